"""A study without a torque reference in; what neither its log nor its limits can tell, as a question, out."""

from __future__ import annotations

from ...core.words import listed
from .finding import Finding, column_line, scaled

_LIKELY = 0.6, 1.7
"""Factors between the load's fitted and its given weight that call for no question."""
_FITS = 0.35
"""Relative error up to which the balance of motors and load says something about their scale."""


def asked(relations, holds, columns, group, limited):
    """Whether the motors' torques are torques.

    Parameters
    ----------
    relations : list
        `ModelRelation` and `RateRelation`, as of `relations.relations`.
    holds : dict of int to Agreement
        How well each relation holds, by its place in the list.
    columns : Columns
        Of the study, mistakes that were found undone.
    group : dict of str to list of str
        Variables by what they are, as `changes.roles` gives them.
    limited : bool
        Whether [limits] bound the torques closely enough to tell.

    Returns
    -------
    list of Finding
    """
    torques = [n for n in group["torques"] if columns.column(n) is not None and columns.column(n).unit == "N.m"]
    if not torques or group["references"]:
        return []
    names = listed(columns.of(n) for n in torques)
    balance = next((k for k, r in enumerate(relations) if getattr(r, "scale", None)), None)
    factor = None
    if balance is not None and max(holds[balance].relative.values()) < _FITS:
        factor = weight(relations[balance], holds[balance].x)
    if factor is not None and _LIKELY[0] <= factor <= _LIKELY[1] or factor is None and limited:
        return []
    if factor is None:
        text = f"Are {names} in N.m, not in A? Nothing in the log, and no [limits], can tell"
        certainty, k_m = 0.2, 0.1
    else:
        text = (f"Are {names} in N.m? They would carry {factor:.3g} times the weight that the rig gives its load; "
                f"currents need unit = \"A\" and k_m")
        certainty, k_m = (0.45, 1 / factor)
    lines = [column_line(columns.of(n), scaled(columns.column(n), k_m, "A", float(f"{k_m:.2g}"))) for n in torques]
    return [Finding("unit", text, [columns.of(n) for n in torques], certainty, mend="\n".join(lines))]


def weight(relation, x):
    """Fitted masses of a load over given ones.

    Parameters
    ----------
    relation : ModelRelation
        Of what the load weighs.
    x : ndarray
        Its free parameters, fitted.

    Returns
    -------
    float or None
        None where no mass is fitted.
    """
    masses = [k for k, n in enumerate(relation.free) if relation.units[n] == "kg"]
    given = sum(relation.given[relation.at[k]] for k in masses)
    return float(sum(x[k] for k in masses) / given) if given > 0 else None

"""Readings and the study's [limits] in; what goes beyond them, out."""

from __future__ import annotations

import numpy as np

from ...study.schema import limit_terms
from .finding import Finding

_OVER = 0.02  # of the limit: noise, and a controller's overshoot
_SHARE = 0.002  # of the samples that may be beyond


def beyond(study, known):
    """How far each limit is exceeded.

    Parameters
    ----------
    study : Study
        Its ``[limits]`` are compared, in SI units.
    known : dict of str to ndarray
        Values by variable.

    Returns
    -------
    dict of str to (float, float, float)
        By the limit's name: the value reached, the limit, and how many times the allowed it is.
    """
    found = {}
    for name, (low, high) in study.limits.items():
        parts = limit_terms(name)
        if not all(p in known for _, p in parts):  # not recorded; that the rig has it, the study was checked for
            continue
        values = sum(factor * known[p] for factor, p in parts)
        both = low is None  # a largest speed or torque holds either way
        least, most = np.quantile(values, (_SHARE, 1 - _SHARE))
        room = max(abs(v) for v in (low, high) if v is not None)
        if high is not None and max(most, -least if both else most) > high + _OVER * room:
            reached = max(most, -least if both else most)
            found[name] = float(reached), high, float(reached / room)
        if low is not None and least < low - _OVER * room:
            found[name] = float(least), low, float(abs(least) / room)
    return found


def limits(study, known, columns, units):
    """What goes beyond the study's limits.

    Parameters
    ----------
    study : Study
        Its ``[limits]`` are compared, in SI units.
    known : dict of str to ndarray
        Values by variable, SI.
    columns : Columns
        Name the columns of the variables in the findings.
    units : dict of str to str
        Unit of each variable, for the words of a finding.

    Returns
    -------
    list of Finding
    """
    found = []
    for name, (reached, limit, times) in beyond(study, known).items():
        parts = [p for _, p in limit_terms(name)]
        unit = units.get(parts[0], "")
        side = "below" if reached < limit else "above"
        text = f"{name} reaches {reached:.4g} {unit}, {side} the {limit:.4g} {unit} of [limits]"
        text += "; check its unit" if times > 3 else ""
        found.append(Finding("limits", text, [columns.of(p) for p in parts],
                             0.95 if times > 1.1 else 0.6))
    return found

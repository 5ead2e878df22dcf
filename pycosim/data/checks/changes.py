"""Columns of a study in; every discrete mistake that could be in them, as a change that would undo it, out.

Nothing here knows a rig: what can be negated, swapped or in another unit follows from the variables' names and units,
and from which of them the model takes and which it predicts.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace

from ...core import units
from ...core.words import listed
from ...study.schema import known_unit
from .finding import column_line, scaled
from .readings import Source

_ALSO = {"rad": ("deg", "rev"), "rad/s": ("deg/s", "rpm", "rev/s"), "N.m": ("mN.m", "N.cm", "kN.m"), "V": ("mV",),
         "N": ("kN",), "m": ("mm",), "m/s": ("mm/s",)}
"""Units that a column may be in although the study says another, by dimension."""
COUNTS = tuple(2 ** k for k in range(8, 25)) + (2000, 4000, 8000, 10000, 20000, 40000, 3600, 36000, 5000, 1000)
"""Steps a turn of usual encoders."""


@dataclass(frozen=True)
class Change:
    """One mistake, undone.

    Attributes
    ----------
    kind : str
        ``sign``, ``swap`` or ``unit``; findings of the check are named alike.
    sources : dict of str to Source
        How the variables are to be read.
    edits : list of tuple
        ``("scale", variable, factor, unit, k_m)`` or ``("swap", variable, variable)``.
    text : str
        What to do, in words.
    doubtful : float
        How much less likely than a plain mistake [1, in logarithms].
    """

    kind: str
    sources: dict
    edits: list
    text: str
    doubtful: float = 0.0
    touched: tuple = field(default=())

    @property
    def variables(self):
        """Variables whose readings change."""
        return set(self.sources)


class Columns:
    """Columns of a study by variable, and what was done to them.

    Parameters
    ----------
    study : Study
        Its ``[columns]`` are copied, so that edits do not reach it.
    names : list of str
        Variables that the logs hold.
    """

    def __init__(self, study, names):
        self.table = {n: c for n, c in study.columns.items() if c.variable in names}

    def of(self, variable):
        """Name of the column that holds a variable.

        Parameters
        ----------
        variable : str
            Of the rig, as ``motor1.tau``.

        Returns
        -------
        str
            The variable's own, where no column is known.
        """
        return next((n for n, c in self.table.items() if c.variable == variable), variable)

    def column(self, variable):
        """Settings of the column that holds a variable.

        Parameters
        ----------
        variable : str
            Of the rig, as ``motor1.tau``.

        Returns
        -------
        Column or None
        """
        return self.table.get(self.of(variable))

    def after(self, edits):
        """The columns after some edits.

        Parameters
        ----------
        edits : list of tuple
            As of `Change`.

        Returns
        -------
        Columns
        """
        made = object.__new__(Columns)
        made.table = dict(self.table)
        for what, variable, *rest in edits:
            name = made.of(variable)
            if what == "swap":
                other = made.of(rest[0])
                one, two = made.table[name], made.table[other]
                made.table[name], made.table[other] = replace(one, variable=two.variable), replace(
                    two, variable=one.variable)
            else:
                made.table[name] = scaled(made.table[name], *rest)
        return made

    def lines(self, before, variables=None):
        """Lines of ``[columns]`` that differ from what was there.

        Parameters
        ----------
        before : Columns
            The same columns before anything was edited.
        variables : set of str, optional
            Only those columns that held one of these.

        Returns
        -------
        str
        """
        return "\n".join(column_line(n, c) for n, c in self.table.items() if c != before.table[n]
                         and (variables is None or before.table[n].variable in variables))


def roles(names, relations):
    """Variables by what they are: angles, speeds, torques that the model takes, and what it predicts.

    Parameters
    ----------
    names : list of str
        Variables that all logs hold.
    relations : list
        `ModelRelation` and `RateRelation`; what they read and predict tells what a variable is.

    Returns
    -------
    dict of str to list of str
        ``angles``, ``speeds``, ``encoders``, ``torques``, ``references``.
    """
    found = {"angles": [n for n in names if n.endswith(".phi")], "speeds": [n for n in names if n.endswith(".w")]}
    models = [r for r in relations if hasattr(r, "name")]
    found["encoders"] = [c for r in models if r.level for c in r.channels]
    found["references"] = list(dict.fromkeys(c for r in models if not r.level and not r.scale for c in r.channels))
    taken = {v for r in models for v in r.variables}
    known = {n for group in found.values() for n in group}
    found["torques"] = [n for n in names if n in taken and n not in known]
    return found


def signs_and_swaps(columns, group):
    """Changes of sign and of place.

    Parameters
    ----------
    columns : Columns
        Of the study, by variable, as they stand before the change.
    group : dict of str to list of str
        As `roles` gives them.

    Returns
    -------
    list of Change
    """
    sets = []
    for members in group.values():
        sets += [(m,) for m in members] + ([tuple(members)] if len(members) > 1 else [])
    pairs = [(a, a[:-3] + "w") for a in group["angles"] if a[:-3] + "w" in group["speeds"]]
    sets += pairs + ([tuple(itertools.chain(*pairs))] if len(pairs) > 1 else [])
    found = [negate(columns, s) for s in sets]
    for members in group.values():
        found += [swap(columns, [(a, b)]) for a, b in itertools.combinations(members, 2)]
    return found + _whole_swaps(columns, group)


def _whole_swaps(columns, group):
    """Swaps of all that belongs to one component with all that belongs to another, and of angles with their speeds."""
    owned = {}
    for name in itertools.chain(*group.values()):
        if "." in name:
            owned.setdefault(name.rsplit(".", 1)[0], set()).add(name.rsplit(".", 1)[1])
    found = []
    for one, two in itertools.combinations(owned, 2):
        shared = owned[one] & owned[two]
        if owned[one] == owned[two] and len(shared) > 1:
            found.append(swap(columns, [(f"{one}.{m}", f"{two}.{m}") for m in sorted(shared)]))
            if {"phi", "w"} < shared:
                found.append(swap(columns, [(f"{one}.{m}", f"{two}.{m}") for m in ("phi", "w")]))
    return found


def negate(columns, variables):
    """Change of sign of some variables.

    Parameters
    ----------
    columns : Columns
        Of the study, by variable, as they stand before the change.
    variables : sequence of str
        Those that are changed together.

    Returns
    -------
    Change
    """
    return Change("sign", {v: Source(v, -1.0) for v in variables}, [("scale", v, -1.0) for v in variables],
                  f"negate {listed(columns.of(v) for v in variables)}")


def swap(columns, pairs):
    """Exchange of pairs of variables.

    Parameters
    ----------
    columns : Columns
        Of the study, by variable, as they stand before the change.
    pairs : list of (str, str)
        Variables that take each other's place.

    Returns
    -------
    Change
    """
    sources = {a: Source(b) for one, two in pairs for a, b in ((one, two), (two, one))}
    texts = [f"{columns.of(a)} with {columns.of(b)}" for a, b in pairs]
    return Change("swap", sources, [("swap", a, b) for a, b in pairs], f"swap {listed(texts)}")


def unit_changes(columns, group, ratios, steps):
    """Changes of unit.

    Parameters
    ----------
    columns : Columns
        Of the study, by variable, as they stand before the change.
    group : dict of str to list of str
        Variables by what they are, as `roles` gives them.
    ratios : dict of str to float
        Gear ratios of the model, by parameter.
    steps : dict of str to float
        Steps in which a column's raw numbers change; 1 where they are whole numbers.

    Returns
    -------
    list of Change
    """
    found = _both_units(columns, group)
    sets = [s for members in group.values()
            for s in [(m,) for m in members] + ([tuple(members)] if len(members) > 1 else [])]
    if group["torques"] and group["references"]:  # from one program that writes all of them alike
        sets.append((*group["torques"], *group["references"]))
    for chosen in sets:
        column = columns.column(chosen[0])
        if column is None or any(columns.column(m) is None or columns.column(m).unit != column.unit for m in chosen):
            continue
        if column.k_m is None:
            dimension, factor = known_unit(column.unit)
            found += [in_unit(columns, chosen, unit, units.UNITS[unit][1] / factor)
                      for unit in _ALSO.get(dimension, ()) if unit != column.unit]
        if column.dimension in ("rad", "rad/s"):
            found += _geared(columns, chosen, ratios)
        if column.dimension == "rad" and all(steps.get(m) == 1.0 for m in chosen):
            found += [counted(columns, chosen, n) for n in COUNTS]
    return found


def _both_units(columns, group):
    """Angles and their speeds in units that go together."""
    found = []
    pairs = [(a, a[:-3] + "w") for a in group["angles"] if a[:-3] + "w" in group["speeds"]]
    for chosen in [(p,) for p in pairs] + ([tuple(pairs)] if len(pairs) > 1 else []):
        columns_of = [columns.column(v) for pair in chosen for v in pair]
        if any(c is None or c.unit not in ("rad", "rad/s") for c in columns_of):
            continue
        for angle in ("deg", "rev"):
            factor = units.UNITS[angle][1]
            edits = [("scale", v, factor, unit) for pair in chosen for v, unit in zip(pair, (angle, f"{angle}/s"))]
            names = listed(columns.of(v) for pair in chosen for v in pair)
            found.append(Change("unit", {e[1]: Source(e[1], factor) for e in edits}, edits,
                                f"{names} are in {angle} and {angle}/s, not in rad and rad/s"))
    return found


def in_unit(columns, variables, unit, factor, k_m=None):
    """The columns are in another unit than the study says.

    Parameters
    ----------
    columns : Columns
        Of the study, by variable, as they stand before the change.
    variables : sequence of str
        Those that are changed together.
    unit : str
        That the columns are in instead, as ``deg``.
    factor : float
        By which the readings [SI] change.
    k_m : float, optional
        Torque constant [N.m/A], of a current.

    Returns
    -------
    Change
    """
    names = listed(columns.of(v) for v in variables)
    before = columns.column(variables[0]).unit
    many = "are" if len(variables) > 1 else "is"
    how = f" with k_m = {k_m:.3g} N.m/A" if k_m is not None else ""
    return Change("unit", {v: Source(v, factor) for v in variables},
                  [("scale", v, factor, unit, k_m) for v in variables],
                  f"{names} {many} in {unit}{how}, not in {before}", 2.0 if k_m is not None else 0.0)


def counted(columns, variables, count):
    """The columns hold steps of an encoder.

    Parameters
    ----------
    columns : Columns
        Of the study, by variable, as they stand before the change.
    variables : sequence of str
        Those that are changed together.
    count : int
        Steps a turn.

    Returns
    -------
    Change
    """
    names = listed(columns.of(v) for v in variables)
    factor = 2 * math.pi / count
    return Change("unit", {v: Source(v, factor) for v in variables}, [("scale", v, factor) for v in variables],
                  f"{names} {'count' if len(variables) > 1 else 'counts'} steps of an encoder with {count} a turn", 1.0)


def _geared(columns, variables, ratios):
    names, found = listed(columns.of(v) for v in variables), []
    for name, ratio in ratios.items():
        for factor, side in ((ratio, "behind"), (1 / ratio, "before")):
            found.append(Change(
                "unit", {v: Source(v, factor) for v in variables}, [("scale", v, factor) for v in variables],
                f"{names} {'are' if len(variables) > 1 else 'is'} measured {side} the gear, {name} = {ratio:g}", 1.0))
    return found


def snapped(columns, group, variable, factor):
    """Changes that multiply a variable by about a factor, each with a reason.

    Parameters
    ----------
    columns : Columns
        Of the study, by variable, as they stand before the change.
    group : dict of str to list of str
        Variables by what they are, as `roles` gives them.
    variable : str
        Whose readings are off, as ``motor1.tau``.
    factor : float
        What the readings are to be multiplied by, in SI units.

    Returns
    -------
    list of Change
    """
    members = next(m for m in group.values() if variable in m)
    found = []
    column = columns.column(variable)
    for chosen in [(variable,)] + ([tuple(members)] if len(members) > 1 else []):
        known = [n for n in COUNTS if column.dimension == "rad" and abs(math.log(2 * math.pi / n / factor)) < 0.05]
        found += [counted(columns, chosen, n) for n in known]
        if not known:
            names = listed(columns.of(v) for v in chosen)
            found.append(Change("unit", {v: Source(v, factor) for v in chosen},
                                [("scale", v, factor) for v in chosen],
                                f"multiply {names} by {factor:.4g}", 3.0))
    return found

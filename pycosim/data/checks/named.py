"""Names of columns and a study in; those that state another unit than the study, out."""

from __future__ import annotations

from ...study.schema import Column, known_unit
from ..likeness import named_unit
from .finding import Finding, column_line, scaled

_TEMPERATURES = ("degC", "K")  # of which only differences count


def named(study, logs, told):
    """Columns whose names state a unit that the study does not give them.

    Parameters
    ----------
    study : Study
        A column that it gives a gain is taken to be converted by that.
    logs : list of Log
        Their headers hold the names.
    told : list of Finding
        What the readings themselves have told; a column whose unit is among that is not told again.

    Returns
    -------
    list of Finding
        Another unit of the same quantity is sure; another quantity is a question, as a bracket may hold anything.
    """
    known = {n for f in told if f.kind == "unit" for n in f.columns}
    columns = {study.time_column: Column("time", "s"), **study.columns}
    if study.rate is not None:
        columns.pop(study.time_column)
    return [finding for name, column in columns.items()
            if name not in known and column.gain == 1.0 and any(name in log.header for log in logs)
            for finding in _contradicted(name, column)]


def _contradicted(name, column):
    """The finding of one column, if there is one."""
    unit = named_unit(name)
    if unit is None or known_unit(unit) == known_unit(column.unit):
        return
    dimension, given = known_unit(unit)[0], known_unit(column.unit)[0]
    if dimension in _TEMPERATURES and given in _TEMPERATURES:
        return
    text = f"{name} has {unit} in its name, and the study says {column.unit}"
    if dimension == given:
        yield Finding("unit", text, [name], 0.95, mend=column_line(name, scaled(column, 1.0, unit, column.k_m)))
    elif {dimension, given} == {"A", "N.m"}:
        text += "; currents need k_m in N.m/A as well" if dimension == "A" else ""
        line = column_line(name, scaled(column, 1.0, unit, 0.1))
        yield Finding("unit", f"{text}; which is it?", [name], 0.45, mend=line)
    else:
        yield Finding("unit", f"{text}; which is it?", [name], 0.45)

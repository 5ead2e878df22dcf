"""The name of a log's column and a variable of a rig in; how alike they are, and the unit that the name states, out."""

from __future__ import annotations

import re

from ..core.units import SPELLINGS
from ..study.schema import known_unit

# words of a column's name that tell what it holds, by SI unit; some in the other languages that recorders speak
WORDS = {"rad": {"theta", "phi", "angle", "pos", "position", "enc", "encoder", "winkel"},
         "m": {"q", "x", "pos", "position", "enc", "encoder", "weg"},
         "rad/s": {"omega", "w", "speed", "vel", "velocity", "dtheta", "drehzahl"},
         "m/s": {"v", "speed", "vel", "velocity"},
         "N.m": {"tau", "torque", "moment", "trq", "drehmoment", "m"}, "N": {"force", "f", "kraft"},
         "A": {"current", "iq", "i", "curr", "strom"}, "V": {"voltage", "volt", "u", "spannung"},
         "degC": {"temperature", "temp", "temperatur"},
         "s": {"time", "t", "timestamp", "zeit", "temps", "seconds", "elapsed", "millis"}}
PLAIN_WORDS = {"measured", "meas", "act", "actual", "ist", "raw", "value", "sensor"}
"""Words of a column's name that change nothing; any other one may, as `desired` or `joint` do."""
SUFFIXES = ("deg", "rad", "rpm", "rad/s", "deg/s", "rev/s", "N.m", "mN.m", "ms", "us")
"""Units that a name may end with behind an underscore; shorter ones might be something else."""


def _parted(name):
    """A name, and the unit behind its last underscore or stroke, or None."""
    for mark, known in (("_", SUFFIXES), ("/", None)):
        before, _, text = name.rpartition(mark)
        unit = _unit(text) if before else None
        if unit and (known is None or unit in known):
            return before, unit
    return name, None


def _unit(text):
    """A unit in any usual spelling, as a study writes it; None for what is none."""
    text = text.strip()
    for spelled in (text, text.lower(), text.replace("·", "."), text.lower().replace("nm", "N.m")):
        if spelled and spelled not in ("-", "1") and known_unit(spelled) is not None:
            return SPELLINGS.get(spelled, spelled)
    return None


def stated(seen, name):
    """Unit that a column's name or the row below it states, as in ``angle [deg]`` or ``angle_deg``.

    Parameters
    ----------
    seen : Look
        Head of the log, with the row below its header.
    name : str
        Of the column, as the log's header has it.

    Returns
    -------
    str or None
    """
    return _unit(seen.units.get(name, "").strip("[]()")) or named_unit(name)


def named_unit(name):
    """Unit that a column's name states.

    Parameters
    ----------
    name : str
        Of the column, as the log's header has it.

    Returns
    -------
    str or None
        As a study writes it.

    Examples
    --------
    >>> named_unit("torque (mNm)")
    'mN.m'
    """
    inside = re.findall(r"[\[(](.*?)[\])]", name)
    return _unit(inside[-1]) if inside else _parted(name)[1]


def bare(name):
    """A column's name without its unit.

    Parameters
    ----------
    name : str
        Of the column, as the log's header has it.

    Returns
    -------
    str

    Examples
    --------
    >>> bare("theta1 [deg]")
    'theta1'
    """
    text = re.sub(r"\s*[\[(].*?[\])]\s*", " ", name).strip()
    return _parted(text)[0]


def words(name):
    """Words of a column's name, without its unit.

    Parameters
    ----------
    name : str
        Of the column, as the log's header has it.

    Returns
    -------
    set of str
        In small letters.

    Examples
    --------
    >>> sorted(words("Motor 1 torque [Nm]"))
    ['motor', 'torque']
    """
    return {w.lower() for w in re.findall(r"[^\W\d_]+", bare(name))}


def _number(name):
    digits = re.findall(r"\d+", bare(name))
    return digits[-1] if digits else ""


def likeness(name, told, variable, unit, model):
    """How much a column's name is like a variable's.

    Parameters
    ----------
    name : str
        Of the column, as the log's header has it.
    told : str or None
        Unit that the column states.
    variable, unit : str
        Of the rig.
    model : Model
        The rig; the description of the variable may have words of the name.

    Returns
    -------
    float
        0 for not at all.
    """
    dimension = known_unit(told)[0] if told else None
    if dimension not in (None, unit) and not (dimension == "A" and variable.endswith(".tau")):
        return 0.0
    plain = bare(name)
    if plain == variable:
        return 4.0
    if re.sub(r"\W|_", "", plain).lower() == re.sub(r"\W|_", "", variable).lower():
        return 3.0
    component = variable.rpartition(".")[0]
    if _number(name) != _number(component):
        return 0.0
    kind = WORDS.get(unit, set()) | (WORDS["A"] if variable.endswith(".tau") else set())
    rest = words(name) - PLAIN_WORDS
    if not rest & kind and dimension is None:
        return 0.0
    place = component.lower().rstrip("0123456789")
    rest = rest - kind - ({place} if place else set())
    if rest:  # words that say something else, unless the variable's own description has them
        flat = model.variables.get(variable)
        described = set(re.findall(r"\w+", flat.description.lower())) if flat else set()
        return 1.5 if rest <= described else 0.0
    return 2.0 if place and place in plain.lower() else 1.0

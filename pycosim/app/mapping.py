"""The columns of a log and the variables of a rig in; which column is likely which variable, in which unit, out."""

from __future__ import annotations

import re

from ..study.schema import LOG_VARIABLES, Column

# words of a column's name that tell what it is: last part of a variable's name, its unit
WORDS = {"phi": ("theta", "phi", "angle", "pos", "position", "enc", "encoder"),
         "w": ("omega", "w", "speed", "vel", "velocity", "dtheta"),
         "tau": ("tau", "torque", "moment", "trq", "current", "iq", "i")}
CURRENTS = "current", "iq", "i"
UNITS = {"deg": "deg", "rad": "rad", "rpm": "rpm", "deg/s": "deg/s", "rad/s": "rad/s", "nm": "N.m", "n.m": "N.m",
         "mnm": "mN.m", "a": "A", "ma": "mA", "ms": "ms", "s": "s", "degc": "degC", "c": "degC", "v": "V"}


def wanted(model):
    """Variables of a rig that a log can hold.

    Parameters
    ----------
    model : Model

    Returns
    -------
    dict of str to (str, str)
        Unit, and what it is for: ``needed``, ``compared``, ``optional``.
    """
    outputs, known = model.alternatives("estimate")[0]
    flat = model.variables
    found = {n: (flat[n].unit, "needed") for n in known if n in flat}
    found.update({n: (flat[n].unit, "compared") for n in outputs})
    speeds = [f"{n[:-4]}.w" for n in known if n.endswith(".phi")]
    encoders = list(model.aliases("encoders"))
    found.update({n: (flat[n].unit, "optional") for n in [*speeds, *encoders] if n in flat and n not in found})
    found["temperature"] = LOG_VARIABLES["temperature"], "optional"
    return found


def suggest(header, model):
    """Columns that a log's names suggest.

    Parameters
    ----------
    header : list of str
        Columns of the log.
    model : Model

    Returns
    -------
    dict of str to Column
        By the column's name; each variable once, and none where no name is alike. A current lacks its k_m, which no
        name tells.
    """
    found, left = {}, dict(wanted(model))
    scored = sorted(((_likeness(name, variable), -k, name, variable) for k, name in enumerate(header)
                     for variable in left), reverse=True)
    for likeness, _, name, variable in scored:
        if likeness > 0 and name not in found and variable in left:
            unit, _ = left.pop(variable)
            stated = _stated(name)
            current = variable.endswith(".tau") and (stated in ("A", "mA") or bool(_words(name) & set(CURRENTS)))
            found[name] = Column(variable, stated or ("A" if current else unit))
    return found


def _words(name):
    bare = re.sub(r"[\[(].*?[\])]", "", name)
    return {w.lower() for w in re.findall(r"[A-Za-z]+", bare)}


def _number(name):
    digits = re.findall(r"\d+", re.sub(r"[\[(].*?[\])]", "", name))
    return digits[-1] if digits else ""


def _likeness(name, variable):
    """How much a column's name is like a variable's, 0 for not at all."""
    bare = re.sub(r"\s*[\[(].*?[\])]\s*", "", name)
    if bare == variable:
        return 4.0
    if bare.lower() == variable.lower():
        return 3.0
    component, _, kind = variable.rpartition(".")
    if not _words(name) & set(WORDS.get(kind, ())):
        return 0.0
    if _number(name) != _number(component):
        return 0.0
    return 2.0 if component.lower().rstrip("0123456789") in name.lower() else 1.0


def _stated(name):
    """Unit that a column's name states, as in ``angle [deg]`` or ``angle_deg``."""
    inside = re.findall(r"[\[(](.*?)[\])]", name)
    text = inside[-1] if inside else name.rpartition("_")[2] if "_" in name else ""
    unit = UNITS.get(text.strip().lower())
    return unit if inside or unit in ("deg", "rad", "rpm", "N.m", "mN.m", "ms") else None

"""A Modelica unit as text in, its SI exponents and display units out."""

from __future__ import annotations

import math
import re

# symbol: exponents of the SI base units, factor is always 1 (facts of the SI brochure)
_BASE = {
    "1": {}, "kg": {"kg": 1}, "m": {"m": 1}, "s": {"s": 1}, "A": {"A": 1}, "K": {"K": 1}, "mol": {"mol": 1},
    "cd": {"cd": 1}, "rad": {"rad": 1}, "degC": {"K": 1}, "Hz": {"s": -1}, "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2}, "W": {"kg": 1, "m": 2, "s": -3}, "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
}
_OFFSET = {"degC": 273.15}
_DISPLAY = {"rad": "deg", "rad/s": "deg/s", "rad/s2": "deg/s2", "N.m/rad": "N.m/deg"}
_FACTOR = {"rad": 180 / math.pi, "rad/s": 180 / math.pi, "rad/s2": 180 / math.pi, "N.m/rad": math.pi / 180}
QUANTITIES = {  # of the Modelica Standard Library, for units that stand for one quantity here
    "rad": "Angle", "rad/s": "AngularVelocity", "rad/s2": "AngularAcceleration", "N.m": "Torque", "kg": "Mass",
    "kg.m2": "MomentOfInertia", "m": "Length", "m/s": "Velocity", "m/s2": "Acceleration", "N": "Force", "s": "Time",
    "A": "Current", "V": "Voltage", "Ohm": "Resistance", "W": "Power", "K": "Temperature",
    "N.m.s/rad": "RotationalDampingConstant", "N.m/rad": "RotationalSpringConstant"}
ORDER = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


def exponents(unit):
    """Exponents of the SI base units of a unit.

    Parameters
    ----------
    unit : str
        As Modelica writes it: ``N.m.s/rad``, ``1/(N.m)``, ``kg.m2``.

    Returns
    -------
    dict of str to int, or None
        None for a unit with a symbol that is not known.
    """
    total, sign = {}, 1
    for token in re.findall(r"\([^()]*\)|[./]|[A-Za-z]+-?\d*|1", unit):
        if token in "./":
            sign = -1 if token == "/" else 1
            continue
        inner = exponents(token[1:-1]) if token.startswith("(") else _factor(token)
        if inner is None:
            return None
        for base, power in inner.items():
            total[base] = total.get(base, 0) + sign * power
        sign = 1
    return {base: total[base] for base in ORDER if total.get(base)}


def _factor(token):
    symbol, power = re.fullmatch(r"([A-Za-z]+|1)(-?\d*)", token).groups()
    if symbol not in _BASE:
        return None
    return {base: n * int(power or 1) for base, n in _BASE[symbol].items()}


def offset(unit):
    """What to add to a value for the base unit.

    Parameters
    ----------
    unit : str
        As Modelica writes it, as ``degC``.

    Returns
    -------
    float
        273.15 for degC, else 0.
    """
    return _OFFSET.get(unit, 0.0)


def display(unit):
    """Unit that people like to read a quantity in.

    Parameters
    ----------
    unit : str
        As Modelica writes it.

    Returns
    -------
    tuple of (str, float), or None
        The display unit, and the factor that takes a value to it; None where the unit itself does.
    """
    return (_DISPLAY[unit], _FACTOR[unit]) if unit in _DISPLAY else None


def rate(unit):
    """Unit of the derivative of a quantity by time.

    Parameters
    ----------
    unit : str
        Of the quantity.

    Returns
    -------
    str
        ``rad/s`` for ``rad``, ``rad/s2`` for ``rad/s``.
    """
    known = {"rad": "rad/s", "rad/s": "rad/s2", "m": "m/s", "m/s": "m/s2", "1": "1/s"}
    return known.get(unit, f"({unit})/s" if "/" in unit else f"{unit}/s")

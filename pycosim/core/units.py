"""Named quantities with units: conversion of what users write to SI, and the description of a model's variables."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .errors import UnknownNameError, closest

KGF, LBF = 9.80665, 4.4482216152605  # N, by definition
# unit: (dimension, factor to SI). Facts of the SI brochure; degC is kept as it is, since only differences enter.
UNITS = {
    "1": ("1", 1.0), "-": ("1", 1.0), "%": ("1", 0.01),
    "s": ("s", 1.0), "ms": ("s", 1e-3), "us": ("s", 1e-6), "ns": ("s", 1e-9), "min": ("s", 60.0),
    "rad": ("rad", 1.0), "deg": ("rad", math.pi / 180), "rev": ("rad", 2 * math.pi), "mrad": ("rad", 1e-3),
    "rad/s": ("rad/s", 1.0), "deg/s": ("rad/s", math.pi / 180), "rpm": ("rad/s", 2 * math.pi / 60),
    "rev/s": ("rad/s", 2 * math.pi), "rad/s2": ("rad/s2", 1.0), "deg/s2": ("rad/s2", math.pi / 180),
    "N.m": ("N.m", 1.0), "mN.m": ("N.m", 1e-3), "uN.m": ("N.m", 1e-6), "kN.m": ("N.m", 1e3), "N.cm": ("N.m", 1e-2),
    "N": ("N", 1.0), "kN": ("N", 1e3), "m": ("m", 1.0), "mm": ("m", 1e-3), "m/s": ("m/s", 1.0), "mm/s": ("m/s", 1e-3),
    "V": ("V", 1.0), "mV": ("V", 1e-3), "A": ("A", 1.0), "mA": ("A", 1e-3), "degC": ("degC", 1.0), "K": ("K", 1.0),
    "kg": ("kg", 1.0), "g": ("kg", 1e-3), "kg.m": ("kg.m", 1.0), "kg.m2": ("kg.m2", 1.0),
    "W": ("W", 1.0), "Ohm": ("Ohm", 1.0),
    "kgf": ("N", KGF), "lbf": ("N", LBF), "kgf.m": ("N.m", KGF), "kgf.cm": ("N.m", 0.01 * KGF),
    "lbf.ft": ("N.m", 0.3048 * LBF), "lbf.in": ("N.m", 0.0254 * LBF), "ozf.in": ("N.m", 0.0254 * LBF / 16),
    "kg.cm2": ("kg.m2", 1e-4), "g.cm2": ("kg.m2", 1e-7), "m/s2": ("m/s2", 1.0), "mm/s2": ("m/s2", 1e-3),
}
SPELLINGS = {"Nm": "N.m", "N*m": "N.m", "N m": "N.m", "mNm": "mN.m", "°": "deg", "degrees": "deg", "radians": "rad",
             "°C": "degC", "C": "degC", "sec": "s", "r/min": "rpm", "1/min": "rpm", "rev/min": "rpm", "": "1",
             "rad/s^2": "rad/s2", "kg.cm": "kgf.cm", "kgcm": "kgf.cm", "oz-in": "ozf.in", "oz.in": "ozf.in",
             "lb-ft": "lbf.ft", "lb.ft": "lbf.ft", "lb-in": "lbf.in", "lb.in": "lbf.in", "gcm2": "g.cm2"}


def to_si(unit, expected, where):
    """Factor that takes a value in ``unit`` to the SI unit ``expected``.

    Parameters
    ----------
    unit : str
        Unit as the user wrote it.
    expected : str
        SI unit of the variable it is for.
    where : str
        Place in the study or log, for the message.

    Returns
    -------
    float

    Raises
    ------
    UnknownNameError
        The unit is unknown, or of another dimension.

    Examples
    --------
    >>> to_si("deg", "rad", "column 'theta'")
    0.017453292519943295
    """
    name = SPELLINGS.get(unit, unit)
    if name not in UNITS:
        raise UnknownNameError(f"{where}: unknown unit '{unit}'{closest(unit, UNITS)}")
    dimension, factor = UNITS[name]
    if dimension != expected:
        fitting = [u for u, (d, _) in UNITS.items() if d == expected]
        raise UnknownNameError(f"{where}: unit '{unit}' does not fit a quantity in {expected}; "
                               f"use one of {', '.join(fitting) or expected}")
    return factor


@dataclass(frozen=True)
class Variable:
    """A variable or parameter of a model.

    Attributes
    ----------
    name : str
        Modelica name, as ``s1A.f0``.
    unit, description : str
        From the Modelica declaration.
    value : float
        Default value of a parameter, start value of a state.
    min, max, nominal : float
        From the Modelica declaration.
    """

    name: str
    unit: str = "1"
    description: str = ""
    value: float = 0.0
    min: float = -math.inf
    max: float = math.inf
    nominal: float = 1.0

"""A recorder file of EPOS Studio (semicolons, Latin-1) comes in; a Table in SI units goes out.

Columns: time [s], velocity [rad/s], torque [N.m]. `meta["speed"]` is the commanded speed [rad/s] that the file's name
says (`n20.csv` is -20 rpm). The drives log velocity and torque with the sign opposite to that name. Data:
Mablekos-Alexiou, da Cruz, Bergeles, IEEE T-RO 37(4), 2021.
"""

from __future__ import annotations

import math
import re

import numpy as np

from ...core.errors import DataError
from . import Table, read_text

NOMINAL_TORQUE = 9.84e-3
"""Nominal torque of the motor [N.m], 100 % in the file."""
_UNITS = {"ms": ("time", 1e-3), "s": ("time", 1.0), "rpm": ("velocity", 2 * math.pi / 60),
          "%": ("torque", NOMINAL_TORQUE / 100)}


def read(path, wanted, text):
    """Read one recording; see `pycosim.data.readers.read_parts`.

    Raises
    ------
    DataError
        No units line, an unknown unit, or a row that does not hold a number for each unit.
    """
    lines = read_text(path, "latin-1").splitlines()
    start = next((k for k, line in enumerate(lines) if re.fullmatch(r"m?s(;[^;]+)+;?", line.strip())), None)
    if start is None:
        raise DataError(f"{path}: no units line as 'ms;rpm;%'; is [data] reader = \"epos\" right?")
    units = lines[start].strip().rstrip(";").split(";")
    for unit in units:
        if unit not in _UNITS:
            raise DataError(f"{path}, row {start + 1}: unknown unit '{unit}'; known: {', '.join(_UNITS)}")
    names = [_UNITS[unit][0] for unit in units]
    if len(set(names)) < len(names):
        raise DataError(f"{path}, row {start + 1}: several columns have the same unit; keep one of each of "
                        f"{', '.join(dict.fromkeys(units))}")
    while lines and not lines[-1].strip():
        lines.pop()
    values = np.array([_row(path, k + 1, lines[k], len(units)) for k in range(start + 1, len(lines))])
    values = values.reshape(-1, len(units))
    columns = {n: values[:, k] * _UNITS[u][1] for k, (n, u) in enumerate(zip(names, units))}
    named = re.fullmatch(r"(n?)(\d+(?:\.\d+)?)", path.stem)
    meta = {"speed": float(named[2]) * (-1 if named[1] else 1) * 2 * math.pi / 60} if named else {}
    return Table(columns, list(columns), np.arange(start + 1, len(lines)) + 1, meta=meta)


def _row(path, row, line, expected):
    cells = line.strip().split(";")
    if len(cells) != expected:
        raise DataError(f"{path}, row {row}: has {len(cells)} fields, the units line has {expected}")
    try:
        return [float(cell) for cell in cells]
    except ValueError:
        raise DataError(f"{path}, row {row}: '{line[:40]}' is not {expected} numbers") from None

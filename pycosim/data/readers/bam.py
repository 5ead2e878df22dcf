"""A log of BAM's servo bench (JSON, one run) comes in; a Table in SI units goes out, powered samples only.

Columns: time [s], position [rad], speed [rad/s], voltage [V], torque_enable [1], temperature [degC], goal_position
[rad]. Constants of the run (mass [kg], length [m], kp, trajectory, vin [V], motor) are in `meta`. Rows are the entries,
counted from 1. The servo's own speed lags its position by about 20 ms. Format: Rhoban, Better Actuator Models,
https://github.com/Rhoban/bam.
"""

from __future__ import annotations

import json

import numpy as np

from ...core.errors import DataError, closest
from . import Table, ranges, read_text

FULL_SCALE = 885.0
"""PWM `load` of the full supply voltage on a Dynamixel XL330."""
_ENTRY = {"timestamp": "time", "position": "position", "speed": "speed", "temp": "temperature",
          "goal_position": "goal_position", "torque_enable": "torque_enable"}
_META = ("mass", "length", "kp", "trajectory", "vin", "motor")


def read(path, wanted, text):
    """Read one run; see `pycosim.data.readers.read_parts`.

    `meta["powered"]` is False where the torque goes off in the run.

    Raises
    ------
    DataError
        Not JSON, not such a log, or no powered sample.
    """
    try:
        run = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise DataError(f"{path}, row {error.lineno}: is not JSON ({error.msg}); "
                        'is [data] reader = "bam" right?') from None
    entries = run.get("entries") if isinstance(run, dict) else None
    if not isinstance(entries, list) or not entries:
        raise DataError(f"{path}: has no entries; is [data] reader = \"bam\" right?")
    columns = {name: _column(path, entries, key) for key, name in _ENTRY.items()}
    load = _column(path, entries, "load")
    # an unsigned 16-bit wrap of a signed number
    columns["voltage"] = np.where(load > 32767, load - 65536, load) / FULL_SCALE * _column(path, entries, "input_volts")
    rows = np.arange(len(entries)) + 1
    # after the torque has been off once the motor is no longer the actuator of this run
    powered = np.logical_and.accumulate(columns["torque_enable"] > 0.5)
    if not powered.any():
        raise DataError(f"{path}: the torque is never switched on; leave this run out of the study")
    meta = {key: run[key] for key in _META if key in run}
    meta["powered"] = bool(powered.all()) and meta.get("trajectory") != "lift_and_drop"
    kept = {name: values[powered] for name, values in columns.items()}
    return Table(kept, list(columns), rows[powered], ranges(rows[~powered]), meta)


def _column(path, entries, key):
    try:
        return np.array([entry[key] for entry in entries], dtype=float)
    except KeyError:
        row, entry = next((k, e) for k, e in enumerate(entries, 1) if key not in e)
        raise DataError(f"{path}, entry {row}: no '{key}'{closest(key, entry)}") from None
    except (TypeError, ValueError):
        for row, entry in enumerate(entries, 1):
            if not isinstance(entry, dict) or not isinstance(entry.get(key), (int, float)):
                raise DataError(f"{path}, entry {row}: '{key}' is not a number") from None
        raise

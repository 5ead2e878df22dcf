"""An MDF file (version 3 or 4) comes in; a Table goes out.

The column ``time`` is the master channel of the wanted channels [s], unless the file has a channel of that name.
"""

from __future__ import annotations

import gc
import sys
from contextlib import contextmanager

import numpy as np

from ...core.errors import DataError
from . import Table, numbers, one_clock, optional

TIME = "time"


def read(path, wanted, text):
    """Read the wanted channels of an MDF file; see `pycosim.data.readers.read_parts`.

    Raises
    ------
    DataError
        asammdf is not installed, the file is not MDF or cut short, a channel is there several times or is no number,
        or the wanted channels do not share a master.
    """
    module = optional(path, "asammdf", "asammdf", "MDF", "mdf")
    signals = None
    with _unheard():
        try:
            with path.open("rb") as stream, module.MDF(stream) as file:
                places = _channels(file)
                signals = {n: _signal(path, file, n, places[n]) for n in places if n in wanted | {text}}
        except DataError:
            raise
        except Exception:  # the package raises whatever it stumbles over in a broken file
            pass
    if signals is None:  # raised out here, so that nothing keeps the half-made file alive
        raise DataError(f"{path}: is not an MDF file, or is cut short; repair it, or export the log as CSV or Parquet")
    columns = {n: _labels(s) if n == text else _values(path, n, s) for n, s in signals.items()}
    header = [*places] if TIME in places else [TIME, *places]
    if not columns:
        return Table({TIME: np.empty(0)}, header, np.arange(0))
    clock = one_clock(path, {n: s.timestamps for n, s in signals.items()})
    if TIME in wanted:
        columns.setdefault(TIME, clock)
    return Table(columns, header, np.arange(len(clock)) + 1)


@contextmanager
def _unheard():
    """Half-made files complain on stderr when they are collected; what is wrong is said in our own words."""
    before, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        yield
    finally:
        gc.collect()
        sys.unraisablehook = before


def _channels(file):
    """Groups and indices of every channel that is no master, by name."""
    masters = set(file.masters_db.items())
    found = {n: [p for p in places if tuple(p) not in masters] for n, places in file.channels_db.items()}
    return {n: places for n, places in found.items() if places}


def _signal(path, file, name, places):
    if len(places) > 1:
        raise DataError(f"{path}: channel '{name}' is there {len(places)} times; keep one")
    (group, index), = places
    return file.get(group=group, index=index, ignore_invalidation_bits=True)


def _values(path, name, signal):
    values = numbers(path, name, signal.samples)
    invalid = signal.invalidation_bits
    return values if invalid is None else np.where(np.asarray(invalid, dtype=bool), np.nan, values)


def _labels(signal):
    return np.array([v.decode("utf-8", "replace").rstrip("\0") if isinstance(v, bytes) else str(v)
                     for v in signal.samples.tolist()])

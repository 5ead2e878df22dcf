"""Log files and a study in; checked signals in SI units out."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..core.errors import DataError, StillError, closest
from ..core.units import UNITS
from .chunks import Gathered
from .copies import refuse_copies
from .frames import Frame
from .likeness import bare, named_unit
from .readers import read_parts
from .stale import fresh
from .stamps import evened

SLOWEST, FASTEST = 10.0, 1e-6
"""Median sample intervals [s] beyond which the time column cannot be in seconds."""
_SLOW = ("degC", "K")
_USUAL = 0.2  # s between samples of a drive at most


@dataclass
class Log:
    """One run, checked.

    Attributes
    ----------
    name : str
        File name.
    path : Path
        Of the file; of a table in memory, what stands for it.
    time : ndarray, shape (n,)
        Strictly increasing [s].
    signals : dict of str to ndarray, shape (n,)
        By variable of the rig, SI units.
    labels : ndarray of str, shape (n,), or None
        The column that the study calls its labels, as the manoeuvre; None without one.
    dropped : list of (int, int)
        First and last row of stretches left out: drop-outs, or samples that the format says are not to be used.
    meta : dict
        What the file says about the run; ``samples`` and ``deviation`` when the log is the mean of a file;
        ``file_rows`` and ``means_of`` when its samples are the means of so many rows; with ``stands``, variable to the
        rows for which its readings stand, its samples are rows in which they are new, and ``whole`` says whether all
        stand alike.
    rows : ndarray of int, shape (n,)
        Row in the file, as an editor shows it; the header is row 1. Of a mean, the first one.
    header : list of str
        Columns of the file.
    columns : dict of str to str
        Variable to the column that the study maps to it, in the file or not.
    held_out : bool
        Whether the study keeps this log for the test.
    """

    name: str
    path: Path
    time: np.ndarray
    signals: dict
    labels: np.ndarray | None = None
    dropped: list = field(default_factory=list)
    meta: dict = field(default_factory=dict)
    rows: np.ndarray | None = None
    header: list = field(default_factory=list)
    columns: dict = field(default_factory=dict)
    held_out: bool = False


def load(study, files=None, strict=True):
    """Read the logs of a study.

    Parameters
    ----------
    study : Study
        Its ``[data]`` and ``[columns]`` say what is read, and how.
    files : sequence of path, optional
        Instead of the study's own.
    strict : bool
        Refuse what only a wrong unit or sign can be; else that is left to `pycosim.data.checks`.

    Returns
    -------
    list of Log
        Runs, then held-out runs (`Log.held_out`).

    Raises
    ------
    DataError
        A log cannot be used, or there is none.
    StudyError
        One of them holds a stretch of another.
    """
    study = study if files is None else study.with_data(files)
    if not study.runs:
        raise DataError(f"{study.path}: no logs to fit; list them in [data] runs, or give --data FILE...")
    logs = [read_log(path, study, strict) for path in study.runs]
    logs += [replace(read_log(path, study, strict), held_out=True) for path in study.held_out]
    refuse_copies(logs)
    return logs


def read_log(path, study, strict=True):
    """Read one log and refuse what a fit would silently suffer from.

    Parameters
    ----------
    path : path or Frame
        A file, or a table in memory.
    study : Study
        Columns, units, labels, what to do with drop-outs, reader, average, most rows to keep apart.
    strict : bool
        As for `load`.

    Returns
    -------
    Log

    Raises
    ------
    DataError
        The file, a row or a column cannot be used; the message names it and says what to do.
    """
    path = path if isinstance(path, Frame) else Path(path)
    wanted = set(study.columns) | ({study.time_column} if study.rate is None else set())
    count, tables = (path.parts(wanted, study.labels) if isinstance(path, Frame)
                     else read_parts(path, study.reader, wanted, study.labels, study.layout))
    first = next(tables)
    used = {n: c for n, c in study.columns.items() if n in first.columns and n != study.time_column}
    _check_columns(path, first, study, used)
    # the scatter within a file that is one sample needs every row
    every = 1 if study.average == "file" else max(1, math.ceil(count / study.most))
    clock = study.columns[study.time_column].si if study.time_column in study.columns else np.asarray
    gathered = Gathered(path, study.time_column, clock, [study.time_column, *used], study.labels, every, study.time)
    for table in itertools.chain([first], tables):
        if study.rate is not None:
            table.columns[study.time_column] = (table.rows - first.rows[0]) / study.rate
        gathered.add(table)
    columns, rows = gathered.finish(study.drop_outs)
    new, stale = _fresh(columns, used) if every == 1 and study.average != "file" else (slice(None), {})
    columns, rows = {n: v[new] for n, v in columns.items()}, rows[new]
    columns[study.time_column], rounded = evened(columns[study.time_column])
    meta = first.meta | ({"file_rows": count, "means_of": every} if every > 1 else {}) | (
        {"rounded_time": rounded} if rounded else {}) | ({"file_rows": count, **stale} if stale else {})
    log = Log(path.name, path, columns[study.time_column], _signals(path, columns, study, used),
              columns.get(study.labels), gathered.dropped, meta, rows, first.header,
              {c.variable: n for n, c in study.columns.items()})
    _check_torques(log, used)
    _check_motion(log, used)
    if strict or study.average == "file":
        require_units([log])
    return _average(log) if study.average == "file" else log


def _fresh(columns, used):
    """Rows in which readings are new, where some stand for several; how long a slow temperature stands is no matter."""
    asked = {n: columns[n] for n, c in used.items() if c.dimension not in _SLOW}
    new, rows = fresh(asked)
    return new, {"stands": {used[n].variable: k for n, k in rows.items()},
                 "whole": len(rows) == len(asked) and len({*rows.values()}) == 1} if rows else {}


def _signals(path, columns, study, used):
    """Columns of a file as signals in SI units, at the times of their rows."""
    time = columns[study.time_column]
    for name, column in used.items():
        if abs(column.late) >= time[-1] - time[0] > 0:
            raise DataError(f"{path}: column '{name}' has late = {column.late:g} s in the study, and the log lasts "
                            f"{time[-1] - time[0]:.4g} s alone; late is in s, as 0.012 for 12 ms")
    return {c.variable: c.timely(time, c.si(columns[n])) for n, c in used.items()}


def require_units(logs):
    """Refuse logs whose times cannot be in seconds, or whose speeds are not those of their angles.

    Parameters
    ----------
    logs : list of Log
        Of one study.

    Raises
    ------
    DataError
        Says which unit is to be looked at.
    """
    for log in logs:
        median = float(np.median(np.diff(log.time))) / log.meta.get("means_of", 1) if log.time.size > 1 else 1.0
        if not FASTEST <= median <= SLOWEST:
            unit = next((u for u in ("ms", "us", "ns") if median * UNITS[u][1] <= _USUAL), "ns")
            raise DataError(f"{log.path}: a sample every {median:.3g} s (median) cannot be; time must be in s, or say "
                            f'its unit: [columns] time = {{ variable = "time", unit = "{unit}" }}')
        _check_speeds(log)


def require(log, names):
    """Refuse a log that lacks variables.

    Parameters
    ----------
    log : Log
        Named in what is refused.
    names : iterable of str
        Variables of the rig that a question needs.

    Raises
    ------
    DataError
        Names the column that should hold the first missing variable.
    """
    for name in names:
        if name in log.signals:
            continue
        column = log.columns.get(name)
        if column is None:
            raise DataError(f"{log.path}: '{name}' is needed, and no column of the study holds it; "
                            f'add [columns] "<column>" = {{ variable = "{name}", unit = ".." }}')
        if column == name:
            raise DataError(f"{log.path}: no column '{name}'{closest(name, log.header)}; "
                            "[columns] names the column that holds this variable")
        raise DataError(f"{log.path}: no column '{column}', which holds '{name}'{closest(column, log.header)}")


def require_alike(logs, names):
    """Refuse logs of which some lack what others hold: the model cannot be compared with half of a reference.

    Parameters
    ----------
    logs : list of Log
        That are fitted together.
    names : iterable of str
        Variables of the rig.

    Raises
    ------
    DataError
        Names the first log that lacks one.
    """
    for name in names:
        lacking = [log for log in logs if name not in log.signals]
        if lacking and len(lacking) < len(logs):
            other = next(log for log in logs if name in log.signals)
            raise DataError(f"{lacking[0].path}: no column '{lacking[0].columns[name]}', which {other.name} has; "
                            "fit logs with and without it in two studies, or take the column out of [columns]")


# --- checks ---------------------------------------------------------------------------------------------------------


def _check_columns(path, table, study, used):
    if study.rate is None and study.time_column not in table.columns:
        raise DataError(f"{path}: no column '{study.time_column}' for the time"
                        f"{closest(study.time_column, table.header)}; rename it, set [data] time_column, or "
                        "[data] rate where there is none")
    if study.rate is not None and study.time_column in table.header:
        raise DataError(f"{path}: has a column '{study.time_column}', and [data] rate = {study.rate:g} is for logs "
                        "without a column of time; take rate out, or add [data] time_column = \"\" where that is not "
                        "the time")
    if study.labels != "manoeuvre" and study.labels not in table.columns:
        raise DataError(f"{path}: no label column '{study.labels}'{closest(study.labels, table.header)}")
    if not study.columns:
        raise DataError(f"{study.path}: [columns] is empty; say what the columns of {path.name} are: "
                        f"{', '.join(table.header)}")
    if not used:
        raise DataError(f"{path}: holds none of the study's columns {', '.join(study.columns)}; "
                        f"it has {', '.join(table.header)}")
    for name in study.columns:
        # a column may be missing, but hardly when another one differs by case, blanks or a unit alone
        twin = [h for h in table.header if h not in study.columns and h != study.time_column
                and name.lower() in {h.strip().lower(), *([bare(h).lower()] if named_unit(h) else [])}]
        if name not in table.columns and twin:
            raise DataError(f"{path}: no column '{name}'; closest: '{twin[0]}'; rename one of the two")


def _check_torques(log, used):
    for name, column in used.items():
        if column.dimension == "N.m" and not log.signals[column.variable].any():
            raise DataError(f"{log.path}: column '{name}' is exactly zero throughout, so the torque was not recorded; "
                            "log it, or take the column out of [columns]")


def _check_motion(log, used):
    """Nothing can be learnt of friction where nothing moves."""
    angles = {n: c for n, c in used.items() if c.dimension == "rad"}
    speeds = {n: c for n, c in used.items() if c.dimension == "rad/s"}
    still = [not np.ptp(log.signals[c.variable]) for c in angles.values()]
    if not angles:
        still = [not log.signals[c.variable].any() for c in speeds.values()]
    if not still or not all(still):
        return
    turning = [n for n, c in speeds.items() if _goes_on(log.signals[c.variable])]
    if turning:
        raise DataError(f"{log.path}: stuck: {_keep(angles)} while {', '.join(turning)} "
                        f"{'move' if len(turning) > 1 else 'moves'}; take "
                        f"{'those' if len(angles) > 1 else 'that'} out of [columns], or log what the encoder reads")
    raise StillError(f"{log.path}: not_enough_excitation: nothing moves: {_keep(angles or speeds)}; record motion, or "
                     "take the run out of the study")


def _goes_on(values):
    """Whether a signal keeps to what it did a sample before, as motion does and noise about a standstill does not."""
    return np.mean(np.diff(values) ** 2) < np.var(values)


def _keep(columns):
    return f"{', '.join(columns)} {'keep' if len(columns) > 1 else 'keeps'} one value"


def _check_speeds(log):
    """A logged speed must be the derivative of the logged angle: a slip of unit, sign or time shows here."""
    for name, speed in log.signals.items():
        angle = log.signals.get(name[:-1] + "phi") if name.endswith(".w") else None
        if angle is None or log.time.size < 20:
            continue
        # integrals compare better than derivatives: noise averages out
        travel = np.append(0.0, np.cumsum(np.diff(log.time) * (speed[1:] + speed[:-1]) / 2))
        x, y = travel - travel.mean(), angle - angle.mean()
        power = np.sqrt((x @ x) * (y @ y))
        slope = (x @ y) / (x @ x) if power else 1.0
        if power and abs(x @ y) > 0.95 * power and not 0.5 < slope < 2.0:
            raise DataError(f"{log.path}: the angle in '{log.columns[name[:-1] + 'phi']}' changes {slope:.3g} times as "
                            f"fast as the speed in '{log.columns[name]}' says; check units and signs of both, and the "
                            "unit of time")


def _average(log):
    """One sample: the mean of a file; scatter and number of samples are kept in `meta`."""
    deviation = {n: float(v.std(ddof=1)) for n, v in log.signals.items()}
    labels = log.labels
    if labels is not None:
        names, counts = np.unique(labels, return_counts=True)
        labels = names[[counts.argmax()]]
    return replace(log, time=log.time.mean(keepdims=True), labels=labels, rows=log.rows[:1],
                   signals={n: v.mean(keepdims=True) for n, v in log.signals.items()},
                   meta={**log.meta, "samples": log.time.size, "deviation": deviation})

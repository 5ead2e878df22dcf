"""Times and readings in; how often was recorded, what rests, in which steps, and whether times are in seconds, out."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ...core.units import UNITS
from ...core.words import listed
from ...study.schema import Column
from ..stale import stale_text, stands
from .finding import Finding, column_line

_SLOWEST = 0.2
"""s between samples from which another unit of the time is considered: a drive that is controlled is sampled faster."""
_STILL = 0.05
"""rad/s (or m/s) that nothing exceeds where milliseconds or microseconds are read as seconds."""
_RUSHED, _MOST = 1e-3, {"rad": 2e5, "m": 1e3}
"""s between samples, and accelerations [rad/s2, m/s2], beyond which minutes may have been read as seconds: no drive
that friction matters to is accelerated a hundredfold faster than it falls."""
_GAP = 5.0  # usual intervals without a sample
_UNEVEN = 0.05  # relative scatter of the interval that is worth a word
_MOST_ROWS, _WHOLE = 100, 0.003
"""Rows left out for each that is there at most, and part by which that number may be off a whole one."""
_FOLLOWS = 0.95  # correlation of a speed with the slope of its angle, from which their ratio says something
_MANY = 200_000  # samples of a column from which its steps are found


def rate(logs, columns):
    """Rate, length and gaps of the logs, and readings that stand for several rows.

    Parameters
    ----------
    logs : list of Log
        Their times [s] are taken as the study reads them.
    columns : Columns
        Name the columns of the variables.

    Returns
    -------
    list of Finding
    """
    steps = [np.diff(log.time) for log in logs]
    usual = [float(np.median(s)) for s in steps]
    least, most = 1 / max(usual), 1 / min(usual)
    samples, length = sum(log.time.size for log in logs), sum(float(log.time[-1] - log.time[0]) for log in logs)
    text = f"{samples} samples, {length:.4g} s, {most:.4g} Hz" if most < 1.02 * least else (
        f"{samples} samples, {length:.4g} s, {least:.4g} to {most:.4g} Hz")
    gaps = [(float(log.time[k]), float(log.time[k + 1])) for log, s, u in zip(logs, steps, usual)
            for k in np.flatnonzero(s > _GAP * u)]
    if gaps:
        text += f"; {len(gaps)} {'gap' if len(gaps) == 1 else 'gaps'}, the longest {max(b - a for a, b in gaps):.3g} s"
    rounded = max(log.meta.get("rounded_time", 0.0) for log in logs)
    if rounded:
        text += f"; times, which are rounded to {rounded:g} s, are taken as even"
    uneven = max(float(1.4826 * np.median(np.abs(s - u)) / u) for s, u in zip(steps, usual))
    if uneven > _UNEVEN:
        text += f"; the interval scatters by {100 * uneven:.0f} %"
    return [Finding("rate", text + _stale(logs, max(usual), columns), times=gaps[:20])]


def _stale(logs, step, columns):
    """Which readings stand for several rows, as a slow device's do that a fast logger asks; empty where none does."""
    text = next((f"; {stale_text(log, columns.of)}" for log in logs if "stands" in log.meta), "")
    rows = {n: min(stands(log.signals[n]) for log in logs) for n in sorted(set.intersection(*map(
        set, (log.signals for log in logs))))}
    return text + "".join(
        f"; readings of {listed(columns.of(n) for n in rows if rows[n] == k)} stand for {k} rows, and are "
        f"{(k - 1) / 2 * step:.3g} s old on average" for k in sorted({*rows.values()} - {1}))


def rest(logs, moving):
    """Share of the time at rest.

    Parameters
    ----------
    logs : list of Log
        Their times [s] are taken as the study reads them.
    moving : float or None
        Share of samples in which everything moves.

    Returns
    -------
    list of Finding
    """
    if moving is None:
        return []
    return [Finding("rest", f"everything moves in {100 * moving:.0f} % of the samples")]


def clock(study, logs, model):
    """Another unit of the time: milliseconds read as seconds, so that nothing would move, or minutes.

    Parameters
    ----------
    study : Study
        Its columns tell the unit of the time, and `rate` where there is no such column.
    logs : list of Log
        Their times [s] are taken as the study reads them.
    model : Model
        Its gear ratios are no rows that were left out.

    Returns
    -------
    found : list of Finding
    factor : float
        That makes the times seconds.
    """
    step = float(np.median(np.concatenate([np.diff(log.time) for log in logs])))
    angles = [n for n in logs[0].signals if n.endswith(".phi")]
    fastest, moves = max(((_fast(log.time, log.signals[n]), model.variables[n].unit) for log in logs for n in angles
                          if n in log.signals), default=(0.0, ""))
    told = max((float(np.quantile(np.abs(log.signals[n]), 0.99)) for log in logs for n in log.signals
                if n.endswith(".w")), default=0.0)
    if not fastest:
        return [], 1.0
    name, known = study.time_column, study.columns.get(study.time_column, Column("time", "s"))
    said = "s" if study.rate is not None else known.unit
    for unit in (u for u in ("s", "ms", "us", "ns", "min") if u != said):
        factor = UNITS[unit][1] / UNITS[said][1]
        agrees = told and 0.5 < fastest / factor / told < 2.0
        rushed = unit == "min" and not told and step < _RUSHED and any(
            _accelerated(log.time, log.signals[n]) > _MOST[model.variables[n].unit] for log in logs for n in angles)
        slow = step > _SLOWEST and fastest < _STILL and 1e-5 <= step * factor <= 0.2
        if agrees or rushed or (slow and not told and fastest / factor < 1e3):
            mend = column_line(name, replace(known, unit=unit))
            if study.rate is not None:
                name, mend = f"[data] rate, {study.rate:g},", f"[data]\nrate = {study.rate / factor:.6g}"
            text = (f"{name} is in {unit}, not in {said}: a sample every {step:.4g} s and a fastest motion of "
                    f"{fastest:.3g} {moves}/s become {1 / (step * factor):.4g} Hz and {fastest / factor:.3g} {moves}/s")
            named = [name] if study.rate is None else []
            sure = 0.999 if agrees else 0.4 if rushed else 0.98
            return [Finding("unit", text, named, sure, mend=mend)], 1.0 if rushed else factor
    return _rows(study, logs, [p.value for p in model.parameters.values() if p.unit == "1"])


def _rows(study, logs, geared):
    """Rows that were left out, or added, while the times go on as if none were: all speeds are off by one whole number.

    Units and steps of an encoder make no whole number: 57.3 of degrees, 9.55 of revolutions a minute.
    """
    pairs = [(log.time, log.signals[n], log.signals[n[:-1] + "phi"]) for log in logs for n in log.signals
             if n.endswith(".w") and n[:-1] + "phi" in log.signals]
    ratios = np.array([_ratio(*pair) for pair in pairs])
    if len(pairs) < 2 * len(logs) or not np.isfinite(ratios).all():
        return [], 1.0
    slower = ratios.mean() > 1
    whole = ratios if slower else 1 / ratios
    count = round(float(whole.mean()))
    if (not 2 <= count <= _MOST_ROWS or np.abs(whole - count).max() > _WHOLE * count
            or any(abs(r - count) < 0.01 * count for r in geared)):
        return [], 1.0
    return [_rows_left_out(study, logs, count, slower)], float(count) if slower else 1.0 / count


def _rows_left_out(study, logs, count, slower):
    factor = float(count) if slower else 1.0 / count
    name, rate = study.time_column, study.rate
    if rate is not None:
        mend = f"rate = {rate / factor:.6g}"
    else:
        known = study.columns.get(name, Column("time", "s"))
        mend = column_line(name, replace(known, gain=known.gain * factor))
    step = float(np.median(np.concatenate([np.diff(log.time) for log in logs])))
    done = f"one every {step * factor:.3g} s"
    text = (f"the angles turn {count} times as {'fast' if slower else 'slowly'} as all speeds say: a sample every "
            f"{step:.3g} s stands for {done}; the rate is another, or rows are missing")
    return Finding("unit", text, [name], 0.98, mend=mend)


def _ratio(time, speed, angle):
    """Slope of an angle over its speed; NaN where one does not follow the other."""
    slope = np.gradient(angle, time)
    power = float(np.sqrt((slope @ slope) * (speed @ speed)))
    if not power or slope @ speed < _FOLLOWS * power:
        return np.nan
    return float(slope @ speed / (speed @ speed))


def _accelerated(time, values):
    """The usual largest acceleration, over twenty samples."""
    if time.size < 80:
        return 0.0
    at = slice(None, None, 10)
    speed = np.gradient(values[at], time[at])
    return float(np.quantile(np.abs(np.gradient(speed, time[at])), 0.95))


def _fast(time, values):
    if time.size < 5:
        return 0.0
    few = slice(None, None, max(1, time.size // 20000))
    speed = np.abs(np.diff(values[few]) / np.diff(time[few]))
    return float(np.quantile(speed, 0.99))


def resolution(logs, columns):
    """Steps in which the columns' numbers change.

    Parameters
    ----------
    logs : list of Log
        Their times [s] are taken as the study reads them.
    columns : Columns
        Give the readings' size in the columns' own numbers, and their names.

    Returns
    -------
    found : list of Finding
    raw : dict of str to float
        Steps in the columns' own numbers; 0 where there are none.
    """
    found, raw = [], {}
    for name in sorted(set.intersection(*[set(log.signals) for log in logs])):
        column = columns.column(name)
        step = steps(np.concatenate([log.signals[name] for log in logs])[:_MANY])
        if column is None or not step:
            raw[name] = 0.0
            continue
        factor = abs(float(column.si(np.array([1.0]))[0] - column.si(np.array([0.0]))[0]))
        raw[name] = step / factor
        if raw[name] > 0.999 and abs(raw[name] - round(raw[name])) < 1e-6:
            raw[name] = 1.0  # whole numbers
        spread = np.concatenate([log.signals[name] for log in logs])
        levels = int(round(float(np.ptp(spread)) / step))
        if levels > 1e6 or not levels:
            continue
        turn = f", {2 * math.pi / step:.6g} a turn" if column.dimension == "rad" else ""
        found.append(Finding("resolution", f"{columns.of(name)} in steps of {step:.3g} {column.dimension}{turn}, "
                                           f"{levels} of them over its range", [columns.of(name)]))
    return found, raw


def steps(values):
    """Step that all values are whole multiples of, up to a constant; 0 where there is none worth the name.

    Parameters
    ----------
    values : ndarray, shape (n,)
        As recorded, in any unit.

    Returns
    -------
    float
    """
    levels = np.unique(values)
    if levels.size < 2:
        return 0.0
    gaps = np.diff(levels)
    span = float(levels[-1] - levels[0])
    gaps = gaps[gaps > 1e-9 * span]
    if not gaps.size:
        return 0.0
    least = float(gaps.min())
    near = gaps[gaps < 1.5 * least]
    step = float(near.mean())  # rounding in the file scatters about the step
    whole = (levels - levels[0]) / step
    few = whole[whole < 2e4]
    if levels.size > 0.9 * values.size and span / step > values.size:
        return 0.0  # about as many levels as samples, and room for more: digits of the file
    return step if np.mean(np.abs(few - np.round(few)) < 0.1) > 0.98 and near.size >= min(3, gaps.size) else 0.0

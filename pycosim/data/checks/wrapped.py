"""Angles in; where they jump by a turn, what the turn is in the column's numbers, and the angles without jumps, out."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from .finding import Finding, column_line

_LARGE = 0.6  # of the range: a jump that goes from one end to the other
_FILLED = 0.9  # of a turn
_PAUSE = 3.0  # usual intervals: what happens in a longer one is not known
_SMOOTH = 0.25  # of a jump: what is left of it when a turn is added
_TURNS = (360.0, 2 * math.pi, 2.0, 1.0, 400.0, *(float(2 ** k) for k in range(8, 25)))
"""Usual turns in the numbers of a column: degrees, radians, (half) revolutions, gon, steps of an encoder."""


def wrapped(logs, columns):
    """Angles that jump by a turn.

    Parameters
    ----------
    logs : list of Log
        As recorded.
    columns : Columns
        Tell which variables are angles, and how large a turn is in the column's numbers.

    Returns
    -------
    found : list of Finding
    logs : list of Log
        Without the jumps.
    periods : dict of str to float
        Turn [SI] of each angle that jumped.
    """
    found, periods = [], {}
    for name in sorted(set.intersection(*[set(log.signals) for log in logs])):
        column = columns.column(name)
        if column is None or column.dimension != "rad":
            continue
        jumps = [(log, *_jumps(log.time, log.signals[name])) for log in logs]
        sizes = np.concatenate([s for _, _, s in jumps])
        if not sizes.size:
            continue
        factor = abs(float(column.si(np.array([1.0]))[0] - column.si(np.array([0.0]))[0]))
        turn = float(np.median(np.abs(sizes))) / factor
        turn = next((t for t in _TURNS if abs(turn / t - 1) < 0.03), None)
        span = max(float(np.ptp(log.signals[name])) for log, at, _ in jumps if at.size) / factor
        if turn is None or not _FILLED < span / turn < 1.001:
            continue  # a wrapped angle fills its turn, and no more
        times = [(float(log.time[k]), float(log.time[k + 1])) for log, at, _ in jumps for k in at]
        many = "jumps" if len(times) > 1 else "jump"
        text = f"{columns.of(name)} is wrapped: {len(times)} {many} by a turn of {turn:.6g} {column.unit}"
        found.append(Finding("wrap", text, [columns.of(name)], 0.999, times=times[:20],
                             mend=column_line(columns.of(name), replace(column, wrap=turn))))
        periods[name] = turn * factor
    if periods:
        logs = [replace(log, signals={n: np.unwrap(v, period=periods[n]) if n in periods else v
                                      for n, v in log.signals.items()}) for log in logs]
    return found, logs, periods


def _jumps(time, values):
    """Indices before jumps of about a turn, and how far they go."""
    none = np.empty(0, dtype=int), np.empty(0)
    step, span = np.diff(values), float(np.ptp(values))
    if step.size < 10 or not span:
        return none
    pause = np.diff(time)
    at = np.flatnonzero((np.abs(step) > _LARGE * span) & (pause < _PAUSE * np.median(pause)))
    usual = float(np.quantile(np.abs(step), 0.98))
    if not at.size or at.size > 0.2 * step.size or usual > 0.2 * span:
        return none
    kept = []
    for k in at:
        # an outlier comes back at once; a turn goes on as it went before
        before, after = step[max(k - 2, 0):k], step[k + 1:k + 3]
        if before.size and after.size and max(np.abs(before).max(), np.abs(after).max()) < _SMOOTH * abs(step[k]):
            kept.append(k)
    kept = np.array(kept, dtype=int)
    if not kept.size:
        return none
    drift = np.array([0.5 * (step[max(k - 1, 0)] + step[min(k + 1, step.size - 1)]) for k in kept])
    sizes = step[kept] - drift
    return (kept, sizes) if np.ptp(np.abs(sizes)) < 0.05 * np.abs(sizes).max() else none

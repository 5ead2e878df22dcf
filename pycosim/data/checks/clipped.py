"""Readings in; torques and references that stay at their largest value as if cut off there, out."""

from __future__ import annotations

import numpy as np

from .finding import Finding
from .readings import Source
from .stuck import equal_stretches

_RUN = 5  # equal readings in a row that noise does not make
_LEAST = 20  # samples at the extreme
_TIMES = 5.0  # as many as at the next values
_RANGE = 0.01  # of the range, that counts as next


def clipped(readings, motion, columns, names):
    """Columns that are cut off.

    Parameters
    ----------
    readings : Readings
        At every sample.
    motion : ndarray of bool, shape (samples,)
        Samples in which something moves: at rest a torque may well stay what it is.
    columns : Columns
        Name the columns of the variables in the findings.
    names : list of str
        Variables to look at: no angles, which rest at the ends of their travel.

    Returns
    -------
    list of Finding
    """
    found = []
    for name in names:
        cut, times, share = [], [], 0
        for k in range(len(readings.times)):
            inside = (readings.run == k) & motion
            values, time = readings.take(Source(name))[inside], readings.time[inside]
            for extreme, sign in ((values.max(), 1.0), (values.min(), -1.0)) if values.size else ():
                spans = _cut(sign * values)
                if spans is not None:
                    cut.append(extreme)
                    times += [(float(time[a]), float(time[b])) for a, b in spans]
                    share += sum(b - a + 1 for a, b in spans)
        if cut:
            total = int(motion.sum())
            ends = " and ".join(f"{v:.5g}" for v in sorted(set(np.round(cut, 9))))
            column = columns.column(name)
            text = (f"{columns.of(name)} is cut off at {ends} {column.dimension if column else ''}: "
                    f"{100 * share / total:.2g} % of the moving samples are at that value")
            found.append(Finding("clipped", text, [columns.of(name)], 0.98, times=sorted(times)[:20]))
    return found


def _cut(values):
    """Stretches at the largest value, or None where it is no limit."""
    spread = float(np.ptp(values))
    if values.size < 10 * _LEAST or not spread:
        return None
    at = values >= values.max() - 1e-9 * spread
    near = np.count_nonzero((values >= values.max() - _RANGE * spread) & ~at)
    if at.sum() < _LEAST or at.sum() < _TIMES * near:
        return None
    inner = ~at
    if np.mean(np.diff(values[inner]) != 0) < 0.5:
        return None  # coarse or constant anyway
    spans = [(a, b) for a, b in equal_stretches(at.astype(int)) if at[a]]
    long = [(a, b) for a, b in spans if b - a + 1 >= _RUN]
    return long if long and sum(b - a + 1 for a, b in long) > 0.5 * at.sum() else None

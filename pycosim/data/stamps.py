"""Times of a log in; the even ones behind them, where they were rounded to a part of the interval that shows, out."""

from __future__ import annotations

import numpy as np

_DIGITS = range(7)  # of a second, that times may be rounded to
_SHOWS = 0.02  # of an interval, from which rounding is worth a thought: the speeds are off by as much
_USUAL = 1.6  # median intervals, beyond which rows are missing
_FEWEST = 200
_BAND = 1.25  # of what times are rounded to, that they may scatter about even ones


def evened(time):
    """Times without their rounding.

    Milliseconds of a recorder of 300 Hz are 3, 3, 4 apart: speeds would be off by a fifth from sample to sample, and
    accelerations be nothing else. Missing rows leave their gap.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Strictly increasing [s].

    Returns
    -------
    time : ndarray, shape (n,)
        [s]; those given where they are not rounded to a whole decimal of a second, or are not even apart from that.
    rounded : float
        To what they were rounded [s]; zero where they stay.
    """
    steps = np.diff(time)
    if len(steps) < _FEWEST:
        return time, 0.0
    usual = float(np.median(steps))
    whole = (10.0 ** -k for k in _DIGITS if np.abs(steps * 10.0 ** k - np.round(steps * 10.0 ** k)).max() < 1e-3)
    quantum = next(whole, 0.0)
    near = steps[steps < _USUAL * max(usual, quantum)]
    counts = np.unique(np.round(near / quantum)) if quantum > _SHOWS * usual else []
    if len(counts) != 2 or np.diff(counts)[0] != 1:
        return time, 0.0
    step = float(near.mean())
    for _ in range(2):
        index = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(steps / step), 1.0))])
        step, start = np.polyfit(index, time, 1)
    even = start + step * index
    return (even, quantum) if np.ptp(time - even) <= _BAND * quantum else (time, 0.0)

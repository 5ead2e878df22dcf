"""Signals of a log in; samples far off their neighbours, and the signals without them, out."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, uniform_filter1d

MOTION = (".phi", ".s", ".w", ".v")
"""How variables of motion end."""
_FAR = 10.0
"""Robust standard deviations from the median of the neighbours: of a million normal samples none is beyond 6, and noise
that grows with load or speed is measured around each sample."""
_SIDE, _AROUND = 3, 100  # samples on each side of the median, and of the scatter
_NEAR = 5  # samples about a start, a stop or a turn
_SEEN = 0.01  # of the range: nearer ones move no fit
_LEAP = 3.0  # of the range: no torque jumps further where a joint turns
MANY = 0.02  # of the samples: more are no outliers
_BEYOND = 20.0
"""Ranges (of all but the outermost twentieth on each side) from the median at which no reading is one of this column,
but a number that stands for none: also in a row, where no neighbour shows it."""


def starts(log):
    """Samples about which a joint starts, stops or turns: a torque may jump there, and be back at the next sample.

    Parameters
    ----------
    log : Log
        Its angles tell where a joint moves.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    found = np.zeros(len(log.time), bool)
    for name, values in log.signals.items():
        if name.endswith((".phi", ".s")) and values.size > 4 * _NEAR:
            values = mended(values)  # a spike turns back at once
            steps = np.abs(np.diff(values))
            least = 2 * float(steps[steps > 0].min(initial=np.inf)) if (steps > 0).any() else np.inf
            moved = values[_NEAR:] - values[:-_NEAR]
            before, after = moved[:-_NEAR], moved[_NEAR:]
            slow, fast = (f(np.abs(before), np.abs(after)) for f in (np.minimum, np.maximum))
            turn = (fast > least) & ((slow < 0.2 * fast) | (before * after < 0))
            found[_NEAR:-_NEAR] |= turn
    return maximum_filter1d(found, 2 * _NEAR + 1)


def spikes(values, turns=None):
    """Samples far off the median of their neighbours.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Of one signal of one log, in any unit.
    turns : ndarray of bool, shape (n,), optional
        Samples that may be off by as much as the signal's range: a torque jumps there.

    Returns
    -------
    at : ndarray of int
    off : ndarray
        How far, in the unit of the values.
    """
    if values.size < 2 * _AROUND:
        return np.empty(0, int), np.empty(0)
    beyond = _beyond(values)
    if beyond.size:
        values, given = _bridged(values, beyond), values
        at, off = spikes(values)
        at = np.union1d(beyond, at)
        return _calm(values, at, given[at] - _bridged(values, at)[at], turns)
    off = values - median_filter(values, 2 * _SIDE + 1, mode="reflect")  # the last one has no part in its own median
    size = np.abs(off)
    middle = float(np.median(size))
    whole = 1.4826 * middle if middle else 1.2533 * float(np.mean(np.minimum(size, np.quantile(size, 0.99))))
    # the mean around, each sample limited, follows noise that grows and shrinks; a spike moves it by little
    around = 1.2533 * uniform_filter1d(np.minimum(size, 5 * whole + 1e-300), 2 * _AROUND + 1, mode="nearest")
    # in motion the neighbours themselves lie apart
    travel = maximum_filter1d(np.abs(median_filter(np.diff(values, prepend=values[0]), 5, mode="reflect")), 9)
    far = size > np.maximum(_FAR * np.maximum(whole, around), 4 * travel)
    far &= size > _SEEN * float(np.quantile(values, 0.99) - np.quantile(values, 0.01))
    at = np.flatnonzero(far)
    return _calm(values, at, off[at], turns)


def _calm(values, at, off, turns):
    """Outliers without those that are near a turn and no further off than a jump may be there."""
    if turns is None:
        return at, off
    kept = ~turns[at] | (np.abs(off) > _LEAP * (np.quantile(values, 0.99) - np.quantile(values, 0.01)))
    return at[kept], off[kept]


def _beyond(values):
    """Samples that no reading of the column can be: -9999 among angles."""
    low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
    least = _BEYOND * (high - low)
    far = np.abs(values - middle) > least
    if not least or far.mean() >= MANY:
        return np.empty(0, int)
    # what is reached by way of what lies between is a motion after a long rest
    leap = np.abs(np.diff(values, prepend=middle, append=middle)) > 0.5 * least
    edges = np.flatnonzero(np.diff(np.concatenate([[False], far, [False]]).astype(int)))
    return np.concatenate([np.arange(a, b) for a, b in zip(edges[::2], edges[1::2]) if leap[a] and leap[b]]
                          or [np.empty(0, int)])


def _bridged(values, at):
    """Values with a straight line between the neighbours of some samples."""
    kept = np.ones(values.size, bool)
    kept[at] = False
    found = np.array(values, dtype=float)
    found[at] = np.interp(at, np.flatnonzero(kept), found[kept])
    return found


def mended(values, turns=None, where=None):
    """A signal with its outliers on a straight line between their neighbours.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Of one signal of one log, in any unit.
    turns : ndarray of bool, shape (n,), optional
        As of `spikes`.
    where : ndarray of bool, shape (n,), optional
        Samples that may be changed; all by default.

    Returns
    -------
    ndarray, shape (n,)
        The values themselves where there are none, or so many that they are none.
    """
    at = spikes(values, turns)[0]
    at = at if where is None else at[where[at]]
    return _bridged(values, at) if 0 < at.size < MANY * values.size else values

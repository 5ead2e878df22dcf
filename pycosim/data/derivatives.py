"""Angles over time in; speeds and accelerations that do not lag out."""

from __future__ import annotations

import numpy as np

from ..core.errors import DataError

_DEGREE = 3
_LEAST = _DEGREE + 2
_CHUNK = 2_000_000
_SPEED_NOISE = 0.005
_LONGEST_WINDOW = 0.3


# --- derivatives ----------------------------------------------------------------------------------------------------


def resolution(values):
    """Step of a quantised signal, or the step that would scatter like its noise, whichever is larger.

    Parameters
    ----------
    values : ndarray, shape (n,)

    Returns
    -------
    float
        In the unit of the values; 0.0 for a constant.
    """
    steps = np.abs(np.diff(values))
    steps = steps[steps > 0]
    if steps.size == 0 or values.size < _LEAST:
        return 0.0
    third, travel = np.diff(values, 3), np.abs(values[3:] - values[:-3])  # what is smooth over four samples is gone
    slow = third[travel <= np.median(travel)]  # jerk and uneven sampling show in fast motion
    noise = 1.4826 * np.median(np.abs(slow - np.median(slow))) / np.sqrt(20.0)
    # the smallest step of a continuous signal is rounding, not an encoder's: an encoder's repeats
    smallest = steps.min()
    multiples = steps / smallest
    quantised = np.mean(np.abs(multiples - np.round(multiples)) < 0.01) > 0.99 and multiples.max() < 1e3
    return float(max(noise * np.sqrt(12.0), smallest if quantised else 0.0))


def default_window(time, quantum):
    """Window of `derivatives` that is as short as the angle's resolution allows.

    Parameters
    ----------
    time : ndarray, shape (n,)
        [s]
    quantum : float
        Resolution of the angle [rad], see `resolution`.

    Returns
    -------
    float
        Full width [s]: the speed's scatter stays near 0.005 rad/s, with nine samples at least and 0.3 s at most (or
        nine samples, if that is longer).
    """
    step = float(np.median(np.diff(time)))
    # variance of the slope of a cubic over N = T / step samples: 75 sigma^2 / (N T^2), sigma = quantum / sqrt(12)
    needed = (75.0 * quantum**2 / 12.0 * step / _SPEED_NOISE**2) ** (1 / 3)
    return max(min(needed, _LONGEST_WINDOW), 8.0 * step)


def derivatives(time, values, window):
    """First and second derivative by a cubic fitted to the samples around each sample.

    Symmetric in time, hence without phase lag; within half a window of the ends the window stays whole and becomes
    one-sided. Sampling may be irregular.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Strictly increasing [s].
    values : ndarray, shape (n,)
    window : float
        Full width [s]; where it holds fewer than five samples, the five nearest in order are used.

    Returns
    -------
    first, second : ndarray, shape (n,)
        In the unit of the values per s and per s2.

    Raises
    ------
    DataError
        Fewer than five samples.
    """
    n = len(time)
    if n < _LEAST:
        raise DataError(f"{n} samples are too few for a derivative; at least {_LEAST} are needed")
    half = window / 2 * (1 + 1e-9)  # a sample on the edge of the window is in, whatever the rounding
    centre = np.clip(time, min(time[0] + half, time[-1]), max(time[-1] - half, time[0]))
    low = np.searchsorted(time, centre - half, side="left")
    high = np.searchsorted(time, centre + half, side="right")
    few = high - low < _LEAST
    low[few] = np.clip(np.arange(n)[few] - _LEAST // 2, 0, n - _LEAST)
    high[few] = low[few] + _LEAST
    width = int((high - low).max())
    size = max(1, _CHUNK // width)
    parts = [_local_cubic(time, values, low[k:k + size], high[k:k + size], k, width) for k in range(0, n, size)]
    return tuple(np.concatenate(p) for p in zip(*parts))


def _local_cubic(time, values, low, high, first, width):
    """Derivatives at samples first, first + 1, .. from the samples low to high - 1 of each."""
    here = np.arange(first, first + low.size)
    index = low[:, None] + np.arange(width)
    inside = index < high[:, None]
    index = np.minimum(index, time.size - 1)
    x = np.where(inside, time[index] - time[here, None], 0.0)
    scale = np.abs(x).max(axis=1, keepdims=True)
    x /= scale
    y = np.where(inside, values[index] - values[here, None], 0.0)
    moments, right = np.empty((2 * _DEGREE + 1, low.size)), np.empty((_DEGREE + 1, low.size))
    power = inside.astype(float)
    for k in range(2 * _DEGREE + 1):
        moments[k] = power.sum(axis=1)
        if k <= _DEGREE:
            right[k] = (power * y).sum(axis=1)
        power *= x
    orders = np.arange(_DEGREE + 1)
    normal = moments[orders[:, None] + orders].transpose(2, 0, 1)
    solution = np.linalg.solve(normal, right.T[:, :, None])[:, :, 0]
    return solution[:, 1] / scale[:, 0], 2.0 * solution[:, 2] / scale[:, 0] ** 2

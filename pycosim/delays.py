"""Signals as they were recorded and a model with delays in; the signals at the time they tell of out.

A delay is undone exactly, by moving the record in time: band-limited interpolation of evenly spaced samples, a cubic
spline of others. The model's function then needs only the derivative by the delay, which is the signal's rate.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from .compile import ArrayFunction

TAPS = 8  # samples on each side; fewer would take noise away with every fraction of a sample, and look like a better fit
_BETA = 5.0  # of the Kaiser window


def undo(question, signals, time, run, parameters, smooth=None):
    """Signals of a question with their delays undone.

    Parameters
    ----------
    question : Question
    signals : dict of str to ndarray, shape (n,)
        As recorded.
    time, run : ndarray, shape (n,)
    parameters : dict of str to float
    smooth : dict of str to ndarray, optional
        The same without noise; its rates are the derivative by the delay.

    Returns
    -------
    dict of str to ndarray
        The same dict where nothing is delayed.
    """
    if not question.late:
        return signals
    smooth, found = smooth or signals, dict(signals)
    chosen = question.select(list(question.late.values()))
    values = ArrayFunction(chosen.output)([0.0] * (len(chosen.inputs) + len(chosen.states))
                                          + [float(parameters[n]) for n in chosen.parameters], 1)[:, 0]
    for name, delay in zip(question.late, values):
        found[name] = shift(time, signals[name], delay, run)
        found[f"der({name})"] = rate(time, shift(time, smooth[name], delay, run), run)
        found[f"at({name})"] = float(delay)
    return found


def rate(time, values, run):
    """Time derivative of a signal, log by log: ndarray, shape (n,)."""
    result = np.zeros(len(time))
    for k in np.unique(run):
        part = run == k
        if part.sum() > 2:
            result[part] = np.gradient(values[part], time[part])
    return result


def shift(time, values, later, run):
    """Values of a signal at later times, log by log; beyond the end its last value.

    Parameters
    ----------
    time, values, run : ndarray, shape (n,)
    later : float
        [s]

    Returns
    -------
    ndarray, shape (n,)
    """
    if later == 0:
        return values
    result = values.copy()
    for k in np.unique(run):
        part = run == k
        t, v = time[part], values[part]
        if len(t) > 2 * TAPS:
            step = np.diff(t)
            even = np.ptp(step) < 1e-3 * step.mean()
            result[part] = _even(v, later / step.mean()) if even else CubicSpline(t, v)(np.minimum(t + later, t[-1]))
    return result


def _even(values, samples):
    """Values a number of samples later, by a windowed sinc."""
    whole = int(np.floor(samples))
    k = np.arange(1 - TAPS, TAPS + 1)
    x = samples - whole - k
    weight = np.sinc(x) * np.i0(_BETA * np.sqrt(np.maximum(1 - (x / TAPS) ** 2, 0))) / np.i0(_BETA)
    index = np.arange(len(values)) + whole
    padded = values[np.clip(index[:, None] + k, 0, len(values) - 1)]
    return padded @ (weight / weight.sum())

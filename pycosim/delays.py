"""Signals as they were recorded and a model with delays in; the signals at the time they tell of out.

A delay is undone exactly, by moving the record in time along a cubic spline. The model's function then needs only the
derivative by the delay, which is the slope of the spline.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from .compile import ArrayFunction

_LEAST = 8  # samples of a log that is moved


def undo(question, signals, time, run, parameters, rest=None):
    """Signals of a question with their delays undone.

    Parameters
    ----------
    question : Question
    signals : dict of str to ndarray, shape (n,)
        As recorded.
    time, run : ndarray, shape (n,)
    parameters : dict of str to float
    rest : dict of str to ndarray, optional
        Noise alike that of the signals. A spline takes noise away between samples, which would look like a better fit;
        as much of it is put back.

    Returns
    -------
    dict of str to ndarray
        The same dict where nothing is delayed.
    """
    if not question.late:
        return signals
    found = dict(signals)
    chosen = question.select(list(question.late.values()))
    values = ArrayFunction(chosen.output)([0.0] * (len(chosen.inputs) + len(chosen.states))
                                          + [float(parameters[n]) for n in chosen.parameters], 1)[:, 0]
    for name, delay in zip(question.late, values):
        record = Record(time, signals[name], run)
        found[name], found[f"der({name})"] = record.at(delay), record.at(delay, 1)
        found[f"at({name})"] = float(delay)
        if rest:
            step = float(np.median(np.diff(time)))
            found[name] = found[name] + np.sqrt(1 - kept(round(delay / step % 1, 6))) * rest[name]
    return found


@cache
def kept(fraction):
    """Share of the power of white noise that a cubic spline keeps at a fraction of a sample.

    Parameters
    ----------
    fraction : float
        From 0 to 1.

    Returns
    -------
    float
        One at a sample itself.
    """
    impulse = np.zeros(41)
    impulse[20] = 1.0
    return min(1.0, float((CubicSpline(np.arange(41), impulse)(np.arange(5, 35) + fraction) ** 2).sum()))


class Record:
    """A recorded signal that can be read at other times, log by log; beyond a log's ends, its nearest value.

    Parameters
    ----------
    time, values, run : ndarray, shape (n,)
    """

    def __init__(self, time, values, run):
        self.time, self.values, self.run = time, values, run
        parts = ((k, run == k) for k in np.unique(run))
        self.splines = {k: CubicSpline(time[part], values[part]) for k, part in parts if part.sum() >= _LEAST}

    def at(self, later, order=0, some=slice(None)):
        """Values, or slopes, at later times.

        Parameters
        ----------
        later : float
            [s]
        order : int
            1 for the slope instead.
        some : slice or ndarray of int
            Samples wanted.

        Returns
        -------
        ndarray, as many as are wanted
        """
        if later == 0 and not order:
            return self.values[some]
        time, run = self.time[some], self.run[some]
        result = np.zeros(len(time)) if order else self.values[some].copy()
        for k, spline in self.splines.items():
            wanted = run == k
            result[wanted] = spline(np.clip(time[wanted] + later, spline.x[0], spline.x[-1]), order)
        return result

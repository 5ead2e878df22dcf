"""Signals and a time constant in; the signals as a filter of first order gives them, and their slope by it, out.

Between samples the signal is taken as straight, over a gap too: there a reversal lies mostly, across which it goes from
one level to the other.
"""

from __future__ import annotations

import numpy as np

from ..compile import ArrayFunction
from .states import scan


def recorded(question, outputs, values, time, run, parameters):
    """Outputs of a question as they are recorded, where filters hold some of them back.

    Parameters
    ----------
    question : Question
    outputs : dict of str to str
        Outputs, and the component whose reference each of them is.
    values : dict of str to ndarray, shape (n,)
        Of the outputs among others, before the filters.
    time, run : ndarray, shape (n,)
    parameters : dict of str to float

    Returns
    -------
    dict of str to ndarray, shape (n,)
        The values; the same dict where nothing is held back.
    """
    held = {n: c for n, c in outputs.items() if c in question.held and n in values}
    if not held:
        return values
    chosen = question.select([question.held[c] for c in held.values()])
    lags = ArrayFunction(chosen.output)([0.0] * (len(chosen.inputs) + len(chosen.states))
                                        + [float(parameters[n]) for n in chosen.parameters], 1)[:, 0]
    return {**values, **{n: FirstOrder(lag, time, run)(values[n][None])[0][0] for n, lag in zip(held, lags)}}


class FirstOrder:
    """A filter of first order along one or several logs, in parts: each part goes on where the one before ended.

    Parameters
    ----------
    lag : float
        Time constant [s]; none from zero on down.
    time : ndarray, shape (n,)
        Of all samples [s], in the order in which the parts will come.
    run : ndarray, shape (n,)
        Log of each sample; each log starts at rest, where the filter has caught up.
    """

    def __init__(self, lag, time, run):
        self.lag, self.time, self.run, self.done = max(float(lag), 0.0), time, run, 0
        self.last = None

    def __call__(self, values):
        """The next samples of some signals, filtered.

        Parameters
        ----------
        values : ndarray, shape (k, m)

        Returns
        -------
        filtered, by_lag : ndarray, shape (k, m)
            The second is the derivative by the time constant, in the signals' units a second.
        """
        k, m = values.shape
        behind = np.zeros((2, k)) if self.last is None else self.last[1:]
        before = values[:, :1] if self.last is None else self.last[0][:, None]
        first = max(self.done - 1, 0)
        time, run = self.time[first:self.done + m], self.run[first:self.done + m]
        step, same = np.diff(time), np.diff(run) == 0
        if self.done == 0:
            step, same = np.r_[1.0, step], np.r_[False, same]
        step = np.where(same, np.maximum(step, 1e-9), 1.0)
        rise = np.where(same, np.diff(np.hstack([before, values]), axis=1), 0.0)
        lag = max(self.lag, 1e-9)
        kept = np.exp(-step / lag) * same
        share = -np.expm1(-step / lag)
        ahead = _follow(np.tile(kept, (k, 1)), rise * share * lag / step, behind[0])
        earlier = np.hstack([behind[0][:, None], ahead[:, :-1]])
        drive = earlier * kept * step / lag ** 2 + rise * (share / step - kept / lag)
        by_lag = _follow(np.tile(kept, (k, 1)), drive, behind[1])
        self.done += m
        self.last = np.array([values[:, -1], ahead[:, -1], by_lag[:, -1]])
        return values - ahead, -by_lag


def _follow(growth, drive, start):
    """``x[k] = growth[k] x[k - 1] + drive[k]`` from a start, shape (rows, m)."""
    growth, drive = growth.copy(), drive.copy()
    drive[:, 0] += growth[:, 0] * start
    growth[:, 0] = 0.0
    return scan(growth, drive)[:, 1:]

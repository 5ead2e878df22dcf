"""Signals as they were recorded and a model with delays in; the signals at the time they tell of out.

A delay is undone by moving the record in time: one without noise along a cubic spline, a measured one by whole samples,
and between them along the slope of what the motion predicts. Noise stays where it is: moved, it would meet the noise of
other samples, and the sum of squares differ by more than a short delay changes it. What a filter has held back of a
measured one is what it would hold back of that prediction: the slope of the record itself is mostly noise. The model's
function then needs only the derivative by the delay or the time constant.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from ..compile import FILTERED
from .filters import settings

_LEAST, _KEPT = 8, 4  # samples of a log that is moved; readings of a record that are kept


def undo(question, signals, time, run, parameters, slopes=None, held=None, record=None, moved=None):
    """Signals of a question with their delays undone.

    Parameters
    ----------
    question : Question
        Its ``late`` names the signals, and what says by how much.
    signals : dict of str to ndarray, shape (n,)
        As recorded.
    time, run : ndarray, shape (n,)
        Of the samples [s], and the number of the log that each belongs to.
    parameters : dict of str to float
        Delays [s] among them.
    slopes : dict of str to (ndarray, ndarray), optional
        Of those signals that are measured torques, without their noise, and, where that tells nothing, of the record
        over some samples. A spline takes noise away between samples, which would look like a better fit; with slopes,
        the nearest sample is taken along them. The derivative by the delay is the first alone: where a torque jumps,
        the error is no parabola of the delay.
    held : callable, optional
        Name of such a signal and a time constant to what a filter of first order holds back of it, and the derivative
        of that by the time constant, each of shape (n,).
    record : callable, optional
        Values of another signal to its `Record`, where that is kept from call to call.
    moved : callable, optional
        Name of a measured torque, its delay and its record moved by that, to the torque moved without its noise, which
        stays where it is, shape (n,); NaN where it may jump: there it is moved as recorded. As recorded by default.

    Returns
    -------
    dict of str to ndarray
        The same dict where nothing is delayed.
    """
    if not question.late:
        return signals
    found = dict(signals)
    values = settings(question, [*question.late.values(), *(f"lag({n})" for n in question.late)], parameters)
    for name, behind, lag in zip(question.late, *np.split(values, 2)):
        delay, (at_lag, by_lag) = behind - lag, (n.format(name) for n in FILTERED)
        if name not in (slopes or {}):
            one = record(signals[name]) if record else Record(time, signals[name], run)
            slope = one.at(delay, 1)
            found[name], back = one.at(delay), (lag * slope, slope)
        else:
            near, slope = slice(None), slopes[name][0]
            if delay:
                near, slope, found[name] = _moved(name, signals[name], time, run, delay, slopes[name], moved)
            back = [v[near] for v in held(name, lag)] if at_lag in question.inputs else ()
        found[f"at({name})"], found[f"der({name})"] = float(delay), slope
        if at_lag in question.inputs:
            found[name], found[at_lag], found[by_lag] = found[name] + back[0], float(lag), back[1]
    return found


def _moved(name, values, time, run, delay, slopes, moved):
    """The samples nearest to those a delay later, the slope there, and a measured torque moved by the delay."""
    near, apart = _nearest(time, run, delay)
    slope, jumping = (s[near] for s in slopes)
    own, beside = values[near], values[near + np.sign(apart).astype(int)]
    found = own + slope * apart + np.clip(jumping * apart, np.minimum(beside - own, 0.0), np.maximum(beside - own, 0.0))
    if moved:
        calm = moved(name, delay, found)
        found = np.where(np.isnan(calm), found, calm)
    return near, slope, found


def _nearest(time, run, later):
    """Samples nearest to a later time, log by log, and how much later that is than they are; none beyond the ends."""
    near, apart = np.arange(len(time)), np.zeros(len(time))
    for k in np.unique(run):
        part = np.flatnonzero(run == k)
        own = np.clip(time[part] + later, time[part[0]], time[part[-1]])
        edges = (time[part][1:] + time[part][:-1]) / 2
        near[part] = part[np.searchsorted(edges, own)]
        apart[part] = own - time[near[part]]
    return near, apart


def between(time, values, run, later):
    """Values at later times, log by log, along straight lines; not a number beyond a log's ends.

    Parameters
    ----------
    time, values, run : ndarray, shape (n,)
        Samples [s], the signal there, and the number of the log that each belongs to.
    later : float
        [s]

    Returns
    -------
    ndarray, shape (n,)
    """
    found = np.empty(len(time))
    for k in np.unique(run):
        own = run == k
        found[own] = np.interp(time[own] + later, time[own], values[own], np.nan, np.nan)
    return found


class Record:
    """A recorded signal that can be read at other times, log by log; beyond a log's ends, its nearest value.

    Parameters
    ----------
    time, values, run : ndarray, shape (n,)
        Samples [s], the signal there, and the number of the log that each belongs to.
    """

    def __init__(self, time, values, run):
        self.time, self.values, self.run = time, values, run
        parts = ((k, run == k) for k in np.unique(run))
        self.splines = {k: CubicSpline(time[part], values[part]) for k, part in parts if part.sum() >= _LEAST}
        self._known = {}

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
        if not isinstance(some, slice):
            return self._read(later, order, some)
        found = self._known.get((later, order))  # asked for again and again where a delay is held
        if found is None:
            found = self._read(later, order, some)
            found.flags.writeable = False
            self._known = dict([*self._known.items()][1 - _KEPT:]) | {(later, order): found}
        return found

    def _read(self, later, order, some):
        """The same without what is known."""
        time, run = self.time[some], self.run[some]
        result = np.zeros(len(time)) if order else self.values[some].copy()
        for k, spline in self.splines.items():
            wanted = run == k
            result[wanted] = spline(np.clip(time[wanted] + later, spline.x[0], spline.x[-1]), order)
        return result

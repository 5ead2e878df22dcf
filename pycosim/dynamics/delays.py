"""Signals as they were recorded and a model with delays in; the signals at the time they tell of out.

A delay is undone by moving the record in time: one without noise along a cubic spline, a measured one by whole samples,
and between them along the slope of what the motion predicts. Noise stays where it is: moved, it would meet the noise of
other samples, and the sum of squares differ by more than a short delay changes it. What a filter has held back of a
measured one is what it would hold back of that prediction: the slope of the record itself is mostly noise. The model's
function then needs only the derivative by the delay or the time constant.
"""

from __future__ import annotations

from functools import cache, partial

import numpy as np
from scipy.interpolate import CubicSpline

from ..compile import FILTERED
from .filters import settings

_LEAST, _KEPT = 8, 4  # samples of a log that is moved; readings of a record that are kept
_HELD = 1 << 25  # bytes of measured torques that are kept as they were moved


def undo(question, signals, time, run, parameters, slopes=None, held=None, record=None, moved=None, some=slice(None),
         kept=None):
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
    some : slice or ndarray of int
        Samples wanted.
    kept : Moved, optional
        Of these samples; what it has not moved yet is put in.

    Returns
    -------
    dict of str to ndarray, as many as are wanted
        Those that the question delays, and each delay [s], a number, under ``at(x)``.
    """
    found, nearest = {}, cache(partial(_nearest, time, run))  # torques are often as late as each other
    kept = kept or Moved()
    if not question.late:
        return found
    values = settings(question, [*question.late.values(), *(f"lag({n})" for n in question.late)], parameters)
    for name, behind, lag in zip(question.late, *np.split(values, 2)):
        delay, (at_lag, by_lag) = behind - lag, (n.format(name) for n in FILTERED)
        if name not in (slopes or {}):
            one = record(signals[name]) if record else Record(Clock(time, run), signals[name])
            found[name], slope = one.at(delay, some)
            back = lag * slope, slope
        else:
            near, slope = slice(None), slopes[name][0]
            if delay:
                near, slope, record_then = kept.at(name, signals[name], delay, nearest, slopes[name], moved)
                found[name] = record_then[some]
            slope = slope[some]
            back = [v[near][some] for v in held(name, lag)] if at_lag in question.inputs else ()
        found[f"at({name})"], found[f"der({name})"] = float(delay), slope
        found.setdefault(name, signals[name][some])
        if at_lag in question.inputs:
            found[name], found[at_lag], found[by_lag] = found[name] + back[0], float(lag), back[1]
    return found


class Moved:
    """Measured torques moved in time; the last of them are kept, for one effect after the other asks for the same."""

    def __init__(self):
        self._known = {}

    def at(self, name, values, delay, nearest, slopes, moved):
        """A torque moved by a delay.

        Parameters
        ----------
        name : str
            Of the torque.
        values : ndarray, shape (n,)
            Its record.
        delay : float
            [s]
        nearest : callable
            A delay to the nearest samples and how much later it is than they are, each of shape (n,).
        slopes : (ndarray, ndarray)
            Of the torque, as of `undo`.
        moved : callable or None
            As of `undo`.

        Returns
        -------
        near, slope, moved : ndarray, shape (n,)
            Nearest samples, the slope there, and the record moved.
        """
        key = id(values), id(slopes[0]), delay, moved is None
        found, _ = self._known.get(key, (None, None))
        if found is None:
            found = _moved(name, values, delay, nearest(delay), slopes, moved)
            room = max(_HELD // max(sum(v.nbytes for v in found), 1), 1)
            for old in [*self._known][:max(len(self._known) - room + 1, 0)]:
                self._known.pop(old, None)
            self._known[key] = found, (values, slopes)  # held, so that no other has their names
        return found


def _moved(name, values, delay, nearest, slopes, moved):
    """The samples nearest to those a delay later, the slope there, and a measured torque moved by the delay."""
    near, apart = nearest
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
    for part in _logs(run):
        own = time[part]
        then = np.clip(own + later, own[0], own[-1])
        near[part] = part.start + np.searchsorted((own[1:] + own[:-1]) / 2, then)
        apart[part] = then - time[near[part]]
    return near, apart


def _logs(run):
    """The samples of each log, which stand together."""
    edges = np.flatnonzero(np.diff(run, prepend=np.nan, append=np.nan))
    return [slice(a, b) for a, b in zip(edges[:-1], edges[1:])]


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
    for own in _logs(run):
        found[own] = np.interp(time[own] + later, time[own], values[own], np.nan, np.nan)
    return found


class Clock:
    """When the samples of some logs were taken; what several records share, asked for later times.

    Parameters
    ----------
    time, run : ndarray, shape (n,)
        Of the samples [s], and the number of the log that each belongs to.
    """

    def __init__(self, time, run):
        self.time, self.run = time, run
        self.logs = _logs(run)
        self._known, self._last = {}, (None, None, None)

    def at(self, later, some):
        """The sample before each later time, and how long before; times beyond a log's ends are its ends.

        Parameters
        ----------
        later : float
            [s]
        some : slice or ndarray of int
            Samples wanted.

        Returns
        -------
        ndarray of int, ndarray
            Number of the sample, and time since it [s].
        """
        last = self._last  # threads may share a clock
        if last[0] != later or last[1] is not some:  # one record after the other asks
            self._last = last = later, some, _kept(self._known, later, some, self._before)
        return last[2]

    def _before(self, later, some):
        time, run = self.time[some], self.run[some]
        before, since = np.empty(len(time), dtype=int), np.empty(len(time))
        for log in self.logs:
            own = self.time[log]
            wanted = slice(None) if len(self.logs) == 1 else run == self.run[log.start]
            then = np.clip(time[wanted] + later, own[0], own[-1])
            k = np.searchsorted(own, then, side="right") - 1
            before[wanted], since[wanted] = log.start + k, then - own[k]
        return before, since


class Record:
    """A recorded signal that can be read at other times, log by log; beyond a log's ends, its nearest value.

    Parameters
    ----------
    clock : Clock
        Of its samples.
    values : ndarray, shape (n,)
        The signal there.
    """

    def __init__(self, clock, values):
        self.clock, self.values = clock, values
        self.pieces = np.zeros((4, len(values)))  # of a cubic after each sample, highest power first
        self.pieces[3] = values
        for log in clock.logs:
            if log.stop - log.start >= _LEAST:
                spline = CubicSpline(clock.time[log], values[log])
                self.pieces[:, log.start:log.stop - 1] = spline.c
                self.pieces[2, log.stop - 1] = spline(clock.time[log.stop - 1], 1)
        self._known = {}

    def at(self, later, some=slice(None)):
        """Values and slopes at later times.

        Parameters
        ----------
        later : float
            [s]
        some : slice or ndarray of int
            Samples wanted.

        Returns
        -------
        ndarray, ndarray; as many as are wanted
        """
        return _kept(self._known, later, some, self._read)

    def _read(self, later, some):
        before, since = self.clock.at(later, some)
        cubic, square, slope, value = self.pieces[:, before]
        values = ((cubic * since + square) * since + slope) * since + value if later else self.values[some]
        return values, (3 * cubic * since + 2 * square) * since + slope


def _kept(known, later, some, read):
    """Readings of all samples, where they are known; those of some are made anew until they are asked for again.

    A delay that is held is asked for again and again, one that is looked for is another each time.
    """
    if later not in known:
        for old in [*known][:1 - _KEPT]:
            known.pop(old, None)
        if not isinstance(some, slice):
            known[later] = None
            return read(later, some)
    found = known.get(later)
    if found is None:
        known[later] = found = read(later, slice(None))
    return tuple(v[some] for v in found)

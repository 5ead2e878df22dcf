"""Logs in; readings of any variable at a few thousand samples out, as recorded or changed in sign, unit, place or time.

Everything here costs memory and time by the samples of the log, never by how far something travelled: an angle in a
wrong unit must cost nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..derivatives import resolution

_WIDEST = 32  # samples on each side that a slope is taken over
_LONGEST = 0.08  # s on each side, so that ramps stay ramps
_NOISE = 0.03  # share of the usual speed that rounding of the angle may add to it
APART = 3
"""Samples between two neighbours: interpolation between samples shares no noise between them."""
_LEAST = 8  # samples of a run that has slopes


@dataclass(frozen=True)
class Source:
    """How a variable is read from the log: ``factor`` times what is recorded as ``of``, at another time.

    Attributes
    ----------
    of : str
        Variable whose readings they are.
    factor : float
        What readings are multiplied by: -1 for a wrong sign, a ratio of units for a wrong unit.
    shift : float
        The readings come this much late [s].
    drift : float
        Part of the time [1] by which they come later and later.
    """

    of: str
    factor: float = 1.0
    shift: float = 0.0
    drift: float = 0.0


class Readings:
    """Signals of all logs, and their slopes.

    Parameters
    ----------
    logs : list of Log
        Only signals that all of them hold are looked at.
    most : int
        Samples that are looked at, evenly spread.
    clock : float
        Factor that makes recorded times seconds.
    """

    def __init__(self, logs, most=3000, clock=1.0):
        self.clock, self.logs = clock, logs
        shared = set.intersection(*[set(log.signals) for log in logs])
        self.names = sorted(shared)
        self.times = [log.time * clock for log in logs]
        self.values = {n: [log.signals[n] for log in logs] for n in self.names}
        self._slopes, self._taken = {}, {}
        total = sum(t.size for t in self.times)
        self.step = max(1.0, total / most)
        self.picks = [_pairs(t.size, self.step) for t in self.times]

    def thinned(self, most):
        """The same readings at fewer samples, slopes shared.

        Parameters
        ----------
        most : int
            Samples of all logs together, evenly spread.

        Returns
        -------
        Readings
        """
        fewer = object.__new__(Readings)
        fewer.__dict__.update(self.__dict__)
        fewer.step = max(1.0, sum(t.size for t in self.times) / most)
        fewer.picks, fewer._taken = [_pairs(t.size, fewer.step) for t in self.times], {}
        return fewer

    def only(self, kept):
        """The same readings at some of the samples, slopes shared.

        Parameters
        ----------
        kept : ndarray of bool, shape (samples,)
            Samples that stay.

        Returns
        -------
        Readings
        """
        fewer = object.__new__(Readings)
        fewer.__dict__.update(self.__dict__)
        ends = np.cumsum([p.size for p in self.picks])[:-1]
        fewer.picks, fewer._taken = [p[k] for p, k in zip(self.picks, np.split(kept, ends))], {}
        return fewer

    @property
    def time(self):
        """Times of the samples [s], run after run."""
        return np.concatenate([t[p] for t, p in zip(self.times, self.picks)])

    @property
    def elapsed(self):
        """Times of the samples since their run began [s]."""
        return np.concatenate([t[p] - t[0] for t, p in zip(self.times, self.picks)])

    @property
    def run(self):
        """Run of each sample."""
        return np.concatenate([np.full(p.size, k) for k, p in enumerate(self.picks)])

    @property
    def partners(self):
        """Pairs of samples that were recorded `APART` one after the other: two arrays of indices."""
        first, second, begin = [], [], 0
        for pick in self.picks:
            at = np.minimum(np.searchsorted(pick, pick + APART), pick.size - 1)
            have = np.flatnonzero(pick[at] == pick + APART)
            first.append(begin + have)
            second.append(begin + at[have])
            begin += pick.size
        return np.concatenate(first), np.concatenate(second)

    def take(self, source, order=0):
        """Readings at the samples.

        Parameters
        ----------
        source : Source
            Which recorded variable is read, with what factor, and how late.
        order : int
            0 for the readings, 1 for their slope in time, 2 for the slope of that.

        Returns
        -------
        ndarray, shape (samples,)
        """
        key = source, order
        if key not in self._taken:
            if len(self._taken) > 400:
                self._taken.clear()
            self._taken[key] = source.factor * np.concatenate(
                [self._at(source, order, k) for k in range(len(self.times))])
        return self._taken[key]

    def _at(self, source, order, k):
        values, pick = self._order(source.of, order)[k], self.picks[k]
        if not source.shift and not source.drift:
            return values[pick]
        time = self.times[k]
        there = time[pick] + source.shift + source.drift * (time[pick] - time[0])
        return np.interp(there, time, values)

    def _order(self, name, order):
        if order == 0:
            return self.values[name]
        if (name, order) not in self._slopes:
            below = self._order(name, order - 1)
            self._slopes[name, order] = [
                slope(t, v, self._reach(name, k)) for k, (t, v) in enumerate(zip(self.times, below))]
        return self._slopes[name, order]

    def _reach(self, name, k):
        """Samples on each side over which rounding hardly shows in the slope."""
        time, values = self.times[k], self.values[name][k]
        if values.size < _LEAST:
            return 1
        quantum = resolution(values[:20000], time[:20000])
        longest = max(2, min(_WIDEST, int(_LONGEST / max(np.median(np.diff(time)), 1e-12))))
        for reach in (1, 2, 4, 8, 16, 32):
            if reach >= longest:
                return longest
            moved = np.sqrt(np.mean((values[2 * reach:] - values[:-2 * reach]) ** 2)) if values.size > 2 * reach else 0
            if quantum <= _NOISE * moved:
                return reach
        return longest


def _pairs(n, step):
    """Evenly spread samples, two neighbours each time: noise differs between the two, a mistake does not."""
    if step < 1.5:
        return np.arange(n)
    first = (np.arange(max(1, int(n / (2 * step)))) * 2 * step).astype(int)
    return np.unique(np.clip(np.concatenate([first, first + APART]), 0, n - 1))


def slope(time, values, reach):
    """Slope by central differences over some samples on each side, after a mean over half as many.

    Parameters
    ----------
    time, values : ndarray, shape (n,)
        Times [s] need not be even.
    reach : int
        Samples on each side.

    Returns
    -------
    ndarray, shape (n,)
        Zero where there are fewer than eight samples.
    """
    n = values.size
    if n < _LEAST:
        return np.zeros(n)
    reach = min(reach, (n - 1) // 2)
    half = reach // 2
    if half:
        total = np.concatenate([[0.0], np.cumsum(values - values[0])])
        low, high = np.maximum(np.arange(n) - half, 0), np.minimum(np.arange(n) + half + 1, n)
        even = np.minimum(np.arange(n) - low, high - 1 - np.arange(n))  # the same on both sides, so that nothing lags
        low, high = np.arange(n) - even, np.arange(n) + even + 1
        values = (total[high] - total[low]) / (high - low)
    before, after = np.maximum(np.arange(n) - reach, 0), np.minimum(np.arange(n) + reach, n - 1)
    even = np.maximum(np.minimum(np.arange(n) - before, after - np.arange(n)), 1)
    before, after = np.maximum(np.arange(n) - even, 0), np.minimum(np.arange(n) + even, n - 1)
    return (values[after] - values[before]) / (time[after] - time[before])


def with_change(sources, change):
    """Sources after one more change.

    Parameters
    ----------
    sources : dict of str to Source
        By variable, as they are read so far.
    change : dict of str to Source
        By variable; ``of`` names a variable whose source is taken first.

    Returns
    -------
    dict of str to Source
    """
    made = dict(sources)
    for name, new in change.items():
        old = sources[new.of]
        made[name] = replace(old, factor=old.factor * new.factor, shift=old.shift + new.shift,
                             drift=old.drift + new.drift)
    return made

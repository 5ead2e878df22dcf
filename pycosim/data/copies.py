"""Two logs in; the stretch of samples that is the same in both, whatever they are called, out.

A log that is written anew has other bytes: its time begins elsewhere, its numbers have fewer digits, rows are left out
at the ends or between. Its noise is the same all the same, and noise does not happen twice.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np
from scipy.special import erf

from ..core.errors import StudyError
from . import instruments

STRETCH = 200
"""Samples of a stretch that is looked for."""
FEWEST = 20  # samples of a stretch in a short log; a log with fewer than two such stretches is not compared
WINDOWS = 2000  # stretches of a log that are looked for, spread over it
FEWER = 4  # of these where many logs are compared with each other
SAME = 0.1
"""Standard deviations of the noise within which two readings are one: two of their own are so 6 times in 100."""
DIGITS = 5e-7
"""Of a column's largest value: what the last of seven digits, or a float of four bytes, may take off."""
SURE = 30.0
"""Powers of ten against chance from which a stretch is the same: a million samples at a million places make twelve."""
LIKE_NOISE = 0.5
"""Least ratio of the noise that sixth and fourth differences show. It is 1 of white noise, small of smooth motion."""
NEAR = 1e-3
"""Of a column's span, within which it agrees where others are sure: it may have fewer digits than its instrument."""
LEVEL = 0.25  # steps of an instrument within which two readings are of one level
DITHERED = 1.0  # steps of noise from which readings are not of one level by chance; rounding alone shows up to 0.7
CHANGING = 0.05  # of a stretch without noise, in which a column must change for the stretch to say anything
CANDIDATES = 2**26  # places that are tried in all
PROBED = 5  # samples of a stretch that are compared before all are


@dataclass
class Record:
    """A log, as others are held against it.

    Attributes
    ----------
    columns : dict of str to ndarray, shape (n,)
        Signals that change, SI.
    rows : ndarray of int, shape (n,)
        In the file.
    interval : float
        Median of the intervals [s].
    steps : dict of str to float
        That each signal was rounded to; 0.0 where it was not.
    """

    columns: dict
    rows: np.ndarray
    interval: float
    steps: dict
    _sorted: dict = field(default_factory=dict)

    @classmethod
    def of(cls, log):
        """A log that was read.

        Parameters
        ----------
        log : Log
            Of one sample or many.

        Returns
        -------
        Record
        """
        columns = {n: v for n, v in log.signals.items() if np.ptp(v) > 0}
        steps = {n: instruments.step(v[:: 1 + v.size // 3000]) for n, v in columns.items()}
        interval = float(np.median(np.diff(log.time))) if log.time.size > 1 else 1.0
        return cls(columns, log.rows, interval, steps)

    def sorted(self, name):
        """A signal's order and its values in that order.

        Parameters
        ----------
        name : str
            Of the signal.

        Returns
        -------
        order : ndarray of int, shape (n,)
        values : ndarray, shape (n,)
        """
        if name not in self._sorted:
            order = np.argsort(self.columns[name]).astype(np.int32)
            self._sorted[name] = order, self.columns[name][order]
        return self._sorted[name]


def shared(one, other, most=WINDOWS):
    """A stretch of samples that two logs share.

    The same up to a shift of the time, rounding, and rows that one of them leaves out between, each so many.

    Parameters
    ----------
    one, other : Record
        Of one study.
    most : int
        Stretches that are looked for.

    Returns
    -------
    ((int, int), (int, int)) or None
        First and last row in either file.
    """
    names = [n for n in one.columns if n in other.columns]
    ratio = one.interval / other.interval
    every = max(1, round(max(ratio, 1 / ratio)))
    swapped = ratio < 0.75 or (every == 1 and one.rows.size > other.rows.size)
    coarse, fine = (other, one) if swapped else (one, other)
    length = min(STRETCH, coarse.rows.size // 2)
    if not names or length < FEWEST or (length - 1) * every >= fine.rows.size:
        return None
    search = _Search(coarse, fine, names, every, length, most)
    found = search.found()
    if found is not None and not search.sure.any() and most < WINDOWS:
        found = _Search(coarse, fine, names, every, length, WINDOWS).found()
    if found is None:
        return None
    first, second = found
    spans = ((int(coarse.rows[first]), int(coarse.rows[first + length - 1])),
             (int(fine.rows[second]), int(fine.rows[second + (length - 1) * every])))
    return spans[::-1] if swapped else spans


class _Search:
    """Stretches of a log, looked for in another one that may have more rows between."""

    def __init__(self, coarse, fine, names, every, length, most):
        self.coarse, self.fine, self.every, self.length = coarse, fine, every, length
        whole = coarse.rows.size // length
        self.starts = length * np.unique(np.linspace(0, whole - 1, min(whole, most)).round().astype(int))
        picked = self.starts[:, None] + np.arange(length)
        self.names = names
        self.values = np.array([coarse.columns[n][picked] for n in names])  # (columns, stretches, samples)
        self._tolerances()

    def _tolerances(self):
        """How near is the same, by column and stretch, and which stretches would be sure."""
        noise, smoother = (np.median(np.abs(np.diff(self.values, order)), axis=2) / 0.6745 / norm
                           for order, norm in ((4, 70 ** 0.5), (6, 924 ** 0.5)))
        steps = np.sort([[log.steps[n] for n in self.names] for log in (self.coarse, self.fine)], axis=0)[..., None]
        noise = np.where((smoother >= LIKE_NOISE * noise) & (noise > DITHERED * steps[0]), noise, 0.0)
        size, span = np.abs(self.values).max(axis=(1, 2))[:, None], np.ptp(self.values, axis=(1, 2))[:, None]
        self.within = np.maximum(SAME * noise, np.maximum(DIGITS * size, LEVEL * steps[0]))
        twice = steps[1] > 2 * steps[0]  # rounded once more
        self.within = np.where(twice, np.maximum(self.within, 0.51 * steps.sum(axis=0)), self.within)
        chance = erf(self.within / (2 * np.where(noise > 0, noise, 1e-200)))
        self.sure = -self.length * np.log10(chance).sum(axis=0) >= SURE
        self.within = np.where((noise > 0) | ~self.sure, self.within, np.maximum(self.within, NEAR * span))

    def found(self):
        """First samples of a stretch that is the same, in either log; None where there is none."""
        if self.sure.any():
            return next(self._places(np.flatnonzero(self.sure)), None)
        # what was computed twice without noise agrees for a while: then all that changes must be the same
        moves = (np.abs(np.diff(self.values, axis=2)) > self.within[..., None]).mean(axis=2).max(axis=0)
        changing = np.flatnonzero(moves > CHANGING)
        needed = min(changing.size, self.fine.rows.size / (self.every * self.length) - 1)
        places = list(self._places(changing)) if changing.size else []
        return places[0] if places and len(places) >= needed else None

    def _places(self, stretches):
        """Yield each stretch that the other log holds, with its place there; those of rare values first."""
        spread = np.ptp(self.values, axis=(1, 2)) / np.median(self.within, axis=1)
        column = int(np.argmax(spread))
        order, ranked = self.fine.sorted(self.names[column])
        looked, within = self.values[column, stretches], self.within[column, stretches][:, None]
        low, high = np.searchsorted(ranked, looked - within), np.searchsorted(ranked, looked + within, "right")
        at, tried = np.argmin(high - low, axis=1), 0
        each = np.arange(stretches.size)
        low, high = low[each, at], high[each, at]
        for k in np.argsort(high - low, kind="stable"):
            tried += high[k] - low[k]
            if tried > CANDIDATES:
                return
            place = self._place(stretches[k], order[low[k]:high[k]].astype(np.int64) - self.every * at[k])
            if place is not None:
                yield int(self.starts[stretches[k]]), place

    def _place(self, stretch, starts):
        """The first of some places in the other log where a stretch is the same."""
        starts = starts[(starts >= 0) & (starts + self.every * (self.length - 1) < self.fine.rows.size)]
        for samples in (np.linspace(0, self.length - 1, PROBED).astype(int), np.arange(self.length)):
            for j, k in itertools.product(samples, range(len(self.names))):
                if not starts.size:
                    return None
                other = self.fine.columns[self.names[k]][starts + self.every * j]
                starts = starts[np.abs(other - self.values[k, stretch, j]) <= self.within[k, stretch]]
        return int(starts[0]) if starts.size else None


def refuse_copies(logs):
    """Refuse logs of which one holds a stretch of another: what is counted twice makes intervals too narrow.

    Parameters
    ----------
    logs : list of Log
        Of one study, fitted or held out.

    Raises
    ------
    StudyError
        Names the two, and the rows that are the same.
    """
    if len(logs) < 2:
        return
    records = [Record.of(log) for log in logs]
    pairs = list(itertools.combinations(range(len(logs)), 2))
    for a, b in pairs:
        if "samples" in logs[a].meta and _means(logs[a]) == _means(logs[b]):
            raise StudyError(f"{logs[b].path}: holds the same as {logs[a].path}; data counted twice make the intervals "
                             "too narrow, so keep one of the two")
        found = shared(records[a], records[b], max(FEWER, WINDOWS // len(pairs)))
        if found is not None:
            raise StudyError(f"{logs[b].path}: {_rows(found[1])} hold the same as {_rows(found[0])} of {logs[a].path}; "
                             "data counted twice make the intervals too narrow, so keep one of the two")


def refuse_known(logs, known, study):
    """Refuse new logs that hold a stretch of a log that was searched.

    Parameters
    ----------
    logs : list of Log
        That are to confirm.
    known : Log
        That the study was made from.
    study : Study
        Named in what is refused.

    Raises
    ------
    StudyError
        Names the two, and the rows that are the same.
    """
    before = Record.of(known)
    for log in logs:
        found = shared(Record.of(log), before)
        if found is not None:
            raise StudyError(f"{log.path}: {_rows(found[0])} hold the same as {_rows(found[1])} of {known.path}, which "
                             f"{study.path} was made from; an effect is confirmed on a log that was never searched, so "
                             "record another")


def _means(log):
    """What a log that is one sample was made of: means, scatter and number of its readings."""
    return {n: float(v[0]) for n, v in log.signals.items()}, log.meta.get("deviation"), log.meta.get("samples")


def _rows(span):
    return f"rows {span[0]} to {span[1]}"

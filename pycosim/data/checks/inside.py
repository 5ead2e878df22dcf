"""Relations between columns in; how late some of them come by what the samples well inside the passes say, out.

After a turn friction builds up over a travel, load lines stretch, filters settle: torques seem late there, or early,
and are not. Inside a pass a column that comes late is off by its own slope in time, out and back with opposite signs.
That slope is what the residuals are held against, beside all that the model may fit and what goes with accelerations;
each pass answers once, and how much the answers scatter says how much is chance.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from .readings import Source, with_change
from .relations import ModelRelation, between, moving

_FROM, _TO = 0.2, 0.9
"""Parts of the time of a stretch between which a sample is well inside it."""
_SHORTEST = 6  # samples inside a stretch at least
_FEWEST = 6  # stretches at least
_LATEST = 0.2  # s by which columns may come late
_CUT = 0.025  # s on both sides of a shift, over which the slope is taken
_ROUNDS = 3  # of the slope about the shift that was found
_LONE = 100.0
"""Factor on the chance of one column of several of its kind: they come from one device mostly."""
_LIMIT = 2.5  # deviations from which a residual counts as much as one there
_MOST = 0.99  # of the answer that one stretch is taken to give


@dataclass
class Late:
    """How late some columns come.

    Attributes
    ----------
    names : tuple of str
        Variables that are read at another time together.
    shift : float
        Seconds by which they come late.
    chance : float
        Probability of as much where nothing comes late.
    before, after : dict of str to float
        By channel: error inside the passes that neighbouring samples share, SI units.
    """

    names: tuple
    shift: float
    chance: float
    before: dict
    after: dict


class Inside:
    """Samples well inside the passes, and what relations leave there.

    Parameters
    ----------
    readings : Readings
        At as many samples as can be: noise must not hide what little a shift leaves.
    sources : dict of str to Source
        How each variable is read, mistakes undone.
    relations : list
        `ModelRelation` and `RateRelation`; only models are asked.
    holds : dict of int to Agreement
        How well each relation holds, by its place in the list.
    angles : list of str
        Variables whose accelerations may be in a residual.
    """

    def __init__(self, readings, sources, relations, holds, angles):
        self.readings, self.sources = readings, sources
        self.models = [(r, holds[k].x) for k, r in enumerate(relations) if isinstance(r, ModelRelation)]
        rates = [readings.take(sources[n], 1) for n in angles]
        self.unit = np.full(readings.time.size, -1)
        for first, last in _stretches(readings.run, rates) if rates else ():
            self._enter(first, last)
        self.inside = self.unit >= 0
        self.count = int(self.unit.max()) + 1 if self.inside.any() else 0
        one, two = readings.partners
        same = self.inside[one] & (self.unit[one] == self.unit[two])
        place = np.cumsum(self.inside) - 1
        self.pairs = place[one[same]], place[two[same]]
        self.at = self.unit[self.inside]
        beside = [*(readings.take(sources[n], 2) for n in angles)]
        self.beside = np.array([np.ones(readings.time.size), *beside])[:, self.inside]

    def _enter(self, first, last):
        """Number the samples well inside a stretch."""
        time = self.readings.time[first:last]
        span = time[-1] - time[0]
        low, high = time[0] + max(_FROM * span, _CUT), time[-1] - max((1 - _TO) * span, _CUT)
        within = first + np.flatnonzero((time > low) & (time < high))
        if within.size >= _SHORTEST:
            self.unit[within] = self.unit.max() + 1

    def late(self, names):
        """How late some columns come.

        Parameters
        ----------
        names : tuple of str
            Variables that are read at another time together.

        Returns
        -------
        Late or None
            None where too little is seen inside the passes, or where nothing depends on when they were read.
        """
        asked = self._asked(names)
        if not asked or self.count < _FEWEST:
            return None
        shift = 0.0
        for _ in range(_ROUNDS):
            parts = [self._part(relation, x, names, shift) for relation, x in asked]
            pull, weight = (sum(p[k] for p in parts) for k in (0, 1))
            if weight.sum() <= 0 or not np.isfinite(pull).all():
                return None
            step = -pull.sum() / weight.sum()
            shift += step
            if abs(shift) > _LATEST:
                return None
            if abs(step) < 0.1 * _CUT:
                break
        scatter, independent = _scatter(pull + step * weight, weight)
        chance = student.sf(abs(shift) / max(scatter, 1e-300), max(independent - 1, 1))
        return Late(tuple(names), float(shift), float(chance), *self._errors(asked, names, shift))

    def _part(self, relation, x, names, shift):
        """By stretch: how a residual goes with its slope over a shift, and the square of that slope, noise apart."""
        residual, slope, sizes = self._residual(relation, x, names, shift)
        known = self._known(relation, x, names, shift, sizes)
        weight = np.ones(residual.size)
        r = g = None
        for _ in range(3):
            root = np.sqrt(weight)[:, None]
            both = np.column_stack([residual.ravel(), slope.ravel()])
            r, g = (both - known @ np.linalg.lstsq(known * root, both * root, rcond=1e-9)[0]).T
            weight = np.minimum(1.0, _LIMIT / np.maximum(np.abs(r), 1e-12))
        r, g, weight = (v.reshape(residual.shape) for v in (r, g, weight))
        one, two = self.pairs
        pull = np.bincount(self.at, (weight * r * g).sum(0), self.count)
        power = np.bincount(self.at[one], (weight[:, one] * g[:, one] * g[:, two]).sum(0), self.count)
        return pull, power * self.at.size / max(one.size, 1)

    def _residual(self, relation, x, names, shift):
        """Residual inside the passes, its slope over the shift, both over the noise, and the noise."""
        there = [self._left(relation, x, names, shift + d) for d in (0.0, _CUT, -_CUT)]
        sizes = np.maximum(1.4826 * np.median(np.abs(there[0] - np.median(there[0], axis=1, keepdims=True)), axis=1),
                           1e-300)[:, None]
        return there[0] / sizes, (there[1] - there[2]) / (2 * _CUT) / sizes, sizes

    def _left(self, relation, x, names, shift, drift=0.0):
        sources = with_change(self.sources, {n: Source(n, 1.0, shift, drift) for n in names})
        return (relation.measured(self.readings, sources)
                - relation.predict(self.readings, sources, x))[:, self.inside]

    def _known(self, relation, x, names, shift, sizes, drift=0.0):
        """Columns of what the model may fit, and of what goes with accelerations, channel by channel."""
        sources = with_change(self.sources, {n: Source(n, 1.0, shift, drift) for n in names})
        slopes = relation.evaluate(relation.arguments(self.readings, sources), x, self.readings.time.size)[3]
        channels, rows = len(sizes), len(self.beside)
        beside = np.zeros((channels, channels * rows, self.at.size))
        for c in range(channels):
            beside[c, c * rows:(c + 1) * rows] = self.beside
        columns = np.concatenate([slopes[:, :, self.inside], beside], axis=1) / sizes[:, None]
        columns = columns.transpose(0, 2, 1).reshape(channels * self.at.size, -1)
        length = np.linalg.norm(columns, axis=0)
        return columns[:, length > 0] / length[length > 0]

    def fall(self, names, drift):
        """Factor by which errors inside the passes fall, all channels together, where columns drift away.

        Parameters
        ----------
        names : tuple of str
            Variables of one clock.
        drift : float
            As of `Source`.

        Returns
        -------
        float
            Infinite where too little is seen inside the passes to say.
        """
        asked = self._asked(names)
        if not asked or self.count < _FEWEST:
            return math.inf
        return math.prod(falls(*self._errors(asked, names, 0.0, drift)))

    def _asked(self, names):
        """Models of some of the columns that others are held against, with their parameters."""
        return [(r, x) for r, x in self.models if between(r, names)]

    def _errors(self, asked, names, shift, drift=0.0):
        """Errors by channel that neighbours share, in the relation whose error falls most."""
        before, after, most = {}, {}, {}
        for relation, x in asked:
            sizes = self._residual(relation, x, names, 0.0)[2]
            errors = [self._shared(relation, x, names, sizes, *late) for late in ((0.0, 0.0), (shift, drift))]
            for channel, old, new in zip(relation.channels, *errors):
                fall = old / max(new, 1e-300)
                if fall > most.get(channel, 0.0):
                    most[channel], before[channel], after[channel] = fall, float(old), float(new)
        return before, after

    def _shared(self, relation, x, names, sizes, shift, drift):
        known = self._known(relation, x, names, shift, sizes, drift)
        residual = self._left(relation, x, names, shift, drift) / sizes
        fitted = known @ np.linalg.lstsq(known, residual.ravel(), rcond=1e-9)[0]
        left = np.clip(residual - fitted.reshape(residual.shape), -2 * _LIMIT, 2 * _LIMIT) * sizes
        one, two = self.pairs
        return np.sqrt(np.maximum(np.mean(left[:, one] * left[:, two], axis=1), 0.0))


def _scatter(left, weight):
    """How far off an answer of all stretches may be, and how many of them it hangs on.

    What the answer leaves of a stretch's own pull is the less the more the answer is that stretch's: it is taken as it
    would be if the others had answered [MacKinnon and White 1985, HC3]. One of 28 stretches, with a ramp inside, told a
    force to be 58 ms late as if there were no chance of error, and the others knew nothing of it.
    """
    own = np.clip(weight / weight.sum(), 0.0, _MOST)
    return (float(np.sqrt(np.sum((left / (1 - own)) ** 2)) / weight.sum()),
            float(np.abs(weight).sum() ** 2 / (weight ** 2).sum()))


def _stretches(run, rates):
    """First sample of each stretch in which everything moves and nothing turns, and the first after it."""
    keys = np.column_stack([run, moving(np.array(rates)), *(np.sign(w) for w in rates)])
    edges = np.flatnonzero(np.any(np.diff(keys, axis=0) != 0, axis=1)) + 1
    for first, last in itertools.pairwise([0, *edges, len(run)]):
        if keys[first, 1] and last - first >= _SHORTEST:
            yield first, last


def falls(before, after):
    """Factors by which errors fall.

    Parameters
    ----------
    before, after : dict of str to float
        Errors by channel.

    Returns
    -------
    list of float
    """
    return [max(e, 1e-300) / max(after[c], 1e-300) for c, e in before.items()]


def latest(readings, sources, relations, holds, angles, candidates):
    """The columns that come late, if any do.

    Nothing is recorded before it happens: what seems early is told by what it is compared with, which comes late then.

    Parameters
    ----------
    readings, sources, relations, holds, angles
        As of `Inside`.
    candidates : list of tuple of str
        Variables that may share a clock; those of a kind, then each of them.

    Returns
    -------
    found : Late or None
        The set with the least chance; one column of several of its kind must be clearer than all of them together.
    certainty : float
        How sure that is, among so many candidates.
    """
    inside = Inside(readings, sources, relations, holds, angles)
    best, least = None, 1.0
    for names in candidates:
        found = inside.late(names)
        if found is None or found.shift <= 0:
            continue
        chance = found.chance * (_LONE if any(set(names) < set(c) for c in candidates) else 1.0)
        if chance < least:
            best, least = found, chance
    return best, certainty(least, len(candidates))


def certainty(chance, tried):
    """How sure something is by the probability of as much where there is nothing.

    A probability p raises the odds by at most -1 / (e p log p) [Sellke, Bayarri, Berger 2001]; one of so many sets is
    as likely to be off, before the log is asked, as all others and none together are not.

    Parameters
    ----------
    chance : float
        Probability of as much by chance.
    tried : int
        Sets that were tried.

    Returns
    -------
    float
    """
    if chance >= 1 / math.e:
        return 0.0
    chance = max(chance, 1e-12)
    odds = -1 / (math.e * chance * math.log(chance)) / max(tried, 1)
    return odds / (1 + odds)

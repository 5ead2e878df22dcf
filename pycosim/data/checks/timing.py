"""Relations between columns in; columns that come late, on a clock of their own, or through a filter, out."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter
from scipy.stats import kendalltau, theilslopes

from ...core.words import listed
from .finding import QUESTION, Finding, column_line
from .inside import Inside, falls, latest
from .readings import Source, with_change
from .relations import ModelRelation, RateRelation, _winsorised, between, shared

_LATEST = 0.2
"""s by which a column may come late or early."""
_FASTEST = 0.01
"""Part by which a clock may run fast or slow."""
_BETTER = 0.9
"""Factor by which the error of some channel must fall at least for a shift to be worth a word."""
_FALLEN = 1.5
"""Factor by which the error of some channel must fall for a shift of less than a sample and a half."""
_AGED = 2.0
"""Factor by which a drift must leave less than a machine that changes over time: 1.3 was the most of a sound log or one
with an effect that looked like a clock, and 9 the least of 44 clocks of 0.3 %."""
_ALONE = 3.0
"""Factor by which a drift of one column of several of its kind must lower an error: they come from one device mostly,
and friction at one of two motors may look like it."""
_FELL = 1.1
"""Factor by which a drift must lower some channel's error: what a filter held back looked like one, at 1.06."""
_ALL, _FALLS = 0.5, 1.02
"""Of the most that a drift changes in any channel, that it changes in one whose error must fall too, and the least
factor. Of drifts in twelve logs each channel's fell by 1.17 to 7; a preload that looked like one raised one."""
_STRETCHES, _DELAYS, _OUT = 8, 33, 16.0
"""Parts of the time of the logs that each say how late columns come, out of so many delays; and squared residuals, over
the square of their median, from which a sample counts no more."""
_LAGS = np.linspace(-_LATEST, _LATEST, _DELAYS)
_POLISHED = 9  # drifts that are tried last, over those that stretches may say instead
_ROUNDS = 4
"""Of the drift and the lags that are left."""
_WIDE, _SLOPES, _ORDERS = 4.0, 41, 999
"""Factor either way of a drift within which stretches say another, how many are tried, and orders of the stretches."""
_CHANCE, _ABOUT = 0.05, 2.0
"""Of an order in time among stretches, at most; and factor within which their drift is the drift. Seventeen clocks had
orders of their best delays that chance brings in 3.2 % at most, and slopes of 0.6 to 1.5; of a dozen lags and other
effects none had both but two machines that warm up, which are told by what ageing leaves. Two of twenty more had a
best delay of noise among them, in slow motion, and orders of 13 and 15 %; weighed, of 1 %."""
_SURE = 8.0
"""Least gain of the logarithm of the likelihood."""
_APART = 0.05  # s that a drifting clock is off at the end at least
_ROUGH = 0.2  # of that, from which few samples, with the parameters of no drift, begin
_ANEW, _STUCK = 3, 0.1  # searches at most, and fall of a relation's cost from which one more is begun
_FEW = 600  # samples of a first trial
_ASKED = 1 / 3  # certainty from which a shift is worth a question
_SEEN = 0.015
"""Relative error from which a relation may tell of times: a load's model is no better."""
_LITTLE = 1e-3  # of a torque, that an inertia is tried with
_TINY = 1e-4  # relative error below which less is no better


def _logarithms(errors):
    """Sum of the logarithms of relative errors; one that is no number counts as one that is large."""
    return sum(math.log(max(min(e, 2.0), _TINY)) if np.isfinite(e) else 1.0 for e in errors)


def _cost(agreement):
    """Sum of the logarithms of the relative errors of all channels, noise apart."""
    return _logarithms(agreement.smooth.values())


class Timing:
    """Trial of shifts and drifts.

    Parameters
    ----------
    readings : Readings
        At every sample, or few for a first trial.
    sources : dict of str to Source
        How each variable is read, mistakes undone.
    relations : list
        `ModelRelation` and `RateRelation` that tell of times.
    holds : dict of int to Agreement
        How well each relation holds without a shift, by its place in the list.
    columns : Columns
        Name the columns of the variables in the findings.
    group : dict of str to list of str
        Variables by what they are, as `changes.roles` gives them.
    every : Readings, optional
        At as many samples as can be, for what is small beside noise; ``readings`` by default.
    """

    def __init__(self, readings, sources, relations, holds, columns, group, every=None):
        self.every = readings if every is None else every
        self.readings, self.sources, self.relations = readings, sources, relations
        self.holds, self.columns, self.group = holds, columns, group
        self.valleys = defaultdict(list)  # parameters that other trials ended in, by relation
        self.step = float(np.median(np.concatenate([np.diff(t) for t in readings.times])))
        self.length = max(float(t[-1] - t[0]) for t in readings.times)

    def candidates(self):
        """Columns that may share a clock.

        Returns
        -------
        list of tuple of str
        """
        sets = []
        for role in ("torques", "references", "encoders", "speeds"):
            members = self.group[role]
            sets += [tuple(members)] if members else []
            sets += [(m,) for m in members] if len(members) > 1 else []
        angles = self.group["angles"]
        with_speeds = tuple(dict.fromkeys([*angles, *self.group["speeds"]]))
        sets += [s for s in dict.fromkeys([tuple(angles), with_speeds]) if s]
        return [s for s in dict.fromkeys(sets) if self._told_by(s)]

    def costs(self, names, trials):
        """Sums of the logarithms of the errors that the columns are in, noise apart, the model's parameters held.

        Parameters
        ----------
        names : tuple of str
            Variables that are shifted together, as those of one clock.
        trials : sequence of (float, float)
            Shift and drift, as of `Source`.

        Returns
        -------
        ndarray, shape (trials,)
        """
        tried = [with_change(self.sources, {n: Source(n, 1.0, *trial) for n in names}) for trial in trials]
        total = np.zeros(len(tried))
        for k, relation in self._told_by(names):
            if isinstance(relation, RateRelation) or relation.level:
                total += [_cost(relation.hold(self.readings, s, self.holds[k].x)) for s in tried]
            else:
                total += [_logarithms(e) for e in self._errors(relation, self.holds[k], tried)]
        return total

    def _told_by(self, names):
        """Numbered relations between some columns and others."""
        return [(k, r) for k, r in enumerate(self.relations) if between(r, names)]

    def _errors(self, relation, old, tried):
        """Errors of each channel of a relation, trial by trial."""
        pairs = self.readings.partners
        first, second = (p[old.used[pairs[0]] & old.used[pairs[1]]] for p in pairs)
        return [[shared(row, first, second) / old.spread[c] for c, row in zip(relation.channels, rows)]
                for rows in self._residuals(relation, old, tried)]

    def _residuals(self, relation, old, tried):
        """Residuals of a relation, (channels, samples) for each trial; all trials of a model are evaluated at once."""
        if isinstance(relation, RateRelation) or relation.level:
            return [relation.hold(self.readings, s, old.x).residual for s in tried]
        n = self.readings.time.size
        rows = zip(*(relation.arguments(self.readings, s) for s in tried))
        stacked = [np.concatenate(row) if isinstance(row[0], np.ndarray) else row[0] for row in rows]
        y = relation.evaluate(stacked, old.x, n * len(tried), False)[0].reshape(-1, len(tried), n)
        return [relation.measured(self.readings, s) - y[:, k] for k, s in enumerate(tried)]

    def _lags(self, names, shift, drift, holds):
        """Times of stretches, since their run began, and what each leaves with every delay beside a shift and a drift.

        Each stretch answers for itself, with the parameters of all. Slow noise, which hides in the errors what a drift
        brings, scatters the answers, and does not line them up.
        """
        left, used = 0.0, np.zeros(self.readings.time.size, bool)
        tried = [with_change(self.sources, {n: Source(n, 1.0, shift + d, drift) for n in names}) for d in _LAGS]
        for relation, held in ((self.relations[k], h) for k, h in holds.items()):
            if held.used.any() and np.isfinite(held.residual).all():
                sizes = np.maximum(np.median(np.abs(held.residual[:, held.used]), axis=1), 1e-300)[:, None]
                left = left + np.array([np.minimum((r / sizes) ** 2, _OUT).sum(0) * held.used for r in
                                        self._residuals(relation, held, tried)])
                used |= held.used
        if not used.any():
            return np.zeros(1), np.zeros((1, _DELAYS))
        time = self.readings.elapsed
        stretch = np.searchsorted(np.quantile(time[used], np.linspace(0, 1, _STRETCHES + 1)[1:-1]), time)
        parts = [part for k in range(_STRETCHES) if (part := used & (stretch == k)).any()]
        return np.array([time[p].mean() for p in parts]), np.array([left[:, p].sum(1) for p in parts])

    def _straightened(self, drifted):
        """A drift beside which stretches of the logs come later no more, as far as they say."""
        names, _, drift, _ = drifted
        tried = []
        for _ in range(_ROUNDS):
            holds = self.fitted(names, 0.0, drift)[1]
            times, left = self._lags(names, 0.0, drift, holds)
            lags = _LAGS[left.argmin(1)]
            tried.append((float(np.mean(np.abs(lags))), (names, 0.0, drift, holds)))
            if not times.all():
                break
            # least absolute deviations from a line; the clock is right where a run begins
            order = np.argsort(lags / times)
            drift += (lags / times)[order[np.searchsorted(np.cumsum(times[order]), 0.5 * times.sum())]]
        return min(tried, key=lambda t: t[0])[1]

    def fitted(self, names, shift, drift):
        """The cost of a shift and a drift after a fit of the model's parameters, and how well the relations hold then.

        Parameters
        ----------
        names : tuple of str
            Variables that are shifted together, as those of one clock.
        shift, drift : float
            As of `Source`.

        Returns
        -------
        total : float
        holds : dict of int to Agreement
            By relation that the columns are in.
        """
        sources = with_change(self.sources, {n: Source(n, 1.0, shift, drift) for n in names})
        holds = {k: self._held(k, sources) for k, _ in self._told_by(names)}
        return sum(_cost(h) for h in holds.values()), holds

    def _held(self, k, sources):
        """How well a relation holds after the best of the fits from where others ended."""
        return min((self.relations[k].hold(self.readings, sources, x) for x in (self.holds[k].x, *self.valleys[k])),
                   key=_cost)

    def _sharpened(self, drifted):
        """A drift beside which the model, fitted anew, leaves least; near one that stretches of the logs say."""
        names, _, drift, _ = drifted
        best = self._search(lambda grid: [self.fitted(names, 0.0, e)[0] for e in grid], drift / _ABOUT, drift * _ABOUT,
                            _POLISHED)
        return names, 0.0, best, self.fitted(names, 0.0, best)[1]

    def _search(self, costs, low, high, points):
        """Least of a function on a grid, then twice within the neighbours."""
        for zoom in (points, 7, 7):
            grid = np.linspace(low, high, zoom)
            k = int(np.argmin(costs(grid)))
            low, high = grid[max(k - 1, 0)], grid[min(k + 1, zoom - 1)]
        return grid[k]

    def best(self):
        """The shift and the drift that explain most, each with what it does.

        Where a fit from what one of them ended in holds better without any, the fits so far were stuck.

        Returns
        -------
        shifted, drifted : tuple of (names, shift, drift, holds), or None
        """
        for _ in range(_ANEW):
            found = self._tried()
            for k, h in [item for f in found if f for item in f[3].items()]:
                self.valleys[k].append(h.x)
            anew = {k: self._held(k, self.sources) for k in self.valleys}
            stuck = any(_cost(self.holds[k]) - _cost(h) > _STUCK for k, h in anew.items())
            self.holds = {**self.holds, **anew}
            if not stuck:
                break
        return tuple(f and (*f[:3], self.fitted(*f[:3])[1]) for f in found)

    def _tried(self):
        """The same from where the fits stand."""
        shifted, drifted = [], []
        steps = min(161, max(9, int(2 * _FASTEST * self.length / 0.15) | 1))
        rough = Timing(self.readings.thinned(_FEW), self.sources, self.relations, None, self.columns, self.group)
        rough.holds = {k: r.hold(rough.readings, self.sources, self.holds[k].x) for k, r in enumerate(self.relations)}
        for names in self.candidates():
            base = rough.costs(names, [(0.0, 0.0)])[0]
            shift = rough._search(lambda grid: rough.costs(names, [(d, 0.0) for d in grid]), -_LATEST, _LATEST, 17)
            gain = base - rough.costs(names, [(shift, 0.0)])[0]
            if gain > 0.02:
                shifted.append((gain, names, shift, 0.0))
            drift = rough._search(lambda grid: rough.costs(names, [(0.0, e) for e in grid]), -_FASTEST, _FASTEST,
                                  steps)
            gain = base - rough.costs(names, [(0.0, drift)])[0]
            if gain > 0.1 and abs(drift) * self.length > _ROUGH * _APART:
                drifted.append((gain, names, 0.0, drift))
        return self._refined(shifted), self._refined(drifted)

    def _refined(self, tried):
        """The best of the first few, after a fit of the model to each."""
        found = []
        for _, names, shift, drift in sorted(tried, key=lambda t: -t[0])[:3]:
            given = self.holds
            for span in (1.0, 0.3):  # parameters and time in turn
                self.holds = {**given, **self.fitted(names, shift, drift)[1]}
                if drift:
                    span *= 0.05 / self.length
                    drift = self._search(lambda grid: self.costs(names, [(shift, e) for e in grid]),  # noqa: B023
                                         drift - span, drift + span, 5)
                else:
                    span *= 0.02
                    shift = self._search(lambda grid: self.costs(names, [(d, 0.0) for d in grid]),  # noqa: B023
                                         shift - span, shift + span, 5)
            self.holds = given
            cost, holds = self.fitted(names, shift, drift)
            found.append((self.fitted(names, 0.0, 0.0)[0] - cost, names, shift, drift, holds))
        if not found:
            return None
        best = max(f[0] for f in found)
        return min((f for f in found if f[0] > best - 0.05), key=lambda f: len(f[1]))[1:]

    def findings(self):
        """Findings of kind ``shift`` and ``clock``.

        Returns
        -------
        list of Finding
        """
        shifted, drifted = self.best()
        drifted = drifted and self._straightened(drifted)
        if drifted is not None and self._drifts(drifted):
            names, _, drift, holds = self._sharpened(drifted)
            _, likelihood, before, after = self._worth(holds)
            return [self._clock(names, drift, before, after, likelihood)]
        return self._late() or self._apart(shifted)

    def _late(self):
        """Columns that come late by what the samples well inside the passes say, where they leave less then.

        Passes that are all alike have all the same answer where something else is missing, and are as sure of it.
        """
        found, sure = latest(self.every, self.sources, self.relations, self.holds, self.group["angles"],
                             self.candidates())
        if found is None or sure < _ASKED:
            return []
        factors = falls(found.before, found.after)
        if max(factors, default=0.0) < _FALLS or math.prod(factors) <= 1.0:  # where neighbours share nothing, none is
            return []
        told = [c for c, e in found.before.items() if not 0.99 * e < found.after[c] < 1.01 * e]
        before, after = ({c: errors[c] for c in told} for errors in (found.before, found.after))
        return self._shift(found.names, found.shift, before, after, sure)

    def _apart(self, shifted):
        """Columns that come late or early against their own slopes, where no friction is."""
        if shifted is None:
            return []
        names, shift, _, holds = shifted
        pairs = {r.angle: r.speed for r in self.relations if isinstance(r, RateRelation)}
        if shift < 0 and {*names} <= {*pairs}:  # nothing makes an angle early, and every filter a speed late
            names, shift = tuple(pairs[n] for n in names), -shift
            holds = self.fitted(names, shift, 0.0)[1]
        holds = {k: h for k, h in holds.items() if isinstance(self.relations[k], RateRelation)}
        ratio, likelihood, before, after = self._worth(holds)
        if ratio < 1 / _BETTER or likelihood < _SURE:
            return []
        return self._shift(names, shift, before, after, self._share(holds))

    def _shift(self, names, shift, before, after, sure):
        """A shift as a finding, where it is more than the samples' distance would make; a question has no mend."""
        ratio = max((e / max(after[c], _TINY * e) for c, e in before.items()), default=1.0)
        if abs(shift) < (0.5 if ratio > _FALLEN else 1.5) * self.step:
            return []
        many = len(names) > 1
        text = (f"{listed(self.columns.of(n) for n in names)} {'come' if many else 'comes'} {abs(shift):.3g} s "
                f"{'late' if shift > 0 else 'early'}: {self._told(before, after)}")
        mend = self._lines(names, late=float(f"{shift:.3g}")) if sure >= QUESTION else ""
        return [Finding("shift", text, [self.columns.of(n) for n in names], sure, before, after, mend)]

    def _drifts(self, drifted):
        """Whether columns come the later the longer the log, as neither chance nor a machine that warms up has it."""
        names, _, drift, holds = drifted
        ratio, likelihood, *_ = self._worth(holds)
        most = abs(drift) * self.length
        alone = len(names) == 1 and any(names[0] in members and len(members) > 1 for members in self.group.values())
        if ratio < (_ALONE if alone else _FELL) or likelihood < _SURE or most < _APART:
            return False
        if self._ageing(holds) < math.log(_AGED):
            return False
        inside = Inside(self.every, self.sources, self.relations, self.holds, self.group["angles"])
        # friction that builds up after a turn looks late there, the later the slower the pass, and nowhere else
        if inside.fall(names, drift) < _FALLS:
            return False
        return self._everywhere(names, drift, holds) and self._later(names, drift, holds)

    def _later(self, names, drift, drifted):
        """Whether stretches of the log come the later the longer it lasts, by about as much as a drift says.

        What is late by the same all the time, and what looks late for a torque that is missing, has no order in time;
        and where chance brings one in, the stretches lie no closer together beside the drift.
        """
        times, left = self._lags(names, 0.0, 0.0, self.fitted(names, 0.0, 0.0)[1])
        lags = _LAGS[left.argmin(1)]
        if np.ptp(times) == 0.0 or np.ptp(lags) == 0.0:
            return False
        beside = self._lags(names, 0.0, drift, drifted)[1]
        if all(_scatter(left, alike) <= _scatter(beside, alike) for alike in (True, False)):
            return False
        order = kendalltau(times, lags, alternative="greater" if drift > 0 else "less")
        told = [(theilslopes(lags, times).slope, order.pvalue), _order(times, left, drift)]
        return any(chance < _CHANCE and 1 / _ABOUT < slope / drift < _ABOUT for slope, chance in told)

    def _everywhere(self, names, drift, drifted):
        """Whether a drift lowers the error of each channel that it changes much: a clock is that of all its columns."""
        sources = with_change(self.sources, {n: Source(n, 1.0, 0.0, drift) for n in names})
        for k in (k for k in drifted if isinstance(self.relations[k], ModelRelation)):
            relation, old, new = self.relations[k], self.holds[k], drifted[k]
            one, other = (r[:, new.used] for r in self._residuals(relation, new, [self.sources, sources]))
            changes = np.std(one - other, axis=1) / np.array([new.spread[c] for c in relation.channels])
            much = [c for c, change in zip(relation.channels, changes) if change >= _ALL * np.max(changes)]
            if any(old.smooth[c] >= _SEEN and old.smooth[c] <= _FALLS * new.smooth[c] for c in much):
                return False
        return True

    def _ageing(self, drifted):
        """By how much less a drifting clock leaves than a machine that warms up: logarithm of the errors' ratio.

        In that machine each coefficient, the zero of each channel, and the inertia behind each torque, changes by a
        parabola over the time. An inertia that the model lacks is late where a torque turns: one of 1.7 times the noise
        was a clock 0.1 % slow. In all relations together: where both reach the noise of one, another tells them apart.
        """
        less = 0.0
        for k in (k for k in drifted if isinstance(self.relations[k], ModelRelation)):
            relation, old = self.relations[k], self.holds[k]
            slopes = relation.evaluate(relation.arguments(self.readings, self.sources), old.x,
                                       self.readings.time.size)[3]
            slopes = np.concatenate([slopes, *self._of_inertia(relation, old.x)], axis=1)
            residual = _without(old, slopes, self.readings.time)
            first, second = (p[old.used[self.readings.partners[0]] & old.used[self.readings.partners[1]]]
                             for p in self.readings.partners)
            aged = [shared(r, first, second) / old.spread[c] for c, r in zip(relation.channels, residual)]
            less += _logarithms(aged) - _logarithms(drifted[k].smooth.values())
        return less

    def _of_inertia(self, relation, x):
        """What an inertia behind each torque of a relation changes in its channels: (channels, 1, samples) each."""
        given, n = relation.arguments(self.readings, self.sources), self.readings.time.size
        for torque in (t for t in self.group["torques"] if t in relation.inputs):
            angle = f"{torque.rpartition('.')[0]}.phi"
            if angle not in self.sources:
                continue
            k, turned = relation.inputs.index(torque), self.readings.take(self.sources[angle], 2)
            little = _LITTLE * np.std(given[k]) / max(np.std(turned), 1e-300) * turned
            more, less = (relation.evaluate([*given[:k], given[k] + d, *given[k + 1:]], x, n, False)[0]
                          for d in (little, -little))
            yield (more - less)[:, None]

    def _share(self, holds):
        """Part of the errors' energy, noise apart, that a shift takes away: an effect that looks late leaves more."""
        pairs = [(self.holds[k].smooth[c], e) for k, a in holds.items() for c, e in a.smooth.items()
                 if self.holds[k].smooth[c] >= _SEEN]
        return max(0.05, 1.0 - sum((e / old) ** 2 for old, e in pairs) / len(pairs))

    def _lines(self, names, **changed):
        """Lines of the study that read the columns at other times."""
        columns = [(self.columns.of(n), self.columns.column(n)) for n in names]
        return "\n".join(column_line(n, replace(c, **changed)) for n, c in columns if c is not None)

    def _clock(self, names, drift, before, after, likelihood):
        listed_names = listed(self.columns.of(n) for n in names)
        how = "slow" if drift < 0 else "fast"
        text = (f"the clock of {listed_names} runs {100 * abs(drift):.3g} % {how}, {abs(drift) * self.length:.3g} s at "
                f"the end of the log: {self._told(before, after)}")
        mend = self._lines(names, clock=1 + drift)
        return Finding("clock", text, [self.columns.of(n) for n in names], _sure(likelihood), before, after, mend)

    def _worth(self, holds):
        """Largest factor by which an error falls, gain of the likelihood, and errors before and after."""
        ratio, likelihood, before, after = 1.0, 0.0, {}, {}
        for k, new in holds.items():
            old = self.holds[k]
            independent = _independent(new)
            for channel in [c for c in new.smooth if old.smooth[c] >= _SEEN]:
                fall = max(old.smooth[channel], _TINY) / max(new.smooth[channel], _TINY)
                likelihood += independent * math.log(fall)
                ratio = max(ratio, fall)
                if abs(math.log(fall)) > 0.02 and channel not in before:
                    before[channel] = old.smooth[channel] * old.spread[channel]
                    after[channel] = new.smooth[channel] * old.spread[channel]
        return ratio, likelihood, before, after

    def _told(self, before, after):
        told = ", ".join(f"{self.columns.of(c)} {before[c]:.3g} -> {after[c]:.3g}" for c in before)
        return f"{told}, noise apart"


def _without(agreement, slopes, time):
    """Residuals without what coefficients, and zeros of the channels, that change by a parabola over time explain."""
    channels, count, _ = slopes.shape
    # by what is left in each: as parts of the signal, little in a small channel would cost much in a large one
    weight = 1 / np.maximum([_error(r, agreement.used) for r in agreement.residual], 1e-300)
    zeros = np.repeat(np.eye(channels)[:, :, None], time.size, 2)
    each = np.concatenate([slopes, zeros], axis=1) * weight[:, None, None]
    span = (time - time.mean()) / max(np.ptp(time), 1e-300)
    columns = np.concatenate([each, each * span, each * span ** 2], axis=1)
    used, target = agreement.used, agreement.residual * weight[:, None]
    a = columns[:, :, used].transpose(0, 2, 1).reshape(-1, 3 * (count + channels))
    size = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    x = np.linalg.lstsq(a / size, target[:, used].ravel(), rcond=1e-9)[0] / size
    return (target - np.einsum("kij,i->kj", columns, x)) / weight[:, None]


def _order(times, left, drift):
    """The drift that stretches say together, and how often chance would bring as good an order among them.

    A stretch of slow motion hardly says how late it is, and its best delay is noise: each counts as it is sure. Where
    one or two say nearly all, the order of their best delays tells more.
    """
    slopes = drift * np.geomspace(1 / _WIDE, _WIDE, _SLOPES)

    def least(times):
        late = np.clip(slopes[:, None] * times, -_LATEST, _LATEST)
        column = (late + _LATEST) * (_DELAYS - 1) / (2 * _LATEST)
        low = np.minimum(column.astype(int), _DELAYS - 2)
        stretch = np.arange(len(times))
        total = (left[stretch, low] * (low + 1 - column) + left[stretch, low + 1] * (column - low)).sum(1)
        return total.min(), slopes[total.argmin()]

    here, slope = least(times)
    rng = np.random.default_rng(0)
    others = np.array([least(rng.permutation(times))[0] for _ in range(_ORDERS)])
    return slope, (1 + np.count_nonzero(others <= here)) / (1 + _ORDERS)


def _scatter(left, alike):
    """Mean distance of the best delays of stretches from their median: all alike, or each as it is sure.

    In a clock of 0.3 % one stretch of eight, a slow one, had a delay of 0.175 s beside the drift, of noise.
    """
    lags, sure = _LAGS[left.argmin(1)], np.ones(len(left)) if alike else left.mean(1) - left.min(1)
    order = np.argsort(lags)
    middle = lags[order[np.searchsorted(np.cumsum(sure[order]), 0.5 * sure.sum())]]
    return float(sure @ np.abs(lags - middle) / max(sure.sum(), 1e-300))


def _independent(agreement):
    """Stretches in which a residual keeps its sign."""
    changes = [np.count_nonzero(np.diff(np.sign(r[agreement.used]))) for r in agreement.residual]
    return float(max(3, 1 + min(changes)))


def _sure(likelihood):
    """Certainty from a gain of the logarithm of the likelihood, less what the choice among many times costs."""
    return 1 / (1 + math.exp(-min(likelihood - 4.0, 40.0)))


# --- filters --------------------------------------------------------------------------------------------------------

_CONSTANTS = (0.003, 0.005, 0.008, 0.0125, 0.02, 0.032, 0.05, 0.08, 0.125)
"""Time constants [s] of first-order filters that are tried."""
_CLEAR = 0.8
"""Factor by which the error must fall for a filter to be named, and by which it must be below that of any shift."""


def filtered(readings, sources, relation, x, columns, group):
    """References or torques that went through a low-pass filter.

    Parameters
    ----------
    readings : Readings
        At every sample.
    sources : dict of str to Source
        How each variable is read, mistakes undone.
    relation : ModelRelation
        The study's own comparison.
    x : ndarray
        Its fitted parameters.
    columns : Columns
        Name the columns of the variables in the findings.
    group : dict of str to list of str
        Variables by what they are, as `changes.roles` gives them.

    Returns
    -------
    list of Finding
    """
    y, predicted = relation.measured(readings, sources), relation.predict(readings, sources, x)
    used, step = _settled(readings, sources, relation, x), float(np.median(np.concatenate(
        [np.diff(t) for t in readings.times])))
    if used.sum() < 100 or not np.isfinite(predicted).all():
        return []
    given = np.array([_error(a - b, used) for a, b in zip(y, predicted)])
    best = None
    for names, one, other in ((group["references"], predicted, y), (group["torques"], y, predicted)):
        for constant in [c for c in _CONSTANTS if c >= step] if names else ():
            slow, late, early = _low_pass(one, constant, step, readings.run)
            there = np.array([_error(a - b, used) for a, b in zip(other, slow)])
            # a mean takes noise away, whichever way it looks: only what the direction adds tells of a filter
            back = np.array([_error(a - b, used) for a, b in zip(other, early)])
            apart = np.array([_error(a - b, used) for a, b in zip(other, late)])
            score = float(np.mean(np.log(there / np.maximum(np.minimum(np.minimum(given, back), apart), 1e-12))))
            if best is None or score < best[0]:
                best = score, names, constant, there
    if best is None:
        return []
    score, names, constant, there = best
    if score > math.log(_CLEAR):
        return []
    names = [columns.of(n) for n in names]
    before, after = ({c: float(v) for c, v in zip(relation.channels, e)} for e in (given, there))
    text = (f"{listed(names)} went through a low-pass filter of about {constant:.2g} s: "
            + ", ".join(f"{columns.of(c)} {before[c]:.3g} -> {after[c]:.3g}" for c in before))
    return [Finding("filtered", text, names, 0.9, before, after)]


def _settled(readings, sources, relation, x):
    return relation.hold(readings, sources, x).used


def _error(residual, used):
    return _winsorised(residual[used])


def _low_pass(values, constant, step, run):
    """Values through a filter, as much smoothed but merely late, and through the filter backwards in time."""
    keep, late = math.exp(-step / constant), max(1, int(round(constant / step)))
    slow, shifted, early = np.empty_like(values), np.empty_like(values), np.empty_like(values)

    def through(part):
        return lfilter([1 - keep], [1, -keep], part, axis=1, zi=part[:, :1] * keep)[0]
    for k in np.unique(run):
        inside = run == k
        part = values[:, inside]
        slow[:, inside] = through(part)
        early[:, inside] = through(part[:, ::-1])[:, ::-1]
        even = 0.5 * (slow[:, inside] + early[:, inside])
        shifted[:, inside] = np.concatenate([even[:, :1].repeat(late, 1), even[:, :-late]], axis=1)[:, :part.shape[1]]
    return slow, shifted, early

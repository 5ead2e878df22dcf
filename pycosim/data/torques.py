"""Measured torques and the motion in; what the motion alone predicts of them, without their noise, out.

A torque recorded late, or through a filter, is moved by its prediction: the slope of the record itself is mostly noise.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..dynamics.delays import between
from ..dynamics.filters import first_order, settings
from .noise import contiguous
from .segmentation import directions
from .turns import built_up

SMOOTH = 5  # degree of the polynomial of the configuration that the torque of a load is predicted by
FALLS = (0.05, 0.2)  # of the fastest speed, over which a friction may fall
FOLDS = 5  # of passes
CLEAR = 1e-6  # least singular value over the largest, from which a pass tells a share of what all tell
_FEW = 20  # samples of a pass or a direction, of which nothing is predicted
JUMP = 0.1  # s from the ends of a pass, in which a torque recorded late may jump
SETTLED = 2.0  # time constants after which little is left of what is not known of the onset of a jump
LEAST, NODE = 1e-4, 1.1  # s, least time constant of a filter that is a node, and the ratio of two nodes
KEPT = 6  # nodes
LAGS = np.geomspace(0.002, 0.3, 16)  # s, of filters that are tried on a start
TRAVELS = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)  # over the model's own, that friction may build up over at a start
LEAVES = 0.1  # of a torque's variance, that the motion may leave of what is moved in the record's place
QUIET = 0.2  # of the noise of a torque's record, that what the motion predicts of it may have to be moved in its place
SHARE = 0.2  # of a pass that may be left to what happens at its ends
LEVEL = np.array([-0.1, 0.4, 0.4, 0.4, -0.1])
"""A mean over five samples that keeps parabolas, and in which a sample counts as much as its neighbours: what a filter
holds back of it within a step shares no noise with the accelerations that it was predicted from."""


def predicted(dataset, values, trusted=None):
    """Values as the motion predicts them at moving samples.

    Parameters
    ----------
    dataset : Dataset
        Arranged: its passes and moving samples are known.
    values : ndarray, shape (n,)
        Of a measured torque [N.m], on a linear axis [N].
    trusted : ndarray of bool, shape (n,), optional
        Samples that the prediction is made from; all moving ones by default.

    Returns
    -------
    ndarray, shape (n,)
        In the unit of the values; the values themselves where nothing moves.
    """
    trusted = dataset.moving if trusted is None else trusted
    return dataset.memo(("torques.motion", trusted.tobytes()), lambda: _Motion(dataset, trusted)).of(values)


class _Motion:
    """What the motion predicts of values along it: what hangs on the motion alone is worked out once."""

    def __init__(self, dataset, trusted):
        self.ways = []
        for k, where in enumerate(_ways(dataset)):
            told = trusted[where] if np.count_nonzero(trusted[where]) > _FEW else np.ones(len(where), dtype=bool)
            rows = _regressors(dataset, k, _degree(told))
            moments = rows[:, told] @ rows[:, told].T
            self.ways.append((where, told, rows, np.linalg.pinv(moments, rcond=1e-10)))
        self.piece, self.trusted, count = np.full(len(dataset.time), -1), trusted, 0
        for s in () if dataset.paired else contiguous(dataset.time, dataset.passes):
            if dataset.passes[s.start] >= 0 and np.count_nonzero(trusted[s]) > _FEW:
                self.piece[s] = count
                count += 1
        self.inside = np.flatnonzero(self.piece >= 0)

    def of(self, values):
        """What is predicted of values; themselves where nothing moves."""
        found = values.copy()
        for where, told, rows, inverse in self.ways:
            found[where] = inverse @ (rows @ np.where(told, values[where], 0.0)) @ rows
        if len(self.inside):
            found[self.inside] = self._levelled(found, values)
        return found

    def _levelled(self, found, values):
        """Pass by pass the level and the share of what all tell that fit it, where its changes tell a share."""
        told = self.inside[self.trusted[self.inside]]
        number, inside = self.piece[told], self.piece[self.inside]
        count = np.bincount(number)
        level, mean = (np.bincount(number, x[told]) / count for x in (found, values))
        away = found[told] - level[number]
        spread = np.bincount(number, away**2)
        total = count + np.bincount(number, found[told] ** 2)  # squares of the level's column and of this one
        most = (total + np.sqrt(np.maximum(total**2 - 4 * count * spread, 0.0))) / 2
        clear = count * spread > (CLEAR * most) ** 2
        share = np.bincount(number, away * values[told]) / np.where(clear, spread, 1.0) * clear
        return mean[inside] + share[inside] * (found[self.inside] - level[inside])


def _ways(dataset):
    """Moving samples, one array for each set of directions of all segments, and of paired runs for each run."""
    def make():
        code = directions(dataset.speeds) + (dataset.run << len(dataset.speeds) if dataset.paired else 0)
        return [np.flatnonzero(dataset.moving & (code == c)) for c in np.unique(code[dataset.moving])]
    return dataset.memo("torques.ways", make)


def _degree(told):
    """Degree of the polynomial that so many samples carry."""
    return 3 if told.sum() > 1000 else 2 if told.sum() > 200 else 1


def _regressors(dataset, way, degree):
    """Powers of the configuration up to a degree, and with the third one speeds and accelerations, one a row.

    At the samples of one of the ways that `_ways` lists.
    """
    def make():
        span, where = np.maximum(np.ptp(dataset.config, axis=1, keepdims=True), 1e-9), _ways(dataset)[way]
        x = 2 * (dataset.config[:, where] - dataset.config.min(1, keepdims=True)) / span - 1
        rates = [v[where] / np.std(v) for n, v in dataset.signals.items()
                 if degree == 3 and n.startswith("der(") and np.ptp(v) > 0]
        return np.array([*(np.prod(x ** np.array(e)[:, None], axis=0) for e in itertools.product(
            range(degree + 1), repeat=len(x)) if sum(e) <= degree), *rates])
    return dataset.memo(("torques.regressors", way, degree), make)


class _Falling:
    """What of a torque falls with speed as a Stribeck friction does, the same for all directions and passes.

    It changes within a ramp, where a filter holds most back, and the motion's polynomials do not follow it. Where
    nothing falls its columns would bring noise: they are used if they predict passes that they were not fitted to.
    """

    def __init__(self, dataset, values, trusted):
        self.dataset, self.trusted = dataset, trusted
        self.columns = dataset.memo("torques.falling", lambda: np.array([
            np.sign(w) * np.exp(-np.abs(w) / (share * np.abs(w).max()))
            for w in dataset.speeds if np.ptp(np.abs(w)) > 0 for share in FALLS]).reshape(-1, len(values)))
        self.used = len(self.columns) > 0 and self._predicts(values)

    def of(self, values):
        """What falls of such values, shape (n,)."""
        if not self.used:
            return np.zeros(len(values))
        total = sum(self._moments(values))
        return np.linalg.lstsq(total[:-1, :-1], total[:-1, -1], rcond=1e-10)[0] @ self.columns

    def _predicts(self, values):
        """Whether passes tell what falls in the others."""
        parts, gains = self._moments(values), []
        for own in parts if len(parts) > 1 else ():
            rest = sum(parts) - own
            x = np.linalg.lstsq(rest[:-1, :-1], rest[:-1, -1], rcond=1e-10)[0]
            gains.append(2 * x @ own[:-1, -1] - x @ own[:-1, :-1] @ x)
        return bool(np.sum(gains) > np.sqrt(np.sum(np.square(gains))))

    def _moments(self, values):
        """Moments of the columns and the values, beside what the motion predicts otherwise, fold by fold of passes."""
        _, order = np.unique(self.dataset.passes, return_inverse=True)
        parts = np.zeros((FOLDS, len(self.columns) + 1, len(self.columns) + 1))
        for way, where in enumerate(_ways(self.dataset)):
            inside = self.trusted[where]
            a, told = _regressors(self.dataset, way, _degree(inside))[:, inside], where[inside]
            rows, k = np.array([*a, *self.columns[:, told], values[told]]), len(a)
            own = order[told]
            count = np.maximum(np.bincount(own), 1)
            rows -= np.array([np.bincount(own, row) / count for row in rows])[:, own]  # each pass from its own level
            rows = rows[k:] - np.linalg.lstsq(rows[:k] @ rows[:k].T, rows[:k] @ rows[k:].T, rcond=1e-10)[0].T @ rows[:k]
            for fold in range(FOLDS):
                part = rows[:, own % FOLDS == fold]
                parts[fold] += part @ part.T
        return [part for part in parts if part.any()]


def held_back(dataset, name, lag):
    """What a filter of first order holds back of what the motion predicts of a torque, and its slope by the lag.

    Parameters
    ----------
    dataset : Dataset
        Arranged: its passes and moving samples are known.
    name : str
        Of the measured torque.
    lag : float
        Time constant of the filter [s].

    Returns
    -------
    behind, by_lag : ndarray, shape (n,)
        In the torque's unit, and in that a second.
    """
    start = dataset.memo(("torques.start", name),
                         lambda: _Start(dataset, dataset.signals.get(name, 0.0 * dataset.time)))
    return start.held(lag)


def lag(question, parameters):
    """The longest time constant of the filters through which a question's torques were recorded.

    Parameters
    ----------
    question : Question
        That the model is asked.
    parameters : dict of str to float
        All of the model's, SI units.

    Returns
    -------
    float
        [s]; none where no filter is among the question's effects.
    """
    torques = [n for n in question.late if not is_motion(n)]
    return float(np.max(settings(question, [f"lag({n})" for n in torques], parameters), initial=0.0))


def is_motion(name):
    """Whether a known signal is an angle, a speed or an acceleration.

    Parameters
    ----------
    name : str
        Of a variable of the model.

    Returns
    -------
    bool
    """
    return name.startswith("der(") or name.endswith((".phi", ".w"))


def unsettled(dataset, lag):
    """Samples of the start of a pass that a filter still tells of, of no more than a fifth of a pass.

    Parameters
    ----------
    dataset : Dataset
        Arranged: its passes are known.
    lag : float
        Time constant [s].

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    found = np.zeros(len(dataset.time), dtype=bool)
    for s in contiguous(dataset.time, dataset.passes):
        since = dataset.time[s] - dataset.time[s.start]
        found[s] = (dataset.passes[s.start] >= 0) & (since < min(SETTLED * lag, SHARE * since[-1]))
    return found


class _Nodes:
    """What a filter of first order holds back of a record, worked out at some time constants and straight between them.
    """

    def __init__(self, dataset):
        self.dataset, self.nodes = dataset, {}

    def held(self, lag):
        """What a filter holds back, and its slope by the time constant."""
        k = math.floor(math.log(max(lag, LEAST) / LEAST) / math.log(NODE))
        low, high = LEAST * NODE ** k if lag > LEAST else 0.0, LEAST * NODE ** (k + 1)
        one, two = self._node(low), self._node(high)
        slope = (two - one) / (high - low)
        return one + max(lag - low, 0.0) * slope, slope

    def _node(self, lag):
        if lag not in self.nodes:
            while len(self.nodes) >= KEPT:  # of a long log each is as large as a signal
                del self.nodes[next(iter(self.nodes))]
            self.nodes[lag] = self._made(lag) if lag else np.zeros(len(self.dataset.time))
        return self.nodes[lag]


class _Start(_Nodes):
    """What the motion predicts of a torque from samples at which a filter has caught up, from one turn to the next.

    A sample below the least speed that goes the way of its neighbour is as that, but for what friction builds up over a
    travel: jumps that come too early would be taken for a longer filter. The travel, of the model's own, is the one
    with which some filter gives the record.
    """

    def __init__(self, dataset, values):
        super().__init__(dataset)
        self.values = values
        starts = np.append(True, (np.diff(dataset.passes) != 0) | (np.diff(dataset.run) != 0))
        since = dataset.time - dataset.time[np.maximum.accumulate(np.where(starts, np.arange(len(values)), 0))]
        self.trusted = dataset.moving & (since > JUMP)
        way = np.sign(dataset.speeds)
        turns = np.flatnonzero(np.any(np.diff(way, axis=1) != 0, axis=0) | (np.diff(dataset.run) != 0)) + 1
        parts = [(part, part[dataset.moving[part]]) for part in np.split(np.arange(len(values)), turns)]
        self.parts = [(part, moving) for part, moving in parts if moving.size]
        self.shares = [None] * len(self.parts)
        self.falling = _Falling(dataset, values, self.trusted)
        self.torque = self.settled(values)
        if not dataset.averaged and dataset.base.segments:
            self.shares = min((self.shares, *map(self._shares, TRAVELS)), key=self._off)
            self.torque = self.settled(values)

    def settled(self, values):
        """What the motion predicts of a record, also before and after a pass, and while friction is built up."""
        falling = self.falling.of(values)
        found = predicted(self.dataset, values - falling, self.trusted) + falling
        for (part, moving), share in zip(self.parts, self.shares, strict=True):
            if moving.size >= LEVEL.size:
                found[moving[2:-2]] = np.convolve(found[moving], LEVEL, "valid")
            found[part[0]:moving[0]], found[moving[-1] + 1:part[-1] + 1] = found[moving[0]], found[moving[-1]]
            if share is not None:
                found[part] = found[part[0] - 1] + share * (found[part] - found[part[0] - 1])
        return found

    def _made(self, lag):
        """What a filter holds back of what the motion predicts; of the record itself that is late as well."""
        def held(torque):
            return torque - first_order(torque[None], lag, self.dataset.time, self.dataset.run)[0][0]
        return held(self.settled(self.values + held(self.torque)))

    def _shares(self, times):
        """How much of the jump at each start has come, after a travel that is so many times the model's own."""
        data = self.dataset
        parameters = {n: v.value for n, v in data.parameters.variables(data.base).items()}
        built = built_up(data, data.base, parameters, times)
        return [_share(built[:, part[0] - 1:part[-1] + 1], np.sign(data.speeds[:, moving[0]]))
                if part[0] and data.run[part[0]] == data.run[part[0] - 1] else None for part, moving in self.parts]

    def _off(self, shares):
        """What the best filter of the torque leaves of the record soon after the starts."""
        data, self.shares = self.dataset, shares
        torque, early = self.settled(self.values), np.zeros(len(self.values), dtype=bool)
        for part, _ in self.parts:
            early[part] = data.time[part] - data.time[part[0]] < 2 * JUMP
        return min(np.sum((self.values - first_order(torque[None], lag, data.time, data.run)[0][0])[early] ** 2)
                   for lag in LAGS)


def _share(built, way):
    """How much of a jump has come, on the mean of the segments that turn, from before it on: from 0 to 1."""
    span = way - built[:, 0]
    turning = np.abs(span) > 0.5
    if not turning.any():
        return np.ones(built.shape[1] - 1)
    share = ((built[turning] - built[turning, :1]) / span[turning, None]).mean(0)[1:]
    return np.clip(np.maximum.accumulate(share), 0.0, 1.0)


def slope(dataset, name):
    """Slope of what the motion alone predicts of a signal, well inside the passes, and of the record elsewhere.

    Near the ends of a pass a torque recorded late jumps, and the motion predicts it elsewhere. The first slope is zero
    there: it tells of that jump and of no slope. The record's own, over five samples, is needed between two samples:
    else the error over a delay has steps on which a fit stops.

    Parameters
    ----------
    dataset : Dataset
        Arranged: its passes and moving samples are known.
    name : str
        Of the signal; zero everywhere for one that is not measured.

    Returns
    -------
    inside, jumping : ndarray, shape (n,)
        In the signal's unit a second; one of them is zero at each sample.
    """
    def make():
        nothing = np.zeros(len(dataset.time))
        inner, values = nothing.copy(), dataset.exogenous().get(name, nothing)
        outer = _own_slope(dataset, dataset.signals.get(name, nothing))
        for s, reach, inside in _passes(dataset):
            ahead, behind = (np.interp(dataset.time[s] + sign * reach, dataset.time[s], values[s]) for sign in (1, -1))
            inner[s] = np.where(inside, ahead - behind, 0.0) / max(2 * reach, 1e-300)
            outer[s][inside] = 0.0
        return inner, outer
    return dataset.memo(("torques.slope", name), make)


def _own_slope(dataset, values):
    """Slope of a record over five samples, log by log; none at the ends of a log."""
    found = np.zeros(len(values))
    for k in np.unique(dataset.run):
        own = np.flatnonzero(dataset.run == k)
        if len(own) > 4:
            x, t = values[own], dataset.time[own]
            found[own[2:-2]] = (2 * (x[4:] - x[:-4]) + x[3:-1] - x[1:-3]) / (2.5 * (t[4:] - t[:-4]))
    return found


def calm(dataset, name, delay, moved):
    """A measured torque whose noise stays where it is, while what the motion predicts of it is moved by a delay.

    The prediction is made of the record as moved: as recorded, a late torque belongs to no motion where that changes.
    Straight lines between samples take noise away, and the noise of the accelerations is in the prediction: where it is
    not far quieter than the record, as behind coarse encoders, the record is moved with its noise. So it is where the
    motion does not tell the load, as of a leg that somebody moves: what is not predicted would stay where it is.

    Parameters
    ----------
    dataset : Dataset
        Arranged: its passes and moving samples are known.
    name : str
        Of the torque.
    delay : float
        [s]
    moved : ndarray, shape (n,)
        The record, moved by it.

    Returns
    -------
    ndarray, shape (n,)
        In the torque's unit; NaN near the ends of a pass, where a late torque may jump.
    """
    if name not in dataset.signals or not dataset.memo(("torques.quiet", name), lambda: _quiet(dataset, name)):
        return moved
    inside = dataset.memo("torques.inside", lambda: _inside(dataset))
    found = np.where(inside, predicted(dataset, moved, dataset.moving & inside), np.nan)
    return dataset.signals[name] + found - between(dataset.time, found, dataset.run, -delay)


def _quiet(dataset, name):
    """Whether what the motion predicts of a torque has much less noise than its record, and changes as that does."""
    inside, record = dataset.memo("torques.inside", lambda: _inside(dataset)), dataset.signals[name]
    here = dataset.moving & inside
    found = predicted(dataset, record, here)
    whole = sliding_window_view(inside, 5).all(1)  # no ends of passes
    quick = [np.median(np.abs(np.diff(x, 4)[whole])) if whole.any() else 0.0 for x in (found, record)]
    alike = not here.any() or np.var((record - found)[here]) <= LEAVES * np.var(record[here])
    return bool(quick[0] <= QUIET * quick[1] and alike)


def _inside(dataset):
    """Samples that lie well inside the passes."""
    found = np.zeros(len(dataset.time), dtype=bool)
    for s, _, inside in _passes(dataset):
        found[s] = inside
    return found


def _passes(dataset):
    """Samples of each pass, how far from its ends a torque recorded late may jump [s], and which are beyond."""
    for s in contiguous(dataset.time, dataset.passes):
        if dataset.passes[s.start] >= 0:
            time = dataset.time[s]
            reach = min(JUMP, SHARE * (time[-1] - time[0]))
            yield s, reach, (time >= time[0] + reach) & (time <= time[-1] - reach) & (reach > 0)


def of_load(dataset, channel):
    """What the motion alone predicts of a measured channel that is a function of it, as the torque of a load is.

    Parameters
    ----------
    dataset : Dataset
        Arranged: its passes and moving samples are known.
    channel : str
        Output of the question that was measured.

    Returns
    -------
    ndarray, shape (n,)
        In the channel's unit: log by log, a polynomial of the configuration, and speeds and accelerations with their
        products.
    """
    def make():
        found = np.array(dataset.reference(channel), dtype=float)
        for part, rows in _of_motion(dataset):
            found[part] = _told(rows, found[part]) @ rows
        return found

    return dataset.memo(("torques.of_load", channel), make)


def held_of_load(dataset, channel, lag):
    """What a filter of first order holds back of a measured channel that is a function of the motion.

    The record is behind that function: it is compared with what the filter makes of each of the motion's terms.

    Parameters
    ----------
    dataset : Dataset
        Arranged: its passes and moving samples are known.
    channel : str
        Output of the question that was measured.
    lag : float
        Time constant of the filter [s].

    Returns
    -------
    behind, by_lag : ndarray, shape (n,)
        In the channel's unit, and in that a second.
    """
    return dataset.memo(("torques.load", channel), lambda: _Load(dataset, channel)).held(lag)


class _Load(_Nodes):
    """What a filter holds back of a channel that the motion alone predicts."""

    def __init__(self, dataset, channel):
        super().__init__(dataset)
        self.channel = channel

    def _made(self, lag):
        found = np.array(self.dataset.reference(self.channel), dtype=float)
        for part, rows in _of_motion(self.dataset):
            time, run = self.dataset.time[part], np.zeros(len(part))
            filtered = np.array([first_order(row[None], lag, time, run)[0][0] for row in rows])
            found[part] = _told(filtered, found[part]) @ (rows - filtered)
        return found


def _of_motion(dataset):
    """Samples of each log, and the terms of the motion there of which a load is made, one a row."""
    rates = [v for n, v in dataset.signals.items() if n.startswith("der(")]
    for part in (np.flatnonzero(dataset.run == k) for k in np.unique(dataset.run)):
        x = dataset.config[:, part]
        x = 2 * (x - x.min(1, keepdims=True)) / np.maximum(np.ptp(x, axis=1, keepdims=True), 1e-9) - 1
        own = [v[part] / max(np.std(v[part]), 1e-300) for v in rates]
        rows = [np.prod(x ** np.array(e)[:, None], axis=0)
                for e in itertools.product(range(SMOOTH + 1), repeat=len(x)) if sum(e) <= SMOOTH]
        yield part, np.array([*rows, *own, *(a * b for a, b in itertools.combinations_with_replacement(own, 2))])


def _told(rows, values):
    """Coefficients of rows that leave least of values."""
    return np.linalg.lstsq(rows @ rows.T, rows @ values, rcond=1e-10)[0]

"""A log's samples after each turn in; which of them the model's own elastic displacement explains, out.

A segment gives by its `travel` before it slides. The models that are fitted take friction as that of sliding at once,
which is right where the machine is stiffer than that, or the log too coarse to show it. What a longer travel, a delay
or a filter does after a turn looks otherwise, and is for the diagnosis to find.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear, nnls

from ..compile import compile_model
from ..dynamics.states import propagate
from . import segmentation
from .derivatives import resolution
from .noise import contiguous
from .spikes import mended, starts

BUILT_UP = 0.02  # of a segment's friction, that may still have to build up where it counts as sliding
LONGER = 5.0  # times the model's own travel, within which a turn is looked at
AFTER = 10  # samples of a pass beyond that, which tell what it would have been
EXPLAINED, AT_LEAST, CHANCE = 0.95, 0.91, 2.0
"""Of what is off after turns, that the model's own travel explains where it is all that is at work: 99 % then, less by
so many standard deviations of the noise's own squares, to the second; a hidden presliding leaves 10 to 25 %, a delay or
a filter 20 to 75 %."""
ALIKE = (0.6, 1.6)
"""Travels, over the model's own, that may share it: friction builds up by no one law. Where it was an exponential of
the way, behind speeds of a sample late, the model's travel left 6 %, and with these beside it 2.6; true delays of 3 to
40 ms then left 21 to 55 for 28 to 66, and travels of twice the model's at one stage are told by the other stages."""
PART = 0.25
"""The same where something else is off there too: then it must be better than any other travel, delay or filter."""
HALF, ALL = 0.5, 0.1
"""A machine has a travel at each of its segments: with half of its own everywhere at the least, no more than so much
more may be left. Of eight machines with a travel everywhere that was at most 0.7 %, of three with one at one stage or
at two 37 to 388."""
TIMES, LATE, LAGS = (0.25, *ALIKE, LONGER, 3 * LONGER), (1, 2, 3, 4, 6, 8, 12, 16), (2, 4, 8)
"""Travels, over the model's own, delays and time constants of filters [samples] that it is compared with."""
ENOUGH, STEPS, PROBE = 5000, 2, 1e-3
"""Samples and straight steps that settle free parameters, and the part of one that its changes are made of."""
SPIKE, FEWEST = 10.0, 0.05  # standard deviations off, from which a sample is a spike, and of how many at most
SEEN = 2.0  # times the squared noise, from which something is off at all
OFF, TRIMMED, FEW, EACH = 8.0, 0.1, 4, 2
"""Times the squared noise, from which slow samples are off, in the mean of the ends of passes without the least and the
most so many of them (a spike is no law), how many ends tell, and samples of each: one jump between two samples does not
say where it was, and a delay of 31 ms at 50 Hz was 43 with it."""


def building_up(miss, longer, moving, passes, time, errors, columns, others=(), alike=()):
    """Samples at which friction still builds up over the model's own travel; none where that is not what is seen.

    Parameters
    ----------
    miss, longer : ndarray, shape (segments, n)
        Friction states short of their limits, for the model's own travel and for one that is `LONGER` times that.
    moving : ndarray of bool, shape (n,)
        Samples in which every segment is faster than the least speed.
    passes : ndarray of int, shape (n,)
        -1 where nothing moves.
    time : ndarray, shape (n,)
        [s]
    errors : ndarray, shape (channels, n)
        Measured less predicted, for friction that slides at once.
    columns : ndarray, shape (segments, channels, n)
        What each segment's own travel would change in the prediction.
    others : sequence of ndarray, shape (segments, channels, n)
        The same of other travels, of torques that come late or through a filter.
    alike : sequence of ndarray, shape (segments, channels, n)
        The same of travels near to the model's own, which may share what it explains.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    own = moving & np.any(np.abs(miss) > BUILT_UP, axis=0)
    near = moving & np.any(np.abs(longer) > BUILT_UP, axis=0)
    off, noise, at = _after_turns(near, passes, time, errors)
    nothing = np.zeros(len(time), dtype=bool)
    if not own[at].any():
        return nothing
    weight = 1 / np.sqrt(np.maximum(np.median(noise, axis=1, keepdims=True), 1e-300))

    def left(some, least=0.0):
        rows = (some[:, :, at] * weight).reshape(len(some), -1)
        return nnls(rows.T, (off * weight).ravel() - least * rows.sum(0))[1] ** 2

    spiked = _far(off * weight, columns[:, :, at] * weight)
    if 0 < spiked.mean() < FEWEST:  # one of these in a turn would hide what all the others tell
        off, noise, at = off[:, ~spiked], noise[:, ~spiked], at[~spiked]
        middle = np.median(noise, axis=1, keepdims=True)
        noise = np.where(noise > SPIKE ** 2 * middle, middle, noise)
    total, usual, alone = np.sum((off * weight) ** 2), np.sum(noise * weight**2), left(columns)
    if total < SEEN * usual or (len(columns) > 1 and left(columns, HALF) > (1 + ALL) * alone):
        return nothing
    chance, shared = CHANCE * usual * np.sqrt(2 / off.size), left(np.concatenate([columns, *alike]))
    if shared - usual <= min((1 - EXPLAINED) * (total - usual) + chance, (1 - AT_LEAST) * (total - usual)):
        return own
    if total - alone < PART * (total - usual):
        return nothing
    return own if alone < min(map(left, others), default=0.0) else nothing


def _after_turns(near, passes, time, errors):
    """How far samples near a turn are off the next that are not, the square that noise would make of it, and which."""
    off, noise, at = [errors[:, :0]], [errors[:, :0]], [np.array([], dtype=int)]
    for s in contiguous(time, passes):
        index = np.arange(s.start, s.stop)
        beyond = np.flatnonzero(~near[s])[:AFTER]
        if passes[s.start] < 0 or len(beyond) < AFTER:
            continue
        usual = errors[:, index[beyond]]
        some = index[:beyond[0]][near[index[:beyond[0]]]]
        at.append(some)
        off.append(errors[:, some] - _mean(usual))
        noise.append(np.tile(np.var(np.diff(usual, axis=1), axis=1)[:, None] / 2 * (1 + 1 / AFTER), (1, len(some))))
    return np.hstack(off), np.hstack(noise), np.concatenate(at)


def _far(off, columns):
    """Samples that are far from what the columns explain of them, all in units of the noise."""
    rows = columns.reshape(len(columns), -1)
    explained = nnls(rows.T, off.ravel())[0] @ rows
    return np.any(np.abs(off - explained.reshape(off.shape)) > SPIKE, axis=0)


def _mean(values):
    """Mean of each row, shape (rows, 1), without what is far off all others of it."""
    away = np.abs(values - np.median(values, axis=1, keepdims=True))
    scatter = np.median(away, axis=1, keepdims=True)
    return np.mean(values, axis=1, keepdims=True, where=(away <= 2 * SPIKE * scatter) | (scatter == 0))


def compared(dataset, parameters, least, slowest, angles):
    """Samples in which every segment moves, for the fit and all that follows.

    What is slower than the least speed tells of turns alone: of a machine's own travel, which no fit knows, and little
    else. Where it is off by more than that, though, a torque that comes late or through a filter, a longer travel or a
    friction that falls with speed shows there first, and often there alone: then it counts as well.

    Parameters
    ----------
    dataset : Dataset
        Its speeds are known.
    parameters : dict of str to float
        Of the base model, `travel` [rad] or [m] among them.
    least, slowest : ndarray, shape (segments,)
        Speeds above which a segment moves: usually, and where slow samples count [rad/s, or m/s].
    angles : list of str
        Variables that are recorded angles [rad], positions [m].

    Returns
    -------
    moving : ndarray of bool, shape (n,)
    passes : ndarray of int, shape (n,)
        -1 where nothing moves.
    least : ndarray, shape (segments,)
        The speeds that were taken.
    at_work : bool
        Whether what is off after turns is the machine's own travel: no other of about its length can be told beside it.
    """
    moving, passes = _cut(dataset, least, angles)
    if not dataset.base.segments:
        return moving, passes, least, False
    travel, at_work = _Travel(dataset, parameters, moving), False
    if np.any(slowest < least):  # there a travel is told from a delay best
        slow, ways = _cut(dataset, slowest, [n for n in angles if not dataset.motion.told_by_speed(n)])
        dense = np.count_nonzero(slow & ~moving) >= EACH * 2 * (len(np.unique(ways)) - 1)  # both ends of each pass
        at_work = dense and travel.seen(slow, ways, travel.others).any()
        if dense and not at_work and off(travel.errors[travel.forces], moving, ways, dataset.time):
            return slow, ways, slowest, False
    at_work = at_work or travel.seen(moving, passes).any()
    if at_work:
        moving = moving & ~np.any(np.abs(travel.miss) > BUILT_UP, axis=0)
    return moving, np.where(moving, passes, -1), least, bool(at_work)


def _cut(dataset, least, angles):
    """Moving samples without the ends that smoothing adds to them, and their passes."""
    moving = segmentation.moving(dataset.speeds, least, dataset.run)
    passes = segmentation.passes(dataset.time, dataset.speeds, moving, dataset.run)
    moving = without_ends(dataset, moving, passes, [dataset.measured[n] for n in angles]) & ~dataset.left_out
    moving &= ~dataset.motion.unsure
    return moving, np.where(moving, passes, -1)


def off(errors, moving, passes, time):
    """Whether what lies before and after the usual samples of passes is off, compared with those next to it.

    Parameters
    ----------
    errors : ndarray, shape (channels, n)
        Measured less predicted, for friction that slides at once, of what friction acts on: steps of a joint's encoder
        do not scatter.
    moving : ndarray of bool, shape (n,)
        The usual samples.
    passes : ndarray of int, shape (n,)
        Passes of these and the slower ones, -1 elsewhere.
    time : ndarray, shape (n,)
        [s]

    Returns
    -------
    bool
    """
    squares, noise = [], []
    for s in contiguous(time, passes):
        usual = np.flatnonzero(moving[s])
        if passes[s.start] < 0 or len(usual) < AFTER:
            continue
        for slower, near in ((slice(s.start, s.start + usual[0]), usual[:AFTER]),
                             (slice(s.start + usual[-1] + 1, s.stop), usual[-AFTER:])):
            if slower.start < slower.stop:
                beside = errors[:, s.start + near]
                gap = errors[:, slower] - beside.mean(axis=1, keepdims=True)
                squares.append(np.mean(gap**2, axis=1))
                noise.append(np.var(beside, axis=1, ddof=1) * (1 + 1 / AFTER))
    if len(squares) < FEW:
        return False
    times = np.sort(np.array(squares) / np.maximum(np.median(noise, axis=0), 1e-300), axis=0)
    cut = int(TRIMMED * len(times))
    return bool(np.any(times[cut:len(times) - cut].mean(axis=0) > OFF))


class _Travel:
    """What the rig's own travel changes after turns, what else would look like it, and what is measured there.

    No effect of the study counts, nor what it says of free parameters: samples are the same with what was found as
    without it, and from any start.
    """

    def __init__(self, dataset, parameters, moving):
        from scipy.signal import lfilter  # only now: it takes as long to import as an export takes

        base = compile_model(dataset.library, dataset.study.rig, [])
        question, self.time = dataset.ask(base), dataset.time
        parameters = {n: parameters[n] for n in base.parameters}
        rows, way = [question.states.index(f"{c}.z") for c in base.segments], np.sign(dataset.speeds)
        sliding = np.zeros((len(question.states), len(self.time)))
        sliding[rows] = way

        torques = [n for n in {*dataset.known, *dataset.outputs} if base.unit(n) in ("N.m", "N")]
        calm = {n: _mended(dataset, dataset.measured[n]) for n in torques if n in dataset.measured}
        signals = {**dataset.signals, **{n: v for n, v in calm.items() if n in dataset.signals}}

        def predicted(states, values=None, names=dataset.outputs):
            return np.array(list(dataset.segment_signals(base, values or parameters, names, states, signals).values()))

        measured = np.array([calm.get(c, dataset.reference(c)) for c in dataset.outputs])
        parameters = _settled(dataset, base, parameters, moving, measured, lambda v: predicted(sliding, v))

        def changed(friction):
            """What each segment's friction state changes in the prediction, segment by segment."""
            found = []
            for row, state in zip(rows, friction):
                states = sliding.copy()
                states[row] = state
                found.append(predicted(states) - at_once)
            return np.array(found)

        early, at_once = built_up(dataset, base, parameters), predicted(sliding)
        far = {times: built_up(dataset, base, parameters, times) for times in TIMES}
        late = [np.roll(early, n, axis=1) for n in LATE]
        lagging = [lfilter([1 / (1 + n)], [1, -n / (1 + n)], early, axis=1) for n in LAGS]
        self.errors = measured - at_once
        self.forces = [base.unit(c) not in ("rad", "m") for c in dataset.outputs]
        self.columns, self.others = changed(early), [changed(f) for f in (*far.values(), *late, *lagging)]
        self.alike = [self.others[TIMES.index(times)] for times in ALIKE]
        self.miss, self.longer = early - way, far[LONGER] - way

    def seen(self, moving, passes, others=()):
        """Samples at which what friction builds up over the model's own travel would be taken for an effect.

        Smoothed speeds follow it: an encoder's steps go to and fro in slow motion.
        """
        return building_up(self.miss, self.longer, moving, passes, self.time, self.errors, self.columns, others,
                           self.alike)


def _settled(dataset, base, parameters, moving, measured, predicted):
    """Parameters with the free ones where they leave least of some samples: straight steps, within bounds."""
    free = [n for n in dataset.parameters.free(base) if n in parameters]
    some = np.flatnonzero(moving)
    some = some[::max(len(some) // ENOUGH, 1)]
    if not free or len(some) <= len(free):
        return parameters
    values = np.array([parameters[n] for n in free])
    least, most, usual = np.array([[v.min if v.unit == "1" or v.min == 0 else -np.inf,
                                    v.max if v.unit == "1" else np.inf, v.nominal]  # no sizes are known yet
                                   for v in (base.parameters[n] for n in free)]).T

    def at(x):
        return predicted({**parameters, **dict(zip(free, map(float, x)))})[:, some]

    for _ in range(STEPS):
        here = at(values)
        left = measured[:, some] - here
        scale = np.maximum(np.median(np.abs(left), axis=1, keepdims=True), 1e-300)
        probe = PROBE * np.maximum(np.maximum(np.abs(values), usual), 1e-9) * np.where(values < most, 1, -1)
        rows = np.array([((at(values + h * (np.arange(len(free)) == k)) - here) / scale).ravel()
                         for k, h in enumerate(probe)]).T
        if not (np.isfinite(rows).all() and np.isfinite(left).all()):
            break
        room = np.sort([(least - values) / probe, (most - values) / probe], axis=0)
        step = lsq_linear(rows, (left / scale).ravel(), (np.minimum(room[0], 0) - 1e-9, np.maximum(room[1], 0) + 1e-9))
        values = np.clip(values + step.x * probe, least, most)
    return {**parameters, **dict(zip(free, map(float, values)))}


def _mended(dataset, values):
    """A measured torque without its outliers, log by log: one of them in a turn would hide what is usual there."""
    return np.concatenate([mended(values[dataset.run == k], starts(log)) for k, log in enumerate(dataset.logs)])


def built_up(dataset, model, parameters, times=1.0):
    """How far the friction of each segment has been built up over the model's own travel.

    Parameters
    ----------
    dataset : Dataset
        Its signals are known.
    model : Model
        Of its rig.
    parameters : dict of str to float
        Of the model, `travel` [rad] or [m] among them.
    times : float
        That travel, over the one of the parameters.

    Returns
    -------
    ndarray, shape (segments, n)
        From -1, sliding backwards, to 1.
    """
    names, question = [f"{c}.z" for c in model.segments], dataset.ask(model)
    rates = {n: v for n, v in dataset.signals.items() if n.startswith("der(")}
    longer = {n: v * times if n.endswith(".travel") else v for n, v in parameters.items()}
    states = propagate(question, rates, dataset.time, longer, dataset.run, only=names)[0]
    return states[[question.states.index(n) for n in names]]


def giving(dataset, parameters):
    """Moving samples at which friction still builds up over the model's own travel.

    Parameters
    ----------
    dataset : Dataset
        Its signals and its moving samples are known.
    parameters : dict of str to float
        Of the base model, `travel` [rad] or [m] among them.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    miss = built_up(dataset, dataset.base, parameters) - np.sign(dataset.speeds)
    return dataset.moving & np.any(np.abs(miss) > BUILT_UP, axis=0)


def without_ends(dataset, moving, passes, angles):
    """Leave out the ends of a pass that smoothing makes look like motion: less than two encoder steps from rest.

    Parameters
    ----------
    dataset : Dataset
        Its logs and their times are known.
    moving : ndarray of bool, shape (n,)
        Samples in which every segment is faster than the least speed.
    passes : ndarray of int, shape (n,)
        -1 where nothing moves.
    angles : list of ndarray, shape (n,)
        As recorded [rad], positions [m].

    Returns
    -------
    ndarray of bool, shape (n,)
        True where `moving` is, but for those ends.
    """
    moving = moving.copy()
    least = {(run, k): 1.5 * resolution(angle[there], dataset.time[there]) + 1e-9 * np.ptp(angle)
             for run in np.unique(dataset.run) for k, angle in enumerate(angles) for there in [dataset.run == run]}
    for pass_number in np.unique(passes[passes >= 0]):
        inside = np.flatnonzero(passes == pass_number)
        first, last = max(inside[0] - 3, 0), min(inside[-1] + 3, len(dataset.time) - 1)
        for k, angle in enumerate(angles):
            near = least[dataset.run[inside[0]], k]
            moving[inside[np.abs(angle[inside] - angle[first]) < near]] = False
            moving[inside[np.abs(angle[inside] - angle[last]) < near]] = False
    return moving

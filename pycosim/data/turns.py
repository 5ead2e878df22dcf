"""A log's samples after each turn in; which of them the model's own elastic displacement explains, out.

A segment gives by its `travel` before it slides. The models that are fitted take friction as that of sliding at once,
which is right where the machine is stiffer than that, or the log too coarse to show it. What a longer travel, a delay
or a filter does after a turn looks otherwise, and is for the diagnosis to find.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from ..dynamics.states import propagate
from .derivatives import resolution
from .noise import contiguous

BUILT_UP = 0.02  # of a segment's friction, that may still have to build up where it counts as sliding
LONGER = 5.0  # times the model's own travel, within which a turn is looked at
AFTER = 10  # samples of a pass beyond that, which tell what it would have been
EXPLAINED = 0.95
"""Of what is off after turns, that the model's own travel has to explain to be what is at work. Where it is, 99 % are
explained; a hidden presliding leaves 10 to 25 %, a delay or a filter 25 to 75 %."""
SEEN = 2.0  # times the squared noise, from which something is off at all


def building_up(miss, longer, moving, passes, time, errors, columns):
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

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    own = moving & np.any(np.abs(miss) > BUILT_UP, axis=0)
    near = moving & np.any(np.abs(longer) > BUILT_UP, axis=0)
    off, noise, at = [], [], []
    for s in contiguous(time, passes):
        index = np.arange(s.start, s.stop)
        beyond = np.flatnonzero(~near[s])[:AFTER]
        if passes[s.start] < 0 or len(beyond) < AFTER:
            continue
        usual = errors[:, index[beyond]]
        some = index[:beyond[0]][near[index[:beyond[0]]]]
        at.append(some)
        off.append(errors[:, some] - usual.mean(axis=1, keepdims=True))
        noise.append(np.tile(np.var(np.diff(usual, axis=1), axis=1)[:, None] / 2 * (1 + 1 / AFTER), (1, len(some))))
    if not at or not own[np.concatenate(at)].any():
        return np.zeros(len(time), dtype=bool)
    off, noise, at = np.hstack(off), np.hstack(noise), np.concatenate(at)
    weight = 1 / np.sqrt(np.maximum(np.median(noise, axis=1, keepdims=True), 1e-300))
    left = nnls((columns[:, :, at] * weight).reshape(len(columns), -1).T, (off * weight).ravel())[1] ** 2
    total, usual = np.sum((off * weight) ** 2), np.sum(noise * weight**2)
    if total < SEEN * usual or left - usual > (1 - EXPLAINED) * (total - usual):
        return np.zeros(len(time), dtype=bool)
    return own


def of_travel(dataset, parameters, moving):
    """Samples at which what friction builds up over the model's own travel would be taken for an effect.

    Smoothed speeds follow it: an encoder's steps go to and fro in slow motion.

    Parameters
    ----------
    dataset : Dataset
        Its speeds and passes are known.
    parameters : dict of str to float
        Of the base model, `travel` [rad] or [m] among them.
    moving : ndarray of bool, shape (n,)
        Samples in which every segment is faster than the least speed.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    base, question = dataset.base, dataset.question
    if dataset.averaged or not base.segments:
        return np.zeros(len(dataset.time), dtype=bool)
    at, way = [question.states.index(f"{c}.z") for c in base.segments], np.sign(dataset.speeds)
    sliding = np.zeros((len(question.states), len(dataset.time)))
    sliding[at] = way

    def predicted(states):
        return np.array(list(dataset.segment_signals(base, parameters, dataset.outputs, states).values()))

    early, at_once, columns = built_up(dataset, parameters), predicted(sliding), []
    for k, row in enumerate(at):
        states = sliding.copy()
        states[row] = early[k]
        columns.append(predicted(states) - at_once)
    errors = np.array([dataset.reference(c) for c in dataset.outputs]) - at_once
    return building_up(early - way, built_up(dataset, parameters, LONGER) - way, moving, dataset.passes, dataset.time,
                       errors, np.array(columns))


def built_up(dataset, parameters, times=1.0):
    """How far the friction of each segment has been built up over the model's own travel.

    Parameters
    ----------
    dataset : Dataset
        Its question and signals are known.
    parameters : dict of str to float
        Of the base model, `travel` [rad] or [m] among them.
    times : float
        That travel, over the one of the parameters.

    Returns
    -------
    ndarray, shape (segments, n)
        From -1, sliding backwards, to 1.
    """
    names = [f"{c}.z" for c in dataset.base.segments]
    rates = {n: v for n, v in dataset.signals.items() if n.startswith("der(")}
    longer = {n: v * times if n.endswith(".travel") else v for n, v in parameters.items()}
    states = propagate(dataset.question, rates, dataset.time, longer, dataset.run, only=names)[0]
    return states[[dataset.question.states.index(n) for n in names]]


def without_ends(dataset, moving, angles):
    """Leave out the ends of a pass that smoothing makes look like motion: less than two encoder steps from rest.

    Parameters
    ----------
    dataset : Dataset
        Its passes are known.
    moving : ndarray of bool, shape (n,)
        Samples in which every segment is faster than the least speed.
    angles : list of ndarray, shape (n,)
        As recorded [rad], positions [m].

    Returns
    -------
    ndarray of bool, shape (n,)
        True where `moving` is, but for those ends.
    """
    moving = moving.copy()
    least = {(run, k): 1.5 * resolution(angle[dataset.run == run]) + 1e-9 * np.ptp(angle)
             for run in np.unique(dataset.run) for k, angle in enumerate(angles)}
    for pass_number in np.unique(dataset.passes[dataset.passes >= 0]):
        inside = np.flatnonzero(dataset.passes == pass_number)
        first, last = max(inside[0] - 3, 0), min(inside[-1] + 3, len(dataset.time) - 1)
        for k, angle in enumerate(angles):
            near = least[dataset.run[inside[0]], k]
            moving[inside[np.abs(angle[inside] - angle[first]) < near]] = False
            moving[inside[np.abs(angle[inside] - angle[last]) < near]] = False
    return moving

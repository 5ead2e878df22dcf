"""Measured torques and the motion in; what the motion alone predicts of them, without their noise, out.

A torque recorded late, or through a filter, is moved by its prediction: the slope of the record itself is mostly noise.
"""

from __future__ import annotations

import itertools

import numpy as np

from ..dynamics.delays import between
from ..dynamics.filters import first_order
from .noise import contiguous

SMOOTH = 5  # degree of the polynomial of the configuration that the torque of a load is predicted by
_FEW = 20  # samples of a pass or a direction, of which nothing is predicted
JUMP = 0.1  # s from the ends of a pass, in which a torque recorded late may jump


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
    span = np.maximum(np.ptp(dataset.config, axis=1, keepdims=True), 1e-9)
    x = 2 * (dataset.config - dataset.config.min(1, keepdims=True)) / span - 1
    rates = [v for n, v in dataset.signals.items() if n.startswith("der(") and np.ptp(v) > 0]
    powers = {degree: np.array([np.prod(x ** np.array(e)[:, None], axis=0) for e in itertools.product(
        range(degree + 1), repeat=len(x)) if sum(e) <= degree]) for degree in (1, 2, 3)}
    rates = np.array([r / np.std(r) for r in rates]).reshape(len(rates), -1)
    code = (np.sign(dataset.speeds) > 0).T @ (1 << np.arange(len(dataset.speeds))) + (
        dataset.run << len(dataset.speeds) if dataset.paired else 0)
    found = values.copy()
    for where in (dataset.moving & (code == c) for c in np.unique(code[dataset.moving])):
        told = where & trusted if np.count_nonzero(where & trusted) > _FEW else where
        degree = 3 if told.sum() > 1000 else 2 if told.sum() > 200 else 1
        rows = np.vstack([powers[degree], rates if degree == 3 else rates[:0]])
        a = rows[:, told]
        found[where] = np.linalg.lstsq(a @ a.T, a @ values[told], rcond=1e-10)[0] @ rows[:, where]
    for s in () if dataset.paired else contiguous(dataset.time, dataset.passes):
        told = np.flatnonzero(trusted[s]) + s.start
        if dataset.passes[s.start] >= 0 and len(told) > _FEW:
            a = np.array([np.ones(len(told)), found[told]])
            level, share = np.linalg.lstsq(a.T, values[told], rcond=1e-6)[0]
            found[s] = level + share * found[s]
    return found


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
    smooth = dataset.memo(("torques.settled", name),
                          lambda: _settled(dataset, dataset.signals.get(name, 0.0 * dataset.time)))
    (filtered,), (by_lag,) = first_order(smooth[None], lag, dataset.time, dataset.run)
    return smooth - filtered, -by_lag


def _settled(dataset, values):
    """What the motion predicts of a torque from samples at which a filter has caught up, between turns.

    A sample below the least speed that goes the way of its neighbour is as that.
    """
    starts = np.append(True, (np.diff(dataset.passes) != 0) | (np.diff(dataset.run) != 0))
    start = np.maximum.accumulate(np.where(starts, np.arange(len(values)), 0))
    found = predicted(dataset, values, dataset.moving & (dataset.time - dataset.time[start] > JUMP))
    way = np.sign(dataset.speeds)
    turns = np.flatnonzero(np.any(np.diff(way, axis=1) != 0, axis=0) | (np.diff(dataset.run) != 0)) + 1
    for part in np.split(np.arange(len(values)), turns):
        moving = part[dataset.moving[part]]
        if moving.size:
            found[part[0]:moving[0]], found[moving[-1] + 1:part[-1] + 1] = found[moving[0]], found[moving[-1]]
    return found


def slope(dataset, name):
    """Slope of what the motion alone predicts of a signal, well inside the passes.

    It is zero near their ends, where a torque recorded late jumps, and tells of that jump and of no slope.

    Parameters
    ----------
    dataset : Dataset
        Arranged: its passes and moving samples are known.
    name : str
        Of the signal; zero everywhere for one that is not measured.

    Returns
    -------
    ndarray, shape (n,)
        In the signal's unit a second.
    """
    def make():
        found, values = np.zeros(len(dataset.time)), dataset.exogenous().get(name, np.zeros(len(dataset.time)))
        for s, reach, inside in _passes(dataset):
            ahead, behind = (np.interp(dataset.time[s] + sign * reach, dataset.time[s], values[s]) for sign in (1, -1))
            found[s] = np.where(inside, ahead - behind, 0.0) / max(2 * reach, 1e-300)
        return found
    return dataset.memo(("torques.slope", name), make)


def calm(dataset, name, delay, moved):
    """A measured torque whose noise stays where it is, while what the motion predicts of it is moved by a delay.

    The prediction is made of the record as moved: as recorded, a late torque belongs to no motion where that changes.

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
    inside = dataset.memo("torques.inside", lambda: _inside(dataset))
    found = np.where(inside, predicted(dataset, moved, dataset.moving & inside), np.nan)
    return dataset.signals[name] + found - between(dataset.time, found, dataset.run, -delay)


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
            reach = min(JUMP, 0.2 * (time[-1] - time[0]))
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
        rates = [v for n, v in dataset.signals.items() if n.startswith("der(")]
        for part in (np.flatnonzero(dataset.run == k) for k in np.unique(dataset.run)):
            x = dataset.config[:, part]
            x = 2 * (x - x.min(1, keepdims=True)) / np.maximum(np.ptp(x, axis=1, keepdims=True), 1e-9) - 1
            own = [v[part] / max(np.std(v[part]), 1e-300) for v in rates]
            rows = [np.prod(x ** np.array(e)[:, None], axis=0)
                    for e in itertools.product(range(SMOOTH + 1), repeat=len(x)) if sum(e) <= SMOOTH]
            rows = np.array([*rows, *own, *(a * b for a, b in itertools.combinations_with_replacement(own, 2))])
            found[part] = np.linalg.lstsq(rows @ rows.T, rows @ found[part], rcond=1e-10)[0] @ rows
        return found

    return dataset.memo(("torques.of_load", channel), make)

"""Measured signals and a model in; the noise of each sample, and what it leaves in the errors of that model, out."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
from scipy.ndimage import median_filter
from scipy.special import ndtri

from ..compile import ArrayFunction

COARSE, FAR = 4, 2.5  # steps that a usual magnitude is coarse below; deviations beyond which one counts as that far
WITHIN = 0.7939  # mean of the magnitude of a normal variable, of which none counts as more than 2.5
NEAR, POINTS = 3.0, 9
"""Times its noise, that a load is about nothing below; and points at which noise is tried there."""
AROUND, OUT = 7, 6.0  # samples whose median one is compared with, and scatters that it must be off to be out of line


def weights(dataset):
    """Weight of each channel in a fit: one over its noise, the same for every model of a data set.

    Parameters
    ----------
    dataset : Dataset
        Its logs are measured; the noise of each signal is read off them.

    Returns
    -------
    ndarray, shape (channels,)
        Their geometric mean is one.
    """
    def make():
        values = {n: v.value for n, v in dataset.parameters.variables(dataset.base).items()}
        level = np.median(noise_level(dataset, dataset.base, values), axis=1)
        return np.exp(np.mean(np.log(level))) / level
    return dataset.memo("scatter.weights", make)


def noise_level(dataset, model, parameters, part="fit"):
    """Noise that each sample of each channel should show, from the scatter of the signals and the model's response.

    A model that responds less to a noisy torque leaves less noise in its residual without being a better model;
    rivals are compared after dividing by this level. A sample far out from those around it has noise of that size.

    Parameters
    ----------
    dataset : Dataset
        Its logs are measured; the noise of each signal is read off them.
    model : Model
        With whatever effects are attached.
    parameters : dict of str to float
        All of the model's.
    part : str or ndarray of int
        As for `Dataset.choose`.

    Returns
    -------
    ndarray, shape (channels, n)
        Standard deviations in the channels' units; one where the signals show no scatter.
    """
    view, picks = dataset.view(part), dataset.picks(part)
    total = np.zeros((len(dataset.outputs), len(picks[0][1])))
    noisy = [k for k in dataset.known if k in dataset.signals and not k.endswith(".w")]
    for name, square in _squares(dataset, model, parameters, noisy, part).items():
        spread = _noisy(dataset, name) if not name.endswith(".phi") else dataset.steps[name] / math.sqrt(12)
        total += sum(take(square * spread ** 2) * weight ** 2 for weight, _, take in picks)
    if not dataset.paired:
        total += np.array([_noisy(dataset, c)[view] ** 2 for c in dataset.outputs])
    return np.sqrt(np.where(total > 0, total, 1.0))


def _squares(dataset, model, parameters, names, part):
    """Mean squares of the channels' responses to signals, over what noise makes of a load that is about nothing.

    Where a load is less than a few times its noise, now one branch of friction answers and now the other, whatever the
    motion alone would say: for two rivals whose loads pass zero at different times, too.
    """
    found = {n: r ** 2 for n, r in responses(dataset, model, parameters, names).items()}
    shaken = [n for n in found if not n.endswith(".phi") and scatter(dataset, n) > 0.0]
    load, noise = _carried(dataset, model, parameters, part)
    near = np.flatnonzero((np.abs(load) < NEAR * noise).any(0))
    if not shaken or not near.size:
        return found
    # points of a lattice, so that few of them fill the space of a few signals
    order = np.arange(POINTS)[:, None] * np.array([(1, 2, 4, 5)[k % 4] for k in range(len(shaken))]) % POINTS
    total = dict.fromkeys(found, 0.0)
    for point in ndtri((order + 0.5) / POINTS):
        shift = {n: z * scatter(dataset, n) for n, z in zip(shaken, point)}
        for name, response in responses(dataset, model, parameters, list(found), near, shift).items():
            total[name] = total[name] + response ** 2 / POINTS
    for name, square in total.items():
        found[name][:, near] = square
    return found


def _carried(dataset, model, parameters, part):
    """Load of each segment at each sample, positive where the segment drives it, and its noise, one a segment."""
    ends = [f"{c}.L" for c in dataset.base.segments]
    names = ends + [f"{c}.w" for c in dataset.base.segments]
    known = dataset.segment_signals(model, parameters, names, None, dataset.exogenous())
    noisy = dataset.segment_signals(model, parameters, ends)
    carried = [c for c in dataset.base.segments if f"{c}.L" in known]
    if not carried:
        return np.zeros((0, len(dataset.time))), np.zeros((0, 1))
    load = np.array([known[f"{c}.L"] * np.sign(known[f"{c}.w"]) for c in carried])
    off = np.abs([noisy[f"{c}.L"] - known[f"{c}.L"] for c in carried])
    off = np.concatenate([take(off) for _, _, take in dataset.picks(part)], axis=1)
    return load, 1.4826 * np.median(off, axis=1, keepdims=True)


def responses(dataset, model, parameters, names, rows=None, shift=None):
    """Derivatives of the channels by signals that the model is given, sample by sample.

    Parameters
    ----------
    dataset : Dataset
        Its logs are measured; the noise of each signal is read off them.
    model : Model
        Of the study's rig, with whatever effects are attached.
    parameters : dict of str to float
        All of the model's, SI units.
    names : list of str
        Signals; those that the channels do not depend on are left out.
    rows : ndarray of int, shape (n,), optional
        Samples; all by default.
    shift : dict of str to float, optional
        By signal, what is added to it, in its unit.

    Returns
    -------
    dict of str to ndarray, shape (channels, n)
    """
    question, size = dataset.ask(model), len(dataset.time if rows is None else rows)
    rows_of, slopes = question.memo(("scatter.slopes", *names),
                                    lambda: _slopes(question.select(dataset.outputs), names))
    signals, (states, _) = dataset.undelayed(question, parameters, dataset.exogenous()), dataset.states(
        model, parameters)
    moved = [signals.get(n, 0.0) + (shift or {}).get(n, 0.0) for n in question.inputs]
    given = [v if rows is None or np.ndim(v) == 0 else v[rows] for v in [*moved, *states]]
    arguments = given + [float(parameters[n]) for n in question.parameters]
    every = slopes(arguments, size)
    return {n: every[own] for n, own in rows_of.items()}


def _slopes(question, names):
    """Derivatives of all outputs by those of some inputs that they depend on, over arrays; and the rows of each."""
    u, x, p = question.symbols()
    y = question.output(u, x, p)
    found = {n: ca.jacobian(y, u[question.inputs.index(n)]) for n in names if n in question.inputs}
    found, count = {n: ca.densify(s) for n, s in found.items() if s.nnz()}, y.numel()
    rows = {n: slice(k * count, (k + 1) * count) for k, n in enumerate(found)}
    every = ca.cse(ca.vertcat(*found.values(), ca.SX(0, 1)))
    return rows, ArrayFunction(ca.Function("slopes", [u, x, p], [every]))


def scatter(dataset, name):
    """Standard deviation of what changes from sample to sample, within passes, rounding counted.

    Parameters
    ----------
    dataset : Dataset
        Its logs are measured; the noise of each signal is read off them.
    name : str
        A measured signal.

    Returns
    -------
    float
        In the unit of the signal.
    """
    def make():
        third = np.diff(dataset.reference(name), 3)
        inside = (dataset.passes[3:] >= 0) & (dataset.passes[3:] == dataset.passes[:-3])
        quantum = dataset.steps.get(name, 0.0)
        found = spread(np.abs(third[inside]), quantum) / math.sqrt(20) if inside.any() else 0.0
        return max(found, quantum / math.sqrt(12))
    return dataset.memo(("scatter.scatter", name), make)


def spread(sizes, quantum):
    """Standard deviation of a normal noise whose magnitudes lie on a lattice; a part of them may be outliers.

    The plain median is one of the levels: a noise of 0.55 steps was found as 0.66, and one of 0.71 as well. It is taken
    as if each magnitude were spread evenly over its step; where that is not small beside them, the mean of what is not
    far out says more.

    Parameters
    ----------
    sizes : ndarray, shape (n,)
        None is negative, and there is one at least.
    quantum : float
        The step; 0.0 where there is none.

    Returns
    -------
    float
        In the unit of the sizes. A noise below half a step is found up to a tenth too small.

    Examples
    --------
    >>> round(spread(np.array([0.0, 1.0, 1.0, 2.0]), 0.0), 4)
    1.4826
    """
    if quantum <= 0.0:
        return 1.4826 * float(np.median(sizes))
    levels = sizes / quantum
    middle = np.round(np.quantile(levels, 0.5, method="lower"))
    low, high = max(middle - 0.5, 0.0), middle + 0.5
    below, here = np.mean(levels < low), np.mean((levels >= low) & (levels < high))
    found = 1.4826 * (low + (0.5 - below) / here * (high - low))
    if middle < COARSE:
        found = np.mean(np.minimum(levels, FAR * found)) / WITHIN
    return float(quantum * found)


def _noisy(dataset, name):
    """Standard deviation of the noise of each sample of a measured signal: its scatter, and how far it is out."""
    def make():
        values, usual = dataset.reference(name), scatter(dataset, name)
        away = values - np.concatenate([median_filter(values[dataset.run == k], AROUND, mode="nearest")
                                        for k in dict.fromkeys(dataset.run)])
        return np.hypot(usual, np.where(np.abs(away) > OUT * usual, away, 0.0))
    return dataset.memo(("scatter.noisy", name), make)

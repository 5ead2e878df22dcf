"""What was recorded in; the steps it was rounded to, and what that rounding can leave in a residual, out.

A rounded signal is off by a sawtooth of itself: the same in every pass, smooth over many samples where it is slow, and
so no noise that averaging over repeats takes away. What it can do to a test is therefore simulated: the same motion is
rounded again, with the instrument's zero anywhere within a step.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from .motion import speed_beside
from .scatter import responses, scatter

DITHERED = 0.5
"""Noise, in steps, from which rounding is noise like any other: the error of a quantiser dithered by Gaussian noise of
half a step is white within 1 % (Widrow and Kollar, Quantization Noise, 2008, ch. 5)."""
OWN = 1 / 6
"""Variance, in squared steps, that rounding itself may show from sample to sample: 1/12 where it is white, up to twice
that in even motion. What is taken for noise before the rounding would blur its pattern."""
AGREED = 0.6
"""Length of the mean phase of the levels on their lattice: 1 on an exact one, 0.64 where few digits round it by half a
step once more, 0 on none."""
CALM = 1 / 3
"""Part of the bandwidth in which a motion is told from its noise: that of an acceleration grows in variance with
the fifth power of the bandwidth, so that 0.4 % of it is left."""
HIDDEN = 1.2
"""Steps of the last digit: an instrument that is not coarser than this leaves the same lattice as digits alone."""
FEWEST = 8  # different values that a column must take for its lattice to be seen


def step(values):
    """Step of the lattice that a signal was recorded on.

    Parameters
    ----------
    values : ndarray, shape (n,)
        One signal of all logs, in its unit.

    Returns
    -------
    float
        In the unit of the values; 0.0 where the values lie on no lattice that is coarser than their digits.

    Examples
    --------
    >>> angle = np.sin(np.linspace(0, 10, 2001))
    >>> float(round(step(np.round(angle / 1e-3) * 1e-3), 9))
    0.001
    """
    span = float(np.ptp(values)) if len(values) else 0.0
    if not np.isfinite(span) or span <= 0.0:
        return 0.0
    levels = np.unique(values)
    apart = np.diff(levels)
    apart = apart[apart > 1e-9 * span]
    if len(apart) < FEWEST:
        return float(apart.min()) if len(apart) and len(values) > 50 * len(apart) else 0.0
    starts = {float(apart[apart < reach * apart.min()].mean()) for reach in (1.6, 2.6)}
    found = [_lattice(levels, start) for start in starts]
    return max((s for s, agreed in found if agreed > AGREED and span / s < 1e7), default=0.0)


def _lattice(levels, start):
    """Spacing of a lattice near a first guess, and how far the levels agree with it (1: exactly, 0: not at all)."""
    reach, agreed, least = 30.0 * start, 0.0, start
    crowd = np.searchsorted(levels, levels + reach) - np.searchsorted(levels, levels - reach)
    centre = levels[int(np.argmax(crowd))]
    while True:
        some = levels[np.abs(levels - centre) <= reach]
        tried = least * (1 + np.linspace(-0.6, 0.6, 49) * start / reach * (6.0 if agreed == 0.0 else 1.0))
        sure = np.abs(np.exp(2j * np.pi * (some - centre) / tried[:, None]).mean(1))
        least, agreed = float(tried[np.argmax(sure)]), float(sure.max())
        if reach >= levels[-1] - levels[0] or agreed < AGREED:
            return least, agreed
        reach *= 4.0


def rounded(values, quantum, dither, rng):
    """Error of a signal that is rounded by an instrument whose zero lies anywhere within a step.

    Parameters
    ----------
    values : ndarray, shape (n,)
        The signal before it was rounded.
    quantum : float
        The step, in the unit of the values.
    dither : float
        Standard deviation of the noise before the rounding.
    rng : numpy.random.Generator
        Draws the instrument's zero, and the noise before the rounding.

    Returns
    -------
    ndarray, shape (n,)
        Rounded minus true, in the unit of the values.

    References
    ----------
    .. [1] Widrow, B. and Kollar, I. (2008). Quantization Noise. Cambridge University Press.
    """
    true = values + quantum * rng.uniform()
    if dither > 0.0:
        true = true + dither * rng.standard_normal(len(values))
    read = true
    if abs(np.log10(quantum) - np.round(np.log10(quantum))) < 1e-6:  # digits, behind which there may be an instrument
        hidden = HIDDEN * quantum
        zero = hidden * rng.uniform()
        read = np.round((true + zero) / hidden) * hidden - zero
    return np.round(read / quantum) * quantum - true


def rounding(dataset, model, fit, part="fit"):
    """What rounding alone may leave in the residual of a fitted model, as a function that draws it.

    Parameters
    ----------
    dataset : Dataset
        Its measured signals are looked at for steps.
    model : Model
        That was fitted.
    fit : Fit
        Its parameters say how the model passes errors of its inputs on.
    part : str or ndarray of int
        As for `Dataset.choose`.

    Returns
    -------
    callable or None
        Takes a random generator, gives an ndarray of shape (channels, n), in the channels' units; None where no
        column's step exceeds its noise.
    """
    rows = [*_of_outputs(dataset, model, fit), *_of_inputs(dataset, model, fit), *_of_motion(dataset, model, fit)]
    if not rows:
        return None
    picks = dataset.picks(part)

    def draw(rng):
        total = 0.0
        for signals, left in rows:
            error = left(*(rounded(*signal, rng) for signal in signals))
            total = total + sum(weight * take(error) for weight, _, take in picks)
        return total
    return draw


def _coarse(dataset, names):
    """Signals whose steps are no noise among other noise: with the step and the noise before the rounding."""
    for name in names:
        quantum = dataset.steps.get(name, 0.0)
        dither = float(np.sqrt(max(scatter(dataset, name) ** 2 - OWN * quantum ** 2, 0.0))) if quantum > 0 else np.inf
        if dither < DITHERED * quantum:
            yield name, quantum, dither


def _of_outputs(dataset, model, fit):
    """Rounding of the measured channels: a reading that is too large leaves a residual that is too large."""
    coarse = [] if dataset.paired else list(_coarse(dataset, dataset.outputs))
    predicted = dataset.predicted(model, fit.parameters) if coarse else {}
    for name, *found in coarse:
        yield [(predicted[name], *found)], partial(np.multiply, np.equal(dataset.outputs, name)[:, None] * 1.0)


def _of_inputs(dataset, model, fit):
    """Rounding of what the model is given and is no motion, through what the model makes of it."""
    given = [n for n in dataset.signals if n in dataset.measured and f"der({n})" not in dataset.signals]
    coarse = {n: found for n, *found in _coarse(dataset, given)}
    for name, response in responses(dataset, model, fit.parameters, list(coarse)).items():
        yield [(dataset.exogenous()[name], *coarse[name])], partial(np.multiply, -response)


def _of_motion(dataset, model, fit):
    """Rounding of angles and of speeds beside them, which is also in the speeds and accelerations derived from both."""
    for angle in dataset.motion.followed:
        speed, names = speed_beside(angle), [angle, f"der({angle})", f"der(der({angle}))"]
        coarse = {n: found for n, *found in _coarse(dataset, [n for n in (angle, speed) if n in dataset.measured])}
        slopes = responses(dataset, model, fit.parameters, names) if coarse else {}
        if not slopes:
            continue
        derived, true = dataset.motion.passed_on(angle), dataset.motion.calm(angle, CALM)
        yield [(true[names[n != angle]], *found) for n, found in coarse.items()], partial(
            _left_by_motion, slopes, derived, angle, list(coarse))


def _left_by_motion(responses, derived, angle, names, *errors):
    """What errors of an angle, or of the speed beside it, or of both leave in the channels."""
    given = dict(zip(names, errors))
    none = np.zeros_like(errors[0])
    found = derived(given.get(angle, none), given.get(speed_beside(angle), none))
    found[angle] = given.get(angle, none)
    return -sum(response * found[name] for name, response in responses.items())

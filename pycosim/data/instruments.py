"""What was recorded in; the steps it was rounded to, and what that rounding can leave in a residual, out.

A rounded signal is off by a sawtooth of itself: the same in every pass, smooth over many samples where it is slow, and
so no noise that averaging over repeats takes away. What it can do to a test is therefore simulated: the same motion is
rounded again, with the instrument's zero anywhere within a step.
"""

from __future__ import annotations

import numpy as np

DITHERED = 0.5
"""Noise, in steps, from which rounding is noise like any other: the error of a quantiser dithered by Gaussian noise of
half a step is white within 1 % (Widrow and Kollar, Quantization Noise, 2008, ch. 5)."""
FEWEST = 8  # different values that a column must take for its lattice to be seen


def step(values):
    """Step of the lattice that a signal was recorded on.

    Parameters
    ----------
    values : ndarray, shape (n,)

    Returns
    -------
    float
        In the unit of the values; 0.0 where the values lie on no lattice that is coarser than their digits.
    """
    span = float(np.ptp(values)) if len(values) else 0.0
    if not np.isfinite(span) or span <= 0.0:
        return 0.0
    levels = np.unique(values)
    apart = np.diff(levels)
    apart = apart[apart > 1e-9 * span]
    if len(apart) < FEWEST:
        return float(apart.min()) if len(apart) and len(values) > 50 * len(apart) else 0.0
    least = float(np.median(apart[apart < 1.5 * apart.min()]))
    for _ in range(2):  # a lattice's step is known the better the longer the way that it is counted over
        counts = np.round(np.cumsum(apart) / least)
        least = float(np.cumsum(apart) @ counts / (counts @ counts))
    off = np.abs(apart / least - np.round(apart / least))
    return least if np.mean(off < 0.05) > 0.98 and span / least < 1e7 else 0.0


def smooth(time, values, run):
    """A rounded signal between the moments at which it changes, where it is known best.

    Parameters
    ----------
    time, values, run : ndarray, shape (n,)

    Returns
    -------
    ndarray, shape (n,)
        The values themselves where a run holds fewer than two changes.
    """
    found = np.array(values, dtype=float)
    for k in np.unique(run):
        part = np.flatnonzero(run == k)
        t, v = time[part], values[part]
        moved = np.flatnonzero(np.diff(v))
        if len(moved) > 1:
            found[part] = np.interp(t, (t[moved] + t[moved + 1]) / 2, (v[moved] + v[moved + 1]) / 2)
    return found


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

    Returns
    -------
    ndarray, shape (n,)
        Rounded minus true, in the unit of the values.
    """
    true = values + quantum * rng.uniform()
    if dither > 0.0:
        true = true + dither * rng.standard_normal(len(values))
    return np.round(true / quantum) * quantum - true


def rounding(dataset, model, fit, part="fit"):
    """What rounding alone may leave in the residual of a fitted model, as a function that draws it.

    Parameters
    ----------
    dataset : Dataset
    model : Model
    fit : Fit
    part : str or ndarray of int
        As for `Dataset.choose`.

    Returns
    -------
    callable or None
        Takes a random generator, gives an ndarray of shape (channels, n), in the channels' units; None where no
        column's step exceeds its noise.
    """
    rows = [*_of_outputs(dataset, model, fit), *_of_inputs(dataset, model, fit)]
    if not rows:
        return None
    picks = dataset.picks(part)

    def draw(rng):
        total = 0.0
        for values, quantum, dither, response in rows:
            error = response * rounded(values, quantum, dither, rng)
            total = total + sum(weight * take(error) for weight, _, take in picks)
        return total
    return draw


def _coarse(dataset, names):
    """Signals whose steps are no noise among other noise: with the step and the noise before the rounding."""
    for name in names:
        quantum = dataset.steps.get(name, 0.0)
        dither = float(np.sqrt(max(dataset.scatter(name) ** 2 - quantum ** 2 / 12, 0.0))) if quantum > 0 else np.inf
        if dither < DITHERED * quantum:
            yield name, quantum, dither


def _of_outputs(dataset, model, fit):
    """Rounding of the measured channels: a reading that is too large leaves a residual that is too large."""
    coarse = [] if dataset.paired else list(_coarse(dataset, dataset.outputs))
    predicted = dataset.predicted(model, fit.parameters) if coarse else {}
    for name, quantum, dither in coarse:
        yield predicted[name], quantum, dither, np.equal(dataset.outputs, name)[:, None].astype(float)


def _of_inputs(dataset, model, fit):
    """Rounding of what the model is given, through what the model makes of it."""
    coarse = {n: found for n, *found in _coarse(dataset, [n for n in dataset.signals if n in dataset.measured])}
    for name, response in dataset.responses(model, fit.parameters, list(coarse)).items():
        values = (smooth(dataset.time, dataset.signals[name], dataset.run) if name.endswith(".phi")
                  else dataset.exogenous()[name])
        yield values, *coarse[name], -response

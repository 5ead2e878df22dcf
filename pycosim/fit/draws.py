"""A fit in, parameter sets that its data allow out: arrays for simulators that run many machines side by side.

Over what the data determine, the draws are normal with the fit's covariance. Along null directions the data say
nothing: bounded draws are spread evenly there, as far as the bounds allow; unbounded ones stay at the estimate.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtr, ndtri

from ..core.errors import UnknownNameError, closest
from ..core.given import shortened

_TRIES = 30  # batches of unbounded draws of which those within the bounds are taken
_SWEEPS = 60  # of Gibbs' sampler; in whitened coordinates a few are enough but in narrow corners
_LEAST = 1e-14  # eigenvalue of the scaled covariance, relative, below which it is rounding: a null direction's


@dataclass(frozen=True)
class Draws:
    """Parameter sets.

    Attributes
    ----------
    names : list of str
        Free parameters.
    values : ndarray, shape (n, p)
        One set a row, SI units.
    fixed : dict of str to float
        The other parameters of the model.
    outside : dict of str to float
        Share of the unbounded draws that lay beyond each parameter's bounds; without those that never did.
    any_outside : float
        Share of the unbounded draws that lay beyond some bound.
    moved : dict of str to tuple of float
        What the bounds made of mean and standard deviation, for each parameter in ``outside``: mean without and with
        them, standard deviation without and with them.
    own : dict of str to list of str
        Of a parameter with a value of its own in each run, the names of those values.
    """

    names: list
    values: np.ndarray
    fixed: dict
    outside: dict
    any_outside: float
    moved: dict
    own: dict = field(default_factory=dict)

    def array(self, names):
        """Parameter sets in an order of one's own, as that of `pycosim.export.law.Law.parameters`.

        Parameters
        ----------
        names : list of str
            Free or fixed parameters.

        Returns
        -------
        ndarray, shape (n, len(names))

        Raises
        ------
        UnknownNameError
            The model has no such parameter.
        """
        if isinstance(names, str) or not isinstance(names, Iterable):
            raise UnknownNameError(f"array takes a list of parameters, as [\"s1A.f0\"], not {shortened(names)}")
        columns = dict(zip(self.names, self.values.T))
        columns.update({n: np.mean([columns[k] for k in runs], axis=0) for n, runs in self.own.items()})
        for n in names:
            if n not in columns and n not in self.fixed:
                raise UnknownNameError(f"no parameter '{n}' in this fit{closest(n, [*columns, *self.fixed])}")
        return np.column_stack([columns[n] if n in columns else np.full(len(self.values), self.fixed[n])
                                for n in names]) if names else np.zeros((len(self.values), 0))

    def lines(self):
        """What the bounds cut, in sentences.

        Returns
        -------
        list of str
        """
        return [f"{n}: {share:.1%} of the unbounded draws lay beyond its bounds; within them its mean is "
                f"{self.moved[n][1]:.4g} instead of {self.moved[n][0]:.4g}, its standard deviation "
                f"{self.moved[n][3]:.2g} instead of {self.moved[n][2]:.2g}." for n, share in self.outside.items()]


def draw(fit, n, bounded=True, seed=0):
    """Draw parameter sets from what a fit knows.

    Parameters
    ----------
    fit : Fit
        Its covariance and undetermined directions are drawn from.
    n : int
        How many.
    bounded : bool
        Respect the bounds, and spread along null directions within them; or neither.
    seed : int
        The same seed gives the same sets.

    Returns
    -------
    Draws

    References
    ----------
    .. [1] Geman, S. and Geman, D. (1984). Stochastic relaxation, Gibbs distributions, and the Bayesian restoration of
           images. IEEE Transactions on Pattern Analysis and Machine Intelligence 6(6).
    .. [2] Robert, C. P. (1995). Simulation of truncated normal variables. Statistics and Computing 5.
    """
    rng, fixed = np.random.default_rng(seed), {k: v for k, v in fit.parameters.items()
                                             if k not in fit.free and k not in fit.own}
    root, null = _axes(fit)

    def some():
        return fit.unbounded + rng.standard_normal((n, root.shape[1])) @ root.T

    free = some()
    if not bounded or not fit.free or not n:
        return Draws(fit.free, free, fixed, {}, 0.0, {}, fit.own)
    low, high = (np.array([getattr(fit.variables[k], b) for k in fit.free]) for b in ("min", "max"))
    beyond = (free < low) | (free > high)
    kept = free[~beyond.any(axis=1)]
    for _ in range(_TRIES):
        if len(kept) < n:
            more = some()
            kept = np.vstack([kept, more[((more >= low) & (more <= high)).all(axis=1)]])
    values = kept[:n]
    if len(kept) < n or null.shape[1]:
        inside = kept[np.arange(n) % len(kept)] if len(kept) else np.tile(np.clip(fit.values, low, high), (n, 1))
        values = _within(inside, fit.unbounded, root, null, low, high, rng)
    outside = {k: float(b.mean()) for k, b in zip(fit.free, beyond.T) if b.any()}
    moved = {k: (float(fit.unbounded[i]), float(values[:, i].mean()), float(fit.stderr[i]), float(values[:, i].std()))
             for i, k in enumerate(fit.free) if k in outside}
    return Draws(fit.free, values, fixed, outside, float(beyond.any(axis=1).mean()), moved, fit.own)


def _axes(fit):
    """Square root of the covariance, and null directions, as columns."""
    scale = np.array([fit.variables[k].nominal for k in fit.free])
    if not len(scale):
        return np.zeros((0, 0)), np.zeros((0, 0))
    values, vectors = np.linalg.eigh(fit.covariance / np.outer(scale, scale))
    kept = values > _LEAST * values.max()
    null = np.reshape(fit.null_directions, (-1, len(scale))).T
    return scale[:, None] * vectors[:, kept] * np.sqrt(values[kept]), null


def _within(x, centre, root, null, low, high, rng):
    """Gibbs' sampler of the normal distribution within bounds, even along null directions; a chain for every draw.

    A draw is ``centre + root y + null c``, y standard normal; each coordinate of y and c in turn is drawn anew from
    what the bounds leave of it while the others are held.
    """
    y = ((x - centre) @ np.linalg.pinv(np.hstack([root, null])).T)[:, :root.shape[1]].copy()
    for _ in range(_SWEEPS):
        for k, axis in enumerate(root.T):
            new = _truncated(y[:, k], *_room(x, axis, low, high), rng)
            x, y[:, k] = x + (new - y[:, k])[:, None] * axis, new
        for axis in null.T:
            x = x + rng.uniform(*_room(x, axis, low, high))[:, None] * axis
    return np.clip(x, low, high)  # of rounding


def _room(x, axis, low, high):
    """How far each draw may move along an axis, backwards and onwards."""
    moves = np.abs(axis) > 1e-9 * np.max(np.abs(axis))
    ends = np.stack([(low[moves] - x[:, moves]) / axis[moves], (high[moves] - x[:, moves]) / axis[moves]])
    return np.minimum(ends.min(axis=0).max(axis=1), 0.0), np.maximum(ends.max(axis=0).min(axis=1), 0.0)


def _truncated(y, first, last, rng):
    """Standard normal numbers between ``y + first`` and ``y + last``."""
    low, high = y + first, y + last
    flip = low > 0  # the upper tail, where probabilities are too near to one
    low, high = np.where(flip, -high, low), np.where(flip, -low, high)
    share = rng.uniform(ndtr(low), ndtr(high))
    found = np.clip(ndtri(share), low, high)
    return np.where(flip, -found, found)

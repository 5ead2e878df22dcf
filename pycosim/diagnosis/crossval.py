"""A fitted model in; its errors on folds that it was not fitted to, block by block, out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..data.noise import contiguous
from ..data.scatter import noise_level
from ..fit.bounded import bounded

LARGEST = 50e6  # bytes of derivatives that rivals are compared by: a longer log is thinned
HINT = 0.02
"""Weight of a fold itself beside the others, in the plain error. What the others tell decides; where they tell next to
nothing, its own stands in, instead of an extrapolation. In logs of 12 s, of three passes, the plain error of unseen
passes was a hundred times that of fitted ones, whatever law was in the model, and true effects of twice the noise were
refused."""
UNTOLD = 2.0
"""Where a model errs more than so many times as far with what the other folds alone tell, its plain error is as good as
drawn by lot: the base model's 1.0 to 1.6 times in 23 short logs, 4 to 900 times in 13. There the whitened error
decides, which counts what the others leave open: in a log of pick and place, 32 times, an asymmetry that took 0.88 of
the error was refused, and a torque constant, 47 noise variances behind, was not. In one of 10 s a constant, 92 times,
was before an asymmetry that no data told from it by the whitened error."""


@dataclass
class Selection:
    """Errors of a refitted model on folds that it was not fitted to, block by block; log by log where folds are logs.

    Attributes
    ----------
    channels : ndarray, shape (channels, blocks)
        Weighted sum of squares of each channel, with what the other folds tell next to nothing of taken from the fold.
    alone : ndarray, shape (channels, blocks)
        The same with what the other folds alone tell: in a short log they may tell some parameters not at all.
    white : ndarray, shape (blocks,)
        The same of the whitened residual: sharper between rivals.
    level : ndarray, shape (channels, n)
        Noise that each sample should show, in the channels' units.
    left : dict of str to ndarray, shape (channels, compared samples)
        By kind of error, ``raw`` and ``white``: the residual that it is made of.
    index : ndarray of int, shape (compared samples,)
        The block of each of them.
    thin : int
        Of so many samples one is compared.
    """

    channels: np.ndarray
    alone: np.ndarray
    white: np.ndarray
    level: np.ndarray
    left: dict
    index: np.ndarray
    thin: int

    @property
    def told(self):
        """Whether the other folds tell a fold's plain error, by `UNTOLD`."""
        return bool(self.alone.sum() < UNTOLD * self.channels.sum())

    @property
    def usual(self):
        """Noise level at which models are compared, channel by channel."""
        return np.median(self.level, axis=1, keepdims=True)

    @property
    def raw(self):
        """Weighted sum of squares a block, of all channels together."""
        return self.channels.sum(0)


def select(dataset, model, fit, noise, beside=None):
    """Cross-validate a fitted model over the selection folds, linearised at its optimum.

    Parameters
    ----------
    dataset : Dataset
        Its folds are left out in turn.
    model : Model
        That was fitted.
    fit : Fit
        The optimum at which the residual is taken as linear.
    noise : list of Noise
        One a channel.
    beside : Selection, optional
        Of the model that rivals are compared beside, which lacks each of them: its noise level is theirs.

    Returns
    -------
    Selection
    """
    problem = dataset.residuals(model, fit.free, fit.parameters, "fit")
    thin = max(1, int(problem.n * (len(fit.free) + 1) * len(noise) * 8 / LARGEST))
    sloped = dataset.residuals(model, fit.free, fit.parameters, "fit", dataset.exogenous())
    level = noise_level(dataset, model, fit.parameters)
    whole = level if beside is None else beside.level
    level, usual = level[:, ::thin], np.median(whole, axis=1, keepdims=True)
    if thin > 1:
        problem, sloped = problem.thin(thin), sloped.thin(thin)
    residual = problem.residual(fit.values) * usual / level
    slope = np.concatenate([j for _, _, j in sloped.blocks(fit.values)], axis=2) * (usual / level)[:, None, :]
    blocks, index = np.unique(problem.block, return_inverse=True)
    size = len(fit.free) + 1
    raw = np.zeros((len(noise), len(blocks), size, size))
    white, chain, pieces, whitened = np.zeros_like(raw), problem.chain, contiguous(problem.time, problem.group), []
    for c, w in enumerate(fit.weights):
        rows = np.concatenate([slope[c], residual[c][None]])
        whitened.append(noise[c].whiten(rows, chain))
        for found, values in ((raw[c], w * rows), (white[c], whitened[c])):
            for s in pieces:
                found[index[s.start]] += values[:, s] @ values[:, s].T
    low = np.array([fit.variables[n].min for n in fit.free]) - fit.values
    high = np.array([fit.variables[n].max for n in fit.free]) - fit.values
    fold, total = dataset.fold[blocks], white.sum((0, 1))
    errors = [_cross_validate(raw, fold, low, high), _cross_validate(raw, fold, low, high, 0.0),
              _predictive(white, fold, low, high)]
    if dataset.by_run:  # the blocks of a log share its conditions
        own = np.unique(dataset.blocks.run[blocks], return_inverse=True)[1]
        errors = [np.array([np.bincount(own, of_channel) for of_channel in e]) for e in errors]
        index = own[index]
    y = np.r_[-bounded(total[:-1, :-1], total[:-1, -1], low, high)[1], 1.0]
    left = {"raw": residual - np.einsum("i,cij->cj", -y[:-1], slope), "white": np.array([y @ w for w in whitened])}
    left["raw"] *= fit.weights[:, None]
    return Selection(*errors[:2], errors[2].sum(0), whole, left, index, thin)


def _cross_validate(gram, fold, low, high, hint=HINT):
    """Squares of each channel and block, with parameters fitted to the other folds, as far as those tell them."""
    error = np.zeros(gram.shape[:2])
    for f in np.unique(fold):
        inside = fold == f
        rest = gram[:, ~inside].sum((0, 1)) + hint * gram[:, inside].sum((0, 1))
        _, x = bounded(rest[:-1, :-1], rest[:-1, -1], low, high)
        y = np.r_[-x, 1.0]
        error[:, inside] = np.einsum("i,cbij,j->cb", y, gram[:, inside], y)
    return error


def _predictive(gram, fold, low, high):
    """What each channel and block adds to the squares of the other folds, with parameters that may give way to it.

    An error of prediction in units of what the other folds leave open. Where they hardly tell a parameter - one fold
    alone has another load - a right model errs as far as a wrong one, and that tells nothing of either.
    """
    whole = gram.sum((0, 1))
    kept, x = bounded(whole[:-1, :-1], whole[:-1, -1], low, high)
    y = np.r_[-x, 1.0]
    error = np.einsum("i,cbij,j->cb", y, gram, y)
    for f in np.unique(fold):
        inside = fold == f
        rest = gram[:, ~inside].sum((0, 1))  # a difference would keep the rounding of what one fold alone tells
        gained = bounded(rest[:-1, :-1], rest[:-1, -1], low, high)[0]
        risen = (whole[-1, -1] - kept) - (rest[-1, -1] - gained) - error[:, inside].sum()
        error[:, inside] += risen / error[:, inside].size
    return error


def gap(one, other, kind):
    """By how much one of two rivals errs more than another on unseen folds, and the standard error of that.

    What two models predict apart tells how far their errors differ where one of them is right, block by block: by its
    squares, up or down, give or take twice their root in units of the noise. A block in which they predict the same
    tells nothing of them. The noise is at least what it was found to be,
    of the whitened error; and more where the differences are not in proportion to those squares.

    Parameters
    ----------
    one, other : Selection
        Of the same folds at one noise level.
    kind : str
        Of the error: ``white`` or ``raw``.

    Returns
    -------
    total, stderr : float

    References
    ----------
    .. [1] Cox, D. R. (1962). Further results on tests of separate families of hypotheses. Journal of the Royal
           Statistical Society B 24(2), 406-424.
    """
    d = getattr(one, kind) - getattr(other, kind)
    apart = np.bincount(one.index, ((one.left[kind] - other.left[kind]) ** 2).sum(0), len(d))
    least = 1.0 if kind == "white" else 0.0 if len(d) > 1 else np.inf
    whole = apart.sum()
    if whole <= 0.0:
        return float(d.sum()), 0.0
    off = d - d.sum() / whole * apart
    spread = (off[apart > 0] ** 2 / apart[apart > 0]).sum() / max(np.count_nonzero(apart > 0) - 1, 1)
    return float(d.sum()), float(np.sqrt(whole * max(spread, 4.0 * least)))


def difference(a, b):
    """Sum of the differences of two block-wise errors, and its standard error.

    Parameters
    ----------
    a, b : ndarray, shape (blocks,)
        Errors of two models on the same blocks, in the same unit.

    Returns
    -------
    total, stderr : float
        The second is infinite for a single block.

    Examples
    --------
    >>> total, stderr = difference(np.array([1.0, 2.0, 3.0]), np.array([0.5, 1.5, 2.8]))
    >>> round(float(total), 3), round(float(stderr), 3)
    (1.2, 0.3)
    """
    d = a - b
    return float(d.sum()), float(np.sqrt(len(d) * d.var(ddof=1))) if len(d) > 1 else float("inf")

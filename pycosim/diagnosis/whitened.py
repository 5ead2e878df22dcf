"""A residual in correlated noise in; the chance that noise alone gains as much by further columns, out.

Errors over stretches of a log count these as independent, and noise that changes over a second or two makes neighbours
of them. In units of the noise itself, white and slow, what some columns take of a residual is chi-squared.
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc

RANK = 1e-10  # of the square of a column that is no more than rounding beside others


class Whitened:
    """A residual, and the columns that it was fitted by, in units of correlated noise.

    Parameters
    ----------
    noise : list of Noise
        One a channel.
    chain : Chain
        Of the samples.
    residual : ndarray, shape (channels, n)
        In units of each channel that its noise has, as all that follows.
    slope : ndarray, shape (channels, free, n), optional
        What stays free beside the columns that are asked about.
    """

    def __init__(self, noise, chain, residual, slope=None):
        self.noise, self.chain, self.count = noise, chain, residual.size
        free = residual[:, None][:, :0] if slope is None else slope
        self._base = [n.whiten(np.concatenate([f, r[None]]), chain) for n, f, r in zip(noise, free, residual)]

    def chance(self, columns):
        """Chance that noise alone gains as much by columns beside the slopes.

        Parameters
        ----------
        columns : iterable of ndarray, shape (any, n)
            As many in each channel; one channel is held at a time.

        Returns
        -------
        float
            Of all the columns together, by chi-squared.
        """
        gram = 0.0
        for noise, base, some in zip(self.noise, self._base, columns):
            rows = np.concatenate([noise.whiten(some, self.chain), base])
            gram = gram + rows @ rows.T
        size = np.sqrt(np.diag(gram))
        gram = gram / np.maximum(size[:, None] * size, 1e-300)
        first = len(gram) - len(self._base[0])
        rest = _beside(gram, np.r_[np.arange(first), len(gram) - 1], np.arange(first, len(gram) - 1))
        values, vectors = np.linalg.eigh(rest[:-1, :-1])
        told = values > RANK
        gain = ((rest[-1, :-1] @ vectors[:, told]) ** 2 / values[told]).sum()
        return float(chdtrc(max(np.count_nonzero(told), 1), gain * self.count / max(rest[-1, -1], 1e-300)))


def _beside(gram, kept, free):
    """Products of the kept columns, without what the free ones span of them."""
    values, vectors = np.linalg.eigh(gram[np.ix_(free, free)])
    span = gram[np.ix_(kept, free)] @ (vectors[:, told := values > RANK] / np.sqrt(values[told]))
    return gram[np.ix_(kept, kept)] - span @ span.T

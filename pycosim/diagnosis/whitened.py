"""A residual in correlated noise in; the chance that noise alone gains as much by further columns, out.

Errors over stretches of a log count these as independent, and noise that changes over a second or two makes neighbours
of them. In units of the noise itself, white and slow, what some columns take of a residual is chi-squared.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.stats import chi2

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
        self.noise, self.chain, self.residual, self.slope = noise, chain, residual, slope

    def _of(self, rows):
        """The channels one after the other: shape (channels * n, any)."""
        return np.concatenate([n.whiten(r, self.chain).T for n, r in zip(self.noise, rows)])

    @cached_property
    def _base(self):
        """What spans the slopes, and the residual beside them."""
        left = self._of(self.residual[:, None])[:, 0]
        span = np.zeros((len(left), 0)) if self.slope is None else _span(self._of(self.slope))
        return span, left - span @ (span.T @ left)

    def chance(self, columns):
        """Chance that noise alone gains as much by columns beside the slopes.

        Parameters
        ----------
        columns : ndarray, shape (channels, any, n)
            Any number of them.

        Returns
        -------
        float
            Of all the columns together, by chi-squared.
        """
        span, left = self._base
        rows = self._of(columns)
        more = _span(rows - span @ (span.T @ rows), np.sqrt((rows ** 2).sum(0)))
        return float(chi2.sf(((more.T @ left) ** 2).sum() / (left ** 2).mean(), max(more.shape[1], 1)))


def _span(columns, size=None):
    """Orthonormal columns that span others, but for what is rounding beside the size that each had."""
    size = np.sqrt((columns ** 2).sum(0)) if size is None else size
    scaled = columns / np.maximum(size, 1e-300)
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    told = values > RANK * max(values.max(initial=0.0), 1.0)
    return scaled @ (vectors[:, told] / np.sqrt(values[told]))

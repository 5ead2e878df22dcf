"""A residual in correlated noise in; the chance that noise alone gains as much by further columns, out.

Errors over stretches of a log count these as independent, and noise that changes over a second or two makes neighbours
of them. In units of the noise itself, white and slow, what some columns take of a residual is chi-squared.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.special import chdtrc

from ..fit.least_squares import NULL, invert

CHANCE = 0.01
"""Of one of all the laws or variables that are asked to gain as much in correlated noise, by chi-squared. In five right
laws of 92, to which standard errors over stretches gave three for a slow variable, the statistic was 2 to 11 by a line
(bar: 14) and 19 by eight levels (31); in what stood first for another law, in 18 logs, 76 to 640 by a line and 39 by
eight levels. Of what was missing in 12 logs of laws outside the chance was 1e-7 and less."""


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
        self._given = np.concatenate([free, residual[:, None]], axis=1)

    @cached_property
    def _base(self):
        """The slopes and the residual, in units of the noise: a channel each."""
        return [n.whiten(rows, self.chain) for n, rows in zip(self.noise, self._given)]

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
        kept, free = np.r_[:first, len(gram) - 1], np.s_[first:len(gram) - 1]
        rest = gram[np.ix_(kept, kept)] - gram[kept, free] @ invert(gram[free, free])[0] @ gram[free, kept]
        values, vectors = np.linalg.eigh(rest[:-1, :-1])
        told = values > NULL
        gain = ((rest[-1, :-1] @ vectors[:, told]) ** 2 / values[told]).sum()
        return float(chdtrc(max(np.count_nonzero(told), 1), gain * self.count / max(rest[-1, -1], 1e-300)))

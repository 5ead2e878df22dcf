"""Residuals in, a model of their correlation out: white noise plus a slow part, which is an ARMA(1, 1) process."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter


@dataclass(frozen=True)
class Noise:
    """Noise of one channel, white plus an exponentially correlated part.

    Attributes
    ----------
    white, slow : float
        Standard deviations of the two parts, in the channel's unit.
    phi : float
        Correlation of the slow part from one sample to the next.
    theta : float
        Moving-average coefficient of the equivalent ARMA(1, 1) process.
    sigma : float
        Standard deviation of its innovations.
    """

    white: float
    slow: float
    phi: float
    theta: float
    sigma: float

    def whiten(self, values):
        """Innovations of ``values`` along the last axis, in units of their standard deviation."""
        return lfilter([1.0, -self.phi], [1.0, -self.theta], values, axis=-1) / self.sigma

    def colour(self, values):
        """Multiply by the covariance of the noise along the last axis (``whiten`` inverted, and its transpose)."""
        back = lfilter([1.0, -self.theta], [1.0, -self.phi], values[..., ::-1], axis=-1)[..., ::-1]
        return self.sigma ** 2 * lfilter([1.0, -self.theta], [1.0, -self.phi], back, axis=-1)


def autocovariance(pieces, lags):
    """Autocovariance of contiguous pieces of a series, pooled.

    Parameters
    ----------
    pieces : list of ndarray
    lags : ndarray of int

    Returns
    -------
    ndarray, shape (len(lags),)
    """
    total, count = np.zeros(len(lags)), np.zeros(len(lags))
    for piece in pieces:
        n = len(piece)
        size = 1 << int(2 * n - 1).bit_length()
        spectrum = np.abs(np.fft.rfft(piece, size)) ** 2
        covariance = np.fft.irfft(spectrum, size)
        fits = lags < n
        total[fits] += covariance[lags[fits]]
        count[fits] += n - lags[fits]
    return total / np.maximum(count, 1)


def fit_noise(pieces):
    """Estimate the noise of one channel from contiguous pieces of its residual.

    Parameters
    ----------
    pieces : list of ndarray

    Returns
    -------
    Noise
    """
    longest = max((len(p) for p in pieces), default=1)
    variance = autocovariance(pieces, np.array([0]))[0] if pieces else 1.0
    if longest < 20 or variance <= 0:
        sigma = float(np.sqrt(max(variance, 1e-300)))
        return Noise(sigma, 0.0, 0.0, 0.0, sigma)
    top = min(longest // 2, 1000)
    lags = np.unique(np.r_[np.arange(1, min(10, top + 1)), np.geomspace(1, top, 30).astype(int)])
    rho = autocovariance(pieces, lags) / variance
    weight = 1 / np.sqrt(1 + lags / 10)

    def misfit(x):
        return weight * (x[0] * np.exp(-lags / np.exp(x[1])) - rho)

    starts = [(0.3, np.log(t)) for t in (3.0, 30.0, 200.0)]
    bounds = [(0, np.log(0.5)), (0.999, np.log(5.0 * longest))]
    best = min((least_squares(misfit, np.clip(s, *bounds), bounds=bounds) for s in starts), key=lambda r: r.cost)
    share, phi = best.x[0], float(np.exp(-1 / np.exp(best.x[1])))
    if share < 1e-3:
        sigma = float(np.sqrt(variance))
        return Noise(sigma, 0.0, 0.0, 0.0, sigma)
    return arma(np.sqrt((1 - share) * variance), np.sqrt(share * variance), phi)


def arma(white, slow, phi):
    """ARMA(1, 1) process of a white and an exponentially correlated part.

    The differenced series ``y(t) - phi y(t - 1)`` has variance ``g0`` and lag-one covariance ``g1``; a moving average of
    order one has the same two (Box and Jenkins).
    """
    g0 = slow ** 2 * (1 - phi ** 2) + white ** 2 * (1 + phi ** 2)
    g1 = -phi * white ** 2
    if white ** 2 * phi < 1e-12 * g0:
        return Noise(float(white), float(slow), phi, 0.0, float(np.sqrt(g0)))
    half = -g0 / (2 * g1)
    theta = half - np.sqrt(max(half ** 2 - 1, 0.0))
    return Noise(float(white), float(slow), phi, float(theta), float(np.sqrt(-g1 / theta)))


def contiguous(time, group):
    """Slices of samples that follow each other in time within one group, in order.

    Parameters
    ----------
    time : ndarray, shape (n,)
    group : ndarray, shape (n,)

    Returns
    -------
    list of slice
    """
    if len(time) == 0:
        return []
    gap = np.diff(time)
    usual = np.median(gap[gap > 0]) if (gap > 0).any() else 1.0
    cut = np.flatnonzero((gap > 3 * usual) | (gap <= 0) | (np.diff(group) != 0)) + 1
    edges = np.r_[0, cut, len(time)]
    return [slice(a, b) for a, b in zip(edges[:-1], edges[1:])]

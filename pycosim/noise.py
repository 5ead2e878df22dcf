"""Residuals in, a model of their correlation out: white noise plus a slow part, which is an ARMA(1, 1) process."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
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

    def independent(self, n, pieces):
        """Number of independent values among n samples in so many pieces, as far as slow noise limits a fit."""
        if self.slow <= 0.1 * self.white:
            return float(n)
        return max(n / (1 + 2 * self.phi / (1 - self.phi + 1e-12)), float(pieces))

    def whiten(self, values):
        """Innovations of ``values`` along the last axis, in units of their standard deviation."""
        return lfilter([1.0, -self.phi], [1.0, -self.theta], values, axis=-1) / self.sigma

    def colour(self, values):
        """Multiply by the covariance of the noise along the last axis (``whiten`` inverted, and its transpose)."""
        back = lfilter([1.0, -self.theta], [1.0, -self.phi], values[..., ::-1], axis=-1)[..., ::-1]
        return self.sigma ** 2 * lfilter([1.0, -self.theta], [1.0, -self.phi], back, axis=-1)


def fit_noise(pieces, absorbed=None):
    """Estimate the noise of one channel from contiguous pieces of its residual.

    Maximum likelihood in the frequency domain (Whittle), all pieces pooled: the periodogram of each frequency is
    exponential about the spectrum of white noise plus an exponentially correlated part.

    Parameters
    ----------
    pieces : list of ndarray
    absorbed : list of ndarray, shape (p, length), optional
        The part of an orthonormal basis of the fitted parameters in each piece: what the fit took out of the noise,
        mostly at low frequencies, is put back.

    Returns
    -------
    Noise
    """
    step = max(1, sum(map(len, pieces)) // 60000)  # enough for three numbers
    pieces, absorbed = pieces[::step], (absorbed or [np.zeros((0, len(p))) for p in pieces])[::step]
    variance = np.mean(np.concatenate(pieces) ** 2) if pieces else 1.0
    long = [(p, a) for p, a in zip(pieces, absorbed) if len(p) >= 20]
    if not long or variance <= 0:
        sigma = float(np.sqrt(max(variance, 1e-300)))
        return Noise(sigma, 0.0, 0.0, 0.0, sigma)
    power = np.concatenate([_periodogram(p) for p, _ in long]) / variance
    power /= np.maximum(1 - np.concatenate([_periodogram(a).sum(0) for _, a in long]), 0.2)
    frequency = np.concatenate([np.arange(1, _kept(len(p)) + 1) / len(p) for p, _ in long])
    count, power, cosine = _smoothed(frequency, power)

    def misfit(x):
        white, slow, phi = np.exp(x[0]), np.exp(x[1]), np.exp(-np.exp(-np.clip(x[2], -1.0, top)))
        shape = (1 - phi ** 2) / (1 - 2 * phi * cosine + phi ** 2)
        spectrum = white + slow * shape
        return float(count @ (np.log(spectrum) + power / spectrum))

    top = np.log(2.0 * max(len(p) for p, _ in long))
    best = min((minimize(misfit, (-0.3, -1.5, min(t, top)), method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-7})
                for t in (2.0, 5.0)), key=lambda r: r.fun)
    white, slow = variance * np.exp(best.x[:2])
    if best.fun > np.log(count @ power) + 1 - 3.0 / len(frequency):  # a slow part that explains nothing
        sigma = float(np.sqrt(variance))
        return Noise(sigma, 0.0, 0.0, 0.0, sigma)
    return arma(np.sqrt(white), np.sqrt(slow), float(np.exp(-np.exp(-np.clip(best.x[2], -1.0, top)))))


def _smoothed(frequency, power, bins=60):
    """Mean power in bins of equal ratio of frequency: share of the frequencies, power, cosine of the mean frequency."""
    edges = np.geomspace(frequency.min(), frequency.max() * (1 + 1e-9), bins + 1)
    place = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, bins - 1)
    count = np.bincount(place, minlength=bins)
    kept = count > 0
    mean = [np.bincount(place, v, bins)[kept] / count[kept] for v in (power, frequency)]
    return count[kept] / count.sum(), mean[0], np.cos(2 * np.pi * mean[1])


def _periodogram(values):
    """Power at the lower positive frequencies, along the last axis, of a unitary transform.

    The upper two thirds say nothing of what limits a fit, and filters and interpolation have been there.
    """
    return np.abs(np.fft.rfft(values, axis=-1)[..., 1:_kept(values.shape[-1]) + 1]) ** 2 / values.shape[-1]


def _kept(n):
    """Number of frequencies used of a piece of n samples."""
    return max(n // 6, min(n // 2, 8))


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
    theta = 1 / (half + np.sqrt(max(half ** 2 - 1, 0.0)))  # the root inside the unit circle, without cancellation
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

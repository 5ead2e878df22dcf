"""Residuals in, a model of their correlation out: white noise plus a slow part, which is an ARMA(1, 1) process."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.fft import next_fast_len, rfft
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
        """Number of independent values among n samples in so many pieces, as far as slow noise limits a fit.

        Parameters
        ----------
        n, pieces : int

        Returns
        -------
        float
        """
        if self.slow <= 0.1 * self.white:
            return float(n)
        return max(n / (1 + 2 * self.phi / (1 - self.phi + 1e-12)), float(pieces))

    def whiten(self, values):
        """Innovations of ``values`` along the last axis, in units of their standard deviation.

        Parameters
        ----------
        values : ndarray, shape (.., n)

        Returns
        -------
        ndarray, shape (.., n)
        """
        return lfilter([1.0, -self.phi], [1.0, -self.theta], values, axis=-1) / self.sigma

    def colour(self, values):
        """Multiply by a square root of the covariance of the noise along the last axis; comes out in reversed order.

        Parameters
        ----------
        values : ndarray, shape (.., n)

        Returns
        -------
        ndarray, shape (.., n)
        """
        return self.sigma * lfilter([1.0, -self.theta], [1.0, -self.phi], values[..., ::-1], axis=-1)


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
    power, taken, frequency = (np.concatenate(v) for v in zip(*[_periodogram(p, a) for p, a in long]))
    power /= variance * np.maximum(1 - taken, 0.2)
    count, power, cosine = _smoothed(frequency, power)

    misfit, white, slow, phi = _whittle(count, power, cosine, max(len(p) for p, _ in long))
    if misfit > np.log(count @ power) + 1 - 3.0 / len(frequency):  # a slow part that explains nothing
        sigma = float(np.sqrt(variance))
        return Noise(sigma, 0.0, 0.0, 0.0, sigma)
    return arma(np.sqrt(variance * white), np.sqrt(variance * slow), phi)


def _whittle(count, power, cosine, longest, points=24, zooms=6):
    """White and slow power, and correlation, that make the spectrum most likely: misfit, white, slow, phi.

    The scale has a closed form for a given shape. The logarithms of the other two - slow over white, and the
    correlation time - are searched on a grid that closes in on its best point.
    """
    low, high = -1.0, np.log(2.0 * longest)
    middle, half = np.array([1.0, (low + high) / 2]), np.array([8.0, (high - low) / 2])
    for _ in range(zooms):
        r, t = (np.linspace(m - h, m + h, points) for m, h in zip(middle, half))
        phi = np.exp(-np.exp(-np.clip(t, low, high)))[:, None]
        shape = 1 + np.exp(r)[:, None, None] * ((1 - phi ** 2) / (1 - 2 * phi * cosine + phi ** 2))
        white = (power / shape) @ count
        misfit = np.log(white) + np.log(shape) @ count + 1
        i, j = np.unravel_index(np.argmin(misfit), misfit.shape)
        middle, half = np.array([r[i], t[j]]), half * 4 / points
    return float(misfit[i, j]), float(white[i, j]), float(white[i, j] * np.exp(r[i])), float(phi[j, 0])


def _smoothed(frequency, power, bins=60):
    """Mean power in bins of equal ratio of frequency: share of the frequencies, power, cosine of the mean frequency."""
    edges = np.geomspace(frequency.min(), frequency.max() * (1 + 1e-9), bins + 1)
    place = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, bins - 1)
    count = np.bincount(place, minlength=bins)
    kept = count > 0
    mean = [np.bincount(place, v, bins)[kept] / count[kept] for v in (power, frequency)]
    return count[kept] / count.sum(), mean[0], np.cos(2 * np.pi * mean[1])


def _periodogram(values, absorbed):
    """Power of a piece and of what was absorbed of it, at the lower positive frequencies of a unitary transform.

    The upper two thirds say nothing of what limits a fit, and filters and interpolation have been there.
    """
    n = _fast(len(values))
    kept = max(n // 6, min(n // 2, 8))
    power = rfft(np.concatenate([values[None, :n], absorbed[:, :n]]), axis=1)[:, 1:kept + 1]
    power = (power.real ** 2 + power.imag ** 2) / n
    return power[0], power[1:].sum(0), np.arange(1, kept + 1) / n


@lru_cache(maxsize=None)
def _fast(n):
    """Largest length up to n whose transform is quick."""
    return next(m for m in range(n, 0, -1) if next_fast_len(m, real=True) == m)


def arma(white, slow, phi):
    """ARMA(1, 1) process of a white and an exponentially correlated part.

    The differenced series ``y(t) - phi y(t - 1)`` has variance ``g0`` and lag-one covariance ``g1``; a moving average
    of order one has the same two (Box and Jenkins).

    Parameters
    ----------
    white, slow : float
        Standard deviations of the two parts.
    phi : float
        Correlation of the slow part from one sample to the next.

    Returns
    -------
    Noise
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

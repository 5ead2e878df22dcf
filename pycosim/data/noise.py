"""Residuals in, a model of their correlation out: white noise plus a slow, exponentially correlated part.

The slow part remembers across the gaps between passes and across what a recorder missed; only unrelated records (other
runs, other pairs of passes) start anew. Half the difference of a way out and its way back forgets as either way does,
and holds the less of the slow part the less time lies between its two samples. Whitening and covariance are exact for
such samples (of half differences: where both ways take equal times), through the filter of the slow part (Kalman),
whose recursions are solved as banded systems.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.linalg.lapack import dtbtrs
from scipy.optimize import minimize

BLOCKS = 2500  # means that the memory of the noise is estimated from, where a log holds them, and up to twice as many
_GOLDEN = (math.sqrt(5) - 1) / 2
LONGEST = 32  # samples of one mean at most
STRETCHES = 5.0
"""Times that a log must hold the memory of its noise: what it holds less often is a trend, of which it shows one."""
VALLEYS = 3  # memories of the grid from which the search starts: the likelihood may have another valley at the longest
_WAY = 6  # points of the straight way from a start to a valley, on which a ridge between both would show
_MANY = 40  # means of that many samples, of which fewer tell little of a memory
COARSE = 16  # samples of the means that must tell of the same noise as single samples do
FINITE = 800  # samples over which a number may double at each and stay finite
PROVED = 3.0  # least gain in log-likelihood for which correlated noise is assumed: 5 % by chance (its two parameters)


@dataclass(frozen=True, eq=False)  # the filters of a chain are kept by its identity
class Chain:
    """How the slow noise of samples hangs together.

    Attributes
    ----------
    gaps : ndarray, shape (n,)
        Time from the sample before to each sample [s]; infinite where the noise starts anew.
    lags : ndarray, shape (n,), or None
        Where a sample is half a difference, the time between the two samples that it is made of [s].
    colour : float
        Variance that white noise gives the mean of many samples, over that of as many samples without a neighbour in
        common: interpolated ones share what was measured.
    """

    gaps: np.ndarray
    lags: np.ndarray | None = None
    colour: float = 1.0

    def __len__(self):
        return len(self.gaps)

    def variance(self, memory):
        """Variance of the slow part at each sample, as a part of that of samples far apart.

        Parameters
        ----------
        memory : float
            [s]

        Returns
        -------
        ndarray, shape (n,)
        """
        return np.ones(len(self.gaps)) if self.lags is None else -np.expm1(-self.lags / memory)

    def kept(self, memory):
        """What each sample keeps of the slow part of the sample before.

        With the samples of both ways a time :math:`u` from where the motion turned, half the difference is, counted
        outward, the same exponential process started from zero at :math:`u = 0`. Counted inward it keeps less.

        Parameters
        ----------
        memory : float
            [s]

        Returns
        -------
        ndarray, shape (n,)
        """
        kept = np.exp(-self.gaps / memory)
        if self.lags is not None:
            variance = self.variance(memory)
            kept[1:] *= np.minimum(1.0, variance[1:] / np.maximum(variance[:-1], 1e-300))
        return kept


@dataclass(frozen=True)
class Noise:
    """Noise of one channel, white plus an exponentially correlated part.

    Attributes
    ----------
    white, slow : float
        Standard deviations of the two parts, in the channel's unit. Where white noise is coloured by interpolation, the
        one that means over many samples tell of.
    memory : float
        Correlation time of the slow part [s].
    coarse : bool
        Whether means over many samples told it, and single ones scatter less.
    """

    white: float
    slow: float = 0.0
    memory: float = 0.0
    coarse: bool = False

    def single(self, width):
        """The noise of single samples, where this is that of means of ``width`` samples.

        Parameters
        ----------
        width : int
            Samples of one mean.

        Returns
        -------
        Noise
        """
        return replace(self, white=self.white * math.sqrt(width))

    def independent(self, chain):
        """Number of independent values among samples, as far as slow noise limits a fit.

        Parameters
        ----------
        chain : Chain
            Time between neighbouring samples, and where the noise starts anew.

        Returns
        -------
        float
        """
        if self.slow <= 0.1 * self.white:
            return float(len(chain))
        kept = np.exp(-chain.gaps / self.memory)
        return float(np.sum((1 - kept) / (1 + kept)))

    def freedom(self, chain):
        """Degrees of freedom that samples tell the noise of something slow with, where they tell it at all.

        The slow part is told by as many values as it has beside the white one, which is the trace of its smoother; the
        white one by all samples. Both are pooled as of variances [1]_.

        Parameters
        ----------
        chain : Chain
            Time between neighbouring samples, and where the noise starts anew.

        Returns
        -------
        float

        References
        ----------
        .. [1] Satterthwaite, F. E. (1946). An approximate distribution of estimates of variance components. Biometrics
               Bulletin 2(6).
        """
        inside = chain.gaps[np.isfinite(chain.gaps)]
        if self.slow == 0.0 or not len(inside):
            return float(len(chain))
        memories = len(chain) * float(np.median(inside)) / self.memory
        over = 2.0 * (self.slow / self.white) ** 2 * len(chain) / memories  # density of the slow part at rest
        values = 0.5 * memories * over / math.sqrt(1.0 + over)
        return (1.0 + over) ** 2 / (over**2 / values + 1.0 / len(chain))

    def whiten(self, values, chain):
        """Innovations of ``values`` along the last axis, in units of their standard deviation.

        Parameters
        ----------
        values : ndarray, shape (.., n)
            In the channel's unit.
        chain : Chain
            Time between neighbouring samples, and where the noise starts anew.

        Returns
        -------
        ndarray, shape (.., n)

        References
        ----------
        .. [1] Kalman, R. E. (1960). A new approach to linear filtering and prediction problems. Journal of Basic
               Engineering 82(1).
        """
        if self.slow == 0.0:
            return values / self.white
        flat = values.reshape(-1, values.shape[-1])
        return _innovations(flat, *_filter(self, chain)).reshape(values.shape)

    def unlikely(self, values, chain):
        """Minus the log-likelihood of samples, but for a constant.

        Parameters
        ----------
        values : ndarray, shape (n,)
            In the channel's unit.
        chain : Chain
            Time between neighbouring samples, and where the noise starts anew. Samples that are averages of others
            count as often as they are independent.

        Returns
        -------
        float
        """
        spread = np.full(len(values), self.white) if self.slow == 0.0 else _filter(self, chain)[2]
        white = self.whiten(values, chain)
        return float(0.5 * white @ white + np.log(spread).sum()) / max(chain.colour, 1.0)

    def whiten_transposed(self, values, chain):
        """Product of ``values`` with the transpose of the matrix that `whiten` multiplies by.

        Parameters
        ----------
        values : ndarray, shape (n,)
            In the channel's unit; any number of rows.
        chain : Chain
            Time between neighbouring samples, and where the noise starts anew.

        Returns
        -------
        ndarray, shape (n,)
        """
        if self.slow == 0.0:
            return values / self.white
        own, from_before, spread = _filter(self, chain)
        u = values / spread
        later = _recursion(np.r_[0.0, own[:0:-1]], -u[None, ::-1])[0, ::-1]
        return u + np.r_[from_before[1:] * later[1:], 0.0]

    def covariance(self, rows, chain):
        """Covariance of the sums of noise weighted by rows.

        Parameters
        ----------
        rows : ndarray, shape (p, n)
            Weights of the samples, one sum a row.
        chain : Chain
            Time between neighbouring samples, and where the noise starts anew.

        Returns
        -------
        ndarray, shape (p, p)
        """
        plain = rows @ rows.T
        if self.slow == 0.0:
            return self.white ** 2 * plain
        each = chain.variance(self.memory) * rows
        half = _recursion(chain.kept(self.memory), each) @ rows.T
        return self.white ** 2 * plain + self.slow ** 2 * (half + half.T - each @ rows.T)


@lru_cache(maxsize=4)  # the same noise whitens many a residual of the same samples
def _filter(noise, chain):
    return _gains(chain.kept(noise.memory), noise.slow ** 2 * chain.variance(noise.memory), noise.white ** 2)


def _recursion(factor, drive, spent=False):
    """Solve ``x[k] = factor[k] x[k - 1] + drive[k]`` along the last axis, from ``x[0] = drive[0]``.

    In the place of the drive, where that is spent.
    """
    if not drive.size:  # LAPACK's wrapper spoils memory with nothing to solve
        return drive
    bands = np.ones((2, len(factor)), order="F")
    bands[1, :-1] = -factor[1:]
    return dtbtrs(bands, drive.T, uplo="L", diag="U", overwrite_b=spent)[0].T


def _innovations(rows, own, from_before, spread):
    """What each sample says that those before it did not, over its spread."""
    drive = np.zeros(rows.shape)
    np.multiply(from_before[1:], rows[:, :-1], out=drive[:, 1:])
    before = _recursion(own, drive, spent=True)
    np.subtract(rows, before, out=before)
    before /= spread
    return before


def _gains(kept, slow, white):
    """Filter of a state of variances ``slow`` seen in white noise.

    Returns what the prediction of a sample takes from the prediction before it, what from the sample before it, and the
    spread of the innovations. The variance after a sample is a fractional-linear function of that after the sample
    before, so that its numerator and denominator follow a linear recursion, solved as a banded system. No entry is
    negative, so that nothing cancels; a denominator doubles at most from one sample to the next.
    """
    decay = kept ** 2
    fresh = np.maximum(slow - decay * np.r_[0.0, slow[:-1]], 0.0)
    size = fresh + white
    over_over, over_under, under_over = white * decay / size, white * fresh / size, decay / size
    after, before = np.empty(len(kept)), 0.0
    for k in range(0, len(kept), FINITE):
        some = slice(k, k + FINITE)
        m = len(after[some])
        bands, drive = np.zeros((4, 2 * m), order="F"), np.zeros(2 * m)
        bands[1, 1:-1:2], bands[2, 1:-1:2] = -over_under[some][1:], -1.0
        bands[2, 0:-2:2], bands[3, 0:-2:2] = -over_over[some][1:], -under_over[some][1:]
        drive[:2] = over_over[k] * before + over_under[k], under_over[k] * before + 1.0
        over, under = dtbtrs(bands, drive, uplo="L", diag="U", overwrite_b=True)[0].reshape(-1, 2).T
        np.divide(over, under, out=after[some])
        before = after[k + m - 1]
    ahead = fresh + decay * np.r_[0.0, after[:-1]]
    gain = ahead / (ahead + white)
    last = np.r_[0.0, gain[:-1]]
    return kept * (1 - last), kept * last, np.sqrt(ahead + white)


def chained(time, group, linked, lags=None, colour=1.0):
    """How the noise of samples hangs together.

    Parameters
    ----------
    time : ndarray, shape (n,)
        [s]
    group : ndarray, shape (n,)
        Pass of each sample, or what else tells unrelated records apart.
    linked : bool
        Whether the noise goes on from one group to the next where time does.
    lags : ndarray, shape (n,), optional
        Of half differences, the time between both samples [s].
    colour : float
        As of `Chain`.

    Returns
    -------
    Chain
        Regular sampling intervals are exactly equal.
    """
    if len(time) == 0:
        return Chain(np.zeros(0), lags, colour)
    gap, same = np.diff(time), np.diff(group) == 0
    inside = gap[(gap > 0) & same]
    usual = np.median(inside) if len(inside) else math.inf
    gap = np.where(np.abs(gap - usual) < 0.5 * usual, usual, gap) if len(inside) else gap
    return Chain(np.r_[math.inf, np.where((gap > 0) & (same | linked), gap, math.inf)], lags, colour)


def fit_noise(residual, chain, absorbed=None):
    """Estimate the noise of one channel from its residual, by restricted maximum likelihood.

    Means over short stretches hold what is known of the slow part, the scatter within them what is known of the white
    part; both have closed forms for exponential correlation. Behind a filter, noise has two memories, of which single
    samples tell the shorter one. Where means over longer stretches prove that noise wrong, the noise that they tell of
    is taken, but for what is white: of that the means know next to nothing where much is slow. Effects are slow.

    Parameters
    ----------
    residual : ndarray, shape (n,)
        Of one channel, in its unit.
    chain : Chain
        Time between neighbouring samples, and where the noise starts anew.
    absorbed : ndarray, shape (p, n), optional
        Derivatives by the fitted parameters, orthonormal or zero: what the fit took out of the noise is put back.

    Returns
    -------
    Noise

    References
    ----------
    .. [1] Patterson, H. D. and Thompson, R. (1971). Recovery of inter-block information when block sizes are unequal.
           Biometrika 58(3).
    """
    absorbed = np.zeros((0, len(residual))) if absorbed is None else absorbed
    (means, found), *proved = _told(residual, absorbed, chain)
    if not proved:
        return found
    (_, other), = proved
    between = math.sqrt(np.mean(np.diff(residual)[chain.gaps[1:] == means.step] ** 2) / 2)  # at least what is white
    return replace(other, white=max(other.white, min(found.white, between)), coarse=True)


def likelier(residual, chain, absorbed, columns):
    """By how much columns make a residual likelier, the noise at its best beside them and without them.

    Coefficients are those of generalised least squares in each noise that is tried: a column that goes with slow noise
    gains no more there than one of the few values that such noise has.

    Parameters
    ----------
    residual : ndarray, shape (n,)
        Of one channel, in its unit.
    chain : Chain
        Time between neighbouring samples, and where the noise starts anew.
    absorbed : ndarray, shape (p, n)
        Derivatives by the fitted parameters.
    columns : ndarray, shape (k, n)
        What may explain the residual besides.

    Returns
    -------
    float
        Difference of the largest log-likelihoods; 0 where too few samples follow each other. Twice that is chi-squared
        with k degrees of freedom [1]_ where noise alone is there and the columns were not chosen.

    References
    ----------
    .. [1] Wilks, S. S. (1938). The large-sample distribution of the likelihood ratio for testing composite hypotheses.
           Annals of Mathematical Statistics 9(1).
    """
    rows = np.concatenate([absorbed, columns])
    rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
    told = _told(residual, rows, chain)
    if told[0][0] is None:
        return 0.0
    without = _Means.of(residual, rows[:len(absorbed)], chain, COARSE if len(told) > 1 else None)
    before, after = (_likeliest(means, means.unlikelihood)[0] for means in (without, told[-1][0]))
    return max(before - after, 0.0)


def _told(residual, absorbed, chain):
    """Means and the noise that they tell of; after them coarse means, where these prove that noise wrong."""
    variance = float(np.mean(residual ** 2)) if len(residual) else 1.0
    plain = Noise(math.sqrt(max(chain.colour * variance, 1e-300)))
    means = _Means.of(residual, absorbed, chain) if variance > 0 else None
    if means is None:
        return [(None, plain)]
    found = _told_by(means) or plain
    coarse = _Means.of(residual, absorbed, chain, COARSE)
    if coarse is None:
        return [(means, found)]
    other = _told_by(coarse) or Noise(math.sqrt(coarse.evaluate((-50.0, math.log(coarse.least)))[1]))
    if coarse.unlikely(found) <= coarse.unlikely(other) + PROVED:
        return [(means, found)]
    return [(means, found), (coarse, other)]


def _told_by(means):
    """The noise that is likeliest by means; None where that is white."""
    misfit, x = _likeliest(means, means.misfit)
    if misfit > means.misfit((-50.0, x[1])) - PROVED:
        return None
    r, t = means.inside(x)
    white = math.sqrt(means.evaluate((r, t))[1])
    return Noise(white, white * math.exp(r), math.exp(t))


def _likeliest(means, misfit):
    """Least misfit of means, and where it is."""
    times = np.linspace(math.log(means.least), math.log(means.longest), 4)
    starts = sorted((min(((r, t) for r in (-2.5, -1.0, 0.5)), key=misfit) for t in times), key=misfit)
    found = _least(misfit, starts[0])
    for x in (x for x in starts[1:VALLEYS] if _apart(misfit, x, found.x)):
        found = min(found, _least(misfit, x), key=lambda f: f.fun)
    return found.fun, found.x


def _least(misfit, x):
    """The least misfit near a start."""
    return minimize(misfit, x, method="Nelder-Mead", options={
        "xatol": 0.03, "fatol": 0.03, "maxfev": 50, "initial_simplex": [x, (x[0] + 0.6, x[1]), (x[0], x[1] + 0.6)]})


def _apart(misfit, start, least):
    """Whether the straight way from a start to a least misfit goes up anywhere: another valley may lie there."""
    way = [misfit(tuple((1 - t) * a + t * b for a, b in zip(start, least))) for t in np.linspace(0, 1, _WAY)]
    return any(later > before for before, later in zip(way, way[1:]))


@dataclass
class _Means:
    """Means of a residual and of the fitted derivatives over stretches of ``size`` samples, and the scatter within."""

    rows: np.ndarray
    chain: Chain
    step: float
    size: int
    within: float
    count: int
    least: float
    longest: float

    @classmethod
    def of(cls, residual, absorbed, chain, coarse=None):
        """Cut into stretches; None where too few samples follow each other.

        Of ``coarse`` samples each, where that many are asked for; the scatter within them is then not counted.
        """
        gaps = chain.gaps
        regular = gaps[np.isfinite(gaps)]
        if len(residual) < 20 or len(regular) < 8:
            return None
        step = float(np.median(regular))
        edges = np.flatnonzero(np.r_[gaps != step, True])
        length = np.diff(edges)
        if length.max() < 8:
            return None
        least = math.ceil(3 * chain.colour) if chain.colour > 1 else 1  # samples in common are no slow noise
        size = int(min(coarse or max(len(residual) // BLOCKS, least), LONGEST, max(np.median(length) // 4, 1)))
        if coarse and (size < coarse or len(residual) < _MANY * coarse):
            return None
        pieces = [(a, n // size) for a, n in zip(edges[:-1].tolist(), length.tolist()) if n >= size]
        share = 2 * BLOCKS / sum(n for _, n in pieces)  # in no rhythm: every other piece may go one way
        pieces = [piece for k, piece in enumerate(pieces) if k * _GOLDEN % 1 < share]
        begins = np.concatenate([a + size * np.arange(n) for a, n in pieces])
        index = begins[:, None] + np.arange(size)
        values, absorbed = residual[index], absorbed[absorbed.any(1)]
        rows = np.concatenate([absorbed[:, index].mean(2), values.mean(1)[None]]) * math.sqrt(size)
        clock = np.cumsum(np.where(np.isfinite(gaps), gaps, 1e9))
        apart = np.diff(clock[begins])
        apart[np.abs(apart - size * step) < 0.5 * step] = size * step
        within = float(((values - values.mean(1, keepdims=True)) ** 2).sum())
        within *= chain.colour / max(1 - (chain.colour - 1) / size, 0.5)
        lags = None if chain.lags is None else chain.lags[index].mean(1)
        least = step * max(size / 4, 0.4)
        within, count = (0.0, 0) if coarse else (within, len(begins) * (size - 1))
        longest = max(float(regular.sum()) / STRETCHES, 2 * least)
        return cls(rows, Chain(np.r_[math.inf, apart], lags), step, size, within, count, least, longest)

    def inside(self, x):
        """Logarithms of slow over white and of the memory, where the closed forms hold."""
        return min(max(x[0], -50.0), 8.0), min(max(x[1], math.log(self.least)), math.log(self.longest))

    def misfit(self, x):
        """Minus the restricted log-likelihood, with the scale at its best."""
        return self.evaluate(self.inside(x))[0]

    def unlikelihood(self, x):
        """Minus the log-likelihood, with scale and coefficients at their best."""
        return self.evaluate(self.inside(x), restricted=False)[0]

    def unlikely(self, noise):
        """Minus the restricted log-likelihood of a noise with its own scale."""
        x = self.inside((math.log(noise.slow / noise.white), math.log(noise.memory)) if noise.slow else
                        (-50.0, math.log(self.least)))
        misfit, scale, n = self.evaluate(x, count=True)
        return misfit + 0.5 * n * (math.log(noise.white ** 2 / scale) + scale / noise.white ** 2)

    def evaluate(self, x, count=False, restricted=True):
        """Misfit, the white variance that is best, and, where asked for, how many values tell it."""
        d, ratio, memory = self.size, math.exp(2 * x[0]), math.exp(x[1])
        phi = math.exp(-self.step / memory)
        mean = (1 - phi ** d) / (d * (1 - phi))
        own = ratio * (1 + 2 * phi / (1 - phi) * (1 - mean)) / d  # variance of a mean of the slow part
        shared = ratio * mean ** 2 * phi ** (1 - d)  # of which goes on to the next, times phi^d
        slow = d * shared * self.chain.variance(memory)
        filtered = _gains(self.chain.kept(memory), slow, 1 + d * (own - shared))
        white = _innovations(self.rows, *filtered)
        spread = filtered[2]
        a, b = white[:-1] @ white[:-1].T, white[:-1] @ white[-1]
        free = np.diag(a) > 0
        a, b = a[np.ix_(free, free)], b[free]
        values, vectors = np.linalg.eigh(a)
        seen = values > 1e-10 * values.max(initial=0.0)
        left = white[-1] @ white[-1] - ((b @ vectors[:, seen]) ** 2 / values[seen]).sum()
        scatter = 1 + (ratio - own) * d / (d - 1) if d > 1 else 1.0
        n = len(spread) + self.count - (len(b) if restricted else 0)
        scale = max((left + self.within / scatter) / n, 1e-300)
        logs = 2 * np.log(spread).sum() + self.count * math.log(scatter)
        if restricted and len(a):
            logs += np.log(np.maximum(values, 1e-10)).sum()
        misfit = 0.5 * (n * math.log(scale) + logs)
        return (misfit, scale, n) if count else (misfit, scale)


def contiguous(time, group):
    """Slices of samples that follow each other in time within one group, in order.

    Parameters
    ----------
    time : ndarray, shape (n,)
        [s]
    group : ndarray, shape (n,)
        Pass of each sample.

    Returns
    -------
    list of slice

    Examples
    --------
    A gap of many sampling intervals ends a slice:

    >>> [len(range(4)[s]) for s in contiguous(np.array([0.0, 0.1, 0.2, 0.9]), np.zeros(4))]
    [3, 1]
    """
    if len(time) == 0:
        return []
    gap = np.diff(time)
    usual = np.median(gap[gap > 0]) if (gap > 0).any() else 1.0
    cut = np.flatnonzero((gap > 3 * usual) | (gap <= 0) | (np.diff(group) != 0)) + 1
    edges = np.r_[0, cut, len(time)]
    return [slice(a, b) for a, b in zip(edges[:-1], edges[1:])]

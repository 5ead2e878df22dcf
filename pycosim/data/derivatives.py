"""Angles and measured speeds over time in; speeds and accelerations that do not lag, and how sure they are, out.

A smoothing spline: the curve that passes the angles, and the speeds where they were measured, as near as their noise
allows with the least jerk. Up to which frequency it follows them is read off the record: the density of the
acceleration falls with the frequency as the motion does, and rises with it as the noise of a sensor does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import isotonic_regression
from scipy.sparse import block_diag, csr_array, diags_array

from ..core.errors import DataError

_LEAST = 5
_DEGREE, _ORDER = 5, 3  # of the splines; of the derivative whose size is the roughness, the jerk
_GAP = 10.0  # sample intervals without a sample, over which nothing is known
_SEGMENT = 2048  # samples of one spectrum
_BINS = 4  # of an octave, in which a density is averaged
_MOTION = 0.99  # of the variance of an angle, below whose frequency is motion
_REACH, _LOOSE = 6.0, 0.3  # time constants near an end, and the share of the time constant that is left there
_TRIED = 60  # bandwidths
_SHORT = 16  # samples, of which no spectrum is worth taking
_KNOTS = 0.5  # distance of the knots, over the time constant of the bandwidth
AWAY = 3.0
"""Root mean square of what an angle is off its curve, over its noise, beyond which the curve does not follow it. Of 32
ends of records in motion, of two generators that were written apart, it was 0.9 to 2.5 at ten, and 3 to 53 at those
where the motion sets off or stops faster than it goes on: forces of 0.2 N of noise were up to 160 N off there."""
_SAME = 1e-7  # of the travel: rounding of numbers; no sensor resolves less


# --- resolution -----------------------------------------------------------------------------------------------------


def resolution(values, time=None):
    """Step of a quantised signal, or the step that would scatter like its noise, whichever is larger.

    Parameters
    ----------
    values : ndarray, shape (n,)
        One signal in the order of time, in any unit.
    time : ndarray, shape (n,), optional
        Of the samples, strictly increasing, in any unit; even by default. What moves steadily between uneven samples is
        no noise, nor is what times that were rounded make of even ones.

    Returns
    -------
    float
        In the unit of the values; 0.0 for a constant.
    """
    steps = np.abs(np.diff(values))
    steps = steps[steps > 0]
    if steps.size == 0 or values.size < _LEAST:
        return 0.0
    travel = np.abs(values[3:] - values[:-3])
    slow = travel <= np.median(travel)  # jerk and uneven clocks show in fast motion
    noise = min(1.4826 * np.median(np.abs(u[slow] - np.median(u[slow]))) for u in _unsmooth(values, time))
    # the smallest step of a continuous signal is rounding, not an encoder's: an encoder's repeats
    smallest = steps.min()
    multiples = steps / smallest
    quantised = np.mean(np.abs(multiples - np.round(multiples)) < 0.01) > 0.99 and multiples.max() < 1e3
    return float(max(noise * np.sqrt(12.0), smallest if quantised else 0.0))


def _unsmooth(values, time):
    """What no parabola through four samples explains, as if they were even, and at their times; scatter as a sample."""
    found = [np.diff(values, 3) / np.sqrt(20.0)]
    if time is not None:
        four = [time[k:len(time) - 3 + k] for k in range(4)]
        weights = np.array([1 / np.prod([own - other for other in four[:k] + four[k + 1:]], axis=0)
                            for k, own in enumerate(four)])
        told = sum(w * values[k:len(values) - 3 + k] for k, w in enumerate(weights))
        found.append(told / np.sqrt((weights**2).sum(axis=0)))
    return found


# --- derivatives ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Derivatives:
    """What a record of an angle says of its speed and acceleration.

    Attributes
    ----------
    first, second : ndarray, shape (n,)
        In the unit of the angle per s and per s2.
    noise : float
        Standard deviation of the first, well inside the record.
    bandwidth : float
        Frequency [Hz] up to which the record was followed.
    unsure : ndarray of bool, shape (n,)
        Samples near an end of the record, which sets off or stops there faster than it was followed.
    trust : float
        Noise of a measured speed over that of the angle, counted in sample intervals; infinite where no speed was used.
    """

    first: np.ndarray
    second: np.ndarray
    noise: float
    bandwidth: float
    unsure: np.ndarray
    trust: float = math.inf


def passed_on(time, bandwidth, trust):
    """The smooth motion behind a record, or what errors of it become there: linear once the bandwidth is chosen.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Strictly increasing [s].
    bandwidth, trust : float
        As `Derivatives` says; the bandwidth above zero.

    Returns
    -------
    callable
        Takes the angle and, where it was used, the speed, or their errors, ndarrays of shape (n,); gives the angle,
        the first and the second derivative, or theirs.
    """
    step = float(np.median(np.diff(time)))
    band = 2 * math.pi * step * bandwidth
    curve = _Curve((time - time[0]) / step, band)
    fitted = curve.fits(band, trust)

    def follow(angle, speed):
        found = fitted(angle, speed * step)
        return curve.value @ found, curve.first @ found / step, curve.second @ found / step**2
    return follow


def derivatives(time, angle, speed=None):
    """First and second derivative of the smooth motion behind an angle and, if there is one, its measured speed.

    Nothing lags: samples before and after count alike. The result is that of the same motion in other units, times
    their ratio. Sampling may be irregular; over gaps nothing is smoothed.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Strictly increasing [s].
    angle : ndarray, shape (n,)
        [rad], or another unit.
    speed : ndarray, shape (n,), optional
        In the same unit per s. Believed as far as it agrees with the angle: one that lags counts for little.

    Returns
    -------
    Derivatives

    Raises
    ------
    DataError
        Fewer than five samples.

    References
    ----------
    .. [1] Reinsch, C. H. (1967). Smoothing by spline functions. Numerische Mathematik 10.
    """
    if len(time) < _LEAST:
        raise DataError(f"{len(time)} samples are too few for a derivative; at least {_LEAST} are needed")
    step = float(np.median(np.diff(time)))
    seen = max(resolution(angle, time) / np.sqrt(12.0), _SAME * float(np.ptp(angle)))
    if seen == 0.0:
        return Derivatives(np.zeros(len(time)), np.zeros(len(time)), 0.0, 0.0, np.zeros(len(time), bool))
    u, y = (time - time[0]) / step, (angle - angle[0]) / seen
    band = _bandwidth(u, y, 2)
    curve, trust = _Curve(u, band), math.inf
    found = curve.fit(y, band)
    noise = max(1.0, float(np.std(y - curve.value @ found)))
    scatter = noise * math.sqrt(band**3 / 6)  # of the slope, of white noise below the bandwidth
    if speed is not None:
        v = speed * (step / seen)
        apart = 1.4826 * np.median(np.abs(v - curve.first @ found))  # the ends of a curve are less sure
        spread = max(resolution(v, u) / np.sqrt(12.0), math.sqrt(max(apart**2 - scatter**2, 0.0)),
                     _SAME * np.abs(v).max(), _lagging(v - curve.first @ found, curve.second @ found))
        if spread < noise:  # else it says less of every frequency than the angle does
            if spread < noise * band:  # else what the angle hardly tells of there is less than the speed's own noise
                band = max(band, _bandwidth(u, v, 1))
            curve, trust = _Curve(u, band), spread / noise
            found = curve.fit(y / noise, band, v / noise, trust) * noise
            scatter = min(scatter, spread)
    return Derivatives(curve.first @ found * (seen / step), curve.second @ found * (seen / step**2),
                       float(scatter * seen / step), band / (2 * math.pi * step),
                       _unsure(u, y - curve.value @ found, 2 * math.pi / band), trust)


def _unsure(u, off, period):
    """Samples within a period of the bandwidth of either end, where half of that is further off the curve than noise.

    Inside the record a curve sees what comes before and after. Where it ends in a motion, the curve has one side, and
    goes on as smoothly as the whole: a chirp that set off within 60 ms was 1.6 m/s2 off there, for one of 3.9.
    """
    usual = AWAY * max(1.0, 1.4826 * np.median(np.abs(off)))
    found = np.zeros(len(u), bool)
    for from_end in (u - u[0], u[-1] - u):
        near = from_end < max(period / 2, _LEAST)
        if np.sqrt(np.mean(off[near]**2)) > usual:
            found |= from_end < max(period, _LEAST)
    return found


def _lagging(off, acceleration):
    """How far a speed is off by coming late: most samples hardly accelerate, and show little of it."""
    size = math.sqrt(np.mean(acceleration**2))
    return abs(np.mean(off * acceleration)) / size if size else 0.0


def _bandwidth(u, values, order):
    """Bandwidth with which a curve misses least of the motion and takes least of the noise with it [rad a sample].

    The difference of this order of the values is the acceleration. Its density falls where it is that of the motion and
    rises where it is that of noise.
    """
    edges = np.r_[0, np.flatnonzero(np.diff(u) > _GAP) + 1, len(u)]
    change = np.concatenate([_changes(u[a:b], values[a:b], order) for a, b in zip(edges[:-1], edges[1:])])
    if len(change) < _SHORT:
        return math.pi
    from scipy.signal import welch  # only now: it takes as long to import as an export takes

    frequency, density = welch(change, 2 * math.pi, nperseg=min(len(change), _SEGMENT), detrend=False)
    frequency, density = frequency[1:], np.maximum(density[1:], 1e-300)
    # a difference shrinks what is slow; undone, the values' own density says where the motion is
    motion = np.cumsum(density / frequency**(2 * order))
    slow = np.searchsorted(motion, _MOTION * motion[-1])
    first = int(np.argmax(density[:slow + 1]))
    number = np.floor(_BINS * np.log2(frequency[first:] / frequency[first])).astype(int)
    number = np.unique(number, return_inverse=True)[1]
    count = np.bincount(number)
    level = np.log(np.bincount(number, density[first:]) / count)
    centre = np.bincount(number, frequency[first:]) / count
    turn = centre[_turn(level, np.sqrt(count))]
    tried = np.geomspace(turn / 2, math.pi, _TRIED)
    # how a curve of least jerk lets go of angles, or of speeds
    lost = 1.0 - 1.0 / (1.0 + (frequency / tried[:, None])**(2 * (_ORDER - 2 + order)))
    error = np.where(frequency < turn, lost, 1.0 - lost)**2 @ density
    return float(tried[np.argmin(error)])


def _changes(u, values, order):
    """Differences of an unbroken record at even steps; over a gap nothing moved evenly."""
    return np.diff(np.interp(np.arange(math.floor(u[0]), math.floor(u[-1]) + 1.0), u, values), order)


def _turn(level, weight):
    """Index at which values that fall and then rise, but for their scatter, turn."""
    def misfit(values, weights, rising):
        if not len(values):
            return 0.0
        return weights @ (values - isotonic_regression(values, weights=weights, increasing=rising).x)**2
    errors = [misfit(level[:k], weight[:k], False) + misfit(level[k:], weight[k:], True)
              for k in range(1, len(level) + 1)]
    return int(np.flatnonzero(np.array(errors) <= min(errors) * (1 + 1e-6))[-1])  # rounding decides no draw


class _Curve:
    """Splines through samples at times ``u``, counted in sample intervals."""

    def __init__(self, u, band):
        cut, edges = [int(k) for k in np.flatnonzero(np.diff(u) > _GAP) + 1], [0]
        for k in cut:  # what is too short for a curve of its own goes with its neighbour
            if k - edges[-1] >= _LEAST and len(u) - k >= _LEAST:
                edges.append(k)
        edges.append(len(u))
        parts = [_matrices(u[a:b], max(1.0, _KNOTS / band), _REACH / band) for a, b in zip(edges, edges[1:])]
        self.value, self.first, self.second, self.rough = (
            csr_array(block_diag([p[k] for p in parts])) for k in range(4))

    def fit(self, y, band, v=None, spread=math.inf):
        """Coefficients of the curve that follows values, and slopes with this noise, up to a bandwidth."""
        return self.fits(band, spread)(y, v)

    def fits(self, band, spread=math.inf):
        """The same as a function of values and slopes, which are left out where their noise is infinite."""
        # as much is known of the motion as the data tell, where its bandwidth ends
        weight, told = (1.0 + (band / spread)**2) / band**6, math.isfinite(spread)
        matrix, value = self.value.T @ self.value + weight * self.rough, self.value.T.tocsr()
        if told:
            matrix, first = matrix + self.first.T @ self.first / spread**2, self.first.T.tocsr() / spread**2
        factor = cholesky_banded(_bands(matrix), lower=True)
        return lambda y, v: cho_solve_banded((factor, True), value @ y + (first @ v if told else 0.0))


def _matrices(u, apart, reach):
    """Spline to values, first and second derivative at the samples, and the roughness between the knots.

    Within ``reach`` of the ends roughness counts for less: there the curve of least jerk would end without any.
    """
    inner = np.linspace(u[0], u[-1], max(1, math.ceil((u[-1] - u[0]) / apart)) + 1)
    knots = np.r_[np.full(_DEGREE, u[0]), inner, np.full(_DEGREE, u[-1])]
    slopes, designs = None, []
    count = len(knots) - _DEGREE - 1
    for order in range(_ORDER + 1):
        degree, some = _DEGREE - order, knots[order:len(knots) - order]
        if order:
            width = (degree + 1) / (knots[_DEGREE + 1:_DEGREE + 1 + count - order] - knots[order:count])
            change = diags_array([-width, width], offsets=[0, 1], shape=(count - order, count - order + 1))
            slopes = change if slopes is None else change @ slopes
        if order < _ORDER:
            design = csr_array(BSpline.design_matrix(u, some, degree))
            designs.append(design if slopes is None else csr_array(design @ slopes))
    nodes, weights = np.polynomial.legendre.leggauss(_ORDER)
    half = np.diff(inner)[:, None] / 2
    there = ((inner[:-1] + inner[1:])[:, None] / 2 + half * nodes).ravel()
    jerk = csr_array(BSpline.design_matrix(there, some, degree)) @ slopes
    inside = np.minimum(there - u[0], u[-1] - there) / reach
    weight = np.minimum(inside + _LOOSE, 1.0)**3
    jerk = diags_array(np.sqrt((half * weights).ravel()) * weight) @ jerk
    return [*designs, csr_array(jerk.T @ jerk)]


def _bands(matrix):
    """Lower diagonals of a symmetric matrix, as LAPACK wants them."""
    found = np.zeros((_DEGREE + 1, matrix.shape[0]))
    for k in range(min(_DEGREE + 1, matrix.shape[0])):
        found[k, :matrix.shape[0] - k] = matrix.diagonal(-k)
    return found

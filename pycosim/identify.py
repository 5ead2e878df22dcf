"""Data set and model in, parameters with intervals, and what the data cannot tell, out.

The fit is a bounded nonlinear least-squares problem. Its residual enters only through the moments [J r]'[J r], which are
summed block by block, so memory does not grow with the log and a solver for small problems serves logs of any length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy import stats
from scipy.optimize import least_squares

from .noise import contiguous, fit_noise

NULL = 1e-9  # eigenvalue of the scaled normal matrix below which a direction is not determined
WEAK = 1e-3


@dataclass
class Fit:
    """Result of an identification.

    Attributes
    ----------
    parameters : dict of str to float
        All parameters, fitted and fixed.
    free : list of str
    variables : dict of str to Variable
        Units and bounds.
    values : ndarray, shape (p,)
    unbounded : ndarray, shape (p,)
        Estimate with the bounds lifted, of the quadratic model at the solution; intervals are centred on it.
    covariance : ndarray, shape (p, p)
    null_directions : ndarray, shape (k, p)
        Directions of the parameters that change no residual.
    dof : float
        Degrees of freedom for the quantile of the intervals.
    noise : list of Noise
        One a channel.
    channels : list of str
    weights : ndarray, shape (channels,)
    """

    parameters: dict
    free: list
    variables: dict
    values: np.ndarray
    unbounded: np.ndarray
    covariance: np.ndarray
    null_directions: np.ndarray
    dof: float
    noise: list
    channels: list
    weights: np.ndarray
    error: dict = field(default_factory=dict)

    @property
    def stderr(self):
        """Standard errors, infinite along null directions."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self):
        """Correlation matrix of the estimates."""
        s = np.where(self.stderr > 0, self.stderr, 1.0)
        return self.covariance / np.outer(s, s)

    def identifiable(self, name):
        """Whether the data determine this parameter by itself."""
        k = self.free.index(name)
        scale = np.array([self.variables[n].nominal for n in self.free])
        return not any(abs(d[k] / scale[k]) > 1e-4 * np.max(np.abs(d / scale)) for d in self.null_directions)

    def at_bound(self, name):
        """``"min"``, ``"max"`` or None."""
        k, v = self.free.index(name), self.variables[name]
        tolerance = 1e-6 * v.nominal
        if self.values[k] <= v.min + tolerance:
            return "min"
        return "max" if self.values[k] >= v.max - tolerance else None

    def interval(self, name, level=0.95):
        """Confidence interval of a parameter, within its bounds.

        Centred on the estimate with the bounds lifted, so that a neighbour at its bound does not make it too narrow.
        Along a null direction: what the bounds alone allow.
        """
        k, v = self.free.index(name), self.variables[name]
        if not self.identifiable(name):
            return self._range_by_bounds(k)
        half = stats.t.ppf(0.5 + level / 2, self.dof) * self.stderr[k]
        low, high = self.unbounded[k] - half, self.unbounded[k] + half
        if high < v.min:
            high = v.min + half
        if low > v.max:
            low = v.max - half
        return [float(max(low, v.min)), float(min(high, v.max))]

    def _range_by_bounds(self, k):
        low, high = [], []
        for d in self.null_directions:
            reach = [self._reach(d), self._reach(-d)]
            ends = [self.values[k] + reach[0] * d[k], self.values[k] - reach[1] * d[k]]
            low.append(min(ends))
            high.append(max(ends))
        return [float(min(low)), float(max(high))]

    def _reach(self, d):
        reach = math.inf
        for value, name, step in zip(self.values, self.free, d):
            v = self.variables[name]
            if abs(step) > 1e-12 * np.max(np.abs(d)):
                reach = min(reach, ((v.max if step > 0 else v.min) - value) / step)
        return reach


def fit(dataset, model, start=None, free=None, part="fit", robust=False):
    """Fit a model's free parameters to a data set.

    Parameters
    ----------
    dataset : Dataset
    model : Model
    start : dict of str to float, optional
        Values to start from; the study's by default.
    free : list of str, optional
        The study's free parameters, those of the attached effects included, by default.
    part : str or ndarray of int
        ``"fit"``, ``"test"``, ``"all"``, or the blocks to use.
    robust : bool
        Weigh samples down that are far out (Huber).

    Returns
    -------
    Fit
    """
    variables = dataset.variables(model)
    parameters = {**{n: v.value for n, v in variables.items()}, **dataset.values(model), **(start or {})}
    free = dataset.free(model) if free is None else list(free)
    problem = dataset.residuals(model, free, parameters, part)
    weights = np.ones(len(problem.channels)) if len(problem.channels) == 1 else None
    x = np.array([_inside(parameters[n], variables[n]) for n in free])
    thin = max(1, problem.n // 4000)
    if thin > 1:
        coarse = problem.thin(thin)
        x, weights = _solve(coarse, x, free, variables, weights, 60, robust)
    x, weights = _solve(problem, x, free, variables, weights, 60 if thin == 1 else 15, robust)
    return _result(dataset, problem, x, free, variables, weights)


def _inside(value, variable):
    """Start strictly inside the bounds, where derivatives are two-sided."""
    margin = 1e-6 * variable.nominal
    return min(max(value, variable.min + margin), variable.max - margin)


def channel_weights(problem, x):
    """One over the rough noise of each channel, from differences of neighbouring residuals; blind to what is smooth."""
    residual = problem.residual(x)
    spread = np.array([np.std(np.diff(r)) for r in residual]) + 1e-12
    level = np.array([np.sqrt(np.mean(r ** 2)) for r in residual]) + 1e-12
    spread = np.maximum(spread / math.sqrt(2), 0.05 * level)
    return np.exp(np.mean(np.log(spread))) / spread


def _solve(problem, x, free, variables, weights, evaluations, robust):
    if not free:
        return x, np.ones(len(problem.channels)) if weights is None else weights
    if weights is None:
        weights = channel_weights(problem, x)
    lower = np.array([variables[n].min for n in free])
    upper = np.array([variables[n].max for n in free])
    scale = np.array([variables[n].nominal for n in free])
    rows = {}

    def root(z):
        key = z.tobytes()
        if key not in rows:
            rows.clear()
            gram = problem.gram(z, weights, robust)
            values, vectors = np.linalg.eigh(gram)
            rows[key] = np.sqrt(np.maximum(values, 0))[:, None] * vectors.T
        return rows[key]

    solution = least_squares(
        lambda z: -root(z)[:, -1], x, jac=lambda z: root(z)[:, :-1], bounds=(lower, upper), x_scale=scale,
        xtol=1e-9, ftol=1e-10, gtol=1e-12, max_nfev=evaluations)
    margin = 1e-6 * scale
    return np.clip(solution.x, lower + margin, upper - margin), weights


def _result(dataset, problem, x, free, variables, weights):
    """Covariance, null directions and noise at the solution."""
    blocks = [(r, j) for _, r, j in problem.blocks(x)]
    residual = np.concatenate([r for r, _ in blocks], axis=1)
    slope = np.concatenate([j for _, j in blocks], axis=2)
    pieces = contiguous(problem.time, problem.group)
    noise = [fit_noise([r[s] for s in pieces]) for r in residual]
    normal = sum(w ** 2 * j @ j.T for w, j in zip(weights, slope))
    gradient = sum(w ** 2 * j @ r for w, j, r in zip(weights, slope, residual))
    inverse, null = invert(normal)
    meat = np.zeros_like(normal)
    for w, j, r_noise in zip(weights, slope, noise):
        for s in pieces:
            meat += w ** 4 * j[:, s] @ r_noise.colour(j[:, s]).T
    covariance = inverse @ meat @ inverse
    covariance = np.maximum(covariance, 0) * np.eye(len(free)) if len(free) == 0 else covariance
    samples = sum(1 / (1 + 2 * n.slow ** 2 / (n.slow ** 2 + n.white ** 2 + 1e-300) * n.phi / (1 - n.phi + 1e-12))
                  for n in noise) * problem.n
    dof = max(1.0, min(samples, 1e6) - len(free))
    fitted = Fit({**problem.parameters, **dict(zip(free, map(float, x)))}, free, variables, x,
                 x + inverse @ gradient, covariance, null, dof, noise, problem.channels, weights)
    fitted.error = {c: float(np.sqrt(np.mean(r ** 2))) for c, r in zip(problem.channels, residual)}
    return fitted


def invert(normal):
    """Pseudo-inverse of a normal matrix, and the directions that it does not determine.

    Returns
    -------
    inverse : ndarray, shape (p, p)
    null : ndarray, shape (k, p)
        In the parameters' own units.
    """
    if len(normal) == 0:
        return normal, np.zeros((0, 0))
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    dead = np.diag(normal) <= 1e-24 * max(np.max(np.diag(normal)), 1e-300)
    scaled = normal / np.outer(scale, scale)
    scaled[dead, :] = scaled[:, dead] = 0.0
    values, vectors = np.linalg.eigh(scaled)
    kept = values > NULL
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T / np.outer(scale, scale)
    null = vectors[:, ~kept].T / np.where(dead, 1.0, scale)
    return inverse, null / np.maximum(np.max(np.abs(null), axis=1, keepdims=True), 1e-300) if len(null) else null

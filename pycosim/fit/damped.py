"""Moments of a weighted residual and its derivative in; where the squares are least within bounds, out.

Why not SciPy's: `docs/explanation/identification.md`, measured by ``benchmarks.speed.solver``.
"""

from __future__ import annotations

import numpy as np

from ..core.errors import NoAnswerError
from .bounded import bounded

ENOUGH = 1e-7  # of the squares, by which a step must lower them for another to be worth its while
FIRST, LEAST = 1e-3, 1e-12  # damping at the start, and at least
TAKEN = 1e-3  # of the fall that the moments promise, from which on a step is taken


def solve(gram, x, free, low, high, evaluations, enough=ENOUGH):
    """Damped Gauss-Newton steps, each the best within the bounds by the moments at hand.

    Parameters
    ----------
    gram : callable
        Takes values of the free parameters; returns [J r]'[J r], shape (p + 1, p + 1).
    x : ndarray, shape (p,)
        Values to start from.
    free : list of str
        Names of the parameters.
    low, high : ndarray, shape (p,)
        Bounds, in the units of the parameters.
    evaluations : int
        Moments that are asked for at most.
    enough : float
        Part of the squares by which a step must lower them for another to be worth its while.

    Returns
    -------
    ndarray, shape (p,)
        The best that was found.

    Raises
    ------
    NoAnswerError
        The model has no finite answer at the start.

    References
    ----------
    .. [1] Marquardt, D. W. (1963). An algorithm for least-squares estimation of nonlinear parameters. Journal of the
           Society for Industrial and Applied Mathematics 11(2): steps damped in units of the derivative.
    .. [2] More, J. J. (1978). The Levenberg-Marquardt algorithm: implementation and theory. Lecture Notes in
           Mathematics 630: units that never shrink.
    .. [3] Nielsen, H. B. (1999). Damping parameter in Marquardt's method. DTU, IMM-REP-1999-05.
    """
    x = np.clip(x, low, high)
    g = gram(x)
    if not np.isfinite(g).all():
        raise NoAnswerError(f"the model has no finite answer at the start, {listed(free, x)}; start elsewhere")
    damping, growth, units = FIRST, 2.0, np.zeros(len(x))
    for _ in range(evaluations - 1):
        a, b, squares = g[:-1, :-1], g[:-1, -1], g[-1, -1]
        units = np.maximum(units, np.diag(a))
        there = np.clip(x + bounded(a + damping * np.diag(units), b, low - x, high - x)[1], low, high)
        promised = 2 * (there - x) @ b - (there - x) @ a @ (there - x)
        if not promised > enough * squares:  # nothing is left to gain, where nothing is left at all too
            break
        after = gram(there)
        kept = (squares - after[-1, -1]) / promised if np.isfinite(after).all() else -np.inf
        if kept < TAKEN:  # far from where the derivatives hold
            damping, growth = growth * max(damping, LEAST), 2 * growth
            continue
        x, g = there, after
        damping, growth = max(damping * max(0.1, 1 - (2 * kept - 1) ** 3), LEAST), 2.0
        if kept * promised < enough * squares:
            break
    return x


def listed(names, values):
    """Parameters and their values in words.

    Parameters
    ----------
    names : sequence of str
        Of parameters.
    values : sequence of float
        One a name, in its unit.

    Returns
    -------
    str
        As ``s1A.f0 = 0.04, s1A.mu = 0.9``.
    """
    return ", ".join(f"{n} = {v:.4g}" for n, v in zip(names, values))

"""A quadratic form and bounds in; where it is greatest within them, and how great, out."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs
from scipy.optimize import lsq_linear

NULL = 1e-9  # eigenvalue of the scaled normal matrix below which a direction is not determined


def _pressed(a, b, low, high, held):
    """Solution with what leaves the bounds pressed against them, one let go where that is better; None if not found.

    ``held`` is -1 and 1 for what is pressed from the start, low and high.
    """
    enough = 1e-9 * np.abs(b).max(initial=0.0)
    for _ in range(3 * len(b) + 1):
        free = held == 0
        x = np.where(held < 0, low, np.where(held > 0, high, 0.0))
        if free.any():
            rows = a[free]
            factor, failed = dpotrf(rows[:, free])
            if failed or factor.diagonal().min() < math.sqrt(NULL):
                return None
            x[free] = dpotrs(factor, b[free] - rows[:, ~free] @ x[~free])[0]
        out = np.where(x < low, -1, np.where(x > high, 1, 0)) * free
        if out.any():
            held = held + out
            continue
        inward = (a @ x - b) * held  # uphill must point out of the bounds
        if np.all(inward <= enough):
            return x
        held[np.argmax(inward)] = 0
    return None


def bounded(a, b, low, high, near=None):
    """Maximise ``2 b'x - x'a x`` within bounds.

    Parameters
    ----------
    a : ndarray, shape (p, p)
        Positive semidefinite.
    b, low, high : ndarray, shape (p,)
        Slope at zero, and the bounds of x; infinite where there is none.
    near : ndarray, shape (p,), optional
        The solution of a problem much like it: what is at a bound there is tried there first.

    Returns
    -------
    value : float
    x : ndarray, shape (p,)
    """
    held = np.zeros(len(b), dtype=int) if near is None else (near >= high).astype(int) - (near <= low)
    seen = np.diag(a) > 0  # beside nothing, what is shared is the rounding of a difference
    scale = np.sqrt(np.where(seen, np.diag(a), 1.0))
    s, low, high = a / np.outer(scale, scale), low * scale, np.maximum(high, low + 1e-12) * scale
    if not seen.all():
        s[~seen, :] = s[:, ~seen] = 0.0
    x = _pressed(s, b / scale, low, high, held)
    if x is None:
        values, vectors = np.linalg.eigh(s)
        keep = values > NULL
        root = np.sqrt(np.where(keep, values, 0))[:, None] * vectors.T
        right = np.where(keep, vectors.T @ (b / scale) / np.sqrt(np.where(keep, values, 1)), 0)
        x = vectors[:, keep] @ (right[keep] / np.sqrt(values[keep]))
        if np.any(x < low) or np.any(x > high):
            x = lsq_linear(root, right, (low, high), method="bvls").x
    x = x / scale
    return float(2 * b @ x - x @ a @ x), x

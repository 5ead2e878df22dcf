"""Friction states along a log: motion in, states (and what they owe to the parameters) out.

A friction state follows ``x' = a x + b`` with ``a`` and ``b`` of the speed, stiff when its travel is short. Each step is
exact for inputs held at their mean over it, and the steps of a whole log are a linear recursion.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from .compile import ArrayFunction
from .errors import ModelicaError


def dependent_parameters(question):
    """Names of the parameters that the friction states, or the times at which signals are taken, depend on."""
    u, x, p = question.symbols()
    rate = ca.vertcat(question.rate(u, x, p), question.select(list(question.late.values())).output(u, x, p))
    return [n for n, s in zip(question.parameters, ca.vertsplit(p)) if rate.numel() and ca.depends_on(rate, s)]


def _step(question, free):
    """Growth and drive of one step, ``x+ = growth x + drive``, and their derivatives by the free parameters."""
    u, x, p = question.symbols()
    h = ca.SX.sym("h")
    rate = question.rate(u, x, p)
    slope = ca.jacobian(rate, x)
    if any(r != c for r, c in zip(*slope.sparsity().get_triplet())) or ca.depends_on(slope, x):
        raise ModelicaError(f"the states {', '.join(question.states)} are not each linear in themselves at a given "
                            "speed; write an effect's state as x' = a(w) x + b(w)")
    y = ca.densify(ca.diag(slope)) * h
    series = ca.if_else(ca.fabs(y) > 1e-6, (ca.exp(y) - 1) / ca.if_else(y == 0, 1, y), 1 + y / 2)
    parts = ca.vertcat(ca.exp(y), ca.substitute(rate, x, ca.DM.zeros(x.numel())) * h * series)
    columns = [ca.jacobian(parts, p[question.parameters.index(n)]) for n in free]
    return ArrayFunction(ca.Function("step", [u, p, h], [ca.densify(ca.horzcat(parts, *columns))]))


def propagate(question, signals, time, parameters, run=None, free=()):
    """Friction states at every sample of one or several logs, from zero at the start of each.

    Parameters
    ----------
    question : Question
    signals : dict of str to ndarray, shape (n,)
        Inputs of the question; those that the states do not need may be missing. Where an angle is given, what it moved
        between samples is used rather than its speed.
    time : ndarray, shape (n,)
    parameters : dict of str to float
    run : ndarray, shape (n,), optional
        Index of the log a sample belongs to.
    free : list of str
        Parameters whose sensitivities are wanted too.

    Returns
    -------
    states : ndarray, shape (number of states, n)
    sensitivities : ndarray, shape (len(free), number of states, n)

    Raises
    ------
    ModelicaError
        A state is coupled to another, or not linear in itself.
    """
    n, m = len(time), len(question.states)
    if m == 0 or n < 2:
        return np.zeros((m, n)), np.zeros((len(free), m, n))
    h = np.diff(time)
    inputs = []
    for name in question.inputs:
        angle = signals.get(name[4:-1]) if name.startswith("der(") else None
        if isinstance(angle, np.ndarray):
            inputs.append(np.diff(angle) / np.where(h == 0, 1, h))
        else:
            value = np.broadcast_to(signals.get(name, 0.0), n)
            inputs.append((value[1:] + value[:-1]) / 2)
    values = _step(question, free)([*inputs, *[float(parameters[p]) for p in question.parameters], h], n - 1)
    growth, drive, *rest = values.reshape(-1, m, n - 1)
    if run is not None:  # a new log starts from zero
        new = run[1:] != run[:-1]
        for part in (growth, drive, *rest):
            part[:, new] = 0.0
    states = scan(growth, drive)
    sensitivities = [scan(growth, dg * states[:, :-1] + dd) for dg, dd in zip(rest[::2], rest[1::2])]
    return states, np.array(sensitivities).reshape(len(free), m, n)


def scan(growth, drive):
    """Solve ``x[k + 1] = growth[k] x[k] + drive[k]`` from zero, along the last axis.

    The axis is cut into rows that advance side by side, then the end of each row starts the next: the number of steps
    in Python is the square root of the length.
    """
    m, n = growth.shape
    width = int(np.ceil(np.sqrt(n)))
    rows = -(-n // width)
    fill = ((0, 0), (0, rows * width - n))
    a, b = (np.pad(v, fill).reshape(m, rows, width) for v in (growth, drive))
    total, x = np.multiply.accumulate(a, axis=2), b.copy()
    for k in range(1, width):
        x[:, :, k] += a[:, :, k] * x[:, :, k - 1]
    for r in range(1, rows):
        x[:, r] += total[:, r] * x[:, r - 1, -1:]
    return np.hstack([np.zeros((m, 1)), x.reshape(m, -1)[:, :n]])

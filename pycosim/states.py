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
    """Names of the parameters that the friction states depend on."""
    if "_dependent" not in question.__dict__:
        u, x, p = question.symbols()
        used = {s.name() for s in ca.symvar(question.rate(u, x, p))}
        question._dependent = [n for n, s in zip(question.parameters, ca.vertsplit(p))
                               if question.states and s.name() in used]
    return question._dependent


def _step(question, free):
    """Growth and drive of one step, ``x+ = growth x + drive``, and their derivatives by the free parameters; made once."""
    made = question.__dict__.setdefault("_steps", {})
    if tuple(free) not in made:
        made[tuple(free)] = _make_step(question, free)
    return made[tuple(free)]


def _make_step(question, free):
    u, x, p = question.symbols()
    h = ca.SX.sym("h")
    rate = question.rate(u, x, p)
    slope = ca.jacobian(rate, x)
    if any(r != c for r, c in zip(*slope.sparsity().get_triplet())) or ca.depends_on(slope, x):
        raise ModelicaError(f"the states {', '.join(question.states)} are not each linear in themselves at a given "
                            "speed; write an effect's state as x' = a(w) x + b(w)")
    y = ca.densify(ca.diag(slope)) * h
    near = y - 1e-12  # never zero where nothing moves
    series = ca.expm1(near) / near
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

    The axis is cut into rows that advance side by side, then the end of each row starts the next.
    """
    m, n = growth.shape
    width = int(np.ceil(np.sqrt(n) / 4))
    rows = -(-n // width)
    fill = ((0, 0), (0, rows * width - n))
    total, x = (np.pad(v, fill).reshape(m, rows, width).transpose(2, 0, 1).copy() for v in (growth, drive))
    for k in range(1, width):
        x[k] += total[k] * x[k - 1]
        total[k] *= total[k - 1]
    start = np.zeros((m, rows))
    for row, growths, ends in zip(start, total[-1].tolist(), x[-1].tolist()):
        value = 0.0
        for r, (g, end) in enumerate(zip(growths, ends)):
            row[r] = value
            value = g * value + end
    x += total * start
    return np.hstack([np.zeros((m, 1)), x.transpose(1, 2, 0).reshape(m, -1)[:, :n]])

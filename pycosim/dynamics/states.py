"""Friction states along a log: motion in, states (and their derivatives by the parameters) out.

With its inputs held, a friction state moves at a rate of one or two straight pieces, stiff when its travel is short.
Each step is exact for inputs held at their mean over it. Where the rate is one piece, ``x' = a x + b``, the steps of a
whole log are a linear recursion.
"""

from __future__ import annotations

import inspect
from functools import cached_property

import casadi as ca
import numpy as np

from ..compile import ArrayFunction
from ..core.errors import ModelicaError


def dependent_parameters(question):
    """Names of the parameters that the friction states, or the times at which signals are taken, depend on.

    Parameters
    ----------
    question : Question
        With or without friction states.

    Returns
    -------
    list of str
    """
    def make():
        u, x, p = question.symbols()
        late = question.select(list(question.late.values())).output(u, x, p)
        used = {s.name() for s in ca.symvar(ca.vertcat(question.rate(u, x, p), late))}
        return [n for n, s in zip(question.parameters, ca.vertsplit(p)) if s.name() in used]

    return question.memo("states.dependent", make)


def advance(rate, x, h, p):
    """Friction states after a time, everything else held: exact, and stable for any step.

    Parameters
    ----------
    rate, x : SX, shape (n, 1)
        Rates, and the symbols of the states, which lie between -1 and 1.
    h : SX
        Time [s].
    p : SX
        Symbols of the parameters.

    Returns
    -------
    SX, shape (n, 1)

    Raises
    ------
    ModelicaError
        A rate is neither straight in its state, nor that of an elastic displacement that slides.
    """
    found = [ca.SX(0, 1)]
    for r, s in zip(ca.vertsplit(rate), ca.vertsplit(x)):
        line = _line(r, s, h)
        found.append(line[0] * s + line[1] if line else _along(s, *_move(r, s, h, p), *_pieces(r, s, p)))
    return ca.vertcat(*found)


def coupled(rate, x):
    """Indices of the states whose rate depends on another state of the list.

    Parameters
    ----------
    rate, x : SX, shape (n, 1)
        Rates, and the symbols of the states.

    Returns
    -------
    list of int
    """
    return [i for i, r in enumerate(ca.vertsplit(rate))
            if any(ca.depends_on(r, s) for j, s in enumerate(ca.vertsplit(x)) if j != i)]


def _line(rate, x, h):
    """Growth and drive of ``x+ = growth x + drive`` where the rate is straight in the state, else None."""
    slope = ca.jacobian(rate, x)
    if ca.depends_on(slope, x):
        return None
    y = ca.densify(slope) * h
    near = y - 1e-12  # never zero where nothing moves
    return ca.exp(y), ca.substitute(rate, x, 0.0) * h * ca.expm1(near) / near


def _free(rate, x, p):
    """Rate of an elastic displacement that does not slide: its gradient at rest, by what drives it."""
    parameters = {s.name() for s in ca.symvar(p)}
    drives = ca.vertcat(*[s for s in ca.symvar(rate) if s.name() not in {x.name(), *parameters}], ca.SX(0, 1))
    at_rest = ca.vertcat(x, drives), ca.DM.zeros(1 + drives.numel())
    return ca.substitute(ca.jacobian(rate, drives), *at_rest), drives


def _move(rate, x, h, p):
    """Free move of an elastic displacement, and its direction."""
    free = ca.mtimes(*_free(rate, x, p))
    return free * h, ca.sign(free)


def _along(x, move, toward, bend, bend_turn, limit, limit_turn, ratio, ratio_turn):
    """Displacement after a free move as far as the bend, and from there towards the limit."""
    far, bend, limit = x + move, bend + toward * bend_turn, limit + toward * limit_turn
    # the order of the arguments is that of choice where they are equal: at rest, the slope of the elastic part
    corner = ca.fmin(ca.fmax(ca.fmin(far, x), bend), ca.fmax(far, x))
    return limit + (corner - limit) * ca.exp((ratio + toward * ratio_turn) * (far - corner))


def _pieces(rate, x, p):
    """Bend, limit and inverse length of an elastic displacement that slides, from its rate.

    Relative to the free rate, the rate depends on nothing but the direction, the state and
    parameters: free as far as the bend, then straight down to zero at the limit. Each comes as the mean of both
    directions and half their difference.
    """
    gradient, drives = _free(rate, x, p)
    free = ca.mtimes(gradient, drives)
    found = []
    for way in (1.0, -1.0):
        some = ca.substitute(rate / free, drives, way * gradient.T)  # any motion in this direction
        slope = ca.substitute(ca.jacobian(some, x), x, way)
        limit = way - ca.substitute(some, x, way) / slope
        found.append((limit + 1 / slope, limit, slope))
    pieces = [part for one, other in zip(*found) for part in ((one + other) / 2, (one - other) / 2)]
    _check_pieces(rate, x, free, pieces, p)
    return pieces


def _check_pieces(rate, x, free, pieces, p):
    """Compare a rate with its pieces, by numbers."""
    toward = ca.sign(free)
    limit, ratio = (pieces[k] + toward * pieces[k + 1] for k in (2, 4))
    error = rate - free * ca.fmin(1, ratio * (x - limit))
    names = ca.symvar(ca.vertcat(error, free, *pieces))
    check = ca.Function("check", names, [error, free])
    parameters, rng = {s.name() for s in ca.symvar(p)}, np.random.default_rng(3)
    for _ in range(32):
        point = [rng.uniform(0.1 if n.name() in parameters else -0.9, 0.9) for n in names]
        error, size = (abs(float(v)) for v in check.call(point))
        if not error <= 1e-9 * (1 + size):
            raise ModelicaError(f"at a given speed the rate of '{x.name()}' is not straight in it, nor that of an "
                                "elastic displacement that slides; write an effect's state as x' = a(w) x + b(w)")


def follow(question):
    """One step of the friction states of a question, as a function to take away.

    Parameters
    ----------
    question : Question
        Its ``rate`` is integrated.

    Returns
    -------
    casadi.Function
        ``(u, x, p, h) -> x_next``: states after ``h`` seconds, for the means of the inputs over them.
    """
    u, x, p = question.symbols()
    h = ca.SX.sym("h")
    return ca.Function("follow", [u, x, p, h], [ca.cse(advance(question.rate(u, x, p), x, h, p))],
                       ["u", "x", "p", "h"], ["x_next"])


class _Steps:
    """One step of some states of a question, cut into what is a linear recursion and what is not."""

    def __init__(self, question, chosen):
        self.u, x, self.p = question.symbols()
        rate = question.rate(self.u, x, self.p)
        self.x, rate = x[chosen], rate[chosen]
        others = [i for i in range(x.numel()) if i not in chosen]
        if coupled(rate, self.x) or any(ca.depends_on(rate, x[i]) for i in others):
            raise ModelicaError(f"the states {', '.join(question.states)} are coupled to one another; write an "
                                "effect's state as x' = a(w) x + b(w)")
        self.h, states, rates = ca.SX.sym("h"), ca.vertsplit(self.x), ca.vertsplit(rate)
        lines = [_line(r, s, self.h) for r, s in zip(rates, states)]
        self.straight = [i for i, line in enumerate(lines) if line]
        self.bent = [i for i, line in enumerate(lines) if not line]
        self.lines = [lines[i] for i in self.straight]
        self.pieces = [(*_move(rates[i], states[i], self.h, self.p), *_pieces(rates[i], states[i], self.p))
                       for i in self.bent]
        self.after = advance(rate, self.x, self.h, self.p)

    @cached_property
    def coefficients(self):
        """``(inputs, parameters, h)`` to the coefficients of the straight ones, then of the bent ones."""
        parts = [part for rows in (self.lines, self.pieces) for column in zip(*rows) for part in column]
        return ArrayFunction(ca.Function("coefficients", [self.u, self.p, self.h], [ca.densify(ca.vertcat(*parts))]))

    def sensitivity(self, question, free):
        """Derivatives of a step by its own state and by parameters."""
        own = ca.diag(ca.jacobian(self.after, self.x))
        columns = [ca.jacobian(self.after, self.p[question.parameters.index(n)]) for n in free]
        return ArrayFunction(ca.Function("sensitivity", [self.u, self.x, self.p, self.h],
                                         [ca.densify(ca.horzcat(own, *columns))]))


def propagate(question, signals, time, parameters, run=None, free=(), only=None):
    """Friction states at every sample of one or several logs, from zero at the start of each.

    Parameters
    ----------
    question : Question
        Its ``rate`` is integrated, exactly within each sample interval.
    signals : dict of str to ndarray, shape (n,)
        Inputs of the question; those that the states do not need may be missing. Where an angle is given, what it moved
        between samples is used rather than its speed.
    time : ndarray, shape (n,)
        Of the samples [s], increasing within a log; intervals may differ.
    parameters : dict of str to float
        All of the question's.
    run : ndarray, shape (n,), optional
        Index of the log a sample belongs to.
    free : list of str
        Parameters whose sensitivities are wanted too.
    only : list of str, optional
        States to follow; the others stay zero.

    Returns
    -------
    states : ndarray, shape (number of states, n)
    sensitivities : ndarray, shape (len(free), number of states, n)

    Raises
    ------
    ModelicaError
        A state is coupled to another, or its rate is not made of one or two straight pieces.
    """
    n, m = len(time), len(question.states)
    states, sensitivities = np.zeros((m, n)), np.zeros((len(free), m, n))
    chosen = [i for i, name in enumerate(question.states) if only is None or name in only]
    if not chosen or n < 2:
        return states, sensitivities
    keep = np.ones(n - 1) if run is None else (run[1:] == run[:-1]).astype(float)  # a new log starts from zero
    h = np.where(keep, np.diff(time), 0.0)  # what lies between two logs, backwards perhaps, is no step
    inputs = _between(question, signals, n, h)
    values = [float(parameters[p]) for p in question.parameters]
    steps = question.memo(("states.steps", *chosen), lambda: _Steps(question, chosen))
    found = steps.coefficients([*inputs, *values, h], n - 1)
    split = 2 * len(steps.straight)
    if steps.straight:
        states[np.array(chosen)[steps.straight]] = scan(*(keep * found[:split].reshape(2, -1, n - 1)))
    if steps.bent:
        states[np.array(chosen)[steps.bent]] = _walk(found[split:], keep)
    if free:
        sensitivity = question.memo(("states.sensitivity", *chosen, "by", *free),
                                    lambda: steps.sensitivity(question, free))
        found = sensitivity([*inputs, *states[chosen, :-1], *values, h], n - 1)
        growth, *drives = keep * found.reshape(1 + len(free), len(chosen), n - 1)
        sensitivities[:, chosen] = [scan(growth, drive) for drive in drives]
    return states, sensitivities


def _between(question, signals, n, h):
    """Means of a question's inputs over each step."""
    inputs = []
    for name in question.inputs:
        angle = signals.get(name[4:-1]) if name.startswith("der(") else None
        if isinstance(angle, np.ndarray):
            inputs.append(np.diff(angle) / np.where(h == 0, 1, h))
        else:
            value = np.broadcast_to(signals.get(name, 0.0), n)
            inputs.append((value[1:] + value[:-1]) / 2)
    return inputs


def _walk(pieces, keep):
    """States after each step from zero; ``keep`` of zero starts again.

    The log is cut into rows that advance side by side, each from what the row before ended with in the sweep before:
    friction forgets as it slides, so that a few sweeps settle all rows. Only rows whose start changed go again.
    """
    names = [ca.SX.sym(n) for n in ("x", *inspect.signature(_along).parameters, "keep")][1:]
    m, n = len(pieces) // (len(names) - 2), len(keep)
    width = int(np.ceil(np.sqrt(n)))
    rows = -(-n // width)
    fill = ((0, 0), (0, rows * width - n))
    data = np.pad(np.vstack([pieces, np.tile(keep, (m, 1))]), fill).reshape(len(names) - 1, m * rows, width)
    step = ArrayFunction(ca.Function("along", names, [names[-1] * _along(*names[:-1])]))
    states, starts, todo = np.zeros((m * rows, width)), np.zeros(m * rows), np.arange(m * rows)
    while len(todo):
        part, x = np.ascontiguousarray(data[:, todo].transpose(2, 0, 1)), starts[todo]
        for k in range(width):
            x = step([x, *part[k]], len(todo))[0]
            states[todo, k] = x
        ends = states[:, -1].reshape(m, rows)
        new = np.hstack([np.zeros((m, 1)), ends[:, :-1]]).ravel()
        todo, starts = np.flatnonzero(new != starts), new
    return np.hstack([np.zeros((m, 1)), states.reshape(m, -1)[:, :n]])


def scan(growth, drive):
    """Solve ``x[k + 1] = growth[k] x[k] + drive[k]`` from zero, along the last axis.

    The axis is cut into rows that advance side by side, then the end of each row starts the next.

    Parameters
    ----------
    growth, drive : ndarray, shape (m, n)
        A recursion a row; the last axis is that of the samples.

    Returns
    -------
    ndarray, shape (m, n + 1)
        Each row starts with the zero.
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

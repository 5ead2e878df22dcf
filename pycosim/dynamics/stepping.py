"""Differential-algebraic system in; its consistent start and one implicit step as CasADi functions out.

The step is the two-stage, stiffly accurate, singly diagonally implicit Runge-Kutta method [1]_: order 2, L-stable, so
that a short travel of friction does not limit it. Its unknowns are the algebraic variables alone (accelerations): a
stage's angles and speeds follow from them, friction states from what the angles moved (`states.advance`), and loads in
closed form. What is left, a handful of unknowns unrolled into scalar code, is solved by Newton's method with an exact
Jacobian: one correction, a second one with the Jacobian of the first (a quarter of its work), and more, damped at last,
only while the last one was not small. What the parameters alone ask for is worked out apart, once for many steps.

References
----------
.. [1] Alexander, R. (1977). Diagonally implicit Runge-Kutta methods for stiff O.D.E.'s. SIAM J. Numer. Anal. 14(6).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..compile.solve import solve_small
from ..core.errors import ModelicaError
from .states import advance

GAMMA = 1 - 0.5 ** 0.5
TOLERANCE = 1e-8  # largest last Newton correction, relative; a further one would be far smaller, except at a kink
_PLAIN = 5  # made while the last one was too large
_RESCUE = 40  # made after those, damped, while the last one was too large
GAP = 1e-5  # rad, or m; see `gap`. Machines in use stay below (stick and slip, reversals, 50 rad/s of a free shank);
#             where a step is too long for the motion, as for a leg that is whirled, it is 10 to 1000 times that
HALVINGS = 6  # of a step without solution, or with a larger gap, before it counts as impossible
_SHARES = (1.0, 0.5, 0.25, 0.125, 0.03)  # of a damped correction


class System:
    """States, algebraic variables and what they depend on.

    Parameters
    ----------
    x, z, u, p, t : SX
        Symbols of the states, algebraic variables, inputs, parameters and the time.
    rates : list of SX
        Derivatives of the states.
    residuals : list of SX
        As many as algebraic variables.
    friction : list of int
        States that lie between -1 and 1; one that depends on itself is carried on by `states.advance`.
    """

    def __init__(self, x, z, u, p, t, rates, residuals, friction):
        self.x, self.z, self.known = x, z, [u, p, t]
        self.rates, self.given, self.order, loose = list(rates), ca.vertcat(*rates, ca.SX(0, 1)), [], []
        left = list(range(x.numel()))
        friction = {i for i in friction if not ca.depends_on(rates[i], z) and _advances(rates[i], x[i], p)}
        needs = [{j for j in left if ca.depends_on(r, x[j])} for r in rates]
        while left:
            ready = [i for i in left if needs[i] <= {*self.order} | {i} & friction]
            for i in ready or left[:1]:
                if not ready:  # then its rate is an unknown too
                    loose.append(i)
                    self.rates[i], needs[i] = ca.SX.sym(f"rate{i}"), set()
                self.order.append(i)
                left.remove(i)
        self.held = {i for i in self.order if i in needs[i]}
        self.unknown = ca.vertcat(z, *[self.rates[i] for i in loose])
        self.start = ca.vertcat(z, *[rates[i] for i in loose])
        self.residual = ca.vertcat(*residuals, *[rates[i] - self.rates[i] for i in loose])

    def stage(self):
        """Correction of a stage's unknowns, and its states, with what only the parameters ask for worked out before.

        A state is ``base + c[0] rate``; friction states start at ``x0`` and see the others at ``mean + c[1] x`` for
        ``c[2]`` seconds.

        Returns
        -------
        prepare : casadi.Function
            ``p -> q``
        newton : casadi.Function
            ``(y, x0, base, mean, c, u, q, t) -> y, size, miss, slope``: with the correction's relative size, by how
            much the equations failed before it, and their Jacobian.
        chord : casadi.Function
            ``(y, slope, x0, base, mean, c, u, q, t) -> y, size, miss``: a correction with a given Jacobian.
        place : casadi.Function
            ``(y, x0, base, mean, c, u, q, t) -> x``
        """
        n, y = self.x.numel(), self.unknown
        x0, base, mean, c = ca.SX.sym("x0", n), ca.SX.sym("base", n), ca.SX.sym("mean", n), ca.SX.sym("c", 3)
        x = self._place(x0, base, mean, c)
        residual = ca.substitute(self.residual, self.x, x)
        slope, given = ca.densify(jacobian(residual, y)), ca.SX.sym("slope", y.numel(), y.numel())
        (u, p, t), newton, chord = self.known, _corrected(y, slope, residual), _corrected(y, given, residual)
        found, symbols, values = split_parameters([*newton, slope, *chord, x], p)
        symbols, values = ca.vertcat(p, symbols), ca.vertcat(p, values)
        arguments = [x0, base, mean, c, u, symbols, t]
        found[3] = ca.reshape(found[3], *slope.shape)
        return (ca.Function("prepare", [p], [values]), ca.Function("newton", [y, *arguments], ca.cse(found[:4])),
                ca.Function("chord", [y, given, *arguments], ca.cse(found[4:7])),
                ca.Function("place", [y, *arguments], found[7:]))

    def _place(self, x0, base, mean, c):
        """States of a stage."""
        x, stage = ca.vertsplit(self.x), ca.vertsplit(base)
        for i in self.order:
            if i not in self.held:
                stage[i] = base[i] + c[0] * ca.substitute(self.rates[i], self.x, ca.vertcat(*stage))
                continue
            seen = [x[j] if j == i else mean[j] + c[1] * stage[j] for j in range(len(x))]
            after = advance(self.rates[i], x[i], c[2], self.known[1])
            stage[i] = ca.substitute(after, self.x, ca.vertcat(*[x0[j] if j == i else seen[j] for j in range(len(x))]))
        return ca.vertcat(*stage, ca.SX(0, 1))


def _advances(rate, x, p):
    try:
        return advance(rate, x, ca.SX.sym("h"), p) is not None
    except ModelicaError:  # of another shape: its rate becomes an unknown
        return False


def _corrected(y, slope, residual):
    """Unknowns after a correction, its relative size, and by how much the equations failed before it."""
    if not y.numel():
        return [y, ca.SX(0), ca.SX(0)]
    change = solve_small(slope, residual)
    return [y - change, ca.norm_inf(change / (1 + ca.fabs(y))), ca.sumsqr(residual)]


def jacobian(expression, y):
    """Jacobian with a choice, not CasADi's quotient of comparisons, where an expression bends.

    Parameters
    ----------
    expression : casadi.SX, shape (m, 1)
        Of `y` and other symbols.
    y : casadi.SX, shape (n, 1)
        Symbols.

    Returns
    -------
    casadi.SX, shape (m, n)
    """
    cuts = []

    def cut(op, *used):
        if op in (ca.OP_FMIN, ca.OP_FMAX, ca.OP_FABS) and any(ca.depends_on(u, ca.vertcat(y, *[c[0] for c in cuts]))
                                                              for u in used):
            cuts.append((ca.SX.sym(f"cut{len(cuts)}"), op, *used))
            return cuts[-1][0]

    total = _tangent(y, _rebuild(expression, cut), cuts)
    values = [ca.SX.unary(op, *used) if op == ca.OP_FABS else ca.SX.binary(op, *used) for _, op, *used in cuts]
    found = [total]
    for (symbol, *_), value in zip(reversed(cuts), reversed(values)):
        found = ca.substitute(found, [symbol], [value])
    return found[0]


def _tangent(y, expression, cuts):
    """Jacobian of an expression by y, through what was cut out of it."""
    symbols, slopes = ca.vertcat(*[c[0] for c in cuts], ca.SX(0, 1)), ca.SX(0, y.numel())

    def through(e):
        return ca.jacobian(e, y) + ca.mtimes(ca.jacobian(e, symbols[:slopes.shape[0]]), slopes)

    for _, op, a, *b in cuts:
        if op == ca.OP_FABS:
            slope = ca.sign(a) * through(a)
        else:
            first = a <= b[0] if op == ca.OP_FMIN else a >= b[0]
            slope = ca.if_else(first, through(a), through(b[0]))
        slopes = ca.vertcat(slopes, slope)
    return through(expression)


def split_parameters(expressions, p):
    """Split what depends on the parameters alone from expressions, so that a step need not work it out again.

    Parameters
    ----------
    expressions : list of casadi.SX
        Of `p` and other symbols.
    p : casadi.SX, shape (n, 1)
        Parameters.

    Returns
    -------
    rest : list of casadi.SX
        The expressions over the symbols.
    symbols, values : casadi.SX, shape (k, 1)
        What was split off.
    """
    joined = ca.vertcat(*[ca.vec(ca.densify(e)) for e in expressions])
    joined, symbols, values = ca.extract_parametric(ca.cse(joined), p, {})
    inverse, divisors = {}, [*symbols, *ca.vertsplit(p)]

    def multiply(op, a, b=None):
        if op == ca.OP_DIV and b.is_symbolic() and b.name() in known:
            return a * inverse.setdefault(b.name(), ca.SX.sym(f"inverse_{b.name()}"))

    known = {s.name(): v for s, v in zip(divisors, [*values, *ca.vertsplit(p)])}
    joined = _rebuild(joined, multiply)
    ends = [0]
    for e in expressions:
        ends.append(ends[-1] + e.numel())
    return ([joined[a:b] for a, b in zip(ends, ends[1:])], ca.vertcat(ca.SX(0, 1), *symbols, *inverse.values()),
            ca.vertcat(ca.SX(0, 1), *values, *[1 / known[n] for n in inverse]))


def _rebuild(expression, rule=lambda *_: None):
    """A column again, instruction by instruction, with what a rule puts in place of an operation."""
    symbols = ca.symvar(expression)
    function = ca.Function("f", symbols, [ca.cse(ca.densify(expression))])
    work, result = [None] * (function.sz_w() + 1), [ca.SX(0)] * expression.numel()
    for k in range(function.n_instructions()):
        op, out, used = (f(k) for f in (function.instruction_id, function.instruction_output,
                                        function.instruction_input))
        if op == ca.OP_INPUT:
            work[out[0]] = symbols[used[0]]
        elif op == ca.OP_CONST:
            work[out[0]] = ca.SX(function.instruction_constant(k))
        elif op == ca.OP_OUTPUT:
            result[out[1]] = work[used[0]]
        else:
            given = [work[j] for j in used]
            put = rule(op, *given)
            plain = ca.SX.unary if len(given) == 1 else ca.SX.binary
            work[out[0]] = plain(op, *given) if put is None else put
    return ca.vertcat(*result, ca.SX(0, 1))


def with_choices(expression):
    """An expression with a choice in place of the smaller and the larger of two.

    Its value is the same; its derivative is that of one of the two everywhere, the first where both are equal. CasADi's
    own is the mean there, which is the slope on neither side where two such corners meet.

    Parameters
    ----------
    expression : SX, shape (n, 1)
        With any number of ``fmin`` and ``fmax`` in it.

    Returns
    -------
    SX, shape (n, 1)
    """
    def choose(op, *given):
        if op in (ca.OP_FMIN, ca.OP_FMAX):
            a, b = given
            return ca.if_else(a <= b if op == ca.OP_FMIN else a >= b, a, b)

    return _rebuild(expression, choose)


def _damped(newton, chord):
    """A correction, shortened to the share after which the equations fail least."""
    arguments = newton.mx_in()
    y, *rest = arguments
    full, size, _, slope = newton(*arguments)
    best, least = full, ca.MX.inf()
    for share in _SHARES:
        trial = y + share * (full - y)
        miss = chord(trial, slope, *rest)[2]
        best, least = ca.if_else(miss < least, trial, best), ca.fmin(miss, least)
    return ca.Function("damped", arguments, [best, size])


def _guarded(name, function, tolerance):
    """``(size, y, ...) -> y, size``: the function's, but as they are where the size is small or no number."""
    arguments = function.mx_in()
    size = ca.MX.sym("size")
    again = ca.Function("again", [size, *arguments], function.call(arguments)[:2])
    keep = ca.Function("keep", [size, *arguments], [arguments[0], size])
    either = ca.Function.if_else(name, again, keep)
    return lambda size, *given: either(size > tolerance, size, *given)


def _settle(newton, chord, tolerance):
    """``(y, ...) -> y, size``: corrections until they are small."""
    arguments = newton.mx_in()
    y, *rest = arguments
    rescue = _repeated("rescue", _damped(newton, chord), _RESCUE, tolerance)
    more = _guarded("more", _repeated("plain", newton, _PLAIN, tolerance, rescue), tolerance)
    y, _, _, slope = newton(y, *rest)
    again = _guarded("chord_again", chord, tolerance)
    y, size, _ = chord(y, slope, *rest)
    y, size = again(size, y, slope, *rest)
    return ca.Function("settle", arguments, more(size, y, *rest))


def _repeated(name, correct, times, tolerance, then=None):
    """``(y, ...) -> y, size``: one correction, and more while the last was not small; then another function's."""
    arguments = correct.mx_in()
    again = _guarded(name, correct, tolerance)
    y, size, *_ = correct(*arguments)
    for _ in range(times - 1):
        y, size = again(size, y, *arguments[1:])
    if then is not None:
        y, size = _guarded(f"{name}_then", then, tolerance)(size, y, *arguments[1:])
    return ca.Function(f"{name}_repeated", arguments, [y, size])


def gap(before, after, h, speeds):
    """By how much the trapezoidal rule misses what each angle moved in a step: of the order of the step's own error.

    Parameters
    ----------
    before, after : ndarray, shape (n, ...)
        States.
    h : float or ndarray
        Step [s].
    speeds : list of int or None
        For each state, which one is its derivative.

    Returns
    -------
    float or ndarray
        The largest over all angles [rad], or displacements [m].
    """
    missed = np.abs(_missed(before, after, h, speeds))
    return np.max(missed, axis=0) if len(missed) else np.zeros(np.shape(h))


def _missed(before, after, h, speeds):
    return [after[i] - before[i] - h * (before[j] + after[j]) / 2 for i, j in enumerate(speeds) if j is not None]


def watched(step, speeds):
    """A rig's step that also says how far it may be believed.

    Parameters
    ----------
    step : casadi.Function
        Of `pycosim.dynamics.simulate.Dynamics`.
    speeds : list of int or None
        For each state the number of the one that is its derivative, or None.

    Returns
    -------
    casadi.Function
        As the step; its third result is the larger of ``error`` and of `gap` in units of `GAP`, infinite where one of
        the states is no finite number: the step is good up to 1.
    """
    given = step.mx_in()
    after, z, error = step.call(given)
    symbols = ca.SX.sym("before", after.numel()), ca.SX.sym("after", after.numel()), ca.SX.sym("h")
    largest = ca.mmax(ca.fabs(ca.vertcat(0, *_missed(*symbols, speeds))))
    gap = ca.Function("gap", symbols, [largest])(given[0], after, given[-1])
    good = ca.if_else(ca.fabs(error) + ca.norm_1(after) < ca.inf, ca.fmax(error, gap / GAP), ca.inf)
    return ca.Function("watched", given, [after, z, good], step.name_in(), step.name_out())


def in_parts(d, x, z, u0, u1, q, t, h, halvings=HALVINGS):
    """A step of a rig; where it has no solution, or is too long for the motion, two of half its length, and so on.

    Parameters
    ----------
    d : pycosim.dynamics.simulate.Dynamics
        Whose ``step`` is taken.
    x, z, u0, u1, q, t, h
        As its ``step`` takes them; inputs are linear in between.
    halvings : int
        How often the step may be halved.

    Returns
    -------
    tuple of ndarray, or None
        States and algebraic variables after it; None where there is no solution.
    """
    made = [np.array(v).ravel() for v in d.step(x, z, u0, u1, q, t, h)]
    if all(np.isfinite(v).all() for v in made) and made[2][0] <= 1 and gap(x, made[0], h, d.speeds) <= GAP:
        return made[0], made[1]
    if not halvings:
        return None
    middle = (np.asarray(u0) + np.asarray(u1)) / 2
    half = in_parts(d, x, z, u0, middle, q, t, h / 2, halvings - 1)
    return half and in_parts(d, *half, middle, u1, q, t + h / 2, h / 2, halvings - 1)


@dataclass
class Steps:
    """Functions of a system; see `simulate.Dynamics` for their arguments."""

    prepare: ca.Function
    initial: ca.Function
    step: ca.Function


def steps(system, tolerance=TOLERANCE):
    """Make the functions of a system.

    Parameters
    ----------
    system : System
        States, algebraic variables and residuals.
    tolerance : float
        Largest last correction, relative.

    Returns
    -------
    Steps
    """
    prepare, newton, chord, place = system.stage()
    settle = _settle(newton, chord, tolerance)
    n, m = system.x.numel(), system.z.numel()
    start = ca.Function("start", [system.x, system.z, *system.known], [system.start])
    x, z, u0, u1, q, t, h = (ca.MX.sym(k, *size) for k, size in zip(
        ["x", "z", "u0", "u1", "q", "t", "h"],
        [(n,), (m,), system.known[0].shape, system.known[0].shape, prepare.size_out(0), (1,), (1,)]))
    p = q[:system.known[1].numel()]
    now = [x, x, ca.MX(n, 1), ca.MX([0, 1, 0]), u0, q, t]  # a stage of no length
    consistent = settle(start(x, z, u0, p, t), *now)[0][:m]
    initial = ca.Function("initial", [x, z, u0, q, t], [consistent], ["x", "z", "u", "q", "t"], ["z_next"])

    def stage(y, base, mean, c, share):
        at = [x, base, mean, ca.vertcat(*c), u0 + share * (u1 - u0), q, t + share * h]
        y, size = settle(y, *at)
        return y, size, place(y, *at)

    y, first, x1 = stage(start(x, z, u0, p, t), x, ca.MX(n, 1), (GAMMA * h, 1, GAMMA * h), GAMMA)
    y, second, x2 = stage(y, x + (1 - GAMMA) / GAMMA * (x1 - x), (1 - GAMMA) * x1, (GAMMA * h, GAMMA, h), 1)
    error = ca.fmax(first, second) / tolerance
    step = ca.Function("step", [x, z, u0, u1, q, t, h], [x2, y[:m], error],
                       ["x", "z", "u0", "u1", "q", "t", "h"], ["x_next", "z_next", "error"])
    return Steps(prepare, initial, step)

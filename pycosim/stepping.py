"""Differential-algebraic system in; its consistent start, rates, and one implicit step as CasADi functions out.

The step is the two-stage, stiffly accurate, singly diagonally implicit Runge-Kutta method [1]_: order 2, L-stable, so
that a short travel of friction does not limit it. Its unknowns are the algebraic variables alone (accelerations): a
stage's angles and speeds follow from them, friction states from what the angles moved (`states.advance`), and loads in
closed form. What is left is solved by Newton's method with an exact Jacobian, a handful of unknowns unrolled into
scalar code; two corrections usually do, and more, damped, are made only while the last one was not small.

References
----------
.. [1] Alexander, R. (1977). Diagonally implicit Runge-Kutta methods for stiff O.D.E.'s. SIAM J. Numer. Anal. 14(6).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from .states import advance

GAMMA = 1 - 0.5 ** 0.5
TOLERANCE = 1e-7  # of a correction, relative; Newton's next one would be its square
_CORRECTIONS = 2  # made in any case
_PLAIN = 4  # made while the last one was too large
_RESCUE = 40  # made after those, damped, while the last one was too large
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
        needs = [{j for j in left if ca.depends_on(r, x[j])} for r in rates]
        while left:
            ready = [i for i in left if needs[i] <= {*self.order} | {i} & {*friction}]
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

    def place(self):
        """``(y, x0, base, mean, c, u, p, t) -> x``: states of a stage for its unknowns.

        A state is ``base + c[0] rate``; friction states start at ``x0`` and see the others at ``mean + c[1] x`` for
        ``c[2]`` seconds.
        """
        x0, base, mean = (ca.SX.sym(n, self.x.numel()) for n in ("x0", "base", "mean"))
        c = ca.SX.sym("c", 3)
        x = ca.vertsplit(self.x)
        stage = ca.vertsplit(base)
        for i in self.order:
            if i in self.held:
                others = [mean[j] + c[1] * stage[j] if j != i else x0[i] for j in range(len(x))]
                own = ca.substitute(self.rates[i], ca.vertcat(*x[:i], *x[i + 1:]), ca.vertcat(*others[:i], *others[i + 1:]))
                stage[i] = ca.substitute(advance(own, x[i], c[2]), x[i], x0[i])
            else:
                stage[i] = base[i] + c[0] * ca.substitute(self.rates[i], self.x, ca.vertcat(*stage))
        arguments = [self.unknown, x0, base, mean, c, *self.known]
        return ca.Function("place", arguments, [ca.cse(ca.densify(ca.vertcat(*stage, ca.SX(0, 1))))])

    def newton(self, place):
        """``(y, x0, base, mean, c, u, p, t) -> y, size, miss``: one correction of the unknowns.

        With its relative size, and by how much the equations failed before it.
        """
        arguments = place.sx_in()
        y, known = arguments[0], arguments[5:]
        residual = ca.substitute(self.residual, ca.vertcat(self.unknown, self.x, *self.known),
                                 ca.vertcat(y, place(*arguments), *known))
        change = _solve(ca.jacobian(residual, y), residual)
        size = ca.norm_inf(change / (1 + ca.fabs(y))) if y.numel() else ca.SX(0)
        results = ca.cse([ca.densify(y - change), size, ca.sumsqr(residual)])
        return ca.Function("newton", arguments, results)


def _solve(matrix, right):
    """Unrolled elimination, smallest code; rows in the order given, whose pivots are masses."""
    n = right.numel()
    a, b = [[matrix[i, j] for j in range(n)] for i in range(n)], ca.vertsplit(right) if n else []
    for k in range(n):
        for i in range(k + 1, n):
            factor = a[i][k] / a[k][k]
            a[i] = [a[i][j] - factor * a[k][j] if j > k else a[i][j] for j in range(n)]
            b[i] = b[i] - factor * b[k]
    x = [None] * n
    for k in reversed(range(n)):
        x[k] = (b[k] - sum((a[k][j] * x[j] for j in range(k + 1, n)), ca.SX(0))) / a[k][k]
    return ca.vertcat(*x, ca.SX(0, 1))


def _damped(newton):
    """A correction, shortened to the share after which the equations fail least."""
    arguments = newton.mx_in()
    y = arguments[0]
    full, size, _ = newton(*arguments)
    best, least = full, ca.MX.inf()
    for share in _SHARES:
        trial = y + share * (full - y)
        miss = newton(trial, *arguments[1:])[2]
        best, least = ca.if_else(miss < least, trial, best), ca.fmin(miss, least)
    return ca.Function("damped", arguments, [best, size])


def _guarded(name, function):
    """``(size, y, ...) -> y, size``: the function's, but y and size as they are where the size is small or no number."""
    arguments = function.mx_in()
    size = ca.MX.sym("size")
    again = ca.Function("again", [size, *arguments], function.call(arguments)[:2])
    keep = ca.Function("keep", [size, *arguments], [arguments[0], size])
    either = ca.Function.if_else(name, again, keep)
    return lambda size, *given: either(size > TOLERANCE, size, *given)


def _settle(newton):
    """``(y, ...) -> y, size``: corrections until they are small."""
    arguments = newton.mx_in()
    y, *rest = arguments
    plain, damped = _guarded("plain", newton), _guarded("rescued", _damped(newton))
    found, size, _ = newton(y, *rest)
    for _ in range(_PLAIN):
        found, size = plain(size, found, *rest)
    for _ in range(_RESCUE):
        found, size = damped(size, found, *rest)
    more = _guarded("more", ca.Function("corrected", arguments, [found, size]))
    for _ in range(_CORRECTIONS):
        y, size, _ = newton(y, *rest)
    return ca.Function("settle", arguments, more(size, y, *rest))


@dataclass
class Steps:
    """Functions of a system; see `simulate.Dynamics` for their arguments."""

    initial: ca.Function
    rates: ca.Function
    step: ca.Function


def steps(system):
    """Make the functions of a system.

    Parameters
    ----------
    system : System

    Returns
    -------
    Steps
    """
    place = system.place()
    settle = _settle(system.newton(place))
    n, m = system.x.numel(), system.z.numel()
    start = ca.Function("start", [system.x, system.z, *system.known], [system.start])
    given = ca.Function("given", [system.x, system.z, *system.known], [ca.densify(system.given)])
    names = ["x", "z", "u", "p", "t"]
    x, z, u0, u1, p, t, h = (ca.MX.sym(k, *size) for k, size in zip(
        ["x", "z", "u0", "u1", "p", "t", "h"],
        [(n,), (m,), system.known[0].shape, system.known[0].shape, system.known[1].shape, (1,), (1,)]))
    now = [x, x, ca.MX(n, 1), ca.MX([0, 1, 0]), u0, p, t]  # a stage of no length
    consistent = settle(start(x, z, u0, p, t), *now)[0][:m]
    initial = ca.Function("initial", [x, z, u0, p, t], [consistent], names, ["z_next"])
    rates = ca.Function("rates", [x, z, u0, p, t], [given(x, consistent, u0, p, t)], names, ["xdot"])

    def stage(y, base, mean, c, share):
        at = [x, base, mean, ca.vertcat(*c), u0 + share * (u1 - u0), p, t + share * h]
        y, size = settle(y, *at)
        return y, size, place(y, *at)

    y, first, x1 = stage(start(x, z, u0, p, t), x, ca.MX(n, 1), (GAMMA * h, 1, GAMMA * h), GAMMA)
    y, second, x2 = stage(y, x + (1 - GAMMA) / GAMMA * (x1 - x), (1 - GAMMA) * x1, (GAMMA * h, GAMMA, h), 1)
    error = ca.fmax(first, second) / TOLERANCE
    step = ca.Function("step", [x, z, u0, u1, p, t, h], [x2, y[:m], error],
                       ["x", "z", "u0", "u1", "p", "t", "h"], ["x_next", "z_next", "error"])
    return Steps(initial, rates, step)

"""Residual equations and the list of known variables in, explicit CasADi expressions of the unknown ones out.

The method: what only says that an unknown is another, its negative or zero goes first, all of it in one substitution;
then every equation that is linear in one of its unknowns with a coefficient free of unknowns is substituted away; when
a differentiated variable goes, its derivative becomes the derivative of its expression (this is the index reduction);
what is left is cut into blocks, and a block that is piecewise linear in its unknowns (a segment's law) is solved in
closed form, sign case by sign case.
"""

from __future__ import annotations

import heapq
import itertools
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching

from ..core.errors import ModelicaError


@dataclass
class Solution:
    """What is left of a model once its known variables are known.

    Attributes
    ----------
    values : dict of str to SX
        Every eliminated variable, as an expression of known variables, states, parameters and ``algebraic``.
    states : list of str
        Differentiated variables that stay.
    algebraic : list of str
        Unknowns of ``residuals`` that have no closed form (empty for ``estimate`` and ``compensate``).
    residuals : list of SX
        Zero where ``algebraic`` are right; as many as these.
    """

    symbols: dict
    values: dict = field(default_factory=dict)
    states: list = field(default_factory=list)
    algebraic: list = field(default_factory=list)
    residuals: list = field(default_factory=list)


def der(name, order=1):
    """Name of a derivative: ``der(x)``, ``der(der(x))``.

    Parameters
    ----------
    name : str
        A variable's, or a derivative's.
    order : int
        How often it is differentiated; zero leaves the name.

    Returns
    -------
    str
    """
    return name if order == 0 else der(f"der({name})", order - 1)


class _System:
    """The equations while they shrink."""

    def __init__(self, flat, known, explicit):
        self.flat = flat
        self.symbols = dict(flat.symbols)
        self.known = set(flat.parameters) | {"time"} | set(known)
        self.unknown = (set(flat.variables) | set(flat.derivatives.values())) - self.known
        self.differentiated = {x for x in flat.derivatives if x not in self.known}
        self.rates = set(flat.derivatives.values())
        self.solved = []
        self.equations = {}
        self.where = {}
        self.waiting = {False: [], True: []}  # equations to be tried, the shortest first: without rates, with them
        self.counter = itertools.count()
        for x in [x for x in flat.derivatives if x in self.known]:
            self.symbol(der(x), known=True)
            if x in known and der(x) in flat.derivatives:
                self.symbol(der(x, 2), known=True)
        self.bent = _bent(flat) - self.differentiated if explicit else set()
        for equation in self.renamed(flat.equations):
            self.add(equation)

    def renamed(self, equations):
        """The equations but for those that give an unknown another name, without these unknowns."""
        names = _Names(self)
        left = names.sort_out(equations)
        values = [names.value(n) for n in names.heads]
        self.unknown.difference_update(names.heads)
        self.solved += zip(names.heads, values)
        return ca.substitute(left, [self.symbols[n] for n in names.heads], values) if left and values else left

    def symbol(self, name, known=False):
        if name not in self.symbols:
            self.symbols[name] = ca.SX.sym(name)
            if known:
                self.known.add(name)
            else:
                self.unknown.add(name)
        elif known:
            self.known.add(name)
            self.unknown.discard(name)
        return self.symbols[name]

    def names(self, expression):
        return {s.name() for s in ca.symvar(expression)} & self.unknown

    def add(self, equation):
        equation = ca.simplify(equation)
        names = self.names(equation)
        key = next(self.counter)
        self.equations[key] = (equation, names)
        for n in names:
            self.where.setdefault(n, set()).add(key)
        for waiting in self.waiting.values():
            heapq.heappush(waiting, (len(names), key))

    def drop(self, key):
        _, names = self.equations.pop(key)
        for n in names:
            self.where[n].discard(key)

    def bind(self, name, expression):
        """Eliminate an unknown: put its expression wherever it stands."""
        if name in self.known:
            return
        self.unknown.discard(name)
        self.solved.append((name, expression))
        keys = sorted(self.where.pop(name, ()))
        equations = [self.equations[key][0] for key in keys]
        for key, equation in zip(keys, ca.substitute(equations, [self.symbols[name]], [expression]) if keys else ()):
            self.drop_keep(key, name)
            self.add(equation)

    def drop_keep(self, key, name):
        _, names = self.equations.pop(key)
        for n in names - {name}:
            self.where[n].discard(key)

    def derivative(self, expression):
        """Total time derivative; names of derivatives are created as needed."""
        total = ca.SX(0)
        for s in ca.symvar(expression):
            name = s.name()
            partial = ca.jacobian(expression, s)
            if name == "time":
                total += partial
            elif name in self.flat.parameters:
                continue
            elif name in self.known:
                total += partial * self.symbol(der(name), known=True)
            else:
                total += partial * self.rate(name)
        return ca.simplify(total)

    def rate(self, name):
        """Symbol of the derivative of an unknown; the unknown becomes differentiated."""
        rate = self.flat.derivatives.get(name, der(name))
        if name not in self.differentiated:
            self.differentiated.add(name)
            self.flat.derivatives.setdefault(name, rate)
            self.rates.add(rate)
        return self.symbol(rate)


class _Names:
    """Which unknowns are another variable, its negative, or zero; of two that one goes which `_candidate` chooses."""

    def __init__(self, system):
        self.system, self.heads = system, {}  # a name: who stands for it (None: zero), and the sign

    def head(self, name):
        sign = 1
        while name in self.heads:
            name, step = self.heads[name]
            sign *= step
        return name, sign

    def value(self, name):
        head, sign = self.head(name)
        if head is None:
            return ca.SX(0)
        return self.system.symbols[head] if sign > 0 else -self.system.symbols[head]

    def rank(self, name):
        """Kind of a variable and who goes first of a kind: 0 plain, 1 bent, 2 with a derivative, 3 known or zero."""
        if name not in self.system.unknown:
            return 3, 0, 0, ""
        kind = 2 if name in self.system.differentiated else int(name in self.system.bent)
        return kind, -name.count("."), -len(name), name

    def sort_out(self, equations):
        """The equations that say more than a name does; what becomes zero or one of two on the way is a name too."""
        sums = [_sum(e) for e in equations]
        left = [e for e, terms in zip(equations, sums) if terms is None]
        waiting = [pair for pair in zip(equations, sums) if pair[1] is not None]
        while True:
            said = [not self.join(terms) for _, terms in waiting]
            if all(said):
                return left + [e for e, _ in waiting]
            waiting = list(itertools.compress(waiting, said))

    def join(self, terms):
        """Whether a sum of variables that is zero says no more than who is whom; it is taken up then."""
        factors = {}
        for name, factor in terms.items():
            head, sign = self.head(name)
            if head is not None:
                factors[head] = factors.get(head, 0) + sign * factor
        factors = {n: f for n, f in factors.items() if f}
        if not factors:
            return True
        low, high = [*sorted(factors, key=self.rank), None][:2]
        kind, other = self.rank(low)[0], self.rank(high)[0]
        if len(factors) > 2 or kind > 1 or kind == 1 and other not in (1, 3) or factors.keys() & self.system.rates:
            return False
        turn = -factors[low] * factors.get(high, factors[low])
        if high is not None and abs(factors[low]) != abs(factors[high]):
            return False
        self.heads[low] = high, int(np.sign(turn))
        return True


def _sum(equation, sign=1):
    """Names and factors of an equation that is a sum of variables; None of any other."""
    if equation.is_symbolic():
        return {equation.name(): sign}
    if equation.is_op(ca.OP_NEG):
        return _sum(equation.dep(0), -sign)
    if not (equation.is_op(ca.OP_ADD) or equation.is_op(ca.OP_SUB)):
        return {} if equation.is_zero() else None
    first = _sum(equation.dep(0), sign)
    second = first is not None and _sum(equation.dep(1), sign if equation.is_op(ca.OP_ADD) else -sign)
    if not second:
        return first if second == {} else None
    return {n: first.get(n, 0) + second.get(n, 0) for n in {**first, **second}}


def _usable(system, coefficient):
    """Whether a coefficient may be divided by: free of unknowns, and never zero within the parameters' bounds."""
    if coefficient.is_constant():
        return abs(float(coefficient)) > 1e-12
    names = [s.name() for s in ca.symvar(coefficient)]
    if not names:  # of numbers, yet not worked out
        return abs(float(ca.DM(ca.evalf(coefficient)))) > 1e-12
    parameters = system.flat.parameters
    if any(n not in parameters or parameters[n].min == 0 for n in names):
        return False
    value = ca.Function("c", [system.symbols[n] for n in names], [coefficient])
    return abs(float(value(*[parameters[n].value for n in names]))) > 1e-12


def _bent(flat):
    """Unknowns that stand in an absolute value or a square, where the closed form of a segment's law expects them.

    To put an expression in their place would move the bend away from zero.
    """
    found = set()
    for equation in flat.equations:
        text = str(equation)
        if not any(f"{called}(" in text for called in ("fabs", "sq", "sign")):  # most are sums
            continue
        inputs = ca.symvar(equation)
        function, held = ca.Function("f", inputs, [equation]), {}
        for k in range(function.n_instructions()):
            op, out, arguments = (f(k) for f in (function.instruction_id, function.instruction_output,
                                                 function.instruction_input))
            if op == ca.OP_INPUT:
                held[out[0]] = inputs[arguments[0]].name()
            elif op != ca.OP_OUTPUT:
                if op in (ca.OP_FABS, ca.OP_SQ, ca.OP_SIGN) and arguments[0] in held:
                    found.add(held[arguments[0]])
                held.pop(out[0], None)
    return found


def _candidate(system, equation, names, prefer, rates_too):
    """The best unknown that this equation can be solved for, with its coefficient; or None."""
    has_rate = bool(names & system.rates)
    plain = names - system.differentiated - system.rates
    if has_rate and not rates_too:
        return None
    barred = system.bent if names - system.bent else set()  # bent unknowns go by what defines them, or by an alias
    found = [(n in prefer, n in system.differentiated, n in system.rates, -n.count("."), -len(n), n)
             for n in names - barred
             if n not in system.differentiated
             or not (has_rate or plain or system.flat.derivatives[n] not in system.unknown)]
    for *_, n in sorted(found):
        coefficient = ca.simplify(ca.jacobian(equation, system.symbols[n]))
        if coefficient.nnz() and _usable(system, coefficient):
            return n, coefficient
    return None


def _eliminate(system, prefer):
    """Substitute linear equations away, the shortest first; those with rates wait until no other is left."""
    while system.waiting[False] or system.waiting[True]:
        rates_too = not system.waiting[False]
        _, key = heapq.heappop(system.waiting[rates_too])
        if key not in system.equations:
            continue
        equation, names = system.equations[key]
        if not names:
            system.drop(key)
            continue
        option = _candidate(system, equation, names, prefer, rates_too)
        if option is not None:
            _substitute(system, key, *option)


def _substitute(system, key, name, coefficient):
    """Eliminate one unknown by one equation, its derivative along with it."""
    equation, _ = system.equations[key]
    expression = ca.simplify(-ca.substitute(equation, system.symbols[name], 0) / coefficient)
    system.drop(key)
    rate = system.flat.derivatives[name] if name in system.differentiated else None
    system.bind(name, expression)
    system.differentiated.discard(name)
    if rate is not None:
        system.bind(rate, system.derivative(expression))


def _blocks(residuals, unknowns, names_of):
    """Order equations and unknowns into blocks that can be solved one after the other."""
    incidence = csr_matrix(np.array([[n in names_of(r) for n in unknowns] for r in residuals], dtype=int))
    match = maximum_bipartite_matching(incidence, perm_type="column")
    if (match < 0).any():
        return None
    n = len(unknowns)
    column_owner = {match[i]: i for i in range(n)}
    depends = np.zeros((n, n), dtype=int)
    for i in range(n):
        for j in incidence[i].indices:
            depends[i, column_owner[j]] = 1
    count, label = connected_components(csr_matrix(depends), directed=True, connection="strong")
    groups = [[i for i in range(n) if label[i] == c] for c in range(count)]
    ordered, done = [], set()
    while groups:
        for group in groups:
            needs = {label[column_owner[j]] for i in group for j in incidence[i].indices} - {label[group[0]]}
            if needs <= done:
                ordered.append(([residuals[i] for i in group], [unknowns[match[i]] for i in group]))
                done.add(label[group[0]])
                groups.remove(group)
                break
    return ordered


def piecewise_linear(residuals, x):
    """Closed form of residuals that are linear in x for fixed signs of x (for one unknown, quadratic or cubic too).

    Each sign pattern gives a linear system; the pattern that agrees with its own solution is the right one. The law of
    a segment is monotone, so it is unique.

    Parameters
    ----------
    residuals, x : list of SX
        As many equations, each zero, as unknowns.

    Returns
    -------
    list of SX or None
        None when the residuals are of another shape.
    """
    g, v = ca.vertcat(*residuals), ca.vertcat(*x)
    jacobian = ca.jacobian(g, v)
    at_zero = ca.substitute(g, v, ca.DM.zeros(len(x)))
    if len(x) == 1:  # a law that falls with its unknown is turned
        turn = _constant_sign(ca.sign(ca.substitute(jacobian, v, 1.0)))
        jacobian, at_zero = jacobian * turn, at_zero * turn
    signed = [i for i, s in enumerate(x) if _depends(jacobian, s)]
    if len(signed) > 4:
        return None
    if len(x) == 1 and signed and not _linear(jacobian, v, signed):
        return _quadratic(jacobian, at_zero, x[0]) or _cubic(jacobian, at_zero, x[0])
    if not _linear(jacobian, v, signed):
        return None
    if len(x) == 1:
        return [-at_zero / ca.substitute(jacobian, x[0], -at_zero)]  # only its sign counts
    best, score = None, None
    for pattern in itertools.product([1.0, -1.0], repeat=len(signed)):
        point = ca.DM.zeros(len(x))
        for i, s in zip(signed, pattern):
            point[i] = s
        solution = solve_small(ca.substitute(jacobian, v, point), -at_zero)
        fit = ca.inf
        for i, s in zip(signed, pattern):
            fit = ca.fmin(fit, s * solution[i]) if isinstance(fit, ca.SX) else s * solution[i]
        if best is None:
            best, score = solution, fit
        else:
            better = fit > score
            best = ca.if_else(better, solution, best)
            score = ca.fmax(fit, score)
    return [best[i] for i in range(len(x))]


def _constant_sign(sign):
    """The number, where a sign is the same for all parameters tried; else the expression."""
    seen = set(_numeric([ca.densify(sign)], np.random.default_rng(1), 8)[0].ravel())
    return seen.pop() if len(seen) == 1 else sign


def _solves(residuals, x, result, parameters):
    """Check a closed form by numbers: parameters near their defaults, all else of both signs."""
    before = ca.vertcat(*residuals)
    after = ca.substitute(before, ca.vertcat(*x), ca.vertcat(*result))
    names = ca.symvar(ca.vertcat(after, before))
    check = ca.Function("check", names, [ca.densify(after), ca.densify(before)])
    points = np.random.default_rng(2).uniform(-0.9, 0.9, (len(names), 16))
    for row, name in zip(points, (n.name() for n in names)):
        if name in parameters:
            row[:] = parameters[name].value + 1e-3 * parameters[name].nominal
    error, size = (np.abs(np.array(v)).max(axis=0) for v in check.call([ca.DM(row[None]) for row in points]))
    return not (np.isfinite(error) & (error > 1e-6 * (1 + size))).any()


def _depends(expression, symbol):
    return symbol.name() in {s.name() for s in ca.symvar(expression)}


def solve_small(matrix, right):
    """Solution of a few linear equations, unrolled without choosing pivots: by determinants, or by rotations.

    Parameters
    ----------
    matrix : SX, shape (n, n)
        Regular wherever it is evaluated.
    right : SX, shape (n, 1)
        Right-hand side.

    Returns
    -------
    SX, shape (n, 1)
    """
    n = matrix.shape[0]
    if n == 1:
        return right / matrix
    if n == 2:
        a, b, c, d = matrix[0, 0], matrix[0, 1], matrix[1, 0], matrix[1, 1]
        return ca.vertcat(d * right[0] - b * right[1], a * right[1] - c * right[0]) / (a * d - b * c)
    return ca.solve(ca.densify(matrix), right)


def _numeric(expressions, rng, points=1):
    """Values where all symbols are drawn by lot, points beside each other."""
    names = ca.symvar(ca.vertcat(*[ca.vec(e) for e in expressions]))
    f = ca.Function("f", names, expressions)
    return [np.array(v) for v in f.call([ca.DM(rng.uniform(0.2, 0.9, (1, points))) for _ in names])]


def _linear(jacobian, v, signed):
    """Check that the Jacobian depends on x through its signs alone, by numbers."""
    rng = np.random.default_rng(0)
    for pattern in itertools.product([1.0, -1.0], repeat=len(signed)):
        point = np.full(v.shape[0], 0.7)
        point[signed] = pattern
        near, far = (ca.densify(ca.substitute(jacobian, v, scale * ca.DM(point))) for scale in (1.0, 2.3))
        a, b = _numeric([near, far], rng)
        if not np.allclose(a, b, rtol=1e-9, atol=1e-12):
            return False
    return True


def _quadratic(jacobian, at_zero, x):
    """Root of g0 + a x + b x^2 on either side of zero, the one that the linear law continues to."""
    roots = []
    for s in (1.0, -1.0):
        one, two, three = (ca.substitute(jacobian, x, k * s) for k in (1, 2, 3))
        values = _numeric([ca.densify(v) for v in (one, two, three)], np.random.default_rng(0))
        if not np.allclose(values[2] - values[1], values[1] - values[0], rtol=1e-8, atol=1e-12):
            return None
        a, b = 2 * one - two, (two - one) / (2 * s)
        discriminant = ca.fmax(a * a - 4 * b * at_zero, 0)
        roots.append(-2 * at_zero / (a + ca.sqrt(discriminant)))
    return [ca.if_else(at_zero <= 0, roots[0], roots[1])]


_SERIES = (1, -1, 3, -12, 55, -273, 1428)  # g(u) = sum (-u)^n binomial(3 n, n) / (2 n + 1), exact to rounding ..
_NEAR = 1e-3  # .. for |u| below this


def _cubic(jacobian, at_zero, x):
    """Root of g0 + a x + b x^3 that continues the linear one: x = -g0 / a g(u) with u = b g0^2 / a^3, g + u g^3 = 1.

    The trigonometric roots [Viete] have no derivative at b = 0, where an effect is neutral; a series stands there.
    """
    a, one, other, two = (ca.substitute(jacobian, x, k) for k in (0.0, 1.0, -1.0, 2.0))
    values = _numeric([ca.densify(v) for v in (a, one, other, two)], np.random.default_rng(0))
    if not (np.allclose(values[1], values[2], rtol=1e-8) and
            np.allclose(values[3] - values[0], 4 * (values[1] - values[0]), rtol=1e-8, atol=1e-12)):
        return None
    u = (one - a) / 3 * at_zero ** 2 / a ** 3
    series = sum(c * u ** n for n, c in enumerate(_SERIES))
    rising, falling = (ca.sqrt(3 * ca.fmax(sign * u, _NEAR)) for sign in (1, -1))
    stiff = 2 * ca.sinh(ca.asinh(1.5 * rising) / 3) / rising
    # beyond 1.5 sqrt(-3 u) = 1 this root is no longer real, no torque has so large a reading: its last value is kept
    soft = 2 * ca.sin(ca.asin(ca.fmin(1.5 * falling, 1 - 1e-12)) / 3) / falling
    return [-at_zero / a * ca.if_else(ca.fabs(u) < _NEAR, series, ca.if_else(u > 0, stiff, soft))]


def solve(flat, known, keep=(), explicit=True):
    """Solve a flat model for everything but what is known.

    Parameters
    ----------
    flat : Flat
        Variables and equations of a whole rig.
    known : list of str
        Variables that are given as functions of time; their derivatives are given too, under the names ``der(x)``.
    keep : list of str
        States to keep rather than eliminate, where there is a choice.
    explicit : bool
        Solve what is left in closed form (``estimate``, ``compensate``); else (``simulate``) only what follows from the
        states and their rates, and leave residuals for these.

    Returns
    -------
    Solution

    Raises
    ------
    ModelicaError
        Too many or too few equations, or no closed form where one was asked for.
    """
    flat.derivatives = dict(flat.derivatives)
    system = _System(flat, known, explicit)
    _eliminate(system, set(keep))
    rates = {flat.derivatives[x] for x in system.differentiated}
    solution = Solution(system.symbols)
    solution.states = sorted(x for x in system.differentiated if x in system.unknown)
    residuals = [e for e, names in system.equations.values()]
    unknowns = sorted(system.unknown - set(solution.states))
    used = system.names(ca.vertcat(*residuals, *(e for _, e in system.solved)))
    unknowns = [u for u in unknowns if u in used or u in rates]
    if len(residuals) != len(unknowns):
        raise ModelicaError(
            f"'{flat.name}': {len(residuals)} equations are left for {len(unknowns)} unknowns "
            f"({', '.join(unknowns[:6])}); declare what is free as an input, or connect it")
    solution.algebraic, solution.residuals = unknowns, residuals
    if explicit:
        _close(flat, system, solution)
    else:
        _tear(flat, system, solution, rates)
    _substitute_back(system, solution)
    return solution


def _tear(flat, system, solution, rates):
    """Solve one by one, in closed form, what follows once the rates are known; the rest stays residuals."""
    waiting = [(r, system.names(r) - set(solution.states) - rates) for r in solution.residuals]
    closed, left = [], []
    while waiting:
        waiting.sort(key=lambda item: len(item[1]))
        residual, names = waiting.pop(0)
        result = None
        if len(names) == 1:
            x = [system.symbols[n] for n in names]
            result = piecewise_linear([residual], x)
        if result is None or not _solves([residual], x, result, flat.parameters):
            left.append(residual)
            continue
        closed += zip(names, result)
        waiting = [(r, others - names) for r, others in waiting]
    system.solved += reversed(closed)
    symbols = [system.symbols[n] for n, _ in closed]
    for n, s in zip(reversed(closed), reversed(symbols)):
        left = ca.substitute(left, [s], [n[1]])
    solution.residuals = left
    solution.algebraic = [n for n in solution.algebraic if n not in dict(closed)]


def _close(flat, system, solution):
    """Solve the remaining blocks in closed form and append them to what is solved."""
    if not solution.residuals:
        return
    state_names = set(solution.states)
    blocks = _blocks(solution.residuals, solution.algebraic, lambda e: system.names(e) - state_names)
    if blocks is None:
        raise ModelicaError(f"'{flat.name}': the equations do not determine {', '.join(solution.algebraic)}")
    closed = []
    for residuals, names in blocks:
        x = [system.symbols[n] for n in names]
        result = piecewise_linear(residuals, x)
        if result is None or not _solves(residuals, x, result, flat.parameters):
            raise ModelicaError(
                f"'{flat.name}': no closed form for {', '.join(names)}; an effect must be linear, absolute or "
                "quadratic in the load, or cubic in the torque")
        closed += list(zip(names, result))
    system.solved += [(n, e) for n, e in reversed(closed)]
    solution.algebraic, solution.residuals = [], []


def _substitute_back(system, solution):
    """Fill in values in reverse order of elimination, so that every value is explicit."""
    names, expressions = [n for n, _ in reversed(system.solved)], [e for _, e in reversed(system.solved)]
    if names:
        expressions, _ = ca.substitute_inplace([system.symbols[n] for n in names], expressions, [], False)
    solution.values = dict(zip(names, expressions))

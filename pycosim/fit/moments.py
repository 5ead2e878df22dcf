"""Residuals of a piecewise affine model in; their moments, by patterns of signs, out: a fit without the samples.

Between changes of sign of speeds and loads, the segments' law is affine in the measured torques. Within one pattern of
signs the residual and its derivative are then the same affine map of every sample, and all a least-squares step needs
are the second moments of the samples. What is affine is found by differentiation and checked on the samples.
"""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np

from ..compile import ArrayFunction

_MOST = 64  # sign patterns
_CHECKED = 2000  # samples on which the affine maps are compared with the model
_APART = 1e-6  # of the residual's energy by which they may differ there


class Moments:
    """Second moments of a problem's samples for the sign patterns at one point.

    Use `Moments.of`, which returns None for a model that is not piecewise affine on these samples.
    """

    @classmethod
    def of(cls, problem, x, segments, exogenous=None):
        """Moments of a problem at free parameters x.

        Parameters
        ----------
        problem : Residuals
            With its derivatives by the free parameters.
        x : ndarray
            Values of the free parameters, in their order.
        segments : list of str
            Components whose load may change sign.
        exogenous : Residuals, optional
            The same problem on signals without noise; its derivatives become the instruments.

        Returns
        -------
        Moments or None
        """
        if problem.of_states or problem.own:  # the maps would differ from run to run
            return None
        found = cls()
        found.problem, found.functions = problem, _functions(problem, segments)
        found.terms = problem.terms(dict(problem.parameters), ())
        clean = found.terms if exogenous is None else exogenous.terms(dict(problem.parameters), ())
        if not all(np.all(np.abs(s) == 1) for t in found.terms for s in t.states):
            return None
        names = [problem.selected.inputs[k] for k in found.functions.varying]
        inputs = [_full(t.signals.get(name, 0.0), problem.n)
                  for terms in (found.terms, clean) for t in terms for name in names]
        found.rows = np.array([np.ones(problem.n), *inputs, *problem.measured])
        return found if found.take(x) else None

    def _parameters(self, x):
        return {**self.problem.parameters, **dict(zip(self.problem.free, x))}

    def _code(self, x):
        """Number of the sign pattern of every sample."""
        n, parameters, loads = self.problem.n, self._parameters(x), self.functions.loads
        code = np.zeros(n, dtype=np.int64)
        for term in self.terms:
            arguments = [*[term.signals.get(name, 0.0) for name in loads.inputs], *term.states,
                         *[float(parameters[name]) for name in loads.parameters]]
            for bit in [*term.states, *self.functions.load(arguments, n)]:
                code *= 2
                code += bit > 0
        return code

    def take(self, x):
        """Sum the moments of each sign pattern at x.

        Parameters
        ----------
        x : ndarray, shape (p,)
            Free parameters.

        Returns
        -------
        bool
            False where the model is not affine within the patterns, or has too many of them.
        """
        code = self._code(x)
        self.starts = np.r_[0, np.flatnonzero(np.diff(code)) + 1]  # a run of samples keeps its pattern
        patterns, self.pattern = np.unique(code[self.starts], return_inverse=True)
        if len(patterns) > _MOST:
            return False
        self.inside = self._inside(len(code))
        size = len(self.rows)
        self.second = np.empty((len(patterns), size, size))
        for i in range(size):
            for j in range(i + 1):
                sums = np.add.reduceat(self.rows[i] * self.rows[j], self.starts)
                self.second[:, i, j] = self.second[:, j, i] = np.bincount(self.pattern, sums, len(patterns))
        return self.holds(x)

    def _inside(self, n):
        """A sample of each pattern: the middle of its longest run, where a fit's next step hardly turns a sign."""
        lengths = np.diff(np.r_[self.starts, n])
        order = np.lexsort((lengths, self.pattern))
        longest = order[np.flatnonzero(np.diff(np.r_[self.pattern[order], -1]))]
        return self.starts[longest] + lengths[longest] // 2

    def holds(self, x):
        """Whether at x the model still is the affine maps, signs included; checked on some samples.

        Parameters
        ----------
        x : ndarray, shape (p,)
            Free parameters.

        Returns
        -------
        bool
        """
        some = np.arange(0, self.problem.n, max(1, self.problem.n // _CHECKED))
        pattern = self.pattern[np.searchsorted(self.starts, some, side="right") - 1]
        affine = np.einsum("ncs,sn->cn", self._combined(x, False)[pattern, :, -1], self.rows[:, some])
        apart = affine - self.problem.residual(x, some)
        return bool((apart ** 2).sum(1).max() <= _APART * max((affine ** 2).sum(), 1e-300))

    def _maps(self, x, samples):
        """Affine maps over [1, inputs] of the value and its derivatives at some samples.

        Returns
        -------
        list of ndarray, shape (channels, samples, 1 + parameters, 1 + inputs)
            One a term: the value, then a derivative a parameter of the question.
        """
        q, f, count = self.problem.selected, self.functions, len(samples)
        parameters = self._parameters(x)
        p = np.array([[float(parameters[name])] * count for name in q.parameters])
        if count not in f.mapped:
            f.mapped[count] = f.local.map(count)
        found = []
        for term in self.terms:
            u = np.array([np.broadcast_to(_at(term.signals.get(name, 0.0), samples), count) for name in q.inputs])
            maps = f.mapped[count](u, term.states[:, samples], p).full()
            maps = maps.reshape(len(maps), count, 1 + len(f.columns), 1 + len(f.varying))
            maps[..., 0] -= np.einsum("csrv,vs->csr", maps[..., 1:], u[f.varying])  # value at zero input
            found.append(maps)
        return found

    def _combined(self, x, instruments):
        """Derivatives and residual as combinations of the rows, shape (patterns, channels, p + 1, rows)."""
        f, channels, p = self.functions, len(self.problem.channels), len(self.problem.free)
        k, count = len(f.varying), len(self.terms)
        found = np.zeros((len(self.second), channels, p + 1, len(self.rows)))
        found[:, np.arange(channels), p, 1 + 2 * k * count + np.arange(channels)] = 1.0
        for t, (term, maps) in enumerate(zip(self.terms, self._maps(x, self.inside))):
            weighted = term.weight * maps.swapaxes(0, 1)  # patterns first
            noisy, clean = (slice(1 + k * s, 1 + k * (s + 1)) for s in (t, count + t))
            found[:, :, p, 0] -= weighted[:, :, 0, 0]
            found[:, :, p, noisy] -= weighted[:, :, 0, 1:]
            found[:, :, f.columns, 0] += weighted[:, :, 1:, 0]
            found[:, :, f.columns, clean if instruments else noisy] += weighted[:, :, 1:, 1:]
        return found

    def slope_and_residual(self, x):
        """Derivatives at the signals without noise, and the residual as measured.

        Parameters
        ----------
        x : ndarray, shape (p,)
            Free parameters.

        Returns
        -------
        slope : ndarray, shape (channels, p, n)
            Of the model.
        residual : ndarray, shape (channels, n)
            In the channels' units.
        """
        combined = self._combined(x, True)
        patterns, channels, p, size = combined.shape
        found = np.empty((channels * p, self.problem.n))
        for g, a, b in zip(self.pattern, self.starts, [*self.starts[1:], self.problem.n]):
            found[:, a:b] = combined[g].reshape(-1, size) @ self.rows[:, a:b]
        found = found.reshape(channels, p, -1)
        return found[:, :-1], found[:, -1]

    def gram(self, x, weights, instruments=False):
        """Moments [J r]'[J r] at free parameters x, with the signs as they were.

        Parameters
        ----------
        x, weights : sequence of float
            Values of the free parameters, and one factor a channel.
        instruments : bool
            Take the derivatives at the signals without noise.

        Returns
        -------
        ndarray, shape (p + 1, p + 1)
        """
        rows = self._combined(x, instruments) * np.asarray(weights)[:, None, None]
        return (rows @ self.second[:, None] @ rows.swapaxes(2, 3)).sum((0, 1))


def _functions(problem, segments):
    """Loads of the segments, and value and derivatives of the residual by the inputs; made once a question."""
    key = "moments", tuple(problem.channels), tuple(problem.free), tuple(segments)
    return problem.question.memo(key, lambda: _made(problem, segments))


def _made(problem, segments):
    q = problem.selected
    loads = problem.question.select([f"{c}.L" for c in segments if f"{c}.L" in problem.question.outputs])
    u, x, p = q.symbols()
    y = q.output(u, x, p)
    varying = [k for k in range(len(q.inputs)) if ca.depends_on(y, u[k])]
    columns = [k for k, n in enumerate(problem.free) if n in q.parameters]
    slope = ca.jacobian(y, u[varying]) if varying else ca.SX(y.numel(), 0)
    values = ca.densify(ca.horzcat(y, slope))  # channels x (1 + inputs)
    numbers = [q.parameters.index(problem.free[k]) for k in columns]
    rates = [ca.densify(ca.reshape(ca.jacobian(ca.vec(values), p[k]), values.shape)) for k in numbers]
    local = ca.Function("local", [u, x, p], [ca.cse(ca.horzcat(values, *rates))])
    load = ArrayFunction(ca.Function("load", [u, x, p], [ca.cse(loads.output(u, x, p))]))
    return SimpleNamespace(loads=loads, load=load, varying=varying, columns=columns, local=local, mapped={})


def _full(value, n):
    return np.broadcast_to(value, n)


def _at(value, where):
    return value[where] if isinstance(value, np.ndarray) else value

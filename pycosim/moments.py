"""Residuals of a piecewise affine model in; their moments, sign pattern by sign pattern, out: a fit without the samples.

Between changes of sign of speeds and loads, the segments' law is affine in the measured torques. Within one pattern of
signs the residual and its derivative are then the same affine map of every sample, and all a least-squares step needs
are the second moments of the samples. What is affine is found by differentiation and checked on the samples.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from .compile import ArrayFunction

_MOST = 64  # sign patterns


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
        x : ndarray
        segments : list of str
            Components whose load may change sign.
        exogenous : Residuals, optional
            The same problem on signals without noise; its derivatives become the instruments.

        Returns
        -------
        Moments or None
        """
        if problem.of_states:
            return None
        found = cls()
        found.problem, found.p = problem, len(problem.free)
        found._functions(segments)
        terms = problem.terms(dict(problem.parameters), ())
        clean = (exogenous or problem).terms(dict(problem.parameters), ())
        return found if found._gather(terms, clean, x) else None

    def _functions(self, segments):
        q = self.problem.selected
        self.loads = self.problem.question.select([f"{c}.L" for c in segments
                                                   if f"{c}.L" in self.problem.question.outputs])
        u, x, p = q.symbols()
        y = q.output(u, x, p)
        self.varying = [k for k in range(len(q.inputs)) if ca.depends_on(y, u[k])]
        free = [q.parameters.index(n) for n in self.problem.free if n in q.parameters]
        self.columns = [k for k, n in enumerate(self.problem.free) if n in q.parameters]
        slope = ca.jacobian(y, u[self.varying]) if self.varying else ca.SX(y.numel(), 0)
        values = ca.densify(ca.horzcat(y, slope))  # channels x (1 + inputs)
        rates = [ca.densify(ca.reshape(ca.jacobian(ca.vec(values), p[k]), values.shape)) for k in free]
        self.local = ca.Function("local", [u, x, p], [values, *rates])
        self.mapped = {}

    def _parameters(self, x):
        return {**self.problem.parameters, **dict(zip(self.problem.free, x))}

    def _gather(self, terms, clean, x):
        """Sort samples by sign pattern and sum their moments; False when the affine maps do not hold."""
        n, parameters = self.problem.n, self._parameters(x)
        code, rows, clean_rows = np.zeros(n, dtype=np.int64), [], []
        q = self.problem.selected
        for term, tidy in zip(terms, clean):
            inputs = [_full(term.signals.get(name, 0.0), n) for name in q.inputs]
            rows.append([inputs[k] for k in self.varying])
            clean_rows.append([_full(tidy.signals.get(q.inputs[k], 0.0), n) for k in self.varying])
            arguments = [*inputs, *term.states, *[float(parameters[name]) for name in self.loads.parameters]]
            loads = ArrayFunction(self.loads.output)(arguments, n)
            for bit in [*term.states, *loads]:
                code = code * 2 + (bit > 0)
            if not all(np.all(np.abs(s) == 1) for s in term.states):
                return False
        patterns, self.group = np.unique(code, return_inverse=True)
        if len(patterns) > _MOST:
            return False
        stacked = [*[v for r in rows for v in r], *[v for r in clean_rows for v in r], *self.problem.measured]
        data = np.vstack([np.ones(n), *stacked])
        order = np.argsort(self.group, kind="stable")
        edges = np.searchsorted(self.group[order], np.arange(len(patterns) + 1))
        self.second, self.first, self.members = [], [], []
        for a, b in zip(edges[:-1], edges[1:]):
            part = data[:, order[a:b]]
            self.members.append(order[a:b])
            self.second.append(part @ part.T)
            self.first.append((order[a], order[b - 1]))
        self.terms, self.clean_rows = terms, clean_rows
        return self._holds(x)

    def _maps(self, x, samples):
        """Affine maps over [1, inputs] of the value and its derivatives at some samples.

        Returns
        -------
        list of list of ndarray, shape (channels, 1 + inputs)
            One list a sample and term: the value, then a derivative a free parameter.
        """
        q, count = self.problem.selected, len(samples)
        parameters = self._parameters(x)
        p = [[float(parameters[name])] * count for name in q.parameters]
        if count not in self.mapped:
            self.mapped[count] = self.local.map(count)
        local = self.mapped[count]
        found = [[] for _ in samples]
        for term in self.terms:
            u = np.array([np.broadcast_to(_at(term.signals.get(name, 0.0), samples), count) for name in q.inputs])
            values = [np.array(v) for v in local.call([u, term.states[:, samples], np.array(p)])]
            width = 1 + len(self.varying)
            for k in range(count):
                part = [v[:, k * width:(k + 1) * width].copy() for v in values]
                for v in part:  # value at the sample to value at zero input
                    v[:, 0] -= v[:, 1:] @ u[self.varying, k]
                found[k].append(part)
        return found

    def _holds(self, x):
        """Check the affine maps of the first sample of each pattern on its last."""
        count = len(self.first)
        maps = self._maps(x, [a for a, _ in self.first] + [b for _, b in self.first])
        for left, right in zip(maps[:count], maps[count:]):
            for a, b in zip(left, right):
                scale = 1e-7 * max(1.0, max(np.abs(v).max() for v in a))
                if any(np.abs(v - w).max() > scale for v, w in zip(a, b)):
                    return False
        return True

    def slope(self, x):
        """Derivatives at the signals without noise, shape (channels, p, n)."""
        found = np.zeros((len(self.problem.channels), self.p, self.problem.n))
        maps = self._maps(x, [a for a, _ in self.first])
        for g, members in enumerate(self.members):
            for t, (term, values) in enumerate(zip(self.terms, maps[g])):
                rows = np.vstack([np.ones(len(members)), *[r[members] for r in self.clean_rows[t]]])
                for column, rate in zip(self.columns, values[1:]):
                    found[:, column, members] += term.weight * rate @ rows
        return found

    def gram(self, x, weights, instruments=False):
        """Moments [J r]'[J r] at free parameters x, with the signs as they were.

        Parameters
        ----------
        x, weights : sequence of float
        instruments : bool
            Take the derivatives at the signals without noise.

        Returns
        -------
        ndarray, shape (p + 1, p + 1)
        """
        channels, k = len(self.problem.channels), len(self.varying)
        size = 1 + 2 * k * len(self.terms) + channels
        total = np.zeros((self.p + 1, self.p + 1))
        every = self._maps(x, [a for a, _ in self.first])
        for maps, second in zip(every, self.second):
            for c, weight in enumerate(weights):
                rows = np.zeros((self.p + 1, size))
                rows[-1, 1 + 2 * k * len(self.terms) + c] = 1.0
                for t, (term, values) in enumerate(zip(self.terms, maps)):
                    noisy = slice(1 + k * t, 1 + k * (t + 1))
                    tidy = slice(1 + k * (len(self.terms) + t), 1 + k * (len(self.terms) + t + 1))
                    rows[-1, 0] -= term.weight * values[0][c, 0]
                    rows[-1, noisy] -= term.weight * values[0][c, 1:]
                    for column, rate in zip(self.columns, values[1:]):
                        rows[column, 0] += term.weight * rate[c, 0]
                        rows[column, tidy if instruments else noisy] += term.weight * rate[c, 1:]
                total += weight ** 2 * rows @ second @ rows.T
        return total


def _full(value, n):
    return np.broadcast_to(value, n)


def _at(value, sample):
    return value[sample] if isinstance(value, np.ndarray) else value

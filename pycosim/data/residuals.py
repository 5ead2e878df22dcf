"""Samples and a model in, residuals and their exact derivatives out, block by block."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from functools import cached_property, partial

import casadi as ca
import numpy as np

from ..compile import ArrayFunction
from ..dynamics.states import dependent_parameters
from .noise import chained
from .torques import held_of_load

_CHUNK = 8192
_STRIDE = 4  # samples at a time at most, by which friction states are followed where samples are thinned


@dataclass
class Term:
    """One evaluation of the model at a set of samples, with its weight in the residual.

    A residual against a reference is one term of weight 1; a paired residual is half the out pass minus half the back
    pass.
    """

    weight: float
    signals: dict
    states: np.ndarray
    sensitivities: np.ndarray


@dataclass
class Held:
    """Channels that were recorded through a filter of first order: what the model gives is held back alike.

    By how much follows from what the motion alone predicts of the channel, without its noise. What a noisy torque gives
    would lose noise in a filter, which looks like a better model.

    Parameters
    ----------
    lags : dict of int to str
        Channels, and the question's output that is the time constant of the filter.
    back : list of callable
        Time constant [s] to what such a filter holds back of a channel, and the derivative by it, at all samples.
    where : ndarray of int, shape (n,)
        The samples of the residual among those.
    """

    lags: dict
    back: list
    where: np.ndarray

    def behind(self, times):
        """By how much each channel is recorded behind itself, and the derivatives by the time constants.

        Parameters
        ----------
        times : sequence of float
            Time constants [s].

        Returns
        -------
        list of (int, ndarray of shape (n,), ndarray of shape (n,))
            Channel, difference, and its derivative.
        """
        return [(channel, *(v[self.where] for v in back(max(lag, 0.0))))
                for channel, back, lag in zip(self.lags, self.back, times)]


class Residuals:
    """Measured minus modelled, for chosen samples, as a function of the free parameters.

    Parameters
    ----------
    question : Question
        That the model is asked; with the channels among its outputs.
    channels : list of str
        Outputs of the question that are compared.
    measured : ndarray, shape (channels, n)
        In the channels' units; zero where the error itself is modelled.
    terms : callable
        ``terms(parameters, free, thin) -> list of Term``: every so many-th sample, with friction states for these
        parameters.
    free : list of str
        Parameters to differentiate by.
    parameters : dict of str to float
        All parameters.
    time, group, block : ndarray, shape (n,)
        Time of each sample, the pass and the block it belongs to.
    names : list of str, optional
        What the errors are called, where not as the channels.
    linked : bool
        Whether noise goes on from one pass to the next: samples in the order of time, each compared with a reference.
    lags : ndarray, shape (n,), optional
        Of paired samples, the time between both [s].
    colour : float
        What interpolation does to white noise; both as of `noise.Chain`.
    held : Held, optional
        Channels that were recorded through a filter of first order.
    own : dict of str to (str, ndarray of bool, shape (n,)), optional
        Values that a parameter has in a run: which parameter that is, and the samples of the run. Elsewhere it has the
        value under its own name.
    """

    def __init__(self, question, channels, measured, terms, free, parameters, time, group, block,
                 names=None, linked=False, lags=None, colour=1.0, held=None, own=None):
        self.time, self.group, self.block = time, group, block
        self.linked, self.lags, self.colour = linked, lags, colour
        self.held, self.own = held, own or {}
        self.question = question
        self.channels, self.measured = list(channels), measured
        self.names = list(channels if names is None else names)
        self.free, self.parameters = list(free), dict(parameters)
        self.selected = question.select(channels)
        self.terms = terms
        self.of_states = [n for n in dependent_parameters(question) if n in self.free]
        self._build()

    def _build(self):
        """Functions of value and derivatives, compiled once a question and choice of free parameters."""
        key = (tuple(self.channels), tuple(self.free), tuple(self.of_states), bool(self.held))

        def make():
            self._compile()
            return self.known, self.function, self.slots, self.state_slots, self.plain, self.constants

        self.known, self.function, self.slots, self.state_slots, self.plain, self.constants = self.question.memo(
            ("residuals", key), make)

    def _compile(self):
        q = self.selected
        u, x, p = q.symbols()
        y = q.output(u, x, p)
        means = [self.own[n][0] if n in self.own else n for n in self.free]  # the parameter behind each free value
        wanted = [n for n in dict.fromkeys(means) if n in q.parameters]
        columns = ca.vertcat(*[p[q.parameters.index(n)] for n in wanted], ca.SX(0, 1))
        self.known = [means.index(n) for n in wanted]
        slope = ca.jacobian(y, columns) if columns.numel() else ca.SX(y.numel(), 0)
        outputs = ca.cse([y, slope] + ([ca.jacobian(y, x)] if self.of_states else []))
        self.function = ArrayFunction(ca.Function("residual", [u, x, p], [ca.densify(outputs[0]), *outputs[1:]]))
        rows, cols = outputs[1].sparsity().get_triplet()
        self.slots = [(r, [k for k, n in enumerate(means) if n == wanted[c]]) for r, c in zip(rows, cols)]
        self.state_slots = list(zip(*outputs[2].sparsity().get_triplet())) if self.of_states else []
        self.plain = ArrayFunction(ca.Function("model", [u, x, p], [ca.densify(ca.cse(y))]))
        lags = self.question.select(list(self.held.lags.values()) if self.held else []).output(u, x, p)
        slope = ca.jacobian(lags, columns) if columns.numel() else ca.SX(lags.numel(), 0)
        self.constants = ca.Function("constants", [u, x, p], [ca.densify(lags), ca.densify(slope)])

    @property
    def n(self):
        """Number of samples."""
        return self.measured.shape[1]

    @cached_property
    def chain(self):
        """How the noise of the samples hangs together."""
        return chained(self.time, self.group, self.linked, self.lags, self.colour)

    def thin(self, k):
        """The same problem on every k-th sample.

        Parameters
        ----------
        k : int
            1 leaves all samples.

        Returns
        -------
        Residuals
        """
        fewer = copy.copy(self)  # shares the compiled functions
        fewer.__dict__.pop("chain", None)
        fewer.measured = self.measured[:, ::k]
        fewer.terms = lambda parameters, free, thin=1: self.terms(parameters, free, k * thin)
        fewer.time, fewer.group, fewer.block = self.time[::k], self.group[::k], self.block[::k]
        fewer.lags, fewer.colour = None if self.lags is None else self.lags[::k], 1.0
        fewer.held = self.held and replace(self.held, where=self.held.where[::k])
        fewer.own = {n: (of, inside[::k]) for n, (of, inside) in self.own.items()}
        return fewer

    def _arguments(self, term, parameters, where):
        q = self.selected
        values = {n: float(parameters[n]) for n in q.parameters}
        for name, (of, inside) in self.own.items():
            if of in values and name in parameters:
                values[of] = np.where(inside[where], float(parameters[name]), values[of])
        return ([_slice(term.signals.get(n, 0.0), where) for n in q.inputs] + [s[where] for s in term.states]
                + [values[n] for n in q.parameters])

    def blocks(self, x, where=None):
        """Yield (slice, residual, derivative of the model) over consecutive samples.

        Parameters
        ----------
        x : sequence of float
            Values of the free parameters.
        where : slice, optional
            Samples wanted.

        Yields
        ------
        slice, ndarray of shape (channels, m), ndarray of shape (channels, free, m)
            Samples, their residual and its derivative by the free parameters, in the channels' units.
        """
        parameters = {**self.parameters, **dict(zip(self.free, x))}
        terms, held = self.terms(parameters, self.of_states), self._behind(parameters)
        where = where or slice(0, self.n)
        for start in range(where.start, where.stop, _CHUNK):
            part = slice(start, min(start + _CHUNK, where.stop))
            m = part.stop - part.start
            residual = self.measured[:, part].copy()
            slope = np.zeros((len(self.channels), len(self.free), m))
            for term in terms:
                self._add(term, parameters, part, m, residual, slope)
            for channel, behind, by_parameter in held:
                residual[channel] += behind[part]
                for k, own in by_parameter:
                    slope[channel, k] -= own[part]
            yield part, residual, slope

    def _behind(self, parameters):
        """By how much each held channel is recorded behind the model, and derivatives by some free parameters."""
        if not self.held:
            return []
        q = self.selected
        lags, known = self.constants(np.zeros(len(q.inputs)), np.zeros(len(q.states)),
                                     [float(parameters[n]) for n in q.parameters])
        return [(channel, behind, [(k, share * by_lag) for k, share in zip(self.known, own) if share])
                for (channel, behind, by_lag), own in zip(self.held.behind(lags.full()[:, 0]), known.full())]

    def _add(self, term, parameters, part, m, residual, slope):
        for inner, values in self.function.blocks(self._arguments(term, parameters, part), m):
            c = len(self.channels)
            residual[:, inner] -= term.weight * values[:c]
            for k, (channel, columns) in enumerate(self.slots):
                for column in columns:
                    own = self.own.get(self.free[column])
                    share = term.weight if own is None else term.weight * own[1][part][inner]
                    slope[channel, column, inner] += share * values[c + k]
            offset = c + len(self.slots)
            for k, (channel, state) in enumerate(self.state_slots):
                for f, name in enumerate(self.of_states):
                    moved = term.sensitivities[f, state, part][inner]
                    slope[channel, self.free.index(name), inner] += term.weight * values[offset + k] * moved

    def residual(self, x, some=slice(None)):
        """Residual of all samples, or of some.

        Parameters
        ----------
        x : sequence of float
            Values of the free parameters.
        some : slice or ndarray of int
            Samples that are wanted; all by default.

        Returns
        -------
        ndarray, shape (channels, n)
            In the channels' units.
        """
        parameters = {**self.parameters, **dict(zip(self.free, x))}
        result = self.measured[:, some].copy()
        for term in self.terms(parameters, ()):
            for inner, values in self.plain.blocks(self._arguments(term, parameters, some), result.shape[1]):
                result[:, inner] -= term.weight * values
        for channel, behind, _ in self._behind(parameters):
            result[channel] += behind[some]
        return result

    def gram(self, x, weights, robust=False):
        """Moments of the weighted derivative and residual, [J r]' [J r].

        They hold all a least-squares step needs, whatever the number of samples.

        Parameters
        ----------
        x : sequence of float
            Values of the free parameters, in their order.
        weights : sequence of float
            One a channel.
        robust : bool
            Weigh residuals that are far out down; see `huber`.

        Returns
        -------
        ndarray, shape (p + 1, p + 1)
        """
        p = len(self.free)
        total = np.zeros((p + 1, p + 1))
        trust = np.sqrt(huber(self.residual(x))) if robust else None
        for part, residual, slope in self.blocks(x):
            for c, weight in enumerate(weights):
                add_moments(total, slope[c], residual[c], weight * trust[c, part] if robust else weight)
        return total


def add_moments(total, slope, residual, weight):
    """Add the moments of one channel's weighted derivative and residual: most parameters change few channels.

    Parameters
    ----------
    total : ndarray, shape (p + 1, p + 1)
        To be added to.
    slope : ndarray, shape (p, n)
        Of the channel, by the free parameters.
    residual : ndarray, shape (n,)
        Of the channel.
    weight : float or ndarray, shape (n,)
        Of the channel, or of each sample.
    """
    live = np.flatnonzero(slope.any(axis=1))
    rows = np.empty((len(live) + 1, len(residual)))
    np.multiply(slope[live], weight, out=rows[:-1])
    np.multiply(residual, weight, out=rows[-1])
    live = np.append(live, len(slope))
    total[np.ix_(live, live)] += rows @ rows.T


def huber(residual):
    """Weights of samples by how far out they are [1]_.

    Parameters
    ----------
    residual : ndarray, shape (channels, n)
        Measured minus modelled, in the channels' units.

    Returns
    -------
    ndarray, shape (channels, n)
        1 up to 1.345 median spreads of the channel, where 95 % of the efficiency at normal noise is kept; beyond, as
        one over the distance.

    References
    ----------
    .. [1] Huber, P. J. (1964). Robust estimation of a location parameter. Annals of Mathematical Statistics 35(1).

    Examples
    --------
    One sample of six is far out, and counts for a tenth:

    >>> huber(np.array([[0.1, -0.2, 0.1, -0.1, 0.2, 3.0]])).round(2).tolist()
    [[1.0, 1.0, 1.0, 1.0, 1.0, 0.1]]
    """
    spread = 1.4826 * np.median(np.abs(residual), axis=1, keepdims=True)
    spread[spread == 0] = np.inf
    return np.minimum(1.0, 1.345 * spread / np.maximum(np.abs(residual), 1e-300))


def _slice(value, where):
    return value[where] if isinstance(value, np.ndarray) else value


def held(dataset, question, index):
    """Channels of a data set that a filter has held back.

    Parameters
    ----------
    dataset : Dataset
        Its logs are what is compared.
    question : Question
        That the model is asked; its `held` names the channels.
    index : ndarray of int, shape (n,)
        Samples of the residual.

    Returns
    -------
    Held or None
        None where nothing is held back.
    """
    lags = {dataset.compared(c): n for c, n in question.held.items() if dataset.compared(c)}
    if not lags:
        return None
    return Held({dataset.outputs.index(c): n for c, n in lags.items()},
                [partial(held_of_load, dataset, c) for c in lags], index)


def evaluated(dataset, model, part, signals):
    """What a residual is made of, as a function of the parameters.

    Parameters
    ----------
    dataset : Dataset
        Its logs are what is compared.
    model : Model
        With whatever effects are attached.
    part : str or ndarray of int
        As for `Dataset.choose`.
    signals : dict of str to ndarray, shape (n,)
        That the model is given, as recorded.

    Returns
    -------
    callable
        ``terms(parameters, free, thin=1) -> list of Term``, of every so many-th sample, by which friction states are
        followed too.
    """
    question, picks = dataset.ask(model), dataset.picks(part)
    cached, stateful, read = {}, dependent_parameters(question), _read(dataset, question)
    still = {n: v for n, v in signals.items() if n in read and n not in question.late}
    at, taken, paths = {}, {}, {}

    def terms(values, with_respect_to, thin=1):
        key = (tuple(values[n] for n in stateful), tuple(with_respect_to), thin)
        if key not in cached:
            cached.clear()
            if thin not in taken:
                at[thin] = slice(None) if dataset.paired else picks[0][1][::thin]
                taken[thin] = [{n: _at(take, v, thin) for n, v in still.items()} for _, _, take in picks]
                paths[thin] = _path(dataset, part, at[thin], thin)
            path, inside = paths[thin]
            states, sensitivities = dataset.states(model, values, with_respect_to, path)
            moved = dataset.moved(question, values, signals, at[thin])
            cached[key] = [Term(weight, {**given, **(
                {n: _at(take, v, thin) for n, v in moved.items()} if dataset.paired else moved)},
                *(_at(take, v, thin) if dataset.paired else v[..., inside] for v in (states, sensitivities)))
                for (weight, _, take), given in zip(picks, taken[thin])]
        return cached[key]

    return terms


def _path(dataset, part, wanted, thin):
    """The samples by which states are followed, and where in them those are that are wanted; of pairs, all."""
    path = slice(None) if dataset.paired else dataset.path(part, thin, _STRIDE)
    return path, wanted if isinstance(path, slice) else np.searchsorted(path, wanted)


def _at(take, value, thin):
    return take(value)[..., ::thin] if isinstance(value, np.ndarray) else value


def _read(dataset, question):
    """Inputs that the errors, the segments' loads or the friction states depend on."""
    def make():
        u, x, p = question.symbols()
        chosen = question.select(dataset.outputs + [n for n in question.outputs if n.endswith(".L")])
        used = {s.name() for s in ca.symvar(ca.vertcat(chosen.output(u, x, p), question.rate(u, x, p)))}
        return {n for n, s in zip(question.inputs, ca.vertsplit(u)) if s.name() in used}

    return question.memo(("residuals.read", *dataset.outputs), make)

"""Model, data and catalogue in; for every candidate effect, the change of the residual that it would make, out.

An effect acts through the ports of its place. The model says how the error channels respond to a port (a probe hangs
there), the effect's own file says what it adds to the port, and the product is the candidate's column. Nothing is
refitted and no model is compiled for this.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from ..compile import catalogue, compile_model, places, ranked
from ..compile.contribution import AHEAD, HELD, Contribution, additions, effect_question
from ..compile.effects import PARTNER, ports
from ..data.instruments import rounding
from ..data.noise import contiguous
from ..data.residuals import Residuals
from ..data.torques import of_load
from ..dynamics.delays import Record
from ..dynamics.filters import first_order
from ..dynamics.states import propagate

_LIMIT = 300e6  # bytes of columns held at once; more samples are thinned
_ENOUGH = 12000  # samples to test by; longer logs are thinned, the noise of the residual averaged ..
_SHORT = 0.05  # .. over at most so many seconds


@dataclass
class Candidate:
    """An effect at a place and a grid point, with the columns that stand for it.

    Attributes
    ----------
    effect : Effect
        Of the library, or of the study's own files.
    place : Place
        One component, or a pair, where the effect hangs.
    grid : dict of str to float
        Values of the coefficients that vanish with the effect.
    parts : list of list of int
        One list of column numbers a coefficient; joined places sum theirs.
    names : list of str
        Coefficient of each part.
    lower, upper : ndarray
        Bounds of the coefficients, relative to neutral.
    """

    effect: object
    place: object
    grid: dict
    parts: list
    names: list
    lower: np.ndarray
    upper: np.ndarray
    extra: dict = field(default_factory=dict)

    @property
    def key(self):
        """Effect and place."""
        return self.effect.id, self.place.name


def _averaged(values, pieces, width):
    """Running mean over so many samples, within pieces."""
    found = np.empty_like(values)
    for s in pieces:
        n = s.stop - s.start
        sums = np.concatenate([np.zeros((len(values), 1)), np.cumsum(values[:, s], axis=1)], axis=1)
        low = np.maximum(np.arange(n) - width // 2, 0)
        high = np.minimum(np.arange(n) + width // 2 + 1, n)
        found[:, s] = (sums[:, high] - sums[:, low]) / (high - low)
    return found


def grids(effect, scan_values):
    """Grid points of an effect's vanishing coefficients, without the cycles (they are scanned apart).

    Parameters
    ----------
    effect : Effect
        Of the library, or of the study's own files.
    scan_values : dict of str to ndarray
        Values to try, by kind of grid; see `Table.scan_values`.

    Returns
    -------
    list of dict of str to float
        One empty point where nothing vanishes.
    """
    axes = [(c, scan_values[kind]) for c, kind in effect.scan.items() if kind in scan_values]
    return [dict(zip([c for c, _ in axes], point)) for point in itertools.product(*[v for _, v in axes])]


class Table:
    """All candidates of a fitted model, and their columns on the fit part.

    Parameters
    ----------
    dataset : Dataset
        Gives samples and signals.
    model : Model
        With the effects accepted so far.
    fit : Fit
        Of the model; columns are derivatives at its values.
    part : str
        ``"fit"``, ``"test"``, ``"all"``, or numbers of blocks.
    """

    def __init__(self, dataset, model, fit, part="fit"):
        self.dataset, self.model, self.fit, self.part = dataset, model, fit, part
        self.library = dataset.library
        self.probe_model = compile_model(self.library, model.rig, model.keys, True)
        self.probes = [n for n in self.probe_model.parameters if n.startswith("probe_")]
        self._evaluate()
        self._signals()
        self._catalogue()
        self._columns()

    def _evaluate(self):
        """Residual, derivative by the free parameters, and response to every probe, term by term."""
        parameters = {**{n: v.value for n, v in self.probe_model.parameters.items()}, **self.fit.parameters}
        free = [*self.fit.free, *self.probes]
        exogenous = self.dataset.exogenous()
        whole = self.dataset.residuals(self.probe_model, free, parameters, self.part, exogenous)
        x = [*self.fit.values, *np.zeros(len(self.probes))]
        effects = len(ranked(self.library))
        most = min(_ENOUGH, _LIMIT / (len(whole.channels) * 12.0 * effects * 8))
        self.thin = max(1, int(np.ceil(whole.n / most))) | 1  # odd, so that an average has its sample in the middle
        whole = whole.thin(self.thin) if self.thin > 1 else whole
        self.time, self.group, self.block, self.chain = whole.time, whole.group, whole.block, whole.chain
        self.run = self.dataset.run[self.dataset.picks(self.part)[0][1]][::self.thin]
        p = len(self.fit.free)
        self.responses = []
        for k, term in enumerate(whole.terms({**parameters}, whole.of_states)):
            single = Residuals(whole.question, whole.channels, np.zeros_like(whole.measured),
                               lambda values, wrt, k=k: [whole.terms(values, wrt)[k]], free, parameters,
                               whole.time, whole.group, whole.block, held=whole.held, own=whole.own)
            slope = np.concatenate([j for _, _, j in single.blocks(x)], axis=2)
            self.responses.append(slope[:, p:])
            self.slope = slope[:, :p] if k == 0 else self.slope + slope[:, :p]
        plain = self.dataset.residuals(self.model, self.fit.free, self.fit.parameters, self.part)
        self.width = 1
        if self.thin > 1:
            usual = float(np.median(np.diff(plain.time)))
            self.width = min(self.thin, int(_SHORT / max(usual, 1e-9)) // 2 * 2 + 1)
        self._pieces = contiguous(plain.time, plain.group)
        self.residual = self.thinned(plain.residual(self.fit.values))
        self._rounding = rounding(self.dataset, self.model, self.fit, self.part)
        self.path = self.dataset.path(self.part, self.thin)
        self.channels = self.dataset.channels

    def thinned(self, values):
        """Values at the samples of the table: means of their neighbours where the log is thinned.

        Parameters
        ----------
        values : ndarray, shape (channels, all samples of the part)
            In any unit.

        Returns
        -------
        ndarray, shape (channels, n)
        """
        return _averaged(values, self._pieces, self.width)[:, ::self.thin] if self.thin > 1 else values

    def roundings(self, count, seed=0):
        """Residuals that rounding alone might have left.

        Parameters
        ----------
        count : int
            How many residuals are drawn.
        seed : int
            Of the zeros of the instruments.

        Returns
        -------
        ndarray, shape (count or 0, channels, n)
            None of them where no column is coarser than its noise.
        """
        if self._rounding is None:
            return np.zeros((0, *self.residual.shape))
        rng = np.random.default_rng(seed)
        return np.array([self.thinned(self._rounding(rng)) for _ in range(count)])

    def _signals(self):
        """Signals of the ports at the samples of each term."""
        d, q = self.dataset, self.model
        segments, motors = q.components("friction"), q.components("signal")
        names = [f"{c}.{v}" for c in segments for v in ("w", "L", "s")] + [f"{c}.phi" for c in motors]
        names += [f"{c}.{port}.{v}" for port, kind in ports(self.library).items() for c in q.components(port)
                  for v in kind.potentials]
        names += sorted({i for e in catalogue(self.library).values() for i in e.inputs})
        self.full = {**d.signals, **d.measured, **d.segment_signals(q, self.fit.parameters, names, None, d.exogenous())}
        self._followed, self._records = {}, {}
        self._kept, self._own = {}, {id(v) for v in (d.time, *self.full.values())}
        self.takes = [take for _, _, take in d.picks(self.part)]

    def port_signals(self, effect, component, term=None, partner=None, times=(0.0, 0.0)):
        """Signals that an effect reads at a component, at all samples or at those of a term.

        Parameters
        ----------
        effect : Effect
            Of the library, or of the study's own files.
        component : str
            Of the rig, as ``s1A``.
        term : int, optional
            Number of the residual's term; its samples are thinned like the table.
        partner : str, optional
            Other component of a pair.
        times : (float, float)
            Delay and time constant of an effect that holds a record back [s].

        Returns
        -------
        dict of str to ndarray, shape (n,)
            By name in the effect. A number where it is the same for all samples, None where the log does not give it.
        """
        found = {"time": None if self.dataset.averaged else self.dataset.time}
        for connector in effect.connectors:
            found.update(self._potentials(connector, effect, component if partner is None or connector != PARTNER
                                          else partner))
        found["flange.phi"] = self.full.get(f"{component}.phi")
        found["der(der(flange.phi))"] = self.full.get(f"der(der({component}.phi))")
        if effect.channel:
            now = found["signal.tau"]
            found[AHEAD] = None if now is None else self._ahead(now, *times)
        if HELD in effect_question(self.library, effect).inputs:
            channel = self.dataset.compared(component)
            found[HELD] = None if channel is None else self._ahead(of_load(self.dataset, channel), *times)
        found.update({i: self.full.get(i) for i in effect.inputs})
        if term is None:
            return found
        return {n: self._taken(term, v) if isinstance(v, np.ndarray) else v for n, v in found.items()}

    def _ahead(self, now, delay, lag):
        """What a signal is ahead of itself a delay earlier, or behind a filter of first order."""
        if lag:
            now = now[self.path]
            filtered = first_order(now[None], lag, self.dataset.time[self.path], self.dataset.run[self.path])[0][0]
            return self._spread(now - filtered)
        if id(now) not in self._records:
            self._records[id(now)] = Record(self.dataset.clock, now)
        return self._spread(now[self.path] - self._records[id(now)].at(-delay, self.path)[0])

    def _spread(self, values):
        """Values along the path as an array over all samples, zero between."""
        found = np.zeros((*values.shape[:-1], len(self.dataset.time)))
        found[..., self.path] = values
        return found

    def _taken(self, term, values):
        """A signal at the samples of a term; most are asked for by many candidates."""
        if id(values) not in self._own:
            return self.takes[term](values)[::self.thin]
        key = term, id(values)
        if key not in self._kept:
            self._kept[key] = self.takes[term](values)[::self.thin]
        return self._kept[key]

    def _potentials(self, connector, effect, component):
        """What a connector of an effect offers at a component."""
        kinds = ports(self.library)
        port = connector if connector in kinds else next(
            (p for p in effect.ports if effect.connectors[p] == effect.connectors[connector]), connector)
        found = {f"{connector}.{v}": self.full.get(f"{component}.{port}.{v}")
                 for v in (kinds[port].potentials if port in kinds else ())}
        if f"{connector}.f0" in found:
            found[f"{connector}.f0"] = max(self.fit.parameters.get(f"{component}.f0", 0.0), self.least_loss(component))
        if found.get(f"{connector}.mu") is not None:
            found[f"{connector}.mu"] = np.minimum(found[f"{connector}.mu"], self.most_efficient(component))
        return found

    def reads(self, effect):
        """What an effect reads of the ports of its place.

        Parameters
        ----------
        effect : str
            Its id.

        Returns
        -------
        set of str
            Names without the port's, as ``mu``.
        """
        return {n.partition(".")[2] for n in effect_question(self.library, catalogue(self.library)[effect]).inputs}

    def least_loss(self, component):
        """Loss below which an effect relative to it could not be seen; a missing effect can press f0 to zero.

        Parameters
        ----------
        component : str
            Of the rig, as ``s1A``.

        Returns
        -------
        float
            In the unit of ``f0``; zero for a component without one.
        """
        v = self.fit.variables.get(f"{component}.f0")
        return 0.2 * v.nominal if v is not None else 0.0

    def most_efficient(self, component):
        """Efficiency above which an effect on the load term could not be seen; a missing one can press mu to one.

        Parameters
        ----------
        component : str
            Of the rig, as ``s1A``.

        Returns
        -------
        float
            [1]; one where ``mu`` is not fitted.
        """
        v = self.fit.variables.get(f"{component}.mu")
        return 1 - 0.5 * v.nominal if v is not None and v.name in self.fit.free else 1.0

    # ---- which candidates

    def _catalogue(self):
        self.offers, self.scans, self.unavailable, self.rejected = [], [], [], []
        attached = set(self.model.keys)
        touched = {(e.id, c) for e, p in self.model.attached for c in p.components}
        for effect in ranked(self.library):
            for place in places(self.library, self.model.rig, effect):
                if (effect.id, place.name) in attached or any((effect.id, c) in touched for c in place.components):
                    continue
                if self.dataset.paired and "reference" in effect.connectors:  # compared with nothing that was measured
                    continue
                if effect.replaces and any(f"{c}.{effect.replaces}" in self.fit.free for c in place.components):
                    continue
                if self.dataset.study.rules_out(effect.id, place.name):
                    self.rejected.append((effect, place))
                    continue
                missing = self._missing(effect, place)
                if missing:
                    self.unavailable.append((effect, place, missing))
                    continue
                if "cycles" in effect.scan.values():
                    self.scans.append((effect, place))
                else:
                    self.offers.append((effect, place))

    def _missing(self, effect, place):
        """Signals that the effect reads and that the log does not give."""
        question = effect_question(self.library, effect)
        needed = question.inputs
        if self.dataset.averaged and question.states and {"lag", "rest"} & set(effect.scan.values()):
            return ["time"]  # what moves in time has nothing to say of means
        return [n for c in place.components
                for n, v in self.port_signals(effect, c, None, place.partner(effect, c)).items()
                if n in needed and v is None]

    def scan_values(self, component):
        """Grids for coefficients that vanish with their effect, from what the data cover.

        Parameters
        ----------
        component : str
            Of the rig, as ``s1A``.

        Returns
        -------
        dict of str to ndarray
            By kind of grid: ``time``, ``delay``, ``lag``, ``rest`` [s], ``quadrature``, ``power`` [1], ``angle``,
            ``travel`` [rad], ``speed``, ``creep`` [rad/s]; without those that the data say nothing of.
        """
        if component not in self._grids:
            self._grids[component] = self._scan_values(component)
        return self._grids[component]

    def _scan_values(self, component):
        view = self.takes[0]
        time = self.time
        values = {"time": np.geomspace(max(np.ptp(time) / 40, 0.5), max(2 * np.ptp(time), 1.0), 7),
                  "quadrature": np.array([0.0, np.pi / 2]), "power": np.array([0.2, 0.35, 0.5, 0.65, 0.8])}
        if len(self.dataset.time) > 1 and not self.dataset.averaged:
            delays = np.median(np.diff(self.dataset.time)) * np.geomspace(0.5, 32, 12)
            values["delay"], values["lag"] = np.r_[-delays[::-1], delays], delays
            values["rest"] = self._pause(10 * np.median(np.diff(self.dataset.time))) * np.array([0.5, 5.0])
        angles = [v for n, v in self.full.items() if n.endswith(".beside.phi")]
        if angles:  # where a spring has no torque, in the workspace or beyond; alike for all joints, which may share it
            low, high = min(v.min() for v in angles), max(v.max() for v in angles)
            values["angle"] = np.linspace(2 * low - high, 2 * high - low, 11)
        speed = self.full.get(f"{component}.w")
        if speed is not None:
            speed = np.abs(view(speed))
            low, high = np.quantile(speed, [0.02, 0.98])
            values["speed"] = np.geomspace(max(low / 2, 1e-3), max(1.5 * high, 2e-3), 9)
            values["creep"] = values["speed"][0] * np.array([1.0, 8.0])
            moved = np.abs(speed[::self.thin]) * np.gradient(time).clip(0, 1)
            path = [moved[s].sum() for s in contiguous(time, self.group)]
            values["travel"] = np.geomspace(5e-4, max(np.median(path) / 2, 8e-3), 10)
        return values

    def _pause(self, least):
        """Usual time between one pass and the next, or the least that one may mean by that [s]."""
        pairs = itertools.pairwise(contiguous(self.time, self.group))
        pauses = [self.time[two.start] - self.time[one.stop - 1] for one, two in pairs
                  if self.run[one.start] == self.run[two.start]]
        return max(float(np.median(pauses)) if pauses else 0.0, least)

    def _columns(self):
        self._grids = {}
        self.candidates, self.columns, index = [], [], {}
        for effect, place in self.offers:
            contribution = self.contribution(effect)
            for number, grid in enumerate(grids(effect, self.scan_values(place.components[0]))):
                for component in place.components:
                    partner = place.partner(effect, component)
                    key = (effect.id, component, partner, number)
                    if key not in index:
                        own = grids(effect, self.scan_values(component))[number]
                        index[key] = len(self.columns)
                        self.columns.extend(self.column(contribution, component, own, partner))
                d = len(contribution.coefficients)
                starts = [index[(effect.id, c, place.partner(effect, c), number)] for c in place.components]
                parts = [[s + k for s in starts] for k in range(d)]
                self.candidates.append(self.candidate(contribution, place, grid, parts))

    def contribution(self, effect):
        """What an effect adds to its ports; made once.

        Parameters
        ----------
        effect : Effect
            Of the library, or of the study's own files.

        Returns
        -------
        Contribution
        """
        return self.library.memo(("contribution", effect.id), lambda: Contribution(self.library, effect))

    def described(self, contribution):
        """Coefficients of an effect, with bounds and nominal values in proportion to the machine.

        Parameters
        ----------
        contribution : Contribution
            Of one effect, as `contribution` gives it.

        Returns
        -------
        dict of str to Variable
        """
        return self.dataset.sizes.described(contribution.effect, contribution.question.variables)

    def candidate(self, contribution, place, grid, parts):
        """A candidate with the bounds of its coefficients.

        Parameters
        ----------
        contribution : Contribution
            Of one effect, as `contribution` gives it.
        place : Place
            Of the effect, with its components.
        grid : dict of str to float
            Values of the coefficients that vanish with the effect.
        parts : list of list of int
            Column numbers of each coefficient.

        Returns
        -------
        Candidate
        """
        effect, described = contribution.effect, self.described(contribution)
        bounds = [(0.0, 2.0) if c in effect.scan else (described[c].min - described[c].value,
                                                       described[c].max - described[c].value)
                  for c in contribution.coefficients]
        lower, upper = np.array(bounds).T
        return Candidate(effect, place, grid, parts, contribution.coefficients, lower, upper)

    def _states(self, contribution, component, grid, partner):
        """States of an effect at every sample of the path, shape (states, n)."""
        q, d = contribution.question, self.dataset
        if not q.states:
            return np.zeros((0, len(d.time)))
        values = {**contribution.defaults, **grid}
        named = ca.vertcat(*[ca.SX.sym(n) for n in q.inputs])
        rate = q.rate(named, q.symbols()[1], ca.vertcat(*[values[n] for n in q.parameters]))
        key = component, partner, str(rate)
        if key not in self._followed:  # effects share states that move alike
            signals = {n: v[self.path] if isinstance(v, np.ndarray) else v
                       for n, v in self.port_signals(contribution.effect, component, None, partner).items()}
            self._followed[key] = propagate(q, signals, d.time[self.path], values, d.run[self.path])[0]
        return self._spread(self._followed[key])

    def column(self, contribution, component, grid, partner=None):
        """Columns of an effect at a component.

        Parameters
        ----------
        contribution : Contribution
            Of one effect, as `contribution` gives it.
        component : str
            Of the rig, as ``s1A``.
        grid : dict of str to float
            Values of the coefficients that vanish with the effect.
        partner : str, optional
            Other component of a pair.

        Returns
        -------
        ndarray, shape (coefficients, channels, n)
            Change of the modelled channels, in their units, a unit of each coefficient.
        """
        q = contribution.question
        total, probes = 0.0, additions(self.library, contribution.effect)
        grid = {**self.dataset.parameters.means(contribution.effect, (component,)), **grid}
        times = contribution.times(grid)
        states = self._states(contribution, component, grid, partner)
        for term, response in enumerate(self.responses):
            n = response.shape[2]
            signals = self.port_signals(contribution.effect, component, term, partner, times)
            added = contribution(signals, [self.takes[term](s)[::self.thin] for s in states], grid, n)
            part = 0.0
            for k, port in enumerate(q.outputs):
                connector, addition = probes[port]
                probe = self.probes.index(f"{self.model.probe(component, connector)}.{addition}")
                part = part + added[:, k][:, None, :] * response[None, :, probe]
            total = total + part
        return total

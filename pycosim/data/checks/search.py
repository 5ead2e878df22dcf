"""Relations between columns in; the fewest discrete mistakes that explain why they do not hold, out.

Each sign, place and unit is changed in turn, and the rig's model is fitted again each time, on few samples. A change is
a finding where it takes the error down by a large factor, to where a sound log's error is. That is far beyond what any
missing effect does: effects add to the error of a model that is right in the main; a mistake of this kind leaves
nothing right. Two mistakes are undone one after the other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...core.words import listed
from ...study.schema import known_unit
from .asking import weight
from .changes import Columns, in_unit, roles, signs_and_swaps, snapped, unit_changes
from .finding import Finding
from .readings import Source, with_change
from .relations import RateRelation
from .zeros import turned

BAD = 0.05
"""Relative error from which a relation is looked into at all; a tenth of the largest hidden effects' and less."""
CLOSE = 0.015
"""The same of what the load weighs, where the study says that its reference was computed so: none of it is measured."""
LEAST = 3.0
"""Factor by which the error of some channel must fall: hidden effects of the largest size are undone by no change of
sign, place or unit, and the factor by which one may happen to lower them stays below 1.5."""
SOUND = 0.35
"""Relative error that may be left: that of a sound fit, or of one that lacks a large effect."""
UNLIKE = 0.9
"""Relative error from which a channel hardly follows from the columns that it is told from."""
_FLOOR = 0.01  # relative error below which less is no better
_WORSE = 1.3  # factor by which another channel may get worse
_MOST = 4  # mistakes in one log
_STEP = math.log(1.25)  # mean fall of one of several mistakes
_PRIOR = math.log(100.0)  # a log as given is that much likelier to be right than to have one given mistake
_GAINED = 0.02  # relative error, noise apart, from which a gain is looked for
_GAIN = 1.5  # factor by which it must lower it
_FACTOR = 0.3  # relative error from which a torque may be off by a factor outside the next
_SAME = 0.2  # logarithm within which two factors are one
_STARTS = 4.0, 16.0  # times the study's values
_DOUBT = 0.5  # of what is sure of a change that leaves the load's weight as wrong as it was: noisy motion does that
_PLAUSIBLE = 0.5, 2.0  # factors of a torque that a wrong torque constant may have


@dataclass
class State:
    """A log with some mistakes undone."""

    sources: dict
    holds: dict
    changes: list

    def cost(self):
        """Sum of the logarithms of all relative errors.

        Returns
        -------
        float
        """
        return sum(map(_cost, self.holds.values()))

    def smooth_cost(self):
        """The same of the errors that are no noise.

        Returns
        -------
        float
        """
        return sum(math.log(max(e, 1e-4)) for a in self.holds.values() for e in a.smooth.values())

    def worst(self):
        """Largest relative error that is no noise.

        Returns
        -------
        float
        """
        return max((e for a in self.holds.values() for e in a.smooth.values()), default=0.0)


class Search:
    """Trial of changes on the relations of a study's logs.

    Parameters
    ----------
    study : Study
        Its columns are what may be wrong.
    model : Model
        The rig with the study's effects; gear ratios among its parameters are factors to try.
    readings : Readings
        At few enough samples to fit the model once for each change.
    sources : dict of str to Source
        How each variable is read before any change.
    relations : list
        `ModelRelation` and `RateRelation` that the columns are held against.
    steps : dict of str to float
        Steps in which raw numbers change.
    """

    def __init__(self, study, model, readings, sources, relations, steps):
        self.readings, self.relations, self.steps, self.model = readings, relations, steps, model
        self.columns = Columns(study, readings.names)
        self.group = roles(readings.names, relations)
        self.ratios = {n: p.value for n, p in model.parameters.items()
                       if p.unit == "1" and n.rsplit(".")[-1] in ("ratio", "t_r", "gear_ratio", "N") and p.value > 1.5}
        self.bad = [CLOSE if study.reference == "gravity_model" and getattr(r, "name", "") == "weight" else BAD
                    for r in relations]
        self.given = State(sources, self._hold(sources), [])

    @cached_property
    def _fair(self):
        """The log as given, fitted from several starts: a fit that sticks half-way is no mistake of the log."""
        return State(self.given.sources, {**self.given.holds, **{k: self._from_elsewhere(k) for k in self._off(
            self.given)}}, [])

    def _from_elsewhere(self, k):
        relation = self.relations[k]
        return self._best_of(k, self.given, [start * relation.given[relation.at] for start in _STARTS if relation.free])

    def _best_of(self, k, state, starts):
        """How well a relation holds in a state, from several starts as well."""
        others = [self.relations[k].hold(self.readings, state.sources, start=start) for start in starts]
        return min([state.holds[k], *others], key=_cost)

    def _fair_beside(self, state):
        """The log as given, fitted from where changes ended as well: torques that are all called larger fit no better.

        Parameters with a unit are brought to the size that the channels have as given.
        """
        found = {}
        for k in self._off(self.given):
            relation, there = self.relations[k], state.holds[k]
            starts = []
            if relation.free:
                size = [np.linalg.norm(relation.measured(self.readings, s)) for s in (
                    self.given.sources, state.sources)]
                sized = np.array([relation.units[n] != "1" for n in relation.free])
                starts.append(np.where(sized, size[0] / max(size[1], 1e-300), 1.0) * there.x)
            found[k] = self._best_of(k, self._fair, starts)
        return State(self.given.sources, {**self._fair.holds, **found}, [])

    def _hold(self, sources, known=None, changed=None):
        return {k: known[k] if known and not (r.variables & changed) else r.hold(self.readings, sources)
                for k, r in enumerate(self.relations)}

    def _after(self, state, change):
        sources = with_change(state.sources, change.sources)
        return State(sources, self._hold(sources, state.holds, change.variables), [*state.changes, change])

    def run(self):
        """Undo mistakes one after the other.

        Returns
        -------
        State
            The log as given, where no mistake explains it.
        rivals : list of list of State
            For each mistake, other changes that explain as much.
        """
        state, rivals = self.given, []
        while len(state.changes) < _MOST and self._off(state):
            tried = [self._after(state, c) for c in self.candidates(state)]
            best = min(tried, key=self._price, default=None)
            if state.worst() > _FACTOR and (best is None or best.worst() > BAD):
                tried += [self._after(state, c) for c in self._currents(state)]
            tried = [t for t in tried if self._harmless(state, t)]
            if not tried:
                break
            best = min(tried, key=self._price)
            if state.cost() - best.cost() < _STEP:
                break
            rivals.append([t for t in tried if t is not best and abs(self._price(t) - self._price(best)) < 0.5])
            state = best
        return self._decisive(state, rivals)

    def _off(self, state):
        """Relations that do not hold, by their place."""
        return [k for k, bad in enumerate(self.bad) if max(state.holds[k].smooth.values(), default=0.0) >= bad]

    def _price(self, state):
        """Cost, and a little for each column that is touched: of two explanations, the smaller."""
        return state.cost() + sum(0.02 * len(c.variables) + 0.1 * c.doubtful for c in state.changes)

    @staticmethod
    def _harmless(before, after):
        """Whether no channel that held well is made worse."""
        for k, old in before.holds.items():
            for channel, e in old.relative.items():
                new = after.holds[k].relative[channel]
                if e < SOUND and new > max(_WORSE * e, BAD):
                    return False
        return True

    def _decisive(self, state, rivals):
        """The state, or the log as given where the changes do not explain what is wrong."""
        while state.changes and not (decisive(self._fair_beside(state), state, self.bad) and self._no_zero(state)):
            state, rivals = self._replayed(state.changes[:-1]), rivals[:-1]
        return state, rivals

    def _no_zero(self, state):
        """Whether the changes do more than zeros of the motors would: those touch nothing but what the load weighs."""
        fallen = {k for k, old in self.given.holds.items()
                  if any(state.holds[k].relative[c] < e / LEAST for c, e in old.relative.items() if e >= self.bad[k])}
        told = [k for k in fallen if getattr(self.relations[k], "name", "") == "weight"]
        if not told or len(fallen) > 1:
            return True
        there = turned(self.relations[told[0]], self.readings, self.given.sources, self.model, self.ratios)[0]
        return _cost(there) > _cost(state.holds[told[0]])

    def _replayed(self, changes):
        state = self.given
        for change in changes:
            state = self._after(state, change)
        return state

    def candidates(self, state):
        """Changes that touch a relation that does not hold.

        Parameters
        ----------
        state : State
            Mistakes undone so far, and how well each relation holds then.

        Returns
        -------
        list of Change
        """
        bad = set().union(*[self.relations[k].variables for k in self._off(state)] or [set()])
        group = {k: [m for m in members if m in bad] for k, members in self.group.items()}
        found = [*signs_and_swaps(self.columns, self.group),
                 *unit_changes(self.columns, self.group, self.ratios, self.steps)]
        found = [c for c in found if c.variables & bad]
        return found + self._slopes(state, group)

    def _slopes(self, state, group):
        """Factors that speeds and encoders show against their angles, as changes."""
        found = []
        for relation in self.relations:
            if isinstance(relation, RateRelation):
                x = self.readings.take(state.sources[relation.speed])
                y = self.readings.take(state.sources[relation.angle], 1)
                pair = relation.speed, relation.angle
            elif relation.level and relation.channels[0] in group["encoders"]:
                x = relation.measured(self.readings, state.sources)[0]
                y = relation.predict(self.readings, state.sources, relation.given[relation.at])[0]
                x, y = x - np.median(x), y - np.median(y)
                pair = relation.channels[0], None
            else:
                continue
            power = math.sqrt(float(x @ x) * float(y @ y))
            if power and abs(x @ y) > 0.95 * power:
                factor = abs(x @ y) / (y @ y)
                if not _PLAUSIBLE[0] < factor < _PLAUSIBLE[1]:
                    for variable, f in zip(pair, (1 / factor, factor)):
                        found += snapped(self.columns, self.group, variable, f) if variable else []
        return found

    def _currents(self, state):
        """Torques that may be currents: a factor of any size, beyond what a wrong torque constant could be."""
        found, members = [], [v for v in self.group["torques"] if self.columns.column(v) is not None
                              and self.columns.column(v).dimension == "N.m" and self.columns.column(v).k_m is None]
        for chosen in ([tuple(members)] if len(members) > 1 else []) + [(m,) for m in members]:
            factor = self._best_factor(state, chosen)
            if factor is None or _PLAUSIBLE[0] <= factor <= _PLAUSIBLE[1]:
                continue
            declared = known_unit(self.columns.column(chosen[0]).unit)[1]
            found.append(in_unit(self.columns, chosen, "A", factor, float(f"{factor * declared:.4g}")))
        return found

    def _best_factor(self, state, variables):
        """Factor of some variables with the least error."""
        def cost(log_factor):
            sources = with_change(state.sources, {v: Source(v, math.exp(log_factor)) for v in variables})
            holds = self._hold(sources, state.holds, set(variables))
            return State(sources, holds, []).cost()
        grid = np.linspace(math.log(1e-3), math.log(1e3), 19)
        costs = [cost(g) for g in grid]
        k = int(np.argmin(costs))
        if costs[k] > state.cost() - math.log(1.5):
            return None
        low, high = grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)]
        for _ in range(9):
            a, b = high - 0.618 * (high - low), low + 0.618 * (high - low)
            low, high = (low, b) if cost(a) < cost(b) else (a, high)
        return math.exp((low + high) / 2)

    def gains(self, state):
        """Torques that fit better with another factor, no larger than a wrong torque constant could be.

        Parameters
        ----------
        state : State
            What `run` ended with.

        Returns
        -------
        list of Finding
        """
        found, columns = [], self.mended(state)
        torques = [v for v in self.group["torques"] if columns.column(v) is not None]
        for variable in torques if state.worst() >= _GAINED else ():
            def after(g):
                change = {variable: Source(variable, g)}
                sources = with_change(state.sources, change)
                return State(sources, self._hold(sources, state.holds, {variable}), [])
            costs = {g: after(g).smooth_cost() for g in (0.8, 0.9, 1.0, 1.1, 1.25)}
            best = min(costs, key=costs.get)
            if best == 1.0:
                continue
            low, high = sorted((best / 1.12, best * 1.12))
            for _ in range(5):
                a, b = high - 0.618 * (high - low), low + 0.618 * (high - low)
                low, high = (low, b) if after(a).smooth_cost() < after(b).smooth_cost() else (a, high)
            there = after((low + high) / 2)
            ratio = max(state.holds[k].smooth[c] / max(e, 1e-9) for k, a in there.holds.items()
                        for c, e in a.smooth.items())
            if ratio > _GAIN and abs(low + high - 2) > 0.04:
                told = [(k, c) for k, a in there.holds.items() for c, e in a.smooth.items()
                        if e < state.holds[k].smooth[c] / 1.2]
                before, then = ({c: s.holds[k].error[c] for k, c in told} for s in (state, there))
                found.append((ratio, Finding(
                    "scale", f"{columns.of(variable)} fits better times {(low + high) / 2:.3g}: "
                    f"{self._told(before, then)}", [columns.of(variable)], 0.6, before, then,
                    columns.after([("scale", variable, (low + high) / 2)]).lines(columns))))
        return [max(found, key=lambda f: f[0])[1]] if found else []

    def mended(self, state):
        """Columns as a study has them whose mistakes are mended.

        Parameters
        ----------
        state : State
            What `run` ended with.

        Returns
        -------
        Columns
        """
        return self.columns.after([e for c in state.changes for e in c.edits])

    def findings(self):
        """Mistakes found, each with the lines that mend it.

        Returns
        -------
        found : list of Finding
        state : State
            The log with the mistakes undone.
        """
        state, rivals = self.run()
        after, found, done = self.mended(state), [], self.given
        for change, others in zip(state.changes, rivals):
            there = self._after(done, change)
            told = [(k, c) for k in done.holds for c, e in done.holds[k].relative.items()
                    if max(e, there.holds[k].relative[c]) >= _FLOOR and not (
                        e / 1.2 < there.holds[k].relative[c] < 1.2 * e)]
            before, then = self._errors(state, told)
            also = [o.changes[-1] for o in others if self._equal(there, o) and o.changes[-1].variables]
            text = f"{change.text}: {self._told(before, then)}"
            if also:
                text += f"; {' or '.join(c.text for c in also[:2])} would do as well"
            text += self._or_references(change, state)
            found.append(Finding(change.kind, text, [self.columns.of(v) for v in change.sources],
                                 certainty(self.given, state, len(also)) * (_DOUBT if self._unmended(
                                     change, state) else 1.0), before, then,
                                 after.lines(self.columns, change.variables)))
            done = there
        return found, state

    def _unmended(self, change, state):
        """Whether what the load weighs, which the change touches, follows from nothing with it as without it."""
        return any(getattr(r, "name", "") == "weight" and change.variables & r.variables and min(
            min(s.holds[k].relative.values(), default=0.0) for s in (self.given, state)) > UNLIKE
            for k, r in enumerate(self.relations))

    def _or_references(self, change, state):
        """What a factor of the motors' torques may be instead: the load seems that much lighter than the rig's."""
        currents = [e for e in change.edits if e[0] == "scale" and len(e) > 4 and e[4] is not None]
        place = next((k for k, r in enumerate(self.relations) if getattr(r, "name", "") == "weight"), None)
        lighter = weight(self.relations[place], state.holds[place].x) if currents and place is not None else None
        if lighter is None or abs(math.log(max(lighter, 1e-9) / currents[0][2])) > _SAME:
            return ""
        names = [self.columns.of(c) for c in self.relations[place].channels]
        return (f"; or {listed(names)} are {lighter:.3g} times what they are called, for the load seems that much "
                "lighter than the rig's: mend those instead")

    def _errors(self, state, told):
        """Errors of some channels, as given and with all mistakes undone, each in the relation that shows it best."""
        before, after = {}, {}
        for k, c in sorted(told, key=lambda t: self.given.holds[t[0]].relative[t[1]] / max(
                state.holds[t[0]].relative[t[1]], 1e-9)):
            before[c], after[c] = self.given.holds[k].error[c], state.holds[k].error[c]
        return before, after

    def _equal(self, one, other):
        return abs(one.cost() - other.cost()) < math.log(1.15) and (
            one.changes[-1].variables != other.changes[-1].variables)

    def _told(self, before, after):
        unit = {v: self.columns.column(v).dimension for v in before if self.columns.column(v) is not None}
        return ", ".join(f"{self.columns.of(c)} {before[c]:.3g} -> {after[c]:.3g} {unit.get(c, 'N.m')}" for c in before
                         if c in after)


def _cost(agreement):
    """Sum of the logarithms of the relative errors of a relation."""
    return sum(math.log(max(e, _FLOOR)) for e in agreement.relative.values())


def decisive(before, after, bad):
    """Whether changes explain what was wrong: some errors fall by a large factor, to a sound level.

    Parameters
    ----------
    before, after : State
        With some mistakes undone, and with one more.
    bad : list of float
        Relative error of each relation that a sound log does not reach.

    Returns
    -------
    bool
    """
    fallen = False
    for k, old in before.holds.items():
        if max(after.holds[k].relative.values(), default=0.0) > UNLIKE:
            continue  # what bends to a channel that follows from nothing tells of no other
        for channel, e in old.relative.items():
            new = after.holds[k].relative[channel]
            if e >= bad[k] and new <= min(e / LEAST, SOUND):
                fallen = True
    return fallen


def certainty(before, after, rivals):
    """How sure it is that a log has the mistakes that were undone, and no other.

    The likelihood of independent residuals goes with their standard deviation to the power of minus their number. A
    residual that a mistake leaves is as smooth as the motion: what counts as independent is a stretch between
    reversals, not a sample.

    Parameters
    ----------
    before, after : State
        The log as given, and with all mistakes undone.
    rivals : int
        Other changes that explain as much.

    Returns
    -------
    float
    """
    independent = min(independent_stretches(a) for a in after.holds.values())
    gain = independent * (before.cost() - after.cost()) - _PRIOR * len(after.changes)
    return float(1.0 / (1.0 + math.exp(-min(max(gain, -50.0), 50.0)))) / (1.0 + 0.02 * rivals)


def independent_stretches(agreement):
    """Stretches in which a residual keeps its sign.

    Parameters
    ----------
    agreement : Agreement
        Of one relation; the channel with the fewest stretches counts.

    Returns
    -------
    float
        At most fifty.
    """
    counts = [1 + int(np.count_nonzero(np.diff(np.sign(r[agreement.used])))) for r in agreement.residual]
    return float(min(50, max(3, min(counts))))

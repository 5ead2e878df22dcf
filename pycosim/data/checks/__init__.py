"""Logs, study and model in; what is wrong with the data before any physics is asked, out.

First what each column shows by itself (jumps, cut-off values, outliers, steps), then whether the columns agree with
each other and with the rig: angles with speeds and encoders, motors with joints, references with what the load weighs.
Where they do not, every sign, place and unit is tried. Everything is computed on a few thousand samples, and nothing
grows with how far something travelled.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...core.words import listed
from .asking import asked
from .changes import Columns
from .clipped import clipped
from .finding import DISCRETE, FACTS, KINDS, Checked, Finding, joined, ordered
from .limits import limits
from .named import named
from .outliers import outliers, shocks, without_outliers
from .readings import Readings, Source
from .relations import WORST, ModelRelation, relations
from .sampling import clock, rate, resolution, rest
from .search import BAD, LEAST, UNLIKE, Search
from .stuck import copied, moved, stuck
from .timing import Timing, filtered
from .wrapped import wrapped
from .zeros import encoder_zeros, motor_zeros, reference_offsets, turned

__all__ = ["Checked", "DISCRETE", "FACTS", "Finding", "KINDS", "check"]

_QUIET = 0.01
"""Relative error, noise apart, below which no column is late by anything that matters."""
_FEW, _SOME, _DENSE, _MANY = 600, 2000, 20_000, 60_000
"""Samples for trials, for times, for what is small beside noise, and for what must see every sample."""


def check(study, library, model, logs):
    """Check logs before anything is learnt from them.

    Parameters
    ----------
    study : Study
        With its columns, limits, and the kinds of finding that it has answered (``accept``).
    library : Library
        Holds the study's rig.
    model : Model
        Of the study, its effects attached.
    logs : list of Log
        As recorded; none of them is changed.

    Returns
    -------
    Checked
    """
    logs = [log for log in logs if log.time.size > 20 and log.signals]
    if not logs:
        return Checked([], list(study.accept))
    shared = sorted(set.intersection(*[set(log.signals) for log in logs]))
    columns = Columns(study, shared)
    found = rate(logs, columns)
    steps, raw = resolution(logs, columns)
    unwrapped, logs, _ = wrapped(logs, columns)
    in_seconds, factor = clock(study, logs, model)
    found += steps + unwrapped + in_seconds + outliers(logs, columns, study) + copied(logs, columns)
    logs = without_outliers(logs)
    every = _Relations(study, library, model, logs, factor, raw)
    apart, sound = every.apart()
    found += apart + (every if len(sound) == len(logs) else _Relations(
        study, library, model, sound, factor, raw)).findings()
    found += named(study, logs, found)
    return Checked(joined(ordered(found), study), list(study.accept))


def _of_run(log, finding):
    """A finding that holds in one run alone."""
    where = "held_out" if log.held_out else "runs"
    return replace(finding, text=f"in {log.name} alone: {finding.text}", mend=(
        f"# {log.name}: correct {', '.join(finding.columns)} in the file, or take it out of [data] {where}; "
        "[columns] are those of all runs"))


class _Relations:
    """Findings that need more than one column."""

    def __init__(self, study, library, model, logs, factor, raw):
        self.study, self.library, self.model, self.logs = study, library, model, logs
        self.factor, self.raw = factor, raw
        self.whole = Readings(logs, _MANY, factor)
        self.sources = {n: Source(n) for n in self.whole.names}
        self.relations = relations(study, library, model, self.whole.names)
        self.few = self.whole.thinned(_FEW)
        self.search = Search(study, model, self.few, self.sources, self.relations, raw)
        self.columns, self.group = self.search.columns, self.search.group

    def apart(self):
        """Mistakes of some runs that others do not have: columns are one for all runs, so that no line mends them.

        Returns
        -------
        found : list of Finding
            Each with the name of its run; empty where the runs are alike.
        sound : list of Log
            The runs without.
        """
        if len(self.logs) < 2:
            return [], self.logs
        each = [Readings([log], _FEW, self.factor) for log in self.logs]
        zeros = self._own_zeros(each)
        if self.search.given.worst() < BAD and not self._uneven():
            return zeros, self.logs
        alone = [Search(self.study, self.model, one, self.sources, self.relations, self.raw) for one in each]
        worst = [a.given.worst() for a in alone]
        least = max(BAD, LEAST * min(worst))
        if max(worst) < least:
            return zeros, self.logs
        mistakes = [a.findings()[0] or (self._alone(log) if size >= least and min(worst) < BAD else [])
                    for a, log, size in zip(alone, self.logs, worst)]
        sound = [log for log, found in zip(self.logs, mistakes) if not found]
        if not sound:
            return zeros, self.logs
        return [_of_run(log, f) for log, found in zip(self.logs, mistakes) for f in found] + zeros, sound

    def _uneven(self):
        """Whether some run is off by much more of its size than another: all together, it is one of many outliers."""
        for relation, hold in ((r, self.search.given.holds[k]) for k, r in enumerate(self.relations)):
            if not isinstance(relation, ModelRelation) or relation.scale or hold.used is None:
                continue
            measured = relation.measured(self.few, self.sources)
            parts = [(self.few.run == k) & hold.used for k in np.unique(self.few.run)]
            off = [[np.median(np.abs(r[p])) / max(np.sqrt(np.mean(m[p] ** 2)), 1e-300) for p in parts if p.any()]
                   for r, m in zip(hold.residual, measured)]
            if any(max(o) > max(BAD, LEAST * min(o)) for o in off):
                return True
        return False

    def _alone(self, log):
        """What a run shows by itself, whose columns disagree by more than any other's."""
        found = _Relations(self.study, self.library, self.model, [log], self.factor, self.raw).findings()
        return [f for f in found if f.kind in ("zero", "disagreement")]

    def _own_zeros(self, each):
        """Zeros of the joints' encoders in single runs, where most runs agree on another."""
        told = [encoder_zeros(one, self.sources, self.relations, self.columns) for one in each]
        usual = {c for c in {c for found in told for f in found for c in f.columns}
                 if sum(any(c in f.columns for f in found) for found in told) > len(told) / 2}
        return [_of_run(log, f) for log, found in zip(self.logs, told) for f in found if not usual & {*f.columns}]

    def findings(self):
        """All findings, those about what the changes leave computed with them.

        Returns
        -------
        list of Finding
        """
        found, state = self.search.findings()
        self.columns = self.search.mended(state)  # what is found beside a mistake goes into the line that mends it
        whole = {k: r.hold(self.whole, state.sources, state.holds[k].x) for k, r in enumerate(self.relations)}
        holds = [(r, whole[k]) for k, r in enumerate(self.relations)]
        found += stuck(self.whole, state.sources, self.columns, self.group, holds)
        still = {c for f in found if f.kind == "stuck" for c in f.columns}
        forces = [n for role in ("torques", "references") for n in self.group[role] if self.columns.of(n) not in still]
        motion = moved(self.whole, state.sources, self.group)
        found += clipped(self.whole, np.ones(self.whole.time.size, bool) if motion is None else motion, self.columns,
                         forces)
        found += rest(self.logs, self._moving(whole))
        found += [] if still else self._times(state)
        if not any(f.kind in ("shift", "clock", "filtered", "stuck", "clipped") for f in found):
            sound = [(r, h) for r, h in holds
                     if not getattr(r, "always", False) or max(h.relative.values()) < BAD]
            found += shocks(self.whole, self.columns, sound, self.study)
        found += self._zeros(state)
        if not any(f.kind in ("shift", "clock", "filtered", "stuck", "clipped", "zero") for f in found):
            found += self.search.gains(state)
        if not any(f.kind in DISCRETE for f in found):
            mended = {c for f in found for c, e in f.error_after.items() if e < 0.5 * f.error_before[c]}
            found += self._unlike(state, mended)
        return found + self._limits(state) + asked(self.relations, state.holds, self.columns, self.group,
                                                   self._limited())

    def _unlike(self, state, mended):
        """Channels that do not follow from what they are told from, and nothing that was found mends it."""
        for k, relation in enumerate(self.relations):
            hold, least = state.holds[k], UNLIKE if getattr(relation, "always", False) else WORST
            off = [c for c, e in hold.relative.items() if e >= least and np.isfinite(hold.error[c]) and c not in mended]
            if off:
                names = [self.columns.of(v) for v in self.sources if v in relation.variables - {*relation.channels}]
                text = (f"{listed(self.columns.of(c) for c in off)} {'do' if len(off) > 1 else 'does'} not follow from "
                        f"{listed(names)}, and no sign, place or unit of a column mends that: "
                        + ", ".join(f"{hold.error[c]:.3g} of {hold.spread[c]:.3g} is left" for c in off)
                        + "; plot these columns over time")
                return [Finding("disagreement", text, [self.columns.of(c) for c in off], 0.9)]
        return []

    def _moving(self, whole):
        own = [whole[k].used for k, r in enumerate(self.relations)
               if isinstance(r, ModelRelation) and not r.always and whole[k].used is not None]
        return float(np.mean(own[0])) if own else None

    def _times(self, state):
        if state.worst() < _QUIET:
            return []
        some = self.whole.thinned(_SOME)
        holds = {k: r.hold(some, state.sources, state.holds[k].x) for k, r in enumerate(self.relations)}
        telling = [k for k, h in holds.items() if max(h.relative.values()) < UNLIKE]
        found = Timing(some, state.sources, [self.relations[k] for k in telling],
                       {n: holds[k] for n, k in enumerate(telling)}, self.columns, self.group,
                       self.whole.thinned(_DENSE)).findings()
        own = next((k for k, r in enumerate(self.relations) if getattr(r, "name", "") == "estimate"), None)
        if own is not None and not any(f.kind == "clock" for f in found):
            slow = filtered(self.whole, state.sources, self.relations[own], state.holds[own].x, self.columns,
                            self.group)
            if slow:
                found = [f for f in found if f.kind != "shift"] + slow
        return found

    def _zeros(self, state):
        found = encoder_zeros(self.few, state.sources, self.relations, self.columns)
        offsets = reference_offsets(self.few, state.sources, self.relations, state.holds, self.columns)
        weight = next((k for k, r in enumerate(self.relations) if getattr(r, "name", "") == "weight"), None)
        if weight is not None and (not offsets or self._turned(weight, state)):
            offsets = motor_zeros(self.few, state.sources, self.relations, weight, state.holds, self.columns,
                                  self.model, self.search.ratios)
        return found + offsets

    def _turned(self, weight, state):
        """Whether the weight is told better with other zeros of the motors than with offsets of the references."""
        relation, readings = self.relations[weight], self.few
        offset = relation.hold(readings, state.sources, state.holds[weight].x, offset=True)
        there = turned(relation, readings, state.sources, self.model, self.search.ratios)[0]
        return sum(there.relative.values()) < 0.5 * sum(offset.relative.values())

    def _known(self, state):
        """Values of everything that limits may name."""
        known = {n: self.few.take(state.sources[n]) for n in self.few.names}
        for n in self.group["angles"]:
            base = n[:-3]
            known.setdefault(f"{base}w", self.few.take(state.sources[n], 1))
            known.setdefault(f"{base}a", self.few.take(state.sources[n], 2))
        return known

    def _limits(self, state):
        units = {n: v.unit for n, v in self.model.variables.items()}
        known = {n: v for n, v in self._known(state).items() if not n.endswith(".a")}
        return limits(self.study, known, self.columns, units)

    def _limited(self):
        return all(n in self.study.limits for n in self.group["torques"])

"""Logs, study and model in; what is wrong with the data before any physics is asked, out.

First what each column shows by itself (jumps, cut-off values, outliers, steps), then whether the columns agree with
each other and with the rig: angles with speeds and encoders, motors with joints, references with what the load weighs.
Where they do not, every sign, place and unit is tried. Everything is computed on a few thousand samples, and nothing
grows with how far something travelled.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .asking import asked
from .changes import Columns
from .clipped import clipped
from .finding import DISCRETE, FACTS, KINDS, Checked, Finding, joined, ordered
from .limits import limits
from .named import named
from .outliers import outliers, shocks
from .readings import Readings, Source
from .relations import ModelRelation, relations
from .sampling import clock, rate, resolution, rest
from .search import BAD, LEAST, Search
from .stuck import copied, moved, stuck
from .timing import Timing, filtered
from .wrapped import wrapped
from .zeros import encoder_zeros, motor_zeros, reference_offsets

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
    found = rate(logs)
    steps, raw = resolution(logs, columns)
    unwrapped, logs, _ = wrapped(logs, columns)
    in_seconds, factor = clock(study, logs, model)
    found += steps + unwrapped + in_seconds + outliers(logs, columns, study) + copied(logs, columns)
    every = _Relations(study, library, model, logs, factor, raw)
    apart, sound = every.apart()
    found += apart + (_Relations(study, library, model, sound, factor, raw) if apart else every).findings()
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
        if len(self.logs) < 2 or self.search.given.worst() < BAD:
            return [], self.logs
        alone = [Search(self.study, self.model, Readings([log], _FEW, self.factor), self.sources, self.relations,
                        self.raw) for log in self.logs]
        worst = [a.given.worst() for a in alone]
        if max(worst) < max(BAD, LEAST * min(worst)):
            return [], self.logs
        mistakes = [a.findings()[0] for a in alone]
        sound = [log for log, found in zip(self.logs, mistakes) if not found]
        if not sound:
            return [], self.logs
        return [_of_run(log, f) for log, found in zip(self.logs, mistakes) for f in found], sound

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
        forces = [n for role in ("torques", "references") for n in self.group[role]]
        motion = moved(self.whole, state.sources, self.group)
        found += clipped(self.whole, np.ones(self.whole.time.size, bool) if motion is None else motion, self.columns,
                         forces)
        found += rest(self.logs, self._moving(whole))
        found += self._times(state)
        if not any(f.kind in ("shift", "clock", "filtered", "stuck", "clipped") for f in found):
            found += shocks(self.whole, self.columns, holds, self.study)
        found += self._zeros(state, whole)
        if not any(f.kind in ("shift", "clock", "filtered", "stuck", "clipped", "zero") for f in found):
            found += self.search.gains(state)
        return found + self._limits(state) + asked(self.relations, state.holds, self.columns, self.group,
                                                   self._limited())

    def _moving(self, whole):
        own = [whole[k].used for k, r in enumerate(self.relations)
               if isinstance(r, ModelRelation) and not r.always and whole[k].used is not None]
        return float(np.mean(own[0])) if own else None

    def _times(self, state):
        if state.worst() < _QUIET:
            return []
        some = self.whole.thinned(_SOME)
        holds = {k: r.hold(some, state.sources, state.holds[k].x) for k, r in enumerate(self.relations)}
        found = Timing(some, state.sources, self.relations, holds, self.columns, self.group,
                       self.whole.thinned(_DENSE)).findings()
        own = next((k for k, r in enumerate(self.relations) if getattr(r, "name", "") == "estimate"), None)
        if own is not None and not any(f.kind == "clock" for f in found):
            slow = filtered(self.whole, state.sources, self.relations[own], state.holds[own].x, self.columns,
                            self.group)
            if slow:
                found = [f for f in found if f.kind != "shift"] + slow
        return found

    def _zeros(self, state, whole):
        found = encoder_zeros(self.few, state.sources, self.relations, self.columns)
        offsets = reference_offsets(self.few, state.sources, self.relations, state.holds, self.columns)
        for k, relation in enumerate(self.relations if not offsets else ()):
            if getattr(relation, "name", "") == "weight":
                zeros = {f"{c}.phi": f"{c}.zero" for c in self.model.components("signal")}
                found += motor_zeros(self.few, state.sources, self.relations, k, state.holds, self.columns, zeros)
        return found + offsets

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

"""A data set and a base model in; effects added until nothing is left to learn, and the ladder of errors, out."""

from __future__ import annotations

from dataclasses import dataclass, field

from . import compare, identify
from .compile import compile_model
from .diagnose import diagnose, difference, select

MOST = 6  # effects that one search may add


@dataclass
class Step:
    """One step of the ladder."""

    added: tuple | None
    model: object
    fit: object
    error: dict
    held_out_error: dict


@dataclass
class Improvement:
    """Result of a search.

    Attributes
    ----------
    first, last : Diagnosis
        Of the model as given, and of what is left.
    steps : list of Step
        The base model first.
    """

    first: object
    last: object
    steps: list = field(default_factory=list)

    @property
    def model(self):
        """The improved model."""
        return self.steps[-1].model

    @property
    def fit(self):
        """Its fit."""
        return self.steps[-1].fit


def step_of(dataset, model, fit, added=None):
    """Errors of a fitted model on the fit part and on the held-out part.

    Parameters
    ----------
    dataset : Dataset
    model : Model
    fit : Fit
    added : (str, str), optional
        Effect and place that came with this step.

    Returns
    -------
    Step
    """
    held_out = compare.errors(dataset, model, fit, "test") if dataset.is_test.any() else {}
    return Step(added, model, fit, compare.errors(dataset, model, fit, "fit"), held_out)


def improve(dataset, model=None, seed=0, progress=None):
    """Diagnose, add, refit, until no effect is accepted; then take out what later effects made superfluous.

    Parameters
    ----------
    dataset : Dataset
    model : Model, optional
        The study's model by default.
    seed : int
    progress : callable, optional

    Returns
    -------
    Improvement
    """
    say = progress or (lambda text: None)
    model = model or dataset.base
    say("fitting the base model")
    steps = [step_of(dataset, model, identify.fit(dataset, model))]
    first = last = diagnose(dataset, model, steps[0].fit, seed, progress)
    while last.winner is not None and len(steps) <= MOST:
        winner = last.winner
        say(f"adding {winner.effect} at {winner.place}")
        attached = [(e.id, p.name) for e, p in steps[-1].model.attached]
        model = compile_model(dataset.library, model.rig, [*attached, winner.key])
        steps.append(step_of(dataset, model, winner.fit, winner.key))
        winner.held_out_error = steps[-1].held_out_error
        last = diagnose(dataset, model, winner.fit, seed + len(steps), progress)
    pruned = _prune(dataset, steps, last.noise)
    if len(pruned) < len(steps):
        steps = pruned
        last = diagnose(dataset, steps[-1].model, steps[-1].fit, seed + 99, progress)
    return Improvement(first, last, steps)


def _prune(dataset, steps, noise):
    """Leave out effects whose absence does not raise the selection error by more than its standard error."""
    if len(steps) <= 2:
        return steps
    added = [s.added for s in steps[1:]]
    given = [(e.id, p.name) for e, p in steps[0].model.attached]
    rig = steps[0].model.rig
    full = select(dataset, steps[-1].model, steps[-1].fit, noise)
    for out in added[:-1]:
        rest = [a for a in added if a != out]
        model = compile_model(dataset.library, rig, [*given, *rest])
        fit = identify.fit(dataset, model, steps[-1].fit.parameters)
        rise, spread = difference(select(dataset, model, fit, noise, full.usual).raw, full.raw)
        if rise <= spread:
            return _ladder(dataset, steps[0], rig, given, rest)
    return steps


def _ladder(dataset, base, rig, given, added):
    """The steps of a ladder that adds these effects in this order."""
    steps = [base]
    for k, key in enumerate(added):
        model = compile_model(dataset.library, rig, [*given, *added[:k + 1]])
        steps.append(step_of(dataset, model, identify.fit(dataset, model, steps[-1].fit.parameters), key))
    return steps

"""Fits, diagnoses and selection paths in; the JSON of a verb's files out."""

from __future__ import annotations

import json
import math
from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np

from ..compile import component_name, find_effect, places, ranked
from ..compile.contribution import effect_question
from ..compile.effects import annotation
from ..diagnosis.finding import Diagnosis, Finding
from ..diagnosis.search import Improvement, Step
from ..fit.nullspace import null_directions, weak_directions
from ..study.schema import Setting
from . import cards
from .thresholds import thresholds

SCHEMA = 1


# --- JSON -----------------------------------------------------------------------------------------------------------


def plain(value):
    """A value as JSON knows it: NumPy's types unwrapped, NaN and infinities to None.

    Parameters
    ----------
    value : object
        Of any depth.

    Returns
    -------
    dict, list, str, bool, int, float or None

    Examples
    --------
    >>> import numpy as np
    >>> plain({"a": np.float64(1.5), "b": float("nan")})
    {'a': 1.5, 'b': None}
    """
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value if value is None else str(value)


def to_json(value):
    """JSON text of a result; never NaN or infinity.

    Parameters
    ----------
    value : dict
        Plain, or with NumPy's types in it.

    Returns
    -------
    str
    """
    return json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def parameters(fit, model, seed):
    """``parameters.json``.

    Parameters
    ----------
    fit : Fit
        Its free parameters, intervals and undetermined directions are told.
    model : Model or Calibration
        What was fitted.
    seed : int
        That the verb ran with.

    Returns
    -------
    dict
        Beyond the contract: ``thresholds``, what decided, with which value; ``stderr``, ``fixed`` (what was not
        fitted), ``weak_directions`` and ``conditional`` (something unknown is missing beside these values, and
        intervals are as wide as blocks differ), and ``own``: of a parameter with a value of its own in each run, their
        names, their mean, their standard deviation and, ``unseen``, what was found for runs that were not fitted.
    """
    found = {}
    for name in fit.free:
        found[name] = {"value": fit.parameters[name], "ci95": fit.interval(name), "unit": fit.variables[name].unit,
                       "at_bound": fit.at_bound(name), "identifiable": fit.identifiable(name),
                       "stderr": fit.stderr[fit.free.index(name)] if fit.identifiable(name) else None,
                       "description": fit.variables[name].description}
    fixed = {n: {"value": v, "unit": fit.variables[n].unit} for n, v in fit.parameters.items()
             if n not in fit.free and n in fit.variables and n not in fit.own and "[" not in n}
    own = {n: {"runs": runs, "mean": fit.parameters[n], "between_runs": fit.between_runs(n),
               "unit": fit.variables[n].unit, "unseen": fit.unseen(n)} for n, runs in fit.own.items()}
    owners = {component_name(e, p): p.components[0] for e, p in model.attached if len(p.components) == 1}
    return plain({"schema": SCHEMA, "parameters": found, "null_directions": null_directions(fit, owners),
                  "weak_directions": weak_directions(fit), "error": fit.error,
                  "units": {c: model.unit(c) for c in fit.error}, "seed": seed, "fixed": fixed,
                  "conditional": fit.conditional, "own": own, "thresholds": thresholds("parameters")})


def diagnosis(found, dataset):
    """``diagnosis.json``.

    Parameters
    ----------
    found : Diagnosis
        Findings, noise floor, and what was tried.
    dataset : Dataset
        That was diagnosed.

    Returns
    -------
    dict
        ``twins`` holds ``alternatives`` under the name that it had first. Beyond the contract, ``thresholds``:
        what decided, with which value; ``refitted``:
        candidates that were only scored have expected coefficients without interval; ``conditional``: the interval
        comes from the data that chose the effect, and holds if the effect is there; ``explained_by``, the accepted
        effect beside which a candidate's evidence vanishes; ``refused``, why a refitted candidate is no finding;
        ``varies_with``, what the coefficient of one that stands in for another law differs over, and
        ``outweighed_by``, what explains much of what it leaves; ``contested``, one that is not added because
        more than five others, or two at once, do as well; ``together``, such pairs, which do better or have no more
        coefficients, or of which one is ``small``: an error of the load's model as such models have; ``outdone``,
        whether all of them do better;
        ``between``, whether something is missing that is over between two samples; ``channels``, what each says for
        itself; the cards of `cards`, what the log varies, and where an unexplained residual lives.
    """
    return plain({"schema": SCHEMA, "verdict": found.verdict, "error": found.error, "noise_floor": found.noise_floor,
                  "units": dataset.units,
                  "candidates": [_candidate(c, dataset.library, found.error) for c in found.candidates],
                  "residual_depends_on": found.residual_depends_on, "undetectable": found.undetectable,
                  "between": found.between,
                  "excitation": found.excitation, "smallest_detectable": found.smallest,
                  "unexplained": found.unexplained, "channels": found.channels,
                  "thresholds": thresholds("diagnosis")})


def still(library, rig):
    """What a search leaves of a log in which nothing moves: no error, no candidate, and what each effect needs.

    Parameters
    ----------
    library : Library
        Which holds the rig.
    rig : str
        Full name of the class.

    Returns
    -------
    dict of str to dict
        By file name, as of `diagnosis` and `ladder`.
    """
    hidden = [{"effect": effect.id, "place": place.name, "why": "nothing moves, or too little for a fit",
               "experiment": annotation(library, effect.model).get("experiment", "vary speed, load and direction")}
              for effect in ranked(library) for place in places(library, rig, effect)]
    nothing = SimpleNamespace(library=library, units={}, held_out_ranges=list)
    found = diagnosis(Diagnosis("not_enough_excitation", {}, {}, [], [], hidden), nothing)
    return {"diagnosis.json": found, "diagnosis_final.json": found,
            "ladder.json": ladder([Step(None, None, None, {}, {})], nothing)}


def diagnosis_of(record):
    """What ``diagnosis.json`` keeps of a diagnosis: all but fitted models and noise.

    Parameters
    ----------
    record : dict
        As `diagnosis` gives it, or a file holds it.

    Returns
    -------
    pycosim.diagnosis.finding.Diagnosis
    """
    def made(kind, entry, **more):
        return kind(**{f.name: entry[f.name] for f in fields(kind) if f.name in entry} | more)
    return made(Diagnosis, record, smallest=record["smallest_detectable"],
                candidates=[made(Finding, entry) for entry in record["candidates"]])


def _candidate(c, library, error):
    told = {"effect": c.effect, "place": c.place, "accepted": c.accepted, "p_value": c.p_value,
            "p_value_single": c.p_value_single, "predicted_error": c.predicted_error,
            "predicted_fall": cards.fall(error, c.predicted_error), "held_out_error": c.held_out_error or None,
            "coefficients": c.coefficients or _expected(c, library), "conditional": c.fit is not None,
            "alternatives": c.twins, "twins": c.twins, "together": c.together, "outdone": c.outdone,
            "refitted": c.fit is not None, "explained_by": c.explained_by, "refused": c.refused,
            "varies_with": c.varies_with if c.provisional else None,
            "outweighed_by": c.outweighed_by if c.provisional else None,
            "contested": c.contested}
    return {**told, "experiment": cards.experiment(library, c), "variable": cards.variable(library, c),
            "sentence": cards.sentence(library, c, error)}


def _expected(c, library):
    """Coefficients of a candidate that was only scored: no interval."""
    known = effect_question(library, find_effect(library, c.effect)).variables
    names = {n.rsplit(".", 1)[-1]: v for n, v in c.start.items()}
    return {n: {"value": v, "ci95": [None, None], "unit": known[n].unit if n in known else "1"}
            for n, v in names.items()}


def ladder(steps, dataset):
    """``ladder.json``: errors of the base model, then with every effect added.

    Parameters
    ----------
    steps : list of Step
        Of an `Improvement`.
    dataset : Dataset
        Its logs were searched.

    Returns
    -------
    dict
        Beyond the contract, what the diagnosis that chose an effect said of it: ``alternatives`` and ``coefficients``;
        and ``thresholds``, what decided, with which value.
    """
    return plain({"schema": SCHEMA, "held_out": dataset.held_out_ranges(), "units": dataset.units,
                  "thresholds": thresholds("ladder"), "steps": [
        {"added": None if s.added is None else {"effect": s.added[0], "place": s.added[1]},
         "error": s.error, "held_out_error": s.held_out_error,
         "predicted_error": s.finding.predicted_error or None if s.finding else None,
         "alternatives": s.finding.twins if s.finding else [],
         "coefficients": s.finding.coefficients if s.finding else {}} for s in steps]})


def improvement_of(path, first, last):
    """What ``ladder.json`` keeps of a search: all but models and fits.

    Parameters
    ----------
    path : dict
        ``ladder.json``.
    first, last : pycosim.diagnosis.finding.Diagnosis
        Of its first and its last model, as of `diagnosis_of`.

    Returns
    -------
    pycosim.diagnosis.search.Improvement
    """
    def added(step):
        return (step["added"]["effect"], step["added"]["place"]) if step["added"] else None
    return Improvement(first, last, [Step(added(s), None, None, s["error"], s["held_out_error"])
                                     for s in path["steps"]])


def confirmation(found, replay, units):
    """``confirmation.json``.

    Parameters
    ----------
    found : list of Confirmation
        In the order of the study.
    replay : dict
        ``before`` and ``after`` the effects, errors of the exported FMU; ``why`` there are none.
    units : dict of str to str
        Of the channels.

    Returns
    -------
    dict
        Beyond the contract: the two p-values of which the larger counts, how many blocks or passes were compared, and
        why an effect is not confirmed.
    """
    return plain({"schema": SCHEMA, "effects": [vars(c) for c in found], "replay": replay, "units": units})


def improved_study(study, model, fit):
    """The study with a model's effects, and the fitted values to start from.

    Parameters
    ----------
    study : Study
        As given; it is not changed.
    model : Model
        Its effects are the study's from then on.
    fit : Fit
        Its values become the study's.

    Returns
    -------
    Study
    """
    settings = dict(study.parameters)
    apart = {n for runs in fit.own.values() for n in runs}  # values in a run are fitted again; the study has their mean
    for name in [*(n for n in fit.free if n not in apart), *fit.own]:
        old, variable = settings.get(name, Setting(fixed=False)), fit.variables[name]
        value = min(max(float(f"{fit.parameters[name]:.9g}"), variable.min), variable.max)
        declared = model.parameters[name]
        if not declared.min <= value <= declared.max:  # possible on a machine of this size, which the study must say
            old = replace(old, min=variable.min, max=variable.max)
        settings[name] = replace(old, value=value)
    for effect, place in model.attached:  # other logs have other means, and would make other coefficients of the fitted
        for name in (f"{component_name(effect, place)}.{n}" for n in effect.means):
            settings[name] = Setting(value=float(f"{fit.parameters[name]:.9g}"), fixed=True)
    turning = [f"{effect.id}@{place.name}.{c}" for effect, place in model.attached for c in effect.phases
               if f"{component_name(effect, place)}.{c}" in fit.own]
    own = [*study.own, *(text for text in turning if text not in study.own)]
    return replace(study, effects=model.keys, parameters=settings, own=own)

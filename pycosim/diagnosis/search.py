"""A data set and a base model in; effects added until nothing is left to learn, and the ladder of errors, out."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace

from ..compile import compile_model, component_called, corrections, find_effect, find_place, places
from ..core.errors import PycosimError, StudyError
from ..fit import least_squares
from . import compare, pairs
from .constancy import as_good_a_law, constancy
from .crossval import difference, select
from .decide import ENDLESS, OPEN, diagnose, scored
from .dependence import dependence
from .finding import Finding
from .remainder import LEFT, beyond, remaining, rises, slow
from .rivals import PLAIN, SEPARATE, alike, behind, too_many
from .trials import TRIAL, nudged, pressed, told_from_nothing

MOST = 6  # effects that one search may add
AHEAD = 3  # effects that the search goes on with, to see whether a coefficient becomes constant
SHOWN = 3  # pairs that are told where they do better than one effect, or tried where as good a one is not constant
CHANCE = 0.05  # that the interval of any of all candidates is off, where what is left is unexplained
NOTHING = "its size differs from block to block by so much that it may be none"
MANY = "as many others do as well beside the other effects as leave no name"
ALONE = "without an effect that was taken out, its size is not the same all over the data"
TOGETHER = 3  # effects of a ladder up to which two are looked for, or exchanged, at once


@dataclass
class Step:
    """One step of the ladder; `finding` is what the diagnosis said of the added effect before it was added."""

    added: tuple | None
    model: object
    fit: object
    error: dict
    held_out_error: dict
    finding: object = None


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


def step_of(dataset, model, fit, finding=None):
    """Errors of a fitted model on the fit part and on the held-out part.

    Parameters
    ----------
    dataset : Dataset
        Its fit part is searched, and its held-out part told about.
    model : Model
        Of the data set's rig, with the effects that are in by now.
    fit : Fit
        Of that model.
    finding : Finding, optional
        The effect that came with this step.

    Returns
    -------
    Step
    """
    held_out = compare.errors(dataset, model, fit, "test") if dataset.is_test.any() else {}
    added = None if finding is None else finding.key
    return Step(added, model, fit, compare.errors(dataset, model, fit, "fit"), held_out, finding)


# --- one effect that is asked for ------------------------------------------------------------------------------------


def addable(study, library, model, text):
    """Effect and places of ``EFFECT[@PLACE]``, where it can still be added.

    Parameters
    ----------
    study : Study
        What it rejects, and what it has already, is refused.
    library : Library
        Knows the effects.
    model : Model
        The study's rig with its effects.
    text : str
        As ``stribeck@2A``, or ``stribeck`` for every place.

    Returns
    -------
    effect : str
    places : list of str
        The given place, or all places of the rig that the effect can still be added at.

    Raises
    ------
    UnknownNameError, StudyError
        No such effect or place, it is in the model already, the study rejects it, or it does what a free
        parameter does.
    """
    name, at, place = text.partition("@")
    effect = find_effect(library, name)
    wanted = [find_place(library, study.rig, effect, place)] if at else places(library, study.rig, effect)
    if not wanted:
        find_place(library, study.rig, effect, "")
    acting = {(e.id, c): p.name for e, p in model.attached for c in p.components}
    allowed = [p for p in wanted if not study.rules_out(name, p.name)]
    if not allowed:
        raise StudyError(f"{study.path}: '{text}' is among [data] rejected; take it out there to add it")
    free = [p for p in allowed if not any((name, c) in acting for c in p.components)]
    if not free:
        where = next(acting[name, c] for p in allowed for c in p.components if (name, c) in acting)
        raise StudyError(f"{study.path}: '{name}' at '{where}' is in the model already")
    rival = [f"{c}.{effect.replaces}" for p in free for c in p.components] if effect.replaces else []
    fitted = [n for n in rival if study.parameters.get(n) and study.parameters[n].fixed is False]
    if fitted:
        raise StudyError(f"{study.path}: '{name}' does what the free parameter '{fitted[0]}' does already; "
                         "fix that one first (fixed = true)")
    return name, [p.name for p in free]


@dataclass
class Addition:
    """An effect that was added because it was asked for.

    Attributes
    ----------
    step : Step
        The model with it, its fit and its errors.
    tried : list of str
        Places where it could be fitted.
    finding : Finding or None
        What the diagnosis said of it.
    hidden : dict or None
        Why these data can hardly show it.
    """

    step: object
    tried: list
    finding: object
    hidden: dict | None


def add(dataset, model, fit, effect, places, found, progress=None):
    """Add an effect at the best of these places, by selection error.

    Parameters
    ----------
    dataset : Dataset
        Its fit part is searched, and its held-out part told about.
    model : Model
        Of the data set's rig, with the effects that are in by now.
    fit : Fit
        Of that model.
    effect : str
        Its name, as ``stribeck``.
    places : list of str
        Those that are tried, as of `addable`.
    found : Diagnosis or None
        Of the model and its fit; its starts and its noise level are used. None where there is none: the fit's are.
    progress : callable, optional
        Called with a sentence before each stage.

    Returns
    -------
    Addition

    Raises
    ------
    StudyError
        The effect can be fitted at none of them.
    """
    say = progress or (lambda text: None)
    dataset, fit = _without_spikes(dataset, model, fit)
    known = {f.place: f for f in found.candidates if f.effect == effect} if found else {}
    noise = found.noise if found else fit.noise
    # rivals are compared at one noise level
    alone = select(dataset, model, fit, noise) if len(places) > 1 else None
    tried = {}
    for place in places:
        say(f"fitting {effect} at {place}")
        try:
            tried[place] = _fitted_with(dataset, model, fit, effect, place, known.get(place))
        except PycosimError:
            if len(places) == 1:
                raise
    if not tried:
        raise StudyError(f"{dataset.study.path}: '{effect}' cannot be fitted at any place of {model.rig} on these data")

    def error(place):
        larger, fitted = tried[place]
        return select(dataset, larger, fitted, noise, alone).white.sum() + 2 * len(fitted.free)

    best = min(tried, key=error) if len(tried) > 1 else next(iter(tried))
    say("computing errors")
    step = step_of(dataset, *tried[best], known.get(best) or Finding(effect, best))
    unseen = found.undetectable if found else ()
    hidden = next((u for u in unseen if (u["effect"], u["place"]) == (effect, best)), None)
    return Addition(step, list(tried), known.get(best), hidden)


def _fitted_with(dataset, model, fit, effect, place, finding):
    """Model and fit with one more effect, from where the diagnosis saw it best."""
    larger = compile_model(dataset.library, model.rig, [*model.keys, (effect, place)])
    if finding is not None and finding.accepted:
        return larger, finding.fit  # fitted to all samples already
    if finding is not None and finding.fit is not None:
        start = finding.fit.parameters
    else:
        start = nudged({**fit.parameters, **(finding.start if finding else {})}, larger, finding)
    return larger, least_squares.fit(dataset, larger, start)


# --- the search -----------------------------------------------------------------------------------------------------


def improve(dataset, model=None, seed=0, progress=None):
    """Diagnose, add, refit, until no effect is accepted; then look at each effect again beside those found after it.

    An effect that was chosen while another was missing may stand in for it: it is chosen again with the others in the
    model, and taken out where they make it superfluous. One whose coefficient is not the same all over the data may
    lack another effect beside it, or stand in for a law that nobody knows: the search goes on with it for a while, and
    keeps it if in the end every coefficient is constant.

    Parameters
    ----------
    dataset : Dataset
        Its fit part is searched, and its held-out part told about.
    model : Model, optional
        The study's model by default.
    seed : int
        Of all draws, so that an answer can be had again.
    progress : callable, optional
        Called with a sentence before each stage.

    Returns
    -------
    Improvement
        Not finished where its last diagnosis has `travels`: then search again with them in the study.
    """
    say = progress or (lambda text: None)
    model, dataset = model or dataset.base, dataset.calm
    say("fitting the base model")
    steps = [step_of(dataset, model, least_squares.fit(dataset, model))]
    first, steps, last = _first(dataset, steps, seed, progress)
    seen, without = [], {}
    while True:
        steps, last = _grow(dataset, steps, last, seed, progress)
        if last.travels:  # the samples that tell of effects are others where those are known
            return Improvement(first, last, steps)
        seen.append({s.added for s in steps})
        revised, either = _revised(dataset, steps, last.noise, seed, progress, without), None
        if revised is None and (last.verdict == "unexplained" or len(steps) > 2) and not (
                last.between or last.contested):
            revised, either = _exchanged(dataset, steps, last.noise, seed, progress)
        revised = revised or _moved(dataset, steps, last.noise, progress)
        revised = revised or _spared(dataset, steps, last.noise, seed, progress)
        if revised is None or len(seen) > 2 * MOST or {s.added for s in revised} in seen:  # it would come back again
            break
        steps = revised
        seen.append({s.added for s in steps})
        last = without.get(frozenset(s.added for s in steps)) or diagnose(
            dataset, steps[-1].model, steps[-1].fit, seed + 50 + len(seen), progress, False)
    if either is not None and last.verdict == "nothing_missing":
        steps, last = _left_open(dataset, steps, *either, seed + 98, progress)
    pruned = _prune(dataset, steps, last.noise)
    if len(pruned) < len(steps):
        steps = pruned
        last = diagnose(dataset, steps[-1].model, steps[-1].fit, seed + 99, progress, False)
    steps, last = _sure(dataset, steps, last, seed + 99, progress)
    first = first if len(steps) > 1 else last  # what was found and taken out again is no answer
    return Improvement(first.finish(), last.finish(), steps)


def _sure(dataset, steps, last, seed, progress):
    """A path whose effects all have a size of their own; its last fit widened where something unknown is left.

    None is held by a bound alone beside the others, has too many alternatives there, nor may be none where something
    unknown is left. What any of too many explains is not unknown: beside it sizes are as its fit has them. What stays
    when one is taken out that may be none, or that a bound holds, must be the same all over the data without it.
    """
    out, refines = {}, corrections(dataset.library)
    while True:
        end, unknown = steps[-1], last.verdict == "unexplained"
        if unknown:
            steps = [*steps[:-1], replace(end, fit=least_squares.widened(dataset, end.model, end.fit))]
        level = 1 - CHANCE / max(len(last.candidates), 1)
        attached = {(e.id, p.name): (e, p) for e, p in end.model.attached}
        ended = [s.added for s in steps[1:] if pressed(end.model, end.fit, attached[s.added])]
        unsure = _unsure(dataset, steps, last, level) if unknown else []
        many = [s.added for s in steps[1:] if len(steps) > 2 and _nameless(s, refines)]
        if not ended + unsure + many:
            return steps, last
        none = dict.fromkeys(unsure, NOTHING) | dict.fromkeys(ended, ENDLESS)
        out |= dict.fromkeys(many, MANY) | none
        steps = _ladder(dataset, steps[0], [s for s in steps[1:] if s.added not in out])
        while none and len(steps) > 1 and _shortfall(dataset, steps, last.noise, 1, seed) > 1.0:
            out[steps[-1].added] = ALONE
            steps = _ladder(dataset, steps[0], steps[1:-1])
        last = diagnose(dataset, steps[-1].model, steps[-1].fit, seed, progress, False)
        last.refuse(out)
        if last.winner is not None and len(out) < MOST:
            steps = [*steps, _added(dataset, steps, last.winner, progress)]
            last = diagnose(dataset, steps[-1].model, steps[-1].fit, seed, progress, False)
            last.refuse(out)


def _unsure(dataset, steps, last, level):
    """Effects of a path that may be none: beside what is unknown, or beside the first of a class that explains it."""
    end, first = steps[-1], last.contested
    if first is None or first.together:
        return [s.added for s in steps[1:] if _may_be_nothing(end.fit, s, level)]
    return [s.added for s in steps[1:] if _may_be_nothing(first.fit, s, level)
            and _may_be_nothing(_likeliest(dataset, end.model, first, s), s, level)]


def _likeliest(dataset, model, other, step):
    """The fit with another effect that the model lacks, and what the likelihood tells there of a step's size."""
    keys = [*model.keys, other.key]
    larger = compile_model(dataset.library, model.rig, keys)
    smaller = compile_model(dataset.library, model.rig, [k for k in keys if k != step.added])
    without = least_squares.fit_without(dataset, smaller, other.fit.parameters)
    attached = next((e, p) for e, p in larger.attached if (e.id, p.name) == step.added)
    return told_from_nothing(dataset, larger, replace(step.finding, fit=other.fit), smaller, without, attached)


def _may_be_nothing(fit, step, level):
    """Whether the intervals of all sizes of a step's effect hold nothing, in the last fit of a path.

    They are as wide as blocks differ where something unknown is missing: what lowers unseen errors there, and may as
    well have no size, or the other sign, stands in for that.
    """
    sizes = {f"{component_called(*step.added)}.{n}": neutral for n, neutral in step.finding.sizes.items()}
    return bool(sizes) and all(n in fit.free and n not in fit.apart and low <= neutral <= high
                               for n, neutral in sizes.items() for low, high in [fit.interval(n, level)])


def diagnosed(dataset, model, fit, seed=0, progress=None):
    """What a fitted model lacks, by the same decision that `improve` makes.

    Parameters
    ----------
    dataset : Dataset
        Its fit part is searched, and its held-out part told about.
    model : Model
        Of the data set's rig, with the effects that are in by now.
    fit : Fit
        Of that model.
    seed : int
        Of all draws, so that an answer can be had again.
    progress : callable, optional
        Called with a sentence before each stage.

    Returns
    -------
    Diagnosis
    """
    dataset, fit = _without_spikes(dataset, model, fit)
    return _first(dataset, [step_of(dataset, model, fit)], seed, progress)[0].finish()


def _without_spikes(dataset, model, fit):
    """Data and fit as the tests see them: outliers that hold more than the noise would hide effects."""
    return (dataset, fit) if dataset.calm is dataset else (
        dataset.calm, least_squares.fit(dataset.calm, model, fit.parameters))


def _first(dataset, steps, seed, progress, known=None):
    """The diagnosis of the last step, and the path and diagnosis that the search goes on with.

    Threes come first: where one takes more than any pair by more than luck, two in its place lead nowhere.
    """
    step, draw = steps[-1], seed + len(steps) - 1
    known = known or scored(dataset, step.model, step.fit, draw, progress)
    found = diagnose(dataset, step.model, step.fit, draw, progress, False, known)
    if found.travels:
        return found, steps, found
    unknown = found.verdict == "unexplained" and not found.between and len(steps) + 1 <= TOGETHER
    several = pairs.fitted(dataset, step.model, step.fit, known, progress, len(steps) == 1) if unknown else iter(())
    ahead, last, known = None, None, None
    if unknown and len(steps) == 1 and not found.contested:
        ahead, last = _together(dataset, steps, _beyond_one(found, next(several)), seed, progress)
    if ahead is None and found.provisional:
        ahead, last = _ahead(dataset, steps, found, seed, progress)
    alone = last is not None and found.contested and last.verdict == "nothing_missing"
    if ahead is None and found.winner and len(steps) + 1 <= TOGETHER:
        ahead, last = _doubled(dataset, steps, found, seed, progress)
    for some in several if ahead is None and not alone else ():
        ahead, last = _together(dataset, steps, _beyond_one(found, some), seed, progress)
        if ahead is not None:
            break
    if ahead is None:
        return found, steps, found
    found.accept(ahead[len(steps)].finding)
    return found, ahead, last


def _ahead(dataset, steps, found, seed, progress):
    """Go on with a provisional effect: the path on which all coefficients are constant and its diagnosis.

    Or none, and what is left beside that effect alone.
    An effect that brings the ones before no nearer to that is not what they lack. Rivals that were as good while
    another was missing may be worse beside it; a path ends before the effect that too many do as well as.
    """
    path, told, before = list(steps), [found], float("inf")
    for _ in range(AHEAD):
        chosen = told[-1].winner or told[-1].provisional
        if chosen is None:
            break
        path.append(_added(dataset, path, chosen, progress))
        told.append(diagnose(dataset, path[-1].model, path[-1].fit, seed + len(path) - 1, progress, False))
        if chosen.contested and len(told) == 2:  # its rivals fall beside another, if at all
            continue
        short = _shortfall(dataset, path, told[-1].noise, len(steps), seed)
        if short <= 1.0:
            end = _named(dataset, path, told[-1].noise, len(steps), progress)
            return (path[:end] if end > len(steps) else None), told[end - len(steps)]
        if short >= before:
            break
        before = short
    return None, told[1]


def _named(dataset, steps, noise, known, progress):
    """How many steps come before the first after the known ones that has too many alternatives for a name.

    Those of steps that had too many are told anew, beside the others.
    """
    refines = corrections(dataset.library)
    for step in [s for s in steps[known:] if _nameless(s, refines)]:
        twins = _good_beside(dataset, steps, step, step.finding.twins, noise, progress)
        step.finding = replace(step.finding, twins=twins)
    return next((k for k, s in enumerate(steps) if k >= known and _nameless(s, refines)), len(steps))


def _good_beside(dataset, steps, step, twins, noise, progress):
    """Of what may be an effect's alternatives, those that do as well in its place beside the others of a ladder."""
    base = steps[0].model
    rest = [*base.keys, *(s.added for s in steps[1:] if s is not step)]
    without = compile_model(dataset.library, base.rig, rest)
    here, full = _Selections(dataset, steps[-1], noise).beside(without)
    lacking = least_squares.fit_without(here, without, steps[-1].fit.parameters, most=TRIAL, noise=noise)
    alone, found = select(here, without, lacking, noise, full), []
    for twin in (t for t in twins if (t["effect"], t["place"]) not in (*rest, step.added)):
        if progress:
            progress(f"refitting with {twin['effect']} at {twin['place']} beside what was found")
        one = pairs.beside(here, without, lacking.parameters, (twin["effect"], twin["place"]), noise, full)
        if one is not None and alike(alone, one, full):
            found.append(twin)
    return found


def _nameless(step, refines):
    """Whether too many others do as well as what a step has added, alone or beside the effects before it."""
    return too_many(step.finding, refines, len(step.model.keys) > 1)


def _shortfall(dataset, steps, noise, known, seed):
    """How far the effects added after the known steps are from having one coefficient all over the data.

    Over what is allowed: the largest of what each would gain where its coefficient varies, beside the others, of what
    it adds to the errors of the held-out part, and of what is left over what they have taken together. Nor may another
    do as well without it where the coefficient of that varies: a law is then missing of which the other is an average.
    """
    added = [s.added for s in steps[known:]]
    if any(pressed(steps[-1].model, steps[-1].fit, (e, p)) for e, p in steps[-1].model.attached
           if (e.id, p.name) in added):  # what has no best size stands in for something else
        return float("inf")
    fulls = _Selections(dataset, steps[-1], noise)
    here, full = fulls.beside(steps[known - 1].model)
    before = select(here, steps[known - 1].model, steps[known - 1].fit, noise, full)

    def risen(model, fit):
        return rises(dataset, (model, fit), (steps[-1].model, steps[-1].fit))

    told = constancy(here, steps[-1].model, steps[-1].fit)
    follows = {name: max(told[s.added].follows[name] for s in steps[known:])
               for name in told[steps[-1].added].follows}
    left = dependence(here, steps[-1].model, steps[-1].fit, seed)
    worst = remaining(left, before, full, follows, risen(steps[known - 1].model, steps[known - 1].fit),
                      slow(here, steps[-1].model, steps[-1].fit))[0] / LEFT
    for out in steps[known:]:
        rest = [k for k in steps[-1].model.keys if k != out.added]
        model = compile_model(dataset.library, steps[0].model.rig, rest)
        fit = least_squares.fit_without(dataset, model, steps[-1].fit.parameters, noise=noise)
        here, full = fulls.beside(model)
        alone = select(here, model, fit, noise, full)
        takes, spread = difference(alone.raw, full.raw)
        if takes <= spread:  # superfluous beside the others
            return float("inf")
        worst = max(worst, beyond(risen(model, fit), alone) / (LEFT * takes))
        effect = next(e for e, p in steps[-1].model.attached if (e.id, p.name) == out.added)
        worst = max(worst, told[out.added].short(effect, alone, full))
        if any(as_good_a_law(here, (model, fit), (steps[-1].model, steps[-1].fit), k) for k in added if k != out.added):
            return float("inf")
    return worst


class _Selections:
    """The last step's errors on unseen folds, beside models that lack something of it.

    Parameters
    ----------
    dataset : Dataset
    step : Step
    noise : list of Noise
    """

    def __init__(self, dataset, step, noise):
        self.dataset, self.step, self.noise, self._known = dataset, step, noise, {}

    def beside(self, model):
        """The data on which a model is compared with the step, and the step's errors there.

        Only where both filter a torque do they leave out what the filter has not settled at.
        """
        here = self.dataset.sliding(model).settled(model, self.step.fit.parameters)
        key = here.early is None or here.early.tobytes()
        if key not in self._known:
            self._known[key] = here, select(here, self.step.model, self.step.fit, self.noise)
        return self._known[key]


def _added(dataset, steps, chosen, progress):
    """The step that adds a finding."""
    if progress:
        progress(f"adding {chosen.effect} at {chosen.place}")
    before = steps[-1].model
    model = compile_model(dataset.library, before.rig, [*before.keys, chosen.key])
    step = step_of(dataset, model, chosen.fit, chosen)
    chosen.held_out_error = step.held_out_error
    return step


def _grow(dataset, steps, last, seed, progress):
    """Add what the diagnosis accepts, step by step; returns the path and the diagnosis that accepts nothing."""
    while last.winner is not None and len(steps) <= MOST:
        steps, known, last.known = [*steps, _added(dataset, steps, last.winner, progress)], last.known, None
        _, steps, last = _first(dataset, steps, seed, progress, known)
    return steps, last


def _revised(dataset, steps, noise, seed, progress, without=None):
    """The ladder with an effect chosen again beside the others, where that predicts unseen folds better; or None.

    One that is refused beside the others is taken out, and a correction gives way to what it corrects where that is
    said there. One that stays has the alternatives that are left there: another that is said there is one too, where
    unseen folds do not tell which of both it is. The last effect was chosen with all others in the model, if it was by
    itself.

    What is said ``without`` an effect is kept there by the effects that are left: no model is diagnosed twice.
    """
    without = {} if without is None else without
    base, fulls = steps[0].model, _Selections(dataset, steps[-1], noise)
    refines = corrections(dataset.library)
    for out in (s for s in steps[1:] if s is not steps[-1] or s.finding.joint):
        rest = [s for s in steps[1:] if s is not out]
        keys = [*base.keys, *(s.added for s in rest)]
        model = compile_model(dataset.library, base.rig, keys)
        fit = least_squares.fit_without(dataset, model, steps[-1].fit.parameters)
        left = frozenset((None, *(s.added for s in rest)))
        told = without[left] = without.get(left) or diagnose(dataset, model, fit, seed, progress, False)
        if any(c.key == out.added and c.refused not in (None, *OPEN) for c in told.candidates):
            instead = told.winner
            return _ladder(dataset, steps[0], rest if instead is None else [
                *rest, Step(instead.key, model, instead.fit, {}, {}, instead)])
        found = told.winner or told.contested
        if found is None:
            continue
        alternatives = [found.key, *((t["effect"], t["place"]) for t in found.twins)]
        larger = compile_model(dataset.library, base.rig, [*keys, found.key])
        chosen = Step(found.key, larger, found.fit, {}, {}, found)
        if told.winner is None and out.added not in alternatives:
            continue
        if out.added in alternatives and found.effect == refines.get(out.added[0]):
            return _ladder(dataset, steps[0], [*rest, chosen])  # it did less well for want of another effect
        if out.added not in alternatives:
            here, full = fulls.beside(model)
            other = select(here, larger, found.fit, noise, full)
            lost, won = behind(full, other), behind(other, full)
            if lost and not won:
                return _ladder(dataset, steps[0], [*rest, chosen])
            if lost or won:  # the luck of folds changes nobody's mind
                continue
        others = [{"effect": e, "place": p} for e, p in alternatives if (e, p) != out.added]
        out.finding = replace(out.finding, twins=others, joint=False)  # its own were told where the others were missing
    return None


def _exchanged(dataset, steps, noise, seed, progress):
    """The ladder with two effects in the place of two, or of the only one; or None. And which two are left open.

    Chosen one after the other, the first of two may stand in for both, and beside it neither is what is lacking. The
    scores of a model that lacks what is exchanged say which two take most of it together. Those are fitted, and unseen
    folds decide as they do for one; of what they cannot tell apart, the one with fewer coefficients is said. Where
    nothing is exchanged, what could be in the place of one of the two together with another of the other is told as its
    alternative. Where two do as well that have neither, nor an alternative of either, which two it is stays open: the
    steps without them are told, and all pairs; else None.
    """
    base, added, fulls, best = steps[0].model, steps[1:], _Selections(dataset, steps[-1], noise), (0.0, None, None)
    either = None
    for out in itertools.combinations(added, min(2, len(added))) if 0 < len(added) <= TOGETHER else ():
        rest, near = [s for s in added if s not in out], []
        without = compile_model(dataset.library, base.rig, [*base.keys, *(s.added for s in rest)])
        lacking = least_squares.fit_without(dataset, without, steps[-1].fit.parameters)
        known = scored(dataset, without, lacking, seed, progress)
        for pair in next(pairs.fitted(dataset, without, lacking, known, progress)):
            gain, cannot_tell = _gained(fulls, pair)
            near += [pair] if cannot_tell else []
            if gain > best[0] and {*pair.keys} != {s.added for s in out}:
                best = gain, rest, pair
        told = [pairs.instead(near, a.finding, [b.finding]) for a, b in itertools.permutations(out, 2)]
        for step, alternatives in zip(out, told):
            step.finding = replace(step.finding, twins=alternatives)
        known = {s.added for s in out}.union((t["effect"], t["place"]) for some in told for t in some)
        if others := [p for p in near if known.isdisjoint(p.keys) and len(p.fit.free) <= len(steps[-1].fit.free)]:
            own = [{"effect": effect, "place": place} for effect, place in (s.added for s in out)]
            either = either or (rest, [own, *(p.told for p in others)][:SHOWN])
    if best[2] is None:
        return None, either
    path = _joined(dataset, steps[0], *best[1:])
    return (path, None) if _shortfall(dataset, path, noise, 1, seed) <= 1.0 else (None, either)


def _left_open(dataset, steps, rest, some, seed, progress):
    """The steps without two effects that others at once do as well as, and the diagnosis that says so."""
    path = _ladder(dataset, steps[0], rest)
    last = diagnose(dataset, path[-1].model, path[-1].fit, seed, progress, False)
    if last.winner is None and last.provisional is None:
        return path, last
    last.contest(some, True)
    return path, last


def _moved(dataset, steps, noise, progress):
    """The ladder with all effects of a place at another, where that predicts unseen folds better; or None.

    What acts on a friction goes where that is: the first effect brings the next to its place, and there none of them
    alone does as well elsewhere. Where unseen folds cannot tell the places apart, each is an alternative of the other.
    """
    base, fulls = steps[0].model, _Selections(dataset, steps[-1], noise)
    for place in dict.fromkeys(s.added[1] for s in steps[1:]):
        some, rest = ([s for s in steps[1:] if (s.added[1] == place) == inside] for inside in (True, False))
        without = compile_model(dataset.library, base.rig, [*base.keys, *(s.added for s in rest)])
        here, full = fulls.beside(without)
        for keys in _elsewhere(dataset, steps, some) if len(some) > 1 else ():
            if progress:
                progress(f"moving {' and '.join(e for e, _ in keys)} from {place} to {keys[0][1]}")
            lacking = least_squares.fit_without(here, without, steps[-1].fit.parameters, most=TRIAL, noise=noise)
            larger = compile_model(dataset.library, base.rig, [*without.keys, *keys])
            start = dict(lacking.parameters)
            for step, key in zip(some, keys):
                start |= _sizes(replace(step, fit=steps[-1].fit), key)
            try:
                fit = least_squares.fit(here, larger, nudged(start, larger, None), noise=noise)
            except PycosimError:  # no motion is left, or no answer in closed form
                continue
            other, alone = select(here, larger, fit, noise, full), select(here, without, lacking, noise, full)
            if behind(full, other) and not behind(other, full):
                found = [replace(s.finding, place=k[1], fit=fit, selection=other, twins=[]) for s, k in zip(some, keys)]
                return _ladder(dataset, steps[0], [*rest, *(Step(f.key, larger, fit, {}, {}, f) for f in found)])
            for step, (effect, name) in zip(some, keys) if alike(alone, other, full) else ():
                twins = [t for t in step.finding.twins if (t["effect"], t["place"]) != (effect, name)]
                step.finding = replace(step.finding, twins=[*twins, {"effect": effect, "place": name}])
    return None


def _elsewhere(dataset, steps, some):
    """Effects of one place at each other place that all of them could be at, and none of the ladder's is."""
    rig, library, ruled_out = steps[0].model.rig, dataset.library, dataset.study.rules_out
    allowed = [[p.name for p in places(library, rig, find_effect(library, s.added[0]))
                if not ruled_out(s.added[0], p.name)] for s in some]
    for name in [n for n in allowed[0] if all(n in a for a in allowed)]:
        keys = [(s.added[0], name) for s in some]
        if not {*steps[-1].model.keys} & {*keys}:
            yield keys


def _spared(dataset, steps, noise, seed, progress):
    """The ladder with one effect less, where an alternative of another makes it superfluous; or None.

    Of two that do as well, the one that is chosen by luck may leave a remainder that the other does not, for which a
    further effect was found. So may one that was found at one stage, and then at another, for want of a third: at both
    together it has one size.
    """
    base, fulls = steps[0].model, _Selections(dataset, steps[-1], noise)
    for out, other in itertools.permutations(steps[1:], 2):
        twins = [*_at_both(dataset, out, other), *((t["effect"], t["place"]) for t in other.finding.twins)]
        if not twins:
            continue
        rest = [s for s in steps[1:] if s not in (out, other)]
        without = compile_model(dataset.library, base.rig, [*base.keys, *(s.added for s in rest)])
        here, full = fulls.beside(without)
        lacking = least_squares.fit_without(here, without, steps[-1].fit.parameters, most=TRIAL, noise=noise)
        for twin in twins:
            start = {**lacking.parameters, **_sizes(other, twin)}
            one = pairs.beside(here, without, start, twin, noise, full)
            if one is None or not _as_good(one, full):
                continue
            fit = least_squares.fit_without(dataset, without, steps[-1].fit.parameters)
            told = diagnose(dataset, without, fit, seed, progress, False)
            best = told.winner or told.contested
            known = [best.key, *((t["effect"], t["place"]) for t in best.twins)] if best else []
            if twin in known:
                others = [{"effect": e, "place": p} for e, p in known if (e, p) != twin]
                chosen = replace(next(c for c in told.candidates if c.key == twin), accepted=True, twins=others)
                step = Step(twin, without, chosen.fit, {}, {}, chosen)
                return _ladder(dataset, steps[0], [step if s is other else s for s in steps[1:] if s is not out])
    return None


def _at_both(dataset, out, other):
    """The place of both of two effects, where they are the same at two places; asked once of the two."""
    if out.added[0] != other.added[0] or out.added > other.added:
        return []
    effect = find_effect(dataset.library, out.added[0])
    one, two = (find_place(dataset.library, other.model.rig, effect, s.added[1]).components for s in (out, other))
    return [(effect.id, p.name) for p in places(dataset.library, other.model.rig, effect)
            if set(p.components) == {*one, *two} and not {*one} & {*two}]


def _sizes(step, key):
    """Coefficients of a step's effect, as those of the same one at another place; none of another effect."""
    own = component_called(*step.added) + "."
    return {f"{component_called(*key)}.{n.removeprefix(own)}": v for n, v in step.fit.parameters.items()
            if n.startswith(own) and step.added[0] == key[0]}


def _as_good(one, full):
    """Whether unseen folds do not tell a model with less from one with more, in the plain error by little at that."""
    gaps = [difference(getattr(one, kind), getattr(full, kind)) for kind in ("white", "raw")]
    return all(rise <= SEPARATE * spread for rise, spread in gaps) and gaps[1][0] < PLAIN * full.raw.sum()


def _gained(fulls, pair):
    """By how much a model with a pair of effects is better on unseen folds than a step, and whether they cannot tell.

    Nothing where it is not clearly better, and has no fewer coefficients either.
    """
    here, full = fulls.beside(pair.without)
    other = select(here, pair.model, pair.fit, fulls.noise, full)
    gains = [difference(getattr(full, kind), getattr(other, kind)) for kind in ("white", "raw")]
    spared = len(fulls.step.fit.free) - len(pair.fit.free)
    clear = all(gain > SEPARATE * spread for gain, spread in gains)
    near = alike(select(here, pair.without, pair.lacking, fulls.noise, full), other, full)
    return gains[0][0] + 2 * spared if clear or (spared > 0 and near) else 0.0, near


def _doubled(dataset, steps, found, seed, progress):
    """The ladder with two effects in the place of a winner, and its diagnosis; or None.

    A spring about the joint does, to the noise, what a wrong zero of the reference does beside a wrong torque constant.
    Where a pair predicts better by more than the luck of so many pairs, it is what is missing; what other pairs
    that do as well lack, or what has too many alternatives, is left to the next diagnosis. Where that leaves neither,
    or a pair of no more coefficients does as well as the winner, or one for a small error of the load's model, or any
    as the winner with another, or one leaves nothing though its coefficients may vary, nobody knows what is missing:
    the winner is none.
    """
    winner, step = found.winner, steps[-1]
    larger = compile_model(dataset.library, step.model.rig, [*step.model.keys, winner.key])
    found.known = scored(dataset, larger, winner.fit, seed + len(steps), progress)
    some = pairs.doubles(dataset, step.model, step.fit, winner, found.noise, found.known[1], seed, progress)
    pair = next((p for p in some if p.clear), None)
    path, last = (None, None) if pair is None else _followed(dataset, steps, pair, seed, progress)
    if path is not None:
        _tell_as_winner(dataset, path, path[len(steps):], winner, last.noise, progress)
        if _named(dataset, path, last.noise, len(steps), progress) == len(path) and pair.common == {*pair.keys}:
            return path, last
        common = _in_common(dataset, steps, path, pair, seed, progress)
        if common[0] is not None:
            return common
    if pair is not None and (path is not None or last.verdict == "nothing_missing"):
        found.contest([p.told for p in some if p.clear][:SHOWN])
        return None, None
    if equal := [p.told for p in some if p.doubted or p.better or p.matched or len(p.fit.free) <= len(winner.fit.free)]:
        found.contest(equal[:SHOWN])
    return None, None


def _tell_as_winner(dataset, path, added, winner, noise, progress):
    """Give an effect that the winner could not be told from, those as alternatives that do as well beside the others.

    Few pairs of the same two effects are fitted, and the place that one of them comes with is the luck of that.
    """
    known = [{"effect": winner.effect, "place": winner.place}, *winner.twins]
    for step in added:
        told = [step.added, *((t["effect"], t["place"]) for t in step.finding.twins)]
        if step.added in [(t["effect"], t["place"]) for t in known]:
            new = [t for t in known if (t["effect"], t["place"]) not in told]
            twins = step.finding.twins + _good_beside(dataset, path, step, new, noise, progress)
            step.finding = replace(step.finding, twins=twins)


def _together(dataset, steps, some, seed, progress):
    """The ladder with the best of some pairs or threes, and its diagnosis; or None.

    Where something is missing, and no effect by itself is what is: each of several may be far from constant without
    the others, and the first that is tried may be none of them. Of those that unseen folds cannot tell apart, luck
    alone says which is the best: another may be the one whose coefficients are constant.
    """
    pair = some[0] if some else None
    path, last = _followed(dataset, steps, pair, seed, progress) if some else (None, None)
    for pair in [p for p in some if any(p is n for n in some[0].near)][:SHOWN] if path is None else ():
        if _shortfall(dataset, _joined(dataset, steps[0], steps[1:], pair), pair.fit.noise, len(steps), seed) <= 1.0:
            path, last = _followed(dataset, steps, pair, seed, progress)
            break
    if path is None:
        return None, None
    if _named(dataset, path, last.noise, len(steps), progress) == len(path):
        return path, last
    common, left = _in_common(dataset, steps, path, pair, seed, progress)
    return common, last if common is None else left


def _beyond_one(found, some):
    """Those of some pairs or threes that unseen folds do not put behind the one effect that is to be gone on with.

    They come before it: three stand-ins of a delay beside a wrong mass stayed, though the delay was ahead of them.
    """
    one = found.provisional
    return [p for p in some if one is None or not pairs.ahead(
        one.selection, p.selection, len(one.fit.free) - len(p.fit.free))]


def _in_common(dataset, steps, path, pair, seed, progress):
    """The ladder with those effects of a pair's path that have a name and are in all pairs as good, and its diagnosis.

    None where there are none: what the others are is not known, and is left to that diagnosis.
    """
    refines = corrections(dataset.library)
    sure = [s for s in path[len(steps):] if s.added in pair.common and not _nameless(s, refines)]
    if not sure:
        return None, None
    # without the others, one that stands in for all of them is ahead again: it is not asked for in the last one's place
    sure = [replace(s, finding=replace(s.finding, joint=False)) for s in sure]
    path = _ladder(dataset, steps[0], [*steps[1:], *sure])
    return path, diagnose(dataset, path[-1].model, path[-1].fit, seed + len(path) - 1, progress, False)


def _followed(dataset, steps, pair, seed, progress):
    """The ladder with a pair of effects, and a third where two need it, or None; and the diagnosis at its end."""
    path = _joined(dataset, steps[0], steps[1:], pair)
    while True:
        last = diagnose(dataset, path[-1].model, path[-1].fit, seed + len(path) - 1, progress, False)
        if _shortfall(dataset, path, last.noise, len(steps), seed) <= 1.0:
            return path, last
        chosen = last.winner or last.provisional
        if chosen is None or len(path) - len(steps) >= AHEAD:
            return None, last
        path.append(_added(dataset, path, chosen, progress))


def _joined(dataset, base, rest, pair):
    """The steps of a ladder with a pair of effects after others."""
    return _ladder(dataset, base, [*rest, *(Step(f.key, pair.model, pair.fit, {}, {}, f) for f in pair.findings)])


def _prune(dataset, steps, noise):
    """Leave out, one after the other, effects whose absence does not raise the selection error beyond its own error."""
    base = steps[0].model
    while len(steps) > 2:
        fulls = _Selections(dataset, steps[-1], noise)
        for out in steps[1:-1]:
            rest = [s for s in steps[1:] if s is not out]
            model = compile_model(dataset.library, base.rig, [*base.keys, *(s.added for s in rest)])
            fit = least_squares.fit_without(dataset, model, steps[-1].fit.parameters, noise=noise)
            here, full = fulls.beside(model)
            rise, spread = difference(select(here, model, fit, noise, full).raw, full.raw)
            if rise <= spread:
                steps = _ladder(dataset, steps[0], rest)
                break
        else:
            break
    return steps


def _ladder(dataset, base, chosen):
    """The steps of a ladder that adds the effects of these steps in this order.

    Each effect starts from where it was found: a ripple has valleys, and from no amplitude none is found. What a
    diagnosis predicted holds beside the effects that were in its model, no longer beside others.
    """
    steps, given = [base], base.model.keys
    for step in chosen:
        keys = [*given, *(s.added for s in steps[1:]), step.added]
        model = compile_model(dataset.library, base.model.rig, keys)
        same = step.model.keys == keys
        finding = step.finding if same else replace(step.finding, predicted_error={})
        start = {**step.fit.parameters, **steps[-1].fit.parameters}
        steps.append(step_of(dataset, model, least_squares.fit(dataset, model, start), finding))
    return steps

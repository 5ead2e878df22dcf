"""A fitted model and its data in; which effect is missing, where, how sure, or nothing, or nothing known, out.

The best few candidates are refitted; the first is accepted that is significant, that lowers the error on folds that it
was not fitted to by more than the standard error of that fall and by enough to matter, whose interval leaves out
nothing, and whose coefficient is the same all over the data.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ..compile import catalogue, compile_model, component_name, find_effect, find_place
from ..core.errors import NoAnswerError, PycosimError
from ..fit import least_squares
from ..fit.late import delays
from . import first_look
from .compare import errors
from .constancy import allowed, constancy
from .crossval import difference, select
from .dependence import RELEVANT, dependence, noise_floor
from .excitation import smallest, undetectable, varied
from .lack_of_fit import unexplained
from .remainder import LEFT, remaining, rises
from .scores import LEVEL, PRESSED, Scores
from .table import Table

SLOW, VISIBLE = 2.0, 0.01
"""Squared error of a torque over that of its noise floor, and error over the torque, from which what is left is more
than slow noise. Seventeen worlds with nothing hidden reach 1.2, friction that ebbs, flows or comes and goes 2.2 to 7;
what a simulation leaves that nobody added noise to is less than a hundredth."""
NOTHING = "its interval holds zero, so that something else is at work"
UNSOLVED = "beside the effects of the model it has no answer in closed form"
CLEAR = 0.1
"""Of the whitened error, from which an effect may predict unseen passes with what they tell of themselves, where the
others do not tell the base model; a smaller one must do so with what the others alone tell. Of 16 short logs with
nothing hidden two had a candidate that took a hundredth; true effects there took a quarter and more."""
ALIKE = 0.2  # of what the best takes away, that an alternative may leave
SEPARATE = 1.645  # standard errors by which unseen folds must tell rivals apart: the true one of two is lost in 5 %
MATTERS = 0.05
"""Of the squared error of one channel, that an effect must take. The imperfect form of a larger one leaves as much:
beside a delay of a gait, found to a tenth of a sample, a hysteresis took 0.04."""
PLAIN = 0.05  # of the plain squared error, by which it must be lower to decide: something else that is missing moves it
REFITS = 10
TRIAL = 15000  # samples of a trial fit; the accepted effect is fitted to all
CONTESTED, KINDS = 5, 3
"""Alternatives beyond which none is a name, and effects, of which so many may be alternatives at any places. A constant
torque has six names: offset of motor or reference, asymmetry with or without its growth at low speed, a far spring, a
zero."""


@dataclass
class Finding:
    """What the diagnosis says of one effect at one place."""

    effect: str
    place: str
    accepted: bool = False
    p_value: float = 1.0
    p_value_single: float = 1.0
    statistic: float = 0.0
    predicted_error: dict = field(default_factory=dict)
    held_out_error: dict | None = None
    coefficients: dict = field(default_factory=dict)
    twins: list = field(default_factory=list)
    start: dict = field(default_factory=dict)
    sizes: dict = field(default_factory=dict)
    provisional: bool = False
    contested: bool = False
    refused: str | None = None
    explained_by: dict | None = None
    varies_with: str | None = None
    outweighed_by: str | None = None
    selection: object = None
    fit: object = None

    @property
    def key(self):
        """Effect and place."""
        return self.effect, self.place


@dataclass
class Diagnosis:
    """What is missing in a fitted model.

    Attributes
    ----------
    verdict : str
        ``missing_effect``, ``nothing_missing``, ``unexplained`` or ``not_enough_excitation``.
    error, noise_floor : dict of str to float
        RMSE of each channel, and what noise alone would leave, in the channel's unit.
    candidates : list of Finding
        Best first.
    residual_depends_on : list of dict
        Variables, most first, each with its share of the residual's energy and how sure that is.
    undetectable : list of dict
        Effects and places that the log cannot show, each with the reason and an experiment that would.
    noise : list of Noise
        Of single samples, one a channel.
    smallest : list of dict
        Smallest size of each effect at each place that this log would have shown; see `excitation.smallest`.
    excitation : list of dict
        What the log varies.
    unexplained : dict or None
        Where a residual that no effect explains lives; see `unexplained.unexplained`.
    channels : dict of str to dict
        What each channel says for itself: ``verdict``, ``error``, ``floor``, ``resolution``, ``slow``, ``depends_on``.
    later : callable or None
        What finds `unexplained`, until `finish` calls it.
    """

    verdict: str
    error: dict
    noise_floor: dict
    candidates: list
    residual_depends_on: list
    undetectable: list
    noise: list = field(default_factory=list)
    smallest: list = field(default_factory=list)
    excitation: list = field(default_factory=list)
    unexplained: dict | None = None
    channels: dict = field(default_factory=dict)
    later: object = field(default=None, repr=False, compare=False)

    def finish(self):
        """Find where a residual that no effect explains lives, where a search has put that off.

        Returns
        -------
        Diagnosis
            Itself.
        """
        if self.later is not None:
            self.unexplained, self.later = self.later(), None
        return self

    @property
    def provisional(self):
        """What that would be added if, beside others, its coefficient is constant and its rivals fall; or None."""
        return next((c for c in self.candidates if c.provisional), None)

    def accept(self, finding):
        """Accept a finding: beside other effects its coefficient is constant, and few do as well.

        Parameters
        ----------
        finding : Finding
            The provisional one, or one of a pair that was fitted together.
        """
        for other in self.candidates:
            other.provisional = other.contested = False
        known = next(c for c in self.candidates if c.key == finding.key)
        finding.accepted, finding.provisional, finding.contested = True, False, False
        finding.predicted_error = known.predicted_error
        self.candidates = [finding, *(c for c in self.candidates if c is not known)]
        self.verdict, self.unexplained, self.later = "missing_effect", None, None

    @property
    def contested(self):
        """The finding that would be added, did not too many others do as well; or None."""
        return next((c for c in self.candidates if c.contested), None)

    @property
    def winner(self):
        """The finding that would be added, or None."""
        return next((c for c in self.candidates if c.accepted), None)


def diagnose(dataset, model, fit, seed=0, progress=None, finished=True):
    """Find the effect that a fitted model lacks.

    Parameters
    ----------
    dataset : Dataset
        Its fit part is searched; what is held out decides nothing.
    model : Model
        With the effects accepted so far.
    fit : Fit
        Of that model.
    seed : int
        Of all draws, so that an answer can be had again.
    progress : callable, optional
        Called with a sentence before each stage.
    finished : bool
        Of a search that may find the effect beside another, only `Diagnosis.finish` says where it lives.

    Returns
    -------
    Diagnosis
    """
    say, dataset = progress or (lambda text: None), dataset.settled(model, fit.parameters)
    say("testing every candidate effect at every place")
    table = Table(dataset, model, fit)
    first_look.tell(say, table)
    scores = Scores(table, seed)
    findings = _findings(table, scores)
    base = select(dataset, model, fit, scores.single)
    rivals = _refit_best(dataset, model, fit, scores, findings, base, table, say)
    told = dependence(dataset, model, fit, seed)
    depends, alarm = told.variables, told.sure

    def steady(finding):
        larger = compile_model(dataset.library, model.rig, [*model.keys, finding.key])
        law, own = constancy(dataset, larger, finding.fit)[finding.key], finding.selection
        if law.gain * own.raw.sum() > allowed(larger.attached[-1][0]) * difference(base.raw, own.raw)[0]:
            finding.varies_with = law.variable
        risen = rises(_errors(dataset, model, fit), _errors(dataset, larger, finding.fit))
        share, variable = remaining(dependence(dataset, larger, finding.fit, seed), base, own, law.follows, risen)
        finding.outweighed_by = variable if share > LEFT else None
        return finding.varies_with is None and finding.outweighed_by is None

    chosen = _chosen(dataset, model, fit, findings, rivals, base, steady, scores.single)
    if chosen is not None:
        _explained_by(findings, chosen, scores)
    say("looking at what is left")
    hidden = undetectable(table, scores)
    floor = noise_floor(dataset, model, fit)
    slow = _slow(dataset, model, fit, floor)
    verdict = _verdict(findings, alarm or bool(slow), hidden, dataset, model.attached)
    winner, provisional = (chosen if chosen and chosen.accepted else None), (
        chosen if chosen and chosen.provisional else None)
    channels = _channels(fit.error, floor, told, base, winner, dataset.steps, provisional, slow)
    unknown = verdict == "unexplained" and not dataset.averaged and not any(f.contested for f in findings)
    found = Diagnosis(verdict, fit.error, floor, findings, depends, hidden, scores.single,
                      smallest(scores, LEVEL, MATTERS), varied(table), None, channels,
                      partial(unexplained, table, depends, floor) if unknown else None)
    return found.finish() if finished else found


def _errors(dataset, model, fit):
    """Errors by channel of the fit part and of the held-out part, which is empty where nothing is held out."""
    return {"fit": errors(dataset, model, fit, "fit"),
            "test": errors(dataset, model, fit, "test") if dataset.is_test.any() else {}}


def _lesser(dataset, one, other):
    """The lesser of two estimates of the noise, channel by channel: by what it gives the mean of a long stretch."""
    step = float(np.median(np.diff(dataset.time))) if len(dataset.time) > 1 else 1.0
    return [min(pair, key=lambda n: n.white ** 2 * step + 2 * n.slow ** 2 * n.memory) for pair in zip(one, other)]


def _chosen(dataset, model, fit, findings, rivals, base, steady, noise):
    """The first finding that earns it on all samples as well: their fit reaches bounds that a trial does not."""
    refines = {e.id: e.refines for e in catalogue(dataset.library).values()}
    for _ in range(len(rivals)):
        chosen = _decide(findings, rivals, base, refines, steady)
        if chosen is None:
            break
        larger = compile_model(dataset.library, model.rig, [*model.keys, chosen.key])
        if not _can_be_searched(dataset, larger):
            _give_way(findings, chosen, UNSOLVED)
            continue
        chosen.fit = least_squares.fit(dataset, larger, chosen.fit.parameters)
        if holds_nothing(larger, chosen):  # something else may be missing too, which its noise then holds
            chosen.fit = least_squares.fit(dataset, larger, chosen.fit.parameters,
                                           noise=_lesser(dataset, noise, chosen.fit.noise))
        if holds_nothing(larger, chosen):
            chosen.fit = _told_from_nothing(dataset, larger, chosen, model, fit)
        chosen.coefficients = _coefficients(larger, chosen.fit)
        if not holds_nothing(larger, chosen):
            return chosen
        _give_way(findings, chosen, NOTHING)
    return None


def _give_way(findings, chosen, reason):
    """Refuse what was chosen, and forget what were alternatives of it."""
    chosen.accepted, chosen.provisional, chosen.contested, chosen.refused = False, False, False, reason
    for finding in findings:
        finding.twins = []


def _can_be_searched(dataset, model):
    """Whether the model has an answer in closed form with the probes that the next search hangs on its places."""
    try:
        dataset.ask(compile_model(dataset.library, model.rig, model.keys, True))
    except PycosimError:
        return False
    return True


def _findings(table, scores):
    """One finding an effect and place, at its best grid point, best first."""
    best = {}
    for score in scores.results:
        known = best.get(score.candidate.key)
        if known is None or score.surprise > known.surprise:
            best[score.candidate.key] = score
    findings = []
    for score in best.values():
        candidate = score.candidate
        penalty = 2.0 * (len(candidate.parts) + len(candidate.effect.scan))
        finding = Finding(candidate.effect.id, candidate.place.name, statistic=score.value - penalty)
        finding.p_value_single = float(np.exp(-score.surprise))
        finding.p_value = scores.family(score.surprise, score.scanned)
        finer = scores.refined.get(candidate.key, score)
        finding.start = start_of(finer.candidate, finer.coefficients)
        finding.predicted_error = scores.predicted(finer.candidate, finer.coefficients)
        findings.append(finding)
    return sorted(findings, key=lambda f: -f.statistic)


def start_of(candidate, coefficients):
    """Full values of an effect's coefficients at its score estimate.

    Parameters
    ----------
    candidate : Candidate
        At the grid point that its scores are those of.
    coefficients : ndarray or None
        Estimated, relative to neutral; None where the grid alone is known.

    Returns
    -------
    dict of str to float
        By parameter of the model, SI units.
    """
    effect, base = candidate.effect, component_name(candidate.effect, candidate.place)
    values = dict(candidate.grid)
    if coefficients is None:
        return {f"{base}.{n}": v for n, v in values.items()}
    if candidate.extra.get("scanned"):
        values[candidate.names[0]] = float(np.hypot(*coefficients))
        values[candidate.extra["phase"]] = float(np.arctan2(coefficients[1], coefficients[0]))
    else:
        values.update({n: float(v) for n, v in zip(candidate.names, coefficients) if n not in effect.scan})
    return {f"{base}.{n}": v for n, v in values.items()}


def _refit_best(dataset, model, fit, scores, findings, base, table, say):
    """Fit the model with each of the best candidates; fills the findings and returns those that were fitted.

    The scores see each place from a base model that has bent to what is missing, so that the best effect's other places
    are fitted as well, however low they rank. So is what could add the same as it does: an asymmetry of a loss that the
    base model takes for small is the offset that is missing, and takes a part of it for lack of that loss.
    """
    def refitted(some):
        for k, f in enumerate(some, 1):
            say(f"refitting with {f.effect} at {f.place}, {k} of {len(some)}")
            if _refit(dataset, model, fit, scores, f, base.usual, table):
                yield f

    likely = [f for f in findings if f.p_value < 10 * LEVEL]
    dataset.library.ahead(model.rig, [[*model.keys, f.key] for f in likely[:REFITS]])
    fitted = list(refitted(likely[:REFITS]))
    if fitted:
        best = min(fitted, key=lambda f: f.selection.white.sum())
        effects = {f.effect for f in fitted if _twins(base, f, best)}
        fitted += refitted([f for f in findings if f.effect == best.effect and f not in fitted
                            and _unseen(dataset, model, fit, f)])
        akin = scores.akin(best.key, 1 - ALIKE)[:REFITS]
        fitted += refitted([f for f in likely[REFITS:] if (f.effect in effects or f.key in akin) and f not in fitted])
        for f in [f for f in fitted if f.effect == best.effect and f is not best]:
            _refit_from(dataset, model, scores.single, f, best, base.usual)
            if _twins(base, f, best):  # a score sees nothing of a share of a loss that the base model takes for none
                f.p_value, f.p_value_single = best.p_value, best.p_value_single
    return fitted


def _unseen(dataset, model, fit, finding):
    """Whether the base model takes the loss at a finding's place for none: a score sees nothing of a share of that."""
    place = find_place(dataset.library, model.rig, find_effect(dataset.library, finding.effect), finding.place)
    return any(f"{c}.f0" in fit.free and fit.at_bound(f"{c}.f0") == "min" for c in place.components)


def _refit_from(dataset, model, noise, finding, other, usual):
    """Fit a candidate from where the same effect at another place has brought the other parameters, if that is lower.

    Losses that are traded between two places have a valley at each.
    """
    larger = compile_model(dataset.library, model.rig, [*model.keys, finding.key])
    at, names = component_name(*larger.attached[-1]), other.coefficients
    whose = component_name(larger.attached[-1][0], find_place(dataset.library, model.rig, larger.attached[-1][0],
                                                              other.place))
    start = {**finding.fit.parameters, **{n: other.fit.parameters[n] for n in model.parameters},
             **{f"{at}.{n}": other.fit.parameters[f"{whose}.{n}"] for n in names}}
    try:
        fit = least_squares.fit(dataset, larger, start, most=TRIAL, noise=noise, held=_earlier(larger))
    except NoAnswerError:
        return
    if _cost(fit, usual) < _cost(finding.fit, usual):
        finding.fit, finding.selection = fit, select(dataset, larger, fit, noise, usual)
        finding.coefficients = _coefficients(larger, fit)


def _cost(fit, usual):
    """Sum of the channels' squared errors, in units of their noise."""
    return sum((e / u) ** 2 for e, u in zip(fit.error.values(), usual.ravel()))


def _refit(dataset, model, fit, scores, finding, usual, table):
    """Fit the model with one candidate; whether it could be fitted."""
    larger = compile_model(dataset.library, model.rig, [*model.keys, finding.key])
    start, lifted = {**fit.parameters, **finding.start}, {}
    for component in larger.attached[-1][1].components:
        name = f"{component}.f0"
        if name in fit.free and start[name] < table.least_loss(component):
            lifted[name] = table.least_loss(component)
        name = f"{component}.mu"
        if name in fit.free and "mu" in table.reads(finding.effect):
            start[name] = min(start[name], table.most_efficient(component))
    starts = [{**start, **lifted}]
    if lifted and not any(fit.at_bound(name) for name in lifted):
        starts.append(start)  # a small loss that nothing presses may be what there is
    try:
        fits = [_best_fit(dataset, larger, nudged(s, larger, finding), scores.single, usual) for s in starts]
    except PycosimError:
        return False
    finding.fit = min(fits, key=lambda f: _cost(f, usual))
    finding.selection = select(dataset, larger, finding.fit, scores.single, usual)
    measure(finding, larger, larger.attached[-1], table)
    return True


def measure(finding, model, attached, table):
    """What a finding's fit says of its effect: coefficients, and the values of its sizes that change nothing.

    Parameters
    ----------
    finding : Finding
        With the fit; changed in place.
    model : Model
        That was fitted.
    attached : (Effect, Place)
        The finding's, one of the model's.
    table : Table
        Knows what the effect's size is.
    """
    effect, base = attached[0], component_name(*attached)
    own, rig = finding.fit.variables, model.parameters
    finding.coefficients = _coefficients(model, finding.fit, attached)
    acting = table.contribution(effect).coefficients  # a time or a travel too that acts by itself
    finding.sizes = {c: _none(own[f"{base}.{c}"]) if c in effect.scan else rig[f"{base}.{c}"].value
                     for c in acting if c in finding.coefficients}


def _best_fit(dataset, model, start, noise, usual):
    """Fit from a start, and where another parameter ends at a bound, from twice the effect too.

    A loss that would be negative is none: beyond that the errors bend, and have valleys of their own.
    """
    fit = least_squares.fit(dataset, model, start, most=TRIAL, noise=noise, held=_earlier(model))
    base, effect = component_name(*model.attached[-1]), model.attached[-1][0]
    if not any(fit.at_bound(n) for n in fit.free if not n.startswith(base + ".")):
        return fit
    twice = {name: min(max(2 * start.get(name, v.value) - v.value, v.min), v.max) for name, v in (
        (f"{base}.{c}", model.parameters[f"{base}.{c}"]) for c in effect.size)}
    try:
        other = least_squares.fit(dataset, model, {**start, **twice}, most=TRIAL, noise=noise, held=_earlier(model))
    except NoAnswerError:  # so large an effect leaves no motion
        return fit
    return min(fit, other, key=lambda f: _cost(f, usual))


def _earlier(model):
    """Delays that a trial of the effect attached last does not look for again."""
    base = component_name(*model.attached[-1])
    return [n for n in delays(model) if not n.startswith(base + ".")]


def _none(variable):
    """Time or travel that changes nothing: none, or the least that is allowed."""
    return min(max(0.0, variable.min), variable.max)


def _explained_by(findings, chosen, scores):
    """Mark the candidates whose evidence is gone beside the chosen one."""
    beside = scores.beside(chosen.key)
    for f in findings:
        if f is not chosen and f.p_value < LEVEL and beside.get(f.key, 1.0) >= LEVEL:
            f.explained_by = {"effect": chosen.effect, "place": chosen.place}


def _coefficients(model, fit, attached=None):
    """Values, intervals and units of an effect's coefficients, by default of the last attached one's."""
    base = component_name(*(attached or model.attached[-1]))
    return {n.split(".", 1)[1]: {"value": fit.parameters[n], "ci95": fit.interval(n), "unit": model.parameters[n].unit}
            for n in fit.free if n.startswith(base + ".")}


def nudged(start, model, finding):
    """A start where no coefficient is exactly neutral, so that the ones that vanish with it can move.

    Parameters
    ----------
    start : dict of str to float
        By parameter, SI units; changed in place.
    model : Model
        With the effect attached last.
    finding : Finding or None
        The effect, as the diagnosis found it.

    Returns
    -------
    dict of str to float
    """
    effect, place = model.attached[-1]
    base = component_name(effect, place)
    for c in effect.size:
        v, name = model.parameters[f"{base}.{c}"], f"{base}.{c}"
        if abs(start.get(name, v.value) - v.value) < 1e-3 * v.nominal:
            start[name] = v.value + 1e-2 * v.nominal * (1 if v.max > v.value else -1)
    return start


def _decide(findings, rivals, base, refines, steady):
    """Order the refitted candidates, accept the first that earns it, and name what these data cannot tell it from.

    One of more than a few that do as well is not accepted: it would be a name drawn by lot.
    ``steady(finding)`` says whether a finding's coefficient is the same all over the data. Returns it, or None.
    """
    parameters = {f.key: len(f.fit.free) for f in rivals}
    rivals.sort(key=lambda f: f.selection.white.sum() + 2 * parameters[f.key])
    rest = [f for f in findings if f not in rivals]
    findings[:] = [*rivals, *rest]
    for f in rivals:
        f.refused = f.refused or _refused(base, f)
    earned = [f for f in rivals if f.refused is None]
    if not earned:
        return None
    best = _plainly_better(base, earned)
    if _at_a_bound(best):  # a coefficient that the bounds alone hold is no measurement, where another does as well
        best = next((f for f in earned[1:] if not _at_a_bound(f) and _twins(base, f, best, kinds=("white",))), best)
    best, twins, constant = _considered(rivals, earned, best, base, refines, steady)
    largest = min(earned, key=lambda f: f.selection.raw.sum())
    if not constant and _ahead_in_plain(largest, best):  # what is slow is missing too, and may need no other
        other = _considered(rivals, earned, largest, base, refines, steady)
        best, twins, constant = other if other[2] else (best, twins, constant)
    findings.remove(best)
    findings.insert(0, best)
    for other in by_kind(twins):
        best.twins.append({"effect": other.effect, "place": other.place})
        other.twins.append({"effect": best.effect, "place": best.place})
    best.contested = constant and too_many(best)  # one that varies is none of them
    best.accepted = constant and not best.contested
    best.provisional = not best.accepted
    return best


def too_many(finding):
    """Whether so many others do as well as a finding that none of them is a name.

    Few effects at many places are no such case: one that acts at one stage or at another is known.

    Parameters
    ----------
    finding : Finding
        With its alternatives.

    Returns
    -------
    bool
    """
    return len(finding.twins) > CONTESTED and len({finding.effect, *(t["effect"] for t in finding.twins)}) > KINDS


def _considered(rivals, earned, best, base, refines, steady):
    """What is said where a finding is the best: it or what it corrects, alternatives, and whether it is constant."""
    twins = [f for f in rivals if f is not best and f.refused not in (NOTHING, UNSOLVED) and _twins(base, f, best)]
    plain = next((f for f in earned if f.effect == refines.get(best.effect) and _twins(base, f, best, 3.0)), None)
    if plain is not None and steady(plain):  # a correction is not claimed where the effect itself does nearly as well
        return plain, [best, *[t for t in twins if t is not plain]], True
    return best, twins, bool(steady(best))


def _ahead_in_plain(one, other):
    """Whether one finding predicts unseen folds better than another by more than chance, and by enough to matter."""
    ahead, own = difference(other.selection.raw, one.selection.raw)
    return ahead > max(SEPARATE * own, PLAIN * other.selection.raw.sum())


def by_kind(findings):
    """Findings in their order, yet each effect once before any of them at a second place.

    Parameters
    ----------
    findings : list of Finding
        Best first.

    Returns
    -------
    list of Finding
        The same ones.
    """
    known, ranks = {}, []
    for f in findings:
        known[f.effect] = known.get(f.effect, 0) + 1
        ranks.append(known[f.effect])
    return [f for _, f in sorted(zip(ranks, findings), key=lambda pair: pair[0])]


def _plainly_better(base, earned):
    """The first of the findings; or, of those that its fast part alone puts behind it, the one that predicts best.

    The whitened error hardly counts what is slow. Where it cannot tell rivals apart and the plain error of unseen folds
    can, that decides.
    """
    best = earned[0]
    fall, better = difference(base.white, best.selection.white)[0], []
    for f in earned[1:]:
        behind, error = difference(f.selection.white, best.selection.white)
        if behind <= SEPARATE * error and behind < ALIKE * fall and _ahead_in_plain(f, best):
            better.append(f)
    return min(better, key=lambda f: f.selection.raw.sum()) if better else best


def _at_a_bound(finding):
    """Whether a coefficient of a refitted candidate lies at an end of what is allowed."""
    own = [n for n in finding.fit.free if n.startswith(f"{finding.effect}_")]
    return any(finding.fit.at_bound(n) for n in own)


def _refused(base, finding):
    """Why a refitted candidate is no finding by itself, in words; None for one that is.

    It must be more than chance, predict unseen blocks better by more than the error of that, and by enough to matter,
    in the channel that it changes most too. Its interval is asked after the fit to all samples, whose residual alone
    tells the noise: that of the model without it holds what is missing.
    """
    if finding.p_value >= LEVEL:
        return "no more than chance"
    own = finding.selection
    shares = _shares(base.channels, own.channels)
    told = _predicts(base.channels, own.channels)
    if told and difference(base.white, own.white)[0] < CLEAR * base.white.sum():
        told = _predicts(base.alone, own.alone)
    if not told:
        return "no better on passes that it was not fitted to"
    share = shares[np.argmax(np.abs(shares))]
    if share < MATTERS:
        return f"too small to matter: {100 * share:.2g} % of the squared error"
    return None


def _shares(base, own):
    """By how much the error of each channel is less, as a part of it."""
    return (base - own).sum(1) / base.sum(1)


def _predicts(base, own):
    """Whether the errors on unseen blocks fall by more than chance, in the channel that changes most too."""
    fall, spread = difference(base.sum(0), own.sum(0))
    shares = _shares(base, own)
    return fall > spread and shares[np.argmax(np.abs(shares))] > 0


def holds_nothing(model, finding, attached=None):
    """Whether the intervals of all sizes of an effect hold the value that changes nothing.

    Parameters
    ----------
    model : Model
        That was fitted.
    finding : Finding
        With the fit, and its sizes.
    attached : (Effect, Place), optional
        The finding's, the last of the model's by default.

    Returns
    -------
    bool
    """
    coefficients = _coefficients(model, finding.fit, attached)
    ends = [(coefficients[n]["ci95"], neutral) for n, neutral in finding.sizes.items()]
    return bool(ends) and not finding.fit.apart and all(low <= neutral <= high for (low, high), neutral in ends)


def _told_from_nothing(dataset, model, finding, smaller, without):
    """The fit, with what the likelihood ratio rules out although an interval holds it.

    An interval takes the model as straight. A factor of a product, such as the growth of a loss that is small itself,
    or a drift whose time is longer than the log, is known to differ from nothing long before its size is known. Where
    the model is straight, both say the same.
    """
    base = component_name(*model.attached[-1])

    def squares(m, f):
        problem = dataset.residuals(m, f.free, f.parameters, "fit")
        return sum((noise.whiten(r[None], problem.chain) ** 2).sum()
                   for noise, r in zip(finding.fit.noise, problem.residual(f.values)))

    fall = squares(smaller, without) - squares(model, finding.fit)
    if fall < PRESSED * len(finding.sizes):
        return finding.fit
    return replace(finding.fit, apart={f"{base}.{n}": neutral for n, neutral in finding.sizes.items()})


def _twins(base, other, best, errors=SEPARATE, kinds=("white", "raw")):
    return alike(base, other.selection, best.selection, errors, kinds)


def alike(base, other, best, errors=SEPARATE, kinds=("white", "raw")):
    """Whether unseen folds cannot tell two refitted candidates apart: by so many standard errors, and what they take.

    Rivals that take away very different parts of the error are no alternatives, however noisy the comparison. One that
    its bounds hold errs less in the plain error than one that the other folds must tell: the whitened one counts that.

    Parameters
    ----------
    base : Selection
        Without either.
    other, best : Selection
        Of the rivals.
    errors : float
        Standard errors.
    kinds : tuple of str
        Errors that are asked: ``white``, ``raw``.

    Returns
    -------
    bool
    """
    least = {"white": 2.0 * errors ** 2, "raw": PLAIN * best.raw.sum()}
    for kind in kinds:
        one, two, none = (getattr(s, kind) for s in (other, best, base))
        gap, spread = difference(one, two)
        if gap >= least[kind] and not (gap <= errors * spread and gap < ALIKE * difference(none, two)[0]):
            return False
    return True


def _verdict(findings, alarm, hidden, dataset, attached):
    if any(f.accepted for f in findings):
        return "missing_effect"
    unseen = {(h["effect"], h["place"]) for h in hidden}
    if np.count_nonzero(~dataset.is_test) < 2 or (not attached and all(f.key in unseen for f in findings)):
        return "not_enough_excitation"
    if alarm or any(f.provisional or f.refused == NOTHING for f in findings):
        return "unexplained"
    return "nothing_missing"


def _slow(dataset, model, fit, floor):
    """Channels of torques or forces whose error is far above what changes from moment to moment, repeat to repeat.

    Beside noise that slow, which memory and size of the noise model take in, no test has an effect to find.
    """
    if dataset.paired:  # half a difference of out and back holds little that is slow
        return []
    left = errors(dataset, model, fit, "all")
    sizes = {c: float(np.sqrt(np.mean(dataset.reference(c) ** 2))) for c in dataset.channels}
    return [c for c in dataset.channels if dataset.base.unit(c) in ("N.m", "N")
            and left[c] ** 2 > SLOW * floor[c] ** 2 and left[c] > VISIBLE * sizes[c]]


def _channels(error, floor, told, base, winner, steps, provisional, slow):
    """What each channel says for itself.

    A channel misses an effect where the accepted one lowers its unseen error, and something unknown where its residual
    depends on something, or is slower than noise, and no effect explains that.
    """
    found = {}
    for k, (name, own) in enumerate(told.channels.items()):
        verdict = "unexplained" if own.sure or name in slow else "nothing_missing"
        for finding, word in ((winner, "missing_effect"), (provisional, "unexplained")):
            if finding is not None:
                fall, spread = difference(base.channels[k], finding.selection.channels[k])
                if fall > spread and fall > RELEVANT * base.channels[k].sum():
                    verdict = word
        found[name] = {"verdict": verdict, "error": error[name], "floor": floor[name],
                       "resolution": steps.get(name, 0.0), "slow": name in slow,
                       "depends_on": [v for v in own.variables if v["strength"] >= RELEVANT][:5] if own.sure else []}
    return found

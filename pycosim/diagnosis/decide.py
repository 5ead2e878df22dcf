"""A fitted model and its data in; which effect is missing, where, how sure, or nothing, or nothing known, out.

The best few candidates are refitted; the first is accepted that is significant, that lowers the error on folds that it
was not fitted to by more than the standard error of that fall and by enough to matter, whose interval leaves out
nothing, and whose coefficient is the same all over the data.
"""

from __future__ import annotations

from functools import partial
from weakref import WeakKeyDictionary

import numpy as np

from ..compile import compile_model, component_name, corrections, find_effect
from ..compile.contribution import effect_question
from ..core.errors import PycosimError
from ..fit import least_squares
from ..fit.late import endless
from . import first_look
from .compare import errors
from .constancy import constancy
from .crossval import difference, select
from .dependence import RELEVANT, dependence, noise_floor
from .excitation import smallest, undetectable, varied
from .finding import Diagnosis
from .lack_of_fit import unexplained
from .own import travels
from .remainder import LEFT, remaining, rises, slow
from .rhythm import rhythms
from .rivals import ALIKE, SURELY, behind, by_kind, plainly_better, too_many, twins
from .scores import LEVEL, Scores
from .table import Table
from .trials import BETWEEN, HALF, OWN, as_findings, fit_to_all, pressed, refit_best, turned

TOO_FEW = "there are too few passes to see whether it predicts one that it was not fitted to"
NOTHING = "its interval holds zero, so that something else is at work"
ENDLESS = "its best value is at the end of what is looked for, so that something else is at work"
ASTRAY = "most of what it changes in a channel is not what is missing there, so that something else is at work"
LASTING = "it outlasts the way from one turn to the next, so that something else is at work"
BEHIND = "another predicts more, and something else is at work there"
STARTS = "what it takes elsewhere it adds where a filter still tells of the start"
UNSOLVED = "beside the effects of the model it has no answer in closed form"
ELSE = NOTHING, ENDLESS, ASTRAY, LASTING  # reasons that something else is at work
OPEN = TOO_FEW, *ELSE, BEHIND, UNSOLVED  # reasons that do not say that a candidate is not what is missing
CLEAR, FEW = 0.1, 4
"""Of the whitened error, from which an effect may predict unseen passes with what they tell of themselves, where the
others do not tell the base model; a smaller one must do so with what the others alone tell. Of 16 short logs with
nothing hidden two had a candidate that took a hundredth; true effects there took a quarter and more. One that takes so
much and predicts no better is disproved by no fewer than so many blocks."""
MUCH, MEANT, SPIKE = 0.5, 0.25, 4.0
"""Of the most that an effect changes in any channel, from which a channel is asked how much of what changes there is
what was missing. That is all of it for a law that is right: 0.75 to 1.3 of 61 laws in logs of 34 kinds, 0.5 of one;
0.5 and more for delays that show, which move noise as well, and 0.4 for a travel behind an encoder's steps. Of delays
that fitted something else at one joint it was 0.05 and 0.14 at the other. What is further off than so many times the
median counts as that far."""
MATTERS = 0.05
"""Of the squared error of one channel, that an effect must take. The imperfect form of a larger one leaves as much:
beside a delay of a gait, found to a tenth of a sample, a hysteresis took 0.04."""
BESIDE, WHOLE = 0.15, 0.01
"""The same beside other effects, where it is less than so much of what a model without any leaves. Beside a filter of
5 Hz, the error of which is four to seven times the noise, two false second effects took 0.05 of the rest and 0.0024
and 0.0027 of the whole, eleven true ones 0.3 and more of the rest: 0.41 is an effect of 1.3 times the noise. A third
false one, of 0.11 of the rest, is not refused."""
TURNS = 0.25
"""Of the squared error of a channel, from which what is over between two samples is not nothing. Two delays
of nine tenths of a sample in coarse logs of ordinary motion, 1.2 times the floor, held 0.53 and 0.57; of ten sound
logs, seven of them of such motion and two at 50 Hz, none had a candidate of that kind at all."""
_WITHOUT = WeakKeyDictionary()  # errors of the model without effects, by data set


def diagnose(dataset, model, fit, seed=0, progress=None, finished=True, known=None):
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
    known : (Table, Scores), optional
        Of this model and fit, where they are computed already.

    Returns
    -------
    Diagnosis
    """
    say = progress or (lambda text: None)
    whole = dataset.sliding(model)
    dataset = whole.settled(model, fit.parameters)
    table, scores = known or scored(dataset, model, fit, seed, progress)
    findings = as_findings(table, scores)
    base = select(dataset, model, fit, scores.single)
    rivals = refit_best(dataset, model, fit, scores, findings, base, table, say)
    _refuse_as_lesser(whole, model, fit, base, rivals)
    _refuse_after_turns(dataset, rivals)
    told = dependence(dataset, model, fit, seed)
    depends, alarm = told.variables, told.sure

    steady = partial(_steady, dataset=dataset, model=model, fit=fit, base=base, seed=seed)
    chosen = _chosen(dataset, whole, model, fit, findings, rivals, base, steady, scores.single)
    if chosen is not None:
        _explained_by(findings, chosen, scores)
    say("looking at what is left")
    hidden = undetectable(table, scores)
    floor = noise_floor(dataset, model, fit)
    wandering, beats = slow(dataset, model, fit), rhythms(dataset, model, fit)
    brief = [f for f in rivals if _much_between(base, f)]
    beating = any(not mains for _, _, mains in beats.values())
    verdict = _verdict(findings, alarm or bool(brief or wandering or beating), hidden, dataset, model.attached)
    winner, provisional = (chosen if chosen and chosen.accepted else None), (
        chosen if chosen and chosen.provisional else None)
    held_out = errors(dataset, model, fit, "test") if dataset.is_test.any() else {}
    channels = _channels(fit.error, held_out, floor, told, base, winner, dataset.steps, provisional, wandering, beats)
    unknown = verdict == "unexplained" and not dataset.averaged and not any(f.contested for f in findings)
    found = Diagnosis(verdict, fit.error, floor, findings, depends, hidden, scores.single,
                      smallest(scores, LEVEL, MATTERS, hidden), varied(table), None, channels,
                      partial(unexplained, table, depends, floor) if unknown else None,
                      between=any(_soon(dataset, (model, fit), f) for f in brief),
                      travels={} if winner else _travels(dataset, model, rivals))
    return found.finish() if finished else found


def scored(dataset, model, fit, seed=0, progress=None):
    """What every candidate effect would change at every place, and the scores of that.

    Parameters
    ----------
    dataset, model, fit, seed, progress
        As for `diagnose`.

    Returns
    -------
    (Table, Scores)
        Without the columns, hundreds of the log's length: what is asked of them are their moments.
    """
    say = progress or (lambda text: None)
    say("testing every candidate effect at every place")
    table = Table(dataset.sliding(model).settled(model, fit.parameters), model, fit)
    first_look.tell(say, table)
    scores = Scores(table, seed)
    table.columns, scores.columns, scores.frame = [], [], []  # a search goes on with several of these at hand
    return table, scores


def _steady(finding, dataset, model, fit, base, seed):
    """Whether a finding has the same coefficient all over the data, and what is left beside it does not outweigh it."""
    larger = compile_model(dataset.library, model.rig, [*model.keys, finding.key])
    law, own = constancy(dataset, larger, finding.fit)[finding.key], finding.selection
    if law.short(larger.attached[-1][0], base, own) > 1.0:
        finding.varies_with = law.variable
    risen = rises(dataset, (model, fit), (larger, finding.fit))
    share, variable = remaining(dependence(dataset, larger, finding.fit, seed), base, own, law.follows, risen,
                                slow(dataset, larger, finding.fit))
    finding.outweighed_by = variable if share > LEFT else None
    return finding.varies_with is None and finding.outweighed_by is None


def _chosen(dataset, whole, model, fit, findings, rivals, base, steady, noise):
    """The first finding that earns it on all samples as well: their fit reaches bounds that a trial does not.

    Samples soon after a start are not settled where the model filters a torque: what it was before is not known. No
    effect is fitted to them, yet one that is at work raises no error there. Beside something else that is missing an
    interval may hold zero, and what stands in for a law that nobody knows may have no best value. One that predicts
    less is not chosen in its stead. One that comes to a bound gives way to another that does as well, if there is one.
    """
    refines, ahead = corrections(dataset.library), None
    for _ in range(2 * len(rivals)):
        chosen = _decide(findings, rivals, base, refines, steady, bool(model.keys))
        if chosen is None:
            break
        if ahead is not None and _predicts_less(chosen.selection, ahead.selection):
            _give_way(findings, chosen, BEHIND)
            break
        larger = compile_model(dataset.library, model.rig, [*model.keys, chosen.key])
        if not _can_be_searched(dataset, larger):
            _give_way(findings, chosen, UNSOLVED)
            continue
        held = _at_a_bound(chosen)
        apart = fit_to_all(chosen, dataset, larger, model, fit, noise)
        if _at_a_bound(chosen) and not held:
            _give_way(findings, chosen, None)
            continue
        reason = NOTHING if not apart else _against(dataset, whole, (model, fit), (larger, chosen.fit), base.usual)
        if reason is None:
            return chosen
        ahead = ahead or chosen
        _give_way(findings, chosen, reason)
    return None


def _against(dataset, whole, before, after, usual):
    """What speaks against an effect that was fitted to all samples, in words; None where nothing does."""
    if whole.early is not dataset.early and _risen(whole, before, after, usual):
        return STARTS
    if endless(after[1]) or pressed(*after):
        return ENDLESS
    if _lasting(dataset, *after):
        return LASTING
    if not _meant(dataset, before, after):
        return ASTRAY
    # the rig's travels are a guess: others do all that the effect does, with its other parameters as they are fitted
    (effect, _), (model, _) = after[0].attached[-1], before
    return OWN if effect.channel and _own_travels(dataset, model, *after, 1.0) else None


def _lasting(dataset, model, fit):
    """Whether a memory of friction, in the effect attached last, is not over before the next turn.

    What grew at rest must be lost over the way, a lag must end within the time, and a direction must turn over within
    the speeds from one turn to the next. A friction that grows with the way that was travelled was both else.
    """
    effect, place = model.attached[-1]
    if not {"rest", "creep"} & set(effect.scan.values()):
        return False
    own = {kind: fit.parameters[f"{component_name(effect, place)}.{c}"] for c, kind in effect.scan.items()}
    speed = dataset.segment_signals(model, fit.parameters, [name := f"{place.components[0]}.w"])[name]
    moving = dataset.passes >= 0
    steps, speed = np.gradient(dataset.time)[moving].clip(0, 1), np.abs(speed[moving])
    number = np.unique(dataset.passes[moving], return_inverse=True)[1]
    usual = {"travel": np.median(np.bincount(number, speed * steps)), "lag": np.median(np.bincount(number, steps)),
             "creep": np.median(speed)}
    return any(own.get(kind, 0.0) > most for kind, most in usual.items())


def _risen(dataset, before, after, usual):
    """Whether all channels together are further off on all moving samples, in units of their noise."""
    one, other = (sum((e / u) ** 2 for e, u in zip(errors(dataset, *m, "all").values(), usual.ravel()))
                  for m in (before, after))
    return other > one


def _meant(dataset, before, after):
    """Whether what a larger model changes in each channel is mostly what the smaller one lacks there."""
    one, left = (dataset.residuals(model, fit.free, fit.parameters, "fit").residual(fit.values)
                 for model, fit in (before, after))
    most, changed = SPIKE * np.median(np.abs(left), axis=1, keepdims=True), one - left
    changes = (changed**2).sum(1) * after[1].weights ** 2
    falls = (changed * (changed + 2 * np.clip(left, -most, most))).sum(1) * after[1].weights ** 2
    return bool(np.all((falls >= MEANT * changes)[changes >= MUCH * changes.max()]))


def _predicts_less(one, other):
    """Whether unseen folds put one behind another in one kind of error, and not before it in the other."""
    return bool(behind(one, other)) and not behind(other, one)


def _give_way(findings, chosen, reason):
    """Refuse what was chosen, or ask for it anew without a reason; and forget what were alternatives of it."""
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


def _explained_by(findings, chosen, scores):
    """Mark the candidates whose evidence is gone beside the chosen one."""
    told = [f for f in findings if f is not chosen and f.p_value < LEVEL]
    beside = scores.beside(chosen.key, only={f.key for f in told})
    for f in told:
        if beside.get(f.key, 1.0) >= LEVEL:
            f.explained_by = {"effect": chosen.effect, "place": chosen.place}


def _decide(findings, rivals, base, refines, steady, beside):
    """Order the refitted candidates, accept the first that earns it, and name what these data cannot tell it from.

    One of more than a few that do as well is not accepted: it would be a name drawn by lot.
    ``steady(finding)`` says whether a finding's coefficient is the same all over the data, ``beside`` whether other
    effects are in the model. Returns it, or None.
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
    best = plainly_better(base, earned)
    held = {f.effect for f in earned if _at_a_bound(f)}  # no measurement, nor is what would correct it
    if _at_a_bound(best) or refines.get(best.effect) in held:
        best = next((f for f in earned if not _at_a_bound(f) and refines.get(f.effect) not in held and twins(
            base, f, best, SURELY, ("white",))), best)
    best, others, constant = _considered(rivals, earned, best, base, refines, steady)
    largest = min(earned, key=lambda f: f.selection.raw.sum())
    if not constant and "raw" in behind(best.selection, largest.selection):  # what is slow is missing too
        other = _considered(rivals, earned, largest, base, refines, steady)
        best, others, constant = other if other[2] else (best, others, constant)
    findings.remove(best)
    findings.insert(0, best)
    for other in by_kind(others, [best.effect], refines):
        best.twins.append({"effect": other.effect, "place": other.place})
        other.twins.append({"effect": best.effect, "place": best.place})
        best.uncounted |= {other.key} if other.refused == BETWEEN else set()
    best.contested = constant and too_many(best, refines, beside)  # one that varies is none of them
    best.accepted = constant and not best.contested
    best.provisional = not best.accepted
    return best


def _considered(rivals, earned, best, base, refines, steady):
    """What is said where a finding is the best: it or what it corrects, alternatives, and whether it is constant.

    One that was refused for its bound is an alternative still of one that is at a bound itself.
    """
    able = [f for f in rivals if f.refused not in (*ELSE, UNSOLVED) or f.refused == ENDLESS and _at_a_bound(best)]
    others = [f for f in able if f is not best and twins(base, f, best)]
    plain = next((f for f in earned if f.effect == refines.get(best.effect) and (
        twins(base, f, best, SURELY)
        or np.all(_shares(f.selection.channels, best.selection.channels) < MATTERS))), None)
    if plain is not None and steady(plain):  # a correction is not claimed where the effect itself does nearly as well
        return plain, [f for f in able if f is not plain and (f is best or f in others or twins(base, f, plain))], True
    return best, others, bool(steady(best))


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
    clear = difference(base.white, own.white)[0] >= CLEAR * base.white.sum()
    if told and not clear:
        told = _predicts(base.alone, own.alone) if base.told else "white" in behind(base, own)
    if not told:
        return TOO_FEW if clear and len(base.white) < FEW else "no better on passes that it was not fitted to"
    share = shares[np.argmax(np.abs(shares))]
    if share < MATTERS:
        return f"too small to matter: {_percent(share)} of the squared error"
    return None


def _refuse_as_lesser(dataset, model, fit, base, rivals):
    """Refuse what takes next to nothing of what a model without effects leaves: the form of a larger may leave that."""
    if not model.attached:
        return
    if dataset not in _WITHOUT:
        bare = compile_model(dataset.library, model.rig, [])
        _WITHOUT[dataset] = errors(dataset, bare, least_squares.fit(dataset, bare), "fit")
    now = errors(dataset, model, fit, "fit")
    part = np.array([(now[c] / _WITHOUT[dataset][c]) ** 2 for c in dataset.channels])
    for f in rivals:
        shares = _shares(base.channels, f.selection.channels)
        whole = float((part * shares).max())
        if f.refused is None and f.p_value < LEVEL and shares.max() < BESIDE and whole < WHOLE:
            f.refused = f"too small beside the other effects: {_percent(whole)} of the squared error without any"


def _refuse_after_turns(dataset, rivals):
    """Refuse what acts after turns and predicts less than what is no name there, for which it stands.

    That is a travel that may be the machine's own, for the rig's is a guess: of two logs with nothing else hidden after
    turns, whose machines had a third and a half of it, one had a filter for it, and one a lag of friction. Or it is
    what is over between two samples: beside a reference that lagged by less than one, the jumps of friction at two
    segments were a lag of it at one.
    """
    able = [f for f in rivals if _after_turns(dataset, f.effect)]
    ahead = [f for f in able if f.refused in (OWN, BETWEEN) and f.p_value < LEVEL]
    for f in (f for f in able if f.refused is None):
        f.refused = next((o.refused for o in ahead if _predicts_less(f.selection, o.selection)), None)


def _travels(dataset, model, rivals):
    """What the best of those that are refused as the machine's own travel says of it; nothing if told."""
    refused = [f for f in rivals if f.refused == OWN and f.p_value < LEVEL and _after_turns(dataset, f.effect)]
    if not refused:
        return {}
    best = min(refused, key=lambda f: f.selection.white.sum())
    return _own_travels(dataset, model, compile_model(dataset.library, model.rig, [*model.keys, best.key]), best.fit)


def _after_turns(dataset, effect):
    """Whether an effect acts after turns, as another travel of the machine's own does."""
    found = find_effect(dataset.library, effect)
    return bool(found.channel or effect_question(dataset.library, found).states)


def _own_travels(dataset, model, larger, fit, least=1 - ALIKE):
    """The machine's own travels that do what the effect of a larger model does; nothing where they do not, or are told.

    ``least`` is the part of it that they must do.
    """
    told, question = dataset.study.parameters, dataset.ask(model)
    known = any(f"{c}.travel" in told and told[f"{c}.travel"].value is not None for c in model.segments)
    if known or dataset.averaged or question.late or question.held:
        return {}
    return travels(dataset, model, larger, fit, least)


def _percent(share):
    return f"{100 * share:.2g} %" if share >= 1e-3 else "less than 0.1 %"


def _shares(base, own):
    """By how much the error of each channel is less, as a part of it."""
    return (base - own).sum(1) / base.sum(1)


def _predicts(base, own):
    """Whether the errors on unseen blocks fall by more than chance, in the channel that changes most too."""
    fall, spread = difference(base.sum(0), own.sum(0))
    shares = _shares(base, own)
    return fall > spread and shares[np.argmax(np.abs(shares))] > 0


def _much_between(base, finding):
    """Whether so much is over between two samples that what does it is missing, although none of what may is a name."""
    own = finding.selection.channels
    return bool(finding.refused == BETWEEN and finding.p_value < LEVEL and _predicts(base.channels, own)
                and _shares(base.channels, own).max() >= TURNS)


def _soon(dataset, before, finding):
    """Whether most of what an effect takes is over in the few samples after turns, or taken by a filter.

    A hysteresis whose travel is over so soon is a difference between directions too, which acts everywhere.
    """
    larger = compile_model(dataset.library, before[0].rig, [*before[0].keys, finding.key])
    if "lag" in larger.attached[-1][0].scan.values():
        return True
    one, left = (dataset.residuals(model, fit.free, fit.parameters, "fit").residual(fit.values)
                 for model, fit in (before, (larger, finding.fit)))
    falls = ((one**2 - left**2) * finding.fit.weights[:, None] ** 2).sum(0)
    return bool(falls[turned(dataset)[dataset.picks("fit")[0][1]]].sum() > HALF * falls.sum())


def _verdict(findings, alarm, hidden, dataset, attached):
    if any(f.accepted for f in findings):
        return "missing_effect"
    unseen = {(h["effect"], h["place"]) for h in hidden}
    if np.count_nonzero(~dataset.is_test) < 2 or (not attached and all(f.key in unseen for f in findings)):
        return "not_enough_excitation"
    if alarm or any(f.provisional or f.refused in ELSE for f in findings):
        return "unexplained"
    if any(f.refused == TOO_FEW for f in findings):
        return "not_enough_excitation"
    return "nothing_missing"


def _channels(error, held_out, floor, told, base, winner, steps, provisional, slow, beats):
    """What each channel says for itself.

    A channel misses an effect where the accepted one lowers its unseen error, and something unknown where its residual
    depends on something, is slower than noise, or keeps a beat of its own that is not of mains, and no effect explains
    that.
    """
    found = {}
    for k, (name, own) in enumerate(told.channels.items()):
        beating = name in beats and not beats[name][-1]
        verdict = "unexplained" if own.sure or name in slow or beating else "nothing_missing"
        for finding, word in ((winner, "missing_effect"), (provisional, "unexplained")):
            if finding is not None:
                fall, spread = difference(base.channels[k], finding.selection.channels[k])
                if fall > spread and fall > RELEVANT * base.channels[k].sum():
                    verdict = word
        found[name] = {"verdict": verdict, "error": error[name], "floor": floor[name],
                       "resolution": steps.get(name, 0.0), "slow": name in slow,
                       "depends_on": [v for v in own.variables if v["strength"] >= RELEVANT][:5] if own.sure else []}
        found[name] |= {"held_out_error": held_out[name]} if name in held_out else {}
        found[name] |= {"beat": dict(zip(("frequency", "share", "mains"), beats[name]))} if name in beats else {}
    return found

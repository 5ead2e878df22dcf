"""Scores of candidates in; findings, the best of them refitted and judged on unseen folds, out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import chdtrc

from ..compile import compile_model, component_name, corrections, find_effect, find_place
from ..compile.contribution import effect_question
from ..core.errors import NoAnswerError, PycosimError
from ..core.executors import in_turn
from ..data.sent import Sent
from ..data.turns import built_up
from ..fit import least_squares
from ..fit.late import delays
from .crossval import difference, select
from .finding import Finding
from .own import Followed, left_of
from .rivals import ALIKE, twins
from .scores import LEVEL, PRESSED

REFITS = 10
BETWEEN = "over within a few samples, so that they do not show it"
OWN, SIMILAR = "what the model's own travel does after turns", 2.0
"""Said of a travel less than so many times the rig's own, where that is at work."""
SHORT = 0.25  # samples: a shorter delay is when, between two rows, a logger read each of its columns
START, ENDED = "over within one pass or stretch, so that it tells of the start alone", 3.0
"""Said of a law of time of which so many time constants are no longer than that: a twentieth is left then."""
FEW, MOSTLY, HALF = 4, 0.8, 0.5
"""Samples after a turn, and the share of what a memory of friction changes that lies in them, from which on it is taken
for what straight lines between samples leave where a torque was moved by a part of one; and of what a delay of less
than a sample changes, from which on that is what happens between the last sample of one way and the next first. At
50 Hz a friction that builds up over 0.2 mrad was a delay of 15 ms, 0.8 of it in those samples; of the shift of the ball
screw EMPS, half a sample, nothing lies there."""
RULED, BACK = 2.0, 0.1
"""Standard errors, and part of what a delay takes next to turns, that it may give back elsewhere. True ones of more
than half a sample took something there, or gave back 0.03; two of half a sample gave back 0.3 and 0.9."""
WORTH = 0.5
"""Of what the best candidate takes, from which a memory of friction is refitted at its other places. A hysteresis of
two stages took 0.8 of it at one of them."""
TRIAL = 8000  # samples of a trial fit; the accepted effect is fitted to all
GLANCE, SAME = 4000, 1e-4
"""Samples on which another start is tried first, and the part of what is left there that it must take to be another
valley: of 46 such starts of the ball screw EMPS two were."""


def as_findings(table, scores):
    """One finding an effect and place, at its best grid point.

    Parameters
    ----------
    table : Table
        Of the fitted model, with a column for each candidate.
    scores : Scores
        Of these candidates.

    Returns
    -------
    list of Finding
        Best first.
    """
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
        finding.p_value = scores.family(score.drawn, score.scanned)
        finer = _clearest(scores, score) if score.scanned else scores.refined.get(candidate.key, score)
        finding.start = start_of(finer.candidate, finer.coefficients)
        finding.predicted_error = scores.predicted(finer.candidate, finer.coefficients)
        findings.append(finding)
    return sorted(findings, key=lambda f: -f.statistic)


def _clearest(scores, best):
    """Of the numbers of cycles of one place that are more than chance, the one that leaves least.

    Behind an encoder's steps the surest may be one that rounding knows little of, and that takes little.
    """
    mine = [s for s in scores.results if s.candidate.key == best.candidate.key and s.coefficients is not None]
    shared = [s for s in mine if not s.candidate.extra["runs"]]
    sure = [s for s in mine if scores.family(s.drawn, True) < LEVEL and _turns(s, shared)]
    errors = {id(s): scores.predicted(s.candidate, s.coefficients) for s in sure}
    return min(sure, key=lambda s: _squares(scores, errors[id(s)]), default=best)


def _squares(scores, errors):
    """Sum of the channels' squared errors, as the scores weigh them."""
    return sum((w * errors[c]) ** 2 for w, c in zip(scores.weights, scores.table.channels))


def _turns(score, shared):
    """Whether a phase in each run takes more than chance beside one for all, at the same number of cycles."""
    if not score.candidate.extra["runs"]:
        return True
    one = next(s for s in shared if s.candidate.grid == score.candidate.grid)
    return chdtrc(len(score.coefficients) - len(one.coefficients), max(score.value - one.value, 0.0)) < LEVEL


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
        sine, cosine = np.reshape(coefficients, (-1, 2)).T
        phase, turned = candidate.extra["phase"], np.arctan2(cosine, sine)
        values[candidate.names[0]] = float(np.sqrt(np.mean(sine ** 2 + cosine ** 2)))
        values[phase] = float(least_squares.around(turned))
        values.update({f"{phase}[{run}]": float(v) for run, v in zip(candidate.extra["runs"], turned)})
    else:
        values.update({n: float(v) for n, v in zip(candidate.names, coefficients) if n not in effect.scan})
    return {f"{base}.{n}": v for n, v in values.items()}


def refit_best(dataset, model, fit, scores, findings, base, table, say):
    """Fit the model with each of the best candidates, and fill in what their findings say.

    The scores see each place from a base model bent to what is missing, so that the best effect's other places are
    fitted as well. So is what could add the same (an asymmetry of a loss taken for small is the offset that is
    missing), and what such an effect corrects: of a share of a loss taken for none no score tells. Of a memory, or a
    record moved at turns, a score sees little: at half of what the best takes its other places are fitted.

    Parameters
    ----------
    dataset : Dataset
        Its fit part is fitted.
    model : Model
        With the effects accepted so far.
    fit : Fit
        Of that model.
    scores : Scores
        Of all candidates.
    findings : list of Finding
        Best score first.
    base : Selection
        Of the model as it is.
    table : Table
        Of the fitted model, with a column for each candidate.
    say : callable
        Takes a sentence on what is done next.

    Returns
    -------
    list of Finding
        Those that could be fitted.
    """
    def refitted(some):
        return _refitted(dataset, model, fit, scores, some, base, table, say)

    def lowest(some):
        return min(some, key=lambda f: f.selection.white.sum())

    likely, refines = [f for f in findings if f.p_value < 10 * LEVEL], corrections(dataset.library)
    first = _promising(dataset, scores, likely)
    dataset.library.ahead(model.rig, [[*model.keys, f.key] for f in first])
    seen, unseen, asked, best = list(refitted(first)), [], set(), None
    while seen and (best := lowest([*seen, *unseen])).key not in asked:
        asked.add(best.key)  # what is fitted for its sake may be better, and has a kin of its own
        effects = {best.effect, *(f.effect for f in seen if twins(base, f, best) or _remembers(dataset, f, best, base))}
        effects |= {refines[e] for e in effects if e in refines}
        rest = [f for f in findings if f not in seen and f not in unseen]
        unseen += refitted([f for f in rest if f.effect in effects and _unseen(dataset, model, fit, f)])
        akin = scores.akin(best.key, 1 - ALIKE)[:REFITS]
        seen += refitted([f for f in likely if f in rest and f not in first and f not in unseen
                          and (f.effect in effects or f.key in akin)])
    for f in [f for f in (*seen, *unseen) if f.effect == best.effect or f in unseen]:
        mine = [o for o in seen if o.effect == f.effect]
        other = lowest(mine or [o for o in seen if refines.get(o.effect) == f.effect])
        if mine and f is not other:
            _refit_from(dataset, model, scores.single, f, other, base)
        if lowest((f, other)) is f or twins(base, f, other):  # a score sees no share of a loss taken for none
            f.p_value, f.p_value_single = min((f.p_value, f.p_value_single), (other.p_value, other.p_value_single))
    return seen + unseen


def _promising(dataset, scores, likely):
    """The best by their scores, which hardly count what is slow, what is predicted to leave least, and delays."""
    least = min(likely, key=lambda f: _squares(scores, f.predicted_error), default=None)
    return likely[:REFITS] + [f for f in likely[REFITS:] if f is least
                              or "delay" in find_effect(dataset.library, f.effect).scan.values()]


def _refitted(dataset, model, fit, scores, some, base, table, say):
    """Fit the model with each of some candidates; yields those that could be, as soon as they are."""
    larger = [compile_model(dataset.library, model.rig, [*model.keys, f.key]) for f in some]
    results = in_turn((tried, Sent(dataset), model.rig, m.keys, _starts(m, fit, f, table), scores.single, base)
                      for f, m in zip(some, larger))
    for k, (f, m) in enumerate(zip(some, larger), 1):
        say(f"refitting with {f.effect} at {f.place}, {k} of {len(some)}")
        if (found := next(results)) is not None:
            f.fit, f.selection = found
            measure(f, m, m.attached[-1], table)
            f.refused = no_effect(dataset, m, f.fit)
            yield f


def _remembers(dataset, finding, best, base):
    """Whether it is a memory of friction that takes so much of what the best does that its other places may be it."""
    takes, most = ((base.white - f.selection.white).sum() for f in (finding, best))
    effect = find_effect(dataset.library, finding.effect)
    return finding.refused is None and takes > WORTH * most and bool(effect_question(dataset.library, effect).states)


def _unseen(dataset, model, fit, finding):
    """Whether the base model takes the loss at a finding's place for none: a score sees nothing of a share of that."""
    place = find_place(dataset.library, model.rig, find_effect(dataset.library, finding.effect), finding.place)
    return any(f"{c}.f0" in fit.free and fit.at_bound(f"{c}.f0") == "min" for c in place.components)


def _refit_from(dataset, model, noise, finding, other, alone):
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
    if _cost(fit, alone.usual) < _cost(finding.fit, alone.usual):
        finding.fit, finding.selection = fit, select(dataset, larger, fit, noise, alone)
        finding.coefficients = _coefficients(larger, fit)


def _cost(fit, usual):
    """Sum of the channels' squared errors, in units of their noise."""
    return sum((e / u) ** 2 for e, u in zip(fit.error.values(), usual.ravel()))


def _starts(model, fit, finding, table):
    """Where the fits of a model with one candidate more begin."""
    start, lifted = {**fit.parameters, **finding.start}, {}
    for component in model.attached[-1][1].components:
        name = f"{component}.f0"
        if name in fit.free and start[name] < table.least_loss(component):
            lifted[name] = table.least_loss(component)
        name = f"{component}.mu"
        if name in fit.free and "mu" in table.reads(finding.effect):
            start[name] = min(start[name], table.most_efficient(component))
    starts = [{**start, **lifted}]
    if lifted and not any(fit.at_bound(name) for name in lifted):
        starts.append(start)  # a small loss that nothing presses may be what there is
    return [nudged(s, model, finding) for s in starts]


def tried(sent, rig, keys, starts, noise, alone):
    """Fit a model with a candidate from several starts, and judge the best on unseen folds; done anywhere.

    Parameters
    ----------
    sent : Sent
        The data.
    rig : str
        Class of the rig.
    keys : list of (str, str)
        Effects and places, the candidate's last.
    starts : list of dict of str to float
        All parameters, SI units.
    noise : list of Noise
        One a channel.
    alone : Selection
        Of the model without the candidate.

    Returns
    -------
    (Fit, Selection), or None
        None where the candidate cannot be fitted.
    """
    dataset = sent.dataset
    model = compile_model(dataset.library, rig, keys)
    try:
        fits = [_best_fit(dataset, model, start, noise, alone.usual) for start in starts]
    except PycosimError:
        return None
    best = min(fits, key=lambda f: _cost(f, alone.usual))
    return best, select(dataset, model, best, noise, alone)


def no_effect(dataset, model, fit, attached=None):
    """Why what was fitted is no effect, in words; None where nothing speaks against it.

    Parameters
    ----------
    dataset : Dataset
        Its fit part was fitted.
    model : Model
        That was fitted.
    fit : Fit
        Of it.
    attached : (Effect, Place), optional
        The effect in question, one of the model's; by default the last.

    Returns
    -------
    str or None

    Notes
    -----
    A filter that is done within half a sample, or a travel that is passed within two at the least speed, is what
    straight lines between samples miss: as much is left at a start where a torque was moved by a part of a sample. A
    delay of less than a quarter of one is when a logger reads its columns, or holds a command that it logs. A lag of
    friction of less than one and a half is what a speed that is known to a sample leaves of a travel. Where the
    rig's own travel is at work, one of about that length is no other; of a rig's only segment it is the same whether it
    was seen at work or not, and any memory of which it does four fifths is none. A loss that falls in time, and has
    done so before the first pass is over, is what that starts with: a memory of friction has a state there that no log
    tells.
    """
    effect, place = attached = attached or model.attached[-1]
    own = {kind: fit.parameters[f"{component_name(*attached)}.{c}"] for c, kind in effect.scan.items()}
    lasts = 1.5 if "creep" in effect.scan.values() else 0.5
    step = _step(dataset)
    least = {"lag": lasts * step, "travel": 2 * step * dataset.w_min, "delay": SHORT * step}
    if any(abs(own[kind]) < least[kind] for kind in own if kind in least) or _between(dataset, model, fit, attached):
        return BETWEEN
    if ENDED * own.get("time", np.inf) < np.median(dataset.blocks.t1 - dataset.blocks.t0):
        return START
    travels = [fit.parameters[f"{c}.travel"] for c in place.components if f"{c}.travel" in fit.parameters]
    similar = own.get("travel", np.inf) < SIMILAR * max(travels, default=0.0)
    at_work = dataset.own_travel or dataset.early is not None or len(dataset.base.segments) == 1
    return OWN if similar and at_work or _is_own(dataset, model, fit, attached) else None


def _is_own(dataset, model, fit, attached):
    """Whether the rig's own travel, which every segment has and no fit follows, does what a memory of friction does.

    It has no free parameter. Beside another effect, behind a coarse encoder or after a spike it is not seen at work
    before the fit, and has the name of a memory then: of a travel of its own length, or of a lag of a sample or two.
    """
    key = (attached[0].id, attached[1].name)
    if not effect_question(dataset.library, attached[0]).states or dataset.averaged or not dataset.base.segments:
        return False
    without = compile_model(dataset.library, model.rig, [k for k in model.keys if k != key])
    here = Followed(dataset, without, fit)
    own = here.residual + here.changed(built_up(dataset, without, here.parameters))
    none, left, own = map(here.squares, (here.residual, left_of(dataset, model, fit), own))
    return none - own >= (1 - ALIKE) * (none - left) > 0


def _between(dataset, model, fit, attached):
    """Whether an effect acts in a few samples after a turn, where it may be what happens between two of them.

    That is asked of a memory of friction beside a torque that was moved in time, and of a delay of a few samples.
    """
    effect, place = attached
    key, step = (effect.id, place.name), _step(dataset)
    names = [f"{component_name(effect, place)}.{c}" for c, kind in effect.scan.items() if kind == "delay"]
    if any(abs(fit.parameters[n]) < step for n in names):
        most = HALF
    elif effect_question(dataset.library, effect).states and any(
            e.channel for e, p in model.attached if (e.id, p.name) != key):
        most = MOSTLY
    else:
        most = 1.0
    if most == 1.0 and not names:
        return False
    near = turned(dataset)[dataset.picks("fit")[0][1]]
    without = compile_model(dataset.library, model.rig, [k for k in model.keys if k != key])
    before, after = (dataset.residuals(m, free, fit.parameters, "fit").residual([fit.parameters[n] for n in free])
                     for m in (without, model) for free in [[n for n in fit.free if n in m.parameters]])
    changed = ((after - before) ** 2 * fit.weights[:, None] ** 2).sum(0)
    return bool(changed[near].sum() > most * changed.sum()) or any(
        _given_back(dataset, model, fit, n, near) for n in names if abs(fit.parameters[n]) < FEW * step)


def _given_back(dataset, model, fit, name, turned):
    """Whether a delay gives back elsewhere a part of what it takes next to turns, and more than chance.

    A true one takes something wherever the torque changes. It is asked at whole samples: between two, means lower the
    noise.
    """
    problem, step = dataset.residuals(model, fit.free, fit.parameters, "fit"), _step(dataset)
    whole = round(fit.parameters[name] / step) * step
    values = [np.where([n == name for n in fit.free], d, fit.values) for d in (0.0, whole)]
    none, late = (((fit.weights[:, None] * problem.residual(v)) ** 2).sum(0) for v in values)
    blocks = np.unique(problem.block, return_inverse=True)[1]
    back, spread = difference(*(np.bincount(blocks, np.where(turned, 0.0, left)) for left in (late, none)))
    return bool(back > max(RULED * spread, BACK * (none - late)[turned].sum()))


def turned(dataset):
    """Samples a few after a turn of any segment, and the last of a pass: a delay takes it from what comes after.

    Parameters
    ----------
    dataset : Dataset
        Its passes are known.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    way, found = np.sign(dataset.speeds), np.zeros(len(dataset.time), dtype=bool)
    for k in range(1, FEW + 1):
        found[k:] |= np.any(way[:, k:] != way[:, :-k], axis=0) | (dataset.run[k:] != dataset.run[:-k])
    found[:-1] |= dataset.passes[1:] != dataset.passes[:-1]
    return found


def _step(dataset):
    """Usual time between two samples [s]."""
    return float(np.median(np.diff(dataset.time))) if len(dataset.time) > 1 else 1.0


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

    A loss that would be negative is none: beyond that the errors bend, and have valleys of their own. Whether the other
    start leads to another valley is seen on few samples.
    """
    fit = least_squares.fit(dataset, model, start, most=TRIAL, noise=noise, held=_earlier(model))
    base, effect = component_name(*model.attached[-1]), model.attached[-1][0]
    if not any(fit.at_bound(n) for n in fit.free if not n.startswith(base + ".")):
        return fit
    twice = {name: min(max(2 * start.get(name, v.value) - v.value, v.min), v.max) for name, v in (
        (f"{base}.{c}", model.parameters[f"{base}.{c}"]) for c in effect.size)}
    try:
        other = least_squares.fit(dataset, model, {**start, **twice}, most=GLANCE, noise=noise, held=_earlier(model))
    except NoAnswerError:  # so large an effect leaves no motion
        return fit
    problem = dataset.residuals(model, fit.free, fit.parameters, "fit")
    there = problem.thin(max(1, problem.n // GLANCE)).residual(fit.values)
    if _cost(other, usual) >= (1 - SAME) * float(((there / usual) ** 2).mean(1).sum()):
        return fit
    other = least_squares.fit(dataset, model, other.parameters, most=TRIAL, noise=noise, held=_earlier(model))
    return min(fit, other, key=lambda f: _cost(f, usual))


def _earlier(model):
    """Delays that a trial of the effect attached last does not look for again."""
    base = component_name(*model.attached[-1])
    return [n for n in delays(model) if not n.startswith(base + ".")]


def _none(variable):
    """Time or travel that changes nothing: none, or the least that is allowed."""
    return min(max(0.0, variable.min), variable.max)


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


def fit_to_all(finding, dataset, model, without, fit, noise):
    """Fit a chosen candidate to all samples, where bounds are reached that a trial does not reach.

    Parameters
    ----------
    finding : Finding
        Its fit and its coefficients are changed in place.
    dataset : Dataset
        Its fit part is fitted.
    model, without : Model
        With the candidate attached last, and without it.
    fit : Fit
        Of the model without it.
    noise : list of Noise
        What the score tests left after the columns that explain most, by channel.

    Returns
    -------
    bool
        Whether the interval of a size leaves out the value that changes nothing.
    """
    finding.fit = least_squares.fit(dataset, model, finding.fit.parameters)
    if holds_nothing(model, finding):  # something else may be missing too, which its noise then holds
        finding.fit = least_squares.fit(dataset, model, finding.fit.parameters,
                                        noise=_lesser(dataset, noise, finding.fit.noise))
    if holds_nothing(model, finding):
        finding.fit = told_from_nothing(dataset, model, finding, without, fit)
    finding.coefficients = _coefficients(model, finding.fit)
    return not holds_nothing(model, finding)


def _lesser(dataset, one, other):
    """The lesser of two estimates of the noise, channel by channel: by what it gives the mean of a long stretch."""
    step = _step(dataset)
    return [min(pair, key=lambda n: n.white ** 2 * step + 2 * n.slow ** 2 * n.memory) for pair in zip(one, other)]


def _coefficients(model, fit, attached=None):
    """An effect's coefficients with intervals, units and bounds that they are at, by default of the last attached."""
    base = component_name(*(attached or model.attached[-1]))
    return {n.split(".", 1)[1]: {"value": fit.parameters[n], "ci95": fit.interval(n), "unit": fit.variables[n].unit,
                                 "at_bound": fit.at_bound(n)} for n in fit.free if n.startswith(base + ".")}


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
    coefficients, base = _coefficients(model, finding.fit, attached), component_name(*(attached or model.attached[-1]))
    ends = [(coefficients[n]["ci95"], neutral) for n, neutral in finding.sizes.items()]
    apart = any(f"{base}.{n}" in finding.fit.apart for n in finding.sizes)
    return bool(ends) and not apart and all(low <= neutral <= high for (low, high), neutral in ends)


def pressed(model, fit, attached=None):
    """Whether a size of an effect has no best value inside what is allowed.

    Parameters
    ----------
    model : Model
        That was fitted.
    fit : Fit
        Of it.
    attached : (Effect, Place), optional
        One of the model's, the last by default.

    Returns
    -------
    bool
        The best is at a bound that is not where the effect changes nothing, and half of that size is ruled out. One
        that may as well be half as large is not known: a factor of a loss that is small itself.
    """
    effect, place = attached or model.attached[-1]
    names = [f"{component_name(effect, place)}.{c}" for c in effect.size]
    ends = {n: getattr(fit.variables[n], end) for n in names if n in fit.free and (end := fit.at_bound(n))}
    half = {n: (end + model.parameters[n].value) / 2 for n, end in ends.items() if end != model.parameters[n].value}
    return any(not low <= half[n] <= high for n in half for low, high in [fit.interval(n)])


def told_from_nothing(dataset, model, finding, smaller, without, attached=None):
    """The fit of an effect, with what the likelihood ratio rules out although an interval holds it.

    An interval takes the model as straight. A factor of a product, such as the growth of a loss that is small itself,
    or a drift whose time is longer than the log, is known to differ from nothing long before its size is known. Where
    the model is straight, both say the same. The interval of a delay is that of its likelihood, and says it itself.

    Parameters
    ----------
    dataset : Dataset
        Its fit part is fitted.
    model, smaller : Model
        With the effect, and without it.
    finding : Finding
        With the fit, and its sizes.
    without : Fit
        Of the model without it.
    attached : (Effect, Place), optional
        The finding's, the last of the model's by default.

    Returns
    -------
    Fit
    """
    base = component_name(*(attached or model.attached[-1]))
    if any(f"{base}.{n}" in finding.fit.profiles for n in finding.sizes):
        return finding.fit

    here = dataset.settled(model, finding.fit.parameters)
    if here is not dataset:  # what lies where a filter is not known lowers no noise that was found elsewhere
        without = least_squares.fit_without(here, smaller, without.parameters, noise=finding.fit.noise)

    def squares(m, f):
        problem = here.residuals(m, f.free, f.parameters, "fit")
        return sum((noise.whiten(r[None], problem.chain) ** 2).sum()
                   for noise, r in zip(finding.fit.noise, problem.residual(f.values)))

    fall = squares(smaller, without) - squares(model, finding.fit)
    if fall < PRESSED * len(finding.sizes):
        return finding.fit
    ruled_out = {f"{base}.{n}": neutral for n, neutral in finding.sizes.items()}
    return replace(finding.fit, apart=finding.fit.apart | ruled_out)

"""A study, its limits and what was measured already in; the next experiment, and the gain it predicts, out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ..compile import compile_model, component_name, find_effect, find_place, ranked
from ..compile.effects import annotation
from ..core.errors import ModelicaError, PlanError, closest
from ..diagnosis.decide import diagnose
from ..diagnosis.trials import nudged
from ..fit import least_squares
from ..fit.bounded import bounded
from .goals import GOALS, goal_named
from .information import Block, ChannelNoise, Node, StrokeInformation
from .motion import assemble, ordered
from .optimiser import DWELL, MEMORY, ROOM, TRAVEL, Asked, Design, Optimiser, asked, noise_of, prior_of
from .prediction import expected, predicted_fit, signals_of
from .workspace import Workspace, kinematics, limits_of

ASSUMED = 0.01  # noise over the range of a channel, where nothing was measured
NOTHING = "nothing"  # the rival of an effect that is to be seen at all
ALIKE = 0.1  # squares of the noise below which rivals are one and the same
SEPARATE = 10.8  # squares of the noise by which rivals must differ: the better one is the true one in 99.9 %
PATIENCE = 40.0  # s that the optimiser may take: a minute with all the rest, for an experiment of minutes


# --- from strokes to a motion ---------------------------------------------------------------------------------------


def fast(limits):
    """How fast the ways between strokes may be.

    Parameters
    ----------
    limits : Limits
        Of the motors; a margin is kept from them.

    Returns
    -------
    speed, acceleration : ndarray, shape (motors,)
        [rad/s], [rad/s2]
    """
    return ROOM * limits.speed, ROOM * limits.acceleration


def motion_of(design, workspace, budget, dwell, rate):
    """Whole cycles of every stroke within the budget, joined to one motion.

    Parameters
    ----------
    design : Design
        Strokes, and the seconds that each is to last.
    workspace : Workspace
        Its limits hold on the ways between strokes too.
    budget : float
        [s]
    dwell : float
        [s]
    rate : float
        Samples a second.

    Returns
    -------
    Motion

    Raises
    ------
    PlanError
        Two cycles of every stroke take longer than the budget.
    """
    period = np.array([2 * (s.travel + s.ramp + dwell) for s in design.strokes])
    cycles = np.maximum(2, np.round(design.seconds / period)).astype(int)

    most = fast(workspace.limits)
    order = ordered(design.strokes, *most)
    number = {s.name: k for k, s in enumerate(design.strokes)}

    def joined():
        strokes = [replace(s, cycles=int(cycles[number[s.name]])) for s in order]
        return assemble(strokes, *most, dwell, rate)

    ways = joined().duration + 1.0 / rate - float(cycles @ period)  # the same for any number of cycles
    while ways + cycles @ period > budget:
        over = np.flatnonzero(cycles > 2)
        if not len(over):
            raise PlanError(f"a budget of {budget:g} s is too short: two cycles in every zone at every speed take "
                            f"{ways + cycles @ period:.0f} s")
        cycles[over[np.argmax((cycles * period / design.seconds)[over])]] -= 1
    while (fits := np.flatnonzero(ways + cycles @ period + period <= budget)).size:
        cycles[fits[np.argmax((design.seconds / (cycles * period))[fits])]] += 1
    return joined()


# --- what is to be learnt -------------------------------------------------------------------------------------------


@dataclass
class Known:
    """What is known before the experiment.

    Attributes
    ----------
    study : Study
        With its limits.
    library : Library
        Which holds the rig and the effects.
    model : Model
        With the study's effects.
    dataset : Dataset or None
        Logs made by now.
    fit : Fit or None
        Of the model to these.
    asked : Asked
        What the planned log will compare.
    free : list of str
        Parameters to be learnt.
    values : dict of str to float
        Of every parameter, as far as it is known.
    prior : ndarray, shape (p, p)
        Inverse covariance of the free parameters.
    noise : list of ChannelNoise
        One a channel.
    workspace : Workspace
        Where the motors can go.
    assumed : bool
        Whether the noise is a guess.
    """

    study: object
    library: object
    model: object
    dataset: object
    fit: object
    asked: Asked
    free: list
    values: dict
    prior: np.ndarray
    noise: list
    workspace: Workspace
    assumed: bool


def known(study, library, model, dataset=None, fit=None):
    """Gather what is known of a rig before the next experiment.

    Parameters
    ----------
    study : Study
        With its limits; its values count where nothing was measured.
    library : Library
        Which holds the rig and the effects.
    model : Model
        With the study's effects.
    dataset : Dataset, optional
        What was measured already.
    fit : Fit, optional
        Of the model to it.

    Returns
    -------
    Known
    """
    kin = kinematics(model)
    workspace = Workspace(kin, limits_of(study, model, kin))
    info = asked(study, model, dataset)
    if fit is not None:
        return Known(study, library, model, dataset, fit, info, fit.free, fit.parameters, prior_of(fit),
                     noise_of(fit, info), workspace, False)
    variables = {n: study.parameters[n].applied(v) if n in study.parameters else v for n, v in model.parameters.items()}
    values = {n: v.value for n, v in variables.items()}
    free = [n for n, s in study.parameters.items() if s.fixed is False and n in model.parameters]
    found = Known(study, library, model, None, None, info, free, values, prior_of(None, free, variables), [],
                  workspace, True)
    found.noise = _assumed_noise(found)
    return found


def _assumed_noise(k):
    """A noise of one part in a hundred of what the channels range over, for a rig that nothing was measured of."""
    from .motion import Motion
    kin, corners = k.workspace.kinematics, k.workspace.vertices.T
    directions = [z.direction for z in k.workspace.zones]
    angle = np.hstack([corners] * len(directions))
    speed = np.repeat(np.array(directions).T, corners.shape[1], axis=1)
    motion = Motion(np.arange(angle.shape[1], dtype=float), angle, speed, 0 * speed, None)
    signals = signals_of(k.asked, kin, k.model, k.values, motion)
    ranges = [float(np.ptp(signals[c])) if c in signals else 1.0 for c in k.asked.outputs]
    return [ChannelNoise(ASSUMED * max(r, 1e-9), 0.4 * ASSUMED * max(r, 1e-9), MEMORY) for r in ranges]


def twins_of(k, pairs=None, progress=None):
    """Blocks that separate rivals: each in turn is the truth that the other bends to.

    Parameters
    ----------
    k : Known
        With a data set, which is diagnosed where no pairs are given.
    pairs : list of tuple, optional
        Pairs of (effect, place); those that the diagnosis cannot separate by default.
    progress : callable, optional
        Called with a sentence before each stage.

    Returns
    -------
    list of Block

    Raises
    ------
    PlanError
        There is no data to diagnose, or nothing to separate.
    """
    if k.dataset is None:
        raise PlanError(f"{k.study.path}: alternatives are found in data; give a log with --data, or "
                        "--goal parameters")
    found = diagnose(k.dataset, k.model, k.fit, k.study.seed, progress)
    if pairs is None:
        best = found.winner or found.contested
        pairs = [(best.key, (t["effect"], t["place"])) for t in best.twins] if best else []
    if not pairs:
        raise PlanError(f"{k.study.path}: the diagnosis of these data leaves no alternatives to separate; use "
                        "--goal parameters or --goal detect")
    findings = {f.key: f for f in found.candidates}
    fitted = {}
    for key in dict.fromkeys(key for pair in pairs for key in pair):
        if key not in findings:
            names = [f"{e}@{p}" for e, p in findings]
            raise PlanError(f"{'@'.join(key)} is no candidate on these data{closest('@'.join(key), names)}")
        larger = compile_model(k.library, k.study.rig, [*k.study.effects, key])
        start = nudged({**k.fit.parameters, **findings[key].start}, larger, findings[key])
        fitted[key] = larger, least_squares.fit(k.dataset, larger, start)
    return rivals(pairs, fitted)


def rivals(pairs, fitted):
    """Blocks of pairs of fitted rivals.

    Parameters
    ----------
    pairs : list of (key, key)
        Effects with their places.
    fitted : dict of key to (Model, Fit)
        Each of them, fitted to the same data.

    Returns
    -------
    list of Block
    """
    found = []
    for a, b in pairs:
        for true, other in ((a, b), (b, a)):
            (model, fit), (rival, rival_fit) = fitted[true], fitted[other]
            values = {**{n: v.value for n, v in rival.parameters.items()}, **rival_fit.parameters}
            machine = {**{n: v.value for n, v in model.parameters.items()}, **fit.parameters}
            low, high = (np.array([getattr(rival_fit.variables[n], end) for n in rival_fit.free])
                         for end in ("min", "max"))
            found.append(Block(rival, rival_fit.free, values, prior_of(rival_fit), (model, machine),
                               ("@".join(true), "@".join(other)),
                               room=(low - rival_fit.values, high - rival_fit.values)))
    return found


def hidden_of(k, wanted):
    """Blocks that make effects visible: each at the nominal size of its coefficients.

    Parameters
    ----------
    k : Known
        Its model is the one without the effects.
    wanted : list of (effect, place)
        To be seen.

    Returns
    -------
    list of Block
    """
    found = []
    for name, place in wanted:
        effect = find_effect(k.library, name)
        larger = compile_model(k.library, k.study.rig, [*k.study.effects, (name, place)])
        base = component_name(effect, find_place(k.library, k.study.rig, effect, place))
        values = {**{n: v.value for n, v in larger.parameters.items()}, **k.values}
        sized = dict(values)
        for c in dict.fromkeys((*effect.size, *effect.scan)):
            v = larger.parameters[f"{base}.{c}"]
            sized[v.name] = v.value + (v.nominal if v.value + v.nominal <= v.max else -v.nominal)
        found.append(Block(larger, k.free, values, k.prior, (larger, sized), (f"{name}@{place}", NOTHING)))
    return found


def foreseen(k, blocks):
    """Blocks whose machine tells in closed form which torques its motors need, and what is to be said of the others.

    Parameters
    ----------
    k : Known
        Whose rig is asked.
    blocks : list of Block
        Of single effects against nothing.

    Returns
    -------
    found : list of Block
    notes : list of str
        What shows the others, by the effect's own annotation.
    """
    node, found, left = Node(k.asked, k.workspace.kinematics), [], {}
    for block in blocks:
        try:
            node.torques(*block.other)
            found.append(block)
        except ModelicaError:
            effect, _, place = block.name[0].partition("@")
            left.setdefault(effect, []).append(place)
    return found, [f"{effect} at {', '.join(places)} is not planned for: which torques the motors would need with it "
                   "has no closed form, so no motion can be rated. What shows it: "
                   f"{annotation(k.library, find_effect(k.library, effect).model)['experiment']}."
                   for effect, places in left.items()]


def hidden_effects(k):
    """Effects that an experiment with motors alone could show, at single places.

    Parameters
    ----------
    k : Known
        Whose rig is asked; what its model has already is left out.

    Returns
    -------
    list of (str, str)
    """
    from ..compile import places
    from ..compile.contribution import effect_question
    found = []
    for effect in ranked(k.library):
        simple = not (effect.channel or effect.measured or effect_question(k.library, effect).states)
        simple = simple and not any(f"{c}.{effect.replaces}" in k.free for c in k.workspace.kinematics.segments)
        if simple and "cycles" not in effect.scan.values() and "time" not in effect.scan.values():
            found += [(effect.id, p.name) for p in places(k.library, k.study.rig, effect)
                      if len(p.components) == 1 and (effect.id, p.name) not in k.study.effects]
    return found


# --- the plan -------------------------------------------------------------------------------------------------------


@dataclass
class Plan:
    """The next experiment.

    Attributes
    ----------
    goal : str
        ``parameters``, ``alternatives`` or ``detect``.
    known : Known
        What it was made from.
    motion : Motion
        Sample by sample.
    design : Design
        Strokes as the optimiser left them, before whole cycles were made of them.
    blocks : list of Block
        What is to be learnt.
    fit : Fit
        That the identification should make of the new log alone.
    covariance : ndarray, shape (p, p)
        Of the parameters, old and new data together.
    torque : ndarray, shape (motors, n) or None
        Predicted [N.m].
    budget, rate : float
        Longest duration [s], and samples a second [Hz].
    """

    goal: str
    known: Known
    motion: object
    design: Design
    blocks: list
    fit: object
    covariance: np.ndarray
    torque: np.ndarray | None
    budget: float
    rate: float
    notes: list = field(default_factory=list)


def make_plan(k, goal="parameters", budget=120.0, rate=100.0, blocks=None, criterion="intervals", progress=None,
              patience=None):
    """Plan the next experiment.

    Parameters
    ----------
    k : Known
        Of `known`.
    goal : str
        ``parameters``, ``alternatives`` or ``detect``.
    budget : float
        Longest duration [s].
    rate : float
        Samples a second.
    blocks : list of Block, optional
        What is to be learnt; from the goal by default.
    criterion : str
        For parameters: ``D``, ``E``, or ``intervals``, their geometric mean.
    progress : callable, optional
        Called with a sentence before each stage.
    patience : float, optional
        Time for the optimiser [s]; `PATIENCE` by default.

    Returns
    -------
    Plan

    Raises
    ------
    PlanError
        The limits leave no experiment, or nothing can be learnt.
    """
    say, goal = progress or (lambda text: None), goal_named(goal)
    if goal not in GOALS:
        raise PlanError(f"no goal '{goal}'{closest(goal, GOALS)}; goals are {', '.join(GOALS)}")
    if not 0 < budget <= 1e5:
        raise PlanError(f"--budget {budget:g} s must be above zero, and not above 100000")
    if not 5 <= rate <= 1e5:
        raise PlanError(f"--rate {rate:g} Hz is outside 5 to 100000 Hz")
    notes = []
    if blocks is None:
        blocks = _blocks(k, goal, say, notes)
    say("setting the experiment up")
    info = StrokeInformation(k.asked, k.workspace.kinematics, blocks, (k.model, k.values), k.noise, DWELL, 1 / rate)
    for travel in TRAVEL:
        optimiser = Optimiser(k.workspace, info, blocks, budget, k.asked.w_min, DWELL, criterion, travel)
        design = optimiser.solve(np.random.default_rng(k.study.seed), patience or PATIENCE, say)
        try:
            motion = motion_of(design, k.workspace, budget, DWELL, rate)
            break
        except PlanError:
            if travel == TRAVEL[-1]:
                raise
    torque = _checked(k, motion)
    say("predicting the intervals")
    measured = [] if k.dataset is None else list(k.dataset.measured)
    log = expected(k.study, k.library, k.asked, k.workspace.kinematics, k.model, k.values, motion, measured)
    fit = predicted_fit(log, k.model, k.free, k.values, k.noise, "fit", k.study.seed)
    covariance = np.linalg.inv(k.prior + prior_of(fit)) if k.free else fit.covariance
    return Plan(goal, k, motion, design, blocks, fit, covariance, torque, budget, rate, notes)


def _blocks(k, goal, say, notes):
    if goal == "alternatives":
        return twins_of(k, None, say)
    if goal == "detect":
        found, told = foreseen(k, hidden_of(k, hidden_effects(k)))
        notes += told
        return found
    if not k.free:
        raise PlanError(f"{k.study.path}: no parameter is free, so there is nothing to learn; write fixed = false at "
                        "those to identify")
    return [Block(k.model, k.free, k.values, k.prior, rows=determined(k.fit) if k.fit is not None else None)]


def determined(fit):
    """Combinations of the parameters that a fit determines: each by itself, or what is left of a null direction.

    Parameters
    ----------
    fit : Fit
        Of what was measured by now.

    Returns
    -------
    ndarray, shape (k, p)
        Of parameters over their nominal values.
    """
    p, nominal = len(fit.free), np.array([fit.variables[n].nominal for n in fit.free])
    if not len(fit.null_directions):
        return np.eye(p)
    _, size, null = np.linalg.svd(fit.null_directions / nominal, full_matrices=False)
    null = null[size > 1e-9 * size[0]]
    open_ones = [not fit.identifiable(n) for n in fit.free]
    alone = np.eye(p)[np.invert(open_ones)]
    inside = np.eye(p)[open_ones]
    values, vectors = np.linalg.eigh(inside @ (np.eye(p) - null.T @ null) @ inside.T)
    return np.vstack([alone, vectors[:, values > 0.5].T @ inside])


def _checked(k, motion):
    """Torques of the finished motion; every limit is looked at once more, sample by sample.

    Raises
    ------
    PlanError
        With the limit that does not hold.
    """
    limits, kin = k.workspace.limits, k.workspace.kinematics
    signals = signals_of(k.asked, kin, k.model, k.values, motion)
    torque = np.array([signals[f"{m}.tau"] for m in kin.motors]) if f"{kin.motors[0]}.tau" in signals else None
    if k.workspace.margin(motion.angle).min() < 0:
        raise PlanError("the motion would meet a stop; the limits of the angles leave too little room")
    for what, values, bound, unit in (("w", motion.speed, limits.speed, "rad/s"),
                                      ("a", motion.acceleration, limits.acceleration, "rad/s2"),
                                      ("tau", torque, limits.torque, "N.m")):
        if values is None:
            continue
        over = np.abs(values).max(axis=1) - bound
        if over.max() > 1e-9 * bound.min():
            motor = kin.motors[int(np.argmax(over))]
            raise PlanError(f"the limit of '{motor}.{what}', {bound[int(np.argmax(over))]:g} {unit}, does not hold on "
                            f"the ways between strokes ({np.abs(values).max():.3g} {unit}); widen it, or tighten the "
                            "angles to where less is needed")
    return torque


def table(motors, motion):
    """A motion as a table: what a scenario's trajectory and a drive read.

    Parameters
    ----------
    motors : sequence of str
        Components, as ``motor1``, in the order of the motion's rows.
    motion : Motion
        Angles [rad] and speeds [rad/s] of these.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        ``time``, angle and speed of every motor by variable, and ``manoeuvre``.
    """
    found = {"time": motion.time}
    found.update({f"{m}.phi": motion.angle[k] for k, m in enumerate(motors)})
    found.update({f"{m}.w": motion.speed[k] for k, m in enumerate(motors)})
    return {**found, "manoeuvre": motion.label}


def separations(plan):
    """By how much rivals should differ after the experiment, and whether that names the right one.

    Parameters
    ----------
    plan : Plan
        Those of its blocks that have a rival.

    Returns
    -------
    list of dict
        ``true``, ``other``, ``difference`` (in standard deviations of the noise), ``share`` of the difference that the
        other cannot bend to, ``separable``, and the ``time`` that would separate them, as squares grow with it [s].
    """
    found = []
    for block, gram in zip(plan.blocks, plan.design.grams):
        if block.other is None:
            continue
        whole, free = gram[-1, -1], np.full(len(gram) - 1, np.inf)
        bent, _ = bounded(gram[:-1, :-1], gram[:-1, -1], *(block.room or (-free, free)))
        left = max(float(whole - bent), 0.0)
        true, other = block.name
        found.append({"true": true, "other": other, "difference": math.sqrt(left),
                      "share": math.sqrt(left / whole) if whole > 0 else 0.0, "separable": left > SEPARATE,
                      "time": plan.budget * SEPARATE / left if left > ALIKE else None})
    return found

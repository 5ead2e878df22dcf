"""A fit, a data set and a planned motion in; what is determined, how far, and what would determine the rest, out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..fit import least_squares
from ..fit.nullspace import null_directions
from .information import ChannelNoise
from .optimiser import Asked, asked
from .prediction import expected, predicted_fit

SQUARE = 3.84  # 95 % of a squared standard normal variable
POINTS = 9


def profile_likelihood(dataset, model, fit, name, points=POINTS, reach=3.0):
    """How much worse the best fit becomes when one parameter is held elsewhere.

    Parameters
    ----------
    dataset : Dataset
        To which everything else is fitted again at each point.
    model : Model
        The rig with its effects.
    fit : Fit
        Where the profile is lowest.
    name : str
        A free parameter.
    points : int
        Of the grid.
    reach : float
        Of the grid about the estimate, in half widths of the interval.

    Returns
    -------
    dict
        ``values`` in the parameter's unit; ``squares``, how many squared standard errors each is away, as the noise's
        correlation counts them; ``ci95``, where that stays below 3.84.

    References
    ----------
    .. [1] Raue, A. et al. (2009). Structural and practical identifiability analysis of partially observed dynamical
           models by exploiting the profile likelihood. Bioinformatics 25(15).
    """
    v, k = fit.variables[name], fit.free.index(name)
    low, high = fit.interval(name)
    half = max(high - low, 1e-6 * v.nominal) / 2
    grid = np.unique(np.clip(np.linspace(low - (reach - 1) * half, high + (reach - 1) * half, points), v.min, v.max))
    others = [n for n in fit.free if n != name]
    problem = dataset.residuals(model, fit.free, fit.parameters)
    gram = problem.gram(fit.values, fit.weights)
    naive = least_squares.invert(gram[:-1, :-1])[0][k, k]
    squares = []
    for value in grid:
        held = least_squares.fit(dataset, model, {**fit.parameters, name: float(value)}, others)
        at = np.array([held.parameters[n] for n in fit.free])
        squares.append(problem.gram(at, fit.weights)[-1, -1])
    scale = naive / fit.covariance[k, k] if fit.covariance[k, k] > 0 else 0.0
    squares = (np.array(squares) - min(*squares, gram[-1, -1])) * scale
    inside = np.interp(np.linspace(grid[0], grid[-1], 2001), grid, squares) <= SQUARE
    ends = np.linspace(grid[0], grid[-1], 2001)[inside]
    return {"values": grid.tolist(), "squares": squares.tolist(),
            "ci95": [float(ends.min()), float(ends.max())] if len(ends) else [float(low), float(high)]}


def channels_compared(plan):
    """The same motion with and without a torque reference: what each leaves undetermined, and its intervals.

    Parameters
    ----------
    plan : Plan
        Its motion is predicted twice.

    Returns
    -------
    dict
        By ``with_reference`` and ``without_reference``: ``stderr`` of every parameter (None where undetermined),
        ``null_directions`` in words. ``loss``: geometric mean of the intervals without over with, over what both
        determine. Empty where the rig has no motor torque to pair, or no model of its load to foresee a reference by.
    """
    k = plan.known
    outputs, inputs = k.model.alternatives("estimate")[0]
    if not any(n.endswith(".tau") for n in inputs) or not k.free or not k.model.notes.get("gravity_model"):
        return {}
    base = [n for n in k.free if n in k.model.parameters]
    found, errors = {}, {}
    for name, reference in (("with_reference", "sensor"), ("without_reference", "unknown")):
        info, noise = _as_if(k, reference, outputs)
        study = replace(k.study, reference=reference)
        log = expected(study, k.library, info, k.workspace.kinematics, k.model, k.values, plan.motion)
        fit = predicted_fit(log, k.model, [n for n in base if n not in log.zeros], k.values, noise)
        errors[name] = {n: float(fit.stderr[i]) if fit.identifiable(n) else None for i, n in enumerate(fit.free)}
        found[name] = {"stderr": errors[name], "null_directions": [d["text"] for d in null_directions(fit)]}
    both = [n for n in base if all(errors[e].get(n) for e in errors)]
    if both:
        ratio = [np.log(errors["without_reference"][n] / errors["with_reference"][n]) for n in both]
        found["loss"] = float(np.exp(np.mean(ratio)))
    return found


def _as_if(k, reference, outputs):
    """What would be compared, and its noise, with the torque reference or without."""
    paired = reference == "unknown"
    info = asked(replace(k.study, reference=reference), k.model)
    noise = [n for o, n in zip(k.asked.outputs, k.noise) if o in outputs]
    noise = noise if len(noise) == len(outputs) else [ChannelNoise(n.white, n.slow, n.memory) for n in k.noise][:len(
        outputs)]
    return Asked(info.outputs, info.known, paired, info.ask, info.channels, k.asked.w_min), noise


def identifiability(plan, profiles=True):
    """Section ``identifiability`` of ``plan.json``.

    Parameters
    ----------
    plan : Plan
        With what was known before it.
    profiles : bool
        With profile likelihoods of the parameters that earlier data put at a bound, or at none.

    Returns
    -------
    dict
        ``now``: null directions of the data so far, each with what would free it; ``planned``: those left after the
        experiment; ``channels``, as `channels_compared`; ``profiles``.
    """
    k = plan.known
    channels = channels_compared(plan)
    planned = [d["text"] for d in null_directions(plan.fit)]
    now = []
    if k.fit is not None:
        for d in null_directions(k.fit):
            now.append({"text": d["text"], "coefficients": d["coefficients"],
                        "freed_by": _freed_by(d["coefficients"], plan.fit, channels)})
    found = {"now": now, "planned": planned, "channels": channels, "profiles": {}}
    if profiles and k.fit is not None:
        for n in k.fit.free:
            if k.fit.identifiable(n) and k.fit.at_bound(n):
                found["profiles"][n] = profile_likelihood(k.dataset, k.model, k.fit, n)
    return found


def _freed_by(coefficients, planned, channels):
    """What would determine the parameters of a null direction."""
    found = []
    names = [n for n in coefficients if n in planned.free]
    if names and all(planned.identifiable(n) for n in names):
        found.append("the planned motion, with the channels measured so far")
    stderr = channels.get("with_reference", {}).get("stderr", {})
    if names and all(stderr.get(n) is not None for n in names):
        found.append("a reference of the joint torques")
    return found or ["nothing that was tried: motion of the motors, reference of the joint torques"]

"""In: a case and an effect that was named in it. Out: how much worse it explains unseen data than the truth does.

The oracle knows the machine, its motion, the condition and the candidates: it fits friction and coefficients by the
generator's own equations on every other stretch of the log, and compares what is left of the motors' torques on the
stretches between, in twice the log-likelihood of noise as large as the truth leaves. Below `score.SEPARABLE` nobody
could tell the two apart, and naming the one as an alternative of the other is right.
"""

from __future__ import annotations

from copy import copy

import numpy as np
from scipy.optimize import least_squares

from benchmarks.real_logs import cases, machines, sensors
from benchmarks.real_logs import effects as laws

STRETCH, MOST = 5.0, 4000
"""Seconds of each stretch; samples that count."""
DEFAULTS = {"stribeck": {"fs": 0.03, "ws": 0.3}, "presliding": {"travel": 0.02}, "time_delay": {"d": 0.01},
            "load_hysteresis": {"h": 0.1, "mu_dif": 0.02}, "thermal_drift": {"k": 0.5, "T": 30.0},
            "stribeck_asymmetry": {"fs_a": 0.02, "ws": 0.3}, "sublinear_viscous": {"b": 0.03, "a": 0.5},
            "joint_spring": {"k": 0.3, "q0": 0.0}, "configuration_preload": {"k_H": 0.02, "k_K": 0.02},
            "friction_lag": {"T": 0.02}, "dwell": {"fd": 0.05, "T": 0.3}}
OF_REFERENCE = {"reference_gain": 0.01, "reference_offset": 0.1, "reference_zero": 0.01, "reference_mass": 0.03,
                "reference_centre": 0.03, "payload": 0.05}


def gap(case, told, coefficients=None):
    """How much worse an effect explains unseen data than what is true.

    Parameters
    ----------
    case : Case
    told : (str, str)
        Effect and place.
    coefficients : dict of str to float, optional
        To start from.

    Returns
    -------
    float or None
        Twice the difference of the log-likelihoods on stretches that were not fitted, never below that of a tie; None
        for an effect that the generator does not know, as free functions of an angle.
    """
    found = cases.drawn(case)
    truth = found.truth()
    log = found.columns(truth)
    torque = np.array([log[c] for c in found.plant.columns["tau"]])
    odd = (truth.time // STRETCH).astype(int) % 2 == 1
    moving = np.flatnonzero(truth.moving(found.plant.least))
    moving = moving[::max(1, len(moving) // MOST)]
    fit, unseen = moving[odd[moving]], moving[~odd[moving]]
    own = _left(found, found.hidden, truth.C, torque, fit, unseen, True)
    alternative = _alternative(told, coefficients)
    if alternative is None:
        return None
    # named beside a hidden effect, it stands in for that one; with nothing hidden, for the condition itself
    beside = bool(found.hidden) and told[0] not in OF_REFERENCE
    seen = truth.C if beside else _seen(found, truth)
    other = _left(found, [alternative], seen, torque, fit, unseen, beside)
    return float(np.sum((other ** 2 - own ** 2) / np.mean(own ** 2, axis=1, keepdims=True)))


def _alternative(told, coefficients):
    name, place = told
    if name in OF_REFERENCE:
        return laws.Effect(name, place, {"size": OF_REFERENCE[name]})
    if name not in laws.AMPLITUDE or name in ("angle_friction", "angle_torque", "torque_ripple", *laws.ENCODER):
        return None
    first = laws.AMPLITUDE[name][0][0]
    known = DEFAULTS.get(name, {first: 0.02})
    given = {n: v for n, v in (coefficients or {}).items() if n in known and name != "torque_constant"}
    return laws.Effect(name, place, {**known, **given})


def _seen(found, truth):
    """The reference without its noise, wrong and filtered as the condition has it."""
    C, world = sensors.reference(found.plant, truth, found.motion, found.world), found.world
    dt = truth.time[1] - truth.time[0]
    return np.array([sensors.low_passed(x, world.low_pass["C"], dt) for x in C]) if "C" in world.low_pass else C


def _left(found, hidden, C, torque, fit, unseen, knows):
    """What a model leaves of the motors' torques on unseen samples, its friction and coefficients fitted.

    One that `knows` the condition filters its torques as the drives do.
    """
    plant, n = copy(found.plant), len(found.plant.segments)
    start = [*plant.f0.values(), *plant.mu.values(), *(v for e in hidden for v in e.values.values())]

    def residual(x, rows):
        plant.f0 = dict(zip(plant.segments, x[:n]))
        plant.mu = dict(zip(plant.segments, x[n:2 * n]))
        effects, rest = [], list(x[2 * n:])
        for e in hidden:
            effects.append(laws.Effect(e.id, e.place, {k: rest.pop(0) for k in e.values}))
        try:
            told = machines.simulate(plant, found.motion, [e for e in effects if e.id not in OF_REFERENCE],
                                     found.temperature, _corrected(plant, found, C, effects))
        except ValueError:  # a step so long that the loads do not converge
            return np.full((len(torque), len(rows)), 10.0)
        measured = told.measured
        if knows and "tau" in found.world.low_pass:
            dt = told.time[1] - told.time[0]
            measured = np.array([sensors.low_passed(x, found.world.low_pass["tau"], dt) for x in measured])
        return (measured - torque)[:, rows]

    scale = [*[0.02] * n, *[0.02] * n, *(max(abs(v), 1e-3) for e in hidden for v in e.values.values())]
    low = [*[0.0] * n, *[0.5] * n, *[-np.inf] * (len(start) - 2 * n)]
    high = [*[np.inf] * n, *[1.0] * n, *[np.inf] * (len(start) - 2 * n)]
    best = least_squares(lambda x: residual(x, fit).ravel(), start, x_scale=scale, bounds=(low, high), max_nfev=25)
    return residual(best.x, unseen)


def _corrected(plant, found, C, effects):
    """Torques of the joints where the reference is said to be wrong."""
    C = np.array(C)
    for e in (e for e in effects if e.id in OF_REFERENCE):
        size, q = e.values["size"], found.plant.lay(found.motion)[0]
        joints = [k for k, j in enumerate(plant.joints) if j in e.place.split("+")] or range(len(plant.joints))
        if e.id == "reference_gain":
            for k in joints:
                C[k] /= 1 + size
        elif e.id == "reference_offset":
            for k in joints:
                C[k] -= size
        elif e.id == "reference_zero":
            moved = [np.array(x) for x in q]
            for k in joints:
                moved[0][k] += size
            C += plant.torques(q) - plant.torques(moved)
        else:
            part = {"hip": "1", "thigh": "1"}.get(e.place, "2")
            key = {"reference_mass": "m", "reference_centre": "c"}.get(e.id, "m") + part
            C += plant.torques(q) - plant.torques(q, {key: plant.load[key] * (1 + size)})
    return C

"""In: a rig with its runs and sensors, and an effect. Out: how far the effect shows above noise, and one of a size."""

from __future__ import annotations

import numpy as np

from benchmarks.other_logs import effects as laws
from benchmarks.other_logs.machine import SEGMENTS, Segment, joint_angles, joint_torques
from benchmarks.other_logs.simulate import simulate

SAMPLES = 4000
"""About as many of a log are fitted."""
MOVING = 0.05
"""Speed of a segment below which its friction is not judged, rad/s."""
UNSEEN = 0.5
"""Ratio to the noise below which an effect counts as not there."""
BOUNDLESS = 50.0
"""Ratio where the refit fails."""
DRAWS, TURNS = 4, 6
"""Of an effect's place and coefficients, and of its strength for each."""


def ratio(case, effect):
    """What an effect leaves unexplained when friction is fitted anew, over noise.

    Parameters
    ----------
    case : make.Case
    effect : Effect

    Returns
    -------
    float
    """
    truths = [simulate(case.rig, run, [effect]) for run in case.runs]
    with np.errstate(all="ignore"):
        try:
            error = refitted_error(case, truths)
        except np.linalg.LinAlgError:
            return BOUNDLESS
    if not np.isfinite(error).all():
        return BOUNDLESS
    seen = error.max() / case.sensors.floor
    if case.sensors.joint_encoders and effect.id in laws.ELASTIC:
        seen = max(seen, _angle_error(case, truths) / case.sensors.angle_floor)
    return float(seen)


def refitted_error(case, truths):
    """Error of the reference, root mean square, with the friction that explains a log best and nothing hidden.

    Parameters
    ----------
    case : make.Case
    truths : list of Truth
        Of the case's runs.

    Returns
    -------
    ndarray, shape (2,)
        At hip and knee, N.m.
    """
    kept = _kept(case, truths)
    readings, said = (np.vstack([getattr(t, name)[rows] for t, rows in zip(truths, kept)])
                      for name in ("readings", "reference"))
    slides = {s: np.concatenate([t.direction[s][rows] for t, rows in zip(truths, kept)]) for s in SEGMENTS}

    def error(friction):
        segments = {s: Segment(slides[s], f0, mu) for s, f0, mu in zip(SEGMENTS, friction[:4], friction[4:])}
        return (joint_torques(segments, readings) - said).ravel()
    start = np.array([case.rig.friction[s] for s in SEGMENTS]).T.ravel()
    left = _least_squares(error, start, np.repeat([0.0, 0.5], 4), np.ones(8))
    return np.sqrt(np.mean(left.reshape(-1, 2) ** 2, axis=0))


def sized(case, name, rng):
    """An effect as far above noise as the case asks for, of places and coefficients drawn until one can be.

    Parameters
    ----------
    case : make.Case
    name : str
    rng : numpy.random.Generator

    Returns
    -------
    effect : Effect
    ratio : float
    """
    for _ in range(DRAWS):
        draft = laws.drawn(rng, case.top_speed, case.duration)[name]
        factor = 1.0
        for _ in range(TURNS):
            effect = draft.scaled(factor)
            seen = ratio(case, effect)
            if abs(seen - case.target) < 0.12 * case.target or (factor >= draft.most and seen < case.target):
                break
            factor = min(factor * np.clip(case.target / max(seen, 1e-3), 0.1, 6), draft.most)
        if seen > 0.7:
            break
    return effect, seen


def _kept(case, truths):
    """Samples of each run that are judged: some, where every segment moves."""
    kept = []
    for truth in truths:
        n = len(truth.theta)
        rows = np.arange(7, n, max(n // (SAMPLES // len(truths)), 1))
        kept.append(rows[np.all([abs(truth.w[s][rows]) > MOVING for s in SEGMENTS], axis=0)])
    return kept


def _angle_error(case, truths):
    """Largest spread, of runs and joints, of angles of the joints from those that the motors stand for."""
    return max(np.std((run.q - joint_angles(truth.theta))[rows], axis=0).max()
               for run, truth, rows in zip(case.runs, truths, _kept(case, truths)))


def _least_squares(error, start, low, high):
    """Smallest error within bounds, by damped Gauss-Newton steps."""
    x, left, damping = start, error(start), 1e-3
    for _ in range(12):
        slopes = np.array([(error(x + step) - left) / 1e-5 for step in 1e-5 * np.eye(len(x))]).T
        for _ in range(6):
            held = np.diag(np.sqrt(damping * (slopes ** 2).sum(0) + 1e-9))
            step = np.linalg.lstsq(np.vstack([slopes, held]), np.r_[-left, np.zeros(len(x))], rcond=None)[0]
            there = np.clip(x + step, low, high)
            then = error(there)
            if np.isfinite(then).all() and then @ then < left @ left:
                break
            damping *= 6
        else:
            return left
        better = 1 - (then @ then) / (left @ left + 1e-30)
        x, left, damping = there, then, max(damping / 10, 1e-6)
        if better < 1e-3:
            break
    return left

"""A motion and a model in; the log that it should give, and the intervals that a fit of that log should report, out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.signal import lfilter

from ..compile import ArrayFunction
from ..core.errors import StudyError
from ..data.dataset import Dataset
from ..data.logs import Log
from ..fit import least_squares
from .information import Node

DRAWS = 4  # of the noise, averaged


def signals_of(asked, kin, model, values, motion):
    """What would be measured, without noise.

    Parameters
    ----------
    asked : Asked
        What will be compared.
    kin : Kinematics
        Of the rig.
    model : Model
        The machine, as far as it is known.
    values : dict of str to float
        Of every parameter.
    motion : Motion
        Of the motors.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        Angles, speeds and torques of the motors, angles and reference torques of the joints, by variable.
    """
    node = Node(asked, kin)
    found = {**node.torques(model, values), **node.references(model, values)}
    n = len(motion.time)
    signs = np.sign(kin.speed @ motion.speed)
    signals = dict(zip(kin.joints, kin.angles(motion.angle)))
    for k, motor in enumerate(kin.motors):
        signals.update({f"{motor}.phi": motion.angle[k], f"{motor}.w": motion.speed[k]})
    if found:
        function = ArrayFunction(ca.Function("signals", node.arguments, [ca.densify(ca.vertcat(*found.values()))]))
        rows = function([*motion.angle, *motion.speed, *motion.acceleration, *signs], n)
        signals.update(zip(found, rows))
    return signals


def expected(study, library, asked, kin, model, values, motion, measured=()):
    """The log of a motion as a data set, without noise.

    Parameters
    ----------
    study : Study
        Whose columns and limits hold.
    library : Library
        Which holds the rig.
    asked : Asked
        What will be compared.
    kin : Kinematics
        Of the rig.
    model : Model
        The machine, as far as it is known.
    values : dict of str to float
        Of every parameter.
    motion : Motion
        Of the motors.
    measured : sequence of str
        Variables of earlier logs; what the model does not predict of them stays constant.

    Returns
    -------
    Dataset

    Raises
    ------
    StudyError
        The rig has no model of its load, whose torque the machine would be compared with.
    """
    signals = signals_of(asked, kin, model, values, motion)
    unknown = [n for n in asked.outputs if n not in signals and model.unit(n) in ("N.m", "N")]
    if unknown and not asked.paired and not model.notes.get("gravity_model"):
        raise StudyError(f"{study.path}: {model.rig} has no model of its load, so that a plan cannot foresee "
                         f"{', '.join(unknown)}; add one to the rig (gravity_model in its annotation, as in "
                         'DriveTrain.Rigs.GearedJoint), or plan with reference = "unknown"')
    wanted = set(asked.known) | set(measured) | (set() if asked.paired else set(asked.outputs))
    kept = {n: v for n, v in signals.items() if n in wanted}
    kept.update({n: np.zeros(len(motion.time)) for n in measured if n not in kept and n != "time"})
    log = Log("plan.csv", Path("plan.csv"), motion.time, kept, motion.label, columns={n: n for n in kept})
    return Dataset(replace(study, w_min=asked.w_min), library, [log])


def predicted_fit(dataset, model, free, values, noise, part="fit", seed=0):
    """The fit that the identification should make of an expected log.

    The derivatives are those at the expected log, the residual is noise drawn from its model, so that intervals come
    out as the identification estimates them, correlation and all.

    Parameters
    ----------
    dataset : Dataset
        Of `expected`.
    model : Model
        That will be fitted.
    free : list of str
        Parameters that will be fitted.
    values : dict of str to float
        Of every parameter; the fit comes out there.
    noise : list of ChannelNoise
        One a channel.
    part : str
        ``fit`` or ``all``.
    seed : int
        Of the noise that is drawn.

    Returns
    -------
    Fit
    """
    problem = dataset.residuals(model, free, values, part)
    x = np.array([values[n] for n in free])
    variables = dataset.parameters.variables(model)
    slope = np.concatenate([j for _, _, j in problem.blocks(x)], axis=2)
    white = np.array([n.white for n in noise])
    weights = np.exp(np.mean(np.log(white))) / white
    gram = np.zeros((len(free) + 1,) * 2)
    gram[:-1, :-1] = sum(w ** 2 * j @ j.T for w, j in zip(weights, slope))
    rng, covariances = np.random.default_rng(seed), []
    for _ in range(DRAWS):
        drawn = _fitted(drawn_noise(dataset, noise, part, rng), slope, gram[:-1, :-1], weights)
        fit = least_squares.result(problem, slope, drawn, gram, x, free, variables, weights, None)
        covariances.append(fit.covariance)
    fit.covariance = np.mean(covariances, axis=0)
    spread = np.mean([np.sqrt(np.diag(c)) for c in covariances], axis=0)  # of intervals, not of their squares
    share = spread / np.where(fit.stderr > 0, fit.stderr, 1.0)
    fit.covariance = fit.covariance * np.outer(share, share)
    return fit


def _fitted(residual, slope, normal, weights):
    """What a fit leaves of a residual."""
    pull = sum(w ** 2 * j @ r for w, j, r in zip(weights, slope, residual))
    step = least_squares.invert(normal)[0] @ pull
    return residual - np.einsum("cpn,p->cn", slope, step)


def drawn_noise(dataset, noise, part, rng):
    """Noise of the residual: of the samples, or of half the differences of pairs.

    Parameters
    ----------
    dataset : Dataset
        Its times and its pairs count.
    noise : list of ChannelNoise
        One a channel.
    part : str
        ``fit`` or ``all``.
    rng : numpy.random.Generator
        Draws it.

    Returns
    -------
    ndarray, shape (channels, n)
    """
    n, step = len(dataset.time), float(np.median(np.diff(dataset.time)))
    rows = []
    for channel in noise:
        kept = np.exp(-step / channel.memory)
        shocks = rng.standard_normal(n) * channel.slow
        shocks[1:] *= np.sqrt(1 - kept ** 2)
        rows.append(lfilter([1.0], [1.0, -kept], shocks) + channel.white * rng.standard_normal(n))
    rows = np.array(rows)
    return sum(weight * take(rows) for weight, _, take in dataset.picks(part))

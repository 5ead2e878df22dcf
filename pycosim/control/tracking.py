"""A machine, a model of it that its controller knows and a wanted motion in; what the loop makes of the motion, out.

Every motor has a controller of angle and speed, its torque (or voltage) worked out ahead from a model: from the
machine's own model, or from one that lacks something. What the loop then leaves as an error is what that lack costs.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.interpolate import PchipInterpolator

from ..core.errors import ModelicaError, StudyError
from ..dynamics.simulate import answer, dynamics
from ..dynamics.stepping import GAP, gap, in_parts

BANDWIDTH = 5.0
"""Hz, of the loop of angle and speed about the inertia that the model has: what a cable- or gear-driven joint of this
kind is given in the literature (3 to 10 Hz, below its first resonance); an error of a static torque goes with its
inverse square."""
DAMPING = 0.7  # of that loop, relative: the usual choice, hardly any overshoot
PERIOD = 1e-3  # s, from one sample of the controller to the next
SETTLING = 1.0  # s at the start that do not count: friction states begin at zero, whatever came before
_POSES = 50  # at which the inertia is asked for; it differs by pose, gains are of the mean
_CHUNK = 1000  # steps at a time


@dataclass(frozen=True)
class Tracked:
    """A motion as a loop followed it.

    Attributes
    ----------
    error : dict of str to ndarray, shape (n,)
        Wanted less actual angle [rad, or m on a linear axis] of each joint, or of each motor of a rig without joints.
    drive : dict of str to ndarray, shape (n,)
        What each motor was given: torque [N.m, or N], or voltage [V].
    ahead : dict of str to ndarray, shape (n,)
        Of that, what the controller's model worked out ahead.
    gains : dict of str to (float, float)
        Of the angle and of the speed, by motor, in the drive's unit a rad (a m), and a rad/s (a m/s).
    """

    error: dict
    drive: dict
    ahead: dict
    gains: dict


@dataclass(frozen=True)
class _Inverse:
    """The question of a rig that tells what its motors need for a motion."""

    name: str
    form: int
    motors: list
    drives: list


def wanted_motion(time, speeds):
    """A motion at the controller's samples from speeds in a log.

    Angles are integrals of the speeds from zero on, and accelerations their slopes, so that the three agree; noise of
    measured angles does not enter.

    Parameters
    ----------
    time : ndarray, shape (n,)
        [s]
    speeds : dict of str to (float, ndarray of shape (n,))
        Of each motor: its angle at the first sample, and its speed.

    Returns
    -------
    time : ndarray, shape (m,)
    motion : dict of str to ndarray, shape (m,)
        ``motor1.phi``, ``motor1.w``, ``motor1.a`` ..
    """
    at = np.arange(0.0, time[-1] - time[0], PERIOD)
    motion = {}
    for motor, (angle, speed) in speeds.items():
        curve = PchipInterpolator(time - time[0], speed)
        motion |= {f"{motor}.phi": angle + curve.antiderivative()(at), f"{motor}.w": curve(at),
                   f"{motor}.a": curve.derivative()(at)}
    return at, motion


def track(machine, values, known, known_values, time, motion):
    """Follow a motion with a controller of angle and speed, and a model that works the drive out ahead.

    Parameters
    ----------
    machine : Model
        What is moved.
    values : dict of str to float
        Its parameters; the model's own defaults for those that are not named.
    known : Model
        What the controller knows.
    known_values : dict of str to float
        Parameters of `known` in SI; its own defaults for those that are not named.
    time : ndarray, shape (n,)
        In steps of `PERIOD` [s].
    motion : dict of str to ndarray, shape (n,)
        Of `wanted_motion`.

    Returns
    -------
    Tracked

    Raises
    ------
    StudyError
        The rig's annotation does not tell what its motors need for a motion, or how they move it.
    ModelicaError
        The loop cannot be simulated: a joint without inertia, or a loop that is not stable.
    """
    inverse = _inverse(machine)
    ahead = _answered(known, inverse, motion, time, known_values)
    right = _answered(machine, inverse, motion, time, values)
    gains = _gains(machine, inverse, motion, values)
    d = dynamics(machine)
    p = np.array([float(values.get(n, v.value)) for n, v in machine.parameters.items()])
    reference = np.array([motion[f"{m}.{kind}"] for m in inverse.motors for kind in ("phi", "w")])
    forward = np.array([ahead[n] if n in inverse.drives else np.zeros(len(time)) for n in d.inputs])
    start = np.array([_start(d, right, motion, n) for n in d.states])
    shown = _shown(machine, inverse)
    walk = _closed(d, inverse, list(gains.values()), shown)
    drive, seen = _march(machine.rig, d, walk, start, forward, reference, p, time, len(shown))
    error = {n: {**right, **motion}[n] - row for n, row in zip(shown, seen)}
    return Tracked(error, {n: drive[d.inputs.index(n)] for n in inverse.drives},
                   {n: ahead[n] for n in inverse.drives}, gains)


# --- what the model knows ---------------------------------------------------------------------------------------------


def _inverse(model):
    """The question from whose answers the drives of a motion follow; what else it takes is zero: torques from outside.

    Raises
    ------
    StudyError
        There is none.
    """
    d, motors = dynamics(model), model.components("signal")
    for name in ("compensate", "gravity_model"):
        for form, (_, given) in enumerate(model.alternatives(name) if model.notes.get(name) else ()):
            outside = [n for n in given if n.rpartition(".")[0] not in motors or n.rpartition(".")[2] not in "phi w"]
            drives = [n for n in d.inputs if n not in given]
            if not set(outside) <= set(d.inputs) or len(outside) == len(given):
                continue
            if set(drives) <= set(model.question(name, form).outputs) and len(motors) <= len(drives):
                return _Inverse(name, form, motors, drives)
    raise StudyError(f"{model.rig}: its annotation says nowhere which torques of its motors a motion alone needs; "
                     "a gravity_model or a compensate of the motors' angles, and of torques from outside, would")


def _answered(model, inverse, motion, time, values):
    """Every variable of a model along a motion."""
    question = model.question(inverse.name, inverse.form)
    signals = {}
    for m in inverse.motors:
        phi, w, a = (motion[f"{m}.{kind}"] for kind in ("phi", "w", "a"))
        signals |= {f"{m}.phi": phi, f"{m}.w": w, f"der({m}.phi)": w, f"der({m}.w)": a, f"der(der({m}.phi))": a}
    signals = {n: signals.get(n, 0.0) for n in question.inputs if n != "time"}
    strange = [n for n in signals if n in model.log_inputs]
    if strange:
        raise StudyError(f"{model.rig}: its effects take {', '.join(strange)} from a log, and a simulation has no log")
    known = {n: values[n] for n in model.parameters if n in values}
    return answer(model, inverse.name, signals, time, known, inverse.form)


def _gains(model, inverse, motion, values):
    """Gains of angle and speed of each motor, for `BANDWIDTH` and `DAMPING` about its mean inertia."""
    every = max(1, len(motion[f"{inverse.motors[0]}.phi"]) // _POSES)
    still = {n: v[::every] if n.endswith(".phi") else np.zeros(len(v[::every])) for n, v in motion.items()}
    time = np.arange(float(len(still[f"{inverse.motors[0]}.phi"])))
    rest, found, around = _answered(model, inverse, still, time, values), {}, 2 * np.pi * BANDWIDTH
    for k, m in enumerate(inverse.motors):
        moved = _answered(model, inverse, {**still, f"{m}.a": np.ones(len(time))}, time, values)
        inertia = float(np.mean(moved[inverse.drives[k]] - rest[inverse.drives[k]]))
        if not inertia > 0:
            raise StudyError(f"{model.rig}: {inverse.drives[k]} does not accelerate {m}, so no gain follows for it; "
                             "give it an inertia")
        found[m] = inertia * around ** 2, 2 * DAMPING * around * inertia
    return found


def _start(d, answers, motion, state):
    """Value of a state at the first sample of the motion; friction states begin at zero."""
    for name, carried in d.start.items():
        known = motion.get(name, answers.get(name))
        if carried == state and known is not None:
            return float(np.ravel(known)[0])
    return 0.0


def _shown(model, inverse):
    """Angles whose error counts: the joints' where the rig has some."""
    d, angle = dynamics(model), model.along("rad")
    asked = [n for n in model.alternatives("simulate")[0][0] if n in model.variables and n in [*d.states, *d.outputs]]
    joints = [n for n in asked if model.variables[n].unit == angle and n.rpartition(".")[0] not in inverse.motors]
    return joints or [f"{m}.phi" for m in inverse.motors]


# --- the loop ---------------------------------------------------------------------------------------------------------


def _closed(d, inverse, gains, shown):
    """``(x, z, f, r, q, p, t) -> x, z, u, shown, error``: one sample of controller and machine."""
    x, z, f, p, t = (ca.SX.sym(n, d.output.size1_in(k)) for k, n in enumerate(["x", "z", "f", "p", "t"]))
    known = dict(zip([*d.inputs, *d.states, *d.algebraic, *d.outputs], ca.vertsplit(ca.vertcat(f, x, z, d.output(
        x, z, f, p, t)))))
    r, u = ca.SX.sym("r", 2 * len(inverse.motors)), ca.vertsplit(f)
    for k, (m, (of_angle, of_speed)) in enumerate(zip(inverse.motors, gains)):
        at = d.inputs.index(inverse.drives[k])
        u[at] += of_angle * (r[2 * k] - known[f"{m}.phi"]) + of_speed * (r[2 * k + 1] - known[f"{m}.w"])
    control = ca.Function("control", [x, z, f, r, p, t], [ca.vertcat(*u), ca.vertcat(*[known[n] for n in shown])])
    x, z, f, r, q, p, t = (ca.MX.sym(n, k) for n, k in zip("xzfrqpt", (
        x.numel(), z.numel(), f.numel(), r.numel(), d.step.size1_in("q"), p.numel(), 1)))
    u, y = control(x, z, f, r, p, t)
    x1, z1, error = d.step(x, z, u, u, q, t, PERIOD)
    return ca.Function("sample", [x, z, f, r, q, p, t], [x1, z1, u, y, error])


def _march(rig, d, sample, x, forward, reference, p, time, n_shown):
    """What the motors were given, and the angles, at every sample; steps that fail are made in parts."""
    n, q, a = len(time), np.array(d.prepare(p)).ravel(), 0
    drive, seen = np.empty((len(d.inputs), n)), np.empty((n_shown, n))
    z = np.array(d.initial(x, np.zeros(len(d.algebraic)), forward[:, 0], q, time[0])).ravel()
    walk = sample.mapaccum("walk", _CHUNK, 2)
    while a < n:
        b, pad = min(a + _CHUNK, n), max(0, a + _CHUNK - n)
        given = [np.pad(v[:, a:b], ((0, 0), (0, pad)), "edge") for v in (forward, reference, time[None])]
        columns = [np.repeat(v[:, None], _CHUNK, 1) for v in (q, p)]
        xs, zs, us, ys, errors = (np.array(v) for v in walk(x, z, *given[:2], *columns, given[2]))
        before = np.column_stack([x, xs[:, :-1]])
        fine = (errors[0] <= 1) & (gap(before, xs, PERIOD, d.speeds) <= GAP)
        good = b - a if fine[:b - a].all() else int(np.argmin(fine))
        end = min(good + 1, b - a)  # what was given in the step that failed is known as well
        drive[:, a:a + end], seen[:, a:a + end] = us[:, :end], ys[:, :end]
        if good:
            x, z = xs[:, good - 1], zs[:, good - 1]
        if good < b - a:
            found = in_parts(d, x, z, drive[:, a + good], drive[:, a + good], q, time[a + good], PERIOD)
            if not found or not np.isfinite(found[0]).all():
                raise ModelicaError(f"{rig}: the simulated loop has no solution at t = {time[a + good]:g} s")
            x, z = found
        a += end
    return drive, seen

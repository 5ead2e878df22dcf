"""The name of a motion, or a file that holds one, in; angles, speeds and accelerations of motors and joints out.

Motions: the six manoeuvres along lines of the motor angles, a gait-like cycle, holding a posture under a load, moving
to and fro. Those of the joints become motions of the motors by the model's own kinematics.
"""

from __future__ import annotations

import inspect
import math
from dataclasses import dataclass, field
from numbers import Integral, Real

import casadi as ca
import numpy as np

from ..compile import ArrayFunction
from ..core.errors import DataError, StudyError, UnknownNameError, closest
from ..dynamics.simulate import dynamics

__all__ = ["TRAJECTORIES", "Trajectory", "backdrive", "from_file", "gait", "hold", "manoeuvre_motion", "six_manoeuvres"]

LINES = {"A": (1.0, -1.0), "C": (1.0, 0.5), "E": (0.5, 1.0)}  # directions in (theta1, theta2); back: B, D, F
BACK = {"A": "B", "C": "D", "E": "F"}
START = 0.76, 26.5  # motor angles where all lines begin [rad]
TRAVEL = 12.8       # of the faster motor along a line [rad]
DWELL, ACCELERATION = 0.4, 8.0  # s, rad/s2


@dataclass
class Trajectory:
    """A motion at equal times from zero on.

    Attributes
    ----------
    time : ndarray, shape (n,)
        [s]
    columns : dict of str to ndarray, shape (n,)
        ``ref.motor1.phi``, ``ref.motor1.w``, ``ref.motor1.a`` .., ``ref.q_H`` .., and torques from outside.
    label : ndarray of int, shape (n,)
        Manoeuvre of each sample, an index into ``labels``.
    labels : list of str
        What the numbers in ``label`` mean.
    """

    time: np.ndarray
    columns: dict
    label: np.ndarray = None
    labels: list = field(default_factory=list)

    def __post_init__(self):
        if self.label is None:
            self.label, self.labels = np.zeros(len(self.time), int), [""]


# --- kinematics of a rig ---------------------------------------------------------------------------------------------


class _Kinematics:
    """Motor angles of joint angles, and back, as the model has them."""

    def __init__(self, model, values):
        self.model, d = model, dynamics(model)
        self.motors = [f"{m}.phi" for m in model.components("signal")]
        names = [n for n in model.alternatives("simulate")[0][0] if model.variables[n].unit == "rad"]
        self.joints = [n for n in names if n not in self.motors]
        states, others = self.joints, self.motors
        if not all(n in d.start for n in states):  # as of a rig whose motor has the inertia that counts
            states, others = others, states
        if not self.motors or not all(n in d.start for n in states):
            raise StudyError(f"{model.rig}: no joint angles among its states, so no motion of joints can be followed")
        slope, zero = self._lines(d, states, others, values)
        self.slope, self.zero = (slope, zero) if others is self.motors else (
            np.linalg.inv(slope), -np.linalg.solve(slope, zero))

    def _lines(self, d, states, others, values):
        """The other angles over those that are states: slopes, and values at zero."""
        x, q = ca.SX(len(d.states), 1), ca.SX.sym("q", len(states))
        for k, n in enumerate(states):
            x[d.states.index(d.start[n])] = q[k]
        p = ca.DM([values[n] for n in d.parameters])
        y = d.output(x, ca.DM(len(d.algebraic), 1), ca.DM(len(d.inputs), 1), p, 0)
        found = ca.vertcat(*[y[d.outputs.index(n)] if n in d.outputs else x[d.states.index(n)] for n in others])
        slope, zero = ca.jacobian(found, q), ca.substitute(found, q, ca.DM.zeros(len(states)))
        if slope.size1() != slope.size2() or ca.symvar(slope):
            raise StudyError(f"{self.model.rig}: its motors do not determine its joints one to one")
        return ca.DM(slope).full(), ca.DM(zero).full()[:, 0]

    def from_joints(self, q, v, a):
        """Columns of a motion of the joints, arrays of shape (joints, n)."""
        return self._columns(self.slope @ q + self.zero[:, None], self.slope @ v, self.slope @ a, q)

    def from_motors(self, phi, w, a):
        """Columns of a motion of the motors, arrays of shape (motors, n)."""
        return self._columns(phi, w, a, np.linalg.solve(self.slope, phi - self.zero[:, None]))

    def _columns(self, phi, w, a, q):
        found = {}
        for k, n in enumerate(self.motors):
            found.update({f"ref.{n}": phi[k], f"ref.{n[:-4]}.w": w[k], f"ref.{n[:-4]}.a": a[k]})
        return {**found, **{f"ref.{n}": q[k] for k, n in enumerate(self.joints)}}

    def pair(self, given, what):
        """One number a joint, from one number or a list."""
        given = np.atleast_1d(np.asarray(given, float))
        if given.ndim != 1 or len(given) not in (1, len(self.joints)):
            raise DataError(f"{what} has {given.size} values, {self.model.rig} has the joints {', '.join(self.joints)}")
        return np.broadcast_to(given, len(self.joints))

    def outside(self):
        """Inputs of the rig that are not motors': torques from outside, one a joint."""
        motors = {f"{m}.tau" for m in self.model.components("signal")}
        known = [n for n in self.model.alternatives("simulate")[0][1] if n != "time" and n not in motors]
        return known[-len(self.joints):]


# --- motions ---------------------------------------------------------------------------------------------------------


def manoeuvre_motion(rng, rate, speeds, repeats, longest):
    """Motor angles and speeds of the six manoeuvres, blocks of them in random order.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws the order of the blocks.
    rate : float
        Samples a second.
    speeds : sequence of float
        Of the faster motor [rad/s].
    repeats : int
        Times that each line is passed, out and back, at each speed.
    longest : float
        Slow passes turn back after this time [s].

    Returns
    -------
    time : ndarray, shape (n,)
        [s]
    angle, speed : ndarray, shape (2, n)
        [rad], [rad/s]
    label : ndarray of str, shape (n,)
        ``A`` to ``F``, or ``rest``.
    """
    rest = np.zeros((2, round(DWELL * rate)))
    speed, label = [rest], ["rest"] * rest.shape[1]
    for k in rng.permutation(np.repeat(np.arange(len(speeds)), repeats)):
        for line, direction in LINES.items():
            pulse = _pulse(speeds[k], longest, rate)
            for name, sign in ((line, 1.0), (BACK[line], -1.0)):
                speed += [sign * np.outer(direction, pulse), rest]
                label += [name] * len(pulse) + ["rest"] * rest.shape[1]
    speed = np.hstack(speed)
    step = (speed[:, 1:] + speed[:, :-1]) / 2 / rate
    angle = np.array(START)[:, None] + np.hstack([np.zeros((2, 1)), np.cumsum(step, axis=1)])
    return np.arange(speed.shape[1]) / rate, angle, speed, np.array(label)


def _pulse(speed, longest, rate):
    """Speed over a pass: up in a raised cosine, constant, down."""
    ramp = max(np.pi / 2 * speed / ACCELERATION, 0.1)
    up = speed * (1 - np.cos(np.pi * np.arange(round(ramp * rate)) / round(ramp * rate))) / 2
    return np.r_[up, np.full(round(min(TRAVEL / speed, longest) * rate), speed), up[::-1]]


def six_manoeuvres(model, values, rate, duration=None, speeds=(0.2, 0.4, 0.8, 1.6, 2.4), repeats=2, longest=3.5,
                   seed=2):
    """The six manoeuvres out and back, at several speeds of the faster motor [rad/s], in random order.

    Parameters
    ----------
    model : Model
        A rig with two motors.
    values : dict of str to float
        Its parameters.
    rate : float
        Samples a second.
    duration : float, optional
        [s]; not used, the motion ends by itself.
    speeds, repeats, longest, seed
        As in `manoeuvre_motion`.

    Returns
    -------
    Trajectory
    """
    kinematics = _Kinematics(model, values)
    if len(kinematics.motors) != 2:
        raise StudyError(f"{model.rig} has {len(kinematics.motors)} motor; the six manoeuvres are for two")
    time, angle, speed, label = manoeuvre_motion(np.random.default_rng(seed), rate, speeds, repeats, longest)
    columns = kinematics.from_motors(angle, speed, np.gradient(speed, time, axis=1))
    labels, numbers = np.unique(label, return_inverse=True)
    return Trajectory(time, columns, numbers, labels.tolist())


def gait(model, values, rate, duration=10.0, cycle=1.6, load=30.0, start=2.0):
    """A gait-like cycle of hip and knee, with torques from outside on both in stance.

    Parameters
    ----------
    model, values, rate
        As in `six_manoeuvres`; a rig with two joints.
    duration : float
        [s]
    cycle : float
        Time of a stride [s].
    load : float
        Largest torque from outside on the hip [N.m]; 0.7 of it on the knee.
    start : float
        The motion grows over this time [s].

    Returns
    -------
    Trajectory
        Labelled ``stance`` for the first 60 % of a stride, then ``swing``.
    """
    kinematics = _Kinematics(model, values)
    if len(kinematics.joints) != 2:
        raise StudyError(f"{model.rig} has the joints {', '.join(kinematics.joints)}; a gait is for hip and knee")
    _above_zero(cycle=cycle, start=start)
    time = _times(duration, rate)
    t, tau = ca.SX.sym("t"), 2 * np.pi
    part = t / cycle
    hip = 12 + 22 * ca.cos(tau * (part - 0.93)) + 3 * ca.cos(2 * tau * (part - 0.85))
    flexion = 26 + 21 * ca.cos(tau * (part - 0.75)) + 14 * ca.cos(2 * tau * (part - 0.70))
    s = ca.fmin(1, t / start)
    grow = s ** 3 * (10 - 15 * s + 6 * s ** 2)
    q = ca.vertcat(hip, -flexion) * np.pi / 180
    rest = ca.vertcat(12, -26) * np.pi / 180
    columns = kinematics.from_joints(*_derived(rest + grow * (q - rest), t, time))
    phase = (time / cycle) % 1.0
    stance = np.sin(np.pi * np.clip(phase / 0.6, 0, 1))
    ramp = np.array(ca.Function("ramp", [t], [grow])(time[None])).ravel()
    for name, size, shape in zip(kinematics.outside(), (load, 0.7 * load), (np.cos(np.pi * phase / 0.6), 1.0)):
        columns[name] = -size * ramp * stance * shape
    return Trajectory(time, columns, (phase >= 0.6).astype(int), ["stance", "swing"])


def hold(model, values, rate, duration=10.0, posture=(0.5,), load=(0.0,), ramp=1.0):
    """Hold a posture while torques from outside grow, stay, and go again.

    Parameters
    ----------
    model, values, rate
        As in `six_manoeuvres`.
    duration : float
        [s]
    posture : float or sequence of float
        Joint angles [rad].
    load : float or sequence of float
        Torques from outside [N.m].
    ramp : float
        Time over which the load comes and goes [s].

    Returns
    -------
    Trajectory
        Labelled ``rest``.
    """
    kinematics = _Kinematics(model, values)
    _above_zero(ramp=ramp)
    time = _times(duration, rate)
    q = np.outer(kinematics.pair(posture, "posture"), np.ones(len(time)))
    columns = kinematics.from_joints(q, 0 * q, 0 * q)
    shape = np.clip((time - 0.25 * duration) / ramp, 0, 1) - np.clip((time - 0.75 * duration) / ramp, 0, 1)
    for name, size in zip(kinematics.outside(), kinematics.pair(load, "load")):
        columns[name] = size * shape * shape * (3 - 2 * shape)
    return Trajectory(time, columns, np.zeros(len(time), int), ["rest"])


def backdrive(model, values, rate, duration=10.0, posture=(0.5,), amplitude=(0.3,), cycle=(4.0,)):
    """Move the joints to and fro about a posture, each with its own period.

    Parameters
    ----------
    model, values, rate
        As in `six_manoeuvres`.
    duration : float
        [s]
    posture, amplitude : float or sequence of float
        Of the joints [rad].
    cycle : float or sequence of float
        [s]

    Returns
    -------
    Trajectory
    """
    kinematics = _Kinematics(model, values)
    time = _times(duration, rate)
    posture, amplitude, cycle = (kinematics.pair(v, n) for v, n in ((posture, "posture"), (amplitude, "amplitude"),
                                                                    (cycle, "cycle")))
    _above_zero(cycle=cycle.min())
    t = ca.SX.sym("t")
    s = ca.fmin(1, t)  # the motion grows within a second
    grow = s ** 3 * (10 - 15 * s + 6 * s ** 2)
    q = ca.vertcat(*[p + a * grow * ca.sin(2 * np.pi * t / c) for p, a, c in zip(posture, amplitude, cycle)])
    return Trajectory(time, kinematics.from_joints(*_derived(q, t, time)))


def from_file(path, model, values, rate):
    """A motion from a CSV file: ``time``, all motor angles or all joint angles, torques from outside, ``manoeuvre``.

    Parameters
    ----------
    path : path
        CSV in SI units, ``time`` strictly increasing.
    model, values, rate
        As in `six_manoeuvres`.

    Returns
    -------
    Trajectory
        Angles are followed along cubic splines, everything else along straight lines.

    Raises
    ------
    DataError
        The file cannot be read, or holds neither all motor angles nor all joint angles.
    """
    import pandas as pd
    from scipy.interpolate import CubicSpline
    kinematics = _Kinematics(model, values)
    try:
        table = pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read as a motion ({str(error).splitlines()[0]})") from None
    known = [k for k in (kinematics.joints, kinematics.motors) if set(k) <= set(table.columns)]
    if "time" not in table or not known or len(table) < 4:
        raise DataError(f"{path}: a motion needs four rows, 'time', and {', '.join(kinematics.joints)} or "
                        f"{', '.join(kinematics.motors)}; it has {len(table)} rows of {', '.join(table.columns)}")
    numbers = [n for n in ("time", *known[0], *kinematics.outside()) if n in table]
    wrong = next((n for n in numbers if not pd.api.types.is_numeric_dtype(table[n]) or table[n].isna().any()), None)
    if wrong:
        raise DataError(f"{path}: column '{wrong}' holds what is not a number")
    given = table["time"].to_numpy(float)
    if not (np.diff(given) > 0).all():
        raise DataError(f"{path}: time does not increase at row {int(np.argmin(np.diff(given) > 0)) + 3}")
    time = _times(given[-1] - given[0], rate)
    at = np.minimum(given[0] + time, given[-1])
    spline = CubicSpline(given, table[known[0]].to_numpy(float).T, axis=1)
    motion = [spline(at, order) for order in range(3)]
    columns = (kinematics.from_joints if known[0] is kinematics.joints else kinematics.from_motors)(*motion)
    columns.update({n: np.interp(at, given, table[n]) for n in kinematics.outside() if n in table})
    if "manoeuvre" not in table:
        return Trajectory(time, columns)
    labels, numbers = np.unique(table["manoeuvre"].astype(str), return_inverse=True)
    return Trajectory(time, columns, numbers[np.searchsorted(given, at, side="right") - 1], labels.tolist())


TRAJECTORIES = {"six_manoeuvres": six_manoeuvres, "gait": gait, "hold": hold, "backdrive": backdrive}


def make(kind, model, values, rate, duration=None, **options):
    """A motion by its name.

    Parameters
    ----------
    kind : str
        A key of ``TRAJECTORIES``.
    model : Model
        Whose motors move, and whose joints follow them.
    values : dict of str to float
        Parameters of the model.
    rate : float
        Samples a second [1/s].
    duration : float, optional
        [s]; the motion's own by default.
    **options
        Of the motion's own function.

    Returns
    -------
    Trajectory

    Raises
    ------
    UnknownNameError
        No such motion, or it has no such option.
    DataError
        An option has a value that does not fit.
    """
    if kind not in TRAJECTORIES:
        raise UnknownNameError(f"no trajectory '{kind}'{closest(kind, TRAJECTORIES)}")
    known = dict(list(inspect.signature(TRAJECTORIES[kind]).parameters.items())[4:])
    for name, value in options.items():
        if name not in known:
            raise UnknownNameError(f"the trajectory '{kind}' has no option '{name}'{closest(name, known)}")
        default = known[name].default
        several, whole = isinstance(default, tuple), isinstance(default, int)
        each = value if isinstance(value, (list, tuple)) else [value]
        right = [isinstance(v, Integral if whole else Real) and not isinstance(v, bool) and math.isfinite(v)
                 for v in each]
        if not right or not all(right) or (each is value and not several):
            what = "a number or a list of numbers" if several else "a whole number" if whole else "a number"
            raise DataError(f"the trajectory '{kind}': '{name}' must be {what}, not {value!r}")
        options[name] = each if several else value
    if duration is not None:
        options["duration"] = duration
    return TRAJECTORIES[kind](model, values, rate, **options)


def _derived(q, t, time):
    """A motion over time with its two derivatives, arrays of shape (joints, n)."""
    v = ca.jacobian(q, t)
    motion = ca.Function("motion", [t], [ca.densify(ca.vertcat(q, v, ca.jacobian(v, t)))])
    found = ArrayFunction(motion)([time], len(time))
    return found.reshape(3, q.numel(), -1)


def _times(duration, rate):
    _above_zero(duration=duration)
    return np.arange(int(np.floor(duration * rate + 1e-9)) + 1) / rate


def _above_zero(**given):
    for name, value in given.items():
        if not 0 < value < 1e7:
            raise DataError(f"{name} = {value:g} s must be above zero")

"""A rig and its limits in; where its motors can go, its operative zones, and its torque and speed domains, out.

Everything follows from the linear kinematics that the compiled model has: joint angles and segment speeds as functions
of the motors. It holds for any number of motors, joints and segments.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from ..compile.model import der
from ..core.errors import PlanError, StudyError, UnknownNameError, closest

__all__ = ["Kinematics", "Limits", "Workspace", "Zone", "kinematics", "limits_of", "read_limits"]

_RATES = {"w": "rad/s", "a": "rad/s2", "tau": "N.m"}  # limits of a motor beside those of its angle
_TERM = re.compile(r"\s*([+-]?)\s*(?:([0-9.eE]+)\s*\*\s*)?([A-Za-z_][\w.]*)\s*")
_EQUAL = 1e-9


@dataclass(frozen=True)
class Kinematics:
    """Joint angles and segment speeds as linear functions of the motors.

    Attributes
    ----------
    motors, joints, segments : list of str
        Components, variables, components.
    joint : ndarray, shape (joints, motors)
        Joint angles a unit of motor angle [1].
    zero : ndarray, shape (joints,)
        Joint angles at motor angles zero [rad].
    speed : ndarray, shape (segments, motors)
        Speed of each segment relative to its support, a unit of motor speed [1].
    places : dict of str to str
        What each segment is called: component to place.
    """

    motors: list
    joints: list
    segments: list
    joint: np.ndarray
    zero: np.ndarray
    speed: np.ndarray
    places: dict

    def angles(self, motors):
        """Joint angles of motor angles.

        Parameters
        ----------
        motors : ndarray, shape (motors, ..)
            [rad]

        Returns
        -------
        ndarray, shape (joints, ..)
            [rad]
        """
        shift = self.zero.reshape(-1, *[1] * (np.ndim(motors) - 1))
        return np.tensordot(self.joint, motors, 1) + shift


def kinematics(model, values=None):
    """Kinematics of a rig, from its compiled model.

    Parameters
    ----------
    model : Model
        Effects do not change it.
    values : dict of str to float, optional
        Parameters; the model's by default.

    Returns
    -------
    Kinematics

    Raises
    ------
    StudyError
        The rig does not say how to compute anything from motor angles, or angles and speeds are not linear in them.
    """
    known = model.alternatives("estimate")[0][1]
    motors = [n.removesuffix(".phi") for n in known if n.endswith(".phi")]
    if not motors:
        raise StudyError(f"{model.rig}: its estimate starts from no motor angle, so it has no workspace")
    question = model.question("estimate")
    given = {**{n: v.value for n, v in model.parameters.items()}, **(values or {})}
    encoders = {v.partition(":")[0] for v in model.aliases("encoders").values()}
    joints = [n for n in question.outputs if "." not in n and n not in encoders
              and model.variables[n].unit == "rad"]
    segments = list(model.segments)
    u, x, p = question.symbols()
    rows = question.select([*joints, *[f"{c}.w" for c in segments]]).output(u, x, p)
    at = [question.inputs.index(n) for m in motors for n in (f"{m}.phi", der(f"{m}.phi"))]
    slope = ca.jacobian(rows, u[at])
    if any(ca.depends_on(slope, v) for v in (u, x)):
        raise StudyError(f"{model.rig}: angles of its joints are not linear in those of its motors")
    numbers = ca.DM([given[n] for n in question.parameters])
    slope, rest = ca.Function("kinematics", [u, x, p], [ca.densify(slope), ca.densify(rows)])(0, 0, numbers)
    slope, rest = slope.full(), rest.full()[:, 0]
    n = len(joints)
    moving = np.any(np.abs(slope[:n, ::2]) > 0, axis=1)
    return Kinematics(motors, [j for j, m in zip(joints, moving) if m], segments, slope[:n, ::2][moving],
                      rest[:n][moving], slope[n:, 1::2], dict(model.segments))


# --- limits ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Limits:
    """What a planned experiment keeps to.

    Attributes
    ----------
    rows : ndarray, shape (k, motors)
        Each limited angle, or sum of angles, as a combination of motor angles [1].
    low, high : ndarray, shape (k,)
        [rad]
    names : list of str
        Of the rows, as the study has them.
    speed, acceleration, torque : ndarray, shape (motors,)
        Greatest size [rad/s], [rad/s2], [N.m].
    """

    rows: np.ndarray
    low: np.ndarray
    high: np.ndarray
    names: list
    speed: np.ndarray
    acceleration: np.ndarray
    torque: np.ndarray

    @property
    def halfspaces(self):
        """Half-spaces ``a phi <= b`` of the position limits: ``a``, ``b``, and the limit of each in words."""
        a, b, words = [], [], []
        for row, low, high, name in zip(self.rows, self.low, self.high, self.names):
            for sign, end, kind in ((1.0, high, "max"), (-1.0, -low, "min")):
                if math.isfinite(end):
                    a.append(sign * row)
                    b.append(end)
                    words.append(f"{kind} {sign * end:g} rad of '{name}'")
        return np.array(a).reshape(-1, len(self.speed)), np.array(b), words


def read_limits(text, kin):
    """A sum of angles as a combination of motor angles.

    Parameters
    ----------
    text : str
        As ``q_H``, ``q_H + q_K`` or ``0.5 * motor1.phi - q_K``.
    kin : Kinematics
        Whose motors and joints can be named.

    Returns
    -------
    row : ndarray, shape (motors,)
    zero : float
        Value at motor angles zero [rad].

    Raises
    ------
    UnknownNameError
        Not an angle of a joint or motor.
    """
    known = {**{n: (kin.joint[k], kin.zero[k]) for k, n in enumerate(kin.joints)},
             **{f"{m}.phi": (np.eye(len(kin.motors))[k], 0.0) for k, m in enumerate(kin.motors)}}
    row, zero, at = np.zeros(len(kin.motors)), 0.0, 0
    while at < len(text) or at == 0:
        term = _TERM.match(text, at)
        if term is None or term.group(3) not in known or (at > 0 and not term.group(1)):
            name = term.group(3) if term else text
            every = [*known, *(f"{m}.{r}" for m in kin.motors for r in _RATES)]
            raise UnknownNameError(f"[limits] '{text}': no angle '{name}' of a joint or motor{closest(name, every)}")
        factor = (-1.0 if term.group(1) == "-" else 1.0) * float(term.group(2) or 1.0)
        row, zero, at = row + factor * known[term.group(3)][0], zero + factor * known[term.group(3)][1], term.end()
    return row, zero


def limits_of(study, model, kin):
    """Limits that a study sets, and those that the rig's joint angles carry as their own min and max.

    Parameters
    ----------
    study : Study
        Its ``[limits]``.
    model : Model
        Min and max of its joint angles.
    kin : Kinematics
        Of the model.

    Returns
    -------
    Limits

    Raises
    ------
    UnknownNameError
        A limit of what is no angle, and no speed, acceleration or torque of a motor.
    PlanError
        A speed, acceleration or torque that must stay on one side of zero.
    """
    found = dict(study.limits)
    for name in kin.joints:
        v = model.variables[name]
        if name not in found and (math.isfinite(v.min) or math.isfinite(v.max)):
            found[name] = (v.min, v.max)
    sizes = {r: np.full(len(kin.motors), math.inf) for r in _RATES}
    angles = []
    for name, (low, high) in found.items():
        motor, _, what = name.rpartition(".")
        if what in sizes and motor in kin.motors:
            sizes[what][kin.motors.index(motor)] = _size(study, name, low, high, _RATES[what])
            continue
        try:
            row, zero = read_limits(name, kin)
        except UnknownNameError as error:
            raise UnknownNameError(f"{study.path}: {error}") from None
        angles.append((row, -math.inf if low is None else low - zero, math.inf if high is None else high - zero, name))
    rows = np.array([a[0] for a in angles]).reshape(-1, len(kin.motors))
    low, high = (np.array([a[k] for a in angles]) for k in (1, 2))
    return Limits(rows, low, high, [a[3] for a in angles], sizes["w"], sizes["a"], sizes["tau"])


def _size(study, name, low, high, unit):
    """Greatest size of what a motor does both ways."""
    low, high = -math.inf if low is None else low, math.inf if high is None else high
    if not low < 0 < high and not (low == -math.inf and high > 0):
        raise PlanError(f"{study.path}: [limits] '{name}' from {low:g} to {high:g} {unit} keeps the motor from "
                        "standing still, so no experiment fits; let it hold zero")
    return min(high, -low)


# --- workspace ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Zone:
    """Directions of the motors between the lines on which some segment stands still.

    Attributes
    ----------
    signs : tuple of int
        Direction of every segment, in the order of `Kinematics.segments`.
    direction : ndarray, shape (motors,)
        Motor speeds, the fastest one, that keep every segment furthest from standstill.
    least : float
        How far: the least speed of a segment over what one motor alone can give it.
    """

    signs: tuple
    direction: np.ndarray
    least: float

    def branches(self, loads):
        """Whether each segment drives or is driven.

        Parameters
        ----------
        loads : sequence of float
            Sign of the load of every segment.

        Returns
        -------
        list of str
            ``direct`` where motor and motion agree, ``reverse`` else.
        """
        return ["direct" if s * np.sign(v) > 0 else "reverse" for s, v in zip(self.signs, loads)]


@dataclass(frozen=True)
class Workspace:
    """Where a rig can go, and how.

    Parameters
    ----------
    kinematics : Kinematics
        Of the rig.
    limits : Limits
        Stops [rad], and greatest speeds, accelerations and torques.
    """

    kinematics: Kinematics
    limits: Limits

    @cached_property
    def centre(self):
        """Motor angles furthest from all stops [rad], shape (motors,), and how far that is [rad]."""
        a, b, words = self.limits.halfspaces
        size = np.linalg.norm(a, axis=1)
        n = a.shape[1]
        found = linprog(np.r_[np.zeros(n), -1.0], np.c_[a, size], b, bounds=[(None, None)] * n + [(0, None)])
        if found.status == 3:
            raise PlanError("the limits leave some motion of the joints without a stop; give [limits] of "
                            f"{', '.join(self.kinematics.joints) or 'the motor angles'}")
        if not found.success or found.x[-1] < 1e-6:
            raise PlanError(f"no position is within all limits: {self._conflict(a, b, words)} contradict each other")
        return found.x[:n], float(found.x[-1])

    @staticmethod
    def _conflict(a, b, words):
        """The few limits that contradict each other: those that cannot be left out."""
        kept = list(range(len(b)))
        for k in list(kept):
            fewer = [j for j in kept if j != k]
            c = np.r_[np.zeros(a.shape[1]), -1.0]
            rows = np.c_[a[fewer], np.linalg.norm(a[fewer], axis=1)]
            found = linprog(c, rows, b[fewer], bounds=[(None, None)] * a.shape[1] + [(0, 1.0)])
            if not found.success or found.x[-1] < 1e-6:
                kept = fewer
        return " and ".join(words[k] for k in kept)

    @cached_property
    def vertices(self):
        """Corners of the reachable motor angles, shape (corners, motors) [rad]; in order round it for two motors."""
        a, b, _ = self.limits.halfspaces
        centre, _ = self.centre
        if a.shape[1] == 1:
            ends = b / a[:, 0]
            return np.array([[max(ends[a[:, 0] < 0])], [min(ends[a[:, 0] > 0])]])
        try:
            points = HalfspaceIntersection(np.c_[a, -b], centre).intersections
        except QhullError:
            raise PlanError("the stops do not close: the motors can go anywhere along some direction; give [limits] of "
                            f"{', '.join(self.kinematics.joints) or 'the motor angles'}") from None
        if not np.isfinite(points).all() or np.abs(points).max() > 1e9:
            raise PlanError("the stops do not close: the motors can go anywhere along some direction; give [limits] of "
                            f"{', '.join(self.kinematics.joints) or 'the motor angles'}")
        return points[ConvexHull(points).vertices]

    @cached_property
    def still(self):
        """Lines (or planes) on which segments stand still: list of (row, segments); row . motor speeds = 0."""
        found = []
        for name, row in zip(self.kinematics.segments, self.kinematics.speed):
            row = row / np.max(np.abs(row))
            row = row * np.sign(row[np.flatnonzero(np.abs(row) > _EQUAL)[0]])
            same = next((f for f in found if np.allclose(f[0], row, atol=_EQUAL)), None)
            if same:
                same[1].append(name)
            else:
                found.append((row, [name]))
        return found

    @cached_property
    def zones(self):
        """Operative zones, those of opposite motion next to each other.

        Signs are added segment by segment and only what some motion can do is kept, so that the work grows with the
        number of zones and not with that of sign patterns.
        """
        rows = np.array([row for row, _ in self.still])
        patterns = [()]
        for k in range(len(rows)):
            patterns = [p + (s,) for p in patterns for s in (1, -1) if _furthest(rows[:k + 1], p + (s,)) is not None]
        found = []
        for p in (p for p in patterns if p[0] > 0):
            direction, least = _furthest(rows, p)
            for sign in (1, -1):
                signs = np.sign(self.kinematics.speed @ (sign * direction)).astype(int)
                found.append(Zone(tuple(signs.tolist()), sign * direction, least))
        return found

    def rates(self):
        """Corners of the attainable joint speeds: with this transmission, and with one motor a joint.

        Returns
        -------
        coupled, single : ndarray, shape (corners, joints)
            [rad/s]
        """
        ratio = self._ratio()
        corners = _corners(self.limits.speed) @ self.kinematics.joint.T
        return _hull(corners), _corners(np.full(len(ratio), self.limits.speed.max()) / ratio)

    def torques(self):
        """Corners of the attainable joint torques without friction, as `rates` gives those of the speeds.

        Returns
        -------
        coupled, single : ndarray, shape (corners, joints)
            [N.m]
        """
        ratio = self._ratio()
        corners = _corners(self.limits.torque) @ np.linalg.pinv(self.kinematics.joint)
        return _hull(corners), _corners(np.full(len(ratio), self.limits.torque.max()) * ratio)

    def _ratio(self):
        """Ratio of a gear between one motor and one joint that the coupled transmission is compared with."""
        return np.abs(np.linalg.pinv(self.kinematics.joint)).max(axis=0)

    def margin(self, motors):
        """Least distance of motor angles to any stop, negative beyond it.

        Parameters
        ----------
        motors : ndarray, shape (motors, n)
            [rad]

        Returns
        -------
        ndarray, shape (n,)
            [rad] of the limited angle.
        """
        a, b, _ = self.limits.halfspaces
        return (b[:, None] - a @ motors).min(axis=0)

    def reach(self, start, direction):
        """How far the motors can go from a point before a stop.

        Parameters
        ----------
        start, direction : ndarray, shape (motors,)
            A point within the stops [rad], and which way to go.

        Returns
        -------
        float
            In lengths of ``direction``.
        """
        a, b, _ = self.limits.halfspaces
        along = a @ direction
        ends = (b - a @ start)[along > _EQUAL] / along[along > _EQUAL]
        return float(max(ends.min(initial=math.inf), 0.0))


def _furthest(rows, signs):
    """Direction in which the least of the relative segment speeds is greatest, and that speed; None for no motion."""
    a = np.array(signs)[:, None] * rows
    n = rows.shape[1]
    found = linprog(np.r_[np.zeros(n), -1.0], np.c_[-a, np.ones(len(a))], np.zeros(len(a)),
                    bounds=[(-1, 1)] * n + [(0, None)])
    if not found.success or found.x[-1] < 1e-6:
        return None
    # of all directions as good, the one that is in the middle: the shortest would be, were it not as fast
    d = found.x[:n]
    return d / np.abs(d).max(), float(found.x[-1] / np.abs(d).max())


def _corners(half):
    """Corners of a box about zero, in order round it for two dimensions."""
    n = len(half)
    signs = np.array([[1 if k >> b & 1 else -1 for b in range(n)] for k in range(2 ** n)], dtype=float)
    return _hull(signs * half)


def _hull(points):
    """Corners of the convex hull, in order round it in two dimensions."""
    if points.shape[1] == 1:
        return np.array([points.min(axis=0), points.max(axis=0)])
    return points[ConvexHull(points).vertices]

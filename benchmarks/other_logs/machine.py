"""In: angles of the joints, friction of the segments. Out: torques of joints and motors, from the equations alone.

Two motors, 1 and 2, pull the hip and the knee over cables. Each line has a segment A at its motor and a segment B at
the hip; the sum of the lines turns the hip, their difference the knee. Units: s, rad, N.m; friction on the motor side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

RATIO = 15.125
"""Turn of motor 1 over that of either joint."""
SEGMENTS = ("1A", "2A", "1B", "2B")
GRAVITY = 9.81
THIGH_MASS, THIGH_CENTRE, THIGH_INERTIA, THIGH_LENGTH = 4.0, 0.20, 0.06, 0.42
SHANK_MASS, SHANK_CENTRE, SHANK_INERTIA = 3.2, 0.15, 0.03
PAYLOAD_CENTRE = 0.40
ROUNDS = 30
"""Of the fixed point of the losses; each makes the error some ten times smaller, twice where effects are strongest."""
_SUM_AND_DIFFERENCE = np.array([[1.0, 1.0], [1.0, -1.0]])


def motor_angles(q):
    """Angles of the motors where nothing gives.

    Parameters
    ----------
    q : ndarray, shape (n, 2)
        Hip and knee; speeds map alike.

    Returns
    -------
    ndarray, shape (n, 2)
    """
    return RATIO * q @ _SUM_AND_DIFFERENCE


def joint_angles(theta):
    """Angles of hip and knee that belong to angles of the motors.

    Parameters
    ----------
    theta : ndarray, shape (n, 2)

    Returns
    -------
    ndarray, shape (n, 2)
    """
    return theta @ _SUM_AND_DIFFERENCE / (2 * RATIO)


def per_segment(motors):
    """What the segments turn where the motors turn so much; the B segments turn with the knee.

    Parameters
    ----------
    motors : ndarray, shape (n, 2)
        Angles, speeds or accelerations.

    Returns
    -------
    dict of str to ndarray
    """
    first, second = motors.T
    return {"1A": first, "2A": second, "1B": (first - second) / 2, "2B": (second - first) / 2}


def load_torques(q, v, a, payload=0.0):
    """Torques that the leg asks of its joints.

    Parameters
    ----------
    q, v, a : ndarray, shape (n, 2)
        Angle, speed and acceleration of hip and knee; the knee's against the thigh.
    payload : float
        kg, a point of the shank.

    Returns
    -------
    ndarray, shape (n, 2)
    """
    hip = (THIGH_MASS * THIGH_CENTRE ** 2 + THIGH_INERTIA) * a[:, 0]
    hip = hip + THIGH_MASS * THIGH_CENTRE * GRAVITY * np.sin(q[:, 0])
    torques = _shank_torques(q, v, a, SHANK_MASS, SHANK_CENTRE, SHANK_INERTIA)
    if payload:
        torques = torques + _shank_torques(q, v, a, payload, PAYLOAD_CENTRE, 0.0)
    return torques + np.column_stack([hip, np.zeros(len(q))])


def _shank_torques(q, v, a, mass, centre, inertia):
    """Of a body that is fixed to the shank."""
    (hip, knee), (v_hip, v_knee), (a_hip, a_knee) = q.T, v.T, a.T
    coupling, turning = mass * THIGH_LENGTH * centre, mass * centre ** 2 + inertia
    cos, sin = np.cos(knee), np.sin(knee)
    weight = mass * centre * GRAVITY * np.sin(hip + knee)
    at_hip = ((turning + mass * THIGH_LENGTH ** 2 + 2 * coupling * cos) * a_hip + (turning + coupling * cos) * a_knee
              - coupling * sin * (2 * v_hip * v_knee + v_knee ** 2)
              + mass * THIGH_LENGTH * GRAVITY * np.sin(hip) + weight)
    at_knee = (turning + coupling * cos) * a_hip + turning * a_knee + coupling * sin * v_hip ** 2 + weight
    return np.column_stack([at_hip, at_knee])


def direction(angle, travel):
    """Direction of sliding, which turns over within a travel; zero at the start.

    Parameters
    ----------
    angle : ndarray, shape (n,)
    travel : float

    Returns
    -------
    ndarray, shape (n,)
        From -1 to 1.
    """
    step = np.diff(angle, prepend=angle[0])
    keep = np.exp(-abs(step) / travel)
    gain, state, states = np.sign(step) * (1 - keep), 0.0, []
    for k, g in zip(keep.tolist(), gain.tolist()):
        state = k * state + g
        states.append(state)
    return np.array(states)


def lagged(x, duration, dt):
    """Through a first-order lag, at rest before.

    Parameters
    ----------
    x : ndarray, shape (n,)
    duration, dt : float
        Time constant and step, s.

    Returns
    -------
    ndarray, shape (n,)
    """
    keep = np.exp(-dt / duration)
    return lfilter([1 - keep], [1, -keep], x, zi=[keep * x[0]])[0]


@dataclass
class Segment:
    """Friction of a segment over time.

    Parameters
    ----------
    direction : ndarray, shape (n,)
        Of sliding, from -1 to 1.
    f0 : float or ndarray
        Friction without load, N.m.
    mu : float
        Efficiency.
    drag : float or ndarray
        Further friction that no load changes, N.m.
    quadratic, cross : float
        Friction per square of the load, 1/N.m, and per load of the other line.
    load_direction : ndarray, optional
        Direction that friction by load follows; that of sliding where it is missing.
    mu_dif : float
        Share of the load that is lost more when driving than when driven; with `load_direction` only.
    """

    direction: np.ndarray
    f0: float | np.ndarray
    mu: float
    drag: float | np.ndarray = 0.0
    quadratic: float = 0.0
    cross: float = 0.0
    load_direction: np.ndarray | None = None
    mu_dif: float = 0.0

    def loss(self, load, other=0.0):
        """Torque that is lost.

        Parameters
        ----------
        load : ndarray, shape (n,)
            Mean of the torques before and behind the segment.
        other : ndarray or float
            Load of the same segment of the other line.

        Returns
        -------
        ndarray, shape (n,)
        """
        share = 2 * (1 - self.mu) / (1 + self.mu)
        free = 2 * self.mu * self.f0 / (1 + self.mu) + self.drag
        free = self.direction * (free + self.quadratic * load ** 2 + self.cross * abs(other))
        if self.load_direction is None:
            return free + self.direction * share * abs(load)
        return free + abs(load) * share * self.load_direction + self.mu_dif * load * self.load_direction ** 2


def motor_torques(segments, C):
    """Torques that the motors need, from those at the joints.

    Parameters
    ----------
    segments : dict of str to Segment
    C : ndarray, shape (n, 2)
        At hip and knee.

    Returns
    -------
    ndarray, shape (n, 2)
    """
    even1, even2 = joint_angles(C).T  # half of sum and of difference: what the lines would carry without losses
    load1, load2 = even1, even2
    for _ in range(ROUNDS):
        loss1, loss2 = segments["1B"].loss(load1), segments["2B"].loss(load2)
        load1, load2 = even1 - loss2 / 2, even2 - loss1 / 2
    hip1, hip2 = load1 + loss1 / 2, load2 + loss2 / 2
    load1, load2 = hip1, hip2
    for _ in range(ROUNDS):
        loss1, loss2 = segments["1A"].loss(load1, load2), segments["2A"].loss(load2, load1)
        load1, load2 = hip1 + loss1 / 2, hip2 + loss2 / 2
    return np.column_stack([load1 + loss1 / 2, load2 + loss2 / 2])


def joint_torques(segments, tau):
    """Torques at hip and knee, from those of the motors.

    Parameters
    ----------
    segments : dict of str to Segment
    tau : ndarray, shape (n, 2)

    Returns
    -------
    ndarray, shape (n, 2)
    """
    load1, load2 = tau.T
    for _ in range(ROUNDS):
        loss1, loss2 = segments["1A"].loss(load1, load2), segments["2A"].loss(load2, load1)
        load1, load2 = tau[:, 0] - loss1 / 2, tau[:, 1] - loss2 / 2
    hip1, hip2 = load1 - loss1 / 2, load2 - loss2 / 2
    load1, load2 = hip1, hip2
    for _ in range(ROUNDS):
        loss1, loss2 = segments["1B"].loss(load1), segments["2B"].loss(load2)
        load1, load2 = hip1 - loss1 / 2, hip2 - loss2 / 2
    return RATIO * np.column_stack([hip1 + hip2, load1 - loss1 / 2 - load2 + loss2 / 2])

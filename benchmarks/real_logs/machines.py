"""In: a motion, friction parameters, hidden effects. Out: what is true in a machine at every sample.

Inverse dynamics: the motion is prescribed, the joints' torques follow from gravity and inertia, and the transmission is
gone through backwards to the motors. The mean loads of all segments are found together by a fixed-point iteration
(a segment loses a small part of its load, so that it contracts). Equations: Nobili et al., all four quadrants;
nothing of pycosim. Units: rad, rad/s, N.m, s, kg; motor side unless it is called a joint.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from benchmarks.real_logs import effects as laws

GRAVITY = 9.80665
STICTION = 1e-5
"""Travel over which friction builds up in a sound machine, rad: it rests without jumping, and is gone at once."""
ITERATIONS, CONVERGED = 80, 1e-9


@dataclass
class Segment:
    """What a segment's friction is made of, sample by sample: it loses s (F0 + c |L| + ..).

    Parameters
    ----------
    time, w, a, phi : ndarray, shape (n,)
        Speed, acceleration and angle relative to the support.
    q : ndarray, shape (joints, n)
    temperature : ndarray, shape (n,)
        degC.
    f0 : ndarray, shape (n,)
        N.m.
    mu : float
    """

    time: np.ndarray
    w: np.ndarray
    a: np.ndarray
    phi: np.ndarray
    q: np.ndarray
    temperature: np.ndarray
    f0: np.ndarray
    mu: float
    drag: np.ndarray = None
    extra_c: np.ndarray = None
    scale: np.ndarray = None
    s: np.ndarray = None
    load_state: np.ndarray = None
    stiction: float = STICTION
    quadratic: float = 0.0
    cross: float = 0.0
    mu_dif: float = 0.0

    def __post_init__(self):
        n = len(self.time)
        self.drag, self.extra_c, self.scale = np.zeros(n), np.zeros(n), np.ones(n)
        self.s = self.state(self.stiction)

    @property
    def c(self):
        """Share of the mean load that is lost."""
        return 2 * (1 - self.mu) / (1 + self.mu)

    def state(self, travel):
        """z of z' = (w - |w| z) / travel, exact where the speed keeps its sign within a sample."""
        step = np.diff(self.phi)
        keep, goal = np.exp(-abs(step) / travel), np.sign(step)
        z = np.zeros(len(self.time))
        now = 0.0
        for k, (share, end) in enumerate(zip(keep.tolist(), goal.tolist()), 1):
            now = end + (now - end) * share
            z[k] = now
        return z

    def lagging(self, lag):
        """sign(w) of a speed that follows the true one with a lag of `lag` seconds."""
        share = np.exp(-(self.time[1] - self.time[0]) / lag)
        follows = lfilter([1 - share], [1, -share], self.w)
        return np.clip(follows / 0.01, -1, 1)

    def lost(self, L, partner=0.0):
        """Torque lost at a mean load.

        Parameters
        ----------
        L, partner : ndarray, shape (n,)
            Mean loads of this segment and of the one on the other line.

        Returns
        -------
        ndarray, shape (n,)
        """
        size = abs(L)
        own = 2 * self.mu / (1 + self.mu) * np.maximum(self.f0, 0) + self.drag + self.quadratic * L * L
        own = (own + self.cross * abs(partner) + self.extra_c * size) * self.scale * self.s
        if self.load_state is None:
            return own + self.c * size * self.s * self.scale
        return own + self.c * size * self.load_state + self.mu_dif * L * self.load_state ** 2


@dataclass
class Truth:
    """What is true at every sample.

    Parameters
    ----------
    time : ndarray, shape (n,)
    theta, omega, alpha : ndarray, shape (motors, n)
    q : ndarray, shape (joints, n)
        As a joint encoder without error sees it.
    tau, measured : ndarray, shape (motors, n)
        Torque at the shaft, and as the drive believes it to be.
    C : ndarray, shape (joints, n)
        Torque of the transmission on the joint.
    temperature : ndarray, shape (n,)
    label : list of str
    segments : dict of str to Segment
    loads : dict of str to ndarray
    """

    time: np.ndarray
    theta: np.ndarray
    omega: np.ndarray
    alpha: np.ndarray
    q: np.ndarray
    tau: np.ndarray
    measured: np.ndarray
    C: np.ndarray
    temperature: np.ndarray
    label: list
    segments: dict = field(repr=False)
    loads: dict = field(repr=False)
    lateness: float = 0.0

    def moving(self, least):
        """Samples in which every segment is faster than `least`."""
        return np.all([abs(s.w) > least for s in self.segments.values()], axis=0)


def two_links(q, dq, ddq, m1=4.0, c1=0.20, m2=3.2, c2=0.15, I1=0.06, I2=0.03, l1=0.42):
    """Torques that a leg asks of hip and knee: two links hanging in a vertical plane.

    Parameters
    ----------
    q, dq, ddq : ndarray, shape (2, n)
    m1, c1, m2, c2, I1, I2, l1 : float
        Masses, centres, inertias about the centres, length of the thigh.

    Returns
    -------
    ndarray, shape (2, n)
    """
    # centre of the shank: l1 and c2 along two absolute angles; virtual work of gravity and inertia on each
    t1, t2, w1, w2, a1, a2 = q[0], q[0] + q[1], dq[0], dq[0] + dq[1], ddq[0], ddq[0] + ddq[1]
    ax = l1 * (a1 * np.cos(t1) - w1 ** 2 * np.sin(t1)) + c2 * (a2 * np.cos(t2) - w2 ** 2 * np.sin(t2))
    ay = l1 * (a1 * np.sin(t1) + w1 ** 2 * np.cos(t1)) + c2 * (a2 * np.sin(t2) + w2 ** 2 * np.cos(t2))
    on_shank = I2 * a2 + m2 * c2 * (ax * np.cos(t2) + (ay + GRAVITY) * np.sin(t2))
    on_thigh = (I1 + m1 * c1 ** 2) * a1 + m1 * c1 * GRAVITY * np.sin(t1)
    on_thigh = on_thigh + m2 * l1 * (ax * np.cos(t1) + (ay + GRAVITY) * np.sin(t1))
    return np.array([on_thigh + on_shank, on_shank])


def pendulum(q, dq, ddq, m=4.0, l=0.3, J=0.05):
    """Torque that a pendulum asks of its joint.

    Parameters
    ----------
    q, dq, ddq : ndarray, shape (1, n)
    m, l, J : float

    Returns
    -------
    ndarray, shape (1, n)
    """
    return (m * l * l + J) * ddq + m * l * GRAVITY * np.sin(q)


class HipKnee:
    """Two motors drive hip and knee of a leg over two lines of two stages each.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws the friction and the posture that passes start from.
    """

    rig, study = "DriveTrain.Rigs.HipKnee", "hip_knee"
    ratio, axes, turn = 15.125, 2, 2 * np.pi
    segments, motors, joints = ("1A", "2A", "1B", "2B"), ("motor1", "motor2"), ("hip", "knee")
    columns = {"theta": ("theta1", "theta2"), "omega": ("omega1", "omega2"), "tau": ("tau1", "tau2"),
               "q": ("q_H", "q_K"), "C": ("C_H", "C_K")}
    least = 0.02
    mix = np.array([[1.0, 1.0], [1.0, -1.0]])
    torque_noise, reference_noise = 5e-3, 0.03
    torque, speed = 1.0, 1.0  # what torques and speeds are like, against those of this machine

    def __init__(self, rng):
        self.f0 = dict(zip(self.segments, [*rng.uniform(0.05, 0.12, 2), *rng.uniform(0.01, 0.05, 2)]))
        self.mu = dict(zip(self.segments, [*rng.uniform(0.86, 0.95, 2), *rng.uniform(0.93, 0.985, 2)]))
        self.posture = np.array([rng.uniform(0.3, 1.0), -rng.uniform(0.2, 1.2)])
        self.load = dict(m1=4.0, c1=0.20, m2=3.2, c2=0.15)

    def places(self, effect):
        """Places that an effect can sit at."""
        if effect in laws.MOTOR:
            return (*self.motors, "motor1+motor2") if effect not in ("torque_ripple",) else self.motors
        fixed = {"time_delay": ("torque",), "cross_load": ("1A+2A",), "joint_spring": ("hip", "knee"),
                 "payload": ("shank",), "cable_compliance": ("line1", "line2"), "backlash": ("line1", "line2"),
                 "angle_torque": self.motors}
        return fixed.get(effect, ("1A", "2A", "1A", "2A", "1B", "2B", "1A+2A"))

    def lay(self, motion):
        """A motion as angles, speeds and accelerations of the joints and of the motors, around the posture."""
        start = self.posture[:, None]
        if motion.at == "motor":
            start = self.ratio * self.mix @ start
            theta = [motion.x + start, motion.v, motion.a]
            return [self.mix @ x / (2 * self.ratio) for x in theta], theta
        q = [motion.x + start, motion.v, motion.a]
        return q, [self.ratio * self.mix @ x for x in q]

    def relative(self, x):
        """Motor angles (or speeds) to those of the segments."""
        half = (x[0] - x[1]) / 2
        return dict(zip(self.segments, (x[0], x[1], half, -half)))

    def fastest(self, place, motion):
        """Largest speed at a place, rad/s."""
        w = self.relative(self.lay(motion)[1][1])
        return max(abs(w.get(p, w["1A"])).max() for p in place.split("+"))

    def torques(self, q, load=None):
        """Torques of the load at the joints."""
        return two_links(*q, **{**self.load, **(load or {})})

    def partner(self, name):
        """Segment on the other line."""
        return {"1": "2", "2": "1"}[name[0]] + name[1]

    def backwards(self, C, segments):
        """Mean loads and torques of the motors for torques at the joints.

        Parameters
        ----------
        C : ndarray, shape (2, n)
        segments : dict of str to Segment

        Returns
        -------
        loads : dict of str to ndarray
        tau : ndarray, shape (2, n)

        Raises
        ------
        ValueError
            The iteration did not converge.
        """
        total, difference = C / self.ratio
        L = {n: np.zeros(C.shape[1]) for n in self.segments}
        for _ in range(ITERATIONS):
            T = {n: segments[n].lost(L[n], L[self.partner(n)]) for n in self.segments}
            x = difference + T["1B"] - T["2B"]  # between the inputs of the B stages
            inner = {"1": (total + x) / 2, "2": (total - x) / 2}
            new = {f"{i}{k}": inner[i] + (0.5 if k == "A" else -0.5) * T[f"{i}{k}"] for i in "12" for k in "AB"}
            change = max(abs(new[n] - L[n]).max() for n in L)
            L = new
            if change < CONVERGED:
                return L, np.array([inner[i] + T[f"{i}A"] for i in "12"])
        raise ValueError(f"the loads do not converge: {change:.1e} N.m")

    def forward(self, tau, w, p):
        """Joint torques of the base model, closed form, for motor torques and signs of speed.

        Parameters
        ----------
        tau : ndarray, shape (2, n)
        w : dict of str to ndarray
        p : ndarray, shape (8,)
            f0 of the segments, then mu.

        Returns
        -------
        ndarray, shape (2, n)
        """
        out = {}
        for i, t in zip("12", tau):
            for stage in "AB":
                k = self.segments.index(i + stage)
                f0, mu, s = max(p[k], 0.0), p[4 + k], np.sign(w[i + stage])
                r = t - s * mu * f0 / (1 + mu)
                L = r / (1 + s * np.sign(r) * (1 - mu) / (1 + mu))
                t = out[i + stage] = 2 * L - t
        return self.ratio * np.array([out["1A"] + out["2A"], out["1B"] - out["2B"]])

    def encoder(self, theta, true, loads, hidden):
        """What joint encoders see: angles that the lines lose are missing."""
        lost = np.zeros_like(theta)
        for k, line in enumerate(("line1", "line2")):
            for e in hidden:
                if e.id == "cable_compliance" and e.at(line):
                    lost[k] += e.values["e"] * true[k]
                elif e.id == "backlash" and e.at(line):
                    lost[k] += e.values["gap"] / 2 * np.sign(loads[f"{k + 1}A"])
        return self.mix @ (theta - lost) / (2 * self.ratio)

    def base_errors(self, tau, C, truth, pick):
        """RMSE of each joint's torque after a fit of f0 and mu of every segment."""
        w, n = {name: s.w[pick] for name, s in truth.segments.items()}, len(self.segments)
        start = np.clip([*self.f0.values(), *self.mu.values()], 1e-4, 0.999)
        bounds = np.r_[np.zeros(n), np.full(n, 0.3)], np.full(2 * n, 1 + 1e-9)
        found = least_squares(lambda p: (self.forward(tau, w, p) - C).ravel(), start, x_scale=0.05, bounds=bounds,
                              max_nfev=30)
        left = self.forward(tau, w, found.x) - C
        return dict(zip(self.columns["C"], np.sqrt(np.mean(left ** 2, axis=1))))


class GearedJoint(HipKnee):
    """A motor drives a pendulum over a gear of 50 with load-dependent losses.

    Parameters
    ----------
    rng : numpy.random.Generator
    """

    rig, study = "DriveTrain.Rigs.GearedJoint", "geared_joint"
    ratio, axes = 50.0, 1
    segments, motors, joints = ("gear",), ("motor",), ("joint",)
    columns = {"theta": ("theta",), "omega": ("omega",), "tau": ("tau",), "q": (), "C": ("C",)}
    torque_noise, reference_noise = 2e-3, 0.05
    torque, speed = 0.25, 10.0
    rotor, reach = 1e-4, 0.12

    def __init__(self, rng):
        self.f0, self.mu = {"gear": rng.uniform(0.03, 0.08)}, {"gear": rng.uniform(0.85, 0.95)}
        self.posture, self.load = np.array([rng.uniform(0.2, 0.6)]), dict(m=4.0, l=0.3)

    def places(self, effect):
        """Places that an effect can sit at."""
        return {"time_delay": ("torque",), "joint_spring": ("joint",), "angle_torque": ("motor",)}.get(
            effect, ("motor",) if effect in laws.MOTOR else ("gear",))

    def lay(self, motion):
        """A motion as angles, speeds and accelerations of the joint and of the motor."""
        share = self.reach if motion.at == "motor" else 1.0  # passes are given for motors of the hip-knee machine
        q = [share * x[:1] for x in (motion.x, motion.v, motion.a)]
        q[0] = q[0] + self.posture[:, None] - (5 * self.reach if motion.at == "motor" else 0.0)
        return q, [self.ratio * x for x in q]

    def relative(self, x):
        """Motor angle to that of the gear."""
        return {"gear": x[0]}

    def fastest(self, place, motion):
        """Largest speed of the gear, rad/s."""
        return abs(self.lay(motion)[1][1]).max()

    def torques(self, q, load=None):
        """Torque of the load at the joint."""
        return pendulum(*q, **{**self.load, **(load or {})})

    def backwards(self, C, segments):
        """Mean load of the gear and torque of the motor, without its rotor, for a torque at the joint."""
        L, out = np.zeros(C.shape[1]), C[0] / self.ratio
        for _ in range(ITERATIONS):
            T = segments["gear"].lost(L)
            new = out + T / 2
            change, L = abs(new - L).max(), new
            if change < CONVERGED:
                return {"gear": L}, (out + T)[None]
        raise ValueError(f"the load does not converge: {change:.1e} N.m")

    def forward(self, tau, w, p):
        """Joint torque of the base model for motor torques without the rotor's share."""
        f0, mu, s = max(p[0], 0.0), p[1], np.sign(w["gear"])
        r = tau[0] - s * mu * f0 / (1 + mu)
        return self.ratio * (2 * r / (1 + s * np.sign(r) * (1 - mu) / (1 + mu)) - tau[0])[None]

    def encoder(self, theta, true, loads, hidden):
        """What a joint encoder sees."""
        return theta / self.ratio


class LinearAxis(GearedJoint):
    """A motor pushes a carriage along a ball screw: mass, Coulomb and viscous friction, known by its force alone.

    Parameters
    ----------
    rng : numpy.random.Generator
    """

    rig, study = "DriveTrain.Rigs.LinearAxis", "linear_axis"
    ratio, reach, least, turn = 1.0, 0.05, 2e-3, 2.5e-3
    segments, motors, joints = ("guide",), ("motor",), ("carriage",)
    columns = {"theta": ("x",), "omega": ("v",), "tau": ("F",), "q": (), "C": ()}
    torque_noise, rotor = 1.5, 0.0
    torque, speed = 50.0, 0.05

    def __init__(self, rng):
        self.f0, self.mu = {"guide": rng.uniform(15, 25)}, {"guide": 1.0}
        self.mass, self.b, self.posture = rng.uniform(60, 120), rng.uniform(120, 260), np.array([0.0])

    def places(self, effect):
        """Places that an effect can sit at."""
        return {"time_delay": ("force",), "angle_torque": ("motor",)}.get(
            effect, ("motor",) if effect in laws.MOTOR else ("guide",))

    def relative(self, x):
        """Motor position to that of the guide."""
        return {"guide": x[0]}

    def torques(self, q, load=None):
        """Force that the carriage asks for: its inertia, and the viscous friction of the base model."""
        return self.mass * q[2] + self.b * q[1]

    def backwards(self, C, segments):
        """Force of the motor; the guide loses nothing that follows a load."""
        return {"guide": C[0]}, (C[0] + segments["guide"].lost(C[0]))[None]

    def base_errors(self, tau, C, truth, pick):
        """RMSE of the force after a linear fit of mass, viscous and Coulomb friction."""
        w = truth.omega[0, pick]
        terms = np.column_stack([truth.alpha[0, pick], w, np.sign(w)])
        left = tau[0] - terms @ np.linalg.lstsq(terms, tau[0], rcond=None)[0]
        return {"F": np.sqrt(np.mean(left ** 2))}


MACHINES = {"hip_knee": HipKnee, "geared_joint": GearedJoint, "linear_axis": LinearAxis}


def bent(plant, motion, hidden, temperature):
    """Segments of a machine on a motion, with the hidden friction effects in them.

    Parameters
    ----------
    plant : HipKnee
    motion : Motion
    hidden : sequence of Effect
    temperature : ndarray
        degC.

    Returns
    -------
    dict of str to Segment
    """
    q, angles = plant.lay(motion)
    phi, w, a = (plant.relative(x) for x in angles)
    segments = {n: Segment(motion.time, w[n], a[n], phi[n], q[0], temperature,
                           np.full(len(motion.time), plant.f0[n]), plant.mu[n], stiction=STICTION * plant.speed)
                for n in plant.segments}
    for name, segment in segments.items():
        for e in (e for e in hidden if e.at(name)):
            if e.id == "presliding":
                segment.s = segment.state(e.values["travel"])
            elif e.id == "friction_lag":
                segment.s = segment.lagging(e.values["T"])
            laws.bend(segment, e)
    return segments


def simulate(plant, motion, hidden=(), temperature=None, C=None):
    """Everything that is true while a machine does a motion.

    Parameters
    ----------
    plant : HipKnee or GearedJoint
    motion : Motion
    hidden : sequence of Effect
    temperature : ndarray, optional
        degC.
    C : ndarray, optional
        Torques at the joints, instead of those of the load.

    Returns
    -------
    Truth
    """
    given = C is not None
    q, (theta, omega, alpha) = plant.lay(motion)
    temperature = np.full(len(motion.time), 25.0) if temperature is None else temperature
    segments = bent(plant, motion, hidden, temperature)
    C = plant.torques(q) if C is None else np.array(C)
    for e in () if given else hidden:  # what the load model does not know; the transmission carries it
        if e.id == "joint_spring":
            C[plant.joints.index(e.place)] += e.values["k"] * (q[0][plant.joints.index(e.place)] - e.values["q0"])
        elif e.id == "payload":
            reach = two_links(*q, 0, 0, e.values["m"], 0.40, 0, 0)
            C = C + reach
    loads, tau = plant.backwards(C, segments)
    rotor = getattr(plant, "rotor", 0.0)
    tau = tau + rotor * alpha
    for e in hidden:
        if e.id == "angle_torque":
            k = plant.motors.index(e.place)
            tau[k] += e.values["g"] * np.sin(e.values["cycles"] * theta[k] / 6 + e.values["phase"])
    measured = np.array([_reported(tau[k], theta[k], alpha[k], [e for e in hidden if e.at(m)])
                         for k, m in enumerate(plant.motors)])
    late = sum(e.values["d"] for e in hidden if e.id == "time_delay")
    if late:
        measured = np.array([np.interp(motion.time - late, motion.time, x) for x in measured])
    seen = plant.encoder(theta, tau, loads, hidden)
    return Truth(motion.time, theta, omega, alpha, seen, tau, measured, C, temperature, motion.label, segments, loads)


def _reported(true, theta, alpha, hidden):
    """Torque as a drive reports it."""
    value = np.array(true)
    for e in hidden:
        v = e.values
        if e.id == "torque_constant":
            value = value + v["g"] * true
        elif e.id == "torque_saturation":
            value = value + v["k"] * true ** 3
        elif e.id == "torque_offset":
            value = value + v["o"]
        elif e.id == "torque_ripple":
            value = value + v["A"] * np.sin(v["n"] * theta + v["phase"])
        elif e.id == "rotor_inertia":
            value = value + v["J"] * alpha
    return value


def power_gap(plant, truth):
    """Largest power, W, that enters the transmission and neither leaves it nor is lost in the segments' friction.

    Parameters
    ----------
    plant : HipKnee or GearedJoint
    truth : Truth
        Without effects that act on an angle or a rotor.

    Returns
    -------
    float
    """
    tau = truth.tau - getattr(plant, "rotor", 0.0) * truth.alpha
    dq = plant.mix @ truth.omega / (2 * plant.ratio) if plant.axes == 2 else truth.omega / plant.ratio
    lost = 0.0
    for name, segment in truth.segments.items():
        partner = truth.loads[plant.partner(name)] if plant.axes == 2 else 0.0
        lost = lost + segment.lost(truth.loads[name], partner) * segment.w
    return float(abs((tau * truth.omega).sum(0) - (truth.C * dq).sum(0) - lost).max())


def base_errors(plant, truth, log, most=5000):
    """RMSE of the base model, fitted to a log, in each of its channels on moving samples.

    Parameters
    ----------
    plant : HipKnee or GearedJoint
    truth : Truth
        For what is moving, and the directions.
    log : dict of str to ndarray
        Columns as recorded.
    most : int
        Samples to fit.

    Returns
    -------
    dict of str to float
    """
    pick = np.flatnonzero(truth.moving(plant.least))
    pick = pick[::max(1, len(pick) // most)]
    tau = np.array([log[c] for c in plant.columns["tau"]])[:, pick] - getattr(plant, "rotor", 0) * truth.alpha[:, pick]
    C = np.array([log[c][pick] for c in plant.columns["C"]])
    errors = plant.base_errors(tau, C, truth, pick)
    if plant.columns["q"] and plant.columns["q"][0] in log:
        theta = np.array([log[c] for c in plant.columns["theta"]])[:, pick]
        for name, ideal in zip(plant.columns["q"], plant.mix @ theta / (2 * plant.ratio)):
            errors[name] = np.std(log[name][pick] - ideal)
    return errors

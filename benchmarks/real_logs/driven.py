"""In: a wanted motion and a hidden effect. Out: what is true of a machine under control, integrated forward.

Each machine is followed by a controller of its own, in steps of `STEP`. Friction is a state that sticks over a travel
and loses a share of the mean load, so that what goes in and what comes out is found in two rounds. Written from the
pages that define the machines; nothing of pycosim.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

GRAVITY = 9.80665
STEP, CONTROL, SAMPLE = 5e-5, 1e-3, 5e-3
"""Of the integration, the controller and the log [s]."""
CURRENT = 8e-4
"""Time constant of the torque behind its command [s]."""
LATE = (2, 6)
"""Delays that are hidden, in samples: from the first, below the second."""


class Friction:
    """What sticks and slides at one place.

    Parameters
    ----------
    f0 : float
        Friction without load, as f0 of the paper [N.m, or N].
    mu : float
        Efficiency.
    travel : float
        Way over which the friction builds up [rad, or m].
    b, fs, ws, a : float
        Viscous friction; what a friction at rest has more, and the speed at which it is gone; share of f0 that
        forwards has more and backwards less.
    """

    def __init__(self, f0, mu, travel, b=0.0, fs=0.0, ws=1.0, a=0.0):
        self.own, self.share = 2 * mu / (1 + mu), 2 * (1 - mu) / (1 + mu)
        self.f0, self.travel, self.b, self.fs, self.ws, self.a = f0, travel, b, fs, ws, a
        self.state = 0.0

    def lost(self, torque, w, side):
        """Torque lost at speed `w` where `torque` leaves (side 1/2) or enters (-1/2); the state moves by `STEP`."""
        own = self.f0 * (1 + self.a * self.state) + (self.fs * math.exp(-(w / self.ws) ** 2) if self.fs else 0.0)
        loss, own = 0.0, self.own * own
        for _ in range(2):  # the loss is of the mean load, half of it away from either end
            loss = self.state * (own + self.share * abs(torque + side * loss)) + self.b * w
        end = math.copysign(1.0, w)
        self.state = end + (self.state - end) * math.exp(-abs(w) * STEP / self.travel)
        return loss


@dataclass
class Driven:
    """A machine with its controller.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws what the machine is made of.
    effect : str
        Hidden, one of `effects`.
    """

    rng: np.random.Generator
    effect: str

    def __post_init__(self):
        self.hidden = {}  # coefficients of the effect; each machine draws its own


class Geared(Driven):
    """A motor turns a pendulum over an elastic gear of 50."""

    study, counts, axes = "geared_joint", 4096, 1
    effects = {"none": None, "viscous": "gear", "stribeck": "gear", "torque_constant": "motor",
               "torque_ripple": "motor", "time_delay": "torque"}
    beside = (("presliding", "gear"),)
    speeds = (0.2, 0.5, 1.0)
    ratio, rotor, mass, length, inertia = 50.0, 1e-4, 4.0, 0.3, 0.05
    noise = {"tau": (2e-3, 5e-4), "C": (0.05, 0.0)}

    def __post_init__(self):
        rng = self.rng
        self.stiffness = 10 ** rng.uniform(2.9, 3.7)
        self.damping = 0.01 * math.sqrt(self.stiffness * (self.inertia + self.mass * self.length ** 2))
        self.f0, self.mu, self.travel = rng.uniform(0.03, 0.08), rng.uniform(0.85, 0.95), rng.uniform(2e-3, 2e-2)
        self.hidden = {
            "none": dict, "viscous": lambda: {"b": rng.uniform(4e-4, 1.2e-3)},
            "stribeck": lambda: {"fs": rng.uniform(0.8, 1.5) * self.f0, "ws": rng.uniform(1.0, 3.0)},
            "torque_constant": lambda: {"g": float(rng.choice([0.8, 1.2]))},
            "torque_ripple": lambda: {"A": rng.uniform(0.02, 0.04), "n": 7.0, "phase": 0.4},
            "time_delay": lambda: {"d": SAMPLE * int(rng.integers(*LATE))}}[self.effect]()

    def run(self, wanted):
        """Follow a motion of the joint.

        Parameters
        ----------
        wanted : ndarray, shape (1, n)
            Angle of the joint at every `STEP` [rad].

        Returns
        -------
        dict of str to ndarray, shape (samples,)
            What is true of the log's columns at every `SAMPLE`.
        """
        ratio, rotor = self.ratio, self.rotor
        goal, rate = (ratio * wanted[0]).tolist(), (ratio * np.gradient(wanted[0], STEP)).tolist()
        weight, inertia = self.mass * GRAVITY * self.length, self.inertia + self.mass * self.length ** 2
        given = {n: v for n, v in self.hidden.items() if n in ("b", "fs", "ws")}
        gear = Friction(self.f0, self.mu, self.travel, **given)
        theta, omega, dq = goal[0], 0.0, 0.0
        q = wanted[0, 0] - weight * math.sin(wanted[0, 0]) / self.stiffness
        torque = command = 0.0
        held = weight * math.sin(wanted[0, 0]) / ratio
        told, control, sample = [], round(CONTROL / STEP), round(SAMPLE / STEP)
        for k in range(len(goal)):
            if k % control == 0:
                held += 1e-4 * (goal[k] - theta)
                command = min(1.2, max(-1.2, 0.08 * (goal[k] - theta) + 4e-3 * (rate[k] - omega) + held))
            joint = self.stiffness * (theta / ratio - q) + self.damping * (omega / ratio - dq)
            if k % sample == 0:
                told.append((theta, torque, joint))
            torque += (command - torque) * STEP / CURRENT
            omega += STEP * (torque - gear.lost(joint / ratio, omega, 0.5) - joint / ratio) / rotor
            theta += STEP * omega
            dq += STEP * (joint - weight * math.sin(q)) / inertia
            q += STEP * dq
        return dict(zip(("theta", "tau", "C"), np.array(told).T))


class Leg(Driven):
    """Two motors turn hip and knee of a leg over two elastic lines of two stages each."""

    study, counts, axes = "hip_knee", 16384, 2
    effects = {"none": None, "viscous": "1A", "stribeck": "2A", "direction_asymmetry": "1A",
               "torque_constant": "motor1", "torque_ripple": "motor2", "time_delay": "torque"}
    beside = (("presliding", "*"), ("rotor_inertia", "*"), ("cable_compliance", "*"))
    speeds = (0.3, 0.7, 1.4)
    ratio = 15.125
    noise = {"tau1": (5e-3, 2e-3), "tau2": (5e-3, 2e-3), "q_H": (0.0, 2 * math.pi / 2 ** 16),
             "q_K": (0.0, 2 * math.pi / 2 ** 16), "C_H": (0.03, 0.0), "C_K": (0.03, 0.0)}

    def __post_init__(self):
        rng = self.rng
        self.stiffness, self.rotor = 10 ** rng.uniform(1.3, 2.0), 10 ** rng.uniform(-4, -3)
        self.damping = 0.01 * math.sqrt(self.stiffness * 2e-3)
        self.f0 = dict(zip(("1A", "2A", "1B", "2B"), (*rng.uniform(0.05, 0.12, 2), *rng.uniform(0.01, 0.05, 2))))
        self.mu = dict(zip(self.f0, (*rng.uniform(0.86, 0.95, 2), *rng.uniform(0.93, 0.985, 2))))
        self.travel = rng.uniform(2e-3, 1e-2)
        self.hidden = {
            "none": dict, "viscous": lambda: {"b": rng.uniform(5e-3, 1.5e-2)},
            "stribeck": lambda: {"fs": rng.uniform(0.8, 1.5) * self.f0["2A"], "ws": rng.uniform(0.3, 1.2)},
            "direction_asymmetry": lambda: {"a": float(rng.choice([-1, 1])) * rng.uniform(0.3, 0.6)},
            "torque_constant": lambda: {"g": float(rng.choice([0.85, 1.15]))},
            "torque_ripple": lambda: {"A": rng.uniform(0.04, 0.08), "n": 6.0, "phase": 0.4},
            "time_delay": lambda: {"d": SAMPLE * int(rng.integers(*LATE))}}[self.effect]()

    def run(self, wanted):
        """Follow a motion of hip and knee.

        Parameters
        ----------
        wanted : ndarray, shape (2, n)
            Angles at every `STEP` [rad].

        Returns
        -------
        dict of str to ndarray, shape (samples,)
            What is true of the log's columns at every `SAMPLE`.
        """
        t_r, k, d, rotor = self.ratio, self.stiffness, self.damping, self.rotor
        goals = t_r * np.array([wanted[0] + wanted[1], wanted[0] - wanted[1]])
        rates = np.gradient(goals, STEP, axis=1).T.tolist()
        goals = goals.T.tolist()
        place, at = self.effects[self.effect], {}
        if place in self.f0:
            at = {place: self.hidden}
        f = {n: Friction(self.f0[n], self.mu[n], self.travel, **at.get(n, {})) for n in self.f0}
        one, two, low, far = f["1A"], f["2A"], f["1B"], f["2B"]
        q1, q2 = wanted[:, 0]
        pull = _weights(q1, q2, 0.0, 0.0)
        held = [(pull[0] + pull[1]) / (2 * t_r), (pull[0] - pull[1]) / (2 * t_r)]
        a1, a2 = goals[0][0] + held[0] / k, goals[0][1] + held[1] / k
        w1 = w2 = v1 = v2 = 0.0
        torque, command = list(held), list(held)
        told, control, sample = [], round(CONTROL / STEP), round(SAMPLE / STEP)
        for step in range(len(goals)):
            if step % control == 0:
                goal, rate = goals[step], rates[step]
                for i, (a, w) in enumerate(((a1, w1), (a2, w2))):
                    held[i] += 4e-3 * (goal[i] - a)
                    wish = 3.0 * (goal[i] - a) + 0.15 * (rate[i] - w) + held[i]
                    command[i] = min(15.0, max(-15.0, wish))
            up, across = t_r * v1, t_r * v2
            out1 = k * (a1 - t_r * (q1 + q2)) + d * (w1 - up - across)
            out2 = k * (a2 - t_r * (q1 - q2)) + d * (w2 - up + across)
            end1, end2 = out1 - low.lost(out1, across, -0.5), out2 - far.lost(out2, -across, -0.5)
            hip, knee = t_r * (out1 + out2), t_r * (end1 - end2)
            if step % sample == 0:
                told.append((a1, a2, torque[0], torque[1], q1, q2, hip, knee))
            torque[0] += (command[0] - torque[0]) * STEP / CURRENT
            torque[1] += (command[1] - torque[1]) * STEP / CURRENT
            w1 += STEP * (torque[0] - out1 - one.lost(out1, w1, 0.5)) / rotor
            w2 += STEP * (torque[1] - out2 - two.lost(out2, w2, 0.5)) / rotor
            a1 += STEP * w1
            a2 += STEP * w2
            n1, n2 = _weights(q1, q2, v1, v2)
            m11, m12, m22 = _masses(q2)
            det = m11 * m22 - m12 * m12
            x1, x2 = hip - n1, knee - n2
            v1 += STEP * (m22 * x1 - m12 * x2) / det
            v2 += STEP * (m11 * x2 - m12 * x1) / det
            q1 += STEP * v1
            q2 += STEP * v2
        return dict(zip(("theta1", "theta2", "tau1", "tau2", "q_H", "q_K", "C_H", "C_K"), np.array(told).T))


class Axis(Driven):
    """A drive pushes a carriage along a guide over a stiff spring: what it measures is its own force and way."""

    study, counts, axes = "linear_axis", 2 * math.pi / 2e-6, 1
    effects = {"none": None, "stribeck": "guide", "viscous_asymmetry": "guide", "torque_offset": "motor",
               "torque_ripple": "motor", "time_delay": "force"}
    beside = (("presliding", "guide"),)
    speeds = (0.03, 0.1, 0.25)
    noise = {"F": (1.5, 0.3)}

    def __post_init__(self):
        rng = self.rng
        self.mass, self.carried = rng.uniform(20, 40), rng.uniform(40, 80)
        self.stiffness = self.carried * (2 * math.pi * rng.uniform(40, 80)) ** 2
        self.damping = 0.02 * math.sqrt(self.stiffness * self.carried)
        self.f0, self.b, self.travel = rng.uniform(15, 25), rng.uniform(120, 260), 10 ** rng.uniform(-5, -3.7)
        self.hidden = {
            "none": dict, "stribeck": lambda: {"fs": rng.uniform(0.5, 1.0) * self.f0, "ws": rng.uniform(0.01, 0.04)},
            "viscous_asymmetry": lambda: {"b_a": float(rng.choice([-1, 1])) * rng.uniform(0.2, 0.4) * self.b},
            "torque_offset": lambda: {"o": rng.uniform(3, 8)},
            "torque_ripple": lambda: {"A": rng.uniform(3, 6), "n": 2 * math.pi / 2.5e-3, "phase": 0.4},
            "time_delay": lambda: {"d": SAMPLE * int(rng.integers(*LATE))}}[self.effect]()

    def run(self, wanted):
        """Follow a motion along the axis.

        Parameters
        ----------
        wanted : ndarray, shape (1, n)
            Position at every `STEP` [m].

        Returns
        -------
        dict of str to ndarray, shape (samples,)
            What is true of the log's columns at every `SAMPLE`.
        """
        goal, rate = wanted[0].tolist(), np.gradient(wanted[0], STEP).tolist()
        more, less = (self.b + s * self.hidden.get("b_a", 0.0) for s in (1, -1))
        given = self.hidden if self.effect == "stribeck" else {}
        guide = Friction(self.f0, 1.0, self.travel, **given)
        x = y = goal[0]
        v = u = force = command = held = 0.0
        told, control, sample = [], round(CONTROL / STEP), round(SAMPLE / STEP)
        for k in range(len(goal)):
            if k % control == 0:
                held += 40.0 * (goal[k] - x)
                command = min(900.0, max(-900.0, 6e4 * (goal[k] - x) + 3e3 * (rate[k] - v) + held))
            if k % sample == 0:
                told.append((x, force))
            spring = self.stiffness * (x - y) + self.damping * (v - u)
            force += (command - force) * STEP / CURRENT
            v += STEP * (force - spring) / self.mass
            x += STEP * v
            drag = guide.lost(0.0, u, 0.5) + (more if u > 0 else less) * u
            u += STEP * (spring - drag) / self.carried
            y += STEP * u
        return dict(zip(("x", "F"), np.array(told).T))



M1, C1, M2, C2, I1, I2, L1 = 4.0, 0.20, 3.2, 0.15, 0.06, 0.03, 0.42
"""Masses, centres and inertias of thigh and shank, length of the thigh; SI."""


def _weights(q1, q2, v1, v2):
    """Torques that weight and speeds ask of hip and knee."""
    both = q1 + q2
    shank = M2 * C2 * GRAVITY * math.sin(both)
    turn = M2 * L1 * C2 * math.sin(q2)
    knee = shank + turn * v1 * v1
    hip = (M1 * C1 + M2 * L1) * GRAVITY * math.sin(q1) + shank - turn * v2 * (2 * v1 + v2)
    return hip, knee


def _masses(q2):
    """Mass matrix of the leg: hip, both, knee."""
    knee = I2 + M2 * C2 * C2
    cross = M2 * L1 * C2 * math.cos(q2)
    return I1 + M1 * C1 * C1 + M2 * L1 * L1 + knee + 2 * cross, knee + cross, knee


MACHINES = {"geared": Geared, "leg": Leg, "axis": Axis}

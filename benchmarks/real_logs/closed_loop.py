"""In: a motion, an effect, a seed. Out: the log of a joint under control, integrated forward, and its study and truth.

    from benchmarks.real_logs.closed_loop import make
    study = make("pick_and_place", "viscous", 2, folder)

The other machines of this benchmark do a motion that is given, and their torques follow from it. This one is driven: a
controller turns a motor over an elastic gear against the weight of a link, friction sticks over a travel, and the drive
makes its speed of the encoder's steps. Accelerations ring, and motion and torque share the controller's errors.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.real_logs.make import GEARED, written

MOTIONS = ("pick_and_place", "multi_sine", "passes")
EFFECTS = {"none": None, "viscous": "gear", "stribeck": "gear", "torque_constant": "motor", "torque_ripple": "motor",
           "time_delay": "torque"}
RATIO, ROTOR, MASS, LENGTH, INERTIA, GRAVITY = 50.0, 1e-4, 4.0, 0.3, 0.05, 9.80665
STEP, CONTROL, SAMPLE = 5e-5, 1e-3, 5e-3
"""Of the integration, the controller and the log [s]."""
SETTLED, LONG = 2.0, 45.0
"""When the log begins and ends [s]."""
CURRENT = 8e-4
"""Time constant of the torque behind its command [s]."""
COUNTS = 4096
"""Steps of the encoder a turn of the motor."""


@dataclass
class Drive:
    """What a drive is made of; SI units, friction at the motor's side of the gear.

    Parameters
    ----------
    rng : numpy.random.Generator
    effect : str
        Hidden, one of `EFFECTS`.
    """

    rng: np.random.Generator
    effect: str

    def __post_init__(self):
        rng = self.rng
        self.stiffness = 10 ** rng.uniform(2.9, 3.7)
        self.damping = 0.01 * math.sqrt(self.stiffness * (INERTIA + MASS * LENGTH ** 2))
        self.f0, self.mu, self.travel = rng.uniform(0.03, 0.08), rng.uniform(0.85, 0.95), rng.uniform(2e-3, 2e-2)
        self.hidden = {
            "none": dict, "viscous": lambda: {"b": rng.uniform(4e-4, 1.2e-3)},
            "stribeck": lambda: {"fs": rng.uniform(0.8, 1.5) * self.f0, "ws": rng.uniform(1.0, 3.0)},
            "torque_constant": lambda: {"g": float(rng.choice([0.8, 1.2]))},
            "torque_ripple": lambda: {"A": rng.uniform(0.02, 0.04), "n": 7.0, "phase": 0.4},
            "time_delay": lambda: {"d": SAMPLE * int(rng.integers(2, 6))}}[self.effect]()

    def run(self, wanted):
        """Follow a motion of the joint.

        Parameters
        ----------
        wanted : ndarray, shape (n,)
            Angle of the joint at every `STEP` [rad].

        Returns
        -------
        ndarray, shape (4, samples)
            Angle of the motor, true torque of its current, torque and angle of the joint, at every `SAMPLE`.
        """
        goal, rate = (RATIO * wanted).tolist(), (RATIO * np.gradient(wanted, STEP)).tolist()
        weight, inertia = MASS * GRAVITY * LENGTH, INERTIA + MASS * LENGTH ** 2
        own_share, share = 2 * self.mu / (1 + self.mu), 2 * (1 - self.mu) / (1 + self.mu)
        b, fs, ws = (self.hidden.get(n, 1.0 if n == "ws" else 0.0) for n in ("b", "fs", "ws"))
        theta, omega, q, dq = goal[0], 0.0, wanted[0] - weight * math.sin(wanted[0]) / self.stiffness, 0.0
        state = torque = command = 0.0
        held = weight * math.sin(wanted[0]) / RATIO
        told, control, sample = [], round(CONTROL / STEP), round(SAMPLE / STEP)
        for k in range(len(goal)):
            if k % control == 0:
                held += 1e-4 * (goal[k] - theta)
                command = min(1.2, max(-1.2, 0.08 * (goal[k] - theta) + 4e-3 * (rate[k] - omega) + held))
            joint = self.stiffness * (theta / RATIO - q) + self.damping * (omega / RATIO - dq)
            if k % sample == 0:
                told.append((theta, torque, joint, q))
            out, lost = joint / RATIO, 0.0
            own = own_share * (self.f0 + fs * math.exp(-(omega / ws) ** 2))
            for _ in range(2):  # the loss is of the mean load, half of it above what goes out
                lost = state * (own + share * abs(out + lost / 2)) + b * omega
            torque += (command - torque) * STEP / CURRENT
            state = math.copysign(1, omega) + (state - math.copysign(1, omega)) * math.exp(
                -abs(omega) * STEP / self.travel)
            omega += STEP * (torque - lost - out) / ROTOR
            theta += STEP * omega
            dq += STEP * (joint - weight * math.sin(q)) / inertia
            q += STEP * dq
        return np.array(told).T


def motion(name, rng):
    """Angle of the joint that the controller is given, at every `STEP` [rad].

    Parameters
    ----------
    name : str
        One of `MOTIONS`.
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (n,)
    """
    n = round(LONG / STEP)
    if name == "multi_sine":
        time = STEP * np.arange(n)
        waves = zip((0.11, 0.23, 0.37, 0.53), rng.uniform(0.1, 0.35, 4) * (1, 0.8, 0.6, 0.4), rng.uniform(0, 6.28, 4))
        return 0.3 + sum(a * np.sin(2 * np.pi * f * time + p) for f, a, p in waves)
    pieces, at = [], 0.2
    while sum(map(len, pieces)) < n:
        if name == "passes":
            for speed in (0.2, 0.5, 1.0):
                there, stay = np.linspace(-0.5, 1.1, round(1.6 / speed / STEP)), round(0.4 / STEP)
                pieces += [there, np.full(stay, 1.1), there[::-1], np.full(stay, -0.5)]
        else:
            goal = rng.uniform(-0.8, 1.4)
            s = np.linspace(0, 1, round(max(0.5, abs(goal - at) / rng.uniform(0.5, 1.5)) / STEP))
            pieces += [np.full(round(rng.uniform(0.2, 1.0) / STEP), at),
                       at + (goal - at) * s ** 3 * (10 - 15 * s + 6 * s ** 2)]
            at = goal
    wanted = np.concatenate(pieces)[:n]
    if name == "passes":
        reach = round(0.05 / STEP)
        wanted = np.convolve(np.pad(wanted, reach, mode="edge"), np.full(2 * reach + 1, 1 / (2 * reach + 1)), "valid")
    return wanted


def make(name, effect, seed, folder):
    """Write the log of a drive under control, its study and what is true of it.

    Parameters
    ----------
    name : str
        One of `MOTIONS`.
    effect : str
        One of `EFFECTS`; friction builds up over a travel beside it, which may be named where it shows.
    seed : int
    folder : Path

    Returns
    -------
    Path
        Of the study.
    """
    rng = np.random.default_rng([seed, MOTIONS.index(name), list(EFFECTS).index(effect)])
    drive, folder = Drive(rng, effect), Path(folder)
    theta, tau, C, _ = drive.run(motion(name, rng))
    v = drive.hidden
    tau = v.get("g", 1.0) * tau + v.get("A", 0.0) * np.sin(v.get("n", 0.0) * theta + v.get("phase", 0.0))
    late, first = round(v.get("d", 0.0) / SAMPLE), round(SETTLED / SAMPLE)
    tau = tau[first - late:len(tau) - late]
    theta, C = (x[first:] for x in (theta, C))
    theta = np.round(theta * COUNTS / (2 * np.pi)) * 2 * np.pi / COUNTS
    tau = np.round((tau + rng.normal(0, 2e-3, len(tau))) / 5e-4) * 5e-4
    log = {"time": SAMPLE * np.arange(len(theta)), "theta": theta, "omega": np.gradient(theta, SAMPLE), "tau": tau,
           "C": C + rng.normal(0, 0.05, len(C))}
    folder.mkdir(parents=True, exist_ok=True)
    written(folder / "run1.csv", log)
    text = GEARED.replace("runs = []", 'runs = ["run1.csv"]', 1).replace('"unknown"', '"sensor"', 1)
    (folder / "study.toml").write_text(text)
    truth = {"hidden": [[effect, EFFECTS[effect]]] if v else [], "coefficients": [v] if v else [],
             "beside": [["presliding", "gear"]], "own_size": 1.0, "travel": drive.travel, "samples": len(theta),
             "f0": drive.f0, "mu": drive.mu}
    (folder / "truth.json").write_text(json.dumps(truth))
    return folder / "study.toml"

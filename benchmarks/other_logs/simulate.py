"""In: friction of a rig, its motion, what is hidden. Out: what drives, encoders and reference would show exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.other_logs import effects as laws
from benchmarks.other_logs.machine import (
    SEGMENTS,
    Segment,
    direction,
    lagged,
    load_torques,
    motor_angles,
    motor_torques,
    per_segment,
)


@dataclass
class Run:
    """A motion of the rig on a fine time grid.

    Parameters
    ----------
    kind : str
        Of motion.
    rate, every : int
        Samples a second of its log, each of so many steps of the fine grid.
    q, C : ndarray, shape (n, 2)
        Angles and torques of hip and knee.
    walk : ndarray, shape (n,)
        As of `effects.Sliding`.
    """

    kind: str
    rate: int
    every: int
    q: np.ndarray
    C: np.ndarray | None = None
    walk: np.ndarray | None = None

    @property
    def dt(self):
        """Step of the fine grid, s."""
        return 1 / (self.rate * self.every)

    @property
    def time(self):
        """From zero, s."""
        return np.arange(len(self.q)) * self.dt

    def loaded(self, inertia, rng):
        """Fill in torques and random walk.

        Parameters
        ----------
        inertia : bool
            Whether masses resist acceleration; weights alone act otherwise.
        rng : numpy.random.Generator

        Returns
        -------
        Run
            Itself.
        """
        v = np.gradient(self.q, self.dt, axis=0)
        a = np.gradient(v, self.dt, axis=0)
        self.C = load_torques(self.q, v * inertia, a * inertia)
        self.walk = lagged(np.cumsum(rng.normal(size=len(self.q))) * np.sqrt(self.dt / 10), 0.2, self.dt)
        return self


@dataclass(frozen=True)
class Rig:
    """Friction with nothing hidden.

    Parameters
    ----------
    friction : dict of str to (float, float)
        f0 [N.m] and mu of each segment.
    travel : float
        Within which each segment turns over, rad: the rig's own presliding.
    """

    friction: dict
    travel: float


@dataclass
class Truth:
    """What a run would show without noise.

    Parameters
    ----------
    theta, tau, readings, reference : ndarray, shape (n, 2)
        Angles and torques of the motors, those torques as drives say them, torques that the joints are said to have.
    w, direction : dict of str to ndarray
        Speeds of the segments, and directions of sliding with the rig's own travel alone.
    """

    theta: np.ndarray
    tau: np.ndarray
    readings: np.ndarray
    reference: np.ndarray
    w: dict
    direction: dict


def simulate(rig, run, effects):
    """What a run shows with some effects.

    Parameters
    ----------
    rig : Rig
    run : Run
        Loaded.
    effects : list of Effect

    Returns
    -------
    Truth
    """
    C = run.C
    for effect in effects:
        if effect.id == "payload":
            rest = np.zeros_like(run.q)
            C = load_torques(run.q, rest, rest, effect.values["m"])
    exact = theta = motor_angles(run.q)
    for _ in range(3 if any(e.id in laws.ELASTIC for e in effects) else 1):  # angles and torques ask for each other
        w = np.gradient(theta, run.dt, axis=0)
        a = np.gradient(w, run.dt, axis=0)
        slides = {s: direction(angle, rig.travel) for s, angle in per_segment(theta).items()}
        tau = motor_torques(_segments(rig, run, effects, theta, w, a, slides), C)
        theta = exact + laws.deflection(effects, tau, run.dt)
    return Truth(theta, tau, laws.motor_readings(effects, tau, theta, a, run.dt),
                 laws.reference(effects, run.C, run.q, run.dt), per_segment(w), slides)


def _segments(rig, run, effects, theta, w, a, slides):
    """Friction of each segment over a run, with what the effects change of it."""
    angles, speeds, accelerations = per_segment(theta), per_segment(w), per_segment(a)
    segments = {}
    for s in SEGMENTS:
        segments[s] = Segment(slides[s], *rig.friction[s])
        sliding = laws.Sliding(run.time, run.q, run.walk, angles[s], speeds[s], accelerations[s])
        for effect in effects:
            if effect.at(s):
                laws.bend(segments[s], effect, sliding)
        segments[s].f0 = np.maximum(segments[s].f0, 0)
    return segments

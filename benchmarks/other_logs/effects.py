"""In: an effect with its coefficients. Out: what it changes in friction, torques, angles and reference; random draws.

Names and coefficients are those of the catalogue, in SI units; names that begin with ``x_`` are laws outside it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.other_logs.machine import direction, lagged

CATALOGUE = (
    "viscous", "stribeck", "direction_asymmetry", "torque_offset", "torque_constant", "torque_ripple",
    "load_nonlinearity", "thermal_drift", "configuration_preload", "presliding", "load_hysteresis", "cross_load",
    "torque_saturation", "rotor_inertia", "time_delay", "joint_spring", "payload", "cable_compliance", "backlash",
    "viscous_asymmetry", "stribeck_asymmetry", "reference_gain", "reference_offset", "low_pass")
PAIRED = CATALOGUE[:14]
"""Effects that two of may be hidden at once."""
OUTSIDE = ("x_speed_angle", "x_dead_zone", "x_random_walk", "x_acceleration")
OF_LOAD = ("payload", "joint_spring")
"""Hidden against a computed reference, in motions slow enough to leave inertia out."""
ELASTIC = ("cable_compliance", "backlash")
"""Seen by encoders at the joints."""
FAST = ("rotor_inertia", "time_delay", "low_pass", "x_acceleration")
"""Hardly seen in slow passes."""


@dataclass(frozen=True)
class Effect:
    """An effect at a place.

    Parameters
    ----------
    id, place : str
        Joined places as ``1A+2A``.
    values : dict of str to float
        Coefficients.
    sizes : tuple of str
        Coefficients that say how strong it is.
    most : float
        Factor on them that is still plausible.
    """

    id: str
    place: str
    values: dict
    sizes: tuple = ()
    most: float = 1.0

    def at(self, place):
        """Whether it acts at a place.

        Parameters
        ----------
        place : str

        Returns
        -------
        bool
        """
        return self.place == "system" or place in self.place.split("+")

    def scaled(self, factor):
        """The same, so many times as strong; gains keep their distance from 1 in proportion.

        Parameters
        ----------
        factor : float

        Returns
        -------
        Effect
        """
        def stronger(name, value):
            return 1 + (value - 1) * factor if name in ("g", "gain") else value * factor
        return replace(self, values={n: stronger(n, v) if n in self.sizes else v for n, v in self.values.items()})


def drawn(rng, top_speed, duration):
    """A random draw of each effect, at the strength that its search starts from.

    Parameters
    ----------
    rng : numpy.random.Generator
    top_speed : float
        Of the motors, rad/s.
    duration : float
        Of the log, s.

    Returns
    -------
    dict of str to Effect
    """
    segment = str(rng.choice(["1A", "2A", "1B", "2B", "1A+2A", "1B+2B"], p=[0.3, 0.3, 0.12, 0.12, 0.1, 0.06]))
    motor = str(rng.choice(["motor1", "motor2", "motor1+motor2"], p=[0.4, 0.4, 0.2]))
    joint = str(rng.choice(["hip", "knee"]))
    line = str(rng.choice(["line1", "line2", "line1+line2"], p=[0.4, 0.4, 0.2]))
    sign = float(rng.choice([-1, 1]))
    drag = 0.1 / top_speed
    return {e.id: e for e in (
        Effect("viscous", segment, {"b": drag}, ("b",), 50),
        Effect("stribeck", segment, {"fs": 0.03, "ws": top_speed * rng.uniform(0.08, 0.3)}, ("fs",), 8),
        Effect("direction_asymmetry", segment, {"a": 0.3 * sign}, ("a",), 3),
        Effect("torque_offset", motor, {"o": 0.03 * sign}, ("o",), 10),
        Effect("torque_constant", motor, {"g": 1 + 0.05 * sign}, ("g",), 6),
        Effect("torque_ripple", motor, {"A": 0.02, "n": float(rng.choice([1, 2, 4, 6, 7, 12, 18])),
                                        "phase": rng.uniform(0, 6)}, ("A",), 10),
        Effect("load_nonlinearity", segment, {"d": 0.01}, ("d",), 30),
        Effect("thermal_drift", str(rng.choice([segment, "system"])),
               {"k": 0.5, "T": duration * rng.uniform(0.15, 0.5)}, ("k",), 6),
        Effect("configuration_preload", segment, {"k_H": 0.03 * rng.uniform(-1, 1), "k_K": 0.04 * sign},
               ("k_H", "k_K"), 6),
        Effect("presliding", segment, {"travel": rng.uniform(0.02, 0.1)}, ("travel",), 8),
        Effect("load_hysteresis", segment, {"h": rng.uniform(0.3, 2), "mu_dif": 0.02 * sign}, ("mu_dif",), 2),
        Effect("cross_load", "1A+2A", {"k": 0.05}, ("k",), 6),
        Effect("torque_saturation", motor, {"k": 0.15 * sign}, ("k",), 10),
        Effect("rotor_inertia", motor, {"J": 0.003}, ("J",), 50),
        Effect("time_delay", "torque", {"d": rng.uniform(0.008, 0.04)}, ("d",), 3),
        Effect("joint_spring", joint, {"k": 2.0, "q0": float(rng.uniform(-0.3, 0.5))}, ("k",), 10),
        Effect("payload", "shank", {"m": 0.3}, ("m",), 8),
        Effect("cable_compliance", line, {"e": 0.003}, ("e",), 30),
        Effect("backlash", line, {"gap": 0.003}, ("gap",), 30),
        Effect("viscous_asymmetry", segment, {"b_a": drag * sign}, ("b_a",), 30),
        Effect("stribeck_asymmetry", segment, {"fs_a": 0.03 * sign, "ws": top_speed * rng.uniform(0.1, 0.35)},
               ("fs_a",), 6),
        Effect("reference_gain", joint, {"gain": 1 + 0.05 * sign}, ("gain",), 6),
        Effect("reference_offset", joint, {"offset": 0.5 * sign}, ("offset",), 10),
        Effect("low_pass", str(rng.choice(["tau", "C"])), {"T": rng.uniform(0.01, 0.05)}, ("T",), 5),
        Effect("x_speed_angle", segment, {"b": drag}, ("b",), 50),
        Effect("x_dead_zone", motor, {"d": 0.05}, ("d",), 10),
        Effect("x_random_walk", "1A+2A", {"k": 0.4}, ("k",), 8),
        Effect("x_acceleration", segment, {"k": 0.005}, ("k",), 100))}


# --- friction


@dataclass
class Sliding:
    """What a law of friction may depend on.

    Parameters
    ----------
    time : ndarray, shape (n,)
    q : ndarray, shape (n, 2)
        Of hip and knee.
    walk : ndarray, shape (n,)
        A random walk, of the size 1 after ten seconds.
    angle, w, a : ndarray, shape (n,)
        Of the segment, with its speed and acceleration.
    """

    time: np.ndarray
    q: np.ndarray
    walk: np.ndarray
    angle: np.ndarray
    w: np.ndarray
    a: np.ndarray


def bend(segment, effect, sliding):
    """Let an effect change the friction of a segment.

    Parameters
    ----------
    segment : machine.Segment
        Changed in place.
    effect : Effect
        Others than laws of friction change nothing.
    sliding : Sliding
    """
    law = _FRICTION.get(effect.id)
    if law:
        law(segment, sliding, **effect.values)


def _viscous(segment, s, b):
    segment.drag = segment.drag + b * abs(s.w)


def _viscous_asymmetry(segment, s, b_a):
    segment.drag = segment.drag + b_a * s.w


def _stribeck(segment, s, fs, ws):
    segment.f0 = segment.f0 + fs * np.exp(-(s.w / ws) ** 2)


def _stribeck_asymmetry(segment, s, fs_a, ws):
    segment.f0 = segment.f0 + fs_a * np.sign(s.w) * np.exp(-(s.w / ws) ** 2)


def _direction_asymmetry(segment, s, a):
    segment.f0 = segment.f0 * (1 + a * np.sign(s.w))


def _configuration_preload(segment, s, k_H, k_K):
    segment.f0 = segment.f0 + s.q @ (k_H, k_K)


def _thermal_drift(segment, s, k, T):
    segment.f0 = segment.f0 * (1 + k * np.exp(-s.time / T))


def _load_nonlinearity(segment, s, d):
    segment.quadratic = d


def _cross_load(segment, s, k):
    segment.cross = k


def _load_hysteresis(segment, s, h, mu_dif):
    segment.load_direction, segment.mu_dif = direction(s.angle, h), mu_dif


def _presliding(segment, s, travel):
    segment.direction = direction(s.angle, travel)


def _speed_angle(segment, s, b):
    segment.drag = segment.drag + b * abs(s.w * s.q[:, 1])


def _random_walk(segment, s, k):
    segment.f0 = segment.f0 * (1 + k * s.walk)


def _acceleration(segment, s, k):
    segment.drag = segment.drag + k * abs(s.a)


_FRICTION = {
    "viscous": _viscous, "viscous_asymmetry": _viscous_asymmetry, "stribeck": _stribeck,
    "stribeck_asymmetry": _stribeck_asymmetry, "direction_asymmetry": _direction_asymmetry,
    "configuration_preload": _configuration_preload, "thermal_drift": _thermal_drift,
    "load_nonlinearity": _load_nonlinearity, "cross_load": _cross_load, "load_hysteresis": _load_hysteresis,
    "presliding": _presliding, "x_speed_angle": _speed_angle, "x_random_walk": _random_walk,
    "x_acceleration": _acceleration}


# --- torques of the motors, angles, reference


_MOTOR = {
    "torque_offset": lambda tau, theta, a, o: tau + o,
    "torque_constant": lambda tau, theta, a, g: tau * g,
    "torque_ripple": lambda tau, theta, a, A, n, phase: tau + A * np.sin(n * theta + phase),
    "torque_saturation": lambda tau, theta, a, k: tau * (1 + k * tau ** 2),
    "rotor_inertia": lambda tau, theta, a, J: tau + J * a,
    "x_dead_zone": lambda tau, theta, a, d: tau + d * np.clip(tau / 0.02, -1, 1)}
_LINE = {
    "cable_compliance": lambda tau, dt, e: e * tau,
    "backlash": lambda tau, dt, gap: gap / 2 * lagged(np.tanh(tau / 0.01), 0.005, dt)}
_JOINT = {
    "reference_gain": lambda C, q, gain: C * gain,
    "reference_offset": lambda C, q, offset: C + offset,
    "joint_spring": lambda C, q, k, q0: C - k * (q - q0)}


def motor_readings(effects, tau, theta, a, dt):
    """Torques of the motors as the log has them, before noise.

    Parameters
    ----------
    effects : list of Effect
    tau, theta, a : ndarray, shape (n, 2)
        Torque, angle and acceleration of the motors.
    dt : float

    Returns
    -------
    ndarray, shape (n, 2)
    """
    readings = np.array(tau)
    for effect in effects:
        for k in (0, 1):
            if effect.id in _MOTOR and effect.at(f"motor{k + 1}"):
                readings[:, k] = _MOTOR[effect.id](readings[:, k], theta[:, k], a[:, k], **effect.values)
            elif effect.id == "time_delay":
                time = np.arange(len(tau)) * dt
                readings[:, k] = np.interp(time - effect.values["d"], time, readings[:, k])
            elif effect.id == "low_pass" and effect.place == "tau":
                readings[:, k] = lagged(readings[:, k], effect.values["T"], dt)
    return readings


def deflection(effects, tau, dt):
    """Angles by which the motors run ahead of where they would be if nothing gave.

    Parameters
    ----------
    effects : list of Effect
    tau : ndarray, shape (n, 2)
    dt : float

    Returns
    -------
    ndarray, shape (n, 2)
    """
    ahead = np.zeros_like(tau)
    for effect in effects:
        for k in (0, 1):
            if effect.id in _LINE and effect.at(f"line{k + 1}"):
                ahead[:, k] += _LINE[effect.id](tau[:, k], dt, **effect.values)
    return ahead


def reference(effects, C, q, dt):
    """Torques that the joints are said to have, before noise.

    Parameters
    ----------
    effects : list of Effect
    C, q : ndarray, shape (n, 2)
        True torques, or those of a load model, and angles, of hip and knee.
    dt : float

    Returns
    -------
    ndarray, shape (n, 2)
    """
    said = np.array(C)
    for effect in effects:
        for k, joint in enumerate(("hip", "knee")):
            if effect.id in _JOINT and effect.at(joint):
                said[:, k] = _JOINT[effect.id](said[:, k], q[:, k], **effect.values)
            elif effect.id == "low_pass" and effect.place == "C":
                said[:, k] = lagged(said[:, k], effect.values["T"], dt)
    return said

"""In: the name of an effect or of a law outside the catalogue. Out: what it changes in a machine, and a random draw.

A friction effect changes the terms of a segment (`machines.Segment`) in place; what acts on a motor, a channel, a
joint or an angle is asked for by name where `machines` computes that. Equations: those of the library's table of
effects, written anew; units on the motor side.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

A_PLACES, B_PLACES = ("1A", "2A"), ("1B", "2B")


@dataclass(frozen=True)
class Effect:
    """An effect at a place with its coefficients.

    Parameters
    ----------
    id, place : str
        As the library calls them; a joined place as ``1A+2A``.
    values : dict of str to float
        Coefficients in SI units.
    """

    id: str
    place: str
    values: dict = field(hash=False)

    def at(self, place):
        """Whether it acts at a place."""
        return self.place == "system" or place in self.place.split("+")

    def sized(self, amplitude):
        """The same with its size set; `amplitude` is positive, the sign stays."""
        names = AMPLITUDE[self.id][0]
        low = max(abs(self.values[n]) for n in names)
        return Effect(self.id, self.place, {**self.values, **{n: self.values[n] / low * amplitude for n in names}})


# What says how strong an effect is, and between which bounds it may be.
AMPLITUDE = {
    "viscous": (("b",), 1e-5, 0.5), "stribeck": (("fs",), 1e-4, 1.0), "presliding": (("travel",), 3e-4, 3.0),
    "direction_asymmetry": (("a",), 1e-3, 0.95), "configuration_preload": (("k_H", "k_K"), 1e-4, 1.0),
    "load_nonlinearity": (("d",), 1e-4, 0.3), "load_hysteresis": (("h",), 1e-2, 10.0),
    "cross_load": (("k",), 1e-4, 0.3), "torque_ripple": (("A",), 1e-4, 0.5), "thermal_drift": (("k",), 1e-2, 10.0),
    "temperature_dependence": (("k",), 1e-4, 0.5), "torque_constant": (("g",), 1e-3, 0.4),
    "torque_offset": (("o",), 1e-4, 0.3), "torque_saturation": (("k",), 1e-4, 0.4),
    "rotor_inertia": (("J",), 1e-5, 0.1),
    "time_delay": (("d",), 1e-3, 0.3), "joint_spring": (("k",), 1e-2, 30.0), "payload": (("m",), 1e-3, 5.0),
    "cable_compliance": (("e",), 1e-6, 0.1), "backlash": (("gap",), 1e-6, 0.2),
    "viscous_asymmetry": (("b_a",), 1e-5, 0.5), "stribeck_asymmetry": (("fs_a",), 1e-4, 1.0),
    "sublinear_viscous": (("b",), 1e-4, 0.5), "angle_friction": (("g",), 1e-4, 1.0),
    "angle_torque": (("g",), 1e-4, 1.0), "friction_lag": (("T",), 3e-3, 1.0), "dwell": (("fd",), 1e-4, 2.0),
    "speed_angle": (("k",), 1e-5, 0.5), "backward_drag": (("k",), 1e-6, 0.5), "gear_mesh": (("k",), 1e-3, 0.98),
    "wear": (("k",), 1e-5, 0.1), "load_speed": (("k",), 1e-4, 0.3), "load_angle": (("k",), 1e-3, 0.5),
    "intermittent": (("k",), 1e-3, 1.0), "acceleration_friction": (("k",), 1e-5, 0.3), "tide": (("k",), 1e-2, 0.98),
}
SIXTEEN = ("viscous", "stribeck", "presliding", "direction_asymmetry", "configuration_preload", "load_nonlinearity",
           "load_hysteresis", "cross_load", "torque_ripple", "thermal_drift", "torque_constant", "torque_offset",
           "torque_saturation", "rotor_inertia", "time_delay", "cable_compliance")
"""The effects of the table; in worlds without joint encoders `temperature_dependence` stands for the last."""
FURTHER = ("temperature_dependence", "backlash", "viscous_asymmetry", "stribeck_asymmetry", "sublinear_viscous",
           "angle_friction", "angle_torque", "friction_lag", "dwell", "joint_spring", "payload")
OUTSIDE = ("speed_angle", "backward_drag", "gear_mesh", "wear", "load_speed", "load_angle", "intermittent",
           "acceleration_friction", "tide")
"""Laws that the catalogue lacks."""
MOTOR = ("torque_ripple", "torque_constant", "torque_offset", "torque_saturation", "rotor_inertia")
ENCODER = ("cable_compliance", "backlash")
LOAD_MODEL = ("joint_spring", "payload")
TORQUES = {"stribeck": (1, 0), "viscous": (1, -1), "viscous_asymmetry": (1, -1), "stribeck_asymmetry": (1, 0),
           "sublinear_viscous": (1, -0.5), "torque_ripple": (1, 0), "torque_offset": (1, 0), "angle_friction": (1, 0),
           "angle_torque": (1, 0), "presliding": (0, 1), "dwell": (1, 0), "speed_angle": (1, -1), "tide": (0, 0),
           "backward_drag": (1, -2), "intermittent": (1, 0), "acceleration_friction": (1, -1), "wear": (1, -1),
           "load_nonlinearity": (-1, 0), "torque_saturation": (-2, 0)}
"""Powers of a machine's torque and speed in the bounds above; none where the size has no unit, or is a time."""


def bend(segment, effect):
    """Let a friction effect change the terms of a segment.

    Parameters
    ----------
    segment : machines.Segment
        Changed in place.
    effect : Effect
        Others than friction effects change nothing.
    """
    change = _BENDS.get(effect.id)
    if change:
        change(segment, **effect.values)


def _viscous(s, b):
    s.drag += b * abs(s.w)


def _stribeck(s, fs, ws):
    s.f0 += fs * np.exp(-(s.w / ws) ** 2)


def _asymmetry(s, a):
    s.f0 *= 1 + a * np.sign(s.w)


def _preload(s, k_H, k_K):
    s.f0 += k_H * s.q[0] + k_K * s.q[1]


def _quadratic(s, d):
    s.quadratic += d


def _hysteresis(s, h, mu_dif):
    s.load_state, s.mu_dif = s.state(h), np.clip(mu_dif, -s.c, s.c)


def _cross(s, k):
    s.cross += k


def _thermal(s, k, T):
    s.f0 *= 1 + k * np.exp(-s.time / T)


def _temperature(s, k):
    s.f0 *= 1 + k * (s.temperature - s.temperature.mean())


def _viscous_asymmetry(s, b_a):
    s.drag += np.maximum(b_a * s.w, -s.f0)


def _stribeck_asymmetry(s, fs_a, ws):
    s.f0 += fs_a * np.sign(s.w) * np.exp(-(s.w / ws) ** 2)


def _sublinear(s, b, a):
    s.drag += b * abs(s.w) ** a


def _angle_friction(s, g, cycles, phase):
    s.drag += g * (1 + np.sin(cycles * s.phi + phase)) * 0.5 * (1 + 0.4 * np.sin(2 * cycles * s.phi + 2.1 * phase))


def _dwell(s, fd, T):
    rest, pause = np.zeros(len(s.time)), 0.0
    step = s.time[1] - s.time[0]
    gone = 0.0
    for k, (w, d) in enumerate(zip(abs(s.w), abs(np.gradient(s.phi)))):
        pause, gone = (pause + step, 0.0) if w < 1e-3 else (pause, gone + d)
        if gone > 0.3:
            pause = 0.0
        rest[k] = (1 - np.exp(-pause / T)) * np.exp(-gone / 0.05)
    s.drag += fd * rest


def _speed_angle(s, k, lowest):
    s.drag += k * abs(s.w) * (s.phi - s.phi.min()) / max(np.ptp(s.phi), 1e-9) * (1 - lowest) + k * abs(s.w) * lowest


def _backward_drag(s, k):
    s.drag += np.where(s.w < 0, k * s.w ** 2, 0.0)


def _gear_mesh(s, k, cycles):
    s.scale *= 1 + k * np.sin(cycles * s.phi)


def _wear(s, k):
    s.f0 += k * np.concatenate([[0], np.cumsum(abs(np.diff(s.phi)))])


def _load_speed(s, k):
    s.extra_c += k * abs(s.w)


def _load_angle(s, k, cycles, phase):
    s.extra_c += k * (1 + np.sin(cycles * s.phi + phase)) / 2


def _intermittent(s, k, on, off, seed):
    rng, acts, t = np.random.default_rng(int(seed)), np.zeros(len(s.time)), 0.0
    while t < s.time[-1]:
        t += rng.exponential(off)
        length = rng.exponential(on)
        acts[(s.time >= t) & (s.time < t + length)] = 1.0
        t += length
    s.drag += k * acts


def _acceleration(s, k):
    s.drag += k * abs(s.a)


def _tide(s, k, period, phase):
    s.f0 *= 1 + k * np.sin(2 * np.pi * s.time / period + phase)


_BENDS = {"viscous": _viscous, "stribeck": _stribeck, "direction_asymmetry": _asymmetry,
          "configuration_preload": _preload, "load_nonlinearity": _quadratic, "load_hysteresis": _hysteresis,
          "cross_load": _cross, "thermal_drift": _thermal, "temperature_dependence": _temperature,
          "viscous_asymmetry": _viscous_asymmetry, "stribeck_asymmetry": _stribeck_asymmetry,
          "sublinear_viscous": _sublinear, "angle_friction": _angle_friction, "dwell": _dwell,
          "speed_angle": _speed_angle, "backward_drag": _backward_drag, "gear_mesh": _gear_mesh, "wear": _wear,
          "load_speed": _load_speed, "load_angle": _load_angle, "intermittent": _intermittent,
          "acceleration_friction": _acceleration, "tide": _tide}


# --- random draws


def draw(identifier, rng, plant, motion):
    """A random place and random coefficients of an effect, its sign included; `Effect.sized` sets the size.

    Parameters
    ----------
    identifier : str
    rng : numpy.random.Generator
    plant : object
        A machine of `machines`: its places are asked for.
    motion : Motion

    Returns
    -------
    Effect
    """
    place = str(rng.choice(plant.places(identifier)))
    fast = plant.fastest(place, motion)
    drawn = _DRAWS.get(identifier, lambda r, f: {AMPLITUDE[identifier][0][0]: 1.0})(rng, fast)
    if identifier == "torque_ripple":
        drawn["n"] *= 2 * np.pi / plant.turn  # cycles a turn of the screw where the axis is straight
    return Effect(identifier, place, {n: float(v) for n, v in drawn.items()})


def bounds(identifier, plant):
    """Smallest and largest size of an effect's coefficient in a machine."""
    _, low, high = AMPLITUDE[identifier]
    t, w = TORQUES.get(identifier, (0, 0))
    unit = plant.torque ** t * plant.speed ** w
    return low * unit, high * unit


def _sign(rng):
    return float(rng.choice((-1.0, 1.0)))


_CYCLES = (1, 2, 3, 4, 6, 7, 11, 12, 14)
_DRAWS = {
    "stribeck": lambda r, fast: {"fs": 1.0, "ws": fast * r.uniform(0.08, 0.3)},
    "stribeck_asymmetry": lambda r, fast: {"fs_a": _sign(r), "ws": fast * r.uniform(0.08, 0.3)},
    "direction_asymmetry": lambda r, fast: {"a": _sign(r)},
    "viscous_asymmetry": lambda r, fast: {"b_a": _sign(r)},
    "sublinear_viscous": lambda r, fast: {"b": 1.0, "a": r.uniform(0.3, 0.6)},
    "configuration_preload": lambda r, fast: dict(zip(("k_H", "k_K"), r.uniform(0.3, 1.0, 2) * r.choice((-1, 1), 2))),
    "load_hysteresis": lambda r, fast: {"h": 1.0, "mu_dif": _sign(r) * r.uniform(0.02, 0.06)},
    "torque_ripple": lambda r, fast: {"A": 1.0, "n": r.choice(_CYCLES), "phase": r.uniform(-3, 3)},
    "thermal_drift": lambda r, fast: {"k": 1.0, "T": r.uniform(15, 60)},
    "temperature_dependence": lambda r, fast: {"k": _sign(r)},
    "torque_constant": lambda r, fast: {"g": _sign(r)},
    "torque_offset": lambda r, fast: {"o": _sign(r)},
    "torque_saturation": lambda r, fast: {"k": -1.0},
    "joint_spring": lambda r, fast: {"k": 1.0, "q0": r.uniform(-0.5, 0.5)},
    "angle_friction": lambda r, fast: {"g": 1.0, "cycles": r.uniform(0.5, 1.5), "phase": r.uniform(-3, 3)},
    "angle_torque": lambda r, fast: {"g": 1.0, "cycles": r.uniform(3, 8), "phase": r.uniform(-3, 3)},
    "dwell": lambda r, fast: {"fd": 1.0, "T": r.uniform(0.1, 0.6)},
    "speed_angle": lambda r, fast: {"k": 1.0, "lowest": r.uniform(0.0, 0.15)},
    "gear_mesh": lambda r, fast: {"k": 1.0, "cycles": r.uniform(6, 20)},
    "load_angle": lambda r, fast: {"k": 1.0, "cycles": r.uniform(1, 3), "phase": r.uniform(-3, 3)},
    "intermittent": lambda r, fast: {"k": 1.0, "on": r.uniform(0.5, 1.5), "off": r.uniform(2, 5),
                                     "seed": r.integers(1_000_000)},
    "tide": lambda r, fast: {"k": 1.0, "period": r.uniform(11, 19), "phase": r.uniform(-3, 3)},
}

"""In: a motion, friction parameters, hidden effects. Out: the log of a hip-knee rig, as its own drives would write it.

Independent of pycosim on purpose (another formulation, another solver, another integrator), so that a slip in the
package cannot hide itself. The segment law is the direct/reverse table of the paper where the friction is saturated,
and a bracketed root search on the mean load elsewhere; friction states follow the travelled angle, not time. Motion is
prescribed and torques come out backwards: joints -> stages B -> stages A -> motors -> what the drives report.

Units: rad, rad/s, N.m, s, kg, K; everything on the motor side unless it is called a joint (q, C).
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pandas as pd
from scipy.optimize import brentq, least_squares
from scipy.signal import lfilter

RATIO = 15.125
"""Transmission ratio t_r [1]; theta = t_r M q."""
SEGMENTS = ("1A", "2A", "1B", "2B")
MOVING_SPEED = 0.02
"""A sample is moving when every segment is faster than this [rad/s]."""
OVERSAMPLING = 10
"""Points a sample interval on which the direction of travel is followed."""

PAPER = dict(
    f0={"1A": 0.089, "2A": 0.077, "1B": 0.001, "2B": 0.014},
    mu={"1A": 0.90, "2A": 0.91, "1B": 0.99, "2B": 0.97},
)
"""The eight parameters the paper reports: f0 [N.m, motor side], mu [1]."""

_M = np.array([[1.0, 1.0], [1.0, -1.0]])
_SEGMENT_OF_MOTORS = {"1A": (1.0, 0.0), "2A": (0.0, 1.0), "1B": (0.5, -0.5), "2B": (-0.5, 0.5)}
_DIRECTIONS = {"A": (1.0, -1.0), "C": (1.0, 0.5), "E": (0.5, 1.0)}
_RETURN = {"A": "B", "C": "D", "E": "F"}


class MachineError(ValueError):
    """A machine, motion or effect that cannot be simulated."""


class UnreachableSizeError(MachineError):
    """No amplitude within the effect's limits gives the wanted size; `largest` is the largest size met."""

    def __init__(self, message: str, largest: float):
        super().__init__(message)
        self.largest = largest


# --- effects ----------------------------------------------------------------------------------------------------------

_SEGMENT_PLACES = (*SEGMENTS, "1A+2A", "1B+2B")
_MOTOR_PLACES = ("motor1", "motor2", "motor1+motor2")


@dataclass(frozen=True)
class Kind:
    """What an effect is made of: its places, its coefficients, and which of them say how strong it is.

    `amplitude` names the coefficients that `calibrate` scales together, `neutral` is their value without the effect,
    `low` and `high` bound the size of the departure from it.
    """

    places: tuple[str, ...]
    coefficients: tuple[str, ...]
    amplitude: tuple[str, ...]
    low: float
    high: float
    neutral: float = 0.0


KINDS = {
    "viscous": Kind(_SEGMENT_PLACES, ("b",), ("b",), 1e-5, 1.0),
    "stribeck": Kind(_SEGMENT_PLACES, ("fs", "ws"), ("fs",), 1e-5, 1.0),
    "presliding": Kind(_SEGMENT_PLACES, ("travel",), ("travel",), 1e-4, 10.0),
    "direction_asymmetry": Kind(_SEGMENT_PLACES, ("a",), ("a",), 1e-4, 1.0),
    "configuration_preload": Kind(_SEGMENT_PLACES, ("k_H", "k_K"), ("k_H", "k_K"), 1e-5, 1.0),
    "load_dependence": Kind(_SEGMENT_PLACES, ("mu",), ("mu",), 1e-5, 0.5, neutral=1.0),
    "load_nonlinearity": Kind(_SEGMENT_PLACES, ("d",), ("d",), 1e-5, 1.0),
    "load_hysteresis": Kind(_SEGMENT_PLACES, ("h", "mu_dif"), ("h", "mu_dif"), 1e-4, 10.0),
    "cross_load": Kind(("1A+2A", "1B+2B"), ("k",), ("k",), 1e-5, 0.5),
    "torque_ripple": Kind(_MOTOR_PLACES, ("A", "n", "phase"), ("A",), 1e-5, 1.0),
    "thermal_drift": Kind((*_SEGMENT_PLACES, "system"), ("k", "T"), ("k",), 1e-4, 20.0),
    "temperature_dependence": Kind((*_SEGMENT_PLACES, "system"), ("k",), ("k",), 1e-5, 1.0),
    "torque_constant": Kind(_MOTOR_PLACES, ("g",), ("g",), 1e-5, 0.5, neutral=1.0),
    "torque_offset": Kind(_MOTOR_PLACES, ("o",), ("o",), 1e-5, 0.5),
    "torque_saturation": Kind(_MOTOR_PLACES, ("k",), ("k",), 1e-5, 1.0),
    "rotor_inertia": Kind(_MOTOR_PLACES, ("J",), ("J",), 1e-6, 1.0),
    "time_delay": Kind(("torque",), ("d",), ("d",), 1e-5, 1.0),
    "joint_spring": Kind(("hip", "knee", "hip+knee"), ("k", "q0"), ("k",), 1e-3, 100.0),
    "payload": Kind(("shank",), ("m",), ("m",), 1e-4, 10.0),
    "cable_compliance": Kind(("line1", "line2", "line1+line2"), ("e",), ("e",), 1e-6, 0.3),
    "backlash": Kind(("line1", "line2", "line1+line2"), ("gap",), ("gap",), 1e-6, 0.3),
    # Outside the catalogue: what a diagnosis must call unexplained, or at most describe.
    "bump": Kind(SEGMENTS, ("A", "centre", "width", "motor"), ("A",), 1e-4, 2.0),
    "intermittent_drag": Kind(SEGMENTS, ("A", "on", "off", "seed"), ("A",), 1e-4, 2.0),
    "acceleration_friction": Kind(SEGMENTS, ("k",), ("k",), 1e-5, 1.0),
}
"""Every effect known here: the 21 of the catalogue, then `bump`, `intermittent_drag`, `acceleration_friction`."""

OUTSIDE_CATALOGUE = ("bump", "intermittent_drag", "acceleration_friction")
# Seen in a few samples after each reversal or in each ramp: a coarse subsample would miss them.
_TRANSIENT = ("presliding", "load_hysteresis", "time_delay", "rotor_inertia", "acceleration_friction")
_JOINT_ENCODER = ("cable_compliance", "backlash")


def _closest(name: str, names: Iterable[str]) -> str:
    near = difflib.get_close_matches(str(name), list(names), n=1, cutoff=0.0)
    return f"; closest: '{near[0]}'" if near else ""


@dataclass(frozen=True, init=False)
class Effect:
    """One hidden effect at one place, with its coefficients.

    Parameters
    ----------
    id : str
        A key of `KINDS`.
    place : str
        A place the effect exists at; joined places (`1A+2A`) share the coefficients.
    **coefficients : float
        All coefficients of the effect, SI units, as in the contract's table. For `bump`: A [N.m], centre and width
        [rad] of motor `motor` (1 or 2). For `intermittent_drag`: A [N.m], mean durations on and off [s], seed. For
        `acceleration_friction`: k [N.m.s2/rad]. These three add to F.

    Raises
    ------
    MachineError
        The effect, place or coefficient does not exist, or a coefficient is missing.
    """

    id: str
    place: str
    coefficients: Mapping[str, float] = field(hash=False)

    def __init__(self, id: str, place: str, **coefficients: float):
        if id not in KINDS:
            raise MachineError(f"no effect '{id}'{_closest(id, KINDS)}")
        kind = KINDS[id]
        if place not in kind.places:
            raise MachineError(f"no place '{place}' for {id}{_closest(place, kind.places)}")
        if set(coefficients) != set(kind.coefficients):
            raise MachineError(f"{id} needs {', '.join(kind.coefficients)}; given: {', '.join(coefficients) or 'none'}")
        object.__setattr__(self, "id", id)
        object.__setattr__(self, "place", place)
        object.__setattr__(self, "coefficients", {name: float(coefficients[name]) for name in kind.coefficients})

    def __getitem__(self, name: str) -> float:
        return self.coefficients[name]

    def __str__(self) -> str:
        values = ", ".join(f"{name}={value:.4g}" for name, value in self.coefficients.items())
        return f"{self.id}@{self.place}({values})"

    def acts_on(self, place: str) -> bool:
        """Whether a single place (`1A`, `motor2`) is among this effect's places."""
        return self.place == "system" or place in self.place.split("+")

    @property
    def amplitude(self) -> float:
        """Distance of the amplitude coefficients from their neutral value, >= 0."""
        kind = KINDS[self.id]
        return math.hypot(*(self[name] - kind.neutral for name in kind.amplitude))

    def scaled(self, amplitude: float) -> Effect:
        """The same effect, amplitude coefficients scaled together (signs and ratios kept) to this amplitude."""
        kind = KINDS[self.id]
        if self.amplitude == 0.0:
            raise MachineError(f"{self} cannot be scaled: its amplitude is zero, so it has no sign")
        factor = amplitude / self.amplitude
        scaled = {name: kind.neutral + (self[name] - kind.neutral) * factor for name in kind.amplitude}
        return Effect(self.id, self.place, **{**self.coefficients, **scaled})


def _pick(effects: Sequence[Effect], id: str, place: str | None = None) -> list[Effect]:
    return [effect for effect in effects if effect.id == id and (place is None or effect.acts_on(place))]


# --- the machine and its leg ------------------------------------------------------------------------------------------


def random_machine(rng: np.random.Generator) -> dict:
    """A rig like the paper's with other friction: same shape as `PAPER`.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws f0 uniform in [0.03, 0.15] (A) and [0.002, 0.03] N.m (B), mu in [0.85, 0.97] and [0.94, 0.995].
    """
    f0_range = {"A": (0.03, 0.15), "B": (0.002, 0.03)}
    mu_range = {"A": (0.85, 0.97), "B": (0.94, 0.995)}
    return dict(
        f0={name: float(rng.uniform(*f0_range[name[1]])) for name in SEGMENTS},
        mu={name: float(rng.uniform(*mu_range[name[1]])) for name in SEGMENTS},
    )


def without_load_dependence(machine: Mapping) -> dict:
    """The machine with mu = 1 everywhere, the base on which `load_dependence` is a missing effect."""
    return dict(f0=dict(machine["f0"]), mu=dict.fromkeys(SEGMENTS, 1.0))


@dataclass(frozen=True)
class Leg:
    """The driven leg: thigh (1) and shank (2), angles from the vertical q_H and q_H + q_K; defaults of the rig.

    Masses m [kg], centres of mass c and thigh length l1 [m], inertias about the centres of mass I [kg.m2], g [m/s2],
    `payload_distance` [m] of a point mass below the knee.
    """

    m1: float = 4.0
    c1: float = 0.20
    m2: float = 3.2
    c2: float = 0.15
    I1: float = 0.06
    I2: float = 0.03
    l1: float = 0.42
    g: float = 9.80665
    payload_distance: float = 0.40

    def gravity(self, q: np.ndarray) -> np.ndarray:
        """Joint torques (n, 2) [N.m] that hold the leg at q (n, 2) [rad]."""
        thigh, shank = q[:, 0], q[:, 0] + q[:, 1]
        knee = self.m2 * self.c2 * self.g * np.sin(shank)
        hip = (self.m1 * self.c1 + self.m2 * self.l1) * self.g * np.sin(thigh) + knee
        return np.column_stack([hip, knee])

    def payload_gravity(self, q: np.ndarray, mass: float) -> np.ndarray:
        """Joint torques (n, 2) [N.m] that hold a point mass [kg] on the shank."""
        thigh, shank = q[:, 0], q[:, 0] + q[:, 1]
        knee = mass * self.payload_distance * self.g * np.sin(shank)
        return np.column_stack([mass * self.l1 * self.g * np.sin(thigh) + knee, knee])

    def inertial(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Joint torques (n, 2) [N.m] of the double pendulum beyond gravity."""
        lean = -q[:, 1]
        w1, w2 = dq[:, 0], dq[:, 0] + dq[:, 1]
        a1, a2 = ddq[:, 0], ddq[:, 0] + ddq[:, 1]
        coupling = self.m2 * self.l1 * self.c2
        knee = (self.I2 + self.m2 * self.c2**2) * a2 + coupling * (np.cos(lean) * a1 - np.sin(lean) * w1**2)
        thigh = (self.I1 + self.m1 * self.c1**2 + self.m2 * self.l1**2) * a1
        thigh += coupling * (np.cos(lean) * a2 + np.sin(lean) * w2**2)
        return np.column_stack([thigh + knee, knee])


# --- motion -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Stretch:
    """One piece of a trajectory: a pass along a straight line in (theta1, theta2), or a rest (speed 0)."""

    label: str
    begin: float
    duration: float
    theta: tuple[float, float]
    direction: tuple[float, float]
    speed: float
    ramp: float


class Trajectory:
    """Motor angles as exact functions of time, sampled at `time`.

    Parameters
    ----------
    stretches : sequence of Stretch
        Contiguous in time and angle.
    rate : float
        Samples a second [Hz].
    """

    def __init__(self, stretches: Sequence[Stretch], rate: float):
        self.stretches = tuple(stretches)
        self.rate = float(rate)
        end = self.stretches[-1].begin + self.stretches[-1].duration
        self.time = np.arange(int(round(end * rate)) + 1) / rate
        self._begin = np.array([piece.begin for piece in self.stretches])
        labels = np.array([piece.label for piece in self.stretches], dtype=object)
        self.manoeuvre = labels[self._index(self.time)]

    def _index(self, time: np.ndarray) -> np.ndarray:
        return np.clip(np.searchsorted(self._begin, time, side="right") - 1, 0, len(self._begin) - 1)

    def at(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angle, speed and acceleration of the motors, each (n, 2), at any times [s]; at rest before and after."""
        index = self._index(time)
        table = {name: np.array([getattr(piece, name) for piece in self.stretches])[index]
                 for name in ("duration", "theta", "direction", "speed", "ramp")}
        local = np.clip(time - self._begin[index], 0.0, table["duration"])
        travel, speed, acceleration = _profile(local, table["duration"], table["speed"], table["ramp"])
        direction = table["direction"]
        theta = table["theta"] + direction * travel[:, None]
        return theta, direction * speed[:, None], direction * acceleration[:, None]

    @cached_property
    def moving(self) -> np.ndarray:
        """True where every segment is faster than `MOVING_SPEED`, (n,)."""
        omega = self.at(self.time)[1]
        return np.all([np.abs(segment_motion(omega, name)) > MOVING_SPEED for name in SEGMENTS], axis=0)


def _profile(time, duration, speed, ramp):
    """Travel, speed, acceleration of a pass: raised-cosine ramp, constant speed, the same ramp down."""
    rising = np.minimum(time, ramp)
    falling = np.minimum(duration - time, ramp)
    phase_up, phase_down = np.pi * rising / ramp, np.pi * falling / ramp
    travel_up = speed / 2 * (rising - ramp / np.pi * np.sin(phase_up))
    # The ramp down is the ramp up seen from the end, so that out and back pass each point with the same acceleration.
    missing_down = speed / 2 * (ramp - falling + ramp / np.pi * np.sin(phase_down))
    cruise = np.clip(time - ramp, 0.0, duration - 2 * ramp)
    travel = travel_up + speed * cruise + missing_down
    current = speed * (1 - np.cos(phase_up)) / 2 - speed * (1 + np.cos(phase_down)) / 2
    acceleration = speed * np.pi / (2 * ramp) * (np.sin(phase_up) - np.sin(phase_down))
    return travel, np.where(np.abs(current) < 1e-12, 0.0, current), acceleration


def segment_motion(motors: np.ndarray, name: str) -> np.ndarray:
    """Angle, speed or acceleration (n,) of a segment relative to its support, from the motors' (n, 2)."""
    first, second = _SEGMENT_OF_MOTORS[name]
    return first * motors[:, 0] + second * motors[:, 1]


class _Path:
    """Builds a trajectory piece by piece; keeps where and when it is."""

    def __init__(self, theta: np.ndarray, acceleration: float):
        self.theta = np.asarray(theta, dtype=float)
        self.acceleration = acceleration
        self.now = 0.0
        self.stretches: list[Stretch] = []

    def rest(self, duration: float) -> None:
        self._append("rest", duration, (0.0, 0.0), 0.0, duration / 4)

    def go(self, label: str, direction: Sequence[float], travel: float, speed: float) -> None:
        # Not shorter than 0.1 s: a log of 100 Hz should see the ramp. Slower where the line is short for the speed.
        ramp = max(math.pi / 2 * speed / self.acceleration, 0.1)
        if travel < 1.5 * speed * ramp:
            speed = travel / (1.5 * ramp)
        self._append(label, travel / speed + ramp, tuple(direction), speed, ramp)
        self.theta = self.theta + np.asarray(direction) * travel

    def _append(self, label, duration, direction, speed, ramp):
        self.stretches.append(Stretch(label, self.now, duration, tuple(self.theta), direction, speed, ramp))
        self.now += duration

    def six_passes(self, travel: float, speed: float, dwell: float) -> None:
        """A, B, C, D, E, F: three lines, each out and back."""
        for out, direction in _DIRECTIONS.items():
            passes = [(out, np.array(direction)), (_RETURN[out], -np.array(direction))]
            for label, towards in passes if travel > 0 else passes[::-1]:
                self.go(label, towards, abs(travel), speed)
                self.rest(dwell)

    def transfer(self, theta: np.ndarray, speed: float, dwell: float) -> None:
        """Go to another start along the lines of A and of C, so that no segment ever stands still alone."""
        lines = np.column_stack([_DIRECTIONS["A"], _DIRECTIONS["C"]])
        for line, travel in zip(lines.T, np.linalg.solve(lines, theta - self.theta)):
            if abs(travel) > 1e-9:
                self.go("transfer", line * np.sign(travel), abs(travel), speed)
                self.rest(dwell)


def six_manoeuvres(speeds: Sequence[float] = (1.6,), repeats: int = 2, rate: float = 100.0, dwell: float = 0.5,
                   start: Sequence = ((0.9, -0.85),), lines: Sequence[float] = (12.8,), longest_pass: float = math.inf,
                   acceleration: float = 8.0, rng: np.random.Generator | None = None) -> Trajectory:
    """The six manoeuvres of the paper, out and back over three lines: A then B, C then D, E then F.

    Parameters
    ----------
    speeds : sequence of float
        Speed of the faster motor [rad/s].
    repeats : int
        Blocks of six passes for each (start, line, speed).
    rate : float
        Samples a second [Hz].
    dwell : float
        Rest at both ends of each pass [s], labelled `rest`.
    start : sequence of (q_H, q_K)
        Where the lines begin [rad]; one pair or several. Transfers between them are labelled `transfer`.
    lines : sequence of float
        Travel of the faster motor along a pass [rad]; negative lines are gone back and out: B then A, and so on.
    longest_pass : float
        Slow passes turn back after this time [s] rather than go the whole line.
    acceleration : float
        Limit of the faster motor's acceleration [rad/s2].
    rng : numpy.random.Generator, optional
        Puts the blocks into a random order in time; without it they come in the order given.

    Returns
    -------
    Trajectory

    Raises
    ------
    MachineError
        A speed is so low that a segment would not count as moving.
    """
    if min(speeds) / 4 <= MOVING_SPEED:
        raise MachineError(f"speed {min(speeds):g} rad/s: the B stages of C to F would not exceed {MOVING_SPEED} rad/s")
    starts = np.atleast_2d(start)
    blocks = [(q, line, speed) for _ in range(repeats) for q in starts for line in lines for speed in speeds]
    if rng is not None:
        blocks = [blocks[index] for index in rng.permutation(len(blocks))]
    path = _Path(RATIO * _M @ blocks[0][0], acceleration)
    path.rest(max(dwell, 0.5))
    for q, line, speed in blocks:
        path.transfer(RATIO * _M @ q, max(speeds), dwell)
        path.six_passes(math.copysign(min(abs(line), speed * longest_pass), line), speed, dwell)
    return Trajectory(path.stretches, rate)


def default_trajectory(rng: np.random.Generator | None = None) -> Trajectory:
    """The motion of the hidden-effect experiments: five speeds in random order, twice, about 430 s at 100 Hz."""
    return six_manoeuvres(speeds=(0.2, 0.4, 0.8, 1.6, 2.4), repeats=2, longest_pass=6.8, rng=rng)


CROSSING_START = (-0.25, -0.9)
"""A start [rad] from which gravity changes the sign of both lines' load within a pass: what backlash needs to show."""


class _Motion:
    """The trajectory at the wanted samples, and the history that friction states need."""

    def __init__(self, trajectory: Trajectory, pick=slice(None), delay: float = 0.0):
        self._trajectory = trajectory
        self._pick = pick
        self._all = trajectory.time - delay
        self.time = self._all[pick]
        self.theta, self.omega, self.alpha = trajectory.at(self.time)
        self.q = self.theta @ _M / (2 * RATIO)
        self._histories: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    @cached_property
    def _fine_theta(self) -> np.ndarray:
        count = len(self._all)
        places = np.arange((count - 1) * OVERSAMPLING + 1) / OVERSAMPLING
        return self._trajectory.at(np.interp(places, np.arange(count), self._all))[0]

    def _history(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Oversampled angle of a segment, and on each interval the direction of the last motion (0 before any)."""
        if name not in self._histories:
            x = segment_motion(self._fine_theta, name)
            step = np.diff(x)
            # Where two stretches meet, rounding leaves steps of 1e-15 rad that are no motion.
            direction = np.where(np.abs(step) > 1e-12, np.sign(step), 0.0)
            last_moving = np.maximum.accumulate(np.where(direction != 0, np.arange(len(step)), -1))
            self._histories[name] = x, np.where(last_moving >= 0, direction[last_moving], 0.0)
        return self._histories[name]

    def bristle(self, name: str, length: float) -> np.ndarray:
        """Friction state z of a segment [1], z' = (w - |w| z) / length, exact in the travelled angle.

        On a run of one direction s, dz/d|x| = (s - z) / length, so z relaxes to s exponentially with travel. With
        length = 0 it is the direction of the last motion, kept at rest.
        """
        x, held = self._history(name)
        z = np.zeros(len(x))
        if length <= 0.0:
            z[1:] = held
            return z[::OVERSAMPLING][self._pick]
        turns = np.flatnonzero(np.diff(held)) + 1
        for first, last in zip([0, *turns], [*turns, len(held)]):
            travel = np.abs(x[first + 1:last + 1] - x[first])
            z[first + 1:last + 1] = held[first] + (z[first] - held[first]) * np.exp(-travel / length)
        z = np.where(1 - np.abs(z) < 1e-12, np.sign(z), z)
        return z[::OVERSAMPLING][self._pick]


# --- the segment law --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Segment:
    """A segment at every sample: tau_in - tau_out = s (F0 + d L^2) + c |L| z + mu_dif L z^2.

    `s` and `z` are (n,) in [-1, 1] and the same thing unless the load term has its own hysteresis; `F0` is (n,) [N.m]
    with every load-free effect in it.
    """

    s: np.ndarray
    z: np.ndarray
    F0: np.ndarray
    mu: float
    mu_dif: float = 0.0
    d: float = 0.0

    @property
    def c(self) -> float:
        """Share of the mean load lost to friction [1]."""
        return 2 * (1 - self.mu) / (1 + self.mu)

    def dissipated(self, load: np.ndarray) -> np.ndarray:
        """tau_in - tau_out (n,) [N.m] at a mean load (n,) [N.m]."""
        return (self.s * (self.F0 + self.d * load**2) + self.c * np.abs(load) * self.z
                + self.mu_dif * load * self.z**2)

    @property
    def saturated(self) -> np.ndarray:
        """Where the paper's direct/reverse table holds, (n,)."""
        if self.mu_dif != 0.0 or self.d != 0.0:
            return np.zeros(len(self.s), dtype=bool)
        return (np.abs(self.s) == 1.0) & (self.z == self.s)

    def take(self, mask: np.ndarray) -> Segment:
        """The same segment at some of the samples."""
        return replace(self, s=self.s[mask], z=self.z[mask], F0=self.F0[mask])

    def dragged(self, extra: np.ndarray) -> Segment:
        """The same segment with more load-free friction (n,) [N.m]."""
        return replace(self, F0=self.F0 + extra)


def table_out(tau_in: np.ndarray, s: np.ndarray, F0: np.ndarray, mu: float) -> np.ndarray:
    """Torque out of a sliding segment from the torque into it: the table of direct and reverse branches.

    All torques (n,) [N.m], s = +1 or -1. F0 = 2 mu f0 / (1 + mu) is the friction at no load, where the branch changes.
    """
    f0 = F0 * (1 + mu) / (2 * mu)
    direct = (tau_in > s * mu * f0 / (1 + mu)) == (s > 0)
    return np.where(direct, mu * (tau_in - s * f0), tau_in / mu - s * f0)


def table_in(tau_out: np.ndarray, s: np.ndarray, F0: np.ndarray, mu: float) -> np.ndarray:
    """Torque into a sliding segment from the torque out of it; the inverse of `table_out`."""
    f0 = F0 * (1 + mu) / (2 * mu)
    direct = (tau_out > -s * mu * f0 / (1 + mu)) == (s > 0)
    return np.where(direct, tau_out / mu + s * f0, mu * (tau_out + s * f0))


def _root(function: Callable, low: np.ndarray, high: np.ndarray, tolerance: float = 1e-13) -> np.ndarray:
    """Roots of n increasing functions, each in its bracket: secant and bisection in turn.

    The secant hits a linear piece at once, the bisection gets into it whatever happens.
    """
    f_low, f_high = function(low), function(high)
    for step in range(200):
        span = f_high - f_low
        share = np.where((step % 2 == 0) & (span > 0), -f_low / np.where(span > 0, span, 1.0), 0.5)
        middle = low + np.clip(share, 0.0, 1.0) * (high - low)
        f_middle = function(middle)
        if np.all(np.abs(f_middle) < tolerance):
            return middle
        left = f_middle <= 0
        low, f_low = np.where(left, middle, low), np.where(left, f_middle, f_low)
        high, f_high = np.where(left, high, middle), np.where(left, f_high, f_middle)
    raise MachineError(f"the segment law did not converge: {np.max(np.abs(f_middle)):.1e} N.m left")


def _bracket(function: Callable, centre: np.ndarray, limit: float = math.inf) -> tuple[np.ndarray, np.ndarray]:
    """A sign change around the centre, at most `limit` from zero."""
    width = np.full(len(centre), 0.5)
    for _ in range(40):
        low = np.clip(centre - width, -limit, limit)
        high = np.clip(centre + width, -limit, limit)
        open_ends = (function(low) > 0) | (function(high) < 0)
        if not open_ends.any():
            return low, high
        width = np.where(open_ends, 2 * width, width)
    raise MachineError("no torque balances the load: friction grows faster than the torque that should overcome it")


def _searched_load(segment: Segment, known: np.ndarray, given: str) -> np.ndarray:
    side = 0.5 if given == "in" else -0.5

    def excess(load):
        return load + side * segment.dissipated(load) - known

    # Beyond this load the quadratic term would win over the torque itself and the law has no unique answer.
    steepest = (1 - segment.c / 2 - abs(segment.mu_dif) / 2) / abs(segment.d) if segment.d else math.inf
    return _root(excess, *_bracket(excess, known, 0.999 * steepest))


def mean_load(segment: Segment, known: np.ndarray, given: str) -> np.ndarray:
    """Mean load (n,) [N.m] of a segment from the torque (n,) at its end `given`, "in" or "out"."""
    load = np.empty(len(known))
    fast = segment.saturated
    if fast.any():
        part = segment.take(fast)
        other = (table_out if given == "in" else table_in)(known[fast], part.s, part.F0, part.mu)
        load[fast] = (known[fast] + other) / 2
    if not fast.all():
        load[~fast] = _searched_load(segment.take(~fast), known[~fast], given)
    return load


def _mean_loads(first: Segment, second: Segment, known: np.ndarray, given: str, cross: float) -> np.ndarray:
    """Mean loads (n, 2) of a pair of segments that may rub on each other's load (`cross` [1])."""
    pair = (first, second)
    loads = np.column_stack([mean_load(segment, known[:, i], given) for i, segment in enumerate(pair)])
    if cross == 0.0:
        return loads
    for _ in range(200):
        before = loads
        extra = cross * np.abs(loads[:, ::-1])
        loads = np.column_stack([mean_load(segment.dragged(extra[:, i]), known[:, i], given)
                                 for i, segment in enumerate(pair)])
        if np.max(np.abs(loads - before)) < 1e-13:
            return loads
    raise MachineError(f"cross_load k = {cross:g} is too strong: the loads of the pair do not settle")


# --- from effects to segments -----------------------------------------------------------------------------------------


def _preload(f0: float, name: str, motion: _Motion, s: np.ndarray, effects, temperature) -> np.ndarray:
    """f0 (n,) [N.m] of a segment with every effect that works on f0: first what is added, then the factors."""
    value = np.full(len(motion.time), f0)
    for effect in _pick(effects, "stribeck", name):
        value += effect["fs"] * np.exp(-(segment_motion(motion.omega, name) / effect["ws"]) ** 2)
    for effect in _pick(effects, "configuration_preload", name):
        value += motion.q @ np.array([effect["k_H"], effect["k_K"]])
    for effect in _pick(effects, "direction_asymmetry", name):
        value *= 1 + effect["a"] * s
    for effect in _pick(effects, "thermal_drift", name):
        value *= 1 + effect["k"] * np.exp(-motion.time / effect["T"])
    for effect in _pick(effects, "temperature_dependence", name):
        value *= 1 + effect["k"] * (temperature - temperature.mean())[motion._pick]
    return np.maximum(value, 0.0)


def _extra_friction(name: str, motion: _Motion, effects) -> np.ndarray:
    """What is added to F itself (n,) [N.m]."""
    extra = np.zeros(len(motion.time))
    for effect in _pick(effects, "viscous", name):
        extra += effect["b"] * np.abs(segment_motion(motion.omega, name))
    for effect in _pick(effects, "bump", name):
        angle = motion.theta[:, int(effect["motor"]) - 1]
        extra += effect["A"] * np.exp(-(((angle - effect["centre"]) / effect["width"]) ** 2))
    for effect in _pick(effects, "intermittent_drag", name):
        extra += effect["A"] * _switching(motion.time, effect)
    for effect in _pick(effects, "acceleration_friction", name):
        extra += effect["k"] * np.abs(segment_motion(motion.alpha, name))
    return extra


def _switching(time: np.ndarray, effect: Effect) -> np.ndarray:
    """0 or 1 (n,): a cable that rubs now and then; durations exponential, nothing to do with the motion."""
    rng = np.random.default_rng(int(effect["seed"]))
    count = 10 + int(4 * max(time[-1], 1.0) / (effect["on"] + effect["off"]))
    durations = rng.exponential(np.tile([effect["off"], effect["on"]], count))
    return np.searchsorted(np.cumsum(durations), time) % 2.0


def _segment(name: str, machine: Mapping, motion: _Motion, effects, temperature) -> Segment:
    f0, mu = machine["f0"][name], machine["mu"][name]
    for effect in _pick(effects, "load_dependence", name):
        mu = effect["mu"]
    travel = sum(effect["travel"] for effect in _pick(effects, "presliding", name))
    s = motion.bristle(name, travel)
    z, mu_dif = s, 0.0
    for effect in _pick(effects, "load_hysteresis", name):
        z, mu_dif = motion.bristle(name, effect["h"]), effect["mu_dif"]
        if abs(mu_dif) > 2 * (1 - mu) / (1 + mu):
            raise MachineError(f"{effect}: |mu_dif| must not exceed c = {2 * (1 - mu) / (1 + mu):.4g}")
    F0 = 2 * mu / (1 + mu) * _preload(f0, name, motion, s, effects, temperature)
    F0 += _extra_friction(name, motion, effects)
    d = sum(effect["d"] for effect in _pick(effects, "load_nonlinearity", name))
    return Segment(s, z, F0, mu, mu_dif, d)


# --- backwards through the machine ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Truth:
    """What really happens inside the machine at n samples; nothing here is measured.

    tau, tau_H, tau_K : (n, 2) torques of lines 1 and 2 at the motor, after A, after B [N.m]; C : (n, 2) joint torques
    the transmission delivers; C_ref : (n, 2) the reference, without spring and payload; q : (n, 2) joint angles [rad];
    load, dissipated : per segment, mean load and tau_in - tau_out [N.m]; w : per segment, speed [rad/s].
    """

    time: np.ndarray
    theta: np.ndarray
    omega: np.ndarray
    tau: np.ndarray
    tau_H: np.ndarray
    tau_K: np.ndarray
    C: np.ndarray
    C_ref: np.ndarray
    q: np.ndarray
    load: dict
    dissipated: dict
    w: dict


def _joint_torques(motion: _Motion, q: np.ndarray, effects, leg: Leg, inertia: bool) -> tuple[np.ndarray, np.ndarray]:
    """Joint torques (n, 2) the transmission must deliver, and the reference without spring and payload."""
    reference = leg.gravity(q)
    if inertia:
        reference = reference + leg.inertial(q, motion.omega @ _M / (2 * RATIO), motion.alpha @ _M / (2 * RATIO))
    wanted = reference.copy()
    for joint, name in enumerate(("hip", "knee")):
        for effect in _pick(effects, "joint_spring", name):
            wanted[:, joint] += effect["k"] * (q[:, joint] - effect["q0"])
    for effect in _pick(effects, "payload"):
        wanted += leg.payload_gravity(q, effect["m"])
    return wanted, reference


def _backwards(C: np.ndarray, segments: Mapping[str, Segment], effects) -> tuple[np.ndarray, ...]:
    """Torques of the lines (tau, tau_H, tau_K), each (n, 2), and the loads of A and B, from joint torques (n, 2)."""
    total, wanted = C[:, 0] / RATIO, C[:, 1] / RATIO
    cross = {stage: sum(effect["k"] for effect in _pick(effects, "cross_load", f"1{stage}")) for stage in "AB"}
    stage_a, stage_b = [(segments[f"1{stage}"], segments[f"2{stage}"]) for stage in "AB"]

    def through_b(difference):
        tau_H = np.column_stack([total + difference, total - difference]) / 2
        load = _mean_loads(*stage_b, tau_H, "in", cross["B"])
        return tau_H, 2 * load - tau_H, load

    def excess(difference):
        tau_K = through_b(difference)[1]
        return tau_K[:, 0] - tau_K[:, 1] - wanted

    tau_H, tau_K, load_b = through_b(_root(excess, *_bracket(excess, wanted), tolerance=1e-12))
    load_a = _mean_loads(*stage_a, tau_H, "out", cross["A"])
    return 2 * load_a - tau_H, tau_H, tau_K, load_a, load_b


def _joint_angles(motion: _Motion, tau: np.ndarray, load_a: np.ndarray, effects) -> np.ndarray:
    """Joint angles (n, 2) behind soft cables and gaps: t_r M q = theta - e true - (gap / 2) sign(load)."""
    line = motion.theta.copy()
    for i in range(2):
        for effect in _pick(effects, "cable_compliance", f"line{i + 1}"):
            line[:, i] -= effect["e"] * tau[:, i]
        for effect in _pick(effects, "backlash", f"line{i + 1}"):
            line[:, i] -= effect["gap"] / 2 * np.sign(load_a[:, i])
    return line @ _M / (2 * RATIO)


def _truth(machine, motion: _Motion, effects, leg: Leg, inertia: bool, temperature) -> Truth:
    segments = {name: _segment(name, machine, motion, effects, temperature) for name in SEGMENTS}
    q = motion.q
    # Soft cables move the leg, which changes its gravity, which changes the torque: settles within a few rounds.
    for _ in range(4 if any(effect.id in _JOINT_ENCODER for effect in effects) else 1):
        C, reference = _joint_torques(motion, q, effects, leg, inertia)
        tau, tau_H, tau_K, load_a, load_b = _backwards(C, segments, effects)
        q = _joint_angles(motion, tau, load_a, effects)
    return Truth(
        motion.time, motion.theta, motion.omega, tau, tau_H, tau_K, C, reference, q,
        load={"1A": load_a[:, 0], "2A": load_a[:, 1], "1B": load_b[:, 0], "2B": load_b[:, 1]},
        dissipated={"1A": tau[:, 0] - tau_H[:, 0], "2A": tau[:, 1] - tau_H[:, 1],
                    "1B": tau_H[:, 0] - tau_K[:, 0], "2B": tau_H[:, 1] - tau_K[:, 1]},
        w={name: segment_motion(motion.omega, name) for name in SEGMENTS},
    )


def truth(machine: Mapping, trajectory: Trajectory, effects: Iterable[Effect] = (), leg: Leg = Leg(),
          inertia: bool = False, seed: int = 0) -> Truth:
    """Every torque and load inside the machine, without noise and without the effects of the drives.

    Parameters are those of `measure`; the seed only matters for `temperature_dependence`.
    """
    streams = _streams(seed)
    temperature = temperature_signal(trajectory.time, streams["temperature"])
    return _truth(machine, _Motion(trajectory), tuple(effects), leg, inertia, temperature)


# --- what is measured -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the noise.

    `white` and `slow` act on the motor torques [N.m], slow being an Ornstein-Uhlenbeck process with time constant
    `slow_time` [s]; `reference` on C_H and C_K [N.m]; `joint` on the joint encoders [rad]. `resolution` [N.m]: the
    drives report whole multiples of it.
    """

    white: float = 6e-3
    slow: float = 2.4e-3
    slow_time: float = 1.0
    reference: float = 0.0
    joint: float = 5e-5
    resolution: float = 0.0


def slow_noise(time: np.ndarray, deviation: float, slow_time: float, rng: np.random.Generator) -> np.ndarray:
    """A stationary Ornstein-Uhlenbeck process (n,), exact at the (evenly spaced) samples."""
    kept = math.exp(-(time[1] - time[0]) / slow_time)
    shocks = rng.standard_normal(len(time)) * deviation
    shocks[1:] *= math.sqrt(1 - kept**2)
    return lfilter([1.0], [1.0, -kept], shocks)


def temperature_signal(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Temperature (n,) [degC] of a machine that warms up while the room and the drives wander."""
    rise, warm_up = rng.uniform(3.0, 10.0), rng.uniform(80.0, 300.0)
    wander = slow_noise(time, rng.uniform(1.0, 2.0), rng.uniform(30.0, 80.0), rng)
    # A thermal mass of a few seconds stands between the wandering heat and the sensor.
    smooth = math.exp(-(time[1] - time[0]) / 5.0)
    wander = lfilter([1 - smooth], [1.0, -smooth], wander, zi=[wander[0] * smooth])[0]
    return rng.uniform(20.0, 26.0) + rise * (1 - np.exp(-time / warm_up)) + wander


def _streams(seed) -> dict[str, np.random.Generator]:
    """One random stream a purpose, so that an effect never shifts the noise of anything else."""
    if isinstance(seed, np.random.Generator):
        seed = int(seed.integers(2**63))
    names = ("white", "slow1", "slow2", "reference", "joint", "temperature")
    return dict(zip(names, map(np.random.default_rng, np.random.SeedSequence(seed).spawn(len(names)))))


def _reported(true: np.ndarray, motion: _Motion, effects) -> np.ndarray:
    """Torques (n, 2) as the drives report them, before noise."""
    reported = true.copy()
    for i in range(2):
        place = f"motor{i + 1}"
        for effect in _pick(effects, "torque_saturation", place):
            reported[:, i] *= 1 + effect["k"] * true[:, i] ** 2
        for effect in _pick(effects, "torque_constant", place):
            reported[:, i] *= effect["g"]
        for effect in _pick(effects, "rotor_inertia", place):
            reported[:, i] += effect["J"] * motion.alpha[:, i]
        for effect in _pick(effects, "torque_ripple", place):
            reported[:, i] += effect["A"] * np.sin(effect["n"] * motion.theta[:, i] + effect["phase"])
        for effect in _pick(effects, "torque_offset", place):
            reported[:, i] += effect["o"]
    return reported


@dataclass(frozen=True)
class _Log:
    """Everything measured, as arrays: tau, q, C each (n, 2), temperature (n,); theta and omega still exact."""

    tau: np.ndarray
    q: np.ndarray
    C: np.ndarray
    temperature: np.ndarray
    theta: np.ndarray
    omega: np.ndarray


def _log(machine, now: _Motion, effects, noise: Noise, seed, leg=Leg(), inertia=False, sensor=False) -> _Log:
    """The measurement at the motion's samples; the noise of a sample does not depend on which others are picked."""
    streams, trajectory, pick = _streams(seed), now._trajectory, now._pick
    time = trajectory.time
    temperature = temperature_signal(time, streams["temperature"])
    delay = sum(effect["d"] for effect in _pick(effects, "time_delay"))
    # The delay is exact: the drives report the machine of `delay` seconds ago, computed there and not interpolated.
    then = _Motion(trajectory, pick, delay) if delay else now
    past = _truth(machine, then, effects, leg, inertia, temperature)
    if delay and any(effect.id in _JOINT_ENCODER for effect in effects):
        present = _truth(machine, now, effects, leg, inertia, temperature)
        q, C, reference = present.q, present.C, present.C_ref
    elif delay:
        q, (C, reference) = now.q, _joint_torques(now, now.q, effects, leg, inertia)
    else:
        q, C, reference = past.q, past.C, past.C_ref
    tau_noise = noise.white * streams["white"].standard_normal((len(time), 2)) + np.column_stack(
        [slow_noise(time, noise.slow, noise.slow_time, streams[name]) for name in ("slow1", "slow2")])
    C_noise = noise.reference * streams["reference"].standard_normal((len(time), 2))
    q_noise = noise.joint * streams["joint"].standard_normal((len(time), 2))
    tau = _reported(past.tau, then, effects) + tau_noise[pick]
    return _Log(
        tau=np.round(tau / noise.resolution) * noise.resolution if noise.resolution else tau,
        q=q + q_noise[pick],
        C=(C if sensor else reference) + C_noise[pick],
        temperature=temperature[pick], theta=now.theta, omega=now.omega,
    )


EXTRA_COLUMNS = ("q", "omega", "temperature")


def measure(machine: Mapping, trajectory: Trajectory, effects: Iterable[Effect] = (), noise: Noise = Noise(),
            counts: int = 2**14, rng=0, extra: Iterable[str] = (), reference: str | None = "gravity_model",
            leg: Leg = Leg(), inertia: bool = False) -> pd.DataFrame:
    """The log of a run: the columns of the hip-knee log.

    Parameters
    ----------
    machine : mapping
        `f0` [N.m] and `mu` [1] of the four segments, as `PAPER`.
    trajectory : Trajectory
        The prescribed motion.
    effects : iterable of Effect
        What the base model does not know.
    noise : Noise
        Standard deviations.
    counts : int
        Encoder counts a motor turn; `theta1`, `theta2` are whole counts.
    rng : int or numpy.random.Generator
        The same seed gives the same noise and temperature whatever the effects.
    extra : iterable of {"q", "omega", "temperature"}
        Optional columns; joint encoders and temperature come by themselves where an effect needs them.
    reference : {"gravity_model", "sensor", None}
        What C_H and C_K are: the torque of the leg as designed; what the transmission really delivers (they differ by
        `joint_spring` and `payload` only); or no columns.
    leg : Leg
        The driven leg.
    inertia : bool
        Whether the leg's inertia counts (the paper: slow, gravity alone).

    Returns
    -------
    pandas.DataFrame
        SI units, one row a sample.

    Raises
    ------
    MachineError
        An unknown option, or an effect too strong for the law to have an answer.
    """
    effects, extra = tuple(effects), set(extra)
    if unknown := extra - set(EXTRA_COLUMNS):
        raise MachineError(f"no extra column '{min(unknown)}'{_closest(min(unknown), EXTRA_COLUMNS)}")
    if reference not in ("gravity_model", "sensor", None):
        raise MachineError(f"no reference '{reference}'{_closest(reference, ('gravity_model', 'sensor'))}")
    log = _log(machine, _Motion(trajectory), effects, noise, rng, leg, inertia, reference == "sensor")
    return _frame(log, trajectory, effects, counts, extra, reference)


def _frame(log: _Log, trajectory: Trajectory, effects, counts: int, extra: set, reference: str | None) -> pd.DataFrame:
    """The log as a table: angles in whole counts, optional columns only where asked for or needed."""
    step = 2 * np.pi / counts
    columns = {"time": trajectory.time, "theta1,theta2": np.round(log.theta / step) * step}
    if "omega" in extra:
        columns["omega1,omega2"] = log.omega
    columns["tau1,tau2"] = log.tau
    if "q" in extra or any(effect.id in _JOINT_ENCODER for effect in effects):
        columns["q_H,q_K"] = log.q
    if reference is not None:
        columns["C_H,C_K"] = log.C
    if "temperature" in extra or _pick(effects, "temperature_dependence"):
        columns["temperature"] = log.temperature
    frame = pd.DataFrame({name: column for names, values in columns.items()
                          for name, column in zip(names.split(","), np.atleast_2d(values.T))})
    frame["manoeuvre"] = trajectory.manoeuvre.astype(str)
    return frame


def drop_out(frame: pd.DataFrame, share: float, rng: np.random.Generator, longest: float = 0.5) -> pd.DataFrame:
    """The log of a recorder that now and then misses samples in a row.

    Parameters
    ----------
    frame : pandas.DataFrame
        A log with a `time` column [s].
    share : float
        Of the samples that are missed, about.
    rng : numpy.random.Generator
    longest : float
        Gaps are drawn up to this long [s].
    """
    time = frame["time"].to_numpy()
    gaps = rng.uniform(0.0, longest, int(2 * share * (time[-1] - time[0]) / longest))
    begins = rng.uniform(time[0], time[-1], len(gaps))
    lost = np.zeros(len(time), dtype=bool)
    for begin, gap in zip(begins, gaps):
        lost |= (time > begin) & (time < begin + gap)
    return frame[~lost].reset_index(drop=True)


def write_csv(frame: pd.DataFrame, path) -> None:
    """Write a log as CSV, ten significant digits."""
    frame.to_csv(path, index=False, float_format="%.10g")


# --- the base model, and the size of an effect ------------------------------------------------------------------------


def _forward(tau: np.ndarray, s: np.ndarray, f0: float, mu: float) -> tuple[np.ndarray, ...]:
    """Torque out of a sliding segment, and its derivatives to tau, f0 and mu, each (n,)."""
    direct = (tau > s * mu * f0 / (1 + mu)) == (s > 0)
    out = np.where(direct, mu * (tau - s * f0), tau / mu - s * f0)
    by_tau, by_f0 = np.where(direct, mu, 1 / mu), np.where(direct, -mu * s, -s)
    return out, by_tau, by_f0, np.where(direct, tau - s * f0, -tau / mu**2)


def base_torques(tau: np.ndarray, omega: np.ndarray, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Joint torques of the base model from measured motor torques, and their derivatives.

    Parameters
    ----------
    tau, omega : ndarray, shape (n, 2)
        Motor torques [N.m] and speeds [rad/s]; every segment moves.
    parameters : ndarray, shape (8,)
        f0 then mu, in the order of `SEGMENTS`.

    Returns
    -------
    C : ndarray, shape (n, 2)
        Hip and knee torque [N.m].
    jacobian : ndarray, shape (n, 2, 8)
    """
    C, jacobian = np.zeros((len(tau), 2)), np.zeros((len(tau), 2, 8))
    for line in range(2):
        a, b = line, line + 2
        sign_a, sign_b = (np.sign(segment_motion(omega, SEGMENTS[k])) for k in (a, b))
        tau_H, _, *by_a = _forward(tau[:, line], sign_a, parameters[a], parameters[4 + a])
        tau_K, gain, *by_b = _forward(tau_H, sign_b, parameters[b], parameters[4 + b])
        crossed = RATIO * (1 - 2 * line)
        C += np.column_stack([RATIO * tau_H, crossed * tau_K])
        for offset, d_a, d_b in zip((0, 4), by_a, by_b):
            jacobian[:, 0, a + offset] = RATIO * d_a
            jacobian[:, 1, a + offset] = crossed * gain * d_a
            jacobian[:, 1, b + offset] = crossed * d_b
    return C, jacobian


def fit_base(tau: np.ndarray, omega: np.ndarray, C: np.ndarray, base_mu_fixed: Iterable[str] = (),
             guess: np.ndarray | None = None) -> np.ndarray:
    """The eight parameters of the base model that fit joint torques best, f0 >= 0 and 0.3 < mu <= 1.

    Parameters
    ----------
    tau, omega, C : ndarray, shape (n, 2)
        Measured motor torques, motor speeds and reference joint torques, moving samples.
    base_mu_fixed : iterable of str
        Segments without a load term: mu = 1.
    guess : ndarray, shape (8,), optional
        Where the search starts.

    Returns
    -------
    ndarray, shape (8,)
        f0 [N.m] then mu [1], in the order of `SEGMENTS`.
    """
    held = set(base_mu_fixed)
    free = np.array([True] * 4 + [name not in held for name in SEGMENTS])
    full = np.array([0.06, 0.06, 0.01, 0.01, 0.92, 0.92, 0.97, 0.97]) if guess is None else guess.copy()
    full[4:][~free[4:]] = 1.0

    def complete(x):
        full[free] = x
        return full

    low, high = np.array([0.0] * 4 + [0.3] * 4)[free], np.array([np.inf] * 4 + [1.0] * 4)[free]
    result = least_squares(
        lambda x: (base_torques(tau, omega, complete(x))[0] - C).ravel(), full[free], bounds=(low, high), x_scale="jac",
        jac=lambda x: base_torques(tau, omega, complete(x))[1].reshape(-1, 8)[:, free], ftol=1e-9, xtol=1e-9)
    return complete(result.x).copy()


def _base_errors(log: _Log, parameters: np.ndarray) -> dict[str, float]:
    """RMSE of the fitted base model: C_H, C_K [N.m], and q_H, q_K [rad] with one free zero each."""
    error = base_torques(log.tau, log.omega, parameters)[0] - log.C
    angle = log.q - log.theta @ _M / (2 * RATIO)
    values = np.concatenate([np.sqrt(np.mean(error**2, axis=0)), np.std(angle, axis=0)])
    return dict(zip(("C_H", "C_K", "q_H", "q_K"), values.tolist()))


def _held_mu(effects: Sequence[Effect], machine: Mapping, base_mu_fixed) -> tuple[str, ...]:
    """The segments whose mu the study keeps at 1; all of them by default where load dependence is what is hidden."""
    hidden = _pick(effects, "load_dependence")
    held = tuple(SEGMENTS if hidden else ()) if base_mu_fixed is None else tuple(base_mu_fixed)
    if hidden and any(machine["mu"][name] != 1.0 for name in held):
        raise MachineError("load_dependence hides only from a base with mu = 1: use without_load_dependence(machine)")
    return held


class _Yardstick:
    """Sizes of effects on one machine, motion and noise; the data without effect are fitted once."""

    def __init__(self, machine, trajectory, noise, seed, base_mu_fixed, subsample, leg):
        self._machine, self._held = machine, base_mu_fixed
        self._motion = _Motion(trajectory, np.flatnonzero(trajectory.moving)[::subsample])
        self._options = dict(noise=noise, seed=seed, leg=leg)
        self._guess: np.ndarray | None = None
        self.without = self._errors(())

    def _errors(self, effects) -> dict[str, float]:
        log = _log(self._machine, self._motion, effects, **self._options)
        parameters = fit_base(log.tau, log.omega, log.C, self._held, self._guess)
        if self._guess is None:
            self._guess = parameters
        return _base_errors(log, parameters)

    def size(self, effects: Sequence[Effect]) -> float:
        """Error with the effects over error without, in the worse channel."""
        errors = self._errors(tuple(effects))
        return max(errors[name] / self.without[name] for name in errors if self.without[name] > 0)


def size_of(effects: Effect | Iterable[Effect], machine: Mapping, trajectory: Trajectory, noise: Noise = Noise(),
            seed: int = 0, base_mu_fixed: Iterable[str] | None = None, subsample: int = 4, leg: Leg = Leg()) -> float:
    """How much the effect spoils the refitted base model: RMSE with it / RMSE without it, in the worse channel.

    Parameters
    ----------
    effects : Effect or iterable of Effect
        What is hidden in the data.
    machine, trajectory, noise, seed, leg
        As for `measure` (seed is its `rng`).
    base_mu_fixed : iterable of str, optional
        Segments whose mu the study fixes at 1. Default: all with `load_dependence`, else none.
    subsample : int
        Every so many moving samples count; effects that live in transients always use all.

    Returns
    -------
    float
        1 means nothing to see. Channels C_H and C_K, and the joint encoders (which only compliance and backlash touch).
    """
    effects = (effects,) if isinstance(effects, Effect) else tuple(effects)
    held = _held_mu(effects, machine, base_mu_fixed)
    if any(effect.id in _TRANSIENT for effect in effects):
        subsample = 1
    return _Yardstick(machine, trajectory, noise, seed, held, subsample, leg).size(effects)


def calibrate(effect: Effect, size: float, machine: Mapping, trajectory: Trajectory, noise: Noise = Noise(),
              seed: int = 0, base_mu_fixed: Iterable[str] | None = None, subsample: int = 4,
              leg: Leg = Leg()) -> Effect:
    """The effect with the amplitude that gives it a wanted size.

    Parameters
    ----------
    effect : Effect
        Place, secondary coefficients and signs; its amplitude is where the search starts. `draw` makes one.
    size : float
        Wanted `size_of`, > 1.
    machine, trajectory, noise, seed, base_mu_fixed, subsample, leg
        As for `size_of`.

    Returns
    -------
    Effect

    Raises
    ------
    UnreachableSizeError
        No amplitude within the limits of `KINDS` is that strong; says and carries the largest size met.
    """
    if not size > 1.0:
        raise MachineError(f"size {size:g}: an effect that shows has a size above 1")
    if effect.id in _TRANSIENT:
        subsample = 1
    held = _held_mu((effect,), machine, base_mu_fixed)
    yardstick = _Yardstick(machine, trajectory, noise, seed, held, subsample, leg)
    low, high = _enclose(effect, size, yardstick)
    wanted = brentq(lambda x: yardstick.size([effect.scaled(math.exp(x))]) - size, low, high, xtol=1e-3)
    return effect.scaled(math.exp(wanted))


def _enclose(effect: Effect, size: float, yardstick: _Yardstick) -> tuple[float, float]:
    """Logarithms of two amplitudes, one too weak and one strong enough."""
    kind = KINDS[effect.id]
    below = above = min(max(effect.amplitude, kind.low), kind.high)
    largest = yardstick.size([effect.scaled(above)])
    if largest >= size:
        while below > kind.low:
            above, below = below, below / 3
            if yardstick.size([effect.scaled(below)]) < size:
                return math.log(below), math.log(above)
        raise UnreachableSizeError(f"{effect}: size {size:g} is passed at any amplitude above {kind.low:g}", largest)
    while above < kind.high:
        below, above = above, min(above * 2, kind.high)
        try:
            reached = yardstick.size([effect.scaled(above)])
        except MachineError:
            break  # beyond this amplitude the law has no answer: a limit like `kind.high`
        if reached >= size:
            return math.log(below), math.log(above)
        largest = max(largest, reached)
    raise UnreachableSizeError(f"{effect}: size {size:g} cannot be reached up to amplitude {above:.3g}; "
                               f"largest: {largest:.3f}", largest)


# --- random effects ---------------------------------------------------------------------------------------------------


def _log_uniform(rng, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def _sign(rng) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _drawn_preload(rng, place):
    angle = rng.uniform(0, 2 * np.pi)
    k = 2e-3 * np.array([math.cos(angle), math.sin(angle)])
    # A path that tightens: slackening soon ends at the floor f0 = 0, where the base model fits the rest.
    if k @ np.array([1.1, -0.75]) < 0:
        k = -k
    return dict(k_H=k[0], k_K=k[1])


def _drawn_bump(rng, place):
    # Within the angles all three lines of the default start pass on their faster speeds.
    motor = int(rng.integers(1, 3))
    start = RATIO * _M @ np.array([0.9, -0.85])
    reach = (0.5, 5.0) if motor == 1 else (-6.0, 5.0)
    return dict(A=5e-3, centre=start[motor - 1] + rng.uniform(*reach), width=rng.uniform(0.3, 1.5), motor=motor)


_DRAWS = {
    "viscous": lambda rng, place: dict(b=2e-3),
    "stribeck": lambda rng, place: dict(fs=2e-3, ws=_log_uniform(rng, 0.15, 1.2)),
    "presliding": lambda rng, place: dict(travel=0.01),
    "direction_asymmetry": lambda rng, place: dict(a=0.02 * _sign(rng)),
    "configuration_preload": _drawn_preload,
    "load_dependence": lambda rng, place: dict(mu=0.995),
    "load_nonlinearity": lambda rng, place: dict(d=5e-3),
    "load_hysteresis": lambda rng, place: dict(h=0.02, mu_dif=0.02 * rng.uniform(-0.03, 0.03)),
    "cross_load": lambda rng, place: dict(k=5e-3),
    "torque_ripple": lambda rng, place: dict(A=2e-3, n=rng.uniform(1.0, 16.0), phase=rng.uniform(0, 2 * np.pi)),
    "thermal_drift": lambda rng, place: dict(k=0.05, T=_log_uniform(rng, 40.0, 300.0)),
    "temperature_dependence": lambda rng, place: dict(k=5e-3 * _sign(rng)),
    "torque_constant": lambda rng, place: dict(g=1 + 5e-3 * _sign(rng)),
    "torque_offset": lambda rng, place: dict(o=2e-3 * _sign(rng)),
    "torque_saturation": lambda rng, place: dict(k=2e-3 * _sign(rng)),
    "rotor_inertia": lambda rng, place: dict(J=2e-4),
    "time_delay": lambda rng, place: dict(d=2e-3),
    "joint_spring": lambda rng, place: dict(k=0.05, q0=rng.uniform(-0.5, 0.5)),
    "payload": lambda rng, place: dict(m=0.01),
    "cable_compliance": lambda rng, place: dict(e=2e-4),
    "backlash": lambda rng, place: dict(gap=2e-4),
    "bump": _drawn_bump,
    "intermittent_drag": lambda rng, place: dict(A=5e-3, on=rng.uniform(3.0, 15.0), off=rng.uniform(10.0, 40.0),
                                                 seed=int(rng.integers(2**31))),
    "acceleration_friction": lambda rng, place: dict(k=1e-3),
}


def draw(effect_id: str, place: str, rng: np.random.Generator) -> Effect:
    """An effect with random secondary coefficients and signs, still weak; `calibrate` then sets its amplitude.

    Parameters
    ----------
    effect_id, place : str
        As for `Effect`.
    rng : numpy.random.Generator
        Drawn continuously: Stribeck speed 0.15 to 1.2 rad/s, ripple 1 to 16 cycles a turn (real) and any phase, thermal
        time 40 to 300 s, any direction of the preload in (q_H, q_K), and so on.

    Raises
    ------
    MachineError
        The effect or place does not exist.
    """
    if effect_id not in KINDS:
        raise MachineError(f"no effect '{effect_id}'{_closest(effect_id, KINDS)}")
    return Effect(effect_id, place, **_DRAWS[effect_id](rng, place))

"""In: what is true, and a world of sensors. Out: the columns of a log: noise, steps, filters, errors and spikes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.signal import lfilter


@dataclass(frozen=True)
class World:
    """Sensors of a machine; every number is drawn or set by `cases`.

    Parameters
    ----------
    motor_bits, joint_bits, current_bits : int or None
        Steps of the encoders a turn and of the current over its range, as powers of two. Without `joint_bits` the log
        has no joint encoders; None elsewhere is exact.
    speed : bool
        Whether the drives report speeds.
    slow : float
        Size of slow noise over that of white noise.
    outliers : float
        Share of samples of torques that are spikes.
    grows : {"", "speed", "load"}
        With what the torques' noise grows, fivefold over its range.
    part_noise : tuple of float
        Factor on the noise in each run.
    low_pass : dict of str to float
        Corner frequency, Hz, by "tau" or "C".
    reference : {"sensor", "gravity_model", "none"}
        Where the joints' torques come from.
    reference_error : dict of str to float
        Of the load model or sensor: a scale of a parameter as ``m1``, ``zero`` [rad], ``gain`` [1], ``offset`` [N.m].
    reference_joint : int
        Joint whose zero, gain or offset is wrong.
    digits : int
        Digits of the recorded numbers after the point.
    noise : float
        Factor on all noise.
    jitter : float
        By how much of an interval a sample comes earlier or later at most; its time is known.
    stands : dict of str to int
        Rows for which readings stand, by "tau", "C" or "all".
    """

    motor_bits: int | None = None
    joint_bits: int | None = None
    current_bits: int | None = None
    speed: bool = True
    slow: float = 0.4
    slow_time: float = 1.0
    outliers: float = 0.0
    grows: str = ""
    part_noise: tuple = (1.0,)
    low_pass: dict = field(default_factory=dict)
    reference: str = "sensor"
    reference_error: dict = field(default_factory=dict)
    reference_joint: int = 0
    digits: int = 6
    noise: float = 1.0
    jitter: float = 0.0
    stands: dict = field(default_factory=dict)


def quantised(x, step, rng=None):
    """Values in steps; with a generator, the zero of the steps is drawn."""
    shift = rng.uniform(0, step) if rng is not None else 0.0
    return np.round((x - shift) / step) * step + shift


def coloured(rng, n, white, slow, slow_time, dt):
    """White noise plus noise that changes over `slow_time` seconds."""
    keep = np.exp(-dt / slow_time)
    drift = lfilter([np.sqrt(1 - keep ** 2)], [1, -keep], rng.standard_normal(n))
    return white * rng.standard_normal(n) + slow * drift


def low_passed(x, corner, dt):
    """Through a first-order lag with a corner frequency, at rest before."""
    keep = np.exp(-2 * np.pi * corner * dt)
    return lfilter([1 - keep], [1, -keep], x, zi=[keep * x[0]])[0]


def reference(plant, truth, motion, world):
    """Torques that the joints are said to have: true ones, or those of a load model that may be wrong."""
    C = np.array(truth.C)
    error, k = dict(world.reference_error), world.reference_joint
    zero, gain, offset = error.pop("zero", 0.0), error.pop("gain", 0.0), error.pop("offset", 0.0)
    if world.reference == "gravity_model":
        q = [np.array(x) for x in plant.lay(motion)[0]]
        q[0][k] += zero
        C = plant.torques(q, {n: plant.load[n] * (1 + share) for n, share in error.items()})
    C[k] = C[k] * (1 + gain) + offset
    return C


def record(plant, truth, motion, world, seed):
    """The columns of a log.

    Parameters
    ----------
    plant : machines.HipKnee
    truth : machines.Truth
    motion : Motion
    world : World
    seed : int
        Noise, spikes and zeros of steps: the same whatever the machine hides.

    Returns
    -------
    dict of str to ndarray
        In the order of the file.
    """
    dt, n = truth.time[1] - truth.time[0], len(truth.time)
    stream = {name: np.random.default_rng([seed, k]) for k, name in enumerate(
        ("tau", "C", "q", "theta", "spikes", "clock"))}
    if world.jitter:
        truth = _jittered(truth, world.jitter * dt, stream["clock"])
    shape = _shape(truth, world, n)
    log = {"time": np.round(truth.time, 6)}
    theta = _encoded(truth.theta, world.motor_bits, plant.turn, stream["theta"])
    log.update(zip(plant.columns["theta"], theta))
    if world.speed:
        log.update(zip(plant.columns["omega"], [np.round(x, 3 if plant.speed > 0.5 else 5) for x in truth.omega]))
    tau = _noisy(truth.measured, plant.torque_noise * world.noise, world, shape, stream["tau"], dt)
    tau = [low_passed(x, world.low_pass["tau"], dt) for x in tau] if "tau" in world.low_pass else tau
    if world.current_bits:
        tau = [quantised(x, 2 * 1.3 * abs(truth.tau[k]).max() / 2 ** world.current_bits)
               for k, x in enumerate(tau)]
    C = []
    if world.reference != "none":
        C = reference(plant, truth, motion, world)
        C = _noisy(C, plant.reference_noise * world.noise, world, shape, stream["C"], dt)
        C = [low_passed(x, world.low_pass["C"], dt) for x in C] if "C" in world.low_pass else C
    if world.outliers:
        tau, C = (_spiked(x, world.outliers, noise, stream["spikes"])
                  for x, noise in ((tau, plant.torque_noise), (C, plant.reference_noise)))
    log.update(zip(plant.columns["tau"], tau))
    if world.joint_bits:
        log.update(zip(plant.columns["q"], _encoded(truth.q, world.joint_bits, 2 * np.pi, stream["q"])))
    log.update(zip(plant.columns["C"], C))
    for kind, rows in world.stands.items():
        log.update({name: log[name][np.arange(n) // rows * rows] for name in log
                    if name != "time" and kind in ("all", *(k for k in plant.columns if name in plant.columns[k]))})
    if np.ptp(truth.temperature) > 0:
        log["temperature"] = np.round(truth.temperature, 2)
    return {name: np.round(x, world.digits) for name, x in log.items()}


def _jittered(truth, most, rng):
    """What is true at times that come earlier or later than even ones, straight between those."""
    time = truth.time + rng.uniform(-most, most, len(truth.time))
    return replace(truth, time=time, **{name: np.array([np.interp(time, truth.time, x) for x in getattr(truth, name)])
                                        for name in ("theta", "omega", "q", "measured", "C")})


def _encoded(angles, bits, turn, rng):
    if not bits:
        return list(angles)
    return [quantised(x, turn / 2 ** bits, rng) for x in angles]


def _shape(truth, world, n):
    """Factor on the torques' noise at each sample."""
    shape = np.repeat(world.part_noise, -(-n // len(world.part_noise)))[:n].astype(float)
    if world.grows:
        first = next(iter(truth.segments))
        x = abs(truth.segments[first].w if world.grows == "speed" else truth.loads[first])
        shape = shape * (1 + 4 * x / x.max())
    return shape


def _noisy(values, white, world, shape, rng, dt):
    return [x + shape * coloured(rng, len(x), white, world.slow * white, world.slow_time, dt) for x in values]


def _spiked(values, share, noise, rng):
    """Single samples off by ten to sixty times the noise, as lost bits or bus errors make them."""
    found = []
    for x in values:
        x = np.array(x)
        hit = np.flatnonzero(rng.random(len(x)) < share)
        x[hit] += rng.choice((-1, 1), len(hit)) * rng.uniform(10, 60, len(hit)) * noise
        found.append(x)
    return found

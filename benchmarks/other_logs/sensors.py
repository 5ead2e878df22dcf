"""In: what a run would show exactly, and its sensors. Out: the columns of its log: noise, steps, filters, spikes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from benchmarks.other_logs.machine import RATIO, lagged

FORMATS = {"time": "%.5f", "theta": "%.6f", "tau": "%.4f", "omega": "%.4f", "q": "%.7f", "C": "%.3f"}
"""Digits of the columns, by how their names begin."""


@dataclass
class Sensors:
    """Sensors of a rig.

    Parameters
    ----------
    joint_encoders, speeds, computed : bool
        Whether the log has angles of the joints and speeds of the motors; whether the reference is a load model's.
    motor_bits, joint_bits, torque_bits : int
        Steps of an encoder a turn, and of the torques over their range, as powers of two.
    noise_share : float
        Noise of the torques over half their mean size.
    reference_noise, reference_drift, drift_time : float
        White and slow noise of the reference, N.m; time in which the slow one changes, s.
    speed_filter : float
        Time constant of the filter of the speeds, s.
    zeros : ndarray, shape (2,)
        Errors of the joint encoders' zeros, rad.
    torque_step, torque_noise : float
        N.m; known when the torques are.
    """

    joint_encoders: bool
    speeds: bool
    computed: bool
    motor_bits: int
    joint_bits: int
    torque_bits: int
    noise_share: float
    reference_noise: float
    reference_drift: float
    drift_time: float
    speed_filter: float
    zeros: np.ndarray
    torque_step: float = 0.0
    torque_noise: float = 0.0

    def suited(self, readings, rng):
        """Set range and noise of the torques by what they have to measure.

        Parameters
        ----------
        readings : ndarray, shape (n, 2)
        rng : numpy.random.Generator

        Returns
        -------
        Sensors
            Itself.
        """
        self.torque_step = 2 * np.max(abs(readings)) * rng.uniform(1.5, 4) / 2 ** self.torque_bits
        self.torque_noise = self.noise_share * max(np.sqrt(np.mean(readings ** 2)), 0.3) * 2
        return self

    @property
    def floor(self):
        """Noise of torques at the joints that no model explains, N.m."""
        torques = np.hypot(self.torque_noise, self.torque_step / np.sqrt(12)) * RATIO * np.sqrt(2)
        return torques if self.computed else np.hypot(torques, np.hypot(self.reference_noise, self.reference_drift))

    @property
    def angle_floor(self):
        """Noise of angles at the joints, rad."""
        joint, motor = 2 * np.pi / 2 ** self.joint_bits, 2 * np.pi / 2 ** self.motor_bits / (2 * RATIO)
        return np.sqrt(joint ** 2 / 12 + motor ** 2 / 6)


def drawn(rng, joint_encoders, computed):
    """Random sensors.

    Parameters
    ----------
    rng : numpy.random.Generator
    joint_encoders : bool
        Whether there must be some; half of the rigs have them anyway.
    computed : bool
        Whether the reference is a load model's.

    Returns
    -------
    Sensors
    """
    joint_encoders = bool(rng.random() < 0.5) or joint_encoders
    found = Sensors(
        joint_encoders=joint_encoders, computed=computed, speeds=bool(rng.choice([False, True, True])),
        motor_bits=int(rng.integers(12, 19)), joint_bits=int(rng.integers(12, 21)),
        torque_bits=int(rng.integers(8, 13)), noise_share=rng.uniform(0.005, 0.015),
        reference_noise=rng.uniform(0.1, 0.3), reference_drift=rng.uniform(0.1, 0.3), drift_time=rng.uniform(0.2, 2),
        speed_filter=rng.uniform(0.004, 0.02), zeros=rng.uniform(-0.02, 0.02, 2))
    rng.random()  # nothing uses it: a seed's logs stay as they have been
    return found


def record(run, truth, sensors, spikes, rng):
    """The columns of a run's log.

    Parameters
    ----------
    run : Run
    truth : Truth
    sensors : Sensors
    spikes : bool
        Whether single samples of torques and reference are far off.
    rng : numpy.random.Generator

    Returns
    -------
    dict of str to ndarray
        In the order of the file.
    """
    kept = slice(rng.integers(0, run.every), None, run.every)
    tau = truth.readings[kept]
    tau = _stepped(tau + rng.normal(size=tau.shape) * sensors.torque_noise, sensors.torque_step)
    C = truth.reference[kept].copy()
    if not sensors.computed:
        for k in (0, 1):
            C[:, k] += _noise(rng, len(C), sensors, 1 / run.rate)
    if spikes:
        for column in (tau, C):
            _spike(column, rng)
    encoded = _stepped(truth.theta, 2 * np.pi / 2 ** sensors.motor_bits)
    log = {"time": run.time[kept], **_pair("theta", "12", encoded[kept]), **_pair("tau", "12", tau)}
    if sensors.speeds:
        moved = np.diff(encoded, axis=0, prepend=encoded[:1]) / run.dt
        speeds = np.column_stack([lagged(w, sensors.speed_filter, run.dt) for w in moved.T])
        log |= _pair("omega", "12", speeds[kept])
    if sensors.joint_encoders:
        log |= _pair("q_", "HK", _stepped(run.q[kept] + sensors.zeros, 2 * np.pi / 2 ** sensors.joint_bits))
    return log | _pair("C_", "HK", C)


def written(path, log):
    """Write a log as CSV.

    Parameters
    ----------
    path : Path
    log : dict of str to ndarray, shape (n,)
    """
    formats = [next(f for start, f in FORMATS.items() if name.startswith(start)) for name in log]
    np.savetxt(path, np.column_stack(list(log.values())), delimiter=",", header=",".join(log), comments="",
               fmt=formats)


def _stepped(x, step):
    return np.round(x / step) * step


def _pair(name, ends, values):
    return dict(zip((name + end for end in ends), values.T))


def _noise(rng, n, sensors, dt):
    """Slow noise, which begins as it goes on, and white noise."""
    keep = np.exp(-dt / sensors.drift_time)
    steps = rng.normal(size=n) * sensors.reference_drift * np.sqrt(1 - keep ** 2)
    steps[0] = rng.normal() * sensors.reference_drift
    return lfilter([1], [1, -keep], steps) + rng.normal(size=n) * sensors.reference_noise


def _spike(column, rng):
    """One sample in a thousand, two at least, off by about eight times what the torques vary by."""
    at = rng.integers(0, len(column), max(len(column) // 1000, 2))
    column[at, rng.integers(0, 2, len(at))] += rng.normal(size=len(at)) * 8 * column.std()

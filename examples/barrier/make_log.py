"""Make the log of a road barrier, for want of a real one: the machine of Barrier.mo with an effect that it lacks.

    python examples/barrier/make_log.py FOLDER        writes FOLDER/monday.csv

The arm is lifted and lowered at four speeds, three times. The log is as a drive and a sensor amplifier would leave it:
time in ms, motor angle in degrees and current in A, torque of the arm in N.m; encoder steps and noise included. What
is hidden stands in HIDDEN.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from pycosim.compile import Library, compile_model, component_name
from pycosim.dynamics.simulate import compensate, estimate

RIG = Path(__file__).parent / "Barrier.mo"
HIDDEN = ("torque_ripple", "motor", {"A": 0.02, "n": 1.0, "phase": 0.6})  # N.m, cycles a revolution, rad
MACHINE = {"worm.f0": 0.08, "worm.mu": 0.82, "worm.travel": 1e-5}  # slides at once: no second hidden effect
K_M, RATIO, RATE = 0.11, 40, 100.0  # N.m/A; -; Hz
SPEEDS, REPEATS, LOW, HIGH, REST = (0.1, 0.2, 0.4, 0.8), 3, 0.3, 2.8, 0.5  # of the arm: rad/s, -, rad, rad; s
QUANTUM, WHITE_A, WHITE_C = 2 * np.pi / 4096, 0.03, 0.15  # encoder [rad]; noise of current [A] and sensor [N.m]


def motion():
    """Angle of the arm [rad] over time [s]: half a second of speeding up and slowing down, rests in between.

    Returns
    -------
    time, angle : ndarray, shape (n,)
    """
    ramp = np.linspace(0, 1, int(0.5 * RATE))
    rest, speed = np.zeros(int(REST * RATE)), []
    for v in [v for _ in range(REPEATS) for v in SPEEDS]:
        cruise = np.ones(int(RATE * ((HIGH - LOW) / v - 0.5)))
        there = v * np.concatenate([ramp, cruise, ramp[::-1]])
        speed += [rest, there, rest, -there]
    angle = LOW + np.cumsum(np.concatenate([*speed, rest])) / RATE
    return np.arange(len(angle)) / RATE, angle


def record(rng):
    """What the drive and the amplifier would log.

    Parameters
    ----------
    rng : numpy.random.Generator

    Returns
    -------
    pandas.DataFrame
    """
    effect, place, coefficients = HIDDEN
    model = compile_model(Library([RIG]), "Barrier", [(effect, place)])
    values = {**MACHINE, **{f"{component_name(*model.attached[0])}.{n}": v for n, v in coefficients.items()}}
    time, angle = motion()
    moved = {"motor.phi": RATIO * angle}
    torque = compensate(model, {**moved, "push": 0.0}, time, values)["motor.tau"]
    sensed = estimate(model, {**moved, "motor.tau": torque}, time, values)["C"]
    n = len(time)
    return pd.DataFrame({
        "t": np.round(1e3 * time),
        "motor_angle": np.rad2deg(np.round(RATIO * angle / QUANTUM) * QUANTUM),
        "current": torque / K_M + WHITE_A * rng.standard_normal(n),
        "arm_torque": sensed + WHITE_C * rng.standard_normal(n)})


def main():
    """Write the log."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    folder.mkdir(parents=True, exist_ok=True)
    record(np.random.default_rng(1)).to_csv(folder / "monday.csv", index=False, float_format="%.7g")
    print(f"Written: {folder / 'monday.csv'}")


if __name__ == "__main__":
    main()

"""Make the log of a road barrier, for want of a real one: the machine of Barrier.mo with an effect that it lacks.

    python examples/barrier/make_log.py FOLDER [KIND]              writes FOLDER/monday.csv
    python examples/barrier/make_log.py FOLDER KIND plan.csv       the same machine moved as planned: FOLDER/tuesday.csv

The arm is lifted and lowered at four speeds, three times. The log is as a drive and a sensor amplifier would leave it:
time in ms, motor angle in degrees and current in A, torque of the arm in N.m; encoder steps and noise included. What
is hidden stands in HIDDEN. KIND is another machine or another log, for another verdict: see KINDS.
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
UNEVEN = ("viscous_asymmetry", "worm", {"b_a": 1e-4})  # N.m.s/rad: the worm loses more on the way up
KINDS = {
    "ripple": "the default: the worm runs out of true",
    "nothing": "the machine is as its model says",
    "rivals": "a friction that grows with speed, in a log of two speeds",
    "alike": "the worm loses more on the way up the faster it turns, in a log of one speed",
    "unknown": "rubs at one angle of the arm, which no effect of the library does",
    "wiring": "nothing is missing, but the current is recorded with the other sign",
    "poor": "the ripple, in a log of one slow pass up",
}
RUB, RUB_AT, RUB_WIDE = 0.12, 1.4, 0.08  # N.m at the motor, more where the arm is at so many rad, over so many
QUANTUM, WHITE_A, WHITE_C = 2 * np.pi / 4096, 0.03, 0.15  # encoder [rad]; noise of current [A] and sensor [N.m]


def motion(speeds=SPEEDS, repeats=REPEATS, back=True, ramp=0.5):
    """Angle of the arm [rad] over time [s]: speeding up and slowing down, rests in between.

    Parameters
    ----------
    speeds : sequence of float
        [rad/s]
    repeats : int
    back : bool
        Whether the arm is lowered again.
    ramp : float
        How long it takes to come to speed [s].

    Returns
    -------
    time, angle : ndarray, shape (n,)
    """
    rising = np.linspace(0, 1, int(ramp * RATE))
    rest, speed = np.zeros(int(REST * RATE)), []
    for v in [v for _ in range(repeats) for v in speeds]:
        cruise = np.ones(int(RATE * ((HIGH - LOW) / v - ramp)))
        there = v * np.concatenate([rising, cruise, rising[::-1]])
        speed += [rest, there, rest, -there] if back else [rest, there]
    angle = LOW + np.cumsum(np.concatenate([*speed, rest])) / RATE
    return np.arange(len(angle)) / RATE, angle


def planned(path):
    """Angle of the arm [rad] over time [s] as a plan has it.

    Parameters
    ----------
    path : path
        ``plan.csv``.

    Returns
    -------
    time, angle : ndarray, shape (n,)
    """
    plan = pd.read_csv(path)
    return plan["time"].to_numpy(), plan["motor.phi"].to_numpy() / RATIO


def record(rng, kind="ripple", plan=None):
    """What the drive and the amplifier would log.

    Parameters
    ----------
    rng : numpy.random.Generator
    kind : str
        Of KINDS.
    plan : path, optional
        The motion instead of the kind's own.

    Returns
    -------
    pandas.DataFrame
    """
    hidden = {"ripple": HIDDEN, "poor": HIDDEN, "alike": UNEVEN,
              "rivals": ("viscous", "worm", {"b": 0.001})}.get(kind)  # N.m.s/rad
    model = compile_model(Library([RIG]), "Barrier", [hidden[:2]] if hidden else [])
    values = dict(MACHINE)
    if hidden:
        values.update({f"{component_name(*model.attached[0])}.{n}": v for n, v in hidden[2].items()})
    time, angle = planned(plan) if plan else motion(**{
        "rivals": {"speeds": (0.4, 0.8)}, "alike": {"speeds": (0.4,), "repeats": 4, "ramp": 0.1},
        "poor": {"speeds": (0.1,), "repeats": 1, "back": False}}.get(kind, {}))
    moved = {"motor.phi": RATIO * angle}
    torque = compensate(model, {**moved, "push": 0.0}, time, values)["motor.tau"]
    sensed = estimate(model, {**moved, "motor.tau": torque}, time, values)["C"]
    if kind == "unknown":
        torque += RUB * np.exp(-((angle - RUB_AT) / RUB_WIDE) ** 2) * np.sign(np.gradient(angle))
    n = len(time)
    if kind == "wiring":
        torque = -torque
    return pd.DataFrame({
        "t": np.round(1e3 * time),
        "motor_angle": np.rad2deg(np.round(RATIO * angle / QUANTUM) * QUANTUM),
        "current": torque / K_M + WHITE_A * rng.standard_normal(n),
        "arm_torque": sensed + WHITE_C * rng.standard_normal(n)})


def main():
    """Write the log."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    folder.mkdir(parents=True, exist_ok=True)
    kind = sys.argv[2] if len(sys.argv) > 2 else "ripple"
    if kind not in KINDS:
        sys.exit(f"no kind '{kind}'; one of {', '.join(KINDS)}")
    plan = sys.argv[3] if len(sys.argv) > 3 else None
    path = folder / ("tuesday.csv" if plan else "monday.csv")
    record(np.random.default_rng(2 if plan else 1), kind, plan).to_csv(path, index=False, float_format="%.7g")
    print(f"Written: {path}")


if __name__ == "__main__":
    main()

"""What does friction compensation bring, with right, wrong and no friction parameters?

Run: python examples/cosim/compensation.py
Backdriving: a hand moves both joints to and fro while the motors carry the leg; what the hand feels is its torque, less
what the leg itself asks for its acceleration. Tracking: the gait-like cycle under position
control, without load: no controller knows a load from outside. Letting go: the leg is
pushed off at 0.2 rad/s in both joints, and nobody holds it any more.
"""

from dataclasses import replace

import numpy as np
from common import HERE, IMAGES, changed, logged
from draw import compensation as figure
from draw import write

from pycosim.study.parse import load_study

# Friction parameters of the controller: of the machine, 1.5 times and half its losses, or of no machine at all.
CASES = {"none": (0.0, 1.0), "right": (1.0, 1.0), "losses x 1.5": (1.0, 1.5), "losses x 0.5": (1.0, 0.5)}


def wrong(factor):
    """Friction parameters with all losses multiplied."""
    given = {n: s.value for n, s in load_study(HERE / "machine.toml").parameters.items()}
    return {n: 1 - factor * (1 - v) if n.endswith(".mu") else factor * v for n, v in given.items()}


def backdriven(share, factor):
    """Log of a hand moving the joints."""
    return logged(changed("backdrive", controller={"options": {"friction": share}, "parameters": wrong(factor)}), 200)


def felt(run, transparent):
    """RMS of what friction adds to the torque of the hand, at hip and knee [N.m]."""
    after = (run["time"] > 2).to_numpy()
    return [float(np.sqrt(np.mean((run[n] - transparent[n])[after] ** 2))) for n in ("hand_H", "hand_K")]


def frictionless():
    """The same hand on a machine without losses: what the leg alone asks of it."""
    none = wrong(0.0)
    return logged(changed("backdrive", plant={"parameters": none},
                          controller={"options": {"friction": 0.0}, "parameters": none}), 200)


def tracked(share, factor):
    """RMS of the tracking error of hip and knee over the gait-like cycle [mrad]."""
    controller = {"options": {"friction": share}, "parameters": wrong(factor)}
    run = logged(changed("gait", reference={"options": {"load": 0.0}}, controller=controller), 200)
    after = (run["time"] > 2).to_numpy()
    return [float(1e3 * np.sqrt(np.mean((run[q] - run[f"{q}_wanted"])[after] ** 2))) for q in ("q_H", "q_K")]


def released(share, factor):
    """How far hip and knee get within 3 s when they are pushed off at 0.2 rad/s and let go [rad]."""
    scenario = changed("backdrive", hand={"parameters": {"k": 0.0, "d": 0.0}},
                       plant={"start": {"leg.w_H": 0.2, "leg.w_K": 0.2}},
                       controller={"options": {"friction": share}, "parameters": wrong(factor)})
    run = logged(replace(scenario, duration=3.0), 200)
    return [float(np.ptp(run[q])) for q in ("q_H", "q_K")]


def main():
    """Measure, tell, draw."""
    transparent = frictionless()
    runs = {name: backdriven(*case) for name, case in CASES.items()}
    felts = {name: felt(run, transparent) for name, run in runs.items()}
    errors = {name: tracked(*case) for name, case in CASES.items()}
    print("                 felt by the hand, RMS [N.m]   tracking error, RMS [mrad]")
    for name in CASES:
        print(f"  {name:14s} hip {felts[name][0]:.3f}, knee {felts[name][1]:.3f}      "
              f"hip {errors[name][0]:.2f}, knee {errors[name][1]:.2f}")
    most = felt(backdriven(0.9, 1.0), transparent)
    print(f"  right, 90 %    hip {most[0]:.3f}, knee {most[1]:.3f}")
    for name, case in {**CASES, "right, 90 %": (0.9, 1.0)}.items():
        print("  let go, {}: hip moves {:.3f}, knee {:.3f} rad in 3 s".format(name, *released(*case)))
    write(figure(runs, transparent, errors, felts), IMAGES, "compensation")


if __name__ == "__main__":
    main()

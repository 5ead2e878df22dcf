"""Run `improve` on two lead-screw drives and on a servo with a pendulum, and print the ladders.

    python -m benchmarks.real_data.run

The servo is held out one kind of trajectory at a time, and one controller gain at a time.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"


def ladder(study):
    """Improve a study; returns the search."""
    import pycosim as pc
    return pc.open(study).improve()


def screw(number):
    """The study of a drive."""
    from pycosim.study.parse import load_study
    return load_study(ROOT / "examples" / "screw_drives" / f"drive{number}.toml")


def servo_splits(key):
    """Studies of the servo that hold out the runs of one value of a key at a time."""
    from pycosim.study.parse import load_study
    study = load_study(ROOT / "examples" / "servo_pendulum" / "study.toml")
    runs = [*study.runs, *study.held_out]
    values = {path: json.loads(path.read_text())[key] for path in runs}
    for value in sorted(set(values.values())):
        yield value, replace(study, runs=[p for p in runs if values[p] != value],
                             held_out=[p for p in runs if values[p] == value])


def main():
    """Print every ladder."""
    for number in (1, 2):
        print(f"screw drive {number} (RMSE on speeds held out, mN.m)")
        show(ladder(screw(number)), 1e3, "tau")
    for key in ("trajectory", "kp"):
        falls = []
        for value, study in servo_splits(key):
            print(f"servo, {key} {value} held out (RMSE, V)")
            result = ladder(study)
            falls.append(show(result, 1.0, "voltage"))
        print(f"fall of the held-out error, one {key} left out at a time: "
              f"{', '.join(f'{100 * f:.0f} %' for f in falls)}; mean {100 * np.mean(falls):.0f} %")


def show(result, scale, channel):
    """Print a ladder; returns the fall of the held-out error."""
    for step in result.steps:
        name = step.added or "base"
        fitted, held_out = (scale * e[channel] for e in (step.error, step.held_out_error))
        print(f"  {name:32s} fit {fitted:.3f}  held out {held_out:.3f}")
    best = result.first.best
    print(f"  verdict {result.first.verdict}, then {result.last.verdict}; indistinguishable from the first: "
          f"{', '.join(best.alternatives if best else []) or 'none'}")
    return 1 - result.steps[-1].held_out_error[channel] / result.steps[0].held_out_error[channel]


if __name__ == "__main__":
    main()

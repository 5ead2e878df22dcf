"""A linear axis (EMPS) in; what plain least squares with the same terms leaves, beside what `improve` found, out.

    python -m benchmarks.real_data.emps RESULTS        a folder that `pycosim improve examples/emps/study.toml` left

Positions are smoothed without phase lag and differentiated; mass, Coulomb friction and viscous friction of each
direction are fitted to the force on the passes that `improve` fitted, then a shift of the force and a ripple over the
position are searched on a grid. Errors are of the passes that `improve` held out, and of samples that it calls moving.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import butter, filtfilt

ROOT = Path(__file__).parents[2]
STUDY = ROOT / "examples" / "emps" / "study.toml"
LOG = ROOT.parent / "shared" / "data" / "emps" / "trajectories.csv"
GAIN = 35.1507  # N/V, as published
CUT = 150.0  # Hz, of the filter of positions: lower ones smear the jumps of the acceleration, higher ones pass noise
SHIFTS = np.arange(-2e-3, 2.01e-3, 1e-4)  # s
WAVES = np.arange(500.0, 8000.0, 2.0)  # rad/m


def motion(time, x):
    """Speed and acceleration without phase lag."""
    low = filtfilt(*butter(4, CUT * 2 * np.median(np.diff(time))), x)
    speed = np.gradient(low, time)
    return speed, np.gradient(speed, time)


def fitted(columns, force, fit):
    """Error of every sample after least squares on some."""
    solution = np.linalg.lstsq(columns[fit], force[fit], rcond=None)[0]
    return force - columns @ solution, solution


def plain(time, x, force, least, held):
    """Errors on held-out passes, term after term.

    Parameters
    ----------
    time, x, force : ndarray, shape (n,)
        [s], [m], [N].
    least : float
        Speed above which a sample counts [m/s].
    held : list of (float, float)
        Times that no fit sees.

    Returns
    -------
    dict of str to float
        [N], by what was added last.
    """
    speed, acceleration = motion(time, x)
    moving = np.abs(speed) > least
    test = np.any([(time >= a) & (time <= b) for a, b in held], axis=0)
    fit, test = moving & ~test, moving & test

    def rms(error):
        return float(np.sqrt(np.mean(error[test] ** 2)))
    sign = np.sign(speed)
    columns = np.array([acceleration, speed, sign]).T
    found = {"mass, viscous and Coulomb friction": rms(fitted(columns, force, fit)[0])}
    found["an offset instead"] = rms(fitted(np.c_[columns, np.ones(len(time))], force, fit)[0])
    columns = np.c_[columns, np.abs(speed)]
    found["viscous friction of each direction"] = rms(fitted(columns, force, fit)[0])
    shifted = [np.interp(time + d, time, force) for d in SHIFTS]
    k = int(np.argmin([np.sum(fitted(columns, f, fit)[0][fit] ** 2) for f in shifted]))
    left = fitted(columns, shifted[k], fit)[0]
    found[f"force recorded {1e3 * SHIFTS[k]:.1f} ms late"] = rms(left)
    power = [np.abs(np.sum(left[fit] * np.exp(1j * n * x[fit]))) for n in WAVES]
    n = WAVES[int(np.argmax(power))]
    columns = np.c_[columns, np.sin(n * x), np.cos(n * x)]
    left, solution = fitted(columns, shifted[k], fit)
    found[f"a ripple of {2e3 * np.pi / n:.2f} mm and {np.hypot(*solution[-2:]):.2f} N"] = rms(left)
    return found


def main():
    """Print both ladders."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("results", type=Path)
    folder = parser.parse_args().results
    ladder = json.loads((folder / "ladder.json").read_text())
    least = json.loads((folder / "comparison.json").read_text())["samples"]["w_min"]
    log = pd.read_csv(LOG)
    found = plain(log.t.to_numpy(), log.qm.to_numpy(), GAIN * log.vir.to_numpy(), least,
                  [(a, b) for _, a, b in ladder["held_out"]])
    print("plain least squares, held-out error [N]")
    for name, error in found.items():
        print(f"  {error:6.3f}  {name}")
    print("improve")
    for step in ladder["steps"]:
        added = step["added"] and f"{step['added']['effect']} at {step['added']['place']}"
        print(f"  {step['held_out_error']['force']:6.3f}  {added or 'base model'}")


if __name__ == "__main__":
    main()

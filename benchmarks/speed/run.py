"""Time the identification and the diagnosis against SciPy's least squares on a vectorised NumPy residual.

    python -m benchmarks.speed.run [--samples 10000 100000 1000000]

Reading the file and arranging the samples are excluded on both sides; each time is the least of three.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from benchmarks.hidden_effects import machine as rig

STUDY = Path(__file__).parents[2] / "examples" / "hip_knee" / "study.toml"
START = [0.05, 0.05, 0.01, 0.01, 0.95, 0.95, 0.97, 0.97]


def data(samples, folder, effects=()):
    """A data set of about so many samples at 100 Hz."""
    from pycosim.compile import Library
    from pycosim.data.dataset import Dataset
    from pycosim.study.parse import load_study
    rng = np.random.default_rng(0)
    repeats = max(1, round(samples / 21700))
    rate = 100.0 * min(1.0, samples / 21700)
    motion = rig.six_manoeuvres(speeds=(0.2, 0.4, 0.8, 1.6, 2.4), repeats=repeats, longest_pass=6.8, rate=rate, rng=rng)
    path = Path(folder) / "run.csv"
    rig.write_csv(rig.measure(rig.PAPER, motion, effects, rng=0), path)
    return Dataset(load_study(STUDY).with_data([path]), Library())


def segment(tau, f0, mu, sign):
    """Torque behind a segment, from the torque before it."""
    loss, slope = 2 * mu * f0 / (1 + mu), 2 * (1 - mu) / (1 + mu)
    rest = tau - sign * loss / 2
    load = rest / (1 + sign * np.sign(rest) * slope / 2)
    return 2 * load - tau


def baseline(dataset):
    """The alternative: vectorised NumPy residual, finite differences, SciPy's bounded least squares."""
    view = dataset.view("all")
    tau = [dataset.signals[f"motor{k}.tau"][view] for k in (1, 2)]
    torque = [dataset.measured[c][view] for c in ("C_H", "C_K")]
    signs = dict(zip(dataset.base.segments, np.sign(dataset.speeds[:, view])))

    def residual(p):
        a1, a2 = segment(tau[0], p[0], p[4], signs["s1A"]), segment(tau[1], p[1], p[5], signs["s2A"])
        b1, b2 = segment(a1, p[2], p[6], signs["s1B"]), segment(a2, p[3], p[7], signs["s2B"])
        return np.concatenate([torque[0] - 15.125 * (a1 + a2), torque[1] - 15.125 * (b1 - b2)])

    return least_squares(residual, START, bounds=([0] * 4 + [0.3] * 4, [1] * 8), x_scale=[0.05] * 4 + [0.1] * 4).x


def least(function, times=3):
    """Least time of a few calls, and the last result."""
    found = []
    for _ in range(times):
        start = time.perf_counter()
        result = function()
        found.append(time.perf_counter() - start)
    return min(found), result


def main():
    """Print the table."""
    from pycosim.diagnosis import decide
    from pycosim.fit import least_squares
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", nargs="*", type=int, default=[10000, 86000, 100000, 1000000])
    args = parser.parse_args()
    print(f"{'samples':>9s} {'scipy s':>9s} {'fit s':>9s} {'ratio':>7s} "
          f"{'diagnosis s':>12s} {'to scipy':>9s} {'peak MiB':>9s}")
    for samples in args.samples:
        with tempfile.TemporaryDirectory() as folder:
            dataset = data(samples, folder)
        slow, reference = least(lambda: baseline(dataset), 2)
        fast, fit = least(lambda: least_squares.fit(dataset, dataset.base, part="all"))
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        ranking, _ = least(lambda: decide.diagnose(dataset, dataset.base, fit), 2)
        print(f"{len(dataset.time):9d} {slow:9.2f} {fast:9.3f} {slow / fast:7.1f} "
              f"{ranking:12.2f} {ranking / slow:9.2f} {memory:9.0f}")
        order = [fit.free.index(n) for n in names()]
        apart = np.abs(fit.values[order] - reference) / fit.stderr[order]
        print(f"{'':9s} largest difference of the two estimates, in standard errors: {apart.max():.2f}")


def names():
    """Parameters in the order of the baseline."""
    return [f"s{s}.{p}" for p in ("f0", "mu") for s in ("1A", "2A", "1B", "2B")]


if __name__ == "__main__":
    main()

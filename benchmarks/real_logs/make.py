"""In: a case and a folder. Out: its logs as CSV files, `study.toml` and `truth.json`; the path of the study.

    python -m benchmarks.real_logs.make digital:stribeck:1.7:3 --out /tmp/case

    from benchmarks.real_logs.make import make
    study = make("digital:stribeck:1.7:3", folder)          # or a Case; quick=True for some 8000 samples
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.real_logs import cases, mistakes

ROOT = Path(__file__).parents[2]
GEARED = """[rig]
model = "DriveTrain.Rigs.GearedJoint"

[parameters]
"gear.f0" = { value = 0.05, min = 0.0, max = 1.0, fixed = false }
"gear.mu" = { value = 0.95, min = 0.3, max = 1.0, fixed = false }

[data]
runs = []
held_out = []
reference = "unknown"

[columns]
theta = { variable = "motor.phi", unit = "rad" }
omega = { variable = "motor.w", unit = "rad/s" }
tau = { variable = "motor.tau", unit = "N.m" }
C = { variable = "C", unit = "N.m" }
"""

LINEAR = """[rig]
model = "DriveTrain.Rigs.LinearAxis"

[parameters]
"carriage.J" = { value = 90.0, fixed = false }
"guide.f0" = { value = 20.0, fixed = false }
"viscous_guide.b" = { value = 180.0, fixed = false }

[data]
runs = []
held_out = []

[columns]
x = { variable = "motor.phi", unit = "m" }
v = { variable = "motor.w", unit = "m/s" }
F = { variable = "force", unit = "N" }
"""


def make(case, folder, quick=False):
    """Write logs and study of a case.

    Parameters
    ----------
    case : Case or str
    folder : Path or str
        Made where it is missing.
    quick : bool
        A shorter log.

    Returns
    -------
    Path
        Of the study; `truth.json` beside it says what is hidden, with which coefficients and size.

    Raises
    ------
    ValueError
        No such condition, or an effect that reaches no size there.
    """
    case = cases.parse(case) if isinstance(case, str) else case
    case = replace(case, quick=quick or case.quick)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    found = cases.drawn(case)
    about, truth = cases.CONDITIONS[case.condition], found.truth()
    log = found.columns(truth)
    if case.condition in ("mistake", "poor"):
        log = mistakes.apply(case.what, log, case.seed)
    names, rng = [], np.random.default_rng([case.seed, 7])
    pieces = _pieces(found, truth, about.files) if about.files > 1 else [slice(None)]
    for k, rows in enumerate(pieces, 1):
        names.append(f"run{k}.csv")
        zeros = {n: rng.uniform(-about.zeros, about.zeros) for n in found.plant.columns["theta"]} if about.zeros else {}
        written(folder / names[-1], {n: x[rows] + zeros.get(n, 0.0) for n, x in log.items()})
    study = folder / "study.toml"
    study.write_text(_study(found, names))
    (folder / "truth.json").write_text(json.dumps({
        "case": case.name, "hidden": [[e.id, e.place] for e in found.hidden],
        "coefficients": [e.values for e in found.hidden], "sizes": found.sizes,
        "machine": {"f0": found.plant.f0, "mu": found.plant.mu}, "world": vars(found.world) | {},
        "floor": cases.base(found), "own_size": cases.own_size(found),
        "samples": len(log["time"])}, indent=1, default=float))
    return study


def _pieces(found, truth, files):
    """Rows of each file, cut where the machine rests if it does."""
    n = len(truth.time)
    still, cuts = np.flatnonzero(abs(truth.omega).max(0) < 1e-9), [0]
    for k in range(1, files):
        goal = n * k // files
        cuts.append(int(still[np.argmin(abs(still - goal))]) if len(still) and found.motion.at == "motor" else goal)
    return [slice(a, b) for a, b in zip(cuts, [*cuts[1:], n])]


def written(path, log):
    """Write a log as CSV, with as many digits as the numbers need.

    Parameters
    ----------
    path : Path
    log : dict of str to ndarray, shape (n,)
    """
    names = list(log)
    rows = np.column_stack([log[n] for n in names])
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.10g")


def _study(found, runs):
    text = {"geared_joint": GEARED, "linear_axis": LINEAR}.get(found.plant.study, "")
    if not text:
        text = (ROOT / "examples" / "hip_knee" / "study.toml").read_text()
    kind = {"none": "unknown"}.get(found.world.reference, found.world.reference)
    text = text.replace("runs = []", f"runs = {json.dumps(runs)}", 1)
    return text.replace('reference = "unknown"', f'reference = "{kind}"', 1)


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--quick", action="store_true")
    args = parser.parse_args()
    print(make(args.case, args.out, args.quick))


if __name__ == "__main__":
    main()

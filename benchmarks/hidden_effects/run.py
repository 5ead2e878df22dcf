"""Hide effects in independently generated logs, run `improve` on them, and tabulate what it found.

    python -m benchmarks.hidden_effects.run [--sizes 1.3 1.7 2.4] [--effects viscous ...] [--seeds 1] [--none 20]
                                            [--bump 5]
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.hidden_effects import machine as rig

ROOT = Path(__file__).parents[2]
STUDY = ROOT / "examples" / "hip_knee" / "study.toml"
EFFECTS = ("viscous", "stribeck", "presliding", "direction_asymmetry", "configuration_preload", "load_dependence",
           "load_nonlinearity", "load_hysteresis", "cross_load", "torque_ripple", "thermal_drift",
           "temperature_dependence", "torque_offset", "torque_constant", "torque_saturation", "rotor_inertia",
           "time_delay", "joint_spring", "payload", "cable_compliance", "backlash")
# what no log of this rig with a torque reference can tell apart (the contract's list)
TWINS = [{("torque_offset", f"motor{i}"), ("direction_asymmetry", f"{i}A")} for i in (1, 2)] + [
    {("torque_offset", "motor1+motor2"), ("direction_asymmetry", "1A+2A")}] + [
    {(e, p) for p in ("1B", "2B", "1B+2B")} for e in ("viscous", "stribeck")]


def study(effect):
    """The example's study; where load dependence is hidden, one that has none."""
    from pycosim.study import load_study
    given = load_study(STUDY)
    if effect == "load_dependence":
        given = replace(given, parameters={n: replace(s, value=1.0, fixed=True) if n.endswith(".mu") else s
                                           for n, s in given.parameters.items()})
    return given


def hide(effect, size, seed):
    """Draw a machine, a motion, a place and coefficients of the wanted size."""
    rng = np.random.default_rng([seed, sum(map(ord, effect)), int(100 * size)])
    motion = rig.default_trajectory(rng)
    if effect == "backlash":  # shows only where the load changes its sign
        motion = rig.six_manoeuvres((0.2, 0.4, 0.8, 1.6, 2.4), 2, start=(rig.CROSSING_START,), longest_pass=6.8,
                                    rng=rng)
    machine = rig.random_machine(rng)
    if effect == "none":
        return machine, motion, [], rng
    if effect == "load_dependence":
        machine = rig.without_load_dependence(machine)
    for _ in range(20):
        place = str(rng.choice(list(rig.KINDS[effect].places)))
        try:
            return machine, motion, [rig.calibrate(rig.draw(effect, place, rng), size, machine, motion, seed=seed)], rng
        except rig.UnreachableSizeError:
            continue
    raise SystemExit(f"{effect} cannot reach size {size}")


def true_error(data, given, library, hidden):
    """Held-out error of the true model, fitted."""
    from pycosim import compare, identify
    from pycosim.compile import compile_model
    model = compile_model(library, given.rig, [(h.id, h.place) for h in hidden])
    start = {n: v for h in hidden for n, v in ((f"{h.id}_{h.place.replace('+', '_')}.{c}", h[c])
                                               for c in h.coefficients)}
    return compare.errors(data, model, identify.fit(data, model, start), "test")


def case(job):
    """Run one case; returns a row of the table."""
    from pycosim import improve, identify, compare
    from pycosim.compile import Library
    from pycosim.dataset import Dataset
    effect, size, seed = job
    machine, motion, hidden, _ = hide(effect, size, seed)
    given, library = study(effect), Library()
    with tempfile.TemporaryDirectory() as folder:
        datasets = []
        for name, effects in (("with", hidden), ("without", [])):
            path = Path(folder) / f"{name}.csv"
            extra = ("q",) if effect in ("cable_compliance", "backlash") else ()
            rig.write_csv(rig.measure(machine, motion, effects, rng=seed, extra=extra), path)
            datasets.append(Dataset(given.with_data([path]), library))
    data, clean = datasets
    start = time.perf_counter()
    result = improve.improve(data)
    seconds = time.perf_counter() - start
    reference = compare.errors(clean, clean.base, identify.fit(clean, clean.base), "test")
    final = result.steps[-1].held_out_error
    first = result.first.candidates[0]
    ladder = [list(s.added) for s in result.steps[1:]]
    row = {"effect": effect, "size": size, "seed": seed, "hidden": [str(h) for h in hidden],
           "verdict": result.first.verdict, "first": [first.effect, first.place], "p": first.p_value, "ladder": ladder,
           "final": result.last.verdict, "p_final": result.last.candidates[0].p_value,
           "held_out": max(final[c] / reference[c] for c in final), "seconds": seconds,
           "depends": [d["variable"] for d in result.first.residual_depends_on[:2]],
           "strength": [d["strength"] for d in result.first.residual_depends_on[:2]]}
    if effect == "bump":
        row["bump_angle"] = f"theta{int(hidden[0]['motor'])}"
    elif hidden:
        true_final = true_error(data, given, library, hidden)
        row["beside_true"] = max(final[c] / true_final[c] for c in final)
        true = (hidden[0].id, hidden[0].place)
        told = [(first.effect, first.place), *((t["effect"], t["place"]) for t in first.twins)]
        row["right"] = bool(ladder) and (same(told[0], true) or true in told)
        row["place"] = (first.effect, first.place) == (hidden[0].id, hidden[0].place)
        row["inside"] = coefficients(first, hidden[0])
        row["coefficients"] = {n: [c["value"], *c["ci95"]] for n, c in first.coefficients.items()}
        row["twins"] = first.twins
    return row


def same(found, true):
    """Whether a finding is the hidden effect or a true twin of it."""
    return found == true or any(found in group and true in group for group in TWINS)


def coefficients(finding, hidden):
    """Whether every coefficient is inside its interval or within 10 % of the truth; None for a twin."""
    if (finding.effect, finding.place) != (hidden.id, hidden.place):
        return None
    good = []
    for name, found in finding.coefficients.items():
        true = hidden[name]
        if name == "phase":
            continue
        good.append(found["ci95"][0] <= true <= found["ci95"][1] or abs(found["value"] - true) <= 0.1 * abs(true))
    return all(good)


def jobs(args):
    """Cases of a run."""
    seeds = range(args.first, args.first + args.seeds)
    found = [(e, s, seed) for e in args.effects for s in args.sizes for seed in seeds]
    found += [("none", 1.0, args.first + k) for k in range(args.none)]
    return found + [("bump", 1.7, args.first + k) for k in range(args.bump)]


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--effects", nargs="*", default=EFFECTS)
    parser.add_argument("--sizes", nargs="*", type=float, default=[1.3, 1.7, 2.4])
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--none", type=int, default=20)
    parser.add_argument("--bump", type=int, default=5)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    rows = []
    with ProcessPoolExecutor(args.workers) as pool:
        for row in pool.map(case, jobs(args)):
            rows.append(row)
            print(json.dumps(row, default=float), flush=True)
    summary(rows)
    if args.out:
        args.out.write_text(json.dumps(rows, indent=1, default=float))


def summary(rows):
    """Print the shares that the project promises."""
    hidden = [r for r in rows if "right" in r]
    if hidden:
        checks = {"named first, twins count": [r["right"] for r in hidden],
                  "coefficients right": [r["inside"] for r in hidden if r["inside"] is not None],
                  "nothing else added": [len(r["ladder"]) == 1 for r in hidden],
                  "held-out within 5 % of none": [r["held_out"] <= 1.05 for r in hidden],
                  "held-out within 5 % of true": [r["beside_true"] <= 1.05 for r in hidden]}
        for name, values in checks.items():
            print(f"{name:28s} {sum(values):4d} of {len(values)}")
    for kind, good in (("none", "nothing_missing"), ("bump", "unexplained")):
        some = [r for r in rows if r["effect"] == kind]
        if some:
            print(f"{kind}: {good:22s} {sum(r['verdict'] == good for r in some):4d} of {len(some)}")
    print(f"median time of improve {np.median([r['seconds'] for r in rows]):.1f} s")


if __name__ == "__main__":
    main()

"""Planned experiments against the paper's six manoeuvres: intervals, predicted against realised, and twins.

    python -m benchmarks.plan.run [--seeds 50] [--plans 5] [--twin-seeds 30] [--pairs 10] [--seed 1000]

Logs come from the independently written machine of `benchmarks.hidden_effects`; each plan is made from a first log of
the six manoeuvres and from nothing else. Logs are fitted with the model that made them, and nothing is searched for: no
item is an improve of a study, so plans and fits go through `pycosim.core.executors.each`, the loop below the
many-studies engine.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.hidden_effects import machine as rig
from benchmarks.paper.run import STUDY, TRUTH, combination
from pycosim.core.executors import each

REFERENCES = ("gravity_model", "unknown")


def baseline():
    """The six manoeuvres at 1.6 rad/s, each twice."""
    return rig.six_manoeuvres(speeds=(1.6,), repeats=2, rate=100.0, start=((1.4, -0.35),), lines=(-20.0,))


def as_machine(motion, rate=100.0):
    """A planned motion as the machine takes it: the same pieces, made by its own formulas.

    Parameters
    ----------
    motion : Motion
    rate : float

    Returns
    -------
    benchmarks.hidden_effects.machine.Trajectory
    """
    found = []
    for p in motion.pieces:
        speed = float(np.abs(p.velocity).max())
        direction = tuple(p.velocity / speed) if speed else (0.0, 0.0)
        found.append(rig.Stretch(p.label, p.begin, p.duration, tuple(p.start), direction, speed, p.ramp))
    return rig.Trajectory(found, rate)


def study(reference):
    """The example's study, with or without a reference of the joint torques."""
    from pycosim.study.parse import load_study
    return replace(load_study(STUDY), reference=reference)


def dataset(motions, seed, reference, effects=(), study_of=study):
    """Logs of the machine as a data set; `motions` is one, or several that are made one after the other."""
    from pycosim.compile import Library
    from pycosim.data.dataset import Dataset
    motions = motions if isinstance(motions, list) else [motions]
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"log{k}.csv" for k in range(len(motions))]
        for k, (path, motion) in enumerate(zip(paths, motions)):
            frame = rig.measure(rig.PAPER, motion, effects, rng=seed + 100_000 * k)
            rig.write_csv(frame.drop(columns=["C_H", "C_K"] if reference == "unknown" else []), path)
        return Dataset(study_of(reference).with_data(paths), Library())


def planned(reference, seed, criterion="intervals"):
    """Plan of the baseline's duration, made from one log of the baseline, and its predicted fit of everything."""
    from pycosim.design import optimiser, plan
    from pycosim.design.prediction import expected, predicted_fit
    from pycosim.fit import least_squares
    first = dataset(baseline(), seed, reference)
    fit = least_squares.fit(first, first.base, part="all")
    k = plan.known(first.study, first.library, first.base, first, fit)
    k.prior = optimiser.prior_of(None, k.free, fit.variables)  # the new log is to stand alone, as the baseline does
    start = time.monotonic()
    found = plan.make_plan(k, budget=float(baseline().time[-1]), criterion=criterion)
    took = time.monotonic() - start
    log = expected(k.study, k.library, k.asked, k.workspace.kinematics, k.model, k.values, found.motion)
    return found, predicted_fit(log, k.model, k.free, k.values, k.noise, "all"), took


def case(arguments):
    """Fit of one log: standard errors, values, intervals, and the combination of both distal losses."""
    from pycosim.fit import least_squares
    motion, seed, reference = arguments
    log = dataset(motion, seed, reference)
    fit = least_squares.fit(log, log.base, part="all")
    value, low, high, _ = combination(fit)
    found = {n: (fit.unbounded[k], fit.stderr[k], *fit.interval(n)) for k, n in enumerate(fit.free)}
    found["sum"] = (value, (high - low) / 3.92, low, high)
    return found


def compared(reference, seeds, plans, where, workers):
    """Print intervals and errors of plans and baseline, and what was predicted of the plans' intervals.

    Each plan is made from a log of its own; the seeds are shared out among them.
    """
    truth = {**TRUTH, "sum": sum(TRUTH[f"s{s}.f0"] * (1 + TRUTH[f"s{s}.mu"]) for s in ("1B", "2B"))}
    parts = {int(part[0]): part[1:].tolist() for part in np.array_split(seeds, plans)}
    made = {first: planned(reference, first) for first in parts}
    motions = {first: {"baseline": baseline(), "plan": as_machine(found.motion)} for first, (found, *_) in made.items()}
    work = {(kind, first, s): (case, (motions[first][kind], s, reference))
            for first, part in parts.items() for kind in ("baseline", "plan") for s in part}
    done = {key: future.result() for key, future in each(work, where, workers)}
    rows, told = {kind: [done[key] for key in work if key[0] == kind] for kind in ("baseline", "plan")}, []
    for first, (_, predicted, _) in made.items():
        _, low, high, _ = combination(predicted)
        widths = {**dict(zip(predicted.free, predicted.stderr)), "sum": (high - low) / 3.92}
        told.append({n: widths[n] / np.mean([done["plan", first, s][n][1] for s in parts[first]]) for n in truth})
    took = [seconds for _, _, seconds in made.values()]
    print(f"\nreference {reference}: {plans} plans of at most {baseline().time[-1]:.1f} s, each from one log, made in "
          f"at most {max(took):.0f} s; {len(rows['plan'])} seeds")
    print(f"{'':8s} {'stderr base':>12s} {'plan':>9s} {'ratio':>6s} {'error ratio':>11s} {'predicted/realised':>18s} "
          f"{'inside':>6s}")
    ratios = {}
    for n, true in truth.items():
        base, new = (np.array([r[n] for r in rows[k]]) for k in rows)
        error = [np.sqrt(np.mean((v[:, 0] - true) ** 2)) for v in (base, new)]
        ratios[n] = new[:, 1].mean() / base[:, 1].mean(), error[1] / error[0]
        foreseen, inside = [t[n] for t in told], np.mean((new[:, 2] <= true) & (true <= new[:, 3]))
        print(f"{n:8s} {base[:, 1].mean():12.6f} {new[:, 1].mean():9.6f} {ratios[n][0]:6.2f} {ratios[n][1]:11.2f} "
              f"{min(foreseen):7.2f} to {max(foreseen):4.2f}    {inside:6.2f}")
    own = [n for n in TRUTH if reference != "unknown" or n not in ("s1B.f0", "s2B.f0")]
    own += ["sum"] if reference == "unknown" else []
    for k, what in enumerate(("intervals", "errors (root mean square)")):
        mean = np.exp(np.mean([np.log(ratios[n][k]) for n in own]))
        print(f"geometric mean of {what} over {len(own)}: {mean:.3f} of the baseline's (the aim is 0.333)")
    near = [0.8 <= t[n] <= 1.2 for t in told for n in own]
    print(f"predicted over realised widths within 0.8 to 1.2: {sum(near)} of {len(near)}, in the mean "
          f"{np.exp(np.mean([np.log(t[n]) for t in told for n in own])):.2f}")


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--twin-seeds", type=int, default=30)
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--plans", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1000, help="of the first log; the others count on")
    parser.add_argument("--references", nargs="+", choices=REFERENCES, default=REFERENCES)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--on", default="processes", help="or serial, threads, dask://host:port")
    args = parser.parse_args()
    for reference in args.references if args.seeds else ():
        compared(reference, range(args.seed, args.seed + args.seeds + args.plans), args.plans, args.on, args.workers)
    if args.pairs:
        from benchmarks.plan import twins
        twins.report(args.pairs, range(args.seed, args.seed + args.twin_seeds + 1), args.on, args.workers)


if __name__ == "__main__":
    main()

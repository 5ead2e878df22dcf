"""Planned experiments against the paper's six manoeuvres: intervals, predicted against realised, and twins.

    python -m benchmarks.plan.run [--seeds 50] [--twin-seeds 30] [--pairs 10]

Logs come from the independently written machine of `benchmarks.hidden_effects`; the plans are made from a first log of
the six manoeuvres and from nothing else.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.hidden_effects import machine as rig
from benchmarks.paper.run import STUDY, TRUTH, combination

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
    from pycosim.study import load_study
    return replace(load_study(STUDY), reference=reference)


def dataset(motion, seed, reference, effects=(), study_of=study):
    """A log of the machine as a data set."""
    from pycosim.compile import Library
    from pycosim.dataset import Dataset
    frame = rig.measure(rig.PAPER, motion, effects, rng=seed)
    if reference == "unknown":
        frame = frame.drop(columns=["C_H", "C_K"])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        rig.write_csv(frame, path)
        return Dataset(study_of(reference).with_data([path]), Library())


def planned(reference, criterion="intervals"):
    """Plan of the baseline's duration, made from one log of the baseline, and its predicted fit of everything."""
    from pycosim import identify, plan
    from pycosim.plan_prediction import expected, predicted_fit
    first = dataset(baseline(), 1000, reference)
    fit = identify.fit(first, first.base, part="all")
    k = plan.known(first.study, first.library, first.base, first, fit)
    k.prior = plan.prior_of(None, k.free, fit.variables)  # the new log is to stand alone, as the baseline does
    start = time.monotonic()
    found = plan.make_plan(k, budget=float(baseline().time[-1]), criterion=criterion)
    took = time.monotonic() - start
    log = expected(k.study, k.library, k.asked, k.workspace.kinematics, k.model, k.values, found.motion)
    return found, predicted_fit(log, k.model, k.free, k.values, k.noise, "all"), took


def case(arguments):
    """Fit of one log: standard errors, values, intervals, and the combination of both distal losses."""
    from pycosim import identify
    motion, seed, reference = arguments
    log = dataset(motion, seed, reference)
    fit = identify.fit(log, log.base, part="all")
    value, low, high, _ = combination(fit)
    found = {n: (fit.unbounded[k], fit.stderr[k], *fit.interval(n)) for k, n in enumerate(fit.free)}
    found["sum"] = (value, (high - low) / 3.92, low, high)
    return found


def compared(reference, seeds, pool):
    """Print intervals of plan and baseline, and what was predicted of the plan's."""
    found, predicted, took = planned(reference)
    motion = as_machine(found.motion)
    kinds = {"baseline": baseline(), "plan": motion}
    rows = {k: list(pool.map(case, [(m, s, reference) for s in range(seeds)])) for k, m in kinds.items()}
    names = [*TRUTH, "sum"]
    truth = {**TRUTH, "sum": sum(TRUTH[f"s{s}.f0"] * (1 + TRUTH[f"s{s}.mu"]) for s in ("1B", "2B"))}
    _, low, high, _ = combination(predicted)
    told = {**dict(zip(predicted.free, predicted.stderr)), "sum": (high - low) / 3.92}
    print(f"\nreference {reference}: baseline {kinds['baseline'].time[-1]:.1f} s, plan {found.motion.duration:.1f} s, "
          f"made in {took:.0f} s; {seeds} seeds")
    print(f"{'':8s} {'stderr base':>12s} {'plan':>9s} {'ratio':>6s} {'scatter ratio':>13s} {'predicted/realised':>18s} "
          f"{'inside':>6s}")
    ratios = {}
    for n in names:
        base, new = (np.array([r[n] for r in rows[k]]) for k in kinds)
        reported, scatter = new[:, 1].mean() / base[:, 1].mean(), new[:, 0].std(ddof=1) / base[:, 0].std(ddof=1)
        inside = np.mean((new[:, 2] <= truth[n]) & (truth[n] <= new[:, 3]))
        ratios[n] = reported, scatter, told[n] / new[:, 1].mean()
        print(f"{n:8s} {base[:, 1].mean():12.6f} {new[:, 1].mean():9.6f} {reported:6.2f} {scatter:13.2f} "
              f"{ratios[n][2]:18.2f} {inside:6.2f}")
    own = [n for n in TRUTH if reference != "unknown" or n not in ("s1B.f0", "s2B.f0")]
    own += ["sum"] if reference == "unknown" else []
    for k, what in enumerate(("intervals", "scatter")):
        mean = np.exp(np.mean([np.log(ratios[n][k]) for n in own]))
        print(f"geometric mean of {what} over {len(own)}: {mean:.3f} of the baseline's (the aim is 0.333)")
    known = [ratios[n][2] for n in own]
    print(f"predicted over realised widths: {min(known):.2f} to {max(known):.2f} (the aim is 0.8 to 1.2)")


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--twin-seeds", type=int, default=30)
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--references", nargs="+", choices=REFERENCES, default=REFERENCES)
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    with ProcessPoolExecutor(args.workers) as pool:
        for reference in args.references if args.seeds else ():
            compared(reference, args.seeds, pool)
        if args.pairs:
            from benchmarks.plan import twins
            twins.report(args.pairs, args.twin_seeds, pool)


if __name__ == "__main__":
    main()

"""Hide effects in logs of the independent machine, improve each, and print how often the diagnosis is right.

    python -m benchmarks.hidden_effects.run [--half development|final] [--share 1.0] [--out cases.jsonl]
                                            [--kinds one weak pair none paired outside paper] [--effects viscous ...]

Cases that the output file already holds are not run again. `python -m benchmarks.hidden_effects.summary cases.jsonl`
prints the tables and draws the confusion matrix.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from concurrent.futures import as_completed
from pathlib import Path

from benchmarks.hidden_effects import cases
from benchmarks.hidden_effects import machine as rig
from pycosim.core.executors import executor

ROOT = Path(__file__).parents[2]
STUDY = ROOT / "examples" / "hip_knee" / "study.toml"


def run(case):
    """Run one case.

    Parameters
    ----------
    case : Case

    Returns
    -------
    dict
        A row of the table.
    """
    import pycosim as pc
    from pycosim.study.parse import load_study
    row = {"kind": case.kind, "effects": list(case.effects), "seed": case.seed, "half": case.half}
    try:
        drawn = cases.draw(case)
    except rig.MachineError as error:
        return {**row, "skipped": str(error)}
    given = cases.study(load_study(STUDY), case.effects)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        rig.write_csv(cases.log(drawn, case.seed, reference=None if case.kind == "paired" else "gravity_model"), path)
        project = pc.open(given, data=path)
        data = project.dataset
    if case.kind == "paper":
        return {**row, "base": _base(project.fit().solution, drawn.machine)}
    start = time.perf_counter()
    result = project.improve().found
    row |= {"seconds": time.perf_counter() - start, "samples": len(data.time), "sizes": drawn.sizes,
            "short": drawn.short, "hidden": [[h.id, h.place] for h in drawn.hidden],
            "truth": [dict(h.coefficients) for h in drawn.hidden]}
    row |= _found(result)
    row["base"] = _base(result.steps[0].fit, drawn.machine)
    if drawn.hidden and case.kind != "outside":
        true = true_error(data, given, project.library, drawn.hidden)
        row["beside_true"] = max(row["held_out"][c] / true[c] for c in true)
    if case.kind == "outside":
        row["cause"] = _cause(drawn.hidden[0])
        guess = (result.first.unexplained or {}).get("proposal")
        row["guess"] = guess and [guess["variable"], guess["place"], guess["share"]]
    return row


def _cause(effect):
    """Variables that an effect outside the catalogue acts over; both B stages accelerate alike."""
    if effect.id == "bump":
        return [f"theta{int(effect['motor'])}"]
    if effect.id == "acceleration_friction":
        return [f"acceleration@{p}" for p in (("1B", "2B") if effect.place.endswith("B") else (effect.place,))]
    return ["time"]


def _found(result):
    """What the search says, as plain values."""
    first, last = result.first, result.last
    best = first.candidates[0]
    steps = [{"added": list(s.added), "twins": [list(t.values()) for t in s.finding.twins],
              "coefficients": {n: [c["value"], *c["ci95"]] for n, c in s.finding.coefficients.items()},
              "before": b.error, "predicted": s.finding.predicted_error, "realised": s.error}
             for b, s in zip(result.steps[:-1], result.steps[1:])]
    return {"verdict": first.verdict, "final": last.verdict, "steps": steps,
            "held_out": result.steps[-1].held_out_error,
            "p": min(c.p_value for c in first.candidates), "p_final": min(c.p_value for c in last.candidates),
            "best": [best.effect, best.place],
            "depends": [[d["variable"], d["strength"]] for d in first.residual_depends_on[:3]]}


def _base(fit, machine):
    """Truth, value and interval of each base parameter, for those fitted."""
    return {n: [machine[n[4:]][n[1:3]], fit.parameters[n], *fit.interval(n)] for n in fit.free
            if n[4:] in machine and n[1:3] in rig.SEGMENTS}


def true_error(data, given, library, hidden):
    """Held-out error of the true model, fitted.

    Parameters
    ----------
    data : Dataset
    given : Study
    library : Library
    hidden : list of Effect

    Returns
    -------
    dict of str to float
    """
    from pycosim.compile import compile_model
    from pycosim.diagnosis import compare
    from pycosim.fit import least_squares
    model = compile_model(library, given.rig, [(h.id, h.place) for h in hidden])
    start = {n: v for h in hidden for n, v in ((f"{h.id}_{h.place.replace('+', '_')}.{c}", h[c])
                                               for c in h.coefficients)}
    return compare.errors(data, model, least_squares.fit(data, model, start), "test")


def right(row):
    """Whether the first effect named is the hidden one, and whether its place is: what the data cannot tell counts.

    Parameters
    ----------
    row : dict

    Returns
    -------
    named, placed : bool
    """
    if not row["steps"]:
        return False, False
    first = row["steps"][0]
    true = tuple(row["hidden"][0])
    told = [tuple(first["added"]), *map(tuple, first["twins"])]
    placed = true in told or cases.same(told[0], true)
    return placed or true[0] in {e for e, _ in told}, placed


def sized(row):
    """Whether every coefficient of the first effect holds the truth or is within 10 % of it; None for a twin."""
    first = row["steps"][0] if row["steps"] else None
    if first is None or first["added"] != row["hidden"][0]:
        return None
    good = [low <= row["truth"][0][n] <= high or abs(value - row["truth"][0][n]) <= 0.1 * abs(row["truth"][0][n])
            for n, (value, low, high) in first["coefficients"].items() if n != "phase"]
    return all(good)


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--half", choices=("development", "final"))
    parser.add_argument("--share", type=float, default=1.0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kinds", nargs="*")
    parser.add_argument("--effects", nargs="*")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--on", default="processes", help="or serial, threads, dask://host:port")
    parser.add_argument("--out", type=Path, default=Path("hidden_effects.jsonl"))
    args = parser.parse_args()
    wanted = [c for c in cases.all_cases(args.share, args.first)
              if args.half in (None, c.half) and (not args.kinds or c.kind in args.kinds)
              and (not args.effects or set(c.effects) & set(args.effects))]
    known = [json.loads(line) for line in args.out.read_text().splitlines()] if args.out.exists() else []
    done = {(r["kind"], *r["effects"], r["seed"]) for r in known}
    wanted = sorted((c for c in wanted if (c.kind, *c.effects, c.seed) not in done), key=lambda c: c.seed)
    with executor(args.on, args.workers) as pool, args.out.open("a") as out:
        for future in as_completed([pool.submit(run, c) for c in wanted]):
            out.write(json.dumps(future.result(), default=float) + "\n")
            out.flush()


if __name__ == "__main__":
    main()

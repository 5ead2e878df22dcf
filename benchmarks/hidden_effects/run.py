"""Hide effects in logs of the independent machine, improve each, and print how often the diagnosis is right.

    python -m benchmarks.hidden_effects.run [--half development|final] [--share 1.0] [--out cases.jsonl]
                                            [--kinds one weak pair none paired outside paper] [--effects viscous ...]

Cases that the output file already holds are not run again. Each case is a study that the many-studies engine of
``pycosim improve`` takes. `python -m benchmarks.hidden_effects.summary cases.jsonl`
prints the tables and draws the confusion matrix.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import pycosim as pc
from benchmarks.hidden_effects import cases
from benchmarks.hidden_effects import machine as rig
from benchmarks.rows import append, known
from pycosim.cli.batch import improve_all
from pycosim.core.executors import each
from pycosim.study.parse import load_study
from pycosim.study.write import write_study

ROOT = Path(__file__).parents[2]
STUDY = ROOT / "examples" / "hip_knee" / "study.toml"
TOGETHER = 32  # cases whose logs are kept at a time, some MB each; between two lots a worker may wait for the last case


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
    return next(rows([case]))


def rows(wanted, where="serial", workers=None):
    """Run cases: write studies and logs, improve them as ``pycosim improve STUDY ... --bare`` does, judge what it left.

    Parameters
    ----------
    wanted : list of Case
    where, workers
        As for `pycosim.core.executors.executor`.

    Yields
    ------
    dict
        A row of the table.

    Raises
    ------
    RuntimeError
        A study failed.
    """
    for first in range(0, len(wanted), TOGETHER):
        some = wanted[first:first + TOGETHER]
        with tempfile.TemporaryDirectory() as name:
            study = {c: Path(name) / f"{'_'.join((c.kind, *c.effects))}_{c.seed}.toml" for c in some}
            skipped = {c: future.result() for c, future in
                       each({c: (make, c, study[c]) for c in some}, where, workers)}
            yield from (_named(c) | {"skipped": why} for c, why in skipped.items() if why)
            made = [c for c in some if not skipped[c]]
            # of the paper's machine only the fit is asked for: no search, so nothing to improve
            searched = [c for c in made if c.kind != "paper"]
            done = dict(zip(searched, improve_all([study[c] for c in searched], Path(name) / "out", where, workers,
                                                  bare=True)))
            failed = [f"{row['study']}: {row['failure']}" for row in done.values() if row["failure"]]
            if failed:
                raise RuntimeError("; ".join(failed))
            left = {c: (Path(name) / "out" / study[c].stem, row["seconds"]) for c, row in done.items()}
            judged = {c: (judge, c, study[c], *left.get(c, (None, None))) for c in made}
            yield from (future.result() for _, future in each(judged, where, workers))


def make(case, study):
    """Write the study, the log and the truth of a case.

    Parameters
    ----------
    case : Case
    study : Path
        Where the study goes; log and truth stand beside it.

    Returns
    -------
    str
        Why it cannot be made; empty where it was.
    """
    try:
        drawn = cases.draw(case)
    except rig.MachineError as error:
        return str(error)
    path = study.with_suffix(".csv")
    rig.write_csv(cases.log(drawn, case.seed, reference=None if case.kind == "paired" else "gravity_model"), path)
    write_study(cases.study(load_study(STUDY), case.effects).with_data([path]), study)
    truth = {"machine": drawn.machine, "sizes": drawn.sizes, "short": drawn.short,
             "hidden": [[h.id, h.place] for h in drawn.hidden], "truth": [dict(h.coefficients) for h in drawn.hidden]}
    study.with_suffix(".json").write_text(json.dumps(truth, default=float))
    return ""


def judge(case, study, out, seconds):
    """What a search said, beside the truth and beside the true model, fitted.

    Parameters
    ----------
    case : Case
    study : Path
        Of `make`.
    out : Path or None
        What ``pycosim improve`` left; None where only the fit is asked for.
    seconds : float or None
        That it took.

    Returns
    -------
    dict
        A row of the table.
    """
    truth = json.loads(study.with_suffix(".json").read_text())
    project = pc.open(study)
    base = _base(project.fit().solution, truth.pop("machine"))
    if out is None:
        return {**_named(case), "base": base}
    hidden = [rig.Effect(*key, **values) for key, values in zip(truth["hidden"], truth["truth"])]
    found = pc.Search.load(out)
    row = {**_named(case), "seconds": seconds, "samples": len(project.dataset.time), **truth, **_found(found),
           "base": base}
    if hidden and case.kind != "outside":
        true = true_error(project.dataset, project.study, project.library, hidden)
        row["beside_true"] = max(row["held_out"][c] / true[c] for c in true)
    if case.kind == "outside":
        row["cause"] = _cause(hidden[0])
        guess = (found.first.record["unexplained"] or {}).get("proposal")
        row["guess"] = guess and [guess["variable"], guess["place"], guess["share"]]
    return row


def _named(case):
    return {"kind": case.kind, "effects": list(case.effects), "seed": case.seed, "half": case.half}


def _cause(effect):
    """Variables that an effect outside the catalogue acts over; both B stages accelerate alike."""
    if effect.id == "bump":
        return [f"theta{int(effect['motor'])}"]
    if effect.id == "acceleration_friction":
        return [f"acceleration@{p}" for p in (("1B", "2B") if effect.place.endswith("B") else (effect.place,))]
    return ["time"]


def _found(search):
    """What the search says, as plain values."""
    first, last = search.first, search.last
    best = first.candidates[0]
    steps = [{"added": list(s.record["added"].values()), "twins": [list(t.values()) for t in s.record["alternatives"]],
              "coefficients": {n: [c["value"], *c["ci95"]] for n, c in s.record["coefficients"].items()},
              "before": b.error, "predicted": s.predicted_error, "realised": s.error}
             for b, s in zip(search.steps[:-1], search.steps[1:])]
    return {"verdict": first.verdict, "final": last.verdict, "steps": steps,
            "held_out": search.steps[-1].held_out_error,
            "p": min(c.p_value for c in first.candidates), "p_final": min(c.p_value for c in last.candidates),
            "best": list(best.key),
            "depends": [[d["variable"], d["strength"]] for d in first.record["residual_depends_on"][:3]]}


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
    done = {(r["kind"], *r["effects"], r["seed"]) for r in known(args.out)}
    wanted = sorted((c for c in wanted if (c.kind, *c.effects, c.seed) not in done), key=lambda c: c.seed)
    for count, row in enumerate(append(args.out, rows(wanted, args.on, args.workers)), 1):
        print(f"{count} of {len(wanted)}: {row['kind']} {' '.join(row['effects'])} {row['seed']}", flush=True)


if __name__ == "__main__":
    main()

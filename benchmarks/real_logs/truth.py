"""In: adverse logs and what is hidden in them. Out: what the diagnosis says of the model that has all of it.

    python -m benchmarks.real_logs.truth --conditions gait,lag_current --first 5 --out truth.jsonl

Whatever it says is missing beside the truth is a fault of physics, noise or fit, and no search could come to a right
answer there. A condition that is itself an error of a channel or of the reference brings the effect that names it,
at the place where it leaves least.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from benchmarks.real_logs import cases
from benchmarks.real_logs.make import make
from benchmarks.rows import append, known
from pycosim.compile import compile_model, component_name, find_effect, places
from pycosim.core.errors import PycosimError
from pycosim.core.executors import each
from pycosim.diagnosis.decide import diagnose
from pycosim.fit import least_squares
from pycosim.project.project import open_project

APART = ("mistake", "poor", "outside", "outside_digital", "outside_gait")
"""Conditions whose truth is no model of the catalogue's."""
STARTS = {"low_pass": {"T": 0.03}, "reference_lag": {"T": 0.03}}


def told(case):
    """Make a log, fit the model that has what is hidden in it, and diagnose that.

    Parameters
    ----------
    case : Case

    Returns
    -------
    dict
        A row: the model, its verdict, what was accepted or held for possible, coefficients with intervals, seconds.
    """
    row, begun = {"case": case.name, "condition": case.condition}, time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        study = make(case, Path(folder) / "log")
        truth = json.loads((study.parent / "truth.json").read_text())
        dataset = open_project(study, progress=lambda text: None).dataset
        start = dict(least_squares.fit(dataset, dataset.base).parameters)
        fits = [_fitted(dataset, truth, own, start) for own in _own(dataset, case)]
        fits = [found for found in fits if found is not None]
        if not fits:
            return {**row, "verdict": None, "said": "has no place in the rig"}
        model, fit = min(fits, key=lambda found: sum(found[1].error.values()))
        found = diagnose(dataset, model, fit, 0, None, False)
    names = [n for n in fit.free if n not in start]
    return row | {
        "model": ["@".join(k) for k in model.keys], "verdict": found.verdict,
        "said": "@".join((found.winner or found.provisional).key) if found.winner or found.provisional else "",
        "accepted": found.winner is not None, "slow": [c for c, own in found.channels.items() if own["slow"]],
        "coefficients": {n: [fit.parameters[n], *fit.interval(n)] for n in names}, "true": truth["coefficients"],
        "seconds": round(time.perf_counter() - begun, 1)}


def _own(dataset, case):
    """Effects that name the condition itself, place by place; nothing where it is none."""
    named = cases.CONDITIONS[case.condition].named
    if not named:
        return [()]
    effect = named[0][0]
    if named is cases.LAG:
        effect = "low_pass" if case.condition == "lag_current" else "reference_lag"
    known = find_effect(dataset.library, effect)
    return [((effect, place.name),) for place in places(dataset.library, dataset.study.rig, known)]


def _fitted(dataset, truth, own, start):
    """The model with the hidden effects and those of the condition, fitted from the truth; None without a place."""
    keys = [*dataset.base.keys, *map(tuple, truth["hidden"]), *own]
    try:
        model = compile_model(dataset.library, dataset.base.rig, keys)
    except PycosimError:
        return None
    values, attached = dict(start), model.attached[len(dataset.base.keys):]
    for at, given in zip(attached, [*truth["coefficients"], *(STARTS.get(effect, {}) for effect, _ in own)]):
        values |= {f"{component_name(*at)}.{n}": v for n, v in given.items()}
    known = {n: v.value for n, v in dataset.parameters.variables(model).items()}
    return model, least_squares.fit(dataset, model, {n: values.get(n, v) for n, v in known.items()})


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--conditions", default="all")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--hidden", type=int, default=2)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("truth.jsonl"))
    args = parser.parse_args()
    wanted = list(cases.CONDITIONS) if args.conditions == "all" else args.conditions.split(",")
    done = {row["case"] for row in known(args.out)}
    planned = cases.listed([c for c in wanted if c not in APART], args.seeds, args.first, args.hidden, True)
    work = {c.name: (told, replace(c, quick=True)) for c in planned if c.name not in done}
    for row in append(args.out, (future.result() for _, future in each(work, "processes", args.jobs))):
        print(row["verdict"], row["case"], row["said"], flush=True)


if __name__ == "__main__":
    main()

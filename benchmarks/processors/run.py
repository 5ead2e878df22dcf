"""The same logs under several processors' arithmetic, and disturbed in the twelfth digit; what changes, out.

    python -m benchmarks.processors.run [--kinds reference unpaired] [--worlds Haswell] [--workers 2] [--json rows.json]

OpenBLAS has an arithmetic of its own for each processor, which OPENBLAS_CORETYPE chooses as it is loaded: each world is
a process. Exits 1 where a verdict or an added effect is not everywhere the same; alternatives that change are listed.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import pycosim as pc
from benchmarks.hidden_effects import cases
from benchmarks.hidden_effects import machine as rig
from pycosim.core.executors import each

STUDY = Path(__file__).parents[2] / "examples" / "hip_knee" / "study.toml"
SEED = 5  # a log without torque reference of this seed once had a false effect on some processors and none on others
HIDDEN = "load_nonlinearity", "1A"
DISTURBED = "disturbed"
SMALL = 1e-12  # relative, of every number but the times: what any log's digits leave open, and more than rounding makes
NEEDS = {"Zen": "avx2", "Nehalem": "sse4_2", "Haswell": "avx2", "SkylakeX": "avx512f"}  # what a processor must have
USUAL = 2  # of these, the last that a machine has: they differ most


def worlds():
    """What this machine can pretend to be.

    Returns
    -------
    list of str
    """
    path = Path("/proc/cpuinfo")  # elsewhere than on Linux nothing is known, and nothing is tried
    flags = set(path.read_text().split()) if path.is_file() else set()
    return [name for name, flag in NEEDS.items() if flag in flags]


# --- the logs -------------------------------------------------------------------------------------------------------


def _measured(effects=(), seed=SEED, **more):
    drawn = cases.draw(cases.Case("none", (), SEED))
    hidden = [rig.calibrate(rig.draw(*e, np.random.default_rng(SEED)), 2.0, drawn.machine, drawn.motion, drawn.noise,
                            SEED) for e in effects]
    return rig.measure(drawn.machine, drawn.motion, hidden, drawn.noise, drawn.counts, seed, **more)


KINDS = {
    "reference": lambda: [_measured([("stribeck", "2A")])],
    "nothing hidden": lambda: [_measured()],
    "unpaired": lambda: [_measured([HIDDEN], reference=None)],
    "two loads": lambda: [_measured([HIDDEN], 10 * SEED + k, leg=leg) for k, leg in enumerate((rig.Leg(),
                                                                                              rig.Leg(m2=5.0)))],
}
"""A log with joint torques and one without an effect; one without joint torques; one of two runs."""


def make(folder, kinds):
    """Write the logs, as they are and disturbed.

    Parameters
    ----------
    folder : Path
    kinds : sequence of str
    """
    rng = np.random.default_rng(0)
    for kind in kinds:
        for k, frame in enumerate(KINDS[kind]()):
            disturbed = frame.copy()
            for name in frame.select_dtypes("number").columns.drop("time"):
                disturbed[name] *= 1 + SMALL * rng.standard_normal(len(frame))
            for table, world in ((frame, "as it is"), (disturbed, DISTURBED)):
                path = folder / world / kind.replace(" ", "_") / f"run{k}.csv"
                path.parent.mkdir(parents=True, exist_ok=True)
                table.to_csv(path, index=False, float_format="%.17g")


# --- the answers ----------------------------------------------------------------------------------------------------


def answer(folder):
    """What `improve` says of the logs in a folder.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    dict
        ``verdict``, ``added`` (effect@place, in order), ``left`` (the last verdict): what must not change; besides,
        ``alternatives`` of each step, ``errors`` and ``p_values``.
    """
    found = pc.open(STUDY, data=sorted(folder.glob("*.csv"))).improve().found
    steps = found.steps[1:]
    return {"verdict": found.first.verdict, "added": ["@".join(s.added) for s in steps], "left": found.last.verdict,
            "alternatives": [sorted("@".join(t.values()) for t in s.finding.twins) for s in steps],
            "errors": [s.error for s in found.steps],
            "p_values": {f"{c.effect}@{c.place}": c.p_value for c in found.first.candidates[:5]}}


def ask(folder, world, kind):
    """The answer for a kind of log in a process of its own.

    Parameters
    ----------
    folder : Path
        Of `make`.
    world : str
        Of `worlds`, ``disturbed``, or ``as it is``.
    kind : str

    Returns
    -------
    dict
        As of `answer`, with ``seconds``.
    """
    known = {**os.environ, "OMP_NUM_THREADS": "1", **({"OPENBLAS_CORETYPE": world} if world in NEEDS else {})}
    logs = folder / (world if world == DISTURBED else "as it is") / kind.replace(" ", "_")
    began = time.monotonic()
    done = subprocess.run([sys.executable, "-m", "benchmarks.processors.run", "--answer", str(logs)], env=known,
                          cwd=Path(__file__).parents[2], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{kind} under {world}: {done.stderr.strip().splitlines()[-1:]}")
    return {**json.loads(done.stdout), "seconds": time.monotonic() - began}


def changes(answers):
    """What is not the same everywhere.

    Parameters
    ----------
    answers : dict of str to dict
        By world, of one kind of log.

    Returns
    -------
    decided, other : list of str
        Changed verdicts and effects; changed alternatives.
    """
    (first, usual), *rest = answers.items()
    told = {key: [f"{key}: {usual[key]} under {first}, {found[key]} under {world}" for world, found in rest
                  if found[key] != usual[key]] for key in ("verdict", "added", "left", "alternatives")}
    return told["verdict"] + told["added"] + told["left"], told["alternatives"]


def spread(answers):
    """Largest relative difference of the steps' errors between worlds in which the same was added.

    Parameters
    ----------
    answers : dict of str to dict

    Returns
    -------
    float
    """
    rows = [[e for step in found["errors"] for e in step.values()] for found in answers.values()]
    same = np.array([row for row in rows if len(row) == len(rows[0])])
    return float((np.ptp(same, axis=0) / same.min(0)).max())


def compare(kinds, asked, workers=1):
    """Ask everything in every world.

    Parameters
    ----------
    kinds, asked : sequence of str
        Kinds of logs, and worlds.
    workers : int

    Yields
    ------
    kind : str
    answers : dict of str to dict
        By world.
    """
    with tempfile.TemporaryDirectory() as name:
        make(Path(name), kinds)
        told = {kind: {} for kind in kinds}
        work = {(kind, world): (ask, Path(name), world, kind) for kind in kinds for world in asked}
        for (kind, world), future in each(work, "threads", workers):  # each waits for a process with its processor set
            told[kind][world] = future.result()
            if len(told[kind]) == len(asked):
                yield kind, {world: told[kind][world] for world in asked}


def report(kind, answers):
    """Lines on one kind of log, and what must not have changed.

    Parameters
    ----------
    kind : str
    answers : dict of str to dict
        By world.

    Returns
    -------
    lines, decided : list of str
    """
    decided, other = changes(answers)
    usual, seconds = next(iter(answers.values())), [a["seconds"] for a in answers.values()]
    lines = [f"{kind}: {usual['verdict']}, {', '.join(usual['added']) or 'nothing added'}, then {usual['left']}; "
             f"errors differ by {spread(answers):.1e} between {', '.join(answers)}; {min(seconds):.0f} to "
             f"{max(seconds):.0f} s each"]
    return lines + [f"  {line}" for line in [*decided, *other] or ["the same everywhere"]], decided


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--worlds", nargs="+", default=[*worlds()[-USUAL:], DISTURBED],
                        help="names of OpenBLAS's cores, and 'disturbed'")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--json", type=Path, help="answers, as JSON")
    parser.add_argument("--answer", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.answer:
        print(json.dumps(answer(args.answer), default=float))
        return
    found, wrong = {}, []
    for kind, answers in compare(args.kinds, args.worlds, args.workers):
        lines, decided = report(kind, answers)
        print(*lines, sep="\n", flush=True)
        found[kind], wrong = answers, wrong + decided
    if args.json:
        args.json.write_text(json.dumps(found, indent=1, default=float) + "\n", encoding="utf-8")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()

"""Make logs of adverse worlds, diagnose each through the command line, judge what it says, and print the table.

    python -m benchmarks.real_logs.run --conditions digital,gait --seeds 4 --out rows.jsonl [--quick] [--list]
    python -m benchmarks.real_logs.run summary rows.jsonl [--table status.md]
    python -m benchmarks.real_logs.run oracle rows.jsonl      adds what nobody could tell apart to the rows

Each condition has `--seeds` logs with nothing hidden and `--hidden` times as many with effects; rows that the output
file already holds are not run again. `--conditions all` is every condition, `closed_loop` the driven machines of
`closed_loop.py`, `measured` the studies of `examples` on measured data beside the project. Each run has a limit of time
and of memory, and its peak memory is recorded.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from dataclasses import replace
from functools import partial
from pathlib import Path

from benchmarks.real_logs import cases, closed_loop
from benchmarks.real_logs.make import ROOT, make
from benchmarks.real_logs.score import fits, names, score, wrong_alternatives
from benchmarks.rows import append, known
from pycosim.core.executors import each

LIMIT_SECONDS, LIMIT_BYTES = 300, 4 << 30
"""Of the processor's time, so that a busy machine changes nothing; five times as long by the clock."""
SPECIAL = ("measured", "scenario", "closed_loop")
MEASURED = ("screw_drives/drive1", "screw_drives/drive2", "servo_pendulum/study", "emps/study", "double_pendulum/study")


def run(case, verb="improve", keep=None, bare=False):
    """Make a case, run a verb on it, and say what came of it.

    Parameters
    ----------
    case : Case
    verb : str
        improve or diagnose.
    keep : Path, optional
        Folder to leave logs and results in.
    bare : bool
        As of `call`.

    Returns
    -------
    dict
        A row: what was hidden, verdicts, steps with their alternatives, seconds, peak memory, and the judgement.
    """
    row = {"case": case.name, "condition": case.condition, "what": case.what, "seed": case.seed, "quick": case.quick}
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(keep or folder) / case.name.replace(":", "_")
        try:
            study = make(case, folder)
        except ValueError as error:
            return {**row, "skipped": str(error)}
        truth = json.loads((folder / "truth.json").read_text())
        row |= {n: truth[n] for n in ("hidden", "coefficients", "sizes", "samples", "floor", "own_size")}
        row |= call(verb, study, folder / "out", bare)
        if case.condition == "mistake":
            row["findings"] += findings(study, folder / "check")
    row["score"] = score(row)
    return row


def call(verb, study, out, bare=False):
    """Run a verb of the command line on a study, within limits; what it said, as plain values.

    Parameters
    ----------
    verb : str
    study, out : Path
    bare : bool
        Leave figures and the page out: they decide nothing.

    Returns
    -------
    dict
    """
    code, text, errors, peak, spent = _command([verb, str(study), "--out", str(out), "--quiet",
                                                *(["--bare"] if bare and verb == "improve" else [])])
    found = {"seconds": round(spent, 1), "peak_mib": round(peak / 2 ** 20), "exit": code,
             "verdict": None, "final": None, "steps": [], "depends": [], "findings": [], "blocked": False,
             "failure": ""}
    said = (errors.strip() or text.strip()).splitlines()
    if code is None:
        return {**found, "failure": f"over {LIMIT_SECONDS:g} s"}
    if "Traceback" in errors or code == 1 or code < 0:
        return {**found, "failure": said[-1][:300] if said else f"exit {code}"}
    if code == 2:
        known = [k for k in KINDS if any(word in errors.lower() for word in KINDS[k])]
        return {**found, "blocked": True, "message": " ".join(said)[:600], "findings": known}
    return found | _said(out)


# Words by which a blocking sentence is recognised where `check.json` is not at hand.
KINDS = {"sign": ("negate", "sign"), "swap": ("swap",), "scale": ("scale", "factor"),
         "unit": ("degree", "unit", "counts", "millisecond", "rpm", "mn.m"), "wrap": ("wrap",),
         "stuck": ("stuck", "does not change", "constant"), "clock": ("clock", "drift"), "shift": ("late", "shift"),
         "clipped": ("clip",), "rate": ("rate",)}


def findings(study, out):
    """Kinds of findings that `pycosim check` lists; none where the verb is missing."""
    _command(["check", str(study), "--out", str(out), "--quiet"])
    path = out / "check.json"
    return [f["kind"] for f in json.loads(path.read_text())["findings"]] if path.exists() else []


def _command(arguments):
    """Exit code (None where time ran out), output, errors, peak memory in bytes and processor's seconds."""
    def limited():
        resource.setrlimit(resource.RLIMIT_AS, (LIMIT_BYTES, LIMIT_BYTES))
        resource.setrlimit(resource.RLIMIT_CPU, (LIMIT_SECONDS, LIMIT_SECONDS))
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    with tempfile.TemporaryFile("w+") as text, tempfile.TemporaryFile("w+") as errors:
        child = subprocess.Popen([sys.executable, "-m", "pycosim.cli", *arguments], stdout=text, stderr=errors,
                                 env=environment, preexec_fn=limited)
        code, peak, spent, stop = None, 0, 0.0, time.monotonic() + 5 * LIMIT_SECONDS
        while time.monotonic() < stop and code is None:
            pid, status, usage = os.wait4(child.pid, os.WNOHANG)
            if pid:
                code, peak = os.waitstatus_to_exitcode(status), usage.ru_maxrss * 1024
                child.returncode, spent = code, usage.ru_utime + usage.ru_stime
            else:
                time.sleep(0.2)
        if code is None:
            child.kill()
            child.wait()
        text.seek(0)
        errors.seek(0)
        late = code in (-signal.SIGXCPU, -signal.SIGKILL)
        return None if late else code, text.read(), errors.read(), peak, spent


def _said(out):
    """Verdicts and steps that a verb left."""
    first = json.loads((out / "diagnosis.json").read_text())
    last, steps = first, []
    if (out / "diagnosis_final.json").exists():
        last = json.loads((out / "diagnosis_final.json").read_text())
    if (out / "ladder.json").exists():
        ladder = json.loads((out / "ladder.json").read_text())["steps"]
        for before, step in zip(ladder, ladder[1:]):
            steps.append({"added": list(step["added"].values()),
                          "twins": [[t["effect"], t["place"]] for t in step["alternatives"]],
                          "before": before["held_out_error"], "after": step["held_out_error"],
                          "coefficients": {n: [v["value"], *v["ci95"]] for n, v in step["coefficients"].items()}})
    best = [[c["effect"], c["place"], c["p_value"], c.get("refused")] for c in first["candidates"][:3]]
    return {"verdict": first["verdict"], "final": last["verdict"], "steps": steps, "best": best,
            "depends": [[d["variable"], round(d["strength"], 3)] for d in last.get("residual_depends_on", [])[:3]]}


SCENARIOS = ("six_manoeuvres", "gait", "backdrive", "standstill")
# Steps and noise of the signals that a scenario logs exactly: 2^14 steps a turn, N.m.
SENSED = {"theta": "quantum = 3.834952e-4", "tau": "noise = 6e-3", "C": "noise = 0.03", "q": "quantum = 9.587380e-5"}


def scenario(name, seed, bare=False):
    """Co-simulate a scenario of the examples with seeded noise and steps, nothing hidden, and improve its log.

    Parameters
    ----------
    name : str
    seed : int
    bare : bool
        As of `call`.

    Returns
    -------
    dict
    """
    row = {"case": f"scenario:{name}::{seed}", "condition": "scenario", "what": name, "seed": seed, "hidden": []}
    with tempfile.TemporaryDirectory() as folder:
        there = Path(folder) / "cosim"
        shutil.copytree(ROOT / "examples" / "cosim", there)
        path = there / f"{name}.toml"
        text = re.sub(r"^seed = .*$", "", path.read_text(), flags=re.M)
        for column, what in SENSED.items():
            text = re.sub(rf'^({column}(?:1|2|_H|_K)) = ("plant[^"]*")$', rf"\1 = {{ signal = \2, {what} }}", text,
                          flags=re.M)
        path.write_text(f"seed = {seed}\n" + text)
        code, _, errors, _, _ = _command(["cosim", str(path), "--out", str(there / "out"), "--quiet"])
        if code:
            return {**row, "failure": f"cosim: {errors[-200:]}", "score": "failed", "seconds": 0, "peak_mib": 0}
        study = there / "study.toml"
        study.write_text((ROOT / "examples" / "hip_knee" / "study.toml").read_text().replace(
            "runs = []", 'runs = ["out/run.csv"]', 1))
        row |= call("improve", study, there / "improved", bare)
    return {**row, "score": score(row)}


def driven(machine, motion, effect, seed, bare=False):
    """Make the log of a machine under control, and improve its study.

    Parameters
    ----------
    machine, motion, effect : str
    seed : int
    bare : bool
        As of `call`.

    Returns
    -------
    dict
    """
    row = {"case": f"closed_loop:{machine}:{motion}:{effect}:{seed}", "condition": "closed_loop", "what": effect,
           "seed": seed}
    with tempfile.TemporaryDirectory() as folder:
        study = closed_loop.make(machine, motion, effect, seed, folder)
        row |= json.loads((study.parent / "truth.json").read_text())
        row |= call("improve", study, study.parent / "out", bare)
    return {**row, "score": score(row)}


def measured(name, bare=False):
    """Improve a study of `examples` on measured data.

    Parameters
    ----------
    name : str
        Path below `examples`, without its end.
    bare : bool
        As of `call`.

    Returns
    -------
    dict
    """
    row = {"case": f"measured:{name}", "condition": "measured", "what": name, "hidden": [], "seed": 0}
    study = ROOT / "examples" / f"{name}.toml"
    if not study.exists():
        return {**row, "skipped": f"no {study}"}
    with tempfile.TemporaryDirectory() as out:
        return row | call("improve", study, Path(out) / "out", bare)


# --- summary


def summary(rows):
    """The table, condition by condition.

    Parameters
    ----------
    rows : list of dict

    Yields
    ------
    str
        Lines of Markdown.
    """
    rows = [r for r in rows if "skipped" not in r]
    groups = defaultdict(list)
    for r in (r for r in rows if r["condition"] != "measured"):
        groups[r["condition"]].append({**r, "score": score(r)})
    yield ("| condition | nothing hidden: right | something hidden: right | undecided | missed | wrong | wrong "
           "alternatives | stopped | failed | seconds (median, most) | MiB |")
    yield "|---|---|---|---|---|---|---|---|---|---|---|"
    for condition, some in groups.items():
        yield _counted(condition, some)
    if len(groups) > 1:
        yield _counted("all", [r for some in groups.values() for r in some])
    yield ""
    for r in rows:
        judged = score(r) if r["condition"] != "measured" else "measured"
        if judged != "right":
            yield f"- {judged}: `{r['case']}` {told(r)}"


def _counted(name, some):
    """A line of the table: what is not right with nothing hidden is counted beside the rest."""
    sound, others = ([r for r in some if bool(r["hidden"]) == what] for what in (False, True))
    right = [f"{sum(r['score'] == 'right' for r in part)} of {len(part)}" if part else "" for part in (sound, others)]
    count = [sum(r["score"] in s for r in some) or "" for s in (
        ("undecided",), ("missed",), ("wrong", "misnamed"), ("blocked",), ("failed",))]
    count.insert(3, sum(bool(wrong_alternatives(r)) for r in some) or "")
    seconds = sorted(r["seconds"] for r in some)
    return (f"| {name} | {' | '.join([*right, *map(str, count)])} | "
            f"{seconds[len(seconds) // 2]:.0f}, {seconds[-1]:.0f} | {max(r['peak_mib'] for r in some)} |")


def _asked(row):
    """A row with the oracle's answer to each effect in it that is neither hidden nor the condition's name."""
    from benchmarks.real_logs import oracle
    if not row.get("steps") or len(row["hidden"]) > 1 or row["condition"] in ("mistake", "poor", *SPECIAL):
        return row
    hidden, condition = names(row)
    gaps = row.setdefault("gaps", {})
    for step in row["steps"]:
        for name in (tuple(step["added"]), *map(tuple, step["twins"])):
            key = "@".join(name)
            if key not in gaps and not fits({"added": name, "twins": []}, [*hidden, *condition]):
                case = replace(cases.parse(row["case"]), quick=row["quick"])
                gaps[key] = oracle.gap(case, name, {n: v[0] for n, v in step["coefficients"].items()})
    return row


def told(row):
    """What was said of a log, in a line."""
    if row["failure"]:
        return f"{row['failure']} (after {row['seconds']:g} s)"
    hidden = ", ".join(f"{e}@{p} ({s:.2f})" for (e, p), s in zip(row["hidden"], row.get("sizes", []))) or "nothing"
    if row["blocked"]:
        return f"hidden {hidden}: {row.get('message', 'blocked')[:240]}"
    steps = "; ".join("@".join(s["added"]) + (f" (or {', '.join('@'.join(t) for t in s['twins'])})" if s["twins"] else
                                              "") for s in row["steps"])
    best = ", ".join(f"{e}@{p} p={v:.3g}" + (f" ({why[0]})" if why and why[0] else "")
                     for e, p, v, *why in row.get("best", []))
    return (f"hidden {hidden}: {row['verdict']} -> {steps or 'no effect'} -> {row['final']}; "
            f"first: {best}; depends on {row['depends']}")


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", nargs="*", help="summary FILE...")
    parser.add_argument("--conditions", default="plain")
    parser.add_argument("--cases", nargs="*", help="names of cases, instead of conditions")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--hidden", type=int, default=2)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--verb", default="improve", choices=("improve", "diagnose"))
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--bare", action="store_true", help="no figures, no page")
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--table", type=Path)
    parser.add_argument("--out", type=Path, default=Path("real_logs.jsonl"))
    args = parser.parse_args()
    if args.action and args.action[0] == "oracle":
        for path in map(Path, args.action[1:]):
            rows = [_asked(json.loads(line)) for line in path.read_text().splitlines()]
            path.write_text("".join(json.dumps(r) + "\n" for r in rows))
        return
    if args.action:
        rows = [json.loads(line) for path in args.action[1:] for line in Path(path).read_text().splitlines()]
        lines = "\n".join(summary(rows))
        print(lines)
        if args.table:
            args.table.write_text(lines + "\n")
        return
    wanted = list(cases.CONDITIONS) if args.conditions == "all" else args.conditions.split(",")
    if unknown := [c for c in wanted if c not in SPECIAL and c not in cases.CONDITIONS]:
        parser.error(f"no condition '{unknown[0]}'; one of all, {', '.join([*cases.CONDITIONS, *SPECIAL])}")
    planned = cases.listed([c for c in wanted if c not in SPECIAL], args.seeds, args.first, args.hidden, args.quick)
    if args.cases:
        try:
            planned = [replace(cases.parse(name), quick=args.quick) for name in args.cases]
        except ValueError as error:
            parser.error(str(error))
    if args.list:
        print("\n".join(c.name for c in planned))
        return
    work = [partial(run, c, args.verb, args.keep, args.bare) for c in planned]
    work += [partial(scenario, name, s, args.bare) for s in range(args.first, args.first + args.seeds)
             for name in SCENARIOS if "scenario" in wanted]
    work += [partial(driven, *kind, s, args.bare) for s in range(args.first, args.first + args.seeds)
             for kind in closed_loop.cases() if "closed_loop" in wanted]
    work += [partial(measured, name, args.bare) for name in MEASURED if "measured" in wanted]
    _work(work, args)


def _work(work, args):
    """Run what the output file does not hold yet; a row a line, as they come.

    Each is a process of its own, with limits of time and memory that a worker of the many-studies engine could not have
    of itself; threads only wait for them.
    """
    done = {row["case"] for row in known(args.out)}
    left = {_name(one): (one,) for one in work if _name(one) not in done}
    for row in append(args.out, (future.result() for _, future in each(left, "threads", args.jobs))):
        print(row.get("score", row.get("skipped", "")), row["case"], flush=True)


def _name(work):
    """Name of the case that a piece of work runs."""
    if work.func is run:
        return work.args[0].name
    if work.func is driven:
        return "closed_loop:" + ":".join(map(str, work.args[:4]))
    return f"scenario:{work.args[0]}::{work.args[1]}" if work.func is scenario else f"measured:{work.args[0]}"


if __name__ == "__main__":
    main()

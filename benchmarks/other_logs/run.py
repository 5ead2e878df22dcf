"""Make the logs of some seeds, improve each study through the command line, judge what it says, and print the table.

    python -m benchmarks.other_logs.run --seeds 1 75 --out rows.jsonl [--jobs 1]
    python -m benchmarks.other_logs.run summary rows.jsonl

Both ends of the seeds are included; rows that the output file already holds are not run again. Each run has the limits
of time and memory of `real_logs`.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

from benchmarks.other_logs.make import make
from benchmarks.other_logs.score import SCORES, outside, score
from benchmarks.real_logs.run import call, told
from benchmarks.rows import append, known
from pycosim.core.executors import each

GROUPS = ("nothing", "effects", "outside laws")


def run(seed):
    """Make the log of a seed, improve its study, and say what came of it.

    Parameters
    ----------
    seed : int

    Returns
    -------
    dict
        A row: what was hidden, verdicts, steps with their alternatives, seconds, peak memory, and the judgement.
    """
    with tempfile.TemporaryDirectory() as folder:
        study = make(seed, folder)
        truth = json.loads((study.parent / "truth.json").read_text())
        hidden = truth.pop("hidden")
        row = {"case": f"other:{seed}", **truth, "hidden": [[h["effect"], h["place"]] for h in hidden],
               "coefficients": [h["coefficients"] for h in hidden], "sizes": [h["ratio"] for h in hidden]}
        row |= call("improve", study, study.parent / "out", bare=True)
    return {**row, "score": score(row)}


def group(row):
    """Kind of what is hidden.

    Parameters
    ----------
    row : dict

    Returns
    -------
    str
        One of `GROUPS`.
    """
    if not row["hidden"]:
        return "nothing"
    return "outside laws" if outside(row["hidden"]) else "effects"


def summary(rows):
    """The table, and a line for each answer that was not right.

    Parameters
    ----------
    rows : list of dict

    Yields
    ------
    str
        Lines of Markdown.
    """
    rows = [{**row, "score": score(row)} for row in rows]
    yield f"| hidden | logs | {' | '.join(SCORES)} |"
    yield "|---" * (2 + len(SCORES)) + "|"
    for kind in GROUPS:
        scores = [row["score"] for row in rows if group(row) == kind]
        yield f"| {kind} | {len(scores)} | {' | '.join(str(scores.count(s)) for s in SCORES)} |"
    yield ""
    for row in sorted(rows, key=lambda row: row["seed"]):
        if row["score"] != "right":
            kinds = ", ".join(dict.fromkeys(row["kinds"]))
            yield f"- {row['score']}: `{row['case']}` ({kinds}; {row['quirk']}) {told(row)}"


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", nargs="*", help="summary FILE...")
    parser.add_argument("--seeds", type=int, nargs=2, default=(1, 75), metavar=("FIRST", "LAST"))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("other_logs.jsonl"))
    args = parser.parse_args()
    if args.action:
        if args.action[0] != "summary":
            parser.error(f"no action {args.action[0]}")
        print("\n".join(summary([row for path in args.action[1:] for row in known(Path(path))])))
        return
    first, last = args.seeds
    done = {row["seed"] for row in known(args.out)}
    work = {seed: (run, seed) for seed in range(first, last + 1) if seed not in done}
    for row in append(args.out, (future.result() for _, future in each(work, "threads", args.jobs))):
        print(row["score"], row["case"], flush=True)


if __name__ == "__main__":
    main()

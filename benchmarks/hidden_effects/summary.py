"""Rows of `benchmarks.hidden_effects.run` in; the table of the track record and the confusion matrix out.

    python -m benchmarks.hidden_effects.summary cases.jsonl [--figure docs/images/confusion.png]
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path

import numpy as np
from scipy import stats

from benchmarks.hidden_effects import cases
from benchmarks.hidden_effects.run import right, sized
from pycosim.report.figures import save
from pycosim.report.plot import Axis, Cells, Panel, Plot

TOP = """# Track record

How often the diagnosis was right about effects hidden in logs of an independently written machine
(`benchmarks/hidden_effects`): random friction, speeds in random order, coloured noise, drives that report in steps, a
recorder that misses samples; sizes, places, signs and other coefficients drawn continuously. *Size* is the error of the
base model with the effect over the error without it. Made by

    python -m benchmarks.hidden_effects.run{half} --out cases.jsonl
    python -m benchmarks.hidden_effects.summary cases.jsonl --figure docs/images/confusion.png > this page
"""
WORDS = {"none": "with nothing hidden", "paired": "with nothing hidden and no torque reference",
         "one": "with one effect of size 1.3 to 3",
         "weak": "with one effect of size 1.2",
         "pair": "with two effects", "paper": "of the paper's machine, nothing hidden, fitted only",
         "outside": "with an effect that the catalogue lacks"}
OTHER = {"nothing_missing": "nothing", "unexplained": "unexplained", "not_enough_excitation": "too little"}


def share(values):
    """Counted shares as text: ``31 of 33 (94 %)``."""
    values = [bool(v) for v in values if v is not None]
    return f"{sum(values)} of {len(values)} ({100 * np.mean(values):.0f} %)" if values else "not run"


def table(rows):
    """What the issue of the benchmark asks for, goal by goal.

    Parameters
    ----------
    rows : list of dict

    Returns
    -------
    list of (str, str, str)
        Claim, goal, measured.
    """
    kind = {k: [r for r in rows if r["kind"] == k] for k in WORDS}
    hidden = [*kind["one"], *kind["weak"]]
    small = [r for r in hidden if min(r["sizes"]) < cases.LEAST]
    large = [r for r in hidden if r not in small]
    first = [s for r in [*hidden, *kind["pair"]] for s in r["steps"][:1]]
    found = [
        ("one effect, size 1.3 to 3: named first", "97 %", share(right(r)[0] for r in large)),
        ("and in the right place", "95 %", share(right(r)[1] for r in large)),
        ("size below 1.3: named first", "85 %", share(right(r)[0] for r in small)),
        ("one effect: nothing else is added", "", share(len(r["steps"]) == 1 for r in large)),
        ("coefficients inside the interval, or within 10 %", "", share(sized(r) for r in large)),
        ("pairs: both found, nothing else", "85 %", share(map(both, kind["pair"]))),
        ("nothing hidden: false alarms", "2 %", share(r["verdict"] != "nothing_missing" for r in kind["none"])),
        ("nothing hidden, no torque reference: false alarms", "",
         share(r["verdict"] != "nothing_missing" for r in kind["paired"])),
        ("not in the catalogue: unexplained", "90 %", share(r["verdict"] == "unexplained" for r in kind["outside"])),
        ("and the variable it acts over named first", "90 %",
         share(r["depends"][0][0] in r["cause"] for r in kind["outside"])),
        ("held-out error within 5 % of the fitted true model's", "95 %",
         share(r["beside_true"] <= 1.05 for r in [*hidden, *kind["pair"]])),
        ("predicted fall over realised fall, 0.8 to 1.25", "90 %", share(map(foreseen, first))),
        ("seconds of improve, median and longest", "15", seconds(rows)),
    ]
    for name, logs in (("none", ""), ("paired", ", no torque reference")):
        if len(kind[name]) > 20:
            p = np.array([r["p"] for r in kind[name]])
            found.append((f"smallest family-wise p-values uniform{logs} (Kolmogorov-Smirnov p)", "> 0.01",
                          f"{stats.kstest(p, 'uniform').pvalue:.3f} over {len(p)}"))
    return found + coverage(kind["none"], "random machines") + coverage(kind["paper"], "the paper's machine")


def both(row):
    """Whether a pair was found, each with its place or a twin, and nothing else."""
    told = [{tuple(s["added"]), *map(tuple, s["twins"])} for s in row["steps"]]
    if len(told) != len(row["hidden"]):
        return False
    true = [tuple(h) for h in row["hidden"]]

    def hits(names, one):
        return any(cases.same(n, one) for n in names)
    return (hits(told[0], true[0]) and hits(told[1], true[1])) or (hits(told[0], true[1]) and hits(told[1], true[0]))


def foreseen(step):
    """Whether the fall of the error that the score predicts is near the one that adding the effect brings.

    None for an effect that came first only after others had been found.
    """
    if not step["predicted"]:
        return None
    fall = {c: (step["before"][c] - step["predicted"][c], step["before"][c] - step["realised"][c])
            for c in step["before"]}
    predicted, realised = max(fall.values(), key=lambda f: f[1])
    return bool(0.8 <= predicted / realised <= 1.25) if realised > 0 else False


def seconds(rows):
    """Median and largest time of a case."""
    taken = [r["seconds"] for r in rows if "seconds" in r]
    return f"{np.median(taken):.1f}, {max(taken):.1f}" if taken else "not run"


def coverage(rows, machines):
    """How often the 95 % intervals hold the truth, for each base parameter of logs with nothing hidden."""
    names = sorted({n for r in rows for n in r["base"]})
    found = []
    for name in names:
        held = [r["base"][name][2] <= r["base"][name][0] <= r["base"][name][3] for r in rows if name in r["base"]]
        found.append((f"95 % interval of {name} holds the truth, {machines}", "92 to 98 %", share(held)))
    return found


def answer(row):
    """What a case is taken for: the effect named first, or a verdict."""
    if not row["steps"]:
        return OTHER[row["verdict"]]
    named, _ = right(row) if row["hidden"] and row["kind"] != "outside" else (False, False)
    return row["hidden"][0][0] if named else row["steps"][0]["added"][0]


def confusion(rows):
    """Counts of answers for each hidden effect.

    Parameters
    ----------
    rows : list of dict

    Returns
    -------
    truths, answers : list of str
    counts : ndarray of int, shape (truths, answers)
    """
    rows = [r for r in rows if r["kind"] not in ("pair", "paired", "paper")]
    name = [r["effects"][0] if r["effects"] else "nothing" for r in rows]
    tally = Counter(zip(name, map(answer, rows)))
    truths = [t for t in [*cases.CATALOGUE, *cases.rig.OUTSIDE_CATALOGUE, "nothing"] if t in set(name)]
    seen = {a for _, a in tally}
    answers = [a for a in [*cases.CATALOGUE, "unexplained", "nothing", "too little"] if a in seen or a in truths]
    return truths, answers, np.array([[tally[t, a] for a in answers] for t in truths])


def draw(rows, path):
    """The confusion matrix as a figure, shares by row.

    Parameters
    ----------
    rows : list of dict
    path : Path
    """
    truths, answers, counts = confusion(rows)
    part = counts / counts.sum(1, keepdims=True)
    x, y = (Axis(words, names=[n.replace("_", " ") for n in names], falling=falls) for words, names, falls in (
        ("named first by the diagnosis", answers, False), ("hidden in the log", truths, True)))
    edges = (np.arange(len(names) + 1) - 0.5 for names in (answers, truths))
    texts = [[str(n) if n else "" for n in row] for row in counts]
    cells = Cells(*edges, np.where(counts, part, np.nan), texts, 100 * part,
                  Axis("share of the logs with it", "1"), 1.0)
    save(Plot("confusion", "", "What was hidden, and what was named.", [[Panel(x, y, [cells])]], width=2,
              height=0.2 * len(truths) + 2.2), path.parent, path.stem)


def page(rows):
    """Lines of the page of the documentation.

    Parameters
    ----------
    rows : list of dict

    Yields
    ------
    str
    """
    skipped, rows = [r for r in rows if "skipped" in r], [r for r in rows if "skipped" not in r]
    halves = {r["half"] for r in rows}
    yield TOP.format(half="" if len(halves) > 1 else f" --half {min(halves)}")
    parts = {f"The {half} half": [r for r in rows if r["half"] == half] for half in ("development", "final")}
    whole = {"Both halves": rows} if len(halves) > 1 else {}
    for title, some in {**whole, **parts}.items():
        if some:
            kinds = Counter(r["kind"] for r in some)
            yield f"## {title}: {len(some)} cases\n"
            yield ", ".join(f"{n} {WORDS[k]}" for k, n in sorted(kinds.items())) + ".\n"
            yield "| claim | aim | measured |\n|---|---|---|"
            yield from (f"| {' | '.join(line)} |" for line in table(some))
            yield ""
    yield "## What it was taken for\n"
    yield ("![Rows: what was hidden. Columns: what was named first; a twin of the hidden effect counts as it.]"
           "(../images/confusion.png)\n")
    wrong = [r for r in rows if r["kind"] in ("one", "weak") and not right(r)[1]]
    if wrong:
        yield "Not named, or not in place:\n"
        yield from (f"- {r['hidden'][0][0]} at {r['hidden'][0][1]}, size {r['sizes'][0]:.2f} (seed {r['seed']}): "
                    f"{told(r)}" for r in wrong)
        yield ""
    short = [f"{h[0]} ({s:.2f})" for r in rows if r.get("short") for h, s in zip(r["hidden"], r["sizes"])]
    yield f"Drawn at the largest size that they reach: {', '.join(short) or 'none'}."
    yield f"Cases in which the drawn machine gives the effect no meaningful size, left out: {len(skipped)}."


def told(row):
    """What a case was answered with, in words."""
    if not row["steps"]:
        return OTHER[row["verdict"]]
    first = row["steps"][0]
    twins = ", ".join("@".join(t) for t in first["twins"])
    return "@".join(first["added"]) + (f", twins {twins}" if twins else "")


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", nargs="+", type=Path)
    parser.add_argument("--figure", type=Path)
    args = parser.parse_args()
    rows = [json.loads(line) for path in args.rows for line in path.read_text().splitlines()]
    print("\n".join(page(rows)))
    if args.figure:
        draw([r for r in rows if "skipped" not in r], args.figure)


if __name__ == "__main__":
    main()

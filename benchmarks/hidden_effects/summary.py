"""Rows of `benchmarks.hidden_effects.run` in; the table of the track record and the confusion matrix out.

    python -m benchmarks.hidden_effects.summary cases.jsonl [--figure docs/images/confusion.pdf]
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
    kind = {k: [r for r in rows if r["kind"] == k] for k in ("one", "weak", "pair", "none", "outside")}
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
        ("not in the catalogue: unexplained", "90 %", share(r["verdict"] == "unexplained" for r in kind["outside"])),
        ("and the variable it acts over named first", "90 %",
         share(r["depends"][0][0] in r["cause"] for r in kind["outside"])),
        ("held-out error within 5 % of the fitted true model's", "95 %",
         share(r["beside_true"] <= 1.05 for r in [*hidden, *kind["pair"]])),
        ("predicted fall over realised fall, 0.8 to 1.25", "90 %", share(map(foreseen, first))),
        ("seconds of improve, median and longest", "15", seconds(rows)),
    ]
    if len(kind["none"]) > 20:
        p = np.array([r["p"] for r in kind["none"]])
        test = stats.kstest(p, "uniform").pvalue
        found.append(("smallest family-wise p-values uniform (Kolmogorov-Smirnov p)", "> 0.01",
                      f"{test:.3f} over {len(p)}"))
    return found + coverage(kind["none"])


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
    """Whether the fall of the error that the score predicts is near the one that adding the effect brings."""
    fall = {c: (step["before"][c] - step["predicted"][c], step["before"][c] - step["realised"][c])
            for c in step["before"]}
    predicted, realised = max(fall.values(), key=lambda f: f[1])
    return bool(0.8 <= predicted / realised <= 1.25) if realised > 0 else False


def seconds(rows):
    """Median and largest time of a case."""
    taken = [r["seconds"] for r in rows]
    return f"{np.median(taken):.1f}, {max(taken):.1f}" if taken else "not run"


def coverage(rows):
    """How often the 95 % intervals hold the truth, for each base parameter of logs with nothing hidden."""
    names = sorted({n for r in rows for n in r["base"]})
    found = []
    for name in names:
        held = [r["base"][name][2] <= r["base"][name][0] <= r["base"][name][3] for r in rows if name in r["base"]]
        found.append((f"95 % interval of {name} holds the truth", "92 to 98 %", share(held)))
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
    rows = [r for r in rows if r["kind"] != "pair"]
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
    from matplotlib.figure import Figure
    truths, answers, counts = confusion(rows)
    part = counts / counts.sum(1, keepdims=True)
    figure = Figure((0.34 * len(answers) + 2.6, 0.26 * len(truths) + 2.2), layout="constrained")
    axes = figure.subplots()
    axes.imshow(part, cmap="Greys", vmin=0, vmax=1, aspect="auto")
    for (i, j), n in np.ndenumerate(counts):
        if n:
            axes.text(j, i, n, ha="center", va="center", fontsize=7, color="w" if part[i, j] > 0.5 else "k")
    axes.set_xticks(range(len(answers)), [a.replace("_", " ") for a in answers], rotation=90, fontsize=7)
    axes.set_yticks(range(len(truths)), [t.replace("_", " ") for t in truths], fontsize=7)
    axes.set_xlabel("named first by the diagnosis")
    axes.set_ylabel("hidden in the log")
    for end in (path.with_suffix(".pdf"), path.with_suffix(".png")):
        figure.savefig(end, dpi=160)


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", nargs="+", type=Path)
    parser.add_argument("--figure", type=Path)
    args = parser.parse_args()
    rows = [json.loads(line) for path in args.rows for line in path.read_text().splitlines()]
    skipped = [r for r in rows if "skipped" in r]
    rows = [r for r in rows if "skipped" not in r]
    for half in ("development", "final"):
        some = [r for r in rows if r["half"] == half]
        if some:
            print(f"\n{half} half, {len(some)} cases\n")
            print("| claim | goal | measured |\n|---|---|---|")
            print("\n".join(f"| {' | '.join(line)} |" for line in table(some)))
    short = [f"{h[0]} ({s:.2f})" for r in rows if r["short"] for h, s in zip(r["hidden"], r["sizes"])]
    print(f"\ndrawn at their largest size: {', '.join(short) or 'none'}; without any: {len(skipped)}")
    if args.figure:
        draw(rows, args.figure)


if __name__ == "__main__":
    main()

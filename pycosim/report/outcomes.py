"""A fit's parameters, a diagnosis, a search or a confirmation in; what came out of it as a plot, described, out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..diagnosis.scores import LEVEL
from . import values
from .cards import chance
from .drawings import _floor_level, _spaced
from .plot import MARKERS, Axis, Bars, Line, Look, Panel, Plot, Text
from .sentences import number


def ladder(units, steps, floor):
    """Error of every step of a search, on the fitted and on the held-out passes.

    Parameters
    ----------
    units : dict of str to str
        By channel.
    steps : list of Step
        The base model first.
    floor : dict of str to float
        Noise floor of the last model, by channel, in the channel's unit.

    Returns
    -------
    Plot
    """
    marks, at = [], np.arange(len(steps))
    for c, channel in enumerate(units):
        tone, marker = ("before", "after", "third", "ink")[c % 4], MARKERS[c % 4]
        for kind, text, dash in (("error", "fitted passes", "dash"), ("held_out_error", "held-out passes", "solid")):
            y = [np.nan if (e := getattr(s, kind).get(channel)) is None else e for s in steps]
            if np.isfinite(y).any():
                marks.append(Line(at, y, Look(tone, dash, 1.2, marker, dash == "dash"), f"{channel} {text}"))
        marks += [replace(m, name=f"{channel} noise floor", look=Look(tone, ("dot", "dashdot")[c % 2], 0.8))
                  for m in _floor_level(floor, channel)]
    unit = ", ".join(dict.fromkeys(units.values()))
    names = ["base"] + [f"+ {_spaced(s.added[0])}\nat {s.added[1]}" for s in steps[1:]]
    panel = Panel(Axis("model", names=names), Axis("RMSE", unit, low=0), marks)
    falls = ", ".join(f"{c} from {steps[0].error[c]:.3g} to {steps[-1].error[c]:.3g}" for c in units)
    return Plot("ladder", "The error, effect by effect", f"Error at every step of the search: {falls} {unit} on the "
                "fitted passes; lines across: the noise floor.", [[panel]], width=1 if len(steps) < 4 else 1.5,
                height=2.5)


def candidates(diagnosis, most=10, held_out=None):
    """The error that each of the best candidates would leave by itself, and what became of it.

    Parameters
    ----------
    diagnosis : Diagnosis
        Its candidates are drawn, those accepted first.
    most : int
        Candidates to show.
    held_out : dict of str to float, optional
        Error of the diagnosed model on held-out passes; without it all bars are expectations.

    Returns
    -------
    Plot
    """
    left = {f.key: _left(diagnosis, f, held_out) for f in diagnosis.candidates}
    shown = sorted(diagnosis.candidates, key=lambda f: (not f.accepted, left[f.key][0]))[:most]
    kinds = {}
    for k, f in enumerate(shown):
        size, seen = left[f.key]
        kinds.setdefault((not seen, not f.accepted), []).append((k, 100 * size))
    marks = []
    for (expected, other), rows in sorted(kinds.items()):
        at, sizes = zip(*rows)
        text = "expected before a refit" if expected else "on held-out passes"
        marks.append(Bars(at, sizes, Look("faint" if other else "muted", hatch="/" if expected else ""),
                          f"{'' if other else 'accepted, '}{text}", across=True))
    marks += [Text(0, k, fate(diagnosis, f), beside=True) for k, f in enumerate(shown)]
    panel = Panel(Axis("error left with it alone", "% of the error without it", low=0, high=105),
                  Axis("candidate", names=[f"{_spaced(f.effect)} at {f.place}" for f in shown], falling=True), marks)
    return Plot("candidates", "What each candidate would explain", "The error that each candidate would leave by "
                "itself, in percent of the error without it; hatched: expected before any refit.", [[panel]], width=1.5,
                height=0.9 + 0.19 * max(3, len(shown)))


def _left(diagnosis, finding, held_out):
    """Share of the error that a candidate leaves, over all channels, and whether held-out passes say so."""
    seen = bool(finding.held_out_error and held_out)
    before, after = (held_out, finding.held_out_error) if seen else (diagnosis.error, finding.predicted_error)
    keys = [c for c in before if c in after and before[c]]
    return (float(np.sqrt(np.mean([after[c] ** 2 / before[c] ** 2 for c in keys]))) if keys else 1.0), seen


def fate(diagnosis, finding):
    """What became of a candidate, in a few words.

    Parameters
    ----------
    diagnosis : Diagnosis
        Of a fitted model.
    finding : Finding
        One of its candidates.

    Returns
    -------
    str
    """
    if finding.accepted:
        return "accepted"
    if finding.contested:
        return "one of several that do equally well"
    for other in diagnosis.candidates:
        if (other.accepted or other.contested) and any((t["effect"], t["place"]) == finding.key for t in other.twins):
            return f"not to be told from {_spaced(other.effect)} at {other.place}"
    if finding.explained_by:
        return f"explained by {_spaced(finding.explained_by['effect'])} at {finding.explained_by['place']}"
    if finding.p_value >= LEVEL:
        return f"as large by chance in {chance(finding.p_value)}"
    return f"refused: {finding.refused}" if finding.refused else "not needed"


def intervals(parameters):
    """Parameters with their 95 % intervals, over the larger end of the interval.

    Parameters
    ----------
    parameters : dict
        ``parameters.json``.

    Returns
    -------
    Plot
    """
    rows, marks = values.interval_rows(parameters), []
    for sure, look, name in ((True, Look("after", "", marker="circle"), "value and interval"),
                             (False, Look("before", "", marker="cross"), "at a bound, or not determined by itself")):
        at = [k for k, row in enumerate(rows) if row["sure"] == sure]
        if at:
            low, x, high = np.array([rows[k]["scaled"] for k in at]).T
            marks.append(Line(x, np.array(at), look, name, reach=(low, high),
                              told=[f"{rows[k]['value']:.4g} {rows[k]['unit']}" for k in at]))
    panel = Panel(Axis("share of the interval's larger end"),
                  Axis("parameter", names=[row["name"] for row in rows], falling=True), marks)
    return Plot("intervals", "Parameters and their intervals", "Each parameter with its 95 % interval, over the larger "
                "end of the interval; a cross where it is at a bound or not determined by itself.", [[panel]],
                height=0.8 + 0.17 * max(3, len(rows)))


def confirmation(result):
    """The error with each effect, in percent of that without it, channel by channel, and whether it is confirmed.

    Parameters
    ----------
    result : dict
        ``confirmation.json``.

    Returns
    -------
    Plot
    """
    rows = [(e, c) for e in result["effects"] for c in e["error_with"]]
    shares = [100 * e["error_with"][c] / e["error_without"][c] if e["error_without"][c] else 100.0 for e, c in rows]
    kinds = {}
    for k, (e, _) in enumerate(rows):
        kinds.setdefault(bool(e["confirmed"]), []).append(k)
    marks = [Bars(at, [shares[k] for k in at], Look("muted" if holds else "faint"),
                  "confirmed" if holds else "not confirmed", across=True) for holds, at in sorted(kinds.items())]
    marks += [Text(0, k, f"p = {number(e['p_value'])}", beside=True) for k, (e, _) in enumerate(rows)]
    names = [f"{_spaced(e['effect'])} at {e['place']}, {c}" for e, c in rows]
    panel = Panel(Axis("error left with it, everything else as it is", "% of the error without it", low=0,
                       high=max(105.0, *shares)), Axis("effect", names=names, falling=True), marks)
    return Plot("confirmation", "The effects on a log that was never searched", "The error with each effect, in "
                "percent of the error without it; nothing was fitted to this log.", [[panel]], width=1.5,
                height=0.9 + 0.19 * max(3, len(rows)))

"""A confirmation in; the error that each effect leaves on a log that was never searched, as a description, out."""

from __future__ import annotations

from .plot import Axis, Bars, Look, Panel, Plot, Text
from .sentences import number


def errors(result):
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
    names = [f"{e['effect'].replace('_', ' ')} at {e['place']}, {c}" for e, c in rows]
    panel = Panel(Axis("error left with it, everything else as it is", "% of the error without it", low=0,
                       high=max(105.0, *shares)), Axis("effect", names=names, falling=True), marks)
    return Plot("confirmation", "The effects on a log that was never searched", "The error with each effect, in "
                "percent of the error without it; nothing was fitted to this log.", [[panel]], width=1.5,
                height=0.9 + 0.19 * max(3, len(rows)))

"""A table of candidates in; what this data cannot show at all, why, and the experiment that would show it, out."""

from __future__ import annotations

import numpy as np

from .compile.effects import annotation

ABSORBED = 2e-3  # share of a column that is left beyond the base model, below which the effect cannot be seen


def undetectable(table, scores):
    """Effects and places that the data cannot show.

    Parameters
    ----------
    table : Table
    scores : Scores

    Returns
    -------
    list of dict
        ``effect``, ``place``, ``why`` and ``experiment``.
    """
    share = {}
    for candidate, _, _, _, left in scores.results:
        share[candidate.key] = max(share.get(candidate.key, 0.0), left)
    found = []
    for effect, place in [*table.offers, *table.scans]:
        if share.get((effect.id, place.name), 1.0 if (effect, place) in table.scans else 0.0) < ABSORBED:
            notes = annotation(table.library, effect.model)
            found.append({"effect": effect.id, "place": place.name, "why": why(table, notes.get("needs", "")),
                          "experiment": notes.get("experiment", "vary speed, load, direction and configuration")})
    for effect, place, missing in table.unavailable:
        notes = annotation(table.library, effect.model)
        found.append({"effect": effect.id, "place": place.name, "why": f"not in the log: {', '.join(dict.fromkeys(missing))}",
                      "experiment": notes.get("experiment", f"log {', '.join(dict.fromkeys(missing))}")})
    return found


def why(table, needs):
    """The reason, from what the data cover of the variable that the effect needs."""
    d = table.dataset
    moving = np.abs(d.speeds[:, d.moving])
    covered = {
        "speeds": ("one speed only", np.ptp(np.log(np.quantile(moving.max(0), [0.05, 0.95]))) < 0.2),
        "directions": ("one direction only", (np.sign(d.speeds[:, d.moving]).min(1) == np.sign(
            d.speeds[:, d.moving]).max(1)).all()),
        "reversals": ("no reversals", len(np.unique(d.passes[d.passes >= 0])) < 2),
        "loads": ("one load only", False),
    }
    for need in needs.split():
        reason, holds = covered.get(need, ("", False))
        if holds:
            return reason
    if needs:
        return f"the base model absorbs it: {needs.replace(' ', ', ')} do not vary enough on their own"
    return "the base model absorbs it on this data"

"""A table of candidates in; what this data cannot show at all, why, and the experiment that would show it, out."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri, ndtri  # quantiles; scipy.stats takes half a second to import

from ..compile.effects import annotation
from .compare import unit_of
from .dependence import explanations


def undetectable(table, scores):
    """Effects and places that the data cannot show.

    Parameters
    ----------
    table : Table
        Of the fitted model, with a column for each candidate.
    scores : Scores
        Of the same table.

    Returns
    -------
    list of dict
        ``effect``, ``place``, ``why`` and ``experiment``.
    """
    seen = {r.candidate.key for r in scores.results if r.visible}
    found = []
    for effect, place in [*table.offers, *table.scans]:
        notes = annotation(table.library, effect.model)
        reason = definite(table, place, notes.get("needs", ""))
        if reason is None and (effect.id, place.name) not in seen:
            reason = "the base model absorbs it on this data"
            if notes.get("needs"):
                reason = f"the base model absorbs it: too little changes on its own of {notes['needs']}"
        if reason:
            found.append({"effect": effect.id, "place": place.name, "why": reason,
                          "experiment": notes.get("experiment", "vary speed, load, direction and configuration")})
    for effect, place, missing in table.unavailable:
        notes = annotation(table.library, effect.model)
        names = ", ".join(dict.fromkeys(missing))
        found.append({"effect": effect.id, "place": place.name, "why": f"not in the log: {names}",
                      "experiment": notes.get("experiment", f"log {names}")})
    return found + [{"effect": effect.id, "place": place.name, "why": "ruled out by the study",
                     "experiment": "take it out of [data] rejected"}
                    for effect, place in table.rejected]


def smallest(scores, level, matters, hidden=()):
    """The smallest size of each effect at each place that this log would have shown.

    Shown in nine logs of ten such that the family-wise p-value is below the level, and enough of the error is taken to
    matter; of effects with a grid, at the grid point where the smallest size shows.

    Parameters
    ----------
    scores : Scores
        Of the same table.
    level : float
        Family-wise p-value, 0 to 1.
    matters : float
        Least share of the squared error that an effect must take, 0 to 1.
    hidden : list of dict, optional
        What the data cannot show, as of `undetectable`: no size of that is told.

    Returns
    -------
    list of dict
        ``effect``, ``place``, ``coefficient``, ``value``, ``unit``, ``at`` (values of the grid) and ``error_share``:
        the part of the noise that such an effect would add to the error of the channel that shows it best.
    """
    thresholds = {scanned: scores.threshold(level, scanned) for scanned in (False, True)}
    best, unseen = {}, {(h["effect"], h["place"]) for h in hidden}
    for score in scores.results:
        if not score.visible or score.candidate.key in unseen:
            continue
        candidate = score.candidate
        sided = len(candidate.parts) == 1 and (candidate.lower[0] == 0 or candidate.upper[0] == 0)
        tail = min(np.exp(-thresholds[score.scanned]) * (2 if sided else 1), 1.0)
        least = chdtri(len(candidate.parts), tail)
        wanted = (np.sqrt(least / (1.0 - least / score.limit)) if least < score.limit else np.inf) + ndtri(0.9)
        spread = float(np.min(score.spread))
        enough = np.sqrt(matters / (1 - matters)) / max(scores.weight(candidate, 1.0), 1e-300)
        size = float(max(wanted * spread, enough + ndtri(0.9) * spread))
        if not np.isfinite(size):  # every size could hide: nothing is known to be absent
            continue
        described = scores.table.described(scores.table.contribution(candidate.effect))
        name = candidate.names[min(int(np.argmin(score.spread)), len(candidate.names) - 1)]
        known = best.get(candidate.key)
        if known is None or size < known["value"]:
            best[candidate.key] = {
                "effect": candidate.effect.id, "place": candidate.place.name, "coefficient": name, "value": size,
                "unit": described[name].unit, "at": {k: float(v) for k, v in candidate.grid.items()},
                "error_share": scores.weight(candidate, size)}
    return list(best.values())


def varied(table):
    """What the fitted part of a log varies.

    Parameters
    ----------
    table : Table
        Of the fitted model, with a column for each candidate.

    Returns
    -------
    list of dict
        ``variable``, ``min``, ``max``, ``unit`` (SI), and ``levels``: how many values or clusters of values it takes, a
        pass by its median.
    """
    dataset = table.dataset
    view = dataset.view(table.part)
    index = (view.i if dataset.paired else view)[::table.thin]
    compared = {*dataset.channels, *dataset.outputs}
    found = []
    for name, values in explanations(dataset, table.model, table.fit, index).items():
        if name in compared:
            continue
        passes = np.array([np.median(np.abs(values[table.group == g])) for g in np.unique(table.group)])
        steps = np.diff(np.sort(passes))
        found.append({"variable": name, "min": float(values.min()), "max": float(values.max()),
                      "levels": int(1 + np.count_nonzero(steps > 0.05 * max(np.ptp(passes), 1e-300))),
                      "unit": unit_of(dataset, name)})
    signs = np.unique(np.sign(np.round(dataset.speeds[:, dataset.moving], 12)), axis=1)
    found.append({"variable": "combinations of directions", "min": 1, "max": 2 ** len(dataset.speeds),
                  "levels": int(signs.shape[1]), "unit": "1"})
    return found


def definite(table, place, needs):
    """A reason that holds whatever the noise: the log does not vary what the effect needs; else None.

    Parameters
    ----------
    table : Table
        Of the fitted model, with a column for each candidate.
    place : Place
        Where the effect would hang.
    needs : str
        What the effect's annotation says it needs, as ``speeds reversals``.

    Returns
    -------
    str or None
    """
    component = place.components[0]
    if not hasattr(table, "_definite"):
        table._definite = _coverage(table.dataset)
        table._one_load = {}
    if component not in table._one_load:
        load = table.full.get(f"{component}.L")
        table._one_load[component] = load is not None and _constant(load[table.dataset.moving])
    one = {**table._definite, "loads": ("one load only", table._one_load[component])}
    load = table.full.get(f"{component}.line.L")
    if load is not None:
        one["load_signs"] = ("the load keeps its sign", np.ptp(np.sign(load[table.dataset.moving])) == 0)
    return next((reason for need in needs.split() for reason, holds in [one.get(need, ("", False))] if holds), None)


def _coverage(d):
    """What the log as a whole does not vary."""
    moving = np.abs(d.speeds[:, d.moving]).max(0)
    signs = np.sign(d.speeds[:, d.moving])
    one_way = bool((signs.min(1) == signs.max(1)).all())
    return {
        "load_reference": ("a torque sensor reads what the joint takes, whatever takes it",
                           d.study.reference == "sensor") if not d.paired else
                          ("what depends on the angles alone cancels between a pass and its way back", True),
        "joint_encoders": ("no joint encoder", not d.zeros),
        "temperatures": ("one temperature only", np.ptp(d.measured.get("temperature", np.zeros(2))) < 0.5),
        "speeds": ("one speed only", not d.averaged and np.ptp(np.log(np.quantile(moving, [0.2, 0.95]))) < 0.2),
        "directions": ("one direction only", one_way),
        "reversals": ("no reversals", one_way or len(np.unique(d.passes[d.passes >= 0])) < 2),
    }


def _constant(load):
    low, high = np.quantile(load, [0.05, 0.95])
    return high - low < 0.1 * max(abs(low), abs(high))

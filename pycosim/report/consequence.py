"""A data set and two models in; how large an effect is, and what it changes for who uses the model, out."""

from __future__ import annotations

import numpy as np

from ..compile import find_effect
from ..core.errors import DataError, StudyError
from ..diagnosis.compare import unit_of
from ..dynamics.simulate import compensate
from . import values
from .schematic import component_of, upstream

PEAK = 0.99  # quantile of an effect's size over the moving samples that counts as its largest: one outlier is none
CLEAR = 1e-2  # of the mean drive of a sample, below which an effect's torque cannot be read off the residual
CHANGED = 0.02  # change of the feedforward's error, below which an effect is none of a controller's business


def size(dataset, before, after, key):
    """Largest torque (or force, or angle) of an effect over a log, and what that is of what is rated.

    Parameters
    ----------
    dataset : Dataset
    before, after : (Model, Fit)
        Without the effect, and with it.
    key : (str, str)
        Effect and place.

    Returns
    -------
    dict
        ``value``, ``unit``, ``where`` (the place, or the channel that shows the effect), ``share`` of ``rated`` (None
        where there is nothing to compare with) and ``of``, what is rated, in words.
    """
    known = values.torque_at(dataset, before, after, key)
    if known is not None:
        torque, drive, unit = known
        clear = drive > CLEAR * drive.mean()
        found = {"value": float(np.quantile(np.abs(torque[clear]), PEAK)), "unit": unit, "where": key[1]}
        limit = _rated_of_place(dataset, after[0], key, unit)
        if limit is not None:
            return {**found, **_share(found["value"], *limit)}
    channels = [_in_channel(dataset, before, after, c) for c in dataset.channels]
    largest = max(channels, key=lambda c: c["share"] or 0.0)
    return {**found, "share": None, "rated": None, "of": None, "channel": largest} if known is not None else largest


def _share(value, rated, of):
    return {"share": value / rated if rated else None, "rated": rated, "of": of}


def _rated_of_place(dataset, model, key, unit):
    """Rated torque where an effect acts: of its joint, or of the motors before it; and how that is known."""
    place = next(p for e, p in model.attached if (e.id, p.name) == tuple(key))
    for channel in dataset.channels:
        if component_of(model, channel) in place.components and unit_of(dataset, channel) == unit:
            return rated(dataset, channel)
    motors = upstream(model, key[1])
    names = [f"{m}.tau" for m in motors] + [c for c in dataset.channels if component_of(model, c) in motors]
    found = [rated(dataset, n) for n in names if unit_of(dataset, n) == unit]
    return max((f for f in found if f is not None), default=None)


def rated(dataset, name):
    """Rated value of a torque: the study's limit, else the largest in the log.

    Parameters
    ----------
    dataset : Dataset
    name : str
        Variable or channel, as ``motor1.tau``.

    Returns
    -------
    (float, str) or None
        The value, and what it is in words; None where the study and the log have no such torque.
    """
    limits = [abs(v) for v in dataset.study.limits.get(name, ()) if v is not None and np.isfinite(v)]
    if limits:
        return max(limits), f"what [limits] allow {name}"
    column = logged(dataset, name)
    recorded = dataset.measured.get(name)
    top = float(np.max(np.abs(recorded))) if recorded is not None and len(recorded) else 0.0
    return (top, f"the largest {column} in the log") if top > 0 else None


def logged(dataset, variable):
    """Name that the log has for a variable.

    Parameters
    ----------
    dataset : Dataset
    variable : str

    Returns
    -------
    str
        The variable itself where no column is mapped to it.
    """
    return next((c for c, k in dataset.study.columns.items() if k.variable == variable), variable)


def _in_channel(dataset, before, after, channel):
    """Largest change of a channel by an effect."""
    c = dataset.channels.index(channel)
    full, left = (values.residual_of(dataset, *m, None, "all", values.ENOUGH)[0][c] for m in (before, after))
    value = float(np.quantile(np.abs(full - left), PEAK))
    limit = rated(dataset, channel.removesuffix("_pair")) or (None, None)
    return {"value": value, "unit": unit_of(dataset, channel), "where": channel, **_share(value, *limit)}


def errors_of_rated(dataset, error):
    """Errors as shares of what is rated.

    Parameters
    ----------
    dataset : Dataset
    error : dict of str to float
        By channel.

    Returns
    -------
    dict of str to (float, str)
        Share and what is rated, in words; channels without a torque to compare with are left out.
    """
    limits = {c: rated(dataset, c.removesuffix("_pair")) for c in error}
    return {c: (error[c] / limit[0], limit[1]) for c, limit in limits.items() if limit and error[c] is not None}


def feedforward(dataset, first, last):
    """What a controller that feeds a model forward leaves to its feedback, and how far off the predicted heat is.

    Each model says which motor torques the motion and the joint torques of the log need; the motors gave others.

    Parameters
    ----------
    dataset : Dataset
    first, last : (Model, Fit)
        As given, and improved.

    Returns
    -------
    dict of str to dict
        By motor torque: ``unit``, ``rated`` (of `rated`), ``told`` (it is a channel, and compared already), ``error``
        and ``heat`` (relative error of the mean square, to which the heat in a winding is in proportion), each before
        and after, over held-out moving samples where there are any; empty where the rig or the log cannot answer, or
        the effects change nothing of it.
    """
    answers = [_needed(dataset, *m) for m in (first, last)]
    if not all(answers):
        return {}
    held = dataset.moving & (dataset.block >= 0) & dataset.is_test[dataset.block] if dataset.is_test.any() else \
        dataset.moving
    found = {}
    for name in answers[0]:
        given = dataset.measured[name][held]
        if unit_of(dataset, name) != dataset.base.along("N.m"):
            continue  # a voltage: its square is no heat
        error = [float(np.sqrt(np.mean((a[name][held] - given) ** 2))) for a in answers]
        heat = [float(np.mean(a[name][held] ** 2) / np.mean(given ** 2) - 1) for a in answers]
        if np.isfinite([*error, *heat]).all() and abs(error[1] - error[0]) > CHANGED * error[0]:
            found[name] = {"unit": unit_of(dataset, name), "rated": rated(dataset, name), "error": error, "heat": heat,
                           "told": name in dataset.channels}
    return found


def _needed(dataset, model, fit):
    """Motor torques that a model says the log's motion and joint torques need; None where it cannot say."""
    if dataset.averaged or not model.notes.get("compensate"):
        return None
    asked, _ = model.alternatives("compensate")[0]
    known = {**dataset.measured, **dataset.signals}
    question = model.question("compensate")
    given = {n: known[n] for n in question.inputs if n in known and n != "time"}
    if any(n not in dataset.measured for n in asked):
        return None
    if all(n in dataset.channels for n in asked):
        return values.outputs(dataset, model, fit)
    try:
        parts = [compensate(model, {n: v[dataset.run == k] for n, v in given.items()}, dataset.time[dataset.run == k],
                            {n: fit.parameters[n] for n in model.parameters if n in fit.parameters})
                 for k in np.unique(dataset.run)]
    except (DataError, StudyError):
        return None
    return {n: np.concatenate([p[n] for p in parts]) for n in asked}


def words_of_effect(library, effect):
    """What an effect is, as a clause.

    Parameters
    ----------
    library : Library
    effect : str

    Returns
    -------
    str
        The effect's description with a small first letter.
    """
    text = find_effect(library, effect).description
    return text[:1].lower() + text[1:]

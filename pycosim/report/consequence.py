"""A data set and two models in; how large an effect is, beside what is rated, out."""

from __future__ import annotations

import numpy as np

from ..compile import find_effect
from ..diagnosis.compare import unit_of
from . import values
from .schematic import component_of, upstream

PEAK = 0.99  # quantile of an effect's size over the moving samples that counts as its largest: one outlier is none
CLEAR = 1e-2  # of the mean drive of a sample, below which an effect's torque cannot be read off the residual


def size(dataset, before, after, key):
    """Largest torque (or force, or angle) of an effect over a log, and what that is of what is rated.

    Parameters
    ----------
    dataset : Dataset
        Its logs and limits tell what is usual and what is rated.
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
        Its logs and limits tell what is usual and what is rated.
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
        Its logs and limits tell what is usual and what is rated.
    variable : str
        Of the rig, as ``motor1.tau``.

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
        Its logs and limits tell what is usual and what is rated.
    error : dict of str to float
        By channel.

    Returns
    -------
    dict of str to (float, str)
        Share and what is rated, in words; channels without a torque to compare with are left out.
    """
    limits = {c: rated(dataset, c.removesuffix("_pair")) for c in error}
    return {c: (error[c] / limit[0], limit[1]) for c, limit in limits.items() if limit and error[c] is not None}


def words_of_effect(library, effect):
    """What an effect is, as a clause.

    Parameters
    ----------
    library : Library
        Has the effect's description.
    effect : str
        Its name, as ``stribeck``.

    Returns
    -------
    str
        The effect's description with a small first letter.
    """
    text = find_effect(library, effect).description
    return text[:1].lower() + text[1:]

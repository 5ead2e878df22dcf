"""A model with effects that nobody gave a start in; the fit from where the scores see them, out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..compile import compile_model, component_name
from ..core.errors import PycosimError
from ..fit import least_squares
from ..fit.late import delays
from .scores import Scores
from .table import Table
from .trials import as_findings, nudged


def fitted(dataset, model, progress=None):
    """Fit a model, and once more from where the scores see the effects that the study says no start of.

    A speed, a travel or a number of cycles means nothing while its effect has no size, and the errors have many valleys
    over it: from a value that suits no data the fit may end in one of them, with no effect at all. (A Stribeck speed on
    a linear axis went to 11 m/s, beyond all speeds of the log.)

    Parameters
    ----------
    dataset : Dataset
        Its fit part is fitted.
    model : Model
        Of its study, with the study's effects.
    progress : callable, optional
        Called with a sentence before the search.

    Returns
    -------
    Fit
        Whichever leaves less.
    """
    plain = _beside_delays(dataset, model, least_squares.fit(dataset, model))
    lost = [(e.id, p.name) for e, p in model.attached if _unsaid(dataset, model, plain, e, p)]
    if not lost:
        return plain
    if progress:
        progress("looking for where the effects start")
    try:
        found = _from_scores(dataset, model, lost)
    except PycosimError:  # without them there is no motion, or no answer in closed form
        return plain
    return min((plain, found), key=_left)


def _unsaid(dataset, model, fit, effect, place):
    """Whether an effect has free scales of its own, and the study gives none of them."""
    names = [f"{component_name(effect, place)}.{c}" for c, kind in effect.scan.items() if kind != "delay"]
    free = {n.partition("[")[0] for n in fit.free}
    return any(n in free for n in names) and not any(n in dataset.parameters.values(model) for n in names)


def _from_scores(dataset, model, lost):
    """The fit with these effects added one after the other, the most surprising first, where the scores see each."""
    keys = [key for key in model.keys if key not in lost]
    lacking = compile_model(dataset.library, model.rig, keys)
    fit, rest = least_squares.fit(dataset, lacking), list(lost)
    while rest:
        table = Table(dataset, lacking, fit)
        seen = {f.key: f for f in as_findings(table, Scores(table)) if f.key in rest}
        key = next(iter(seen), rest[0])
        rest.remove(key)
        larger = compile_model(dataset.library, model.rig, [*lacking.keys, key])
        start = {**fit.parameters, **(seen[key].start if key in seen else {})}
        fit = least_squares.fit(dataset, larger, nudged(start, larger, seen.get(key)))
        lacking = larger
    return _beside_delays(dataset, model, least_squares.fit(dataset, model, fit.parameters))


def _beside_delays(dataset, model, fit):
    """The fit without samples of turns that hide the rig's own travel; they tell the delays themselves best."""
    here = dataset.sliding(model)
    if here is dataset or here.settled(model, fit.parameters) is not here:  # a filter's fit leaves them out already
        return fit
    held = [n for n in delays(model) if n in fit.free]
    later = least_squares.fit(here, model, fit.parameters, held=held)
    told = [k for k, n in enumerate(later.free) if n in held]
    scale = np.ones(len(later.free))
    scale[told] = [fit.stderr[fit.free.index(later.free[k])] / max(later.stderr[k], 1e-300) for k in told]
    return replace(later, profiles=fit.profiles, covariance=later.covariance * np.outer(scale, scale))


def _left(fit):
    """The channels' squared errors, in units of their noise."""
    return sum((error * weight) ** 2 for error, weight in zip(fit.error.values(), fit.weights))


__all__ = ["fitted"]

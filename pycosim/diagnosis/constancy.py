"""A fitted effect in; whether its coefficient is the same all over the data, or only an average of another law, out.

What an effect adds to the residual is multiplied by a free function of one variable after the other. A law that is
right gains nothing by that; one that stands in for another law gains, on passes that the function was not fitted to,
much of what it has taken away itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..compile import component_name
from ..data.instruments import rounding
from .dependence import AGAIN, SAMPLES, explained, explanations, stretches

LEVELS = 8  # of a variable, over which the coefficient may differ
LACK = 0.25
"""Of what an effect takes away, that it may gain where its coefficient varies. A law that stands in for another gains
about as much as it takes; one that is right gains nothing, and something where another effect is missing too."""
SURE = 3.0
"""Standard errors over blocks or passes by which a varying coefficient must predict unseen ones better."""


@dataclass
class Constancy:
    """What an effect would gain if its coefficient varied.

    Attributes
    ----------
    gain : float
        Share of the squared error left that it would take on unseen blocks or passes; 0.0 where none is sure.
    variable : str or None
        Over which it would vary.
    """

    gain: float = 0.0
    variable: str | None = None


def constancy(dataset, model, fit, seed=0):
    """Whether the coefficients of a model's effects are the same all over the data.

    Parameters
    ----------
    dataset : Dataset
    model : Model
    fit : Fit
    seed : int
        Of the roundings whose share is taken off.

    Returns
    -------
    dict of (str, str) to Constancy
        By effect and place.
    """
    view = dataset.view("fit")
    index = view.i if dataset.paired else view
    problem = dataset.residuals(model, fit.free, fit.parameters, "fit")
    sloped = dataset.residuals(model, fit.free, fit.parameters, "fit", dataset.exogenous())
    thin = max(1, problem.n // SAMPLES)
    problem, sloped, index = problem.thin(thin), sloped.thin(thin), index[::thin]
    slope = np.concatenate([j for _, _, j in sloped.blocks(fit.values)], axis=2)
    left = fit.weights[:, None] * problem.residual(fit.values)
    label, fold = stretches(dataset, problem)
    bins = {n: levels(v) for n, v in explanations(dataset, model, fit, index).items()}
    drawn, rng = rounding(dataset, model, fit), np.random.default_rng(seed)
    roundings = [fit.weights[:, None] * drawn(rng)[:, ::thin] for _ in range(AGAIN)] if drawn else []
    energy, found = float((left ** 2).sum()), {}
    for effect, place in model.attached:
        added = fit.weights[:, None] * _added(model, fit, effect, place, slope)
        xy, xx = (added * left).sum(0), (added ** 2).sum(0)
        rounded = [(added * r).sum(0) for r in roundings]
        found[effect.id, place.name] = best = Constancy()
        for name, cells in bins.items():
            gain, errors = explained(xy, xx, energy, cells, fold, label, label.max() + 1)
            if errors > SURE and gain > best.gain:  # a sawtooth is a function of its angle whatever it is multiplied by
                gain -= max((max(explained(r, xx, energy, cells, fold, label, label.max() + 1)[0], 0.0)
                             for r in rounded), default=0.0)
            if errors > SURE and gain > best.gain:
                found[effect.id, place.name] = best = Constancy(float(gain), name)
    return found


def levels(values):
    """Levels of a variable that as many samples share.

    Parameters
    ----------
    values : ndarray, shape (n,)

    Returns
    -------
    ndarray of int, shape (n,)
    """
    return np.searchsorted(np.unique(np.quantile(values, np.linspace(0, 1, LEVELS + 1)[1:-1])), values)


def _added(model, fit, effect, place, slope):
    """What an effect adds to each channel, as far as it is linear in its sizes."""
    base = component_name(effect, place)
    own = [n for n in fit.free if n.startswith(base + ".")]
    sized = [n for n in own if n[len(base) + 1:] in effect.size] or own
    return sum(slope[:, fit.free.index(n)] * (fit.parameters[n] - model.parameters[n].value) for n in sized)

"""A fitted model and its data in; over which travels the machine's own friction builds up, for the rig's guess, out.

Each segment has a travel, of which a study rarely says anything: the rig's is 1 mrad. A machine with a third of that
leaves something in the first samples after turns that is no missing effect: its friction is as the model's, and builds
up sooner. What is refused as the machine's own travel says how long that is.
"""

from __future__ import annotations

import numpy as np

from ..data.turns import built_up

TIMES = 1.25 ** np.arange(3, -18, -1)
"""Travels, over the rig's, that a machine may have: up to twice that, beyond which it is a presliding."""
OTHER = 0.2  # of the rig's travel, from which more or less is another travel, and of what it takes, that the other must
SURER = 25.0
"""Times what a sample keeps of the memory's best fit, squared: what another travel must take, which is chosen of twenty
by samples that share a part of their noise."""
ENOUGH = 20000  # samples that travels are compared on


class Followed:
    """A model whose segments slide at once, and what is left where they build their friction up instead.

    Parameters
    ----------
    dataset : Dataset
        Its fit part is looked at.
    model : Model
        Of its rig, without the memory of friction in question.
    fit : Fit
        Of the model with that memory, whose other parameters are taken.
    """

    def __init__(self, dataset, model, fit):
        self.dataset, self.model, self.weights = dataset, model, fit.weights[:, None] ** 2
        self.parameters = {n: fit.parameters[n] for n in model.parameters}
        question = dataset.ask(model)
        self.rows = np.array([question.states.index(f"{c}.z") for c in model.segments])
        self.states = dataset.states(model, self.parameters)[0]
        self.at_once = self._predicted(self.states)
        free = [n for n in fit.free if n in self.parameters]
        self.residual = left_of(dataset, model, fit, free)

    def _predicted(self, states):
        found = self.dataset.segment_signals(self.model, self.parameters, self.dataset.outputs, states)
        return np.array(list(found.values()))

    def changed(self, built, segments=slice(None)):
        """What a travel adds to the residual.

        Parameters
        ----------
        built : ndarray, shape (segments, n)
            As of `built_up`.
        segments : slice or list of int
            Those that have it.

        Returns
        -------
        ndarray, shape (channels, compared samples)
        """
        states = self.states.copy()
        states[self.rows[segments]] = built[segments]
        more = self._predicted(states) - self.at_once
        return -sum(share * take(more) for share, _, take in self.dataset.picks("fit"))

    def squares(self, residual):
        """Sum of squares of a residual, channels weighted as in the fit.

        Parameters
        ----------
        residual : ndarray, shape (channels, samples)
            In the channels' units.

        Returns
        -------
        float
        """
        return float((self.weights * residual ** 2).sum())


def left_of(dataset, model, fit, free=None):
    """Residual of a fitted model on the fit part.

    Parameters
    ----------
    dataset : Dataset
        Its fit part was fitted.
    model : Model
        That was fitted, or one without some of its effects.
    fit : Fit
        Its values are taken.
    free : list of str, optional
        The free ones of the model, where the fit is of a larger one.

    Returns
    -------
    ndarray, shape (channels, compared samples)
    """
    free = fit.free if free is None else free
    return dataset.residuals(model, free, fit.parameters, "fit").residual([fit.parameters[n] for n in free])


def travels(dataset, model, larger, fit, least):
    """Travels over which the machine's own friction builds up, where they are others than the rig's.

    One factor for all segments first, then one of its own for a segment where that takes more than luck.

    Parameters
    ----------
    dataset : Dataset
        Its fit part was fitted.
    model : Model
        With the effects that are in by now, none of which delays or filters a torque.
    larger : Model
        That model with a memory of friction that is the machine's own travel.
    fit : Fit
        Of the larger one.
    least : float
        Of what that memory takes, that the travels must take.

    Returns
    -------
    dict of str to float
        By parameter, as ``s1A.travel``: [rad] or [m]. Empty where the rig's explain as much.
    """
    here = Followed(dataset, model, fit)
    skip = max(here.residual.shape[1] // ENOUGH, 1)
    residual, left = here.residual[:, ::skip], here.squares(left_of(dataset, larger, fit)[:, ::skip])
    built = [built_up(dataset, model, here.parameters, times) for times in TIMES]
    none, luck = here.squares(residual), SURER * left / residual.size
    taken = [none - here.squares(residual + here.changed(b)[:, ::skip]) for b in built]
    best, usual = int(np.argmax(taken)), taken[int(np.argmin(np.abs(TIMES - 1)))]
    chosen, most = [best] * len(here.rows), taken[best]
    if len(chosen) > 1:
        columns = [[here.changed(b, [s])[:, ::skip] for b in built] for s in range(len(chosen))]
        chosen = _apart(here, columns, residual, chosen, luck)
        most = none - here.squares(residual + sum(own[k] for own, k in zip(columns, chosen)))
    if most < least * (none - left) or most - usual < max(OTHER * most, luck):
        return {}
    own = {c: TIMES[k] * here.parameters[f"{c}.travel"] for c, k in zip(model.segments, chosen)}
    return {f"{c}.travel": float(f"{v:.3g}") for c, v in own.items()}


def _apart(here, columns, residual, chosen, luck):
    """Segments' own travels in the place of a common one, one after the other, where they take more than luck."""
    for _ in range(2):
        before = list(chosen)
        for s, own in enumerate(columns):
            others = residual + sum(columns[j][k] for j, k in enumerate(chosen) if j != s)
            left = [here.squares(others + c) for c in own]
            if left[chosen[s]] - min(left) > luck:
                chosen[s] = int(np.argmin(left))
        if before == chosen:
            break
    return chosen

"""What a residual depends on after an effect was added, and what the effect took, in; the one over the other, out."""

from __future__ import annotations

import numpy as np

from .constancy import ALIKE
from .dependence import RELEVANT, calm_floor, mirrored

LEFT = 0.25
"""Of what an effect takes away, that one variable may still explain of what is left, for the effect to be believed by
itself. A law that stands in for another leaves much of that in its place, or pays for it in another channel. So does a
true one beside a second: then the search goes on, and both are believed together. Where it is slower than noise, and
no variable tells it, it must be more than what the effect takes: a tide of friction left 1.9 times what a preload
took, true effects beside a wrong mass, a filter or two others 0.6 times."""


DROWNED = 4.0
"""The same of an effect that cannot be mistaken for a law of that variable. Beside something so much larger any signal
catches a little; the delay and the ripple of the ball screw EMPS leave 1.1 and 1.3 times what they take."""
MOST, AS_SMALL = 0.5, 1.5
"""Of the squared error of a channel, that an effect leaves which takes most of it; squared error of held-out passes
over that of fitted ones, up to which one is as small as the other: slow noise differs by as much from pass to pass."""
TELLING, CALMEST = 100, 0.2
"""Samples of a run that tell its own size, and the least of it, over that of all runs."""
HELD_OUT = "the held-out part"
WANDERS = "something that is slower than noise"
SIGNED, SLOW, DRIFTS, VISIBLE = 1.4, 2.0, 4.0, 0.01
"""Squared error of a torque over that of its noise floor, and error over the torque, from which what is left is more
than slow noise: where it surely changes its sign in turns, as a friction does; where it does not go on through them, as
noise would; and whatever it does there: so much is a reference that drifts. Seventeen worlds with nothing hidden reach
1.2, slow noise as large as the fast 2.6, friction that ebbs, flows or comes and goes 1.6 to 7; what a simulation leaves
that nobody added noise to is less than a hundredth."""


def rises(dataset, before, after):
    """By how much an effect changes the squared errors of the held-out part, over those of the fit part without it.

    Each run counts in units of its own noise, or one that is four times noisier than the others says by chance what
    the others deny.

    Parameters
    ----------
    dataset : Dataset
        With a held-out part, or without.
    before, after : (Model, Fit)
        Without the effect and with it.

    Returns
    -------
    dict of str to float
        By channel; negative where it lowers them, empty without a held-out part, or where that has nothing to say.
    """
    if not dataset.is_test.any():
        return {}
    index = {part: dataset.picks(part)[0][1] for part in ("fit", "test")}
    residuals = {part: [dataset.residuals(model, fit.free, fit.parameters, part).residual(fit.values)
                        for model, fit in (before, after)] for part in index}
    runs, count = {part: dataset.run[i] for part, i in index.items()}, len(dataset.logs)
    sizes = np.minimum(*(_sizes(r, runs["fit"], count) for r in residuals["fit"]))
    (fitted, left), (held, unseen) = ([np.mean((r / sizes[:, runs[part]]) ** 2, axis=1) for r in residuals[part]]
                                      for part in index)
    if np.all(unseen <= AS_SMALL * left) and (left / fitted).min() < MOST:
        return {}  # one held-out pass may be as near to a wrong model as to a right one, by chance
    return dict(zip(dataset.channels, (unseen - held) / fitted))


def _sizes(residual, run, count):
    """RMSE of each channel in each run, in all of them where a run has few samples: shape (channels, runs)."""
    whole = np.sqrt(np.mean(residual ** 2, axis=1)) + 1e-300
    parts = [residual[:, run == k] for k in range(count)]
    return np.array([np.maximum(np.sqrt(np.mean(own ** 2, axis=1)), CALMEST * whole) if own.shape[1] >= TELLING
                     else whole for own in parts]).T


def beyond(risen, without):
    """What an effect adds to the squared errors of the held-out part, in the units of those of unseen folds.

    An effect that lowers them nowhere by more than it raises them elsewhere has not been seen there.

    Parameters
    ----------
    risen : dict of str to float or None
        As `rises` says it.
    without : Selection
        Errors of unseen folds without the effect.

    Returns
    -------
    float
        Infinite where all channels together are not lowered.
    """
    if not risen:
        return 0.0
    added = np.array(list(risen.values())) * without.channels.sum(1)
    return float(np.maximum(added, 0.0).sum()) if added.sum() < 0 else float("inf")


def slow(dataset, model, fit):
    """Channels of torques or forces whose error is far above what changes from moment to moment, repeat to repeat.

    Beside noise that slow, which memory and size of the noise model take in, no test has an effect to find.

    Parameters
    ----------
    dataset : Dataset
        All its samples are looked at.
    model : Model
        That was fitted.
    fit : Fit
        Of that model.

    Returns
    -------
    dict of str to float
        Share of a channel's squared error that is more than slow noise.
    """
    if dataset.paired or dataset.averaged:  # half a difference of out and back holds little that is slow
        return {}
    floor, left = calm_floor(dataset, model, fit)
    sizes = {c: float(np.sqrt(np.mean(dataset.reference(c) ** 2))) for c in dataset.channels}
    above = {c: (left[c] / floor[c]) ** 2 for c in dataset.channels if dataset.base.unit(c) in ("N.m", "N")
             and left[c] > VISIBLE * sizes[c] and left[c] ** 2 > SIGNED * floor[c] ** 2}
    turned, found = mirrored(dataset, model, fit) if above else {}, {}
    for c, times in above.items():
        ends, signed = turned[c]
        if signed or times > DRIFTS or (times > SLOW and ends is not False):
            found[c] = 1.0 - (SIGNED if signed else SLOW) / times
    return found


def remaining(told, before, after, follows, risen=None, wanders=None):
    """How much of what an effect takes is left depending on one variable, in the channels that it acts on.

    Parameters
    ----------
    told : Dependence
        Of the residual with the effect.
    before, after : Selection
        Errors of unseen folds without it and with it.
    follows : dict of str to float
        Share of what it adds that is a function of each variable; one that follows none, as a ripple of hundreds of
        cycles or a small delay, does not stand in for a law of any.
    risen : dict of str to float, optional
        What `rises` says of the held-out part, which lies beyond the folds: in time, or in another run.
    wanders : dict of str to float, optional
        What `slow` says of the model with it: no fold tells on what that depends, where a few blocks hold it.

    Returns
    -------
    share : float
        Of what the effect takes, that is left or paid for elsewhere; more than `LEFT` outweighs it.
    variable : str or None
        What it depends on, `HELD_OUT`, or `WANDERS`.
    """
    without, left = (s.channels.sum(1) for s in (before, after))
    fall, acts = without - left, without - left > RELEVANT * without
    worth = 1.0 if max(follows.values(), default=1.0) > ALIKE else LEFT / DROWNED
    still = [(worth * channel.variables[0]["strength"] * left[k], channel.variables[0]["variable"])
             for k, channel in enumerate(told.channels.values()) if acts[k] and channel.sure]
    for k, (name, channel) in enumerate(told.channels.items()):
        if acts[k] and not channel.sure and name in (wanders or {}):
            still.append((worth * LEFT * wanders[name] * left[k], WANDERS))
    if told.sure and not still:  # no channel by itself tells it from chance, all together do
        still = [(worth * told.variables[0]["strength"] * left[acts].sum(), told.variables[0]["variable"])]
    takes = fall[acts].sum()
    if not takes:
        return 0.0, None
    added = beyond(risen, before)
    if added > LEFT * takes:
        return added / takes, HELD_OUT
    if not still:
        return 0.0, None
    return float(sum(taken for taken, _ in still) - fall[fall < 0].sum()) / takes, max(still)[1]

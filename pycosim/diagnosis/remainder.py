"""What a residual depends on after an effect was added, and what the effect took, in; which of the two is more, out."""

from __future__ import annotations

from .dependence import RELEVANT

LEFT = 0.25
"""Of what an effect takes away, that one variable may still explain of what is left, for the effect to be believed by
itself. A law that stands in for another leaves much of that in its place, or pays for it in another channel. So does a
true one beside a second: then the search goes on, and both are believed together."""


def outweighed(told, before, after):
    """The variable by which what is left outweighs what an effect has taken, in the channels that it acts on.

    Parameters
    ----------
    told : Dependence
        Of the residual with the effect.
    before, after : Selection
        Errors of unseen folds without it and with it.

    Returns
    -------
    str or None
    """
    without, left = (s.channels.sum(1) for s in (before, after))
    fall, acts = without - left, without - left > RELEVANT * without
    still = [(own.variables[0]["strength"] * left[k], own.variables[0]["variable"])
             for k, own in enumerate(told.channels.values()) if acts[k] and own.sure]
    if told.sure and not still:  # no channel by itself tells it from chance, all together do
        still = [(told.variables[0]["strength"] * left[acts].sum(), told.variables[0]["variable"])]
    total = sum(taken for taken, _ in still) - fall[fall < 0].sum()
    if not still or total <= LEFT * fall[acts].sum():
        return None
    return max(still)[1]

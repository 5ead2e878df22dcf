"""The table of all candidates in; which of them would take most off the error, before any test, out.

A few thousand samples, no whitening, no draws: a moment's work before seconds of tests. It knows nothing of chance, and
decides nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.early import tell_early
from ..fit import least_squares
from ..fit.bounded import bounded
from .scores import summed

ENOUGH = 3000  # samples: a share of the error's energy is known to some percent from as many
TRIED = 40  # candidates that are tried within all bounds, of those that would take most without
WORTH = 0.05  # of the error's energy: slow noise gives less than that to the best of some hundred columns by chance


@dataclass(frozen=True)
class Likely:
    """A candidate at first sight.

    Attributes
    ----------
    effect, place : str
        As ``stribeck`` and ``2A``.
    share : float
        Of the error's energy that it would take away, base and candidate within their bounds.
    """

    effect: str
    place: str
    share: float


def first_look(table):
    """Candidates that would take most off the error.

    Parameters
    ----------
    table : Table
        Of the fitted model; its columns are compared with the residual.

    Returns
    -------
    list of Likely
        Each effect at its best place, most first; those with a share below `WORTH` are left out.
    """
    gram, p = _moments(table), len(table.fit.free)
    beside = _beside_base(gram, p)
    tried = sorted(table.candidates, key=lambda c: -_free_fall(*beside, c))[:TRIED]
    low = np.array([table.fit.variables[n].min for n in table.fit.free]) - table.fit.values
    high = np.array([table.fit.variables[n].max for n in table.fit.free]) - table.fit.values
    without, best = bounded(gram[:p, :p], gram[:p, -1], low, high)[0], {}
    for c in tried:
        groups = [*[[k] for k in range(p)], *[p + np.array(part) for part in c.parts]]
        left = np.array([gram[g, -1].sum() for g in groups])
        fall = bounded(summed(gram, groups), left, np.r_[low, c.lower], np.r_[high, c.upper])[0] - without
        share = float(fall / max(gram[-1, -1] - without, 1e-300))
        if share >= WORTH and share > best.get(c.effect.id, Likely("", "", 0.0)).share:
            best[c.effect.id] = Likely(c.effect.id, c.place.name, share)
    return sorted(best.values(), key=lambda found: -found.share)


def _moments(table):
    """Moments of derivatives, candidate columns and residual on a part of the samples, channels by their weight."""
    every = slice(None, None, max(1, len(table.time) // ENOUGH))
    total = 0.0
    for c, weight in enumerate(table.fit.weights):
        rows = weight * np.array([*table.slope[c][:, every], *[v[c, every] for v in table.columns],
                                  table.residual[c, every]])
        total = total + rows @ rows.T
    return total


def _beside_base(gram, p):
    """Moments of all candidate columns, and theirs with the residual, beside what the base takes of them."""
    cross = gram[p:-1, :p] @ least_squares.invert(gram[:p, :p])[0]
    return gram[p:-1, p:-1] - cross @ gram[:p, p:-1], gram[p:-1, -1] - cross @ gram[:p, -1]


def _free_fall(moments, moved, candidate):
    """What a candidate would take without any bounds, roughly: of its own columns alone, beside the base."""
    left = np.array([moved[part].sum() for part in candidate.parts])
    return float(left @ np.linalg.lstsq(summed(moments, candidate.parts), left, rcond=1e-9)[0])


def tell(say, table):
    """Tell a first look to whoever listens for partial answers.

    Parameters
    ----------
    say : callable
        As of `core.early.tell_early`; one that does not listen costs nothing.
    table : Table
        Of the fitted model; its columns are compared with the residual.
    """
    if hasattr(say, "early"):
        tell_early(say, told(first_look(table), table.fit.error, table.dataset.units))


def told(found, error, units):
    """A first look in words.

    Parameters
    ----------
    found : list of Likely
        Most first, as `first_look` gives them.
    error, units : dict of str
        Of the fitted model, by channel.

    Returns
    -------
    str
    """
    size = ", ".join(f"{c} {e:.3g}" + ("" if units[c] == "1" else f" {units[c]}") for c, e in error.items())
    text = f"First look: the error is {size}"
    if not found:
        return f"{text}; no effect alone would take {100 * WORTH:g} % of its energy. Tests follow."
    names = [f"{f.effect.replace('_', ' ')} at {f.place} ({100 * f.share:.0f} %)" for f in found[:3]]
    return f"{text}; most of its energy would go with {', then '.join(names)}. Tests follow, which decide."

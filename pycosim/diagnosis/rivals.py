"""Refitted candidates in; which of them no data tell apart, and which predicts best, out."""

from __future__ import annotations

from .crossval import difference, gap

ALIKE = 0.2  # of what the best takes away, that an alternative may leave
SEPARATE = 1.645  # standard errors by which unseen folds must tell rivals apart: the true one of two is lost in 5 %
SURELY = 3.0  # the same, for one that corrects another, or that its bounds alone hold, to be named before it
PLAIN = 0.05  # of the plain squared error, by which it must be lower to decide: something else that is missing moves it
CONTESTED, BESIDE, KINDS = 5, 3, 3
"""Alternatives beyond which none is a name, the same beside other effects, and effects, of which so many may be
alternatives at any places. A constant torque has six names: offset of motor or reference, asymmetry with or without its
growth at low speed, a far spring, a zero. As the only thing that is missing, the list is the answer; beside something
larger it is what that has left, and one of six was added by the luck of the noise."""


def alike(base, other, best, errors=SEPARATE, kinds=("white", "raw")):
    """Whether unseen folds cannot tell two refitted candidates apart: by so many standard errors, and what they take.

    Rivals that take away very different parts of the error are no alternatives, however noisy the comparison. One that
    its bounds hold errs less in the plain error than one that the other folds must tell: the whitened one counts that.
    Where the folds tell one of them next to nothing, the plain error is not asked.

    Parameters
    ----------
    base : Selection
        Without either.
    other, best : Selection
        Of the rivals.
    errors : float
        Standard errors.
    kinds : tuple of str
        Errors that are asked: ``white``, ``raw``.

    Returns
    -------
    bool
    """
    least = {"white": 2.0 * errors ** 2, "raw": PLAIN * best.raw.sum()}
    for kind in (k for k in kinds if k in _asked(other, best)):
        more, spread = gap(other, best, kind)
        taken = difference(getattr(base, kind), getattr(best, kind))[0]
        if more >= least[kind] and not (more <= errors * spread and more < ALIKE * taken):
            return False
    return True


def behind(one, other):
    """The kinds of errors on unseen folds in which one rival is behind another by more than chance, and by enough.

    Parameters
    ----------
    one, other : Selection
        Of the same folds at one noise level.

    Returns
    -------
    list of str
        Of ``white`` and ``raw``.
    """
    least, found = {"white": 2.0 * SEPARATE ** 2, "raw": PLAIN * one.raw.sum()}, []
    for kind in _asked(one, other):
        more, spread = gap(one, other, kind)
        found += [kind] if more > max(SEPARATE * spread, least[kind]) else []
    return found


def _asked(*selections):
    """The kinds of errors that tell models apart: without the plain one where it is the luck of extrapolation."""
    return ("white", "raw") if all(s.told for s in selections) else ("white",)


def twins(base, other, best, errors=SEPARATE, kinds=("white", "raw")):
    """Whether unseen folds cannot tell two findings apart, by their selections; see `alike`.

    Parameters
    ----------
    base : Selection
        Without either.
    other, best : Finding
        Refitted.
    errors : float
        Standard errors.
    kinds : tuple of str
        Errors that are asked: ``white``, ``raw``.

    Returns
    -------
    bool
    """
    return alike(base, other.selection, best.selection, errors, kinds)


def plainly_better(base, earned):
    """The first of the findings; or, of those that its fast part alone puts behind it, the one that predicts best.

    The whitened error hardly counts what is slow. Where it cannot tell rivals apart and the plain error of unseen folds
    can, that decides.

    Parameters
    ----------
    base : Selection
        Without any of them.
    earned : list of Finding
        Lowest whitened error first.

    Returns
    -------
    Finding
    """
    best = earned[0]
    fall, better = difference(base.white, best.selection.white)[0], []
    for f in earned[1:]:
        more, error = gap(f.selection, best.selection, "white")
        if more <= SEPARATE * error and more < ALIKE * fall and "raw" in behind(best.selection, f.selection):
            better.append(f)
    return min(better, key=lambda f: f.selection.raw.sum()) if better else best


def by_kind(findings, named=(), refines=None):
    """Findings in their order, yet each effect once before any of them at a second place, and what is no name last.

    A correction of what is named does as well because that does: it is no other name. Less of one is what was refused
    by itself.

    Parameters
    ----------
    findings : list of Finding
        Best first.
    named : iterable of str
        Effects that are named before them.
    refines : dict of str to str, optional
        By effect, what it is a correction of.

    Returns
    -------
    list of Finding
        The same ones.
    """
    known, ranks, about = {}, [], {*named, *(f.effect for f in findings)}
    for f in findings:
        known[f.effect] = known.get(f.effect, 0) + 1
        ranks.append((f.refused is not None, (refines or {}).get(f.effect) in about, known[f.effect]))
    return [f for _, f in sorted(zip(ranks, findings), key=lambda pair: pair[0])]


def too_many(finding, refines, beside):
    """Whether so many others do as well as a finding that none of them is a name.

    Few effects at many places are no such case: one that acts at one stage or at another is known. Nor is a correction
    of an effect that is among them one more: it does as well because that does. One that is over between two samples
    would not be named by itself.

    Parameters
    ----------
    finding : Finding
        With its alternatives.
    refines : dict of str to str
        By effect, what it is a correction of.
    beside : bool
        Whether other effects are in the model already.

    Returns
    -------
    bool
    """
    counted = [t for t in finding.twins if (t["effect"], t["place"]) not in finding.uncounted]
    named = {finding.effect, *(t["effect"] for t in counted)}
    return sum(refines.get(t["effect"]) not in named for t in counted) > (BESIDE if beside else CONTESTED) and len(
        named) > KINDS

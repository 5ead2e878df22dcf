"""Findings of a diagnosis in; what an engineer asks of each (where, how large, how sure, what would decide) out."""

from __future__ import annotations

from ..compile import find_effect
from ..compile.effects import annotation
from ..fit.nullspace import number

# what an effect needs the data to vary, and the variable that its signature is drawn over
OVER = {"speeds": "speed@{place}", "loads": "load@{place}", "load_signs": "load@{place}", "time": "time",
        "temperatures": "temperature", "reversals": "time_since_reversal", "accelerations": "acceleration@{place}"}

SURE = ((1e-3, "As sure as this test can be"), (1e-2, "Very likely"), (0.05, "Likely"))  # largest p-value, in words


def fall(before, after):
    """Part of each channel's error that goes.

    Parameters
    ----------
    before, after : dict of str to float
        RMSE of each channel in its unit.

    Returns
    -------
    dict of str to float
    """
    return {c: 1 - after[c] / before[c] for c in after if before.get(c)}


def experiment(library, finding, most=None):
    """What would tell a candidate from its twins, or make it surer where it has none.

    Parameters
    ----------
    library : Library
        Knows the effects' descriptions, and what each needs of a log.
    finding : Finding
        A candidate of a diagnosis.
    most : int, optional
        Experiments that are named; the candidate's own comes first. All by default.

    Returns
    -------
    str
        An imperative without a full stop.
    """
    own = annotation(library, find_effect(library, finding.effect).model).get("experiment", "")
    others = {t["effect"] for group in (finding.twins, *finding.together) for t in group} - {finding.effect}
    wanted = [own, *(annotation(library, find_effect(library, e).model).get("experiment", "") for e in sorted(others))]
    text = "; ".join(list(dict.fromkeys(w for w in wanted if w))[:most])
    places = [t["place"] for t in finding.twins if t["effect"] == finding.effect]
    if places:
        text += (f"; and choose a line along which what acts at {finding.place} and at {', '.join(places)} differs, "
                 "if the mechanism has one")
    return text


def sentence(library, finding, error):
    """One candidate in words.

    Parameters
    ----------
    library : Library
        Knows the effects' descriptions, and what each needs of a log.
    finding : Finding
        A candidate of a diagnosis.
    error : dict of str to float
        Before it is added.

    Returns
    -------
    str
    """
    effect = find_effect(library, finding.effect)
    what = effect.description[:1].lower() + effect.description[1:]
    gone = fall(error, finding.predicted_error)
    best = max(gone, key=gone.get, default=None)
    text = f"At {finding.place}: {what}. "
    text += (f"Chance alone would find something as large in {chance(finding.p_value)} among all the effects and "
             "places tested. ")
    if best is not None and gone[best] > 0:
        text += f"Adding it should take {100 * gone[best]:.0f} % off the error of {best}. "
    known = [f"{n} = {number(c['value'])} {'' if c['unit'] == '1' else c['unit']}".rstrip()
             + (f" ({number(c['ci95'][0])} to {number(c['ci95'][1])})" if None not in c["ci95"] else "")
             for n, c in finding.coefficients.items() if c["value"] is not None]
    if known:
        text += f"It would be {', '.join(known)}. "
    if finding.twins:
        twins = ", ".join(f"{t['effect']} at {t['place']}" for t in finding.twins)
        text += f"These data cannot tell it from {twins}. "
    return text.strip()


def chance(p):
    """A probability in words of one in so many; the smallest that the draws can tell is a bound.

    Parameters
    ----------
    p : float
        From 0 to 1.

    Returns
    -------
    str
        As ``one log of 250``.
    """
    if p > 0.995:
        return "nearly every log"
    if p > 0.5:
        return f"{100 * p:.0f} logs of 100"
    return f"{'at most ' if p <= 1e-3 else ''}one log of {round(1 / p):d}"


def certainty(p):
    """A family-wise p-value in words and as a number.

    Parameters
    ----------
    p : float
        From 0 to 1.

    Returns
    -------
    str
        As ``Very likely: chance alone would find something as large in one log of 250 (p = 0.004)``.

    Examples
    --------
    >>> certainty(0.004)
    'Very likely: chance alone would find something as large in one log of 250 (p = 0.004)'
    """
    words = next((w for most, w in SURE if p <= most), "Doubtful")
    bound = f"p ≤ {SURE[0][0]:g}" if p <= SURE[0][0] else f"p = {number(p)}"
    return f"{words}: chance alone would find something as large in {chance(p)} ({bound})"


def variable(library, finding):
    """Variable of the residual over which an effect's signature shows best; None where no single one does.

    Parameters
    ----------
    library : Library
        Knows the effects' descriptions, and what each needs of a log.
    finding : Finding
        A candidate of a diagnosis.

    Returns
    -------
    str or None
    """
    needs = annotation(library, find_effect(library, finding.effect).model).get("needs", "").split()
    form = next((OVER[n] for n in needs if n in OVER), None)
    return form.format(place=finding.place.split("+")[0]) if form else None

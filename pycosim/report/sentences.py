"""Fits, diagnoses and selection paths in; sentences that an engineer reads out."""

from __future__ import annotations

import json
import math

import numpy as np

from ..compile import component_called
from ..core.words import listed
from ..data.stale import stale_text
from ..diagnosis.compare import worded
from ..diagnosis.decide import TOO_FEW
from ..diagnosis.dependence import ALARM, RARE
from ..diagnosis.first_look import WORTH
from ..diagnosis.pairs import DOUBTED
from ..diagnosis.remainder import HELD_OUT, SLOW, WANDERS
from ..diagnosis.scores import LEVEL
from ..diagnosis.trials import BETWEEN
from ..fit.nullspace import number
from . import cards

LIKELIEST = 3  # effects that a first look names
MOST = 0.5  # of the energy of what is left: the larger part
UNSEEN = 3.0  # times the error of the fitted passes, from which that of held-out ones is of another kind

# --- sentences ------------------------------------------------------------------------------------------------------


def errors_text(error, units):
    """Errors in words.

    Parameters
    ----------
    error : dict of str to float
        By channel; None or NaN where it is not known.
    units : dict of str to str
        By channel.

    Returns
    -------
    str
        As ``C_H 0.138 N.m, C_K 0.141 N.m``.

    Examples
    --------
    >>> errors_text({"C_H": 0.138}, {"C_H": "N.m"})
    'C_H 0.138 N.m'
    """
    known = {c: v for c, v in error.items() if v is not None and math.isfinite(v)}
    return ", ".join(f"{c} {number(v)}{_unit(units[c])}" for c, v in known.items()) or "unknown"


def _unit(unit):
    return "" if unit in ("1", "") else f" {unit}"


def labelled(name, unit):
    """A name with its unit; a number without unit has none.

    Parameters
    ----------
    name, unit : str
        Of a quantity; unit ``1`` for a number without one.

    Returns
    -------
    str
        As ``C_H [N.m]``.

    Examples
    --------
    >>> labelled("C_H", "N.m"), labelled("s1A.mu", "1")
    ('C_H [N.m]', 's1A.mu')
    """
    return name if unit in ("1", "") else f"{name} [{unit}]"


def change_text(before, after, units):
    """Two errors in words.

    Parameters
    ----------
    before, after : dict of str to float
        By channel.
    units : dict of str to str
        By channel.

    Returns
    -------
    str
        As ``C_H 0.235 -> 0.138 N.m``, for every channel of both.
    """
    return ", ".join(f"{c} {number(before[c])} -> {number(after[c])}{_unit(units[c])}" for c in before if c in after)


def coefficient_text(name, c):
    """A coefficient in words.

    Parameters
    ----------
    name : str
        As ``fs``.
    c : dict
        ``value``, ``unit``, ``ci95``, and ``at_bound`` where it is known, as in ``diagnosis.json``.

    Returns
    -------
    str
        As ``fs = 0.045 N.m (95 %: 0.04 to 0.05)``.
    """
    if c["value"] is None:
        return f"{name} unknown"
    text, told = f"{name} = {number(c['value'])}{_unit(c['unit'])}", []
    low, high = c["ci95"]
    if low is not None and high is not None:
        told.append(f"95 %: {number(low)} to {number(high)}")
    if c.get("at_bound"):
        told.append(_bound(c["at_bound"]))
    return text + (f" ({', '.join(told)})" if told else "")


def _bound(end):
    """The bound that a value is at, in words."""
    return f"at its {'lower' if end == 'min' else 'upper'} bound"


def summary_data(dataset):
    """What was used of the logs.

    Parameters
    ----------
    dataset : Dataset
        Its logs, and what was left out of them, are told.

    Returns
    -------
    list of str
    """
    moving, held = int(dataset.moving.sum()), int(dataset.is_test.sum())
    runs = f"{len(dataset.logs)} {'run' if len(dataset.logs) == 1 else 'runs'}"
    samples = "the mean of each is a sample" if dataset.averaged else f"{len(dataset.time)} samples"
    blocks = "means" if dataset.averaged else "passes out and back" if dataset.blocks.straight else "stretches"
    lines = [f"{dataset.study.rig}: {runs}, {samples}, {moving} of them moving "
             f"(every segment above {number(dataset.w_min)} {dataset.speed_unit}); {held} of {len(dataset.blocks)} "
             f"{blocks} held out."]
    for log in dataset.logs:
        if "means_of" in log.meta:
            lines.append(f"{log.name}: {log.meta['file_rows']:,} rows, read as means of {log.meta['means_of']}.")
        if "stands" in log.meta:
            lines.append(f"{log.name}: {log.meta['file_rows']:,} rows; {stale_text(log, log.columns.get)}.")
        if log.dropped:
            rows = sum(b - a + 1 for a, b in log.dropped)
            lines.append(f"{log.name}: {rows} {'row' if rows == 1 else 'rows'} left out.")
    if dataset.study.leave_out:
        gone = int(np.count_nonzero(dataset.left_out))
        lines.append(f"{gone} {'sample' if gone == 1 else 'samples'} left out, as [data] leave_out says.")
    if dataset.spiked:
        count = "1 sample" if dataset.spiked == 1 else f"{dataset.spiked} samples"
        lines.append(f"{count} of torques far off the neighbours, in all by more than the noise: what looks for "
                     "effects bridges that; [fit] robust = true does so everywhere.")
    if dataset.paired:
        lines.append("No torque reference: errors are half the difference between a pass out and its way back.")
    return lines + dataset.shortcomings()


def summary_doubt(dataset, fit):
    """Whether a slip in the study or the log is likelier than a missing effect.

    Parameters
    ----------
    dataset : Dataset
        Its logs, and what was left out of them, are told.
    fit : Fit
        Of the base model.

    Returns
    -------
    list of str
        One line, or none.
    """
    if dataset.paired or dataset.averaged:
        return []
    view = dataset.view("fit")
    share = {c: fit.error[c] / max(np.std(dataset.measured[c][view]), 1e-300)
             for c in dataset.channels if c in dataset.measured}
    if not share or np.mean(np.square(list(share.values()))) < 1.0:
        return []
    missed = [c for c, own in share.items() if own >= 1.0]
    return [f"Doubtful: the fitted model misses {listed(missed)} by more than a constant would; check units, signs, "
            "zeros and the order of the columns before believing what follows."]


def aligned(rows):
    """Rows of text in columns.

    Parameters
    ----------
    rows : list of sequence of str
        Cells; all rows have as many, the last column is not filled up.

    Returns
    -------
    list of str

    Examples
    --------
    >>> aligned([("name", "value"), ("s1A.f0", "0.1")])
    ['name    value', 's1A.f0  0.1']
    """
    widths = [max(len(r[k]) for r in rows) for k in range(len(rows[0]) - 1)]
    return ["  ".join(c.ljust(w) for c, w in zip(r, (*widths, 0))).rstrip() for r in rows]


def summary_cosimulation(result):
    """What was stepped together, and where the signals went.

    Parameters
    ----------
    result : dict
        ``cosim.json``.

    Returns
    -------
    list of str
    """
    lines = [f"{result['scenario']}: {number(result['time'])} of {number(result['duration'])} s, "
             f"{result['rows']} rows of {len(result['columns'])} signals at {number(result['log_rate'])} Hz, "
             f"{result['method']} in the order"]
    lines += [f"  {c['name']}: {c['is']}, {c['what']}, {number(c['rate'])} Hz" for c in result["components"]]
    if result["unconnected"]:
        lines.append(f"Connected to nothing, so at their start values: {', '.join(result['unconnected'])}.")
    rows = [("column", "least", "largest", "rms"), *((n, *(number(r[k]) for k in ("min", "max", "rms")))
                                                    for n, r in result["columns"].items())]
    return lines + aligned(rows)


def summary_parameters(result):
    """Parameters with intervals, and what the data cannot tell.

    Parameters
    ----------
    result : dict
        ``parameters.json``.

    Returns
    -------
    list of str
    """
    rows = [("parameter", "value", "95 %", "unit", "")]
    for name, p in result["parameters"].items():
        rows.append((name, finite(p["value"]), f"{finite(p['ci95'][0])} to {finite(p['ci95'][1])}",
                     "" if p["unit"] == "1" else p["unit"], note(p)))
    lines = aligned(rows)
    if result.get("conditional"):
        lines.append("Something unknown is missing beside these values: they hold if it is the same all over the data; "
                     "intervals are as wide as blocks differ.")
    directions = list(dict.fromkeys(d["text"] for d in result["null_directions"]))
    lines += [f"Not determined: {t}." for t in directions]
    lines += [f"Weak: {d['text']}." for d in result["weak_directions"]]
    for name, own in result.get("own", {}).items():
        unit = "" if own["unit"] == "1" else f" {own['unit']}"
        unseen = own.get("unseen")  # none for any but a phase
        found = ", ".join(f"{n} {number(v)}{unit}" for n, v in (unseen or {}).items())
        spread = own["between_runs"]
        between = "" if spread is None else f", standard deviation between runs {number(spread)}{unit}"
        lines.append(f"{name} has a value of its own in each run: mean {number(own['mean'])}{between}; " + (
                         "a run that was not fitted is predicted with the mean." if unseen is None else
                         f"a run that was not fitted has what leaves least there{': ' * bool(found)}{found}."))
    error = errors_text(result["error"], result["units"])
    lines.append(f"Error on the fitted passes: {error} (RMSE of moving samples).")
    return lines


def finite(value):
    """An end of an interval in words.

    Parameters
    ----------
    value : float or None
        None where the data set no end.

    Returns
    -------
    str
    """
    if value is None:
        return "any"
    return number(value, 1e-2)  # a bound of zero is approached to 5e-8


def percent(share, sign=""):
    """A share in percent, to two digits; near a hundred and above to three, and never as a power of ten.

    Parameters
    ----------
    share : float
        1 for all of it.
    sign : str
        ``+`` to write the sign of what is not below zero as well.

    Returns
    -------
    str
        Without the sign of percent.

    Examples
    --------
    >>> percent(0.0123), percent(0.997)
    ('1.2', '99.7')
    """
    value = 100 * share
    size = abs(value)
    digits = ".2g" if size < 99 else ".3g" if size < 999.5 else ".0f"
    return f"{value:{sign}{digits}}"


def note(p):
    """What is to be said of a parameter beside its value.

    Parameters
    ----------
    p : dict
        Of ``parameters.json``.

    Returns
    -------
    str
        Empty where nothing is.
    """
    notes = []
    if not p["identifiable"]:
        notes.append("not determined by itself; the range is what the bounds allow")
    if p["at_bound"]:
        notes.append(_bound(p["at_bound"]))
    return "; ".join(notes)


def summary_first_look(error, floor, told, likely, units):
    """A first look at a fitted model, before any test.

    Parameters
    ----------
    error, floor : dict of str to float
        Of each channel: RMSE, and the least that a model of this kind could reach; NaN where that is not known.
    told : Dependence
        What the residual depends on.
    likely : list of Likely
        Effects that would take most off the error, most first.
    units : dict of str to str
        By channel.

    Returns
    -------
    list of str
    """
    sizes = [f"{c} errs by {number(v)}{_unit(units[c])}"
             + (f", {v / floor[c]:.1f} times its noise floor" if floor[c] > 0 else "") for c, v in error.items()]
    lines = [f"First look, before any check or test: {'; '.join(sizes)}."]
    if told.sure:
        most = told.variables[0]
        lines.append(f"The error depends most on {worded(most['variable'])} ({100 * most['strength']:.0f} %).")
    names = [f"{f.effect.replace('_', ' ')} at {f.place} ({100 * f.share:.0f} %)" for f in likely[:LIKELIEST]]
    return [*lines, f"Likeliest so far, by the share of the error's energy that each alone would take: "
                    f"{', '.join(names)}; provisional." if names
            else f"No effect alone would take {100 * WORTH:g} % of the error's energy."]


def summary_diagnosis(result, final=False):
    """What is missing, how sure, what it would bring, and what these data cannot show.

    Parameters
    ----------
    result : dict
        ``diagnosis.json``.
    final : bool
        Of the improved model: nothing missing means nothing else.

    Returns
    -------
    list of str
    """
    lines = {"missing_effect": _missing, "unexplained": _unexplained, "nothing_missing": _nothing,
             "not_enough_excitation": _too_little}[result["verdict"]](result, final)
    lines += travels_text(result.get("travels")) + _by_channel(result) + smallest_text(result["smallest_detectable"])
    return lines + summary_undetectable(result["undetectable"])


def travels_text(travels):
    """Over which travels the machine's own friction builds up, where a log told that they are not the rig's.

    Parameters
    ----------
    travels : dict or None
        Of ``diagnosis.json``, by parameter: ``value``, ``unit``, and ``rig``, what the rig says.

    Returns
    -------
    list of str
    """
    if not travels:
        return []
    text = ", ".join(f"{name} = {number(t['value'])} {t['unit']} for the rig's {number(t['rig'])}"
                     for name, t in travels.items())
    return [f"The machine's own friction builds up after turns over another travel than the rig's: {text}. The study "
            "that is written says so, and samples at which friction still builds up are not compared."]


def _by_channel(result):
    """What each channel says, where they do not all say the same."""
    verdicts = {}
    for name, told in (result.get("channels") or {}).items():
        verdicts.setdefault(told["verdict"], []).append(name)
    if len(verdicts) < 2:
        return []
    return ["By channel: " + "; ".join(f"{v.replace('_', ' ')} in {listed(names)}" for v, names in verdicts.items())
            + "."]


def smallest_text(entries, most=4):
    """The effects that could hide best in this log: the largest sizes that it would not show.

    Parameters
    ----------
    entries : list of dict
        ``smallest_detectable`` of ``diagnosis.json``.
    most : int
        Effects to name.

    Returns
    -------
    list of str
        One line, or none.
    """
    worst = {}
    for e in sorted(entries, key=lambda e: -(e["error_share"] or 0)):
        worst.setdefault(e["effect"], e)
    hidden = [f"{e['effect']} at {e['place']} below {e['coefficient']} = {number(e['value'])}{_unit(e['unit'])}"
              for e in list(worst.values())[:most]]
    if not hidden:
        return []
    return [f"What could still hide (above that size it is found in nine logs of ten): {'; '.join(hidden)}."]


def _missing(result, final):
    best = next(c for c in result["candidates"] if c["accepted"])
    numbers = ", ".join(coefficient_text(n, c) for n, c in best["coefficients"].items())
    lines = [f"Missing: {best['effect']} at {best['place']} (p = {number(best['p_value'])} family-wise). {numbers}.",
             f"Error with it, predicted: {change_text(result['error'], best['predicted_error'], result['units'])}; "
             f"noise floor {errors_text(result['noise_floor'], result['units'])}."]
    if best["held_out_error"]:
        lines.append(f"Error with it on passes never fitted: {errors_text(best['held_out_error'], result['units'])}.")
    return lines + alternatives_text(best)


def alternatives_text(best, experiment=True):
    """What these data cannot tell a candidate from, and what would.

    Parameters
    ----------
    best : dict
        A candidate of ``diagnosis.json``, or its ``twins`` and the ``experiment``.
    experiment : bool
        Name the experiment that would.

    Returns
    -------
    list of str
        One line, or none.
    """
    if not best["twins"]:
        return []
    line = f"These data cannot tell it from {listed(_names(best['twins']))}"
    if experiment and best["experiment"]:
        line += f"; to tell them apart, {best['experiment']}"
    return [line + "."]


def _names(pairs):
    return [f"{p['effect']} at {p['place']}" for p in pairs]


def _repeats(own):
    """Whether most of what is left of a channel follows a variable on passes that it was not fitted to."""
    return any(d["strength"] > MOST for d in own["depends_on"] if d["variable"] != "time")


def _off_where_held_out(channels):
    """Channels that are slow for want of what only held-out passes show."""
    return [c for c, own in channels.items() if own.get("slow")
            and own.get("held_out_error", 0.0) > UNSEEN * own["error"]]


def _unexplained(result, final):
    if contested := _contested(result, final):
        return [*contested, *certainty_of_unknown(result), _at_floor(result)]
    if passing := between_of(result):
        return [f"Something {'else ' if final else ''}is missing that is over within a few samples, so that these data "
                f"do not show what: {listed(_names(passing))} would each lower the error. To see which, record faster.",
                *certainty_of_unknown(result), _at_floor(result)]
    depends = [f"{d['variable']} ({number(d['strength'])})" for d in result["residual_depends_on"][:3]
               if d["strength"] > 1e-3]
    line = f"Something {'else ' if final else ''}is missing that no effect of the library explains"
    line += f"; what is left depends most on {listed(depends)}." if depends else "."
    by_run = bool(depends) and result["residual_depends_on"][0]["variable"] == "run"
    if by_run:
        line += (" It differs from run to run, as a zero, an offset or a payload does: add it, and give it a value of "
                 "its own in each run ([fit] own).")
    line += "".join(f" {told}" for told in of_no_motion(result["channels"])) + _refusals(result["candidates"])
    mystery = result["unexplained"]
    if mystery and mystery["proposal"] and not by_run:
        line += f" {mystery['proposal']['text']}"
        if mystery["proposal"]["file"]:
            line += (" It is written as guess.mo, to be tried as an effect of your own: "
                     "modelica = [\"guess.mo\"] in [rig].")
    if mystery and mystery.get("free"):
        line += f" {mystery['free']['text']}"
    return [line, *certainty_of_unknown(result), _at_floor(result)]


def between_of(result):
    """The likeliest of what may be missing where that is over between two samples.

    Parameters
    ----------
    result : dict
        ``diagnosis.json``.

    Returns
    -------
    list of dict
        Candidates; none where nothing of that kind is missing, or more than that.
    """
    return [c for c in result["candidates"] if c["p_value"] < LEVEL and c.get("refused") == BETWEEN][:3] if (
        result.get("between") and result["verdict"] == "unexplained") else []


def mains_text(channels):
    """The beats of mains in what is left, where nothing is missing: they hide what is as small.

    Parameters
    ----------
    channels : dict or None
        Of ``diagnosis.json``.

    Returns
    -------
    list of str
    """
    beats = {c: own["beat"] for c, own in (channels or {}).items() if own.get("beat")}
    told = [f"{c} ({number(b['frequency'])} Hz, {100 * b['share']:.0f} % of its squared error)"
            for c, b in beats.items()]
    return [f"Mains are in {listed(told)}: noise of the record, which hides what is as small."] if beats else []


def of_no_motion(channels):
    """What is left that follows no motion: held-out passes that differ, what is slower than noise, a beat.

    Parameters
    ----------
    channels : dict
        Of ``diagnosis.json``.

    Returns
    -------
    list of str
        Sentences; none where what is left follows the motion, or nothing is.
    """
    lines, unseen = [], _off_where_held_out(channels)
    if unseen:
        own = {c: channels[c] for c in unseen}
        off = listed([f"{c} {number(v['held_out_error'])} instead of {number(v['error'])}" for c, v in own.items()])
        lines.append(f"Held-out passes are off by far more than the fitted ones ({off}): they move as the fitted ones "
                     "do not, or something changed before them. Fit more of the motion, or hold out other runs.")
    slow = [c for c, own in channels.items() if own.get("slow") and not _repeats(own) and c not in unseen]
    if slow:
        lines.append(f"Most of what is left of {listed(slow)} is slower than noise and does not repeat: a reference "
                     "that drifts, or a loss that changes with time.")
    if beats := {c: own["beat"] for c, own in channels.items() if own.get("beat")}:
        told = listed([f"{c} at {number(b['frequency'])} Hz ({100 * b['share']:.0f} % of the squared error)"
                       for c, b in beats.items()])
        mains = all(b.get("mains") for b in beats.values())
        lines.append(f"What is left keeps a beat all through the log, whatever the motion: {told}. " + (
            "That is mains: noise of the record, and no law of the machine." if mains else
            "Mains, a pump or a fan do that, and no law of friction."))
    return lines


def contested_of(result):
    """The candidate that is not added because several other effects do as well.

    Parameters
    ----------
    result : dict
        ``diagnosis.json``.

    Returns
    -------
    dict or None
    """
    return next((c for c in result["candidates"] if c.get("contested")), None)


def _contested(result, final):
    """Which effects do equally well where they are too many for a name, and what to do; nothing where they are few."""
    best = contested_of(result)
    if best is None:
        return []
    known = "Where you know which, each is added by 'pycosim add STUDY EFFECT@PLACE'." if best.get("outdone") else (
        f"Where you know which, or any will do, 'pycosim add STUDY {best['effect']}@{best['place']}' adds it.")
    lines = [f"Something {'else ' if final else ''}is missing, and {equals(best)}.",
             f"Error with {'the first of them' if not best.get('together') else _names([best])[0]}, predicted: "
             f"{change_text(result['error'], best['predicted_error'], result['units'])}. {known}"]
    if small := dict.fromkeys(p["effect"] for p in _small(best)):
        lines.append("Where masses, their centres and the zeros of the joints are known better than that, say so: "
                     f"[data] rejected = {json.dumps([*small])}.")
    return lines + ([f"To tell them apart, {best['experiment']}."] if best["experiment"] else [])


def equals(best):
    """What explains equally well what is missing, in words.

    Parameters
    ----------
    best : dict
        A candidate of ``diagnosis.json`` that is not added for that.

    Returns
    -------
    str
        An end of a sentence.
    """
    some = listed(_names([best, *best["twins"]]))
    if best.get("together"):
        two = listed([" with ".join(_names(pair)) for pair in best["together"]])
        if small := dict.fromkeys(_names(_small(best))):
            least = f"less than {100 * DOUBTED:g} %"
            two += f", where {listed(small)} would be an error of {least} in the model of the load"
        if best.get("outdone"):
            return f"two effects at once explain it better than one; which two, these data do not tell: {two}"
        one = f"any of {some}" if best["twins"] else some
        return f"two effects at once explain it no worse than one: {two}; the one is {one}"
    kinds = {c["effect"] for c in [best, *best["twins"]]}
    return f"{len(kinds)} effects of the library explain it equally well, too many to name one: {some}"


def _small(best):
    """Errors of the load's model, as such models have, beside which another effect does as well as the best one."""
    return [p for pair in best.get("together", ()) for p in pair if p.get("small")]


def certainty_of_unknown(result):
    """How sure it is that something is missing, where no effect of the library is it.

    Parameters
    ----------
    result : dict
        ``diagnosis.json`` whose verdict is ``unexplained``.

    Returns
    -------
    list of str
        What chance would do, by the test that the verdict rests on; and the error over its noise floor.
    """
    tested = result["candidates"]
    p = min((c["p_value"] for c in tested), default=1.0)
    blamed = {c: own for c, own in result["channels"].items() if own["verdict"] == "unexplained"}
    follows = next(((c, own["depends_on"][0]["variable"]) for c, own in blamed.items() if own["depends_on"]), None)
    if not follows and result["residual_depends_on"] and not any(own.get("slow") for own in blamed.values()):
        follows = "all channels together", result["residual_depends_on"][0]["variable"]
    if p < LEVEL:
        open_end = "which of them it is stays open" if contested_of(result) or between_of(result) else (
            "that it is one of these is refused")
        lines = [f"{cards.certainty(p)}, among all {len(tested)} effects and places tested. So sure it is that "
                 f"something is missing; {open_end}."]
    elif follows:
        lines = [f"Very likely: what is left of {follows[0]} depends on {worded(follows[1])} also in parts of the log "
                 f"that this was not fitted to, by more than {ALARM:g} standard errors or more than chance does in one "
                 f"log of {round(1 / RARE)}."]
    elif beating := [c for c, own in blamed.items() if own.get("beat")]:
        lines = [f"Very likely: the beat in {listed(beating)} predicts parts of the log that its size and phase do not "
                 "come from."]
    elif _off_where_held_out(blamed):
        lines = [f"Very likely: held-out passes are off by more than {UNSEEN:g} times what the fitted ones are."]
    else:
        lines = [f"Likely: the error is more than {math.sqrt(SLOW):.2g} times the noise floor, which no simulated "
                 "machine with nothing hidden reached."]
    return lines + _over_floor(blamed or result["channels"])


def _over_floor(channels):
    """Errors of channels over their noise floors."""
    ratios = {c: own["error"] / own["floor"] for c, own in channels.items()
              if own["floor"] and math.isfinite(own["floor"]) and own["error"] > own["floor"]}
    told = [f"{'that' if k else 'The error'} of {c} is {number(r)} times its noise floor "
            f"({100 * (1 - r ** -2):.0f} % of its energy is not noise)" for k, (c, r) in enumerate(ratios.items())]
    return [f"{listed(told)}."] if told else []


def _refusals(candidates):
    """Why significant candidates are no answer."""
    found = ""
    for c in [c for c in candidates if c.get("varies_with")][:1]:
        found += (f" {c['effect']} at {c['place']} would lower the error, but its coefficient is not the same all over "
                  f"the data: it differs with {c['varies_with']}, so that another law is at work.")
    for c in [c for c in candidates if c.get("outweighed_by") and not c.get("varies_with")][:1]:
        left = "is" if c["outweighed_by"] == WANDERS else "still depends on"
        why = (f"much of what it leaves {left} {c['outweighed_by']}, and no effect of the library explains "
               "that beside it") if c["outweighed_by"] != HELD_OUT else f"it predicts {HELD_OUT} of the log worse"
        found += f" {c['effect']} at {c['place']} would lower the error, but {why}."
    reasons = {}
    for c in [c for c in candidates if c["p_value"] < LEVEL and c.get("refused")][:3]:
        reasons.setdefault(c["refused"], []).append(c)
    return found + "".join(f" Significant, but {why}: {listed(_names(some))}." for why, some in reasons.items())


def _at_floor(result):
    error, floor = (errors_text(result[k], result["units"]) for k in ("error", "noise_floor"))
    return f"Error {error}; noise floor {floor}."


def _nothing(result, final):
    line = f"Nothing {'else ' if final else ''}is missing that these data could show"
    tested = len(result["candidates"])
    best = min(result["candidates"], key=lambda c: c["p_value"], default=None)
    if best:
        line += (f": of {tested} candidates the likeliest is {best['effect']} at {best['place']}, "
                 f"p = {number(best['p_value'])} family-wise{but(best)}")
    return [line + ".", *mains_text(result["channels"]), _at_floor(result)]


def but(best):
    """Why a candidate that chance does not explain is none; nothing for others.

    Parameters
    ----------
    best : dict
        A candidate of ``diagnosis.json``.

    Returns
    -------
    str
        As ``, but it is refused: too small to matter``.
    """
    return f", but it is refused: {best['refused']}" if best["p_value"] < LEVEL and best.get("refused") else ""


def unconfirmed(result):
    """The candidate for the sake of which a verdict is that the passes are too few, if one is.

    Parameters
    ----------
    result : dict
        ``diagnosis.json``.

    Returns
    -------
    dict or None
    """
    few = result["verdict"] == "not_enough_excitation"
    return next((c for c in result["candidates"] if few and c.get("refused") == TOO_FEW), None)


def _too_little(result, final):
    unsure = unconfirmed(result)
    if unsure:
        return [f"{unsure['effect']} at {unsure['place']} would explain more than chance does "
                f"(p = {number(unsure['p_value'])}), and these data hold too few passes to see whether it predicts one "
                "that it was not fitted to. Log more passes.", _at_floor(result)]
    return ["These data move too little, or too much alike, to tell whether an effect is missing; see below what each "
            "effect needs.", _at_floor(result)]


def summary_undetectable(entries):
    """What the data cannot show: one line a reason.

    Parameters
    ----------
    entries : list of dict
        ``undetectable`` of ``diagnosis.json``.

    Returns
    -------
    list of str
    """
    groups = {}
    for entry in entries:
        places = groups.setdefault((entry["why"], entry["experiment"]), {})
        places.setdefault(entry["effect"], []).append(entry["place"])
    return [f"Not visible ({why}): "
            + "; ".join(f"{effect} at {', '.join(p)}" for effect, p in effects.items())
            + (f". To see it: {experiment}." if experiment else ".")
            for (why, experiment), effects in groups.items()]


def summary_improvement(first, last, ladder, parameters):
    """The whole story of a search: what was missing, step by step, and what is left.

    Parameters
    ----------
    first, last : dict
        ``diagnosis.json`` and ``diagnosis_final.json``.
    ladder, parameters : dict
        ``ladder.json`` and ``parameters.json``.

    Returns
    -------
    list of str
    """
    steps, units = ladder["steps"], ladder["units"]
    if len(steps) == 1:
        return summary_diagnosis(first)
    lines = [f"Base model: error {errors_text(steps[0]['error'], units)}"
             + (f"; held-out {errors_text(steps[0]['held_out_error'], units)}" if steps[0]["held_out_error"] else "")
             + "."]
    for before, step in zip(steps, steps[1:]):
        lines += _step(before, step, ladder, first, parameters)
    best, added = first["candidates"][0], [(s["added"]["effect"], s["added"]["place"]) for s in steps[1:]]
    if best["accepted"] and (best["effect"], best["place"]) not in added:
        part = {*best["place"].split("+")}
        all_of = next((p for e, p in added if e == best["effect"] and part < {*p.split("+")}), None)
        lines.append(f"{best['effect']} at {best['place']} was found first, " + (
            "in place of these, and is not needed beside them." if all_of is None else
            f"and then elsewhere; with one size at {all_of} it does as well."))
    if len(steps) > 2:
        lines.append(f"In all: error {change_text(steps[0]['error'], steps[-1]['error'], units)}; "
                     f"held-out {change_text(steps[0]['held_out_error'], steps[-1]['held_out_error'], units)}.")
    lines.append(f"Noise floor: {errors_text(last['noise_floor'], units)}.")
    return [*lines, *summary_diagnosis(last, final=True)]


def _step(before, step, ladder, first, parameters):
    """An effect that was added: its coefficients in the final model, what was expected of it, and what it brought."""
    units, added = ladder["units"], [s["added"] for s in ladder["steps"]]
    name, place = step["added"]["effect"], step["added"]["place"]
    found = next((c for c in first["candidates"] if c["accepted"] and (c["effect"], c["place"]) == (name, place)), None)
    base = component_called(name, place)
    numbers = ", ".join(coefficient_text(n[len(base) + 1:], p) for n, p in parameters["parameters"].items()
                        if n.startswith(f"{base}."))
    sure = f" (p = {number(found['p_value'])} family-wise)" if found else ""
    first_one = before["added"] is None
    lines = [f"{'Missing' if first_one else 'Then missing'}: {name} at {place}{sure}. {numbers}.",
             f"  Error {change_text(before['error'], step['error'], units)}"
             + (f" (predicted {errors_text(step['predicted_error'], units)})" if step["predicted_error"] else "")
             + (f"; held-out {change_text(before['held_out_error'], step['held_out_error'], units)}"
                if step["held_out_error"] else "") + "."]
    alike = [t for t in step.get("alternatives", ()) if t not in added]
    return lines + alternatives_text({"twins": alike, "experiment": found["experiment"] if found else ""})


def summary_addition(made):
    """What was added because it was asked for, and how well the data support it.

    Parameters
    ----------
    made : Addition
        Of `pycosim.diagnosis.search.add`.

    Returns
    -------
    list of str
    """
    effect, place = made.step.added
    lines = [f"Added {effect} at {place}" + (f", the best of {', '.join(made.tried)} by cross-validation."
                                             if len(made.tried) > 1 else ".")]
    if made.finding is not None and made.finding.p_value >= LEVEL:
        lines.append(f"These data do not ask for it: p = {made.finding.p_value:.3g} family-wise.")
    if made.hidden:
        lines.append(f"These data can hardly show it ({made.hidden['why']}); its coefficients mean little. "
                     f"To see it: {made.hidden['experiment']}.")
    return lines


def summary_confirmation(result):
    """Which effects hold on a log that was never searched.

    Parameters
    ----------
    result : dict
        ``confirmation.json``.

    Returns
    -------
    list of str
    """
    lines = ["Nothing is fitted to these logs, so that all of their passes are compared."]
    for e in result["effects"]:
        head = f"{e['effect']} at {e['place']} is {'' if e['confirmed'] else 'not '}confirmed"
        head += "" if e["confirmed"] else f": {e['why']}"
        lines.append(f"{head} (p = {number(e['p_value'])}, {e['units']} passes compared). Error without and with it, "
                     f"nothing fitted: {change_text(e['error_without'], e['error_with'], result['units'])}.")
    replay = result["replay"]
    if replay["after"]:
        lines.append("The same log through the exported FMU, without all effects and with them: "
                     f"{change_text(replay['before'], replay['after'], result['units'])}.")
    else:
        lines.append(f"No FMU was replayed: {replay['why']}")
    return lines


def summary_calibration(result):
    """What was left open of an FMU, its parameters with intervals, and its errors before and after.

    Parameters
    ----------
    result : dict
        ``parameters.json`` of an FMU.

    Returns
    -------
    list of str
    """
    errors = [f"Error of {n} ({kind.replace('_', ' ')} logs): {result['before'][kind][n]:.4g} before, {e:.4g} after."
              for kind, channels in result["after"].items() for n, e in channels.items()]
    return [*result["notes"], *summary_parameters(result), *errors, f"Derivatives: {result['derivatives']}."]


def summary_comparison(result, most=3):
    """Errors, and the groups of samples where they are largest.

    Parameters
    ----------
    result : dict
        ``comparison.json``.
    most : int
        Groups to name for each channel.

    Returns
    -------
    list of str
    """
    lines = [f"Error: {errors_text(result['error'], result['units'])} (RMSE of moving samples, all passes)."]
    if result.get("error_as_given"):
        given = errors_text(result["error_as_given"], result["units"])
        lines.append(f"With the study's own values, nothing fitted: {given}.")
    for channel, whole in result["error"].items():
        spread = []
        for name, groups in result["by"].items():
            values = {label: e[channel] for label, e in groups.items() if e.get(channel) is not None}
            if len(values) > 1:
                worst = max(values, key=values.get)
                spread.append((values[worst] / max(whole, 1e-300), name, worst, values[worst]))
        worst = sorted(spread, reverse=True)[:most]
        if worst:
            lines.append(f"{channel} is worst where " + "; ".join(
                f"{_article(name)}{worded(name)} is {label}{_unit(result['units'].get(name, ''))} "
                f"({number(value)}{_unit(result['units'][channel])})" for _, name, label, value in worst) + ".")
    return lines


def _article(name):
    """The names of columns stand without one."""
    return "" if worded(name) == name else "the "

"""In: a row of `run` with what was hidden and what was said. Out: right, undecided, missed or wrong, and why.

- **right**: every hidden effect is named, first or among its at most three named alternatives, at its place; with
  nothing hidden, *nothing missing*. Where the condition itself is an error of a channel or of the reference, naming
  that error is right too.
- **undecided**: nothing wrong is named, and the verdict is *unexplained* or *not enough excitation* (of a diagnosis
  that found a part, the verdict on what is left).
- **missed**: *nothing missing* although something is hidden.
- **wrong**: an accepted effect is none of the hidden ones, nor has one among its alternatives.
- **failed**: a traceback, the limit of time or memory, or another exit than was due.
"""

from __future__ import annotations

from benchmarks.real_logs import cases
from benchmarks.real_logs import effects as laws
from benchmarks.real_logs.mistakes import MISTAKES

ALTERNATIVES = 3
SEPARABLE = 5.4
"""Twice the log-likelihood on unseen data from which on two effects are told apart."""
VISIBLE = 1.1
"""Size below which a condition's own error of channel or reference need not be named."""


def same(told, true):
    """Whether an effect at a place is the hidden one; a sine of the motor's angle goes by two names.

    What else no log can tell apart must stand among the alternatives.

    Parameters
    ----------
    told, true : (str, str)

    Returns
    -------
    bool
    """
    if told == true:
        return True
    if {told[0], true[0]} == {"torque_ripple", "angle_torque"}:
        return told[1] in true[1]
    return told[0] == true[0] == "torque_ripple" and told[1] in true[1]


def names(row):
    """What may be named in a case: hidden effects, and what names the condition.

    Parameters
    ----------
    row : dict

    Returns
    -------
    hidden, condition : list of (str, str)
    """
    hidden = [tuple(h) for h in row["hidden"]]
    hidden = [h for h in hidden if h[0] not in laws.OUTSIDE]
    about = cases.CONDITIONS.get(row["condition"])  # none of a scenario
    return hidden, list(about.named) if about else [tuple(b) for b in row.get("beside", [])]


def fits(step, wanted):
    """Whether a step names one of the wanted, first or as one of at most three alternatives."""
    told = [tuple(step["added"]), *map(tuple, step["twins"][:ALTERNATIVES])]
    return any(same(t, w) or (w[1] == "*" and t[0] == w[0]) for t in told for w in wanted)


def tied(row, step):
    """Whether the oracle (`row["gaps"]`, where it was asked) cannot tell what a step names first from the truth."""
    value = row.get("gaps", {}).get("@".join(step["added"]))
    return value is not None and value <= SEPARABLE


def wrong_alternatives(row):
    """Alternatives that were named and that the oracle tells from the truth.

    Parameters
    ----------
    row : dict

    Returns
    -------
    list of str
    """
    hidden, condition = names(row)
    told = {"@".join(t) for s in row["steps"] for t in s["twins"]
            if not fits({"added": t, "twins": []}, [*hidden, *condition])}
    return sorted(t for t in told if (row.get("gaps", {}).get(t) or 0) > SEPARABLE)


def score(row):
    """Judge a row.

    Parameters
    ----------
    row : dict

    Returns
    -------
    str
        right, undecided, missed, wrong or failed.
    """
    if row["condition"] == "mistake":
        return _mistake(row)
    if row["failure"]:
        return "failed"
    if row["condition"] == "scenario" and row["what"] == "standstill":
        return "right" if "not_enough_excitation" in (row["verdict"] or row.get("message", "")) else "wrong"
    if row["condition"] == "poor":
        return "wrong" if row["steps"] else "right"
    hidden, condition = names(row)
    steps = row["steps"]
    if row["blocked"]:
        return "blocked"
    if any(not fits(s, [*hidden, *condition]) and not tied(row, s) for s in steps):
        return "wrong"
    outside = [h for h in row["hidden"] if h[0] in laws.OUTSIDE]
    if outside and not steps:
        return "right" if row["verdict"] == "unexplained" else (
            "undecided" if row["verdict"] == "not_enough_excitation" else "missed")
    if row.get("own_size", VISIBLE) < VISIBLE:
        condition = []  # too small to be seen: nothing has to be said of it
    if all(any(fits(s, [h]) or tied(row, s) for s in steps) for h in hidden) and (steps or not condition):
        open_ends = row["final"] in ("unexplained", "not_enough_excitation")
        if steps and open_ends and not condition:
            return "right"  # the hidden ones are found; what is said of the rest is counted by itself
        return "right" if steps or row["verdict"] == "nothing_missing" else _open(row)
    return _open(row)


def _open(row):
    return "undecided" if row["final"] in ("unexplained", "not_enough_excitation") else "missed"


def _mistake(row):
    """Named as such; physics named instead is wrong. Discrete ones must stop the diagnosis."""
    _, kinds, discrete = MISTAKES[row["what"]]
    if row["failure"]:
        return "failed"
    named = any(k in row["findings"] for k in kinds)
    if row["blocked"]:
        return "right" if named else "misnamed"
    channel = {"late_50ms": ("time_delay", "low_pass", "reference_lag"),
               "torque_late_50ms": ("time_delay", "low_pass"),
               "filtered_reference": ("low_pass", "time_delay", "reference_lag"), "clipped": ("torque_saturation",),
               "reference_zero_offset": ("reference_offset", "joint_spring", "torque_offset"),
               "torque_gain": ("torque_constant",)}.get(row["what"], ())
    told = ({s["added"][0], *(t[0] for t in s["twins"][:ALTERNATIVES])} for s in row["steps"])
    if any(not names & set(channel) for names in told):
        return "wrong"
    if discrete:
        return "undecided" if named else "missed"
    return "right" if named or row["steps"] else "missed"

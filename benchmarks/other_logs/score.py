"""In: a row of `run` with what was hidden and what was said. Out: right, undecided, missed, wrong, blocked or failed.

- **right**: every effect that shows is named at its place, first or among at most three alternatives; with nothing to
  see, *nothing missing*. A law outside the catalogue asks for no effect and the verdict *unexplained*.
- **undecided**: nothing wrong is named, and what is left is not said to be nothing.
- **missed**: *nothing missing* is said of what is left, although something shows.
- **wrong**: an accepted effect is none of the hidden ones, nor has one among its alternatives.
- **blocked**: the check of the log stopped before physics was looked for.
- **failed**: an error, or the limit of time or memory.

A rig's own travel that is large enough to be seen may be named as presliding.
"""

from __future__ import annotations

from benchmarks.other_logs.sizes import UNSEEN

SCORES = ("right", "undecided", "missed", "wrong", "blocked", "failed")
ALTERNATIVES = 3
SEEN_TRAVEL = 2e-4
"""Travel of the rig itself that may be named, rad."""
CHANNELS = {"tau": ("torque", "tau", "motor"), "C": ("C", "hip", "knee")}
"""How places begin that stand for all torques of the motors or of the joints."""


def same(told, hidden):
    """Whether an effect at a place is the hidden one, or cannot be told from it.

    Parameters
    ----------
    told, hidden : (str, str)

    Returns
    -------
    bool
    """
    (effect, place), (true, there) = told, hidden
    if true == "x_dead_zone":
        return effect in ("torque_offset", "direction_asymmetry")
    if hidden == ("low_pass", "C") and effect == "reference_lag":
        return True
    return effect == true and (there in ("system", place) or place.startswith(CHANNELS.get(there, ())))


def score(row):
    """Judge a row.

    Parameters
    ----------
    row : dict

    Returns
    -------
    str
        One of `SCORES`.
    """
    if row["failure"]:
        return "failed"
    if row["blocked"]:
        return "blocked"
    hidden = [tuple(h) for h in row["hidden"]]
    found = [_found(step, hidden, row["own_travel"]) for step in row["steps"]]
    if None in found:
        return "wrong"
    visible = [h for h, size in zip(hidden, row["sizes"]) if size > UNSEEN]
    left = [h for h in visible if h not in found]
    if not left:
        return "right" if visible or found or row["verdict"] == "nothing_missing" else "undecided"
    if row["final"] == "nothing_missing":
        return "missed"
    return "right" if outside(left) and row["final"] == "unexplained" else "undecided"


def outside(hidden):
    """Whether the catalogue lacks all of some effects.

    Parameters
    ----------
    hidden : list of (str, str)

    Returns
    -------
    bool
    """
    return all(effect.startswith("x_") for effect, _ in hidden)


def _found(step, hidden, own_travel):
    """What a step names: the hidden effect that it names first, the rig's own presliding, or None."""
    named = [tuple(step["added"]), *map(tuple, step["twins"][:ALTERNATIVES])]
    for told in named:
        for effect in hidden:
            if same(told, effect):
                return effect
    if own_travel >= SEEN_TRAVEL:
        return next((told for told in named if told[0] == "presliding"), None)
    return None

"""A data set and two models in; what the better one changes for a controller, in numbers and words, out.

Two answers. From the log: how far off the torque is that a model works out ahead, which is left to the feedback.
Simulated: how far off the motion is then, with the improved model as the machine and a controller that knows either.
"""

from __future__ import annotations

import numpy as np

from ..control import tracking
from ..core.errors import DataError, ModelicaError, StudyError
from ..diagnosis.compare import unit_of
from ..dynamics.simulate import compensate
from ..fit.nullspace import number
from . import consequence, sentences, values

CHANGED = 0.02  # change of an error, relative, below which an effect is none of a controller's business
STRETCH = 20.0  # s of the log's motion that a simulated controller follows: a few passes, and a second or two of work
EXACT = 1e-3  # of a heat or a torque, relative: an error below it is none
STANDS, MOSTLY = 0.01, 0.5  # of the fastest speed, below which a motor stands; of squared errors, which is most of them


def feedforward(dataset, first, last):
    """What a controller that feeds a model forward leaves to its feedback, and how far off the predicted heat is.

    Each model says which motor torques the motion and the joint torques of the log need; the motors gave others.

    Parameters
    ----------
    dataset : Dataset
        The motion of its logs is what the controller has to follow.
    first, last : (Model, Fit)
        As given, and improved.

    Returns
    -------
    dict of str to dict
        By motor torque: ``unit``, ``rated`` (of `rated`), ``told`` (it is a channel, and compared already), ``error``
        and ``heat`` (relative error of the mean square, to which the heat in a winding is in proportion), each before
        and after, over held-out moving samples where there are any; empty where the rig or the log cannot answer, or
        the effects change nothing of it.
    """
    answers = [_needed(dataset, *m) for m in (first, last)]
    if not all(answers):
        return {}
    held = dataset.moving & (dataset.block >= 0) & dataset.is_test[dataset.block] if dataset.is_test.any() else \
        dataset.moving
    found = {}
    for name in answers[0]:
        given = dataset.measured[name][held]
        if unit_of(dataset, name) != dataset.base.along("N.m"):
            continue  # a voltage: its square is no heat
        error = [float(np.sqrt(np.mean((a[name][held] - given) ** 2))) for a in answers]
        heat = [float(np.mean(a[name][held] ** 2) / np.mean(given ** 2) - 1) for a in answers]
        if np.isfinite([*error, *heat]).all() and abs(error[1] - error[0]) > CHANGED * error[0]:
            found[name] = {"unit": unit_of(dataset, name), "rated": consequence.rated(dataset, name), "error": error,
                           "heat": heat, "told": name in dataset.channels}
    return found


def _needed(dataset, model, fit):
    """Motor torques that a model says the log's motion and joint torques need; None where it cannot say."""
    if dataset.averaged or not model.notes.get("compensate"):
        return None
    asked, _ = model.alternatives("compensate")[0]
    known = {**dataset.measured, **dataset.signals}
    question = model.question("compensate")
    given = {n: known[n] for n in question.inputs if n in known and n != "time"}
    if any(n not in dataset.measured for n in asked):
        return None
    if all(n in dataset.channels for n in asked):
        return values.outputs(dataset, model, fit)
    try:
        parts = [compensate(model, {n: v[dataset.run == k] for n, v in given.items()}, dataset.time[dataset.run == k],
                            {n: fit.parameters[n] for n in model.parameters if n in fit.parameters})
                 for k in np.unique(dataset.run)]
    except (DataError, StudyError):
        return None
    return {n: np.concatenate([p[n] for p in parts]) for n in asked}


def changes(dataset, first, last):
    """What the improved model changes for a controller, in numbers; worked out once a data set.

    Parameters
    ----------
    dataset : Dataset
        The motion of its logs is what the controller has to follow.
    first, last : (Model, Fit)
        As given, and improved.

    Returns
    -------
    dict
        ``feedforward`` (see there); ``closed_loop``: None, or ``from`` and ``to`` [s], ``run``, ``bandwidth`` [Hz],
        ``damping``, ``gains`` by motor, ``tracking_error`` and ``heat`` by angle and drive (see `closed_loop`);
        ``why_not``: why nothing was simulated, or None.
    """
    def make():
        found = {"schema": 1, "feedforward": {}, "closed_loop": None, "why_not": "nothing was added"}
        if first[1] is last[1]:
            return found, first, last
        found["why_not"] = None
        try:
            found["feedforward"] = feedforward(dataset, first, last)
            found["closed_loop"] = closed_loop(dataset, first, last)
        except (DataError, StudyError, ModelicaError) as error:
            found["why_not"] = str(error)
        return found, first, last  # kept, so that no other model is taken for one of them
    return dataset.memo(("changes", id(first[1]), id(last[1])), make)[0]


def closed_loop(dataset, first, last):
    """Tracking error and heat of a controller that knows a model, on the improved model as the machine.

    The controller of each motor is one of angle and speed, with the torque that a model says the motion needs added
    ahead: by the first model, and by the last. The motion is a stretch of the log's own, where the motors travel most.

    Parameters
    ----------
    dataset : Dataset
        The motion of its logs is what the controller has to follow.
    first, last : (Model, Fit)
        As given, and improved.

    Returns
    -------
    dict
        ``run``, ``from``, ``to`` [s]; ``bandwidth`` [Hz], ``damping``, ``gains`` (of angle and speed, by motor);
        ``tracking_error``: by angle, ``unit``, ``rms`` and ``largest``, each before and after, and ``standing``, the
        part of the squares after that lies where all motors are to stand; ``heat``: by drive of a motor that gives a
        torque, ``unit``, ``predicted`` (mean square that each model works out ahead) and ``given`` (what the motors of
        the simulated machine gave), each before and after.

    Raises
    ------
    DataError, StudyError, ModelicaError
        The log has no motion over time, the rig no inverse, or the loop no solution.
    """
    run, begin, time, motion = _stretch(dataset)
    counts = time > tracking.SETTLING
    if not counts.any():
        raise DataError(f"{dataset.logs[run].path}: is shorter than the {tracking.SETTLING:g} s in which a simulated "
                        "loop settles")
    machine = last[0], last[1].parameters
    done = [tracking.track(*machine, model, fit.parameters, time, motion) for model, fit in (first, last)]
    angle, torque = dataset.base.along("rad"), dataset.base.along("N.m")
    speeds = [np.abs(v) for n, v in motion.items() if n.endswith(".w")]
    standing = np.all([s <= STANDS * s.max() for s in speeds], axis=0)[counts]
    error = {n: {"unit": angle, "rms": [_rms(t.error[n][counts]) for t in done],
                 "largest": [float(np.max(np.abs(t.error[n][counts]))) for t in done],
                 "standing": _share(done[1].error[n][counts] ** 2, standing)} for n in done[0].error}
    heat = {n: {"unit": f"{torque}2".replace("N.m2", "N2.m2"),
                "predicted": [_rms(t.ahead[n][counts]) ** 2 for t in done],
                "given": [_rms(t.drive[n][counts]) ** 2 for t in done]}
            for n in done[0].drive if last[0].unit(n) == torque}
    return {"run": dataset.logs[run].name, "from": begin, "to": begin + float(time[-1]),
            "bandwidth": tracking.BANDWIDTH, "damping": tracking.DAMPING, "gains": done[1].gains,
            "tracking_error": error, "heat": heat}


def _rms(values):
    return float(np.sqrt(np.mean(values ** 2)))


def _share(squares, some):
    """Part of a sum that lies at some samples."""
    return float(squares[some].sum() / max(squares.sum(), 1e-300))


def _stretch(dataset):
    """Run, its time at the begin, and the motion of the part of a log where the motors travel most."""
    motors = dataset.base.components("signal")
    if dataset.averaged or not motors:
        raise DataError(f"{dataset.study.path}: its log holds no motion of motors over time that a controller could "
                        "follow")
    speeds = [next((dataset.signals[n] for n in (f"{m}.w", f"der({m}.phi)") if n in dataset.signals), None)
              for m in motors]
    if any(s is None for s in speeds):
        raise DataError(f"{dataset.study.path}: its log holds no speed of every motor that a controller could follow")
    best = (-1.0, 0, slice(0))
    for run in np.unique(dataset.run):
        rows = np.flatnonzero(dataset.run == run)
        time = dataset.time[rows]
        way = np.append(0.0, np.cumsum(np.diff(time) * sum(np.abs(s[rows[1:]]) for s in speeds)))
        ends = np.searchsorted(time, time + STRETCH, "right") - 1
        k = int(np.argmax(way[ends] - way))
        best = max(best, (float(way[ends[k]] - way[k]), int(run), slice(rows[k], rows[ends[k]] + 1)),
                   key=lambda b: b[0])
    _, run, part = best
    given = {m: (float(dataset.signals[f"{m}.phi"][part][0]) if f"{m}.phi" in dataset.signals else 0.0, s[part])
             for m, s in zip(motors, speeds)}
    time, motion = tracking.wanted_motion(dataset.time[part], given)
    return run, float(dataset.time[part][0]), time, motion


# --- in words ---------------------------------------------------------------------------------------------------------


def table(dataset, found):
    """What changes, as rows: what, before, after, change.

    Parameters
    ----------
    dataset : Dataset
        The motion of its logs is what the controller has to follow.
    found : dict
        Of `changes`.

    Returns
    -------
    list of (str, str, str, str)
        Empty where nothing changes for a controller.
    """
    rows, loop = [], found["closed_loop"]
    for angle, e in (loop["tracking_error"] if loop else {}).items():
        if _changed(*e["rms"]):
            rows.append((f"tracking error of {angle}, RMS [m{e['unit']}]", *_numbers(1e3 * v for v in e["rms"])))
    for name, f in found["feedforward"].items():
        if not f["told"]:
            share = f" ({_percents(f['error'], f['rated'][0])} % of {f['rated'][1]})" if f["rated"] else ""
            rows.append((f"{consequence.logged(dataset, name)} left to the feedback, RMS [{f['unit']}]{share}",
                         *_numbers(f["error"])))
    for name, f in found["feedforward"].items():
        rows.append((f"heat that it predicts by {consequence.logged(dataset, name)}", *map(_off, f["heat"]), ""))
    for name, h in (loop["heat"] if rows and loop else {}).items():
        rows.append((f"heat of the simulated motor, mean square of {name} [{h['unit']}]", *_numbers(h["given"])))
    return rows


def _changed(before, after):
    return abs(after - before) > CHANGED * before


def _numbers(pair):
    """Two numbers and their change."""
    before, after = pair
    change = after / before - 1 if before else 0.0
    text = f"{sentences.percent(change, '+')} %".replace("-", "\u2212") if abs(change) >= EXACT else "none"
    return number(before), number(after), text


def _percents(pair, rated):
    return " \u2192 ".join(sentences.percent(v / rated) for v in pair)


def _off(heat):
    """A relative error of a heat in words."""
    if abs(heat) < EXACT:
        return f"right to {100 * EXACT:g} %"
    return f"{sentences.percent(abs(heat))} % too {'high' if heat > 0 else 'low'}"


def told(dataset, found):
    """How the numbers of the table came about, or why there are none.

    Parameters
    ----------
    dataset : Dataset
        The motion of its logs is what the controller has to follow.
    found : dict
        Of `changes`.

    Returns
    -------
    list of str
    """
    loop, lines = found["closed_loop"], []
    errors = [f for f in found["feedforward"].values() if f["told"]]
    if errors:
        lines.append("The error of the torque above is what such a controller leaves to its feedback.")
    if loop is None:
        return [*lines, f"The tracking error was not simulated: {found['why_not'].rstrip('.')}."]
    seconds = f"{loop['to'] - loop['from']:.3g} s of {loop['run']} from {number(loop['from'])} s on"
    how = (f"simulated over {seconds}, with the improved model as the machine and a feedback of "
           f"{loop['bandwidth']:g} Hz; an error goes with the inverse square of that frequency")
    if any(_changed(*e["rms"]) for e in loop["tracking_error"].values()):
        return [*lines, f"Tracking error and its heat are {how}. What the improved model leaves unexplained is not in "
                "that machine.", *_pushed(loop["tracking_error"])]
    worst = {n: e["rms"][1] for n, e in loop["tracking_error"].items()}
    kept = sentences.errors_text({n: 1e3 * v for n, v in worst.items()},
                                 {n: f"m{loop['tracking_error'][n]['unit']}" for n in worst})
    return [*lines, f"A controller's motion stays as it is: tracking error {kept} either way, {how}."]


def _pushed(errors):
    """Why a better model may track worse: a friction that is greatest at rest, given in full, pushes what stands."""
    grown = [n for n, e in errors.items() if e["rms"][1] > (1 + CHANGED) * e["rms"][0] and e["standing"] > MOSTLY]
    if not grown:
        return []
    shares = ", ".join(f"{sentences.percent(errors[n]['standing'])} % of the squared error of {n}" for n in grown)
    return [f"It grows where the motors are to stand ({shares}): most likely a friction that falls as they move, "
            "worked out ahead in full, pushes them on there, and only the feedback holds them. Feed less of it forward "
            "near standstill."]


def summary(found):
    """What changes, in sentences for a terminal.

    Parameters
    ----------
    found : dict
        Of `changes`.

    Returns
    -------
    list of str
        Empty where nothing was simulated, or nothing changes.
    """
    errors = (found["closed_loop"] or {"tracking_error": {}})["tracking_error"]
    units = {n: f"m{e['unit']}" for n, e in errors.items()}
    ends = [{n: 1e3 * e["rms"][k] for n, e in errors.items() if _changed(*e["rms"])} for k in (0, 1)]
    return ["A controller that works its torque out ahead: simulated tracking error "
            f"{sentences.change_text(*ends, units)}.", *_pushed(errors)] if ends[0] else []

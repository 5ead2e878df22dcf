"""In: columns of a sound hip-knee log. Out: the same with one mistake of wiring or units, and what names it."""

from __future__ import annotations

import numpy as np

from benchmarks.real_logs import sensors


def _scaled(*names, by):
    def change(log, rng):
        return {n: x * by if n in names else x for n, x in log.items()}
    return change


def _swapped(*pairs):
    def change(log, rng):
        other = {a: b for a, b in pairs} | {b: a for a, b in pairs}
        return {n: log[other.get(n, n)] if other.get(n, n) in log else x for n, x in log.items()}
    return change


def _shifted(names, seconds=0.0, drift=0.0):
    def change(log, rng):
        t = log["time"]
        return {n: np.interp(t - seconds - drift * t, t, x) if n in names else x for n, x in log.items()}
    return change


def _wrapped(log, rng):
    return {n: np.mod(x, 2 * np.pi) if n in ("theta1", "theta2") else x for n, x in log.items()}


def _counts(log, rng):
    return {n: np.round(x / (2 * np.pi) * 4096) if n in ("theta1", "theta2") else x for n, x in log.items()}


def _clipped(log, rng):
    top = np.quantile(abs(log["tau1"]), 0.75)
    return {n: np.clip(x, -top, top) if n == "tau1" else x for n, x in log.items()}


def _stuck(name):
    def change(log, rng):
        k = int(len(log["time"]) * rng.uniform(0.3, 0.5))
        return {n: np.r_[x[:k], np.full(len(x) - k, x[k])] if n == name else x for n, x in log.items()}
    return change


def _added(by, *names):
    def change(log, rng):
        return {n: x + by if n in names else x for n, x in log.items()}
    return change


def _copied(source, target):
    def change(log, rng):
        return {n: log[source] if n == target else x for n, x in log.items()}
    return change


def _filtered(log, rng):
    dt = log["time"][1] - log["time"][0]
    return {n: sensors.low_passed(x, 2.0, dt) if n in ("C_H", "C_K") else x for n, x in log.items()}


TAU, THETA, OMEGA, C = ("tau1", "tau2"), ("theta1", "theta2"), ("omega1", "omega2"), ("C_H", "C_K")
MISTAKES = {
    "torques_negated": (_scaled(*TAU, by=-1.0), ("sign",), True),
    "one_torque_negated": (_scaled("tau2", by=-1.0), ("sign",), True),
    "references_negated": (_scaled(*C, by=-1.0), ("sign",), True),
    "one_reference_negated": (_scaled("C_K", by=-1.0), ("sign",), True),
    "one_encoder_negated": (_scaled("theta2", "omega2", by=-1.0), ("sign",), True),
    "one_speed_negated": (_scaled("omega1", by=-1.0), ("sign",), True),
    "motors_swapped": (_swapped(("theta1", "theta2"), ("omega1", "omega2"), ("tau1", "tau2")), ("swap",), True),
    "torques_swapped": (_swapped(("tau1", "tau2")), ("swap",), True),
    "references_swapped": (_swapped(("C_H", "C_K")), ("swap",), True),
    "degrees": (_scaled(*THETA, by=180 / np.pi), ("unit", "scale"), True),
    "degrees_all": (_scaled(*THETA, *OMEGA, by=180 / np.pi), ("unit", "scale"), True),
    "rpm": (_scaled(*OMEGA, by=30 / np.pi), ("unit", "scale"), True),
    "encoder_counts": (_counts, ("unit", "scale"), True),
    "milliseconds": (_scaled("time", by=1e3), ("unit", "rate", "scale"), True),
    "millinewtonmetres": (_scaled(*TAU, by=1e3), ("unit", "scale"), True),
    "amperes": (_scaled(*TAU, by=1 / 0.12), ("unit", "scale"), True),
    "reference_millinewtonmetres": (_scaled(*C, by=1e3), ("unit", "scale"), True),
    "wrapped": (_wrapped, ("wrap",), True),
    "stuck_torque": (_stuck("tau2"), ("stuck",), True),
    "stuck_reference": (_stuck("C_H"), ("stuck",), True),
    "copied_column": (_copied("tau1", "tau2"), ("swap", "stuck", "scale"), True),
    "clock": (_shifted((*TAU,), drift=0.003), ("clock",), True),
    "late_50ms": (_shifted((*C,), seconds=0.05), ("shift", "filtered"), False),
    "torque_late_50ms": (_shifted((*TAU,), seconds=0.05), ("shift", "filtered"), False),
    "clipped": (_clipped, ("clipped",), False),
    "filtered_reference": (_filtered, ("filtered", "shift"), False),
    "reference_zero_offset": (_added(1.5, "C_H"), ("zero",), False),
    "torque_gain": (_scaled("tau1", by=1.1), ("scale",), False),
}
"""By name: what is done to the columns, kinds of findings of `check` that name it, and whether the gate must stop."""


def _rows(pick):
    def change(log, rng):
        keep = pick(log)
        found = {n: x[keep] for n, x in log.items()}
        return found | {"time": np.arange(len(found["time"])) * (log["time"][1] - log["time"][0])}
    return change


def _longer(seconds):
    """The last row again and again: the machine stops, its torques keep their noise."""
    def change(log, rng):
        dt = log["time"][1] - log["time"][0]
        tail = rng.integers(0, 100, int(seconds / dt))  # the log begins with rest
        found = {n: np.r_[x, x[tail] - (x[:100].mean() - x[-50:].mean())] for n, x in log.items()}
        return found | {"time": np.arange(len(found["time"])) * dt}
    return change


def _with(name, value):
    def change(log, rng):
        return {**log, name: value(log, rng)}
    return change


def _forward(log):
    return np.flatnonzero(log["omega1"] > -1e-9)


POOR = {
    "one_branch": _rows(_forward),
    "rest_only": _rows(lambda log: np.arange(150)),
    "five_seconds": _rows(lambda log: np.arange(1000)),
    "one_second": _rows(lambda log: np.arange(200)),
    "two_rows": _rows(lambda log: np.arange(2)),
    "stop_at_end": _longer(0.4),
    "long_rest_at_end": _longer(20.0),
    "load_column": _with("load", lambda log, rng: rng.standard_normal(len(log["time"]))),
    "constant_column": _with("temperature", lambda log, rng: np.full(len(log["time"]), 21.0)),
    "no_speeds": lambda log, rng: {n: x for n, x in log.items() if not n.startswith("omega")},
    "no_reference": lambda log, rng: {n: x for n, x in log.items() if not n.startswith("C_")},
    "one_reference": lambda log, rng: {n: x for n, x in log.items() if n != "C_K"},
    "every_tenth": _rows(lambda log: np.arange(0, len(log["time"]), 10)),
    "no_motor2": lambda log, rng: {n: x for n, x in log.items() if n not in ("theta2", "omega2", "tau2")},
    "torques_zero": _scaled("tau1", "tau2", by=0.0),
}
"""Logs too poor for much: no traceback, no wrong name."""


def apply(name, log, seed):
    """A log with a mistake, or a poor one.

    Parameters
    ----------
    name : str
        A key of `MISTAKES` or `POOR`.
    log : dict of str to ndarray
    seed : int

    Returns
    -------
    dict of str to ndarray
    """
    change = POOR[name] if name in POOR else MISTAKES[name][0]
    return change(log, np.random.default_rng([seed, 99]))

"""In: a driven machine, a motion, an effect, a seed. Out: its log under control, integrated forward, study and truth.

    from benchmarks.real_logs.closed_loop import make
    study = make("geared", "pick_and_place", "viscous", 2, folder)

The other machines of this benchmark do a motion that is given, and their torques follow from it. Those of `driven.py`
are driven: a controller turns motors over something elastic against a load, friction sticks over a travel, and the
drive makes its speed of the encoder's steps. Accelerations ring, and motion and torque share the controller's errors.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from benchmarks.real_logs.driven import MACHINES, SAMPLE, STEP
from benchmarks.real_logs.make import GEARED, LINEAR, ROOT, written

MOTIONS = ("pick_and_place", "multi_sine", "passes")
SETTLED, LONG = 2.0, 45.0
"""When the log begins and ends [s]."""
RANGES = {"leg": ((-0.3, 1.2), (-1.4, 0.0)), "axis": ((-0.15, 0.15),)}
"""Of each axis [rad, or m]."""
DIRECTIONS = {1: ((1.0,),), 2: ((0.0, 1.0), (0.75, 0.25), (0.75, -0.25))}
"""Of the passes: of one axis, or of hip and knee on the paper's three lines."""


def cases():
    """Machine, motion and effect of every kind of log, one after another.

    Yields
    ------
    (str, str, str)
    """
    for machine in MACHINES:
        for motion in MOTIONS:
            yield from ((machine, motion, effect) for effect in MACHINES[machine].effects)


def wanted(machine, name, rng):
    """Angles of the axes that the controller is given, at every `STEP`.

    Parameters
    ----------
    machine : str
        One of `MACHINES`.
    name : str
        One of `MOTIONS`.
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (axes, n)
        In rad, or m.
    """
    if machine == "geared":
        return _joint(name, rng)[None]
    ranges = np.array(RANGES[machine])
    middle, reach = ranges.mean(1)[:, None], np.diff(ranges) / 2
    n = round(LONG / STEP)
    if name == "multi_sine":
        time, x = STEP * np.arange(n), []
        for _ in ranges:
            sizes = rng.uniform(0.3, 1.0, 4) * (1, 0.8, 0.6, 0.4)
            waves = zip((0.11, 0.23, 0.37, 0.53), sizes / sizes.sum(), rng.uniform(0, 6.28, 4))
            x.append(sum(a * np.sin(2 * np.pi * f * time + p) for f, a, p in waves))
        return middle + reach * np.array(x)
    return middle + reach * (_passes(machine, n) if name == "passes" else _places(machine, n, rng))


def _joint(name, rng):
    """Angle of the one geared joint, at every `STEP` [rad]; rests between moves are of any length."""
    n = round(LONG / STEP)
    if name == "multi_sine":
        time = STEP * np.arange(n)
        waves = zip((0.11, 0.23, 0.37, 0.53), rng.uniform(0.1, 0.35, 4) * (1, 0.8, 0.6, 0.4), rng.uniform(0, 6.28, 4))
        return 0.3 + sum(a * np.sin(2 * np.pi * f * time + p) for f, a, p in waves)
    pieces, at = [], 0.2
    while sum(map(len, pieces)) < n:
        if name == "passes":
            for speed in (0.2, 0.5, 1.0):
                there, stay = np.linspace(-0.5, 1.1, round(1.6 / speed / STEP)), round(0.4 / STEP)
                pieces += [there, np.full(stay, 1.1), there[::-1], np.full(stay, -0.5)]
        else:
            goal = rng.uniform(-0.8, 1.4)
            s = np.linspace(0, 1, round(max(0.5, abs(goal - at) / rng.uniform(0.5, 1.5)) / STEP))
            pieces += [np.full(round(rng.uniform(0.2, 1.0) / STEP), at),
                       at + (goal - at) * s ** 3 * (10 - 15 * s + 6 * s ** 2)]
            at = goal
    wanted = np.concatenate(pieces)[:n]
    if name == "passes":
        reach = round(0.05 / STEP)
        wanted = np.convolve(np.pad(wanted, reach, mode="edge"), np.full(2 * reach + 1, 1 / (2 * reach + 1)), "valid")
    return wanted


def _places(machine, n, rng):
    """From one place to another, with rests, as shares of the range."""
    pieces, at = [], np.zeros(len(RANGES[machine]))
    usual = MACHINES[machine].speeds[1] / np.max(np.diff(RANGES[machine]) / 2)
    while sum(p.shape[1] for p in pieces) < n:
        goal = rng.uniform(-1, 1, len(at))
        s = np.linspace(0, 1, round(max(0.4, np.max(abs(goal - at)) / (usual * rng.uniform(0.7, 2.5))) / STEP))
        pieces += [np.repeat(at[:, None], round(rng.uniform(0.2, 1.0) / STEP), 1),
                   at[:, None] + (goal - at)[:, None] * s ** 3 * (10 - 15 * s + 6 * s ** 2)]
        at = goal
    return np.concatenate(pieces, 1)[:, :n]


def _passes(machine, n):
    """From the middle to both ends at constant speeds, line by line; corners are rounded over 0.1 s."""
    pieces, stay = [], round(0.4 / STEP)
    reach = np.max(np.diff(RANGES[machine]) / 2)
    while sum(p.shape[1] for p in pieces) < n:
        for line in np.array(DIRECTIONS[len(RANGES[machine])]):
            for speed in MACHINES[machine].speeds:
                half = np.linspace(0, 1, round(reach * abs(line).max() / speed / STEP))
                way = [half, np.full(stay, 1.0), half[::-1]]
                pieces.append(line[:, None] * np.concatenate([*way, *(-x for x in way)]))
    told, half = np.concatenate(pieces, 1)[:, :n], round(0.05 / STEP)
    window = np.full(2 * half + 1, 1 / (2 * half + 1))
    return np.array([np.convolve(np.pad(x, half, mode="edge"), window, "valid") for x in told])


def make(machine, motion, effect, seed, folder):
    """Write the log of a machine under control, its study and what is true of it.

    Parameters
    ----------
    machine : str
        One of `MACHINES`.
    motion : str
        One of `MOTIONS`.
    effect : str
        One of the machine's `effects`; what the machine has `beside` it may be named where it shows.
    seed : int
    folder : Path

    Returns
    -------
    Path
        Of the study.
    """
    about = MACHINES[machine]
    rng = np.random.default_rng([seed, MOTIONS.index(motion), list(about.effects).index(effect)])
    plant, folder = about(rng, effect), Path(folder)
    log, v, place = plant.run(wanted(machine, motion, rng)), plant.hidden, about.effects[effect]
    late, first = round(v.get("d", 0.0) / SAMPLE), round(SETTLED / SAMPLE)
    for name in [n for n in log if n.startswith(("tau", "F"))]:
        on = 1.0 if place in ("motor", "torque", "force") or place == f"motor{name[3:]}" else 0.0
        angle = log["x"] if name == "F" else log[name.replace("tau", "theta")]
        factor = 1 + on * (v.get("g", 1.0) - 1)
        log[name] = factor * log[name] + on * (v.get("o", 0.0) + v.get("A", 0.0) * np.sin(
            v.get("n", 0.0) * angle + v.get("phase", 0.0)))
    n = len(next(iter(log.values())))
    told = {"time": SAMPLE * np.arange(n - first)}
    for name, x in log.items():
        back = late if name.startswith(("tau", "F")) else 0
        told[name] = x[first - back:n - back]
    for name in [n for n in told if n.startswith("theta") or n == "x"]:
        step = 2 * np.pi / about.counts
        told[name] = np.round(told[name] / step) * step
        told[name.replace("theta", "omega").replace("x", "v")] = np.gradient(told[name], SAMPLE)
    for name, (noise, step) in about.noise.items():
        told[name] = told[name] + rng.normal(0, noise, n - first) if noise else told[name]
        told[name] = np.round(told[name] / step) * step if step else told[name]
    folder.mkdir(parents=True, exist_ok=True)
    written(folder / "run1.csv", told)
    text = {"geared_joint": GEARED, "linear_axis": LINEAR}.get(about.study) or (
        ROOT / "examples" / about.study / "study.toml").read_text()
    text = text.replace("runs = []", 'runs = ["run1.csv"]', 1).replace('"unknown"', '"sensor"', 1)
    (folder / "study.toml").write_text(text)
    truth = {"hidden": [[effect, place]] if v else [], "coefficients": [v] if v else [], "beside": about.beside,
             "own_size": 1.0, "travel": plant.travel, "samples": n - first, "f0": plant.f0, "mu": getattr(
                 plant, "mu", 1.0)}
    (folder / "truth.json").write_text(json.dumps(truth))
    return folder / "study.toml"

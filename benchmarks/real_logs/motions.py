"""In: a kind of motion, a rate, a random generator. Out: angles, speeds and accelerations on a time grid, analytic.

Written from the pages that define the machines, without anything of pycosim. A motion of the hip-knee machine is given
either at its motors (passes) or at its joints (gait, pick and place, multi-sine); `machines` maps one to the other.
Units: s, rad, rad/s, rad/s2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

DIRECTIONS = {"A": (1.0, -1.0), "B": (-1.0, 1.0), "C": (1.0, 0.5), "D": (-1.0, -0.5), "E": (0.5, 1.0),
              "F": (-0.5, -1.0)}
"""Speeds of the two motors in the six manoeuvres, the faster one as 1."""
PAIRS = (("A", "B"), ("C", "D"), ("E", "F"))


@dataclass
class Motion:
    """A motion of some axes.

    Parameters
    ----------
    time : ndarray, shape (n,)
        s, evenly spaced from zero.
    x, v, a : ndarray, shape (axes, n)
        Angle, speed, acceleration.
    label : list of str
        What each sample belongs to.
    at : {"motor", "joint"}
        Where the axes are.
    """

    time: np.ndarray
    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    label: list
    at: str = "joint"


def stroke(time, travel, speed, ramp):
    """A move from rest to rest whose speed rises and falls over half cosines.

    Parameters
    ----------
    time : ndarray, shape (n,)
        s since the start of the move; later times rest at its end.
    travel, speed, ramp : float
        Distance (not negative), cruising speed and duration of each ramp; a move too short to cruise is slower.

    Returns
    -------
    x, v, a : ndarray, shape (n,)
    duration : float
    """
    speed = min(speed, travel / ramp)
    cruise = travel / speed - ramp
    t = np.clip(time, 0, 2 * ramp + cruise)
    up, down = t < ramp, t > ramp + cruise
    u = np.where(up, t, np.where(down, 2 * ramp + cruise - t, ramp))
    v = speed / 2 * (1 - np.cos(np.pi * u / ramp))
    slope = speed / 2 * np.pi / ramp * np.sin(np.pi * u / ramp)
    a = np.where(up, slope, np.where(down, -slope, 0.0))
    part = speed / 2 * (u - ramp / np.pi * np.sin(np.pi * u / ramp))
    x = np.where(up, part, np.where(down, travel - part, speed * ramp / 2 + speed * (t - ramp)))
    return x, v, a, 2 * ramp + cruise


def chain(moves, start, rate, at):
    """Moves one after another.

    Parameters
    ----------
    moves : list of (str, sequence of float, float, float, float)
        Label, direction of each axis, travel, speed, ramp. A move of no travel rests for `speed` seconds.
    start : sequence of float
    rate : float
        Hz.
    at : str

    Returns
    -------
    Motion
    """
    here, begin, parts, labels = np.asarray(start, float), 0.0, [], []
    for label, direction, travel, speed, ramp in moves:
        rests = travel <= 0
        duration = speed if rests else stroke(np.zeros(1), travel, speed, ramp)[3]
        first, last = int(np.ceil(begin * rate - 1e-9)), int(np.ceil((begin + duration) * rate - 1e-9))
        t = np.arange(first, last) / rate - begin
        d = np.asarray(direction, float)[:, None]
        x, v, a = (np.zeros((3, len(t))) if rests else np.array(stroke(t, travel, speed, ramp)[:3]))
        parts.append(np.stack([here[:, None] + d * x, d * v, d * a]))
        labels += [label] * len(t)
        here, begin = here + d[:, 0] * max(travel, 0.0), begin + duration
    x, v, a = np.concatenate(parts, axis=2)
    return Motion(np.arange(x.shape[1]) / rate, x, v, a, labels, at)


def passes(rng, rate, speeds=(0.4, 1.0, 2.2), repeats=2, travel=10.0, longest=4.5, dwell=0.4, pairs=PAIRS, ramp=0.35):
    """Out and back along the lines of the six manoeuvres, speeds in random order, with rest between.

    Parameters
    ----------
    rng : numpy.random.Generator
    rate : float
        Hz.
    speeds : sequence of float
        Of the faster motor.
    repeats : int
        How often each line is passed at each speed.
    travel, longest : float
        Of the faster motor, rad; shorter where a pass would take longer than `longest` seconds.
    dwell : float
        Rest after each move, s.
    pairs : sequence of (str, str)
        Lines to pass.
    ramp : float
        Time to reach the speed, s.

    Returns
    -------
    Motion
        At the motors; it starts at zero, `machines` lays it where the joints are to be.
    """
    order = [(s, k) for k in range(repeats) for s in rng.permutation(speeds)]
    moves = [("rest", (0, 0), 0.0, 1.0, 0.0)]
    for speed, _ in order:
        length = min(travel, speed * longest)
        for pair in pairs:
            for name in pair:
                moves += [(name, DIRECTIONS[name], length, speed, ramp), ("rest", (0, 0), 0.0, dwell, 0.0)]
    return chain(moves, (0.0, 0.0), rate, "motor")


def gait(rng, rate, duration=90.0, axes=2, amplitude=0.3, cadences=(0.06, 0.12, 0.2)):
    """Periodic motion with three harmonics, as walking has, at cadences that change smoothly; it rests at both ends.

    Parameters
    ----------
    rng : numpy.random.Generator
    rate, duration : float
    axes : int
    amplitude : float
        Of the first harmonic, rad.
    cadences : sequence of float
        Cycles a second, in random order.

    Returns
    -------
    Motion
    """
    time = np.arange(int(duration * rate)) / rate
    window, dwindow, ddwindow = _window(time, duration, 2.0)
    order = rng.permutation(cadences)
    knots = np.linspace(0, duration, len(order) + 1)
    f, df = np.full(len(time), order[0]), np.zeros(len(time))
    for before, after, knot in zip(order, order[1:], knots[1:]):
        u = np.clip((time - knot) / 2.0 + 0.5, 0, 1)
        f += (after - before) * (1 - np.cos(np.pi * u)) / 2
        df += (after - before) * np.pi / 4.0 * np.sin(np.pi * u)
    phase = 2 * np.pi * np.concatenate([[0], np.cumsum((f[1:] + f[:-1]) / 2)]) / rate
    x = np.zeros((3, axes, len(time)))
    for axis in range(axes):
        for k, size in enumerate((1.0, 0.45, 0.15), 1):
            size, lag = amplitude * size * rng.uniform(0.8, 1.2), rng.uniform(0, 2 * np.pi)
            c, s, w = np.cos(k * phase + lag), np.sin(k * phase + lag), 2 * np.pi * k * f
            x[0, axis] += size * s
            x[1, axis] += size * w * c
            x[2, axis] += size * (2 * np.pi * k * df * c - w * w * s)
    return Motion(time, *_windowed(x, window, dwindow, ddwindow), ["gait"] * len(time))


def multisine(rng, rate, duration=90.0, axes=2, amplitude=0.16, lowest=0.03, highest=0.3, lines=7):
    """Sums of sines of random phases, one set of frequencies an axis; at rest at both ends.

    Parameters
    ----------
    rng : numpy.random.Generator
    rate, duration : float
    axes : int
    amplitude : float
        Of the slowest line, rad; the others fall with their frequency.
    lowest, highest : float
        Hz.
    lines : int

    Returns
    -------
    Motion
    """
    time = np.arange(int(duration * rate)) / rate
    x = np.zeros((3, axes, len(time)))
    for axis in range(axes):
        for f in np.exp(np.linspace(np.log(lowest), np.log(highest), lines) + rng.uniform(-0.1, 0.1, lines)):
            w, lag, size = 2 * np.pi * f, rng.uniform(0, 2 * np.pi), amplitude * (lowest / f) ** 0.6
            x[:, axis] += size * np.array([np.sin(w * time + lag), w * np.cos(w * time + lag),
                                           -w * w * np.sin(w * time + lag)])
    return Motion(time, *_windowed(x, *_window(time, duration, 2.0)), ["multisine"] * len(time))


def pick_and_place(rng, rate, duration=90.0, axes=2, reach=0.4, stations=5, fastest=0.5):
    """Moves of least jerk between a few stations, rests of different lengths between them.

    Parameters
    ----------
    rng : numpy.random.Generator
    rate, duration : float
    axes : int
    reach : float
        Half the range of each axis, rad.
    stations : int
    fastest : float
        Peak speed of the fastest move, rad/s.

    Returns
    -------
    Motion
    """
    time = np.arange(int(duration * rate)) / rate
    places = rng.uniform(-reach, reach, (stations, axes))
    x, labels, here, begin = np.zeros((3, axes, len(time))), ["rest"] * len(time), np.zeros(axes), 1.0
    while True:
        goal = places[rng.integers(stations)]
        far = np.abs(goal - here).max()
        if far < 0.05:
            continue
        length = 1.875 * far / (fastest * rng.choice([0.3, 0.6, 1.0]))
        if begin + length > duration - 1.0:
            break
        u = np.clip((time - begin) / length, 0, 1)
        rise = np.array([u ** 3 * (10 - 15 * u + 6 * u * u), 30 * u * u * (1 - u) ** 2 / length,
                         60 * u * (1 - u) * (1 - 2 * u) / length ** 2])
        x += (goal - here)[None, :, None] * rise[:, None, :]
        for k in np.flatnonzero((u > 0) & (u < 1)):
            labels[k] = "move"
        here, begin = goal, begin + length + rng.uniform(0.2, 1.5)
    return Motion(time, *x, labels)


def _window(time, duration, ramp):
    """A weight that rises from zero, stays one and falls to zero, with two continuous derivatives."""
    u = np.clip(np.minimum(time, duration - time) / ramp, 0, 1)
    sign = np.where(time < duration / 2, 1.0, -1.0)
    return (u ** 3 * (10 - 15 * u + 6 * u * u), sign * 30 * u * u * (1 - u) ** 2 / ramp,
            60 * u * (1 - u) * (1 - 2 * u) / ramp ** 2)


def _windowed(x, w, dw, ddw):
    return x[0] * w, x[1] * w + x[0] * dw, x[2] * w + 2 * x[1] * dw + x[0] * ddw

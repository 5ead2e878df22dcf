"""In: a kind of motion, a quirk of the log, a random generator. Out: angles of hip and knee on a fine time grid."""

from __future__ import annotations

import numpy as np

from benchmarks.other_logs.machine import RATIO, joint_angles, motor_angles

QUIRKS = ("none", "none", "starts_moving", "stops", "spikes", "rests_first", "never_repeats", "small_knee",
          "rests_a_third", "no_plateau", "mixed_rates")
"""What a log may have of its own; the first is drawn twice as often."""
PASSES = np.array([[1.0, -1.0], [1.0, 0.5], [0.5, 1.0]])
"""Travel of the motors in the three kinds of passes, the larger as 1; each goes out and back."""
EASE, FIRST_REST, STOPPING = 1.5, 1.0, 0.5
"""s: to reach full speed, of rest before the motion, and to slow down to a stop or leave it."""


def passes(rng, duration, dt, quirk="none", one_speed=False):
    """Straight moves of the motors out and back, in three directions, at three speeds or one, with rests between.

    Parameters
    ----------
    rng : numpy.random.Generator
    duration, dt : float
        s; the duration is met roughly.
    quirk : str
        One of `QUIRKS`.
    one_speed : bool
        Whether one speed is kept.

    Returns
    -------
    ndarray, shape (n, 2)
    """
    here = motor_angles(np.array([[rng.uniform(0.35, 0.6), rng.uniform(-0.7, -0.3)]]))[0]
    cruise = quirk != "no_plateau" and bool(rng.choice([True, True, False]))
    dwell = 1.5 if quirk == "rests_a_third" else rng.uniform(0.1, 0.6)
    speeds = np.array([1.0, rng.uniform(1.8, 2.5), rng.uniform(3.5, 6)])[rng.permutation(3)]
    speeds = np.ones(1) if one_speed else speeds
    travel = RATIO * rng.uniform(0.35, 0.7) * _amplitude(quirk)
    moves = 2 * len(PASSES)
    moving = max(duration - moves * len(speeds) * dwell, 10)
    slowest = moves * travel * np.sum(1 / speeds) / moving / 0.6
    pieces = []
    for speed in speeds * slowest:
        lasts = travel / speed / (0.75 if cruise else 0.53)
        for k, way in enumerate(PASSES * travel):
            way = way * rng.choice([-1.0, 1.0]) if k == 0 else way
            for start, end in ((here, here + way), (here + way, here)):
                pieces += [_move(start, end, lasts, dt, cruise), _rest(end, dwell, dt)]
    return joint_angles(np.vstack(pieces))


def gait(rng, duration, dt, quirk="none"):
    """Steps whose rate and size change slowly; see `passes`."""
    time = np.arange(int(duration / dt)) * dt
    rate = rng.uniform(0.25, 0.7)
    wander = np.sin(2 * np.pi * 0.07 * time + rng.uniform(0, 6)) * (2 if quirk == "never_repeats" else 1)
    phase = 2 * np.pi * rate * (time + 0.15 / rate * wander)
    hip, knee = rng.uniform(0.2, 0.4), rng.uniform(0.3, 0.5) * _amplitude(quirk)
    hip_phase, knee_phase = rng.uniform(0, 6.3, 2)
    size = 1 + 0.3 * np.sin(2 * np.pi * 0.043 * time + hip_phase)
    return np.column_stack([
        0.35 + hip * size * np.sin(phase) + 0.08 * np.sin(2 * phase + hip_phase),
        -0.7 + knee * size * np.sin(phase + 1.3) + 0.35 * knee * np.sin(2 * phase + knee_phase)])


def sines(rng, duration, dt, quirk="none"):
    """Sums of three to five sines; see `passes`."""
    time, count = np.arange(int(duration / dt)) * dt, rng.integers(3, 6)
    joints = []
    for centre, amplitude in ((0.4, 0.45), (-0.7, 0.55 * _amplitude(quirk))):
        rates = rng.uniform(0.04, 0.45, count)
        sizes = 1.4 * amplitude * rates ** -0.5 / np.sum(rates ** -0.5)
        waves = np.sin(2 * np.pi * rates * time[:, None] + rng.uniform(0, 6.3, count))
        joints.append(centre + (sizes * waves).sum(1))
    return np.column_stack(joints)


def point_to_point(rng, duration, dt, quirk="none"):
    """Moves between random places with rests of random length; see `passes`."""
    here, pieces, spent = np.array([0.4, -0.6]), [], 0.0
    while spent < duration:
        goal = np.array([rng.uniform(-0.1, 0.9), -0.7 + _amplitude(quirk) * rng.uniform(-0.6, 0.6)])
        lasts = max(np.max(abs(goal - here)) / rng.uniform(0.15, 1.2), 0.5)
        pause = rng.exponential(0.5) + (lasts * 0.45 if quirk == "rests_a_third" else 0)
        cruise = quirk != "no_plateau" and rng.random() >= 0.6
        pieces += [_move(here, goal, lasts, dt, cruise), _rest(goal, pause, dt)]
        here, spent = goal, spent + lasts + pause
    return np.vstack(pieces)


KINDS = {"passes": passes, "gait": gait, "point_to_point": point_to_point, "sines": sines}


def motion(kind, rng, duration, dt, quirk="none", one_speed=False):
    """Angles of hip and knee, with what the quirk makes of them.

    Parameters
    ----------
    kind : str
        Of `KINDS`.
    rng : numpy.random.Generator
    duration, dt : float
        s
    quirk : str
        One of `QUIRKS`.
    one_speed : bool
        Of passes only.

    Returns
    -------
    ndarray, shape (n, 2)
    """
    q = passes(rng, duration, dt, quirk, one_speed) if kind == "passes" else KINDS[kind](rng, duration, dt, quirk)
    steady = kind in ("gait", "sines")
    if quirk == "stops":
        q = _stopped(q, dt, len(q) * dt * rng.uniform(0.3, 0.7), rng.uniform(0.5, 4))
    if quirk == "rests_first" or (steady and quirk != "starts_moving"):
        q = _from_rest(q, dt)
    if quirk == "starts_moving":
        q = q[int(rng.uniform(0.5, 3) / dt):]
    if quirk == "rests_a_third" and steady:
        q = _stopped(q, dt, len(q) * dt * 0.4, len(q) * dt * 0.45)
    return q


def _amplitude(quirk):
    return 0.35 if quirk == "small_knee" else 1.0


def _least_jerk(u):
    """From 0 to 1 and from rest to rest, with the least jerk."""
    return u ** 3 * (10 - 15 * u + 6 * u ** 2)


def _smooth(u):
    """From 0 to 1 with flat ends."""
    return u ** 2 * (3 - 2 * u)


def _move(start, end, lasts, dt, cruise):
    """A straight move from rest to rest, with a plateau of speed or without."""
    u = np.linspace(0, 1, max(int(lasts / dt), 8), endpoint=False)
    if cruise:
        way = np.cumsum(_smooth(np.clip(np.minimum(u, 1 - u) / 0.25, 0, 1)))
        way = (way - way[0]) / (way[-1] - way[0])
    else:
        way = _least_jerk(u)
    return start + (end - start) * way[:, None]


def _rest(place, lasts, dt):
    return np.repeat(place[None], max(int(lasts / dt), 2), 0)


def _replayed(q, pace):
    """The motion at another pace, 1 as it was; its end is held."""
    at = np.clip(np.cumsum(pace), 0, len(q) - 1.001)
    before = at.astype(int)
    share = (at - before)[:, None]
    return q[before] * (1 - share) + q[before + 1] * share


def _stopped(q, dt, at, lasts):
    """Slow down at a time, rest, and go on."""
    time = np.arange(len(q) + int((lasts + STOPPING) / dt)) * dt
    outside = abs(time - at - lasts / 2 - STOPPING) - lasts / 2
    return _replayed(q, _smooth(np.clip(outside, 0, STOPPING) / STOPPING))


def _from_rest(q, dt):
    """Rest first, then set out slowly."""
    q = _replayed(q, _least_jerk(np.clip(np.arange(len(q)) * dt / EASE, 0, 1)))
    return np.vstack([np.repeat(q[:1], int(FIRST_REST / dt), 0), q])

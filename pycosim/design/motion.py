"""Strokes in; a smooth motion of the motors at equal times, with its labels and its held-out part, out.

A stroke goes to and fro along a straight line, in one operative zone and the opposite one. Straight ways lead from
stroke to stroke: the reachable angles are convex, so they stay within the stops as the strokes do.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace

import numpy as np

SHORTEST_RAMP = 0.1  # s, so that a log of 100 Hz sees it
PEAK = np.pi / 2  # of the acceleration of a raised cosine, over speed by ramp
REST, TRANSFER = "rest", "transfer"


@dataclass(frozen=True, eq=False)
class Stroke:
    """To and fro along a line.

    Attributes
    ----------
    centre : ndarray, shape (motors,)
        [rad]
    velocity : ndarray, shape (motors,)
        Of the way out, at its constant speed [rad/s].
    travel : float
        Length of the line over the speed [s].
    ramp : float
        Time to speed up and to slow down [s], not above ``travel``.
    cycles : int
        Ways out and back.
    name : str
        The label of the way out is ``name+``, that of the way back ``name-``.
    """

    centre: np.ndarray
    velocity: np.ndarray
    travel: float
    ramp: float
    cycles: int
    name: str

    @property
    def ends(self):
        """Motor angles at both ends [rad], shape (2, motors)."""
        half = self.velocity * self.travel / 2
        return np.array([self.centre - half, self.centre + half])

    @property
    def turned(self):
        """The same stroke from its other end."""
        return replace(self, velocity=-self.velocity)


@dataclass(frozen=True)
class Piece:
    """One straight way, or a rest.

    Attributes
    ----------
    label : str
        Of its samples: ``name+`` and ``name-`` of a stroke, ``transfer`` or ``rest``.
    begin, duration, ramp : float
        [s]
    start : ndarray, shape (motors,)
        [rad]
    velocity : ndarray, shape (motors,)
        Between the ramps [rad/s].
    held_out : bool
        Whether the fit is to leave it out.
    """

    label: str
    begin: float
    duration: float
    start: np.ndarray
    velocity: np.ndarray
    ramp: float
    held_out: bool = False


@dataclass
class Motion:
    """A motion of the motors at equal times from zero on.

    Attributes
    ----------
    time : ndarray, shape (n,)
        [s]
    angle, speed, acceleration : ndarray, shape (motors, n)
        [rad], [rad/s], [rad/s2]
    label : ndarray of str, shape (n,)
        The piece that each sample belongs to.
    held_out : list of (float, float)
        Times from and to [s].
    strokes : list of Stroke
        In the order in which they are made.
    pieces : list of Piece
        All of the time, without gaps.
    """

    time: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    label: np.ndarray
    held_out: list = field(default_factory=list)
    strokes: list = field(default_factory=list)
    pieces: list = field(default_factory=list)

    @property
    def duration(self):
        """Of the whole motion [s]."""
        return float(self.time[-1])


def ordered(strokes, speed, acceleration):
    """Strokes in an order, and each begun at the end, that makes the ways between them short.

    Parameters
    ----------
    strokes : list of Stroke
        In any order.
    speed, acceleration : ndarray, shape (motors,)
        Greatest size on those ways [rad/s], [rad/s2].

    Returns
    -------
    list of Stroke
    """
    def cost(order):
        return sum(sum(transfer_time(b.ends[0] - a.ends[0], speed, acceleration)) for a, b in zip(order, order[1:]))

    best = min((_greedy(strokes, k) for k in range(len(strokes))), key=cost)
    while True:  # a stretch turned round, while that is shorter
        turned = [best[:i] + best[i:j][::-1] + best[j:] for i in range(len(best)) for j in range(i + 2, len(best) + 1)]
        turned += [[*best[:i], best[i].turned, *best[i + 1:]] for i in range(len(best))]
        found = min(turned, key=cost, default=best)
        if cost(found) > cost(best) - 1e-9:
            return best
        best = found


def _greedy(strokes, first):
    """The nearest stroke next, by whichever of its ends is nearer."""
    rest, found = [s for k, s in enumerate(strokes) if k != first], [strokes[first]]
    while rest:
        at = found[-1].ends[0]
        both = [(s, t) for s in rest for t in (s, s.turned)]
        nearest, way = min(both, key=lambda pair: np.abs(pair[1].ends[0] - at).max())
        rest.remove(nearest)
        found.append(way)
    return found


def transfer_time(way, speed, acceleration):
    """Time and ramp of a straight way at the limits.

    Parameters
    ----------
    way : ndarray, shape (motors,)
        [rad]
    speed, acceleration : ndarray, shape (motors,)
        Greatest size [rad/s], [rad/s2].

    Returns
    -------
    travel, ramp : float
        As those of a `Stroke` [s]; zero for no way.
    """
    size = np.abs(way)
    if size.max() < 1e-9:
        return 0.0, 0.0
    travel = max((size / speed).max(), np.sqrt(PEAK * size / acceleration).max(), SHORTEST_RAMP)
    return float(travel), float(max((PEAK * size / acceleration).max() / travel, SHORTEST_RAMP))


def assemble(strokes, speed, acceleration, dwell, rate):
    """One motion of all strokes.

    Parameters
    ----------
    strokes : list of Stroke
        In their order.
    speed, acceleration : ndarray, shape (motors,)
        Greatest size on the ways between strokes [rad/s], [rad/s2].
    dwell : float
        Rest at each end [s].
    rate : float
        Samples a second.

    Returns
    -------
    Motion
        The last cycle of each stroke is held out.
    """
    pieces, now = [], 0.0
    at = strokes[0].ends[0]

    def add(label, duration, velocity, ramp, held_out=False):
        nonlocal now, at
        pieces.append(Piece(label, now, duration, at, velocity, ramp, held_out))
        now, at = now + duration, at + velocity * (duration - ramp)

    def rest(held_out=False):
        pieces.append(Piece(REST, now, dwell, at, np.zeros(len(at)), SHORTEST_RAMP, held_out))
        return now + dwell

    now = rest()
    for stroke in strokes:
        travel, ramp = transfer_time(stroke.ends[0] - at, speed, acceleration)
        if travel:
            add(TRANSFER, travel + ramp, (stroke.ends[0] - at) / travel, ramp)
            now = rest()
        for cycle, sign in itertools.product(range(stroke.cycles), (1, -1)):
            last = cycle == stroke.cycles - 1
            add(f"{stroke.name}{'+' if sign > 0 else '-'}", stroke.travel + stroke.ramp, sign * stroke.velocity,
                stroke.ramp, last)
            now = rest(last)
    return _sampled(pieces, now, rate, strokes)


def _sampled(pieces, end, rate, strokes):
    time = np.arange(int(np.floor(end * rate + 1e-9)) + 1) / rate
    begin = np.array([p.begin for p in pieces])
    index = np.clip(np.searchsorted(begin, time + 1e-9, side="right") - 1, 0, len(pieces) - 1)
    duration, ramp = (np.array([getattr(p, n) for p in pieces])[index] for n in ("duration", "ramp"))
    start, velocity = (np.array([getattr(p, n) for p in pieces])[index].T for n in ("start", "velocity"))
    done, share, rate_of = profile(np.clip(time - begin[index], 0, duration), duration, ramp)
    label = np.array([p.label for p in pieces])[index]
    held = []
    for p in (p for p in pieces if p.held_out):
        if held and abs(held[-1][1] - p.begin) < 1e-6:
            held[-1] = (held[-1][0], p.begin + p.duration)
        else:
            held.append((p.begin, p.begin + p.duration))
    held = [(a, min(b, float(time[-1]))) for a, b in held]
    return Motion(time, start + velocity * done, velocity * share, velocity * rate_of, label, held, list(strokes),
                  pieces)


def profile(t, duration, ramp):
    """Travel, speed and acceleration of a way at unit speed: a raised cosine up, constant, the same down.

    Parameters
    ----------
    t, duration, ramp : ndarray, shape (n,)
        [s]

    Returns
    -------
    travel, speed, acceleration : ndarray, shape (n,)
        [s], [1], [1/s]
    """
    up, down = np.minimum(t, ramp), np.minimum(duration - t, ramp)
    a, b = np.pi * up / ramp, np.pi * down / ramp
    travel = (up - ramp / np.pi * np.sin(a)) / 2 + np.clip(t - ramp, 0, duration - 2 * ramp) + (
        ramp - down + ramp / np.pi * np.sin(b)) / 2
    speed = (1 - np.cos(a)) / 2 - (1 + np.cos(b)) / 2
    return travel, np.where(np.abs(speed) < 1e-12, 0.0, speed), np.pi / (2 * ramp) * (np.sin(a) - np.sin(b))

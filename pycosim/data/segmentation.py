"""Times, speeds and configurations of runs come in; moving samples, passes, blocks, folds and crossing pairs go out.

Nothing here trusts a label. Several runs are handled at once: their arrays are concatenated, and ``run`` (n,) numbers
them; time needs to increase within a run only.

    moving samples -> passes (one way along a line) -> blocks (out and back, or stretches) -> test part, folds
                                                    -> pairs (out and back through one configuration)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ..core.errors import DataError

SLOW = 0.03
"""Share of a segment's typical speed below which it is not moving: there, samples tell of the reversal alone."""
SLOWEST = 0.01  # the same where those samples count: see `turns.compared`
_RANGE = 1000.0  # between the speed of most of the way and the slowest that is no rest
_GAP = 10.0  # sample intervals without a sample that break a pass
_FLICKER = 0.05  # s below w_min that do not break a pass: noise at its slow ends
_PLATEAU = 0.25  # s of constant speed that make a commanded level
_LEVEL = 0.15  # relative difference of two commanded levels
_SHORTEST = 5  # samples of a pass that can be one half of a block
_SHORT = 0.25  # of the tolerance: a movement over a shorter distance does not count as a pass
_OPPOSITE = -0.9  # cosine between the directions of out and back
_MOSTLY = 0.5  # share of the motion that goes out and back in a run that is cut by that
_WHOLLY, _ENOUGH = 0.9, 8  # that share, and the blocks below which it is asked for: five folds and a test part
_STRETCHES = 20  # blocks of any other run: five folds of some, and a test part
_RARE, _LONELY = 0.25, 0.05
"""Of a block's samples in a combination of directions, below which the others hold next to none of it; and of all its
samples, from which it moves as the others do not."""


# --- moving ---------------------------------------------------------------------------------------------------------


def _stretches(key):
    """First and one-past-last index of stretches of equal key, shape (k, 2)."""
    key = np.asarray(key)
    if key.size == 0:
        return np.empty((0, 2), dtype=int)
    edges = np.flatnonzero(key[1:] != key[:-1]) + 1
    return np.column_stack([np.append(0, edges), np.append(edges, key.size)])


def _smooth(values, width):
    """Centred moving average along the last axis, windows cut at the ends."""
    n = values.shape[-1]
    total = np.concatenate([np.zeros((*values.shape[:-1], 1)), np.cumsum(values, axis=-1)], axis=-1)
    low, high = np.maximum(np.arange(n) - width // 2, 0), np.minimum(np.arange(n) + width // 2 + 1, n)
    return (total[..., high] - total[..., low]) / (high - low)


def typical(speeds):
    """Mean speed while something moves; creeping passes beside fast ones count by the time that they take.

    Parameters
    ----------
    speeds : ndarray, shape (m, n)
        [rad/s, or m/s of what slides]

    Returns
    -------
    ndarray, shape (m,)
        In the same units.
    """
    size = np.abs(np.atleast_2d(np.nan_to_num(speeds)))
    fast = (size**2).mean(axis=1) / np.maximum(size.mean(axis=1), 1e-300)  # the mean along the way: rest adds nothing
    moved = size > fast[:, None] / _RANGE
    return (size * moved).sum(axis=1) / np.maximum(moved.sum(axis=1), 1)


def standstill(speeds):
    """Samples at rest: the longest stretches in which every speed averages to nearly nothing.

    Parameters
    ----------
    speeds : ndarray, shape (m, n)
        Speeds of all segments [rad/s].

    Returns
    -------
    ndarray of bool, shape (n,)
        The inner part of each stretch; all False where nothing rests.
    """
    speeds = np.atleast_2d(np.asarray(speeds, dtype=float))
    little = SLOW * typical(speeds)[:, None]
    # an average tells slow travel from noise about zero, which the size of single speeds cannot; the longer the surer
    for width in (51, 25, 11, 5):
        quiet = np.all(np.abs(_smooth(speeds, width)) <= little, axis=0)
        found = [(a, b) for a, b in _stretches(quiet) if quiet[a] and b - a >= 2 * width]
        if sum(b - a for a, b in found) > 0.01 * quiet.size:
            break
    rest = np.zeros(speeds.shape[1], dtype=bool)
    longest = max((b - a for a, b in found), default=0)
    for a, b in found:
        trim = max((b - a) // 10, width // 2)  # ramps reach into a smoothed stretch
        if b - a >= longest / 2:
            rest[a + trim:b - trim] = True
    return rest


def default_w_min(speeds, rest_mask=None, noise=0.0, share=SLOW):
    """Speed above which a segment is moving: a share of its typical speed, or 5 standard deviations of noise if more.

    Parameters
    ----------
    speeds : ndarray, shape (m, n)
        [rad/s, or m/s of what slides]
    rest_mask : ndarray of bool, shape (n,), optional
        Samples at rest; found from the speeds by `standstill` if not given. Labels do not belong here.
    noise : float or ndarray, shape (m,)
        Standard deviation that the speeds are known to have, where nothing rests or the speeds are derived.
    share : float
        Of the typical speed.

    Returns
    -------
    ndarray, shape (m,)
        In the units of the speeds. Twice as fast a motion, or the same one in other units, gives as much more.
    """
    speeds = np.atleast_2d(np.asarray(speeds, dtype=float))
    rest = standstill(speeds) if rest_mask is None else np.asarray(rest_mask, dtype=bool)
    # about each stretch's own mean: creep is not noise
    parts = [speeds[:, a:b] - speeds[:, a:b].mean(axis=1, keepdims=True)
             for a, b in _stretches(rest) if rest[a] and b - a > 1]
    sigma = np.concatenate(parts, axis=1).std(axis=1) if parts else _scatter(speeds)
    return np.maximum(share * typical(speeds), 5.0 * np.maximum(sigma, noise))


def _scatter(speeds):
    """Standard deviation of what changes from sample to sample."""
    if speeds.shape[1] < 8:
        return np.zeros(len(speeds))
    return 1.4826 * np.median(np.abs(np.diff(speeds, 3, axis=1)), axis=1) / np.sqrt(20.0)


def moving(speeds, w_min, run=None):
    """Samples in which every segment is faster than ``w_min``.

    Parameters
    ----------
    speeds : ndarray, shape (m, n)
        [rad/s, or m/s of what slides]
    w_min : float or ndarray, shape (m,)
        In the same units.
    run : ndarray of int, shape (n,), optional
        Number of the log that each sample belongs to; all of one by default.

    Returns
    -------
    ndarray of bool, shape (n,)
        False also on both sides of a reversal that fell between two samples: torque and speed are never of quite the
        same instant, and there that decides about the sign of the friction.
    """
    speeds = np.atleast_2d(speeds)
    fast = np.abs(speeds) > np.reshape(w_min, (-1, 1))
    found = np.all(fast, axis=0)
    turned = np.any(fast[:, 1:] & fast[:, :-1] & (np.diff(np.sign(speeds), axis=1) != 0), axis=0)
    turned &= True if run is None else np.diff(run) == 0
    found[1:] &= ~turned
    found[:-1] &= ~turned
    return found


# --- passes ---------------------------------------------------------------------------------------------------------


def _interval(time, run):
    """Median sample interval within runs [s]."""
    step = np.diff(time)[run[1:] == run[:-1]]
    return float(np.median(step)) if step.size else 1.0


def passes(time, speeds, moving, run=None):
    """Number the passes: stretches of motion one way, at one commanded speed, ramps included.

    Parameters
    ----------
    time : ndarray, shape (n,)
        [s]
    speeds : ndarray, shape (m, n)
        [rad/s]
    moving : ndarray of bool, shape (n,)
        As of `moving`.
    run : ndarray of int, shape (n,), optional
        Number of the log that each sample belongs to; all of one by default.

    Returns
    -------
    ndarray of int, shape (n,)
        In order of time; -1 where not moving. Standstill, a change of any segment's sign, a gap in time, another run
        and another constant speed begin a new pass; noise and ramps do not.
    """
    time, speeds, moving = np.asarray(time), np.atleast_2d(speeds), np.asarray(moving, dtype=bool)
    run = np.zeros(time.size, dtype=int) if run is None else np.asarray(run)
    found = np.full(time.size, -1)
    index = np.flatnonzero(moving)
    if index.size == 0:
        return found
    step = _interval(time, run)
    pause = np.diff(time[index])
    lost = np.diff(index) == 1  # neighbours in the log, so a long interval between them is a gap in it
    new = np.any(np.diff(np.sign(speeds[:, index]), axis=1) != 0, axis=0) | (np.diff(run[index]) != 0)
    new |= np.where(lost, pause > _GAP * step, pause > max(_FLICKER, 2.5 * step))
    stretch = np.append(0, np.cumsum(new))
    level = np.abs(speeds[:, index]).max(axis=0)
    for a, b in _stretches(stretch):
        for cut in _level_changes(level[a:b], step):
            new[a + cut - 1] = True
    found[index] = np.append(0, np.cumsum(new))
    return found


def _level_changes(level, step):
    """Indices at which a speed goes from one plateau to another; none for ramps, noise and continuous variation."""
    least = max(int(round(_PLATEAU / step)), 8)
    if level.size < 3 * least:
        return []
    reach = max(least // 2, 2)
    smooth = np.log(_smooth(level, reach | 1))
    change = np.full(level.size, np.inf)
    change[reach:-reach] = np.abs(smooth[2 * reach:] - smooth[:-2 * reach])
    flat = change < _LEVEL / 5
    plateaus = [(a, b, float(np.median(smooth[a:b]))) for a, b in _stretches(flat) if flat[a] and b - a >= least]
    cuts = []
    for (start, end, before), (begin, stop, after) in zip(plateaus, plateaus[1:]):
        # a commanded step is short against the levels it joins; the flat tops of slow variation are not levels
        if abs(after - before) > _LEVEL and begin - end < min(end - start, stop - begin):
            between = smooth[end - 1:begin + 1]
            cuts.append(end - 1 + int(np.argmin(np.abs(between - (before + after) / 2))))
    return cuts


@dataclass(frozen=True)
class _Pass:
    """One pass as a straight line."""

    first: int
    last: int
    count: int
    run: int
    begin: np.ndarray
    end: np.ndarray

    @property
    def length(self):
        return float(np.linalg.norm(self.end - self.begin))

    @property
    def direction(self):
        return (self.end - self.begin) / max(self.length, 1e-300)

    @property
    def middle(self):
        return (self.begin + self.end) / 2


def _summaries(config, pass_id, run):
    found = {}
    inside = np.flatnonzero(pass_id >= 0)
    order = inside[np.argsort(pass_id[inside], kind="stable")]
    for a, b in _stretches(pass_id[order]):
        k = order[a:b]
        found[int(pass_id[k[0]])] = _Pass(k[0], k[-1], k.size, int(run[k[0]]), config[:, k[0]], config[:, k[-1]])
    return found


def _extent(config):
    """Size of the travelled region [rad]."""
    return float(np.linalg.norm(np.ptp(config, axis=1))) if config.shape[1] else 0.0


def _opposite(a, b, tolerance):
    """Whether two passes go opposite ways over the same stretch of a line."""
    if a.length == 0 or b.length == 0 or a.direction @ b.direction > _OPPOSITE:
        return False
    along = sorted([float((b.begin - a.begin) @ a.direction), float((b.end - a.begin) @ a.direction)])
    overlap = min(along[1], a.length) - max(along[0], 0.0)
    away = b.middle - a.begin
    away = away - (away @ a.direction) * a.direction
    # a line that is a few degrees off leaves the other one over its length
    return overlap > 0.5 * min(a.length, b.length) and np.linalg.norm(away) < tolerance + 0.05 * min(a.length, b.length)


# --- blocks ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Blocks:
    """Stretches of runs that are fitted or held out as a whole: out and back over one line, with the reversal.

    Of a run that does not mostly go out and back, stretches of about equal motion, from one reversal or rest to
    another; no two of them repeat each other.

    Attributes
    ----------
    index : ndarray of int, shape (n,)
        Block of each sample; -1 for samples of blocks that `take` left out.
    run, line, repeat : ndarray of int, shape (b,)
        Run; line in configuration space; how many blocks of this line and speed came before.
    speed : ndarray, shape (b,)
        Commanded speed [rad/s]: largest |w|, its median over the block, equal for blocks within about 10 %; 0 without
        motion.
    t0, t1 : ndarray, shape (b,)
        First and last time [s].
    straight : bool
        Whether every run mostly goes out and back.
    """

    index: np.ndarray
    run: np.ndarray
    line: np.ndarray
    speed: np.ndarray
    repeat: np.ndarray
    t0: np.ndarray
    t1: np.ndarray
    straight: bool = True

    def __len__(self):
        return len(self.run)

    def samples(self, mask):
        """Samples of some blocks.

        Parameters
        ----------
        mask : ndarray of bool, shape (b,)
            True for the blocks that are wanted.

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        return np.append(np.asarray(mask, dtype=bool), False)[self.index]

    def take(self, mask):
        """Only some blocks; their samples are numbered anew.

        Parameters
        ----------
        mask : ndarray of bool, shape (b,)
            True for the blocks that are wanted.

        Returns
        -------
        Blocks
        """
        mask = np.asarray(mask, dtype=bool)
        number = np.append(np.where(mask, np.cumsum(mask) - 1, -1), -1)
        parts = {k: getattr(self, k)[mask] for k in ("run", "line", "speed", "repeat", "t0", "t1")}
        return replace(self, index=number[self.index], **parts)


def blocks(time, config, pass_id, speeds, run=None, tolerance=None, paired=False):
    """Cut runs into out-and-back blocks, or into stretches where most of the motion is another.

    Parameters
    ----------
    time : ndarray, shape (n,)
        [s]
    config : ndarray, shape (d, n)
        Independent angles [rad].
    pass_id : ndarray of int, shape (n,)
        From `passes`.
    speeds : ndarray, shape (m, n)
        Speeds of all segments [rad/s].
    run : ndarray of int, shape (n,), optional
        Number of the log that each sample belongs to; all of one by default.
    tolerance : float, optional
        Distance [rad] within which two lines are one; default 2 % of the travelled region.
    paired : bool
        Whether a way back is compared with its way out, which `pairs` looks for in the same block.

    Returns
    -------
    Blocks
        In order of time; every sample is in exactly one. Passes without a way back belong to the nearest block. A run
        of which less than half goes out and back is cut into some twenty stretches at reversals and rests, never
        inside a pass; a run of one pass is one block. Where that leaves too few to select on, so is a run of which
        some goes another way, if that makes more of them, and no pairs are parted.
    """
    time, config, pass_id = np.asarray(time), np.atleast_2d(config), np.asarray(pass_id)
    run = np.zeros(time.size, dtype=int) if run is None else np.asarray(run)
    tolerance = 0.02 * _extent(config) if tolerance is None else tolerance
    known = list(_summaries(config, pass_id, run).values())

    def cut(mostly):
        index, members, heads, free = np.empty(time.size, dtype=int), [], [], []
        for a, b in _stretches(run):
            mine = [p for p in known if a <= p.first < b]
            found = _couples(mine, tolerance)
            ends = _ends(mine, time, np.atleast_2d(speeds))
            straight = len(mine) < 2 or _out_and_back(mine, found, ends) >= mostly
            if not straight:
                found = _groups(mine, ends)
            cuts = [_cut(mine, p[-1], q[0], time) for p, q in zip(found, found[1:])]
            index[a:b] = len(members) + np.searchsorted(cuts, time[a:b], side="right")
            found = found or [[max(mine, key=lambda p: p.length)] if mine else []]
            members += found
            heads += [group[0] if straight and group else None for group in found]
            free += [not straight] * len(found)
        return index, members, heads, free

    found = cut(_MOSTLY)
    if not paired and len(found[1]) < _ENOUGH:
        found = max(found, cut(_WHOLLY), key=lambda cut: len(cut[1]))
    index, members, heads, free = found
    bounds = _stretches(index)
    speed = _speed_keys(np.array([_level(speeds, pass_id, group) for group in members]))
    line, free = _line_keys(heads, tolerance), np.array(free, dtype=bool)
    line[free] = line.max() + 1 + np.arange(free.sum())  # each its own: ordinary motion repeats nothing exactly
    first, last = bounds[:, 0], bounds[:, 1] - 1
    return Blocks(index, run[first], line, speed, _repeats(line, speed), time[first], time[last], not free.any())


def _couples(mine, tolerance):
    """Pairs of neighbours that are out and back; first come, first served."""
    able = [p for p in mine if p.count >= _SHORTEST and p.length > tolerance * _SHORT]
    found, k = [], 0
    while k < len(able) - 1:
        both = _opposite(able[k], able[k + 1], tolerance) and _alike(able[k].length, able[k + 1].length, tolerance)
        if both:
            found.append([able[k], able[k + 1]])
        k += 2 if both else 1
    return found


def _ends(mine, time, speeds):
    """Numbers of the passes that end in a reversal or a rest, not in another level of the speed."""
    return np.array([k for k, (p, q) in enumerate(zip(mine, mine[1:])) if time[q.first] - time[p.last] > _FLICKER
                     or not np.array_equal(np.sign(speeds[:, p.last]), np.sign(speeds[:, q.first]))], dtype=int)


def _out_and_back(mine, couples, ends):
    """Share of the motion on ways of which some part goes out and back."""
    count = np.array([p.count for p in mine])
    way = np.searchsorted(ends, np.arange(len(mine)))
    there = {id(p) for couple in couples for p in couple}
    ways = np.unique(way[[id(p) in there for p in mine]])
    return count[np.isin(way, ways)].sum() / count.sum()


def _groups(mine, able):
    """Passes in order, in groups of about equal motion that end where one can."""
    done = np.cumsum([p.count for p in mine])
    wanted = done[-1] * np.arange(1, _STRETCHES) / _STRETCHES
    ends = sorted({int(able[np.argmin(np.abs(done[able] - w))]) for w in wanted}) if able.size else []
    edges = [0, *(k + 1 for k in ends), len(mine)]
    groups = [mine[a:b] for a, b in zip(edges, edges[1:])]
    return [g for g in groups if sum(p.count for p in g) >= _SHORTEST] or [mine]


def _alike(a, b, tolerance):
    """Whether two lengths belong together: short ways must be equal, a long one may have lost an end."""
    return min(a, b) > tolerance or max(a, b) < 1.5 * min(a, b)


def _cut(mine, last, first, time):
    """Time between two blocks: in the longest pause, so that passes between them stay with the nearer one."""
    row = [p for p in mine if last.first <= p.first <= first.first]
    _, p, q = max(((time[q.first] - time[p.last], p, q) for p, q in zip(row, row[1:])), key=lambda pause: pause[0])
    return (time[p.last] + time[q.first]) / 2


def _level(speeds, pass_id, couple):
    """Median of the largest |w| in the passes of a block [rad/s]."""
    speeds = np.abs(np.atleast_2d(speeds)).max(axis=0)
    parts = [speeds[p.first:p.last + 1][pass_id[p.first:p.last + 1] >= 0] for p in couple]
    return float(np.median(np.concatenate(parts))) if parts else 0.0


def _line_keys(heads, tolerance):
    """Number lines by direction and offset, in order of appearance; a block without motion has a line of its own."""
    lines, keys = [], []
    for head in heads:
        if head is None or head.length == 0:
            keys.append(-1)
            continue
        for key, line in enumerate(lines):
            away = head.middle - line.middle
            away = away - (away @ line.direction) * line.direction
            if abs(head.direction @ line.direction) > 0.998 and np.linalg.norm(away) < tolerance:
                keys.append(key)
                break
        else:
            keys.append(len(lines))
            lines.append(head)
    return np.array(keys, dtype=int)


def _speed_keys(level):
    """Replace speeds within about 10 % of each other by their common median."""
    key = np.zeros(level.size)
    order = [k for k in np.argsort(level, kind="stable") if level[k] > 0]
    while order:
        # bins start at a measured speed, not on a fixed grid, whose edges could cut one commanded speed in two
        group = [k for k in order if level[k] <= 1.1 * level[order[0]]]
        key[group] = np.median(level[group])
        order = order[len(group):]
    return key


def _repeats(line, speed):
    seen, found = {}, []
    for pair in zip(line.tolist(), speed.tolist()):
        found.append(seen.get(pair, 0))
        seen[pair] = found[-1] + 1
    return np.array(found, dtype=int)


# --- test part and folds --------------------------------------------------------------------------------------------


def directions(speeds):
    """A number for each combination of directions.

    Parameters
    ----------
    speeds : ndarray, shape (segments, n)
        Of all samples, in any unit.

    Returns
    -------
    ndarray of int, shape (n,)
        Below two to the power of the segments.
    """
    return (speeds > 0).T @ (1 << np.arange(len(speeds)))


def ways(blocks, speeds, moving):
    """How many samples of each block move in each combination of directions.

    Parameters
    ----------
    blocks : Blocks
        Of all runs.
    speeds : ndarray, shape (segments, n)
        Of all samples [rad/s], on a linear axis [m/s].
    moving : ndarray of bool, shape (n,)
        Those that count.

    Returns
    -------
    ndarray of int, shape (b, combinations)
    """
    inside = moving & (blocks.index >= 0)
    _, way = np.unique(directions(speeds[:, inside]), return_inverse=True)
    found = np.zeros((len(blocks), way.max(initial=-1) + 1), dtype=int)
    np.add.at(found, (blocks.index[inside], way), 1)
    return found


def _alone(ways, k, others):
    """Share of a block's samples that move as next to none of the other blocks do."""
    rest = ways[others].sum(0)
    return ways[k][rest < _RARE * ways[k]].sum() / max(ways[k].sum(), 1)


def split(blocks, n_runs, held_out_runs=(), ways=None):
    """Choose the test part, before any fit.

    Parameters
    ----------
    blocks : Blocks
        Of all runs.
    n_runs : int
        Logs, also those without a block.
    held_out_runs : sequence of int
        Runs that the study holds out.
    ways : ndarray of int, shape (b, combinations), optional
        How many samples of each block move in each combination of directions; alike by default.

    Returns
    -------
    ndarray of bool, shape (b,)
        The held-out runs, else every fourth run. Fewer than four runs: the last repeat of each (line, speed), else
        every fourth block, or the last of fewer; of one alone, nothing. A run that was planned to follow another is
        thus fitted, and not held out as a whole. A block that moves as no other does is fitted instead of its
        neighbour: of its frictions the others would tell nothing.

    Raises
    ------
    DataError
        Every run is held out.
    """
    if len(held_out_runs):
        if set(range(n_runs)) <= set(held_out_runs):
            raise DataError("every run is held out, so nothing is left to fit; leave at least one in [data] runs")
        return np.isin(blocks.run, list(held_out_runs))
    if n_runs > 3:
        return np.isin(blocks.run, np.arange(3, n_runs, 4))
    keys = list(zip(blocks.line.tolist(), blocks.speed.tolist()))
    last = {key: k for k, key in enumerate(keys)}
    test = np.array([last[key] == k for k, key in enumerate(keys)], dtype=bool) & (blocks.repeat > 0)
    if not test.any() and len(test) > 1:
        ways = np.ones((len(test), 1)) if ways is None else ways
        for group in np.split(np.arange(len(test)), np.arange(4, len(test), 4)):
            if len(group) < min(4, len(test)):
                continue
            alike = [k for k in group if _alone(ways, k, ~test & (np.arange(len(test)) != k)) < _LONELY]
            test[max(alike, default=group[-1])] = True
    return test


def folds(blocks_fit, k=5):
    """Deal fit blocks to folds so that each holds its share of every line and speed.

    Parameters
    ----------
    blocks_fit : Blocks
        The blocks that are not in the test part.
    k : int
        Number of folds; the number of blocks if that is smaller.

    Returns
    -------
    ndarray of int, shape (b,)
    """
    order = np.lexsort((blocks_fit.repeat, blocks_fit.speed, blocks_fit.line))
    found = np.empty(len(blocks_fit), dtype=int)
    # dealt in order of (line, speed): equal ones go to different folds, and no fold is two larger than another
    found[order] = np.arange(len(blocks_fit)) % max(1, min(k, len(blocks_fit)))
    return found


# --- pairs ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Pairs:
    """Crossings of one configuration, out and back.

    Attributes
    ----------
    i : ndarray of int, shape (p,)
        Samples of the earlier pass.
    j0, j1 : ndarray of int, shape (p,)
        Neighbouring samples of the later pass, before and after the crossing.
    weight : ndarray, shape (p,)
        Of j1; 1 - weight is that of j0.
    """

    i: np.ndarray
    j0: np.ndarray
    j1: np.ndarray
    weight: np.ndarray

    def at(self, values):
        """Values at the crossings.

        Parameters
        ----------
        values : ndarray, shape (.., n)
            At every sample, the last axis in the order of time.

        Returns
        -------
        earlier, later : ndarray, shape (.., p)
            Of the earlier pass, and interpolated on the later.
        """
        return values[..., self.i], values[..., self.j0] * (1 - self.weight) + values[..., self.j1] * self.weight

    def lags(self, time):
        """Time between both ways.

        Parameters
        ----------
        time : ndarray, shape (n,)
            [s]

        Returns
        -------
        ndarray, shape (p,)
            [s]
        """
        earlier, later = self.at(time)
        return later - earlier

    @property
    def colour(self):
        """Variance of white noise in the mean over all pairs, over that of pairs that have no sample in common."""
        own = np.sum(1 + self.weight**2 + (1 - self.weight)**2)
        shares = np.bincount(np.r_[self.j0, self.j1], np.r_[1 - self.weight, self.weight])
        return float((len(self.i) + np.sum(shares**2)) / own) if len(self.i) else 1.0


def pairs(config, pass_id, run=None, tolerance=None, block=None):
    """Find the way back through the configuration of every sample.

    Parameters
    ----------
    config : ndarray, shape (d, n)
        Independent angles [rad].
    pass_id : ndarray of int, shape (n,)
        As of `passes`; -1 where nothing moves.
    run : ndarray of int, shape (n,), optional
        Number of the log that each sample belongs to; all of one by default.
    tolerance : float, optional
        Distance [rad] of the crossing; default 0.5 % of the travelled region.
    block : ndarray of int, shape (n,), optional
        Keeps both ends of a pair in one block, so that no pair ties the test part to the fit.

    Returns
    -------
    Pairs
        The earlier pass gives ``i``. The partner is the next pass that comes back through the configuration; a sample
        is used on one side of one pair only, so no measurement counts twice.
    """
    config, pass_id = np.atleast_2d(config), np.asarray(pass_id)
    run = np.zeros(pass_id.size, dtype=int) if run is None else np.asarray(run)
    tolerance = 0.005 * _extent(config) if tolerance is None else tolerance
    known = list(_summaries(config, pass_id, run).values())
    members = [np.flatnonzero(pass_id[p.first:p.last + 1] == pass_id[p.first]) + p.first for p in known]
    paths = {k: _path(config[:, m]) for k, m in enumerate(members) if m.size > 1}
    used, found = np.zeros(pass_id.size, dtype=bool), []
    for k, m in _candidates([known[k] for k in paths], list(paths), tolerance):
        free = np.flatnonzero(~used[members[k]])
        if free.size == 0 or used[members[m]].all():
            continue
        here, there = config[:, members[k]], config[:, members[m]]
        hit, lower, weight = _crossings(here, paths[k], there, paths[m], free, tolerance)
        i, j0, j1 = members[k][hit], members[m][lower], members[m][lower + 1]
        keep = ~(used[j0] & used[j1])
        if block is not None:
            keep &= (block[i] == block[j0]) & (block[i] == block[j1])
        if keep.any():
            found.append((i[keep], j0[keep], j1[keep], weight[keep]))
            used[i[keep]] = True
            # all between the first and the last crossing is used: what lies between them was interpolated over
            used[members[m][lower[keep].min():lower[keep].max() + 2]] = True
    if not found:
        return Pairs(*np.empty((3, 0), dtype=int), np.empty(0))
    return Pairs(*(np.concatenate(part) for part in zip(*found)))


def _candidates(known, names, tolerance):
    """Pairs of passes that go roughly opposite ways through one region, nearest in time first."""
    if not known:
        return []
    begin, end = np.array([p.begin for p in known]), np.array([p.end for p in known])
    low, high = np.minimum(begin, end) - tolerance, np.maximum(begin, end) + tolerance
    touch = np.all((low[:, None] <= high) & (low <= high[:, None]), axis=2)
    first, second = np.nonzero(np.triu(touch & ((end - begin) @ (end - begin).T < 0), 1))
    # by passes between, not by time: dwells of unequal length must not couple a way back with the next way out
    order = np.lexsort((first, second - first))
    return [(names[k], names[m]) for k, m in zip(first[order], second[order])]


def _path(points):
    """Unit direction of travel at each point (d, n), over a few samples, and a tree of the points."""
    n = points.shape[1]
    reach = max(2, n // 20)  # beyond the steps of an encoder
    low, high = np.maximum(np.arange(n) - reach, 0), np.minimum(np.arange(n) + reach, n - 1)
    travel = points[:, high] - points[:, low]
    return travel / np.maximum(np.linalg.norm(travel, axis=0), 1e-300), cKDTree(points.T)


def _crossings(here, path, there, other, free, tolerance):
    """Samples of one pass, the index before and the weight after the crossing on the other pass."""
    towards, _ = path
    back, tree = other
    points, n = here[:, free], there.shape[1]
    nearest = tree.query(points.T)[1]
    best, lower, weight = np.full(free.size, np.inf), np.zeros(free.size, dtype=int), np.zeros(free.size)
    for start in (nearest - 1, nearest):
        a = np.clip(start, 0, n - 2)
        edge = there[:, a + 1] - there[:, a]
        size = np.sum(edge**2, axis=0)
        along = np.sum((points - there[:, a]) * edge, axis=0) / np.maximum(size, 1e-300)
        part = np.clip(along, 0.0, 1.0)
        distance = np.linalg.norm(points - there[:, a] - part * edge, axis=0)
        # beyond the ends of the pass nothing was measured
        beyond = ((a == 0) & (along < 0)) | ((a == n - 2) & (along > 1)) | (size == 0)
        distance[beyond & (distance > 1e-9)] = np.inf
        better = distance < best
        best[better], lower[better], weight[better] = distance[better], a[better], part[better]
    opposite = np.sum(towards[:, free] * back[:, lower], axis=0) < _OPPOSITE
    hit = (best <= tolerance) & opposite
    return free[hit], lower[hit], weight[hit]

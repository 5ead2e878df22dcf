"""Readings in; columns that keep one value while the others say that something moves, out."""

from __future__ import annotations

import itertools

import numpy as np

from .finding import Finding
from .readings import Source
from .relations import SLOW

_HELD = 0.7  # a motor that is held throughout is told, and stops nothing: it may have been
_SECONDS, _SAMPLES = 0.3, 30
"""A stretch of equal readings that is looked at lasts that long at least."""
_LONGER = 8.0
"""Times the usual length of equal readings, while moving: coarse steps make stretches of equal readings too."""
_AS_WELL = 1.2  # of the usual scatter about the relation, that a column which stays may have
_LONG, _LEFT = 0.05, 0.03
"""Part of the log from which an angle that stays is held against the rest alone, and relative error that says no."""
_JUMP = 10.0
"""Usual changes between samples by which a column leaps to a value far from its last: what is cut off gets there."""
_FEW = 2000  # samples of such a fit
_REST = 0.1  # of the log that must be left for a mend
_TIMES = 4.0
"""Factor by which the column disagrees with the others more within the stretch than elsewhere."""


def equal_stretches(values):
    """First and last index of every stretch of equal readings.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Of one signal of one log.

    Returns
    -------
    ndarray of int, shape (k, 2)

    Examples
    --------
    >>> equal_stretches(np.array([1, 1, 2, 3, 3])).tolist()
    [[0, 1], [2, 2], [3, 4]]
    """
    edges = np.flatnonzero(np.diff(values) != 0) + 1
    return np.column_stack([np.append(0, edges), np.append(edges, values.size) - 1])


def stuck(readings, sources, columns, group, holds):
    """Columns that stand still while others move.

    Parameters
    ----------
    readings : Readings
        At every sample.
    sources : dict of str to Source
        How each variable is read, by its name.
    columns : Columns
        Name the columns of the variables in the findings.
    group : dict of str to list of str
        As `changes.roles` gives them.
    holds : list of (relation, Agreement)
        Agreement at every sample.

    Returns
    -------
    list of Finding
    """
    found, begin = [], np.concatenate([[0], np.cumsum([p.size for p in readings.picks])])
    motion = moved(readings, sources, group)
    for name in [n for members in group.values() for n in members]:
        for k in range(len(readings.picks)):
            here = slice(begin[k], begin[k + 1])
            time, values = readings.time[here], readings.take(Source(name))[here]
            if values.size < 2 * _SAMPLES or motion is None:
                continue
            spans = equal_stretches(values)
            length = spans[:, 1] - spans[:, 0] + 1
            long = spans[(length >= _SAMPLES) & (time[spans[:, 1]] - time[spans[:, 0]] >= _SECONDS)]
            moves = motion[here]
            bad = [(a, b) for a, b in long if _contradicted(name, a, b, begin[k], moves, length, spans, group, holds,
                                                           readings, sources, values)]
            if bad:
                found.append(_finding(readings, columns, name, k, bad, time, values))
            elif len(spans) == 1 and name in group["angles"] and moves.any():
                text = f"{columns.of(name)} keeps the value {values[0]:.6g} throughout, while others move"
                found.append(Finding("stuck", text, [columns.of(name)], _HELD))
    return found


def moved(readings, sources, group):
    """Samples in which some angle moves.

    Parameters
    ----------
    readings : Readings
        At the samples that are looked at.
    sources : dict of str to Source
        How each variable is read, by its name.
    group : dict of str to list of str
        Variables by what they are, as `changes.roles` gives them.

    Returns
    -------
    ndarray of bool, shape (samples,), or None
        None where there are no angles.
    """
    speeds = [readings.take(sources[n], 1) for n in group["angles"]]
    speeds += [readings.take(sources[n]) for n in group["speeds"]]
    if not speeds:
        return None
    return np.any([np.abs(w) > 3 * SLOW * np.sqrt(np.mean(w ** 2)) for w in speeds if np.any(w)] or [
        np.zeros(readings.time.size, bool)], axis=0)


def _contradicted(name, a, b, begin, moves, length, spans, group, holds, readings, sources, values):
    """Whether other columns say that the value did not stay."""
    inside = slice(begin + a, begin + b + 1)
    if (len(spans) > 1 and values[a] in (values.min(), values.max()) and name not in group["angles"] + group["speeds"]
            and not _leapt(values, a, b)):
        return False  # cut off there, which is said as such
    if np.mean(moves[a:b + 1]) < 0.5 or np.count_nonzero(moves[a:b + 1]) < _SAMPLES:
        return False
    if name in group["torques"] + group["references"] + group["encoders"]:
        # lengths of equal readings while moving, each counted by its samples; the longest is not among them
        usual = [n for (i, j), n in zip(spans, length) if (i, j) != (a, b) and np.mean(moves[i:j + 1]) > 0.5]
        weights = np.sort(usual)[::-1]
        typical = weights[np.searchsorted(np.cumsum(weights), 0.05 * weights.sum())] if len(weights) else 1
        if b - a + 1 > _LONGER * typical and not (name in group["encoders"] and _followed(name, inside, holds)):
            return True
    for channel, r, within, outside, hold in _residuals(name, inside, holds):
        e, usual = np.sqrt(np.mean(r[within] ** 2)), 1.4826 * np.median(np.abs(r[outside]))
        if e > _TIMES * max(usual, 1e-12) and e > 0.2 * hold.spread[channel]:
            return True
    return name in group["angles"] and _apart(name, inside, holds, readings, sources)


def _leapt(values, a, b):
    """Whether a column leaps to the value at which it stays, and away from it."""
    usual = np.median(np.abs(np.diff(values)))
    ends = [abs(values[k] - values[a]) for k in (a - 1, b + 1) if 0 <= k < values.size]
    return bool(ends) and min(ends) > _JUMP * usual > 0


def _apart(name, inside, holds, readings, sources):
    """Whether relations that hold at rest, fitted without a stretch, say that an angle moved in it."""
    kept = np.ones(readings.time.size, bool)
    kept[inside] = False
    if not _LONG < 1 - kept.mean() < 1 - _LONG:
        return False
    few = readings.only(kept & (np.arange(kept.size) % max(1, kept.size // _FEW) == 0))
    for relation, hold in ((r, h) for r, h in holds if getattr(r, "always", False) and name in r.variables):
        if relation.level:
            continue
        x = relation.hold(few, sources, hold.x).x
        residual = relation.measured(readings, sources) - relation.predict(readings, sources, x)
        for channel, r in zip(relation.channels, residual):
            within, usual = (float(np.sqrt(np.mean(r[part] ** 2))) for part in (~kept, kept))
            if within > max(_TIMES * usual, _LEFT * hold.spread[channel]):
                return True
    return False


def _followed(name, inside, holds):
    """Whether an encoder that stays is where the motors say that it is, as well as it is elsewhere: in slow motion."""
    told = [np.std(r[within]) <= _AS_WELL * 1.4826 * np.median(np.abs(r[outside] - np.median(r[outside])))
            for _, r, within, outside, _ in _residuals(name, inside, holds)]
    return bool(told) and all(told)


def _residuals(name, inside, holds):
    """Channels of the relations that a column is in, what they leave, and the samples within a stretch and outside."""
    for relation, hold in holds:
        if name in relation.variables and hold.residual is not None:
            within, outside = np.zeros_like(hold.used), hold.used.copy()
            within[inside], outside[inside] = hold.used[inside], False
            if within.sum() >= _SAMPLES and outside.sum() >= _SAMPLES:
                for channel, r in zip(relation.channels, hold.residual):
                    yield channel, r, within, outside, hold


def _finding(readings, columns, name, k, bad, time, values):
    column, log = columns.of(name), readings.logs[k]
    times = [(float(time[a]), float(time[b])) for a, b in bad]
    share = sum(b - a + 1 for a, b in bad) / values.size
    where = "throughout" if share > 0.95 else f"from {times[0][0]:.4g} to {times[0][1]:.4g} s"
    where += f" and {len(times) - 1} times more" if len(times) > 1 else ""
    many = f" of {log.name}" if len(readings.logs) > 1 else ""
    text = f"{column} keeps the value {values[bad[0][0]]:.6g} {where}{many}, while others move: the column is stuck"
    free = _longest_free(bad, time)
    if free is None or free[1] - free[0] < _REST * (time[-1] - time[0]):
        mend = f"# {column}: record it again, or take its line out of [columns]"
    else:
        mend = f"[data]\ntime = [{free[0]:.6g}, {free[1]:.6g}]"
    return Finding("stuck", text, [column], 0.99, mend=mend, times=times)


def copied(logs, columns):
    """Columns that repeat another in every sample.

    Parameters
    ----------
    logs : list of Log
        Signals are compared sample by sample in each.
    columns : Columns
        Name the columns of the variables in the findings.

    Returns
    -------
    list of Finding
    """
    found, names = [], sorted(set.intersection(*[set(log.signals) for log in logs]))
    for one, two in itertools.combinations(names, 2):
        if columns.column(one) is None or columns.column(two) is None:
            continue
        pairs = [(log.signals[one], log.signals[two]) for log in logs]
        if all(np.array_equal(a, b) for a, b in pairs) and any(np.ptp(a) > 0 for a, _ in pairs):
            a, b = columns.of(one), columns.of(two)
            text = f"{b} repeats {a} in every sample: one of the two was recorded twice, the other not at all"
            found.append(Finding("stuck", text, [a, b], 0.99,
                                 mend=f"# {b}: name the column that holds it, or record it again"))
    return found


def _longest_free(bad, time):
    """Longest stretch without the stuck ones."""
    edges = [0, *[i for a, b in bad for i in (a, b)], time.size - 1]
    free = [(edges[i], edges[i + 1]) for i in range(0, len(edges), 2)]
    a, b = max(free, key=lambda f: time[f[1]] - time[f[0]])
    step = float(np.median(np.diff(time)))
    return (float(time[a]), float(time[b]) - step) if time[b] - time[a] > 2 * step else None

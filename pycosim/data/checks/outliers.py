"""Readings in; samples far off their neighbours, and short stretches that no model follows, with their times, out."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d, uniform_filter1d

from ...study.toml import to_toml
from .finding import Finding

_FAR = 10.0
"""Robust standard deviations from the median of the neighbours: of a million normal samples none is beyond 6, and noise
that grows with load or speed is measured around each sample."""
_SIDE, _AROUND = 3, 100  # samples on each side of the median, and of the scatter
_NEAR = 5  # samples about a start, a stop or a turn
_SEEN = 0.01  # of the range: nearer ones move no fit
_SHARE = 0.02  # of the samples: more are no outliers
_SHOCK = 12.0  # robust deviations of the residual over a tenth of a second
_CALM = 0.3  # s to the next sample at rest, start, stop or turn
_LONGEST = 0.5  # s that a shock lasts at most
_ABOUT = 0.1  # s on each side that go with it: it rises before it is seen, and rings on


def outliers(logs, columns, study):
    """Single samples that are far off.

    Parameters
    ----------
    logs : list of Log
        As recorded, without wraps.
    columns : Columns
        Name the columns of the variables in the findings.
    study : Study
        Samples that it leaves out are not looked at; it may be robust already.

    Returns
    -------
    found : list of Finding
    """
    found, turns = [], {log.name: starts(log) | study.left_out(log.name, log.time) for log in logs}
    mend = "" if study.robust else "[fit]\nrobust = true"
    weighed = "they are weighed down" if study.robust else "[fit] robust = true weighs them down"
    for name in sorted(set.intersection(*[set(log.signals) for log in logs])):
        times, count, total, size = [], 0, 0, 0.0
        for log in logs:
            values = log.signals[name]
            total += values.size
            far, off = spikes(values)
            free = ~turns[log.name][far]
            far, off = far[free], off[free]
            count += far.size
            size = max(size, float(np.abs(off).max(initial=0.0)))
            times += [(float(log.time[max(k - 1, 0)]), float(log.time[min(k + 1, values.size - 1)])) for k in far]
        if count and count < _SHARE * total:
            column = columns.column(name)
            text = (f"{count} {'samples' if count > 1 else 'sample'} of {columns.of(name)} "
                    f"({100 * count / total:.2g} %) {'are' if count > 1 else 'is'} far off the neighbours, "
                    f"by up to {size:.3g} {column.dimension if column else ''}; {weighed}")
            found.append(Finding("outliers", text, [columns.of(name)], 0.99, mend=mend,
                                 times=times[:50]))
    return found


def starts(log):
    """Samples about which a joint starts, stops or turns: a torque may jump there, and be back at the next sample.

    Parameters
    ----------
    log : Log
        Its angles tell where a joint moves.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    found = np.zeros(len(log.time), bool)
    for name, values in log.signals.items():
        if name.endswith((".phi", ".s")) and values.size > 4 * _NEAR:
            steps = np.abs(np.diff(values))
            least = 2 * float(steps[steps > 0].min(initial=np.inf)) if (steps > 0).any() else np.inf
            moved = values[_NEAR:] - values[:-_NEAR]
            before, after = moved[:-_NEAR], moved[_NEAR:]
            slow, fast = (f(np.abs(before), np.abs(after)) for f in (np.minimum, np.maximum))
            turn = (fast > least) & ((slow < 0.2 * fast) | (before * after < 0))
            found[_NEAR:-_NEAR] |= turn
    return maximum_filter1d(found, 2 * _NEAR + 1)


def spikes(values):
    """Samples far off the median of their neighbours.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Of one signal of one log, in any unit.

    Returns
    -------
    at : ndarray of int
    off : ndarray
        How far, in the unit of the values.
    """
    if values.size < 2 * _AROUND:
        return np.empty(0, int), np.empty(0)
    off = values - median_filter(values, 2 * _SIDE + 1, mode="nearest")
    size = np.abs(off)
    middle = float(np.median(size))
    whole = 1.4826 * middle if middle else 1.2533 * float(np.mean(np.minimum(size, np.quantile(size, 0.99))))
    # the mean around, each sample limited, follows noise that grows and shrinks; a spike moves it by little
    around = 1.2533 * uniform_filter1d(np.minimum(size, 5 * whole + 1e-300), 2 * _AROUND + 1, mode="nearest")
    # in motion the neighbours themselves lie apart
    travel = maximum_filter1d(np.abs(median_filter(np.diff(values, prepend=values[0]), 5, mode="nearest")), 9)
    far = size > np.maximum(_FAR * np.maximum(whole, around), 4 * travel)
    far &= size > _SEEN * float(np.quantile(values, 0.99) - np.quantile(values, 0.01))
    at = np.flatnonzero(far)
    return at, off[at]


def shocks(readings, columns, holds, study):
    """Short stretches that the model of the rig does not follow, though it follows the rest.

    Parameters
    ----------
    readings : Readings
        At every sample.
    columns : Columns
        Name the columns of the variables in the findings.
    holds : list of (relation, Agreement)
        Agreement at every sample.
    study : Study
        Samples that it leaves out are not looked at.

    Returns
    -------
    list of Finding
    """
    hit, time, run = np.zeros(readings.time.size, bool), readings.time, readings.run
    named = set()
    turns = np.concatenate([_about(starts(log), log.time * readings.clock)[pick]
                            for log, pick in zip(readings.logs, readings.picks)])
    turns |= np.concatenate([study.left_out(log.name, seconds)[pick] for log, seconds, pick in zip(
        readings.logs, readings.times, readings.picks)])
    for relation, hold in holds:
        if not hasattr(relation, "name") or relation.level or hold.residual is None:
            continue
        step = float(np.median(np.diff(time)))
        width = max(3, int(round(0.05 / max(step, 1e-9))) | 1)
        for channel, r in zip(relation.channels, hold.residual):
            r = np.where(hold.used, r, 0.0)
            smooth = median_filter(r, width, mode="nearest")
            usual = 1.4826 * np.median(np.abs(smooth[hold.used])) if hold.used.any() else 0.0
            # at a reversal friction passes through states that the quick model does not follow
            calm = minimum_filter1d(hold.used.astype(int), 2 * int(_CALM / max(step, 1e-9)) + 1).astype(bool)
            calm &= ~turns
            far = (np.abs(smooth) > _SHOCK * usual) & calm & (usual > 0)
            if far.any() and far.mean() < 0.005:
                hit |= far
                named.add(columns.of(channel))
    short = [(a, b) for a, b in _spans(hit, run) if time[b] - time[a] <= _LONGEST]
    spans = [(float(time[a]), float(time[b])) for a, b in short]
    if not spans:
        return []
    text = (f"{len(spans)} {'stretch' if len(spans) == 1 else 'stretches'} of less than {_LONGEST:g} s that the model "
            f"does not follow in {', '.join(sorted(named))}, as after a shock")
    names = [readings.logs[int(run[a])].name for a, _ in short]
    return [Finding("shock", text, sorted(named), 0.7, times=spans[:50], mend=_left_out(study, names, spans))]


def _left_out(study, names, spans):
    """The line that leaves stretches out, beside those that are left out already."""
    wanted = [list(item) for item in study.leave_out]
    for name, (first, last) in zip(names, spans):
        file = [name] if len(study.runs) + len(study.held_out) > 1 else []
        first, last = round(first - _ABOUT, 3), round(last + _ABOUT, 3)
        if wanted and wanted[-1][:-2] == file and wanted[-1][-2] <= first <= wanted[-1][-1]:
            wanted[-1][-1] = last
        else:
            wanted.append([*file, first, last])
    return f"[data]\nleave_out = [{', '.join(map(to_toml, wanted))}]"


def _about(mask, time):
    """A mask with what lies within the time of a calm about it."""
    step = float(np.median(np.diff(time))) if time.size > 1 else 1.0
    return maximum_filter1d(mask, 2 * int(_CALM / max(step, 1e-9)) + 1)


def _spans(mask, run):
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(a, b - 1) for a, b in zip(edges[::2], edges[1::2]) if run[a] == run[b - 1]]

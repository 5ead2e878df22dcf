"""Readings in; samples far off their neighbours, and short stretches that no model follows, with their times, out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import distance_transform_edt, median_filter

from ...study.toml import to_toml
from ..spikes import MANY, mended, spikes, starts
from .finding import Finding

_SHOCK = 12.0  # robust deviations of the residual over a tenth of a second
_CALM, _READINGS, _PART = 0.3, 10, 0.1
"""To the next sample at rest, start, stop or turn: seconds, samples, and of the usual time between two, at least."""
_LONGEST = 0.5  # s that a shock lasts at most
_ABOUT = 0.1  # s on each side that go with it: it rises before it is seen, and rings on
_SOON = 1.0  # s to a start, stop or turn, within which what comes back is of the motion
_AGAIN = 3  # times that it comes back as soon; of five shocks, three do so by chance in one log of sixty
_GAP = 3.0  # usual steps between two samples, from which some are missing there


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
    for name in sorted(set.intersection(*[set(log.signals) for log in logs])):
        times, count, total, size = [], 0, 0, 0.0
        for log in logs:
            values = log.signals[name]
            total += values.size
            far, off = spikes(values, turns[log.name])
            count += far.size
            size = max(size, float(np.abs(off).max(initial=0.0)))
            times += [(float(log.time[max(k - 1, 0)]), float(log.time[min(k + 1, values.size - 1)])) for k in far]
        if count and count < MANY * total:
            column = columns.column(name)
            done = "they are bridged" if study.robust else "[fit] robust = true bridges them"
            text = (f"{count} {'samples' if count > 1 else 'sample'} of {columns.of(name)} "
                    f"({100 * count / total:.2g} %) {'are' if count > 1 else 'is'} far off the neighbours, "
                    f"by up to {size:.3g} {column.dimension if column else ''}; {done}")
            found.append(Finding("outliers", text, [columns.of(name)], 0.99, mend=mend,
                                 times=times[:50]))
    return found


def without_outliers(logs):
    """Logs whose signals hold no outliers, so that each does not look like another mistake.

    Parameters
    ----------
    logs : list of Log
        As recorded; none of them is changed.

    Returns
    -------
    list of Log
    """
    turns = [starts(log) for log in logs]
    return [replace(log, signals={n: mended(v, t) for n, v in log.signals.items()}) for log, t in zip(logs, turns)]


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
    named, soon = set(), np.full(time.size, np.inf)
    step = float(np.median(np.diff(time)))
    turns = _gaps(time, step) | np.concatenate([_ends(starts(log))[pick] for log, pick in zip(
        readings.logs, readings.picks)])
    left_out = np.concatenate([study.left_out(log.name, seconds)[pick] for log, seconds, pick in zip(
        readings.logs, readings.times, readings.picks)])
    for relation, hold in holds:
        if not hasattr(relation, "name") or relation.level or hold.residual is None:
            continue
        width = max(3, int(round(0.05 / max(step, 1e-9))) | 1)
        for channel, r in zip(relation.channels, hold.residual):
            r = np.where(hold.used, r, 0.0)
            smooth = median_filter(r, width, mode="nearest")
            usual = 1.4826 * np.median(np.abs(smooth[hold.used])) if hold.used.any() else 0.0
            # at a reversal friction passes through states that the quick model does not follow
            apart = step * distance_transform_edt(hold.used & ~turns)
            far = (np.abs(smooth) > _SHOCK * usual) & (apart > _calm(hold.used & ~turns, run, step)) & ~left_out
            far &= usual > 0
            if far.any() and far.mean() < 0.005:
                hit |= far
                soon = np.minimum(soon, np.where(far, apart, np.inf))
                named.add(columns.of(channel))
    short = _by_chance([(a, b) for a, b in _spans(hit, run) if time[b] - time[a] <= _LONGEST], soon)
    spans = [(float(time[a]), float(time[b])) for a, b in short]
    if not spans:
        return []
    text = (f"{len(spans)} {'stretch' if len(spans) == 1 else 'stretches'} of less than {_LONGEST:g} s that the model "
            f"does not follow in {', '.join(sorted(named))}, as after a shock")
    names = [readings.logs[int(run[a])].name for a, _ in short]
    return [Finding("shock", text, sorted(named), 0.7, times=spans[:50], mend=_left_out(study, names, spans))]


def _calm(moving, run, step):
    """Time to the next start, stop or turn [s] within which nothing is a shock: slow machines take longer to settle."""
    usual = np.median([b - a + 1 for a, b in _spans(moving, run)] or [0])
    return max(_CALM, _READINGS * step, _PART * usual * step)


def _by_chance(spans, soon):
    """Stretches without those that come back as soon after a start, or before a stop: that is the motion's doing."""
    after = np.array([soon[a:b + 1].min() for a, b in spans])
    alike = np.abs(after[:, None] - after) <= _ABOUT
    return [s for s, times, own in zip(spans, alike.sum(1), after) if times < _AGAIN or own > _SOON]


def _gaps(time, step):
    """Samples on either side of some that are missing: what is derived from the motion is poor there."""
    apart = np.abs(np.diff(time, prepend=time[:1])) > _GAP * step
    return apart | np.roll(apart, -1)


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


def _ends(mask):
    """A mask with the first and the last sample, where slopes are of one side."""
    mask[[0, -1]] = True
    return mask


def _spans(mask, run):
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(a, b - 1) for a, b in zip(edges[::2], edges[1::2]) if run[a] == run[b - 1]]

"""A fitted model's residual in; the beat that it keeps in time, whatever the machine does, out.

Mains, a pump, a fan or a neighbour's compressor shake a torque at a frequency of their own. No function of angle, speed
or load follows that, and a noise model takes it for slow noise, beside which no test has an effect to find.
"""

from __future__ import annotations

import finufft
import numpy as np

SHARE = 0.2
"""Of a channel's squared error, from which a beat counts: an error of 1.12 times the noise."""
CYCLES, BLOCKS = 8.0, 4
"""Cycles of the slowest beat within the longest run, and blocks that are needed."""
MOST_FREQUENCIES = 2 ** 18
FASTEST = 0.4  # of the sampling rate
MAINS, HARMONICS, OFF, APART = (50.0, 60.0), 4, 0.005, 2.0
"""Frequencies of mains [Hz], how many of their multiples, how far a beat may be off them (a network keeps 0.002, a
logger's clock 0.003), and from which frequency on one that sampling folds is told from what is slow [Hz]."""
OF_MOTION = 0.05  # of its energy, that the motion itself may have there: what repeats with it has no beat of its own


def rhythms(dataset, model, fit):
    """Beats that the residual of a channel keeps all through the log.

    Their frequency is where the periodogram is largest. Size and phase found there in every second block must predict
    the blocks between, and the other way round; and those of the first half of each run its second one, and the other
    way round, for slow noise goes on from block to block.

    Parameters
    ----------
    dataset : Dataset
        Its fit part is looked at.
    model : Model
        That was fitted.
    fit : Fit
        Of that model.

    Returns
    -------
    dict of str to (float, float, bool)
        By channel of a torque or force, the frequency [Hz], the share of the squared error that it predicts, and
        whether it is of mains; those of more than `SHARE` alone.
    """
    if dataset.paired or dataset.averaged:
        return {}
    problem = dataset.residuals(model, fit.free, fit.parameters, "fit")
    view = dataset.view("fit")
    run, time = dataset.run[view], problem.time
    blocks, number = np.unique(problem.block, return_inverse=True)
    parts = [np.flatnonzero(number % 2 == k) for k in (0, 1)]
    longest = max(np.ptp(time[run == k]) for k in np.unique(run))
    if len(blocks) < BLOCKS or not longest > 0:
        return {}
    middle = {k: (time[run == k].min() + time[run == k].max()) / 2 for k in np.unique(run)}
    late = time > np.array([middle[k] for k in run])
    halves = [np.flatnonzero(late == side) for side in (False, True)]
    low = CYCLES / longest
    rate = 1 / np.median(np.diff(dataset.time[dataset.run == run[0]]))
    high = FASTEST * rate
    count = int(min(4 * longest * (high - low), MOST_FREQUENCIES))
    if count < 2:
        return {}
    grid = np.linspace(low, high, count)
    found = {}
    for channel, r in zip(dataset.channels, problem.residual(fit.values)):
        if dataset.base.unit(channel) not in ("N.m", "N"):
            continue
        best = grid[np.argmax(_power(time, r, run, grid))]
        share = min(_predicted(time, r, run, *way, best) for way in (parts, parts[::-1], halves, halves[::-1]))
        if share > SHARE and not _moves(time, [s[view] for s in dataset.speeds], run, best):
            found[channel] = float(best), float(share), of_mains(best, rate)
    return found


def _power(time, values, run, grid):
    """Periodogram on an even grid of frequencies, summed over the runs."""
    step, count, total = grid[1] - grid[0], len(grid), 0.0
    middle = grid[0] + step * (count // 2)
    for k in np.unique(run):
        t = time[run == k] - time[run == k][0]
        turned = 2 * np.pi * step * t
        values_there = (values[run == k] * np.exp(-2j * np.pi * middle * t)).astype(complex)
        total = total + np.abs(finufft.nufft1d1(np.mod(turned, 2 * np.pi), values_there, count, isign=-1,
                                                eps=1e-6)) ** 2
    return total


def _waves(time, frequency):
    return np.array([np.sin(2 * np.pi * frequency * time), np.cos(2 * np.pi * frequency * time)])


def _predicted(time, values, run, one, other, frequency):
    """Share of the energy of some samples that a wave predicts whose size and phase come from others, run by run."""
    left = energy = 0.0
    for k in np.unique(run):
        known, unseen = one[run[one] == k], other[run[other] == k]
        if len(known) < 8 or not len(unseen):
            continue
        size = np.linalg.lstsq(_waves(time[known], frequency).T, values[known], rcond=None)[0]
        left += np.sum((values[unseen] - size @ _waves(time[unseen], frequency)) ** 2)
        energy += np.sum(values[unseen] ** 2)
    return 1.0 - left / energy if energy else 0.0


def _moves(time, speeds, run, frequency):
    """Whether the motion itself has a line at a frequency."""
    everything = np.arange(len(time))
    return any(_predicted(time, s - np.mean(s), run, everything, everything, frequency) > OF_MOTION
               for s in speeds)


def of_mains(frequency, rate):
    """Whether a beat is that of mains: noise of the record, and no law of the machine.

    Parameters
    ----------
    frequency : float
        [Hz]
    rate : float
        Of the samples [Hz], which fold what is faster than half of it.

    Returns
    -------
    bool
    """
    lines = np.outer(MAINS, np.arange(1, HARMONICS + 1)).ravel()
    folded = np.abs(lines - rate * np.round(lines / rate))
    return bool(frequency > APART and np.any(np.abs(folded - frequency) < OFF * lines))


__all__ = ["of_mains", "rhythms"]

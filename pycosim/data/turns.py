"""A log's samples after each turn in; which of them the model's own elastic displacement explains, out.

A segment gives by its `travel` before it slides. The models that are fitted take friction as that of sliding at once,
which is right where the machine is stiffer than that, or the log too coarse to show it. What a longer travel, a delay
or a filter does after a turn looks otherwise, and is for the diagnosis to find.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from .noise import contiguous

BUILT_UP = 0.02  # of a segment's friction, that may still have to build up where it counts as sliding
LONGER = 5.0  # times the model's own travel, within which a turn is looked at
AFTER = 10  # samples of a pass beyond that, which tell what it would have been
EXPLAINED = 0.95
"""Of what is off after turns, that the model's own travel has to explain to be what is at work. Where it is, 99 % are
explained; a hidden presliding leaves 10 to 25 %, a delay or a filter 25 to 75 %."""
SEEN = 2.0  # times the squared noise, from which something is off at all


def building_up(miss, longer, moving, passes, time, errors, columns):
    """Samples at which friction still builds up over the model's own travel; none where that is not what is seen.

    Parameters
    ----------
    miss, longer : ndarray, shape (segments, n)
        Friction states short of their limits, for the model's own travel and for one that is `LONGER` times that.
    moving : ndarray of bool, shape (n,)
    passes : ndarray of int, shape (n,)
        -1 where nothing moves.
    time : ndarray, shape (n,)
        [s]
    errors : ndarray, shape (channels, n)
        Measured less predicted, for friction that slides at once.
    columns : ndarray, shape (segments, channels, n)
        What each segment's own travel would change in the prediction.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    own = moving & np.any(np.abs(miss) > BUILT_UP, axis=0)
    near = moving & np.any(np.abs(longer) > BUILT_UP, axis=0)
    off, noise, at = [], [], []
    for s in contiguous(time, passes):
        index = np.arange(s.start, s.stop)
        beyond = np.flatnonzero(~near[s])[:AFTER]
        if passes[s.start] < 0 or len(beyond) < AFTER:
            continue
        usual = errors[:, index[beyond]]
        some = index[:beyond[0]][near[index[:beyond[0]]]]
        at.append(some)
        off.append(errors[:, some] - usual.mean(axis=1, keepdims=True))
        noise.append(np.tile(np.var(np.diff(usual, axis=1), axis=1)[:, None] / 2 * (1 + 1 / AFTER), (1, len(some))))
    if not at or not own[np.concatenate(at)].any():
        return np.zeros(len(time), dtype=bool)
    off, noise, at = np.hstack(off), np.hstack(noise), np.concatenate(at)
    weight = 1 / np.sqrt(np.maximum(np.median(noise, axis=1, keepdims=True), 1e-300))
    left = nnls((columns[:, :, at] * weight).reshape(len(columns), -1).T, (off * weight).ravel())[1] ** 2
    total, usual = np.sum((off * weight) ** 2), np.sum(noise * weight**2)
    if total < SEEN * usual or left - usual > (1 - EXPLAINED) * (total - usual):
        return np.zeros(len(time), dtype=bool)
    return own

"""Readings of a log in, some of which stand for several rows; the rows in which they are new out."""

from __future__ import annotations

import math

import numpy as np

from ..core.words import listed

_STANDS, _CHANGES, _MOSTLY, _EVEN = 16, 50, 0.5, 0.95
"""Rows for which a reading stands at most; changes that are needed, part of them as far apart as most, and part that
are some multiple of that apart: a coarse reading changes now and then."""
_STEP, _FURTHER = 1.5, 0.1
"""Least changes that one of more than a step is, and part of them that are: what counts goes one on at a time."""
_AGREE = 0.5  # of the rows at which readings that stand for 2 and for 3 rows could be new together


def stands(values):
    """Rows for which a reading stands.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Of one signal of one log, in any unit.

    Returns
    -------
    int
        1 where readings change with any row, or at no even distance as a coarse one does, or by one step at a time.
    """
    change = np.diff(values)
    apart = np.diff(np.flatnonzero(change))
    apart = apart[apart <= _STANDS]
    if apart.size < _CHANGES:
        return 1
    usual = int(np.bincount(apart).argmax())
    even = usual > 1 and np.mean(apart == usual) > _MOSTLY and np.mean(apart % usual == 0) > _EVEN
    return usual if even and _leaps(np.abs(change[change != 0.0])) else 1


def _leaps(changes):
    """Whether changes are not all of one step, as those of an angle in even motion that counts are read of."""
    return float(np.mean(changes > _STEP * changes.min())) > _FURTHER


def fresh(signals):
    """Rows in which no reading is an old one.

    Parameters
    ----------
    signals : dict of str to ndarray, shape (n,)
        Of one log, in any unit.

    Returns
    -------
    new : ndarray of bool, shape (n,)
        All rows where no reading stands for several, or where some are new at one row and some at another.
    rows : dict of str to int
        Rows for which those that stand for several do; empty with all rows.
    """
    rows = {n: k for n, v in signals.items() if (k := stands(v)) > 1}
    new = np.ones(len(next(iter(signals.values()), ())), dtype=bool)
    for k in sorted({*rows.values()}):
        changes = np.any([np.diff(signals[n]) != 0 for n in rows if rows[n] == k], axis=0)
        if np.mean(np.diff(np.flatnonzero(changes)) % k == 0) <= _EVEN:
            return np.ones(len(new), dtype=bool), {}
        new &= _every(1 + np.flatnonzero(changes), k, len(new))
    if rows and new.sum() < _AGREE * len(new) / math.lcm(*rows.values()):
        return np.ones(len(new), dtype=bool), {}
    return new, rows


def stale_text(log, column):
    """What is said of readings that stand for several rows, where only those are used in which they are new.

    Parameters
    ----------
    log : Log
        With ``stands`` in its `meta`.
    column : callable
        Variable to the column that holds it.

    Returns
    -------
    str
    """
    rows = log.meta["stands"]
    if log.meta["whole"]:
        return f"every row stands {max(rows.values())} times, of which one is used"
    told = [f"{listed(column(n) for n in rows if rows[n] == k)} stand for {k} rows" for k in sorted({*rows.values()})]
    return f"readings of {', those of '.join(told)}: only rows in which they are new are used"


def _every(changes, k, count):
    """Rows of changes, and every k-th after each: a reading may come again as it was."""
    rows = np.arange(count)
    since = rows - np.append(changes[0], changes)[np.searchsorted(changes, rows, "right")]
    return since % k == 0

"""The parts of a log file come in, in order; one checked table goes out, of means of rows where the file is large."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..core.errors import DataError
from .readers import ranges

_GAP = 3.0  # usual sample intervals without a sample that end a mean


@dataclass
class Gathered:
    """What has been read of a file so far.

    Rows of the same label, with none left out and no gap in time between them, are averaged over ``every`` rows; what
    is over at the end of such a stretch is a mean of fewer. Nothing but the means is kept.

    Attributes
    ----------
    path : Path
        The file, for the words of an error.
    clock : str
        Column of the time.
    to_seconds : callable
        Makes that column's numbers seconds.
    numbers : list of str
        Columns that must hold a number in every row, the time among them.
    text : str
        Column of the labels; a log may lack it.
    every : int
        Rows a mean; 1 keeps all rows.
    span : (float, float), optional
        First and last time [s] of the rows that are used.
    dropped : list of (int, int)
        First and last row of each stretch left out.
    """

    path: object
    clock: str
    to_seconds: object
    numbers: list
    text: str
    every: int = 1
    span: tuple | None = None
    dropped: list = field(default_factory=list)

    def __post_init__(self):
        self._missing = {n: [] for n in self.numbers}
        self._recorded, self._rows = set(), 0
        self._last = None  # time and row of the last sample
        self._wrong, self._wrong_count = None, 0
        self._rest, self._done = None, []
        self._reach = (np.inf, -np.inf)  # of the times of the whole file

    def add(self, table):
        """Take in the next part.

        Parameters
        ----------
        table : Table
            Rows that follow those taken in before.
        """
        names = [*self.numbers, *([self.text] if self.text in table.columns else [])]
        if self.span is not None:
            table = self._cut(table, names)
        keep = self._usable(table)
        part = {n: table.columns[n][keep] for n in names}
        part[self.clock] = self.to_seconds(part[self.clock])
        rows = table.rows[keep]
        self.dropped += table.dropped
        self._rows += len(table.rows)
        if not rows.size:
            return
        self._follow(part[self.clock], rows)
        if self.every == 1:
            self._done.append((part, rows))
        else:
            self._average(part, rows)

    def finish(self, drop_outs):
        """Columns and rows of the whole file.

        Parameters
        ----------
        drop_outs : str
            ``refuse``, or ``skip`` where rows with missing numbers are to be left out.

        Returns
        -------
        columns : dict of str to ndarray, shape (n,)
        rows : ndarray of int, shape (n,)
            Row in the file, of the first sample of each mean.

        Raises
        ------
        DataError
            A number is missing, or time does not run forward, or hardly a row can be used.
        """
        self._refuse_missing(drop_outs)
        if self._rest is not None:
            self._done.append(_means(*self._rest, np.zeros(1, dtype=int)))
        count = sum(rows.size for _, rows in self._done)
        if count < 2 and self.span is not None and not self._rows and self._reach[0] < np.inf:
            raise DataError(f"{self.path}: no row lies within time = [{self.span[0]:g}, {self.span[1]:g}] s; the log "
                            f"runs from {self._reach[0]:g} to {self._reach[1]:g} s")
        if count < 2:
            raise DataError(f"{self.path}: has {'one usable row' if count else 'no usable rows'} of data; "
                            "a log needs at least two")
        self._refuse_time()
        columns = {n: np.concatenate([part[n] for part, _ in self._done]) for n in self._done[0][0]}
        return columns, np.concatenate([rows for _, rows in self._done])

    def _cut(self, table, names):
        """The rows of a part that lie within the span; one without a time stays, to be refused."""
        seconds = np.asarray(self.to_seconds(table.columns[self.clock]), dtype=float)
        known = seconds[np.isfinite(seconds)]
        if known.size:
            self._reach = min(self._reach[0], float(known.min())), max(self._reach[1], float(known.max()))
        inside = ~((seconds < self.span[0]) | (seconds > self.span[1]))
        return replace(table, rows=table.rows[inside], columns={n: table.columns[n][inside] for n in names})

    def _usable(self, table):
        """Rows that lack no number; the others are noted."""
        missing = np.zeros(table.rows.size, dtype=bool)
        for name in self.numbers:
            bad = ~np.isfinite(table.columns[name])
            if not bad.all():
                self._recorded.add(name)
            _extend(self._missing[name], ranges(table.rows[bad]))
            missing |= bad
        return ~missing

    def _refuse_missing(self, drop_outs):
        for name in self.numbers:
            if self._rows and name not in self._recorded:
                raise DataError(f"{self.path}: column '{name}' holds no number at all; take it out of [columns], "
                                "or log it")
        bad = {n: spans for n, spans in self._missing.items() if spans}
        if bad and drop_outs != "skip":
            (name, rows), *others = [(n, _text(spans)) for n, spans in bad.items()]
            also = "; so is " + ", ".join(f"'{n}' in row {r}" for n, r in others) if others else ""
            raise DataError(f"{self.path}, row {rows}: column '{name}' is empty, NaN or infinite{also}; "
                            'repair the log, or leave such rows out with [data] drop_outs = "skip"')
        if bad:
            self.dropped += _united([span for spans in bad.values() for span in spans])
        self.dropped.sort()

    def _follow(self, time, rows):
        """Note where time does not run forward."""
        if self._last is not None:
            time, rows = np.append(self._last[0], time), np.append(self._last[1], rows)
        step = np.diff(time)
        wrong = np.flatnonzero(step <= 0)
        if wrong.size and self._wrong is None:
            k = wrong[0]
            self._wrong = rows[k], rows[k + 1], time[k], time[k + 1]
        self._wrong_count += wrong.size
        self._last = time[-1], rows[-1]

    def _refuse_time(self):
        if self._wrong:
            before, row, earlier, later = self._wrong
            what = "repeats" if later == earlier else "goes backwards"
            raise DataError(f"{self.path}, row {row}: time {what}, {later:.9g} s after {earlier:.9g} s (row {before}), "
                            f"{self._wrong_count} such rows in all; one file is one run, in order of time")

    def _average(self, part, rows):
        """Means of whole groups; the last group waits for what the next part may add to it."""
        if self._rest is not None:
            part = {n: np.append(self._rest[0][n], c) for n, c in part.items()}
            rows = np.append(self._rest[1], rows)
        step = np.diff(part[self.clock])
        new = np.append(True, np.diff(rows) > 1)
        if step.size:
            new[1:] |= step > _GAP * np.median(step)
        if self.text in part:
            new[1:] |= part[self.text][1:] != part[self.text][:-1]
        index = np.arange(rows.size)
        begin = np.maximum.accumulate(np.where(new, index, 0))
        starts = np.flatnonzero((index - begin) % self.every == 0)
        end = starts[-1]
        if end:
            self._done.append(_means({n: c[:end] for n, c in part.items()}, rows[:end], starts[:-1]))
        self._rest = {n: c[end:].copy() for n, c in part.items()}, rows[end:].copy()


def _means(part, rows, starts):
    """Means of the rows from each start to the next, and each one's first row and label."""
    counts = np.diff(starts, append=rows.size)
    found = {}
    for name, values in part.items():
        first = values[starts]
        # what is added to the first is the mean of the rest: a constant stays exactly that
        found[name] = first if values.dtype.kind == "U" else first + np.add.reduceat(
            values - np.repeat(first, counts), starts) / counts
    return found, rows[starts]


def _extend(spans, more):
    """Append stretches of rows; one that goes on from the last part is one with it."""
    if spans and more and spans[-1][1] + 1 == more[0][0]:
        spans[-1] = spans[-1][0], more[0][1]
        more = more[1:]
    spans += more


def _united(spans):
    """Stretches of rows that may overlap, as stretches that do not."""
    found = []
    for first, last in sorted(spans):
        if found and first <= found[-1][1] + 1:
            found[-1] = found[-1][0], max(found[-1][1], last)
        else:
            found.append((first, last))
    return found


def _text(spans):
    """Row numbers as text: ``7-9, 12``."""
    spans = [f"{a}-{b}" if b > a else f"{a}" for a, b in spans]
    return ", ".join(spans[:5]) + (f" and {len(spans) - 5} more places" if len(spans) > 5 else "")

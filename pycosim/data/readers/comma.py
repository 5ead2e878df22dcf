"""Comma-separated text with a header row comes in; Tables go out, or the exact row that is not as it should be."""

from __future__ import annotations

import csv
import io
import itertools

import numpy as np
import pandas as pd

from ...core.errors import DataError
from . import Table, text_blocks

_MISSING = {"", "nan", "na", "n/a", "null", "none", "<na>", "#n/a", "inf", "-inf", "+inf", "infinity", "-infinity"}


def parts(path, wanted, text, header=True):
    """Read the wanted columns of a CSV file, part by part; see `pycosim.data.readers.read_parts`.

    Raises
    ------
    DataError
        Semicolons or tabs, duplicate columns, rows of the wrong length, text where a number belongs, no rows.
    """
    names, rows = _survey(path, wanted | {text}, header)
    return rows, _tables(path, names, wanted, text, int(header))


def _lines(path):
    """Yield blocks of whole lines without the last line break; blank lines at the end of the file are not there."""
    breaks = ""
    for block in text_blocks(path):
        block = breaks + block.replace("\r\n", "\n").replace("\r", "\n")
        kept = block.rstrip("\n")
        breaks = block[len(kept):]
        if kept:
            yield kept
            breaks = breaks[1:]  # the one that ends the last line yielded


def _survey(path, wanted, named):
    """Columns and number of rows, once every row has been found to have as many fields as there are columns."""
    blocks = _lines(path)
    first = next(blocks, "")
    line = first.partition("\n")[0]
    header = [name.strip() for name in next(csv.reader([line]), [])]
    if not named:
        header = [str(k) for k in range(1, len(header) + 1)]
    _check_header(path, line, header, wanted)
    rows = 0
    for block in itertools.chain([first] if first else [], blocks):
        counts = _fields(block)
        wrong = np.flatnonzero(counts != len(header))
        if wrong.size:
            k = int(wrong[0])
            cut = counts[k] < len(header) and k == counts.size - 1 and next(blocks, None) is None
            raise DataError(f"{path}, row {rows + k + 1}: has {counts[k]} fields, the "
                            f"{'header' if named else 'first row'} has {len(header)}"
                            f"{' (the log ends within a row)' if cut else ''}; repair or remove the row")
        rows += counts.size
    if named and rows < 2:
        raise DataError(f"{path}: has a header but no data rows")
    return header, rows - named


def _fields(block):
    """Number of fields in each line."""
    if '"' in block:
        # a quoted field may hold commas; a quoted line break would shift every row number, so rows are lines here too
        return np.array([len(next(csv.reader([line]), [""])) for line in block.split("\n")])
    # a multibyte character never holds the bytes of a comma or a line break
    marks = np.frombuffer(block.encode(), dtype=np.uint8)
    ends = np.append(np.flatnonzero(marks == 10), marks.size)
    commas = np.append(0, np.cumsum(marks == 44))[ends]
    return np.diff(commas, prepend=0) + 1


def _tables(path, header, wanted, text, above):
    """Yield the blocks of a file whose rows have the right length, without the rows above the first of numbers."""
    used = {name: k for k, name in enumerate(header) if name in wanted or name == text}
    row = 1
    for block in _lines(path):
        lines = block.count("\n") + 1
        if row <= above:
            block, lines, row = block.partition("\n")[2], lines - 1, 2
        if lines:
            yield _table(path, block, header, used, text, row)
        row += lines


def _table(path, block, header, used, text, row):
    kinds = {k: str if name == text else float for name, k in used.items()}
    options = dict(header=None, usecols=list(kinds), skip_blank_lines=False, skipinitialspace=True)
    try:
        frame = pd.read_csv(io.StringIO(block), dtype=kinds, keep_default_na=True, **options)
    except ValueError as error:
        frame = pd.read_csv(io.StringIO(block), dtype=str, keep_default_na=False, **options)
        raise _offender(path, frame, {k: n for n, k in used.items() if n != text}, row, error) from None
    columns = {name: frame[k].fillna("").to_numpy(dtype=str) if name == text else frame[k].to_numpy(dtype=float)
               for name, k in used.items()}
    return Table(columns, header, np.arange(len(frame)) + row)


def _check_header(path, line, header, wanted):
    for mark, word in ((";", "semicolons"), ("\t", "tabs")):
        if len(header) == 1 and mark in line:
            raise DataError(f"{path}: columns are separated by {word}; write the log with commas and decimal points, "
                            "or set [data] reader")
    for name in header:
        if name in wanted and header.count(name) > 1:
            raise DataError(f"{path}: column '{name}' is there {header.count(name)} times; keep one")


def _offender(path, frame, names, first, error):
    """The first cell that is not a number."""
    found = []
    for k, name in names.items():
        cells = frame[k].str.strip()
        numbers = pd.to_numeric(cells, errors="coerce")
        bad = np.flatnonzero(numbers.isna() & ~cells.str.lower().isin(_MISSING))
        if bad.size:
            found.append((int(bad[0]), name, cells.iloc[bad[0]]))
    if not found:
        return DataError(f"{path}: cannot be read as numbers ({error})")
    row, name, cell = min(found)
    hint = "; use a decimal point" if cell.replace(",", "", 1).lstrip("+-").isdigit() else ""
    if first + row == 1:
        hint = "; if the first row names the columns, remove header = false"
    return DataError(f"{path}, row {first + row}, column '{name}': '{cell[:40]}' is not a number{hint}")

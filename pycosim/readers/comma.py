"""Comma-separated text with a header row comes in; a Table goes out, or the exact row that is not as it should be."""

from __future__ import annotations

import csv
import io

import numpy as np
import pandas as pd

from ..errors import DataError
from . import Table, read_text

_MISSING = {"", "nan", "na", "n/a", "null", "none", "<na>", "#n/a", "inf", "-inf", "+inf", "infinity", "-infinity"}


def read(path, wanted, text):
    """Read the wanted columns of a CSV file; see `pycosim.readers.read_table`.

    Raises
    ------
    DataError
        Semicolons or tabs, duplicate columns, rows of the wrong length, text where a number belongs, no rows.
    """
    content = read_text(path).replace("\r\n", "\n").replace("\r", "\n").rstrip("\n")
    header = [name.strip() for name in next(csv.reader([content.split("\n", 1)[0]]), [])]
    _check_header(path, content.split("\n", 1)[0], header, wanted | {text})
    if "\n" not in content:
        raise DataError(f"{path}: has a header but no data rows")
    _check_lengths(path, content, len(header))
    used = {name: k for k, name in enumerate(header) if name in wanted or name == text}
    kinds = {k: str if name == text else float for name, k in used.items()}
    options = dict(header=None, skiprows=1, usecols=list(kinds), skip_blank_lines=False, skipinitialspace=True)
    try:
        frame = pd.read_csv(io.StringIO(content), dtype=kinds, keep_default_na=True, **options)
    except ValueError as error:
        frame = pd.read_csv(io.StringIO(content), dtype=str, keep_default_na=False, **options)
        raise _offender(path, frame, {k: n for n, k in used.items() if n != text}, error) from None
    columns = {name: frame[k].fillna("").to_numpy(dtype=str) if name == text else frame[k].to_numpy(dtype=float)
               for name, k in used.items()}
    return Table(columns, header, np.arange(len(frame)) + 2)


def _check_header(path, line, header, wanted):
    for mark, word in ((";", "semicolons"), ("\t", "tabs")):
        if len(header) == 1 and mark in line:
            raise DataError(f"{path}: columns are separated by {word}; write the log with commas and decimal points, "
                            "or set [data] reader")
    for name in header:
        if name in wanted and header.count(name) > 1:
            raise DataError(f"{path}: column '{name}' is there {header.count(name)} times; keep one")


def _check_lengths(path, content, expected):
    """Every row has as many fields as the header."""
    if '"' in content:
        # a quoted field may hold commas; a quoted line break would shift every row number, so rows are lines here too
        counts = np.array([len(next(csv.reader([line]), [""])) for line in content.split("\n")])
    else:
        # a multibyte character never holds the bytes of a comma or a line break
        marks = np.frombuffer(content.encode(), dtype=np.uint8)
        ends = np.append(np.flatnonzero(marks == 10), marks.size)
        commas = np.append(0, np.cumsum(marks == 44))[ends]
        counts = np.diff(commas, prepend=0) + 1
    wrong = np.flatnonzero(counts != expected)
    if wrong.size:
        row = int(wrong[0])
        end = " (the log ends within a row)" if row == counts.size - 1 and counts[row] < expected else ""
        raise DataError(f"{path}, row {row + 1}: has {counts[row]} fields, the header has {expected}{end}; "
                        "repair or remove the row")


def _offender(path, frame, names, error):
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
    return DataError(f"{path}, row {row + 2}, column '{name}': '{cell[:40]}' is not a number{hint}")

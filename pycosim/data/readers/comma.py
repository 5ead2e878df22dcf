"""Text in columns, as a study lays it out, comes in; Tables go out, or the exact row that is not as it should be."""

from __future__ import annotations

import csv
import io
import itertools
import re

import numpy as np
import pandas as pd

from ...core.errors import DataError
from ...study.layout import LAYOUT_KEYS, PLAIN
from ...study.toml import to_toml
from . import Table, dated, text_blocks

MISSING = {"", "nan", "na", "n/a", "null", "none", "<na>", "#n/a", "inf", "-inf", "+inf", "infinity", "-infinity"}
"""Cells that stand for no number, in small letters."""


def parts(path, wanted, text, layout=PLAIN):
    """Read the wanted columns of a text file, part by part; see `pycosim.data.readers.read_parts`.

    Raises
    ------
    DataError
        Another layout than the study says (the message gives the lines that say it), duplicate columns, rows of the
        wrong length, text where a number belongs, no rows.
    """
    try:
        names, rows = _survey(path, wanted | {text}, layout)
    except DataError as error:
        raise _laid_out_otherwise(path, layout, error) from None
    if wanted and not wanted & set(names):
        lacking = DataError(f"{path}: holds none of the study's columns")
        otherwise = _laid_out_otherwise(path, layout, lacking)
        if otherwise is not lacking:
            raise otherwise
    return rows, _tables(path, names, wanted, text, layout)


def _laid_out_otherwise(path, layout, error):
    """The error, with the lines of a study that would read the file where there are such."""
    from .look import look  # which reads with this module
    try:
        found = look(path).layout
    except DataError:
        return error
    keys = [k for k in LAYOUT_KEYS if getattr(found, k) != getattr(layout, k)]
    if found.encoding == PLAIN.encoding:  # its letters are the same in most others
        keys = [k for k in keys if k != "encoding"]
    if not keys:
        return error
    lines = [f"{k} = {to_toml(getattr(found, k))}"
             + (f" instead of {k} = {to_toml(layout.said[k])}" if k in layout.said else "") for k in keys]
    reason = str(error).partition("; ")[0]
    return DataError(f"{reason}; lay the file out as it is, in the study: [data] {', '.join(lines)}")


def _lines(path, layout):
    """Yield blocks of whole lines from below the preamble on, without the last line break.

    Blank lines at the end of the file are not there.
    """
    breaks, above = "", layout.preamble
    for block in text_blocks(path, "utf-8-sig" if layout.encoding == "utf-8" else layout.encoding):
        block = breaks + block.replace("\r\n", "\n").replace("\r", "\n")
        if above:
            *_, block = block.split("\n", above)
            above = 0  # a preamble longer than the first block is no preamble
        kept = block.rstrip("\n")
        breaks = block[len(kept):]
        if kept:
            yield kept
            breaks = breaks[1:]  # the one that ends the last line yielded


def _filled(path, layout):
    """Yield the same blocks without lines that are blank, and the row of each line that is left."""
    row = layout.preamble + 1
    for block in _lines(path, layout):
        lines = block.count("\n") + 1
        kept = np.arange(lines)
        if re.search(r"^ *$", block, re.MULTILINE):
            every = block.split("\n")
            kept = np.flatnonzero([line.strip(" ") != "" for line in every])
            block = "\n".join(every[k] for k in kept)
        if kept.size:
            yield block, row + kept
        row += lines


def fields(line, separator):
    """Cells of a line.

    Parameters
    ----------
    line : str
        Without its end; quotes hold a cell together.
    separator : str
        As in `Layout`.

    Returns
    -------
    list of str
        Without blanks around them.
    """
    if separator == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _survey(path, wanted, layout):
    """Columns and number of rows, once every row has been found to have as many fields as there are columns."""
    blocks = _filled(path, layout)
    first, above = next(blocks, ("", np.zeros(0, dtype=int)))
    line, named = first.partition("\n")[0], layout.header
    header = fields(line, layout.separator)
    if not named:
        header = [str(k) for k in range(1, len(header) + 1)]
    _check_header(path, line, header, wanted, layout)
    if layout.units_row:
        _check_units(path, first, above, layout)
    rows = 0
    for block, at in itertools.chain([(first, above)] if first else [], blocks):
        counts = _fields(block, layout.separator)
        wrong = np.flatnonzero(counts != len(header))
        if layout.units_row and rows == 0:
            wrong = wrong[wrong != 1]  # units need not be told of every column
        if wrong.size:
            k = int(wrong[0])
            cut = counts[k] < len(header) and k == counts.size - 1 and next(blocks, None) is None
            raise DataError(f"{path}, row {at[k]}: has {counts[k]} fields, the "
                            f"{'header' if named else 'first row'} has {len(header)}"
                            f"{' (the log ends within a row)' if cut else ''}; repair or remove the row")
        rows += counts.size
    rows -= layout.above - layout.preamble
    if rows < 1:
        raise DataError(f"{path}: has a header but no data rows" if named else f"{path}: has no data rows")
    return header, rows


def _check_units(path, block, at, layout):
    """Refuse a row that is said to hold units and holds numbers: it would be a sample that is lost."""
    second = block.split("\n", 2)[1:2]
    cells = [cell for line in second for cell in fields(line, layout.separator) if cell]
    if cells and any(number(cell, layout.decimal) for cell in cells):
        raise DataError(f"{path}: row {at[1]} holds numbers, not units; take units_row out of [data]")


def _fields(block, separator):
    """Number of fields in each line."""
    if '"' in block or separator == " ":
        # a quoted field may hold commas; a quoted line break would shift every row number, so rows are lines here too
        return np.array([len(fields(line, separator) or [""]) for line in block.split("\n")])
    # a multibyte character never holds the bytes of a separator or a line break
    marks = np.frombuffer(block.encode(), dtype=np.uint8)
    ends = np.append(np.flatnonzero(marks == 10), marks.size)
    between = np.append(0, np.cumsum(marks == ord(separator)))[ends]
    return np.diff(between, prepend=0) + 1


def _tables(path, header, wanted, text, layout):
    """Yield the blocks of a file whose rows have the right length, without the rows above the first of numbers."""
    used = {name: k for k, name in enumerate(header) if name in wanted or name == text}
    above = layout.above - layout.preamble
    for block, rows in _filled(path, layout):
        while above and block:
            block, rows, above = block.partition("\n")[2], rows[1:], above - 1
        if block:
            yield _table(path, block, header, used, text, rows, layout)


def _table(path, block, header, used, text, rows, layout):
    kinds = {k: str if name == text else float for name, k in used.items()}
    options = dict(header=None, usecols=list(kinds), skip_blank_lines=False, skipinitialspace=True,
                   sep=r"\s+" if layout.separator == " " else layout.separator, decimal=layout.decimal)
    try:
        frame = pd.read_csv(io.StringIO(block), dtype=kinds, keep_default_na=True, **options)
    except ValueError as error:
        frame = pd.read_csv(io.StringIO(block), dtype=str, keep_default_na=False, **options)
        names = {k: n for n, k in used.items() if n != text}
        raise _laid_out_otherwise(path, layout, _offender(path, frame, names, rows, error, layout)) from None
    columns = {name: frame[k].fillna("").to_numpy(dtype=str) if name == text else frame[k].to_numpy(dtype=float)
               for name, k in used.items()}
    return Table(columns, header, rows)


def number(cell, decimal="."):
    """Whether a cell is a number.

    Parameters
    ----------
    cell : str
        As in the file.
    decimal : str
        Mark before the fraction.

    Returns
    -------
    bool
    """
    if decimal != "." and "." in cell:
        return False
    try:
        float(cell.replace(decimal, "."))
    except ValueError:
        return False
    return "_" not in cell  # which Python reads, and nothing else does


def _check_header(path, line, header, wanted, layout):
    for mark, word in ((";", "semicolons"), ("\t", "tabs")):
        if len(header) == 1 and mark in line and layout.separator == ",":
            raise DataError(f"{path}: columns are separated by {word}, not by commas; write the log with commas and "
                            "decimal points, or set [data] reader")
    if layout.header and len(header) > 1 and all(number(n, layout.decimal) for n in header):
        raise DataError(f"{path}: row {layout.preamble + 1} holds numbers, not the names of columns; say so in the "
                        "study: [data] header = false")
    for name in header:
        if name in wanted and header.count(name) > 1:
            raise DataError(f"{path}: column '{name}' is there {header.count(name)} times; keep one")


def _offender(path, frame, names, rows, error, layout):
    """The first cell that is not a number."""
    found = []
    for k, name in names.items():
        cells = frame[k].str.strip()
        numbers = pd.to_numeric(cells.str.replace(layout.decimal, "."), errors="coerce")
        bad = np.flatnonzero(numbers.isna() & ~cells.str.lower().isin(MISSING))
        if bad.size:
            found.append((int(bad[0]), name, cells.iloc[bad[0]]))
    if not found:
        return DataError(f"{path}: cannot be read as numbers ({error})")
    first, name, cell = min(found)
    hint = dated(frame[next(k for k, n in names.items() if n == name)].iloc[first:])
    if layout.decimal == "." and cell.replace(",", "", 1).lstrip("+-").isdigit():
        hint = '; use a decimal point' + (', or [data] decimal = ","' if layout.separator != "," else "")
    if rows[first] == 1 and not layout.header:
        hint = "; if the first row names the columns, remove header = false"
    return DataError(f"{path}, row {rows[first]}, column '{name}': '{cell[:40]}' is not a number{hint}")

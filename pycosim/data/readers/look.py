"""A log file nobody has described in; how it is laid out, what its columns are called, and some of its rows, out.

Only the head of a text file is looked at. What is found is proposed to who reads the log; no reader applies it unasked.
"""

from __future__ import annotations

import codecs
import itertools
from dataclasses import dataclass, field
from pathlib import Path

from ...core.errors import DataError
from ...study.layout import DECIMALS, PLAIN, SEPARATORS, Layout
from ...study.schema import known_unit
from . import READERS, read_parts, refuse_no_file, refuse_packed
from .comma import MISSING, fields, number

HEAD = 2**18
"""Bytes of a text file that are looked at: some thousand rows, far below any preamble."""
CLEAN = 0.9
"""Share of a column's cells that must be numbers for it to be one of numbers; the rest may be drop-outs."""
_RECORDERS = {"EPOS Studio Version:": "epos"}  # a text in the head that only this reader's files have


@dataclass(frozen=True)
class Look:
    """What the head of a log shows.

    Attributes
    ----------
    path : Path
        The log.
    layout : Layout
        Of a text file; the usual one for every other format.
    header : list of str
        Columns, as the reader names them.
    units : dict of str to str
        What the row below the header says, by column.
    numeric : list of str
        Columns that hold numbers.
    reader : str or None
        For `[data] reader`, where the ending does not say it.
    """

    path: Path
    layout: Layout
    header: list
    units: dict = field(default_factory=dict)
    numeric: list = field(default_factory=list)
    reader: str | None = None


def look(path):
    """Find how a log is laid out.

    Parameters
    ----------
    path : path
        Of any format that there is a reader for.

    Returns
    -------
    Look

    Raises
    ------
    DataError
        It is no file, or no table of numbers is in its head.
    """
    path = Path(path)
    refuse_no_file(path)
    refuse_packed(path)
    key = path.suffix.lower()
    reader = "bam" if key == ".json" else None
    if reader is None and READERS.get(key, "comma") == "comma":
        encoding, text = _head(path)
        reader = next((r for mark, r in _RECORDERS.items() if mark in text[:4000]), None)
        if reader is None:
            if key not in READERS:
                raise DataError(f"{path}: cannot tell the format from the ending '{path.suffix}'; rename it to .csv "
                                "where it is text in columns")
            return _table(path, encoding, text)
    header = next(read_parts(path, reader, set(), "")[1]).header
    return Look(path, PLAIN, header, numeric=[n for n in header if _reads(path, reader, n)], reader=reader)


def _reads(path, reader, name):
    """Whether a column of a format with types holds numbers."""
    try:
        return name in next(read_parts(path, reader, {name}, "")[1]).columns
    except DataError:
        return False


def _head(path):
    """Encoding and text of the first lines of a file."""
    with path.open("rb") as stream:
        raw = stream.read(HEAD)
        whole = not stream.read(1)
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encoding = "utf-16"
    elif b"\0" in raw:
        # two bytes a letter, and no mark that says in which order: numbers have their zeros on one side
        even, odd = raw[0::2].count(0), raw[1::2].count(0)
        encoding = "utf-16-le" if odd > 10 * even else "utf-16-be" if even > 10 * odd else None
        if encoding is None:
            raise DataError(f"{path}: is a binary file, not text; export the log as comma-separated text")
    else:
        encoding = "utf-8" if _decodes(raw, "utf-8", whole) else "cp1252" if _decodes(raw, "cp1252") else "latin-1"
    text = raw.decode("utf-8-sig" if encoding == "utf-8" else encoding, errors="ignore")
    return encoding, text if whole else text[:text.rfind("\n") + 1]


def _decodes(raw, encoding, whole=True):
    try:
        codecs.getincrementaldecoder(encoding)().decode(raw, whole)
    except UnicodeDecodeError:
        return False
    return True


def _table(path, encoding, text):
    """The layout under which most columns are numbers down to the end."""
    every = text.replace("\r\n", "\n").replace("\r", "\n").rstrip("\n").split("\n")
    at = [k for k, line in enumerate(every) if line.strip(" ")]  # lines that are not blank, which no reader counts
    lines = [every[k] for k in at]
    best, most = None, 0.0
    for separator, decimal in itertools.product(SEPARATORS, DECIMALS):
        found = _numbers(lines, separator, decimal) if lines else None
        if found is None:
            continue
        score = len(found[1]) ** 2 / found[2]  # many columns of numbers, and few of anything else
        if score > most:  # the first of equals is the more usual one
            best, most = (separator, decimal, *found), score
    if best is None:
        raise DataError(f"{path}: no table of numbers is in its first {len(every)} lines; export the log as "
                        "comma-separated text, one row a sample")
    separator, decimal, start, numeric, width = best
    names, preamble, units = _names(lines, separator, decimal, start, width)
    layout = Layout(names is not None, separator, decimal, encoding, at[preamble], units is not None)
    header = names or [str(k) for k in range(1, width + 1)]
    told = {n: u for n, u in zip(header, units or []) if u.strip("[]()-")}
    return Look(path, layout, header, told, [header[k] for k in numeric])


def _numbers(lines, separator, decimal):
    """First row of a table of numbers, its columns of numbers, and its width; None where there is no table."""
    tail = [fields(line, separator) for line in lines[len(lines) // 2:]]
    widths = [len(row) for row in tail]
    width = max(set(widths), key=widths.count)
    rows = [row for row in tail if len(row) == width]
    if width < 2 or len(rows) < CLEAN * len(tail):
        return None
    numeric = [k for k, cells in enumerate(zip(*rows))
               if any(number(c, decimal) for c in cells)
               and sum(number(c, decimal) or c.lower() in MISSING for c in cells) >= CLEAN * len(cells)]
    if len(numeric) < 2:
        return None
    for start, line in enumerate(lines):
        row = fields(line, separator)
        if len(row) == width and all(number(row[k], decimal) or row[k].lower() in MISSING for k in numeric) and any(
                number(row[k], decimal) for k in numeric):
            return start, numeric, width
    return None


def _names(lines, separator, decimal, start, width):
    """Names of the columns, lines above them, and units below them; None for what is not there."""
    above = [fields(line, separator) for line in lines[max(0, start - 2):start]]
    named = [len(row) == width and sum(map(bool, row)) > width / 2 for row in above]
    if not above or not named[-1]:
        units = above and len(above) == 2 and named[0] and _units(above[1])
        return (above[0], start - 2, above[1]) if units else (None, start, None)
    if len(above) == 2 and named[0] and _units(above[1]):
        return above[0], start - 2, above[1]
    return above[-1], start - 1, None


def _units(row):
    """Whether every cell of a row is a unit, or nothing."""
    bare = [cell.strip("[]() ") for cell in row]
    return any(bare) and all(not cell or cell == "-" or known_unit(cell) for cell in bare)

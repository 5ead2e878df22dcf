"""A log file of some format comes in; Tables of named columns go out. One module a format, registered here."""

from __future__ import annotations

import codecs
import importlib
import itertools
import re
import warnings
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from ...core.errors import DataError, StudyError, closest, closest_file
from ...study.layout import PLAIN

# name in `[data] reader`, or ending of the file: module with `read(path, wanted, text) -> Table`, or, where a file may
# be larger than memory, `parts(path, wanted, text) -> rows, iterator of Table`, see `read_parts`
READERS = {"bam": "bam", "epos": "epos", ".csv": "comma", ".txt": "comma", ".tsv": "comma", ".dat": "comma",
           ".asc": "comma", ".parquet": "parquet", ".pq": "parquet", ".mat": "matlab", ".mcap": "mcap",
           ".mf4": "mdf", ".mdf": "mdf"}


_STAMPS = 1000  # of a column, that its rate is told by
PACKED = (".gz", ".bz2", ".xz", ".zip", ".zst", ".7z")
"""Endings of files that hold another one."""
BLOCK = 2**22
"""Bytes of text that are held at a time."""


@dataclass
class Table:
    """What is in a file or in a part of it, before the study's columns are looked up.

    Attributes
    ----------
    columns : dict of str to ndarray, shape (n,)
        Numbers in the file's units, or text for the label column.
    header : list of str
        Every column of the file, also those not read.
    rows : ndarray of int, shape (n,)
        Row of each sample as an editor shows it.
    dropped : list of (int, int)
        Rows that the format itself says are not to be used.
    meta : dict
        What the file says about the run.
    """

    columns: dict
    header: list
    rows: np.ndarray
    dropped: list = field(default_factory=list)
    meta: dict = field(default_factory=dict)


def read_parts(path, name, wanted, text, layout=PLAIN):
    """Read a file with the reader of this name, or the one its ending asks for.

    Parameters
    ----------
    path : Path
        Its ending names the format, unless `name` does.
    name : str or None
        Reader, as in `[data] reader`.
    wanted : set of str
        Columns to read as numbers; those that the file lacks are left out.
    text : str
        Column to read as text.
    layout : Layout
        How a text file holds its table.

    Returns
    -------
    rows : int
        Rows of data in the file.
    tables : iterator of Table
        At least one, in order of rows; all have the same columns.

    Raises
    ------
    DataError
        The file is not there, its format cannot be told, or it cannot be read.
    """
    refuse_no_file(path)
    key = name or path.suffix.lower()
    if key not in READERS:
        if name:
            raise StudyError(f"no reader '{name}'{closest(name, [r for r in READERS if r[0] != '.'])}")
        refuse_packed(path)
        raise DataError(f"{path}: cannot tell the format from the ending '{path.suffix}'; use "
                        f"{', '.join(r for r in READERS if r[0] == '.')}, or set [data] reader")
    module = importlib.import_module(f".{READERS[key]}", __package__)
    if READERS[key] == "comma":
        return module.parts(path, wanted, text, layout)
    if layout.said:
        raise DataError(f"{path}: {layout.lines[0]} is for comma-separated text; remove it from [data]")
    if hasattr(module, "parts"):
        return module.parts(path, wanted, text)
    table = module.read(path, wanted, text)
    return table.rows.size, iter([table])


def refuse_no_file(path):
    """Raise DataError for what is not a file with something in it.

    Parameters
    ----------
    path : Path
        One that is missing, a folder, empty or not to be read is told in its own words.
    """
    if path.is_dir():
        raise DataError(f"{path}: is a folder; name the files in it")
    if not path.exists():
        raise DataError(f"no log {path}{closest_file(path, READERS)}")
    try:
        if path.stat().st_size == 0:
            raise DataError(f"{path}: the file is empty")
        path.open("rb").close()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from None


def refuse_packed(path):
    """Raise DataError for a file that holds a packed one.

    Parameters
    ----------
    path : Path
        Told by its ending.
    """
    if path.suffix.lower() in PACKED:
        raise DataError(f"{path}: is packed; unpack it, and name the file that was in it"
                        f"{f' (likely {path.stem})' if Path(path.stem).suffix else ''}")


def read_text(path, encoding="utf-8-sig"):
    """The text of a file, or DataError when it is not text.

    Parameters
    ----------
    path : Path
        Read whole.
    encoding : str
        As Python names it, as ``utf-8``.

    Returns
    -------
    str
    """
    return "".join(text_blocks(path, encoding))


def text_blocks(path, encoding="utf-8-sig"):
    """The text of a file in blocks of whole lines.

    Parameters
    ----------
    path : Path
        Of any size: a block is in memory at a time.
    encoding : str
        As Python names it, as ``utf-8``.

    Yields
    ------
    str
        Lines with their ends; only the last block may end without one.

    Raises
    ------
    DataError
        The file is not text.
    """
    if encoding.startswith("utf-16"):
        yield from _wide_blocks(path, encoding)
        return
    row = 1
    with Path(path).open("rb") as stream:
        while raw := stream.read(BLOCK) + stream.readline():
            if row == 1 and raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
                raise DataError(f"{path}: is UTF-16 text, not UTF-8; save the file as UTF-8")
            if b"\0" in raw:
                raise DataError(f"{path}: is a binary file, not text; export the log as comma-separated text")
            try:
                text = raw.decode(encoding)
            except UnicodeDecodeError as error:
                row += raw.count(b"\n", 0, error.start)
                name = encoding.removesuffix("-sig").upper()
                raise DataError(f"{path}, row {row}: is not {name} text; save the file as UTF-8, or set [data] "
                                "reader") from None
            yield text
            row += raw.count(b"\n")
            encoding = encoding.removesuffix("-sig")  # a byte-order mark stands at the start alone


def _wide_blocks(path, encoding):
    """Blocks of whole lines of text whose letters have two bytes, where a byte of a line break says nothing."""
    try:
        with Path(path).open(encoding=encoding, newline="") as stream:
            while text := stream.read(BLOCK) + stream.readline():
                yield text
    except UnicodeError:
        raise DataError(f"{path}: is not {encoding.upper()} text; set another [data] encoding, or none for "
                        "UTF-8") from None


def optional(path, package, module, kind, extra):
    """A module that only one format needs.

    Parameters
    ----------
    path : Path
        File that asks for it.
    package, module : str
        What to install, and what to import of it.
    kind, extra : str
        Name of the format, and the extra of this project that brings the package.

    Returns
    -------
    module

    Raises
    ------
    DataError
        It is not installed.
    """
    try:
        importlib.import_module(package)
        return importlib.import_module(module)
    except ImportError:
        raise DataError(f"{path}: {kind} files need {package}; "
                        f"pip install 'pycosim-drivetrain[{extra}]'") from None


def dated(cells):
    """What to do about cells that hold dates, as the end of a sentence; nothing for any other cells.

    Parameters
    ----------
    cells : sequence of str
        As in the file, one row after the other.

    Returns
    -------
    str
    """
    cells = [str(cell) for cell in itertools.islice(iter(cells), _STAMPS)]
    if not cells or not re.match(r"\d{4}-\d\d-\d\d|\d\d?[./]\d\d?[./]\d{4}|\d\d?:\d\d:\d\d", cells[0]):
        return ""
    rate = stamped(cells)
    instead = (f"; its stamps make {rate:.5g} rows a second, which can be said instead: [data] rate = {rate:.5g}, "
               'time_column = ""' if rate else ", or say the rows a second instead: [data] rate and time_column = \"\"")
    return f" but a date or a time of day; write seconds since the first row there{instead}"


def stamped(cells):
    """Rows a second, by dates or times of day.

    Parameters
    ----------
    cells : sequence
        One row after the other.

    Returns
    -------
    float or None
        [Hz]; None where they cannot be read, or do not rise evenly.

    Examples
    --------
    >>> stamped(["2025-06-01 10:00:00.00", "2025-06-01 10:00:00.01", "2025-06-01 10:00:00.02"])
    100.0
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # how it reads a date matters little to the time between two
        try:
            stamps = pd.to_datetime(pd.Series(list(cells)), format="mixed", errors="coerce", utc=True)
        except (ValueError, TypeError, OverflowError):
            return None
    if stamps.isna().any() or len(stamps) < 2:
        return None
    steps = stamps.diff().dt.total_seconds().to_numpy()[1:]
    whole = (stamps.iloc[-1] - stamps.iloc[0]).total_seconds() / steps.size
    step = float(np.median(steps)) if np.median(steps) > 0 else whole
    return float(f"{1 / step:.6g}") if step > 0 and abs(whole / step - 1) < 0.1 else None


def numbers(path, name, values):
    """A column as floats.

    Parameters
    ----------
    path : Path
        Named in what is refused.
    name : str
        Column.
    values : array_like, shape (n,)
        NaN or None where nothing was recorded.

    Returns
    -------
    ndarray, shape (n,)

    Raises
    ------
    DataError
        Some of it is no number.
    """
    values = np.asarray(values)
    if values.ndim != 1:
        shape = " x ".join(map(str, values.shape)) or "a single value"
        raise DataError(f"{path}, column '{name}': holds {shape}, not one number a sample")
    if values.dtype.kind in "mM":
        cells = np.datetime_as_string(values[:_STAMPS]) if values.dtype.kind == "M" else ["0:00:00"]
        raise DataError(f"{path}, column '{name}': holds {values.dtype}, not a number{dated(cells)}")
    if values.dtype.kind in "iuf":
        return values.astype(float)
    for k, value in enumerate(values.tolist(), 1):
        if value is not None and (isinstance(value, bool) or not isinstance(value, (int, float))):
            raise DataError(f"{path}, column '{name}': holds '{str(value)[:40]}' in sample {k}, not a number"
                            f"{dated(values[k - 1:])}")
    return np.array([np.nan if v is None else v for v in values.tolist()], dtype=float)


def one_clock(path, times):
    """The time of columns that were all sampled together.

    Parameters
    ----------
    path : Path
        Named in what is refused.
    times : dict of str to ndarray
        Time [s] of each column's samples.

    Returns
    -------
    ndarray, shape (n,)

    Raises
    ------
    DataError
        Two columns have clocks of their own: to interpolate between them is for who knows the signals.
    """
    (first, time), *others = times.items()
    for name, other in others:
        if len(other) != len(time) or not np.array_equal(other, time):
            raise DataError(f"{path}: columns '{first}' and '{name}' were not sampled at the same times ({len(time)} "
                            f"and {len(other)} samples); bring them to one clock, or map columns that share one")
    return time


def ranges(rows):
    """Sorted row numbers as stretches.

    Parameters
    ----------
    rows : sequence of int
        Increasing.

    Returns
    -------
    list of (int, int)
        First and last row of each.
    """
    rows = np.asarray(rows, dtype=int)
    if not rows.size:
        return []
    starts = np.flatnonzero(np.diff(rows, prepend=rows[0] - 2) > 1)
    ends = np.append(starts[1:], rows.size) - 1
    return [(int(rows[a]), int(rows[b])) for a, b in zip(starts, ends)]

"""A MAT file (MATLAB 4 to 7.2) of vectors, or of structs of vectors, comes in; a Table goes out.

A field ``tau`` of a struct ``log`` is the column ``log.tau``.
"""

from __future__ import annotations

import zlib

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from ...core.errors import DataError
from . import Table, numbers


def read(path, wanted, text):
    """Read the wanted vectors of a MAT file; see `pycosim.data.readers.read_parts`.

    Raises
    ------
    DataError
        The file is not MAT, is of version 7.3, or its columns are not vectors of one length.
    """
    try:
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise DataError(f"{path}: is a MAT file of version 7.3; save it with the option -v7") from None
    except (MatReadError, ValueError, OSError, EOFError, LookupError, TypeError, zlib.error) as error:
        why = next(iter(str(error).splitlines()), type(error).__name__)
        raise DataError(f"{path}: is not a MAT file, or is cut short ({why}); save it again, or export the log as "
                        "CSV") from None
    found = dict(_vectors({n: v for n, v in content.items() if not n.startswith("__")}))
    columns = {n: _labels(v) if n == text else numbers(path, n, v) for n, v in found.items() if n in wanted | {text}}
    sizes = {n: len(v) for n, v in columns.items()}
    for name, size in sizes.items():
        first = next(iter(sizes))
        if size != sizes[first]:
            raise DataError(f"{path}: column '{name}' has {size} values, '{first}' has {sizes[first]}; "
                            "a log has one of each a sample")
    return Table(columns, list(found), np.arange(next(iter(sizes.values()), 0)) + 1)


def _vectors(content, prefix=""):
    """Yield the names and values of all variables, those in structs by dotted names."""
    for name, value in content.items():
        if isinstance(value, dict):
            yield from _vectors(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _labels(values):
    """Cells, or the rows of a character array, as text."""
    return np.array([str(v).strip() if np.size(v) else "" for v in np.atleast_1d(np.asarray(values, dtype=object))])

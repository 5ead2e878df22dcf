"""A table in memory (pandas) in; a Table as the readers make it out."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ..core.errors import DataError
from .readers import Table


@dataclass(frozen=True, eq=False)
class Frame:
    """A log that is in memory already; it stands where a file's path would.

    Attributes
    ----------
    name : str
        Said in messages instead of a file's name.
    frame : pandas.DataFrame
        A row a sample, columns as a study names them. The index is a column too where it has a name.
    """

    name: str
    frame: pd.DataFrame

    def __str__(self):
        return self.name

    def __fspath__(self):
        raise DataError(f"{self.name}: is in memory, not in a file; write it to one first, as with to_csv")

    @property
    def sha256(self):
        """Hash of what is in the table."""
        rows = pd.util.hash_pandas_object(self.frame).to_numpy()
        return hashlib.sha256("\0".join(map(str, self.frame.columns)).encode() + rows.tobytes()).hexdigest()

    def parts(self, wanted, text):
        """The table, as `pycosim.data.readers.read_parts` gives a file's.

        Parameters
        ----------
        wanted : set of str
            Columns to take as numbers.
        text : str
            Column to take as text.

        Returns
        -------
        rows : int
        tables : iterator of Table
            One; its rows count from 0, as ``iloc`` does.

        Raises
        ------
        DataError
            A column is not numeric, is there twice, or there are no rows.
        """
        frame = self.frame.reset_index() if self.frame.index.name else self.frame
        header = [str(n) for n in frame.columns]
        if frame.empty:
            raise DataError(f"{self.name}: has no rows of data")
        columns = {}
        for k, name in enumerate(header):
            if name not in wanted and name != text:
                continue
            if name in columns:
                raise DataError(f"{self.name}: column '{name}' is there {header.count(name)} times; keep one")
            columns[name] = self._column(frame.iloc[:, k], name, name == text)
        return len(frame), iter([Table(columns, header, np.arange(len(frame)))])

    def _column(self, column, name, text):
        if text:
            return column.astype(object).where(column.notna(), "").to_numpy(dtype=str)
        types = pd.api.types
        if not types.is_numeric_dtype(column) or types.is_bool_dtype(column) or types.is_complex_dtype(column):
            how = {"m": "(t - t.iloc[0]).dt.total_seconds()", "M": "(t - t.iloc[0]).dt.total_seconds()",
                   "c": "numpy.real"}.get(column.dtype.kind, "pandas.to_numeric")
            raise DataError(f"{self.name}, column '{name}': holds {column.dtype}, not numbers; "
                            f"convert it first, as with {how}")
        return column.to_numpy(dtype=float, na_value=np.nan)

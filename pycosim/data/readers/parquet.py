"""A Parquet file comes in; Tables go out."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pandas as pd

from ...core.errors import DataError
from . import Table, dated, optional

_ROWS = 2**17  # held at a time


def parts(path, wanted, text):
    """Read the wanted columns of a Parquet file, part by part; see `pycosim.data.readers.read_parts`.

    Raises
    ------
    DataError
        pyarrow is not installed, the file is not Parquet, a column is not numeric, or there are no rows.
    """
    parquet = optional(path, "pyarrow", "pyarrow.parquet", "Parquet", "parquet")
    with _understood(path), parquet.ParquetFile(path) as file:
        header, rows = list(file.schema_arrow.names), file.metadata.num_rows
    used = [n for n in dict.fromkeys(header) if n in wanted or n == text]
    for name in used:
        if header.count(name) > 1:
            raise DataError(f"{path}: column '{name}' is there {header.count(name)} times; keep one")
    return rows, _tables(path, parquet, header, used, text)


@contextmanager
def _understood(path):
    try:
        yield
    except (OSError, ValueError) as error:  # pyarrow's own errors derive from these
        raise DataError(f"{path}: is not a Parquet file, or is cut short ({str(error).splitlines()[0].rstrip('.')}); "
                        "export the log again, or as CSV") from None


def _tables(path, parquet, header, used, text):
    row = 2
    # columns of a row group are streamed: else a file of one group is in memory whole
    with _understood(path), parquet.ParquetFile(path, pre_buffer=False, buffer_size=2**20) as file:
        batches = file.iter_batches(_ROWS, columns=used) if file.metadata.num_rows else [
            file.schema_arrow.empty_table().select(used)]
        for batch in batches:
            frame = batch.to_pandas(ignore_metadata=True)  # else an index hides a column
            columns = {n: frame[n].astype(object).fillna("").to_numpy(dtype=str) if n == text
                       else _numbers(path, n, frame[n], row) for n in used}
            yield Table(columns, header, np.arange(len(frame)) + row)
            row += len(frame)


def _numbers(path, name, column, row):
    if not pd.api.types.is_numeric_dtype(column) or pd.api.types.is_bool_dtype(column):
        cell = str(column.iloc[0])[:40] if len(column) else ""
        raise DataError(f"{path}, column '{name}': holds {column.dtype}, "
                        + (f"as '{cell}' in row {row}, not numbers{dated(column)}" if cell else "not numbers"))
    return column.to_numpy(dtype=float, na_value=np.nan)

"""A Parquet file comes in; a Table goes out."""

from __future__ import annotations

import numpy as np
import pandas as pd

from ..errors import DataError
from . import Table, optional


def read(path, wanted, text):
    """Read the wanted columns of a Parquet file; see `pycosim.readers.read_table`.

    Raises
    ------
    DataError
        pyarrow is not installed, the file is not Parquet, a column is not numeric, or there are no rows.
    """
    parquet = optional(path, "pyarrow", "pyarrow.parquet", "Parquet", "parquet")
    try:
        with parquet.ParquetFile(path) as file:
            header = list(file.schema_arrow.names)
            used = [n for n in dict.fromkeys(header) if n in wanted or n == text]
            for name in used:
                if header.count(name) > 1:
                    raise DataError(f"{path}: column '{name}' is there {header.count(name)} times; keep one")
            frame = file.read(columns=used).to_pandas(ignore_metadata=True)  # else an index hides a column
    except (OSError, ValueError) as error:  # pyarrow's own errors derive from these
        raise DataError(f"{path}: is not a Parquet file ({str(error).splitlines()[0]})") from None
    columns = {n: frame[n].fillna("").to_numpy(dtype=str) if n == text else _numbers(path, n, frame[n]) for n in used}
    return Table(columns, header, np.arange(len(frame)) + 2)


def _numbers(path, name, column):
    if not pd.api.types.is_numeric_dtype(column) or pd.api.types.is_bool_dtype(column):
        raise DataError(f"{path}, column '{name}': holds {column.dtype}, not numbers"
                        + (f", as '{str(column.iloc[0])[:40]}' in row 2" if len(column) else ""))
    return column.to_numpy(dtype=float, na_value=np.nan)

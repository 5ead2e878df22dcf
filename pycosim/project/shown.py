"""A table and a headline in; how an object shows in a shell and in a notebook out."""

from __future__ import annotations

import html
from typing import Any

import pandas as pd

ROWS = 12
"""Rows of a table that a notebook shows at most; `to_frame` has them all."""


class Shown:
    """Base of what the front door gives out: one line in a shell, a table in a notebook.

    Examples
    --------
    >>> import pandas as pd
    >>> class Two(Shown):
    ...     def _headline(self):
    ...         return "two numbers"
    ...     def to_frame(self):
    ...         return pd.DataFrame({"number": [1, 2]})
    >>> Two()
    <Two: two numbers>
    """

    def _headline(self) -> str:
        """What the object is, in a line."""
        raise NotImplementedError

    def to_frame(self) -> Any:
        """The same as a table.

        Returns
        -------
        pandas.DataFrame
        """
        raise NotImplementedError

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._headline()}>"

    def _repr_html_(self) -> str:
        frame: pd.DataFrame = self.to_frame()
        rest = len(frame) - ROWS
        more = f"<p>and {rest} more rows; <code>to_frame()</code> has all</p>" if rest > 0 else ""
        table = frame.head(ROWS).to_html(border=0, float_format=lambda v: f"{v:.4g}", na_rep="")
        return f"<p><b>{type(self).__name__}</b>: {html.escape(self._headline())}</p>{table}{more}"

"""A table and a headline in; how an object shows in a shell and in a notebook out."""

from __future__ import annotations

import html
from abc import ABC, abstractmethod
from os import PathLike
from pathlib import Path
from typing import Any

import pandas as pd

from ..core.errors import StudyError
from ..core.whole import write_whole
from ..report import records

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


class Recorded(Shown, ABC):
    """What a verb writes as a file of JSON, and an object can too."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """What the file of the verb holds.

        Returns
        -------
        dict
        """

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the file that the verb writes.

        Parameters
        ----------
        path : path
            A file of JSON; replaced where there is one.

        Returns
        -------
        Path

        Raises
        ------
        StudyError
            It cannot be written there.
        """
        try:
            return write_whole(path, records.to_json(self.to_dict()))
        except OSError as error:
            raise StudyError(f"{path}: cannot be written ({error.strerror}); save it elsewhere") from None

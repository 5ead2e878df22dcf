"""A table and a headline in; how an object shows in a shell and in a notebook, and its file of JSON, out."""

from __future__ import annotations

import copy
import html
import json
from abc import ABC, abstractmethod
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, Self

import pandas as pd

from ..core.errors import PycosimError, StudyError, UnknownNameError
from ..core.given import file_path
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


def xarray_module() -> Any:
    """xarray, where it is installed; every ``to_xarray`` asks for it here.

    Returns
    -------
    module

    Raises
    ------
    UnknownNameError
        It is not installed.
    """
    try:
        import xarray  # type: ignore[import-not-found, unused-ignore]
    except ModuleNotFoundError:
        raise UnknownNameError("xarray is not installed; pip install xarray, or use to_frame()") from None
    return xarray


class ResultError(PycosimError):
    """A file is no result of the kind that is asked for, or a result that was loaded does not hold what is asked."""


class Absent:
    """Stands for the log and the model in a result that was read from a file: whatever needs them says so.

    Parameters
    ----------
    path : Path
        The file.

    Examples
    --------
    >>> Absent(Path("diagnosis.json")).dataset
    Traceback (most recent call last):
    pycosim.project.shown.ResultError: diagnosis.json: a file of results holds no log and no fitted model, which this \
needs; open the study with pycosim.open() and compute it there
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # what Python, copy and notebooks probe an object for
            raise AttributeError(name)
        raise ResultError(f"{self.path}: a file of results holds no log and no fitted model, which this needs; open "
                          "the study with pycosim.open() and compute it there")


class Recorded(Shown, ABC):
    """What a verb writes as a file of JSON, and an object can too; what it shows comes from that record alone.

    Attributes
    ----------
    record : dict
        What the file holds; plain JSON with ``schema``, the number of its form.
    """

    FILE: ClassVar[str]
    """Name that the verb gives the file."""
    LEFT_BY: ClassVar[str]
    """The command that leaves it."""
    KEYS: ClassVar[tuple[str, ...]]
    """Keys of the record by which the file is known."""

    @property
    @abstractmethod
    def record(self) -> dict[str, Any]:
        """What the file of the verb holds."""

    @classmethod
    @abstractmethod
    def _loaded(cls, record: dict[str, Any], absent: Any) -> Self:
        """The object of a record; `absent` stands for what no file holds."""

    def to_dict(self) -> dict[str, Any]:
        """What the file of the verb holds.

        Returns
        -------
        dict
            A copy: changing it changes nothing else.
        """
        return copy.deepcopy(self.record)

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the file that the verb writes; `load` reads it again.

        Parameters
        ----------
        path : path
            Ends in ``.json``; a result that is there is replaced.

        Returns
        -------
        Path

        Raises
        ------
        StudyError
            It cannot be written there, or what is there is no result.
        """
        replaceable(path, ".json", f"a {self.FILE}", _is_result)
        try:
            return write_whole(path, records.to_json(self.record))
        except OSError as error:
            raise StudyError(f"{path}: cannot be written ({error.strerror}); save it elsewhere") from None

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read what `save`, or the command line, has written; no log is needed, and none is read.

        Parameters
        ----------
        path : path
            File of JSON.

        Returns
        -------
        object
            Shows the same, and has the same table. What needs the log says so with a `ResultError`.

        Raises
        ------
        ResultError
            It cannot be read, was cut off, is another kind of file, or comes from a newer pycosim.
        """
        return cls._made(read_json(file_path(path, cls.FILE), cls), Path(path))

    @classmethod
    def _made(cls, record: dict[str, Any], path: Path) -> Self:
        """The object of a record, tried out: what is missing inside shows now, not in the middle of a notebook."""
        other = next((c for c in _kinds() if _fits(record, c)), None)
        if not _fits(record, cls):
            raise ResultError(f"{path}: is no {cls.FILE}, as {cls.LEFT_BY} and save() leave it"
                              + (f"; it is a {other.FILE}, which pycosim.{other.__name__}.load reads" if other else ""))
        try:
            made = cls._loaded(record, Absent(path))
            made._repr_html_()
        except (LookupError, TypeError, ValueError, AttributeError) as error:
            raise ResultError(f"{path}: looks like a {cls.FILE}, but something in it is missing or of another kind "
                              f"({type(error).__name__}: {error}); have {cls.LEFT_BY} or save() write it "
                              "anew") from None
        return made


def read_json(path: str | PathLike[str], kind: Any) -> dict[str, Any]:
    """A record out of a file.

    Parameters
    ----------
    path : path
        UTF-8, nothing but JSON in it.
    kind : type
        The subclass of `Recorded` that it is to become.

    Returns
    -------
    dict

    Raises
    ------
    ResultError
        It cannot be read, is no whole file of JSON, or has a newer schema.
    """
    try:
        found = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ResultError(f"{path}: cannot be read ({error.strerror}); {kind.LEFT_BY} and save() leave a "
                          f"{kind.FILE}") from None
    except (ValueError, RecursionError) as error:  # of text, of JSON, or nested without end
        where = f" beyond line {error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        raise ResultError(f"{path}: is no whole file of JSON{where}; was it cut off? Have {kind.LEFT_BY} or save() "
                          "write it anew") from None
    schema = found.get("schema") if isinstance(found, dict) else None
    if isinstance(schema, int) and schema > records.SCHEMA:
        raise ResultError(f"{path}: has schema {schema}, and this pycosim knows {records.SCHEMA}; load it with the "
                          "newer pycosim that wrote it, or update")
    return found if isinstance(found, dict) else {}


def replaceable(path: str | PathLike[str], ending: str, what: str, known: Callable[[Path], bool]) -> Path:
    """Refuse to write under the name of something else.

    Parameters
    ----------
    path : path
        To be written.
    ending : str
        That it must have.
    what : str
        That is to be written, in words.
    known : callable
        Whether a file that is there is of the same kind, and may be replaced.

    Returns
    -------
    Path

    Raises
    ------
    StudyError
        The name has another ending, or the file there is of another kind.
    """
    target = file_path(path, f"name{ending}")
    if target.suffix.lower() != ending:
        raise StudyError(f"{path}: does not end in {ending}, as {what} does; save it as {target.with_suffix(ending)}"
                         if target.name else f"'{path}' names no file; save {what} as name{ending}")
    if target.is_file() and not known(target):
        raise StudyError(f"{path}: is there already and is not {what}, so it is not replaced; save under another name")
    return target


def _is_result(path: Path) -> bool:
    """Whether a file is one of JSON that pycosim wrote."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(found, dict) and "schema" in found


def _fits(record: dict[str, Any], kind: Any) -> bool:
    return record.get("schema") == records.SCHEMA and set(kind.KEYS) <= set(record)


def _kinds() -> list[type[Recorded]]:
    return [c for c in Recorded.__subclasses__() if not c.__abstractmethods__]

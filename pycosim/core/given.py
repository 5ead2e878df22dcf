"""What somebody gave to a function in; the same, or one sentence that says what it takes, out."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from typing import Any

from .errors import PycosimError

LONGEST = 255
"""Bytes of a name that a file can have."""


def shortened(value: Any) -> str:
    """What somebody gave, on one line, for a message.

    Parameters
    ----------
    value : object
        Anything.

    Returns
    -------
    str
        Its value where that is short, else its kind.

    Examples
    --------
    >>> shortened(3), shortened("one\\ntwo")
    ('3', 'a str of 2 lines')
    """
    text = repr(value)
    if isinstance(value, str) and "\n" in value:
        return f"a str of {len(value.splitlines())} lines"
    return text if len(text) <= 60 and "\n" not in text else f"a {type(value).__name__}"


def file_path(path: Any, example: str) -> Path:
    """The name of a file or a folder.

    Parameters
    ----------
    path : path
        As it was given.
    example : str
        Such a name, for the message.

    Returns
    -------
    Path

    Raises
    ------
    PycosimError
        It is none.

    Examples
    --------
    >>> file_path("run.csv", "run.csv").suffix
    '.csv'
    """
    named = isinstance(path, PathLike) or (isinstance(path, str) and path and not {"\0", "\n"} & set(path))
    if named and all(len(part.encode()) <= LONGEST for part in Path(path).parts):
        return Path(path)
    raise PycosimError(f"{shortened(path)} is no name of a file; give one as a text, \"{example}\", or a pathlib.Path")


def whole_number(value: Any, name: str, example: int) -> int:
    """A number of things.

    Parameters
    ----------
    value : int
        Not below zero.
    name : str
        What it is, for the message.
    example : int
        Such a number, for the message.

    Returns
    -------
    int

    Raises
    ------
    PycosimError
        It is no whole number, or below zero.

    Examples
    --------
    >>> whole_number(3, "sets", 100)
    3
    """
    if isinstance(value, Integral) and not isinstance(value, bool) and value >= 0:
        return int(value)
    raise PycosimError(f"{name} must be a whole number, zero or more, as {example}, not {shortened(value)}")


def real_number(value: Any, name: str, example: float) -> float:
    """A quantity.

    Parameters
    ----------
    value : float
        As it was given.
    name : str
        What it is, for the message.
    example : float
        Such a number, for the message.

    Returns
    -------
    float

    Raises
    ------
    PycosimError
        It is no number.

    Examples
    --------
    >>> real_number(120, "budget", 120.0)
    120.0
    """
    if isinstance(value, Real) and not isinstance(value, bool):
        return float(value)
    raise PycosimError(f"{name} must be a number, as {example:g}, not {shortened(value)}")


def one_of(value: Any, name: str, known: Sequence[Any]) -> Any:
    """One of a few words or numbers.

    Parameters
    ----------
    value : object
        As it was given.
    name : str
        What it is, for the message.
    known : sequence
        What it may be.

    Returns
    -------
    object

    Raises
    ------
    PycosimError
        It is none of them.

    Examples
    --------
    >>> one_of("fit", "part", ("fit", "test"))
    'fit'
    """
    if any(type(value) is type(k) and value == k for k in known):
        return value
    raise PycosimError(f"{name} = {shortened(value)} is unknown; use {' or '.join(map(repr, known))}")

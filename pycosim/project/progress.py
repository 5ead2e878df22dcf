"""Sentences on what long work is doing in; a line in a notebook, or silence, out."""

from __future__ import annotations

import html
import sys
import time
from collections.abc import Callable
from typing import Any

from ..core.early import tell_early

Say = Callable[[str], None]
"""Called with a sentence before each stage of long work."""


class NotebookLine:
    """One line below a notebook's cell, which says what is going on and goes when it is done."""

    def __init__(self) -> None:
        self._handle: Any = None
        self._began = 0.0

    def __call__(self, text: str) -> None:
        from IPython.display import HTML, display  # type: ignore[import-not-found, unused-ignore]
        if self._handle is None:
            self._handle, self._began = display(HTML(""), display_id=True), time.monotonic()
        self._handle.update(HTML(f"<small>{html.escape(text)} ({time.monotonic() - self._began:.0f} s)</small>"))

    def done(self) -> None:
        """Take the line away."""
        if self._handle is not None:
            from IPython.display import HTML  # type: ignore[import-not-found, unused-ignore]
            self._handle.update(HTML(""))
            self._handle = None


def usual() -> Say:
    """What a project says its stages to when nothing is given.

    Returns
    -------
    callable
        A `NotebookLine` in a notebook; elsewhere it says nothing.
    """
    interactive = sys.modules.get("IPython")
    shell = interactive.get_ipython() if interactive else None
    return NotebookLine() if shell is not None and hasattr(shell, "kernel") else silent


def silent(text: str) -> None:
    """Say nothing.

    Parameters
    ----------
    text : str
        What would be said.
    """


class Continued:
    """Passes on what long work says, but for its first partial answer, where that was given before.

    Parameters
    ----------
    say : callable
        Told every sentence; partial answers too where it has a method ``early``.
    given : bool
        Whether it was.
    several : bool
        Whether later ones are answers too: a search has one a step, a diagnosis looks at larger models for itself.
    """

    def __init__(self, say: Say, given: bool, several: bool = True) -> None:
        self.say, self.given, self.several = say, given, several

    def __call__(self, text: str) -> None:
        self.say(text)

    def early(self, text: str) -> None:
        """Pass a partial answer on.

        Parameters
        ----------
        text : str
            The answer, in sentences.
        """
        if not self.given:
            tell_early(self.say, text)
        self.given = not self.several


def finish(say: Say) -> None:
    """Say that the work is done.

    Parameters
    ----------
    say : callable
        Its method ``done`` is called, where it has one.
    """
    done = getattr(say, "done", None)
    if done is not None:
        done()

"""What long work is doing in; a line on a terminal, and nothing where that is piped, out."""

from __future__ import annotations

import shutil
import sys
import time

_CLEAR = "\r\x1b[K"  # to the start of the line, and nothing on it

# --- progress and output --------------------------------------------------------------------------------------------


class Progress:
    """Sentences about what is going on, on a terminal only."""

    def __init__(self, quiet):
        self.shown = not quiet and sys.stderr.isatty()
        self.start = time.monotonic()

    def __enter__(self):
        self("reading")
        return self

    def __exit__(self, *_):
        self.stop()

    def stop(self):
        """Say no more."""
        if self.shown:
            print(_CLEAR, end="", file=sys.stderr, flush=True)

    def early(self, text):
        """Leave a partial answer on a line of its own.

        Parameters
        ----------
        text : str
            The answer, in sentences.
        """
        if self.shown:
            print(f"{_CLEAR}{text} ({time.monotonic() - self.start:.0f} s)", file=sys.stderr, flush=True)

    def __call__(self, text):
        if self.shown:
            line = f"{text} ({time.monotonic() - self.start:.0f} s)"
            print(_CLEAR + line[:shutil.get_terminal_size().columns - 1], end="", file=sys.stderr, flush=True)

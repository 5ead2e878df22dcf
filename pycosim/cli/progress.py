"""What long work is doing in; a line on a terminal, and nothing where that is piped, out."""

from __future__ import annotations

import sys
import time

# --- progress and output --------------------------------------------------------------------------------------------


class Progress:
    """Sentences about what is going on, on a terminal only."""

    def __init__(self, quiet):
        self.status = None
        if not quiet and sys.stderr.isatty():
            from rich.console import Console
            self.status = Console(stderr=True).status("reading")
        self.start = time.monotonic()

    def __enter__(self):
        if self.status:
            self.status.start()
        return self

    def __exit__(self, *_):
        self.stop()

    def stop(self):
        """Say no more."""
        if self.status:
            self.status.stop()

    def __call__(self, text):
        if self.status:
            self.status.update(f"{text} ({time.monotonic() - self.start:.0f} s)")

"""Work in; the same work in the background, with what it is doing and a way to give it up, out."""

from __future__ import annotations

import time


class Cancelled(Exception):
    """The work was given up."""


class Job:
    """Progress of one piece of work: called with a sentence before each stage, where it can be given up.

    Attributes
    ----------
    text : str
        The present stage.
    cancelled : bool
    """

    def __init__(self):
        self.text, self.cancelled, self.began = "starting", False, time.monotonic()

    def __call__(self, text):
        if self.cancelled:
            raise Cancelled
        self.text = text

    @property
    def told(self):
        """The stage, and for how long the work has gone on."""
        return f"{self.text} ({time.monotonic() - self.began:.0f} s)"

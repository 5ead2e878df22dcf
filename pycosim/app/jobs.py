"""Work in; the same in the background, with what is done, what goes on, what is left, and a way to give it up, out."""

from __future__ import annotations

import time


class Cancelled(Exception):
    """The work was given up."""


class Job:
    """Progress of one piece of work: called with a sentence before each stage, where it can be given up.

    Parameters
    ----------
    place : str
        Button that began it.
    stages : sequence of str
        How the sentences of its stages begin, in their order.

    Attributes
    ----------
    text : str
        The present stage.
    cancelled : bool
        Whether somebody asked to give the work up; at its next stage it ends.
    known : list of str
        Partial answers so far.
    """

    def __init__(self, place="", stages=()):
        self.place, self.stages = place, tuple(stages)
        self.text, self.cancelled, self.began, self._at = "starting", False, time.monotonic(), -1
        self.known = []

    def __call__(self, text):
        if self.cancelled:
            raise Cancelled
        self.text = text
        found = [k for k, stage in enumerate(self.stages) if k >= self._at and text.startswith(stage)]
        self._at = found[0] if found else self._at

    def early(self, text):
        """Take a partial answer.

        Parameters
        ----------
        text : str
            The answer, in sentences.
        """
        self.known = [*self.known, text]

    @property
    def told(self):
        """The stage, and for how long the work has gone on."""
        if self.cancelled:
            return "giving up at the next stage"
        return f"{self.text} ({time.monotonic() - self.began:.0f} s)"

    @property
    def done(self):
        """Stages that are behind it."""
        return self.stages[:max(0, self._at)]

    @property
    def left(self):
        """Stages that are before it."""
        return self.stages[self._at + 1:]

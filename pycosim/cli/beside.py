"""A search in; what it will need compiled, some of its fits, and its figures drawn, on a second core meanwhile, out."""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, suppress
from threading import Thread

from ..compile import compile_model, places, ranked, shared_library
from ..compile.contribution import effect_question
from ..core.executors import aided, executor
from ..data.sent import Sent

LARGEST = 200_000  # samples of a data set that is made a second time in the other process


class Beside:
    """A process beside this one, where there is a second core for it: compiles ahead, fits, draws figures.

    Parameters
    ----------
    library : Library
        Tells what it will compile next.
    rig : str, optional
        Full name of the class whose candidates are compiled at once.

    Attributes
    ----------
    pool : concurrent.futures.Executor
        Of one process; without a second core, what works at once in this one.
    """

    def __init__(self, library, rig=None):
        self._rig = rig
        self._library, self._usual = library, library.ahead
        self._two = (os.cpu_count() or 1) > 1
        self._where = executor("processes" if self._two else "serial", 1)
        self._waiting, self._failed, self._feeder = deque(), [], Thread(target=self._feed, daemon=True)

    def __enter__(self):
        self.pool, self._library.ahead = self._where.__enter__(), self.ahead
        self.compile(self._rig)  # what it needs is imported by the time that it is needed
        return self

    def __exit__(self, *error):
        self._waiting.clear()
        self._library.ahead = self._usual
        return self._where.__exit__(*error)

    def compile(self, rig=None):
        """Have compiled what the diagnosis of a rig will ask for; found in the cache on disk, or compiled then.

        Parameters
        ----------
        rig : str, optional
            Full name of the class; without one, what it needs is imported.
        """
        self._submit(_compile, rig)

    def ahead(self, rig, attached):
        """Have models compiled, the last first: this process begins with the first.

        Parameters
        ----------
        rig : str
            Full name of the class, as ``DriveTrain.Rigs.HipKnee``.
        attached : list of list of (str, str)
            Effects and places of each.
        """
        for effects in reversed(attached):
            self._submit(_compile_model, rig, effects)

    def _submit(self, function, *arguments):
        with suppress(BrokenExecutor):  # then this process does it, when it comes there
            if self._two:
                self.pool.submit(function, *arguments)

    @contextmanager
    def fits(self, dataset):
        """Share the fits of a search that do not need each other with the process; none that has other work beside it.

        Parameters
        ----------
        dataset : Dataset
            That is searched; one that is large is not kept twice.

        Yields
        ------
        None
            For a ``with`` block, all of whose searches it holds for.
        """
        if self._two and len(dataset.time) <= LARGEST and multiprocessing.parent_process() is None:
            self._submit(_received, Sent(dataset.calm))
            with aided(self.pool):
                yield
        else:
            yield

    def save(self, *plot):
        """Have a plot drawn.

        Parameters
        ----------
        *plot
            As `figures.save` takes it.
        """
        self._waiting.append(plot)

    def begin(self):
        """Draw what waits, meanwhile."""
        if self._two:
            self._feeder.start()

    def _feed(self):
        for plot in _taken(self._waiting):
            try:
                self.pool.submit(_save, *plot).result()
            except Exception:  # the process ended, or cannot draw it; this one will, or tell why not
                self._failed.append(plot)

    def finish(self):
        """Draw what nobody has begun, and wait for the rest."""
        for plot in _taken(self._waiting):
            _save(*plot)
        if self._two:
            self._feeder.join()
        for plot in self._failed:
            _save(*plot)


def _save(*plot):
    """Draw a plot; nothing of that is imported where none is wanted."""
    from ..report import figures
    figures.save(*plot)


def _received(sent):
    """Have a data set at hand before the first fit asks for it."""
    return len(sent.dataset.time)


def _compile(rig):
    library = shared_library()
    for probes in (False, True) if rig else ():
        _compile_model(rig, (), probes)
    for effect in ranked(library) if rig else ():
        if places(library, rig, effect):
            effect_question(library, effect)


def _compile_model(rig, attached, probes=False):
    model = compile_model(shared_library(), rig, attached, probes)
    return len(model.parameters), len(model.question("estimate").outputs)  # both are kept now


def _taken(waiting):
    """What waits, taken out one by one, also where others take too."""
    while True:
        try:
            yield waiting.popleft()
        except IndexError:
            return

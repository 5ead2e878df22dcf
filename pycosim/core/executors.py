"""A word for where to compute, and work, in; an executor of Python's `concurrent.futures`, and what was done, out."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from queue import Empty, SimpleQueue

from .errors import PycosimError, closest

WORDS = ("serial", "threads", "processes")
DASK = "dask://"
PATIENCE = 10  # s, for a scheduler of dask to answer
HEEDED = 1.0  # s after which an interrupt is seen that came just as waiting began
_POOL = ContextVar("pool", default=None)


class ExecutorError(PycosimError):
    """There is nowhere of that name to compute."""


class Serial(Executor):
    """Does the work at once, where it was asked for."""

    def submit(self, function, /, *arguments, **options):
        """Do a piece of work; see `concurrent.futures.Executor.submit`.

        Parameters
        ----------
        function : callable
            Called before this returns.
        *arguments, **options
            Its own.

        Returns
        -------
        concurrent.futures.Future
            Finished.
        """
        future = Future()
        try:
            future.set_result(function(*arguments, **options))
        except Exception as error:
            future.set_exception(error)
        return future


@contextmanager
def executor(where, workers=None, imports=()):
    """Where to compute.

    Parameters
    ----------
    where : str
        ``serial``, ``threads``, ``processes``, or ``dask://host:port``, a scheduler of dask.distributed.
    workers : int, optional
        Threads or processes; as many as there are cores by default.
    imports : sequence of str
        Modules that all the work needs. Where the system can fork, one process of Python's own imports them once, and
        the workers are forked from it; what the environment says then is what they know.

    Yields
    ------
    concurrent.futures.Executor, or one that behaves like it
        Ended when the block is left.

    Raises
    ------
    ExecutorError
        No such place, or it does not answer.
    """
    where = str(where)
    if where.startswith(DASK):
        with _dask(f"tcp://{where.removeprefix(DASK)}") as pool:
            yield pool
        return
    if where not in WORDS:
        raise ExecutorError(f"--on {where}: there is no such place to compute{closest(where, [*WORDS, DASK])}")
    if where == "serial":
        yield Serial()
        return
    workers, others = workers or os.cpu_count() or 1, multiprocessing.active_children()
    if where == "threads":
        pool = ThreadPoolExecutor(workers)
    else:
        pool = _Processes(workers, _begun(imports))
    try:
        yield pool
    except (KeyboardInterrupt, GeneratorExit):  # the latter where who took results of `each` stops taking them
        for process in multiprocessing.active_children():
            if process not in others:
                process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def each(work, where="serial", workers=None, imports=()):
    """Do pieces of work that do not need each other; every loop over studies, cases and seeds is this one.

    A piece whose process was killed is done again, by itself: of all that were under way, one ended the pool.

    Parameters
    ----------
    work : dict
        By key, a function and its arguments; what is done elsewhere must be known there by name.
    where, workers, imports
        As for `executor`.

    Yields
    ------
    key : object
        Of a piece of work that is done.
    future : concurrent.futures.Future
        Finished, as pieces come; its ``result()`` raises what the work raised. `lost` tells of one that was killed
        again.

    Raises
    ------
    ExecutorError
        There is nowhere of that name to compute.

    Examples
    --------
    >>> {key: future.result() for key, future in each({"two": (abs, -2), "one": (abs, -1)})}
    {'two': 2, 'one': 1}
    """
    killed = []
    with executor(where, workers, imports) as pool:
        if isinstance(pool, Serial):  # one after the other, so that each is told before the next begins
            done = ((pool.submit(*piece), key) for key, piece in work.items())
        else:
            futures = {pool.submit(*piece): key for key, piece in work.items()}
            done = ((future, futures[future]) for future in _ended(futures))
        for future, key in done:
            if lost(future.exception()):
                killed.append(key)
            else:
                yield key, future
    for key in killed:
        with executor(where, 1, imports) as pool:
            future = pool.submit(*work[key])
            list(_ended([future]))
        yield key, future


def _ended(futures):
    """Futures, as they end.

    Whoever waits for them without an end may never see an interrupt: Python looks for it before it waits, not as it
    begins to. And one that comes while a future is locked may leave it locked, for whoever ends the pool.
    """
    ended, left = SimpleQueue(), len(futures)
    with _uninterrupted():
        for future in futures:
            future.add_done_callback(ended.put)
    while left:
        try:
            future = ended.get(timeout=HEEDED)
        except Empty:
            continue
        left -= 1
        yield future


@contextmanager
def _uninterrupted():
    """An interrupt that comes in the block comes after it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came = []
    usual = signal.signal(signal.SIGINT, lambda *what: came.append(what))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
        if came and callable(usual):
            usual(*came[0])


@contextmanager
def computing(where="serial", workers=None, imports=("pycosim.diagnosis.search",)):
    """Where fits that do not need each other are computed, of all that is done in a block.

    The answers are the same everywhere. Results of another process are those of this one only if both round alike: set
    OMP_NUM_THREADS=1 before Python starts, as the command line does.

    Parameters
    ----------
    where : str
        ``serial``, ``threads``, ``processes``, or ``dask://host:port``, a scheduler of dask.distributed.
    workers : int, optional
        Threads or processes; as many as there are cores by default.
    imports : sequence of str
        As for `executor`.

    Yields
    ------
    None
        For a ``with`` block, all of whose searches it holds for.

    Raises
    ------
    ExecutorError
        No such place, or it does not answer.

    Examples
    --------
    >>> import pycosim as pc
    >>> with pc.computing("processes", workers=4):          # doctest: +SKIP
    ...     found = pc.open("study.toml").improve()

    A script that does so keeps it below ``if __name__ == "__main__":``, for its processes import it.
    """
    with executor(where, workers, imports) as pool:
        before = _POOL.set(pool)
        try:
            yield
        finally:
            _POOL.reset(before)


@contextmanager
def aided(pool):
    """Fits that do not need each other are computed here, and by a pool of one process what is left of them meanwhile.

    This process begins with the first of them, the other with the last: neither waits for more than one. The answers
    are those of `computing`.

    Parameters
    ----------
    pool : concurrent.futures.Executor
        Of one process; it may have other work as well.

    Yields
    ------
    None
        For a ``with`` block, all of whose searches it holds for.
    """
    before = _POOL.set(_Aid(pool))
    try:
        yield
    finally:
        _POOL.reset(before)


class _Aid:
    """A pool that is given the last piece of what nobody has begun, and then the next."""

    def __init__(self, pool):
        self.pool = pool

    def shared(self, work):
        """Results of pieces of work, in their order."""
        left, given, lock = deque(range(len(work))), {}, threading.RLock()

        def give(done=None):
            if done is not None and not done.cancelled() and lost(done.exception()):
                return  # a pool that ends its futures has no ear for more
            with lock, suppress(BrokenExecutor):
                if left:
                    given[left[-1]] = self.pool.submit(*work[left[-1]])
                    given[left.pop()].add_done_callback(give)

        give()
        try:
            for number, (function, *arguments) in enumerate(work):
                with lock:
                    mine = bool(left) and left[0] == number
                    if mine:
                        left.popleft()
                if not mine and given[number].cancel():  # it had other work
                    mine = True
                if not mine:
                    list(_ended([given[number]]))
                    mine = lost(given[number].exception())
                yield function(*arguments) if mine else given[number].result()
        finally:
            left.clear()
            for future in given.values():
                future.cancel()


def in_turn(work):
    """Results of pieces of work that do not need each other, in their order; computed where `computing` says.

    A piece whose process was killed is done again here.

    Parameters
    ----------
    work : iterable of (callable, argument, ..)
        What is done elsewhere must be known there by name.

    Yields
    ------
    object
        What the piece returned; what it raised is raised.

    Examples
    --------
    >>> list(in_turn([(abs, -2), (max, 1, 3)]))
    [2, 3]
    """
    pool = _POOL.get()
    if pool is None or isinstance(pool, Serial):  # one after the other, so that what is not asked for is not done
        for function, *arguments in work:
            yield function(*arguments)
        return
    if isinstance(pool, _Aid):
        yield from pool.shared(list(work))
        return
    futures = [(pool.submit(*piece), piece) for piece in work]
    try:
        for future, (function, *arguments) in futures:
            list(_ended([future]))
            yield function(*arguments) if lost(future.exception()) else future.result()
    finally:
        for future, _ in futures:
            future.cancel()


def _begun(imports):
    """How processes begin: never as a fork of this one, which would copy locks that its threads hold."""
    if not imports or "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(imports))
    return context


class _Processes(ProcessPoolExecutor):
    """Processes that leave Ctrl-C to the one that started them: each would answer it with a traceback."""

    def submit(self, function, /, *arguments, **options):
        if threading.current_thread() is not threading.main_thread():
            return super().submit(function, *arguments, **options)
        usual = signal.signal(signal.SIGINT, signal.SIG_IGN)  # a process that starts has it from here
        try:
            return super().submit(function, *arguments, **options)
        finally:
            signal.signal(signal.SIGINT, usual)


def lost(error):
    """Whether a piece of work failed because the process that did it ended, and not by what it did.

    Parameters
    ----------
    error : Exception or None
        Of its future.

    Returns
    -------
    bool
    """
    return isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker"  # dask's, which may not be here


@contextmanager
def _dask(address):
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise ExecutorError("--on dask://HOST:PORT needs dask; pip install 'pycosim-drivetrain[dask]'") from None
    try:
        client = Client(address, timeout=PATIENCE)
    except (OSError, TimeoutError) as error:
        raise ExecutorError(f"no scheduler of dask answers at {address} ({error}); start one with 'dask scheduler', "
                            "and workers with 'dask worker HOST:PORT'") from None
    with client, client.get_executor() as pool:
        yield pool


__all__ = ["ExecutorError", "Serial", "aided", "computing", "each", "executor", "in_turn", "lost"]

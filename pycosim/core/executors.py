"""A word for where to compute in; an executor of Python's `concurrent.futures` out."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager

from .errors import PycosimError, closest

WORDS = ("serial", "threads", "processes")
DASK = "dask://"
PATIENCE = 10  # s, for a scheduler of dask to answer


class ExecutorError(PycosimError):
    """There is nowhere of that name to compute."""


class Serial(Executor):
    """Does the work at once, where it was asked for."""

    def submit(self, function, /, *arguments, **options):
        """Do a piece of work; see `concurrent.futures.Executor.submit`.

        Parameters
        ----------
        function : callable
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
def executor(where, workers=None):
    """Where to compute.

    Parameters
    ----------
    where : str
        ``serial``, ``threads``, ``processes``, or ``dask://host:port``, a scheduler of dask.distributed.
    workers : int, optional
        Threads or processes; as many as there are cores by default.

    Yields
    ------
    concurrent.futures.Executor, or one that behaves like it

    Raises
    ------
    ExecutorError
        No such place, or it does not answer.
    """
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
    else:  # spawned: a fork would copy locks that other threads hold
        pool = _Processes(workers, multiprocessing.get_context("spawn"))
    try:
        yield pool
    except KeyboardInterrupt:
        for process in multiprocessing.active_children():
            if process not in others:
                process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


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
    error : Exception
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


__all__ = ["ExecutorError", "Serial", "executor", "lost"]

"""Time several studies, improved one after the other, against ``--on``: ``python -m benchmarks.speed.batch``.

What was compiled is in the cache on disk on both sides, and the plain loop has imported what it needs; each study is a
log of its own of the demo's machine. A core's time is compared as well as the clock's, which a busy machine bends.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from multiprocessing import forkserver
from pathlib import Path


def made(count, folder):
    """Studies of logs with noise of their own.

    Parameters
    ----------
    count : int
    folder : Path

    Returns
    -------
    list of Path
    """
    from pycosim.cli import demo
    from pycosim.compile import shared_library
    from pycosim.report.folder import Folder
    found = []
    for seed in range(count):
        with Folder(folder / f"log{seed}", "demo") as one:
            demo._make(shared_library(), one, seed=seed, speeds=(0.4, 1.6), longest=2.0)
        found.append(one.path / "study.toml")
    return found


def plain(studies, folder):
    """A loop over the verb."""
    from pycosim.cli import main
    for k, study in enumerate(studies):
        if main(["improve", str(study), "--out", str(folder / f"plain{k}"), "--quiet"]):
            raise SystemExit(f"{study} cannot be improved")


def main():
    """Print the times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=8)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy, on every side
    import numpy as np
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        studies = made(args.studies, folder)
        plain(studies, folder / "warm")
        places = [("serial", 1), ("processes", 1), ("processes", args.workers)]
        loops, times = [], {place: [] for place in places}
        for k in range(args.rounds):  # in turn, so that what else the machine does meets all of them
            loops.append(timed(plain, studies, folder / f"loop{k}"))
            for where, workers in places:
                times[where, workers].append(timed(engine, studies, folder / f"{where}{workers}_{k}", where, workers))
        loop, work = np.median(loops, axis=0)
        print(f"a plain loop over {len(studies)} studies: {loop:.1f} s, {work:.1f} s of a core (medians of "
              f"{args.rounds})")
        for (where, workers), found in times.items():
            took, used = np.median(found, axis=0)
            each = ", ".join(f"{u / w - 1:+.1%}" for (_, u), (_, w) in zip(found, loops))
            print(f"--on {where} --workers {workers}: {took:.1f} s, {used / work - 1:+.1%} of a core's time ({each}; "
                  "the aim is 10 %)")


def engine(studies, folder, where, workers):
    """The many-studies engine."""
    from pycosim.cli.batch import improve_all
    failed = [row for row in improve_all(studies, folder, where, workers) if row["failure"]]
    if failed:
        raise SystemExit(f"failed: {failed}")


def timed(work, *arguments):
    """Seconds by the clock, and of a core."""
    begin, used = time.perf_counter(), cores()
    work(*arguments)
    return time.perf_counter() - begin, cores() - used


def cores():
    """Seconds that this process and those that it has waited for have kept a core busy."""
    forkserver._forkserver._stop()  # Python's own, which waits for the workers: what both have used counts only then
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


if __name__ == "__main__":
    main()

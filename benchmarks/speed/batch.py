"""Time several studies, improved one after the other, against ``--on``: ``python -m benchmarks.speed.batch``.

What was compiled is in the cache on disk on both sides; each study is a log of its own of the demo's machine.
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
    args = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy, on every side
    from pycosim.cli.batch import improve_all
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        studies = made(args.studies, folder)
        plain(studies, folder / "warm")
        begin, used = time.perf_counter(), cores()
        plain(studies, folder / "loop")
        loop, work = time.perf_counter() - begin, cores() - used
        print(f"a plain loop over {len(studies)} studies: {loop:.1f} s, {work:.1f} s of a core")
        for where, workers in (("serial", 1), ("processes", 1), ("processes", args.workers)):
            begin, used = time.perf_counter(), cores()
            rows = improve_all(studies, folder / f"{where}{workers}", where, workers)
            spent, more = time.perf_counter() - begin, (cores() - used) / work - 1
            if any(row["failure"] for row in rows):
                raise SystemExit(f"failed: {rows}")
            print(f"--on {where} --workers {workers}: {spent:.1f} s, {more:+.1%} of a core's time (the aim is 10 %)")


def cores():
    """Seconds that this process and those that it has waited for have kept a core busy."""
    forkserver._forkserver._stop()  # Python's own, which waits for the workers: what both have used counts only then
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


if __name__ == "__main__":
    main()

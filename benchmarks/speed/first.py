"""What the README's first block costs on an empty machine: ``python -m benchmarks.speed.first``.

It is run in a copy of the tree, with an empty cache: megabytes of the install, seconds of the first and of a second
demo, and of the help. Two cores are to be idle.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
AIMS = {"install [MB]": 750, "first demo [s]": 30, "second demo [s]": 20, "help [s]": 0.15}


def timed(command, folder, cache):
    """Seconds of a command.

    Parameters
    ----------
    command : str
    folder, cache : Path

    Returns
    -------
    float
    """
    known = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "OMP_", "PYCOSIM_"))}
    begin = time.perf_counter()
    subprocess.run(command, shell=True, check=True, cwd=folder, env={**known, "PYCOSIM_CACHE": str(cache)},
                   stdout=subprocess.DEVNULL)
    return time.perf_counter() - begin


def main():
    """Print what was asked for and what was measured."""
    block = re.search(r"^```sh\n(.*?)^```", (ROOT / "README.md").read_text(), re.M | re.S).group(1)
    *install, demo = block.strip().splitlines()
    with tempfile.TemporaryDirectory() as name:
        folder, cache = Path(name) / "tree", Path(name) / "cache"
        tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
        for file in tracked.splitlines():
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / file, folder / file)
        print(f"{'; '.join(install)}: {sum(timed(line, folder, cache) for line in install):.0f} s")
        size = sum(p.lstat().st_size for p in (folder / ".venv").rglob("*") if not p.is_symlink())
        found = {"install [MB]": size / 1e6, "first demo [s]": timed(demo, folder, cache),
                 "second demo [s]": timed(demo, folder, cache),
                 "help [s]": min(timed(".venv/bin/pycosim --help", folder, cache) for _ in range(5))}
    for what, value in found.items():
        print(f"{what:16s} {value:7.2f}   (the aim is {AIMS[what]:g})")
    raise SystemExit(any(found[what] > aim for what, aim in AIMS.items()))


if __name__ == "__main__":
    main()

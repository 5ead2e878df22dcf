"""The command line without its drawings: the arguments of `pycosim` in, the same results but figures and page out.

    python -m benchmarks.real_logs.bare improve study.toml --out DIR
"""

from __future__ import annotations

import sys

from pycosim.cli import entry, verbs


def main():
    """Run pycosim on the command line's arguments; figures and pages are left out, as they decide nothing."""
    verbs.Run.draw = verbs.Run.page = lambda self, *arguments: None
    sys.exit(entry.main())


if __name__ == "__main__":
    main()

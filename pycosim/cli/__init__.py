"""Command line in; one verb run, its results in a folder and in sentences, out.

Exit codes: 0 done; 2 bad input, one line on stderr; 1 a failure of pycosim's own; 130 interrupted.
Nothing heavy is imported before the arguments are read, so that help and refusals are quick.
"""

from .entry import main

__all__ = ["main"]

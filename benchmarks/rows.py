"""Rows of a long benchmark in, as they come; a file with a row a line, which the next run goes on with, out."""

from __future__ import annotations

import json


def known(path):
    """Rows that an earlier run has left.

    Parameters
    ----------
    path : Path

    Returns
    -------
    list of dict
    """
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def append(path, rows):
    """Write rows as they come; what ends the run loses none of them.

    Parameters
    ----------
    path : Path
    rows : iterable of dict

    Yields
    ------
    dict
        The row, written.
    """
    with path.open("a") as out:
        for row in rows:
            out.write(json.dumps(row, default=float) + "\n")
            out.flush()
            yield row

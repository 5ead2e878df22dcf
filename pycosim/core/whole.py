"""A path and what it is to hold, in; the file, whole or as it was before, out."""

from __future__ import annotations

import os
from pathlib import Path


def write_whole(path, content):
    """Write a file beside its place under another name, then rename it: no reader meets half of it.

    Parameters
    ----------
    path : path
        Replaced where there is one.
    content : str or bytes
        Text becomes UTF-8.

    Returns
    -------
    Path

    Raises
    ------
    OSError
        It cannot be written; what was there before stays.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_whole(Path(folder) / "one.txt", "whole").read_text()
    'whole'
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
        os.replace(temporary, path)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise
    return path

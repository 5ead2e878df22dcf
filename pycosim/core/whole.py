"""A path and what it is to hold, in; the file, whole or as it was before, out."""

from __future__ import annotations

import os
import threading
from pathlib import Path


def write_whole(path, content, check=None):
    """Write a file beside its place under another name, then rename it: no reader meets half of it.

    Parameters
    ----------
    path : path
        Replaced where there is one.
    content : str or bytes
        Text becomes UTF-8.
    check : callable, optional
        Given the file under its other name, before it is renamed; what it raises is passed on.

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
    # two threads, or two processes, may write the same file at once: the last whole one stays
    temporary = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}")
    try:
        temporary.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
        if check is not None:
            check(temporary)
        os.replace(temporary, path)
    except BaseException:
        if path.parent.is_dir():
            temporary.unlink(missing_ok=True)
        raise
    return path

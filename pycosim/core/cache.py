"""A cache on disk for what is costly to compile: keyed by content, written to a temporary name and renamed."""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from .whole import write_whole


def folder():
    """Folder of the cache: ``PYCOSIM_CACHE``, or the user's cache folder.

    Returns
    -------
    Path or None
        None when it cannot be written.
    """
    users = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    base = os.environ.get("PYCOSIM_CACHE") or users / "pycosim"
    try:
        Path(base).mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return Path(base)


def digest(*parts):
    """Hash of strings and lists of strings, and of pycosim's own compiler.

    Parameters
    ----------
    *parts : str or iterable of str
        Everything that the cached value depends on; order counts.

    Returns
    -------
    str
    """
    h = hashlib.sha256(_own_code())
    for part in parts:
        for text in [part] if isinstance(part, str) else part:
            h.update(text.encode() + b"\0")
    return h.hexdigest()[:32]


@lru_cache(maxsize=1)
def _own_code():
    """Everything of this package that could change a result: any source may."""
    here = Path(__file__).parents[1]
    return hashlib.sha256(b"".join(p.read_bytes() for p in sorted(here.rglob("*.py")))).digest()


def remember(kind, key, make, dump, load):
    """Return ``make()``, or what an earlier call of the same kind and key made.

    Parameters
    ----------
    kind, key : str
        Name of the entry.
    make : callable
        Computes the value.
    dump, load : callable
        Value to bytes and back.

    Returns
    -------
    object
        The value.
    """
    place = folder()
    if place is None:
        return make()
    path = place / f"{kind}-{key}"
    try:
        return load(path.read_bytes())
    except Exception:  # missing, or written by another version: make it again
        value = make()
    with suppress(OSError):  # without a cache all is as right, only slower
        write_whole(path, dump(value))
    return value

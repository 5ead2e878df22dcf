"""Names in; a sentence's list of them out."""

from __future__ import annotations


def listed(names):
    """Names as a sentence lists them.

    Parameters
    ----------
    names : iterable of str
        In the order in which they are to be read.

    Returns
    -------
    str
        As ``a, b and c``.

    Examples
    --------
    >>> listed(["a", "b", "c"])
    'a, b and c'
    """
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last

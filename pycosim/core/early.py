"""A partial answer in; told at once to whoever waits for the whole one, where they listen for it."""

from __future__ import annotations


def tell_early(say, text):
    """Tell what is known already.

    Parameters
    ----------
    say : callable or None
        Who is told the stages of long work; hears partial answers where it has a method ``early``.
    text : str
        A sentence, which holds until the whole answer says otherwise.
    """
    hear = getattr(say, "early", None)
    if hear is not None:
        hear(text)

"""Cases of a test, and which of them are short, in; its parameters, the rest marked long, out."""

import pytest


def cases(every, short, slow=()):
    """Parameters of a test that walks many cases of one kind, a few of which stand for all in the short tier, and those
    that say no more than their neighbours stand in the slow one."""
    assert {*short, *slow} <= set(every)
    return [c if c in short else pytest.param(c, marks=pytest.mark.slow if c in slow else pytest.mark.long)
            for c in every]

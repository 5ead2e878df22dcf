"""The tiers: what is long by the folder it stands in is marked so, and the short tier leaves it out.

What takes half a minute or more and repeats another test's claim on other data stands in ``minutes.txt``, and is slow.
"""

from pathlib import Path

import pytest

LONG = ("browser", "cosim", "fmu", "real", "recovery")


def pytest_collection_modifyitems(items):
    """Mark the tests of long folders, and those of minutes."""
    here = Path(__file__).parent
    slow = {*(here / "minutes.txt").read_text(encoding="utf-8").split("\n")}
    for item in items:
        if item.path.is_relative_to(here) and item.path.relative_to(here).parts[0] in LONG:
            item.add_marker(pytest.mark.long)
        if item.nodeid in slow:
            item.add_marker(pytest.mark.slow)

"""The tiers: what is long by the folder it stands in is marked so, and the short tier leaves it out."""

from pathlib import Path

import pytest

LONG = ("browser", "cosim", "fmu", "real", "recovery")


def pytest_collection_modifyitems(items):
    """Mark the tests of long folders."""
    here = Path(__file__).parent
    for item in items:
        if item.path.is_relative_to(here) and item.path.relative_to(here).parts[0] in LONG:
            item.add_marker(pytest.mark.long)

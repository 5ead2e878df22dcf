"""A page in; what axe-core objects to on it, out."""

import pytest


def violations(page):
    """What axe-core objects to on a page: its rule, where, and why."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="no axe-core: .[test] brings it")
    return [(v["id"], n["target"], [m["message"] for m in (*n["any"], *n["all"], *n["none"])])
            for v in axe.Axe().run(page).response["violations"] for n in v["nodes"]]

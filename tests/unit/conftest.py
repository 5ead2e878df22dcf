"""What several files of tests share: a short log with a hidden Stribeck term at segment 2A, and its study."""

import pytest

from pycosim.cli import demo
from pycosim.compile import Library
from pycosim.report.folder import Folder


@pytest.fixture(scope="session")
def hidden(tmp_path_factory):
    """Folder with study.toml and run.csv, as the demo makes them, two speeds instead of five."""
    with Folder(tmp_path_factory.mktemp("hidden") / "study", "demo") as folder:
        demo._make(Library(), folder, speeds=(0.4, 1.6), longest=2.0)
    return folder.path

"""What several files of tests share: a short log with a hidden Stribeck term at segment 2A, and its study."""

import pytest

from pycosim.cli import demo
from pycosim.compile import Library, compile_model
from pycosim.data.dataset import Dataset
from pycosim.diagnosis.decide import diagnose
from pycosim.diagnosis.search import Improvement, step_of
from pycosim.fit import least_squares
from pycosim.report.folder import Folder
from pycosim.study.parse import load_study


@pytest.fixture(scope="session")
def hidden(tmp_path_factory):
    """Folder with study.toml and run.csv, as the demo makes them, two speeds instead of five."""
    with Folder(tmp_path_factory.mktemp("hidden") / "study", "demo") as folder:
        demo._make(Library(), folder, speeds=(0.4, 1.6), longest=2.0)
    return folder.path


@pytest.fixture(scope="session")
def searched(hidden):
    """That log as a dataset, and its search: the base model, and the winner of its diagnosis."""
    dataset = Dataset(load_study(hidden / "study.toml"), Library())
    base = least_squares.fit(dataset, dataset.base)
    first = diagnose(dataset, dataset.base, base)
    winner = first.winner
    assert winner.key == demo.HIDDEN[:2]
    larger = compile_model(dataset.library, dataset.study.rig, [winner.key])
    steps = [step_of(dataset, dataset.base, base), step_of(dataset, larger, winner.fit, winner)]
    return dataset, Improvement(first, first, steps)

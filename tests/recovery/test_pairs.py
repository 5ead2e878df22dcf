"""Two effects in one machine: each is found, and one that stood in for the other is replaced."""

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.hidden_effects import cases
from benchmarks.hidden_effects import machine as rig
from pycosim.compile import Library, compile_model
from pycosim.data.dataset import Dataset
from pycosim.diagnosis.decide import Finding
from pycosim.diagnosis.search import _ladder, _revised, improve, step_of
from pycosim.fit import least_squares
from pycosim.study.parse import load_study

STUDY = Path(__file__).parents[2] / "examples" / "hip_knee" / "study.toml"
TRUE = ("stribeck", "2A"), ("payload", "shank")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """A log of a machine with both effects."""
    drawn = cases.draw(cases.Case("pair", tuple(e for e, _ in TRUE), 3, (1.7, 1.7)))
    hidden = [rig.calibrate(rig.Effect(h.id, place, **h.coefficients), 1.7, drawn.machine, drawn.motion, drawn.noise, 3)
              for h, (_, place) in zip(drawn.hidden, TRUE)]
    path = tmp_path_factory.mktemp("pair") / "run.csv"
    rig.write_csv(cases.log(drawn, 3, hidden), path)
    return Dataset(load_study(STUDY).with_data([path]), Library())


def test_both_are_found_and_nothing_else(dataset):
    found = improve(dataset)
    assert {s.added for s in found.steps[1:]} == set(TRUE)
    assert found.last.verdict == "nothing_missing"


def ladder(dataset, keys):
    """The steps that add these effects one after the other."""
    base = step_of(dataset, dataset.base, least_squares.fit(dataset, dataset.base))
    rungs = [replace(base, added=key, finding=Finding(*key), model=compile_model(dataset.library, base.model.rig, keys))
             for key in keys]
    return _ladder(dataset, base, rungs)


def test_an_effect_that_stands_in_for_another_is_replaced(dataset):
    steps = ladder(dataset, [("viscous", "1A+2A"), TRUE[1]])
    revised = _revised(dataset, steps, steps[-1].fit.noise, 0, None)
    assert [s.added for s in revised[1:]] == [TRUE[1], TRUE[0]]
    assert sum(revised[-1].error.values()) < sum(steps[-1].error.values())
    assert revised[-1].finding.predicted_error and not revised[1].finding.predicted_error, "it came from another model"


def test_what_was_chosen_rightly_stays(dataset):
    steps = ladder(dataset, TRUE)
    assert _revised(dataset, steps, steps[-1].fit.noise, 0, None) is None

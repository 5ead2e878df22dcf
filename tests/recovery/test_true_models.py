"""The model that has all that a log hides lacks nothing, and holds what is hidden within its intervals."""

from dataclasses import replace

import pytest

from benchmarks.real_logs import cases, truth
from benchmarks.real_logs.make import make
from pycosim.compile import Library
from pycosim.data.dataset import Dataset
from pycosim.diagnosis import search
from pycosim.study.parse import load_study


@pytest.mark.parametrize("case", ["geared:viscous:1.7:3", "reference_mass:viscous:1.7:4401",
                                  "plain:thermal_drift:1.7:3221", "lag_current:none::2700"])
def test_beside_the_truth_nothing_is_missing(case):
    row = truth.told(replace(cases.parse(case), quick=True))
    assert (row["verdict"], row["said"]) == ("nothing_missing", ""), row
    given = {n: v for own in row["true"] for n, v in own.items()}
    for name, (_, low, high) in row["coefficients"].items():
        if name.split(".")[1] in given:
            assert low < given[name.split(".")[1]] < high, row


@pytest.mark.parametrize("case", ["pick_and_place:load_nonlinearity:1.7:5600", "pick_and_place:none::2701"])
def test_a_pick_and_place_of_few_passes_out_and_back_can_be_selected_on(case, tmp_path):
    study = make(replace(cases.parse(case), quick=True), tmp_path / "log")
    found = search.improve(Dataset(load_study(study), Library()))
    named = [s.added for s in found.steps[1:]]
    assert named == ([] if ":none:" in case else [("load_nonlinearity", "1A+2A")]), named
    assert found.last.verdict == "nothing_missing"

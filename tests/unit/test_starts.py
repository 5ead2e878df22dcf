"""Claims about effects that a study names without values: identify finds them, wherever the defaults lie."""

import json

import pytest
from tiers import cases

import pycosim as pc
from benchmarks.real_logs.cases import parse
from benchmarks.real_logs.make import make
from pycosim.fit import least_squares

NAMED = ["linear:stribeck:2.4:7", "linear:torque_ripple:1.7:7", "linear:sublinear_viscous:2.4:7"]


@pytest.mark.parametrize("case", cases(NAMED, []))
def test_identify_finds_an_effect_that_the_study_names_without_values(case, tmp_path):
    study, truth = make(parse(case), tmp_path, True), case.split(":")[1]
    place = {"torque_ripple": "motor"}.get(truth, "guide")
    study.write_text(study.read_text() + f'\n[[effects]]\neffect = "{truth}"\nplace = "{place}"\n')
    project = pc.open(study)
    plain = least_squares.fit(project.dataset, project.model)
    found = project.fit().solution
    noise = json.loads((tmp_path / "truth.json").read_text())["floor"]["F"]
    assert found.error["force"] < 1.1 * noise < 1.5 * noise < plain.error["force"]

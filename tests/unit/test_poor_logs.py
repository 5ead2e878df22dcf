"""Claims about poor logs: no verb falls over them, and what they can still answer is said."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.hidden_effects.machine import PAPER, measure, six_manoeuvres
from pycosim.cli.entry import main

pytestmark = pytest.mark.long
HIP_KNEE = (Path(__file__).parents[2] / "examples" / "hip_knee" / "study.toml").read_text()
GEARED = """
[rig]
model = "DriveTrain.Rigs.GearedJoint"
[parameters]
"gear.f0" = { value = 0.05, min = 0.0, max = 1.0, fixed = false }
"gear.mu" = { value = 0.95, min = 0.3, max = 1.0, fixed = false }
[columns]
theta = { variable = "motor.phi", unit = "rad" }
tau = { variable = "motor.tau", unit = "N.m" }
C = { variable = "C", unit = "N.m" }
"""


def geared(load, one_way=False):
    """A geared joint (ratio 50) with Coulomb and load-dependent friction, out and back at three speeds."""
    time, rng = np.arange(0, 27, 0.01), np.random.default_rng(0)
    part = time % 3.0
    speed = np.repeat([0.5, 1.0, 2.0], 900) * np.interp(part, [0, 0.3, 0.6, 2.4, 2.7, 3.0], [0, 0, 1, 1, 0, 0])
    speed = speed if one_way else speed * np.where(time // 3 % 2, -1, 1)
    theta = np.cumsum(speed) * 0.01
    C = load(theta) * np.ones(len(time))
    tau = C / 50 + np.sign(speed) * (0.05 + 0.03 * np.abs(C / 50)) + 0.005 * rng.standard_normal(len(time))
    return pd.DataFrame({"time": time, "theta": theta, "tau": tau, "C": C + 0.1 * rng.standard_normal(len(time))})


@pytest.fixture(scope="module")
def passes():
    return measure(PAPER, six_manoeuvres(speeds=(1.6,), repeats=1, rate=50, longest_pass=4), rng=3)


def until(frame, label):
    """The log up to the end of the first pass of this label."""
    there = np.flatnonzero(frame["manoeuvre"] == label)
    last = there[np.flatnonzero(np.diff(there, append=len(frame) + 9) > 1)[0]]
    return frame.iloc[:last + 10]


@pytest.fixture
def improved(tmp_path, monkeypatch, capsys):
    """What `improve` says and finds."""
    def run(frame, study):
        monkeypatch.chdir(tmp_path)
        frame.to_csv("log.csv", index=False)
        (tmp_path / "study.toml").write_text(study)
        code = main(["improve", "study.toml", "--data", "log.csv", "--out", "out"])
        said = capsys.readouterr()
        assert code == 0, said.err
        assert (tmp_path / "out" / "report.html").exists()
        return said.out, json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    return run


def test_one_pass_identifies_and_says_that_no_effect_can_be_shown(passes, improved):
    said, found = improved(until(passes, "A"), HIP_KNEE)
    assert found["verdict"] == "not_enough_excitation"
    assert "One block is left to fit: its parameters can be found" in said and "one way only" in said


def test_one_pass_out_and_back_is_one_block(passes, improved):
    said, found = improved(until(passes, "B"), HIP_KNEE)
    assert found["verdict"] == "not_enough_excitation" and "One block is left to fit" in said


def test_a_joint_without_gravity_and_one_that_moves_one_way_are_no_fault(improved):
    assert "one way only" not in improved(geared(lambda theta: 0.0), GEARED)[0]
    assert "gear moves one way only" in improved(geared(lambda theta: 5.0, one_way=True), GEARED)[0]


@pytest.mark.slow
def test_a_current_without_a_reference_is_enough_to_go_on(improved):
    study = GEARED.replace('C = { variable = "C", unit = "N.m" }\n', "")
    study = study.replace('unit = "N.m"', 'unit = "A", k_m = 0.1')
    improved(geared(lambda theta: 5 * np.sin(theta / 3)).drop(columns="C"), study)


@pytest.mark.parametrize("names", [("load", "speed"), ("time_since_reversal", "acceleration")])
def test_a_column_may_be_called_as_the_diagnosis_calls_its_variables(passes, improved, names):
    renamed = dict(zip(("tau1", "tau2"), names))
    study = HIP_KNEE
    for old, new in renamed.items():
        study = study.replace(f"{old} = {{", f"{new} = {{")
    improved(passes.rename(columns=renamed), study)

"""A rig outside the library, on a log of its own: the fit forgets its start, the hidden effect is found by name."""

import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pycosim.cli.entry import main
from pycosim.compile import Library
from pycosim.data.dataset import Dataset
from pycosim.fit import least_squares
from pycosim.study.parse import load_study

EXAMPLE = Path(__file__).parents[2] / "examples" / "barrier"


@pytest.fixture(scope="module")
def maker():
    spec = importlib.util.spec_from_file_location("make_log", EXAMPLE / "make_log.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def log(maker, tmp_path_factory):
    path = tmp_path_factory.mktemp("barrier") / "monday.csv"
    maker.record(np.random.default_rng(1)).to_csv(path, index=False)
    return path


def test_the_fit_ends_where_it_ends_whatever_its_start(log):
    """The load turns its sign in mid-pass: the affine maps must not be taken from a sample beside the turn."""
    study = replace(load_study(EXAMPLE / "study.toml"), runs=[log])
    dataset = Dataset(study, Library(study.modelica))
    starts = ({}, {"worm.f0": 0.08, "worm.mu": 0.82}, {"worm.f0": 0.05, "worm.mu": 0.7},
              {"worm.f0": 0.5, "worm.mu": 0.5})
    fits = [least_squares.fit(dataset, dataset.base, start) for start in starts]
    for other in fits[1:]:
        assert np.all(np.abs(other.values - fits[0].values) < 0.1 * fits[0].stderr)


def test_new_writes_a_study_for_a_rig_of_ones_own(log, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("own").mkdir()
    Path("own/Barrier.mo").write_text((EXAMPLE / "Barrier.mo").read_text())
    said = ["--map", "motor_angle=motor.phi:deg", "current=motor.tau:A,k_m=0.11", "arm_torque=C:N.m"]
    assert main(["new", "own/Barrier.mo", "--data", str(log), "--out", "studies", "--quiet", *said]) == 0
    study = load_study("studies/Barrier.toml")
    assert study.rig == "Barrier" and study.modelica == [tmp_path / "own" / "Barrier.mo"] and study.runs == [log]
    assert {n for n, s in study.parameters.items() if s.fixed is False} == {"worm.f0", "worm.mu"}
    assert {c.variable for c in study.columns.values()} == {"time", "motor.phi", "motor.tau", "C"}


@pytest.mark.parametrize("change, says", [
    (("estimate=", "estimated="), "has no key 'estimated'; closest: 'estimate'"),
    (("__pycosim(", "__other("), "holds no rig"), (("equation\n", "equatio\n"), "Barrier.mo"),
    (("DriveTrain.Components.Motor", "DriveTrain.Components.Moto"), "DriveTrain.Components.Motor")])
def test_new_refuses_what_is_no_rig_in_a_sentence(change, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("Barrier.mo").write_text((EXAMPLE / "Barrier.mo").read_text().replace(*change))
    assert main(["new", "Barrier.mo"]) == 2
    told = capsys.readouterr().err.strip()
    assert "\n" not in told and says in told and list(Path().iterdir()) == [Path("Barrier.mo")]


def test_the_ripple_of_the_worm_is_found_and_sized(maker, log, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["improve", str(EXAMPLE / "study.toml"), "--data", str(log), "--out", "found", "--quiet"]) == 0
    best, = (c for c in json.loads(Path("found/diagnosis.json").read_text())["candidates"] if c["accepted"])
    effect, place, hidden = maker.HIDDEN
    assert (best["effect"], best["place"]) == (effect, place)
    for name, value in hidden.items():
        low, high = best["coefficients"][name]["ci95"]
        assert low <= value <= high or best["coefficients"][name]["value"] == pytest.approx(value, rel=0.01), name
    parameters = json.loads(Path("found/parameters.json").read_text())["parameters"]
    for name in ("worm.f0", "worm.mu"):
        assert parameters[name]["value"] == pytest.approx(maker.MACHINE[name], rel=0.01)
    assert json.loads(Path("found/diagnosis_final.json").read_text())["verdict"] == "nothing_missing"

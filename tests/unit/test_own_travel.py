"""The rig's own travel, which no fit follows, is no memory of friction; nor is a start a warm-up."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import cumulative_trapezoid

import pycosim as pc
from benchmarks.real_logs.make import GEARED
from pycosim.compile import Library, compile_model
from pycosim.data import turns
from pycosim.data.dataset import Dataset
from pycosim.diagnosis import own, trials
from pycosim.diagnosis.decide import diagnose
from pycosim.diagnosis.trials import BETWEEN, OWN, START, no_effect
from pycosim.dynamics.filters import first_order
from pycosim.fit import least_squares
from pycosim.study.parse import load_study

RIG = "DriveTrain.Rigs.GearedJoint"
TRAVEL, LOSS = 1e-3, 0.3


def logged(folder, friction, every=20):
    """A slow swing under a load of its own; friction takes time and speed, and gives its state from -1 to 1."""
    time = np.arange(0, 40, 0.00025)
    way = 0.12 * np.sin(2 * np.pi * time / 0.9) + 0.05 * np.sin(2 * np.pi * time / 0.37)
    load = 1.5 * np.sin(2 * np.pi * time / 0.61)
    log = pd.DataFrame({"time": time, "theta": cumulative_trapezoid(way, time, initial=0), "omega": way,
                        "C": 50 * load, "tau": load + LOSS * friction(time, way)})[::every]
    log[["C", "tau"]] += np.random.default_rng(0).standard_normal((len(log), 2)) * (0.15, 0.005)
    log.to_csv(folder / "log.csv", index=False)
    (folder / "study.toml").write_text(GEARED.replace("runs = []", 'runs = ["log.csv"]'))
    return Dataset(load_study(folder / "study.toml"), Library())


def stiff(time, way, travel=TRAVEL):
    """Elastic over a travel, the rig's own where no other is given, and sliding from there on."""
    state, found = 0.0, np.empty(len(time))
    for k, step in enumerate(way * np.gradient(time) / travel):
        found[k] = state = min(max(state + step, -1.0), 1.0)
    return found


def late(T):
    """Against a speed that follows the true one late."""
    return lambda time, way: np.clip(first_order(way[None], T, time, np.zeros(len(time)))[0][0] / 0.01, -1, 1)


@pytest.mark.parametrize("friction, T, said", [
    (stiff, 0.03, OWN), (late(0.15), 0.15, None), (late(0.15), 0.007, BETWEEN)])
def test_a_memory_that_the_rig_s_own_travel_does_as_well_is_none(friction, T, said, tmp_path, monkeypatch):
    """Beside what is missing, behind a coarse encoder or with spikes the travel is not seen at work before the fit."""
    monkeypatch.setattr(turns, "building_up", lambda miss, *given: np.zeros(miss.shape[1], dtype=bool))
    dataset = logged(tmp_path, friction)
    model = compile_model(dataset.library, RIG, [("friction_lag", "gear")])
    values = {"friction_lag_gear.T": T, "friction_lag_gear.ws": 0.01}
    free = [n for n in dataset.parameters.free(model) if n not in values]
    fit = least_squares.fit(dataset, model, values, free)
    assert no_effect(dataset, model, fit) == said


def test_what_predicts_less_than_a_travel_of_the_machine_s_own_length_stands_in_for_it(tmp_path, monkeypatch):
    """The rig's travel is a guess; of one of 0.4 of it a filter of the torque was what is missing, or a lag."""
    monkeypatch.setattr(turns, "building_up", lambda miss, *given: np.zeros(miss.shape[1], dtype=bool))
    dataset = logged(tmp_path, partial(stiff, travel=0.4 * TRAVEL))
    found = diagnose(dataset, dataset.base, least_squares.fit(dataset, dataset.base))
    refused = {c.effect: c.refused for c in found.candidates if c.fit is not None}
    assert refused["presliding"] == OWN and refused["friction_lag"] == OWN
    assert not found.winner
    assert found.travels == {"gear.travel": pytest.approx(0.4 * TRAVEL, rel=0.15)}


def test_a_travel_as_the_rig_s_is_no_other(tmp_path, monkeypatch):
    monkeypatch.setattr(turns, "building_up", lambda miss, *given: np.zeros(miss.shape[1], dtype=bool))
    dataset = logged(tmp_path, stiff)
    found = diagnose(dataset, dataset.base, least_squares.fit(dataset, dataset.base))
    assert "presliding" in [c.effect for c in found.candidates if c.refused == OWN]
    assert found.travels == {}


def test_a_search_takes_the_machine_s_own_travel(tmp_path):
    """A friction that falls with speed is beside it: taken as sliding at once, its size was 0.35 for 0.15."""
    fall = 0.5

    def friction(time, way):
        return stiff(time, way, 0.3 * TRAVEL) * (1 + fall * np.exp(-(way / 0.1) ** 2))

    dataset = logged(tmp_path, friction)
    assert not dataset.own_travel
    project = pc.open(tmp_path / "study.toml")
    found = project.improve()
    assert (found.added, found.verdict) == (["stribeck@gear"], "nothing_missing")
    told = found.project.study.parameters["gear.travel"]
    assert told.fixed and told.value == pytest.approx(0.3 * TRAVEL, rel=0.2)
    assert "gear.travel" not in project.study.parameters
    assert found.final.params["stribeck_gear.fs"].value == pytest.approx(fall * LOSS, rel=0.03)
    assert any("gear.travel = " in line for line in found.sentences)
    assert "gear.travel" in found.save(tmp_path / "found.toml").read_text()
    assert found.last.record["travels"]["gear.travel"] == {"value": told.value, "unit": "rad", "rig": TRAVEL}


def test_a_diagnosis_takes_the_machine_s_own_travel_and_an_effect_is_added_beside_it(tmp_path):
    logged(tmp_path, partial(stiff, travel=0.3 * TRAVEL))
    fitted = pc.open(tmp_path / "study.toml").fit()
    told = fitted.diagnose()
    assert told.verdict == "nothing_missing"
    assert told.record["travels"]["gear.travel"]["value"] == pytest.approx(0.3 * TRAVEL, rel=0.2)
    assert told.error["C"] < fitted.error["C"]
    assert fitted.add("viscous@gear").project.travels == told.fitted.project.travels


def test_a_segment_has_a_travel_of_its_own_where_that_takes_more_than_luck():
    noise, shapes = np.random.default_rng(0).standard_normal((1, 900)), np.zeros((2, 3, 1, 900))
    for segment, part in enumerate((slice(0, 300), slice(300, 600))):
        shapes[segment, :, :, part] = np.array([0.0, 1.0, 2.0])[:, None, None]
    here = SimpleNamespace(squares=lambda residual: float((residual ** 2).sum()))
    hidden = noise - shapes[0, 2]
    assert own._apart(here, list(shapes), hidden, [0, 0], own.SURER) == [2, 0]


def test_a_time_constant_is_told_from_nothing_where_a_filter_has_settled(monkeypatch):
    """What the first samples of a pass hold fell by more than the noise of the others, and the interval held zero."""
    class Data:
        def __init__(self, first):
            self.first = first

        def settled(self, model, parameters):
            return Data(0.0)

        def residuals(self, model, free, parameters, part):
            left = np.r_[self.first * (1.0 - 0.1 * parameters.get("low_pass_torque.T", 0.0)), np.zeros(9)]
            return SimpleNamespace(chain=None, residual=lambda values: left[None])

    noise = SimpleNamespace(whiten=lambda values, chain: values)
    attached = [(SimpleNamespace(id="low_pass"), SimpleNamespace(name="torque", components=("torque",)))]
    monkeypatch.setattr(trials, "component_name", lambda *given: "low_pass_torque")
    monkeypatch.setattr(least_squares, "fit_without", lambda data, model, start, **options: without)
    fit = least_squares.Fit({"low_pass_torque.T": 1.0}, [], {}, *[None] * 4, 1.0, [noise], [], None)
    without = replace(fit, parameters={})
    told = trials.told_from_nothing(Data(100.0), SimpleNamespace(attached=attached),
                                    SimpleNamespace(fit=fit, sizes={"T": 0.0}), None, without)
    assert not told.apart


@pytest.mark.parametrize("T, said", [(0.05, START), (20.0, None)])
def test_a_warm_up_that_ends_with_the_first_pass_tells_of_the_start(T, said, tmp_path):
    dataset = logged(tmp_path, lambda time, way: np.sign(way) * (1 + np.exp(-time / T)))
    model = compile_model(dataset.library, RIG, [("thermal_drift", "gear")])
    fit = least_squares.fit(dataset, model, {"thermal_drift_gear.k": 1.0, "thermal_drift_gear.T": T})
    assert no_effect(dataset, model, fit) == said

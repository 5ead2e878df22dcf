"""The rig's own travel, which no fit follows, is no memory of friction; nor is a start a warm-up."""

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import cumulative_trapezoid

from benchmarks.real_logs.make import GEARED
from pycosim.compile import Library, compile_model
from pycosim.data import turns
from pycosim.data.dataset import Dataset
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


def stiff(time, way):
    """Elastic over the rig's own travel, and sliding from there on."""
    state, found = 0.0, np.empty(len(time))
    for k, step in enumerate(way * np.gradient(time) / TRAVEL):
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


@pytest.mark.parametrize("T, said", [(0.05, START), (20.0, None)])
def test_a_warm_up_that_ends_with_the_first_pass_tells_of_the_start(T, said, tmp_path):
    dataset = logged(tmp_path, lambda time, way: np.sign(way) * (1 + np.exp(-time / T)))
    model = compile_model(dataset.library, RIG, [("thermal_drift", "gear")])
    fit = least_squares.fit(dataset, model, {"thermal_drift_gear.k": 1.0, "thermal_drift_gear.T": T})
    assert no_effect(dataset, model, fit) == said

"""Torques and frictions of no law are recovered as free functions of an angle, and proposed where nothing else fits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.hidden_effects import machine as rig
from pycosim.compile import Library, catalogue
from pycosim.compile.contribution import Contribution
from pycosim.core.errors import StudyError
from pycosim.data.dataset import Dataset
from pycosim.diagnosis import lack_of_fit
from pycosim.diagnosis.table import Table
from pycosim.fit.least_squares import fit
from pycosim.study.parse import load_study

STUDY = Path(__file__).parents[2] / "examples" / "hip_knee" / "study.toml"
LIBRARY = Library()
MOTION = rig.six_manoeuvres((1.6,), repeats=2, rate=20, start=((0.9, -0.85), (0.2, -0.6)))


def cable(angle):
    """Torque of a cable's routing, three harmonics of the joint's turn [N.m]."""
    return 0.8 * np.sin(angle) + 0.5 * np.sin(2 * angle + 0.7) + 0.4 * np.cos(3 * angle)


def fitted(folder, frame, *effects):
    """Data set and fit of a log with effects, and the error on its held-out part."""
    path = folder / "run.csv"
    rig.write_csv(frame, path)
    study = replace(load_study(STUDY).with_data([path]), effects=list(effects))
    dataset = Dataset(study, LIBRARY)
    found = fit(dataset, dataset.base)
    unseen = dataset.residuals(dataset.base, found.free, found.parameters, "test").residual(found.values)
    return dataset, found, np.sqrt(np.mean(unseen ** 2, axis=1))


def curve(found, effect, place, variable, angles):
    """The fitted function at some angles, and its standard error."""
    base = f"{effect}_{place}."
    own = {n.removeprefix(base): v for n, v in found.parameters.items() if n.startswith(base)}
    shape = Contribution(LIBRARY, catalogue(LIBRARY)[effect])
    rows = shape({variable: angles}, [], own, len(angles))[:, 0]
    index = [found.free.index(base + c) for c in shape.coefficients]
    spread = np.einsum("in,ij,jn->n", rows, found.covariance[np.ix_(index, index)], rows)
    return np.array([own[c] for c in shape.coefficients]) @ rows, np.sqrt(spread)


@pytest.fixture(scope="module")
def routed():
    """A log without, and the same with a torque of a cable about the hip; the second knows it not."""
    plain = rig.measure(rig.PAPER, MOTION, rng=4)
    angle = (plain["theta1"] + plain["theta2"]) / (2 * rig.RATIO)
    return plain, plain.assign(C_H=plain["C_H"] - cable(angle))


def test_a_torque_of_three_harmonics_is_recovered_to_within_noise_on_unseen_data(routed, tmp_path):
    plain, hidden = routed
    *_, best = fitted(tmp_path, plain)
    *_, without = fitted(tmp_path, hidden)
    _, found, left = fitted(tmp_path, hidden, ("angle_torque", "hip"))
    assert without[0] > 3 * best[0] and left[0] < 1.03 * best[0] and left[1] < 1.03 * best[1]
    low, high = (found.parameters[f"angle_torque_hip.{end}"] for end in ("low", "high"))
    angles = np.linspace(low, high, 15)
    value, spread = curve(found, "angle_torque", "hip", "beside.phi", angles)
    assert np.all(np.abs(value - cable(angles)) < 4 * spread + 0.01) and spread.max() < 0.1


def test_friction_that_grows_with_an_angle_is_recovered_to_within_noise_on_unseen_data(tmp_path):
    bump = rig.Effect("bump", "1A", A=0.15, centre=20.0, width=12.0, motor=1)
    *_, best = fitted(tmp_path, rig.measure(rig.PAPER, MOTION, rng=5))
    *_, without = fitted(tmp_path, rig.measure(rig.PAPER, MOTION, [bump], rng=5))
    _, _, left = fitted(tmp_path, rig.measure(rig.PAPER, MOTION, [bump], rng=5), ("angle_friction", "1A"))
    assert without.max() > 1.2 * best.max() and np.all(left < 1.03 * best)


def test_where_nothing_explains_what_follows_an_angle_the_command_that_adds_a_free_function_is_said(routed, tmp_path,
                                                                                                   monkeypatch):
    monkeypatch.setattr(lack_of_fit, "_proposal", lambda *_: None)  # a guess of another kind, which takes long
    dataset, found, _ = fitted(tmp_path, routed[1])
    table = Table(dataset, dataset.base, found)
    assert not {c.effect.id for c in table.candidates} & {"angle_torque", "angle_friction", "motor_angle_torque"}
    floor = {c: 0.14 for c in dataset.channels}
    left = lack_of_fit.unexplained(table, [{"variable": "theta1", "strength": 0.5}], floor)["free"]
    assert (left["effect"], left["place"]) == ("angle_torque", "hip") and left["share"] > 0.8
    assert "'pycosim add study.toml angle_torque@hip'" in left["text"]
    assert lack_of_fit.unexplained(table, [{"variable": "speed@1A", "strength": 0.5}], floor)["free"] is None


def test_a_free_function_of_an_angle_that_stands_still_is_refused_in_one_sentence(routed, tmp_path, monkeypatch):
    path = tmp_path / "run.csv"
    rig.write_csv(routed[0], path)
    dataset = Dataset(load_study(STUDY).with_data([path]), LIBRARY)
    monkeypatch.setattr(dataset, "segment_signals", lambda *_: {"s2A.friction.phi": np.ones(3)})
    with pytest.raises(StudyError, match="'angle_friction' at s2A .* does not change in these logs"):
        dataset.parameters.means(catalogue(LIBRARY)["angle_friction"], ("s2A",))

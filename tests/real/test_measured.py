"""Verdicts on measured data made by others; the tables are made by `benchmarks.real_data`."""

import numpy as np
import pandas as pd
import pytest

from benchmarks.real_data import emps
from benchmarks.real_data.run import DATA, ladder, screw, servo_splits
from pycosim.compile import Library, compile_model
from pycosim.data.dataset import Dataset
from pycosim.data.noise import fit_noise
from pycosim.diagnosis.compare import errors
from pycosim.diagnosis.cycles import ripples
from pycosim.diagnosis.search import improve
from pycosim.diagnosis.table import Table
from pycosim.fit import least_squares
from pycosim.study.parse import load_study

pytestmark = pytest.mark.skipif(not DATA.exists(), reason=f"the measured data are not in {DATA}")
ASYMMETRY = {"direction_asymmetry", "torque_offset"}
OF_THE_LOAD = {"load_dependence", "load_nonlinearity"}  # the second refines the first


def added(result):
    return [name.partition("@")[0] for name in result.added]


def held_out(result, channel):
    return [step.held_out_error[channel] for step in result.steps]


def test_drive_1_is_asymmetric_and_has_a_stribeck_effect():
    result = ladder(screw(1))
    found = added(result)
    assert found[0] in ASYMMETRY and found[1:] == ["stribeck"]
    errors = held_out(result, "tau")
    assert errors[0] > 0.3e-3 and errors[-1] < 0.06e-3


def test_drive_2_is_asymmetric_and_has_no_stribeck_effect():
    result = ladder(screw(2))
    found = added(result)
    assert len(found) == 1 and found[0] in ASYMMETRY
    assert result.last.verdict == "nothing_missing"


@pytest.mark.parametrize("index", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))])
def test_the_servo_lacks_load_dependent_friction_whatever_trajectory_is_held_out(index):
    value, study = list(servo_splits("trajectory"))[index]
    result = ladder(study)
    assert added(result)[0] in OF_THE_LOAD, value
    errors = held_out(result, "voltage")
    assert errors[-1] <= 0.7 * errors[0], value


def test_the_axis_with_what_is_known_to_be_missing_does_as_well_as_plain_least_squares_with_the_same_terms():
    data = Dataset(load_study(emps.STUDY), Library())
    known = [("viscous_asymmetry", "guide"), ("time_delay", "force"), ("torque_ripple", "motor")]
    model = compile_model(data.library, data.study.rig, known)
    fit = least_squares.fit(data, model, {"torque_ripple_motor.n": 2 * np.pi / 2.5e-3, "torque_ripple_motor.A": 0.5})
    values = fit.parameters
    assert values["viscous_asymmetry_guide.b_a"] == pytest.approx((166 - 240) / 2, rel=0.1)
    assert -1e-3 < values["time_delay_force.d"] < -3e-4
    assert 2 * np.pi / values["torque_ripple_motor.n"] == pytest.approx(2.5e-3, rel=2e-3)
    log = pd.read_csv(emps.LOG)
    plain = emps.plain(log.t.to_numpy(), log.qm.to_numpy(), emps.GAIN * log.vir.to_numpy(), data.w_min,
                       [(a, b) for _, a, b in data.held_out_ranges()])
    assert errors(data, model, fit, "test")["force"] <= 1.1 * list(plain.values())[-1]


def test_the_axis_lacks_an_asymmetry_of_its_viscous_friction_a_shift_and_the_ripple_of_its_screw():
    """The shift is most of what is fast, the asymmetry most of all: neither keeps the other out."""
    found = improve(Dataset(load_study(emps.STUDY), Library()))
    steps = [s.added for s in found.steps[1:]]
    assert steps[0] == ("viscous_asymmetry", "guide") and not found.first.winner.twins, "an offset leaves more"
    assert {("time_delay", "force"), ("torque_ripple", "motor")} <= set(steps)
    assert -1e-3 < found.fit.parameters["time_delay_force.d"] < -3e-4
    assert 2 * np.pi / found.fit.parameters["torque_ripple_motor.n"] == pytest.approx(2.5e-3, rel=2e-3)
    assert found.steps[-1].held_out_error["force"] < 0.3 * found.steps[0].held_out_error["force"]


def test_the_search_for_ripples_sees_the_screw_of_the_axis():
    data = Dataset(load_study(emps.STUDY), Library())
    model = compile_model(data.library, data.study.rig, [("viscous_asymmetry", "guide"), ("time_delay", "force")])
    table = Table(data, model, least_squares.fit(data, model))
    found = ripples(table, [fit_noise(r, table.chain) for r in table.residual], 199, np.random.default_rng(0))
    assert 2 * np.pi / found.candidates[0].grid["n"] == pytest.approx(2.5e-3, rel=5e-3)

"""Verdicts on measured data made by others; the tables are made by `benchmarks.real_data`."""

import pytest

from benchmarks.real_data.run import DATA, ladder, screw, servo_splits

pytestmark = pytest.mark.skipif(not DATA.exists(), reason=f"the measured data are not in {DATA}")
ASYMMETRY = {"direction_asymmetry", "torque_offset"}


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


@pytest.mark.parametrize("index", range(3))
def test_the_servo_lacks_load_dependent_friction_whatever_trajectory_is_held_out(index):
    value, study = list(servo_splits("trajectory"))[index]
    result = ladder(study)
    assert added(result)[0] == "load_dependence", value
    errors = held_out(result, "voltage")
    assert errors[-1] <= 0.7 * errors[0], value

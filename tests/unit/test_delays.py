"""A record moved in time is the signal at the time it tells of, and its noise stays what it was."""

import numpy as np
import pytest

from pycosim.compile import Library, compile_model
from pycosim.data.dataset import Dataset
from pycosim.dynamics.delays import Record, undo
from pycosim.dynamics.simulate import estimate

TIME = np.arange(0, 4, 0.01)
ONE = np.zeros(len(TIME))
RIG = "DriveTrain.Rigs.GearedJoint"


@pytest.mark.parametrize("later", [-0.0137, 0.004, 0.05])
def test_a_smooth_signal_is_moved_by_any_part_of_a_sample(later):
    record = Record(TIME, np.sin(3 * TIME), ONE)
    moved, slope = record.at(later), record.at(later, 1)
    inside = slice(20, -20)
    np.testing.assert_allclose(moved[inside], np.sin(3 * (TIME + later))[inside], atol=1e-7)
    np.testing.assert_allclose(slope[inside], 3 * np.cos(3 * (TIME + later))[inside], atol=1e-4)


def test_one_log_does_not_reach_into_the_next():
    run = np.repeat([0.0, 1.0], len(TIME) // 2)
    moved = Record(np.tile(TIME[:200], 2), run, run).at(0.05)
    np.testing.assert_allclose(moved, run, atol=1e-12)


@pytest.mark.parametrize("d", [0.02, 0.023, 0.0262, 0.0279])
def test_a_noisy_record_is_moved_along_its_slope_and_keeps_its_noise(d):
    late = compile_model(Library(), RIG, [("time_delay", "torque")])
    noise = np.random.default_rng(0).standard_normal(len(TIME))
    signals = {"motor.tau": np.sin(2 * (TIME - 0.023)) + noise}
    moved = undo(late.question("estimate"), signals, TIME, ONE,
                 {**{n: v.value for n, v in late.parameters.items()}, "time_delay_torque.d": d},
                 {"motor.tau": 2 * np.cos(2 * (TIME - 0.023))})
    left = (moved["motor.tau"] - np.sin(2 * (TIME + d - 0.023)))[5:-5]
    shift = round(d / 0.01)
    np.testing.assert_allclose(left, noise[5 + shift:len(TIME) - 5 + shift], atol=1e-4)


def test_a_model_with_a_delay_takes_the_torques_of_the_delayed_time():
    library = Library()
    late, bare = compile_model(library, RIG, [("time_delay", "torque")]), compile_model(library, RIG)
    motion = {"motor.phi": TIME, "der(motor.phi)": 1.0, "der(der(motor.phi))": 0.0}
    d = 0.023
    a = estimate(late, {**motion, "motor.tau": np.sin(2 * (TIME - d))}, TIME, {"time_delay_torque.d": d})
    b = estimate(bare, {**motion, "motor.tau": np.sin(2 * TIME)}, TIME)
    np.testing.assert_allclose(a["C"][20:-20], b["C"][20:-20], atol=1e-5)


@pytest.mark.parametrize("T", [0.01, 0.05])
def test_what_a_filter_of_first_order_has_held_back_is_given_back(T):
    library = Library()
    held, bare = compile_model(library, RIG, [("low_pass", "torque")]), compile_model(library, RIG)
    motion = {"motor.phi": TIME, "der(motor.phi)": 1.0, "der(der(motor.phi))": 0.0}
    filtered = (np.sin(2 * TIME) - 2 * T * np.cos(2 * TIME)) / (1 + (2 * T) ** 2)  # settled
    a = estimate(held, {**motion, "motor.tau": filtered}, TIME, {"low_pass_torque.T": T})
    b, late = (estimate(bare, {**motion, "motor.tau": tau}, TIME)["C"] for tau in (np.sin(2 * TIME), filtered))
    np.testing.assert_allclose(a["C"][20:-20], b[20:-20], atol=1e-5)
    assert np.abs(late - b)[20:-20].max() > 0.3 * T * 50  # a gear of 50


@pytest.mark.parametrize("shake", [0.0, 2e-3])
def test_the_slope_of_a_record_is_that_of_its_time_also_where_the_rate_varies(shake):
    time = TIME + shake * np.sin(40 * TIME)
    data = Dataset.__new__(Dataset)
    data.time, data.run, data._rates = time, ONE, {}
    np.testing.assert_allclose(data._rate(np.sin(3 * time)), 3 * np.cos(3 * time), atol=2e-2)

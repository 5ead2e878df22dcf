"""Claims about a simulated controller: its error is what is missing over its gain, and none where nothing is."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import cumulative_trapezoid

from benchmarks.real_logs.make import GEARED
from pycosim.compile import Library, compile_model
from pycosim.control import tracking
from pycosim.core.errors import StudyError
from pycosim.data.dataset import Dataset
from pycosim.report import controller
from pycosim.study.parse import load_study

SPEED = 0.2  # m/s, or rad/s: past a start of half a second, the same throughout


@pytest.fixture(scope="module")
def library():
    return Library()


def steady(motor):
    """A motion that comes up to one speed and keeps it."""
    time = np.linspace(0.0, 4.0, 401)
    return tracking.wanted_motion(time, {motor: (0.3, SPEED * np.minimum(1.0, time / 0.5))})


def test_the_error_is_the_force_that_the_model_lacks_over_the_gain(library):
    axis = compile_model(library, "DriveTrain.Rigs.LinearAxis")
    time, motion = steady("motor")
    true = {"viscous_guide.b": 300.0, "carriage.J": 80.0}
    done = tracking.track(axis, true, axis, {**true, "viscous_guide.b": 100.0}, time, motion)
    end = time > 3.0
    kp, kd = done.gains["motor"]
    around = 2 * np.pi * tracking.BANDWIDTH
    assert kp == pytest.approx(80.0 * around ** 2, rel=1e-6)
    assert kd == pytest.approx(2 * tracking.DAMPING * around * 80.0, rel=1e-6)
    assert done.error["motor.phi"][end] == pytest.approx((300.0 - 100.0) * SPEED / kp, rel=1e-3)
    assert done.drive["push"][end] - done.ahead["push"][end] == pytest.approx(200.0 * SPEED, rel=1e-3)


def test_a_controller_that_knows_the_machine_leaves_next_to_nothing(library):
    joint = compile_model(library, "DriveTrain.Rigs.GearedJoint")
    time, motion = steady("motor")
    values = {n: v.value for n, v in joint.parameters.items()}
    right = tracking.track(joint, values, joint, values, time, motion)
    wrong = tracking.track(joint, values, joint, {**values, "gear.f0": 0.5 * values["gear.f0"]}, time, motion)
    late = time > tracking.SETTLING
    rms = [np.sqrt(np.mean(t.error["q"][late] ** 2)) for t in (right, wrong)]
    assert set(right.error) == {"q"} and rms[0] < 0.05 * rms[1]


def test_angles_speeds_and_accelerations_of_a_wanted_motion_agree():
    at = np.linspace(0.0, 3.0, 301)
    time, motion = tracking.wanted_motion(at, {"motor": (0.3, np.sin(2 * at))})
    assert motion["motor.phi"] == pytest.approx(0.3 + (1 - np.cos(2 * time)) / 2, abs=1e-4)
    inner = slice(5, -5)
    assert np.gradient(motion["motor.phi"], time)[inner] == pytest.approx(motion["motor.w"][inner], abs=1e-5)
    assert np.gradient(motion["motor.w"], time)[inner] == pytest.approx(motion["motor.a"][inner], abs=0.02)


def test_a_rig_that_does_not_say_what_its_motors_need_is_refused_in_words(library):
    bare = compile_model(library, "DriveTrain.Rigs.HipKneeTransmission")
    time, motion = tracking.wanted_motion(np.linspace(0, 2, 50), {m: (0.0, np.ones(50)) for m in ("motor1", "motor2")})
    with pytest.raises(StudyError, match="a gravity_model or a compensate"):
        tracking.track(bare, {}, bare, {}, time, motion)


@pytest.mark.parametrize("effect, size, grows", [("stribeck", {"fs": 0.05, "ws": 0.5}, True),
                                                 ("viscous", {"b": 0.01}, False)])
def test_a_friction_that_is_largest_at_rest_pushes_on_what_stands_and_the_page_says_so(
        effect, size, grows, library, tmp_path):
    time = np.arange(0, 12, 0.01)
    way = 3.0 * np.clip(2.0 * np.sin(2 * np.pi * time / 6.0), -1, 1) ** 3  # comes to rest, stays, and goes back
    way[np.abs(way) < 0.3] = 0.0
    pd.DataFrame({"time": time, "theta": cumulative_trapezoid(way, time, initial=0), "omega": way, "tau": way,
                  "C": 50 * way}).to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "study.toml").write_text(GEARED.replace("runs = []", 'runs = ["log.csv"]'))
    data = Dataset(load_study(tmp_path / "study.toml"), library)
    larger = compile_model(library, data.base.rig, [(effect, "gear")])
    values = {n: v.value for n, v in larger.parameters.items()} | {f"{effect}_gear.{n}": v for n, v in size.items()}
    known = SimpleNamespace(parameters={n: values[n] for n in data.base.parameters})
    loop = controller.closed_loop(data, (data.base, known), (larger, SimpleNamespace(parameters=values)))
    before, after = loop["tracking_error"]["q"]["rms"]
    assert (after > before) == grows
    found = {"closed_loop": loop, "feedforward": {}, "why_not": None}
    said = [" ".join(lines) for lines in (controller.told(data, found), controller.summary(found))]
    assert ["It grows where the motors are to stand" in text for text in said] == [grows, grows]

"""What the steps of an encoder leave in a residual through the speed and acceleration derived from it, as simulated."""

import numpy as np
import pandas as pd
import pytest

from pycosim.compile import Library
from pycosim.data.dataset import Dataset
from pycosim.data.derivatives import derivatives, passed_on
from pycosim.data.instruments import rounding
from pycosim.diagnosis.dependence import explanations
from pycosim.fit import least_squares
from pycosim.study.parse import load_study

RIG = "DriveTrain.Rigs.LinearAxis"
MASS, STEP, NOISE = 90.0, 2e-5, 0.05  # kg, m, N


def log():
    """Passes at even speeds along an axis of 90 kg, without friction worth speaking of."""
    time = np.arange(0, 40, 0.005)
    speed = np.zeros(len(time))
    for k, level in enumerate([0.0413, 0.0207, 0.0319, 0.0528]):
        way = np.concatenate([level * np.interp(np.arange(0, 5, 0.005), [0, 0.5, 4.5, 5], [0, 1, 1, 0]) * sign
                              for sign in (1, -1)])
        speed[2000 * k:2000 * (k + 1)] = way
    position = np.cumsum(speed) * 0.005
    force = 20 * np.sign(speed) + 180 * speed + MASS * np.gradient(speed, time)
    noise = NOISE * np.random.default_rng(0).standard_normal(len(time))
    return pd.DataFrame({"time": time, "x": position, "F": force + noise})


def opened(folder, frame):
    frame.to_csv(folder / "log.csv", index=False)
    (folder / "study.toml").write_text(f"""
[rig]
model = "{RIG}"
[data]
runs = ["log.csv"]
[columns]
x = {{ variable = "motor.phi", unit = "m" }}
F = {{ variable = "force", unit = "N" }}
[parameters]
"carriage.J" = {{ value = {MASS}, fixed = false }}
"guide.f0" = {{ value = 20.0, fixed = false }}
"viscous_guide.b" = {{ value = 180.0, fixed = false }}
""")
    data = Dataset(load_study(folder / "study.toml"), Library())
    return data, least_squares.fit(data, data.base)


@pytest.fixture(scope="module")
def coarse(tmp_path_factory):
    """The log as an encoder of 20 um reads it, and its fit."""
    frame = log()
    return opened(tmp_path_factory.mktemp("coarse"), frame.assign(x=np.round(frame["x"] / STEP) * STEP))


def left_at_constant_speed(data, fit):
    """Residual and samples where an acceleration is noise alone."""
    left = data.residuals(data.base, fit.free, fit.parameters, "fit").residual(fit.values)[0]
    smooth = data.motion.calm("motor.phi", 0.2)["der(der(motor.phi))"][data.view("fit")]
    steady = np.abs(smooth) < 0.02 * np.abs(smooth).max()
    return left[steady], steady


def test_rounding_drawn_anew_leaves_as_much_as_the_rounding_that_was_recorded(coarse):
    data, fit = coarse
    left, steady = left_at_constant_speed(data, fit)
    drawn, rng = rounding(data, data.base, fit), np.random.default_rng(0)
    sizes = [np.sqrt(np.mean(drawn(rng)[0, steady] ** 2)) for _ in range(8)]
    assert np.sqrt(np.mean(left ** 2)) > 1.5 * NOISE  # the noise of the force is not all that is left
    assert 0.7 < np.median(sizes) / np.sqrt(np.mean(left ** 2) - NOISE ** 2) < 1.4


def test_an_acceleration_that_explains_a_residual_does_not_hold_the_residual_s_own_noise(coarse):
    data, fit = coarse
    at, (left, steady) = data.view("fit"), left_at_constant_speed(data, fit)
    own = data.signals["der(der(motor.phi))"][at][steady]
    told = explanations(data, data.base, fit, at)["acceleration@guide"][steady]
    assert abs(np.corrcoef(left, own)[0, 1]) > 0.7
    assert abs(np.corrcoef(left, told)[0, 1]) < 0.2


def test_errors_of_an_angle_pass_on_to_its_derivatives_as_the_derivatives_of_both_differ():
    time = np.arange(0, 10, 0.01)
    angle, error = np.sin(time), 1e-4 * np.random.default_rng(0).standard_normal(1000)
    bare = derivatives(time, angle + error)
    follow = passed_on(time, bare.bandwidth, bare.trust)
    whole, clean = follow(angle + error, angle), follow(angle, angle)
    np.testing.assert_allclose(whole[2], bare.second, atol=1e-6 * np.abs(bare.second).max())
    np.testing.assert_allclose(whole[1] - clean[1], follow(error, angle)[1], atol=1e-9)

"""Where a record ends in motion its curve has one side: what it does not follow there is not compared."""

import numpy as np
import pandas as pd
import pytest

from benchmarks.real_logs.make import GEARED
from pycosim.compile import Library
from pycosim.data.dataset import Dataset
from pycosim.data.derivatives import derivatives
from pycosim.study.parse import load_study

STEP = 0.002
TIME = np.arange(0, 30, STEP)


def motion(fade):
    """A swing that begins and ends in motion, with a speed that comes and goes within ``fade`` s; its acceleration."""
    grows = np.clip(np.minimum(TIME, TIME[-1] - TIME) / fade, 0, 1) if fade else np.ones(len(TIME))
    speed = (1.2 + 0.3 * np.sin(1.3 * TIME)) * (0.3 + 0.35 * (1 - np.cos(np.pi * grows)))
    angle = np.cumsum(speed) * STEP + 2e-5 * np.random.default_rng(0).standard_normal(len(TIME))
    return angle, np.gradient(speed, TIME)


def test_ends_at_which_a_motion_sets_off_and_stops_are_unsure_as_far_as_the_acceleration_is_off():
    angle, acceleration = motion(0.06)
    found = derivatives(TIME, angle)
    off = np.abs(found.second - acceleration)
    assert off.max() > 5 and off[~found.unsure].max() < 0.5
    assert found.unsure.sum() * STEP < 1.5
    assert found.unsure[0] and found.unsure[-1] and not found.unsure[len(TIME) // 2]


@pytest.mark.parametrize("scale", [1.0, 50.0, 1e-3])
def test_ends_at_which_a_motion_goes_on_are_not_and_units_change_nothing(scale):
    assert not derivatives(TIME, scale * motion(0)[0]).unsure.any()
    fast = motion(0.06)[0]
    np.testing.assert_array_equal(derivatives(TIME, scale * fast).unsure, derivatives(TIME, fast).unsure)


def test_unsure_ends_are_not_compared(tmp_path):
    angle, _ = motion(0.06)
    frame = pd.DataFrame({"time": TIME, "theta": angle, "tau": 0.3, "C": 10.0})
    frame.to_csv(tmp_path / "log.csv", index=False)
    lines = GEARED.replace("runs = []", 'runs = ["log.csv"]').splitlines()
    (tmp_path / "study.toml").write_text("\n".join(line for line in lines if not line.startswith("omega")))
    dataset = Dataset(load_study(tmp_path / "study.toml"), Library())
    unsure = derivatives(TIME, angle).unsure
    assert unsure.any() and not dataset.moving[unsure].any() and dataset.moving[~unsure].mean() > 0.95

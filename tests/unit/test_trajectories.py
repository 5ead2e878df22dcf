"""Claims about motions: a file of either angles is followed, whichever of them the model takes as its states."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pycosim.compile import Library, compile_model
from pycosim.control.trajectories import from_file
from pycosim.dynamics.simulate import dynamics

RIG = Path(__file__).parents[2] / "examples" / "barrier" / "Barrier.mo"  # its state is the motor's angle, not the arm's


@pytest.fixture(scope="module")
def barrier():
    """The model, and the values that its parameters have."""
    model = compile_model(Library([RIG]), "Barrier")
    found = dynamics(model)
    assert "motor.phi" in found.start and "q" not in found.start
    return model, {n: model.parameters[n].value for n in found.parameters}


@pytest.mark.parametrize("given, factor", [("motor.phi", 40.0), ("q", 1.0)])
def test_either_angle_of_a_motor_with_inertia_is_followed(barrier, given, factor, tmp_path):
    time = np.linspace(0, 2, 41)
    arm = 0.5 + 0.2 * (1 - np.cos(np.pi * time))
    pd.DataFrame({"time": time, given: factor * arm}).to_csv(tmp_path / "motion.csv", index=False)
    motion = from_file(tmp_path / "motion.csv", *barrier, 20.0)
    assert np.allclose(motion.columns["ref.q"], arm, atol=1e-3)
    assert np.allclose(motion.columns["ref.motor.phi"], 40 * arm, atol=4e-2)
    assert np.abs(motion.columns["ref.motor.w"] - 40 * 0.2 * np.pi * np.sin(np.pi * time))[2:-2].max() < 0.1

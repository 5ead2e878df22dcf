"""Trajectories of every example against an independent Modelica compiler, with its own index reduction and solver."""

import numpy as np
import pytest

from pycosim.compile.parse import LIBRARY
from pycosim.dynamics.simulate import dynamics, simulate

EXAMPLES = sorted(p.stem for p in (LIBRARY / "DriveTrain" / "Examples").glob("*.mo") if p.stem != "package")
END = 2.0


@pytest.mark.parametrize("name", EXAMPLES)
def test_motion_agrees_and_the_difference_shrinks_with_the_step(model, rumoca_model, name):
    rumoca = pytest.importorskip("rumoca")
    oracle = rumoca_model(f"Examples.{name}").simulate(END, dt=0.01, config=rumoca.SimConfig(rtol=1e-9, atol=1e-11))
    example, time = model(f"Examples.{name}"), np.array(oracle.time)
    moving = [n for n in dynamics(example).states if not n.endswith(".z")]
    assert moving
    errors = [_error(oracle, simulate(example, {}, time, step=step), moving) for step in (2e-3, 2.5e-4)]
    assert errors[0] < 2e-3
    assert errors[1] < 2e-4
    assert errors[1] < errors[0] / 4


@pytest.mark.parametrize("name", ["GearedJoint", "ServoPendulum"])
def test_the_difference_is_of_second_order_down_to_a_millionth(model, rumoca_model, name):
    rumoca = pytest.importorskip("rumoca")
    oracle = rumoca_model(f"Examples.{name}").simulate(END, dt=0.01, config=rumoca.SimConfig(rtol=1e-9, atol=1e-11))
    example, time = model(f"Examples.{name}"), np.array(oracle.time)
    moving = [n for n in dynamics(example).states if not n.endswith(".z")]
    coarse, fine = (_error(oracle, simulate(example, {}, time, step=step), moving) for step in (1e-3, 6.25e-5))
    assert fine < 1e-6
    assert coarse / fine > 100  # 256, were there no reversals


def _error(oracle, ours, names):
    """Largest difference, as a fraction of the variable's range."""
    return max(np.abs(ours[n] - np.array(oracle[n])).max() / np.ptp(ours[n]) for n in names)

"""Trajectories of every example against an independent Modelica compiler, with its own index reduction and solver."""

import numpy as np
import pytest

from pycosim.compile import compile_model, find_effect
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


def test_free_functions_of_an_angle_move_alike(library, tmp_path):
    rumoca = pytest.importorskip("rumoca")
    effects = {"angle_torque": ("joint", 0.5, -1.0, 1.0), "angle_friction": ("gear", 0.02, -50.0, 50.0),
               "motor_angle_torque": ("motor", 0.01, -50.0, 50.0)}
    rig = compile_model(library, "DriveTrain.Rigs.GearedJoint", [(e, at[0]) for e, at in effects.items()])
    text, given = rig.text, {}
    for effect, (place, size, low, high) in effects.items():
        base = f"{effect}_{place}"
        own = {c: float(size * np.sin(2.0 * k)) for k, c in enumerate(find_effect(library, effect).size)}
        own.update(low=low, high=high)
        given.update({f"{base}.{c}": v for c, v in own.items()})
        assert f" {base} " in text
        text = text.replace(f" {base} ", f" {base}({', '.join(f'{c} = {v!r}' for c, v in own.items())}) ", 1)
    driven = "model Driven\n  Improved rig(tau = 0.2 * sin(1.5 * time), push = 0);\nend Driven;\n"
    (tmp_path / "Free.mo").write_text(f"package Free\n{text}{driven}end Free;\n")
    session = rumoca.Session(roots=[str(LIBRARY / "DriveTrain")])
    oracle = session.load(str(tmp_path / "Free.mo"), model="Free.Driven").simulate(
        END, dt=0.01, config=rumoca.SimConfig(rtol=1e-9, atol=1e-11))
    time, theirs = np.array(oracle.time), np.array(oracle["rig.q"])
    inputs = {"tau": 0.2 * np.sin(1.5 * time)}
    ours, without = (simulate(rig, inputs, time, more, step=2.5e-4)["q"] for more in (given, None))
    assert np.abs(ours - theirs).max() < 2e-4 * np.ptp(theirs)
    assert np.abs(without - theirs).max() > 1e-2 * np.ptp(theirs)  # they do something


def _error(oracle, ours, names):
    """Largest difference, as a fraction of the variable's range."""
    return max(np.abs(ours[n] - np.array(oracle[n])).max() / np.ptp(ours[n]) for n in names)

"""Claims about the included controllers: they equal their FMUs, and do what they are for."""

from dataclasses import replace

import numpy as np
import pytest

from pycosim.compile import compile_model
from pycosim.control import controllers
from pycosim.core.errors import StudyError
from pycosim.cosim.master import cosimulate
from pycosim.dynamics.simulate import estimate

GAIN = "parameters = { kp = 1.0, kd = 0.02, ki = 2.0 }"


FALL = 'inputs = { "ref.C" = 25.0 }\n'


def as_fmu(made, fmi, kinds=("plant", "controller")):
    """The same scenario with FMUs."""
    return replace(made, components=[replace(c, run="fmu", fmi=fmi) if c.kind in kinds else c for c in made.components])


def check_equal(a, b):
    for name in a:
        assert np.abs(a[name] - b[name]).max() <= 1e-8 * max(1, np.abs(a[name]).max()), name


@pytest.mark.parametrize("method", ["gauss-seidel", "jacobi"])
def test_fmus_of_plant_controller_and_estimator_do_what_they_do_in_process(scenario, library, method):
    made = scenario(("seed = 3", f'seed = 3\nmethod = "{method}"'), ("kp = 1.0,", "integral_max = 0.5, kp = 1.0,"))
    check_equal(*(cosimulate(s, library=library).log for s in (made, as_fmu(made, 2))))


@pytest.mark.parametrize("kind", ["torque", "hand"])
def test_the_other_controllers_equal_their_fmus(scenario, library, kind):
    fmi = 2 if kind == "torque" else 3
    change = (('"reference -> controller", ', "") if kind == "torque" else
              ("controller.motor.tau -> plant.tau", "controller.push -> plant.push"))
    made = scenario(('controller = "position"', f'controller = "{kind}"'),
                    (f"{GAIN}\n", FALL if kind == "torque" else ""), change)
    parts = [c for c in made.components if c.name != "estimator"]
    made = replace(made, components=parts, connections=[c for c in made.connections if "estimator" not in c],
                   columns={n: c for n, c in made.columns.items() if c.signal[0] != "estimator"})
    a, b = (cosimulate(s, library=library) for s in (made, as_fmu(made, fmi, ["controller"])))
    assert np.ptp(a.log["C"]) > 0.01
    check_equal(a.log, b.log)
    part = cosimulate(as_fmu(made, fmi, ["controller"]), until=0.61, library=library)
    assert cosimulate(as_fmu(made, fmi, ["controller"]), resume=part.checkpoint, library=library).text == b.text


def test_an_fmu_goes_on_from_a_checkpoint_bit_for_bit(scenario, library):
    made = scenario(('run = "process"', ""), (GAIN, f'{GAIN}\nrun = "fmu"'))
    whole, part = cosimulate(made, library=library), cosimulate(made, until=0.61, library=library)
    assert cosimulate(made, resume=part.checkpoint, library=library).text == whole.text


def test_the_estimator_is_the_estimate_of_the_model_sample_by_sample(scenario, library):
    made = scenario((", noise = 1e-3", ""), (", quantum = 1e-4", ""),
                    ('q = "plant.q"', 'q = "plant.q"\nacceleration = "plant.motor.a"'))
    log = cosimulate(made, library=library).log
    model = compile_model(library, "DriveTrain.Rigs.GearedJoint")
    columns = {"motor.phi": "theta", "der(motor.phi)": "omega", "der(der(motor.phi))": "acceleration",
               "motor.tau": "tau"}
    offline = estimate(model, {n: log[c].to_numpy() for n, c in columns.items()}, log["time"].to_numpy())["C"]
    assert np.ptp(log["omega"]) > 10 and np.abs(offline - log["estimate"]).max() < 1e-6 * np.abs(offline).max()


def test_compensation_of_the_right_friction_takes_it_away_and_none_leaves_it(scenario, library):
    def error(share):
        made = scenario(("[components.plant]", f"options = {{ friction = {share} }}\n[components.plant]"),
                        ("rate = 200", "rate = 500"), ("rate = 250", "rate = 500"), ("ki = 2.0", "ki = 0.0"))
        log = cosimulate(made, library=library).log
        return np.sqrt(np.mean((log["q"] - log["wanted"])[40:] ** 2))
    assert error(1.0) < 0.5 * error(0.0)


def test_without_compensation_the_ideal_law_is_left(library):
    model = compile_model(library, "DriveTrain.Rigs.HipKnee")
    values = {n: p.value for n, p in model.parameters.items()}
    block = controllers.torque_control(model, values, gravity=False, friction=0.0)
    u = dict.fromkeys((v.name for v in block.inputs), 0.3) | {"ref.C_H": 12.0, "ref.C_K": -5.0}
    y = block.output([v.value for v in block.states], [u[v.name] for v in block.inputs],
                     [v.value for v in block.parameters])
    assert np.allclose(np.array(y).ravel(), np.array([12 - 5, 12 + 5]) / (2 * 15.125), atol=1e-12)


def test_a_joint_side_controller_uses_the_joint_angles(library):
    model = compile_model(library, "DriveTrain.Rigs.HipKnee")
    values = {n: p.value for n, p in model.parameters.items()}
    block = controllers.make("position", model, values, side="joint")
    assert {"q_H", "q_K"} <= {v.name for v in block.inputs}
    assert all(v.description and v.unit for v in (*block.inputs, *block.outputs, *block.parameters))


def test_a_rig_without_joints_is_told_so(library):
    model = compile_model(library, "DriveTrain.Rigs.ScrewDrive")
    values = {n: p.value for n, p in model.parameters.items()}
    with pytest.raises(StudyError, match="joint"):
        controllers.make("position", model, values)

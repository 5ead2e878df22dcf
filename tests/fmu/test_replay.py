"""Claims about the replay of a log through the FMU: every rig has one, with a torque reference or without."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pycosim as pc
from pycosim.compile import Library, compile_model, component_name
from pycosim.cosim.replay import before_and_after
from pycosim.data.dataset import Dataset
from pycosim.dynamics.simulate import estimate
from pycosim.study.parse import load_study

ROOT = Path(__file__).parents[2]
DATA = ROOT / "../shared/data"
PENDULUM = ROOT / "examples" / "double_pendulum" / "DoublePendulum.mo"
TIME = np.arange(0, 20, 4e-3)
SPEEDS = np.array([-60.0, -35, -20, -10, 10, 20, 35, 60])  # rad/s, of the screw: one a log

STUDY = """
[rig]
model = "{rig}"
modelica = {modelica}
[parameters]
{parameters}
[data]
runs = {runs}
{more}
[columns]
{columns}
{effects}
"""

# A rig without a torque reference, the form of its question, the size of its motion, the effects of the machine by
# their place, and the noise of what is asked for.
UNEVEN = "direction_asymmetry", {"a": 0.4}
RIGS = {
    "axis": ("DriveTrain.Rigs.LinearAxis", 0, 0.1, {"guide": UNEVEN}, 0.5),
    "servo": ("DriveTrain.Rigs.ServoPendulum", 0, 1.2, {"gear": UNEVEN}, 0.05),
    "screw": ("DriveTrain.Rigs.ScrewDrive", 0, 30.0, {"screw": UNEVEN}, 2e-4),
    "geared joint": ("DriveTrain.Rigs.GearedJoint", 1, 40.0, {"gear": ("viscous", {"b": 3e-3})}, 5e-3),
    "double pendulum": ("DoublePendulum", 0, 0.8, {"shoulder": UNEVEN, "elbow": UNEVEN}, 5e-3)}


@pytest.fixture(scope="module")
def library():
    return Library([PENDULUM])


def machine(library, rig, effects):
    """Model of a rig with effects, and its parameters."""
    model = compile_model(library, rig, [(effect, place) for place, (effect, _) in effects.items()])
    values = {n: v.value for n, v in model.parameters.items()}
    for attached in model.attached:
        values |= {f"{component_name(*attached)}.{c}": v for c, v in effects[attached[1].name][1].items()}
    return model, values


def motion(model, form, size, time=TIME):
    """Angles of the motors, or their speed where that is what the rig is given."""
    known = [n for n in model.alternatives("estimate")[form][1] if n.startswith("motor")]
    pace = 2 * np.pi * np.array([[0.21, 0.53], [0.17, 0.61]])
    return {n: size * (0.8 * np.sin(a * time) + 0.2 * np.sin(b * time + 1)) for n, (a, b) in zip(known, pace)}


def recorded(model, values, form, signals, noise, seed):
    """A log: what is given, and with noise what the rig is asked for; pushes are none, and no column of it."""
    given = {n: signals.get(n, 0.0) for n in model.alternatives("estimate")[form][1]}
    told, rng = estimate(model, given, TIME, values, form), np.random.default_rng(seed)
    asked = {n: told[n] + noise * rng.standard_normal(len(TIME)) for n in model.alternatives("estimate")[form][0]}
    return pd.DataFrame({"time": TIME, **signals, **asked})


def dataset(folder, library, machine, logs, more=""):
    """The logs with a study that has the effects and the values of the machine."""
    (model, values), columns = machine, [c for c in logs[0] if c != "time"]
    for k, log in enumerate(logs):
        log.to_csv(folder / f"{k}.csv", index=False)
    (folder / "study.toml").write_text(STUDY.format(
        rig=model.rig, modelica=[str(PENDULUM)] if model.rig == "DoublePendulum" else [], more=more,
        runs=[str(folder / f"{k}.csv") for k in range(len(logs))],
        parameters="\n".join(f'"{n}" = {{ value = {v}, fixed = true }}' for n, v in values.items()),
        columns="\n".join(f'"{c}" = {{ variable = "{c}", unit = "{model.unit(c)}" }}' for c in columns),
        effects="\n".join(f'[[effects]]\neffect = "{e}"\nplace = "{p}"' for e, p in model.keys)))
    return Dataset(load_study(folder / "study.toml"), library)


@pytest.mark.parametrize("case", RIGS)
def test_a_rig_without_a_torque_reference_is_replayed_and_both_errors_fall(library, tmp_path, case):
    rig, form, size, effects, noise = RIGS[case]
    model, values = machine(library, rig, effects)
    log = recorded(model, values, form, motion(model, form, size), noise, 1)
    data = dataset(tmp_path, library, (model, values), [log])
    found = before_and_after(data)
    assert found["why"] is None and set(found["after"]) == set(data.outputs)
    for channel, after in found["after"].items():
        assert after < 0.7 * found["before"][channel] and after == pytest.approx(noise, rel=0.1)


def test_a_force_recorded_late_meets_the_motion_of_its_own_time(library, tmp_path):
    late, noise, axis = 0.01, 0.2, "DriveTrain.Rigs.LinearAxis"
    model, values = machine(library, axis, {"force": ("time_delay", {"d": late})})
    log = recorded(*machine(library, axis, {}), 0, motion(model, 0, 0.1, TIME - late), noise, 3)
    data = dataset(tmp_path, library, (model, values), [log.assign(**motion(model, 0, 0.1))])
    found = before_and_after(data)
    assert found["before"]["force"] > 3 * noise and found["after"]["force"] == pytest.approx(noise, rel=0.1)


def test_logs_that_are_one_sample_each_are_stepped_through_and_their_means_compared(library, tmp_path):
    model, values = machine(library, "DriveTrain.Rigs.ScrewDrive", {"screw": UNEVEN})
    rng = np.random.default_rng(2)
    logs = [recorded(model, values, 0, {"motor.w": w + 0.2 * rng.standard_normal(len(TIME))}, 1e-3, k).iloc[:500]
            for k, w in enumerate(SPEEDS)]
    data = dataset(tmp_path, library, (model, values), logs, 'average = "file"')
    found = before_and_after(data)
    assert found["why"] is None and found["after"]["tau"] < 0.2 * found["before"]["tau"]
    assert found["after"]["tau"] < 3 * 1e-3 / np.sqrt(500)


@pytest.mark.skipif(not DATA.is_dir(), reason=f"the measured data are not in {DATA}")
def test_the_measured_axis_is_replayed_in_newtons_and_both_errors_fall():
    study = load_study(ROOT / "examples" / "emps" / "study.toml")
    found = pc.open(study).fit().add("viscous_asymmetry@guide").confirm(DATA / "emps" / "pulses.csv")
    assert found.confirmed == {"viscous_asymmetry@guide": True} and found.record["units"] == {"force": "N"}
    before, after = (found.replay[k]["force"] for k in ("before", "after"))
    frame = found.to_frame().iloc[0]
    assert after < 0.9 * before
    assert (before, after) == pytest.approx((frame.error_without_force, frame.error_with_force), rel=0.01)

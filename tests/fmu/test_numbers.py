"""The FMU computes what Python computes: steps, variables, derivatives."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from driver import EXPORTS, OK, Instance

from pycosim.dynamics.simulate import simulate
from pycosim.export.description import values

DRIVE = {"GearedJoint": {"tau": 0.9}, "ScrewDrive": {"tau_in": 8e-3}, "ServoPendulum": {"v_in": 5.0},
         "HipKnee": {"tau1": 0.8, "tau2": 0.5, "push_H": 3.0, "push_K": -2.0}}


def drive(rig, time):
    """Inputs that reverse, stick and slip."""
    return {n: a * np.sin((3 + k) * time) for k, (n, a) in enumerate(DRIVE[rig].items())}


def walk(instance, inputs, time, names):
    """Values of some variables after each communication step, inputs held."""
    rows = []
    for k, t in enumerate(time[:-1]):
        assert instance.set(list(inputs), [v[k] for v in inputs.values()]) == OK
        assert instance.step(t, time[k + 1] - t) == OK, instance.messages
        rows.append(instance.get(*names))
    return np.array(rows)


@pytest.mark.parametrize(("rig", "fmi"), EXPORTS)
def test_the_fmu_steps_as_python_does(built, model, study, rig, fmi):
    fmu, time = built(rig, fmi), np.arange(301) * 2e-3
    u = drive(rig, time)
    expected = simulate(model(rig), u, time, values(study(rig), model(rig)), hold=True)
    names = [n for n in expected if n in fmu.vr and n not in u]
    found = walk(Instance(fmu), u, time, names)
    assert len(names) > 30
    for name, column in zip(names, found.T):
        scale = max(1.0, np.abs(expected[name]).max())
        assert np.abs(column - expected[name][1:]).max() <= 1e-9 * scale, name


@pytest.mark.parametrize(("rig", "fmi"), EXPORTS)
def test_the_fmu_computes_the_reference_results_that_it_brings(built, rig, fmi):
    fmu = built(rig, fmi)
    given, expected = (np.genfromtxt(fmu.folder / "documentation" / "reference" / f"{rig}_{n}.csv", delimiter=",",
                                     names=True, deletechars="") for n in ("in", "ref"))
    inputs, names = given.dtype.names[1:], [n for n in expected.dtype.names[1:] if n not in given.dtype.names]
    found = walk(Instance(fmu), {n: given[n] for n in inputs}, given["time"], names)[9::10]
    assert len(expected) == len(found) + 1 > 40 and len(names) > 5
    for name, column in zip(names, found.T):
        # what follows the torque at once is read after its step, still under the torque of that step
        scale = max(1.0, np.abs(expected[name]).max())
        assert np.abs(column - expected[name][1:]).max() < 1e-6 * scale, name
    assert max(np.ptp(expected[n]) for n in names) > 1e-3


def test_reading_does_not_change_what_follows(fmu):
    time = np.arange(100) * 1e-3
    u = drive("GearedJoint", time)
    quiet, curious = Instance(fmu), Instance(fmu)
    last = walk(quiet, u, time, ["q"])[-1]
    for k, t in enumerate(time[:-1]):
        curious.get("gear.L", "C")
        curious.set("tau", u["tau"][k])
        curious.get("gear.L", "C")
        assert curious.step(t, time[k + 1] - t) == OK
    assert curious.get("q") == last


def test_the_communication_step_changes_nothing_on_the_same_grid(fmu):
    fine, coarse = Instance(fmu), Instance(fmu)
    for plant, h in ((fine, 1e-3), (coarse, 8e-3)):
        assert plant.set("tau", 0.7) == OK
        for k in range(round(0.4 / h)):
            assert plant.step(k * h, h) == OK
    assert np.allclose(fine.get("q", "w", "gear.loss"), coarse.get("q", "w", "gear.loss"), rtol=1e-9, atol=1e-12)


def test_halving_a_short_communication_step_shows_the_order_of_the_method(fmu):
    """Away from sticking the error of the step is of order two at least, so halving takes three quarters away."""
    ends = []
    for parts in (1, 2, 16):
        plant = Instance(fmu, started=False)
        plant.set_up(load__w=0.5, q=0.2, tau=1.5, gear__z=1.0, solver__step=0.005)
        h = 0.005 / parts  # short enough not to be halved by itself
        for k in range(20 * parts):
            assert plant.step(k * h, h) == OK
        ends.append(np.array(plant.get("q", "w")))
    first, second = (np.abs(e - ends[2]).max() for e in ends[:2])
    assert second < first / 3.5 and first < 5e-3 * np.abs(ends[2]).max()


def test_inputs_follow_a_given_derivative(built, model, study):
    import ctypes as c
    fmu, time = built("GearedJoint", 2), np.arange(101) * 2e-3
    tau = 0.5 + 2.0 * time
    expected = simulate(model("GearedJoint"), {"tau": tau}, time, values(study("GearedJoint"), model("GearedJoint")))
    plant = Instance(fmu, started=False)
    plant.set_up(tau=0.5)
    for k, t in enumerate(time[:-1]):
        plant.set("tau", tau[k])
        status = plant.call("SetRealInputDerivatives", plant.references(["tau"]), c.c_size_t(1), (c.c_int * 1)(1),
                            (c.c_double * 1)(2.0))
        assert status == OK and plant.step(t, 2e-3) == OK
        assert plant.get("q") == pytest.approx(expected["q"][k + 1], abs=1e-9)


def test_a_state_restored_in_another_process_goes_on_bit_for_bit(fmu, tmp_path):
    plant, names = Instance(fmu), ["q", "w", "gear.L", "gear.z"]
    plant.set("tau", 0.8)
    for k in range(50):
        plant.step(k * 1e-3, 1e-3)
    (tmp_path / "state").write_bytes(plant.serialize())
    for k in range(50, 70):
        plant.step(k * 1e-3, 1e-3)
    done = subprocess.run([sys.executable, str(Path(__file__).with_name("driver.py")), str(fmu.path),
                           str(tmp_path / "again"), str(tmp_path / "state"), ",".join(names)],
                          capture_output=True, text=True, check=True)
    assert done.stdout.split() == [v.hex() for v in plant.get(*names)]


def test_reset_and_rerun_are_equal_bit_for_bit(fmu):
    plant = Instance(fmu)
    for run in range(2):
        plant.set("tau", 0.8)
        for k in range(60):
            plant.step(k * 1e-3, 1e-3)
        found = plant.get("q", "w", "gear.L", "gear.f0")
        if run == 0:
            first = found
            plant.set("gear.f0", 0.3)
            assert plant.call("Terminate") == OK and plant.call("Reset") == OK
            plant.set_up()
    assert found == first


def point(fmu, me=True):
    """An instance that hardly moves, where load and friction state both count."""
    plant = Instance(fmu, me, started=False)
    plant.set_up(load__w=5e-4, q=0.4, gear__z=0.6, tau=0.5, push=0.2)
    return plant


@pytest.mark.parametrize("me", [True, False], ids=["me", "cs"])
@pytest.mark.parametrize("known", ["q", "load.w", "gear.z", "tau", "push", "gear.f0", "gear.mu", "viscous_gear.b"])
def test_directional_derivatives_are_those_of_finite_differences(fmu, known, me):
    unknowns = ["der(load.w)", "der(gear.z)", "gear.L", "C", "gear.loss", "motor.w", "q"]
    found = point(fmu, me).directional(unknowns, [known], [1.0])
    ends, step = [], 1e-6
    for sign in (1, -1):
        plant = Instance(fmu, me, started=False)
        start = {"load.w": 5e-4, "q": 0.4, "gear.z": 0.6, "tau": 0.5, "push": 0.2}
        assert plant.enter() == OK and plant.set(list(start), list(start.values())) == OK
        assert plant.set(known, plant.get(known) + sign * step) == OK
        assert plant.exit() == OK
        ends.append(np.array(plant.get(*unknowns)))
    difference = (ends[0] - ends[1]) / (2 * step)
    assert np.allclose(found, difference, rtol=2e-6, atol=2e-6 * max(1, np.abs(difference).max()))
    assert np.abs(found).max() > 0


def test_the_adjoint_is_the_transpose(built):
    plant = point(built("GearedJoint", 3))
    unknowns, knowns = ["der(load.w)", "gear.L", "C", "q"], ["q", "load.w", "gear.z", "tau", "gear.f0", "time"]
    columns = [plant.directional(unknowns, [k], [1.0]) for k in knowns]
    rows = [plant.directional([u], knowns, [1.0], adjoint=True) for u in unknowns]
    assert np.allclose(np.array(columns).T, rows, rtol=1e-12, atol=1e-12)
    assert np.abs(rows).max() > 1


def test_what_stands_still_is_said(fmu):
    plant = Instance(fmu)
    assert plant.flag("gear.still")
    plant.set("tau", 2.0)
    plant.step(0.0, 0.1)
    assert not plant.flag("gear.still") and abs(plant.get("gear.w")) > 0.02


def test_values_are_the_studys_and_friction_is_tunable(fmu):
    plant = Instance(fmu)
    assert plant.get("gear.f0", "gear.mu", "stribeck_gear.fs") == [0.04, 0.9, 0.01]
    known = {v.name: v.variability for v in fmu.description.modelVariables}
    assert known["gear.f0"] == known["stribeck_gear.ws"] == "tunable" and known["load.m"] == "fixed"
    assert plant.set("gear.f0", 0.2) == OK and plant.get("gear.f") > 0.19

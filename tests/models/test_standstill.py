"""Standstill is part of the model: no creep under load, and the sliding law as the limit of short travels."""

import casadi as ca
import numpy as np
import pytest

from pycosim.errors import DataError, ModelicaError, UnknownNameError
from pycosim.simulate import compensate, dynamics, estimate, simulate, step_function
from pycosim.states import propagate


def held(model):
    """A joint whose gravity asks for 80 % of what friction can hold."""
    rig = model("Rigs.GearedJoint")
    p = {n: v.value for n, v in rig.parameters.items()}
    # standing, tau_in = 0: L = tau_out / 2, so friction holds F = F0 + c |tau_out| / 2
    c, floor = 2 * (1 - p["gear.mu"]) / (1 + p["gear.mu"]), 2 * p["gear.mu"] * p["gear.f0"] / (1 + p["gear.mu"])
    breakaway = floor / (1 - c / 2) * p["reduction.ratio"]
    return rig, np.arcsin(0.8 * breakaway / (p["load.m"] * p["load.l"] * p["load.g"])), p


@pytest.mark.parametrize("step", [1e-3, 1e-2])
def test_a_load_below_breakaway_does_not_creep(model, step):
    rig, q, p = held(model)
    time = np.linspace(0, 60, 61)
    y = simulate(rig, {}, time, start={"q": q, "gear.z": -0.8}, step=step)
    assert np.abs(y["motor.phi"] - y["motor.phi"][0]).max() < 5 * p["gear.travel"]  # elastic, as -0.8 is not exact
    assert np.ptp(y["motor.phi"][30:]) < 1e-6
    assert abs(y["motor.w"][-1]) < 1e-8
    assert y["gear.s"][-1] == pytest.approx(-0.8, abs=0.03)


@pytest.mark.parametrize("step", [1e-3, 1e-2])
def test_a_load_let_go_at_once_rings_and_comes_to_rest(model, step):
    rig, q, p = held(model)
    y = simulate(rig, {}, np.linspace(0, 60, 61), start={"q": q}, step=step)
    assert np.abs(y["motor.phi"] - y["motor.phi"][0]).max() < 30 * p["gear.travel"]
    assert np.ptp(y["motor.phi"][30:]) < 1e-6
    assert abs(y["motor.w"][-1]) < 1e-8


def test_a_load_above_breakaway_falls(model):
    rig, q, p = held(model)
    y = simulate(rig, {}, np.linspace(0, 2, 21), start={"q": 1.3 / 0.8 * q, "gear.z": -1})
    assert y["motor.phi"][-1] < y["motor.phi"][0] - 1000 * p["gear.travel"]


def log(n=4000):
    """Motor angles that reverse several times, with torques of both signs."""
    time = np.linspace(0, 8, n)
    one, two = np.sin(1.3 * time), 0.8 * np.sin(2.1 * time + 0.4)
    return time, {"motor1.phi": one, "motor2.phi": two, "der(motor1.phi)": 1.3 * np.cos(1.3 * time),
                  "der(motor2.phi)": 1.68 * np.cos(2.1 * time + 0.4), "motor1.tau": 0.6 + 0.3 * np.sin(time),
                  "motor2.tau": 0.4 * np.cos(0.7 * time)}


def test_estimate_on_moving_samples_is_the_sliding_law_in_the_limit(model):
    rig = model("Rigs.HipKnee")
    time, signals = log()
    question = rig.question("estimate")
    error = []
    for travel in (1e-2, 1e-3, 1e-4):
        y = estimate(rig, signals, time, {f"{s}.travel": travel for s in rig.segments})
        p = [rig.parameters[n].value for n in question.parameters]
        u = np.array([np.broadcast_to(signals.get(n, 0.0), len(time)) for n in question.inputs])
        limit = np.array(question.sliding().map(len(time))(u, p))[question.outputs.index("C_H")]
        moving = np.all([np.abs(y[f"{s}.w"]) > 0.3 for s in rig.segments], axis=0)
        assert 0.2 < moving.mean() < 0.9
        error.append(np.abs(y["C_H"] - limit)[moving].max())
    assert error[0] > 100 * error[1] and error[2] < 1e-9


def test_compensate_inverts_estimate_along_a_log_with_reversals(model):
    rig = model("Rigs.HipKnee")
    time, signals = log(1000)
    y = estimate(rig, signals, time)
    wanted = {n: v for n, v in signals.items() if not n.endswith(".tau")} | {n: y[n] for n in ("C_H", "C_K")}
    back = compensate(rig, wanted, time)
    for n in ("motor1.tau", "motor2.tau"):
        np.testing.assert_allclose(back[n], signals[n], atol=1e-9)


def test_estimate_gives_back_what_simulate_made(model):
    rig = model("Rigs.GearedJoint")
    time = np.linspace(0, 3, 3001)
    y = simulate(rig, {"tau": 0.15 * np.sin(3 * time)}, time, start={"q": 0.2})
    known = {"motor.phi": y["motor.phi"], "motor.tau": y["tau"], "der(motor.phi)": y["motor.w"],
             "der(der(motor.phi))": y["motor.a"]}
    again = estimate(rig, known, time)
    assert np.abs(again["C"] - y["C"]).max() < 0.02 * np.ptp(y["C"])
    assert np.quantile(np.abs(again["C"] - y["C"]), 0.8) < 1e-6  # the rest lies within a travel of a reversal


@pytest.mark.parametrize("travel", [1e-5, 1e-3, 1e-1])
def test_states_are_exact_at_constant_speed_and_bounded(model, travel):
    rig = model("Rigs.GearedJoint")
    question, time = rig.question("estimate"), np.linspace(0, 1, 101)
    p = {n: v.value for n, v in rig.parameters.items()} | {"gear.travel": travel}
    z = propagate(question, {"der(motor.phi)": np.full(101, -0.7)}, time, p)[0][0]
    np.testing.assert_allclose(z, np.expm1(-0.7 * time / travel), atol=1e-12)
    z = propagate(question, {"der(motor.phi)": 1e3 * np.sin(40 * time)}, time, p)[0][0]
    assert np.abs(z).max() <= 1 + 1e-12


def test_hip_and_knee_hang_still_at_a_coarse_step(model):
    rig, time = model("Rigs.HipKnee"), np.linspace(0, 20, 21)
    y = simulate(rig, {"tau1": 0.1, "tau2": 0.05}, time, step=1e-2)
    assert np.ptp(y["q_H"][10:]) < 1e-6 and np.ptp(y["q_K"][10:]) < 1e-6


def test_the_step_takes_inputs_that_hold_or_ramp(model):
    rig, time = model("Rigs.GearedJoint"), np.linspace(0, 1, 11)
    ramp = simulate(rig, {"tau": time}, time)
    stairs = simulate(rig, {"tau": np.repeat(time, 100)[:1000]}, np.linspace(0, 1, 1001)[:1000], hold=True)
    held_ = simulate(rig, {"tau": time}, time, hold=True)
    assert abs(held_["q"][-1] - stairs["q"][-1]) < 0.05 * abs(held_["q"][-1])
    assert ramp["q"][-1] > held_["q"][-1]


def test_the_step_generates_c(model):
    rig = model("Rigs.GearedJoint")
    step, d = step_function(rig, 1e-3), dynamics(rig)
    assert [step.size1_out(k) for k in range(2)] == [len(d.states), len(d.algebraic)]
    text = ca.CodeGenerator("step")
    text.add(step)
    assert "int step(" in text.dump()


@pytest.mark.parametrize(("arguments", "error", "text"), [
    ({"inputs": {"taw": 1.0}}, UnknownNameError, "no input 'taw' in DriveTrain.Rigs.GearedJoint; closest: 'tau'"),
    ({"start": {"z": 1.0}}, UnknownNameError, "no state 'z' in DriveTrain.Rigs.GearedJoint"),
    ({"parameters": {"gear.fo": 1.0}}, UnknownNameError, "no parameter 'gear.fo'.*closest: 'gear.f0'"),
    ({"time": np.array([0.0, 0.2, 0.1])}, DataError, "does not increase at sample 2"),
    ({"inputs": {"tau": np.zeros(5)}}, DataError, r"'tau' has shape \(5,\), time has 3 samples"),
    ({"inputs": {"tau": 1.0}, "parameters": {"load.m": 0.0, "load.J": 0.0, "motor.J": 0.0}},
     ModelicaError, "no solution near t = 0 s; check that every joint has inertia")])
def test_wrong_arguments_are_named(model, arguments, error, text):
    call = {"inputs": {}, "time": np.array([0.0, 0.1, 0.2])} | arguments
    with pytest.raises(error, match=text):
        simulate(model("Rigs.GearedJoint"), **call)


def test_a_missing_signal_is_named(model):
    with pytest.raises(DataError, match="to estimate, DriveTrain.Rigs.GearedJoint needs 'motor.tau'"):
        estimate(model("Rigs.GearedJoint"), {"motor.phi": np.zeros(3)}, np.arange(3.0))
    with pytest.raises(UnknownNameError, match="closest: 'motor.phi'"):
        estimate(model("Rigs.GearedJoint"), {"motor.phy": np.zeros(3)}, np.arange(3.0))

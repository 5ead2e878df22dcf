"""Standstill is part of the model: no creep under load, and the sliding law as the limit of short travels."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pycosim.compile import Library, compile_model
from pycosim.core.errors import DataError, ModelicaError, UnknownNameError
from pycosim.dynamics.simulate import compensate, dynamics, estimate, simulate, step_function
from pycosim.dynamics.states import propagate

JOINT = compile_model(Library(), "DriveTrain.Rigs.GearedJoint")


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
    assert np.ptp(y["motor.phi"][1:]) < 1e-6  # once it has come to rest on its displacement


@pytest.mark.parametrize("step", [1e-3, 1e-2])
def test_a_load_let_go_at_once_rings_and_comes_to_rest(model, step):
    rig, q, p = held(model)
    y = simulate(rig, {}, np.linspace(0, 60, 61), start={"q": q}, step=step)
    assert np.abs(y["motor.phi"] - y["motor.phi"][0]).max() < 2 * p["gear.travel"]
    assert np.ptp(y["motor.phi"][1:]) < 1e-6
    assert abs(y["motor.w"][-1]) < 1e-8


def test_a_load_above_breakaway_falls(model):
    rig, q, p = held(model)
    y = simulate(rig, {}, np.linspace(0, 2, 21), start={"q": 1.3 / 0.8 * q, "gear.z": -1})
    assert y["motor.phi"][-1] < y["motor.phi"][0] - 1000 * p["gear.travel"]


def breakaway(rig):
    """Motor torque at which a horizontal joint without gravity breaks away."""
    p = {n: v.value for n, v in rig.parameters.items()}
    c, floor = 2 * (1 - p["gear.mu"]) / (1 + p["gear.mu"]), 2 * p["gear.mu"] * p["gear.f0"] / (1 + p["gear.mu"])
    return floor / (1 - c / 2)  # tau_in = F, tau_out = 0, L = F / 2


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("rate", [pytest.param(0.02, marks=pytest.mark.long), 0.1])  # of breakaway, a second
@pytest.mark.parametrize("travel", [pytest.param(1e-4, marks=pytest.mark.long), 1e-3])
def test_a_slow_ramp_frees_it_in_the_step_that_passes_breakaway(model, way, rate, travel):
    """A ramp that ends half a step below breakaway leaves it held; one step later it never stops."""
    rig, h, end = model("Rigs.GearedJoint"), 1e-3, 40.0
    limit, time = breakaway(rig), np.arange(0, end, h)
    for last, free in ((1 - rate * h / 2, False), (1 + rate * h / 2, True)):
        torque = way * limit * np.minimum(0.97 + rate * time, last)
        y = simulate(rig, {"tau": torque}, time, {"load.g": 0.0, "gear.travel": travel}, {"gear.z": 0.97 * way}, step=h)
        w, s = way * y["motor.w"], np.abs(y["gear.s"][-1])
        if free:
            assert np.all(np.diff(w[-5000:]) > 0) and s == pytest.approx(1, abs=1e-12)
        else:
            assert np.abs(w[-5000:]).max() < 1e-11 and s == pytest.approx(last, abs=0.1 * rate * h)


@pytest.mark.parametrize(("share", "moves"), [(0.999, False), (1.001, True)])
def test_a_constant_torque_a_thousandth_beside_breakaway(model, share, moves):
    rig, time = model("Rigs.GearedJoint"), np.linspace(0, 60, 121)
    y = simulate(rig, {"tau": share * breakaway(rig)}, time, {"load.g": 0.0}, start={"gear.z": 0.99}, step=5e-3)
    late = np.ptp(y["motor.phi"][60:])
    assert late > 1 if moves else late < 1e-6


def test_vibration_below_breakaway_does_not_make_a_load_drift(model):
    rig, q, p = held(model)
    time = np.linspace(0, 10, 10001)
    y = simulate(rig, {"tau": 0.02 * p["gear.f0"] * np.sin(2 * np.pi * 20 * time)}, time,
                 start={"q": q, "gear.z": -0.8}, step=1e-3)
    middle = y["motor.phi"].reshape(-1)[:10000].reshape(200, 50).mean(axis=1)  # one mean a period
    assert np.ptp(y["motor.phi"][5000:]) > 1e-6  # it does vibrate
    assert np.ptp(middle[20:]) < 1e-8


@settings(max_examples=40, deadline=None)
@given(st.tuples(*[st.floats(-1, 1)] * 3), st.floats(0.5, 1), st.floats(0, 0.99), st.floats(5e-4, 5e-3),
       st.sampled_from([1e-4, 1e-3, 1e-2]), st.sampled_from([2e-3, 5e-4]))
def test_energy_never_grows_by_itself(start, mu, elastic, damping, travel, step):
    """No inputs: what is in motion, height and displacement falls, but for what a rising load stiffens (its docs)."""
    time, p = np.arange(0, 1, step), {n: v.value for n, v in JOINT.parameters.items()}
    p |= {"gear.mu": mu, "gear.elastic": elastic, "gear.damping": damping, "gear.travel": travel}
    y = simulate(JOINT, {}, time, p, dict(zip(("q", "load.w", "gear.z"), start)), step)
    inertia = p["load.m"] * p["load.l"] ** 2 + p["load.J"] + p["motor.J"] * p["reduction.ratio"] ** 2
    moving = inertia * y["w"] ** 2 / 2 + p["load.m"] * p["load.l"] * p["load.g"] * (1 - np.cos(y["q"]))
    square, stiffening = y["gear.z"] ** 2, np.diff(y["gear.F"])
    stored = y["gear.F"] * travel * square / 2
    fed = travel / 2 * np.maximum(square[1:], square[:-1]) * np.maximum(stiffening, 0)
    total = moving + stored
    solved = 1e-6 * travel * y["gear.F"].max() / 2 + 1e-14 * total[0]  # of what the displacement can hold; rounding
    assert np.all(np.diff(total) <= fed + solved)
    assert np.all(moving <= total[0] + solved)  # displacement gives back no more than it took


@settings(max_examples=300, deadline=None)
@given(st.floats(-1e3, 1e3), st.floats(-1, 1), st.floats(0, 0.99), st.floats(0, 1))
def test_friction_is_passive_at_every_speed(w, z, elastic, damping):
    """Power taken, less what goes into the displacement, is never negative; so over any cycle none is given back."""
    question = JOINT.question("estimate")
    p = {n: v.value for n, v in JOINT.parameters.items()} | {"gear.elastic": elastic, "gear.damping": damping}
    p = [p[n] for n in question.parameters]
    u = [w if n == "der(motor.phi)" else 0.3 for n in question.inputs]
    y = dict(zip(question.outputs, np.array(question.output(u, [z], p)).ravel()))
    stores = JOINT.parameters["gear.travel"].value * z * float(question.rate(u, [z], p))
    assert y["gear.F"] >= 0 and abs(y["gear.s"]) <= 1
    assert y["gear.s"] * y["gear.w"] - stores >= -1e-12 * abs(w)


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
    moved, elastic = 0.7 * time / travel, p["gear.elastic"]
    slid = 1 - (1 - elastic) * np.exp(-(moved - elastic) / (1 - elastic))
    np.testing.assert_allclose(-z, np.where(moved < elastic, moved, slid), atol=1e-12)
    z = propagate(question, {"der(motor.phi)": 1e3 * np.sin(40 * time)}, time, p)[0][0]
    assert np.abs(z).max() <= 1 + 1e-12


def test_states_and_their_sensitivities_are_those_of_the_rate(model):
    """Against small steps of the model's own rate, along a motion that sticks, slides and reverses."""
    rig, time = model("Rigs.GearedJoint", [("presliding", "gear")]), np.linspace(0, 1, 201)
    question, names = rig.question("estimate"), ["gear.travel", "gear.elastic", "presliding_gear.travel"]
    p = {n: v.value for n, v in rig.parameters.items()} | {"presliding_gear.travel": 4e-3}
    signals = {"der(motor.phi)": 4e-2 * np.sin(9 * time) * np.sin(40 * time)}
    states, slopes = propagate(question, signals, time, p, free=names)
    speed, x, fine = question.inputs.index("der(motor.phi)"), np.zeros(len(question.states)), 200
    rate, values = question.rate, [p[n] for n in question.parameters]
    for k, h in enumerate(np.diff(time)):
        u = np.zeros(len(question.inputs))
        u[speed] = signals["der(motor.phi)"][k:k + 2].mean()
        walk = ca.Function("walk", [x_ := ca.SX.sym("x", len(x))], [x_ + h / fine * rate(u, x_, values)]).fold(fine)
        x = np.array(walk(x)).ravel()
        np.testing.assert_allclose(states[:, k + 1], x, atol=2e-3)
    assert np.abs(states).max() > 0.95 and np.abs(np.diff(np.sign(states[0]))).sum() > 4
    for k, n in enumerate(names):
        step = 1e-6 * p[n]
        other = propagate(question, signals, time, p | {n: p[n] + step})[0]
        np.testing.assert_allclose(slopes[k], (other - states) / step, rtol=1e-3, atol=2e-3 * np.abs(slopes[k]).max())


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
    assert [step.size1_out(k) for k in range(3)] == [len(d.states), len(d.algebraic), 1]
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

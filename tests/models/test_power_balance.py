"""The connections give the paper's joint torques and lose exactly the power that friction takes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pycosim.compile import Library, compile_model

T_R = 15.125
SEGMENTS = ("s1A", "s2A", "s1B", "s2B")
HIP_KNEE = compile_model(Library(), "DriveTrain.Rigs.HipKnee")
JOINT = compile_model(HIP_KNEE.library, "DriveTrain.Rigs.GearedJoint")
FUNCTIONS = {}

torque = st.floats(-5, 5).filter(lambda v: abs(v) > 1e-6)
speed = st.floats(-10, 10).filter(lambda v: abs(v) > 1e-3)
loss = st.floats(0, 0.5)
efficiency = st.floats(0.5, 1)
friction = st.tuples(*[loss, efficiency] * 4)


def sliding(model, name, signals, parameters=None, form=0):
    """Outputs of a question for one sample of a sliding machine."""
    question = model.question(name, form)
    key = model.rig, name, form
    function = FUNCTIONS.setdefault(key, question.sliding())
    values = {n: v.value for n, v in model.parameters.items()} | (parameters or {})
    u = [signals.get(n, 0.0) for n in question.inputs]
    y = np.array(function(u, [values[n] for n in question.parameters])).ravel()
    return dict(zip(question.outputs, y))


def hip_knee(tau1, tau2, w1, w2, values):
    """Joint torques from motor torques, with the friction of the four segments."""
    parameters = {f"{s}.{n}": v for (s, n), v in zip([(s, n) for s in SEGMENTS for n in ("f0", "mu")], values)}
    signals = {"motor1.tau": tau1, "motor2.tau": tau2, "der(motor1.phi)": w1, "der(motor2.phi)": w2}
    return sliding(HIP_KNEE, "estimate", signals, parameters), parameters


def leaving(y, segment):
    """Torque that leaves a segment."""
    return y[f"{segment}.L"] - y[f"{segment}.s"] * y[f"{segment}.F"] / 2


@settings(max_examples=200, deadline=None)
@given(torque, torque, speed, speed, friction)
def test_joint_torques_come_out_of_the_connections(tau1, tau2, w1, w2, values):
    y, _ = hip_knee(tau1, tau2, w1, w2, values)
    assert y["C_H"] == pytest.approx(T_R * (leaving(y, "s1A") + leaving(y, "s2A")), abs=1e-9)
    assert y["C_K"] == pytest.approx(T_R * (leaving(y, "s1B") - leaving(y, "s2B")), abs=1e-9)


@settings(max_examples=200, deadline=None)
@given(torque, torque, speed, speed, friction)
def test_power_lost_is_friction_torque_times_speed(tau1, tau2, w1, w2, values):
    y, _ = hip_knee(tau1, tau2, w1, w2, values)
    lost = tau1 * w1 + tau2 * w2 - y["C_H"] * y["w_H"] - y["C_K"] * y["w_K"]
    assert lost == pytest.approx(sum(y[f"{s}.F"] * abs(y[f"{s}.w"]) for s in SEGMENTS), abs=1e-8)
    assert all(y[f"{s}.F"] >= 0 for s in SEGMENTS)
    assert sum(y[f"{s}.loss"] for s in SEGMENTS) == pytest.approx(lost, abs=1e-8)


@settings(max_examples=200, deadline=None)
@given(torque, torque, speed, speed, friction)
def test_compensate_inverts_estimate(tau1, tau2, w1, w2, values):
    y, parameters = hip_knee(tau1, tau2, w1, w2, values)
    signals = {"C_H": y["C_H"], "C_K": y["C_K"], "der(motor1.phi)": w1, "der(motor2.phi)": w2}
    back = sliding(HIP_KNEE, "compensate", signals, parameters)
    assert back["motor1.tau"] == pytest.approx(tau1, abs=1e-7)
    assert back["motor2.tau"] == pytest.approx(tau2, abs=1e-7)


@settings(max_examples=300, deadline=None)
@given(torque, speed, loss, efficiency)
def test_branches_of_one_segment(tau, w, f0, mu):
    """The table of the paper, as corrected: direct when the load drives along the motion, else reverse."""
    y = sliding(JOINT, "estimate", {"motor.tau": tau, "der(motor.phi)": w}, {"gear.f0": f0, "gear.mu": mu})
    out, load, s = y["C"] / JOINT.parameters["reduction.ratio"].value, y["gear.L"], np.sign(w)
    expected = mu * (tau - s * f0) if load * w > 0 else tau / mu - s * f0
    assert out == pytest.approx(expected, abs=1e-9)


@settings(max_examples=100, deadline=None)
@given(speed, loss, efficiency)
def test_law_is_continuous_where_the_branch_changes(w, f0, mu):
    edge = np.sign(w) * mu * f0 / (1 + mu)
    below, above = (sliding(JOINT, "estimate", {"motor.tau": edge + d, "der(motor.phi)": w},
                            {"gear.f0": f0, "gear.mu": mu}) for d in (-1e-9, 1e-9))
    assert below["gear.L"] <= 1e-12 and above["gear.L"] >= -1e-12
    assert below["C"] == pytest.approx(above["C"], abs=1e-6)


MANOEUVRES = {  # speeds of the motors; d for direct, r for reverse, of 1A 1B 2A 2B, at positive motor torques
    "A": (1, -1, "ddrr"), "B": (-1, 1, "rrdd"), "C": (2, 1, "dddr"),
    "D": (-2, -1, "rrrd"), "E": (1, 2, "drdd"), "F": (-1, -2, "rdrr")}


@pytest.mark.parametrize("name", MANOEUVRES)
def test_branches_of_the_six_manoeuvres(name):
    w1, w2, branches = MANOEUVRES[name]
    y, _ = hip_knee(1.0, 1.0, w1, w2, (0.05, 0.95) * 4)
    found = "".join("d" if y[f"{s}.L"] * y[f"{s}.w"] > 0 else "r" for s in ("s1A", "s1B", "s2A", "s2B"))
    assert found == branches

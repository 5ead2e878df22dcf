"""Effects obey their equations: channels, pairs, joints, lines, temperature, and what a user writes beside a study."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline
from scipy.signal import lfilter

from pycosim.compile import Library, catalogue, compile_model, find_effect, places
from pycosim.compile.solve import piecewise_linear
from pycosim.core.errors import ModelicaError
from pycosim.dynamics.simulate import estimate

RIG = "DriveTrain.Rigs.HipKnee"
LIBRARY = Library()
T, R, K, A = (ca.SX.sym(n) for n in "trka")
ROOT = piecewise_linear([R - A * T - K * T ** 3], [T])[0]
CUBIC = ca.Function("cubic", [R, K, A], [ROOT, ca.jacobian(ROOT, K)])


def sliding(attached, signals, parameters=None, question="estimate"):
    """Outputs of a question for one sample of the sliding hip-knee rig."""
    model = compile_model(LIBRARY, RIG, attached)
    asked = model.question(question)
    values = {n: v.value for n, v in model.parameters.items()} | (parameters or {})
    y = asked.sliding()([signals.get(n, 0.0) for n in asked.inputs], [values[n] for n in asked.parameters])
    return dict(zip(asked.outputs, np.array(y).ravel()))


MOVING = {"motor1.tau": 1.2, "motor2.tau": 0.7, "der(motor1.phi)": 1.0, "der(motor2.phi)": -0.4,
          "motor1.phi": 20.0, "motor2.phi": 3.0}


@settings(max_examples=500, deadline=None)
@given(st.floats(-15, 15), st.floats(-0.1, 1), st.floats(0.5, 2))
def test_a_cubic_channel_is_inverted_exactly_derivative_included(torque, k, gain):
    slope = gain + 3 * k * torque ** 2
    assume(slope > 0.05)
    found, rate = (float(v) for v in CUBIC(gain * torque + k * torque ** 3, k, gain))
    assert found == pytest.approx(torque, abs=1e-10)
    assert rate == pytest.approx(-torque ** 3 / slope, rel=1e-8, abs=1e-9)


def test_a_reading_beyond_the_fold_of_the_channel_stands_at_the_last_torque():
    assert float(CUBIC(20.0, -0.01, 1.0)[0]) == pytest.approx(np.sqrt(1 / 0.03))


@pytest.mark.parametrize("k", [0.05, -0.01])
def test_saturated_torques_read_as_the_truth_times_one_plus_k_squared(k):
    y = sliding([("torque_saturation", "motor1")], MOVING, {"torque_saturation_motor1.k": k})
    true = y["motor1.tau_shaft"]
    assert true * (1 + k * true ** 2) == pytest.approx(1.2, abs=1e-12)


@pytest.mark.parametrize("turning", [{"motor1.J": 2e-3}, {"rotor_inertia_motor1.J": 2e-3}])
def test_a_wrong_torque_constant_scales_what_turns_the_rotor_as_well(turning):
    """What is measured is the current, and all of its torque has the same constant."""
    effects = [("torque_constant", "motor1"), ("rotor_inertia", "motor1")]
    fast = {**MOVING, "der(der(motor1.phi))": 100.0}
    y = sliding(effects, fast, {**turning, "torque_constant_motor1.g": 1.2})
    true = sliding([], {**fast, "motor1.tau": MOVING["motor1.tau"] / 1.2 - 0.2})
    assert [y[c] for c in ("C_H", "C_K")] == pytest.approx([true[c] for c in ("C_H", "C_K")], rel=1e-12)


@pytest.mark.parametrize("place", ["1A+2A", "1B+2B"])
def test_cross_load_is_the_friction_of_the_partners_load_both_ways(place):
    name = f"cross_load_{place.replace('+', '_')}"
    bare = sliding([], MOVING)
    y = sliding([("cross_load", place)], MOVING, {f"{name}.k": 0.2})
    one, two = (f"s{p}" for p in place.split("+"))
    for own, other in ((one, two), (two, one)):
        own_law = (bare[f"{own}.F"] - 2 * 0.95 * 0.05 / 1.95) / abs(bare[f"{own}.L"])  # share of its own load
        expected = 2 * 0.95 * 0.05 / 1.95 + own_law * abs(y[f"{own}.L"]) + 0.2 * abs(y[f"{other}.L"])
        assert y[f"{own}.F"] == pytest.approx(expected, rel=1e-9)
    back = {**MOVING, "C_H": y["C_H"], "C_K": y["C_K"]}
    again = sliding([("cross_load", place)], back, {f"{name}.k": 0.2}, "compensate")
    assert again["motor1.tau"] == pytest.approx(1.2) and again["motor2.tau"] == pytest.approx(0.7)


def test_load_hysteresis_is_the_load_term_with_its_own_state():
    time = np.linspace(0, 6, 3001)
    angle = np.sin(time)
    signals = {"motor1.phi": angle, "motor2.phi": -0.4 * angle, "motor1.tau": 1.0, "motor2.tau": 0.5}
    given = {"load_hysteresis_1A.h": 0.3, "load_hysteresis_1A.mu_dif": 0.02}
    y = estimate(compile_model(LIBRARY, RIG, [("load_hysteresis", "1A")]), signals, time, given)
    z = np.zeros(len(time))
    for k in range(len(time) - 1):  # exact in the travel of a step, another scheme than the package's
        step = angle[k + 1] - angle[k]
        z[k + 1] = np.sign(step) + (z[k] - np.sign(step)) * np.exp(-abs(step) / 0.3)
    out = y["line1.tau"] - y["s1A.loss"] / np.where(np.abs(y["s1A.w"]) > 0, y["s1A.w"], np.nan)
    load = y["s1A.L"]
    lost = y["s1A.s"] * 2 * 0.95 * 0.05 / 1.95 + 0.1 / 1.95 * np.abs(load) * z + 0.02 * load * z ** 2
    moving = np.abs(y["s1A.w"]) > 0.05
    np.testing.assert_allclose((y["line1.tau"] - out)[moving], lost[moving], atol=2e-4)


def turning(time, rest=0.0):
    """Angles and torques of both motors, to and fro, with a rest at the end of each way."""
    period = 2 * np.pi + 2 * rest
    within = np.mod(time, period)
    back = np.minimum(within - rest, 2 * np.pi)
    phase = np.where(within < np.pi, within, np.where(within < np.pi + rest, np.pi, back))
    angle = -np.cos(phase)
    return {"motor1.phi": angle, "motor2.phi": -0.4 * angle, "motor1.tau": 1.0 + 0 * time, "motor2.tau": 0.5 + 0 * time}


@pytest.mark.parametrize("lag", [0.05, 0.3])
def test_friction_that_lags_acts_against_the_speed_of_a_moment_ago(lag):
    time = np.linspace(0, 13, 6501)
    signals, model = turning(time), compile_model(LIBRARY, RIG, [("friction_lag", "1A")])
    given = {"friction_lag_1A.T": lag, "friction_lag_1A.ws": 0.02, "s1A.travel": 1e-5}  # the rig's own is one too
    y = estimate(model, signals, time, given)
    speed = np.gradient(signals["motor1.phi"], time)
    late = lfilter([1 - np.exp(-0.002 / lag)], [1, -np.exp(-0.002 / lag)], speed)
    slides = np.abs(speed) > 0.02
    np.testing.assert_allclose(y["s1A.s"][slides], np.clip(late / 0.02, -1, 1)[slides], atol=0.06)
    behind = slides & (late * speed < 0)
    assert behind.sum() > 10 and np.all(y["s1A.s"][behind] * speed[behind] < 0)


def test_breakaway_grows_at_rest_and_is_lost_over_a_travel():
    time = np.linspace(0, 15, 7501)
    signals, given = turning(time, rest=1.0), {"dwell_1A.fd": 0.2, "dwell_1A.T": 0.8, "dwell_1A.h": 0.05}
    y = estimate(compile_model(LIBRARY, RIG, [("dwell", "1A")]), signals, time, given)
    bare = estimate(compile_model(LIBRARY, RIG), signals, time)
    rested, way = 0.0, np.abs(np.diff(signals["motor1.phi"], prepend=signals["motor1.phi"][0]))
    added = []
    for d in way:
        rested += 0.002 * max(0, 1 - 10 * d / 0.002 * 0.8 / 0.05) * (1 - rested) / 0.8 - d * rested / 0.05
        added.append(0.2 * rested)
    law = [F["s1A.F"] - 0.1 / 1.95 * np.abs(F["s1A.L"]) for F in (bare, y)]  # without the load term
    np.testing.assert_allclose(law[1] - law[0], added, atol=4e-3)
    assert np.max(law[1] - law[0]) == pytest.approx(0.2 * (1 - np.exp(-1 / 0.8)), rel=0.02)
    assert np.median(law[1] - law[0]) < 1e-3


def test_spring_and_payload_are_in_the_joint_torque_and_not_in_the_load():
    q = np.array([1.0, 1.0, 1.0, -1.0]).reshape(2, 2) @ np.array([20.0, 3.0]) / (2 * 15.125)
    bare = sliding([], MOVING)
    spring = sliding([("joint_spring", "hip")], MOVING, {"joint_spring_hip.k": 2.0, "joint_spring_hip.q0": 0.1})
    assert spring["C_H"] == pytest.approx(bare["C_H"])
    assert spring["C_H"] - spring["hip.computed"] == pytest.approx(2.0 * (q[0] - 0.1))
    payload = sliding([("payload", "shank")], MOVING, {"payload_shank.m": 1.5})
    knee = 1.5 * 9.80665 * 0.40 * np.sin(q.sum())
    assert payload["C_K"] - payload["knee.computed"] == pytest.approx(knee)
    assert payload["C_H"] - payload["hip.computed"] == pytest.approx(knee + 1.5 * 9.80665 * 0.42 * np.sin(q[0]))


def gravity(q_H, q_K, m1=4.0, m2=3.2, c2=0.15):
    """Torques of hip and knee that hold the leg, by hand."""
    knee = m2 * c2 * 9.80665 * np.sin(q_H + q_K)
    return np.array([(m1 * 0.20 + m2 * 0.42) * 9.80665 * np.sin(q_H) + knee, knee])


@pytest.mark.parametrize(("effect", "place", "given", "leg"), [
    ("reference_mass", "shank", {"m": 0.3}, {"m2": 3.5}),
    ("reference_mass", "thigh", {"m": -0.3}, {"m1": 3.7}),
    ("reference_centre", "shank", {"c": 0.02}, {"c2": 0.17})])
def test_a_computed_reference_is_that_of_another_leg_in_weight_and_in_motion(effect, place, given, leg):
    signals = {**MOVING, "der(der(motor1.phi))": 9.0, "der(der(motor2.phi))": -4.0}
    bare = sliding([], signals)
    right, wrong = (sliding([], signals, {f"leg.{n}": v for n, v in changed.items()}, "gravity_model")
                    for changed in ({}, leg))
    y = sliding([(effect, place)], signals, {f"{effect}_{place}.{n}": v for n, v in given.items()})
    errors = [y[f"{joint}.computed"] - bare[f"{joint}.computed"] for joint in ("hip", "knee")]
    assert errors == pytest.approx([wrong[c] - right[c] for c in ("C_H", "C_K")], abs=1e-12) and abs(errors[0]) > 0.05
    for name in ("C_H", "C_K", "hip.sensed", "knee.sensed"):
        assert y[name] == pytest.approx(bare[name], abs=1e-12)


@pytest.mark.parametrize(("effect", "place", "given", "wrong"), [
    ("reference_zero", "hip", {"q0": 0.2}, lambda q: gravity(q[0] + 0.2, q[1])),
    ("reference_zero", "knee", {"q0": -0.3}, lambda q: gravity(q[0], q[1] - 0.3))])
def test_a_computed_reference_has_the_zeros_of_its_angles_and_a_sensor_has_not(effect, place, given, wrong):
    q = np.array([23.0, 17.0]) / 30.25
    bare = sliding([], MOVING)
    y = sliding([(effect, place)], MOVING, {f"{effect}_{place}.{n}": v for n, v in given.items()})
    errors = [y[f"{joint}.computed"] - bare[f"{joint}.computed"] for joint in ("hip", "knee")]
    np.testing.assert_allclose(errors, wrong(q) - gravity(*q), atol=1e-12)
    for name in ("C_H", "C_K", "hip.sensed", "knee.sensed"):
        assert y[name] == pytest.approx(bare[name], abs=1e-12)


@pytest.mark.parametrize("reading", ["sensed", "computed"])
def test_gain_and_offset_of_a_reference_leave_the_true_torque_alone(reading):
    bare = sliding([], MOVING)
    y = sliding([("reference_gain", "hip"), ("reference_offset", "hip")], MOVING,
                {"reference_gain_hip.g": 1.1, "reference_offset_hip.o": 0.4})
    assert y[f"hip.{reading}"] == pytest.approx(1.1 * bare[f"hip.{reading}"] + 0.4)
    assert y["C_H"] == pytest.approx(bare["C_H"]) and y["knee.computed"] == pytest.approx(bare["knee.computed"])


@pytest.mark.parametrize(("effect", "given", "added"), [
    ("viscous_asymmetry", {"b_a": 0.02}, lambda w: 0.02 * w),
    ("viscous_asymmetry", {"b_a": -0.5}, lambda w: max(-0.5 * w, -2 * 0.95 * 0.05 / 1.95)),
    ("stribeck_asymmetry", {"fs_a": 0.03, "ws": 0.7},
     lambda w: 2 * 0.95 / 1.95 * 0.03 * np.sign(w) * np.exp(-(w / 0.7) ** 2)),
    ("sublinear_viscous", {"b": 0.03, "a": 0.4}, lambda w: 0.03 * abs(w) ** 0.4)])
@pytest.mark.parametrize("speed", [0.3, -0.8, 1.7])
def test_friction_over_the_speed_is_what_its_equation_says_and_never_gives_power(effect, given, added, speed):
    signals = {**MOVING, "der(motor1.phi)": speed}
    names = {f"{effect}_1A.{n}": v for n, v in given.items()}
    bare, y = sliding([], signals), sliding([(effect, "1A")], signals, names)
    law = [F["s1A.F"] - 0.1 / 1.95 * abs(F["s1A.L"]) for F in (bare, y)]  # without the load term
    assert law[1] - law[0] == pytest.approx(added(speed), abs=1e-12)
    assert y["s1A.loss"] >= 0


@pytest.mark.parametrize(("effect", "coefficient", "lost"), [
    ("cable_compliance", "e", lambda y, i: 0.01 * y[f"motor{i}.tau_shaft"]),
    ("backlash", "gap", lambda y, i: 0.005 * np.sign(y[f"s{i}A.L"]))])
def test_a_soft_or_loose_line_shows_at_the_joint_encoders(effect, coefficient, lost):
    for place, lines in (("line1", [1]), ("line2", [2]), ("line1+line2", [1, 2])):
        name = f"{effect}_{place.replace('+', '_')}.{coefficient}"
        y = sliding([(effect, place)], {**MOVING, "motor2.tau": -0.9}, {name: 0.01, "zero_K": 0.3})
        by = [lost(y, i) if i in lines else 0.0 for i in (1, 2)]
        assert y["encoder_H"] == pytest.approx((23.0 - by[0] - by[1]) / 30.25)
        assert y["encoder_K"] == pytest.approx((17.0 - by[0] + by[1]) / 30.25 + 0.3)


def test_a_temperature_is_an_input_only_where_an_effect_reads_one():
    model = compile_model(LIBRARY, RIG, [("temperature_dependence", "system")])
    assert "temperature" in model.question("estimate").inputs and 'temperature(unit="degC")' in model.text
    assert "temperature" not in compile_model(LIBRARY, RIG).flat.variables
    warm = sliding([("temperature_dependence", "1A")], {**MOVING, "temperature": 35.0},
                   {"temperature_dependence_1A.k": 0.02, "temperature_dependence_1A.mean": 25.0})
    hotter = 2 * 0.95 * 0.05 / 1.95 * 0.2
    assert warm["s1A.F"] - 0.1 / 1.95 * abs(warm["s1A.L"]) == pytest.approx(2 * 0.95 * 0.05 / 1.95 + hotter)


def test_a_pair_with_a_squared_load_says_that_it_has_no_closed_form():
    with pytest.raises(ModelicaError, match="no closed form"):
        compile_model(LIBRARY, RIG, [("cross_load", "1A+2A"), ("load_nonlinearity", "1A")]).question("estimate")


def test_places_of_pairs_channels_joints_and_lines():
    found = {e.id: [p.name for p in places(LIBRARY, RIG, e)] for e in catalogue(LIBRARY).values()}
    assert len(found) == 36
    assert found["cross_load"] == ["1A+2A", "1B+2B"] and found["time_delay"] == ["torque"]
    assert found["joint_spring"] == ["hip", "knee", "hip+knee"] and found["payload"] == ["shank"]
    assert found["angle_torque"] == ["hip", "knee", "hip+knee"] and found["angle_friction"][:2] == ["1A", "2A"]
    assert found["cable_compliance"] == found["backlash"] == ["line1", "line2", "line1+line2"]


FREE = {"angle_torque": ("hip", "q_H", 10), "motor_angle_torque": ("motor1", "motor1.phi", 10),
        "angle_friction": ("1A", "motor1.phi", 7)}  # place, angle, splines


@pytest.mark.parametrize("effect", FREE)
def test_a_free_function_of_an_angle_is_the_cubic_spline_through_uniform_knots(effect):
    place, over, n = FREE[effect]
    model = compile_model(LIBRARY, RIG, [(effect, place)])
    own = {f"c{k}": v for k, v in enumerate(np.random.default_rng(3).uniform(-0.04, 0.04, 10), 1)
           if f"c{k}" in find_effect(LIBRARY, effect).size}
    weights = np.array(list(own.values()))
    weights = np.insert(weights, 3, 0.0) if effect == "angle_friction" else weights  # the middle one is f0's
    time = np.linspace(0, 1, 101)
    phi = {"motor1.phi": 18 + 6 * time, "motor2.phi": 3 + 2 * time, "motor1.tau": 0 * time + 1.2,
           "motor2.tau": 0 * time + 0.7}
    bare = estimate(compile_model(LIBRARY, RIG), phi, time)
    angle = phi["motor1.phi"] if over in phi else bare[over]
    low, high = np.quantile(angle, [0.2, 0.8])
    base = f"{effect}_{place}"
    given = {**{f"{base}.{c}": v for c, v in own.items()}, f"{base}.low": low, f"{base}.high": high}
    y = estimate(model, phi, time, given)
    step = (high - low) / (n - 3)
    spline = BSpline(low + step * np.arange(-3, n + 1), weights, 3)(np.clip(angle, low, high))
    if effect == "angle_friction":
        change = y["s1A.F"] - 2 * 0.05 / 1.95 * abs(y["s1A.L"]) - 2 * 0.95 * 0.05 / 1.95
    else:
        change = y["hip.tau"] - y["hip.computed"] if effect == "angle_torque" else 1.2 - y["line1.tau"]
    np.testing.assert_allclose(change[1:], spline[1:], atol=1e-12)


def test_friction_of_an_angle_takes_no_more_than_there_is():
    down = {f"angle_friction_1A.c{k}": -1.0 for k in range(1, 7)}
    y = sliding([("angle_friction", "1A")], MOVING, {**down, "angle_friction_1A.low": 19, "angle_friction_1A.high": 30})
    assert y["s1A.F"] == pytest.approx(0.1 / 1.95 * abs(y["s1A.L"])) and y["s1A.loss"] > 0

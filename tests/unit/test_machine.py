"""The generator of hidden-effect logs keeps its promises: law, power balance, manoeuvres, noise and sizes."""

import ast
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))  # benchmarks/ is not an installed package

from benchmarks.hidden_effects import machine as rig  # noqa: E402
from benchmarks.hidden_effects.machine import PAPER, Effect, MachineError, Noise  # noqa: E402

SHORT = rig.six_manoeuvres((0.4, 1.6), repeats=1, longest_pass=2.0)
SILENT = Noise(white=0.0, slow=0.0, joint=0.0)


def samples(count=2000, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-2, 2, count), rng.choice([-1.0, 1.0], count), rng.uniform(0, 0.3, count)


def friction(load, F0, mu):
    return F0 + 2 * (1 - mu) / (1 + mu) * np.abs(load)


# --- the law ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mu", [0.5, 0.85, 0.97, 1.0])
def test_the_branch_table_obeys_the_law_in_all_four_quadrants(mu):
    tau_in, s, F0 = samples()
    tau_out = rig.table_out(tau_in, s, F0, mu)
    load = (tau_in + tau_out) / 2
    assert all(np.any((np.sign(load) == a) & (s == b)) for a in (-1, 1) for b in (-1, 1))
    np.testing.assert_allclose(tau_in - tau_out, s * friction(load, F0, mu), atol=1e-12)


def test_the_branch_table_inverts_itself():
    tau_in, s, F0 = samples()
    np.testing.assert_allclose(rig.table_in(rig.table_out(tau_in, s, F0, 0.9), s, F0, 0.9), tau_in, atol=1e-12)


@pytest.mark.parametrize("given", ["in", "out"])
def test_root_search_and_branch_table_agree_where_both_hold(given):
    known, s, F0 = samples()
    segment = rig.Segment(s, s, F0, mu=0.9)
    searched, tabulated = rig._searched_load(segment, known, given), rig.mean_load(segment, known, given)
    np.testing.assert_allclose(searched, tabulated, atol=1e-12)


def test_the_root_search_solves_the_law_where_the_table_does_not_hold():
    known, s, F0 = samples()
    z = s * np.random.default_rng(1).uniform(0, 1, len(s))
    for segment in (rig.Segment(z, z, F0, 0.9), rig.Segment(s, z, F0, 0.9, mu_dif=0.05, d=0.1)):
        load = rig.mean_load(segment, known, "in")
        np.testing.assert_allclose(load + segment.dissipated(load) / 2, known, atol=1e-12)


def test_no_answer_is_an_error_not_a_number():
    with pytest.raises(MachineError, match="balances"):
        rig.truth(PAPER, SHORT, [Effect("load_nonlinearity", "1A", d=20.0)])


def test_bristle_state_follows_its_differential_equation():
    motion = rig._Motion(SHORT)

    def rate(t, z):
        w = rig.segment_motion(SHORT.at(np.array([t]))[1], "1B")[0]
        return (w - np.abs(w) * z) / 0.2

    solution = solve_ivp(rate, (0, SHORT.time[-1]), [0.0], t_eval=SHORT.time, max_step=0.05, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(motion.bristle("1B", 0.2), solution.y[0], atol=1e-3)


# --- the machine ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("effects", [
    (), (Effect("presliding", "1A+2A", travel=0.2),), (Effect("cross_load", "1A+2A", k=0.1),),
    (Effect("load_hysteresis", "1B", h=0.3, mu_dif=0.005), Effect("load_nonlinearity", "2A", d=0.05)),
], ids=lambda effects: "+".join(effect.id for effect in effects) or "none")
def test_losses_are_friction_torque_times_speed(effects):
    inside = rig.truth(PAPER, SHORT, effects)
    joint_speed = inside.omega @ np.array([[1, 1], [1, -1]]) / (2 * rig.RATIO)
    power_in, power_out = np.sum(inside.tau * inside.omega, axis=1), np.sum(inside.C * joint_speed, axis=1)
    losses = sum(inside.dissipated[name] * inside.w[name] for name in rig.SEGMENTS)
    np.testing.assert_allclose(power_in - power_out, losses, atol=1e-10)
    if not effects:
        F = {name: friction(inside.load[name], 2 * mu / (1 + mu) * PAPER["f0"][name], mu)
             for name, mu in PAPER["mu"].items()}
        np.testing.assert_allclose(losses, sum(F[name] * np.abs(inside.w[name]) for name in F), atol=1e-10)


BRANCHES = dict(A="ddrr", B="rrdd", C="dddr", D="rrrd", E="drdd", F="rdrr")  # 1A 1B 2A 2B, as paper.md


@pytest.mark.parametrize("manoeuvre", BRANCHES)
def test_manoeuvres_take_the_branches_of_the_paper(manoeuvre):
    inside = rig.truth(PAPER, SHORT)
    here = (SHORT.manoeuvre == manoeuvre) & SHORT.moving
    assert here.sum() > 100
    ends = {"1A": (inside.tau, inside.tau_H), "1B": (inside.tau_H, inside.tau_K)}
    for name, branch in zip(("1A", "1B", "2A", "2B"), BRANCHES[manoeuvre]):
        tau_in, tau_out = (torque[here, int(name[0]) - 1] for torque in ends["1" + name[1]])
        f0, mu = PAPER["f0"][name], PAPER["mu"][name]
        expected = mu * (tau_in - f0) if branch == "d" else tau_in / mu + f0
        assert np.all(tau_in > 0)
        np.testing.assert_allclose(tau_out, expected, atol=1e-10)


def test_joint_torques_are_the_sums_of_the_paper():
    inside = rig.truth(PAPER, SHORT)
    np.testing.assert_allclose(inside.C[:, 0], rig.RATIO * inside.tau_H.sum(axis=1), atol=1e-10)
    np.testing.assert_allclose(inside.C[:, 1], rig.RATIO * (inside.tau_K[:, 0] - inside.tau_K[:, 1]), atol=1e-10)


def test_base_model_finds_the_parameters_of_a_silent_machine():
    pick = np.flatnonzero(SHORT.moving)
    log = rig._log(PAPER, rig._Motion(SHORT, pick), (), SILENT, 0)
    expected = [*PAPER["f0"].values(), *PAPER["mu"].values()]
    np.testing.assert_allclose(rig.fit_base(log.tau, log.omega, log.C), expected, atol=1e-4)


# --- motion -----------------------------------------------------------------------------------------------------------


def test_speed_and_acceleration_are_derivatives_of_the_angle():
    time = np.arange(0, SHORT.time[-1], 1e-3)
    theta, omega, alpha = SHORT.at(time)
    np.testing.assert_allclose(np.gradient(theta, time, axis=0), omega, atol=2e-2)
    np.testing.assert_allclose(np.cumsum(alpha, axis=0) * 1e-3, omega, atol=2e-2)
    assert np.abs(alpha).max() <= 8.0 + 1e-9


def test_out_and_back_run_over_the_same_line_and_no_segment_stands_still():
    motion = rig.six_manoeuvres((0.4, 1.6), start=((0.9, -0.85), (1.0, -0.9)), lines=(3.0, 2.0), repeats=1,
                                rng=np.random.default_rng(3))
    theta, omega, _ = motion.at(motion.time)
    passes = motion.manoeuvre != "rest"
    ratios = {name: rig.segment_motion(omega, name)[passes & motion.moving] for name in rig.SEGMENTS}
    assert all(np.abs(w).min() > rig.MOVING_SPEED for w in ratios.values())
    ends = {piece.label: piece for piece in motion.stretches}
    for out, back in ("AB", "CD", "EF"):
        np.testing.assert_allclose(np.array(ends[out].direction), -np.array(ends[back].direction))
        assert ends[out].duration == ends[back].duration


def test_default_motion_is_as_long_as_the_experiments_expect():
    motion = rig.default_trajectory(np.random.default_rng(0))
    assert 400 < motion.time[-1] < 460
    order = [piece.speed for piece in motion.stretches if piece.label == "A"]
    assert sorted(order) != order and sorted(order) == sorted([0.2, 0.4, 0.8, 1.6, 2.4] * 2)


# --- measuring --------------------------------------------------------------------------------------------------------


def test_slow_noise_has_its_deviation_and_its_memory():
    time = np.arange(200_000) / 100
    noise = rig.slow_noise(time, 2.4e-3, 1.0, np.random.default_rng(0))
    assert np.std(noise) == pytest.approx(2.4e-3, rel=0.05)
    assert np.corrcoef(noise[:-100], noise[100:])[0, 1] == pytest.approx(np.exp(-1), abs=0.05)


def test_the_same_seed_gives_the_same_noise_whatever_the_effect():
    effects = [Effect("intermittent_drag", "1A", A=0.1, on=1, off=2, seed=4),
               Effect("temperature_dependence", "2B", k=0.1)]
    tau = ["tau1", "tau2"]
    differences = [rig.measure(PAPER, SHORT, hidden, rng=7)[tau]
                   - rig.measure(PAPER, SHORT, hidden, noise=SILENT, rng=7)[tau] for hidden in ([], effects)]
    np.testing.assert_allclose(*differences, atol=1e-12)
    assert differences[0].std().to_numpy() == pytest.approx(np.hypot(6e-3, 2.4e-3), rel=0.15)


def test_the_log_has_the_columns_of_the_contract_and_survives_csv(tmp_path):
    frame = rig.measure(PAPER, SHORT, rng=1, extra=("q", "omega", "temperature"))
    assert list(frame) == ["time", "theta1", "theta2", "omega1", "omega2", "tau1", "tau2", "q_H", "q_K", "C_H", "C_K",
                           "temperature", "manoeuvre"]
    turns = frame.theta1 / (2 * np.pi / 2**14)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-6)
    rig.write_csv(frame, tmp_path / "run.csv")
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "run.csv"), frame, rtol=1e-8)
    assert "C_H" not in rig.measure(PAPER, SHORT, reference=None)


def test_the_reference_can_be_the_leg_as_designed_or_a_sensor():
    payload = [Effect("payload", "shank", m=1.0)]
    designed, sensed, bare = (
        rig.measure(PAPER, SHORT, hidden, noise=SILENT, reference=reference).C_K.to_numpy()
        for hidden, reference in [(payload, "gravity_model"), (payload, "sensor"), ((), "sensor")])
    np.testing.assert_array_equal(designed, bare)
    np.testing.assert_allclose(sensed, bare * (1 + 0.4 / (3.2 * 0.15)))


@pytest.mark.parametrize("effect, equation", [
    (Effect("torque_constant", "motor1", g=1.1), lambda tau, phi, a: 1.1 * tau),
    (Effect("torque_offset", "motor1", o=0.02), lambda tau, phi, a: tau + 0.02),
    (Effect("torque_saturation", "motor1", k=0.1), lambda tau, phi, a: tau * (1 + 0.1 * tau**2)),
    (Effect("torque_ripple", "motor1", A=0.01, n=3.7, phase=1), lambda tau, phi, a: tau + 0.01 * np.sin(3.7 * phi + 1)),
    (Effect("rotor_inertia", "motor1", J=0.002), lambda tau, phi, a: tau + 0.002 * a),
], ids=lambda value: getattr(value, "id", ""))
def test_drive_effects_are_the_equations_of_the_contract(effect, equation):
    theta, _, alpha = SHORT.at(SHORT.time)
    plain, changed = (rig.measure(PAPER, SHORT, hidden, noise=SILENT) for hidden in ((), [effect]))
    np.testing.assert_allclose(changed.tau1, equation(plain.tau1, theta[:, 0], alpha[:, 0]), atol=1e-12)
    np.testing.assert_array_equal(changed.tau2, plain.tau2)


def test_a_delay_of_whole_samples_shifts_the_torques_and_nothing_else():
    delay = Effect("time_delay", "torque", d=0.03)
    plain, late = (rig.measure(PAPER, SHORT, hidden, noise=SILENT) for hidden in ((), [delay]))
    moving = np.flatnonzero(SHORT.moving[3:] & SHORT.moving[:-3])
    np.testing.assert_allclose(late.tau1.to_numpy()[moving + 3], plain.tau1.to_numpy()[moving], atol=1e-10)
    np.testing.assert_array_equal(late[["theta1", "C_H"]], plain[["theta1", "C_H"]])


def test_soft_cables_bring_joint_encoders_and_their_equation():
    frame = rig.measure(PAPER, SHORT, [Effect("cable_compliance", "line1", e=0.05)], noise=SILENT, counts=2**22)
    np.testing.assert_allclose(rig.RATIO * (frame.q_H + frame.q_K), frame.theta1 - 0.05 * frame.tau1, atol=1e-5)
    np.testing.assert_allclose(rig.RATIO * (frame.q_H - frame.q_K), frame.theta2, atol=1e-5)


@pytest.mark.parametrize("effect_id", rig.KINDS)
def test_every_effect_can_be_drawn_and_changes_the_log(effect_id):
    place = rig.KINDS[effect_id].places[-1]
    machine = rig.without_load_dependence(PAPER) if effect_id == "load_dependence" else PAPER
    motion = SHORT
    if effect_id == "backlash":
        motion = rig.six_manoeuvres(repeats=1, longest_pass=6.0, start=(rig.CROSSING_START,))
    if effect_id == "intermittent_drag":
        motion = rig.six_manoeuvres(repeats=4)  # long enough for it to come and go
    effect = rig.draw(effect_id, place, np.random.default_rng(4))
    effect = effect.scaled(10 * effect.amplitude)
    plain, changed = (rig.measure(machine, motion, hidden, rng=2, extra=["q"]) for hidden in ((), [effect]))
    columns = ["tau1", "tau2", "q_H", "q_K"]
    assert np.isfinite(changed[columns]).all(axis=None)
    assert not np.allclose(changed[columns], plain[columns], rtol=0, atol=1e-6)


# --- sizes ------------------------------------------------------------------------------------------------------------


def test_calibrated_viscous_friction_has_the_wanted_size():
    effect = rig.calibrate(rig.draw("viscous", "1A", np.random.default_rng(0)), 1.7, PAPER, SHORT, seed=3)
    assert 0.005 < effect["b"] < 0.1
    assert rig.size_of(effect, PAPER, SHORT, seed=3) == pytest.approx(1.7, rel=0.01)


def test_load_dependence_is_measured_against_a_base_without_it():
    bare = rig.without_load_dependence(PAPER)
    effect = rig.calibrate(rig.draw("load_dependence", "1A", np.random.default_rng(0)), 1.7, bare, SHORT)
    assert 0.5 < effect["mu"] < 1
    assert rig.size_of(effect, bare, SHORT, base_mu_fixed=()) < 1.05
    with pytest.raises(MachineError, match="without_load_dependence"):
        rig.size_of(effect, PAPER, SHORT)


def test_a_size_out_of_reach_says_how_far_it_goes():
    with pytest.raises(rig.UnreachableSizeError, match="cannot be reached") as caught:
        rig.calibrate(rig.draw("backlash", "line1", np.random.default_rng(0)), 1.7, PAPER, SHORT)
    assert caught.value.largest == pytest.approx(1.0, abs=0.01)


# --- refusals and independence ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("make, closest", [
    (lambda: Effect("stribek", "1A", fs=1, ws=1), "'stribeck'"),
    (lambda: Effect("torque_offset", "motr1", o=0.1), "'motor1'"),
    (lambda: Effect("viscous", "1A", c=0.1), "viscous needs b"),
    (lambda: rig.measure(PAPER, SHORT, extra=["omgea"]), "'omega'"),
])
def test_unknown_names_are_refused_with_the_nearest(make, closest):
    with pytest.raises(MachineError, match=closest):
        make()


def test_the_generator_shares_nothing_with_the_package_it_judges():
    tree = ast.parse(Path(rig.__file__).read_text())
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert not {name.split(".")[0] for name in names} & {"pycosim", "casadi", "pymoca", "fmpy"}

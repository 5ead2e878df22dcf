"""A record moved in time is the signal at the time it tells of, and its noise stays what it was."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import cumulative_trapezoid

from benchmarks.real_logs import closed_loop
from benchmarks.real_logs.make import GEARED, make
from pycosim.compile import Library, compile_model
from pycosim.data.dataset import Dataset
from pycosim.data.torques import held_back
from pycosim.diagnosis.trials import BETWEEN, no_effect
from pycosim.dynamics.delays import Clock, Record, undo
from pycosim.dynamics.filters import first_order
from pycosim.dynamics.simulate import estimate
from pycosim.fit import least_squares
from pycosim.fit.late import Profile
from pycosim.study.parse import load_study

TIME = np.arange(0, 4, 0.01)
ONE = np.zeros(len(TIME))
PENDULUM = Path(__file__).parents[2] / "examples" / "double_pendulum" / "DoublePendulum.mo"
RIG = "DriveTrain.Rigs.GearedJoint"


@pytest.mark.parametrize("later", [-0.0137, 0.004, 0.05])
def test_a_smooth_signal_is_moved_by_any_part_of_a_sample(later):
    record = Record(Clock(TIME, ONE), np.sin(3 * TIME))
    moved, slope = record.at(later)
    inside = slice(20, -20)
    np.testing.assert_allclose(moved[inside], np.sin(3 * (TIME + later))[inside], atol=1e-7)
    np.testing.assert_allclose(slope[inside], 3 * np.cos(3 * (TIME + later))[inside], atol=1e-4)


def test_one_log_does_not_reach_into_the_next():
    run = np.repeat([0.0, 1.0], len(TIME) // 2)
    moved = Record(Clock(np.tile(TIME[:200], 2), run), run).at(0.05)[0]
    np.testing.assert_allclose(moved, run, atol=1e-12)


@pytest.mark.parametrize("d", [0.02, 0.023, 0.0262, 0.0279])
def test_a_noisy_record_is_moved_along_its_slope_and_keeps_its_noise(d):
    late = compile_model(Library(), RIG, [("time_delay", "torque")])
    noise = np.random.default_rng(0).standard_normal(len(TIME))
    signals = {"motor.tau": np.sin(2 * (TIME - 0.023)) + noise}
    moved = undo(late.question("estimate"), signals, TIME, ONE,
                 {**{n: v.value for n, v in late.parameters.items()}, "time_delay_torque.d": d},
                 {"motor.tau": (2 * np.cos(2 * (TIME - 0.023)), ONE)})
    left = (moved["motor.tau"] - np.sin(2 * (TIME + d - 0.023)))[5:-5]
    shift = round(d / 0.01)
    np.testing.assert_allclose(left, noise[5 + shift:len(TIME) - 5 + shift], atol=1e-4)


def test_a_model_with_a_delay_takes_the_torques_of_the_delayed_time():
    library = Library()
    late, bare = compile_model(library, RIG, [("time_delay", "torque")]), compile_model(library, RIG)
    motion = {"motor.phi": TIME, "der(motor.phi)": 1.0, "der(der(motor.phi))": 0.0}
    d = 0.023
    a = estimate(late, {**motion, "motor.tau": np.sin(2 * (TIME - d))}, TIME, {"time_delay_torque.d": d})
    b = estimate(bare, {**motion, "motor.tau": np.sin(2 * TIME)}, TIME)
    np.testing.assert_allclose(a["C"][20:-20], b["C"][20:-20], atol=1e-5)


@pytest.mark.parametrize("T", [0.01, 0.05])
def test_what_a_filter_of_first_order_has_held_back_is_given_back(T):
    library = Library()
    held, bare = compile_model(library, RIG, [("low_pass", "torque")]), compile_model(library, RIG)
    motion = {"motor.phi": TIME, "der(motor.phi)": 1.0, "der(der(motor.phi))": 0.0}
    filtered = (np.sin(2 * TIME) - 2 * T * np.cos(2 * TIME)) / (1 + (2 * T) ** 2)  # settled
    a = estimate(held, {**motion, "motor.tau": filtered}, TIME, {"low_pass_torque.T": T})
    b, late = (estimate(bare, {**motion, "motor.tau": tau}, TIME)["C"] for tau in (np.sin(2 * TIME), filtered))
    np.testing.assert_allclose(a["C"][20:-20], b[20:-20], atol=1e-5)
    assert np.abs(late - b)[20:-20].max() > 0.3 * T * 50  # a gear of 50


@pytest.mark.parametrize("falling", [0.0, 0.03])
def test_a_torque_that_a_filter_held_back_is_given_back_without_its_noise_growing(lagging_study, falling):
    """A friction that falls with speed changes most near a turn, as no polynomial of the angle does."""
    log = pd.read_csv(lagging_study.parent / "log.csv")
    speed = np.gradient(log["phi"].to_numpy(), log["time"].to_numpy()) / 50
    true = log["tau"].to_numpy() + falling * np.sign(speed) * np.exp(-np.abs(speed) / 0.4)
    noise = 0.002 * np.random.default_rng(0).standard_normal(len(log))
    time = log["time"].to_numpy()
    log["tau"] = first_order(true[None], 0.08, time, np.zeros(len(log)))[0][0] + noise
    log.to_csv(lagging_study.parent / "log.csv", index=False)
    data = Dataset(load_study(lagging_study), Library())
    model = compile_model(data.library, data.study.rig, [("low_pass", "torque")])
    values = {**{n: v.value for n, v in data.parameters.variables(model).items()}, "low_pass_torque.T": 0.08}
    given = data.undelayed(data.ask(model), values)["motor.tau"][data.moving]
    off = given - (true + noise)[data.moving]
    bare = (log["tau"] - true - noise)[data.moving]
    assert np.sqrt(np.mean(off ** 2)) < 0.25 * np.sqrt(np.mean(bare ** 2))


@pytest.mark.parametrize("effect", ["time_delay", "low_pass"])
def test_a_study_whose_own_effects_delay_a_torque_is_read(lagging_study, effect):
    lagging_study.write_text(f'{lagging_study.read_text()}\n[[effects]]\neffect = "{effect}"\nplace = "torque"\n')
    data = Dataset(load_study(lagging_study), Library())
    assert (effect, "torque") in data.base.keys and data.moving.any()
    assert np.isfinite(list(least_squares.fit(data, data.base).error.values())).all()


def test_a_delay_that_the_study_fixes_is_held_and_no_more(lagging_study):
    data = Dataset(load_study(lagging_study), Library())
    model, name = compile_model(data.library, data.study.rig, [("time_delay", "torque")]), "time_delay_torque.d"
    free = [n for n in data.parameters.free(model) if n != name]
    fit = least_squares.fit(data, model, {name: 0.03}, free, held=[name])
    assert fit.parameters[name] == 0.03 and name not in fit.free and not fit.profiles


def test_a_filter_is_undone_in_every_run_alike(lagging_study):
    text = lagging_study.read_text()
    one = Dataset(load_study(lagging_study), Library())
    lagging_study.write_text(text.replace('runs = ["log.csv"]', 'runs = ["log.csv", "again.csv"]'))
    log = pd.read_csv(lagging_study.parent / "log.csv")
    log.assign(tau=1.3 * log["tau"]).to_csv(lagging_study.parent / "again.csv", index=False)
    two = Dataset(load_study(lagging_study), Library())
    alone, both = (held_back(data, "motor.tau", 0.08)[0] for data in (one, two))
    for part, gain in zip(np.split(both, 2), (1.0, 1.3), strict=True):
        off = (part - gain * alone)[one.moving]
        assert np.sqrt(np.mean(off ** 2)) < 0.05 * np.abs(alone).max()


def test_the_error_over_a_short_delay_has_one_valley_for_all_the_noise_of_the_record(lagging_study):
    log = pd.read_csv(lagging_study.parent / "log.csv")
    log["tau"] += 0.004 * np.random.default_rng(0).standard_normal(len(log))
    log.to_csv(lagging_study.parent / "log.csv", index=False)
    data = Dataset(load_study(lagging_study), Library())
    model = compile_model(data.library, data.study.rig, [("time_delay", "torque")])
    values = {n: v.value for n, v in data.parameters.variables(model).items()}
    slopes = []
    for d in 0.002 * np.arange(1, 12):
        pair = [data.residuals(model, [], {**values, "time_delay_torque.d": x}).residual([]) for x in (d, d + 0.002)]
        slopes.append(np.diff([np.mean(r ** 2) for r in pair])[0])
    assert np.count_nonzero(np.diff(np.sign(slopes))) <= 1


def test_the_slope_of_a_residual_by_a_lag_of_the_torque_is_its_difference(lagging_study):
    data = Dataset(load_study(lagging_study), Library())
    model = compile_model(data.library, data.study.rig, [("time_delay", "torque"), ("low_pass", "torque")])
    values = {**{n: v.value for n, v in data.parameters.variables(model).items()}, "low_pass_torque.T": 0.05,
              "time_delay_torque.d": 0.0}
    free = ["low_pass_torque.T"]
    problem = data.residuals(model, free, values)
    slope = np.concatenate([j for _, _, j in problem.blocks(np.array([0.05]))], axis=2)[:, 0]
    apart = (problem.residual(np.array([0.05 - 1e-5])) - problem.residual(np.array([0.05 + 1e-5]))) / 2e-5
    np.testing.assert_allclose(slope, apart, atol=2e-4 * np.abs(apart).max())


@pytest.mark.parametrize("lag", [0.0, 0.004, 0.05, 3.0])
def test_the_slope_of_a_filter_is_that_of_its_time_constant(lag):
    time, run = np.tile(TIME[:200] ** 1.2, 2), np.repeat([0.0, 1.0], 200)
    signal = np.array([np.sin(3 * time) + 0.2 * run, np.sign(np.sin(5 * time))])
    whole, slope = first_order(signal, lag, time, run)
    near = 1e-6 * max(lag, 1e-3)
    more = first_order(signal, lag + near, time, run)[0]
    if lag:
        np.testing.assert_allclose((more - whole) / near, slope, atol=2e-5 * np.abs(slope).max())
    else:  # no filter gives back what it is given
        np.testing.assert_allclose(whole, signal, atol=1e-6)


def test_a_filter_of_first_order_settles_on_the_known_answer_and_each_log_starts_caught_up():
    found = first_order(np.sin(2 * TIME)[None], 0.05, TIME, ONE)[0][0]
    settled = (np.sin(2 * TIME) - 0.1 * np.cos(2 * TIME)) / 1.01
    np.testing.assert_allclose(found[60:], settled[60:], atol=1e-4)
    levels, run = np.repeat([1.0, 5.0], len(TIME)), np.repeat([0.0, 1.0], len(TIME))
    np.testing.assert_allclose(first_order(levels[None], 0.05, np.tile(TIME, 2), run)[0][0], levels)


def test_a_reference_that_a_filter_held_back_is_compared_with_a_model_held_back_alike(lagging_study):
    data = Dataset(load_study(lagging_study), Library())
    model = compile_model(data.library, data.study.rig, [("reference_lag", "joint")])
    values = {**{n: v.value for n, v in data.parameters.variables(model).items()}, "reference_lag_joint.T": 0.08}
    free = [*data.parameters.free(data.base), "reference_lag_joint.T"]
    problem = data.residuals(model, free, values)
    x = np.array([values[n] for n in free])
    slope = np.concatenate([j for _, _, j in problem.blocks(x)], axis=2)
    for k in range(len(free)):
        step = 1e-6 * np.maximum(np.abs(x[k]), 1e-2) * (np.arange(len(x)) == k)
        apart = (problem.residual(x - step) - problem.residual(x + step)) / (2 * step[k])
        np.testing.assert_allclose(slope[:, k], apart, atol=2e-4 * np.abs(apart).max())
    np.testing.assert_allclose(problem.residual(x, np.arange(40, 60)), problem.residual(x)[:, 40:60])
    bare = data.residuals(data.base, free[:-1], values).residual(x[:-1])
    assert np.sqrt(np.mean(problem.residual(x) ** 2)) < 0.3 * np.sqrt(np.mean(bare ** 2))


@pytest.fixture
def lagging_study(tmp_path):
    """A geared joint whose reference a filter of 0.08 s has held back."""
    time = np.arange(0, 30, 0.01)
    angle = 1.2 * np.sin(1.3 * time) + 0.4 * np.sin(2.9 * time)
    speed = 1.56 * np.cos(1.3 * time) + 1.16 * np.cos(2.9 * time)
    library = Library()
    model = compile_model(library, RIG)
    tau = 0.05 * np.sin(angle) + 0.004 * np.sign(speed)
    motion = {"motor.phi": 50 * angle, "motor.tau": tau}
    torque = estimate(model, motion, time, {"gear.f0": 0.005})["C"]
    held = first_order(torque[None], 0.08, time, np.zeros(len(time)))[0][0]
    rows = np.column_stack([time, 50 * angle, tau, held])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="time,phi,tau,C", comments="")
    (tmp_path / "study.toml").write_text(f"""
[rig]
model = "{RIG}"
[data]
runs = ["log.csv"]
reference = "sensor"
[columns]
phi = {{ variable = "motor.phi", unit = "rad" }}
tau = {{ variable = "motor.tau", unit = "N.m" }}
C = {{ variable = "C", unit = "N.m" }}
[parameters]
"gear.f0" = {{ value = 0.005, fixed = false }}
""")
    return tmp_path / "study.toml"


@pytest.mark.parametrize("effect, values", [
    pytest.param(effect, values, marks=pytest.mark.long) for effect, values in (
        ("time_delay", (-2e-3, -1e-3, 1e-3, 2e-3)), ("low_pass", (5e-4, 1e-3, 2e-3)))])
def test_less_than_a_sample_of_delay_takes_no_noise_of_accelerations_away(effect, values, tmp_path):
    """What the motion predicts of a torque holds their noise; between samples, and filtered, there would be less."""
    data = Dataset(load_study(closed_loop.make("geared", "passes", "none", 1, tmp_path)), Library())
    model = compile_model(data.library, data.study.rig, [("presliding", "gear"), (effect, "torque")])
    name = {"time_delay": "time_delay_torque.d", "low_pass": "low_pass_torque.T"}[effect]
    free = [n for n in data.parameters.free(model) if n != name]
    fit = least_squares.fit(data, model, {name: 0.0}, free, held=[name])

    def left(value):
        return np.sum(data.residuals(model, free, {**fit.parameters, name: value}, "fit").residual(fit.values) ** 2)

    assert min(left(v) for v in values) > 0.98 * left(0.0)


@pytest.mark.long
@pytest.mark.parametrize("effect", ["friction_lag", "dwell"])
def test_a_memory_beside_a_delay_is_judged_without_a_torque_reference_too(effect, tmp_path):
    dataset = Dataset(load_study(make("unpaired:viscous:1.7:8900", tmp_path, quick=True)), Library())
    model = compile_model(dataset.library, dataset.study.rig, [("time_delay", "torque"), (effect, "1A")])
    fit = least_squares.fit(dataset, model)
    assert dataset.paired and no_effect(dataset, model, fit) in (None, BETWEEN)


@pytest.mark.parametrize("swing, refused", [(0.0, BETWEEN), (3.0, None)])
def test_a_delay_of_less_than_a_sample_that_acts_at_turns_is_what_happens_between_two(swing, refused, tmp_path):
    """Passes at even speed under no load, where it acts at turns alone, and under one that swings all along, late."""
    time = np.arange(0, 48, 0.02)
    way = np.interp(time % 4, [0, 0.3, 0.34, 1.66, 1.7, 2.3, 2.34, 3.66, 3.7, 4], [0, 0, 1, 1, 0, 0, -1, -1, 0, 0])
    load, late = (swing * np.sin(2 * np.pi * (time - d) / 0.9) for d in (0.0, 0.014))
    log = pd.DataFrame({"time": time, "theta": cumulative_trapezoid(2 * way, time, initial=0), "omega": 2 * way,
                        "C": 50 * load, "tau": late + 0.3 * np.sign(way)})
    log[["C", "tau"]] += np.random.default_rng(0).standard_normal((len(time), 2)) * (0.15, 0.005)
    log.to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "study.toml").write_text(GEARED.replace("runs = []", 'runs = ["log.csv"]'))
    dataset = Dataset(load_study(tmp_path / "study.toml"), Library())
    model = compile_model(dataset.library, dataset.study.rig, [("time_delay", "torque")])
    fit = least_squares.fit(dataset, model, {"time_delay_torque.d": 0.014}, held=["time_delay_torque.d"])
    assert no_effect(dataset, model, fit) == refused


@pytest.mark.parametrize("delay, refused", [(0.002, BETWEEN), (-0.004, BETWEEN), (0.007, None)])
def test_a_delay_of_less_than_a_quarter_of_a_sample_is_when_a_logger_reads(delay, refused, tmp_path):
    """Under a load that swings all along, at 50 samples a second: it is seen, and is no machine's."""
    time = np.arange(0, 48, 0.02)
    load, late = (3.0 * np.sin(2 * np.pi * (time - d) / 0.9) for d in (0.0, delay))
    way = 2 + 0.2 * np.sin(time)
    log = pd.DataFrame({"time": time, "theta": cumulative_trapezoid(way, time, initial=0), "omega": way,
                        "C": 50 * load, "tau": late + 0.3})
    log[["C", "tau"]] += np.random.default_rng(0).standard_normal((len(time), 2)) * (0.05, 0.002)
    log.to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "study.toml").write_text(GEARED.replace("runs = []", 'runs = ["log.csv"]'))
    dataset = Dataset(load_study(tmp_path / "study.toml"), Library())
    model = compile_model(dataset.library, dataset.study.rig, [("time_delay", "torque")])
    fit = least_squares.fit(dataset, model, {"time_delay_torque.d": delay}, held=["time_delay_torque.d"])
    assert no_effect(dataset, model, fit) == refused


@pytest.fixture(params=["delay", "travel"])
def turning(request, tmp_path):
    """A swing under a load of its own: with a torque 5.2 ms late, or friction that turns over in 6 ms."""
    late, time = request.param == "delay", np.arange(0, 40, 0.00025)
    way = 12.0 * np.sin(2 * np.pi * time / 0.9) + 5.0 * np.sin(2 * np.pi * time / 0.37)
    load, friction = 1.5 * np.sin(2 * np.pi * time / 0.61), np.sign(way)
    if not late:
        friction = first_order(friction[None], 0.006, time, np.zeros(len(time)))[0][0]
    tau = np.interp(time - 0.0052 * late, time, load + 0.3 * friction)
    log = pd.DataFrame({"time": time, "theta": cumulative_trapezoid(way, time, initial=0), "omega": way,
                        "C": 50 * load, "tau": tau})[::20]
    log[["C", "tau"]] += np.random.default_rng(0).standard_normal((len(log), 2)) * (0.15, 0.005)
    log.to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "study.toml").write_text(GEARED.replace("runs = []", 'runs = ["log.csv"]'))
    return late, Dataset(load_study(tmp_path / "study.toml"), Library())


def test_a_delay_that_samples_without_turns_rule_out_is_what_happens_at_turns(turning):
    late, dataset = turning
    model = compile_model(dataset.library, dataset.study.rig, [("time_delay", "torque")])
    fit = least_squares.fit(dataset, model)
    assert fit.parameters["time_delay_torque.d"] == pytest.approx(0.005, abs=5e-4), "it looks late in either"
    assert no_effect(dataset, model, fit) == (None if late else BETWEEN)


@pytest.mark.parametrize("turning", ["delay"], indirect=True)
def test_a_delay_under_a_load_that_the_motion_does_not_tell_is_found(turning):
    _, dataset = turning
    model = compile_model(dataset.library, dataset.study.rig, [("time_delay", "torque")])
    fit = least_squares.fit(dataset, model)
    low, high = fit.interval("time_delay_torque.d")
    assert low < 0.0052 < high and high - low < 0.002 and fit.error["C"] < 0.6


@pytest.mark.long
def test_a_delay_comes_to_what_leaves_least_from_wherever_it_starts(turning):
    late, dataset = turning
    model = compile_model(dataset.library, dataset.study.rig, [("time_delay", "torque")])
    name, known = "time_delay_torque.d", []
    for start in (-0.005, 1e-4, 0.002, 0.005, 0.01):
        fit = least_squares.fit(dataset, model, {name: start})
        profile = Profile(dataset, model, fit, name, "fit", 0.005)
        known.append(fit.parameters[name])
        assert profile.excess <= profile.sure
    assert np.ptp(known) < (5e-4 if late else 0.0026), "what no delay has made is told to half a sample"


def test_a_study_whose_effect_moves_the_motion_can_be_opened(tmp_path):
    """The force of an axis is compared, so that a delay of it moves all that is known of the motion."""
    time = np.arange(0, 20, 0.005)
    speed = 0.05 * np.sin(2 * np.pi * time / 5) + 0.02 * np.sin(2 * np.pi * time / 0.7)
    motion = pd.DataFrame({"time": time, "x": cumulative_trapezoid(speed, time, initial=0)})
    force = 180 * speed + 90 * np.gradient(speed, time)
    motion["F"] = np.interp(time - 0.01, time, force) + 0.05 * np.random.default_rng(0).standard_normal(len(time))
    motion.to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "study.toml").write_text("""
[rig]
model = "DriveTrain.Rigs.LinearAxis"
[parameters]
"carriage.J" = { value = 80.0, fixed = false }
"guide.f0" = { value = 0.0 }
"viscous_guide.b" = { value = 100.0, fixed = false }
[data]
runs = ["log.csv"]
[columns]
x = { variable = "motor.phi", unit = "m" }
F = { variable = "force", unit = "N" }
[[effects]]
effect = "time_delay"
place = "force"
""")
    dataset = Dataset(load_study(tmp_path / "study.toml"), Library())
    found = least_squares.fit(dataset, dataset.base)
    assert found.parameters["time_delay_force.d"] == pytest.approx(0.01, abs=1e-3)


def test_an_estimate_whose_speeds_alone_are_moved_needs_the_angle_alone():
    axis, d = compile_model(Library(), "DriveTrain.Rigs.LinearAxis", [("time_delay", "force")]), 0.03
    values = {"carriage.J": 90.0, "viscous_guide.b": 180.0, "guide.f0": 0.0}

    def force(late):
        return estimate(axis, {"motor.phi": np.sin(3 * TIME)}, TIME, {**values, "time_delay_force.d": late})["force"]

    np.testing.assert_allclose(force(d)[10:-10], np.interp(TIME - d, TIME, force(0.0))[10:-10], atol=1.0)
    assert np.ptp(force(0.0)) > 1000


def test_two_torques_that_the_motion_predicts_are_as_late_as_one():
    """Each moved the motion for both: a delay of the pair was found at half its length."""
    library = Library([PENDULUM])
    pendulum = compile_model(library, "DoublePendulum", [("time_delay", "torque")])

    def torques(d):
        motion = {"motor1.phi": np.sin(3 * TIME), "motor2.phi": 0.7 * np.sin(4 * TIME)}
        return np.array(list(estimate(pendulum, motion, TIME, {"time_delay_torque.d": d}).values()))

    moved = torques(0.1)[:, 20:-20]
    then = np.array([np.interp(TIME - 0.1, TIME, t) for t in torques(0.0)])[:, 20:-20]
    np.testing.assert_allclose(moved, then, atol=0.02 * np.abs(then).max())


@pytest.mark.parametrize("later", [-0.0137, 0.004, 0.05, 0.0])
def test_some_samples_are_moved_as_all_of_them_are(later):
    run = np.repeat([0.0, 1.0], len(TIME) // 2)
    some, time = np.array([3, 180, 201, 399]), np.tile(TIME[:200], 2)
    for readings in range(3):  # the first is made of some, later ones are kept of all
        record = Record(Clock(time, run), np.sin(3 * time))
        for _ in range(readings):
            record.at(later, some)
        for few, all_ in zip(record.at(later, some), record.at(later)):
            np.testing.assert_array_equal(few, all_[some])


@pytest.mark.parametrize("seed", [60003, *(pytest.param(seed, marks=pytest.mark.long) for seed in (60011, 60027))])
def test_the_interval_of_a_delay_that_jumps_tell_holds_where_in_a_sample_they_lie(seed, tmp_path):
    """By noise alone it was +- 0.2 ms of a sample of 5 ms, and 0.05 to 0.1 samples off in each of seven logs."""
    dataset = Dataset(load_study(make(f"linear:time_delay:1.3:{seed}", tmp_path, quick=True)), Library())
    model = compile_model(dataset.library, dataset.base.rig, [("time_delay", "force")])
    fit = least_squares.fit(dataset, model)
    low, high = fit.interval("time_delay_force.d")
    true = {60003: 0.004883, 60011: 0.004648, 60027: 0.003896}[seed]
    assert 0 < low < true < high < true + 0.003


def test_the_lag_of_a_reference_is_told_in_sudden_moves(tmp_path):
    """Accelerations were told by the record, which shows them held back: 0.116 s for 0.08."""
    rng, time, speed = np.random.default_rng(3), np.arange(0, 60, 0.01), np.zeros(6000)
    for begin in np.arange(50, 5900, 120):
        speed[begin:begin + 60] = rng.uniform(30, 60) * (1 if begin // 120 % 2 else -1)
    speed = np.convolve(speed, np.hanning(17) / np.hanning(17).sum(), "same")
    phi = 10.0 + cumulative_trapezoid(speed, time, initial=0)
    model, free = compile_model(Library(), RIG), {"gear.f0": 0.02, "gear.mu": 1.0, "load.J": 0.4}
    values = {n: v.value for n, v in model.parameters.items()} | free
    q, acceleration = phi / 50, np.gradient(speed, time) / 50
    load = 4.0 * 9.80665 * 0.3 * np.sin(q) + (0.4 + 4.0 * 0.3**2) * acceleration
    at = [estimate(model, {"motor.phi": phi, "motor.tau": np.full(6000, torque)}, time, values)["C"]
          for torque in (0.0, 1.0)]
    recorded = first_order(load[None], 0.08, time, np.zeros(6000))[0][0]
    pd.DataFrame({"time": time, "phi": phi, "C": recorded + 0.02 * rng.standard_normal(6000),
                  "tau": (load - at[0]) / (at[1] - at[0])}).to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "study.toml").write_text(f"""
[rig]
model = "{RIG}"
[parameters]
"gear.f0" = {{ value = 0.01, fixed = false }}
"gear.mu" = {{ value = 0.95, fixed = false }}
"load.J" = {{ value = 0.4, fixed = true }}
[data]
runs = ["log.csv"]
reference = "sensor"
[columns]
phi = {{ variable = "motor.phi", unit = "rad" }}
tau = {{ variable = "motor.tau", unit = "N.m" }}
C = {{ variable = "C", unit = "N.m" }}
[[effects]]
effect = "reference_lag"
place = "joint"
""")
    data = Dataset(load_study(tmp_path / "study.toml"), Library())
    found = least_squares.fit(data, data.base)
    assert found.parameters["reference_lag_joint.T"] == pytest.approx(0.08, rel=0.02)
    assert found.error["C"] < 0.06

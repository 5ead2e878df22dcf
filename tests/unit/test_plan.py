"""Claims about a plan: no limit is exceeded, what is impossible is said, and its files can be run."""

import json
import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from pycosim.cli import main
from pycosim.compile import Library
from pycosim.control.trajectories import from_file
from pycosim.core.errors import PlanError, PycosimError
from pycosim.design.information import ChannelNoise
from pycosim.design.motion import REST, TRANSFER, Stroke, assemble, ordered, profile
from pycosim.design.optimiser import Optimiser, prior_of
from pycosim.design.plan import foreseen, hidden_of, known, make_plan, motion_of, separations, table
from pycosim.project import Plan, open_project
from pycosim.study.parse import load_study
from pycosim.study.schema import Setting, Study

STUDY = "examples/hip_knee/study.toml"
LIBRARY = Library()
GEARED = {"q": (-1.0, 1.5), "motor.w": (None, 30.0), "motor.a": (None, 200.0), "motor.tau": (None, 1.0)}


def geared(tmp_path, **limits):
    """A study of one geared joint, its friction to be identified from a torque reference."""
    free = {n: Setting(value=v, fixed=False) for n, v in (("gear.f0", 0.05), ("gear.mu", 0.9))}
    given = {**GEARED, **{k.replace("__", "."): v for k, v in limits.items()}}
    return Study(tmp_path / "geared.toml", "DriveTrain.Rigs.GearedJoint", parameters=free, reference="sensor",
                 limits=given)


def planned(study, **options):
    model = study.validate(LIBRARY)
    return make_plan(known(study, LIBRARY, model), **{"budget": 60.0, "patience": 20.0, **options})


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    return planned(geared(tmp_path_factory.mktemp("one")))


def within(plan):
    """Every limit, sample by sample, and as differences between samples have it."""
    limits, motion = plan.known.workspace.limits, plan.motion
    step = 1 / plan.rate
    assert plan.known.workspace.margin(motion.angle).min() >= 0
    for values, bound in ((motion.speed, limits.speed), (motion.acceleration, limits.acceleration),
                          (np.diff(motion.angle, axis=1) / step, limits.speed),
                          (np.diff(motion.speed, axis=1) / step, limits.acceleration)):
        assert np.all(np.abs(values).max(axis=1) <= bound * (1 + 1e-9))
    if plan.torque is not None:
        assert np.all(np.abs(plan.torque).max(axis=1) <= limits.torque)
    assert motion.duration <= plan.budget


def test_a_plan_keeps_its_limits(one):
    within(one)


@pytest.mark.long
@settings(max_examples=5, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(low=st.floats(-3, 0), span=st.floats(0.01, 4), speed=st.floats(0.3, 100), acceleration=st.floats(2, 1000),
       torque=st.floats(0.02, 2), budget=st.floats(5, 90))
@example(low=-1.0, span=2.5, speed=30.0, acceleration=200.0, torque=1.0, budget=60.0)
def test_no_limit_is_ever_exceeded_and_what_is_impossible_is_said(tmp_path, low, span, speed, acceleration, torque,
                                                                  budget):
    study = geared(tmp_path, q=(low, low + span), motor__w=(None, speed), motor__a=(None, acceleration),
                   motor__tau=(None, torque))
    try:
        plan = planned(study, budget=budget, patience=3.0)
    except PlanError as error:
        wide = low <= -1 and low + span >= 1.5 and speed >= 30 and acceleration >= 200 and torque >= 1
        assert not (wide and budget >= 60), "limits as wide as those of GEARED leave an experiment"
        named = ("motor.w", "motor.a", "motor.tau", "'q'", "budget", "way", "speed", "acceleration", "torque", "stop")
        assert any(n in str(error) for n in named)
        assert "\n" not in str(error)
    else:
        within(plan)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2 ** 31), motors=st.integers(1, 4))
def test_an_assembled_motion_of_any_machine_is_smooth_and_within_its_limits(seed, motors):
    rng = np.random.default_rng(seed)
    speed, acceleration = rng.uniform(0.5, 5, motors), rng.uniform(1, 50, motors)
    strokes = []
    for k in range(4):
        velocity = rng.uniform(-1, 1, motors) * speed
        ramp = max((math.pi / 2 * np.abs(velocity) / acceleration).max(), 0.1)
        strokes.append(Stroke(rng.uniform(-9, 9, motors), velocity, ramp + rng.uniform(0.1, 1), ramp, 2, str(k)))
    motion = assemble(ordered(strokes, speed, acceleration), speed, acceleration, 0.2, 200.0)
    for values, bound in ((motion.speed, speed), (np.diff(motion.angle) * 200, speed),
                          (motion.acceleration, acceleration), (np.diff(motion.speed) * 200, acceleration)):
        assert np.all(np.abs(values).max(axis=1) <= bound * (1 + 1e-9))
    rest = motion.label == REST
    np.testing.assert_allclose(motion.speed[:, rest], 0, atol=1e-9)


def test_the_profile_s_speed_and_acceleration_are_its_derivatives():
    t = np.linspace(0, 3, 30001)
    travel, speed, acceleration = profile(t, np.full(t.shape, 3.0), np.full(t.shape, 0.7))
    np.testing.assert_allclose(np.gradient(travel, t)[1:-1], speed[1:-1], atol=1e-6)
    np.testing.assert_allclose(np.gradient(speed, t)[1:-1], acceleration[1:-1], atol=1e-3)
    assert travel[-1] == pytest.approx(3.0 - 0.7)


@pytest.mark.long
@pytest.mark.parametrize("limits, said", [
    ({"motor__w": (None, 0.02)}, "'motor.w', 0.02 rad/s, is too low"),
    ({"motor__tau": (None, 0.01)}, "'motor.tau'"),
    ({"q": (0.3, 0.3001)}, "no position|'q'|way"),
    ({"motor__a": (None, None)}, "no limit of 'motor.a'"),
])
def test_impossible_limits_are_named(tmp_path, limits, said):
    with pytest.raises(PlanError, match=said):
        planned(geared(tmp_path, **limits), patience=3.0)


def test_a_budget_too_short_says_how_much_is_needed(tmp_path):
    with pytest.raises(PlanError, match="budget of 3 s"):
        planned(geared(tmp_path), budget=3.0, patience=3.0)


def test_a_plan_covers_both_directions_several_speeds_and_holds_a_part_out(one):
    speeds = {round(float(np.abs(s.velocity).max()), 1) for s in one.motion.strokes}
    assert max(speeds) > 3 * min(speeds)
    assert len(one.motion.held_out) == len(one.motion.strokes)
    labels = set(one.motion.label) - {REST, TRANSFER}
    assert {n[-1] for n in labels} == {"+", "-"}
    held = sum(b - a for a, b in one.motion.held_out)
    assert 0.02 * one.motion.duration < held < 0.5 * one.motion.duration


@pytest.mark.long
def test_the_optimiser_s_plan_beats_a_start_of_its_own(tmp_path):
    k = known(geared(tmp_path), LIBRARY, geared(tmp_path).validate(LIBRARY))
    seen = []
    inner = Optimiser.solve

    def solve(self, rng, seconds, progress):
        seen.append((self, self.start(np.random.default_rng(3))))
        return inner(self, rng, seconds, progress)

    Optimiser.solve = solve
    try:
        plan = make_plan(k, budget=60.0)
    finally:
        Optimiser.solve = inner
    optimiser, start = seen[0]
    before = optimiser.values(start / optimiser.scale).full()
    sizes = [np.sqrt(np.diag(np.linalg.inv(g))) for g in (plan.design.grams[0], before)]
    assert np.exp(np.mean(np.log(sizes[0] / sizes[1]))) < 0.8
    assert motion_of(plan.design, k.workspace, 60.0, 0.15, 100.0).duration <= 60.0


@pytest.mark.parametrize("duration", [0.4, 1.0, 6.0])
@pytest.mark.parametrize("paired", [False, True])
def test_the_density_of_the_noise_is_the_variance_of_a_way_s_mean(duration, paired):
    noise, step, dwell = ChannelNoise(0.3, 0.2, 1.3), 0.005, 0.15
    n = round(duration / step)
    t = (np.arange(n) + 0.5) * step
    t = np.r_[t, 2 * duration + dwell - t[::-1]] if paired else t
    covariance = 0.04 * np.exp(-np.abs(t[:, None] - t) / 1.3) + 0.09 * np.eye(len(t))
    weights = np.r_[np.full(n, 0.5 / n), np.full(n, -0.5 / n)] if paired else np.full(n, 1.0 / n)
    if paired:
        weights = np.r_[np.full(n, 0.5 / n), np.full(n, -0.5 / n)]
    found = noise.density(duration, dwell, step, paired)
    assert float(found) == pytest.approx(duration * weights @ covariance @ weights, rel=0.02)


@pytest.mark.long
def test_the_same_physics_at_two_names_stays_alike_and_is_said_so():
    """An offset against itself, however much of it there is."""
    from pycosim.compile import compile_model
    from pycosim.design.information import Block
    study = load_study(STUDY)
    study = replace(study, reference="sensor")
    model = study.validate(LIBRARY)
    k = known(study, LIBRARY, model)
    larger = compile_model(LIBRARY, study.rig, [("torque_offset", "motor1")])
    values = {**{n: v.value for n, v in larger.parameters.items()}, **k.values}
    sized = {**values, "torque_offset_motor1.o": 0.02}
    free = [*k.free, "torque_offset_motor1.o"]
    block = Block(larger, free, values, prior_of(None, free, larger.parameters), (larger, sized), ("a", "b"))
    plan = make_plan(k, "twins", 90.0, 100.0, [block], patience=4.0)
    found, = separations(plan)
    assert not found["separable"] and found["share"] < 0.02


def test_an_effect_whose_torques_have_no_closed_form_is_left_out_and_told():
    study = replace(load_study(STUDY), reference="gravity_model")
    k = known(study, LIBRARY, study.validate(LIBRARY))
    keys = [("viscous", "1A"), ("load_nonlinearity", "1B"), ("load_nonlinearity", "2B")]
    found, notes = foreseen(k, hidden_of(k, keys))
    assert [b.name for b in found] == [("viscous@1A", "nothing")]
    assert len(notes) == 1 and notes[0].startswith("load_nonlinearity at 1B, 2B is not planned for: ")
    assert notes[0].endswith("What shows it: repeat the passes with three payloads or more.")


def test_a_saved_plan_is_loaded_with_its_motion_sample_by_sample(one, tmp_path):
    made = Plan(one)
    again = Plan.load(made.save(tmp_path / "plan.json"))
    assert again.record == made.record and repr(again) == repr(made) and again._repr_html_() == made._repr_html_()
    assert again.sentences == made.sentences
    for frame in (made.to_frame(), again.to_frame()):
        pd.testing.assert_frame_equal(frame, pd.DataFrame(table(["motor"], one.motion)), check_exact=True)
    arrays = again.to_xarray()
    assert (arrays.speed.sel(motor="motor").to_numpy() == made.to_frame()["motor.w"]).all()
    assert set(arrays.dims) == {"motor", "time"} and (arrays.manoeuvre == made.to_frame()["manoeuvre"]).all()
    assert again.to_csv(tmp_path / "a.csv").read_text() == made.to_csv(tmp_path / "b.csv").read_text()
    with pytest.raises(PycosimError, match="plan.json: a file of results holds no log"):
        again.plot.motion()
    (tmp_path / "plan.json").write_text(json.dumps({**made.record, "ways": {}}))
    with pytest.raises(PycosimError, match="something in it is missing"):
        Plan.load(tmp_path / "plan.json")


@pytest.mark.long
def test_a_plan_to_detect_says_what_it_shows_what_takes_longer_and_what_nothing_shows(tmp_path, monkeypatch):
    monkeypatch.setattr("pycosim.design.plan.PATIENCE", 6.0)
    plan = open_project(geared(tmp_path)).plan("detect", 60.0)
    within(plan.planned)
    rivals = {s["true"]: s for s in plan.to_dict()["rivals"]}
    assert {s["other"] for s in rivals.values()} == {"nothing"}
    shown = next(line for line in plan.sentences if line.startswith("It shows these effects"))
    never = next(line for line in plan.sentences if line.startswith("No motion that was found"))
    for effect in ("viscous@gear", "torque_constant@motor", "torque_offset@motor"):
        assert rivals[effect]["separable"] and effect.replace("@", " at ") in shown
    # way by way at one speed, inertia shows nothing; an offset of the sensor is nothing to what compares two ways
    for effect in ("rotor_inertia@motor", "joint_spring@joint"):
        assert not rivals[effect]["separable"] and effect.replace("@", " at ") in never
    assert not any("and nothing stay alike" in line or "nothing would miss" in line for line in plan.sentences)


def run(capsys, *argv):
    code = main([str(a) for a in argv])
    return code, capsys.readouterr()


@pytest.mark.long
def test_the_verb_writes_a_motion_that_a_scenario_reads(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("pycosim.design.plan.PATIENCE", 8.0)
    code, said = run(capsys, "plan", STUDY, "--budget", "110", "--out", tmp_path / "plan", "--json")
    assert code == 0, said.err
    result = json.loads(said.out)
    assert result["schema"] == 1 and result["noise"]["assumed"]
    assert {s["zone"] for s in result["strokes"]} >= {0, 2, 4} or len({s["zone"] // 2 for s in result["strokes"]}) == 3
    motion = pd.read_csv(tmp_path / "plan" / "plan.csv")
    assert list(motion) == ["time", "motor1.phi", "motor2.phi", "motor1.w", "motor2.w", "manoeuvre"]
    assert motion.time.iloc[-1] == pytest.approx(result["duration"]) and result["duration"] <= 110
    pd.testing.assert_frame_equal(Plan.load(tmp_path / "plan" / "plan.json").to_frame(), motion, atol=1e-8)
    model = load_study(STUDY).validate(LIBRARY)
    read = from_file(tmp_path / "plan" / "plan.csv", model, {n: v.value for n, v in model.parameters.items()}, 100.0)
    np.testing.assert_allclose(read.columns["ref.motor1.phi"], motion["motor1.phi"], atol=1e-6)
    np.testing.assert_allclose(read.columns["ref.motor2.w"], motion["motor2.w"], atol=0.02)  # of a spline
    for a, b in result["held_out"]:
        assert 0 <= a < b <= result["duration"]
    assert all(row["width"] < row["ci95_now"][1] - row["ci95_now"][0] for row in result["parameters"].values())


def test_bad_options_are_told_in_a_sentence(tmp_path, capsys):
    for argv, said in ((["--budget", "-3"], "--budget -3 s must be above zero"),
                       (["--rate", "1"], "--rate 1 Hz is outside"), (["--goal", "alternatives"], "are found in data"),
                       (["--goal", "twins"], "are found in data"),
                       (["--goal", "twin"], "(choose from 'parameters', 'alternatives', 'detect')"),
                       (["--buget", "3"], "closest: '--budget'")):
        code, out = run(capsys, "plan", STUDY, *argv, "--out", tmp_path / "bad")
        assert code == 2 and said in out.err and out.err.count("\n") == 1
        assert not (tmp_path / "bad").exists()

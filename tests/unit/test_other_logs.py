"""Claims about `benchmarks.other_logs`: power balances, effects show as said, answers are judged by rules."""

import ast
import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.other_logs import effects, machine, make, motions, run, score, sizes
from benchmarks.other_logs.machine import RATIO, SEGMENTS, Segment
from benchmarks.other_logs.simulate import Rig, Run, simulate

FOLDER = Path(make.__file__).parent
FRICTION = {"1A": (0.06, 0.93), "2A": (0.04, 0.9), "1B": (0.02, 0.95), "2B": (0.03, 0.88)}


@pytest.mark.parametrize("name", ["machine", "motions", "effects", "simulate", "sensors", "sizes", "make"])
def test_the_generator_knows_nothing_of_the_package_or_the_other_generators(name):
    tree = ast.parse((FOLDER / f"{name}.py").read_text())
    found = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names} | {
        n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert not {m for m in found if m.startswith(("pycosim", "benchmarks")) and "other_logs" not in m}


# --- machine


def behind(torque, w, f0, mu):
    """What leaves a segment that a torque enters: the textbook's efficiency, in the direction that power flows."""
    ahead = torque * np.sign(w)
    return np.sign(w) * np.where(ahead > 0, mu * (ahead - f0), ahead / mu - f0)


@pytest.mark.parametrize("way", [1, -1], ids=["driving", "driven backward"])
def test_power_that_enters_leaves_or_is_lost(way):
    rng = np.random.default_rng(1)
    lines = rng.choice([-1, 1], (500, 2)) * rng.uniform(0.6, 3, (500, 2))
    motors = way * np.sign(lines) * rng.uniform(0.1, 5, (500, 2))
    C, v, w = machine.motor_angles(lines), machine.joint_angles(motors), machine.per_segment(motors)
    segments = {s: Segment(np.sign(w[s]), *FRICTION[s]) for s in SEGMENTS}
    tau = machine.motor_torques(segments, C)
    assert np.allclose(machine.joint_torques(segments, tau), C, rtol=0, atol=1e-9)
    hip = {k: behind(tau[:, k - 1], w[f"{k}A"], *FRICTION[f"{k}A"]) for k in (1, 2)}
    knee = {k: behind(hip[k], w[f"{k}B"], *FRICTION[f"{k}B"]) for k in (1, 2)}
    assert np.allclose(RATIO * np.column_stack([hip[1] + hip[2], knee[1] - knee[2]]), C, rtol=0, atol=1e-9)
    lost = np.array([(tau[:, k - 1] - hip[k]) * w[f"{k}A"] for k in (1, 2)]
                    + [(hip[k] - knee[k]) * w[f"{k}B"] for k in (1, 2)])
    entered, left = (tau * motors).sum(1), (C * v).sum(1)
    assert (lost > 0).all() and (way * left > 0).all()
    assert np.allclose(entered, left + lost.sum(0), rtol=0, atol=1e-9)


def test_work_of_the_joints_is_energy_of_the_leg():
    """Round a motion that ends as it began, masses and weights take no work."""
    time = np.arange(4000) * 2 * np.pi / 4000
    q = np.column_stack([0.4 + 0.5 * np.sin(time), -0.7 + 0.6 * np.sin(2 * time + 1)])
    v = np.column_stack([0.5 * np.cos(time), 1.2 * np.cos(2 * time + 1)])
    a = np.column_stack([-0.5 * np.sin(time), -2.4 * np.sin(2 * time + 1)])
    power = (machine.load_torques(q, v, a, payload=0.5) * v).sum(1)
    assert abs(power.sum()) < 1e-9 * abs(power).sum()


@pytest.fixture(scope="module")
def short():
    rng = np.random.default_rng(3)
    q = motions.motion("sines", rng, 6.0, 0.002)
    found = Run("sines", 100, 5, q).loaded(True, rng)
    return found, Rig(FRICTION, 1e-3)


@pytest.mark.parametrize("name", [*effects.CATALOGUE, *effects.OUTSIDE])
def test_every_effect_shows(short, name):
    found, rig = short
    plain = simulate(rig, found, [])
    changed = simulate(rig, found, [effects.drawn(np.random.default_rng(2), 10.0, 6.0)[name]])
    shows = {n for n in ("theta", "readings", "reference")
             if not np.array_equal(getattr(plain, n), getattr(changed, n))}
    assert {"theta"} <= shows if name in effects.ELASTIC else shows and "theta" not in shows


# --- logs


@pytest.mark.long
def test_a_seed_gives_the_same_log_again(tmp_path):
    for name in ("once", "again"):
        make.make(21, tmp_path / name)
    files = sorted(p.name for p in (tmp_path / "once").iterdir())
    assert files == [*(f"run{k}.csv" for k in range(1, 6)), "study.toml", "truth.json"]
    assert all((tmp_path / "once" / f).read_bytes() == (tmp_path / "again" / f).read_bytes() for f in files)
    head = (tmp_path / "once" / "run1.csv").read_text().splitlines()[:2]
    assert head == ["time,theta1,theta2,tau1,tau2,C_H,C_K", "0.00300,-4.732331,16.081488,0.1546,0.2596,6.417,-1.436"]
    truth = json.loads((tmp_path / "once" / "truth.json").read_text())
    assert truth["hidden"][0]["effect"] == "torque_offset" and len(truth["samples"]) == 5


@pytest.mark.parametrize("name", ["torque_offset", "x_speed_angle"])
def test_an_effect_shows_as_far_above_noise_as_is_said(name):
    case, _ = make.drawn(48, [name])
    assert case.ratios[0] == pytest.approx(case.target, rel=0.12)
    errors = []
    for some in ([], case.effects):
        truth = simulate(case.rig, case.runs[0], some)
        segments = {s: Segment(truth.direction[s], *case.rig.friction[s]) for s in SEGMENTS}
        moves = np.all([abs(w) > sizes.MOVING for w in truth.w.values()], axis=0)
        left = (machine.joint_torques(segments, truth.readings) - truth.reference)[moves]
        errors.append(np.sqrt(np.mean(left ** 2, axis=0)).max())
    without, with_it = errors
    assert without < 1e-9  # friction fitted anew takes some of it, never more than all
    assert 0.98 * case.ratios[0] * case.sensors.floor < with_it < 20 * case.ratios[0] * case.sensors.floor


def test_half_an_effect_shows_about_half_as_far():
    case, _ = make.drawn(48, ["torque_offset"])
    assert sizes.ratio(case, case.effects[0].scaled(0.5)) == pytest.approx(case.ratios[0] / 2, rel=0.15)


# --- judgement


def row(hidden=(), steps=(), verdict="missing_effect", final="nothing_missing", sizes=None, own_travel=1e-4, **more):
    """A row; effects as ``id@place``, a step's alternatives behind ``|``."""
    steps = [[name.split("@") for name in step.split("|")] for step in steps]
    return {"case": "other:1", "seed": 1, "kinds": ["gait"], "quirk": "none", "failure": "", "blocked": False,
            "hidden": [h.split("@") for h in hidden], "sizes": sizes or [1.0] * len(hidden), "own_travel": own_travel,
            "steps": [{"added": first, "twins": others} for first, *others in steps], "verdict": verdict,
            "final": final, "seconds": 1.0, "depends": [], **more}


SILENT = {"verdict": "nothing_missing", "final": "nothing_missing"}
OPEN = {"verdict": "unexplained", "final": "unexplained"}
POOR = {"verdict": "not_enough_excitation", "final": "not_enough_excitation"}
JUDGED = {
    "nothing is hidden and nothing said": (row(**SILENT), "right"),
    "nothing is hidden and no answer": (row(**OPEN), "undecided"),
    "nothing is hidden and an effect said": (row(steps=["viscous@1A"]), "wrong"),
    "named": (row(["viscous@1A"], ["viscous@1A"]), "right"),
    "at another place": (row(["viscous@1A"], ["viscous@2A"]), "wrong"),
    "at a part of its place": (row(["viscous@1A+2A"], ["viscous@2A"]), "wrong"),
    "at more than its place": (row(["viscous@1A"], ["viscous@1A+2A"]), "wrong"),
    "everywhere": (row(["thermal_drift@system"], ["thermal_drift@1A+2A"]), "right"),
    "third alternative": (row(["viscous@1A"], ["a@1A|b@1A|c@1A|viscous@1A"]), "right"),
    "fourth alternative": (row(["viscous@1A"], ["a@1A|b@1A|c@1A|d@1A|viscous@1A"]), "wrong"),
    "named, and another": (row(["viscous@1A"], ["viscous@1A", "time_delay@torque"]), "wrong"),
    "missed": (row(["viscous@1A"], **SILENT), "missed"),
    "no answer": (row(["viscous@1A"], **OPEN), "undecided"),
    "too small to be seen": (row(["viscous@1A"], sizes=[0.4], **SILENT), "right"),
    "too small, and named": (row(["viscous@1A"], ["viscous@1A"], sizes=[0.4]), "right"),
    "one of two, the rest said to be nothing": (row(["viscous@1A", "stribeck@2A"], ["viscous@1A"]), "missed"),
    "one of two, the rest open": (row(["viscous@1A", "stribeck@2A"], ["viscous@1A"], final="unexplained"),
                                  "undecided"),
    "both": (row(["viscous@1A", "stribeck@2A"], ["stribeck@2A", "viscous@1A"]), "right"),
    "own travel that shows": (row(steps=["presliding@1A"], own_travel=1e-3), "right"),
    "own travel too short": (row(steps=["presliding@1A"], own_travel=1e-4), "wrong"),
    "own travel beside what is missed": (row(["viscous@1A"], ["presliding@1A"], own_travel=1e-3), "missed"),
    "a law outside, left open": (row(["x_speed_angle@1A"], **OPEN), "right"),
    "a law outside, too little motion": (row(["x_speed_angle@1A"], **POOR), "undecided"),
    "a law outside, missed": (row(["x_speed_angle@1A"], **SILENT), "missed"),
    "a law outside, another named": (row(["x_speed_angle@1A"], ["viscous@1A"]), "wrong"),
    "a dead zone as an offset": (row(["x_dead_zone@motor1"], ["torque_offset@motor1"]), "right"),
    "a slow reference as its lag": (row(["low_pass@C"], ["reference_lag@C_H+C_K"]), "right"),
    "a slow torque as the reference's lag": (row(["low_pass@tau"], ["reference_lag@C_H+C_K"]), "wrong"),
    "a slow torque at the motors": (row(["low_pass@tau"], ["low_pass@torque"]), "right"),
    "stopped by the check": (row(["viscous@1A"], verdict=None, final=None, blocked=True), "blocked"),
    "out of time": (row(["viscous@1A"], verdict=None, final=None, failure="over 300 s"), "failed"),
}


@pytest.mark.parametrize("what", JUDGED)
def test_answers_are_judged(what):
    given, judged = JUDGED[what]
    assert score.score(given) == judged


def test_the_summary_counts_and_lists():
    lines = list(run.summary([row(**SILENT), row(["viscous@1A"], ["viscous@2A"]), row(["x_speed_angle@1A"], **OPEN)]))
    assert lines[2:5] == ["| nothing | 1 | 1 | 0 | 0 | 0 | 0 | 0 |", "| effects | 1 | 0 | 0 | 0 | 1 | 0 | 0 |",
                          "| outside laws | 1 | 1 | 0 | 0 | 0 | 0 | 0 |"]
    assert len(lines) == 7 and "viscous@2A" in lines[6] and lines[6].startswith("- wrong")

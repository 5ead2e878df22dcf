"""Claims about the machines of `benchmarks.real_logs`: they balance power, are sized, and stand without the package."""

import ast
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.real_logs import cases, effects, machines, mistakes
from benchmarks.real_logs.make import make
from benchmarks.real_logs.run import summary
from benchmarks.real_logs.score import score

FOLDER = Path(cases.__file__).parent


@pytest.mark.parametrize("name", ["machines", "motions", "sensors", "effects", "mistakes", "cases", "make"])
def test_the_generator_knows_nothing_of_the_package(name):
    tree = ast.parse((FOLDER / f"{name}.py").read_text())
    found = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names} | {
        n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert not {m for m in found if m.startswith("pycosim") or "hidden_effects" in m}


@pytest.mark.parametrize("condition", ["plain", "gait", "geared", "pick_and_place"])
def test_power_that_enters_leaves_or_is_lost(condition):
    found = cases.drawn(cases.Case(condition, quick=True))
    truth = found.truth()
    assert machines.power_gap(found.plant, truth) < 1e-6 * abs(truth.tau * truth.omega).max()


@pytest.mark.parametrize("motion", ["passes", "gait", "multisine", "pick_and_place"])
def test_speeds_and_accelerations_are_those_of_the_angles(motion):
    m = getattr(cases.motions, motion)(np.random.default_rng(1), 1000.0)
    inner = slice(5, -5)
    assert abs(np.gradient(m.x, m.time, axis=1) - m.v)[:, inner].max() < 1e-3 * abs(m.v).max()
    assert abs(np.gradient(m.v, m.time, axis=1) - m.a)[:, inner].max() < 3e-2 * abs(m.a).max()


@pytest.mark.parametrize("what", ["stribeck", pytest.param("cable_compliance", marks=pytest.mark.long)])
def test_effects_have_the_size_that_is_asked_for(what):
    found = cases.drawn(cases.Case("digital", what, 1.7, 3, quick=True))
    assert found.sizes[0] == pytest.approx(1.7, rel=0.03)


@pytest.mark.parametrize("name", [*mistakes.MISTAKES, *mistakes.POOR])
def test_a_mistake_changes_the_log(name):
    found = cases.drawn(cases.Case("mistake", name, seed=1, quick=True))
    log = found.columns(found.truth())
    wrong = mistakes.apply(name, log, 1)
    assert list(wrong) != list(log) or any(not np.array_equal(wrong[n], log[n]) for n in log)


def test_a_case_is_a_study_with_its_logs(tmp_path):
    study = make("one_noisy:viscous:1.7:2", tmp_path, quick=True)
    text, truth = study.read_text(), json.loads((tmp_path / "truth.json").read_text())
    assert all(f"run{k}.csv" in text for k in (1, 2, 3)) and truth["hidden"][0][0] == "viscous"
    assert {"time", "theta1", "tau2", "C_K"} <= set(pd.read_csv(tmp_path / "run3.csv"))


def row(steps=(), verdict="nothing_missing", final="nothing_missing", hidden=(), condition="plain"):
    """A row of `run`."""
    return {"condition": condition, "failure": "", "blocked": False, "hidden": hidden, "verdict": verdict,
            "final": final, "steps": [{"added": s, "twins": t} for s, t in steps]}


def test_scores_are_what_they_say():
    hidden = [("viscous", "1A")]
    other = [(("stribeck", "1A"), [])]
    assert score(row(hidden=hidden)) == "missed"
    assert score(row(other, "missing_effect", hidden=hidden)) == "wrong"
    assert score(row([(("stribeck", "1A"), hidden)], "missing_effect", hidden=hidden)) == "right"
    assert score(row([(("stribeck", "1A"), [*3 * [("backlash", "line1")], *hidden])], hidden=hidden)) == "wrong"
    assert score(row(verdict="unexplained", final="unexplained", hidden=hidden)) == "undecided"
    assert score(row()) == "right" and score(row(other, "missing_effect")) == "wrong"
    assert score(row([(("reference_mass", "shank"), [])], condition="reference_mass")) == "right"
    assert score(row(verdict="unexplained", final="unexplained", hidden=[("wear", "1A")])) == "right"


def test_the_summary_counts_what_is_right_with_and_without_an_effect():
    cost = {"seconds": 10.0, "peak_mib": 300, "depends": [], "case": "plain:viscous:1.7:3"}
    hidden, other = [("viscous", "1A")], [(("stribeck", "1A"), [])]
    rows = [row() | cost, row(other, "missing_effect") | cost, row(other, "missing_effect", hidden=hidden) | cost,
            row([(hidden[0], [])], "missing_effect", hidden=hidden) | cost | {"seconds": 30.0},
            row(hidden=hidden, condition="gait") | cost]
    lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in summary(rows) if line.startswith("| ")]
    assert lines[1] == ["plain", "1 of 2", "1 of 2", "", "", "2", "", "", "", "10, 30", "300"]
    assert lines[2][:5] == ["gait", "", "0 of 1", "", "1"] and lines[3][:3] == ["all", "1 of 2", "1 of 3"]


def test_every_condition_can_be_drawn():
    assert set(effects.SIXTEEN) <= set(effects.AMPLITUDE)
    for condition in cases.CONDITIONS:
        listed = cases.listed([condition], 1)
        assert listed and all(cases.parse(c.name) == c for c in listed)

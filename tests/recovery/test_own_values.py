"""Parameters with a value of their own in each run: each is found with its interval, an unseen run has their mean."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.hidden_effects import machine as rig
from pycosim.cli.entry import main
from pycosim.compile import Library
from pycosim.core.errors import StudyError
from pycosim.data.dataset import Dataset
from pycosim.fit.least_squares import fit
from pycosim.report import records, sentences
from pycosim.study.parse import load_study
from pycosim.study.schema import Setting

STUDY = Path(__file__).parents[2] / "examples" / "hip_knee" / "study.toml"
LIBRARY = Library()
MOTION = rig.six_manoeuvres((1.6,), repeats=1, rate=20, start=((0.9, -0.85), (0.2, -0.6)))
CASES = {"torque_offset": ("motor1", "o", (0.03, -0.02, 0.08, 0.01), {}),
         "payload": ("shank", "m", (0.2, 0.5, 0.9, 0.4), {}),
         "torque_ripple": ("motor1", "phase", (0.4, 2.9, -2.0, 1.0), {"A": 0.06, "n": 1.0})}


def study_of(folder, effect, place, values, more, own=(), held_out=0):
    """A study of one run for each value of the coefficient that differs."""
    where, coefficient, _, rest = CASES[effect]
    paths = []
    for k, value in enumerate(values):
        hidden = rig.Effect(effect, where, **{coefficient: value, **rest})
        paths.append(folder / f"run{k + 1}.csv")
        rig.write_csv(rig.measure(rig.PAPER, MOTION, [hidden], rng=20 + k), paths[-1])
    study = replace(load_study(STUDY).with_data(paths), effects=[(effect, place)], own=list(own))
    study = replace(study, parameters={**study.parameters, **more})
    count = len(paths) - held_out
    return replace(study, runs=paths[:count], held_out=paths[count:])


@pytest.fixture(scope="module")
def offsets(tmp_path_factory):
    """Three runs with torque offsets of their own and a fourth held out, fitted with and without that."""
    folder, found = tmp_path_factory.mktemp("offsets"), []
    for own in ((), ("torque_offset@motor1.o",)):
        dataset = Dataset(study_of(folder, "torque_offset", "motor1", CASES["torque_offset"][2], {}, own, 1), LIBRARY)
        found.append((dataset, fit(dataset, dataset.base)))
    return found


def check(found, name, values, distance=lambda a, b: a - b):
    """Each run's value is within its interval, and the intervals are narrow against what lies between the runs."""
    for k, value in enumerate(values):
        run = f"{name}[run{k + 1}]"
        error = found.stderr[found.free.index(run)]
        assert abs(distance(found.parameters[run], value)) < 3.5 * error, (run, found.parameters[run], value, error)
        assert error < 0.25 * np.std(values)


def test_every_run_has_its_offset_and_the_error_is_noise(offsets):
    (_, shared), (dataset, own) = offsets
    check(own, "torque_offset_motor1.o", CASES["torque_offset"][2][:3])
    assert all(own.error[c] <= shared.error[c] for c in own.error) and own.error["C_H"] < 0.95 * shared.error["C_H"]
    assert "torque_offset_motor1.o" not in own.free and len(own.free) == len(shared.free) + 2
    alone = fit(dataset, dataset.base, {**own.parameters, **{n: 0.0 for n in own.own["torque_offset_motor1.o"]}})
    assert alone.values == pytest.approx(own.values, rel=1e-4, abs=1e-5)


def test_an_unseen_run_has_the_mean_with_what_lies_between_runs_said(offsets):
    _, (dataset, own) = offsets
    name, fitted = "torque_offset_motor1.o", [own.parameters[f"torque_offset_motor1.o[run{k}]"] for k in (1, 2, 3)]
    assert own.parameters[name] == pytest.approx(np.mean(fitted))
    problem = dataset.residuals(dataset.base, own.free, own.parameters, "test")
    moved = {**own.parameters, **{n: 9.0 for n in own.own[name]}}  # of fitted runs, and so none of its
    other = dataset.residuals(dataset.base, [], moved, "test").residual([])
    np.testing.assert_array_equal(problem.residual(own.values), other)
    record = records.parameters(own, dataset.base, 0)
    assert record["own"][name]["between_runs"] == pytest.approx(np.std(fitted, ddof=1)) and name not in record["fixed"]
    told = "\n".join(sentences.summary_parameters(record))
    assert "torque_offset_motor1.o has a value of its own in each run: mean" in told and "[run2]" in told
    draws = own.draw(400, bounded=False)
    error = own.stderr[own.free.index(f"{name}[run1]")]
    assert np.std(draws.array([f"{name}[run1]"])) == pytest.approx(error, rel=0.15)
    assert draws.array([name])[:, 0] == pytest.approx(
        draws.array([f"{name}[run{k}]" for k in (1, 2, 3)]).mean(axis=1))


def test_the_study_that_is_written_keeps_the_mean_and_the_list(offsets):
    _, (dataset, own) = offsets
    study = records.improved_study(dataset.study, dataset.base, own)
    assert study.own == ["torque_offset@motor1.o"] and not any("[" in n for n in study.parameters)
    assert study.parameters["torque_offset_motor1.o"].value == pytest.approx(own.parameters["torque_offset_motor1.o"])
    study.validate(LIBRARY)


@pytest.mark.parametrize("effect", ["payload", "torque_ripple"])
def test_every_run_has_its_payload_or_the_phase_of_its_ripple(effect, tmp_path):
    place, coefficient, values, rest = CASES[effect]
    more = {"torque_ripple_motor1.n": Setting(value=1.0, fixed=True)} if rest else {}
    dataset = Dataset(study_of(tmp_path, effect, place, values[:3], more, [f"{effect}@{place}.{coefficient}"]), LIBRARY)
    found = fit(dataset, dataset.base)
    turn = 0.0 if not rest or found.parameters["torque_ripple_motor1.A"] > 0 else np.pi
    check(found, f"{effect}_{place}.{coefficient}", values[:3],
          (lambda a, b: (a - b + turn + np.pi) % (2 * np.pi) - np.pi) if rest else (lambda a, b: a - b))


def test_what_cannot_differ_from_run_to_run_is_refused_in_one_sentence(offsets, tmp_path):
    _, (dataset, _) = offsets
    with pytest.raises(StudyError, match="a friction state, a delay or a filter depends on 'presliding_1A.travel'"):
        given = Dataset(replace(dataset.study, effects=[("presliding", "1A")], own=["presliding@1A.travel"]), LIBRARY)
        given.parameters.free(Dataset(replace(dataset.study, effects=[("presliding", "1A")], own=[]), LIBRARY).base)
    with pytest.raises(StudyError, match="'diagnose' does not take into account that torque_offset@motor1.o has"):
        dataset.study.refuse_own("diagnose", LIBRARY)


@pytest.mark.slow
def test_a_ripple_is_found_although_the_encoder_counts_from_elsewhere_in_each_run(tmp_path, monkeypatch):
    """By `improve` with a run held out, in the study it writes, and by `confirm` on runs whose phases nobody knows."""
    monkeypatch.chdir(tmp_path)
    motion = rig.six_manoeuvres((0.5, 1.6), repeats=1, rate=25, longest_pass=4)
    given = {"run1": 0.4, "run2": 2.9, "run3": -2.0, "run4": 1.0, "new1": -1.0, "new2": 2.0, "sound1": None,
             "sound2": None}
    for k, (name, phase) in enumerate(given.items()):
        hidden = [] if phase is None else [rig.Effect("torque_ripple", "motor1", A=0.03, n=2.0, phase=phase)]
        rig.write_csv(rig.measure(rig.PAPER, motion, hidden, rng=50 + k), tmp_path / f"{name}.csv")
    runs = [f"run{k}.csv" for k in (1, 2, 3, 4)]
    assert main(["improve", str(STUDY), "--data", *runs, "--out", "found", "--quiet", "--bare"]) == 0
    ladder = json.loads((tmp_path / "found" / "ladder.json").read_text())["steps"]
    assert [s["added"] for s in ladder[1:]] == [{"effect": "torque_ripple", "place": "motor1"}]
    own = json.loads((tmp_path / "found" / "parameters.json").read_text())["own"]["torque_ripple_motor1.phase"]
    assert list(own["unseen"]) == ["torque_ripple_motor1.phase[run4]"] and len(own["runs"]) == 3
    values = ladder[-1]["coefficients"]
    for run in ("run1", "run2", "run3"):
        low, high = values[f"phase[{run}]"]["ci95"]
        away = (values[f"phase[{run}]"]["value"] - given[run] + np.pi) % (2 * np.pi) - np.pi
        assert abs(away) < high - low < 1.0
    assert abs((own["unseen"]["torque_ripple_motor1.phase[run4]"] - given["run4"] + np.pi) % (2 * np.pi) - np.pi) < 0.5
    assert load_study(tmp_path / "found" / "study.toml").own == ["torque_ripple@motor1.phase"]
    assert main(["diagnose", "found/study.toml", "--out", "again", "--quiet"]) == 0
    assert json.loads((tmp_path / "again" / "diagnosis.json").read_text())["verdict"] == "nothing_missing"
    for name in ("new", "sound"):
        logs = [f"{name}1.csv", f"{name}2.csv"]
        assert main(["confirm", "found/study.toml", "--data", *logs, "--out", name, "--quiet"]) == 0
        told = json.loads((tmp_path / name / "confirmation.json").read_text())
        assert told["effects"][0]["confirmed"] == (name == "new")
        lower = [told["replay"]["after"][c] < before for c, before in told["replay"]["before"].items()]
        assert all(lower) if name == "new" else not any(lower)

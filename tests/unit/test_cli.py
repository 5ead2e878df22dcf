"""Claims about the command line: every verb leaves the contract's files, says what it found, and refuses kindly."""

import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tiers import cases

from benchmarks.hidden_effects.machine import PAPER, Effect, measure, six_manoeuvres, write_csv
from pycosim.cli import parser, verbs
from pycosim.cli.entry import main
from pycosim.compile import Library
from pycosim.fit import nullspace
from pycosim.report import folder as folders
from pycosim.report import records
from pycosim.report.folder import Folder
from pycosim.study.parse import load_study

ROOT = Path(__file__).parents[2]
STUDY = ROOT / "examples" / "hip_knee" / "study.toml"
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A short log of a machine with viscous friction at 1A."""
    motion = six_manoeuvres(speeds=(0.5, 1.6), repeats=2, rate=25, longest_pass=4)
    path = tmp_path_factory.mktemp("log") / "run.csv"
    write_csv(measure(PAPER, motion, [Effect("viscous", "1A", b=0.05)], rng=3), path)
    return path


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments):
    assert main(list(map(str, arguments))) == 0


def read(path):
    """JSON without NaN or infinity."""
    def refuse(name):
        raise AssertionError(f"{name} in {path}")
    return json.loads(Path(path).read_text(), parse_constant=refuse)


def check_errors(error, channels=("C_H", "C_K")):
    assert set(channels) <= set(error) and all(e > 0 for e in error.values())


def check_parameters(found):
    assert found["schema"] == 1 and isinstance(found["seed"], int)
    check_errors(found["error"])
    for p in found["parameters"].values():
        assert {"value", "ci95", "unit", "at_bound", "identifiable"} <= set(p)
        assert p["ci95"][0] <= p["ci95"][1] and p["at_bound"] in (None, "min", "max")
    for d in found["null_directions"]:
        assert d["text"] and set(d["coefficients"]) <= set(found["parameters"])


def check_diagnosis(found):
    assert found["schema"] == 1
    assert found["verdict"] in ("missing_effect", "nothing_missing", "unexplained", "not_enough_excitation")
    check_errors(found["error"])
    check_errors(found["noise_floor"])
    for c in found["candidates"]:
        assert {"effect", "place", "accepted", "p_value", "p_value_single", "predicted_error", "held_out_error",
                "coefficients", "twins"} <= set(c)
        assert 0 <= c["p_value"] <= 1
        assert all({"value", "ci95", "unit"} <= set(v) for v in c["coefficients"].values())
    assert all({"variable", "strength"} <= set(d) for d in found["residual_depends_on"])
    assert all({"effect", "place", "why", "experiment"} <= set(u) for u in found["undetectable"])


def check_comparison(found):
    assert found["schema"] == 1
    check_errors(found["error"])
    assert {"manoeuvre", "branch"} <= set(found["by"])
    assert {"A", "F"} <= set(found["by"]["manoeuvre"])


@pytest.mark.long
def test_improve_leaves_every_file_and_tells_the_story(log, here, capsys):
    run("improve", STUDY, "--data", log)
    out = here / "study_improve"
    check_diagnosis(read(out / "diagnosis.json"))
    assert read(out / "diagnosis.json")["verdict"] == "missing_effect"
    check_diagnosis(read(out / "diagnosis_final.json"))
    check_parameters(read(out / "parameters.json"))
    check_comparison(read(out / "comparison.json"))
    ladder = read(out / "ladder.json")
    assert ladder["held_out"] and all(len(r) == 3 for r in ladder["held_out"])
    assert [s["added"] for s in ladder["steps"]][:2] == [None, {"effect": "viscous", "place": "1A"}]
    assert all(set(s) >= {"added", "error", "held_out_error"} for s in ladder["steps"])
    improved = load_study(out / "study.toml")
    assert ("viscous", "1A") in improved.effects and improved.runs == [log]
    assert abs(improved.parameters["viscous_1A.b"].value - 0.05) < 0.005
    assert "Viscous viscous_1A" in (out / "model.mo").read_text()
    told = capsys.readouterr()
    assert "Missing: viscous at 1A (p = 0.001 family-wise). b = 0.0" in told.out
    assert "noise floor" in told.out.lower() and "Took" in told.out
    assert told.out.splitlines()[-1].startswith("Results in study_improve: ") and told.err == ""


def test_identify_gives_parameters_with_intervals(log, here, capsys):
    run("identify", STUDY, "--data", log, "--out", "deep/er")
    found = read(here / "deep" / "er" / "parameters.json")
    check_parameters(found)
    assert set(found["parameters"]) == {f"s{s}.{p}" for s in ("1A", "2A", "1B", "2B") for p in ("f0", "mu")}
    assert "s1A.mu" in capsys.readouterr().out


@pytest.mark.long
def test_diagnose_prints_its_json_and_nothing_else(log, here, capsys):
    run("diagnose", STUDY, "--data", log, "--json")
    told = capsys.readouterr()
    found = json.loads(told.out)
    assert found == read(here / "study_diagnose" / "diagnosis.json") and told.err == ""
    check_diagnosis(found)
    best = found["candidates"][0]
    assert (best["effect"], best["place"], best["accepted"]) == ("viscous", "1A", True)
    check_errors(best["held_out_error"])


@pytest.mark.slow
@pytest.mark.long
def test_add_without_a_place_takes_the_best(log, here, capsys):
    run("add", STUDY, "viscous", "--data", log)
    assert "Added viscous at 1A, the best of" in capsys.readouterr().out
    out = here / "study_add"
    check_parameters(read(out / "parameters.json"))
    check_comparison(read(out / "comparison.json"))
    assert load_study(out / "study.toml").effects == [("viscous", "1A")]
    # what was added can be compared with data, and is not fitted anew in secret: both errors are told
    run("compare", out / "study.toml")
    found = read(here / "study_compare" / "comparison.json")
    check_comparison(found)
    assert math.isclose(found["error"]["C_H"], found["error_as_given"]["C_H"], rel_tol=1e-4)
    told = capsys.readouterr().out
    assert re.search(r"is worst where the \w+ \w* ?of \w+ is -?[\d.]+ to -?[\d.]+ (rad/s|N\.m) \(", told), told
    assert told.splitlines()[-1] == "Results in study_compare: comparison.json, figures/"


@pytest.mark.long
def test_add_at_a_place_says_when_the_data_do_not_ask_for_it(log, here, capsys):
    improved = STUDY.read_text() + '\n[[effects]]\neffect = "viscous"\nplace = "1A"\n'
    (here / "known.toml").write_text(improved)
    run("add", "known.toml", "torque_constant@motor2", "--data", log)
    assert "These data do not ask for it" in capsys.readouterr().out
    assert len(load_study(here / "known_add" / "study.toml").effects) == 2


@pytest.mark.long
def test_quiet_is_quiet(log, capsys):
    run("compare", STUDY, "--data", log, "--quiet")
    told = capsys.readouterr()
    assert told.out == "" and told.err == ""


@pytest.mark.parametrize("rig", [
    "HipKnee", pytest.param("DriveTrain.Rigs.HipKneeTransmission", marks=pytest.mark.long), "ScrewDrive",
    "ServoPendulum", "GearedJoint"])
def test_new_writes_a_study_that_loads_for_every_rig(rig, here, capsys):
    run("new", rig)
    path = here / f"{rig.rsplit('.', 1)[-1]}.toml"
    study = load_study(path)
    assert study.columns and any(s.fixed is False for s in study.parameters.values())
    before = path.read_text()
    assert main(["new", rig]) == 2 and path.read_text() == before  # never overwritten
    # what stands in its comments holds too: parameters, columns and effects, all of them taken in at once
    lines = [line.removeprefix("# ") for line in before.splitlines()]
    settings = [line for line in lines if re.match(r'"[\w.]+" = \{ value = ', line)]
    columns = [line for line in lines if re.match(r'"[\w.]+" = \{ variable = ', line) and '"current"' not in line]
    effects = re.findall(r"^#   (\w+): .*; at (.*)$", before, re.M)
    assert effects and all(places for _, places in effects)
    chosen = "\n".join(f'[[effects]]\neffect = "{e}"\nplace = "{p.split(", ")[0]}"' for e, p in effects)
    path.write_text("\n".join([f'[rig]\nmodel = "{study.rig}"', "[parameters]", *settings, "[columns]", *columns,
                               chosen]))
    model = load_study(path).validate(Library())
    for name, setting in load_study(path).parameters.items():
        assert math.isclose(setting.value, model.parameters[name].value), name  # the rig's defaults


def test_new_takes_logs(log, here):
    run("new", "HipKnee", "--data", log, "--si", "--out", "mine", "--quiet")
    assert load_study(here / "mine" / "HipKnee.toml").runs == [log]


def test_help_is_quick_and_every_verb_has_an_example(capsys):
    for verb in parser.VERBS:
        run(verb, "--help")
        assert f"example:\n  pycosim {verb}" in capsys.readouterr().out
    heavy = ("import sys, pycosim.cli; pycosim.cli.main(['--help']); "
             "print({'numpy', 'casadi', 'rich'} & set(sys.modules))")
    told = subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True, check=True,
                          env=ENVIRONMENT)
    assert told.stdout.endswith("set()\n")


def test_the_whole_help_has_an_example_and_tells_how_to_complete(capsys):
    run("--help")
    told = capsys.readouterr().out
    assert "example:\n  pycosim new" in told and "register-python-argcomplete pycosim" in told


@pytest.mark.parametrize("line, wanted", [("pycosim imp", "improve"), ("pycosim diagnose --q", "--quiet"),
                                          ("pycosim new Se", "ServoPendulum"), ("pycosim compare stu", "study.toml")])
def test_a_shell_completes_verbs_options_rigs_and_files(line, wanted, here):
    shutil.copy(STUDY, here / "study.toml")
    asked = {**ENVIRONMENT, "_ARGCOMPLETE": "1", "_ARGCOMPLETE_STDOUT_FILENAME": str(here / "answer"),
             "COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARGCOMPLETE_IFS": "\n"}
    subprocess.run([sys.executable, "-m", "pycosim.cli"], env=asked, check=True, cwd=here)
    assert [w.strip() for w in (here / "answer").read_text().split("\n")] == [wanted]


def test_version(capsys):
    run("--version")
    assert capsys.readouterr().out.startswith("pycosim ")


@pytest.mark.parametrize("arguments, told", [
    (["identfy", "study.toml"], "no verb 'identfy'; closest: 'identify'"),
    (["diagnose", "study.toml", "--jsn"], "unknown option '--jsn'; closest: '--json'"),
    (["diagnose"], "STUDY is missing"),
    (["diagnose", "--data", "a.csv", "study.toml"], "STUDY is missing; it comes before --data"),
    (["add", "study.toml"], "EFFECT[@PLACE] is missing"),
    (["demo", "--data", "a.csv"], "demo makes its own log"),
    (["new", "HipKne"], "no rig 'HipKne'; closest: 'HipKnee'"),
])
def test_a_wrong_command_line_is_one_sentence(arguments, told, capsys, here):
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert told in said.err and said.err.count("\n") == 1 and said.out == ""
    assert not list(here.iterdir())


# --- logs as users have them


def with_columns(*lines):
    """The example study with these lines instead of its columns."""
    return STUDY.read_text().split("[columns]")[0] + "[columns]\n" + "\n".join(lines) + "\n"


OTHER_UNITS = with_columns(
    'time = { variable = "time", unit = "ms" }', 'theta1 = { variable = "motor1.phi", unit = "deg", zero = 30.0 }',
    'theta2 = { variable = "motor2.phi", unit = "deg" }', 'omega1 = { variable = "motor1.w", unit = "rpm" }',
    'I1 = { variable = "motor1.tau", unit = "A", k_m = 0.146 }',
    'I2 = { variable = "motor2.tau", unit = "mA", k_m = 0.146 }',
    'C_H = { variable = "C_H", unit = "N.m" }', 'C_K = { variable = "C_K", unit = "mN.m" }')


@pytest.mark.parametrize("ending", cases(["csv", "parquet"], []))
def test_currents_degrees_and_milliseconds_give_the_same_parameters(ending, log, here):
    si = pd.read_csv(log)
    speed = np.gradient(si["theta1"], si["time"])
    other = pd.DataFrame({
        "time": 1e3 * si["time"], "theta1": np.degrees(si["theta1"]) + 30.0, "theta2": np.degrees(si["theta2"]),
        "omega1": speed * 60 / (2 * np.pi), "I1": si["tau1"] / 0.146, "I2": 1e3 * si["tau2"] / 0.146,
        "C_H": si["C_H"], "C_K": 1e3 * si["C_K"]})
    other.to_csv(here / "other.csv", index=False)
    other.to_parquet(here / "other.parquet")
    si.assign(omega1=speed).drop(columns="manoeuvre").to_csv(here / "si.csv", index=False)
    (here / "other.toml").write_text(OTHER_UNITS)
    run("identify", STUDY, "--data", "si.csv", "--out", "one", "--quiet")
    run("identify", "other.toml", "--data", f"other.{ending}", "--out", "two", "--quiet")
    one, two = (read(here / n / "parameters.json")["parameters"] for n in ("one", "two"))
    for name, p in one.items():
        assert math.isclose(p["value"], two[name]["value"], rel_tol=1e-5, abs_tol=1e-7)


@pytest.mark.long
@pytest.mark.slow
def test_irregular_samples_and_drop_outs_give_nearly_the_same_parameters(log, here):
    whole = pd.read_csv(log)
    keep = np.random.default_rng(4).random(len(whole)) > 0.2
    thinned = whole[keep].reset_index(drop=True)
    thinned.loc[200:210, "tau2"] = np.nan
    thinned.to_csv(here / "thinned.csv", index=False)
    (here / "study.toml").write_text(STUDY.read_text().replace("[data]", '[data]\ndrop_outs = "skip"'))
    run("add", STUDY, "viscous@1A", "--data", log, "--out", "whole", "--quiet")
    run("add", "study.toml", "viscous@1A", "--data", "thinned.csv", "--quiet")
    for name, p in read(here / "study_add" / "parameters.json")["parameters"].items():
        low, high = read(here / "whole" / "parameters.json")["parameters"][name]["ci95"]
        assert low - (high - low) <= p["value"] <= high + (high - low), name


@pytest.mark.long
def test_the_held_out_run_is_the_one_the_study_names(log, here):
    for k in (1, 2, 3):
        again = pd.read_csv(log)
        again[["tau1", "tau2"]] += 0.02 * np.random.default_rng(k).standard_normal((len(again), 2))
        again.to_csv(here / f"run{k}.csv", index=False)
    (here / "study.toml").write_text(STUDY.read_text().replace("runs = []", 'runs = ["run*.csv"]').replace(
        "held_out = []", 'held_out = ["run2.csv"]'))
    run("compare", "study.toml", "--quiet")
    by = read(here / "study_compare" / "comparison.json")["by"]
    assert set(by["run"]) == {"run1.csv", "run2.csv", "run3.csv"} and by["part"]["test"] == by["run"]["run2.csv"]


# --- the folder


def test_results_of_the_same_verb_are_replaced_whole_and_others_stay(here):
    def write(verb, *names):
        with Folder("out", verb) as folder:
            for name in names:
                folder.write(name, {"by": verb})
    write("identify", "parameters.json", "old.json")
    (here / "out" / "notes.txt").write_text("mine")
    write("compare", "comparison.json")
    write("identify", "parameters.json")
    assert sorted(p.name for p in (here / "out").iterdir()) == [
        ".pycosim", "comparison.json", "notes.txt", "parameters.json"]
    assert [p.name for p in here.iterdir()] == ["out"]


def test_a_failure_leaves_earlier_results_as_they_were(here):
    with Folder("out", "identify") as folder:
        folder.write("parameters.json", {"a": 1})
    with pytest.raises(RuntimeError), Folder("out", "identify") as folder:
        folder.write("parameters.json", {"a": 2})
        raise RuntimeError
    with pytest.raises(RuntimeError), Folder("not/there", "identify") as folder:
        raise RuntimeError
    assert read("out/parameters.json") == {"a": 1} and [p.name for p in here.iterdir()] == ["out"]


def test_an_interrupt_is_one_line_and_writes_nothing(log, here, monkeypatch, capsys):
    def stop(*_):
        raise KeyboardInterrupt
    monkeypatch.setitem(verbs.VERB, "identify", stop)
    assert main(["identify", str(STUDY), "--data", str(log)]) == 130
    assert capsys.readouterr().err.count("\n") == 1 and not list(here.iterdir())


def test_a_fault_of_ours_is_one_line_that_names_the_traceback(log, here, monkeypatch, capsys):
    def fail(*_):
        raise ZeroDivisionError("of ours")
    monkeypatch.setitem(verbs.VERB, "identify", fail)
    assert main(["identify", str(STUDY), "--data", str(log)]) == 1
    line = capsys.readouterr().err
    assert line.count("\n") == 1 and "ZeroDivisionError: of ours" in line
    report = Path(line.split()[-1])
    assert "Traceback" in report.read_text() and not list(here.iterdir())
    report.unlink()


def test_an_interrupt_between_the_renames_comes_too_late(here, monkeypatch):
    def interrupted(*names):
        os.kill(os.getpid(), signal.SIGINT)
        return rename(*names)
    rename = os.replace
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job is started without
    with Folder("out", "identify") as folder:
        folder.write("parameters.json", {"a": 1})
    with Folder("out", "identify") as folder:
        folder.write("parameters.json", {"a": 2})
        monkeypatch.setattr(folders.os, "replace", interrupted)
    assert read("out/parameters.json") == {"a": 2} and [p.name for p in here.iterdir()] == ["out"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_the_given_study_is_never_replaced(log, here, capsys):
    (here / "out").mkdir()
    shutil.copy(STUDY, here / "out" / "study.toml")
    (here / "out" / ".pycosim").write_text('{"improve": ["study.toml"]}')
    assert main(["improve", "out/study.toml", "--data", str(log), "--out", "out"]) == 2
    assert "never changed" in capsys.readouterr().err
    assert (here / "out" / "study.toml").read_text() == STUDY.read_text()


# --- numbers and null directions


def test_json_has_neither_nan_nor_infinity():
    assert records.plain({"a": np.float64("nan"), "b": [np.inf, np.int64(3)], "c": np.array([1.0, -np.inf])}) == {
        "a": None, "b": [None, 3], "c": [1.0, None]}


class _Fit:
    """A fit with a given null space: three parameters of two components, covariance of what is determined."""

    def __init__(self, null, parameters, covariance):
        from pycosim.core.units import Variable
        self.parameters, self.free = parameters, [n for n in parameters if n.endswith(".f0")]
        self.variables = {n: Variable(n, "N.m", min=0.0, max=1.0, nominal=0.05) for n in self.free}
        self.values = self.unbounded = np.array([parameters[n] for n in self.free])
        self.null_directions, self.covariance, self.dof = np.array(null), np.array(covariance), 1e4


@pytest.mark.parametrize("g, text", [
    (lambda m: 1.0, "a.f0 + b.f0"),
    (lambda m: m, "a.f0 a.mu + b.f0 b.mu"),
    (lambda m: 1 + m, "a.f0 (1 + a.mu) + b.f0 (1 + b.mu)"),
    (lambda m: 1 - m, "a.f0 (1 - a.mu) + b.f0 (1 - b.mu)"),
    (lambda m: 1 / m, "a.f0 / a.mu + b.f0 / b.mu"),
    (lambda m: m / (1 + m), "a.f0 a.mu / (1 + a.mu) + b.f0 b.mu / (1 + b.mu)"),
    (lambda m: m**3, "a.f0 + 1.2"),
])
def test_the_form_of_a_null_direction_is_found_from_its_vector(g, text):
    p = {"a.f0": 0.01, "b.f0": 0.02, "c.f0": 0.3, "a.mu": 0.85, "b.mu": 0.907}
    direction = np.array([g(p["b.mu"]), -g(p["a.mu"]), 0.0])
    known = np.array([g(p["a.mu"]), g(p["b.mu"]), 0.0])
    (found,) = nullspace.null_directions(_Fit([direction / 7], p, 1e-6 * np.outer(known, known)))
    assert found["text"].startswith(f"a.f0 and b.f0 only as {text}")
    ratio = found["coefficients"]["a.f0"] / found["coefficients"]["b.f0"]
    assert math.isclose(ratio, direction[0] / direction[1], rel_tol=1e-9)
    assert set(found["coefficients"]) == {"a.f0", "b.f0"}
    (sum_,) = found["determined"]
    assert sum_["ci95"][0] < sum_["value"] < sum_["ci95"][1]


def test_a_parameter_without_any_effect_is_said_to_have_none():
    p = {"a.f0": 0.01, "b.f0": 0.02}
    (found,) = nullspace.null_directions(_Fit([[1.0, 0.0]], p, np.eye(2) * 1e-6))
    assert found["text"] == "a.f0: these data say nothing about it"


def test_without_a_reference_the_split_of_the_distal_stages_is_reported(here, capsys):
    motion = six_manoeuvres(speeds=(1.6,), repeats=2, rate=50, longest_pass=5)
    write_csv(measure(PAPER, motion, rng=3, reference=None), here / "run.csv")
    run("identify", STUDY, "--data", "run.csv")
    found = read("study_identify/parameters.json")
    assert found["null_directions"][0]["text"].startswith(
        "s1B.f0 and s2B.f0 only as s1B.f0 (1 + s1B.mu) + s2B.f0 (1 + s2B.mu) = ")
    assert not found["parameters"]["s1B.f0"]["identifiable"] and found["parameters"]["s1A.f0"]["identifiable"]
    told = capsys.readouterr().out
    rows = [line for line in told.splitlines() if line.startswith(("s1B.f0", "s2B.f0"))]
    assert len(rows) == 2 and all("not determined by itself" in row for row in rows)


@pytest.mark.long
def test_output_closed_early_is_no_fault(log):
    command = f"{sys.executable} -m pycosim.cli compare {STUDY} --data {log} --json | head -c 1 > /dev/null"
    told = subprocess.run(command, shell=True, capture_output=True, text=True, env=ENVIRONMENT)
    assert told.stderr == ""

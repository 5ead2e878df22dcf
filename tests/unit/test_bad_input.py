"""Claims about bad input: every kind exits with 2 and one line that names the fault, and leaves nothing behind.

Data that are only poor are not bad input: they are read, and the results say what they cannot tell.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import io
from tiers import cases

import pycosim as pc
from benchmarks.hidden_effects.machine import PAPER, measure, six_manoeuvres
from pycosim.cli import batch
from pycosim.cli.entry import main

STUDY = (Path(__file__).parents[2] / "examples" / "hip_knee" / "study.toml").read_text()


@pytest.fixture(scope="module")
def whole():
    """A good log, as a frame."""
    motion = six_manoeuvres(speeds=(0.5, 1.6), repeats=1, rate=25, longest_pass=4)
    return measure(PAPER, motion, rng=3)


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def files(folder):
    return {p.relative_to(folder): p.read_bytes() if p.is_file() else None for p in folder.rglob("*")}


def refused(here, capsys, told, verb="identify", *more, study="study.toml", data=("log.csv",)):
    """A verb refuses: code 2, one line that holds `told`, nothing written."""
    before = files(here)
    code = main([verb, study, *more, *(["--data", *data] if data else [])])
    said = capsys.readouterr()
    assert (code, said.out) == (2, ""), said.err
    assert said.err.startswith("pycosim: ") and said.err.count("\n") == 1 and "Traceback" not in said.err
    assert told in said.err
    assert files(here) == before


def edited(frame, **columns):
    frame = frame.copy()
    for name, values in columns.items():
        frame[name] = values
    return frame


def with_cell(frame, column, row, value):
    frame = frame.copy()
    frame[column] = frame[column].astype(object)
    frame.loc[row, column] = value
    return frame


def swapped(time):
    time = time.to_numpy(copy=True)
    time[[40, 41]] = time[[41, 40]]
    return time


def repeated(time):
    time = time.to_numpy(copy=True)
    time[41] = time[40]
    return time


LOGS = {
    "a column missing": (lambda f: f.drop(columns="tau2"), "no column 'tau2'"),
    "no time": (lambda f: f.drop(columns="time"), "no column 'time'"),
    "a column of other case": (lambda f: f.rename(columns={"tau1": "Tau1"}), "no column 'tau1'; closest: 'Tau1'"),
    "none of the columns": (lambda f: f[["time"]].assign(x=1.0), "holds none of the study's columns"),
    "NaN": (lambda f: with_cell(f, "tau1", 7, np.nan), "row 9: column 'tau1' is empty, NaN or infinite"),
    "infinity": (lambda f: with_cell(f, "theta1", 7, "inf"), "row 9: column 'theta1' is empty, NaN or infinite"),
    "no number at all": (lambda f: edited(f, tau1=np.nan), "column 'tau1' holds no number at all"),
    "text": (lambda f: with_cell(f, "tau1", 7, "high"), "row 9, column 'tau1': 'high' is not a number"),
    "a decimal comma": (lambda f: with_cell(f, "tau1", 7, "0,5"), "use a decimal point"),
    "time backwards": (lambda f: edited(f, time=swapped(f["time"])), "time goes backwards"),
    "time repeated": (lambda f: edited(f, time=repeated(f["time"])), "row 43: time repeats"),
    "time in ms": (lambda f: edited(f, time=f["time"] * 1e6), "time must be in s"),
    "one row": (lambda f: f.head(1), "has one usable row"),
    "a few rows": (lambda f: f.iloc[100:104], "log.csv: 4 samples are too few for a derivative"),
    "a header alone": (lambda f: f.head(0), "has a header but no data rows"),
    "no torque": (lambda f: edited(f, tau1=0.0), "column 'tau1' is exactly zero throughout"),
    "no motion": (lambda f: edited(f, theta1=1.0, theta2=2.0), "nothing moves"),
    "motion of one motor alone": (lambda f: edited(f, theta2=2.0), "nothing moves"),
    "a speed in other units": (lambda f: edited(f, omega1=np.gradient(f["theta1"], f["time"]) * 9.549),
                               "check units and signs"),
}


@pytest.mark.parametrize("kind", LOGS)
def test_a_bad_log_is_refused(kind, whole, here, capsys):
    change, told = LOGS[kind]
    (here / "study.toml").write_text(STUDY)
    change(whole).to_csv(here / "log.csv", index=False)
    refused(here, capsys, told)


RAW = {
    "empty": (lambda t: b"", "the file is empty"),
    "binary": (lambda t: b"\x7fELF\0\0\1\2" * 50, "is a binary file, not text"),
    "other encoding": (lambda t: t.replace(b"rest", "\xe9t\xe9".encode("latin-1")), "is not UTF-8 text"),
    "a row cut short": (lambda t: t.rstrip(b"\n")[:-30], "the log ends within a row"),
    "a row too long": (lambda t: t.replace(b"\n", b",1\n", 5).replace(b",1\n", b"\n", 4), "row 5"),
    "semicolons": (lambda t: t.replace(b",", b";"), "separated by semicolons"),
    "a column twice": (lambda t: t.replace(b"tau2", b"tau1", 1), "column 'tau1' is there 2 times"),
}


@pytest.mark.parametrize("kind", RAW)
def test_a_broken_file_is_refused(kind, whole, here, capsys):
    change, told = RAW[kind]
    (here / "study.toml").write_text(STUDY)
    (here / "log.csv").write_bytes(change(whole.head(300).to_csv(index=False).encode()))
    refused(here, capsys, told)


def test_files_of_other_formats_that_are_cut_short_are_refused(whole, here, capsys):
    (here / "study.toml").write_text(STUDY)
    io.savemat(here / "log.mat", {c: whole[c].to_numpy() for c in ("time", "tau1")}, do_compression=True)
    (here / "log.mat").write_bytes((here / "log.mat").read_bytes()[:-60])
    refused(here, capsys, "log.mat: is not a MAT file, or is cut short", data=("log.mat",))
    pytest.importorskip("mcap")
    (here / "log.mcap").write_bytes(b"\x89MCAP0\r\n" + b"\x01\x20\0\0\0\0\0\0\0abc")
    refused(here, capsys, "log.mcap: is not an MCAP file, or is cut short", data=("log.mcap",))


def test_a_study_of_another_encoding_is_refused_in_words_and_a_byte_order_mark_is_read(whole, here, capsys):
    whole.to_csv(here / "log.csv", index=False)
    (here / "study.toml").write_text(STUDY, encoding="utf-16")
    refused(here, capsys, "study.toml: is not text in UTF-8 (byte 1)")
    (here / "study.toml").write_text(STUDY, encoding="utf-8-sig")
    refused(here, capsys, "closest: 'log.csv'", data=("logs.csv",))


def test_a_log_that_is_not_there_is_refused(here, capsys):
    (here / "study.toml").write_text(STUDY)
    refused(here, capsys, "no log", data=("gone.csv",))
    (here / "run.csv").write_text("time\n1\n")
    assert main(["identify", "study.toml", "--data", "nope.csv"]) == 2
    assert "closest" not in capsys.readouterr().err
    refused(here, capsys, "closest: 'run.csv'", data=("rum.csv",))
    refused(here, capsys, "is a folder", data=(".",))
    refused(here, capsys, "no logs to fit", data=())
    (here / "log.doc").write_text("time\n1\n")
    refused(here, capsys, "cannot tell the format", data=("log.doc",))
    refused(here, capsys, "is listed twice", data=("log.csv", "log.csv"))


def test_a_log_under_two_names_is_refused(whole, here, capsys):
    """In whatever digits; and of averaged logs, by what they are the means of."""
    (here / "study.toml").write_text(STUDY)
    whole.to_csv(here / "a.csv", index=False)
    whole.to_csv(here / "b.csv", index=False)
    refused(here, capsys, "hold the same as rows 2 to 201 of", data=("a.csv", "b.csv"))
    whole.assign(time=whole["time"] + 50).round(5).to_csv(here / "b.csv", index=False)
    refused(here, capsys, "data counted twice make the intervals too narrow", "check", data=("a.csv", "b.csv"))
    with pytest.raises(pc.PycosimError, match="table 2: rows .* hold the same as rows .* of table 1"):
        pc.open("study.toml", data=[whole, whole]).fit()
    (here / "study.toml").write_text(STUDY.replace("[data]", '[data]\naverage = "file"'))
    (here / "b.csv").write_bytes((here / "a.csv").read_bytes())
    refused(here, capsys, "b.csv: holds the same as", data=("a.csv", "b.csv"))


def test_logs_with_and_without_a_reference_are_not_mixed(whole, here, capsys):
    (here / "study.toml").write_text(STUDY)
    whole.to_csv(here / "with.csv", index=False)
    other = measure(PAPER, six_manoeuvres(speeds=(0.5, 1.6), repeats=1, rate=25, longest_pass=4), rng=4)
    other.drop(columns=["C_H", "C_K"]).to_csv(here / "without.csv", index=False)
    refused(here, capsys, "without.csv: no column 'C_H', which with.csv has", data=("with.csv", "without.csv"))


EFFECT = '\n[[effects]]\neffect = "{}"\nplace = "{}"\n'
STUDIES = {
    "not TOML": (lambda t: t.replace("[rig]", "[rig"), "not valid TOML"),
    "no rig": (lambda t: t.replace("[rig]", "[data2]", 1), "unknown table 'data2'"),
    "an unknown rig": (lambda t: t.replace("Rigs.HipKnee", "Rigs.HipKne"),
                       "no Modelica class 'DriveTrain.Rigs.HipKne'; closest: 'DriveTrain.Rigs.HipKnee'"),
    "a class that is no rig": (lambda t: t.replace("Rigs.HipKnee", "Components.Segment"),
                               "in DriveTrain.Components.Segment"),
    "an unknown key": (lambda t: t.replace("held_out", "heldout"), "unknown key 'heldout'; closest: 'held_out'"),
    "an unknown parameter": (lambda t: t.replace('"s1A.f0"', '"s1A.fo"'), "no parameter 's1A.fo'"),
    "an unknown variable": (lambda t: t.replace('"motor1.tau"', '"motor1.taw"'), "no variable 'motor1.taw'"),
    "an unknown unit": (lambda t: t.replace('"N.m" }', '"N.mm" }', 1), "unknown unit 'N.mm'"),
    "a unit that does not fit": (lambda t: t.replace('"motor1.tau", unit = "N.m"', '"motor1.tau", unit = "rad"'),
                                 "unit 'rad' does not fit a quantity in N.m"),
    "a value outside its bounds": (lambda t: t.replace("value = 0.05, min = 0.0, max = 1.0",
                                                       "value = 2.0, min = 0.0", 1), "outside the bounds of the rig"),
    "a value outside its own bounds": (lambda t: t.replace("value = 0.05", "value = 1.5", 1),
                                       "outside its own bounds"),
    "bounds that leave nothing to fit": (lambda t: t.replace("min = 0.0, max = 1.0", "min = 0.05, max = 0.05", 1),
                                         "is to be fitted, but its bounds leave 0.05 N.m alone"),
    "bounds upside down": (lambda t: t.replace("min = 0.0, max = 1.0", "min = 1.0, max = 0.0", 1), "is above max"),
    "an unknown effect": (lambda t: t + EFFECT.format("viscos", "1A"), "no effect 'viscos'; closest: 'viscous'"),
    "an unknown place": (lambda t: t + EFFECT.format("viscous", "3A"), "no place '3A' for 'viscous'"),
    "an effect twice": (lambda t: t + 2 * EFFECT.format("viscous", "1A"), "is listed twice"),
    "a log fitted and held out": (lambda t: t.replace("runs = []", 'runs = ["log.csv"]').replace(
        "held_out = []", 'held_out = ["log.csv"]'), "is in runs and in held_out"),
    "a variable read twice": (lambda t: t.replace('variable = "motor2.tau"', 'variable = "motor1.tau"'),
                              "already read from column 'tau1'"),
    "an unknown reference": (lambda t: t.replace('"unknown"', '"senser"', 1), "reference = 'senser' is unknown"),
    "a sensor that no log holds": (lambda t: t.replace('reference = "unknown"', 'reference = "sensor"').replace(
        "C_H = {", "hip = {").replace("C_K = {", "knee = {"), 'reference = "sensor", but no log holds C_H, C_K;'),
    "half of a sensor": (lambda t: t.replace('reference = "unknown"', 'reference = "sensor"').replace(
        "C_K = {", "knee = {"), 'reference = "sensor", but no log holds C_K, needed beside C_H;'),
    "nothing free": (lambda t: t.replace("fixed = false", "fixed = true"), "no parameter is free"),
    "a Modelica file that is not there": (lambda t: t.replace("[rig]", '[rig]\nmodelica = ["my.mo"]'), "my.mo"),
}


@pytest.mark.parametrize("kind", STUDIES)
def test_a_bad_study_is_refused(kind, whole, here, capsys):
    change, told = STUDIES[kind]
    (here / "study.toml").write_text(change(STUDY))
    whole.to_csv(here / "log.csv", index=False)
    data = () if kind == "a log fitted and held out" else ("log.csv",)
    refused(here, capsys, told, data=data)


@pytest.mark.parametrize("verb", cases(["check", "compare", "identify"], ["check"]))
def test_a_value_of_each_run_of_an_effect_that_is_not_there_is_refused(verb, whole, here, capsys):
    (here / "study.toml").write_text(STUDY + '\n[fit]\nown = ["payload@shank.m"]\n')
    whole.to_csv(here / "log.csv", index=False)
    refused(here, capsys, "[fit] own: 'payload@shank.m' is of an effect that the study does not have; add [[effects]] "
            'effect = "payload", place = "shank"', verb)
    (here / "study.toml").write_text(STUDY + EFFECT.format("payload", "shank") + '\n[fit]\nown = ["payload@shank.m"]\n')
    assert main([verb, "study.toml", "--data", "log.csv"]) == 0


@pytest.mark.long
def test_where_nothing_is_left_to_compare_it_is_said_why(whole, here, capsys):
    whole.to_csv(here / "log.csv", index=False)
    (here / "study.toml").write_text(STUDY.replace("[data]", "[data]\nleave_out = [[0, 5000]]"))
    refused(here, capsys, "study.toml: [data] leave_out covers every sample of log.csv, so that nothing is compared")
    (here / "study.toml").write_text(STUDY.replace("[data]", "[data]\nw_min = 500.0"))
    refused(here, capsys, "record motion, or lower [data] w_min in the study")


def test_the_check_refuses_what_no_other_verb_could_use(whole, here, capsys):
    (here / "study.toml").write_text(STUDY.replace('reference = "unknown"', 'reference = "sensor"'))
    whole.drop(columns="C_K").to_csv(here / "log.csv", index=False)
    refused(here, capsys, "no log holds C_K, needed beside C_H;", "check")
    whole.drop(columns=["theta2", "tau2"]).to_csv(here / "log.csv", index=False)
    refused(here, capsys, "no column 'theta2', which holds 'motor2.phi'", "check")


def test_a_broken_modelica_file_is_refused_with_its_line(whole, here, capsys):
    (here / "my.mo").write_text("model My\n  Real x;\nequation\n  x = = 1;\nend My;\n")
    (here / "study.toml").write_text(STUDY.replace("[rig]", '[rig]\nmodelica = ["my.mo"]'))
    whole.to_csv(here / "log.csv", index=False)
    refused(here, capsys, "my.mo:4")


def test_no_study_is_refused(here, capsys):
    (here / "study.toml").write_text(STUDY)
    refused(here, capsys, "closest: 'study.toml'", study="studi.toml")
    refused(here, capsys, "cannot be read as a study", study=".")


def test_a_log_in_the_place_of_a_study_is_told_as_that(whole, here, capsys):
    whole.to_csv(here / "run.csv", index=False)
    refused(here, capsys, "run.csv is a log, not a study; give it with --data", "improve", study="run.csv", data=())
    (here / "run.mat").write_bytes(b"\xff\xfe\x00")
    refused(here, capsys, "run.mat is a log, not a study", study="run.mat", data=())


def test_an_fmu_that_is_not_there_is_refused(whole, here, capsys):
    (here / "study.toml").write_text(STUDY)
    whole.to_csv(here / "log.csv", index=False)
    refused(here, capsys, "no FMU nope.fmu; name a file of FMI 2 or 3", "identify", "--fmu", "nope.fmu")


@pytest.mark.parametrize("effect, told", [
    ("viscos", "no effect 'viscos'; closest: 'viscous'"),
    ("viscous@4A", "no place '4A' for 'viscous'"),
    ("viscous@", "no place ''"),
    ("load_dependence@1A", "fix that one first"),
    ("stribeck@1A", "is in the model already"),
])
def test_an_effect_that_cannot_be_added_is_refused(effect, told, whole, here, capsys):
    (here / "study.toml").write_text(STUDY + EFFECT.format("stribeck", "1A"))
    whole.to_csv(here / "log.csv", index=False)
    refused(here, capsys, told, "add", effect)


def test_a_folder_that_is_not_ours_or_cannot_be_made_is_refused(whole, here, capsys):
    (here / "study.toml").write_text(STUDY)
    whole.to_csv(here / "log.csv", index=False)
    (here / "full").mkdir()
    (here / "full" / "thesis.tex").write_text("years of work")
    refused(here, capsys, "holds files that are not results of pycosim", "identify", "--out", "full")
    refused(here, capsys, "is a file", "identify", "--out", "log.csv")
    refused(here, capsys, "cannot be written", "identify", "--out", "log.csv/results")
    refused(here, capsys, "cannot be written", "identify", "--out", "/proc/pycosim/results")
    refused(here, capsys, "is the current folder", "identify", "--out", ".")


@pytest.mark.long
def test_drop_outs_are_refused_with_their_rows_or_left_out_when_the_study_says_so(whole, here, capsys):
    log = whole.copy()
    log.loc[[100, 101, 102, 300], "tau1"] = np.nan
    log.to_csv(here / "log.csv", index=False)
    (here / "study.toml").write_text(STUDY)
    refused(here, capsys, "row 102-104, 302: column 'tau1'")
    both = log.copy()
    both.loc[[7, 8], "theta2"] = np.inf
    both.to_csv(here / "both.csv", index=False)
    refused(here, capsys, "row 9-10: column 'theta2' is empty, NaN or infinite; so is 'tau1' in row 102-104, 302;",
            data=("both.csv",))
    (here / "study.toml").write_text(STUDY.replace("[data]", '[data]\ndrop_outs = "skip"'))
    assert main(["compare", "study.toml", "--data", "log.csv"]) == 0
    assert "log.csv: 4 rows left out." in capsys.readouterr().out
    found = json.loads((here / "study_compare" / "comparison.json").read_text())
    assert found["samples"]["left_out_rows"] == {"log.csv": [[102, 104], [302, 302]]}


@pytest.mark.parametrize("change", [
    pytest.param(lambda f: f.rename(columns={"C_H": "C_K", "C_K": "C_H"}), marks=pytest.mark.long),
    pytest.param(lambda f: edited(f, theta1=-f["theta1"]), marks=pytest.mark.long),
    pytest.param(lambda f: edited(f, tau1=1e3 * f["tau1"]), marks=pytest.mark.long),
], ids=["columns exchanged", "sign", "unit"])
def test_a_slip_that_no_check_can_prove_is_doubted(change, whole, here, capsys):
    (here / "study.toml").write_text(STUDY)
    change(whole).to_csv(here / "log.csv", index=False)
    assert main(["identify", "study.toml", "--data", "log.csv"]) == 0
    assert "Doubtful: the fitted model misses C_H" in capsys.readouterr().out
    whole.to_csv(here / "log.csv", index=False)
    assert main(["identify", "study.toml", "--data", "log.csv"]) == 0
    assert "Doubtful" not in capsys.readouterr().out


# --- poor, but honest


# rows to keep, motion, and what the results must say is not visible, with the reason where there is one for it
POOR = {
    "one direction": (["A"], {"speeds": (0.5, 1.6)}, "direction_asymmetry", "one direction only"),
    "one pass": (["A"], {"speeds": (1.6,)}, "direction_asymmetry", "one direction only"),
    "one speed": (["A", "B", "rest"], {"speeds": (1.6,), "repeats": 4}, "viscous", "one speed only"),
    "one load": (["A", "B", "rest"], {"speeds": (0.5, 1.6), "lines": (0.8,), "repeats": 4}, "load_nonlinearity", ""),
}


@pytest.mark.parametrize("steps", [0, 1])
def test_a_machine_that_stands_still_is_told_to_move_too_little(steps, whole, here, capsys):
    """Its encoders stay, or fall from one step to the next and back."""
    for n, name in enumerate(("theta1", "theta2")):
        whole = whole.assign(**{name: 0.3 + 1.534e-3 * steps * (np.arange(len(whole)) // (70 + n) % 2)})
    whole.to_csv(here / "log.csv", index=False)
    (here / "study.toml").write_text(STUDY)
    (here / "known.toml").write_text(STUDY.replace("runs = []", 'runs = ["log.csv"]'))
    refused(here, capsys, "not_enough_excitation")
    whole.assign(tau1=0.9 * whole.tau1).to_csv(here / "other.csv", index=False)
    refused(here, capsys, "not_enough_excitation", "diagnose", data=("log.csv", "other.csv"))
    row = batch.improve_one(str(here / "known.toml"), str(here / "row"), bare=True)
    assert (row["verdict"], row["failure"], row["added"]) == ("not_enough_excitation", "", "")
    assert main(["improve", "study.toml", "--data", "log.csv", "--out", "out", "--bare"]) == 0
    said = capsys.readouterr().out
    assert "not_enough_excitation: nothing moves" in said and "move too little to tell" in said
    found, final, ladder = (json.loads((here / "out" / f"{name}.json").read_text())
                            for name in ("diagnosis", "diagnosis_final", "ladder"))
    assert found == final and found["verdict"] == "not_enough_excitation" and found["candidates"] == []
    assert [step["added"] for step in ladder["steps"]] == [None]
    hidden = {(u["effect"], u["place"]): u["experiment"] for u in found["undetectable"]}
    assert "speed" in hidden["viscous", "1A"]


@pytest.mark.parametrize("kind", cases(POOR, [], ["one load"]))
def test_poor_data_are_read_and_the_results_say_what_they_cannot_tell(kind, here, capsys):
    labels, options, hidden, why = POOR[kind]
    log = measure(PAPER, six_manoeuvres(**{"repeats": 1, "rate": 50, "longest_pass": 4, **options}), rng=3)
    log[log["manoeuvre"].isin(labels)].to_csv(here / "log.csv", index=False)
    (here / "study.toml").write_text(STUDY)
    assert main(["identify", "study.toml", "--data", "log.csv"]) == 0
    assert main(["diagnose", "study.toml", "--data", "log.csv"]) == 0
    told = capsys.readouterr()
    assert told.err == "" and "Not visible (" in told.out
    found = json.loads((here / "study_diagnose" / "diagnosis.json").read_text())
    entries = [u for u in found["undetectable"] if u["effect"] == hidden]
    assert entries and all(why in u["why"] and u["experiment"] for u in entries)

"""Claims about studies: what is read is what is written, and every slip is named with its place and a way out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pycosim.compile.parse import Library
from pycosim.core.errors import BoundsError, StudyError, UnknownNameError
from pycosim.study.layout import PLAIN, Layout
from pycosim.study.parse import load_study
from pycosim.study.schema import Column, Setting
from pycosim.study.write import write_study

RIG = '[rig]\nmodel = "DriveTrain.Rigs.HipKnee"\n'
FULL = RIG + """
[parameters]
"s1A.f0" = { value = 0.05, min = 0.0, max = 1.0, fixed = false }
s1B.mu = { value = 0.97 }

[data]
runs = ["run1.csv", "more/run2.csv"]
held_out = ["run3.csv"]
reference = "sensor"
label = "phase"
w_min = 0.03
seed = 7
drop_outs = "skip"
most = 50_000
rate = 500
time = [1, 30.5]
leave_out = [[3, 3.5], ["run3.csv", 7.0, 8.0]]
header = true
separator = ";"
decimal = ","
encoding = "utf-16"
preamble = 3
units_row = true
accept = ["sign"]
rejected = ["torque_offset@motor1", "stribeck"]

[fit]
robust = true

[columns]
theta1 = { variable = "motor1.phi", unit = "deg", zero = 2 }
theta2 = { variable = "motor2.phi", unit = "rad", gain = 0.001, offset = -0.5, sign = -1 }
i1 = { variable = "motor1.tau", unit = "mA", k_m = 0.11 }

[[effects]]
effect = "viscous"
place = "1A+2A"
"""


@pytest.fixture(scope="module")
def library():
    return Library()


@pytest.fixture
def study(tmp_path):
    """Write a study's text and load it."""
    def make(text):
        (tmp_path / "study.toml").write_text(text, encoding="utf-8")
        return load_study(tmp_path / "study.toml")
    return make


def test_a_study_is_read_whole(study, tmp_path):
    found = study(FULL)
    assert found.rig == "DriveTrain.Rigs.HipKnee"
    assert found.parameters == {"s1A.f0": Setting(0.05, 0.0, 1.0, False), "s1B.mu": Setting(0.97)}
    assert found.runs == [tmp_path / "run1.csv", tmp_path / "more/run2.csv"]
    assert found.held_out == [tmp_path / "run3.csv"]
    assert (found.reference, found.labels, found.w_min, found.seed) == ("sensor", "phase", 0.03, 7)
    assert (found.drop_outs, found.most) == ("skip", 50_000)
    assert found.columns["i1"] == Column("motor1.tau", "mA", 0.11)
    assert found.effects == [("viscous", "1A+2A")]
    assert (found.rate, found.time, found.header, found.robust) == (500.0, (1.0, 30.5), True, True)
    assert found.leave_out == [[3.0, 3.5], ["run3.csv", 7.0, 8.0]]
    assert found.layout == Layout(True, ";", ",", "utf-16", 3, True)
    assert (found.accept, found.rejected) == (["sign"], ["torque_offset@motor1", "stribeck"])
    assert found.columns["theta2"] == Column("motor2.phi", "rad", gain=0.001, offset=-0.5, sign=-1)


def test_the_least_study_has_the_contracts_defaults(study):
    found = study(RIG)
    assert (found.reference, found.labels, found.time_column, found.seed) == ("unknown", "manoeuvre", "time", 0)
    assert (found.runs, found.w_min, found.drop_outs, found.average, found.reader) == ([], None, "refuse", None, None)
    assert found.most == 2_000_000
    assert (found.rate, found.time, found.header, found.accept, found.rejected) == (None, None, True, [], [])
    assert found.layout == PLAIN
    assert not found.robust


def test_a_column_becomes_si_with_its_zero_and_torque_constant(study):
    columns = study(FULL).columns
    assert columns["theta1"].si(182.0) == pytest.approx(3.14159265)
    assert columns["i1"].si(2000.0) == pytest.approx(0.22)
    assert columns["theta2"].si(np.array([0.0, 2000.0])) == pytest.approx([0.5, -1.5])  # -(0.001 x - 0.5)
    assert Column("motor1.phi", "deg", zero=10, gain=2, offset=3, sign=-1).si(100.0) == pytest.approx(-np.deg2rad(183))
    assert Column("motor1.tau", "A", k_m=0.2, gain=0.5).si(8.0) == pytest.approx(0.8)
    assert columns["i1"].dimension == "N.m"


def test_a_written_study_is_the_same_study(study, tmp_path):
    first = study(FULL)
    other = tmp_path / "elsewhere"
    other.mkdir()
    again = load_study(write_study(first, other / "study.toml"))
    assert {**vars(again), "path": 0} == {**vars(first), "path": 0}
    text = (other / "study.toml").read_text()
    assert '"../run1.csv"' in text and "#" not in text
    assert [p.name for p in other.iterdir()] == ["study.toml"]


COMMENTED = """# the machine in the cellar
seed = 3                     # as ever

[rig]
model = "DriveTrain.Rigs.HipKnee"   # the old one

[parameters]
# from the data sheet
"s1A.f0" = { value = 0.05, min = 0.0, max = 1.0, fixed = false }  # N.m
s1B.mu = { value = 0.97 }            # [1]
s2B.mu = { value = 0.96 }

[data]
runs = ["a.csv",             # Monday
        "b.csv"]
w_min = 0.05
"""


def test_what_is_written_into_a_study_leaves_its_comments_and_order(study, tmp_path):
    first = study(COMMENTED)
    parameters = {**first.parameters, "s1A.f0": replace(first.parameters["s1A.f0"], value=0.07),
                  "s1B.mu": Setting(0.9, fixed=False), "s2A.f0": Setting(0.1)}
    del parameters["s2B.mu"]
    changed = replace(first, parameters=parameters, effects=[("viscous", "1A")], w_min=None, seed=4, robust=True)
    path = write_study(changed, tmp_path / "improved.toml")
    again, text = load_study(path), path.read_text()
    assert {**vars(again), "path": 0} == {**vars(changed), "path": 0}
    for kept in ("# the machine in the cellar", "seed = 4", "# as ever", "# the old one", "# from the data sheet",
                 "# N.m", "# [1]", '"a.csv",             # Monday\n        "b.csv"]'):
        assert kept in text, text
    assert "w_min" not in text and "s2B" not in text
    more = replace(again, effects=[*again.effects, ("stribeck", "2A")])
    assert load_study(write_study(more, path)).effects == more.effects
    assert load_study(write_study(replace(more, effects=[("stribeck", "2A")]), path)).effects == [("stribeck", "2A")]
    assert load_study(write_study(replace(more, effects=[]), path)).effects == []


def test_a_study_that_nothing_changed_is_written_as_it_was(study, tmp_path):
    assert write_study(study(COMMENTED), tmp_path / "again.toml").read_text() == COMMENTED


@pytest.mark.parametrize("name", ['quo"te', "back\\slash", "tab\t", "ünï", "a.b", "line\nbreak", "\x7f"])
def test_awkward_column_names_survive_writing(study, tmp_path, name):
    first = study(RIG)
    first.columns[name] = Column("motor1.phi", "rad")
    assert list(load_study(write_study(first, tmp_path / "b.toml")).columns) == [name]


def test_top_level_w_min_and_seed_mean_the_same_as_in_data(study):
    found = study("w_min = 0.1\nseed = 3\n" + RIG)
    assert (found.w_min, found.seed) == (0.1, 3)


def test_a_pattern_stands_for_the_files_it_matches(study, tmp_path):
    for name in ("b.csv", "a.csv"):
        (tmp_path / name).write_text("x")
    assert [p.name for p in study(RIG + '[data]\nruns = ["*.csv"]').runs] == ["a.csv", "b.csv"]


def test_given_data_replaces_the_runs_and_keeps_held_out_files_held_out(study, tmp_path):
    found = study(FULL).with_data([tmp_path / "x.csv", tmp_path / "run3.csv"])
    assert (found.runs, found.held_out) == ([tmp_path / "x.csv"], [tmp_path / "run3.csv"])
    assert study(FULL).with_data([tmp_path / "run3.csv"]).runs == [tmp_path / "run3.csv"]
    with pytest.raises(StudyError, match="x.csv is listed twice"):
        study(FULL).with_data(["x.csv", "x.csv"])


BROKEN = {
    "negative seed": (RIG + "[data]\nseed = -5", ["seed = -5 must not be negative", "study.toml:4"]),
    "no rig": ("[data]\nruns = []", ["no [rig]"]),
    "no model": ("[rig]\nmodelica = []", ["model is missing"]),
    "broken toml": ("[rig]\nmodel = \n", ["not valid TOML", "line 2"]),
    "unknown table": (RIG + "[parameter]\n", ["unknown table 'parameter'", "closest: 'parameters'", "study.toml:3"]),
    "unknown key": (RIG + '[data]\nrun = ["a.csv"]',
                    ["[data]", "unknown key 'run'", "closest: 'runs'", "study.toml:4"]),
    "unknown rig key": ('[rig]\nmodle = "x"', ["[rig]", "'modle'", "closest: 'model'"]),
    "wrong type": (RIG + '[data]\nruns = "a.csv"', ["runs must be a list", '"a.csv"']),
    "wrong item": (RIG + "[data]\nruns = [1]", ["runs must be a list of file names", "1"]),
    "a truth is no number": (RIG + '[parameters]\n"s1A.f0" = { value = true }', ["'s1A.f0'", "finite number", "true"]),
    "nan": (RIG + '[parameters]\n"s1A.f0" = { value = nan }', ["'s1A.f0'", "finite number", "nan"]),
    "bare number": (RIG + '[parameters]\n"s1A.f0" = 0.05', ["'s1A.f0'", "{ value = 0.05 }"]),
    "unknown setting": (RIG + '[parameters]\n"s1A.f0" = { vlaue = 1 }',
                        ["'vlaue'", "closest: 'value'", "study.toml:4"]),
    "unknown unit": (RIG + '[columns]\na = { variable = "motor1.phi", unit = "rda" }',
                     ["'a'", "unit 'rda'", "closest: 'rad'"]),
    "no unit": (RIG + '[columns]\na = { variable = "motor1.phi" }', ["'a'", "no unit"]),
    "k_m without current": (RIG + '[columns]\na = { variable = "motor1.tau", unit = "N.m", k_m = 1 }',
                            ["k_m", "'N.m'", "mA"]),
    "k_m zero": (RIG + '[columns]\na = { variable = "motor1.tau", unit = "A", k_m = 0 }', ["k_m = 0"]),
    "two columns for one variable": (
        RIG + '[columns]\na = { variable = "motor1.phi", unit = "rad" }\nb = { variable = "motor1.phi", unit = "deg" }',
        ["'b'", "'motor1.phi'", "column 'a'"]),
    "time as a signal": (RIG + '[columns]\ntime = { variable = "motor1.phi", unit = "rad" }',
                         ["'time'", "time_column"]),
    "label as a signal": (RIG + '[columns]\nmanoeuvre = { variable = "q_H", unit = "rad" }', ["label column"]),
    "held out and fitted": (RIG + '[data]\nruns = ["a.csv"]\nheld_out = ["./a.csv"]',
                            ["a.csv", "runs and in held_out"]),
    "twice": (RIG + '[data]\nruns = ["a.csv", "a.csv"]', ["a.csv", "listed twice"]),
    "no match": (RIG + '[data]\nruns = ["*.nothing"]', ["no file matches '*.nothing'"]),
    "unknown reference": (RIG + '[data]\nreference = "sensr"',
                          ["reference = 'sensr'", "sensor, gravity_model, unknown"]),
    "unknown drop_outs": (RIG + '[data]\ndrop_outs = "fill"', ["drop_outs = 'fill'", "refuse, skip"]),
    "unknown reader": (RIG + '[data]\nreader = "xls"', ["reader = 'xls'", "bam, epos"]),
    "w_min not positive": (RIG + "[data]\nw_min = 0.0", ["w_min = 0", "above zero"]),
    "most too small": (RIG + "[data]\nmost = 0", ["most = 0 rows", "100 at least"]),
    "most not whole": (RIG + "[data]\nmost = 2e6", ["most must be an integer"]),
    "seed twice": ("seed = 1\n" + RIG + "[data]\nseed = 2", ["seed is given twice"]),
    "rate not positive": (RIG + "[data]\nrate = 0", ["rate = 0 Hz", "above zero"]),
    "rate and time": (RIG + '[data]\nrate = 9\ntime_column = "t"', ["rate", "time_column", "keep one"]),
    "no time at all": (RIG + '[data]\ntime_column = ""', ['time_column = ""', "add rate", "study.toml:4"]),
    "rate and a column of time": (RIG + '[data]\nrate = 9\n[columns]\nt = { variable = "time", unit = "s" }',
                                  ["'t'", "rate", "keep one"]),
    "time not a span": (RIG + "[data]\ntime = [3.0]", ["time must be [first, last]", "[3.0]"]),
    "time span backwards": (RIG + "[data]\ntime = [3, 1]", ["time must be [first, last]", "[3, 1]"]),
    "left out backwards": (RIG + "[data]\nleave_out = [[3, 1]]", ["leave_out", "[first, last]", "[3, 1]"]),
    "left out no span": (RIG + "[data]\nleave_out = [3, 4]", ["leave_out", "[first, last]", "3"]),
    "left out of no log": (RIG + '[data]\nruns = ["run1.csv"]\nleave_out = [["run.csv", 1, 2]]',
                           ["leave_out", "'run.csv'", "closest: 'run1.csv'"]),
    "left out of a mean": (RIG + '[data]\naverage = "file"\nleave_out = [[1, 2]]', ["leave_out", "average", "time ="]),
    "header not a truth": (RIG + '[data]\nheader = "no"', ["header must be true or false"]),
    "no header of another format": (RIG + '[data]\nheader = false\nreader = "bam"', ["header = false", "bam"]),
    "unknown encoding": (RIG + '[data]\nencoding = "utf16"', ["encoding = 'utf16'", "utf-16"]),
    "a key of [data] elsewhere": (RIG + "[fit]\nw_min = 0.1", ["unknown key 'w_min'; it belongs under [data]"]),
    "a key of [fit] elsewhere": (RIG + "[data]\nrobust = true", ["unknown key 'robust'; it belongs under [fit]"]),
    "a column twice": (RIG + '[columns]\na = { variable = "C_H", unit = "N.m" }\na = { variable = "C_K" }',
                       ["study.toml:5: a is given twice; keep one of the two"]),
    "a table twice": (RIG + "[data]\n[fit]\n[data]\n", ["study.toml:5: [data] is given twice; put all its keys under"]),
    "preamble": (RIG + "[data]\npreamble = -1", ["preamble = -1"]),
    "units of no header": (RIG + "[data]\nheader = false\nunits_row = true", ["units_row", "preamble"]),
    "accept not texts": (RIG + "[data]\naccept = [1]", ["accept must be a list of texts", "1"]),
    "accept no kind": (RIG + '[data]\naccept = ["sgin"]', ["accept", "'sgin'", "closest: 'sign'", "study.toml:4"]),
    "rejected and there": (RIG + '[data]\nrejected = ["viscous@1A"]\n'
                           '[[effects]]\neffect = "viscous"\nplace = "1A"',
                           ["rejected", "'viscous' at '1A'", "[[effects]]"]),
    "gain zero": (RIG + '[columns]\na = { variable = "motor1.phi", unit = "rad", gain = 0 }', ["'a'", "gain = 0"]),
    "sign of two": (RIG + '[columns]\na = { variable = "motor1.phi", unit = "rad", sign = 2 }',
                    ["'a'", "sign = 2", "1 or -1"]),
    "unknown key of fit": (RIG + "[fit]\nrobustt = true", ["[fit]", "'robustt'", "closest: 'robust'"]),
    "effect twice": (RIG + 2 * '[[effects]]\neffect = "viscous"\nplace = "1A"\n',
                     ["no. 2", "'viscous' at '1A'", "twice"]),
    "effect without place": (RIG + '[[effects]]\neffect = "viscous"\n', ["no. 1", "place is missing"]),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_study_is_refused_with_place_and_remedy(study, case):
    text, words = BROKEN[case]
    with pytest.raises(StudyError) as caught:
        study(text)
    assert "study.toml" in str(caught.value) and "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("text, words", [
    ("{ value = 2.0, max = 1.0 }", ["value 2", "-inf to 1"]),
    ("{ min = 2.0, max = 1.0 }", ["min 2 is above max 1"]),
])
def test_a_value_outside_its_own_bounds_is_refused(study, text, words):
    with pytest.raises(BoundsError) as caught:
        study(RIG + f'[parameters]\n"s1A.f0" = {text}')
    assert all(w in str(caught.value) for w in ["'s1A.f0'", "study.toml:4", *words])


def test_a_missing_study_names_the_nearest_file(tmp_path):
    (tmp_path / "study.toml").write_text(RIG)
    with pytest.raises(StudyError, match=r"no study .*stduy.toml; closest: 'study.toml'"):
        load_study(tmp_path / "stduy.toml")
    with pytest.raises(StudyError, match="cannot be read as a study"):
        load_study(tmp_path)


def test_a_study_that_fits_its_rig_passes(study, library):
    assert study(FULL).validate(library).attached[0][1].name == "1A+2A"


COLUMN = RIG + '[columns]\na = {{ variable = "{}", unit = "{}" }}'
UNFIT = {
    "rig": ('[rig]\nmodel = "DriveTrain.Rigs.HipKne"', UnknownNameError, ["'DriveTrain.Rigs.HipKne'", "HipKnee'"]),
    "parameter": (RIG + '[parameters]\n"s1A.fo" = { value = 1.0 }', UnknownNameError,
                  ["no parameter 's1A.fo' in DriveTrain.Rigs.HipKnee", "closest: 's1A.f0'"]),
    "bounds": (RIG + '[parameters]\n"s1A.f0" = { value = 2.0 }', BoundsError,
               ["value 2 N.m", "'s1A.f0'", "0 to 1 N.m"]),
    "min above the rig's max": (RIG + '[parameters]\n"s1A.f0" = { value = 2.0, min = 2.0 }', BoundsError,
                                ["'s1A.f0'", "give both min and max"]),
    "rejected effect": (RIG + '[data]\nrejected = ["torqe_offset@motor1"]', UnknownNameError,
                        ["'torqe_offset'", "closest: 'torque_offset'"]),
    "rejected place": (RIG + '[data]\nrejected = ["torque_offset@motor3"]', UnknownNameError,
                       ["'motor3'", "closest: 'motor"]),
    "default": (RIG + '[parameters]\n"s1A.f0" = { min = 0.5 }', BoundsError, ["default 0.05 N.m", "0.5"]),
    "effect": (RIG + '[[effects]]\neffect = "viscos"\nplace = "1A"', UnknownNameError,
               ["'viscos'", "closest: 'viscous'"]),
    "place": (RIG + '[[effects]]\neffect = "viscous"\nplace = "1a"', UnknownNameError, ["'1a'", "closest: '1A'"]),
    "variable": (COLUMN.format("motor1.pih", "rad"), UnknownNameError,
                 ["column 'a'", "'motor1.pih'", "closest: 'motor1.phi'"]),
    "dimension": (COLUMN.format("motor1.tau", "rad"), UnknownNameError, ["column 'a'", "unit 'rad'", "N.m"]),
    "a current without k_m": (COLUMN.format("motor1.tau", "A"), UnknownNameError,
                              ["column 'a'", "k_m in N.m/A", 'unit = "A", k_m = 0.1 }']),
    "limit": (RIG + '[limits]\n"motor1.ww" = { max = 2.0 }', UnknownNameError,
              ["[limits] 'motor1.ww'", "closest: 'motor1.w'"]),
    "limit of a torque": (RIG + '[limits]\n"motor1.tao" = { max = 2.0 }', UnknownNameError,
                          ["'motor1.tao'", "closest: 'motor1.tau'"]),
    "limit of a sum": (RIG + '[limits]\n"q_H + q_T" = { max = 2.0 }', UnknownNameError,
                       ["[limits] 'q_H + q_T'", "no variable 'q_T'", "closest: 'q_"]),
    "k_m on an angle": (RIG + '[columns]\na = { variable = "motor1.phi", unit = "A", k_m = 1 }', StudyError,
                        ["'a'", "k_m"]),
}


@pytest.mark.parametrize("case", UNFIT)
def test_a_study_that_does_not_fit_its_rig_is_refused(study, library, case):
    text, kind, words = UNFIT[case]
    with pytest.raises(kind) as caught:
        study(text).validate(library)
    assert all(w in str(caught.value) for w in ["study.toml", *words])


def test_a_study_may_widen_the_bounds_of_its_rig_and_the_scale_follows(study, library):
    found = study(RIG + '[parameters]\n"s1A.f0" = { value = 10, min = -5, max = 20, fixed = false }')
    usual = found.validate(library).parameters["s1A.f0"]
    wide = found.parameters["s1A.f0"].applied(usual)
    assert (wide.value, wide.min, wide.max) == (10.0, -5.0, 20.0)
    assert wide.nominal == pytest.approx(usual.nominal * 20.0 / usual.max)
    assert Setting(0.1, 0.0, 0.5).applied(usual).nominal == usual.nominal


def test_limits_may_be_of_sums_with_factors_and_of_what_motors_do(study, library):
    limits = '"0.5 * motor1.phi - q_K" = { max = 2.0 }\n"q_H + q_K" = { min = -1 }\n"motor1.a" = { max = 8 }'
    study(f"{RIG}[limits]\n{limits}").validate(library)


def test_the_temperature_may_be_logged_for_any_rig(study, library):
    study(COLUMN.format("temperature", "degC")).validate(library)


def test_a_column_called_time_may_give_the_unit_of_time(study):
    assert study(RIG + '[columns]\ntime = { variable = "time", unit = "ms" }').columns["time"].si(500.0) == 0.5


def test_paths_start_at_the_study_not_at_the_working_folder(study, tmp_path, monkeypatch):
    monkeypatch.chdir(Path("/"))
    assert study(RIG + '[data]\nruns = ["../x.csv"]').runs == [tmp_path.parent / "x.csv"]


@pytest.mark.parametrize("own, error, message", [
    ('["zero_Q"]', UnknownNameError, "own: no parameter 'zero_Q' in .*closest: 'zero_"),
    ('["payload@shank.k"]', UnknownNameError, "'payload@shank.k' names no coefficient .*; write payload@PLACE.m"),
    ('["payload@motor1.m"]', UnknownNameError, "no place 'motor1' for 'payload'"),
    ('["zero_H", "zero_H"]', StudyError, "own lists 'zero_H' twice"),
    ('[1]', StudyError, "own must be a list of texts")])
def test_own_values_of_what_does_not_exist_are_refused_with_the_nearest(tmp_path, own, error, message):
    path = tmp_path / "s.toml"
    path.write_text(f'[rig]\nmodel = "DriveTrain.Rigs.HipKnee"\n[fit]\nown = {own}\n')
    with pytest.raises(error, match=message):
        load_study(path).validate(Library())


def test_own_values_survive_writing(tmp_path):
    path = tmp_path / "s.toml"
    path.write_text('[rig]\nmodel = "DriveTrain.Rigs.HipKnee"\n[fit]\nown = ["zero_H", "payload@shank.m"]  # days\n')
    study = load_study(path)
    assert study.own_parameters(Library()) == ["zero_H", "payload_shank.m"]
    assert load_study(write_study(study, tmp_path / "t.toml")).own == study.own

"""Claims about logs nobody has described: layout and columns are found or asked, never assumed; a study comes out."""

import io
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pycosim.cli import mapping
from pycosim.cli.entry import main
from pycosim.compile import Library, compile_model
from pycosim.core.errors import DataError, UnknownNameError
from pycosim.data.likeness import likeness, stated
from pycosim.data.logs import load
from pycosim.data.proposal import NOT_THERE, Given, answered, propose, rig_of, sampled
from pycosim.data.readers.look import Look, look
from pycosim.study.layout import Layout
from pycosim.study.parse import load_study

HIP_KNEE, JOINT = "DriveTrain.Rigs.HipKnee", "DriveTrain.Rigs.GearedJoint"


@pytest.fixture(scope="module")
def models():
    library = Library()
    return {rig: compile_model(library, rig) for rig in (HIP_KNEE, JOINT)}


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def frame(n=300, **columns):
    """A joint that swings, with its motor's angle and torque, and what a sensor reads."""
    t = np.arange(n) * 0.002
    return pd.DataFrame({"time [s]": t, "motor_angle [rad]": np.sin(40 * t), "motor_torque [Nm]": 1 + np.cos(40 * t),
                         "load_torque [Nm]": 3 + np.cos(40 * t), **columns})


def bare(**columns):
    """The same without units."""
    return frame().set_axis(["time", "motor_angle", "motor_torque", "load_torque"], axis=1).assign(**columns)


def text(source=None, **options):
    return (frame() if source is None else source).to_csv(index=False, **options)


def write(content, name="log.csv"):
    with open(name, "wb") as stream:
        stream.write(content if isinstance(content, bytes) else content.encode())
    return name


NAMES = ["time [s]", "motor_angle [rad]", "motor_torque [Nm]", "load_torque [Nm]"]
ODD = {  # what an export of a recorder may look like, and the layout that reads it
    "plain": (text(), Layout()),
    "semicolons": (text(sep=";"), Layout(separator=";")),
    "decimal commas": (text(sep=";", decimal=","), Layout(separator=";", decimal=",")),
    "tabs": (text(sep="\t"), Layout(separator="\t")),
    "bars": (text(sep="|"), Layout(separator="|")),
    "UTF-16 with its mark": (text(sep="\t").encode("utf-16"), Layout(separator="\t", encoding="utf-16")),
    "UTF-16 without one": (text().encode("utf-16-le"), Layout(encoding="utf-16-le")),
    "UTF-16, the other way": (text().encode("utf-16-be"), Layout(encoding="utf-16-be")),
    "UTF-8 with a mark": (text().encode("utf-8-sig"), Layout()),
    "Windows' letters": (text().replace("[rad]", "[°]").encode("cp1252"), Layout(encoding="cp1252")),
    "a preamble": ("Recorder 7\nSerial; 12, of May\n\n" + text(), Layout(preamble=3)),
    "units below": (text(bare()).replace("\n", "\ns,rad,Nm,Nm\n", 1), Layout(units_row=True)),
    "all at once": (("Recorder 7\n\n" + text(bare(), sep=";", decimal=",").replace("\n", "\n[s];[rad];[Nm];[Nm]\n", 1)
                     ).encode("utf-16"), Layout(True, ";", ",", "utf-16", 2, True)),
    "no names": (text(header=False), Layout(header=False)),
    "no names below a preamble": ("made by hand\n" + text(header=False), Layout(header=False, preamble=1)),
    "carriage returns": (text().replace("\n", "\r\n"), Layout()),
    "whole numbers": (text(frame().round().astype(int).assign(**{"time [s]": range(300)}), sep=";"),
                      Layout(separator=";")),
    "a word in each row": (text(frame().assign(phase="up")), Layout()),
    "drop-outs": (text(frame().mask(np.arange(300)[:, None] % 40 == np.arange(4))), Layout()),
}


@pytest.mark.parametrize("kind", ODD)
def test_the_layout_of_a_file_is_found_and_reads_it(kind, models):
    content, layout = ODD[kind]
    seen = look(write(content))
    assert seen.layout == layout
    sample = sampled("log.csv")
    assert sample.rows == 300
    if "names" not in kind and kind not in ("whole numbers", "drop-outs"):
        np.testing.assert_allclose(sample.columns[seen.header[1]], frame()["motor_angle [rad]"], atol=1e-9)


@pytest.mark.parametrize("kind", [k for k in ODD if k not in ("whole numbers", "drop-outs")])
def test_new_writes_a_study_that_reads_the_file(kind, capsys):
    write(ODD[kind][0])
    said = (["--map", "1=time:s", "2=motor.phi:rad", "3=motor.tau:N.m", "4=C:N.m"] if "no names" in kind else
            ["--map", "load_torque=C:N.m"] if "units" in kind or "all" in kind else ["--map", "load_torque [Nm]=C"])
    assert main(["new", "GearedJoint", "--data", "log.csv", *said]) == 0
    said = capsys.readouterr().out
    assert "Written: GearedJoint.toml. Next: pycosim check GearedJoint.toml" in said
    assert "A picture of each column: GearedJoint_columns.png" in said and Path("GearedJoint_columns.png").is_file()
    log, = load(load_study("GearedJoint.toml"))
    assert set(log.signals) == {"motor.phi", "motor.tau", "C"}
    factor = np.pi / 180 if "Windows" in kind else 1
    np.testing.assert_allclose(log.signals["motor.phi"], factor * frame()["motor_angle [rad]"], atol=1e-9)
    np.testing.assert_allclose(log.time, frame()["time [s]"], atol=1e-9)


def test_what_holds_no_table_is_refused():
    for content, told in ((b"\x7fELF\0\0\1\2" * 50, "binary"), ("words\nand words\n" * 20, "no table of numbers"),
                          ("", "empty")):
        with pytest.raises(DataError, match=told):
            look(write(content))
    with pytest.raises(DataError, match="cannot tell the format from the ending '.doc'"):
        look(write(text(), "log.doc"))


# --- names and units --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name, unit", [
    ("angle [deg]", "deg"), ("angle (°)", "deg"), ("q_rad", "rad"), ("n/rpm", "rpm"), ("M [mNm]", "mN.m"),
    ("t_ms", "ms"),
    ("pos_a", None), ("angle [counts]", None), ("speed [1/min]", "rpm"), ("T [°C]", "degC")])
def test_units_that_a_name_states_are_read(name, unit):
    assert stated(Look("log.csv", Layout(), [name]), name) == unit


@pytest.mark.parametrize("rig, name, variable, alike", [
    (HIP_KNEE, "theta1", "motor1.phi", True), (HIP_KNEE, "Motor2 position [deg]", "motor2.phi", True),
    (HIP_KNEE, "motor1_phi", "motor1.phi", True), (HIP_KNEE, "theta1 desired", "motor1.phi", False),
    (HIP_KNEE, "theta1 [Nm]", "motor1.phi", False), (HIP_KNEE, "hip flexion", "q_H", False),
    (HIP_KNEE, "hip flexion [deg]", "q_H", True), (JOINT, "joint angle", "motor.phi", False),
    (JOINT, "joint torque", "C", True), (JOINT, "load torque", "C", False),
    (JOINT, "current", "motor.tau", True), (JOINT, "current", "C", False), (HIP_KNEE, "Winkel 2", "motor2.phi", True)])
def test_a_name_is_like_a_variable_or_not(rig, name, variable, alike, models):
    unit = models[rig].variables[variable].unit
    assert (likeness(name, stated(Look("", Layout(), [name]), name), variable, unit, models[rig]) > 0) is alike


def test_names_that_fit_two_variables_are_asked(models):
    write(text(frame().rename(columns={"motor_torque [Nm]": "torque [Nm]", "load_torque [Nm]": "load [Nm]"})))
    proposal = propose(sampled("log.csv"), models[JOINT])
    assert [c.variable for c in proposal.columns.values()] == ["motor.phi"]
    assert [q.about for q in proposal.questions] == [("motor.tau",), ("C",)]
    assert proposal.questions[0].answers == ("torque [Nm]", "load [Nm]", NOT_THERE)


def test_every_answer_takes_a_question_away_until_a_study_is_there(models):
    write(text(bare().rename(columns={"time": "ms"}).assign(ms=range(0, 45000, 150))))
    sample, given = sampled("log.csv"), Given()
    proposal = propose(sample, models[JOINT], given)
    answers = {"time": "ms", "C": "load_torque", "ms": "ms", "motor_angle": "deg", "motor_torque": "A"}
    asked = []
    while proposal.questions:
        question = proposal.questions[0]
        key = question.kind if question.kind in ("time", "k_m") else question.about[0]
        asked.append((question.kind, key))
        given = answered(proposal, given, question, answers.get(key, "0.1" if key == "k_m" else "N.m"))
        proposal = propose(sample, models[JOINT], given)
    assert asked == [("time", "time"), ("column", "C"), ("unit", "ms"), ("unit", "motor_angle"),
                     ("unit", "motor_torque"), ("unit", "load_torque"), ("k_m", "k_m")]
    study = proposal.study("study.toml", models[JOINT])
    assert study.time_column == "ms" and study.columns["ms"].unit == "ms"
    assert (study.columns["motor_torque"].unit, study.columns["motor_torque"].k_m) == ("A", 0.1)
    log, = load(study)
    assert log.time[1] == pytest.approx(0.15)


@pytest.mark.parametrize("step, unit", [(0.002, "s"), (2, "ms"), (0.05, "s"), (500, "us"), (20, "ms"), (1e7, "ns"),
                                        (0.15, None), (150, None)])
def test_an_interval_tells_the_unit_of_time_where_one_alone_is_plausible(step, unit, models):
    write(text(bare(time=np.arange(300) * step)))
    proposal = propose(sampled("log.csv"), models[JOINT], Given(si=True))
    asked = [q for q in proposal.questions if q.about == ("time",)]
    if unit is None:
        assert asked and asked[0].answers == ("s", "ms", "us", "ns")
    else:
        assert not asked and (proposal.columns["time"].unit if "time" in proposal.columns else "s") == unit
        assert any(n.startswith("'time' states no unit; its steps of") for n in proposal.notes)


def test_a_current_is_in_amperes_and_asks_for_its_constant(models):
    write(text(bare().rename(columns={"motor_torque": "motor_current", "load_torque": "joint_torque"})))
    proposal = propose(sampled("log.csv"), models[JOINT])
    assert ("A", "mA") in [q.answers for q in proposal.questions]
    question, = propose(sampled("log.csv"), models[JOINT], Given(si=True)).questions
    assert question.kind == "k_m" and question.option == "--map motor_current=motor.tau:A,k_m=0.1"


def test_a_log_without_time_asks_for_its_rate(models):
    write(text(frame().drop(columns="time [s]")))
    sample = sampled("log.csv")
    proposal = propose(sample, models[JOINT])
    question = proposal.questions[0]
    assert question.kind == "time" and "how many rows a second" in question.text and question.option == "--rate HZ"
    with pytest.raises(DataError, match="no number above zero"):
        answered(proposal, Given(), question, "-3")
    given = answered(proposal, Given(), question, "250")
    assert propose(sample, models[JOINT], given).settings == {"rate": 250.0}


@pytest.mark.parametrize("factor, unit", [(1, "rad/s"), (180 / np.pi, "deg/s"), (30 / np.pi, "rpm")])
def test_a_speed_without_a_unit_has_that_of_its_slope(factor, unit, models):
    t = frame()["time [s]"]
    write(text(frame(motor_speed=40 * np.cos(40 * t) * factor)))
    proposal = propose(sampled("log.csv"), models[JOINT])
    assert proposal.columns["motor_speed"].unit == unit
    assert f"'motor_speed' states no unit; its slope against 'motor_angle [rad]' says {unit}." in proposal.notes


def test_a_speed_that_counts_the_other_way_is_asked(models):
    t = frame()["time [s]"]
    write(text(frame(**{"motor_speed [rad/s]": -40 * np.cos(40 * t)})))
    sample = sampled("log.csv")
    given = Given({"load_torque [Nm]": {"variable": "C"}})
    proposal = propose(sample, models[JOINT], given)
    question, = proposal.questions
    assert question.kind == "sign" and question.about == ("motor_angle [rad]", "motor_speed [rad/s]")
    after = propose(sample, models[JOINT], answered(proposal, given, question, "motor_speed [rad/s]"))
    assert not after.questions and after.columns["motor_speed [rad/s]"].sign == -1


def test_a_rig_is_told_by_its_columns_or_not(models):
    assert rig_of(sampled(write(text())), models) == [JOINT]
    assert rig_of(sampled(write(text(header=False))), models) == []


def test_what_names_nothing_is_refused(models):
    sample = sampled(write(text(frame().assign(phase="up"))))
    for name, settings, told in (("motor_angl", {"variable": "motor.phi"}, "closest: 'motor_angle"),
                                 ("phase", {"variable": "C"}, "holds no numbers"),
                                 ("motor_angle [rad]", {"variable": "motr.phi"}, "closest: 'motor.phi'"),
                                 ("motor_angle [rad]", {"variable": "motor.phi", "unit": "Nm"}, "does not fit")):
        with pytest.raises((UnknownNameError, DataError), match=told):
            propose(sample, models[JOINT], Given({name: settings}))


# --- the command ------------------------------------------------------------------------------------------------------


class Terminal(io.StringIO):
    """A user who types these lines."""

    def isatty(self):
        return True


def test_on_a_terminal_it_asks_and_repeats_what_was_no_answer(monkeypatch, capsys):
    write(text(bare()))
    monkeypatch.setattr(mapping.sys, "stdin", Terminal("load_torque\nrat\nrad\nN.m\nN.m\n"))
    assert main(["new", "GearedJoint", "--data", "log.csv"]) == 0
    told = capsys.readouterr().out
    assert "Which column is C [N.m]" in told and "'rat' is no answer; closest: 'rad'" in told
    assert load_study("GearedJoint.toml").columns["load_torque"].variable == "C"


def test_what_motors_are_rated_for_is_asked_or_given_and_stands_in_the_limits(monkeypatch, capsys):
    write(text(bare()))
    monkeypatch.setattr(mapping.sys, "stdin", Terminal("load_torque\nrad\nN.m\nN.m\nfive\n5\n3000 rpm\n"))
    assert main(["new", "GearedJoint", "--data", "log.csv", "--out", "asked"]) == 0
    told = capsys.readouterr().out
    assert "rated torque of the motors [N.m]" in told and "'five' is no number" in told
    found = load_study("asked/GearedJoint.toml").limits
    assert found["motor.tau"] == (None, 5.0) and found["motor.w"][1] == pytest.approx(314.159, rel=1e-5)
    given = ["--map", "load_torque=C:N.m", "--si", "--rated", "motor.tau=0.5", "w=3000:rpm"]
    assert main(["new", "GearedJoint", "--data", "log.csv", "--out", "given", *given]) == 0
    assert load_study("given/GearedJoint.toml").limits["motor.tau"] == (None, 0.5)
    for wrong, said in (("motor.tau=lots", "write VARIABLE=VALUE"), ("motor.tau=-1", "must be above zero"),
                        ("motor.tau=1:rpm", "'motor.tau'"), ("motr.tau=1", "closest: 'motor.tau'")):
        assert main(["new", "GearedJoint", "--data", "log.csv", "--out", "no", "--si", "--rated", wrong]) == 2
        assert said in capsys.readouterr().err and not Path("no").exists()


def test_piped_it_says_in_one_sentence_what_to_give_and_writes_nothing(here, capsys):
    write(text(bare()))
    assert main(["new", "GearedJoint", "--data", "log.csv"]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and told.startswith("pycosim: log.csv: the log does not tell the columns of C and the "
                                                     "units of 'motor_angle'")
    assert "--map COLUMN=C:N.m motor_angle=motor.phi:rad motor_torque=motor.tau:N.m" in told and "--si" in told
    assert not list(here.glob("*.toml"))
    assert main(["new", "GearedJoint", "--data", "log.csv", "--si", "--map", "load_torque=C,sign=-1,gain=2"]) == 0
    column = load_study("GearedJoint.toml").columns["load_torque"]
    assert (column.unit, column.sign, column.gain) == ("N.m", -1, 2.0)


def test_dates_tell_the_rate_that_can_be_said_instead(here, capsys):
    stamps = pd.Timestamp("2025-06-01 10:00") + pd.to_timedelta(np.arange(300) * 4, unit="ms")
    write(text(bare(time=stamps.strftime("%Y-%m-%d %H:%M:%S.%f"))))
    assert main(["new", "GearedJoint", "--data", "log.csv", "--si", "--map", "load_torque=C"]) == 2
    assert "--rate 250" in capsys.readouterr().err
    assert main(["new", "GearedJoint", "--data", "log.csv", "--si", "--map", "load_torque=C", "--rate", "250"]) == 0
    study = load_study("GearedJoint.toml")
    assert (study.rate, study.time_column) == (250.0, "")


def test_without_a_rig_the_columns_tell_or_it_is_asked_for(capsys):
    write(text())
    assert main(["new", "--data", "log.csv", "--map", "load_torque [Nm]=C"]) == 0
    assert load_study("GearedJoint.toml").rig == JOINT
    write(text(header=False))
    assert main(["new", "--data", "log.csv"]) == 2
    assert "do not tell which machine it is; name it: pycosim new " in capsys.readouterr().err


@pytest.mark.parametrize("arguments, told", [
    (["new"], "RIG is missing; name one, as HipKnee, or give --data FILE"),
    (["new", "GearedJoint", "--si"], "--si says something of a log; name the log with --data FILE"),
    (["new", "GearedJoint", "--data", "log.csv", "--map", "time"], "--map time: write COLUMN=VARIABLE:UNIT"),
    (["new", "GearedJoint", "--data", "log.csv", "--map", "time [s]=time:s,gian=2"],
     "unknown key 'gian'; closest: 'gain'"),
    (["new", "GearedJoint", "--data", "log.csv", "--map", "time [s]=time:s,gain=x"], "gain = 'x' is not a number"),
    (["new", "GearedJoint", "--data", "log.csv", "--rate", "0"], "--rate 0: must be above zero"),
    (["new", "GearedJoint", "--data", "log.csv", "--rate", "500"],
     "log.csv: has a column 'time [s]' that is the time, and a rate (500 Hz) is for logs without one"),
    (["new", "GearedJoint", "--data", "log.csv", "--without", "C_X"],
     "log.csv: the log cannot be without 'C_X', for DriveTrain.Rigs.GearedJoint has no such variable; "),
    (["new", "GearedJoint", "--data", "short.csv"], "short.csv: has one row of data; a log needs at least two"),
    (["new", "GearedJoint", "--data", "log.csv", "other.csv", "--si", "--map", "load_torque [Nm]=C"],
     "other.csv: is laid out otherwise (separator = \";\")"),
    (["new", "GearedJoint", "--data", "log.csv", "lacks.csv", "--si", "--map", "load_torque [Nm]=C"],
     "lacks.csv: no column 'load_torque [Nm]'")])
def test_what_cannot_be_is_refused(arguments, told, here, capsys):
    write(text())
    write(text(sep=";"), "other.csv")
    write(text(frame().drop(columns="load_torque [Nm]")), "lacks.csv")
    write(text(frame().head(1)), "short.csv")
    assert main(arguments) == 2
    err = capsys.readouterr().err
    assert told in err and err.count("\n") == 1 and not list(here.glob("*.toml"))

"""Claims about logs: SI signals come out, what would mislead a fit is refused with its row, nothing is repaired."""

import json
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.io import savemat

from pycosim.core.errors import DataError
from pycosim.core.units import to_si
from pycosim.data.derivatives import derivatives, resolution
from pycosim.data.frames import Frame
from pycosim.data.logs import load, read_log, require
from pycosim.data.readers import READERS
from pycosim.study.schema import LOG_ENDINGS, Column, Study

DATA = Path(__file__).parents[2] / "../shared/data"
COLUMNS = {"theta1": Column("motor1.phi", "rad"), "tau1": Column("motor1.tau", "N.m"),
           "omega1": Column("motor1.w", "rad/s"), "C_H": Column("C_H", "N.m")}
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"measured data is not at {DATA}")


def make_study(tmp_path, **options):
    return Study(tmp_path / "study.toml", "DriveTrain.Rigs.HipKnee", **{"columns": COLUMNS, **options})


def frame(n=40, **columns):
    t = np.round(np.arange(n) * 0.01, 4)
    return pd.DataFrame({"time": t, "theta1": np.sin(3 * t), "tau1": 0.5 + 0.1 * t, **columns})


@pytest.fixture
def read(tmp_path):
    """Write a frame, text or bytes as a log and read it."""
    def do(content, name="run.csv", **options):
        path = tmp_path / name
        if isinstance(content, pd.DataFrame):
            content = content.to_csv(index=False)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_log(path, make_study(tmp_path, **options))
    return do


# --- what is read ---------------------------------------------------------------------------------------------------


def test_a_log_comes_out_in_si_by_variable(read):
    columns = {"theta1": Column("motor1.phi", "deg", zero=10.0), "tau1": Column("motor1.tau", "A", k_m=0.1)}
    source = frame()
    log = read(source, columns=columns)
    assert set(log.signals) == {"motor1.phi", "motor1.tau"} and log.name == "run.csv"
    np.testing.assert_allclose(log.signals["motor1.phi"], np.radians(source.theta1 - 10.0))
    np.testing.assert_allclose(log.signals["motor1.tau"], 0.1 * source.tau1)
    np.testing.assert_array_equal(log.rows, np.arange(40) + 2)


def test_labels_and_unknown_columns_need_no_attention(read):
    source = frame(manoeuvre=["A"] * 20 + [""] * 20, note="x,y", other="text")
    log = read(source)
    assert set(log.labels[:20]) == {"A"} and set(log.labels[20:]) == {""}
    assert read(frame()).labels is None


def test_byte_order_mark_windows_lines_and_blanks_in_the_header_do_no_harm(read):
    text = "\ufeff" + frame().to_csv(index=False, lineterminator="\r\n").replace("theta1", " theta1 ") + "\r\n\r\n"
    np.testing.assert_array_equal(read(text).signals["motor1.phi"], read(frame()).signals["motor1.phi"])


def test_parquet_gives_what_csv_gives(tmp_path, read):
    pytest.importorskip("pyarrow")
    source = frame(manoeuvre="A")
    source.to_parquet(tmp_path / "run.parquet")
    log = read_log(tmp_path / "run.parquet", make_study(tmp_path))
    np.testing.assert_array_equal(log.signals["motor1.tau"], read(source).signals["motor1.tau"])
    assert set(log.labels) == {"A"}


def test_the_unit_of_time_can_be_said(read):
    source = frame().assign(time=np.arange(40) * 10.0)
    log = read(source, columns={**COLUMNS, "time": Column("time", "ms")})
    assert log.time[-1] == pytest.approx(0.39) and "time" not in log.signals


def test_a_file_can_be_one_sample(read):
    log = read(frame(), average="file")
    assert log.time.shape == log.signals["motor1.tau"].shape == (1,)
    assert log.signals["motor1.tau"][0] == pytest.approx(frame().tau1.mean()) and log.meta["samples"] == 40


def test_drop_outs_are_skipped_only_on_request_and_recorded(read):
    source = frame()
    source.loc[[5, 6, 20], "theta1"] = [np.nan, np.inf, np.nan]
    log = read(source, drop_outs="skip")
    assert log.dropped == [(7, 8), (22, 22)] and log.time.size == 37 and 7 not in log.rows


def test_load_reads_runs_then_held_out_runs(tmp_path):
    for k, name in enumerate(("a.csv", "b.csv")):
        frame(theta1=np.sin(3 * frame().time + k)).to_csv(tmp_path / name, index=False)
    study = make_study(tmp_path, runs=[tmp_path / "a.csv"], held_out=[tmp_path / "b.csv"])
    assert [(log.name, log.held_out) for log in load(study)] == [("a.csv", False), ("b.csv", True)]
    assert [log.name for log in load(study, [tmp_path / "b.csv"])] == ["b.csv"]
    with pytest.raises(DataError, match="no logs to fit.*--data"):
        load(replace(study, runs=[]))


# --- what is refused ------------------------------------------------------------------------------------------------


def lines(change):
    """The good file with its list of lines changed."""
    text = frame().to_csv(index=False).splitlines()
    return "\n".join(change(text)) + "\n"


def cell(row, column, value):
    source = frame().astype(object)
    source.loc[row - 2, column] = value
    return source


REFUSED = {
    "not a number": (cell(9, "tau1", np.nan), ["row 9", "'tau1'", "NaN", 'drop_outs = "skip"']),
    "infinite": (cell(9, "tau1", "inf"), ["row 9", "'tau1'", "infinite"]),
    "empty cell in time": (cell(9, "time", ""), ["row 9", "'time'"]),
    "time back": (cell(9, "time", 0.0), ["row 9", "goes backwards", "0 s after 0.06 s"]),
    "time repeats": (cell(9, "time", 0.06), ["row 9", "repeats", "0.06 s"]),
    "one row": (frame(1), ["one usable row"]),
    "header only": (frame(0), ["header but no data rows"]),
    "empty file": (b"", ["empty"]),
    "binary": (b"PK\x03\x04\x00\x00\x00", ["binary file"]),
    "utf-16": (frame().to_csv(index=False).encode("utf-16"), ["is UTF-16 text", '[data] encoding = "utf-16"']),
    "latin-1": ("time,theta1,tau1\n0,1,2\n1,2,3°\n".encode("latin-1"), ["row 3", "UTF-8", 'encoding = "cp1252"']),
    "duplicate": (frame().to_csv(index=False).replace("tau1", "theta1", 1), ["column 'theta1'", "2 times"]),
    "truncated": (lines(lambda x: x[:-1] + [x[-1].split(",")[0]]), ["row 41", "1 fields", "3", "ends within a row"]),
    "ragged": (lines(lambda x: x[:7] + [x[7] + ",1"] + x[8:]), ["row 8", "4 fields", "3"]),
    "ragged with quotes": (lines(lambda x: ['time,"theta1",tau1', *x[1:6], x[6] + ",1"]), ["row 7", "4 fields"]),
    "text": (cell(9, "tau1", "overload"), ["row 9", "'tau1'", "'overload' is not a number"]),
    "dates": (frame().astype(object).assign(time=[f"2026-03-01T12:00:{k:02}.005" for k in range(40)]),
              ["row 2", "is not a number but a date", "its stamps make 1 rows a second", "rate = 1, time_column"]),
    "decimal comma": (cell(9, "tau1", "0,5"), ["row 9", "'0,5'", "decimal point"]),
    "semicolons": (frame().to_csv(index=False, sep=";"), ["semicolons", 'in the study: [data] separator = ";"']),
    "tabs": (frame().to_csv(index=False, sep="\t"), ["tabs", r'[data] separator = "\t"']),
    "decimal commas": (frame().to_csv(index=False, sep=";", decimal=","), ['separator = ";", decimal = ","']),
    "a preamble": ("Recorder 7\nof May, 2nd\n" + frame().to_csv(index=False), ["row 2: has", "preamble = 2"]),
    "units below the names": (frame().to_csv(index=False).replace("\n", "\ns,rad,Nm\n", 1),
                              ["row 2", "units_row = true"]),
    "no names": (frame().to_csv(index=False, header=False), ["row 1 holds numbers", "[data] header = false"]),
    "no time": (frame().rename(columns={"time": "Time"}), ["'time'", "closest: 'Time'", "time_column"]),
    "none of ours": (frame().rename(columns={"theta1": "a", "tau1": "b"}),
                     ["none of the study's columns", "it has time, a, b"]),
    "other case": (frame().rename(columns={"tau1": "Tau1"}), ["no column 'tau1'", "closest: 'Tau1'"]),
    "a unit in the name": (frame().rename(columns={"tau1": "tau1 [mNm]"}),
                           ["no column 'tau1'", "closest: 'tau1 [mNm]'"]),
    "dead torque": (frame(C_H=0.0), ["'C_H'", "exactly zero"]),
    "no motion": (frame().assign(theta1=1.0), ["not_enough_excitation: nothing moves: theta1 keeps one value"]),
    "no motion, a noisy speed": (frame(omega1=1e-3 * np.random.default_rng(2).standard_normal(40)).assign(theta1=1.0),
                                 ["nothing moves: theta1 keeps one value"]),
    "an angle that stays": (frame(omega1=3 * np.cos(3 * frame().time)).assign(theta1=1.0),
                            ["stuck: theta1 keeps one value while omega1 moves", "take that out of [columns]"]),
    "column without numbers": (frame(C_H=np.nan), ["'C_H'", "no number at all"]),
    "microseconds": (frame().assign(time=np.arange(40) * 1e4), ["every 1e+04 s", "must be in s", 'unit = "us"']),
    "too fast": (frame().assign(time=np.arange(40) * 1e-9), ["every 1e-09 s"]),
    "speed in rpm": (frame(omega1=3 * np.cos(3 * frame().time) * 9.5493),
                     ["'theta1'", "'omega1'", "0.105 times", "units"]),
    "speed with other sign": (frame(omega1=-3 * np.cos(3 * frame().time)), ["-1 times", "signs"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_log_that_would_mislead_is_refused_with_its_place(read, case):
    content, words = REFUSED[case]
    with pytest.raises(DataError) as caught:
        read(content)
    assert "run.csv" in str(caught.value) and "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def named(text):
    return text.replace("\n", ",up\n").replace(",up\n", ",phase\n", 1)


OTHERWISE = {  # a file, what the study says of it, and the line that reads it
    "no names": (named(frame().to_csv(index=False)).partition("\n")[2], {}, "[data] header = false"),
    "names after all": (frame(), {"header": False}, "[data] header = true instead of header = false"),
    "no preamble": (frame(), {"preamble": 3}, "[data] preamble = 0 instead of preamble = 3"),
    "no units": (frame(), {"units_row": True}, "row 2 holds numbers, not units; lay the file out as it is, in the "
                                               "study: [data] units_row = false instead of units_row = true"),
    "points after all": (frame(), {"decimal": ","}, '[data] decimal = "." instead of decimal = ","'),
    "commas in quotes": (lines(lambda x: [x[0], *(",".join(f'"{c.replace(".", ",")}"' for c in line.split(","))
                                                  for line in x[1:])]), {}, '[data] decimal = ","'),
}


@pytest.mark.parametrize("case", OTHERWISE)
def test_a_file_that_is_laid_out_otherwise_is_refused_with_the_line_that_reads_it(read, case):
    content, said, line = OTHERWISE[case]
    with pytest.raises(DataError) as caught:
        read(content, **said)
    assert line in str(caught.value)


def test_decimal_commas_in_quotes_are_read_between_commas(read):
    log = read(OTHERWISE["commas in quotes"][0], decimal=",")
    np.testing.assert_allclose(log.signals["motor1.phi"], frame().theta1)


def test_blank_lines_are_skipped_and_rows_are_counted_with_them(read):
    log = read(lines(lambda x: [x[0], "", *x[1:7], "", "  ", *x[7:]]))
    np.testing.assert_allclose(log.signals["motor1.phi"], frame().theta1)
    assert log.rows[[0, 5, 6]].tolist() == [3, 8, 11]
    with pytest.raises(DataError, match="row 11, column 'tau1': 'x' is not a number"):
        read(lines(lambda x: [x[0], "", *x[1:7], "", "", x[7].rpartition(",")[0] + ",x", *x[8:]]))


def test_a_packed_file_is_to_be_unpacked(read):
    with pytest.raises(DataError, match=r"run.csv.gz: is packed; unpack it, .* \(likely run.csv\)"):
        read(b"\x1f\x8b\x08", name="run.csv.gz")


def test_a_column_cannot_come_later_than_the_log_lasts(read):
    with pytest.raises(DataError, match="column 'tau1' has late = 500 s in the study, and the log lasts 0.39 s"):
        read(frame(), columns={"theta1": Column("motor1.phi", "rad"), "tau1": Column("motor1.tau", "N.m", late=500.0)})


def test_dates_of_other_formats_are_no_nanoseconds(tmp_path, read):
    dated = frame().assign(time=pd.date_range("2026-03-01", periods=40, freq="10ms"))
    dated.to_parquet(tmp_path / "run.parquet")
    study = make_study(tmp_path)
    with pytest.raises(DataError, match="column 'time': holds datetime64.*not numbers but a date.*; write seconds.* "
                                        "rate = 100, "):
        read_log(tmp_path / "run.parquet", study)
    with pytest.raises(DataError, match=r"holds datetime64.*dt.total_seconds"):
        read_log(Frame("table", dated), study)


def test_the_endings_of_logs_are_those_that_there_are_readers_for():
    assert set(LOG_ENDINGS) == {ending for ending in READERS if ending.startswith(".")}


def test_what_is_not_a_file_is_refused(tmp_path, read):
    study = make_study(tmp_path)
    with pytest.raises(DataError, match="is a folder"):
        read_log(tmp_path, study)
    read(frame())
    with pytest.raises(DataError, match="no log .*rum.csv; closest: 'run.csv'"):
        read_log(tmp_path / "rum.csv", study)
    with pytest.raises(DataError, match=r"ending '.doc'.*\[data\] reader"):
        read(frame(), "run.doc")


def test_a_label_column_that_was_asked_for_must_be_there(read):
    with pytest.raises(DataError, match="no label column 'phase'"):
        read(frame(), labels="phase")


def test_all_rows_dropped_is_no_log(read):
    source = frame(4)
    source.loc[[0, 1, 2], "theta1"] = np.nan
    with pytest.raises(DataError, match="one usable row"):
        read(source, drop_outs="skip")


def test_what_a_question_needs_is_named_by_its_column(read):
    log = read(frame())
    require(log, ["motor1.phi", "motor1.tau"])
    with pytest.raises(DataError, match="run.csv: no column 'C_H'; .*names the column that holds"):
        require(log, ["C_H"])
    with pytest.raises(DataError, match=r"'motor2.phi' is needed.*add \[columns\]"):
        require(log, ["motor2.phi"])


def test_parquet_without_pyarrow_says_what_to_install(tmp_path, monkeypatch):
    (tmp_path / "run.parquet").write_bytes(b"PAR1")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(DataError, match="pip install"):
        read_log(tmp_path / "run.parquet", make_study(tmp_path))


# --- MAT, MCAP and MDF


def write_mat(source, path, **more):
    savemat(path, {n: source[n].to_numpy() for n in source} | more)


def write_mdf(source, path, times=None):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        for k, names in enumerate(times or [[n for n in source if n != "time"]]):
            rows = source.iloc[::k + 1]
            values = [rows[n].to_numpy() if rows[n].dtype.kind == "f" else rows[n].to_numpy(dtype="S") for n in names]
            file.append([asammdf.Signal(v, rows["time"].to_numpy(), name=n, encoding="utf-8")
                         for n, v in zip(names, values)])
        file.save(path, overwrite=True)


def write_mcap(source, path, topics=None, encoding="json", text=json.dumps):
    writer = pytest.importorskip("mcap.writer")
    with open(path, "wb") as stream:
        file = writer.Writer(stream)
        file.start()
        schema = file.register_schema("any", "jsonschema", b"{}")
        for k, (topic, names) in enumerate((topics or {"rig": [n for n in source if n != "time"]}).items()):
            channel = file.register_channel(topic, encoding, schema)
            for row in source.iloc[::k + 1].to_dict("records"):
                at = round(row["time"] * 1e9) + 5 * 10**9
                file.add_message(channel, at + 1000, text({n: row[n] for n in names}).encode(), at)
        file.finish()


WRITERS = {"mat": write_mat, "mf4": write_mdf, "mcap": write_mcap}


def mapped(kind):
    """The columns' names in a file of this kind."""
    return {f"rig.{n}" if kind == "mcap" else n: c for n, c in COLUMNS.items()}


@pytest.mark.parametrize("kind", WRITERS)
def test_every_format_gives_what_csv_gives(kind, tmp_path, read):
    source = frame(manoeuvre=["A"] * 20 + ["rest"] * 20)
    WRITERS[kind](source, tmp_path / f"run.{kind}")
    label = "rig.manoeuvre" if kind == "mcap" else "manoeuvre"
    wanted = read(source)
    log = read_log(tmp_path / f"run.{kind}", make_study(tmp_path, columns=mapped(kind), labels=label))
    for name, values in wanted.signals.items():
        np.testing.assert_array_equal(log.signals[name], values)
    np.testing.assert_allclose(log.time, wanted.time, atol=1e-9)
    assert list(log.labels) == list(wanted.labels) and set(wanted.signals) == set(log.signals)


@pytest.mark.parametrize("kind", WRITERS)
def test_a_broken_file_of_any_format_is_refused(kind, tmp_path):
    path = tmp_path / f"run.{kind}"
    study = make_study(tmp_path, columns=mapped(kind))
    for content in (b"no such thing", frame().to_csv(index=False).encode(), bytes(500)):
        path.write_bytes(content)
        with pytest.raises(DataError, match=rf"run\.{kind}: is not an? (MAT|MDF|MCAP) file, or is") as caught:
            read_log(path, study)
        assert "\n" not in str(caught.value)
    WRITERS[kind](frame(), path)
    whole = path.read_bytes()
    path.write_bytes(whole[:len(whole) // 2])
    with pytest.raises(DataError):
        read_log(path, study)


@pytest.mark.parametrize("kind", WRITERS)
def test_a_file_of_other_columns_says_which_it_has(kind, tmp_path):
    WRITERS[kind](frame()[["time", "tau1"]], tmp_path / f"run.{kind}")
    other = make_study(tmp_path, columns={"elsewhere": Column("motor1.tau", "N.m")})
    with pytest.raises(DataError, match="holds none of the study's columns elsewhere; it has .*tau1"):
        read_log(tmp_path / f"run.{kind}", other)


@pytest.mark.parametrize("kind, package", [("mf4", "asammdf"), ("mcap", "mcap")])
def test_without_its_package_a_format_says_what_to_install(kind, package, tmp_path, monkeypatch):
    (tmp_path / f"run.{kind}").write_bytes(b"any")
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(DataError, match=rf"need {package}; pip install 'pycosim-drivetrain\[(mdf|mcap)\]'"):
        read_log(tmp_path / f"run.{kind}", make_study(tmp_path))


@pytest.mark.parametrize("kind, apart", [("mf4", [["theta1"], ["tau1"]]), ("mcap", {"a": ["theta1"], "b": ["tau1"]})])
def test_columns_of_two_clocks_are_not_mixed(kind, apart, tmp_path):
    WRITERS[kind](frame(), tmp_path / f"run.{kind}", apart)
    columns = {n: c for n, c in {**COLUMNS, "a.theta1": COLUMNS["theta1"], "b.tau1": COLUMNS["tau1"]}.items()
               if ("." in n) == (kind == "mcap")}
    with pytest.raises(DataError, match="were not sampled at the same times"):
        read_log(tmp_path / f"run.{kind}", make_study(tmp_path, columns=columns))


def test_a_mat_file_may_hold_structs_and_cells(tmp_path):
    source = frame()
    fields = {n: source[n].to_numpy()[:, None] for n in source}
    savemat(tmp_path / "run.mat", {"log": {**fields, "label": np.array(["A"] * 40, dtype=object)}, "note": "any"})
    columns = {f"log.{n}": c for n, c in COLUMNS.items()}
    study = make_study(tmp_path, columns=columns, time_column="log.time", labels="log.label")
    log = read_log(tmp_path / "run.mat", study)
    np.testing.assert_array_equal(log.signals["motor1.tau"], source.tau1)
    assert set(log.labels) == {"A"} and "note" in log.header


@pytest.mark.parametrize("more, told", [
    ({"tau1": np.zeros(39)}, "column 'tau1' has 39 values, 'time' has 40"),
    ({"tau1": np.ones((40, 3))}, "column 'tau1': holds 40 x 3, not one number a sample"),
    ({"tau1": "high"}, "column 'tau1': holds a single value, not one number a sample"),
])
def test_what_is_no_column_in_a_mat_file_is_refused(more, told, tmp_path):
    write_mat(frame(), tmp_path / "run.mat", **more)
    with pytest.raises(DataError, match=told):
        read_log(tmp_path / "run.mat", make_study(tmp_path))


def test_a_mat_file_of_version_73_says_how_to_save_it(tmp_path):
    (tmp_path / "run.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(400))
    with pytest.raises(DataError, match="is a MAT file of version 7.3; save it with the option -v7"):
        read_log(tmp_path / "run.mat", make_study(tmp_path))


def test_an_mcap_file_of_other_encodings_says_so(tmp_path):
    write_mcap(frame(), tmp_path / "run.mcap", encoding="cdr")
    with pytest.raises(DataError, match=r"has no message encoded as JSON \(but cdr\)"):
        read_log(tmp_path / "run.mcap", make_study(tmp_path))
    write_mcap(frame(), tmp_path / "run.mcap", text=lambda row: "{")
    with pytest.raises(DataError, match="message 0 on 'rig' is not JSON"):
        read_log(tmp_path / "run.mcap", make_study(tmp_path))


def test_an_mcap_file_may_hold_arrays_and_drop_outs(tmp_path):
    source = frame()
    source.loc[7, "tau1"] = np.nan
    write_mcap(source, tmp_path / "run.mcap", text=lambda row: json.dumps(
        {"joint": [row["theta1"], 0], "tau1": None if np.isnan(row["tau1"]) else row["tau1"]}))
    columns = {"rig.joint[0]": COLUMNS["theta1"], "rig.tau1": COLUMNS["tau1"]}
    log = read_log(tmp_path / "run.mcap", make_study(tmp_path, columns=columns, drop_outs="skip"))
    assert log.dropped == [(8, 8)] and log.time[0] == 0.0 and len(log.signals["motor1.phi"]) == 39


def test_an_mdf_channel_that_is_there_twice_is_refused(tmp_path):
    write_mdf(frame(), tmp_path / "run.mf4", [["theta1", "tau1"], ["tau1"]])
    with pytest.raises(DataError, match="channel 'tau1' is there 2 times"):
        read_log(tmp_path / "run.mf4", make_study(tmp_path))


def test_broken_parquet_is_refused(tmp_path):
    pytest.importorskip("pyarrow")
    (tmp_path / "run.parquet").write_bytes(b"no such thing")
    with pytest.raises(DataError, match="is not a Parquet file"):
        read_log(tmp_path / "run.parquet", make_study(tmp_path))
    frame(tau1="x").to_parquet(tmp_path / "text.parquet")
    with pytest.raises(DataError, match="'tau1': holds .*'x' in row 2"):
        read_log(tmp_path / "text.parquet", make_study(tmp_path))


# --- other formats --------------------------------------------------------------------------------------------------

SERVO = {"position": Column("motor.phi", "rad"), "speed": Column("motor.w", "rad/s"), "voltage": Column("motor.v", "V")}
SCREW = {"velocity": Column("motor.w", "rad/s"), "torque": Column("motor.tau", "N.m")}


def servo_run(**changes):
    entry = {"speed": 0.0, "load": 65535, "input_volts": 8.85, "temp": 28, "goal_position": 0.0, "torque_enable": True}
    entries = [{**entry, "timestamp": 0.01 * k, "position": 0.01 * k} for k in range(5)]
    return {"mass": 0.49, "length": 0.1, "kp": 100, "vin": 7.4, "trajectory": "sin_sin", "entries": entries, **changes}


def test_servo_load_is_a_signed_number(read):
    log = read(json.dumps(servo_run()), "run.json", columns=SERVO, reader="bam")
    np.testing.assert_allclose(log.signals["motor.v"], -0.01)
    assert log.meta["mass"] == 0.49 and log.meta["powered"]


def test_servo_samples_without_power_are_left_out(read):
    run = servo_run(trajectory="lift_and_drop")
    run["entries"][3]["torque_enable"] = False
    log = read(json.dumps(run), "run.json", columns=SERVO, reader="bam")
    assert log.time.size == 3 and log.dropped == [(4, 5)] and not log.meta["powered"]


@pytest.mark.parametrize("content, words", [
    ("{", ["is not JSON", "reader"]), ("[]", ["no entries"]),
    (json.dumps(servo_run(entries=[{"timestamp": 0.0}])), ["entry 1", "no 'position'"]),
    (json.dumps(servo_run()).replace('"temp": 28', '"temp": "hot"', 1), ["entry 1", "'temp' is not a number"]),
])
def test_a_broken_servo_log_is_refused(read, content, words):
    with pytest.raises(DataError) as caught:
        read(content, "run.json", columns=SERVO, reader="bam")
    assert all(w in str(caught.value) for w in words)


@pytest.mark.parametrize("content, words", [
    ("time,torque\n1,2\n", ["no units line"]), ("ms;rpm;Nm\n0;1;2\n", ["row 1", "unknown unit 'Nm'"]),
    ("x\nms;rpm;%\n0;1;2\n1;1\n", ["row 4", "2 fields"]), ("ms;rpm;%\n0;1;2\n1;x;2\n", ["row 3", "not 3 numbers"]),
])
def test_a_broken_screw_log_is_refused(read, content, words):
    with pytest.raises(DataError) as caught:
        read(content, "20.csv", columns=SCREW, reader="epos")
    assert all(w in str(caught.value) for w in words)


@needs_data
def test_all_servo_runs_are_read(tmp_path):
    study = make_study(tmp_path, columns=SERVO, reader="bam")
    logs = load(study, sorted((DATA / "bam_xl330").glob("*.json")))
    assert len(logs) == 16 and sum(log.meta["powered"] for log in logs) == 12
    for log in logs:
        assert np.abs(log.signals["motor.v"]).max() < 9.0
        assert bool(log.dropped) == (log.meta["trajectory"] == "lift_and_drop")


@needs_data
def test_all_steady_screw_runs_are_read(tmp_path):
    study = make_study(tmp_path, columns=SCREW, reader="epos", average="file")
    logs = load(study, sorted((DATA / "screw_drives").glob("*/steady_state/*/*.csv")))
    assert len(logs) == 62
    for log in logs:
        # the drives log with the sign opposite to the file's name
        assert log.signals["motor.w"][0] == pytest.approx(-log.meta["speed"], rel=0.05, abs=0.02)
        assert np.sign(log.signals["motor.tau"][0]) == -np.sign(log.meta["speed"])


@needs_data
def test_the_servos_own_speed_lags_and_the_derivative_does_not(tmp_path):
    path = DATA / "bam_xl330/2026-01-15_10h30m10.json"
    log = read_log(path, make_study(tmp_path, columns=SERVO, reader="bam"))
    angle = log.signals["motor.phi"]
    speed = derivatives(log.time, angle).first
    travel = np.append(0.0, np.cumsum(np.diff(log.time) * (speed[1:] + speed[:-1]) / 2))
    assert np.std(travel - angle) < 0.02
    lagged = np.interp(log.time - 0.02, log.time, speed)
    assert np.std(lagged - log.signals["motor.w"]) < 0.2 * np.std(speed - log.signals["motor.w"])


# --- how a file is laid out -----------------------------------------------------------------------------------------


def test_a_rate_stands_for_a_column_of_time(read):
    source = frame().drop(columns="time")
    log = read(source, rate=250.0)
    np.testing.assert_allclose(log.time, np.arange(40) / 250)
    source.loc[5, "tau1"] = np.nan  # a row left out still took its time
    np.testing.assert_allclose(read(source, rate=250.0, drop_outs="skip").time[[4, 5]], [4 / 250, 6 / 250])
    with pytest.raises(DataError, match=r"no column 'time'.*\[data\] rate"):
        read(source)


def test_a_rate_beside_a_column_of_time_is_refused_unless_that_is_said_to_be_none(read):
    with pytest.raises(DataError, match=r"has a column 'time', and \[data\] rate = 250 .*; take rate out"):
        read(frame(), rate=250.0)
    np.testing.assert_allclose(read(frame(), rate=250.0, time_column="").time, np.arange(40) / 250)


def test_columns_of_a_file_without_a_header_go_by_number(read):
    columns = {"2": Column("motor1.phi", "rad"), "3": Column("motor1.tau", "N.m")}
    text = frame().to_csv(index=False, header=False)
    log = read(text, columns=columns, header=False, time_column="1")
    assert log.header == ["1", "2", "3"] and log.rows[0] == 1 and len(log.time) == 40
    np.testing.assert_allclose(log.signals["motor1.phi"], frame().theta1)
    with pytest.raises(DataError, match=r"row 1, column '1': 'time' is not a number; .*: \[data\] header = true "
                                        "instead of header = false"):
        read(frame(), columns=columns, header=False, time_column="1")
    with pytest.raises(DataError, match="row 3: has 2 fields, the first row has 3"):
        read("1,2,3\n2,3,4\n3,4\n4,5,6\n", columns=columns, header=False, time_column="1")
    with pytest.raises(DataError, match="header = false is for comma-separated text"):
        read(b"PAR1", name="run.parquet", columns=columns, header=False)


def test_of_a_log_only_a_span_of_time_may_be_used(read):
    source = frame()
    source.loc[35, "tau1"] = np.nan  # what is cut off need not be whole
    log = read(source, time=(0.1, 0.2))
    np.testing.assert_allclose(log.time, np.arange(10, 21) * 0.01)
    assert log.rows[0] == 12 and log.dropped == []
    with pytest.raises(DataError, match=r"no row lies within time = \[3, 4\] s; the log runs from 0 to 0.39 s"):
        read(source, time=(3.0, 4.0))


# --- derivatives ----------------------------------------------------------------------------------------------------


def test_a_cubic_is_differentiated_also_at_the_ends_and_with_uneven_sampling():
    rng = np.random.default_rng(0)
    t = 1e3 + np.cumsum(rng.uniform(0.002, 0.02, 300))
    x = t - t[0]
    found = derivatives(t, 2.0 + x - 0.5 * x**2 + 0.1 * x**3)
    np.testing.assert_allclose(found.first, 1 - x + 0.3 * x**2, atol=2e-4)
    np.testing.assert_allclose(found.second, -1 + 0.6 * x, atol=1e-2)


def test_derivatives_do_not_lag():
    t = np.arange(0, 10, 0.01)
    first = derivatives(t, np.sin(4 * t)).first[50:-50]
    inner = t[50:-50]
    (_, lag), *_ = np.linalg.lstsq(np.column_stack([np.cos(4 * inner), np.sin(4 * inner)]), first)
    assert abs(lag) < 1e-9
    np.testing.assert_allclose(first, 4 * np.cos(4 * inner), atol=4e-3)


def test_a_gap_in_the_log_makes_no_speed():
    t = np.concatenate([np.arange(0, 1, 0.01), np.arange(5, 6, 0.01)])
    first = derivatives(t, np.where(t < 2, 0.0, 3.0) + 0.5 * t).first
    np.testing.assert_allclose(first, 0.5, atol=1e-6)


def moved(counts, rate=100.0, seconds=30.0):
    """A motion out and back, its angle in steps, and its speed and acceleration."""
    t = np.arange(0, seconds, 1 / rate)
    true = 2 * np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t)
    step = 2 * np.pi / counts
    return (t, np.round(true / step) * step, 2.6 * np.cos(1.3 * t) + 1.55 * np.cos(3.1 * t),
            -3.38 * np.sin(1.3 * t) - 4.805 * np.sin(3.1 * t))


@pytest.mark.parametrize("counts, speed_error, acceleration_error", [(2**16, 0.002, 0.03), (2**12, 0.004, 0.05),
                                                                     (500, 0.01, 0.1)])
def test_coarse_encoders_give_usable_speeds_and_accelerations(counts, speed_error, acceleration_error):
    t, angle, speed, acceleration = moved(counts)
    found = derivatives(t, angle)
    assert np.std(found.first - speed) < speed_error and np.std(found.second - acceleration) < acceleration_error
    assert 1.3 / (2 * np.pi) < found.bandwidth < 50.0


@pytest.mark.parametrize("factor", [1 / 15.125, 100.0, 180 / np.pi, 1e-3])
def test_derivatives_are_those_of_the_same_motion_in_other_units(factor):
    t, angle, speed, _ = moved(4096)
    for given in (None, speed + 0.01 * np.random.default_rng(0).standard_normal(len(t))):
        here = derivatives(t, angle, given)
        there = derivatives(t, angle * factor, None if given is None else given * factor)
        np.testing.assert_allclose(there.first, factor * here.first, rtol=1e-5, atol=1e-6 * factor)
        np.testing.assert_allclose(there.second, factor * here.second, rtol=1e-5, atol=1e-5 * factor)
        assert there.noise == pytest.approx(factor * here.noise) and there.bandwidth == pytest.approx(here.bandwidth)


def test_a_measured_speed_makes_speed_and_acceleration_better_and_one_that_lags_does_no_harm():
    t, angle, speed, acceleration = moved(500)
    rng = np.random.default_rng(0)
    alone = derivatives(t, angle)
    both = derivatives(t, angle, speed + 0.002 * rng.standard_normal(len(t)))
    assert np.std(both.first - speed) < 0.2 * np.std(alone.first - speed)
    assert np.std(both.second - acceleration) < 0.5 * np.std(alone.second - acceleration)
    late = np.interp(t - 0.05, t, speed) + 0.002 * rng.standard_normal(len(t))
    beside = derivatives(t, moved(2**16)[1], late)
    assert np.std(beside.first - speed) < 0.1 * np.std(late - speed)


@pytest.mark.parametrize("late", [0.004, -0.004, 0.02])
def test_a_fine_speed_that_comes_late_is_not_believed_where_the_motion_changes(late):
    """Most samples hardly accelerate: from their middle error it was believed, and the torque came early."""
    t, _, speed, _ = moved(500)
    speed = np.clip(3.0 * np.sin(0.9 * t), -0.8, 0.8)  # cruises, and turns
    angle = np.round(np.cumsum(speed) * (t[1] - t[0]) * 2**16) / 2**16
    shown = np.interp(t - late, t, speed)
    alone, both = derivatives(t, angle), derivatives(t, angle, shown)
    assert np.std(both.first - speed) < max(1.1 * np.std(alone.first - speed), 0.3 * np.std(shown - speed))


def test_the_noise_of_a_speed_is_known():
    rng = np.random.default_rng(0)
    t, _, speed, _ = moved(500)
    true = 2 * np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t)
    found = derivatives(t, true + 0.003 * rng.standard_normal(len(t)))
    assert found.noise == pytest.approx(np.std((found.first - speed)[100:-100]), rel=0.5)


def test_an_inertia_from_noisy_angles_is_not_biased():
    rng = np.random.default_rng(0)
    t, _, speed, acceleration = moved(500, rate=500.0)
    angle = 2 * np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t) + 0.002 * rng.standard_normal(len(t))
    torque = 0.3 * acceleration + 0.1 * np.sign(speed) + 0.5 * rng.standard_normal(len(t))
    found = derivatives(t, angle)
    columns = np.array([found.second, np.sign(found.first)])
    inertia, _ = np.linalg.lstsq(columns.T, torque)[0]
    assert inertia == pytest.approx(0.3, rel=0.03)


def test_a_long_log_is_differentiated_in_a_second():
    t = np.arange(40_000) * 0.002
    angle = np.cumsum(np.sin(t) * np.sin(0.31 * t)) * 0.002 + 1e-4 * np.random.default_rng(0).standard_normal(len(t))
    start = time.perf_counter()
    derivatives(t, angle)
    assert time.perf_counter() - start < 5.0  # some 0.2 s on an idle machine


def test_an_angle_that_keeps_one_value_has_no_speed():
    found = derivatives(np.arange(50.0), np.full(50, 2.0))
    assert not found.first.any() and not found.second.any() and found.noise == 0.0
    assert resolution(np.full(50, 2.0)) == 0.0
    t = np.arange(0, 20, 0.01)
    for quantum in (1e-4, 1e-3, 2e-3):
        assert resolution(np.round(np.sin(0.7 * t) / quantum) * quantum) == pytest.approx(quantum, rel=0.5)


def test_steps_are_told_whatever_the_clock_does():
    """A steady angle at times that jitter, rightly logged, or that are rounded, looked rougher than its encoder is."""
    even = np.arange(3000) * 0.02
    uneven = even + np.random.default_rng(0).uniform(-0.25, 0.25, even.size) * 0.02
    steps = [resolution(np.round(3.1 * t / 0.01) * 0.01, said) for t, said in (
        (even, None), (even, even), (uneven, uneven), (even, np.round(even / 0.015) * 0.015 + 1e-6 * even))]
    assert steps == pytest.approx([0.01] * 4, rel=0.35)
    assert resolution(np.round(3.1 * uneven / 0.01) * 0.01) > 0.02


def test_too_few_samples_have_no_derivative():
    with pytest.raises(DataError, match="4 samples"):
        derivatives(np.arange(4.0), np.arange(4.0))


@pytest.mark.parametrize(("unit", "si", "factor"), [
    ("kg.cm", "N.m", 0.0980665), ("lb-ft", "N.m", 1.3558179), ("lbf.in", "N.m", 0.11298483),
    ("oz-in", "N.m", 7.0615518e-3), ("kgf", "N", 9.80665), ("g.cm2", "kg.m2", 1e-7), ("mm/s2", "m/s2", 1e-3)])
def test_units_of_data_sheets_are_known(unit, si, factor):
    assert to_si(unit, si, "column 'tau'") == pytest.approx(factor, rel=1e-7)


def test_a_speed_that_is_the_difference_of_coarse_counts_makes_no_accelerations():
    """Even moves at half a count a sample and more: their beat is at all frequencies, and is no motion."""
    time = np.arange(0, 20, 0.0025)
    moves = [0, 0.15, 6.5, 6.65, 6.8, 13.2, 13.35, 13.5, 19.85, 20], [0, 0.34, 0.34, 0, -1.8, -1.8, 0, 0.55, 0.55, 0]
    ramp = np.interp(time, *moves)
    angle, true = cumulative_trapezoid(ramp, time, initial=0), np.gradient(ramp, time)
    count = 2 * np.pi / 4096
    read = count * np.round(angle / count)
    alone, beside = (derivatives(time, read, s) for s in (None, np.r_[0.0, np.diff(read)] / 0.0025))
    assert np.std(beside.second - true) < 1.2 * np.std(alone.second - true)
    exact = derivatives(time, read, ramp + 0.002 * np.random.default_rng(0).standard_normal(len(time)))
    assert exact.bandwidth > 2 * alone.bandwidth, "a speed that knows more is still followed further"

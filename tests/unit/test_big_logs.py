"""Claims about logs larger than memory: means equal those taken by hand, the same checks name the same rows."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.hidden_effects import machine as rig
from pycosim.cli.entry import main
from pycosim.core.errors import DataError
from pycosim.data import readers
from pycosim.data.logs import read_log
from pycosim.data.readers import parquet
from pycosim.study.schema import Column, Study

ROOT = Path(__file__).parents[2]
COLUMNS = {"theta1": Column("motor1.phi", "deg", zero=3.0), "tau1": Column("motor1.tau", "N.m"),
           "omega1": Column("motor1.w", "rad/s"), "temperature": Column("temperature", "degC")}
MOST = 500


def frame(n=2000):
    rng = np.random.default_rng(0)
    time = np.round(np.cumsum(rng.uniform(0.009, 0.011, n)), 6)
    return pd.DataFrame({"time": time, "theta1": np.degrees(np.sin(time)), "tau1": rng.normal(0.5, 0.1, n),
                         "omega1": np.cos(time), "temperature": 20.0 + 0.1 * time, "manoeuvre": "A"})


@pytest.fixture(params=["csv", "parquet"])
def read(request, tmp_path, monkeypatch):
    """Write a frame and read it, in parts much smaller than the file and unlike the means."""
    monkeypatch.setattr(readers, "BLOCK", 3001)
    if request.param == "parquet":
        pytest.importorskip("pyarrow")
        monkeypatch.setattr(parquet, "_ROWS", 37)

    def do(source, most=MOST, **options):
        path = tmp_path / f"run.{request.param}"
        if request.param == "csv":
            source.to_csv(path, index=False)
        else:
            source.to_parquet(path, index=False)
        study = Study(tmp_path / "study.toml", "DriveTrain.Rigs.HipKnee", columns=COLUMNS, most=most, **options)
        return read_log(path, study)
    return do


def by_hand(source, pieces, every):
    """Means of so many rows within each piece, a range of rows of the frame."""
    groups = [source.iloc[k:min(k + every, b)] for a, b in pieces for k in range(a, b, every)]
    return (pd.DataFrame([g.drop(columns="manoeuvre").mean() for g in groups]),
            [g.manoeuvre.iloc[0] for g in groups], [g.index[0] + 2 for g in groups])


def same(log, wanted):
    means, labels, rows = wanted
    np.testing.assert_allclose(log.time, means.time, rtol=1e-12)
    np.testing.assert_allclose(log.signals["motor1.phi"], np.radians(means.theta1 - 3.0), rtol=1e-9, atol=1e-12)
    for variable, name in (("motor1.tau", "tau1"), ("motor1.w", "omega1"), ("temperature", "temperature")):
        np.testing.assert_allclose(log.signals[variable], means[name], rtol=1e-9, atol=1e-12)
    assert list(log.labels) == labels and list(log.rows) == rows


def test_a_log_with_more_rows_is_read_as_means_and_says_so(read):
    log = read(frame(2001))
    same(log, by_hand(frame(2001), [(0, 2001)], 5))
    assert log.meta == {"file_rows": 2001, "means_of": 5}


def test_a_log_with_no_more_rows_is_read_row_by_row(read):
    log = read(frame(MOST))
    same(log, by_hand(frame(MOST), [(0, MOST)], 1))
    assert log.meta == {}


def test_no_mean_crosses_a_label_a_drop_out_or_a_gap(read):
    source = frame()
    source.loc[401:, "manoeuvre"] = "rest"
    source.loc[700:702, "tau1"] = np.nan
    source.loc[702:703, "theta1"] = np.nan
    source.loc[1210:, "time"] += 5.0
    log = read(source, drop_outs="skip")
    same(log, by_hand(source, [(0, 401), (401, 700), (704, 1210), (1210, 2000)], 4))
    assert log.dropped == [(702, 705)]


def test_constants_stay_constants_so_that_standstill_is_seen(read):
    with pytest.raises(DataError, match="keeps one value"):
        read(frame(1999).assign(theta1=0.1))


def missing(name, first, last):
    def change(source):
        source.loc[first:last, name] = np.nan
    return change


def repeated(source):
    source.loc[1500, "time"] = source.time[1499]


BAD = {
    "missing where parts meet": (missing("tau1", 30, 80), ["row 32-82", "'tau1'"]),
    "missing at the end": (missing("omega1", 1998, 1999), ["row 2000-2001", "'omega1'"]),
    "no number at all": (missing("temperature", 0, 1999), ["'temperature' holds no number at all"]),
    "time repeats": (repeated, ["row 1502: time repeats", "(row 1501)", "1 such row"]),
}


@pytest.mark.parametrize("case", BAD)
def test_what_misleads_is_refused_with_its_row(read, case):
    change, words = BAD[case]
    source = frame()
    change(source)
    with pytest.raises(DataError) as told:
        read(source)
    for word in words:
        assert word in str(told.value), told.value


@pytest.mark.parametrize("border", range(36, 40))
def test_time_that_runs_back_where_parts_meet_is_refused(read, border):
    source = frame()
    source.loc[border:, "time"] -= 0.05
    with pytest.raises(DataError, match=f"row {border + 2}: time goes backwards.*row {border + 1}.*1 such row"):
        read(source)


BROKEN = {
    "fields": (1501, lambda line: line + ",1", "row 1502: has 7 fields, the header has 6"),
    "cut": (-1, lambda line: line[:9], "row 2001: has 1 fields, the header has 6 (the log ends within a row)"),
    "number": (1501, lambda line: line.replace(",", ",x", 1), "row 1502, column 'theta1': 'x"),
    "text": (1501, lambda line: line + "\udcff", "row 1502: is not UTF-8 text"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_row_of_text_is_named_wherever_it_stands(tmp_path, monkeypatch, case):
    monkeypatch.setattr(readers, "BLOCK", 3001)
    row, broken, words = BROKEN[case]
    lines = frame().to_csv(index=False).splitlines()
    lines[row] = broken(lines[row])
    (tmp_path / "run.csv").write_bytes(("\n".join(lines) + "\n\n").encode(errors="surrogateescape"))
    with pytest.raises(DataError) as told:
        read_log(tmp_path / "run.csv", Study(tmp_path / "study.toml", "x", columns=COLUMNS, most=MOST))
    assert words in str(told.value)


@pytest.mark.long
def test_the_results_say_that_means_were_read(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    motion = rig.six_manoeuvres((0.8, 1.6), 1, longest_pass=3.0)
    rig.write_csv(rig.measure(rig.PAPER, motion), "run.csv")
    text = (ROOT / "examples" / "hip_knee" / "study.toml").read_text()
    Path("study.toml").write_text(text.replace("[data]", "[data]\nmost = 2000"))
    assert main(["identify", "study.toml", "--data", "run.csv"]) == 0
    assert f"run.csv: {motion.time.size:,} rows, read as means of 3." in capsys.readouterr().out


MEASURE = """
import sys
from pathlib import Path
from pycosim.data.logs import read_log
from pycosim.study.schema import Column, Study
columns = {"theta1": Column("motor1.phi", "rad"), "tau1": Column("motor1.tau", "N.m")}
log = read_log(Path(sys.argv[1]), Study(Path("study.toml"), "x", columns=columns, most=20_000))
print(len(log.time), next(int(s.split()[1]) / 1024 for s in open("/proc/self/status") if s.startswith("VmHWM")))
"""


def write(path, rows):
    """A log of one row group or of lines made quickly."""
    if path.suffix == ".parquet":
        time = np.arange(rows) * 1e-3
        source = pd.DataFrame({"time": time, "theta1": np.sin(time), "tau1": np.cos(time), "manoeuvre": "A"})
        source.to_parquet(path, index=False, row_group_size=rows)
        return
    with path.open("w") as stream:
        stream.write("time,theta1,tau1,manoeuvre\n")
        stream.writelines(f"{k}e-3,{k % 997}.25,0.{k % 991},A\n" for k in range(rows))


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the peak of a process is read from /proc")
@pytest.mark.parametrize("kind", [pytest.param(k, marks=pytest.mark.long) for k in ("csv", "parquet")])
def test_memory_does_not_grow_with_the_file(tmp_path, kind):
    if kind == "parquet":
        pytest.importorskip("pyarrow")
    peaks = []
    for rows in (800_000, 2_400_000):
        path = tmp_path / f"{rows}.{kind}"
        write(path, rows)
        found = subprocess.run([sys.executable, "-c", MEASURE, path], cwd=ROOT, capture_output=True, text=True,
                               check=True)
        samples, peak = map(float, found.stdout.split())
        assert samples == 20_000
        peaks.append(peak)
    # 1.6 million rows more would be 49 MiB as numbers alone
    assert peaks[1] - peaks[0] < 20, peaks



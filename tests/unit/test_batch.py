"""Claims about several studies at once: each is a row, failures too; nothing is done twice or lost with a process."""

import csv
import os
import signal
from pathlib import Path

import pytest

from pycosim.cli import batch
from pycosim.cli.entry import main
from pycosim.core.executors import ExecutorError, executor


def pretend(study, folder, robust=False):
    """Stands for `improve_one`: leaves a result, fails where the study says so, or is killed."""
    if "killed" in study:
        os.kill(os.getpid(), signal.SIGKILL)
    if "broken" in study:
        return batch._failed(study, 0.1, "no rig in it")
    Path(folder).mkdir(parents=True, exist_ok=True)
    with (Path(folder) / "times.txt").open("a") as stream:
        stream.write("once\n")
    (Path(folder) / "ladder.json").write_text("{}")
    return {**batch._failed(study, 0.1, ""), "verdict": "nothing_missing"}


@pytest.fixture
def studies(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(batch, "improve_one", pretend)
    for name in ("one", "broken", "two", "killed"):
        Path(f"{name}.toml").write_text('[rig]\nmodel = "DriveTrain.Rigs.HipKnee"\n')
    return lambda *names: [f"{n}.toml" for n in names]


def table(folder):
    with (folder / batch.TABLE).open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.parametrize("where", ["serial", "threads"])
def test_every_study_is_a_row_and_one_that_fails_too(studies, tmp_path, where):
    told = []
    rows = batch.improve_all(studies("one", "broken", "two"), tmp_path / "out", where, progress=told.append)
    assert [r["verdict"] for r in rows] == ["nothing_missing", "", "nothing_missing"]
    assert [r["failure"] for r in table(tmp_path / "out")] == ["", "no rig in it", ""]
    assert told[-1] == "3 of 3 studies done, 1 failed"


def test_what_was_done_is_not_done_again_unless_the_study_changed(studies, tmp_path):
    for _ in range(2):
        batch.improve_all(studies("one", "two"), tmp_path / "out")
    Path("two.toml").write_text('seed = 1\n[rig]\nmodel = "DriveTrain.Rigs.HipKnee"\n')
    batch.improve_all(studies("one", "two"), tmp_path / "out")
    times = {n: (tmp_path / "out" / n / "times.txt").read_text().count("once") for n in ("one", "two")}
    assert times == {"one": 1, "two": 2}


def test_a_killed_process_loses_nothing_but_its_own_study(studies, tmp_path):
    rows = batch.improve_all(studies("one", "killed", "two"), tmp_path / "out", "processes", 2)
    assert [bool(r["failure"]) for r in rows] == [False, True, False]
    assert "killed" in rows[1]["failure"] and len(table(tmp_path / "out")) == 3


def test_studies_of_one_name_have_folders_of_their_own():
    assert batch._folders(["a/x.toml", "b/x.toml", "c.toml"]) == {"a/x.toml": "x", "b/x.toml": "x_2", "c.toml": "c"}


@pytest.mark.parametrize("argv, message", [
    (["a.toml", "b.toml", "--on", "thread"], "closest: 'threads'"),
    (["a.toml", "b.toml", "--data", "run.csv"], "--data is for one study"),
    (["a.toml", "--on", "threads"], "--on is for several studies"),
    (["a.toml", "b.toml", "--workers", "0"], "there must be one at least")])
def test_a_slip_in_the_options_is_told(tmp_path, monkeypatch, capsys, argv, message):
    monkeypatch.chdir(tmp_path)
    assert main(["improve", *argv]) == 2
    told = capsys.readouterr().err
    assert message in told and told.count("\n") == 1


def test_no_scheduler_is_told_in_a_sentence():
    pytest.importorskip("distributed")
    with pytest.raises(ExecutorError, match="no scheduler of dask answers"):
        with executor("dask://127.0.0.1:1"):
            pass

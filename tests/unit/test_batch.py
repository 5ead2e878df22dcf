"""Claims about several studies at once: each is a row, failures too; nothing is done twice or lost with a process."""

import csv
import json
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import pycosim as pc
from pycosim.cli import batch
from pycosim.cli.entry import main
from pycosim.core.executors import ExecutorError, aided, computing, each, executor, in_turn
from pycosim.data.sent import Sent


def pretend(study, folder, robust=False, bare=False):
    """Stands for `improve_one`: leaves a result, fails where the study says so, or is killed."""
    name = Path(study).stem
    if name == "killed" or name == "unlucky" and not Path(study).with_suffix(".tried").exists():
        Path(study).with_suffix(".tried").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if name == "broken":
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
    for name in ("one", "broken", "two", "killed", "unlucky"):
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


@pytest.mark.slow
@pytest.mark.long
def test_a_study_is_improved_as_the_verb_does(hidden, tmp_path):
    row = batch.improve_one(str(hidden / "study.toml"), str(tmp_path / "out"), bare=True)
    assert (row["failure"], row["verdict"], row["added"]) == ("", "nothing_missing", "stribeck@2A")
    assert pc.Search.load(tmp_path / "out").added == ["stribeck@2A"]
    assert not (tmp_path / "out" / "report.html").exists() and not (tmp_path / "out" / "figures").exists()


def test_what_was_done_is_not_done_again_unless_the_study_changed(studies, tmp_path):
    for _ in range(2):
        batch.improve_all(studies("one", "two"), tmp_path / "out")
    Path("two.toml").write_text('seed = 1\n[rig]\nmodel = "DriveTrain.Rigs.HipKnee"\n')
    batch.improve_all(studies("one", "two"), tmp_path / "out")
    times = {n: (tmp_path / "out" / n / "times.txt").read_text().count("once") for n in ("one", "two")}
    assert times == {"one": 1, "two": 2}


@pytest.mark.long
def test_a_killed_process_loses_nothing_but_its_own_study(studies, tmp_path):
    rows = batch.improve_all(studies("one", "killed", "two"), tmp_path / "out", "processes", 2)
    assert [bool(r["failure"]) for r in rows] == [False, True, False]
    assert "killed" in rows[1]["failure"] and len(table(tmp_path / "out")) == 3


def test_each_piece_is_told_before_the_next_begins_where_there_is_one_core():
    begun = []
    for key, future in each({k: (begun.append, k) for k in range(3)}):
        assert future.result() is None and begun == list(range(key + 1))


@pytest.mark.parametrize("where", ["threads", "processes"])
def test_what_the_work_raises_is_raised_where_its_result_is_asked_for(where):
    done = dict(each({"good": (int, "7"), "bad": (int, "x")}, where, 2))
    assert done["good"].result() == 7
    with pytest.raises(ValueError, match="invalid literal"):
        done["bad"].result()


FORKED = """
from pycosim.core.executors import executor
with executor("processes", 1, ("wave",)) as pool:
    print([pool.submit(eval, f"'{name}' in __import__('sys').modules").result() for name in ("wave", "aifc")])
"""


@pytest.mark.skipif("forkserver" not in multiprocessing.get_all_start_methods(), reason="nothing is forked here")
def test_what_all_processes_need_is_there_when_they_begin():
    done = subprocess.run([sys.executable, "-c", FORKED], capture_output=True, text=True, check=True)
    assert done.stdout == "[True, False]\n"


@pytest.fixture
def cluster(tmp_path):
    """A scheduler of dask and two workers, each a process of its own in a folder of its own; its word."""
    pytest.importorskip("distributed")
    address, environment = tmp_path / "scheduler.json", {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}

    def start(tool, *options):
        (tmp_path / tool).mkdir(exist_ok=True)
        return subprocess.Popen([sys.executable, "-m", f"distributed.cli.dask_{tool}", "--scheduler-file", address,
                                 "--no-dashboard", *options], cwd=tmp_path / tool, env=environment,
                                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    started = [start("scheduler", "--host", "127.0.0.1", "--port", "0")]
    started += [start("worker", "--nthreads", "1", "--host", "127.0.0.1") for _ in range(2)]
    end = time.monotonic() + 60
    while not address.exists() and time.monotonic() < end:
        time.sleep(0.1)
    yield json.loads(address.read_text())["address"].replace("tcp://", "dask://")
    for process in reversed(started):  # workers first, as long as there is a scheduler to take leave of
        process.terminate()
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


WAITS = """
import signal
import time
from pycosim.core.executors import each

class Work(dict):
    def items(self):
        yield from super().items()
        print("begun", flush=True)

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job is started without
    try:
        list(each(Work(one=(time.sleep, 120)), "processes", 1, IMPORTS))
    except KeyboardInterrupt:
        print("interrupted")
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("later", [0.0, 1.0])  # while the other process starts, and when it works [s]
@pytest.mark.parametrize("imports", [(), ("numpy",)], ids=["spawned", "forked"])
def test_an_interrupt_ends_the_other_processes_without_a_word_of_theirs(tmp_path, later, imports):
    (tmp_path / "waits.py").write_text(WAITS.replace("IMPORTS", repr(imports)))
    begun = subprocess.Popen([sys.executable, tmp_path / "waits.py"], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                             text=True, start_new_session=True)
    assert begun.stdout.readline() == "begun\n"
    time.sleep(later)
    os.killpg(begun.pid, signal.SIGINT)
    assert begun.communicate(timeout=60) == ("interrupted\n", "")


@pytest.mark.long
def test_a_killed_worker_of_a_cluster_loses_nothing(studies, cluster, tmp_path):
    """One study is killed once and done by another worker; one kills whoever takes it, and is a row that says so."""
    names = ("one", "unlucky", "broken", "killed", "two")
    rows = batch.improve_all(studies(*names), tmp_path / "out", cluster)
    assert {n: r["verdict"] for n, r in zip(names, rows)} == {
        "one": "nothing_missing", "unlucky": "nothing_missing", "broken": "", "killed": "", "two": "nothing_missing"}
    assert [r["study"] for r in table(tmp_path / "out")] == studies(*names)
    assert "killed" in rows[3]["failure"] and rows[2]["failure"] == "no rig in it"
    for name in ("one", "unlucky", "two"):
        assert (tmp_path / "out" / name / "ladder.json").exists()


def test_studies_of_one_name_have_folders_of_their_own():
    assert batch._folders(["a/x.toml", "b/x.toml", "c.toml"]) == {"a/x.toml": "x", "b/x.toml": "x_2", "c.toml": "c"}


@pytest.mark.parametrize("argv, message", [
    (["a.toml", "b.toml", "--on", "thread"], "closest: 'threads'"),
    (["a.toml", "b.toml", "--data", "run.csv"], "--data is for one study"),
    (["a.toml", "--on", "proceses"], "closest: 'processes'"),
    (["a.toml", "b.toml", "--workers", "0"], "there must be one at least")])
def test_a_slip_in_the_options_is_told(tmp_path, monkeypatch, capsys, argv, message):
    monkeypatch.chdir(tmp_path)
    assert main(["improve", *argv]) == 2
    told = capsys.readouterr().err
    assert message in told and told.count("\n") == 1


def killed_elsewhere(here, value):
    """The value, where it is asked for by the process with this number; any other dies of it."""
    if os.getpid() != here:
        os.kill(os.getpid(), signal.SIGKILL)
    return value


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_results_come_in_turn_and_what_was_killed_elsewhere_is_done_here():
    work = [(pow, 2, 3), (killed_elsewhere, os.getpid(), "here"), (max, 1, 2)]
    with computing("processes", 1, ()):
        assert list(in_turn(work)) == [8, "here", 2]
    assert list(in_turn(work)) == [8, "here", 2]


def where_it_is_done(number):
    """The number and the process, after a moment in which the other comes to its own."""
    time.sleep(0.05)
    return number, os.getpid()


def fails(number):
    raise ValueError(f"number {number}")


def test_a_second_process_takes_the_last_of_what_this_one_has_not_begun():
    with executor("processes", 1) as pool:
        pool.submit(os.getpid).result()  # it has come up
        with aided(pool):
            done = list(in_turn((where_it_is_done, k) for k in range(8)))
            assert [k for k, _ in done] == list(range(8))
            mine = [process == os.getpid() for _, process in done]
            assert mine == sorted(mine, reverse=True) and 0 < sum(mine) < 8
            assert list(in_turn([])) == []


def test_a_second_process_that_has_other_work_is_not_waited_for():
    with executor("processes", 1) as pool:
        busy = [pool.submit(time.sleep, 2.0) for _ in range(2)]  # one is begun, and one beside it is on its way
        with aided(pool):
            start = time.monotonic()
            assert list(in_turn((pow, k, 2) for k in range(4))) == [0, 1, 4, 9]
        assert not busy[-1].done() and time.monotonic() - start < 2.0


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_what_a_second_process_ends_in_or_fails_with_is_done_or_raised_here():
    with executor("processes", 1) as pool, aided(pool):
        assert list(in_turn((killed_elsewhere, os.getpid(), k) for k in range(5))) == [*range(5)]
        assert list(in_turn((killed_elsewhere, os.getpid(), k) for k in range(5))) == [*range(5)], "it has ended"
    with executor("processes", 1) as pool, aided(pool):
        results = in_turn([(pow, 2, 3), (fails, 1), (pow, 2, 2)])
        assert next(results) == 8
        with pytest.raises(ValueError, match="number 1"):
            next(results)
        assert list(in_turn([(pow, 2, 3), (pow, 2, 2)])) == [8, 4]


def test_what_is_not_asked_for_is_not_done():
    done = []
    results = in_turn([(done.append, 1), (done.append, 2)])
    next(results)
    assert done == [1]


@pytest.mark.slow
@pytest.mark.parametrize("where", ["threads", "processes", "beside"])
def test_a_diagnosis_is_the_same_wherever_its_fits_are_computed(hidden, where):
    def told():
        return pc.open(hidden / "study.toml").diagnose().candidates.to_frame().to_csv()
    here = told()
    if where == "beside":
        with executor("processes", 1) as pool, aided(pool):
            assert told() == here
        return
    with pc.computing(where, workers=2):
        assert told() == here


def test_a_data_set_that_was_sent_is_made_once_and_leaves_out_the_same(hidden):
    dataset = pc.open(hidden / "study.toml").fit().dataset
    early = dataset.passes == dataset.passes[-1]
    first, other = (pickle.loads(pickle.dumps(Sent(d))).dataset for d in (dataset, dataset.without(early)))
    assert first is not dataset and first.clock is other.clock
    for mine, theirs in ((dataset, first), (dataset.without(early), other)):
        assert np.array_equal(mine.view("all"), theirs.view("all"))


def test_no_scheduler_is_told_in_a_sentence(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("pycosim.core.executors.PATIENCE", 1)
    with pytest.raises(ExecutorError, match="no scheduler of dask answers"):
        with executor("dask://127.0.0.1:1"):
            pass

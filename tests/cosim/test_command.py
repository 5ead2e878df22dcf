"""Claims about `pycosim cosim` and the scenarios that come with it."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from joint import JOINT

import pycosim as pc
from pycosim.cli.entry import main
from pycosim.compile import Library
from pycosim.cosim.master import cosimulate
from pycosim.cosim.scenario import Column, load_scenario
from pycosim.data.dataset import Dataset
from pycosim.study.parse import load_study

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples" / "cosim"


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "joint.toml").write_text(JOINT)
    return tmp_path


def test_the_verb_leaves_log_results_and_figure_and_says_so(here, capsys):
    assert main(["cosim", "joint.toml"]) == 0
    out, err = capsys.readouterr()
    folder = here / "joint_cosim"
    assert {"run.csv", "cosim.json"} <= {p.name for p in folder.iterdir()}
    assert {p.name for p in (folder / "figures").iterdir()} == {"log.pdf", "log.png"}
    assert not (folder / "checkpoint.zip").exists() and err == ""
    assert "plant: machine, in process" in out and "joint_cosim" in out
    assert main(["cosim", "joint.toml", "--json", "--out", "again"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["schema"] == 1 and found["complete"] and found["columns"]["C"]["unit"] == "N.m"
    assert (here / "again" / "run.csv").read_bytes() == (folder / "run.csv").read_bytes()
    assert main(["cosim", "joint.toml", "--quiet"]) == 0 and capsys.readouterr().out == ""


def test_python_gives_an_object_that_its_file_gives_back(here):
    found = pc.cosimulate("joint.toml")
    assert main(["cosim", "joint.toml", "--quiet"]) == 0
    folder = here / "joint_cosim"
    assert found.to_csv("own.csv").read_bytes() == (folder / "run.csv").read_bytes() and found.checkpoint is None
    again = pc.Cosimulation.load(folder / "cosim.json")
    assert again.record == found.record and repr(again) == repr(found) and again.sentences == found.sentences
    assert again._repr_html_() == found._repr_html_() and found.complete
    pd.testing.assert_frame_equal(again.to_frame(), found.to_frame())
    assert found.to_frame().loc["C", "max"] == pytest.approx(found.log.C.max())
    assert len(found.plot.over_time()) == found.to_frame().unit.nunique() == 3
    arrays = found.to_xarray()
    assert (arrays.C.to_numpy() == found.log.C).all() and arrays.C.attrs["unit"] == "N.m" and "time" in arrays.coords
    own = found.log
    own["C"] = 0.0
    assert found.log.C.any()
    for asked in (again.plot.over_time, lambda: again.log, lambda: again.to_csv("no.csv")):
        with pytest.raises(pc.ResultError, match="holds no log"):
            asked()
    assert not (here / "no.csv").exists()
    with pytest.raises(pc.PycosimError, match="cannot be written"):
        found.to_csv(here / "no" / "log.csv")
    (here / "cut.json").write_text((folder / "cosim.json").read_text()[:300])
    with pytest.raises(pc.ResultError, match="no whole file of JSON"):
        pc.Cosimulation.load("cut.json")


def test_python_stops_and_goes_on_as_the_command_line_does(here):
    first = pc.cosimulate("joint.toml", until=0.5)
    assert not first.complete and " of 1.2 s" in repr(first)
    rest = pc.cosimulate("joint.toml", resume=first.checkpoint)
    pd.testing.assert_frame_equal(rest.log, pc.cosimulate("joint.toml").log)


def test_until_and_resume_make_one_log(here, capsys):
    assert main(["cosim", "joint.toml", "--quiet", "--out", "whole"]) == 0
    assert main(["cosim", "joint.toml", "--until", "0.5"]) == 0
    assert "--resume joint_cosim/checkpoint.zip" in capsys.readouterr().out
    assert main(["cosim", "joint.toml", "--quiet", "--resume", "joint_cosim/checkpoint.zip"]) == 0
    assert (here / "joint_cosim" / "run.csv").read_text() == (here / "whole" / "run.csv").read_text()
    assert not (here / "joint_cosim" / "checkpoint.zip").exists()


def test_a_run_that_is_killed_leaves_a_checkpoint_beside_its_folder(here):
    (here / "joint.toml").write_text(JOINT.replace("duration = 1.2", "duration = 20"))
    left = here / "out.checkpoint.zip"
    child = subprocess.Popen([sys.executable, "-c", CHILD, "cosim", "joint.toml", "--out", "out",
                              "--checkpoint-every", "0.1"], env={**os.environ, "PYTHONPATH": str(ROOT)},
                             stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    end = time.monotonic() + 60
    while not left.exists() and time.monotonic() < end:
        time.sleep(0.02)
    child.kill()
    child.wait()
    assert not (here / "out").exists()
    assert main(["cosim", "joint.toml", "--quiet", "--out", "out", "--resume", str(left),
                 "--checkpoint-every", "1"]) == 0
    assert main(["cosim", "joint.toml", "--quiet", "--out", "whole"]) == 0
    assert (here / "out" / "run.csv").read_bytes() == (here / "whole" / "run.csv").read_bytes()
    assert not left.exists()


def test_ctrl_c_leaves_a_complete_log_a_checkpoint_and_130(here):
    (here / "joint.toml").write_text(JOINT.replace("duration = 1.2", "duration = 2000"))
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    child = subprocess.Popen([sys.executable, "-c", CHILD, "cosim", "joint.toml", "--out", "out"], env=environment,
                             stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert child.stdout.readline() == "running\n"
    child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=60)
    assert child.returncode == 130 and out == "" and err.count("\n") == 1
    assert "interrupted at t = " in err and "--resume out/checkpoint.zip" in err
    log = pd.read_csv(here / "out" / "run.csv")
    assert len(log) > 1 and not log.isna().any().any() and np.allclose(np.diff(log["time"]), 0.01)
    assert not json.loads((here / "out" / "cosim.json").read_text())["complete"]


CHILD = """\
import sys
from pycosim.cli.entry import main
from pycosim.cosim import master
advance, said = master._Master._advance, []
def tell(self):
    advance(self)
    if self.tick > 200 and not said:
        said.append(print("running", flush=True))
master._Master._advance = tell
sys.exit(main())
"""


@pytest.fixture(scope="module")
def models():
    return Library()


def shortened(name, seconds):
    """A scenario that comes along, in process and cut short."""
    made = load_scenario(EXAMPLES / f"{name}.toml")
    parts = [replace(c, run="process") if c.kind in ("plant", "controller") else c for c in made.components]
    return replace(made, duration=seconds if made.duration else None, components=parts)


@pytest.mark.parametrize("name", ["gait", "standstill", "backdrive"])
def test_a_scenario_that_comes_along_runs(name, models):
    log = cosimulate(shortened(name, 0.8), library=models).log
    assert len(log) >= 81 and np.isfinite(log.select_dtypes("number")).all().all()
    assert np.abs(log["q_H"] - log["q_H"][0]).max() < 0.6
    if "C_H_estimate" in log:
        assert np.sqrt(np.mean((log["C_H_estimate"] - log["C_H"]) ** 2)) < 0.5


def test_the_six_manoeuvres_read_back_as_a_log(models, tmp_path):
    made = shortened("six_manoeuvres", None)
    parts = [replace(c, options={"speeds": [1.6], "repeats": 2, "longest": 1.0}) if c.kind == "trajectory" else c
             for c in made.components]
    columns = {**made.columns, "wanted": Column(("reference", "ref.motor2.phi"))}
    done = cosimulate(replace(made, components=parts, columns=columns), library=models)
    assert np.abs(done.log["theta2"] - done.log["wanted"]).max() < 0.02 and np.abs(done.log["C_K"]).max() < 20
    (tmp_path / "run.csv").write_text(done.text)
    study = load_study(ROOT / "examples" / "hip_knee" / "study.toml").with_data([tmp_path / "run.csv"])
    study.validate(models)
    dataset = Dataset(study, models)
    assert set(done.log["manoeuvre"]) == set("ABCDEF") | {"rest"}
    assert dataset.moving.sum() > 0.5 * len(dataset.time) and len(dataset.blocks) >= 6


def test_a_motion_from_a_file_is_followed(here, models):
    t = np.linspace(0, 1.2, 40)
    pd.DataFrame({"time": t, "q": 0.5 + 0.05 * np.sin(4 * t) ** 2, "push": 2 * t,
                  "manoeuvre": np.where(t < 0.6, "a", "b")}).to_csv(here / "motion.csv", index=False)
    text = JOINT.replace('trajectory = "backdrive"', 'motion = "motion.csv"').replace(
        "options = { cycle = 1.2, amplitude = 0.1 }\n", "").replace(
        'wanted = "reference.ref.q"', 'wanted = "reference.ref.q"\nlabel = "reference.label"').replace(
        '"reference -> controller"', '"reference -> controller", "reference -> plant"')
    (here / "file.toml").write_text(text)
    log = cosimulate(here / "file.toml", library=models).log
    assert np.abs(log["q"] - log["wanted"]).max() < 0.02 and np.ptp(log["wanted"]) > 0.045
    assert list(log["label"].unique()) == ["a", "b"]

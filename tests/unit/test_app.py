"""Claims about the app without a page: columns are suggested by name, steps go forth and back, the study stays."""

import socket

import pytest

from pycosim.app.mapping import suggest
from pycosim.app.workbench import Given, Workbench
from pycosim.cli import demo
from pycosim.cli.entry import main
from pycosim.compile import Library, compile_model
from pycosim.core.errors import PycosimError
from pycosim.report.folder import Folder
from pycosim.study.parse import load_study


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("app") / "hidden"
    with Folder(folder, "demo") as made:
        demo._make(Library(), made, speeds=(0.4, 1.6), longest=2.0)
    return folder / "study.toml"


@pytest.mark.parametrize("header, wanted", [
    (["time", "theta1", "tau2", "C_H", "temperature"],
     {"theta1": ("motor1.phi", "rad"), "tau2": ("motor2.tau", "N.m"), "C_H": ("C_H", "N.m"),
      "temperature": ("temperature", "degC")}),
    (["t", "Motor2 position [deg]", "motor_speed_1 (rpm)", "current 1 [mA]", "remark"],
     {"Motor2 position [deg]": ("motor2.phi", "deg"), "motor_speed_1 (rpm)": ("motor1.w", "rpm"),
      "current 1 [mA]": ("motor1.tau", "mA")}),
    (["a", "b"], {})])
def test_columns_are_suggested_by_their_names(header, wanted):
    found = suggest(header, compile_model(Library(), demo.RIG))
    assert {n: (c.variable, c.unit) for n, c in found.items()} == wanted


def test_the_loop_goes_forth_and_back(study, tmp_path):
    bench = Workbench(tmp_path / "app")
    with pytest.raises(Given, match="no data are read yet"):
        bench.diagnose()
    assert bench.likely_rig(study.parent / "run.csv") == demo.RIG
    bench.open(study)
    before = bench.step.held_out_error
    bench.add("stribeck", "2A")
    assert bench.step.held_out_error["C_H"] < 0.6 * before["C_H"]
    with pytest.raises(PycosimError, match="in the model already"):
        bench.add("stribeck", "2A")
    saved = load_study(bench.save())
    assert saved.effects == [("stribeck", "2A")] and load_study(study).effects == []
    again = Workbench(tmp_path / "again")
    again.open(bench.folder / "study.toml")  # what was clicked is in the file
    assert again.step.held_out_error["C_H"] == pytest.approx(bench.step.held_out_error["C_H"], rel=1e-3)
    bench.undo()
    assert bench.step.held_out_error == before
    with pytest.raises(Given, match="nothing was added"):
        bench.undo()


def test_a_region_says_what_its_error_depends_on(study, tmp_path):
    bench = Workbench(tmp_path / "app")
    bench.open(study)
    found = bench.region(0, 1e9)
    assert found["energy"] == pytest.approx(1) and found["depends"][0][1] > 0.05
    with pytest.raises(Given, match="moving samples"):
        bench.region(0, 0.1)


def test_the_given_study_is_never_written_over(study):
    bench = Workbench(study.parent)
    bench.open(study)
    with pytest.raises(Given, match="never changed"):
        bench.save()


def test_work_that_fails_leaves_what_was_there(study, tmp_path):
    bench = Workbench(tmp_path / "app")
    bench.open(study)
    step = bench.step

    def give_up(text):
        raise KeyboardInterrupt
    with pytest.raises(KeyboardInterrupt):
        bench.add("viscous", "1A", progress=give_up)
    with pytest.raises(PycosimError):
        bench.open(tmp_path / "none.toml")
    assert bench.step is step


def test_the_command_line_refuses_a_taken_port_and_a_bad_study(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        assert main(["app", "--port", port, "--no-browser"]) == 2
        told = capsys.readouterr().err
        assert f"port {port} cannot be used" in told and told.count("\n") == 1
    assert main(["app", "none.toml", "--port", port, "--no-browser"]) == 2
    assert "no study none.toml" in capsys.readouterr().err

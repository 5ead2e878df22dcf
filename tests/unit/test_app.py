"""Claims about the app without a page: one state and one job for all tabs, steps go forth and back, the study stays."""

import socket
import threading
from dataclasses import replace

import pytest

from pycosim.app.jobs import Cancelled, Job
from pycosim.app.session import BUSY, Session, place_of
from pycosim.app.workbench import Given, Workbench
from pycosim.cli import demo
from pycosim.cli.entry import main
from pycosim.compile import Library
from pycosim.core.errors import PycosimError
from pycosim.report.folder import Folder
from pycosim.study.parse import load_study

DRAG = """model QuadraticDrag "Friction that grows with the square of the speed"
  extends DriveTrain.Interfaces.SegmentEffect(dF=k * friction.w^2);
  parameter Real k(unit="N.m.s2/rad2", min=0, max=1, nominal=1e-3) = 0 "Drag coefficient";
  annotation(__pycosim(size="k", needs="speeds", experiment="repeat the passes at three or more speeds"));
end QuadraticDrag;
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("app") / "hidden"
    with Folder(folder, "demo") as made:
        demo._make(Library(), made, speeds=(0.4, 1.6), longest=2.0)
    return folder / "study.toml"


@pytest.mark.slow
def test_the_loop_goes_forth_and_back(study, tmp_path):
    bench = Workbench(tmp_path / "app")
    with pytest.raises(Given, match="no data are read yet"):
        bench.diagnose()
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


@pytest.mark.long
def test_a_region_says_what_its_error_depends_on(study, tmp_path):
    bench = Workbench(tmp_path / "app")
    bench.open(study)
    found = bench.region(0, 1e9)
    assert found["energy"] == pytest.approx(1) and found["depends"][0][1] > 0.05
    with pytest.raises(Given, match="moving samples"):
        bench.region(0, 0.1)


@pytest.mark.long
def test_the_given_study_is_never_written_over(study):
    bench = Workbench(study.parent)
    bench.open(study)
    with pytest.raises(Given, match="never changed"):
        bench.save()


@pytest.mark.slow
def test_an_effect_of_one_s_own_joins_the_candidates_and_a_slip_in_it_is_told(study, tmp_path):
    bench = Workbench(tmp_path / "app")
    bench.open(study)
    bench.add("stribeck", "2A")
    error, own = bench.step.error, tmp_path / "drag.mo"
    for path, text, told in (("", None, "no file is named"), (tmp_path / "none.mo", None, "none.mo"),
                             (own, DRAG.replace("friction.w^2", "sped^2"), "'QuadraticDrag' does not compile: 'sped'")):
        if text:
            own.write_text(text)
        with pytest.raises(PycosimError, match=told):
            bench.own(path)
        assert len(bench.steps) == 2 and bench.study.modelica == []
    own.write_text(DRAG)
    bench.own(own)
    assert bench.step.error == pytest.approx(error, rel=1e-3)  # what was added stays
    bench.add("quadratic_drag", "1A")
    saved = load_study(bench.save())
    assert saved.modelica == [own] and saved.effects == [("stribeck", "2A"), ("quadratic_drag", "1A")]


@pytest.mark.long
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


# --- the session: what all tabs show ------------------------------------------------------------------------------


def test_a_job_tells_what_is_done_and_what_is_left():
    job = Job("open", ("reading", "checking", "fitting"))
    assert (job.done, job.left) == ((), ("reading", "checking", "fitting"))
    job("checking the logs")
    assert (job.done, job.left) == (("reading",), ("fitting",)) and job.told == "checking the logs (0 s)"
    job("something else")  # no stage of it
    assert job.done == ("reading",)
    job.cancelled = True
    with pytest.raises(Cancelled):
        job("fitting")


def test_one_piece_of_work_goes_on_and_another_is_refused_at_its_button(tmp_path):
    session, go, seen = Session(Workbench(tmp_path)), threading.Event(), []

    def work(progress):
        progress("working")
        seen.append(session.job)
        go.wait(10)
        progress("still working")
    first = session.start("diagnose", work, after=("diagnosis",))
    assert session.start("plan", work) is None and session.errors == {"plan": BUSY}
    session.cancel()
    go.set()
    first.join(10)
    assert session.job is None and len(seen) == 1
    assert session.errors["diagnose"].startswith("Given up") and not session.changed["diagnosis"]
    session.start("plan", lambda progress: None, after=("plan",)).join(10)
    assert session.errors == {} and session.changed["plan"] == 1


def test_what_fails_stands_at_the_button_that_caused_it(tmp_path):
    session = Session(Workbench(tmp_path))
    session.start("open", session.bench.open, tmp_path / "none.toml", None).join(20)
    assert list(session.errors) == ["open"] and "no study" in session.errors["open"]
    session.use(tmp_path / "none.csv")
    assert "no log" in session.errors["log"] and session.changed["log"] == 0
    session.start("open", lambda progress: 1 / 0).join(10)
    assert "this is a fault of pycosim" in session.errors["open"]


@pytest.mark.long
def test_a_dropped_log_is_mapped_by_answers_and_compared(study, tmp_path):
    session = Session(Workbench(tmp_path / "app"))
    session.use(study.parent / "run.csv")
    assert session.likely == ["HipKnee", "HipKneeTransmission"] and session.rig == demo.RIG
    places = [place_of(q) for q in session.proposal.questions]
    assert places == ["unit theta1", "unit tau1", "unit C_H"]
    session.map("unknown")
    assert session.errors["map"] == "3 questions are open, beside the fields above" and session.job is None
    session.answer(session.proposal.questions[0], "rad")
    assert len(session.proposal.questions) == 2
    before = session.given
    session.tell("unit motor1.phi", before.with_column("theta1", variable="motor1.phi", unit="N.m"))
    assert "does not fit" in session.errors["unit motor1.phi"] and session.given is before  # nothing of it was taken
    session.tell("si", replace(before, si=True))
    assert not session.proposal.questions and session.changed["answers"] == 3
    session.choose("DriveTrain.Rigs.GearedJoint")
    assert session.proposal.questions and session.model.rig.endswith("GearedJoint")
    session.choose(demo.RIG)
    session.map("gravity_model")
    while session.job is not None:
        session.job and threading.Event().wait(0.1)
    assert session.bench.steps and session.changed["steps"] == 1 and not session.errors
    assert session.bench.study.reference == "gravity_model"


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

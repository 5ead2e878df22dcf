"""Claims about a partial answer: it names what the tests then confirm, and reaches whoever waits."""

import io
import sys

import pandas as pd
import pytest

from pycosim.app.jobs import Job
from pycosim.app.workbench import Workbench
from pycosim.cli.progress import Progress
from pycosim.core.early import tell_early
from pycosim.diagnosis import decide
from pycosim.diagnosis.first_look import first_look, told
from pycosim.diagnosis.table import Table
from pycosim.project import open_project
from pycosim.project.progress import Continued


@pytest.mark.long
def test_it_names_the_hidden_effect_first_and_nothing_once_that_is_in(searched):
    dataset, improvement = searched
    before, after = (first_look(Table(dataset, s.model, s.fit)) for s in improvement.steps)
    assert (before[0].effect, before[0].place) == improvement.steps[1].added and 0.3 < before[0].share < 1
    assert [f.share for f in before] == sorted((f.share for f in before), reverse=True)
    assert len({f.effect for f in before}) == len(before)
    assert after == []


@pytest.mark.long
def test_it_is_told_in_words_before_the_tests_and_only_to_who_listens(searched):
    dataset, improvement = searched
    first = improvement.steps[0]

    class Stop(Exception):
        pass

    class Listener:
        def __init__(self):
            self.stages, self.known = [], []

        def __call__(self, text):
            if text.startswith("refitting"):
                raise Stop
            self.stages.append(text)

        def early(self, text):
            self.known.append(text)

    listener = Listener()
    with pytest.raises(Stop):
        decide.diagnose(dataset, first.model, first.fit, progress=listener)
    assert len(listener.known) == 1 and "stribeck at 2A (" in listener.known[0]
    assert f"C_H {first.fit.error['C_H']:.3g} N.m" in listener.known[0] and "decide" in listener.known[0]
    tell_early(print, "nobody listens")
    assert told([], {"x": 0.5}, {"x": "1"}).startswith("First look: the error is x 0.5; no effect alone")


def test_the_app_s_job_keeps_it_and_a_terminal_has_it_on_a_line_of_its_own(tmp_path, monkeypatch):
    bench, job = Workbench(tmp_path), Job("diagnose")
    bench._say.early("before any work")  # nobody waits
    bench._say.listener = job
    bench._say("testing")
    bench._say.early("likely this")
    assert (job.text, job.known) == ("testing", ["likely this"])

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr("sys.stderr", Terminal())
    progress = Progress(False)
    progress.early("likely this")
    progress("testing")
    line, stage = sys.stderr.getvalue().split("\n")
    assert "likely this (0 s)" in line and "testing" in stage
    monkeypatch.setattr("sys.stderr", io.StringIO())
    Progress(False).early("piped")
    assert sys.stderr.getvalue() == ""


class Stages:
    """What long work says, in order; partial answers marked."""

    def __init__(self):
        self.heard = []

    def __call__(self, text):
        self.heard.append(text)

    def early(self, text):
        self.heard.append(f"early: {text}")


@pytest.mark.slow
@pytest.mark.long
def test_a_project_tells_it_before_the_check_and_a_diagnosis_of_the_same_fit_does_not_again(hidden):
    say = Stages()
    project = open_project(hidden / "study.toml", progress=say)
    lines = project.first_look()
    project.check()
    told = [k for k, text in enumerate(say.heard) if text.startswith("early: ")]
    assert len(told) == 1 and told[0] < say.heard.index("checking the logs")
    size, depends, likely = lines
    error, floor = project.fit().solution.error["C_H"], project.fit().diagnose().found.noise_floor["C_H"]
    assert f"C_H errs by {error:.3g} N.m, {error / floor:.1f} times its noise floor" in size
    assert "speed of 2A" in depends and "stribeck at 2A (" in likely and likely.endswith("provisional.")
    assert project.first_look() is lines and sum(text.startswith("early: ") for text in say.heard) == 1
    for several, last in ((True, "of a third"), (False, "of another model")):
        again = Continued(say, False, several)
        again.early("of another model")
        again.early("of a third")
        assert say.heard[-1] == f"early: {last}"


@pytest.mark.long
def test_the_app_keeps_it_but_not_of_a_log_that_is_mixed_up(hidden, tmp_path):
    bench, job = Workbench(tmp_path), Job("open")
    bench.open(hidden / "study.toml", progress=job)
    assert " ".join(bench.first) == job.known[0]
    mixed = tmp_path / "mixed.csv"
    pd.read_csv(hidden / "run.csv").assign(tau1=lambda f: -f["tau1"]).to_csv(mixed, index=False)
    bench.open(hidden / "study.toml", [mixed])
    assert bench.first == [] and any("tau1" in line for line in bench.told)

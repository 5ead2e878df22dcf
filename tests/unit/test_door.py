"""Claims about the front door: what it offers, that nothing changes in place, and that its examples run."""

import doctest
import importlib
import json
import pkgutil
import subprocess
import sys
from dataclasses import FrozenInstanceError, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes

import pycosim as pc
import pycosim.project
from pycosim.core.errors import DataError, StudyError, UnknownNameError
from pycosim.project import open_project
from pycosim.report import records
from pycosim.study.parse import load_study

ROOT = Path(__file__).parents[2]
MODULES = [m.name for m in pkgutil.iter_modules(pycosim.project.__path__, "pycosim.project.")]


@pytest.fixture(scope="module")
def project(hidden):
    return pc.open(hidden / "study.toml")


@pytest.fixture(scope="module")
def search(project):
    return project.improve()


@pytest.mark.parametrize("module", MODULES)
def test_the_examples_of_docstrings_run(module, project, hidden, monkeypatch):
    def once(study, data=None):  # an example opens the study anew, and the tests need not compute all of it anew
        return project if data is None else open_project(study, data)
    monkeypatch.setattr(pycosim.project, "open_project", once)
    monkeypatch.chdir(hidden)
    assert not doctest.testmod(importlib.import_module(module)).failed


def test_importing_is_quick_and_asks_for_nothing_heavy():
    code = ("import sys, time; t = time.perf_counter(); import pycosim; pycosim.__version__; dir(pycosim);"
            "print(time.perf_counter() - t, *({'numpy', 'casadi', 'pandas', 'matplotlib'} & set(sys.modules)))")
    seconds, *heavy = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True,
                                     check=True).stdout.split()
    assert float(seconds) < 0.1 and not heavy


def test_what_it_offers_is_there_and_nothing_else():
    assert all(getattr(pc, name) is not None for name in pc.__all__) and set(pc.__all__) <= set(dir(pc))
    with pytest.raises(AttributeError, match="no attribute 'opne'"):
        pc.opne  # noqa: B018


def test_a_mistyped_parameter_is_refused_here_too(hidden, tmp_path):
    text = (hidden / "study.toml").read_text().replace('"s1A.f0"', '"s1A.fo"')
    (tmp_path / "study.toml").write_text(text)
    with pytest.raises(UnknownNameError, match="no parameter 's1A.fo'.*closest: 's1A.f0'"):
        pc.open(tmp_path / "study.toml")
    with pytest.raises(UnknownNameError, match="closest: 's1A.f0'"):  # nor from a study in memory
        study = load_study(hidden / "study.toml")
        pc.open(replace(study, parameters={"s1A.fo": study.parameters["s1A.f0"]}))


def test_a_table_in_memory_is_a_log(project, hidden):
    table = pd.read_csv(hidden / "run.csv")
    by_file, by_table = project.fit(), pc.open(hidden / "study.toml", data=table).fit()
    assert by_table.error == by_file.error
    indexed = project.with_data({"monday": table.set_index("time")})
    assert indexed.fit().error == by_file.error and indexed.dataset.logs[0].name == "monday"
    two = project.with_data([hidden / "run.csv", table])
    assert len(two.dataset.logs) == 2 and two.fit().params["s1A.f0"].stderr < by_file.params["s1A.f0"].stderr
    with pytest.raises(DataError, match="table, column 'tau1': holds .*, not numbers"):
        project.with_data(table.assign(tau1="x")).fit()
    with pytest.raises(DataError, match="no column 'theta1'"):
        project.with_data(table.drop(columns="theta1")).fit()


def test_a_table_in_memory_does_not_follow_later_changes(hidden):
    table = pd.read_csv(hidden / "run.csv")
    opened = pc.open(hidden / "study.toml", data=table)
    table["tau1"] = np.nan
    assert np.isfinite(opened.fit().error["C_H"])


def test_nothing_is_changed_in_place(project):
    fit = project.fit()
    with pytest.raises(FrozenInstanceError):
        project.study = None
    with pytest.raises(FrozenInstanceError):
        fit.solution = None
    before = fit.to_frame().copy(), list(fit.effects), project.to_frame().copy()
    better = fit.add("stribeck@2A")
    assert better is not fit and better.effects == ["stribeck@2A"]
    pd.testing.assert_frame_equal(fit.to_frame(), before[0])
    assert fit.effects == before[1] == [] and project.study.effects == []
    with pytest.raises(StudyError, match="is in the model already"):
        better.add("stribeck@2A")


def test_parameters_have_value_interval_and_unit(project):
    fit = project.fit()
    p = fit.params["s1A.mu"]
    assert p.ci95[0] <= p.value <= p.ci95[1] and p.unit == "1" and float(p) == p.value
    assert fit.params["s2B.f0"].at_bound == "min" and fit.params["s2B.f0"].stderr == np.inf
    frame = fit.to_frame()
    assert list(frame.index) == list(fit.params) and frame.loc["s1A.mu", "value"] == p.value
    with pytest.raises(UnknownNameError, match="no fitted parameter 's1A.nu'; closest: 's1A.mu'"):
        fit.params["s1A.nu"]


def test_a_diagnosis_is_a_verdict_a_table_and_sentences(project):
    found = project.diagnose()
    assert found.verdict == "missing_effect" and found.best.name == "stribeck@2A" and found.best.p_value < 0.01
    frame = found.candidates.to_frame()
    assert frame.index[0] == "stribeck@2A" and frame.accepted.sum() == 1 and len(frame) == len(found.candidates)
    assert found.candidates["stribeck@2A"].coefficients["fs"]["unit"] == "N.m"
    assert found.best.add().error == project.fit().add("stribeck@2A").error
    assert any("stribeck at 2A" in line for line in found.sentences)
    with pytest.raises(UnknownNameError, match="closest: 'stribeck@2A'"):
        found.candidates["stribek@2A"]


def test_telling_a_result_does_not_change_it(project):
    found = project.diagnose()
    scored = [c for c in found.found.candidates if c.fit is None]
    before = [dict(c.coefficients) for c in scored]
    told = found.to_dict(), found.sentences, found._repr_html_(), repr(found.to_frame())
    assert all(told) and scored and [dict(c.coefficients) for c in scored] == before
    assert any(c["coefficients"] and not c["refitted"] for c in found.to_dict()["candidates"])


def test_a_search_is_reported_saved_and_opened_again(search, tmp_path):
    assert search.added == ["stribeck@2A"] and search.verdict == "nothing_missing"
    frame = search.to_frame()
    assert frame.error_C_H[1] < 0.6 * frame.error_C_H[0]
    page = search.report(tmp_path / "report.html", tmp_path / "data")
    assert page.read_text().startswith("<!DOCTYPE html>") and list((tmp_path / "data").glob("*.csv"))
    again = pc.open(search.save(tmp_path / "improved.toml"))
    assert again.study.effects == [("stribeck", "2A")]
    assert again.as_given().error["C_H"] == pytest.approx(search.final.error["C_H"], rel=1e-4)
    with pytest.raises(StudyError, match="cannot be written"):
        search.report(tmp_path / "no" / "report.html")


def test_the_given_study_is_never_changed(project, hidden):
    before = (hidden / "study.toml").read_text()
    with pytest.raises(StudyError, match="never changed"):
        project.fit().save(hidden / "study.toml")
    assert (hidden / "study.toml").read_text() == before


def test_plots_give_axes_to_go_on_with(project, search):
    fit, found = project.fit(), project.diagnose()
    one = fit.plot.residuals(over="speed@2A", channel="C_H")
    assert isinstance(one, Axes) and "2A" in one.get_xlabel()
    several = [fit.plot.residuals(), fit.plot.over_time(), fit.plot.where_it_fails(), fit.plot.manoeuvres(),
               search.plot.signature(), found.best.plot()]
    assert all(isinstance(a, Axes) for axes in several for a in np.ravel(axes))
    assert all(isinstance(a, Axes) for a in (search.plot.path(), fit.plot.map(), fit.plot.intervals(),
                                             found.plot.candidates()))
    with pytest.raises(UnknownNameError, match="closest: 'speed@2A'"):
        fit.plot.residuals(over="sped@2A")
    with pytest.raises(pc.PycosimError, match="no step 2: 1 effects were added"):
        search.plot.signature(2)
    with pytest.raises(pc.PycosimError, match="missing_effect"):
        found.plot.unexplained()


def test_every_object_shows_in_a_line_and_as_a_table(project, search):
    fit, found = project.fit(), project.diagnose()
    for thing in (project, project.check(), fit, fit.params, fit.params["s1A.f0"], fit.compare(), found, found.best,
                  found.candidates, search, search.steps[1]):
        text = repr(thing)
        assert "\n" not in text and text.startswith(f"<{type(thing).__name__}: ") and len(text) < 400
        assert "<table" in thing._repr_html_() and isinstance(thing.to_frame(), pd.DataFrame)


def test_what_a_verb_writes_an_object_saves(project, tmp_path):
    compared, found = project.compare(), project.diagnose()
    for thing, name in ((compared, "comparison"), (found, "diagnosis"), (project.check(), "check")):
        kept = thing.save(tmp_path / f"{name}.json")
        assert json.loads(kept.read_text()) == json.loads(records.to_json(thing.to_dict()))
    again = pc.Comparison.load(tmp_path / "comparison.json")
    assert repr(again) == repr(compared) and again.to_frame().equals(compared.to_frame())
    with pytest.raises(pc.PycosimError, match="is no comparison.json"):
        pc.Comparison.load(tmp_path / "diagnosis.json")
    with pytest.raises(pc.PycosimError, match="cannot be written"):
        found.save(tmp_path / "nowhere" / "diagnosis.json")


def test_errors_have_dimensions(project):
    pytest.importorskip("xarray")
    compared = project.compare()
    found = compared.to_xarray()
    assert set(found["manoeuvre"].dims) == {"manoeuvre group", "channel"}
    one = compared.record["by"]["manoeuvre"]["A"]["C_H"]
    assert float(found["manoeuvre"].sel({"manoeuvre group": "A", "channel": "C_H"})) == one


def test_an_export_takes_the_fitted_values(search, tmp_path):
    made = search.final.export(tmp_path / "out", to="json")
    fitted = search.final.params["s1A.f0"].value
    told = {v["name"]: v["start"] for v in made.description["variables"] if v["name"] == "s1A.f0"}
    assert told["s1A.f0"] == pytest.approx(fitted, rel=1e-6) and (tmp_path / "out" / "export.json").exists()


def test_an_export_brings_the_library_along_where_that_is_asked_for(project, tmp_path):
    made = [project.export(tmp_path / str(whole), to="modelica", self_contained=whole) for whole in (False, True)]
    texts = [(tmp_path / str(whole) / m.files[0]).read_text() for whole, m in zip((False, True), made)]
    assert ["package DriveTrain" in text for text in texts] == [False, True]

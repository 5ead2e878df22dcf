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
from pycosim.data.checks.finding import SURE
from pycosim.diagnosis.scores import LEVEL
from pycosim.diagnosis.search import MOST as search_most
from pycosim.project import open_project
from pycosim.report import records
from pycosim.study.parse import load_study

ROOT = Path(__file__).parents[2]
MODULES = [m.name for m in pkgutil.iter_modules(pycosim.project.__path__, "pycosim.project.")]
SEARCHING = ("pycosim.project.fitted", "pycosim.project.project")   # their examples search


@pytest.fixture(scope="module")
def project(hidden):
    return pc.open(hidden / "study.toml")


@pytest.fixture(scope="module")
def search(project):
    return project.improve()


@pytest.mark.parametrize("module", [
    pytest.param(m, marks=pytest.mark.long if m in SEARCHING else []) for m in MODULES])
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


def test_a_table_in_memory_is_a_log(project, hidden, tmp_path):
    table = pd.read_csv(hidden / "run.csv")
    by_file, by_table = project.fit(), pc.open(hidden / "study.toml", data=table).fit()
    assert by_table.error == by_file.error
    indexed = project.with_data({"monday": table.set_index("time")})
    assert indexed.fit().error == by_file.error and indexed.dataset.logs[0].name == "monday"
    half = len(table) // 2
    table[:half].to_csv(tmp_path / "half.csv", index=False)
    two = project.with_data([tmp_path / "half.csv", table[half:]])
    assert [log.name for log in two.dataset.logs] == ["half.csv", "table"] and np.isfinite(two.fit().error["C_H"])
    with pytest.raises(DataError, match="table, column 'tau1': holds .*, not numbers"):
        project.with_data(table.assign(tau1="x")).fit()
    with pytest.raises(DataError, match="no column 'theta1'"):
        project.with_data(table.drop(columns="theta1")).fit()


def test_a_table_in_memory_does_not_follow_later_changes(hidden):
    table = pd.read_csv(hidden / "run.csv")
    opened = pc.open(hidden / "study.toml", data=table)
    table["tau1"] = np.nan
    assert np.isfinite(opened.fit().error["C_H"])


@pytest.mark.long
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


def test_draws_are_a_table(project):
    fit = project.fit()
    drawn = fit.draw(20, seed=3)
    assert list(drawn.to_frame().columns) == list(fit.params) and len(drawn.to_frame()) == 20
    assert (drawn.array(["s1A.mu"])[:, 0] == drawn.to_frame()["s1A.mu"]).all()
    arrays = drawn.to_xarray()
    assert arrays.dims == ("set", "parameter") and (arrays.sel(parameter="s1A.mu") == drawn.to_frame()["s1A.mu"]).all()
    assert repr(drawn).startswith(f"<Draws: 20 sets of {len(fit.params)} parameters")
    assert "<table" in drawn._repr_html_()
    with pytest.raises(FrozenInstanceError):
        drawn.values = None


@pytest.mark.long
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


@pytest.mark.long
def test_telling_a_result_does_not_change_it(project):
    found = project.diagnose()
    scored = [c for c in found.found.candidates if c.fit is None]
    before = [dict(c.coefficients) for c in scored]
    told = found.to_dict(), found.sentences, found._repr_html_(), repr(found.to_frame())
    assert all(told) and scored and [dict(c.coefficients) for c in scored] == before
    assert any(c["coefficients"] and not c["refitted"] for c in found.to_dict()["candidates"])


@pytest.mark.long
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


@pytest.mark.long
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


@pytest.mark.long
def test_every_object_shows_in_a_line_and_as_a_table(project, search):
    fit, found = project.fit(), project.diagnose()
    for thing in (project, project.check(), fit, fit.params, fit.params["s1A.f0"], fit.compare(), found, found.best,
                  found.candidates, search, search.steps[1]):
        text = repr(thing)
        assert "\n" not in text and text.startswith(f"<{type(thing).__name__}: ") and len(text) < 400
        assert "<table" in thing._repr_html_() and isinstance(thing.to_frame(), pd.DataFrame)


def recorded(project, search):
    """Every result that has a file of its own, by the name of that file; a plan has its test beside the planner."""
    return {"check": project.check(), "comparison": project.fit().compare(given=True), "parameters": search.final,
            "diagnosis": project.diagnose(), "diagnosis_final": search.last, "search": search}


@pytest.mark.long
def test_what_is_saved_is_loaded_and_shows_the_same(project, search, tmp_path):
    for name, thing in recorded(project, search).items():
        kept = thing.save(tmp_path / f"{name}.json")
        assert json.loads(kept.read_text()) == json.loads(records.to_json(thing.record))
        again = type(thing).load(kept)
        assert again.record == thing.record and again.to_dict() == thing.to_dict()
        assert repr(again) == repr(thing) and again._repr_html_() == thing._repr_html_()
        assert again.sentences == thing.sentences
        pd.testing.assert_frame_equal(again.to_frame(), thing.to_frame())
        with pytest.raises(FrozenInstanceError):
            again.kept = None
        again.to_dict().clear()
        assert again.save(tmp_path / "again.json").read_text() == kept.read_text()


@pytest.mark.long
def test_a_loaded_result_answers_what_its_file_holds_and_says_what_needs_the_log(project, search, tmp_path):
    again = {n: type(t).load(t.save(tmp_path / f"{n}.json")) for n, t in recorded(project, search).items()}
    found, fit, whole = again["diagnosis"], again["parameters"], again["search"]
    assert found.best.name == "stribeck@2A" and found.best.coefficients == project.diagnose().best.coefficients
    assert fit.params["s2A.mu"] == search.final.params["s2A.mu"] and fit.effects == ["stribeck@2A"]
    assert fit.undetermined == search.final.undetermined
    base = pc.Fitted.load(project.fit().save(tmp_path / "base.json"))
    assert dict(base.params) == dict(project.fit().params) and base.params["s2B.f0"].stderr == np.inf
    assert [s.added for s in whole.steps] == [None, "stribeck@2A"] and whole.last.final
    pd.testing.assert_frame_equal(whole.steps[1].to_frame(), search.steps[1].to_frame())
    assert not again["check"].blocking and again["check"].told == project.check().told
    again["check"].refuse()
    for drawn in (found.plot.candidates, fit.plot.intervals, whole.plot.path):
        assert isinstance(drawn(), Axes)
    for asked in (found.best.add, found.best.plot, found.plot.unexplained, fit.plot.residuals, fit.diagnose,
                  fit.compare, whole.plot.signature, whole.files, lambda: fit.add("viscous@1A"),
                  lambda: fit.held_out_error, lambda: whole.report(tmp_path / "page.html"),
                  lambda: whole.save(tmp_path / "study.toml")):
        with pytest.raises(pc.ResultError, match=r"json: a file of results holds no log .* pycosim.open\(\)"):
            asked()
    assert not (tmp_path / "page.html").exists()


@pytest.mark.long
def test_the_folder_of_a_search_is_loaded_as_well(search, tmp_path):
    for name, content in search.files().items():
        (tmp_path / name).write_text(content if isinstance(content, str) else records.to_json(content))
    again = pc.Search.load(tmp_path)
    assert repr(again) == repr(search) and again.sentences == search.sentences
    (tmp_path / "ladder.json").unlink()
    with pytest.raises(pc.ResultError, match="ladder.json: cannot be read"):
        pc.Search.load(tmp_path)


def test_a_log_with_a_mistake_is_refused_by_its_loaded_check_too(project, tmp_path):
    from pycosim.data.checks import Checked, Finding
    wrong = Finding("sign", "tau1 has the wrong sign", ["tau1"], 0.97, mend="tau1 = 1", times=[[0.0, 1.5]])
    made = pc.Check(Checked([wrong], ["swap"]), project.study)
    again = pc.Check.load(made.save(tmp_path / "check.json"))
    assert again.blocking and again.sentences == made.sentences and again.to_frame().equals(made.to_frame())
    with pytest.raises(DataError, match="check.json: tau1 has the wrong sign .*accept"):
        again.refuse()
    answered = pc.Check(Checked([wrong], ["sign"]), project.study)
    assert not pc.Check.load(answered.save(tmp_path / "check.json")).blocking


@pytest.mark.long
def test_a_result_names_the_thresholds_that_decided_it(project, search):
    told = {name: thing.record["thresholds"] for name, thing in recorded(project, search).items()
            if name not in ("comparison", "search")} | {"ladder": search.to_dict()["thresholds"]}
    assert told["diagnosis"]["level"]["value"] == LEVEL and told["ladder"]["most"]["value"] == search_most
    assert told["check"]["stops"]["value"] == SURE
    for table in told.values():
        assert all(isinstance(t["value"], (int, float)) and len(t["means"].split()) > 3 for t in table.values())


@pytest.mark.long
def test_what_a_stranger_writes_into_a_result_stays_text_in_a_notebook(project, tmp_path):
    record = project.diagnose().to_dict()
    record["candidates"][0] |= {"effect": "<script>x</script>", "accepted": True}
    (tmp_path / "diagnosis.json").write_text(records.to_json(record))
    shown = pc.Diagnosis.load(tmp_path / "diagnosis.json")._repr_html_()
    assert "<script>" not in shown and shown.count("&lt;script&gt;") >= 2


def broken(record):
    """Ways in which a file of results is none."""
    text = records.to_json(record)
    inside = {**record, **{k: 7 for k in ("candidates", "findings", "parameters", "by", "ladder") if k in record}}
    return {"cut off": (text[:len(text) // 2], "no whole file of JSON beyond line"),
            "empty": ("", "no whole file of JSON"), "endless": ("[" * 100_000, "no whole file of JSON"),
            "no text": (b"\xff\xfe\x00", "no whole file of JSON"),
            "of a newer schema": (records.to_json({**record, "schema": 2}), "has schema 2, and this pycosim knows 1"),
            "a list": ("[1, 2]", "is no "), "foreign": ('{"schema": "https://x.org", "error": 1}', "is no "),
            "of another shape": (records.to_json(inside), "something in it is missing or of another kind")}


@pytest.mark.long
def test_a_file_that_is_no_result_is_refused_in_a_sentence(project, search, tmp_path):
    path = tmp_path / "result.json"
    things = recorded(project, search)
    for thing in things.values():
        for content, why in broken(thing.record).values():
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
            with pytest.raises(pc.ResultError, match=why) as told:
                type(thing).load(path)
            assert str(told.value).startswith(str(path)) and "\n" not in str(told.value)
    things["comparison"].save(path)
    with pytest.raises(pc.ResultError, match="is no diagnosis.json.*; it is a comparison.json, which "
                                             "pycosim.Comparison.load reads"):
        pc.Diagnosis.load(path)
    with pytest.raises(pc.ResultError, match="nowhere.json: cannot be read"):
        pc.Check.load(tmp_path / "nowhere.json")
    with pytest.raises(pc.PycosimError, match="cannot be written"):
        things["diagnosis"].save(tmp_path / "nowhere" / "diagnosis.json")


def test_errors_have_dimensions(project):
    pytest.importorskip("xarray")
    compared = project.compare()
    found = compared.to_xarray()
    assert set(found["manoeuvre"].dims) == {"manoeuvre group", "channel"}
    one = compared.record["by"]["manoeuvre"]["A"]["C_H"]
    assert float(found["manoeuvre"].sel({"manoeuvre group": "A", "channel": "C_H"})) == one


@pytest.mark.long
def test_an_export_takes_the_fitted_values(search, tmp_path):
    made = search.final.export(tmp_path / "out", to="json")
    fitted = search.final.params["s1A.f0"].value
    told = {v["name"]: v["start"] for v in made.record["variables"] if v["name"] == "s1A.f0"}
    assert told["s1A.f0"] == pytest.approx(fitted, rel=1e-6)
    assert made.to_frame().loc["s1A.f0", ["start", "unit"]].tolist() == [told["s1A.f0"], "N.m"]
    again = pc.Export.load(made.folder / "export.json")
    assert again.record == made.record and again.files == made.files and again.sentences == made.sentences
    assert repr(again) == repr(made) and len(repr(made)) < 200 and again._repr_html_() == made._repr_html_()
    pd.testing.assert_frame_equal(again.to_frame(), made.to_frame())
    with pytest.raises(pc.ResultError, match="is no diagnosis.json.*pycosim.Export.load reads"):
        pc.Diagnosis.load(made.save(tmp_path / "x.json"))
    with pytest.raises(FrozenInstanceError):
        made.folder = None


def test_an_export_as_c_is_an_object_too(project, tmp_path):
    made = project.export(tmp_path / "out", to="c")
    assert all((made.folder / f).is_file() for f in made.files) and made.sentences[0].startswith("C: ")
    assert made.to_frame().empty and pc.Export.load(tmp_path / "out" / "export.json").record == made.record


def test_an_export_brings_the_library_along_where_that_is_asked_for(project, tmp_path):
    made = [project.export(tmp_path / str(whole), to="modelica", self_contained=whole) for whole in (False, True)]
    texts = [(tmp_path / str(whole) / m.files[0]).read_text() for whole, m in zip((False, True), made)]
    assert ["package DriveTrain" in text for text in texts] == [False, True]


WRONG = {
    "no study": (lambda p, f: pc.open(None), 'None is no name of a file; give one as a text, "study.toml"'),
    "the text of a study": (lambda p, f: pc.open(p.study.path.read_text()), "a str of .* lines is no name of a file"),
    "a dict for a study": (lambda p, f: pc.open({"rig": "HipKnee"}), "is no name of a file"),
    "a number for data": (lambda p, f: p.with_data(3), "data is 3, neither a file nor a table; give a file"),
    "an array for data": (lambda p, f: p.with_data(np.zeros((9, 7))), "data is a ndarray, neither a file nor a table"),
    "a column for data": (lambda p, f: p.with_data(pd.Series([1.0])), "data is a Series, neither"),
    "bytes for data": (lambda p, f: p.with_data(b"run.csv"), "data is b'run.csv', neither"),
    "a dict of numbers": (lambda p, f: p.with_data({"a": 1}), r"data\['a'\] is 1, not a table"),
    "a list of numbers": (lambda p, f: p.with_data(["run.csv", 1]), r"data\[1\] is 1, neither"),
    "no effect": (lambda p, f: f.add(None), "None is no effect to add; give one, as \"stribeck@2A\""),
    "a list of effects": (lambda p, f: f.add(["stribeck@2A"]), r"\['stribeck@2A'\] is no effect to add"),
    "fewer sets than none": (lambda p, f: f.draw(-1), "must be a whole number, zero or more, as 100, not -1"),
    "a text of sets": (lambda p, f: f.draw("100"), "not '100'"),
    "half a set": (lambda p, f: f.draw(1.5), "not 1.5"),
    "a seed below zero": (lambda p, f: f.draw(3, seed=-1), "seed must be a whole number"),
    "no list of parameters": (lambda p, f: f.draw(3).array("s1A.f0"), "array takes a list of parameters"),
    "an unknown part": (lambda p, f: f.compare("foo"), "part = 'foo' is unknown; use 'fit' or 'test' or 'all'"),
    "a parameter by number": (lambda p, f: f.params[3], "no fitted parameter '3'"),
    "a plan of words": (lambda p, f: f.plan(budget="long"), "budget must be a number, as 120, not 'long'"),
    "an unknown criterion": (lambda p, f: f.plan(criterion="F"), "criterion = 'F' is unknown; use 'intervals' or"),
    "no pair": (lambda p, f: f.plan(between="stribeck@2A"), "between = 'stribeck@2A' must be two effects"),
    "an unknown fmi": (lambda p, f: f.export("out", fmi=5), "fmi = 5 is unknown; use 2 or 3"),
    "kinds as a text": (lambda p, f: f.export("out", kinds="cs"), "kinds = 'cs' must be a list"),
    "no folder": (lambda p, f: f.export(None), "None is no name of a file"),
    "no file to load": (lambda p, f: pc.Check.load(None), "None is no name of a file; give one as a text, \"check"),
    "no scenario": (lambda p, f: pc.cosimulate(None), "None is no name of a file"),
    "no place to compute": (lambda p, f: pc.computing(None).__enter__(), "no such place to compute"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_wrong_is_told_in_one_sentence(kind, project, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    ask, told = WRONG[kind]
    with pytest.raises(pc.PycosimError, match=told) as error:
        ask(project, project.fit())
    assert "\n" not in str(error.value) and len(str(error.value)) < 250 and not list(tmp_path.iterdir())


def test_complex_numbers_are_no_samples(project, hidden):
    table = pd.read_csv(hidden / "run.csv")
    with pytest.raises(DataError, match="column 'tau1': holds complex128, not numbers; convert it first, as with"):
        project.with_data(table.assign(tau1=table.tau1 + 1j)).check()


def test_nothing_but_what_is_of_the_same_kind_is_written_over(project, hidden, tmp_path):
    log, fit = tmp_path / "run.csv", project.fit()
    log.write_bytes((hidden / "run.csv").read_bytes())
    (tmp_path / "notes.toml").write_text("[notes]\n")
    (tmp_path / "notes.json").write_text("[1, 2]")
    for save, name, told in ((fit.save, "run.csv", "does not end in .toml, as a study does"),
                             (fit.save, "x.yaml", "save it as .*x.toml"),
                             (project.save, "s.json", "save it as .*s.toml"),
                             (fit.save, "notes.toml", "is there already and is not a study"),
                             (fit.save, "notes.json", "is there already and is not a parameters.json"),
                             (fit.compare().save, "run.csv", "does not end in .json, as a comparison.json does")):
        before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
        with pytest.raises(StudyError, match=told):
            save(tmp_path / name)
        assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before
    for name in ("found.toml", "found.json"):
        assert fit.save(tmp_path / name) == fit.save(tmp_path / name)

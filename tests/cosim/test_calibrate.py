"""Anyone's FMU, calibrated: made with other parameters, its log gives them back; what it cannot give is said."""

import json
import zipfile
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from fmpy import read_model_description
from fmpy.ssp.ssd import read_ssd
from fmpy.validation import validate_fmu
from matplotlib.axes import Axes

import pycosim as pc
from benchmarks.engines.foreign import MACHINES, c_fmu
from pycosim.cli.entry import main
from pycosim.core.errors import CosimulationError, DataError, StudyError
from pycosim.cosim.calibrate import calibrate
from pycosim.cosim.foreign import ForeignFmu
from pycosim.study.schema import Column, Setting, Study

KINDS = [(2, "cs", False), (3, "cs", False), (2, "me", False), (2, "me", True), (3, "me", True)]
TRUTH = {"mass": 1.3, "damping": 0.48, "stiffness": 9.2}
TIME = np.arange(200) * 0.03
INPUT = 0.5 * np.sign(np.sin(2 * TIME)) + 0.2 * np.sin(5 * TIME)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A small FMU in C by its kind."""
    found, folder = {}, tmp_path_factory.mktemp("fmus")

    def make(machine, *kind):
        key = machine, *kind
        if key not in found:
            found[key] = c_fmu(folder, machine, *kind)
        return found[key]
    return make


def study(folder, path, truth, free, noise=0.01, name="bench", seed=1):
    """A study whose log an FMU with other parameters made."""
    fmu = ForeignFmu(path)
    y = fmu.run(truth, TIME, {"u": INPUT}, ["y"])[0]
    fmu.close()
    y = y + noise * np.random.default_rng(seed).standard_normal(len(TIME))
    log = folder / f"{name}.csv"
    np.savetxt(log, np.c_[TIME, INPUT, y], delimiter=",", header="time,force,place", comments="")
    return Study(folder / f"{name}.toml", "FMU", runs=[log],
                 columns={"force": Column("u", "1"), "place": Column("y", "1")},
                 parameters={n: Setting(fixed=False) for n in free})


@pytest.mark.parametrize("kind", KINDS, ids=lambda k: "-".join(map(str, k)) if isinstance(k, tuple) else None)
def test_the_log_gives_the_parameters_back(made, tmp_path, kind):
    path = made("spring", *kind)
    assert not validate_fmu(str(path))
    found = calibrate(study(tmp_path, path, TRUTH, []), path)
    fit = found.fit
    for n, value in TRUTH.items():
        low, high = fit.interval(n, 0.999)
        assert low < value < high and high - low < 0.2 * value and fit.identifiable(n)
    assert found.after["fit"]["y"] == pytest.approx(0.01, rel=0.15) and found.before["fit"]["y"] > 0.05
    assert ("directional" in found.method) == kind[2]


def test_directional_derivatives_are_those_of_differences(made):
    fmu = ForeignFmu(made("tank", 3, "me", True))
    values, free = {"area": 1.4, "pump": 0.9, "outlet": 0.6, "x0": 1.1}, ["area", "pump", "outlet", "x0"]
    y, own = fmu.slopes(values, free, TIME, {"u": INPUT}, ["y", "x0"])
    assert fmu.directional
    other = fmu._differences(values, free, TIME, {"u": INPUT}, ["y", "x0"])
    fmu.close()
    assert np.abs(own - other).max() < 1e-5 * np.abs(other).max() and np.allclose(y[0], y[1])


def test_what_the_log_cannot_tell_is_a_null_direction(made, tmp_path):
    """The level of the tank depends on ratios of its parameters alone."""
    path = made("tank", 2, "cs", False)
    fit = calibrate(study(tmp_path, path, {"area": 1.5, "pump": 0.7, "outlet": 0.75}, []), path).fit
    direction, = fit.null_directions
    ratio = direction / fit.values
    assert np.allclose(ratio, ratio[0], rtol=1e-2) and not any(fit.identifiable(n) for n in fit.free)
    two = calibrate(study(tmp_path, path, {"pump": 0.7, "outlet": 0.75}, ["pump", "outlet"]), path).fit
    assert len(two.null_directions) == 0 and two.interval("pump")[0] < 0.7 < two.interval("pump")[1]


def test_the_command_line_leaves_sets_system_and_an_fmu_that_starts_there(made, tmp_path, monkeypatch, capsys):
    for fmi in (2, 3):
        path = made("spring", fmi, "cs", False)
        own = study(tmp_path, path, TRUTH, [])
        own.path.write_text(f"[rig]\nmodel = 'FMU'\n[data]\nruns = ['{own.runs[0]}']\n[columns]\n"
                            "force = { variable = 'u', unit = '1' }\nplace = { variable = 'y', unit = '1' }\n"
                            "[parameters]\nmass = { fixed = false, max = 5 }\ndamping = { fixed = false }\n"
                            "stiffness = { fixed = false }\n")
        monkeypatch.chdir(tmp_path)
        assert main(["identify", str(own.path), "--fmu", str(path), "--out", f"out{fmi}"]) == 0
        assert "Derivatives: central differences" in capsys.readouterr().out
        out = tmp_path / f"out{fmi}"
        result = json.loads((out / "parameters.json").read_text())
        assert result["parameters"]["mass"]["ci95"][0] < 1.3 < result["parameters"]["mass"]["ci95"][1]
        errors = json.loads((out / "comparison.json").read_text())
        assert pc.Calibration.load(out / "parameters.json").comparison == errors
        assert errors["after"]["fit"]["y"] < 0.2 * errors["before"]["fit"]["y"]
        new = out / f"{path.stem}_calibrated.fmu"
        assert not validate_fmu(str(new))
        starts = {v.name: v.start for v in read_model_description(str(new)).modelVariables}
        old = {v.name: v.start for v in read_model_description(str(path)).modelVariables}
        for n, p in result["parameters"].items():
            assert float(starts.pop(n)) == p["value"]
            old.pop(n)
        assert starts == old
        system = read_ssd(str(out / "calibrated.ssp"))
        assert [c.name for c in system.system.elements] == ["model"]
        with zipfile.ZipFile(out / "calibrated.ssp") as archive:
            assert archive.read("resources/calibrated.ssv") == (out / "calibrated.ssv").read_bytes()
            assert archive.read(f"resources/{path.name}") == path.read_bytes()
        assert 'target="model.mass"' in (out / "calibrated.ssm").read_text()


@pytest.fixture(scope="module")
def calibrated(made, tmp_path_factory):
    """What the front door gives of the spring, and the study and FMU that it was given."""
    folder = tmp_path_factory.mktemp("door")
    path, other = made("spring", 2, "cs", False), folder / "other"
    other.mkdir()
    held_out = study(other, made("spring", 2, "cs", False), TRUTH, [], name="held", seed=2).runs
    given = replace(study(folder, path, TRUTH, []), held_out=held_out)
    return pc.calibrate(path, given), given, path


def test_python_gives_an_object_that_its_file_gives_back(calibrated, tmp_path):
    found, given, path = calibrated
    assert found.params["mass"].ci95[0] < 1.3 < found.params["mass"].ci95[1] and set(found.params) == set(TRUTH)
    assert found.after["fit"]["y"] < 0.2 * found.before["fit"]["y"] and list(found.errors().logs) == ["fit", "held_out"]
    assert repr(found).startswith("<Calibration: spring2cs.fmu, 3 parameters; error y ") and found.record["notes"]
    again = pc.Calibration.load(found.save(tmp_path / "parameters.json"))
    assert again.record == found.record and again.comparison == found.comparison and again.params == found.params
    assert repr(again) == repr(found) and again._repr_html_() == found._repr_html_()
    assert again.sentences == found.sentences and isinstance(again.plot.intervals(), Axes)
    pd.testing.assert_frame_equal(again.to_frame(), found.to_frame())
    pd.testing.assert_frame_equal(again.errors(), found.errors())
    with pytest.raises(pc.ResultError, match="holds no log and no fitted model"):
        again.export(tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_table_in_memory_is_its_log_and_its_files_are_left_where_they_are_asked_for(calibrated, tmp_path):
    found, given, path = calibrated
    table = pd.read_csv(given.runs[0])
    assert pc.calibrate(path, given, table).params == found.params
    files = found.export(tmp_path / "out")
    assert {p.name for p in files} == {"calibrated.ssv", "calibrated.ssm", "calibrated.ssp", "spring2cs_calibrated.fmu"}
    assert all(p.is_file() for p in files)
    again = pc.calibrate(tmp_path / "out" / "spring2cs_calibrated.fmu", given)
    assert again.before["fit"]["y"] == pytest.approx(found.after["fit"]["y"], rel=1e-6)


def test_what_is_no_calibration_is_refused_in_a_sentence(calibrated, tmp_path):
    record = calibrated[0].to_dict()
    for content, why in (({**record, "before": {}}, "something in it is missing"), ({"schema": 1}, "is no parameters"),
                         ({k: v for k, v in record.items() if k != "fmu"}, "it is a parameters.json, which "
                                                                           "pycosim.Fitted.load reads")):
        (tmp_path / "x.json").write_text(json.dumps(content))
        with pytest.raises(pc.ResultError, match=why) as said:
            pc.Calibration.load(tmp_path / "x.json")
        assert "\n" not in str(said.value)
    with pytest.raises(pc.PycosimError, match="no.fmu"):
        pc.calibrate(tmp_path / "no.fmu", calibrated[1])


def test_held_out_logs_are_compared_and_not_fitted(made, tmp_path):
    path = made("spring", 2, "cs", False)
    first, other = (study(tmp_path, path, {**TRUTH, "mass": m}, [], name=n) for m, n in ((1.3, "a"), (1.6, "b")))
    found = calibrate(replace(first, held_out=other.runs), path)
    assert found.fit.parameters["mass"] == pytest.approx(1.3, rel=0.05)
    assert found.after["held_out"]["y"] > 2 * found.after["fit"]["y"]


@pytest.mark.parametrize(("change", "error", "text"), [
    ({"parameters": {"mas": Setting(fixed=False)}}, CosimulationError, "no parameter or start 'mas'.*closest: 'mass'"),
    ({"columns": {"force": Column("u", "1"), "place": Column("z", "1")}}, CosimulationError, "no variable 'z'"),
    ({"columns": {"force": Column("u", "1")}}, DataError, "no column is an output"),
    ({"parameters": {n: Setting(fixed=True) for n in TRUTH}}, StudyError, "nothing of spring2cs.fmu is free")])
def test_what_does_not_fit_the_fmu_is_named(made, tmp_path, change, error, text):
    path = made("spring", 2, "cs", False)
    with pytest.raises(error, match=text):
        calibrate(replace(study(tmp_path, path, TRUTH, []), **change), path)


def test_what_is_no_fmu_is_refused(tmp_path):
    (tmp_path / "a.fmu").write_text("no")
    with pytest.raises(CosimulationError, match="cannot be loaded as an FMU"):
        ForeignFmu(tmp_path / "a.fmu")


def test_an_fmu_in_the_place_of_the_study_is_told_apart(capsys):
    assert main(["identify", "model.fmu", "--data", "log.csv"]) == 2
    assert "'pycosim identify study.toml --fmu model.fmu'" in capsys.readouterr().err


def test_machines_are_told_by_three_parameters():
    assert all(len(m.parameters) == 3 for m in MACHINES.values())

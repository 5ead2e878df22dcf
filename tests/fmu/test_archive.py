"""What is inside the file: the same bytes each time, nothing of the machine it was made on, sources that build."""

import re
import shutil
import subprocess
import sys
import zipfile
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from driver import OK, Instance
from fmpy.build import build_platform_binary

from pycosim.cli.entry import main
from pycosim.compile.parse import LIBRARY
from pycosim.control.controllers import estimator
from pycosim.core.errors import ExportError
from pycosim.export import build
from pycosim.export import fmu as fmu_module
from pycosim.export.controller import export_block
from pycosim.export.description import describe, values
from pycosim.export.modelica import to_modelica
from pycosim.export.units import exponents
from pycosim.study.schema import Column


def test_the_same_study_gives_the_same_bytes(fmu, study, model, tmp_path, monkeypatch):
    monkeypatch.setenv("PYCOSIM_CACHE", str(tmp_path / "empty"))  # compiled again, in another folder
    again = fmu_module.export_fmu(study("GearedJoint"), model("GearedJoint"), tmp_path, fmu.fmi)
    assert again.read_bytes() == fmu.path.read_bytes()


def test_no_path_of_this_machine_is_inside(fmu):
    with zipfile.ZipFile(fmu.path) as archive:
        for name in archive.namelist():
            for trace in (b"/home/", b"/tmp/", str(fmu.folder.parent).encode()):
                assert trace not in archive.read(name), name


def test_the_binary_shows_the_standards_functions_and_nothing_else(fmu):
    tool = shutil.which("nm") or pytest.skip("no nm")
    library = next((fmu.folder / "binaries").rglob("*.so"), None) or pytest.skip("not linux")
    shown = subprocess.run([tool, "-D", "--defined-only", str(library)], capture_output=True, text=True, check=True)
    functions = {line.split()[-1] for line in shown.stdout.splitlines()}
    header = (fmu.folder / "sources" / f"fmi{fmu.fmi}Functions.h").read_text(encoding="latin-1")
    declared = re.findall(rf"FMI{fmu.fmi}_Export\s+\w+TYPE\s+(\w+);", header)
    assert functions == set(declared) and len(declared) > 40


def test_the_sources_build_without_a_warning(fmu, tmp_path):
    tool = shutil.which("gcc") or pytest.skip("no gcc")
    done = subprocess.run([tool, "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-c", f"fmi{fmu.fmi}.c", "-o",
                           str(tmp_path / "fmu.o")], cwd=fmu.folder / "sources", capture_output=True, text=True)
    assert done.returncode == 0 and done.stderr == ""


def test_fmpys_builder_rebuilds_it(fmu, tmp_path):
    shutil.which("cmake") or pytest.skip("no cmake")
    shutil.copytree(fmu.folder, tmp_path / "again")
    library = next((tmp_path / "again" / "binaries").rglob("*.so"))
    library.unlink()
    build_platform_binary(tmp_path / "again")
    assert library.stat().st_size > 0


def test_every_file_an_importer_looks_for(fmu):
    with zipfile.ZipFile(fmu.path) as archive:
        names = archive.namelist()
        dates = {i.date_time for i in archive.infolist()}
    wanted = ["documentation/index.html", "sources/instance.c"]
    wanted += ["model.png"] if fmu.fmi == 2 else ["sources/buildDescription.xml", "terminalsAndIcons/icon.png",
                                                  "terminalsAndIcons/terminalsAndIcons.xml"]
    assert set(wanted) < set(names) and names[0] == "modelDescription.xml" and dates == {(1980, 1, 1, 0, 0, 0)}


def test_terminals_name_variables_that_exist(built):
    fmu = built("HipKnee", 3)
    root = ElementTree.parse(fmu.folder / "terminalsAndIcons" / "terminalsAndIcons.xml")
    found = {t.get("name"): [m.get("variableName") for m in t] for t in root.iter("Terminal")}
    assert {"motor1", "motor2", "outside_H", "outside_K"} == set(found)
    assert all(name in fmu.vr for names in found.values() for name in names)
    assert "tau1" in found["motor1"] and {"push_H", "q_H"} < set(found["outside_H"])


def test_the_structure_lists_every_dependency(built):
    """What the derivatives of the FMU feel is in the model structure: probed by directional derivatives."""
    fmu = built("HipKnee", 2)
    plant = Instance(fmu, me=True, started=False)
    plant.set_up(q_H=0.4, q_K=-0.3, leg__w_H=0.5, leg__w_K=-0.4, s1A__z=0.5, s2A__z=-0.5, tau1=0.5, tau2=0.3)
    unknowns = fmu.description.outputs + fmu.description.derivatives
    known = [v.name for v in fmu.description.modelVariables if v.causality == "input" or v.name in plant_states(fmu)]
    real = [u for u in unknowns if u.variable.type == "Real"]
    for name in known:
        felt = plant.directional([u.variable.name for u in real], [name], [1.0])
        for unknown, value in zip(real, felt):
            if value:
                assert name in [v.name for v in unknown.dependencies], (unknown.variable.name, name)


def structure(folder, by_place):
    """What depends on what, by name: numbers of the model structure read as places from one on, or as references."""
    root = ElementTree.parse(folder / "modelDescription.xml").getroot()
    variables = list(root.find("ModelVariables"))
    name = {k + 1 if by_place else int(v.get("valueReference")): v.get("name") for k, v in enumerate(variables)}
    return {(e.tag, name[int(e.get("index") or e.get("valueReference"))]):
            {name[int(n)] for n in e.get("dependencies").split()} for e in root.find("ModelStructure").iter()
            if e.get("dependencies") is not None}


def test_an_importer_that_takes_references_for_places_is_right_too(study, model, built, tmp_path):
    """OMSimulator 3.0 reads FMI 3's dependencies so: the estimator of a system then started before its inputs."""
    given = values(study("GearedJoint"), model("GearedJoint"))
    path = export_block(estimator(model("GearedJoint"), given), tmp_path, 3)
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path / "estimator")
    for folder in (tmp_path / "estimator", built("HipKnee", 3).folder):
        found = structure(folder, by_place=True)
        assert found == structure(folder, by_place=False) and found
    assert {"motor.phi", "motor.tau"} < structure(tmp_path / "estimator", by_place=True)["Output", "C"]


def plant_states(fmu):
    return {u.variable.derivative.name for u in fmu.description.derivatives}


def test_a_study_in_currents_takes_currents(study, model, tmp_path):
    from driver import Fmu
    column = {"Iq": Column("motor.tau", "A", k_m=0.12)}
    path = fmu_module.export_fmu(replace(study("GearedJoint"), columns=column), model("GearedJoint"), tmp_path)
    plant = Instance(Fmu(path, tmp_path / "unpacked"))
    assert plant.set("Iq", 5.0) == OK
    assert plant.get("tau", "k_m_Iq") == [pytest.approx(0.6), 0.12]
    assert plant.directional(["tau"], ["Iq"], [1.0]) == [pytest.approx(0.12)]


def test_one_interface_alone(study, model, tmp_path):
    path = fmu_module.export_fmu(study("ScrewDrive"), model("ScrewDrive"), tmp_path, 3, ("cs",))
    text = zipfile.ZipFile(path).read("modelDescription.xml").decode()
    assert "<CoSimulation" in text and "<ModelExchange" not in text


@pytest.mark.parametrize(("unit", "powers"), [
    ("N.m", {"kg": 1, "m": 2, "s": -2}), ("1/(N.m)", {"kg": -1, "m": -2, "s": 2}), ("kg.m2", {"kg": 1, "m": 2}),
    ("N.m.s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}), ("1", {}), ("rad/s2", {"s": -2, "rad": 1}),
    ("furlong", None)])
def test_units_are_taken_apart(unit, powers):
    assert exponents(unit) == powers


def test_without_any_compiler_one_sentence_says_so(monkeypatch):
    monkeypatch.setattr(build.shutil, "which", lambda name: None)
    monkeypatch.setattr(build.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ExportError, match="no C compiler here.*type 'pip install ziglang'"):
        build.compiler(build.host())


def test_another_platform_without_its_compiler_is_told_what_to_type(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(build.importlib.util, "find_spec", lambda name: None)
    (tmp_path / "arm.toml").write_text('[rig]\nmodel = "DriveTrain.Rigs.ScrewDrive"\n')
    assert main(["export", "arm.toml", "--platforms", "all"]) == 2
    said = capsys.readouterr().err
    assert "type 'pip install ziglang'" in said and "x86_64-linux" in said and said.count("\n") == 1


SCENARIO = """\
duration = 0.1
[components.p]
plant = "DriveTrain.Rigs.ScrewDrive"
rate = 1000
[log]
rate = 100
columns = { s = "p.nut.s" }
"""


@pytest.mark.parametrize("text", ["", SCENARIO], ids=["ssp", "cosim"])
def test_without_fmpy_an_fmu_is_written_and_the_rest_says_what_to_type(text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in [n for n in sys.modules if n.partition(".")[0] == "fmpy"] + ["fmpy"]:
        monkeypatch.setitem(sys.modules, name, None)  # as if it were not installed
    (tmp_path / "arm.toml").write_text('[rig]\nmodel = "DriveTrain.Rigs.ScrewDrive"\n')
    (tmp_path / "run.toml").write_text(text)
    if not text:
        assert main(["export", "arm.toml"]) == 0 and (tmp_path / "arm_export" / "arm_fmi2.fmu").exists()
        capsys.readouterr()
    assert main(["cosim", "run.toml"] if text else ["export", "arm.toml", "--to", "ssp"]) == 2
    said = capsys.readouterr().err
    assert "type 'pip install fmpy'" in said and said.count("\n") == 1


def test_a_failing_compiler_leaves_nothing(study, model, tmp_path, monkeypatch):
    monkeypatch.setenv("PYCOSIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(build, "FLAGS", ["-no-such-flag-at-all"])
    (tmp_path / "out").mkdir()
    with pytest.raises(ExportError, match="C compiler"):
        fmu_module.export_fmu(study("ScrewDrive"), model("ScrewDrive"), tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("fmi", [2, 3])
def test_five_platforms_from_one_machine(study, model, tmp_path, fmi):
    pytest.importorskip("ziglang")
    path = fmu_module.export_fmu(study("ScrewDrive"), model("ScrewDrive"), tmp_path, fmi, platforms="all")
    with zipfile.ZipFile(path) as archive:
        found = {n: archive.read(n) for n in archive.namelist() if n.startswith("binaries/")}
    assert len(found) == (4 if fmi == 2 else 5)  # FMI 2 has one folder for macOS: a universal library
    for name, content in found.items():
        magic = {".so": b"\x7fELF", ".dll": b"MZ"}.get(name[name.rindex("."):])
        assert content.startswith(magic or (b"\xca\xfe\xba\xbe" if fmi == 2 else b"\xcf\xfa\xed\xfe"))
        assert b"/tmp/" not in content and (b"@rpath/" in content) == name.endswith(".dylib")
    linux = next(c for n, c in found.items() if "linux64" in n or "x86_64-linux" in n)
    needed = {tuple(map(int, v.split(b"."))) for v in re.findall(rb"GLIBC_([0-9.]+)\0", linux)}
    assert needed and max(needed) <= (2, 17)


def test_the_command_line_writes_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.toml").write_text('[rig]\nmodel = "DriveTrain.Rigs.ScrewDrive"\n')
    assert main(["export", "arm.toml", "--fmi", "3"]) == 0
    assert "1 inputs" in capsys.readouterr().out
    assert {p.name for p in (tmp_path / "arm_export").iterdir()} >= {"arm_fmi3.fmu", "export.json"}
    for bad, word in ((["nothing.toml"], "no study"), (["arm.toml", "--to", "fmx"], "fmu"),
                      (["arm.toml", "--data", "x.csv"], "reads no log")):
        assert main(["export", *bad]) == 2
        said = capsys.readouterr().err
        assert word in said and len(said.splitlines()) == 1


def test_an_export_imports_nothing_that_reads_or_draws_logs(tmp_path):
    """They take as long to import as the compiler takes for the FMU."""
    (tmp_path / "arm.toml").write_text('[rig]\nmodel = "DriveTrain.Rigs.ScrewDrive"\n')
    told = "print([m for m in ('pandas', 'matplotlib', 'scipy.stats', 'scipy.signal', 'lark') if m in sys.modules])"
    code = f"import sys; from pycosim.cli.entry import main; assert main(['export', 'arm.toml']) == 0; {told}"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "[]", done.stderr + done.stdout


def test_a_name_that_the_standard_does_not_know_is_found(fmu, tmp_path):
    text = (fmu.folder / "modelDescription.xml").read_text()
    for name, fine in (("motor.phi_1", True), ("der(motor.phi_1)", True), ("1motor", False), ("motor..phi", False),
                       ("der(motor", False)):
        with zipfile.ZipFile(tmp_path / "named.fmu", "w") as archive:
            archive.writestr("modelDescription.xml", text.replace('name="push"', f'name="{name}"'))
        if fine:
            fmu_module._validate(str(tmp_path / "named.fmu"))
        else:
            with pytest.raises(RuntimeError, match=re.escape(name)):
                fmu_module._validate(str(tmp_path / "named.fmu"))


def test_the_modelica_text_compiles_to_the_same_machine(study, model, library):
    """Read again, the text is the machine it was written from; what a second compiler makes of it is tested below."""
    text = to_modelica(describe(study("GearedJoint"), model("GearedJoint")))
    flat = library.flatten("GearedJoint.Machine", text)
    assert flat.parameters["gear.f0"].value == 0.04 and flat.parameters["stribeck_gear.fs"].value == 0.01
    assert len(flat.equations) == len(model("GearedJoint").flat.equations)


@pytest.mark.parametrize("rig", ["GearedJoint", "HipKnee"])
def test_a_self_contained_modelica_file_needs_no_library(study, model, tmp_path, rig):
    """Parsed alone, without DriveTrain beside it, and compiled by the second compiler from that one file."""
    import pymoca.ast
    import pymoca.tree

    from pycosim.compile.parse import parse
    rumoca = pytest.importorskip("rumoca")
    text = to_modelica(describe(study(rig), model(rig)), self_contained=True)
    alone = pymoca.tree.flatten(parse(text, rig), pymoca.ast.ComponentRef.from_string(f"{rig}.Machine"))
    flat, = alone.classes.values()
    assert len(flat.symbols) > 50 and "UsersGuide" not in text and "Examples" not in text
    unused = {"GearedJoint": "model Leg ", "HipKnee": "model Screw "}[rig]
    assert unused not in text and "model Segment " in text and "within" not in text
    inputs = {"GearedJoint": "tau = 0.4 * sin(3 * time), push = 0",
              "HipKnee": "tau1 = 0.4 * sin(3 * time), tau2 = 0, push_H = 0, push_K = 0"}[rig]
    driven = f"  model Driven\n    Machine rig({inputs});\n  end Driven;\nend {rig};\n"
    (tmp_path / f"{rig}.mo").write_text(text.rstrip().removesuffix(f"end {rig};") + driven)
    session = rumoca.Session()
    q = np.array(session.load(str(tmp_path / f"{rig}.mo"), model=f"{rig}.Driven").simulate(0.5, dt=0.05)[
        "rig.q" if rig == "GearedJoint" else "rig.q_H"])
    assert np.isfinite(q).all() and np.ptp(q) > 1e-3


def test_the_second_compiler_moves_the_modelica_text_as_the_fmu_moves(study, model, built, tmp_path):
    rumoca = pytest.importorskip("rumoca")
    text = to_modelica(describe(study("GearedJoint"), model("GearedJoint"))).rstrip().removesuffix("end GearedJoint;")
    driven = "  model Driven\n    Machine rig(tau = 0.4 * sin(3 * time), push = 0);\n  end Driven;\nend GearedJoint;\n"
    (tmp_path / "GearedJoint.mo").write_text(text + driven)
    session = rumoca.Session(roots=[str(LIBRARY / "DriveTrain")])
    oracle = session.load(str(tmp_path / "GearedJoint.mo"), model="GearedJoint.Driven").simulate(
        1.0, dt=0.01, config=rumoca.SimConfig(rtol=1e-9, atol=1e-11))
    ends, q = [], np.array(oracle["rig.q"])
    for h in (1e-3, 1.25e-4):
        plant, found = Instance(built("GearedJoint", 2)), [0.0]
        for k in range(round(1 / h)):
            # an input is held over a step; at its middle it is right to second order
            assert plant.set("tau", 0.4 * np.sin(3 * (k + 0.5) * h)) == OK and plant.step(k * h, h) == OK
            if (k + 1) % round(0.01 / h) == 0:
                found.append(plant.get("q"))
        ends.append(np.abs(np.array(found) - q).max() / np.ptp(q))
    assert ends[0] < 2e-6 and ends[1] < ends[0] / 4 and np.ptp(q) > 0.1

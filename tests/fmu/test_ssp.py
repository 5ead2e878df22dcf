"""The system structure: valid by the standard's schemas, and simulated by another importer to Python's numbers."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import find_components, read_ssd, read_ssv

from pycosim.errors import StudyError
from pycosim.export.description import values
from pycosim.export.ssp import Part, export_ssp, read_part
from pycosim.simulate import simulate


@pytest.fixture(scope="module")
def system(study, model, tmp_path_factory):
    return export_ssp(study("GearedJoint"), model("GearedJoint"), tmp_path_factory.mktemp("ssp"))


def test_it_is_valid_and_separates_what_was_identified_from_defaults(system):
    read = read_ssd(str(system))  # validates
    assert [c.name for c in find_components(read.system)] == ["plant"]
    sets = {k: {p.name: float(p.value) for p in read_ssv(str(system), f"resources/{k}.ssv").parameters}
            for k in ("identified", "defaults")}
    assert sets["identified"] == {"plant.gear.f0": 0.04, "plant.gear.mu": 0.9, "plant.viscous_gear.b": 1e-4,
                                  "plant.stribeck_gear.fs": 0.01}
    assert sets["defaults"]["plant.load.m"] == 4 and not set(sets["identified"]) & set(sets["defaults"])


def test_fmpy_simulates_it_with_its_parameter_set(system, study, model):
    rig, push, time = model("GearedJoint"), 3.0, np.arange(201) * 1e-3
    chosen = read_ssv(str(system), "resources/identified.ssv")
    next(p for p in chosen.parameters if p.name == "plant.gear.f0").value = "0.06"
    found = simulate_ssp(str(system), stop_time=0.2, step_size=1e-3, parameter_set=chosen,
                         input={"tau": lambda t: 0.7, "push": lambda t: push})
    late = np.r_[0.0, np.ones(200)]  # that importer hands inputs on one step later
    expected = simulate(rig, {"tau": 0.7 * late, "push": push * late}, time,
                        {**values(study("GearedJoint"), rig), "gear.f0": 0.06}, hold=True)
    assert abs(expected["q"][-1]) > 0.01
    assert np.allclose(found["plant.q"][:200], expected["q"][1:], rtol=1e-9, atol=1e-12)
    assert np.allclose(found["q"], found["plant.q"], rtol=0, atol=0) and "gear.still" in found.dtype.names


def test_a_further_component_is_wired_by_name(study, model, built, tmp_path):
    """A stand-in for a controller: another machine, whose outputs and inputs have other names but one."""
    other = read_part("other", built("ScrewDrive").path)
    renamed = {{"tau": "push"}.get(n, n): v for n, v in other.connectors.items()}
    path = export_ssp(study("GearedJoint"), model("GearedJoint"), tmp_path,
                      others=[Part("other", other.fmu, renamed)])
    read = read_ssd(str(path))
    wires = {(c.startElement, c.startConnector, c.endElement, c.endConnector) for c in read.system.connections}
    assert ("other", "push", "plant", "push") in wires and (None, "tau", "plant", "tau") in wires
    assert (None, "tau_in", "other", "tau_in") in wires
    with zipfile.ZipFile(path) as archive:
        assert archive.read("resources/other.fmu") == built("ScrewDrive").path.read_bytes()


def test_what_cannot_be_wired_is_refused(study, model, built, tmp_path):
    feeding = Part("one", b"", {"tau": ("output", "Real", "N.m")})
    for others, words in (([feeding, Part("two", b"", feeding.connectors)], "'tau' of 'plant'.*one and two"),
                          ([Part("plant", b"", {})], "two components.*'plant'")):
        with pytest.raises(StudyError, match=words):
            export_ssp(study("GearedJoint"), model("GearedJoint"), tmp_path, others=others)
    with pytest.raises(StudyError, match="no FMU"):
        read_part("none", Path(__file__))
    assert not list(tmp_path.iterdir())

"""The system structure: valid by the standard's schemas, and simulated by another importer to Python's numbers."""

import json
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import find_components, read_ssd, read_ssv

from pycosim.core.errors import StudyError
from pycosim.dynamics.simulate import simulate
from pycosim.export import export
from pycosim.export.description import values
from pycosim.export.ssp import Part, export_ssp, read_part


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
    assert np.allclose(found["q"], found["plant.q"], rtol=0, atol=0)


@pytest.mark.parametrize("fmi", [2, 3])
def test_names_at_the_border_are_identifiers(study, model, tmp_path, fmi):
    """OMSimulator refuses dots there; in a component, a connector is called as its variable."""
    made = export(study("GearedJoint"), model("GearedJoint"), tmp_path, to="ssp", fmi=fmi)
    read = read_ssd(str(tmp_path / made.files[0]))
    border = {c.name for c in read.system.connectors}
    assert {"motor_phi", "controller_motor_tau", "ref_motor_phi", "estimator_C"} < border
    assert all(re.fullmatch(r"[A-Za-z_]\w*", n, re.ASCII) for n in (*border, read.system.name))
    ends = {e for c in read.system.connections for e in (c.startConnector if c.startElement is None else None,
                                                         c.endConnector if c.endElement is None else None) if e}
    assert ends == border
    plant = next(c for c in find_components(read.system) if c.name == "plant")
    assert "motor.phi" in {c.name for c in plant.connectors}


def test_two_names_that_would_be_one_at_the_border_are_refused(study, model, tmp_path):
    others = [Part("one", b"", {"a.b": ("output", "Real", "1"), "a_b": ("output", "Real", "1")})]
    with pytest.raises(StudyError, match="'one_a.b' and 'one_a_b'"):
        export_ssp(study("GearedJoint"), model("GearedJoint"), tmp_path, others=others)


@pytest.fixture(scope="module")
def controlled(study, model, tmp_path_factory):
    """What the command writes: plant, controller and estimator."""
    folder = tmp_path_factory.mktemp("controlled")
    made = export(study("GearedJoint"), model("GearedJoint"), folder, to="ssp")
    assert "plant, controller, estimator" in made.lines[0] and not any("In the SSP" in n for n in made.lines)
    return folder / made.files[0]


def test_the_command_connects_controller_and_estimator(controlled):
    read = read_ssd(str(controlled))
    assert [c.name for c in find_components(read.system)] == ["plant", "controller", "estimator"]
    wires = {(c.endElement, c.endConnector): (c.startElement, c.startConnector) for c in read.system.connections}
    assert wires["plant", "tau"] == ("controller", "motor.tau")
    assert wires["estimator", "motor.tau"] == ("plant", "motor.tau") == wires[None, "motor_tau"]
    assert wires["controller", "motor.phi"] == ("plant", "motor.phi") and wires[None, "estimator_C"][0] == "estimator"
    assert wires["controller", "ref.motor.phi"] == (None, "ref_motor_phi") and wires["plant", "push"][0] is None
    gains = {p.name: float(p.value) for p in read_ssv(str(controlled), "resources/controller.ssv").parameters}
    assert gains["controller.kp"] == 3.0 and gains["controller.gear.f0"] == 0.04


def followed(path, most):
    """Motor angle, and the joint torque as it is and as it is estimated, along a slow sine."""
    chosen = read_ssv(str(path), "resources/controller.ssv")
    next(p for p in chosen.parameters if p.name == "controller.tau_max").value = str(most)
    size, speed = 20.0, 3.0
    motion = {"ref_motor_phi": lambda t: size * (1 - np.cos(speed * t)),
              "ref_motor_w": lambda t: size * speed * np.sin(speed * t),
              "ref_motor_a": lambda t: size * speed ** 2 * np.cos(speed * t)}
    motion["motor_a"] = motion["ref_motor_a"]  # nobody measures it; the estimator takes it for the rotor's inertia
    y = simulate_ssp(str(path), stop_time=1.0, step_size=1e-3, parameter_set=chosen, input=motion)
    return y, size * (1 - np.cos(speed * (y["time"] + 1e-3)))


def test_the_system_follows_a_motion_and_estimates_its_torque(controlled):
    y, wanted = followed(controlled, 3.0)
    late = y["time"] > 0.1
    assert np.abs(y["motor_phi"] - wanted)[late].max() < 0.005 * np.ptp(wanted)
    assert np.ptp(y["C"]) > 5 and np.abs(y["estimator.C"] - y["C"])[late].max() < 0.05 * np.ptp(y["C"])
    weak, _ = followed(controlled, 0.01)  # the parameter set is what the controller takes
    assert np.abs(weak["controller.motor.tau"]).max() == pytest.approx(0.01)
    assert np.abs(weak["motor_phi"] - wanted)[late].max() > 0.5 * np.ptp(wanted)


_ECOS = """
import sys
from ecospy import EcosSimulation
with EcosSimulation(ssp_path=sys.argv[1], step_size=1e-3) as simulation:
    simulation.init()
    simulation.step(100)
    print([simulation.get_real(f"plant::{n}") for n in ("q", "motor.phi")])
    simulation.terminate()
"""


def without_border(path, folder):
    """The system without connections to its border, which ecos cannot read."""
    changed = folder / path.name
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(changed, "w") as copy:
        for name in archive.namelist():
            data = archive.read(name)
            if name == "SystemStructure.ssd":
                whole = len(re.findall(rb"<ssd:Connection ", data))
                data = re.sub(rb"<ssd:Connection (?:(?!startElement)[^>])*/>|<ssd:Connection (?:(?!endElement)[^>])*/>",
                              b"", data)
                assert 0 < len(re.findall(rb"<ssd:Connection ", data)) < whole
            copy.writestr(name, data)
    return changed


def test_ecos_loads_and_steps_the_system(controlled, tmp_path):
    environment = {**os.environ, "LD_LIBRARY_PATH": str(Path(sys.prefix) / "lib")}  # where the wheel of tbb is
    if subprocess.run([sys.executable, "-c", "import ecospy"], env=environment, capture_output=True).returncode:
        pytest.skip("ecospy, or the tbb it needs, is not installed")
    done = subprocess.run([sys.executable, "-c", _ECOS, str(without_border(controlled, tmp_path))], env=environment,
                          capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr + done.stdout
    assert max(map(abs, json.loads(done.stdout.splitlines()[-1]))) < 1e-6  # held where it starts, upright


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

"""Other people's importers take the FMUs without a complaint, and find the numbers that Python finds."""

import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from driver import EXPORTS, OK, Instance
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu

from pycosim.dynamics.simulate import simulate
from pycosim.export.description import values


@pytest.mark.parametrize(("rig", "fmi"), EXPORTS)
def test_fmpy_finds_nothing_to_complain_about(built, rig, fmi):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert validate_fmu(str(built(rig, fmi).path)) == []


def reference(model, study, start, stop, step=1e-3):
    time = np.arange(0.0, stop + 1e-9, 1e-3)
    return time, simulate(model("GearedJoint"), {"tau": np.full(len(time), 0.7)}, time,
                          values(study("GearedJoint"), model("GearedJoint")), start, step)


@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_fmpy_simulates_both_interfaces(fmu, model, study, kind, capfd):
    """The importer's solver of model exchange is held against steps fine enough not to matter, below the upright."""
    time, expected = reference(model, study, {"q": 0.1}, 0.3, 1e-3 if kind == "CoSimulation" else 2e-5)
    names = ["q", "w", "C", "gear.loss", "gear.still"]
    found = simulate_fmu(str(fmu.path), stop_time=0.3, output_interval=1e-2, fmi_type=kind, output=names,
                         start_values={"q": 0.1, "tau": 0.7}, relative_tolerance=1e-10, record_events=False)
    shown = capfd.readouterr()
    assert shown.out == shown.err == ""
    assert len(found["time"]) == 31
    for name in ("q", "w"):
        other = np.interp(found["time"], time, expected[name])
        # where friction sets in and lets go, CVode's global error is some thousand times its tolerance
        assert np.abs(found[name] - other).max() < (1e-9 if kind == "CoSimulation" else 1e-6) * np.abs(other).max()
    assert found["gear.still"][0] and not found["gear.still"][-1]


def test_casadi_imports_the_equations(fmu):
    """CasADi's own importer: the derivative of the states, and its derivatives, through the FMU's functions."""
    dae = ca.DaeBuilder("plant", str(fmu.folder), {"debug": False})
    assert dae.x() == [v.name for v in fmu.description.modelVariables if v.initial == "exact" and v.causality
                       in ("output", "local")]
    dae.set_start("gear.f0", 0.04)
    f = dae.create("f", ["x", "u"], ["ode"])
    x, u = [0.5, 0.2, 0.3], [0.6, 0.1]
    jacobian = f.jacobian()(x, u, ca.DM.zeros(3, 1))[0]
    step = 1e-6
    for k in range(3):
        up, down = (np.array(x) + s * step * np.eye(3)[k] for s in (1, -1))
        difference = (f(up, u) - f(down, u)) / (2 * step)
        assert np.allclose(jacobian[:, k], difference, rtol=1e-5, atol=1e-5)


def test_casadi_imports_the_outputs(fmu):
    """All of them, and their derivatives: none is of a type that its importer cannot read."""
    dae = ca.DaeBuilder("plant", str(fmu.folder), {"debug": False})
    f = dae.create("f", ["x", "u"], ["ode", "y"])
    x, u, names = [0.5, 0.2, 0.3], [0.6, 0.1], dae.y()
    assert {"q", "motor.tau", "gear.loss", "C"} < set(names)
    outputs, known = np.array(f(x, u)[1]).ravel(), dae.x()
    assert outputs[names.index("q")] == x[known.index("q")] and outputs[names.index("motor.tau")] == u[0]
    slope = np.array(f.jacobian()(x, u, 0, 0)[2])  # of the outputs by the states
    step = 1e-6 * np.eye(3)
    for k in range(3):
        ends = [np.array(f(np.array(x) + s * step[k], u)[1]).ravel() for s in (1, -1)]
        assert np.allclose(slope[:, k], (ends[0] - ends[1]) / 2e-6, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(("rig", "fmi"), EXPORTS)
def test_the_reference_results_are_what_it_computes(built, rig, fmi):
    """Inputs held over steps of a millisecond, as the files say; results to the digits that are written."""
    fmu = built(rig, fmi)
    given, wanted = (np.genfromtxt(next((fmu.folder / "documentation" / "reference").glob(f"*_{kind}.csv")),
                                   delimiter=",", names=True, deletechars="") for kind in ("in", "ref"))
    plant, rows = Instance(fmu), [n for n in wanted.dtype.names if n != "time"]
    found = [plant.get(*rows)]
    for k, t in enumerate(given["time"][:-1]):
        assert plant.set(list(given.dtype.names[1:]), [float(given[n][k]) for n in given.dtype.names[1:]]) == OK
        assert plant.step(float(t), 1e-3) == OK
        if (k + 1) % 10 == 0:
            found.append(plant.get(*rows))
    wanted = np.array([wanted[n] for n in rows]).T
    size = np.abs(wanted).max(axis=0)
    assert len(found) == len(wanted) and (np.abs(np.array(found) - wanted)[1:] <= 1e-6 * size + 1e-9).all()


_ECOS = """
import sys
from ecospy import EcosSimulationStructure, EcosSimulation
structure = EcosSimulationStructure()
structure.add_model("plant", sys.argv[1])
structure.add_parameter_set("initial", {"plant::tau": 0.7, "plant::q": 0.1})
with EcosSimulation(structure=structure, step_size=1e-2) as simulation:
    simulation.init(parameter_set="initial")
    simulation.step(50)
    print("\\nq =", simulation.get_real("plant::q").hex(), flush=True)
    simulation.terminate()
"""


def test_ecos_simulates_it(fmu, model, study):
    environment = {**os.environ, "LD_LIBRARY_PATH": str(Path(sys.prefix) / "lib")}  # where the wheel of tbb is
    if subprocess.run([sys.executable, "-c", "import ecospy"], env=environment, capture_output=True).returncode:
        pytest.skip("ecospy, or the tbb it needs, is not installed")
    _, expected = reference(model, study, {"q": 0.1}, 0.5)
    done = subprocess.run([sys.executable, "-c", _ECOS, str(fmu.path)], capture_output=True, text=True, timeout=60,
                          env=environment)
    assert done.returncode == 0, done.stderr
    shown = re.search(r"^q = (\S+)$", done.stdout, re.M)  # between lines of its own log
    assert shown, done.stdout
    assert float.fromhex(shown[1]) == pytest.approx(expected["q"][-1], abs=1e-9)


@pytest.mark.parametrize("name", ["with space", "größe", "per%20cent", "has#hash"])
def test_paths_of_all_kinds(fmu, tmp_path, name):
    path = tmp_path / name / f"{name}.fmu"
    path.parent.mkdir()
    path.write_bytes(fmu.path.read_bytes())
    found = simulate_fmu(str(path), stop_time=0.01, start_values={"tau": 0.7})
    assert np.isfinite(found["q"]).all()

"""The C export: no warnings, nothing but math.h, and the numbers of Python to rounding."""

import ctypes
import re
import shutil
import subprocess

import numpy as np
import pytest

from pycosim.compile import Library, compile_model
from pycosim.compile.parse import LIBRARY
from pycosim.core.errors import StudyError, UnknownNameError
from pycosim.dynamics.simulate import dynamics, estimate, simulate
from pycosim.dynamics.states import follow
from pycosim.export.c import export_c

RIGS = sorted({p.stem for p in (LIBRARY / "DriveTrain" / "Rigs").glob("*.mo")}
              - {"package", "HipKneeTransmission"})  # the latter is inside HipKnee
WARNINGS = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror"]
REALS = {"double": (np.float64, ctypes.c_double, 1e-12), "float": (np.float32, ctypes.c_float, 2e-3)}
LIBRARY_ = Library()

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")


class Exported:
    """A compiled export, called with arrays."""

    def __init__(self, model, folder, real, parameters=None):
        self.header, self.source = export_c(model, parameters or {}, folder, "rig", real)
        self.object = folder / "rig.o"
        subprocess.run(["gcc", "-O0", *WARNINGS, "-fPIC", "-c", self.source, "-o", self.object], check=True)
        subprocess.run(["gcc", "-shared", self.object, "-o", folder / "rig.so", "-lm"], check=True)
        self.library = ctypes.CDLL(str(folder / "rig.so"))
        self.type, self.scalar, self.tolerance = REALS[real]
        self.parameters = self.call("parameters", [], [len(model.parameters)])[0]

    def call(self, name, given, sizes):
        arrays = [v if np.isscalar(v) else np.ascontiguousarray(v, self.type) for v in given]
        results = [np.zeros(max(1, n), self.type) for n in sizes]
        getattr(self.library, f"rig_{name}")(*[
            self.scalar(v) if np.isscalar(v) else v.ctypes.data_as(ctypes.c_void_p) for v in [*arrays, *results]])
        return [r[:n].astype(float) for r, n in zip(results, sizes)]

    def agrees(self, found, wanted):
        wanted = np.array(wanted, float).ravel()
        scale = 1 + np.abs(wanted)
        assert np.max(np.abs(found - wanted) / scale, initial=0.0) < self.tolerance, (found, wanted)


@pytest.fixture(scope="module", ids="-".join,
                params=[("double", r) for r in RIGS] + [("float", "HipKnee"), ("float", "ServoPendulum")])
def exported(request, tmp_path_factory):
    real, rig = request.param
    model = compile_model(LIBRARY_, f"DriveTrain.Rigs.{rig}")
    inertia = {n: 2e-3 for n in model.parameters if re.fullmatch(r"motor\d?\.J", n)}  # one rig has none of its own
    return model, Exported(model, tmp_path_factory.mktemp(rig), real, inertia)


def point(rng, names):
    """A random state or input; friction states lie within their bounds."""
    return rng.uniform(-0.9, 0.9, len(names))


@pytest.mark.parametrize("question", ["estimate", "compensate"])
def test_answers_and_friction_states_are_those_of_python(exported, question):
    model, c = exported
    asked, rng = model.question(question), np.random.default_rng(1)
    order = list(model.parameters)
    p, after = c.parameters[[order.index(n) for n in asked.parameters]], follow(asked)
    for _ in range(50):
        u, x, h = point(rng, asked.inputs), point(rng, asked.states), float(rng.uniform(0, 2e-3))
        c.agrees(c.call(question, [u, x, c.parameters], [len(asked.outputs)])[0], asked.output(u, x, p))
        if asked.states:
            c.agrees(c.call(f"{question}_next", [u, x, c.parameters, h], [len(x)])[0], after(u, x, p, h))


def test_the_step_is_that_of_python(exported):
    model, c = exported
    d, rng = dynamics(model), np.random.default_rng(2)
    q = d.prepare(c.parameters)
    for _ in range(50):
        x, u0, u1 = point(rng, d.states), point(rng, d.inputs), point(rng, d.inputs)
        z = c.call("simulate_start", [x, np.zeros(len(d.algebraic)), u0, c.parameters, 0.0], [len(d.algebraic)])[0]
        wanted = d.initial(x, np.zeros(len(z)), u0, q, 0)
        c.agrees(z, wanted)
        sizes = [len(x), len(z), 1]
        x_next, z_next, error = c.call("simulate_step", [x, z, u0, u1, c.parameters, 0.0, 1e-3], sizes)
        wanted = d.step(x, wanted, u0, u1, q, 0, 1e-3)
        assert error[0] <= 1
        c.agrees(x_next, wanted[0])
        y = c.call("simulate_output", [x_next, z_next, u1, c.parameters, 1e-3], [len(d.outputs)])[0]
        c.agrees(y, d.output(x_next, z_next, u1, c.parameters, 1e-3))


def test_a_step_without_solution_says_so(exported):
    model, c = exported
    d = dynamics(model)
    x, z, u = np.zeros(len(d.states)), np.zeros(len(d.algebraic)), np.full(len(d.inputs), np.nan)
    error = c.call("simulate_step", [x, z, u, u, c.parameters, 0.0, 1e-3], [len(x), len(z), 1])[2]
    assert not error[0] <= 1


def test_estimate_sample_by_sample_is_the_estimate_of_the_log(tmp_path):
    model = compile_model(LIBRARY_, "DriveTrain.Rigs.GearedJoint")
    c, time = Exported(model, tmp_path, "double"), np.linspace(0, 2, 400)
    y = simulate(model, {"tau": 0.15 * np.sin(3 * time)}, time, start={"q": 0.2})
    log = {"motor.phi": y["motor.phi"], "motor.tau": y["tau"], "der(motor.phi)": y["motor.w"],
           "der(der(motor.phi))": y["motor.a"]}
    asked, h, x, found = model.question("estimate"), time[1] - time[0], np.zeros(1), []
    speed = asked.inputs.index("der(motor.phi)")
    for k in range(len(time)):
        u = np.array([log[n][k] for n in asked.inputs])
        if k:
            mean = u.copy()
            mean[speed] = (log["motor.phi"][k] - log["motor.phi"][k - 1]) / h
            x = c.call("estimate_next", [mean, x, c.parameters, h], [1])[0]
        found.append(c.call("estimate", [u, x, c.parameters], [len(asked.outputs)])[0][asked.outputs.index("C")])
    np.testing.assert_allclose(found, estimate(model, log, time)["C"], atol=1e-9)


def test_identified_values_and_every_name_are_in_the_header(exported):
    model, c = exported
    text = c.header.read_text()
    assert "SI units" in text and "malloc" not in c.source.read_text()
    assert re.findall(r"#include <(.*)>", c.source.read_text()) == ["math.h"]
    for n in model.question("estimate").inputs:
        assert f"/* {n} [" in text and (not n.startswith("der(der(") or f"/* {n} [{model.along('rad/s2')}]" in text)
    for k, (n, v) in enumerate(model.parameters.items()):
        assert f"= {k}, /* {n} [{v.unit}]" in text
        if not re.fullmatch(r"motor\d?\.J", n):
            assert c.parameters[k] == pytest.approx(v.value, rel=1e-6)


def test_only_functions_of_the_header_are_visible_and_nothing_global_is_written(exported):
    _, c = exported
    symbols = subprocess.run(["nm", c.object], check=True, capture_output=True, text=True).stdout
    for kind, name in re.findall(r"^[0-9a-f ]{16} (\w) (\S+)$", symbols, re.M):
        assert kind not in "BbDdC", name
        assert kind != "T" or f" {name}(" in c.header.read_text()
        assert kind != "U" or name.removesuffix("f") in {"sin", "cos", "sincos", "exp", "memset", "memcpy",
                                                         "_GLOBAL_OFFSET_TABLE_"}, name


@pytest.mark.parametrize(("arguments", "error", "text"), [
    (({}, "2rig"), StudyError, "'2rig' is no name in C"),
    (({"gear.fo": 0.1}, "rig"), UnknownNameError, "no parameter 'gear.fo'.*closest: 'gear.f0'"),
    (({}, "rig", "half"), StudyError, "no precision 'half'")])
def test_wrong_arguments_are_named_and_nothing_is_written(tmp_path, arguments, error, text):
    parameters, *rest = arguments
    with pytest.raises(error, match=text):
        export_c(compile_model(LIBRARY_, "DriveTrain.Rigs.GearedJoint"), parameters, tmp_path / "out", *rest)
    assert not (tmp_path / "out").exists()

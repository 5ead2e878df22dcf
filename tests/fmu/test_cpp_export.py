"""Estimator and compensation in C++: no warnings, no allocation, and the numbers of Python on a whole log."""

import shutil
import subprocess

import numpy as np
import pytest

from pycosim.cli.entry import main
from pycosim.compile import Library, compile_model
from pycosim.dynamics.simulate import compensate, estimate, simulate
from pycosim.export.cpp import cpp_source

pytestmark = pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler")
FLAGS = ["-std=c++11", "-Wall", "-Wextra", "-Werror", "-fno-exceptions", "-fno-rtti"]
LOOP = """
#include "rig.hpp"
#include <cstdio>
int main() {
  rig::%(title)s block;
  double h, now[rig::%(title)s::INPUT_COUNT];
  for (int k = 0; std::scanf("%%lf", &h) == 1; ++k) {
    for (double &v : now) if (std::scanf("%%lf", &v) != 1) return 1;
    std::printf("%%.17g\\n", block.step(now, h)[%(output)d]);
  }
}
"""


@pytest.mark.parametrize("question", ["estimate", "compensate"])
def test_a_log_sample_by_sample_is_that_of_python(tmp_path, question):
    model, time = compile_model(Library(), "DriveTrain.Rigs.GearedJoint"), np.linspace(0, 2, 300)
    known = {n: v.value for n, v in model.parameters.items()}
    (tmp_path / "rig.hpp").write_text(cpp_source(model, known, "rig"))
    y = simulate(model, {"tau": 0.15 * np.sin(3 * time)}, time, known, start={"q": 0.2})
    log = {"motor.phi": y["motor.phi"], "motor.tau": y["tau"], "C": y["C"], "der(motor.phi)": y["motor.w"],
           "der(der(motor.phi))": y["motor.a"]}
    asked, wanted = model.question(question), {"estimate": "C", "compensate": "motor.tau"}[question]
    given = {n: log[n] for n in asked.inputs}
    right = (estimate if question == "estimate" else compensate)(model, given, time, known)[wanted]
    (tmp_path / "main.cpp").write_text(LOOP % {"title": question.capitalize(), "output": asked.outputs.index(wanted)})
    subprocess.run(["g++", "-O1", *FLAGS, "main.cpp", "-o", "main"], cwd=tmp_path, check=True)
    rows = np.column_stack([np.r_[0.0, np.diff(time)], *given.values()])
    text = "\n".join(" ".join(map(repr, map(float, row))) for row in rows)
    said = subprocess.run([tmp_path / "main"], input=text, capture_output=True, text=True, check=True).stdout
    assert np.allclose(np.array(said.split(), float), right, rtol=0, atol=1e-9 * np.abs(right).max())


def test_it_asks_nothing_of_the_system(tmp_path):
    """Of two units that include it: no symbol is defined twice, none but those of the mathematics is asked for."""
    model = compile_model(Library(), "DriveTrain.Rigs.HipKnee")
    text = cpp_source(model, {n: v.value for n, v in model.parameters.items()}, "rig")
    (tmp_path / "rig.hpp").write_text(text)
    unit = '#include "rig.hpp"\ndouble %s(const double (&u)[rig::Estimate::INPUT_COUNT], rig::Estimate &e) {\n' \
           "  e.reset(); return e.step(u, 1e-3)[0]; }\n"
    for name in ("one", "two"):
        (tmp_path / f"{name}.cpp").write_text(unit % name)
    subprocess.run(["g++", "-O0", *FLAGS, "-fPIC", "-shared", "one.cpp", "two.cpp", "-o", "both.so"], cwd=tmp_path,
                   check=True)
    asked = subprocess.run(["nm", "-D", "--undefined-only", "both.so"], cwd=tmp_path, check=True, capture_output=True,
                           text=True).stdout
    names = {line.split()[-1].partition("@")[0] for line in asked.splitlines()}
    assert not {n for n in names if n.startswith(("_Z", "malloc", "free", "calloc", "__cxa_throw", "pthread"))}


def test_the_command_line_writes_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.toml").write_text('[rig]\nmodel = "DriveTrain.Rigs.GearedJoint"\n')
    assert main(["export", "arm.toml", "--to", "cpp", "--out", "made"]) == 0
    assert "class Estimate" in (tmp_path / "made" / "arm.hpp").read_text()

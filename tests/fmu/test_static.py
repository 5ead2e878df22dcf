"""The sources of several FMUs in one program, as for an embedded system: linked statically, with prefixes."""

import hashlib
import re
import shutil
import subprocess

import pytest

from pycosim.control.controllers import position_control
from pycosim.export import build
from pycosim.export.controller import describe_block
from pycosim.export.fmu import contents
from pycosim.export.source import headers, sources

KEPT = {"fmi2FunctionTypes.h": "3d9051a7a05011b26150875c8e30641a544ec519d64e2d42c415b22b1ca01df4",
        "fmi2Functions.h": "bea68c7c645c89d6be2a7b2f983b7fc574e8fe9d518030282199a972ea23be61",
        "fmi2TypesPlatform.h": "e46f1bcac910fe8bb627888a1a8fc2ab886181a2410ea823867f4d4aed37ad48",
        "fmi3FunctionTypes.h": "77bb086dbf9b9123f75edc2a90a0f27fb5c32f913ab3f9b69fe2e2cbc2448b24",
        "fmi3Functions.h": "6367e9f7895848ed8d06c8a9b7f77e72d9f3eae102f64c313d51c10049b720ee",
        "fmi3PlatformTypes.h": "19ea19ae07cdab582931fc1a545d9aeef3d5066da131ee96a7e393e72164fa30"}

MAIN = {2: """
#include <stdio.h>
#define FMI2_FUNCTION_PREFIX plant_
#include "plant/fmi2Functions.h"
extern fmi2Component controller_fmi2Instantiate(fmi2String, fmi2Type, fmi2String, fmi2String,
                                                const fmi2CallbackFunctions *, fmi2Boolean, fmi2Boolean);
extern fmi2Status controller_fmi2DoStep(fmi2Component, fmi2Real, fmi2Real, fmi2Boolean);
extern fmi2Status controller_fmi2SetupExperiment(fmi2Component, fmi2Boolean, fmi2Real, fmi2Real, fmi2Boolean, fmi2Real);
extern fmi2Status controller_fmi2EnterInitializationMode(fmi2Component);
extern fmi2Status controller_fmi2ExitInitializationMode(fmi2Component);
static void quiet(fmi2ComponentEnvironment e, fmi2String n, fmi2Status s, fmi2String c, fmi2String m, ...) {
    (void)e, (void)n, (void)s, (void)c, (void)m;
}
int main(int n, char **token) {
    fmi2CallbackFunctions f = {quiet, NULL, NULL, NULL, NULL};
    fmi2Component a = plant_fmi2Instantiate("a", fmi2CoSimulation, token[1], NULL, &f, 0, 0);
    fmi2Component b = controller_fmi2Instantiate("b", fmi2CoSimulation, token[2], NULL, &f, 0, 0);
    if (n != 3 || !a || !b) return 1;
    plant_fmi2SetupExperiment(a, 0, 0, 0, 0, 0), controller_fmi2SetupExperiment(b, 0, 0, 0, 0, 0);
    plant_fmi2EnterInitializationMode(a), controller_fmi2EnterInitializationMode(b);
    plant_fmi2ExitInitializationMode(a), controller_fmi2ExitInitializationMode(b);
    return plant_fmi2DoStep(a, 0, 1e-3, 1) || controller_fmi2DoStep(b, 0, 1e-3, 1);
}
""", 3: """
#include <stdio.h>
#define FMI3_FUNCTION_PREFIX plant_
#include "plant/fmi3Functions.h"
extern fmi3Instance controller_fmi3InstantiateCoSimulation(fmi3String, fmi3String, fmi3String, fmi3Boolean, fmi3Boolean,
    fmi3Boolean, fmi3Boolean, const fmi3ValueReference[], size_t, fmi3InstanceEnvironment, fmi3LogMessageCallback,
    fmi3IntermediateUpdateCallback);
extern fmi3Status controller_fmi3EnterInitializationMode(fmi3Instance, fmi3Boolean, fmi3Float64, fmi3Float64,
                                                         fmi3Boolean, fmi3Float64);
extern fmi3Status controller_fmi3ExitInitializationMode(fmi3Instance);
extern fmi3Status controller_fmi3DoStep(fmi3Instance, fmi3Float64, fmi3Float64, fmi3Boolean, fmi3Boolean *,
                                        fmi3Boolean *, fmi3Boolean *, fmi3Float64 *);
int main(int n, char **token) {
    fmi3Boolean x, y, z;
    fmi3Float64 t;
    fmi3Instance a = plant_fmi3InstantiateCoSimulation("a", token[1], NULL, 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL);
    fmi3Instance b = controller_fmi3InstantiateCoSimulation("b", token[2], NULL, 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL);
    if (n != 3 || !a || !b) return 1;
    plant_fmi3EnterInitializationMode(a, 0, 0, 0, 0, 0), controller_fmi3EnterInitializationMode(b, 0, 0, 0, 0, 0);
    plant_fmi3ExitInitializationMode(a), controller_fmi3ExitInitializationMode(b);
    return plant_fmi3DoStep(a, 0, 1e-3, 1, &x, &y, &z, &t) || controller_fmi3DoStep(b, 0, 1e-3, 1, &x, &y, &z, &t);
}
"""}


@pytest.mark.parametrize("fmi", [2, 3])
def test_plant_and_controller_link_into_one_program(plant, model, tmp_path, fmi):
    tool = shutil.which("gcc") or pytest.skip("no gcc")
    rig, tokens = model("GearedJoint"), []
    block = position_control(rig, {n: v.value for n, v in rig.parameters.items()})
    (tmp_path / "main.c").write_text(MAIN[fmi])
    for name, part in (("plant", plant("GearedJoint")), ("controller", describe_block(block))):
        files, token = sources(part, fmi, ("cs",))
        tokens.append(token)
        (tmp_path / name).mkdir()
        for file, content in files.items():
            (tmp_path / name / file).write_bytes(content)
        prefix = f"-DFMI{fmi}_FUNCTION_PREFIX={name}_"
        subprocess.run([tool, "-std=c99", "-O0", prefix, "-c", f"{name}/fmi{fmi}.c", "-o", f"{name}.o"], cwd=tmp_path,
                       check=True)
        shown = subprocess.run(["nm", "--defined-only", "-g", f"{name}.o"], cwd=tmp_path, capture_output=True,
                               text=True, check=True).stdout.split("\n")[:-1]
        assert len(shown) > 40 and all(line.split()[-1].startswith(f"{name}_fmi{fmi}") for line in shown)
    done = subprocess.run([tool, "-std=c99", "main.c", "plant.o", "controller.o", "-lm", "-o", "both"], cwd=tmp_path,
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert subprocess.run([tmp_path / "both", *tokens]).returncode == 0


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_headers_are_the_standards_unaltered(fmi):
    for name, content in headers(fmi).items():
        assert hashlib.sha256(content).hexdigest() == KEPT[name], name
        assert b"has been changed" not in content
        assert (f"FMI{fmi}_FUNCTION_PREFIX".encode() in content) == (name == f"fmi{fmi}Functions.h")


def test_the_host_binary_runs_on_systems_of_2012(plant, tmp_path):
    """It needs no newer glibc than the cross-compiled ones, though the system's own compiler made it."""
    tool = shutil.which("objdump") or pytest.skip("no objdump")
    if build.host().name != "x86_64-linux":
        pytest.skip("not linux x86-64")
    files = contents(plant("HipKnee"), 2, ("cs", "me"))
    library = tmp_path / "library.so"
    library.write_bytes(next(content for n, content in files.items() if n.startswith("binaries/")))
    shown = subprocess.run([tool, "-T", str(library)], capture_output=True, text=True, check=True).stdout
    needed = {tuple(map(int, v.split("."))) for v in re.findall(r"GLIBC_([0-9.]+)", shown)}
    assert needed and max(needed) <= (2, 17), sorted(needed)
    assert re.search(r"GLIBC_2\.2\.5\)? +exp\b", shown)  # a function of which there is a newer version

"""Time of a co-simulation step of the hip-knee plant, as ratios in one run: ``python -m benchmarks.speed.fmu``.

The bare step is the C function that CasADi generates, called in a loop in C from the same translation unit; the FMU's
step goes through fmi2DoStep with an input set and an output read; both compiled alike.
"""

from __future__ import annotations

import ctypes
import json
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

import numpy as np

from pycosim.compile import Library
from pycosim.export.build import FLAGS, compiler, host
from pycosim.export.fmu import export_fmu
from pycosim.study.schema import Study

STEPS = 20000
_DRIVER = r"""
#include "fmi2.c"
#include <time.h>

static double seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}
static void quiet(fmi2ComponentEnvironment e, fmi2String n, fmi2Status s, fmi2String c, fmi2String m, ...) {
    (void)e, (void)n, (void)s, (void)c, (void)m;
}
static Instance *start(void) {
    static fmi2CallbackFunctions f = {quiet, NULL, NULL, NULL, NULL};
    Instance *m = fmi2Instantiate("bench", fmi2CoSimulation, MODEL_TOKEN, NULL, &f, 0, 0);
    fmi2SetupExperiment(m, 0, 0, 0, 0, 0);
    fmi2EnterInitializationMode(m);
    fmi2ExitInitializationMode(m);
    return m;
}
static double torque(int k) { return 0.8 * sin(3e-3 * k); }

double bare(int n) {
    Instance *m = start();
    double t, h = 1e-3, begin = seconds();
    for (int k = 0; k < n; k++) {
        m->s.u[0] = torque(k);
        t = k * h;
        const double *in[] = {m->s.x, m->s.z, m->s.u, m->s.u, m->q, &t, &h};
        memcpy(m->arg, in, sizeof in);
        double error;
        m->res[0] = m->x_next, m->res[1] = m->z_next, m->res[2] = &error;
        model_step(m->arg, m->res, m->iw, m->w, 0);
        memcpy(m->s.x, m->x_next, sizeof m->s.x);
        memcpy(m->s.z, m->z_next, sizeof m->s.z);
    }
    double took = seconds() - begin;
    fmi2FreeInstance(m);
    return took / n;
}
double wrapped(int n, int reading) {
    Instance *m = start();
    fmi2ValueReference in = VR_U, out = VR_Y + NY / 2;
    double y, begin = seconds();
    for (int k = 0; k < n; k++) {
        double u = torque(k);
        fmi2SetReal(m, &in, 1, &u);
        fmi2DoStep(m, k * 1e-3, 1e-3, 1);
        if (reading) fmi2GetReal(m, &out, 1, &y);
    }
    double took = seconds() - begin;
    fmi2FreeInstance(m);
    return took / n;
}
size_t memory(void) {
    casadi_int n[4], most[4] = {0};
    for (size_t k = 0; k < sizeof model_work / sizeof *model_work; k++) {
        model_work[k](&n[0], &n[1], &n[2], &n[3]);
        for (int i = 0; i < 4; i++) if (n[i] > most[i]) most[i] = n[i];
    }
    return sizeof(Instance) + most[0] * sizeof(void *) + most[1] * sizeof(void *) + most[2] * sizeof(casadi_int)
        + most[3] * sizeof(double) + 64;
}
int main(void) {
    double best[3] = {1, 1, 1};
    for (int k = 0; k < 200; k++) { /* short windows, as cores are shared */
        double t[] = {bare(500), wrapped(500, 0), wrapped(500, 1)};
        for (int i = 0; i < 3; i++) best[i] = t[i] < best[i] ? t[i] : best[i];
    }
    printf("{\"bare\": %.4g, \"step\": %.4g, \"step_and_read\": %.4g, \"memory\": %zu}\n", best[0], best[1], best[2],
           memory());
    return 0;
}
"""

_PYTHON = '''
"""The same equations, stepped by CasADi in Python behind pythonfmu3."""
from pythonfmu3 import Fmi3Causality, Fmi3Slave, Fmi3Status, Fmi3StepResult, Float64
from pathlib import Path
import casadi as ca
import numpy as np


class Plant(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time, self.tau1, self.q_H = 0.0, 0.0, 0.0
        self.f = ca.Function.load(str(Path(self.resources) / "step.casadi"))
        data = np.load(Path(self.resources) / "start.npz")
        self.x, self.z, self.q = data["x"], data["z"], data["q"]
        self.register_variable(Float64("time", causality=Fmi3Causality.independent))
        self.register_variable(Float64("tau1", causality=Fmi3Causality.input))
        self.register_variable(Float64("q_H", causality=Fmi3Causality.output))

    def do_step(self, t, h):
        u = [self.tau1, 0.0, 0.0, 0.0]
        self.x, self.z = self.f(self.x, self.z, u, u, self.q, t, h)[:2]
        self.q_H = float(self.x[2])
        return Fmi3StepResult(status=Fmi3Status.ok)
'''


def in_c(folder):
    """Times of a step [s] and memory of an instance [B], measured in C."""
    source = Path(folder) / "sources"
    (source / "bench.c").write_text("#define _POSIX_C_SOURCE 199309L\n" + _DRIVER)
    command, _ = compiler(host())
    flags = [f for f in FLAGS if f not in ("-shared", "-fPIC")]
    subprocess.run([*command, *flags, "bench.c", "-o", "bench", "-lm"], cwd=source, check=True)
    return json.loads(subprocess.run([source / "bench"], capture_output=True, text=True, check=True).stdout)


def through_fmpy(path, steps=STEPS):
    """Least times of a step [s] through fmpy's own classes, with an exchange every 20 and every step; then without."""
    from fmpy import extract, read_model_description
    from fmpy.fmi2 import FMU2Slave
    from fmpy.fmi3 import FMU3Slave
    d = read_model_description(str(path))
    vr = {v.name: v.valueReference for v in d.modelVariables}
    kind = FMU2Slave if d.fmiVersion == "2.0" else FMU3Slave
    token = d.guid if d.fmiVersion == "2.0" else d.instantiationToken
    plant = kind(guid=token, unzipDirectory=extract(str(path)), modelIdentifier=d.coSimulation.modelIdentifier,
                 instanceName="bench")
    put, get = (plant.setReal, plant.getReal) if kind is FMU2Slave else (plant.setFloat64, plant.getFloat64)
    plant.instantiate()
    if kind is FMU2Slave:
        plant.setupExperiment()
    plant.enterInitializationMode()
    plant.exitInitializationMode()
    best, k, tau, q, part = [np.inf, np.inf], 0, [vr["tau1"]], [vr["q_H"]], steps // 100
    for each in [20, 1] * 50:  # steps between two exchanges; short windows, as cores are shared
        torques = (0.8 * np.sin(3e-3 * np.arange(k, k + part))).tolist()
        begin = time.perf_counter()
        for j, torque in enumerate(torques):
            if j % each == 0:
                put(tau, [torque])
                get(q)
            plant.doStep(currentCommunicationPoint=k * 1e-3, communicationStepSize=1e-3)
            k += 1
        best[each == 1] = min(best[each == 1], (time.perf_counter() - begin) / part)
    best.append(_alone(plant, k, part) if kind is FMU3Slave else np.nan)
    plant.terminate()
    plant.freeInstance()
    return best


def _alone(plant, k, steps):
    """Least time of fmi3DoStep [s], called without fmpy's handling of its arguments."""
    t, h, flags, last = ctypes.c_double(), ctypes.c_double(1e-3), [ctypes.c_bool() for _ in range(3)], ctypes.c_double()
    results = [ctypes.byref(v) for v in (*flags, last)]
    call, component, best = plant.dll.fmi3DoStep, plant.component, np.inf
    for _ in range(50):
        begin = time.perf_counter()
        for _ in range(steps):
            t.value, k = k * 1e-3, k + 1
            call(component, t, h, True, *results)
        best = min(best, (time.perf_counter() - begin) / steps)
    return best


def in_python(model, folder):
    """The same equations as an FMU made with pythonfmu3, stepped the same way; None where it is not installed."""
    from pycosim.dynamics.simulate import dynamics
    d = dynamics(model)
    folder = Path(folder)
    d.step.save(str(folder / "step.casadi"))
    q = np.array(d.prepare([model.parameters[n].value for n in d.parameters])).ravel()
    x = np.zeros(len(d.states))
    z = np.array(d.initial(x, np.zeros(len(d.algebraic)), np.zeros(len(d.inputs)), q, 0)).ravel()
    np.savez(folder / "start.npz", x=x, z=z, q=q)
    (folder / "plant.py").write_text(_PYTHON)
    done = subprocess.run([sys.executable, "-m", "pythonfmu3", "build", "-f", "plant.py", "step.casadi", "start.npz"],
                          cwd=folder, capture_output=True, text=True)
    if done.returncode:
        print(done.stdout, done.stderr, file=sys.stderr)
        return None
    return through_fmpy(folder / "Plant.fmu", 2000)


def main():
    """Print every figure with its aim."""
    study = Study(Path("bench.toml"), "DriveTrain.Rigs.HipKnee")
    model = study.validate(Library())
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        two, three = (export_fmu(study, model, folder, fmi) for fmi in (2, 3))
        zipfile.ZipFile(two).extractall(folder / "two")
        c = in_c(folder / "two")
        fmpy2, fmpy3 = through_fmpy(two), through_fmpy(three)
        python = in_python(model, folder)
    print(f"bare C step {1e6 * c['bare']:.2f} us; doStep with an input {c['step'] / c['bare']:.2f} times that "
          f"(aim: 1.1), with an output read {c['step_and_read'] / c['bare']:.2f} times")
    print(f"memory of an instance {c['memory'] / 1024:.1f} KiB (aim: below 100)")
    for version, took in ((2, fmpy2), (3, fmpy3)):
        for what, t in zip(("inputs every 20 ms", "inputs and outputs every step"), took):
            print(f"through fmpy, FMI {version}, {what}: {1e6 * t:.2f} us a step of 1 ms, {1e-3 / t:.0f} times real "
                  f"time (aim: 200); {1e6 * c['step']:.2f} us of it in the FMU, the rest in fmpy and ctypes")
    if python:
        print(f"the same equations behind pythonfmu3: {1e6 * python[0]:.1f} us a step, {python[0] / fmpy3[0]:.1f} "
              "times as long as ours through the same importer (aim: 20)")
        print(f"fmi3DoStep called by ctypes, without fmpy: {1e6 * python[2]:.1f} us behind pythonfmu3, "
              f"{python[2] / fmpy3[2]:.1f} times our {1e6 * fmpy3[2]:.2f} us; fmpy's handling of a step of FMI 3 takes "
              f"{1e6 * (fmpy3[0] - fmpy3[2]):.2f} us")


if __name__ == "__main__":
    main()

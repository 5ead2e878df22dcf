"""Time one step and one estimate in generated C, against real time, a memcpy, and the same equations in Python.

    python -m benchmarks.speed.step [--rig DriveTrain.Rigs.HipKnee] [--steps 200000]

The C is what `export_c` writes, compiled with ``-O2``. Times are the least over short windows, since cores are shared;
the time of a dependent multiplication tells how fast the core ran. In Python the very same step is called one
step at a time, as a Python FMU's ``do_step`` would; its arithmetic runs in CasADi's interpreter, not in Python's.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

DRIVER = r"""
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <math.h>
#include <time.h>
#include "rig.h"
#define WINDOW 500
static double now(void) {
  struct timespec a;
  clock_gettime(CLOCK_MONOTONIC, &a);
  return 1e6 * a.tv_sec + 1e-3 * a.tv_nsec;
}
static double least(double a, double b) { return a < b ? a : b; }
int main(int argc, char **argv) {
  double p[NP], x[NX], z[NZ + 1], worst = 0, error, t = 0;
  double in[NI], out[NO], back[NI], s[NS + 1], step = 1e9, estimate = 1e9, copy = 1e9, multiply = 1e9, q = 1;
  volatile double keep = 1.0000001;
  long windows = (argc > 1 ? atol(argv[1]) : 200000) / WINDOW;
  rig_parameters(p);
  for (int i = 0; i < NI; ++i) in[i] = 0.3 + 0.1 * i;
  for (int i = 0; i < NS; ++i) s[i] = 0.5;
  memset(x, 0, sizeof x); memset(z, 0, sizeof z);
  for (long k = 0; k < windows; ++k) {
    double inputs[WINDOW + 1][NU + 1], start;
    for (int j = 0; j <= WINDOW; ++j) for (int i = 0; i < NU; ++i) inputs[j][i] = 0.5 * sin(2 * (t + 1e-3 * j) + i);
    start = now();
    for (int j = 0; j < WINDOW; ++j) {
      rig_simulate_step(x, z, inputs[j], inputs[j + 1], p, t, 1e-3, x, z, &error);
      t += 1e-3;
      if (!(error <= worst)) worst = error;
    }
    step = least(step, (now() - start) / WINDOW);
    start = now();
    for (int j = 0; j < WINDOW; ++j) { in[0] += 1e-6; rig_estimate(in, s, p, out); keep = out[0]; }
    estimate = least(estimate, (now() - start) / WINDOW);
    start = now();
    for (int j = 0; j < 20 * WINDOW; ++j) {
      memcpy(back, in, sizeof in);
      __asm__ volatile("" : : "r"(back) : "memory");
    }
    copy = least(copy, (now() - start) / (20 * WINDOW));
    start = now(); keep = 1.0000001;
    for (int j = 0; j < WINDOW; ++j) q *= keep;
    multiply = least(multiply, (now() - start) / WINDOW);
  }
  keep = q;
  printf("%.17g %.17g %.17g %.17g %.17g\n", step, estimate, copy, multiply, worst);
  return 0;
}
"""


def in_c(model, steps):
    """Microseconds of a step, an estimate, a memcpy and a multiplication, and the largest error of a step."""
    from pycosim.dynamics.simulate import dynamics
    from pycosim.export.c import export_c
    d, asked = dynamics(model), model.question("estimate")
    sizes = {"NP": model.parameters, "NX": d.states, "NZ": d.algebraic, "NU": d.inputs, "NI": asked.inputs,
             "NO": asked.outputs, "NS": asked.states}
    with tempfile.TemporaryDirectory() as folder:
        _, source = export_c(model, {}, folder, "rig")
        driver, program = Path(folder) / "driver.c", Path(folder) / "driver"
        driver.write_text(DRIVER)
        defined = [f"-D{k}={len(v)}" for k, v in sizes.items()]
        subprocess.run(["gcc", "-O2", *defined, driver, source, "-o", program, "-lm"], check=True)
        found = subprocess.run([program, str(steps)], check=True, capture_output=True, text=True).stdout
    return [float(v) for v in found.split()]


def in_python(model, steps=300):
    """Microseconds of a step called from Python, as a Python FMU would; and of a step within `simulate`."""
    from pycosim.dynamics.simulate import dynamics, simulate
    d, best, inside = dynamics(model), math.inf, math.inf
    q = d.prepare([v.value for v in model.parameters.values()])
    clock = np.arange(steps + 1) * 1e-3
    inputs = [[0.5 * math.sin(2 * t + i) for i in range(len(d.inputs))] for t in clock]
    columns = dict(zip(d.inputs, np.array(inputs).T))
    for _ in range(8):
        x, z = [0.0] * len(d.states), [0.0] * len(d.algebraic)
        start = time.perf_counter()
        for k in range(steps):
            x, z, _ = d.step(x, z, inputs[k], inputs[k + 1], q, clock[k], 1e-3)
        best = min(best, (time.perf_counter() - start) / steps)
        start = time.perf_counter()
        simulate(model, columns, clock)
        inside = min(inside, (time.perf_counter() - start) / steps)
    return 1e6 * best, 1e6 * inside


def main():
    """Print the table."""
    from pycosim.compile import Library, compile_model
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rig", nargs="*", default=["DriveTrain.Rigs.HipKnee"])
    parser.add_argument("--steps", type=int, default=200000)
    args = parser.parse_args()
    for rig in args.rig:
        model = compile_model(Library(), rig)
        step, estimate, copy, multiply, worst = in_c(model, args.steps)
        called, inside = in_python(model)
        print(f"{rig}: a multiplication takes {1e3 * multiply:.2f} ns on this core, now")
        print(f"  step of 1 ms in C   {step:7.2f} us   {1e3 / step:.0f} times real time; "
              f"largest error {worst:.2g} of 1")
        print(f"  the same in Python  {called:7.1f} us   {called / step:.0f} times the C; "
              f"within simulate {inside:.1f} us")
        print(f"  estimate in C       {estimate:7.3f} us   {estimate / copy:.0f} times a memcpy of its inputs "
              f"({1e3 * copy:.1f} ns)")


if __name__ == "__main__":
    main()

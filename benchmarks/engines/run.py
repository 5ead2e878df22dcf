"""The same law in every engine: nothing in, the measured numbers of each claim as JSON on stdout, out.

``python -m benchmarks.engines.run [law] [trajectories] [swing] [rest] [cost] [jax] [header] [draws] [calibration]``
"""

from __future__ import annotations

import copy
import ctypes
import importlib.util
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import pycosim as pc
from benchmarks.engines.machines import four_legs, on_links, steps
from pycosim.compile import Library
from pycosim.dynamics.simulate import dynamics, simulate
from pycosim.export import build, mujoco_plugin
from pycosim.export.cpp import cpp_source
from pycosim.export.description import describe, values
from pycosim.export.jax_drive import jax_source
from pycosim.export.law import drive_law
from pycosim.export.mujoco import to_mjcf
from pycosim.study.parse import load_study
from pycosim.study.schema import Setting, Study

LIBRARY = Library()
EFFECTS = {
    "GearedJoint": ([("viscous", "gear"), ("stribeck", "gear"), ("torque_ripple", "motor"),
                     ("load_hysteresis", "gear")],
                    {"gear.mu": 0.85, "viscous_gear.b": 1e-4, "stribeck_gear.fs": 0.01, "torque_ripple_motor.A": 0.01,
                     "load_hysteresis_gear.mu_dif": 0.02, "load_hysteresis_gear.h": 0.02}),
    "ServoPendulum": ([("load_dependence", "gear")], {"load_dependence_gear.mu": 0.8}),
    "HipKnee": ([("viscous", "1B")], {"motor1.J": 1e-3, "motor2.J": 2e-3, "s1A.mu": 0.9, "viscous_1B.b": 1e-3})}
SERVO = Path(__file__).parents[2] / "examples" / "servo_pendulum" / "study.toml"


def machine(rig):
    """Study, model, values and law of a rig with effects."""
    effects, given = EFFECTS[rig]
    study = Study(Path(f"/bench/{rig.lower()}_bench.toml"), f"DriveTrain.Rigs.{rig}", effects=effects,
                  parameters={n: Setting(v) for n, v in given.items()})
    model = study.validate(LIBRARY)
    known = values(study, model)
    return study, model, known, drive_law(model, known)


def servo():
    """The XL330 with the load-dependent friction that its logs identify: study, model, values, law, fit."""
    study = replace(load_study(SERVO), effects=[("load_dependence", "gear")])
    fitted = pc.open(study).fit()
    model, found = fitted.model, fitted.solution
    study = replace(study, parameters={**study.parameters, **{n: Setting(found.parameters[n]) for n in found.free}})
    known = values(study, model)
    return study, model, known, drive_law(model, known), found


def compiled(law, folder, *more):
    """The law as a library of C: its functions, parameters prepared."""
    source = mujoco_plugin.law_source(law, ("prepare", "torque", "implicit", "follow"))
    text = ["#include <math.h>", source.replace("static void drive_", "void drive_"), *more]
    (Path(folder) / "law.c").write_text("\n".join(text))
    subprocess.run([*build.compiler(build.host())[0], "-O2", "-shared", "-fPIC", "law.c", "-o", "law.so", "-lm"],
                   cwd=folder, check=True)
    return ctypes.CDLL(str(Path(folder) / "law.so"))


def pointer(a):
    """An array as C takes it."""
    return a.ctypes.data_as(ctypes.c_void_p)


_MANY = """
void many(int n, int m, int k, const double *phi, const double *w, const double *a, const double *mean, const double *x,
          const double *u, const double *t, double h, const double *q, double *tau, double *next) {
  for (int i = 0; i < n; ++i)
    drive_torque(phi + i*m, w + i*m, a + i*m, mean + i*m, x + i*k, u + i*m, t[i], h, q, tau + i*m, next + i*k);
}
void solve(int n, const double *phi, const double *w, const double *x, const double *u, const double *t, double h,
           const double *mobility, const double *free, const double *q, double *tau, double *next) {
  for (int i = 0; i < n; ++i) {
    double v = w[i], slope, change;
    for (int k = 0; k < 30; ++k) {
      drive_implicit(&v, x + i, phi + i, w + i, u + i, t[i], h, q, tau + i, &slope);
      change = (v - free[i] - h * mobility[i] * tau[i]) / (1 - h * mobility[i] * slope);
      v -= k < 12 ? change : change / 2;
      if (fabs(change) <= 1e-6 * (1 + fabs(v))) break;
    }
    tau[i] -= slope * change;
    drive_follow(&v, x + i, h, q, next + i);
  }
}
"""


def load_jax(law, folder):
    """The module that JAX runs."""
    path = Path(folder) / "bench_drive.py"
    path.write_text(jax_source(law, "bench"))
    spec = importlib.util.spec_from_file_location("bench_drive", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def law(points=1_000_000, block=50_000):
    """Largest difference of torque to the FMU's step over full scale: C, and JAX in single precision."""
    found = {}
    for rig in EFFECTS:
        _, model, known, own = machine(rig)
        n = points if rig == "ServoPendulum" else points // 10
        full, off, single = 0.0, 0.0, 0.0
        with tempfile.TemporaryDirectory() as folder:
            c, module, q = compiled(own, folder, _MANY), load_jax(own, folder), own.prepared()
            import jax
            run = jax.jit(jax.vmap(module.torque, (0,) * 7 + (None, None)))
            for seed in range(max(1, n // block)):
                ok, x, u, t, before, after, d = steps(model, known, own, min(n, block), seed=seed)
                wanted = np.array(on_links(rig, after, known)).T
                phi, w, a, last = (np.ascontiguousarray(np.array([y[f"{m}.{k}"] for m in own.motors]).T)
                                   for y, k in ((after, "phi"), (after, "w"), (after, "a"), (before, "phi")))
                given = [phi, w, a, (phi - last) / 1e-3, x[:, [d.states.index(s) for s in own.states]],
                         u[:, [d.inputs.index(s) for s in own.inputs]], t + 1e-3]
                given = [np.ascontiguousarray(g) for g in given]
                tau, following = np.empty_like(phi), np.empty_like(given[4])
                sizes, end = (len(phi), phi.shape[1], given[4].shape[1]), (q, tau, following)
                c.many(*sizes, *map(pointer, given), ctypes.c_double(1e-3), *map(pointer, end))
                full, off = max(full, np.abs(wanted[ok]).max()), max(off, np.abs(tau - wanted)[ok].max())
                few = [g.astype(np.float32) for g in given]  # rounded first: both take the same numbers
                wide = [np.ascontiguousarray(g, float) for g in few]
                c.many(*sizes, *map(pointer, wide), ctypes.c_double(1e-3), *map(pointer, end))
                answer = np.array(run(*few, np.float32(1e-3), module.prepare(module.parameters()))[0])
                single = max(single, np.abs(answer - tau)[ok].max())
        found[rig] = {"points": n, "c": off / full, "jax_float32": single / full}
    return found


def trajectories(count=100):
    """The law in C along motions of the FMU's step, its states carried by itself: torque off, over full scale."""
    found, t, rng = {}, np.arange(1001) * 1e-3, np.random.default_rng(0)
    for rig, start, size in (("GearedJoint", "q", 0.6), ("ServoPendulum", "motor.phi", 5.0)):
        _, model, known, own = machine(rig)
        m, off, full = own.motors[0], 0.0, 0.0
        with tempfile.TemporaryDirectory() as folder:
            c, q = compiled(own, folder), own.prepared()
            for _ in range(count):
                u = size * rng.uniform(0.1, 1) * np.sin(rng.uniform(2, 25) * t + rng.uniform(0, 6)) * (t < 0.7)
                y = simulate(model, {own.inputs[0]: u}, t, known, {start: rng.uniform(-1, 1)})
                wanted, x, tau = on_links(rig, y, known)[0], np.zeros(len(own.states)), np.zeros(1)
                mean = np.diff(y[f"{m}.phi"]) / 1e-3
                for k in range(1, len(t)):
                    given = [np.array([v]) for v in (*(y[f"{m}.{n}"][k] for n in ("phi", "w", "a")), mean[k - 1])]
                    c.drive_torque(*map(pointer, given), pointer(x), pointer(u[k:k + 1]), ctypes.c_double(t[k]),
                                   ctypes.c_double(1e-3), pointer(q), pointer(tau), pointer(x))
                    off = max(off, abs(tau[0] - wanted[k]))
                full = max(full, np.abs(wanted).max())
        found[rig] = {"trajectories": count, "c": off / full}
    return found


def plugin(study, model, own, folder):
    """MuJoCo, and the bodies of a study, its plugin loaded."""
    import mujoco
    file, content = mujoco_plugin.build_plugin(mujoco_plugin.plugin_source(own, study.name), study.name)
    (Path(folder) / file).write_bytes(content)
    mujoco.mj_loadPluginLibrary(str(Path(folder) / file))
    return mujoco, to_mjcf(describe(study, model), (mujoco_plugin.plugin_name(study.name), own.inputs))[0]


def swing():
    """The XL330 in MuJoCo and as the FMU steps it, in closed loop on its 16 logged goals; largest difference [rad].

    With RK4, as exported, the plugin steps as the FMU does; the other integrators of MuJoCo move angles by order one.
    """
    study, model, known, own, _ = servo()
    folder = SERVO.parents[3] / "shared" / "data" / "bam_xl330"
    d, found = dynamics(model), {}
    step = d.step
    with tempfile.TemporaryDirectory() as temporary:
        mujoco, text = plugin(study, model, own, temporary)
        for integrator, h in (("RK4", 1e-3), ("RK4", 2e-3), ("IMPLICITFAST", 1e-3), ("IMPLICITFAST", 1e-4)):
            worst = {}
            for path in sorted(folder.glob("*.json")):
                log = json.loads(path.read_text())
                t = np.array([e["timestamp"] for e in log["entries"]])
                goal = np.array([e["goal_position"] for e in log["entries"]])
                grid = np.arange(t[0], t[-1], h)
                wanted = np.interp(grid, t, goal)
                gain = log["kp"] / 100.0  # V/rad times the supply, of the order of the firmware's
                theirs = mujoco.MjModel.from_xml_string(text)
                theirs.opt.timestep = h
                theirs.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
                data, q = mujoco.MjData(theirs), np.array(d.prepare([known[n] for n in d.parameters])).ravel()
                x, z = np.zeros(len(d.states)), np.zeros(len(d.algebraic))
                at = d.states.index(d.start["motor.phi"])
                x[at] = data.qpos[0] = log["entries"][0]["position"]
                off = 0.0
                for k, goal_now in enumerate(wanted):
                    ours = np.clip(gain * (goal_now - x[at]) * 7.0, -7.0, 7.0)
                    data.ctrl[:] = np.clip(gain * (goal_now - data.qpos[0]) * 7.0, -7.0, 7.0)
                    mujoco.mj_step(theirs, data)
                    x, z, error = (np.array(v).ravel() for v in step(x, z, ours, ours, q, k * h, h))
                    assert error[0] <= 1
                    off = max(off, abs(x[at] - data.qpos[0]))
                worst[path.stem] = off
            found[f"{integrator}, step {h:g} s"] = {"worst": max(worst.values()),
                                                    "median": float(np.median(list(worst.values())))}
    return found


def rest():
    """Creep of a loaded joint at 80 % of breakaway in 60 s [rad], by step."""
    study, model, _, own = machine("GearedJoint")
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        mujoco, text = plugin(study, model, own, folder)
        for integrator, h in (("RK4", 1e-3), ("RK4", 2e-3), ("IMPLICITFAST", 1e-3), ("IMPLICITFAST", 2e-3)):
            theirs = mujoco.MjModel.from_xml_string(text)
            theirs.opt.timestep = h
            theirs.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
            data, breakaway = mujoco.MjData(theirs), 0.0
            trial = copy.copy(data)
            while abs(trial.plugin_state[0]) < 0.99:
                breakaway += 0.02
                trial.qfrc_applied[0] = breakaway
                mujoco.mj_step(theirs, trial, 20)
            data.qfrc_applied[0] = 0.8 * breakaway
            mujoco.mj_step(theirs, data, 1000)
            at = data.qpos[0]
            mujoco.mj_step(theirs, data, int(60 / h))
            found[f"{integrator}, step {h:g} s"] = {"creep": float(abs(data.qpos[0] - at)), "breakaway": breakaway}
    return found


def cost(rounds=100, steps_=200):
    """Time of mj_step of a robot of 12 joints at 1 ms [us] with the plugin, with motors, with MuJoCo's own friction.

    The motors play back the torques that the plugin gave: the same motion, bit for bit, so that the difference is what
    the plugin costs. Called from Python a step at a time (median over the steps), and in a loop in C (`rollout`); the
    least of many rounds taken in turn, each from the pose in which friction holds the robot: standing or hanging
    without voltage, or standing and then driven by a sine of 3 V at each motor, which no friction of MuJoCo's own
    answers with the same motion.
    """
    study, model, _, own = machine("ServoPendulum")
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        mujoco, _ = plugin(study, model, own, folder)
        for case, base, volts in (("standing", True, 0.0), ("hanging", False, 0.0), ("driven", True, 3.0)):
            robots = {"plugin": four_legs(study.name, base), "motors": four_legs("", base)}
            if not volts:
                robots["frictionloss"] = four_legs("", base, 'frictionloss="0.045" damping="0.0045"')
            made = {k: mujoco.MjModel.from_xml_string(t) for k, t in robots.items()}
            driven = volts * np.sin(np.arange(12) + 0.01 * np.arange(steps_)[:, None])
            for way, least in zip(("a step at a time", "in a loop in C"), _times(mujoco, made, driven, rounds)):
                part = least["plugin"] - least["motors"]
                found[f"{case}, {way}"] = {
                    **{f"mj_step {k} [us]": float(v) for k, v in least.items()}, "plugin [us]": float(part),
                    "over mj_step": float(part / least["plugin"]),
                    "over mj_step with motors": float(part / least["motors"])}
    return found


def _times(mujoco, made, driven, rounds):
    """Least times of a step [us] by robot, a step at a time and in a loop in C; ``motors`` move as ``plugin`` does."""
    from mujoco import rollout
    data, forces = {k: mujoco.MjData(m) for k, m in made.items()}, np.zeros_like(driven)
    mujoco.mj_step(made["plugin"], data["plugin"], 2000)
    settled = data["plugin"].qpos.copy()
    one, loop = dict.fromkeys(made, np.inf), dict.fromkeys(made, np.inf)
    for k in ["plugin", *[*made] * rounds]:
        m, d = made[k], data[k]
        mujoco.mj_resetData(m, d)
        d.qpos[:] = settled
        state = np.empty(mujoco.mj_stateSize(m, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(m, d, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        commands, took = forces if k == "motors" else driven, np.empty(len(driven))
        for i in range(len(driven)):
            d.ctrl[:] = commands[i]
            start = time.perf_counter()
            mujoco.mj_step(m, d)
            took[i] = time.perf_counter() - start
            if k == "plugin":
                forces[i] = d.actuator_force
        one[k] = min(one[k], np.median(took) * 1e6)
        end = d.qpos.copy()
        start = time.perf_counter()
        rollout.rollout(m, d, state, commands[None], nstep=len(driven))
        loop[k] = min(loop[k], (time.perf_counter() - start) / len(driven) * 1e6)
        if k == "plugin":
            there = end
        assert k != "motors" or (end == there).all()
    return one, loop


def batch(n=4096, rounds=400):
    """An implicit step of 4096 machines: JAX on the CPU against a loop in C, machine by machine, on one core [us].

    The least of many rounds: on a busy machine, JAX's threads wait for a core in most of them.
    """
    import jax
    _, _, _, own = machine("ServoPendulum")
    rng = np.random.default_rng(0)
    phi, w, x, u, t = (rng.uniform(-1, 1, (n, 1)) for _ in range(5))
    mobility, free = rng.uniform(100, 200, (n, 1, 1)), w + rng.uniform(-0.05, 0.05, (n, 1))
    with tempfile.TemporaryDirectory() as folder:
        c, module, q = compiled(own, folder, _MANY), load_jax(own, folder), own.prepared()
        tau, after = np.empty(n), np.empty(n)
        given = [pointer(a) for a in (phi, w, x, u, t)]

        def in_c():
            c.solve(n, *given, ctypes.c_double(1e-3), pointer(mobility), pointer(free), pointer(q), pointer(tau),
                    pointer(after))
        run = jax.jit(jax.vmap(module.step_torque, (0, 0, 0, 0, 0, None, 0, 0, None)))
        arrays = [jax.numpy.asarray(a, jax.numpy.float32) for a in (phi, w, x, u, t[:, 0])]
        bodies = (jax.numpy.asarray(a, jax.numpy.float32) for a in (mobility, free))
        rest_ = np.float32(1e-3), *bodies, module.parameters()
        run(*arrays, *rest_)[0].block_until_ready()
        least = {"c": np.inf, "jax": np.inf}
        for _ in range(rounds):
            for k, f in (("c", in_c), ("jax", lambda: run(*arrays, *rest_)[0].block_until_ready())):
                start = time.perf_counter()
                f()
                least[k] = min(least[k], (time.perf_counter() - start) * 1e6)
        off = np.abs(np.array(run(*arrays, *rest_)[0])[:, 0] - tau).max() / np.abs(tau).max()
    return {**{f"{k} [us]": v for k, v in least.items()}, "jax over c": least["jax"] / least["c"],
            "difference": float(off)}


_TIMED = """
#include "rig.hpp"
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <random>
#include <vector>
typedef std::chrono::steady_clock Clock;
static double microseconds(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double, std::micro>(to - from).count();
}
static void print(const char *name, std::vector<double> &took) {
  const size_t n = took.size();
  std::sort(took.begin(), took.end());
  std::printf("%s %g %g %g %g\\n", name, took[n / 2], took[n / 1000 * 999], took[n - 100], took[n - 1]);
}
template <class Block> void timed(const char *name) {
  std::mt19937 draw(1);
  std::uniform_real_distribution<double> one(-1, 1);
  static Block block;
  double now[Block::INPUT_COUNT], sum = 0;
  std::vector<double> took(1000000), least(1000000), empty(1000000);
  for (size_t k = 0; k < took.size() + 10000; ++k) {
    for (double &v : now) v = one(draw);
    double first = 0, best = 1e9, none = 0;
    Block tried;
    for (int i = 0; i < 5; ++i) { /* the same sample from the same state: what differs is not of the code */
      tried = block;
      const Clock::time_point start = Clock::now();
      sum += tried.step(now, 1e-3)[0];
      const Clock::time_point end = Clock::now(), after = Clock::now();
      const double t = microseconds(start, end);
      if (i == 0) first = t, none = microseconds(end, after);
      best = std::min(best, t);
    }
    block = tried;
    if (k >= 10000) took[k - 10000] = first, least[k - 10000] = best, empty[k - 10000] = none;
  }
  std::printf("%s %g\\n", name, sum);
  print("sample", took), print("least_of_five", least), print("nothing", empty);
}
int main() { timed<rig::Estimate>("Estimate"); timed<rig::Compensate>("Compensate"); }
"""


def header():
    """A sample of the C++ classes of the hip-knee rig [us]: random inputs, 10,000 to warm up, a million measured.

    Each is made once, and four times again from the same state: the least of the five is the code's own, what is above
    it is the machine's. ``nothing`` is the same two clock readings with nothing in between.
    """
    _, model, known, _ = machine("HipKnee")
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "rig.hpp").write_text(cpp_source(model, known, "rig"))
        (Path(folder) / "main.cpp").write_text(_TIMED)
        subprocess.run(["g++", "-O2", "-std=c++11", "main.cpp", "-o", "main"], cwd=folder, check=True)
        said = subprocess.run([Path(folder) / "main"], capture_output=True, text=True, check=True).stdout
    names, found = ("median", "99.9 %", "all but 100", "worst"), {}
    for what, *numbers in map(str.split, said.splitlines()):
        if len(numbers) == 1:
            block = found[what] = {}
        else:
            block[what] = dict(zip(names, map(float, numbers)))
    return found


def draws(n=100_000):
    """Mean and covariance of draws of the XL330's fit against the fit's own, and what bounds cut."""
    found = servo()[4]
    free, bounded = found.draw(n, bounded=False).values, found.draw(10_000)
    spread = np.sqrt(np.diag(found.covariance))
    return {"mean, over a standard deviation": float(np.abs((free.mean(axis=0) - found.unbounded) / spread).max()),
            "covariance, over its size": float(np.abs((np.cov(free.T) - found.covariance)
                                                      / np.outer(spread, spread)).max()),
            "bounded": bounded.lines() or "nothing is cut"}


def calibration():
    """Ten foreign FMUs."""
    from benchmarks.engines.calibration import run
    return run()


CLAIMS = {"law": law, "trajectories": trajectories, "swing": swing, "rest": rest, "cost": cost, "jax": batch,
          "header": header, "draws": draws, "calibration": calibration}


if __name__ == "__main__":
    for name in sys.argv[1:] or CLAIMS:
        print(json.dumps({name: CLAIMS[name]()}, indent=1), flush=True)

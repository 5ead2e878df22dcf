"""What does the simplified law cost, whose load term knows the output torque of a segment alone?

Run: python examples/cosim/simplified_law.py
The machine obeys the full law. A payload is on the leg, so that loads vary. The simplified law (OutputLoad.mo: the rig
with one line changed) estimates the joint torques of its log, with the machine's parameters and with its own best ones.
"""

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import HERE, IMAGES, T_R, changed, logged
from draw import simplified as figure
from draw import write

import pycosim as pc
from pycosim.compile import ArrayFunction, Library, compile_model
from pycosim.dynamics.simulate import estimate
from pycosim.export.description import values
from pycosim.study.parse import load_study

BINS, LAW = 8, HERE / "OutputLoad.mo"


def log():
    """The six manoeuvres with a heavy shank."""
    scenario = changed("six_manoeuvres", plant={"parameters": PAYLOAD}, controller={"parameters": PAYLOAD},
                       reference={"options": {"speeds": [0.8, 1.6], "repeats": 2}})
    return logged(scenario, 100, omega1="plant.motor1.w", omega2="plant.motor2.w")


PAYLOAD = {"leg.m1": 8.0, "leg.m2": 9.2, "leg.c2": 0.237}  # a grown person's thigh, and 6 kg more on the shank


def asked(model, given, run):
    """Answers of a law to the log, friction and load of 1A among them."""
    signals = {}
    for k in (1, 2):
        signals.update({f"motor{k}.phi": run[f"theta{k}"].to_numpy(), f"motor{k}.tau": run[f"tau{k}"].to_numpy(),
                        f"der(motor{k}.phi)": run[f"omega{k}"].to_numpy()})
    return estimate(model, signals, run["time"].to_numpy(), given)


def fitted(rig, path):
    """Friction parameters of a law that fit the log best."""
    study = load_study(HERE.parent / "hip_knee" / "study.toml")
    fit = pc.open(replace(study, rig=rig, reference="sensor", modelica=[LAW]), path).fit().solution
    return fit.parameters, fit.error


def binned(load, value):
    """Mean by load; loads that hardly occur are left out."""
    edges = np.quantile(load, np.linspace(0, 1, BINS + 1))
    which = np.clip(np.searchsorted(edges, load, side="right") - 1, 0, BINS - 1)
    return ([load[which == k].mean() for k in range(BINS)], [value[which == k].mean() for k in range(BINS)])


def cost(model, name, wanted):
    """Time of a question over 20,000 samples, least of seven [s], and its operations."""
    question = model.question(name).select(wanted)
    function, rng = ArrayFunction(question.output), np.random.default_rng(0)
    arguments = [rng.uniform(-1, 1, 20000) for _ in (*question.inputs, *question.states)]
    arguments += [model.parameters[p].value for p in question.parameters]
    times = []
    for _ in range(7):
        start = time.perf_counter()
        function(arguments, 20000)
        times.append(time.perf_counter() - start)
    return min(times), question.output.n_instructions()


def main():
    """Measure, tell, draw."""
    library = Library([LAW])
    full, simple = compile_model(library, "DriveTrain.Rigs.HipKnee"), compile_model(library, "OutputLoad")
    study, run = load_study(HERE / "machine.toml"), log()
    given = {**values(study, full), **PAYLOAD}
    with tempfile.TemporaryDirectory() as folder:
        run.to_csv(Path(folder) / "run.csv", index=False)
        own = {rig: fitted(rig, Path(folder) / "run.csv") for rig in (simple.rig, full.rig)}
    moving = (np.abs(run[["omega1", "omega2"]]).min(axis=1) > 0.02).to_numpy()
    truth = {n: run[n].to_numpy()[moving] for n in ("C_H", "C_K")}
    answers = {"full law": asked(full, given, run), "output torque only": asked(simple, given, run),
               "output torque only, refitted": asked(simple, {**given, **_friction(own[simple.rig][0])}, run)}
    answers = {law: {n: v[moving] for n, v in found.items()} for law, found in answers.items()}
    tell(answers, truth, own, full, simple)
    load = np.abs(answers["full law"]["s1A.L"])
    direct = answers["full law"]["s1A.L"] * answers["full law"]["s1A.w"] > 0
    friction = {law: {branch: binned(load[chosen], answers[law]["s1A.F"][chosen])
                      for branch, chosen in (("direct", direct), ("reverse", ~direct))}
                for law in ("full law", "output torque only")}
    errors = {}
    for name, law in (("same parameters", "output torque only"), ("refitted", "output torque only, refitted")):
        at, square = binned(load, (answers[law]["C_H"] - truth["C_H"]) ** 2)
        errors[name] = at, np.sqrt(square)
    write(figure(friction, errors), IMAGES, "simplified_law")


def _friction(parameters):
    return {n: v for n, v in parameters.items() if n.endswith((".f0", ".mu"))}


def tell(answers, truth, own, full, simple):
    """Errors and times in sentences."""
    ideal = {n: T_R * (answers["full law"]["motor1.tau_shaft"] + s * answers["full law"]["motor2.tau_shaft"])
             for n, s in (("C_H", 1), ("C_K", -1))}
    for law, found in {**answers, "no friction at all": ideal}.items():
        told = ", ".join(f"{n} {np.sqrt(np.mean((found[n] - t) ** 2)):.4f}" for n, t in truth.items())
        print(f"  {law}: RMSE {told} N.m on moving samples")
    changes = ", ".join(f"{n} {own[simple.rig][0][n] - own[full.rig][0][n]:+.4f}" for n in _friction(own[full.rig][0]))
    print(f"  refitted against the full law's own fit: {changes}")
    reference, _ = cost(full, "estimate", ["C_H", "C_K"])
    for model, name, wanted in ((full, "estimate", ["C_H", "C_K"]), (simple, "estimate", ["C_H", "C_K"]),
                                (full, "compensate", ["motor1.tau", "motor2.tau"])):
        least, count = cost(model, name, wanted)
        print(f"  {model.rig.rpartition('.')[2]}, {name}: {count} operations, {least / reference:.2f} of the time of "
              "the full estimate")


if __name__ == "__main__":
    main()

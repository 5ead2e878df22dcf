"""Nothing in; a log of a machine with an effect that its model lacks, and the whole way to finding it, out.

The log is made with the model itself, asked backwards: motor torques for the torques that the leg needs. The effect is
attached to the model that makes the log and to no other.
"""

from __future__ import annotations

import sys
import time as clock
from pathlib import Path

import numpy as np
import pandas as pd

from . import compare, identify, results
from .compile import ArrayFunction, Library, compile_model, component_name
from .dataset import Dataset
from .improve import improve
from .report import figures
from .report.page import write_report
from .simulate import compensate
from .study import load_study, write_study
from .trajectories import manoeuvre_motion

RIG = "DriveTrain.Rigs.HipKnee"
HIDDEN = ("stribeck", "2A", {"fs": 0.045, "ws": 0.85})  # N.m, rad/s
MACHINE = {  # Nobili et al., identified friction of the hip-knee actuation; f0 [N.m], mu [1]
    "s1A.f0": 0.089, "s1A.mu": 0.90, "s2A.f0": 0.077, "s2A.mu": 0.91,
    "s1B.f0": 0.001, "s1B.mu": 0.99, "s2B.f0": 0.014, "s2B.mu": 0.97,
}
# With the model's default travel, presliding would be a second hidden effect; and it would be found.
RIGID = {f"s{p}.travel": 1e-5 for p in ("1A", "2A", "1B", "2B")}  # slides at once [rad]
SPEEDS = 0.2, 0.4, 0.8, 1.6, 2.4  # of the faster motor [rad/s]
RATE, REPEATS, LONGEST = 100.0, 2, 3.5  # Hz; of every pass; of a pass [s]
QUANTUM = 2 * np.pi / 2 ** 14  # encoder step [rad]
WHITE, SLOW, SLOW_TIME = 6e-3, 2.4e-3, 1.0  # noise of a motor torque [N.m], [N.m], [s]
FILES = ("run.csv", "study.toml", "hidden.json", "comparison.json", "diagnosis.json", "diagnosis_final.json",
         "ladder.json", "parameters.json", "improved.toml", "model.mo", "report.html")

STUDY = """\
# A hip-knee actuation, its friction to be fitted, and one log. What is missing in the model?
# pycosim improve study.toml

[rig]
model = "{rig}"

[parameters]
{parameters}

[data]
runs = ["run.csv"]
reference = "gravity_model"       # C_H and C_K were computed from the leg

[columns]
theta1 = {{ variable = "motor1.phi", unit = "rad" }}
theta2 = {{ variable = "motor2.phi", unit = "rad" }}
tau1 = {{ variable = "motor1.tau", unit = "N.m" }}
tau2 = {{ variable = "motor2.tau", unit = "N.m" }}
C_H = {{ variable = "C_H", unit = "N.m" }}
C_K = {{ variable = "C_K", unit = "N.m" }}
"""


def run(out, quiet=False, progress=None):
    """Make a log with a hidden effect, and find the effect from the log alone.

    Parameters
    ----------
    out : path
        Folder of the results.
    quiet : bool
        Say nothing.
    progress : callable, optional
        Called with a sentence before each stage.

    Returns
    -------
    Improvement

    Raises
    ------
    FolderError
        The folder holds what is not ours, or cannot be written.
    """
    began, out = clock.monotonic(), Path(out)
    say = (lambda *lines: None) if quiet else _say
    progress = progress or (lambda text: None)
    with results.Folder(out, "demo", writes=FILES) as folder:
        library = Library()
        progress("making a log")
        _make(library, folder)
        say("1. A log of a hip-knee actuation: six manoeuvres out and back, five speeds, twice. The machine has an",
            "   effect that its model lacks.", "")
        study = load_study(folder.file("study.toml"))
        progress("reading the log")
        dataset = Dataset(study, library)
        _compare(dataset, folder, progress, say)
        found = improve(dataset, seed=study.seed, progress=progress)
        _write(folder, study, dataset, found)
        _tell(folder, found, library, say)
        progress("drawing")
        figures.write_figures(folder.temporary, dataset, found)
        write_report(folder.file("report.html"), dataset, found, "pycosim report study.toml")
    say(f"Took {clock.monotonic() - began:.0f} s. Everything is in {out}: {folder.listed}.",
        f"The same on the log alone: pycosim improve {out / 'study.toml'}")
    return found


def _say(*lines):
    """Lines on stdout, also where a progress line on the terminal has taken its place."""
    stream = sys.stdout
    if hasattr(stream, "rich_proxied_file") and not stream.rich_proxied_file.isatty():
        stream = stream.rich_proxied_file
    print(*lines, sep="\n", file=stream, flush=True)


# --- the log --------------------------------------------------------------------------------------------------------


def record(model, parameters, rng, speeds=SPEEDS, repeats=REPEATS, longest=LONGEST):
    """What the drives of a machine would log.

    Motor torques come from `compensate`, not from a simulated controller: `pycosim cosim` does that, and takes about a
    third as long again as the whole demo.

    Parameters
    ----------
    model : Model
        The machine; `parameters` are its own.
    parameters : dict of str to float
    rng : numpy.random.Generator
        Order of the passes, and noise.
    speeds, repeats, longest
        Of the motion, see `pycosim.trajectories.manoeuvre_motion`.

    Returns
    -------
    pandas.DataFrame
        Columns of the hip-knee log.
    """
    time, angle, speed, label = manoeuvre_motion(rng, RATE, speeds, repeats, longest)
    acceleration = np.gradient(speed, time, axis=1)
    known = {f"{d}motor{k + 1}.phi{e}": v[k] for k in (0, 1)
             for d, e, v in (("", "", angle), ("der(", ")", speed), ("der(der(", "))", acceleration))}
    wanted = _gravity(model, known, len(time))
    torques = compensate(model, {**known, **wanted}, time, parameters)
    columns = {"time": time}
    columns.update({f"theta{k + 1}": np.round(angle[k] / QUANTUM) * QUANTUM for k in (0, 1)})
    columns.update({f"tau{k}": torques[f"motor{k}.tau"] + _noise(rng, len(time)) for k in (1, 2)})
    return pd.DataFrame({**columns, **wanted, "manoeuvre": label})


def _gravity(model, known, n):
    """Joint torques [N.m] that the leg needs on its way."""
    question = model.question("gravity_model").select(["C_H", "C_K"])
    values = ([known.get(name, 0.0) for name in question.inputs] + [0.0] * len(question.states)
              + [model.parameters[p].value for p in question.parameters])
    return dict(zip(question.outputs, ArrayFunction(question.output)(values, n)))


def _noise(rng, n):
    """White noise, and a slow one that forgets in a second."""
    forget = np.exp(-1 / (RATE * SLOW_TIME))
    slow = rng.standard_normal(n) * SLOW * np.sqrt(1 - forget ** 2)
    slow[0] = rng.standard_normal() * SLOW
    for k in range(1, n):
        slow[k] += forget * slow[k - 1]
    return slow + WHITE * rng.standard_normal(n)


def _make(library, folder, seed=2, **options):
    """Log, study, and what is hidden; options of `record`."""
    effect, place, coefficients = HIDDEN
    machine = compile_model(library, RIG, [(effect, place)])
    name = component_name(*machine.attached[0])
    parameters = {**MACHINE, **RIGID, **{f"{name}.{c}": v for c, v in coefficients.items()}}
    log = record(machine, parameters, np.random.default_rng(seed), **options)
    log.to_csv(folder.file("run.csv"), index=False, float_format="%.9g")
    lines = [f'"{n}" = {{ value = {0.05 if n.endswith("f0") else 0.95}, fixed = false }}' for n in MACHINE]
    folder.write("study.toml", STUDY.format(rig=RIG, parameters="\n".join(lines)))
    folder.write("hidden.json", {"schema": 1, "effect": effect, "place": place, "parameters": parameters, "seed": seed})


# --- the story ------------------------------------------------------------------------------------------------------


def _compare(dataset, folder, progress, say):
    """Fit the base model, and say where it fails."""
    progress("fitting the base model")
    fit = identify.fit(dataset, dataset.base)
    comparison = compare.compare(dataset, dataset.base, fit)
    folder.write("comparison.json", comparison)
    say("2. The base model, fitted, against the log.", *_indent(results.summary_comparison(comparison)), "")


def _write(folder, study, dataset, found):
    """Results as those of ``improve``; the improved study goes beside the given one."""
    folder.write("diagnosis.json", results.diagnosis(found.first, dataset.library))
    folder.write("diagnosis_final.json", results.diagnosis(found.last, dataset.library))
    folder.write("ladder.json", results.ladder(found.steps, dataset))
    folder.write("parameters.json", results.parameters(found.fit, found.model, study.seed))
    folder.write("model.mo", found.model.text.rstrip("\n") + "\n")
    write_study(results.improved_study(study, found.model, found.fit), folder.file("improved.toml"))


def _tell(folder, found, library, say):
    """What was found, then what was hidden."""
    first, last = (results.diagnosis(d, library) for d in (found.first, found.last))
    parameters = results.parameters(found.fit, found.model, 0)
    steps = results.plain({"steps": [{"added": s.added and dict(zip(("effect", "place"), s.added)), "error": s.error,
                                      "held_out_error": s.held_out_error} for s in found.steps]})
    lines = results.summary_improvement(first, last, steps, parameters, library)
    hidden = [line for line in lines if line.startswith("Not visible")]
    say("3. What is missing, and what is left when it is added.", *_indent(x for x in lines if x not in hidden))
    if hidden:
        say("   What these data could not show is in diagnosis_final.json.")
    effect, place, coefficients = HIDDEN
    units = {n.rsplit(".", 1)[-1]: v.unit for n, v in found.fit.variables.items()}
    values = ", ".join(f"{n} = {v:g} {units.get(n, '')}".rstrip() for n, v in coefficients.items())
    inside = sum(_inside(found.fit.interval(n), v) for n, v in MACHINE.items())
    say("", f"4. Hidden was: {effect} at {place}, {values}.",
        f"   Of the {len(MACHINE)} other parameters of the machine, {inside} are within their 95 % intervals.", "")


def _inside(interval, value):
    return interval[0] <= value <= interval[1]


def _indent(lines):
    return [f"   {line}" for line in lines]

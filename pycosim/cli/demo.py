"""Nothing in; a log of a machine with an effect that its model lacks, and the whole way to finding it, out.

The log comes from a co-simulation: the machine, the effect attached to it and to no other model, under position
control. Machine and scenario are left beside the log, for ``pycosim cosim``.
"""

from __future__ import annotations

import sys
import time as clock
from pathlib import Path

from ..compile import compile_model, component_name, shared_library
from ..cosim.master import cosimulate
from ..project import open_project
from ..report import figures
from ..report.folder import Folder
from .beside import Beside

RIG = "DriveTrain.Rigs.HipKnee"
HIDDEN = ("stribeck", "2A", {"fs": 0.045, "ws": 0.85})  # N.m, rad/s
MACHINE = {  # Nobili et al., identified friction of the hip-knee actuation; f0 [N.m], mu [1]
    "s1A.f0": 0.089, "s1A.mu": 0.90, "s2A.f0": 0.077, "s2A.mu": 0.91,
    "s1B.f0": 0.001, "s1B.mu": 0.99, "s2B.f0": 0.014, "s2B.mu": 0.97,
}
# With the model's default travel, presliding would be a second hidden effect; and it would be found.
RIGID = {f"s{p}.travel": 1e-4 for p in ("1A", "2A", "1B", "2B")}  # rad; a quarter of the encoder's step
LONGEST = 2.0  # of a pass [s]
FILES = ("run.csv", "study.toml", "machine.toml", "scenario.toml", "hidden.json", "comparison.json", "diagnosis.json",
         "diagnosis_final.json", "ladder.json", "parameters.json", "consequence.json",
         "improved.toml", "model.mo", "report.html")

MACHINE_FILE = """\
# The machine that made run.csv: the rig of the study, with an effect that the study does not have.

[rig]
model = "{rig}"

[parameters]
{parameters}

[[effects]]
effect = "{effect}"
place = "{place}"
"""

SCENARIO = """\
# The six manoeuvres out and back under position control.
# pycosim cosim scenario.toml

seed = {seed}
connections = [
    "reference -> controller",
    "plant -> controller",
    "controller.motor1.tau -> plant.tau1",
    "controller.motor2.tau -> plant.tau2",
]

[components.reference]
trajectory = "six_manoeuvres"
machine = "machine.toml"
rate = 500                        # Hz
options = {{ {options} }}

[components.controller]
controller = "position"
machine = "machine.toml"
rate = 500
parameters = {{ tau_max = 14.98 }}

[components.plant]
plant = "machine.toml"
run = "process"                   # without an FMU, which would need a C compiler for a minute
rate = 500
step = 0.002
start = {{ q_H = 0.901157, q_K = -0.850909 }}

[log]
rate = 100

[log.columns]                     # an encoder of 2^14 steps a turn; noise of the currents, in N.m
theta1 = {{ signal = "plant.motor1.phi", quantum = 3.834952e-4 }}
theta2 = {{ signal = "plant.motor2.phi", quantum = 3.834952e-4 }}
tau1 = {{ signal = "plant.motor1.tau", noise = 6e-3 }}
tau2 = {{ signal = "plant.motor2.tau", noise = 6e-3 }}
C_H = "plant.C_H"
C_K = "plant.C_K"
manoeuvre = "reference.label"
"""

STUDY = """\
# A hip-knee actuation, its friction to be fitted, and one log. What is missing in the model?
# pycosim improve study.toml

[rig]
model = "{rig}"

[parameters]
{parameters}

[limits]                          # what a planned experiment keeps to: pycosim plan study.toml
"q_H" = {{ min = -0.35, max = 2.0 }}        # rad
"q_K" = {{ min = -2.0, max = 0.1 }}
"q_H + q_K" = {{ min = -1.2, max = 1.5 }}
"motor1.w" = {{ max = 2.4 }}                # rad/s
"motor2.w" = {{ max = 2.4 }}
"motor1.a" = {{ max = 8.0 }}                # rad/s2
"motor2.a" = {{ max = 8.0 }}

[data]
runs = ["run.csv"]
reference = "gravity_model"       # C_H and C_K are what the leg asks for

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
    Search

    Raises
    ------
    FolderError
        The folder holds what is not ours, or cannot be written.
    """
    began, out = clock.monotonic(), Path(out)
    say = (lambda *lines: None) if quiet else _say
    progress = progress or (lambda text: None)
    library = shared_library()
    with Folder(out, "demo", writes=FILES) as folder, Beside(library) as beside:
        progress("making a log")
        _make(library, folder, progress=progress, meanwhile=beside.compile)
        say("1. A log of a hip-knee actuation under position control: six manoeuvres out and back, five speeds, twice.",
            "   The machine has an effect that its model lacks.", "")
        project = open_project(folder.file("study.toml"), progress=progress)
        compared = project.compare()
        say("2. The base model, fitted, against the log.", *_indent(compared.sentences), "")
        found = project.improve()
        figures.write_figures(folder.temporary, project.dataset, found.found, beside.save)
        beside.begin()
        for name, content in {**found.files(), "comparison.json": compared.record}.items():
            folder.write(name, content)
        found.save(folder.file("improved.toml"))
        _tell(found, say)
        progress("drawing")
        found.report(folder.file("report.html"))
        beside.finish()
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


def _make(library, folder, seed=2, progress=None, meanwhile=lambda rig: None, **options):
    """Machine, scenario, log, study, and what is hidden; options of the trajectory `six_manoeuvres`."""
    effect, place, coefficients = HIDDEN
    name = component_name(*compile_model(library, RIG, [(effect, place)]).attached[0])
    meanwhile(RIG)  # by now the library is parsed
    parameters = {**MACHINE, **RIGID, **{f"{name}.{c}": v for c, v in coefficients.items()}}
    lines = [f'"{n}" = {{ value = {v:g} }}' for n, v in parameters.items()]
    folder.write("machine.toml", MACHINE_FILE.format(rig=RIG, parameters="\n".join(lines), effect=effect, place=place))
    given = {"seed": seed, "longest": LONGEST, **options}
    text = ", ".join(f"{n} = {list(v) if isinstance(v, tuple) else v}" for n, v in given.items())
    folder.write("scenario.toml", SCENARIO.format(seed=seed, options=text))
    made = cosimulate(folder.file("scenario.toml"), library=library, progress=progress)
    if not made.complete:  # Ctrl-C ends a co-simulation with what it has
        raise KeyboardInterrupt
    folder.write("run.csv", made.text)
    lines = [f'"{n}" = {{ value = {0.05 if n.endswith("f0") else 0.95}, fixed = false }}' for n in MACHINE]
    folder.write("study.toml", STUDY.format(rig=RIG, parameters="\n".join(lines)))
    folder.write("hidden.json", {"schema": 1, "effect": effect, "place": place, "parameters": parameters, "seed": seed})


# --- the story ------------------------------------------------------------------------------------------------------


def _tell(found, say):
    """What was found, then what was hidden."""
    lines = found.sentences
    unseen = [line for line in lines if line.startswith("Not visible")]
    say("3. What is missing, and what is left when it is added.", *_indent(x for x in lines if x not in unseen))
    if unseen:
        say("   What these data could not show is in diagnosis_final.json.")
    effect, place, coefficients = HIDDEN
    units = {n.rsplit(".", 1)[-1]: p.unit for n, p in found.final.params.items()}
    values = ", ".join(f"{n} = {v:g} {units.get(n, '')}".rstrip() for n, v in coefficients.items())
    inside = sum(_inside(found.final.params[n].ci95, v) for n, v in MACHINE.items())
    say("", f"4. Hidden was: {effect} at {place}, {values}.",
        f"   Of the {len(MACHINE)} other parameters of the machine, {inside} are within their 95 % intervals.", "")


def _inside(interval, value):
    return interval[0] <= value <= interval[1]


def _indent(lines):
    return [f"   {line}" for line in lines]

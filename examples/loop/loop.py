"""Plan, run, identify, diagnose, and plan again, until the friction of a machine is known as well as wanted.

Run: python examples/loop/loop.py [--out loop] [--budget 80] [--most 6]
The machine is a plant FMU with a loss that the model at the start lacks. The loop ends when every parameter's interval
is as narrow as wanted, no effect of the list could hide above its wanted size, and the diagnosis finds nothing more; or
after so many experiments. It leaves the logs, what it found after each experiment, and a figure.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

import pycosim as pc
from pycosim.compile import Library, component_name
from pycosim.cosim.scenario import load_scenario
from pycosim.report.figures import save
from pycosim.report.plot import MARKERS, Axis, Level, Line, Look, Panel, Plot, curve
from pycosim.study.parse import load_study

HERE = Path(__file__).parent
STUDY = HERE.parent / "hip_knee" / "study.toml"
IMAGES = HERE.parents[1] / "docs" / "images"
# widest 95 % interval, by the last part of the name: N.m and 1; both distal losses are hard to tell apart on any motion
WANTED = {"f0": 8e-4, "mu": 2e-3}
DISTAL = 0.03
# largest size that may stay unseen: N.m.s/rad, N.m, 1
UNSEEN = {("viscous", "1A"): 3e-4, ("viscous", "2A"): 3e-4, ("torque_offset", "motor1"): 3e-4,
          ("torque_offset", "motor2"): 3e-4, ("torque_constant", "motor1"): 7e-4, ("torque_constant", "motor2"): 7e-4}


def experiment(plan, number, out, library):
    """Run a plan on the plant; returns the log to fit and the part of it that is held out, as files."""
    motion, plan = plan.to_csv(out / f"plan{number}.csv"), plan.planned
    scenario = load_scenario(HERE / "experiment.toml")
    angles = plan.known.workspace.kinematics.angles(plan.motion.angle[:, :1])[:, 0]
    start = dict(zip(plan.known.workspace.kinematics.joints, map(float, angles)))
    parts = {"reference": {"what": str(motion.absolute())}, "plant": {"start": start}}
    scenario = replace(scenario, seed=number, duration=plan.motion.duration, components=[
        replace(c, **parts.get(c.name, {})) for c in scenario.components])
    log = pc.cosimulate(scenario, library=library).log
    held = pd.Series(False, index=log.index)
    for a, b in plan.motion.held_out:
        held |= (log["time"] >= a) & (log["time"] <= b)
    files = [out / f"run{number}.csv", out / f"run{number}_held_out.csv"]
    for file, rows in zip(files, (~held, held)):
        log[rows].to_csv(file, index=False, float_format="%.9g")
    return files


def unseen(fitted):
    """Size of each effect of the list that the data so far could hide: 3.6 standard errors of its coefficient."""
    found = {}
    for name in (n for n in map("@".join, UNSEEN) if n not in fitted.effects):
        larger = fitted.add(name)
        effect, place = larger.model.attached[-1]
        found[name] = 3.6 * larger.params[f"{component_name(effect, place)}.{effect.size[0]}"].stderr
    return found


def wanted(name):
    """Widest interval that a parameter may have at the end."""
    kind = name.rsplit(".", 1)[-1]
    return DISTAL if name in ("s1B.f0", "s2B.f0") else WANTED.get(kind, UNSEEN[("viscous", "2A")])


def learn(study):
    """The model of all logs, with every effect that they miss."""
    return pc.open(study).improve().final


def loop(out, budget=80.0, most=6, say=print):
    """Run the loop.

    Returns
    -------
    list of dict
        One an experiment: ``widths``, ``unseen``, ``effects``, ``verdict``, ``done``.
    """
    out.mkdir(parents=True, exist_ok=True)
    study = replace(load_study(STUDY), reference="sensor")
    known, history = pc.open(study), []  # at first the study alone
    for number in range(1, most + 1):
        plan = known.plan(budget=budget)
        run, held_out = experiment(plan, number, out, Library())
        study = replace(study, runs=[*study.runs, run], held_out=[*study.held_out, held_out])
        known = learn(study)
        study = replace(study, effects=known.model.keys)
        found, widths = known.diagnose(), {n: p.ci95[1] - p.ci95[0] for n, p in known.params.items()}
        hidden = unseen(known)
        done = (all(w <= wanted(n) for n, w in widths.items()) and found.verdict == "nothing_missing"
                and all(size <= UNSEEN[tuple(k.split("@"))] for k, size in hidden.items()))
        duration = plan.planned.motion.duration
        history.append({"duration": duration, "widths": widths, "unseen": hidden, "verdict": found.verdict,
                        "effects": known.effects, "done": done})
        wide = [n for n, w in widths.items() if w > wanted(n)]
        say(f"experiment {number}, {duration:.0f} s: {found.verdict}; effects "
            f"{', '.join(history[-1]['effects']) or 'none'}; too wide: {', '.join(wide) or 'none'}; could hide: "
            f"{', '.join(k for k, s in hidden.items() if s > UNSEEN[tuple(k.split('@'))]) or 'none'}")
        if done:
            break
    (out / "history.json").write_text(json.dumps(history, indent=2) + "\n", encoding="utf-8")
    return history


def draw(history):
    """Intervals and unseen sizes over experiments, each over what is wanted; below one is good enough."""
    columns = []
    for words, key, most in (("interval over wanted", "widths", wanted),
                             ("unseen size over wanted", "unseen", lambda n: UNSEEN[tuple(n.split("@"))])):
        marks = [Level(1.0, Look("ink", width=0.6))]
        for k, name in enumerate(dict.fromkeys(n for h in history for n in h[key])):
            at, sizes = zip(*((j, h[key][name] / most(name)) for j, h in enumerate(history) if name in h[key]))
            marks.append(Line(np.array(at), np.array(sizes), curve(k, marker=MARKERS[k % 4]), name))
        x = Axis("experiment", names=[str(k + 1) for k in range(len(history))])
        columns.append([Panel(x, Axis(words, log=True), marks, legend=True)])
    return Plot("loop", "", "Intervals and unseen sizes after each experiment, over what is wanted.", columns, width=2,
                height=3.4)


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("loop"))
    parser.add_argument("--budget", type=float, default=80.0, help="of each experiment [s]")
    parser.add_argument("--most", type=int, default=6, help="experiments")
    args = parser.parse_args()
    history = loop(args.out, args.budget, args.most)
    for folder in (args.out, IMAGES):
        save(draw(history), folder, "loop")


if __name__ == "__main__":
    main()

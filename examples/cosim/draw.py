"""Numbers of the four questions in; descriptions of their plots, and these as vector PDF with a PNG preview, out."""

import numpy as np

from pycosim.report.figures import save as write  # noqa: F401 - the scripts beside this one write with it
from pycosim.report.plot import Axis, Bars, Line, Look, Panel, Plot, Text, curve

TIME = Axis("time", "s")
LOOKS = {"no friction": Look("muted", "dot"), "sign of the speed": Look("before", "dashdot"),
         "friction states": Look("after"), "states, encoder": Look("third", "dash")}
TORQUE = "N.m"


def reversals(run, truth, found):
    """Joint torques before, at and after a reversal with a rest, and the speeds of motors and distal segments."""
    time = run["time"].to_numpy()
    fast = np.abs(run["omega1"].to_numpy()) > 1.5
    end = time[np.flatnonzero(fast[:-1] & ~fast[1:])[0]]  # the first reversal of the fastest manoeuvre
    chosen = (time > end - 0.3) & (time < end + 1.3)
    panels = []
    for joint, name in enumerate(("hip", "knee")):
        lines = [Line(time[chosen], truth[joint, chosen], Look("muted", width=2.5), "true")]
        lines += [Line(time[chosen], torque[joint, chosen], LOOKS[label], label) for label, torque in found.items()
                  if label in LOOKS]
        panels.append(Panel(TIME, Axis(f"{name} torque", TORQUE), lines, height=2))
    speeds = [Line(time[chosen], run[name].to_numpy()[chosen], curve(k), text) for k, (name, text) in enumerate((
        ("omega1", "motor 1"), ("omega2", "motor 2"), ("w_1B", "segment 1B")))]
    panels.append(Panel(TIME, Axis("speed", "rad/s"), speeds, legend=True))
    return Plot("reversals", "", "Joint torques and speeds around a reversal.", [panels], width=2, height=3.4)


def simplified(friction, errors):
    """Left: friction torque of 1A by both laws, in both branches. Right: error of the estimate, by load."""
    load = Axis("load of 1A", TORQUE)
    left = [Line(*points, Look(tone, dash, marker=marker, open=True), f"{law}, {branch}")
            for (law, branches), tone, dash in zip(friction.items(), ("after", "before"), ("solid", "dash"))
            for (branch, points), marker in zip(branches.items(), ("circle", "square"))]
    right = [Line(*points, look, name) for (name, points), look in zip(errors.items(), (
        Look("before", "dash", marker="square"), Look("third", "dashdot", marker="triangle")))]
    return Plot("simplified_law", "", "Friction torque by both laws, and the error of the estimate.", [
        [Panel(load, Axis("friction torque of 1A", TORQUE), left, legend=True)],
        [Panel(load, Axis("error of the hip torque, RMS", TORQUE, low=0), right, legend=True)]], width=2, height=2.4)


def compensation(runs, transparent, errors, felt):
    """Left: what friction adds to the torque of the hand at the knee. Right: torque felt and tracking error."""
    lines = []
    for k, (name, run) in enumerate(runs.items()):
        chosen = (run["time"] > 4) & (run["time"] < 9)
        lines.append(Line(run["time"][chosen].to_numpy(), (run["hand_K"] - transparent["hand_K"])[chosen].to_numpy(),
                          curve(k), name))
    columns = [[Panel(TIME, Axis("friction felt at the knee", TORQUE), lines, legend=True)]]
    for values, words, unit in ((felt, "friction felt, RMS", TORQUE), (errors, "tracking error, RMS", "mrad")):
        names, most = list(values), max(map(max, values.values()))
        marks = []
        for k, (joint, look) in enumerate((("hip", Look("after")), ("knee", Look("before", hatch="/")))):
            sizes = [values[n][k] for n in names]
            marks.append(Bars(range(len(names)), sizes, look, joint, (k, 2), across=True))
            marks += [Text(v + 0.08 * most, row - 0.2 + 0.4 * k, f"{v:.2g}") for row, v in enumerate(sizes)]
        columns.append([Panel(Axis(words, unit, high=1.2 * most, low=0), Axis(names=names, falling=True), marks,
                              legend=True)])
    return Plot("compensation", "", "Friction felt, and the error of tracking.", columns, (1.5, 1, 1), width=2,
                height=2.5)


def sharing(run, phase, torque, speed):
    """Torques of both motors over a cycle; the cycle inside the domains of torque and of speed."""
    order = np.argsort(phase)
    lines = [Line(100 * phase[order], run[f"tau{k + 1}"].to_numpy()[order], curve(k), f"motor {k + 1}") for k in (0, 1)]
    columns = [[Panel(Axis("gait cycle", "%", low=0, high=100), Axis("motor torque", TORQUE), lines, legend=True)]]
    for x, y, bounds, square, words in (torque, speed):
        text, _, unit = words.rstrip("]").partition(" [")
        marks = [Line(x, y, Look("after"), "cycle")]
        marks += [Line(half * np.array([1, 0, -1, 0, 1]), half * np.array([0, 1, 0, -1, 0]), Look("ink", dash), label)
                  for (half, label), dash in zip(bounds, ("solid", "dash"))]
        marks.append(Line(square * np.array([1, 1, -1, -1, 1]), square * np.array([1, -1, -1, 1, 1]),
                          Look("muted", "dot"), "one motor a joint"))
        columns.append([Panel(Axis(f"hip {text}", unit), Axis(f"knee {text}", unit), marks, equal=True, legend=True)])
    return Plot("sharing", "", "Torques of both motors over a cycle, and the cycle inside its domains.", columns,
                width=2, height=2.8)

"""Numbers of the four questions in; figures for print, as vector PDF with a PNG preview, out."""

import numpy as np
from matplotlib.figure import Figure

from pycosim.report.figures import BLUE, GREEN, GREY, LINES, PAGE, RED, _styled

COLORS = {"no friction": GREY, "sign of the speed": RED, "friction states": BLUE, "states, encoder": GREEN}


@_styled
def write(figure, folder, name):
    """Write a figure as PDF and PNG."""
    figure.savefig(folder / f"{name}.pdf", metadata={"CreationDate": None})
    figure.set_layout_engine("none")
    figure.savefig(folder / f"{name}.png", dpi=170, metadata={"Software": None})


def _window(run, most=1.3):
    """A stretch around the first reversal of the fastest manoeuvre."""
    time = run["time"].to_numpy()
    fast = np.abs(run["omega1"].to_numpy()) > 1.5
    end = time[np.flatnonzero(fast[:-1] & ~fast[1:])[0]]
    return (time > end - 0.3) & (time < end + most)


@_styled
def reversals(run, truth, found):
    """Knee torque before, at and after a reversal with a rest, and the speed of the distal segments."""
    chosen = _window(run)
    time = run["time"].to_numpy()[chosen]
    figure = Figure(figsize=(PAGE, 3.4))
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=[2, 2, 1])
    for axes, joint, name in ((top, 0, "hip"), (middle, 1, "knee")):
        axes.plot(time, truth[joint, chosen], color="black", linewidth=2.2, alpha=0.35, label="true")
        for (label, torque), line in zip(found.items(), (":", "-.", "-", "--")):
            if label in COLORS:
                axes.plot(time, torque[joint, chosen], line, color=COLORS[label], label=label)
        axes.set_ylabel(f"{name} torque [N$\\,$m]")
    top.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    for name, line, color in (("omega1", "-", BLUE), ("omega2", "--", RED), ("w_1B", ":", "black")):
        bottom.plot(time, run[name].to_numpy()[chosen], line, color=color,
                    label={"omega1": "motor 1", "omega2": "motor 2", "w_1B": "segment 1B"}[name])
    bottom.set_ylabel("speed [rad/s]")
    bottom.set_xlabel("time [s]")
    bottom.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


@_styled
def simplified(friction, errors):
    """Left: friction torque of 1A by both laws, in both branches. Right: error of the estimate, by load."""
    figure = Figure(figsize=(PAGE, 2.4))
    left, right = figure.subplots(1, 2)
    for (law, branches), line, color in zip(friction.items(), ("-", "--"), (BLUE, RED)):
        for (branch, (load, torque)), marker in zip(branches.items(), "os"):
            left.plot(load, torque, line, marker=marker, color=color, label=f"{law}, {branch}", markerfacecolor="white")
    left.set_xlabel("load of 1A [N$\\,$m]")
    left.set_ylabel("friction torque of 1A [N$\\,$m]")
    left.legend()
    for (name, (load, error)), line, marker, color in zip(errors.items(), ("--", "-."), "s^", (RED, GREEN)):
        right.plot(load, error, line, marker=marker, color=color, label=name)
    right.set_xlabel("load of 1A [N$\\,$m]")
    right.set_ylabel("error of the hip torque, RMS [N$\\,$m]")
    right.set_ylim(bottom=0)
    right.legend()
    return figure


@_styled
def compensation(runs, transparent, errors, felt):
    """Left: what friction adds to the torque of the hand at the knee. Right: torque felt and tracking error."""
    figure = Figure(figsize=(PAGE, 2.5))
    left, middle, right = figure.subplots(1, 3, width_ratios=[1.5, 1, 1])
    for (name, run), line, color in zip(runs.items(), LINES, (GREY, BLUE, RED, GREEN)):
        chosen = (run["time"] > 4) & (run["time"] < 9)
        left.plot(run["time"][chosen], (run["hand_K"] - transparent["hand_K"])[chosen], line, color=color, label=name)
    left.set_xlabel("time [s]")
    left.set_ylabel("friction felt at the knee [N$\\,$m]")
    left.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    panels = (middle, felt, "friction felt, RMS [N$\\,$m]"), (right, errors, "tracking error, RMS [mrad]")
    for axes, values, text in panels:
        names, most = list(values), max(map(max, values.values()))
        for k, (joint, hatch, color) in enumerate((("hip", "", BLUE), ("knee", "////", RED))):
            at, size = np.arange(len(names)) - 0.2 + 0.4 * k, [values[n][k] for n in names]
            axes.barh(at, size, 0.38, hatch=hatch, color=color, edgecolor="white", label=joint)
            for y, v in zip(at, size):
                axes.text(v + 0.02 * most, y, f"{v:.2g}", va="center", fontsize=6)
        axes.set_yticks(range(len(names)), names)
        axes.invert_yaxis()
        axes.set_xlim(0, 1.2 * most)
        axes.set_xlabel(text)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    return figure


def _diamond(axes, half, line, label):
    axes.plot(half * np.array([1, 0, -1, 0, 1]), half * np.array([0, 1, 0, -1, 0]), line, color="black", label=label)


def _square(axes, half, label):
    axes.plot(half * np.array([1, 1, -1, -1, 1]), half * np.array([1, -1, -1, 1, 1]), ":", color=GREY, label=label)


@_styled
def sharing(run, phase, torque, speed):
    """Top: torques of both motors over a cycle. Bottom: the cycle inside the domains of torque and speed."""
    figure = Figure(figsize=(PAGE, 4.6))
    grid = figure.add_gridspec(2, 2, height_ratios=[1, 1.6])
    top = figure.add_subplot(grid[0, :])
    order = np.argsort(phase)
    for k, (line, color) in enumerate((("-", BLUE), ("--", RED)), 1):
        top.plot(100 * phase[order], run[f"tau{k}"].to_numpy()[order], line, color=color, label=f"motor {k}")
    top.set_xlabel("gait cycle [%]")
    top.set_ylabel("motor torque [N$\\,$m]")
    top.set_xlim(0, 100)
    top.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    for column, (x, y, bounds, square, words) in enumerate((torque, speed)):
        axes = figure.add_subplot(grid[1, column])
        axes.plot(x, y, color=BLUE, label="cycle")
        for (half, label), line in zip(bounds, ("-", "--")):
            _diamond(axes, half, line, label)
        _square(axes, square, "one motor a joint")
        axes.set_xlabel(f"hip {words}")
        axes.set_ylabel(f"knee {words}")
        axes.set_aspect("equal")
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    return figure

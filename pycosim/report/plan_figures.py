"""A workspace or a plan in; its figures, as vector PDF with a PNG preview, out."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ..design.motion import REST, TRANSFER
from .figures import BLUE, COLUMN, GREEN, GREY, LINES, PAGE, RED, TONES, _styled, _titled, save

WORDS = {"w": "speed [rad/s]", "tau": r"torque [N$\,$m]"}


def _closed(points):
    return np.vstack([points, points[:1]]).T


def _axis(name):
    """A motor's or joint's name as a symbol."""
    head, _, index = name.partition("_")
    return rf"${head}_\mathrm{{{index}}}$" if index else name


@_styled
def workspace(ws):
    """Reachable motor angles, the lines through the middle on which a segment stands still, and the zones between.

    The arrows are the directions that keep every segment furthest from standstill.

    Parameters
    ----------
    ws : Workspace
        Of a rig with two motors.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = Figure(figsize=(COLUMN, 3.2))
    axes = figure.add_subplot()
    axes.fill(*_closed(ws.vertices), color=GREY, alpha=0.12, lw=0)
    axes.plot(*_closed(ws.vertices), color="black", lw=1.0, ls=":")
    _stops(axes, ws)
    centre, _ = ws.centre
    _still(axes, ws, centre)
    size = np.ptp(ws.vertices, axis=0).min()
    for k, zone in enumerate(ws.zones):
        tip = centre + zone.direction / np.linalg.norm(zone.direction) * 0.3 * size
        axes.annotate("", tip, centre, arrowprops={"arrowstyle": "-|>", "color": GREEN, "lw": 1.0})
        beyond = centre + (tip - centre) * 1.15
        axes.text(*beyond, str(k + 1), ha="center", va="center", color=GREEN)
    axes.plot(*centre, "o", color="black", ms=3)
    _label(axes, ws)
    _titled(figure, "Where the motors can go, and zones of direction")
    return figure


def _label(axes, ws):
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"{ws.kinematics.motors[0]} [rad]")
    axes.set_ylabel(f"{ws.kinematics.motors[1]} [rad]")


def _stops(axes, ws):
    """The limit that each edge is, in words beside it."""
    a, b, _ = ws.limits.halfspaces
    names = [n for n, low, high in zip(ws.limits.names, ws.limits.low, ws.limits.high)
             for end in (high, low) if np.isfinite(end)]
    corners = ws.vertices
    for first, second in zip(corners, np.roll(corners, -1, axis=0)):
        middle = (first + second) / 2
        on = [k for k in range(len(b)) if abs(a[k] @ first - b[k]) < 1e-6 and abs(a[k] @ second - b[k]) < 1e-6]
        if on:
            way = second - first
            turn = np.degrees(np.arctan2(way[1], way[0]))
            turn = turn - 180 if turn > 90 else turn + 180 if turn < -90 else turn
            outward = a[on[0]] / np.linalg.norm(a[on[0]])
            axes.annotate(" + ".join(_axis(t.strip()) for t in names[on[0]].split("+")), middle, outward * 7,
                          textcoords="offset points", rotation=turn, rotation_mode="anchor", ha="center", va="center",
                          fontsize=7)


def _still(axes, ws, centre):
    for k, (row, segments) in enumerate(ws.still):
        along = np.array([-row[1], row[0]])
        ends = [centre + along * ws.reach(centre, along), centre - along * ws.reach(centre, -along)]
        names = ", ".join(ws.kinematics.places[s] for s in segments)
        axes.plot(*np.array(ends).T, color=RED, lw=0.9, ls=LINES[k % len(LINES)], label=names)
    axes.legend(title="stands still", title_fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))


@_styled
def domains(ws):
    """Attainable joint torques and speeds, without friction: of this transmission, and of one motor a joint.

    Parameters
    ----------
    ws : Workspace
        Of a rig with two joints.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = Figure(figsize=(PAGE * 0.75, 2.5))
    both = [(d, w, u) for d, w, u in ((ws.torques, "torque", r"N$\,$m"), (ws.rates, "speed", "rad/s"))
            if np.isfinite(d()[0]).all()]
    for k, (domain, what, unit) in enumerate(both):
        axes = figure.add_subplot(1, len(both), k + 1)
        coupled, single = domain()
        axes.fill(*_closed(coupled), color=BLUE, alpha=0.15, lw=0)
        axes.plot(*_closed(coupled), color=BLUE, label="coupled")
        axes.plot(*_closed(single), color=RED, ls="--", label="one motor a joint")
        axes.set_aspect("equal")
        for name, set_label in zip(ws.kinematics.joints, (axes.set_xlabel, axes.set_ylabel)):
            set_label(f"{what} of {_axis(name)} [{unit}]")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    _titled(figure, "What the joints can do")
    return figure


@_styled
def motion(plan):
    """The planned motion: in the reachable motor angles where there are two, and over time.

    Parameters
    ----------
    plan : Plan

    Returns
    -------
    matplotlib.figure.Figure
    """
    ws, moved = plan.known.workspace, plan.motion
    plane = len(ws.kinematics.motors) == 2
    figure = Figure(figsize=(PAGE, 3.0))
    grid = figure.add_gridspec(3, 2 if plane else 1, width_ratios=[1, 1.5] if plane else None)
    if plane:
        axes = figure.add_subplot(grid[:, 0])
        axes.plot(*_closed(ws.vertices), color="black", lw=1.0, ls=":")
        way = moved.label == TRANSFER
        axes.plot(*np.where(way, moved.angle, np.nan), color=GREY, lw=0.5)
        for k, s in enumerate(moved.strokes):
            axes.plot(*s.ends.T, color=TONES[k % len(TONES)], ls=LINES[k % len(LINES)], lw=1.4, marker="|", ms=3)
        _label(axes, ws)
    _over_time(figure, grid, plan, int(plane))
    _titled(figure, "The planned motion")
    return figure


def _over_time(figure, grid, plan, column):
    moved, motors = plan.motion, plan.known.workspace.kinematics.motors
    rows = [("angle [rad]", moved.angle), (WORDS["w"], moved.speed)]
    rows += [] if plan.torque is None else [(WORDS["tau"], plan.torque)]
    first = None
    for k, (name, values) in enumerate(rows):
        first = axes = figure.add_subplot(grid[k, column], sharex=first)
        for i, motor in enumerate(motors):
            axes.plot(moved.time, values[i], color=TONES[i], ls=LINES[i % 2], lw=0.6, label=motor)
        for a, b in moved.held_out:
            axes.axvspan(a, b, color=GREY, alpha=0.25, lw=0, label="held out" if a == moved.held_out[0][0] else None)
        axes.set_ylabel(name)
        axes.tick_params(labelbottom=k == len(rows) - 1)
    axes.set_xlabel("time [s]")
    axes.set_xlim(0, moved.time[np.flatnonzero(moved.label != REST)[-1]])
    figure.axes[column].legend(ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)


@_styled
def intervals(plan):
    """Widths of the 95 % intervals over the parameters' nominal sizes: known now, and after the experiment.

    Parameters
    ----------
    plan : Plan

    Returns
    -------
    matplotlib.figure.Figure
    """
    k = plan.known
    scale = np.array([k.model.parameters[n].nominal for n in k.free])
    before, after = (3.92 * np.sqrt(np.diag(c)) / scale for c in (np.linalg.inv(k.prior), plan.covariance))
    figure = Figure(figsize=(COLUMN, 0.6 + 0.22 * len(k.free)))
    axes = figure.add_subplot()
    at = np.arange(len(k.free))
    axes.hlines(at, after, before, color=GREY, lw=0.8)
    axes.plot(before, at, "s", color=RED, mfc="white", label="now")
    axes.plot(after, at, "o", color=BLUE, label="after the experiment")
    axes.set_xscale("log")
    axes.set_yticks(at, k.free)
    axes.invert_yaxis()
    axes.set_xlabel("width of the 95 % interval over nominal size")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.1)
    _titled(figure, "What the experiment would bring")
    return figure


def write_plan(folder, plan):
    """Figures of a plan, into ``folder / "figures"``.

    Parameters
    ----------
    folder : Path
    plan : Plan
    """
    ws, folder = plan.known.workspace, folder / "figures"
    if len(ws.kinematics.motors) == 2:
        save(workspace(ws), folder, "workspace")
    if len(ws.kinematics.joints) == 2 and np.isfinite(ws.limits.torque).all():
        save(domains(ws), folder, "domains")
    save(motion(plan), folder, "motion")
    if plan.known.free:
        save(intervals(plan), folder, "intervals")

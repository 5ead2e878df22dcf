"""A workspace or a plan in; descriptions of its plots, and its figures as files, out."""

from __future__ import annotations

import numpy as np

from ..design.motion import REST, TRANSFER
from .figures import save
from .plot import Area, Arrow, Axis, Band, Line, Look, Panel, Plot, Text, curve

EDGE = Look("ink", "dot")
INTERVAL = 3.92  # widths of a 95 % interval: twice 1.96 standard deviations


def _closed(points):
    return np.vstack([points, points[:1]]).T


def _angles(ws):
    return [Axis(motor, "rad") for motor in ws.kinematics.motors]


def workspace(ws):
    """Reachable motor angles, the lines through the middle on which a segment stands still, and the zones between.

    The arrows are the directions that keep every segment furthest from standstill.

    Parameters
    ----------
    ws : Workspace
        Workspace of the rig within the study's limits.

    Returns
    -------
    Plot or None
        None of a rig without two motors.
    """
    if len(ws.kinematics.motors) != 2:
        return None
    centre, size = ws.centre[0], np.ptp(ws.vertices, axis=0).min()
    marks = [Area(*_closed(ws.vertices)), Line(*_closed(ws.vertices), EDGE), *_stops(ws, 0.045 * size)]
    for k, (row, segments) in enumerate(ws.still):
        along = np.array([-row[1], row[0]])
        ends = [centre + along * ws.reach(centre, along), centre - along * ws.reach(centre, -along)]
        names = ", ".join(ws.kinematics.places[s] for s in segments)
        marks.append(Line(*np.array(ends).T, curve(k, width=0.9), f"{names} still"))
    for k, zone in enumerate(ws.zones):
        way = zone.direction / np.linalg.norm(zone.direction) * 0.3 * size
        marks += [Arrow(tuple(centre), tuple(centre + way), Look("third")),
                  Text(*(centre + 1.15 * way), str(k + 1), "third")]
    marks.append(Line(*centre[:, None], Look("ink", "", marker="circle")))
    return Plot("workspace", "Where the motors can go, and zones of direction", "Reachable motor angles, the lines on "
                "which a segment stands still, and numbered zones of direction between them.",
                [[Panel(*_angles(ws), marks, equal=True)]], height=3.2)


def _stops(ws, aside):
    """The limit that each edge is, in words beside it."""
    a, b, _ = ws.limits.halfspaces
    names = [n for n, low, high in zip(ws.limits.names, ws.limits.low, ws.limits.high)
             for end in (high, low) if np.isfinite(end)]
    for first, second in zip(ws.vertices, np.roll(ws.vertices, -1, axis=0)):
        on = [k for k in range(len(b)) if abs(a[k] @ first - b[k]) < 1e-6 and abs(a[k] @ second - b[k]) < 1e-6]
        if on:
            turn = np.degrees(np.arctan2(*(second - first)[::-1]))
            turn = turn - 180 if turn > 90 else turn + 180 if turn < -90 else turn
            yield Text(*((first + second) / 2 + aside * a[on[0]] / np.linalg.norm(a[on[0]])), names[on[0]], angle=turn)


def domains(ws):
    """Attainable joint torques and speeds, without friction: of this transmission, and of one motor a joint.

    Parameters
    ----------
    ws : Workspace
        Workspace of the rig within the study's limits.

    Returns
    -------
    Plot or None
        None of a rig without two joints or without limits of the torque.
    """
    if len(ws.kinematics.joints) != 2 or not np.isfinite(ws.limits.torque).all():
        return None
    columns = []
    for domain, what, unit in ((ws.torques, "torque", "N.m"), (ws.rates, "speed", "rad/s")):
        coupled, single = domain()
        if np.isfinite(coupled).all():
            marks = [Area(*_closed(coupled), "after"), Line(*_closed(coupled), Look("after"), "coupled"),
                     Line(*_closed(single), Look("before", "dash"), "one motor a joint")]
            columns.append([Panel(*(Axis(f"{what} of {n}", unit) for n in ws.kinematics.joints), marks, equal=True)])
    return Plot("domains", "What the joints can do", "Attainable torques and speeds of the joints, without friction: "
                "of this transmission, and of one motor a joint.", columns, width=1.5, height=2.7)


def motion(plan):
    """The planned motion: in the reachable motor angles where there are two, and over time.

    Parameters
    ----------
    plan : Plan
        Planned, not loaded: it holds the rig.

    Returns
    -------
    Plot
    """
    ws, moved = plan.known.workspace, plan.motion
    columns, plane = [_over_time(plan)], ""
    if len(ws.kinematics.motors) == 2:
        way = np.where(moved.label == TRANSFER, moved.angle, np.nan)
        marks = [Line(*_closed(ws.vertices), EDGE), Line(*way, Look("muted", width=0.5))]
        marks += [Line(*s.ends.T, curve(k, width=1.4, marker="tick")) for k, s in enumerate(moved.strokes)]
        columns.insert(0, [Panel(*_angles(ws), marks, equal=True)])
        plane = ", and in the plane of both motors' angles"
    return Plot("motion", "The planned motion", f"The motion of the motors over time{plane}; grey: what is held out of "
                "the fit.", columns, (1, 1.5)[-len(columns):], width=2, height=3.0)


def _over_time(plan):
    moved, motors = plan.motion, plan.known.workspace.kinematics.motors
    rows = [(Axis("angle", "rad"), moved.angle), (Axis("speed", "rad/s"), moved.speed)]
    rows += [] if plan.torque is None else [(Axis("torque", "N.m"), plan.torque)]
    held_out = [Band(a, b, "" if k else "held out", True) for k, (a, b) in enumerate(moved.held_out)]
    time = Axis("time", "s", low=0.0, high=float(moved.time[np.flatnonzero(moved.label != REST)[-1]]))
    return [Panel(time, y, [*held_out, *(Line(moved.time, v, curve(i, width=0.6), motor, signal=True)
                                         for i, (motor, v) in enumerate(zip(motors, values)))]) for y, values in rows]


def intervals(plan):
    """Widths of the 95 % intervals over the parameters' nominal sizes: known now, and after the experiment.

    Parameters
    ----------
    plan : Plan
        Planned, not loaded: it holds the rig.

    Returns
    -------
    Plot or None
        None where no parameter is free.
    """
    k, at = plan.known, np.arange(len(plan.known.free))
    if not k.free:
        return None
    scale = np.array([k.model.parameters[n].nominal for n in k.free])
    now, then = (INTERVAL * np.sqrt(np.diag(c)) / scale for c in (np.linalg.inv(k.prior), plan.covariance))
    marks = [Line(now, at, Look("before", "", marker="square", open=True), "now"),
             Line(then, at, Look("after", "", 0.8, "circle"), "after the experiment",
                  reach=(np.minimum(now, then), np.maximum(now, then)))]
    panel = Panel(Axis("width of the 95 % interval over nominal size", log=True),
                  Axis("parameter", names=k.free, falling=True), marks)
    return Plot("intervals", "What the experiment would bring", "Widths of the 95 % intervals over the parameters' "
                "nominal sizes, now and after the experiment.", [[panel]], height=0.9 + 0.22 * len(k.free))


def write_plan(folder, plan):
    """Figures of a plan, into ``folder / "figures"``.

    Parameters
    ----------
    folder : Path
        There already; ``figures/`` is made in it.
    plan : Plan
        Planned, not loaded: it holds the rig.
    """
    ws = plan.known.workspace
    for plot in (workspace(ws), domains(ws), motion(plan), intervals(plan)):
        if plot is not None:
            save(plot, folder / "figures", plot.id)

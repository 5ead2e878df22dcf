"""Data set and fitted models in; descriptions of plots of their samples, for paper and for a browser alike, out.

Curves and bars differ in dash, marker or hatch as well as in tone, and cells carry numbers. A title says what a plot
shows; its caption stands for it where it cannot be seen.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.errors import UnknownNameError, closest
from ..diagnosis.compare import branches, unit_of, worded
from . import values
from .plot import (
    DASHES,
    MARKERS,
    TONES,
    Arrow,
    Axis,
    Band,
    Bars,
    Cells,
    Level,
    Line,
    Look,
    Names,
    Panel,
    Plot,
    Spans,
    Text,
    beside,
)

NAMES = "base model", "improved model"
BEFORE, AFTER = Look("before", "dash", 1.3, "circle", True), Look("after", "solid", 1.3, "square")
LOOKS = BEFORE, AFTER
MOST = 12  # passes in a set of manoeuvres that is shown by itself


# --- words ----------------------------------------------------------------------------------------------------------


def axis(dataset, name, **more):
    """Axis of a channel, a column or a variable such as ``speed@2A``.

    Parameters
    ----------
    dataset : Dataset
        Its samples are drawn.
    name : str
        As tables call it.
    **more
        Attributes of `Axis`.

    Returns
    -------
    Axis
    """
    if name == "cycle":
        return Axis("angle within a cycle", "rad", **more)
    words = f"½ Δ{name[:-5]}" if name.endswith("_pair") else worded(name)
    return Axis(words, unit_of(dataset, name), **more)


def channel_name(channel):
    """A channel in words: pairs are half a difference.

    Parameters
    ----------
    channel : str
        As ``C_H``, or ``C_H_pair`` of half differences.

    Returns
    -------
    str
    """
    return f"half the difference of {channel[:-5]}, out and back" if channel.endswith("_pair") else channel


def _of(dataset, what, channel, **more):
    """Axis of what is computed from a channel, as its RMSE."""
    own = axis(dataset, channel)
    return replace(own, words=f"{what} {own.words}", **more)


def _units(dataset):
    return ", ".join(dict.fromkeys(unit_of(dataset, c) for c in dataset.channels))


def _spaced(effect):
    return effect.replace("_", " ")


def angles(dataset):
    """Names that the log has for the angles of the motors.

    Parameters
    ----------
    dataset : Dataset
        Its samples are drawn.

    Returns
    -------
    dict of str to str
        By variable.
    """
    column = {c.variable: n for n, c in dataset.study.columns.items()}
    return {k: column.get(k, k) for k in dataset.known if k.endswith("phi") and k in dataset.measured}


# --- where the machine went -----------------------------------------------------------------------------------------


def manoeuvres(dataset):
    """The passes in the plane of the two motor angles, and the lines on which a segment stands still.

    Parameters
    ----------
    dataset : Dataset
        Its samples are drawn.

    Returns
    -------
    Plot or None
        None where there are not two angles.
    """
    known = angles(dataset)
    if dataset.averaged or len(known) != 2:
        return None
    x, y = (dataset.measured[n] for n in known)
    lines, longest = {}, {}
    for s, name in values.passes(dataset):
        few = np.unique(np.linspace(s.start, s.stop - 1, 40).astype(int))
        for part, all_ in zip(lines.setdefault(name or "pass", ([], [])), (x, y)):
            part.extend([*all_[few], np.nan])
        length = np.hypot(x[s][-1] - x[s][0], y[s][-1] - y[s][0])
        if name and length > longest.get(name, (0,))[0]:
            longest[name] = length, s
    marks, size = _still_lines(dataset, x, y), max(np.ptp(x), np.ptp(y))
    for k, (name, xy) in enumerate(sorted(lines.items())):
        look = Look(TONES[k // 2 % 4], DASHES[k % 2], 1.3)
        named = name in longest
        thin = Look("muted", width=0.6)
        marks.append(Line(*map(np.array, xy), thin if named else look, name))
        if named:
            s = longest[name][1]
            marks += _arrow(x[s], y[s], (x[0], y[0]), name, 0.022 * size, look)
    marks.append(Line(x[:1], y[:1], Look("ink", "", marker="circle"), "where the log begins"))
    panel = Panel(*(axis(dataset, n) for n in known.values()), marks, equal=True)
    return Plot("plane", "Where the machine went", f"The passes in the plane of the motor angles: "
                f"{', '.join(sorted(lines))}. An arrow is the longest pass of a manoeuvre; dashed, lines on which a "
                "segment stands still.", [[panel]], height=3.0)


def _arrow(x, y, start, name, aside, look):
    """A pass as an arrow beside its line, on the right of its direction, with its name."""
    d = np.array([x[-1] - x[0], y[-1] - y[0]])
    right = np.array([d[1], -d[0]]) / np.hypot(*d) * aside
    a, b = (np.array([x[k], y[k]]) + right for k in (0, -1))
    far = 0.7 if np.hypot(*(b - start)) > np.hypot(*(a - start)) else 0.3  # passes fan out from the start
    return [Arrow(tuple(a + 0.04 * d), tuple(b - 0.04 * d), look),
            Text(*(a + far * (b - a) + 2 * right), name, look.tone)]


def still_directions(dataset):
    """Direction in (angle 1, angle 2) along which each segment stands still, from the log's own motion.

    Parameters
    ----------
    dataset : Dataset
        Its samples are drawn.

    Returns
    -------
    dict of str to ndarray, shape (2,)
        By place.
    """
    rates = np.array([dataset.signals[f"der({n})"] for n in angles(dataset)])
    rows = np.linalg.lstsq(rates @ rates.T, rates @ dataset.speeds.T, rcond=None)[0].T
    return {place: np.array([-row[1], row[0]]) / np.hypot(*row)
            for place, row in zip(dataset.base.segments.values(), rows) if np.hypot(*row) > 0}


def _still_lines(dataset, x, y):
    """Lines through the start, from border to border, on which a segment stands still, named by segment."""
    groups, marks = {}, []
    for place, d in still_directions(dataset).items():
        d = d * (1 if d[np.argmax(np.abs(d))] > 0 else -1)
        key = next((k for k in groups if np.allclose(k, d, atol=0.02)), tuple(d))
        groups.setdefault(key, []).append(place)
    half = 0.56 * max(np.ptp(x), np.ptp(y))
    limits = [((v.min() + v.max()) / 2 - half, (v.min() + v.max()) / 2 + half) for v in (x, y)]
    for d, places in groups.items():
        start, d = np.array([x[0], y[0]]), np.array(d)
        ahead, back = (min((max(sign * c * e for e in ends) - sign * c * s) / (c * c) for s, c, ends in
                           zip(start, d, limits) if abs(c) > 1e-6) for sign in (1, -1))
        line = np.array([start - back * d, start + ahead * d]).T
        marks.append(Line(*line, Look("ink", "dash", 0.7), f"{', '.join(places)} still"))
        named = start + 0.72 * max(ahead, -back, key=abs) * d
        turn = float(np.degrees(np.arctan2(d[1], d[0])))
        marks.append(Text(*named, f"{', '.join(places)} still", angle=turn if turn <= 90 else turn - 180))
    return marks


# --- over time ------------------------------------------------------------------------------------------------------


def timeline(dataset, models, names=NAMES, window=None):
    """Model against measurement: marks, speeds, every channel, and what each model leaves.

    Parameters
    ----------
    dataset : Dataset
        Its samples are drawn.
    models : list of (Model, Fit)
        One or two.
    names : sequence of str
        What the models are called.
    window : slice, optional
        Samples to show; the whole log by default.

    Returns
    -------
    Plot
    """
    shown, time = window or slice(None), values.clock(dataset)
    panels = [_marks(dataset, models[-1], time, time[shown]), _speeds(dataset, time, shown)]
    kinds = ("value",) if dataset.paired else ("value", "error")
    for channel in dataset.outputs:
        panels += [_outputs(dataset, models, names, time, shown, channel, kind) for kind in kinds]
    if dataset.paired:  # the error is that of two passes
        panels += [_outputs(dataset, models, names, time, shown, c, "error") for c in dataset.channels]
    caption = (f"Measured and modelled {', '.join(map(channel_name, dataset.channels))} over "
               f"{time[shown][-1] - time[shown][0]:.4g} s, {len(time[shown])} samples. Marks on top: manoeuvres, "
               "passes held out of every fit, when a motor's torque is negative, and the branch of each segment, thick "
               "where power flows to the joint (direct) and thin where it flows back (reverse), none where it stands "
               "still.")
    title = "Everything over time" if window is None else "Model against measurement, where the error is largest"
    return Plot("timeline", title, caption, [panels], width=2, height=0.7 + 0.85 * sum(p.height for p in panels))


def worst_window(dataset, model, fit, margin=0.02):
    """The set with every labelled manoeuvre once (else six passes) in which a model errs most, and a little around it.

    Parameters
    ----------
    dataset : Dataset
        Its samples are drawn.
    model : Model
        That was fitted.
    fit : Fit
        Of that model.
    margin : float
        What is added at either end, as a share of the set.

    Returns
    -------
    slice
        Of the samples.
    """
    residual, index = values.residual_of(dataset, model, fit)
    window = _worst(dataset, residual, index)
    extra = int(margin * (window.stop - window.start))
    same = np.flatnonzero(dataset.run == dataset.run[window.start])
    return slice(max(window.start - extra, same[0]), min(window.stop + extra, same[-1] + 1))


def _worst(dataset, residual, index):
    found = values.passes(dataset)
    energy = np.zeros(len(dataset.time))
    np.add.at(energy, index, (residual ** 2).sum(0))
    names = {n for _, n in found if n}
    best = None
    for k in [k for k, (_, n) in enumerate(found) if n == found[0][1]]:  # a set begins as the log does
        seen, last = set(), None
        for m in range(k, min(k + MOST, len(found))):
            seen.add(found[m][1])
            if (names <= seen) if names and len(names) <= MOST else m == k + 5:
                last = m
                break
        if last is None or dataset.run[found[k][0].start] != dataset.run[found[last][0].start]:
            continue
        s = slice(found[k][0].start, found[last][0].stop)
        mean = energy[s].sum() / max(1, dataset.moving[s].sum())
        if best is None or mean > best[0]:
            best = mean, s
    return best[1] if best else slice(0, len(dataset.time))


def _signal(time, signal, shown, look, name):
    return Line(time[shown], signal[shown], look, name, signal=True)


def _speeds(dataset, time, shown):
    """Speeds of the motors."""
    names = [k for k in dataset.signals if k.startswith("der(") and k.count("(") == 1] or list(dataset.signals)[:1]
    looks = Look("ink", "solid", 0.8), Look("muted", "dash", 1.1), Look("third", "dot", 1.2), Look("after", "dashdot")
    lines = [_signal(time, dataset.signals[n], shown, look, n[4:-1].removesuffix(".phi"))
             for n, look in zip(names, looks)]
    return Panel(Axis("time", "s"), Axis("speed", dataset.base.along("rad/s")), lines)


def _outputs(dataset, models, names, time, shown, channel, kind):
    """A channel as measured and by each model, or what each model leaves of it."""
    lines = []
    if kind == "value":
        if not dataset.paired:
            lines.append(_signal(time, dataset.reference(channel), shown, Look("ink", "solid", 2.0), "measured"))
        lossless = values.ideal(dataset)
        if lossless is not None:
            lines.append(replace(_signal(time, lossless[channel], shown, Look("muted", "dot", 1.0), "without losses"),
                                 aside=True))
    for look, name, (model, fit) in zip(LOOKS, names, models):
        made = values.outputs if kind == "value" else values.residual_over_time
        lines.append(_signal(time, made(dataset, model, fit)[channel], shown,
                             replace(look, marker="", width=0.9), name))
    own = axis(dataset, channel)
    return Panel(Axis("time", "s"), own if kind == "value" else replace(own, words=f"error {own.words}"), lines,
                 height=1.5 if kind == "value" else 1.0)


def _marks(dataset, best, time, shown):
    """Rows of marks, from below: branches, negative torques, what is held out, manoeuvres, runs."""
    begin, end = shown[0], shown[-1]
    shortest, rows, marks = (end - begin) / 4000, [], []

    def spans(codes, code=True):
        return [(max(a, begin), min(b, end)) for a, b, c in values.stretches(time, codes, shortest)
                if c == code and b > begin and a < end]

    def row(name, codes, look, told="", code=True):
        found = spans(codes, code)
        if found:
            marks.append(Spans(found, len(rows), look, told or name))
        if name and (found or told):
            rows.append(name)
    for place, branch in reversed(branches(dataset, *best).items()):
        codes = np.where(dataset.moving, branch, "")
        row("", codes, Look("third", width=4), "direct", "direct")
        row(f"branch {place}", codes, Look("muted", width=1.5), "reverse", "reverse")
    torques = [dataset.signals[k] < 0 for k in dataset.known if k in dataset.signals and k.endswith("tau")]
    if torques:
        row("torque < 0", np.any(torques, axis=0) & dataset.moving, Look("before", width=3))
    if dataset.is_test.any():
        row("held out", dataset.moving & (dataset.block >= 0) & dataset.is_test[dataset.block], Look("ink", width=4))
    named = [(float(time[(s.start + s.stop) // 2]), n) for s, n in values.passes(dataset) if n]
    runs = [((a + b) / 2, dataset.logs[int(r)].name) for a, b, r in values.stretches(time, dataset.run)]
    for name, words in (("manoeuvre", named), ("run", runs if len(runs) > 1 else [])):
        words = [(t, n) for t, n in words if begin <= t <= end]
        if words:
            marks.append(Names(*([w[0] for w in words], len(rows), [w[1] for w in words]), name))
            rows.append(name)
    return Panel(Axis("time", "s"), Axis(names=rows, low=-0.7, high=len(rows) - 0.3), marks,
                 height=0.4 + 0.1 * len(rows))


# --- where it fails -------------------------------------------------------------------------------------------------


def groups(dataset, models, floor, names=NAMES):
    """Error by manoeuvre, by branch of each segment and by run (in the order of the study), of each model.

    A log that has none of these is split by the sign of the speed, and stands as a whole where that has one sign.

    Parameters
    ----------
    dataset : Dataset
        Its samples are drawn.
    models : list of (Model, Fit)
        Those that are compared, the base model first.
    floor : dict of str to float
        Noise floor of each channel.
    names : sequence of str
        What each model is called in the legend.

    Returns
    -------
    list of Plot
        One a grouping and channel.
    """
    residuals = [values.sampled(dataset, *m)[0] for m in models]
    splits = {k: v for k, v in _splits(dataset, *models[0]).items() if len(v) > 1} or {"log": {"whole": slice(None)}}
    plots = []
    for name, parts in splits.items():
        sizes = [[np.sqrt(np.mean(r[:, where] ** 2, axis=1)) for where in parts.values()] for r in residuals]
        for c, channel in enumerate(dataset.channels):
            looks = (Look("muted"),) if len(models) == 1 else (replace(BEFORE, hatch="/"), AFTER)
            marks = [Bars(range(len(parts)), [float(v[c]) for v in size], looks[k], names[k], (k, len(models)))
                     for k, size in enumerate(sizes)]
            marks += _floor_level(floor, channel)
            worst = list(parts)[int(np.argmax([v[c] for v in sizes[0]]))].replace("\n", " ")
            caption = f"Error of {channel_name(channel)} by {name}; of the {names[0]} it is largest for {worst}."
            panel = Panel(Axis(name, names=list(parts)), _of(dataset, "RMSE of", channel, low=0), marks)
            plots.append(Plot(f"{name}_{channel}".replace(" ", "_"), "Error by group", caption, [[panel]],
                              choice=f"{channel} by {name}", over=(name,), channel=channel))
    return plots


def _floor_level(floor, channel):
    known = floor.get(channel) is not None and np.isfinite(floor[channel])
    return [Level(floor[channel], Look("ink", "dot", 1.3), "noise floor")] if known else []


def _splits(dataset, model, fit):
    """Groupings, each its groups and where their samples are."""
    _, index, _ = values.sampled(dataset, model, fit)

    def parts(codes, form="{}"):
        return {form.format(n): codes == n for n in np.unique(codes)}
    found = {} if dataset.labels is None else {"manoeuvre": parts(dataset.labels[index].astype(str))}
    for place, branch in branches(dataset, model, fit).items():
        found[f"branch of {place}"] = parts(branch[index].astype(str))
    if len(dataset.logs) > 1 and not dataset.averaged:
        found["run"] = parts(dataset.run[index] + 1)
    if dataset.averaged and all(len(v) < 2 for v in found.values()):
        split = [parts(np.where(dataset.speeds[k, index] > 0, "> 0", "< 0"), place + "\nspeed {}")
                 for k, place in enumerate(dataset.base.segments.values())]
        found["sign of the speed"] = {n: where for own in split for n, where in own.items()}
    return found


def where_it_fails(dataset, model, fit, floor):
    """All groups of one model beside each other.

    Parameters
    ----------
    dataset : Dataset
        Its samples are drawn.
    model : Model
        That was fitted.
    fit : Fit
        Of that model.
    floor : dict of str to float
        Noise floor of each channel.

    Returns
    -------
    Plot
    """
    plots = groups(dataset, [(model, fit)], floor)
    sizes = list({p.over: max(3, len(p.panels[0].x.names)) for p in plots}.values())
    return beside(plots, "Where the model fails", widths=sizes, width=2 if sum(sizes) > 6 else 1,
                  height=0.7 + 1.1 * len(dataset.channels))


def maps(dataset, models, names=NAMES):
    """Error of each channel over speed and load of each segment, and over the angles, of each model.

    Parameters
    ----------
    dataset : Dataset
        Its samples are drawn.
    models : list of (Model, Fit)
        Those that are compared, the base model first.
    names : sequence of str
        What each model is called in the legend.

    Returns
    -------
    list of Plot
        The map that the base model's error is most concentrated on comes first.
    """
    residuals = [values.sampled(dataset, *m)[0] for m in models]
    known = values.sampled(dataset, *models[0])[2]
    found = []
    for x, y in values.planes(dataset, known):
        each = [values.residual_map(known[x], known[y], r) for r in residuals]
        for c, channel in enumerate(dataset.channels):
            half = values.half_energy(each[0]["energy"][c], each[0]["samples"])
            found.append((half, _map(dataset, channel, c, (x, y), each, half, names)))
    return [plot for _, plot in sorted(found, key=lambda f: f[0])]


def first_maps(dataset, model, fit):
    """The map of each channel that a model's error is most concentrated on.

    Parameters
    ----------
    dataset : Dataset
        Its samples are drawn.
    model : Model
        That was fitted.
    fit : Fit
        Of that model.

    Returns
    -------
    list of Plot
        None of a rig without planes to draw over.
    """
    found = maps(dataset, [(model, fit)])
    return [next(p for p in found if p.channel == c) for c in dataset.channels if found]


def _map(dataset, channel, c, plane, each, half, names):
    top = max(float(np.nanmax(m["rmse"][c])) for m in each)
    columns = []
    for m, name in zip(each, names):
        share = 100 * np.nan_to_num(m["energy"][c])
        cells = Cells(m["x"], m["y"], m["rmse"][c], [[f"{v:.0f}" if v >= values.TOLD else "" for v in row]
                                                     for row in share], share, _of(dataset, "RMSE of", channel), top,
                      name=name)
        columns.append([Panel(axis(dataset, plane[0]), axis(dataset, plane[1]), [cells],
                              name if len(each) > 1 else "")])
    words = f"{worded(plane[0])} and {worded(plane[1])}"
    caption = (f"Error of {channel_name(channel)} over {words}. Colour: its RMS in a cell. Number: the cell's share of "
               f"the error's energy, in percent. Half of that of the {names[0]} lies in {100 * half:.0f} % of the "
               "samples.")
    return Plot(f"map_{channel}_{'_'.join(plane)}".replace("@", "_"), "Where the error is", caption, columns,
                width=len(each), height=2.7, aligned=True, choice=f"{channel} over {words}", over=tuple(plane),
                channel=channel, note="number in a cell: its share of the error's energy in percent")


def unexplained(dataset, left):
    """Where a residual that no effect explains lives: its mean over two variables, and how much of its energy.

    Parameters
    ----------
    dataset : Dataset
        Its samples are drawn.
    left : dict or None
        Of `pycosim.unexplained.unexplained`.

    Returns
    -------
    Plot or None
        None where nothing is left, or only one variable is known to matter.
    """
    found = left and left["map"]
    if not found:
        return None
    mean, share = np.asarray(found["mean"], dtype=float), 100 * np.asarray(found["energy"], dtype=float)
    edges, channel = (np.asarray(found[f"{a}_edges"]) for a in "xy"), left["channel"]
    cells = Cells(*edges, mean, values.signed_shares(mean, share), share, _of(dataset, "mean residual of", channel),
                  float(np.nanmax(np.abs(mean))), True, "residual")
    words = f"{worded(found['x'])} and {worded(found['y'])}"
    caption = (f"Mean of what is left of {channel_name(channel)} over {words}; number in a cell: its share of the "
               "energy in percent, with the sign of the mean.")
    return Plot("unexplained", "What no effect explains", caption,
                [[Panel(axis(dataset, found["x"]), axis(dataset, found["y"]), [cells])]], height=2.7,
                note="number in a cell: its share of the energy in percent,\nwith the sign of the mean")


def profiles(dataset, models, floor, names=NAMES, over=None, also=()):
    """Mean and spread of the residual over one variable: of one model apart for two directions, else of each model.

    Parameters
    ----------
    dataset : Dataset
        Its samples are drawn.
    models : list of (Model, Fit)
        Those that are compared, the base model first.
    floor : dict of str to float
        Noise floor of each channel.
    names : sequence of str
        What each model is called in the legend.
    over : sequence of str, optional
        Variables; by default the angles, time since reversal, temperature and time.
    also : sequence of str
        Variables before these, as ``speed@2A``.

    Returns
    -------
    list of Plot
    """
    residuals = [values.sampled(dataset, *m)[0] for m in models]
    known = values.sampled(dataset, *models[0])[2]
    over = over or [*also, *angles(dataset).values(), "time_since_reversal", "temperature", "time"]
    curves = [(name, r, slice(None), look) for name, r, look in zip(names, residuals, LOOKS)]
    if len(models) == 1:
        forward, place = values.direction(residuals[0], known)
        curves = [(f"speed of {place} {sign} 0" if place else "all samples", residuals[0], where, look) for sign, where,
                  look in ((">", forward, AFTER), ("<", ~forward, BEFORE)) if where.sum() > 10]
    plots = []
    for name in [n for n in dict.fromkeys(over) if n in known]:
        for c, channel in enumerate(dataset.channels):
            marks = [Band(-m.value, m.value, m.name) for m in _floor_level(floor, channel)]
            for text, residual, where, look in curves:
                centre, mean, spread = values.binned(known[name][where], residual[c][where])
                marks.append(Line(centre, mean, replace(look, width=0.9), text, spread=spread))
            caption = (f"Mean and standard deviation of the error of {channel_name(channel)} in bins of "
                       f"{worded(name)}.")
            panel = Panel(axis(dataset, name), _of(dataset, "residual of", channel), marks)
            plots.append(Plot(f"over_{name}_{channel}", "Error over one variable", caption, [[panel]],
                              choice=f"{channel} over {worded(name)}", over=(name,), channel=channel))
    return plots


def residuals(dataset, model, fit, floor, over=None, channel=None):
    """Residual against speed, load, angle, time since reversal and time, in two directions.

    Of each kind the variable with the strongest dependence is shown. Mean and standard deviation in bins, apart for the
    two signs of the speed of the segment named in the legend; grey band: the noise floor.

    Parameters
    ----------
    dataset : Dataset
        Its samples are drawn.
    model : Model
        That was fitted.
    fit : Fit
        Of that model.
    floor : dict of str to float
        Noise floor of each channel.
    over : str, optional
        This variable alone, as ``speed@2A``.
    channel : str, optional
        This channel alone.

    Returns
    -------
    Plot

    Raises
    ------
    UnknownNameError
        The residual of these data cannot be drawn over that.
    """
    residual, _, known = values.sampled(dataset, model, fit)
    if over is not None and over not in known:
        raise UnknownNameError(f"no variable '{over}' to draw the residual over{closest(over, known)}")
    shown = [over] if over else _strongest(dataset, residual, known)
    plots = [p for p in profiles(dataset, [(model, fit)], floor, over=shown) if channel in (None, p.channel)]
    rows = len({p.channel for p in plots})
    return beside(plots, "What the residual depends on", width=2 * max(0.5, len(shown) / 5), height=0.75 + 1.35 * rows)


def _strongest(dataset, residual, known):
    """Of each kind of variable, the one that the residual depends on most."""
    forward, _ = values.direction(residual, known)
    own = set(angles(dataset).values())
    kinds = [[n for n in known if n.startswith("speed@")], [n for n in known if n.startswith("load@")],
             [n for n in known if n in own], ["time_since_reversal"], ["time"], ["temperature"]]
    kinds = [[n for n in kind if n in known] for kind in kinds]
    shown = [max(kind, key=lambda n: values.explained_share(known[n], residual, forward)) for kind in kinds if kind]
    return shown[:5] or list(known)[:1]


# --- which effect ---------------------------------------------------------------------------------------------------


def signature(dataset, before, after, key):
    """What a missing effect looks like: before and after it is added, against the variable it depends on.

    First: root mean square of the residual. Then: what is missing at the effect's place, that is the residual's share
    in the direction of a torque there, all else as fitted with the effect; the line is the fitted effect.

    Parameters
    ----------
    dataset : Dataset
        Its samples are drawn.
    before, after : (Model, Fit)
        Without the effect, and with it.
    key : (str, str)
        Effect and place.

    Returns
    -------
    Plot
    """
    found = values.signature_values(dataset, before, after, key)
    missing, x, words = found["missing"], axis(dataset, found["variable"]), f"{_spaced(key[0])} at {key[1]}"
    texts = "without the effect", "with it"
    marks = [Line(centre, rms, replace(look, dash=DASHES[c % 4], marker=MARKERS[(2 * c + k) % 4]),
                  f"{channel} {text}") for c, (channel, (centre, *pair)) in enumerate(found["rmse"].items())
             for k, (rms, text, look) in enumerate(zip(pair, texts, LOOKS))]
    columns = [[Panel(x, Axis("RMSE", _units(dataset), low=0), marks, legend=True)]]
    caption = f"Error against {worded(found['variable'])}, without {words} and with it."
    if missing:
        centre = missing["centre"]
        marks = [Line(centre, missing["without"], Look("before", "", marker="circle", open=True), texts[0]),
                 Line(centre, missing["effect"], Look("ink", "solid", 1.3), "the fitted effect"),
                 Line(centre, missing["with"], Look("after", "", marker="square"), texts[1])]
        columns.append([Panel(x, Axis(f"missing {missing['kind']} of {missing['place']}", missing["unit"]), marks,
                              legend=True)])
        caption += (f" Then the {missing['kind']} that is missing at {missing['place']}, all else as fitted with the "
                    "effect; the line is the fitted effect.")
    return Plot(f"signature_{key[0]}_{key[1]}", f"What {words} looks like", caption, columns, width=len(columns))

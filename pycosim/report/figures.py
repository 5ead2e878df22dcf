"""Data set, fitted models and diagnoses in; figures that a paper can print, as vector PDF with a PNG preview, out.

Every curve differs in line style or marker as well as in colour, so that print without colour stays readable. A title
says what a figure shows; its docstring serves as a caption.
"""

from __future__ import annotations

from functools import wraps

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, ScalarFormatter

from ..core.errors import UnknownNameError, closest
from ..diagnosis.compare import branches, errors, unit_of, worded
from ..diagnosis.dependence import explanations, noise_floor
from ..diagnosis.scores import LEVEL
from .cards import chance
from .schematic import coloured, write_schematic
from .values import (
    _quiet,
    binned,
    envelope,
    explained_share,
    half_energy,
    ideal,
    interval_rows,
    outputs,
    passes,
    planes,
    residual_map,
    residual_of,
    signature_values,
    signed_shares,
)

COLUMN, PAGE = 3.46, 7.1  # width of a column and of a page [inch]
# Hues of Okabe and Ito, safe for colour-blind readers; the blue darker than theirs, to differ from the red in print
BLUE, RED, GREEN, GREY = "#004C7F", "#D55E00", "#009E73", "#767676"
TONES = BLUE, RED, GREEN, "black"
MARKERS, LINES, HATCHES = "os^D", ("-", "--", "-.", ":"), ("", "////", "....", "xxxx")
STYLE = {
    "font.family": "serif", "font.serif": ["STIXGeneral", "DejaVu Serif"], "mathtext.fontset": "stix", "font.size": 8,
    "axes.labelsize": 8, "legend.fontsize": 7, "xtick.labelsize": 7, "ytick.labelsize": 7, "axes.linewidth": 0.6,
    "lines.linewidth": 1.0, "lines.markersize": 3.5, "xtick.direction": "in", "ytick.direction": "in",
    "xtick.major.width": 0.5, "ytick.major.width": 0.5, "axes.spines.top": False, "axes.spines.right": False,
    "legend.frameon": False, "legend.handlelength": 2.2, "hatch.linewidth": 0.5, "pdf.fonttype": 42,
    "figure.constrained_layout.use": True,
}


def _styled(function):
    """Draw in the style of this module, whatever the user's own."""
    @wraps(function)
    def inner(*arguments, **options):
        with mpl.rc_context({**mpl.rcParamsDefault, **STYLE}):
            result = function(*arguments, **options)
            for axes in result.axes if isinstance(result, Figure) else ():
                _format(axes)
            return result
    return inner


class _Numbers(ScalarFormatter):
    """Plain text at the ticks, a printed power of ten beside them: mathematics at every tick is slow."""

    def get_offset(self):
        """The power of ten."""
        self.set_useMathText(True)
        try:
            return super().get_offset()
        finally:
            self.set_useMathText(False)


def _titled(figure, text):
    """Say what a figure shows, above all else; where a legend stands on top, in it, or they would lie on each other."""
    style = {"size": 8.5, "weight": "bold"}
    if figure.legends:
        figure.legends[0].set_title(text, prop=style)
    else:
        figure.suptitle(text, fontproperties=style)


def _explained(figure, text):
    """What the numbers in a figure are, below it."""
    figure.supxlabel(text, fontsize=6.5)


def _format(axes):
    for axis, limits in ((axes.xaxis, (-4, 5)), (axes.yaxis, (-3, 4))):
        if type(axis.get_major_formatter()) is ScalarFormatter:
            axis.set_major_formatter(_Numbers())
            axis.get_major_formatter().set_powerlimits(limits)


# --- words and units ------------------------------------------------------------------------------------------------


def _pretty(unit):
    """A unit as papers print it."""
    text = unit.replace("rad/s/s", "rad/s2").replace("m/s/s", "m/s2").replace(".", r"$\,$").replace("s2", "s$^2$")
    return text.replace("degC", "°C") or "1"


def label(dataset, name, symbol=None):
    """Axis label of a channel or variable, with its unit.

    Parameters
    ----------
    dataset : Dataset
    name : str
        Channel, column, or variable of `pycosim.diagnosis.dependence.explanations`.
    symbol : str, optional
        Instead of the name's own.

    Returns
    -------
    str
    """
    words = worded(name)
    text = symbol or (words if words != name else _symbol(dataset, name))
    return _measured(text, unit_of(dataset, name))


def _measured(text, unit):
    """Words of an axis with their unit; a number without unit has none."""
    return text if unit in ("1", "") else f"{text} [{_pretty(unit)}]"


def _symbol(dataset, name):
    """C_H as a symbol; other names as they are."""
    paired = name.endswith("_pair")
    head, _, index = name.removesuffix("_pair").partition("_")
    if len(head) == 1 and index.isalnum():
        return rf"$\frac{{1}}{{2}}\Delta {head}_\mathrm{{{index}}}$" if paired else rf"${head}_\mathrm{{{index}}}$"
    if name[-1:].isdigit() and name[:-1] in ("theta", "tau", "omega"):
        return rf"$\{name[:-1]}_{name[-1]}$"
    return r"$\tau$" if name == "tau" else name.replace("_", " ")


def _capital(text):
    return text if text.startswith("$") else text[:1].upper() + text[1:]


# --- values ---------------------------------------------------------------------------------------------------------


def _segment_directions(dataset):
    """Direction in (angle 1, angle 2) along which each segment stands still, from the log's own motion.

    Returns
    -------
    dict of str to ndarray, shape (2,)
        By place.
    """
    rates = np.array([dataset.signals[f"der({n})"] for n in _angles(dataset)])
    rows = np.linalg.lstsq(rates @ rates.T, rates @ dataset.speeds.T, rcond=None)[0].T
    return {place: np.array([-row[1], row[0]]) / np.hypot(*row)
            for place, row in zip(dataset.base.segments.values(), rows) if np.hypot(*row) > 0}


def _angles(dataset):
    return [k for k in dataset.known if k.endswith("phi") and k in dataset.measured]


def _named(dataset, variable):
    """Name that the log has for a variable."""
    return next((n for n, c in dataset.study.columns.items() if c.variable == variable), variable)


def has_plane(dataset):
    """Whether the rig has two motors, whose angles make a plane.

    Parameters
    ----------
    dataset : Dataset

    Returns
    -------
    bool
    """
    return not dataset.averaged and len(_angles(dataset)) == 2


def _window(dataset, residual, index, most=12):
    """Slice of the log with every labelled manoeuvre once (else six passes), where the residual is largest."""
    found = passes(dataset)
    energy = np.zeros(len(dataset.time))
    np.add.at(energy, index, (residual ** 2).sum(0))
    names = {n for _, n in found if n}
    best = None
    for k in [k for k, (_, n) in enumerate(found) if n == found[0][1]]:  # a set begins as the log does
        seen, last = set(), None
        for m in range(k, min(k + most, len(found))):
            seen.add(found[m][1])
            if (names <= seen) if names and len(names) <= most else m == k + 5:
                last = m
                break
        if last is None or dataset.run[found[k][0].start] != dataset.run[found[last][0].start]:
            continue
        s = slice(found[k][0].start, found[last][0].stop)
        mean = energy[s].sum() / max(1, dataset.moving[s].sum())
        if best is None or mean > best[0]:
            best = mean, s
    return best[1] if best else slice(0, len(dataset.time))


def _widened(dataset, window, margin=0.02):
    """A window with a little of what is around it in the same run."""
    extra = int(margin * (window.stop - window.start))
    same = np.flatnonzero(dataset.run == dataset.run[window.start])
    return slice(max(window.start - extra, same[0]), min(window.stop + extra, same[-1] + 1))


# --- the figures ----------------------------------------------------------------------------------------------------


@_styled
def manoeuvres(dataset):
    """The passes in motor space, with their directions; dashed, the lines on which a segment stands still.

    The longest pass of each manoeuvre is named at its arrow; others are thin lines.

    Parameters
    ----------
    dataset : Dataset

    Returns
    -------
    matplotlib.figure.Figure
    """
    x, y = (dataset.measured[n] for n in _angles(dataset))
    figure = Figure(figsize=(COLUMN, 3.0))
    axes = figure.add_subplot()
    longest = {}
    for s, name in passes(dataset):
        axes.plot(*envelope(x[s], y[s], 100), color=GREY, lw=0.5, alpha=0.6, zorder=1)
        length = np.hypot(x[s][-1] - x[s][0], y[s][-1] - y[s][0])
        if name and length > longest.get(name, (0,))[0]:
            longest[name] = length, s
    size = max(np.ptp(x), np.ptp(y))
    for k, (name, (_, s)) in enumerate(sorted(longest.items())):
        _arrow(axes, x[s], y[s], (x[0], y[0]), name, 0.022 * size, TONES[(k // 2) % len(TONES)], LINES[k % 2])
    start = x[0], y[0]
    axes.plot(*start, "o", color="black", ms=4, zorder=5)
    _still_lines(axes, dataset, start)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(label(dataset, _named(dataset, _angles(dataset)[0])))
    axes.set_ylabel(label(dataset, _named(dataset, _angles(dataset)[1])))
    _titled(figure, "Passes in the plane of the motor angles")
    return figure


def _arrow(axes, x, y, start, name, aside, color, line):
    """A pass as an arrow beside its line, on the right of its direction, with its name."""
    d = np.array([x[-1] - x[0], y[-1] - y[0]])
    right = np.array([d[1], -d[0]]) / np.hypot(*d) * aside
    a, b = (np.array([x[k], y[k]]) + right for k in (0, -1))
    axes.annotate("", b - 0.04 * d, a + 0.04 * d, zorder=3,
                  arrowprops={"arrowstyle": "-|>", "color": color, "lw": 1.2, "ls": line, "shrinkA": 0, "shrinkB": 0})
    far = 0.7 if np.hypot(*(b - start)) > np.hypot(*(a - start)) else 0.3  # passes fan out from the start
    axes.text(*(a + far * (b - a) + 2 * right), name, color=color, ha="center", va="center", fontsize=9,
              fontweight="bold")


def _still_lines(axes, dataset, start):
    """Lines through the start on which a segment stands still, named by segment."""
    groups = {}
    for place, d in _segment_directions(dataset).items():
        d = d * (1 if d[np.argmax(np.abs(d))] > 0 else -1)
        key = next((k for k in groups if np.allclose(k, d, atol=0.02)), tuple(d))
        groups.setdefault(key, []).append(place)
    axes.autoscale_view()
    for d in groups:
        axes.axline(start, (start[0] + d[0], start[1] + d[1]), color="black", lw=0.7, ls=(0, (5, 3)), zorder=0)
    limits = axes.get_xlim(), axes.get_ylim()
    axes.dataLim.update_from_data_xy(np.array(limits).T, ignore=False)
    for d, places in groups.items():
        text = f"{', '.join(places)} still{_equation(d)}"
        reach = _reach(start, d, limits)
        axes.text(start[0] + reach * d[0], start[1] + reach * d[1], text, fontsize=6.5, color="black", ha="center",
                  va="center", rotation=np.degrees(np.arctan2(d[1], d[0])), rotation_mode="anchor", zorder=6,
                  transform_rotates_text=True, bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8})


def _equation(d):
    """The direction in words of the two speeds, where they are simple."""
    simple = {(0, 1): r": $\dot\theta_1 = 0$", (1, 0): r": $\dot\theta_2 = 0$",
              (1, 1): r": $\dot\theta_1 = \dot\theta_2$"}
    return simple.get(tuple(np.round(np.array(d) / np.max(np.abs(d)), 2) + 0.0), "")


def _reach(start, d, limits):
    """Distance along a line to most of the way to the border, on the longer side."""
    ends = []
    for sign in (1, -1):
        steps = [(max(sign * c * e for e in lim) - sign * c * s) / (c * c) for s, c, lim in zip(start, d, limits)
                 if abs(c) > 1e-6]
        ends.append(sign * 0.72 * min(steps))
    return max(ends, key=abs)


@_styled
def over_time(dataset, model, fit, other=None, window=None):
    """Speeds, measured and modelled outputs, and what is left, over one set of manoeuvres.

    The window is the set where the first model is worst. Grey: something stands still; hatched: a motor torque is
    negative.

    Parameters
    ----------
    dataset : Dataset
    model, fit : Model, Fit
    other : (Model, Fit), optional
        The improved model.
    window : slice, optional
        Of the samples; the whole log with ``slice(None)``.

    Returns
    -------
    matplotlib.figure.Figure
    """
    residual, index = residual_of(dataset, model, fit)
    window = window or _widened(dataset, _window(dataset, residual, index))
    window = slice(*window.indices(len(dataset.time)))
    heights = [1] + ([1.6] if dataset.paired else [1.6, 1]) * len(dataset.outputs)
    figure = Figure(figsize=(PAGE, 1.0 + 0.85 * sum(heights)))
    axes = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    _speeds(axes[0], dataset, window)
    shown = [("friction model", RED, "-", model, fit)]
    if other:
        shown = [("base model", RED, "--", model, fit), ("improved model", BLUE, "-", *other)]
    lossless = ideal(dataset)
    for k, channel in enumerate(dataset.outputs):
        panels = [axes[1 + k]] if dataset.paired else axes[1 + 2 * k:3 + 2 * k]
        _fitted(panels, dataset, channel, window, shown, lossless)
    for panel in axes:
        _zones(panel, dataset, window)
        panel.yaxis.set_major_locator(MaxNLocator(4))
        panel.margins(x=0)
    _names(axes[0], dataset, window)
    axes[-1].set_xlabel("Time [s]")
    zones = [Patch(facecolor="0.87", label="a segment stands still")]
    if (_negative(dataset) & dataset.moving)[window].any():
        zones.append(Patch(facecolor="none", edgecolor="0.55", hatch="////", lw=0, label="a motor torque is negative"))
    handles = [*axes[0].get_legend_handles_labels()[0], *axes[1].get_legend_handles_labels()[0], *zones]
    figure.legend(handles=handles, loc="outside upper center", ncols=-(-len(handles) // 2), columnspacing=1.4)
    figure.align_ylabels(axes)
    _titled(figure, "Model against measurement, where the error is largest")
    return figure


def _speeds(axes, dataset, window):
    """Speeds of the motors."""
    names = [k for k in dataset.signals if k.startswith("der(") and k.count("(") == 1] or list(dataset.signals)[:1]
    for k, name in enumerate(names):
        symbol = _symbol(dataset, _named(dataset, name[4:-1])).replace(r"\theta", r"\dot\theta")
        text = symbol if symbol.startswith("$") else f"speed of {name[4:-1].removesuffix('.phi')}"
        values = dataset.signals[name][window]
        axes.plot(*envelope(dataset.time[window], values), color=("black", GREY)[k % 2], ls=LINES[k],
                  label=text)
    component = next(iter(dataset.base.segments))
    axes.set_ylabel(f"Speed [{_pretty(dataset.base.variables[f'{component}.w'].unit)}]")


def _fitted(panels, dataset, channel, window, shown, lossless):
    """An output measured, without losses, and by each model; below, what each model leaves."""
    axes, time = panels[0], dataset.time[window]
    if not dataset.paired:
        measured = dataset.reference(channel)[window]
        axes.plot(*envelope(time, measured), color="black", lw=1.8, label="measured")
        panels[1].axhline(0, color="black", lw=0.4)
        panels[1].set_ylabel(f"Error [{_pretty(unit_of(dataset, channel))}]")
    if lossless is not None:
        axes.plot(*envelope(time, lossless[channel][window]), color=GREY, ls=":", lw=0.9, label="without losses")
    for name, color, line, model, fit in shown:
        values = outputs(dataset, model, fit)[channel][window]
        axes.plot(*envelope(time, values), color=color, ls=line, lw=0.8, label=name)
        if not dataset.paired:
            panels[1].plot(*envelope(time, measured - values), color=color, ls=line, lw=0.5)
    axes.set_ylabel(_capital(label(dataset, channel)))


def _negative(dataset):
    """Samples where a measured motor torque is negative."""
    torques = [dataset.signals[k] for k in dataset.known if k in dataset.signals and k.endswith("tau")]
    return np.any([t < 0 for t in torques], axis=0) if torques else np.zeros(len(dataset.time), bool)


def _zones(axes, dataset, window):
    """Grey and hatched zones behind a panel."""
    time, limits = dataset.time[window], axes.get_ylim()
    axes.fill_between(time, 0, 1, where=~dataset.moving[window], transform=axes.get_xaxis_transform(), color="0.87",
                      lw=0, zorder=0, step="mid")
    where = (_negative(dataset) & dataset.moving)[window]
    if where.any():
        axes.fill_between(time, 0, 1, where=where, transform=axes.get_xaxis_transform(), facecolor="none",
                          edgecolor="0.75", hatch="////", lw=0, zorder=0, step="mid")
    axes.set_ylim(limits)


def _names(axes, dataset, window):
    """Names of the passes above a panel, while there is room for them."""
    found = [((s.start + s.stop) // 2, name) for s, name in passes(dataset) if name]
    inside = [(dataset.time[k], name) for k, name in found if window.start <= k < window.stop]
    if len(inside) <= 24:
        for time, name in inside:
            axes.text(time, 1.02, name, ha="center", va="bottom", transform=axes.get_xaxis_transform(), fontsize=8)


@_styled
def where_it_fails(dataset, model, fit, floor=None):
    """Error by manoeuvre, by branch of every segment (direct: power flows to the joint; reverse: back), and by run.

    Runs have the numbers of their order in the study. A log that has none of these is split by the sign of the speed,
    and stands as a whole where that has one sign.
    Dotted: the noise floor of each channel.

    Parameters
    ----------
    dataset : Dataset
    model : Model
    fit : Fit
    floor : dict of str to float, optional
        Noise floor of each channel.

    Returns
    -------
    matplotlib.figure.Figure
    """
    residual, index = residual_of(dataset, model, fit)
    floor = _floor(dataset, model, fit) if floor is None else floor
    panels = [(name, values) for name, values in _splits(dataset, model, fit, residual, index) if len(values) > 1]
    panels = panels or [("Log", _rmse(residual, np.full(len(index), "whole")))]
    widths = [max(3, len(values)) for _, values in panels]
    wide = PAGE if sum(widths) > 6 else COLUMN
    figure = Figure(figsize=(wide, 2.1))
    axes = np.atleast_1d(figure.subplots(1, len(panels), sharey=True, width_ratios=widths))
    for panel, (name, groups) in zip(axes, panels):
        _bars(panel, dataset, groups, floor)
        panel.set_xlabel(name)
    axes[0].set_ylabel(f"RMSE [{_units(dataset)}]")
    handles = dict(zip(*reversed(axes[0].get_legend_handles_labels())))
    names = sorted(handles, key=lambda n: n.startswith("noise"))
    figure.legend([handles[n] for n in names], names, loc="outside upper center", ncols=4)
    _titled(figure, "Where the model fails")
    return figure


def _splits(dataset, model, fit, residual, index):
    """Names of groupings and their errors."""
    if dataset.labels is not None:
        yield "Manoeuvre", _rmse(residual, dataset.labels[index].astype(str))
    split = {}
    for place, branch in branches(dataset, model, fit).items():
        groups = _rmse(residual, branch[index].astype(str))
        split.update({f"{place}\n{name}": values for name, values in groups.items() if len(groups) > 1})
    yield "Branch of segment", split
    if not dataset.averaged:
        yield "Run", _rmse(residual, dataset.run[index] + 1)
    elif not split:
        for k, place in enumerate(dataset.base.segments.values()):
            names = np.where(dataset.speeds[k, index] > 0, f"{place}\nspeed > 0", f"{place}\nspeed < 0")
            yield "Sign of the speed", _rmse(residual, names)


def _floor(dataset, model, fit):
    """Noise floor of each channel; none where a run is one sample, whose scatter nothing shows."""
    return {c: v for c, v in noise_floor(dataset, model, fit).items() if np.isfinite(v)}


def _units(dataset):
    return ", ".join(dict.fromkeys(_pretty(unit_of(dataset, c)) for c in dataset.channels))


def _rmse(residual, names):
    with _quiet():
        return {n: np.sqrt(np.mean(residual[:, names == n] ** 2, axis=1)) for n in np.unique(names)}


def _bars(axes, dataset, groups, floor):
    """One group of bars a label, one bar a channel."""
    count = len(dataset.channels)
    for k, channel in enumerate(dataset.channels):
        at = np.arange(len(groups)) + (k - (count - 1) / 2) * 0.8 / count
        axes.bar(at, [v[k] for v in groups.values()], 0.8 / count, color=("0.35", "white")[k % 2], edgecolor="black",
                 lw=0.6, hatch=HATCHES[k], label=_symbol(dataset, channel))
    for k, channel in enumerate(c for c in dataset.channels if c in floor):
        axes.axhline(floor[channel], color=TONES[k], ls=(":", "--")[k % 2], lw=1.2,
                     label=f"noise floor of {_symbol(dataset, channel)}")
    axes.set_xticks(range(len(groups)), list(groups), fontsize=6.5 if len(groups) < 14 else 5)
    margin = 0.6 if len(groups) > 2 else 1.2
    axes.set_xlim(-margin, len(groups) - 1 + margin)
    axes.tick_params(axis="x", length=0)


@_styled
def residuals(dataset, model, fit, floor=None, over=None, channel=None):
    """Residual against speed, load, angle, time since reversal and time.

    Of each kind the variable with the strongest dependence is shown. Mean and standard deviation in bins, apart for the
    two signs of the speed of the segment named in the legend; grey band: the noise floor.

    Parameters
    ----------
    dataset : Dataset
    model : Model
    fit : Fit
    floor : dict of str to float, optional
        Noise floor of each channel.
    over : str, optional
        This variable alone, as ``speed@2A``.
    channel : str, optional
        This channel alone.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    UnknownNameError
        The residual of these data cannot be drawn over that.
    """
    residual, index = residual_of(dataset, model, fit)
    floor = _floor(dataset, model, fit) if floor is None else floor
    known = explanations(dataset, model, fit, index)
    if over is not None and over not in known:
        raise UnknownNameError(f"no variable '{over}' to draw the residual over{closest(over, known)}")
    forward, name = _direction(dataset, residual, known)
    shown = _strongest(dataset, residual, known, forward) if over is None else [over]
    rows = dataset.channels if channel is None else [channel]
    count = len(shown)
    figure = Figure(figsize=(max(COLUMN, PAGE * count / 5), 1.35 * len(rows) + 0.75))
    axes = figure.subplots(len(rows), count, sharex="col", sharey="row", squeeze=False)
    for c, channel in enumerate(rows):
        for panel, variable in zip(axes[c], shown):
            _scatter(panel, known[variable], residual[dataset.channels.index(channel)], forward, floor.get(channel),
                     name)
            if c == len(rows) - 1:
                panel.set_xlabel(_capital(label(dataset, variable)))
        axes[c, 0].set_ylabel(f"Residual of {_symbol(dataset, channel)} [{_pretty(unit_of(dataset, channel))}]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    _titled(figure, "What the residual depends on")
    return figure


def _direction(dataset, residual, known):
    """Samples in which the segment whose speed matters most goes forward, and its place."""
    speeds = [n for n in known if n.startswith("speed@")]
    if not speeds:
        return np.ones(residual.shape[1], bool), ""
    best = max(speeds, key=lambda n: explained_share(known[n], residual, np.ones(residual.shape[1], bool)))
    return known[best] > 0, best.partition("@")[2]


def _strongest(dataset, residual, known, forward):
    """Of each kind of variable, the one that the residual depends on most."""
    angles = [_named(dataset, a) for a in _angles(dataset)]
    kinds = [[n for n in known if n.startswith("speed@")], [n for n in known if n.startswith("load@")],
             [n for n in known if n in angles], ["time_since_reversal"], ["time"], ["temperature"]]
    kinds = [[n for n in kind if n in known] for kind in kinds]
    shown = [max(kind, key=lambda n: explained_share(known[n], residual, forward)) for kind in kinds if kind]
    return shown[:5] or list(known)[:1]


def _scatter(axes, x, y, forward, floor, name):
    if floor is not None:
        axes.axhspan(-floor, floor, color="0.87", lw=0, zorder=0, label="noise floor")
    axes.axhline(0, color="black", lw=0.4, zorder=0)
    for k, (text, where) in enumerate(((">", forward), ("<", ~forward))):
        if where.sum() > 10:
            centre, mean, spread = binned(x[where], y[where])
            axes.errorbar(centre, mean, spread, color=(BLUE, RED)[k], ls=LINES[k], lw=0.8, marker="o^"[k], ms=2.8,
                          mfc=(BLUE, "white")[k], elinewidth=0.4,
                          label=f"speed of {name} {text} 0" if name else "all samples")
    axes.xaxis.set_major_locator(MaxNLocator(4))
    axes.yaxis.set_major_locator(MaxNLocator(5))


@_styled
def signature(dataset, before, after, key):
    """What a missing effect looks like: before and after it is added, against the variable it depends on.

    Left: root mean square of the residual. Right: what is missing at the effect's place, that is the residual's share
    in the direction of a torque there, all else as fitted with the effect; the line is the fitted effect.

    Parameters
    ----------
    dataset : Dataset
    before, after : (Model, Fit)
    key : (str, str)
        Effect and place.

    Returns
    -------
    matplotlib.figure.Figure
    """
    found = signature_values(dataset, before, after, key)
    missing = found["missing"]
    figure = Figure(figsize=(PAGE if missing else COLUMN, 2.2))
    axes = np.atleast_1d(figure.subplots(1, 2 if missing else 1))
    for c, (channel, (centre, *pair)) in enumerate(found["rmse"].items()):
        for k, (values, text) in enumerate(zip(pair, ("without the effect", "with it"))):
            axes[0].plot(centre, values, color=(RED, BLUE)[k], ls=LINES[c], marker=MARKERS[c],
                         mfc=("white", (RED, BLUE)[k])[k], label=f"{_symbol(dataset, channel)} {text}")
    axes[0].set_ylim(bottom=0)
    axes[0].set_ylabel(f"RMSE [{_units(dataset)}]")
    if missing:
        _partial(axes[1], missing)
        axes[1].set_ylabel(f"Missing {missing['kind']} of {missing['place']} [{_pretty(missing['unit'])}]")
    for panel in axes:
        panel.set_xlabel(_capital(_variable_label(dataset, found["variable"])))
        panel.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2 if panel is axes[0] else 3,
                     columnspacing=1.2)
    _titled(figure, f"What {key[0].replace('_', ' ')} at {key[1]} looks like")
    return figure


def _variable_label(dataset, variable):
    return "angle within a cycle [rad]" if variable == "cycle" else label(dataset, variable)


def _partial(axes, missing):
    axes.axhline(0, color="black", lw=0.4)
    axes.plot(missing["centre"], missing["without"], "o", color=RED, mfc="white", label="without the effect")
    axes.plot(missing["centre"], missing["effect"], "-", color="black", label="fitted effect")
    axes.plot(missing["centre"], missing["with"], "s", color=BLUE, ms=2.8, label="with it")


@_styled
def ladder(improvement, dataset):
    """Error at every step of the search, on the fitted and on the held-out passes; dotted: the noise floor.

    Parameters
    ----------
    improvement : Improvement
    dataset : Dataset

    Returns
    -------
    matplotlib.figure.Figure
    """
    steps, floor = improvement.steps, improvement.last.noise_floor
    figure = Figure(figsize=(COLUMN if len(steps) < 4 else 0.75 * PAGE, 2.3))
    axes = figure.subplots()
    at = np.arange(len(steps))
    for c, channel in enumerate(dataset.channels):
        for k, (kind, text) in enumerate((("error", "fit"), ("held_out_error", "held out"))):
            values = [getattr(s, kind).get(channel, np.nan) for s in steps]
            if np.isfinite(values).any():
                axes.plot(at + 0.06 * (c - 0.5) * (len(dataset.channels) > 1), values, color=TONES[c], ls=LINES[k],
                          marker=MARKERS[c], mfc=(TONES[c], "white")[k], zorder=3 - k, ms=(3.5, 5.5)[k],
                          label=f"{_symbol(dataset, channel)} {text}")
        if np.isfinite(floor[channel]):
            axes.axhline(floor[channel], color=TONES[c], ls=":", lw=1.0,
                         label=f"{_symbol(dataset, channel)} noise floor")
    names = ["base"] + [f"+ {s.added[0].replace('_', ' ')}\nat {s.added[1]}" for s in steps[1:]]
    axes.set_xticks(at, names, fontsize=6.5)
    axes.set_xlim(-0.4, len(steps) - 0.6)
    axes.set_ylim(0, 1.08 * axes.get_ylim()[1])
    axes.set_xlabel("Model")
    axes.set_ylabel(f"RMSE [{_units(dataset)}]")
    count = len(dataset.channels)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=count if count > 1 else 3,
                  columnspacing=1.5)
    _titled(figure, "The error, effect by effect")
    return figure


@_styled
def candidates(diagnosis, most=10, held_out=None):
    """The error that each of the best candidates would leave by itself, and what became of it.

    Full bars: on passes that were held out; hatched: expected before any refit.

    Parameters
    ----------
    diagnosis : Diagnosis
    most : int
        Candidates to show.
    held_out : dict of str to float, optional
        Error of the diagnosed model on held-out passes; without it all bars are expectations.

    Returns
    -------
    matplotlib.figure.Figure
    """
    left = {f.key: _left(diagnosis, f, held_out) for f in diagnosis.candidates}
    shown = sorted(diagnosis.candidates, key=lambda f: (not f.accepted, left[f.key][0]))[:most]
    figure = Figure(figsize=(0.75 * PAGE, 0.9 + 0.19 * max(3, len(shown))))
    axes = figure.subplots()
    for seen, text in ((True, "on held-out passes"), (False, "expected before a refit")):
        at = [k for k, f in enumerate(shown) if left[f.key][1] == seen]
        if at:
            axes.barh(at, [100 * left[shown[k].key][0] for k in at], 0.7, color=["0.25" if shown[k].accepted and seen
                      else "0.8" for k in at], edgecolor="black", lw=0.5, hatch="" if seen else "////", label=text)
    for k, f in enumerate(shown):
        axes.text(1.02, k, _fate(diagnosis, f), va="center", fontsize=6.5, transform=axes.get_yaxis_transform())
    axes.set_yticks(range(len(shown)), [f"{f.effect.replace('_', ' ')} at {f.place}" for f in shown], fontsize=7)
    axes.tick_params(axis="y", length=0)
    axes.invert_yaxis()
    axes.axvline(100, color="black", lw=0.8, ls=":")
    axes.set_xlim(0, 105)
    axes.set_xlabel("Error left with it alone [% of the error without it]")
    axes.set_ylabel("Candidate")
    _titled(figure, "What each candidate would explain")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def _left(diagnosis, finding, held_out):
    """Share of the error that a candidate leaves, over all channels, and whether held-out passes say so."""
    seen = bool(finding.held_out_error and held_out)
    before, after = (held_out, finding.held_out_error) if seen else (diagnosis.error, finding.predicted_error)
    keys = [c for c in before if c in after and before[c]]
    return (float(np.sqrt(np.mean([after[c] ** 2 / before[c] ** 2 for c in keys]))) if keys else 1.0), seen


def _fate(diagnosis, finding):
    """What became of a candidate, in a few words."""
    if finding.accepted:
        return "accepted"
    for other in diagnosis.candidates:
        if other.accepted and any((t["effect"], t["place"]) == finding.key for t in other.twins):
            return f"not to be told from {other.effect.replace('_', ' ')} at {other.place}"
    if finding.explained_by:
        return f"explained by {finding.explained_by['effect'].replace('_', ' ')} at {finding.explained_by['place']}"
    if finding.p_value >= LEVEL:
        return f"as large by chance in {chance(finding.p_value)}"
    return finding.refused or "not needed"


@_styled
def maps(dataset, model, fit, channel=None):
    """Error over the plane that it is most concentrated on: speed and load of a segment, or the two angles.

    Numbers: share of the error's energy in percent, where it is 2 and more.

    Parameters
    ----------
    dataset : Dataset
    model : Model
    fit : Fit
    channel : str, optional
        The first by default.

    Returns
    -------
    matplotlib.figure.Figure or None
        None where there is no plane to draw over.
    """
    residual, index = residual_of(dataset, model, fit)
    c = dataset.channels.index(channel) if channel else 0
    known = explanations(dataset, model, fit, index)
    found = [(pair, residual_map(known[pair[0]], known[pair[1]], residual)) for pair in planes(dataset, known)]
    if not found:
        return None
    (x, y), best = min(found, key=lambda f: half_energy(f[1]["energy"][c], f[1]["samples"]))
    figure = Figure(figsize=(COLUMN, 2.7))
    axes = figure.add_subplot()
    mesh = axes.pcolormesh(best["x"], best["y"], np.ma.masked_invalid(best["rmse"][c]), cmap="cividis", vmin=0)
    middle = [(best[a][1:] + best[a][:-1]) / 2 for a in "xy"]
    half = 0.5 * np.nanmax(best["rmse"][c])
    for (row, column), share in np.ndenumerate(100 * np.nan_to_num(best["energy"][c])):
        if share >= 2:
            axes.text(middle[0][column], middle[1][row], f"{share:.0f}", ha="center", va="center", fontsize=6,
                      color="black" if best["rmse"][c][row, column] > half else "white")
    _explained(figure, "number in a cell: its share of the error's energy in percent")
    figure.colorbar(mesh, ax=axes, label=f"RMSE of {_symbol(dataset, dataset.channels[c])} "
                                         f"[{_pretty(unit_of(dataset, dataset.channels[c]))}]")
    axes.set_xlabel(_capital(label(dataset, x)))
    axes.set_ylabel(_capital(label(dataset, y)))
    _titled(figure, f"Where the error of {_symbol(dataset, dataset.channels[c])} is")
    return figure


@_styled
def unexplained(dataset, left):
    """Where a residual that no effect explains lives: its mean over two variables.

    Numbers: share of its energy in percent with the sign of the mean, where it is 2 and more.

    Parameters
    ----------
    dataset : Dataset
    left : dict
        Of `pycosim.unexplained.unexplained`.

    Returns
    -------
    matplotlib.figure.Figure or None
        None where only one variable is known to matter.
    """
    found = left["map"]
    if found is None:
        return None
    mean, share = np.asarray(found["mean"], dtype=float), 100 * np.asarray(found["energy"], dtype=float)
    edges = [np.asarray(found[f"{a}_edges"]) for a in "xy"]
    top = np.nanmax(np.abs(mean))
    figure = Figure(figsize=(COLUMN, 2.7))
    axes = figure.add_subplot()
    mesh = axes.pcolormesh(*edges, np.ma.masked_invalid(mean), cmap="RdBu_r", vmin=-top, vmax=top)
    middle = [(e[1:] + e[:-1]) / 2 for e in edges]
    for row, line in enumerate(signed_shares(mean, share)):
        for column, text in enumerate(line):
            axes.text(middle[0][column], middle[1][row], text, ha="center", va="center", fontsize=5,
                      color="black" if abs(np.nan_to_num(mean[row, column])) < 0.6 * top else "white")
    channel = left["channel"]
    _explained(figure, "number in a cell: its share of the energy in percent,\nwith the sign of the mean")
    figure.colorbar(mesh, ax=axes, label=f"Mean residual of {_symbol(dataset, channel)} "
                                         f"[{_pretty(unit_of(dataset, channel))}]")
    axes.set_xlabel(_capital(label(dataset, found["x"])))
    axes.set_ylabel(_capital(label(dataset, found["y"])))
    _titled(figure, f"What no effect explains in {_symbol(dataset, channel)}")
    return figure


@_styled
def intervals(parameters):
    """Fitted parameters with their 95 % intervals, over the larger end of the interval.

    Crosses: at a bound, or not determined by itself.

    Parameters
    ----------
    parameters : dict
        ``parameters.json``.

    Returns
    -------
    matplotlib.figure.Figure
    """
    rows = interval_rows(parameters)
    figure = Figure(figsize=(COLUMN, 0.6 + 0.17 * max(3, len(rows))))
    axes = figure.subplots()
    for k, row in enumerate(rows):
        low, value, high = row["scaled"]
        axes.plot([low, high], [k, k], color="black", lw=0.8, marker="|", label="_interval")
        axes.plot(value, k, "o" if row["sure"] else "x", color=BLUE if row["sure"] else RED, label="_value")
    axes.set_yticks(range(len(rows)), [row["name"] for row in rows], fontsize=7)
    axes.invert_yaxis()
    axes.set_xlabel("Value over the larger end of its interval")
    axes.set_ylabel("Parameter")
    _titled(figure, "Parameters and their 95 % intervals")
    return figure


# --- files ----------------------------------------------------------------------------------------------------------


@_styled
def save(figure, folder, name):
    """Write a figure as PDF, and as PNG for a quick look.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    folder : Path
        Made where it is missing.
    name : str
        Of the files, without ending.
    """
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / f"{name}.pdf", metadata={"CreationDate": None})
    figure.set_layout_engine("none")  # laid out already
    figure.savefig(folder / f"{name}.png", dpi=170, metadata={"Software": None})


def write_comparison(folder, dataset, model, fit, other=None):
    """Figures of a comparison, into ``folder / "figures"``.

    Parameters
    ----------
    folder : Path
    dataset : Dataset
    model : Model
    fit : Fit
    other : (Model, Fit), optional
        A second model to draw over time.
    """
    folder = folder / "figures"
    floor = _floor(dataset, model, fit)
    if has_plane(dataset):
        save(manoeuvres(dataset), folder, "manoeuvres")
    if not dataset.averaged:
        save(over_time(dataset, model, fit, other), folder, "over_time")
    save(where_it_fails(dataset, model, fit, floor), folder, "where_it_fails")
    save(residuals(dataset, model, fit, floor), folder, "residuals")
    folder.mkdir(parents=True, exist_ok=True)
    write_schematic(folder / "drive_train.svg", model, **coloured(model, errors(dataset, model, fit), dataset.units))
    for channel in dataset.channels:
        figure = maps(dataset, model, fit, channel)
        if figure is not None:
            save(figure, folder, f"map_{channel}")


def write_figures(folder, dataset, improvement):
    """Figures of a search, into ``folder / "figures"``.

    Parameters
    ----------
    folder : Path
    dataset : Dataset
    improvement : Improvement
    """
    base, last = improvement.steps[0], improvement.steps[-1]
    more = len(improvement.steps) > 1
    write_comparison(folder, dataset, base.model, base.fit, (last.model, last.fit) if more else None)
    folder = folder / "figures"
    left = unexplained(dataset, improvement.last.unexplained) if improvement.last.unexplained else None
    if left is not None:
        save(left, folder, "unexplained")
    save(candidates(improvement.first, held_out=base.held_out_error), folder, "candidates")
    save(ladder(improvement, dataset), folder, "ladder")
    if more:
        for before, after in zip(improvement.steps, improvement.steps[1:]):
            name = "signature" if len(improvement.steps) == 2 else f"signature_{after.added[0]}_{after.added[1]}"
            save(signature(dataset, (before.model, before.fit), (after.model, after.fit), after.added), folder, name)
        floor = _floor(dataset, last.model, last.fit)
        save(residuals(dataset, last.model, last.fit, floor), folder, "residuals_after")

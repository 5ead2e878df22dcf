"""Descriptions of plots in; figures that a paper can print, as vector PDF with a PNG preview, out.

Every curve differs in line style or marker as well as in tone, so that print without colour stays readable.
"""

from __future__ import annotations

import math
import re
from functools import wraps

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, ScalarFormatter

from ..diagnosis.compare import errors
from ..diagnosis.dependence import noise_floor
from . import drawings, outcomes
from .plot import Area, Arrow, Band, Bars, Cells, Level, Line, Names, Spans, Text
from .schematic import coloured, write_schematic
from .values import envelope

COLUMN, PAGE = 3.46, 7.1  # width of a column and of a page [inch]
# Hues of Okabe and Ito, safe for colour-blind readers; the blue darker than theirs, to differ from the red in print
INKS = {"after": "#004C7F", "before": "#D55E00", "third": "#009E73", "muted": "#767676", "faint": "#CCCCCC",
        "ink": "black"}
MARKERS = {"circle": "o", "square": "s", "triangle": "^", "diamond": "D", "cross": "x", "tick": "|", "point": ".",
           "": ""}
DASHES = {"solid": "-", "dash": "--", "dashdot": "-.", "dot": ":", "": ""}
NAMED = 24  # names of passes that fit side by side
DOTS = 170  # an inch, in a preview
ROUNDING = 1e-9  # of its size, below which a change is none
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
            return function(*arguments, **options)
    return inner


_POWERS = (-3, 4)  # of ten, between which numbers along an upright axis are written out


class _Numbers(ScalarFormatter):
    """Plain text at the ticks, a printed power of ten beside them: mathematics at every tick is slow."""

    def __init__(self):
        super().__init__(useOffset=False)

    def get_offset(self):
        """The power of ten."""
        self.set_useMathText(True)
        try:
            return super().get_offset()
        finally:
            self.set_useMathText(False)


def _unit(unit):
    """A unit as papers print it."""
    text = unit.replace("rad/s/s", "rad/s2").replace("m/s/s", "m/s2").replace(".", r"$\,$").replace("s2", "s$^2$")
    return text.replace("degC", "°C") or "1"


def _printed(text):
    """Names as symbols: C_H, theta1."""
    text = re.sub(r"½ Δ([A-Za-z])_(\w+)", r"$\\frac{1}{2}\\Delta \1_\\mathrm{\2}$", text)
    text = re.sub(r"(?<![\w.$])([A-Za-z])_([A-Za-z0-9]+)(?![\w.}])", r"$\1_\\mathrm{\2}$", text)
    return re.sub(r"(?<![\w.])(theta|tau|omega)(\d)(?!\w)", r"$\\\1_\2$", text)


# --- marks ----------------------------------------------------------------------------------------------------------


def _line(axes, mark, name):
    look, x, y = mark.look, mark.x, mark.y
    if mark.signal:
        x, y = envelope(x, y)
    ink = INKS[look.tone]
    style = {"color": ink, "ls": DASHES[look.dash], "lw": look.width, "marker": MARKERS[look.marker],
             "mfc": "white" if look.open else ink, "label": name,
             "ms": look.width if look.marker == "point" else 3.5}
    if mark.spread is None and mark.reach is None:
        axes.plot(x, y, **style)
        return
    reach = None if mark.reach is None else np.array([x - mark.reach[0], mark.reach[1] - x])
    axes.errorbar(x, y, mark.spread, reach, elinewidth=0.5, capsize=0 if mark.reach is None else 1.5,
                  **{**style, "ls": style["ls"] or "none"})


def _bars(axes, mark, name):
    look, (k, n) = mark.look, mark.slot
    draw, size = (axes.barh, "height") if mark.across else (axes.bar, "width")
    draw(np.array(mark.at) + (k - (n - 1) / 2) * 0.8 / n, mark.values, **{size: 0.75 / n}, color=INKS[look.tone],
         edgecolor="black", lw=0.6, hatch=4 * look.hatch, label=name)


def _cells(axes, mark, _):
    colours = {"cmap": "RdBu_r", "vmin": -mark.top} if mark.signed else {"cmap": "cividis", "vmin": 0}
    axes.pcolormesh(mark.x, mark.y, np.ma.masked_invalid(mark.values), vmax=mark.top, **colours)
    middle = [(e[1:] + e[:-1]) / 2 for e in (mark.x, mark.y)]
    for (row, column), value in np.ndenumerate(np.nan_to_num(mark.values) / mark.top):
        dark = abs(value) < 0.6 if mark.signed else value > 0.5
        axes.text(middle[0][column], middle[1][row], mark.texts[row][column], ha="center", va="center", fontsize=5.5,
                  color="black" if dark else "white")


def _level(axes, mark, name):
    axes.axhline(mark.value, color=INKS[mark.look.tone], ls=DASHES[mark.look.dash], lw=mark.look.width, label=name)


def _band(axes, mark, name):
    (axes.axvspan if mark.upright else axes.axhspan)(mark.low, mark.high, color="0.87", lw=0, zorder=0, label=name)


def _spans(axes, mark, name):
    if len(mark.spans):
        begin, end = np.array(mark.spans).T
        axes.hlines(np.full(len(begin), mark.y), begin, end, color=INKS[mark.look.tone], lw=mark.look.width, label=name)


def _names(axes, mark, _):
    for x, text in zip(mark.x, mark.texts) if len(mark.x) <= NAMED else ():
        axes.text(x, mark.y, text, ha="center", va="center", fontsize=8)


def _text(axes, mark, _):
    if mark.beside:
        axes.text(1.02, mark.y, _printed(mark.text), va="center", fontsize=6.5, transform=axes.get_yaxis_transform())
        return
    axes.text(mark.x, mark.y, _printed(mark.text), color=INKS[mark.tone], ha="center", va="center", fontsize=7,
              fontweight="normal" if mark.tone == "ink" else "bold", rotation=mark.angle,
              rotation_mode="anchor", transform_rotates_text=True, zorder=6,
              bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6, "alpha": 0.85})


def _arrow(axes, mark, _):
    axes.annotate("", mark.end, mark.start, zorder=3, arrowprops={
        "arrowstyle": "-|>", "color": INKS[mark.look.tone], "lw": mark.look.width, "ls": DASHES[mark.look.dash],
        "shrinkA": 0, "shrinkB": 0})


def _area(axes, mark, _):
    axes.fill(mark.x, mark.y, color=INKS[mark.tone], alpha=0.12, lw=0)


MARKS = {Line: _line, Bars: _bars, Cells: _cells, Level: _level, Band: _band, Spans: _spans, Names: _names,
         Text: _text, Arrow: _arrow, Area: _area}


# --- panels ---------------------------------------------------------------------------------------------------------


def _panel(axes, panel):
    for mark in panel.marks:
        name = getattr(mark, "name", "")
        MARKS[type(mark)](axes, mark, f"_{name}" if not name or name in panel.told else _printed(name))
    if any(isinstance(m, (Line, Bars)) for m in panel.marks) and not (panel.y.names or panel.y.log or panel.equal):
        low, high = axes.get_ylim()
        if high - low < ROUNDING * abs(high):
            low, high = axes.set_ylim(0.0 if low > 0 else 1.5 * low, 1.5 * high if high > 0 else 0.0)
        if low < 0 < high:
            axes.axhline(0, color="black", lw=0.4, zorder=0, label="_zero")
    for axis, described, lie in ((axes.xaxis, panel.x, True), (axes.yaxis, panel.y, False)):
        _ends(axes, axis, described, lie, any(isinstance(m, Bars) for m in panel.marks))
    if panel.equal:
        axes.set_aspect("equal", adjustable="datalim")
    if panel.title:
        axes.annotate(_printed(panel.title), (1.0, 1.0), (0, 9 if _has_power(axes) else 2), "axes fraction",
                      textcoords="offset points", ha="right", va="bottom", fontsize=7)
    if any(isinstance(m, Spans) for m in panel.marks):  # rows of marks, not numbers
        axes.spines[["left", "bottom"]].set_visible(False)
        axes.tick_params(length=0, axis="both")


def _ends(axes, axis, described, lie, bars):
    """Scale, limits and ticks of an axis."""
    if described.log:
        (axes.set_xscale if lie else axes.set_yscale)("log")
    limit = axes.set_xlim if lie else axes.set_ylim
    if described.names:
        count = len(described.names)
        axis.set_ticks(range(count), list(map(_printed, described.names)), fontsize=6.5 if count < 14 else 5,
                       rotation=90 if lie and count > 13 else 0)
        axis.set_tick_params(length=0)
        margin = 1.0 if bars and lie and count < 3 else 0.6
        if described.low is None:
            limit(-margin, count - 1 + margin)
    if described.low is not None or described.high is not None:
        limit(described.low, described.high)
    if described.falling:
        axis.set_inverted(True)
    if type(axis.get_major_formatter()) is ScalarFormatter:
        axis.set_major_formatter(_Numbers())
        axis.get_major_formatter().set_powerlimits((-4, 5) if lie else _POWERS)


def _has_power(axes):
    """Whether a power of ten stands above the upright axis."""
    largest = max(map(abs, axes.get_ylim()))
    written = largest == 0 or _POWERS[0] < math.floor(math.log10(largest)) < _POWERS[1]
    return isinstance(axes.yaxis.get_major_formatter(), _Numbers) and not written


def _laid(figure, plot):
    """Axes of the panels, by column."""
    rows = max(map(len, plot.columns))
    longest = next(c for c in plot.columns if len(c) == rows)
    grid = figure.add_gridspec(rows, len(plot.columns), width_ratios=plot.widths or None,
                               height_ratios=[p.height for p in longest])
    laid = [[] for _ in plot.columns]
    for c, (column, own) in enumerate(zip(plot.columns, laid)):
        for r, _ in enumerate(column):
            above, first = own[-1] if own and not plot.apart else None, laid[0][r] if c and plot.aligned else None
            place = grid[r if len(column) > 1 else slice(None), c]
            own.append(figure.add_subplot(place, sharex=above, sharey=first))
    return laid


def _ticks(axes, plot, height):
    """Few ticks where there is little room."""
    for axis, room in ((axes.xaxis, plot.width / len(plot.columns)), (axes.yaxis, height)):
        if isinstance(axis.get_major_formatter(), _Numbers) and axis.get_scale() == "linear" and room < 1:
            axis.set_major_locator(MaxNLocator(4))


def _legend(place, axes, title="", width=0.0, **where):
    """What is named in some axes, each name once, with a title above."""
    named = {}
    for a in axes:
        for handle, name in zip(*a.get_legend_handles_labels()):
            named.setdefault(name, handle)
    if named:
        longest = max(len(re.sub(r"\\mathrm|[${}_\\]", "", n)) for n in named)
        columns = int(np.clip(width / (0.55 + 0.052 * longest), 1, len(named)))
        columns = -(-len(named) // -(-len(named) // columns))
        legend = place.legend(named.values(), named, ncols=columns, columnspacing=1.4, **where)
        if title:
            legend.set_title(title, prop={"size": 8.5, "weight": "bold"})
    return bool(named)


@_styled
def figure(plot):
    """Draw a plot for print.

    Parameters
    ----------
    plot : Plot or None
        Described without a library, as of `drawings`.

    Returns
    -------
    matplotlib.figure.Figure or None
        None where there is no plot.
    """
    if plot is None:
        return None
    wide = COLUMN + (PAGE - COLUMN) * (min(plot.width, 2) - 1)
    drawn = Figure(figsize=(max(COLUMN, wide), plot.height))
    laid = _laid(drawn, plot)
    above, mesh = [], None
    for c, (column, panels) in enumerate(zip(laid, plot.columns)):
        for axes, panel in zip(column, panels):
            _panel(axes, panel)
            _ticks(axes, plot, plot.height * panel.height / sum(p.height for p in panels) / 1.6)
            first, last = not plot.aligned or c == 0, plot.apart or panel is panels[-1]
            axes.set(ylabel=_printed(panel.y.label(_unit)) if first else "",
                     xlabel=_printed(panel.x.label(_unit)) if last else "")
            axes.tick_params(labelbottom=last, labelleft=first)
            mesh = axes.collections[0] if any(isinstance(m, Cells) for m in panel.marks) else mesh
            if panel.legend:
                _own_legend(axes, wide / len(laid), len(laid) > 1)
            else:
                above.append(axes)
            if any(isinstance(m, Line) and m.signal for p in panels for m in p.marks):
                axes.margins(x=0)
    drawn.align_ylabels()
    title = _printed(plot.title)
    if not _legend(drawn, above, title, wide, loc="outside upper center") and title:
        drawn.suptitle(title, size=8.5, weight="bold")
    if plot.note:
        drawn.supxlabel(plot.note, fontsize=6.5)
    if mesh is not None:
        colour = next(m for p in plot.panels for m in p.marks if isinstance(m, Cells)).colour
        drawn.colorbar(mesh, ax=[a for column in laid for a in column], label=_printed(colour.label(_unit)))
    return drawn


def _own_legend(axes, width, crowded):
    """What a panel names: above it where others are beside it, else on its right."""
    where = ({"loc": "lower center", "bbox_to_anchor": (0.5, 1.0)} if crowded else
             {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.0})
    _legend(axes, [axes], width=width if crowded else 0, **where)


# --- files ----------------------------------------------------------------------------------------------------------


@_styled
def save(plot, folder, name, forms=("pdf", "png")):
    """Draw a plot as PDF, and as PNG for a quick look.

    Parameters
    ----------
    plot : Plot or None
        Nothing is written where there is none.
    folder : Path
        Made where it is missing.
    name : str
        Of the files, without ending.
    forms : sequence of str
        Their endings.
    """
    if plot is None:
        return
    folder.mkdir(parents=True, exist_ok=True)
    drawn = figure(plot)
    for form in forms:
        drawn.savefig(folder / f"{name}.{form}", dpi=DOTS,
                      metadata={"CreationDate": None} if form == "pdf" else {"Software": None})
        drawn.set_layout_engine("none")  # laid out already


def write_comparison(folder, dataset, model, fit, other=None, save=save):
    """Figures of a comparison, into ``folder / "figures"``.

    Parameters
    ----------
    folder : Path
        There already; ``figures/`` is made in it.
    dataset : Dataset
        Its samples are drawn.
    model : Model
        That was fitted.
    fit : Fit
        Of that model.
    other : (Model, Fit), optional
        A second model to draw over time.
    save : callable, optional
        Draws a plot; as `save`, or what has another process do so.
    """
    folder, floor = folder / "figures", noise_floor(dataset, model, fit)
    folder.mkdir(parents=True, exist_ok=True)
    save(drawings.manoeuvres(dataset), folder, "manoeuvres")
    if not dataset.averaged:
        models = [(model, fit), other] if other else [(model, fit)]
        window = drawings.worst_window(dataset, model, fit)
        save(drawings.timeline(dataset, models, window=window), folder, "over_time")
    save(drawings.where_it_fails(dataset, model, fit, floor), folder, "where_it_fails")
    save(drawings.residuals(dataset, model, fit, floor), folder, "residuals")
    write_schematic(folder / "drive_train.svg", model, **coloured(model, errors(dataset, model, fit), dataset.units))
    for plot in drawings.first_maps(dataset, model, fit):
        save(plot, folder, f"map_{plot.channel}")


def write_figures(folder, dataset, improvement, save=save):
    """Figures of a search, into ``folder / "figures"``.

    Parameters
    ----------
    folder : Path
        There already; ``figures/`` is made in it.
    dataset : Dataset
        Its samples are drawn.
    improvement : Improvement
        Its steps and its last diagnosis are drawn.
    save : callable, optional
        As of `write_comparison`.
    """
    steps, found = improvement.steps, improvement.last
    base, last = steps[0], steps[-1]
    more = len(steps) > 1
    write_comparison(folder, dataset, base.model, base.fit, (last.model, last.fit) if more else None, save)
    folder = folder / "figures"
    save(drawings.unexplained(dataset, found.unexplained), folder, "unexplained")
    save(outcomes.candidates(improvement.first, held_out=base.held_out_error), folder, "candidates")
    save(outcomes.ladder(dataset.units, steps, found.noise_floor), folder, "ladder")
    for before, after in zip(steps, steps[1:]):
        name = "signature" if len(steps) == 2 else f"signature_{after.added[0]}_{after.added[1]}"
        plot = drawings.signature(dataset, (before.model, before.fit), (after.model, after.fit), after.added)
        save(plot, folder, name)
    if more:
        floor = noise_floor(dataset, last.model, last.fit)
        save(drawings.residuals(dataset, last.model, last.fit, floor), folder, "residuals_after")

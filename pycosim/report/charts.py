"""Descriptions of plots in; charts for a browser, as Plotly takes them, out.

Traces and layouts are plain dicts. Their colours are names (``@ink``), which whoever shows a chart replaces by those of
a light or a dark theme.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass, field, replace

import numpy as np

from .plot import Area, Arrow, Band, Bars, Cells, Level, Line, Names, Spans, Text
from .values import envelope

# every pair of ink and paper has a contrast of 4.5 and more; hues as of Okabe and Ito
THEMES = {
    "light": {"@ink": "#1b1f24", "@muted": "#5d6670", "@grid": "#dfe3e8", "@paper": "#ffffff", "@before": "#b04a00",
              "@after": "#005a94", "@third": "#00684c"},
    "dark": {"@ink": "#e8eaed", "@muted": "#a3adb8", "@grid": "#3a424b", "@paper": "#15181c", "@before": "#ff9d5c",
             "@after": "#6fb9f2", "@third": "#56cfa5"},
}
BUCKETS = 10000  # in which a long signal keeps its smallest and its largest value
SHOWN = 2000  # of these, drawn at once
DIGITS = 7  # of a number in a list
ROOM = 40  # names of passes that fit side by side
INCH = 150  # px of a screen for an inch of a figure
THICK = 1.2  # px of a thin line
MARKERS = {"circle": "circle", "square": "square", "triangle": "triangle-up", "diamond": "diamond", "cross": "x",
           "tick": "line-ns", "point": "circle"}


@dataclass
class Chart:
    """One chart.

    Attributes
    ----------
    id : str
        Name of the element on the page, and of its file of numbers.
    title : str
        Above the chart.
    caption : str
        What it shows, in words that stand for it where it cannot be seen.
    traces : list of dict
        Values as NumPy arrays or lists.
    layout : dict
        Plotly's, without colours of a scheme.
    choice : str
        Its name among those of the same title, of which one is shown at a time.
    over : tuple of str
        Variables that it is drawn over, as ``speed@2A``.
    channel : str
        What it shows.
    """

    id: str
    title: str
    caption: str
    traces: list
    layout: dict = field(default_factory=dict)
    choice: str = ""
    over: tuple = ()
    channel: str = ""

    def columns(self):
        """What is drawn, as columns.

        Returns
        -------
        dict of str to ndarray or list
            By the names of trace and axis; of different lengths.
        """
        found = {}
        for k, trace in enumerate(self.traces):
            name = trace.get("name") or f"trace {k + 1}"
            for axis in ("x", "y", "z", "text"):
                if axis in trace and not isinstance(trace[axis], str):
                    key = f"{name}: {axis}"
                    found[key if key not in found else f"{name} ({k + 1}): {axis}"] = np.ravel(
                        np.asarray(trace[axis], dtype=object))
        return found

    def themed(self, theme):
        """The chart in the colours of a theme.

        Parameters
        ----------
        theme : str
            ``light`` or ``dark``.

        Returns
        -------
        dict
            ``data`` and ``layout`` for Plotly.
        """
        return _painted(encoded({"data": self.traces, "layout": {**base_layout(), **self.layout}}), THEMES[theme])


def base_layout():
    """What every chart's layout starts from.

    Returns
    -------
    dict
    """
    return {"font": {"color": "@ink", "size": 12, "family": "system-ui, sans-serif"}, "paper_bgcolor": "@paper",
            "plot_bgcolor": "@paper", "margin": {"l": 64, "r": 16, "t": 36, "b": 48}, "height": 340,
            "legend": {"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0}, "hovermode": "closest",
            "hoverlabel": {"bgcolor": "@paper", "font": {"color": "@ink"}, "bordercolor": "@muted"}}


def _painted(value, colours):
    if isinstance(value, dict):
        return {k: v if k == "bdata" else _painted(v, colours) for k, v in value.items()}
    if isinstance(value, list):
        return [_painted(v, colours) for v in value]
    return colours.get(value, value) if isinstance(value, str) else value


def encoded(value):
    """A chart's values as JSON holds them: long arrays as Plotly's binary text, NaN in lists as null.

    Parameters
    ----------
    value : object
        Of a figure of Plotly; arrays of NumPy at any depth.

    Returns
    -------
    dict, list, str, bool, int, float or None
    """
    if isinstance(value, dict):
        return {k: encoded(v) for k, v in value.items()}
    if isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind == "f" and value.size > 64:
        data = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        return {"dtype": data.dtype.str[1:], "bdata": base64.b64encode(data.tobytes()).decode()}
    if isinstance(value, np.ndarray):
        return encoded(value.tolist())
    if isinstance(value, (list, tuple)):
        return [encoded(v) for v in value]
    if isinstance(value, (float, np.floating)):
        return float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value


def packed(signal, wide=False):
    """A long signal in a few bytes a sample: whole steps of its range, which no screen can tell from the numbers.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        NaN where there is no value.
    wide : bool
        Steps of a 2^31st of the range, as differences from sample to sample (for time); else of a 65,000th.

    Returns
    -------
    dict
        ``steps`` (base64), ``wide``, ``low`` and ``step``: value = low + step * steps; the least integer is NaN.
    """
    known = signal[np.isfinite(signal)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    most = 2 ** 31 - 2 if wide else 2 ** 16 - 3
    step = (high - low) / most or 1.0
    whole = np.rint((np.nan_to_num(signal, nan=low) - low) / step).astype(np.int64)
    if wide:
        data = np.diff(whole, prepend=0).astype("<i4")
    else:
        data = np.where(np.isfinite(signal), whole - 2 ** 15 + 1, -2 ** 15).astype("<i2")
        low += step * (2 ** 15 - 1)
    return {"steps": base64.b64encode(data.tobytes()).decode(), "wide": wide, "low": low, "step": step}


def _axis(described, **more):
    """Plotly's words for an axis."""
    made = {"title": {"text": _lines(described.label()), "standoff": 6}, "gridcolor": "@grid", "linecolor": "@muted",
            "zerolinecolor": "@muted", "ticks": "outside", "tickcolor": "@muted", "automargin": True, **more}
    if described.low is not None and described.high is not None:
        made["range"] = [described.low, described.high]
    elif described.low == 0:
        made["rangemode"] = "tozero"
    if described.names and described.low is not None:  # rows of marks
        made |= {"tickvals": list(range(len(described.names))), "ticktext": list(described.names), "fixedrange": True,
                 "showgrid": False, "zeroline": False}
    elif described.names:
        made |= {"type": "category", "categoryorder": "array", "categoryarray": list(map(_lines, described.names))}
    if described.log:
        made["type"] = "log"
    if described.falling:
        made["autorange"] = "reversed"
    return made


def _lines(text):
    return text.replace("\n", "<br>")


def _placed(numbers, described):
    """Values along an axis: names where it has such."""
    if described.names and described.low is None:
        return [_lines(described.names[int(k)]) for k in numbers]
    return numbers


# --- marks: traces, and what a layout holds besides -----------------------------------------------------------------


def _line(mark, panel, x, y):
    look, both = mark.look, envelope(mark.x, mark.y, BUCKETS) if mark.signal else (mark.x, mark.y)
    made = {"type": "scatter", "x": _placed(both[0], panel.x), "y": _placed(both[1], panel.y), "name": mark.name,
            "mode": "+".join(word for word, there in (("lines", look.dash), ("markers", look.marker)) if there)}
    if look.dash:
        made["line"] = {"color": f"@{look.tone}", "dash": look.dash, "width": round(THICK * look.width, 2)}
    if look.marker:
        made["marker"] = {"symbol": MARKERS[look.marker] + ("-open" if look.open else ""), "color": f"@{look.tone}",
                          "size": 2 if look.marker == "point" else 8}
    if mark.signal:
        made |= {"y": both[1].astype(np.float32), "meta": "signal"}
    if mark.aside:
        made["visible"] = "legendonly"
    if mark.spread is not None:
        made["error_y"] = {"type": "data", "array": list(map(float, mark.spread)), "thickness": 0.8, "width": 2}
    if mark.reach is not None:
        low, high = mark.reach
        made["error_x"] = {"type": "data", "symmetric": False, "color": f"@{look.tone}",
                           "array": list(map(float, high - mark.x)), "arrayminus": list(map(float, mark.x - low))}
    if mark.told:
        made |= {"text": list(mark.told), "hovertemplate": "%{y}: %{text}<extra></extra>"}
    return [made], {}


def _bars(mark, panel, x, y):
    look, names = mark.look, panel.y if mark.across else panel.x
    at, sizes = _placed(mark.at, names), list(mark.values)
    made = {"type": "bar", "x": sizes if mark.across else at, "y": at if mark.across else sizes, "name": mark.name,
            "marker": {"color": "@muted" if look.tone == "faint" else f"@{look.tone}", "opacity": 0.5 if look.tone ==
                       "faint" else 1.0, "pattern": {"shape": look.hatch}}}
    return [{**made, "orientation": "h"} if mark.across else made], {"barmode": "group" if mark.slot[1] > 1 else
                                                                    "overlay"}


def _cells(mark, panel, x, y):
    centre = [((e[1:] + e[:-1]) / 2).tolist() for e in (mark.x, mark.y)]
    what = mark.colour.words.partition(" of ")[0]
    return [{"type": "heatmap", "x": centre[0], "y": centre[1], "z": mark.values.tolist(), "zmax": mark.top,
             "zmin": -mark.top if mark.signed else 0, "colorscale": "RdBu" if mark.signed else "Cividis",
             "reversescale": False, "name": mark.name, "colorbar": {"title": {"text": mark.colour.label()}},
             "text": [list(row) for row in mark.texts], "texttemplate": "%{text}", "customdata": mark.share.tolist(),
             "hovertemplate": f"%{{x:.3g}}, %{{y:.3g}}<br>{what} %{{z:.3g}}<br>%{{customdata:.1f}} % of the energy"
                              "<extra></extra>"}], {}


def _level(mark, panel, x, y):
    """A line from end to end of what else the panel holds."""
    if panel.x.names:
        ends = [_lines(n) for n in panel.x.names]
    else:
        every = np.concatenate([np.asarray(m.x, float) for m in panel.marks if isinstance(m, Line)] or [[0.0, 1.0]])
        ends = [float(np.nanmin(every)), float(np.nanmax(every))]
    return [{"type": "scatter", "mode": "lines", "x": ends, "y": [mark.value] * len(ends), "name": mark.name, "line": {
        "color": f"@{mark.look.tone}", "dash": mark.look.dash, "width": round(THICK * mark.look.width, 2)}}], {}


def _band(mark, panel, x, y):
    across = {"xref": f"{x} domain", "x0": 0, "x1": 1, "yref": y, "y0": mark.low, "y1": mark.high}
    upright = {"yref": f"{y} domain", "y0": 0, "y1": 1, "xref": x, "x0": mark.low, "x1": mark.high}
    return [], {"shapes": [{"type": "rect", "layer": "below", "fillcolor": "@grid", "line": {"width": 0}, "name":
                            mark.name, **(upright if mark.upright else across)}]}


def _spans(mark, panel, x, y):
    at = [v for a, b in mark.spans for v in (float(a), float(b), None)]
    rows = [None if v is None else mark.y for v in at]
    return [{"type": "scatter", "mode": "lines", "x": at, "y": rows, "name": mark.name, "connectgaps": False,
             "line": {"color": f"@{mark.look.tone}", "width": 2.2 * mark.look.width}, "hoverinfo": "name"}], {}


def _names(mark, panel, x, y):
    return [{"type": "scatter", "mode": "text", "x": list(mark.x), "y": [mark.y] * len(mark.x), "text":
             list(mark.texts), "name": mark.name, "showlegend": False, "textfont": {"color": "@ink"}, "meta": "names",
             "hoverinfo": "text"}], {}


def _text(mark, panel, x, y):
    place = ({"x": 1.01, "xref": f"{x} domain", "xanchor": "left"} if mark.beside else {"x": float(mark.x), "xref": x})
    return [], {"annotations": [{**place, "y": float(mark.y), "yref": y, "text": mark.text, "showarrow": False,
                                 "textangle": -mark.angle, "font": {"color": f"@{mark.tone}"}}]}


def _arrow(mark, panel, x, y):
    (ax, ay), (bx, by) = mark.start, mark.end
    return [], {"annotations": [{"x": float(bx), "y": float(by), "ax": float(ax), "ay": float(ay), "xref": x,
                                 "yref": y, "axref": x, "ayref": y, "text": "", "showarrow": True, "arrowhead": 2,
                                 "arrowcolor": f"@{mark.look.tone}", "arrowwidth": 1.5}]}


def _area(mark, panel, x, y):
    return [{"type": "scatter", "mode": "none", "fill": "toself", "fillcolor": f"@{mark.tone}", "opacity": 0.15,
             "x": list(mark.x), "y": list(mark.y), "showlegend": False, "hoverinfo": "skip", "name": "area"}], {}


MARKS = {Line: _line, Bars: _bars, Cells: _cells, Level: _level, Band: _band, Spans: _spans, Names: _names,
         Text: _text, Arrow: _arrow, Area: _area}


# --- charts ---------------------------------------------------------------------------------------------------------


def chart(plot):
    """Draw a plot for a browser.

    Parameters
    ----------
    plot : Plot or None
        Described without a library, as of `drawings`.

    Returns
    -------
    Chart or None
        None where there is no plot.
    """
    if plot is None:
        return None
    traces, layout = [], {"height": max(300, round(INCH * plot.height)), "shapes": [], "annotations": []}
    number, named = 0, set()
    for c, (panels, (left, right)) in enumerate(zip(plot.columns, _shares(plot.widths or [1] * len(plot.columns)))):
        tops = _shares([p.height for p in panels], 0.1 if plot.apart else 0.024)
        for panel, (below, above) in zip(panels, [(1 - b, 1 - a) for a, b in tops]):
            number += 1
            x, y = (f"{a}{k if k > 1 else ''}" for a, k in (("x", number if plot.apart else c + 1), ("y", number)))
            _panel(panel, x, y, traces, layout, named)
            kept = {"constrain": "domain"} if panel.equal else {}
            layout[f"yaxis{y[1:]}"] = _axis(panel.y, domain=[below, above], anchor=x, **kept, **(
                {"scaleanchor": x} if panel.equal else {}))
            layout[f"xaxis{x[1:]}"] = _axis(panel.x, domain=[left, right], anchor=y, **kept)
    if len(plot.columns) == 2 and number == 2:
        layout["meta"] = "pair"  # one below the other on a narrow screen
    if any(isinstance(m, Cells) for p in plot.panels for m in p.marks):
        for trace in traces[:-1]:
            trace["showscale"] = False
    layout |= {"dragmode": "zoom"} if any(t.get("meta") == "signal" for t in traces) else {}
    caption = plot.caption + _thinned(plot)
    return Chart(plot.id, plot.title, caption, traces, layout, plot.choice, plot.over, plot.channel)


def _panel(panel, x, y, traces, layout, named):
    """Add what a panel holds; a name stands once in the legend, and not where it stands at its mark."""
    told = panel.told
    for mark in panel.marks:
        made, more = MARKS[type(mark)](mark, panel, x, y)
        for trace in made:
            trace |= {k: v for k, v in (("xaxis", x), ("yaxis", y)) if len(v) > 1}
            if trace["type"] != "heatmap" and "showlegend" not in trace:
                trace |= {"legendgroup": mark.name, "showlegend": bool(mark.name) and mark.name not in named | told}
                named.add(mark.name)
        for shape in more.get("shapes", ()):
            shape["showlegend"] = bool(mark.name) and mark.name not in named
            named.add(mark.name)
        traces += made
        for key, value in more.items():
            layout[key] = [*layout[key], *value] if isinstance(value, list) else value
    if panel.title:
        layout["annotations"].append({"text": panel.title, "xref": f"{x} domain", "yref": f"{y} domain", "x": 0.5,
                                      "y": 1.0, "yanchor": "bottom", "showarrow": False, "font": {"color": "@ink"}})


def _shares(sizes, gap=0.08):
    """Where parts of these sizes begin and end, from 0 to 1, with gaps between."""
    ends = np.concatenate([[0], np.cumsum(np.asarray(sizes, float) / sum(sizes))])
    return [(float(a + (gap / 2 if k else 0)), float(b - (gap / 2 if k < len(sizes) - 1 else 0)))
            for k, (a, b) in enumerate(zip(ends[:-1], ends[1:]))]


def _thinned(plot):
    """What became of long signals, in words."""
    n = max((len(m.x) for p in plot.panels for m in p.marks if isinstance(m, Line) and m.signal), default=0)
    if not n:
        return ""
    return " Drag to zoom, double-click to see all; " + (
        f"each point is the smallest or the largest of {-(-n // BUCKETS)} samples, so that no peak is lost."
        if n > 2 * BUCKETS else "every sample is kept.")


def zoomed(chart, window=None):
    """A chart over time with no more points than a screen shows, extremes kept.

    Parameters
    ----------
    chart : Chart
        One whose signals share the first axis.
    window : (float, float), optional
        Times to show [s]; all by default.

    Returns
    -------
    Chart
    """
    begin, end = window or (-np.inf, np.inf)
    traces = []
    for trace in chart.traces:
        if trace.get("meta") == "signal":
            a, b = np.searchsorted(trace["x"], [begin, end])
            part = slice(max(0, a - 2), b + 2)
            x, y = envelope(trace["x"][part], trace["y"][part], SHOWN)
            trace = {**trace, "x": x, "y": y}
        elif trace.get("meta") == "names" and sum(begin <= t <= end for t in trace["x"]) > ROOM:
            trace = {**trace, "mode": "markers", "marker": {"size": 3, "color": "@muted"}}
        traces.append(trace)
    axis_ = {**chart.layout["xaxis"], **({"range": list(window), "autorange": False} if window else {})}
    return replace(chart, traces=traces, layout={**chart.layout, "xaxis": axis_})

"""Data set, fitted models and results in; charts for a browser, as Plotly takes them, out.

Traces and layouts are plain dicts. Their colours are names (``@ink``), which whoever shows a chart replaces by those of
a light or a dark theme. What differs in colour differs in dash, marker or width as well, and cells carry numbers.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass, field, replace

import numpy as np

from ..diagnosis.compare import branches, unit_of, worded
from . import values

# every pair of ink and paper has a contrast of 4.5 and more; hues as of Okabe and Ito
THEMES = {
    "light": {"@ink": "#1b1f24", "@muted": "#5d6670", "@grid": "#dfe3e8", "@paper": "#ffffff", "@before": "#b04a00",
              "@after": "#005a94", "@third": "#00684c"},
    "dark": {"@ink": "#e8eaed", "@muted": "#a3adb8", "@grid": "#3a424b", "@paper": "#15181c", "@before": "#ff9d5c",
             "@after": "#6fb9f2", "@third": "#56cfa5"},
}
LOOKS = ({"color": "@before", "dash": "dot", "width": 1.4}, {"color": "@after", "dash": "solid", "width": 1.4})
NAMES = "base model", "improved model"
BUCKETS = 10000  # in which a long signal keeps its smallest and its largest value
SHOWN = 2000  # of these, drawn at once
DIGITS = 7  # of a number in a list
ROOM = 40  # names of passes that fit side by side


@dataclass
class Chart:
    """One chart.

    Attributes
    ----------
    id : str
    title : str
    caption : str
        What it shows, in words that stand for it where it cannot be seen.
    traces : list of dict
        Values as NumPy arrays or lists.
    layout : dict
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


def axis(title, **more):
    """An axis with a title.

    Parameters
    ----------
    title : str
    **more
        Further settings of Plotly's.

    Returns
    -------
    dict
    """
    return {"title": {"text": title, "standoff": 6}, "gridcolor": "@grid", "zerolinecolor": "@muted",
            "linecolor": "@muted", "ticks": "outside", "tickcolor": "@muted", "automargin": True, **more}


def label(dataset, name):
    """A channel or variable in words, with its unit.

    Parameters
    ----------
    dataset : Dataset
    name : str

    Returns
    -------
    str
        As ``speed of 2A [rad/s]``.
    """
    if name == "cycle":
        return "angle within a cycle [rad]"
    unit = unit_of(dataset, name)
    words = f"½ Δ{name[:-5]}" if name.endswith("_pair") else worded(name)
    return words if unit in ("1", "") else f"{words} [{unit}]"


def channel_name(channel):
    """A channel in words: pairs are half a difference.

    Parameters
    ----------
    channel : str

    Returns
    -------
    str
    """
    return f"half the difference of {channel[:-5]}, out and back" if channel.endswith("_pair") else channel


# --- over time ------------------------------------------------------------------------------------------------------


def timeline(dataset, models, names=NAMES):
    """Model against measurement over the whole log: speeds, every channel, what each model leaves, and marks.

    Parameters
    ----------
    dataset : Dataset
    models : list of (Model, Fit)
        One or two.
    names : sequence of str
        What the models are called.

    Returns
    -------
    Chart
    """
    time = values.clock(dataset)
    rows = ["speeds"] + [f"{kind}:{c}" for c in dataset.channels
                         for kind in (("residual",) if dataset.paired else ("value", "residual"))]
    heights = np.array([1.0] + [1.5 if r.startswith("value") else 1.0 for r in rows])
    tops = 1 - np.concatenate([[0], np.cumsum(heights / heights.sum())])
    domains = [[float(low + 0.012), float(high - 0.012)] for high, low in zip(tops[:-1], tops[1:])]
    marks, rows_of_marks = _marks(dataset, models[-1], time)
    layout = {"height": int(150 * heights.sum()), "xaxis": axis("time [s]", anchor=f"y{len(heights)}"),
              "legend": {"orientation": "h", "y": 1.0, "yanchor": "bottom"}, "dragmode": "zoom",
              "yaxis": axis("", domain=domains[0], tickvals=list(range(len(rows_of_marks))), ticktext=rows_of_marks,
                            fixedrange=True, range=[-0.7, len(rows_of_marks) - 0.3], showgrid=False, zeroline=False)}
    traces = marks
    for k, row in enumerate(rows, 2):
        kind, _, channel = row.partition(":")
        traces += _row(dataset, models, names, time, kind, channel, f"y{k}")
        unit = unit_of(dataset, channel) if channel else dataset.base.along("rad/s")
        short = channel.removesuffix("_pair")
        title = {"speeds": "speed", "value": short, "residual": f"error {short}"}[kind]
        layout[f"yaxis{k}"] = axis(f"{title} [{unit}]", domain=domains[k - 1])
    n = len(time)
    kept = (f"each point is the smallest or the largest of {-(-n // BUCKETS)} samples, so that no peak is lost"
            if n > 2 * BUCKETS else "every sample is kept")
    caption = (f"Measured and modelled {', '.join(map(channel_name, dataset.channels))} over {time[-1]:.4g} s, {n} "
               f"samples; {kept}. Drag to zoom, double-click to see all. Marks on top: manoeuvres, passes held out of "
               "every fit, and the branch of each segment, thick where power flows to the joint (direct) and thin "
               "where it flows back (reverse).")
    return Chart("timeline", "Everything over time", caption, traces, layout)


def zoomed(chart, window=None):
    """A chart over time with no more points than a screen shows, extremes kept.

    Parameters
    ----------
    chart : Chart
        As `timeline` gives it.
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
            x, y = values.envelope(trace["x"][part], trace["y"][part], SHOWN)
            trace = {**trace, "x": x, "y": y}
        elif trace.get("meta") == "names" and sum(begin <= t <= end for t in trace["x"]) > ROOM:
            trace = {**trace, "mode": "markers", "marker": {"size": 3, "color": "@muted"}}
        traces.append(trace)
    axis_ = {**chart.layout["xaxis"], **({"range": list(window), "autorange": False} if window else {})}
    return replace(chart, traces=traces, layout={**chart.layout, "xaxis": axis_})


def _row(dataset, models, names, time, kind, channel, y):
    """Traces of one panel."""
    if kind == "speeds":
        speeds = [k for k in dataset.signals if k.startswith("der(") and k.count("(") == 1]
        looks = [{"color": "@ink", "dash": "solid", "width": 1.2}, {"color": "@muted", "dash": "dash", "width": 1.2}]
        return [_signal(time, dataset.signals[n], y, n[4:-1].removesuffix(".phi"), k > 1, **looks[k % 2])
                for k, n in enumerate((speeds or list(dataset.signals)[:1])[:4])]
    found = []
    if kind == "value":
        found.append(_signal(time, dataset.reference(channel), y, "measured", channel == dataset.channels[0],
                             color="@ink", width=2.4))
    for k, (model, fit) in enumerate(models):
        signal = (values.outputs(dataset, model, fit)[channel] if kind == "value"
                  else values.residual_over_time(dataset, model, fit)[channel])
        first = channel == dataset.channels[0] and (kind == "value" or dataset.paired)
        found.append(_signal(time, signal, y, names[k], first, **LOOKS[k]))
    return found


def _signal(time, signal, y, name, legend, **line):
    t, v = values.envelope(time, signal, BUCKETS)
    return {"type": "scatter", "mode": "lines", "x": t, "y": v.astype(np.float32), "yaxis": y, "name": name,
            "legendgroup": name, "showlegend": bool(legend), "line": line, "meta": "signal"}


def _marks(dataset, best, time):
    """Traces of the marks, and the names of their rows, from below."""
    shortest, rows, traces = time[-1] / 4000, [], []
    found = {place: branch for place, branch in branches(dataset, *best).items()}
    for place in reversed(list(found)):
        codes = np.where(dataset.moving, found[place], "")
        spans = values.stretches(time, codes, shortest)
        for name, width, colour in (("direct", 9, "@third"), ("reverse", 3, "@muted")):
            traces.append(_bars_over_time([s for s in spans if s[2] == name], len(rows), name, width, colour,
                                          place == next(iter(found))))
        rows.append(f"branch {place}")
    if dataset.is_test.any():
        held = dataset.moving & (dataset.block >= 0) & dataset.is_test[dataset.block]
        spans = [s for s in values.stretches(time, held, shortest) if s[2]]
        traces.append(_bars_over_time(spans, len(rows), "held out", 9, "@ink", False))
        rows.append("held out")
    named = [(s, n) for s, n in values.passes(dataset) if n]
    if named:
        traces.append({"type": "scatter", "mode": "text", "x": [float(time[(s.start + s.stop) // 2]) for s, _ in named],
                       "y": [len(rows)] * len(named), "text": [n for _, n in named], "name": "manoeuvre",
                       "showlegend": False, "textfont": {"color": "@ink"}, "meta": "names", "hoverinfo": "text"})
        rows.append("manoeuvre")
    if len(dataset.logs) > 1:
        spans = values.stretches(time, dataset.run)
        traces.append({"type": "scatter", "mode": "text", "x": [(a + b) / 2 for a, b, _ in spans],
                       "y": [len(rows)] * len(spans), "text": [dataset.logs[int(r)].name for *_, r in spans],
                       "name": "run", "showlegend": False, "meta": "names", "hoverinfo": "text"})
        rows.append("run")
    return traces, rows


def _bars_over_time(spans, row, name, width, colour, legend):
    x = [v for a, b, _ in spans for v in (a, b, None)]
    return {"type": "scatter", "mode": "lines", "x": x, "y": [v and row for v in [1, 1, None] * len(spans)] if row else
            [None if v is None else 0 for v in [1, 1, None] * len(spans)], "name": name, "legendgroup": name,
            "showlegend": legend, "line": {"color": colour, "width": width}, "connectgaps": False, "hoverinfo": "name"}


# --- where ----------------------------------------------------------------------------------------------------------


def groups(dataset, models, floor, names=NAMES):
    """Error by manoeuvre, by branch and by run, of each model.

    Parameters
    ----------
    dataset : Dataset
    models : list of (Model, Fit)
    floor : dict of str to float
        Noise floor of each channel.
    names : sequence of str

    Returns
    -------
    list of Chart
        Those with more than one group.
    """
    splits, codes_of = {}, None
    for k, (model, fit) in enumerate(models):
        residual, index, _ = values.sampled(dataset, model, fit)
        codes_of = codes_of or list(_codes(dataset, *models[0], index))
        for name, codes in codes_of:
            for group in np.unique(codes):
                where = codes == group
                splits.setdefault(name, {}).setdefault(k, {})[group] = np.sqrt(np.mean(residual[:, where] ** 2, axis=1))
    charts = []
    for name, found in splits.items():
        if len(found[0]) < 2:
            continue
        for c, channel in enumerate(dataset.channels):
            traces = [{"type": "bar", "x": list(g), "y": [float(v[c]) for v in g.values()], "name": names[k],
                       "marker": {"color": LOOKS[k]["color"], "pattern": {"shape": ("/", "")[k]}}}
                      for k, g in found.items()]
            layout = {"xaxis": axis(name, type="category"), "yaxis": axis(f"RMSE {label(dataset, channel)}"),
                      "barmode": "group"}
            if floor.get(channel) is not None and np.isfinite(floor[channel]):
                traces.append({"type": "scatter", "mode": "lines", "x": list(found[0]),
                               "y": [floor[channel]] * len(found[0]),
                               "name": "noise floor", "line": {"color": "@ink", "dash": "dash", "width": 1.5}})
            worst = max(found[0], key=lambda g: found[0][g][c])
            charts.append(Chart(f"{name}_{channel}".replace(" ", "_"), "Error by group",
                                f"Error of {channel_name(channel)} by {name}; of the {names[0]} it is largest "
                                f"for {worst}.", traces, layout, f"{channel} by {name}", (name,), channel))
    return charts


def _codes(dataset, model, fit, index):
    """Names of groupings, and the group of every sample."""
    if dataset.labels is not None:
        yield "manoeuvre", dataset.labels[index].astype(str)
    for place, branch in branches(dataset, model, fit).items():
        yield f"branch of {place}", branch[index].astype(str)
    if len(dataset.logs) > 1:
        yield "run", np.array([log.name for log in dataset.logs])[dataset.run[index]]


def maps(dataset, models, names=NAMES):
    """Error of each channel over speed and load of each segment, and over the angles, of each model.

    Parameters
    ----------
    dataset : Dataset
    models : list of (Model, Fit)
    names : sequence of str

    Returns
    -------
    list of Chart
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
    return [chart for _, chart in sorted(found, key=lambda f: f[0])]


def _map(dataset, channel, c, plane, each, half, names):
    top = max(float(np.nanmax(m["rmse"][c])) for m in each)
    traces, layout = [], {"height": 400, "annotations": [], "meta": "pair" if len(each) == 2 else "one"}
    for k, m in enumerate(each):
        axes = "" if k == 0 else "2"
        centre = [(m[a][1:] + m[a][:-1]) / 2 for a in "xy"]
        share = 100 * m["energy"][c]
        traces.append({
            "type": "heatmap", "x": centre[0].tolist(), "y": centre[1].tolist(), "z": m["rmse"][c].tolist(), "zmin": 0,
            "zmax": top, "colorscale": "Cividis", "xaxis": f"x{axes}", "yaxis": f"y{axes}", "name": names[k],
            "showscale": k == len(each) - 1, "colorbar": {"title": {"text": f"RMSE [{unit_of(dataset, channel)}]"}},
            "text": [[f"{v:.0f}" if v >= 2 else "" for v in np.nan_to_num(row)] for row in share],
            "texttemplate": "%{text}", "customdata": np.nan_to_num(share).tolist(), "hovertemplate":
            "%{x:.3g}, %{y:.3g}<br>RMSE %{z:.3g}<br>%{customdata:.1f} % of the energy<extra></extra>"})
        low, high = ((0.0, 0.46), (0.54, 1.0))[k] if len(each) == 2 else (0.0, 1.0)
        layout[f"xaxis{axes}"] = axis(label(dataset, plane[0]), domain=[low, high], anchor=f"y{axes}", showgrid=False)
        layout[f"yaxis{axes}"] = axis(label(dataset, plane[1]) if k == 0 else "", anchor=f"x{axes}", showgrid=False)
        layout["annotations"].append({"text": names[k], "xref": "paper", "yref": "paper", "x": (low + high) / 2,
                                      "y": 1.0, "yanchor": "bottom", "showarrow": False, "font": {"color": "@ink"}})
    words = f"{worded(plane[0])} and {worded(plane[1])}"
    caption = (f"Error of {channel_name(channel)} over {words}. Colour: its RMS in a cell. Number: the cell's share of "
               f"the error's energy, in percent. Half of that of the {names[0]} lies in {100 * half:.0f} % of the "
               "samples.")
    return Chart(f"map_{channel}_{'_'.join(plane)}".replace("@", "_"), "Where the error is", caption, traces, layout,
                 f"{channel} over {words}", tuple(plane), channel)


def unexplained(dataset, left):
    """Where a residual that no effect explains lives: its mean over two variables, and how much of its energy.

    Parameters
    ----------
    dataset : Dataset
    left : dict
        Of `pycosim.unexplained.unexplained`.

    Returns
    -------
    Chart or None
        None where only one variable is known to matter.
    """
    found = left["map"]
    if found is None:
        return None
    centre = [(np.asarray(found[f"{a}_edges"])[1:] + np.asarray(found[f"{a}_edges"])[:-1]) / 2 for a in "xy"]
    mean, share = np.asarray(found["mean"], dtype=float), 100 * np.asarray(found["energy"], dtype=float)
    top, unit = float(np.nanmax(np.abs(mean))), unit_of(dataset, left["channel"])
    trace = {"type": "heatmap", "x": centre[0].tolist(), "y": centre[1].tolist(), "z": mean.tolist(), "zmin": -top,
             "zmax": top, "colorscale": "RdBu", "name": "residual",
             "colorbar": {"title": {"text": f"mean [{unit}]"}}, "text": values.signed_shares(mean, share),
             "texttemplate": "%{text}", "customdata": share.tolist(), "hovertemplate":
             "%{x:.3g}, %{y:.3g}<br>mean %{z:.3g}<br>%{customdata:.1f} % of the energy<extra></extra>"}
    layout = {"height": 400, "xaxis": axis(label(dataset, found["x"]), showgrid=False),
              "yaxis": axis(label(dataset, found["y"]), showgrid=False)}
    words = f"{worded(found['x'])} and {worded(found['y'])}"
    caption = (f"Mean of what is left of {channel_name(left['channel'])} over {words}; number in a cell: its share "
               "of the energy in percent, with the sign of the mean.")
    return Chart("unexplained", "What no effect explains", caption, [trace], layout)


def profiles(dataset, models, names=NAMES, also=()):
    """Mean and spread of the residual over angles, time since reversal, temperature and time, of each model.

    Parameters
    ----------
    dataset : Dataset
    models : list of (Model, Fit)
    names : sequence of str
    also : sequence of str
        Further variables, as ``speed@2A``.

    Returns
    -------
    list of Chart
    """
    residuals = [values.sampled(dataset, *m)[0] for m in models]
    known = values.sampled(dataset, *models[0])[2]
    column = {c.variable: n for n, c in dataset.study.columns.items()}
    variables = [column.get(k, k) for k in dataset.known if k.endswith("phi")]
    variables += ["time_since_reversal", "temperature", "time"]
    charts = []
    for name in [n for n in dict.fromkeys([*also, *variables]) if n in known]:
        for c, channel in enumerate(dataset.channels):
            traces = []
            for k, residual in enumerate(residuals):
                centre, mean, spread = values.binned(known[name], residual[c])
                traces.append({"type": "scatter", "mode": "lines+markers", "x": centre, "y": mean, "name": names[k],
                               "line": LOOKS[k], "marker": {"symbol": ("circle-open", "square")[k], "size": 7},
                               "error_y": {"type": "data", "array": spread.tolist(), "thickness": 0.8, "width": 2}})
            charts.append(Chart(f"over_{name}_{channel}", "Error over one variable",
                                f"Mean and standard deviation of the error of {channel_name(channel)} in bins of "
                                f"{worded(name)}.", traces,
                                {"xaxis": axis(label(dataset, name)),
                                 "yaxis": axis(f"error {label(dataset, channel)}")},
                                f"{channel} over {worded(name)}", (name,), channel))
    return charts


# --- which ----------------------------------------------------------------------------------------------------------


def signature(dataset, before, after, key):
    """What a missing effect looks like, and the fitted effect on it.

    Parameters
    ----------
    dataset : Dataset
    before, after : (Model, Fit)
    key : (str, str)
        Effect and place.

    Returns
    -------
    Chart
    """
    found = values.signature_values(dataset, before, after, key)
    missing, x = found["missing"], label(dataset, found["variable"])
    title = f"What {key[0].replace('_', ' ')} at {key[1]} looks like"
    name = f"signature_{key[0]}_{key[1]}"
    if missing is None:
        symbols = "circle-open", "square", "diamond-open", "cross"
        traces = [{"type": "scatter", "mode": "lines+markers", "x": centre, "y": rms, "name": f"{channel} {text}",
                   "line": LOOKS[k], "marker": {"symbol": symbols[2 * c % 4 + k]}}
                  for c, (channel, (centre, *pair)) in enumerate(found["rmse"].items())
                  for k, (rms, text) in enumerate(zip(pair, ("without the effect", "with it")))]
        caption = (f"Error against {worded(found['variable'])}, without {key[0].replace('_', ' ')} at {key[1]} and "
                   "with it.")
        return Chart(name, title, caption, traces,
                     {"xaxis": axis(x), "yaxis": axis(f"RMSE [{_units(dataset)}]", rangemode="tozero")})
    centre = missing["centre"]
    traces = [{"type": "scatter", "mode": "markers", "x": centre, "y": missing["without"],
               "name": "residual without it",
               "marker": {"symbol": "circle-open", "color": "@before", "size": 8, "line": {"width": 2}}},
              {"type": "scatter", "mode": "lines", "x": centre, "y": missing["effect"], "name": "the fitted effect",
               "line": {"color": "@ink", "width": 2}},
              {"type": "scatter", "mode": "markers", "x": centre, "y": missing["with"], "name": "residual with it",
               "marker": {"symbol": "square", "color": "@after", "size": 5}}]
    caption = (f"{missing['kind'].capitalize()} that is missing at {missing['place']} against "
               f"{worded(found['variable'])}, without {key[0].replace('_', ' ')} and with it, all else as fitted with "
               "it; the line is the fitted effect.")
    return Chart(name, title, caption, traces,
                 {"xaxis": axis(x), "yaxis": axis(f"missing {missing['kind']} of {missing['place']} "
                                                  f"[{missing['unit']}]")})


def _units(dataset):
    return ", ".join(dict.fromkeys(unit_of(dataset, c) for c in dataset.channels))


def ladder(dataset, steps, floor):
    """Error of every step of a search, on the fitted and on the held-out passes.

    Parameters
    ----------
    dataset : Dataset
    steps : list of Step
    floor : dict of str to float

    Returns
    -------
    Chart
    """
    names = ["base"] + [f"+ {s.added[0].replace('_', ' ')}<br>at {s.added[1]}" for s in steps[1:]]
    traces, layout = [], {"xaxis": axis("model", type="category"), "height": 380}
    colours, symbols = ("@before", "@after", "@third", "@ink"), ("circle", "square", "diamond", "triangle-up")
    for c, channel in enumerate(dataset.channels):
        for kind, text, dash in (("error", "fitted passes", "dot"), ("held_out_error", "held-out passes", "solid")):
            y = [getattr(s, kind).get(channel, np.nan) for s in steps]
            if np.isfinite(y).any():
                traces.append({"type": "scatter", "mode": "lines+markers", "x": names, "y": y,
                               "name": f"{channel} {text}", "line": {"color": colours[c % 4], "dash": dash},
                               "marker": {"symbol": symbols[c % 4] + ("-open" if dash == "dot" else ""), "size": 10}})
        if floor.get(channel) is not None and np.isfinite(floor[channel]):
            traces.append({"type": "scatter", "mode": "lines", "x": names, "y": [floor[channel]] * len(names),
                           "name": f"{channel} noise floor", "line": {"color": colours[c % 4], "width": 1,
                                                                      "dash": ("dashdot", "longdash")[c % 2]}})
    units = _units(dataset)
    layout["yaxis"] = axis(f"RMSE [{units}]", rangemode="tozero")
    falls = ", ".join(f"{c} from {steps[0].error[c]:.3g} to {steps[-1].error[c]:.3g}" for c in dataset.channels)
    return Chart("ladder", "The error, effect by effect", f"Error at every step of the search: {falls} {units} on the "
                 "fitted passes; lines across: the noise floor.", traces, layout)


def intervals(parameters):
    """Parameters with their 95 % intervals, as shares of the interval's own larger end.

    Parameters
    ----------
    parameters : dict
        ``parameters.json``.

    Returns
    -------
    Chart
    """
    rows = values.interval_rows(parameters)
    low, x, high = zip(*(r["scaled"] for r in rows)) if rows else ((), (), ())
    trace = {"type": "scatter", "mode": "markers", "x": list(x), "y": [r["name"] for r in rows],
             "name": "value and interval", "text": [f"{r['value']:.4g} {r['unit']}" for r in rows],
             "marker": {"color": "@after", "size": 9, "symbol": ["circle" if r["sure"] else "x" for r in rows]},
             "hovertemplate": "%{y}: %{text}<extra></extra>",
             "error_x": {"type": "data", "symmetric": False, "color": "@after",
                         "array": [b - v for b, v in zip(high, x)], "arrayminus": [v - a for a, v in zip(low, x)]}}
    layout = {"height": 110 + 24 * len(rows), "xaxis": axis("value over the larger end of its interval"),
              "yaxis": axis("", autorange="reversed", type="category"), "showlegend": False}
    return Chart("intervals", "Parameters and their intervals",
                 "Each parameter with its 95 % interval, over the larger end of the interval; a cross where it is at a "
                 "bound or not determined by itself.", [trace], layout)


def plane(dataset):
    """The passes in the plane of the two motor angles.

    Parameters
    ----------
    dataset : Dataset

    Returns
    -------
    Chart or None
        None where there are not two angles.
    """
    column = {c.variable: n for n, c in dataset.study.columns.items()}
    angles = [k for k in dataset.known if k.endswith("phi") and k in dataset.measured]
    if dataset.averaged or len(angles) != 2:
        return None
    x, y = (dataset.measured[a] for a in angles)
    lines = {}
    for s, name in values.passes(dataset):
        few = np.unique(np.linspace(s.start, s.stop - 1, 40).astype(int))
        part = lines.setdefault(name or "pass", ([], []))
        part[0].extend([*x[few].tolist(), None])
        part[1].extend([*y[few].tolist(), None])
    dashes, colours = ("solid", "dash", "dot", "dashdot"), ("@after", "@before", "@third", "@ink")
    traces = [{"type": "scatter", "mode": "lines", "x": a, "y": b, "name": name,
               "line": {"color": colours[k // 2 % 4], "dash": dashes[k % 2], "width": 1.5}}
              for k, (name, (a, b)) in enumerate(sorted(lines.items()))]
    return Chart("plane", "Where the machine went", f"The passes in the plane of the motor angles: "
                 f"{', '.join(sorted(lines))}.", traces,
                 {"xaxis": axis(label(dataset, column.get(angles[0], angles[0])), constrain="domain"), "height": 420,
                  "yaxis": axis(label(dataset, column.get(angles[1], angles[1])), scaleanchor="x", constrain="domain")})

"""Data set and fitted models in; the numbers that figures and reports draw, out.

What is drawn twice, on paper and in a browser, is computed here once.
"""

from __future__ import annotations

import math
from contextlib import contextmanager
from functools import wraps

import numpy as np

from ..compile import compile_model, component_name
from ..data.noise import contiguous
from ..diagnosis.dependence import explanations

PIXELS = 1200  # across a page, in a preview of 170 dots an inch
BINS, FULL = 14, 0.15  # bins, and the share of an equal filling below which one is not shown
CELLS = 12  # of a map, along either axis
TOLD = 2.0  # smallest share of the energy that a cell of a map tells [%]
ENOUGH = 100_000  # samples for a mean in a bin; a longer log is thinned evenly, never where extremes are drawn


def _once(function):
    """Compute once for a data set, model and fit what several charts draw."""
    @wraps(function)
    def inner(dataset, model, fit, *arguments):
        # model and fit are kept alive with the result, so that their ids are not used again
        key = "values", function.__name__, id(model), id(fit), arguments
        return dataset.memo(key, lambda: (function(dataset, model, fit, *arguments), model, fit))[0]
    return inner


@contextmanager
def _quiet():
    """No warnings of empty bins."""
    with np.errstate(invalid="ignore", divide="ignore"):
        yield


@_once
def outputs(dataset, model, fit):
    """Values of the compared outputs by a fitted model, NaN where nothing moves.

    Parameters
    ----------
    dataset : Dataset
        Its samples are evaluated.
    model : Model
        That was fitted.
    fit : Fit
        Of that model; its values are used.

    Returns
    -------
    dict of str to ndarray, shape (n,)
    """
    values = dataset.segment_signals(model, fit.parameters, dataset.outputs)
    return {c: np.where(dataset.moving, v, np.nan) for c, v in values.items()}


def ideal(dataset):
    """Values of the compared outputs without any friction: no effect, every f0 = 0 and mu = 1.

    Parameters
    ----------
    dataset : Dataset
        Its samples are evaluated.

    Returns
    -------
    dict of str to ndarray, shape (n,), or None where a rig's segments have no f0
    """
    return dataset.memo(("values", "ideal"), lambda: _ideal(dataset))


def _ideal(dataset):
    model = compile_model(dataset.library, dataset.study.rig)
    values = {n: v.value for n, v in dataset.parameters.variables(model).items()}
    lossless = {f"{c}.{p}": v for c in model.segments for p, v in (("f0", 0.0), ("mu", 1.0)) if f"{c}.{p}" in values}
    if not any(n.endswith(".f0") for n in lossless):
        return None
    return dataset.segment_signals(model, {**values, **dataset.parameters.values(model), **lossless}, dataset.outputs)


def residual_of(dataset, model, fit, parameters=None, part="all", most=None):
    """Residual of a model, and where in the log its samples are.

    Parameters
    ----------
    dataset : Dataset
        Its samples are evaluated.
    model : Model
        That was fitted.
    fit : Fit
        Of that model; its values are used.
    parameters : dict of str to float, optional
        Values to use instead of the fitted ones.
    part : str
        ``fit``, ``test`` or ``all``.
    most : int, optional
        More samples than these are thinned evenly.

    Returns
    -------
    residual : ndarray, shape (channels, samples)
        In the channels' units.
    index : ndarray of int, shape (samples,)
    """
    problem = dataset.residuals(model, fit.free, {**fit.parameters, **(parameters or {})}, part)
    view = dataset.view(part)
    values = [(parameters or {}).get(n, v) for n, v in zip(fit.free, fit.values)]
    k = 1 if most is None else max(1, problem.n // most)
    return problem.thin(k).residual(values), (view.i if dataset.paired else view)[::k]


@_once
def sampled(dataset, model, fit, part="all"):
    """Residual of a model at enough samples for means, where they are, and what the residual may depend on there.

    Parameters
    ----------
    dataset : Dataset
        Its samples are evaluated.
    model : Model
        That was fitted.
    fit : Fit
        Of that model; its values are used.
    part : str
        ``"fit"``, ``"test"``, ``"all"``, or numbers of blocks.

    Returns
    -------
    residual : ndarray, shape (channels, samples)
    index : ndarray of int, shape (samples,)
    known : dict of str to ndarray, shape (samples,)
        See `pycosim.diagnosis.dependence.explanations`.
    """
    residual, index = residual_of(dataset, model, fit, None, part, ENOUGH)
    return residual, index, explanations(dataset, model, fit, index)


def envelope(time, values, pixels=PIXELS):
    """A long signal as its smallest and largest value in every pixel, so that no peak gets lost.

    Parameters
    ----------
    time, values : ndarray, shape (n,)
        NaN where there is no value.
    pixels : int
        Across the plot.

    Returns
    -------
    time, values : ndarray, shape (m,)
        The signal itself where it has no more than two samples a pixel.
    """
    n = len(time)
    if n <= 2 * pixels:
        return time, values
    edges = np.linspace(0, n, pixels + 1).astype(int)[:-1]
    low, high = (f.reduceat(values, edges) for f in (np.fmin, np.fmax))
    return np.repeat(time[edges], 2), np.column_stack([low, high]).ravel()


def _bins(values, count=BINS):
    """Bin number of every sample, and edges: equally wide over what 99 % of the samples cover."""
    low, high = np.quantile(values, [0.005, 0.995])
    if not high > low:
        low, high = values.min() - 0.5, values.max() + 0.5
    edges = np.linspace(low, high, count + 1)
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, count - 1), edges


def binned(x, y, count=BINS):
    """Mean and spread of y over bins of x.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        In any units.
    count : int
        Number of bins.

    Returns
    -------
    centre, mean, spread : ndarray, shape (bins that hold enough samples,)
    """
    where, edges = _bins(x, count)
    number = np.bincount(where, minlength=count)
    with _quiet():
        centre, mean = (np.bincount(where, v, count) / number for v in (x, y))
        spread = np.sqrt(np.maximum(np.bincount(where, y ** 2, count) / number - mean ** 2, 0))
    keep = number >= max(1, FULL * len(x) / count)
    return centre[keep], mean[keep], spread[keep]


def passes(dataset):
    """Samples and label of each pass.

    Parameters
    ----------
    dataset : Dataset
        Its samples are evaluated.

    Returns
    -------
    list of (slice, str)
        In order of time; without a name for passes that have none.
    """
    found = []
    for s in contiguous(dataset.time, dataset.passes):
        if dataset.passes[s.start] >= 0:
            name = "" if dataset.labels is None else str(dataset.labels[(s.start + s.stop) // 2])
            found.append((s, "" if name in ("rest", "transfer", "nan") else name))
    return found


def explained_share(values, residual, forward):
    """Share of the residual's energy that bins of a variable explain, apart for two directions.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Of the variable.
    residual : ndarray, shape (channels, n)
        Measured minus modelled, in the channels' units.
    forward : ndarray of bool, shape (n,)
        Samples of the one direction; the others are of the other.

    Returns
    -------
    float
        From 0 to the number of channels.
    """
    explained = 0.0
    for where in (forward, ~forward):
        if where.sum() > 2 * BINS:
            bins, _ = _bins(values[where])
            number = np.maximum(np.bincount(bins, minlength=BINS), 1)
            for r in residual:
                explained += np.sum(np.bincount(bins, r[where], BINS) ** 2 / number) / np.sum(r ** 2)
    return explained


def direction(residual, known):
    """Samples in which the segment whose speed matters most goes forward, and its place.

    Parameters
    ----------
    residual : ndarray, shape (channels, n)
        Measured minus modelled, in the channels' units.
    known : dict of str to ndarray, shape (n,)
        As `pycosim.diagnosis.dependence.explanations` gives them.

    Returns
    -------
    forward : ndarray of bool, shape (n,)
    place : str
        Empty where no speed is known: then all samples are forward.
    """
    everything = np.ones(residual.shape[1], bool)
    speeds = [n for n in known if n.startswith("speed@")]
    if not speeds:
        return everything, ""
    best = max(speeds, key=lambda n: explained_share(known[n], residual, everything))
    return known[best] > 0, best.partition("@")[2]


def signature_values(dataset, before, after, key):
    """What a missing effect looks like, before and after it is added, in bins of the variable it depends on.

    Parameters
    ----------
    dataset : Dataset
        Its samples are evaluated.
    before, after : (Model, Fit)
        Without the effect, and with it.
    key : (str, str)
        Effect and place.

    Returns
    -------
    dict
        ``variable``; ``rmse``, by channel ``(centres, without, with)``; ``missing``, what is missing at the effect's
        place (None where the rig has no port there): ``centre``, ``without``, ``with``, ``effect``, ``place``, ``unit``
        and ``kind``.
    """
    missing = _missing_torque(dataset, before, after, key)
    residual, _ = residual_of(dataset, *before, None, "fit", ENOUGH)
    left, index, known = sampled(dataset, *after, "fit")
    known = {**known, **_cycle(dataset, after, key, index)}
    variable = _depends(known, missing, residual)
    x, found = known[variable], {}
    for channel, without, with_it in zip(dataset.channels, residual, left):
        (centre, a, _), (_, b, _) = (binned(x, r ** 2, 2 * BINS) for r in (without, with_it))
        found[channel] = centre, np.sqrt(a), np.sqrt(b)
    return {"variable": variable, "rmse": found, "missing": missing and _partial(x, missing)}


def _partial(x, missing):
    """What is missing at a place, in bins."""
    bins, _ = _bins(x, 2 * BINS)
    number = np.bincount(bins, minlength=2 * BINS)
    keep = number >= max(1, FULL * len(x) / (2 * BINS))
    with _quiet():
        size = np.bincount(bins, missing["drive"], 2 * BINS)
        found = {k: (np.bincount(bins, missing[k], 2 * BINS) / size)[keep] for k in ("without", "with", "effect")}
        found["centre"] = (np.bincount(bins, x, 2 * BINS) / number)[keep]
    kind = "friction" if missing["probe"].endswith("dF") else "torque"
    return {**found, "kind": kind, "place": missing["place"], "unit": missing["unit"]}


def _cycle(dataset, after, key, index):
    """Angle within one cycle, for an effect that repeats over the angle."""
    model, fit = after
    effect, place = next((e, p) for e, p in model.attached if (e.id, p.name) == tuple(key))
    cycles = [c for c, kind in effect.scan.items() if kind == "cycles"]
    angle = dataset.signals.get(f"{place.components[0]}.phi")
    if not cycles or angle is None:
        return {}
    n = fit.parameters[f"{component_name(effect, place)}.{cycles[0]}"]
    return {"cycle": np.mod(angle[index], 2 * np.pi / n)}


def _missing_torque(dataset, before, after, key):
    """Residual with and without an effect, all else equal, and the effect, in the direction of a torque at its place.

    Returns
    -------
    dict or None
        ``without``, ``with``, ``effect`` and ``drive``, summed over the channels with their weights, shape (n,); the
        first three are to be divided by the sum of the last. None where the rig has no port at that place.
    """
    model, fit = after
    effect, place = next((e, p) for e, p in model.attached if (e.id, p.name) == tuple(key))
    attached = model.keys
    probes = compile_model(dataset.library, model.rig, attached, True)
    names = [n for n in probes.parameters for c in place.components
             if n in (f"probe_{c}.dF", f"probe_{c}.dtau")]
    if not names:
        return None
    others = {n: v for n, v in fit.parameters.items() if n in before[1].parameters}
    full, _ = residual_of(dataset, *before, others, "fit", ENOUGH)
    left, *_ = sampled(dataset, model, fit, "fit")
    parameters = {**{n: v.value for n, v in probes.parameters.items()}, **fit.parameters}
    kind = [n for n in names if n.rpartition(".")[2] == names[0].rpartition(".")[2]]
    problem = dataset.residuals(probes, kind, parameters, "fit", dataset.exogenous())
    problem = problem.thin(max(1, problem.n // ENOUGH))
    drive = np.concatenate([j.sum(axis=1) for _, _, j in problem.blocks([0.0] * len(kind))], axis=1)
    w = fit.weights[:, None] ** 2
    return {"without": (w * drive * full).sum(0), "with": (w * drive * left).sum(0),
            "effect": (w * drive * (full - left)).sum(0), "drive": (w * drive ** 2).sum(0), "probe": names[0],
            "place": dict(dataset.base.segments).get(place.components[0], place.components[0]),
            "unit": probes.parameters[names[0]].unit}


def torque_at(dataset, before, after, key):
    """Torque of an effect at its place, sample by sample: what takes the residual without it to the one with it.

    Parameters
    ----------
    dataset : Dataset
        Its samples are evaluated.
    before, after : (Model, Fit)
        Without the effect, and with it.
    key : (str, str)
        Effect and place.

    Returns
    -------
    (ndarray, ndarray, str) or None
        Torque and how clearly each sample shows it, shape (n,), and the torque's unit; None where the rig has no port
        for a torque there.
    """
    missing = _missing_torque(dataset, before, after, key)
    if missing is None:
        return None
    with _quiet():
        return missing["effect"] / missing["drive"], missing["drive"], missing["unit"]


def _depends(known, missing, residual):
    """Variable whose bins explain the effect best, or the residual where the effect has no port."""
    def share(values):
        bins, _ = _bins(values, 2 * BINS)
        if missing is None:
            return explained_share(values, residual, np.ones(len(values), bool))
        top, size = (np.bincount(bins, missing[k], 2 * BINS) for k in ("effect", "drive"))
        return np.sum(top ** 2 / np.maximum(size, 1e-300))
    return max((n for n in known if not n.startswith("acceleration@")), key=lambda n: share(known[n]))


def clock(dataset):
    """Time with the runs one after the other, each from where the one before it ends.

    Parameters
    ----------
    dataset : Dataset
        Its samples are evaluated.

    Returns
    -------
    ndarray, shape (n,)
        [s]
    """
    time, start = np.empty(len(dataset.time)), 0.0
    for run in range(len(dataset.logs)):
        where = dataset.run == run
        own = dataset.time[where]
        time[where] = own - own[0] + start
        start += own[-1] - own[0] + float(np.median(np.diff(own))) if len(own) > 1 else 1.0
    return time


@_once
def residual_over_time(dataset, model, fit):
    """Residual of a model at every sample, NaN where none is taken.

    Parameters
    ----------
    dataset : Dataset
        Its samples are evaluated.
    model : Model
        That was fitted.
    fit : Fit
        Of that model; its values are used.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        By channel.
    """
    residual, index = residual_of(dataset, model, fit)
    found = {}
    for channel, values in zip(dataset.channels, residual):
        found[channel] = np.full(len(dataset.time), np.nan)
        found[channel][index] = values
    return found


def stretches(time, codes, shortest=0.0):
    """Stretches of time in which a code stays the same.

    Parameters
    ----------
    time : ndarray, shape (n,)
        [s]
    codes : ndarray, shape (n,)
        Anything that can be compared, as labels.
    shortest : float
        Stretches that do not last longer are left out [s].

    Returns
    -------
    list of (float, float, object)
        Begin, end and code.
    """
    ends = np.append(np.flatnonzero(codes[1:] != codes[:-1]), len(codes) - 1)
    starts = np.insert(ends[:-1] + 1, 0, 0)
    return [(float(time[a]), float(time[b]), codes[a]) for a, b in zip(starts, ends) if time[b] - time[a] > shortest]


def planes(dataset, known):
    """Pairs of variables over which a residual is mapped: speed and load of each segment, and the two angles.

    Parameters
    ----------
    dataset : Dataset
        Its samples are evaluated.
    known : dict of str to ndarray
        As `pycosim.diagnosis.dependence.explanations` gives them.

    Returns
    -------
    list of (str, str)
    """
    found = [(f"speed@{p}", f"load@{p}") for p in dataset.base.segments.values()]
    column = {c.variable: n for n, c in dataset.study.columns.items()}
    angles = [column.get(k, k) for k in dataset.known if k.endswith("phi")]
    found += [tuple(angles)] if len(angles) == 2 else []
    return [pair for pair in found if all(n in known for n in pair)]


def residual_map(x, y, residual):
    """Error of each channel in the cells of a plane.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Variables of the plane at the samples of the residual, SI.
    residual : ndarray, shape (channels, n)
        Measured minus modelled, in the channels' units.

    Returns
    -------
    dict
        ``x`` and ``y`` (edges), ``samples`` (share of all in each cell, shape (CELLS, CELLS), rows along y), ``rmse``
        and ``energy`` (share of the channel's own, shape (channels, CELLS, CELLS)); cells without samples are NaN.
    """
    (i, x_edges), (j, y_edges) = (_bins(v, CELLS) for v in (x, y))
    cell, shape = j * CELLS + i, (CELLS, CELLS)
    count = np.bincount(cell, minlength=CELLS ** 2).astype(float)
    squares = np.array([np.bincount(cell, r ** 2, CELLS ** 2) for r in residual])
    with _quiet():
        rmse = np.sqrt(squares / count)
        energy = np.where(count > 0, squares / squares.sum(1, keepdims=True), np.nan)
    return {"x": x_edges, "y": y_edges, "samples": (count / len(x)).reshape(shape),
            "rmse": rmse.reshape(-1, *shape), "energy": energy.reshape(-1, *shape)}


def signed_shares(mean, share):
    """Labels of the cells of a map: the share of the energy, with the sign of the mean; empty for small shares.

    Parameters
    ----------
    mean, share : ndarray, shape (rows, columns)
        The share in percent.

    Returns
    -------
    list of list of str
    """
    return [[f"{math.copysign(s, m):+.0f}" if s >= TOLD else "" for m, s in zip(*row)]
            for row in zip(mean, share)]


def half_energy(energy, samples):
    """Share of the samples that holds half of the error's energy, the densest cells first.

    Parameters
    ----------
    energy, samples : ndarray, shape (cells, cells)
        Shares, as `residual_map` gives them.

    Returns
    -------
    float
        0.5 where the error is the same everywhere.
    """
    full = samples > 0
    e, n = energy[full], samples[full]
    order = np.argsort(-e / n)
    return float(np.interp(0.5, np.r_[0.0, np.cumsum(e[order])], np.r_[0.0, np.cumsum(n[order])]))


def interval_rows(parameters):
    """Parameters and their intervals over the larger end of each.

    Parameters
    ----------
    parameters : dict
        ``parameters.json``.

    Returns
    -------
    list of dict
        ``name``, ``value``, ``unit``, ``scaled`` (low, value and high) and ``sure`` (neither at a bound nor
        undetermined); parameters without a finite interval are left out.
    """
    rows = []
    for name, p in parameters["parameters"].items():
        ends = p["ci95"][0], p["value"], p["ci95"][1]
        if None not in ends:
            scale = max(map(abs, ends)) or 1.0
            rows.append({"name": name, "value": p["value"], "unit": p["unit"], "scaled": [e / scale for e in ends],
                         "sure": p["identifiable"] and not p["at_bound"]})
    return rows

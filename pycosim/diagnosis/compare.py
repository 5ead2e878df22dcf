"""A fitted model and its data in; errors, and where they are, out."""

from __future__ import annotations

import numpy as np

from ..study.schema import LOG_VARIABLES
from .dependence import explanations

GROUPS = 8
WORDS = {"speed": "speed of {}", "angle": "angle of {}", "load": "mean load of {}",
         "acceleration": "acceleration of {}", "time_since_reversal": "time since reversal"}
OWN = {"speed": "w", "angle": "phi", "load": "L", "acceleration": "w"}  # a segment's


def worded(name):
    """A variable of `explanations`, or a grouping, in words.

    Parameters
    ----------
    name : str
        As ``speed@2A``.

    Returns
    -------
    str
        As ``speed of 2A``.
    """
    kind, _, place = name.partition("@")
    return WORDS.get(kind, name).format(place)


def unit_of(dataset, name):
    """Unit of a channel, a log's column, or a variable such as ``speed@2A``.

    Parameters
    ----------
    dataset : Dataset
        Its logs are compared, as they are arranged for a fit.
    name : str
        As tables and plots call it.

    Returns
    -------
    str
        ``1`` for a number without unit.
    """
    kind, _, place = name.partition("@")
    flat = dataset.base.variables
    component = next((c for c, p in dataset.base.segments.items() if p == place), None)
    if component is not None and kind in OWN:  # a column may have such a name too
        unit = flat[f"{component}.{OWN[kind]}"].unit
        return unit + "/s" if kind == "acceleration" else unit
    if kind in ("time", "time_since_reversal"):
        return "s"
    variable = name.removesuffix("_pair")
    variable = dataset.study.columns[variable].variable if variable in dataset.study.columns else variable
    return dataset.base.unit(variable) if variable in flat else LOG_VARIABLES.get(variable, "1")


def errors(dataset, model, fit, part="all"):
    """RMSE of each channel over the moving samples of a part.

    Parameters
    ----------
    dataset : Dataset
        Its logs are compared, as they are arranged for a fit.
    model : Model
        Of the data set's rig, with the effects that are compared.
    fit : Fit
        Of that model; its values are used.
    part : str
        ``fit``, ``test`` or ``all``.

    Returns
    -------
    dict of str to float
    """
    problem = dataset.residuals(model, fit.free, fit.parameters, part)
    residual = problem.residual(fit.values)
    return {c: float(np.sqrt(np.mean(r ** 2))) for c, r in zip(dataset.channels, residual)}


def joint_errors(dataset, model, fit, part="all"):
    """RMSE of measured joint angles against those of the motors, each with one free zero.

    Parameters
    ----------
    dataset : Dataset
        Its logs are compared, as they are arranged for a fit.
    model : Model
        Of the data set's rig, with the effects that are compared.
    fit : Fit
        Of that model; its values are used.
    part : str
        ``"fit"``, ``"test"``, ``"all"``, or numbers of blocks.

    Returns
    -------
    dict of str to float
        [rad]; empty without joint encoders.
    """
    found = {}
    where = dataset.view(part)
    where = where.i if dataset.paired else where
    names = [n for n in dataset.measured if "." not in n and n not in dataset.known
             and n in model.variables and model.variables[n].unit == "rad"]
    values = dataset.segment_signals(model, fit.parameters, names)
    for n in values:
        gap = (dataset.measured[n] - values[n])[where]
        found[n] = float(np.std(gap))
    return found


def branches(dataset, model, fit):
    """``direct`` or ``reverse`` of every segment at every sample: the sign of load times speed.

    Parameters
    ----------
    dataset : Dataset
        Its logs are compared, as they are arranged for a fit.
    model : Model
        Of the data set's rig, with the effects that are compared.
    fit : Fit
        Of that model; its values are used.

    Returns
    -------
    dict of str to ndarray of str
    """
    names = [f"{c}.{v}" for c in model.segments for v in ("w", "L")]
    signals = dataset.segment_signals(model, fit.parameters, names)
    return {place: np.where(signals[f"{c}.w"] * signals[f"{c}.L"] >= 0, "direct", "reverse")
            for c, place in model.segments.items() if f"{c}.L" in signals}


def compare(dataset, model, fit, part="all"):
    """Errors of a fitted model, whole and by group.

    Parameters
    ----------
    dataset : Dataset
        Its logs are compared, as they are arranged for a fit.
    model : Model
        Of the data set's rig, with the effects that are compared.
    fit : Fit
        Of that model; its values are used.
    part : str
        ``"fit"``, ``"test"``, ``"all"``, or numbers of blocks.

    Returns
    -------
    dict
        ``comparison.json``: ``error``, ``by`` (manoeuvre, branch, part, and quantile groups of every variable), the
        ``units`` of channels and variables, and how many samples were left out.
    """
    problem = dataset.residuals(model, fit.free, fit.parameters, part)
    residual = problem.residual(fit.values)
    view = dataset.view(part)
    index = view.i if dataset.paired else view
    by = {}
    if dataset.labels is not None:
        by["manoeuvre"] = _grouped(dataset, residual, dataset.labels[index])
    by["branch"] = {}
    for place, branch in branches(dataset, model, fit).items():
        for label, value in _grouped(dataset, residual, branch[index]).items():
            by["branch"][f"{place} {label}"] = value
    by["part"] = _grouped(dataset, residual, np.where(dataset.is_test[dataset.block[index]], "test", "fit"))
    if len(dataset.logs) > 1:
        names = np.array([log.name for log in dataset.logs])
        by["run"] = _grouped(dataset, residual, names[dataset.run[index]])
    variables = {n: v for n, v in explanations(dataset, model, fit, index).items() if n not in by}  # runs have names
    for name, values in variables.items():
        by[name] = _grouped(dataset, residual, _quantile_labels(values))
    error = {**{c: float(np.sqrt(np.mean(r ** 2))) for c, r in zip(dataset.channels, residual)},
             **joint_errors(dataset, model, fit, part)}
    return {"schema": 1, "error": error,
            "by": by,
            "units": {name: unit_of(dataset, name) for name in [*error, *variables]},
            "samples": {"used": int(problem.n), "moving": int(dataset.moving.sum()), "all": int(len(dataset.time)),
                        "w_min": float(dataset.w_min), "unit_w_min": dataset.speed_unit,
                        "left_out": int(np.count_nonzero(dataset.left_out)),
                        "left_out_rows": {log.name: log.dropped for log in dataset.logs if log.dropped}}}


def _grouped(dataset, residual, labels):
    found = {}
    for label in np.unique(labels):
        where = labels == label
        found[str(label)] = {c: float(np.sqrt(np.mean(r[where] ** 2))) for c, r in zip(dataset.channels, residual)}
    return found


def _quantile_labels(values):
    edges = np.unique(np.quantile(values, np.linspace(0, 1, GROUPS + 1)))
    if len(edges) < 2:
        return np.array([f"{values[0]:.4g}"] * len(values))
    edges = np.where(np.abs(edges) < 1e-6 * np.ptp(edges), 0.0, edges)
    number = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    names = np.array([f"{a:.4g} to {b:.4g}" for a, b in zip(edges[:-1], edges[1:])])
    return names[number]


__all__ = ["branches", "compare", "errors", "joint_errors", "unit_of", "worded"]

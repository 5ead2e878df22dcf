"""A fit in; the directions it does not determine, and the combinations of parameters that it does, in words, out.

The form of a combination is searched for in the vectors: nothing here knows a rig. A combination of parameters of one
kind is tried as their sum, each times a simple function of another parameter of its own component.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.special import stdtrit

from ..core.words import listed

MATCH = 1e-4  # relative agreement of coefficients with a simple function
HARDLY = 0.95  # correlation beyond which two parameters are told as one
FORMS = {
    "{m}": lambda m: m,
    "(1 + {m})": lambda m: 1 + m,
    "(1 - {m})": lambda m: 1 - m,
    "/ {m}": lambda m: 1 / m,
    "/ (1 + {m})": lambda m: 1 / (1 + m),
    "{m} / (1 + {m})": lambda m: m / (1 + m),
}
_SLOPE = 1e-6


def number(value, nominal=0.0):
    """A value to three digits, as a person reads it.

    Parameters
    ----------
    value : float
        In the unit that is written beside it.
    nominal : float
        Usual size of the quantity.

    Returns
    -------
    str
        ``0`` when the value is nothing against its nominal size.

    Examples
    --------
    >>> number(0.0123456)
    '0.0123'
    """
    return "0" if abs(value) <= 1e-5 * nominal else f"{value:.3g}"


def null_directions(fit, owners=None):
    """What the data do not determine.

    Parameters
    ----------
    fit : Fit
        Its ``null_directions`` are put into words.
    owners : dict of str to str, optional
        Component that an effect hangs at, by the component of its coefficients: ``viscous_1B`` to ``s1B``.

    Returns
    -------
    list of dict
        ``text``; ``coefficients``, the direction along which nothing changes, in the parameters' own units; and
        ``determined``, the combinations of the same parameters that the data do determine (``text``, ``value``,
        ``ci95``, ``unit``).
    """
    found = []
    for names, null, known in _clusters(fit):
        determined = [_combination(fit, names, row, owners or {}) for row in known]
        if determined:
            forms = "; ".join(_told(d) for d in determined)
            text = f"{listed(names)} only as {forms}"
        else:
            text = f"{listed(names)}: these data say nothing about {'it' if len(names) == 1 else 'them'}"
        found += [{"text": text, "coefficients": dict(zip(names, map(float, row))), "determined": determined}
                  for row in null]
    return found


def weak_directions(fit):
    """Pairs that the data determine, but hardly one without the other.

    Parameters
    ----------
    fit : Fit
        Its correlations are looked at, pair by pair.

    Returns
    -------
    list of dict
        As `null_directions`, with ``correlation``.
    """
    found = []
    correlation = fit.correlation
    usable = [k for k, n in enumerate(fit.free) if fit.identifiable(n) and fit.stderr[k] > 0]
    for a, i in enumerate(usable):
        for j in usable[a + 1:]:
            kinds = {n.rsplit(".", 1)[-1] for n in (fit.free[i], fit.free[j])}
            if abs(correlation[i, j]) < HARDLY or len(kinds) > 1:  # a sum of unlike quantities helps nobody
                continue
            scale = np.array([fit.variables[fit.free[k]].nominal for k in (i, j)])
            _, vectors = np.linalg.eigh(fit.covariance[np.ix_((i, j), (i, j))] / np.outer(scale, scale))
            names = [fit.free[i], fit.free[j]]
            determined = _combination(fit, names, vectors[:, 0] / scale, {})
            weak = vectors[:, 1] * scale
            found.append({"text": f"{listed(names)} are hard to tell apart (correlation {correlation[i, j]:.3f}); "
                                  f"together they are better known: {_told(determined)}",
                          "coefficients": dict(zip(names, map(float, weak / np.max(np.abs(weak))))),
                          "determined": [determined], "correlation": float(correlation[i, j])})
    return found


def _clusters(fit):
    """Parameters that are undetermined together: (names, null rows, determined rows)."""
    if not len(fit.null_directions):
        return
    nominal = np.array([fit.variables[n].nominal for n in fit.free])
    _, size, rows = np.linalg.svd(fit.null_directions / nominal, full_matrices=False)
    rows = rows[size > 1e-9 * size[0]]
    projector = rows.T @ rows  # does not depend on how the solver mixed the directions
    inside = np.flatnonzero(np.diag(projector) > 1e-8)
    linked = np.abs(projector[np.ix_(inside, inside)]) > 1e-6
    count, label = connected_components(linked, directed=False)
    for k in range(count):
        members = inside[label == k]
        values, vectors = np.linalg.eigh(projector[np.ix_(members, members)])
        names = [fit.free[i] for i in members]
        null = _reduced(vectors[:, values > 0.5].T * nominal[members])
        yield names, null / np.max(np.abs(null), axis=1, keepdims=True), _reduced(
            vectors[:, values <= 0.5].T / nominal[members])


def _reduced(rows):
    """Row echelon form with unit pivots: the sparsest simple basis of the same space."""
    rows = np.array(rows, dtype=float)
    column = 0
    for k in range(len(rows)):
        while True:
            pivot = k + int(np.argmax(np.abs(rows[k:, column])))
            if abs(rows[pivot, column]) > 1e-9 * np.max(np.abs(rows[k:])):
                break
            column += 1
        rows[[k, pivot]] = rows[[pivot, k]]
        rows[k] /= rows[k, column]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, column] * rows[k]
        column += 1
    rows[np.abs(rows) < 1e-9 * np.max(np.abs(rows), initial=0)] = 0.0
    return rows


def _combination(fit, names, row, owners):
    """A determined combination in words, with its value and interval."""
    terms = [(n, c) for n, c in zip(names, row) if abs(c) > 1e-7 * np.max(np.abs(row))]
    names, row = [n for n, _ in terms], np.array([c for _, c in terms])
    row = row / row[0]
    form = _form(fit, names, row, owners)
    if form is None:
        text = _sum(names, ["" if number(abs(c)) == "1" else f"{number(abs(c))} " for c in row], [""] * len(row), row)
        weights = {n: float(c) for n, c in zip(names, row)}
        return {"text": text, **_value(fit, names, lambda p: sum(c * p[n] for n, c in weights.items()), weights)}
    pattern, siblings = form
    if pattern is None:
        signs = np.sign(row)
        weights = {n: float(s) for n, s in zip(names, signs)}
        return {"text": _sum(names, [""] * len(row), [""] * len(row), row),
                **_value(fit, names, lambda p: sum(s * p[n] for n, s in weights.items()), weights)}
    function, signs = FORMS[pattern], np.sign(row)
    after = [" " + pattern.format(m=s) for s in siblings]
    weights = {n: float(s * function(fit.parameters[m])) for n, s, m in zip(names, signs, siblings)}
    return {"text": _sum(names, [""] * len(row), after, row),
            **_value(fit, names, lambda p: sum(s * p[n] * function(p[m]) for n, s, m in zip(names, signs, siblings)),
                     weights)}


def _form(fit, names, row, owners):
    """(pattern, siblings) of the function that the coefficients are proportional to, or None."""
    kinds = {n.rsplit(".", 1)[-1] for n in names}
    if len(names) < 2 or len(kinds) != 1:
        return None
    tried = [(None, names, np.ones(len(names)))]
    components = [owners.get(c, c) for c in (n.rpartition(".")[0] for n in names)]
    own = [{p[len(c) + 1:] for p in fit.parameters if p.startswith(c + ".")} for c in components]
    for sibling in sorted(set.intersection(*own) - kinds):
        full = [f"{c}.{sibling}" for c in components]
        for pattern, function in FORMS.items():
            with np.errstate(all="ignore"):
                tried.append((pattern, full, np.array([function(np.float64(fit.parameters[m])) for m in full])))
    best = None
    for pattern, siblings, values in tried:
        if not np.all(np.isfinite(values)) or np.any(np.abs(values) < 1e-9):
            continue
        gap = float(np.max(np.abs(np.abs(values / values[0]) / np.abs(row) - 1)))
        if gap < MATCH and (best is None or gap < best[0] - 1e-6):
            best = gap, pattern, siblings
    return best and best[1:]


def _sum(names, before, after, row):
    parts = [f"{'- ' if c < 0 else '+ '}{b}{n}{a}" for n, b, a, c in zip(names, before, after, row)]
    return " ".join(parts).removeprefix("+ ")


def _value(fit, names, function, weights):
    """Value and interval of a function of the parameters (delta method), within what the bounds allow."""
    gradient = np.empty(len(fit.free))
    for k, name in enumerate(fit.free):
        step = _SLOPE * fit.variables[name].nominal
        up, down = ({**fit.parameters, name: fit.parameters[name] + s} for s in (step, -step))
        gradient[k] = (function(up) - function(down)) / (2 * step)
    value = float(function(fit.parameters))
    # as single intervals are: around the estimate with the bounds lifted, so that a bound does not make it too narrow
    shift = gradient @ (fit.unbounded - fit.values)
    half = stdtrit(fit.dof, 0.975) * math.sqrt(max(gradient @ fit.covariance @ gradient, 0.0))
    ends = [[c * b for b in (fit.variables[n].min, fit.variables[n].max)] for n, c in weights.items()]
    low, high = sum(min(e) for e in ends), sum(max(e) for e in ends)
    return {"value": value, "ci95": [float(min(max(value + shift - half, low), value)),
                                     float(max(min(value + shift + half, high), value))],
            "unit": fit.variables[names[0]].unit, "nominal": fit.variables[names[0]].nominal}


def _told(d):
    """A combination with its value, unit and interval."""
    unit = "" if d["unit"] == "1" else f" {d['unit']}"
    value, low, high = (number(v, d["nominal"]) for v in (d["value"], *d["ci95"]))
    return f"{d['text']} = {value}{unit} (95 %: {low} to {high})"

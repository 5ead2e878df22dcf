"""A fitted model's residual in; the noise floor, and the variables that the residual still depends on, out."""

from __future__ import annotations

import numpy as np

from ..data.noise import contiguous

BINS = 24
MOMENTS = 1.5  # [s]: a stretch in which friction that comes and goes is taken to last
ALARM = 4.0  # standard errors by which a dependence must lower the error on blocks that it was not fitted to ..
SHARE, FEW = 0.05, 1.5  # .. or this share of the error's energy, where few blocks hold it, and so many standard errors


def noise_floor(dataset, model, fit):
    """Error that no model of this kind could get below, a channel.

    The smaller of the spread within a pass after removing what is smooth over it (a cubic in time), and the difference
    of repeats of the same line at the same speed.

    Parameters
    ----------
    dataset : Dataset
    model : Model
    fit : Fit

    Returns
    -------
    dict of str to float
        NaN where a whole run is one sample: nothing shows how much of it is noise.
    """
    if dataset.averaged:
        return dict.fromkeys(dataset.channels, float("nan"))
    problem = dataset.residuals(model, fit.free, fit.parameters, "all")
    residual = problem.residual(fit.values)
    floors = {}
    for channel, r in zip(dataset.channels, residual):
        within = _within(r, problem)
        between = _between(dataset, r, problem)
        floors[channel] = float(min(v for v in (within, between) if v is not None))
    return floors


def _within(residual, problem):
    total, count = 0.0, 0
    for s in contiguous(problem.time, problem.group):
        n = s.stop - s.start
        if n >= 12:
            x = np.linspace(-1, 1, n)
            base = np.polynomial.legendre.legvander(x, 3)
            left = residual[s] - base @ np.linalg.lstsq(base, residual[s], rcond=None)[0]
            total, count = total + left @ left, count + n - 4
    return np.sqrt(total / count) if count else float(np.sqrt(np.mean(residual ** 2)))


def _between(dataset, residual, problem):
    """Difference of repeats: the same line, speed and direction, compared bin by bin along the line."""
    blocks = dataset.blocks
    values = []
    keys = list(zip(blocks.line.tolist(), blocks.speed.tolist()))
    for key in set(keys):
        same = [b for b, k in enumerate(keys) if k == key]
        if len(same) < 2:
            continue
        profiles = [_profile(dataset, residual, problem, b) for b in same]
        for a, b in zip(profiles[:-1], profiles[1:]):
            m = min(len(a), len(b))
            if m > 20:
                values.append((a[:m] - b[:m]) / np.sqrt(2))
    return float(np.sqrt(np.mean(np.concatenate(values) ** 2))) if values else None


def _profile(dataset, residual, problem, block):
    """Residual of a block in order; repeats of constant speed line up sample by sample."""
    return residual[problem.block == block]


def explanations(dataset, model, fit, problem_index):
    """Variables that the residual may depend on, at the samples of a problem.

    Parameters
    ----------
    dataset : Dataset
    model : Model
    fit : Fit
    problem_index : ndarray of int, shape (n,)
        The samples.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        SI units.
    """
    study = dataset.study
    column = {c.variable: n for n, c in study.columns.items()}
    found = {}
    for variable, values in dataset.measured.items():
        found[column.get(variable, variable)] = dataset.exogenous().get(variable, values)
    if not dataset.averaged:
        found["time"] = dataset.time
        found["time_since_reversal"] = time_since_reversal(dataset)
    segments = model.segments
    signals = dataset.segment_signals(model, fit.parameters,
                                      [f"{c}.{v}" for c in segments for v in ("w", "L")], None, dataset.exogenous())
    for component, place in segments.items():
        if f"{component}.w" in signals:
            found[f"speed@{place}"] = signals[f"{component}.w"]
            found[f"load@{place}"] = signals[f"{component}.L"]
            rate = np.zeros(len(dataset.time))
            for k in range(len(dataset.logs)):
                part = dataset.run == k
                if part.sum() > 10:
                    t, w = dataset.time[part], signals[f"{component}.w"][part]
                    rate[part] = np.gradient(w, t)
            found[f"acceleration@{place}"] = rate
    return {n: v[problem_index] for n, v in found.items() if np.ptp(v[problem_index]) > 0}


def time_since_reversal(dataset):
    """Time since the start of the pass, 0 while nothing moves.

    Parameters
    ----------
    dataset : Dataset

    Returns
    -------
    ndarray, shape (n,)
        [s]
    """
    since = np.zeros(len(dataset.time))
    for s in contiguous(dataset.time, dataset.passes):
        since[s] = dataset.time[s] - dataset.time[s.start]
    return since


def dependence(dataset, model, fit, seed=0):
    """What the residual still depends on, most first, and whether that is more than chance.

    For every variable, the residual is predicted from bins of it, times the response of the channels to friction at
    each place (and plainly), on blocks that the bins were not fitted to. The strength is the share of the residual's
    energy that this removes.

    Parameters
    ----------
    dataset : Dataset
    model : Model
    fit : Fit
    seed : int

    Returns
    -------
    found : list of dict
        ``{"variable": .., "strength": ..}``.
    sure : bool
        Whether the strongest is beyond chance.
    """
    from ..compile import compile_model

    probes = compile_model(dataset.library, model.rig, [(e.id, p.name) for e, p in model.attached], True)
    names = [n for n in probes.parameters if n.startswith("probe_") and n.rsplit(".", 1)[1] in ("dF", "dtau")]
    parameters = {**{n: v.value for n, v in probes.parameters.items()}, **fit.parameters}
    problem = dataset.residuals(probes, [*fit.free, *names], parameters, "fit", dataset.exogenous())
    residual = dataset.residuals(model, fit.free, fit.parameters, "fit").residual(fit.values)
    view = dataset.view("fit")
    index = view.i if dataset.paired else view
    thin = max(1, problem.n // 20000)
    problem, index, residual = problem.thin(thin), index[::thin], residual[:, ::thin]
    x = [*fit.values, *np.zeros(len(names))]
    slope = np.concatenate([j[:, len(fit.free):] for _, _, j in problem.blocks(x)], axis=2)
    plain = np.zeros((len(residual), len(residual), problem.n))
    plain[np.arange(len(residual)), np.arange(len(residual))] = 1.0
    drives = np.concatenate([slope, plain], axis=1)
    blocks, label = np.unique(problem.block, return_inverse=True)
    fold = dataset.fold[blocks][label]
    weights = fit.weights[:, None] ** 2
    energy = float((weights * residual ** 2).sum())
    waves = list(drives.transpose(1, 0, 2))
    drives = [((weights * d * residual).sum(0), (weights * d ** 2).sum(0)) for d in waves]
    found, sure, most = [], False, (0.0, None)
    for name, values in explanations(dataset, model, fit, index).items():
        bins = _bins(values)
        tried = [_explained(xy, xx, energy, bins, fold, label, len(blocks)) for xy, xx in drives]
        k = max(range(len(tried)), key=lambda i: tried[i][0])
        found.append({"variable": name, "strength": max(0.0, float(tried[k][0]))})
        sure |= _beyond_chance(*tried[k])
        most = max(most, (tried[k][0], (k, bins)), key=lambda m: m[0])
    if not dataset.paired and not dataset.averaged:
        left = _without(residual, waves, drives, most)
        frictions = [w for w, n in zip(waves, names) if n.endswith(".dF")]
        share, errors = max((_bursts(left, w, weights, problem, energy) for w in frictions), default=(0.0, 0.0))
        sure |= share > 0 and errors > ALARM
        for entry in found:
            if entry["variable"] == "time":
                entry["strength"] = max(entry["strength"], share)
    found = [{**e, "strength": round(e["strength"], 4)} for e in found]
    angles = {n for n, c in dataset.study.columns.items() if c.variable.endswith("phi")}
    channels = {n for n, c in dataset.study.columns.items() if c.variable in dataset.outputs}

    def order(entry):
        """Most first; of variables that follow from each other, the angle before what it causes."""
        name = entry["variable"]
        return -entry["strength"] * (1.02 if name in angles else 0.9 if name in channels else 1.0)
    return sorted(found, key=order), bool(sure)


def _beyond_chance(share, errors):
    return (errors > ALARM and share > 0) or (share > SHARE and errors > FEW)


def _without(residual, waves, drives, most):
    """Residual after what depends most on one variable is taken out."""
    if most[1] is None:
        return residual
    k, bins = most[1]
    xy, xx = drives[k]
    sums = np.bincount(bins, xy), np.bincount(bins, xx)
    return residual - (sums[0] / (sums[1] + 1e-300))[bins] * waves[k]


def _bursts(residual, drive, weights, problem, energy):
    """Friction at a place that comes and goes with time alone.

    Its size in each short stretch of a pass is found; where it is sometimes large and mostly not, these sizes are
    skewed to one side, which noise that knows no direction of motion is not.

    Returns
    -------
    share, errors : float
        Of the energy, in the stretches that stand out; and skewness in standard errors. Zero where none does.
    """
    stretch = np.floor(np.concatenate([problem.time[s] - problem.time[s.start] for s in
                                       contiguous(problem.time, problem.group)]) / MOMENTS).astype(int)
    new = np.r_[0, np.cumsum((np.diff(stretch) != 0) | (np.diff(problem.group) != 0))]
    xy, xx = (np.bincount(new, v) for v in ((weights * drive * residual).sum(0), (weights * drive ** 2).sum(0)))
    xy, xx = xy[xx > 0.2 * np.median(xx)], xx[xx > 0.2 * np.median(xx)]
    if len(xx) < 30:
        return 0.0, 0.0
    size = xy / xx
    middle = np.median(size)
    spread = 1.4826 * np.median(np.abs(size - middle)) + 1e-300
    centred = size - size.mean()
    lasting = np.clip(np.corrcoef(centred[1:], centred[:-1])[0, 1], 0.0, 0.95) ** 3
    skew = np.mean(centred ** 3) / np.mean(centred ** 2) ** 1.5
    errors = skew / np.sqrt(6 / len(size) * (1 + lasting) / (1 - lasting))
    out = size > middle + 3 * spread
    share = float((xy ** 2 / xx)[out].sum() / energy) if errors > ALARM else 0.0
    return share, float(errors)


def _bins(values):
    """Bin numbers: half of the edges fill the bins equally, half are equally wide, for what is mostly near a value."""
    equal = np.quantile(values, np.linspace(0, 1, BINS // 2 + 1)[1:-1])
    wide = np.linspace(*np.quantile(values, [0.002, 0.998]), BINS // 2 + 1)[1:-1]
    return np.searchsorted(np.unique(np.r_[equal, wide]), values)


def _explained(xy, xx, energy, bins, fold, block, count):
    """Share of energy removed out of fold, and how many standard errors over the blocks that is.

    ``xy`` and ``xx`` are, sample by sample, the products of a drive with the residual and with itself: a bin's factor
    beta on the drive takes ``beta (2 xy - beta xx)`` of the energy.
    """
    k, f = bins.max() + 1, fold.max() + 1
    cell = fold * k + bins
    sum_xy, sum_xx = (np.bincount(cell, v, f * k).reshape(f, k) for v in (xy, xx))
    others_xy, others_xx = sum_xy.sum(0) - sum_xy, sum_xx.sum(0) - sum_xx
    ridge = 1e-3 * sum_xx.sum() / k + 1e-300
    beta = (others_xy / (others_xx + ridge)).ravel()[cell]
    per_block = np.bincount(block, beta * (2 * xy - beta * xx), count)
    spread = np.sqrt(count * per_block.var(ddof=1)) if count > 1 else np.inf
    return per_block.sum() / energy, per_block.sum() / (spread + 1e-300)

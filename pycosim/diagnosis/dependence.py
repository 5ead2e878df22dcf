"""A fitted model's residual in; the noise floor, and the variables that the residual still depends on, out."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csc_array

from ..compile import compile_model
from ..data.instruments import CALM, rounding
from ..data.noise import contiguous
from ..data.spikes import mended
from .whitened import CHANCE, Whitened

BINS = 24
FINE = 192  # bins of an angle: five in each cycle of what a mesh of some forty teeth does over the travel
ENOUGH = 20  # blocks, whose scatter tells a standard error; with fewer, passes do
FOLDS = 5
MOMENTS = 1.5  # [s]: a stretch in which friction that comes and goes is taken to last
ALARM = 4.0  # standard errors by which a dependence must lower the error on blocks that it was not fitted to ..
RELEVANT = 0.01
"""Least share of the energy that matters: half a percent of the error, which nobody would notice in an estimate."""
SAME = 0.9999  # correlation of two angles that tell the same
SAMPLES = 20000  # that bins are compared on
BROAD = 1.1  # times its energy in a few draws, that rounding may leave
AGAIN = 12  # times that what was measured is rounded anew
SHARE, FLIPS, RARE = 0.05, 199, 0.01
""".. or a share of the energy that so few of so many flips of the blocks' signs reach: where few blocks hold what is
missing, their scatter tells no standard error (wild cluster bootstrap: Cameron, Gelbach, Miller, *Bootstrap-based
improvements for inference with clustered errors*, 2008)."""

BESIDE, PAUSE, FEW, TURNS, AGREE, OPPOSED = 0.3, 2.0, 5, 4, 0.3, 1.645
"""Seconds beside a turn whose error is compared, seconds that it may rest there, samples of a side, turns that tell,
the correlation of both sides from which they agree, and the standard errors by which they are of the other sign. Slow
noise alone has 0.2 to 0.9, and 0.8 where it is as strong as the fast; friction that ebbs, flows, or comes and goes has
-0.96 to 0.24 at one segment at least, in seven logs. Of 67 logs with nothing hidden the least error was -1.1 of its
standard errors in torques, the wrong or filtered references among them -1.5; a friction that grew with the way, came
and went, or grew with speed and load had -2.1 to -3.6."""


def noise_floor(dataset, model, fit):
    """Error that no model of this kind could get below, a channel.

    In each run, the smallest of the spread within a pass after removing what is smooth over it (a cubic in time), the
    difference of repeats of the same line at the same speed, and the error itself: a few passes may tell more than all
    have. The runs' own are averaged, for one may be noisier than another, and repeat nothing.

    Parameters
    ----------
    dataset : Dataset
        Its logs are arranged for a fit.
    model : Model
        That was fitted.
    fit : Fit
        Of that model; its residual is looked at.

    Returns
    -------
    dict of str to float
        NaN where a whole run is one sample: nothing shows how much of it is noise.
    """
    if dataset.averaged:
        return dict.fromkeys(dataset.channels, float("nan"))
    problem = dataset.residuals(model, fit.free, fit.parameters, "all")
    return _floors(dataset, problem, problem.residual(fit.values))


def calm_floor(dataset, model, fit):
    """`noise_floor` and the error itself, both without the outliers of the residual.

    A single one of twenty times the noise, which a turn hid from what mends a record, is as much as all the rest.

    Parameters
    ----------
    dataset, model, fit
        As of `noise_floor`; the data set is not averaged.

    Returns
    -------
    floor, error : dict of str to float
        By channel.
    """
    problem = dataset.residuals(model, fit.free, fit.parameters, "all")
    run = dataset.run[dataset.picks("all")[0][1]]
    residual = problem.residual(fit.values)
    for k in np.unique(run):
        residual[:, run == k] = [mended(r) for r in residual[:, run == k]]
    return _floors(dataset, problem, residual), dict(zip(dataset.channels, np.sqrt(np.mean(residual**2, axis=1))))


def _floors(dataset, problem, residual):
    run = dataset.run[dataset.picks("all")[0][1]]
    floors = {}
    for channel, r in zip(dataset.channels, residual):
        total = 0.0
        for one in np.unique(run):
            inside = run == one
            own = (_within(r, problem, inside), _between(dataset, r, problem, inside), np.sqrt(np.mean(r[inside] ** 2)))
            total += np.count_nonzero(inside) * min(v for v in own if v is not None) ** 2
        floors[channel] = float(np.sqrt(total / len(r)))
    return floors


def _within(residual, problem, inside):
    total, count = 0.0, 0
    for s in contiguous(problem.time, problem.group):
        n = s.stop - s.start
        if n >= 12 and inside[s.start]:
            x = np.linspace(-1, 1, n)
            base = np.polynomial.legendre.legvander(x, 3)
            left = residual[s] - base @ np.linalg.lstsq(base, residual[s], rcond=None)[0]
            total, count = total + left @ left, count + n - 4
    return np.sqrt(total / count) if count else None


def _between(dataset, residual, problem, inside):
    """Difference of repeats: the same line, speed and direction, compared bin by bin along the line."""
    blocks, own = dataset.blocks, {*np.unique(problem.block[inside]).tolist()}
    values = []
    keys = list(zip(blocks.line.tolist(), blocks.speed.tolist()))
    for key in set(keys):
        same = [b for b, k in enumerate(keys) if k == key and b in own]
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
        Its logs are arranged for a fit.
    model : Model
        That was fitted.
    fit : Fit
        Of that model; its residual is looked at.
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
    known = {**dataset.exogenous(), **({} if dataset.paired else dataset.predicted(model, fit.parameters))}
    for variable, values in dataset.measured.items():  # a residual's own noise is in what was measured
        found[column.get(variable, variable)] = known.get(variable, values)
    if not dataset.averaged:
        found["time"] = dataset.time
        found["time_since_reversal"] = time_since_reversal(dataset)
        found["run"] = dataset.run.astype(float)
    segments, angles = model.segments, []
    signals = dataset.segment_signals(model, fit.parameters, [f"{c}.{v}" for c in segments for v in ("w", "L", "phi")],
                                      None, dataset.exogenous())
    # what an encoder errs by is in the residual through the acceleration: it must not be in what explains that
    still = {n: v for angle in dataset.motion.followed for n, v in dataset.motion.calm(angle, CALM).items()}
    calm = dataset.segment_signals(model, fit.parameters, [f"{c}.w" for c in segments], None,
                                   {**dataset.exogenous(), **still})
    for component, place in segments.items():
        if f"{component}.phi" in signals and not dataset.averaged:
            found[f"angle@{place}"] = signals[f"{component}.phi"]
            angles.append(f"angle@{place}")
        if f"{component}.w" in signals:
            found[f"speed@{place}"] = signals[f"{component}.w"]
            found[f"load@{place}"] = signals[f"{component}.L"]
            rate = np.zeros(len(dataset.time))
            for k in range(len(dataset.logs)):
                part = dataset.run == k
                if part.sum() > 10:
                    rate[part] = np.gradient(calm[f"{component}.w"][part], dataset.time[part])
            found[f"acceleration@{place}"] = rate
    found = {n: v[problem_index] for n, v in found.items() if np.ptp(v[problem_index]) > 0}
    for name in [n for n in angles if n in found]:  # one that a column or another segment tells is said once
        values = found.pop(name)
        if not any(abs(np.corrcoef(values, v)[0, 1]) > SAME for v in found.values()):
            found[name] = values
    return found


def time_since_reversal(dataset):
    """Time since the start of the pass, 0 while nothing moves.

    Parameters
    ----------
    dataset : Dataset
        Its logs are arranged for a fit.

    Returns
    -------
    ndarray, shape (n,)
        [s]
    """
    since = np.zeros(len(dataset.time))
    for s in contiguous(dataset.time, dataset.passes):
        since[s] = dataset.time[s] - dataset.time[s.start]
    return since


@dataclass
class Dependence:
    """What a residual still depends on.

    Attributes
    ----------
    variables : list of dict
        ``{"variable": .., "strength": ..}``, most first: the share of the energy that a free function of it takes away
        on blocks that it was not fitted to, beyond what rounding would give it.
    sure : bool
        Whether that is more than chance, and enough to matter.
    channels : dict of str to Dependence
        The same of each channel alone; empty for those.
    """

    variables: list
    sure: bool
    channels: dict = field(default_factory=dict)


def dependence(dataset, model, fit, seed=0):
    """What the residual still depends on, most first, and whether that is more than chance.

    For every variable, the residual is predicted from bins of it, times the response of the channels to friction at
    each place (and plainly), on blocks that the bins were not fitted to. The strength is the share of the residual's
    energy that this removes, less the share that it would remove of what rounding alone leaves. Each channel answers
    for itself too.

    Parameters
    ----------
    dataset : Dataset
        Its logs are arranged for a fit.
    model : Model
        That was fitted.
    fit : Fit
        Of that model; its residual is looked at.
    seed : int
        Of what rounding may have left in the residual, which is drawn.

    Returns
    -------
    Dependence

    References
    ----------
    .. [1] Cameron, A. C., Gelbach, J. B. and Miller, D. L. (2008). Bootstrap-based improvements for inference with
           clustered errors. Review of Economics and Statistics 90(3).
    """
    given = _Given.of(dataset, model, fit, seed)
    channels = {c: _dependence(given, np.arange(len(dataset.channels)) == k) for k, c in enumerate(dataset.channels)}
    whole = _dependence(given, given.beyond_rounding(), True)
    sure = [c for c in channels.values() if c.sure]
    if sure and not whole.sure:
        whole = max(sure, key=lambda c: c.variables[0]["strength"])
    return Dependence(whole.variables, whole.sure, channels)


@dataclass
class _Given:
    """Residual, responses to friction, variables and folds, thinned to what bins need."""

    dataset: object
    problem: object
    residual: np.ndarray
    waves: list
    frictions: list
    weights: np.ndarray
    bins: dict
    fold: np.ndarray
    label: np.ndarray
    roundings: np.ndarray
    noise: list

    @classmethod
    def of(cls, dataset, model, fit, seed):
        """Gather what is needed, once for all channels."""
        probes = compile_model(dataset.library, model.rig, model.keys, True)
        names = [n for n in probes.parameters if n.startswith("probe_") and n.rsplit(".", 1)[1] in ("dF", "dtau")]
        parameters = {**{n: v.value for n, v in probes.parameters.items()}, **fit.parameters}
        problem = dataset.residuals(probes, [*fit.free, *names], parameters, "fit", dataset.exogenous())
        residual = dataset.residuals(model, fit.free, fit.parameters, "fit").residual(fit.values)
        view = dataset.view("fit")
        index = view.i if dataset.paired else view
        thin = max(1, problem.n // SAMPLES)
        problem, index, residual = problem.thin(thin), index[::thin], residual[:, ::thin]
        x = [*fit.values, *np.zeros(len(names))]
        slope = np.concatenate([j[:, len(fit.free):] for _, _, j in problem.blocks(x)], axis=2)
        plain = np.zeros((len(residual), len(residual), problem.n))
        plain[np.arange(len(residual)), np.arange(len(residual))] = 1.0
        waves = list(np.concatenate([slope, plain], axis=1).transpose(1, 0, 2))
        label, fold = stretches(dataset, problem)
        drawn, rng = rounding(dataset, model, fit), np.random.default_rng(seed)
        roundings = [drawn(rng)[:, ::thin] for _ in range(AGAIN)] if drawn else []
        bins = {}
        for name, values in explanations(dataset, model, fit, index).items():
            bins[name] = [_bins(values)]
            if _is_angle(dataset, name):
                bins[name].append(_even(values, FINE))
        return cls(dataset, problem, residual, waves, [n.endswith(".dF") for n in names], fit.weights[:, None] ** 2,
                   bins, fold, label, np.array(roundings), fit.noise)

    def beyond_rounding(self):
        """Channels of whose residual rounding is the lesser part; all, where it is the larger part of each."""
        energy = (self.residual ** 2).sum(1)
        mine = np.max([(r ** 2).sum(1) for r in self.roundings], axis=0) if len(self.roundings) else 0.0 * energy
        return mine < 0.5 * energy if (mine < 0.5 * energy).any() else np.ones(len(energy), dtype=bool)

    def drives(self, weights, residual, some=None):
        """Products of each wave, or of some, with a residual and with itself: an ndarray of shape (waves, 2, n)."""
        waves = self.waves if some is None else [self.waves[k] for k in some]
        found = np.empty((residual.shape[1], len(waves), 2))  # sample by sample, as they are added up
        for k, wave in enumerate(waves):
            weighted = weights * wave
            found[:, k, 0], found[:, k, 1] = (weighted * residual).sum(0), (weighted * wave).sum(0)
        return found.transpose(1, 2, 0)

    def telling(self, name):
        """Waves whose size over a variable is a law: of time a friction's alone, for slow noise is one too.

        Where a friction has another sign after each turn, such noise goes on.
        """
        own = [k for k, friction in enumerate(self.frictions) if friction]
        return own if name == "time" and own and not self.dataset.paired else range(len(self.waves))

    def may_last(self, name):
        """Whether slow noise, which goes on from block to block, would show in what tells of a variable."""
        return name == "time" and (self.dataset.paired or not any(self.frictions))

    def by_chance(self, drives, energy, share):
        """Part of the flips of the blocks' signs in which some wave and variable takes as much of the energy."""
        count, folds = self.label.max() + 1, self.fold.max() + 1
        fold = np.zeros(count, dtype=int)
        fold[self.label] = self.fold
        signs = np.random.default_rng(count).choice((-1.0, 1.0), (FLIPS, count))
        most = np.zeros(FLIPS)
        for name, bins in ((n, b) for n, every in self.bins.items() for b in every):
            if not self.may_last(name):
                k = bins.max() + 1
                for xy, xx in (drives[i] for i in self.telling(name)):
                    own = np.bincount(self.label * k + bins, xy, count * k).reshape(count, k)
                    squares = np.bincount(self.fold * k + bins, xx, folds * k).reshape(folds, k)
                    sums = np.stack([signs[:, fold == f] @ own[fold == f] for f in range(folds)], 1)
                    most = np.maximum(most, _taken(sums, squares)[0].sum((1, 2)) / energy)
        return (1 + np.count_nonzero(most >= share)) / (1 + FLIPS)

    def told(self, chosen, laws):
        """Whether correlated noise would not do as much as some wave times a function of bins, by `CHANCE`."""
        noise = [n for n, c in zip(self.noise, chosen) if c]
        seen = Whitened(noise, self.problem.chain, self.residual[chosen])
        count = sum(len(self.telling(name)) * len(every) for name, every in self.bins.items())
        for _, k, bins in sorted(laws, key=lambda law: -law[0]):
            cells = bins == np.arange(bins.max() + 1)[:, None]
            if seen.chance(wave * cells for wave in self.waves[k][chosen]) < CHANCE / count:
                return True
        return False

    def removed(self, drives, bins, energy):
        """Share of the energy that each wave times a function of bins removes out of fold, and its standard errors.

        A bin's factor beta on a wave takes ``beta (2 xy - beta xx)`` of the energy.
        """
        count, k, n = self.label.max() + 1, bins.max() + 1, len(bins)
        of_block = np.zeros(count, dtype=int)
        of_block[self.label] = self.fold
        cells = csc_array((np.ones(n), self.label * k + bins, np.arange(n + 1)), shape=(count * k, n))
        own = (cells @ drives.transpose(2, 0, 1).reshape(n, -1)).reshape(count, k, len(drives), 2)
        xy, xx = own.transpose(3, 2, 0, 1)
        folds = (np.arange(of_block.max() + 1)[:, None] == of_block) * 1.0
        beta = _taken(folds @ xy, folds @ xx)[1][:, of_block]
        blocks = (beta * (2 * xy - beta * xx)).sum(2)
        spread = np.sqrt(count * blocks.var(1, ddof=1)) if count > 1 else np.full(len(blocks), np.inf)
        return [*zip(blocks.sum(1) / energy, blocks.sum(1) / (spread + 1e-300))]


def stretches(dataset, problem):
    """Stretches of the data that predict each other: blocks, or passes where a short log has few blocks.

    Parameters
    ----------
    dataset : Dataset
        Its logs are arranged for a fit.
    problem : Residuals
        Its samples are labelled.

    Returns
    -------
    label, fold : ndarray of int, shape (n,)
        Stretch and fold of each sample.
    """
    blocks, label = np.unique(problem.block, return_inverse=True)
    if len(blocks) >= ENOUGH:
        return label, dataset.fold[blocks][label]
    label = np.unique(problem.group, return_inverse=True)[1]
    return label, label % FOLDS


def _dependence(given, chosen, whole=False):
    """What the chosen channels depend on, together."""
    weights = given.weights * chosen[:, None]
    energy = float((weights * given.residual ** 2).sum())
    if energy <= 0.0:
        return Dependence([], False)
    drives = given.drives(weights, given.residual)
    beyond = 1.0 - BROAD * max(((weights * r ** 2).sum() / energy for r in given.roundings), default=0.0)
    found, sure, most, mild = [], [], (0.0, None), (0.0, 0, None)
    for name, bins in ((n, b) for n, every in given.bins.items() for b in every):
        tried = given.removed(drives, bins, energy)
        k = max(given.telling(name), key=lambda i: tried[i][0])
        share, errors = tried[k]
        if share > RELEVANT and len(given.roundings):  # a sawtooth is a function of its angle
            share -= max(given.removed(given.drives(weights, r, [k]), bins, energy)[0][0] for r in given.roundings)
            share = min(share, beyond)
        found.append({"variable": name, "strength": max(0.0, float(share))})
        sure += [(share, k, bins)] if errors > ALARM and share > RELEVANT else []
        mild = mild if given.may_last(name) else max(mild, (share, k, bins), key=lambda m: m[0])
        most = max(most, (share, (k, bins)), key=lambda m: m[0])
    if not sure and mild[0] > SHARE and given.by_chance(drives, energy, mild[0]) <= RARE:
        sure = [mild]
    sure = given.told(chosen, sure)
    if whole and not given.dataset.paired and not given.dataset.averaged:
        sure |= _comes_and_goes(given, weights, drives, most, energy, found)
    strongest = {}
    for entry in sorted(found, key=lambda e: -e["strength"]):
        strongest.setdefault(entry["variable"], {**entry, "strength": round(entry["strength"], 4)})
    found = [strongest[name] for name in given.bins]
    return Dependence(_ordered(given.dataset, found), bool(sure))


def _comes_and_goes(given, weights, drives, most, energy, found):
    """Whether friction comes and goes with time alone; tells the strength of time so."""
    left = _without(given.residual, given.waves, drives, most)
    frictions = [w for w, friction in zip(given.waves, given.frictions) if friction]
    share, errors = max((_bursts(left, w, weights, given.problem, energy) for w in frictions), default=(0.0, 0.0))
    for entry in found:
        if entry["variable"] == "time":
            entry["strength"] = max(entry["strength"], share)
    return share > RELEVANT and errors > ALARM


def _ordered(dataset, found):
    """Most first; of variables that follow from each other, the angle before what it causes."""
    angles = {e["variable"] for e in found if _is_angle(dataset, e["variable"])}
    channels = {n for n, c in dataset.study.columns.items() if c.variable in dataset.outputs}

    def order(entry):
        name = entry["variable"]
        return -entry["strength"] * (1.02 if name in angles else 0.9 if name in channels else 1.0)
    return sorted(found, key=order)


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


def _is_angle(dataset, name):
    """Whether a variable is the angle, or the way, of a segment."""
    columns = dataset.study.columns
    return name.startswith("angle@") or name in columns and columns[name].variable.endswith("phi")


def _even(values, count):
    """Bin numbers of equally wide bins."""
    low, high = np.quantile(values, [0.002, 0.998])
    return np.clip((values - low) / max(high - low, 1e-300) * count, 0, count - 1).astype(int)


def _bins(values):
    """Bin numbers: half of the edges fill the bins equally, half are equally wide, for what is mostly near a value."""
    equal = np.quantile(values, np.linspace(0, 1, BINS // 2 + 1)[1:-1])
    wide = np.linspace(*np.quantile(values, [0.002, 0.998]), BINS // 2 + 1)[1:-1]
    return np.searchsorted(np.unique(np.r_[equal, wide]), values)


def _taken(sum_xy, sum_xx):
    """What bins take of the energy out of fold, and the factors that the other folds give them: (.., folds, bins)."""
    others_xy, others_xx = (v.sum(-2, keepdims=True) - v for v in (sum_xy, sum_xx))
    beta = others_xy / (others_xx + 1e-3 * sum_xx.sum((-2, -1), keepdims=True) / sum_xx.shape[-1] + 1e-300)
    return beta * (2 * sum_xy - beta * sum_xx), beta


def mirrored(dataset, model, fit):
    """Whether the slow error goes on where some segment turns, as noise does, or changes its sign, as a friction does.

    Parameters
    ----------
    dataset : Dataset
        All its passes are looked at.
    model : Model
        That was fitted.
    fit : Fit
        Of that model.

    Returns
    -------
    dict of str to (bool or None, bool)
        By channel, whether it does not go on, None where nothing turns often enough to say; and whether it surely
        changes its sign.
    """
    view = dataset.view("all")
    residual = dataset.residuals(model, fit.free, fit.parameters, "all").residual(fit.values)
    time, run, told = dataset.time[view], dataset.run[view], []
    far = int(BESIDE / max(np.median(np.abs(np.diff(time))), 1e-9)) + 1
    for way in np.sign(dataset.speeds[:, view]):
        sides = []
        for k in np.flatnonzero((way[1:] * way[:-1] < 0) & (run[1:] == run[:-1]) & (np.diff(time) < PAUSE)):
            ends = [(k, np.arange(max(k - far, 0), k + 1)), (k + 1, np.arange(k + 1, min(k + far + 2, len(time))))]
            near = [i[(np.abs(time[i] - time[at]) < BESIDE) & (run[i] == run[at]) & (way[i] == way[at])]
                    for at, i in ends]
            if min(map(len, near)) >= FEW:
                sides.append([residual[:, i].mean(1) for i in near])
        if len(sides) >= TURNS:
            one, two = np.swapaxes(sides, 0, 1)
            both = (one * two).sum(0)
            told.append((both / np.sqrt((one**2).sum(0) * (two**2).sum(0) + 1e-300),
                         both / np.sqrt(((one * two) ** 2).sum(0) + 1e-300)))
    if not told:
        return dict.fromkeys(dataset.channels, (None, False))
    least = np.min(told, axis=0).T
    return {c: (bool(alike < AGREE), bool(errors < -OPPOSED)) for c, (alike, errors) in zip(dataset.channels, least)}

"""A fitted effect in; whether its coefficient is the same all over the data, or only an average of another law, out.

What an effect adds to the residual is multiplied by a straight line of one variable after the other, of its magnitude,
and by a free function. A law that is right gains nothing by that; one that stands in for another law gains, on passes
that the function was not fitted to, much of what it has taken away itself. Where it acts at several segments, what each
of them adds is multiplied by a line of its own load, speed or angle as well.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from ..compile import compile_model, component_name, places
from ..data.instruments import rounding
from ..fit.bounded import bounded
from .crossval import difference
from .dependence import AGAIN, FOLDS, SAMPLES, explanations
from .rivals import ALIKE, SEPARATE
from .whitened import CHANCE, Whitened

LEVELS, PARTS = 8, 64  # of a variable, over which the coefficient may differ, and of its range
LACK = 0.02
"""Of what an effect takes away, that it may gain where its coefficient varies. Of 105 right laws, in logs of 35 kinds,
100 gained nothing by a straight line, the others 0.006 to 0.03; what stood in for another mostly 0.05 to 2, a viscosity
that is one of speed times load 0.021, 0.033 and 0.036."""
GUESSED = 0.25
"""The same of an effect from a file of the study's own: a guess of a law's shape differs from the law by intent."""
SURE, FREE = 2.5, 4.0
"""Standard errors over short stretches by which a coefficient on a straight line must predict unseen ones better, and
one that is a free function. Three of those 72 right laws gained 0.04 to 0.15 by a free function, at 3.1 to 3.6 of
them. A straight line tells a viscosity that is one of speed times load at 4.1, a free function at 3.9, and the
same signal at other times gains as much by that. Three errors were asked of a line before `CHANCE` was: a drag one way
in the place of which a viscosity one way stood had 2.9. Of 54 right laws one has more than 1.5 of what passes it."""
OWNS = "load", "speed", "angle"
"""Variables of a segment on which its law may depend otherwise than the effect has it. For a viscosity that is one of
speed times load, at both first stages, the largest gain by the load of one of them was 0.0045, at 2.8 standard errors,
and is 0.032 by that of each, at 7.4. Eleven right laws at two segments gained 0.037 at most so, and none of them beyond
2.2 standard errors."""
PIECES = 100
"""Stretches that the data are cut into. A fold of whole blocks leaves out what one of them alone shows: the fastest
stride of a gait is one of thirty, and holds half of what a law of the speed adds."""
BOTH = 0.1  # of the samples, at which a variable must have either sign for its magnitude to be another
OWN = 0.1
"""Of what an effect adds, that some variable and direction must explain for a law of that variable to be mistaken for
it. A ripple of hundreds of cycles, or a lag, looks like nothing else, even where its size varies."""
PLACEBOS, OTHER = 19, 0.5
"""Signals that the effect's own is compared with, itself at other times, and how much one may be like it. Beside
something else that is missing a free function catches some of that whatever it multiplies, and on unseen passes too
where the machine repeats its motion. Of 19, one is above the rest by chance in 5 % of the cases."""
TINY = 1e-9  # of a slope's own square, that keeps what the data do not tell where it is
CENTRE = 0.455  # median of the square of a normal variable


@dataclass
class Constancy:
    """What an effect would gain if its coefficient varied.

    Attributes
    ----------
    gain : float
        Share of the squared error left that it would take on unseen blocks or passes; 0.0 where none is sure.
    variable : str or None
        Over which it would vary.
    follows : dict of str to float
        Share of what the effect adds that is a function of each variable and a direction.
    """

    gain: float = 0.0
    variable: str | None = None
    follows: dict = field(default_factory=dict)

    def short(self, effect, before, after):
        """What it would gain, over how much of what the effect takes it may gain.

        Parameters
        ----------
        effect : Effect
            Whose coefficients may vary.
        before, after : Selection
            Without the effect and with it.

        Returns
        -------
        float
            More than one where the coefficient is not the same all over the data.
        """
        takes = difference(before.raw, after.raw)[0]
        return float(self.gain * after.raw.sum() / (allowed(effect) * max(takes, 1e-300)))


def allowed(effect):
    """How much of what an effect takes it may gain where its coefficient varies.

    Parameters
    ----------
    effect : Effect
        One of the library, or a guess in a file of its own, of which less is asked.

    Returns
    -------
    float
    """
    return LACK if effect.model.startswith("DriveTrain.") else GUESSED


def constancy(dataset, model, fit, seed=0):
    """Whether the coefficients of a model's effects are the same all over the data.

    Both laws, the one with the coefficient and the one with a coefficient a level, are fitted together with all other
    free parameters to four fifths of short stretches, and compared on the last: what the others have already bent to
    would hide most of the difference.

    Parameters
    ----------
    dataset : Dataset
        Its fit part is looked at.
    model : Model
        With the effects whose coefficients may vary.
    fit : Fit
        Of that model.
    seed : int
        Of the roundings whose share is taken off.

    Returns
    -------
    dict of (str, str) to Constancy
        By effect and place.
    """
    slope, left, index, pieces, thin, chain = _seen(dataset, model, fit)
    weighed = [replace(n, white=w * n.white, slow=w * n.slow) for n, w in zip(fit.noise, fit.weights)]
    whitened = Whitened(weighed, chain, left, slope)
    values = explanations(dataset, model, fit, index)
    bins = {n: levels(v) for n, v in values.items()}
    drawn, rng = rounding(dataset, model, fit), np.random.default_rng(seed)
    roundings = [fit.weights[:, None] * drawn(rng)[:, ::thin] for _ in range(AGAIN)] if drawn else []
    found, energy = {}, float((left ** 2).sum())
    for effect, place in model.attached:
        added = _added(model, fit, effect, place, slope)
        found[effect.id, place.name] = best = Constancy(follows=_follows(added, values, bins))
        if max(best.follows.values(), default=1.0) < OWN:
            continue
        tried = [_Law(n, sure, {n: added}, {n: function}) for n in values for sure, function in (
            *((SURE, _straight(v)) for v in _sided(values[n])), (FREE, _free(bins[n])))]
        tried += _own_lines(values, _parts(dataset, model, fit, effect, place, thin))
        gain, best.variable = _most(_Laws(added, slope, pieces), tried, left, roundings, rng, whitened)
        best.gain = gain / energy
    return found


@dataclass
class _Law:
    """An effect with a coefficient that varies: what each part of it adds, times its functions, shape (any, n)."""

    name: str
    sure: float
    parts: dict
    functions: dict

    def varied(self, shift=0):
        """What it adds, a function each, or what it would at other times: shape (channels, any, n)."""
        return sum(np.roll(a, shift, axis=1)[:, None] * self.functions[k] for k, a in self.parts.items())


def _most(laws, tried, left, roundings, rng, whitened):
    """The largest gain that is sure, and more than placebos', less what rounding may make of it; and its variable."""
    asked = [(*laws.gain(left, law.varied()), law) for law in tried]
    for gain, _, law in sorted((t for t in asked if t[1] > t[2].sure), key=lambda t: -t[0]):
        if gain <= 0.0:
            break
        varied = law.varied()
        if whitened.chance(varied) > CHANCE / len(tried):
            continue
        others = _placebos(laws, left, law, rng)
        # a sawtooth is a function of its angle whatever it is multiplied by
        rounded = max((max(laws.gain(r, varied)[0], 0.0) for r in roundings), default=0.0)
        beyond = gain - np.median(others or [0.0]) - rounded
        if gain > max(others, default=0.0) and beyond > 0.0:
            return float(beyond), law.name
    return 0.0, None


def _parts(dataset, model, fit, effect, place, thin):
    """What an effect adds at each of several segments; nothing where it acts at one, or may not act at each alone."""
    names = [model.segments[c] for c in place.components if c in model.segments]
    single = {p.name: p for p in places(dataset.library, model.rig, effect) if p.name in names}
    if not 1 < len(names) == len(place.components) == len(single):
        return {}
    others = [k for k in model.keys if k != (effect.id, place.name)]
    apart = compile_model(dataset.library, model.rig, [*others, *((effect.id, n) for n in names)])
    whole, values, sizes = component_name(effect, place), dict(fit.parameters), _sizes(model, fit, effect, place)
    bases = {n: component_name(effect, single[n]) for n in names}
    for base in bases.values():
        values |= {base + c[len(whole):]: v for c, v in fit.parameters.items() if c.startswith(whole + ".")}
    found = {}
    for n, base in bases.items():
        free = [base + c[len(whole):] for c in sizes]
        slope = _slopes(dataset, apart, fit.weights, free, values, [values[f] for f in free], thin)
        found[n] = sum(slope[:, k] * size for k, size in enumerate(sizes.values()))
    return found


def _slopes(dataset, model, weights, free, parameters, x, thin):
    """Derivatives by signals without noise, in units of the weights: shape (channels, free, n)."""
    problem = dataset.residuals(model, free, parameters, "fit", dataset.exogenous()).thin(thin)
    return weights[:, None, None] * np.concatenate([j for _, _, j in problem.blocks(np.asarray(x))], axis=2)


def _own_lines(values, parts):
    """Laws whose coefficient is, at each segment, a straight line of one variable of that segment, or its magnitude."""
    found = []
    for kind in OWNS if parts else ():
        own = {n: _sided(values[f"{kind}@{n}"]) for n in parts if np.ptp(values.get(f"{kind}@{n}", 0.0)) > 0}
        if len(own) == len(parts):
            found += [_Law(f"{kind}@{next(iter(own))}", SURE, parts, {n: _straight(v[k]) for n, v in own.items()})
                      for k in range(min(map(len, own.values()))) if all(np.ptp(v[k]) > 0 for v in own.values())]
    return found


def as_good_a_law(dataset, before, after, key):
    """Whether an effect whose coefficient is a straight line of some variable predicts as well as with further effects.

    A friction of speed times load, in a motion whose loads differ between the ways, is a viscosity and another one that
    differs between them: two effects, each of which is the same all over the data. So is the viscosity alone that grows
    with the load, and no more than that is known then. Both are fitted to four fifths of short stretches, with all that
    is free before and within its bounds, and compared on the last; each as linear as its model is where it was fitted.

    Parameters
    ----------
    dataset : Dataset
        Its fit part is looked at.
    before, after : (Model, Fit)
        With the effect and without the further ones, and with them.
    key : (str, str)
        Effect and place.

    Returns
    -------
    bool
        Unseen stretches do not tell some such law from the further effects, as of two rivals.
    """
    (model, fit), (larger, found) = before, after
    slope, left, index, pieces, thin, _ = _seen(dataset, model, fit)
    effect, place = next(a for a in model.attached if (a[0].id, a[1].name) == key)
    added, own = _added(model, fit, effect, place, slope), component_name(effect, place)
    values = explanations(dataset, model, fit, index)
    if max(_follows(added, values, {n: levels(v) for n, v in values.items()}).values(), default=1.0) < OWN:
        return False
    room, scale = _room(fit, own), (fit.weights / found.weights)[:, None]
    slopes, rest = _seen(dataset, larger, found)[:2]
    none = _unseen(slope, left, pieces, room)
    other = _unseen(scale[..., None] * slopes, scale * rest, pieces, _room(found, own))
    takes, spread = difference(none, other)
    if takes <= SEPARATE * spread:
        return False
    lines = [_Law(n, SURE, {n: added}, {n: _straight(v)}) for n in values for v in _sided(values[n]) if np.ptp(v) > 0]
    for law in lines + _own_lines(values, _parts(dataset, model, fit, effect, place, thin)):
        behind, spread = difference(_unseen(np.concatenate([slope, law.varied()], axis=1), left, pieces, room), other)
        if behind <= SEPARATE * spread and behind < ALIKE * takes:
            return True
    return False


def _seen(dataset, model, fit):
    """Slopes by signals without noise and residual, by weights; samples, stretches, every how many, chain."""
    view = dataset.view("fit")
    problem = dataset.residuals(model, fit.free, fit.parameters, "fit")
    thin = max(1, problem.n // SAMPLES)
    problem, index = problem.thin(thin), (view.i if dataset.paired else view)[::thin]
    slope = _slopes(dataset, model, fit.weights, fit.free, fit.parameters, fit.values, thin)
    left = fit.weights[:, None] * problem.residual(fit.values)
    return slope, left, index, _pieces(problem.block), thin, problem.chain


def _room(fit, own):
    """How far each free parameter of a fit may go down and up; what an effect of that name has is not held.

    Without bounds the rest of a model may do what is missing, on a straight line of some variable at least: a gain of
    one motor on a line of its torque did what it does with an offset beside it, by losses below nothing.
    """
    bounds = np.array([(-np.inf, np.inf) if n.startswith(own + ".") else (fit.variables[n].min, fit.variables[n].max)
                       for n in fit.free])
    return (bounds - np.asarray(fit.values)[:, None]).T


def _unseen(slope, left, pieces, room):
    """Squares of a residual in each stretch, after a fit to the stretches of the other folds, within bounds.

    Columns of the slope beyond those of the room are free.
    """
    low, high = (np.r_[r, np.full(slope.shape[1] - len(r), end)] for r, end in zip(room, (-np.inf, np.inf)))
    fold, found = pieces % FOLDS, np.zeros(pieces.max() + 1)
    own = [fold == f for f in range(FOLDS)]
    normal = np.array([(slope[..., o] @ slope[..., o].swapaxes(1, 2)).sum(0) for o in own])
    side = np.array([np.einsum("ckn,cn->k", slope[..., o], left[:, o]) for o in own])
    for o, n, s in zip(own, normal.sum(0) - normal, side.sum(0) - side):
        error = left[:, o] + bounded(n, -s, low, high)[1] @ slope[..., o]
        found += np.bincount(pieces[o], (error ** 2).sum(0), len(found))
    return found


class _Laws:
    """A law with one coefficient and one whose coefficient varies, each beside all other free parameters.

    Products of what stays from one function to the next are made once; samples are sorted by fold for them.

    Parameters
    ----------
    added : ndarray, shape (channels, n)
        What the effect adds to the residual.
    slope : ndarray, shape (channels, free, n)
        Of the model by its free parameters, the effect's own among them.
    pieces : ndarray of int, shape (n,)
        Stretch of each sample; every `FOLDS`-th belongs to one fold.
    """

    def __init__(self, added, slope, pieces):
        fold = pieces % FOLDS
        self.order, ends = np.argsort(fold, kind="stable"), np.cumsum(np.bincount(fold, minlength=FOLDS))
        self.folds = [slice(b - size, b) for b, size in zip(ends, np.diff(ends, prepend=0))]
        self.added, self.pieces = added, pieces
        size = np.sqrt((slope ** 2).sum((0, 2)))
        self.slope = (slope[:, size > 0] / size[size > 0, None])[..., self.order]
        self.normal, self._lefts = self._moments(self.slope, self.slope), []

    def beside(self, other):
        """The laws of another signal, with that among the slopes as well."""
        size, laws = np.sqrt((other ** 2).sum()), copy(self)
        laws.added, laws._lefts = other, []
        row, p = other[:, None, self.order] / max(size, 1e-300), len(self.normal[0])
        laws.slope = np.concatenate([self.slope, row], axis=1)
        laws.normal = np.zeros((FOLDS, p + 1, p + 1))
        laws.normal[:, :p, :p] = self.normal
        laws.normal[:, p] = self._moments(row, laws.slope)[:, 0]
        laws.normal[:, :, p] = laws.normal[:, p]
        return laws

    def _moments(self, one, other):
        """Products of columns, fold by fold: (folds, k, m)."""
        return np.array([(one[..., f] @ other[..., f].swapaxes(1, 2)).sum(0) for f in self.folds])

    def _first(self, left):
        """A residual sorted by fold, its products with the slopes, its noise, and what the first law leaves unseen."""
        for known in self._lefts:
            if known[0] is left:
                return known[1:]
        row = left[:, self.order]
        side = self._moments(self.slope, row[:, None])[..., 0]
        one = [row[:, f] - np.linalg.solve(n + TINY * np.eye(len(n)), s) @ self.slope[..., f] for f, n, s in zip(
            self.folds, self.normal.sum(0) - self.normal, side.sum(0) - side)]
        self._lefts.append((left, row, side, self._noise(left), one))
        return self._lefts[-1][1:]

    def gain(self, left, varied):
        """What the second law takes more of a residual than the first, unseen, and how many standard errors that is.

        ``varied``, shape (channels, any, n), make the second beside the first.
        """
        count, p = varied.shape[1], self.slope.shape[1]
        row, told, noise, first = self._first(left)
        varied = varied[..., self.order]
        normal = np.zeros((FOLDS, p + count, p + count))
        normal[:, :p, :p] = self.normal
        normal[:, :p, p:] = self._moments(self.slope, varied)
        normal[:, p:, :p] = normal[:, :p, p:].swapaxes(1, 2)
        normal[:, p:, p:] = self._moments(varied, varied)
        side = np.concatenate([told, self._moments(varied, row[:, None])[..., 0]], axis=1)
        # where it varies it may by about the coefficient itself: by no more than the data of that can tell
        prior = np.diag(np.r_[np.full(p, TINY), np.full(count, np.median(noise))])
        gain = square = 0.0
        for f, one, n, s in zip(self.folds, first, normal.sum(0) - normal, side.sum(0) - side):
            x = np.linalg.solve(n + prior, s)
            other = row[:, f] - x[:p] @ self.slope[..., f] - x[p:] @ varied[..., f]
            gain += float((one ** 2 - other ** 2).sum())
            square += float(((one - other) ** 2 * noise[self.pieces[self.order[f]]]).sum())
        return gain, gain / (2.0 * np.sqrt(square) + 1e-300)

    def _noise(self, left):
        """Variance of the noise in each piece as a slow function meets it.

        The coefficient's scores in most pieces tell it; by how much more a piece has, differences of neighbours do. The
        scatter of the pieces' own gains would not: where one of them gains it all, it is as large as the gain.
        """
        xy = np.bincount(self.pieces, (self.added * left).sum(0))
        xx = np.bincount(self.pieces, (self.added ** 2).sum(0))
        seen = xx > 0.1 * np.median(xx)
        usual = float(np.median(xy[seen] ** 2 / xx[seen]) / CENTRE)
        steps = np.diff(left, append=left[:, -1:])
        size = np.bincount(self.pieces, (steps ** 2).sum(0)) / np.bincount(self.pieces)
        return usual * np.maximum(1.0, size / (np.median(size) + 1e-300)) + 1e-9 * xx.sum()


def _placebos(laws, left, law, rng):
    """Gains of signals that have nothing to do with the effect: its own at other times."""
    n, own, found = laws.added.shape[1], sum(law.parts.values()), []
    size = (own ** 2).sum()
    for shift in rng.permutation(np.linspace(0.02, 0.98, 4 * PLACEBOS)):
        other = np.roll(own, int(n * shift), axis=1)
        if abs((other * own).sum()) > OTHER * size:
            continue
        found.append(laws.beside(other).gain(left, law.varied(int(n * shift)))[0])
        if len(found) == PLACEBOS:
            break
    return found


def _follows(added, values, bins):
    """Share of a signal's energy that is a function of each variable and one direction, in the channel of most."""
    energy = np.maximum((added ** 2).sum(1), 1e-300)
    directions = [(v > 0).astype(int) for n, v in values.items() if n.startswith("speed@")] or [0]

    def share(row, cells):
        return float((np.bincount(cells, row) ** 2 / np.maximum(np.bincount(cells), 1)).sum())
    return {name: max(share(row, 2 * cells + d) / of for row, of in zip(added, energy) for d in directions)
            for name, cells in bins.items()}


def _pieces(block):
    """Stretches of consecutive samples, about `PIECES` in all, each within one block."""
    starts = np.flatnonzero(np.r_[True, np.diff(block) != 0])
    within = np.arange(len(block)) - np.repeat(starts, np.diff(np.r_[starts, len(block)]))
    new = (within % max(1, len(block) // PIECES)) == 0
    return np.cumsum(new) - 1


def _sided(values):
    """A variable, and its magnitude where it has both signs: a loss cares for the size of a load or a speed."""
    found = [values, np.abs(values)]
    return found if min(np.mean(values > 0), np.mean(values < 0)) > BOTH else found[:1]


def _straight(values):
    """A variable from its mean, in units of its spread: shape (1, n)."""
    return ((values - values.mean()) / values.std())[None]


def _free(cells):
    """One function a level, which is one there and nothing elsewhere: shape (levels, n)."""
    return cells == np.arange(cells.max() + 1)[:, None]


def levels(values):
    """Levels of a variable that as many samples share, none finer than a part of its range.

    Speeds that are meant to be the same differ by what the rounding of an angle makes of them, and that is in the
    residual of an encoder too.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Of one variable, in its unit.

    Returns
    -------
    ndarray of int, shape (n,)
    """
    low, high = np.quantile(values, [0.002, 0.998])
    coarse = np.rint(values / max((high - low) / PARTS, 1e-300))
    return np.searchsorted(np.unique(np.quantile(coarse, np.linspace(0, 1, LEVELS + 1)[1:-1])), coarse)


def _sizes(model, fit, effect, place):
    """How far the sizes of an effect are from where it does nothing, by parameter; without any, its coefficients."""
    base = component_name(effect, place) + "."
    own = [n for n in fit.free if n.startswith(base)]
    sized = [n for n in own if n[len(base):] in effect.size] or own
    return {n: fit.parameters[n] - model.parameters[n].value for n in sized}


def _added(model, fit, effect, place, slope):
    """What an effect adds to each channel, as far as it is linear in its sizes."""
    return sum(slope[:, fit.free.index(n)] * size for n, size in _sizes(model, fit, effect, place).items())

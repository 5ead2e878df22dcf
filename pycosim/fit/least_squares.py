"""Data set and model in, parameters with intervals, and what the data cannot tell, out.

The fit is a bounded nonlinear least-squares problem. Its residual enters only through the moments [J r]'[J r], which
are summed block by block, so memory does not grow with the log and a solver for small problems serves logs of any
length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.optimize import linprog
from scipy.special import stdtrit  # quantiles of Student's t; scipy.stats takes half a second to import

from ..compile import component_name
from ..core.errors import NoAnswerError
from ..data.noise import fit_noise
from ..data.parameters import phases
from ..data.residuals import add_moments, huber
from ..data.scatter import weights as channel_weights
from . import late
from .bounded import NULL, bounded
from .damped import ENOUGH, listed, solve
from .moments import Moments

NEAR = 1e-5  # of the squares of a few thousand samples, below which a step is left to those of all: noise tells no more
HALVES = 12  # by which a size that changes nothing is brought to where it does
MARGIN = 1e-6  # of the nominal value, that a fit keeps from its bounds: there derivatives are two-sided


@dataclass
class Fit:
    """Result of an identification.

    Attributes
    ----------
    parameters : dict of str to float
        All parameters, fitted and fixed.
    free : list of str
        Parameters that were fitted, in the order of every vector and matrix here.
    variables : dict of str to Variable
        Units and bounds.
    values : ndarray, shape (p,)
        Of ``free``, in the parameters' units, within the bounds.
    unbounded : ndarray, shape (p,)
        Estimate with the bounds lifted, of the quadratic model at the solution; intervals are centred on it.
    covariance : ndarray, shape (p, p)
        Of ``free``, in products of their units; what is not determined has no share in it.
    null_directions : ndarray, shape (k, p)
        Directions of the parameters that change no residual.
    dof : float
        Degrees of freedom for the quantile of the intervals.
    noise : list of Noise
        One a channel.
    channels : list of str
        That were compared, as ``C_H``.
    weights : ndarray, shape (channels,)
        One over the noise of each channel, their geometric mean one.
    conditional : bool
        Whether something is known to be missing beside it: its intervals hold if that is the same all over the data.
    own : dict of str to list of str
        Parameters with a value of their own in each run, and the names of those values among ``free``; under its own
        name such a parameter has their mean, for runs that were not fitted.
    turning : list of str
        Phases of ripples, whose mean is that of directions. Of a run that is held out the phase is that which leaves
        least there: nothing else tells it.
    apart : dict of str to float
        Values that the data rule out although an interval, which takes the model as straight, reaches beyond them: of a
        product, one factor may have any size but none at all. Intervals end there.
    profiles : dict of str to pycosim.fit.late.Ends
        Of delays, what the likelihood says of them, which has no parabola where a torque jumps.
    """

    parameters: dict
    free: list
    variables: dict
    values: np.ndarray
    unbounded: np.ndarray
    covariance: np.ndarray
    null_directions: np.ndarray
    dof: float
    noise: list
    channels: list
    weights: np.ndarray
    error: dict = field(default_factory=dict)
    conditional: bool = False
    apart: dict = field(default_factory=dict)
    profiles: dict = field(default_factory=dict)
    own: dict = field(default_factory=dict)
    turning: list = field(default_factory=list)

    @property
    def stderr(self):
        """Standard errors, infinite along null directions."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self):
        """Correlation matrix of the estimates."""
        s = np.where(self.stderr > 0, self.stderr, 1.0)
        return self.covariance / np.outer(s, s)

    def identifiable(self, name):
        """Whether the data determine this parameter by itself.

        Parameters
        ----------
        name : str
            A free parameter.

        Returns
        -------
        bool
        """
        k = self.free.index(name)
        scale = np.array([self.variables[n].nominal for n in self.free])
        return not any(abs(d[k] / scale[k]) > 1e-4 * np.max(np.abs(d / scale)) for d in self.null_directions)

    def at_bound(self, name):
        """Bound that a free parameter is at.

        Parameters
        ----------
        name : str
            Among ``free``.

        Returns
        -------
        str or None
            ``"min"`` or ``"max"``.
        """
        k, v = self.free.index(name), self.variables[name]
        tolerance = 2 * MARGIN * v.nominal  # a fit stops at the margin, but for rounding
        if self.values[k] <= v.min + tolerance:
            return "min"
        return "max" if self.values[k] >= v.max - tolerance else None

    def interval(self, name, level=0.95):
        """Confidence interval of a parameter, within its bounds.

        Centred on the estimate with the bounds lifted, so that a neighbour at its bound does not make it too narrow.
        Along a null direction: what the bounds alone allow.

        Parameters
        ----------
        name : str
            A free parameter.
        level : float
            Probability that it holds the parameter.

        Returns
        -------
        list of float
            Lower and upper end, in the parameter's unit.
        """
        k, v = self.free.index(name), self.variables[name]
        if not self.identifiable(name):
            return self._cut(name, *self._range_by_bounds(k, level))
        half = stdtrit(self.dof, 0.5 + level / 2) * self.stderr[k]
        low, high = self.unbounded[k] - half, self.unbounded[k] + half
        if high < v.min:
            high = v.min + half
        if low > v.max:
            low = v.max - half
        low, high = min(low, self.values[k]), max(high, self.values[k])
        if name in self.profiles:
            grown = stdtrit(self.dof, 0.5 + level / 2) / stdtrit(self.dof, 0.975)
            told = self.profiles[name]
            ends = [self.values[k] + grown * (end - self.values[k]) for end in (told.low, told.high)]
            low, high = max(min(low, ends[0]), told.least), min(max(high, ends[1]), told.most)
        return self._cut(name, float(max(low, v.min)), float(min(high, v.max)))

    def _cut(self, name, low, high):
        """An interval without what lies beyond a value that is ruled out."""
        if name in self.apart:
            end = self.apart[name]
            low, high = (max(low, end), high) if self.parameters[name] > end else (low, min(high, end))
        return [low, high]

    def between_runs(self, name):
        """How much a parameter with a value of its own in each run differs between them.

        Parameters
        ----------
        name : str
            One of ``own``.

        Returns
        -------
        float
            Standard deviation of the fitted values, in the parameter's unit: what an unseen run may be off its mean.
            Of phases, the shorter way round. NaN where one run alone was fitted.
        """
        if len(self.own[name]) < 2:
            return float("nan")
        away = np.array([self.parameters[n] for n in self.own[name]])
        if name in self.turning:
            away = np.angle(np.exp(1j * (away - self.parameters[name])))
        return float(np.std(away, ddof=1))

    def unseen(self, name):
        """Values of a phase in the runs that were not fitted, each found from its run: nothing else tells it.

        Parameters
        ----------
        name : str
            A parameter of `own`.

        Returns
        -------
        dict of str to float, or None
            By their names; None of a parameter whose mean stands for such runs.
        """
        if name not in self.turning:
            return None
        return {n: v for n, v in self.parameters.items() if n.startswith(f"{name}[") and n not in self.own[name]}

    def draw(self, n, bounded=True, seed=0):
        """Parameter sets that the data allow, for simulators that vary their machines.

        Parameters
        ----------
        n : int
            How many.
        bounded : bool
            Respect the bounds, and spread along null directions within them; or neither.
        seed : int
            The same seed gives the same sets.

        Returns
        -------
        pycosim.fit.draws.Draws
        """
        from .draws import draw
        return draw(self, n, bounded, seed)

    def _range_by_bounds(self, k, level):
        """Least and greatest value that some point along the null directions takes within all bounds."""
        low = np.array([self.variables[n].min for n in self.free]) - self.values
        high = np.array([self.variables[n].max for n in self.free]) - self.values
        d = self.null_directions / np.maximum(np.max(np.abs(self.null_directions), axis=1, keepdims=True), 1e-300)
        d = np.where(np.abs(d) < 1e-7, 0.0, d)
        ends = []
        for sign in (1.0, -1.0):
            found = linprog(sign * d[:, k], np.vstack([d.T, -d.T]), np.r_[high, -low], bounds=(None, None))
            if not found.success:
                return [float(self.variables[self.free[k]].min), float(self.variables[self.free[k]].max)]
            move = found.x @ d
            ends.append(self.values[k] + move[k] - sign * self._spread_there(k, move, low, high, level))
        v = self.variables[self.free[k]]
        return [float(max(ends[0], v.min)), float(min(ends[1], v.max))]

    def _spread_there(self, k, move, low, high, level):
        """Half width of the interval of a parameter where its partner on the null direction is at a bound."""
        room = np.minimum(np.abs(move - low), np.abs(high - move)) + np.where(np.abs(move) < 1e-9, math.inf, 0.0)
        room[k] = math.inf
        j = int(np.argmin(room))
        if not np.isfinite(room[j]) or abs(move[j]) < 1e-9:
            return 0.0
        c = np.zeros(len(self.free))
        c[k], c[j] = 1.0, -move[k] / move[j]
        return stdtrit(self.dof, 0.5 + level / 2) * math.sqrt(max(c @ self.covariance @ c, 0.0))


def fit(dataset, model, start=None, free=None, part="fit", robust=None, most=None, noise=None, held=()):
    """Fit a model's free parameters to a data set.

    Parameters
    ----------
    dataset : Dataset
        Its moving samples are compared.
    model : Model
        The rig with the effects to fit.
    start : dict of str to float, optional
        Values to start from; the study's by default.
    free : list of str, optional
        The study's free parameters, those of the attached effects included, by default.
    part : str or ndarray of int
        ``"fit"``, ``"test"``, ``"all"``, or the blocks to use.
    robust : bool, optional
        Weigh samples down that are far out (Huber); as the study says by default.
    most : int, optional
        Samples to use, evenly spread, for a quick trial; of fewer than twice as many, all are used.
    noise : list of Noise, optional
        Noise of each channel where it is known; estimated from the residual by default.
    held : list of str
        Parameters that stay where they start: those that are free are given a covariance, and not looked for.

    Returns
    -------
    Fit
        Of a model that filters a torque: to the samples at which the filter it finds has settled, where that leaves any
        out; see `Dataset.settled`.
    """
    chosen = free, part, robust, most, noise

    def again(data, parameters, still):
        return _fit(data, model, parameters, *chosen, still)
    found = again(dataset, start, held)
    looked = [n for n in late.delays(model) if n in found.free and n not in held]
    if looked:
        known = {n: v for n, v in (start or {}).items() if n in looked and v and most is None}
        found = late.found(dataset, model, found, looked, part, known, lambda *given: again(dataset, *given))
    settled = dataset if most else dataset.settled(model, found.parameters)  # rivals are tried on the same samples
    if settled is not dataset:
        found = replace(again(settled, found.parameters, [*held, *looked]), profiles=found.profiles)
    return found


def fit_without(dataset, model, start, **options):
    """Fit a model that lacks an effect, from where the effect had brought the parameters.

    Without it they may leave no motion, as a loss that grows with the load does without what took a part of it away.
    The rig's own then start from the study's values.

    Parameters
    ----------
    dataset : Dataset
        Its moving samples are compared.
    model : Model
        Without the effect.
    start : dict of str to float
        All parameters of the larger model, SI units.
    **options
        As for `fit`.

    Returns
    -------
    Fit
    """
    try:
        return fit(dataset, model, start, **options)
    except NoAnswerError:
        own = dataset.base.parameters
        return fit(dataset, model, {n: v for n, v in start.items() if n not in own}, **options)


def _fit(dataset, model, start, free, part, robust, most, noise, held):
    """Fit a model's free parameters to all samples of a part, those that are held staying where they start."""
    robust = dataset.study.robust if robust is None else robust
    variables = dataset.parameters.variables(model)
    parameters = {**{n: v.value for n, v in variables.items()}, **dataset.parameters.values(model), **(start or {})}
    free = dataset.parameters.free(model, start or ()) if free is None else list(free)
    own, turning = dataset.parameters.own(model), phases(model)
    for name in (n for runs in own.values() for n in runs.values()):  # what one run has and this fit does not
        if name not in free and name not in (start or {}):
            parameters.pop(name, None)
    problem = dataset.residuals(model, free, parameters, part)
    weights = channel_weights(dataset)
    x = np.array([_inside(parameters[n], variables[n]) for n in free])
    apart = [n for name in turning for n in own.get(name, {}).values() if n in free]
    x = _turned(problem, x, [n for n in apart if n not in (start or {})], weights, variables)
    skip = max(1, problem.n // most) if most else 1
    if skip > 1:
        problem = problem.thin(skip)
    tidy = dataset.residuals(model, free, parameters, part, dataset.exogenous())
    tidy = tidy.thin(skip) if skip > 1 else tidy
    near = {**variables, **{n: replace(variables[n], min=v - 2 * MARGIN * variables[n].nominal,
                                       max=v + 2 * MARGIN * variables[n].nominal)
                            for n, v in zip(free, x) if n in held}}
    refine = partial(_refine, problem, tidy, free=free, variables=near, weights=weights, segments=list(model.segments),
                     robust=robust, trial=most is not None)

    def told(x, moments):
        if moments is None:
            residual, slopes = problem.residual(x), [(part, slope) for part, _, slope in tidy.blocks(x)]
            gram = _crossed(slopes, residual, len(x), weights, robust)
            return x, np.concatenate([slope for _, slope in slopes], axis=2), residual, gram
        return x, *moments.slope_and_residual(x), moments.gram(x, weights, True)

    start, tried = x, [told(*refine(x))]
    for side in (1, -1) if (flat := _flat(tried[0][1], free, model)) else ():
        if (moved := _unstuck(tidy, start, side, flat, free, model)) is not start:
            tried.append(told(*refine(moved)))
    x, slope, residual, gram = min(tried, key=lambda found: found[-1][-1, -1])
    found = result(problem, slope, residual, gram, x, free, variables, weights, noise, robust)
    for k in (free.index(n) for n in held if n in free):  # what is left pulls at it, but not to where less is left
        found.unbounded[k] = found.values[k]
    found.turning = turning
    for name, runs in own.items():
        found.own |= {name: fitted} if (fitted := [n for n in runs.values() if n in free]) else {}
    for name in found.own:
        of_runs = [found.parameters[n] for n in found.own[name]]
        found.parameters[name] = around(of_runs) if name in turning else float(np.mean(of_runs))
    unseen = {name: [n for n in own[name].values() if n not in free] for name in turning if name in found.own}
    found.parameters |= _turned_to(dataset, model, found, unseen)
    return found


def _flat(slope, free, model):
    """Sizes of effects that change nothing, as beyond what a law allows of them: nothing pulls at them there."""
    sizes = {f"{component_name(e, p)}.{c}" for e, p in model.attached for c in e.size}
    return [k for k, n in enumerate(free) if n in sizes and not slope[:, k].any()]


def _unstuck(problem, x, side, flat, free, model):
    """A start where sizes that change nothing are nearer to none, by halves, until they do; or on the other side.

    The start itself where they change nothing however small, as a friction that has fallen before the slowest sample.
    """
    def felt(there, k):
        return any(own[:, k].any() for _, _, own in problem.blocks(there))

    for k in flat:
        none, own = model.parameters[free[k]].value, np.arange(len(x)) == k
        nearer = [np.where(own, none + side * half * (x[k] - none), x) for half in 0.5 ** np.arange(HALVES)]
        if felt(nearer[-1], k):
            x = next(there for there in nearer if felt(there, k))
    return x


def around(angles):
    """Mean of angles that go round: where the sum of their directions points.

    Parameters
    ----------
    angles : sequence of float
        [rad]

    Returns
    -------
    float
        From -pi to pi [rad].
    """
    return float(np.angle(np.exp(1j * np.asarray(angles)).sum()))


def _turned_to(dataset, model, fit, unseen):
    """Phases in the runs that are held out, where each run has one: nothing but the run itself can tell.

    ``unseen`` holds, by phase, its names in these runs.
    """
    names = [n for of_runs in unseen.values() for n in of_runs]
    if not names or not dataset.is_test.any():
        return {}
    start = {n: fit.parameters.get(n, fit.parameters[name]) for name, of_runs in unseen.items() for n in of_runs}
    problem = dataset.residuals(model, names, {**fit.parameters, **start}, "test")
    x = _turned(problem, np.array(list(start.values())), names, fit.weights, fit.variables)
    return dict(zip(names, map(float, _solve(lambda z: problem.gram(z, fit.weights), x, names, fit.variables, 20))))


def _turned(problem, x, phases, weights, variables):
    """A start with the phase in each run that leaves least there, of eight round the turn.

    Halfway from the truth a step would not know which way to turn. Amplitudes must not be zero for it: where they are,
    they are started at their nominal value.
    """
    if not phases:
        return x
    x, free = x.copy(), problem.free
    for k, n in enumerate(free):
        same = any(n.rpartition(".")[0] == p.partition("[")[0].rpartition(".")[0] for p in phases)
        if same and "[" not in n and abs(x[k]) < 1e-3 * variables[n].nominal:
            x[k] = _inside(variables[n].nominal, variables[n])
    numbers, tried = [free.index(n) for n in phases], np.arange(8) * np.pi / 4 - np.pi
    left = []
    for phase in tried:
        x[numbers] = phase
        squares = ((np.asarray(weights)[:, None] * problem.residual(x)) ** 2).sum(0)
        left.append([squares[problem.own[n][1]].sum() for n in phases])
    x[numbers] = tried[np.argmin(left, axis=0)]
    return x


def _refine(problem, tidy, x, free, variables, weights, segments, robust, trial):
    """Least squares, then steps whose derivatives hold no noise of the measured torques.

    A trial is left to those steps where few samples have brought it near. Returns the parameters, and the moments where
    the model is piecewise affine.
    """
    moments = None if robust or problem.held else Moments.of(problem, x, segments, tidy)
    for _ in range(5):
        if moments is None:
            thin = max(1, problem.n // 4000)
            few = [problem.thin(thin)] if thin > 1 else []
            for part in few if trial and few else [*few, problem]:
                x = _solve(lambda z: part.gram(z, weights, robust), x, free, variables, 60,
                           ENOUGH if part is problem else NEAR)
            return _instrumented(lambda z: _cross_gram(problem, tidy, z, weights, robust), x, free, variables, 4), None
        x = _solve(lambda z: moments.gram(z, weights), x, free, variables, 60)
        x = _instrumented(lambda z: moments.gram(z, weights, True), x, free, variables, 8)
        if moments.holds(x):
            break
        moments = moments if moments.take(x) else None
    return x, moments


def _cross_gram(problem, tidy, x, weights, robust):
    """Moments of noise-free derivatives and the measured residual."""
    slopes = ((part, slope) for part, _, slope in tidy.blocks(x))
    return _crossed(slopes, problem.residual(x), len(x), weights, robust)


def _crossed(slopes, residual, p, weights, robust):
    """Moments of derivatives by p parameters, part by part of the samples, and a residual of all."""
    trust, total = np.sqrt(huber(residual)) if robust else None, np.zeros((p + 1, p + 1))
    for part, slope in slopes:
        for c, weight in enumerate(weights):
            add_moments(total, slope[c], residual[c, part], weight * trust[c, part] if robust else weight)
    return total


def _instrumented(gram, x, free, variables, steps):
    """Bounded Gauss-Newton steps to where the instruments find nothing left in the residual."""
    scale = np.array([variables[n].nominal for n in free])
    low, high = (np.array([getattr(variables[n], b) for n in free]) for b in ("min", "max"))
    margin = MARGIN * scale
    if not free:
        return x
    g = gram(x)
    for _ in range(steps):
        _, step = bounded(g[:-1, :-1], g[:-1, -1], low + margin - x, high - margin - x)
        there = np.clip(x + np.clip(step, -scale, scale), low + margin, high - margin)
        after = gram(there)
        if not np.isfinite(after).all() or after[-1, -1] > 1.02 * g[-1, -1]:
            break  # far from where the derivatives hold
        x, g = there, after
        if np.all(np.abs(step) < 1e-5 * scale):
            break
    return x


def _inside(value, variable):
    """Start strictly inside the bounds, where derivatives are two-sided."""
    margin = MARGIN * variable.nominal
    return min(max(value, variable.min + margin), variable.max - margin)


def _solve(gram, x, free, variables, evaluations, enough=ENOUGH):
    """Least squares from the moments [J r]'[J r] alone, a margin inside the bounds."""
    if not free:
        return x
    margin = MARGIN * np.array([variables[n].nominal for n in free])
    low, high = (np.array([getattr(variables[n], b) for n in free]) for b in ("min", "max"))
    return solve(gram, x, free, low + margin, high - margin, evaluations, enough)


def result(problem, slope, residual, gram, x, free, variables, weights, noise, robust=False):
    """Covariance, null directions and noise at a solution.

    With k free parameters, c channels and n samples.

    Parameters
    ----------
    problem : object
        With ``chain`` (Chain), ``parameters`` (all of them, by name) and ``names`` (of the channels).
    slope : ndarray, shape (c, k, n)
        Of the residual by the free parameters.
    residual : ndarray, shape (c, n)
        Of moving samples, in the channels' units.
    gram : ndarray, shape (k + 1, k + 1)
        Weighted products of the slopes, and with the residual.
    x : ndarray, shape (k,)
        The solution.
    free : list of str
        Parameters that were fitted, in the order of `slope`.
    variables : dict of str to Variable
        Bounds, nominal values and units of these.
    weights : ndarray, shape (c,)
        What each channel was multiplied with in the fit.
    noise : list of Noise or None
        None: to be fitted to the residual.
    robust : bool
        Whether large residuals counted less.

    Returns
    -------
    Fit

    Raises
    ------
    NoAnswerError
        The model has no finite answer there.
    """
    if not np.isfinite(gram).all():
        raise NoAnswerError(f"the model has no finite answer at {listed(free, x)}; tighten the bounds around a "
                            "better start")
    chain = problem.chain
    inverse, null = invert(gram[:-1, :-1])
    if noise is None:
        root = orthonormal(inverse)
        counted = residual * huber(residual) if robust else residual  # what the estimate hangs on
        noise = [fit_noise(r, chain, w * root @ j) for w, r, j in zip(weights, counted, slope)]
    meat = np.zeros_like(inverse)
    for w, j, r_noise in zip(weights, slope, noise):
        used = np.flatnonzero(j.any(axis=1))
        meat[np.ix_(used, used)] += w ** 4 * r_noise.covariance(j[used], chain)
    covariance = inverse @ meat @ inverse
    independent = sum(n.independent(chain) for n in noise)
    dof = max(1.0, independent - len(free))
    covariance *= max(independent, 2.0) / max(independent - len(free), 1.0)
    fitted = Fit({**problem.parameters, **dict(zip(free, map(float, x)))}, free, variables, x,
                 x + inverse @ gram[:-1, -1], covariance, null, dof, noise, problem.names, weights)
    fitted.error = {c: float(np.sqrt(np.mean(r ** 2))) for c, r in zip(problem.names, residual)}
    return fitted


def widened(dataset, model, fit):
    """A fit whose intervals hold what is wrong with its model too, as far as that differs from block to block.

    While something is missing, the residual is no noise: its pull on a parameter is then taken from how much it differs
    between blocks (a sandwich with clusters), where that is more than the noise model says.

    Parameters
    ----------
    dataset : Dataset
        Whose blocks are compared.
    model : Model
        That was fitted.
    fit : Fit
        Only its covariance changes.

    Returns
    -------
    Fit
    """
    problem = dataset.residuals(model, fit.free, fit.parameters, "fit", dataset.exogenous())
    blocks, label = np.unique(problem.block, return_inverse=True)
    p = len(fit.free)
    if p == 0 or len(blocks) <= p + 1:
        return replace(fit, conditional=True)
    normal, pull = np.zeros((p, p)), np.zeros((len(blocks), p))
    residual = dataset.residuals(model, fit.free, fit.parameters, "fit").residual(fit.values)
    for part, _, slope in problem.blocks(fit.values):
        for c, w in enumerate(fit.weights):
            normal += w ** 2 * slope[c] @ slope[c].T
            np.add.at(pull, label[part], (w ** 2 * slope[c] * residual[c, part]).T)
    inverse = invert(normal)[0]
    pull = pull - pull.mean(0)
    between = inverse @ (pull.T @ pull) @ inverse * len(blocks) / (len(blocks) - p)
    grown = np.sqrt(np.maximum(np.diag(between) / np.maximum(np.diag(fit.covariance), 1e-300), 1.0))
    return replace(fit, covariance=fit.covariance * np.outer(grown, grown), conditional=True,
                   dof=min(fit.dof, float(len(blocks) - 1)))


def orthonormal(inverse):
    """Square root of an inverse normal matrix: takes derivatives to an orthonormal basis of what they fit.

    Parameters
    ----------
    inverse : ndarray, shape (p, p)
        Symmetric, positive semidefinite.

    Returns
    -------
    ndarray, shape (p, p)
        Rows that belong to what is not determined are zero.
    """
    if len(inverse) == 0:
        return inverse
    scale = np.sqrt(np.maximum(np.diag(inverse), 1e-300))
    values, vectors = np.linalg.eigh(inverse / np.outer(scale, scale))
    return np.sqrt(np.maximum(values, 0))[:, None] * (vectors.T * scale)


def invert(normal):
    """Pseudo-inverse of a normal matrix, and the directions that it does not determine.

    Parameters
    ----------
    normal : ndarray, shape (p, p)
        Symmetric, positive semidefinite.

    Returns
    -------
    inverse : ndarray, shape (p, p)
    null : ndarray, shape (k, p)
        In the parameters' own units.
    """
    if len(normal) == 0:
        return normal, np.zeros((0, 0))
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    dead = np.diag(normal) <= 1e-24 * max(np.max(np.diag(normal)), 1e-300)
    scaled = normal / np.outer(scale, scale)
    scaled[dead, :] = scaled[:, dead] = 0.0
    values, vectors = np.linalg.eigh(scaled)
    kept = values > NULL
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T / np.outer(scale, scale)
    null = vectors[:, ~kept].T / np.where(dead, 1.0, scale)
    return inverse, null / np.maximum(np.max(np.abs(null), axis=1, keepdims=True), 1e-300) if len(null) else null

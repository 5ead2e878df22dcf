"""Readings in; how well the columns agree with each other and with the study's model, out.

A relation predicts some columns from others: a speed from its angle, a joint encoder from the motors' angles, the
torques of the joints from those of the motors, or from what the leg weighs. Each gives a relative error: 0 where all is
as the rig says, 1 where a constant would do as well, and up to `WORST`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from ...compile import ArrayFunction, compile_model
from ...core.errors import PycosimError
from ...study.template import first_parameters

WORST = 2.0
"""Relative error at most: the size of a wrong answer says nothing more."""
SLOW = 0.03
"""Share of a segment's usual speed below which the direction of a sample is not relied on."""
_OUT = 4.0  # robust standard deviations beyond which a residual counts no more
_CHANCE = 0.5  # standard deviations of a correlation by chance
_STEPS = 10  # of a fit
_DONE = 2e-3  # relative fall of the cost that ends it


@dataclass
class Agreement:
    """How well a relation holds.

    Attributes
    ----------
    relative : dict of str to float
        By channel: error over the spread of what was measured.
    error : dict of str to float
        RMSE [SI units].
    smooth : dict of str to float
        By channel: the part of it that neighbouring samples share, which noise is not.
    residual : ndarray, shape (channels, samples)
        Measured minus predicted, SI units.
    used : ndarray of bool, shape (samples,)
        Samples that were compared: those in motion, unless the relation holds at rest as well.
    x : ndarray
        Fitted parameters.
    """

    relative: dict
    error: dict
    smooth: dict
    residual: np.ndarray = None
    used: np.ndarray = None
    x: np.ndarray = None
    spread: dict = field(default_factory=dict)


def agreement(names, residual, measured, used, partners, x=None):
    """Errors of a relation.

    Parameters
    ----------
    names : list of str
        Channels.
    residual, measured : ndarray, shape (channels, samples)
        Measured minus predicted, and what was measured, in SI units.
    used : ndarray of bool, shape (samples,)
        Samples that are compared.
    partners : tuple of ndarray of int
        Of `Readings`.
    x : ndarray, optional
        Fitted parameters, kept in the result.

    Returns
    -------
    Agreement
    """
    relative, error, smooth, spreads = {}, {}, {}, {}
    first, second = (p[used[partners[0]] & used[partners[1]]] for p in partners)
    for name, r, m in zip(names, residual, measured):
        every, r, m = r, r[used], m[used]
        if r.size < 20 or not np.isfinite(r).all():
            relative[name], smooth[name] = WORST, WORST
            error[name] = spreads[name] = float("nan")
            continue
        spread = max(_spread(m), 1e-300)
        size = _winsorised(r)
        relative[name], error[name], spreads[name] = float(min(size / spread, WORST)), float(size), float(spread)
        smooth[name] = shared(every, first, second) / spread
    return Agreement(relative, error, smooth, residual, used, x, spreads)


def between(relation, names):
    """Whether a relation holds some columns against others: one of those alone tells of no time, if all move.

    Parameters
    ----------
    relation : ModelRelation or RateRelation
        With the variables that it is about.
    names : iterable of str
        Variables that are read at another time together.

    Returns
    -------
    bool
    """
    return bool({*names} & relation.variables) and not relation.variables <= {*names}


def shared(residual, first, second):
    """Size of the part of a residual that neighbouring samples share, at least what chance would give.

    Parameters
    ----------
    residual : ndarray, shape (samples,)
        In any unit; one channel.
    first, second : ndarray of int, shape (pairs,)
        Samples of each pair, recorded closely one after the other.

    Returns
    -------
    float
    """
    if first.size < 10:
        return float(np.sqrt(np.mean(residual ** 2))) if residual.size else 0.0
    a, b = residual[first], residual[second]
    limit = _OUT * 1.4826 * np.median(np.abs(a))
    if limit:
        a, b = np.clip(a, -limit, limit), np.clip(b, -limit, limit)
    power = 0.5 * (np.mean(a ** 2) + np.mean(b ** 2))
    return float(np.sqrt(max(np.mean(a * b), 0.0) + _CHANCE * power / np.sqrt(first.size)))


def _spread(values):
    """Root mean square without the outermost hundredth on each side: a load that hardly varies is no small one."""
    low, high = np.quantile(values, (0.01, 0.99))
    return float(np.sqrt(np.mean(np.clip(values, low, high) ** 2)))


def _winsorised(residual):
    """RMSE in which no sample counts as more than four robust deviations."""
    limit = _OUT * 1.4826 * np.median(np.abs(residual))
    return float(np.sqrt(np.mean(np.minimum(np.abs(residual), max(limit, 1e-300)) ** 2))) if limit else float(
        np.sqrt(np.mean(residual ** 2)))


_CHANGES, _TELLING = 0.05, 40  # of the usual largest acceleration, and samples with more of it that are enough


class RateRelation:
    """A logged speed is the slope of the logged angle, and where it changes it says when it was.

    At an even speed a late one errs by nothing: of a log that mostly cruises, samples that accelerate were outliers.
    """

    free = ()  # parameters to fit

    def __init__(self, speed, angle):
        self.speed, self.angle, self.channels = speed, angle, [speed]
        self.variables = {speed, angle}

    def hold(self, readings, sources, start=None):
        """How well it holds.

        Parameters
        ----------
        readings : Readings
            Samples of all logs.
        sources : dict of str to Source
            How each variable is read, by its name.
        start : ndarray, optional
            Of no use here.

        Returns
        -------
        Agreement
        """
        w, slope = readings.take(sources[self.speed]), readings.take(sources[self.angle], 1)
        rate = np.abs(readings.take(sources[self.speed], 1))
        changes = rate > _CHANGES * np.quantile(rate, 0.99) if rate.size else rate > 0
        used = changes if np.count_nonzero(changes) > _TELLING else np.ones(w.size, bool)
        return agreement(self.channels, (w - slope)[None], w[None], used, readings.partners)


class ModelRelation:
    """A question of the model, answered from some columns, and compared with others.

    Parameters
    ----------
    name : str
        Said in findings, as what is compared.
    question : Question
        Of the rig, with the channels among its outputs.
    channels : dict of str to str
        Measured variable to the output that predicts it.
    model : Model
        The rig with the study's effects; its segments' speeds tell when it moves.
    free : list of str
        Parameters to fit.
    settings : dict of str to Variable
        Values and bounds of all parameters.
    level : bool
        Each run has a zero of its own: only what varies is compared.
    scale : dict of str to str, optional
        Of an output that should be zero: the output whose size it is measured by.
    always : bool
        Holds at rest as well: no friction is in it.
    """

    def __init__(self, name, question, channels, model, free, settings, level=False, scale=None,
                 always=False):
        self.name, self.channels, self.level, self.scale = name, list(channels), level, scale or {}
        self.free = [n for n in free if n in question.parameters]
        self.always = always
        segments = [] if always else [f"{c}.w" for c in model.segments if f"{c}.w" in question.outputs]
        wanted = [*channels.values(), *self.scale.values(), *segments]
        chosen = question.select(wanted)
        self.inputs, self.names = chosen.inputs, chosen.parameters
        u, p = ca.SX.sym("u", len(chosen.inputs)), ca.SX.sym("p", len(chosen.parameters))
        y = chosen.sliding()(u, p)
        at = [chosen.parameters.index(n) for n in self.free]
        self.count, self.sized, self.segments = len(channels), len(self.scale), len(segments)
        columns = ca.vertcat(*[p[k] for k in at]) if at else ca.SX(0, 1)
        slopes = ca.jacobian(y[:self.count], columns) if at else ca.SX(self.count, 0)
        outputs = ca.cse([ca.densify(y), ca.densify(slopes)])
        self.function = ArrayFunction(ca.Function("relation", [u, p], outputs if at else outputs[:1]))
        self.plain = ArrayFunction(ca.Function("relation", [u, p], [ca.cse(ca.densify(y))]))
        self.given = np.array([settings[n].value for n in self.names])
        self.at = at
        self.units = {n: settings[n].unit for n in self.free}
        self.settings, self.question, self.model, self.outputs = settings, question, model, dict(channels)
        self.low, self.high, self.nominal = (np.array([getattr(settings[n], k) for n in self.free])
                                             for k in ("min", "max", "nominal"))
        self.read = [n for n, s in zip(chosen.inputs, ca.vertsplit(u)) if ca.depends_on(y, s)]
        self.variables = {bare(n) for n in self.read} | {c for c in self.channels if c not in self.scale}

    def freed(self, names):
        """The same relation with more free parameters.

        Parameters
        ----------
        names : list of str
            Parameters to fit as well.

        Returns
        -------
        ModelRelation
        """
        scale = dict(zip(self.outputs, self.scale.values())) if self.scale else None
        return ModelRelation(self.name, self.question, self.outputs, self.model, [*self.free, *names], self.settings,
                             self.level, scale, self.always)

    def arguments(self, readings, sources):
        """Signals of the model's inputs.

        Parameters
        ----------
        readings : Readings
            Samples of all logs.
        sources : dict of str to Source
            How each variable is read, by its name.

        Returns
        -------
        list of ndarray or float
        """
        found = []
        for name in self.inputs:
            if name == "time":
                found.append(readings.time)
            elif bare(name) in sources:
                found.append(readings.take(sources[bare(name)], name.count("der(")))
            else:
                found.append(0.0)
        return found

    def measured(self, readings, sources):
        """What is compared with; zero where the error itself is modelled.

        Parameters
        ----------
        readings : Readings
            Samples of all logs.
        sources : dict of str to Source
            How each variable is read, by its name.

        Returns
        -------
        ndarray, shape (channels, samples)
        """
        n = readings.time.size
        return np.array([np.zeros(n) if c in self.scale else readings.take(sources[c]) for c in self.channels])

    def evaluate(self, arguments, x, n, slopes=True):
        """Outputs, segments' speeds, and derivatives by the free parameters.

        Parameters
        ----------
        arguments : list of ndarray or float
            As `arguments` gives them: a number stands for an input that is constant.
        x : ndarray
            Free parameters.
        n : int
            Number of samples.
        slopes : bool
            Derivatives are wanted.

        Returns
        -------
        outputs, sizes, speeds : ndarray, shape (rows, n)
        slopes : ndarray, shape (channels, free, n)
        """
        p = self.given.copy()
        p[self.at] = x
        values = (self.function if slopes else self.plain)([*arguments, *p], n)
        rows = self.count + self.sized + self.segments
        jacobian = values[rows:].reshape(len(self.free), self.count, n).transpose(1, 0, 2) if slopes and self.at else (
            np.zeros((self.count, 0, n)))
        return values[:self.count], values[self.count:self.count + self.sized], values[self.count + self.sized:rows], (
            jacobian)

    def predict(self, readings, sources, x):
        """What the model says of each channel.

        Parameters
        ----------
        readings : Readings
            Samples of all logs.
        sources : dict of str to Source
            How each variable is read, by its name.
        x : ndarray
            Free parameters.

        Returns
        -------
        ndarray, shape (channels, samples)
        """
        return self.evaluate(self.arguments(readings, sources), x, readings.time.size, False)[0]

    def hold(self, readings, sources, start=None, offset=False):
        """How well it holds after a fit of the free parameters.

        Parameters
        ----------
        readings : Readings
            Samples of all logs.
        sources : dict of str to Source
            How each variable is read, by its name.
        start : ndarray, optional
            Where the fit starts; the study's values by default.
        offset : bool
            Each channel may be off by a constant, which is left in ``offsets``.

        Returns
        -------
        Agreement
        """
        n, arguments = readings.time.size, self.arguments(readings, sources)
        measured = self.measured(readings, sources)
        x = np.clip(self.given[self.at] if start is None else start, self.low, self.high)
        with np.errstate(all="ignore"):
            y, size, speeds, slopes = self.evaluate(arguments, x, n)
            used = moving(speeds)
            if self.level:
                measured = levelled(measured, readings.run, used)
            spread = np.array([max(_spread(m[used]), 1e-12) if used.sum() > 20 else 1.0 for m in (
                measured if not self.sized else size)])
            x, y, size = self._fit(arguments, measured, x, y, size, slopes, used, spread, offset)
            self.offsets = np.zeros(self.count)
            if offset and used.any():
                self.offsets = np.median((measured - y)[:, used], axis=1)
                measured = measured - self.offsets[:, None]
            if self.level:
                y = levelled(y, readings.run, used)
            return agreement(self.channels, measured - y, measured if not self.sized else size, used,
                             readings.partners, x)

    def _fit(self, arguments, measured, x, y, size, slopes, used, spread, offset=False):
        """Bounded, damped Gauss-Newton steps on the samples that are not far out, beside any constant if wanted."""
        n = measured.shape[1]
        if not self.free or used.sum() < 20:
            return x, y, size

        def left(there):
            residual = measured - there
            return residual - np.median(residual[:, used], axis=1, keepdims=True) if offset else residual
        damping = 1e-6
        cost, weight = _cost(left(y), used, spread)
        for _ in range(_STEPS):
            if offset:
                slopes = slopes - slopes[:, :, used].mean(axis=2, keepdims=True)
            j = (slopes * weight[:, None]).transpose(0, 2, 1).reshape(-1, len(x)) * self.nominal
            r = (left(y) * weight).ravel()
            normal, right = j.T @ j, j.T @ r
            if not (np.isfinite(normal).all() and np.isfinite(right).all()):
                break
            step = _bounded(normal + damping * np.diag(np.maximum(np.diag(normal), 1e-12)), right,
                            (self.low - x) / self.nominal, (self.high - x) / self.nominal)
            there = np.clip(x + step * self.nominal, self.low, self.high)
            y_there, size_there, _, slopes_there = self.evaluate(arguments, there, n)
            cost_there, weight_there = _cost(left(y_there), used, spread)
            if np.isfinite(cost_there) and cost_there < cost:
                done = cost_there > (1 - _DONE) * cost
                x, y, size, slopes, cost, weight = there, y_there, size_there, slopes_there, cost_there, weight_there
                damping = max(damping / 10, 1e-9)
                if done:
                    break
            else:
                damping *= 100
                if damping > 1e4:
                    break
        return x, y, size


def _cost(residual, used, spread):
    """Huber's sum of squares, and the weights that give it."""
    r = residual / spread[:, None]
    limit = np.array([max(1.4826 * np.median(np.abs(row[used])), 1e-9) * 2.0 for row in r])[:, None]
    size = np.abs(r)
    cost = np.where(size < limit, r ** 2, 2 * limit * size - limit ** 2) * used
    # spreads rather than least squares: the limit moves with the residual, so cost falls only where residuals do
    return float(cost.sum()), np.sqrt(np.minimum(1.0, limit / np.maximum(size, 1e-12)) * used) / spread[:, None]


def _bounded(normal, right, low, high):
    """Minimum of a quadratic within bounds: what leaves them is pressed against them, one after the other."""
    held, x = np.zeros(right.size, dtype=int), np.zeros(right.size)
    for _ in range(right.size + 1):
        free = held == 0
        x = np.where(held < 0, low, np.where(held > 0, high, 0.0))
        if free.any():
            left = right[free] - normal[np.ix_(free, ~free)] @ x[~free]
            a = normal[np.ix_(free, free)]
            x[free] = np.linalg.solve(a + 1e-12 * np.trace(a) / len(a) * np.eye(len(a)) + 1e-300 * np.eye(len(a)), left)
        out = np.where(x < low - 1e-12, -1, np.where(x > high + 1e-12, 1, 0)) * free
        if not out.any():
            break
        held = held + out
    return np.clip(x, low, high)


def moving(speeds):
    """Samples in which no segment is nearly at rest.

    Parameters
    ----------
    speeds : ndarray, shape (segments, n)
        Of each segment [rad/s], on a linear axis [m/s].

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    if not len(speeds):
        return np.ones(speeds.shape[1], bool)
    usual = np.sqrt(np.mean(speeds ** 2, axis=1, keepdims=True))
    return np.all(np.abs(speeds) > SLOW * usual, axis=0)


def levelled(values, run, used):
    """Values without the median of each run.

    Parameters
    ----------
    values : ndarray, shape (channels, samples)
        A row a channel, in any unit.
    run : ndarray of int, shape (samples,)
        Number of the log that each sample belongs to.
    used : ndarray of bool, shape (samples,)
        Samples that the medians are taken of.

    Returns
    -------
    ndarray, shape (channels, samples)
    """
    made = values.copy()
    for k in np.unique(run):
        inside = run == k
        some = inside & used if (inside & used).any() else inside
        made[:, inside] -= np.median(values[:, some], axis=1, keepdims=True)
    return made


def bare(name):
    """Variable of an input such as ``der(der(motor.phi))``.

    Parameters
    ----------
    name : str
        Of an input of the model, a derivative or the variable itself.

    Returns
    -------
    str
    """
    return name.rsplit("(", 1)[-1].rstrip(")")


# --- of a study -----------------------------------------------------------------------------------------------------


def relations(study, library, model, names):
    """Relations that a study's logs can be held against.

    Parameters
    ----------
    study : Study
        Its columns and parameters say what is known.
    library : Library
        Holds the study's rig.
    model : Model
        With the study's effects.
    names : list of str
        Variables that every log holds.

    Returns
    -------
    list of RateRelation and ModelRelation
    """
    found = [RateRelation(n, n[:-1] + "phi") for n in names if n.endswith(".w") and n[:-1] + "phi" in names]
    calm = [(e.id, p.name) for e, p in model.attached if not e.channel]
    model = model if len(calm) == len(model.attached) else compile_model(library, study.rig, calm)
    settings = dict(model.parameters)
    for name, setting in study.parameters.items():
        if name in settings:
            settings[name] = setting.applied(settings[name])
    for make in (_encoders, _estimate, _weight, _balance):
        try:
            found += make(study, model, names, settings)
        except PycosimError:
            continue  # a question that this rig does not answer
    return found


def _encoders(study, model, names, settings):
    readings = {c: out.partition(":")[0] for c, out in model.aliases("encoders").items() if c in names}
    forms = [(k, known) for k, (_, known) in enumerate(model.alternatives("estimate")) if known[0] in names]
    if not readings or not forms:
        return []
    question = model.question("estimate", forms[0][0])
    return [ModelRelation(f"encoder {c}", question, {c: out}, model, [], settings, level=True, always=True)
            for c, out in readings.items() if out in question.outputs]


def _free(study, model, question):
    named = [n for n, s in study.parameters.items() if s.fixed is False and n in question.parameters]
    own = [n for e, p in model.attached for n in model.effect_parameters(e, p) if n in question.parameters]
    return list(dict.fromkeys([*(named or first_parameters(model, question)), *own]))


def _estimate(study, model, names, settings):
    """The study's own comparison."""
    forms = model.alternatives("estimate")
    form = next((k for k, (wanted, known) in enumerate(forms) if {*wanted, *_needed(known)} <= set(names)), None)
    if form is None:
        return []
    aliases = {} if study.reference == "sensor" else model.aliases("load")
    question, wanted = model.question("estimate", form), forms[form][0]
    outputs = {c: aliases.get(c, c) for c in wanted}
    outputs = {c: out if out in question.outputs else c for c, out in outputs.items()}
    return [ModelRelation("estimate", question, outputs, model, _free(study, model, question), settings)]


def _needed(known):
    return [k for k in known if not k.startswith("push") and k != "time"]


def _bodies(study, question, model):
    """Masses and inertias that the study does not fix."""
    return [n for n in question.parameters if model.parameters[n].unit in ("kg", "kg.m2")
            and not (study.parameters.get(n) and study.parameters[n].fixed)]


def _weight(study, model, names, settings):
    """What the load weighs, against the reference: the motors' torques are not in it."""
    if "gravity_model" not in model.notes:
        return []
    forms = model.alternatives("gravity_model")
    form = next((k for k, (wanted, known) in enumerate(forms) if {*wanted, *_needed(known)} <= set(names)), None)
    if form is None:
        return []
    question = model.question("gravity_model", form)
    outputs = {c: c for c in forms[form][0]}
    return [ModelRelation("weight", question, outputs, model, _bodies(study, question, model), settings,
                          always=True)]


def _balance(study, model, names, settings):
    """What the load weighs, against the motors' torques, where no reference was measured."""
    if "balance" not in model.notes:
        return []
    measured = [w for wanted, _ in model.alternatives("estimate") for w in wanted]
    if set(measured) <= set(names):
        return []
    outputs, known = model.alternatives("balance")[0]
    if not set(_needed(known)) <= set(names):
        return []
    question = model.question("balance", 0)
    sizes = [c for c in model.aliases("load") if c in question.outputs]
    if len(sizes) != len(outputs):
        return []
    free = [*_free(study, model, question), *_bodies(study, question, model)]
    return [ModelRelation("balance", question, {c: c for c in outputs}, model, free, settings,
                          scale=dict(zip(outputs, sizes)))]

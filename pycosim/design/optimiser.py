"""A study, its limits and what was measured already in; the next experiment, and the gain it predicts, out.

The motion is a set of strokes: to and fro along straight lines, at least one a pair of opposite zones and speed class.
Where they lie, how fast and how long they are, and the time that each gets, is optimised within the limits by Ipopt
with exact first derivatives of the information that the identification's own residual would carry.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from ..fit import least_squares
from ..compile import catalogue, compile_model, component_name, find_effect, find_place
from ..diagnosis.diagnose import _nudged, diagnose
from ..core.errors import PlanError, closest
from .information import Block, ChannelNoise, StrokeInformation
from .motion import PEAK, SHORTEST_RAMP, Stroke, assemble, ordered
from .prediction import expected, predicted_fit, signals_of
from .workspace import Workspace, kinematics, limits_of

GOALS = ("parameters", "twins", "detect")
CRITERIA = ("D", "E", "intervals")
CLASSES = 1.0, 0.45, 0.2  # greatest speed of a stroke, of the limit
SLOWEST = 0.7  # least speed of a stroke, of its class
MARGIN = 0.02  # rad kept from every stop
ROOM = 0.99  # share of speed, acceleration and torque limits that is used
DWELL = 0.15  # s
FLAT = 0.3  # s at constant speed at least
LEAST = 3.0  # least speed of a segment, over the speed above which a sample counts as moving
SHARE = 0.01  # of the budget that every stroke gets at least
TRAVEL = 0.05, 0.15, 0.5  # of the budget kept for the ways between strokes; the next if they take longer
STARTS = 5
DRAWN = 60  # points from which those are chosen: what tells rivals apart can be a corner that nothing slopes towards
SHORTEST = 0.0075  # of a way, over the size of the workspace; below 0.005 `segmentation` sees no way out and back
PRESLIDING = 50.0  # least way of a segment over its elastic displacement: friction has built up in 2 % of a pass
ASSUMED = 0.01  # noise over the range of a channel, where nothing was measured
MEMORY = 1.0  # s
ALIKE = 0.1  # squares of the noise below which rivals are one and the same
SEPARATE = 10.8  # squares of the noise by which rivals must differ: the better one is the true one in 99.9 %


@dataclass
class Asked:
    """What is compared, and from what.

    Attributes
    ----------
    outputs, known : list of str
    paired : bool
    ask : callable
        Question of a model.
    channels : list of str
    w_min : float
        [rad/s]
    """

    outputs: list
    known: list
    paired: bool
    ask: object
    channels: list
    w_min: float


def asked(study, model, dataset=None):
    """What a data set compares, or what the study's first log would.

    Parameters
    ----------
    study : Study
    model : Model
    dataset : Dataset, optional

    Returns
    -------
    Asked
    """
    if dataset is not None:
        return Asked(dataset.outputs, dataset.known, dataset.paired, dataset.ask, dataset.channels, dataset.w_min)
    outputs, known = model.alternatives("estimate")[0]
    paired = study.reference == "unknown" and any(n.endswith(".tau") for n in known)
    aliases = tuple(model.aliases("load").items()) if study.reference == "gravity_model" else ()

    def ask(m):
        question = m.question("estimate", 0, aliases)
        return question.fixed({n: 0.0 for n in (f"{c}.damping" for c in m.segments) if n in question.parameters})

    return Asked(outputs, known, paired, ask, [f"{c}_pair" if paired else c for c in outputs], study.w_min or 0.02)


def noise_of(fit, info):
    """Noise of the channels at one sample, from a fit.

    Parameters
    ----------
    fit : Fit
    info : Asked

    Returns
    -------
    list of ChannelNoise
    """
    scale = math.sqrt(2.0) if info.paired else 1.0  # of half a difference, back to one way's
    return [ChannelNoise(scale * n.white, scale * n.slow, n.memory or MEMORY) for n in fit.noise]


def prior_of(fit=None, free=(), variables=None):
    """Inverse covariance of parameters: what the data told, and that a parameter is within its bounds.

    Parameters
    ----------
    fit : Fit, optional
    free : list of str, optional
        The fit's by default.
    variables : dict of str to Variable, optional

    Returns
    -------
    ndarray, shape (p, p)
    """
    free, variables = (fit.free, fit.variables) if fit is not None else (list(free), variables)
    span = np.array([min(variables[n].max - variables[n].min, 1e3 * variables[n].nominal) for n in free])
    found = np.diag(12.0 / span ** 2) if free else np.zeros((0, 0))
    if fit is not None and free:
        scale = np.array([variables[n].nominal for n in free])
        values, vectors = np.linalg.eigh(fit.covariance / np.outer(scale, scale))
        kept = values > 1e-12 * values.max()
        found += (vectors[:, kept] / values[kept]) @ vectors[:, kept].T / np.outer(scale, scale)
    return found


# --- the optimisation -----------------------------------------------------------------------------------------------


@dataclass
class Design:
    """Strokes as the optimiser left them, with the time that each gets."""

    strokes: list
    seconds: np.ndarray
    grams: list
    value: float


class Optimiser:
    """Chooses strokes.

    Parameters
    ----------
    workspace : Workspace
    info : StrokeInformation
    blocks : list of Block
    budget : float
        [s]
    w_min : float
        Speed above which a segment counts as moving [rad/s].
    dwell : float
        [s]
    criterion : str
        For parameters: ``D``, ``E`` or ``intervals``.
    travel : float
        Share of the budget that is kept for the ways between strokes.
    """

    def __init__(self, workspace, info, blocks, budget, w_min, dwell, criterion, travel=TRAVEL[0]):
        known = blocks[0].values
        self.elastic = np.array([PRESLIDING * known.get(f"{c}.travel", 0.0) for c in workspace.kinematics.segments])
        self.shortest = SHORTEST * np.linalg.norm(np.ptp(workspace.vertices, axis=0))
        self.ws, self.info, self.blocks, self.budget, self.dwell = workspace, info, blocks, budget, dwell
        self.w_min, self.criterion, self.travel = w_min, criterion, travel
        limits = workspace.limits
        for name, size, unit in (("speed", limits.speed, "rad/s"), ("acceleration", limits.acceleration, "rad/s2")):
            if not np.isfinite(size).all():
                what = {"speed": "w", "acceleration": "a"}[name]
                motor = workspace.kinematics.motors[int(np.argmin(np.isfinite(size)))]
                raise PlanError(f"no limit of '{motor}.{what}'; give the greatest {name} in the study, as [limits] "
                                f'"{motor}.{what}" = {{ max = 2.0 }}  # {unit}')
        self._slots()
        self._build()

    def _slots(self):
        """Zone and speed class of every stroke."""
        pairs = self.ws.zones[::2]
        limits = self.ws.limits
        self.slots = []
        for zone in pairs:
            fastest = (limits.speed / np.maximum(np.abs(zone.direction), 1e-9)).min()
            slow = LEAST * self.w_min / np.abs(self.ws.kinematics.speed @ zone.direction).min()
            if SLOWEST * fastest * ROOM < slow:
                motor = self.ws.kinematics.motors[int(np.argmin(limits.speed))]
                raise PlanError(f"the limit of '{motor}.w', {limits.speed.min():g} rad/s, is too low: some segment "
                                f"would not count as moving below {slow:.3g} rad/s of the fastest motor")
            classes = [c for c in CLASSES if SLOWEST * c * fastest > slow] or [1.0]
            self.slots += [(zone, c * fastest) for c in classes]
        more = [s for s in self.slots if s[1] == max(v for z, v in self.slots if z is s[0])]
        while (self.travel == TRAVEL[0] and len(self.slots) + len(more) <= 12) or len(self.slots) < 4:
            self.slots += more

    def _build(self):
        """The nonlinear program, all strokes at once."""
        ws, m = self.ws, len(self.ws.kinematics.motors)
        limits = ws.limits
        a, b, stops = limits.halfspaces
        motors = ws.kinematics.motors
        size = 2 * m + 3
        z = ca.MX.sym("z", size * len(self.slots))  # all of one size, which the solver needs
        radius = np.ptp(ws.vertices, axis=0) / 2
        self.scale = np.tile([*radius, *limits.speed, 1.0, 0.5, 1.0 / len(self.slots)], len(self.slots))
        x = z * self.scale
        self.g, self.g_low, self.g_high, self.words = [], [], [], []
        total = [ca.MX(ca.DM(block.prior)) for block in self.blocks]
        total = [ca.diagcat(t, ca.MX(0)) if block.other is not None else t for t, block in zip(total, self.blocks)]
        spent = 0
        signs = [np.array(zone.signs, float) for zone, _ in self.slots]
        for k, (zone, fastest) in enumerate(self.slots):
            part = x[k * size:(k + 1) * size]
            c, u, travel, ramp, share = part[:m], part[m:2 * m], part[2 * m], part[2 * m + 1], part[2 * m + 2]
            grams, torques = self.info(c, u, travel, ramp, signs[k])
            seconds = share * self.budget
            total = [t + g * seconds for t, g in zip(total, grams)]
            spent += share
            for sign in (1, -1):
                self._below(ca.mtimes(ca.DM(a), c + sign * u * travel / 2), b - MARGIN, stops)
            self._inside(u, -ROOM * limits.speed, ROOM * limits.speed, [f"'{n}.w'" for n in motors])
            least = np.full(len(signs[k]), LEAST * self.w_min)
            self._above(ca.DM(signs[k]) * ca.mtimes(ca.DM(ws.kinematics.speed), u), least, ["the least speed"])
            along = float(zone.direction @ zone.direction)
            pace = ca.mtimes(ca.DM(zone.direction).T, u) / along
            self._inside(pace, SLOWEST * fastest * ROOM, fastest, ["the speeds of the motors"])
            for sign in (1, -1):
                self._above(ramp * ca.DM(ROOM * limits.acceleration) - sign * PEAK * u, np.zeros(m),
                            [f"'{n}.a'" for n in motors])
            self._above(travel - ramp, [FLAT], ["the accelerations of the motors"])
            way = ca.DM(signs[k]) * ca.mtimes(ca.DM(ws.kinematics.speed), u) * travel
            self._above(way, self.elastic, ["the way that builds friction up"])
            self._above(ca.sumsqr(u * travel / self.shortest), [1.0], ["the shortest way"])
            # two cycles, one to be held out
            self._above(seconds - 4 * (travel + ramp + self.dwell), [0.0], [f"the budget of {self.budget:g} s"])
            if self._torque_matters():
                bound = np.where(np.isfinite(limits.torque), ROOM * limits.torque, 1e6)
                count = torques.size2()
                self._inside(ca.vec(torques), np.tile(-bound, count), np.tile(bound, count),
                             [f"'{n}.tau'" for n in motors] * count)
        self._inside(spent, 0.0, 1.0 - self.travel, [f"the budget of {self.budget:g} s"])
        objective = sum(self._objective(t, block) for t, block in zip(total, self.blocks)) / len(self.blocks)
        self.values = ca.Function("values", [z], total)
        g = ca.vertcat(*self.g)
        self.g_low, self.g_high = np.concatenate(self.g_low), np.concatenate(self.g_high)
        self.problem = {"x": z, "f": objective, "g": g}

    def _torque_matters(self):
        """Whether some motion within the other limits comes near the limit of a torque."""
        if not hasattr(self, "_near"):
            limits, found = self.ws.limits, 0.0
            for corner in self.ws.vertices:
                for zone in self.ws.zones:
                    speed = zone.direction * limits.speed
                    for sign in (1, -1):
                        torque = self.info.torque(corner, speed, sign * limits.acceleration, np.sign(zone.signs))
                        found = max(found, float(np.max(np.abs(torque.full()[:, 0]) / limits.torque)))
            self._near = found > 0.5
        return self._near

    def _inside(self, expression, low, high, words):
        """A constraint, and the limit that it stands for in words."""
        self.g.append(expression)
        self.g_low.append(np.atleast_1d(low).astype(float))
        self.g_high.append(np.atleast_1d(high).astype(float))
        rows = len(self.g_low[-1])
        self.words += words if len(words) == rows else words * rows

    def _below(self, expression, high, words):
        self._inside(expression, np.full(len(high), -np.inf), high, words)

    def _above(self, expression, low, words):
        self._inside(expression, low, np.full(len(np.atleast_1d(low)), np.inf), words)

    def _objective(self, total, block):
        """Minimised: logarithm of intervals, or minus that of the squares by which rivals differ."""
        return contrast(total) if block.other is not None else spread(total, block, self.criterion)

    def start(self, rng):
        """A point that keeps most limits.

        Parameters
        ----------
        rng : numpy.random.Generator

        Returns
        -------
        ndarray
        """
        found, corners = [], self.ws.vertices
        limits = self.ws.limits
        for zone, fastest in self.slots:
            centre = rng.dirichlet(np.full(len(corners), 0.7)) @ corners
            middle, _ = self.ws.centre
            centre = middle + rng.uniform(0.6, 0.95) * (centre - middle)
            u = zone.direction * fastest * 0.9
            ramp = max(PEAK * (np.abs(u) / limits.acceleration).max() / ROOM * 1.02, SHORTEST_RAMP)
            reach = 2 * min(self.ws.reach(centre, d) for d in (u, -u))
            least = 1.02 * max(ramp + FLAT, self.shortest / np.linalg.norm(u))
            travel = max(min(rng.uniform(0.7, 3.0), 0.9 * reach), least)
            found += [*centre, *u, travel, ramp, (1 - self.travel) / len(self.slots)]
        return np.array(found)

    def solve(self, rng, seconds, progress):
        """Best of several starts.

        Parameters
        ----------
        rng : numpy.random.Generator
        seconds : float
            Time that may be used for it.
        progress : callable

        Returns
        -------
        Design

        Raises
        ------
        PlanError
            No motion keeps all limits.
        """
        options = {"print_time": False, "ipopt": {
            "print_level": 0, "sb": "yes", "max_iter": 200, "hessian_approximation": "limited-memory", "tol": 1e-4,
            "acceptable_tol": 1e-3, "acceptable_iter": 8, "max_wall_time": seconds / STARTS, "mu_strategy": "adaptive",
            "constr_viol_tol": 1e-6, "limited_memory_max_history": 30}}
        solver = ca.nlpsol("plan", "ipopt", self.problem, options)
        low, high = self._bounds()
        objective = ca.Function("objective", [self.problem["x"]], [self.problem["f"]])
        drawn = [self.start(rng) / self.scale for _ in range(DRAWN)]
        worth = np.nan_to_num([float(objective(z)) for z in drawn], nan=np.inf)
        best = self.nearest = None
        for k, z in enumerate(np.argsort(worth, kind="stable")[:STARTS]):
            progress(f"optimising the experiment, start {k + 1} of {STARTS}")
            found = solver(x0=drawn[z], lbx=low, ubx=high, lbg=self.g_low, ubg=self.g_high)
            x, g = found["x"].full()[:, 0], found["g"].full()[:, 0]
            beyond = np.maximum(self.g_low - g, g - self.g_high)
            if np.isfinite(x).all() and beyond.max() < 1e-4 and (best is None or float(found["f"]) < best[0]):
                best = float(found["f"]), x
        if best is None:
            raise PlanError(self._why())
        return self._design(*best)

    def _bounds(self):
        m = len(self.ws.kinematics.motors)
        low = np.tile([*[-np.inf] * 2 * m, FLAT, SHORTEST_RAMP, SHARE], len(self.slots))
        high = np.tile([*[np.inf] * 2 * m, 60.0, 30.0, 1.0], len(self.slots))
        return low / self.scale, high / self.scale

    def _why(self):
        """The limit without which there would be a motion, in a sentence."""
        for group in dict.fromkeys(_family(w) for w in self.words):
            mine = np.array([_family(w) == group for w in self.words])
            low, high = np.where(mine, -np.inf, self.g_low), np.where(mine, np.inf, self.g_high)
            g = self._feasible(low, high)
            if g is not None:
                beyond = np.where(mine, np.maximum(self.g_low - g, g - self.g_high), -np.inf)
                worst = self.words[int(np.argmax(beyond))]
                return (f"no motion keeps all limits within {self.budget:g} s: it would, but for {worst}; widen that, "
                        "or the limits that it goes with")
        worst = self.words[int(np.argmax(self.nearest))]
        return f"no motion keeps all limits within {self.budget:g} s, and more than one stands against it, as {worst}"

    def _feasible(self, low, high):
        """Constraints at a point that keeps these ends, or None."""
        problem = {**self.problem, "f": ca.MX(0)}
        solver = ca.nlpsol("feasible", "ipopt", problem, {"print_time": False, "ipopt": {
            "print_level": 0, "sb": "yes", "max_iter": 60, "max_wall_time": 1.5,
            "hessian_approximation": "limited-memory"}})
        least, most = self._bounds()
        found = solver(x0=self.start(np.random.default_rng(0)) / self.scale, lbx=least, ubx=most, lbg=low, ubg=high)
        g = found["g"].full()[:, 0]
        return g if np.isfinite(g).all() and np.maximum(low - g, g - high).max() < 1e-4 else None

    def _design(self, value, x):
        m, size = len(self.ws.kinematics.motors), 2 * len(self.ws.kinematics.motors) + 3
        strokes, seconds = [], []
        for k, (_, fastest) in enumerate(self.slots):
            part = (x * self.scale)[k * size:(k + 1) * size]
            stroke = Stroke(part[:m], part[m:2 * m], float(part[2 * m]), float(part[2 * m + 1]), 2, str(k + 1))
            strokes.append(stroke)
            seconds.append(float(part[-1]) * self.budget)
        return Design(strokes, np.array(seconds), [t.full() for t in self.values.call([x])], value)


def _family(words):
    """Limits that are lifted together to see whether they are what stands against a motion."""
    return words.rpartition(".")[2] if words.startswith("'") else "stops" if words.startswith(("max", "min")) else words


def spread(total, block, criterion):
    """Mean logarithm of standard errors over nominal values, by one of the criteria, from the information.

    Parameters
    ----------
    total : MX, shape (p, p)
    block : Block
    criterion : str

    Returns
    -------
    MX
    """
    p = len(block.free)
    scale = ca.DM([block.model.parameters[n].nominal for n in block.free])
    scaled = total * ca.mtimes(scale, scale.T)
    symbol = ca.SX.sym("s", p, p)
    root = ca.chol(symbol)
    if criterion == "D":
        value = -ca.sum1(ca.log(ca.diag(root))) / p
    else:
        back = ca.solve(root.T, ca.SX.eye(p))  # root' root = information
        if criterion == "intervals":
            rows = ca.DM(np.eye(p) if block.rows is None else block.rows)
            value = ca.sum1(ca.log(ca.sum1(ca.mtimes(back, rows.T) ** 2).T)) / 2 / rows.size1()
        else:
            cov = ca.mtimes(back.T, back)
            four = ca.mtimes(cov, cov)
            value = ca.log(ca.trace(ca.mtimes(four, four))) / 8  # the largest eigenvalue, smoothly
    return ca.Function("spread", [symbol], [value])(scaled)


def contrast(total):
    """Minus the logarithm of the squares by which rivals differ when one has bent to the other as far as it can.

    Parameters
    ----------
    total : MX, shape (p + 1, p + 1)
        Information of the parameters that bend, and the difference as the last row.

    Returns
    -------
    MX
    """
    n = total.size1()
    symbol = ca.SX.sym("s", n, n)
    scale = ca.sqrt(ca.diag(symbol)[:n - 1])
    own = symbol[:n - 1, :n - 1] / ca.mtimes(scale, scale.T)
    cross = symbol[:n - 1, n - 1] / scale
    half = ca.solve(ca.chol(own + 1e-9 * ca.SX.eye(n - 1)).T, cross)
    left = symbol[n - 1, n - 1] - ca.sumsqr(half)
    return ca.Function("contrast", [symbol], [-ca.log(left + 1e-6 * symbol[n - 1, n - 1] + 1e-9)])(total)


# --- from strokes to a motion ---------------------------------------------------------------------------------------


def motion_of(design, workspace, budget, dwell, rate):
    """Whole cycles of every stroke within the budget, joined to one motion.

    Parameters
    ----------
    design : Design
    workspace : Workspace
    budget : float
        [s]
    dwell : float
        [s]
    rate : float
        Samples a second.

    Returns
    -------
    Motion

    Raises
    ------
    PlanError
        Two cycles of every stroke take longer than the budget.
    """
    limits = workspace.limits
    period = np.array([2 * (s.travel + s.ramp + dwell) for s in design.strokes])
    cycles = np.maximum(2, np.round(design.seconds / period)).astype(int)

    fast = ROOM * limits.speed, ROOM * limits.acceleration
    order = ordered(design.strokes, *fast)
    number = {s.name: k for k, s in enumerate(design.strokes)}

    def joined():
        strokes = [replace(s, cycles=int(cycles[number[s.name]])) for s in order]
        return assemble(strokes, *fast, dwell, rate)

    ways = joined().duration + 1.0 / rate - float(cycles @ period)  # the same for any number of cycles
    while ways + cycles @ period > budget:
        over = np.flatnonzero(cycles > 2)
        if not len(over):
            raise PlanError(f"a budget of {budget:g} s is too short: two cycles in every zone at every speed take "
                            f"{ways + cycles @ period:.0f} s")
        cycles[over[np.argmax((cycles * period / design.seconds)[over])]] -= 1
    while (fits := np.flatnonzero(ways + cycles @ period + period <= budget)).size:
        cycles[fits[np.argmax((design.seconds / (cycles * period))[fits])]] += 1
    return joined()


# --- what is to be learnt -------------------------------------------------------------------------------------------


@dataclass
class Known:
    """What is known before the experiment.

    Attributes
    ----------
    study : Study
    library : Library
    model : Model
        With the study's effects.
    dataset : Dataset or None
    fit : Fit or None
    asked : Asked
    free : list of str
    values : dict of str to float
    prior : ndarray, shape (p, p)
        Inverse covariance of the free parameters.
    noise : list of ChannelNoise
    workspace : Workspace
    assumed : bool
        Whether the noise is a guess.
    """

    study: object
    library: object
    model: object
    dataset: object
    fit: object
    asked: Asked
    free: list
    values: dict
    prior: np.ndarray
    noise: list
    workspace: Workspace
    assumed: bool


def known(study, library, model, dataset=None, fit=None):
    """Gather what is known of a rig before the next experiment.

    Parameters
    ----------
    study : Study
    library : Library
    model : Model
    dataset : Dataset, optional
        What was measured already.
    fit : Fit, optional
        Of the model to it.

    Returns
    -------
    Known
    """
    kin = kinematics(model)
    workspace = Workspace(kin, limits_of(study, model, kin))
    info = asked(study, model, dataset)
    if fit is not None:
        return Known(study, library, model, dataset, fit, info, fit.free, fit.parameters, prior_of(fit),
                     noise_of(fit, info), workspace, False)
    variables = {n: replace(v, **{k: getattr(study.parameters[n], k) for k in ("value", "min", "max")
                                  if getattr(study.parameters[n], k) is not None}) if n in study.parameters else v
                 for n, v in model.parameters.items()}
    values = {n: v.value for n, v in variables.items()}
    free = [n for n, s in study.parameters.items() if s.fixed is False and n in model.parameters]
    found = Known(study, library, model, None, None, info, free, values, prior_of(None, free, variables), [],
                  workspace, True)
    found.noise = _assumed_noise(found)
    return found


def _assumed_noise(k):
    """A noise of one part in a hundred of what the channels range over, for a rig that nothing was measured of."""
    from .motion import Motion
    kin, corners = k.workspace.kinematics, k.workspace.vertices.T
    directions = [z.direction for z in k.workspace.zones]
    angle = np.hstack([corners] * len(directions))
    speed = np.repeat(np.array(directions).T, corners.shape[1], axis=1)
    motion = Motion(np.arange(angle.shape[1], dtype=float), angle, speed, 0 * speed, None)
    signals = signals_of(k.asked, kin, k.model, k.values, motion)
    ranges = [float(np.ptp(signals[c])) if c in signals else 1.0 for c in k.asked.outputs]
    return [ChannelNoise(ASSUMED * max(r, 1e-9), 0.4 * ASSUMED * max(r, 1e-9), MEMORY) for r in ranges]


def twins_of(k, pairs=None, progress=None):
    """Blocks that separate rivals: each in turn is the truth that the other bends to.

    Parameters
    ----------
    k : Known
    pairs : list of tuple, optional
        Pairs of (effect, place); those that the diagnosis cannot separate by default.
    progress : callable, optional

    Returns
    -------
    list of Block

    Raises
    ------
    PlanError
        There is no data to diagnose, or nothing to separate.
    """
    if k.dataset is None:
        raise PlanError(f"{k.study.path}: twins are found in data; give a log with --data, or --goal parameters")
    found = diagnose(k.dataset, k.model, k.fit, k.study.seed, progress)
    if pairs is None:
        best = found.winner
        pairs = [(best.key, (t["effect"], t["place"])) for t in best.twins] if best else []
    if not pairs:
        raise PlanError(f"{k.study.path}: the diagnosis of these data leaves no twins to separate; use --goal "
                        "parameters or --goal detect")
    findings = {f.key: f for f in found.candidates}
    fitted = {}
    for key in dict.fromkeys(key for pair in pairs for key in pair):
        if key not in findings:
            names = [f"{e}@{p}" for e, p in findings]
            raise PlanError(f"{'@'.join(key)} is no candidate on these data{closest('@'.join(key), names)}")
        larger = compile_model(k.library, k.study.rig, [*k.study.effects, key])
        start = _nudged({**k.fit.parameters, **findings[key].start}, larger, findings[key])
        fitted[key] = larger, least_squares.fit(k.dataset, larger, start)
    return rivals(pairs, fitted)


def rivals(pairs, fitted):
    """Blocks of pairs of fitted rivals.

    Parameters
    ----------
    pairs : list of (key, key)
    fitted : dict of key to (Model, Fit)

    Returns
    -------
    list of Block
    """
    found = []
    for a, b in pairs:
        for true, other in ((a, b), (b, a)):
            (model, fit), (rival, rival_fit) = fitted[true], fitted[other]
            values = {**{n: v.value for n, v in rival.parameters.items()}, **rival_fit.parameters}
            machine = {**{n: v.value for n, v in model.parameters.items()}, **fit.parameters}
            low, high = (np.array([getattr(rival_fit.variables[n], end) for n in rival_fit.free])
                         for end in ("min", "max"))
            found.append(Block(rival, rival_fit.free, values, prior_of(rival_fit), (model, machine),
                               ("@".join(true), "@".join(other)),
                               room=(low - rival_fit.values, high - rival_fit.values)))
    return found


def hidden_of(k, wanted):
    """Blocks that make effects visible: each at the nominal size of its coefficients.

    Parameters
    ----------
    k : Known
    wanted : list of (effect, place)

    Returns
    -------
    list of Block
    """
    found = []
    for name, place in wanted:
        effect = find_effect(k.library, name)
        larger = compile_model(k.library, k.study.rig, [*k.study.effects, (name, place)])
        base = component_name(effect, find_place(k.library, k.study.rig, effect, place))
        values = {**{n: v.value for n, v in larger.parameters.items()}, **k.values}
        sized = dict(values)
        for c in dict.fromkeys((*effect.size, *effect.scan)):
            v = larger.parameters[f"{base}.{c}"]
            sized[v.name] = v.value + (v.nominal if v.value + v.nominal <= v.max else -v.nominal)
        found.append(Block(larger, k.free, values, k.prior, (larger, sized), (f"{name}@{place}", "nothing")))
    return found


def hidden_effects(k):
    """Effects that an experiment with motors alone could show, at single places.

    Parameters
    ----------
    k : Known

    Returns
    -------
    list of (str, str)
    """
    from ..diagnosis.table import effect_question
    from ..compile import places
    found = []
    for effect in catalogue(k.library).values():
        simple = not (effect.channel or effect.measured or effect_question(k.library, effect).states)
        simple = simple and not any(f"{c}.{effect.replaces}" in k.free for c in k.workspace.kinematics.segments)
        if simple and "cycles" not in effect.scan.values() and "time" not in effect.scan.values():
            found += [(effect.id, p.name) for p in places(k.library, k.study.rig, effect)
                      if len(p.components) == 1 and (effect.id, p.name) not in k.study.effects]
    return found


# --- the plan -------------------------------------------------------------------------------------------------------


@dataclass
class Plan:
    """The next experiment.

    Attributes
    ----------
    goal : str
    known : Known
    motion : Motion
    design : Design
    blocks : list of Block
    fit : Fit
        That the identification should make of the new log alone.
    covariance : ndarray, shape (p, p)
        Of the parameters, old and new data together.
    torque : ndarray, shape (motors, n) or None
        Predicted [N.m].
    budget, rate : float
    """

    goal: str
    known: Known
    motion: object
    design: Design
    blocks: list
    fit: object
    covariance: np.ndarray
    torque: np.ndarray | None
    budget: float
    rate: float
    notes: list = field(default_factory=list)


def make_plan(k, goal="parameters", budget=120.0, rate=100.0, blocks=None, criterion="intervals", progress=None,
              patience=40.0):
    """Plan the next experiment.

    Parameters
    ----------
    k : Known
    goal : str
        ``parameters``, ``twins`` or ``detect``.
    budget : float
        Longest duration [s].
    rate : float
        Samples a second.
    blocks : list of Block, optional
        What is to be learnt; from the goal by default.
    criterion : str
        For parameters: ``D``, ``E``, or ``intervals``, their geometric mean.
    progress : callable, optional
        Called with a sentence before each stage.
    patience : float
        Time for the optimiser [s].

    Returns
    -------
    Plan

    Raises
    ------
    PlanError
        The limits leave no experiment, or nothing can be learnt.
    """
    say = progress or (lambda text: None)
    if not 0 < budget <= 1e5:
        raise PlanError(f"--budget {budget:g} s must be above zero, and not above 100000")
    if not 5 <= rate <= 1e5:
        raise PlanError(f"--rate {rate:g} Hz is outside 5 to 100000 Hz")
    if blocks is None:
        blocks = _blocks(k, goal, say)
    say("setting the experiment up")
    info = StrokeInformation(k.asked, k.workspace.kinematics, blocks, (k.model, k.values), k.noise, DWELL, 1 / rate)
    for travel in TRAVEL:
        optimiser = Optimiser(k.workspace, info, blocks, budget, k.asked.w_min, DWELL, criterion, travel)
        design = optimiser.solve(np.random.default_rng(k.study.seed), patience, say)
        try:
            motion = motion_of(design, k.workspace, budget, DWELL, rate)
            break
        except PlanError:
            if travel == TRAVEL[-1]:
                raise
    torque = _checked(k, motion)
    say("predicting the intervals")
    measured = [] if k.dataset is None else list(k.dataset.measured)
    log = expected(k.study, k.library, k.asked, k.workspace.kinematics, k.model, k.values, motion, measured)
    fit = predicted_fit(log, k.model, k.free, k.values, k.noise, "fit", k.study.seed)
    covariance = np.linalg.inv(k.prior + prior_of(fit)) if k.free else fit.covariance
    return Plan(goal, k, motion, design, blocks, fit, covariance, torque, budget, rate)


def _blocks(k, goal, say):
    if goal == "twins":
        return twins_of(k, None, say)
    if goal == "detect":
        return hidden_of(k, hidden_effects(k))
    if not k.free:
        raise PlanError(f"{k.study.path}: no parameter is free, so there is nothing to learn; write fixed = false at "
                        "those to identify")
    return [Block(k.model, k.free, k.values, k.prior, rows=determined(k.fit) if k.fit is not None else None)]


def determined(fit):
    """Combinations of the parameters that a fit determines: each by itself, or what is left of a null direction.

    Parameters
    ----------
    fit : Fit

    Returns
    -------
    ndarray, shape (k, p)
        Of parameters over their nominal values.
    """
    p, nominal = len(fit.free), np.array([fit.variables[n].nominal for n in fit.free])
    if not len(fit.null_directions):
        return np.eye(p)
    _, size, null = np.linalg.svd(fit.null_directions / nominal, full_matrices=False)
    null = null[size > 1e-9 * size[0]]
    open_ones = [not fit.identifiable(n) for n in fit.free]
    alone = np.eye(p)[np.invert(open_ones)]
    inside = np.eye(p)[open_ones]
    values, vectors = np.linalg.eigh(inside @ (np.eye(p) - null.T @ null) @ inside.T)
    return np.vstack([alone, vectors[:, values > 0.5].T @ inside])


def _checked(k, motion):
    """Torques of the finished motion; every limit is looked at once more, sample by sample.

    Raises
    ------
    PlanError
        With the limit that does not hold.
    """
    limits, kin = k.workspace.limits, k.workspace.kinematics
    signals = signals_of(k.asked, kin, k.model, k.values, motion)
    torque = np.array([signals[f"{m}.tau"] for m in kin.motors]) if f"{kin.motors[0]}.tau" in signals else None
    if k.workspace.margin(motion.angle).min() < 0:
        raise PlanError("the motion would meet a stop; the limits of the angles leave too little room")
    for what, values, bound, unit in (("w", motion.speed, limits.speed, "rad/s"),
                                      ("a", motion.acceleration, limits.acceleration, "rad/s2"),
                                      ("tau", torque, limits.torque, "N.m")):
        if values is None:
            continue
        over = np.abs(values).max(axis=1) - bound
        if over.max() > 1e-9 * bound.min():
            motor = kin.motors[int(np.argmax(over))]
            raise PlanError(f"the limit of '{motor}.{what}', {bound[int(np.argmax(over))]:g} {unit}, does not hold on "
                            f"the ways between strokes ({np.abs(values).max():.3g} {unit}); widen it, or tighten the "
                            "angles to where less is needed")
    return torque


def table(plan):
    """The planned motion as a table: what a scenario's trajectory and a drive read.

    Parameters
    ----------
    plan : Plan

    Returns
    -------
    dict of str to ndarray, shape (n,)
        ``time``, angle and speed of every motor by variable, and ``manoeuvre``.
    """
    motors, motion = plan.known.workspace.kinematics.motors, plan.motion
    found = {"time": motion.time}
    found.update({f"{m}.phi": motion.angle[k] for k, m in enumerate(motors)})
    found.update({f"{m}.w": motion.speed[k] for k, m in enumerate(motors)})
    return {**found, "manoeuvre": motion.label}


def separations(plan):
    """By how much rivals should differ after the experiment, and whether that names the right one.

    Parameters
    ----------
    plan : Plan

    Returns
    -------
    list of dict
        ``true``, ``other``, ``difference`` (in standard deviations of the noise), ``share`` of the difference that the
        other cannot bend to, ``separable``, and the ``time`` that would separate them, as squares grow with it [s].
    """
    found = []
    for block, gram in zip(plan.blocks, plan.design.grams):
        if block.other is None:
            continue
        whole, free = gram[-1, -1], np.full(len(gram) - 1, np.inf)
        bent, _ = least_squares.bounded(gram[:-1, :-1], gram[:-1, -1], *(block.room or (-free, free)))
        left = max(float(whole - bent), 0.0)
        true, other = block.name
        found.append({"true": true, "other": other, "difference": math.sqrt(left),
                      "share": math.sqrt(left / whole) if whole > 0 else 0.0, "separable": left > SEPARATE,
                      "time": plan.budget * SEPARATE / left if left > ALIKE else None})
    return found

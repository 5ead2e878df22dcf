"""What is known and what is asked in; the strokes that tell most in the time given, out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..core.errors import PlanError
from .information import ChannelNoise
from .motion import PEAK, SHORTEST_RAMP, Stroke

MEMORY = 1.0  # s
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
DRAWN = 60  # random points from which the starts are chosen: a gradient need not lead to where rivals differ most
SHORTEST = 0.0075  # of a way, over the size of the workspace; below 0.005 `segmentation` sees no way out and back
PRESLIDING = 50.0  # least way of a segment over its elastic displacement: friction has built up in 2 % of a pass


@dataclass
class Asked:
    """What is compared, and from what.

    Attributes
    ----------
    outputs, known : list of str
        Variables that are computed, and those that they are computed from.
    paired : bool
        Whether half differences of ways out and back are compared, for want of a torque reference.
    ask : callable
        Question of a model.
    channels : list of str
        What is compared, as ``C_H`` or ``C_H_pair``.
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
        Its columns and its reference count where there is no data set.
    model : Model
        Whose rig says what it can answer.
    dataset : Dataset, optional
        Logs made by now.

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
        Whose noise is known.
    info : Asked
        What the planned log will compare.

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
        What the data told; without one, the bounds alone count.
    free : list of str, optional
        The fit's by default.
    variables : dict of str to Variable, optional
        Bounds of the parameters; those of the fit by default.

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
        Where the motors can go, and in which zones of direction.
    info : StrokeInformation
        What a stroke tells.
    blocks : list of Block
        Those that `info` was made with.
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
            Draws where the strokes lie and how long they are.

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
            Draws the starts.
        seconds : float
            Time that may be used for it.
        progress : callable
            Called with a sentence before each start.

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
        for k in range(len(self.slots)):
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
        Information of the whole experiment, and of what was known.
    block : Block
        Whose parameters these are.
    criterion : str
        ``D``, ``E`` or ``intervals``.

    Returns
    -------
    MX

    References
    ----------
    .. [1] Atkinson, A. C., Donev, A. N. and Tobias, R. D. (2007). Optimum Experimental Designs, with SAS. Oxford
           University Press.
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

"""An effect in; what it adds to the ports of its place, as functions of their state, out."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..core import cache
from . import ArrayFunction, potentials, solve
from .effects import ports
from .model import Question, _dump, _load

AHEAD = "ahead(signal.tau)"  # by how much a torque is ahead of its record
HELD = "ahead(reference)"  # by how much what is compared is ahead of the record that it is compared with
TIMES = ("delay", "lag")  # by which an effect holds a record back


def additions(library, effect):
    """What an effect may add, and the parameter of the place's probe that stands for it.

    Parameters
    ----------
    library : Library
        Which holds the effect and the probes.
    effect : Effect
        Its ports say where it adds.

    Returns
    -------
    dict of str to (str, str)
        Variable of the effect, to the connector and the parameter of the probe there.
    """
    found = {a: (c, a) for c in effect.ports if c in ports(library) for a in ports(library)[c].additions}
    # a torque taken at the shaft reads like one in the channel
    return {**found, "loss": found["dtau"]} if "dtau" in found else found


def effect_question(library, effect):
    """An effect's own equation: state of its ports in, additions out.

    Parameters
    ----------
    library : Library
        Which holds the effect.
    effect : Effect
        Of its equation alone; no rig is needed.

    Returns
    -------
    Question

    Raises
    ------
    ModelicaError
        The effect by itself does not compile, or does not determine its additions.
    """
    def make():
        flat = library.flatten(effect.model)
        open_ports = tuple(f"{c}." for c in effect.connectors)  # a class by itself has its flows set to zero
        flat.equations = [e for e in flat.equations if not (e.is_symbolic() and e.name().startswith(open_ports))]
        known = [*(f"{c}.{m}" for c, kind in effect.connectors.items() for m in potentials(library, kind)),
                 *effect.inputs]
        solution = solve(flat, known)
        values = solution.values
        if effect.channel:  # adds to a record what it has not caught up with yet
            solution.symbols[AHEAD] = ca.SX.sym(AHEAD)
            values["dtau"] = -solution.symbols[AHEAD]
        elif "dC" in values and not values["lag"].is_zero():  # the same of what it is compared with
            solution.symbols[HELD] = ca.SX.sym(HELD)
            values["dC"] = -solution.symbols[HELD]
        outputs = [o for o in [*additions(library, effect), *TIMES] if o in values and not values[o].is_zero()]
        y = ca.vertcat(*[values[o] for o in outputs])
        states = solution.states
        rates = ca.vertcat(*[values[flat.derivatives[s]] for s in states]) if states else ca.SX(0, 1)
        used = [s.name() for s in ca.symvar(ca.vertcat(y, rates))]
        inputs = [n for n in used if n not in flat.parameters and n not in states]
        parameters = list(flat.parameters)
        arguments = [ca.vertcat(*[solution.symbols[n] for n in names]) if names else ca.SX(0, 1)
                     for names in (inputs, states, parameters)]
        described = dict(flat.parameters)
        return Question(inputs, states, parameters, outputs, ca.Function("output", arguments, [y]),
                        ca.Function("rate", arguments, [rates]), described)

    key = cache.digest(library.digest, "effect", effect.model)
    return library.memo(("effect", effect.id), lambda: cache.remember("effect", key, make, _dump, _load))


class Contribution:
    """What an effect adds to its ports a unit of its coefficients, near its neutral point."""

    def __init__(self, library, effect):
        self.effect, self.question = effect, effect_question(library, effect)
        q = self.whole = self.question
        self.question = q = q.select([o for o in q.outputs if o not in TIMES])
        self.defaults = {n: v.value for n, v in q.variables.items()}
        u, x, p = q.symbols()
        y = q.output(u, x, p)
        sizes = [p[q.parameters.index(c)] for c in effect.size]
        whole = ca.substitute(y, ca.vertcat(*sizes), [self.defaults[c] for c in effect.size]) if sizes else y
        self.coefficients, parts = list(effect.size), [ca.jacobian(y, size) for size in sizes]
        if effect.scan and not _vanishes(whole):  # what has no amplitude: its addition at the grid point itself
            self.coefficients.insert(0, next(iter(effect.scan)))
            parts.insert(0, whole)
        self.function = ArrayFunction(ca.Function("contribution", [u, x, p], [ca.densify(ca.cse(v)) for v in parts]))

    def times(self, grid):
        """Delay and time constant at a grid point.

        Parameters
        ----------
        grid : dict of str to float
            Values of the coefficients that vanish with the effect.

        Returns
        -------
        delay, lag : float
            [s]
        """
        values, held = {**self.defaults, **grid}, [t for t in TIMES if t in self.whole.outputs]
        chosen = self.whole.select(held)
        arguments = [0.0] * len(chosen.inputs) + [values[p] for p in chosen.parameters]
        found = dict(zip(held, ArrayFunction(chosen.output)(arguments, 1)[:, 0]))
        return tuple(float(found.get(t, 0.0)) for t in TIMES)

    def __call__(self, signals, states, grid, n):
        """Additions, shape (coefficients, ports, n)."""
        q = self.question
        values = {**self.defaults, **grid}
        arguments = [signals[i] for i in q.inputs] + list(states) + [values[p] for p in q.parameters]
        return self.function(arguments, n).reshape(len(self.coefficients), len(q.outputs), n)


def _vanishes(expression):
    """Whether an expression is zero whatever its variables, and whatever their signs, by numbers."""
    names = ca.symvar(expression)
    value = ca.Function("value", names, [ca.densify(expression)])
    rng = np.random.default_rng(0)
    sizes, signs = rng.uniform(0.2, 0.9, (16, len(names))), rng.choice((-1.0, 1.0), (16, len(names)))
    points = sizes * np.where(np.arange(16)[:, None] < 4, 1.0, signs)
    found = [np.abs(np.array(value.call([ca.DM(v) for v in p])[0])).max() for p in points]
    return max((f for f in found if np.isfinite(f)), default=1.0) < 1e-12  # a power of a negative one is no number

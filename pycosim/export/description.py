"""A study and its model in, the plant as other tools see it out: numbered variables and the functions behind them."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

import casadi as ca

from ..compile import solve
from ..compile.effects import component_names, components_of, is_effect
from ..core.errors import StudyError
from ..core.units import Variable
from ..dynamics.simulate import dynamics
from ..dynamics.stepping import with_choices
from .units import rate as unit_of_rate

STEP = "solver.step"
STILL = 0.999  # of the breakaway: a segment that carries less, and hardly moves, stands still
W_MIN = 0.02   # rad/s; the least speed at which a sample counts as moving, unless the study says otherwise


@dataclass
class Entry:
    """One variable of the exported plant.

    Attributes
    ----------
    variable : Variable
        Name, unit, description, value (the start), min, max, nominal.
    causality, variability : str
        In the words of the standard.
    initial : str or None
        ``exact``, ``calculated``, or None for inputs and time.
    state : int or None
        For a derivative, the number of its state.
    depends : list of int
        Numbers of the inputs, states and time it depends on.
    initially : list of int
        The same, parameters included: what it depends on while the model is initialised.
    boolean : bool
        Whether it is a flag, as ``s1A.still``; every other variable is a real number in SI.
    """

    variable: Variable
    causality: str
    variability: str
    initial: str | None = None
    state: int | None = None
    depends: list = field(default_factory=list)
    initially: list = field(default_factory=list)
    boolean: bool = False

    @property
    def name(self):
        """Modelica name."""
        return self.variable.name


@dataclass
class Plant:
    """A machine ready to be exported.

    Attributes
    ----------
    name, rig, description : str
        The study's name, its Modelica class, and what that says of itself.
    model : Model
        The compiled rig with effects.
    parameters : dict of str to float
        Every parameter of the rig, with the study's values.
    identified : set of str
        Parameters whose value the study gives.
    entries : list of Entry
        In the order of their numbers: time, states, derivatives, inputs, parameters, other variables, flags.
    functions : list of casadi.Function
        ``model_initial``, ``model_step``, ``model_observe``, ``model_forward``, ``model_reverse``.
    sizes : dict of str to int
        ``x``, ``z``, ``u``, ``p``, ``q`` (what the parameters alone ask for), ``y``, ``e``.
    terminals : list of (str, dict of str to str)
        Motors and joints: name, and member to variable.
    stepping : str
        How it steps, in HTML, where not as a machine does.
    sampled : bool
        Whether its states change once a period, the last parameter, and its outputs are held in between.
    speeds : list of int or None
        For each state, which one is its derivative; empty where none is.
    limits : dict of str to (float or None, float or None)
        The study's, by variable or sum of angles: stops, torques, speeds.
    """

    name: str
    rig: str
    description: str
    model: object
    parameters: dict
    identified: set
    entries: list
    functions: list
    sizes: dict
    terminals: list
    stepping: str = ""
    sampled: bool = False
    speeds: list = field(default_factory=list)
    limits: dict = field(default_factory=dict)


def describe(study, model):
    """The plant of a study.

    Parameters
    ----------
    study : Study
        Its values become the start values of parameters, its limits those of motors and joints.
    model : Model
        Its compiled rig with effects, from ``study.validate``.

    Returns
    -------
    Plant

    Raises
    ------
    StudyError
        The rig cannot be simulated, or a name is taken twice.
    """
    return _Builder(study, model).plant()


def values(study, model):
    """Every parameter of a model with the study's values.

    Parameters
    ----------
    study : Study
        Whose ``[parameters]`` count.
    model : Model
        Gives the rest.

    Returns
    -------
    dict of str to float
        In the unit that the model gives each; those not in the study have the rig's own value.
    """
    given = {n: s.value for n, s in study.parameters.items() if s.value is not None}
    return {n: given.get(n, v.value) for n, v in model.parameters.items()}


def tunable(model):
    """Parameters of friction and effects; the others are the structure of the machine.

    Parameters
    ----------
    model : Model
        A rig with its effects.

    Returns
    -------
    list of str
    """
    base = {c for c, (kind, _) in components_of(model.library, model.rig).items()
            if kind not in ("Real", "Integer", "Boolean", "String") and is_effect(model.library, kind)}
    own = base | set(model.segments) | {c for e, p in model.attached for c in component_names(e, p)}
    return [n for n in model.parameters if n.rpartition(".")[0] in own]


class _Builder:
    """Collects variables and expressions over one set of CasADi symbols."""

    def __init__(self, study, model):
        self.study, self.model, self.d = study, model, dynamics(model)
        self.values = values(study, model)
        self.flat = model.flat
        self.x, self.z, self.u, self.t = (ca.SX.sym("x", len(self.d.states)), ca.SX.sym("z", len(self.d.algebraic)),
                                          ca.SX.sym("u", len(self.d.inputs)), ca.SX.sym("t"))
        self.p = ca.SX.sym("p", len(self.d.parameters))
        self.currents = self._currents()
        gains = ca.SX.sym("k_m", len(self.currents))
        self.p_all = ca.vertcat(self.p, gains, ca.SX.sym("step"))
        self.factor = ca.SX.ones(len(self.d.inputs))
        for k, i in enumerate(self.currents):
            self.factor[i] = gains[k]
        self.torque = self.u * self.factor  # what the rig's equations take
        self.others = self._others()

    # --- expressions ---

    def _raw(self):
        """All variables of the rig over the rig's own symbols: name to expression."""
        y = self.d.output(self.x, self.z, self.u, self.p, self.t)
        found = dict(zip(self.d.outputs, ca.vertsplit(y) if self.d.outputs else []))
        found.update({n: self.z[k] for k, n in enumerate(self.d.algebraic) if not n.startswith("der(")})
        return found

    def _alias(self, expression, symbols):
        """Number of the symbol that an expression is, or None."""
        for k, s in enumerate(ca.vertsplit(symbols)):
            if ca.is_equal(expression, s, 3):
                return k
        return None

    def _currents(self):
        """Inputs that the study maps from a current: number of the input to (name, torque constant)."""
        raw, found = self._raw(), {}
        raw.update({n: self.u[k] for k, n in enumerate(self.d.inputs)})
        for label, column in self.study.columns.items():
            if column.k_m is None or column.variable not in raw:
                continue
            number = self._alias(raw[column.variable], self.u)
            if number is not None:
                name = re.sub(r"\W", "_", label, flags=re.ASCII)
                taken = name in raw or name in self.values or not re.match(r"[A-Za-z_]", name)
                found[number] = (f"{self.d.inputs[number]}_current" if taken else name, column.k_m)
        return found

    def _others(self):
        """Everything that is computed, in order: variables of the rig, bound parameters, margins to moving."""
        raw = self._raw()
        raw.update({self.d.inputs[i]: self.u[i] for i in self.currents})
        found = {n: e for n, e in raw.items() if n not in self.d.states}
        names = [s for s in self.d.parameters]
        if self.flat.bindings:
            symbols = ca.vertcat(*[self.flat.symbols[n] for n in names])
            bound = ca.Function("bound", [symbols], [ca.vertcat(*self.flat.bindings.values())])(self.p)
            found.update(zip(self.flat.bindings, ca.vertsplit(bound)))
        full = {**raw, **{n: self.x[k] for k, n in enumerate(self.d.states)}}
        for c in self.model.segments:
            speed, ratio = (ca.fabs(full[f"{c}.{n}"]) for n in ("w", "s"))
            found[f"{c}.still_margin"] = ca.fmax(speed / self.w_min, ratio / STILL) - 1
        expressions = ca.substitute(list(found.values()), [self.u], [self.torque])
        return dict(zip(found, expressions))

    @property
    def w_min(self):
        """Speed [rad/s] below which a segment may stand still."""
        return self.study.w_min or W_MIN

    def _functions(self):
        """The functions that the wrapper calls, and the sparsity of everything computed."""
        arguments, names = [self.x, self.z, self.u, self.p_all, self.t], ["x", "z", "u", "p", "t"]
        xdot, residual = system(self.model, self.d)(self.x, self.z, self.torque, self.p, self.t)
        y = ca.vertcat(*self.others.values(), ca.SX(0, 1))
        observe = ca.Function("model_observe", arguments, [ca.densify(ca.cse(xdot)), ca.densify(ca.cse(y))], names,
                              ["xdot", "y"])
        forward, reverse, sparsity = derivatives(arguments, xdot, y, residual)
        return [*self._stepping(), observe, forward, reverse], sparsity

    def _stepping(self):
        """What only the parameters ask for, gains of the inputs last; a start that fits, and a step, which take it."""
        d, n = self.d, self.d.prepare.numel_out(0)
        prepare = ca.Function("model_prepare", [self.p_all], [ca.vertcat(d.prepare(self.p), self.factor)], ["p"], ["q"])
        X, Z, U0, U1, T, H = (ca.MX.sym(k, a) for k, a in (
            ("x", self.x.numel()), ("z", self.z.numel()), ("u0", self.u.numel()), ("u1", self.u.numel()), ("t", 1),
            ("h", 1)))
        Q = ca.MX.sym("q", prepare.numel_out(0))
        q, gain = Q[:n], Q[n:]
        initial = ca.Function("model_initial", [X, Z, U0, Q, T], [d.initial(X, Z, U0 * gain, q, T)],
                              ["x", "z", "u", "q", "t"], ["z_now"])
        step = ca.Function("model_step", [X, Z, U0, U1, Q, T, H], d.step.call([X, Z, U0 * gain, U1 * gain, q, T, H]),
                           ["x", "z", "u0", "u1", "q", "t", "h"], ["x_next", "z_next", "error"])
        return [prepare, initial, step]

    # --- variables ---

    def plant(self):
        """Put it together.

        Returns
        -------
        Plant

        Raises
        ------
        StudyError
            A name is taken twice.
        """
        functions, sparsity = self._functions()
        entries = [Entry(Variable("time", "s", "Time"), "independent", "continuous")]
        entries += self._states() + self._rates() + self._inputs() + self._parameters() + self._computed()
        entries += self._flags()
        names = [e.name for e in entries]
        for name in names:
            if names.count(name) > 1:
                raise StudyError(f"{self.study.path}: the name '{name}' is taken twice in the export of "
                                 f"{self.study.rig}; rename the column or component")
        sizes = {"x": len(self.d.states), "z": len(self.d.algebraic), "u": len(self.d.inputs),
                 "p": self.p_all.numel(), "q": functions[0].numel_out(0), "y": len(self.others),
                 "e": len(self.model.segments)}
        depend(entries, sizes, sparsity)
        comment = (self.model.library.find(self.study.rig).comment or "").strip('"')
        identified = {n for n, s in self.study.parameters.items() if s.value is not None}
        return Plant(self.study.name, self.study.rig, comment, self.model, self.values, identified, entries, functions,
                     sizes, self._terminals(), speeds=self.d.speeds, limits=self.study.limits)

    def _described(self, name):
        v = replace(self.flat.variables.get(name) or self.flat.parameters.get(name) or Variable(name), name=name)
        if name in self.study.parameters:  # a study may widen the rig's bounds; its narrower ones are those of a fit
            wanted = self.study.parameters[name].applied(v)
            v = replace(v, min=min(v.min, wanted.min), max=max(v.max, wanted.max), nominal=wanted.nominal)
        return v

    def _wanted(self):
        """Outputs: what the rig's questions name, top-level variables, motors and segments."""
        wanted = {n for q in ("simulate", "estimate") if self.model.notes.get(q)
                  for names in self.model.alternatives(q)[0] for n in names}
        wanted |= {n for n in self.flat.variables if "." not in n}
        wanted |= {f"{c}.{m}" for c in self.model.components("signal")
                   for m in ("phi", "w", "i", "tau", "tau_shaft")}
        wanted |= {f"{c}.{m}" for c in self.model.segments for m in ("w", "s", "L", "F", "loss")}
        return wanted

    def _states(self):
        wanted = self._wanted()
        return [Entry(self._described(n), "output" if n in wanted else "local", "continuous", "exact")
                for n in self.d.states]

    def _rates(self):
        found = []
        for k, n in enumerate(self.d.states):
            v = self._described(n)
            rate = Variable(f"der({n})", unit_of_rate(v.unit), f"Derivative of {n}")
            found.append(Entry(rate, "local", "continuous", "calculated", k))
        return found

    def _inputs(self):
        found = []
        for k, n in enumerate(self.d.inputs):
            v = self._described(n)
            if k in self.currents:
                name = self.currents[k][0]
                v = Variable(name, "A", f"Current that makes {n}: {v.description}", 0.0)
            found.append(Entry(v, "input", "continuous"))
        return found

    def _parameters(self):
        found, changeable = [], set(tunable(self.model))
        for n in self.d.parameters:
            v = replace(self._described(n), value=self.values[n])
            found.append(Entry(v, "parameter", "tunable" if n in changeable else "fixed", "exact"))
        for k, (name, k_m) in self.currents.items():
            v = Variable(f"k_m_{name}", "N.m/A", f"Torque constant: {self.d.inputs[k]} over {name}", k_m)
            found.append(Entry(v, "parameter", "fixed", "exact"))
        step = Variable(STEP, "s", "Longest integration step in co-simulation", 1e-3, 1e-6, 0.1, 1e-3)
        return [*found, Entry(step, "parameter", "fixed", "exact")]

    def _computed(self):
        wanted, changeable, found = self._wanted(), set(tunable(self.model)), []
        for n in self.others:
            if n in self.flat.bindings:
                sources = {s.name() for s in ca.symvar(self.flat.bindings[n])}
                kind = "tunable" if sources & changeable else "fixed"
                found.append(Entry(self._described(n), "calculatedParameter", kind, "calculated"))
            elif n.endswith(".still_margin"):
                text = f"Below zero while {n.rpartition('.')[0]} stands still"
                found.append(Entry(Variable(n, "1", text), "local", "continuous", "calculated"))
            else:
                kind = "output" if n in wanted else "local"
                found.append(Entry(self._described(n), kind, "continuous", "calculated"))
        return found

    def _flags(self):
        """Local, not outputs: CasADi's importer takes every output for a real number."""
        text = f"Stands still: slower than {self.w_min:g} rad/s and loaded below {STILL:.1%} of its friction"
        return [Entry(Variable(f"{c}.still", "1", text), "local", "discrete", "calculated", boolean=True)
                for c in self.model.segments]

    def _terminals(self):
        """Motors, and places where a torque acts from outside."""
        names = [self.currents[k][0] if k in self.currents else n for k, n in enumerate(self.d.inputs)]
        raw, found = self._raw(), []
        for c in self.model.components("signal"):
            drive = next((n for m in ("tau", "v") if f"{c}.{m}" in raw
                          for n in [self._alias(raw[f"{c}.{m}"], self.u)] if n is not None), None)
            members = {m: f"{c}.{m}" for m in ("phi", "w", "tau_shaft") if f"{c}.{m}" in self.flat.variables}
            if drive is not None:
                members["drive"] = names[drive]
            found.append((c, members))
        for n in raw:
            component, _, last = n.rpartition(".")
            angle = raw.get(f"{component}.flange.phi")
            drive = self._alias(raw[n], self.u) if last == "tau" and component.count(".") == 0 else None
            state = None if angle is None or component in dict(found) else self._alias(angle, self.x)
            if drive is not None and state is not None:
                joint = self.d.states[state]
                found.append((component, {"tau": names[drive], "phi": joint, "w": f"der({joint})"}))
        return found


def system(model, d):
    """The equations behind a step; rates and derivatives need no solver.

    Parameters
    ----------
    model : Model
        A rig that can be simulated: each motor and joint has its equation of motion.
    d : Dynamics
        Of the same model; it gives the order of the vectors.

    Returns
    -------
    casadi.Function
        ``(x, z, u, p, t) -> (xdot, residual)``: derivatives of the states, and what is zero where z fits.
    """
    wanted, _ = model.alternatives("simulate")[0]
    flat = replace(model.flat)  # solving adds derivatives to it
    solution = solve(flat, d.inputs, keep=wanted, explicit=False)
    arguments = [ca.vertcat(*[solution.symbols[n] for n in names], ca.SX(0, 1))
                 for names in (d.states, d.algebraic, d.inputs, d.parameters)]
    xdot = [solution.values.get(flat.derivatives[n], solution.symbols[flat.derivatives[n]]) for n in d.states]
    return ca.Function("system", [*arguments, solution.symbols["time"]],
                       [ca.vertcat(*xdot, ca.SX(0, 1)), ca.vertcat(*solution.residuals, ca.SX(0, 1))])


def derivatives(arguments, xdot, y, residual):
    """Derivatives along a direction, their transpose, and their sparsity; algebraic variables follow the others.

    Where the residual R(v, z) is zero, R_v dv + R_z dz = 0 gives dz. The residual stays as it is: where two of its
    pieces meet, as at no load, CasADi's mean of both slopes keeps it regular.

    Parameters
    ----------
    arguments : list of casadi.SX
        Symbols: states, algebraic variables, inputs, parameters, time.
    xdot, y, residual : casadi.SX
        Derivatives of the states, what is computed besides, and what is zero where the algebraic variables fit.

    Returns
    -------
    forward, reverse : casadi.Function
        ``model_forward``, ``model_reverse``.
    sparsity : casadi.Sparsity
        Of derivatives and computed variables, by states, inputs, parameters and time.
    """
    x, z, u, p, t = arguments
    xdot, y = ca.vertsplit(with_choices(ca.vertcat(xdot, y)), [0, xdot.numel(), xdot.numel() + y.numel()])
    v, out, slope = ca.vertcat(x, u, p, t), ca.vertcat(xdot, y), ca.jacobian(residual, z)
    dv, w = ca.SX.sym("dv", v.numel()), ca.SX.sym("w", out.numel())
    dz = -ca.solve(slope, ca.jtimes(residual, v, dv)) if z.numel() else ca.SX(0, 1)
    ahead = ca.jtimes(out, v, dv) + ca.jtimes(out, z, dz)
    back = ca.jtimes(out, v, w, True)
    if z.numel():
        back -= ca.jtimes(residual, v, ca.solve(slope.T, ca.jtimes(out, z, w, True)), True)
    parts = [0, x.numel(), x.numel() + u.numel(), v.numel() - 1, v.numel()]
    at, split = xdot.numel(), [ca.densify(e) for e in ca.vertsplit(ca.cse(back), parts)]
    ahead = ca.densify(ca.cse(ahead))
    forward = ca.Function("model_forward", [*arguments, *ca.vertsplit(dv, parts)], [ahead[:at], ahead[at:]])
    reverse = ca.Function("model_reverse", [*arguments, w[:at], w[at:]], split)
    followed = ca.substitute(out, z, z - ca.solve(slope, residual)) if z.numel() else out
    return forward, reverse, ca.Function("all", [v, z], [followed]).jac_sparsity(0, 0)


def depend(entries, sizes, sparsity):
    """Fill in what each derivative and computed variable depends on.

    Parameters
    ----------
    entries : list of Entry
        Changed in place.
    sizes : dict of str to int
        Of `Plant`.
    sparsity : casadi.Sparsity
        Of `derivatives`.
    """
    x, u, p = (sizes[k] for k in "xup")
    columns = [*range(1, 1 + x), *range(1 + 2 * x, 1 + 2 * x + u + p), 0]  # states, inputs, parameters, time
    rows = [*range(1 + x, 1 + 2 * x), *range(1 + 2 * x + u + p, 1 + 2 * x + u + p + sizes["y"])]
    found = {}
    for row, column in zip(*sparsity.get_triplet()):
        found.setdefault(rows[row], set()).add(columns[column])
    flags, parameters = len(entries) - sizes["e"], range(1 + 2 * x + u, 1 + 2 * x + u + p)
    for number, entry in enumerate(entries):
        at = number - sizes["e"] if number >= flags else number  # a flag depends on what its margin depends on
        own = entry.causality == "output" and entry.initial == "exact"
        entry.initially = [number] if own else sorted(found.get(at, ()))
        entry.depends = [k for k in entry.initially if k not in parameters]


def c_name(text):
    """The nearest name that C and Modelica take.

    Parameters
    ----------
    text : str
        Any; ``hip knee-2`` becomes ``hip_knee_2``.

    Returns
    -------
    str
        Letters, digits and underscores, a letter first.

    Examples
    --------
    >>> c_name("arm one")
    'arm_one'
    """
    name = re.sub(r"\W", "_", text, flags=re.ASCII)
    return name if name[:1].isalpha() else f"m_{name}"

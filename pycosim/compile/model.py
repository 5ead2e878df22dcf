"""One model, and the questions it answers: which variables are known decides which."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property

import casadi as ca

from ..core import cache
from ..core.errors import ModelicaError, StudyError, UnknownNameError, closest
from ..core.units import Variable
from .attach import Hung, attach, extend
from .effects import (
    annotation,
    catalogue,
    component_name,
    component_names,
    components_of,
    find_place,
    is_connector,
    is_effect,
    ports,
)
from .solve import der, solve

RECORDED = "tau"  # what a component with a torque channel records
FILTERED = "at(lag({}))", "by(lag({}))"  # inputs: a record's lag as it is undone, and its derivative by that


@dataclass
class Question:
    """Explicit answer of a model to one question, as CasADi functions.

    Attributes
    ----------
    inputs : list of str
        Known variables; ``der(x)`` is the derivative of a known ``x``, and ``time`` may be one of them.
    states : list of str
        Friction states.
    parameters : list of str
        What the answer depends on besides, in the order of the functions' last argument.
    outputs : list of str
        What is asked for, in the order of ``output``.
    output : casadi.Function
        ``(inputs, states, parameters) -> outputs``.
    rate : casadi.Function
        ``(inputs, states, parameters) -> derivative of the states``.
    variables : dict of str to Variable
        Unit and description of every name.
    late : dict of str to str
        Inputs that were recorded late, and the output that says by how much; the output ``lag(x)`` says how much of
        it is the time constant of a filter. The function holds what the delay does to first order about ``at(x)``, an
        input: there its value is exact when x is given at that much later. So with a filter, about ``at(lag(x))``, with
        ``by(lag(x))`` the derivative of x by the time constant.
    held : dict of str to str
        Components whose reference a filter of first order has held back, and the output that is its time constant.
        The outputs themselves are those before the filter.
    """

    inputs: list
    states: list
    parameters: list
    outputs: list
    output: ca.Function
    rate: ca.Function
    variables: dict = field(default_factory=dict)
    late: dict = field(default_factory=dict)
    held: dict = field(default_factory=dict)
    _memo: dict = field(default_factory=dict, init=False, repr=False, compare=False)

    def memo(self, key, make):
        """Return ``make()``, computed once a key and kept as long as this object.

        Parameters
        ----------
        key : hashable
            Begins with the name of who asks.
        make : callable
            Without arguments.

        Returns
        -------
        object
        """
        if key not in self._memo:
            self._memo[key] = make()
        return self._memo[key]

    def symbols(self):
        """Fresh symbols for inputs, states and parameters.

        Returns
        -------
        u, x, p : SX, shape (k, 1)
            In the order of ``inputs``, ``states`` and ``parameters``.
        """
        return (ca.SX.sym("u", len(self.inputs)), ca.SX.sym("x", len(self.states)),
                ca.SX.sym("p", len(self.parameters)))

    def select(self, outputs):
        """The same question with fewer outputs.

        Parameters
        ----------
        outputs : list of str
            Among those of the question.

        Returns
        -------
        Question
            With the outputs in this order.
        """
        u, x, p = self.symbols()
        y = self.output(u, x, p)
        rows = [y[self.outputs.index(o)] for o in outputs]
        names = ["u", "x", "p"], ["y"]
        return Question(self.inputs, self.states, self.parameters, list(outputs),
                        ca.Function("output", [u, x, p], [ca.vertcat(*rows)], *names), self.rate, self.variables,
                        self.late, self.held)

    def swapped(self, names):
        """The same question with pairs of outputs under each other's name.

        Parameters
        ----------
        names : dict of str to str
            Each output of a pair to the other.

        Returns
        -------
        Question
        """
        both = {**names, **{b: a for a, b in names.items()}}
        return replace(self, outputs=[both.get(n, n) for n in self.outputs]) if names else self

    def fixed(self, values):
        """The same question with some parameters at given numbers, and simpler for it; made once.

        Parameters
        ----------
        values : dict of str to float
            By parameter, in its unit.

        Returns
        -------
        Question
        """
        def make():
            u, x, p = self.symbols()
            q = ca.vertcat(*[values.get(n, s) for n, s in zip(self.parameters, ca.vertsplit(p))])
            output, rate = (ca.Function(f.name(), [u, x, p], [ca.cse(f(u, x, q))], ["u", "x", "p"], ["y"])
                            for f in (self.output, self.rate))
            return replace(self, output=output, rate=rate)

        return self.memo(("fixed", *sorted(values.items())), make)

    def sliding(self):
        """The same question for sliding segments: every friction state at its limit, the sign of the speed.

        Returns
        -------
        casadi.Function
            ``(inputs, parameters) -> outputs``; stateless, for users who want one function to take away.
        """
        u, x, p = self.symbols()
        y = self.output(u, x, p)
        if self.states:
            y = ca.substitute(y, x, ca.vertcat(*[_limit(r, s) for r, s in
                                                 zip(ca.vertsplit(self.rate(u, x, p)), ca.vertsplit(x))]))
        return ca.Function("estimate", [u, p], [ca.cse(y)], ["u", "p"], ["y"])


def _limit(rate, x):
    """Where a friction state ends that moves on and on: at 1 or -1 its rate is straight, if it bends at all."""
    toward = ca.sign(ca.substitute(rate, x, 0.0))
    slope, end = (ca.substitute(e, x, toward) for e in (ca.jacobian(rate, x), rate))
    return ca.if_else(slope < 0, toward - end / slope, 0)


def along_axis(unit):
    """Unit that a rotational one stands for on a linear axis.

    Parameters
    ----------
    unit : str
        As ``N.m.s/rad``.

    Returns
    -------
    str
        As ``N.s/m``.
    """
    for turning, along in (("kg.m2", "kg"), ("N.m", "N"), ("rad", "m"), ("(N)", "N")):
        unit = unit.replace(turning, along)
    return unit


def wave_units(effect):
    """Units that an effect's wave over a position has: cycles are counted along it, and a phase stays an angle.

    Parameters
    ----------
    effect : Effect
        One that scans ``cycles`` has a wave.

    Returns
    -------
    dict of str to str
        By coefficient; empty for an effect without a wave.
    """
    return {c: {"cycles": "rad/m", "quadrature": "rad"}[kind] for c, kind in effect.scan.items()
            if kind in ("cycles", "quadrature")}


class Model:
    """A rig with effects attached.

    Parameters
    ----------
    library : Library
        Which holds the rig and the effects.
    rig : str
        Modelica class.
    attached : sequence of (str, str)
        Effect and place names.
    probes : bool
        Hang a probe on every segment and motor, whose parameters are the additions an effect could make.
    more : tuple of (sequence of str, sequence of str)
        Declarations and equations of one's own, lines of Modelica.
    """

    def __init__(self, library, rig, attached=(), probes=False, more=((), ())):
        self.library, self.rig, self.probes = library, rig, probes
        library.find(rig)
        effects = catalogue(library)
        self.attached = []
        for effect, place in attached:
            if effect not in effects:
                raise UnknownNameError(f"no effect '{effect}'{closest(effect, effects)}")
            self.attached.append((effects[effect], find_place(library, rig, effects[effect], place)))
        self.notes = annotation(library, rig)
        self._questions, self._carriers = {}, {}
        self.hung = tuple(self._probed()) if probes else ()
        self._more = more
        self.text = extend(rig, self.attached, given=components_of(library, rig), probes=self.hung, more=more)

    def _probed(self):
        """A probe at every port."""
        for connector, port in ports(self.library).items():
            for component in self.components(connector):
                ends = (connector, f"{component}.{connector}"),
                yield Hung(port.probe, self.probe(component, connector), "", ends)

    @property
    def keys(self):
        """Effect and place names of what is attached, as `compile_model` takes them."""
        return [(effect.id, place.name) for effect, place in self.attached]

    @cached_property
    def flat(self):
        """The flattened model."""
        flat = None if any(self._more) else attach(self.library, self.rig, self.attached, self.hung)
        flat = flat or self.library.flatten("Improved", self.text)
        if self.linear:
            for kind in (flat.variables, flat.parameters):
                kind.update({n: replace(v, unit=along_axis(v.unit)) for n, v in kind.items()})
            for effect, place in self.attached:
                waves = {f"{name}.{c}": unit for name in component_names(effect, place)
                         for c, unit in wave_units(effect).items()}
                flat.parameters.update({n: replace(flat.parameters[n], unit=unit) for n, unit in waves.items()
                                        if n in flat.parameters})
        return flat

    @property
    def linear(self):
        """Whether the drive train moves along an axis: angles are positions, torques forces, inertias masses."""
        return self.notes.get("axis") == "linear"

    def along(self, turning):
        """Unit that a rotational one stands for in this drive train.

        Parameters
        ----------
        turning : str
            As ``N.m`` or ``rad/s``.

        Returns
        -------
        str
            The same, or on a linear axis ``N`` and ``m/s``.
        """
        return along_axis(turning) if self.linear else turning

    @cached_property
    def key(self):
        """Hash of everything the compiled functions depend on."""
        return cache.digest(self.library.digest, self.text)

    @cached_property
    def parameters(self):
        """Parameters by name, with defaults, units and bounds."""
        return self._declared["parameters"]

    @cached_property
    def variables(self):
        """Variables by name, with units and bounds; parameters are not among them."""
        return self._declared["variables"]

    @cached_property
    def _declared(self):
        """What the flattened model declares, kept on disk: most questions are answered without flattening."""
        def make():
            return json.dumps({kind: {n: asdict(v) for n, v in getattr(self.flat, kind).items()}
                               for kind in ("parameters", "variables")})
        text = cache.remember("declared", self.key, make, str.encode, bytes.decode)
        return {kind: {n: Variable(**v) for n, v in known.items()} for kind, known in json.loads(text).items()}

    @cached_property
    def segments(self):
        """Components that carry the friction law: component name to place name."""
        names = {c: p for p, c in (pair.split("=") for pair in self.notes.get("places", "").split())}
        return {c: names.get(c, c) for c in self.components("friction")}

    def unit(self, channel):
        """Unit of a channel.

        Parameters
        ----------
        channel : str
            A variable, or with ``_pair`` half its difference between a pass and its way back.

        Returns
        -------
        str
            ``1`` for a number without unit.
        """
        name = channel.removesuffix("_pair")
        return self.variables[name].unit if name in self.variables else "1"

    def components(self, connector):
        """Components of the rig that carry a connector of this name.

        Parameters
        ----------
        connector : str
            Name, not class.

        Returns
        -------
        list of str
        """
        if connector not in self._carriers:  # asked for a thousand times in a search
            self._carriers[connector] = [
                component for component, (kind, _) in components_of(self.library, self.rig).items()
                if kind not in ("Real", "Integer", "Boolean") and not is_connector(self.library, kind)
                and not is_effect(self.library, kind) and connector in components_of(self.library, kind)]
        return list(self._carriers[connector])

    def probe(self, component, connector):
        """Name of the probe at a port; the first port of a component gives the plain name.

        Parameters
        ----------
        component, connector : str
            Of the rig, as ``s1A`` and ``friction``.

        Returns
        -------
        str
        """
        first = next(port for port in ports(self.library) if component in self.components(port))
        base = f"probe_{component.replace('.', '_')}"
        return base if connector == first else f"{base}_{connector}"

    @property
    def log_inputs(self):
        """Inputs of the attached effects that come from the log, such as a temperature."""
        return list(dict.fromkeys(n for effect, _ in self.attached for n in effect.measured))

    def aliases(self, key):
        """Entries of the rig's annotation ``load``, ``sensor`` or ``encoders``: a measured channel, and its output.

        Parameters
        ----------
        key : str
            ``load``, ``sensor`` or ``encoders``.

        Returns
        -------
        dict of str to str
            Empty without the entry. An encoder's output is followed by a colon and the parameter that is its zero.
        """
        return dict(pair.split("=") for pair in self.notes.get(key, "").split())

    def alternatives(self, name):
        """Forms of a question that the rig's annotation offers, as (outputs, inputs).

        Parameters
        ----------
        name : str
            Key of the annotation, as ``estimate``.

        Returns
        -------
        list of (list of str, list of str)
            The inputs include those that attached effects take from the log.

        Raises
        ------
        StudyError
            The annotation has no such key.
        """
        text = self.notes.get(name, "")
        forms = []
        for form in filter(None, (f.strip() for f in text.split(";"))):
            wanted, _, known = form.partition(" from ")
            forms.append((wanted.split(), list(dict.fromkeys([*known.split(), *self.log_inputs]))))
        if not forms:
            raise StudyError(f"{self.rig} does not say how to {name}; "
                             f"add {name}=\"outputs from inputs\" to its annotation")
        return forms

    def question(self, name, form=0, aliases=()):
        """Compile a question, or take it from the cache.

        Parameters
        ----------
        name : str
            ``estimate``, ``compensate``, ``gravity_model``: a key of the rig's annotation.
        form : int
            Which of the alternatives.
        aliases : tuple of (str, str)
            Pairs of outputs that swap their names.

        Returns
        -------
        Question
        """
        key = name, form, aliases
        if key not in self._questions:
            found = self.question(name, form) if aliases else self._question(name, form)
            self._questions[key] = found.swapped(dict(aliases))
        return self._questions[key]

    def _question(self, name, form):
        wanted, known = self.alternatives(name)[form]
        return self.ask(wanted, known, name)

    def ask(self, wanted, known, name=""):
        """Compile a question of one's own, or take it from the disk.

        Parameters
        ----------
        wanted, known : list of str
            Variables.
        name : str
            Of the question.

        Returns
        -------
        Question

        Raises
        ------
        ModelicaError
            No such variable, or no answer in closed form.
        """
        key = cache.digest(self.key, name, " ".join([*wanted, "from", *known]))
        return cache.remember("question", key, lambda: self._compile(wanted, known), _dump, _load)

    def extended(self, declared, equations):
        """The same rig with more in it.

        Parameters
        ----------
        declared, equations : list of str
            Lines of Modelica.

        Returns
        -------
        Model
        """
        return Model(self.library, self.rig, self.keys, more=(tuple(declared), tuple(equations)))

    def _compile(self, wanted, known):
        for n in [*wanted, *known]:
            if n not in self.flat.variables:
                raise ModelicaError(f"{self.rig} has no variable '{n}'{closest(n, self.flat.variables)}")
        flat = self.flat
        solution = solve(flat, known)
        values = {**{n: flat.symbols[n] for n in known}, **solution.values}
        extra = [f"{c}.{v}" for c in self.segments for v in ("w", "L", "s", "F", "loss")]
        extra += [f"{c}.{port}.{v}" for port, kind in ports(self.library).items() for c in self.components(port)
                  for v in kind.potentials]
        top = [n for n in flat.variables if "." not in n]
        members = ("phi", "w", "a", "tau", "tau_shaft", "v", "i")
        inner = [n for n in flat.variables if n.count(".") == 1 and n.endswith(tuple(f".{m}" for m in members))]
        named = [n.partition(":")[0] for key in ("load", "sensor", "encoders") for n in self.aliases(key).values()]
        every = dict.fromkeys([*wanted, *extra, *top, *inner, *named])
        outputs = [n for n in every if n in values and n not in known]
        late, held = self._late(wanted, known, values), self._held(values)
        outputs += [n for signal, behind in late.items() for n in (behind, f"lag({signal})")] + list(held.values())
        values = {**values, **self._shifted(late, values, outputs, solution.symbols)}
        y = ca.vertcat(*[values[n] for n in outputs])
        states = [s for s in solution.states if s in {v.name() for v in ca.symvar(y)}]
        rates = ca.vertcat(*[values[flat.derivatives[s]] for s in states]) if states else ca.SX(0, 1)
        used = [s.name() for s in ca.symvar(ca.vertcat(y, rates))]
        parameters = [n for n in flat.parameters if n in used]
        inputs = [n for n in used if n not in flat.parameters and n not in states]
        inputs = sorted(inputs, key=lambda n: (n.count("("), n))
        arguments = [ca.vertcat(*[solution.symbols[n] for n in names]) if names else ca.SX(0, 1)
                     for names in (inputs, states, parameters)]
        described = {n: flat.variables.get(n) or flat.parameters.get(n) or Variable(n)
                     for n in [*outputs, *states, *parameters]}
        described.update({n: flat.variables.get(n) or Variable(n) for n in inputs})
        names = ["u", "x", "p"]
        return Question(inputs, states, parameters, outputs, ca.Function("output", arguments, [y], names, ["y"]),
                        ca.Function("rate", arguments, [rates], names, ["xdot"]), described, late, held)

    def _late(self, wanted, known, values):
        """Known signals that an attached effect holds back, each with the output that says by how much.

        Where the record is the answer, what is known comes as much earlier instead.
        """
        late = {}
        for effect, place in self.attached:
            earlier = set()  # of two records that are answers, one moves the motion for both
            for name, c in zip(component_names(effect, place), place.components) if effect.channel else ():
                delay, lag = values[f"{name}.delay"], values[f"{name}.lag"]
                if f"{c}.{RECORDED}" in known:
                    self._hold(late, values, f"{c}.{RECORDED}", delay + lag, lag)
                    continue
                read = {s.name() for s in ca.symvar(ca.vertcat(*[values[n] for n in wanted]))}
                motion = {n for n in read if n.replace("der(", "").rstrip(")") in known} - earlier
                for n in sorted(motion, key=lambda n: (n.count("("), n)):
                    self._hold(late, values, n, -delay - lag, 0.0)
                earlier |= motion
        return late

    def _held(self, values):
        """Components whose reference an attached effect holds back, each with the output that says by how much."""
        held = {}
        for effect, place in self.attached:
            for name, c in zip(component_names(effect, place), place.components):
                lag = values.get(f"{name}.lag")
                if not effect.channel and lag is not None and not lag.is_zero():
                    held[c] = f"held({c})"
                    values[held[c]] = values.get(held[c], ca.SX(0)) + lag
        return held

    @staticmethod
    def _hold(late, values, signal, behind, lag):
        """Hold a signal back by so much more, of which some by a lag."""
        late[signal] = f"behind({signal})"
        for name, more in ((late[signal], behind), (f"lag({signal})", lag)):
            values[name] = values.get(name, ca.SX(0)) + more

    @staticmethod
    def _shifted(late, values, names, symbols):
        """Variables in terms of signals as they were recorded: x becomes x + (delay - at(x)) der(x), so with a lag."""
        if not late:
            return {}
        recorded = []
        for signal, behind in late.items():
            lag, value = values[f"lag({signal})"], symbols[signal]
            for time, at, slope in ((values[behind] - lag, f"at({signal})", der(signal)),
                                    (lag, *(n.format(signal) for n in FILTERED))):
                if not time.is_zero():
                    at, slope = (symbols.setdefault(n, ca.SX.sym(n)) for n in (at, slope))
                    value += (time - at) * slope
            recorded.append(value)
        shifted = ca.substitute([values[n] for n in names], [symbols[s] for s in late], recorded)
        return dict(zip(names, shifted))

    def effect_parameters(self, effect, place):
        """Names of the coefficients of an attached effect.

        Parameters
        ----------
        effect : Effect
            Whose ``size`` and ``scan`` are named.
        place : Place
            Joined places share one set of names.

        Returns
        -------
        list of str
        """
        base = component_name(effect, place)
        return [f"{base}.{c}" for c in dict.fromkeys((*effect.size, *effect.scan))]


def compile_model(library, rig, attached=(), probes=False):
    """Return the model of a rig with effects; models are made once a library.

    Parameters
    ----------
    library : Library
        Which keeps what was made of it.
    rig : str
        Modelica class.
    attached : sequence of (str, str)
        Effect and place names, as ``("viscous", "1A")``.
    probes : bool
        As of `Model`.

    Returns
    -------
    Model

    Raises
    ------
    UnknownNameError, ModelicaError
        No such rig, effect or place, or its equations cannot be compiled.
    """
    key = ("model", rig, tuple(map(tuple, attached)), probes)
    return library.memo(key, lambda: Model(library, rig, attached, probes))


def _dump(question):
    return json.dumps({
        "inputs": question.inputs, "states": question.states, "parameters": question.parameters,
        "outputs": question.outputs, "output": question.output.serialize(), "rate": question.rate.serialize(),
        "variables": {n: asdict(v) for n, v in question.variables.items()}, "late": question.late,
        "held": question.held}).encode()


def _load(data):
    found = json.loads(data)
    found["output"] = ca.Function.deserialize(found["output"])
    found["rate"] = ca.Function.deserialize(found["rate"])
    found["variables"] = {n: Variable(**v) for n, v in found["variables"].items()}
    return Question(**found)

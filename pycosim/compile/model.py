"""One model, and the questions it answers: which variables are known decides which."""

from __future__ import annotations


import json
from dataclasses import asdict, dataclass, field
from functools import cached_property

import casadi as ca

from .. import cache
from ..errors import ModelicaError, StudyError, UnknownNameError, closest
from ..variables import Variable
from .effects import annotation, catalogue, component_name, extend, find_place
from .solve import solve

PROBES = {"friction": "DriveTrain.Interfaces.SegmentProbe", "signal": "DriveTrain.Interfaces.MotorProbe"}


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
    outputs : list of str
    output : casadi.Function
        ``(inputs, states, parameters) -> outputs``.
    rate : casadi.Function
        ``(inputs, states, parameters) -> derivative of the states``.
    variables : dict of str to Variable
        Unit and description of every name.
    """

    inputs: list
    states: list
    parameters: list
    outputs: list
    output: ca.Function
    rate: ca.Function
    variables: dict = field(default_factory=dict)

    def symbols(self):
        """Fresh symbols for inputs, states and parameters."""
        return (ca.SX.sym("u", len(self.inputs)), ca.SX.sym("x", len(self.states)),
                ca.SX.sym("p", len(self.parameters)))

    def select(self, outputs):
        """The same question with fewer outputs."""
        u, x, p = self.symbols()
        y = self.output(u, x, p)
        rows = [y[self.outputs.index(o)] for o in outputs]
        names = ["u", "x", "p"], ["y"]
        return Question(self.inputs, self.states, self.parameters, list(outputs),
                        ca.Function("output", [u, x, p], [ca.vertcat(*rows)], *names), self.rate, self.variables)

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


class Model:
    """A rig with effects attached.

    Parameters
    ----------
    library : Library
    rig : str
        Modelica class.
    attached : sequence of (str, str)
        Effect and place names.
    probes : bool
        Hang a probe on every segment and motor, whose parameters are the additions an effect could make.
    """

    def __init__(self, library, rig, attached=(), probes=False):
        self.library, self.rig, self.probes = library, rig, probes
        library.find(rig)
        effects = catalogue(library)
        self.attached = []
        for effect, place in attached:
            if effect not in effects:
                raise UnknownNameError(f"no effect '{effect}'{closest(effect, effects)}")
            self.attached.append((effects[effect], find_place(library, rig, effects[effect], place)))
        self.notes = annotation(library, rig)
        self._questions = {}
        self.text = extend(rig, self.attached)
        if probes:
            self.text = _with_probes(self)

    @cached_property
    def flat(self):
        """The flattened model."""
        return self.library.flatten("Improved", self.text)

    @cached_property
    def key(self):
        """Hash of everything the compiled functions depend on."""
        return cache.digest(self.library.digest, self.text)

    @cached_property
    def parameters(self):
        """Parameters by name, with defaults, units and bounds."""
        text = cache.remember(
            "parameters", self.key,
            lambda: json.dumps({n: asdict(v) for n, v in self.flat.parameters.items()}), str.encode, bytes.decode)
        return {n: Variable(**v) for n, v in json.loads(text).items()}

    @cached_property
    def segments(self):
        """Components that carry the friction law: component name to place name."""
        names = {c: p for p, c in (pair.split("=") for pair in self.notes.get("places", "").split())}
        return {c: names.get(c, c) for c in self.components("friction")}

    def components(self, connector):
        """Components of the rig that carry a connector of this name."""
        from .effects import _members, is_connector, is_effect
        found = []
        for component, (kind, _) in _members(self.library, self.rig).items():
            if (kind not in ("Real", "Integer", "Boolean") and not is_connector(self.library, kind)
                    and not is_effect(self.library, kind)):
                if connector in _members(self.library, kind):
                    found.append(component)
        return found

    def alternatives(self, name):
        """Forms of a question that the rig's annotation offers, as (outputs, inputs)."""
        text = self.notes.get(name, "")
        forms = []
        for form in filter(None, (f.strip() for f in text.split(";"))):
            wanted, _, known = form.partition(" from ")
            forms.append((wanted.split(), known.split()))
        if not forms:
            raise StudyError(f"{self.rig} does not say how to {name}; add {name}=\"outputs from inputs\" to its annotation")
        return forms

    def question(self, name, form=0):
        """Compile a question, or take it from the cache.

        Parameters
        ----------
        name : str
            ``estimate``, ``compensate``, ``gravity_model``: a key of the rig's annotation.
        form : int
            Which of the alternatives.

        Returns
        -------
        Question
        """
        if (name, form) not in self._questions:
            self._questions[name, form] = self._question(name, form)
        return self._questions[name, form]

    def _question(self, name, form):
        wanted, known = self.alternatives(name)[form]
        key = cache.digest(self.key, name, " ".join([*wanted, "from", *known]))
        return cache.remember("question", key, lambda: self._compile(wanted, known), _dump, _load)

    def _compile(self, wanted, known):
        for n in [*wanted, *known]:
            if n not in self.flat.variables:
                raise ModelicaError(f"{self.rig} has no variable '{n}'{closest(n, self.flat.variables)}")
        flat = self.flat
        solution = solve(flat, known)
        values = {**{n: flat.symbols[n] for n in known}, **solution.values}
        extra = [f"{c}.{v}" for c in self.segments for v in ("w", "L", "s", "F", "loss")]
        top = [n for n in flat.variables if "." not in n]
        members = ("phi", "w", "a", "tau", "tau_shaft", "v", "i")
        aliases = [n for n in flat.variables if n.count(".") == 1 and n.endswith(tuple(f".{m}" for m in members))]
        outputs = list(dict.fromkeys([n for n in [*wanted, *extra, *top, *aliases] if n in values and n not in known]))
        y = ca.vertcat(*[values[n] for n in outputs])
        states = [s for s in solution.states if s in {v.name() for v in ca.symvar(y)}]
        rates = ca.vertcat(*[values[flat.derivatives[s]] for s in states]) if states else ca.SX(0, 1)
        used = [s.name() for s in ca.symvar(ca.vertcat(y, rates))]
        parameters = [n for n in flat.parameters if n in used]
        inputs = [n for n in used if n not in flat.parameters and n not in states]
        inputs = sorted(inputs, key=lambda n: (n.count("("), n))
        arguments = [ca.vertcat(*[solution.symbols[n] for n in names]) if names else ca.SX(0, 1)
                     for names in (inputs, states, parameters)]
        described = {n: flat.variables.get(n) or flat.parameters.get(n) for n in [*outputs, *states, *parameters]}
        described.update({n: flat.variables.get(n) or Variable(n) for n in inputs})
        names = ["u", "x", "p"]
        return Question(inputs, states, parameters, outputs, ca.Function("output", arguments, [y], names, ["y"]),
                        ca.Function("rate", arguments, [rates], names, ["xdot"]), described)

    def effect_parameters(self, effect, place):
        """Names of the coefficients of an attached effect."""
        base = component_name(effect, place)
        return [f"{base}.{c}" for c in dict.fromkeys((*effect.size, *effect.scan))]


def _with_probes(model):
    """The model's text with a probe at every port."""
    declared, connected = [], []
    for connector, probe in PROBES.items():
        for component in model.components(connector):
            name = f"probe_{component.replace('.', '_')}"
            declared.append(f"  {probe} {name};")
            connected.append(f"  connect({name}.{connector}, {component}.{connector});")
    head, _, tail = model.text.partition("equation\n")
    if not tail:
        head, tail = model.text.split("end Improved;")[0], "end Improved;\n"
    return "\n".join([head.rstrip(), *declared, "equation", *connected, tail])


def compile_model(library, rig, attached=(), probes=False):
    """Return the model of a rig with effects; models are made once a library.

    Parameters
    ----------
    library : Library
    rig : str
    attached : sequence of (str, str)
    probes : bool

    Returns
    -------
    Model

    Raises
    ------
    UnknownNameError, ModelicaError
    """
    key = ("model", rig, tuple(map(tuple, attached)), probes)
    return library.memo(key, lambda: Model(library, rig, attached, probes))


def _dump(question):
    return json.dumps({
        "inputs": question.inputs, "states": question.states, "parameters": question.parameters,
        "outputs": question.outputs, "output": question.output.serialize(), "rate": question.rate.serialize(),
        "variables": {n: asdict(v) for n, v in question.variables.items()}}).encode()


def _load(data):
    found = json.loads(data)
    found["output"] = ca.Function.deserialize(found["output"])
    found["rate"] = ca.Function.deserialize(found["rate"])
    found["variables"] = {n: Variable(**v) for n, v in found["variables"].items()}
    return Question(**found)

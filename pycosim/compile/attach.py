"""A rig and what hangs on it, in; the whole as Modelica text, and flat, out.

pymoca needs most of a second to flatten a rig of three hundred equations, and a search asks for fifty models of one rig
that differ by a few effects. So rig and effects are flattened once each, and put together as the text says: the whole
has the equations of its parts, and those of their connections.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import casadi as ca

from ..core.units import Variable
from .effects import PARTNER, component_names, components_of, potentials
from .parse import Flat
from .wiring import connections_of, nets


@dataclass(frozen=True)
class Hung:
    """A component that hangs on a rig: an effect, or a probe.

    Attributes
    ----------
    model, name : str
        Modelica class and name of the component.
    description : str
        What the declaration says of it; may be empty.
    ends : tuple of (str, str)
        Connectors, each with the port of the rig that it is connected with, as ``friction`` and ``s1A.friction``.
    inputs : tuple of str
        Those of its variables that are the rig's of the same name.
    same : dict of str to str
        Parameters that are another component's, and the names of these.
    """

    model: str
    name: str
    description: str
    ends: tuple
    inputs: tuple = ()
    same: dict = field(default_factory=dict)


def hung(effect, place):
    """What an effect at a place consists of.

    Parameters
    ----------
    effect : Effect
        Its connectors have the names of the ports that they are connected with, but for the partner of a pair.
    place : Place
        The effect hangs at each of its components; the first has the coefficients, the others take them from it.

    Returns
    -------
    list of Hung
    """
    names, coefficients, found = component_names(effect, place), (*effect.size, *effect.scan, *effect.means), []
    for name, component in zip(names, place.components):
        ends = [(c, f"{component}.{c}") for c in effect.ports]
        ends += [(PARTNER, f"{place.partner(effect, component)}.{c}") for c, kind in effect.ports.items()
                 if kind == effect.connectors.get(PARTNER)]
        same = {} if name == names[0] else {c: f"{names[0]}.{c}" for c in coefficients}
        said = f"{effect.description} at {place.name}"
        found.append(Hung(effect.model, name, said, tuple(ends), effect.inputs, same))
    return found


def extend(rig, attached, name="Improved", given=(), probes=(), more=((), ())):
    """Modelica text of a rig with effects.

    Parameters
    ----------
    rig : str
        Modelica class.
    attached : list of (Effect, Place)
        In the order in which they are declared.
    name : str
        Name of the new class.
    given : collection of str
        Measured inputs that the rig has itself; the others are declared.
    probes : sequence of Hung
        What hangs there besides.
    more : tuple of (sequence of str, sequence of str)
        Further declarations and equations, lines of Modelica.

    Returns
    -------
    str
    """
    declared = [f'  input Real {n}(unit="{unit}") "Measured";' for n, unit in _measured(attached, given).items()]
    connected = []
    for h in [*(h for pair in attached for h in hung(*pair)), *probes]:
        same = ", ".join(f"{c} = {other}" for c, other in h.same.items())
        said = f' "{h.description}"' if h.description else ""
        declared.append(f"  {h.model} {h.name}{f'({same})' if same else ''}{said};")
        connected += [f"  connect({h.name}.{c}, {port});" for c, port in h.ends]
        connected += [f"  {h.name}.{i} = {i};" for i in h.inputs]  # as a modifier, pymoca would find the inner name
    declared, connected = [*declared, *more[0]], [*connected, *more[1]]
    lines = [f'model {name} "{rig} with the effects that the measurements asked for"', f"  extends {rig};", *declared]
    if connected:
        lines += ["equation", *connected]
    return "\n".join([*lines, f"end {name};", ""])


def _measured(attached, given):
    """Inputs from the log that the rig does not have, with their units."""
    return {n: unit for effect, _ in attached for n, unit in effect.measured.items() if n not in given}


def attach(library, rig, attached, probes=()):
    """The flat model of what `extend` writes.

    Parameters
    ----------
    library : Library
        Which keeps the flat rig and the flat effects.
    rig, attached, probes
        As of `extend`.

    Returns
    -------
    Flat or None
        None where a flow of a port that is asked for has no equation in the flat rig that adds up what is connected
        there.

    Raises
    ------
    ModelicaError
        The rig or an effect does not compile.
    """
    base = library.flattened(rig)
    whole = _Whole(base, library.memo(("nodes", rig), lambda: _nodes(base, nets(connections_of(library, rig)))))
    for n, unit in _measured(attached, base.variables).items():
        whole.measure(n, unit)
    for h in [*(h for pair in attached for h in hung(*pair)), *probes]:
        whole.put(library.flattened(h.model), h)
        for connector, port in h.ends:
            kind = components_of(library, h.model)[connector][0]
            for n in components_of(library, kind):
                ends = f"{h.name}.{connector}.{n}", f"{port}.{n}"
                if n in potentials(library, kind):
                    whole.equal(*ends)
                elif not whole.balance(*ends):
                    return None
    return whole.flat()


def _nodes(base, nets):
    """Flows of a flat rig to the place of the equation that adds up all that is connected there."""
    sums = {frozenset(v.name() for v in ca.symvar(e)): k for k, e in enumerate(base.equations) if _adds_up(e)}
    met = {".".join(end): [".".join(e) for e in net] for net in nets for end in net}
    found = {}
    for n in base.variables:
        port, _, flow = n.rpartition(".")
        found[n] = sums.get(frozenset(f"{end}.{flow}" for end in met.get(port, [port])))
    return found


def _adds_up(expression):
    """Whether it is the sum of its variables."""
    v = ca.vertcat(*ca.symvar(expression))
    slopes = ca.densify(ca.jacobian(expression, v))
    return slopes.is_constant() and (ca.DM(slopes) == 1).is_one() and ca.substitute(expression, v, 0 * v).is_zero()


class _Whole:
    """A flat rig while effects are hung on it; what it was made from is not changed."""

    def __init__(self, base, nodes):
        self.base, self.nodes = base, nodes
        self.symbols, self.bindings = dict(base.symbols), dict(base.bindings)
        self.variables, self.parameters = dict(base.variables), dict(base.parameters)
        self.inputs, self.derivatives, self.equations = list(base.inputs), dict(base.derivatives), list(base.equations)
        self.alone = {}  # flow of a component that is not connected yet, to the place of the equation that says zero

    def measure(self, name, unit):
        """Declare an input."""
        self.symbols[name], self.variables[name] = ca.SX.sym(name), Variable(name, unit, "Measured")
        self.inputs.append(name)

    def put(self, part, h):
        """Declare a component that hangs there, with its own equations."""
        rates = {rate: f"der({h.name}.{x})" for x, rate in part.derivatives.items()}
        within = {n: n if n == "time" else rates.get(n, f"{h.name}.{n}") for n in part.symbols}
        for n in within.values():
            self.symbols.setdefault(n, ca.SX.sym(n))
        outer = [self.symbols[h.same.get(n, within[n])] for n in part.symbols]
        found = ca.substitute([*part.equations, *part.bindings.values()], list(part.symbols.values()), outer)
        for e in found[:len(part.equations)]:
            if e.is_symbolic():
                self.alone.setdefault(e.name(), len(self.equations))
            self.equations.append(e)
        self.bindings.update(zip((within[n] for n in part.bindings), found[len(part.equations):]))
        self.bindings.update((within[n], self.symbols[other]) for n, other in h.same.items())
        self.equations += [self.symbols[within[i]] - self.symbols[i] for i in h.inputs]
        for mine, of in ((self.variables, part.variables), (self.parameters, part.parameters)):
            mine.update((within[n], replace(v, name=within[n])) for n, v in of.items() if n not in h.same)
        self.derivatives.update((within[x], within[rate]) for x, rate in part.derivatives.items())

    def equal(self, name, other):
        """Two variables are the same."""
        self.equations.append(self.symbols[name] - self.symbols[other])

    def balance(self, flow, met):
        """A flow is added to the sum at the node that it meets; whether there is one."""
        node, alone = self.nodes[met], self.alone.pop(flow, None)
        if node is None or alone is None:
            return False
        self.equations[node] += self.symbols[flow]
        self.equations[alone] = None
        return True

    def flat(self):
        """What has become of it."""
        return Flat(self.base.name, self.symbols, self.variables, self.parameters, self.inputs, self.derivatives,
                    [e for e in self.equations if e is not None], self.bindings)

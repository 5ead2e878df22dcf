"""A rig in; its components, what they are, and what is connected with what, as data for a drawing, out."""

from __future__ import annotations

from dataclasses import dataclass

import pymoca.ast

from .effects import annotation, components_of, is_connector, is_effect

BUILTIN = "Real", "Integer", "Boolean", "String"
FLANGES = "Flange", "TranslationalFlange"  # connectors that carry a torque or a force
# what a component is, from a connector that only such a component has
BY_PORT = {"signal": "motor", "friction": "segment", "line": "line"}
# what it is, from the class that it is or extends
BY_CLASS = {"IdealGear": "gear", "Fixed": "frame", "Spring": "spring", "Torque": "outside", "Screw": "screw",
            "RelativeJoint": "difference", "Sensor": "sensor", "Joint": "joint", "Inertia": "inertia"}


@dataclass(frozen=True)
class Part:
    """A component of a rig.

    Attributes
    ----------
    name : str
        Of the Modelica component.
    kind : str
        ``motor``, ``segment``, ``line``, ``gear``, ``joint``, ``difference``, ``link``, ``inertia``, ``screw``,
        ``spring``, ``sensor``, ``frame``, ``outside`` (a torque from outside), ``effect`` (part of the base model),
        ``beside`` (no flange: where something hangs, or a link as a computed reference knows it) or ``part``.
    description : str
        What Modelica says of the component; empty where it says nothing.
    flanges : tuple of str
        Its connectors that carry a torque or a force.
    """

    name: str
    kind: str
    description: str
    flanges: tuple


@dataclass(frozen=True)
class Wiring:
    """What a rig is made of.

    Attributes
    ----------
    parts : dict of str to Part
        By component, in the order of their declaration.
    nets : tuple of tuple of (str, str)
        Flanges that are connected with each other, as component and connector.
    beside : tuple of ((str, str), (str, str))
        Connections of other connectors, such as an effect's.
    signals : dict of str to str
        Variables of the rig that are a variable of one component: that component.
    """

    parts: dict
    nets: tuple
    beside: tuple
    signals: dict


def wiring(library, rig):
    """Components and connections of a rig, as its Modelica classes declare them.

    Parameters
    ----------
    library : Library
        Which holds the rig and the classes of its components.
    rig : str
        Modelica class.

    Returns
    -------
    Wiring

    Raises
    ------
    UnknownNameError
        No such class.
    """
    return library.memo(("wiring", rig), lambda: _wiring(library, rig))


def _wiring(library, rig):
    texts = {s.name: str(s.comment or "") for _, node in library.bases(rig) for s in node.symbols.values()}
    parts = {}
    for name, (kind, _) in components_of(library, rig).items():
        if kind not in BUILTIN and not is_connector(library, kind):
            parts[name] = _part(library, name, kind, texts.get(name, ""))
    pairs, signals = connections_of(library, rig), {}
    for _, node in reversed(list(library.bases(rig))):
        for equation in node.equations:
            if isinstance(equation, pymoca.ast.Equation):
                signals.update(_signal(equation, parts))
    mechanical = [p for p in pairs if all(port in parts[c].flanges for c, port in p if c in parts)]
    within = [p for p in mechanical if all(c in parts for c, _ in p)]
    return Wiring(parts, nets(within), tuple(p for p in pairs if p not in mechanical), signals)


def connections_of(library, rig):
    """Pairs of connectors that a rig's classes connect.

    Parameters
    ----------
    library : Library
        Which holds the rig.
    rig : str
        Modelica class.

    Returns
    -------
    list of ((str, str), (str, str))
        Component and connector, of either end.
    """
    return [tuple(tuple(str(r).partition(".")[::2]) for r in (equation.left, equation.right))
            for _, node in reversed(list(library.bases(rig))) for equation in node.equations
            if isinstance(equation, pymoca.ast.ConnectClause)]


def nets(pairs):
    """Connectors that are connected, put together where pairs share one.

    Parameters
    ----------
    pairs : iterable of (object, object)
        Ends of connections.

    Returns
    -------
    tuple of tuple
        Each with all that is connected with each other.
    """
    joined = []
    for a, b in pairs:
        met = [n for n in joined if a in n or b in n]
        joined = [n for n in joined if n not in met] + [list(dict.fromkeys([*sum(met, []), a, b]))]
    return tuple(tuple(n) for n in joined)


def _part(library, name, model, description):
    members = components_of(library, model)
    flanges = tuple(n for n, (kind, _) in members.items() if kind.rpartition(".")[2] in FLANGES)
    return Part(name, _kind(library, model, members, flanges), description, flanges)


def _kind(library, model, members, flanges):
    if is_effect(library, model):
        return "effect"
    if not flanges:
        return "beside"
    ancestors = [base.rpartition(".")[2] for base, _ in library.bases(model)]
    found = [BY_PORT[p] for p in BY_PORT if p in members] + [BY_CLASS[a] for a in ancestors if a in BY_CLASS]
    return found[0] if found else "link" if annotation(library, model).get("links") else "part"


def _signal(equation, parts):
    """A variable of the rig, and the component that an equation gives it from."""
    sides = [str(s) if isinstance(s, pymoca.ast.ComponentRef) else "" for s in (equation.left, equation.right)]
    for name, other in (sides, sides[::-1]):
        if name and "." not in name and other.partition(".")[0] in parts:
            return {name: other.partition(".")[0]}
    return {}

"""A compiled rig in, what turns with its flanges out: links with their mass, rotors with their inertia."""

from __future__ import annotations

import ast
import math
import operator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..compile.effects import annotation, component_names, components_of
from ..core.errors import ModelicaError

_KEYS = {"mass", "moment", "inertia", "length"}


@dataclass(frozen=True)
class Link:
    """What turns with a flange.

    Attributes
    ----------
    component, flange : str
        Whose angle is its own.
    parent : str
        Flange of the same component whose link carries its axle; empty when the axle is fixed.
    values : dict of str to float
        ``mass`` [kg], ``moment`` [kg.m] (mass times distance of its centre), ``inertia`` [kg.m2] about the axle,
        ``length`` [m] to the next axle; without a mass, the inertia of a rotor.
    formulas : dict of str to str
        The same over the component's own parameters.
    """

    component: str
    flange: str
    parent: str
    values: dict
    formulas: dict

    @property
    def angle(self):
        """Name of the angle."""
        return f"{self.component}.{self.flange}.phi"


class Links:
    """What the library says of a rig's links.

    Parameters
    ----------
    model : Model
        A rig whose components say in ``__pycosim(links=...)`` what turns.
    parameters : dict of str to float
        Every parameter of the rig.
    """

    def __init__(self, model, parameters):
        self.model, self.parameters = model, parameters

    def all(self):
        """Links and rotors.

        Returns
        -------
        list of Link
        """
        return [_read(c, text, self.values(c)) for c, notes in self.notes("links").items() for text in notes.split(";")]

    def notes(self, key):
        """An entry of the annotation of each component, those of effects included.

        Parameters
        ----------
        key : str
            Of the annotation ``__pycosim``, as ``links``.

        Returns
        -------
        dict of str to str
            By component; only those that have it.
        """
        library, model = self.model.library, self.model
        kinds = {c: kind for c, (kind, _) in components_of(library, model.rig).items() if "." in kind}
        kinds.update({c: e.model for e, p in model.attached for c in component_names(e, p)})
        found = {c: annotation(library, kind) for c, kind in kinds.items()}
        return {c: notes[key] for c, notes in found.items() if key in notes}

    def values(self, component):
        """Parameters of a component by their own names.

        Parameters
        ----------
        component : str
            Of the rig, as ``leg``; the result's names lack it.

        Returns
        -------
        dict of str to float
        """
        known, flat = self.parameters, self.model.flat
        if flat.bindings:
            names = list(flat.parameters)
            symbols = ca.vertcat(*[flat.symbols[n] for n in names])
            bound = ca.Function("bound", [symbols], [ca.vertcat(*flat.bindings.values())])
            known = {**known, **dict(zip(flat.bindings, np.ravel(bound([known[n] for n in names]))))}
        return {n.removeprefix(f"{component}."): float(v) for n, v in known.items() if n.startswith(f"{component}.")}


def evaluate(formula, values):
    """A formula of an annotation, as ``m*l+arm``.

    Parameters
    ----------
    formula : str
        Numbers, names, ``+ - * / **`` and brackets.
    values : dict of str to float
        Of what it names.

    Returns
    -------
    float

    Raises
    ------
    ModelicaError
        It is no arithmetic of numbers and these names: a Modelica file of someone else's must not do more than that.
    """
    try:
        return float(_arithmetic(ast.parse(formula.strip(), mode="eval").body, values))
    except (SyntaxError, ValueError, TypeError, KeyError, ZeroDivisionError, OverflowError, RecursionError):
        raise ModelicaError(f"the formula '{formula}' of an annotation is no sum, product, quotient or power of "
                            f"numbers and {', '.join(values)}") from None


_OPERATIONS = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
               ast.Pow: math.pow, ast.USub: operator.neg, ast.UAdd: operator.pos}


def _arithmetic(node, values):
    if isinstance(node, ast.BinOp):
        return _OPERATIONS[type(node.op)](_arithmetic(node.left, values), _arithmetic(node.right, values))
    if isinstance(node, ast.UnaryOp):
        return _OPERATIONS[type(node.op)](_arithmetic(node.operand, values))
    if isinstance(node, ast.Name):
        return values[node.id]
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return float(node.value)
    raise ValueError(node)


def _read(component, text, values):
    """A link from ``knee on hip: mass=m2, inertia=I2``."""
    head, _, tail = text.partition(":")
    flange, _, parent = head.strip().partition(" on ")
    pairs = dict(part.strip().split("=", 1) for part in tail.split(","))
    assert set(pairs) <= _KEYS, f"{component}: {pairs}"
    return Link(component, flange.strip(), parent.strip(), {k: evaluate(v, values) for k, v in pairs.items()}, pairs)

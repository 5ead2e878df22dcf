"""A pymoca tree in, JSON out, and back: data that is read from a file without running anything that stands in it."""

from __future__ import annotations

import json
from collections import OrderedDict

import pymoca.ast

FORMAT = 1
_PLAIN = (type(None), bool, int, float, str)
_NODES = {n: c for n, c in vars(pymoca.ast).items() if isinstance(c, type) and issubclass(c, pymoca.ast.Node)}
_MEMBERS = {m.name: m for m in pymoca.ast.Visibility}


def dump(tree):
    """A tree as bytes.

    Parameters
    ----------
    tree : pymoca.ast.Tree
        As parsed, before anything is flattened.

    Returns
    -------
    bytes
        JSON: a list of objects that name one another by their numbers, the tree first.

    Raises
    ------
    TypeError
        The tree holds something that is none of pymoca's nodes, lists, mappings and plain values.
    """
    numbers, objects, kept = {}, [], []  # kept: so that no number of Python's is given out twice

    def value(o):
        if isinstance(o, _PLAIN):
            return o
        if id(o) not in numbers:
            numbers[id(o)] = len(kept)
            kept.append(o)
        return [numbers[id(o)]]

    value(tree)
    for o in kept:  # grows on the way
        objects.append(_object(o, value))
    return json.dumps({"format": FORMAT, "objects": objects}).encode()


def _object(o, value):
    """One object: its kind, and what is in it."""
    kind = type(o)
    if kind is list:
        return ["list", [value(v) for v in o]]
    if kind in (dict, OrderedDict):
        return [kind.__name__, [[value(k), value(v)] for k, v in o.items()]]
    if kind is pymoca.ast.Visibility:
        return ["Visibility", o.name]
    if kind.__name__ in _NODES and _NODES[kind.__name__] is kind:
        return [kind.__name__, [[k, value(v)] for k, v in vars(o).items()]]
    raise TypeError(f"a {kind.__name__} in a Modelica tree")


def load(data):
    """The tree that `dump` wrote.

    Parameters
    ----------
    data : bytes
        JSON; nothing in it is run.

    Returns
    -------
    pymoca.ast.Tree

    Raises
    ------
    ValueError
        Not written by `dump`, or by another version of it.
    """
    try:
        found = json.loads(data)
        if found["format"] != FORMAT:
            raise ValueError(f"format {found['format']}")
        objects = found["objects"]
        made = [_empty(*entry) for entry in objects]
        for o, (kind, content) in zip(made, objects):
            _fill(o, kind, content, made)
        if type(made[0]) is not pymoca.ast.Tree:
            raise ValueError("no tree")
        return made[0]
    except (KeyError, TypeError, IndexError, AttributeError) as error:
        raise ValueError(f"no tree of Modelica classes: {error}") from None


def _empty(kind, content):
    if kind == "Visibility":
        return _MEMBERS[content]
    if kind in ("list", "dict", "OrderedDict"):
        return {"list": list, "dict": dict, "OrderedDict": OrderedDict}[kind]()
    return _NODES[kind].__new__(_NODES[kind])


def _fill(o, kind, content, made):
    def value(v):
        return made[v[0]] if isinstance(v, list) else v

    if kind == "list":
        o.extend(map(value, content))
    elif kind in ("dict", "OrderedDict"):
        o.update((value(k), value(v)) for k, v in content)
    elif kind != "Visibility":
        vars(o).update((k, value(v)) for k, v in content)

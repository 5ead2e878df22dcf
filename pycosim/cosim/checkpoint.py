"""Attributes of a Python controller in, JSON out, and back: data only, so that reading a checkpoint runs no code."""

from __future__ import annotations

import base64
import json
import math

import numpy as np

FORMAT = 1
_KINDS = "biufc"  # of arrays: Booleans, integers, floats, complex numbers


def dump(values):
    """Attributes as bytes.

    Parameters
    ----------
    values : dict of str to object
        Numbers, texts, NumPy arrays, lists, tuples, sets and dictionaries of them.

    Returns
    -------
    bytes

    Raises
    ------
    TypeError
        One of them is of another kind, or holds itself; it is named.
    """
    return json.dumps({"format": FORMAT, "values": {n: _encoded(v, n, ()) for n, v in values.items()}}).encode()


def _encoded(value, where, inside):
    if value is None or isinstance(value, (bool, str)):
        return value
    if type(value) is int:
        return ["int", str(value)]
    if type(value) is float:
        return ["float", value.hex() if math.isfinite(value) else str(value)]
    if isinstance(value, (np.ndarray, np.generic)) and value.dtype.kind in _KINDS:
        data = np.ascontiguousarray(value)
        kind = "array" if isinstance(value, np.ndarray) else "number"
        return [kind, value.dtype.str, list(value.shape), base64.b64encode(data.tobytes()).decode()]
    if id(value) in inside:
        raise TypeError(f"'{where}' holds itself")
    inside = (*inside, id(value))
    if type(value) in (list, tuple, set, frozenset):
        return [type(value).__name__, [_encoded(v, where, inside) for v in value]]
    if type(value) is dict:
        return ["dict", [[_encoded(k, where, inside), _encoded(v, where, inside)] for k, v in value.items()]]
    raise TypeError(f"'{where}' is a {type(value).__name__}")


def load(data):
    """The attributes that `dump` wrote.

    Parameters
    ----------
    data : bytes
        JSON, arrays in it as text; nothing in it is run.

    Returns
    -------
    dict of str to object

    Raises
    ------
    ValueError
        Not written by `dump`, or by another version of it.
    """
    try:
        found = json.loads(data)
        if found["format"] != FORMAT:
            raise ValueError(f"format {found['format']}")
        return {n: _decoded(v) for n, v in found["values"].items()}
    except (KeyError, TypeError, IndexError, AttributeError, RecursionError) as error:
        raise ValueError(f"not the attributes of a component ({error})") from None


_GROUPS = {"list": list, "tuple": tuple, "set": set, "frozenset": frozenset}


def _decoded(v):
    if not isinstance(v, list):
        return v
    kind, *rest = v
    if kind == "int":
        return int(rest[0])
    if kind == "float":
        return float.fromhex(rest[0])
    if kind in ("array", "number"):
        dtype = np.dtype(rest[0])
        if dtype.kind not in _KINDS:
            raise ValueError(f"an array of {dtype}")
        array = np.frombuffer(base64.b64decode(rest[2]), dtype).reshape(rest[1]).copy()
        return array if kind == "array" else array[()]
    if kind == "dict":
        return {_decoded(k): _decoded(value) for k, value in rest[0]}
    return _GROUPS[kind](map(_decoded, rest[0]))

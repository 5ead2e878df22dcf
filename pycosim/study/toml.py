"""A value in; the same as TOML text out."""

from __future__ import annotations

import json
import numbers
import re


def to_toml(value):
    """A value as TOML text, on one line but for long lists.

    Parameters
    ----------
    value : bool, str, dict, list, int or float
        A dict becomes an inline table.

    Returns
    -------
    str
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # JSON's escapes are TOML's but for DEL, which JSON leaves bare
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(k)} = {to_toml(v)}" for k, v in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        flat = "[" + ", ".join(map(to_toml, value)) + "]"
        return flat if len(flat) < 100 else "[\n    " + ",\n    ".join(map(to_toml, value)) + ",\n]"
    if isinstance(value, numbers.Integral):
        return repr(int(value))
    return repr(float(value)) if isinstance(value, numbers.Real) else str(value)


def _key(key):
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else to_toml(key)

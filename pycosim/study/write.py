"""A study in; its file (TOML) out."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

from ..core.errors import StudyError
from .schema import COLUMN_KEYS, LIMIT_KEYS, SETTING_KEYS, Study


# --- writing --------------------------------------------------------------------------------------------------------


def write_study(study, path):
    """Write a study; paths in it become relative to the new file.

    Parameters
    ----------
    study : Study
    path : path
        File to write or replace; written beside it under another name first, so that no reader meets half of it.

    Returns
    -------
    Path

    Raises
    ------
    StudyError
        The file cannot be written.
    """
    path = Path(path).absolute()
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_text("\n".join(_lines(study, path.parent)) + "\n", encoding="utf-8")
        os.replace(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise StudyError(f"{path}: cannot be written ({error.strerror})") from None
    return path


def _lines(study, folder):
    yield "[rig]"
    yield f"model = {to_toml(study.rig)}"
    if study.modelica:
        yield f"modelica = {to_toml(_relative(study.modelica, folder))}"
    if study.parameters:
        yield "\n[parameters]"
        for name, setting in study.parameters.items():
            yield f"{to_toml(name)} = {to_toml(_given(setting, SETTING_KEYS))}"
    if study.limits:
        yield "\n[limits]"
        for name, ends in study.limits.items():
            yield f"{to_toml(name)} = {to_toml({k: v for k, v in zip(LIMIT_KEYS, ends) if v is not None})}"
    yield "\n[data]"
    for key in ("runs", "held_out"):
        yield f"{key} = {to_toml(_relative(getattr(study, key), folder))}"
    yield f"reference = {to_toml(study.reference)}"
    names = {"labels": "label"}
    for key in ("labels", "time_column", "w_min", "seed", "drop_outs", "average", "reader", "most"):
        value = getattr(study, key)
        if value != Study.__dataclass_fields__[key].default:
            yield f"{names.get(key, key)} = {to_toml(value)}"
    if study.columns:
        yield "\n[columns]"
        for name, column in study.columns.items():
            given = _given(column, COLUMN_KEYS)
            yield f"{to_toml(name)} = {to_toml({k: v for k, v in given.items() if (k, v) != ('zero', 0.0)})}"
    for effect, place in study.effects:
        yield f"\n[[effects]]\neffect = {to_toml(effect)}\nplace = {to_toml(place)}"


def _given(entry, keys):
    return {k: getattr(entry, k) for k in keys if getattr(entry, k) is not None}


def _relative(paths, folder):
    return [Path(os.path.relpath(p, folder)).as_posix() for p in paths]


def to_toml(value):
    """A value as TOML text, on one line but for long lists.

    Parameters
    ----------
    value : bool, str, int, float, list, tuple or dict

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
    return repr(value) if isinstance(value, (int, float)) else str(value)


def _key(key):
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else to_toml(key)

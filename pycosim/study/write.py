"""A study in; its file (TOML) out: the text that the study was read from, with what has changed."""

from __future__ import annotations

import os
from dataclasses import MISSING
from pathlib import Path

import tomlkit

from ..core.errors import PycosimError, StudyError
from ..core.whole import write_whole
from .layout import LAYOUT_KEYS
from .parse import load_study
from .schema import COLUMN_KEYS, EFFECT_KEYS, LIMIT_KEYS, SETTING_KEYS, Column, Study
from .toml import to_toml

# table: attribute of a study, and key where that is another
_WRITTEN = {"rig": {"rig": "model", "modelica": "modelica"},
            "data": {"runs": "runs", "held_out": "held_out", "reference": "reference", "labels": "label",
                     **{k: k for k in ("time_column", "rate", "time", "leave_out", *LAYOUT_KEYS, "w_min", "seed",
                                       "drop_outs", "average", "reader", "most", "accept", "rejected")}},
            "fit": {"robust": "robust", "own": "own"}}
# attribute that holds entries by name: their settings in the file
_ENTRIES = {"parameters": lambda e: {k: getattr(e, k) for k in SETTING_KEYS},
            "limits": lambda e: dict(zip(LIMIT_KEYS, e)),
            "columns": lambda e: {k: getattr(e, k) for k in COLUMN_KEYS if getattr(e, k) != getattr(Column, k, None)}}
_ORDER = ("rig", "parameters", "limits", "data", "fit", "columns")
_PATHS = ("modelica", "runs", "held_out")
_WIDE = 100  # characters; a longer list has an item a line
_ALWAYS = ("rig", "runs", "held_out", "reference")
"""What a new file says although it may be the default: whoever reads it will look for it."""


# --- writing --------------------------------------------------------------------------------------------------------


def write_study(study, path):
    """Write a study; paths in it become relative to the new file.

    The text of the file that the study was read from is kept, comments included; only what differs is changed in it.

    Parameters
    ----------
    study : Study
        Its own file, where that still is, lends its comments and its order.
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
    try:
        write_whole(path, tomlkit.dumps(_edited(study, path.parent)))
    except OSError as error:
        raise StudyError(f"{path}: cannot be written ({error.strerror})") from None
    return path


def _edited(study, folder):
    """The document that a study was read from, with what has changed since."""
    try:
        known = load_study(study.path)
        document = tomlkit.parse(known.path.read_text(encoding="utf-8"))
    except (PycosimError, OSError):
        known, document = None, tomlkit.document()
    moved = known is None or known.path.parent.resolve() != folder.resolve()
    for table in _ORDER:
        for name, key in _WRITTEN.get(table, {}).items():
            value, usual = getattr(study, name), _default(name)
            before = usual if known is None else getattr(known, name)
            if value != before or (known is None and name in _ALWAYS) or (moved and name in _PATHS and value):
                # w_min and seed may stand above all tables
                home = document if table == "data" and key in document else _table(document, table)
                _put(home, key, _relative(value, folder) if name in _PATHS else value,
                     name not in _ALWAYS and value == usual)
        if table in _ENTRIES:
            _put_entries(document, table, getattr(study, table), getattr(known, table, {}), _ENTRIES[table])
    _put_effects(document, study.effects, getattr(known, "effects", []))
    return document


def _default(name):
    """What a study says of an attribute when its file does not."""
    described = Study.__dataclass_fields__[name]
    return described.default if described.default_factory is MISSING else described.default_factory()


def _table(document, name):
    if name not in document:
        if document:
            document.add(tomlkit.nl())
        document.add(name, tomlkit.table())
    return document[name]


def _put(table, key, value, usual):
    """Set one key; a default need not stand there."""
    if usual:
        table.pop(key, None)
        return
    if isinstance(value, (list, tuple)):
        items, value = value, tomlkit.array()
        value.extend(items)
        value.multiline(len(to_toml(list(items))) > _WIDE)
    table[key] = value


def _put_entries(document, name, wanted, known, settings):
    """Set what has changed in the entries of a table."""
    for entry in [e for e in known if e not in wanted]:
        home, key = _place(document[name], entry)
        del home[key]
    for entry, value in wanted.items():
        if entry in known and known[entry] == value:
            continue
        given = {k: v for k, v in settings(value).items() if v is not None}
        if entry not in known:
            _table(document, name)[entry] = tomlkit.value(to_toml(given))
            continue
        home, key = _place(document[name], entry)
        for k in [k for k in home[key] if k not in given]:
            del home[key][k]
        for k, v in given.items():
            if home[key].get(k) != v:
                home[key][k] = v


def _place(table, name):
    """Where an entry of a dotted name stands: ``s1A.f0 = {..}`` without quotes is a table in a table."""
    while name not in table:
        first = next(k for k in table if name.startswith(f"{k}."))
        table, name = table[first], name[len(first) + 1:]
    return table, name


def _put_effects(document, wanted, known):
    """Append what is new; the list as a whole is written anew where something is gone."""
    if wanted == known:
        return
    kept = known if wanted[:len(known)] == known else []
    if not kept:
        document.pop("effects", None)
        if wanted:
            document.add(tomlkit.nl())
            document.add("effects", tomlkit.aot())
    for pair in wanted[len(kept):]:
        entry = tomlkit.table()
        entry.update(dict(zip(EFFECT_KEYS, pair)))
        document["effects"].append(entry)


def _relative(paths, folder):
    return [Path(os.path.relpath(p, folder)).as_posix() for p in paths]

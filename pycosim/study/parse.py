"""A study file (TOML) in; checked settings, or one sentence that says where it is wrong, out."""

from __future__ import annotations

import glob
import math
import os
import re
import tomllib
from pathlib import Path

from ..core import units
from ..core.errors import BoundsError, StudyError, closest, closest_file
from .layout import DECIMALS, ENCODINGS, PLAIN, SEPARATORS, Layout
from .schema import (
    COLUMN_KEYS,
    DATA_KEYS,
    DROP_OUTS,
    EFFECT_KEYS,
    FINDINGS,
    FIT_KEYS,
    LIMIT_KEYS,
    LOG_ENDINGS,
    MOST,
    READERS,
    REFERENCES,
    RIG_KEYS,
    SETTING_KEYS,
    TABLE_KEYS,
    TABLES,
    TOP_KEYS,
    Column,
    Setting,
    Study,
    known_unit,
    refuse_twice,
)
from .toml import to_toml

_LEAST_MOST = 100
_KINDS = {str: "a text in quotes", float: "a number", bool: "true or false", list: "a list",
          dict: "a table", int: "an integer"}


# --- reading --------------------------------------------------------------------------------------------------------


class Source:
    """A study's text: finds the line of a key, so that messages can point at it."""

    def __init__(self, path):
        self.path = Path(path).absolute()
        if self.path.suffix == ".fmu":
            raise StudyError(f"{path} is an FMU, not a study; write a study that says which column is which of its "
                             f"variables, and type 'pycosim identify study.toml --fmu {path}'")
        try:
            self.text = self.path.read_text(encoding="utf-8-sig")  # with or without the mark that some editors set
        except FileNotFoundError:
            near = closest_file(self.path, (".toml",))
            raise StudyError(f"no study {path}{near}; 'pycosim new' writes one to start from") from None
        except UnicodeDecodeError as error:
            self._refuse_log(path)
            raise StudyError(f"{self.path}: is not text in UTF-8 (byte {error.start + 1}), as a study is; save it so, "
                             "or let 'pycosim new' write one") from None
        except OSError as error:
            raise StudyError(f"{self.path}: cannot be read as a study ({error.strerror})") from None
        try:
            self.tables = tomllib.loads(self.text)
        except tomllib.TOMLDecodeError as error:
            self._refuse_log(path)
            raise StudyError(self._twice(str(error)) or f"{path}: not valid TOML: {error}") from None

    def _refuse_log(self, path):
        """Say of a log that it is one."""
        if self.path.suffix.lower() in LOG_ENDINGS:
            raise StudyError(f"{path} is a log, not a study; give it with --data, behind a study: 'pycosim improve "
                             f"study.toml --data {path}', where 'pycosim new --data {path}' writes the study")

    def _twice(self, told):
        """A message for a key or a table that is there twice, which no TOML may have; None for any other fault."""
        found = re.search(r"(?:overwrite|twice).*\(at (?:line (\d+)|end of document)", told)
        if not found:
            return None
        lines = self.text.rstrip().splitlines()
        for number in range(int(found.group(1) or len(lines)), 0, -1):  # a value may end lines below its key
            key = re.match(r"""\s*(\[+[^\]]*\]+|"[^"]*"|'[^']*'|[\w.-]+)\s*(=|\#|$)""", lines[number - 1])
            if key:
                what = "put all its keys under one" if key[1].startswith("[") else "keep one of the two"
                return f"{self.path}:{number}: {key[1]} is given twice; {what}"
        return None

    def error(self, where, message, key="", kind=StudyError):
        """An error that names file, line of the key, and place in the file.

        Parameters
        ----------
        where : str
            Place in the file, as ``[rig]``.
        message : str
            What is wrong, and what to write instead.
        key : str
            To find the line by.
        kind : type
            Of the error.

        Returns
        -------
        PycosimError
        """
        pattern = re.compile(rf"""\s*(\[+\s*)?["']?{re.escape(key)}["']?\s*[=\]]""")
        lines = [i for i, line in enumerate(self.text.splitlines(), 1) if key and pattern.match(line)]
        line = f":{lines[0]}" if len(lines) == 1 else ""
        return kind(f"{self.path}{line}: {where}{': ' if where else ''}{message}")

    def keys(self, table, known, where, line=""):
        """Refuse keys that nothing reads.

        Parameters
        ----------
        table : dict
            Part of the file, as TOML has it.
        known : collection of str
            All that is read there.
        where : str
            Place in the file.
        line : str
            To find the line by, instead of the key.

        Raises
        ------
        StudyError
            There is one; the line and the nearest known key are named.
        """
        for key in table:
            if key not in known:
                other = next((name for name, keys in TABLE_KEYS.items() if key in keys and name != where), None)
                near = f"; it belongs under {other}" if other and where in TABLE_KEYS else closest(key, known)
                raise self.error(where, f"unknown key '{key}'{near}", line or key)

    def take(self, table, key, kind, where, default=None, line=""):
        """A value of the wanted type, or the default.

        Parameters
        ----------
        table : dict
            Part of the file, as TOML has it.
        key : str
            Of the table.
        kind : type
            ``float`` takes integers too, and nothing infinite.
        where : str
            Place in the file.
        default : object
            What a study means that does not have the key.
        line : str
            To find the line by, instead of the key.

        Returns
        -------
        object

        Raises
        ------
        StudyError
            It is of another type, or infinite.
        """
        if key not in table:
            return default
        value = table[key]
        # bool is an int in Python, and an integer is a fine number in TOML
        fits = isinstance(value, (int, float) if kind is float else kind) and isinstance(value, bool) == (kind is bool)
        if not fits or (kind is float and not math.isfinite(value)):
            raise self.error(where, f"{key} must be {'a finite number' if kind is float else _KINDS[kind]}, "
                                    f"not {to_toml(value)}", line or key)
        return float(value) if kind is float else value

    def choice(self, table, key, known, where, default):
        """One of a few words.

        Parameters
        ----------
        table : dict
            Part of the file, as TOML has it.
        key : str
            Of the table.
        known : sequence of str
            The words that a study may have there.
        where : str
            Place in the file.
        default : str or None
            What a study means that does not have the key.

        Returns
        -------
        str or None

        Raises
        ------
        StudyError
            It is none of them; all are named.
        """
        value = self.take(table, key, str, where, default)
        if value is not default and value not in known:
            raise self.error(where, f"{key} = '{value}' is unknown; use one of {', '.join(known)}", key)
        return value


def load_study(path):
    """Read a study.

    Parameters
    ----------
    path : path
        TOML file.

    Returns
    -------
    Study

    Raises
    ------
    StudyError
        The file is missing or broken, has unknown or mistyped keys, or contradicts itself.
    BoundsError
        A value outside its own min and max, or min above max.
    """
    source = Source(path)
    tables = source.tables
    for key, value in tables.items():
        if key not in TABLES + TOP_KEYS:
            what = "table" if isinstance(value, (dict, list)) else "key"
            raise source.error("", f"unknown {what} '{key}'{closest(key, TABLES + TOP_KEYS)}", key)
    for key in TABLES[:-1]:
        source.take(tables, key, dict, "")
    rig, modelica = _rig(source, tables)
    data = {**_data(source, tables), **_fit(source, tables.get("fit", {}))}
    effects = _effects(source, tables)
    for effect, place in effects:
        if {effect, f"{effect}@{place}"} & set(data["rejected"]):
            raise source.error("[data]", f"rejected rules out '{effect}' at '{place}', which is among the [[effects]]; "
                               "take it out of one of them", "rejected")
    return Study(source.path, rig, modelica, _parameters(source, tables.get("parameters", {})),
                 limits=_limits(source, tables.get("limits", {})),
                 columns=_columns(source, tables.get("columns", {}), data), effects=effects, **data)


def _rig(source, tables):
    if "rig" not in tables:
        raise source.error("", 'no [rig]; say which machine it is: [rig] model = "DriveTrain.Rigs.HipKnee"')
    source.keys(tables["rig"], RIG_KEYS, "[rig]")
    model = source.take(tables["rig"], "model", str, "[rig]")
    if not model:
        raise source.error("[rig]", 'model is missing; say which machine it is: model = "DriveTrain.Rigs.HipKnee"',
                           "rig")
    return model, _paths(source, tables["rig"], "modelica", "[rig]")


def _data(source, tables):
    """The [data] table as keyword arguments of Study."""
    table, where = tables.get("data", {}), "[data]"
    source.keys(table, DATA_KEYS, where)
    for key in TOP_KEYS:
        if key in tables and key in table:
            raise source.error("", f"{key} is given twice, at the top and in [data]; keep one")
    both = {**{k: tables[k] for k in TOP_KEYS if k in tables}, **table}
    w_min = source.take(both, "w_min", float, where)
    if w_min is not None and w_min <= 0:
        raise source.error(where, f"w_min = {w_min:g} rad/s must be above zero", "w_min")
    seed = source.take(both, "seed", int, where, 0)
    if seed < 0:
        raise source.error(where, f"seed = {seed} must not be negative", "seed")
    most = source.take(table, "most", int, where, MOST)
    if most < _LEAST_MOST:
        raise source.error(where, f"most = {most} rows of a log are too few to learn from; use {_LEAST_MOST} at least",
                           "most")
    runs, held_out = (_paths(source, table, key, where) for key in ("runs", "held_out"))
    fitted = [path for path in runs if path not in held_out]  # held_out may pick among runs
    if runs and not fitted:
        raise source.error(where, f"every log, {runs[0].name} first, is in runs and in held_out, so nothing is left to "
                           "fit; hold fewer out", "held_out")
    average = source.choice(table, "average", ("file",), where, None)
    leave_out = _left_out(source, table, [*fitted, *held_out])
    if leave_out and average:
        raise source.error(where, "leave_out is of samples, and average makes one sample of a file; use time = [first, "
                           "last] for the part that is averaged", "leave_out")
    return dict(runs=fitted, held_out=held_out, w_min=w_min, seed=seed, most=most,
                reference=source.choice(table, "reference", REFERENCES, where, "unknown"),
                labels=source.take(table, "label", str, where, "manoeuvre"),
                time_column=source.take(table, "time_column", str, where, "time"),
                drop_outs=source.choice(table, "drop_outs", DROP_OUTS, where, "refuse"),
                average=average, leave_out=leave_out,
                reader=source.choice(table, "reader", READERS, where, None), **_layout(source, table),
                accept=_accepted(source, table), rejected=_texts(source, table, "rejected"))


def _layout(source, table):
    """What a file does not say of its rows itself: their rate, whether the first names columns, which are used."""
    where = "[data]"
    rate = source.take(table, "rate", float, where)
    if rate is not None and rate <= 0:
        raise source.error(where, f"rate = {rate:g} Hz must be above zero", "rate")
    if rate is not None and table.get("time_column"):
        raise source.error(where, "rate is for logs without a column of time, but time_column names one; keep one of "
                           "the two", "rate")
    if rate is None and table.get("time_column") == "":
        raise source.error(where, 'time_column = "" says that no column is the time; add rate, the rows a second',
                           "time_column")
    span = source.take(table, "time", list, where)
    if span is not None:
        if not _rising(span):
            raise source.error(where, f"time must be [first, last], two rising numbers in s, not {to_toml(span)}",
                               "time")
        span = float(span[0]), float(span[1])
    return dict(rate=rate, time=span, **_text_layout(source, table))


def _rising(span):
    """Whether a list is of two rising numbers."""
    return len(span) == 2 and all(isinstance(t, (int, float)) and not isinstance(t, bool) and math.isfinite(t)
                                  for t in span) and span[0] < span[1]


def _left_out(source, table, logs):
    """Spans of time whose samples are not compared, some of them of one log."""
    found, names = [], [path.name for path in logs]
    for item in source.take(table, "leave_out", list, "[data]", []):
        *file, first, last = item if isinstance(item, list) and len(item) in (2, 3) else ("", "", "")
        if not _rising([first, last]) or not all(isinstance(f, str) for f in file):
            raise source.error("[data]", "leave_out must be a list of [first, last], two rising numbers in s, or of "
                               f'["run.csv", first, last], but holds {to_toml(item)}', "leave_out")
        if names and file and file[0] not in names:
            raise source.error("[data]", f"leave_out: no log '{file[0]}' is in runs or held_out"
                               f"{closest(file[0], names)}", "leave_out")
        found.append([*file, float(first), float(last)])
    return found


def _text_layout(source, table):
    """How a text file holds its table."""
    where = "[data]"
    found = Layout(source.take(table, "header", bool, where, True),
                   source.choice(table, "separator", SEPARATORS, where, PLAIN.separator),
                   source.choice(table, "decimal", DECIMALS, where, PLAIN.decimal),
                   source.choice(table, "encoding", ENCODINGS, where, PLAIN.encoding),
                   source.take(table, "preamble", int, where, 0),
                   source.take(table, "units_row", bool, where, False))
    if found.said and table.get("reader") is not None:
        key, line = next(iter(found.said)), found.lines[0]
        raise source.error(where, f"{line} is for comma-separated text; remove reader = '{table['reader']}'", key)
    if found.preamble < 0:
        raise source.error(where, f"preamble = {found.preamble} lines must not be below zero", "preamble")
    if found.units_row and not found.header:
        raise source.error(where, "units_row is the row below the header, and header = false says there is none; "
                           "count it in preamble", "units_row")
    return found.said


def _texts(source, table, key, where="[data]"):
    """A list of words."""
    found = source.take(table, key, list, where, [])
    for item in found:
        if not isinstance(item, str) or not item:
            raise source.error(where, f"{key} must be a list of texts in quotes, but holds {to_toml(item)}", key)
    return found


def _accepted(source, table):
    """Kinds of findings that the study has answered."""
    found = _texts(source, table, "accept")
    for kind in found:
        if kind not in FINDINGS:
            near = closest(kind, FINDINGS)
            raise source.error("[data]", f"accept: the data check finds nothing of the kind '{kind}'{near}; write the "
                               "kind that 'pycosim check' says behind a finding", "accept")
    return found


def _fit(source, table):
    source.keys(table, FIT_KEYS, "[fit]")
    own = _texts(source, table, "own", "[fit]")
    twice = next((n for n in own if own.count(n) > 1), None)
    if twice is not None:
        raise source.error("[fit]", f"own lists '{twice}' twice", "own")
    return dict(robust=source.take(table, "robust", bool, "[fit]", False), own=own)


def _paths(source, table, key, where):
    """Paths relative to the study; a pattern stands for all files it matches."""
    found = []
    for item in source.take(table, key, list, where, []):
        if not isinstance(item, str) or not item:
            raise source.error(where, f"{key} must be a list of file names, but holds {to_toml(item)}", key)
        path = Path(os.path.normpath(source.path.parent / item))
        if not glob.has_magic(item) or path.exists():
            found.append(path)
            continue
        matches = sorted(Path(p) for p in glob.glob(str(path)))
        if not matches:
            raise source.error(where, f"{key}: no file matches '{item}'", key)
        found += matches
    refuse_twice(found, f"{source.path}: {where} {key}")
    return found


def _leaves(table, keys, prefix=""):
    """Yield (dotted name, settings): unquoted ``s1A.f0 = {..}`` is a nested table in TOML, and means the same."""
    for key, value in table.items():
        nested = isinstance(value, dict) and value and all(isinstance(v, dict) for v in value.values())
        if nested and not set(value) & set(keys):
            yield from _leaves(value, keys, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _parameters(source, table):
    found = {}
    for name, given in _leaves(table, SETTING_KEYS):
        where = f"[parameters] '{name}'"
        if name in found:
            raise source.error(where, "is given twice", name)
        if not isinstance(given, dict):
            raise source.error(where, f"must be a table, as {{ value = {to_toml(given)} }}", name)
        source.keys(given, SETTING_KEYS, where, name)
        value, low, high = (source.take(given, k, float, where, None, name) for k in SETTING_KEYS[:3])
        if low is not None and high is not None and low > high:
            raise source.error(where, f"min {low:g} is above max {high:g}", name, BoundsError)
        outside = value is not None and ((low is not None and value < low) or (high is not None and value > high))
        if outside:
            bounds = f"{'-inf' if low is None else f'{low:g}'} to {'inf' if high is None else f'{high:g}'}"
            raise source.error(where, f"value {value:g} is outside its own bounds {bounds}", name, BoundsError)
        found[name] = Setting(value, low, high, source.take(given, "fixed", bool, where, None, name))
    return found


def _limits(source, table):
    """The [limits] table: (min, max) by variable or sum of angles."""
    found = {}
    for name, given in _leaves(table, LIMIT_KEYS):
        where = f"[limits] '{name}'"
        if not isinstance(given, dict) or not given:
            raise source.error(where, "must be a table, as { min = -0.4, max = 2.0 }", name)
        source.keys(given, LIMIT_KEYS, where, name)
        low, high = (source.take(given, k, float, where, None, name) for k in LIMIT_KEYS)
        if low is not None and high is not None and low >= high:
            raise source.error(where, f"min {low:g} is not below max {high:g}", name, BoundsError)
        found[name] = (low, high)
    return found


def _columns(source, table, data):
    found = {}
    for name, given in _leaves(table, COLUMN_KEYS):
        where = f"[columns] '{name}'"
        if name in found:
            raise source.error(where, "is given twice", name)
        if not isinstance(given, dict):
            raise source.error(where, 'must be a table, as { variable = "motor1.tau", unit = "N.m" }', name)
        column = _column(source, given, where, name)
        for other, taken in found.items():
            if taken.variable == column.variable:
                raise source.error(where, f"'{column.variable}' is already read from column '{other}'; keep one", name)
        if data["rate"] is not None and column.variable == "time":
            raise source.error(where, "is a column of time, and [data] rate is for logs without one; keep one of the "
                                      "two", name)
        if data["rate"] is None and (name == data["time_column"]) != (column.variable == "time"):
            raise source.error(where, f"the time is read from column '{data['time_column']}', which can only be the "
                                      "variable 'time'; [data] time_column names another one", name)
        if name == data["labels"]:
            raise source.error(where, "is the label column, which holds text; [data] label names another one", name)
        found[name] = column
    return found


def _column(source, given, where, name):
    source.keys(given, COLUMN_KEYS, where, name)
    variable, unit = (source.take(given, k, str, where, None, name) for k in ("variable", "unit"))
    for key, value in (("variable", variable), ("unit", unit)):
        if value is None:
            raise source.error(where, f'no {key}; write {{ variable = "motor1.tau", unit = "N.m" }}', name)
    if known_unit(unit) is None:
        raise source.error(where, f"unknown unit '{unit}'{closest(unit, units.UNITS)}", name)
    k_m = source.take(given, "k_m", float, where, None, name)
    if k_m is not None and known_unit(unit)[0] != "A":
        raise source.error(where, f"k_m goes with a current, but the unit is '{unit}'; use A or mA, or remove k_m",
                           name)
    if k_m == 0.0:
        raise source.error(where, "k_m = 0 N.m/A makes every torque zero", name)
    numbers = {key: source.take(given, key, float, where, usual, name)
               for key, usual in (("zero", 0.0), ("gain", 1.0), ("offset", 0.0), ("sign", 1.0), ("late", 0.0),
                                  ("clock", 1.0))}
    if numbers["gain"] == 0.0:
        raise source.error(where, "gain = 0 makes every reading the same", name)
    if abs(numbers["sign"]) != 1.0:
        raise source.error(where, f"sign = {numbers['sign']:g} must be 1 or -1; gain holds any other factor", name)
    wrap = source.take(given, "wrap", float, where, None, name)
    if wrap is not None and wrap <= 0:
        raise source.error(where, f"wrap = {wrap:g} must be above zero; it is a turn in the column's numbers", name)
    if not 0.5 < numbers["clock"] < 2.0:
        raise source.error(where, f"clock = {numbers['clock']:g} must be near 1, as many times as fast as the log's as "
                           "it runs", name)
    return Column(variable, unit, k_m, **{**numbers, "sign": int(numbers["sign"])}, wrap=wrap)


def _effects(source, tables):
    found = []
    for k, given in enumerate(source.take(tables, "effects", list, "", []), 1):
        where = f"[[effects]] no. {k}"
        if not isinstance(given, dict):
            raise source.error(where, 'must be a table with effect = ".." and place = ".."')
        source.keys(given, EFFECT_KEYS, where)
        pair = tuple(source.take(given, key, str, where) for key in EFFECT_KEYS)
        for key, value in zip(EFFECT_KEYS, pair):
            if not value:
                raise source.error(where, f'{key} is missing; write effect = "viscous" and place = "1A"')
        if pair in found:
            raise source.error(where, f"'{pair[0]}' at '{pair[1]}' is listed twice")
        found.append(pair)
    return found

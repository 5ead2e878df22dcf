"""A study file (TOML) comes in; checked settings, columns, runs and effects go out, and back into a file."""

from __future__ import annotations

import glob
import json
import math
import os
import re
import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path

from ..core import units
from ..compile.effects import catalogue, find_effect, find_place
from ..compile.model import compile_model
from ..core.errors import BoundsError, PycosimError, StudyError, UnknownNameError, closest

REFERENCES = ("sensor", "gravity_model", "unknown")
DROP_OUTS = ("refuse", "skip")
READERS = ("bam", "epos")
# What a log may hold although the rig has no such variable: effects read it, or it is only looked at.
LOG_VARIABLES = {"time": "s", "temperature": "degC"}

_TABLES = ("rig", "parameters", "limits", "data", "columns", "effects")
_TOP_KEYS = ("w_min", "seed")
_RIG_KEYS = ("model", "modelica")
_SETTING_KEYS = ("value", "min", "max", "fixed")
_COLUMN_KEYS = ("variable", "unit", "k_m", "zero")
_EFFECT_KEYS = ("effect", "place")
_LIMIT_KEYS = ("min", "max")
_DATA_KEYS = ("runs", "held_out", "reference", "label", "time_column", "w_min", "seed", "drop_outs",
              "average", "reader", "most")
MOST = 2_000_000
"""Rows of a log that are read one by one, if the study does not say."""
_LEAST_MOST = 100
_KINDS = {str: "a text in quotes", float: "a number", bool: "true or false", list: "a list",
          dict: "a table", int: "an integer"}


@dataclass(frozen=True)
class Setting:
    """What a study says about one parameter; None is the library's default.

    Attributes
    ----------
    value, min, max : float or None
        In the parameter's SI unit.
    fixed : bool or None
        True keeps the parameter out of every fit.
    """

    value: float | None = None
    min: float | None = None
    max: float | None = None
    fixed: bool | None = None


@dataclass(frozen=True)
class Column:
    """Where a column of the logs goes.

    Attributes
    ----------
    variable : str
        Variable of the rig, as ``motor1.tau``.
    unit : str
        Unit of the column as it is in the file.
    k_m : float or None
        Torque constant [N.m/A] of a column that holds a current.
    zero : float
        Reading that means zero, in the column's unit; subtracted.
    """

    variable: str
    unit: str
    k_m: float | None = None
    zero: float = 0.0

    @property
    def dimension(self):
        """SI unit of the column after conversion."""
        return "N.m" if self.k_m is not None else _unit(self.unit)[0]

    def si(self, values):
        """Readings to SI: zero taken off, unit converted, current made a torque.

        Parameters
        ----------
        values : ndarray, shape (n,)
            In the column's unit.

        Returns
        -------
        ndarray, shape (n,)
        """
        return (values - self.zero) * (_unit(self.unit)[1] * (1.0 if self.k_m is None else self.k_m))


@dataclass(frozen=True)
class Study:
    """A rig, what is known about it, and its logs.

    Attributes
    ----------
    path : Path
        The study file; relative paths in it start at its folder.
    rig : str
        Modelica class.
    modelica : list of Path
        Modelica files of the user, on top of the library.
    parameters : dict of str to Setting
    runs, held_out : list of Path
        Logs to fit, and logs kept for the test; no file is in both.
    reference : str
        ``sensor``, ``gravity_model`` or ``unknown``: where the joint torques come from.
    columns : dict of str to Column
        By the column's name in the file.
    labels, time_column : str
        Columns of the optional labels and of the time.
    effects : list of (str, str)
        Effect and place.
    w_min : float or None
        Speed [rad/s] above which a sample is moving; None finds it from the data.
    seed : int
    drop_outs : str
        ``refuse``, or ``skip`` to leave rows with missing numbers out.
    average : str or None
        ``file``: one file is one sample, its mean.
    reader : str or None
        Format of the logs when their ending does not say it.
    limits : dict of str to (float or None, float or None)
        Least and greatest value of a variable, or of a sum of joint or motor angles as ``q_H + q_K``, that a planned
        experiment keeps to.
    most : int
        A log with more rows is read as means of consecutive rows, about so many.
    """

    path: Path
    rig: str
    modelica: list = field(default_factory=list)
    parameters: dict = field(default_factory=dict)
    runs: list = field(default_factory=list)
    held_out: list = field(default_factory=list)
    reference: str = "unknown"
    columns: dict = field(default_factory=dict)
    labels: str = "manoeuvre"
    time_column: str = "time"
    effects: list = field(default_factory=list)
    w_min: float | None = None
    seed: int = 0
    drop_outs: str = "refuse"
    average: str | None = None
    reader: str | None = None
    limits: dict = field(default_factory=dict)
    most: int = MOST

    @property
    def name(self):
        """Name of the study: its file's without the ending."""
        return self.path.stem

    def with_data(self, files):
        """The same study on other logs.

        Parameters
        ----------
        files : sequence of path
            Instead of all logs of the study. Those among them that the study holds out stay held out, unless nothing
            would be left to fit.

        Returns
        -------
        Study

        Raises
        ------
        StudyError
            A file is given twice.
        """
        files = [Path(f).absolute() for f in files]
        _refuse_twice(files, "--data")
        kept = {p.resolve() for p in self.held_out}
        held_out = [f for f in files if f.resolve() in kept]
        if len(held_out) == len(files):
            held_out = []
        return replace(self, runs=[f for f in files if f not in held_out], held_out=held_out)

    def validate(self, library):
        """Check every name, bound and unit against the Modelica library.

        Parameters
        ----------
        library : Library

        Returns
        -------
        Model
            The compiled rig with the study's effects.

        Raises
        ------
        UnknownNameError
            Rig, effect, place, parameter or variable that does not exist, or a unit that does not fit its variable.
        BoundsError
            A value outside the bounds of its Modelica parameter.
        ModelicaError
        """
        try:
            library.find(self.rig)
            for effect, place in self.effects:
                find_place(library, self.rig, find_effect(library, effect), place)
        except PycosimError as error:
            raise type(error)(f"{self.path}: {error}") from None
        model = compile_model(library, self.rig, self.effects)
        for name, setting in self.parameters.items():
            _check_parameter(self, name, setting, model.parameters)
        read = {n: unit for effect in catalogue(library).values() for n, unit in effect.measured.items()}
        known = {**read, **LOG_VARIABLES, **{n: v.unit for n, v in model.variables.items()}}
        for name, column in self.columns.items():
            _check_column(self, name, column, known)
        return model


def _check_parameter(study, name, setting, known):
    if name not in known:
        raise UnknownNameError(f"{study.path}: no parameter '{name}' in {study.rig}{closest(name, known)}")
    parameter = known[name]
    for key in ("value", "min", "max"):
        given = getattr(setting, key)
        if given is not None and not parameter.min <= given <= parameter.max:
            raise BoundsError(f"{study.path}: {key} {given:g} {parameter.unit} of '{name}' is outside the bounds of "
                              f"the rig, {parameter.min:g} to {parameter.max:g} {parameter.unit}")
    value = parameter.value if setting.value is None else setting.value
    low = -math.inf if setting.min is None else setting.min
    high = math.inf if setting.max is None else setting.max
    if not low <= value <= high:
        raise BoundsError(f"{study.path}: '{name}' has the rig's default {value:g} {parameter.unit}, outside the "
                          f"study's bounds {low:g} to {high:g} {parameter.unit}; give a value within them")
    if setting.fixed is False and max(low, parameter.min) == min(high, parameter.max):
        raise BoundsError(f"{study.path}: '{name}' is to be fitted, but its bounds leave {value:g} {parameter.unit} "
                          "alone; write fixed = true, or wider bounds")


def _check_column(study, name, column, known):
    where = f"{study.path}: column '{name}'"
    if column.variable not in known:
        raise UnknownNameError(
            f"{where}: no variable '{column.variable}' in {study.rig}{closest(column.variable, known)}")
    expected = known[column.variable]
    if column.k_m is None:
        units.to_si(column.unit, expected, where)
    elif expected != "N.m":
        raise StudyError(f"{where}: k_m makes a current a torque, but '{column.variable}' is in {expected}; remove k_m")


# --- reading --------------------------------------------------------------------------------------------------------


def _unit(unit):
    """Dimension and factor to SI of a unit, or None."""
    return units._UNITS.get(units._SPELLINGS.get(unit, unit))


class _Source:
    """A study's text: finds the line of a key, so that messages can point at it."""

    def __init__(self, path):
        self.path = Path(path).absolute()
        try:
            self.text = self.path.read_text(encoding="utf-8")
        except FileNotFoundError:
            near = closest(self.path.name, [p.name for p in self.path.parent.glob("*.toml")])
            raise StudyError(f"no study {path}{near}; 'pycosim new' writes one to start from") from None
        except (OSError, UnicodeDecodeError) as error:
            why = getattr(error, "strerror", None) or error
            raise StudyError(f"{path}: cannot be read as a study ({why})") from None
        try:
            self.tables = tomllib.loads(self.text)
        except tomllib.TOMLDecodeError as error:
            raise StudyError(f"{path}: not valid TOML: {error}") from None

    def error(self, where, message, key="", kind=StudyError):
        """An error that names file, line of the key, and place in the file."""
        pattern = re.compile(rf"""\s*(\[+\s*)?["']?{re.escape(key)}["']?\s*[=\]]""")
        lines = [i for i, line in enumerate(self.text.splitlines(), 1) if key and pattern.match(line)]
        line = f":{lines[0]}" if len(lines) == 1 else ""
        return kind(f"{self.path}{line}: {where}{': ' if where else ''}{message}")

    def keys(self, table, known, where, line=""):
        """Refuse keys that nothing reads."""
        for key in table:
            if key not in known:
                raise self.error(where, f"unknown key '{key}'{closest(key, known)}", line or key)

    def take(self, table, key, kind, where, default=None, line=""):
        """A value of the wanted type, or the default."""
        if key not in table:
            return default
        value = table[key]
        # bool is an int in Python, and an integer is a fine number in TOML
        fits = isinstance(value, (int, float) if kind is float else kind) and isinstance(value, bool) == (kind is bool)
        if not fits or (kind is float and not math.isfinite(value)):
            raise self.error(where, f"{key} must be {'a finite number' if kind is float else _KINDS[kind]}, "
                                    f"not {_toml(value)}", line or key)
        return float(value) if kind is float else value

    def choice(self, table, key, known, where, default):
        """One of a few words."""
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
    source = _Source(path)
    tables = source.tables
    for key, value in tables.items():
        if key not in _TABLES + _TOP_KEYS:
            what = "table" if isinstance(value, (dict, list)) else "key"
            raise source.error("", f"unknown {what} '{key}'{closest(key, _TABLES + _TOP_KEYS)}", key)
    for key in _TABLES[:-1]:
        source.take(tables, key, dict, "")
    rig, modelica = _rig(source, tables)
    data = _data(source, tables)
    return Study(source.path, rig, modelica, _parameters(source, tables.get("parameters", {})),
                 limits=_limits(source, tables.get("limits", {})),
                 columns=_columns(source, tables.get("columns", {}), data), effects=_effects(source, tables), **data)


def _rig(source, tables):
    if "rig" not in tables:
        raise source.error("", 'no [rig]; say which machine it is: [rig] model = "DriveTrain.Rigs.HipKnee"')
    source.keys(tables["rig"], _RIG_KEYS, "[rig]")
    model = source.take(tables["rig"], "model", str, "[rig]")
    if not model:
        raise source.error("[rig]", 'model is missing; say which machine it is: model = "DriveTrain.Rigs.HipKnee"',
                           "rig")
    return model, _paths(source, tables["rig"], "modelica", "[rig]")


def _data(source, tables):
    """The [data] table as keyword arguments of Study."""
    table, where = tables.get("data", {}), "[data]"
    source.keys(table, _DATA_KEYS, where)
    for key in _TOP_KEYS:
        if key in tables and key in table:
            raise source.error("", f"{key} is given twice, at the top and in [data]; keep one")
    both = {**{k: tables[k] for k in _TOP_KEYS if k in tables}, **table}
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
    return dict(runs=fitted, held_out=held_out, w_min=w_min, seed=seed, most=most,
                reference=source.choice(table, "reference", REFERENCES, where, "unknown"),
                labels=source.take(table, "label", str, where, "manoeuvre"),
                time_column=source.take(table, "time_column", str, where, "time"),
                drop_outs=source.choice(table, "drop_outs", DROP_OUTS, where, "refuse"),
                average=source.choice(table, "average", ("file",), where, None),
                reader=source.choice(table, "reader", READERS, where, None))


def _paths(source, table, key, where):
    """Paths relative to the study; a pattern stands for all files it matches."""
    found = []
    for item in source.take(table, key, list, where, []):
        if not isinstance(item, str) or not item:
            raise source.error(where, f"{key} must be a list of file names, but holds {_toml(item)}", key)
        path = Path(os.path.normpath(source.path.parent / item))
        if not glob.has_magic(item) or path.exists():
            found.append(path)
            continue
        matches = sorted(Path(p) for p in glob.glob(str(path)))
        if not matches:
            raise source.error(where, f"{key}: no file matches '{item}'", key)
        found += matches
    _refuse_twice(found, f"{source.path}: {where} {key}")
    return found


def _refuse_twice(paths, where):
    for path in paths:
        if paths.count(path) > 1:
            raise StudyError(f"{where}: {path} is listed twice; a log counted twice makes the intervals too narrow")


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
    for name, given in _leaves(table, _SETTING_KEYS):
        where = f"[parameters] '{name}'"
        if name in found:
            raise source.error(where, "is given twice", name)
        if not isinstance(given, dict):
            raise source.error(where, f"must be a table, as {{ value = {_toml(given)} }}", name)
        source.keys(given, _SETTING_KEYS, where, name)
        value, low, high = (source.take(given, k, float, where, None, name) for k in _SETTING_KEYS[:3])
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
    for name, given in _leaves(table, _LIMIT_KEYS):
        where = f"[limits] '{name}'"
        if not isinstance(given, dict) or not given:
            raise source.error(where, "must be a table, as { min = -0.4, max = 2.0 }", name)
        source.keys(given, _LIMIT_KEYS, where, name)
        low, high = (source.take(given, k, float, where, None, name) for k in _LIMIT_KEYS)
        if low is not None and high is not None and low >= high:
            raise source.error(where, f"min {low:g} is not below max {high:g}", name, BoundsError)
        found[name] = (low, high)
    return found


def _columns(source, table, data):
    found = {}
    for name, given in _leaves(table, _COLUMN_KEYS):
        where = f"[columns] '{name}'"
        if name in found:
            raise source.error(where, "is given twice", name)
        if not isinstance(given, dict):
            raise source.error(where, 'must be a table, as { variable = "motor1.tau", unit = "N.m" }', name)
        column = _column(source, given, where, name)
        for other, taken in found.items():
            if taken.variable == column.variable:
                raise source.error(where, f"'{column.variable}' is already read from column '{other}'; keep one", name)
        if (name == data["time_column"]) != (column.variable == "time"):
            raise source.error(where, f"the time is read from column '{data['time_column']}', which can only be the "
                                      "variable 'time'; [data] time_column names another one", name)
        if name == data["labels"]:
            raise source.error(where, "is the label column, which holds text; [data] label names another one", name)
        found[name] = column
    return found


def _column(source, given, where, name):
    source.keys(given, _COLUMN_KEYS, where, name)
    variable, unit = (source.take(given, k, str, where, None, name) for k in ("variable", "unit"))
    for key, value in (("variable", variable), ("unit", unit)):
        if value is None:
            raise source.error(where, f'no {key}; write {{ variable = "motor1.tau", unit = "N.m" }}', name)
    if _unit(unit) is None:
        raise source.error(where, f"unknown unit '{unit}'{closest(unit, units._UNITS)}", name)
    k_m = source.take(given, "k_m", float, where, None, name)
    if k_m is not None and _unit(unit)[0] != "A":
        raise source.error(where, f"k_m goes with a current, but the unit is '{unit}'; use A or mA, or remove k_m",
                           name)
    if k_m == 0.0:
        raise source.error(where, "k_m = 0 N.m/A makes every torque zero", name)
    return Column(variable, unit, k_m, source.take(given, "zero", float, where, 0.0, name))


def _effects(source, tables):
    found = []
    for k, given in enumerate(source.take(tables, "effects", list, "", []), 1):
        where = f"[[effects]] no. {k}"
        if not isinstance(given, dict):
            raise source.error(where, 'must be a table with effect = ".." and place = ".."')
        source.keys(given, _EFFECT_KEYS, where)
        pair = tuple(source.take(given, key, str, where) for key in _EFFECT_KEYS)
        for key, value in zip(_EFFECT_KEYS, pair):
            if not value:
                raise source.error(where, f'{key} is missing; write effect = "viscous" and place = "1A"')
        if pair in found:
            raise source.error(where, f"'{pair[0]}' at '{pair[1]}' is listed twice")
        found.append(pair)
    return found


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
    yield f"model = {_toml(study.rig)}"
    if study.modelica:
        yield f"modelica = {_toml(_relative(study.modelica, folder))}"
    if study.parameters:
        yield "\n[parameters]"
        for name, setting in study.parameters.items():
            yield f"{_toml(name)} = {_toml(_given(setting, _SETTING_KEYS))}"
    if study.limits:
        yield "\n[limits]"
        for name, ends in study.limits.items():
            yield f"{_toml(name)} = {_toml({k: v for k, v in zip(_LIMIT_KEYS, ends) if v is not None})}"
    yield "\n[data]"
    for key in ("runs", "held_out"):
        yield f"{key} = {_toml(_relative(getattr(study, key), folder))}"
    yield f"reference = {_toml(study.reference)}"
    names = {"labels": "label"}
    for key in ("labels", "time_column", "w_min", "seed", "drop_outs", "average", "reader", "most"):
        value = getattr(study, key)
        if value != Study.__dataclass_fields__[key].default:
            yield f"{names.get(key, key)} = {_toml(value)}"
    if study.columns:
        yield "\n[columns]"
        for name, column in study.columns.items():
            given = _given(column, _COLUMN_KEYS)
            yield f"{_toml(name)} = {_toml({k: v for k, v in given.items() if (k, v) != ('zero', 0.0)})}"
    for effect, place in study.effects:
        yield f"\n[[effects]]\neffect = {_toml(effect)}\nplace = {_toml(place)}"


def _given(entry, keys):
    return {k: getattr(entry, k) for k in keys if getattr(entry, k) is not None}


def _relative(paths, folder):
    return [Path(os.path.relpath(p, folder)).as_posix() for p in paths]


def _toml(value):
    """A value as TOML text, on one line but for long lists."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # JSON's escapes are TOML's but for DEL, which JSON leaves bare
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(k)} = {_toml(v)}" for k, v in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        flat = "[" + ", ".join(map(_toml, value)) + "]"
        return flat if len(flat) < 100 else "[\n    " + ",\n    ".join(map(_toml, value)) + ",\n]"
    return repr(value) if isinstance(value, (int, float)) else str(value)


def _key(key):
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _toml(key)

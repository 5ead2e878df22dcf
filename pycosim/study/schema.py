"""What a study can say: its tables, keys and settings."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

from ..compile.effects import catalogue, find_effect, find_place
from ..compile.model import compile_model
from ..core import units
from ..core.errors import BoundsError, PycosimError, StudyError, UnknownNameError, closest

REFERENCES = ("sensor", "gravity_model", "unknown")
DROP_OUTS = ("refuse", "skip")
READERS = ("bam", "epos")
# What a log may hold although the rig has no such variable: effects read it, or it is only looked at.
LOG_VARIABLES = {"time": "s", "temperature": "degC"}
TABLES = ("rig", "parameters", "limits", "data", "columns", "effects")
TOP_KEYS = ("w_min", "seed")
RIG_KEYS = ("model", "modelica")
SETTING_KEYS = ("value", "min", "max", "fixed")
COLUMN_KEYS = ("variable", "unit", "k_m", "zero")
EFFECT_KEYS = ("effect", "place")
LIMIT_KEYS = ("min", "max")
DATA_KEYS = ("runs", "held_out", "reference", "label", "time_column", "w_min", "seed", "drop_outs",
              "average", "reader", "most")
MOST = 2_000_000
"""Rows of a log that are read one by one, if the study does not say."""


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
        return "N.m" if self.k_m is not None else known_unit(self.unit)[0]

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
        return (values - self.zero) * (known_unit(self.unit)[1] * (1.0 if self.k_m is None else self.k_m))


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
        refuse_twice(files, "--data")
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
            check_parameter(self, name, setting, model.parameters)
        read = {n: unit for effect in catalogue(library).values() for n, unit in effect.measured.items()}
        known = {**read, **LOG_VARIABLES, **{n: v.unit for n, v in model.variables.items()}}
        for name, column in self.columns.items():
            check_column(self, name, column, known)
        return model


def check_parameter(study, name, setting, known):
    """Check what a study says of a parameter against its rig.

    Parameters
    ----------
    study : Study
    name : str
    setting : Setting
    known : dict of str to Variable
        Parameters of the rig.

    Raises
    ------
    UnknownNameError
        With the closest name that there is.
    BoundsError
    """
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


def check_column(study, name, column, known):
    """Check what a study says of a column against its rig.

    Parameters
    ----------
    study : Study
    name : str
        Of the column in the file.
    column : Column
    known : dict of str to str
        Unit of every variable that a log can hold.

    Raises
    ------
    UnknownNameError
        No such variable, or a unit that does not fit it.
    StudyError
    """
    where = f"{study.path}: column '{name}'"
    if column.variable not in known:
        raise UnknownNameError(
            f"{where}: no variable '{column.variable}' in {study.rig}{closest(column.variable, known)}")
    expected = known[column.variable]
    if column.k_m is None:
        units.to_si(column.unit, expected, where)
    elif expected != "N.m":
        raise StudyError(f"{where}: k_m makes a current a torque, but '{column.variable}' is in {expected}; remove k_m")


def known_unit(unit):
    """Dimension and factor to SI of a unit.

    Parameters
    ----------
    unit : str

    Returns
    -------
    (str, float) or None
        None where the unit is unknown.
    """
    return units._UNITS.get(units._SPELLINGS.get(unit, unit))


def refuse_twice(paths, where):
    """Refuse a log that is listed twice.

    Parameters
    ----------
    paths : list of Path
    where : str
        Said in the message.

    Raises
    ------
    StudyError
    """
    for path in paths:
        if paths.count(path) > 1:
            raise StudyError(f"{where}: {path} is listed twice; a log counted twice makes the intervals too narrow")

"""What a study can say: its tables, keys and settings."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..compile.effects import catalogue, component_name, find_effect, find_place
from ..compile.model import compile_model
from ..core import units
from ..core.errors import BoundsError, PycosimError, StudyError, UnknownNameError, closest
from .layout import LAYOUT_KEYS, Layout
from .toml import to_toml

REFERENCES = ("sensor", "gravity_model", "unknown")
DROP_OUTS = ("refuse", "skip")
READERS = ("bam", "epos")
LOG_ENDINGS = (".csv", ".txt", ".tsv", ".dat", ".asc", ".parquet", ".pq", ".mat", ".mcap", ".mf4", ".mdf")
"""Of files that are read as logs unless [data] reader says more."""
FINDINGS = ("sign", "swap", "scale", "unit", "shift", "clock", "wrap", "clipped", "stuck", "outliers", "shock",
            "filtered", "zero", "disagreement", "limits", "resolution", "rest", "rate")
"""Kinds of what the data check finds, that a study can accept."""
# What a log may hold although the rig has no such variable: effects read it, or it is only looked at.
LOG_VARIABLES = {"time": "s", "temperature": "degC"}
TABLES = ("rig", "parameters", "limits", "data", "fit", "columns", "effects")
TOP_KEYS = ("w_min", "seed")
RIG_KEYS = ("model", "modelica")
SETTING_KEYS = ("value", "min", "max", "fixed")
COLUMN_KEYS = ("variable", "unit", "k_m", "zero", "gain", "offset", "sign", "wrap", "late", "clock")
EFFECT_KEYS = ("effect", "place")
LIMIT_KEYS = ("min", "max")
DATA_KEYS = ("runs", "held_out", "reference", "label", "time_column", "w_min", "seed", "drop_outs",
              "average", "reader", "most", "rate", "time", "leave_out", *LAYOUT_KEYS, "accept", "rejected")
FIT_KEYS = ("robust", "own")
TABLE_KEYS = {"[rig]": RIG_KEYS, "[data]": DATA_KEYS, "[fit]": FIT_KEYS}
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

    def applied(self, variable):
        """A parameter of the library as the study wants it.

        Bounds of the study hold, narrower or wider than the rig's. Where they are wider, the machine is larger than the
        one that the rig's scale was written for, and the scale grows as the bounds do.

        Parameters
        ----------
        variable : Variable
            The rig's parameter, with its Modelica value and bounds [SI].

        Returns
        -------
        Variable
        """
        value, low, high = (getattr(variable, k) if getattr(self, k) is None else getattr(self, k)
                            for k in ("value", "min", "max"))
        before, after = (max((abs(b) for b in ends if math.isfinite(b)), default=0.0)
                         for ends in ((variable.min, variable.max), (low, high)))
        growth = max(1.0, after / before) if before else 1.0
        return replace(variable, value=value, min=low, max=high, nominal=variable.nominal * growth)


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
        Reading that means zero, in the column's own numbers; subtracted first.
    gain : float
        Factor that takes the column's numbers to ``unit``, as radians a count.
    offset : float
        Added after the gain, in ``unit``.
    sign : int
        1, or -1 where the recorder counts the other way.
    late : float
        The readings come this much after the others of their row [s].
    clock : float
        The readings' own clock runs so many times as fast as the log's, from its first row on.
    wrap : float or None
        Readings begin again at zero after so many, in the column's own numbers; they are continued before all else.
    """

    variable: str
    unit: str
    k_m: float | None = None
    zero: float = 0.0
    gain: float = 1.0
    offset: float = 0.0
    sign: int = 1
    wrap: float | None = None
    late: float = 0.0
    clock: float = 1.0

    @property
    def dimension(self):
        """SI unit of the column after conversion."""
        return "N.m" if self.k_m is not None else known_unit(self.unit)[0]

    def timely(self, time, values):
        """Readings at the times of their rows, for a column that comes late or has a clock of its own.

        Parameters
        ----------
        time, values : ndarray, shape (n,)
            [s], and any unit.

        Returns
        -------
        ndarray, shape (n,)
            Straight between readings; at the ends the last one is kept.
        """
        if self.late == 0.0 and self.clock == 1.0:
            return values
        return np.interp(time + self.late + (self.clock - 1.0) * (time - time[0]), time, values)

    def si(self, values):
        """Readings to SI: ``sign (gain (reading - zero) + offset)`` in the unit, converted; a current made a torque.

        Parameters
        ----------
        values : ndarray, shape (n,)
            As they stand in the file.

        Returns
        -------
        ndarray, shape (n,)
        """
        if self.wrap is not None:
            values = np.unwrap(values, period=self.wrap)
        factor = self.sign * known_unit(self.unit)[1] * (1.0 if self.k_m is None else self.k_m)
        if self.gain == 1.0 and self.offset == 0.0:  # no rounding that nobody asked for
            return (values - self.zero) * factor
        return (self.gain * (values - self.zero) + self.offset) * factor


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
        By name in the rig, as ``s1A.f0``; those that are not named keep the rig's value and are not fitted.
    runs, held_out : list of Path
        Logs to fit, and logs kept for the test; no file is in both.
    reference : str
        ``sensor``, ``gravity_model`` or ``unknown``: where the joint torques come from.
    columns : dict of str to Column
        By the column's name in the file.
    labels, time_column : str
        Columns of the optional labels and of the time; "" says that no column is the time, and `rate` holds whatever
        the columns are called.
    effects : list of (str, str)
        Effect and place.
    w_min : float or None
        Speed [rad/s] above which a sample is moving; None finds it from the data.
    seed : int
        Of everything drawn by chance; the same study and logs give the same answer.
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
    rate : float or None
        Rows a second [Hz] of logs without a column of time.
    time : (float, float) or None
        Only rows from the first to the last of these times [s] are used, of every log.
    leave_out : list of list
        ``[first, last]`` [s], of every log, or ``[file, first, last]``: samples that nothing is compared at. What moves
        there still moves the model.
    header : bool
        Whether a row of a text file names its columns; else they are called "1", "2", ...
    separator, decimal, encoding : str
        Of a text file: between columns (a blank is any number of blanks and tabs), before the fraction of a number, and
        of its letters.
    preamble : int
        Lines of a text file above its header, or above the first row of numbers.
    units_row : bool
        Whether the row of a text file below its header holds units.
    accept : list of str
        Findings of the data check that are answered.
    rejected : list of str
        Candidates that the user has ruled out, ``effect@place`` or ``effect`` for all its places.
    robust : bool
        Samples that are far out count less in every fit (Huber).
    own : list of str
        Parameters that have a value of their own in each run: a parameter of the rig, as ``zero_H``, or a coefficient
        of an effect, as ``payload@shank.m``.
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
    rate: float | None = None
    time: tuple | None = None
    leave_out: list = field(default_factory=list)
    header: bool = True
    separator: str = ","
    decimal: str = "."
    encoding: str = "utf-8"
    preamble: int = 0
    units_row: bool = False
    accept: list = field(default_factory=list)
    rejected: list = field(default_factory=list)
    robust: bool = False
    own: list = field(default_factory=list)

    @property
    def name(self):
        """Name of the study: its file's without the ending."""
        return self.path.stem

    @property
    def layout(self):
        """How its text files hold their tables."""
        return Layout(*(getattr(self, key) for key in LAYOUT_KEYS))

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

    def rules_out(self, effect, place):
        """Whether the user has ruled a candidate out.

        Parameters
        ----------
        effect, place : str
            As ``stribeck`` and ``2A``.

        Returns
        -------
        bool
        """
        return effect in self.rejected or f"{effect}@{place}" in self.rejected

    def left_out(self, name, time):
        """Samples of a log that the study leaves out.

        Parameters
        ----------
        name : str
            Of the log's file.
        time : ndarray, shape (n,)
            [s]

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        found = np.zeros(len(time), dtype=bool)
        for *file, first, last in self.leave_out:
            if file in ([], [name]):
                found |= (time >= first) & (time <= last)
        return found

    def own_parameters(self, library):
        """Parameters that have a value of their own in each run.

        Parameters
        ----------
        library : Library
            Where the effects and their places are looked up.

        Returns
        -------
        list of str
            Names as a model has them; those of effects that may not be attached yet included.

        Raises
        ------
        UnknownNameError
            No such effect, place or coefficient.
        """
        found = []
        for text in self.own:
            effect, at, rest = text.partition("@")
            if not at:
                found.append(text)
                continue
            place, _, coefficient = rest.rpartition(".")
            effect = find_effect(library, effect)
            known = (*effect.size, *effect.scan)
            if coefficient not in known or not place:
                raise UnknownNameError(f"own: '{text}' names no coefficient of {effect.id}; write {effect.id}@PLACE."
                                       f"{known[0]}{closest(coefficient, known)}")
            found.append(f"{component_name(effect, find_place(library, self.rig, effect, place))}.{coefficient}")
        return found

    def own_values(self, library):
        """What has a value of its own in each run for another reason than where an encoder began to count.

        Parameters
        ----------
        library : Library
            Where the effects are looked up.

        Returns
        -------
        list of str
            Of `own`, without phases of ripples.
        """
        def turns(text):
            effect, at, rest = text.partition("@")
            return at and rest.rpartition(".")[2] in find_effect(library, effect).phases
        return [text for text in self.own if not turns(text)]

    def refuse_own(self, verb, library=None):
        """Refuse what does not know that a parameter may differ from run to run.

        Parameters
        ----------
        verb : str
            What was asked for.
        library : Library, optional
            Where effects are looked up for a verb that knows phases of ripples, if nothing else of that kind.

        Raises
        ------
        StudyError
            The study has such parameters.
        """
        names = self.own if library is None else self.own_values(library)
        if names:
            raise StudyError(f"{self.path}: '{verb}' does not take into account that {names[0]} has a value of its "
                             "own in each run; compare, identify and add do: use these, or take [fit] own out")

    def refuse_absent_own(self):
        """Refuse a coefficient of its own in each run, of an effect that the study does not have.

        Raises
        ------
        StudyError
            `own` names one, which would change nothing.
        """
        for text in self.own:
            effect, at, rest = text.partition("@")
            place = rest.rpartition(".")[0]
            if at and (effect, place) not in self.effects:
                raise StudyError(f"{self.path}: [fit] own: '{text}' is of an effect that the study does not have; add "
                                 f"[[effects]] effect = {to_toml(effect)}, place = {to_toml(place)}, or take it out of "
                                 f"own ('pycosim add {self.path.name} {effect}@{place}' fits the effect beside what is "
                                 "there)")

    def validate(self, library):
        """Check every name, bound and unit against the Modelica library.

        Parameters
        ----------
        library : Library
            With the study's own Modelica files, where it has any.

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
            The rig, or an effect's file, cannot be compiled.
        """
        try:
            library.find(self.rig)
            for effect, place in self.effects:
                find_place(library, self.rig, find_effect(library, effect), place)
            for text in self.rejected:
                effect, at, place = text.partition("@")
                effect = find_effect(library, effect)
                if at:
                    find_place(library, self.rig, effect, place)
            owned = self.own_parameters(library)
        except PycosimError as error:
            raise type(error)(f"{self.path}: {error}") from None
        model = compile_model(library, self.rig, self.effects)
        for name, setting in self.parameters.items():
            check_parameter(self, name, setting, model.parameters)
        for text, name in zip(self.own, owned):
            if "@" not in text and name not in model.parameters:
                raise UnknownNameError(f"{self.path}: [fit] own: no parameter '{name}' in {self.rig}"
                                       f"{closest(name, model.parameters)}")
        read = {n: unit for effect in catalogue(library).values() for n, unit in effect.measured.items()}
        known = {**read, **LOG_VARIABLES, **{n: v.unit for n, v in model.variables.items()}}
        for name, column in self.columns.items():
            check_column(self, name, column, known)
        for name in self.limits:
            check_limit(self, name, known)
        return model


def check_parameter(study, name, setting, known):
    """Check what a study says of a parameter against its rig.

    Parameters
    ----------
    study : Study
        Named in what is refused.
    name : str
        In the study.
    setting : Setting
        Value and bounds in SI; what is None is the rig's.
    known : dict of str to Variable
        Parameters of the rig.

    Raises
    ------
    UnknownNameError
        With the closest name that there is.
    BoundsError
        Its value, or the rig's default, is outside the bounds, or they leave nothing to fit.
    """
    if name not in known:
        raise UnknownNameError(f"{study.path}: no parameter '{name}' in {study.rig}{closest(name, known)}")
    parameter = known[name]
    wanted = setting.applied(parameter)
    value, low, high = wanted.value, wanted.min, wanted.max
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    if low > high:
        raise BoundsError(f"{study.path}: '{name}' is bounded by {low:g} and {high:g}{unit}, one of them "
                          "the rig's, and nothing lies between; give both min and max")
    if setting.value is not None and not low <= value <= high:
        raise BoundsError(f"{study.path}: value {value:g}{unit} of '{name}' is outside the bounds of "
                          f"the rig, {low:g} to {high:g}{unit}; for a larger machine give a min and max of its own")
    if not low <= value <= high:
        raise BoundsError(f"{study.path}: '{name}' has the rig's default {value:g}{unit}, outside the "
                          f"study's bounds {low:g} to {high:g}{unit}; give a value within them")
    if setting.fixed is False and low == high:
        raise BoundsError(f"{study.path}: '{name}' is to be fitted, but its bounds leave {value:g}{unit} "
                          "alone; write fixed = true, or wider bounds")


def check_column(study, name, column, known):
    """Check what a study says of a column against its rig.

    Parameters
    ----------
    study : Study
        Named in what is refused.
    name : str
        Of the column in the file.
    column : Column
        Its variable and unit are checked.
    known : dict of str to str
        Unit of every variable that a log can hold.

    Raises
    ------
    UnknownNameError
        No such variable, or a unit that does not fit it.
    StudyError
        It has a torque constant, and its variable is no torque.
    """
    where = f"{study.path}: column '{name}'"
    if column.variable not in known:
        raise UnknownNameError(
            f"{where}: no variable '{column.variable}' in {study.rig}{closest(column.variable, known)}")
    expected = known[column.variable]
    if column.k_m is None and expected == "N.m" and known_unit(column.unit)[0] == "A":
        line = to_toml({name: {"variable": column.variable, "unit": column.unit, "k_m": 0.1}})[2:-2]
        raise UnknownNameError(f"{where}: unit '{column.unit}' is of a current, and '{column.variable}' is a torque; "
                               f"add the motor's constant k_m in N.m/A, as {line}")
    if column.k_m is None:
        units.to_si(column.unit, expected, where)
    elif expected != "N.m":
        raise StudyError(f"{where}: k_m makes a current a torque, but '{column.variable}' is in {expected}; remove k_m")


def check_limit(study, name, known):
    """Check what a limit is of against the rig.

    Parameters
    ----------
    study : Study
        Named in what is refused.
    name : str
        A variable, or a sum of angles with factors, as ``0.5 * motor1.phi - q_K``.
    known : dict of str to str
        Unit of every variable that a log can hold.

    Raises
    ------
    UnknownNameError
        It names what the rig does not have.
    """
    rates = {f"{n[:-3]}{rate}" for n in known if n.endswith(".phi") for rate in ("w", "a")}
    for _, variable in limit_terms(name):
        if variable not in known and variable not in rates:
            raise UnknownNameError(f"{study.path}: [limits] '{name}': no variable '{variable}' in {study.rig}"
                                   f"{closest(variable, [*known, *sorted(rates)])}")


def limit_terms(name):
    """Variables that a limit adds up.

    Parameters
    ----------
    name : str
        Of the limit, as ``0.5 * motor1.phi - q_K``.

    Returns
    -------
    list of (float, str)
        Factor and variable.

    Examples
    --------
    >>> limit_terms("0.5 * motor1.phi - q_K")
    [(0.5, 'motor1.phi'), (-1.0, 'q_K')]
    """
    terms = re.findall(r"([+-]?)\s*(?:((?:\d+\.?\d*|\.\d+)(?:[eE]\d+)?)\s*\*\s*)?([^\s+*-][^+*-]*)", name)
    return [((-1.0 if sign == "-" else 1.0) * float(factor or 1.0), variable.strip())
            for sign, factor, variable in terms]


def known_unit(unit):
    """Dimension and factor to SI of a unit.

    Parameters
    ----------
    unit : str
        As a study writes it, as ``Nm`` or ``deg``.

    Returns
    -------
    (str, float) or None
        None where the unit is unknown.

    Examples
    --------
    >>> known_unit("Nm")
    ('N.m', 1.0)
    """
    return units.UNITS.get(units.SPELLINGS.get(unit, unit))


def refuse_twice(paths, where):
    """Refuse a log that is listed twice.

    Parameters
    ----------
    paths : list of Path
        Compared as they are written.
    where : str
        Said in the message.

    Raises
    ------
    StudyError
        One of them is.
    """
    for path in paths:
        if paths.count(path) > 1:
            raise StudyError(f"{where}: {path} is listed twice; a log counted twice makes the intervals too narrow")

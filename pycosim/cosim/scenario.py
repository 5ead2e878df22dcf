"""A scenario file (TOML) comes in; checked components, connections and log of a co-simulation go out."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

from ..core.errors import ScenarioError, closest, closest_file
from ..study.parse import Source
from ..study.toml import to_toml

METHODS = ("gauss-seidel", "jacobi")
KINDS = {  # key that says what a component is: keys that go with it
    "fmu": ("inputs", "parameters", "start"),
    "plant": ("inputs", "parameters", "start", "run", "fmi", "step"),
    "controller": ("machine", "inputs", "parameters", "options", "run", "fmi"),
    "python": ("inputs", "parameters"),
    "trajectory": ("machine", "options"),
    "motion": ("machine",),
}
_TOP = ("duration", "method", "seed", "components", "connections", "log")
_LOG = ("rate", "columns")
_COLUMN = ("signal", "quantum", "noise")
LONGEST_CYCLE = 10 ** 7  # ticks a second


@dataclass(frozen=True)
class Component:
    """One participant of a co-simulation.

    Attributes
    ----------
    name : str
        In the scenario; the first part of its variables' names there.
    kind : str
        ``fmu``, ``plant``, ``controller``, ``python``, ``trajectory``, ``motion``.
    what : str
        File, rig, name or import path, as the kind has it.
    rate : Fraction
        Communications a second.
    machine : str or None
        Study or rig that a controller or a trajectory knows.
    inputs : dict of str to float
        Values of inputs that nothing is connected to.
    parameters, start : dict of str to float
        Instead of its own, in SI: parameters, and states at time zero.
    options : dict
        Of a controller's or a trajectory's own.
    run : str
        ``fmu`` or ``process``.
    fmi : int
        2 or 3: version that a plant or a controller is exported with.
    step : float
        Longest integration step of a plant [s].
    """

    name: str
    kind: str
    what: str
    rate: Fraction
    machine: str | None = None
    inputs: dict = field(default_factory=dict)
    parameters: dict = field(default_factory=dict)
    start: dict = field(default_factory=dict)
    options: dict = field(default_factory=dict)
    run: str = "process"
    fmi: int = 2
    step: float = 1e-3


@dataclass(frozen=True)
class Column:
    """One column of the log.

    Attributes
    ----------
    signal : tuple of (str, str)
        Component and variable.
    quantum : float
        Resolution of the sensor, zero for none.
    noise : float
        Standard deviation of white noise.
    """

    signal: tuple
    quantum: float = 0.0
    noise: float = 0.0


@dataclass(frozen=True)
class Scenario:
    """A co-simulation, as a file describes it.

    Attributes
    ----------
    path : Path
        Its file; paths in it are relative to that.
    text : str
        The file as it was read.
    duration : float or None
        [s]; None is as long as the trajectories last.
    method : str
        ``gauss-seidel`` or ``jacobi``.
    seed : int
        Of the noise in the log.
    components : list of Component
        In the order in which they exchange values.
    connections : list of tuple
        ``(component, variable, component, variable)``; variables None where all of equal name are connected.
    log_rate : Fraction
        Rows a second of the log [Hz].
    columns : dict of str to Column
        Of the log: the signal, and the noise and steps of its sensor.
    """

    path: Path
    text: str
    duration: float | None
    method: str
    seed: int
    components: list
    connections: list
    log_rate: Fraction
    columns: dict

    @property
    def name(self):
        """Name of the scenario: its file's without the ending."""
        return self.path.stem

    def beside(self, name):
        """A path given in the scenario, relative to its file.

        Parameters
        ----------
        name : str
            As in the scenario; an absolute path stays.

        Returns
        -------
        Path
        """
        return self.path.parent / name


class _File(Source):
    """A scenario's text; its messages name file and line."""

    def __init__(self, path):
        if not Path(path).is_file():
            near = closest_file(Path(path).absolute(), (".toml",))
            raise ScenarioError(f"no scenario {path}{near}; examples/cosim has some to start from")
        super().__init__(path)

    def error(self, where, message, key="", kind=ScenarioError):
        """An error of a scenario."""
        return super().error(where, message, key, kind)


def load_scenario(path):
    """Read a scenario.

    Parameters
    ----------
    path : path
        TOML file.

    Returns
    -------
    Scenario

    Raises
    ------
    ScenarioError
        The file is missing or broken, has unknown or mistyped keys, or names components that it does not have.
    """
    source = _File(path)
    tables = source.tables
    source.keys(tables, _TOP, "")
    given = source.take(tables, "components", dict, "", {})
    if not given:
        raise source.error("", "no [components.NAME]; a co-simulation needs a plant at least")
    components = [_component(source, name, table) for name, table in given.items()]
    duration = source.take(tables, "duration", float, "")
    if duration is not None and not 0 < duration <= 1e6:
        raise source.error("", f"duration = {duration:g} s must be above zero, and not above 1e6", "duration")
    connections = [_connection(source, text, given) for text in source.take(tables, "connections", list, "", [])]
    rate, columns = _log(source, source.take(tables, "log", dict, "", {}), given)
    _check_rates(source, [*((c.name, c.rate) for c in components), ("log", rate)])
    return Scenario(source.path, source.text, duration, source.choice(tables, "method", METHODS, "", METHODS[0]),
                    source.take(tables, "seed", int, "", 0), components, connections, rate, columns)


def _component(source, name, table):
    where = f"[components.{name}]"
    if not isinstance(table, dict) or not re.fullmatch(r"\w+", name):
        raise source.error(where, "a component is a table with a name of letters, digits and underscores", name)
    found = [k for k in KINDS if k in table]
    if len(found) != 1:
        unknown = [k for k in table if k not in {"rate", *KINDS, *(k for keys in KINDS.values() for k in keys)}]
        near = f"unknown key '{unknown[0]}'{closest(unknown[0], KINDS)}; " if unknown else ""
        raise source.error(where, f"{near}it needs exactly one of {', '.join(KINDS)}, which say what it is", name)
    kind = found[0]
    source.keys(table, (kind, "rate", *KINDS[kind]), where)
    what = source.take(table, kind, str, where)
    run = source.choice(table, "run", ("fmu", "process"), where, "fmu" if kind in ("plant", "fmu") else "process")
    fmi = source.take(table, "fmi", int, where, 2)
    if fmi not in (2, 3):
        raise source.error(where, f"fmi = {fmi}; there are 2 and 3", "fmi")
    step = source.take(table, "step", float, where, 1e-3)
    if not 1e-6 <= step <= 0.1:
        raise source.error(where, f"step = {step:g} s is outside 1e-6 to 0.1 s", "step")
    machine = source.take(table, "machine", str, where)
    if machine is None and "machine" in KINDS[kind]:
        raise source.error(where, 'machine is missing; name the study or the rig it knows: machine = "machine.toml"',
                           name)
    return Component(name, kind, what, _rate(source, table, where, name), machine,
                     *(_numbers(source, table, key, where) for key in ("inputs", "parameters", "start")),
                     source.take(table, "options", dict, where, {}), run, fmi, step)


def _rate(source, table, where, line):
    rate = source.take(table, "rate", float, where)
    if rate is None:
        raise source.error(where, "rate is missing; give communications a second [Hz], as rate = 1000", line)
    if not 1e-3 <= rate <= 1e6:
        raise source.error(where, f"rate = {rate:g} Hz is outside 0.001 to 1e6 Hz", line)
    return Fraction(repr(rate)).limit_denominator(10 ** 6)


def _numbers(source, table, key, where):
    found = source.take(table, key, dict, where, {})
    for name, value in found.items():
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise source.error(f"{where} {key}", f"'{name}' must be a finite number, not {to_toml(value)}", name)
    return {n: float(v) for n, v in found.items()}


def _connection(source, text, components):
    where = "connections"
    parts = [p.strip() for p in text.split("->")] if isinstance(text, str) else []
    if len(parts) != 2 or not all(parts):
        raise source.error(where, f'{to_toml(text)} is not of the form "plant.motor1.phi -> controller.motor1.phi"',
                           "connections")
    ends = [_signal(source, p, components, where, alone=True) for p in parts]
    if (ends[0][1] is None) != (ends[1][1] is None):
        raise source.error(where, f"'{text}' names a variable at one end only; name it at both, or at neither to "
                           "connect all of equal name", "connections")
    return *ends[0], *ends[1]


def _signal(source, text, components, where, alone=False):
    """Component and variable of ``component.variable``."""
    component, dot, variable = text.partition(".")
    if component not in components:
        raise source.error(where, f"no component '{component}' in '{text}'{closest(component, components)}")
    if not variable and (dot or not alone):
        raise source.error(where, f"'{text}' names no variable of '{component}'")
    return component, variable or None


def _log(source, table, components):
    source.keys(table, _LOG, "[log]")
    columns = source.take(table, "columns", dict, "[log]", {})
    if not columns:
        raise source.error("[log]", 'no columns; say what to log: [log.columns] theta1 = "plant.motor1.phi"')
    return _rate(source, table, "[log]", "log"), {n: _column(source, n, c, components) for n, c in columns.items()}


def _column(source, name, given, components):
    where = f"[log.columns] {name}"
    if name == "time":
        raise source.error(where, "the time is always logged; remove it", name)
    if isinstance(given, str):
        given = {"signal": given}
    if not isinstance(given, dict):
        raise source.error(where, 'must be "plant.motor1.phi", or a table with signal = ".."', name)
    source.keys(given, _COLUMN, where, name)
    signal = source.take(given, "signal", str, where, None, name)
    if not signal:
        raise source.error(where, 'signal is missing; write signal = "plant.motor1.phi"', name)
    sizes = [source.take(given, key, float, where, 0.0, name) for key in ("quantum", "noise")]
    for key, size in zip(("quantum", "noise"), sizes):
        if size < 0:
            raise source.error(where, f"{key} = {size:g} must not be below zero", name)
    return Column(_signal(source, signal, components, where), *sizes)


def _check_rates(source, rates):
    ticks = cycle([r for _, r in rates])
    if ticks > LONGEST_CYCLE:
        text = ", ".join(f"{n} {float(r):g} Hz" for n, r in rates)
        raise source.error("", f"the rates ({text}) have no common clock below {LONGEST_CYCLE:g} Hz; choose rates that "
                           "are multiples of one another")


def cycle(rates):
    """Ticks a second of the slowest clock that has a tick for every sample of all rates.

    Parameters
    ----------
    rates : iterable of Fraction
        [1/s]

    Returns
    -------
    Fraction
    """
    return Fraction(math.lcm(*(r.numerator for r in rates)), math.gcd(*(r.denominator for r in rates)))

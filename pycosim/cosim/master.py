"""A scenario in; its components stepped together at their own rates, a log of what they did, out.

The order of events at a communication instant is fixed:

1. Every component that is due hands on what it has become since its last step.
2. Every component that is due takes its inputs and answers. With ``gauss-seidel``, one after the other in the order of
   the file, each answer known to the next at once. With ``jacobi``, all from the values of before, so that the order
   does not matter and every answer arrives one instant later.
3. The log takes its row.
4. Every component that is due goes on for one period of its own, inputs held.

Between its own instants a component sees nothing, and others see of it what it last handed on (sample and hold).
"""

from __future__ import annotations

import base64
import ctypes
import hashlib
import importlib.util
import io
import json
import math
import os
import pickle
import shutil
import signal
import sys
import tempfile
import threading
import time as clock
import zipfile
import zlib
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd

from ..core import cache
from ..control import controllers, trajectories
from ..compile import ArrayFunction, Library, compile_model
from ..core.errors import CosimulationError, PycosimError, ScenarioError, UnknownNameError, closest
from ..export.controller import export_block
from ..export.description import STEP, values
from ..export.fmu import export_fmu
from .scenario import Scenario, cycle, load_scenario
from ..dynamics.simulate import dynamics
from ..study.schema import Study, load_study

__all__ = ["Cosimulation", "cosimulate"]

_FORMAT = 1  # of a checkpoint


@dataclass
class Cosimulation:
    """What came of a scenario.

    Attributes
    ----------
    log : pandas.DataFrame
        ``time`` and the columns of the scenario, as they stand in the file.
    text : str
        The log as CSV.
    time : float
        Simulated up to here [s].
    complete : bool
        False when it was stopped on the way.
    checkpoint : bytes or None
        To go on from; None when it is complete.
    description : dict
        Components, rates, order, connections, and the range of every column.
    """

    log: pd.DataFrame
    text: str
    time: float
    complete: bool
    checkpoint: bytes | None
    description: dict


def cosimulate(scenario, until=None, resume=None, progress=None, library=None, stop=None, save=None, every=60.0):
    """Step the components of a scenario together.

    Parameters
    ----------
    scenario : Scenario or path
    until : float, optional
        Stop at this time [s], with a checkpoint.
    resume : bytes, optional
        Checkpoint to go on from; the log that comes out is the same, bit for bit, as without the stop.
    progress : callable, optional
        Called with a sentence now and then.
    library : Library, optional
    stop : callable, optional
        Called at every instant; true ends the run there, as Ctrl-C does.
    save : callable, optional
        Called with a checkpoint on the way, for what ends a run without asking.
    every : float
        Seconds, by the clock on the wall, from one such checkpoint to the next.

    Returns
    -------
    Cosimulation

    Raises
    ------
    ScenarioError
        The scenario contradicts itself, or the checkpoint is not its own.
    CosimulationError
        A component cannot be loaded, or fails on the way.
    UnknownNameError
        A variable, parameter, option or machine that does not exist.
    """
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario)
    with ExitStack() as stack:
        master = _Master(scenario, library or Library(), stack, progress or (lambda text: None))
        if resume is not None:
            master.restore(resume)
        return master.run(until, stop or (lambda: False), _saving(save, every))


def _saving(save, every):
    """``(master)``: hands a checkpoint on when it is time to."""
    last = clock.monotonic()

    def check(master):
        nonlocal last
        if save is not None and clock.monotonic() - last >= every:
            save(master.checkpoint())
            last = clock.monotonic()
    return check


# --- components ------------------------------------------------------------------------------------------------------


class _Participant:
    """What the master asks of a component.

    ``known`` can be read, ``inputs`` can be set; ``prepare`` is told which of them will be.
    """

    kind = ""
    inputs = ()
    known = ()
    labels = {}
    units = {}
    length = None  # of a motion that ends by itself [s]

    def prepare(self, inputs, outputs):
        """Fix which inputs are set and which variables are read, by name."""

    def read(self):
        """Values read, after a step; None where nothing changes between instants."""
        return None

    def exchange(self, t, u):
        """Take inputs, return the values read."""
        raise NotImplementedError

    def advance(self, t, h):
        """Go on from t for h, inputs held."""

    def save(self):
        """Everything to go on from, as bytes."""
        return b""

    def load(self, data):
        """Undo everything since `save`."""


class _Buffered:
    """A CasADi function on fixed arrays, called without conversion."""

    def __init__(self, function):
        self.arguments = [np.zeros(function.nnz_in(k)) for k in range(function.n_in())]
        self.results = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        self.buffer, self.run = function.buffer()
        for k, a in enumerate(self.arguments):
            self.buffer.set_arg(k, memoryview(a))
        for k, r in enumerate(self.results):
            self.buffer.set_res(k, memoryview(r))

    def __call__(self, *values):
        for a, v in zip(self.arguments, values):
            a[:] = v
        self.run()
        return self.results


class _InProcess(_Participant):
    """State in arrays of numbers; saved as they are."""

    state = ()

    def save(self):
        return b"".join(a.tobytes() for a in self.state)

    def load(self, data):
        for a in self.state:
            a[:] = np.frombuffer(data[:a.nbytes])
            data = data[a.nbytes:]


class _Plant(_InProcess):
    """A machine stepped in this process, by the function that its FMU takes along."""

    kind = "machine, in process"

    def __init__(self, c, study, model):
        self.d, self.model, self.longest = dynamics(model), model, c.step
        d, given = self.d, values(study, model)
        _known(c.parameters, given, f"parameter of {model.rig}")
        _known(c.start, d.start, f"state of {model.rig}")
        given.update(c.parameters)
        self.p = np.array([given[n] for n in d.parameters])
        self.q = np.array(d.prepare(self.p)).ravel()
        sizes = len(d.states), len(d.algebraic), len(d.algebraic), len(d.inputs), 1, 1
        # as in the FMU: z starts the next step, now fits what is read, and fresh says that it does
        self.x, self.z, self.now, self.u, self.time, self.fresh = map(np.zeros, sizes)
        for n, value in c.start.items():
            self.x[d.states.index(d.start[n])] = value
        self.state = self.x, self.z, self.now, self.u, self.time, self.fresh
        self.inputs, self.known = d.inputs, [*d.states, *d.outputs, *d.inputs]
        self.units = {n: v.unit for n, v in model.variables.items()}
        self.step, self.initial = _Buffered(d.step), _Buffered(d.initial)

    def prepare(self, inputs, outputs):
        import casadi as ca
        d = self.d
        self.at = [d.inputs.index(n) for n in inputs]
        a = [ca.SX.sym(n, d.output.size1_in(k)) for k, n in enumerate("xzupt")]
        where = {n: (a[0], k) for k, n in enumerate(d.states)} | {n: (a[2], k) for k, n in enumerate(d.inputs)}
        y = d.output(*a)
        where |= {n: (y, k) for k, n in enumerate(d.outputs)}
        rows = [where[n][0][where[n][1]] for n in outputs]
        self.observe = _Buffered(ca.Function("observe", a, [ca.densify(ca.cse(ca.vertcat(*rows, ca.SX(0, 1))))]))
        self._solve()
        self.z[:] = self.now

    def _solve(self):
        """Algebraic variables that fit states and inputs."""
        if self.fresh[0]:
            return
        self.now[:] = self.initial(self.x, self.z, self.u, self.q, self.time)[0]
        if not np.isfinite(self.now).all():
            raise CosimulationError(f"the loads have no solution at t = {self.time[0]:g} s; check that every joint has "
                                    "inertia")
        self.fresh[0] = 1

    def read(self):
        self._solve()
        return self.observe(self.x, self.now, self.u, self.p, self.time)[0]

    def exchange(self, t, u):
        if (self.u[self.at] != u).any():
            self.u[self.at], self.fresh[0] = u, 0
        return self.read()

    def advance(self, t, h):
        count = max(1, math.ceil(h / self.longest - 1e-6))
        part = h / count
        for k in range(count):
            x, z, *error = self.step(self.x, self.z, self.u, self.u, self.q, t + k * part, part)
            if not np.isfinite(x).all() or (error and not error[0][0] <= 1):
                raise CosimulationError(f"no solution for the step from t = {t + k * part:g} s; check that every joint "
                                        f"has inertia, and take a step below {self.longest:g} s")
            self.x[:], self.z[:] = x, z
        self.now[:], self.time[0], self.fresh[0] = self.z, t + h, 1


class _Controller(_InProcess):
    """An included controller, in process."""

    kind = "controller, in process"

    def __init__(self, c, block):
        self.block, self.inputs = block, [v.name for v in block.inputs]
        self.known = [v.name for v in (*block.outputs, *block.inputs, *block.states)]
        self.units = {v.name: v.unit for v in (*block.outputs, *block.inputs, *block.states)}
        given = {v.name: v.value for v in block.parameters}
        _known(c.parameters, given, f"parameter of the controller {block.name}")
        _bounds(c.parameters, block.parameters)
        given.update(c.parameters)
        self.p = np.array(list(given.values()))
        self.x, self.u = np.array([v.value for v in block.states]), np.array([v.value for v in block.inputs])
        self.state = self.x, self.u
        self.output, self.update = _Buffered(block.output), _Buffered(block.update)

    def prepare(self, inputs, outputs):
        self.at = [self.inputs.index(n) for n in inputs]
        self.wanted = [self.known.index(n) for n in outputs]

    def read(self):
        y = self.output(self.x, self.u, self.p)[0]
        return np.concatenate([y, self.u, self.x])[self.wanted]

    def exchange(self, t, u):
        self.u[self.at] = u
        return self.read()

    def advance(self, t, h):
        self.x[:] = self.update(self.x, self.u, self.p)[0]


class _Motion(_Participant):
    """A trajectory: a table that answers with its row."""

    kind = "trajectory"

    def __init__(self, c, motion, model):
        self.rate, self.motion = float(c.rate), motion
        flat = model.variables
        self.units = {n: flat[n.removeprefix("ref.")].unit for n in motion.columns if n.removeprefix("ref.") in flat}
        self.known = [*motion.columns, "label"]
        self.labels = {"label": motion.labels}
        self.length = motion.time[-1]

    def prepare(self, inputs, outputs):
        columns = {**self.motion.columns, "label": self.motion.label.astype(float)}
        self.rows = np.array([columns[n] for n in outputs]).T.reshape(len(self.motion.time), len(outputs))

    def exchange(self, t, u):
        return self.rows[min(round(t * self.rate), len(self.rows) - 1)]


class _Python(_Participant):
    """A controller of the user: a class with ``inputs``, ``outputs`` and ``step(time, inputs) -> outputs``."""

    kind = "Python class"

    def __init__(self, c, scenario):
        self.what = c.what
        made = _import(c.what, scenario.path.parent)
        try:
            self.object = made(period=float(1 / c.rate), **c.parameters)
            self.inputs, self.known = list(self.object.inputs), list(self.object.outputs)
        except Exception as error:
            raise CosimulationError(f"'{c.what}' cannot be made: {type(error).__name__}: {error}; it takes the period "
                                    "and its parameters by name, and has the lists inputs and outputs") from None

    def prepare(self, inputs, outputs):
        self.given, self.wanted = list(inputs), list(outputs)

    def exchange(self, t, u):
        try:
            y = self.object.step(t, dict(zip(self.given, map(float, u))))
            return np.array([float(y[n]) for n in self.wanted])
        except Exception as error:
            raise CosimulationError(f"'{self.what}' failed at t = {t:g} s: {type(error).__name__}: {error}") from None

    def save(self):
        try:
            return pickle.dumps(self.object.__dict__)
        except Exception as error:
            raise CosimulationError(f"'{self.what}' cannot be saved for a checkpoint: {error}; keep what cannot be "
                                    "pickled out of its attributes") from None

    def load(self, data):
        self.object.__dict__.clear()
        self.object.__dict__.update(pickle.loads(data))


def _import(what, folder):
    """A class by ``module:Class``, looked for beside the scenario first."""
    module, _, name = what.partition(":")
    if not module or not name:
        raise CosimulationError(f"'{what}' is not of the form \"module:Class\"")
    sys.path.insert(0, str(folder))
    try:
        found = _module(module, folder)
    except Exception as error:
        raise CosimulationError(f"'{module}' cannot be imported: {type(error).__name__}: {error}") from None
    finally:
        sys.path.remove(str(folder))
    if not hasattr(found, name):
        known = [n for n in vars(found) if n[0] != "_"]
        raise CosimulationError(f"'{module}' has no class '{name}'{closest(name, known)}")
    return getattr(found, name)


def _module(module, folder):
    """A module of the scenario's folder, under a name of its own: another scenario may have one of the same name."""
    path = folder.joinpath(*module.split(".")).with_suffix(".py")
    if not path.is_file():
        return importlib.import_module(module)
    name = f"scenario_{hashlib.sha256(str(path).encode()).hexdigest()[:12]}_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    sys.modules[name] = found = importlib.util.module_from_spec(spec)  # pickle looks classes up there
    spec.loader.exec_module(found)
    return found


class _Fmu(_Participant):
    """An FMU of version 2 or 3, through fmpy."""

    def __init__(self, c, path, stack):
        import fmpy
        from fmpy.simulation import instantiate_fmu
        self.path, self.messages = path, []
        folder = tempfile.mkdtemp(prefix="pycosim-fmu-")
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        try:
            self.description = fmpy.read_model_description(str(path))
            fmpy.extract(str(path), folder)
            if self.description.coSimulation is None or self.description.fmiVersion[0] not in "23":
                raise CosimulationError(f"{path}: is no FMU for co-simulation of FMI 2 or 3")
            self.slave = instantiate_fmu(folder, self.description, "CoSimulation",
                                         logger=lambda *a: self.messages.append(a[-1].decode(errors="replace")))
        except CosimulationError:
            raise
        except Exception as error:  # fmpy raises bare exceptions
            raise CosimulationError(f"{path}: cannot be loaded as an FMU ({error})") from None
        stack.callback(self._close)
        self.two = self.description.fmiVersion.startswith("2")
        self.kind = f"FMU, FMI {self.description.fmiVersion}"
        real = ("Real", "Float64")
        self.number = {v.name: v.valueReference for v in self.description.modelVariables if v.type in real}
        self.inputs = [v.name for v in self.description.modelVariables if v.causality == "input" and v.type in real]
        self.known = list(self.number)
        self.units = {v.name: v.unit or "1" for v in self.description.modelVariables}
        self._initialize(c)

    def _initialize(self, c):
        _known({**c.parameters, **c.start}, self.number, f"variable of {self.path.name}")
        slave = self.slave
        if self.two:
            self._call("the set-up", slave.setupExperiment, startTime=0.0)
        given = {**c.parameters, **c.start}
        if given:
            self._call("its parameters", slave.setReal if self.two else slave.setFloat64,
                       [self.number[n] for n in given], list(given.values()))
        if self.two:
            self._call("the initialization", slave.enterInitializationMode)
        else:
            self._call("the initialization", slave.enterInitializationMode, startTime=0.0)
        self._call("the initialization", slave.exitInitializationMode)

    def _call(self, what, function, *arguments, **options):
        try:
            return function(*arguments, **options)
        except Exception as error:
            said = self.messages[-1] if self.messages else str(error)
            raise CosimulationError(f"{self.path.name} refused {what}: {said}") from None

    def _close(self):
        try:
            self.slave.terminate()
        except Exception:
            pass  # an instance that failed cannot be terminated, but is freed all the same
        self.slave.freeInstance()

    def prepare(self, inputs, outputs):
        self.given, self.wanted = (((ctypes.c_uint32 * len(names))(*[self.number[n] for n in names]), len(names),
                                    (ctypes.c_double * len(names))()) for names in (inputs, outputs))
        self.view = [np.frombuffer(group[2]) if group[1] else np.zeros(0) for group in (self.given, self.wanted)]

    def _move(self, setting, group):
        numbers, n, buffer = group
        if not n:
            return
        slave = self.slave
        if self.two:
            move = slave.fmi2SetReal if setting else slave.fmi2GetReal
            self._call("a value", move, slave.component, numbers, n, buffer)
        else:
            move = slave.fmi3SetFloat64 if setting else slave.fmi3GetFloat64
            self._call("a value", move, slave.component, numbers, n, buffer, n)

    def read(self):
        self._move(False, self.wanted)
        return self.view[1].copy()

    def exchange(self, t, u):
        self.view[0][:] = u
        self._move(True, self.given)
        return self.read()

    def advance(self, t, h):
        self._call(f"the step from t = {t:g} s", self.slave.doStep, t, h)

    def save(self):
        interface = self.description.coSimulation
        if not (interface.canGetAndSetFMUstate and interface.canSerializeFMUstate):
            raise CosimulationError(f"{self.path.name} cannot give its state away, so there is no checkpoint")
        state = self._call("to give its state", self.slave.getFMUState)
        data = self._call("to give its state", self.slave.serializeFMUState, state)
        self.slave.freeFMUState(state)
        return bytes(data)

    def load(self, data):
        state = self._call("a saved state", self.slave.deserializeFMUState, data)
        self._call("a saved state", self.slave.setFMUState, state)
        self.slave.freeFMUState(state)


def _known(given, known, what):
    for name in given:
        if name not in known:
            kind, _, rest = what.partition(" of ")
            raise UnknownNameError(f"no {kind} '{name}' in {rest}{closest(name, known)}")


def _bounds(given, variables):
    for v in variables:
        if v.name in given and not v.min <= given[v.name] <= v.max:
            raise ScenarioError(f"parameter '{v.name}' = {given[v.name]:g} is outside {v.min:g} to {v.max:g} {v.unit}")


# --- making them -----------------------------------------------------------------------------------------------------


def _machine(scenario, what, library):
    """Study and model of a study file or a rig."""
    if what.endswith(".toml"):
        study = load_study(scenario.beside(what))
    else:
        study = Study(scenario.path.parent / f"{what.rsplit('.', 1)[-1]}.toml", what)
    if study.modelica:
        library = Library(study.modelica)
    return study, study.validate(library)


def _make(scenario, c, library, stack):
    """The participant that a component of the scenario describes."""
    if c.kind == "fmu":
        path = scenario.beside(c.what)
        if not path.is_file():
            raise CosimulationError(f"no FMU {path}{closest(path.name, [p.name for p in path.parent.glob('*.fmu')])}")
        return _Fmu(c, path, stack)
    if c.kind == "python":
        return _Python(c, scenario)
    if c.kind == "plant":
        study, model = _machine(scenario, c.what, library)
        if c.run == "process":
            return _Plant(c, study, model)
        key = model.key, json.dumps(values(study, model), sort_keys=True), study.name
        path = _exported(key, c.fmi, stack, lambda folder: export_fmu(study, model, folder, c.fmi, ("cs",)))
        return _Fmu(_with(c, parameters={STEP: c.step, **c.parameters}), path, stack)
    study, model = _machine(scenario, c.machine, library)
    given = values(study, model)
    if c.kind == "controller":
        block = controllers.make(c.what, model, given, float(1 / c.rate), **c.options)
        if c.run == "process":
            return _Controller(c, block)
        key = model.key, json.dumps(given, sort_keys=True), c.what, json.dumps(c.options, sort_keys=True), str(c.rate)
        return _Fmu(c, _exported(key, c.fmi, stack, lambda folder: export_block(block, folder, c.fmi)), stack)
    if c.kind == "motion":
        motion = trajectories.from_file(scenario.beside(c.what), model, given, float(c.rate))
    else:
        motion = trajectories.make(c.what, model, given, float(c.rate), scenario.duration, **c.options)
    return _Motion(c, motion, model)


def _with(c, **changed):
    from dataclasses import replace
    return replace(c, **changed)


def _exported(key, fmi, stack, make):
    """Path of an FMU made of a machine or a controller, kept from one run to the next."""
    folder = Path(tempfile.mkdtemp(prefix="pycosim-fmu-"))
    stack.callback(shutil.rmtree, folder, ignore_errors=True)
    from ..export.source import WRAPPER
    code = [p.read_text(encoding="utf-8") for p in sorted(WRAPPER.glob("*.c"))]
    made = cache.remember("fmu", cache.digest(*key, str(fmi), *code), lambda: _packed(make(folder)), bytes, bytes)
    name, _, content = made.partition(b"\n")
    path = folder / name.decode()
    path.write_bytes(content)
    return path


def _packed(path):
    return path.name.encode() + b"\n" + path.read_bytes()


# --- the master ------------------------------------------------------------------------------------------------------


class _Master:
    """Steps the components of a scenario."""

    def __init__(self, scenario, library, stack, progress):
        self.scenario, self.progress = scenario, progress
        self.parts = {}
        for c in scenario.components:
            progress(f"preparing {c.name}")
            with _named(scenario, c.name):
                self.parts[c.name] = _make(scenario, c, library, stack)
        self._connect()
        self._clock()
        self.tick = 0
        self.random = np.random.Generator(np.random.PCG64(scenario.seed))
        self.values = np.zeros(self.size)
        self.rows = io.StringIO()
        self.rows.write(",".join(["time", *scenario.columns]) + "\n")
        self.fresh, self.current = True, ""

    # --- what is connected to what ---

    def _connect(self):
        """Number every value that someone reads, and tell each component which inputs it gets from where."""
        scenario, sources = self.scenario, {}
        for a, x, b, y in scenario.connections:
            for x, y in [(x, y)] if x else self._equal_names(a, b):
                self._check_signal(a, x, self.parts[a].known, "variable")
                self._check_signal(b, y, self.parts[b].inputs, "input")
                if (b, y) in sources and sources[b, y] != (a, x):
                    other = ".".join(sources[b, y])
                    raise ScenarioError(f"{scenario.path}: connections: {b}.{y} is connected to {other} and to {a}.{x}")
                sources[b, y] = a, x
        for c in scenario.components:
            _known(c.inputs, self.parts[c.name].inputs, f"input of {c.name}")
            both = next((n for n in c.inputs if (c.name, n) in sources), None)
            if both:
                raise ScenarioError(f"{scenario.path}: [components.{c.name}]: '{both}' has a value and a connection; "
                                    "keep one")
        self.sources = sources
        self._number([*sources.values(), *(column.signal for column in scenario.columns.values())])

    def _equal_names(self, a, b):
        """Pairs for ``a -> b``: what a has and b takes under the same name."""
        found = [(n, n) for n in self.parts[b].inputs if n in self.parts[a].known and n not in self.parts[a].inputs]
        if not found:
            raise ScenarioError(f"{self.scenario.path}: connections: '{a} -> {b}', but {b} takes nothing that {a} has "
                                f"by the same name; it takes {', '.join(self.parts[b].inputs) or 'nothing'}")
        return found

    def _check_signal(self, component, name, known, what):
        if name not in known:
            raise UnknownNameError(f"{self.scenario.path}: no {what} '{name}' in component '{component}'"
                                   f"{closest(name, known)}")

    def _number(self, signals):
        for component, name in signals:
            self._check_signal(component, name, self.parts[component].known, "variable")
        wanted = {c: list(dict.fromkeys(n for owner, n in signals if owner == c)) for c in self.parts}
        self.slots, self.takes, self.size, where = {}, {}, 0, {}
        for c, names in wanted.items():
            self.slots[c] = slice(self.size, self.size + len(names))
            where.update({(c, n): self.size + k for k, n in enumerate(names)})
            self.size += len(names)
        for c in self.scenario.components:
            inputs = [y for b, y in self.sources if b == c.name]
            with _named(self.scenario, c.name):
                self.parts[c.name].prepare([*inputs, *c.inputs], wanted[c.name])
            self.takes[c.name] = (np.array([where[self.sources[c.name, n]] for n in inputs], int),
                                  np.array(list(c.inputs.values()), float))
        self.columns = [(where[column.signal], column, self.parts[column.signal[0]].labels.get(column.signal[1]))
                        for column in self.scenario.columns.values()]

    # --- time ---

    def _clock(self):
        scenario = self.scenario
        self.rate = cycle([*(c.rate for c in scenario.components), scenario.log_rate])
        self.every = {c.name: int(self.rate / c.rate) for c in scenario.components}
        self.period = {c.name: float(1 / c.rate) for c in scenario.components}
        self.log_every = int(self.rate / scenario.log_rate)
        lengths = [p.length for p in self.parts.values() if p.length is not None]
        duration = scenario.duration if scenario.duration is not None else max(lengths, default=None)
        if duration is None:
            raise ScenarioError(f"{scenario.path}: no duration, and no trajectory that has one; write duration = 10.0")
        self.end = math.floor(duration * float(self.rate) + 1e-6)

    def _time(self, tick):
        return tick * self.rate.denominator / self.rate.numerator

    def _next(self, tick):
        """The next tick at which anything happens."""
        return min((tick // n + 1) * n for n in {*self.every.values(), self.log_every})

    # --- running ---

    def run(self, until, stop, saving):
        """Up to the end, or to where it is stopped; checkpoints on the way."""
        last = self.end if until is None else min(self.end, math.floor(until * float(self.rate) + 1e-6))
        said = -math.inf
        with _interrupts() as interrupted, _named(self.scenario, lambda: self.current):
            if self.fresh:
                self._instant()
            while self.tick < last and not interrupted and not stop():
                self._advance()
                self.tick = min(self._next(self.tick), self.end)
                self._instant()
                saving(self)
                if self._time(self.tick) >= said + 0.01 * self._time(self.end):
                    said = self._time(self.tick)
                    self.progress(f"t = {said:.2f} of {self._time(self.end):g} s")
        return self._result()

    def _due(self):
        return [c.name for c in self.scenario.components if self.tick % self.every[c.name] == 0]

    def _advance(self):
        t = self._time(self.tick)
        for name in self._due():
            self.current = name
            self.parts[name].advance(t, self.period[name])

    def _instant(self):
        """Everything that happens at a communication instant before time goes on."""
        self.fresh, t, due = False, self._time(self.tick), self._due()
        for name in due:
            self.current = name
            value = self.parts[name].read()
            if value is not None:
                self.values[self.slots[name]] = value
        before = self.values.copy() if self.scenario.method == "jacobi" else self.values
        for name in due:
            self.current = name
            numbers, constants = self.takes[name]
            u = np.concatenate([before[numbers], constants]) if constants.size else before[numbers]
            self.values[self.slots[name]] = self.parts[name].exchange(t, u)
        self._check_finite(due, t)
        if self.tick % self.log_every == 0:
            self._log(t)

    def _check_finite(self, due, t):
        if np.isfinite(self.values).all():
            return
        for self.current in due:
            if not np.isfinite(self.values[self.slots[self.current]]).all():
                raise CosimulationError(f"it gave a value that is not finite at t = {t:g} s")

    def _log(self, t):
        cells = [f"{t:.9g}"]
        for number, column, labels in self.columns:
            value = self.values[number]
            if labels is not None:
                cells.append(labels[int(value)])
                continue
            if column.noise:
                value += column.noise * self.random.standard_normal()
            if column.quantum:
                value = round(value / column.quantum) * column.quantum
            cells.append(f"{value:.12g}")
        self.rows.write(",".join(cells) + "\n")

    def _result(self):
        text, complete = self.rows.getvalue(), self.tick >= self.end
        log = pd.read_csv(io.StringIO(text))
        return Cosimulation(log, text, self._time(self.tick), complete, None if complete else self.checkpoint(),
                            self._describe(log, complete))

    def _describe(self, log, complete):
        s = self.scenario
        ranges = {n: {"unit": self.parts[c.signal[0]].units.get(c.signal[1], "1"), "min": log[n].min(),
                      "max": log[n].max(), "rms": float(np.sqrt(np.mean(log[n] ** 2)))}
                  for n, c in s.columns.items() if pd.api.types.is_numeric_dtype(log[n])}
        return {"schema": 1, "scenario": s.name, "method": s.method, "duration": self._time(self.end),
                "time": self._time(self.tick), "complete": complete, "rows": len(log),
                "components": [{"name": c.name, "is": self.parts[c.name].kind, "what": c.what, "rate": float(c.rate)}
                               for c in s.components],
                "connections": [f"{a}.{x} -> {b}.{y}" for (b, y), (a, x) in self.sources.items()],
                "unconnected": [f"{n}.{i}" for n, p in self.parts.items() for i in p.inputs
                                if (n, i) not in self.sources and i not in self._component(n).inputs],
                "log_rate": float(s.log_rate), "columns": ranges}

    def _component(self, name):
        return next(c for c in self.scenario.components if c.name == name)

    # --- stopping and going on ---

    def checkpoint(self):
        """Everything to go on from."""
        parts = {}
        for name, part in self.parts.items():
            with _named(self.scenario, name):
                parts[name] = base64.b64encode(part.save()).decode()
        content = json.dumps({"format": _FORMAT, "scenario": _digest(self.scenario), "tick": self.tick,
                              "values": base64.b64encode(self.values.tobytes()).decode(), "parts": parts,
                              "random": self.random.bit_generator.state, "log": self.rows.getvalue()}).encode()
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("checkpoint.json", content)
            archive.writestr("sha256", hashlib.sha256(content).hexdigest())
        return packed.getvalue()

    def restore(self, data):
        """Go to where a checkpoint was made."""
        found = _opened(data)
        if found["scenario"] != _digest(self.scenario):
            raise ScenarioError(f"{self.scenario.path}: is not the scenario of the checkpoint, or was changed since; "
                                "start anew without --resume")
        self.tick, self.fresh = found["tick"], False
        self.values[:] = np.frombuffer(base64.b64decode(found["values"]))
        self.random.bit_generator.state = found["random"]
        self.rows = io.StringIO()
        self.rows.write(found["log"])
        for name, part in self.parts.items():
            with _named(self.scenario, name):
                part.load(base64.b64decode(found["parts"][name]))


def _opened(data):
    """Content of a checkpoint."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            content, expected = archive.read("checkpoint.json"), archive.read("sha256").decode()
        if hashlib.sha256(content).hexdigest() != expected:
            raise ValueError
        found = json.loads(content)
        if found["format"] != _FORMAT:
            raise ValueError
        return found
    except (zipfile.BadZipFile, zlib.error, KeyError, ValueError, OSError, EOFError, RuntimeError):
        raise ScenarioError("the checkpoint is damaged, or was written by another version; start anew without "
                            "--resume") from None


def _digest(scenario):
    return hashlib.sha256(scenario.text.encode()).hexdigest()


@contextmanager
def _named(scenario, name):
    """Errors say which component they come from: a name, or a function that tells it then."""
    try:
        yield
    except PycosimError as error:
        where = f"{scenario.path}: component '{name() if callable(name) else name}': "
        raise error if str(error).startswith(str(scenario.path)) else type(error)(where + str(error)) from None


@contextmanager
def _interrupts():
    """A list that is filled at Ctrl-C, so that a step is never cut in half; a second Ctrl-C is an ordinary one."""
    seen = []
    if threading.current_thread() is not threading.main_thread():
        yield seen
        return
    usual = signal.getsignal(signal.SIGINT)

    def note(number, frame):
        seen.append(number)
        signal.signal(signal.SIGINT, usual)
    signal.signal(signal.SIGINT, note)
    try:
        yield seen
    finally:
        signal.signal(signal.SIGINT, usual)

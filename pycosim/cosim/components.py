"""A component of a scenario in; what steps it, hands over its outputs and keeps its state, out."""

from __future__ import annotations

import ctypes
import hashlib
import importlib.util
import json
import math
import shutil
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ..compile import shared_library
from ..control import controllers, trajectories
from ..core import cache
from ..core.errors import CosimulationError, PycosimError, ScenarioError, UnknownNameError, closest, closest_file
from ..core.extras import extra
from ..dynamics.simulate import dynamics
from ..dynamics.stepping import in_parts, watched
from ..export.controller import export_block
from ..export.description import STEP, values
from ..export.fmu import export_fmu
from ..study.parse import load_study
from ..study.schema import Study
from . import checkpoint

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

    readable = False  # whether `read` tells the values at any time

    def read(self):
        """Values read, after a step; None where only `exchange` tells them."""
        return None

    def exchange(self, t, u):
        """Take inputs, return the values read."""
        raise NotImplementedError

    def take(self, t, u):
        """Take inputs where nobody reads what follows from them; `read` tells it later, where it can."""
        self.exchange(t, u)

    def advance(self, t, h):
        """Go on from t for h, inputs held."""

    def save(self):
        """Everything to go on from, as bytes."""
        return b""

    def load(self, data):
        """Undo everything since `save`."""


class _Buffered:
    """A CasADi function on the given arrays, called without conversion."""

    def __init__(self, function, *arguments):
        self.results = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        self.buffer, self.run = function.buffer()
        for k, a in enumerate(arguments):
            if a.shape != (function.nnz_in(k),):
                raise ValueError(f"{function.name()}: argument {k} has shape {a.shape}")  # or it reads elsewhere
            self.buffer.set_arg(k, memoryview(a))
        for k, r in enumerate(self.results):
            self.buffer.set_res(k, memoryview(r))

    def __call__(self):
        self.run()
        return self.results


class _InProcess(_Participant):
    """State in arrays of numbers; saved as they are."""

    readable = True
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
        check_names(c.parameters, given, f"parameter of {model.rig}")
        check_names(c.start, d.start, f"state of {model.rig}")
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
        self.at_t, self.part = np.zeros(1), np.zeros(1)
        self.step = _Buffered(watched(d.step, d.speeds), self.x, self.z, self.u, self.u, self.q, self.at_t, self.part)
        self.initial = _Buffered(d.initial, self.x, self.z, self.u, self.q, self.time)

    def prepare(self, inputs, outputs):
        import casadi as ca
        d = self.d
        self.at = [d.inputs.index(n) for n in inputs]
        a = [ca.SX.sym(n, d.output.size1_in(k)) for k, n in enumerate("xzupt")]
        where = {n: (a[0], k) for k, n in enumerate(d.states)} | {n: (a[2], k) for k, n in enumerate(d.inputs)}
        y = d.output(*a)
        where |= {n: (y, k) for k, n in enumerate(d.outputs)}
        rows = [where[n][0][where[n][1]] for n in outputs]
        observe = ca.Function("observe", a, [ca.densify(ca.cse(ca.vertcat(*rows, ca.SX(0, 1))))])
        self.observe = _Buffered(observe, self.x, self.now, self.u, self.p, self.time)
        self._solve()
        self.z[:] = self.now

    def _solve(self):
        """Algebraic variables that fit states and inputs."""
        if self.fresh[0]:
            return
        self.now[:] = self.initial()[0]
        if not np.isfinite(self.now).all():
            raise CosimulationError(f"the loads have no solution at t = {self.time[0]:g} s; check that every joint has "
                                    "inertia")
        self.fresh[0] = 1

    def read(self):
        self._solve()
        return self.observe()[0]

    def exchange(self, t, u):
        self.take(t, u)
        return self.read()

    def take(self, t, u):
        if (self.u[self.at] != u).any():
            self.u[self.at], self.fresh[0] = u, 0

    def advance(self, t, h):
        count = max(1, math.ceil(h / self.longest - 1e-6))
        part = h / count
        for k in range(count):
            self.at_t[0], self.part[0] = t + k * part, part
            x, z, error = self.step()
            if not error[0] <= 1:
                found = in_parts(self.d, self.x, self.z, self.u, self.u, self.q, t + k * part, part)
                if not found:
                    raise CosimulationError(f"no solution for the step from t = {t + k * part:g} s; check that every "
                                            f"joint has inertia, and take a step below {self.longest:g} s")
                x, z = found
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
        check_names(c.parameters, given, f"parameter of the controller {block.name}")
        _bounds(c.parameters, block.parameters)
        given.update(c.parameters)
        self.p = np.array(list(given.values()))
        self.x, self.u = np.array([v.value for v in block.states]), np.array([v.value for v in block.inputs])
        self.state = self.x, self.u
        arguments = self.x, self.u, self.p
        self.output, self.update = _Buffered(block.output, *arguments), _Buffered(block.update, *arguments)

    def prepare(self, inputs, outputs):
        self.at = [self.inputs.index(n) for n in inputs]
        self.wanted = [self.known.index(n) for n in outputs]

    def read(self):
        return np.concatenate([self.output()[0], self.u, self.x])[self.wanted]

    def exchange(self, t, u):
        self.take(t, u)
        return self.read()

    def take(self, t, u):
        self.u[self.at] = u

    def advance(self, t, h):
        self.x[:] = self.update()[0]


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

    def __init__(self, c, scenario, allowed):
        self.what = c.what
        made = _import(c.what, scenario, allowed)
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
            return checkpoint.dump(vars(self.object))
        except TypeError as error:
            raise CosimulationError(f"'{self.what}' cannot be saved for a checkpoint: {error}; keep numbers, texts, "
                                    "arrays, lists and dictionaries of them in its attributes") from None

    def load(self, data):
        try:
            found = checkpoint.load(data)
        except ValueError as error:
            raise CosimulationError(f"the checkpoint of '{self.what}' cannot be read: {error}") from None
        vars(self.object).clear()
        vars(self.object).update(found)


def _import(what, scenario, allowed):
    """A class by ``module:Class``, looked for beside the scenario first; only from a file or module that is allowed."""
    module, _, name = what.partition(":")
    if not module or not name:
        raise CosimulationError(f"'{what}' is not of the form \"module:Class\"")
    folder = scenario.path.parent
    path = folder.joinpath(*module.split(".")).with_suffix(".py")
    if path.is_file():
        fine, shown = path.resolve() in [Path(a).resolve() for a in allowed], str(path)
    else:
        fine, shown = module in [str(a) for a in allowed], module
    if not fine:
        raise CosimulationError(f"it runs the Python code of '{shown}', which may do anything on this computer; read "
                                f"it, then allow it: pycosim cosim {scenario.path} --allow-python {shown}")
    sys.path.insert(0, str(folder))
    try:
        found = _module(module, path)
    except Exception as error:
        raise CosimulationError(f"'{module}' cannot be imported: {type(error).__name__}: {error}") from None
    finally:
        sys.path.remove(str(folder))
    if not hasattr(found, name):
        known = [n for n in vars(found) if n[0] != "_"]
        raise CosimulationError(f"'{module}' has no class '{name}'{closest(name, known)}")
    return getattr(found, name)


def _module(module, path):
    """A module of the scenario's folder, under a name of its own: another scenario may have one of the same name."""
    if not path.is_file():
        return importlib.import_module(module)
    name = f"scenario_{hashlib.sha256(str(path).encode()).hexdigest()[:12]}_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


class _Fmu(_Participant):
    """An FMU of version 2 or 3, through fmpy."""

    readable = True

    def __init__(self, c, path, stack):
        use = 'an FMU in a co-simulation (run = "process" does without)'
        fmpy = extra("fmpy", use, CosimulationError)
        instantiate_fmu = extra("fmpy.simulation", use, CosimulationError).instantiate_fmu
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
        check_names({**c.parameters, **c.start}, self.number, f"variable of {self.path.name}")
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
        self.take(t, u)
        return self.read()

    def take(self, t, u):
        self.view[0][:] = u
        self._move(True, self.given)

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


def check_names(given, known, what):
    """Refuse names that nothing has.

    Parameters
    ----------
    given, known : collection of str
        Names that a scenario has, and those that there are.
    what : str
        Their kind and whose they are, as ``parameter of machine.toml``.

    Raises
    ------
    UnknownNameError
        With the closest name that there is.
    """
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
        library = shared_library(study.modelica)
    return study, study.validate(library)


def make_component(scenario, c, library, stack, allowed):
    """The participant that a component of the scenario describes.

    Parameters
    ----------
    scenario : Scenario
        Its folder is where files of the component are looked for.
    c : Component
        As the scenario describes it.
    library : Library
        Which holds the rigs of plants and controllers.
    stack : contextlib.ExitStack
        Takes down what the participant leaves: processes, folders.
    allowed : sequence of str or path
        Files and modules whose Python code may run.

    Returns
    -------
    object
        With inputs, outputs, ``step`` and the rest of what the master calls.

    Raises
    ------
    PycosimError
        What the component names is not there, or does not fit the scenario.
    """
    if c.kind == "fmu":
        path = scenario.beside(c.what)
        if not path.is_file():
            raise CosimulationError(f"no FMU {path}{closest_file(path, ('.fmu',))}")
        return _Fmu(c, path, stack)
    if c.kind == "python":
        return _Python(c, scenario, allowed)
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


@contextmanager
def naming(scenario, name):
    """Errors say which component they come from.

    Parameters
    ----------
    scenario : Scenario
        Its file is named as well.
    name : str or callable
        The component, or a function that tells it when there is an error.

    Yields
    ------
    None
        The component may be used meanwhile.
    """
    try:
        yield
    except PycosimError as error:
        where = f"{scenario.path}: component '{name() if callable(name) else name}': "
        raise error if str(error).startswith(str(scenario.path)) else type(error)(where + str(error)) from None

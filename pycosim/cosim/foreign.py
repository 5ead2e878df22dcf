"""An FMU of anyone's in; its outputs along a log, and their derivatives by its parameters, out.

Co-simulation FMUs are stepped from sample to sample, model-exchange FMUs by the classical Runge-Kutta method with the
same parts in between each time; their state events are not looked for. Inputs are held from each sample to the next.
Derivatives are carried along by the FMU's own directional derivatives where it has them for model exchange; else they
are central differences over the same steps.
"""

from __future__ import annotations

import ctypes
import math
import shutil
import tempfile
import xml.etree.ElementTree as xml
from pathlib import Path

import numpy as np

from ..core.errors import CosimulationError, closest, closest_file
from ..core.units import Variable

_REAL = ("Real", "Float64")
_SHARE = 3e-4  # of a parameter's scale, by which it is varied: its square is left, a solver's noise over it is added
_AGREE = 1e-3  # relative; directional derivatives that differ by more from a difference are not taken
_PARTS = 1e-3  # s; longest part of a step of the Runge-Kutta method, unless the FMU names a step
_MOST_PARTS = 1000


class ForeignFmu:
    """An FMU of FMI 2 or 3, instantiated once.

    Parameters
    ----------
    path : path
        Its binary runs in this process.

    Attributes
    ----------
    kind : str
        ``CoSimulation``, or ``ModelExchange`` where there is no other.
    variables : dict of str to Variable
        What may be fitted: parameters, and starts of other variables that are exact; their start values, units, bounds.
    tunable : list of str
        Parameters that the FMU calls tunable.
    inputs, outputs : dict of str to str
        Names to units; an output is anything that can be read.
    directional : bool
        Whether derivatives are the FMU's own.

    Raises
    ------
    CosimulationError
        The file is no FMU that runs here.
    """

    def __init__(self, path):
        import fmpy
        if not Path(path).exists():
            raise CosimulationError(f"no FMU {path}{closest_file(path, ('.fmu',))}; name a file of FMI 2 or 3")
        self.path, self.messages, self.slave = Path(path), [], None
        self.folder = tempfile.mkdtemp(prefix="pycosim-fmu-")
        try:
            self.description = fmpy.read_model_description(str(path))
            fmpy.extract(str(path), self.folder)
            if self.description.fmiVersion[0] not in "23":
                raise ValueError(f"it is of FMI {self.description.fmiVersion}; FMI 2 and 3 can be calibrated")
            self.kind = "CoSimulation" if self.description.coSimulation else "ModelExchange"
            self._instantiate()
        except Exception as error:  # fmpy raises bare exceptions
            shutil.rmtree(self.folder, ignore_errors=True)
            raise CosimulationError(f"{path}: cannot be loaded as an FMU ({error})") from None
        self.two, self.fresh = self.description.fmiVersion.startswith("2"), True
        real = [v for v in self.description.modelVariables if v.type in _REAL and not getattr(v, "dimensions", None)]
        self.number = {v.name: v.valueReference for v in real}
        self.inputs = {v.name: v.unit or "1" for v in real if v.causality == "input"}
        self.outputs = {v.name: v.unit or "1" for v in real if v.causality != "input"}
        free = [v for v in real if v.start is not None and v.causality != "input" and v.variability != "constant"]
        self.variables = {v.name: _variable(v) for v in free}
        self.tunable = [v.name for v in free if v.causality == "parameter" and v.variability == "tunable"]
        self._states()
        self.directional = self.kind == "ModelExchange" and self._says_directional()

    def _says_directional(self):
        """What the description says itself; fmpy does not read the attribute of FMI 3."""
        root = xml.parse(Path(self.folder) / "modelDescription.xml").getroot()
        return any(value in ("true", "1") for e in root.iter("ModelExchange") for name, value in e.attrib.items()
                   if name.startswith("providesDirectionalDerivative"))

    def close(self):
        """Free the instance and its files."""
        if self.slave is not None:
            self._leave()
            self.slave.freeInstance()
            self.slave = None
        shutil.rmtree(self.folder, ignore_errors=True)

    def _instantiate(self):
        from fmpy.simulation import instantiate_fmu
        self.slave = instantiate_fmu(self.folder, self.description, self.kind,
                                     logger=lambda *a: self.messages.append(a[-1].decode(errors="replace")))

    def _states(self):
        """Continuous states and their derivatives, in the order of the FMU."""
        order = {v.name: v for v in self.description.modelVariables}
        rates = [order[d.variable.name] for d in self.description.derivatives]
        self.rates = [v.valueReference for v in rates]
        self.states = [v.derivative.valueReference for v in rates if v.derivative is not None]

    def _leave(self):
        try:
            self.slave.terminate()
        except Exception:
            pass  # one that failed cannot be terminated, but is freed or reset all the same

    def _call(self, what, function, *arguments, **options):
        try:
            return function(*arguments, **options)
        except Exception as error:
            said = self.messages[-1] if self.messages else str(error)
            raise CosimulationError(f"{self.path.name} refused {what}: {said}") from None

    # --- values

    def _set(self, names, values):
        if names:
            move = self.slave.setReal if self.two else self.slave.setFloat64
            self._call("a value", move, [self.number[n] for n in names], [float(v) for v in values])

    def _get(self, names):
        move = self.slave.getReal if self.two else self.slave.getFloat64
        return self._call("to give a value", move, [self.number[n] for n in names]) if names else []

    def _begin(self, values, at, names, inputs):
        """A fresh start at a time, with parameters and the first inputs."""
        if not self.fresh:
            self._leave()
            try:
                self.slave.reset()
            except Exception:  # it cannot start again, so another one does
                self.slave.freeInstance()
                self._instantiate()
        self.fresh = False
        if self.two:
            self._call("the set-up", self.slave.setupExperiment, startTime=at)
        self._set(list(values), values.values())
        if self.two:
            self._call("the initialization", self.slave.enterInitializationMode)
        else:
            self._call("the initialization", self.slave.enterInitializationMode, startTime=at)
        self._set(names, inputs)
        self._call("the initialization", self.slave.exitInitializationMode)

    # --- running

    def run(self, values, time, inputs, outputs):
        """Outputs at the samples of a log.

        Parameters
        ----------
        values : dict of str to float
            What is not as the FMU has it.
        time : ndarray, shape (n,)
            Increasing [s].
        inputs : dict of str to ndarray, shape (n,)
            In the FMU's units, at the samples.
        outputs : list of str
            In the order of the result's rows.

        Returns
        -------
        ndarray, shape (len(outputs), n)

        Raises
        ------
        CosimulationError
            The FMU refuses a value or a step.
        """
        return self._walk(values, time, inputs, outputs, [])[0]

    def slopes(self, values, free, time, inputs, outputs):
        """Outputs at the samples, and their derivatives by some of the values.

        Parameters
        ----------
        values : dict of str to float
            With all that are free.
        free : list of str
            Names among `values`, in the order of the slope's second axis.
        time : ndarray, shape (n,)
            Increasing [s].
        inputs : dict of str to ndarray, shape (n,)
            In the FMU's units, at the samples.
        outputs : list of str
            In the order of the result's rows.

        Returns
        -------
        y : ndarray, shape (len(outputs), n)
        slope : ndarray, shape (len(outputs), len(free), n)
        """
        if self.directional:
            found = self._own_slopes(values, free, time, inputs, outputs)
            if found is not None:
                return found
            self.directional = False
        return self.run(values, time, inputs, outputs), self._differences(values, free, time, inputs, outputs)

    def _differences(self, values, free, time, inputs, outputs):
        """Central differences over the same steps; at a bound, one-sided ones."""
        columns = []
        for name in free:
            v, here = self.variables[name], values[name]
            ends = [min(max(here + s * _SHARE * v.nominal, v.min), v.max) for s in (1, -1)]
            up, down = (self.run({**values, name: e}, time, inputs, outputs) for e in ends)
            columns.append((up - down) / (ends[0] - ends[1]))
        return np.stack(columns, axis=1)

    def _own_slopes(self, values, free, time, inputs, outputs):
        """By directional derivatives; None where the FMU has none by its parameters, or where they are wrong."""
        try:
            y, slope = self._walk(values, time, inputs, outputs, free)
        except CosimulationError:
            return None
        few = slice(0, max(2, min(len(time), 50)))
        wanted = self._differences(values, free, time[few], {n: u[few] for n, u in inputs.items()}, outputs)
        size = np.abs(wanted).max(axis=2, keepdims=True)
        return (y, slope) if (np.abs(slope[..., few] - wanted) <= _AGREE * size + 1e-9).all() else None

    def _walk(self, values, time, inputs, outputs, free):
        names, u = list(inputs), np.array([inputs[n] for n in inputs]).reshape(len(inputs), len(time)).T
        y = np.empty((len(time), len(outputs)))
        slope = np.zeros((len(time), len(outputs), len(free)))
        self._begin(values, float(time[0]), names, u[0])
        engine = _Exchange(self, values, free, time, outputs) if self.kind == "ModelExchange" else None
        for k, t in enumerate(time):
            if k:
                h = float(t - time[k - 1])
                if engine:
                    engine.step(float(time[k - 1]), h)
                else:
                    self._call(f"the step from t = {time[k - 1]:g} s", self.slave.doStep, float(time[k - 1]), h)
            y[k] = self._get(outputs)
            if free:
                slope[k] = engine.slope()
            self._set(names, u[k])
        return y.T, slope.transpose(1, 2, 0)


class _Exchange:
    """The classical Runge-Kutta method for a model-exchange FMU, its states' derivatives by parameters beside it."""

    def __init__(self, fmu, values, free, time, outputs):
        self.fmu, self.free, self.n = fmu, [fmu.number[n] for n in free], len(fmu.rates)
        self.outputs = [fmu.number[n] for n in outputs]
        self.x, self.rate = (ctypes.c_double * self.n)(), (ctypes.c_double * self.n)()
        hint = getattr(fmu.description.defaultExperiment, "stepSize", None)
        self.longest = float(hint) if hint else _PARTS
        self._settle()
        fmu._call("its states", fmu.slave.getContinuousStates, self.x, self.n)
        self.sensitivity = np.zeros((self.n, len(free)))
        for j, name in enumerate(free):  # where a start value is a state itself
            if fmu.number[name] in fmu.states:
                self.sensitivity[fmu.states.index(fmu.number[name]), j] = 1.0

    def _settle(self):
        """Leave event mode."""
        slave = self.fmu.slave
        if self.fmu.two:
            while self.fmu._call("its events", slave.newDiscreteStates)[0]:
                pass
        else:
            while self.fmu._call("its events", slave.updateDiscreteStates)[0]:
                pass
        self.fmu._call("continuous time", slave.enterContinuousTimeMode)

    def _rates(self, t, x, sensitivity):
        slave = self.fmu.slave
        slave.setTime(t)
        self.x[:] = x
        self.fmu._call("a state", slave.setContinuousStates, self.x, self.n)
        if self.fmu.two:
            self.fmu._call("its derivatives", slave.getDerivatives, self.rate, self.n)
        else:
            self.fmu._call("its derivatives", slave.getContinuousStateDerivatives, self.rate, self.n)
        return np.array(self.rate), self._along(self.fmu.rates, sensitivity)

    def _along(self, unknown, sensitivity):
        """Directional derivatives along each free value, states included."""
        slave, known = self.fmu.slave, self.fmu.states
        found = np.zeros((len(unknown), len(self.free)))
        for j, number in enumerate(self.free):
            own = number in known  # a start value, which is the state's no longer
            found[:, j] = self.fmu._call(
                "a directional derivative", slave.getDirectionalDerivative, unknown,
                known if own else [*known, number], [*sensitivity[:, j], *([] if own else [1.0])])
        return found

    def slope(self):
        """Derivatives of the outputs by what is free, here; a state's own are at hand."""
        found, states = np.zeros((len(self.outputs), len(self.free))), self.fmu.states
        others = [k for k, number in enumerate(self.outputs) if number not in states]
        if others:
            found[others] = self._along([self.outputs[k] for k in others], self.sensitivity)
        for k, number in enumerate(self.outputs):
            if number in states:
                found[k] = self.sensitivity[states.index(number)]
        return found

    def step(self, t, h):
        """Go on by h."""
        parts = min(_MOST_PARTS, max(1, math.ceil(h / self.longest - 1e-9)))
        h, x, s = h / parts, np.array(self.x), self.sensitivity
        for k in range(parts):
            at = t + k * h
            a, da = self._rates(at, x, s)
            b, db = self._rates(at + h / 2, x + h / 2 * a, s + h / 2 * da)
            c, dc = self._rates(at + h / 2, x + h / 2 * b, s + h / 2 * db)
            d, dd = self._rates(at + h, x + h * c, s + h * dc)
            x, s = x + h / 6 * (a + 2 * b + 2 * c + d), s + h / 6 * (da + 2 * db + 2 * dc + dd)
        if not np.isfinite(x).all():
            raise CosimulationError(f"{self.fmu.path.name}: its states are no numbers after t = {t:g} s; it is stiff, "
                                    "or the values are wrong: export it for co-simulation, with its own solver")
        self.sensitivity = s
        self.fmu.slave.setTime(t + parts * h)
        self.x[:] = x
        self.fmu._call("a state", self.fmu.slave.setContinuousStates, self.x, self.n)
        enter, _ = self.fmu._call("a step", self.fmu.slave.completedIntegratorStep)
        if enter:
            self.fmu._call("its events", self.fmu.slave.enterEventMode)
            self._settle()
            self.fmu._call("its states", self.fmu.slave.getContinuousStates, self.x, self.n)


def _variable(v):
    """What the description says of a variable; its scale is its nominal value, else its start."""
    start = float(v.start)
    ends = [float(b) if b is not None else e for b, e in ((v.min, -math.inf), (v.max, math.inf))]
    scale = float(v.nominal) if v.nominal is not None and float(v.nominal) > 0 else abs(start) or 1.0
    return Variable(v.name, v.unit or "1", v.description or "", start, *ends, scale)


def check_names(fmu, names, known, what):
    """Refuse names that an FMU has not.

    Parameters
    ----------
    fmu : ForeignFmu
        Named in what is refused.
    names, known : collection of str
        Names that a study has, and those that there are.
    what : str
        What they should be.

    Raises
    ------
    CosimulationError
        With the closest name that there is.
    """
    for n in names:
        if n not in known:
            raise CosimulationError(f"{fmu.path.name} has no {what} '{n}'{closest(n, known)}")

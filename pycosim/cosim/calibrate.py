"""A study, its logs and anyone's FMU in; the FMU's parameters with intervals, null directions and errors, out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
from scipy.optimize import least_squares

from ..core.errors import DataError, StudyError
from ..data.logs import load, require
from ..data.noise import Chain
from ..fit.least_squares import result
from .foreign import ForeignFmu, check_names

_ROUNDS = 2  # fits with weights of the residual that the last one left
_EVALUATIONS = 60


@dataclass
class Calibration:
    """What a calibration found.

    Attributes
    ----------
    fit : Fit
        Values and intervals of the FMU's parameters.
    before, after : dict of str to dict of str to float
        Root mean square error of each output, of ``fit`` and, where there is one, ``held_out`` logs.
    inputs, outputs : dict of str to str
        Names to units.
    method : str
        Where the derivatives came from.
    notes : list of str
        Sentences on what the study leaves open: which parameters were freed, which inputs stay as they are.
    attached : tuple
        No effects: an FMU is as it is.
    """

    fit: object
    before: dict
    after: dict
    inputs: dict
    outputs: dict
    method: str
    notes: list = field(default_factory=list)
    attached: tuple = ()

    def unit(self, channel):
        """Unit of a fitted output.

        Parameters
        ----------
        channel : str
            An output of the FMU.

        Returns
        -------
        str
        """
        return self.outputs[channel]


def calibrate(study, path, progress=lambda text: None):
    """Fit an FMU's parameters to the logs of a study.

    The study's ``[columns]`` say which column is which input or output of the FMU, its ``[parameters]`` which of the
    FMU's parameters (or exact starts) are free and within what bounds; without any, all tunable ones are free. Its
    ``[rig]`` is not looked at.

    Parameters
    ----------
    study : Study
        Its columns, parameters and logs count.
    path : path
        FMU of FMI 2 or 3, for co-simulation or model exchange.
    progress : callable
        Told what is going on.

    Returns
    -------
    Calibration

    Raises
    ------
    CosimulationError
        The FMU cannot be run, or lacks a variable that the study names.
    StudyError, DataError
        Nothing is free, or no column is an output.
    """
    study.refuse_own("identify --fmu")
    if study.leave_out:
        raise StudyError(f"{study.path}: [data] leave_out is for what a rig is compared with, and an FMU is compared "
                         "at every sample; take it out, or keep a part of the logs with time = [first, last]")
    fmu = ForeignFmu(path)
    try:
        return _Calibrator(fmu, study, progress).found()
    finally:
        fmu.close()


class _Calibrator:
    """Residuals of an FMU over the logs of a study."""

    def __init__(self, fmu, study, progress):
        self.fmu, self.study, self.progress, self.notes = fmu, study, progress, []
        check_names(fmu, study.parameters, fmu.variables, "parameter or start")
        self.variables = {n: study.parameters[n].applied(v) if n in study.parameters else v
                          for n, v in fmu.variables.items()}
        fmu.variables = self.variables
        asked = [n for n, s in study.parameters.items() if s.fixed is False]
        self.free = asked or [n for n in fmu.tunable if n not in study.parameters]
        if not self.free:
            raise StudyError(f"{study.path}: nothing of {fmu.path.name} is free: it has no tunable parameters; write "
                             f"fixed = false at those to identify, of {', '.join(list(fmu.variables)[:8])}")
        if not asked:
            self.notes.append(f"Free are all that {fmu.path.name} calls tunable: {', '.join(self.free)}.")
        named = [c.variable for label, c in study.columns.items() if label != study.time_column]
        check_names(fmu, named, fmu.number, "variable")
        self.inputs = [n for n in named if n in fmu.inputs]
        self.outputs = [n for n in named if n not in fmu.inputs]
        if not self.outputs:
            raise DataError(f"{study.path}: no column is an output of {fmu.path.name}; map one, as "
                            f"{', '.join(list(fmu.outputs)[:5])}")
        idle = [n for n in fmu.inputs if n not in self.inputs]
        if idle:
            self.notes.append(f"Inputs that no column gives stay as the FMU has them: {', '.join(idle)}.")
        self.logs = load(study)
        for log in self.logs:
            require(log, [*self.inputs, *self.outputs])
        self.fixed = {n: v.value for n, v in self.variables.items() if n in study.parameters}

    def _values(self, x):
        return {**self.fixed, **dict(zip(self.free, map(float, x)))}

    def _parts(self, held_out):
        return [log for log in self.logs if log.held_out == held_out]

    def _errors(self, x):
        found = {}
        for kind, held_out in (("fit", False), ("held_out", True)):
            rest = [self._measured(log) - self.fmu.run(self._values(x), log.time, self._given(log), self.outputs)
                    for log in self._parts(held_out)]
            if rest:
                rest = np.hstack(rest)
                found[kind] = {n: float(np.sqrt(np.mean(r ** 2))) for n, r in zip(self.outputs, rest)}
        return found

    def _given(self, log):
        return {n: log.signals[n] for n in self.inputs}

    def _measured(self, log):
        return np.array([log.signals[n] for n in self.outputs])

    def _slopes(self, x):
        """Residual and derivatives of all fitted logs, kept while x stays."""
        if getattr(self, "at", None) is None or not np.array_equal(self.at[0], x):
            found = [self.fmu.slopes(self._values(x), self.free, log.time, self._given(log), self.outputs)
                     for log in self._parts(False)]
            residual = np.hstack([self._measured(log) - y for log, (y, _) in zip(self._parts(False), found)])
            self.at = np.array(x), residual, np.concatenate([s for _, s in found], axis=2)
        return self.at[1:]

    def _residual(self, x):
        return np.hstack([self._measured(log) - self.fmu.run(self._values(x), log.time, self._given(log), self.outputs)
                          for log in self._parts(False)])

    def found(self):
        """Fit, and say what came out."""
        self.progress(f"running {self.fmu.path.name}")
        low, high, scale, start = (np.array([getattr(self.variables[n], k) for n in self.free])
                                   for k in ("min", "max", "nominal", "value"))
        margin = 1e-6 * scale
        x = start = np.clip(start, np.minimum(low + margin, high), np.maximum(high - margin, low))
        before = self._errors(start)
        spread = [np.hstack([log.signals[n] for log in self._parts(False)]).std() for n in self.outputs]
        weights = np.array([1 / s if s > 0 else 1.0 for s in spread])
        for k in range(1 + _ROUNDS):
            self.progress(f"fitting {len(self.free)} parameters, round {k + 1} of {1 + _ROUNDS}")
            x = least_squares(
                lambda z: (weights[:, None] * self._residual(z)).ravel(), x, bounds=(low, high), x_scale=scale,
                jac=lambda z: -(weights[:, None, None] * self._slopes(z)[1]).transpose(0, 2, 1).reshape(-1, len(z)),
                xtol=1e-8, ftol=1e-10, gtol=1e-12, max_nfev=_EVALUATIONS).x
            x = np.clip(x, low + margin, high - margin)
            rms = np.sqrt(np.mean(self._slopes(x)[0] ** 2, axis=1))
            weights = 1 / np.maximum(rms, 1e-9 * np.maximum(spread, 1e-300))
        fit = self._fit(x, weights)
        method = "the FMU's directional derivatives" if self.fmu.directional else "central differences"
        units = ({n: given[n] for n in names} for names, given in ((self.inputs, self.fmu.inputs),
                                                                  (self.outputs, self.fmu.outputs)))
        return Calibration(fit, before, self._errors(x), *units, method, self.notes)

    def _fit(self, x, weights):
        residual, slope = self._slopes(x)
        gaps = np.concatenate([np.r_[math.inf, np.diff(log.time)] for log in self._parts(False)])
        problem = SimpleNamespace(chain=Chain(gaps), parameters={n: v.value for n, v in self.variables.items()},
                                  names=self.outputs)
        gram = np.zeros((len(x) + 1, len(x) + 1))
        for w, s, r in zip(weights, slope, residual):
            rows = np.vstack([s, r]) * w
            gram += rows @ rows.T
        return result(problem, slope, residual, gram, x, self.free, self.variables, weights, None)

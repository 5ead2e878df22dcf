"""A model with its values and a log in; errors of its exported FMU, stepped by fmpy through that log, out.

The FMU is the estimator: joint torques from the motion and the torques of the motors. The plant driven by the measured
torques alone would drift away from any log within seconds, however right its friction is, so that its angles would tell
of nothing; what friction takes on the way is told by the estimator at every sample.
"""

from __future__ import annotations

import json
from contextlib import ExitStack
from fractions import Fraction

import numpy as np

from ..compile import ArrayFunction, compile_model
from ..control.controllers import estimator
from ..core.errors import DataError, ExportError, StudyError
from ..core.extras import extra
from ..diagnosis.confirm import frozen
from ..export.controller import export_block
from .components import _exported, _Fmu
from .scenario import Component

_CANNOT = (StudyError, DataError, ExportError)  # no such FMU for this rig, this log or this computer

_READ = {"phi": "{}", "w": "der({})", "a": "der(der({}))"}  # input of the estimator: signal of the data set


def before_and_after(dataset, progress=None):
    """Errors of the estimator's FMU without all effects of a study, and with them, everything else as it is.

    Parameters
    ----------
    dataset : Dataset
        The study on the log that is replayed.
    progress : callable, optional
        Called with a sentence before each stage.

    Returns
    -------
    dict
        ``before``, ``after``: as of `replay`; both empty where there is no such FMU, and ``why`` says why.
    """
    found = {"before": {}, "after": {}, "why": None}
    models = {"before": compile_model(dataset.library, dataset.base.rig, []), "after": dataset.base}
    try:
        for name, model in models.items():
            if progress:
                progress(f"replaying the log through the FMU {'without' if name == 'before' else 'with'} the effects")
            found[name] = replay(dataset, model, frozen(dataset, model).parameters)
    except _CANNOT as error:
        return {"before": {}, "after": {}, "why": str(error)}
    return found


def replay(dataset, model, parameters):
    """Errors of the FMU of a model's estimator over all moving samples of a data set.

    Parameters
    ----------
    dataset : Dataset
        Its logs hold what the estimator takes; without a torque reference, half differences are compared.
    model : Model
        Its rig answers ``estimate``; with its effects.
    parameters : dict of str to float
        Of the model.

    Returns
    -------
    dict of str to float
        RMSE of each joint torque, by channel, in its unit.

    Raises
    ------
    StudyError
        The rig has no joint torques to estimate from motion and motor torques.
    ExportError
        The FMU cannot be built, or there is no fmpy to step it.
    CosimulationError
        It refuses a step.
    """
    extra("fmpy", "a replay through the FMU", ExportError)
    names = model.alternatives("estimate")[0][0]
    if dataset.averaged or (dataset.asked == "estimate" and dataset.form != 0):
        raise StudyError(f"{dataset.study.path}: its logs do not hold what the estimator of {model.rig} takes, sample "
                         "by sample")
    signals = dataset.undelayed(dataset.ask(model), parameters)
    period = float(np.median(np.diff(dataset.time)))
    block = estimator(model, {n: parameters[n] for n in model.parameters}, period)
    inputs = {v.name: _signal(dataset, signals, v.name) for v in block.inputs}
    estimates = _stepped(block, inputs, names, dataset, period, _of_runs(dataset, model, parameters))
    found = {}
    for name, estimate in zip(names, estimates):
        error = _reference(dataset, model, parameters, name) - estimate
        error = sum(weight * take(error) for weight, _, take in dataset.picks("all"))
        found[f"{name}_pair" if dataset.paired else name] = float(np.sqrt(np.mean(error ** 2)))
    return found


def _signal(dataset, signals, name):
    """Values of an input of the estimator at every sample."""
    owner, _, what = name.rpartition(".")
    wanted = _READ[what].format(f"{owner}.phi") if what in _READ else name
    found = signals.get(wanted, dataset.measured.get(name))
    if found is None:
        raise DataError(f"{dataset.logs[0].path}: holds no '{wanted}', which the estimator of {dataset.study.rig} "
                        "takes")
    return found


def _of_runs(dataset, model, parameters):
    """By run: parameters that have a value of their own there."""
    found = {}
    for name, runs in dataset.parameters.own(model).items():
        for run, own in runs.items():
            if own in parameters:
                found.setdefault(run, {})[name] = parameters[own]
    return found


def _stepped(block, inputs, outputs, dataset, period, of_runs):
    """Outputs (outputs, n) of a block's FMU: a communication step a sample, a new instance a run."""
    found = np.empty((len(outputs), len(dataset.time)))
    rows = np.array(list(inputs.values())).T
    key = block.model.key, json.dumps(block.values, sort_keys=True), "replay", repr(period)
    for run in np.unique(dataset.run):
        part = np.flatnonzero(dataset.run == run)
        start = {v.name: dataset.time[part[0]] for v in block.states if v.name == "clock"}
        start |= of_runs.get(int(run), {})
        with ExitStack() as stack:
            path = _exported(key, 2, stack, lambda folder: export_block(block, folder, 2))
            fmu = _Fmu(Component("estimator", "fmu", str(path), Fraction(1), start=start), path, stack)
            fmu.prepare(list(inputs), outputs)
            for k, i in enumerate(part):
                found[:, i] = fmu.exchange(k * period, rows[i])
                fmu.advance(k * period, period)
    return found


def _reference(dataset, model, parameters, name):
    """What the estimate of a joint torque is held against, at every sample.

    Where the study says that the reference shows something else than the joint torque (a weight that it does not know,
    a gain of its sensor), that is taken off again. Without a reference it is zero, and drops out of pairs.
    """
    if dataset.paired:
        return np.zeros(len(dataset.time))
    if dataset.asked == "balance":
        question = model.question("gravity_model").select([name])
        given = [dataset.signals.get(n, 0.0) for n in question.inputs] + [0.0] * len(question.states)
        return ArrayFunction(question.output)(given + [float(parameters[n]) for n in question.parameters],
                                              len(dataset.time))[0]
    measured, own = dataset.measured[name], dataset.aliases.get(name)
    if own is None:
        return measured
    shown = dataset.segment_signals(model, parameters, [name, own])
    return measured + shown[own] - shown[name] + dataset.behind(model, parameters).get(name, 0.0)

"""A model with its values and a log in; errors of its exported FMU, stepped by fmpy through that log, out.

The FMU is the estimator: what the rig estimates from the motion and, where it asks for them, the torques of the motors.
Those are joint torques; of a rig without a torque reference, the force, torque or voltage that the motion asks for. The
plant driven by the measured torques alone would drift away from any log within seconds, however right its friction is,
so that its angles would tell of nothing; what friction takes on the way is told by the estimator at every sample.
"""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import replace as replaced
from fractions import Fraction

import numpy as np

from ..compile import ArrayFunction, compile_model
from ..control.controllers import estimator
from ..core.errors import DataError, ExportError, StudyError
from ..core.extras import extra
from ..data.dataset import Dataset
from ..diagnosis.confirm import frozen
from ..export.controller import export_block
from .components import _exported, _Fmu
from .scenario import Component

_CANNOT = (StudyError, DataError, ExportError)  # no such FMU for this log or this computer

_READ = {"w": ("der({}.phi)",), "a": ("der(der({}.phi))", "der({}.w)")}  # input: what the data set may call it


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
        Its logs hold what the estimator takes; without a torque reference, half differences are compared. Logs that are
        one sample each are stepped through sample by sample, and the mean over each is compared.
    model : Model
        Its rig answers ``estimate``; with its effects.
    parameters : dict of str to float
        Of the model.

    Returns
    -------
    dict of str to float
        RMSE of each channel that the rig estimates (a joint torque, a force, a voltage), in its unit.

    Raises
    ------
    DataError
        The logs lack what the estimator takes.
    ExportError
        The FMU cannot be built, or there is no fmpy to step it.
    CosimulationError
        It refuses a step.
    """
    extra("fmpy", "a replay through the FMU", ExportError)
    stepped = _sampled(dataset)
    form = dataset.form if dataset.asked == "estimate" else 0
    names = model.alternatives("estimate")[form][0]
    signals = stepped.undelayed(stepped.ask(model), parameters)
    block = estimator(model, {n: parameters[n] for n in model.parameters}, form=form)
    inputs = {v.name: _signal(stepped, signals, v.name) for v in block.inputs}
    estimates = _stepped(block, inputs, names, stepped, _of_runs(stepped, model, parameters))
    found = {}
    for name, estimate in zip(names, estimates):
        error = _reference(stepped, model, parameters, name) - estimate
        if dataset.averaged:
            error = np.bincount(stepped.run, error) / np.bincount(stepped.run)
        error = sum(weight * take(error) for weight, _, take in dataset.picks("all"))
        found[f"{name}_pair" if dataset.paired else name] = float(np.sqrt(np.mean(error ** 2)))
    return found


def _sampled(dataset):
    """The same logs with all their samples, where a data set has the mean of each."""
    if not dataset.averaged:
        return dataset
    return dataset.memo("replay.sampled", lambda: Dataset(replaced(dataset.study, average=None), dataset.library))


def _signal(dataset, signals, name):
    """Values of an input of the estimator at every sample; a push that no log holds is none."""
    owner, _, what = name.rpartition(".")
    known = [*(n.format(owner) for n in _READ.get(what, ())), name]
    found = next((s[n] for n in known for s in (signals, dataset.measured) if n in s), None)
    if found is None and name.startswith("push"):
        return np.zeros(len(dataset.time))
    if found is None:
        raise DataError(f"{dataset.logs[0].path}: holds no '{name}', which the estimator of {dataset.study.rig} "
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


def _stepped(block, inputs, outputs, dataset, of_runs):
    """Outputs (outputs, n) of a block's FMU: a communication step a sample, a new instance a run."""
    found = np.empty((len(outputs), len(dataset.time)))
    rows = np.array(list(inputs.values())).T
    key = block.model.key, json.dumps(block.values, sort_keys=True), "replay", ",".join(outputs)
    for run in np.unique(dataset.run):
        part = np.flatnonzero(dataset.run == run)
        period = float(np.median(np.diff(dataset.time[part])))
        start = {v.name: dataset.time[part[0]] for v in block.states if v.name == "clock"}
        start |= {"period": period} | of_runs.get(int(run), {})
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

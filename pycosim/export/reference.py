"""A plant in; what its FMU must compute for given inputs, as files for whoever imports it, out."""

from __future__ import annotations

import numpy as np

from ..core.errors import ModelicaError
from ..dynamics.simulate import dynamics, simulate
from .description import c_name

STEP = 1e-3      # s; a communication step
DURATION = 0.5   # s
EVERY = 10       # steps from one row of results to the next
FAST = 50.0      # rad/s; inputs are halved until nothing turns faster
_TRIES = 12


def reference_results(plant):
    """Inputs, results and how they were made, in the format of the FMI cross-check.

    Parameters
    ----------
    plant : Plant
        A machine, not a sampled model.

    Returns
    -------
    dict of str to bytes
        ``_in.csv``, ``_ref.csv`` and ``_ref.opt`` by their path in the FMU: inputs, held from one row to the next, and
        outputs, each read at the end of a step; empty where no inputs were found that the machine can follow.
    """
    time = np.arange(round(DURATION / STEP) + 1) * STEP
    inputs = [e.name for e in plant.entries if e.causality == "input"]
    starts = {e.name: e.variable.value for e in plant.entries if e.causality == "parameter"}
    waves = np.array([np.sin(2 * np.pi * (2 + k) * time) for k in range(len(inputs))]).reshape(len(inputs), len(time))
    for size in 0.5 ** np.arange(_TRIES):
        given = dict(zip(inputs, np.round(size * waves, 6)))
        driven = {n: given[i] * starts.get(f"k_m_{i}", 1.0) for n, i in zip(dynamics(plant.model).inputs, inputs)}
        try:
            found = simulate(plant.model, driven, time, plant.parameters, hold=True)
        except ModelicaError:
            continue
        speeds = [np.abs(found[e.name]).max() for e in plant.entries if e.name in found and e.variable.unit == "rad/s"]
        if max(speeds, default=0.0) <= FAST:
            break
    else:
        return {}
    results = [e.name for e in plant.entries if e.causality == "output" and e.name in found]
    options = ["StartTime, 0.0", f"StopTime, {DURATION}", f"StepSize, {STEP}", "RelTol, 0.0001"]
    rows = {"in.csv": _csv(time, given), "ref.csv": _csv(time[::EVERY], {n: found[n][::EVERY] for n in results}),
            "ref.opt": "\n".join([*options, ""])}
    return {f"documentation/reference/{c_name(plant.name)}_{n}": text.encode() for n, text in rows.items()}


def _csv(time, columns):
    lines = [",".join(["time", *columns])]
    lines += [",".join(f"{v:.9g}" for v in row) for row in zip(time, *columns.values())]
    return "\n".join([*lines, ""])

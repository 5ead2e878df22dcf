"""Signals and a time constant in; the signals as a filter of first order gives them, and their slope by it, out.

Between samples the signal is taken as straight, over a gap too: there a reversal lies mostly, across which it goes from
one level to the other.
"""

from __future__ import annotations

import numpy as np

from ..compile import ArrayFunction
from .states import scan


def recorded(question, outputs, values, time, run, parameters):
    """Outputs of a question as they are recorded, where filters hold some of them back.

    Parameters
    ----------
    question : Question
        Its ``held`` names the components, and what says the time constant [s].
    outputs : dict of str to str
        Outputs, and the component whose reference each of them is.
    values : dict of str to ndarray, shape (n,)
        Of the outputs among others, before the filters.
    time, run : ndarray, shape (n,)
        Of the samples [s], and the number of the log that each belongs to.
    parameters : dict of str to float
        Time constants [s] among them.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        The values; the same dict where nothing is held back.
    """
    held = {n: c for n, c in outputs.items() if c in question.held and n in values}
    if not held:
        return values
    lags = settings(question, [question.held[c] for c in held.values()], parameters)
    return {**values, **{n: first_order(values[n][None], lag, time, run)[0][0] for n, lag in zip(held, lags)}}


def settings(question, outputs, parameters):
    """Outputs of a question that its parameters alone decide: delays and time constants of what is recorded.

    Parameters
    ----------
    question : Question
        Has the outputs.
    outputs : list of str
        As in ``late`` and ``held`` of the question.
    parameters : dict of str to float
        All of the question's.

    Returns
    -------
    ndarray, shape (outputs,)
    """
    chosen = question.select(outputs)
    return ArrayFunction(chosen.output)([0.0] * (len(chosen.inputs) + len(chosen.states))
                                        + [float(parameters[n]) for n in chosen.parameters], 1)[:, 0]


def first_order(values, lag, time, run):
    """Signals after a filter of first order.

    Parameters
    ----------
    values : ndarray, shape (k, n)
        Signals before the filter, one a row, in any units.
    lag : float
        Time constant [s]; none from zero on down.
    time, run : ndarray, shape (n,)
        Of the samples; each log starts at rest, where the filter has caught up.

    Returns
    -------
    filtered, by_lag : ndarray, shape (k, n)
        The second is the derivative by the time constant, in the signals' units a second.
    """
    lag, same = max(float(lag), 1e-9), np.diff(run) == 0
    step = np.where(same, np.maximum(np.diff(time), 1e-9), 1.0)
    rise, kept, share = np.diff(values) * same, np.exp(-step / lag) * same, -np.expm1(-step / lag)
    growth = np.broadcast_to(kept, rise.shape)
    ahead = scan(growth, rise * share * lag / step)
    slope = scan(growth, ahead[:, :-1] * kept * step / lag ** 2 + rise * (share / step - kept / lag))
    return values - ahead, -slope

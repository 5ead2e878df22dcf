"""Model and known variables over time in, all other variables out: motion, joint torques or motor torques.

``simulate`` integrates motor torques to motion, step by step with the very function that an FMU takes along;
``estimate`` and ``compensate`` answer the explicit questions of a rig over arrays of samples.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, fields, replace

import casadi as ca
import numpy as np

from ..compile import ArrayFunction, solve
from ..core import cache
from ..core.errors import DataError, ModelicaError, UnknownNameError, closest
from .delays import undo
from .filters import recorded
from .states import propagate
from .stepping import GAP, TOLERANCE, System, gap, in_parts, steps

__all__ = ["Dynamics", "answer", "compensate", "dynamics", "estimate", "propagate", "simulate", "step_function"]

_CHUNK = 500  # steps at a time
_LITTLE = 4    # steps at a time after one that had to be made in parts; then twice as many again and again


@dataclass
class Dynamics:
    """A rig as a differential-algebraic system of index 1, ready to be stepped.

    Attributes
    ----------
    inputs, states, algebraic, parameters, outputs : list of str
        Names of the elements of the vectors below; outputs are all other variables of the rig.
    start : dict of str to str
        Name that ``start`` may give, to the state that carries it.
    speeds : list of int or None
        For each state, the number of the state that is its derivative.
    prepare : casadi.Function
        ``p -> q``: the parameters, and what they alone ask for; the next two take it, many times.
    initial : casadi.Function
        ``(x, z, u, q, t) -> z``: algebraic variables that fit the states, from a guess.
    step : casadi.Function
        ``(x, z, u0, u1, q, t, h) -> (x_next, z_next, error)`` after ``h`` seconds, inputs linear in between (order 2,
        L-stable: short travels do not limit the step). ``z`` is a guess; ``z_next`` fits ``x_next`` and ``u1``. Above
        1, or not a number, ``error`` says that the equations were not solved.
    output : casadi.Function
        ``(x, z, u, p, t) -> outputs``, for a ``z`` that fits.
    """

    inputs: list
    states: list
    algebraic: list
    parameters: list
    outputs: list
    start: dict
    speeds: list
    prepare: ca.Function
    initial: ca.Function
    step: ca.Function
    output: ca.Function


def dynamics(model, tolerance=TOLERANCE):
    """Compile the ``simulate`` question of a model; made once a model.

    Parameters
    ----------
    model : pycosim.compile.Model
        Whose rig says in its annotation what ``simulate`` is given.
    tolerance : float
        Largest last correction of a step's unknowns, relative; single precision needs more than the default.

    Returns
    -------
    Dynamics

    Raises
    ------
    StudyError
        The rig's annotation has no ``simulate``.
    """
    key = cache.digest(model.key, "dynamics", repr(tolerance))
    return model.library.memo(("dynamics", model.key, tolerance), lambda: cache.remember(
        "dynamics", key, lambda: _dynamics(model, tolerance), _dump, _load))


def _dynamics(model, tolerance):
    wanted, known = model.alternatives("simulate")[0]
    known = [n for n in known if n != "time"]  # a rig whose inputs are bound says "from time"
    flat = replace(model.flat)  # solving adds derivatives to it
    solution = solve(flat, known, keep=wanted, explicit=False)
    symbols, values = solution.symbols, solution.values
    parameters = list(flat.parameters)
    x, z, u, p = (ca.vertcat(*[symbols[n] for n in names], ca.SX(0, 1))
                  for names in (solution.states, solution.algebraic, known, parameters))
    rates = [values.get(flat.derivatives[n], symbols[flat.derivatives[n]]) for n in solution.states]
    outputs = [n for n in flat.variables if n in values and n not in known]
    friction = [i for i, n in enumerate(solution.states) if (flat.variables[n].min, flat.variables[n].max) == (-1, 1)]
    made = steps(System(x, z, u, p, symbols["time"], rates, solution.residuals, friction), tolerance)
    start = {n: n for n in solution.states}
    start.update({n: values[n].name() for n in outputs if values[n].is_symbolic() and values[n].name() in start})
    y = ca.cse(ca.densify(ca.vertcat(*[values[n] for n in outputs])))
    output = ca.Function("output", [x, z, u, p, symbols["time"]], [y], ["x", "z", "u", "p", "t"], ["y"])
    rates = [r.name() if r.is_symbolic() else None for r in rates]
    speeds = [solution.states.index(n) if n in solution.states else None for n in rates]
    return Dynamics(known, solution.states, solution.algebraic, parameters, outputs, start, speeds,
                    made.prepare, made.initial, made.step, output)


def _dump(made):
    return json.dumps({n: v.serialize() if isinstance(v, ca.Function) else v for n, v in vars(made).items()}).encode()


def _load(data):
    found = json.loads(data)
    functions = {f.name: ca.Function.deserialize(found[f.name]) for f in fields(Dynamics) if f.type == "ca.Function"}
    return Dynamics(**{**found, **functions})


def step_function(model, h=None):
    """One step of a rig as a CasADi function, from which C can be generated.

    Parameters
    ----------
    model : pycosim.compile.Model
        As of `dynamics`.
    h : float, optional
        Step [s]; without it the step stays the last argument.

    Returns
    -------
    casadi.Function
        ``(x, z, u0, u1, p, t) -> (x_next, z_next, error)``; names of the elements are in ``dynamics(model)``.
    """
    d = dynamics(model)
    whole = with_parameters(d, d.step, "step")
    if h is None:
        return whole
    a = whole.mx_in()[:-1]
    return ca.Function("step", a, whole.call([*a, ca.MX(h)]), whole.name_in()[:-1], whole.name_out())


def with_parameters(d, function, name):
    """A function of a rig that takes its parameters as they are.

    Parameters
    ----------
    d : Dynamics
        Whose function it is.
    function : casadi.Function
        ``initial`` or ``step``.
    name : str
        Of the new one.

    Returns
    -------
    casadi.Function
        With ``p`` where the given one takes ``q``.
    """
    given, at = function.mx_in(), function.name_in().index("q")
    a = [*given[:at], ca.MX.sym("p", d.prepare.sparsity_in(0)), *given[at + 1:]]
    names = ["p" if k == at else n for k, n in enumerate(function.name_in())]
    return ca.Function(name, a, function.call([*a[:at], d.prepare(a[at]), *a[at + 1:]]), names, function.name_out())


def simulate(model, inputs, time, parameters=None, start=None, step=1e-3, hold=False):
    """Motion from motor torques (or voltages) and outside torques.

    Parameters
    ----------
    model : pycosim.compile.Model
        As of `dynamics`.
    inputs : dict of str to float or ndarray, shape (n,)
        Inputs of the rig, linear between samples; those not given are zero.
    time : ndarray, shape (n,)
        Samples [s], increasing.
    parameters : dict of str to float, optional
        Instead of the model's defaults.
    start : dict of str to float, optional
        States at the first sample, as ``q_H`` [rad]; the others, speeds among them, start at zero.
    step : float
        Longest step [s].
    hold : bool
        Hold each input from its sample to the next instead.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        Every variable of the rig at the samples.

    Raises
    ------
    UnknownNameError
        An input, parameter or state of this name does not exist.
    DataError
        Time does not increase, or an input has another length.
    ModelicaError
        The equations have no solution on the way, as for a joint without inertia.
    """
    d = dynamics(model)
    time = _times(time)
    u = _rows(d.inputs, inputs, len(time), f"input of {model.rig}")
    p = np.array(list(_parameters(model, parameters).values()))
    start = start or {}
    _check(start, d.start, f"state of {model.rig}")
    x = np.zeros(len(d.states))
    for name, value in start.items():
        x[d.states.index(d.start[name])] = value
    x, z = _march(model.rig, d, x, u, p, time, step, hold)
    left = np.hstack([u[:, :1], u[:, :-1]]) if hold else u
    y = _arrays(model, ("simulate",), d.output)([*x, *z, *left, *p, time], len(time))
    result = {**dict(zip(d.states, x)), **dict(zip(d.outputs, y)), **dict(zip(d.inputs, u))}
    return {n: result.get(n, a) for n, a in [*zip(d.algebraic, z), *result.items()]}


def _march(rig, d, x, u, p, time, step, hold):
    """States and algebraic variables at the samples."""
    count = np.maximum(1, np.ceil(np.diff(time) / step - 1e-6)).astype(int)
    owner = np.repeat(np.arange(len(count)), count)
    part = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    h = (np.diff(time) / count)[owner]
    left, right = u[:, owner], u[:, owner + 1]
    u0 = left if hold else left + (right - left) * (part / count[owner])
    u1 = left if hold else left + (right - left) * ((part + 1) / count[owner])
    t, n, q = time[owner] + part * h, len(x), np.array(d.prepare(p)).ravel()
    states, algebraic = np.empty((n, len(h) + 1)), np.empty((len(d.algebraic), len(h) + 1))
    states[:, 0], a, size = x, 0, _CHUNK
    columns = np.broadcast_to(q[:, None], (len(q), _CHUNK))
    try:
        algebraic[:, :1] = d.initial(x, np.zeros(len(d.algebraic)), u[:, 0], q, time[0])
        if not np.isfinite(algebraic[:, 0]).all():
            raise RuntimeError
        while a < len(h):
            b = min(a + size, len(h))
            walk = d.step.mapaccum("walk", b - a, 2)
            xs, zs, errors = (np.array(v) for v in walk(states[:, a], algebraic[:, a], u0[:, a:b], u1[:, a:b],
                                                        columns[:, :b - a], t[None, a:b], h[None, a:b]))
            before = np.column_stack([states[:, a], xs[:, :-1]])
            fine = (errors[0] <= 1) & (gap(before, xs, h[a:b], d.speeds) <= GAP)
            good = b - a if fine.all() else int(np.argmin(fine))
            states[:, a + 1:a + good + 1], algebraic[:, a + 1:a + good + 1] = xs[:, :good], zs[:, :good]
            a, size = a + good, min(_CHUNK, 2 * size)
            if a < b:
                found = in_parts(d, states[:, a], algebraic[:, a], u0[:, a], u1[:, a], q, t[a], h[a])
                if not found:
                    raise RuntimeError
                states[:, a + 1], algebraic[:, a + 1] = found
                a, size = a + 1, _LITTLE
    except RuntimeError:
        when = t[a] if len(t) else time[0]
        raise ModelicaError(f"{rig}: no solution near t = {when:g} s; check that every joint has inertia and that the "
                            f"inputs are finite, or take a step below {step:g} s") from None
    at = np.r_[0, np.cumsum(count)]
    return states[:, at], algebraic[:, at]


def estimate(model, signals, time, parameters=None, form=0):
    """What a rig's ``estimate`` asks for, as joint torques from motion and motor torques.

    Parameters
    ----------
    model : pycosim.compile.Model
        Whose rig says in its annotation what ``estimate`` is given and asked for.
    signals : dict of str to float or ndarray, shape (n,)
        Known variables, and their derivatives as ``der(motor1.phi)``; a derivative that is not given is taken by
        central differences of its variable.
    time : ndarray, shape (n,)
        Samples [s], increasing; friction states start at zero at the first.
    parameters : dict of str to float, optional
        Instead of the model's defaults.
    form : int
        Which of the alternatives in the rig's annotation.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        What was asked for, and speed, load and loss of every segment among others.

    Raises
    ------
    StudyError
        The rig's annotation has no ``estimate``.
    UnknownNameError
        The rig has no such variable or parameter.
    DataError
        A known variable is missing, or has another length.
    """
    return answer(model, "estimate", signals, time, parameters, form)


def compensate(model, signals, time, parameters=None, form=0):
    """What a rig's ``compensate`` asks for, as motor torques for wanted joint torques.

    Parameters
    ----------
    model : pycosim.compile.Model
        Whose rig says in its annotation what ``compensate`` is given and asked for.
    signals : dict of str to float or ndarray, shape (n,)
        Motion and wanted torques, and derivatives as ``der(motor1.phi)``; one that is not given is taken by central
        differences.
    time : ndarray, shape (n,)
        Samples [s], increasing; friction states start at zero at the first.
    parameters : dict of str to float, optional
        Instead of the model's defaults.
    form : int
        Which of the alternatives in the rig's annotation.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        What was asked for, and speed, load and loss of every segment among others.

    Raises
    ------
    StudyError
        The rig's annotation has no ``compensate``.
    UnknownNameError
        The rig has no such variable or parameter.
    DataError
        A known variable is missing, or has another length.
    """
    return answer(model, "compensate", signals, time, parameters, form)


def answer(model, name, signals, time, parameters=None, form=0):
    """What a rig's annotation asks for under a name, as `estimate` and `compensate` do under theirs.

    Parameters
    ----------
    model : pycosim.compile.Model
        Whose rig has that key.
    name : str
        Key of the annotation, as ``gravity_model``.
    signals, time, parameters, form
        As of `estimate`.

    Returns
    -------
    dict of str to ndarray, shape (n,)

    Raises
    ------
    StudyError, UnknownNameError, DataError
        As of `estimate`.
    """
    question = model.question(name, form)
    time = _times(time)
    values = _parameters(model, parameters)
    strange = set(signals) - set(question.inputs) - set(question.outputs)
    if strange:
        _check(sorted(strange), [*question.inputs, *model.variables], f"variable of {model.rig}")
    if question.late:
        row = _late_rows(question, signals, time)
        signals = {**signals, **undo(question, row, time, np.zeros(len(time)), values)} if row else signals
    known = _known(model, name, question, signals, time)
    x = propagate(question, known, time, values)[0]
    p = [values[n] for n in question.parameters]
    y = _arrays(model, (name, form), question.output)([*known.values(), *x, *p], len(time))
    shown = {f"{c}.{n}": c for c in question.held for n in ("sensed", "computed")}
    return recorded(question, shown, dict(zip(question.outputs, y)), time, np.zeros(len(time)), values)


def _late_rows(question, signals, time):
    """Signals that a question wants at other times, derivatives filled in; nothing where one is missing."""
    rows = {n: _row(n, signals[n], len(time)) for n in (*question.inputs, *question.late) if n in signals}
    for n in question.late:  # an angle comes before its speed
        if n not in rows and n.startswith("der(") and n[4:-1] in rows:
            rows[n] = _gradient(rows[n[4:-1]], time)
    return {n: rows[n] for n in question.late} if all(n in rows for n in question.late) else {}


def _gradient(values, time):
    return np.gradient(values, time) if len(time) > 1 else np.zeros(len(time))


def _known(model, name, question, signals, time):
    """Inputs of a question in its order, derivatives filled in."""
    known = {}
    for n in question.inputs:
        inner = n[4:-1]
        if n == "time":
            known[n] = time
        elif n in signals:
            known[n] = _row(n, signals[n], len(time))
        elif n.startswith("der(") and inner in known:
            known[n] = _gradient(known[inner], time)
        else:
            raise DataError(f"to {name}, {model.rig} needs '{n}'; give it for every sample")
    return known


def _arrays(model, key, function):
    return model.library.memo(("arrays", model.key, *key), lambda: ArrayFunction(function.expand()))


def _times(time):
    time = np.asarray(time, float)
    if time.ndim != 1 or not len(time):
        raise DataError(f"time has shape {time.shape}; give one value a sample")
    later = np.diff(time) > 0
    if not later.all():
        k = int(np.argmin(later)) + 1
        raise DataError(f"time does not increase at sample {k}: {time[k - 1]:g} s, then {time[k]:g} s")
    return time


def _row(name, value, n):
    value = np.asarray(value, float)
    if value.ndim and value.shape != (n,):
        raise DataError(f"'{name}' has shape {value.shape}, time has {n} samples; give one value a sample")
    return np.ascontiguousarray(np.broadcast_to(value, n))


def _rows(names, given, n, what):
    _check(given, names, what)
    return np.array([_row(name, given.get(name, 0.0), n) for name in names]).reshape(len(names), n)


def _parameters(model, given):
    values = {n: v.value for n, v in model.parameters.items()}
    _check(given or {}, values, f"parameter of {model.rig}")
    values.update({n: float(v) for n, v in (given or {}).items()})
    return values


def _check(names, known, what):
    for name in names:
        if name not in known:
            kind, _, rig = what.partition(" of ")
            raise UnknownNameError(f"no {kind} '{name}' in {rig}{closest(name, known)}")

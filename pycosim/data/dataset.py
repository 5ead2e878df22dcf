"""Logs, study and model in; samples arranged for fitting out: channels, moving ones, blocks, held-out part, pairs."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import casadi as ca
import numpy as np
from scipy.ndimage import median_filter

from ..compile import ArrayFunction, catalogue, compile_model, component_name
from ..core.errors import DataError, StudyError
from ..dynamics.delays import Record, undo
from ..dynamics.filters import first_order, settings
from ..dynamics.states import dependent_parameters, propagate
from . import instruments, segmentation, turns
from .derivatives import derivatives, passed_on, resolution
from .logs import load, require, require_alike
from .noise import contiguous
from .residuals import Held, Residuals, Term
from .scales import Sizes

FOLDS = 5
_ENDS = {"min": min, "max": max}  # of what a place travels over
SPEEDS = {"phi": "w", "s": "v"}  # of a rotating and of a sliding component: position and speed
SMOOTH = 5  # degree of the polynomial of the configuration that the torque of a load is predicted by
AROUND, OUT = 7, 6.0  # samples whose median one is compared with, and scatters that it must be off to be out of line
_FEW = 20  # samples of a pass or a direction, of which nothing is predicted
JUMP = 0.1  # s from the ends of a pass, in which a torque recorded late may jump


class Dataset:
    """Measurements of a study, ready to be compared with models of its rig.

    Parameters
    ----------
    study : Study
    library : Library
    logs : list of Log, optional
        Already read; else the study's files are read.

    Attributes
    ----------
    channels : list of str
        Names of the errors: ``C_H``, or ``C_H_pair`` when no reference was measured.
    paired : bool
    time, run : ndarray, shape (n,)
    signals : dict of str to ndarray, shape (n,)
        Inputs of the model's question.
    measured : dict of str to ndarray, shape (n,)
        Everything measured, by model variable.
    moving : ndarray of bool, shape (n,)
    speed_unit : str
        Of the segments' speeds.
    w_min : float
        Speed above which a segment moves, of the segment where that is highest.
    block : ndarray of int, shape (n,)
        Block of each sample.
    is_test : ndarray of bool, shape (blocks,)
    by_run : bool
        Whether folds are whole logs: those are then what is independent, not the blocks of one.
    """

    def __init__(self, study, library, logs=None):
        self.study, self.library, self._memo = study, library, {}
        self.logs = load(study) if logs is None else logs
        self.base = compile_model(library, study.rig, study.effects)
        self._choose_question()
        self._gather()
        self._scatters = {}
        self._derive()
        self._segment()
        self._size()
        self._split()
        self._views, self._slopes, self._records = {}, {}, {}

    # ---- what is known, what is compared

    def _choose_question(self):
        have = {v for log in self.logs for v in log.signals}
        self.asked, forms = "estimate", self.base.alternatives("estimate")
        self.form = next((k for k, (wanted, _) in enumerate(forms) if all(w in have for w in wanted)), None)
        balanced = self.form is None and self.study.reference == "gravity_model"
        self.paired = self.form is None and not balanced
        self.form = self.form or 0
        named = forms[self.form][0]
        if balanced:  # what the leg's model asks for beyond the transmission's torque is the error
            self.asked, forms = "balance", self.base.alternatives("balance")
        self.outputs, self.known = forms[self.form]
        self._choose_outputs(named, balanced, have)
        require_alike(self.logs, self.outputs)
        if self.paired and self.study.reference != "unknown":
            raise StudyError(f'{self.study.path}: reference = "{self.study.reference}", but no log holds '
                             f'{", ".join(self.outputs)}; log that, or write reference = "unknown"')
        self.question = self.ask(self.base)

    def _choose_outputs(self, named, balanced, have):
        """Channels, and which variables of the model stand for them."""
        self.channels = [f"{c}_pair" for c in named] if self.paired else list(named)
        self.aliases, self.zeros = {}, []
        if not balanced:  # a computed reference knows the load alone
            self.aliases = self.base.aliases("sensor" if self.study.reference == "sensor" else "load")
        for channel, reading in self.base.aliases("encoders").items():
            if channel in have and not self.paired:
                self.aliases[channel], _, zero = reading.partition(":")
                self.outputs = [*self.outputs, channel]
                self.channels.append(channel)
                self.zeros.append(zero)

    def ask(self, model):
        """The question that a model of this rig is asked about these data.

        On moving samples a segment's own state is at its limit, at rest, so that its damping adds nothing.

        Parameters
        ----------
        model : Model

        Returns
        -------
        Question
        """
        question = model.question(self.asked, self.form, tuple(self.aliases.items()))
        return question.fixed({n: 0.0 for n in (f"{c}.damping" for c in model.segments) if n in question.parameters})

    def _gather(self):
        mapped = {c.variable for c in self.study.columns.values()}
        for log in self.logs:  # an unmeasured push from outside is none
            require(log, [k for k in self.known if k in mapped or not k.startswith("push")])
        self.time = np.concatenate([log.time for log in self.logs])
        self.run = np.concatenate([np.full(len(log.time), k) for k, log in enumerate(self.logs)])
        shared = set.intersection(*[set(log.signals) for log in self.logs])
        self.measured = {v: np.concatenate([log.signals[v] for log in self.logs]) for v in sorted(shared)}
        self.labels = (np.concatenate([log.labels for log in self.logs])
                       if all(log.labels is not None for log in self.logs) else None)

    def memo(self, key, make):
        """Return ``make()``, computed once a key and kept as long as this object.

        Parameters
        ----------
        key : hashable
            Begins with the name of who asks.
        make : callable
            Without arguments.

        Returns
        -------
        object
        """
        if key not in self._memo:
            self._memo[key] = make()
        return self._memo[key]

    @property
    def units(self):
        """Unit of each channel."""
        return {c: self.base.unit(c) for c in self.channels}

    # ---- motion

    def _derive(self):
        """Speeds and accelerations of what is known, without phase lag, from angles and the speeds beside them."""
        self.signals = {k: self.measured[k] for k in self.known if k in self.measured}
        self.signals["time"] = self.time
        self._spread, self._followed = {}, {}
        for name in [n for n in self.question.inputs if n.startswith("der(") and n.count("(") == 1]:
            angle = name[4:-1]
            speed = self.measured.get(self.speed_beside(angle))
            first, second = np.zeros(len(self.time)) if speed is None else speed.copy(), np.zeros(len(self.time))
            variance = []
            for k, log in enumerate(self.logs):
                part = self.run == k
                if np.count_nonzero(part) > 1:
                    try:
                        found = derivatives(self.time[part], self.measured[angle][part],
                                            None if speed is None else speed[part])
                    except DataError as error:
                        raise DataError(f"{log.path}: {error}; record more, or leave the log out") from None
                    first[part], second[part] = found.first, found.second
                    variance.append(found.noise**2)
                    self._followed[angle, k] = found.bandwidth, found.trust
            self.signals[name], self.signals[f"der({name})"] = first, second
            self._spread[name] = np.sqrt(np.mean(variance)) if variance else 0.0
        read = {n for effect in catalogue(self.library).values() for n in effect.measured}  # effects may come yet
        for name in [*self.question.inputs, *sorted(read)]:
            if name in self.measured:
                self.signals.setdefault(name, self.measured[name])

    @staticmethod
    def speed_beside(angle):
        """Name that the recorded speed of an angle or a position has, if there is one.

        Parameters
        ----------
        angle : str

        Returns
        -------
        str or None
        """
        component, _, kind = angle.rpartition(".")
        return f"{component}.{SPEEDS[kind]}" if kind in SPEEDS else None

    def passed_on(self, angle, share=1.0):
        """The smooth motion behind a recorded angle and its recorded speed, or what small errors of both become there.

        Parameters
        ----------
        angle : str
            Variable whose derivatives the model is given.
        share : float
            Of the bandwidth that the record was followed with.

        Returns
        -------
        callable
            Takes angle and speed, ndarrays of shape (n,); gives a dict of str to ndarray, shape (n,), the angle and
            its first and second derivative by their names.
        """
        parts = [(self.run == k, passed_on(self.time[self.run == k], share * band, trust))
                 for (name, k), (band, trust) in self._followed.items() if name == angle and band > 0]
        names = angle, f"der({angle})", f"der(der({angle}))"

        def derived(of_angle, of_speed):
            found = {n: np.zeros(len(self.time)) for n in names}
            for part, follow in parts:
                for name, values in zip(names, follow(of_angle[part], of_speed[part])):
                    found[name][part] = values
            return found
        return derived

    def motion(self, angle, share):
        """An angle and its derivatives as they are with a part of the bandwidth: with much less noise, and less sharp.

        Parameters
        ----------
        angle : str
        share : float
            Of the bandwidth that the record was followed with.

        Returns
        -------
        dict of str to ndarray, shape (n,)
            By their names.
        """
        def make():
            values = instruments.smooth(self.time, self.measured[angle], self.run)
            return self.passed_on(angle, share)(values, self.measured.get(self.speed_beside(angle), values))
        return self.memo(("dataset.motion", angle, share), make)

    @property
    def followed(self):
        """Angles and positions whose speeds and accelerations are derived from the record."""
        return list(dict.fromkeys(name for name, _ in self._followed))

    def segment_signals(self, model, parameters, names, states=None, signals=None):
        """Outputs of the model at every sample, such as ``s1A.w`` and ``s1A.L``.

        Parameters
        ----------
        model : Model
        parameters : dict of str to float
        names : list of str
            Those that are no outputs are left out.
        states : ndarray, shape (states, n), optional
            Friction states; followed along the log by default.
        signals : dict of str to ndarray, shape (n,), optional
            Instead of those recorded, as `exogenous` gives them.

        Returns
        -------
        dict of str to ndarray, shape (n,)
        """
        question = self.ask(model)
        names = [n for n in names if n in question.outputs]
        if states is None:
            states = self.states(model, parameters)[0]
        chosen = question.select(names)
        signals = self.undelayed(question, parameters, signals)
        own = self.own(model)
        arguments = ([signals.get(n, 0.0) for n in chosen.inputs] + list(states)
                     + [self._by_run(own[n], n, parameters) if n in own else float(parameters[n])
                        for n in chosen.parameters])
        values = ArrayFunction(chosen.output)(arguments, len(self.time))
        return dict(zip(names, values))

    def states(self, model, parameters, free=()):
        """Friction states at every sample, and their sensitivities.

        The segments' own states are at their sliding limit, the sign of the speed, which holds on moving samples; the
        states of effects are followed along the log, from what the angles moved between samples.

        Parameters
        ----------
        model : Model
        parameters : dict of str to float
        free : sequence of str
            Parameters whose sensitivities are wanted.

        Returns
        -------
        states : ndarray, shape (number of states, n)
        sensitivities : ndarray, shape (len(free), number of states, n)

        Raises
        ------
        ModelicaError
            A state of an effect is coupled to another, or its rate is not made of one or two straight pieces.
        """
        question = self.ask(model)
        own = [f"{c}.z" for c in model.segments]
        followed = [s for s in question.states if s not in own]
        states, sensitivities = np.zeros((len(question.states), len(self.time))), np.zeros(
            (len(free), len(question.states), len(self.time)))
        if followed and not self.averaged:
            states, sensitivities = propagate(question, self.signals, self.time, parameters, self.run, free, followed)
        for k, name in enumerate(question.states):
            if name in own or self.averaged:
                component = name.rsplit(".", 1)[0] if name in own else next(iter(model.segments))
                states[k] = np.sign(self.speeds[list(model.segments).index(component)])
                sensitivities[:, k] = 0.0
        return states, sensitivities

    def undelayed(self, question, parameters, signals=None):
        """Signals at the times they tell of, for a model that delays their record; else as recorded.

        Parameters
        ----------
        question : Question
        parameters : dict of str to float
        signals : dict of str to ndarray, shape (n,), optional
            Instead of those recorded, as `exogenous` gives them.

        Returns
        -------
        dict of str to ndarray, shape (n,)
            The same dict where nothing is delayed; else with each delay [s], a number, under ``at(x)``.
        """
        signals = self.signals if signals is None else signals
        if not question.late:
            return signals
        still = self.memo("dataset.still", lambda: np.zeros(len(self.time)))  # no push
        unmeasured = {n: still for n in question.late if n not in signals}
        return undo(question, {**unmeasured, **signals}, self.time, self.run, parameters,
                    {n: self._slope(n) for n in question.late if not _is_motion(n)},
                    self._held_back, self._record, self._shape if signals is self.signals else None)

    def _record(self, values):
        """A recorded signal that can be read at other times."""
        if id(values) not in self._records:
            self._records[id(values)] = Record(self.time, values, self.run)  # holds them
        return self._records[id(values)]

    def _held_back(self, name, lag):
        """What a filter of first order holds back of what the motion predicts of a torque, and its slope by the lag."""
        smooth = self.memo(("dataset.settled", name), lambda: self._settled(self.signals.get(name, 0.0 * self.time)))
        (filtered,), (by_lag,) = first_order(smooth[None], lag, self.time, self.run)
        return smooth - filtered, -by_lag

    def _settled(self, values):
        """What the motion predicts of a torque from samples at which a filter has caught up, between turns.

        A sample below the least speed that goes the way of its neighbour is as that.
        """
        starts = np.append(True, (np.diff(self.passes) != 0) | (np.diff(self.run) != 0))
        start = np.maximum.accumulate(np.where(starts, np.arange(len(values)), 0))
        found = self._predict(values, self.moving & (self.time - self.time[start] > JUMP))
        way = np.sign(self.speeds)
        turns = np.flatnonzero(np.any(np.diff(way, axis=1) != 0, axis=0) | (np.diff(self.run) != 0)) + 1
        for part in np.split(np.arange(len(values)), turns):
            moving = part[self.moving[part]]
            if moving.size:
                found[part[0]:moving[0]], found[moving[-1] + 1:part[-1] + 1] = found[moving[0]], found[moving[-1]]
        return found

    def _slope(self, name):
        """Slope of what the motion alone predicts of a signal, well inside the passes.

        It is zero near their ends, where a torque recorded late jumps, and tells of that jump and of no slope.
        """
        if name not in self._slopes:
            found, values = np.zeros(len(self.time)), self.exogenous().get(name, np.zeros(len(self.time)))
            for s, reach, inside in self._passes():
                ahead, behind = (np.interp(self.time[s] + sign * reach, self.time[s], values[s]) for sign in (1, -1))
                found[s] = np.where(inside, ahead - behind, 0.0) / max(2 * reach, 1e-300)
            self._slopes[name] = found
        return self._slopes[name]

    def _shape(self, name):
        """What the motion alone predicts of a signal, well inside the passes; NaN where a late torque may jump."""
        def make():
            found, values = np.full(len(self.time), np.nan), self.exogenous().get(name, np.zeros(len(self.time)))
            for s, _, inside in self._passes():
                found[s][inside] = values[s][inside]
            return found
        return self.memo(("dataset.shape", name), make)

    def _passes(self):
        """Samples of each pass, how far from its ends a torque recorded late may jump [s], and which are beyond."""
        for s in contiguous(self.time, self.passes):
            if self.passes[s.start] >= 0:
                time = self.time[s]
                reach = min(JUMP, 0.2 * (time[-1] - time[0]))
                yield s, reach, (time >= time[0] + reach) & (time <= time[-1] - reach) & (reach > 0)

    def exogenous(self):
        """Signals with every measured torque replaced by what the motion alone predicts of it.

        Noise of a measured torque is in the residual and in every column computed from that torque; the two must not
        meet in a test, or each log would seem to lack a torque constant (instrumental variables, two stages). A torque
        is regressed on the motion - a polynomial of the configuration, speeds and accelerations, for each combination
        of directions - and then pass by pass on that. Half the differences of paired passes are small enough for the
        mean noise of a pass to matter: there the polynomial is that of a run, and stays as it is.

        Returns
        -------
        dict of str to ndarray, shape (n,)
        """
        if not hasattr(self, "_exogenous"):
            self._exogenous = dict(self.signals)
            for name in [k for k in self.known if k in self.signals and not k.endswith((".phi", ".w"))]:
                self._exogenous[name] = self._predict(self.signals[name])
        return self._exogenous

    def weights(self):
        """Weight of each channel in a fit: one over its noise, the same for every model of this data set.

        Returns
        -------
        ndarray, shape (channels,)
            Their geometric mean is one.
        """
        if not hasattr(self, "_weights"):
            parameters = {n: v.value for n, v in self.variables(self.base).items()}
            level = np.median(self.noise_level(self.base, parameters), axis=1)
            self._weights = np.exp(np.mean(np.log(level))) / level
        return self._weights

    def noise_level(self, model, parameters, part="fit"):
        """Noise that each sample of each channel should show, from the scatter of the signals and the model's response.

        A model that responds less to a noisy torque leaves less noise in its residual without being a better model;
        rivals are compared after dividing by this level. A sample far out from those around it has noise of that size.

        Parameters
        ----------
        model : Model
        parameters : dict of str to float
        part : str or ndarray of int
            As for `choose`.

        Returns
        -------
        ndarray, shape (channels, n)
            Standard deviations in the channels' units; one where the signals show no scatter.
        """
        view = self.view(part)
        total = np.zeros((len(self.outputs), len(self._picks(view)[0][1])))
        noisy = [k for k in self.known if k in self.signals and not k.endswith(".w")]
        for name, response in self.responses(model, parameters, noisy).items():
            spread = self._noisy(name) if not name.endswith(".phi") else self.steps[name] / math.sqrt(12)
            total += sum(take((response * spread) ** 2) * weight ** 2 for weight, _, take in self._picks(view))
        if not self.paired:
            total += np.array([self._noisy(c)[view] ** 2 for c in self.outputs])
        return np.sqrt(np.where(total > 0, total, 1.0))

    def responses(self, model, parameters, names):
        """Derivatives of the channels by signals that the model is given, sample by sample.

        Parameters
        ----------
        model : Model
        parameters : dict of str to float
        names : list of str
            Signals; those that the channels do not depend on are left out.

        Returns
        -------
        dict of str to ndarray, shape (channels, n)
        """
        question = self.ask(model).select(self.outputs)
        u, x, p = question.symbols()
        y = question.output(u, x, p)
        signals, (states, _) = self.undelayed(self.ask(model), parameters, self.exogenous()), self.states(
            model, parameters)
        arguments = ([signals.get(n, 0.0) for n in question.inputs] + list(states)
                     + [float(parameters[n]) for n in question.parameters])
        found = {}
        for name in [n for n in names if n in question.inputs]:
            slope = ca.jacobian(y, u[question.inputs.index(name)])
            if slope.nnz():
                found[name] = ArrayFunction(ca.Function("slope", [u, x, p], [ca.densify(slope)]))(
                    arguments, len(self.time))
        return found

    def predicted(self, model, parameters):
        """Channels as the model gives them from signals without noise.

        Parameters
        ----------
        model : Model
        parameters : dict of str to float

        Returns
        -------
        dict of str to ndarray, shape (n,)
        """
        return self.segment_signals(model, parameters, self.outputs, None, self.exogenous())

    @property
    def steps(self):
        """Step that each measured signal was rounded to, in its unit; 0.0 where it was not."""
        if not hasattr(self, "_steps"):
            self._steps = {n: instruments.step(v) for n, v in self.measured.items()}
        return self._steps

    def scatter(self, name):
        """Standard deviation of what changes from sample to sample, within passes, rounding counted.

        Parameters
        ----------
        name : str
            A measured signal.

        Returns
        -------
        float
            In the unit of the signal.
        """
        if name not in self._scatters:
            third = np.diff(self.reference(name), 3)
            inside = (self.passes[3:] >= 0) & (self.passes[3:] == self.passes[:-3])
            found = float(1.4826 * np.median(np.abs(third[inside])) / np.sqrt(20)) if inside.any() else 0.0
            self._scatters[name] = max(found, self.steps.get(name, 0.0) / math.sqrt(12))
        return self._scatters[name]

    def _noisy(self, name):
        """Standard deviation of the noise of each sample of a measured signal: its scatter, and how far it is out."""
        def make():
            values, usual = self.reference(name), self.scatter(name)
            away = values - np.concatenate([median_filter(values[self.run == k], AROUND, mode="nearest")
                                            for k in dict.fromkeys(self.run)])
            return np.hypot(usual, np.where(np.abs(away) > OUT * usual, away, 0.0))
        return self.memo(("dataset.spread", name), make)

    def picks(self, part):
        """How the samples of a part enter the residual.

        Parameters
        ----------
        part : str or ndarray of int
            As for `choose`.

        Returns
        -------
        list of (float, ndarray of int, callable)
            Weight, samples, and what takes values at them.
        """
        return self._picks(self.view(part))

    def _predict(self, values, trusted=None):
        """Values as the motion predicts them at moving samples, from those that are trusted: all by default."""
        trusted = self.moving if trusted is None else trusted
        span = np.maximum(np.ptp(self.config, axis=1, keepdims=True), 1e-9)
        x = 2 * (self.config - self.config.min(1, keepdims=True)) / span - 1
        rates = [v for n, v in self.signals.items() if n.startswith("der(") and np.ptp(v) > 0]
        powers = {degree: np.array([np.prod(x ** np.array(e)[:, None], axis=0) for e in itertools.product(
            range(degree + 1), repeat=len(x)) if sum(e) <= degree]) for degree in (1, 2, 3)}
        rates = np.array([r / np.std(r) for r in rates]).reshape(len(rates), -1)
        code = (np.sign(self.speeds) > 0).T @ (1 << np.arange(len(self.speeds))) + (
            self.run << len(self.speeds) if self.paired else 0)
        predicted = values.copy()
        for where in (self.moving & (code == c) for c in np.unique(code[self.moving])):
            told = where & trusted if np.count_nonzero(where & trusted) > _FEW else where
            degree = 3 if told.sum() > 1000 else 2 if told.sum() > 200 else 1
            rows = np.vstack([powers[degree], rates if degree == 3 else rates[:0]])
            a = rows[:, told]
            predicted[where] = np.linalg.lstsq(a @ a.T, a @ values[told], rcond=1e-10)[0] @ rows[:, where]
        for s in () if self.paired else contiguous(self.time, self.passes):
            told = np.flatnonzero(trusted[s]) + s.start
            if self.passes[s.start] >= 0 and len(told) > _FEW:
                a = np.array([np.ones(len(told)), predicted[told]])
                level, share = np.linalg.lstsq(a.T, values[told], rcond=1e-6)[0]
                predicted[s] = level + share * predicted[s]
        return predicted

    # ---- moving samples, blocks, held-out part

    def _segment(self):
        told = self.study.parameters
        parameters = {n: (told[n].applied(v) if n in told else v).value for n, v in self.base.parameters.items()}
        names = [f"{c}.w" for c in self.base.segments]
        self.speed_unit = self.base.variables[names[0]].unit if names else "rad/s"
        states = np.zeros((len(self.question.states), len(self.time)))
        self.speeds = np.array(list(self.segment_signals(self.base, parameters, names, states).values()))
        self.averaged = self.study.average == "file"
        noise = np.zeros(len(names))
        for rate, spread in self._spread.items():
            moved = self.segment_signals(self.base, parameters, names, states,
                                         {**self.signals, rate: self.signals[rate] + spread})
            noise += np.median((np.array(list(moved.values())) - self.speeds)**2, axis=1)
        least = self.study.w_min or (
            segmentation.SLOW * np.min(np.abs(self.speeds), axis=1, where=self.speeds != 0, initial=np.inf)
            if self.averaged else segmentation.default_w_min(self.speeds, noise=np.sqrt(noise)))
        self.w_min = float(np.max(least))
        moving = segmentation.moving(self.speeds, least, self.run)
        angles = [self.measured[k] for k in self.known if k.endswith("phi") and k in self.measured]
        self.config = np.array(angles) if angles else np.cumsum(self.speeds[:1], axis=1)
        self.passes = (np.where(moving, self.run, -1) if self.averaged
                       else segmentation.passes(self.time, self.speeds, moving, self.run))
        self.moving = moving if self.averaged else self._trim(moving, angles) & ~self._building_up(parameters, moving)
        self.passes = np.where(self.moving, self.passes, -1)
        if not self.moving.any():
            raise DataError(f"{self.logs[0].path}: nothing moves: no sample has every segment faster than w_min = "
                            f"{self.w_min:.3g} {self.speed_unit}; record motion, or lower w_min in the study")
        self.blocks = segmentation.blocks(self.time, self.config, self.passes, self.speeds, self.run)
        self.block = self.blocks.index

    def _building_up(self, parameters, moving):
        """Samples at which what friction builds up over the model's own travel would be taken for an effect.

        Smoothed speeds follow it: an encoder's steps go to and fro in slow motion.
        """
        own = [f"{c}.z" for c in self.base.segments]
        if self.averaged or not own:
            return np.zeros(len(self.time), dtype=bool)
        rates, at = {n: v for n, v in self.signals.items() if n.startswith("der(")}, [
            self.question.states.index(n) for n in own]
        sliding = np.zeros((len(self.question.states), len(self.time)))
        sliding[at] = np.sign(self.speeds)

        def state(times):
            longer = {n: v * times if n.endswith(".travel") else v for n, v in parameters.items()}
            return propagate(self.question, rates, self.time, longer, self.run, only=own)[0][at]

        def predicted(states):
            return np.array(list(self.segment_signals(self.base, parameters, self.outputs, states).values()))

        early, at_once, columns = state(1.0), predicted(sliding), []
        for k, row in enumerate(at):
            states = sliding.copy()
            states[row] = early[k]
            columns.append(predicted(states) - at_once)
        errors = np.array([self.reference(c) for c in self.outputs]) - at_once
        return turns.building_up(early - sliding[at], state(turns.LONGER) - sliding[at], moving, self.passes, self.time,
                                 errors, np.array(columns))

    def _trim(self, moving, angles):
        """Leave out the ends of a pass that smoothing makes look like motion: less than two encoder steps from rest."""
        moving = moving.copy()
        least = {(run, k): 1.5 * resolution(angle[self.run == run]) + 1e-9 * np.ptp(angle)
                 for run in np.unique(self.run) for k, angle in enumerate(angles)}
        for pass_number in np.unique(self.passes[self.passes >= 0]):
            inside = np.flatnonzero(self.passes == pass_number)
            first, last = max(inside[0] - 3, 0), min(inside[-1] + 3, len(self.time) - 1)
            for k, angle in enumerate(angles):
                near = least[self.run[inside[0]], k]
                moving[inside[np.abs(angle[inside] - angle[first]) < near]] = False
                moving[inside[np.abs(angle[inside] - angle[last]) < near]] = False
        return moving

    def _size(self):
        """Typical sizes, that nominal values and bounds of parameters are in proportion to."""
        torques = [self.signals[k] for k in self.known if k.endswith(".tau") and k in self.signals]
        flat = self.base.variables
        if not torques:
            torques = [self.measured[n] for n in self.outputs if n in self.measured and flat[n].unit in ("N.m", "N")]
        angles = [self.measured[k] for k in self.known if k.endswith(".phi") and k in self.measured]
        self.sizes = Sizes.of([t[self.moving] for t in torques], angles, self.speeds[:, self.moving], self.base.linear)

    def _split(self):
        held = [k for k, log in enumerate(self.logs) if log.held_out]
        self.is_test = segmentation.split(self.blocks, len(self.logs), held)
        self.fold = np.zeros(len(self.blocks), dtype=int)
        fitted = self.blocks.take(~self.is_test)
        runs, of_run = np.unique(fitted.run, return_inverse=True)
        # a log's blocks share its conditions: with enough logs, a fold is left out log by log, unless
        # parameters have values of their own there, of which a log left out would tell nothing
        self.by_run = len(runs) >= 4 and not self.study.own
        self.fold[~self.is_test] = of_run % FOLDS if self.by_run else segmentation.folds(fitted, FOLDS)

    def shortcomings(self):
        """What a log that is too poor for some questions can still answer.

        Returns
        -------
        list of str
            One sentence each; empty for a log that can be fitted, selected on and tested.
        """
        fitted, found = int(np.count_nonzero(~self.is_test)), []
        if fitted < 2:
            found.append("One block is left to fit: its parameters can be found, but no effect can be shown on data "
                         "that it was not fitted to; record more passes or a longer run.")
        elif not self.is_test.any():
            found.append("Nothing is held out: effects are chosen by cross-validation alone, and no error on data "
                         "never seen is told.")
        signs = {name: np.unique(np.sign(w[self.moving])) for name, w in zip(self.base.segments, self.speeds)}
        one_way = [name for name, s in signs.items() if len(s) == 1]
        if one_way:
            found.append(f"{', '.join(one_way)} {'moves' if len(one_way) == 1 else 'move'} one way only: friction "
                         "cannot be told from an offset of the torque there; record the way back too.")
        return found

    def held_out_ranges(self):
        """Held-out part as ``[file, t0, t1]`` entries.

        Returns
        -------
        list of [str, float, float]
            Times in s.
        """
        return [[self.logs[self.blocks.run[b]].name, float(self.blocks.t0[b]), float(self.blocks.t1[b])]
                for b in np.flatnonzero(self.is_test)]

    # ---- residuals

    def choose(self, part):
        """Blocks of a part: ``"fit"``, ``"test"``, ``"all"``, or the given ones.

        Parameters
        ----------
        part : str or sequence of int

        Returns
        -------
        ndarray of int
        """
        if isinstance(part, str):
            return np.flatnonzero({"fit": ~self.is_test, "test": self.is_test, "all": self.is_test | True}[part])
        return np.asarray(part)

    def view(self, part):
        """Indices of the samples (or pairs of samples) of a part.

        Parameters
        ----------
        part : str or sequence of int
            As for `choose`.

        Returns
        -------
        ndarray of int or segmentation.Pairs
            Pairs where the data are paired.
        """
        blocks = self.choose(part)
        key = blocks.tobytes()
        if key not in self._views:
            inside = np.isin(self.block, blocks) & self.moving & (self.passes >= 0)
            if not self.paired:
                self._views[key] = np.flatnonzero(inside)
            else:
                if not hasattr(self, "_pairs"):
                    self._pairs = segmentation.pairs(self.config, self.passes, self.run, block=self.block)
                p = self._pairs
                keep = inside[p.i] & inside[p.j0] & inside[p.j1]
                self._views[key] = segmentation.Pairs(p.i[keep], p.j0[keep], p.j1[keep], p.weight[keep])
        return self._views[key]

    def path(self, part, thin):
        """Samples by which friction states are followed when a part is thinned.

        Parameters
        ----------
        part : str or ndarray of int
        thin : int
            Of the part's samples, and of the others, every so many.

        Returns
        -------
        slice or ndarray of int
        """
        if thin == 1:
            return slice(None)
        view, n = self.view(part), len(self.time)
        wanted, rest = np.zeros(n, dtype=bool), np.ones(n, dtype=bool)
        for index in (view.i, view.j0, view.j1) if self.paired else (view,):
            wanted[index[::thin]], rest[index] = True, False
        wanted[np.flatnonzero(rest)[::thin]] = True
        wanted[np.r_[0, np.flatnonzero(np.diff(self.run)) + 1]] = True  # where a log starts
        return np.flatnonzero(wanted)

    def residuals(self, model, free, parameters, part="fit", signals=None):
        """Residuals of a model on a part of the data.

        Parameters
        ----------
        model : Model
        free : list of str
            Parameters to differentiate by.
        parameters : dict of str to float
            All parameters.
        part : str or sequence of int
            As for `choose`.
        signals : dict of str to ndarray, shape (n,), optional
            Instead of those recorded, as `exogenous` gives them.

        Returns
        -------
        Residuals

        Raises
        ------
        DataError
            Fewer samples than free parameters and two.
        """
        question = self.ask(model)
        view = self.view(part)
        picks = self._picks(view)
        index = picks[0][1]
        own = {name: (of, self.run[index] == run) for of, runs in self.own(model).items() for run, name in runs.items()}
        if len(index) < len(free) + 2:
            raise DataError(f"{self.logs[0].path}: only {len(index)} usable samples for {len(free)} free parameters; "
                            "record a longer log with motion in both directions")
        measured = (np.zeros((len(self.outputs), len(index))) if self.paired
                    else np.array([self.reference(c)[index] for c in self.outputs]))
        signals = self.signals if signals is None else signals
        terms = self._terms(model, picks, signals)
        return Residuals(question, self.outputs, measured, terms, free, parameters,
                         self.time[index], self.passes[index], self.block[index], self.channels,
                         not (self.paired or self.averaged),
                         *((view.lags(self.time), view.colour) if self.paired else (None, 1.0)),
                         self._held(question, index), own)

    def _held(self, question, index):
        """Channels that a filter has held back, or None."""
        lags = {self.compared(c): n for c, n in question.held.items() if self.compared(c)}
        if not lags:
            return None
        return Held({self.outputs.index(c): n for c, n in lags.items()}, np.array([self.moved(c) for c in lags]),
                    self.time, self.run, index)

    def behind(self, model, parameters):
        """By how much measured channels were recorded behind what they show, where a filter has held them back.

        Parameters
        ----------
        model : Model
        parameters : dict of str to float

        Returns
        -------
        dict of str to ndarray, shape (n,)
            By channel, in its unit.
        """
        question = self.ask(model)
        held = self._held(question, np.arange(len(self.time)))
        if held is None:
            return {}
        times = settings(question, list(held.lags.values()), parameters)
        return {self.outputs[channel]: behind for channel, behind, _ in held.behind(times)}

    def moved(self, channel):
        """What the motion alone predicts of a measured channel that is a function of it, as the torque of a load is.

        Parameters
        ----------
        channel : str

        Returns
        -------
        ndarray, shape (n,)
            Log by log, a polynomial of the configuration, and speeds and accelerations with their products.
        """
        def make():
            found = np.array(self.reference(channel), dtype=float)
            rates = [v for n, v in self.signals.items() if n.startswith("der(")]
            for part in (np.flatnonzero(self.run == k) for k in np.unique(self.run)):
                x = self.config[:, part]
                x = 2 * (x - x.min(1, keepdims=True)) / np.maximum(np.ptp(x, axis=1, keepdims=True), 1e-9) - 1
                own = [v[part] / max(np.std(v[part]), 1e-300) for v in rates]
                rows = [np.prod(x ** np.array(e)[:, None], axis=0)
                        for e in itertools.product(range(SMOOTH + 1), repeat=len(x)) if sum(e) <= SMOOTH]
                rows = np.array([*rows, *own, *(a * b for a, b in itertools.combinations_with_replacement(own, 2))])
                found[part] = np.linalg.lstsq(rows @ rows.T, rows @ found[part], rcond=1e-10)[0] @ rows
            return found

        return self.memo(("dataset.moved", channel), make)

    def _terms(self, model, picks, signals):
        """What a residual is made of at given parameters, from some signals."""
        question = self.ask(model)
        cached, stateful, read = {}, dependent_parameters(question), self._read(question)

        def terms(values, with_respect_to):
            key = (tuple(values[n] for n in stateful), tuple(with_respect_to))
            if key not in cached:
                states, sensitivities = self.states(model, values, with_respect_to)
                cached.clear()
                moved = self.undelayed(question, values, signals)
                cached[key] = [Term(weight, {n: take(v) if isinstance(v, np.ndarray) else v
                                             for n, v in moved.items() if n in read}, take(states),
                                    take(sensitivities)) for weight, _, take in picks]
            return cached[key]

        return terms

    def _read(self, question):
        """Inputs that the errors, the segments' loads or the friction states depend on."""
        def make():
            u, x, p = question.symbols()
            chosen = question.select(self.outputs + [n for n in question.outputs if n.endswith(".L")])
            used = {s.name() for s in ca.symvar(ca.vertcat(chosen.output(u, x, p), question.rate(u, x, p)))}
            return {n for n, s in zip(question.inputs, ca.vertsplit(u)) if s.name() in used}

        return question.memo(("dataset.read", *self.outputs), make)

    def compared(self, component):
        """The measured channel that the torque of a component is compared with.

        Parameters
        ----------
        component : str

        Returns
        -------
        str or None
        """
        held = [c for c, reading in self.aliases.items() if c in self.outputs and c in self.measured
                and reading.rpartition(".")[0] == component and self.base.unit(c) in ("N.m", "N")]
        return None if self.paired or not held else held[0]

    def _picks(self, view):
        if not self.paired:
            return [(1.0, view, lambda v: v[..., view])]
        return [(0.5, view.i, lambda v: view.at(v)[0]), (-0.5, view.i, lambda v: view.at(v)[1])]

    def reference(self, channel):
        """Measured values of a channel at every sample; zero where the error itself is modelled.

        Parameters
        ----------
        channel : str
            Output of the question.

        Returns
        -------
        ndarray, shape (n,)
        """
        return self.measured.get(channel, np.zeros(len(self.time)))

    # ---- parameters

    def variables(self, model):
        """Parameters of a model, with the bounds and values of the study.

        Parameters
        ----------
        model : Model

        Returns
        -------
        dict of str to Variable
        """
        found = {n: self.sizes.fit(v) for n, v in model.parameters.items()}
        for name, setting in self.study.parameters.items():
            if name in found:
                found[name] = setting.applied(found[name])
        for effect, place in model.attached:  # fewer than one cycle over the travel would be an offset, not a ripple
            for coefficient in [c for c, kind in effect.scan.items() if kind == "cycles"]:
                name = f"{component_name(effect, place)}.{coefficient}"
                angle = self.signals.get(f"{place.components[0]}.phi")
                if angle is not None and np.ptp(angle) > 0:
                    found[name] = replace(found[name], min=max(found[name].min, 2 * np.pi / np.ptp(angle)))
            for name, mean in self.means(effect, place.components).items():
                name = f"{component_name(effect, place)}.{name}"
                if name not in self.study.parameters:
                    found[name] = replace(found[name], value=mean)
        for name, runs in self.own(model).items():
            for run, own in runs.items():
                found[own] = replace(found[name], description=f"{found[name].description} in {self.logs[run].name}")
        return found

    def own(self, model):
        """Parameters that have a value of their own in each run that is fitted.

        Parameters
        ----------
        model : Model

        Returns
        -------
        dict of str to dict of int to str
            By parameter: the number of each run, and the name of the parameter's value there, as ``zero_H[monday]``.
            Nothing where one run alone is fitted.

        Raises
        ------
        StudyError
            Such a parameter is fixed, or a friction state, a delay or a filter depends on it.
        """
        wanted = [n for n in self.study.own_parameters(self.library) if n in model.parameters]
        if not wanted or "is_test" not in vars(self):  # runs are not cut yet
            return {}
        return self.memo(("dataset.own", model.key), lambda: self._own(model, wanted))

    def _own(self, model, wanted):
        where, question = f"{self.study.path}: [fit] own", self.ask(model)
        behind = {*dependent_parameters(question)}
        for name in wanted:
            setting = self.study.parameters.get(name)
            if setting is not None and setting.fixed:
                raise StudyError(f"{where} gives '{name}' a value in each run, but [parameters] says fixed = true; "
                                 "take one of them out")
            if name in behind:
                raise StudyError(f"{where}: a friction state, a delay or a filter depends on '{name}', which has one "
                                 "value for all runs; take it out of own, or give each run a study of its own")
        runs = np.unique(self.blocks.run[~self.is_test])
        if len(runs) < 2:
            return {}
        stems = [self.logs[k].name.rpartition(".")[0].replace(".", "_") or self.logs[k].name for k in runs]
        labels = [s if stems.count(s) == 1 else f"{s}#{k + 1}" for k, s in zip(runs, stems)]
        return {name: {int(k): f"{name}[{label}]" for k, label in zip(runs, labels)} for name in wanted}

    def _by_run(self, runs, name, parameters):
        """A parameter at every sample, where runs have values of their own."""
        found = np.full(len(self.time), float(parameters[name]))
        for run, own in runs.items():
            found[self.run == run] = parameters.get(own, parameters[name])
        return found

    def means(self, effect, components):
        """Parameters of an effect that stand for something of the logs.

        Parameters
        ----------
        effect : Effect
        components : sequence of str
            Where it hangs.

        Returns
        -------
        dict of str to float
            Means of measured inputs, and ends of what the place travels over; without those of what was not measured.
        """
        found = {}
        for name, source in effect.means.items():
            end, _, variable = source.rstrip(")").rpartition("(")
            if end:
                found[name] = _ENDS[end](*self._travelled(effect, components, variable))
            elif source in self.measured:
                found[name] = float(self.measured[source].mean())
        return found

    def _travelled(self, effect, components, variable):
        """Least and greatest value of a variable of a place, as ``friction.phi``, over all samples."""
        def make():
            parameters = {**{n: v.value for n, v in self.base.parameters.items()}, **self.values(self.base)}
            names = [f"{c}.{variable}" for c in components]
            known = self.segment_signals(self.base, parameters, names)
            for component in components if variable == "flange.phi" else ():  # of a motor: its encoder, less the zero
                angle = self.signals.get(f"{component}.phi")
                if angle is not None:
                    known[f"{component}.{variable}"] = angle - parameters.get(f"{component}.zero", 0.0)
            missing = [n for n in names if n not in known or np.ptp(known[n]) == 0]
            if missing:
                raise StudyError(f"{self.study.path}: '{effect.id}' at {' and '.join(components)} is a function of "
                                 f"'{missing[0]}', which does not change in these logs or does not follow from them; "
                                 "log an angle that moves, or take the effect out")
            values = [known[n] for n in names]
            return float(np.min(values)), float(np.max(values))
        return self.memo(("dataset.travelled", tuple(components), variable), make)

    def values(self, model):
        """Values that the study sets.

        Parameters
        ----------
        model : Model

        Returns
        -------
        dict of str to float
            Without parameters that the model does not have.
        """
        return {n: s.value for n, s in self.study.parameters.items() if s.value is not None and n in model.parameters}

    def free(self, model):
        """Free parameters: those the study names and does not fix, encoder zeros, and the attached effects' own.

        Parameters
        ----------
        model : Model

        Returns
        -------
        list of str
        """
        named = [n for n, s in self.study.parameters.items() if s.fixed is False and n in model.parameters]
        named += [n for n in self.zeros if n not in self.study.parameters]
        for effect, place in model.attached:
            named += [n for n in model.effect_parameters(effect, place)
                      if n not in named and not (self.study.parameters.get(n) and self.study.parameters[n].fixed)]
        own = self.own(model)
        named += [n for n in self.study.own_parameters(self.library) if n in model.parameters and n not in named]
        return [value for n in named for value in (own[n].values() if n in own else [n])]


def _is_motion(name):
    """Whether a known signal is an angle, a speed or an acceleration."""
    return name.startswith("der(") or name.endswith((".phi", ".w"))

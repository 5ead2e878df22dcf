"""Logs, study and model in; samples arranged for fitting out: channels, moving ones, blocks, held-out part, pairs."""

from __future__ import annotations

import copy
from dataclasses import replace
from functools import partial

import numpy as np

from ..compile import ArrayFunction, catalogue, compile_model
from ..core.errors import DataError, StillError
from ..dynamics.delays import Clock, Moved, Record, undo
from ..dynamics.filters import settings
from ..dynamics.states import propagate
from . import instruments, segmentation, torques, turns
from .asked import Asked
from .logs import load
from .motion import Motion
from .parameters import Parameters
from .residuals import Residuals, evaluated, held
from .scales import Sizes
from .scatter import scatter
from .spikes import MANY, MOTION, mended, spikes, starts

FOLDS = 5


class Dataset:
    """Measurements of a study, ready to be compared with models of its rig.

    Parameters
    ----------
    study : Study
        Names the logs, says what their columns are, and which reference the torques are compared with.
    library : Library
        Holds the study's rig and its effects.
    logs : list of Log, optional
        Already read; else the study's files are read.

    Attributes
    ----------
    channels : list of str
        Names of the errors: ``C_H``, or ``C_H_pair`` when no reference was measured.
    paired : bool
        Whether half differences between ways out and back are compared, because no reference was measured.
    time, run : ndarray, shape (n,)
        Time of each sample [s], and the number of its log; all logs one after the other.
    signals : dict of str to ndarray, shape (n,)
        Inputs of the model's question.
    measured : dict of str to ndarray, shape (n,)
        Everything measured, by model variable.
    moving : ndarray of bool, shape (n,)
        Samples in which every segment slides: those that are compared.
    left_out : ndarray of bool, shape (n,)
        Samples that the study leaves out: they are recorded, drive states, and count as not moving.
    speed_unit : str
        Of the segments' speeds.
    own_travel : bool
        Whether what is off after turns is the travel of the rig's own friction.
    w_min : float
        Speed above which a segment moves, of the segment where that is highest.
    block : ndarray of int, shape (n,)
        Block of each sample.
    is_test : ndarray of bool, shape (blocks,)
        Blocks that are held out, and never fitted.
    by_run : bool
        Whether folds are whole logs: those are then what is independent, not the blocks of one.
    motion : Motion
        What is derived from the recorded angles.
    parameters : Parameters
        What study and logs say of the parameters of models of this rig.
    early : ndarray of bool, shape (n,), or None
        Samples left out of all parts; see `sliding` and `settled`.
    filtered : bool
        Whether those are left out at which a filter has not settled.
    """

    def __init__(self, study, library, logs=None):
        self.study, self.library, self._memo = study, library, {}
        self.logs = load(study) if logs is None else logs
        self.base = compile_model(library, study.rig, study.effects)
        self._choose_question()
        self._gather()
        self.parameters, self.moving = Parameters(self), None
        self._derive()
        self._segment()
        self._size()
        self._split()
        self._views, self.early, self.filtered = {}, None, False

    @property
    def spiked(self):
        """Outliers of torques and references, of columns in which they hold more squares than the noise: a number.

        Zero where the study bridges them anyway.
        """
        def make():
            count = 0
            for name in () if self.study.robust else {*self.known, *self.outputs} & {*self.measured}:
                if self.base.unit(name) in ("N.m", "N"):
                    found = [spikes(self.measured[name][self.run == k], starts(log)) for k, log in enumerate(self.logs)]
                    off = np.concatenate([off for _, off in found])
                    few = 0 < off.size < MANY * len(self.time)
                    count += off.size if few and np.sum(off ** 2) > len(self.time) * scatter(self, name) ** 2 else 0
            return count
        return self.memo("dataset.spiked", make)

    @property
    def calm(self):
        """These data as tests see them: bridged over outliers of torques that would hide every effect."""
        if not self.spiked:
            return self
        robust = replace(self.study, robust=True)
        return self.memo("dataset.calm", lambda: Dataset(robust, self.library, self.logs))

    # ---- what is known, what is compared

    def _choose_question(self):
        asked = Asked.of(self.study, self.base, self.logs)
        asked.require(self.study, self.logs)
        self.asked, self.form, self.paired = asked.name, asked.form, asked.paired
        self.outputs, self.known, self.channels = asked.outputs, asked.known, asked.channels
        self.aliases, self.zeros = asked.aliases, asked.zeros
        self.question = self.ask(self.base)

    def ask(self, model):
        """The question that a model of this rig is asked about these data.

        On moving samples a segment's own state is at its limit, at rest, so that its damping adds nothing.

        Parameters
        ----------
        model : Model
            Of the study's rig, with whatever effects are attached.

        Returns
        -------
        Question
        """
        question = model.question(self.asked, self.form, tuple(self.aliases.items()))
        return question.fixed({n: 0.0 for n in (f"{c}.damping" for c in model.segments) if n in question.parameters})

    def _gather(self):
        self.time = np.concatenate([log.time for log in self.logs])
        self.run = np.concatenate([np.full(len(log.time), k) for k, log in enumerate(self.logs)])
        self.clock, self._records, self._late = Clock(self.time, self.run), {}, Moved()
        self.left_out = np.concatenate([self.study.left_out(log.name, log.time) for log in self.logs])
        shared = set.intersection(*[set(log.signals) for log in self.logs])
        recorded = [self._recorded(log) for log in self.logs]
        self.measured = {v: np.concatenate([signals[v] for signals in recorded]) for v in sorted(shared)}
        self.labels = (np.concatenate([log.labels for log in self.logs])
                       if all(log.labels is not None for log in self.logs) else None)

    def _recorded(self, log):
        """Signals of a log: bridged over outliers where the study is robust, and motion where it leaves them out."""
        left_out = self.study.left_out(log.name, log.time)
        if not (self.study.robust or left_out.any()):
            return log.signals
        turns, where = starts(log), None if self.study.robust else left_out
        return {n: mended(v, turns, where) if self.study.robust or n.endswith(MOTION) else v
                for n, v in log.signals.items()}

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

    # ---- motion, and the model along it

    def _derive(self):
        """Signals that the model is given: what was measured of them, and what is derived from it."""
        self.signals = {k: self.measured[k] for k in self.known if k in self.measured}
        self.signals["time"] = self.time
        angles = [n[4:-1] for n in self.question.inputs if n.startswith("der(") and n.count("(") == 1]
        self.motion = Motion(angles, self.time, self.run, self.measured, [log.path for log in self.logs])
        self.signals.update(self.motion.rates)
        read = {n for effect in catalogue(self.library).values() for n in effect.measured}  # effects may come yet
        for name in [*self.question.inputs, *sorted(read)]:
            if name in self.measured:
                self.signals.setdefault(name, self.measured[name])

    def segment_signals(self, model, parameters, names, states=None, signals=None):
        """Outputs of the model at every sample, such as ``s1A.w`` and ``s1A.L``.

        Parameters
        ----------
        model : Model
            Of the study's rig, with whatever effects are attached.
        parameters : dict of str to float
            All of the model's, SI units.
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
        arguments = ([signals.get(n, 0.0) for n in chosen.inputs] + list(states)
                     + self.parameters.along(model, chosen.parameters, parameters))
        values = ArrayFunction(chosen.output)(arguments, len(self.time))
        return dict(zip(names, values))

    def states(self, model, parameters, free=(), path=slice(None)):
        """Friction states at every sample, and their sensitivities.

        The segments' own states are at their sliding limit, the sign of the speed, which holds on moving samples; the
        states of effects are followed along the log, by what the smooth motion behind the angles moved between samples.

        Parameters
        ----------
        model : Model
            Of the study's rig, with whatever effects are attached.
        parameters : dict of str to float
            All of the model's, SI units.
        free : sequence of str
            Parameters whose sensitivities are wanted.
        path : slice or ndarray of int, optional
            The samples by which they are followed; all by default. See `path`.

        Returns
        -------
        states : ndarray, shape (number of states, samples of the path)
        sensitivities : ndarray, shape (len(free), number of states, samples of the path)

        Raises
        ------
        ModelicaError
            A state of an effect is coupled to another, or its rate is not made of one or two straight pieces.
        """
        question, time = self.ask(model), self.time[path]
        own = [f"{c}.z" for c in model.segments]
        followed = [s for s in question.states if s not in own]
        if followed and not self.averaged:
            along = {n: v[path] for n, v in {**self.signals, **self.motion.paths()}.items()}
            states, sensitivities = propagate(question, along, time, parameters, self.run[path], free, followed)
        else:
            states = np.zeros((len(question.states), len(time)))
            sensitivities = np.zeros((len(free), *states.shape))
        for k, name in enumerate(question.states):
            if name in own or self.averaged:
                component = name.rsplit(".", 1)[0] if name in own else next(iter(model.segments))
                states[k] = np.sign(self.speeds[list(model.segments).index(component)][path])
                sensitivities[:, k] = 0.0
        return states, sensitivities

    def undelayed(self, question, parameters, signals=None):
        """Signals at the times they tell of, for a model that delays their record; else as recorded.

        Parameters
        ----------
        question : Question
            That the model is asked; its `late` names the signals that it delays.
        parameters : dict of str to float
            All of the model's, SI units.
        signals : dict of str to ndarray, shape (n,), optional
            Instead of those recorded, as `exogenous` gives them.

        Returns
        -------
        dict of str to ndarray, shape (n,)
            With each delay [s], a number, under ``at(x)``.
        """
        signals = self.signals if signals is None else signals
        return {**signals, **self.moved(question, parameters, signals)}

    def moved(self, question, parameters, signals, some=slice(None)):
        """The signals alone whose record a model delays, at the times they tell of.

        Parameters
        ----------
        question, parameters, signals
            As of `undelayed`.
        some : slice or ndarray of int
            Samples wanted.

        Returns
        -------
        dict of str to ndarray, as many as are wanted
            With each delay [s], a number, under ``at(x)``.
        """
        if not question.late:
            return {}
        still = self.memo("dataset.still", lambda: np.zeros(len(self.time)))  # no push
        all_given = {**{n: still for n in question.late if n not in signals}, **signals}
        late = [n for n in question.late if not torques.is_motion(n)]
        if self.moving is None:  # no passes yet: torques are taken as recorded, of which no speed is made
            return undo(question, all_given, self.time, self.run, parameters, {n: (still, still) for n in late},
                        lambda name, lag: (still, still), self._record, some=some, kept=self._late)
        return undo(question, all_given, self.time, self.run, parameters, {n: torques.slope(self, n) for n in late},
                    partial(torques.held_back, self), self._record,
                    partial(torques.calm, self) if signals is self.signals else None, some, self._late)

    def _record(self, values):
        """A recorded signal that can be read at other times."""
        if id(values) not in self._records:
            self._records[id(values)] = Record(self.clock, values)  # holds them
        return self._records[id(values)]

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

        References
        ----------
        .. [1] Janot, A., Vandanjon, P.-O. and Gautier, M. (2014). A generic instrumental variable approach for
               industrial robot identification. IEEE Transactions on Control Systems Technology 22(1).
        """
        if not hasattr(self, "_exogenous"):
            self._exogenous = dict(self.signals)
            for name in [k for k in self.known if k in self.signals and not k.endswith((".phi", ".w"))]:
                self._exogenous[name] = torques.predicted(self, self.signals[name])
        return self._exogenous

    def predicted(self, model, parameters):
        """Channels as the model gives them from signals without noise.

        Parameters
        ----------
        model : Model
            Of the study's rig, with whatever effects are attached.
        parameters : dict of str to float
            All of the model's, SI units.

        Returns
        -------
        dict of str to ndarray, shape (n,)
        """
        return self.segment_signals(model, parameters, self.outputs, None, self.exogenous())

    @property
    def steps(self):
        """Step that each measured signal was rounded to, in its unit; 0.0 where it was not."""
        return self.memo("dataset.steps", lambda: {n: instruments.step(v) for n, v in self.measured.items()})

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
        view = self.view(part)
        if not self.paired:
            return [(1.0, view, lambda v: v[..., view])]
        return [(0.5, view.i, lambda v: view.at(v)[0]), (-0.5, view.i, lambda v: view.at(v)[1])]

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
        for rate, spread in self.motion.spread.items():
            moved = self.segment_signals(self.base, parameters, names, states,
                                         {**self.signals, rate: self.signals[rate] + spread})
            noise += np.median((np.array(list(moved.values())) - self.speeds)**2, axis=1)
        self.own_travel = False
        least, angles = self.study.w_min, [k for k in self.known if k.endswith("phi") and k in self.measured]
        if self.averaged:
            least = least or segmentation.SLOW * np.min(np.abs(self.speeds), axis=1, where=self.speeds != 0,
                                                        initial=np.inf)
            self.moving = segmentation.moving(self.speeds, least, self.run)
            self.passes = np.where(self.moving, self.run, -1)
        else:
            usual, slowest = ([least, least] if least else [segmentation.default_w_min(
                self.speeds, noise=np.sqrt(noise), share=share) for share in (segmentation.SLOW, segmentation.SLOWEST)])
            self.moving, self.passes, least, self.own_travel = turns.compared(
                self, parameters, usual, slowest, angles)
        self.w_min = float(np.max(least))
        self.config = np.array([self.measured[k] for k in angles]) if angles else np.cumsum(self.speeds[:1], axis=1)
        if self.left_out.all():
            raise DataError(f"{self.study.path}: [data] leave_out covers every sample of {self.logs[0].name}"
                            f"{' and the others' if len(self.logs) > 1 else ''}, so that nothing is compared; name the "
                            f"stretches alone that must not count, within {self.time[0]:.6g} to {self.time[-1]:.6g} s")
        if not self.moving.any():
            beyond = " beside what leave_out leaves out" if self.left_out.any() else ""
            raise StillError(f"{self.logs[0].path}: not_enough_excitation: nothing moves{beyond}: no sample has every "
                             f"segment faster than w_min = {self.w_min:.3g} {self.speed_unit}; record motion, or lower "
                             "[data] w_min in the study")
        self.blocks = segmentation.blocks(self.time, self.config, self.passes, self.speeds, self.run,
                                          paired=self.paired)
        self.block = self.blocks.index

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
        self.is_test = segmentation.split(self.blocks, len(self.logs), held,
                                          segmentation.ways(self.blocks, self.speeds, self.moving))
        self.fold = np.zeros(len(self.blocks), dtype=int)
        fitted = self.blocks.take(~self.is_test)
        runs, of_run = np.unique(fitted.run, return_inverse=True)
        # a log's blocks share its conditions: with enough logs, a fold is left out log by log, unless
        # parameters have values of their own there, of which a log left out would tell nothing
        self.by_run = len(runs) >= 4 and not self.study.own_values(self.library)
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
            ``"fit"``, ``"test"``, ``"all"``, or numbers of blocks.

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
            inside = inside if self.early is None else inside & ~self.early
            if not self.paired:
                self._views[key] = np.flatnonzero(inside)
            else:
                if not hasattr(self, "_pairs"):
                    self._pairs = segmentation.pairs(self.config, self.passes, self.run, block=self.block)
                p = self._pairs
                gone = np.cumsum(self.left_out)
                keep = inside[p.i] & inside[p.j0] & inside[p.j1] & (gone[p.j0] == gone[p.j1])  # nothing across a hole
                self._views[key] = segmentation.Pairs(p.i[keep], p.j0[keep], p.j1[keep], p.weight[keep])
        return self._views[key]

    def sliding(self, model):
        """These data as far as friction slides where a model moves or filters a torque, or motion beside one.

        A torque that comes late or through a filter hides that what is off after a turn is the machine's own travel:
        its samples are compared then, and what nobody knows of them would be taken for an effect of that travel.

        Parameters
        ----------
        model : Model
            Of the same rig.

        Returns
        -------
        Dataset
            With fewer samples in its parts; this one where the model does neither, or nothing is left out.
        """
        if self.early is not None or self.own_travel or not self.ask(model).late:
            return self
        values = {n: v.value for n, v in self.parameters.variables(self.base).items()}
        giving = self.memo("dataset.giving", lambda: turns.giving(self, values))
        many = np.count_nonzero(giving) >= torques.SHARE * np.count_nonzero(self.moving)
        return self if many or not giving.any() else self.without(giving)

    def settled(self, model, parameters):
        """These data as far as a model with a filter of a torque can tell what the torque was.

        What a filter holds back after a start is the torque of before, of rest and of the first motion, which nobody
        measured: there an error of that would be taken for a longer filter, or for an effect of the travel.

        Parameters
        ----------
        model : Model
            Of the same rig.
        parameters : dict of str to float
            All of the model's, SI units; time constants [s] among them.

        Returns
        -------
        Dataset
            With fewer samples in its parts; this one where the model filters no torque, or nothing is left out.
        """
        lag = 0.0 if self.filtered else torques.lag(self.ask(model), parameters)
        if lag <= 0:
            return self
        here, early = self.sliding(model), torques.unsettled(self, lag)
        other = self.without(early if here.early is None else early | here.early)
        other.filtered = True
        return other

    def without(self, early):
        """These data with fewer samples in their parts.

        Parameters
        ----------
        early : ndarray of bool, shape (n,), or None
            Samples that are in no part; None of none.

        Returns
        -------
        Dataset
        """
        if early is self.early:
            return self
        other = copy.copy(self)
        other._views, other.early = {}, early
        return other

    def path(self, part, thin, most=None):
        """Samples by which friction states are followed when a part is thinned.

        Parameters
        ----------
        part : str or ndarray of int
            ``"fit"``, ``"test"``, ``"all"``, or numbers of blocks.
        thin : int
            Of the part's samples, and of the others, every so many.
        most : int, optional
            Samples from one to the next at most.

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
        if most is not None and thin > most:
            wanted[::most] = True
        wanted[np.r_[0, np.flatnonzero(np.diff(self.run)) + 1]] = True  # where a log starts
        return np.flatnonzero(wanted)

    def residuals(self, model, free, parameters, part="fit", signals=None):
        """Residuals of a model on a part of the data.

        Parameters
        ----------
        model : Model
            Of the study's rig, with whatever effects are attached.
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
        StillError
            Fewer samples than free parameters and two.
        """
        question = self.ask(model)
        view = self.view(part)
        picks = self.picks(part)
        index = picks[0][1]
        own = {name: (of, self.run[index] == run) for of, runs in self.parameters.own(model).items()
               for run, name in runs.items() if name in free or name in parameters}
        if len(index) < len(free) + 2:
            raise StillError(f"{self.logs[0].path}: not_enough_excitation: only {len(index)} usable samples for "
                             f"{len(free)} free parameters; record a longer log with motion in both directions")
        measured = (np.zeros((len(self.outputs), len(index))) if self.paired
                    else np.array([self.reference(c)[index] for c in self.outputs]))
        signals = self.signals if signals is None else signals
        terms = evaluated(self, model, part, signals)
        return Residuals(question, self.outputs, measured, terms, free, parameters,
                         self.time[index], self.passes[index], self.block[index], self.channels,
                         not (self.paired or self.averaged),
                         *((view.lags(self.time), view.colour) if self.paired else (None, 1.0)),
                         held(self, question, index), own)

    def behind(self, model, parameters):
        """By how much measured channels were recorded behind what they show, where a filter has held them back.

        Parameters
        ----------
        model : Model
            Of the study's rig, with whatever effects are attached.
        parameters : dict of str to float
            All of the model's, SI units.

        Returns
        -------
        dict of str to ndarray, shape (n,)
            By channel, in its unit.
        """
        question = self.ask(model)
        filtered = held(self, question, np.arange(len(self.time)))
        if filtered is None:
            return {}
        times = settings(question, list(filtered.lags.values()), parameters)
        return {self.outputs[channel]: behind for channel, behind, _ in filtered.behind(times)}

    def compared(self, component):
        """The measured channel that the torque of a component is compared with.

        Parameters
        ----------
        component : str
            Of the rig, as ``joint``.

        Returns
        -------
        str or None
        """
        held = [c for c, reading in self.aliases.items() if c in self.outputs and c in self.measured
                and reading.rpartition(".")[0] == component and self.base.unit(c) in ("N.m", "N")]
        return None if self.paired or not held else held[0]

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

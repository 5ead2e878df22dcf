"""A study, its logs and a model in; the model's parameters, their bounds and starts, and which are free, out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..compile import component_name
from ..core.errors import StudyError
from ..dynamics.states import dependent_parameters

_ENDS = {"min": min, "max": max}  # of what a place travels over


def fewest_cycles(number, travel):
    """Cycles of the slowest ripple that a travel can show.

    Fewer than one cycle over the travel are an offset or a slope, not a ripple. What turns repeats once a turn at the
    slowest, though, so that one cycle a turn is a ripple wherever most of a turn is seen.

    Parameters
    ----------
    number : Variable
        The effect's number of cycles, a turn or, along an axis, 2 pi m, with the least that it can be.
    travel : float
        Of the angle [rad], or along an axis [m]; above zero.

    Returns
    -------
    float
    """
    turns = travel / (2 * np.pi)
    return max(number.min, 1.0 if number.unit == "1" and 0.5 < turns < 1 else 1 / turns)


def phases(model):
    """Phases of the ripples of a model.

    Parameters
    ----------
    model : Model
        With whatever effects are attached.

    Returns
    -------
    list of str
        Names of parameters.
    """
    return [f"{component_name(effect, place)}.{c}" for effect, place in model.attached for c in effect.phases]


class Parameters:
    """What study and logs say of the parameters of models of one rig.

    Parameters
    ----------
    dataset : Dataset
        Arranged as far as the question that is asked of the model.
    """

    def __init__(self, dataset):
        self.data, self.study = dataset, dataset.study

    def variables(self, model):
        """Parameters of a model, with the bounds and values of the study.

        Parameters
        ----------
        model : Model
            Of the study's rig, with whatever effects are attached.

        Returns
        -------
        dict of str to Variable
        """
        found = {n: self.data.sizes.fit(v) for n, v in model.parameters.items()}
        for name, setting in self.study.parameters.items():
            if name in found:
                found[name] = setting.applied(found[name])
        for effect, place in model.attached:
            for coefficient in [c for c, kind in effect.scan.items() if kind == "cycles"]:
                name = f"{component_name(effect, place)}.{coefficient}"
                angle = self.data.signals.get(f"{place.components[0]}.phi")
                if angle is not None and np.ptp(angle) > 0:
                    found[name] = replace(found[name], min=fewest_cycles(found[name], np.ptp(angle)))
            for name, mean in self.means(effect, place.components).items():
                name = f"{component_name(effect, place)}.{name}"
                if name not in self.study.parameters:
                    found[name] = replace(found[name], value=mean)
        for name, runs in self.own(model).items():
            for run, own in runs.items():
                where = f"{found[name].description} in {self.data.logs[run].name}"
                found[own] = replace(found[name], description=where)
        return found

    def own(self, model):
        """Parameters that have a value of their own in each run that is fitted.

        Parameters
        ----------
        model : Model
            Of the study's rig, with whatever effects are attached.

        Returns
        -------
        dict of str to dict of int to str
            By parameter: the number of each run, and the name of the parameter's value there, as ``zero_H[monday]``.
            Nothing where one run alone is fitted. Phases of ripples may be another in each of several runs, held-out
            ones included: no log says where an encoder began to count.

        Raises
        ------
        StudyError
            Such a parameter is fixed, or a friction state, a delay or a filter depends on it.
        """
        wanted = [n for n in self.study.own_parameters(self.data.library) if n in model.parameters]
        if not (wanted or phases(model)) or "is_test" not in vars(self.data):  # runs are not cut yet
            return {}
        return self.data.memo(("parameters.own", model.key), lambda: self._own(model, wanted))

    def _own(self, model, wanted):
        where, question = f"{self.study.path}: [fit] own", self.data.ask(model)
        behind = {*dependent_parameters(question)}
        for name in wanted:
            setting = self.study.parameters.get(name)
            if setting is not None and setting.fixed:
                raise StudyError(f"{where} gives '{name}' a value in each run, but [parameters] says fixed = true; "
                                 "take one of them out")
            if name in behind:
                raise StudyError(f"{where}: a friction state, a delay or a filter depends on '{name}', which has one "
                                 "value for all runs; take it out of own, or give each run a study of its own")
        fitted, labels = self._fitted_runs(), self.labels
        free = [n for n in phases(model) if not (self.study.parameters.get(n) and self.study.parameters[n].fixed)]
        return {**{n: {int(k): f"{n}[{labels[k]}]" for k in fitted} for n in wanted if len(fitted) > 1},
                **{n: {k: f"{n}[{label}]" for k, label in enumerate(labels)} for n in free if len(labels) > 1}}

    @property
    def labels(self):
        """What a value of a run is named after, as ``monday`` in ``zero_H[monday]``: a list of str, one a run."""
        stems = [log.name.rpartition(".")[0].replace(".", "_") or log.name for log in self.data.logs]
        return [s if stems.count(s) == 1 else f"{s}#{k + 1}" for k, s in enumerate(stems)]

    def _fitted_runs(self):
        return np.unique(self.data.blocks.run[~self.data.is_test])

    def along(self, model, names, values):
        """Parameters along the log, where runs may have values of their own.

        Parameters
        ----------
        model : Model
            Of the study's rig, with whatever effects are attached.
        names : list of str
            Parameters that are wanted.
        values : dict of str to float
            All parameters, those of single runs among them.

        Returns
        -------
        list of float or ndarray, shape (n,)
            One for each name: a number, or, for a parameter with values of its own in runs, one at every sample.
        """
        own, found = self.own(model), []
        for name in names:
            found.append(float(values[name]))
            if name in own:
                found[-1] = np.full(len(self.data.time), found[-1])
                for run, value in own[name].items():
                    found[-1][self.data.run == run] = values.get(value, values[name])
        return found

    def means(self, effect, components):
        """Parameters of an effect that stand for something of the logs.

        Parameters
        ----------
        effect : Effect
            Its `means` say which of its parameters stand for something of the logs.
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
            elif source in self.data.measured:
                found[name] = float(self.data.measured[source].mean())
        return found

    def _travelled(self, effect, components, variable):
        """Least and greatest value of a variable of a place, as ``friction.phi``, over all samples."""
        def make():
            parameters = {**{n: v.value for n, v in self.data.base.parameters.items()}, **self.values(self.data.base)}
            names = [f"{c}.{variable}" for c in components]
            known = self.data.segment_signals(self.data.base, parameters, names)
            for component in components if variable == "flange.phi" else ():  # of a motor: its encoder, less the zero
                angle = self.data.signals.get(f"{component}.phi")
                if angle is not None:
                    known[f"{component}.{variable}"] = angle - parameters.get(f"{component}.zero", 0.0)
            missing = [n for n in names if n not in known or np.ptp(known[n]) == 0]
            if missing:
                raise StudyError(f"{self.study.path}: '{effect.id}' at {' and '.join(components)} is a function of "
                                 f"'{missing[0]}', which does not change in these logs or does not follow from them; "
                                 "log an angle that moves, or take the effect out")
            values = [known[n] for n in names]
            return float(np.min(values)), float(np.max(values))
        return self.data.memo(("parameters.travelled", tuple(components), variable), make)

    def values(self, model):
        """Values that the study sets.

        Parameters
        ----------
        model : Model
            Of the study's rig, with whatever effects are attached.

        Returns
        -------
        dict of str to float
            Without parameters that the model does not have.
        """
        return {n: s.value for n, s in self.study.parameters.items() if s.value is not None and n in model.parameters}

    def free(self, model, start=()):
        """Free parameters: those the study names and does not fix, encoder zeros, and the attached effects' own.

        Parameters
        ----------
        model : Model
            Of the study's rig, with whatever effects are attached.
        start : collection of str
            Parameters that have a value already: a ripple has a phase in each run where the study says so or these do.

        Returns
        -------
        list of str
        """
        named = [n for n, s in self.study.parameters.items() if s.fixed is False and n in model.parameters]
        named += [n for n in self.data.zeros if n not in self.study.parameters]
        for effect, place in model.attached:
            named += [n for n in model.effect_parameters(effect, place)
                      if n not in named and not (self.study.parameters.get(n) and self.study.parameters[n].fixed)]
        asked = [n for n in self.study.own_parameters(self.data.library) if n in model.parameters]
        own = {n: runs for n, runs in self.own(model).items() if n in asked or not set(runs.values()).isdisjoint(start)}
        named += [n for n in asked if n not in named]
        fitted = set(self._fitted_runs()) if own else ()
        return [value for n in named for value in (
            [v for k, v in own[n].items() if k in fitted] if n in own else [n])]

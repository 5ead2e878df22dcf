"""A fitted model in; its parameters, errors and plots, a diagnosis, and the model with one more effect, out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import pandas as pd

from ..compile import find_effect
from ..core.errors import StudyError, UnknownNameError, closest
from ..core.given import file_path, one_of, shortened, whole_number
from ..diagnosis import compare, search
from ..diagnosis.dependence import dependence, noise_floor
from ..diagnosis.first_look import first_look as look
from ..diagnosis.table import Table
from ..fit import draws, least_squares
from ..report import plots, records, sentences
from ..study.schema import Study
from .confirmed import Confirmation, confirmed
from .diagnosed import Candidate, Diagnosis
from .drawn import Draws
from .exported import Export
from .planned import Plan
from .progress import finish
from .shown import Recorded, Shown, xarray_module

if TYPE_CHECKING:
    from .project import Project


@dataclass(frozen=True, repr=False)
class Parameter(Shown):
    """A fitted parameter.

    Attributes
    ----------
    name, unit, description : str
        Name in the rig, as ``s1A.f0``; SI unit, ``1`` for a number without one; what Modelica says of it.
    value : float
        In the unit, SI.
    ci95 : (float, float)
        95 % confidence interval, within the bounds.
    stderr : float
        Standard error; infinite where the data do not determine the parameter by itself.
    at_bound : str or None
        ``min`` or ``max``.
    identifiable : bool
        Whether the data determine it by itself.
    """

    name: str
    value: float
    ci95: tuple[float, float]
    stderr: float
    unit: str
    at_bound: str | None
    identifiable: bool
    description: str

    @classmethod
    def of(cls, name: str, entry: Mapping[str, Any]) -> Parameter:
        """A parameter from its entry of ``parameters.json``.

        Parameters
        ----------
        name : str
            In the rig, as ``s1A.f0``.
        entry : dict
            ``null`` is an end of the interval, or a standard error, that the data do not limit.

        Returns
        -------
        Parameter
        """
        low, high = entry["ci95"]
        return cls(name, float(entry["value"]), (-np.inf if low is None else low, np.inf if high is None else high),
                   np.inf if entry["stderr"] is None else entry["stderr"], entry["unit"], entry["at_bound"],
                   entry["identifiable"], entry["description"])

    def __float__(self) -> float:
        return self.value

    def _headline(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{self.name} = {self.value:.4g}{unit}, 95 %: {self.ci95[0]:.4g} to {self.ci95[1]:.4g}{unit}"

    def to_frame(self) -> Any:
        """The parameter as a row of the table that `Parameters` gives.

        Returns
        -------
        pandas.DataFrame
        """
        return Parameters({self.name: self}).to_frame()


class Parameters(Mapping[str, Parameter], Shown):
    """Fitted parameters by name; a mistyped one is answered with the nearest.

    Parameters
    ----------
    known : dict of str to Parameter
        By name, as ``s1A.f0``, in the order of the fit.
    """

    def __init__(self, known: dict[str, Parameter]):
        self._known = known

    def __getitem__(self, name: str) -> Parameter:
        if name not in self._known:
            raise UnknownNameError(f"no fitted parameter '{name}'{closest(name, self._known)}")
        return self._known[name]

    def __contains__(self, name: object) -> bool:
        return name in self._known

    def __iter__(self) -> Iterator[str]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)

    def _headline(self) -> str:
        return ", ".join(f"{n} = {p.value:.4g}{'' if p.unit == '1' else ' ' + p.unit}" for n, p in self.items())

    def to_frame(self) -> Any:
        """The parameters as a table.

        Returns
        -------
        pandas.DataFrame
            Indexed by parameter: value, ci95_low, ci95_high, stderr, unit, at_bound, identifiable, description.
        """
        rows = [{"parameter": n, "value": p.value, "ci95_low": p.ci95[0], "ci95_high": p.ci95[1], "stderr": p.stderr,
                 "unit": p.unit, "at_bound": p.at_bound, "identifiable": p.identifiable, "description": p.description}
                for n, p in self.items()]
        columns = ["parameter", "value", "ci95_low", "ci95_high", "stderr", "unit", "at_bound", "identifiable",
                   "description"]
        return pd.DataFrame(rows, columns=columns).set_index("parameter")


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Recorded):
    """Errors of a model, whole and by groups of samples.

    Attributes
    ----------
    kept : dict
        Its record.
    """

    FILE: ClassVar[str] = "comparison.json"
    LEFT_BY: ClassVar[str] = "'pycosim compare'"
    KEYS: ClassVar[tuple[str, ...]] = ("error", "by", "units")

    kept: dict[str, Any]

    @property
    def record(self) -> dict[str, Any]:
        """``comparison.json``."""
        return self.kept

    @property
    def error(self) -> dict[str, float]:
        """RMSE of each channel over the moving samples."""
        return dict(self.record["error"])

    @property
    def sentences(self) -> list[str]:
        """The errors, and where they are largest, in words."""
        return sentences.summary_comparison(self.record)

    @classmethod
    def _loaded(cls, record: dict[str, Any], absent: Any) -> Comparison:
        return cls(record)

    def _headline(self) -> str:
        return sentences.errors_text(self.record["error"], self.record["units"])

    def to_frame(self) -> Any:
        """Errors as a table.

        Returns
        -------
        pandas.DataFrame
            A row a grouping, group and channel: rmse, unit.

        Examples
        --------
        >>> import pycosim as pc
        >>> table = pc.open("study.toml").compare().to_frame()
        >>> list(table.columns)
        ['grouping', 'group', 'channel', 'rmse', 'unit']
        """
        units = self.record["units"]
        rows = [("all", "all", c, v, units[c]) for c, v in self.record["error"].items()]
        rows += [(name, group, c, v, units[c]) for name, groups in self.record["by"].items()
                 for group, error in groups.items() for c, v in error.items()]
        return pd.DataFrame(rows, columns=["grouping", "group", "channel", "rmse", "unit"])

    def to_xarray(self) -> Any:
        """Errors with named dimensions.

        Returns
        -------
        xarray.Dataset
            A variable a grouping, over its groups (in their order) and the channels.

        Raises
        ------
        UnknownNameError
            xarray is not installed.
        """
        xarray, found = xarray_module(), {}
        for name, groups in self.record["by"].items():
            channels = list(dict.fromkeys(c for error in groups.values() for c in error))
            values = [[error.get(c, np.nan) for c in channels] for error in groups.values()]
            if groups:
                found[name] = xarray.DataArray(values, dims=(f"{name} group", "channel"),
                                               coords={f"{name} group": list(groups), "channel": channels})
        return xarray.Dataset(found, attrs={"units": str(self.record["units"])})


@dataclass(frozen=True, eq=False, repr=False)
class Fitted(Recorded):
    """A fitted model.

    Attributes
    ----------
    project : Project
        The study and the logs that it was fitted to.
    model : Model
        The rig with its effects.
    solution : Fit
        All that the fit knows: covariance, undetermined directions, noise.
    notes : tuple of str
        What must be said of an effect that was added last.
    reached : pycosim.diagnosis.search.Step or None
        How the model was come to, where that is known.
    kept : dict or None
        The record that it was loaded from.
    """

    FILE: ClassVar[str] = "parameters.json"
    LEFT_BY: ClassVar[str] = "'pycosim identify'"
    KEYS: ClassVar[tuple[str, ...]] = ("parameters", "null_directions", "error", "units")

    project: Project
    model: Any
    solution: Any
    notes: tuple[str, ...] = ()
    reached: Any = None
    kept: dict[str, Any] | None = None

    # ---- what it is

    @property
    def dataset(self) -> Any:
        """The logs, arranged for a fit."""
        return self.project.dataset

    @property
    def effects(self) -> list[str]:
        """Effects in the model, as ``stribeck@2A``."""
        return list(self.record["effects"])

    @cached_property
    def params(self) -> Parameters:
        """Fitted parameters by name.

        Examples
        --------
        >>> import pycosim as pc
        >>> fit = pc.open("study.toml").fit()
        >>> low, high = fit.params["s1A.f0"].ci95
        >>> low < fit.params["s1A.f0"].value < high
        True
        """
        return Parameters({n: Parameter.of(n, entry) for n, entry in self.record["parameters"].items()})

    @property
    def error(self) -> dict[str, float]:
        """RMSE of each channel over the moving samples that were fitted, in the channel's unit."""
        return dict(self.record["error"] if self.kept is not None else self.step.error)

    @property
    def held_out_error(self) -> dict[str, float]:
        """RMSE of each channel over the moving samples that were held out; empty where none were."""
        return dict(self.step.held_out_error)

    @cached_property
    def step(self) -> Any:
        """The fit as a step of a search, with its errors."""
        if self.reached is not None:
            return self.reached
        self.project.say("computing errors")
        return search.step_of(self.dataset, self.model, self.solution)

    @cached_property
    def study(self) -> Study:
        """The study with this model's effects, and the fitted values to start from."""
        made: Study = records.improved_study(self.project.study, self.model, self.solution)
        return made

    @cached_property
    def record(self) -> dict[str, Any]:
        """``parameters.json``; beyond the contract the study's name, and the effects that are in the model."""
        if self.kept is not None:
            return self.kept
        made = records.parameters(self.solution, self.model, self.project.study.seed)
        return {**made, "study": self.project.study.name,
                "effects": [f"{e.id}@{p.name}" for e, p in self.model.attached]}

    @classmethod
    def _loaded(cls, record: dict[str, Any], absent: Any) -> Fitted:
        named = {"study": record.get("study", absent.path.stem), "effects": record.get("effects", [])}
        return cls(absent, absent, absent, kept={**record, **named})

    def to_frame(self) -> Any:
        """The parameters as a table; see `Parameters.to_frame`.

        Returns
        -------
        pandas.DataFrame
        """
        return self.params.to_frame()

    @property
    def sentences(self) -> list[str]:
        """Parameters with intervals, and what the data cannot tell, in words."""
        return sentences.summary_parameters(self.record)

    @property
    def doubts(self) -> list[str]:
        """Whether a slip in the study or the log is likelier than a missing effect, in words."""
        return sentences.summary_doubt(self.dataset, self.solution)

    @cached_property
    def first_look(self) -> list[str]:
        """The error against its noise floor, what it depends on and the likeliest effects, before any test, in words.

        Examples
        --------
        >>> import pycosim as pc
        >>> pc.open("study.toml").fit().first_look[-1].startswith("Likeliest so far")
        True
        """
        given = self.dataset, self.model, self.solution
        told = dependence(*given, self.project.study.seed)
        return sentences.summary_first_look(self.solution.error, noise_floor(*given), told, look(Table(*given)),
                                            self.dataset.units)

    @property
    def undetermined(self) -> list[str]:
        """Combinations of parameters that these data do not determine, in words."""
        return list(dict.fromkeys(d["text"] for d in self.record["null_directions"]))

    def _headline(self) -> str:
        parts = [self.record["study"], f"{len(self.params)} parameters", *self.effects]
        return f"{', '.join(parts)}; error {sentences.errors_text(self.record['error'], self.record['units'])}"

    @property
    def plot(self) -> plots.FitPlots:
        """Plots: ``over_time``, ``residuals``, ``where_it_fails``, ``map``, ``intervals``, ``manoeuvres``.

        All but ``intervals`` need the log.
        """
        return plots.FitPlots(lambda: self.dataset, self.model, self.solution, self.record)

    # ---- what it does

    def compare(self, part: str = "all", given: bool = False) -> Comparison:
        """Errors, and where they are.

        Parameters
        ----------
        part : str
            ``fit``, ``test`` or ``all`` samples.
        given : bool
            Add the errors with the study's own values, nothing fitted.

        Returns
        -------
        Comparison
        """
        one_of(part, "part", ("fit", "test", "all"))
        result = compare.compare(self.dataset, self.model, self.solution, part)
        if given:
            before = least_squares.fit(self.dataset, self.model, free=[])
            result["error_as_given"] = compare.errors(self.dataset, self.model, before, part)
        return Comparison(records.plain(result))

    def diagnose(self) -> Diagnosis:
        """Which effect the model lacks, where, how sure; or nothing; or nothing known.

        Returns
        -------
        Diagnosis
            The same object each time: chance is drawn from the study's seed.

        Examples
        --------
        >>> import pycosim as pc
        >>> found = pc.open("study.toml").fit().diagnose()
        >>> found.verdict, found.best.name
        ('missing_effect', 'stribeck@2A')
        """
        return self._diagnosis

    @cached_property
    def _diagnosis(self) -> Diagnosis:
        self.project.check().refuse()
        self.project.study.refuse_own("diagnose", self.project.library)
        found = search.diagnosed(self.dataset, self.model, self.solution, self.project.study.seed,
                                 self.project.saying(self))
        if found.travels:
            return self._with_travels(found.travels).diagnose()
        if found.winner is not None and self.dataset.is_test.any():
            winner = Diagnosis(self, found).candidates[found.winner.key]
            found.winner.held_out_error = self.add(winner).held_out_error
        finish(self.project.say)
        return Diagnosis(self, found)

    def _with_travels(self, travels: dict[str, float]) -> Fitted:
        """The model fitted where the machine's own friction builds up over other travels than the rig's."""
        project = self.project.with_travels(travels)
        return Fitted(project, self.model, least_squares.fit(project.dataset, self.model, self.solution.parameters))

    def add(self, effect: str | Candidate) -> Fitted:
        """The model with one more effect, fitted.

        Parameters
        ----------
        effect : str or Candidate
            As ``stribeck@2A``; ``stribeck`` alone tries every place and takes the best by cross-validation.

        Returns
        -------
        Fitted
            A new object; `notes` says how well the data support it.

        Raises
        ------
        UnknownNameError
            No such effect or place.
        StudyError
            It is in the model already, does what a free parameter does, or is not given as one text.

        Examples
        --------
        >>> import pycosim as pc
        >>> fit = pc.open("study.toml").fit()
        >>> better = fit.add("stribeck@2A")
        >>> better.error["C_H"] < 0.7 * fit.error["C_H"]
        True
        >>> fit.effects, better.effects
        ([], ['stribeck@2A'])
        """
        if not isinstance(effect, (str, Candidate)):
            raise StudyError(f"{shortened(effect)} is no effect to add; give one, as \"stribeck@2A\", or a candidate "
                             "of a diagnosis")
        self.project.check().refuse()
        text = effect if isinstance(effect, str) else effect.name
        study = replace(self.project.study, effects=[(e.id, p.name) for e, p in self.model.attached])
        name, places = search.addable(study, self.project.library, self.model, text)
        # a diagnosis says nothing of an effect that stands in no ranking, and knows no parameters of single runs
        library = self.project.library
        asked = not (self.project.study.own_values(library) or find_effect(library, name).by_name)
        told = effect.diagnosis if isinstance(effect, Candidate) else self.diagnose() if asked else None
        found = None if told is None else told.found
        # the same model, where the diagnosis found travels of the machine's own
        base = told.fitted if told is not None and told.kept is None and told.fitted.model is self.model else self
        made = search.add(base.dataset, base.model, base.solution, name, places, found, self.project.say)
        if made is None:
            raise StudyError(f"{study.path}: '{name}' cannot be fitted at any place of {study.rig} on these data")
        finish(self.project.say)
        notes = (*sentences.summary_addition(made), *sentences.travels_text(base.project.own_travels))
        return Fitted(base.project, made.step.model, made.step.fit, notes, made.step)

    def confirm(self, data: Any) -> Confirmation:
        """Whether the model's effects, with the fitted values, hold on a log that was never searched.

        Parameters
        ----------
        data : path, pandas.DataFrame, list of these, or dict of str to pandas.DataFrame
            The new logs; see `Project.confirm`.

        Returns
        -------
        Confirmation

        Raises
        ------
        StudyError, DataError
            As of `Project.confirm`.
        """
        new = replace(self.project, study=self.study, model=self.model).with_data(data)
        return confirmed(new, self.study)

    def plan(self, goal: str = "parameters", budget: float = 120.0, rate: float = 100.0,
             criterion: str = "intervals", between: Sequence[str] | None = None) -> Plan:
        """The next experiment, from what these data tell; parameters as for `Project.plan`.

        Parameters
        ----------
        goal : str
            ``parameters``, ``alternatives`` or ``detect``.
        budget : float
            [s]
        rate : float
            [Hz]
        criterion : str
            What counts as narrow: ``intervals``, ``D`` or ``E``.
        between : pair of str, optional
            Two effects with their places, to be told apart.

        Returns
        -------
        Plan

        Raises
        ------
        PlanError
            The limits leave no experiment, or nothing can be learnt.
        """
        return Plan.made(self.project, self.study, self.model, self.dataset, self.solution, goal, budget, rate,
                         criterion, between)

    def draw(self, n: int, bounded: bool = True, seed: int | None = None) -> Draws:
        """Parameter sets that the data allow.

        Parameters
        ----------
        n : int
            How many sets.
        bounded : bool
            Keep within the bounds.
        seed : int, optional
            The study's by default.

        Returns
        -------
        Draws
            See `pycosim.fit.draws.draw`.

        Raises
        ------
        StudyError
            `n` or `seed` is no whole number, or below zero.
        """
        seed = self.project.study.seed if seed is None else whole_number(seed, "seed", 0)
        found = draws.draw(self.solution, whole_number(n, "the number of sets to draw", 100), bounded, seed)
        return Draws(**vars(found))

    def export(self, folder: str | PathLike[str], to: str = "fmu", fmi: int = 2, kinds: Sequence[str] = ("cs", "me"),
               platforms: str = "host", real: str = "double", self_contained: bool = False) -> Export:
        """The fitted machine for another tool; parameters as for `Project.export`.

        Parameters
        ----------
        folder : path
            Made, or replaced whole where an export made it.
        to : str
            Format, as ``fmu`` or ``c``.
        fmi : int
            Version of the FMU, 2 or 3.
        kinds : sequence of str
            Of the FMU: ``cs`` (co-simulation), ``me`` (model exchange).
        platforms : str
            Binaries of the FMU: of this machine (``host``), or for Linux, Windows and macOS (``all``).
        real : str
            Type of every number of the C export, ``double`` or ``float``.
        self_contained : bool
            Whether the Modelica export needs no library beside it.

        Returns
        -------
        Export
        """
        model = self.study.validate(self.project.library)
        return Export.made(self.study, model, folder, to, fmi, kinds, platforms, real, self_contained)

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the study with this model's effects and the fitted values; ``pycosim.open`` reads it.

        Parameters
        ----------
        path : path
            Ends in ``.toml``; another file than the study was read from, which is never changed. One that ends in
            ``.json`` gets ``parameters.json`` instead, which `load` reads.

        Returns
        -------
        Path

        Raises
        ------
        StudyError
            The file is the given study, is there and is no study, or cannot be written.
        """
        from .project import saved
        if file_path(path, "name.toml").suffix == ".json":
            return super().save(path)
        return saved(self.study, self.project.study, path)

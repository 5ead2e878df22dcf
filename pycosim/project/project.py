"""A study file and logs in; a project, from which everything else starts, out."""

from __future__ import annotations

import os
import shlex
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from ..compile import shared_library
from ..core.early import tell_early
from ..core.errors import DataError, StudyError
from ..core.given import file_path, shortened
from ..data.asked import Asked
from ..data.checks import check
from ..data.dataset import Dataset
from ..data.frames import Frame
from ..data.logs import Log, load, require_units
from ..diagnosis import search, starts
from ..fit import least_squares
from ..report import sentences
from ..study.parse import load_study
from ..study.schema import Setting, Study
from ..study.write import write_study
from .checked import Check
from .confirmed import Confirmation, confirmed, refuse
from .diagnosed import Diagnosis
from .exported import Export
from .fitted import Comparison, Fitted
from .planned import Plan
from .progress import Continued, Say, finish, usual
from .searched import Search
from .shown import Shown, replaceable

AnyPath: TypeAlias = str | os.PathLike[str]
Data: TypeAlias = AnyPath | pd.DataFrame | Sequence[AnyPath | pd.DataFrame] | Mapping[str, pd.DataFrame]


def open_project(study: AnyPath | Study, data: Data | None = None, progress: Say | None = None,
                 robust: bool = False) -> Project:
    """Open a study; as ``pycosim.open``.

    The study is checked against the Modelica library and the study's own files: a mistyped parameter, effect, place,
    variable or unit is refused here. Logs are read when they are first needed.

    Parameters
    ----------
    study : path or Study
        Study file (TOML).
    data : path, pandas.DataFrame, list of these, or dict of str to pandas.DataFrame, optional
        Logs instead of the study's own. The columns of a table are named as those of a file would be.
    progress : callable, optional
        Called with a sentence before each stage of long work. A line below the cell in a notebook by default.
    robust : bool
        Count samples that are far out for less, as ``[fit] robust = true`` in the study does.

    Returns
    -------
    Project

    Raises
    ------
    StudyError
        The study is missing, broken, or contradicts itself.
    UnknownNameError
        Something in it has a name that its rig or the library does not have.
    BoundsError
        A value outside the bounds of its parameter.

    Examples
    --------
    >>> import pycosim as pc
    >>> pc.open("study.toml")
    <Project: study, HipKnee, 8 free parameters, 1 log>

    The same on a table in memory:

    >>> import pandas as pd
    >>> pc.open("study.toml", data=pd.read_csv("run.csv"))
    <Project: study, HipKnee, 8 free parameters, 1 log>
    """
    given: Study = study if isinstance(study, Study) else load_study(file_path(study, "study.toml"))
    if data is not None:
        given = on_data(given, data)
    if robust:
        given = replace(given, robust=True)
    library = shared_library(given.modelica)
    return Project(given, library, given.validate(library), progress or usual())


def on_data(study: Study, data: Data) -> Study:
    """A study on other logs.

    Parameters
    ----------
    study : Study
        What it says of columns, parameters and effects stays.
    data : path, pandas.DataFrame, list of these, or dict of str to pandas.DataFrame
        Instead of all its logs; keys of a dict name the runs. A table is copied, and does not follow later changes.

    Returns
    -------
    Study

    Raises
    ------
    DataError
        They are neither files nor tables.
    """
    items = _items(data)
    frames = [i for i in items if isinstance(i, (Frame, pd.DataFrame))]
    if not frames:
        return study.with_data([os.fspath(i) for i in items])
    made = [i if isinstance(i, Frame) else Frame("table" if len(frames) < 2 else f"table {k}", i.copy())
            for k, i in enumerate(frames, 1)]
    files = [Path(os.fspath(i)).absolute() for i in items if not isinstance(i, (Frame, pd.DataFrame))]
    return replace(study, runs=[*files, *made], held_out=[])


def _items(data: Any) -> list[Any]:
    """Files and tables, one a log."""
    what = "give a file, a pandas.DataFrame with the columns that the study names, a list of these, or a dict of tables"
    if isinstance(data, Mapping):
        for name, frame in data.items():
            if not isinstance(frame, pd.DataFrame):
                raise DataError(f"data[{name!r}] is {shortened(frame)}, not a table; {what} by the names of their runs")
        return [Frame(str(name), frame) for name, frame in data.items()]
    if isinstance(data, (str, os.PathLike, pd.DataFrame, Frame)):
        data = [data]
    if isinstance(data, (bytes, np.ndarray, pd.Series)) or not isinstance(data, Iterable):
        raise DataError(f"data is {shortened(data)}, neither a file nor a table; {what}")
    items = list(data)
    for k, item in enumerate(items):
        if not isinstance(item, (str, os.PathLike, pd.DataFrame, Frame)):
            raise DataError(f"data[{k}] is {shortened(item)}, neither a file nor a table; {what}")
    return [file_path(i, "run.csv") if isinstance(i, (str, os.PathLike)) and not isinstance(i, Frame) else i
            for i in items]


@dataclass(frozen=True, eq=False, repr=False)
class Project(Shown):
    """A study, checked, with its rig and its logs. Nothing in it changes; what it gives are new objects.

    Attributes
    ----------
    study : Study
        As opened: with the logs that were given instead of its own.
    library : Library
        Modelica classes: the package's own, and the study's.
    model : Model
        The rig with the study's effects.
    say : callable
        Told the stages of long work.
    travels : dict of str to float
        Of the machine's own friction, which a diagnosis found in the logs, and the study now says [rad] or [m].
    """

    study: Study
    library: Any
    model: Any
    say: Say
    travels: dict[str, float] = field(default_factory=dict)

    # ---- what it is

    def _headline(self) -> str:
        free = sum(s.fixed is False for s in self.study.parameters.values())
        logs = len(self.study.runs) + len(self.study.held_out)
        parts = [self.study.name, self.study.rig.rsplit(".", 1)[-1],
                 f"{free} free {'parameter' if free == 1 else 'parameters'}",
                 f"{logs or 'no'} {'log' if logs == 1 else 'logs'}"]
        return ", ".join([*parts, *(f"{e}@{p}" for e, p in self.study.effects)])

    def to_frame(self) -> Any:
        """What the study says of the rig's parameters.

        Returns
        -------
        pandas.DataFrame
            Indexed by parameter: value, min, max (SI), unit, and whether it is fitted.
        """
        rows = {}
        for name, setting in self.study.parameters.items():
            known = self.model.parameters[name]
            rows[name] = {k: getattr(known if getattr(setting, k) is None else setting, k)
                          for k in ("value", "min", "max")} | {"unit": known.unit, "fitted": setting.fixed is False}
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")

    @cached_property
    def dataset(self) -> Dataset:
        """The logs, checked and arranged for a fit; read once."""
        if not self.study.accept:
            require_units(self._logs)
        made = Dataset(self.study, self.library, self._logs)
        finish(self.say)
        return made

    @cached_property
    def _logs(self) -> list[Log]:
        self.say("reading the logs")
        return load(self.study, strict=False)

    @property
    def samples(self) -> list[Log]:
        """The logs sample by sample, also of files that count as one sample each."""
        return load(replace(self.study, average=None), strict=False) if self.study.average else self._logs

    def check(self) -> Check:
        """What is wrong with the logs before any physics: signs, swaps, units, clocks, outliers.

        Returns
        -------
        Check

        Raises
        ------
        DataError
            A log cannot be read, or lacks a column that a fit needs.
        StudyError
            The study names a reference that no log holds.

        Examples
        --------
        >>> import pycosim as pc
        >>> pc.open("study.toml").check().blocking
        False
        """
        return self._checked

    @cached_property
    def _checked(self) -> Check:
        logs = self._logs
        Asked.of(self.study, self.model, logs).require(self.study, logs)  # of what no verb could use, nothing is right
        self.say("checking the logs")
        made = Check(check(self.study, self.library, self.model, logs), self.study)
        finish(self.say)
        return made

    @property
    def sentences(self) -> list[str]:
        """What was used of the logs, in words."""
        return sentences.summary_data(self.dataset)

    def with_data(self, data: Data) -> Project:
        """The same project on other logs.

        Parameters
        ----------
        data : path, pandas.DataFrame, list of these, or dict of str to pandas.DataFrame
            Instead of all logs of the study, its columns named as it maps them; keys of a dict name the
            runs.

        Returns
        -------
        Project
        """
        return replace(self, study=on_data(self.study, data))

    def with_travels(self, travels: dict[str, float]) -> Project:
        """The same project where the machine's own friction builds up over other travels than the rig's.

        Parameters
        ----------
        travels : dict of str to float
            By parameter, as ``s1A.travel``: [rad] or [m].

        Returns
        -------
        Project
            Its study has them as fixed parameters.
        """
        known = self.study.parameters
        told = {n: replace(known.get(n, Setting()), value=v, fixed=True) for n, v in travels.items()}
        made = replace(self, study=replace(self.study, parameters={**known, **told}), travels=travels)
        made.__dict__.update({n: v for n, v in self.__dict__.items() if n in ("_logs", "_checked")})
        return made

    @property
    def own_travels(self) -> dict[str, dict[str, Any]]:
        """The travels that a diagnosis found, by parameter: ``value``, ``unit``, and ``rig``, what the rig says."""
        known = self.model.parameters
        return {n: {"value": v, "unit": known[n].unit, "rig": known[n].value} for n, v in self.travels.items()}

    # ---- what it does

    def fit(self) -> Fitted:
        """Fit the study's free parameters.

        Returns
        -------
        Fitted
            The same object each time: a fit has no chance in it.

        Raises
        ------
        DataError
            A log cannot be used.

        Examples
        --------
        >>> import pycosim as pc
        >>> fit = pc.open("study.toml").fit()
        >>> fit.params["s1A.f0"].unit
        'N.m'
        """
        return self._fitted

    @cached_property
    def _fitted(self) -> Fitted:
        dataset = self.dataset
        self.say("fitting")
        made = Fitted(self, self.model, starts.fitted(dataset, self.model, self.say))
        finish(self.say)
        return made

    def first_look(self) -> list[str]:
        """What the fitted model's error says at first sight, told at once to whoever hears partial answers.

        A second or two for 40,000 samples, before the check of the data and before any test; it decides nothing.

        Returns
        -------
        list of str
            As of `Fitted.first_look`.

        Raises
        ------
        PycosimError
            A log cannot be used.
        """
        return self._first_look

    @cached_property
    def _first_look(self) -> list[str]:
        fitted = self.fit()
        self.say("looking at the error")
        made = fitted.first_look
        tell_early(self.say, " ".join(made))
        finish(self.say)
        return made

    def saying(self, fitted: Fitted | None = None) -> Continued:
        """What a diagnosis says its stages to: a first look that was told is not told again.

        Parameters
        ----------
        fitted : Fitted, optional
            What is diagnosed; without, it is a search.

        Returns
        -------
        callable
        """
        told = "_first_look" in self.__dict__ and fitted in (None, self._fitted)
        return Continued(self.say, told, several=fitted is None)

    def as_given(self) -> Fitted:
        """The model with the study's own values, nothing fitted.

        Returns
        -------
        Fitted
        """
        return Fitted(self, self.model, least_squares.fit(self.dataset, self.model, free=[]))

    def compare(self) -> Comparison:
        """Errors of the fitted model, and where they are; see `Fitted.compare`.

        Returns
        -------
        Comparison
        """
        return self.fit().compare()

    def diagnose(self) -> Diagnosis:
        """Which effect the fitted model lacks; see `Fitted.diagnose`.

        Returns
        -------
        Diagnosis
        """
        return self.fit().diagnose()

    def improve(self) -> Search:
        """Diagnose, add, refit, until no effect is accepted.

        Returns
        -------
        Search

        Raises
        ------
        DataError
            A log cannot be used.

        Examples
        --------
        >>> import pycosim as pc
        >>> found = pc.open("study.toml").improve()
        >>> [step.added for step in found.steps]
        [None, 'stribeck@2A']
        >>> found.verdict
        'nothing_missing'
        """
        self.check().refuse()
        dataset = self.dataset
        self.study.refuse_own("improve", self.library)
        found = search.improve(dataset, self.model, self.study.seed, self.saying())
        if found.last.travels:
            return self.with_travels(found.last.travels).improve()
        finish(self.say)
        return Search(self, found)

    def confirm(self, data: Data | None = None) -> Confirmation:
        """Whether the study's effects, frozen, hold on a log that was never searched; nothing is fitted to it.

        Parameters
        ----------
        data : path, pandas.DataFrame, list of these, or dict of str to pandas.DataFrame, optional
            The new logs; by default those that the project was opened with instead of the study's own.

        Returns
        -------
        Confirmation

        Raises
        ------
        StudyError
            There is no new log, or a log is one that the effects were found on, under whatever name; or the study
            claims no effect.
        DataError
            A log cannot be used, or has a mistake of wiring or units.
        """
        if data is None:
            return confirmed(self)
        unsaved = not self.study.path.is_file()
        return confirmed(self.with_data(data), *([self.study] if unsaved else []))

    def confirmable(self) -> None:
        """Refuse what `confirm` would refuse, before a log is read.

        Raises
        ------
        StudyError
            There is no new log, or nothing that it could confirm.
        """
        refuse(self)

    def places(self, effect: str) -> tuple[str, list[str]]:
        """Where an effect can still be added.

        Parameters
        ----------
        effect : str
            As ``stribeck@2A``, or ``stribeck`` for all its places.

        Returns
        -------
        effect : str
        places : list of str

        Raises
        ------
        UnknownNameError, StudyError
            It cannot be added there.
        """
        return search.addable(self.study, self.library, self.model, str(effect))

    def plan(self, goal: str = "parameters", budget: float = 120.0, rate: float = 100.0,
             criterion: str = "intervals", between: Sequence[str] | None = None) -> Plan:
        """The next experiment, from what is known by now; from the study alone where it has no logs.

        Parameters
        ----------
        goal : str
            ``parameters`` narrows intervals, ``alternatives`` separates what a diagnosis could not, ``detect`` shows
            what no data could.
        budget : float
            Longest duration [s].
        rate : float
            Samples a second [Hz].
        criterion : str
            Of the parameters: ``intervals``, ``D`` or ``E``.
        between : pair of str, optional
            Separate these two, as ``("stribeck@2A", "viscous@2A")``, whatever a diagnosis says.

        Returns
        -------
        Plan

        Raises
        ------
        PlanError
            The limits leave no experiment, or nothing can be learnt.
        """
        if self.study.runs or self.study.held_out:
            return self.fit().plan(goal, budget, rate, criterion, between)
        return Plan.made(self, self.study, self.model, None, None, goal, budget, rate, criterion, between)

    def report(self, path: AnyPath) -> Path:
        """Search, and write the page that tells it; see `Search.report`.

        Parameters
        ----------
        path : path
            The HTML file.

        Returns
        -------
        Path
        """
        return self.improve().report(path)

    def export(self, folder: AnyPath, to: str = "fmu", fmi: int = 2, kinds: Sequence[str] = ("cs", "me"),
               platforms: str = "host", real: str = "double", self_contained: bool = False) -> Export:
        """The machine with the study's values, for another tool.

        Parameters
        ----------
        folder : path
            Made, or replaced whole where an export made it.
        to : str
            ``fmu``, ``c``, ``cpp``, ``modelica``, ``ssp``, ``mujoco``, ``mujoco-plugin``, ``jax`` or ``json``.
        fmi : int
            2 or 3.
        kinds : sequence of str
            ``cs`` (co-simulation), ``me`` (model exchange).
        platforms : str
            ``host`` or ``all``.
        real : str
            ``double`` or ``float``, of the C export.
        self_contained : bool
            Whether the Modelica export brings the classes of the library along.

        Returns
        -------
        Export

        Raises
        ------
        ExportError, StudyError
            The rig has no such export, a tool for it is missing, or an option does not fit.
        """
        return Export.made(self.study, self.model, folder, to, fmi, kinds, platforms, real, self_contained)

    def save(self, path: AnyPath) -> Path:
        """Write the study; ``pycosim.open`` reads it again.

        Parameters
        ----------
        path : path
            Ends in ``.toml``; another file than the study was read from, which is never changed.

        Returns
        -------
        Path

        Raises
        ------
        StudyError
            The file is the given study, is there and is no study, or cannot be written.
        """
        return saved(self.study, self.study, path)

    @property
    def command(self) -> str:
        """The command that makes a report of this study and these logs."""
        kept = load_study(self.study.path)
        own = (kept.runs, kept.held_out) == (self.study.runs, self.study.held_out)
        files = (*self.study.runs, *self.study.held_out)
        data = [] if own else ["--data", *(str(p) if isinstance(p, Frame) else os.path.relpath(p) for p in files)]
        robust = ["--robust"] if self.study.robust and not kept.robust else []
        return shlex.join(["pycosim", "report", self.study.path.name, *robust, *data])


def saved(study: Study, given: Study, path: AnyPath) -> Path:
    """Write a study beside the one it comes from.

    Parameters
    ----------
    study : Study
        Its tables in memory are left out.
    given : Study
        The one it comes from.
    path : path
        Paths of logs in it become relative to this one.

    Returns
    -------
    Path

    Raises
    ------
    StudyError
        The file is the given study, is there and is no study, does not end in ``.toml``, or cannot be written.
    """
    target = replaceable(path, ".toml", "a study", _is_study).absolute()
    if target.exists() and target.resolve() == given.path.resolve():
        raise StudyError(f"{path}: is the given study, which is never changed; save under another name")
    runs, held_out = ([p for p in files if not isinstance(p, Frame)] for files in (study.runs, study.held_out))
    written: Path = write_study(replace(study, runs=runs, held_out=held_out), target)
    return written


def _is_study(path: Path) -> bool:
    """Whether a file is a study, also one that names what is no longer there."""
    try:
        return "rig" in tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError):
        return False

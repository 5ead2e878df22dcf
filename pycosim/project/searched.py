"""What a search added, step by step, in; the path of errors, the final model, the report and the files, out."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import pandas as pd

from ..core.errors import StudyError
from ..core.given import file_path
from ..report import controller, plots, records, sentences
from ..report.page import write_numbers, write_report
from .diagnosed import Diagnosis
from .fitted import Fitted
from .progress import finish
from .shown import Recorded, Shown, read_json

if TYPE_CHECKING:
    from .project import Project

RECORDS = "diagnosis", "diagnosis_final", "ladder", "parameters", "comparison"
"""What a search is loaded from: names of the records that ``pycosim improve`` writes."""


@dataclass(frozen=True, eq=False, repr=False)
class Step(Shown):
    """One step of a search.

    Attributes
    ----------
    fitted : Fitted
        The model from this step on.
    record : dict
        The step's entry of ``ladder.json``.
    units : dict of str to str
        By channel.
    """

    fitted: Fitted
    record: dict[str, Any]
    units: dict[str, str]

    @property
    def added(self) -> str | None:
        """The effect that came with this step, as ``stribeck@2A``; None for the base model."""
        added = self.record["added"]
        return f"{added['effect']}@{added['place']}" if added else None

    @property
    def error(self) -> dict[str, float]:
        """RMSE of each channel over the moving samples that were fitted, in the channel's unit."""
        return dict(self.record["error"])

    @property
    def held_out_error(self) -> dict[str, float]:
        """RMSE of each channel over the moving samples that were held out; empty where none were."""
        return dict(self.record["held_out_error"])

    @property
    def predicted_error(self) -> dict[str, float]:
        """What the diagnosis expected before the effect was added; empty where it said nothing."""
        return dict(self.record["predicted_error"] or {})

    def _headline(self) -> str:
        return f"{self.added or 'base model'}: error {sentences.errors_text(self.error, self.units)}"

    def to_frame(self) -> Any:
        """Errors of the step as a table.

        Returns
        -------
        pandas.DataFrame
            Indexed by channel: error, held_out_error, predicted_error, unit.
        """
        parts = {"error": self.error, "held_out_error": self.held_out_error, "predicted_error": self.predicted_error}
        frame = pd.DataFrame(parts, index=list(self.error)).rename_axis("channel")
        frame["unit"] = [self.units[c] for c in frame.index]
        return frame


@dataclass(frozen=True)
class Kept:
    """What a search was loaded from, and what that makes.

    Attributes
    ----------
    record : dict
        The records of ``pycosim improve``, by name.
    steps : tuple of Step
        The base model first; only the last has its parameters.
    first, last : Diagnosis
        Of the base model, and of what is left.
    """

    record: dict[str, Any]
    steps: tuple[Step, ...]
    first: Diagnosis
    last: Diagnosis


@dataclass(frozen=True, eq=False, repr=False)
class Search(Recorded):
    """The way from a base model to one that lacks nothing that the data could show.

    Attributes
    ----------
    project : Project
        The study as given, without what was added.
    found : pycosim.diagnosis.search.Improvement
        Of one that was loaded, what its file keeps of that.
    kept : Kept or None
        What it was loaded from.
    """

    FILE: ClassVar[str] = "search.json"
    LEFT_BY: ClassVar[str] = "save() of a search"
    KEYS: ClassVar[tuple[str, ...]] = RECORDS

    project: Project
    found: Any
    kept: Kept | None = None

    @cached_property
    def record(self) -> dict[str, Any]:
        """All records of a search, as ``pycosim improve`` writes them, by their names."""
        if self.kept is not None:
            return self.kept.record
        made: dict[str, Any] = {"schema": records.SCHEMA, **self._records}
        return made

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Search:
        """Read what `save` has written, or the folder that ``pycosim improve`` has left.

        Parameters
        ----------
        path : path
            File of JSON, or a folder with ``diagnosis.json``, ``diagnosis_final.json``, ``ladder.json``,
            ``parameters.json`` and ``comparison.json``.

        Returns
        -------
        Search
            Shows the same, and has the same table. What needs the log says so with a `ResultError`.

        Raises
        ------
        ResultError
            As of `Recorded.load`; or a file of the folder is missing.
        """
        folder = file_path(path, cls.FILE)
        if not folder.is_dir():
            return super().load(path)
        found = {name: read_json(folder / f"{name}.json", cls) for name in RECORDS}
        return cls._made({"schema": records.SCHEMA, **found}, folder)

    @classmethod
    def _loaded(cls, record: dict[str, Any], absent: Any) -> Search:
        path, steps = record["ladder"], record["ladder"]["steps"]
        final = Fitted._loaded(record["parameters"], absent)
        models = (*(Fitted(absent, absent, absent) for _ in steps[1:]), final)
        kept = Kept(record, tuple(Step(m, s, path["units"]) for m, s in zip(models, steps)),
                    *(Diagnosis(m, records.diagnosis_of(record[name]), final=bool(more), kept=record[name])
                      for name, m, more in (("diagnosis", models[0], False),
                                            ("diagnosis_final", final, len(steps) > 1))))
        return cls(absent, records.improvement_of(path, kept.first.found, kept.last.found), kept)

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """The base model first, then one step an added effect."""
        if self.kept is not None:
            return self.kept.steps
        return tuple(Step(Fitted(self.project, s.model, s.fit, reached=s), entry, self._path["units"])
                     for s, entry in zip(self.found.steps, self._path["steps"]))

    @property
    def added(self) -> list[str]:
        """Effects that were added, in order."""
        return [s.added for s in self.steps if s.added]

    @property
    def final(self) -> Fitted:
        """The last model."""
        return self.steps[-1].fitted

    @cached_property
    def first(self) -> Diagnosis:
        """The diagnosis of the base model."""
        if self.kept is not None:
            return self.kept.first
        return Diagnosis(self.steps[0].fitted, self.found.first)

    @cached_property
    def last(self) -> Diagnosis:
        """The diagnosis of the last model: what is left."""
        if self.kept is not None:
            return self.kept.last
        return Diagnosis(self.final, self.found.last, len(self.steps) > 1)

    @property
    def verdict(self) -> str:
        """Of the last model."""
        return self.last.verdict

    @cached_property
    def _path(self) -> dict[str, Any]:
        if self.kept is not None:
            return dict(self.kept.record["ladder"])
        made: dict[str, Any] = records.ladder(self.found.steps, self.project.dataset)
        return made

    @cached_property
    def _records(self) -> dict[str, dict[str, Any]]:
        """What a search writes by itself, without simulating a controller."""
        return dict(zip(RECORDS, (self.first.record, self.last.record, self._path, self.final.record,
                                  self.final.compare().record)))

    def to_dict(self) -> dict[str, Any]:
        """The path of errors as ``ladder.json`` has it.

        Returns
        -------
        dict
        """
        return copy.deepcopy(self._path)

    @property
    def consequence(self) -> dict[str, Any]:
        """What was found changes for a controller: torque left to its feedback, tracking error and heat.

        Returns
        -------
        dict
            As ``consequence.json`` has it; see `pycosim.report.controller.changes`.
        """
        first, last = self.found.steps[0], self.found.steps[-1]
        self.project.say("simulating a controller with the improved model")
        made: dict[str, Any] = controller.changes(self.project.dataset, (first.model, first.fit),
                                                  (last.model, last.fit))
        return made

    def files(self) -> dict[str, Any]:
        """What ``pycosim improve`` writes: records and texts by file name.

        Returns
        -------
        dict of str to dict or str
        """
        found: dict[str, Any] = {f"{name}.json": record for name, record in self._records.items()}
        found |= {"consequence.json": self.consequence, "model.mo": str(self.found.model.text).rstrip("\n") + "\n"}
        return found | ({"guess.mo": self.last.guess} if self.last.guess else {})

    @property
    def sentences(self) -> list[str]:
        """The whole story, in words."""
        return sentences.summary_improvement(self.first.record, self.last.record, self._path, self.final.record)

    @property
    def changes(self) -> list[str]:
        """What was found changes for a controller, in words; empty where that is nothing."""
        return controller.summary(self.consequence)

    def _headline(self) -> str:
        before, after = self.steps[0].error, self.steps[-1].error
        units = self._path["units"]
        way = ", ".join(self.added) or "nothing added"
        return f"{way}; error {sentences.change_text(before, after, units)}; {self.verdict}"

    def to_frame(self) -> Any:
        """Errors along the path as a table.

        Returns
        -------
        pandas.DataFrame
            A row a step: added, then error and held-out error of each channel.
        """
        return pd.DataFrame([{"added": s.added or ""} | {f"error_{c}": v for c, v in s.error.items()}
                             | {f"held_out_{c}": v for c, v in s.held_out_error.items()} for s in self.steps]
                            ).rename_axis("step")

    @property
    def plot(self) -> plots.SearchPlots:
        """Plots of the search: ``path``, and ``signature``, which needs the log."""
        return plots.SearchPlots(lambda: self.project.dataset, self.found, self._path["units"])

    def report(self, path: str | PathLike[str], numbers: str | PathLike[str] | None = None) -> Path:
        """Write the search as one page (HTML) that opens offline.

        Parameters
        ----------
        path : path
            The HTML file.
        numbers : path, optional
            Folder for what the charts draw, as CSV.

        Returns
        -------
        Path

        Raises
        ------
        StudyError
            The file cannot be written.
        """
        target = file_path(path, "report.html")
        self.project.say("writing the report")
        notes = sentences.travels_text(self.project.own_travels)
        if self.verdict == "nothing_missing":
            notes += sentences.mains_text(self.last.record["channels"])
        try:
            charts = write_report(target, self.project.dataset, self.found, self.project.command,
                                  self.project.check().checked, notes)
            if numbers is not None:
                write_numbers(Path(numbers), charts)
        except OSError as error:
            raise StudyError(f"{path}: cannot be written ({error.strerror})") from None
        finish(self.project.say)
        return target

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the study with what was added and the fitted values; see `Fitted.save`.

        Parameters
        ----------
        path : path
            One that ends in ``.json`` gets all records of the search instead, which `load` reads.

        Returns
        -------
        Path
        """
        if file_path(path, "name.toml").suffix == ".json":
            return super().save(path)
        return self.final.save(path)

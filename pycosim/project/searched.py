"""What a search added, step by step, in; the path of errors, the final model, the report and the files, out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from ..core.errors import StudyError
from ..report import controller, plots, records, sentences
from ..report.page import write_numbers, write_report
from .diagnosed import Diagnosis
from .fitted import Fitted
from .progress import finish
from .shown import Shown

if TYPE_CHECKING:
    from .project import Project


@dataclass(frozen=True, eq=False, repr=False)
class Step(Shown):
    """One step of a search.

    Attributes
    ----------
    fitted : Fitted
        The model from this step on.
    step : pycosim.diagnosis.search.Step
    """

    fitted: Fitted
    step: Any

    @property
    def added(self) -> str | None:
        """The effect that came with this step, as ``stribeck@2A``; None for the base model."""
        return "@".join(self.step.added) if self.step.added else None

    @property
    def error(self) -> dict[str, float]:
        """RMSE of each channel over the moving samples that were fitted."""
        return dict(self.step.error)

    @property
    def held_out_error(self) -> dict[str, float]:
        """RMSE of each channel over the moving samples that were held out; empty where none were."""
        return dict(self.step.held_out_error)

    @property
    def predicted_error(self) -> dict[str, float]:
        """What the diagnosis expected before the effect was added; empty where it said nothing."""
        return dict(self.step.finding.predicted_error) if self.step.finding else {}

    def _headline(self) -> str:
        units = self.fitted.dataset.units
        return f"{self.added or 'base model'}: error {sentences.errors_text(self.error, units)}"

    def to_frame(self) -> Any:
        """Errors of the step as a table.

        Returns
        -------
        pandas.DataFrame
            Indexed by channel: error, held_out_error, predicted_error, unit.
        """
        parts = {"error": self.error, "held_out_error": self.held_out_error, "predicted_error": self.predicted_error}
        frame = pd.DataFrame(parts, index=list(self.error)).rename_axis("channel")
        frame["unit"] = [self.fitted.dataset.units[c] for c in frame.index]
        return frame


@dataclass(frozen=True, eq=False, repr=False)
class Search(Shown):
    """The way from a base model to one that lacks nothing that the data could show.

    Attributes
    ----------
    project : Project
    found : pycosim.diagnosis.search.Improvement
    """

    project: Project
    found: Any

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """The base model first, then one step an added effect."""
        return tuple(Step(Fitted(self.project, s.model, s.fit, reached=s), s) for s in self.found.steps)

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
        return Diagnosis(self.steps[0].fitted, self.found.first)

    @cached_property
    def last(self) -> Diagnosis:
        """The diagnosis of the last model: what is left."""
        return Diagnosis(self.final, self.found.last, len(self.steps) > 1)

    @property
    def verdict(self) -> str:
        """Of the last model."""
        return self.last.verdict

    @cached_property
    def _path(self) -> dict[str, Any]:
        made: dict[str, Any] = records.ladder(self.found.steps, self.project.dataset)
        return made

    def to_dict(self) -> dict[str, Any]:
        """The path of errors as ``ladder.json`` has it.

        Returns
        -------
        dict
        """
        return dict(self._path)

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
        found = {"diagnosis.json": self.first.to_dict(), "diagnosis_final.json": self.last.to_dict(),
                 "ladder.json": self.to_dict(), "parameters.json": self.final.to_dict(),
                 "comparison.json": self.final.compare().record,
                 "consequence.json": self.consequence, "model.mo": str(self.found.model.text).rstrip("\n") + "\n"}
        return found | ({"guess.mo": self.last.guess} if self.last.guess else {})

    @property
    def sentences(self) -> list[str]:
        """The whole story, in words."""
        return sentences.summary_improvement(self.first.to_dict(), self.last.to_dict(), self._path,
                                             self.final.to_dict(), self.project.library)

    @property
    def changes(self) -> list[str]:
        """What was found changes for a controller, in words; empty where that is nothing."""
        return controller.summary(self.consequence)

    def _headline(self) -> str:
        before, after = self.steps[0].error, self.steps[-1].error
        units = self.project.dataset.units
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
        """Plots of the search: ``path``, ``signature``."""
        return plots.SearchPlots(self.project.dataset, self.found)

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
        target = Path(path)
        self.project.say("writing the report")
        try:
            charts = write_report(target, self.project.dataset, self.found, self.project.command,
                                  self.project.check().checked)
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

        Returns
        -------
        Path
        """
        return self.final.save(path)

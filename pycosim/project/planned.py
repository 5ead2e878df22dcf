"""What is known of a rig in; the next experiment, as a table, a file and plots, out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import pandas as pd

from ..core.errors import PlanError, StudyError
from ..core.given import file_path, one_of, real_number, shortened
from ..core.whole import write_whole
from ..design import plan as planning
from ..design.goals import GOALS, goal_named
from ..report import plan_results, plots
from .progress import finish
from .shown import Recorded, xarray_module

if TYPE_CHECKING:
    from .project import Project


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Recorded):
    """The next experiment: a motion of the motors within the study's limits.

    Attributes
    ----------
    planned : pycosim.design.plan.Plan
        The motion, what it is predicted to tell, and the rig's workspace.
    kept : dict or None
        The record that it was loaded from.
    """

    FILE: ClassVar[str] = "plan.json"
    LEFT_BY: ClassVar[str] = "'pycosim plan'"
    KEYS: ClassVar[tuple[str, ...]] = ("goal", "strokes", "ways", "rivals")

    planned: Any
    kept: dict[str, Any] | None = None

    @classmethod
    def made(cls, project: Project, study: Any, model: Any, dataset: Any, solution: Any, goal: str, budget: float,
             rate: float, criterion: str, between: Sequence[str] | None) -> Plan:
        """Plan from what is known.

        Parameters
        ----------
        project : Project
            Gives the library, and is told the stages.
        study : Study
            With the limits that the motion keeps to, and the effects of `model`.
        model : Model
            What is to be learnt about.
        dataset : Dataset or None
            Logs made by now; without any, noise is assumed.
        solution : Fit or None
            Of `model` to these logs: what is known already.
        goal, budget, rate, criterion, between
            As for `Project.plan`.

        Returns
        -------
        Plan
        """
        one_of(goal_named(goal) if isinstance(goal, str) else goal, "goal", GOALS)
        one_of(criterion, "criterion", ("intervals", "D", "E"))
        budget, rate = real_number(budget, "budget", 120.0), real_number(rate, "rate", 100.0)
        if between is not None and (isinstance(between, str) or not isinstance(between, Sequence) or len(between) != 2
                                    or not all(isinstance(b, str) for b in between)):
            raise PlanError(f"between = {shortened(between)} must be two effects, as (\"stribeck@2A\", \"viscous@2A\")")
        study.refuse_own("plan")
        known = planning.known(study, project.library, model, dataset, solution)
        blocks = None
        if between:
            keys = [tuple(text.partition("@")[::2]) for text in between]
            blocks, goal = planning.twins_of(known, [keys], project.say), "alternatives"
        found = planning.make_plan(known, goal, budget, rate, blocks, criterion, project.say)
        finish(project.say)
        return cls(found)

    @cached_property
    def record(self) -> dict[str, Any]:
        """``plan.json``, of which the motion can be made again sample by sample."""
        if self.kept is not None:
            return self.kept
        made: dict[str, Any] = plan_results.plan(self.planned)
        return made

    @classmethod
    def _loaded(cls, record: dict[str, Any], absent: Any) -> Plan:
        return cls(absent, record)

    def to_frame(self) -> Any:
        """The motion as a table.

        Returns
        -------
        pandas.DataFrame
            A row a sample: time [s], angle [rad] and speed [rad/s] of each motor, the label of the stroke.
        """
        return pd.DataFrame(self._table)

    def to_xarray(self) -> Any:
        """The motion with named dimensions.

        Returns
        -------
        xarray.Dataset
            ``angle`` [rad] and ``speed`` [rad/s] over ``motor`` and ``time`` [s]; the strokes' labels over ``time``.

        Raises
        ------
        UnknownNameError
            xarray is not installed.
        """
        motors = [n.removesuffix(".phi") for n in self._table if n.endswith(".phi")]
        values = {name: (("motor", "time"), [self._table[f"{m}.{kind}"] for m in motors])
                  for name, kind in (("angle", "phi"), ("speed", "w"))}
        return xarray_module().Dataset({**values, "manoeuvre": ("time", self._table["manoeuvre"])},
                                       {"motor": motors, "time": self._table["time"]})

    @cached_property
    def _table(self) -> dict[str, Any]:
        made: dict[str, Any] = plan_results.table(self.record)
        return made

    def to_csv(self, path: str | PathLike[str]) -> Path:
        """Write the motion, as ``plan.csv``: a drive can follow it, and a scenario of co-simulation.

        Parameters
        ----------
        path : path
            Replaced where there is one; angles [rad] and speeds [rad/s] at equal times [s].

        Returns
        -------
        Path

        Raises
        ------
        StudyError
            The file cannot be written.
        """
        try:
            return write_whole(file_path(path, "plan.csv"), plan_results.csv(self._table))
        except OSError as error:
            raise StudyError(f"{path}: cannot be written ({error.strerror})") from None

    @property
    def sentences(self) -> list[str]:
        """The experiment in words: how long, which lines, what it will tell."""
        return plan_results.summary(self.record)

    def _headline(self) -> str:
        return self.sentences[0]

    @property
    def plot(self) -> plots.PlanPlots:
        """Plots of the plan: ``motion``, ``workspace``, ``intervals``; they need the rig, which no file holds."""
        return plots.PlanPlots(self.planned)

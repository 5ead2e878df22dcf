"""A study with effects, frozen, and a log that was never searched in; what that log says of each effect out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import pandas as pd

from ..core.errors import DataError, StudyError
from ..data.copies import refuse_known
from ..data.frames import Frame
from ..data.logs import read_log
from ..diagnosis import confirm
from ..report import plots, records, sentences
from ..study.parse import load_study
from ..study.schema import Study
from .progress import finish
from .shown import Recorded

if TYPE_CHECKING:
    from .project import Project


@dataclass(frozen=True, eq=False, repr=False)
class Confirmation(Recorded):
    """Whether the effects of a study hold on a log that was never searched; nothing was fitted to it.

    Attributes
    ----------
    kept : dict
        Its record.
    """

    FILE: ClassVar[str] = "confirmation.json"
    LEFT_BY: ClassVar[str] = "'pycosim confirm'"
    KEYS: ClassVar[tuple[str, ...]] = ("effects", "replay", "units")

    kept: dict[str, Any]

    @classmethod
    def made(cls, project: Project) -> Confirmation:
        """Test each effect of a project on its logs.

        Parameters
        ----------
        project : Project
            Its logs were never searched, as `refuse` makes sure.

        Returns
        -------
        Confirmation

        Raises
        ------
        DataError
            A log cannot be used, or has a mistake of wiring or units.
        StudyError
            Parameters have values of their own in each run.
        """
        from ..cosim.replay import before_and_after  # fmpy takes a while to import
        project.check().refuse()
        project.study.refuse_own("confirm", project.library)
        dataset = project.dataset
        found = confirm.confirm(dataset, project.study.seed, project.say)
        record: dict[str, Any] = records.confirmation(found, before_and_after(dataset, project.say), dataset.units)
        finish(project.say)
        return cls(record)

    @property
    def record(self) -> dict[str, Any]:
        """``confirmation.json``."""
        return self.kept

    @classmethod
    def _loaded(cls, record: dict[str, Any], absent: Any) -> Confirmation:
        return cls(record)

    @property
    def confirmed(self) -> dict[str, bool]:
        """Whether each effect holds on the log, by its name and place, as ``stribeck@2A``."""
        return {f"{e['effect']}@{e['place']}": bool(e["confirmed"]) for e in self.record["effects"]}

    @property
    def replay(self) -> dict[str, Any]:
        """RMSE of each channel through the exported FMU ``before`` and ``after`` all effects, and ``why`` none."""
        return dict(self.record["replay"])

    @property
    def sentences(self) -> list[str]:
        """Which effects hold, how sure, and the errors without and with them, in words."""
        return sentences.summary_confirmation(self.record)

    def _headline(self) -> str:
        return ", ".join(f"{name} {'is' if holds else 'is not'} confirmed" for name, holds in self.confirmed.items())

    def to_frame(self) -> Any:
        """What the log says of each effect.

        Returns
        -------
        pandas.DataFrame
            Indexed by effect@place: confirmed, p_value, p_value_frozen, p_value_beside, units (blocks or passes that
            were compared), RMSE of each channel without and with the effect in the channel's unit, why it is not
            confirmed.
        """
        kinds = "error_without", "error_with"
        rows = {f"{e['effect']}@{e['place']}":
                {k: e[k] for k in ("confirmed", "p_value", "p_value_frozen", "p_value_beside", "units")}
                | {f"{kind}_{c}": v for c in e["error_with"] for kind in kinds for v in [e[kind][c]]}
                | {"why": e["why"]} for e in self.record["effects"]}
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("effect")

    @property
    def plot(self) -> plots.ConfirmationPlots:
        """Plots of the confirmation: ``errors``."""
        return plots.ConfirmationPlots(self.record)


def confirmed(project: Project, *searched: Study) -> Confirmation:
    """Confirm what can be.

    Parameters
    ----------
    project : Project
        As for `refuse`.
    *searched : Study
        As for `refuse`.

    Returns
    -------
    Confirmation

    Raises
    ------
    StudyError
        As of `refuse`, or a stretch of a log stands in one that the effects were found on.
    DataError
        A log cannot be used, or has a mistake of wiring or units.
    """
    for known in refuse(project, *searched):
        for path in (p for p in (*known.runs, *known.held_out) if isinstance(p, Frame) or Path(p).is_file()):
            try:
                log = read_log(path, replace(known, average=None), strict=False)
            except DataError:  # a log that is no longer as it was can be compared with nothing
                continue
            refuse_known(project.samples, log, known)
    return Confirmation.made(project)


def refuse(project: Project, *searched: Study) -> list[Study]:
    """Refuse to confirm what cannot be, before a log is read.

    Parameters
    ----------
    project : Project
        The study, its effects frozen, on the logs that are to confirm them.
    *searched : Study
        Studies whose logs were searched, beside the file that the project's study comes from; its logs are known as
        searched, for it has the effects.

    Returns
    -------
    list of Study
        All whose logs were searched.

    Raises
    ------
    StudyError
        There is no new log, the study claims no effect, or a log is one that its effects were found on.
    """
    study, files = project.study, (*project.study.runs, *project.study.held_out)
    kept = load_study(study.path) if study.path.is_file() else None
    own = not searched and (kept is None or (kept.runs, kept.held_out) == (study.runs, study.held_out))
    if not files or own:
        which = (f", and {', '.join(f.name for f in files)} {'is' if len(files) == 1 else 'are'} what its effects were "
                 "found on") if files else ""
        raise StudyError(f"{study.path}: confirm needs a log that was never searched{which}; record one: pycosim "
                         f"confirm {study.path.name} --data FILE, in Python project.confirm(\"FILE\")")
    confirm.refuse_nothing(study, project.model)
    known = [*searched, *([kept] if kept else [])]
    for given in known:
        confirm.refuse_searched(given, files)
    return known

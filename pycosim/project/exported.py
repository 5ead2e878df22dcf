"""A study's machine in; what was written of it for another tool, as a line, a table and a record, out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar

import pandas as pd

from .. import export as writers
from ..core.errors import ExportError
from ..core.given import file_path, one_of, shortened
from ..report import records
from ..report.folder import Folder
from ..study.schema import Study
from .shown import Recorded

COLUMNS = ["unit", "causality", "variability", "start", "min", "max", "from_study", "description"]


@dataclass(frozen=True, eq=False, repr=False)
class Export(Recorded):
    """A machine, written for another tool.

    Attributes
    ----------
    kept : dict
        Its record.
    folder : Path or None
        Where the files are; None of a record that was loaded.
    """

    FILE: ClassVar[str] = "export.json"
    LEFT_BY: ClassVar[str] = "'pycosim export'"
    KEYS: ClassVar[tuple[str, ...]] = ("name", "rig", "files", "sentences")

    kept: dict[str, Any]
    folder: Path | None = None

    @classmethod
    def made(cls, study: Study, model: Any, folder: str | PathLike[str], to: str, fmi: int, kinds: Sequence[str],
             platforms: str, real: str, self_contained: bool) -> Export:
        """Write a machine into a folder of results.

        Parameters
        ----------
        study : Study
            Its values and effects are exported as they are.
        model : Model
            Its compiled rig with effects.
        folder : path
            Made, or replaced whole where an export made it.
        to, fmi, kinds, platforms, real, self_contained
            As for `Project.export`.

        Returns
        -------
        Export
        """
        one_of(fmi, "fmi", (2, 3))
        one_of(platforms, "platforms", ("host", "all"))
        if isinstance(kinds, str) or not isinstance(kinds, Sequence) or not kinds:
            raise ExportError(f"kinds = {shortened(kinds)} must be a list of \"cs\" (co-simulation), \"me\" (model "
                              "exchange), or both")
        for kind in kinds:
            one_of(kind, "kinds", ("cs", "me"))
        with Folder(file_path(folder, "out"), "export", study.path, (cls.FILE,)) as made:
            done = writers.export(study, model, made.temporary, to, fmi, list(kinds), platforms, real, self_contained)
            made.write(cls.FILE, done.description)
        return cls(records.plain(done.description), made.path)

    @property
    def record(self) -> dict[str, Any]:
        """``export.json``: every variable of the machine, its states, effects and files."""
        return self.kept

    @classmethod
    def _loaded(cls, record: dict[str, Any], absent: Any) -> Export:
        return cls(record)

    @property
    def files(self) -> list[str]:
        """Names of the files in the folder."""
        return list(self.record["files"])

    @property
    def sentences(self) -> list[str]:
        """What was written, and what must be said about it."""
        return list(self.record["sentences"])

    def _headline(self) -> str:
        return f"{self.record['name']}, {self.record['rig'].rsplit('.', 1)[-1]}: {', '.join(self.files)}"

    def to_frame(self) -> Any:
        """Variables of the machine as a table.

        Returns
        -------
        pandas.DataFrame
            Indexed by variable: unit, causality and variability as of FMI, start, min and max in the unit, whether the
            study says the value, description. Empty of C, whose header describes them.
        """
        rows = [[v[k] for k in COLUMNS] for v in self.record.get("variables", [])]
        names = [v["name"] for v in self.record.get("variables", [])]
        return pd.DataFrame(rows, columns=COLUMNS, index=pd.Index(names, name="variable"))

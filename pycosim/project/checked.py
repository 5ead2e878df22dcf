"""Findings of the data check in; what to say of them, a table, and the refusal to search for physics, out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pandas as pd

from ..data.checks import Checked
from ..report import findings
from .shown import Recorded


@dataclass(frozen=True, eq=False, repr=False)
class Check(Recorded):
    """What is wrong with a study's logs before any physics is asked.

    Attributes
    ----------
    checked : Checked
    study : Study
    """

    checked: Checked
    study: Any

    @property
    def findings(self) -> list[Any]:
        """All findings, most important first."""
        return list(self.checked.findings)

    @property
    def blocking(self) -> bool:
        """Whether a mistake of wiring or units stops every search for physics."""
        return bool(self.checked.blocking)

    @property
    def told(self) -> list[str]:
        """What every verb says first; empty for a sound log."""
        return findings.told(self.checked)

    @property
    def sentences(self) -> list[str]:
        """All findings in words, with the lines of the study that mend them."""
        return findings.every(self.checked)

    def to_dict(self) -> dict[str, Any]:
        """``check.json``.

        Returns
        -------
        dict
        """
        return self.checked.plain()

    def to_frame(self) -> Any:
        """A row a finding.

        Returns
        -------
        pandas.DataFrame
            kind, columns, certainty, text, mend.
        """
        names = ["kind", "columns", "certainty", "text", "mend"]
        return pd.DataFrame([{n: f.plain()[n] for n in names} for f in self.checked.findings], columns=names)

    def refuse(self) -> None:
        """Raise what stops a search.

        Raises
        ------
        DataError
            A discrete mistake that the study neither mends nor accepts.
        """
        findings.refuse(self.study, self.checked)

    def _headline(self) -> str:
        told = [f.kind for f in self.checked.findings if f.told]
        return f"{', '.join(told) or 'nothing wrong'}{'; a search stops here' if self.blocking else ''}"

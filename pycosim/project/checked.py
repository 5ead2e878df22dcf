"""Findings of the data check in; what to say of them, a table, and the refusal to search for physics, out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import pandas as pd

from ..data.checks import Checked, Finding
from ..data.checks.finding import DISCRETE
from ..report import findings, records
from ..report.thresholds import thresholds
from .shown import Recorded


@dataclass(frozen=True, eq=False, repr=False)
class Check(Recorded):
    """What is wrong with a study's logs before any physics is asked.

    Attributes
    ----------
    checked : Checked
        Findings, most important first, and the kinds that the study has answered.
    study : Study
        Whose logs these are.
    kept : dict or None
        The record that it was loaded from.
    """

    FILE: ClassVar[str] = "check.json"
    LEFT_BY: ClassVar[str] = "'pycosim check'"
    KEYS: ClassVar[tuple[str, ...]] = ("blocking", "findings")

    checked: Checked
    study: Any
    kept: dict[str, Any] | None = None

    @cached_property
    def record(self) -> dict[str, Any]:
        """``check.json``; beyond the contract ``accepted``, the kinds that the study has answered, and `thresholds`."""
        if self.kept is not None:
            return self.kept
        made: dict[str, Any] = records.plain({**self.checked.plain(), "accepted": self.checked.accepted,
                                              "thresholds": thresholds("check")})
        return made

    @classmethod
    def _loaded(cls, record: dict[str, Any], absent: Any) -> Check:
        # where nothing stops, whatever the reason, nothing must stop because a certainty was rounded
        accepted = record.get("accepted", []) if record["blocking"] else list(DISCRETE)
        return cls(Checked([Finding(**f) for f in record["findings"]], accepted), absent, record)

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

    def to_frame(self) -> Any:
        """A row a finding.

        Returns
        -------
        pandas.DataFrame
            kind, columns, certainty, text, mend.
        """
        names = ["kind", "columns", "certainty", "text", "mend"]
        return pd.DataFrame([{n: f[n] for n in names} for f in self.record["findings"]], columns=names)

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

"""What a diagnosis found in; its verdict, its candidates as a table, and each one's plot, out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, overload

import pandas as pd

from ..core.errors import UnknownNameError, closest
from ..report import cards, drawings, plots, records, sentences
from .shown import Recorded, Shown

if TYPE_CHECKING:
    from .fitted import Fitted


@dataclass(frozen=True, eq=False, repr=False)
class Candidate(Shown):
    """One effect at one place, as a diagnosis sees it.

    Attributes
    ----------
    diagnosis : Diagnosis
    finding : Finding
    """

    diagnosis: Diagnosis
    finding: Any

    @property
    def name(self) -> str:
        """Effect and place, as ``stribeck@2A``."""
        return f"{self.finding.effect}@{self.finding.place}"

    @property
    def accepted(self) -> bool:
        """Whether the data ask for it: it would be added."""
        return bool(self.finding.accepted)

    @property
    def p_value(self) -> float:
        """Probability that chance alone makes any candidate look as good as this one (family-wise)."""
        return float(self.finding.p_value)

    @property
    def alternatives(self) -> list[str]:
        """Candidates that these data cannot tell from it (indistinguishable alternatives)."""
        return [f"{t['effect']}@{t['place']}" for t in self.finding.twins]

    @property
    def predicted_error(self) -> dict[str, float]:
        """RMSE of each channel that the model should have with it."""
        return dict(self.finding.predicted_error)

    @property
    def coefficients(self) -> dict[str, dict[str, Any]]:
        """Its coefficients: ``value``, ``ci95``, ``unit``; only expected, and without interval, where not refitted."""
        return dict(self._record["coefficients"])

    @property
    def sentence(self) -> str:
        """What it is, how sure, and what it would bring, in words."""
        fitted = self.diagnosis.fitted
        text: str = cards.sentence(fitted.project.library, self.finding, self.diagnosis.error)
        return text

    @property
    def experiment(self) -> str:
        """What would tell it from its alternatives, or make it surer."""
        return str(self._record["experiment"])

    @property
    def _record(self) -> dict[str, Any]:
        entries = self.diagnosis.to_dict()["candidates"]
        found: dict[str, Any] = next(e for e in entries if (e["effect"], e["place"]) == self.finding.key)
        return found

    def _headline(self) -> str:
        return f"{self.name}, p = {self.p_value:.2g}{', accepted' if self.accepted else ''}"

    def to_frame(self) -> Any:
        """Its coefficients as a table.

        Returns
        -------
        pandas.DataFrame
            Indexed by coefficient: value, ci95_low, ci95_high, unit.
        """
        rows = {n: {"value": c["value"], "ci95_low": c["ci95"][0], "ci95_high": c["ci95"][1], "unit": c["unit"]}
                for n, c in self.coefficients.items()}
        columns = ["value", "ci95_low", "ci95_high", "unit"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("coefficient")

    def add(self) -> Fitted:
        """The model with this effect, fitted.

        Returns
        -------
        Fitted
        """
        return self.diagnosis.fitted.add(self)

    def plot(self) -> Any:
        """What the effect looks like: errors without and with it, and the torque that is missing at its place.

        Returns
        -------
        ndarray of matplotlib.axes.Axes
        """
        before, after = self.diagnosis.fitted, self.add()
        return plots.handed(drawings.signature(before.dataset, (before.model, before.solution),
                                               (after.model, after.solution), self.finding.key))


class Candidates(Sequence[Candidate], Shown):
    """Candidates of a diagnosis, best first; by number, by name (``stribeck@2A``), or by effect and place.

    Parameters
    ----------
    found : list of Candidate
    """

    def __init__(self, found: list[Candidate]):
        self._found = found

    @overload
    def __getitem__(self, key: int | str | tuple[str, str]) -> Candidate: ...

    @overload
    def __getitem__(self, key: slice) -> Candidates: ...

    def __getitem__(self, key: int | str | tuple[str, str] | slice) -> Candidate | Candidates:
        if isinstance(key, slice):
            return Candidates(self._found[key])
        if isinstance(key, int):
            return self._found[key]
        name = key if isinstance(key, str) else "@".join(key)
        for candidate in self._found:
            if candidate.name == name:
                return candidate
        raise UnknownNameError(f"no candidate '{name}'{closest(name, [c.name for c in self._found])}")

    def __iter__(self) -> Iterator[Candidate]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)

    def _headline(self) -> str:
        return f"{len(self)} candidates" + (f", first {self._found[0].name}" if self._found else "")

    def to_frame(self) -> Any:
        """Candidates as a table.

        Returns
        -------
        pandas.DataFrame
            Indexed by effect@place: accepted, p_value, predicted error of each channel, alternatives.
        """
        rows = {c.name: {"accepted": c.accepted, "p_value": c.p_value}
                | {f"predicted_{n}": v for n, v in c.predicted_error.items()}
                | {"alternatives": ", ".join(c.alternatives)} for c in self._found}
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("candidate")


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Recorded):
    """Which effect a fitted model lacks.

    Attributes
    ----------
    fitted : Fitted
        The model that was looked at.
    found : pycosim.diagnosis.decide.Diagnosis
        All that was found.
    final : bool
        Whether effects were added already: nothing missing means nothing else.
    """

    fitted: Fitted
    found: Any
    final: bool = False

    @property
    def verdict(self) -> str:
        """``missing_effect``, ``nothing_missing``, ``unexplained`` or ``not_enough_excitation``."""
        return str(self.found.verdict)

    @property
    def error(self) -> dict[str, float]:
        """RMSE of each channel, of the fitted model."""
        return dict(self.found.error)

    @property
    def noise_floor(self) -> dict[str, float]:
        """RMSE of each channel that noise alone leaves."""
        return dict(self.found.noise_floor)

    @cached_property
    def candidates(self) -> Candidates:
        """Every effect at every place, best first."""
        return Candidates([Candidate(self, f) for f in self.found.candidates])

    @property
    def best(self) -> Candidate | None:
        """The candidate that the data ask for; None where they ask for none."""
        return next((c for c in self.candidates if c.accepted), None)

    @cached_property
    def _record(self) -> dict[str, Any]:
        made: dict[str, Any] = records.diagnosis(self.found, self.fitted.dataset)
        return made

    def to_dict(self) -> dict[str, Any]:
        """The diagnosis as ``diagnosis.json`` has it.

        Returns
        -------
        dict
        """
        return dict(self._record)

    @property
    def sentences(self) -> list[str]:
        """What is missing, how sure, what it would bring, and what these data cannot show."""
        return sentences.summary_diagnosis(self._record, self.fitted.project.library, self.final)

    @property
    def guess(self) -> str | None:
        """A guessed shape of what no effect explains, as a Modelica file to try; None without one."""
        return ((self._record["unexplained"] or {}).get("proposal") or {}).get("file") or None

    def _headline(self) -> str:
        best = self.best
        return self.verdict + (f", {best.name} (p = {best.p_value:.2g})" if best else "")

    def to_frame(self) -> Any:
        """Candidates as a table; see `Candidates.to_frame`.

        Returns
        -------
        pandas.DataFrame
        """
        return self.candidates.to_frame()

    @property
    def plot(self) -> plots.DiagnosisPlots:
        """Plots of the diagnosis: ``candidates``, ``unexplained``."""
        return plots.DiagnosisPlots(self.fitted.dataset, self.found)

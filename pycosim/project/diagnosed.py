"""What a diagnosis found in; its verdict, its candidates as a table, and each one's plot, out."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, overload

import pandas as pd

from ..core.errors import UnknownNameError, closest
from ..report import drawings, plots, records, sentences
from .shown import Recorded, Shown

if TYPE_CHECKING:
    from .fitted import Fitted


@dataclass(frozen=True, eq=False, repr=False)
class Candidate(Shown):
    """One effect at one place, as a diagnosis sees it.

    Attributes
    ----------
    diagnosis : Diagnosis
        The one that it is part of; `add` and `plot` go on from its fitted model.
    record : dict
        Its entry of ``diagnosis.json``.
    """

    diagnosis: Diagnosis
    record: dict[str, Any]

    @property
    def key(self) -> tuple[str, str]:
        """Effect and place."""
        return self.record["effect"], self.record["place"]

    @property
    def name(self) -> str:
        """Effect and place, as ``stribeck@2A``."""
        return "@".join(self.key)

    @property
    def accepted(self) -> bool:
        """Whether the data ask for it: it would be added."""
        return bool(self.record["accepted"])

    @property
    def contested(self) -> bool:
        """Whether it would be added, did not more than five others, or two at once, do as well."""
        return bool(self.record.get("contested"))

    @property
    def p_value(self) -> float:
        """Probability that chance alone makes any candidate look as good as this one (family-wise)."""
        return float(self.record["p_value"])

    @property
    def alternatives(self) -> list[str]:
        """Candidates that these data cannot tell from it (indistinguishable alternatives)."""
        return [f"{t['effect']}@{t['place']}" for t in self.record["twins"]]

    @property
    def together(self) -> list[list[str]]:
        """Pairs of others that do as well, with as many coefficients."""
        return [[f"{t['effect']}@{t['place']}" for t in pair] for pair in self.record.get("together", [])]

    @property
    def predicted_error(self) -> dict[str, float]:
        """RMSE of each channel that the model should have with it, in the channel's unit."""
        return dict(self.record["predicted_error"])

    @property
    def coefficients(self) -> dict[str, dict[str, Any]]:
        """Its coefficients: ``value``, ``ci95``, ``unit``; only expected, and without interval, where not refitted."""
        return copy.deepcopy(self.record["coefficients"])

    @property
    def sentence(self) -> str:
        """What it is, how sure, and what it would bring, in words."""
        return str(self.record["sentence"])

    @property
    def experiment(self) -> str:
        """What would tell it from its alternatives, or make it surer."""
        return str(self.record["experiment"])

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
                                               (after.model, after.solution), self.key))


class Candidates(Sequence[Candidate], Shown):
    """Candidates of a diagnosis, best first; by number, by name (``stribeck@2A``), or by effect and place.

    Parameters
    ----------
    found : list of Candidate
        Best first, as in ``diagnosis.json``.
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
        name = "@".join(map(str, key)) if isinstance(key, tuple) else str(key)
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
    found : pycosim.diagnosis.finding.Diagnosis
        All that was found; of one that was loaded, what its file keeps of that.
    final : bool
        Whether effects were added already: nothing missing means nothing else.
    kept : dict or None
        The record that it was loaded from.
    """

    FILE: ClassVar[str] = "diagnosis.json"
    LEFT_BY: ClassVar[str] = "'pycosim diagnose'"
    KEYS: ClassVar[tuple[str, ...]] = ("verdict", "candidates", "noise_floor", "undetectable")

    fitted: Fitted
    found: Any
    final: bool = False
    kept: dict[str, Any] | None = None

    @cached_property
    def record(self) -> dict[str, Any]:
        """``diagnosis.json``; beyond the contract ``final``, whether effects were added before, and ``travels``.

        Those are of the machine's own friction, by parameter, where the log tells others than the rig's.
        """
        if self.kept is not None:
            return self.kept
        return {**records.diagnosis(self.found, self.fitted.dataset), "final": self.final,
                "travels": self.fitted.project.own_travels}

    @classmethod
    def _loaded(cls, record: dict[str, Any], absent: Any) -> Diagnosis:
        return cls(absent, records.diagnosis_of(record), bool(record.get("final")), record)

    @property
    def verdict(self) -> str:
        """``missing_effect``, ``nothing_missing``, ``unexplained`` or ``not_enough_excitation``."""
        return str(self.record["verdict"])

    @property
    def error(self) -> dict[str, float]:
        """RMSE of each channel, of the fitted model, in the channel's unit."""
        return dict(self.record["error"])

    @property
    def noise_floor(self) -> dict[str, float]:
        """RMSE of each channel that noise alone leaves, in the channel's unit."""
        return dict(self.record["noise_floor"])

    @cached_property
    def candidates(self) -> Candidates:
        """Every effect at every place, best first."""
        return Candidates([Candidate(self, c) for c in self.record["candidates"]])

    @property
    def best(self) -> Candidate | None:
        """The candidate that the data ask for; None where they ask for none."""
        return next((c for c in self.candidates if c.accepted), None)

    @property
    def sentences(self) -> list[str]:
        """What is missing, how sure, what it would bring, and what these data cannot show."""
        return sentences.summary_diagnosis(self.record, self.final)

    @property
    def guess(self) -> str | None:
        """A guessed shape of what no effect explains, as a Modelica file to try; None without one."""
        return ((self.record["unexplained"] or {}).get("proposal") or {}).get("file") or None

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
        """Plots of the diagnosis: ``candidates``, and ``unexplained``, which needs the log."""
        return plots.DiagnosisPlots(lambda: self.fitted.dataset, self.found)

"""Anyone's FMU, a study and logs in; the FMU's fitted parameters, and the files that carry them, out."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import pandas as pd

from ..core.given import file_path
from ..report import plots, records, sentences
from ..report.folder import Folder
from ..study.parse import load_study
from ..study.schema import Study
from .fitted import Parameter, Parameters
from .progress import Say, finish, usual
from .project import Data, on_data
from .shown import Recorded


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Recorded):
    """Parameters of an FMU, fitted to logs.

    Attributes
    ----------
    fmu : Path
        The file, left as it is.
    solution : pycosim.cosim.calibrate.Calibration
        All that the calibration knows: covariance, inputs, outputs.
    study : Study
        Its columns, parameters and logs were used.
    kept : dict or None
        The record that it was loaded from.
    """

    FILE: ClassVar[str] = "parameters.json"
    LEFT_BY: ClassVar[str] = "'pycosim identify --fmu'"
    KEYS: ClassVar[tuple[str, ...]] = ("parameters", "null_directions", "units", "fmu", "before", "after")

    fmu: Any
    solution: Any
    study: Any
    kept: dict[str, Any] | None = None

    @cached_property
    def record(self) -> dict[str, Any]:
        """``parameters.json``; of an FMU with its name, ``derivatives``, errors ``before`` and ``after``, ``notes``."""
        if self.kept is not None:
            return self.kept
        found = self.solution
        return {**records.parameters(found.fit, found, self.study.seed), **self.comparison, "study": self.study.name,
                "effects": [], "notes": list(found.notes)}

    @property
    def comparison(self) -> dict[str, Any]:
        """``comparison.json`` of an FMU: RMSE of each output ``before`` and ``after``, by kind of log."""
        keys = "schema", "fmu", "derivatives", "before", "after"
        if self.kept is not None:
            return {k: self.kept[k] for k in keys}
        found = self.solution
        made: dict[str, Any] = records.plain(dict(zip(keys, (records.SCHEMA, self.fmu.name, found.method, found.before,
                                                             found.after), strict=True)))
        return made

    @classmethod
    def _loaded(cls, record: dict[str, Any], absent: Any) -> Calibration:
        return cls(Path(record["fmu"]), absent, absent, record)

    @cached_property
    def params(self) -> Parameters:
        """Fitted parameters and starts of the FMU by name."""
        return Parameters({n: Parameter.of(n, entry) for n, entry in self.record["parameters"].items()})

    @property
    def before(self) -> dict[str, dict[str, float]]:
        """RMSE of each output with the FMU's own values, of ``fit`` and, where there are any, ``held_out`` logs."""
        return {kind: dict(errors) for kind, errors in self.record["before"].items()}

    @property
    def after(self) -> dict[str, dict[str, float]]:
        """The same with the fitted values."""
        return {kind: dict(errors) for kind, errors in self.record["after"].items()}

    @property
    def sentences(self) -> list[str]:
        """What was left open, parameters with intervals, and errors before and after, in words."""
        return sentences.summary_calibration(self.record)

    def _headline(self) -> str:
        errors = [f"{n} {self.before[kind][n]:.4g} -> {e:.4g}" for kind, found in self.after.items()
                  for n, e in found.items()]
        return f"{self.record['fmu']}, {len(self.params)} parameters; error {', '.join(errors)}"

    def to_frame(self) -> Any:
        """The parameters as a table; see `Parameters.to_frame`.

        Returns
        -------
        pandas.DataFrame
        """
        return self.params.to_frame()

    def errors(self) -> Any:
        """Errors before and after, as a table.

        Returns
        -------
        pandas.DataFrame
            A row a kind of log (``fit``, ``held_out``) and output: before, after, in the unit of the output.
        """
        rows = [(kind, n, self.before[kind][n], e) for kind, found in self.after.items() for n, e in found.items()]
        return pd.DataFrame(rows, columns=["logs", "output", "before", "after"])

    @property
    def plot(self) -> plots.CalibrationPlots:
        """Plots of the calibration: ``intervals``."""
        return plots.CalibrationPlots(self.record)

    def export(self, folder: str | os.PathLike[str]) -> list[Path]:
        """Write the fitted values as files for other tools: a parameter set, its mapping, a system, and an FMU.

        Parameters
        ----------
        folder : path
            Made, or replaced whole where an export made it.

        Returns
        -------
        list of Path
            ``calibrated.ssv``, ``calibrated.ssm``, ``calibrated.ssp`` and ``<fmu>_calibrated.fmu``, whose starts are
            the fitted values.

        Raises
        ------
        CosimulationError
            The FMU's description has no start that could be replaced.
        FolderError
            The folder cannot be made, or holds what is no export.
        """
        with Folder(folder, "export", self.study.path) as made:
            names = self.write(made.temporary)
        return [made.path / name for name in names]

    def write(self, folder: str | os.PathLike[str]) -> list[str]:
        """Write the files of `export` into a folder that is there.

        Parameters
        ----------
        folder : path
            Files of the same names are replaced.

        Returns
        -------
        list of str
            Their names.
        """
        from ..cosim.calibrated import write_calibrated
        names: list[str] = write_calibrated(self.fmu, self.solution, folder)
        return names


def calibrate(fmu: str | os.PathLike[str], study: str | os.PathLike[str] | Study, data: Data | None = None,
              progress: Say | None = None) -> Calibration:
    """Fit parameters of anyone's FMU to logs; as ``pycosim.calibrate``.

    The study's ``[columns]`` say which column is which input or output of the FMU, its ``[parameters]`` which of the
    FMU's parameters are free and within what bounds; without any, all tunable ones are. Its ``[rig]`` is not looked at.

    Parameters
    ----------
    fmu : path
        FMU of FMI 2 or 3, for co-simulation or model exchange.
    study : path or Study
        Study file (TOML).
    data : path, pandas.DataFrame, list of these, or dict of str to pandas.DataFrame, optional
        Logs instead of the study's own.
    progress : callable, optional
        Called with a sentence before each stage. A line below the cell in a notebook by default.

    Returns
    -------
    Calibration

    Raises
    ------
    CosimulationError
        The FMU cannot be run, or lacks a variable that the study names.
    StudyError, DataError
        Nothing is free, no column is an output, or a log cannot be used.
    """
    from ..cosim.calibrate import calibrate as fitted  # fmpy takes a while to import
    given: Study = study if isinstance(study, Study) else load_study(file_path(study, "study.toml"))
    fmu = file_path(fmu, "model.fmu")
    if data is not None:
        given = on_data(given, data)
    say = progress or usual()
    found = fitted(given, Path(fmu), say)
    finish(say)
    return Calibration(Path(fmu), found, given)

"""A scenario in; the log of its components stepped together, as a table, a file and a plot, out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar

import pandas as pd

from ..core.errors import StudyError
from ..core.given import file_path
from ..core.whole import write_whole
from ..report import plots, records, sentences
from .progress import Say, finish, usual
from .shown import Recorded, xarray_module


@dataclass(frozen=True, eq=False, repr=False)
class Cosimulation(Recorded):
    """Plants, controllers and estimators of a scenario, stepped together.

    Attributes
    ----------
    done : pycosim.cosim.master.Cosimulation
        The log, its text, and the checkpoint.
    kept : dict or None
        The record that it was loaded from.
    """

    FILE: ClassVar[str] = "cosim.json"
    LEFT_BY: ClassVar[str] = "'pycosim cosim'"
    KEYS: ClassVar[tuple[str, ...]] = ("scenario", "components", "connections", "columns")

    done: Any
    kept: dict[str, Any] | None = None

    @cached_property
    def record(self) -> dict[str, Any]:
        """``cosim.json``: components, rates, connections, and the range of every column; not the log."""
        if self.kept is not None:
            return self.kept
        made: dict[str, Any] = records.plain(self.done.description)
        return made

    @classmethod
    def _loaded(cls, record: dict[str, Any], absent: Any) -> Cosimulation:
        return cls(absent, record)

    @property
    def log(self) -> Any:
        """The log as pandas.DataFrame: ``time`` [s] and the scenario's columns in SI units; a copy."""
        return self.done.log.copy()

    @property
    def complete(self) -> bool:
        """Whether it went to the end of the scenario."""
        return bool(self.record["complete"])

    @property
    def checkpoint(self) -> bytes | None:
        """To go on from with `cosimulate`; None where it is complete."""
        found: bytes | None = self.done.checkpoint
        return found

    @property
    def sentences(self) -> list[str]:
        """What was stepped together, how often, and the range of every column, in words."""
        return sentences.summary_cosimulation(self.record)

    def _headline(self) -> str:
        r = self.record
        parts = "" if self.complete else f" of {r['duration']:g} s"
        return (f"{r['scenario']}, {r['time']:g} s{parts}, {len(r['components'])} components, {r['rows']} rows of "
                f"{len(r['columns'])} signals")

    def to_frame(self) -> Any:
        """What the columns of the log range over.

        Returns
        -------
        pandas.DataFrame
            Indexed by column: unit, min, max and rms in it. The samples themselves are in `log`.
        """
        return pd.DataFrame.from_dict(self.record["columns"], orient="index",
                                      columns=["unit", "min", "max", "rms"]).rename_axis("column")

    def to_xarray(self) -> Any:
        """The log with named dimensions.

        Returns
        -------
        xarray.Dataset
            A variable a column, over ``time`` [s]; its unit is among its attributes.

        Raises
        ------
        UnknownNameError
            xarray is not installed.
        """
        log, units = self.log.set_index("time"), self.record["columns"]
        return xarray_module().Dataset({n: ("time", log[n].to_numpy(), {"unit": units[n]["unit"]} if n in units else {})
                                        for n in log}, {"time": log.index.to_numpy()})

    def to_csv(self, path: str | PathLike[str]) -> Path:
        """Write the log, as ``run.csv``: `pycosim.open` takes it as data.

        Parameters
        ----------
        path : path
            Replaced where there is one.

        Returns
        -------
        Path

        Raises
        ------
        StudyError
            The file cannot be written.
        """
        text = self.done.text
        try:
            return write_whole(file_path(path, "run.csv"), text)
        except OSError as error:
            raise StudyError(f"{path}: cannot be written ({error.strerror})") from None

    @property
    def plot(self) -> plots.CosimulationPlots:
        """Plots of the co-simulation: ``over_time``, which needs the log."""
        return plots.CosimulationPlots(lambda: self.log, {n: c["unit"] for n, c in self.record["columns"].items()})


def cosimulate(scenario: Any, until: float | None = None, resume: bytes | None = None,
               allow_python: Sequence[str | PathLike[str]] = (), progress: Say | None = None, library: Any = None,
               save: Callable[[bytes], object] | None = None, every: float | None = None) -> Cosimulation:
    """Step the components of a scenario together; as ``pycosim.cosimulate``.

    Parameters
    ----------
    scenario : path or Scenario
        Scenario file (TOML), or one as read.
    until : float, optional
        Stop at this time [s], with a checkpoint.
    resume : bytes, optional
        Checkpoint to go on from; the log that comes out is the same, bit for bit, as without the stop.
    allow_python : sequence of str or path
        Files of Python classes beside the scenario, or names of installed modules, whose code may run; without it a
        scenario runs no code.
    progress : callable, optional
        Called with a sentence now and then. A line below the cell in a notebook by default.
    library : Library, optional
        Which holds rigs of plants and controllers; the package's own by default.
    save : callable, optional
        Called with a checkpoint on the way, for what ends a run without asking.
    every : float, optional
        Seconds, by the clock on the wall, from one such checkpoint to the next; a minute by default.

    Returns
    -------
    Cosimulation

    Raises
    ------
    ScenarioError
        The scenario contradicts itself, or the checkpoint is not its own.
    CosimulationError
        A component cannot be loaded, fails on the way, or runs code that is not allowed.
    UnknownNameError
        A variable, parameter, option or machine that does not exist.
    """
    from ..cosim import master  # takes a while to import
    from ..cosim.scenario import Scenario
    say, more = progress or usual(), {} if every is None else {"every": every}
    if not isinstance(scenario, Scenario):
        scenario = file_path(scenario, "scenario.toml")
    done = master.cosimulate(scenario, until, resume, say, library, save=save, allow_python=allow_python, **more)
    finish(say)
    return Cosimulation(done)

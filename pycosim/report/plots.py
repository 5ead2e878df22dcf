"""A fit, a diagnosis, a search or a plan in; Axes that a user can go on with, out.

All is described by `drawings`, `outcomes` and `plan_figures`; here each plot is drawn, handed out, and shown in a
notebook.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from ..core.errors import PycosimError, UnknownNameError, closest
from ..core.given import whole_number
from ..diagnosis.dependence import noise_floor
from . import cosim_figures, drawings, figures, outcomes, plan_figures

DOTS = 150  # an inch, in a notebook


class PlotError(PycosimError):
    """There is nothing to draw."""


def handed(plot: Any, none: str = "there is nothing to draw") -> Any:
    """Draw a plot, and hand out its Axes; in a notebook the figure is shown as well.

    Parameters
    ----------
    plot : Plot or None
        None where there is nothing to draw.
    none : str
        Why there is none.

    Returns
    -------
    matplotlib.axes.Axes, or ndarray of them where there are several
        Colour bars are left out; ``axes.figure`` is the figure.

    Raises
    ------
    PlotError
        There is nothing to draw.
    """
    figure = figures.figure(plot)
    if figure is None:
        raise PlotError(none)
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if shell is not None and hasattr(shell, "kernel"):
        from IPython.display import Image, display  # type: ignore[import-not-found, unused-ignore]
        page = io.BytesIO()
        figure.savefig(page, format="png", dpi=DOTS)
        display(Image(page.getvalue()))
    axes = [a for a in figure.axes if a.get_label() != "<colorbar>"]
    return axes[0] if len(axes) == 1 else np.array(axes)


class FitPlots:
    """Plots of a fitted model.

    Parameters
    ----------
    samples : callable
        Returns the data set; raises what is to be said where there is none.
    model : Model
        The rig with the effects that were fitted.
    fit : Fit
        Of the model to the data set's fit part.
    record : dict
        ``parameters.json``.
    """

    def __init__(self, samples: Callable[[], Any], model: Any, fit: Any, record: dict[str, Any]):
        self._samples, self._model, self._fit, self._record = samples, model, fit, record

    @property
    def _dataset(self) -> Any:
        return self._samples()

    def _floor(self) -> dict[str, float]:
        return noise_floor(self._dataset, self._model, self._fit)

    def over_time(self) -> Any:
        """Speeds, measured and modelled outputs, and what is left; see `drawings.timeline`.

        Returns
        -------
        ndarray of matplotlib.axes.Axes

        Raises
        ------
        PlotError
            Each run is one sample.
        """
        if self._dataset.averaged:
            raise PlotError("each run is one sample, its mean: there is nothing to draw over time")
        window = drawings.worst_window(self._dataset, self._model, self._fit)
        return handed(drawings.timeline(self._dataset, [(self._model, self._fit)], window=window))

    def residuals(self, over: str | None = None, channel: str | None = None) -> Any:
        """Residual against what it may depend on; see `drawings.residuals`.

        Parameters
        ----------
        over : str, optional
            One variable, as ``speed@2A``, ``load@1A``, ``time``; by default the strongest of each kind.
        channel : str, optional
            One channel, as ``C_H``; all by default.

        Returns
        -------
        matplotlib.axes.Axes, or ndarray of them

        Raises
        ------
        UnknownNameError
            No such channel or variable; the nearest is named.
        """
        if channel is not None and channel not in self._dataset.channels:
            raise UnknownNameError(f"no channel '{channel}'{closest(channel, self._dataset.channels)}")
        return handed(drawings.residuals(self._dataset, self._model, self._fit, self._floor(), over, channel))

    def where_it_fails(self) -> Any:
        """Error by manoeuvre, by branch and by run; see `drawings.where_it_fails`.

        Returns
        -------
        matplotlib.axes.Axes, or ndarray of them
        """
        return handed(drawings.where_it_fails(self._dataset, self._model, self._fit, self._floor()))

    def map(self, channel: str | None = None) -> Any:
        """Error over the plane that it is most concentrated on; see `drawings.first_maps`.

        Parameters
        ----------
        channel : str, optional
            The first by default.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        PlotError
            The rig has no such plane.
        """
        found = {p.channel: p for p in drawings.first_maps(self._dataset, self._model, self._fit)}
        return handed(found.get(channel or self._dataset.channels[0]), "this rig has no plane to draw over")

    def intervals(self) -> Any:
        """Parameters with their 95 % intervals; see `outcomes.intervals`.

        Returns
        -------
        matplotlib.axes.Axes
        """
        return handed(outcomes.intervals(self._record))

    def manoeuvres(self) -> Any:
        """The passes in motor space; see `drawings.manoeuvres`.

        Returns
        -------
        matplotlib.axes.Axes, or ndarray of them

        Raises
        ------
        PlotError
            The rig has one motor.
        """
        return handed(drawings.manoeuvres(self._dataset), "this rig has no two motors to draw over")


class DiagnosisPlots:
    """Plots of a diagnosis.

    Parameters
    ----------
    samples : callable
        As of `FitPlots`.
    found : Diagnosis
        Its candidates are drawn, and the map of what nothing explains.
    """

    def __init__(self, samples: Callable[[], Any], found: Any):
        self._samples, self._found = samples, found

    def candidates(self, most: int = 10) -> Any:
        """Candidates that promise the largest fall of the error; see `outcomes.candidates`.

        Parameters
        ----------
        most : int
            Bars to draw at most.

        Returns
        -------
        matplotlib.axes.Axes
        """
        return handed(outcomes.candidates(self._found, whole_number(most, "most", 10)))

    def unexplained(self) -> Any:
        """Where a residual that no effect explains lives; see `drawings.unexplained`.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        PlotError
            Nothing is unexplained, or one variable alone matters.
        """
        return handed(drawings.unexplained(self._samples(), self._found.unexplained),
                      f"the verdict is {self._found.verdict}, and no map of what is left was made")


class ConfirmationPlots:
    """Plots of a confirmation.

    Parameters
    ----------
    record : dict
        ``confirmation.json``.
    """

    def __init__(self, record: dict[str, Any]):
        self._record = record

    def errors(self) -> Any:
        """The error that each effect leaves on the new log, and whether it holds; see `outcomes.confirmation`.

        Returns
        -------
        matplotlib.axes.Axes
        """
        return handed(outcomes.confirmation(self._record))


class CalibrationPlots:
    """Plots of a calibrated FMU.

    Parameters
    ----------
    record : dict
        ``parameters.json``.
    """

    def __init__(self, record: dict[str, Any]):
        self._record = record

    def intervals(self) -> Any:
        """Parameters with their 95 % intervals; see `outcomes.intervals`.

        Returns
        -------
        matplotlib.axes.Axes
        """
        return handed(outcomes.intervals(self._record))


class CosimulationPlots:
    """Plots of a co-simulation.

    Parameters
    ----------
    log : callable
        Returns the log; raises what is to be said where there is none.
    units : dict of str to str
        Of the log's columns.
    """

    def __init__(self, log: Callable[[], Any], units: dict[str, str]):
        self._log, self._units = log, units

    def over_time(self) -> Any:
        """Signals of the log over time, a panel a unit; see `cosim_figures.over_time`.

        Returns
        -------
        matplotlib.axes.Axes, or ndarray of them

        Raises
        ------
        PlotError
            The log has no columns but the time.
        """
        return handed(cosim_figures.over_time(self._log(), self._units))


class SearchPlots:
    """Plots of a search.

    Parameters
    ----------
    samples : callable
        As of `FitPlots`.
    found : Improvement
        Its steps are drawn, the base model first.
    units : dict of str to str
        By channel.
    """

    def __init__(self, samples: Callable[[], Any], found: Any, units: dict[str, str]):
        self._samples, self._found, self._units = samples, found, units

    def path(self) -> Any:
        """Error at every step, on fitted and on held-out passes; see `outcomes.ladder`.

        Returns
        -------
        matplotlib.axes.Axes
        """
        return handed(outcomes.ladder(self._units, self._found.steps, self._found.last.noise_floor))

    def signature(self, step: int = 1) -> Any:
        """What the effect of a step looks like; see `drawings.signature`.

        Parameters
        ----------
        step : int
            1 for the first effect that was added.

        Returns
        -------
        matplotlib.axes.Axes, or ndarray of them

        Raises
        ------
        PlotError
            No such step.
        """
        steps = self._found.steps
        if not 1 <= step < len(steps):
            raise PlotError(f"no step {step}: {len(steps) - 1} effects were added")
        before, after = steps[step - 1], steps[step]
        return handed(drawings.signature(self._samples(), (before.model, before.fit), (after.model, after.fit),
                                         after.added))


class PlanPlots:
    """Plots of a plan.

    Parameters
    ----------
    planned : Plan
        With the motion, the workspace of the rig, and the covariance after the experiment.
    """

    def __init__(self, planned: Any):
        self._planned = planned

    def motion(self) -> Any:
        """The motion over time; see `plan_figures.motion`.

        Returns
        -------
        ndarray of matplotlib.axes.Axes
        """
        return handed(plan_figures.motion(self._planned))

    def intervals(self) -> Any:
        """Intervals now and after the experiment; see `plan_figures.intervals`.

        Returns
        -------
        matplotlib.axes.Axes
        """
        return handed(plan_figures.intervals(self._planned))

    def workspace(self) -> Any:
        """Where the motors may move; see `plan_figures.workspace`.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        PlotError
            The rig has one motor.
        """
        return handed(plan_figures.workspace(self._planned.known.workspace),
                      "this rig has no two motors to draw over")

"""A fit, a diagnosis, a search or a plan in; Axes that a user can go on with, out.

All is drawn by `figures` and `plan_figures`; here each figure is handed out, and shown where there is a notebook.
"""

from __future__ import annotations

import io
import sys
from typing import Any

import numpy as np

from ..core.errors import PycosimError, UnknownNameError, closest
from . import figures, plan_figures

DOTS = 150  # an inch, in a notebook


class PlotError(PycosimError):
    """There is nothing to draw."""


def handed(figure: Any, none: str = "there is nothing to draw") -> Any:
    """The Axes of a figure; in a notebook the figure is shown as well.

    Parameters
    ----------
    figure : matplotlib.figure.Figure or None
    none : str
        Why there is none.

    Returns
    -------
    matplotlib.axes.Axes, or ndarray of them where there are several
        Colour bars are left out; ``axes.figure`` is the figure.

    Raises
    ------
    PlotError
    """
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
    dataset : Dataset
    model : Model
    fit : Fit
    record : dict
        ``parameters.json``.
    """

    def __init__(self, dataset: Any, model: Any, fit: Any, record: dict[str, Any]):
        self._dataset, self._model, self._fit, self._record = dataset, model, fit, record

    def over_time(self) -> Any:
        """Speeds, measured and modelled outputs, and what is left; see `figures.over_time`.

        Returns
        -------
        ndarray of matplotlib.axes.Axes
        """
        return handed(figures.over_time(self._dataset, self._model, self._fit))

    def residuals(self, over: str | None = None, channel: str | None = None) -> Any:
        """Residual against what it may depend on; see `figures.residuals`.

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
        """
        if channel is not None and channel not in self._dataset.channels:
            raise UnknownNameError(f"no channel '{channel}'{closest(channel, self._dataset.channels)}")
        return handed(figures.residuals(self._dataset, self._model, self._fit, over=over, channel=channel))

    def where_it_fails(self) -> Any:
        """Error by manoeuvre, by branch and by run; see `figures.where_it_fails`.

        Returns
        -------
        matplotlib.axes.Axes, or ndarray of them
        """
        return handed(figures.where_it_fails(self._dataset, self._model, self._fit))

    def map(self, channel: str | None = None) -> Any:
        """Error over the plane that it is most concentrated on; see `figures.maps`.

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
        drawn = figures.maps(self._dataset, self._model, self._fit, channel)
        return handed(drawn, "this rig has no plane to draw over")

    def intervals(self) -> Any:
        """Parameters with their 95 % intervals; see `figures.intervals`.

        Returns
        -------
        matplotlib.axes.Axes
        """
        return handed(figures.intervals(self._record))

    def manoeuvres(self) -> Any:
        """The passes in motor space; see `figures.manoeuvres`.

        Returns
        -------
        matplotlib.axes.Axes, or ndarray of them

        Raises
        ------
        PlotError
            The rig has one motor.
        """
        drawn = figures.manoeuvres(self._dataset) if figures.has_plane(self._dataset) else None
        return handed(drawn, "this rig has no two motors to draw over")


class DiagnosisPlots:
    """Plots of a diagnosis.

    Parameters
    ----------
    dataset : Dataset
    found : Diagnosis
    """

    def __init__(self, dataset: Any, found: Any):
        self._dataset, self._found = dataset, found

    def candidates(self, most: int = 10) -> Any:
        """Candidates that promise the largest fall of the error; see `figures.candidates`.

        Parameters
        ----------
        most : int

        Returns
        -------
        matplotlib.axes.Axes
        """
        return handed(figures.candidates(self._found, most))

    def unexplained(self) -> Any:
        """Where a residual that no effect explains lives; see `figures.unexplained`.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        PlotError
            Nothing is unexplained, or one variable alone matters.
        """
        left = self._found.unexplained
        return handed(figures.unexplained(self._dataset, left) if left else None,
                      f"the verdict is {self._found.verdict}, and no map of what is left was made")


class SearchPlots:
    """Plots of a search.

    Parameters
    ----------
    dataset : Dataset
    found : Improvement
    """

    def __init__(self, dataset: Any, found: Any):
        self._dataset, self._found = dataset, found

    def path(self) -> Any:
        """Error at every step, on fitted and on held-out passes; see `figures.ladder`.

        Returns
        -------
        matplotlib.axes.Axes
        """
        return handed(figures.ladder(self._found, self._dataset))

    def signature(self, step: int = 1) -> Any:
        """What the effect of a step looks like; see `figures.signature`.

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
        return signature(self._dataset, (before.model, before.fit), (after.model, after.fit), after.added)


class PlanPlots:
    """Plots of a plan.

    Parameters
    ----------
    planned : Plan
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
        ws = self._planned.known.workspace
        return handed(plan_figures.workspace(ws) if len(ws.kinematics.motors) == 2 else None,
                      "this rig has no two motors to draw over")


def signature(dataset: Any, before: tuple[Any, Any], after: tuple[Any, Any], key: tuple[str, str]) -> Any:
    """What a missing effect looks like; see `figures.signature`.

    Parameters
    ----------
    dataset : Dataset
    before, after : (Model, Fit)
    key : (str, str)
        Effect and place.

    Returns
    -------
    matplotlib.axes.Axes, or ndarray of them
    """
    return handed(figures.signature(dataset, before, after, key))

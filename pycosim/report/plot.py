"""Series, axes and marks in; the description of a plot, which `figures` draws on paper and `charts` in a browser, out.

Nothing here knows a library. Looks are named by what they mean, so that each side has its own colours for them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np


@dataclass(frozen=True)
class Look:
    """What a mark looks like: curves of one panel differ in more than their tone, so that grey print is readable.

    Attributes
    ----------
    tone : str
        ``ink``, ``muted``, ``faint``, ``before``, ``after`` or ``third``.
    dash : str
        ``solid``, ``dash``, ``dashdot``, ``dot``; empty for points without a line.
    width : float
        Of a line, 1 for a thin one.
    marker : str
        ``circle``, ``square``, ``triangle``, ``diamond``, ``cross``, ``tick`` or ``point``; empty for a line
        without points.
    open : bool
        Whether markers are rings.
    hatch : str
        ``/``, ``.`` or ``x`` in bars; empty for plain ones.
    """

    tone: str = "ink"
    dash: str = "solid"
    width: float = 1.0
    marker: str = ""
    open: bool = False
    hatch: str = ""


TONES = "after", "before", "third", "ink"
DASHES = "solid", "dash", "dashdot", "dot"
MARKERS = "circle", "square", "triangle", "diamond"


def curve(k, **more):
    """Look of the k-th of some curves, all different without colour.

    Parameters
    ----------
    k : int
        From 0; after the last look the first comes again.
    **more
        Attributes of `Look`.

    Returns
    -------
    Look
    """
    return Look(TONES[k % 4], DASHES[(k + k // 4) % 4], **more)


@dataclass(frozen=True)
class Axis:
    """What is laid along an axis.

    Attributes
    ----------
    words : str
        What it shows, without the unit.
    unit : str
        Empty or ``1`` for a number without unit.
    names : sequence of str
        What stands at 0, 1, ...; of an axis of numbers, none.
    low, high : float, optional
        Where it ends, else where the data do.
    log, falling : bool
        Whether it is logarithmic; whether it begins at the top.
    """

    words: str = ""
    unit: str = ""
    names: Sequence[str] = ()
    low: float | None = None
    high: float | None = None
    log: bool = False
    falling: bool = False

    def label(self, printed=str):
        """Words and unit.

        Parameters
        ----------
        printed : callable
            Gives the unit as the reader sees it.

        Returns
        -------
        str
            As ``Speed of 2A [rad/s]``; names, as C_H and theta1, keep their letters.
        """
        named = any(not letter.isalpha() for letter in self.words.partition(" ")[0])
        text = self.words if named else self.words[:1].upper() + self.words[1:]
        return text if self.unit in ("1", "") else f"{text} [{printed(self.unit)}]"


@dataclass
class Line:
    """A curve or points: x and y, shape (n,); ``spread`` above and below, ``reach`` = (low, high) to left and right.

    ``told`` is said of each point where there is a pointer. A ``signal`` may be long: each side thins it to what it can
    show, without losing a peak. What stands ``aside`` is shown at once only where no pointer can ask for it.
    """

    x: np.ndarray
    y: np.ndarray
    look: Look
    name: str = ""
    spread: np.ndarray | None = None
    reach: tuple | None = None
    told: Sequence[str] = ()
    signal: bool = False
    aside: bool = False


@dataclass
class Bars:
    """Bars at places of an axis of names, the ``slot[0]``-th of ``slot[1]`` beside each other; ``across`` lie down."""

    at: Sequence[int]
    values: Sequence[float]
    look: Look
    name: str = ""
    slot: tuple = (0, 1)
    across: bool = False
    told: Sequence[str] = ()


@dataclass
class Cells:
    """Values over a plane: edges, shape (n + 1,), (m + 1,); values, shape (m, n), NaN where there is none; a text each.

    ``share`` [%] is said of a cell where there is a pointer. Colours go from 0 to ``top``, of ``signed`` from -``top``.
    """

    x: np.ndarray
    y: np.ndarray
    values: np.ndarray
    texts: Sequence
    share: np.ndarray
    colour: Axis
    top: float
    signed: bool = False
    name: str = ""


@dataclass
class Level:
    """A line across a panel at a value of y."""

    value: float
    look: Look
    name: str = ""


@dataclass
class Band:
    """A zone across a panel: between two values of y, or, ``upright``, of x."""

    low: float
    high: float
    name: str = ""
    upright: bool = False


@dataclass
class Spans:
    """Stretches (begin, end) of x, as bars in a row at y."""

    spans: Sequence
    y: float
    look: Look
    name: str = ""


@dataclass
class Names:
    """Words at x in a row at y, shown while there is room for them."""

    x: Sequence[float]
    y: float
    texts: Sequence[str]
    name: str = ""


@dataclass
class Text:
    """Words at a point; turned by ``angle`` [degrees]; ``beside``: at y, right of the panel."""

    x: float
    y: float
    text: str
    tone: str = "ink"
    angle: float = 0.0
    beside: bool = False


@dataclass
class Arrow:
    """From a point to a point."""

    start: tuple
    end: tuple
    look: Look


@dataclass
class Area:
    """A faint closed area with these corners."""

    x: np.ndarray
    y: np.ndarray
    tone: str = "muted"


@dataclass
class Panel:
    """Marks over two axes.

    Attributes
    ----------
    x, y : Axis
        Of all marks in the panel.
    marks : list
        Drawn in this order, the last on top.
    title : str
        Where several panels show the same of different things.
    equal : bool
        Whether both axes have one scale.
    height : float
        Relative to the others of its column.
    legend : bool
        Whether what is named here is named beside it, not above all panels.
    """

    x: Axis
    y: Axis
    marks: list = field(default_factory=list)
    title: str = ""
    equal: bool = False
    height: float = 1.0
    legend: bool = False

    @property
    def told(self):
        """What is named where it stands, and needs no legend."""
        return {m.text for m in self.marks if isinstance(m, Text)} | set(self.y.names)


@dataclass
class Plot:
    """One plot.

    Attributes
    ----------
    id : str
        Name of its files and of its element on a page.
    title : str
        A line above all panels.
    caption : str
        What it shows, in words that stand for it where it cannot be seen.
    columns : list of list of Panel
        From left to right, each from above.
    widths : sequence of float
        Of the columns, relative to each other; equal by default.
    width : float
        On paper: 1 for a column of text, 2 for a page.
    height : float
        On paper [inch].
    aligned, apart : bool
        Whether panels beside each other share their y axis; whether those of a column share no x axis.
    choice : str
        Its name among those of the same title, of which one is shown at a time.
    over : tuple of str
        Variables that it is drawn over, as ``speed@2A``.
    channel : str
        What it shows.
    note : str
        What the numbers in it are.
    """

    id: str
    title: str
    caption: str
    columns: list
    widths: Sequence[float] = ()
    width: float = 1.0
    height: float = 2.2
    aligned: bool = False
    apart: bool = False
    choice: str = ""
    over: tuple = ()
    channel: str = ""
    note: str = ""

    @property
    def panels(self):
        """All panels, column by column."""
        return [panel for column in self.columns for panel in column]


def beside(plots, title, **told):
    """Plots as one: beside each other what they are drawn over, below each other their channels.

    Parameters
    ----------
    plots : list of Plot
        Of one panel each.
    title : str
        Of the plot that comes out.
    **told
        Further attributes of the whole.

    Returns
    -------
    Plot
    """
    columns = {}
    for plot in plots:
        columns.setdefault(plot.over, []).extend(plot.panels)
    return replace(plots[0], title=title, columns=list(columns.values()), aligned=True, choice="", **told)

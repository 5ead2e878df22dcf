"""A log that was looked at, and what its columns are taken for, in; a plot of each of them out."""

from __future__ import annotations

import numpy as np

from .plot import Axis, Line, Look, Panel, Plot

HIGH = 0.95  # inch of a panel


def columns(proposal):
    """Every mapped column over time, as the log holds it, under the name of what it is taken for.

    Parameters
    ----------
    proposal : Proposal
        Its sample is drawn.

    Returns
    -------
    Plot or None
        None where nothing is mapped.
    """
    known = proposal.sample.columns
    mapped = {n: c for n, c in proposal.columns.items() if c.variable != "time" and n in known}
    if not mapped:
        return None
    clock = next((c.unit for n, c in proposal.columns.items() if n == proposal.time), "s")
    rows = np.arange(proposal.sample.rows)[:len(next(iter(known.values())))]
    time = known[proposal.time] if proposal.time else rows / proposal.rate if proposal.rate else rows
    x = Axis("time", clock) if proposal.time or proposal.rate else Axis("row")
    panels = [Panel(x, Axis(c.variable, c.unit), [Line(time, known[name], Look("after"), signal=True)],
                    f"column {name}") for name, c in mapped.items()]
    taken = ", ".join(f"{n} as {c.variable}" for n, c in mapped.items())
    return Plot("columns", "What the columns of the log are taken for", "Each mapped column over time, in the unit "
                f"that it is read in, before any gain or sign: {taken}.", [panels], width=2.0,
                height=0.5 + HIGH * len(panels))

"""The log of a co-simulation in; its signals over time, a panel a unit, as a description and as files, out."""

from __future__ import annotations

from .figures import save
from .plot import Axis, Line, Panel, Plot, curve

MOST = 4  # signals in one panel
WORDS = {"rad": "angle", "rad/s": "speed", "rad/s2": "acceleration", "N.m": "torque", "W": "power", "1": "value"}


def over_time(log, units):
    """Signals of a log over time, one panel a unit and at most four signals in each.

    Parameters
    ----------
    log : pandas.DataFrame
        ``time`` and the columns.
    units : dict of str to str
        Of the columns to draw.

    Returns
    -------
    Plot or None
        None where there are no columns.
    """
    groups = {}
    for name, unit in units.items():
        groups.setdefault(unit, []).append(name)
    time = log["time"].to_numpy()
    x = Axis("time", "s", low=time[0], high=max(time[-1], time[0] + 1e-9))
    panels = [Panel(x, Axis(WORDS.get(unit, "signal"), unit), [Line(time, log[n].to_numpy(), curve(i), n, signal=True)
              for i, n in enumerate(names[k:k + MOST])], legend=True)
              for unit, names in groups.items() for k in range(0, len(names), MOST)]
    return Plot("log", "Signals over time", "The signals of a co-simulation over time.", [panels], width=2,
                height=min(9.0, 0.5 + 1.3 * len(panels))) if panels else None


def write_log(folder, done):
    """Draw the log of a co-simulation into ``figures/`` of a folder.

    Parameters
    ----------
    folder : path
        There already; ``figures/`` is made in it.
    done : Cosimulation
        Its log is drawn, with the units of its description.
    """
    save(over_time(done.log, {n: c["unit"] for n, c in done.description["columns"].items()}), folder / "figures", "log")

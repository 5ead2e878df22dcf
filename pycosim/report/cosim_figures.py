"""The log of a co-simulation in; its signals over time, a panel a unit, as vector PDF with a PNG preview, out."""

from __future__ import annotations

from matplotlib.figure import Figure

from .figures import LINES, PAGE, TONES, _pretty, _styled, envelope, save

__all__ = ["over_time", "write_log"]

MOST = 4  # signals in one panel
WORDS = {"rad": "angle", "rad/s": "speed", "rad/s2": "acceleration", "N.m": "torque", "W": "power", "1": "value"}


@_styled
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
    Figure
    """
    groups = {}
    for name, unit in units.items():
        groups.setdefault(unit, []).append(name)
    panels = [(unit, names[k:k + MOST]) for unit, names in groups.items() for k in range(0, len(names), MOST)]
    figure = Figure(figsize=(PAGE, min(9.0, 0.5 + 1.3 * len(panels))))
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    time = log["time"].to_numpy()
    for a, (unit, names) in zip(axes, panels):
        for k, name in enumerate(names):
            a.plot(*envelope(time, log[name].to_numpy()), LINES[k], color=TONES[k], label=name)
        a.set_ylabel(f"{WORDS.get(unit, 'signal')} [{_pretty(unit)}]")
        a.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)
    axes[-1].set_xlabel("time [s]")
    axes[-1].set_xlim(time[0], max(time[-1], time[0] + 1e-9))
    return figure


def write_log(folder, done):
    """Draw the log of a co-simulation into ``figures/`` of a folder.

    Parameters
    ----------
    folder : path
    done : Cosimulation
    """
    units = {n: c["unit"] for n, c in done.description["columns"].items()}
    if units:
        save(over_time(done.log, units), folder / "figures", "log")

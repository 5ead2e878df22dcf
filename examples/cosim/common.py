"""A scenario's name in; its log, with changed components, out. What the four questions share."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pycosim as pc
from pycosim.compile import Library
from pycosim.cosim.scenario import Column, load_scenario

HERE = Path(__file__).parent
IMAGES = HERE.parents[1] / "docs" / "images"
LIBRARY = Library()
T_R, TAU_PEAK, TAU_NOMINAL = 15.125, 14.98, 6.35  # Nobili et al.: ratio; motor torques from 453 and 192 N.m at a joint


def changed(scenario, **components):
    """A scenario with some fields of some components replaced; dictionaries are added to.

    Parameters
    ----------
    scenario : str or Scenario
        Name of a scenario of this folder.
    **components
        Fields of the component of this name.

    Returns
    -------
    Scenario
    """
    made = load_scenario(HERE / f"{scenario}.toml") if isinstance(scenario, str) else scenario
    parts = []
    for c in made.components:
        fields = components.get(c.name, {})
        parts.append(replace(c, **{k: _merged(getattr(c, k), v) for k, v in fields.items()}))
    return replace(made, components=parts)


def _merged(old, new):
    if isinstance(new, dict):
        return {**old, **new}
    return Fraction(new) if isinstance(old, Fraction) else new


def logged(scenario, rate=1000, **signals):
    """The log of a scenario, some more signals in it (``_`` for the dot before the variable), all without noise."""
    columns = {n: Column(c.signal) for n, c in scenario.columns.items()}
    columns.update({n: Column(tuple(s.split(".", 1))) for n, s in signals.items()})
    return pc.cosimulate(replace(scenario, log_rate=Fraction(rate), columns=columns), library=LIBRARY).log

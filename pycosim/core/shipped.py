"""Name of a folder of files that come with the program in; where it is, out."""

from __future__ import annotations

from pathlib import Path


def shipped(name):
    """A folder of files that are no Python: inside the package where it is installed, beside it in a checkout.

    Parameters
    ----------
    name : str
        ``modelica``, ``fmu`` or ``engines``.

    Returns
    -------
    pathlib.Path
    """
    package = Path(__file__).parents[1]
    inside = package / name
    return inside if inside.exists() else package.parent / name

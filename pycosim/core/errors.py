"""Errors of pycosim: one sentence that says what is wrong, where, and what to do."""

import difflib
from pathlib import Path


class PycosimError(Exception):
    """Base of every error that bad input can cause; the command line prints it and exits with 2."""


class StudyError(PycosimError):
    """The study file is missing, broken or contradicts itself."""


class DataError(PycosimError):
    """A log cannot be used as it is."""


class StillError(DataError):
    """Nothing moves in a log, or too little for a fit; no mistake, if that is what was recorded."""


class UnknownNameError(PycosimError):
    """A name (parameter, effect, place, column, class, unit) that nothing carries."""


class ModelicaError(PycosimError):
    """A Modelica file does not parse, or a class does not compile."""


class BoundsError(PycosimError):
    """A value outside the bounds of its parameter."""


class NoAnswerError(PycosimError):
    """The model has no finite answer for these parameters and data."""


class ScenarioError(PycosimError):
    """A co-simulation's scenario is missing, broken or contradicts itself, or does not fit its checkpoint."""


class CosimulationError(PycosimError):
    """A component of a co-simulation cannot be loaded, or fails on the way."""


class ExportError(PycosimError):
    """A machine cannot be exported as asked, or its binary cannot be built."""


class PlanError(PycosimError):
    """No experiment fits the limits, or none answers what was asked."""


def closest(name, known):
    """Return a clause that names the nearest known names.

    Parameters
    ----------
    name : str
        What was asked for.
    known : iterable of str
        What exists.

    Returns
    -------
    str
        ``"; closest: 'x'"``, or the list of known names when nothing is near and the list is short.

    Examples
    --------
    >>> closest("stribek", ["stribeck", "viscous"])
    "; closest: 'stribeck'"
    """
    known = list(dict.fromkeys(known))
    folded = {k.lower(): k for k in known}
    near = difflib.get_close_matches(str(name).lower(), folded, n=1, cutoff=0.5)
    if near:
        return f"; closest: '{folded[near[0]]}'"
    if 0 < len(known) <= 25:
        return "; known: " + ", ".join(known)
    return ""


def closest_file(path, endings):
    """Return a clause that names the file beside a missing one whose name is nearest.

    Parameters
    ----------
    path : path
        What was asked for.
    endings : collection of str
        Of the files that would do beside those with its own, as ``.csv``; what the names share beyond it counts.

    Returns
    -------
    str
        ``"; closest: 'x.csv'"``, or nothing where no name is near.
    """
    path = Path(path)
    if not path.parent.is_dir():
        return ""
    endings = {path.suffix.lower(), *endings}
    beside = {p.stem.lower(): p.name for p in sorted(path.parent.iterdir())
              if p.suffix.lower() in endings and p.is_file()}
    near = difflib.get_close_matches(path.stem.lower(), beside, n=1, cutoff=0.5)
    return f"; closest: '{beside[near[0]]}'" if near else ""

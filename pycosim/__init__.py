"""Compare the model of a geared or cable-driven actuator with its measurements, and learn which effect is missing.

>>> import pycosim as pc
>>> project = pc.open("study.toml", data="run.csv")   # doctest: +SKIP
>>> project.improve().report("report.html")           # doctest: +SKIP

Nothing heavy is imported before a name is asked for, so that ``import pycosim`` is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .core.errors import PycosimError as PycosimError
    from .core.executors import computing as computing
    from .project import Calibration as Calibration
    from .project import Candidate as Candidate
    from .project import Check as Check
    from .project import Comparison as Comparison
    from .project import Confirmation as Confirmation
    from .project import Cosimulation as Cosimulation
    from .project import Diagnosis as Diagnosis
    from .project import Draws as Draws
    from .project import Export as Export
    from .project import Fitted as Fitted
    from .project import Parameter as Parameter
    from .project import Plan as Plan
    from .project import Project as Project
    from .project import ResultError as ResultError
    from .project import Search as Search
    from .project import Step as Step
    from .project import calibrate as calibrate
    from .project import cosimulate as cosimulate
    from .project import open_project as open  # noqa: F401

__version__ = "0.1.0"

# name: module that has it, and what it is called there
_NAMES = {
    "Calibration": ("project", "Calibration"),
    "Candidate": ("project", "Candidate"),
    "Check": ("project", "Check"),
    "Comparison": ("project", "Comparison"),
    "Confirmation": ("project", "Confirmation"),
    "Cosimulation": ("project", "Cosimulation"),
    "Diagnosis": ("project", "Diagnosis"),
    "Draws": ("project", "Draws"),
    "Export": ("project", "Export"),
    "Fitted": ("project", "Fitted"),
    "Parameter": ("project", "Parameter"),
    "Plan": ("project", "Plan"),
    "Project": ("project", "Project"),
    "PycosimError": ("core.errors", "PycosimError"),
    "ResultError": ("project", "ResultError"),
    "Search": ("project", "Search"),
    "Step": ("project", "Step"),
    "calibrate": ("project", "calibrate"),
    "computing": ("core.executors", "computing"),
    "cosimulate": ("project", "cosimulate"),
    "open": ("project", "open_project"),
}
__all__ = [*_NAMES, "__version__"]


def __getattr__(name: str) -> Any:
    if name not in _NAMES:
        raise AttributeError(f"module 'pycosim' has no attribute '{name}'; it offers {', '.join(_NAMES)}")
    module, own = _NAMES[name]
    return getattr(import_module(f".{module}", __name__), own)


def __dir__() -> list[str]:
    return sorted([*globals(), *_NAMES])

"""A study and its logs in; objects that fit, compare, diagnose, improve, plan, report and export, out.

This is what ``import pycosim`` opens on. Command line, app, demo and benchmarks go through the same door.
"""

from .calibrated import Calibration, calibrate
from .checked import Check
from .confirmed import Confirmation
from .cosimulated import Cosimulation, cosimulate
from .diagnosed import Candidate, Candidates, Diagnosis
from .drawn import Draws
from .exported import Export
from .fitted import Comparison, Fitted, Parameter, Parameters
from .planned import Plan
from .project import Project, open_project
from .searched import Search, Step
from .shown import ResultError

__all__ = ["Calibration", "Candidate", "Candidates", "Check", "Comparison", "Confirmation", "Cosimulation",
           "Diagnosis", "Draws", "Export", "Fitted", "Parameter", "Parameters", "Plan", "Project", "ResultError",
           "Search", "Step", "calibrate", "cosimulate", "open_project"]

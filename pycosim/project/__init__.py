"""A study and its logs in; objects that fit, compare, diagnose, improve, plan, report and export, out.

This is what ``import pycosim`` opens on. Command line, app, demo and benchmarks go through the same door.
"""

from .checked import Check
from .diagnosed import Candidate, Candidates, Diagnosis
from .fitted import Comparison, Fitted, Parameter, Parameters
from .planned import Plan
from .project import Project, open_project
from .searched import Search, Step
from .shown import ResultError

__all__ = ["Candidate", "Candidates", "Check", "Comparison", "Diagnosis", "Fitted", "Parameter", "Parameters",
           "Plan", "Project", "ResultError", "Search", "Step", "open_project"]

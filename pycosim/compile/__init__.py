"""Modelica class and effects in, CasADi functions with named, unit-carrying variables out."""

from .arrays import ArrayFunction
from .attach import extend
from .effects import (
    Effect,
    Place,
    catalogue,
    component_called,
    component_name,
    corrections,
    find_effect,
    find_place,
    places,
    potentials,
    ranked,
)
from .model import FILTERED, Model, Question, compile_model
from .parse import Library, shared_library
from .solve import solve

__all__ = ["FILTERED", "ArrayFunction", "Effect", "Library", "Model", "Place", "Question", "catalogue", "compile_model",
           "component_called", "component_name", "corrections", "extend", "find_effect", "find_place", "places",
           "potentials", "ranked", "shared_library", "solve"]

"""A plant in, plain Modelica out: the rig, its effects and its identified values."""

from __future__ import annotations

from ..compile.effects import extend
from .description import c_name


def to_modelica(plant):
    """Text of a package with the rig, its effects, and a model that carries the study's values.

    Parameters
    ----------
    plant : Plant

    Returns
    -------
    str
        Needs the library DriveTrain beside it, nothing else.
    """
    name = c_name(plant.name)
    package = name[0].upper() + name[1:]
    effects = extend(plant.rig, plant.model.attached, "WithEffects")
    lines = [f'package {package} "{plant.rig} as the study {plant.name} has it"',
             *("  " + line for line in effects.rstrip().splitlines()),
             '  model Machine "The rig with its effects and identified values"',
             f"    extends WithEffects{_modifications(plant)};",
             "  end Machine;", f"end {package};", ""]
    return "\n".join(lines)


def _modifications(plant):
    """``(s1A(f0 = 0.1, mu = 0.9), t_r = 15)``: values that differ from the rig's own, or that the study gives."""
    tree = {}
    for name in plant.parameters:
        if name in plant.identified or plant.parameters[name] != plant.model.parameters[name].value:
            *path, last = name.split(".")
            node = tree
            for part in path:
                node = node.setdefault(part, {})
            node[last] = plant.parameters[name]
    return f"({_arguments(tree)})" if tree else ""


def _arguments(tree):
    return ", ".join(f"{n}({_arguments(v)})" if isinstance(v, dict) else f"{n} = {v!r}" for n, v in tree.items())

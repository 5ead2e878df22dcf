"""A plant in, plain Modelica out: the rig, its effects and its identified values."""

from __future__ import annotations

import re

from ..compile.attach import extend
from .description import c_name

_NAME = re.compile(r"\b[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*")
_QUOTED = re.compile(r'"(?:[^"\\]|\\.)*"|//[^\n]*|/\*.*?\*/', re.S)  # texts and comments, which name no class


def to_modelica(plant, self_contained=False):
    """Text of a package with the rig, its effects, and a model that carries the study's values.

    Parameters
    ----------
    plant : Plant
        Of `pycosim.export.description.describe`.
    self_contained : bool
        Whether the classes of the library that it needs come along, inside the package.

    Returns
    -------
    str
        Needs the library DriveTrain beside it, nothing else; self-contained, nothing at all.
    """
    name = c_name(plant.name)
    package = name[0].upper() + name[1:]
    effects = extend(plant.rig, plant.model.attached, "WithEffects")
    study = plant.name.replace("\\", "\\\\").replace('"', '\\"')
    lines = [f'package {package} "{plant.rig} as the study {study} has it"',
             *("  " + line for line in effects.rstrip().splitlines()),
             *("  " + line for line in (_needed(plant) if self_contained else ())),
             '  model Machine "The rig with its effects and identified values"',
             f"    extends WithEffects{_modifications(plant)};",
             "  end Machine;", f"end {package};", ""]
    return "\n".join(lines)


def _needed(plant):
    """Lines of the classes that the machine needs, in packages as in the library; the user's own beside them."""
    library, known, needed = plant.model.library, set(plant.model.library.walk()), set()
    texts = {_full_name(text): text for text in library.text.values()}
    todo = [plant.rig, *(e.model for e, _ in plant.model.attached)]
    while todo:
        name = todo.pop()
        if name in needed or name not in texts or name not in known:
            continue
        needed.add(name)
        scope = name.rpartition(".")[0]
        for word in set(_NAME.findall(_QUOTED.sub("", texts[name]))):
            outer = scope
            while f"{outer}.{word}".lstrip(".") not in known and outer:
                outer = outer.rpartition(".")[0]
            todo.append(f"{outer}.{word}".lstrip("."))
    tree = {}
    for name in sorted(needed):
        *packages, last = name.split(".")
        node = tree
        for package in packages:
            node = node.setdefault(package, {})
        node[last] = texts[name]
    return _package(tree, texts)


def _full_name(text):
    """Dotted name of the class that a file holds."""
    within = re.match(r"\s*within\s+([\w.]+)\s*;", text)
    name = re.findall(r"^end (\w+);", text, re.M)[-1:] or [""]
    return f"{within[1]}.{name[0]}" if within else name[0]


def _package(tree, texts, prefix=""):
    """Lines of classes and packages, one inside the other."""
    lines = []
    for name, content in tree.items():
        if isinstance(content, str):
            lines += re.sub(r"^\s*within\b[^;]*;\n?", "", content).rstrip().splitlines()
            continue
        full = f"{prefix}{name}"
        comment = re.search(rf'package {name}\s*("(?:[^"\\]|\\.)*")', texts.get(full, ""))
        lines.append(f"package {name}{' ' + comment[1] if comment else ''}")
        lines += ["  " + line for line in _package(content, texts, f"{full}.")]
        lines.append(f"end {name};")
    return lines


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

"""A study and its model, and further FMUs, in; one SSP file out: what is connected to what, and with which values."""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as xml
from dataclasses import dataclass, field
from pathlib import Path

from .. import __version__
from ..control import controllers
from ..core.errors import ExportError, ModelicaError, StudyError
from ..core.extras import extra
from . import units
from .controller import export_block
from .description import c_name, describe, values
from .fmu import export_fmu, write_archive
from .xml import clean

PLANT = "plant"
STRUCTURE = "SystemStructure.ssd"
_SPACE = "http://ssp-standard.org/SSP1/SystemStructure"
_NAMES = {"ssd": f"{_SPACE}Description", "ssc": f"{_SPACE}Common", "ssv": f"{_SPACE}ParameterValues"}
_SETS = {"identified": "Parameters whose value the study gives",
         "defaults": "Parameters that nobody measured: the library's own values"}


@dataclass(frozen=True)
class Part:
    """One FMU of a system.

    Attributes
    ----------
    name : str
        Of the component.
    fmu : bytes
        The file.
    connectors : dict of str to (str, str, str)
        Name of a variable to ``input`` or ``output``, its type (``Real``, ``Boolean``), and its unit or an empty text.
    parameters : dict of str to (float, str)
        Start value and unit of each.
    """

    name: str
    fmu: bytes
    connectors: dict
    parameters: dict = field(default_factory=dict)


def read_part(name, path):
    """An FMU as a part of a system.

    Parameters
    ----------
    name : str
        What the component shall be called.
    path : path
        FMU of FMI 2 or 3 with scalar variables.

    Returns
    -------
    Part

    Raises
    ------
    StudyError
        There is no FMU, or it has no such interface.
    """
    fmpy = extra("fmpy", "a system of FMUs (SSP)", ExportError)
    try:
        description = fmpy.read_model_description(str(path))
    except Exception as error:  # whatever fmpy meets in a file that is none
        raise StudyError(f"{path}: no FMU that can be read ({' '.join(str(error).split())[:200]})") from None
    if description.coSimulation is None:
        raise StudyError(f"{path}: the FMU has no co-simulation interface, which a system needs")
    kinds = {"Float64": "Real", "Float32": "Real"}
    connectors = {v.name: (v.causality, kinds.get(v.type, v.type), v.unit or "")
                  for v in description.modelVariables if v.causality in ("input", "output")}
    parameters = {v.name: (float(v.start), v.unit or "") for v in description.modelVariables
                  if v.causality == "parameter" and kinds.get(v.type, v.type) == "Real"}
    return Part(name, Path(path).read_bytes(), connectors, parameters)


def control_parts(study, model, fmi=2, platforms="host"):
    """A position controller and a joint torque estimator of a machine, and what goes from the one to the plant.

    Parameters
    ----------
    study : Study
        Its values are what the controller believes of the machine.
    model : Model
        The compiled rig with the study's effects.
    fmi : int
        2 or 3.
    platforms : str
        ``host`` or ``all``.

    Returns
    -------
    parts : list of Part
        Without one whose questions the machine does not answer.
    wires : dict of (str, str) to (str, str)
        Component and input, to component and output: what is connected though the names differ.
    missing : list of str
        What there is not, and why.
    """
    given, parts, missing = values(study, model), [], []
    for name, kind in (("controller", "position"), ("estimator", "estimator")):
        try:
            block = controllers.make(kind, model, given)
        except (StudyError, ModelicaError) as error:
            missing.append(f"no {name}: {error}")
            continue
        with tempfile.TemporaryDirectory() as folder:
            parts.append(read_part(name, export_block(block, folder, fmi, platforms)))
    plant, wires = describe(study, model), {}
    unit = {e.name: e.variable.unit for e in plant.entries}
    torques = next((p.connectors for p in parts if p.name == "controller"), {})
    for motor, drive in ((m, members["drive"]) for m, members in plant.terminals if "drive" in members):
        if f"{motor}.tau" in torques and unit[drive] == "N.m":
            wires[PLANT, drive] = "controller", f"{motor}.tau"
        elif torques:
            missing.append(f"'{drive}' [{unit[drive]}] is not connected, since the controller gives torques")
    return parts, wires, missing


def export_ssp(study, model, folder, fmi=2, platforms="host", others=(), wires=None):
    """Write ``<study>.ssp``: the plant, further parts, their parameter sets, and what is connected to what.

    An output and an input of two parts are connected where their names are the same, as ``tau1``, the plant's output
    first; what is left of the inputs, and every output, is at the border of the system, dots as underscores, those of
    other parts as ``estimator_C``.

    Parameters
    ----------
    study : Study
        Its values become the plant's parameter set.
    model : Model
        The compiled rig with the study's effects.
    folder : path
        Where the file goes.
    fmi : int
        2 or 3.
    platforms : str
        ``host`` or ``all``.
    others : sequence of Part
        Controllers, estimators; see `read_part` and `control_parts`.
    wires : dict of (str, str) to (str, str), optional
        Component and input, to the component and output that feeds it under another name.

    Returns
    -------
    Path

    Raises
    ------
    StudyError
        Two parts have one name, or two outputs feed one input.
    ExportError
        A binary cannot be built, or the file cannot be written.
    """
    plant = describe(study, model)
    parts = {PLANT: {e.name: (e.causality, "Boolean" if e.boolean else "Real", e.variable.unit)
                     for e in plant.entries if e.causality in ("input", "output")}}
    for other in others:
        if other.name in parts:
            raise StudyError(f"two components of the system are called '{other.name}'; give each its own name")
        parts[other.name] = other.connectors
    sets = {**_sets(plant), **{p.name: {f"{p.name}.{n}": v for n, v in p.parameters.items()}
                               for p in others if p.parameters}}
    files = {STRUCTURE: _structure(plant, parts, sets, wires or {}),
             **{f"resources/{p.name}.fmu": p.fmu for p in others},
             **{f"resources/{kind}.ssv": _values(kind, found) for kind, found in sets.items()}}
    with tempfile.TemporaryDirectory() as temporary:
        fmu = export_fmu(study, model, temporary, fmi, ("cs", "me"), platforms)
        files[f"resources/{PLANT}.fmu"] = fmu.read_bytes()
    path = Path(folder) / f"{study.name}.ssp"
    write_archive(path, files, STRUCTURE, _validate)
    return path


def _tag(short):
    space, _, name = short.partition(":")
    return f"{{{_NAMES[space]}}}{name}"


def _add(parent, short, **attributes):
    return xml.SubElement(parent, _tag(short), attributes)


def _bytes(root):
    clean(root)
    for short, space in _NAMES.items():
        xml.register_namespace(short, space)
    xml.indent(root, "  ")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + xml.tostring(root, encoding="utf-8") + b"\n"


def _units(root, space, used):
    """Declare the units that are used."""
    group = _add(root, f"{space}:Units")
    for unit in dict.fromkeys(u for u in used if u):
        element = _add(group, "ssc:Unit", name=unit)
        base = {k: str(n) for k, n in (units.exponents(unit) or {}).items()}
        if units.offset(unit):
            base["offset"] = repr(units.offset(unit))
        _add(element, "ssc:BaseUnit", **base)


def _sets(plant):
    """Parameters of the plant by the set they belong to, as value and unit; no set is empty."""
    found = {kind: {f"{PLANT}.{e.name}": (e.variable.value, e.variable.unit) for e in plant.entries
                    if e.causality == "parameter" and (e.name in plant.identified) == (kind == "identified")}
             for kind in _SETS}
    return {kind: entries for kind, entries in found.items() if entries}


def _values(kind, parameters):
    """One parameter set, with names as the whole system sees them."""
    root = xml.Element(_tag("ssv:ParameterSet"), version="1.0", name=kind,
                       description=_SETS.get(kind, f"Parameters of the {kind}, and what it believes of the machine"),
                       generationTool=f"pycosim {__version__}")
    group = _add(root, "ssv:Parameters")
    for name, (value, unit) in parameters.items():
        parameter = _add(group, "ssv:Parameter", name=name)
        _add(parameter, "ssv:Real", value=repr(float(value)), **({"unit": unit} if unit else {}))
    _units(root, "ssv", [unit for _, unit in parameters.values()])
    return _bytes(root)


def _structure(plant, parts, sets, wires):
    """``SystemStructure.ssd``."""
    root = xml.Element(_tag("ssd:SystemStructureDescription"), version="1.0", name=plant.name,
                       description=f"{plant.rig}: {plant.description}", generationTool=f"pycosim {__version__}")
    system = _add(root, "ssd:System", name=c_name(plant.name))
    border, connections = _wiring(parts, wires)
    _connectors(system, border)
    bindings = _add(system, "ssd:ParameterBindings")
    for kind in sets:
        _add(bindings, "ssd:ParameterBinding", source=f"resources/{kind}.ssv")
    elements = _add(system, "ssd:Elements")
    for part, connectors in parts.items():
        component = _add(elements, "ssd:Component", name=part, type="application/x-fmu-sharedlibrary",
                         source=f"resources/{part}.fmu")
        _connectors(component, connectors)
    group = _add(system, "ssd:Connections")
    for (start, start_name), (end, end_name) in connections:
        ends = {"startElement": start, "startConnector": start_name, "endElement": end, "endConnector": end_name}
        _add(group, "ssd:Connection", **{k: v for k, v in ends.items() if v is not None})
    _units(root, "ssd", [unit for connectors in parts.values() for _, _, unit in connectors.values()])
    _add(root, "ssd:DefaultExperiment", startTime="0.0", stopTime="1.0")
    return _bytes(root)


def _connectors(element, connectors):
    group = _add(element, "ssd:Connectors")
    for name, (kind, type_, unit) in connectors.items():
        connector = _add(group, "ssd:Connector", name=name, kind=kind)
        _add(connector, f"ssc:{type_}", **({"unit": unit} if unit and type_ == "Real" else {}))


def _wiring(parts, wires):
    """Connectors of the system, and connections as ((component or None, name), (component or None, name))."""
    border, connections, whose = {}, [], {}

    def outside(name, connector):
        """A connector of the system: importers take identifiers only, so dots become underscores."""
        ident = c_name(name)
        if whose.setdefault(ident, name) != name:
            raise StudyError(f"at the border of the system, '{whose[ident]}' and '{name}' would both be called "
                             f"'{ident}'; give one of the variables another name")
        border[ident] = connector
        return None, ident

    for part, connectors in parts.items():
        for name, connector in connectors.items():
            if connector[0] == "input":
                start = wires.get((part, name)) or _feeding(parts, part, name)
                if start[0] is None:
                    start = outside(name, connector)
                connections.append((start, (part, name)))
            else:
                end = outside(name if part == PLANT else f"{part}_{name}", connector)
                connections.append(((part, name), end))
    return border, connections


def _feeding(parts, part, name):
    """The output that an input takes by its name, the plant's first; None for the border of the system."""
    found = [p for p, connectors in parts.items() if p != part and connectors.get(name, [""])[0] == "output"]
    if len(found) > 1 and PLANT not in found:
        raise StudyError(f"input '{name}' of '{part}' has the outputs of {' and '.join(found)} to choose from; give "
                         "one of them another name")
    return (PLANT if PLANT in found else found[0] if found else None), name


def _validate(path):
    """Hold the file against the standard's schemas, as fmpy carries them."""
    extra("fmpy.ssp.ssd", "a system of FMUs (SSP)", ExportError).read_ssd(path)

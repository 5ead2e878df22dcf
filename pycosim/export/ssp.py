"""A study and its model, and further FMUs, in; one SSP file out: what is connected to what, and with which values."""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as xml
from dataclasses import dataclass
from pathlib import Path

from .. import __version__
from ..errors import StudyError
from . import units
from .description import describe
from .fmu import export_fmu, write_archive

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
    """

    name: str
    fmu: bytes
    connectors: dict


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
    from fmpy import read_model_description
    try:
        description = read_model_description(str(path))
    except Exception as error:  # whatever fmpy meets in a file that is none
        raise StudyError(f"{path}: no FMU that can be read ({' '.join(str(error).split())[:200]})") from None
    if description.coSimulation is None:
        raise StudyError(f"{path}: the FMU has no co-simulation interface, which a system needs")
    kinds = {"Float64": "Real", "Float32": "Real"}
    connectors = {v.name: (v.causality, kinds.get(v.type, v.type), v.unit or "")
                  for v in description.modelVariables if v.causality in ("input", "output")}
    return Part(name, Path(path).read_bytes(), connectors)


def export_ssp(study, model, folder, fmi=2, platforms="host", others=()):
    """Write ``<study>.ssp``: the plant, its parameter sets, and what is connected to it by name.

    An output and an input of two parts are connected where their names are the same, as ``tau1``; what is left of the
    inputs, and every output of the plant, is at the border of the system.

    Parameters
    ----------
    study : Study
    model : Model
        The compiled rig with the study's effects.
    folder : path
        Where the file goes.
    fmi : int
        2 or 3.
    platforms : str
        ``host`` or ``all``.
    others : sequence of Part
        Controllers, estimators; see `read_part`.

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
    files = {STRUCTURE: _structure(plant, parts), **{f"resources/{p.name}.fmu": p.fmu for p in others},
             **{f"resources/{kind}.ssv": _values(plant, kind) for kind in _sets(plant)}}
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
    """Parameters by the set they belong to; no set is empty."""
    found = {kind: [e for e in plant.entries if e.causality == "parameter"
                    and (e.name in plant.identified) == (kind == "identified")] for kind in _SETS}
    return {kind: entries for kind, entries in found.items() if entries}


def _values(plant, kind):
    """One parameter set, with names as the whole system sees them."""
    root = xml.Element(_tag("ssv:ParameterSet"), version="1.0", name=kind, description=_SETS[kind],
                       generationTool=f"pycosim {__version__}")
    group, used = _add(root, "ssv:Parameters"), []
    for entry in _sets(plant)[kind]:
        parameter = _add(group, "ssv:Parameter", name=f"{PLANT}.{entry.name}")
        _add(parameter, "ssv:Real", value=repr(float(entry.variable.value)), unit=entry.variable.unit)
        used.append(entry.variable.unit)
    _units(root, "ssv", used)
    return _bytes(root)


def _structure(plant, parts):
    """``SystemStructure.ssd``."""
    root = xml.Element(_tag("ssd:SystemStructureDescription"), version="1.0", name=plant.name,
                       description=f"{plant.rig}: {plant.description}", generationTool=f"pycosim {__version__}")
    system = _add(root, "ssd:System", name=plant.name)
    border, connections = _wiring(parts)
    _connectors(system, border)
    bindings = _add(system, "ssd:ParameterBindings")
    for kind in _sets(plant):
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


def _wiring(parts):
    """Connectors of the system, and connections as ((component or None, name), (component or None, name))."""
    sources, border, connections = {}, {}, []
    for part, connectors in parts.items():
        for name, (kind, *_) in connectors.items():
            if kind == "output":
                sources.setdefault(name, []).append(part)
    for part, connectors in parts.items():
        for name, (kind, *rest) in connectors.items():
            feeding = [s for s in sources.get(name, ()) if s != part]
            if kind == "input" and len(feeding) > 1:
                raise StudyError(f"input '{name}' of '{part}' has the outputs of {' and '.join(feeding)} to choose "
                                 "from; give one of them another name")
            if kind == "input":
                if not feeding:
                    border[name] = (kind, *rest)
                connections.append(((feeding[0] if feeding else None, name), (part, name)))
            elif part == PLANT:
                border[name] = (kind, *rest)
                connections.append(((part, name), (None, name)))
    return border, connections


def _validate(path):
    """Hold the file against the standard's schemas, as fmpy carries them."""
    from fmpy.ssp.ssd import read_ssd
    read_ssd(path)

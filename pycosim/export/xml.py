"""A plant in, the XML files of its FMU out: model description, build description, terminals."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as xml

from .. import __version__
from . import units

TOLERANCE = 1e-6  # relative; of an importer's solver in model exchange, where its own default may be coarser
AUTHORS = {"author": "the study's authors, by pycosim", "version": __version__,
           "license": "Apache-2.0 and others, see documentation/licenses; parameters belong to whoever made the study"}
STIFF = ("The equations are stiff: a friction state settles within its travel, microseconds at speed. In model "
         "exchange, take an implicit solver with error control (CVode with BDF, Radau, DASSL); explicit ones need "
         "steps of about travel / speed. In co-simulation the FMU brings its own implicit solver.")
_TYPE = "Modelica.Units.SI."
_NOT_IN_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
LOG = {"logStatusError": "Why a call failed", "logStatusDiscard": "Why a point was refused, to be tried closer"}


def model_description(plant, fmi, kinds, identifier, token):
    """``modelDescription.xml``.

    Parameters
    ----------
    plant : Plant
        Its entries become ``ModelVariables``, in the order of their value references.
    fmi : int
        2 or 3.
    kinds : sequence of str
        ``cs``, ``me``.
    identifier : str
        Name of the binary and prefix of its functions.
    token : str
        GUID or instantiation token.

    Returns
    -------
    bytes
    """
    root = _root(plant, fmi, token)
    for kind in ("me", "cs"):
        if kind in kinds:
            _interface(root, fmi, kind, identifier, plant)
    _units(root, plant)
    _types(root, plant, fmi)
    categories = xml.SubElement(root, "LogCategories")
    for name, text in LOG.items():
        xml.SubElement(categories, "Category", name=name, description=text)
    xml.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime="1.0", tolerance=repr(TOLERANCE),
                   stepSize=repr(_step(plant)))
    if fmi == 2 and "me" in kinds:
        tool = xml.SubElement(xml.SubElement(root, "VendorAnnotations"), "Tool", name="pycosim")
        xml.SubElement(tool, "Solver", stiff="true", description=STIFF)
    variables = xml.SubElement(root, "ModelVariables")
    for number, entry in enumerate(plant.entries):
        if fmi == 2:
            _variable2(variables, number, entry)
        else:
            _variable3(variables, number, entry, "cs" in kinds and not plant.sampled)
    (_structure2 if fmi == 2 else _structure3)(xml.SubElement(root, "ModelStructure"), plant)
    if fmi == 3 and "me" in kinds:
        note = xml.SubElement(xml.SubElement(root, "Annotations"), "Annotation", type="pycosim")
        xml.SubElement(note, "Solver", stiff="true", description=STIFF)
    return _bytes(root)


def value_reference(number):
    """Value reference of a variable.

    Parameters
    ----------
    number : int
        Its place among the plant's entries, from zero on.

    Returns
    -------
    int
        The place from one on, as FMI 2 counts where it speaks of variables by index. FMI 3 speaks of them by reference;
        an importer that takes one for the other (OMSimulator 3.0 does) is right with both.
    """
    return number + 1


def _step(plant):
    """Longest internal step [s], or the period of a sampled model: the last parameter."""
    return next(e for e in reversed(plant.entries) if e.causality == "parameter").variable.value


def build_description(fmi, identifier):
    """``sources/buildDescription.xml`` of FMI 3.

    Parameters
    ----------
    fmi : int
        3; it names the file to compile.
    identifier : str
        Name of the binary.

    Returns
    -------
    bytes
    """
    root = xml.Element("fmiBuildDescription", fmiVersion="3.0")
    build = xml.SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    files = xml.SubElement(build, "SourceFileSet", language="C99")
    xml.SubElement(files, "SourceFile", name=f"fmi{fmi}.c")
    return _bytes(root)


def terminals(plant):
    """``terminalsAndIcons/terminalsAndIcons.xml`` of FMI 3.

    Parameters
    ----------
    plant : Plant
        Its motors and joints become terminals.

    Returns
    -------
    bytes
    """
    root = xml.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    graphics = xml.SubElement(root, "GraphicalRepresentation")
    box = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    xml.SubElement(graphics, "CoordinateSystem", **box, suggestedScalingFactorTo_mm="0.1")
    xml.SubElement(graphics, "Icon", **box)
    group = xml.SubElement(root, "Terminals")
    for name, members in plant.terminals:
        terminal = xml.SubElement(group, "Terminal", name=name, matchingRule="bus",
                                  description=f"Rotational connection of {name}")
        for member, variable in members.items():
            xml.SubElement(terminal, "TerminalMemberVariable", variableName=variable, memberName=member,
                           variableKind="signal")
    return _bytes(root)


def clean(root):
    """Put a space for every character that XML cannot hold, as a file's name or a description may.

    Parameters
    ----------
    root : xml.etree.ElementTree.Element
        Its attributes, and those of what is in it, are changed in place.
    """
    for element in root.iter():
        for key, text in element.attrib.items():
            element.set(key, _NOT_IN_XML.sub(" ", text))


def _bytes(root):
    clean(root)
    xml.indent(root, "  ")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + xml.tostring(root, encoding="utf-8") + b"\n"


def _root(plant, fmi, token):
    given = {"fmiVersion": f"{fmi}.0", "modelName": plant.name,
             "guid" if fmi == 2 else "instantiationToken": token,
             "description": f"{plant.rig}: {plant.description}", "generationTool": f"pycosim {__version__}",
             "variableNamingConvention": "structured", **AUTHORS}
    if fmi == 2:
        given["numberOfEventIndicators"] = str(plant.sizes["e"])
    return xml.Element("fmiModelDescription", given)


def _interface(root, fmi, kind, identifier, plant):
    state = "State" if fmi == 3 else "state"
    given = {"modelIdentifier": identifier, f"canGetAndSetFMU{state}": "true", f"canSerializeFMU{state}": "true"}
    if fmi == 2:
        given.update(providesDirectionalDerivative="true", canNotUseMemoryManagementFunctions="true")
    else:
        given.update(providesDirectionalDerivatives="true", providesAdjointDerivatives="true")
    if kind == "cs":
        given["canHandleVariableCommunicationStepSize"] = "true"
        if fmi == 2:
            given["canInterpolateInputs"] = "true"
        else:
            given["fixedInternalStepSize"] = repr(_step(plant))
        if not plant.sampled:
            given["maxOutputDerivativeOrder"] = "1"
        if fmi == 3 and not plant.sampled:
            given.update(providesIntermediateUpdate="true", canReturnEarlyAfterIntermediateUpdate="true")
    element = xml.SubElement(root, "CoSimulation" if kind == "cs" else "ModelExchange", given)
    if fmi == 2:
        xml.SubElement(xml.SubElement(element, "SourceFiles"), "File", name="fmi2.c")


def _units(root, plant):
    group = xml.SubElement(root, "UnitDefinitions")
    for unit in dict.fromkeys(e.variable.unit for e in plant.entries if not e.boolean):
        element = xml.SubElement(group, "Unit", name=unit)
        powers = units.exponents(unit)
        if powers is not None:
            base = {k: str(n) for k, n in powers.items()}
            if units.offset(unit):
                base["offset"] = repr(units.offset(unit))
            xml.SubElement(element, "BaseUnit", base)
        if units.display(unit):
            name, factor = units.display(unit)
            xml.SubElement(element, "DisplayUnit", name=name, factor=repr(factor))


def _types(root, plant, fmi):
    """Quantities under the names of the Modelica Standard Library, for units that have just one."""
    used = [u for u in dict.fromkeys(e.variable.unit for e in plant.entries if not e.boolean) if u in units.QUANTITIES]
    group = xml.SubElement(root, "TypeDefinitions") if used else None
    for unit in used:
        quantity = units.QUANTITIES[unit]
        given = {"quantity": quantity, "unit": unit}
        if units.display(unit):
            given["displayUnit"] = units.display(unit)[0]
        if fmi == 2:
            xml.SubElement(xml.SubElement(group, "SimpleType", name=_TYPE + quantity), "Real", given)
        else:
            xml.SubElement(group, "Float64Type", {"name": _TYPE + quantity, **given})


def _attributes(entry):
    """Attributes of a real variable that both versions share; Booleans have none of them."""
    v, given = entry.variable, {}
    if entry.boolean:
        return given
    if v.unit in units.QUANTITIES:
        given["declaredType"] = _TYPE + units.QUANTITIES[v.unit]
    given["unit"] = v.unit
    if units.display(v.unit):
        given["displayUnit"] = units.display(v.unit)[0]
    given.update({k: repr(float(getattr(v, k))) for k in ("min", "max") if math.isfinite(getattr(v, k))})
    if v.nominal not in (0.0, 1.0):
        given["nominal"] = repr(abs(float(v.nominal)))
    return given


def _common(number, entry):
    given = {"name": entry.name, "valueReference": str(value_reference(number))}
    if entry.variable.description:
        given["description"] = entry.variable.description
    given.update(causality=entry.causality, variability=entry.variability)
    if entry.initial:
        given["initial"] = entry.initial
    return given


def _start(entry):
    needed = entry.initial == "exact" or entry.causality == "input"
    return {"start": repr(float(entry.variable.value))} if needed else {}


def _variable2(group, number, entry):
    scalar = xml.SubElement(group, "ScalarVariable", _common(number, entry))
    derivative = {} if entry.state is None else {"derivative": str(value_reference(1 + entry.state))}
    xml.SubElement(scalar, "Boolean" if entry.boolean else "Real",
                   {**_attributes(entry), **_start(entry), **derivative})


def _variable3(group, number, entry, updated):
    derivative = {} if entry.state is None else {"derivative": str(value_reference(1 + entry.state))}
    marked = updated and entry.causality in ("input", "output") and not entry.boolean
    intermediate = {"intermediateUpdate": "true"} if marked else {}
    xml.SubElement(group, "Boolean" if entry.boolean else "Float64",
                   {**_common(number, entry), **intermediate, **_attributes(entry), **derivative, **_start(entry)})


def _unknowns(plant):
    """Numbers of outputs, of derivatives, and of what is computed at the start."""
    outputs = [k for k, e in enumerate(plant.entries) if e.causality == "output"]
    rates = [k for k, e in enumerate(plant.entries) if e.state is not None]
    initial = [k for k, e in enumerate(plant.entries) if e.initial == "calculated"
               and (k in rates or e.causality in ("output", "calculatedParameter"))]
    return outputs, rates, initial


def _structure2(structure, plant):
    outputs, rates, initial = _unknowns(plant)
    for name, numbers, which in (("Outputs", outputs, "depends"), ("Derivatives", rates, "depends"),
                                 ("InitialUnknowns", initial, "initially")):
        group = xml.SubElement(structure, name) if numbers else None
        for k in numbers:
            xml.SubElement(group, "Unknown", index=str(value_reference(k)),
                           dependencies=_known(plant.entries[k], which))


def _structure3(structure, plant):
    outputs, rates, initial = _unknowns(plant)
    margins = [k for k, e in enumerate(plant.entries) if e.name.endswith(".still_margin")]
    for name, numbers, which in (("Output", outputs, "depends"), ("ContinuousStateDerivative", rates, "depends"),
                                 ("InitialUnknown", initial, "initially"), ("EventIndicator", margins, "depends")):
        for k in numbers:
            xml.SubElement(structure, name, valueReference=str(value_reference(k)),
                           dependencies=_known(plant.entries[k], which))


def _known(entry, which):
    return " ".join(str(value_reference(n)) for n in getattr(entry, which))

"""A calibrated FMU in; parameter set, mapping, system and an FMU that starts from the fitted values, as files, out."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

from .. import __version__
from ..core.errors import CosimulationError
from ..export.fmu import write_archive

_COMMON = 'xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"'
_STRUCTURE = "SystemStructure.ssd"


def write_calibrated(fmu, calibration, folder):
    """Write ``calibrated.ssv``, ``.ssm``, ``.ssp`` and ``<fmu>_calibrated.fmu``.

    Parameters
    ----------
    fmu : path
        The file that was calibrated, left as it is.
    calibration : Calibration
        Its values become the start values.
    folder : path
        There already; files of these names are replaced.

    Returns
    -------
    list of str
        Names of the files.

    Raises
    ------
    CosimulationError
        The model description has no start value that could be replaced.
    """
    fmu, folder, fit = Path(fmu), Path(folder), calibration.fit
    fitted = {n: fit.parameters[n] for n in fit.free}
    values, mapping = _values(fit, fitted), _mapping(fitted)
    (folder / "calibrated.ssv").write_text(values, encoding="utf-8")
    (folder / "calibrated.ssm").write_text(mapping, encoding="utf-8")
    name = f"{fmu.stem}_calibrated.fmu"
    _with_starts(fmu, folder / name, fitted)
    files = {_STRUCTURE: _system(fmu, calibration).encode(), "resources/calibrated.ssv": values.encode(),
             "resources/calibrated.ssm": mapping.encode(), f"resources/{fmu.name}": fmu.read_bytes()}
    write_archive(folder / "calibrated.ssp", files, _STRUCTURE, _check)
    return ["calibrated.ssv", "calibrated.ssm", "calibrated.ssp", name]


def _check(path):
    """Hold a system against the standard's schemas, as fmpy carries them."""
    from fmpy.ssp.ssd import read_ssd
    read_ssd(path)


def _values(fit, fitted):
    lines = ['<?xml version="1.0" encoding="UTF-8"?>',
             f'<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" {_COMMON} '
             f'version="1.0" name="calibrated" generationTool="pycosim {__version__}">', "  <ssv:Parameters>"]
    for n, value in fitted.items():
        low, high = fit.interval(n)
        told = f"{fit.variables[n].description} (95 % interval {low:.6g} to {high:.6g})".strip()
        lines.append(f"    <ssv:Parameter name={quoteattr(n)} description={quoteattr(told)}>"
                     f'<ssv:Real value="{value!r}"/></ssv:Parameter>')
    return "\n".join([*lines, "  </ssv:Parameters>", "</ssv:ParameterSet>", ""])


def _mapping(fitted):
    """From the names in the set to those of the component ``model``."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>',
             '<ssm:ParameterMapping xmlns:ssm="http://ssp-standard.org/SSP1/SystemStructureParameterMapping" '
             f'{_COMMON} version="1.0">']
    lines += [f"  <ssm:MappingEntry source={quoteattr(n)} target={quoteattr(f'model.{n}')}/>" for n in fitted]
    return "\n".join([*lines, "</ssm:ParameterMapping>", ""])


def _system(fmu, calibration):
    """One component, its inputs and outputs at the border, the fitted values bound through the mapping."""
    border = [*((n, "input") for n in calibration.inputs), *((n, "output") for n in calibration.outputs)]

    def connectors(indent, names):
        lines = [f'{indent}  <ssd:Connector name={quoteattr(n)} kind="{kind}"><ssc:Real/></ssd:Connector>'
                 for n, kind in names]
        return [f"{indent}<ssd:Connectors>", *lines, f"{indent}</ssd:Connectors>"] if lines else []

    outside = [(re.sub(r"\W", "_", n), kind) for n, kind in border]
    lines = ['<?xml version="1.0" encoding="UTF-8"?>',
             '<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" '
             f'{_COMMON} version="1.0" name={quoteattr(fmu.stem)} generationTool="pycosim {__version__}">',
             '  <ssd:System name="calibrated">', *connectors("    ", outside), "    <ssd:ParameterBindings>",
             '      <ssd:ParameterBinding source="resources/calibrated.ssv">',
             '        <ssd:ParameterMapping source="resources/calibrated.ssm"/>', "      </ssd:ParameterBinding>",
             "    </ssd:ParameterBindings>", "    <ssd:Elements>",
             f'      <ssd:Component name="model" type="application/x-fmu-sharedlibrary" '
             f'source={quoteattr(f"resources/{fmu.name}")}>',
             *connectors("        ", border), "      </ssd:Component>", "    </ssd:Elements>", "    <ssd:Connections>"]
    for (n, kind), (name, _) in zip(border, outside):
        ends = [f"startConnector={quoteattr(name)}", f'endElement="model" endConnector={quoteattr(n)}']
        if kind == "output":
            ends = [f'startElement="model" startConnector={quoteattr(n)}', f"endConnector={quoteattr(name)}"]
        lines.append(f"      <ssd:Connection {' '.join(ends)}/>")
    return "\n".join([*lines, "    </ssd:Connections>", "  </ssd:System>", "</ssd:SystemStructureDescription>", ""])


def _with_starts(fmu, path, fitted):
    """The same FMU with other starts: nothing else in its description changes, nor any other file."""
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as new:
        for item in old.infolist():
            content = old.read(item)
            if item.filename == "modelDescription.xml":
                content = _restarted(content.decode("utf-8"), fitted, fmu.name).encode()
            new.writestr(item, content)


def _restarted(text, fitted, name):
    for n, value in fitted.items():
        own = re.escape(escape(n, {'"': "&quot;"}))
        # FMI 2: the start is in the element inside; FMI 3: in the variable's own
        pattern = (rf'(<(?:ScalarVariable|Float64)\b[^>]*?\bname="{own}"[^>]*?(?:>\s*(?:<!--.*?-->\s*)*<Real\b[^>]*?)?'
                   r'\bstart=")[^"]*(")')
        backward = rf'(<Float64\b[^>]*?\bstart=")[^"]*("[^>]*?\bname="{own}")'
        for p in (pattern, backward):
            text, count = re.subn(p, lambda m, v=value: f"{m[1]}{v!r}{m[2]}", text, count=1, flags=re.S)
            if count:
                break
        if not count:
            raise CosimulationError(f"{name}: the description gives '{n}' no start that could be replaced")
    return text

"""A study and its model in, an FMU out: description, sources, binaries, documentation, in one file."""

from __future__ import annotations

import os
import re
import tempfile
import zipfile
from pathlib import Path

from ..core.errors import ExportError
from . import xml
from .build import binaries
from .description import c_name, describe
from .document import to_html
from .modelica import to_modelica
from .reference import reference_results
from .source import WRAPPER, sources

# a name of structured convention, of those that there can be here: no quoted ones, no indices
_STRUCTURED = re.compile(r"(der\()?[A-Za-z_]\w*(\.[A-Za-z_]\w*)*(?(1)\))", re.ASCII)
_EPOCH = (1980, 1, 1, 0, 0, 0)  # of every file inside: the same input gives the same bytes


def export_fmu(study, model, folder, fmi=2, kinds=("cs", "me"), platforms="host"):
    """Write ``<study>_fmi2.fmu`` or ``<study>_fmi3.fmu``.

    Parameters
    ----------
    study : Study
        Its values become the start values.
    model : Model
        The compiled rig with the study's effects.
    folder : path
        Where the file goes.
    fmi : int
        2 or 3.
    kinds : sequence of str
        ``cs`` for co-simulation, ``me`` for model exchange, both in one file.
    platforms : str
        ``host``, or ``all`` for linux, windows and macOS.

    Returns
    -------
    Path

    Raises
    ------
    StudyError
        The rig cannot be simulated.
    ExportError
        The binary cannot be built, or the file cannot be written.
    """
    plant = describe(study, model)
    path = Path(folder) / f"{study.name}_fmi{fmi}.fmu"
    write_fmu(path, {**contents(plant, fmi, kinds, platforms), **reference_results(plant)})
    return path


def write_fmu(path, files):
    """Write an FMU whose description is valid, whole or not at all.

    Parameters
    ----------
    path : Path
        Ends in ``.fmu``; replaced where there is one.
    files : dict of str to bytes
        Of `contents`.

    Raises
    ------
    ExportError
        The description is not valid, or the file cannot be written.
    """
    write_archive(path, files, "modelDescription.xml", _validate)


def contents(plant, fmi=2, kinds=("cs", "me"), platforms="host"):
    """Files of an FMU by their path in it.

    Parameters
    ----------
    plant : Plant
        A machine, or a controller of `pycosim.export.controller.describe_block`.
    fmi : int
        2 or 3.
    kinds : sequence of str
        ``cs``, ``me``.
    platforms : str
        ``host`` or ``all``.

    Returns
    -------
    dict of str to bytes

    Raises
    ------
    ExportError
        A binary cannot be built.
    """
    identifier = c_name(plant.name)
    files, token = sources(plant, fmi, kinds)
    found = {"modelDescription.xml": xml.model_description(plant, fmi, kinds, identifier, token),
             "documentation/index.html": to_html(plant).encode(),
             "documentation/model.mo": to_modelica(plant).encode(),
             "documentation/licenses/license.txt": (WRAPPER / "license.txt").read_bytes(),
             **{f"sources/{name}": content for name, content in files.items()},
             **binaries(files, f"fmi{fmi}.c", identifier, fmi, platforms)}
    icon = (WRAPPER / "icon.png").read_bytes()
    if fmi == 2:
        found["model.png"] = icon
    else:
        found["sources/buildDescription.xml"] = xml.build_description(fmi, identifier)
        found["terminalsAndIcons/terminalsAndIcons.xml"] = xml.terminals(plant)
        found["terminalsAndIcons/icon.png"] = icon
        found["terminalsAndIcons/icon.svg"] = (WRAPPER / "icon.svg").read_bytes()
    return found


def write_archive(path, files, first, check):
    """Zip to a temporary name, check as an importer would, and rename.

    Parameters
    ----------
    path : Path
        Replaced only when the check has passed.
    files : dict of str to bytes
        By their path inside.
    first : str
        The file that comes first.
    check : callable
        Given the path; raises where an importer would complain.

    Raises
    ------
    ExportError
        The file cannot be written.
    """
    # not `core.whole`: an importer goes by the ending, and an archive is written part by part
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=path.suffix)
    try:
        with os.fdopen(handle, "wb") as stream, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in sorted(files, key=lambda n: (n != first, n)):
                info = zipfile.ZipInfo(name, _EPOCH)
                info.create_system, info.external_attr = 3, (0o755 if name.startswith("binaries/") else 0o644) << 16
                info.compress_type = zipfile.ZIP_DEFLATED
                archive.writestr(info, files[name])
        check(temporary)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except OSError as error:
        raise ExportError(f"{path}: cannot be written ({error.strerror}); name another folder with --out DIR") from None
    finally:
        Path(temporary).unlink(missing_ok=True)


def _validate(path):
    """Hold the description against the standard's schemas, as fmpy carries them; without it the tests must do.

    Names are held against the standard's grammar here: fmpy's own parser of it takes a second for two hundred of them.
    """
    try:
        from fmpy import read_model_description
        from fmpy.model_description import ValidationError
    except ImportError:
        return
    try:
        found = read_model_description(path, validate_model_structure=True)
        problems = [f"the name '{v.name}'" for v in found.modelVariables if not _STRUCTURED.fullmatch(v.name)]
    except ValidationError as error:
        problems = error.problems
    if problems:
        raise RuntimeError("the model description that was generated is not valid: " + "; ".join(problems))

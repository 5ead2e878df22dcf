"""A study's machine in; an FMU, C, Modelica or JSON that other tools take, out."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from ..core.errors import ExportError

__all__ = ["Export", "export"]


@dataclass(frozen=True)
class Export:
    """What an export made.

    Attributes
    ----------
    files : list of str
        Their names.
    description : dict
        Everything about the plant: variables, effects, structure; its ``files``, and the ``sentences`` below.
    lines : list of str
        What was written, and what must be said about it, in sentences.
    """

    files: list
    description: dict
    lines: list


def export(study, model, folder, to="fmu", fmi=2, kinds=("cs", "me"), platforms="host", real="double",
           self_contained=False):
    """Write a study's machine for another tool.

    Parameters
    ----------
    study : Study
        Its values and effects are taken as they are.
    model : Model
        Its compiled rig with effects, from ``study.validate``.
    folder : path
        Where the files go.
    to : str
        ``fmu``, ``c``, ``cpp``, ``modelica``, ``ssp``, ``mujoco``, ``mujoco-plugin``, ``jax`` or ``json``: the
        description alone, which callers write as ``export.json`` beside every export.
    fmi, kinds, platforms
        Of an FMU, see `pycosim.export.fmu.export_fmu`.
    real : str
        ``double`` or ``float``, of the C export.
    self_contained : bool
        Whether the Modelica export brings the classes of the library along.

    Returns
    -------
    Export

    Raises
    ------
    ExportError, StudyError
        The rig has no such export, a tool for it is missing, or an option does not fit.
    """
    from .description import c_name, describe, values
    from .document import to_dict
    if to == "c":
        from .c import export_c
        made = export_c(model, values(study, model), folder, c_name(study.name), real)
        files = [Path(f).name for f in made]
        lines = [f"C: {', '.join(files)}."]
        return Export(files, {"schema": 1, "name": study.name, "rig": study.rig, "files": files, "sentences": lines},
                      lines)
    plant = describe(study, model)
    description = to_dict(plant)
    made = _write(plant, study, model, Path(folder), to, fmi, kinds, platforms, self_contained)
    counts = {c: sum(e.causality == c for e in plant.entries) for c in ("input", "output", "parameter")}
    described = f"{counts['input']} inputs, {counts['output']} outputs, {counts['parameter']} parameters"
    unmeasured = sum(e.causality == "parameter" and e.variability == "tunable" and e.name not in plant.identified
                     for e in plant.entries)
    lines = [f"{made.text}: {', '.join(made.files)}, {described}.", *made.notes]
    if unmeasured:
        lines.append(f"Of its friction and effect parameters, {unmeasured} are the library's defaults, not the "
                     "study's: the documentation inside, and export.json, mark them.")
    return Export(made.files, {**description, "files": made.files, "sentences": lines}, lines)


@dataclass
class _Made:
    """What it is, its files, and what must be said about it."""

    text: str
    files: list
    notes: list = field(default_factory=list)


def _write(plant, study, model, folder, to, fmi, kinds, platforms, self_contained):
    """Write the files of a target."""
    if to == "fmu":
        from .fmu import export_fmu
        return _Made(f"FMU for FMI {fmi}.0", [export_fmu(study, model, folder, fmi, kinds, platforms).name])
    if to == "ssp":
        from .ssp import control_parts, export_ssp
        parts, wires, missing = control_parts(study, model, fmi, platforms)
        path = export_ssp(study, model, folder, fmi, platforms, parts, wires)
        names = ", ".join(["plant", *(p.name for p in parts)])
        return _Made(f"SSP with FMUs for FMI {fmi}.0 ({names})", [path.name], [f"In the SSP: {m}" for m in missing])
    if to == "mujoco":
        from .mujoco import to_mjcf
        text, missing = to_mjcf(plant)
        files = [_text(folder / f"{study.name}.xml", text),
                 _text(folder / f"{study.name}_not_in_mujoco.txt", "\n".join([*missing, ""]))]
        return _Made("MJCF", files, [f"Not in MuJoCo: {m}" for m in missing])
    if to == "mujoco-plugin":
        return _plugin(plant, study, model, folder)
    if to == "cpp":
        from .cpp import cpp_source
        from .description import c_name, values
        name = c_name(study.name)
        return _Made("C++", [_text(folder / f"{name}.hpp", cpp_source(model, values(study, model), name))])
    if to == "jax":
        from .description import c_name, values
        from .jax_drive import jax_source
        from .law import drive_law
        text = jax_source(drive_law(model, values(study, model)), study.name)
        return _Made("JAX", [_text(folder / f"{c_name(study.name)}_drive.py", text)])
    if to == "modelica":
        from .modelica import to_modelica
        return _Made("Modelica", [_text(folder / f"{study.name}.mo", to_modelica(plant, self_contained))])
    if to == "json":
        return _Made("JSON", ["export.json"])
    raise ExportError(f"no target '{to}'; there are fmu, c, cpp, modelica, ssp, mujoco, mujoco-plugin, jax, json")


def _plugin(plant, study, model, folder):
    """The drive as a plugin, and the bodies that it moves as MJCF."""
    from .description import c_name, values
    from .law import drive_law
    from .mujoco import to_mjcf
    from .mujoco_plugin import build_plugin, mujoco_folder, plugin_name, plugin_source
    law, name = drive_law(model, values(study, model)), c_name(study.name)
    source = plugin_source(law, name)
    text, missing = to_mjcf(plant, (plugin_name(name), law.inputs))
    files = [_text(folder / f"{study.name}.xml", text), _text(folder / f"{name}_drive.c", source)]
    notes = [f"Not in MuJoCo: {m}" for m in missing]
    if mujoco_folder():
        file, content = build_plugin(source, f"{name}_drive")
        (folder / file).write_bytes(content)
        files.append(file)
    else:
        notes.append("MuJoCo is not installed here, so the plugin is source alone: its first lines say how to compile.")
    return _Made("Plugin for MuJoCo", files, notes)


def _text(path, text):
    path.write_text(text, encoding="utf-8")
    return path.name

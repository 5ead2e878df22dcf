"""A rig's name, a Modelica file or a log in; a commented study to start from out."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

from ..core.errors import UnknownNameError, closest
from .parser import UsageError

# --- new ---------------------------------------------------------------------------------------------------


def new(arguments):
    """Write a commented study for a rig; with logs, for their columns as well.

    Parameters
    ----------
    arguments : argparse.Namespace
        ``rig``, ``data``, ``columns``, ``rate``, ``si``, ``without``, ``out``.

    Returns
    -------
    path : Path
    lines : list of str
        What was done, and what comes next.

    Raises
    ------
    UnknownNameError
        No such rig, or no such log.
    UsageError
        The log does not tell all, and nobody is there to ask.
    DataError
        A log cannot be read.
    FolderError
        The study is there already, or cannot be written.
    """
    from ..compile import Library
    from .mapping import mapped, refuse_unused, rig_by_log, told
    if not arguments.data:
        refuse_unused(arguments)
    if not arguments.rig and not arguments.data:
        raise UsageError("RIG is missing; name one, as HipKnee, or give --data FILE, a log whose columns tell it")
    for file in arguments.data or []:
        if not Path(file).is_file():
            raise UnknownNameError(f"no log {file}")
    own = [arguments.rig] if (arguments.rig or "").endswith(".mo") else []
    library = Library(own)
    rig = (own_rig(library, arguments.rig) if own else find_rig(library, arguments.rig) if arguments.rig
           else rig_by_log(library, arguments, sys.stdin))
    folder = Path(arguments.out or ".")
    path = folder / f"{rig.rsplit('.', 1)[-1]}.toml"
    refuse_taken(path)
    proposal = mapped(library, rig, arguments, sys.stdin) if arguments.data else None
    runs, own = ([os.path.relpath(f, folder) for f in files] for files in (arguments.data or [], own))
    write(path, "\n".join(template(library, rig, runs, own, proposal)) + "\n", library)
    if proposal is None:
        return path, [f"Written: {path}. Say which columns your log has, then: pycosim improve {path} --data "
                      "my_log.csv"]
    return path, [*told(proposal), f"Written: {path}. Next: pycosim check {path}, then: pycosim improve {path}",
                  *draw(proposal, path)]


def draw(proposal, path):
    """A picture of each mapped column beside the study: a wrong column is seen sooner than read.

    Parameters
    ----------
    proposal : Proposal
        Its sample is drawn.
    path : Path
        The study.

    Returns
    -------
    list of str
        Where it is.
    """
    from ..report import figures, preview
    plot = preview.columns(proposal)
    if plot is None:
        return []
    name = f"{path.stem}_columns"
    figures.save(plot, path.parent, name, ("png",))
    return [f"A picture of each column: {path.parent / name}.png"]


def refuse_taken(path):
    """Refuse to write over a study.

    Parameters
    ----------
    path : Path
        Of the study that would be written.

    Raises
    ------
    FolderError
        Something has that name.
    """
    from ..report.folder import FolderError
    if os.path.lexists(path):
        raise FolderError(f"{path}: exists already, and is not overwritten; move it, or name a folder with --out DIR")


def write(path, text, library):
    """Write a study, or leave nothing behind.

    Parameters
    ----------
    path : Path
        Of the study; folders that are missing are made.
    text : str
        Of the study, TOML.
    library : Library
        What it names is checked against.

    Raises
    ------
    FolderError
        The file or its folder cannot be made.
    PycosimError
        The study does not hold.
    """
    from ..core.whole import write_whole
    from ..report.folder import FolderError
    from ..study.parse import load_study
    made, folder = [], path.parent
    try:
        for parent in [*reversed(folder.absolute().parents), folder.absolute()]:
            if not parent.is_dir():
                parent.mkdir()
                made.insert(0, parent)
        write_whole(path, text, lambda written: load_study(written).validate(library))
    except BaseException as error:
        for parent in made:
            parent.rmdir()
        if isinstance(error, OSError):
            raise FolderError(f"{path}: cannot be written ({error.strerror}); name a folder with --out DIR") from None
        raise


def find_rig(library, name):
    """Full name of a rig, from its full or its short name.

    Parameters
    ----------
    library : Library
        Holds the rigs, the user's own file among them.
    name : str
        As ``HipKnee`` or ``DriveTrain.Rigs.HipKnee``.

    Returns
    -------
    str

    Raises
    ------
    UnknownNameError
        There is none; the nearest is named.
    """
    from ..study.template import rigs
    known = rigs(library)
    if name in known or name in known.values():
        return known.get(name, name)
    raise UnknownNameError(f"no rig '{name}'{closest(name.rsplit('.', 1)[-1], known)}")


def own_rig(library, file):
    """The class of a user's file that answers what a fit asks.

    Parameters
    ----------
    library : Library
        With the file.
    file : str
        Of Modelica, as the user named it.

    Returns
    -------
    str

    Raises
    ------
    UnknownNameError
        None, or several.
    """
    from ..compile.effects import annotation
    found = [n for n in library.walk() if not n.startswith("DriveTrain.") and "estimate" in annotation(library, n)]
    if len(found) == 1:
        return found[0]
    what = f"the rigs {', '.join(found)}; keep one in a file" if found else (
        'no rig: no class with annotation(__pycosim(estimate="what is measured from what is known"))')
    raise UnknownNameError(f"{file} holds {what}")


def template(library, rig, runs, modelica=(), proposal=None):
    """Lines of a commented study for a rig.

    Parameters
    ----------
    library : Library
        Holds the rigs, the user's own file among them.
    rig : str
        Full name.
    runs : list of str
        Logs, relative to the study.
    modelica : sequence of str
        Modelica files of the user, relative to the study.
    proposal : Proposal, optional
        What the columns of the logs are; the rig's names stand for them without it.

    Yields
    ------
    str
        A line without its end.
    """
    from ..compile import compile_model
    from ..study.schema import MOST
    from ..study.template import first_parameters
    from ..study.toml import to_toml
    model = compile_model(library, rig)
    wanted, known = model.alternatives("estimate")[0]
    question = model.question("estimate")
    yield f"# {library.find(rig).comment.strip(chr(34))}" if library.find(rig).comment else f"# {rig}"
    yield f"# Next: pycosim improve {rig.rsplit('.', 1)[-1]}.toml{'' if runs else ' --data my_log.csv'}"
    yield f"\n[rig]\nmodel = {to_toml(rig)}"
    if modelica:
        yield f"modelica = {to_toml(list(modelica))}"
    yield "\n[parameters]                 # SI units; fixed = false is fitted, the others are the rig's defaults"
    open_ones = first_parameters(model, question)
    for name in [*open_ones, *sorted(set(question.parameters) - set(open_ones))]:
        p = model.parameters[name]
        fixed = name not in open_ones
        bounds = "".join(f", {k} = {to_toml(v)}" for k, v in (("min", p.min), ("max", p.max)) if abs(v) != float("inf"))
        line = f"{to_toml(name)} = {{ value = {to_toml(p.value)}{bounds}, fixed = {to_toml(fixed)} }}"
        yield f"{'# ' if fixed else ''}{line}  # {p.unit}; {p.description or name}"
    yield from _limit_lines(model, proposal)
    yield "\n[data]"
    yield f"runs = {to_toml(runs)}                    # logs; or --data FILE..."
    yield "held_out = []                # logs kept for the test"
    yield 'reference = "unknown"        # of the joint torques: "sensor", "gravity_model" (computed), "unknown"'
    settings = {} if proposal is None else proposal.settings
    for key, value in settings.items():
        yield f"{key} = {to_toml(value)}"
    for key, line in _data_lines(MOST):
        if key not in settings:
            yield line
    yield "\n[columns]                    # left: the column in your log, right: what it is, and its unit there"
    yield from _column_lines(model, wanted, known) if proposal is None else _mapped_lines(model, proposal)
    for line in _other_columns(known):
        yield f"# {line}"
    yield from _effect_lines(library, rig)


def _effect_lines(library, rig):
    """Lines of a study that say which effects there are, and where."""
    from ..compile import catalogue, places
    yield "\n# Effects, to be added by hand or found by 'pycosim improve':"
    yield '# [[effects]]\n# effect = "viscous"\n# place = ".."'
    for effect in catalogue(library).values():
        found = [p.name for p in places(library, rig, effect)]
        if found:
            yield f"#   {effect.id}: {effect.description}; at {', '.join(found)}"


def _limit_lines(model, proposal):
    """What the motors are rated for, or lines for who knows it later."""
    from ..data.proposal import ratings
    from ..study.toml import to_toml
    told = {} if proposal is None else proposal.rated
    known = ratings(model)
    if known:
        mark = "" if told else "# "
        yield f"\n{mark}[limits]                     # what motors are rated for; effects are told in percent of it"
    for name, (unit, words) in known.items():
        most = to_toml(told[name]) if name in told else ".."
        yield f"{'' if name in told else '# '}{to_toml(name)} = {{ max = {most} }}  # {unit}, {words}"


def _data_lines(most):
    """Keys of [data] that a study may need, and lines that say what they are for."""
    yield "drop_outs", '# drop_outs = "skip"         # leave rows with missing numbers out, rather than refuse the log'
    yield "most", f"# most = {most:_}            # a log with more rows is read as means of consecutive ones"
    yield "rate", '# rate = 500                  # samples a second, of a log without a column of time'
    yield "header", '# header = false              # columns have no names; they are called "1", "2", ..'
    yield "leave_out", '# leave_out = [[3.1, 3.4]]   # not compared there, s; ["run.csv", 3.1, 3.4] for one log'
    yield "time", '# time = [0.0, 60.0]          # only this part of each log, s'


def _column_lines(model, wanted, known):
    """Columns named as the rig's variables, for whoever has no log yet."""
    from ..study.toml import to_toml
    speeds = [f"{n[:-4]}.w" for n in known if n.endswith(".phi") and f"{n[:-4]}.w" in model.variables]
    for name, role in [*((n, "needed") for n in known), *((n, "optional; else derived from the angle") for n in speeds),
                       *((n, "what the model is compared with") for n in wanted)]:
        v = model.variables[name]
        yield (f"{to_toml(name)} = {{ variable = {to_toml(name)}, unit = {to_toml(v.unit)} }}"
               f"  # {v.description or name}; {role}")


def _mapped_lines(model, proposal):
    """Columns of a log, as they were proposed and answered."""
    from ..data.checks.finding import column_line
    for name, column in proposal.columns.items():
        v = model.variables.get(column.variable)
        yield f"{column_line(name, column)}  # {v.description if v and v.description else column.variable}"


def _other_columns(known):
    """Lines for what a log may hold otherwise."""
    torque = next((n for n in known if n.endswith(".tau")), None)
    if torque:
        yield (f'"current" = {{ variable = {json.dumps(torque)}, unit = "A", k_m = 0.1 }}'
               "  # instead of a torque; k_m [N.m/A]")
    yield '"time" = { variable = "time", unit = "ms" }  # when the time is not in s'
    yield '"temperature" = { variable = "temperature", unit = "degC" }  # optional'

"""The program and the Modelica library in; the reference pages of the site, generated as it is built, out.

A hook of MkDocs (see mkdocs.yml). Nothing here is written twice: what the pages say stands in the parser of the command
line, in docstrings, and in the Modelica files. What has no description there stops the build.
"""

from __future__ import annotations

import html
import inspect
import os
import pkgutil
import re
from pathlib import Path

from mkdocs.structure.files import File

import pycosim
from pycosim import cli
from pycosim.cli import new, parser
from pycosim.compile import Library, catalogue, compile_model, places
from pycosim.compile.effects import annotation
from pycosim.compile.parse import LIBRARY
from pycosim.report.schematic import schematic
from pycosim.study import schema

ROOT = Path(__file__).resolve().parents[1]
RIG = "DriveTrain.Rigs.HipKnee"
EXAMPLES = {"Barrier": "examples/barrier/Barrier.mo",  # rigs of users' own, by the file that holds them
            "DoublePendulum": "examples/double_pendulum/DoublePendulum.mo"}
COLUMN = 800  # of the site's text [px]; a longer drive train is drawn from top to bottom
# the colours of the site, in its light and in its dark scheme
COLOURS = ("--paper: var(--md-default-bg-color); --muted: var(--md-default-fg-color--light); "
           "--bad: var(--md-accent-fg-color); overflow-x: auto")
MODELICA = ("Components", "Effects", "Rigs", "Examples", "Interfaces", "UsersGuide")
# Where the docstring of `Study` has a key under another name than the file
NAMED = {"model": "rig", "label": "labels"}


# --- hooks ----------------------------------------------------------------------------------------------------------


def on_files(files, config):
    """Add the generated pages, and fill the navigation's folders."""
    library = Library()
    for path, text in pages(library):
        files.append(File.generated(config, path, content=text))
    config.nav = _filled(config.nav, sorted(f.src_uri for f in files.documentation_pages()))
    return files


def on_page_markdown(markdown, page, config, files):
    """A link to a file of the project that is no page becomes its name: the site is not served beside the sources."""
    def plain(match):
        target = match[2].partition("#")[0]
        path = os.path.normpath(Path(page.file.src_uri).parent / target)
        outside = path.startswith("..") and (Path(config.docs_dir) / path).exists()
        return f"`{os.path.normpath(Path('docs') / path)}`" if outside else match[0]
    return re.sub(r"(?<!!)\[([^]]*)\]\(([^)\s]+)\)", plain, markdown)


def _filled(nav, paths):
    """Navigation with each ``folder/`` replaced by what is in that folder and not listed beside it."""
    def listed(items):
        for item in items:
            target = next(iter(item.values())) if isinstance(item, dict) else item
            yield from listed(target) if isinstance(target, list) else [target]

    named = set(listed(nav))

    def fill(items):
        for item in items:
            if isinstance(item, dict):
                yield {t: list(fill(v)) if isinstance(v, list) else v for t, v in item.items()}
            elif item.endswith("/"):
                yield from (p for p in paths if p.rpartition("/")[0] + "/" == item and p not in named)
            else:
                yield item

    return list(fill(nav))


def pages(library):
    """Every generated page.

    Parameters
    ----------
    library : Library

    Yields
    ------
    path : str
        Within the site's sources.
    text : str
        Markdown.
    """
    yield "reference/command-line.md", "\n".join(_command_line())
    yield "reference/study.md", "\n".join(_study(library))
    yield "reference/effects.md", "\n".join(_effects(library))
    yield "reference/rigs.md", "\n".join(_rigs())
    for package in MODELICA:
        yield f"reference/modelica/{package.lower()}.md", "\n".join(_package(library, package))
    for module in modules():
        yield f"reference/python/{module.removeprefix('pycosim.')}.md", f"# {module}\n\n::: {module}\n"


def modules():
    """Names of the package's public modules.

    Returns
    -------
    list of str
    """
    found = pkgutil.walk_packages(pycosim.__path__, "pycosim.")
    return sorted(m.name for m in found if not any(part.startswith("_") for part in m.name.split(".")))


# --- command line ---------------------------------------------------------------------------------------------------


def _command_line():
    """Every verb with its help, as the program prints it."""
    os.environ["COLUMNS"] = "100"  # argparse asks the terminal otherwise
    program = parser.build_parser()
    yield "# Command line\n"
    yield f"```text\n{program.format_help().strip()}\n```"
    yield "\nExit codes: " + cli.__doc__.partition("Exit codes: ")[2].partition("\n")[0]
    subs = next(a for a in program._actions if a.dest == "verb").choices
    for verb, sub in subs.items():
        main = parser.VERBS[verb][1]
        yield f"\n## {verb}\n\n{sub.description}\n\n```text\n{sub.format_help().strip()}\n```"
        if main:
            yield f"\n`--json` prints `{main}`."


# --- study file -----------------------------------------------------------------------------------------------------


def _attributes(cls):
    """Attributes of a numpydoc docstring: name to (type, description)."""
    found = {}
    section = inspect.getdoc(cls).partition("Attributes\n----------\n")[2]
    for head, body in re.findall(r"^(\w[\w, ]*) : (.*(?:\n    .*)*)", section, re.M):
        kind, _, text = body.partition("\n")
        for name in head.split(", "):
            found[name] = kind, " ".join(text.split())
    return found


def _keys(title, table, keys, attributes, note=""):
    """A table of the file, key by key."""
    yield f"\n## {title}\n\n{note}\n\n| key | value | meaning |\n|---|---|---|"
    for key in keys:
        name = NAMED.get(key, key)
        if name not in attributes:
            raise LookupError(f"the key '{key}' of {table} has no description in the docstrings of pycosim.study")
        kind, text = attributes[name]
        yield f"| `{key}` | {_cell(kind)} | {_cell(text)} |"


def _study(library):
    """Tables and keys of a study file, and the study that ``pycosim new`` writes."""
    whole, setting, column = (_attributes(c) for c in (schema.Study, schema.Setting, schema.Column))
    yield ("# Study file\n\nA study is a TOML file; paths in it are relative to it. A key that nothing "
           "reads is refused, with the nearest one that is. Top-level tables: "
           + ", ".join(f"`[{t}]`" for t in schema.TABLES) + ".")
    yield from _keys("[rig]", "[rig]", schema.RIG_KEYS, whole)
    yield from _keys("[parameters]", "[parameters]", schema.SETTING_KEYS, setting,
                     "One entry a parameter of the rig: `\"s1A.f0\" = { value = 0.05, fixed = false }`.")
    yield from _keys("[data]", "[data]", schema.DATA_KEYS, whole,
                     f"`{'`, `'.join(schema.TOP_KEYS)}` may stand at the top of the file as well. References: "
                     f"`{'`, `'.join(schema.REFERENCES)}`; drop-outs: `{'`, `'.join(schema.DROP_OUTS)}`; readers that "
                     f"no ending of a file names: `{'`, `'.join(schema.READERS)}`.")
    yield from _keys("[fit]", "[fit]", schema.FIT_KEYS, whole)
    yield from _keys("[columns]", "[columns]", schema.COLUMN_KEYS, column,
                     "One entry a column of the log: `tau1 = { variable = \"motor1.tau\", unit = \"N.m\" }`. Besides "
                     f"the rig's variables: `{'`, `'.join(schema.LOG_VARIABLES)}`.")
    yield ("\n## [[effects]]\n\nOne table an effect: `effect`, its name, and `place`, where it acts "
           "([effects](effects.md)).")
    documented = {"rig", "parameters", "data", "fit", "columns", "effects"}
    for table in [t for t in schema.TABLES if t not in documented]:
        kind, text = whole[table]
        yield f"\n## [{table}]\n\n{text}"
    text = "\n".join(new.template(library, RIG, ["run1.csv"]))
    yield f"\n## A study to start from\n\nWhat `pycosim new HipKnee` writes, with a log in it:\n\n```toml\n{text}\n```"


# --- Modelica -------------------------------------------------------------------------------------------------------


def _package(library, package):
    """Every class of a package of the library."""
    folder = LIBRARY / "DriveTrain" / package
    yield f"# {package}\n\n{_described(folder / 'package.mo')}.\n"
    for path in sorted(folder.glob("*.mo")):
        if path.stem != "package":
            yield from _class(path)


def _described(path):
    """Description in the head of a Modelica file."""
    return re.search(r'^(?:partial )?(?:\w+) \w+ "([^"]+)"', path.read_text(encoding="utf-8"), re.M)[1]


def _class(path):
    """A class: what it is, its members with units and bounds, its equations, its documentation."""
    text = path.read_text(encoding="utf-8")
    head = re.search(r"^((?:partial )?\w+) (\w+) ", text, re.M)
    yield f"\n## {head[2]} {{ #{head[2]} }}\n\n{_described(path)}. *{head[1]}*"
    for s in _statements(text):
        if "extends " in s:
            yield f"\nExtends `{s[s.index('extends ') + 8:]}`."
    members = [m for m in map(_member, _statements(text)) if m]
    if members:
        yield "\n| | name | unit | default | bounds | meaning |\n|---|---|---|---|---|---|"
        for kind, name, unit, default, bounds, meaning in members:
            yield f"| {_cell(kind)} | `{name}` | {_cell(unit)} | {_code(default)} | {bounds} | {_cell(meaning)} |"
    equations = re.search(r"^equation\n(.*?)(?=^  annotation|^end )", text, re.M | re.S)
    if equations:
        yield f"\n```modelica\n{equations[1].rstrip()}\n```"
    documentation = re.search(r'info="<html>\n(.*?)</html>"', text, re.S)
    if documentation:
        plain = re.sub(r"(</?)h[1-6]>", r"\1strong>", documentation[1])  # its headings are none of the page's
        yield f"\n<div>\n{plain}</div>"


def _statements(text):
    """What a file declares, one string each."""
    before = re.split(r"\n(?:equation|  annotation|end )", text)[0]
    return [" ".join(s.removeprefix("protected").split()) for s in re.split(r";(?:\n|$)", before)]


def _member(statement):
    """Kind, name, unit, default, bounds and description of a declaration; None for anything else."""
    statement = re.sub(r'^(?:within [\w.]+; )?(?:partial )?(?:model|connector|class) \w+ "[^"]*" ', "", statement)
    found = re.match(r'((?:parameter |input |output |flow )*)([A-Z][\w.]*) (\w+)(.*?)"([^"]+)"$', statement)
    if not found:
        return None
    prefix, kind, name, rest, meaning = found.groups()
    inside, default = _brackets(rest)
    given = dict(re.findall(r'\b(unit|min|max)=("[^"]*"|[-+.\w]+)', inside))
    if kind != "Real":
        prefix, default = kind, inside or default
    bounds = f"{given['min']} to {given['max']}" if {"min", "max"} <= set(given) else ""
    return prefix.strip() or "variable", name, given.get("unit", "").strip('"'), default.lstrip("= "), bounds, meaning


def _brackets(rest):
    """What stands between the outer brackets after a name, and what follows them."""
    rest = rest.strip()
    if not rest.startswith("("):
        return "", rest
    depth = 0
    for k, character in enumerate(rest):
        depth += (character == "(") - (character == ")")
        if depth == 0:
            return rest[1:k], rest[k + 1:].strip()
    raise LookupError(f"brackets do not match in {rest}")


# --- effects --------------------------------------------------------------------------------------------------------


def _effects(library):
    """Every effect: what it is, its equation, its coefficients, its places in the hip-knee rig, its signature."""
    yield ("# Effects\n\nEvery effect that `diagnose` looks for or that `add` adds by name, from the files in "
           "`modelica/DriveTrain/Effects`. What is behind them: [effects explained](../explanation/effects.md). A "
           "picture shows what the effect changes in a joint's torque or an encoder's reading, over the variable it "
           "shows in; blue on the way out, red back.\n")
    for effect in catalogue(library).values():
        path = LIBRARY / (effect.model.replace(".", "/") + ".mo")
        text, notes = path.read_text(encoding="utf-8"), annotation(library, effect.model)
        yield f"\n## {effect.id}\n\n{effect.description}."
        yield f"\n```modelica\n{re.search(r'extends (Interfaces[^;]+);', text)[1]}\n```"
        yield "\n| coefficient | unit | default | bounds | meaning |\n|---|---|---|---|---|"
        for member in map(_member, _statements(text)):
            if member and member[0] == "parameter":
                _, name, unit, default, bounds, meaning = member
                yield f"| `{name}` | {unit} | {_code(default)} | {bounds} | {_cell(meaning)} |"
        where = [p.name for p in places(library, RIG, effect)]
        yield f"\n- Places in the hip-knee rig: {', '.join(f'`{p}`' for p in where)}."
        if effect.measured:
            yield f"- Reads from the log: {', '.join(f'`{n}` [{u}]' for n, u in effect.measured.items())}."
        if effect.by_name:
            yield f"- Added by its name, in no ranking: {effect.by_name}."
        yield f"- To see it: {notes['experiment']}."
        yield f"- Equations: [{path.stem}](modelica/effects.md#{path.stem})."
        yield (f"\n![Signature of {effect.id}: {effect.description[0].lower()}{effect.description[1:]}]"
               f"(../images/effects/{effect.id}.png)")


# --- rigs -----------------------------------------------------------------------------------------------------------


def _rigs():
    """Every rig: what it is, its drawing, its places."""
    yield ("# Rigs\n\nThe machines of the library, and those of the examples, drawn from their connections: power runs "
           "from the motors on, hatching is what stands still, dashed lines are what a part is carried by. The names "
           "are the places of effects. `pycosim.report.schematic` draws any rig like this, and a report marks what is "
           "missing.\n")
    library = Library([ROOT / path for path in EXAMPLES.values()])
    rigs = [n for n in library.walk() if n.startswith("DriveTrain.Rigs.")]
    for rig in [*rigs, *EXAMPLES]:
        model = compile_model(library, rig)
        found = {p.name for effect in catalogue(library).values() for p in places(library, rig, effect)}
        yield f"\n## {rig.rpartition('.')[2]}\n\n{str(library.find(rig).comment).strip(chr(34))}."
        drawing = schematic(model)
        if int(re.search(r'viewBox="0 0 (\d+)', drawing)[1]) > COLUMN:
            drawing = schematic(model, down=True)
        yield f"\n<div style=\"{COLOURS}\">{drawing}</div>"
        yield f"\nPlaces: {', '.join(f'`{name}`' for name in sorted(found))}. Class: `{rig}`."


def _cell(text):
    """Text within a table."""
    return html.escape(text, quote=False).replace("|", "\\|")


def _code(text):
    """Code within a table, or nothing."""
    return "`" + text.replace("|", "\\|") + "`" if text else ""

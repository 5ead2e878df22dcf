"""Claims about the source: modules depend one way, lines fit, and public names are documented."""

import ast
import doctest
import importlib
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "pycosim"
SOURCES = [ROOT / f for f in subprocess.run(["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.py"],
                                            cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
           if (ROOT / f).exists()]
ONLY = {"pymoca": {"compile"}, "antlr4": {"compile"}, "argparse": {"cli"}, "matplotlib": {"report"},
        "nicegui": {"app"}, "plotly": {"report"}, "fmpy": {"cosim", "export"}, "fmpy.simulation": {"cosim"},
        "fmpy.simulate_fmu": {"cosim"}}


def module(path):
    """Module or subpackage of pycosim that a file belongs to."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


@cache
def imports():
    """For every module: modules of pycosim, and names from elsewhere, that it imports anywhere."""
    inner, outer = {}, {}
    for path in sorted(PACKAGE.rglob("*.py")):
        name, depth = module(path), len(path.relative_to(PACKAGE).parts)
        here, there = inner.setdefault(name, set()), outer.setdefault(name, set())
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.level == depth:
                here |= {node.module.split(".")[0]} if node.module else {a.name for a in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                there |= {f"{node.module}.{a.name}" for a in node.names}
            elif isinstance(node, ast.Import):
                there |= {a.name for a in node.names}
    return {n: found & set(inner) - {n} for n, found in inner.items()}, outer


def test_the_imports_are_read():
    inner, outer = imports()
    assert {"compile", "data", "fit"} <= inner["diagnosis"] and "matplotlib.figure.Figure" in outer["report"]
    assert "pymoca" in outer["compile"] and {"compile", "core"} <= inner["study"]


def test_rooms_know_only_those_below_them():
    done = subprocess.run([Path(sys.executable).with_name("lint-imports")], cwd=ROOT, capture_output=True, text=True)
    assert not done.returncode, done.stdout


def borrowed(path):
    """Private names that a file takes from modules of other rooms, imported or as an attribute."""
    tree, depth = ast.parse(path.read_text(encoding="utf-8")), len(path.relative_to(PACKAGE).parts)
    taken = {a.asname or a.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.level == depth
             for a in node.names}
    used = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name) and node.value.id in taken}
    return {n for n in taken | used if n.startswith("_") and not n.startswith("__")}


def test_no_private_name_is_used_in_another_room():
    assert not {str(p.relative_to(PACKAGE)): names for p in PACKAGE.rglob("*.py") if (names := borrowed(p))}


@pytest.mark.parametrize("package", ONLY)
def test_some_packages_have_one_door(package):
    _, outer = imports()
    assert {n for n, found in outer.items() if any(f"{name}.".startswith(f"{package}.") for name in found)} <= ONLY[
        package]


def test_no_plot_is_drawn_outside_report():
    library = re.compile(r"^\s*(from|import) (matplotlib|plotly|pylab|seaborn)\b", re.M)
    drawn = [str(p.relative_to(ROOT)) for p in SOURCES if library.search(p.read_text(encoding="utf-8"))
             and not any(p.is_relative_to(room) for room in (PACKAGE / "report", ROOT / "tests"))]
    assert not drawn


def test_what_a_plot_shows_is_described_without_a_library():
    here = PACKAGE / "report"
    libraries = {p.name for p in here.glob("*.py") if "matplotlib" in p.read_text(encoding="utf-8").replace(
        "matplotlib.axes.Axes", "").replace("matplotlib.figure.Figure", "")}
    assert libraries == {"figures.py"} and "plotly" not in (here / "drawings.py").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_lines_fit(path):
    long = [k for k, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1) if len(line) > 120]
    assert not long


# --- docstrings


def public(path):
    """Public functions, classes and methods of a file, with their dotted names."""
    def walk(node, prefix):
        for child in node.body:
            if isinstance(child, (ast.FunctionDef, ast.ClassDef)) and not child.name.startswith("_"):
                yield prefix + child.name, child
                if isinstance(child, ast.ClassDef):
                    yield from walk(child, f"{prefix}{child.name}.")
    return walk(ast.parse(path.read_text(encoding="utf-8")), "")


def gives(function):
    """Section that a function's result belongs to, or None where it gives nothing."""
    own, todo = [], list(function.body)
    while todo:  # what inner functions return is theirs
        node = todo.pop()
        own.append(node)
        if not isinstance(node, (ast.FunctionDef, ast.Lambda)):
            todo += ast.iter_child_nodes(node)
    if any(isinstance(node, (ast.Yield, ast.YieldFrom)) for node in own):
        return "Yields"
    return "Returns" if any(isinstance(node, ast.Return) and node.value is not None for node in own) else None


def lacking(node):
    """What a docstring lacks."""
    text = ast.get_docstring(node)
    if not text:
        return ["docstring"]
    if isinstance(node, ast.ClassDef) or "; see `pycosim." in text:  # the one protocol of the readers is told once
        return []
    attribute = any(isinstance(d, ast.Name) and "property" in d.id for d in node.decorator_list)
    taken = [a.arg for a in (*node.args.args, *node.args.kwonlyargs) if a.arg not in ("self", "cls")]
    told = re.split(r"\n\w+\n-+\n", text.partition("Parameters\n----------\n")[2])[0]
    named = set(re.findall(r"\*{0,2}(\w+)", " ".join(re.findall(r"^\*?[\w, *]+(?= :|$)", told, re.M))))
    lacks = [f"parameter {a}" for a in taken if a not in named]
    section = None if attribute else gives(node)
    return lacks + ([section] if section and f"{section}\n-" not in text else [])


def unsaid(node):
    """Entries of a docstring that name a thing and its type, and say nothing of it.

    What is returned may be told by the docstring's first line.
    """
    lines, section, found = (ast.get_docstring(node) or "").splitlines(), None, []
    for line, below in zip(lines, [*lines[1:], ""]):
        if re.fullmatch(r"-{3,}", below):
            section = line
        elif section in ("Parameters", "Attributes", "Raises", "Yields") and re.match(r"[^\s-]", line):
            found += [] if below.startswith("    ") else [line]
    return found


def test_an_entry_without_a_sentence_is_seen():
    text = "One.\n\nParameters\n----------\na : int\nb : int\n    Said.\n\nReturns\n-------\nint\n\nRaises\n------\nE\n"
    node = ast.parse(f"def f(a, b):\n    {text!r}\n").body[0]
    assert unsaid(node) == ["a : int", "E"]


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_every_entry_of_a_docstring_has_a_sentence(path):
    found = {name: unsaid(node) for name, node in public(path)}
    assert not {name: entries for name, entries in found.items() if entries}


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_public_names_say_what_goes_in_and_what_comes_out(path):
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))), "the module's first line"
    found = {name: lacking(node) for name, node in public(path)}
    assert not {name: lacks for name, lacks in found.items() if lacks}


WITH_EXAMPLES = [p for p in sorted(PACKAGE.rglob("*.py")) if ">>> " in p.read_text(encoding="utf-8")
                 and p.parent not in (PACKAGE, PACKAGE / "project")]


@pytest.mark.parametrize("path", WITH_EXAMPLES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_examples_of_docstrings_run(path):
    """Those of the front door need a study, and run in its tests."""
    module = importlib.import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
    failed, tried = doctest.testmod(module)
    assert tried and not failed

"""Claims about the documentation: what it names exists, its commands are there, its examples run."""

import importlib.util
import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from pycosim.cli.parser import VERBS
from pycosim.compile import Library, catalogue

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / n for n in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")] + sorted((ROOT / "docs").rglob("*.md"))
EXAMPLES = [(page, k, code) for page in PAGES
            for k, code in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.S))]
OF_MINUTES = ("missing-effect", "verdicts", "many-studies")
"""In the slow tier."""
REPEATED = ("report-0", "diagnosis-0", "python-1", "python-2", "python-3")
"""Searches as in the example of the README; in the slow tier too."""


@pytest.mark.long
@pytest.mark.parametrize("page, number, code", [
    pytest.param(page, k, code, id=f"{page.stem}-{k}",
                 marks=pytest.mark.slow if {page.stem, f"{page.stem}-{k}"} & {*OF_MINUTES, *REPEATED} else ())
    for page, k, code in EXAMPLES])
def test_example_runs(page, number, code, hidden, tmp_path, monkeypatch, capsys):
    for name in ("study.toml", "run.csv"):
        (tmp_path / name).write_bytes((hidden / name).read_bytes())
    monkeypatch.chdir(tmp_path)
    exec(compile(code, str(page), "exec"), {"__name__": "__main__"})
    assert capsys.readouterr().out


# --- tutorials: an empty folder, the sources beside it, and the page from top to bottom ------------------------------

TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
BLOCK = re.compile(r'^```(\w+)(?: title="([^"]+)")?\n(.*?)^```', re.S | re.M)
INSTALLED = "python3 -m venv", ".venv/bin/pip"  # what a test environment has already
ALIKE = 0.03  # of a number: what another processor may change, and less than a change of the program would
NUMBER = re.compile(r"(?<![A-Za-z_\d.])-?\d+(?:\.\d+)?(?:e-?\d+)?")


def typed(command, folder):
    """Output of a line of a tutorial."""
    here = {"pycosim": f"{shlex.quote(sys.executable)} -m pycosim", "python": shlex.quote(sys.executable)}
    for name, program in here.items():
        command = re.sub(rf"^\.venv/bin/{name}\b", lambda _: program, command)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, shell=True, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}: {done.stderr}"
    return done.stdout


def shown(line, output):
    """Whether a line of the page is a line of the output: words alike, numbers within ALIKE, dots at its end open."""
    head = line.removesuffix("...").rstrip()
    numbers = [float(n) for n in NUMBER.findall(head)]
    for told in output.splitlines():
        values = [float(n) for n in NUMBER.findall(told)]
        same = (NUMBER.sub("#", told).split() == NUMBER.sub("#", head).split() if head == line else
                NUMBER.sub("#", told).split()[:len(head.split())] == NUMBER.sub("#", head).split())
        if same and all(abs(a - b) <= ALIKE * abs(a) + 1e-12 for a, b in zip(numbers, values)):
            return True
    return False


@pytest.mark.long
@pytest.mark.parametrize("page", [
    pytest.param(p, id=p.stem, marks=pytest.mark.slow if p.stem in OF_MINUTES else ()) for p in TUTORIALS])
def test_tutorial_does_what_it_says(page, tmp_path):
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    output = ""
    for kind, title, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        if title:
            (tmp_path / title).parent.mkdir(exist_ok=True)
            (tmp_path / title).write_text(text, encoding="utf-8")
        elif kind == "sh":
            output = "".join(typed(line, tmp_path) for line in text.splitlines() if not line.startswith(INSTALLED))
        elif kind == "text":
            for line in text.splitlines():
                assert shown(line, output), f"{page.stem} says {line!r}, but the program:\n{output}"


def test_files_of_a_tutorial_are_those_of_the_example():
    """The log is made with the example's model, so the reader's must be the same."""
    for page in TUTORIALS:
        for _, title, text in BLOCK.findall(page.read_text(encoding="utf-8")):
            if title:
                assert (ROOT / "examples" / title).read_text(encoding="utf-8") == text


@pytest.mark.parametrize("line, output, same", [
    ("Error: C 0.62 N.m.", "Error: C 0.61 N.m.", True), ("Error: C 0.62 N.m.", "Error: C 0.99 N.m.", False),
    ("Missing: a at ...", "Missing: a at 2A", True), ("Missing: a at ...", "Missing: b at 2A", False)])
def test_a_quoted_line_is_held_against_the_output(line, output, same):
    assert shown(line, output) is same


def blocks():
    return re.findall(r"^```(?:sh|bash|console)\n(.*?)^```", README, re.S | re.M)


def test_readme_sets_up_and_tests_in_two_blocks_that_stand_alone():
    first, second = blocks()
    for block in (first, second):
        assert "python3 -m venv .venv" in block and "activate" not in block and "http" not in block
        for line in block.splitlines():
            assert re.match(r"(\w+=\w+ )*(python3 -m venv|\.venv/bin/|\[ -x \.venv/bin/python \])", line), line
    assert "pycosim demo" in first and "pytest" in second


def test_ci_runs_the_readmes_second_block():
    script = ROOT / ".ci" / "run"
    program = re.search(r"awk '(.*)' README.md", script.read_text()).group(1)
    found = subprocess.run(["awk", program, "README.md"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert found == blocks()[1]
    assert script.stat().st_mode & 0o111


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)", page.read_text(encoding="utf-8").replace("\n", " ")):
        made = "reference/" in target  # generated with the site, whose build refuses a link into the void
        assert made or target.startswith("http") or (page.parent / target).exists(), target


def test_pictures_are_small():
    for picture in (p for p in (ROOT / "docs" / "images").rglob("*") if p.is_file()):
        assert picture.stat().st_size < 150_000, picture


def test_the_tree_names_every_folder_and_no_other():
    tree = README.split("## The tree")[1].split("## ")[0]
    named = set(re.findall(r"^    (\w+)/ ", tree, re.M))
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True).stdout.split()
    folders = {f.split("/")[0] for f in tracked if "/" in f and not f.startswith(".")}
    assert all((ROOT / n).is_dir() for n in named)
    assert folders <= named


def test_verbs_and_modules_that_the_docs_name_exist():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        called = re.findall(r"^(?:    |\.venv/bin/)pycosim ([a-z]+)\b|`pycosim ([a-z]+)\b", text, re.M)
        assert {a or b for a, b in called} <= set(VERBS)
        for module in re.findall(r"python -m ([\w.]+)", text):
            assert module in ("venv", "pytest", "build") or importlib.util.find_spec(module), module


def test_the_new_effect_of_contributing_is_found(tmp_path):
    code = re.search(r"```modelica\n(.*?)```", (ROOT / "CONTRIBUTING.md").read_text(), re.S).group(1)
    path = tmp_path / "QuadraticDrag.mo"
    path.write_text(code)
    effect = catalogue(Library([path]))["quadratic_drag"]
    assert effect.size == ("k",) and "square" in effect.description


def test_the_house_of_contributing_is_the_one_that_the_imports_are_held_to():
    told = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"][0]["layers"]
    drawn = re.findall(r"^    ([a-z]+(?: \| [a-z]+)*)  +\S", (ROOT / "CONTRIBUTING.md").read_text(), re.M)
    assert drawn == [layer.replace("pycosim.", "") for layer in told]
    rooms = {p.name for p in (ROOT / "pycosim").iterdir() if (p / "__init__.py").exists()}
    assert rooms == {room for layer in drawn for room in layer.split(" | ")}


def test_the_places_that_contributing_names_exist():
    table = (ROOT / "CONTRIBUTING.md").read_text().split("| you bring |")[1].split("\n\n")[0]
    named = re.findall(r"`([a-z_]+(?:/[a-z_]+)*(?:\.py)?)`", table)
    assert len(named) > 20
    for name in named:
        assert any((folder / name).exists() for folder in (ROOT, ROOT / "pycosim")) or name == "__init__", name


def test_the_licence_is_whole():
    text = (ROOT / "LICENSE").read_text()
    assert "Apache License" in text and "END OF TERMS AND CONDITIONS" in text and len(text) > 11000


# --- notebooks


@pytest.mark.slow
@pytest.mark.parametrize("notebook", sorted((ROOT / "docs").rglob("*.ipynb")), ids=lambda p: p.stem)
def test_notebook_runs_from_a_log_to_the_missing_effect(notebook, hidden, tmp_path, monkeypatch):
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    for name in ("study.toml", "run.csv"):
        (tmp_path / name).write_bytes((hidden / name).read_bytes())
    told = nbformat.read(notebook, as_version=4)
    code = [cell for cell in told.cells if cell.cell_type == "code"]
    assert len(code) == 5 and not any(cell.outputs for cell in code)
    nbclient.NotebookClient(told, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    last = json.dumps(code[-1].outputs)
    assert "stribeck@2A" in last and "nothing_missing" in last and "<table" in last
    assert any("image/png" in output.get("data", {}) for cell in code for output in cell.outputs)
    assert (tmp_path / "report.html").exists() and (tmp_path / "improved.toml").exists()

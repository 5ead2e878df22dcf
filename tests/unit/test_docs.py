"""Claims about the documentation: what it names exists, its commands are there, its examples run."""

import importlib.util
import re
import subprocess
from pathlib import Path

import pytest

from pycosim import demo, results
from pycosim.cli import VERBS
from pycosim.compile import Library, catalogue

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / n for n in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")] + sorted((ROOT / "docs").rglob("*.md"))
EXAMPLES = [(page, k, code) for page in PAGES
            for k, code in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.S))]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Folder with a short study, as the demo makes it."""
    with results.Folder(tmp_path_factory.mktemp("docs") / "study", "demo") as folder:
        demo._make(Library(), folder, speeds=(0.4, 1.6), longest=2.0)
    return folder.path


@pytest.mark.parametrize("page, number, code", EXAMPLES, ids=[f"{p.stem}-{k}" for p, k, _ in EXAMPLES])
def test_example_runs(page, number, code, study, monkeypatch, capsys):
    monkeypatch.chdir(study)
    exec(compile(code, str(page), "exec"), {"__name__": "__main__"})
    assert capsys.readouterr().out


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
        assert target.startswith("http") or (page.parent / target).exists(), target


def test_pictures_are_small():
    for picture in (ROOT / "docs" / "images").iterdir():
        assert picture.stat().st_size < 150_000


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
        assert set(re.findall(r"pycosim ([a-z]+)\b(?= +(?:examples|RIG|STUDY)|`|\n)", text)) <= set(VERBS)
        for module in re.findall(r"python -m ([\w.]+)", text):
            assert module in ("venv", "pytest") or importlib.util.find_spec(module), module


def test_the_new_effect_of_contributing_is_found(tmp_path):
    code = re.search(r"```modelica\n(.*?)```", (ROOT / "CONTRIBUTING.md").read_text(), re.S).group(1)
    path = tmp_path / "QuadraticDrag.mo"
    path.write_text(code)
    effect = catalogue(Library([path]))["quadratic_drag"]
    assert effect.size == ("k",) and "square" in effect.description


def test_the_licence_is_whole():
    text = (ROOT / "LICENSE").read_text()
    assert "Apache License" in text and "END OF TERMS AND CONDITIONS" in text and len(text) > 11000

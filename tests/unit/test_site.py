"""The site builds without a warning, holds every public thing, and loads nothing from elsewhere."""

import html
import re
import subprocess
import sys
from pathlib import Path

import pytest

from pycosim.cli.parser import VERBS
from pycosim.compile import Library, catalogue, compile_model

pytestmark = pytest.mark.long
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder of the built site."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run([sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder], cwd=ROOT,
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


def words(page):
    """Text of a page as it is read."""
    return html.unescape(re.sub(r"<[^>]+>", "", page.read_text(encoding="utf-8")))


def test_every_page_is_in_the_navigation(site):
    home = (site / "index.html").read_text(encoding="utf-8")
    for page in site.rglob("*.html"):
        if page.name not in ("404.html", "index.html"):
            assert f'href="{page.relative_to(site).as_posix()}"' in home, page


def test_nothing_is_loaded_from_elsewhere(site):
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r'<(?:script|img|iframe|source)\b[^>]*\bsrc="([^"]+)"|<link\b[^>]*\bhref="([^"]+)"', text)
        assert not [a or b for a, b in loaded if re.match(r"(https?:)?//", a or b)], page
    for style in site.rglob("*.css"):
        assert not re.search(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//", style.read_text(encoding="utf-8")), style


def test_every_verb_has_its_help_and_an_example(site):
    page = words(site / "reference" / "command-line.html")
    for verb, (_, _, example, _) in VERBS.items():
        assert f"usage: pycosim {verb}" in page and f"example:\n  {example}" in page


def test_every_effect_has_its_coefficients_and_its_picture(site):
    text = (site / "reference" / "effects.html").read_text(encoding="utf-8")
    sections = dict(re.findall(r'<h2 id="(\w+)">(.*?)(?=<h2|</article>)', text, re.S))
    known = catalogue(Library())
    assert set(sections) == set(known)
    for name, section in sections.items():
        declared = (ROOT / "modelica" / (known[name].model.replace(".", "/") + ".mo")).read_text(encoding="utf-8")
        for coefficient, unit in re.findall(r'parameter Real (\w+)\(unit="([^"]+)"', declared):
            assert re.search(rf"<td><code>{coefficient}</code></td>\s*<td>{re.escape(unit)}</td>", section), name
        assert f'src="../images/effects/{name}.png"' in section
        assert (site / "images" / "effects" / f"{name}.png").is_file()


def test_every_rig_is_drawn_with_its_segments(site):
    text = (site / "reference" / "rigs.html").read_text(encoding="utf-8")
    sections = dict(re.findall(r'<h2 id="(\w+)">(.*?)(?=<h2|</article>)', text, re.S))
    library = Library()
    rigs = [n for n in library.walk() if n.startswith("DriveTrain.Rigs.")]
    assert {n.rpartition(".")[2].lower() for n in rigs} < set(sections)
    for rig in rigs:
        section = sections[rig.rpartition(".")[2].lower()]
        assert section.count("<svg") == 1
        assert all(f">{place}</text>" in section for place in compile_model(library, rig).segments.values())


def test_every_modelica_class_is_there_with_the_units_of_its_parameters(site):
    pages = {p.stem: p.read_text(encoding="utf-8") for p in (site / "reference" / "modelica").glob("*.html")}
    for path in (ROOT / "modelica" / "DriveTrain").rglob("[A-Z]*.mo"):
        text = pages[path.parent.name.lower()]
        section = re.search(rf'<h2 id="{path.stem}">(.*?)(?=<h2|</article>)', text, re.S)[1]
        rows = {n: cells for n, cells in re.findall(r"<tr>\s*<td>\w[^<]*</td>\s*<td><code>(\w+)</code></td>(.*?)</tr>",
                                                    section, re.S)}
        for name, unit in re.findall(r'\bReal (\w+)\([^;]*?unit="([^"]+)"', path.read_text(encoding="utf-8")):
            assert f"<td>{unit}</td>" in rows[name], (path.stem, name)


def test_every_public_function_of_a_module_with_a_list_is_there(site):
    import importlib
    for name in ("compile", "dynamics.simulate", "compile.parse", "fit.least_squares", "diagnosis.decide", "export"):
        module = importlib.import_module(f"pycosim.{name}")
        page = (site / "reference" / "python" / f"{name}.html").read_text(encoding="utf-8")
        own = [n for n, v in vars(module).items() if not n.startswith("_") and callable(v)
               and getattr(v, "__module__", "") == module.__name__]
        assert own or name == "compile"
        for n in own:
            assert f'id="pycosim.{name}.{n}"' in page, (name, n)

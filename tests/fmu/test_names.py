"""Names and texts of someone else's study, log or Modelica file stay names and texts in C, XML, HTML and Modelica."""

from pathlib import Path
from xml.etree import ElementTree

import pytest

from pycosim.compile import Library
from pycosim.compile.parse import parse
from pycosim.core.errors import ModelicaError
from pycosim.export.c import export_c
from pycosim.export.description import describe, values
from pycosim.export.document import to_html
from pycosim.export.modelica import to_modelica
from pycosim.export.source import sources
from pycosim.export.xml import model_description
from pycosim.study.schema import Column, Study

EVIL = '''a"b\\ */ <script>alert(1)</script> ]]> \x07 ??/ %s "; end'''
DRAG = """model Drag "D**// int evil; /* <script>alert(2)</script>"
  extends DriveTrain.Interfaces.SegmentEffect(dF=k * friction.w^2);
  parameter Real k(unit="N.m.s2/rad2", min=0, max=1, nominal=1e-3) = 0 "K**// int evil; /* <script>alert(2)</script>";
  annotation(__pycosim(size="k", needs="speeds", experiment="repeat the passes at three or more speeds"));
end Drag;
"""


@pytest.fixture(scope="module")
def described(tmp_path_factory):
    """A study whose name, column label and effect try to get out of where they are written."""
    folder = tmp_path_factory.mktemp("evil")
    (folder / "drag.mo").write_text(DRAG)
    study = Study(Path("/studies") / f"{EVIL.replace('/', '')}.toml", "DriveTrain.Rigs.GearedJoint",
                  effects=[("drag", "gear")], columns={EVIL: Column("motor.tau", "A", k_m=0.12)},
                  modelica=[folder / "drag.mo"])
    model = study.validate(Library([folder / "drag.mo"]))
    return study, model, describe(study, model)


def test_the_page_holds_no_markup_of_theirs(described):
    page = to_html(described[2])
    assert "<script" not in page and "&lt;script&gt;" in page


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_description_is_xml_and_keeps_the_text(described, fmi):
    text = model_description(described[2], fmi, ("cs", "me"), "evil", "{token}")
    root = ElementTree.fromstring(text)
    assert root.get("modelName").startswith('a"b\\ * <script>')
    names = {e.get("name") for e in root.iter() if e.get("valueReference") and e.get("name")}
    assert all(n.isascii() and set(n) <= set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.()")
               for n in names) and "drag_gear.k" in names


def test_the_sources_hold_nothing_of_their_own_making(described, tmp_path):
    study, model, plant = described
    files, _ = sources(plant, 2, ("cs",))
    assert b"evil" not in files["model.h"] and b"<script" not in files["model.h"]
    header, _ = export_c(model, values(study, model), tmp_path, "machine")
    text, code = header.read_text(), ""
    while "/*" in text:  # what is left when a compiler has taken the comments away
        before, _, text = text.partition("/*")
        code, text = code + before, text.partition("*/")[2]
    assert "evil" not in code + text and "drag_gear" in header.read_text()


def test_the_modelica_text_parses_to_the_same_machine(described):
    text = to_modelica(described[2])
    found = [n for n in parse(text, "evil").classes if n not in parse("model M end M;", "nothing").classes]
    assert len(found) == 1 and found[0].startswith("A_b")


@pytest.mark.parametrize("text, line", [("model M\n  Real 'x */ evil';\nend M;", 2), ("model 'a b'\nend 'a b';", 1)])
def test_quoted_names_of_modelica_are_refused(text, line):
    with pytest.raises(ModelicaError, match=f"mine.mo:{line}: a name between apostrophes"):
        parse(text, "mine.mo")
    parse('model M "it\'s fine" // don\'t\n /* isn\'t */ Real x;\nend M;', "mine.mo")

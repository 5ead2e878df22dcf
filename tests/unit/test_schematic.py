"""Claims about the drawing of a drive train: every rig, boxes apart, power onwards, places marked, words not markup."""

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from pycosim.compile import Library, catalogue, compile_model, places
from pycosim.compile.wiring import wiring
from pycosim.core.errors import UnknownNameError
from pycosim.report.schematic import component_of, components, figure, named, schematic, upstream, write_schematic

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples/barrier/Barrier.mo", ROOT / "examples/double_pendulum/DoublePendulum.mo"
LIBRARY = Library(EXAMPLES)
RIGS = [n for n in LIBRARY.walk() if n.startswith("DriveTrain.Rigs.")] + ["Barrier", "DoublePendulum"]
SVG = "{http://www.w3.org/2000/svg}"
HIP_KNEE = "DriveTrain.Rigs.HipKnee"
HOSTILE = """
model Hostile "<script>alert(1)</script>"
  input Real torque(unit="N.m") "Torque";
  DriveTrain.Components.Motor motor "<img src=x onerror=alert(2)>";
  Coupling a_coupling_with_a_name_that_no_box_could_hold "Own part";
  DriveTrain.Components.Inertia wheel "Load";
equation
  motor.tau = torque;
  connect(motor.flange, a_coupling_with_a_name_that_no_box_could_hold.near);
  connect(a_coupling_with_a_name_that_no_box_could_hold.far, wheel.flange);
end Hostile;
model Coupling "Own component with ports of its own names"
  DriveTrain.Interfaces.Flange near;
  DriveTrain.Interfaces.Flange far;
equation
  near.phi = far.phi;
  near.tau + far.tau = 0;
end Coupling;
"""


def drawn(text):
    """Words of a drawing, and its boxes as (name, x, y, width, height)."""
    tree = ElementTree.fromstring(text)
    boxes = []
    for group in tree.findall(f"{SVG}g"):
        box, name = group.find(f"{SVG}rect"), next(t.text for t in group.iter(f"{SVG}text") if t.get("font-weight")
                                                   == "600" and t.get("text-anchor") == "start")
        boxes.append((name, *(float(box.get(k)) for k in ("x", "y", "width", "height"))))
    return [t.text for t in tree.iter(f"{SVG}text")], boxes


@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize("rig", RIGS)
def test_every_rig_is_drawn_with_its_places_and_no_box_on_another(rig, down):
    model = compile_model(LIBRARY, rig)
    words, boxes = drawn(schematic(model, down=down))
    parts = wiring(LIBRARY, rig).parts
    known = {c: p for p, c in (pair.split("=") for pair in model.notes.get("places", "").split())}
    shown = {known.get(n, n) for n, p in parts.items() if p.kind not in ("frame", "outside", "effect", "beside")}
    assert shown == {b[0] for b in boxes} and set(model.segments.values()) <= set(words)
    for k, (_, x, y, w, h) in enumerate(boxes):
        assert all(abs(x - a) >= w or abs(y - b) >= h for _, a, b, _, _ in boxes[k + 1:])


@pytest.mark.parametrize("rig", RIGS)
def test_power_runs_onwards(rig):
    _, boxes = drawn(schematic(compile_model(LIBRARY, rig)))
    kinds = {n: p.kind for n, p in wiring(LIBRARY, rig).parts.items()}
    at = {name: x for name, x, *_ in boxes}
    motors = [at[n] for n, kind in kinds.items() if kind == "motor"]
    driven = [at[n] for n, kind in kinds.items() if kind in ("link", "inertia", "screw", "joint")]
    assert max(motors) < min(driven)


@pytest.mark.parametrize("rig", RIGS)
def test_every_place_where_an_effect_can_sit_can_be_marked(rig):
    model = compile_model(LIBRARY, rig)
    everywhere = {p.name: p.components for e in catalogue(LIBRARY).values() for p in places(LIBRARY, rig, e)}
    assert everywhere
    for place, own in everywhere.items():
        assert set(own) <= set(components(model, place)), place
        text = schematic(model, {place: "here it is"})
        assert 'stroke-width="3.5"' in text and ">here it is</text>" in text, place


def test_a_mark_stands_at_its_place_alone():
    _, plain = drawn(schematic(compile_model(LIBRARY, HIP_KNEE)))
    tree = ElementTree.fromstring(schematic(compile_model(LIBRARY, HIP_KNEE), {"1A+2A": "stribeck"}))
    thick = [g for g in tree.findall(f"{SVG}g") if g.find(f"{SVG}rect").get("stroke-width") == "3.5"]
    assert {t.text for g in thick for t in g.iter(f"{SVG}text")} == {"1A", "2A", "segment", "stribeck"}
    assert "2A is marked: stribeck" in tree.get("aria-label") and len(plain) > len(thick)


def test_where_else_it_could_be_is_marked_less():
    text = schematic(compile_model(LIBRARY, HIP_KNEE), {"2A": "stribeck"}, also={"motor2": "or torque offset"})
    tree = ElementTree.fromstring(text)
    looks = {next(t.text for t in g.iter(f"{SVG}text")): g.find(f"{SVG}rect") for g in tree.findall(f"{SVG}g")}
    assert looks["2A"].get("stroke-width") == "3.5" and not looks["2A"].get("stroke-dasharray")
    assert looks["motor2"].get("stroke-width") == "2" and looks["motor2"].get("stroke-dasharray")
    assert looks["motor1"].get("stroke-width") == "1.3" and "or torque offset" in text


def test_values_are_numbers_beside_colours_that_grow_with_them():
    model = compile_model(LIBRARY, HIP_KNEE)
    text = schematic(model, values={"hip": 0.141, "knee": 0.02}, unit="N.m")
    words, _ = drawn(text)
    assert "0.141 N.m" in words and "0.02 N.m" in words
    shades = [float(v) for v in re.findall(r'fill-opacity="([\d.]+)"', text)]
    assert len(shades) == 2 and max(shades) > 3 * min(shades)


def test_attached_effects_are_named_under_their_place():
    words, _ = drawn(schematic(compile_model(LIBRARY, "DriveTrain.Rigs.ScrewDrive", [("stribeck", "screw")])))
    assert "+ viscous, stribeck" in words


def test_channels_find_their_component_and_places_their_motors():
    hip_knee, servo = (compile_model(LIBRARY, f"DriveTrain.Rigs.{n}") for n in ("HipKnee", "ServoPendulum"))
    assert component_of(hip_knee, "C_K_pair") == "knee" and component_of(servo, "voltage") == "motor"
    assert named(hip_knee, {"C_H": 0.3, "q_H": 0.1, "nonsense": 9.0}) == {"hip": 0.3}
    assert upstream(hip_knee, "2A") == ["motor2"] and upstream(hip_knee, "1B") == ["motor1"]
    assert upstream(hip_knee, "knee") == ["motor1", "motor2"]


def test_an_unknown_place_names_the_nearest():
    with pytest.raises(UnknownNameError, match="closest: '2A'"):
        schematic(compile_model(LIBRARY, HIP_KNEE), "2a")


def test_words_of_the_user_are_no_markup_and_own_components_are_drawn(tmp_path):
    file = tmp_path / "hostile.mo"
    file.write_text(HOSTILE)
    model = compile_model(Library([file]), "Hostile")
    text = figure(model, highlight={"motor": "<b>&\"'"}, values={"wheel": 1.0}, unit="</svg><script>")
    assert "<script" not in text and "<img" not in text and "<b>" not in text
    words, boxes = drawn(schematic(model, {"motor": "<b>"}))
    assert "<b>" in words and [b[0][:5] for b in sorted(boxes, key=lambda b: b[1])] == ["motor", "a_cou", "wheel"]
    assert all(len(b[0]) < 20 for b in boxes)


def test_it_is_a_file_of_its_own_too(tmp_path):
    write_schematic(tmp_path / "rig.svg", compile_model(LIBRARY, HIP_KNEE), highlight="2A")
    assert ElementTree.parse(tmp_path / "rig.svg").getroot().tag == f"{SVG}svg"

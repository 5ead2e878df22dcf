"""Claims about an annotation of an effect: a slip is told with the nearest thing, and not met later as a riddle."""

import pytest

from pycosim.compile import Library, catalogue, ranked
from pycosim.compile.effects import annotation
from pycosim.core.errors import ModelicaError, UnknownNameError

EFFECT = '''model QuadraticDrag "Friction that grows with the square of the speed"
  extends DriveTrain.Interfaces.SegmentEffect(dF=k * friction.w^2);
  parameter Real k(unit="N.m.s2/rad2", min=0, max=1, nominal=1e-3) = 0 "Drag coefficient";
  annotation(__pycosim(size="k", needs="speeds", experiment="repeat the passes at three or more speeds"));
end QuadraticDrag;
'''


def read(folder, old, new):
    assert old in EFFECT
    path = folder / "drag.mo"
    path.write_text(EFFECT.replace(old, new))
    return Library([path])


@pytest.mark.parametrize("old, new, message", [
    ('size="k"', 'sise="k"', "no key 'sise'; closest: 'size'"),
    ('size="k"', 'size="c"', "size .* names no parameter of the effect, 'c'; known: k"),
    ('size="k"', 'size="k", scan="w:speed"', "scan .* names no parameter of the effect, 'w'"),
    ('size="k", ', "", "does not say which coefficient is the effect's size")])
def test_a_slip_in_an_annotation_is_told_with_the_nearest_thing(tmp_path, old, new, message):
    with pytest.raises(UnknownNameError, match=message):
        catalogue(read(tmp_path, old, new))


def test_a_scan_that_is_no_list_of_coefficients_and_kinds_is_refused_in_words(tmp_path):
    with pytest.raises(ModelicaError, match='scan = "k:speed w:speed" .* must be coefficients with their kinds'):
        catalogue(read(tmp_path, 'size="k"', 'size="k", scan="k:speed w:speed"'))


def test_every_class_of_the_library_has_known_keys(tmp_path):
    library = read(tmp_path, "k * friction", "2 * k * friction")
    assert "quadratic_drag" in catalogue(library)
    assert sum(bool(annotation(library, name)) for name in library.walk()) > 30


def test_ends_of_a_travel_that_are_neither_least_nor_greatest_are_refused_in_words(tmp_path):
    with pytest.raises(ModelicaError, match="means .* is 'mid\\(friction.phi\\)'; write a measured input, or an end"):
        catalogue(read(tmp_path, 'size="k"', 'size="k", means="k:mid(friction.phi)"'))


def test_an_effect_that_is_added_by_name_stands_in_no_ranking(tmp_path):
    library = read(tmp_path, 'size="k"', 'size="k", by_name="it names no cause"')
    assert catalogue(library)["quadratic_drag"].by_name == "it names no cause"
    assert "quadratic_drag" not in {e.id for e in ranked(library)}
    assert {e.id for e in catalogue(library).values()} - {e.id for e in ranked(library)} == {
        "quadratic_drag", "angle_torque", "motor_angle_torque", "angle_friction"}

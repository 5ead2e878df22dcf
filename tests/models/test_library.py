"""Every class of the library compiles, in two compilers, and describes itself; an effect at neutral changes nothing."""

import re
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from pycosim.compile import Library, Model, catalogue, component_name, places
from pycosim.compile.attach import attach
from pycosim.compile.parse import LIBRARY
from pycosim.compile.solve import _Names
from pycosim.dynamics.simulate import dynamics, estimate
from pycosim.dynamics.stepping import GAP, gap, watched

ROOT = LIBRARY / "DriveTrain"

RIGS = sorted(f"Rigs.{p.stem}" for p in (ROOT / "Rigs").glob("*.mo") if p.stem != "package")
EXAMPLES = sorted(f"Examples.{p.stem}" for p in (ROOT / "Examples").glob("*.mo") if p.stem != "package")
FILES = sorted(p for p in ROOT.rglob("*.mo"))


@pytest.mark.parametrize("name", RIGS)
def test_rig_answers_every_question_its_annotation_offers(model, name):
    rig = model(name)
    assert {"estimate", "compensate", "simulate"} <= set(rig.notes)
    for question in {"estimate", "compensate", "gravity_model"} & set(rig.notes):
        for form, (wanted, known) in enumerate(rig.alternatives(question)):
            answer = rig.question(question, form)
            assert set(wanted) <= set(answer.outputs)
            assert {n for n in answer.inputs if not n.startswith("der(")} <= set(known) | {"time"}
    assert set(dynamics(rig).algebraic).isdisjoint(dynamics(rig).states)


@pytest.mark.long
@pytest.mark.parametrize("name", RIGS)
def test_effects_hung_on_a_flat_rig_are_the_model_that_the_compiler_flattens(library, name):
    """Every effect at its last place, which is the joined one, five at a time, and once the probes."""
    rig = f"DriveTrain.{name}"
    offers = [(e.id, p[-1].name) for e, p in ((e, places(library, rig, e)) for e in catalogue(library).values()) if p]
    step = -(-len(offers) // 5)
    for k in range(step):
        model = Model(library, rig, offers[k::step], probes=k == 0)
        _same_flat(library.flatten("Improved", model.text), attach(library, rig, model.attached, model.hung))


def test_a_port_that_leaves_the_rig_is_the_compilers(tmp_path):
    """What is connected with a connector of the rig itself adds up with another sign."""
    (tmp_path / "open.mo").write_text("""model Open
  extends DriveTrain.Rigs.ServoPendulum;
  DriveTrain.Interfaces.TorqueSignal outlet "Channel, seen from outside";
equation
  connect(outlet, motor.signal);
end Open;
""")
    library = Library([tmp_path / "open.mo"])
    model = Model(library, "Open", [("torque_constant", "motor")])
    assert attach(library, "Open", model.attached) is None
    assert "torque_constant_motor.g" in model.flat.parameters


def _same_flat(whole, parts):
    """Check that two flat models say the same: expressions have no equality, so equations are compared by numbers."""
    assert parts.variables == whole.variables and parts.parameters == whole.parameters
    assert parts.derivatives == whole.derivatives and set(parts.inputs) == set(whole.inputs)
    assert parts.symbols.keys() == whole.symbols.keys() and parts.bindings.keys() == whole.bindings.keys()
    point = dict(zip(whole.symbols, np.random.default_rng(1).uniform(0.2, 0.9, len(whole.symbols))))

    def numbers(flat):
        found = ca.vertcat(*flat.equations), ca.vertcat(*[flat.bindings[n] for n in whole.bindings])
        equations, bound = ca.Function("f", list(flat.symbols.values()), found)(*[point[n] for n in flat.symbols])
        return np.sort(np.abs(np.array(equations).ravel())), np.array(bound).ravel()

    for a, b in zip(numbers(parts), numbers(whole)):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)


def test_a_watched_step_tells_what_its_gap_and_its_error_tell(model):
    d, rng = dynamics(model("Rigs.HipKnee")), np.random.default_rng(1)
    step, q = watched(d.step, d.speeds), d.prepare([v.value for v in model("Rigs.HipKnee").parameters.values()])
    for h in (1e-3, 0.3):
        x, u = rng.normal(0, 0.3, len(d.states)), rng.normal(0, 2, len(d.inputs))
        plain, seen = ([np.ravel(v) for v in f(x, np.zeros(len(d.algebraic)), u, u, q, 0, h)] for f in (d.step, step))
        assert (plain[0] == seen[0]).all() and (plain[1] == seen[1]).all()
        assert seen[2][0] == pytest.approx(max(plain[2][0], gap(x, plain[0], h, d.speeds) / GAP), rel=1e-12)
        assert (seen[2][0] > 1) == (h > 0.1)
        assert not step(x, np.zeros(len(d.algebraic)), u, np.nan * u, q, 0, h)[2] <= 1


@pytest.mark.parametrize("name", RIGS)
def test_every_rig_has_an_example(name):
    assert name.replace("Rigs", "Examples") in EXAMPLES


@pytest.mark.parametrize("name", EXAMPLES)
def test_example_says_what_to_plot_and_needs_no_inputs(model, name):
    assert "Plot" in (ROOT / (name.replace(".", "/") + ".mo")).read_text()
    assert dynamics(model(name)).inputs == []


@pytest.mark.parametrize("name", RIGS + EXAMPLES)
def test_second_compiler_takes_it_too(rumoca_model, name):
    rumoca_model(name)


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_one_short_class_a_file(path):
    lines = path.read_text().splitlines()
    assert lines[-1] == f"end {path.parent.name if path.stem == 'package' else path.stem};"
    assert len(lines) <= 90 and max(map(len, lines)) <= 120


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_everything_declared_has_a_description_and_every_quantity_a_unit(path):
    head, *declared = _statements(path)
    assert re.search(r'(package|model|connector|class) \w+ "[^"]+"', head), "the class has no description"
    for statement in declared:
        assert re.search(r'"[^"]+"$', statement), statement
        assert " Real " not in f" {statement}" or 'unit="' in statement, statement


@pytest.mark.parametrize("path", sorted((ROOT / "Effects").glob("[A-Z]*.mo")), ids=lambda p: p.stem)
def test_coefficients_of_an_effect_have_bounds_and_a_nominal_value(path):
    found = [s for s in _statements(path)[1:] if s.startswith("parameter ")]
    assert found
    for statement in found:
        low, high, nominal = (float(re.search(rf"{a}=([-+.\de]+)", statement)[1]) for a in ("min", "max", "nominal"))
        assert low < high and 0 < nominal <= high


def _statements(path):
    """Head of a class and its declarations, one string each."""
    text = re.split(r"\n(?:equation|  annotation|end )", path.read_text())[0]
    head, _, body = text.partition("\n  ")
    found = (" ".join(s.removeprefix("protected").split()) for s in re.split(r";(?:\n|$)", body))
    return [head, *(s for s in found if s and not s.startswith("extends"))]


@pytest.mark.parametrize("name", RIGS)
def test_all_neutral_effects_together_change_nothing(library, model, name):
    attached = [a for a in _offers(library, name) if a[0] != "cross_load"]  # no closed form with a squared load
    assert len(attached) >= 5
    _same(model(name), model(name, attached))


@pytest.mark.parametrize("name", [
    "Rigs.GearedJoint", *(pytest.param(n, marks=pytest.mark.long) for n in ("Rigs.ServoPendulum", "Rigs.HipKnee"))])
def test_each_neutral_effect_changes_nothing(library, model, name):
    for offer in _offers(library, name):
        _same(model(name), model(name, [offer]), offer)


def _offers(library, name):
    """Every effect of the catalogue at its first place in a rig."""
    rig = f"DriveTrain.{name}"
    found = [(e.id, places(library, rig, e)) for e in catalogue(library).values()]
    return [(effect, where[0].name) for effect, where in found if where]


def _same(bare, full, what=""):
    """Check that two models estimate the same along a log with reversals."""
    time = np.linspace(0, 1, 200)
    known = [n for n in bare.question("estimate").inputs if not n.startswith("der(")]
    signals = {n: 0.3 * np.sin((3 + k) * time + k) for k, n in enumerate(known)}
    short = {f"{component_name(effect, place)}.{c}": 1e-4 for effect, place in full.attached  # its least travel
             for c, kind in effect.scan.items() if kind == "travel"}
    a = estimate(bare, signals, time)
    b = estimate(full, {**signals, **{n: 20 + time for n in full.log_inputs}}, time, short)
    here = np.full(len(time), True)
    if len(full.question("estimate").states) > len(bare.question("estimate").states):  # other ways to the same sliding
        here = np.all([np.abs(np.abs(m[f"{c}.s"]) - 1) < 1e-12 for m in (a, b) for c in bare.segments], axis=0)
        here[0] = False  # states start from zero
        assert here.mean() > 0.6
    for n in bare.alternatives("estimate")[0][0]:
        np.testing.assert_allclose(b[n][here], a[n][here], atol=1e-12 if here.all() else 1e-10, err_msg=str(what))


@pytest.mark.parametrize(("name", "segment"), [("Rigs.ServoPendulum", "gear"), ("Rigs.ScrewDrive", "screw")])
def test_an_effect_of_the_base_model_is_neither_a_place_nor_a_candidate_there(library, model, name, segment):
    assert list(model(name).segments) == [segment]
    for effect in catalogue(library).values():
        found = {p.name for p in places(library, f"DriveTrain.{name}", effect)}
        assert found <= ({"motor"} if effect.id == "viscous" else {"motor", segment})


def _named(equations, known=("k",), differentiated=("d",), bent=("v",)):
    """What stays of equations among single letters, and what each unknown that goes is."""
    letters = {n: ca.SX.sym(n) for n in "abcdkmv"}
    names = _Names(SimpleNamespace(unknown={*letters} - {*known}, symbols=letters, differentiated={*differentiated},
                                   rates=set(), bent={*bent}))
    left = names.sort_out([eval(e, {"fabs": ca.fabs}, letters) for e in equations])
    return [str(e) for e in left], {n: str(names.value(n)) for n in names.heads}


@pytest.mark.parametrize(("equations", "left", "values"), [
    (["a - k"], [], {"a": "k"}),
    (["b + k"], [], {"b": "(-k)"}),
    (["a - b", "b + c", "c - k"], [], {"a": "(-k)", "b": "(-k)", "c": "k"}),
    (["a", "a + b + c"], [], {"a": "0", "b": "(-c)"}),  # a sum becomes a name as one of its terms is zero
    (["a + b", "a - b"], [], {"a": "0", "b": "0"}),
    (["a - b", "b - a"], [], {"a": "b"}),
    (["a - 2 * b", "a - fabs(b)"], ["(a-(2*b))", "(a-fabs(b))"], {}),
    (["a + b + c"], ["((a+b)+c)"], {}),
    (["d - a"], [], {"a": "d"}),
    (["d - k", "d - a", "a - c"], ["(d-k)"], {"a": "d", "c": "d"}),  # a state stays, though its value is known
    (["k - m"], [], {"m": "k"}),
    (["v - a", "v - d"], ["(v-d)"], {"a": "v"}),  # what stands in an absolute value goes by no state ..
    (["v - k", "a - v"], [], {"v": "k", "a": "k"}),  # .. but by what is known
])
def test_what_only_names_an_unknown_goes_at_once(equations, left, values):
    assert _named(equations) == (left, values)

"""Two effects in one machine: each is found, and one that stood in for the other is replaced."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.hidden_effects import cases
from benchmarks.hidden_effects import machine as rig
from benchmarks.hidden_effects.run import run
from benchmarks.hidden_effects.summary import both
from benchmarks.real_logs.make import make
from pycosim.compile import Library, compile_model, component_name
from pycosim.data.dataset import Dataset
from pycosim.diagnosis import pairs, search
from pycosim.diagnosis.crossval import select
from pycosim.diagnosis.decide import scored
from pycosim.diagnosis.finding import Finding
from pycosim.diagnosis.scores import LEVEL, Scores
from pycosim.diagnosis.search import Step, _exchanged, _ladder, _moved, _revised, _spared, diagnosed, improve, step_of
from pycosim.diagnosis.table import Table
from pycosim.fit import least_squares
from pycosim.study.parse import load_study

STUDY = Path(__file__).parents[2] / "examples" / "hip_knee" / "study.toml"
TRUE = ("stribeck", "2A"), ("payload", "shank")
ZERO, SATURATION = ("reference_zero", "knee"), ("torque_saturation", "motor1+motor2")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """A log of a machine with both effects."""
    drawn = cases.draw(cases.Case("pair", tuple(e for e, _ in TRUE), 3, (1.7, 1.7)))
    hidden = [rig.calibrate(rig.Effect(h.id, place, **h.coefficients), 1.7, drawn.machine, drawn.motion, drawn.noise, 3)
              for h, (_, place) in zip(drawn.hidden, TRUE)]
    path = tmp_path_factory.mktemp("pair") / "run.csv"
    rig.write_csv(cases.log(drawn, 3, hidden), path)
    return Dataset(load_study(STUDY).with_data([path]), Library())


@pytest.mark.slow
def test_both_are_found_and_nothing_else(dataset):
    found = improve(dataset)
    assert {s.added for s in found.steps[1:]} == set(TRUE)
    assert found.last.verdict == "nothing_missing"


def ladder(dataset, keys):
    """The steps that add these effects one after the other."""
    base = step_of(dataset, dataset.base, least_squares.fit(dataset, dataset.base))
    rungs = [replace(base, added=key, finding=Finding(*key), model=compile_model(dataset.library, base.model.rig, keys))
             for key in keys]
    return _ladder(dataset, base, rungs)


@pytest.mark.slow
def test_a_revision_that_comes_back_ends_the_search_where_nothing_is_missing(dataset, monkeypatch):
    """What is taken out and found again, over and over, was left out in the end, and said to be missing."""
    monkeypatch.setattr(search, "_revised", lambda data, steps, *given: _ladder(data, steps[0], steps[1:-1]))
    found = improve(dataset)
    assert {s.added for s in found.steps[1:]} == set(TRUE)
    assert found.last.verdict == "nothing_missing"


def test_a_ripple_is_fitted_again_from_where_it_was_found(tmp_path):
    """From no amplitude at one cycle a turn it was not found a second time, and given up."""
    data = Dataset(load_study(make("three:torque_ripple+torque_offset+presliding:1.7:4601", tmp_path, quick=True)),
                   Library())
    base = step_of(data, data.base, least_squares.fit(data, data.base))
    model = compile_model(data.library, base.model.rig, [("torque_ripple", "motor1")])
    found = least_squares.fit(data, model, {"torque_ripple_motor1.n": 6.0, "torque_ripple_motor1.A": 0.01})
    key = "torque_ripple", "motor1"
    rung = replace(base, added=key, model=model, fit=found, finding=Finding(*key))
    again = _ladder(data, base, [rung])[-1].fit
    assert again.parameters["torque_ripple_motor1.n"] == pytest.approx(6.0, rel=0.03)
    assert again.parameters["torque_ripple_motor1.A"] == pytest.approx(
        found.parameters["torque_ripple_motor1.A"], rel=0.05)


def test_an_effect_that_stands_in_for_another_is_replaced(dataset):
    steps = ladder(dataset, [("viscous", "1A+2A"), TRUE[1]])
    revised = _revised(dataset, steps, steps[-1].fit.noise, 0, None)
    assert [s.added for s in revised[1:]] == [TRUE[1], TRUE[0]]
    assert sum(revised[-1].error.values()) < sum(steps[-1].error.values())
    assert revised[-1].finding.predicted_error and not revised[1].finding.predicted_error, "it came from another model"


@pytest.mark.slow
def test_what_was_chosen_rightly_stays(dataset):
    steps = ladder(dataset, TRUE)
    assert _revised(dataset, steps, steps[-1].fit.noise, 0, None) is None


@pytest.fixture(scope="module")
def scores(dataset):
    """Of the base model, which lacks both."""
    return Scores(Table(dataset, dataset.base, least_squares.fit(dataset, dataset.base)))


def test_the_scores_of_one_model_tell_which_two_it_lacks(scores):
    first = pairs.Combinations(scores, 8).pairs()[0]
    assert set(first.keys) == set(TRUE)
    assert first.value > max(s.value for s in scores.results)


def test_what_two_take_together_is_what_both_together_take(scores):
    alone = [s.candidate for s in scores.results if s.visible]
    coordinates = pairs._whitened(scores, alone)
    rng = np.random.default_rng(0)
    for k in rng.integers(len(alone), size=20):
        taken = pairs._taken(*coordinates, k)
        for other in rng.choice(np.flatnonzero(np.isfinite(taken)), 20):
            moments, moved = scores.beside_base([alone[k], alone[other]])
            assert np.isclose(taken[other], moved @ np.linalg.solve(moments, moved), rtol=1e-6)
        second = rng.choice(np.flatnonzero(np.isfinite(taken)))
        taken = pairs._taken(*coordinates, k, second)
        for third in rng.choice(np.flatnonzero(np.isfinite(taken)), 5):
            moments, moved = scores.beside_base([alone[n] for n in (k, second, third)])
            assert np.isclose(taken[third], moved @ np.linalg.solve(moments, moved), rtol=1e-6)


def test_no_three_is_asked_where_two_take_as_much_but_for_luck(scores):
    some = pairs.Combinations(scores, 8)
    assert not some.threes(some.pairs())
    assert not some.threes([])


THREE = {("load_nonlinearity", "1A"), ("torque_offset", "motor1+motor2"), ("configuration_preload", "1A+2A")}


@pytest.fixture(scope="module")
def three(tmp_path_factory):
    """A log with three effects, of which none by itself has one coefficient, and no two have."""
    study = make("three:load_nonlinearity+torque_offset+configuration_preload:1.7:216000026",
                 tmp_path_factory.mktemp("three"), quick=True)
    return Dataset(load_study(study), Library())


@pytest.mark.long
def test_the_scores_of_one_model_tell_which_three_it_lacks(three):
    fit = least_squares.fit(three, three.base)
    first = next(pairs.fitted(three, three.base, fit, scored(three, three.base, fit), None, True))[0]
    assert set(first.keys) == THREE
    assert all(f.p_value < LEVEL and f.joint for f in first.findings)
    offset = first.findings[first.keys.index(("torque_offset", "motor1+motor2"))]
    assert ("reference_offset", "hip") in [(t["effect"], t["place"]) for t in offset.twins]


@pytest.mark.slow
@pytest.mark.xfail(strict=True, reason="beside the two others the offset is slow noise to the test, and goes")
def test_three_that_no_order_of_single_steps_leads_to_are_found(three):
    found = improve(three)
    assert {s.added for s in found.steps[1:]} == THREE and found.last.verdict == "nothing_missing"


def test_another_is_asked_where_the_first_is_not_constant_if_folds_cannot_tell_them(monkeypatch):
    """Of threes that do alike the first, by luck, missed one coefficient all over the data by a hundredth."""
    class Known:
        def __init__(self, short, near=()):
            self.short, self.near, self.fit, self.noise = short, list(near), self, None

    asked = []
    monkeypatch.setattr(search, "_joined", lambda data, base, rest, pair: pair)
    monkeypatch.setattr(search, "_shortfall", lambda data, pair, *given: asked.append(pair) or pair.short)
    monkeypatch.setattr(search, "_followed", lambda data, steps, pair, *given: (
        ([pair], pair) if pair.short <= 1.0 else (None, None)))
    monkeypatch.setattr(search, "_named", lambda data, path, *given: len(path))
    steps, other, far, constant = [None], Known(1.2), Known(0.2), Known(0.9)
    first = Known(1.01, [other, constant])
    assert search._together(None, steps, [first, other, far, constant], 0, None) == ([constant], constant)
    assert asked == [other, constant]
    assert search._together(None, steps, [first, far], 0, None) == (None, None)
    assert search._together(None, steps, [constant, first], 0, None)[0] == [constant] and len(asked) == 2
    assert search._together(None, steps, [], 0, None) == (None, None)


@pytest.mark.parametrize(("common", "twins", "kept"), [
    ({SATURATION}, 0, [SATURATION]), (set(), 0, None), ({SATURATION}, 9, None), ({ZERO}, 0, None)])
def test_of_a_pair_the_one_with_a_name_that_all_as_good_pairs_have_is_kept(common, twins, kept, monkeypatch):
    """Of a saturation and a wrong zero, or any of seven others that do as well beside it, none had a name."""
    def step(key, twins):
        others = [{"effect": f"effect{k}", "place": "a"} for k in range(twins)]
        return Step(key, SimpleNamespace(keys=[key, "another"]), None, {}, {}, Finding(*key, twins=others, joint=True))

    base = SimpleNamespace(added=None, model=SimpleNamespace(keys=[]), fit=None)
    path = [base, step(ZERO, 9), step(SATURATION, twins)]
    monkeypatch.setattr(search, "corrections", lambda library: {})
    whole = SimpleNamespace(noise=None)
    monkeypatch.setattr(search, "_followed", lambda *given: (path, whole))
    monkeypatch.setattr(search, "_named", lambda *given: 1)
    monkeypatch.setattr(search, "_ladder", lambda data, base, steps: [base, *steps])
    monkeypatch.setattr(search, "diagnose", lambda *given: "the rest")
    pair = SimpleNamespace(common=common, near=[])
    found, last = search._together(SimpleNamespace(library=None), path[:1], [pair], 0, None)
    assert (found and [s.added for s in found[1:]]) == kept and last == (whole if kept is None else "the rest")
    assert kept is None or not found[-1].finding.joint, "without the other, what stands in for both is ahead of it"


@pytest.mark.slow
def test_two_that_stand_in_for_two_are_exchanged_together(dataset):
    steps = ladder(dataset, [("viscous", "1A+2A"), ("joint_spring", "hip")])
    exchanged, either = _exchanged(dataset, steps, steps[-1].fit.noise, 0, None)
    assert either is None and {s.added for s in exchanged[1:]} == set(TRUE)
    assert all(s.finding.p_value < LEVEL and s.finding.coefficients for s in exchanged[1:])


@pytest.mark.parametrize(("sizes", "told"), [((0.06, 0.06), [("viscous", "1A+2A")]), ((0.12, 0.04), None)])
def test_one_effect_found_stage_by_stage_is_at_both_where_one_size_does(sizes, told, tmp_path):
    """Each was found for want of another effect, and that of both stages could not be looked for beside either."""
    hidden = [rig.Effect("viscous", place, b=b) for place, b in zip(("1A", "2A"), sizes)]
    motion = rig.six_manoeuvres(speeds=(0.4, 1.6), repeats=1, longest_pass=5.0)
    rig.write_csv(rig.measure(rig.PAPER, motion, hidden, rng=1), tmp_path / "run.csv")
    data = Dataset(load_study(STUDY).with_data([tmp_path / "run.csv"]), Library())
    steps = ladder(data, [("viscous", "1A"), ("viscous", "2A")])
    spared = _spared(data, steps, steps[-1].fit.noise, 0, None)
    assert (spared and [s.added for s in spared[1:]]) == told


def test_two_that_nothing_speaks_against_stay(dataset):
    steps = ladder(dataset, TRUE)
    assert _exchanged(dataset, steps, steps[-1].fit.noise, 0, None) == (None, None)


def test_two_that_other_two_do_as_well_as_are_left_open(tmp_path):
    """A law of the load beside any of five does what a wrong zero of both joints and a saturation do."""
    data = Dataset(load_study(make("reference_zero:load_nonlinearity:1.3:910000004", tmp_path, quick=True)), Library())
    steps = ladder(data, [("reference_zero", "hip+knee"), SATURATION])
    better, (rest, told) = _exchanged(data, steps, steps[-1].fit.noise, 0, None)
    assert better is None and rest == [] and len(told) == search.SHOWN
    assert [{(e["effect"], e["place"]) for e in pair} for pair in told][0] == {s.added for s in steps[1:]}
    assert all(("load_nonlinearity", "1A+2A") in [(e["effect"], e["place"]) for e in pair] for pair in told[1:])
    path, last = search._left_open(data, steps, rest, told, 0, None)
    assert len(path) == 1 and last.verdict == "unexplained" and last.contested.outdone
    assert last.contested.together == told


def test_what_acts_on_a_friction_moves_with_it(tmp_path):
    """A drift and a travel before sliding at the other of two stages: there neither alone does as well."""
    case = "three:thermal_drift+presliding+torque_offset:1.7:910000010"
    data = Dataset(load_study(make(case, tmp_path, quick=True)), Library())
    true = [("presliding", "2B"), ("thermal_drift", "2B"), ("torque_offset", "motor2")]
    wrong = ladder(data, [("presliding", "1B"), ("thermal_drift", "1B"), ("torque_offset", "motor2")])
    moved = _moved(data, wrong, wrong[-1].fit.noise, None)
    assert {s.added for s in moved[1:]} == {*true}
    assert _moved(data, moved, moved[-1].fit.noise, None) is None


@pytest.mark.slow
def test_two_do_not_replace_one_that_is_better_beside_one_of_them(dataset, monkeypatch):
    """Two gains of the reference do better than a payload alone, where a friction is missing too."""
    base, one = ladder(dataset, TRUE[1:])
    noise, here = one.fit.noise, dataset.settled(base.model, base.fit.parameters)
    alone = select(here, base.model, base.fit, noise)
    one.finding.fit, one.finding.selection = one.fit, select(here, one.model, one.fit, noise, alone)
    scores = Scores(Table(dataset, one.model, one.fit))
    told, real = [], pairs._refitted
    monkeypatch.setattr(pairs, "_refitted", lambda *given: told.extend(real(*given)) or told)
    some = pairs.doubles(dataset, base.model, base.fit, one.finding, noise, scores, 0, None)
    better = [p for p in told if pairs._outdoes(p, one.finding, pairs._luck(len(scores.results))) and p.findings]
    assert any(pairs._certain(here, p) for p in better)
    assert not any(p.clear for p in told)
    assert not {p.keys for p in better if pairs._certain(here, p)} & {p.keys for p in some}


def test_two_in_the_place_of_one_are_told_beside_what_the_base_takes_without_it(tmp_path):
    """A spring held losses off their bounds that without it are pressed there: what they took of the truth hid it."""
    data = Dataset(load_study(make("reference_mass:torque_offset:2.4:216000014", tmp_path, quick=True)), Library())
    model = compile_model(data.library, data.base.rig, [("joint_spring", "hip+knee")])
    base = component_name(*model.attached[-1])
    found = least_squares.fit(data, model, {f"{base}.k": 0.3, f"{base}.q0": 0.3})
    scores = Scores(Table(data.sliding(model), model, found))
    less = scores.lacking({f"{base}.k": found.parameters[f"{base}.k"], f"{base}.q0": 0.0})
    assert less._absorb[0] != [k for k in scores._absorb[0] if not found.free[k].startswith(base)]
    assert {("torque_offset", "motor2"), ("reference_mass", "thigh")} in [
        set(pair.keys) for pair in pairs.Combinations(less, 8, 2).pairs({2: 0.98 * (less.left() - scores.left())})]


@pytest.mark.long
def test_a_computed_reference_may_be_off_by_a_little_in_the_place_of_a_name(tmp_path, monkeypatch):
    """The thigh's centre of mass is 5 % off, and an offset of one motor was an asymmetry at the other."""
    data = Dataset(load_study(make("reference_centre:torque_offset:1.3:216000023", tmp_path, quick=True)), Library())
    base = step_of(data, data.base, least_squares.fit(data, data.base))
    model = compile_model(data.library, data.base.rig, [("direction_asymmetry", "2A")])
    found = least_squares.fit(data, model, {"direction_asymmetry_2A.a": -0.1})
    noise, here = base.fit.noise, data.settled(base.model, base.fit.parameters)
    winner = Finding("direction_asymmetry", "2A", fit=found, twins=[{"effect": "torque_offset", "place": "motor2"}])
    winner.selection = select(here, model, found, noise, select(here, base.model, base.fit, noise))
    scores = Scores(Table(data.sliding(model), model, found))

    def doubted():
        some = pairs.doubles(data, base.model, base.fit, winner, noise, scores, 0, None)
        return [set(p.keys) for p in some if p.doubted]

    assert {("torque_offset", "motor1"), ("reference_mass", "thigh")} in doubted()
    assert not any(("torque_offset", "motor2") in pair for pair in doubted()), "that is an alternative already"
    monkeypatch.setattr(pairs, "DOUBTED", 1e-4)
    assert not doubted(), "an error of a mass that large is no small one"
    monkeypatch.undo()
    data.study = replace(data.study, reference="sensor")
    assert not doubted(), "a sensor knows of no mass"


def test_where_two_take_the_place_of_one_the_places_that_it_could_not_be_told_at_stay(monkeypatch):
    """Few pairs of the same two effects are fitted: the place that one comes with is not the only one."""
    winner = Finding("stribeck", "2B", twins=[{"effect": "stribeck", "place": p} for p in ("1B+2B", "1B")])
    one, other = Finding("stribeck", "1B"), Finding("reference_mass", "thigh")
    path = [search.Step(f and f.key, None, None, {}, {}, f) for f in (None, one, other)]
    asked = []
    monkeypatch.setattr(search, "_good_beside", lambda *given: asked.append(given[3]) or given[3][:1])
    search._tell_as_winner(None, path, path[1:], winner, None, None)
    assert asked == [[{"effect": "stribeck", "place": p} for p in ("2B", "1B+2B")]], "the mass is no alternative"
    assert path[1].finding.twins == [{"effect": "stribeck", "place": "2B"}] and not path[2].finding.twins


@pytest.mark.parametrize(("gain", "kept"), [(50.0, False), (-50.0, True)])
def test_what_one_effect_is_ahead_of_is_not_asked_before_it(gain, kept, monkeypatch):
    """Three stand-ins of a delay beside a wrong mass had constant coefficients, 2900 noise variances behind it."""
    monkeypatch.setattr(pairs, "gap", lambda other, one, kind: (gain, 3.0))
    fit = SimpleNamespace(free=["f0", "d"])
    three = SimpleNamespace(selection=None, fit=SimpleNamespace(free=["f0", "a", "b", "c"]))
    one = SimpleNamespace(selection=None, fit=fit)
    assert search._beyond_one(SimpleNamespace(provisional=one), [three]) == [three] * kept
    assert search._beyond_one(SimpleNamespace(provisional=None), [three]) == [three]


@pytest.mark.parametrize(("gain", "ahead"), [(400.0, True), (7.0, False)])
def test_a_pair_is_behind_a_winner_with_an_effect_of_more_coefficients(gain, ahead, monkeypatch):
    """A loss and a preload of two coefficients hid: pairs of one each outdid the loss, and contested its name."""
    monkeypatch.setattr(pairs, "_seconds", lambda scores, winner: {("configuration_preload", "2A"): 2})
    monkeypatch.setattr(pairs, "beside", lambda here, larger, start, key, *given: key)
    monkeypatch.setattr(pairs, "gap", lambda pair, one, kind: (gain, 3.0) if one[0] == "configuration_preload" else (
        -50.0, 3.0))
    monkeypatch.setattr(pairs, "alike", lambda *given: False)
    fit = SimpleNamespace(free=["f0", "mu", "m"], parameters={})
    pair = SimpleNamespace(keys=(("payload", "shank"), ZERO), clear=False, matched=False, selection=None,
                           fit=SimpleNamespace(free=["f0", "a", "b", "c"], parameters={}))
    winner = SimpleNamespace(fit=fit)
    assert pairs._beside_winner(None, None, winner, [pair], None, None, None) == [pair] * ahead
    assert pair.clear != ahead


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, 13, 37])
def test_two_that_one_law_looked_as_good_as_are_both_named(seed):
    """A gain and a constant; a law of the load and a saturation; a loss and a preload, of the track record."""
    row = run(cases.Case("pair", cases.pair(seed), seed))
    assert both(row), row


@pytest.mark.slow
def test_effects_that_hide_one_another_are_found_together(tmp_path):
    """No effect by itself has one coefficient here: one after the other they were `unexplained`."""
    study = make("three:load_nonlinearity+configuration_preload+stribeck:1.7:1982", tmp_path, quick=True)
    data = Dataset(load_study(study), Library())
    found = improve(data)
    hidden = {("load_nonlinearity", "2A"), ("configuration_preload", "2A"), ("stribeck", "1A")}
    assert {s.added for s in found.steps[1:]} == hidden and found.last.verdict == "nothing_missing"
    told = diagnosed(data, found.steps[0].model, found.steps[0].fit)
    assert told.verdict == "missing_effect" and told.winner.key == found.steps[1].added == found.first.winner.key

"""How rivals are compared on folds that they were not fitted to."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import pycosim as pc
from benchmarks.real_logs.make import make
from pycosim.compile import Library, compile_model
from pycosim.data.scatter import _carried, noise_level
from pycosim.diagnosis import decide, trials
from pycosim.diagnosis.crossval import UNTOLD, Selection, _cross_validate, _predictive, difference, gap
from pycosim.diagnosis.decide import ENDLESS, _considered, _decide, _soon
from pycosim.diagnosis.finding import Finding
from pycosim.diagnosis.rivals import BESIDE, CONTESTED, KINDS, alike, behind, by_kind, too_many
from pycosim.diagnosis.trials import pressed
from pycosim.fit.bounded import bounded
from pycosim.fit.least_squares import Fit

FREE = np.full(2, np.inf)
BLOCKS, EACH = 7, 400
HIP_KNEE = "DriveTrain.Rigs.HipKnee"


def totals(columns, y, fold):
    """Errors of both kinds of a linear model with unit noise, a fold a block."""
    rows = np.vstack([columns, y])
    gram = np.array([[rows[:, fold == f] @ rows[:, fold == f].T for f in range(fold.max() + 1)]])
    bounds = -FREE[:len(columns)], FREE[:len(columns)]
    return tuple(of(gram, np.arange(fold.max() + 1), *bounds).sum() for of in (_cross_validate, _predictive))


def world(seed, alone):
    """A law of two columns, told apart in one fold alone or in all, and the law of one that stands in for it."""
    rng = np.random.default_rng(seed)
    fold = np.repeat(np.arange(5), 200)
    one = rng.standard_normal(1000)
    other = one + (np.where(fold == 4, 1.0, 1e-4) if alone else 1.0) * rng.standard_normal(1000)
    y = one + other + rng.standard_normal(1000)
    return totals(np.array([one, other]), y, fold), totals(one[None], y, fold)


def test_a_fold_that_alone_tells_a_coefficient_does_not_put_the_right_law_behind():
    right, lesser = np.swapaxes([world(seed, True) for seed in range(40)], 0, 1)
    assert np.all(right < lesser)


def test_the_plain_error_of_what_the_other_folds_do_not_tell_is_no_extrapolation():
    """Where four folds hold a coefficient to 1e-4 of what the fifth does, their estimate of it is noise a hundred times
    over; where all tell it alike, the fold's own weight changes nothing."""
    alone, alike = (np.mean([world(seed, kind)[0][0] for seed in range(40)]) for kind in (True, False))
    assert abs(alone - 1000) < 30 and abs(alike - 1002) < 30


@pytest.mark.parametrize("alone", [True, False])
def test_the_error_of_prediction_of_the_right_law_is_the_noise(alone):
    found = np.array([world(seed, alone)[0][1] for seed in range(40)])
    assert abs(found.mean() - 1000) < 4 * np.sqrt(2 * 1000 / 40)


def residual_of(left):
    """A selection whose residual is so, in blocks of equal length."""
    index = np.repeat(np.arange(BLOCKS), EACH)
    squares, level = np.bincount(index, left**2)[None], np.ones((1, len(left)))
    return Selection(squares, squares, squares[0], level, {"raw": left[None], "white": left[None]}, index, 1)


@pytest.mark.parametrize(("kind", "apart"), [
    ("white", np.ones(BLOCKS)), ("raw", np.ones(BLOCKS)), ("white", np.array([0.0, 0.0, 0.0, 0.1, 0.1, 3.0, 1.0])),
    ("raw", np.array([0.5, 0.5, 0.5, 0.5, 0.5, 1.0, 2.0]))])
def test_a_gap_is_off_by_its_error_however_unequal_the_blocks(kind, apart):
    """The right one of two leaves noise, the other what they predict apart besides, in some blocks most of it."""
    rng, off = np.random.default_rng(0), []
    for _ in range(300):
        shape = 0.2 * np.repeat(apart, EACH) * rng.standard_normal(BLOCKS * EACH)
        noise = rng.standard_normal(BLOCKS * EACH)
        total, spread = gap(residual_of(noise + shape), residual_of(noise), kind)
        off.append((total - (shape**2).sum()) / spread)
    assert 0.7 < np.std(off) < 1.3 and abs(np.mean(off)) < 0.3


def test_blocks_in_which_rivals_say_the_same_do_not_make_them_alike():
    """One block alone tells: the spread over blocks is as large as the gap, and the rival stood as an alternative."""
    rng, told = np.random.default_rng(1), []
    for _ in range(100):
        noise, shape = rng.standard_normal((2, BLOCKS * EACH))
        rival = residual_of(noise + 0.5 * shape * np.repeat(np.arange(BLOCKS) == 2, EACH))
        best, base = residual_of(noise), residual_of(noise + 2.0 * shape)
        total, spread = difference(rival.white, best.white)
        told.append((alike(base, rival, best, kinds=("white",)), total <= 1.645 * spread))
    now, before = np.mean(told, axis=0)
    assert now < 0.1 and before > 0.9


def test_the_plain_error_is_not_asked_of_rivals_where_other_folds_tell_next_to_nothing():
    """It is the luck of extrapolation there; the whitened error counts what the others leave open."""
    noise, shape = np.random.default_rng(3).standard_normal((2, BLOCKS * EACH))
    best, base = residual_of(noise), residual_of(noise + 2.0 * shape)
    rival = residual_of(noise + 0.5 * shape)
    rival = replace(rival, white=best.white, left={**rival.left, "white": best.left["white"]})
    assert not alike(base, rival, best) and behind(best, rival) == [] and behind(rival, best) == ["raw"]
    untold = replace(rival, alone=(UNTOLD + 0.1) * rival.channels)
    assert rival.told and not untold.told
    assert alike(base, untold, best) and behind(untold, best) == []


def test_rivals_that_are_one_model_differ_by_nothing():
    one = residual_of(np.random.default_rng(2).standard_normal(BLOCKS * EACH))
    assert gap(one, one, "white") == (0.0, 0.0) == gap(one, one, "raw")


def test_what_is_over_between_two_samples_is_told_and_not_counted():
    others = ["stribeck", "presliding", "cross_load", "payload", "torque_offset", "low_pass"][:CONTESTED + 1]
    finding = Finding("viscous", "1A", twins=[{"effect": e, "place": "1A"} for e in others])
    assert too_many(finding, {}, False)
    finding.uncounted = {("presliding", "1A")}
    assert not too_many(finding, {}, False) and len(finding.twins) == CONTESTED + 1


def test_alternatives_that_might_be_names_are_told_before_corrections_and_what_was_refused():
    found = [Finding(effect, place, refused=why) for effect, place, why in (
        ("load_hysteresis", "2A", "over within a few samples"), ("torque_offset", "motor1", None),
        ("torque_saturation", "motor2", None), ("torque_offset", "motor2", None), ("viscous", "2A", None))]
    told = by_kind(found, ["torque_constant"], {"torque_saturation": "torque_constant"})
    assert [(f.effect, f.place) for f in told] == [
        ("torque_offset", "motor1"), ("viscous", "2A"), ("torque_offset", "motor2"), ("torque_saturation", "motor2"),
        ("load_hysteresis", "2A")]


def test_so_many_effects_leave_no_name_but_many_places_of_a_few_do():
    def with_twins(effects, places):
        return Finding("viscous", "1A", twins=[{"effect": e, "place": p} for e in effects for p in places])

    others = ["stribeck", "presliding", "cross_load", "payload", "torque_offset", "low_pass"][:CONTESTED + 1]
    assert not too_many(with_twins(others[:CONTESTED], ["1A"]), {}, False)
    assert too_many(with_twins(others, ["1A"]), {}, False)
    assert not too_many(with_twins(others[:KINDS - 1], ["1A", "1B", "2B"]), {}, False)
    assert too_many(with_twins(others[:KINDS], ["1A", "1B"]), {}, False)
    assert not too_many(with_twins(others, ["1A"]), {"stribeck": "viscous"}, False), "it does as well because that does"
    assert too_many(with_twins(others, ["1A"]), {"stribeck": "time_delay"}, False), "which is not among them"
    assert not too_many(with_twins(others[:BESIDE], ["1A"]), {}, True)
    assert too_many(with_twins(others[:BESIDE + 1], ["1A"]), {}, True), "beside another effect"


def test_what_one_fold_alone_tells_leaves_no_rounding_in_the_others():
    """Of two effects that one run alone shows: beside squares of zero, products of 1e-10 had no eigenvalues."""
    moments = np.array([[0.0, 1e-10, 1e-9], [1e-10, 0.0, 3e-10], [1e-9, 3e-10, 4.0]])
    _, x = bounded(moments, np.array([1e-10, 0.0, 8.0]), -np.full(3, 5.0), np.full(3, 5.0))
    assert np.allclose(x, [0.0, 0.0, 2.0])
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((6, 4, 50))
    rows[1:, :2] = 0.0
    gram, fold = np.einsum("bin,bjn->bij", rows, rows)[None], np.arange(6) // 2
    known = _cross_validate(gram[:, :, 2:, 2:], fold, *(np.full(1, end) for end in (-np.inf, np.inf)), 0.0)
    left_out = _cross_validate(gram, fold, *(np.full(3, end) for end in (-np.inf, np.inf)), 0.0)
    assert np.allclose(left_out[:, 1], known[:, 1]), "what the other folds know nothing of predicts nothing"


def test_without_load_a_sample_has_the_noise_of_both_branches(tmp_path):
    """By which of them the motion alone would say, two rivals whose loads pass zero elsewhere differed by 27."""
    project = pc.open(make("geared:none::5", tmp_path, quick=True))
    fitted = project.fit()
    data, model, values = fitted.dataset, fitted.model, fitted.solution.parameters
    level, (load, noise) = noise_level(data, model, values)[0], _carried(data, model, values, "fit")
    (_, _, take), = data.picks("fit")
    load = take(load / noise)[0]
    driven, driving, about = (np.median(level[s] ** 2) for s in (
        (load < -4) & (load > -20), (load > 4) & (load < 20), np.abs(load) < 0.3))
    assert abs(driving / driven - 1) > 0.2 and about == pytest.approx((driven + driving) / 2, rel=0.1)


def refitted(effect, squares, white):
    """A finding that leaves so much in two channels on ten blocks each."""
    level = np.ones((2, 10))
    channels = np.outer(squares, np.ones(10)) / 10
    left = {"raw": np.sqrt(channels), "white": np.full((2, 10), np.sqrt(white / 20))}
    return Finding(effect, "1A", selection=Selection(channels, channels, np.full(10, white / 10), level, left,
                                                     np.arange(10), 1))


@pytest.mark.parametrize("more, said", [(0.03, "viscous"), (0.07, "sublinear_viscous")])
def test_a_correction_is_claimed_where_it_takes_enough_beyond_what_it_corrects(more, said):
    """However sure it is: of a viscous friction 2 % of the squared error were an exponent of 0.96."""
    base, plain = refitted("", [40.0, 40.0], 800.0).selection, refitted("viscous", [10.0, 10.0], 300.0)
    best = refitted("sublinear_viscous", [10.0 * (1 - more), 10.0], 200.0)
    rivals = [best, plain]
    assert not alike(base, plain.selection, best.selection, 3.0)
    found = _considered(rivals, rivals, best, base, {"sublinear_viscous": "viscous"}, lambda finding: True)
    assert found[0].effect == said


@pytest.mark.parametrize("behind, held, named", [(8.0, True, "2B"), (8.0, False, "1A"), (20.0, True, "1A")])
def test_what_its_bounds_alone_hold_gives_way_to_what_does_nearly_as_well(behind, held, named):
    """A loss that grows twentyfold, the most that is allowed, stood before the drift that was hidden by 1.7 errors."""
    variable = replace(compile_model(Library(), "DriveTrain.Rigs.HipKnee", [("thermal_drift", "1A")]).parameters[
        "thermal_drift_1A.k"], min=0.0, max=20.0)
    base, rivals = refitted("", [40.0, 40.0], 800.0).selection, []
    for place, value, more in (("1A", 20.0 if held else 5.0, 0.0), ("2B", 2.0, behind)):
        one, name = refitted("thermal_drift", [10.0, 10.0], 300.0), f"thermal_drift_{place}.k"
        one.selection.white += more / 10
        one.selection.left["white"] = one.selection.left["white"] + np.sqrt(more and 4.0 / 20)  # a gap's error of four
        rivals.append(replace(one, place=place, p_value=0.001, fit=Fit(
            {name: value}, [name], {name: variable}, np.array([value]), np.array([value]), np.eye(1), np.zeros((0, 1)),
            10.0, [], [], np.ones(1))))
    assert gap(rivals[1].selection, rivals[0].selection, "white")[1] == pytest.approx(4.0)
    found = _decide([*rivals], [*rivals], base, {}, lambda finding: True, False)
    assert found.accepted and found.place == named


def with_coefficient(effect, place, coefficient, value):
    """A refitted candidate with a coefficient of some value, which the model bounds."""
    name, finding = f"{effect}_{place}.{coefficient}", refitted(effect, [10.0, 10.0], 300.0)
    variable = compile_model(Library(), HIP_KNEE, [(effect, place)]).parameters[name]
    fit = Fit({name: value}, [name], {name: variable}, np.array([value]), np.array([value]), np.eye(1),
              np.zeros((0, 1)), 10.0, [], [], np.ones(1))
    return replace(finding, place=place, p_value=0.001, fit=fit)


@pytest.mark.parametrize("share, named", [(-1.0, "reference_offset"), (-0.5, "direction_asymmetry")])
def test_what_its_bounds_hold_does_not_come_back_as_what_its_correction_corrects(share, named):
    """An offset of the reference was an asymmetry of the whole loss, which the bounds held, for one of low speeds, of
    which they did not, was taken in its place first, and gave way to what it corrects then."""
    base = refitted("", [40.0, 40.0], 800.0).selection
    rivals = [with_coefficient("direction_asymmetry", "2B", "a", share),
              with_coefficient("stribeck_asymmetry", "2B", "fs_a", -0.05),
              with_coefficient("reference_offset", "knee", "o", -0.7)]
    found = _decide([*rivals], [*rivals], base, {"stribeck_asymmetry": "direction_asymmetry"}, lambda f: True, False)
    assert found.accepted and found.effect == named
    assert {t["effect"] for t in found.twins} == {f.effect for f in rivals} - {named}


@pytest.mark.parametrize("value, others", [(1.0, {"2B"}), (0.5, set())])
def test_what_is_refused_for_its_bound_is_an_alternative_of_one_that_is_at_a_bound_too(value, others):
    """A loss that changes with the temperature was named at one stage, at the end of its range, and refused at the
    other, the true one, for being there."""
    base = refitted("", [40.0, 40.0], 800.0).selection
    rivals = [with_coefficient("temperature_dependence", place, "k", k)
              for place, k in (("1B", value), ("2B", 1.0))]
    rivals[1].refused = ENDLESS
    found = _decide([*rivals], [*rivals], base, {}, lambda f: True, False)
    assert found.accepted and {t["place"] for t in found.twins} == others


@pytest.mark.parametrize("value, error, end", [
    (0.0, 0.1, False), (0.4, 0.1, False), (1.0, 0.1, True), (1.0, 1.0, False)])
def test_a_size_at_the_end_of_what_is_allowed_is_no_measurement_but_none_at_all_is(value, error, end):
    """Nor does one end there that may as well be half as large: a factor of a loss that is small itself."""
    model = compile_model(Library(), "DriveTrain.Rigs.HipKnee", [("load_nonlinearity", "1A")])
    name = "load_nonlinearity_1A.d"
    variable = replace(model.parameters[name], min=0.0, max=1.0)
    fit = Fit({name: value}, [name], {name: variable}, np.array([value]), np.array([value]), error ** 2 * np.eye(1),
              np.zeros((0, 1)), 10.0, [], [], np.ones(1))
    assert pressed(model, fit) == end


def fitted_of(some, takes, monkeypatch, unseen=False):
    """The candidates that are refitted, where each takes a share of what is lost, and scores may see none of them."""
    fitted, rng = [], np.random.default_rng(5)
    lost, noise = rng.standard_normal((2, BLOCKS * EACH))

    def refitted(*given):
        for finding in given[4]:
            fitted.append(finding.key)
            finding.selection = residual_of(noise + np.sqrt(1.0 - takes.get(finding.key, 0.1)) * lost)
            yield finding
    monkeypatch.setattr(trials, "_refitted", refitted)
    monkeypatch.setattr(trials, "_refit_from", lambda *given: None)
    monkeypatch.setattr(trials, "_unseen", lambda *given: unseen)
    dataset = SimpleNamespace(library=Library())
    monkeypatch.setattr(dataset.library, "ahead", lambda *given: None)
    scores = SimpleNamespace(akin=lambda key, share: [], single=None, weights=[2.0],
                             table=SimpleNamespace(channels=["C_H"]))
    trials.refit_best(dataset, compile_model(dataset.library, HIP_KNEE, []), None, scores, some,
                      residual_of(noise + lost), None, lambda said: None)
    return fitted


def scored(keys, errors=None):
    """Findings with their scores, best first, and the errors that are predicted of some."""
    return [Finding(*key, statistic=20.0 - k, p_value=0.001, predicted_error={"C_H": (errors or {}).get(key, 0.3)})
            for k, key in enumerate(keys)]


@pytest.mark.parametrize(("effect", "share", "asked"), [
    ("load_hysteresis", 0.7, True), ("load_hysteresis", 0.3, False), ("viscous", 0.7, False)])
def test_a_memory_that_takes_half_of_the_best_is_refitted_at_its_other_places(effect, share, asked, monkeypatch):
    some = scored([("time_delay", "torque"), (effect, "1A"), *(("torque_saturation", f"motor{n}") for n in range(8)),
                   (effect, "1A+2A")])
    takes = {("time_delay", "torque"): 1.0, (effect, "1A"): share}
    assert ((effect, "1A+2A") in fitted_of(some, takes, monkeypatch)) == asked


@pytest.mark.parametrize(("error", "asked"), [(0.14, True), (0.4, False)])
def test_what_is_predicted_to_leave_least_is_refitted_whatever_its_score(error, asked, monkeypatch):
    """A hysteresis over a long way was predicted to take half of the error, came thirteenth, and was not looked at."""
    last = "load_hysteresis", "2A"
    some = scored([*(("viscous", f"place{n}") for n in range(12)), last], {last: error})
    assert (last in fitted_of(some, {("viscous", "place0"): 0.9}, monkeypatch)) == asked


@pytest.mark.parametrize("none", [True, False])
def test_what_one_that_does_as_well_corrects_is_refitted_where_its_loss_is_taken_for_none(none, monkeypatch):
    """Its score is nothing there, of whatever size it is: an asymmetry is a share of the loss."""
    some = scored([("torque_offset", "motor2"), ("stribeck_asymmetry", "2A"), ("direction_asymmetry", "2A")])
    some[2].statistic, some[2].p_value = 0.0, 1.0
    takes = dict.fromkeys([some[0].key, some[1].key], 1.0)
    monkeypatch.setattr(trials, "_remembers", lambda *given: False)
    assert (some[2].key in fitted_of(some, takes, monkeypatch, none)) == none


@pytest.mark.parametrize(("effect", "place", "everywhere", "soon"), [
    ("presliding", "1A", False, True), ("presliding", "1A", True, False), ("low_pass", "torque", True, True)])
def test_what_a_memory_takes_right_after_turns_is_told_from_what_it_takes_everywhere(effect, place, everywhere, soon):
    """Or by a filter, whatever it takes: so it was between two samples, not all over the way."""
    way = np.tile(np.repeat([1.0, -1.0], 100), 10)
    after = np.arange(way.size) % 100 < 3
    left = np.ones((1, way.size))
    mended = np.where(after | everywhere, 0.2, 1.0)[None]
    dataset = SimpleNamespace(
        library=Library(), speeds=way[None], time=0.01 * np.arange(way.size), run=np.zeros(way.size, int),
        passes=np.arange(way.size) // 100, picks=lambda part: [(None, np.ones(way.size, bool))],
        residuals=lambda model, *given: SimpleNamespace(residual=lambda values: mended if model.keys else left))
    fit = SimpleNamespace(free=[], parameters={}, values=[], weights=np.ones(1))
    finding = Finding(effect, place)
    finding.fit = fit
    assert _soon(dataset, (compile_model(dataset.library, HIP_KNEE, []), fit), finding) == soon


def test_one_that_all_samples_bring_to_a_bound_is_weighed_again_with_that(monkeypatch):
    """A trial fits few samples: of two that do as well, the first was told at its bound, and had not been there."""
    at, bound, asked = {}, {}, []
    findings = [Finding(e, "1A") for e in ("viscous", "stribeck")]
    for f in findings:
        f.fit = SimpleNamespace(free=[f"{f.effect}_1A.b"], at_bound=lambda name, own=f.effect: at.get(own))

    def decided(findings, *given):
        found = next((f for f in findings if not at.get(f.effect)), findings[0])
        found.accepted = True
        asked.append(found.effect)
        return found

    def fitted(finding, *given):
        at[finding.effect] = bound.get(finding.effect)
        return True

    for name, does in (("_decide", decided), ("fit_to_all", fitted), ("_can_be_searched", lambda *given: True),
                       *((n, lambda *given: None) for n in ("compile_model", "corrections", "_against"))):
        monkeypatch.setattr(decide, name, does)
    model, base = SimpleNamespace(rig="", keys=[]), SimpleNamespace(usual=None)
    for bound, told in (({"viscous": "max"}, "stribeck"), ({"viscous": "max", "stribeck": "max"}, "viscous")):
        at.clear()
        asked.clear()
        found = decide._chosen(SimpleNamespace(library=None), None, model, None, findings, findings, base, None, None)
        assert found.effect == told and found.accepted and len(asked) <= 3

"""How rivals are compared on folds that they were not fitted to."""

import numpy as np
import pytest

from pycosim.diagnosis.crossval import _cross_validate, _in_branches, _predictive
from pycosim.diagnosis.finding import Finding
from pycosim.diagnosis.rivals import CONTESTED, KINDS, too_many
from pycosim.fit.bounded import bounded

FREE = np.full(2, np.inf)


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


def test_so_many_effects_leave_no_name_but_many_places_of_a_few_do():
    def with_twins(effects, places):
        return Finding("viscous", "1A", twins=[{"effect": e, "place": p} for e in effects for p in places])

    others = ["stribeck", "presliding", "cross_load", "payload", "torque_offset", "low_pass"][:CONTESTED + 1]
    assert not too_many(with_twins(others[:CONTESTED], ["1A"]), {})
    assert too_many(with_twins(others, ["1A"]), {})
    assert not too_many(with_twins(others[:KINDS - 1], ["1A", "1B", "2B"]), {})
    assert too_many(with_twins(others[:KINDS], ["1A", "1B"]), {})
    assert not too_many(with_twins(others, ["1A"]), {"stribeck": "viscous"}), "it does as well because that does"
    assert too_many(with_twins(others, ["1A"]), {"stribeck": "time_delay"}), "which is not among them"


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


def test_no_rival_does_better_by_taking_samples_without_load_for_the_noisier_branch():
    loaded = np.arange(100)[None] < 60
    beside = np.where(loaded, 1.0, 1.3)
    other = np.arange(100)[None] < 50  # ten samples more in the noisy branch, and a response 2 % smaller
    level = 0.98 * np.where(other, 1.0, 1.3)
    assert _in_branches(level, other, beside, loaded) == pytest.approx(0.98 * beside)
    assert _in_branches(level, loaded, beside, loaded) is level

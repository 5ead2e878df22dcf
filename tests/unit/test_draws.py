"""Draws from a fit: its covariance where nothing binds, the bounds where they do, even along null directions."""

import numpy as np
import pytest
from scipy import stats

from pycosim.core.errors import UnknownNameError
from pycosim.core.units import Variable
from pycosim.fit.least_squares import Fit


def fitted(values, covariance, bounds, null=(), unbounded=None):
    """A fit of parameters a, b, ... with these numbers."""
    names = list("abcdefgh")[:len(values)]
    variables = {n: Variable(n, "1", "", v, low, high, 1.0) for n, v, (low, high) in zip(names, values, bounds)}
    values = np.array(values, float)
    return Fit({**dict(zip(names, values)), "fixed": 7.0}, names, variables, values,
               values if unbounded is None else np.array(unbounded, float), np.array(covariance, float),
               np.array(null, float).reshape(len(null), len(values)), 100.0, [], [], np.ones(1))


def covariance(size, seed):
    root = np.random.default_rng(seed).standard_normal((size, size)) * np.logspace(-3, 0, size)[:, None]
    return root @ root.T


@pytest.mark.parametrize("size", [1, 4, 8])
def test_many_unbounded_draws_have_the_mean_and_covariance_of_the_fit(size):
    wanted, centre = covariance(size, 3), np.linspace(1, 2, size)
    found = fitted(centre, wanted, [(-np.inf, np.inf)] * size).draw(100_000, bounded=False).values
    spread = np.sqrt(np.diag(wanted))
    assert (np.abs(found.mean(axis=0) - centre) < 0.05 * spread).all()
    assert (np.abs(np.atleast_2d(np.cov(found.T)) - wanted) < 0.05 * np.outer(spread, spread)).all()


def test_over_what_is_determined_the_covariance_is_the_fits_with_a_null_direction_too():
    """a and b enter as their sum alone: unbounded draws stay at the estimate along their difference."""
    wanted = np.array([[0.01, 0.01, 0], [0.01, 0.01, 0], [0, 0, 0.04]])
    found = fitted([1, 2, 3], wanted, [(0, 9)] * 3, [[1, -1, 0]]).draw(100_000, bounded=False).values
    assert np.allclose(np.cov(found.T), wanted, atol=0.05 * 0.04) and np.ptp(found[:, 0] - found[:, 1]) < 1e-9


def test_bounded_draws_are_the_truncated_distribution_and_say_what_they_cut():
    fit = fitted([1.0, 0.0], [[0.25, 0.12], [0.12, 0.09]], [(0.8, 5), (-9, 9)], unbounded=[0.9, 0.0])
    drawn = fit.draw(50_000)
    free = stats.multivariate_normal([0.9, 0], fit.covariance, seed=5).rvs(400_000)
    kept = free[free[:, 0] >= 0.8]
    assert drawn.values[:, 0].min() >= 0.8
    assert np.allclose(drawn.values.mean(axis=0), kept.mean(axis=0), atol=0.01)
    assert np.allclose(np.cov(drawn.values.T), np.cov(kept.T), atol=0.01)
    assert drawn.outside == {"a": pytest.approx(stats.norm.cdf(-0.2), abs=0.01)}
    line, = drawn.lines()
    assert line.startswith("a: 42") and "0.9," in line


def test_far_beyond_a_bound_the_sampler_takes_over():
    """The estimate lies five standard deviations outside: draws are an exponential tail at the bound."""
    fit = fitted([0.0, 1.0], np.diag([0.01, 0.01]), [(0, 1), (-9, 9)], unbounded=[-0.5, 1.0])
    found = fit.draw(5000).values
    tail = stats.truncnorm(5, 15, loc=-0.5, scale=0.1)
    assert stats.kstest(found[:, 0], tail.cdf).pvalue > 1e-3
    assert stats.kstest(found[:, 1], "norm", (1, 0.1)).pvalue > 1e-3


def test_along_null_directions_draws_fill_what_the_bounds_allow():
    """a + b = 1 within 0.01, both from 0 to 0.8: the difference is even from -0.6 to 0.6, and c is not touched."""
    fit = fitted([0.4, 0.6, 2.0], [[2.5e-5, 2.5e-5, 0], [2.5e-5, 2.5e-5, 0], [0, 0, 0.01]],
                 [(0, 0.8), (0, 0.8), (-9, 9)], [[1, -1, 0]])
    found = fit.draw(4000, seed=2).values
    a, b, c = found.T
    assert found[:, :2].min() >= 0 and found[:, :2].max() <= 0.8
    assert stats.kstest(a - b, "uniform", (-0.6, 1.2)).pvalue > 1e-3
    assert np.std(a + b) == pytest.approx(0.01, rel=0.1) and np.std(c) == pytest.approx(0.1, rel=0.1)


def test_arrays_come_in_the_order_asked_for():
    drawn = fitted([1, 2], np.diag([0.01, 0.04]), [(0, 9)] * 2).draw(5, seed=1)
    found = drawn.array(["b", "fixed", "a"])
    assert found.shape == (5, 3) and (found[:, 1] == 7).all() and (found[:, 0] == drawn.values[:, 1]).all()
    assert drawn.array([]).shape == (5, 0)
    assert (fitted([1, 2], np.diag([0.01, 0.04]), [(0, 9)] * 2).draw(5, seed=1).values == drawn.values).all()
    with pytest.raises(UnknownNameError, match="no parameter 'fixd' in this fit.*closest: 'fixed'"):
        drawn.array(["fixd"])


def test_nothing_free_gives_sets_of_nothing():
    drawn = fitted([], np.zeros((0, 0)), []).draw(3)
    assert drawn.values.shape == (3, 0) and (drawn.array(["fixed"]) == 7).all()

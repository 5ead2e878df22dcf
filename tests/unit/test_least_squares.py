"""Quadratic forms within bounds, and least squares from moments alone."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear

from benchmarks.real_logs.make import make
from pycosim.compile import Library, compile_model
from pycosim.core.errors import NoAnswerError
from pycosim.data.dataset import Dataset
from pycosim.fit import least_squares as fits
from pycosim.fit.bounded import _pressed, bounded
from pycosim.fit.damped import solve
from pycosim.study.parse import load_study


def test_the_best_within_bounds_is_that_of_scipy():
    rng, given_up = np.random.default_rng(0), 0
    for k in range(300):
        p = rng.integers(1, 14)
        root = rng.standard_normal((p + rng.integers(1, 6), p))
        a, b = root.T @ root, 3 * rng.standard_normal(p)
        low, high = -rng.exponential(1, p) * (rng.random(p) < 0.8), rng.exponential(1, p)
        value, x = bounded(a, b, low, high)
        values, vectors = np.linalg.eigh(a)
        y = lsq_linear(np.sqrt(values)[:, None] * vectors.T, vectors.T @ b / np.sqrt(values),
                       (low, np.maximum(high, low + 1e-9)), method="bvls", max_iter=500).x
        assert np.all((x >= low - 1e-9) & (x <= high + 1e-9))
        assert value >= 2 * b @ y - y @ a @ y - 1e-6 * abs(value)
        given_up += _pressed(a, b, low, high, np.zeros(p, dtype=int)) is None
        near = np.choose(rng.integers(0, 3, p), [low, high, np.full(p, np.nan)])
        assert np.isclose(bounded(a, b, low, high, near)[0], value, rtol=1e-9)
    assert not given_up


def of(model, measured):
    """Moments of a residual and of its derivative by differences, counted."""
    asked = []

    def gram(x):
        asked.append(x)
        steps = 1e-6 * np.maximum(np.abs(x), 1.0)
        slope = np.array([(model(x + h) - model(x - h)) / (2 * h.max()) for h in np.diag(steps)])
        rows = np.concatenate([slope, (measured - model(x))[None]])
        return rows @ rows.T

    return gram, asked


TIME = np.linspace(0.05, 4, 200)


def decay(x):
    """A sum of a constant, and of a power of time: as bent as a sublinear viscosity."""
    return x[0] + x[1] * TIME ** x[2]


@pytest.mark.parametrize("truth", [(0.0, 2.0, 0.2), (1.0, 0.5, 0.8), (0.0, 1.0, 0.05)])
def test_damped_steps_end_where_scipy_does_or_lower(truth):
    measured = decay(truth) + 0.01 * np.sin(37 * TIME)
    low, high, start = np.array([0.0, 0.0, 0.05]), np.array([5.0, 50.0, 1.0]), np.array([0.5, 0.1, 0.5])
    gram, asked = of(decay, measured)
    x = solve(gram, start, ["c", "b", "a"], low, high, 60)
    other = least_squares(lambda z: decay(z) - measured, start, bounds=(low, high), x_scale=[1.0, 0.1, 0.3])
    assert np.all((x >= low) & (x <= high))
    assert gram(x)[-1, -1] <= 2 * other.cost * (1 + 1e-5)
    assert len(asked) < 60  # ended, and not by the limit


def test_units_of_a_parameter_change_nothing():
    measured = decay((0.3, 2.0, 0.4))
    ends = []
    for unit in (1.0, 1e6):
        gram, asked = of(lambda z: decay([z[0], z[1] / unit, z[2]]), measured)
        low, high = np.array([0.0, 0.0, 0.05]), np.array([5.0, 50.0 * unit, 1.0])
        ends.append(solve(gram, np.array([0.5, 0.1 * unit, 0.5]), ["c", "b", "a"], low, high, 60) / [1, unit, 1])
    assert np.allclose(*ends, rtol=1e-3)


def test_a_start_that_leaves_nothing_is_the_answer_without_a_warning():
    with np.errstate(all="raise"):
        assert solve(lambda z: np.diag([1.0, 0.0]), np.array([2.0]), ["k"], np.array([0.0]), np.array([3.0]), 60) == 2.0


def test_no_finite_answer_at_the_start_is_told_with_the_values():
    with pytest.raises(NoAnswerError, match="no finite answer at the start, k = 2;"):
        solve(lambda z: np.full((2, 2), np.nan), np.array([2.0]), ["k"], np.array([0.0]), np.array([3.0]), 60)


def test_a_step_to_where_there_is_no_answer_is_taken_back():
    def gram(z):
        r = np.array([1.0 - z[0] if z[0] < 0.9 else np.nan])
        rows = np.array([[1.0], r])
        return rows @ rows.T
    x = solve(gram, np.array([0.0]), ["k"], np.array([-5.0]), np.array([5.0]), 60)
    assert 0.5 < x[0] < 0.9


def test_a_fit_without_an_effect_starts_where_there_is_an_answer(monkeypatch):
    tried = []

    def fit(dataset, model, start, **options):
        tried.append((start, options))
        if "gear.mu" in start:
            raise NoAnswerError("no finite answer")
        return "fitted"
    monkeypatch.setattr(fits, "fit", fit)
    dataset = SimpleNamespace(base=SimpleNamespace(parameters={"gear.f0": None, "gear.mu": None}))
    start = {"gear.f0": 0.1, "gear.mu": 0.4, "viscous_gear.b": 0.2}
    assert fits.fit_without(dataset, None, start, most=10) == "fitted"
    assert tried == [(start, {"most": 10}), ({"viscous_gear.b": 0.2}, {"most": 10})]


@pytest.mark.parametrize("beyond", [0.4, -0.4])
def test_a_fit_that_starts_where_a_size_changes_nothing_comes_back(beyond, tmp_path):
    """A difference of loads counts to the load term alone; beyond it nothing pulls at it, and the fit stayed there."""
    dataset = Dataset(load_study(make("geared:load_hysteresis:2.4:3", tmp_path, quick=True)), Library())
    model = compile_model(dataset.library, dataset.study.rig, [("load_hysteresis", "gear")])
    names = ["load_hysteresis_gear.h", "load_hysteresis_gear.mu_dif"]
    best = fits.fit(dataset, model, dict(zip(names, [0.02, 0.01])))
    found = fits.fit(dataset, model, {**best.parameters, names[1]: beyond})
    assert [found.parameters[n] for n in names] == pytest.approx([best.parameters[n] for n in names], rel=1e-3)
    assert found.identifiable(names[1])


def test_a_size_that_no_sample_feels_however_small_is_not_fitted_again(tmp_path, monkeypatch):
    """A friction that has fallen before the slowest sample: halves of its size led to the start that had been tried."""
    dataset = Dataset(load_study(make("geared:none::3", tmp_path, quick=True)), Library())
    model = compile_model(dataset.library, dataset.study.rig, [("stribeck", "gear")])
    done, refine = [], fits._refine
    monkeypatch.setattr(fits, "_refine", lambda *given, **named: done.append(1) or refine(*given, **named))
    free = [n for n in dataset.parameters.free(model) if not n.startswith("stribeck")]
    gone = {"stribeck_gear.fs": 0.05, "stribeck_gear.ws": 1e-4 * dataset.w_min}
    found = fits.fit(dataset, model, gone, [*free, "stribeck_gear.fs"])
    assert len(done) == 1 and found.parameters["stribeck_gear.fs"] == pytest.approx(0.05)

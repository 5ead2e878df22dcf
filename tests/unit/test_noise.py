"""Noise that remembers: whitening, covariance and likelihood are exact across gaps; the estimate finds the truth."""

import numpy as np
import pytest
from scipy.signal import lfilter

from benchmarks.plan.run import baseline, dataset
from pycosim.data.noise import Noise, chained, fit_noise, likelier
from pycosim.data.scatter import spread
from pycosim.data.segmentation import Pairs
from pycosim.fit import least_squares

RNG = np.random.default_rng(0)
TIME = np.delete(np.arange(80) * 0.01, [20, 21, 22, *range(40, 55)])
GROUP = (np.arange(len(TIME)) > 30).astype(int)
NOISE = Noise(0.3, 0.5, 0.2)


def dense(linked):
    """Covariance matrix of the noise at TIME."""
    known = 0.25 * np.exp(-np.abs(TIME[:, None] - TIME) / 0.2)
    if not linked:
        known *= GROUP[:, None] == GROUP
    return 0.09 * np.eye(len(TIME)) + known


@pytest.mark.parametrize("linked", [True, False])
def test_whitened_noise_is_white_and_its_transpose_the_transpose(linked):
    chain = chained(TIME, GROUP, linked)
    matrix = NOISE.whiten(np.eye(len(TIME)), chain).T
    assert matrix @ dense(linked) @ matrix.T == pytest.approx(np.eye(len(TIME)), abs=1e-8)
    values = RNG.standard_normal(len(TIME))
    assert NOISE.whiten_transposed(values, chain) == pytest.approx(matrix.T @ values, abs=1e-8)


@pytest.mark.parametrize("linked", [True, False])
def test_covariance_of_weighted_sums(linked):
    rows = RNG.standard_normal((3, len(TIME)))
    found = NOISE.covariance(rows, chained(TIME, GROUP, linked))
    assert found == pytest.approx(rows @ dense(linked) @ rows.T, abs=1e-12)


def halves(time, lag, noise):
    """Covariance of half the differences of noise at these times and a lag later."""
    def slow(a, b):
        return noise.slow ** 2 * 2 * np.exp(-np.abs(a[:, None] - b) / noise.memory)
    there, back = time, time + lag
    across = slow(there, back)
    return (slow(there, there) + slow(back, back) - across - across.T) / 4 + noise.white ** 2 * np.eye(len(time))


def test_half_a_difference_of_ways_out_and_back_has_less_of_the_slow_part_near_the_turn():
    time = np.delete(np.arange(60) * 0.01, [7, 8, 30])
    lag = 2 * (0.65 - time)
    chain, exact = chained(time, np.zeros(len(time)), False, lag), halves(time, lag, NOISE)
    matrix = NOISE.whiten(np.eye(len(time)), chain).T
    assert matrix @ exact @ matrix.T == pytest.approx(np.eye(len(time)), abs=1e-8)
    rows = RNG.standard_normal((3, len(time)))
    assert NOISE.covariance(rows, chain) == pytest.approx(rows @ exact @ rows.T, abs=1e-12)


def test_the_estimate_finds_the_noise_of_half_differences():
    rng, found, dt, n = np.random.default_rng(4), [], 0.01, 150
    phi = np.exp(-dt / 0.5)
    for _ in range(6):
        shocks = rng.standard_normal(2 * n * 150) * np.sqrt(1 - phi ** 2)
        raw = 0.7 * lfilter([1], [1, -phi], shocks) + rng.standard_normal(len(shocks))
        out, back = raw.reshape(-1, 2, n)[:, 0], raw.reshape(-1, 2, n)[:, 1, ::-1]
        time = dt * np.arange(len(raw)).reshape(-1, 2, n)
        lag = time[:, 1, ::-1] - time[:, 0]
        values = np.sqrt(2) * (out - back) / 2
        noise = fit_noise(values.ravel(), chained(time[:, 0].ravel(), np.arange(150).repeat(n), False, lag.ravel()))
        found.append((noise.white, noise.slow, noise.memory))
    assert np.mean(found, axis=0) == pytest.approx([1.0, 0.7, 0.5], rel=0.1)


def test_white_noise_of_interpolated_ways_back_is_that_of_their_means():
    rng, n = np.random.default_rng(7), 4000
    found = Pairs(np.arange(n), np.arange(n)[::-1] + n, np.arange(n)[::-1] + n + 1, np.linspace(0.1, 0.9, n))
    ratio = []
    for _ in range(200):
        there, back = found.at(rng.standard_normal(2 * n + 1))
        values = (there - back) / np.sqrt(2)
        ratio.append(values.mean() ** 2 * n)
    noise = fit_noise(values, chained(np.arange(n) * 0.01, np.zeros(n), False, np.full(n, 50.0), found.colour))
    own = 0.5 + 0.5 * np.mean(found.weight ** 2 + (1 - found.weight) ** 2)
    assert found.colour == pytest.approx(1 / own, rel=0.01)  # what is shared by neighbours comes on top
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.25)
    assert noise.white == pytest.approx(1.0, abs=0.03) and noise.slow == 0.0


def test_noise_starts_anew_where_time_runs_back_or_groups_are_not_linked():
    chain = chained(np.array([0, 1, 2, 0, 1, 5.0, 6]), np.array([0, 0, 0, 1, 1, 1, 2]), False)
    assert chain.gaps.tolist() == [np.inf, 1, 1, np.inf, 1, 4, np.inf]


@pytest.mark.parametrize(("memory", "slow"), [(0.3, 0.5), (1.0, 0.3), (2.0, 0.7)])
def test_the_estimate_finds_the_noise_that_the_fit_took_a_part_of(memory, slow):
    rng, found = np.random.default_rng(1), []
    time = np.arange(40000) * 0.01
    kept = (time % 7.3 < 6.8) & (rng.random(len(time)) > 5e-4)
    phi = np.exp(-0.01 / memory)
    for _ in range(6):
        drift = lfilter([1], [1, -phi], rng.standard_normal(len(time)) * np.sqrt(1 - phi ** 2)) * slow
        values = (drift + rng.standard_normal(len(time)))[kept]
        basis = np.linalg.qr(np.array([np.ones(kept.sum()), np.sign(np.sin(time[kept] / 2))]).T)[0].T
        values = values - basis.T @ (basis @ values)
        noise = fit_noise(values, chained(time[kept], np.floor(time[kept] / 7.3), True), basis)
        found.append((noise.white, noise.slow, noise.memory))
    assert np.mean(found, axis=0) == pytest.approx([1.0, slow, memory], rel=0.08)


def test_white_noise_has_no_slow_part():
    noise = fit_noise(np.random.default_rng(2).standard_normal(5000), chained(np.arange(5000.0), np.zeros(5000), True))
    assert noise.slow == 0.0 and noise.white == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("seed", [1002, 1003])
def test_the_likelihood_s_other_valley_at_the_longest_memory_is_not_taken_for_the_least(seed):
    data = dataset(baseline(), seed, "gravity_model")
    found = least_squares.fit(data, data.base, part="all").noise
    assert all(own.slow < 0.1 and own.memory < 3.0 for own in found), found


def test_noise_behind_a_filter_has_two_memories_and_effects_meet_the_longer_one():
    """White noise behind a filter of 30 ms, slow noise of 0.6 s and white noise of its own."""
    step, n, found = 0.005, 8000, []
    chain = chained(step * np.arange(n), np.zeros(n, int), True)
    for seed in range(8):
        rng, values = np.random.default_rng(seed), 0.03 * np.random.default_rng(seed + 100).standard_normal(n)
        for size, memory in ((0.03, 0.03), (0.05, 0.6)):
            keep = np.exp(-step / memory)
            values += size * lfilter([np.sqrt(1 - keep ** 2)], [1, -keep], rng.standard_normal(n))
        found.append(fit_noise(values, chain))
    mean = 0.03 ** 2 * step + 2 * 0.03 ** 2 * 0.03 + 2 * 0.05 ** 2 * 0.6  # variance of a long mean, times its time
    told = [f.white ** 2 * step + 2 * f.slow ** 2 * f.memory for f in found]
    assert np.median(told) == pytest.approx(mean, rel=0.35)
    assert 0.25 < np.median([f.memory for f in found]) < 1.2


@pytest.mark.parametrize("period", [1.0, 2.5, 5.0])
def test_what_is_smooth_and_missing_takes_nothing_of_the_white_noise(period):
    """Means over stretches tell of it as slow noise, and of white noise beside it next to nothing."""
    time = 0.005 * np.arange(7000)
    for seed in range(3):
        values = 0.11 * np.random.default_rng(seed).standard_normal(len(time)) + 0.3 * np.sin(2 * np.pi * time / period)
        assert fit_noise(values, chained(time, np.zeros(len(time), int), False)).white == pytest.approx(0.11, rel=0.06)


def drawn(rng, seconds, slow, memory, step=0.01):
    """White noise of 1 with slow noise."""
    keep, n = np.exp(-step / memory), int(seconds / step)
    drift = lfilter([np.sqrt(1 - keep ** 2)], [1, -keep], rng.standard_normal(n + 3000))[3000:]
    return slow * drift + rng.standard_normal(n)


@pytest.mark.parametrize("slow, memory", [
    pytest.param(*noise, marks=pytest.mark.long) for noise in ((1.0, 1.0), (0.0, 1.0), (0.5, 0.1), (2.0, 4.0))])
def test_a_column_makes_noise_alone_likelier_by_half_a_chi_squared(slow, memory):
    """Also noise that a log of 20 s holds only five times: a column that lies in it gains no more."""
    found = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        noise, time = drawn(rng, 20.0, slow, memory), 0.01 * np.arange(2000)
        chain, column = chained(time, np.zeros(2000), True), np.sin(2 * np.pi * rng.uniform(0.1, 1.0) * time)
        found.append(2 * likelier(noise, chain, np.ones((1, 2000)), column[None]))
    assert np.median(found) == pytest.approx(0.455, rel=0.6)  # of chi-squared with one degree of freedom
    assert np.count_nonzero(np.array(found) > 3.84) <= 6  # 2 of 40 expected; more than 6 once in 300


@pytest.mark.parametrize("noise", [Noise(1.0, 0.4, 1.0), Noise(1.0, 2.0, 3.0), Noise(1.0, 0.0, 0.0)])
def test_slow_noise_is_told_by_as_many_values_as_it_has_beside_the_white(noise):
    """The trace of its smoother, as matrices; white noise alone by all samples."""
    time = 0.01 * np.arange(1500)
    chain = chained(time, np.zeros(len(time)), True)
    if not noise.slow:
        assert noise.freedom(chain) == len(time)
        return
    slow = noise.slow**2 * np.exp(-np.abs(time[:, None] - time) / noise.memory)
    values = np.trace(np.linalg.solve(slow + noise.white**2 * np.eye(len(time)), slow))
    assert noise.freedom(chain) == pytest.approx(values, rel=0.15)


def test_a_column_that_is_there_makes_samples_likelier_by_what_it_explains():
    """As a known noise tells: half its squares, whitened; beside a derivative that goes with it, less."""
    rng, time = np.random.default_rng(0), 0.01 * np.arange(2000)
    chain, column = chained(time, np.zeros(2000), True), np.sign(np.sin(2 * np.pi * 0.3 * time))
    noise = drawn(rng, 20.0, 0.5, 0.3)
    white = Noise(1.0, 0.5, 0.3).whiten(0.5 * column, chain)
    gain = likelier(noise + 0.5 * column, chain, np.ones((1, 2000)), column[None])
    assert gain == pytest.approx(0.5 * white @ white, rel=0.5)
    near = column + 0.1 * rng.standard_normal(2000)
    assert likelier(noise + 0.5 * column, chain, near[None], column[None]) < 0.1 * gain
    scaled = likelier(noise + 0.5 * column, chain, np.full((1, 2000), 1e-6), 1e9 * column[None])
    assert scaled == pytest.approx(gain, rel=1e-6)


@pytest.mark.parametrize("passes", [40, 900])
def test_what_turns_with_each_pass_is_seen_in_logs_of_any_length(passes):
    """Where not all passes are used, every other one would go the same way."""
    turn, n = np.repeat(np.arange(passes), 100), 100 * passes
    chain, column = chained(0.01 * np.arange(n), turn, True), 1.0 - 2.0 * (turn % 2)
    noise = np.random.default_rng(0).standard_normal(n)
    assert likelier(noise + 0.2 * column, chain, np.ones((1, n)), column[None]) > 20


def test_too_few_samples_are_made_no_likelier():
    chain = chained(np.arange(5.0), np.zeros(5), True)
    assert likelier(np.ones(5), chain, np.zeros((0, 5)), np.ones((1, 5))) == 0.0


def test_no_rows_are_whitened_to_none():
    """The wrapper of the solver behind it spoils memory where there is nothing to solve."""
    chain, nothing = chained(TIME, GROUP, True), np.zeros((0, len(TIME)))
    assert NOISE.whiten(nothing, chain).shape == nothing.shape
    assert NOISE.covariance(nothing, chain).shape == (0, 0)


@pytest.mark.parametrize("noise", [0.47, 0.55, 0.65, 0.8, 1.0, 1.5, 3.0])
def test_noise_of_about_a_step_is_found_behind_the_steps(noise):
    """The median of third differences is a whole number of steps: 0.66 steps for a noise of 0.55 and of 0.71."""
    rng = np.random.default_rng(0)
    third = np.abs(np.diff(np.round(noise * rng.standard_normal(20_000) + np.linspace(0, 50, 20_000)), 3))
    assert spread(third, 1.0) / np.sqrt(20) == pytest.approx(np.hypot(noise, 12 ** -0.5), rel=0.1)
    third[::50] += 50.0  # spikes
    assert spread(third, 1.0) / np.sqrt(20) == pytest.approx(np.hypot(noise, 12 ** -0.5), rel=0.1)

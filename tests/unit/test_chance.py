"""Claims about p-values: in logs with nothing hidden none is small more often than it says."""

import numpy as np
import pytest
from axis import scores_of, slow_noise, wandering
from scipy.signal import butter, sosfilt
from scipy.stats import binom, kstest

from benchmarks.real_logs.make import make

LOGS = 60


def white(rng, n):
    return 0.01 * rng.standard_normal(n)


def slow(rng, n):
    return slow_noise(rng, n, 0.01, 0.01)


def filtered(rng, n):
    """Noise behind a filter of 10 Hz: single samples scatter less than means of many tell."""
    return 3.0 * sosfilt(butter(2, 10.0, fs=100.0, output="sos"), white(rng, n)) + 0.1 * white(rng, n)


def louder(rng, n):
    """Noise that grows over the log: its mean square is that of no part of it."""
    return white(rng, n) * np.linspace(0.5, 1.5, n)


@pytest.mark.long
@pytest.mark.parametrize("noise", [white, slow, filtered, louder])
def test_a_p_value_is_small_no_more_often_than_it_says(noise, tmp_path):
    p = []
    for seed in range(LOGS):
        scores = scores_of(wandering(tmp_path, seed, noise), seed)
        p.append(min(scores.family(s.drawn, s.scanned) for s in scores.results if s.visible))
    for level in (0.01, 0.05, 0.25):
        assert np.sum(np.array(p) < level) <= binom.ppf(0.999, LOGS, level), np.sort(p)
    if noise is not filtered:  # of what a filter leaves in the band of a ripple, too much is taken for noise
        assert kstest(p, "uniform").pvalue > 0.001, np.sort(p)


@pytest.mark.long
def test_a_ripple_of_one_cycle_over_the_travel_is_no_chance(tmp_path):
    """What it adds to one stretch it takes off another: by their own scatter no more than 26 agree, by chance 24."""
    scores = scores_of(make("noise_load:torque_ripple:2.4:182000004", tmp_path, quick=True))
    best = max((s for s in scores.results if s.scanned), key=lambda s: s.value)
    assert best.candidate.key == ("torque_ripple", "motor2") and scores.family(best.drawn, True) < 0.01

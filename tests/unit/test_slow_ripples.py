"""Claims about a ripple that is as slow as noise: it is told, and slow noise is no ripple."""

import pytest
from axis import scores_of, slow_noise, wandering


def scored(path, seed, ripple):
    """Noise of the residual, and the ripple with the least chance."""
    slow = 0.005 if ripple else 0.025
    scores = scores_of(wandering(path, seed, lambda rng, n: slow_noise(rng, n, 0.005, slow), ripple))
    best = max((s for s in scores.results if s.scanned), key=lambda s: s.surprise)
    return scores.noise[0], best.candidate.grid["n"], scores.family(best.drawn, True)


def test_a_ripple_of_four_cycles_in_slow_motion_is_no_noise(tmp_path):
    """Half of the squared error was slow noise, and the chance of its ripple 0.97."""
    noise, cycles, chance = scored(tmp_path, 0, 0.035)
    assert noise.slow < 0.015 and chance < 0.01 and cycles == pytest.approx(125.0, abs=11.0)  # a third of a cycle


@pytest.mark.parametrize("seed", range(1, 7))
def test_slow_noise_is_no_ripple(seed, tmp_path):
    noise, _, chance = scored(tmp_path, seed, 0.0)
    assert 0.015 < noise.slow < 0.04 and chance > 0.01

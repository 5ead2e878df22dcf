"""Claims about beats in time: one that goes on whatever the machine does is found, noise and motion have none."""

from types import SimpleNamespace

import numpy as np
import pytest

from pycosim.diagnosis.rhythm import of_mains, rhythms


def told(residual, time, run=None, speeds=None):
    """What `rhythms` says of a residual in N.m, in passes of three seconds."""
    run = np.zeros(len(time), dtype=int) if run is None else run
    block = (np.cumsum(np.diff(time, prepend=time[0]).clip(0)) // 3.0).astype(int)
    problem = SimpleNamespace(time=time, block=block, residual=lambda x: residual[None])
    dataset = SimpleNamespace(
        paired=False, averaged=False, run=run, time=time, channels=["C"], view=lambda part: np.arange(len(time)),
        residuals=lambda *a: problem, base=SimpleNamespace(unit=lambda name: "N.m"),
        speeds=np.sin(2 * np.pi * time / 6)[None] if speeds is None else speeds)
    return rhythms(dataset, None, SimpleNamespace(free=[], parameters={}, values=[]))


def slow(rng, time, memory, size):
    """Noise with a memory [s] beside as much that has none."""
    kept, noise = np.exp(-0.01 / memory), rng.normal(size=len(time))
    for k in range(1, len(noise)):
        noise[k] = kept * noise[k - 1] + np.sqrt(1 - kept ** 2) * noise[k]
    return size * noise + rng.normal(size=len(time))


@pytest.mark.parametrize(("frequency", "runs"), [(0.73, 1), (7.7, 1), (2.31, 3), (0.41, 1)])
def test_a_beat_is_found_with_its_frequency_whatever_its_phase_in_each_run(frequency, runs):
    rng, time = np.random.default_rng(4), np.tile(np.arange(6000) * 0.01, runs)
    run = np.repeat(np.arange(runs), 6000)
    beat = np.sin(2 * np.pi * frequency * time + 2.0 * run)
    found, share, mains = told(beat + slow(rng, time, 1.0, 0.5), time, run)["C"]
    assert found == pytest.approx(frequency, abs=0.01) and 0.2 < share < 0.5 and not mains


@pytest.mark.parametrize(("frequency", "rate", "said"), [
    (50.02, 250.0, True), (60.0, 250.0, True), (40.0, 100.0, True), (20.05, 80.0, True), (47.0, 250.0, False),
    (1.2, 98.8, False), (33.0, 100.0, False)])
def test_mains_are_known_by_their_frequency_also_where_sampling_folds_it(frequency, rate, said):
    assert of_mains(frequency, rate) is said


@pytest.mark.parametrize("memory", [0.05, 1.0, 8.0])
def test_slow_noise_has_no_beat(memory):
    time = np.arange(6000) * 0.01
    for seed in range(20):
        assert told(slow(np.random.default_rng(seed), time, memory, 2.0), time) == {}


def test_what_the_motion_itself_repeats_is_no_beat_of_its_own():
    rng, time = np.random.default_rng(4), np.arange(6000) * 0.01
    gait = np.sin(2 * np.pi * 0.9 * time)
    assert told(gait + rng.normal(size=len(time)), time, speeds=gait[None]) == {}
    assert "C" in told(gait + rng.normal(size=len(time)), time)

"""Claims about p-values: in logs with nothing hidden none is small more often than it says."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import butter, lfilter, sosfilt
from scipy.stats import binom, kstest

from benchmarks.real_logs.make import make
from pycosim.compile import Library
from pycosim.data.dataset import Dataset
from pycosim.diagnosis.decide import scored
from pycosim.fit import least_squares
from pycosim.study.parse import load_study

LIBRARY, LOGS = Library(), 60
STUDY = """
[rig]
model = "DriveTrain.Rigs.LinearAxis"
[parameters]
"carriage.J" = { value = 1.0, fixed = false }
"guide.f0" = { value = 0.05, fixed = false }
"viscous_guide.b" = { value = 0.4, fixed = false }
[data]
runs = ["log.csv"]
[columns]
x = { variable = "motor.phi", unit = "m" }
F = { variable = "force", unit = "N" }
"""


def white(rng, n):
    return 0.01 * rng.standard_normal(n)


def slow(rng, n):
    kept = np.exp(-0.01 / 0.7)
    return white(rng, n) + 0.01 * np.sqrt(1 - kept**2) * lfilter([1.0], [1.0, -kept], rng.standard_normal(n))


def filtered(rng, n):
    """Noise behind a filter of 10 Hz: single samples scatter less than means of many tell."""
    return 3.0 * sosfilt(butter(2, 10.0, fs=100.0, output="sos"), white(rng, n)) + 0.1 * white(rng, n)


def louder(rng, n):
    """Noise that grows over the log: its mean square is that of no part of it."""
    return white(rng, n) * np.linspace(0.5, 1.5, n)


def of(study, seed=0):
    data = Dataset(load_study(study), LIBRARY)
    return scored(data, data.base, least_squares.fit(data, data.base), seed)[1]


def smallest(folder, seed, noise):
    """Family-wise p-values of a sound log of an axis: the smallest of the ripples, and of all else."""
    rng, time = np.random.default_rng(seed), np.arange(0, 60, 0.01)
    rate = [(f, rng.uniform(0, 2 * np.pi), 0.02 / (6 * f)) for f in (0.05, 0.09, 0.13, 0.21)]
    x, v, a = (sum(size * (2 * np.pi * f) ** k * np.sin(2 * np.pi * f * time + p + k * np.pi / 2)
                   for f, p, size in rate) for k in range(3))
    force = a + 0.05 * np.sign(v) + 0.4 * v + noise(rng, len(time))
    pd.DataFrame({"time": time, "x": x, "F": force}).to_csv(folder / "log.csv", index=False)
    (folder / "study.toml").write_text(STUDY)
    scores = of(folder / "study.toml", seed)
    return [min((scores.family(s.drawn, s.scanned) for s in scores.results if s.visible and s.scanned == scanned),
                default=1.0) for scanned in (True, False)]


@pytest.mark.long
@pytest.mark.parametrize("noise", [white, slow, filtered, louder])
def test_a_p_value_is_small_no_more_often_than_it_says(noise, tmp_path):
    p = [min(smallest(tmp_path, seed, noise)) for seed in range(LOGS)]
    for level in (0.01, 0.05, 0.25):
        assert np.sum(np.array(p) < level) <= binom.ppf(0.999, LOGS, level), np.sort(p)
    if noise is not filtered:  # of what a filter leaves in the band of a ripple, too much is taken for noise
        assert kstest(p, "uniform").pvalue > 0.001, np.sort(p)


@pytest.mark.long
def test_a_ripple_of_one_cycle_over_the_travel_is_no_chance(tmp_path):
    """What it adds to one stretch it takes off another: by their own scatter no more than 26 agree, by chance 24."""
    scores = of(make("noise_load:torque_ripple:2.4:182000004", tmp_path, quick=True))
    best = max((s for s in scores.results if s.scanned), key=lambda s: s.value)
    assert best.candidate.key == ("torque_ripple", "motor2") and scores.family(best.drawn, True) < 0.01

"""Claims about a ripple that is as slow as noise: it is told, and slow noise is no ripple."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from pycosim.compile import Library
from pycosim.data.dataset import Dataset
from pycosim.diagnosis.scores import Scores
from pycosim.diagnosis.table import Table
from pycosim.fit import least_squares
from pycosim.study.parse import load_study

LIBRARY = Library()
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


def scored(path, seed, ripple):
    """Noise of the residual, and the ripple with the least chance, of an axis that wanders over 0.2 m."""
    rng, time = np.random.default_rng(seed), np.arange(0, 60, 0.01)
    rate = [(f, rng.uniform(0, 2 * np.pi), 0.02 / (6 * f)) for f in (0.05, 0.09, 0.13, 0.21)]
    x, v, a = (sum(size * (2 * np.pi * f) ** k * np.sin(2 * np.pi * f * time + p + k * np.pi / 2)
                   for f, p, size in rate) for k in range(3))
    force = a + 0.05 * np.sign(v) + 0.4 * v + 0.005 * rng.standard_normal(len(time))
    slow = 0.005 if ripple else 0.025
    drive, kept = rng.standard_normal(len(time)), np.exp(-0.01 / 0.7)
    force += slow * np.sqrt(1 - kept**2) * lfilter([1.0], [1.0, -kept], drive)
    force += ripple * np.sin(125.0 * x + 0.5)
    pd.DataFrame({"time": time, "x": x, "F": force}).to_csv(path / "log.csv", index=False)
    (path / "study.toml").write_text(STUDY)
    data = Dataset(load_study(path / "study.toml"), LIBRARY)
    scores = Scores(Table(data, data.base, least_squares.fit(data, data.base)))
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

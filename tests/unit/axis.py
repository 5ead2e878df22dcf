"""Noise and a ripple in; a study of a linear axis that wanders over 0.2 m, and its scores, out."""

import numpy as np
import pandas as pd
from scipy.signal import lfilter

from pycosim.compile import Library
from pycosim.data.dataset import Dataset
from pycosim.diagnosis.decide import scored
from pycosim.fit import least_squares
from pycosim.study.parse import load_study

LIBRARY, STEP = Library(), 0.01
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


def slow_noise(rng, n, white, slow):
    """White noise and a part that remembers for 0.7 s, each by its standard deviation."""
    fast, kept = white * rng.standard_normal(n), np.exp(-STEP / 0.7)
    return fast + slow * np.sqrt(1 - kept**2) * lfilter([1.0], [1.0, -kept], rng.standard_normal(n))


def wandering(folder, seed, noise, ripple=0.0):
    """A study of one minute; ``noise`` is asked for so many values of a generator."""
    rng, time = np.random.default_rng(seed), np.arange(0, 60, STEP)
    rate = [(f, rng.uniform(0, 2 * np.pi), 0.02 / (6 * f)) for f in (0.05, 0.09, 0.13, 0.21)]
    x, v, a = (sum(size * (2 * np.pi * f) ** k * np.sin(2 * np.pi * f * time + p + k * np.pi / 2)
                   for f, p, size in rate) for k in range(3))
    force = a + 0.05 * np.sign(v) + 0.4 * v + noise(rng, len(time)) + ripple * np.sin(125.0 * x + 0.5)
    pd.DataFrame({"time": time, "x": x, "F": force}).to_csv(folder / "log.csv", index=False)
    (folder / "study.toml").write_text(STUDY)
    return folder / "study.toml"


def scores_of(study, seed=0):
    """Scores of the base model of a study."""
    data = Dataset(load_study(study), LIBRARY)
    return scored(data, data.base, least_squares.fit(data, data.base), seed)[1]

"""The noise that candidates are tested in: what is missing is none of it, and all of it is left where nothing is."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from pycosim.data.noise import chained
from pycosim.diagnosis.scores import Scores

STEP, SECONDS, COLUMNS = 0.01, 13.0, 300
SLOW, MEMORY = 0.4, 1.0  # of white noise of 1; s


def scored(residual, columns, base=0):
    """Scores of one channel beside columns, the first of which are in the base model, before any is worked out."""
    n, own = len(residual), object.__new__(Scores)
    own.table = SimpleNamespace(residual=residual[None], slope=columns[None, :base], time=STEP * np.arange(n),
                                chain=chained(STEP * np.arange(n), np.zeros(n), True))
    own.p, own.weights, own.few, own.columns, own.thin = base, [1.0], 1, list(columns[base:, None]), []
    own.candidates = [SimpleNamespace(parts=[[k]]) for k in range(len(columns) - base)]
    own._noise_of(np.zeros(len(columns)))
    return own


def told(residual, columns):
    """Noise of that channel."""
    own = scored(residual, columns)
    own._noise()
    return own.noise[0]


def drawn(seed, slow=SLOW, memory=MEMORY):
    """Noise of a log that holds its memory a dozen times, or fewer, and columns of a motion of some hertz."""
    rng, time = np.random.default_rng(seed), np.arange(0, SECONDS, STEP)
    keep = np.exp(-STEP / memory)
    drift = lfilter([np.sqrt(1 - keep ** 2)], [1, -keep], rng.standard_normal(len(time) + 1000))[1000:]
    f, phase = rng.uniform(0.05, 1.5, (2, COLUMNS, 1)), rng.uniform(0, 2 * np.pi, (2, COLUMNS, 1))
    columns = np.sin(2 * np.pi * f[0] * time + phase[0]) * np.sin(2 * np.pi * f[1] * time + phase[1])
    return slow * drift + rng.standard_normal(len(time)), columns


def deviations(effect):
    """What limits a slow column, over what it is in truth: the median of some logs."""
    found = []
    for seed in range(16):
        noise, columns = drawn(seed)
        own = told(noise + effect * np.sqrt(2) * columns[seed], columns)
        found.append(np.sqrt(own.white ** 2 * STEP + 2 * own.slow ** 2 * own.memory))
    return np.median(found) / np.sqrt(STEP + 2 * SLOW ** 2 * MEMORY)


@pytest.mark.long
def test_columns_take_no_slow_noise_away_from_a_short_log():
    assert deviations(0.0) == pytest.approx(1.0, abs=0.2)


@pytest.mark.long
def test_an_effect_is_no_noise():
    assert deviations(2.0) < 1.0


@pytest.mark.long
@pytest.mark.parametrize("slow, memory", [(SLOW, MEMORY), pytest.param(1.0, 3.0, marks=pytest.mark.long)])
def test_the_best_of_hundreds_of_columns_is_beyond_chance_where_one_is_there(slow, memory):
    """Also where a constant torque is most of the error, in a log that holds its noise four times."""
    alone = there = 0
    for seed in range(20):
        noise, columns = drawn(seed, slow, memory)
        columns[0] = np.sign(columns[0])
        for effect in (0.0, 1.0):
            own = scored(noise + effect * columns[0], columns)
            path = zip(range(2), own._path(own._thin_moments()[0], 0.0))
            seen = any(own._beyond_chance(*own._used(beta)) for _, beta in path if beta.any())
            alone, there = alone + (seen and not effect), there + (seen and effect > 0)
    assert alone <= 1 and there >= 17


@pytest.mark.long
def test_where_the_base_has_taken_most_values_of_slow_noise_columns_take_the_rest_by_chance():
    """By as much as in a log with any number of them, two of these 40 had something that is missing."""
    seen = 0
    for seed in range(40):
        noise, columns = drawn(seed)
        base = columns[:8]
        own = scored(noise - np.linalg.lstsq(base.T, noise, rcond=None)[0] @ base, columns, 8)
        seen += own._noise()
    assert seen <= 1


def test_many_columns_that_are_there_are_beyond_chance():
    """Seven of 300, chosen among 2e17: so small a chance is no rounding of one."""
    noise, columns = drawn(0)
    own = scored(0.1 * noise + columns[:7].sum(0), columns)
    assert own._beyond_chance([[k] for k in range(7)], len(columns) ** 7)


def test_what_several_stages_do_alike_is_asked_as_one():
    noise, columns = drawn(0)
    own = scored(0.3 * noise + columns[0] + columns[1], columns)
    own.candidates.append(SimpleNamespace(parts=[[0, 1]]))
    beta, parts = own._alone(own._of_all(own._thin_moments()))
    assert parts == [[0, 1]] and beta[0] == beta[1] == pytest.approx(1.0, abs=0.1) and not beta[2:].any()
    assert own._beyond_chance(parts, len(own.candidates))

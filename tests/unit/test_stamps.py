"""Claims about rounded times: even ones behind them are found, and nothing else is touched."""

import numpy as np
import pytest

from pycosim.data.stamps import evened


@pytest.mark.parametrize("rate", [300.0, 333.0, 120.0, 1000 / 7 * 1.003])
@pytest.mark.parametrize("way", [np.round, np.floor])
def test_times_of_a_recorder_that_counts_milliseconds_are_even(rate, way):
    true = 2.0 + np.arange(4000) / rate
    found, rounded = evened(way(true * 1e3) / 1e3)
    assert rounded == pytest.approx(1e-3)
    np.testing.assert_allclose(np.diff(found), 1 / rate, rtol=2e-4)
    assert np.abs(found - true).max() < 1.2e-3


def test_missing_rows_leave_their_gap():
    true = np.arange(4000) / 300.0
    true = np.delete(true, [*range(100, 130), 900, 2000, 2001])
    found, rounded = evened(np.round(true, 3))
    assert rounded and np.abs(found - true).max() < 1e-3


@pytest.mark.parametrize("kept", [
    np.arange(2000) / 250.0, np.arange(2000) / 300.0, np.round(np.arange(2000) / 300.0, 6),
    np.round(np.arange(50) / 300, 3)],
    ids=["even", "not rounded", "finely rounded", "few"])
def test_times_that_need_nothing_stay(kept):
    found, rounded = evened(kept)
    assert found is kept and not rounded


def test_times_that_are_uneven_by_themselves_stay():
    rng = np.random.default_rng(0)
    steps = np.round(rng.uniform(2.6, 4.4, 3000)) * 1e-3  # 3 and 4 ms by chance: they wander off any even ones
    kept = np.round(np.cumsum(steps), 3)
    assert evened(kept)[0] is kept

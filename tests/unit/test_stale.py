"""Claims about readings that stand for several rows: those of a slow device are found, others are none, and only rows
in which all are new are used, which is said."""

import numpy as np
import pandas as pd
import pytest

from pycosim.compile import Library
from pycosim.data.checks import check
from pycosim.data.dataset import Dataset
from pycosim.data.logs import load
from pycosim.data.stale import fresh, stands
from pycosim.report.sentences import summary_data
from pycosim.study.parse import load_study

COUNT = 3000
TIME = np.arange(COUNT) * 0.01
NOISE = np.random.default_rng(0).standard_normal((2, COUNT)).round(1)
ANGLE = np.cumsum(np.sin(TIME)) * 0.01


def old(values, k, first=0):
    """Readings of a device that has a new one every so many rows, from a row on."""
    return np.asarray(values)[np.maximum((np.arange(len(values)) - first) // k * k + first, 0)]


def test_readings_of_a_slow_device_are_found_and_coarse_ones_are_none():
    for k in (2, 3, 7):
        assert [stands(old(v, k)) for v in (ANGLE, NOISE[0])] == [k, k]
    for step in (1e-4, 1e-3, 5e-3, 2e-2):
        assert stands((ANGLE / step).round() * step) == 1
    assert stands(NOISE[0]) == stands(NOISE[0].round()) == stands(np.zeros(COUNT)) == 1
    for counts in (0.37, 1 / 3, 0.5):
        assert stands((counts * TIME / 0.01 + 0.1).round()) == 1, "steady motion of an encoder with few counts"


@pytest.mark.parametrize(("signals", "every", "rows"), [
    ({"a": ANGLE, "b": NOISE[0]}, 1, {}), ({"a": old(ANGLE, 3), "b": old(NOISE[0], 3)}, 3, {"a": 3, "b": 3}),
    ({"a": ANGLE, "b": old(NOISE[0], 4, 2)}, 4, {"b": 4}),
    ({"a": old(NOISE[1], 2), "b": old(NOISE[0], 3)}, 6, {"a": 2, "b": 3}),
    ({"a": old(NOISE[1], 2), "b": old(NOISE[0], 2, 1)}, 1, {}),  # asked one after the other: none is new with the other
    ({"a": old(NOISE[1], 2), "b": old(NOISE[0], 4, 1)}, 1, {})])
def test_rows_in_which_all_readings_are_new(signals, every, rows):
    new, told = fresh(signals)
    assert told == rows
    assert abs(new.sum() - COUNT / every) <= 1
    where = np.flatnonzero(new)
    assert all((np.diff(signals[n])[where[1:-1] - 1] != 0).mean() > 0.9 for n in told)


def test_a_row_that_is_missing_moves_the_beat():
    signals = {n: np.delete(old(v, 3), 1000) for n, v in (("a", ANGLE), ("b", NOISE[0]))}
    new, _ = fresh(signals)
    assert set(np.diff(np.flatnonzero(new))) <= {2, 3}
    assert abs(new.sum() - COUNT / 3) <= 1


@pytest.mark.parametrize(("slow", "told"), [
    (None, "every row stands 3 times, of which one is used"),
    (["tau1", "tau2"], "readings of tau1 and tau2 stand for 3 rows: only rows in which they are new are used")])
def test_only_rows_with_new_readings_are_used_and_that_is_said(hidden, tmp_path, slow, told):
    frame = pd.read_csv(hidden / "run.csv")
    numbers = [n for n in frame if n not in ("time", "manoeuvre")]
    fast = frame.loc[np.repeat(frame.index, 3)].reset_index(drop=True)
    step = frame["time"][1] - frame["time"][0]
    fast["time"] += step / 3 * (np.arange(len(fast)) % 3)
    for name in numbers if slow else ():  # what a fast device measures goes on
        if name not in slow:
            fast[name] = np.interp(fast["time"], frame["time"], frame[name])
    fast["warmth"] = np.repeat(np.linspace(20.0, 30.0, len(fast) // 30 + 1), 30)[:len(fast)]
    fast.to_csv(tmp_path / "run.csv", index=False)
    text = (hidden / "study.toml").read_text()
    (tmp_path / "study.toml").write_text(text.replace(
        "[columns]", '[columns]\nwarmth = { variable = "temperature", unit = "degC" }'))
    library = Library()
    one, other = (load_study(f / "study.toml") for f in (hidden, tmp_path))
    found = Dataset(other, library)
    for name, values in Dataset(one, library).logs[0].signals.items():
        np.testing.assert_allclose(found.logs[0].signals[name], values, rtol=1e-9, atol=1e-12)
    line = f"run.csv: {len(fast):,} rows; {told}"
    assert any(x.startswith(line) for x in summary_data(found)), summary_data(found)
    said = check(other, library, found.base, load(other, strict=False)).findings
    assert told in next(f.text for f in said if f.kind == "rate")

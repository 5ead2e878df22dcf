"""Effects are found in logs without torque reference, and in several runs of different loads; none where none is."""

from pathlib import Path

import numpy as np
import pytest
from answers import summary, told

from benchmarks.hidden_effects import machine as rig
from benchmarks.hidden_effects.cases import Case, draw, same
from benchmarks.real_logs.make import make
from benchmarks.real_logs.run import scenario
from pycosim.compile import Library
from pycosim.data.dataset import Dataset
from pycosim.diagnosis import search
from pycosim.study.parse import load_study

STUDY = Path(__file__).parents[2] / "examples" / "hip_knee" / "study.toml"


def seeds(first, *others):
    """One seed for the long tier, others for the slow one."""
    return [first, *(pytest.param(seed, marks=pytest.mark.slow) for seed in others)]


def hide(drawn, effect, place, seed, size=2.0):
    """An effect of a size on a drawn machine."""
    weak = rig.draw(effect, place, np.random.default_rng(seed))
    return rig.calibrate(weak, size, drawn.machine, drawn.motion, drawn.noise, seed)


def improved(folder, *frames):
    """What `improve` finds in these logs."""
    paths = [folder / f"run{k}.csv" for k in range(len(frames))]
    for path, frame in zip(paths, frames):
        rig.write_csv(frame, path)
    return search.improve(Dataset(load_study(STUDY).with_data(paths), Library()))


def paired(folder, seed, hidden=()):
    """The same of a log without torque reference; `hidden` are an effect and its place."""
    drawn = draw(Case("none", (), seed))
    effects = [hide(drawn, *hidden, seed)] if hidden else []
    return improved(folder, rig.measure(drawn.machine, drawn.motion, effects, drawn.noise, drawn.counts, seed,
                                        reference=None))


def loaded(folder, seed, hidden=()):
    """The same of two runs, one with a heavier shank, which the reference knows."""
    drawn = draw(Case("none", (), seed))
    effects = [hide(drawn, *hidden, seed)] if hidden else []
    return improved(folder, *(
        rig.measure(drawn.machine, drawn.motion, effects, drawn.noise, drawn.counts, 10 * seed + k, leg=leg)
        for k, leg in enumerate((rig.Leg(), rig.Leg(m2=5.0)))))


def check(result, hidden):
    """The hidden effect, or a twin of it, is the one thing that is added."""
    found = told(result)
    assert result.first.verdict == "missing_effect" and len(found) == 1, summary(result)
    assert any(same(tuple(f), hidden) for f in found[0]), summary(result)
    assert result.last.verdict == "nothing_missing", summary(result)


@pytest.mark.slow
@pytest.mark.parametrize("seed", (3, 4, 5))
def test_a_viscous_effect_is_found_without_torque_reference(tmp_path, seed):
    check(paired(tmp_path, seed, ("viscous", "1A")), ("viscous", "1A"))


@pytest.mark.parametrize("seed", seeds(3, 4, 5))
def test_a_stribeck_effect_is_found_without_torque_reference(tmp_path, seed):
    check(paired(tmp_path, seed, ("stribeck", "2A")), ("stribeck", "2A"))


@pytest.mark.slow
@pytest.mark.parametrize("seed", (3, 5, 6))
def test_an_effect_of_the_load_is_found_without_torque_reference(tmp_path, seed):
    check(paired(tmp_path, seed, ("load_nonlinearity", "1A")), ("load_nonlinearity", "1A"))


@pytest.mark.parametrize("seed", seeds(3, 4, 5))
def test_nothing_is_missing_without_torque_reference(tmp_path, seed):
    result = paired(tmp_path, seed)
    assert result.first.verdict == "nothing_missing" and not told(result), summary(result)


@pytest.mark.slow
@pytest.mark.parametrize("seed", (5, 3, 6, 7))
def test_an_effect_of_the_load_is_found_in_runs_of_different_loads(tmp_path, seed):
    check(loaded(tmp_path, seed, ("load_nonlinearity", "1A")), ("load_nonlinearity", "1A"))


@pytest.mark.parametrize("seed", seeds(3, 4, 5))
def test_nothing_is_missing_in_runs_of_different_loads(tmp_path, seed):
    result = loaded(tmp_path, seed)
    assert result.first.verdict == "nothing_missing" and not told(result), summary(result)


@pytest.mark.parametrize("case", [
    "outside:tide:1.7:224", pytest.param("outside:intermittent:1.7:218", marks=pytest.mark.slow), "plain:none::224",
    "outside:wear:1.3:273000008", pytest.param("outside_digital:wear:1.3:273000008", marks=pytest.mark.slow),
    pytest.param("outside:intermittent:1.3:273000016", marks=pytest.mark.slow)])
def test_what_is_slower_than_noise_is_not_nothing(case, tmp_path):
    """The last three have 1.6 to 1.97 times the squares of their floor, of the other sign after each turn."""
    result = search.improve(Dataset(load_study(make(case, tmp_path, quick=True)), Library()))
    slow = [own["slow"] for own in result.first.channels.values()]
    assert result.first.verdict == ("nothing_missing" if ":none:" in case else "unexplained") and len(result.steps) == 1
    assert any(slow) == (":none:" not in case)


def test_a_co_simulated_log_in_which_nothing_is_hidden_misses_nothing():
    row = scenario("six_manoeuvres", 700)
    assert (row["verdict"], row["steps"]) == ("nothing_missing", []), row


@pytest.mark.slow
def test_torques_that_come_late_by_ten_samples_are_a_delay_and_nothing_else(tmp_path):
    study = make("mistake:torque_late_50ms:1:700", tmp_path, quick=True)
    result = search.improve(Dataset(load_study(study), Library()))
    assert [found[0] for found in told(result)] == [("time_delay", "torque")], summary(result)
    delay = result.steps[1].finding.coefficients["d"]
    assert 0.045 < delay["value"] < 0.055 and delay["ci95"][0] < 0.05 < delay["ci95"][1], delay


@pytest.mark.slow
@pytest.mark.parametrize("case", [
    "lag_current:none::921", "lag_current:thermal_drift:1.3:910"])
def test_what_a_filter_makes_of_a_start_is_no_hysteresis(case, tmp_path):
    """What the torque was at rest and in the first motion is not known: an inverse of the filter is off there."""
    result = search.improve(Dataset(load_study(make(case, tmp_path, quick=True)), Library()))
    first, *rest = told(result)
    assert first[0] == ("low_pass", "torque"), summary(result)
    assert [found[0][0] for found in rest] == ([] if ":none:" in case else ["thermal_drift"]), summary(result)
    low, high = result.fit.interval("low_pass_torque.T")
    constant, step = 1 / (2 * np.pi * 5), 0.005
    held = step / np.expm1(step / constant)  # by how much the recursion that made the log comes late
    assert low < constant and high > held


@pytest.mark.slow
def test_an_offset_of_the_reference_is_no_asymmetry_that_a_bound_holds(tmp_path):
    study = make("mistake:reference_zero_offset:1:960", tmp_path, quick=True)
    result = search.improve(Dataset(load_study(study), Library()))
    assert [found[0] for found in told(result)] == [("reference_offset", "hip")], summary(result)

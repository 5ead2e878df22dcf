"""Claims about what a study decides in fits and searches: robust fits, candidates ruled out, wider bounds."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.hidden_effects.machine import PAPER, measure, six_manoeuvres, write_csv
from pycosim.cli.entry import main
from pycosim.compile import Library, compile_model
from pycosim.data.dataset import Dataset
from pycosim.data.residuals import huber
from pycosim.data.turns import ALIKE, LATE, LONGER, TIMES, _Travel, building_up, off
from pycosim.diagnosis.excitation import undetectable
from pycosim.diagnosis.scores import Scores
from pycosim.diagnosis.table import Table
from pycosim.fit.least_squares import fit
from pycosim.report.controller import changes
from pycosim.report.sentences import summary_data
from pycosim.study.parse import load_study

STUDY = Path(__file__).parents[2] / "examples" / "hip_knee" / "study.toml"


@pytest.fixture(scope="module")
def log():
    return measure(PAPER, six_manoeuvres(speeds=(0.5, 1.6), repeats=1, rate=50, longest_pass=4), rng=3)


@pytest.fixture
def dataset(tmp_path):
    """A data set of a log, with changes to the study."""
    def make(frame, **changes):
        write_csv(frame, tmp_path / "log.csv")
        study = load_study(STUDY).with_data([tmp_path / "log.csv"])
        return Dataset(replace(study, **changes), Library())
    return make


def fitted(dataset):
    return fit(dataset, dataset.base).parameters


@pytest.mark.parametrize("gone", [[], ["C_H", "C_K"]], ids=["with a reference", "without one"])
def test_what_is_left_out_is_compared_nowhere_and_drives_on(dataset, log, gone):
    frame = log.drop(columns=gone)
    whole = dataset(frame)
    middle = float(whole.time[np.flatnonzero(whole.moving)[200]])
    span = [middle - 0.2, middle + 0.2]
    hit = np.abs(frame["time"] - middle) < 0.19
    pushed = dataset(frame.assign(tau1=frame["tau1"] + 8.0 * hit), leave_out=[span, ["other.csv", 0.0, 1e3]])
    sound = dataset(frame, leave_out=[span])
    view = sound.view("all")
    used = np.concatenate([view.i, view.j0, view.j1]) if sound.paired else view
    assert not sound.left_out[used].any() and 0 < sound.left_out.sum() < 25 and len(sound.time) == len(whole.time)
    assert len(sound.blocks) == len(whole.blocks)
    assert fitted(pushed) == pytest.approx(fitted(sound), rel=1e-6)
    assert f"{sound.left_out.sum()} samples left out, as [data] leave_out says." in summary_data(sound)



def distance(found, true):
    return max(abs(found[n] - true[n]) for n in ("s1A.f0", "s2A.f0"))


@pytest.mark.long
def test_outliers_move_a_plain_fit_and_hardly_a_robust_one(dataset, log):
    true = fitted(dataset(log))
    spoiled, rng = log.copy(), np.random.default_rng(0)
    rows = rng.choice(len(log), len(log) // 50, replace=False)
    spoiled.loc[rows, "C_H"] += 100.0  # shocks of one sign
    assert distance(fitted(dataset(spoiled)), true) > 0.02
    assert distance(fitted(dataset(spoiled, robust=True)), true) < 0.004


@pytest.mark.long
def test_tests_bridge_outliers_of_torques_that_hold_more_than_the_noise(dataset, log):
    assert dataset(log).spiked == 0
    spoiled, rng = log.copy(), np.random.default_rng(0)
    rows = rng.choice(len(log), len(log) // 100, replace=False)
    spoiled.loc[rows, "C_H"] += rng.choice((-100.0, 100.0), len(rows))
    data = dataset(spoiled)
    assert 0.5 * len(rows) < data.spiked <= len(rows) and np.ptp(data.measured["C_H"]) > 150
    assert data.calm.study.robust and data.calm is data.calm and data.calm.calm is data.calm
    left = np.abs(data.calm.measured["C_H"] - dataset(log).measured["C_H"]) > 50
    assert np.count_nonzero(left) == len(rows) - data.spiked  # next to a start or a turn it may be a jump
    assert any("samples of torques far off the neighbours" in line for line in summary_data(data))


def test_weights_are_one_for_all_but_the_far_out():
    residual = np.random.default_rng(0).standard_normal((2, 1000)) * [[1.0], [50.0]]
    residual[0, 7] = 1000.0
    weights = huber(residual)
    assert weights[0, 7] == pytest.approx(1.345 * 1.0 / 1000.0, rel=0.1)
    assert np.mean(weights == 1) == pytest.approx(0.82, abs=0.03)
    np.testing.assert_array_equal(huber(np.array([[0.0, 0.0, 0.0, 1.0]])), 1.0)


@pytest.mark.long
def test_what_the_user_has_ruled_out_is_no_candidate_and_is_said(dataset, log):
    data = dataset(log, rejected=["torque_offset@motor1", "stribeck"])
    table = Table(data, data.base, fit(data, data.base))
    offered = {(e.id, p.name) for e, p in table.offers}
    assert ("torque_offset", "motor2") in offered and ("torque_offset", "motor1") not in offered
    assert not {place for effect, place in offered if effect == "stribeck"}
    told = {(u["effect"], u["place"]) for u in undetectable(table, Scores(table)) if "ruled out" in u["why"]}
    assert ("torque_offset", "motor1") in told and ("stribeck", "1A") in told and len(told) == len(table.rejected)


def test_an_effect_that_is_ruled_out_is_not_added(tmp_path, monkeypatch, capsys, log):
    monkeypatch.chdir(tmp_path)
    write_csv(log, tmp_path / "log.csv")
    text = STUDY.read_text().replace("held_out = []", 'held_out = []\nrejected = ["viscous@1A"]', 1)
    (tmp_path / "study.toml").write_text(text)
    assert main(["add", "study.toml", "viscous@1A", "--data", "log.csv"]) == 2
    assert "'viscous@1A' is among [data] rejected" in capsys.readouterr().err


def test_a_parameter_may_leave_the_rig_s_bounds_where_the_study_says_so(dataset, log):
    strong = measure({"f0": {**PAPER["f0"], "1A": 3.0}, "mu": PAPER["mu"]},
                     six_manoeuvres(speeds=(0.5, 1.6), repeats=1, rate=50, longest_pass=4), rng=3)
    wide = {**load_study(STUDY).parameters}
    wide["s1A.f0"] = replace(wide["s1A.f0"], max=20.0)
    assert fitted(dataset(strong, parameters=wide))["s1A.f0"] == pytest.approx(3.0, rel=0.03)
    assert fitted(dataset(strong))["s1A.f0"] == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize("factor", [0.3, 3.0])
def test_what_is_off_after_turns_is_told_from_no_start_of_a_study(dataset, log, factor):
    """From starts a third off, friction that is sliding already looked like a travel longer than the rig's own."""
    data = dataset(log)
    values = {n: v.value for n, v in data.base.parameters.items()} | data.parameters.values(data.base)
    starts = {n: v * factor if n.endswith(".f0") else v for n, v in values.items()}
    one, other = (_Travel(data, told, data.moving).errors[:, data.moving] for told in (values, starts))
    noise = np.std(one, axis=1, keepdims=True)
    assert np.abs(one - other).max() < 0.1 * noise.min()


def turning(travel, own=1e-3, delay=0.0, noise=0.01, seed=0, beside=0.0, spikes=(), straight=False):
    """What `building_up` says of a segment that turns every second, whose friction builds up over a travel.

    By an exponential of the way, or straight, to its end in twice that travel.
    """
    time, rng = np.arange(4000) * 0.01, np.random.default_rng(seed)
    way = (np.mod(time, 1.0) * 0.5) ** 2  # since the turn
    sign = np.where(np.mod(time, 2.0) < 1.0, 1.0, -1.0)

    def state(travel):
        return sign * (1 - 2 * np.exp(-way / travel)) if travel else sign

    built = sign * np.minimum(way / travel - 1, 1) if straight else state(travel)
    late = np.where(np.mod(time, 1.0) < delay, -sign, built)
    errors = (late - sign + noise * rng.standard_normal(len(time)))[None]
    errors[:, list(spikes)] += 3.0
    errors += beside * sign * np.sqrt(way)  # something else that is missing, and grows with the speed
    others = [0.6 * (state(times * own) - sign)[None, None] for times in TIMES]
    others += [0.6 * (np.roll(state(own), n) - sign)[None, None] for n in LATE]
    return building_up(*((state(times * own) - sign)[None] for times in (1.0, LONGER)), np.ones(len(time), dtype=bool),
                       np.floor(time).astype(int), time, errors, (0.6 * (state(own) - sign))[None, None], others,
                       [others[TIMES.index(times)] for times in ALIKE])


@pytest.mark.parametrize(("left_out", "there"), [
    (True, {"travel": 1e-3}), (True, {"travel": 1e-3, "seed": 1, "noise": 0.1}), (False, {"travel": 0.0}),
    (True, {"travel": 1e-3, "beside": -0.3}), (True, {"travel": 4e-4, "straight": True}),
    (True, {"travel": 2e-3, "straight": True}), (False, {"travel": 4e-3, "straight": True}),
    (True, {"travel": 1e-3, "noise": 0.1, "spikes": (502, 1801, 2000, 2612)}),
    (False, {"travel": 0.0, "spikes": (502, 1801, 2000)}), (False, {"travel": 0.0, "beside": -0.3}),
    (False, {"travel": 2e-4}), (False, {"travel": 5e-3}),
    (False, {"travel": 0.0, "delay": 0.07}), (False, {"travel": 0.0, "delay": 0.03})])
def test_only_what_the_model_s_own_travel_does_after_turns_is_left_out(left_out, there):
    found = turning(**there)
    assert (0 < found.sum() < 0.3 * len(found)) if left_out else not found.any()


@pytest.mark.parametrize(("counts", "late", "spike", "drift"), [
    (True, 0.6, 0.0, 0.0), (False, 0.0, 0.0, 0.0), (False, 0.0, 30.0, 0.0), (False, 0.0, 0.0, 0.2)])
def test_slow_samples_count_where_they_are_off_and_not_for_a_spike_or_a_slope(counts, late, spike, drift):
    time, rng = np.arange(4000) * 0.01, np.random.default_rng(3)
    of_pass, passes = np.arange(4000) % 100, np.arange(4000) // 100
    errors = 0.05 * rng.standard_normal((1, 4000)) + drift * (time % 2.0)
    errors[0, of_pass < 4] += late
    errors[0, 101] += spike
    assert off(errors, (of_pass >= 8) & (of_pass < 92), passes, time) == counts


def test_a_study_that_says_what_moves_is_not_asked_again(dataset, log):
    data = dataset(log, w_min=0.05)
    assert data.w_min == 0.05 and np.abs(data.speeds[:, data.moving]).min() > 0.05


@pytest.mark.long
def test_what_a_controller_cannot_work_out_ahead_is_said_and_loses_nothing(dataset, log):
    data = dataset(log)
    keys = [("viscous", "1B+2B"), ("direction_asymmetry", "1A"), ("load_nonlinearity", "1A+2A")]
    model = compile_model(data.library, data.study.rig, keys)
    told = changes(data, (data.base, fit(data, data.base)), (model, fit(data, model)))
    assert told["feedforward"] == {} and "no closed form" in told["why_not"]

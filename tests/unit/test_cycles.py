"""Claims about the search for ripples: its sums are those by hand, chance is flat, hundreds of cycles are found."""

from types import SimpleNamespace

import numpy as np
import pytest

from pycosim.compile import Library, catalogue
from pycosim.compile.contribution import Contribution
from pycosim.compile.effects import Place
from pycosim.core.units import Variable
from pycosim.data.noise import Chain, Noise
from pycosim.data.parameters import fewest_cycles
from pycosim.diagnosis import cycles
from pycosim.diagnosis.trials import start_of

RIPPLE = Contribution(Library(), catalogue(Library())["torque_ripple"])
N = 4000


def table(residual, angle, slope, probe=1.0, runs=1):
    """What the search reads of a table: one channel, one motor, records of one length."""
    n = len(angle)
    time, run = 0.01 * np.arange(n), np.arange(n) * runs // n
    return SimpleNamespace(
        fit=SimpleNamespace(free=["a"] * len(slope)), chain=Chain(np.r_[np.inf, np.diff(time)]), run=run,
        dataset=SimpleNamespace(parameters=SimpleNamespace(labels=[f"run{k}" for k in range(runs)])),
        time=time, group=run, slope=slope[None], residual=residual[None],
        responses=[np.full((1, 1, n), probe)], probes=["probe_motor.dtau"], takes=[None],
        scans=[(RIPPLE.effect, Place("motor", ("motor",)))], contribution=lambda effect: RIPPLE,
        port_signals=lambda effect, component, term: {"flange.phi": angle},
        described=lambda contribution: contribution.question.variables,
        column=lambda contribution, component, grid: RIPPLE(
            {"flange.phi": angle}, [], grid, n)[0])


def motion(turns, n=N):
    """There at one speed, back at another."""
    return 2 * np.pi * turns * np.interp(np.arange(n), [0, 0.6 * n, n], [0.0, 1.0, 0.0])


def test_sums_over_an_uneven_angle_are_those_by_hand():
    rng = np.random.default_rng(0)
    angle, strength = rng.uniform(-3, 40, 500), rng.standard_normal((2, 500))
    sums = cycles._Fourier(angle, strength, np.array([0, 120, 500]))
    for some in (0.4 + 0.031 * np.arange(101), 3.531 + 0.031 * np.arange(101), 6.662 + 0.031 * np.arange(40)):
        by_hand = [[np.exp(1j * np.outer(some, angle[part])) @ own[part] for own in strength]
                   for part in (slice(120), slice(120, None))]
        np.testing.assert_allclose(sums(some), by_hand, atol=1e-3)


@pytest.mark.parametrize("wanted", [3.3, 47.0, 141.0])
def test_a_ripple_of_any_number_of_cycles_that_the_sampling_shows_is_found(wanted):
    rng = np.random.default_rng(1)
    angle = motion(8)
    seen = table(0.3 * np.sin(wanted * angle + 1.0) + rng.standard_normal(N), angle, np.ones((1, N)))
    found = cycles.ripples(seen, [Noise(1.0)], 199, rng)
    assert abs(found.candidates[0].grid["n"] - wanted) < 0.05
    assert [c.parts for c in found.candidates] == [[[2 * k], [2 * k + 1]] for k in range(cycles.PEAKS)]


@pytest.mark.parametrize("turned", [True, False])
def test_a_ripple_is_found_where_its_phase_is_another_in_each_run_and_where_it_is_not(turned):
    rng = np.random.default_rng(3)
    angle, phases = motion(8), np.array([0.3, 2.4, -1.8]) if turned else np.full(3, 0.3)
    seen = table(0.0 * angle, angle, np.ones((1, N)), runs=3)
    hidden = 0.3 * np.sin(7.0 * angle + phases[seen.run])
    seen.residual[:] = hidden + rng.standard_normal(N)
    found = cycles.ripples(seen, [Noise(1.0)], 199, rng)
    one, each = found.candidates[:2]
    assert (one.extra["runs"], each.extra["runs"]) == ([], ["run0", "run1", "run2"])
    assert len(one.parts) == 2 and len(each.parts) == 6 and abs(each.grid["n"] - 7.0) < 0.05
    columns = np.array([found.columns[k] for (k,) in each.parts])
    fitted = np.linalg.lstsq(columns.T, seen.residual[0], rcond=None)[0]
    start = start_of(each, fitted)
    assert start["torque_ripple_motor.A"] == pytest.approx(0.3, abs=0.06)
    fitted = np.array([start[f"torque_ripple_motor.phase[run{k}]"] for k in range(3)])
    told = np.sin(start["torque_ripple_motor.n"] * angle + fitted[seen.run])
    assert np.corrcoef(told, hidden)[0, 1] > 0.9


def test_a_ripple_of_once_a_turn_is_found_where_most_of_a_turn_is_seen():
    rng = np.random.default_rng(2)
    angle = motion(0.77)
    seen = table(0.3 * np.sin(angle + 1.0) + 0.3 * rng.standard_normal(N), angle, np.ones((1, N)))
    assert abs(cycles.ripples(seen, [Noise(0.3)], 199, rng).candidates[0].grid["n"] - 1.0) < 0.2


@pytest.mark.parametrize(("turns", "unit", "fewest"), [
    (5, "1", 0.2), (0.77, "1", 1.0), (0.4, "1", 2.5), (0.77, "rad/m", 1 / 0.77)])
def test_no_ripple_is_slower_than_a_turn_or_the_travel(turns, unit, fewest):
    number = Variable("n", unit, min=0.05, max=1000.0)
    assert fewest_cycles(number, 2 * np.pi * turns) == pytest.approx(fewest)


def test_the_highest_number_of_cycles_has_two_samples_each_on_the_slow_way():
    angle = motion(5)
    tried = cycles._cycles(table(np.zeros(N), angle, np.ones((1, N))), RIPPLE, Place("motor", ("motor",)))
    assert tried[0] == pytest.approx(1 / 5) and tried[-1] == pytest.approx(0.6 * N / 5 / 2, rel=0.01)


@pytest.mark.long
@pytest.mark.parametrize("runs", [1, 3])
@pytest.mark.parametrize("noise", ["even", "grows", "offset"])
def test_chance_is_flat_where_nothing_is_hidden(noise, runs):
    angle, below = motion(6, 600), []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        e = rng.standard_normal(600)
        e = {"even": e, "grows": e * np.linspace(0.5, 2.5, 600), "offset": e + 0.7}[noise]
        slope = np.array([np.ones(600), np.cos(angle / 6)])
        left = e - slope.T @ np.linalg.lstsq(slope.T, e, rcond=None)[0]
        seen = table(left, angle, slope, runs=runs)
        scores = cycles._Scores.of(seen, [Noise(1.0)])
        signs = rng.choice(np.array([-1.0, 1.0], dtype=np.float32), (199, scores.stretches))
        place = seen.scans[0][1]
        value, chance, _ = cycles._scan(seen, scores, RIPPLE, place, cycles._cycles(seen, RIPPLE, place), signs)
        below.append(np.mean(chance >= value.max()))
    assert 0.01 <= np.mean(np.array(below) < 0.1) <= 0.20
    assert 0.35 <= np.mean(np.array(below) < 0.5) <= 0.65

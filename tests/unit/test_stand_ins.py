"""What tells a law from one that stands in for it: one coefficient all over the data, and little that is left."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.signal import lfilter
from scipy.stats import binom, kstest, norm

from pycosim.data.noise import Noise, chained, fit_noise
from pycosim.diagnosis import constancy, search
from pycosim.diagnosis.constancy import (
    CHANCE,
    FREE,
    OWN,
    SURE,
    _follows,
    _free,
    _Law,
    _Laws,
    _own_lines,
    _pieces,
    _placebos,
    _sided,
    _straight,
    as_good_a_law,
    levels,
)
from pycosim.diagnosis.dependence import Dependence, _dependence, _Given, calm_floor, noise_floor
from pycosim.diagnosis.finding import Diagnosis, Finding
from pycosim.diagnosis.remainder import HELD_OUT, LEFT, WANDERS, remaining, rises
from pycosim.diagnosis.whitened import Whitened


def _fitted(law, speed, rng, memory=0.9):
    """Residual and slopes of a model with Coulomb friction and a viscous one, fitted to another law."""
    noise = rng.normal(size=speed.size)
    for k in range(1, speed.size):
        noise[k] = memory * noise[k - 1] + np.sqrt(1 - memory ** 2) * noise[k]
    slope = np.array([np.sign(speed), speed])
    measured = law(speed) + 0.1 * noise
    x = np.linalg.lstsq(slope.T, measured, rcond=None)[0]
    return (measured - x @ slope)[None], slope[None], (x[1] * speed)[None]


def _gain(law, seed, blocks=30):
    """Gain, and errors over the bar, of a straight line and of levels where one block alone is fast."""
    rng = np.random.default_rng(seed)
    block = np.repeat(np.arange(blocks), 120)
    peak = rng.uniform(0.2, 1.0, blocks)
    peak[blocks // 2] = 4.0
    speed = peak[block] * np.sin(2 * np.pi * np.arange(block.size) / 120)
    left, slope, added = _fitted(law, speed, rng)
    return _tried(left, slope, added, _pieces(block), speed)


def _tried(left, slope, added, pieces, speed):
    """Gain and errors over the bar of a coefficient that varies along a line, and level by level."""
    laws = _Laws(added, slope, pieces)
    tried = ((laws.gain(left, added[:, None] * function), bar) for function, bar in
             ((_straight(speed), SURE), (_free(levels(speed)), FREE)))
    return [(gain, errors / bar) for (gain, errors), bar in tried]


def test_a_right_law_gains_nothing_by_a_coefficient_that_varies():
    found = np.array([_gain(lambda w: 0.3 * np.sign(w) + 0.5 * w, seed) for seed in range(60)])
    assert ((found[:, :, 1] > 1).sum(0) <= binom.ppf(0.999, 60, 0.01)).all(), found[:, :, 1].max(0)


def _in_slow_noise(law, seed, signals=20):
    """Of a log of 51 s: errors over the bar of an offset on a line of each slow signal, and the chance of each gain.

    The last signal is the load that the law is given. Noise is as in `benchmarks/real_logs`: white, and of a second.
    """
    rng, n, dt = np.random.default_rng(seed), 3600, 51.0 / 3600
    block, time = np.repeat(np.arange(30), 120), dt * np.arange(n)
    speed = rng.uniform(0.5, 2.0, 30)[block] * np.sin(2 * np.pi * np.arange(n) / 120)
    periods, phases = rng.uniform(4.0, 40.0, (signals, 3, 1)), rng.uniform(0, 2 * np.pi, (signals, 3, 1))
    values = np.sin(2 * np.pi * time / periods + phases).sum(1)
    kept = np.exp(-dt)
    slow = lfilter([np.sqrt(1 - kept ** 2)], [1, -kept], rng.standard_normal(n))
    slope = np.array([np.sign(speed), speed, np.ones(n)])
    measured = law(speed, values[-1]) + 0.1 * (rng.standard_normal(n) + 0.4 * slow)
    x = np.linalg.lstsq(slope.T, measured, rcond=None)[0]
    left, added = (measured - x @ slope)[None], np.full((1, n), x[2])
    whitened = Whitened([Noise(0.1, 0.04, 1.0)], chained(time, np.zeros(n), True), left, slope[None])
    laws = _Laws(added, slope[None], _pieces(block))
    lines = [added[:, None] * _straight(v) for v in values]
    return np.array([(laws.gain(left, row)[1] / SURE, whitened.chance(row)) for row in lines]).T


def test_noise_that_changes_slowly_varies_no_coefficient():
    found = [_in_slow_noise(lambda w, load: 0.3 * np.sign(w) + 0.5 * w + 0.2, seed) for seed in range(100)]
    chances = np.array([chance for _, chance in found])
    told = np.array([((over > 1) & (chance < CHANCE / chance.size)).any() for over, chance in found])
    assert told.sum() <= binom.ppf(0.999, 100, CHANCE)
    assert sum((over > 1).any() for over, _ in found) > 5  # stretches alone would tell many
    assert kstest(chances[:, 0], "uniform").pvalue > 1e-3


def test_an_offset_that_is_a_torque_by_the_load_is_told_in_slow_noise():
    found = [_in_slow_noise(lambda w, load: 0.3 * np.sign(w) + 0.5 * w + 0.1 + 0.05 * load, seed) for seed in range(20)]
    assert all(over[-1] > 1 and chance[-1] < CHANCE / chance.size for over, chance in found)


def _by_load(law, seed):
    """What a straight line of a load, and of its magnitude, gains a viscosity, in errors over the bar."""
    rng = np.random.default_rng(seed)
    block = np.repeat(np.arange(30), 120)
    speed = rng.uniform(0.5, 2.0, 30)[block] * np.sin(2 * np.pi * np.arange(block.size) / 120)
    load = np.sin(2 * np.pi * np.arange(block.size) / 400 + 0.4)
    left, slope, added = _fitted(lambda w: law(w, load), speed, rng)
    laws = _Laws(added, slope, _pieces(block))
    return [laws.gain(left, added[:, None] * _straight(v))[1] / SURE for v in _sided(load)]


def _asked(measured, slopes, own, values, monkeypatch, most=np.inf):
    """Whether the second column, on a straight line of a value, does as well as with the third beside it."""
    fits, seen = {}, {}
    for count in (2, 3):
        room = (np.full(count, -np.inf), np.r_[most, np.full(count - 1, np.inf)])
        x = lsq_linear(slopes[:count].T, measured, room).x
        names = ["base.f", "gain_gear.g", "other_gear.a"][:count]
        fits[count] = SimpleNamespace(free=names, values=x, weights=np.ones(1), variables={
            n: SimpleNamespace(min=-np.inf, max=most if n == "base.f" else np.inf) for n in names})
        seen[id(fits[count])] = -slopes[None, :count], (measured - x @ slopes[:count])[None]
    added = fits[2].values[1] * own
    monkeypatch.setattr(constancy, "_seen", lambda dataset, model, fit: (
        *seen[id(fit)], None, _pieces(np.repeat(np.arange(30), 120)), 1, None))
    monkeypatch.setattr(constancy, "_added", lambda *given: added[None])
    monkeypatch.setattr(constancy, "_parts", lambda *given: {})
    monkeypatch.setattr(constancy, "explanations", lambda *given: values)
    attached = [(SimpleNamespace(id="gain"), SimpleNamespace(name="gear", components=("gear",)))]
    return as_good_a_law(None, *((SimpleNamespace(attached=attached), fits[k]) for k in (2, 3)), ("gain", "gear"))


def _as_good(law, load, seed, monkeypatch):
    """Whether a viscosity on a straight line does as well as one with an asymmetry beside it, fitted to a law."""
    rng = np.random.default_rng(seed)
    speed = rng.uniform(0.5, 2.0, 30).repeat(120) * np.sin(2 * np.pi * np.arange(3600) / 120)
    slopes = np.array([np.sign(speed), speed, np.abs(speed)])
    measured = law(speed, load) + 0.1 * rng.standard_normal(speed.size)
    return _asked(measured, slopes, speed, {"load": load, "speed": speed}, monkeypatch)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("most", "told"), [(np.inf, True), (0.0, False)])
def test_a_law_that_needs_a_loss_below_nothing_is_none(most, told, seed, monkeypatch):
    """A gain and a constant: a gain that grows with the torque does both, where the base may have what is left."""
    rng = np.random.default_rng(seed)
    torque = 1.5 + np.sin(2 * np.pi * np.arange(3600) / 400 + 0.4)
    slopes = np.array([1 - torque ** 2, torque, np.ones(3600)])
    measured = 0.5 * torque + 0.4 + 0.1 * rng.standard_normal(3600)
    assert _asked(measured, slopes, torque, {"torque": torque}, monkeypatch, most) == told


@pytest.mark.parametrize("seed", range(5))
def test_one_law_that_nobody_knows_is_seen_behind_two_effects(seed, monkeypatch):
    """Where the load is that of the way, a loss of speed times load is a viscosity and an asymmetry of it."""
    way = np.sign(np.sin(2 * np.pi * np.arange(3600) / 120))
    noise = np.random.default_rng(seed).normal(0, 0.05, way.size)
    assert _as_good(lambda w, load: 0.3 * np.sign(w) + 0.2 * w * load, 1 + 0.4 * way + noise, seed, monkeypatch)


@pytest.mark.parametrize("seed", range(5))
def test_two_effects_are_no_law_where_loads_differ_otherwise_than_ways(seed, monkeypatch):
    load = 1 + 0.4 * np.sin(2 * np.pi * np.arange(3600) / 400 + 0.4)
    assert not _as_good(lambda w, load: 0.3 * np.sign(w) + 0.2 * w + 0.08 * np.abs(w), load, seed, monkeypatch)


def test_a_viscosity_that_grows_with_the_square_of_a_load_is_seen_in_the_magnitude_of_that():
    line, size = np.array([_by_load(lambda w, load: 0.3 * np.sign(w) + 0.3 * w * load ** 2, s) for s in range(10)]).T
    assert np.all(size > 1) and np.median(line) < 1
    right = np.array([_by_load(lambda w, load: 0.3 * np.sign(w) + 0.2 * w, s) for s in range(60)])
    assert ((right > 1).sum(0) <= binom.ppf(0.999, 60, 0.01)).all()


def _at_two_stages(law, seed):
    """Errors over the bar of a viscosity of two stages by the load of either, and of each by its own, at most."""
    rng, t = np.random.default_rng(seed), np.arange(3600)
    speed = rng.uniform(0.5, 2.0, 30).repeat(120) * np.sin(2 * np.pi * t / 120)
    loads = {"a": 1.0 + 0.5 * np.sin(2 * np.pi * t / 400 + 0.4), "b": 1.0 + 0.5 * np.sin(2 * np.pi * t / 310)}
    one, other = speed, np.roll(speed, 30)
    slopes = np.array([np.sign(one) + np.sign(other), one + other])
    measured = 0.3 * slopes[0] + law(one, loads["a"]) + law(other, loads["b"]) + 0.1 * rng.normal(size=t.size)
    x = np.linalg.lstsq(slopes.T, measured, rcond=None)[0]
    parts = {n: x[1] * w[None] for n, w in (("a", one), ("b", other))}
    added = sum(parts.values())
    laws = _Laws(added, slopes[None], _pieces(np.repeat(np.arange(30), 120)))
    left, own = (measured - x @ slopes)[None], _own_lines({f"load@{n}": v for n, v in loads.items()}, parts)
    assert [law.name for law in own] == ["load@a"]
    alone = max(laws.gain(left, added[:, None] * _straight(v))[1] for v in loads.values())
    return alone / SURE, laws.gain(left, own[0].varied())[1] / SURE


def test_a_viscosity_of_two_stages_that_grows_with_the_load_of_each_is_seen_by_the_load_of_each():
    alone, own = np.array([_at_two_stages(lambda w, load: 0.2 * w * (0.8 + 0.2 * load), s) for s in range(10)]).T
    assert np.median(own) > 1 > np.median(alone), (own, alone)
    right = np.array([_at_two_stages(lambda w, load: 0.2 * w, s)[1] for s in range(60)])
    assert (right > 1).sum() <= binom.ppf(0.999, 60, 0.01)


@pytest.mark.parametrize("seed", range(5))
def test_a_law_that_stands_in_is_seen_though_one_block_alone_is_fast(seed):
    found = _gain(lambda w: 0.3 * np.sign(w) + np.where(w < 0, -0.3 * w ** 2, 0.0), seed)
    assert any(errors > 1 and gain > 0 for gain, errors in found), found


def test_equal_speeds_are_one_level_whatever_rounding_makes_of_them():
    rng = np.random.default_rng(0)
    speed = np.repeat([-1.0, 1.0], 500) * np.repeat([0.5, 1.0, 0.5, 1.0], 250)
    cells = levels(speed + 1e-4 * rng.normal(size=speed.size))
    assert all(np.unique(cells[speed == w]).size == 1 for w in np.unique(speed))


def _given(residual, variable, block):
    """A residual of one channel with friction as the only response, for `_dependence`."""
    edges = np.quantile(variable, np.linspace(0, 1, 25)[1:-1])
    chain = chained(0.01 * np.arange(residual.size), np.zeros(residual.size), True)
    return _Given(SimpleNamespace(study=SimpleNamespace(columns={}), outputs=[]), SimpleNamespace(chain=chain),
                  residual[None], [np.ones((1, residual.size))], [True], np.ones((1, 1)),
                  {"x": [np.searchsorted(edges, variable)]}, block % 5, block, np.empty(0),
                  [fit_noise(residual, chain)])


def _sure(acting, seed, blocks=30):
    """Whether a residual is said to depend on a variable, where the law acts in a part of the blocks."""
    rng = np.random.default_rng(seed)
    block = np.repeat(np.arange(blocks), 100)
    x = rng.uniform(-1, 1, block.size)
    size = np.zeros(blocks)
    size[rng.permutation(blocks)[:acting]] = 4.0
    noise = rng.standard_t(3, block.size) + rng.normal(size=blocks)[block]
    return _dependence(_given(size[block] * np.sin(3 * x) + noise, x, block), np.array([True])).sure


def test_noise_depends_on_nothing_however_blocks_differ():
    assert sum(_sure(0, seed) for seed in range(60)) <= binom.ppf(0.999, 60, 0.01)


def test_what_a_fifth_of_the_blocks_shows_is_seen():
    assert sum(_sure(10, seed) for seed in range(20)) >= 18


def _slowly(law, seed, blocks=14, length=120):
    """Whether a residual is said to depend on a load that changes as slowly as its noise; blocks of 1.2 s."""
    rng, n = np.random.default_rng(seed), blocks * length
    kept = np.exp(-0.01)
    slow = lfilter([np.sqrt(1 - kept ** 2)], [1, -kept], rng.standard_normal(n))
    load = np.sin(2 * np.pi * np.arange(n) / (2.3 * length))
    residual = law(load) + rng.standard_normal(n) + 0.8 * slow
    return _dependence(_given(residual, load, np.repeat(np.arange(blocks), length)), np.array([True])).sure


def test_what_slow_noise_would_do_as_well_is_nothing_and_what_it_would_not_is_seen():
    assert sum(_slowly(lambda load: 0.0 * load, seed) for seed in range(100)) <= binom.ppf(0.999, 100, 0.01)
    assert sum(_slowly(lambda load: 3.0 * load ** 2, seed) for seed in range(20)) >= 18


def _of_time(law, seed, memory=4.0, step=0.01, count=9600):
    """Whether a residual depends on time; friction turns over every half a second, and blocks are as long."""
    rng, t = np.random.default_rng(seed), np.arange(count) * step
    noise, kept = rng.normal(size=count), np.exp(-step / memory)
    for k in range(1, count):
        noise[k] = kept * noise[k - 1] + np.sqrt(1 - kept ** 2) * noise[k]
    way, block = np.where(t % 1.0 < 0.5, 1.0, -1.0), (t / 1.0).astype(int)
    given = _given(way * law(t) + 0.5 * noise + rng.normal(size=count), t, block)
    given.bins = {"time": given.bins["x"]}
    given.waves, given.frictions = [way[None], np.ones((1, count))], [True]
    given.dataset.paired = False
    return _dependence(given, np.array([True])).sure


def test_slow_noise_of_a_sensor_is_no_law_of_time_and_friction_that_ebbs_is_one():
    assert sum(_of_time(lambda t: 0.0 * t, seed) for seed in range(40)) <= binom.ppf(0.999, 40, 0.01)
    assert sum(_of_time(lambda t: 0.7 * np.sin(t / 6), seed) for seed in range(20)) >= 18


def test_friction_that_switches_once_is_seen_and_the_slow_noise_of_few_blocks_is_not():
    few = {"count": 2800, "memory": 8.0}
    assert sum(_of_time(lambda t: 0.0 * t, seed, **few) for seed in range(60)) <= binom.ppf(0.999, 60, 0.01)
    assert sum(_of_time(lambda t: 2.0 * (t > 18) - 0.7, seed, **few) for seed in range(20)) >= 15


FOLLOWS = {"theta": 1.0}


def _told(sure, strength):
    own = [{"variable": "theta", "strength": strength}]
    return Dependence(own, sure, {"a": Dependence(own, sure), "b": Dependence(own, False)})


@pytest.mark.parametrize("sure, strength, left, expected", [
    (True, 0.5, (4.0, 3.0), "theta"),  # takes 6 of 10 and leaves 2 that depend on an angle
    (True, 0.1, (4.0, 3.0), None),
    (False, 0.5, (4.0, 3.0), None),
    (True, 0.1, (4.0, 5.0), "theta"),  # pays for it in the other channel
])
def test_an_effect_must_take_more_than_it_leaves(sure, strength, left, expected):
    before, after = (SimpleNamespace(channels=np.array([[a], [b]])) for a, b in ((10.0, 3.0), left))
    share, variable = remaining(_told(sure, strength), before, after, FOLLOWS)
    assert (variable if share > LEFT else None) == expected


@pytest.mark.parametrize("left, wanders, expected", [
    ((7.0, 3.0), {"a": 0.5}, WANDERS),  # takes 3 of 10 and leaves 3.5 that no noise explains
    ((7.0, 3.0), {"a": 0.4}, None),
    ((7.0, 3.0), {"b": 0.9}, None),  # in a channel that it does not act on
])
def test_an_effect_must_take_more_than_what_is_left_that_is_slower_than_noise(left, wanders, expected):
    before, after = (SimpleNamespace(channels=np.array([[a], [b]])) for a, b in ((10.0, 3.0), left))
    share, variable = remaining(_told(False, 0.0), before, after, FOLLOWS, None, wanders)
    assert (variable if share > LEFT else None) == expected


class Runs:
    """Logs of which a model is no more than what it leaves: by part, shape (channels, n), runs of 400 samples."""

    channels = ("a", "b")

    def __init__(self, count, parts=("fit", "test")):
        self.logs, self.run = [None] * count, np.repeat(np.arange(count), 400)
        self.is_test = np.array(["test" in parts])

    def residuals(self, model, free, parameters, part):
        return SimpleNamespace(residual=lambda values: model[part])

    def picks(self, part):
        return [(1.0, np.arange(len(self.run)), None)]


NONE = SimpleNamespace(free=[], parameters={}, values=[])  # of a fit


def _left(held_out, fit=(1.0, 1.0), noise=(1.0,)):
    """What a model leaves in the fit part and in the held-out part, noise of each run beside it."""
    sizes = np.repeat(noise, 400)
    return {part: np.array(errors)[:, None] * np.resize((1.0, -1.0), sizes.size) * sizes
            for part, errors in (("fit", fit), ("test", held_out))}


@pytest.mark.parametrize("held_out, expected", [
    ((0.9, 1.0), None),
    ((0.5, 1.7), HELD_OUT),
    ((1.001, 1.0), HELD_OUT),  # takes nothing there
    (None, None),
])
def test_an_effect_must_not_raise_the_error_of_the_held_out_part(held_out, expected):
    data = Runs(1) if held_out else Runs(1, ("fit",))
    risen = rises(data, (_left((1.0, 1.0)), NONE), (_left(held_out or (9.0, 9.0), (0.6, 1.0)), NONE))
    before, after = (SimpleNamespace(channels=np.array([[a], [3.0]])) for a in (10.0, 4.0))
    share, variable = remaining(_told(True, 0.1), before, after, FOLLOWS, risen)
    assert (variable if share > LEFT else None) == expected


@pytest.mark.parametrize("noisy, lowered", [(1.05, True), (1.7, False)])
def test_a_run_that_is_noisier_than_the_others_does_not_outvote_them(noisy, lowered):
    """Three runs, of which one has four times the noise: what the others lose counts, what that gains by chance not."""
    data, one, other = Runs(3), _left((1.0, 1.0), noise=(1, 4, 1)), _left((0.75, 1.0), (0.8, 1.0), noise=(1, 4, 1))
    other["test"][0, data.run == 1] *= noisy / 0.75
    plain = np.mean(other["test"][0] ** 2) - np.mean(one["test"][0] ** 2)
    assert plain > 0 and (rises(data, (one, NONE), (other, NONE))["a"] < 0) == lowered


def _any(seed):
    """Whether a signal that has nothing to do with a missing effect seems to vary more than it does at other times."""
    rng = np.random.default_rng(seed)
    t = np.arange(6000) / 607 * 2 * np.pi
    speed, angle, phase = np.sin(t) + 0.4 * np.sin(3 * t), -np.cos(t) - 0.13 * np.cos(3 * t), rng.uniform(0, 7, 6)
    added = 0.2 * sum(np.sin((k + 1) * t + phase[k]) for k in range(6))
    slope = np.array([np.sign(speed), added])
    measured = 0.3 * np.sign(speed) + added + speed * angle ** 2 + 0.1 * rng.normal(size=t.size)
    left = (measured - np.linalg.lstsq(slope.T, measured, rcond=None)[0] @ slope)[None]
    return _beyond_placebos(added, slope, _pieces(np.repeat(np.arange(10), 600)), left, speed, rng)


def _beyond_placebos(added, slope, pieces, left, speed, rng):
    """Whether a line, and levels, gain more than chance and than the signal itself at other times."""
    tried = _tried(left, slope[None], added[None], pieces, speed)
    laws = _Laws(added[None], slope[None], pieces)
    return [errors > 1 and gain > max(_placebos(laws, left, _Law("", SURE, {0: laws.added}, {0: function}), rng))
            for (gain, errors), function in zip(tried, (_straight(speed), _free(levels(speed))))]


def test_what_a_free_function_catches_of_something_else_is_not_a_law_that_varies():
    assert (np.sum([_any(seed) for seed in range(30)], axis=0) <= binom.ppf(0.999, 30, 0.05)).all()


def test_a_law_that_varies_gains_more_than_any_other_signal():
    rng = np.random.default_rng(1)
    speed = np.repeat(rng.uniform(0.2, 2.0, 60), 100) * np.tile(np.repeat([1.0, -1.0], 50), 60)
    slope, added = np.array([np.sign(speed), speed]), speed
    measured = np.where(speed < 0, -0.3 * speed ** 2, 0.0) + 0.05 * rng.normal(size=speed.size)
    left = (measured - np.linalg.lstsq(slope.T, measured, rcond=None)[0] @ slope)[None]
    assert any(_beyond_placebos(added, slope, _pieces(np.repeat(np.arange(60), 100)), left, speed, rng))


def test_a_ripple_of_many_cycles_follows_no_variable_and_friction_does():
    w = np.sin(np.arange(4000) / 300)
    values = {"speed@a": w, "phi": -300 * np.cos(np.arange(4000) / 300)}
    bins = {n: levels(v) for n, v in values.items()}
    assert max(_follows(np.sin(2 * values["phi"])[None], values, bins).values()) < OWN
    assert _follows(np.abs(w)[None] * np.sign(w), values, bins)["speed@a"] > 0.9
    assert min(_follows(np.sign(w)[None], values, bins).values()) > 0.9  # a constant is a function of anything


def test_a_run_that_is_noisier_and_repeats_nothing_has_a_floor_of_its_own():
    """Repeats in the two quiet runs alone had told the floor of all three."""
    rng, block = np.random.default_rng(1), np.repeat(np.arange(9), 100)
    run = block // 3
    noise = np.where(run == 1, 4.0, 1.0) * rng.standard_normal(900)
    time = np.arange(900) * 0.01 + 5.0 * block
    problem = SimpleNamespace(time=time, group=block, block=block, residual=lambda x: noise[None])
    line = np.where(np.arange(9) // 3 == 1, np.arange(9), 0)
    dataset = SimpleNamespace(averaged=False, run=run, channels=["C"], residuals=lambda *a: problem,
                              picks=lambda part: [(1.0, np.arange(900), None)],
                              blocks=SimpleNamespace(line=line, speed=np.zeros(9, dtype=int)))
    floor = noise_floor(dataset, None, SimpleNamespace(free=[], parameters={}, values=[]))["C"]
    assert floor == pytest.approx(np.sqrt(6.0), rel=0.08)


def test_an_outlier_hides_nothing_that_is_slower_than_noise():
    """One of 28 N.m, which a turn had kept, was as much as all that a friction had left that grew with the way."""
    rng, block = np.random.default_rng(2), np.repeat(np.arange(8), 200)
    noise = 0.2 * rng.standard_normal(1600) + np.where(block % 2, -1.0, 1.0) * (block - 3.5) / 8
    residual = noise.copy()
    residual[517] += 28.0
    floors = []
    for shown in (noise, residual):
        problem = SimpleNamespace(time=np.arange(1600) * 0.01 + 5.0 * block, group=block, block=block,
                                  residual=lambda x, shown=shown: shown[None].copy())
        dataset = SimpleNamespace(averaged=False, run=np.zeros(1600, int), channels=["C"],
                                  residuals=lambda *a, problem=problem: problem,
                                  picks=lambda part: [(1.0, np.arange(1600), None)],
                                  blocks=SimpleNamespace(line=np.arange(8), speed=np.zeros(8, dtype=int)))
        floors.append([v["C"] for v in calm_floor(dataset, None, SimpleNamespace(free=[], parameters={}, values=[]))])
    assert floors[1] == pytest.approx(floors[0], rel=0.01) and floors[0][1] > 1.5 * floors[0][0]


class _Fit:
    """Sizes with half widths of their 95 % intervals, which grow with the level as of normal noise."""

    def __init__(self, sizes, apart=()):
        self.sizes, self.free, self.apart = sizes, [*sizes], dict.fromkeys(apart, 0.0)

    def interval(self, name, level=0.95):
        value, half = self.sizes[name]
        half *= norm.ppf(0.5 + level / 2) / norm.ppf(0.975)
        return value - half, value + half


def _step(effect, place, fit, sizes):
    return search.Step((effect, place), None, fit, {}, {}, Finding(effect, place, sizes=dict.fromkeys(sizes, 0.0)))


@pytest.mark.parametrize(("half", "apart", "may"), [(0.4, (), False), (0.9, (), True), (1.2, (), True),
                                                    (1.2, ("viscous_2A.b",), False)])
def test_a_size_may_be_none_at_the_level_of_the_largest_of_all_candidates(half, apart, may):
    """A size of one, of 120 candidates: 1.8 times its 95 % interval, unless the likelihood rules it out."""
    fit = _Fit({"viscous_2A.b": (1.0, half)}, apart)
    assert search._may_be_nothing(fit, _step("viscous", "2A", fit, ["b"]), 1 - search.CHANCE / 120) is may


def _diagnosis(verdict, *names, accepted=None):
    found = [Finding(*name, accepted=name == accepted) for name in names]
    return Diagnosis(verdict, {}, {}, found, [], [], channels={"C": {"verdict": verdict}})


DATA = SimpleNamespace(library=None)


def _path(monkeypatch, *steps, short=0.5):
    """Steps of a search, as its end sees them, where all else is told by the diagnosis of a test."""
    monkeypatch.setattr(search, "corrections", lambda library: {})
    monkeypatch.setattr(search.least_squares, "widened", lambda dataset, model, fit: fit)
    monkeypatch.setattr(search, "_ladder", lambda dataset, base, steps: [base, *steps])
    monkeypatch.setattr(search, "_shortfall", lambda dataset, steps, *given: short)
    attached = [(SimpleNamespace(id=e), SimpleNamespace(name=p)) for e, p in (s.added for s in steps)]
    model = SimpleNamespace(attached=attached, keys=[s.added for s in steps])
    return [search.Step(None, model, steps[0].fit, {}, {}), *(replace(s, model=model) for s in steps)]


def test_what_has_too_many_alternatives_beside_another_is_told_as_a_class(monkeypatch):
    """A centre of mass had twelve, beside a constant torque, once each was asked for beside the other.

    The other need not be the same all over the data without it: one of the twelve is there.
    """
    centre, torque = ("reference_centre", "shank"), ("torque_offset", "motor2")
    fit = _Fit({"reference_centre_shank.c": (0.01, 0.001), "torque_offset_motor2.o": (1.0, 0.1)})
    path = _path(monkeypatch, _step(*centre, fit, ["c"]), _step(*torque, fit, ["o"]), short=2.0)
    others = "joint_spring", "reference_zero", "viscous", "dwell"
    path[1].finding.twins = [{"effect": e, "place": "a"} for e in others]
    monkeypatch.setattr(search, "pressed", lambda *given: False)
    monkeypatch.setattr(search, "diagnose", lambda *given: _diagnosis("unexplained", centre))
    steps, last = search._sure(DATA, path, _diagnosis("nothing_missing", centre), 0, None)
    assert [s.added for s in steps] == [None, torque] and last.verdict == "unexplained"


@pytest.mark.parametrize(("half", "pairs", "none", "stays"), [
    (0.01, [], True, True), (0.2, [], True, False), (0.2, [], False, True), (0.01, ["any"], True, False)])
def test_beside_one_of_a_class_a_size_is_as_that_fit_has_it(half, pairs, none, stays, monkeypatch):
    """A cross load was taken out again, beside any of eight constant torques that explained the rest:
    with blocks that differ by the lack of one of them it might have been none."""
    load, torque = ("cross_load", "1A+2A"), ("torque_constant", "motor1")
    fit = _Fit({"cross_load_1A_2A.k": (0.05, 0.06)})
    path = _path(monkeypatch, _step(*load, fit, ["k"]))
    monkeypatch.setattr(search, "pressed", lambda *given: False)
    monkeypatch.setattr(search, "diagnose", lambda *given: _diagnosis("unexplained", load))
    told = _diagnosis("unexplained", torque)
    told.candidates[0].contested, told.candidates[0].together = True, pairs
    told.candidates[0].fit = _Fit({"cross_load_1A_2A.k": (0.08, half)})
    likeliest = _Fit({"cross_load_1A_2A.k": (0.08, half)}, () if none else ("cross_load_1A_2A.k",))
    monkeypatch.setattr(search, "_likeliest", lambda *given: likeliest)
    steps, last = search._sure(DATA, path, told, 0, None)
    assert (len(steps) == 2) == stays


@pytest.mark.parametrize(("bound", "short"), [(None, 0.5), ("reference_gain", 0.5), (None, 2.0)])
def test_what_may_have_no_size_beside_something_unknown_is_taken_out_and_stays_out(bound, short, monkeypatch):
    """A gain of 0.42, and a ripple of half a cycle, stood in for laws that nobody knows.

    What stays must be the same all over the data without that: a viscosity was left of three effects, the two others of
    which had made it so, for a drag with the square of the speed one way.
    """
    gain, drag = ("reference_gain", "knee"), ("viscous", "2A")
    fit = _Fit({"reference_gain_knee.g": (0.6, 0.58), "viscous_2A.b": (1.0, 0.1)})
    path = _path(monkeypatch, _step(*gain, fit, ["g"]), _step(*drag, fit, ["b"]), short=short)
    monkeypatch.setattr(search, "pressed", lambda model, fit, attached: attached[0].id == bound)
    monkeypatch.setattr(search, "diagnose", lambda *given: _diagnosis("missing_effect", gain, drag, accepted=gain))
    steps, last = search._sure(DATA, path, _diagnosis("unexplained", gain, drag), 0, None)
    assert [s.added for s in steps] == ([None, drag] if short < 1 else [None])
    assert (last.verdict, last.channels["C"]["verdict"], last.winner) == ("unexplained", "unexplained", None)
    assert last.candidates[0].refused == (search.ENDLESS if bound else search.NOTHING)
    known = _diagnosis("nothing_missing", gain)
    steps = search._sure(DATA, path, known, 0, None)[0]
    assert [s.added for s in steps] == ([None, drag] if bound else [None, gain, drag])  # none is taken out for others

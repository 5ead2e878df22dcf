"""Claims about segmentation: passes, blocks, the test part and pairs follow from motion alone, not from labels."""

from dataclasses import dataclass

import numpy as np
import pytest

from pycosim.core.errors import DataError
from pycosim.data import segmentation as seg

LINES = {"A": (1.0, -1.0), "C": (1.0, 0.5), "E": (0.5, 1.0)}
BACK = {"A": "B", "C": "D", "E": "F"}
STEP = 0.01


@dataclass
class Motion:
    time: np.ndarray
    theta: np.ndarray
    speeds: np.ndarray
    label: np.ndarray

    @property
    def true_speeds(self):
        return segments(np.gradient(self.theta, STEP, axis=1))


def segments(omega):
    """Segment speeds (4, n) from the motors' (2, n)."""
    difference = (omega[0] - omega[1]) / 2
    return np.array([omega[0], omega[1], difference, -difference])


def one_way(direction, speed, length, ramp=0.2):
    """Speed profile along a line, ramps included."""
    up = speed * np.arange(0, 1, STEP / ramp)
    cruise = max(int(round((length / speed - ramp) / STEP)), 0)
    return np.outer(direction, np.concatenate([up, np.full(cruise, speed), up[::-1]]))


def manoeuvres(speeds=(0.4, 1.6), repeats=2, length=4.0, dwell=0.5, noise=0.003, lines="ACE", seed=0):
    """Out and back over the lines, a dwell after each pass; labels are for checking only."""
    rest, parts, labels = np.zeros((2, int(dwell / STEP))), [], []
    for speed in [s for _ in range(repeats) for s in speeds]:
        for name in lines:
            for label, sign in ((name, 1.0), (BACK[name], -1.0)):
                parts += [rest, one_way(np.multiply(sign, LINES[name]), speed, length)]
                labels += ["rest"] * rest.shape[1] + [label] * parts[-1].shape[1]
    omega = np.concatenate([*parts, rest], axis=1)
    labels += ["rest"] * rest.shape[1]
    theta = np.array([[1.0], [2.0]]) + np.cumsum(omega, axis=1) * STEP
    omega = omega + noise * np.random.default_rng(seed).standard_normal(omega.shape)
    return Motion(np.arange(omega.shape[1]) * STEP, theta, segments(omega), np.array(labels))


def cut(motion, **options):
    mask = seg.moving(motion.speeds, seg.default_w_min(motion.speeds))
    ids = seg.passes(motion.time, motion.speeds, mask)
    return mask, ids, seg.blocks(motion.time, motion.theta, ids, motion.speeds, **options)


def later(motion, begin):
    keep = motion.time > begin
    return Motion(motion.time[keep], motion.theta[:, keep], motion.speeds[:, keep], motion.label[keep])


def names(motion, mask):
    return "".join(dict.fromkeys(motion.label[mask]))


# --- moving ---------------------------------------------------------------------------------------------------------


def usual(speeds):
    """Three per cent of the mean speed while something moves."""
    return 0.03 * np.sum(np.abs(speeds), axis=1) / np.sum(np.abs(speeds) > 1e-3, axis=1)


@pytest.mark.parametrize("noise", [0.0, 0.003, 0.01, 0.03])
def test_w_min_is_five_deviations_of_the_speed_at_standstill_or_a_share_of_the_speed(noise):
    motion = manoeuvres(noise=noise)
    spread = 5 * noise * np.array([1, 1, 0.5**0.5, 0.5**0.5])
    expected = np.maximum(usual(motion.true_speeds), spread)
    np.testing.assert_allclose(seg.default_w_min(motion.speeds), expected, rtol=0.1)


def test_the_least_speed_of_ordinary_motions_of_a_leg_is_about_what_it_was_fixed_at_once():
    assert 0.01 < seg.default_w_min(manoeuvres(noise=0.0).speeds).max() < 0.03


@pytest.mark.parametrize("factor", [1 / 15.125, 100.0, 1e-4])
def test_a_motion_in_other_units_has_the_same_moving_samples_passes_blocks_and_pairs(factor):
    motion = manoeuvres(noise=0.003)
    mask, ids, blocks = cut(motion)
    other = Motion(motion.time, motion.theta * factor, motion.speeds * factor, motion.label)
    same, same_ids, same_blocks = cut(other)
    np.testing.assert_array_equal(mask, same)
    np.testing.assert_array_equal(ids, same_ids)
    for name in ("index", "line", "repeat"):
        np.testing.assert_array_equal(getattr(blocks, name), getattr(same_blocks, name))
    np.testing.assert_array_equal(seg.pairs(motion.theta, ids).i, seg.pairs(other.theta, ids).i)


def test_creeping_passes_beside_fast_ones_are_moving():
    motion = manoeuvres(speeds=(0.02, 0.2, 2.0), lines="A", repeats=1, length=1.0, noise=0.0)
    assert cut(motion)[1].max() + 1 == 6


def test_each_segment_has_a_least_speed_of_its_own_scale():
    speeds = manoeuvres(noise=0.0).speeds
    mixed = speeds * np.array([[1.0], [100.0], [1e-3], [1.0]])
    np.testing.assert_array_equal(seg.moving(mixed, seg.default_w_min(mixed)),
                                  seg.moving(speeds, seg.default_w_min(speeds)))


def test_standstill_is_found_without_labels_and_holds_no_motion():
    motion = manoeuvres(speeds=(0.1, 1.6))
    rest = seg.standstill(motion.speeds)
    assert rest.mean() > 0.005 and set(motion.label[rest]) == {"rest"}


def test_a_log_without_standstill_gets_a_share_of_its_speed():
    speeds = np.array([1 + 0.1 * np.sin(np.arange(0, 10, STEP))])
    assert seg.default_w_min(speeds) == pytest.approx(usual(speeds), rel=1e-6)
    noisy = speeds + 0.02 * np.random.default_rng(0).standard_normal(speeds.shape)
    assert seg.default_w_min(noisy) == pytest.approx(0.1, rel=0.2)  # five deviations of what is not motion
    assert seg.default_w_min(speeds, noise=0.03) == pytest.approx(0.15)


def test_both_sides_of_a_reversal_between_two_samples_are_left_out():
    speeds = np.array([[1.0, 0.5, 0.1, -0.3, -0.7, 0.0, 0.7]])
    np.testing.assert_array_equal(seg.moving(speeds, 0.02), [True, True, False, False, True, False, True])
    assert seg.moving(speeds, 0.02, np.arange(7)).sum() == 6  # of runs of one sample each, none is beside another


def test_moving_means_that_every_segment_moves():
    speeds = np.array([[1.0, 1.0, 0.0, np.nan], [-1.0, 0.01, 0.0, 1.0]])
    np.testing.assert_array_equal(seg.moving(speeds, 0.02), [True, False, False, False])


# --- passes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [0.0, 0.003, 0.01])
def test_each_way_along_a_line_is_one_pass(noise):
    motion = manoeuvres(noise=noise)
    mask, ids, _ = cut(motion)
    assert ids.max() + 1 == 24 and np.all((ids >= 0) == mask)
    assert [names(motion, ids == k) for k in range(6)] == list("ABCDEF")


def test_a_pass_without_dwell_ends_where_the_sign_changes():
    _, ids, _ = cut(manoeuvres(dwell=STEP, lines="A", repeats=2, speeds=(1.6,)))
    assert ids.max() + 1 == 4


def test_another_commanded_speed_begins_another_pass_but_a_ramp_does_not():
    level = np.concatenate([np.linspace(0, 1, 50), np.full(200, 1.0), np.linspace(1, 2, 30), np.full(200, 2.0),
                            np.linspace(2, 0, 50)])
    speeds = np.outer([1.0, -0.7], level) + 0.02 * np.random.default_rng(0).standard_normal((2, level.size))
    time = np.arange(level.size) * STEP
    ids = seg.passes(time, speeds, seg.moving(speeds, 0.1))
    assert ids.max() + 1 == 2
    assert np.flatnonzero(ids == 1)[0] == pytest.approx(265, abs=20)


def test_slow_variation_of_speed_is_one_pass():
    time = np.arange(0, 20, STEP)
    speeds = np.array([1.0 + 0.3 * np.sin(time)])
    assert seg.passes(time, speeds, seg.moving(speeds, 0.02)).max() == 0


def test_a_gap_in_time_and_another_run_break_a_pass():
    time, speeds = np.arange(100) * STEP, np.ones((1, 100))
    mask = np.ones(100, dtype=bool)
    assert seg.passes(np.where(time < 0.5, time, time + 3), speeds, mask).max() == 1
    run = np.repeat([0, 1], 50)
    ids = seg.passes(np.tile(time[:50], 2), speeds, mask, run)
    np.testing.assert_array_equal(ids, run)


def test_flicker_about_w_min_does_not_break_a_pass():
    time, mask = np.arange(100) * STEP, np.ones(100, dtype=bool)
    mask[[3, 5, 6]] = False
    ids = seg.passes(time, np.ones((1, 100)), mask)
    assert set(ids[mask]) == {0} and set(ids[~mask]) == {-1}


def test_nothing_moving_is_no_pass():
    assert set(seg.passes(np.arange(5.0), np.zeros((1, 5)), np.zeros(5, dtype=bool))) == {-1}


# --- blocks ---------------------------------------------------------------------------------------------------------


def test_a_block_is_out_and_back_with_its_reversal():
    motion = manoeuvres()
    _, ids, blocks = cut(motion)
    assert len(blocks) == 12
    assert [names(motion, (blocks.index == k) & (ids >= 0)) for k in range(3)] == ["AB", "CD", "EF"]
    np.testing.assert_array_equal(blocks.line, [0, 1, 2] * 4)
    np.testing.assert_allclose(blocks.speed, np.repeat([0.4, 1.6, 0.4, 1.6], 3), rtol=0.02)
    np.testing.assert_array_equal(blocks.repeat, np.repeat([0, 1], 6))


def test_every_sample_is_in_exactly_one_block_contiguous_in_time():
    motion = manoeuvres()
    _, _, blocks = cut(motion)
    np.testing.assert_array_equal(np.unique(np.diff(blocks.index)), [0, 1])
    assert blocks.t0[0] == motion.time[0] and blocks.t1[-1] == motion.time[-1]
    assert np.all(blocks.t0[1:] - blocks.t1[:-1] == pytest.approx(STEP))


def test_passes_without_a_way_back_join_the_neighbouring_block():
    motion = later(manoeuvres(repeats=5, speeds=(1.6,), lines="CA"), 3.6)  # C is gone, D is left alone
    _, ids, blocks = cut(motion)
    assert len(blocks) == 9 and blocks.straight and names(motion, ids >= 0).startswith("DAB")


def test_of_few_passes_some_without_a_way_back_each_is_a_stretch_of_its_own():
    motion = later(manoeuvres(repeats=1, speeds=(1.6,), lines="CA"), 3.6)
    _, ids, blocks = cut(motion)
    assert len(blocks) == 3 and not blocks.straight and names(motion, ids >= 0) == "DAB"
    _, _, together = cut(motion, paired=True)  # else no way back would be compared with its way out
    assert len(together) == 1 and together.straight
    _, _, whole = cut(manoeuvres(repeats=1, speeds=(1.6,), lines="CA"))
    assert len(whole) == 2 and whole.straight


def test_a_staircase_of_speeds_is_one_block():
    out = [one_way((1.0, -1.0), 1.0, 3.0)[:, :-20], one_way((1.0, -1.0), 2.0, 4.0)[:, 10:]]
    rest, back = np.zeros((2, 50)), [-way[:, ::-1] for way in out[::-1]]
    omega = np.concatenate([rest, *out, rest, *back, rest], axis=1)
    motion = Motion(np.arange(omega.shape[1]) * STEP, np.cumsum(omega, axis=1) * STEP, segments(omega), np.empty(0))
    _, ids, blocks = cut(motion)
    assert ids.max() + 1 == 4 and len(blocks) == 1


def test_a_run_of_one_pass_is_one_block():
    motion = manoeuvres(repeats=1, speeds=(1.6,), lines="A")
    keep = motion.time < 2.5
    motion = Motion(motion.time[keep], motion.theta[:, keep], motion.speeds[:, keep], motion.label[keep])
    assert len(cut(motion)[2]) == 1
    still = seg.blocks(np.arange(5.0), np.zeros((2, 5)), np.full(5, -1), np.zeros((4, 5)))
    assert len(still) == 1 and still.speed[0] == 0


def gait(duration=60.0, noise=0.003, seed=0):
    """Two joints in ordinary motion: three harmonics, nothing repeats quite, no straight line."""
    time, rng = np.arange(0, duration, STEP), np.random.default_rng(seed)
    phase = 2 * np.pi * (0.3 * time + 0.02 * np.sin(0.2 * time))
    theta = np.array([sum(a * np.sin(k * phase + rng.uniform(0, 6)) for k, a in ((1, 3.0), (2, 1.3), (3, 0.5)))
                      for _ in range(2)])
    omega = np.gradient(theta, STEP, axis=1) + noise * rng.standard_normal(theta.shape)
    return Motion(time, theta, segments(omega), np.empty(0))


def test_ordinary_motion_is_cut_into_some_twenty_stretches_between_passes():
    motion = gait()
    _, ids, blocks = cut(motion)
    assert 15 <= len(blocks) <= 20 and not blocks.straight
    assert all(len(np.unique(blocks.index[ids == k])) == 1 for k in range(ids.max() + 1)), "cut inside a pass"
    share = np.bincount(blocks.index[ids >= 0]) / np.sum(ids >= 0)
    assert share.max() < 0.12
    test = seg.split(blocks, 1)
    np.testing.assert_array_equal(np.flatnonzero(test), np.arange(3, len(blocks), 4))
    assert set(seg.folds(blocks.take(~test))) == {0, 1, 2, 3, 4}
    assert cut(manoeuvres())[2].straight


@pytest.mark.parametrize("stop", [0.2, 0.4, 1.0])
def test_a_stop_at_the_end_of_a_log_changes_nothing_before_it(stop):
    motion, rng = gait(), np.random.default_rng(1)
    omega = motion.speeds[:2]
    end = np.concatenate([omega[:, -1:] * np.linspace(1, 0, 30), np.zeros((2, int(stop / STEP)))], axis=1)
    omega = np.concatenate([omega, end + 0.003 * rng.standard_normal(end.shape)], axis=1)
    stopped = Motion(np.arange(omega.shape[1]) * STEP, np.cumsum(omega, axis=1) * STEP, segments(omega), np.empty(0))
    np.testing.assert_allclose(seg.default_w_min(stopped.speeds), seg.default_w_min(motion.speeds), rtol=0.02)
    assert len(cut(stopped)[2]) == len(cut(motion)[2])


def test_a_short_log_of_ordinary_motion_still_has_ten_blocks():
    assert len(cut(gait(duration=8.0))[2]) >= 10


def test_a_run_of_ordinary_motion_beside_one_of_passes_leaves_those_blocks_as_they_are():
    straight, other = manoeuvres(), gait()
    run = np.repeat([0, 1], [straight.time.size, other.time.size])
    time, theta, speeds = (np.concatenate([a, b], axis=-1) for a, b in zip(
        (straight.time, straight.theta, straight.speeds), (other.time, other.theta, other.speeds)))
    ids = seg.passes(time, speeds, seg.moving(speeds, 0.02), run)
    blocks = seg.blocks(time, theta, ids, speeds, run)
    assert np.sum(blocks.run == 0) == 12 and np.sum(blocks.run == 1) >= 10
    np.testing.assert_array_equal(blocks.line[:12], [0, 1, 2] * 4)
    assert np.all(blocks.repeat[12:] == 0)


def test_blocks_never_cross_runs_and_lines_are_the_same_in_all():
    motion = manoeuvres(repeats=1)
    n = motion.time.size
    run = np.repeat([0, 1, 2], n)
    speeds, theta, time = np.tile(motion.speeds, 3), np.tile(motion.theta, 3), np.tile(motion.time, 3)
    ids = seg.passes(time, speeds, seg.moving(speeds, 0.02), run)
    blocks = seg.blocks(time, theta, ids, speeds, run)
    np.testing.assert_array_equal(blocks.run, np.repeat([0, 1, 2], 6))
    np.testing.assert_array_equal(blocks.line, [0, 1, 2] * 6)
    np.testing.assert_array_equal(blocks.repeat, np.repeat([0, 1, 2], 6))
    assert np.all(run == blocks.run[blocks.index])


def test_one_angle_is_enough():
    time = np.arange(0, 60, STEP)
    angle, speeds = np.sin(time), np.cos(time)[None]
    ids = seg.passes(time, speeds, seg.moving(speeds, 0.02))
    blocks = seg.blocks(time, angle[None], ids, speeds)
    pairs = seg.pairs(angle[None], ids, block=blocks.index)
    assert len(blocks) in (9, 10) and set(blocks.line) == {0}
    np.testing.assert_allclose(*pairs.at(angle), atol=1e-3)
    assert np.all(speeds[0, pairs.i] * speeds[0, pairs.j0] < 0) and pairs.i.size > 0.4 * time.size


def test_files_of_one_sample_are_blocks_of_their_own():
    speeds = np.array([[1.0, -1.0, 2.0, -2.0]])
    run = np.arange(4)
    blocks = seg.blocks(np.zeros(4), np.cumsum(speeds, axis=1), run, speeds, run)
    np.testing.assert_array_equal(blocks.index, run)
    np.testing.assert_array_equal(blocks.repeat, [0, 1, 0, 1])


# --- test part and folds --------------------------------------------------------------------------------------------


def test_of_one_file_the_last_repeat_of_each_line_and_speed_is_the_test_part():
    _, _, blocks = cut(manoeuvres(repeats=3))
    np.testing.assert_array_equal(seg.split(blocks, 1), blocks.repeat == 2)


def test_without_repeats_every_fourth_block_is_the_test_part():
    _, _, blocks = cut(manoeuvres(repeats=1))
    np.testing.assert_array_equal(np.flatnonzero(seg.split(blocks, 1)), [3])


def test_of_several_files_the_held_out_ones_are_the_test_part_else_every_fourth():
    run = np.repeat(np.arange(9), 2)
    blocks = seg.Blocks(np.arange(18), run, run * 0, run * 0.0, run * 0, run * 0.0, run * 0.0)
    assert set(run[seg.split(blocks, 9, [1, 5])]) == {1, 5}
    assert set(run[seg.split(blocks, 9)]) == {3, 7}
    with pytest.raises(DataError, match="nothing is left to fit"):
        seg.split(blocks, 2, [0, 1])


def test_of_fewer_than_four_files_none_is_held_out_as_a_whole():
    run, line, repeat = np.array([0, 0, 0, 0, 1, 1, 1, 1]), np.array([0, 0, 1, 1, 2, 2, 3, 3]), np.tile([0, 1], 4)
    blocks = seg.Blocks(np.arange(8), run, line, run * 0.0, repeat, run * 0.0, run * 0.0)
    np.testing.assert_array_equal(seg.split(blocks, 2), repeat == 1)
    means = blocks.take(repeat == 0)  # as of files of which each is one mean
    np.testing.assert_array_equal(np.flatnonzero(seg.split(means.take(np.arange(4) < 3), 3)), [2])


def test_a_block_that_moves_as_no_other_does_is_fitted_instead_of_its_neighbour():
    index = np.repeat(np.arange(4), 10)
    blocks = seg.Blocks(index, np.zeros(4), np.arange(4), np.ones(4), np.zeros(4), np.zeros(4), np.ones(4))
    one, other = np.ones(40), np.where(index == 3, -1.0, 1.0)
    moving = np.arange(40) != 15  # still for a moment
    ways = seg.ways(blocks, np.array([one, other]), moving)
    assert ways.sum(1).tolist() == [10, 9, 10, 10]
    np.testing.assert_array_equal(np.flatnonzero(seg.split(blocks, 1, ways=ways)), [2])
    alike = seg.ways(blocks, np.array([one, np.where(index > 1, -1.0, 1.0)]), moving)
    np.testing.assert_array_equal(np.flatnonzero(seg.split(blocks, 1, ways=alike)), [3])
    lonely = seg.ways(blocks, np.where(np.arange(4)[:, None] == index, -1.0, 1.0), moving)
    np.testing.assert_array_equal(np.flatnonzero(seg.split(blocks, 1, ways=lonely)), [3])


def test_folds_share_out_lines_and_speeds():
    _, _, blocks = cut(manoeuvres(repeats=4))
    fit = blocks.take(~seg.split(blocks, 1))
    fold = seg.folds(fit, 3)
    for line, speed in set(zip(fit.line, fit.speed)):
        assert sorted(fold[(fit.line == line) & (fit.speed == speed)]) == [0, 1, 2]
    assert np.ptp(np.bincount(seg.folds(fit))) <= 1
    assert set(seg.folds(fit.take(np.arange(len(fit)) < 2))) == {0, 1}


def test_taken_blocks_keep_their_samples():
    _, _, blocks = cut(manoeuvres())
    mask = blocks.line == 1
    np.testing.assert_array_equal(blocks.take(mask).index >= 0, blocks.samples(mask))


# --- pairs ----------------------------------------------------------------------------------------------------------


def test_pairs_meet_in_one_configuration_going_opposite_ways():
    motion = manoeuvres()
    mask, ids, blocks = cut(motion)
    pairs = seg.pairs(motion.theta, ids)
    here, there = pairs.at(motion.theta)
    assert np.linalg.norm(here - there, axis=0).max() < 0.005 * np.linalg.norm(np.ptp(motion.theta, axis=1))
    speeds = motion.true_speeds[:2]
    assert np.all(np.sum(speeds[:, pairs.i] * speeds[:, pairs.j0], axis=0) < 0)
    assert np.all((pairs.weight >= 0) & (pairs.weight <= 1)) and np.all(pairs.j1 == pairs.j0 + 1)
    assert pairs.i.size > 0.45 * mask.sum()


def test_the_way_back_that_is_next_in_time_is_the_partner_and_no_sample_counts_twice():
    motion = manoeuvres(lines="A", repeats=3)
    _, ids, _ = cut(motion)
    pairs = seg.pairs(motion.theta, ids)
    assert set(ids[pairs.j0] - ids[pairs.i]) == {1} and set(ids[pairs.i] % 2) == {0}
    assert np.all(pairs.i < pairs.j0) and np.unique(pairs.i).size == pairs.i.size
    assert not set(pairs.i) & set(pairs.j0)


def test_pairs_can_be_kept_within_a_block():
    motion = manoeuvres()
    _, ids, blocks = cut(motion)
    pairs = seg.pairs(motion.theta, ids, block=blocks.index)
    np.testing.assert_array_equal(blocks.index[pairs.i], blocks.index[pairs.j1])


def test_out_and_back_may_be_in_different_files():
    motion = manoeuvres(lines="A", repeats=1, speeds=(1.6,))
    run = (motion.label == "B").cumsum().clip(0, 1)
    ids = seg.passes(motion.time, motion.speeds, seg.moving(motion.speeds, 0.02), run)
    pairs = seg.pairs(motion.theta, ids, run)
    assert pairs.i.size > 100 and set(run[pairs.i]) == {0} and set(run[pairs.j0]) == {1}


def test_without_a_way_back_there_are_no_pairs():
    line = np.linspace(0, 1, 50)
    assert seg.pairs(np.array([line, line]), np.zeros(50, dtype=int)).i.size == 0
    assert seg.pairs(np.zeros((2, 5)), np.full(5, -1)).i.size == 0
    beside = np.concatenate([np.array([line, line]), np.array([line[::-1] + 1, line[::-1]])], axis=1)
    assert seg.pairs(beside, np.repeat([0, 1], 50)).i.size == 0

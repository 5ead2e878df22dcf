"""Claims about the workspace: zones, stops and domains follow from the compiled kinematics."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pycosim.compile import Library, compile_model
from pycosim.core.errors import PlanError, StudyError, UnknownNameError
from pycosim.design.workspace import Kinematics, Limits, Workspace, kinematics, limits_of, read_limits
from pycosim.study.parse import load_study
from pycosim.study.write import write_study

STUDY = "examples/hip_knee/study.toml"
RATIO = 15.125
# the paper's table: motion in (theta1', theta2'), and the branches of 1A, 1B, 2A, 2B for positive motor torques
PAPER = {
    "A": ((1, -1), "direct direct reverse reverse"), "B": ((-1, 1), "reverse reverse direct direct"),
    "C": ((1, 0.5), "direct direct direct reverse"), "D": ((-1, -0.5), "reverse reverse reverse direct"),
    "E": ((0.5, 1), "direct reverse direct direct"), "F": ((-0.5, -1), "reverse direct reverse reverse"),
}


@pytest.fixture(scope="module")
def hip_knee():
    study, library = load_study(STUDY), Library()
    model = study.validate(library)
    kin = kinematics(model)
    return Workspace(kin, limits_of(study, model, kin))


def test_the_kinematics_are_those_of_the_paper(hip_knee):
    kin = hip_knee.kinematics
    np.testing.assert_allclose(kin.joint, np.array([[1, 1], [1, -1]]) / (2 * RATIO))
    speeds = dict(zip(kin.segments, kin.speed.tolist()))
    assert speeds == {"s1A": [1, 0], "s2A": [0, 1], "s1B": [0.5, -0.5], "s2B": [-0.5, 0.5]}


def test_the_six_manoeuvres_are_the_zones_and_their_directions(hip_knee):
    zones = {tuple(np.round(z.direction, 9).tolist()): z for z in hip_knee.zones}
    assert set(zones) == {tuple(map(float, d)) for d, _ in PAPER.values()}
    order = [hip_knee.kinematics.segments.index(s) for s in ("s1A", "s1B", "s2A", "s2B")]
    for direction, branches in PAPER.values():
        found = zones[tuple(map(float, direction))].branches([1, 1, 1, 1])
        assert [found[k] for k in order] == branches.split()


def test_zones_come_in_opposite_pairs(hip_knee):
    for one, other in zip(hip_knee.zones[::2], hip_knee.zones[1::2]):
        assert one.signs == tuple(-s for s in other.signs)
        np.testing.assert_allclose(one.direction, -other.direction)


def test_the_paper_s_lines_of_standstill_are_found(hip_knee):
    found = {tuple(row): segments for row, segments in hip_knee.still}
    assert found == {(1, 0): ["s1A"], (0, 1): ["s2A"], (1, -1): ["s1B", "s2B"]}


def test_joint_stops_and_one_relative_stop_make_a_hexagon(hip_knee):
    corners = hip_knee.vertices
    assert len(corners) == 6
    q_h, q_k = hip_knee.kinematics.angles(corners.T)
    ends = [(-0.35, 2.0), (-2.0, 0.1), (-1.2, 1.5)]
    on = [[min(abs(v - e) for e in limits) < 1e-9 for limits, v in zip(ends, (h, k, h + k))] for h, k in zip(q_h, q_k)]
    assert [sum(row) for row in on] == [2] * 6
    np.testing.assert_allclose(hip_knee.margin(corners.T), 0, atol=1e-9)


def test_both_motors_on_one_joint_give_twice_the_torque_and_no_more_speed(hip_knee):
    coupled, single = hip_knee.torques()
    np.testing.assert_allclose(np.abs(coupled).max(axis=0), 2 * RATIO * 14.98)  # 453 N.m, as published
    np.testing.assert_allclose(np.abs(coupled).sum(axis=1), 2 * RATIO * 14.98)
    np.testing.assert_allclose(np.abs(single), RATIO * 14.98)
    coupled, single = hip_knee.rates()
    np.testing.assert_allclose(np.abs(coupled).sum(axis=1), 2.4 / RATIO)
    np.testing.assert_allclose(np.abs(single), 2.4 / RATIO)


def test_one_motor_has_two_zones():
    kin = kinematics(compile_model(Library(), "DriveTrain.Rigs.GearedJoint"))
    found = Workspace(kin, Limits(np.array([[0.02]]), np.array([-1.0]), np.array([2.0]), ["q"], *np.ones((3, 1))))
    assert [z.signs for z in found.zones] == [(1,), (-1,)]
    np.testing.assert_allclose(np.sort(found.vertices[:, 0]), [-50, 100])


def test_a_rig_without_motor_angle_says_so():
    with pytest.raises(StudyError, match="no motor angle"):
        kinematics(compile_model(Library(), "DriveTrain.Rigs.ScrewDrive"))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2 ** 31), motors=st.integers(1, 4), segments=st.integers(1, 5))
def test_every_motion_is_in_one_zone_of_any_machine(seed, motors, segments):
    rng = np.random.default_rng(seed)
    speed = rng.standard_normal((segments, motors))
    joint = rng.standard_normal((motors, motors)) + 3 * np.eye(motors)
    names = [f"q{k}" for k in range(motors)]
    kin = Kinematics([f"m{k}" for k in range(motors)], names, [f"s{k}" for k in range(segments)], joint,
                     np.zeros(motors), speed, {})
    limits = Limits(joint, -rng.uniform(0.5, 2, motors), rng.uniform(0.5, 2, motors), names, *np.ones((3, motors)))
    found = Workspace(kin, limits)
    signs = [z.signs for z in found.zones]
    assert len(set(signs)) == len(signs)
    for v in rng.standard_normal((200, motors)):
        s = np.sign(speed @ v).astype(int)
        if np.abs(speed @ v).min() > 1e-2:  # the narrowest zones are none
            assert tuple(s.tolist()) in signs
    for z in found.zones:
        np.testing.assert_array_equal(np.sign(speed @ z.direction), z.signs)
    assert found.margin(found.vertices.T).min() > -1e-6 and len(found.vertices) == 2 ** motors


def limits_with(hip_knee, **given):
    study = load_study(STUDY)
    study.limits.update({k.replace("__", "."): v for k, v in given.items()})
    model = study.validate(Library())
    return Workspace(hip_knee.kinematics, limits_of(study, model, hip_knee.kinematics))


def test_stops_that_contradict_each_other_are_named(hip_knee):
    with pytest.raises(PlanError, match="min 1.8 rad of 'q_H'.* contradict each other"):
        limits_with(hip_knee, q_H=(1.8, 2.0), q_K=(0.0, 0.1)).centre  # noqa: B018


def test_a_limit_of_nothing_names_the_nearest(hip_knee):
    with pytest.raises(UnknownNameError, match="no variable 'q_Hip' in DriveTrain.Rigs.HipKnee; closest: 'q_H'"):
        limits_with(hip_knee, q_Hip=(0.0, 1.0))
    with pytest.raises(UnknownNameError, match="no angle 'C_H' of a joint or motor; closest: 'q_H'"):
        limits_with(hip_knee, C_H=(0.0, 1.0))


def test_a_motor_that_may_not_stand_still_is_refused(hip_knee):
    with pytest.raises(PlanError, match="'motor1.w' from 0.5 to 2 rad/s"):
        limits_with(hip_knee, motor1__w=(0.5, 2.0))


def test_missing_stops_are_asked_for(hip_knee):
    with pytest.raises(PlanError, match="q_H, q_K"):
        Workspace(hip_knee.kinematics, Limits(np.array([[1.0, 0.0]]), np.array([-1.0]), np.array([1.0]), ["q"],
                                              *np.ones((3, 2)))).vertices  # noqa: B018


def test_sums_and_multiples_of_angles_are_read(hip_knee):
    row, zero = read_limits("2 * q_H - 0.5*motor2.phi", hip_knee.kinematics)
    np.testing.assert_allclose(row, [1 / RATIO, 1 / RATIO - 0.5])
    assert zero == 0


def test_limits_survive_writing_a_study(tmp_path):
    study = load_study(STUDY)
    assert load_study(write_study(study, tmp_path / "again.toml")).limits == study.limits

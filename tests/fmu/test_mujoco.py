"""The MJCF export: MuJoCo accelerates and swings the rigs as we do, and what it cannot do is listed."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from pycosim.cli.entry import main
from pycosim.core.errors import StudyError
from pycosim.dynamics.simulate import simulate
from pycosim.export.description import describe, values
from pycosim.export.mujoco import to_mjcf
from pycosim.study.schema import Setting

ACCELERATIONS = {"GearedJoint": ["load.a"], "ServoPendulum": ["pendulum.a"], "ScrewDrive": ["motor.a"],
                 "HipKnee": ["leg.a_H", "leg.a_K"]}


@pytest.fixture(scope="module")
def chosen(study):
    """Studies with values of their own, inertia in every rotor and a tilted base among them."""
    given = {"GearedJoint": {"load.tilt": 0.3, "load.arm": 0.2}, "ServoPendulum": {"pendulum.arm": 7e-3,
             "pendulum.J": 4e-4}, "ScrewDrive": {"nut.m": 3.0},
             "HipKnee": {"motor1.J": 1e-3, "motor2.J": 2e-3, "leg.tilt": -0.2}}

    def make(rig, **more):
        base, own = study(rig), {n: Setting(v) for n, v in {**given[rig], **more}.items()}
        return replace(base, parameters={**base.parameters, **own})
    return make


def loaded(chosen, library, rig, **more):
    """MuJoCo's model of a rig, ours, and our parameters."""
    mujoco = pytest.importorskip("mujoco")
    made = chosen(rig, **more)
    model = made.validate(library)
    return mujoco, mujoco.MjModel.from_xml_string(to_mjcf(describe(made, model))[0]), model, values(made, model)


@pytest.mark.parametrize("rig", ACCELERATIONS)
def test_it_accelerates_from_rest_as_ours_without_friction(chosen, library, rig):
    """At rest, with no elastic displacement, our friction is zero: masses, gravity, rotors and drives are left."""
    mujoco, theirs, model, parameters = loaded(chosen, library, rig)
    theirs.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
    data, rng = mujoco.MjData(theirs), np.random.default_rng(3)
    joints = [theirs.joint(k).name for k in range(theirs.njnt)]
    drives = [theirs.actuator(k).name for k in range(theirs.nu)]
    for _ in range(10):
        data.qpos[:], data.ctrl[:] = rng.uniform(-2, 2, theirs.nq), rng.uniform(-1, 1, theirs.nu)
        mujoco.mj_forward(theirs, data)
        ours = simulate(model, dict(zip(drives, data.ctrl)), [0.0], parameters, dict(zip(joints, data.qpos)))
        wanted = [ours[n][0] for n in ACCELERATIONS[rig]]
        assert np.allclose(data.qacc, wanted, rtol=1e-8, atol=1e-8) and np.abs(wanted).max() > 0.1


@pytest.mark.parametrize(("rig", "start"), [("GearedJoint", {"q": 0.9}), ("HipKnee", {"q_H": 0.5, "q_K": -0.4})])
def test_it_swings_as_ours_without_friction(chosen, library, rig, start):
    segments = ("gear",) if rig == "GearedJoint" else ("s1A", "s2A", "s1B", "s2B")
    without = {f"{c}.{n}": v for c in segments for n, v in (("f0", 0.0), ("mu", 1.0))}
    if rig == "GearedJoint":
        without |= {"stribeck_gear.fs": 0.0}
    mujoco, theirs, model, parameters = loaded(chosen, library, rig, **without)
    theirs.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    data, time = mujoco.MjData(theirs), np.arange(1001) * 1e-3
    joints = [theirs.joint(k).name for k in range(theirs.njnt)]
    data.qpos[:] = [start[n] for n in joints]
    swung = [data.qpos.copy()]
    for _ in time[1:]:
        mujoco.mj_step(theirs, data)
        swung.append(data.qpos.copy())
    ours = simulate(model, {}, time, parameters, start, step=2.5e-4)
    wanted = np.array([ours[n] for n in joints]).T
    assert np.ptp(wanted, axis=0).min() > 0.3
    assert np.abs(swung - wanted).max() < 1e-5


def test_friction_without_load_slows_it_as_ours(chosen, library):
    """A servo whose friction is a constant and a viscous part at any load: MuJoCo has both."""
    mujoco, theirs, model, parameters = loaded(chosen, library, "ServoPendulum")
    theirs.opt.timestep = 2.5e-4
    data, time = mujoco.MjData(theirs), np.arange(801) * 2.5e-4
    data.qpos[:] = 1.2
    swung = [1.2]
    for _ in time[1:]:
        mujoco.mj_step(theirs, data)
        swung.append(data.qpos[0])
    ours = simulate(model, {}, time, parameters, {"motor.phi": 1.2})["motor.phi"]
    assert np.abs(swung - ours).max() < 0.02 * np.ptp(ours)


def test_what_it_cannot_is_measured_and_listed(study, library):
    made = replace(study("HipKnee"), effects=[
        ("direction_asymmetry", "2A"), ("thermal_drift", "1B"), ("stribeck", "2B"), ("torque_ripple", "motor1"),
        ("viscous", "1A"), ("rotor_inertia", "motor2")],
                   parameters={"direction_asymmetry_2A.a": Setting(0.1), "thermal_drift_1B.k": Setting(0.5),
                               "stribeck_2B.fs": Setting(0.03), "viscous_1A.b": Setting(1e-3),
                               "rotor_inertia_motor2.J": Setting(3e-4)})
    text, missing = to_mjcf(describe(made, made.validate(library)))
    for words in (("s1A", "load", "0.0513"), ("s2A", "s2A.z"), ("s1B", "time"), ("s2B", "at rest", "0.0487"),
                  ("torque_ripple", "motor1"), ("Sticking",)):
        assert [m for m in missing if all(w in m for w in words)], words
    assert not [m for m in missing if "viscous" in m or "rotor_inertia" in m]
    tendons = {t.get("name"): t for t in ElementTree.fromstring(text).iter("fixed")}
    assert float(tendons["s1A"].get("damping")) == pytest.approx(1e-3)
    assert float(tendons["motor2"].get("armature")) == pytest.approx(3e-4)
    assert [float(j.get("coef")) for j in tendons["motor2"]] == [15.125, -15.125]


def test_stops_torques_and_sensors_are_those_of_the_study(study, library):
    """Pushed with more than it has, a leg ends at its stops; encoders and torques are read from sensors."""
    mujoco = pytest.importorskip("mujoco")
    limits = {"q_H": (-0.35, 1.2), "q_K": (-2.0, 0.1), "q_H + q_K": (-1.2, None), "motor1.tau": (None, 4.0),
              "motor2.w": (None, 2.4)}
    made = replace(study("HipKnee"), limits=limits)
    text, missing = to_mjcf(describe(made, made.validate(library)))
    assert any("motor2.w" in m for m in missing) and not any("motor1.tau" in m or "limit of q_H" in m for m in missing)
    theirs = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(theirs)
    sensor = {theirs.sensor(k).name: theirs.sensor(k).adr[0] for k in range(theirs.nsensor)}
    assert {"q_H", "der(q_K)", "motor1.phi", "motor2.w", "tau1.force"} < set(sensor)
    data.ctrl[:] = [9.0, 9.0]
    for _ in range(4000):
        mujoco.mj_step(theirs, data)
    mujoco.mj_forward(theirs, data)
    q = dict(zip((theirs.joint(k).name for k in range(theirs.njnt)), data.qpos))
    assert q["q_H"] < 1.25 and -2.05 < q["q_K"] < 0.15 and q["q_H"] + q["q_K"] > -1.25
    assert data.sensordata[sensor["tau1.force"]] == 4.0 and data.sensordata[sensor["tau2.force"]] == 9.0
    assert data.sensordata[sensor["q_H"]] == pytest.approx(q["q_H"])
    assert data.sensordata[sensor["motor1.phi"]] == pytest.approx(15.125 * (q["q_H"] + q["q_K"]))
    assert q["q_H"] > 1.15  # at its stop


def test_the_command_line_writes_the_list_beside_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.toml").write_text('[rig]\nmodel = "DriveTrain.Rigs.GearedJoint"\n')
    assert main(["export", "arm.toml", "--to", "mujoco"]) == 0
    said, listed = capsys.readouterr().out, (tmp_path / "arm_export" / "arm_not_in_mujoco.txt").read_text()
    assert all(f"Not in MuJoCo: {line}" in said for line in listed.splitlines()) and "load" in listed
    comment = (tmp_path / "arm_export" / "arm.xml").read_text().partition("<compiler")[0]
    assert all(line in comment for line in listed.splitlines())


def test_a_rig_without_links_is_refused(study, model):
    with pytest.raises(StudyError, match="no links with a mass"):
        to_mjcf(describe(study("HipKneeTransmission"), model("HipKneeTransmission")))

"""The drive in other engines: its law is the FMU's, and MuJoCo with the plugin moves, holds, saves and resets as it."""

import copy
import ctypes
import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.engines.machines import four_legs, on_links, steps
from pycosim.cli.entry import main
from pycosim.compile import Library
from pycosim.core.errors import StudyError
from pycosim.dynamics.simulate import simulate
from pycosim.export import build, mujoco_plugin
from pycosim.export.description import describe, values
from pycosim.export.law import drive_law
from pycosim.export.mujoco import to_mjcf
from pycosim.study.schema import Setting

LIBRARY_ = Library()
RIGS = {
    "GearedJoint": ([("viscous", "gear"), ("stribeck", "gear"), ("torque_ripple", "motor"), ("load_hysteresis", "gear"),
                     ("direction_asymmetry", "gear"), ("thermal_drift", "gear")],
                    {"torque_ripple_motor.A": 0.01, "torque_ripple_motor.n": 4.0, "load_hysteresis_gear.mu_dif": 0.02,
                     "load_hysteresis_gear.h": 0.02, "direction_asymmetry_gear.a": 0.1, "thermal_drift_gear.k": 0.2,
                     "gear.mu": 0.85}),
    "ServoPendulum": ([("load_dependence", "gear")], {"load_dependence_gear.mu": 0.8}),
    "HipKnee": ([("viscous", "1B")], {"motor1.J": 1e-3, "motor2.J": 2e-3, "s1A.mu": 0.9, "s2A.mu": 0.91,
                                      "viscous_1B.b": 1e-3}),
    "ScrewDrive": ([], {"nut.m": 3.0})}


@pytest.fixture(scope="module")
def case(study):
    """A rig with effects, all of whose losses count: study, model, values, law."""
    made = {}

    def make(rig):
        if rig not in made:
            effects, given = RIGS[rig]
            base = study(rig)
            own = replace(base, path=base.path.with_name(f"{rig.lower()}_engine.toml"),
                          effects=[*base.effects, *(e for e in effects if e not in base.effects)],
                          parameters={**base.parameters, **{n: Setting(v) for n, v in given.items()}})
            model = own.validate(LIBRARY_)
            known = values(own, model)
            made[rig] = own, model, known, drive_law(model, known)
        return made[rig]
    return make


@pytest.mark.parametrize("rig", RIGS)
def test_the_law_in_c_is_that_of_the_fmu(case, rig, tmp_path):
    _, model, known, law = case(rig)
    h, n = 1e-3, 3000
    ok, x, u, t, before, after, d = steps(model, known, law, n, h)
    names = law.motors
    wanted = np.array(on_links(rig, after, known)).T[ok]
    source = mujoco_plugin.law_source(law, ("prepare", "torque"))
    (tmp_path / "law.c").write_text("#include <math.h>\n" + source.replace("static void drive_", "void drive_"))
    subprocess.run([*build.compiler(build.host())[0], "-O1", "-shared", "-fPIC", "law.c", "-o", "law.so", "-lm"],
                   cwd=tmp_path, check=True)
    c = ctypes.CDLL(str(tmp_path / "law.so"))
    q, tau, states = (np.zeros(k) for k in (law.prepare.numel_out(0), len(names), max(1, len(law.states))))
    own = np.array([law.values[m] for m in law.parameters])
    c.drive_prepare(*[a.ctypes.data_as(ctypes.c_void_p) for a in (own, q)])
    columns = [[f"{m}.phi" for m in names], [f"{m}.w" for m in names], [f"{m}.a" for m in names]]
    phi, w, a = (np.array([after[m] for m in names_]).T for names_ in columns)
    mean = (phi - np.array([before[m] for m in columns[0]]).T) / h
    friction = [d.states.index(m) for m in law.states]
    drive = [d.inputs.index(m) for m in law.inputs]
    found, moved = [], []
    for k in np.flatnonzero(ok):
        given = [np.ascontiguousarray(v) for v in (phi[k], w[k], a[k], mean[k], x[k, friction], u[k, drive])]
        c.drive_torque(*[v.ctypes.data_as(ctypes.c_void_p) for v in given], ctypes.c_double(t[k] + h),
                       ctypes.c_double(h), *[v.ctypes.data_as(ctypes.c_void_p) for v in (q, tau, states)])
        found.append(tau.copy())
        moved.append(states[:len(friction)].copy())
    full = np.abs(wanted).max()
    assert np.abs(found - wanted).max() < 1e-9 * full
    assert np.abs(moved - np.array([after[m] for m in law.states]).T[ok]).max() < 1e-9


def test_rotors_are_left_to_the_engine(case):
    law = case("HipKnee")[3]
    assert np.allclose(law.inertia, np.diag([1e-3, 2e-3]))


def test_what_no_engine_can_take_is_refused(study, model):
    with pytest.raises(StudyError, match="no links with a mass"):
        transmission = model("HipKneeTransmission")
        drive_law(transmission, {n: v.value for n, v in transmission.parameters.items()})


# --- in MuJoCo


@pytest.fixture(scope="module")
def engine(case, tmp_path_factory):
    """A rig in MuJoCo with its plugin: module, MJCF."""
    mujoco = pytest.importorskip("mujoco")
    if mujoco_plugin.mujoco_folder() is None:
        pytest.skip("this MuJoCo has no headers")
    made = {}

    def make(rig):
        if rig not in made:
            own, model, _, law = case(rig)
            file, content = mujoco_plugin.build_plugin(mujoco_plugin.plugin_source(law, own.name), own.name)
            path = tmp_path_factory.mktemp("plugin") / file
            path.write_bytes(content)
            mujoco.mj_loadPluginLibrary(str(path))
            made[rig] = to_mjcf(describe(own, model), (mujoco_plugin.plugin_name(own.name), law.inputs))[0]
        return made[rig]
    return lambda rig: (mujoco, make(rig))


def started(mujoco, text, integrator=None, **options):
    model = mujoco.MjModel.from_xml_string(text)
    if integrator:
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    for name, value in options.items():
        setattr(model.opt, name, value)
    return model, mujoco.MjData(model)


@pytest.fixture(params=["implicitfast", "RK4"])
def integrator(request):
    return request.param


def coupled(text):
    """A robot of four legs, one drive of which pulls at two of them: what it moves is no branch of the tree."""
    tendon = '<tendon><fixed name="across"><joint joint="a0" coef="1"/><joint joint="a1" coef="-1"/></fixed></tendon>'
    text = text.replace('<plugin joint="a0"', '<plugin tendon="across"')
    return text.replace("<actuator>", f"{tendon}<actuator>")


@pytest.mark.parametrize(("rig", "robot"), [
    ("GearedJoint", None), ("ServoPendulum", None), ("HipKnee", None), ("ScrewDrive", None),
    ("ServoPendulum", lambda text: text), ("ServoPendulum", coupled)],
    ids=["geared", "servo", "hip-knee", "screw", "legs", "coupled legs"])
def test_the_torque_is_that_of_the_speed_at_the_end_of_the_step(case, engine, rig, robot):
    """Random states, reversals and rest: MuJoCo's own end of the step, put into the law, gives the plugin's torque."""
    _, _, _, law = case(rig)
    mujoco, text = engine(rig)
    robot = robot(four_legs("servopendulum_engine", base=False)) if robot else text
    model, data = started(mujoco, robot, "implicitfast", disableflags=mujoco.mjtDisableBit.mjDSBL_CONTACT.value)
    n, m, rng, worst, size = len(law.motors), len(law.states), np.random.default_rng(4), 0.0, 0.0
    for k in range(200):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = rng.uniform(-1, 1, model.nq), rng.uniform(-1, 1, model.nv) * 10.0 ** -(k % 4)
        data.ctrl[:] = rng.uniform(-1, 1, model.nu)
        data.xfrc_applied[-1] = rng.uniform(-1, 1, 6) * 0.1
        states = rng.uniform(-1, 1, model.nu // n * m)
        data.plugin_state[:len(states)] = states
        guesses = rng.uniform(-1, 1, 4 * model.nu) * 10.0 ** (k % 7)  # where it starts to search
        data.plugin_state[len(states) + model.nv:] = guesses
        mujoco.mj_forward(model, data)
        by = np.zeros((model.nu, model.nv))
        mujoco.mju_sparse2dense(by, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
        phi, w, t, h = data.actuator_length.copy(), data.actuator_velocity.copy(), data.time, model.opt.timestep
        mujoco.mj_step(model, data)
        v = by @ data.qvel
        for i in range(0, model.nu, n):
            part = slice(i, i + n)
            tau, after = law.torque(phi[part] + h * v[part], v[part], (v[part] - w[part]) / h, v[part],
                                    states[i // n * m:(i // n + 1) * m], data.ctrl[part], t + h, h, law.prepared())
            worst = max(worst, np.abs(np.ravel(tau) - data.actuator_force[part]).max())
            size = max(size, np.abs(data.actuator_force[part]).max())
            assert np.allclose(np.ravel(after), data.plugin_state[i // n * m:(i // n + 1) * m], rtol=0, atol=1e-9)
    assert worst < 1e-9 * size


def test_a_loaded_joint_at_rest_does_not_creep(engine, integrator):
    """At 80 % of breakaway for a minute, at 2 ms, without a motor torque that would hold it."""
    mujoco, text = engine("GearedJoint")
    model, data = started(mujoco, text, integrator, timestep=2e-3)
    trial, breakaway = copy.copy(data), 0.0
    while abs(trial.plugin_state[0]) < 0.99 and breakaway < 50:
        breakaway += 0.02
        trial.qfrc_applied[0] = breakaway
        mujoco.mj_step(model, trial, 20)
    assert 1 < breakaway < 50
    data.qfrc_applied[0] = 0.8 * breakaway
    mujoco.mj_step(model, data, 1000)
    where = data.qpos[0]
    mujoco.mj_step(model, data, 30000)
    assert abs(data.qpos[0] - where) < 1e-5 and 0.5 < abs(data.plugin_state[0]) < 0.9


@pytest.mark.parametrize("rig", ["GearedJoint", "HipKnee", "ServoPendulum"])
def test_it_is_stable_at_long_steps_and_takes_energy(engine, rig, integrator):
    """Let go, at 2 and 5 ms and with a travel a hundredth of the default: it comes to rest, and stays there."""
    mujoco, text = engine(rig)
    segments = [n for n in ("gear", "s1A", "s2A", "s1B", "s2B") if (n == "gear") != (rig == "HipKnee")]
    stiff = "".join(f'<config key="{c}.travel" value="1e-5"/>' for c in segments)
    text = text.replace('<instance name="drive" />', f'<instance name="drive">{stiff}</instance>')
    for h in (2e-3, 5e-3):
        model, data = started(mujoco, text, integrator, timestep=h)
        model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
        data.qpos[:] = 1.0
        energy = []
        for _ in range(int(20 / h)):
            mujoco.mj_step(model, data)
            energy.append(data.energy.sum())
        swing = np.ptp(energy)
        assert swing > 0 and np.abs(data.qvel).max() < 1e-6
        assert np.diff(energy).max() < 2e-3 * swing  # the engine's own step of order one gives and takes a little
        at = data.qpos.copy()
        mujoco.mj_step(model, data, 1000)
        assert np.abs(data.qpos - at).max() < 1e-6


def test_the_state_is_saved_copied_and_reset_with_the_simulation(engine, integrator):
    """On a floor, where last step's contacts count: what was saved goes on as the first did, bit for bit."""
    mujoco, _ = engine("ServoPendulum")
    model, data = started(mujoco, four_legs("servopendulum_engine"), integrator)
    rng = np.random.default_rng(6)
    commands = rng.uniform(-1, 1, (400, model.nu))

    def go_on(data, commands):
        for u in commands:
            data.ctrl[:] = u
            mujoco.mj_step(model, data)
        return data.qpos.copy()

    go_on(data, commands[:200])
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION)
    saved, twin, other = np.empty(size), copy.copy(data), mujoco.MjData(model)
    mujoco.mj_getState(model, data, saved, mujoco.mjtState.mjSTATE_INTEGRATION)
    assert np.abs(data.plugin_state).max() > 0.1 and data.ncon
    first = go_on(data, commands[200:])
    mujoco.mj_setState(model, other, saved, mujoco.mjtState.mjSTATE_INTEGRATION)
    assert (go_on(twin, commands[200:]) == first).all() and (go_on(other, commands[200:]) == first).all()
    mujoco.mj_resetData(model, data)
    assert not data.plugin_state.any()
    again = go_on(data, commands)
    mujoco.mj_resetData(model, data)
    assert (go_on(data, commands) == again).all() and (again == first).all()


def test_drives_in_instances_of_their_own_move_as_those_that_share_one(engine):
    mujoco, _ = engine("ServoPendulum")
    shared = four_legs("servopendulum_engine", base=False)
    own = shared.replace('instance="drive"', 'plugin="pycosim.servopendulum_engine"').replace(
        '<instance name="drive"/>', "")
    moved = []
    for text in (shared, own):
        model, data = started(mujoco, text)
        for k in range(1000):
            data.ctrl[:] = 3 * np.sin(np.arange(12) + 0.01 * k)
            mujoco.mj_step(model, data)
        moved.append(data.qpos.copy())
    assert np.ptp(moved[0]) > 0.5 and np.abs(moved[0] - moved[1]).max() < 0.01


def test_parameters_are_attributes_and_wrong_ones_are_named(engine):
    mujoco, text = engine("GearedJoint")

    def still(config):
        changed = text.replace('<instance name="drive" />', f'<instance name="drive">{config}</instance>')
        model, data = started(mujoco, changed)
        data.qpos[:] = 0.3
        mujoco.mj_step(model, data, 5000)
        return data.qpos[0]
    assert still('<config key="gear.f0" value="0.5"/>') == pytest.approx(0.3, abs=1e-2)
    assert abs(still('<config key="gear.f0" value="0.0"/><config key="gear.mu" value="1"/>')) < 0.2
    for wrong in ("much", "-1"):
        with pytest.raises(ValueError, match=f"'gear.f0' is '{wrong}'; give a number from 0 to 1"):
            still(f'<config key="gear.f0" value="{wrong}"/>')
    with pytest.raises(ValueError, match="gear.fo"):
        still('<config key="gear.fo" value="0.1"/>')


def test_what_it_cannot_is_refused(engine):
    mujoco, text = engine("HipKnee")
    alone = "\n".join(line for line in text.splitlines() if not re.search('(name|actuator)="tau2"', line))
    with pytest.raises(ValueError, match="1 actuators share an instance; a drive has 2"):
        mujoco.MjData(mujoco.MjModel.from_xml_string(alone))


def swung(case, engine, h, integrator):
    """Two seconds of the pendulum under a voltage, in MuJoCo and as the FMU; largest difference [rad]."""
    _, model, known, _ = case("ServoPendulum")
    mujoco, text = engine("ServoPendulum")
    theirs, data = started(mujoco, text, integrator, timestep=h)
    time = np.arange(round(2 / h) + 1) * h
    volts = 4 * np.sin(3 * time)
    data.qpos[:] = 0.5
    swung = [0.5]
    for v in volts[:-1]:
        data.ctrl[:] = v
        mujoco.mj_step(theirs, data)
        swung.append(data.qpos[0])
    ours = simulate(model, {"v_in": volts}, time, known, {"motor.phi": 0.5}, hold=True)["motor.phi"]
    assert np.ptp(ours) > 0.5
    return np.abs(swung - ours).max()


def test_it_swings_as_the_fmu_at_its_own_step(case, engine):
    """As exported: RK4 at 1 ms."""
    assert "RK4" in engine("ServoPendulum")[1]
    assert swung(case, engine, 1e-3, None) < 2e-5


def test_with_an_integrator_of_order_one_it_swings_as_the_fmu_at_a_short_step(case, engine):
    long, short = (swung(case, engine, h, "implicitfast") for h in (1e-3, 1e-4))
    assert short < 1e-3 and long == pytest.approx(10 * short, rel=0.3)


def test_a_state_put_in_within_a_step_is_no_stage_of_it(engine):
    """A step begun, then a state of half a step later: the answer is that of a simulation that starts there."""
    mujoco, text = engine("ServoPendulum")
    model, data = started(mujoco, text, "RK4")
    _, other = started(mujoco, text, "RK4")
    mujoco.mj_forward(model, data)
    for d in (data, other):
        d.time, d.qpos[:], d.qvel[:], d.ctrl[:] = 5e-4, 0.7, 0.3, 2.0
        mujoco.mj_step(model, d, 10)
    assert data.qpos[0] == other.qpos[0] and data.plugin_state[0] == other.plugin_state[0] != 0


def test_the_command_line_writes_source_library_and_bodies(tmp_path, monkeypatch, capsys):
    mujoco = pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm one.toml").write_text('[rig]\nmodel = "DriveTrain.Rigs.GearedJoint"\n')
    assert main(["export", "arm one.toml", "--to", "mujoco-plugin", "--out", "made"]) == 0
    assert {f.name for f in (tmp_path / "made").iterdir()} >= {"arm one.xml", "arm_one_drive.c", "export.json"}
    library = next((tmp_path / "made").glob("arm_one_drive.[sd][oly]*"))
    mujoco.mj_loadPluginLibrary(str(library))
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "made" / "arm one.xml"))
    assert model.nu == 1 and model.npluginstate == 6
    monkeypatch.setattr("pycosim.export.mujoco_plugin.mujoco_folder", lambda: None)
    assert main(["export", "arm one.toml", "--to", "mujoco-plugin", "--out", "source"]) == 0
    assert "not installed" in capsys.readouterr().out and not list((tmp_path / "source").glob("*.so"))

"""The drive for JAX: the law's numbers, one machine or many, with derivatives that finite differences confirm."""

import importlib.util
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from pycosim.cli.entry import main
from pycosim.compile import Library
from pycosim.export.description import values
from pycosim.export.jax_drive import jax_source
from pycosim.export.law import drive_law
from pycosim.study.schema import Setting

jax = pytest.importorskip("jax")
LIBRARY_ = Library()
RIGS = {"GearedJoint": [("load_hysteresis", "gear"), ("torque_ripple", "motor"), ("thermal_drift", "gear")],
        "ServoPendulum": [("load_dependence", "gear")], "HipKnee": []}
GIVEN = {"GearedJoint": {"torque_ripple_motor.A": 0.01, "load_hysteresis_gear.mu_dif": 0.02, "gear.mu": 0.8,
                         "thermal_drift_gear.k": 0.2},
         "ServoPendulum": {"load_dependence_gear.mu": 0.8}, "HipKnee": {"motor1.J": 1e-3, "motor2.J": 1e-3}}


def load(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module", params=RIGS)
def drive(request, study, tmp_path_factory):
    """The law of a rig, and the module that JAX runs."""
    rig = request.param
    base = study(rig)
    own = replace(base, effects=[*base.effects, *RIGS[rig]],
                  parameters={**base.parameters, **{n: Setting(v) for n, v in GIVEN[rig].items()}})
    model = own.validate(LIBRARY_)
    law = drive_law(model, values(own, model))
    path = tmp_path_factory.mktemp("jax") / f"{rig}_drive.py"
    path.write_text(jax_source(law, rig))
    return law, load(path)


def points(law, n, seed=0):
    """Angles, speeds, accelerations, mean speeds, states, controls, times: all quadrants, a third nearly at rest."""
    rng, m, k = np.random.default_rng(seed), len(law.motors), len(law.states)
    calm = np.where(rng.uniform(size=(n, 1)) < 0.3, 1e-3, 2.0)
    return (rng.uniform(-3, 3, (n, m)), calm * rng.uniform(-1, 1, (n, m)), rng.uniform(-20, 20, (n, m)),
            calm * rng.uniform(-1, 1, (n, m)), rng.uniform(-1, 1, (n, k)), rng.uniform(-1, 1, (n, m)),
            rng.uniform(0, 50, n))


@pytest.mark.parametrize(("double", "bar"), [(False, 1e-6), (True, 1e-12)])
def test_a_batch_has_the_torques_and_states_of_the_law(drive, double, bar):
    law, module = drive
    n, h = 5000, 1e-3
    given = points(law, n)
    if not double:
        given = tuple(np.asarray(a, np.float32).astype(float) for a in given)  # both get the same numbers
    q = np.tile(law.prepared()[:, None], n)
    tau, after = law.torque.map(n)(*[a.T for a in given[:-1]], given[-1][None], np.full((1, n), h), q)
    with jax.enable_x64(double):
        run = jax.jit(jax.vmap(module.torque, (0,) * 7 + (None, None)))
        found = run(*[jax.numpy.asarray(a) for a in given], h, module.prepare(module.parameters()))
        assert found[0].dtype == (np.float64 if double else np.float32)
    full = np.abs(np.array(tau)).max()
    assert np.abs(np.array(found[0]) - np.array(tau).T).max() < bar * full
    assert np.abs(np.array(found[1]) - np.array(after).T).max() < bar * 2  # states go from -1 to 1


def engine(law, n, seed=1):
    """What step_torque needs of random engines: start, mobility, speeds without the drive."""
    rng, m = np.random.default_rng(seed), len(law.motors)
    phi, w, _, _, x, u, t = points(law, n, seed)
    root = rng.uniform(-1, 1, (n, m, m)) * 15
    mobility = root @ root.transpose(0, 2, 1) + 20 * np.eye(m)
    return phi, w, x, u, t, mobility, w + 1e-3 * rng.uniform(-50, 50, (n, m))


def test_it_is_implicit_in_the_speed_at_the_end_of_the_step(drive):
    law, module = drive
    n, h = 500, 1e-3
    phi, w, x, u, t, mobility, free = engine(law, n)
    with jax.enable_x64(True):
        run = jax.jit(jax.vmap(module.step_torque, (0, 0, 0, 0, 0, None, 0, 0, None)))
        tau, after, v = (np.array(a) for a in run(phi, w, x, u, t, h, mobility, free, module.parameters()))
    assert np.allclose(v, free + h * np.einsum("nij,nj->ni", mobility, tau), rtol=0, atol=1e-10)
    for k in range(0, n, 25):
        wanted = law.torque(phi[k] + h * v[k], v[k], (v[k] - w[k]) / h, v[k], x[k], u[k], t[k] + h, h, law.prepared())
        assert np.allclose(tau[k], np.ravel(wanted[0]), rtol=0, atol=1e-9 * np.abs(tau).max())
        assert np.allclose(after[k], np.ravel(wanted[1]), rtol=0, atol=1e-9)


def test_derivatives_are_those_of_finite_differences_away_from_switches(drive):
    """By parameters, control and start, of torque and state. A switch shows as one-sided differences that disagree."""
    law, module = drive
    if len(law.motors) > 1:
        pytest.skip("XLA takes minutes to compile the reverse derivative of four segments")
    phi, w, x, u, t, mobility, free = engine(law, 40, 5)
    m, s, h, step = len(law.motors), len(law.states), 1e-3, 1e-7
    with jax.enable_x64(True):
        p = np.array(module.parameters())

        def answer(change, phi, w, x, u, t, mobility, free):
            """Torque and states after what may vary has changed, each in units of its own size."""
            of_p, of_u, of_w, of_x = jax.numpy.split(change, np.cumsum([len(p), m, m]))
            tau, after, _ = module.step_torque(phi, w + of_w, x + of_x, u + of_u, t, h, mobility, free + of_w,
                                               p + np.maximum(np.abs(p), 1e-3) * of_p)
            return jax.numpy.concatenate([tau, after])
        size, given = len(p) + 2 * m + s, (phi, w, x, u, t, mobility, free)
        run = jax.jit(jax.vmap(answer, (None, *[0] * 7)))
        slope = np.array(jax.jit(jax.vmap(jax.jacrev(answer), (None, *[0] * 7)))(np.zeros(size), *given))
        here = np.array(run(np.zeros(size), *given))
        ahead = np.stack([np.array(run(step * e, *given)) - here for e in np.eye(size)], axis=2) / step
        behind = np.stack([here - np.array(run(-step * e, *given)) for e in np.eye(size)], axis=2) / step
    smooth = np.abs(ahead - behind) < 1e-3 * (1 + np.abs(ahead))
    off = np.abs(slope - (ahead + behind) / 2) / (1 + np.abs(slope).max(axis=2, keepdims=True))
    assert smooth.mean() > 0.8 and off[smooth].max() < 1e-4


def test_the_file_needs_jax_alone_and_names_what_it_takes(drive, tmp_path):
    law, module = drive
    assert module.PARAMETERS == pytest.approx(law.values) and module.STATES == law.states
    assert np.allclose(module.INERTIA, law.inertia)
    name = law.parameters[0]
    changed = module.parameters(**{name.replace(".", "__"): 0.123})
    assert float(changed[0]) == pytest.approx(0.123) and len(changed) == len(law.parameters)
    with pytest.raises(KeyError, match="no parameter 'gear.fo'"):
        module.parameters(gear__fo=1.0)


def test_the_command_line_writes_it_and_it_runs_without_this_program(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.toml").write_text('[rig]\nmodel = "DriveTrain.Rigs.GearedJoint"\n')
    assert main(["export", "arm.toml", "--to", "jax", "--out", "made"]) == 0
    code = ("import sys; sys.path.insert(0, 'made'); import arm_drive as d; q = d.prepare(d.parameters());"
            "import jax.numpy as j; print(d.torque(*[j.ones(1)] * 4, j.zeros(1), j.ones(1), 0., 1e-3, q)[0]);"
            "assert 'pycosim' not in sys.modules")
    assert subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True).returncode == 0

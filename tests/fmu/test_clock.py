"""Controllers and estimators keep their own clock: what they compute does not depend on the importer's steps."""

import numpy as np
import pytest
from driver import OK, Fmu, Instance

from pycosim.control.controllers import estimator, position_control
from pycosim.cosim.foreign import ForeignFmu
from pycosim.export.controller import export_block

PERIOD = 1e-3  # s, of both blocks


@pytest.fixture(scope="module", params=[2, 3], ids=["fmi2", "fmi3"])
def blocks(request, model, tmp_path_factory):
    """A controller and an estimator of the geared joint."""
    rig, folder = model("GearedJoint"), tmp_path_factory.mktemp("blocks")
    given = {n: v.value for n, v in rig.parameters.items()}
    return {make.__name__: Fmu(export_block(make(rig, given, PERIOD), folder, request.param), folder / make.__name__)
            for make in (position_control, estimator)}


@pytest.mark.parametrize("h", [1e-4, 3e-4, 5e-4, 1e-3, 1.5e-3, 1e-2])
@pytest.mark.parametrize("start", [0.0, 0.25])
def test_the_integral_of_a_constant_error_is_that_error_times_the_time(blocks, h, start):
    plant = Instance(blocks["position_control"], started=False)
    plant.set_up(start, ki=1.0, kp=0.0, ref__motor__phi=0.1)
    for k in range(round(1.0 / h)):
        assert plant.step(start + k * h, h) == OK, plant.messages
    assert plant.get("motor.integral") == pytest.approx(0.1, abs=0.1 * (h + PERIOD))


def test_sums_and_products_of_steps_take_the_same_samples(blocks):
    sums, products, t = (*(Instance(blocks["position_control"], started=False) for _ in range(2)), 0.0)
    for plant in (sums, products):
        plant.set_up(ki=1.0, ref__motor__phi=0.1)
    for k in range(10000):
        assert sums.step(t, 1e-4) == OK and products.step(k * 1e-4, 1e-4) == OK
        t += 1e-4
    assert sums.get("motor.integral") == products.get("motor.integral") == pytest.approx(0.1, rel=1e-12)


def test_outputs_answer_at_a_sample_and_are_held_in_between(blocks):
    plant = Instance(blocks["position_control"])
    assert plant.set(["kp", "ref.motor.phi"], [2.0, 0.1]) == OK
    first = plant.get("motor.tau")
    assert first == pytest.approx(0.2, rel=0.5) and plant.step(0.0, 0.4e-3) == OK
    assert plant.set("ref.motor.phi", 0.3) == OK
    assert plant.get("motor.tau") == first  # held
    assert plant.directional(["motor.tau"], ["ref.motor.phi"], [1.0]) == [0.0]
    saved = plant.serialize()
    assert plant.step(0.4e-3, 0.6e-3) == OK
    later = plant.get("motor.tau")
    assert later > first + 0.3 and plant.directional(["motor.tau"], ["ref.motor.phi"], [1.0])[0] > 1.9
    other = Instance(blocks["position_control"])
    assert other.deserialize(saved) == OK and other.get("motor.tau") == first
    assert other.step(0.4e-3, 0.6e-3) == OK and other.get("motor.tau") == later


@pytest.mark.parametrize("h", [1e-4, 5e-4, 2e-3])
def test_an_estimator_takes_the_samples_that_it_takes_at_its_period(blocks, h):
    """The motion moves on at whole milliseconds only, so that every way of stepping sees the same samples."""
    ends = []
    for step in (PERIOD, h):
        plant, n = Instance(blocks["estimator"]), max(1, round(PERIOD / step))
        for k in range(round(0.4 / step)):
            t = (k // n) * n * step
            t = np.floor(t / 2e-3 + 1e-9) * 2e-3
            assert plant.set(["motor.phi", "motor.w", "motor.tau"], [np.sin(20 * t), 20 * np.cos(20 * t), 0.3]) == OK
            assert plant.step(k * step, step) == OK
        ends.append(plant.get("C", "gear.z"))
    assert ends[0] == ends[1] and abs(ends[0][1]) > 0.1


@pytest.mark.parametrize("phi", [0.0, 0.37])
def test_the_derivative_at_rest_is_the_slope_on_both_sides(blocks, phi):
    """At rest, the corners of the friction law's elastic part meet."""
    plant = Instance(blocks["estimator"])
    assert plant.set(["motor.phi", "motor.tau"], [phi, 0.4]) == OK
    for k in range(3):
        assert plant.step(k * PERIOD, PERIOD) == OK
    found, = plant.directional(["C"], ["motor.phi"], [1.0])
    slopes, middle, step = [], plant.get("C"), 1e-7
    for sign in (1, -1):
        assert plant.set("motor.phi", phi + sign * step) == OK
        slopes.append((plant.get("C") - middle) / (sign * step))
    assert slopes[0] == pytest.approx(slopes[1], rel=1e-3)
    assert found == pytest.approx(slopes[0], rel=1e-3)


def test_both_versions_estimate_alike_from_the_first_sample(model, tmp_path):
    """In motion from the start, as in a system that begins in the middle of one."""
    rig, t, found = model("GearedJoint"), np.arange(100) * PERIOD, []
    given = {n: v.value for n, v in rig.parameters.items()}
    motion = {"motor.phi": 0.7 + 0.6 * np.sin(5 * t), "motor.w": 3 * np.cos(5 * t), "motor.a": -15 * np.sin(5 * t),
              "motor.tau": 0.1 + 0 * t}
    for version in (2, 3):
        (tmp_path / str(version)).mkdir()
        fmu = ForeignFmu(export_block(estimator(rig, given, PERIOD), tmp_path / str(version), version))
        found.append(fmu.run({}, t, {n: motion[n] for n in fmu.inputs}, ["C"])[0])
        fmu.close()
    assert (found[0] == found[1]).all() and np.ptp(found[0]) > 0.01
    assert abs(found[0][1] - found[0][0]) < 0.01  # no jump between the answer at the start and the first step's

"""Claims about sizes: bounds and nominal values follow the machine in any unit; an axis has units of its own."""

import numpy as np
import pytest

from pycosim.compile import Library, catalogue, compile_model
from pycosim.compile.model import along_axis
from pycosim.core.units import Variable
from pycosim.data.scales import Sizes
from pycosim.dynamics.simulate import estimate

LIBRARY = Library()
AXIS = "DriveTrain.Rigs.LinearAxis"


@pytest.mark.parametrize(("unit", "factor"), [
    ("N.m", 8.0), ("N.m.s/rad", 4.0), ("N.m/rad", 16.0), ("rad", 0.5), ("rad/s", 2.0), ("1/(N.m)^2", 1 / 64),
    ("kg.m2", 1.0), ("1", 1.0), ("s", 1.0), ("kg", 1.0)])
def test_a_nominal_value_grows_with_the_machine_and_bounds_never_shrink(unit, factor):
    sizes = Sizes.of([np.array([8.0, -8.0])], [np.array([0.0, 5.0])], [np.array([2.0, 2.0])], False)
    v = sizes.fit(Variable("x", unit, min=-3.0, max=5.0, nominal=0.1))
    assert v.nominal == pytest.approx(0.1 * factor)
    assert (v.min, v.max) == (pytest.approx(-3 * max(factor, 1)), pytest.approx(5 * max(factor, 1)))


def test_the_same_machine_in_other_units_has_the_same_nominal_values_in_them():
    torque, angle, speed = np.array([3.0, 1.0]), np.array([0.0, 4.0]), np.array([1.0, 2.0])
    one = Sizes.of([torque], [angle], [speed], False)
    other = Sizes.of([1e3 * torque], [angle / 50], [speed / 50], False)  # mN.m, at a joint
    for unit, scale in (("N.m", 1e3), ("rad/s", 1 / 50), ("N.m.s/rad", 5e4), ("1/(N.m)", 1e-3)):
        v = Variable("x", unit, nominal=0.3)
        assert other.fit(v).nominal == pytest.approx(scale * one.fit(v).nominal)


def test_a_log_that_tells_nothing_leaves_parameters_alone():
    v = Variable("x", "N.m", min=0.0, max=1.0, nominal=0.05)
    assert Sizes.of([], [], [], False).fit(v) == v


@pytest.mark.parametrize(("turning", "along"), [
    ("N.m", "N"), ("rad/s", "m/s"), ("N.m.s/rad", "N.s/m"), ("kg.m2", "kg"), ("1/(N.m)^2", "1/N^2"), ("s", "s"),
    ("rad/(N.m)", "m/N")])
def test_units_along_an_axis(turning, along):
    assert along_axis(turning) == along


def test_no_unit_of_a_linear_axis_turns_but_that_of_a_phase():
    attached = [(e, "motor") for e in ("torque_ripple", "torque_saturation", "rotor_inertia")]
    attached += [(e, "guide") for e in ("viscous_asymmetry", "stribeck", "presliding", "load_nonlinearity")]
    model = compile_model(LIBRARY, AXIS, [*attached, ("time_delay", "force")])
    units = {n: v.unit for n, v in {**model.parameters, **model.variables}.items()}
    waves = {"torque_ripple_motor.n": "rad/m", "torque_ripple_motor.phase": "rad"}
    assert {n: u for n, u in units.items() if "rad" in u or "N.m" in u} == waves
    assert units["viscous_asymmetry_guide.b_a"] == "N.s/m" and units["carriage.J"] == "kg"
    sizes = Sizes(50.0, 0.02, 0.1, True)
    ripple = sizes.described(catalogue(LIBRARY)["torque_ripple"],
                             {"n": Variable("n", "1", max=1000.0), "phase": Variable("phase", "rad", max=7.0)})
    assert ripple["n"].max == pytest.approx(5e4) and ripple["phase"].max == 7.0


@pytest.mark.parametrize("delay", [0.004, -0.003])
def test_a_force_that_is_asked_for_comes_late_or_early_as_its_record_does(delay):
    time = np.arange(0, 4, 1e-3)
    x = 0.1 * np.sin(3 * time)
    signals = {"motor.phi": x, "der(motor.phi)": 0.3 * np.cos(3 * time), "der(der(motor.phi))": -9 * x}
    model = compile_model(LIBRARY, AXIS, [("time_delay", "force")])
    y = estimate(model, signals, time, {"time_delay_force.d": delay})
    bare = estimate(compile_model(LIBRARY, AXIS), signals, time)["force"]
    before = np.interp(time - delay, time, bare)
    smooth = np.abs(np.cos(3 * time)) > 0.1
    smooth[:10] = smooth[-10:] = False
    np.testing.assert_allclose(y["force"][smooth], before[smooth], atol=1e-3)
    assert np.abs(bare - before)[smooth].max() > 0.3

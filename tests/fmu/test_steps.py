"""Steps that are hard, steps that ask for inputs on the way, and steps of an explicit solver."""

import ctypes as c

import numpy as np
import pytest
from driver import DISCARD, ERROR, OK, Instance

from pycosim.dynamics.simulate import simulate
from pycosim.export.description import values

SEGMENTS = ("s1A", "s2A", "s1B", "s2B")
HARD = {f"{s}.{n}": v for s in SEGMENTS for n, v in (("mu", 0.5), ("travel", 1e-5))}


def square(t, period):
    return 1.0 if (t / period) % 1 < 0.5 else -1.0


@pytest.mark.parametrize("period", [0.2, 0.774])
def test_a_step_without_solution_is_made_in_parts(built, model, study, period):
    """Half the torque lost in every segment and a travel of 1e-5 rad: steps of a millisecond have no solution here."""
    plant, time = Instance(built("HipKnee", 2), started=False), np.arange(1001) * 1e-3
    plant.set_up(**{n.replace(".", "__"): v for n, v in HARD.items()})
    wave = np.array([square(t, period) for t in time])
    for t, s in zip(time[:-1], wave):
        assert plant.set(["tau1", "tau2"], [0.3 * s, -0.15 * s]) == OK
        assert plant.step(t, 1e-3) == OK, plant.messages
    rig = model("HipKnee")
    given = {**values(study("HipKnee"), rig), **HARD}
    for step, tolerance in ((1e-3, 1e-9), (1e-4, 2e-3)):
        expected = simulate(rig, {"tau1": 0.3 * wave, "tau2": -0.15 * wave}, time, given, step=step, hold=True)
        assert abs(plant.get("q_H") - expected["q_H"][-1]) < tolerance
    assert abs(plant.get("q_K")) > 0.01


def test_a_motion_too_fast_for_the_step_is_followed_all_the_same(built):
    """Two full torques, far beyond 600 rad/s: what a millisecond cannot follow is made in parts."""
    ends = []
    for step in (1e-3, 1e-5):
        plant = Instance(built("HipKnee", 2), started=False)
        plant.set_up(solver__step=step, tau1=6.0, tau2=-6.0)
        for k in range(40):
            assert plant.step(k * 1e-2, 1e-2) == OK, plant.messages
        ends.append(np.array(plant.get("q_H", "q_K")))
        speed = plant.get("motor1.w")
    assert abs(speed) > 600 and np.abs(ends[0] - ends[1]).max() < 0.05


@pytest.mark.parametrize("name, value, words", [("s1A.z", -50.0, ("'s1A.z'", "-1 to 1")),
                                                ("t_r", 0.0, ("'t_r'", "0.01 to 10000"))])
def test_a_start_outside_its_bounds_is_refused_by_name(built, name, value, words):
    plant = Instance(built("HipKnee", 2), started=False)
    assert plant.enter() == OK and plant.set(name, value) == ERROR
    assert all(w in plant.messages[-1] for w in words), plant.messages


def test_a_ratio_of_zero_is_named(built):
    plant = Instance(built("GearedJoint", 3), started=False)
    assert plant.enter() == OK and plant.set("reduction.ratio", 0.0) == OK
    assert plant.exit() == ERROR and "'reduction.ratio', which is 0" in plant.messages[-1]


# --- inputs in the middle of a step ----------------------------------------------------------------------------------

_UPDATE = c.CFUNCTYPE(None, c.c_void_p, c.c_double, c.c_bool, c.c_bool, c.c_bool, c.c_bool, c.POINTER(c.c_bool),
                      c.POINTER(c.c_double))


class Asked(Instance):
    """An instance of FMI 3 whose importer answers in the middle of a step."""

    def __init__(self, fmu, answer, may_return=False):
        super().__init__(fmu, started=False)
        self.free()

        def update(environment, time, may_set, may_get, finished, may_stop, wanted, when):
            stop = answer(self, time)
            if stop is not None:
                wanted[0], when[0] = True, stop

        self.update = _UPDATE(update)
        needed = self.references(["tau", "q"])
        self.handle = fmu.function("InstantiateCoSimulation")(
            b"plant", fmu.token.encode(), None, False, False, False, may_return, needed, c.c_size_t(2), None, self._log,
            self.update)
        assert self.handle, self.messages
        self.set_up()

    def long_step(self, t, h):
        flags, last = [c.c_bool() for _ in range(3)], c.c_double()
        status = self.call("DoStep", c.c_double(t), c.c_double(h), True, *map(c.byref, flags), c.byref(last))
        return status, flags[2].value, last.value


def torque(t):
    return 0.9 * np.sin(30 * t)


def test_inputs_given_within_a_step_take_the_hold_away(built):
    fmu = built("GearedJoint", 3)
    fine, held, seen = Instance(fmu), Instance(fmu), []

    def answer(plant, time):
        seen.append((time, plant.get("time", "q")))
        assert plant.set("tau", torque(time)) == OK and plant.set("gear.f0", 0.1) == ERROR

    asked = Asked(fmu, answer)
    for k in range(20):
        for plant in (asked, held):
            plant.set("tau", torque(k * 1e-2))
        assert asked.long_step(k * 1e-2, 1e-2)[0] == OK and held.step(k * 1e-2, 1e-2) == OK
        for j in range(10):
            fine.set("tau", torque(k * 1e-2 + j * 1e-3))
            assert fine.step(k * 1e-2 + j * 1e-3, 1e-3) == OK
    assert asked.get("q", "w") == pytest.approx(fine.get("q", "w"), rel=1e-9)
    assert abs(held.get("q") - fine.get("q")) > 1e-3 * abs(fine.get("q"))
    assert len(seen) == 180 and all(t == pytest.approx(now) for t, (now, _) in seen)


@pytest.mark.parametrize("when", [0.0031, 0.005])
def test_a_step_ends_early_where_the_importer_asks_for_it(built, when):
    fmu = built("GearedJoint", 3)
    plant = Asked(fmu, lambda plant, time: when if time > 0.0029 else None, may_return=True)
    plant.set("tau", 0.8)
    status, early, last = plant.long_step(0.0, 1e-2)
    assert (status, early) == (OK, True) and last == plant.get("time") == pytest.approx(when, abs=1e-12)
    direct = Instance(fmu)
    direct.set("tau", 0.8)
    for k in range(round(when * 1e4)):
        assert direct.step(k * 1e-4, 1e-4) == OK
    assert plant.get("q") == pytest.approx(direct.get("q"), rel=0.1)
    assert plant.long_step(last, 1e-3)[0] == OK
    unasked = Asked(fmu, lambda plant, time: when)  # not allowed to, so the whole step is made
    assert unasked.long_step(0.0, 1e-2)[1:] == (False, 1e-2)


def test_output_derivatives_are_those_of_the_motion(fmu):
    plant = Instance(fmu)
    plant.set("tau", 2.0)
    for k in range(100):
        assert plant.step(k * 1e-3, 1e-3) == OK
    names = ["q", "w", "C", "gear.loss", "motor.phi"]
    found, order = (c.c_double * len(names))(), (c.c_int32 * len(names))(*[1] * len(names))
    call = "GetRealOutputDerivatives" if fmu.fmi == 2 else "GetOutputDerivatives"
    extra = [] if fmu.fmi == 2 else [c.c_size_t(len(names))]
    assert plant.call(call, plant.references(names), c.c_size_t(len(names)), order, found, *extra) == OK
    before, h = np.array(plant.get(*names)), 1e-5
    assert plant.step(0.1, h) == OK
    assert np.allclose(list(found), (np.array(plant.get(*names)) - before) / h, rtol=2e-3)
    order[0] = 2
    assert plant.call(call, plant.references(names), c.c_size_t(len(names)), order, found, *extra) == ERROR
    assert "order 2" in plant.messages[-1]


# --- model exchange --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("h", [1e-3, 1e-5])
def test_an_explicit_solver_with_too_long_a_step_is_not_told_that_all_is_well(fmu, h):
    """The equations are stiff. Euler's method at a millisecond is wrong by radians; the FMU says so, and only then."""
    plant, n, status = Instance(fmu, me=True), len(fmu.description.derivatives), OK
    rates = "GetDerivatives" if fmu.fmi == 2 else "GetContinuousStateDerivatives"
    x = np.array(plant.vector("GetContinuousStates", n))
    flags = [c.c_int(), c.c_int()] if fmu.fmi == 2 else [c.c_bool(), c.c_bool()]
    assert plant.set("tau", 2.0) == OK and plant.call("EnterContinuousTimeMode") == OK
    for k in range(round(0.1 / h)):
        try:
            x = x + h * np.array(plant.vector(rates, n))
        except AssertionError:
            status = DISCARD
            break
        assert plant.call("SetTime", c.c_double((k + 1) * h)) == OK
        if plant.call("SetContinuousStates", (c.c_double * n)(*x), c.c_size_t(n)) != OK:
            status = ERROR
            break
        status = plant.call("CompletedIntegratorStep", True, *map(c.byref, flags))
        if status != OK:
            break
    if h > 1e-4:
        assert status == ERROR and "stiff" in plant.messages[-1] and "gear.z" in plant.messages[-1]
    else:
        assert status == OK


def test_the_description_says_that_it_is_stiff_and_who_made_it(fmu):
    text = (fmu.folder / "modelDescription.xml").read_text()
    assert 'stiff="true"' in text and 'tolerance="1e-06"' in text and "CVode" in text
    assert all(f' {n}="' in text for n in ("version", "author", "license"))
    assert 'declaredType="Modelica.Units.SI.Torque"' in text and 'quantity="Torque"' in text
    assert ('fixedInternalStepSize="0.001"' in text) == ("providesIntermediateUpdate" in text) == (fmu.fmi == 3)

"""The life of an instance: what is refused is refused with a reason, and nothing breaks by it."""

import ctypes as c
import math
import threading

import pytest
from driver import ERROR, OK, Instance


def run(plant, steps=20, start=0):
    """Steps of a millisecond, and where they end."""
    for k in range(start, start + steps):
        assert plant.step(k * 1e-3, 1e-3) == OK, plant.messages
    return plant.get("q", "w", "gear.L")


def refused(plant, status, *words):
    """One message, which holds these words."""
    assert status == ERROR
    message = plant.messages.pop()
    assert not plant.messages
    for word in words:
        assert word in message, message


def test_a_wrong_token_or_no_name_gives_no_instance(fmu):
    for token, name, word in (("{wrong}", b"plant", "token"), (None, b"", "name")):
        plant = Instance(fmu, token=token, name=name, started=False)
        assert not plant.handle and word in plant.messages[0]


def test_values_cannot_be_read_before_the_initialization(fmu):
    plant = Instance(fmu, started=False)
    status, _ = plant.try_get(["q"])
    refused(plant, status, "just instantiated")


@pytest.mark.parametrize("me", [False, True], ids=["cs", "me"])
def test_functions_out_of_order_are_refused(fmu, me):
    plant = Instance(fmu, me, started=False)
    refused(plant, plant.exit(), "just instantiated")
    refused(plant, plant.call("Terminate"), "just instantiated")
    plant.set_up()
    refused(plant, plant.call("EnterInitializationMode", *([] if fmu.fmi == 2 else [
        c.c_bool(False), c.c_double(0), c.c_double(0), c.c_bool(False), c.c_double(0)])), "mode")
    assert plant.call("Terminate") == OK
    refused(plant, plant.set("tau", 1.0), "terminated")
    refused(plant, plant.call("Terminate"), "terminated")
    assert plant.call("Reset") == OK
    plant.set_up()


def test_unknown_value_references(fmu):
    plant = Instance(fmu)
    for number in (0, 10**6, len(fmu.vr) + 1, 2**32 - 1):
        refused(plant, plant.try_get([number])[0], str(number))
        refused(plant, plant.set(number, 1.0), str(number))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_none_are_refused_and_change_nothing(fmu, value):
    plant, twin = Instance(fmu), Instance(fmu)
    for instance in (plant, twin):
        instance.set("tau", 0.8)
    refused(plant, plant.set(["push", "tau"], [3.0, value]), "'tau'", "finite")
    assert plant.get("push") == 0.0
    assert run(plant) == run(twin)


def test_what_may_be_set_when(fmu):
    plant = Instance(fmu)
    refused(plant, plant.set("load.m", 5.0), "load.m", "fixed")
    refused(plant, plant.set("q", 1.0), "'q'", "initialization")
    refused(plant, plant.set("gear.L", 1.0), "computed")
    refused(plant, plant.set("gear.mu", 1.5), "gear.mu", "0.3 to 1")
    assert plant.set("gear.mu", 0.8) == OK


@pytest.mark.parametrize("h", [0.0, -1e-3, math.nan, math.inf, 1e300, 1e-30])
def test_steps_that_are_none_are_refused(fmu, h):
    plant = Instance(fmu, started=False)
    plant.set_up(start=1.0)
    refused(plant, plant.step(1.0, h), "step")
    assert plant.step(1.0, 1e-3) == OK


def test_both_ways_to_count_time_are_fine_and_others_are_not(fmu):
    sums, products, t = Instance(fmu), Instance(fmu), 0.0
    for k in range(3000):
        assert sums.step(t, 1e-3) == OK and products.step(k * 1e-3, 1e-3) == OK
        t += 1e-3
    refused(sums, sums.step(t + 0.1, 1e-3), "the instance is at")


def test_past_the_stop_time_is_an_error_only_if_there_is_one(fmu):
    free, bound = Instance(fmu), Instance(fmu, started=False)
    bound.set_up(stop=0.01)
    run(free)
    run(bound, 10)
    refused(bound, bound.step(0.01, 1e-3), "stop time")


def test_a_step_without_solution_says_why_and_a_saved_state_goes_on(fmu):
    plant = Instance(fmu)
    plant.set("tau", 0.8)
    run(plant)
    saved = plant.save()
    expected = run(plant, 10, 20)
    assert plant.restore(saved) == OK
    assert plant.set("tau", 1e308) == OK
    refused(plant, plant.step(0.02, 1e-3), "no solution", "solver.step")
    refused(plant, plant.step(0.02, 1e-3), "stopped by an error")
    assert plant.restore(saved) == OK
    assert run(plant, 10, 20) == expected
    plant.drop(saved)


def test_saved_states_are_reused_and_freed(fmu):
    plant = Instance(fmu)
    state = plant.save()
    where = state.value
    run(plant)
    assert plant.save(state).value == where
    assert plant.drop(state) == OK and not state.value
    assert plant.drop(state) == OK  # nothing to free is fine
    refused(plant, plant.restore(state), "null")


def test_damaged_truncated_and_foreign_states_are_refused(fmu, built):
    plant = Instance(fmu)
    data = plant.serialize()
    refused(plant, plant.deserialize(data[:-1]), "truncated")
    refused(plant, plant.deserialize(b""), "truncated")
    refused(plant, plant.deserialize(data[:300] + bytes([data[300] ^ 1]) + data[301:]), "checksum")
    refused(plant, plant.deserialize(b"x" + data[1:]), "not a state")
    refused(plant, plant.deserialize(Instance(fmu, me=True).serialize()), "interface")
    other = Instance(built("ScrewDrive", fmu.fmi)).serialize()
    refused(plant, plant.deserialize(other + bytes(len(data))), "not a state")
    assert plant.deserialize(data) == OK


def test_instances_in_threads_agree_with_one_alone(fmu):
    """Eight threads of twelve interleaved instances each; ctypes lets go of Python's lock in every call."""
    alone = Instance(fmu)
    alone.set("tau", 0.8)
    expected, wrong = run(alone), []

    def work():
        plants = [Instance(fmu) for _ in range(12)]
        for plant in plants:
            plant.set("tau", 0.8)
        for k in range(20):
            for plant in plants:
                plant.step(k * 1e-3, 1e-3)
        wrong.extend(p for p in plants if p.get("q", "w", "gear.L") != expected)
        for plant in plants:
            plant.free()

    threads = [threading.Thread(target=work) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_only_declared_log_categories(fmu):
    plant = Instance(fmu)
    declared = (c.c_char_p * 1)(b"logStatusError")
    assert plant.call("SetDebugLogging", 1, c.c_size_t(1), declared) == OK
    refused(plant, plant.call("SetDebugLogging", 1, c.c_size_t(1), (c.c_char_p * 1)(b"chatter")), "chatter")

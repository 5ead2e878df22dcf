"""Random calls and threads under sanitizers, and a long run; in full: ``python -m benchmarks.robustness.run``."""

import json
import shutil
import subprocess
from functools import cache

import pytest

from benchmarks.robustness.run import RACES, SANITIZE, build, fuzz, threads


@pytest.fixture(scope="module")
def fuzzer(plant, tmp_path_factory):
    shutil.which("cc") or pytest.skip("no cc")
    return cache(lambda fmi, *flags: build(plant("ScrewDrive"), fmi, tmp_path_factory.mktemp(f"fuzz{fmi}"), flags))


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("calls", [3000, pytest.param(100000, marks=pytest.mark.slow)])
def test_random_calls_find_nothing(fuzzer, fmi, calls):
    counts = fuzz(fuzzer(fmi, *SANITIZE, "-O0"), calls)
    assert counts["calls"] == calls and counts["fine"] > calls / 5 and counts["messages"] > calls / 10


def test_threads_of_instances_race_for_nothing_and_agree_bit_for_bit(fuzzer):
    counts = threads(fuzzer(3, *RACES, "-O0"))
    assert (counts["threads"], counts["instances"], counts["differing"]) == (8, 100, 0) and counts["spread"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("fmi", [2, 3])
def test_two_million_steps_do_not_grow(fuzzer, fmi):
    done = subprocess.run([fuzzer(fmi, "-O2"), "soak", "2000000"], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["grown_KiB"] < 100

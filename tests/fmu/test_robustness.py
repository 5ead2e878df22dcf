"""Random calls under sanitizers, and a long run; the full size is ``python -m benchmarks.robustness.run``."""

import json
import shutil
import subprocess

import pytest

from benchmarks.robustness.run import SANITIZE, build, fuzz
from pycosim.export.description import describe


@pytest.fixture(scope="module")
def fuzzer(study, model, tmp_path_factory):
    shutil.which("cc") or pytest.skip("no cc")
    plant, made = describe(study("ScrewDrive"), model("ScrewDrive")), {}

    def make(fmi, flags):
        key = fmi, tuple(flags)
        if key not in made:
            made[key] = build(plant, fmi, tmp_path_factory.mktemp(f"fuzz{fmi}"), flags)
        return made[key]
    return make


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("calls", [3000, pytest.param(100000, marks=pytest.mark.slow)])
def test_random_calls_find_nothing(fuzzer, fmi, calls):
    counts = fuzz(fuzzer(fmi, SANITIZE), calls)
    assert counts["calls"] == calls and counts["fine"] > calls / 5 and counts["messages"] > calls / 10


@pytest.mark.slow
@pytest.mark.parametrize("fmi", [2, 3])
def test_two_million_steps_do_not_grow(fuzzer, fmi):
    done = subprocess.run([fuzzer(fmi, ["-O2"]), "soak", "2000000"], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["grown_KiB"] < 100

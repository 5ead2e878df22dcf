"""Random calls and threads under sanitizers, and a long run.

    python -m benchmarks.robustness.run [--calls 100000] [--steps 2000000] [--rig HipKnee]
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from pycosim.compile import Library
from pycosim.export.description import describe
from pycosim.export.source import sources
from pycosim.study.schema import Study

SANITIZE = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
RACES = ["-g", "-O1", "-fsanitize=thread"]


def build(plant, fmi, folder, flags):
    """Compile the fuzzer with the sources of an FMU; its path."""
    folder = Path(folder)
    files, _ = sources(plant, fmi, ("cs", "me"))
    for name, content in files.items():
        (folder / name).write_bytes(content)
    shutil.copy(Path(__file__).with_name("fuzz.c"), folder)
    subprocess.run(["cc", "-std=c99", *flags, f"-DFMI={fmi}", "fuzz.c", "-o", "fuzz", "-lm", "-pthread"], cwd=folder,
                   check=True)
    return folder / "fuzz"


def fuzz(binary, calls, seed=1):
    """Counts of what was called and what went well.

    Raises
    ------
    RuntimeError
        A sanitizer found something; its report is the message.
    """
    return _counts([binary, "fuzz", str(calls), str(seed)])


def threads(binary):
    """Counts of 8 threads with 100 instances each, held bit for bit against one alone.

    Raises
    ------
    RuntimeError
        They differ, or a sanitizer found something.
    """
    return _counts([binary, "threads"])


def _counts(command):
    environment = {**os.environ, "ASAN_OPTIONS": "detect_leaks=1", "LSAN_OPTIONS": "exitcode=23"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode:
        raise RuntimeError(done.stderr[-4000:] or done.stdout or f"exit code {done.returncode}")
    return json.loads(done.stdout)


def main():
    """Fuzz both versions, then threads, then two million steps of each."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--calls", type=int, default=100000)
    parser.add_argument("--steps", type=int, default=2000000)
    parser.add_argument("--rig", default="HipKnee")
    given = parser.parse_args()
    study = Study(Path("fuzz.toml"), f"DriveTrain.Rigs.{given.rig}")
    plant = describe(study, study.validate(Library()))
    for fmi in (2, 3):
        with tempfile.TemporaryDirectory() as folder:
            counts = fuzz(build(plant, fmi, folder, SANITIZE), given.calls)
            print(f"FMI {fmi}: {counts['calls']} calls under address and undefined-behaviour sanitizers, nothing "
                  f"found; {counts['fine']} went well, {counts['steps']} were steps, {counts['messages']} messages")
            counts = threads(build(plant, fmi, folder, RACES))
            print(f"FMI {fmi}: {counts['threads']} threads of {counts['instances']} instances under the thread "
                  "sanitizer, each ends in the bits of one alone")
            binary = build(plant, fmi, folder, ["-O2"])
            done = subprocess.run([binary, "soak", str(given.steps)], capture_output=True, text=True, check=True)
            print(f"FMI {fmi}: {given.steps} steps, memory grown by {json.loads(done.stdout)['grown_KiB']} KiB")


if __name__ == "__main__":
    main()

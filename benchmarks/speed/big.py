"""Hide an effect in a log of millions of samples; print time and memory of reading, improving and reporting.

    python -m benchmarks.speed.big [--rows 2000000 10000000] [--improve 10000000]

The log is written in parts, as CSV and as Parquet, into a temporary folder: about 100 bytes a sample. Each figure is
that of a process of its own; its peak is what /proc says of it (Linux).
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.hidden_effects import machine as rig

STUDY = Path(__file__).parents[2] / "examples" / "hip_knee" / "study.toml"
SPEEDS, RATE, SIZE = (0.2, 0.4, 0.8, 1.6, 2.4), 1000.0, 1.7
HIDDEN = rig.Effect("stribeck", "2A", fs=2e-3, ws=0.5)


def parts(rows):
    """Yield frames of one log: passes that end where they begin, at five speeds in an order new in each part."""
    rng, start = np.random.default_rng(0), 0.0
    effect = rig.calibrate(HIDDEN, SIZE, rig.PAPER, rig.six_manoeuvres(SPEEDS, 1, longest_pass=6.8))
    while rows > 0:
        motion = rig.six_manoeuvres(SPEEDS, 1, longest_pass=6.8, rate=RATE, rng=rng)
        frame = rig.measure(rig.PAPER, motion, [effect], rng=int(rng.integers(2**31))).iloc[:rows]
        frame["time"] += start
        start, rows = frame["time"].iloc[-1] + 1 / RATE, rows - len(frame)
        yield frame


def write(folder, rows):
    """The log in both formats."""
    import pyarrow
    from pyarrow.parquet import ParquetWriter
    table, writer = folder / f"{rows}.csv", None
    for number, frame in enumerate(parts(rows)):
        frame.to_csv(table, index=False, float_format="%.10g", mode="a", header=not number)
        content = pyarrow.Table.from_pandas(frame, preserve_index=False)
        writer = writer or ParquetWriter(folder / f"{rows}.parquet", content.schema)
        writer.write_table(content)
    writer.close()
    return [table, folder / f"{rows}.parquet"]


def task(name, path):
    """What is measured, in a process of its own; prints a line of JSON."""
    import pycosim as pc
    from pycosim.data.logs import read_log
    start = time.perf_counter()
    project = pc.open(STUDY, data=path)
    if name == "read":
        log = read_log(path, project.study)
        told = f"{len(log.time)} samples, {log.meta or 'row by row'}"
    else:
        result = project.improve()
        told = ", ".join([result.first.verdict, *result.added, result.last.verdict])
        begin, page = time.perf_counter(), Path(path).with_suffix(".html")
        result.report(page)
        told += f"; its report took {time.perf_counter() - begin:.1f} s, {page.stat().st_size / 1e6:.1f} MB"
    status = Path("/proc/self/status").read_text()
    peak = int(status.partition("VmHWM:")[2].split()[0]) / 1024
    print(json.dumps([time.perf_counter() - start, peak, told]))


def measured(name, path):
    """Run a task and print its line of the table."""
    found = subprocess.run([sys.executable, "-m", __spec__.name, "--task", name, path], capture_output=True, text=True)
    if found.returncode:
        raise SystemExit(found.stderr)
    seconds, peak, told = json.loads(found.stdout.splitlines()[-1])
    size = path.stat().st_size / 2**20
    print(f"{name:8s} {path.name:18s} {size:8.0f} {seconds:8.1f} {peak:9.0f}  {told}", flush=True)


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", nargs="*", type=int, default=[2_000_000, 10_000_000])
    parser.add_argument("--improve", nargs="*", type=int, default=[10_000_000])
    parser.add_argument("--task", nargs=2, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.task:
        return task(args.task[0], Path(args.task[1]))
    print(f"{'task':8s} {'log':18s} {'file MiB':>8s} {'s':>8s} {'peak MiB':>9s}  result")
    for rows in sorted({*args.rows, *args.improve}):
        with tempfile.TemporaryDirectory() as folder:
            files = write(Path(folder), rows)
            for path in files if rows in args.rows else []:
                measured("read", path)
            if rows in args.improve:
                measured("improve", files[-1])


if __name__ == "__main__":
    main()

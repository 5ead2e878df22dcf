"""In: a seed and a folder. Out: its logs as CSV files, `study.toml` and `truth.json`; the path of the study.

    python -m benchmarks.other_logs.make 21 --out /tmp/case
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.other_logs import effects as laws
from benchmarks.other_logs import motions, sensors
from benchmarks.other_logs.machine import SEGMENTS, motor_angles
from benchmarks.other_logs.simulate import Rig, Run, simulate
from benchmarks.other_logs.sizes import UNSEEN, sized

ROOT = Path(__file__).parents[2]
FINE_RATE = 1000
"""Steps a second of the fine time grid, roughly."""
BETWEEN = 5.0
"""s between the runs."""


@dataclass
class Case:
    """A rig that moves, its sensors, and what is hidden in it.

    Parameters
    ----------
    seed : int
    quirk : str
        One of `motions.QUIRKS`.
    rig : Rig
    sensors : Sensors
    runs : list of Run
    target : float
        Ratio to the noise that each effect shall have.
    effects : list of Effect
        What is hidden.
    ratios : list of float
        How far each shows above noise.
    """

    seed: int
    quirk: str
    rig: Rig
    sensors: sensors.Sensors
    runs: list
    target: float = 1.0
    effects: list = field(default_factory=list)
    ratios: list = field(default_factory=list)

    @property
    def top_speed(self):
        """Of the motors, all but their fastest moments, rad/s."""
        speeds = [np.gradient(motor_angles(run.q), run.dt, axis=0) for run in self.runs]
        return float(np.percentile(abs(np.vstack(speeds)), 98))

    @property
    def duration(self):
        """Of all runs with the time between them, s."""
        return sum(len(run.q) * run.dt + BETWEEN for run in self.runs)


def drawn(seed, hidden=None):
    """A random case.

    Parameters
    ----------
    seed : int
    hidden : list of str, optional
        Names of effects to hide, instead of random ones.

    Returns
    -------
    case : Case
    rng : numpy.random.Generator
        What the noise is drawn from.
    """
    rng = np.random.default_rng(9000 + seed)
    duration = float(rng.uniform(45, 95))
    travel = float(rng.choice([1e-4, 1e-4, 3e-4, 1e-3]))
    of_seed = _hidden(rng, seed)
    hidden = of_seed if hidden is None else hidden
    computed = any(name in laws.OF_LOAD for name in hidden)
    kinds = _kinds(rng)
    quirk = str(rng.choice(motions.QUIRKS))
    if any(name in laws.FAST for name in hidden):
        kinds = ["gait" if kind == "passes" and rng.random() < 0.8 else kind for kind in kinds]
    friction = {s: (float(rng.uniform(0.02, 0.1) if s.endswith("A") else rng.uniform(0.002, 0.05)),
                    float(rng.uniform(0.88, 0.98))) for s in SEGMENTS}
    sensed = sensors.drawn(rng, any(name in laws.ELASTIC for name in hidden), computed)
    rate = int(rng.choice([200, 200, 200, 250]))
    duration = max(min(duration, int(rng.integers(8000, 9500)) / rate), 36.0)
    walk = np.random.default_rng(seed + 5)
    runs = [_run(rng, kind, duration, rate, quirk, len(kinds)) for kind in kinds]
    case = Case(seed, quirk, Rig(friction, travel), sensed, [run.loaded(not computed, walk) for run in runs])
    sensed.suited(np.vstack([simulate(case.rig, run, []).readings for run in case.runs]), rng)
    case.target = float(rng.uniform(0.8, 2))
    for name in hidden:
        effect, ratio = sized(case, name, rng)
        if ratio >= UNSEEN:
            case.effects.append(effect)
            case.ratios.append(ratio)
    return case, rng


def _hidden(rng, seed):
    """Names of what is hidden: nothing, a law outside the catalogue, two effects, or one, which each is in turn."""
    share = rng.random()
    if share < 0.14:
        return []
    if share < 0.26:
        return [str(rng.choice(laws.OUTSIDE))]
    if share < 0.36:
        return [str(name) for name in rng.choice(laws.PAIRED, 2, replace=False)]
    return [laws.CATALOGUE[seed * 7 % len(laws.CATALOGUE)]]


def _kinds(rng):
    """Kinds of motion of the runs: often passes, sometimes a mixture, one other kind in the rest."""
    count, share = int(rng.choice([1, 1, 1, 2, 3, 5])), rng.random()
    if share < 0.45:
        return ["passes"] * count
    if share < 0.6:
        return [str(rng.choice(["gait", "point_to_point", "sines", "passes"])) for _ in range(count)]
    return [str(rng.choice(["gait", "point_to_point", "sines"]))] * count


def _run(rng, kind, duration, rate, quirk, count):
    """One of so many runs that share a duration."""
    rate = int(rng.choice([150, 200, 250])) if quirk == "mixed_rates" else rate
    every = round(FINE_RATE / rate)
    lasts = duration / count
    if kind == "passes":
        lasts = max(lasts, 22.0 if count > 1 else 60.0)
    return Run(kind, rate, every, motions.motion(kind, rng, lasts, 1 / (rate * every), quirk, count > 1))


def make(seed, folder, hidden=None):
    """Write logs and study of a case.

    Parameters
    ----------
    seed : int
    folder : Path or str
        Made where it is missing.
    hidden : list of str, optional
        Names of effects to hide, instead of random ones.

    Returns
    -------
    Path
        Of the study; `truth.json` beside it says what is hidden, with which coefficients and ratio to the noise.
    """
    case, rng = drawn(seed, hidden)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    logs = {}
    for k, run in enumerate(case.runs, 1):
        truth = simulate(case.rig, run, case.effects)
        logs[f"run{k}.csv"] = sensors.record(run, truth, case.sensors, case.quirk == "spikes", rng)
    for name, log in logs.items():
        sensors.written(folder / name, log)
    text = (ROOT / "examples" / "hip_knee" / "study.toml").read_text().replace(
        "runs = []", f"runs = {json.dumps(list(logs))}", 1)
    kind = "gravity_model" if case.sensors.computed else "sensor"
    study = folder / "study.toml"
    study.write_text(text.replace('reference = "unknown"', f'reference = "{kind}"', 1))
    (folder / "truth.json").write_text(json.dumps(_said(case, logs), indent=1))
    return study


def _said(case, logs):
    """What is true of a case, as plain values."""
    return {
        "seed": case.seed, "quirk": case.quirk, "kinds": [run.kind for run in case.runs],
        "hidden": [{"effect": e.id, "place": e.place, "coefficients": e.values, "ratio": ratio}
                   for e, ratio in zip(case.effects, case.ratios)],
        "friction": case.rig.friction, "own_travel": case.rig.travel,
        "rates": [run.rate for run in case.runs], "samples": [len(log["time"]) for log in logs.values()],
        "durations": [float(run.time[-1]) for run in case.runs], "top_speed": case.top_speed, "target": case.target,
        "floor": float(case.sensors.floor), "angle_floor": float(case.sensors.angle_floor),
        "sensors": asdict(case.sensors) | {"zeros": case.sensors.zeros.tolist()}}


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seed", type=int)
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    print(make(args.seed, args.out))


if __name__ == "__main__":
    main()

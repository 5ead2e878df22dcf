"""Ten foreign FMUs and fifty noisy logs of each in, how often intervals hold the truth, out."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.engines.foreign import c_fmu
from pycosim.cosim.calibrate import calibrate
from pycosim.cosim.foreign import ForeignFmu
from pycosim.study.schema import Column, Setting, Study

KINDS = [("spring", 2, "cs", False), ("spring", 3, "cs", False), ("tank", 3, "me", False), ("spring", 2, "me", False),
         ("spring", 2, "me", True), ("spring", 3, "me", True), ("tank", 2, "cs", False),
         ("tank", 3, "cs", False), ("tank", 2, "me", True)]
TIME = np.arange(150) * 0.04
INPUT = 0.5 * np.sign(np.sin(2 * TIME)) + 0.2 * np.sin(5 * TIME)
NOISE = 0.01
TRUTH = {"spring": {"mass": 1.3, "damping": 0.48, "stiffness": 9.2}, "tank": {"pump": 0.7, "outlet": 0.75}}
_SLAVE = '''
from pythonfmu3 import Fmi3Causality, Fmi3Initial, Fmi3Slave, Fmi3Variability, Float64

class Spring(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time, self.mass, self.damping, self.stiffness = 0.0, 1.0, 0.6, 8.0
        self.u, self.y, self.v = 0.0, 0.3, 0.0
        self.register_variable(Float64("time", causality=Fmi3Causality.independent,
                                       variability=Fmi3Variability.continuous))
        for n in ("mass", "damping", "stiffness"):
            self.register_variable(Float64(n, causality=Fmi3Causality.parameter, variability=Fmi3Variability.tunable,
                                           initial=Fmi3Initial.exact))
        self.register_variable(Float64("u", causality=Fmi3Causality.input, start=0.0))
        self.register_variable(Float64("y", causality=Fmi3Causality.output, initial=Fmi3Initial.exact))

    def do_step(self, t, h):
        parts = max(1, round(h / 0.01))
        for _ in range(parts):
            self.v += h / parts * (self.u - self.damping * self.v - self.stiffness * self.y) / self.mass
            self.y += h / parts * self.v
        return True
'''


def python_fmu(folder):
    """An FMU of pythonfmu3.

    Parameters
    ----------
    folder : path

    Returns
    -------
    Path
    """
    script = Path(folder) / "spring.py"
    script.write_text(_SLAVE)
    subprocess.run([sys.executable, "-m", "pythonfmu3", "build", "-f", script.name], cwd=folder, check=True,
                   capture_output=True)
    return Path(folder) / "Spring.fmu"


def covered(path, machine, logs, folder, seed=0):
    """Whether the 95 % intervals hold the truth, of each log and parameter.

    Parameters
    ----------
    path : path
        The FMU.
    machine : str
        Whose truth it is.
    logs : int
    folder : path
    seed : int

    Returns
    -------
    list of bool
    """
    truth, rng = TRUTH[machine], np.random.default_rng(seed)
    fmu = ForeignFmu(path)
    clean = fmu.run(truth, TIME, {"u": INPUT}, ["y"])[0]
    fmu.close()
    log, inside = Path(folder) / "log.csv", []
    study = Study(Path(folder) / "bench.toml", "FMU", runs=[log],
                  columns={"u": Column("u", "1"), "y": Column("y", "1")},
                  parameters={n: Setting(fixed=False) for n in truth})
    for _ in range(logs):
        noisy = clean + NOISE * rng.standard_normal(len(TIME))
        np.savetxt(log, np.c_[TIME, INPUT, noisy], delimiter=",", header="time,u,y", comments="")
        fit = calibrate(replace(study), path).fit
        inside += [fit.interval(n)[0] <= v <= fit.interval(n)[1] for n, v in truth.items()]
    return inside


def run(logs=50):
    """All of them.

    Parameters
    ----------
    logs : int
        Of each FMU.

    Returns
    -------
    dict
        Share of intervals that hold the truth: pooled, and by FMU.
    """
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        jobs = [(c_fmu(folder, *kind), kind[0]) for kind in KINDS] + [(python_fmu(folder), "spring")]
        for k, (path, machine) in enumerate(jobs):
            found[path.stem] = covered(path, machine, logs, folder, k)
            print(f"{path.stem}: {np.mean(found[path.stem]):.3f} of {len(found[path.stem])}", flush=True)
    return {"pooled": float(np.mean(np.concatenate(list(found.values())))), "intervals": sum(map(len, found.values())),
            **{n: float(np.mean(v)) for n, v in found.items()}}


if __name__ == "__main__":
    print(run())

"""Take a verdict into a controller: the improved model as an FMU, moved by controllers that know either study.

    python examples/barrier/track.py GIVEN.toml IMPROVED.toml PLAN.csv FOLDER

Exports the improved study as an FMU, writes two scenarios of co-simulation into FOLDER, and steps them: position
control of the motor along the planned motion, the torque worked out ahead by either study. Each scenario can be run
again: pycosim cosim FOLDER/improved.toml. Needs a C compiler, and `pip install .[fmu]`.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pandas as pd

import pycosim as pc

RATIO, SETTLED = 40, 1.0  # of the worm gear; s after which friction has settled
SCENARIO = """\
# The planned motion under position control; the arm is the exported FMU, the controller knows {known}.

connections = ["reference -> controller", "plant -> controller", "controller.motor.tau -> plant.current"]

[components.reference]
motion = "plan.csv"
machine = "{known}"
rate = 500                        # Hz

[components.controller]
controller = "position"
machine = "{known}"
rate = 500

[components.plant]
fmu = "{fmu}"
rate = 500
parameters = {{ k_m_current = 1.0 }}      # the study logs a current; the controller gives a torque
start = {{ "motor.phi" = {start:.9g} }}   # rad, where the plan begins

[log]
rate = 100

[log.columns]
wanted = "reference.ref.motor.phi"
actual = "plant.motor.phi"
"""


def main(given, improved, plan, folder):
    """Export, write the scenarios, step them, and say how well each follows.

    Parameters
    ----------
    given, improved, plan, folder : path
    """
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(plan, folder / "plan.csv")
    made = pc.open(improved).export(folder / "fmu")
    fmu = next(f for f in made.files if f.endswith(".fmu"))
    print(f"Written: {folder / 'fmu' / fmu}")
    start = pd.read_csv(plan)["motor.phi"].iloc[0]
    for name, study in (("given", given), ("improved", improved)):
        scenario = folder / f"{name}.toml"
        scenario.write_text(SCENARIO.format(known=study.resolve().as_posix(), fmu=f"fmu/{fmu}", start=start))
        log = pc.cosimulate(scenario).log
        late = (log["wanted"] - log["actual"])[log["time"] > SETTLED]
        error = 1e3 * np.sqrt(np.mean(late ** 2)) / RATIO
        print(f"Tracking error of the arm with the {name} study: {error:.4f} mrad RMS")


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    main(*map(Path, sys.argv[1:]))

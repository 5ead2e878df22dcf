"""Draw the signature of every effect: what it changes in a joint's torque (or angle), over the variable it shows in.

    python docs/effect_signatures.py        writes docs/images/effects/signatures.png, and one picture an effect

A passage of the hip-knee rig is moved to and fro at three speeds; its model is evaluated with and without the effect.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from pycosim.compile import Library, catalogue, compile_model
from pycosim.dynamics.simulate import estimate
from pycosim.report.figures import save
from pycosim.report.plot import Axis, Line, Look, Panel, Plot

RIG = "DriveTrain.Rigs.HipKnee"
# effect: place, coefficients, output, variable to show it over
SHOWN = {
    "viscous": ("1A", {"b": 0.02}, "C_H", "s1A.w"),
    "viscous_asymmetry": ("1A", {"b_a": 0.01}, "C_H", "s1A.w"),
    "sublinear_viscous": ("1A", {"b": 0.03, "a": 0.4}, "C_H", "s1A.w"),
    "stribeck": ("1A", {"fs": 0.05, "ws": 0.5}, "C_H", "s1A.w"),
    "stribeck_asymmetry": ("1A", {"fs_a": 0.04, "ws": 0.5}, "C_H", "s1A.w"),
    "presliding": ("1A", {"travel": 0.5}, "C_H", "motor1.phi"),
    "friction_lag": ("1A", {"T": 0.5, "ws": 0.05}, "C_H", "motor1.phi"),
    "dwell": ("1A", {"fd": 0.05, "T": 0.2, "h": 1.0}, "C_H", "motor1.phi"),
    "direction_asymmetry": ("1A", {"a": 0.3}, "C_H", "s1A.w"),
    "configuration_preload": ("1A", {"k_H": 0.1, "k_K": 0.0}, "C_H", "q_H"),
    "angle_friction": ("1A", {"c1": 0.1, "c2": 0.06, "c3": -0.02, "c4": 0.08, "c5": 0.02, "c6": 0.0, "low": 6.0,
                              "high": 18.0}, "C_H", "motor1.phi"),
    "load_dependence": ("1A", {"mu": 0.9}, "C_H", "s1A.L"),
    "load_nonlinearity": ("1A", {"d": 0.05}, "C_H", "s1A.L"),
    "load_hysteresis": ("1A", {"h": 1.0, "mu_dif": 0.02}, "C_H", "motor1.phi"),
    "cross_load": ("1A+2A", {"k": 0.1}, "C_H", "s2A.L"),
    "torque_ripple": ("motor1", {"A": 0.02, "n": 2.0, "phase": 0.0}, "C_H", "motor1.phi"),
    "thermal_drift": ("1A", {"k": 1.0, "T": 60.0}, "C_H", "time"),
    "temperature_dependence": ("1A", {"k": 0.1, "mean": 25.0}, "C_H", "temperature"),
    "torque_constant": ("motor1", {"g": 1.05}, "C_H", "motor1.tau"),
    "motor_angle_torque": ("motor1", {"c2": 0.02, "c4": -0.01, "c6": 0.03, "c8": -0.02, "low": 6.0, "high": 18.0},
                           "C_H", "motor1.phi"),
    "torque_offset": ("motor1", {"o": 0.02}, "C_H", "motor1.tau"),
    "torque_saturation": ("motor1", {"k": 0.02}, "C_H", "motor1.tau"),
    "rotor_inertia": ("motor1", {"J": 2e-3}, "C_H", "der(der(motor1.phi))"),
    "time_delay": ("torque", {"d": 0.05}, "C_H", "time"),
    "low_pass": ("torque", {"T": 0.05}, "C_H", "time"),
    "joint_spring": ("hip", {"k": 1.0, "q0": 0.2}, "hip.computed", "q_H"),
    "angle_torque": ("hip", {"c2": 0.2, "c3": 0.5, "c4": 0.3, "c5": -0.2, "c6": -0.4, "c8": 0.3, "c9": 0.2, "low": 0.44,
                             "high": 0.76}, "hip.computed", "q_H"),
    "payload": ("shank", {"m": 0.5}, "knee.computed", "shank"),
    "reference_mass": ("shank", {"m": 0.3}, "knee.computed", "shank"),
    "reference_centre": ("shank", {"c": 0.02}, "hip.computed", "shank"),
    "reference_zero": ("hip", {"q0": 0.05}, "hip.computed", "q_H"),
    "reference_gain": ("hip", {"g": 1.03}, "hip.computed", "motor1.tau"),
    "reference_offset": ("hip", {"o": 0.5}, "hip.computed", "q_H"),
    "reference_lag": ("hip", {"T": 0.05}, "hip.computed", "q_H"),
    "cable_compliance": ("line1", {"e": 0.01}, "encoder_H", "motor1.tau"),
    "backlash": ("line1", {"gap": 0.02}, "encoder_H", "s1A.L"),
}
LABELS = {"s1A.w": "speed of 1A [rad/s]", "s1A.L": "load of 1A [N.m]", "s2A.L": "load of 2A [N.m]",
          "motor1.phi": "angle of motor 1 [rad]", "q_H": "hip angle [rad]", "shank": "shank angle [rad]",
          "time": "time [s]",
          "temperature": "temperature [degC]", "motor1.tau": "torque of motor 1 [N.m]",
          "der(der(motor1.phi))": "acceleration of motor 1 [rad/s2]"}
COLUMNS, COLOURS = 4, 24  # of the sheet
UNITS = {"encoder_H": "hip encoder [rad]", "C_H": "hip torque [N.m]", "hip.computed": "hip torque [N.m]",
         "knee.computed": "knee torque [N.m]"}


def passage():
    """Time, motion and torques of three speeds to and fro, 120 s at 50 Hz."""
    time = np.arange(0, 120, 0.02)
    rate = np.select([time < 42, time < 84], [0.15, 0.3], 0.6)
    phase = np.cumsum(rate) * 0.02
    signals = {"motor1.phi": 12 + 6 * np.sin(phase), "motor2.phi": 6 - 9 * np.sin(phase + 0.5)}
    for name in list(signals):
        first = np.gradient(signals[name], time)
        signals[f"der({name})"] = np.where(np.abs(np.gradient(rate)) > 0, 0.0, first)
        signals[f"der(der({name}))"] = -np.square(rate) * (signals[name] - signals[name].mean())
    lift = np.sin((signals["motor1.phi"] + signals["motor2.phi"]) / 30.25 - 0.6)
    signals["motor1.tau"] = 2.5 * lift + 0.1 * np.sign(signals["der(motor1.phi)"])
    signals["motor2.tau"] = 1.5 * lift + 0.1 * np.sign(signals["der(motor2.phi)"])
    return time, signals


def signatures(library):
    """What each effect changes, over the variable it shows in.

    Parameters
    ----------
    library : Library

    Yields
    ------
    effect : str
    labels : dict of str to str
        Title and labels of the axes.
    parts : list of (ndarray, ndarray)
        Variable and change, out and back.
    """
    time, signals = passage()
    temperature = 22 + 6 * (1 - np.exp(-time / 40))
    bare = compile_model(library, RIG)
    without = {**signals, **estimate(bare, signals, time), "time": time, "temperature": temperature}
    without["shank"] = without["q_H"] + without["q_K"]
    moving = np.abs(without["s1A.w"]) > 0.02
    for effect, (place, given, output, over) in SHOWN.items():
        model = compile_model(library, RIG, [(effect, place)])
        base = f"{effect}_{place.replace('+', '_')}"
        known = {**signals, **{n: temperature for n in model.log_inputs}}
        found = estimate(model, known, time, {f"{base}.{n}": v for n, v in given.items()})
        change = found[output] - without[output]
        ways = [moving & (np.sign(without["s1A.w"]) == sign) for sign in (1, -1)]
        yield (effect, {"title": f"{effect} @ {place}", "xlabel": LABELS[over], "ylabel": UNITS[output]},
               [(without[over][way], change[way]) for way in ways])


def panel(labels, parts, legend):
    """One signature: the way out, broad, and over it, narrow, the way back: where they agree both are seen."""
    axes = (Axis(*text.rstrip("]").split(" [")) for text in (labels["xlabel"], labels["ylabel"]))
    return Panel(*axes, [Line(*xy, Look(tone, "", width, "point"), name) for xy, tone, width, name in zip(
        parts, ("after", "before"), (2.4, 0.8), ("out", "back"))], labels["title"], legend=legend)


def main():
    """Write the sheet, and a picture for each effect."""
    library = Library()
    missing = set(catalogue(library)) - set(SHOWN)
    if missing:
        raise SystemExit(f"no signature for {', '.join(sorted(missing))}; add it to SHOWN")
    folder = Path(__file__).parent / "images" / "effects"
    columns = [[] for _ in range(COLUMNS)]
    for k, (effect, labels, parts) in enumerate(signatures(library)):
        columns[k % COLUMNS].append(panel(labels, parts, False))
        save(Plot(effect, "", "", [[panel(labels, parts, True)]], height=2.4), folder, effect, ["png"])
    save(Plot("signatures", "What each effect looks like", "", columns, width=2, height=1.4 * len(columns[0]),
              apart=True), folder, "signatures", ["png"])
    sheet = folder / "signatures.png"  # small enough for a repository
    Image.open(sheet).convert("RGB").quantize(COLOURS).save(sheet, optimize=True)


if __name__ == "__main__":
    main()

"""How do the two motors share the torque over a gait-like cycle, and how far is it from the limits?

Run: python examples/cosim/sharing.py
Torque limits are the paper's: 453 N.m peak and 192 N.m nominal at one joint with both motors. It names no largest
speed: 2000 rpm (209 rad/s) at a motor is assumed here, nothing more.
"""

import numpy as np
from common import IMAGES, T_R, TAU_NOMINAL, TAU_PEAK, changed, logged
from draw import sharing as figure
from draw import write

W_MAX = 2000 * 2 * np.pi / 60  # rad/s, assumed
CYCLE, LOAD = 1.6, 90.0        # s, N.m: about what the hip of a grown person carries in walking


def log(load):
    """Two strides once the motion is in full swing."""
    run = logged(changed("gait", reference={"options": {"load": load, "cycle": CYCLE}}), 500,
                 w_H="plant.w_H", w_K="plant.w_K")
    return run[run["time"] > 8 - 2 * CYCLE].reset_index(drop=True)


def tell(run, load):
    """Shares of the motors and distance to the limits."""
    tau, w = (np.abs(run[[f"{n}1", f"{n}2"]].to_numpy()) for n in ("tau", "omega"))
    effort = (tau ** 2).sum(axis=0) / (tau ** 2).sum()
    torque = (np.abs(run["C_H"]) + np.abs(run["C_K"])).max()
    speed = (np.abs(run["w_H"]) + np.abs(run["w_K"])).max()
    single = max(np.abs(run["C_H"]).max(), np.abs(run["C_K"]).max())
    power = (run[["tau1", "tau2"]].to_numpy() * run[["omega1", "omega2"]].to_numpy())
    print(f"load {load:g} N.m in stance")
    print(f"  motor torque: peak {tau[:, 0].max():.2f} and {tau[:, 1].max():.2f} N.m, RMS "
          f"{np.sqrt((tau[:, 0] ** 2).mean()):.2f} and {np.sqrt((tau[:, 1] ** 2).mean()):.2f} N.m "
          f"({tau.max() / TAU_PEAK:.0%} of the peak, {np.sqrt((tau ** 2).mean(axis=0)).max() / TAU_NOMINAL:.0%} of the "
          "nominal torque)")
    print(f"  share of the heat: motor 1 {effort[0]:.0%}, motor 2 {effort[1]:.0%}; one motor brakes the other in "
          f"{(power[:, 0] * power[:, 1] < 0).mean():.0%} of the time")
    print(f"  |C_H| + |C_K| up to {torque:.1f} N.m of {2 * T_R * TAU_PEAK:.0f} (nominal {2 * T_R * TAU_NOMINAL:.0f}); "
          f"|w_H| + |w_K| up to {speed:.1f} rad/s of {W_MAX / T_R:.1f} (assumed)")
    print(f"  one motor a joint, same motors: {single / (T_R * TAU_PEAK):.0%} of its peak torque, this transmission "
          f"{torque / (2 * T_R * TAU_PEAK):.0%}; RMS of the larger joint torque {_rms(run):.1f} N.m")


def _rms(run):
    return np.sqrt((run[["C_H", "C_K"]].to_numpy() ** 2).mean(axis=0)).max()


def main():
    """Measure, tell, draw."""
    for load in (0.0, 30.0):
        tell(log(load), load)
    run = log(LOAD)
    tell(run, LOAD)
    torque = (run["C_H"], run["C_K"], [(2 * T_R * TAU_PEAK, "peak"), (2 * T_R * TAU_NOMINAL, "nominal")],
              T_R * TAU_PEAK, "torque [N.m]")
    speed = run["w_H"], run["w_K"], [(W_MAX / T_R, "assumed limit")], W_MAX / T_R, "speed [rad/s]"
    last = run[run["time"] > run["time"].iloc[-1] - CYCLE].reset_index(drop=True)
    write(figure(last, (last["time"].to_numpy() / CYCLE) % 1.0, torque, speed), IMAGES, "sharing")


if __name__ == "__main__":
    main()

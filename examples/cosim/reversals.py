"""How good is the torque estimate through reversals and at standstill, where the law has no sign?

Run: python examples/cosim/reversals.py
The six manoeuvres, with rests in between, under position control; then the joint torques from motor angles, speeds and
torques, by five estimators: without friction; with the sign of the speed; with friction states, exact; with friction
states from a real encoder; with friction states whose travel is wrong three times over.
"""

import numpy as np
from common import IMAGES, LIBRARY, T_R, changed, logged
from draw import reversals as figure
from draw import write

from pycosim.compile import ArrayFunction, compile_model
from pycosim.dynamics.simulate import estimate
from pycosim.export.description import values
from pycosim.study.parse import load_study

QUANTUM, W_MIN = 2 * np.pi / 2 ** 14, 0.02  # encoder step [rad]; slower is standing still [rad/s]


def log():
    """One run of the manoeuvres at two speeds."""
    scenario = changed("six_manoeuvres", controller={"rate": 1000}, plant={"rate": 1000},
                       reference={"rate": 1000, "options": {"speeds": [0.4, 1.6], "repeats": 1}})
    return logged(scenario, omega1="plant.motor1.w", omega2="plant.motor2.w", w_1B="plant.s1B.w")


def estimators(run, model, given):
    """Hip and knee torque, shape (2, n), by each of the estimators."""
    time = run["time"].to_numpy()
    theta, omega, tau = (run[[f"{n}1", f"{n}2"]].to_numpy().T for n in ("theta", "omega", "tau"))
    coarse = np.round(theta / QUANTUM) * QUANTUM
    slow = np.gradient(_smoothed(coarse), time, axis=1)
    travel = {n: 3 * v for n, v in given.items() if n.endswith(".travel")}
    return {"no friction": T_R * np.array([tau[0] + tau[1], tau[0] - tau[1]]),
            "sign of the speed": _sliding(model, given, theta, omega, tau),
            "friction states": _states(model, given, time, theta, omega, tau),
            "states, encoder": _states(model, given, time, coarse, slow, tau),
            "states, travel x 3": _states(model, {**given, **travel}, time, theta, omega, tau)}


def _smoothed(angle, width=9):
    """Angles averaged over a few samples, for a speed that is not all steps."""
    padded = np.pad(angle, ((0, 0), (width // 2, width // 2)), mode="edge")
    return np.array([np.convolve(a, np.full(width, 1 / width), mode="valid") for a in padded])


def _states(model, given, time, theta, omega, tau):
    signals = {f"motor{k + 1}.{n}": v[k] for n, v in (("phi", theta), ("tau", tau)) for k in (0, 1)}
    signals.update({f"der(motor{k + 1}.phi)": omega[k] for k in (0, 1)})
    found = estimate(model, signals, time, given)
    return np.array([found["C_H"], found["C_K"]])


def _sliding(model, given, theta, omega, tau):
    question = model.question("estimate").select(["C_H", "C_K"])
    known = {f"motor{k + 1}.{n}": v[k] for n, v in (("phi", theta), ("tau", tau)) for k in (0, 1)}
    known.update({f"der(motor{k + 1}.phi)": omega[k] for k in (0, 1)})
    arguments = [known.get(n, 0.0) for n in question.inputs] + [given[p] for p in question.parameters]
    return ArrayFunction(question.sliding())(arguments, theta.shape[1])


def parts(run):
    """Which samples move, which are within 0.1 s of a reversal, which stand still."""
    speed = np.abs(run[["omega1", "omega2", "w_1B"]].to_numpy()).min(axis=1)
    moving = speed > W_MIN
    near = np.convolve(~moving, np.ones(201), mode="same") > 0
    return {"moving": moving & ~near, "just before and after": moving & near, "standing still": ~moving}


def main():
    """Measure, tell, draw."""
    from common import HERE
    study = load_study(HERE / "machine.toml")
    model = compile_model(LIBRARY, study.rig)
    run, given = log(), values(study, model)
    truth = run[["C_H", "C_K"]].to_numpy().T
    found = estimators(run, model, given)
    print("RMSE of hip and knee torque [N.m]")
    for name, torque in found.items():
        told = ", ".join(f"{part} {np.sqrt(np.mean((torque - truth)[:, chosen] ** 2)):.3f}"
                         for part, chosen in parts(run).items())
        print(f"  {name}: {told}; largest {np.abs(torque - truth).max():.2f}; "
              f"largest jump in 1 ms {np.abs(np.diff(torque, axis=1)).max():.2f}")
    write(figure(run, truth, found), IMAGES, "reversals")


if __name__ == "__main__":
    main()

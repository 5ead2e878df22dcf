"""A law and its model in; steps of the FMU to hold it against, and a robot that carries it, out."""

from __future__ import annotations

import numpy as np

from pycosim.dynamics.simulate import dynamics


def steps(model, known, law, n, h=1e-3, seed=0):
    """Random steps of the function that the FMU takes along: what a law needs, and the torque on the links.

    Parameters
    ----------
    model : Model
    known : dict of str to float
    law : Law
    n : int
    h : float
        Step [s].
    seed : int

    Returns
    -------
    tuple
        Which of the steps were solved; states, inputs and times at their start; all variables at start and end; the
        dynamics.
    """
    d, rng = dynamics(model), np.random.default_rng(seed)
    q = d.prepare([known[m] for m in d.parameters])
    friction = np.array([m in law.states for m in d.states])
    angles = np.array([model.variables[m].unit == "rad" and m not in law.states for m in d.states])
    calm = rng.uniform(size=n) < 0.3  # a third of them at rest or just reversed
    x = rng.uniform(-2, 2, (n, len(d.states))) * np.where(friction | angles, 1, np.where(calm, 0.01, 1)[:, None])
    x[:, friction] = np.clip(x[:, friction], -1, 1)
    u = rng.uniform(-1, 1, (n, len(d.inputs)))
    u *= [0 if m.startswith("push") else 5 if m == "v_in" else 0.5 for m in d.inputs]
    t = rng.uniform(0, 100, n)
    z = d.initial.map(n)(x.T, np.zeros((len(d.algebraic), n)), u.T, np.tile(np.array(q), n), t[None])
    after, z, error = d.step.map(n)(x.T, z, u.T, u.T, np.tile(np.array(q), n), t[None], np.full((1, n), h))
    p = np.tile(np.array([[known[m]] for m in d.parameters]), n)
    ok = np.array(error)[0] <= 1
    assert ok.mean() > 0.99

    def all_of(states, algebraic):
        y = np.array(d.output.map(n)(states, algebraic, u.T, p, t[None] + h))
        return {**dict(zip(d.algebraic, np.array(algebraic))), **dict(zip(d.outputs, y)),
                **dict(zip(d.states, np.array(states)))}
    return ok, x, np.array(u), t, all_of(x.T, z), all_of(after, z), d


def on_links(rig, y, known):
    """Torque of the drive on the links as the motors feel it, from the FMU's own variables.

    Parameters
    ----------
    rig : str
    y : dict of str to ndarray
    known : dict of str to float

    Returns
    -------
    list of ndarray
        One a motor.
    """
    if rig == "GearedJoint":
        return [y["C"] / 50 + known["motor.J"] * y["motor.a"]]
    if rig == "ServoPendulum":
        return [y["pendulum.flange.tau"] + known["motor.J"] * y["pendulum.a"]]
    if rig == "ScrewDrive":
        return [y["nut.flange.tau"] + known["motor.J"] * y["motor.a"]]
    hip, knee = y["C_H"] / 15.125 / 2, y["C_K"] / 15.125 / 2
    return [hip + knee + known["motor1.J"] * y["motor1.a"], hip - knee + known["motor2.J"] * y["motor2.a"]]


def four_legs(rig, base=True, friction=""):
    """A robot of 12 joints on a floor, each driven by the same drive.

    Parameters
    ----------
    rig : str
        Of the plugin's name; empty for plain motors.
    base : bool
        Whether it stands on the floor rather than hangs fixed.
    friction : str
        Attributes of each joint, of MuJoCo's own friction.

    Returns
    -------
    str
        MJCF.
    """
    legs, drives = "", ""
    for k, (x, y) in enumerate(((0.2, 0.1), (0.2, -0.1), (-0.2, 0.1), (-0.2, -0.1))):
        legs += f"""<body pos="{x} {y} 0"><joint name="a{k}" axis="1 0 0" armature="0.002" {friction}/>
          <inertial pos="0 0.02 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>
          <body pos="0 {y / 3} 0"><joint name="b{k}" axis="0 1 0" armature="0.002" {friction}/>
          <inertial pos="0 0 -0.05" mass="0.1" diaginertia="2e-4 2e-4 1e-4"/>
          <body pos="0 0 -0.1"><joint name="c{k}" axis="0 1 0" armature="0.002" {friction}/>
          <inertial pos="0 0 -0.05" mass="0.05" diaginertia="1e-4 1e-4 5e-5"/>
          <geom type="sphere" pos="0 0 -0.1" size="0.015"/></body></body></body>"""
        drives += "".join(f'<plugin joint="{c}{k}" instance="drive"/>' if rig else f'<motor joint="{c}{k}"/>'
                          for c in "abc")
    own = f'<extension><plugin plugin="pycosim.{rig}"><instance name="drive"/></plugin></extension>' if rig else ""
    return f"""<mujoco>{own}
      <option timestep="0.001" integrator="implicitfast"/><worldbody><geom type="plane" size="5 5 0.1"/>
      <body pos="0 0 {0.21 if base else 1}">{'<freejoint/>' * base}
      <inertial pos="0 0 0" mass="1" diaginertia="5e-3 1e-2 1e-2"/>{legs}</body></worldbody>
      <actuator>{drives}</actuator></mujoco>"""

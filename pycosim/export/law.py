"""A compiled rig in, its drive alone out: torque at the motors' angles from motion and inputs, for engines that move.

A simulator has its own bodies and its own integrator; what it lacks is the drive between motor and link. The law holds
everything of the rig but the links' masses and the rotors' inertia, which the engine has: friction with its state,
load and effects, back-EMF, ripple. It is the rig's own model, with a torque from outside at every link, asked for that
torque; what comes out is what the links get, as the motors' angles feel it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..compile.solve import der
from ..core.errors import StudyError
from ..dynamics.states import advance
from ..dynamics.stepping import jacobian, split_parameters
from .description import tunable
from .links import Links, evaluate


@dataclass
class Law:
    """A drive for engines that bring their own bodies.

    With n motors, m friction states and k inputs; every vector is a column, SI units, angles those of the motors.

    Attributes
    ----------
    rig : str
        Modelica class.
    motors, inputs, states, parameters : list of str
        Names: components, the input that drives each of them, friction states, and what may be changed.
    values : dict of str to float
        Of the parameters.
    variables : dict of str to Variable
        Of inputs, states and parameters.
    inertia : ndarray, shape (n, n)
        Of the rotors [kg.m2], which the engine must have: it is not in the torque.
    prepare : casadi.Function
        ``p -> q``: the parameters, and what they alone ask for.
    torque : casadi.Function
        ``(phi, w, a, mean, x, u, t, h, q) -> (tau, x_next)``: torque [N.m] and friction states at the end of a step of
        h seconds, from angle, speed and acceleration there, the mean speed over the step and the states at its start.
    implicit : casadi.Function
        ``(v, x, phi, w, u, t, h, q) -> (tau, slope)``: the same for a speed v at the end of a step that moves by h v,
        from angle phi and speed w at its start; with its Jacobian by v.
    follow : casadi.Function
        ``(mean, x, h, q) -> x_next``: friction states after a step.
    """

    rig: str
    motors: list
    inputs: list
    states: list
    parameters: list
    values: dict
    variables: dict
    inertia: np.ndarray
    prepare: ca.Function
    torque: ca.Function
    implicit: ca.Function
    follow: ca.Function

    @property
    def functions(self):
        """Those that an engine calls."""
        return [self.prepare, self.torque, self.implicit, self.follow]

    def prepared(self, parameters=None):
        """The parameters as the other functions take them.

        Parameters
        ----------
        parameters : dict of str to float, optional
            Instead of the law's own.

        Returns
        -------
        ndarray, shape (q,)
        """
        values = {**self.values, **(parameters or {})}
        return np.array(self.prepare([values[n] for n in self.parameters])).ravel()


def drive_law(model, parameters):
    """The drive of a rig.

    Parameters
    ----------
    model : Model
        A rig with motors and links, and its effects.
    parameters : dict of str to float
        Every parameter of the rig.

    Returns
    -------
    Law

    Raises
    ------
    StudyError
        The rig has no motor or no links, a motor has no input of its own, a ratio is not constant, or an effect asks
        for what an engine does not know.
    """
    return _Builder(model, parameters).law()


class _Builder:
    """The rig with a torque from outside at every link, and massless links."""

    def __init__(self, model, parameters):
        self.model, self.values = model, dict(parameters)
        links = Links(model, parameters).all()
        self.links, self.rotors = ([k for k in links if ("mass" in k.values) == heavy] for heavy in (True, False))
        self.motors = model.components("signal")
        if not self.links or not self.motors:
            raise StudyError(f"{model.rig} has no {'motor' if self.links else 'links with a mass'}, so there is no "
                             "drive between the two that an engine could take; take a rig with its load")
        self.fixed = {n for k in links for n in self._named(k)}
        self.question = self._ask()

    def _named(self, link):
        """Parameters that a link's mass and inertia are made of."""
        formulas = " ".join(link.formulas.get(k, "") for k in ("mass", "moment", "inertia"))
        words = re.findall(r"[A-Za-z_]\w*", formulas)
        return {f"{link.component}.{w}" for w in words} & set(self.values)

    def _massless(self):
        """Parameters that are zero where the engine has the masses: a formula's, in turn, until nothing is left."""
        library, gone = Links(self.model, self.values), set()
        for link in self.links:
            own = dict.fromkeys(library.values(link.component), 1.0)
            own.update({n.rpartition(".")[2]: 0.0 for n in gone if n.startswith(f"{link.component}.")})
            for formula in (link.formulas.get(k, "0") for k in ("mass", "moment", "inertia")):
                for word in re.findall(r"[A-Za-z_]\w*", formula):
                    if evaluate(formula, own) != 0 and evaluate(formula, {**own, word: 0.0}) != evaluate(formula, own):
                        own[word] = 0.0
                        gone.add(f"{link.component}.{word}")
        return gone

    def _ask(self):
        """The question: what must act on each link from outside, given motion and inputs."""
        declared, connected = [], []
        for k, link in enumerate(self.links):
            declared += [f'  input Real engine_rest{k}(unit="N.m");',
                         f"  DriveTrain.Components.Torque engine_torque{k}(tau=engine_rest{k});"]
            connected.append(f"  connect(engine_torque{k}.flange, {link.component}.{link.flange});")
        model = self.model.extended(declared, connected)
        self.rests = [f"engine_rest{k}" for k in range(len(self.links))]
        self.given = [n for n in self.model.alternatives("simulate")[0][1] if n != "time"]
        known = [*(f"{c}.phi" for c in self.motors), *self.given]
        angles = [k.angle for k in (*self.links, *self.rotors)]
        return model.ask([*self.rests, *angles, *(f"{c}.tau" for c in self.motors)], known, "drive")

    def law(self):
        """Put it together."""
        q, n = self.question, len(self.motors)
        self.phi, self.w, self.a, self.mean = (ca.SX.sym(k, n) for k in ("phi", "w", "a", "mean"))
        self.u, self.t, self.h = ca.SX.sym("u", n), ca.SX.sym("t"), ca.SX.sym("h")
        self.x, v, phi0, w0 = ca.SX.sym("x", len(q.states)), ca.SX.sym("v", n), ca.SX.sym("phi0", n), ca.SX.sym("w0", n)
        drives = self._drives()
        logged = [m for m in self.model.log_inputs if m in q.inputs]
        own = [m for m in tunable(self.model) if m in q.parameters and m not in self.fixed] + logged
        self.p = ca.SX.sym("p", len(own))
        self.known = {**dict(zip(own, ca.vertsplit(self.p))), **dict(zip(drives, ca.vertsplit(self.u)))}
        after = self._follow()
        tau, inertia = self._torque(after)
        moved = {"phi": phi0 + self.h * v, "w": v, "a": (v - w0) / self.h, "mean": v}
        ended = ca.substitute([tau], [getattr(self, k) for k in moved], list(moved.values()))[0]
        ended = ca.substitute(ended, self.t, self.t + self.h)
        (tau, after, ended, slope), symbols, values = split_parameters([tau, after, ended, jacobian(ended, v)], self.p)
        prepared = ca.vertcat(self.p, symbols)
        given = [self.phi, self.w, self.a, self.mean, self.x, self.u, self.t, self.h, prepared]
        variables = {m: q.variables.get(m) or self.model.variables[m] for m in (*drives, *q.states, *own)}
        return Law(
            self.model.rig, self.motors, drives, q.states, own,
            {m: self.values.get(m, variables[m].value) for m in own}, variables, inertia,
            ca.Function("prepare", [self.p], [ca.vertcat(self.p, values)], ["p"], ["q"]),
            ca.Function("torque", given, _dense(tau, after), ["phi", "w", "a", "mean", "x", "u", "t", "h", "q"],
                        ["tau", "x_next"]),
            ca.Function("implicit", [v, self.x, phi0, w0, self.u, self.t, self.h, prepared],
                        _dense(ended, ca.reshape(slope, n, n)), ["v", "x", "phi", "w", "u", "t", "h", "q"],
                        ["tau", "slope"]),
            ca.Function("follow", [self.mean, self.x, self.h, prepared], _dense(after), ["mean", "x", "h", "q"],
                        ["x_next"]))

    def _drives(self):
        """The input that drives each motor."""
        q, found = self.question, []
        u, x, p = q.symbols()
        for c in self.motors:
            tau = q.select([f"{c}.tau"]).output(u, x, p) if f"{c}.tau" in q.outputs else ca.SX(0)
            mine = [m for m in self.given if m in q.inputs and ca.depends_on(tau, u[q.inputs.index(m)])]
            if len(mine) != 1:
                raise StudyError(f"{self.model.rig}: no single input drives '{c}' ({', '.join(mine) or 'none does'}); "
                                 "an engine's actuator has one control")
            found += mine
        return found

    def _answer(self, function, speed):
        """A function of the question over the law's symbols, with a speed in the place of the motors'."""
        q, zero = self.question, self._massless() | {f"{c}.zero" for c in self.motors}
        known = {**self.known, "time": self.t}
        for k, c in enumerate(self.motors):
            known.update({f"{c}.phi": self.phi[k], der(f"{c}.phi"): speed[k], der(f"{c}.phi", 2): self.a[k]})
        known.update({m: 0.0 for m in self.given if m not in known})  # the engine has torques from outside itself
        strange = [m for m in q.inputs if m not in known]
        if strange:
            raise StudyError(f"{self.model.rig}: an effect needs '{strange[0]}', which no engine knows; leave it out")
        p = [self.known.get(m, 0.0 if m in zero else self.values[m]) for m in q.parameters]
        return function(ca.vertcat(*[known[m] for m in q.inputs]), self.x, ca.vertcat(ca.SX(0, 1), *p))

    def _follow(self):
        if not self.question.states:
            return ca.SX(0, 1)
        return advance(self._answer(self.question.rate, self.mean), self.x, self.h, self.p)

    def _torque(self, after):
        """Torque at the motors' angles without what the rotors take, and their inertia."""
        y = dict(zip(self.question.outputs, ca.vertsplit(self._answer(self.question.output, self.w))))
        by_motor = {k.angle: self._ratio(y, k.angle) for k in (*self.links, *self.rotors)}
        inertia = sum((k.values["inertia"] * np.outer(by_motor[k.angle], by_motor[k.angle]) for k in self.rotors),
                      np.zeros((len(self.motors), len(self.motors))))
        tau = ca.DM(inertia) @ self.a
        for rest, link in zip(self.rests, self.links):
            tau -= ca.DM(by_motor[link.angle]) * y[rest]
        return ca.cse(ca.substitute(tau, self.x, after)) if self.x.numel() else ca.cse(tau), inertia

    def _ratio(self, y, angle):
        """Turns of a link for one of each motor."""
        names = {f"{c}.phi": k for k, c in enumerate(self.motors)}
        if angle not in y:  # the same angle under another name
            raise StudyError(f"{self.model.rig}: '{angle}' does not follow from the motors' angles")
        slope = ca.jacobian(y[angle], self.phi)
        if ca.symvar(slope):
            raise StudyError(f"{self.model.rig}: the ratio between '{angle}' and {', '.join(names)} changes with the "
                             "angle, which no engine's actuator can take")
        return np.array(ca.evalf(ca.densify(slope))).ravel()


def _dense(*expressions):
    return ca.cse([ca.densify(e) for e in expressions])  # what they share is worked out once

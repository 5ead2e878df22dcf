"""A study and its model in; an MJCF file for MuJoCo, and a list of what MuJoCo cannot represent, out.

Angles and speeds of motors and segments are linear in those of the links, so each is a fixed tendon whose coefficients
are the model's own Jacobian: rotor inertia, friction and drive act along it. What a segment's friction does beyond a
constant and a viscous part is found by evaluating the model, and told.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as xml

import casadi as ca
import numpy as np

from .. import __version__
from ..compile.effects import annotation
from ..core.errors import StudyError
from ..dynamics.simulate import dynamics
from .description import system
from .links import Links

_FAST = (20.0, 40.0)  # rad/s; speeds where what friction does at low speed is over
_ANYWHERE = 1e3  # rad; an end of a range that is not limited
_ORDER_ONE = "implicitfast"  # damping of tendons is implicit in it
_ORDER_TWO = "RK4"  # with it the plugin steps as the FMU does, of order two; the others move angles by order one
_LEAST = 1e-12  # kg.m2; MuJoCo refuses links without inertia
_ALWAYS = (
    "Sticking: MuJoCo softens friction, so a loaded joint creeps slowly; the model's friction state, its elastic "
    "displacement before sliding and its damping are left out.",
    "Loads, losses and standstill flags of the segments: MuJoCo has one torque along each tendon, no loads within a "
    "stage.")


def to_mjcf(plant, plugin=None):
    """MJCF of a plant, and what it leaves out.

    Parameters
    ----------
    plant : Plant
        Of `pycosim.export.description.describe`.
    plugin : tuple of (str, list of str), optional
        Name of the plugin that is its drive (`pycosim.export.mujoco_plugin`), and the inputs of its motors; without it
        friction is what MuJoCo has of its own.

    Returns
    -------
    text : str
        XML, with the list as a comment.
    missing : list of str
        Sentences; what MuJoCo cannot represent of this plant.

    Raises
    ------
    StudyError
        The rig has no links, something besides its links moves, or a gear ratio is not constant.
    """
    machine = _Machine(plant)
    root = xml.Element("mujoco", model=plant.name)
    missing = machine.heavier() if plugin else [*machine.missing(), *machine.heavier(), *_ALWAYS]
    root.append(xml.Comment(_comment(plant, missing)))
    xml.SubElement(root, "compiler", angle="radian", inertiafromgeom="false")
    xml.SubElement(root, "option", timestep="0.001", integrator=_ORDER_TWO if plugin else _ORDER_ONE,
                   gravity=_numbers(machine.gravity()))
    if plugin:
        used = xml.SubElement(xml.SubElement(root, "extension"), "plugin", plugin=plugin[0])
        xml.SubElement(used, "instance", name="drive")
    bodies = machine.bodies(xml.SubElement(root, "worldbody"))
    tendons, actuators = xml.SubElement(root, "tendon"), xml.SubElement(root, "actuator")
    for name, given, coefficients in machine.motors() if plugin else machine.tendons():
        tendon = xml.SubElement(tendons, "fixed", name=name, **given)
        for joint, c in zip(bodies, coefficients):
            if c:
                xml.SubElement(tendon, "joint", joint=joint, coef=repr(float(c)))
    machine.stops(tendons, root, bodies)
    for name, tendon in zip(plugin[1], machine.model.components("signal")) if plugin else ():
        xml.SubElement(actuators, "plugin", name=name, tendon=tendon, instance="drive")
    for name, tendon, gain, slope in () if plugin else machine.actuators():
        xml.SubElement(actuators, "general", name=name, tendon=tendon, gainprm=repr(gain), biastype="affine",
                       biasprm=_numbers((0.0, 0.0, slope)), **machine.strength(tendon))
    _sensors(xml.SubElement(root, "sensor"), bodies, actuators)
    xml.indent(root, "  ")
    return xml.tostring(root, encoding="unicode") + "\n", missing


def _sensors(group, joints, actuators):
    """What a machine is fitted with: encoders at joints and motors, and the torques of the motors."""
    motors = dict.fromkeys(a.get("tendon") for a in actuators)
    for kind, names in (("joint", joints), ("tendon", motors)):
        for name in names:
            angle, speed = (name, f"der({name})") if kind == "joint" else (f"{name}.phi", f"{name}.w")
            if angle not in joints or kind == "joint":  # else the motor's angle is the joint's
                xml.SubElement(group, f"{kind}pos", name=angle, **{kind: name})
                xml.SubElement(group, f"{kind}vel", name=speed, **{kind: name})
    for actuator in actuators:
        xml.SubElement(group, "actuatorfrc", name=f"{actuator.get('name')}.force", actuator=actuator.get("name"))


def _comment(plant, missing):
    heading = " What MuJoCo cannot represent of it:" if missing else ""
    lines = [f"{plant.rig} as the study {plant.name} has it, made by pycosim {__version__}. SI units.",
             "Links turn about y; each segment and motor is a fixed tendon whose length is its angle.",
             "Needs MuJoCo 3.3 or later (armature of tendons)." + heading,
             *(f"* {m}" for m in missing)]
    return "\n" + "\n".join("    " + line.replace("--", "- -") for line in lines) + "\n  "


def _numbers(values):
    return " ".join(repr(float(v) + 0.0) for v in values)


class _Machine:
    """The model with the study's values, as functions of states x, algebraic variables z and inputs u."""

    def __init__(self, plant):
        self.plant, self.model, self.d = plant, plant.model, dynamics(plant.model)
        self.x, self.z, self.u, self.t = (ca.SX.sym(n, k) for n, k in (
            ("x", len(self.d.states)), ("z", len(self.d.algebraic)), ("u", len(self.d.inputs)), ("t", 1)))
        p = ca.DM([plant.parameters[n] for n in self.d.parameters])
        y = self.d.output(self.x, self.z, self.u, p, self.t)
        self.all = {**dict(zip(self.d.outputs, ca.vertsplit(y))), **dict(zip(self.d.states, ca.vertsplit(self.x)))}
        self.rates = system(self.model, self.d)(self.x, self.z, self.u, p, self.t)[0]
        self.library = Links(plant.model, plant.parameters)
        links = self.library.all()
        self.links, self.rotors = ([k for k in links if ("mass" in k.values) == heavy] for heavy in (True, False))
        self._check()

    def _check(self):
        """Links, and nothing else, must be what moves."""
        if not self.links:
            raise StudyError(f"{self.plant.rig} has no links with a mass, so there is nothing that MuJoCo could move; "
                             "take a rig with its load")
        self.angles = ca.vertcat(*[self.all[k.angle] for k in self.links])
        self.by_angle = self._slope(self.angles, self.x)
        self.by_speed = self._slope(self.by_angle @ self.rates, self.x)
        moving = [n for n in self.d.states if (self.model.variables[n].min, self.model.variables[n].max)
                  != (-1, 1)]
        both = np.vstack([self.by_angle, self.by_speed])
        if np.linalg.matrix_rank(both) != len(moving) or len(both) != len(moving):
            raise StudyError(f"{self.plant.rig}: the links do not say all that moves ({', '.join(moving)}); MuJoCo can "
                             "take a train of rigid gears and links only")

    # --- what the library says ---

    def gravity(self):
        """Gravity [m/s2] as the links feel it, tilt included."""
        found = {(self.library.values(c)[name], self.library.values(c)[self.library.notes("tilt")[c]])
                 for c, name in self.library.notes("gravity").items()}
        if len(found) > 1:
            raise StudyError(f"{self.plant.rig}: its links have different gravity or tilt, MuJoCo has one for all")
        g, tilt = found.pop() if found else (0.0, 0.0)
        return -g * math.sin(tilt), 0.0, -g * math.cos(tilt)

    # --- limits of the study ---

    def _positions(self):
        """Limits of angles and of sums of them: words, row over the links, least, greatest; and all other limits."""
        found, others = [], []
        for words, (low, high) in self.plant.limits.items():
            names = [n.strip() for n in words.split("+")]
            if not all(n in self.all and self.model.variables[n].unit == "rad" for n in names):
                others.append(words)
                continue
            ends = [-math.inf if low is None else low, math.inf if high is None else high]
            found.append((words, sum(self._along(n) for n in names), *ends))
        return found, others

    def stops(self, tendons, root, joints):
        """Stops: a range of the joint where one alone is limited, else of a tendon over those that are."""
        elements = {e.get("name"): e for e in root.iter("joint") if e.get("type")}
        for words, row, low, high in self._positions()[0]:
            given = {"limited": "true", "range": _numbers([max(low, -_ANYWHERE), min(high, _ANYWHERE)])}
            moved = np.flatnonzero(row)
            if len(moved) == 1 and row[moved[0]] == 1:
                elements[joints[moved[0]]].attrib.update(given)
                continue
            tendon = xml.SubElement(tendons, "fixed", name=f"limit of {words}", **given)
            for k in moved:
                xml.SubElement(tendon, "joint", joint=joints[k], coef=repr(float(row[k])))

    def strength(self, motor):
        """Greatest torque of a motor, as attributes of its actuator."""
        low, high = self.plant.limits.get(f"{motor}.tau", (None, None))
        most = min(math.inf if high is None else high, math.inf if low is None else -low)
        return {"forcelimited": "true", "forcerange": _numbers((-most, most))} if math.isfinite(most) else {}

    # --- bodies ---

    def bodies(self, world):
        """Write the links; names of their joints."""
        elements, joints = {}, []
        for link in self.links:
            parent = elements.get((link.component, link.parent), world)
            offset = next((k.values["length"] for k in self.links if (k.component, k.flange)
                           == (link.component, link.parent)), 0.0)
            body = xml.SubElement(parent, "body", name=f"{link.component}_{link.flange}",
                                  pos=_numbers((0, 0, -offset)))
            joints.append(next((n for n in self.d.states if self.all[n].is_symbolic()
                                and ca.is_equal(self.all[n], self.all[link.angle])), link.angle))
            xml.SubElement(body, "joint", name=joints[-1], type="hinge", axis="0 -1 0")
            mass, centre, inertia = self._inertial(link)
            xml.SubElement(body, "inertial", pos=_numbers((0, 0, -centre)), mass=repr(mass),
                           diaginertia=_numbers([max(inertia, _LEAST)] * 3))
            end = link.values.get("length", 2 * centre)
            if end:
                xml.SubElement(body, "geom", type="capsule", fromto=_numbers((0, 0, 0, 0, 0, -end)), contype="0",
                               conaffinity="0", size=repr(0.06 * abs(end)))
            elements[link.component, link.flange] = body
        return joints

    def _inertial(self, link):
        """Mass, distance of its centre, and inertia about it."""
        mass, moment, inertia = (link.values.get(k, 0.0) for k in ("mass", "moment", "inertia"))
        if inertia <= 0:
            raise StudyError(f"{link.component} has no inertia about {link.flange}; MuJoCo cannot move it")
        needed = moment ** 2 / inertia  # less, and the inertia about the centre would be negative
        if mass < needed and link.parent:
            raise StudyError(f"{link.component}: no body of {mass:g} kg has its centre and inertia; MuJoCo refuses it")
        mass = max(mass, needed)
        return mass, moment / mass if mass else 0.0, inertia - moment ** 2 / mass if mass else inertia

    # --- tendons ---

    def _slope(self, expression, by):
        """Constant Jacobian."""
        slope = ca.densify(ca.cse(ca.jacobian(expression, by)))
        found = [np.array(ca.Function("slope", [self.x, self.z, self.u, self.t], [slope])(
            *[np.full(s.numel(), k) for s in (self.x, self.z, self.u, self.t)])) for k in (0.1, -0.3)]
        if not np.allclose(*found, rtol=1e-9, atol=1e-12):
            raise StudyError(f"{self.plant.rig}: a ratio changes with the angle, which MuJoCo's tendons cannot")
        return found[0]

    def _along(self, name, speed=False):
        """Coefficients of an angle or a speed over the angles or speeds of the links."""
        base = self.by_speed if speed else self.by_angle
        row = self._slope(self.all[name], self.x)
        found = np.linalg.lstsq(base.T, row.ravel(), rcond=None)[0]
        if not np.allclose(base.T @ found, row.ravel(), atol=1e-9):
            raise StudyError(f"{self.plant.rig}: '{name}' does not follow from the angles of the links")
        found[np.abs(found) < 1e-12] = 0.0
        return found

    def motors(self):
        """Name, attributes and coefficients of the motors, each with its rotor's inertia."""
        for c in self.model.components("signal"):
            inertia = sum(r.values["inertia"] for r in self.rotors
                          if np.allclose(self._along(r.angle), self._along(f"{c}.flange.phi")))
            yield c, {"armature": repr(float(inertia))}, self._along(f"{c}.flange.phi")

    def tendons(self):
        """Name, attributes and coefficients of what turns: rotors with their inertia, segments with their friction."""
        yield from self.motors()
        for c, friction in self.friction().items():
            yield c, {"frictionloss": repr(max(0.0, friction.constant)),
                      "damping": repr(max(0.0, friction.viscous))}, self._along(f"{c}.w", speed=True)

    def actuators(self):
        """Name, tendon, torque over the input and torque over the speed of what drives."""
        for c in self.model.components("signal"):
            torque = self.all[f"{c}.tau"]
            gain, slope = self._slope(torque, self.u).ravel(), self._slope(torque, self.x).ravel()
            speed = self._slope(self.all[f"{c}.w"], self.x).ravel()
            for k in np.flatnonzero(gain):
                yield self.d.inputs[k], c, float(gain[k]), float(slope @ speed / (speed @ speed))

    # --- friction ---

    def friction(self):
        """Friction of every segment, as the model has it."""
        return {c: _Friction(self, c) for c in self.model.segments}

    def missing(self):
        """What the model has and the tendons have not."""
        found = [text for f in self.friction().values() for text in f.missing()]
        for e, p in self.model.attached:
            at_motor = not any(c in self.model.segments for c in p.components)
            if at_motor and "links" not in annotation(self.model.library, e.model):
                found.append(f"{e.id} at {p.name}: {e.description}.")
        return found

    def heavier(self):
        """Links whose mass MuJoCo wants larger."""
        found = []
        torques = {f"{c}.tau" for c in self.model.components("signal")}
        found += [f"The limit of {words}: MuJoCo limits angles and torques, and nothing else." for words
                  in self._positions()[1] if words not in torques]
        for link in self.links:
            if self._inertial(link)[0] > link.values["mass"] * (1 + 1e-12):
                found.append(f"{link.component}: its mass is written as {self._inertial(link)[0]:g} kg instead of "
                             f"{link.values['mass']:g} kg, the least that its centre and inertia allow; about a fixed "
                             "axle it makes no difference.")
        return found


class _Friction:
    """Friction torque F of one segment, at chosen states, at no load."""

    def __init__(self, machine, component):
        self.m, self.component = machine, component
        d, load = machine.d, machine.all[f"{component}.L"]
        self.free = ca.vertcat(machine.z, machine.u)
        arguments = [machine.x, self.free, machine.t]
        self.load = ca.Function("load", arguments, [load, ca.densify(ca.jacobian(load, self.free))])
        self.law = ca.Function("law", arguments, [machine.all[f"{component}.F"]])
        self.speed_of = machine._along(f"{component}.w", speed=True)
        self.angles = [k for k, n in enumerate(d.states) if machine.by_angle[:, k].any()]
        self.states = [k for k in range(len(d.states)) if k not in self.angles and not machine.by_speed[:, k].any()]
        slow, fast = (self.at(speed=w) for w in _FAST)
        self.viscous = (fast - slow) / (_FAST[1] - _FAST[0])
        self.constant = slow - self.viscous * _FAST[0]

    def at(self, speed=0.0, load=0.0, state=None, value=0.0, t=0.0):
        """F [N.m] for a speed of the segment [rad/s], one state moved, and its load as near as can be to one."""
        x = np.zeros(len(self.m.d.states))
        if speed:
            links = speed * self.speed_of / (self.speed_of @ self.speed_of)
            x = np.linalg.lstsq(self.m.by_speed, links, rcond=None)[0]
        if state is not None:
            x[state] = value
        v = np.zeros(self.free.numel())
        for _ in range(20):  # the load is straight in what is free, but for friction's own
            found, slope = (np.array(a) for a in self.load(x, v, t))
            v -= np.linalg.pinv(slope) @ (found.ravel() - load)
        self.reached = float(self.load(x, v, t)[0])
        return float(self.law(x, v, t))

    def missing(self):
        """Sentences about what a constant and a viscous part leave out."""
        rest, c = self.at(), self.component
        found = []
        slope = self._per_load(rest)
        if abs(slope) > 1e-9:
            found.append(f"{c}: its friction grows with its load, by {slope:.3g} N.m a N.m of mean load; written is "
                         "that of no load.")
        if abs(rest - self.constant) > 1e-6:
            found.append(f"{c}: at rest its friction is {rest:.3g} N.m, the line through its friction at high speed "
                         f"starts at {self.constant:.3g} N.m; written is the line.")
        if min(self.constant, self.viscous) < -1e-9:
            found.append(f"{c}: the line through its friction at high speed has a negative part, written as zero.")
        for name, change in self._changes(rest).items():
            found.append(f"{c}: its friction changes with {name}, by {change:.3g} N.m in what was tried; written is "
                         "that at rest at zero.")
        return found

    def _per_load(self, rest):
        loaded = self.at(load=1.0)
        return (loaded - rest) / abs(self.reached) if abs(self.reached) > 1e-9 else 0.0

    def _changes(self, rest):
        """Largest change of F with each other variable: an angle by 1 rad, a friction state by 1, time by 1000 s."""
        found = {}
        for k in (*self.angles, *self.states):
            tried = [self.at(state=k, value=v) - rest for v in (-0.999, 0.999)]
            found[self.m.d.states[k]] = max(tried, key=abs)
        found["time"] = self.at(t=1000.0) - rest
        return {n: v for n, v in found.items() if abs(v) > 1e-6}

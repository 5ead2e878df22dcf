"""A machine's model in; controllers, an estimator and a hand out, as blocks that Python steps and an FMU takes along.

What a block must know of the machine it asks the model: ``gravity_model`` for the torques that the leg needs,
``compensate`` for the motor torques that bring them to the joints, ``estimate`` for what arrives there. So a block is
a CasADi function like the plant, and the same wrapper exports it; only the control laws themselves are written here.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass, field

import casadi as ca

from ..compile import FILTERED
from ..core.errors import StudyError, UnknownNameError, closest
from ..core.units import Variable
from ..dynamics.states import advance

__all__ = ["Block", "CONTROLLERS", "estimator", "hand", "make", "position_control", "torque_control"]

PERIOD = 1e-3  # s, unless a scenario says otherwise


@dataclass
class Block:
    """A sampled system: it answers at once, and its states change once a period.

    Attributes
    ----------
    name, description : str
        What its FMU is called by, and a sentence.
    model : Model
        The machine it was made for.
    values : dict of str to float
        Parameters of that machine, as the block believes them.
    inputs, outputs, states, parameters : list of Variable
        ``value`` is the start; the last parameter is the period [s].
    output : casadi.Function
        ``(x, u, p) -> y``.
    update : casadi.Function
        ``(x, u, p) -> x`` of the next sample.
    """

    name: str
    description: str
    model: object
    values: dict
    inputs: list
    outputs: list
    states: list
    parameters: list
    output: ca.Function
    update: ca.Function


@dataclass
class _Builder:
    """Collects variables and expressions of a block; each group is name to (variable, symbol or expression)."""

    model: object
    values: dict
    period: float
    inputs: dict = field(default_factory=dict)
    states: dict = field(default_factory=dict)
    parameters: dict = field(default_factory=dict)
    outputs: dict = field(default_factory=dict)
    after: dict = field(default_factory=dict)

    def __post_init__(self):
        self.symbol_period = ca.SX.sym("period")

    # --- symbols ---

    def _symbol(self, group, variable):
        return group.setdefault(variable.name, (variable, ca.SX.sym(variable.name)))[1]

    def input(self, name, like=None, description="", unit=None):
        """An input, described as the machine's variable of this name, or as another."""
        known = self.model.variables.get(like or name) or Variable(name)
        return self._symbol(self.inputs, Variable(name, unit or known.unit, description or known.description))

    def parameter(self, name, value, unit, description, low=0.0, high=1e6):
        """A gain of the control law."""
        return self._symbol(self.parameters, Variable(name, unit, description, value, low, high, max(abs(value), 1e-3)))

    def state(self, name, unit, description):
        """Something to remember until the next sample."""
        return self._symbol(self.states, Variable(name, unit, description))

    def machine(self, name):
        """A parameter of the machine, with the value the block believes."""
        v = self.model.parameters[name]
        return self._symbol(self.parameters, Variable(name, v.unit, v.description, self.values[name], v.min, v.max,
                                                      v.nominal))

    def result(self, name, expression, like=None, description=""):
        """An output, described as the machine's variable of this name, or as another."""
        known = self.model.variables.get(like or name) or Variable(name)
        self.outputs[name] = Variable(name, known.unit, description or known.description), expression

    # --- the machine ---

    @property
    def motors(self):
        """Names of the motors."""
        return self.model.components("signal")

    @property
    def joints(self):
        """(angle, torque) of every joint, paired in the order in which the rig's annotation names them."""
        torques = self.model.alternatives("estimate")[0][0]
        of_motors = tuple(f"{m}." for m in self.motors)
        angles = [n for n in self.model.alternatives("simulate")[0][0]
                  if self.model.variables[n].unit == "rad" and not n.startswith(of_motors)]
        if len(angles) != len(torques):
            raise StudyError(f"{self.model.rig}: its annotation names the joint torques {', '.join(torques)}, but the "
                             f"joint angles {', '.join(angles) or 'not at all'}; a controller needs one a torque")
        return list(zip(angles, torques))

    def motion(self, prefix="", acceleration=False):
        """Inputs for angle and speed of every motor (and acceleration), by the names that the questions use."""
        found = {}
        for m in self.motors:
            what = {f"{m}.phi": f"{m}.phi", f"der({m}.phi)": f"{m}.w"}
            if acceleration:
                what[f"der(der({m}.phi))"] = f"{m}.a"
            for question, name in what.items():
                found[question] = self.input(f"{prefix}{name}", like=name, unit=_UNIT[name.rpartition(".")[2]],
                                             description=_WHAT[name.rpartition(".")[2]].format(
                                                 what="Wanted" if prefix else "Measured", motor=m))
        return found

    def given(self, question, form=0):
        """Inputs for all that a form of a question is given, by the names that it uses: the motors' motion first.

        Of a motor whose angle is known these are angle, speed and acceleration; of one whose speed is, the last two.
        What an attached effect holds back of a record is not held back here.
        """
        q, kinds, found = self.model.question(question, form), list(_WHAT), {}
        known = self.model.alternatives(question)[form][1]
        for m in self.motors:
            first = next((k for k, kind in enumerate(kinds) if f"{m}.{kind}" in known), len(kinds))
            for k, kind in enumerate(kinds[first:]):
                found[_der(f"{m}.{kinds[first]}", k)] = self.input(
                    f"{m}.{kind}", unit=self.model.along(_UNIT[kind]),
                    description=_WHAT[kind].format(what="Measured", motor=m))
        unheld = {_der(n) for n in q.late} - set(q.late)  # what is undone for a delay, its slope
        for n in [*known, *(n for n in q.inputs if n.startswith("der("))]:
            if n not in found and n not in unheld:
                motor = n.removesuffix(".tau")
                found[n] = self.input(n, description=f"Torque of {motor}, k_m Iq" if motor in self.motors else "")
        for n, behind in q.late.items():
            delay, lag = self.ask(question, {}, [behind, f"lag({n})"], form=form)
            found |= {f"at({n})": delay - lag, FILTERED[0].format(n): lag}
        return found

    def ask(self, question, known, outputs, states=None, form=0):
        """Outputs of a question for known variables; what is not known is zero, states too."""
        q = self.model.question(question, form).select(outputs)
        u = ca.vertcat(*[known.get(n, 0) for n in q.inputs], ca.SX(0, 1))
        x = ca.vertcat(*[(states or {}).get(n, 0) for n in q.states], ca.SX(0, 1))
        p = ca.vertcat(*[self.machine(n) for n in q.parameters], ca.SX(0, 1))
        return ca.vertsplit(q.output(u, x, p))

    def angles(self, motion):
        """Joint angles and speeds of a motion of the motors."""
        names = [angle for angle, _ in self.joints]
        q = ca.vertcat(*self.ask("estimate", motion, names))
        w = sum(ca.jacobian(q, motion[f"{m}.phi"]) * motion[f"der({m}.phi)"] for m in self.motors)
        return ca.vertsplit(q), ca.vertsplit(w)

    def friction_states(self, question, motion, form=0):
        """Friction states now: those of the last sample, moved on by what the motors moved since."""
        q = self.model.question(question, form)
        if not q.states:
            return {}
        before = {n: self.state(n, self.model.variables[n].unit, "Friction state at the last sample") for n in q.states}
        started = self.state("started", "1", "0 before the first sample")
        moved = {**motion, **self._moved(motion, started)}
        self.after["started"] = ca.SX(1)
        u, x, p = q.symbols()
        h = ca.SX.sym("h")
        move = ca.Function("move", [u, x, p, h], [advance(q.rate(u, x, p), x, h, p)])
        now = move(ca.vertcat(*[moved.get(n, 0) for n in q.inputs]), ca.vertcat(*before.values()),
                   ca.vertcat(*[self.machine(n) for n in q.parameters]), self.symbol_period)
        now = dict(zip(q.states, ca.vertsplit(now)))
        self.after.update(now)
        return now

    def _moved(self, motion, started):
        """Mean speed of each motor since the last sample, zero at the first: from its angles where they are known."""
        found = {}
        for m in self.motors:
            for kind, what in (("phi", "Angle"), ("w", "Speed")):
                if f"{m}.{kind}" not in motion:
                    continue
                now, last = motion[f"{m}.{kind}"], self.state(
                    f"{m}.{kind}_before", self.model.along(_UNIT[kind]), f"{what} of {m} at the last sample")
                self.after[f"{m}.{kind}_before"] = now
                if kind == "phi":
                    found[f"der({m}.phi)"] = started * (now - last) / self.symbol_period
                else:
                    found[f"{m}.w"] = started * (now + last) / 2
        return found

    def clock(self, outputs, form=0):
        """Time since the first sample, where outputs of the estimate depend on time."""
        q = self.model.question("estimate", form).select(outputs)
        u, x, p = q.symbols()
        if "time" not in q.inputs or not ca.depends_on(q.output(u, x, p), u[q.inputs.index("time")]):
            return {}
        now = self.state("clock", "s", "Time since the first sample")
        self.after["clock"] = now + self.symbol_period
        return {"time": now}

    def motor_torques(self, motion, wanted, share):
        """Motor torques for wanted joint torques: without friction, and a share of what friction takes."""
        names = [f"{m}.tau" for m in self.motors]
        at_rest = {n: (0 if n.startswith("der(") and n.count("(") == 1 else v) for n, v in motion.items()}
        ideal = self.ask("compensate", {**at_rest, **wanted}, names)  # friction states zero: nothing is lost
        full = self.ask("compensate", {**motion, **wanted}, names, self.friction_states("compensate", motion))
        return [a + share * (b - a) for a, b in zip(ideal, full)]

    # --- the block ---

    def block(self, name, description):
        """Put it together."""
        period = Variable("period", "s", "Time from one sample to the next", self.period, 1e-6, 10.0, 1e-3)
        after = ca.vertcat(*[self.after[n] for n in self.states], ca.SX(0, 1))
        y = ca.vertcat(*[e for _, e in self.outputs.values()], ca.SX(0, 1))
        used = {s.name() for s in ca.symvar(ca.vertcat(y, after))}  # a block declares no parameter that it does not use
        parameters = [pair for n, pair in self.parameters.items() if n in used] + [(period, self.symbol_period)]
        groups = [list(self.inputs.values()), list(self.states.values()), parameters]
        u, x, p = (ca.vertcat(*[symbol for _, symbol in group], ca.SX(0, 1)) for group in groups)
        inputs, states, parameters = ([variable for variable, _ in group] for group in groups)
        return Block(name, description, self.model, self.values, inputs, [v for v, _ in self.outputs.values()], states,
                     parameters,
                     ca.Function("output", [x, u, p], [ca.densify(ca.cse(y))], ["x", "u", "p"], ["y"]),
                     ca.Function("update", [x, u, p], [ca.densify(ca.cse(after))], ["x", "u", "p"], ["x_next"]))


def _der(name, times=1):
    """Name of a derivative in a question."""
    return "der(" * times + name + ")" * times


_UNIT = {"phi": "rad", "w": "rad/s", "a": "rad/s2"}
_WHAT = {"phi": "{what} angle of {motor}", "w": "{what} speed of {motor}", "a": "{what} acceleration of {motor}"}


def position_control(model, values, period=PERIOD, side="motor", gravity=True, friction=1.0):
    """PID control of a motion, with the torques that the motion needs fed forward.

    Inputs are the wanted motion of the motors (``ref.motor1.phi`` ..) and the measured one (``motor1.phi`` ..; joint
    angles as well on the joint side); outputs are motor torques. The friction state follows the wanted motion, so that
    the compensation knows the direction before the motor moves, and noise of the speed does not enter.

    Parameters
    ----------
    model : Model
        The machine as the controller knows it.
    values : dict of str to float
        Its parameters.
    period : float
        [s]
    side : str
        ``motor``: errors of the motor angles, gains in N.m/rad at the motor. ``joint``: of the joint angles.
    gravity : bool
        Feed forward what the leg needs (weight and inertia).
    friction : float
        Share of the friction that is compensated, 0 to 1.

    Returns
    -------
    Block
    """
    _choice("side", side, ("motor", "joint"))
    b = _Builder(model, dict(values), period)
    ref, now = b.motion("ref.", acceleration=True), b.motion()
    share = b.parameter("friction", friction, "1", "Share of the friction that is compensated", 0.0, 2.0)
    wanted = _needed(b, ref, gravity)
    if side == "joint":
        (q_ref, w_ref), w = b.angles(ref), b.angles(now)[1]
        pid = _pid(b, 400.0, 20.0, [(b.input(q, description="Measured joint angle"), q, a, v - s)
                                    for (q, _), a, v, s in zip(b.joints, q_ref, w_ref, w)])
        wanted = {n: wanted[n] + c for (_, n), c in zip(b.joints, pid)}
        torques = b.motor_torques(ref, wanted, share)
    else:
        pid = _pid(b, 3.0, 0.05, [(now[f"{m}.phi"], m, ref[f"{m}.phi"], ref[f"der({m}.phi)"] - now[f"der({m}.phi)"])
                                  for m in b.motors])
        torques = [a + c for a, c in zip(b.motor_torques(ref, wanted, share), pid)]
    _limited(b, torques)
    return b.block(f"position_{side}", f"Position control of {model.rig} on the {side} side")


def torque_control(model, values, period=PERIOD, gravity=True, friction=1.0):
    """Motor torques that bring wanted torques to the joints, from the measured motion.

    Inputs are the wanted joint torques (``ref.C_H`` ..: on top of the weight, when gravity is compensated) and the
    measured motion of the motors. There is no loop around it: a torque estimated from the same model would only repeat
    what was commanded.

    Parameters
    ----------
    model, values, period, friction
        As in `position_control`.
    gravity : bool
        Carry the weight of the leg.

    Returns
    -------
    Block
    """
    b = _Builder(model, dict(values), period)
    now = b.motion()
    share = b.parameter("friction", friction, "1", "Share of the friction that is compensated", 0.0, 2.0)
    at_rest = {f"{m}.phi": now[f"{m}.phi"] for m in b.motors}
    weight = _needed(b, at_rest, gravity)
    wanted = {n: weight[n] + b.input(f"ref.{n}", like=n, description=f"Wanted joint torque {n}") for _, n in b.joints}
    _limited(b, b.motor_torques(now, wanted, share))
    return b.block("torque", f"Torque control of {model.rig}, without torque sensors")


def estimator(model, values, period=PERIOD, form=0):
    """What a rig estimates from its motors alone: joint torques, or the force or voltage that its motion asks for.

    Inputs are what the rig's annotation ``estimate`` is given: the motion of the motors, and where it says so their
    torques. Friction states follow the measured angles through reversals and standstill, as
    `dynamics.simulate.estimate` has them. Accelerations matter where rotors have inertia; left unconnected, they are
    zero. What effects take from a log, as a temperature, is an input too; effects of time count it from the first
    sample.

    Parameters
    ----------
    model, values, period
        As in `position_control`.
    form : int
        Which of the forms of ``estimate``, where the annotation has several.

    Returns
    -------
    Block
    """
    forms = model.alternatives("estimate")
    _choice("form", str(form), [str(k) for k in range(len(forms))])
    names, b = forms[form][0], _Builder(model, dict(values), period)
    given = b.given("estimate", form)
    states = b.friction_states("estimate", given, form)
    for n, value in zip(names, b.ask("estimate", {**given, **b.clock(names, form)}, names, states, form)):
        b.result(n, value, description=f"Estimate of {n}: {model.variables[n].description}")
    return b.block("estimator", f"Estimate of {', '.join(names)} of {model.rig}, from its motors alone")


def hand(model, values, period=PERIOD):
    """Someone who moves the joints along a wanted motion: a spring and a damper from the joints to it.

    Inputs are the wanted motion of the motors and the measured one, outputs the torques from outside.

    Parameters
    ----------
    model, values, period
        As in `position_control`.

    Returns
    -------
    Block
    """
    b = _Builder(model, dict(values), period)
    (q_ref, w_ref), (q, w) = b.angles(b.motion("ref.")), b.angles(b.motion())
    k = b.parameter("k", 300.0, "N.m/rad", "Stiffness of the hand at a joint")
    d = b.parameter("d", 10.0, "N.m.s/rad", "Damping of the hand at a joint")
    motors = {f"{m}.tau" for m in b.motors}
    outside = [n for n in model.alternatives("simulate")[0][1] if n not in motors and n != "time"][-len(b.joints):]
    for n, a, s, v, r in zip(outside, q_ref, q, w_ref, w):
        b.result(n, k * (a - s) + d * (v - r), description=f"Torque of the hand: {n}")
    return b.block("hand", f"A hand that moves the joints of {model.rig}")


def _needed(b, motion, gravity):
    """Joint torques that a motion needs, or zero."""
    names = [n for _, n in b.joints]
    if not gravity:
        return dict.fromkeys(names, 0)
    return dict(zip(names, b.ask("gravity_model", motion, names)))


def _pid(b, kp, kd, channels):
    """PID laws of (measured, name, wanted, error of the speed), with one set of gains."""
    unit = "N.m/rad"
    kp = b.parameter("kp", kp, unit, "Gain of the angle")
    kd = b.parameter("kd", kd, "N.m.s/rad", "Gain of the speed")
    ki = b.parameter("ki", 0.0, "N.m/(rad.s)", "Gain of the angle's integral")
    most = b.parameter("integral_max", 1.0, "N.m", "Largest torque of the integral")
    found = []
    for measured, name, wanted, speed in channels:
        error, before = wanted - measured, b.state(f"{name}.integral", "N.m", f"Torque of the integral of {name}")
        b.after[f"{name}.integral"] = ca.fmin(most, ca.fmax(-most, before + ki * error * b.symbol_period))
        found.append(kp * error + kd * speed + before)
    return found


def _limited(b, torques):
    """Outputs for the motor torques, none larger than the motors give."""
    most = b.parameter("tau_max", 1e3, "N.m", "Largest torque of a motor")
    for m, tau in zip(b.motors, torques):
        b.result(f"{m}.tau", ca.fmin(most, ca.fmax(-most, tau)), description=f"Torque that {m} shall give")


def _choice(name, value, known):
    if value not in known:
        raise UnknownNameError(f"no {name} '{value}'{closest(str(value), known)}")


CONTROLLERS = {"position": position_control, "torque": torque_control, "estimator": estimator, "hand": hand}


def make(kind, model, values, period=PERIOD, **options):
    """An included block by its name.

    Parameters
    ----------
    kind : str
        ``position``, ``torque``, ``estimator`` or ``hand``.
    model, values, period
        As in `position_control`.
    **options
        Of the block: ``side``, ``gravity``, ``friction``.

    Returns
    -------
    Block

    Raises
    ------
    UnknownNameError
        No such block, or it has no such option.
    StudyError
        The rig's annotation lacks what the block asks the model.
    """
    _choice("controller", kind, CONTROLLERS)
    known = dict(list(inspect.signature(CONTROLLERS[kind]).parameters.items())[3:])
    for name, value in options.items():
        if name not in known:
            raise UnknownNameError(f"the controller '{kind}' has no option '{name}'{closest(name, known)}")
        usual = known[name].default
        if isinstance(value, bool) != isinstance(usual, bool) or isinstance(value, str) != isinstance(usual, str):
            raise StudyError(f"the controller '{kind}': option '{name}' must be of the kind of {usual!r}, not "
                             f"{value!r}")
    return CONTROLLERS[kind](model, values, period, **options)

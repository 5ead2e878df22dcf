"""A model and what is known of its noise in; what one stroke tells of parameters and rivals, as CasADi functions, out.

The derivatives are those of the identification's own residual: the same question of the same model, with the motor
torques that the model itself predicts for the motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from ..compile import component_name
from ..compile.model import der
from ..core.errors import StudyError

CLEAR = 4.0  # of a torque's noise: nearer to zero, a segment's load has the wrong sign too often to be believed
NODES = 5  # points of a way that stand for its samples


@dataclass(frozen=True)
class ChannelNoise:
    """Noise of one channel at one sample.

    Attributes
    ----------
    white, slow : float
        Standard deviations of white noise and of an exponentially correlated part, in the channel's unit.
    memory : float
        Time in which the slow part is forgotten [s].
    """

    white: float
    slow: float
    memory: float

    def density(self, duration, dwell, interval, paired):
        """Variance of a mean over a way, times its duration: what a second of it is worth.

        Parameters
        ----------
        duration, dwell : MX or float
            Of a way, and of the rest between it and the way back [s].
        interval : float
            Between samples [s].
        paired : bool
            Half the difference of out and back is meant.

        Returns
        -------
        MX or float
            In the channel's unit squared, times seconds.
        """
        x = duration / self.memory
        own = 2 / x - 2 * (1 - ca.exp(-x)) / x ** 2
        if not paired:
            return self.white ** 2 * interval + self.slow ** 2 * duration * own
        across = ca.exp(-dwell / self.memory) * ((1 - ca.exp(-x)) / x) ** 2
        return self.white ** 2 * interval / 2 + self.slow ** 2 * duration * (own - across) / 2


@dataclass
class Block:
    """One thing to be learnt: parameters, or a difference that other parameters could explain away.

    Attributes
    ----------
    model : Model
        That predicts the log, and whose derivatives count.
    free : list of str
        Parameters to differentiate by.
    values : dict of str to float
        Where.
    prior : ndarray, shape (p, p)
        Inverse covariance of the free parameters before the experiment.
    other : tuple of (Model, dict), optional
        Rival model and its parameters: the difference of both predictions is one column more.
    name : tuple of str
        Of the rivals.
    rows : ndarray, shape (k, p), optional
        Combinations of the parameters over their nominal values whose intervals count; each by itself by default.
    room : tuple of ndarray, shape (p,), optional
        How far each parameter may bend down and up to its bounds; as far as it likes by default.
    """

    model: object
    free: list
    values: dict
    prior: np.ndarray
    other: tuple | None = None
    name: tuple = field(default_factory=tuple)
    rows: object = None
    room: tuple | None = None


class Node:
    """Model at one point of a motion: derivatives and differences of all blocks, and the motor torques.

    Parameters
    ----------
    asked : Asked
        What is compared, see `pycosim.plan.Asked`.
    kin : Kinematics
        How angles and speeds of segments and joints follow from those of the motors.
    """

    def __init__(self, asked, kin):
        self.asked, self.kin = asked, kin
        m = len(kin.motors)
        self.phi, self.w, self.a = (ca.SX.sym(n, m) for n in ("phi", "w", "a"))
        self.signs = ca.SX.sym("s", len(kin.segments))

    @property
    def arguments(self):
        """Symbols: angles, speeds, accelerations of the motors, directions of the segments."""
        return [self.phi, self.w, self.a, self.signs]

    def _inputs(self, question, given):
        """A question's inputs as expressions of the motion; zero for what nothing drives."""
        motion = dict(given)
        for k, motor in enumerate(self.kin.motors):
            angle = f"{motor}.phi"
            motion.update({angle: self.phi[k], der(angle): self.w[k], der(der(angle)): self.a[k],
                           f"{motor}.w": self.w[k], der(f"{motor}.w"): self.a[k]})
        return ca.vertcat(*[motion.get(n, ca.SX(0)) for n in question.inputs], ca.SX(0, 1))

    def _states(self, question, model):
        """Friction states of sliding segments: the direction; those of effects end there too."""
        of = {component_name(e, p): p.components[0] for e, p in model.attached}
        rows = []
        for name in question.states:
            component = name.rsplit(".", 1)[0]
            component = of.get(component, component)
            rows.append(self.signs[self.kin.segments.index(component)] if component in self.kin.segments
                        else ca.SX(0))
        return ca.vertcat(*rows, ca.SX(0, 1))

    def _answer(self, model, question, values, given):
        numbers = ca.DM([float(values[n]) for n in question.parameters])
        return question.output(self._inputs(question, given), self._states(question, model), numbers)

    def torques(self, model, values):
        """Motor torques that a motion needs, as the model with these parameters predicts them.

        Parameters
        ----------
        model : Model
            Whose rig can tell its motors' torques from its motion.
        values : dict of str to float
            Of every parameter.

        Returns
        -------
        dict of str to SX
            By variable [N.m]; empty where the channels depend on the motion alone.
        """
        wanted = [n for n in self.asked.known if n.endswith(".tau")]
        if not wanted:
            return {}
        given = {}
        if model.notes.get("gravity_model"):
            question = model.question("gravity_model")
            names = model.alternatives("gravity_model")[0][0]
            given = dict(zip(names, ca.vertsplit(self._answer(model, question.select(names), values, {}))))
        try:
            question = model.question("compensate").select(wanted)
        except (StudyError, ValueError):
            raise StudyError(f"{model.rig}: its annotation does not say how to compensate, so the torques of a motion "
                             "that was not made yet cannot be predicted") from None
        return dict(zip(wanted, ca.vertsplit(self._answer(model, question, values, given))))

    def references(self, model, values):
        """Reference channels as the model without measurements predicts them.

        Parameters
        ----------
        model : Model
            Whose rig has a model of its load.
        values : dict of str to float
            Of every parameter.

        Returns
        -------
        dict of str to SX
            Empty where the rig has no model of its load.
        """
        if not model.notes.get("gravity_model"):
            return {}
        names = model.alternatives("gravity_model")[0][0]
        question = model.question("gravity_model").select(names)
        return dict(zip(names, ca.vertsplit(self._answer(model, question, values, {}))))

    def channels(self, model, values, given, free=()):
        """Compared channels, and their derivatives by the free parameters.

        Parameters
        ----------
        model : Model
            That is differentiated.
        values : dict of str to float
            Where it is.
        given : dict of str to SX
            Known torques.
        free : sequence of str
            Parameters, in the order of the slope's columns.

        Returns
        -------
        y : SX, shape (channels, 1)
        slope : SX, shape (channels, free)
        """
        question = self.asked.ask(model).select(self.asked.outputs)
        p = ca.SX.sym("p", len(question.parameters))
        y = question.output(self._inputs(question, given), self._states(question, model), p)
        numbers = ca.DM([float(values[n]) for n in question.parameters])
        columns = [p[question.parameters.index(n)] if n in question.parameters else ca.SX.sym("none") for n in free]
        slope = ca.jacobian(y, ca.vertcat(*columns, ca.SX(0, 1)))
        return ca.substitute(y, p, numbers), ca.substitute(slope, p, numbers)

    def clear(self, model, values, given, noise):
        """Square root of the share by which the signs of the segments' loads can be trusted.

        Near zero, noise of a measured torque turns the sign of a load now and then. That biases a fit, and no
        derivative shows it.

        Parameters
        ----------
        model : Model
            Its segments' mean loads are looked at.
        values : dict of str to float
            Of every parameter.
        given : dict of str to SX
            Known torques.
        noise : list of ChannelNoise
            One a channel.

        Returns
        -------
        SX
            Between 0 and 1.
        """
        question = self.asked.ask(model)
        loads = [n for n in question.outputs if n in {f"{c}.L" for c in self.kin.segments}]
        if not given or not loads:
            return ca.SX(1)
        torque = ca.SX.sym("torque", len(given))
        rows = question.select([*loads, *self.asked.outputs])
        numbers = ca.DM([float(values[n]) for n in question.parameters])
        known = dict(zip(given, ca.vertsplit(torque)))
        y = rows.output(self._inputs(rows, known), self._states(rows, model), numbers)
        load, channels = y[:len(loads)], y[len(loads):]
        answer = ca.sqrt(ca.sum2(ca.jacobian(channels, torque) ** 2) + 1e-30)
        least = [n.white / answer[c] for c, n in enumerate(noise[:len(self.asked.outputs)])]
        margin = (CLEAR * ca.mmin(ca.vertcat(*least))) ** 2
        share = 1.0
        for k in range(len(loads)):
            share *= load[k] ** 2 / (load[k] ** 2 + margin)
        return ca.substitute(ca.sqrt(share + 1e-12), torque, ca.vertcat(*given.values()))

    def block(self, block, noise):
        """Columns of a block: derivatives, and the difference to the rival as the last one.

        Parameters
        ----------
        block : Block
            Of the blocks that it was made with.
        noise : list of ChannelNoise
            One a channel; columns are in units of it.

        Returns
        -------
        SX, shape (channels, columns)
            Nothing where the sign of a load is in doubt.
        """
        model, values = (block.model, block.values) if block.other is None else block.other
        given = self.torques(model, values)  # the machine is the rival, where there is one
        y, slope = self.channels(block.model, block.values, given, block.free)
        clear = self.clear(model, values, given, noise)
        if block.other is None:
            return clear * slope
        return clear * ca.horzcat(slope, self.channels(*block.other, given)[0] - y)


class StrokeInformation:
    """What a second of a stroke tells, as a function of its centre, velocity, travel and ramp.

    Parameters
    ----------
    asked : Asked
        What is compared.
    kin : Kinematics
        Of the rig.
    blocks : list of Block
        What is to be learnt.
    limited : (Model, dict)
        Model and parameters that predict the torque for its limit.
    noise : list of ChannelNoise
        One a channel.
    dwell, interval : float
        Rest at each end, time between samples [s].
    """

    def __init__(self, asked, kin, blocks, limited, noise, dwell, interval):
        self.asked, self.kin, self.noise, self.dwell, self.interval = asked, kin, noise, dwell, interval
        node = Node(asked, kin)
        self.columns = [block.free for block in blocks]
        parts = [ca.densify(node.block(b, noise)) for b in blocks]
        self.widths = [p.size2() for p in parts]
        self.point = ca.Function("point", node.arguments, [ca.cse(ca.horzcat(*parts))])
        torque = node.torques(*limited)
        found = [torque[f"{m}.tau"] if f"{m}.tau" in torque else ca.SX(0) for m in kin.motors]
        self.torque = ca.Function("torque", node.arguments, [ca.cse(ca.vertcat(*found))])

    def __call__(self, centre, velocity, travel, ramp, signs):
        """Information a second of each block, and the torques at the ends.

        Parameters
        ----------
        centre, velocity : MX, shape (motors, 1)
            Of the stroke [rad], and of its way out between the ramps [rad/s].
        travel, ramp : MX
            As those of a `Stroke` [s].
        signs : ndarray, shape (segments,)
            Direction of each segment on the way out.

        Returns
        -------
        grams : list of MX, shape (columns, columns)
        torques : MX, shape (motors, k)
            At the points of both ways, and where the acceleration is greatest.
        """
        x = np.r_[(np.arange(NODES) + 0.5) / NODES]
        there = centre + ca.mtimes(velocity, travel * (ca.DM(x).T - 0.5))
        ways = [(sign * velocity, sign * signs) for sign in (1, -1)]
        zero = ca.DM.zeros(len(self.kin.motors), NODES)
        found = [self.point.map(NODES)(there, ca.repmat(w, 1, NODES), zero, ca.repmat(ca.DM(s), 1, NODES))
                 for w, s in ways]
        duration = travel + ramp
        period = 2 * (duration + self.dwell)
        parts = [(found[0] - found[1]) / 2] if self.asked.paired else found
        grams, total = [], sum(self.widths)
        channels = len(self.asked.outputs)
        for start, width in zip(np.cumsum([0, *self.widths[:-1]]), self.widths):
            gram = 0
            for part in parts:
                for c in range(channels):
                    density = self.noise[c].density(duration, self.dwell, self.interval, self.asked.paired)
                    rows = ca.reshape(part[c, :].T, total, NODES)[start:start + width, :]
                    gram += ca.mtimes(rows, rows.T) / density
            grams.append(gram * (duration / NODES) / period)
        return grams, self._torques(centre, velocity, travel, ramp, ways, there)

    def _torques(self, centre, velocity, travel, ramp, ways, there):
        """Along both ways at constant speed, and at their ends in the middle of a ramp."""
        found = []
        for w, s in ways:
            found.append(self.torque.map(NODES)(there, ca.repmat(w, 1, NODES), ca.DM.zeros(there.shape),
                                                ca.repmat(ca.DM(s), 1, NODES)))
            for end, sign in ((-0.5, 1), (0.5, -1)):
                at = centre + w * travel * end
                found.append(self.torque(at, w / 2, sign * math.pi / 2 * w / ramp, ca.DM(s)))
        return ca.horzcat(*found)

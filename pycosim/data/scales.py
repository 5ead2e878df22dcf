"""A machine's torques, speeds and travel in; bounds and steps of its parameters, in proportion to them, out.

The Modelica library writes nominal values and bounds for a motor of about 1 N.m and 1 rad/s that travels 10 rad. What a
screw of millinewton metres or an axis of kilonewtons may have is that, times the sizes in its own log.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..compile.model import along_axis, wave_units

# unit of a parameter: powers of torque, angle and speed that it is made of
_POWERS = {"N.m": (1, 0, 0), "rad": (0, 1, 0), "rad/s": (0, 0, 1), "N.m.s/rad": (1, 0, -1), "N.m/rad": (1, -1, 0),
           "kg.m2": (1, 1, -2), "1/(N.m)": (-1, 0, 0), "1/(N.m)^2": (-2, 0, 0), "rad/(N.m)": (-1, 1, 0)}
_ALONG = {**{along_axis(unit): powers for unit, powers in _POWERS.items()}, "rad/m": (0, -1, 0)}
TRAVEL = 10.0  # rad, that the library's nominal values stand for


@dataclass(frozen=True)
class Sizes:
    """Typical sizes of what a motor does in a log.

    Attributes
    ----------
    torque : float
        [N.m], on a linear axis [N].
    angle : float
        [rad] or [m], as a part of the travel that the library stands for.
    speed : float
        [rad/s] or [m/s].
    linear : bool
        Whether the motors are linear axes, of N and m instead of N.m and rad.
    """

    torque: float = 1.0
    angle: float = 1.0
    speed: float = 1.0
    linear: bool = False

    @classmethod
    def of(cls, torques, angles, speeds, linear):
        """Sizes of samples in motion.

        Parameters
        ----------
        torques, angles, speeds : sequence of ndarray, shape (n,)
            One a motor or segment; nothing where the log has none.
        linear : bool
            Whether the motors are linear axes, of N and m instead of N.m and rad.

        Returns
        -------
        Sizes
            One for what the log does not tell.
        """
        def largest(values, size):
            found = max((float(size(v)) for v in values if len(v)), default=0.0)
            return found if found > 0 else 1.0

        def rms(v):
            return np.sqrt(np.mean(v ** 2))
        return cls(largest(torques, rms), largest(angles, np.ptp) / TRAVEL if len(angles) else 1.0,
                   largest(speeds, rms), linear)

    def described(self, effect, variables):
        """Coefficients of an effect as this machine has them.

        Parameters
        ----------
        effect : Effect
            Its coefficients' nominal values and bounds are those of the library.
        variables : dict of str to Variable
            By coefficient, as the effect's file declares them.

        Returns
        -------
        dict of str to Variable
        """
        if self.linear:
            waves = wave_units(effect)
            variables = {n: replace(v, unit=waves.get(n) or along_axis(v.unit)) for n, v in variables.items()}
        return {n: self.fit(v) for n, v in variables.items()}

    def fit(self, variable):
        """A parameter with nominal value and bounds in proportion to the machine.

        Bounds become wider, never narrower: they say what is possible at all, the nominal value what is usual.

        Parameters
        ----------
        variable : Variable
            On a linear axis in its units.

        Returns
        -------
        Variable
        """
        powers = (_ALONG if self.linear else _POWERS).get(variable.unit)
        if powers is None:
            return variable
        factor = float(np.prod(np.power((self.torque, self.angle, self.speed), powers)))
        wider, closer = max(factor, 1.0), min(factor, 1.0)
        low = variable.min * (closer if variable.min > 0 else wider)
        return replace(variable, min=low, max=variable.max * wider, nominal=variable.nominal * factor)

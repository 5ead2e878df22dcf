"""Recorded angles and the speeds beside them in; speeds and accelerations of all logs, without phase lag, out."""

from __future__ import annotations

import math

import numpy as np

from ..core.errors import DataError
from .derivatives import derivatives, passed_on

KEPT = 200_000
"""Samples of all logs up to which the curves behind an angle are kept, a hundred bytes and more a sample: a search asks
for them at each look at rounding, which took 7 % of its time."""
SPEEDS = {"phi": "w", "s": "v"}  # of a rotating and of a sliding component: position and speed


def speed_beside(angle):
    """Name that the recorded speed of an angle or a position has.

    Parameters
    ----------
    angle : str
        As ``motor.phi`` or ``slide.s``.

    Returns
    -------
    str or None
        As ``motor.w`` or ``slide.v``; None where the name is that of neither.

    Examples
    --------
    >>> speed_beside("motor1.phi")
    'motor1.w'
    """
    component, _, kind = angle.rpartition(".")
    return f"{component}.{SPEEDS[kind]}" if kind in SPEEDS else None


class Motion:
    """What is derived from recorded angles, log by log.

    Parameters
    ----------
    angles : list of str
        Angles [rad] and positions [m] whose derivatives are wanted.
    time, run : ndarray, shape (n,)
        Of the samples of all logs [s], and the number of the log that each belongs to.
    measured : dict of str to ndarray, shape (n,)
        Everything measured, the angles among it.
    paths : list of Path
        Of the logs, for the words of an error.

    Attributes
    ----------
    rates : dict of str to ndarray, shape (n,)
        First and second derivatives, as ``der(motor.phi)`` [rad/s] and ``der(der(motor.phi))`` [rad/s2].
    spread : dict of str to float
        Standard deviation of the noise left in each first derivative, in its unit.
    unsure : ndarray of bool, shape (n,)
        Samples at whose ends of a log the derivatives do not follow the motion.

    Raises
    ------
    DataError
        A log is too short for derivatives.
    """

    def __init__(self, angles, time, run, measured, paths):
        self.time, self.run, self.measured = time, run, measured
        self.rates, self.spread, self._followed, self._memo = {}, {}, {}, {}
        self.unsure = np.zeros(len(time), bool)
        for angle in angles:
            self._derive(angle, paths)

    def _derive(self, angle, paths):
        speed, name = self.measured.get(speed_beside(angle)), f"der({angle})"
        first, second = np.zeros(len(self.time)) if speed is None else speed.copy(), np.zeros(len(self.time))
        variance = []
        for k, path in enumerate(paths):
            part = self.run == k
            if np.count_nonzero(part) > 1:
                try:
                    found = derivatives(self.time[part], self.measured[angle][part],
                                        None if speed is None else speed[part])
                except DataError as error:
                    raise DataError(f"{path}: {error}; record more, or leave the log out") from None
                first[part], second[part] = found.first, found.second
                self.unsure[part] |= found.unsure
                variance.append(found.noise**2)
                self._followed[angle, k] = found.bandwidth, found.trust
        self.rates[name], self.rates[f"der({name})"] = first, second
        self.spread[name] = np.sqrt(np.mean(variance)) if variance else 0.0

    @property
    def followed(self):
        """Angles and positions whose speeds and accelerations are derived from the record."""
        return list(dict.fromkeys(name for name, _ in self._followed))

    def told_by_speed(self, angle):
        """Whether the speed beside a recorded angle was measured, and used, in every run.

        Parameters
        ----------
        angle : str
            Variable.

        Returns
        -------
        bool
        """
        trusts = [trust for (name, _), (_, trust) in self._followed.items() if name == angle]
        return all(map(math.isfinite, trusts)) if trusts else speed_beside(angle) in self.measured

    def passed_on(self, angle, share=1.0):
        """The smooth motion behind a recorded angle and its recorded speed, or what small errors of both become there.

        Parameters
        ----------
        angle : str
            Variable whose derivatives the model is given.
        share : float
            Of the bandwidth that the record was followed with.

        Returns
        -------
        callable
            Takes angle and speed, ndarrays of shape (n,); gives a dict of str to ndarray, shape (n,), the angle and
            its first and second derivative by their names.
        """
        if ("passed on", angle, share) in self._memo:
            return self._memo["passed on", angle, share]
        parts = [(self.run == k, passed_on(self.time[self.run == k], share * band, trust))
                 for (name, k), (band, trust) in self._followed.items() if name == angle and band > 0]
        names = angle, f"der({angle})", f"der(der({angle}))"

        def derived(of_angle, of_speed):
            found = {n: np.zeros(len(self.time)) for n in names}
            for part, follow in parts:
                for name, values in zip(names, follow(of_angle[part], of_speed[part])):
                    found[name][part] = values
            return found

        if len(self.time) <= KEPT:
            self._memo["passed on", angle, share] = derived
        return derived

    def paths(self):
        """The smooth motion behind the recorded angles: between samples they move by it, and not by an encoder's steps.

        Returns
        -------
        dict of str to ndarray, shape (n,)
            Of the angles [rad] and positions [m] that are followed.
        """
        if "paths" not in self._memo:
            self._memo["paths"] = {a: self.passed_on(a)(self.measured[a], self.measured.get(
                speed_beside(a), self.measured[a]))[a] for a in self.followed}
        return self._memo["paths"]

    def calm(self, angle, share):
        """An angle and its derivatives as they are with a part of the bandwidth: with much less noise, and less sharp.

        Parameters
        ----------
        angle : str
            One of those followed.
        share : float
            Of the bandwidth that the record was followed with.

        Returns
        -------
        dict of str to ndarray, shape (n,)
            By their names.
        """
        if (angle, share) not in self._memo:
            values = _smooth(self.time, self.measured[angle], self.run)
            self._memo[angle, share] = self.passed_on(angle, share)(values,
                                                                    self.measured.get(speed_beside(angle), values))
        return self._memo[angle, share]


def _smooth(time, values, run):
    """A rounded signal between the moments at which it changes, where it is known best; itself without two of them."""
    found = np.array(values, dtype=float)
    for k in np.unique(run):
        part = np.flatnonzero(run == k)
        t, v = time[part], values[part]
        moved = np.flatnonzero(np.diff(v))
        if len(moved) > 1:
            found[part] = np.interp(t, (t[moved] + t[moved + 1]) / 2, (v[moved] + v[moved + 1]) / 2)
    return found

"""A fit with free delays in; the delays that leave least, sample by sample, and the interval of each, out.

A torque jumps where a segment turns, and a record that is moved by one sample more has another jump in its place. The
error over a delay is a parabola where the torque changes slowly, and has steps and flat stretches where it jumps: a fit
stops on them, and its second derivative tells nothing of how far they reach. So the delays are tried one by one, each
with the other parameters where they then leave least.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from ..compile import component_name
from .bounded import bounded

REACH = 40  # samples either way that a delay is looked for within its bounds, where nothing is known of it
NEAR = 6  # samples either way of where it is known to be
END = 0.05  # of the bounds' range, at either end, where the likelihood of what is no delay still grows
MOST = 8000  # samples that delays are tried on
PRESSED = 3.84  # fall of twice the log-likelihood at the ends of a 95 % interval
RULED = 6.0  # standard errors beyond which a delay is ruled out
PART = 0.1  # of all squares, which no ruggedness is: far from the least one sample more changes them by many times that
OUTWARD = (1, 1.5, 2, 2.5, 3, 4, 6, 8, 12, 16, 24, 32, REACH)  # samples off, at which that is asked
CLOSE = 0.75  # samples from the delay that leaves least, within which a fit has mostly come to it
ROUNDS = 5
JUMP = 6.0 ** -0.5  # samples: standard deviation of the delay that a jump tells, which lies anywhere between two
FAR = 6.0  # standard deviations, as which samples count that are further out, in a robust study
SMOOTH = np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 9.0
"""Over half samples: each delay meets the noise of a jump with that of other samples, and what it leaves is rugged."""


class Ends(NamedTuple):
    """What the likelihood says of a delay [s].

    Attributes
    ----------
    low, high : float
        Of the 95 % interval.
    least, most : float
        Beyond which a delay is ruled out, however straight the rest of the model is taken.
    """

    low: float
    high: float
    least: float
    most: float


def delays(model):
    """Names of the delays among a model's parameters.

    Parameters
    ----------
    model : Model
        With effects that delay a record, or none.

    Returns
    -------
    list of str
        As among the free parameters of a fit.
    """
    return [f"{component_name(effect, place)}.{c}" for effect, place in model.attached
            for c, kind in effect.scan.items() if kind == "delay"]


def found(dataset, model, fit, names, part, known, again):
    """The fit at the delays that leave least.

    Parameters
    ----------
    dataset : Dataset
        That was fitted.
    model : Model
        That was fitted to it.
    fit : Fit
        Where derivatives have brought it.
    names : list of str
        Of its free delays.
    part : str or ndarray of int
        That was fitted.
    known : dict of str to float
        What is known of the delays [s]; where nothing is, they are looked for far and wide.
    again : callable
        Parameters and names held to the fit from there.

    Returns
    -------
    Fit
        With the profiles of the delays.
    """
    step = float(np.median(np.diff(dataset.time)))
    if not step > 0:  # means of whole files
        return fit
    for name in names:
        profile = Profile(dataset, model, fit, name, part, step)
        tried = [known[name]] if name in known else step * np.arange(-REACH, REACH + 1, 2)
        nearest = min((profile.at, *(d for d in tried if profile.low < d < profile.high)), key=profile.left)
        for _ in range(ROUNDS):
            if _far(profile, nearest):
                fit = again({**fit.parameters, name: float(nearest)}, names)
                profile = Profile(dataset, model, fit, name, part, step)
            nearest = profile.least()
            if not _far(profile, nearest):
                break
        fit.profiles[name] = Ends(*profile.interval(), *profile.ruled_out())
    return fit


def _far(profile, delay):
    """Whether a fit has not come to a delay that leaves less."""
    return abs(delay - profile.at) > CLOSE * profile.step or profile.excess > profile.sure


def endless(fit):
    """Whether a delay was fitted that has no best value inside its bounds.

    Parameters
    ----------
    fit : Fit
        With profiles of its delays.

    Returns
    -------
    bool
        The best is within `END` of a bound.
    """
    ranges = [(fit.parameters[n], fit.variables[n]) for n in fit.profiles]
    return any(min(at - v.min, v.max - at) < END * (v.max - v.min) for at, v in ranges)


class Profile:
    """What the best fit with each delay leaves, in units of the noise.

    Parameters
    ----------
    dataset : Dataset
        That was fitted.
    model : Model
        That was fitted to it.
    fit : Fit
        Whose other parameters the best fits are near to.
    name : str
        Of the delay.
    part : str or ndarray of int
        That was fitted.
    step : float
        Between two samples [s].
    """

    def __init__(self, dataset, model, fit, name, part, step):
        problem = dataset.residuals(model, fit.free, fit.parameters, part)
        self.problem = problem.thin(max(1, problem.n // MOST))
        self.far = FAR if dataset.study.robust else np.inf  # a spike moved to where nothing is compared would decide
        view = dataset.view(part)
        there = view.i if dataset.paired else view
        self.turns = int(sum(np.count_nonzero(np.diff(np.sign(s[there]))) for s in dataset.speeds))
        self.fit, self.k, self.step, self._known = fit, fit.free.index(name), step, {}
        self.low, self.high = (getattr(fit.variables[name], end) for end in ("min", "max"))
        others = np.arange(len(fit.free)) != self.k
        slope = np.concatenate([j for _, _, j in self.problem.blocks(fit.values)], axis=2)[:, others]
        self.rows = np.concatenate([n.whiten(j, self.problem.chain) for n, j in zip(fit.noise, slope)], axis=1)
        self.gram = self.rows @ self.rows.T
        self.room = [np.array([getattr(fit.variables[n], end) for n in fit.free])[others] - fit.values[others]
                     for end in ("min", "max")]

    @property
    def at(self):
        """The delay of the fit [s]."""
        return float(self.fit.values[self.k])

    def left(self, delay):
        """Squares that are left with a delay, the other parameters moved within their bounds to where that is least.

        Parameters
        ----------
        delay : float
            [s]

        Returns
        -------
        float
            Infinite where the model has no answer.
        """
        if delay not in self._known:
            x = self.fit.values.copy()
            x[self.k] = delay
            residual = self.problem.residual(x)
            if not np.isfinite(residual).all():
                self._known[delay] = np.inf
            else:
                r = np.concatenate([n.whiten(r[None], self.problem.chain)[0]
                                    for n, r in zip(self.fit.noise, residual)])
                r = np.clip(r, -self.far, self.far)
                fall = bounded(self.gram, -self.rows @ r, *self.room)[0] if len(self.rows) else 0.0
                self._known[delay] = float(r @ r - fall)
        return self._known[delay]

    @property
    def excess(self):
        """How much more the delay of the fit leaves than the best near it, between two samples or at one alike."""
        some, left, _ = self._smoothed()
        here = left[np.argmin(np.abs(some - self.at))] if len(some) else 0.0
        return here - np.min(left, initial=here)

    @property
    def sure(self):
        """By how much squares differ that noise and ruggedness do not explain."""
        return PRESSED + 2 * self._smoothed()[2]

    def _smoothed(self):
        """Delays round that of the fit, what they leave, that without its ruggedness, and the ruggedness."""
        some = self.at + self.step / 2 * np.arange(-2 * NEAR - 2, 2 * NEAR + 3)
        some = some[(some > self.low) & (some < self.high)]
        left = np.array([self.left(d) for d in some])
        if len(some) < 4 * NEAR or not np.isfinite(left).all():
            return some, left, 0.0
        smooth = np.convolve(left, SMOOTH, "valid")
        bent = np.concatenate([np.diff(left[k::2], 4) for k in (0, 1)])  # between samples means lower the noise
        rugged = float(np.median(np.abs(bent)) / 0.6745 / np.sqrt(70.0))  # of white noise: 1, 4, 6, 4, 1
        return some[2:-2], smooth, rugged

    def least(self):
        """The delay near that of the fit that leaves least.

        Returns
        -------
        float
            [s]
        """
        some, left, _ = self._smoothed()
        return float(some[np.argmin(left)]) if len(some) else self.at

    def interval(self):
        """Ends of the stretch round the fit's delay in which the likelihood falls by no more than noise makes it.

        Nor is it narrower than samples can tell: a jump lies anywhere between two.

        Returns
        -------
        (float, float)
            [s]
        """
        some, left, _ = self._smoothed()
        inside = some[left <= np.min(left, initial=np.inf) + self.sure]
        least = stdtrit(self.fit.dof, 0.975) * JUMP * self.step / np.sqrt(self.turns) if self.turns else 0.0
        return float(min(self.at - least, *inside[:1])), float(max(self.at + least, *inside[-1:]))

    def ruled_out(self):
        """The nearest delays either way that the likelihood rules out; bounds, where it rules out none.

        Returns
        -------
        (float, float)
            [s]
        """
        _, left, rugged = self._smoothed()
        least = min(np.min(left, initial=np.inf), self.left(self.at))
        most = least + RULED ** 2 + min(RULED * rugged, PART * least)
        ends = []
        for sign, bound in ((-1.0, self.low), (1.0, self.high)):
            tried = [self.at + sign * n * self.step for n in OUTWARD]
            inside = [d for d in tried if self.low < d < self.high]
            ends.append(next((d for d in inside if self.left(d) > most), bound))
        return ends[0], ends[1]

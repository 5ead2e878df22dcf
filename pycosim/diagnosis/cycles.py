"""A table and the noise of its residual in; the ripples that explain most, and what chance makes of such a search, out.

A ripple is a sine of an angle with an unknown number of cycles. Its score at every number of cycles is a Fourier sum
over an angle that is not sampled evenly, so a non-uniform fast Fourier transform gives all of them at once, stretch by
stretch of the log. The same sums with the signs of whole stretches flipped tell how large the best of so many numbers
of cycles gets by chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import finufft
import numpy as np
from scipy.special import gammaincc

from ..data.noise import contiguous
from ..data.parameters import fewest_cycles
from ..fit import least_squares
from .table import Candidate

PEAKS = 4  # of the scan over the angle that are tested again, with the noise as fitted
STRETCHES = 200  # of the log whose signs are flipped: many for a variance, each longer than what the noise remembers
STEP = 1 / 3  # of a cycle over the whole travel, between neighbours: a peak between two of them keeps 91 % of its power
SLOW = 0.1  # part of the way whose sampling sets the highest number of cycles: the slow passes resolve most
MOST = 2 ** 15  # numbers of cycles of one place; they bound the time
ABSORBED = 1e-3  # part of a sine's score that must be left beside the base parameters
_CHUNK = 2048  # numbers of cycles at once
_ACCURACY = 1e-6  # of the transform, relative to the largest sum


@dataclass
class Ripples:
    """What the scan leaves.

    Attributes
    ----------
    candidates : list of Candidate
        The numbers of cycles at which each effect at each place takes most.
    columns : list of ndarray, shape (channels, n)
        Those that the candidates number, the first with the number that was asked for.
    chance : ndarray, shape (draws,)
        Largest minus logarithm of a single p-value that each draw of signs gives, over all places.
    tried : int
        Numbers of cycles of all places.
    """

    candidates: list
    columns: list
    chance: np.ndarray
    tried: int = 0


def ripples(table, noise, draws, rng, first=0):
    """Search every place of the effects with a number of cycles.

    Parameters
    ----------
    table : Table
        Of the fitted model; its scans are the effects with a number of cycles.
    noise : list of Noise
        One a channel.
    draws : int
        Sets of signs, one for each stretch of the log, by which chance is judged.
    rng : numpy.random.Generator
        Draws the signs.
    first : int
        Number of the first column made here.

    Returns
    -------
    Ripples
    """
    found = Ripples([], [], np.zeros(draws))
    if not table.scans:
        return found
    scores = _Scores.of(table, noise)
    signs = rng.choice(np.array([-1.0, 1.0], dtype=np.float32), (draws, scores.stretches))
    for effect, place in table.scans:
        contribution = table.contribution(effect)
        cycles = _cycles(table, contribution, place)
        if not len(cycles):
            continue
        found.tried += len(cycles)
        surprise, chance, agreeing = _scan(table, scores, contribution, place, cycles, signs)
        found.chance = np.maximum(found.chance, chance)
        for peak in _peaks(cycles, surprise):
            _add(table, found, contribution, place, peak, first, scores.runs, agreeing)
    return found


@dataclass
class _Scores:
    """Derivative of half the whitened squares by what is added to each channel, and what the base takes of it.

    Attributes
    ----------
    drives : list of ndarray, shape (n,)
        One a channel.
    base : list of list of ndarray, shape (n,)
        The same of each free parameter's derivative instead of the residual.
    absorbed : ndarray, shape (p, stretches)
        What each stretch moves the free parameters by.
    stretch : ndarray of int, shape (n,)
        Stretch of each sample.
    runs : list of ndarray of int
        Stretches of each run.
    """

    drives: list
    base: list
    absorbed: np.ndarray
    stretch: np.ndarray
    runs: list

    @property
    def stretches(self):
        """Number of stretches."""
        return self.absorbed.shape[1]

    @classmethod
    def of(cls, table, noise):
        """Scores of a table's residual."""
        p, chain = len(table.fit.free), table.chain
        white = [own.whiten(np.concatenate([slope, residual[None]]), chain)
                 for slope, residual, own in zip(table.slope, table.residual, noise)]
        gram = sum(w @ w.T for w in white)
        inverse = least_squares.invert(gram[:p, :p])[0]
        step = inverse @ gram[:p, -1]
        drives = [own.whiten_transposed(w[-1] - step @ w[:p], chain) for w, own in zip(white, noise)]
        base = [[own.whiten_transposed(w[k], chain) for w, own in zip(white, noise)] for k in range(p)]
        stretch = _stretches(contiguous(table.time, table.group), len(table.time))
        count = stretch.max() + 1
        sums = [np.bincount(stretch, sum(s[k] * d for s, d in zip(table.slope, drives)), count) for k in range(p)]
        of_run = table.run[np.unique(stretch, return_index=True)[1]]
        runs = [np.flatnonzero(of_run == k) for k in np.unique(of_run)]
        return cls(drives, base, inverse @ np.reshape(sums, (p, count)), stretch, runs)


def _stretches(pieces, n):
    """Number of a short stretch for every sample, about ``STRETCHES`` of them, none across two pieces."""
    length = max(1, n // STRETCHES)
    label, k = np.empty(n, dtype=int), 0
    for s in pieces:
        count = max(1, (s.stop - s.start) // length)
        label[s] = k + np.arange(s.stop - s.start) * count // (s.stop - s.start)
        k += count
    return label


def _angles(table, contribution, place):
    """Angle of each component of a place at the samples of each term."""
    return {c: [table.port_signals(contribution.effect, c, k)["flange.phi"] for k in range(len(table.takes))]
            for c in place.components}


def _periodic(effect):
    """Names of the coefficients that are a number of cycles and a phase."""
    kinds = {kind: c for c, kind in effect.scan.items()}
    return kinds["cycles"], kinds["quadrature"]


def _cycles(table, contribution, place):
    """Numbers of cycles to try: from the fewest that a travel shows to two samples each on the slow part of the way."""
    angles = [a for of_terms in _angles(table, contribution, place).values() for a in of_terms]
    travel = max(np.ptp(a) for a in angles)
    steps = np.concatenate([np.abs(np.diff(a[s])) for a in angles for s in contiguous(table.time, table.group)])
    steps = np.sort(steps[steps > 0])
    if travel == 0 or not len(steps):
        return np.zeros(0)
    way = np.cumsum(steps)
    slow = steps[np.searchsorted(way, SLOW * way[-1])]
    allowed = table.described(contribution)[_periodic(contribution.effect)[0]]
    low, high = fewest_cycles(allowed, travel), min(np.pi / slow, allowed.max)
    step = STEP * 2 * np.pi / travel
    return low + step * np.arange(min(max(int((high - low) / step) + 1, 0), MOST))


def _scan(table, scores, contribution, place, cycles, signs):
    """Surprise of every number of cycles, the largest that each draw of signs gives, and how many sums may agree.

    An encoder may count from somewhere else after each start, and the phase is another in each run then: the more
    surprising of both counts, one phase for all runs or one in each, in what is found and in the draws.

    What the base model's parameters would take over of a stretch is subtracted from it: the residual of a fit lacks
    that too, and flipped stretches shall vary as that residual does.
    """
    angles = _angles(table, contribution, place)
    drive = _Fourier.of(table, angles, [scores.drives], scores.stretch)
    shared = _Fourier.of(table, angles, scores.base, np.zeros_like(scores.stretch)) if scores.base else None
    families = [[np.arange(scores.stretches)], *([scores.runs] if len(scores.runs) > 1 else [])]
    values, largest = [[] for _ in families], np.zeros((len(families), len(signs)), dtype=np.float32)
    share = np.zeros(scores.stretches)
    for k in range(0, len(cycles), _CHUNK):
        some = cycles[k:k + _CHUNK]
        sums = drive(some)[:, 0]
        raw = (np.abs(sums) ** 2).sum(0)
        if shared:
            sums -= scores.absorbed.T @ shared(some)[0]
        sums[:, (np.abs(sums) ** 2).sum(0) <= ABSORBED * raw] = 0.0
        power = np.abs(sums) ** 2
        share += (power / np.maximum(power.sum(0), 1e-300)).sum(1)
        for told, most, family in zip(values, largest, families):
            parts = [(r, _uncorrelated(sums[r])) for r in family]
            told.append(sum(v.sum(0) ** 2 for _, both in parts for v in both))
            np.maximum(most, sum((signs[:, r] @ v) ** 2 for r, both in parts for v in both).max(axis=1), out=most)
    agreeing = 2 * share.sum() ** 2 / max((share ** 2).sum(), 1e-300)  # a sine and a cosine each
    return *(np.max([_surprise(f(v), len(family)) for v, family in zip(which, families)], axis=0)
             for f, which in ((np.concatenate, values), (np.asarray, largest))), agreeing


def _surprise(value, runs):
    """Minus logarithm of the single p-value of a statistic with a sine and a cosine in each of so many runs."""
    return value / 2 if runs == 1 else -np.log(gammaincc(runs, value / 2) + 1e-320)


def _uncorrelated(sums):
    """Sine and cosine sums of stretches, turned and scaled so that their flipped totals have the unit as covariance."""
    sine, cosine = sums.imag, sums.real
    size = np.maximum((sine ** 2).sum(0), 1e-300)
    cosine = cosine - (sine * cosine).sum(0) / size * sine
    left = np.maximum((cosine ** 2).sum(0), 1e-12 * size)
    return (sine / np.sqrt(size)).astype(np.float32), (cosine / np.sqrt(left)).astype(np.float32)


@dataclass
class _Fourier:
    """Sums of strengths times a complex exponential of an angle, one a stretch, at even numbers of cycles."""

    angle: np.ndarray
    strength: np.ndarray
    edges: np.ndarray

    @classmethod
    def of(cls, table, angles, every, stretch):
        """Scores of a torque at each sample of all components and terms, in the order of their stretches."""
        turned, strength = [], []
        for component, of_terms in angles.items():
            probe = table.probes.index(f"probe_{component}.dtau")
            for angle, response in zip(of_terms, table.responses):
                turned.append(angle)
                strength.append([sum(response[c, probe] * d for c, d in enumerate(drives)) for drives in every])
        label = np.tile(stretch, len(turned))
        order = np.argsort(label, kind="stable")
        angle = np.concatenate(turned)[order]
        return cls(angle - (angle.min() + angle.max()) / 2, np.concatenate(strength, axis=1)[:, order],
                   np.searchsorted(label[order], np.arange(stretch.max() + 2)))

    def __call__(self, cycles):
        """Sums, shape (stretches, strengths, cycles)."""
        count = len(cycles)
        strength = self.strength * np.exp(1j * cycles[count // 2] * self.angle)  # modes count from the middle
        turned = self.angle * (cycles[1] - cycles[0] if count > 1 else 0.0)
        plan = finufft.Plan(1, (count,), len(strength), _ACCURACY, 1, nthreads=1)
        found = np.empty((len(self.edges) - 1, len(strength), count), dtype=complex)
        for sums, a, b in zip(found, self.edges[:-1], self.edges[1:]):
            plan.setpts(turned[a:b])
            sums[:] = plan.execute(np.ascontiguousarray(strength[:, a:b])).reshape(sums.shape)
        return found


def _peaks(cycles, surprise):
    """Numbers of cycles of the highest peaks, more than one cycle over the travel apart."""
    found = []
    for k in np.argsort(-surprise):
        if all(abs(cycles[k] - n) * STEP > cycles[1] - cycles[0] for n in found):
            found.append(float(cycles[k]))
        if len(found) == PEAKS or len(cycles) < 2:
            break
    return found


def _add(table, found, contribution, place, cycles, first, runs, agreeing):
    """Candidates of a ripple: with its two columns, and with two in each run."""
    frequency, quadrature = _periodic(contribution.effect)
    columns = [sum(table.column(contribution, c, {frequency: cycles, quadrature: phase})[0] for c in place.components)
               for phase in (0.0, np.pi / 2)]
    bound = table.described(contribution)[contribution.coefficients[0]].max
    numbers = np.unique(table.run)
    apart = [c * (table.run == k) for k in numbers for c in columns]
    labels = [table.dataset.parameters.labels[k] for k in numbers]
    for parts, own in [(columns, []), *([(apart, labels)] if len(runs) > 1 else [])]:
        start, many = first + len(found.columns), len(parts)
        found.columns += parts
        found.candidates.append(Candidate(
            contribution.effect, place, {frequency: cycles, quadrature: 0.0}, [[start + k] for k in range(many)],
            [contribution.coefficients[0]], np.full(many, -bound), np.full(many, bound),
            {"scanned": True, "phase": quadrature, "runs": own, "agreeing": agreeing}))

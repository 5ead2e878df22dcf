"""A table of candidates in; score tests, expected coefficients and family-wise p-values out.

Score tests of every candidate on the pre-whitened residual of one fit give a ranking, the expected coefficient and the
predicted error. Family-wise p-values come from simulated noise with the candidates' own correlations, grids included.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from ..data.noise import Noise, fit_noise, likelier
from ..fit import least_squares
from ..fit.bounded import bounded
from .cycles import ripples

LEVEL = 0.01
DRAWS = 1999
SEEN = 4.0  # standard errors that the largest size of an effect must exceed for the log to say anything of it
SHADOW = 1e-4  # of a column, that must be left beside another for it to be more than its shadow
ROUNDINGS = 40
"""Times that what was measured is rounded anew: the spread of a score is then known to about a tenth."""
PRESSED = 12.0
"""Fall of the squared error, over the noise's variance, that a parameter at a bound must bring beyond it to count as
held back by it, and to absorb nothing of a candidate: chance alone brings as much once in 1900 (chi-squared, one
degree of freedom)."""


@dataclass
class Score:
    """Test of one candidate: statistic, minus log of its single p-value, coefficients, and whether it can be seen.

    What chance makes of a scan over thousands of numbers of cycles is drawn from the stretches of the log, and gets no
    larger than all of them agreeing makes it. ``drawn`` is the surprise in that count.
    """

    candidate: object
    value: float = 0.0
    surprise: float = 0.0
    coefficients: np.ndarray | None = None
    visible: bool = False
    spread: np.ndarray | None = None
    drawn: float = 0.0

    @property
    def scanned(self):
        """Whether it is one of thousands of numbers of cycles."""
        return bool(self.candidate and self.candidate.extra.get("scanned"))

    @property
    def limit(self):
        """How many sums of stretches a draw of chance turns; infinite where none are drawn."""
        return self.candidate.extra.get("agreeing", np.inf)


class Scores:
    """Score tests of all candidates of a table.

    Parameters
    ----------
    table : Table
        Of the fitted model.
    seed : int
        Of the simulated residuals.
    draws : int
        Simulated residuals for the family-wise p-values.

    References
    ----------
    .. [1] Rao, C. R. (1948). Large sample tests of statistical hypotheses concerning several parameters with
           applications to problems of estimation. Mathematical Proceedings of the Cambridge Philosophical Society
           44(1).
    .. [2] Westfall, P. H. and Young, S. S. (1993). Resampling-Based Multiple Testing. Wiley.
    """

    def __init__(self, table, seed=0, draws=DRAWS):
        self.table, self.rng, self.draws = table, np.random.default_rng(seed), draws
        self.p = len(table.fit.free)
        self.weights, self.few = table.fit.weights, max(1, len(table.time) // 5000)
        self.candidates, self.columns, self.thin = list(table.candidates), list(table.columns), []
        if not self._noise():
            self._noise_beside_ripple()
        self._roundings()
        self._search_ripples()
        self._whiten()
        self._test()
        self._refine()

    def _search_ripples(self):
        """Candidates with a number of cycles: the best of a fine scan, as ordinary columns."""
        found = ripples(self.table, self.noise, self.draws, self.rng, len(self.columns))
        self.candidates += found.candidates
        self.columns += found.columns
        self.scan_draws = found.chance

    # ---- noise of what the best mixture of candidates leaves

    def _thin_moments(self):
        """Moments of the rows of each channel, on enough samples to choose and to predict by.

        Rows: derivative, candidate columns, residual. Those of columns that came after the last time are added.
        """
        few, t = slice(None, None, self.few), self.table
        known = len(self.thin[0]) - 1 - self.p if self.thin else 0
        old = [*range(self.p + known), self.p + len(self.columns)] if self.thin else []
        new = {*range(self.p + len(self.columns) + 1)} - {*old}
        found = []
        for c in range(len(self.weights)):
            rows = [*t.slope[c][:, few], *[v[c, few] for v in self.columns], t.residual[c, few]]
            live = [k for k, row in enumerate(rows) if row.any()]  # most candidates change few channels
            values, fresh = np.array([rows[k] for k in live]), [i for i, k in enumerate(live) if k in new]
            found.append(np.zeros((len(rows), len(rows))))
            if old:
                found[-1][np.ix_(old, old)] = self.thin[c]
            own = values @ values.T if len(fresh) == len(live) else values[fresh] @ values.T
            found[-1][np.ix_([live[i] for i in fresh], live)] = own
            found[-1][np.ix_(live, [live[i] for i in fresh])] = own.T
        self.thin = found
        return found

    def _of_all(self, moments):
        """Moments of all channels together, in the weights of the fit."""
        return sum(w ** 2 * g for w, g in zip(self.weights, moments))

    def _noise(self):
        """Noise of each channel beside the few columns that explain most: a missing effect is not noise.

        Nor is slow noise a missing effect: eight of hundreds of columns take half of it away where a log is as short
        as a few of its memories. Unless they make the samples likelier than the best of so many would by chance, the
        noise fitted anew, all is noise. One candidate is asked then as well: at several stages together it has fewer
        coefficients than the columns of these stages, and stands out where they do not. Returns whether it is the noise
        beside any.
        """
        gram = self._of_all(self._thin_moments())
        base, *more = self._path(gram, 0.02)
        self._noise_of(base)
        best = None
        if any(self._beyond_chance(*self._used(beta)) for beta in more):
            best = more[-1]
        elif more:
            alone, parts = self._alone(gram)
            best = alone if self._beyond_chance(parts, len(self.candidates)) else None
        if best is not None:
            self._noise_of(best)
        return best is not None

    def _noise_beside_ripple(self):
        """The noise beside a ripple, where nothing else is missing and that is as slow as noise.

        A few cycles over the travel, in a slow motion, are slow noise to whoever does not ask for them, and whitening
        takes them away: half of the squared error of an axis of 0.2 m was, with 0.97 as the chance of its ripple.
        """
        if not self.table.scans or all(n.slow <= n.white for n in self.noise):
            return
        candidates, columns, thin = self.candidates, self.columns, self.thin
        fast = [Noise(np.hypot(n.white, n.slow)) for n in self.noise]
        found = ripples(self.table, fast, 1, np.random.default_rng(0), len(columns))
        self.candidates, self.columns = found.candidates, [*columns, *found.columns]
        beta, parts = self._alone(self._of_all(self._thin_moments()))
        if parts and self._beyond_chance(parts, found.tried):
            self._noise_of(beta)
        self.candidates, self.columns, self.thin = candidates, columns, thin

    def _noise_of(self, beta):
        """Noise of what a combination of rows leaves."""
        slopes = [w * s for w, s in zip(self.weights, self.table.slope)]
        root = least_squares.orthonormal(least_squares.invert(sum(s @ s.T for s in slopes))[0])
        self.noise = [fit_noise(r, self.table.chain, root @ s) for r, s in zip(self._left_by(beta), slopes)]

    def _used(self, beta):
        """Columns of a combination, and among how many others of as many it was chosen."""
        used = [[k - self.p] for k in np.flatnonzero(beta) if k >= self.p]
        return used, len(self.columns) ** len(used)

    def _alone(self, gram):
        """The candidate that takes most by itself: coefficients of all rows on the residual, and its columns."""
        p, beta, most, parts, values = self.p, np.zeros(len(gram) - 1), 0.0, [], []
        given, (inverse, _) = np.arange(p), least_squares.invert(gram[:p, :p])
        for candidate in self.candidates:
            groups = [p + np.array(part) for part in candidate.parts]
            inner, moved = self._beside(groups, given, inverse, gram)
            if np.min(np.diag(inner) / np.maximum(np.diag(summed(gram, groups)), 1e-300)) < SHADOW:
                continue
            own = np.linalg.lstsq(inner, moved, rcond=1e-9)[0]
            if moved @ own > most:
                most, parts, values = moved @ own, candidate.parts, own
        for value, part in zip(values, parts):
            beta[p + np.array(part)] += value
        beta[:p] = inverse @ (gram[:p, -1] - gram[:p, p:-1] @ beta[p:])
        return beta, parts

    def _beyond_chance(self, parts, choices):
        """Whether columns, each the sum of a part, make the samples likelier than the best of all does by chance.

        Where few independent values tell the noise, the base and the columns leave fewer, and chance gains more: as in
        the ratio of variances, not in that to a known one.
        """
        gain, told, known = 0.0, 0, -float(self.p)
        for c, residual in enumerate(self.table.residual):
            columns = np.array([row for part in parts if (row := sum(self.columns[k][c] for k in part)).any()])
            if len(columns):
                gain += likelier(residual, self.table.chain, self.table.slope[c], columns)
                told += len(columns)
                known += self.noise[c].freedom(self.table.chain)
        if not told:
            return False
        left = max(known - told, 1.0)  # one over the share that is left at a chance of F, however small that is
        return gain > -0.5 * (known + self.p) * np.log(special.betaincinv(0.5 * left, 0.5 * told, LEVEL / choices))

    def _left_by(self, beta):
        """Residual of each channel that a combination of rows leaves."""
        used, t = np.flatnonzero(beta), self.table
        return [t.residual[c] - sum(beta[k] * (t.slope[c][k] if k < self.p else self.columns[k - self.p][c])
                                    for k in used) for c in range(len(self.weights))]

    @property
    def single(self):
        """Noise of single samples of the log, a channel."""
        return [n.single(self.table.width) for n in self.noise]

    def _path(self, gram, share, most=8):
        """Greedy choice of columns; yields the coefficients of all rows on the residual, a column more each time."""
        k = len(gram) - 1
        chosen = list(range(self.p))
        for _ in range(most + 1):
            a = gram[np.ix_(chosen, chosen)]
            inverse, _ = least_squares.invert(a)
            solution = inverse @ gram[chosen, -1]
            rss = gram[-1, -1] - gram[chosen, -1] @ solution
            beta = np.zeros(k)
            beta[chosen] = solution
            yield beta
            cross = gram[:k, chosen] @ inverse
            score = gram[:k, -1] - cross @ gram[chosen, -1]
            size = np.diag(gram)[:k] - np.einsum("ij,ij->i", cross, gram[:k, chosen])
            usable = size > 1e-6 * np.diag(gram)[:k]
            usable[chosen] = False
            fall = np.where(usable, score ** 2 / np.where(usable, size, 1), 0)
            best = int(np.argmax(fall)) if k else 0
            if not k or fall[best] < share * rss or len(chosen) - self.p >= min(most, gram.shape[0]):
                return
            if len(chosen) + 3 > 0.3 * self.table.residual.size:
                return
            chosen.append(best)

    def _roundings(self):
        """What rounding may leave, whitened like the residual; and the moments of all rows with it."""
        drawn = self.table.roundings(ROUNDINGS, int(self.rng.integers(2 ** 32)))
        self.rounded = [noise.whiten(drawn[:, c], self.table.chain) for c, noise in enumerate(self.noise)]
        self.beside_rounding = np.zeros((0, len(drawn)))

    def _whiten(self):
        """Moments of the whitened columns; the residual's spread fixes their scale."""
        t = self.table
        self.together = self._of_all(self._thin_moments())
        grams, self.frame = np.zeros((len(self.noise), *self.thin[0].shape)), []
        self.beside_rounding = np.zeros((len(self.together) - 1, len(self.rounded[0])))
        for c, noise in enumerate(self.noise):
            rows = [*t.slope[c], *[v[c] for v in self.columns], t.residual[c]]
            live = [k for k, row in enumerate(rows) if row.any()]
            white = noise.whiten(np.array([rows[k] for k in live]), t.chain)
            grams[c][np.ix_(live, live)] = white @ white.T
            self.beside_rounding[live[:-1]] += white[:-1] @ self.rounded[c].T
            self.frame.append(np.zeros((self.p + 1, len(t.time))))
            own = [i for i, k in enumerate(live) if k < self.p or k == len(rows) - 1]
            self.frame[-1][[min(live[i], self.p) for i in own]] = white[own]
        self.gram, self.samples = grams.sum(0), t.residual.size
        *_, beta = self._path(self.gram, 12.0 / self.samples)
        used = np.count_nonzero(beta)
        # what means tell holds for what is slow, however little single samples scatter about it
        each = self.samples / len(grams)
        left = [max(np.r_[-beta, 1.0] @ g @ np.r_[-beta, 1.0], each if n.coarse else 0.0)
                for g, n in zip(grams, self.noise)]
        self.variance = max(sum(left) / max(self.samples - used, 1), 1e-300)
        # slow noise is known from as many independent stretches as the log holds, not from its samples
        self.independent = min(self.samples, sum(n.independent(t.chain) for n in self.noise))
        self.used = used

    # ---- what a candidate predicts

    def predicted(self, candidate, coefficients):
        """Error of each channel after adding a candidate, with the base refitted within its bounds.

        The table may hold means of samples: what they lose is taken from the error of the samples.

        Parameters
        ----------
        candidate : Candidate
            One of the table's.
        coefficients : ndarray, shape (coefficients,), or None
            Expected coefficients; None adds nothing.

        Returns
        -------
        dict of str to float
            In the channel's unit.
        """
        left = self._mean_squares(candidate, () if coefficients is None else coefficients)
        error = self.table.fit.error
        return {c: float(np.sqrt(max(error[c] ** 2 - (before - after), 0.0)))
                for c, before, after in zip(self.table.channels, self._mean_squares(candidate, ()), left)}

    def _mean_squares(self, candidate, coefficients):
        """Mean square of each channel of the table, with a candidate's coefficients."""
        p = self.p
        y = np.zeros(len(self.gram))
        y[-1] = 1.0
        for b, part in zip(coefficients, candidate.parts):
            y[p + np.array(part)] -= b
        if p:
            y[:p] = -bounded(self.together[:p, :p], self.together[:p] @ y, *self._bounds())[1]
        samples = len(range(0, len(self.table.time), self.few))
        return [max(y @ g @ y, 0.0) / samples for g in self.thin]

    def weight(self, candidate, size):
        """What a size of a candidate's first coefficient adds to the error, beside what the base absorbs of it.

        Parameters
        ----------
        candidate : Candidate
            One of the table's.
        size : float
            Of the coefficient, in its unit.

        Returns
        -------
        float
            As a part of the error of all channels together.
        """
        total, base = self.together, np.arange(self.p)
        rows = self.p + np.array(candidate.parts[0])
        cross = total[np.ix_(base, rows)].sum(1)
        own = total[np.ix_(rows, rows)].sum() - cross @ least_squares.invert(total[:self.p, :self.p])[0] @ cross
        return float(size * np.sqrt(max(own, 0.0) / max(total[-1, -1], 1e-300)))

    # ---- tests

    def _test(self):
        """Statistic, single and family-wise p-value of every candidate."""
        p, gram, base = self.p, self.gram, self._yielding()
        inverse, _ = least_squares.invert(gram[np.ix_(base, base)])
        cross = gram[p:-1, base] @ inverse
        schur = gram[p:-1, p:-1] - cross @ gram[base, p:-1]
        size = np.sqrt(np.maximum(np.diag(gram)[p:-1], 1e-300))  # columns of any unit, each to its own rounding
        values, vectors = np.linalg.eigh((schur + schur.T) / (2 * np.outer(size, size)))
        root = size[:, None] * vectors * np.sqrt(np.maximum(values, 0))
        noise = self.rng.standard_normal((self.draws, len(schur))) @ root.T
        self._absorb, self._inflations = (base, inverse), {}
        rounded = self._rounded(slice(p, None), cross)
        if rounded.shape[1]:
            noise += (rounded * self.rng.choice([-1.0, 1.0], rounded.shape[1]))[:, self.rng.integers(
                rounded.shape[1], size=self.draws)].T
        self.results, extremes = [], {}
        for candidate in self.candidates:
            inner, d = summed(schur, candidate.parts), len(candidate.parts)
            if not self._visible(candidate, inner, summed(gram[p:-1, p:-1], candidate.parts)):
                self.results.append(Score(candidate))
                continue
            sided = d == 1 and (candidate.lower[0] == 0 or candidate.upper[0] == 0)
            coarse = np.array([rounded[part].sum(0) for part in candidate.parts])
            inner = inner + coarse @ coarse.T / max(coarse.shape[1], 1)
            value, coefficients = self.fall(candidate)
            surprise = float(self._surprise(value, d, sided, self._dof(candidate)))
            drawn = self._drawn(candidate, value, surprise)
            spread = np.sqrt(self.variance * self._inflation(candidate) * np.diag(np.linalg.inv(inner)))
            self.results.append(Score(candidate, value, surprise, coefficients, True, spread, drawn))
            if not candidate.extra.get("scanned"):
                z = np.array([noise[:, part].sum(1) for part in candidate.parts]).T
                chance = np.einsum("bi,ij,bj->b", z, np.linalg.inv(inner), z)
                if sided:
                    sign = 1 if candidate.lower[0] == 0 else -1
                    chance = np.where(sign * z[:, 0] > 0, chance, 0.0)
                extremes[d, sided] = np.maximum(extremes.get((d, sided), 0.0), chance)
        surprises = [-self._log_chi2(chance, *kind) for kind, chance in extremes.items()]
        self.largest = {False: np.sort(np.max(surprises, axis=0)) if surprises else np.zeros(0),
                        True: np.sort(self.scan_draws) if self.table.scans else np.zeros(0)}

    # ---- between the points of a grid

    def _refine(self):
        """Scores between the grid points about the best of each likely candidate: a better size, the same p-value."""
        best = {}
        for score in self.results:
            if score.visible and score.value > best.get(score.candidate.key, Score(None)).value:
                best[score.candidate.key] = score
        likely = [s for s in best.values() if self.family(s.drawn, s.scanned) < 10 * LEVEL]
        self.refined, new = {s.candidate.key: s for s in likely}, []
        for score in likely:
            for grid in self._between(score.candidate):
                new.append(self._candidate_at(score.candidate, grid))
        self._extend()
        for candidate in new:
            value, coefficients = self.fall(candidate)
            if value > self.refined[candidate.key].value:
                self.refined[candidate.key] = Score(candidate, value, 0.0, coefficients, True)

    def _between(self, candidate):
        """Grids a third and two thirds of the way to the neighbours of a grid point, one coefficient at a time."""
        values = self.table.scan_values(candidate.place.components[0])
        for name, here in candidate.grid.items():
            points = values.get(candidate.effect.scan.get(name))
            if points is None or candidate.effect.scan[name] == "quadrature":
                continue
            k = int(np.argmin(np.abs(points - here)))
            for other in {points[max(k - 1, 0)], points[min(k + 1, len(points) - 1)]} - {points[k]}:
                for part in (1 / 3, 2 / 3):
                    even = here + part * (other - here)
                    yield {**candidate.grid, name: here * (other / here) ** part if points[0] > 0 else even}

    def _candidate_at(self, candidate, grid):
        """A candidate at another grid point, with columns of its own."""
        t, contribution = self.table, self.table.contribution(candidate.effect)
        columns = [t.column(contribution, c, grid, candidate.place.partner(candidate.effect, c))
                   for c in candidate.place.components]
        start = len(self.columns)
        self.columns += [sum(c[k] for c in columns) for k in range(len(contribution.coefficients))]
        return replace(candidate, grid=grid, parts=[[start + k] for k in range(len(contribution.coefficients))])

    def _extend(self):
        """Moments of columns that came after the others, with the base and the residual."""
        known, few = len(self.gram) - 1 - self.p, slice(None, None, self.few)
        if len(self.columns) == known:
            return
        new = np.array(self.columns[known:])
        parts = []
        for c, noise in enumerate(self.noise):
            white = noise.whiten(new[:, c], self.table.chain)
            raw = np.concatenate([self.table.slope[c], self.table.residual[c][None]])[:, few]
            self._remember_rounding(c, known, white)
            parts.append((white @ white.T, self.frame[c] @ white.T, new[:, c, few] @ new[:, c, few].T,
                          raw @ new[:, c, few].T))
        self.gram = _grown(self.gram, sum(p[0] for p in parts), sum(p[1] for p in parts), self.p)
        self.thin = [_grown(g, p[2], p[3], self.p) for g, p in zip(self.thin, parts)]
        self.together = self._of_all(self.thin)

    def _remember_rounding(self, channel, known, white):
        """Moments of rounding with columns that came after the others."""
        first = self.p + known
        if len(self.beside_rounding) == first:
            self.beside_rounding = np.concatenate([self.beside_rounding, np.zeros((len(white), len(self.rounded[0])))])
        self.beside_rounding[first:] += white @ self.rounded[channel].T

    def _yielding(self):
        """Base parameters that can absorb a candidate: not those that the data press against a bound.

        One that is at its bound by chance yields; pressed is what would lower the whitened squares by many variances.
        """
        p, (low, high) = self.p, self._bounds()
        a, b = self.gram[:p, :p], self.gram[:p, -1]
        fitted, x = bounded(a, b, low, high)
        near = 1e-5 * np.array([self.table.fit.variables[n].nominal for n in self.table.fit.free])
        found = []
        for k in range(p):
            lifted = [np.where(np.arange(p) == k, end, v) for end, v in ((-np.inf, low), (np.inf, high))]
            at_bound = x[k] - low[k] < near[k] or high[k] - x[k] < near[k]
            if not at_bound or bounded(a, b, *lifted)[0] - fitted < PRESSED * self.variance:
                found.append(k)
        return found

    def _visible(self, candidate, inner, full):
        """Whether a size within reason would stand out of the noise, beside what the base model absorbs."""
        diagonal = np.diag(inner)
        # half differences scale with torques and losses together: what is left of such a column is the residual itself
        least = 5e-3 if self.table.dataset.paired else 1e-6
        if np.min(diagonal / np.maximum(np.diag(full), 1e-300)) < least or np.linalg.cond(inner) > 1e12:
            return False
        if candidate.names[0] in candidate.effect.scan:
            return True
        largest = np.maximum(np.abs(candidate.lower), np.abs(candidate.upper))
        return bool((SEEN * np.sqrt(self.variance / diagonal) < largest).any())

    def _dof(self, candidate):
        """Degrees of freedom that the noise beside a candidate is known with.

        Slow noise limits what a slow column tells, and nothing of a fast one: of each column that part of its energy
        counts with all samples which whitening leaves.
        """
        rows = self.p + np.array(candidate.parts).ravel()
        plain = sum(np.diag(g)[rows].sum() / n.white ** 2 for g, n in zip(self.thin, self.noise)) * self.few
        fast = min(float(np.diag(self.gram)[rows].sum() / max(plain, 1e-300)), 1.0)
        return max(self.independent + fast * (self.samples - self.independent) - self.used, 1.0)

    def _surprise(self, value, d, sided, dof):
        """Minus log of the single p-value of a statistic with d coefficients, for the noise's degrees of freedom."""
        if dof > 1000:
            return -self._log_chi2(value, d, sided)
        log = np.log(special.fdtrc(d, dof, np.asarray(value) / d) + 1e-320)
        return -(log + (np.log(0.5) if sided else 0.0)) * (np.asarray(value) > 0)

    def _drawn(self, candidate, value, surprise):
        """Surprise of a statistic T as the draws of chance count it.

        Stretches tell the variance of their sum as well, an effect's part in it with the rest: the draws of a scan show
        T / (1 + T / limit), to 2 % where all sums are independent numbers. Counted without that, the largest of
        thousands was below 0.05 in one sound log of seven. Where the noise is known with few degrees of freedom, T has
        been lessened for that as much.
        """
        limit = Score(candidate).limit
        if not np.isfinite(limit):
            return surprise
        return min(surprise, float(-self._log_chi2(value / (1.0 + value / limit), len(candidate.parts), False)))

    @staticmethod
    def _log_chi2(value, d, sided):
        value = np.asarray(value, dtype=float)
        log = (np.log(2) + special.log_ndtr(-np.sqrt(value)) if d == 1
               else np.log(special.gammaincc(d / 2, value / 2) + 1e-320))
        return (log + (np.log(0.5) if sided else 0.0)) * (value > 0)

    def _rounded(self, rows, cross):
        """Scores of columns with what rounding may leave, beside what the base absorbs, in standard deviations."""
        base, _ = self._absorb
        return (self.beside_rounding[rows] - cross @ self.beside_rounding[base]) / np.sqrt(self.variance)

    def _inflation(self, candidate):
        """Variance of a candidate's score with rounding counted, over the variance that noise alone gives it."""
        if not len(self.rounded[0]):
            return 1.0
        key = tuple(map(tuple, candidate.parts))
        if key not in self._inflations:
            self._inflations[key] = self._inflated(candidate)
        return self._inflations[key]

    def _inflated(self, candidate):
        base, inverse = self._absorb
        columns = [self.p + np.array(part) for part in candidate.parts]
        cross = np.array([self.gram[np.ix_(c, base)].sum(0) for c in columns]) @ inverse
        own, _ = self._beside(columns, base, inverse)
        coarse = np.array([self.beside_rounding[c].sum(0) for c in columns]) - cross @ self.beside_rounding[base]
        added = coarse @ coarse.T / (coarse.shape[1] * self.variance)
        return 1.0 + float(np.max(np.linalg.eigvals(np.linalg.lstsq(own, added, rcond=1e-12)[0]).real, initial=0.0))

    def fall(self, *candidates):
        """What candidates take together, with the base and all of them inside their bounds.

        Parameters
        ----------
        *candidates : Candidate
            Of the table's, at grid points of their own.

        Returns
        -------
        value : float
            Fall of the whitened sum of squares, over its variance.
        coefficients : ndarray
            Of the candidates, one after the other.
        """
        groups = [*[[k] for k in range(self.p)], *[self.p + np.array(part) for c in candidates for part in c.parts]]
        a, b = summed(self.gram, groups), np.array([self.gram[-1][g].sum() for g in groups])
        if not hasattr(self, "_without"):
            self._without = bounded(a[:self.p, :self.p], b[:self.p], *self._bounds())
        without, near = self._without
        with_them, x = bounded(a, b, *self._bounds(*candidates), np.append(near, np.full(len(b) - self.p, np.nan)))
        fall = max(0.0, (with_them - without) / self.variance)
        return fall / max(self._inflation(c) for c in candidates), x[self.p:]

    def _bounds(self, *candidates):
        fit = self.table.fit
        low = np.array([fit.variables[n].min for n in fit.free]) - fit.values
        high = np.array([fit.variables[n].max for n in fit.free]) - fit.values
        return np.concatenate([low, *(c.lower for c in candidates)]), np.concatenate(
            [high, *(c.upper for c in candidates)])

    def beside_base(self, candidates):
        """What candidates change beside what the base absorbs of it, and how that goes with the residual.

        Parameters
        ----------
        candidates : list of Candidate
            Of the table's.

        Returns
        -------
        moments : ndarray, shape (coefficients, coefficients)
            Of the whitened columns, all coefficients of all candidates.
        moved : ndarray, shape (coefficients,)
            With the residual, in the same unit.
        """
        return self._beside([self.p + np.array(part) for c in candidates for part in c.parts], *self._absorb)

    def lacking(self, sizes):
        """The same scores as if an effect of the model were not in it: what it does is in the residual.

        Parameters
        ----------
        sizes : dict of str to float
            By free parameter of the effect, how far it is from where the effect changes nothing; no distance for those
            that vanish with it.

        Returns
        -------
        Scores
            For `fall`, `beside_base` and what can be seen alone: they were tested beside the effect.
        """
        names, turn, less = self.table.fit.free, np.eye(len(self.gram)), copy.copy(self)
        own = [names.index(n) for n in sizes]
        turn[-1, own] = list(sizes.values())
        less.gram = turn @ self.gram @ turn.T
        less.gram[own], less.gram[:, own] = 0.0, 0.0
        base = [k for k in less._yielding() if k not in own]
        less._absorb, less._inflations = (base, least_squares.invert(less.gram[np.ix_(base, base)])[0]), {}
        less.__dict__.pop("_without", None)
        less.results = []
        for score in self.results:
            rows = [self.p + np.array(part) for part in score.candidate.parts]
            seen = less._visible(score.candidate, less._beside(rows, *less._absorb)[0], summed(less.gram, rows))
            less.results.append(replace(score, visible=seen))
        return less

    def left(self):
        """Least whitened sum of squares with the base inside its bounds, over the variance.

        Returns
        -------
        float
        """
        a, b = self.gram[:self.p, :self.p], self.gram[:self.p, -1]
        return float(self.gram[-1, -1] - bounded(a, b, *self._bounds())[0]) / self.variance

    def akin(self, key, least):
        """Candidates that could add what one adds, most like it first, whatever bounds leave of their own fall.

        Parameters
        ----------
        key : (str, str)
            Effect and place of that one.
        least : float
            Share of what it adds beside the base, as whitened squares, that another must be able to add.

        Returns
        -------
        list of (str, str)
            Without that one.
        """
        best = {}
        for score in self.results:
            if score.visible and score.surprise > best.get(score.candidate.key, Score(None)).surprise:
                best[score.candidate.key] = score
        if key not in best:
            return []
        one, found = best.pop(key), []
        for other in best.values():
            moments, _ = self.beside_base([one.candidate, other.candidate])
            d = len(one.candidate.parts)
            alone, cross = one.coefficients @ moments[:d, :d] @ one.coefficients, moments[d:, :d] @ one.coefficients
            share = cross @ np.linalg.lstsq(moments[d:, d:], cross, rcond=1e-9)[0] / max(alone, 1e-300)
            if share >= least:
                found.append((share, other.candidate.key))
        return [k for _, k in sorted(found, reverse=True)]

    def _beside(self, groups, given, inverse, gram=None):
        """Moments of groups of rows, and theirs with the residual, beside what given rows explain of them."""
        gram = self.gram if gram is None else gram
        cross = np.array([gram[np.ix_(g, given)].sum(0) for g in groups])
        moved = np.array([gram[g, -1].sum() for g in groups]) - cross @ (inverse @ gram[given, -1])
        return summed(gram, groups) - cross @ inverse @ cross.T, moved

    def beside(self, *keys, only=None):
        """Family-wise p-values of candidates, with some others of them in the model.

        Parameters
        ----------
        *keys : (str, str)
            Effect and place of each of those others; at all points of its grid.
        only : collection of (str, str), optional
            Whose p-values are wanted; by default, of all.

        Returns
        -------
        dict of (str, str) to float
        """
        base, p = self._absorb[0], self.p
        mine = [c for c in self.candidates if c.key in keys]
        given = [*base, *sorted({p + k for c in mine for part in c.parts for k in part})]
        inverse, _ = least_squares.invert(self.gram[np.ix_(given, given)])
        found = {}
        for score in self.results:
            candidate = score.candidate
            if not score.visible or candidate.key in keys or only is not None and candidate.key not in only:
                continue
            groups = [p + np.array(part) for part in candidate.parts]
            inner, moved = self._beside(groups, given, inverse)
            if np.min(np.diag(inner) / np.diag(summed(self.gram, groups))) < SHADOW:
                value = 0.0
            else:
                value = float(moved @ np.linalg.lstsq(inner, moved, rcond=1e-9)[0])
                value /= self.variance * self._inflation(candidate)
            sided = len(groups) == 1 and (candidate.lower[0] == 0 or candidate.upper[0] == 0)
            surprise = float(self._surprise(value, len(groups), sided, self._dof(candidate)))
            told = self.family(self._drawn(candidate, value, surprise), score.scanned)
            found[candidate.key] = min(told, found.get(candidate.key, 1.0))
        return found

    def family(self, surprise, scanned=False):
        """Family-wise p-value of a surprise.

        The thousands of numbers of cycles that a ripple is searched over are a family of their own, so that they do not
        raise the bar of everything else; the two share the level (Sidak).

        Parameters
        ----------
        surprise : float
            Minus log of a single p-value; of a ripple, as it is drawn.
        scanned : bool
            Whether it is that of a ripple.

        Returns
        -------
        float
            Chance that a log without the effect shows one as large anywhere.
        """
        largest = self.largest[scanned]
        above = len(largest) - np.searchsorted(largest, surprise, side="left")
        within = (1 + above) / (1 + len(largest))
        return float(1 - (1 - within) ** self._families)

    @property
    def _families(self):
        return sum(len(v) > 0 for v in self.largest.values()) or 1

    def threshold(self, level, scanned=False):
        """Surprise from which a family-wise p-value is below a level.

        Parameters
        ----------
        level : float
            Family-wise p-value, 0 to 1.
        scanned : bool
            Of a ripple.

        Returns
        -------
        float
        """
        within = 1 - (1 - level) ** (1 / self._families)
        return float(np.quantile(self.largest[scanned], 1 - within)) if len(self.largest[scanned]) else 0.0


def summed(matrix, groups):
    """Rows and columns of a symmetric matrix, summed group by group.

    Parameters
    ----------
    matrix : ndarray, shape (n, n)
        Moments of columns.
    groups : list of sequence of int
        Columns of each sum.

    Returns
    -------
    ndarray, shape (groups, groups)
        Moments of the sums.
    """
    picked, first = np.concatenate(groups), np.cumsum([0, *map(len, groups)])[:-1]
    rows = np.add.reduceat(matrix[picked[:, None], picked], first, axis=0)
    return np.add.reduceat(rows, first, axis=1).T


def _grown(gram, own, cross, p):
    """Moments with new rows before the last one; what old candidates share with them is not asked for."""
    n, m = len(gram) - 1, len(own)
    found = np.zeros((n + m + 1, n + m + 1))
    old, new, last = np.arange(n), n + np.arange(m), np.array([n + m])
    found[np.ix_(old, old)] = gram[:n, :n]
    found[np.ix_(old, last)], found[np.ix_(last, old)], found[-1, -1] = gram[:n, n:], gram[n:, :n], gram[n, n]
    found[np.ix_(new, new)] = own
    found[np.ix_([*range(p), n + m], new)] = cross
    found[np.ix_(new, [*range(p), n + m])] = cross.T
    return found

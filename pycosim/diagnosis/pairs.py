"""A model that lacks something in; the pairs of effects, or threes, that explain most of it together, fitted, out.

One effect after the other can miss two at once: the first that is taken may stand in for both, and beside it neither
is what is lacking. The scores of a fitted model tell of every pair what it would take, and of every three that begins
with one of the best pairs, from the moments that its members' own tests are made of.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from ..compile import compile_model, component_name, ranked
from ..core.errors import PycosimError
from ..fit import least_squares
from .crossval import gap, select
from .finding import Finding
from .rivals import SEPARATE, alike, behind, by_kind
from .scores import LEVEL, Scores
from .table import Table
from .trials import OWN, TRIAL, holds_nothing, measure, no_effect, nudged, start_of, told_from_nothing

APART = 0.02
"""Of what one effect changes, that must be left beside the other: two that are nearly one have no size of their own."""
DOUBTED = 0.05
"""Of a computed reference, that is put down to the model of the load without more ado: a mass, or where it is, is known
to some per cent. Up to a tenth, a zero 2.2 degrees off took its name from a constant torque of 2.4 times the noise."""
REFITS = 8  # pairs that are fitted
ALIKE = 3  # pairs of the same two effects, at other places, that are tried
SECONDS = 5  # effects beside a winner that a pair must be ahead of with it
BEGUN = 100  # pairs that a third effect is looked for beside


@dataclass
class Pair:
    """Two candidates that act together, or three.

    Attributes
    ----------
    candidates : tuple of Candidate
        Each at a grid point of its own.
    value : float
        What they take of the whitened squares, over the variance.
    coefficients : ndarray
        Of one after the other.
    without, model : Model
        Without and with all of them.
    lacking, fit : Fit
        Of either model.
    selection : Selection
        Of the fit with them.
    findings : list of Finding
        One of each effect.
    clear : bool
        Whether it does better than the one effect that it may be in the place of, by more than luck of so many pairs.
    doubted : bool
        Whether it does as well for a small error of the model of the load, which is one of the two.
    better : bool
        Whether it does better for a larger one, by more than the luck of the choice among such errors.
    matched : bool
        Whether that effect does as well with another.
    near : list of Pair
        Those that unseen folds cannot tell from it.
    """

    candidates: tuple
    value: float
    coefficients: np.ndarray
    without: object = None
    lacking: object = None
    model: object = None
    fit: object = None
    selection: object = None
    findings: list = field(default_factory=list)
    clear: bool = False
    doubted: bool = False
    better: bool = False
    matched: bool = False
    near: list = field(default_factory=list, repr=False, compare=False)

    @property
    def keys(self):
        """Effect and place of each."""
        return tuple(c.key for c in self.candidates)

    @property
    def common(self):
        """Of its effects, those that all have that unseen folds cannot tell from it."""
        return {*self.keys}.intersection(*(p.keys for p in self.near))

    @property
    def told(self):
        """Either as the diagnosis tells it: ``effect``, ``place``, and ``small`` if it is a small error of the load."""
        return [{"effect": e.id, "place": p.name} | ({"small": True} if self.doubted and e.of_load_model else {})
                for e, p in self.attached]

    @property
    def size(self):
        """Coefficients of all, those of their grids with them."""
        return sum(map(_size, self.candidates))

    @property
    def shares(self):
        """Coefficients of each."""
        return np.split(self.coefficients, np.cumsum([len(c.parts) for c in self.candidates])[:-1])

    @property
    def attached(self):
        """Effect and place of each, as the model has them."""
        return self.model.attached[-len(self.candidates):]


def fitted(dataset, without, lacking, known, progress, three=False):
    """The pairs that most may be said for in a model that lacks them, fitted; best first on unseen folds.

    Parameters
    ----------
    dataset : Dataset
        Its fit part is searched.
    without : Model
        With the effects beside which two are missing.
    lacking : Fit
        Of that model.
    known : (Table, Scores)
        Of that model and fit.
    progress : callable or None
        Called with a sentence before each fit.
    three : bool
        Whether threes come before the pairs, where one takes more than any pair by more than the luck of so many.

    Yields
    ------
    list of Pair
        Of which each effect is more than chance.
    """
    here, (table, scores) = dataset.sliding(without).settled(without, lacking.parameters), known
    alone, start = select(here, without, lacking, scores.single), Combinations(scores, REFITS)
    two = start.pairs()
    for some in [*([start.threes(two)] if three else []), two]:
        found = _refitted(here, without, lacking, lacking, some, scores.single, alone, progress)
        _tell(scores, table, alone, found)
        yield [p for p in found if _certain(here, p)]


def doubles(dataset, without, lacking, winner, noise, scores, seed, progress):
    """The pairs that do as well as one effect, fitted; best first on unseen folds.

    They are looked for where the winner is in the model: from there on the branches of friction are the right ones, and
    what each pair would do in its place is told by the moments of the fit with it. A pair may have one coefficient more
    where it takes more by what outdoes an effect; or where that is of a small error of the model of the load that the
    reference is computed with, as no such model is right to the last per cent.

    Parameters
    ----------
    dataset : Dataset
        Its fit part is searched.
    without : Model
        That lacks the winner, or the two.
    lacking : Fit
        Of that model.
    winner : Finding
        With the fit and the selection.
    noise : list of Noise
        One a channel, that rivals are compared at.
    scores : Scores
        Of the model with the winner.
    seed : int
        Of the draws of other scores.
    progress : callable or None
        Called with a sentence before each fit.

    Returns
    -------
    list of Pair
        With ``clear`` where both effects are more than chance, and do better by more than the luck of so many pairs,
        ``doubted`` or ``better`` where one is an error of the load's model and the other no alternative of the winner,
        and ``matched`` where the winner does as well with another. Without those beside which the winner does better
        with one of their two, or with another.
    """
    here = dataset.sliding(without).settled(without, lacking.parameters)
    larger = compile_model(dataset.library, without.rig, [*without.keys, winner.key])
    base = component_name(*larger.attached[-1])
    own = {n: 0.0 for n in winner.fit.free if n.startswith(f"{base}.")}
    own.update({f"{base}.{c}": winner.fit.parameters[f"{base}.{c}"] - larger.parameters[f"{base}.{c}"].value
                for c in larger.attached[-1][0].size if f"{base}.{c}" in own})
    less, luck = scores.lacking(own), _luck(len(scores.results))
    takes = less.left() - scores.left()
    least = {len(own): takes - 2.0 * SEPARATE ** 2, len(own) + 1: takes + luck + 2.0}
    some = _with_load(dataset, less, winner, Combinations(less, REFITS, max(least)).pairs(least),
                      {len(own) + 1: least[len(own)] + 2.0}, {len(own) + 2: takes + luck + 4.0})
    alone = select(here, without, lacking, noise)
    found = _refitted(here, without, winner.fit, lacking, some, noise, alone, progress)
    found = [p for p in found if _as_well(p.selection, winner.selection) and not _has_own(here, p)]
    errors = {s.candidate.key for s in scores.results if s.candidate.effect.of_load_model}
    for pair in [p for p in found if p.doubted]:
        pair.doubted = _little_of_load(here, pair)
        pair.better = _outdoes(pair, winner, _luck(2 * len(errors)))  # as many times more pairs as errors
    if clear := [p for p in found if _outdoes(p, winner, luck)]:
        table = Table(here, without, lacking)
        _tell(Scores(table, seed), table, alone, found)
        outdone = _beside_winner(here, larger, winner, [p for p in clear if _certain(here, p)], noise, scores, alone)
        found = [p for p in found if not any(p is o for o in outdone)]
    return sorted(found, key=lambda p: (not p.clear, p.selection.white.sum() + 2 * len(p.fit.free)))


def _beside_winner(here, larger, winner, clear, noise, scores, alone):
    """Say which pairs are ahead of the winner with another effect, or matched by it; the rest are returned."""
    known, seconds, outdone = {}, _seconds(scores, winner), []
    for pair in clear:
        more = {k: len(winner.fit.free) + n - len(pair.fit.free) for k, n in seconds.items() if k not in pair.keys}
        others = [k for k in more if more[k] <= 0]
        for key in (k for k in (*pair.keys, *more) if k not in known):
            start = {**pair.fit.parameters, **winner.fit.parameters}
            known[key] = beside(here, larger, start, key, noise, alone)
        if any(known[k] and ahead(known[k], pair.selection, more.get(k, 0)) for k in (*pair.keys, *more)):
            outdone.append(pair)
        else:
            pair.matched = any(known[k] and alike(alone, known[k], pair.selection) for k in others)
            pair.clear = not pair.matched
    return outdone


def _seconds(scores, winner):
    """What most may be said for beside a winner, and how many coefficients each has."""
    found = {}
    for s in sorted(scores.results, key=lambda s: -s.surprise):
        if s.candidate.key != winner.key and len(found) < SECONDS:
            found.setdefault(s.candidate.key, len(s.candidate.parts) + len(s.candidate.effect.scan))
    return found


def beside(dataset, without, start, key, noise, full):
    """The errors on unseen folds of a fitted model with an effect more.

    Parameters
    ----------
    dataset : Dataset
        Its fit part is searched.
    without : Model
        That lacks the effect.
    start : dict of str to float
        Parameters that its fit starts from, SI units.
    key : (str, str)
        Effect and place.
    noise : list of Noise
        One a channel, that rivals are compared at.
    full : Selection
        Of the model that others are compared beside.

    Returns
    -------
    Selection or None
        None where the model has no answer.
    """
    try:
        larger = compile_model(dataset.library, without.rig, [*without.keys, key])
        fitted = least_squares.fit(dataset, larger, nudged(dict(start), larger, None), most=TRIAL, noise=noise)
    except PycosimError:  # beside the others it leaves no motion, or no answer in closed form
        return None
    return select(dataset, larger, fitted, noise, full)


def ahead(one, other, more=0):
    """Whether unseen folds prefer a model to another by what a coefficient is worth, and by a standard error.

    By what tells rivals apart where it has more coefficients, and by what those are worth.

    Parameters
    ----------
    one, other : Selection
        Of the same folds at one noise level.
    more : int
        Coefficients that the first has more.

    Returns
    -------
    bool
    """
    gain, spread = gap(other, one, "white")
    if more > 0:
        return gain > max(2.0 * SEPARATE ** 2 + 2.0 * more, SEPARATE * spread)
    return gain > max(2.0, spread)


def _refitted(here, without, start, lacking, some, noise, alone, progress):
    """Pairs with their model, their fit from where another has brought the parameters, and their selection."""
    found = []
    for k, pair in enumerate(some, 1):
        if progress:
            progress(f"refitting with {' and '.join('@'.join(key) for key in pair.keys)}, {k} of {len(some)}")
        own = {n: v for c, shares in zip(pair.candidates, pair.shares) for n, v in start_of(c, shares).items()}
        begin = {n: start.parameters[n] for n in lacking.parameters}
        try:
            pair.model = compile_model(here.library, without.rig, [*without.keys, *pair.keys])
            pair.fit = least_squares.fit(here, pair.model, {**begin, **own}, most=TRIAL, noise=noise)
        except PycosimError:  # together they leave no motion, or no answer in closed form
            continue
        pair.without, pair.lacking = without, lacking
        pair.selection = select(here, pair.model, pair.fit, noise, alone)
        found.append(pair)
    return found


def _certain(dataset, pair):
    """Whether all effects of a pair are more than chance, differ from nothing, and are not of samples' luck."""
    return all(f.p_value < LEVEL and _is_some(dataset, pair, f, attached)
               and no_effect(dataset, pair.model, pair.fit, attached) is None
               for f, attached in zip(pair.findings, pair.attached))


def _has_own(dataset, pair):
    """Whether one of a pair is the machine's own travel, which is no name, and contests none."""
    return any(no_effect(dataset, pair.model, pair.fit, attached) == OWN for attached in pair.attached)


def _is_some(dataset, pair, finding, attached):
    """Whether an interval of one effect of a pair leaves out nothing, or the likelihood beside the others does."""
    if not holds_nothing(pair.model, finding, attached):
        return True
    smaller = compile_model(dataset.library, pair.model.rig, [k for k in pair.model.keys if k != finding.key])
    without = least_squares.fit_without(dataset, smaller, pair.fit.parameters, most=TRIAL, noise=pair.fit.noise)
    finding.fit = told_from_nothing(dataset, pair.model, finding, smaller, without, attached)
    return not holds_nothing(pair.model, finding, attached)


def _as_well(pair, rival):
    """Whether unseen folds do not tell two effects from one by more than tells rivals apart, nor the plain error."""
    return gap(pair, rival, "white")[0] < 2.0 * SEPARATE ** 2 and "raw" not in behind(pair, rival)


def _luck(candidates):
    """What it takes to be chosen by luck of so many more: of n candidates there are n / 2 times as many pairs."""
    return 2.0 * SEPARATE ** 2 + 2.0 * np.log(max(candidates / 2, 1.0))


def _outdoes(pair, winner, luck):
    """Whether two effects are chosen for one, by what tells two rivals apart beyond luck and a coefficient more."""
    gain, spread = gap(winner.selection, pair.selection, "white")
    more = len(pair.fit.free) - len(winner.fit.free)
    return gain > luck + 2.0 * more and (more <= 0 or gain > SEPARATE * spread)


def _tell(scores, table, alone, found):
    """What scores and fits say of the effects of each pair, and what could be in the place of each; best pair first."""
    others = [[[k for k in pair.keys if k != key] for key in pair.keys] for pair in found]
    asked = defaultdict(set)
    for pair, some in zip(found, others):
        for key, rest in zip(pair.keys, some):
            asked[tuple(rest)].add(key)
    beside = {rest: scores.beside(*rest, only=keys) for rest, keys in asked.items()}
    for pair, some in zip(found, others):
        for candidate, attached, rest in zip(pair.candidates, pair.attached, some):
            own = max((s for s in scores.results if s.candidate.key == candidate.key), key=lambda s: s.surprise)
            finding = Finding(*candidate.key, accepted=True, joint=True, statistic=own.value, fit=pair.fit,
                              p_value=beside[tuple(rest)].get(candidate.key, 1.0),
                              p_value_single=float(np.exp(-own.surprise)), selection=pair.selection)
            measure(finding, pair.model, attached, table)
            pair.findings.append(finding)
    found.sort(key=lambda p: p.selection.white.sum() + 2 * len(p.fit.free))
    for pair in found:
        pair.near = [p for p in found if p is not pair and alike(alone, p.selection, pair.selection)]
        for finding in pair.findings:
            finding.twins = instead(pair.near, finding, [f for f in pair.findings if f is not finding])


def instead(near, finding, others):
    """What could be in the place of one of several effects, each effect once before any at a second place.

    Parameters
    ----------
    near : list of Pair
        That unseen folds cannot tell from these.
    finding : Finding
        The effect, with the alternatives of it that are known.
    others : list of Finding
        Those beside it, with theirs.

    Returns
    -------
    list of dict
        Alternatives, with ``effect`` and ``place``.
    """
    mine, *beside = ({f.key, *((t["effect"], t["place"]) for t in f.twins)} for f in (finding, *others))
    known = mine.union(*beside)
    new = [f for pair in near if all(some & {*pair.keys} for some in beside) for f in pair.findings
           if f.key not in known]
    return finding.twins + [{"effect": e, "place": p} for e, p in dict.fromkeys(f.key for f in by_kind(new))]


def _with_load(dataset, scores, winner, some, least, more):
    """Pairs, and those that may do as well as a winner and its alternatives for an error of the load's model.

    None that does as well where such an error by itself is among those: then it is told. With a coefficient more, for
    no model of the load is quite right, those that take more.
    """
    errors = {e.id for e in ranked(dataset.library) if e.of_load_model and dataset.study.reference == "gravity_model"}
    named = [winner.key, *((t["effect"], t["place"]) for t in winner.twins)]
    found = {frozenset(p.keys): p for p in some}
    if errors:
        for pair in Combinations(scores, REFITS, max(more), errors).pairs(more):
            found.setdefault(frozenset(pair.keys), pair)
    if errors and errors.isdisjoint(e for e, _ in named):
        for pair in Combinations(scores, REFITS, max(least), errors, named).pairs(least):
            found.setdefault(frozenset(pair.keys), pair).doubted = True
    return [*found.values()]


def _little_of_load(dataset, pair):
    """Whether the error of the load's model in a pair changes no more of a channel than such models are off by."""
    sizes = {n: v.value for effect, place in pair.model.attached[-2:] if effect.of_load_model
             for n, v in pair.model.parameters.items() if n.startswith(f"{component_name(effect, place)}.")}
    problem = dataset.residuals(pair.model, pair.fit.free, pair.fit.parameters, "fit")
    without = [sizes.get(n, v) for n, v in zip(pair.fit.free, pair.fit.values)]
    changed = problem.residual(pair.fit.values) - problem.residual(np.array(without))
    load = np.array([dataset.reference(c)[dataset.view("fit")] for c in dataset.outputs])
    return bool(((changed ** 2).sum(1) <= DOUBTED ** 2 * (load ** 2).sum(1)).all())


class Combinations:
    """What some candidates take of a residual together: the pairs that take most, and the threes that begin with those.

    Parameters
    ----------
    scores : Scores
        Of the model that lacks them.
    most : int
        Pairs, or threes, that are wanted.
    largest : int, optional
        Coefficients that two may have together at most; any number by default.
    errors : set of str, optional
        Effects of which one is in each pair, with another beside it; any two by default.
    named : collection of (str, str)
        Effects and places that are not that other.
    """

    def __init__(self, scores, most, largest=np.inf, errors=None, named=()):
        self.scores, self.most = scores, most
        self.candidates = [s.candidate for s in scores.results if s.visible and _size(s.candidate) < largest]
        self.begun = []
        if len(self.candidates) > 1:
            self.coordinates = _whitened(scores, self.candidates)
            self._begin(largest, errors, named)

    def _begin(self, largest, errors, named):
        """What the best pairs take, and their numbers; best first."""
        best, candidates = {}, self.candidates
        barred = [bool(errors) and (c.effect.id in errors or c.key in named) for c in candidates]
        for k, candidate in enumerate(candidates):
            if errors and candidate.effect.id not in errors:
                continue
            taken = np.where(barred, -np.inf, _taken(*self.coordinates, k))
            for other in np.argsort(-taken)[:4 * self.most]:
                keys = frozenset((candidate.key, candidates[other].key))
                if np.isfinite(taken[other]) and taken[other] > best.get(keys, (0.0,))[0] and _apart(
                        candidate, candidates[other]) and _size(candidate) + _size(candidates[other]) <= largest:
                    best[keys] = taken[other], k, other
        self.begun = sorted(best.values(), key=lambda found: -found[0])

    def _inside(self, numbers):
        """The first of some, given by numbers of candidates, with what they take inside their bounds."""
        some = (tuple(self.candidates[k] for k in ks) for ks in numbers[:20 * self.most])
        return [Pair(of, *self.scores.fall(*of)) for of in some]

    def _best(self, found):
        return _varied(sorted(found, key=lambda p: -(p.value - 2.0 * p.size)), self.most)

    def pairs(self, least=None):
        """The pairs that explain most, each at its best grid points.

        Parameters
        ----------
        least : dict of int to float, optional
            By the coefficients that a pair may have at most, what it must take at least; any pair by default.

        Returns
        -------
        list of Pair
            Best first, within the coefficients' bounds; no two effects at one component are the same.
        """
        least = least or {np.inf: 0.0}
        found = self._inside([ks for _, *ks in self.begun])
        return self._best(p for p in found if p.value > least[min(n for n in least if n >= p.size)])

    def threes(self, two):
        """The threes that explain most; none where two take as much but for the luck of so many more.

        Parameters
        ----------
        two : list of Pair
            The best pairs.

        Returns
        -------
        list of Pair
            Best first, within the coefficients' bounds.
        """
        if not two:
            return []
        candidates, best = self.candidates, {}
        for _, *pair in self.begun[:BEGUN]:
            taken = _taken(*self.coordinates, *pair)
            for third in np.argsort(-taken)[:self.most]:
                some = [*pair, third]
                keys = frozenset(candidates[k].key for k in some)
                if np.isfinite(taken[third]) and taken[third] > best.get(keys, (0.0,))[0] and all(
                        _apart(candidates[k], candidates[third]) for k in pair):
                    best[keys] = taken[third], *some
        found = self._inside([ks for _, *ks in sorted(best.values(), key=lambda found: -found[0])])
        least = max(p.value - 2.0 * p.size for p in two) + _luck(len(candidates))
        return self._best(p for p in found if p.value - 2.0 * p.size > least)


def _size(candidate):
    """Coefficients of a candidate, those of its grid with them."""
    return len(candidate.parts) + len(candidate.effect.scan)


def _apart(one, other):
    """Whether two candidates are not one effect at one component twice."""
    return one.effect.id != other.effect.id or not set(one.place.components) & set(other.place.components)


def _varied(pairs, most):
    """The best of the pairs, of the same effects a few at most."""
    known, kept = {}, []
    for pair in pairs:
        kind = frozenset(c.effect.id for c in pair.candidates)
        known[kind] = known.get(kind, 0) + 1
        if known[kind] <= ALIKE and len(kept) < most:
            kept.append(pair)
    return kept


def _whitened(scores, candidates):
    """What each candidate explains of the residual and shares with each other, in coordinates where it is of size one.

    Returns
    -------
    first : ndarray, shape (candidates, most)
    cross : ndarray, shape (candidates, most, candidates, most)
    size : ndarray of bool, shape (candidates, most)
        Coordinates that there are: candidates have one coefficient or several.
    """
    own, moved = scores.beside_base(candidates)
    most, count = max(len(c.parts) for c in candidates), len(candidates)
    turn, k = np.zeros((count * most, len(moved))), 0
    size = np.zeros((count, most), dtype=bool)
    for i, candidate in enumerate(candidates):
        rows = slice(k, k + len(candidate.parts))
        turn[i * most:i * most + len(candidate.parts), rows] = least_squares.orthonormal(
            least_squares.invert(own[rows, rows])[0])
        size[i, :len(candidate.parts)] = True
        k = rows.stop
    return (turn @ moved).reshape(count, most), (turn @ own @ turn.T).reshape(count, most, count, most), size


def _taken(first, cross, size, *ks):
    """What some candidates take together with each of the others; none of those that are nearly the same."""
    count, most = first.shape
    rows = (np.array(ks)[:, None] * most + np.arange(most))[size[list(ks)]]
    flat = cross.reshape(count * most, count * most)
    turn = least_squares.orthonormal(least_squares.invert(flat[np.ix_(rows, rows)])[0])
    own = turn @ first.ravel()[rows]
    shared = np.moveaxis((turn @ flat[rows]).reshape(len(rows), count, most), 0, 2)  # the others first
    left = np.eye(most) - shared @ np.swapaxes(shared, 1, 2)
    added = first - shared @ own
    apart = np.linalg.eigvalsh(left)[:, 0] > APART
    taken = np.full(count, -np.inf)
    solved = np.linalg.solve(left[apart], added[apart][:, :, None])[:, :, 0]
    taken[apart] = (own ** 2).sum() + (added[apart] * solved).sum(1)
    taken[list(ks)] = -np.inf
    return taken

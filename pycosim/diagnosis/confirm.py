"""A study with effects, frozen, and a log that was never searched in; whether each effect holds there too, out.

Nothing was chosen on this log and nothing is fitted to it, so that each effect is one hypothesis with one p-value, and
no family of candidates has to be paid for.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..compile import compile_model, component_name
from ..core.errors import StudyError
from ..data.frames import Frame
from ..data.logs import read_log
from ..data.noise import fit_noise
from ..data.parameters import phases
from ..fit import least_squares
from .compare import errors
from .dependence import stretches
from .scores import LEVEL

FEWEST = 7
"""Units whose signs can say something: by chance, seven of seven fall together once in 128, which is below LEVEL."""
EXACT = 14  # units up to which every combination of signs is counted; of more, DRAWS are drawn
DRAWS = 19999
SAMPLES = 50000  # of a longer log, that errors are compared on
CHUNK = 1000  # draws at a time


@dataclass
class Confirmation:
    """What a new log says of one frozen effect.

    Attributes
    ----------
    effect, place : str
        As the study names them, ``stribeck`` and ``2A``.
    p_value : float
        Probability of so large a fall of the squared error where the effect lowers it by chance alone: the larger of
        the next two.
    p_value_frozen : float
        With everything else as the study has it.
    p_value_beside : float
        The same of the part of the effect that the other free parameters of the study cannot imitate.
    error_without, error_with : dict of str to float
        RMSE of each channel on the moving samples of the log, in its unit.
    confirmed : bool
        Whether `p_value` is below `LEVEL`, the error is smaller with the effect, and enough units were compared.
    units : int
        Blocks or passes whose falls were compared.
    why : str or None
        Why it is not confirmed.
    """

    effect: str
    place: str
    p_value: float
    p_value_frozen: float
    p_value_beside: float
    error_without: dict
    error_with: dict
    confirmed: bool
    units: int
    why: str | None = None


# --- what may be asked ------------------------------------------------------------------------------------------------


def refuse_searched(study, logs):
    """Refuse logs that the study's effects were found on, under their own name or another.

    Parameters
    ----------
    study : Study
        As it was found, with its own runs.
    logs : sequence of path or Frame
        Files, or tables in memory.

    Raises
    ------
    StudyError
        One of them is a run of the study, or holds the same.
    """
    own = [p for p in (*study.runs, *study.held_out) if isinstance(p, Frame) or Path(p).is_file()]
    for given in (g if isinstance(g, Frame) else Path(g) for g in logs):
        for path in own:
            if given is path or (isinstance(given, Path) and isinstance(path, Path)
                                 and given.resolve() == path.resolve()):
                raise StudyError(f"{given}: is one of the logs that {study.path} was made from; an effect is confirmed "
                                 "on a log that was never searched, so record another")
            if _alike(given, path, study):
                raise StudyError(f"{given}: holds the same as {path}, which {study.path} was made from; an effect is "
                                 "confirmed on a log that was never searched, so record another")


def _alike(given, known, study):
    """Whether two logs hold the same: files byte by byte, a table in memory and a file as they are read."""
    if isinstance(given, Path) and isinstance(known, Path):
        return given.is_file() and given.stat().st_size == known.stat().st_size and (
            given.read_bytes() == known.read_bytes())
    if isinstance(given, Frame) and isinstance(known, Frame):
        return given.sha256 == known.sha256
    one, other = (read_log(log, study, strict=False) for log in (given, known))
    return np.array_equal(one.time, other.time) and all(
        np.array_equal(values, other.signals.get(name)) for name, values in one.signals.items())


def refuse_nothing(study, model):
    """Refuse a study that claims nothing: no effects, or one whose size is that of nothing.

    Parameters
    ----------
    study : Study
        With effects, and the values of their coefficients.
    model : Model
        The rig with the study's effects.

    Raises
    ------
    StudyError
        It has no effect, or one whose coefficients are those of no effect.
    """
    if not model.attached:
        raise StudyError(f"{study.path}: has no effects to confirm; take the study.toml that 'pycosim improve' or "
                         "'pycosim add' leaves")
    for effect, place in model.attached:
        names = [f"{component_name(effect, place)}.{c}" for c in effect.size]
        given = {n: study.parameters[n].value for n in names if n in study.parameters}
        if names and all(given.get(n) in (None, model.parameters[n].value) for n in names):
            raise StudyError(f"{study.path}: {effect.id} at {place.name} has no size ({names[0]} is that of no "
                             "effect), so there is nothing to confirm; take the study.toml that 'pycosim add' leaves")


# --- the test ---------------------------------------------------------------------------------------------------------


def frozen(dataset, model):
    """A model with the study's values; where encoders began to count alone is found from the log.

    That is the zeros of joint encoders, and the phases of ripples that the study says are another in each run.

    Parameters
    ----------
    dataset : Dataset
        Gives the samples that zeros and phases are found from.
    model : Model
        Of the study's rig, with all its effects or without some.

    Returns
    -------
    Fit
    """
    asked, own = dataset.study.own_parameters(dataset.library), dataset.parameters.own(model)
    counted = [n for n in dataset.zeros if n in dataset.parameters.free(model)]
    for name in (n for n in phases(model) if n in asked):
        counted += own[name].values() if name in own else [name]
    return least_squares.fit(dataset, model, free=counted, part="all")


def confirm(dataset, seed=0, progress=None):
    """Test each effect of a study on a log that was never searched.

    Parameters
    ----------
    dataset : Dataset
        The study on the new log.
    seed : int
        Of the signs that are drawn where there are many units.
    progress : callable, optional
        Called with a sentence before each effect.

    Returns
    -------
    list of Confirmation
        In the order of the study.
    """
    say = progress or (lambda text: None)
    model = dataset.base
    fit = frozen(dataset, model)
    found = []
    for effect, place in model.attached:
        say(f"comparing with and without {effect.id} at {place.name}")
        key = effect.id, place.name
        fewer = compile_model(dataset.library, model.rig, [k for k in model.keys if tuple(k) != key])
        without = frozen(dataset, fewer)
        falls, beside = _falls(dataset, (model, fit), (fewer, without))
        before, after = errors(dataset, fewer, without, "all"), errors(dataset, model, fit, "all")
        p = [chance(f, seed) for f in (falls, beside)]
        lower = sum((w * before[c]) ** 2 - (w * after[c]) ** 2 for w, c in zip(fit.weights, dataset.channels)) > 0
        why = _why(falls, p, lower)
        found.append(Confirmation(*key, max(p), *p, before, after, why is None, len(falls), why))
    return found


def _why(falls, p, lower):
    """Why an effect is not confirmed; None for one that is."""
    if len(falls) < FEWEST:
        return f"only {len(falls)} passes to compare, of {FEWEST} or more that are needed"
    if not lower or falls.sum() <= 0:
        return "the error is no smaller with it"
    if p[0] >= LEVEL:
        return "the error is smaller with it, but no more than by chance"
    if p[1] >= LEVEL:
        return ("the error is smaller with it, but on this log the other parameters of the study could have done the "
                "same")
    return None


def _falls(dataset, larger, fewer):
    """Fall of the whitened squared error with an effect, unit by unit: frozen, and beside the other parameters.

    What the effect adds is computed from the motion alone: noise of a measured torque in it would meet itself in the
    residual, and an effect that lets less of that noise through would seem to predict.
    """
    (model, fit), (reduced, without) = larger, fewer
    exogenous, free = dataset.exogenous(), dataset.parameters.free(reduced)
    problem = dataset.residuals(reduced, without.free, without.parameters, "all")
    thin = max(1, problem.n // SAMPLES)
    problem = problem.thin(thin)

    def predicted(m, f):
        return dataset.residuals(m, f.free, f.parameters, "all", exogenous).thin(thin).residual(f.values)

    residual, added = problem.residual(without.values), predicted(reduced, without) - predicted(model, fit)
    sloped = dataset.residuals(reduced, free, without.parameters, "all", exogenous).thin(thin)
    slope = np.concatenate([j for _, _, j in sloped.blocks([without.parameters[n] for n in free])], axis=2)
    white = _whitened(problem.chain, fit.weights, residual, added, slope)
    residual, added = white[:, -2], white[:, -1]
    unit = _units(dataset, problem)
    alone = [_without(v, white[:, :-2]) for v in (residual, added)]
    return tuple(np.bincount(unit, (2 * r * a - a ** 2).sum(0)) for r, a in ((residual, added), alone))


def _whitened(chain, weights, residual, added, slope):
    """Slopes, residual and what the effect adds, whitened: shape (channels, p + 2, n).

    The noise is that of what neither the effect nor any other free parameter could explain: the same, whether the
    effect is there or not.
    """
    columns = np.concatenate([slope, added[:, None]], axis=1) * weights[:, None, None]
    left = _without(residual * weights[:, None], columns) / weights[:, None]
    noise = [fit_noise(r, chain) for r in left]
    rows = np.concatenate([slope, residual[:, None], added[:, None]], axis=1)
    return np.array([n.whiten(r, chain) for n, r in zip(noise, rows)])


def _without(values, columns):
    """Values (channels, n) less what columns (channels, p, n) explain of them."""
    size = np.sqrt(np.maximum(np.einsum("cpn,cpn->p", columns, columns), 1e-300))
    columns = columns / size[:, None]
    gram = np.einsum("cpn,cqn->pq", columns, columns)
    factor = np.linalg.lstsq(gram, np.einsum("cpn,cn->p", columns, values), rcond=1e-9)[0]
    return values - np.einsum("p,cpn->cn", factor, columns)


def _units(dataset, problem):
    """Blocks of the samples, numbered; passes where a short log has too few blocks."""
    blocks, unit = np.unique(problem.block, return_inverse=True)
    return unit if len(blocks) >= FEWEST else stretches(dataset, problem)[0]


def chance(falls, seed=0):
    """Probability of so large a sum if each unit's fall were as likely a rise (one-sided sign-flip test).

    The test asks for no equal scatter: fast passes may count for more than slow ones.

    Parameters
    ----------
    falls : ndarray, shape (units,)
        Fall of the squared error of each unit; negative where it rose.
    seed : int
        Of the drawn signs; of few units, all combinations are counted.

    Returns
    -------
    float
        1.0 where nothing falls at all.

    References
    ----------
    .. [1] Winkler, A. M. et al. (2014). Permutation inference for the general linear model. NeuroImage 92.

    Examples
    --------
    Eight falls of eight, all of one size, come about by chance once in 256:

    >>> chance(np.ones(8)) == 1 / 256
    True
    """
    total, n = falls.sum(), len(falls)
    if not np.any(falls):
        return 1.0
    least = total - 1e-12 * np.abs(falls).sum()
    if n <= EXACT:
        signs = 1 - 2 * ((np.arange(2 ** n)[:, None] >> np.arange(n)) & 1)
        return float(np.mean(signs @ falls >= least))
    rng, count = np.random.default_rng(seed), 0
    for start in range(0, DRAWS, CHUNK):
        signs = 1 - 2 * rng.integers(0, 2, (min(CHUNK, DRAWS - start), n), dtype=np.int8)
        count += int(np.count_nonzero(signs @ falls >= least))
    return (1 + count) / (1 + DRAWS)

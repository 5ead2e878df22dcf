"""In: a kind of case and a seed. Out: a random machine, motion, noise and hidden effects, and its log.

Everything is drawn continuously: the eight base parameters, the speeds and their order in time, the noise and its
colour, the resolution of the drives, the gaps of the recorder, the effects' places, signs, sizes and secondary
coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.hidden_effects import machine as rig

CATALOGUE = tuple(name for name in rig.KINDS if name not in rig.OUTSIDE_CATALOGUE)
WEAK = 1.2
LEAST, MOST = 1.3, 3.0
LARGEST = 0.98  # of the largest size an effect reaches, where the wanted one is beyond it
MEANINGFUL = 1.1  # below this size a place is drawn again
# what no log of this rig with a torque reference can tell apart (the contract's list)
TWINS = [{("torque_offset", f"motor{i}"), ("direction_asymmetry", f"{i}A")} for i in (1, 2)] + [
    {("torque_offset", "motor1+motor2"), ("direction_asymmetry", "1A+2A")}] + [
    {(e, p) for p in ("1B", "2B", "1B+2B")} for e in ("viscous", "stribeck")]
# the base has no load term where load dependence is hidden, so that other terms of the load have no meaning there
LOADED = {"load_dependence", "load_nonlinearity", "load_hysteresis", "cross_load"}


@dataclass(frozen=True)
class Case:
    """What to hide.

    Parameters
    ----------
    kind : {"one", "weak", "pair", "none", "paired", "outside", "paper"}
        ``paired`` has nothing hidden and no torque reference. ``paper`` is the paper's machine with nothing hidden, of
        which only the fit is asked for.
    effects : tuple of str
        Identifiers of the hidden effects.
    seed : int
        Draws all the rest.
    sizes : tuple of float, optional
        Wanted sizes; drawn by default.
    """

    kind: str
    effects: tuple
    seed: int
    sizes: tuple = ()

    @property
    def half(self):
        """Development or final half."""
        return "final" if self.seed % 2 else "development"


@dataclass
class Drawn:
    """A case with everything drawn: `hidden` are effects with their coefficients, `sizes` what each alone has."""

    machine: dict
    motion: rig.Trajectory
    noise: rig.Noise
    counts: int
    lost: float
    hidden: list = field(default_factory=list)
    sizes: list = field(default_factory=list)
    short: bool = False


def all_cases(count=1.0, first=0):
    """The published set of cases, or an even share of it; seeds alternate between the two halves.

    Parameters
    ----------
    count : float
        Share of each kind.
    first : int
        First seed.

    Returns
    -------
    list of Case
    """
    def seeds(number):
        return range(first, first + max(1, round(number * count)))

    found = [Case("none", (), s) for s in seeds(200)] + [Case("paired", (), s) for s in seeds(100)]
    found += [Case("one", (e,), s) for e in CATALOGUE for s in seeds(12)]
    found += [Case("weak", (e,), s) for e in CATALOGUE for s in seeds(4)]
    found += [Case("outside", (e,), s) for e in rig.OUTSIDE_CATALOGUE for s in seeds(14)]
    found += [Case("pair", pair(s), s) for s in seeds(42)]
    return found + [Case("paper", (), s) for s in seeds(200)]


def pair(seed):
    """Two different effects that are no twins and can be in one machine."""
    rng = np.random.default_rng([seed, 77])
    while True:
        one, two = (str(e) for e in rng.choice(CATALOGUE, 2, replace=False))
        if "load_dependence" in (one, two) and {one, two} <= LOADED:
            continue
        if {one, two} == {"direction_asymmetry", "torque_offset"}:
            continue
        return one, two


def draw(case):
    """Draw everything of a case.

    Parameters
    ----------
    case : Case

    Returns
    -------
    Drawn
    """
    rng = np.random.default_rng([case.seed, *(sum(map(ord, e)) for e in case.effects)])
    machine = rig.PAPER if case.kind == "paper" else rig.random_machine(rng)
    if "load_dependence" in case.effects:
        machine = rig.without_load_dependence(machine)
    noise = rig.Noise(white=_log_uniform(rng, 3e-3, 9e-3), slow=_log_uniform(rng, 1e-3, 4e-3),
                      slow_time=_log_uniform(rng, 0.3, 3.0), resolution=rng.uniform(0.0, 3e-3))
    drawn = Drawn(machine, _motion(case, rng), noise, 2 ** int(rng.integers(12, 17)), rng.uniform(0.0, 0.02))
    for k, effect in enumerate(case.effects):
        _hide(case, drawn, effect, case.sizes[k] if case.sizes else _size(case, rng), rng)
    return drawn


def _log_uniform(rng, low, high):
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _size(case, rng):
    if case.kind == "weak":
        return WEAK
    return _log_uniform(rng, LEAST, MOST)


def _motion(case, rng):
    """Five speeds, spread over a decade, in random order; where a gap is to show, loads change their signs."""
    speeds = np.exp(np.linspace(np.log(0.2), np.log(2.4), 5) + rng.uniform(-0.2, 0.2, 5))
    start = rig.CROSSING_START if "backlash" in case.effects else (0.9, -0.85)
    return rig.six_manoeuvres(tuple(speeds), 2, start=(start,), longest_pass=6.8, rng=rng)


def _hide(case, drawn, effect, size, rng):
    """Add an effect of a size at a random place; the largest it reaches where it cannot be that large."""
    best = None
    for _ in range(8):
        place = str(rng.choice(list(rig.KINDS[effect].places)))
        weak = rig.draw(effect, place, rng)
        try:
            found, reached = _calibrated(drawn, weak, size, case.seed), size
        except rig.UnreachableSizeError as error:
            if error.largest < MEANINGFUL or (best and best[1] >= error.largest):
                continue
            best = weak, error.largest
            continue
        except rig.MachineError:
            continue
        drawn.hidden.append(found)
        drawn.sizes.append(reached)
        return
    if best is None:
        raise rig.MachineError(f"{effect} reaches no size above {MEANINGFUL:g} on machine {case.seed}")
    reached = 1 + LARGEST * (best[1] - 1)
    drawn.hidden.append(_calibrated(drawn, best[0], reached, case.seed))
    drawn.sizes.append(reached)
    drawn.short = True


def _calibrated(drawn, effect, size, seed):
    return rig.calibrate(effect, size, drawn.machine, drawn.motion, drawn.noise, seed)


def log(drawn, seed, effects=None, reference="gravity_model"):
    """The log of a drawn case, as a table.

    Parameters
    ----------
    drawn : Drawn
    seed : int
        Of the noise.
    effects : list, optional
        Instead of the hidden ones.
    reference : str or None
        What the machine's torques at the joints are taken from; without it there are none.

    Returns
    -------
    pandas.DataFrame
    """
    effects = drawn.hidden if effects is None else effects
    extra = ("q",) if any(e.id in ("cable_compliance", "backlash") for e in drawn.hidden) else ()
    frame = rig.measure(drawn.machine, drawn.motion, effects, drawn.noise, drawn.counts, seed, extra,
                        reference=reference)
    return rig.drop_out(frame, drawn.lost, np.random.default_rng([seed, 5]))


def study(given, effects):
    """The study to improve; where load dependence is hidden, one that has none.

    Parameters
    ----------
    given : Study
    effects : iterable of str

    Returns
    -------
    Study
    """
    if "load_dependence" not in effects:
        return given
    return replace(given, parameters={n: replace(s, value=1.0, fixed=True) if n.endswith(".mu") else s
                                      for n, s in given.parameters.items()})


def same(found, true):
    """Whether a finding is the hidden effect or a true twin of it.

    Parameters
    ----------
    found, true : (str, str)
        Effect and place.

    Returns
    -------
    bool
    """
    return found == true or any(found in group and true in group for group in TWINS)

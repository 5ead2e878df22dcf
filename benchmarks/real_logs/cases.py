"""In: the name of a case, ``condition:what:size:seed``. Out: its machine, motion, sensors and hidden effects.

    digital:stribeck:1.7:3      motor and joint encoders and currents in steps, a Stribeck effect of size 1.7, seed 3
    gait:none::0                nothing hidden, ordinary motion
    digital:wear:1.7:1          a law outside the catalogue (`effects.OUTSIDE`)
    mistake:tau_negated::2      a sound log with one mistake of wiring or units (`mistakes.MISTAKES`)
    three:a+b+c:1.5:4           several effects at once

`make.make(case, folder)` writes logs and study; `CONDITIONS` says what each condition is and what may be named there.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import zip_longest

import numpy as np

from benchmarks.real_logs import effects as laws
from benchmarks.real_logs import machines, motions, sensors
from benchmarks.real_logs.mistakes import MISTAKES, POOR

SIZES = (1.3, 1.7, 2.4)
QUICK = 8000
"""Samples of a quick log."""


@dataclass(frozen=True)
class Case:
    """What is made.

    Parameters
    ----------
    condition : str
        A key of `CONDITIONS`.
    what : str
        ``none``, an effect, several joined by ``+``, or a mistake.
    size : float
        RMSE of the base model with the effect over that without, after steps and rounding.
    seed : int
    quick : bool
        A shorter log.
    """

    condition: str
    what: str = "none"
    size: float = 1.7
    seed: int = 0
    quick: bool = False

    @property
    def name(self):
        """Name of the case."""
        return f"{self.condition}:{self.what}:{'' if self.what == 'none' else f'{self.size:g}'}:{self.seed}"


@dataclass(frozen=True)
class Condition:
    """A way in which logs differ from those of the package's own generator.

    Parameters
    ----------
    world : dict
        Settings of `sensors.World`; a list is drawn from.
    machine, motion : str
    options : dict
        Of the motion.
    effects : tuple of str
        What is hidden in it.
    named : tuple of (str, str)
        Effects and places that name the condition itself; a place ``*`` is any.
    says : str
        A line for the table.
    rate : float
        Hz.
    files : int
        How many files the log is cut into.
    zeros : float
        The encoders of the motors count from somewhere else in each file, by up to so much [rad].
    """

    says: str
    world: dict = field(default_factory=dict)
    machine: str = "hip_knee"
    motion: str = "passes"
    options: dict = field(default_factory=dict)
    effects: tuple = laws.SIXTEEN
    named: tuple = ()
    rate: float = 200.0
    files: int = 1
    zeros: float = 0.0
    decisive: bool = True


BITS, CURRENT = list(range(12, 21)), list(range(8, 13))
FRICTION = ("viscous", "stribeck", "direction_asymmetry", "torque_offset", "torque_constant", "torque_ripple",
            "load_nonlinearity", "thermal_drift", "configuration_preload", "presliding")
GEARED = ("viscous", "stribeck", "direction_asymmetry", "torque_offset", "torque_ripple", "load_nonlinearity",
          "thermal_drift", "torque_constant", "time_delay", "presliding")
LINEAR = ("viscous_asymmetry", "torque_offset", "torque_ripple", "stribeck", "time_delay", "direction_asymmetry",
          "sublinear_viscous", "thermal_drift")
LAG = (("low_pass", "*"), ("time_delay", "*"), ("reference_lag", "*"))
MASS = (("reference_mass", "*"), ("reference_centre", "*"), ("payload", "*"), ("reference_gain", "*"))
CONDITIONS = {
    "plain": Condition("fine resolution, white and slow noise"),
    "joint_encoders": Condition("joint encoders of 12 to 20 bits", {"joint_bits": BITS}),
    "motor_encoders": Condition("motor encoders of 12 to 20 bits", {"motor_bits": BITS, "speed": [True, False]}),
    "currents": Condition("currents of 8 to 12 bits", {"current_bits": CURRENT}),
    "digital": Condition("encoders and currents in steps", {"joint_bits": BITS, "motor_bits": BITS, "speed": [
        True, False], "current_bits": CURRENT, "digits": 5}),
    "outliers_01": Condition("spikes in 0.1 % of the torques", {"outliers": 1e-3}),
    "outliers_1": Condition("spikes in 1 % of the torques", {"outliers": 1e-2}),
    "noise_speed": Condition("noise grows fivefold with the speed", {"grows": "speed"}),
    "noise_load": Condition("noise grows fivefold with the load", {"grows": "load"}),
    "one_noisy": Condition("one run of three four times noisier", {"part_noise": (1.0, 4.0, 1.0)}, files=3),
    "rate50": Condition("50 Hz", rate=50.0),
    "jitter": Condition("samples up to a quarter of an interval early or late, encoders in steps", {
        "jitter": 0.25, "joint_bits": BITS, "motor_bits": BITS, "speed": [True, False]}),
    "held_current": Condition("currents that stand for three rows", {"stands": {"tau": 3}}),
    "held_reference": Condition("references that stand for two rows", {"stands": {"C": 2}}),
    "held_rows": Condition("rows that stand twice, encoders and currents in steps", {
        "stands": {"all": 2}, "joint_bits": BITS, "motor_bits": BITS, "current_bits": CURRENT}),
    "lag_reference": Condition("reference through 5 Hz", {"low_pass": {"C": 5.0}}, named=LAG),
    "lag_current": Condition("currents through 5 Hz", {"low_pass": {"tau": 5.0}}, named=LAG),
    "lag_gait": Condition("ordinary motion, reference through 5 Hz", {"low_pass": {"C": 5.0}}, motion="gait",
                          named=LAG),
    "reference_mass": Condition("mass of the load model 5 % off", {"reference": "gravity_model", "reference_error": [
        {"m1": 0.05}, {"m2": 0.05}, {"m2": -0.05}]}, named=MASS),
    "reference_centre": Condition("centre of mass 5 % off", {"reference": "gravity_model", "reference_error": [
        {"c1": 0.05}, {"c2": 0.05}, {"c1": -0.05}]}, named=MASS),
    "reference_zero": Condition("joint zero of the load model 2 degrees off", {
        "reference": "gravity_model", "reference_error": {"zero": np.deg2rad(2)}, "reference_joint": [0, 1]},
        named=(("reference_zero", "*"),)),
    "reference_gain": Condition("gain of one joint's reference 2 % off", {
        "reference_error": {"gain": 0.02}, "reference_joint": [0, 1]}, named=(("reference_gain", "*"),)),
    "reference_offset": Condition("offset of one joint's reference", {
        "reference_error": {"offset": 0.4}, "reference_joint": [0, 1]}, named=(("reference_offset", "*"),)),
    "three": Condition("three effects at once", effects=("three",)),
    "short": Condition("12 s of passes", options={"speeds": (2.2,), "repeats": 1, "longest": 1.6}),
    "short_gait": Condition("10 s of ordinary motion", motion="gait", options={"duration": 10.0, "cadences": (0.2,)}),
    "gait": Condition("gait-like motion, one run", motion="gait"),
    "gait_files": Condition("gait-like motion in four files", motion="gait", files=4),
    "multisine": Condition("multi-sine, one run", motion="multisine"),
    "pick_and_place": Condition("pick and place, one run", motion="pick_and_place"),
    "ordinary_digital": Condition("gait-like motion, encoders and currents in steps", {
        "joint_bits": BITS, "motor_bits": BITS, "current_bits": CURRENT}, motion="gait"),
    "remounted": Condition("three runs, each with zeros of the motor encoders of its own", files=3, zeros=1.0,
                           effects=("torque_ripple", "stribeck", "torque_ripple", "torque_offset")),
    "one_pass": Condition("one pass out and back", options={"speeds": (1.0,), "repeats": 1, "pairs": (("A", "B"),)},
                          decisive=False),
    "load_model": Condition("a right load model as reference", {"reference": "gravity_model"}, effects=(
        *laws.SIXTEEN[:-1], "joint_spring", "payload")),
    "further": Condition("effects beside the sixteen", {"joint_bits": [14, 16, 18]}, effects=laws.FURTHER[:-2]),
    "unpaired": Condition("no reference", {"reference": "none"}, effects=("viscous", "stribeck", "torque_ripple")),
    "geared": Condition("rig GearedJoint, passes", machine="geared_joint", effects=GEARED),
    "geared_gait": Condition("rig GearedJoint, ordinary motion", machine="geared_joint", motion="gait",
                             effects=GEARED, options={"amplitude": 0.7}),
    "geared_digital": Condition("rig GearedJoint, encoder and current in steps", {
        "motor_bits": BITS, "current_bits": CURRENT}, machine="geared_joint", effects=GEARED),
    "linear": Condition("linear axis, passes", machine="linear_axis", effects=LINEAR, options={"ramp": 0.15}),
    "linear_digital": Condition("linear axis, encoder and current in steps", {
        "motor_bits": [12, 14, 16], "current_bits": CURRENT, "digits": 7, "speed": False}, machine="linear_axis",
        effects=LINEAR, options={"ramp": 0.15}),
    "outside": Condition("laws outside the catalogue, fine sensors", effects=laws.OUTSIDE),
    "outside_digital": Condition("laws outside the catalogue, digital sensors", {
        "joint_bits": BITS, "motor_bits": BITS, "current_bits": CURRENT}, effects=laws.OUTSIDE),
    "outside_gait": Condition("laws outside the catalogue, ordinary motion", motion="gait", effects=laws.OUTSIDE),
    "mistake": Condition("a mistake of wiring or units", {"joint_bits": [None, 16]}, effects=("mistake",)),
    "poor": Condition("a log too poor for much", effects=("poor",)),
}


@dataclass
class Drawn:
    """A case with everything drawn.

    Parameters
    ----------
    case : Case
    plant : machines.HipKnee
    motion : motions.Motion
    world : sensors.World
    hidden : list of Effect
    sizes : list of float
        Of each effect alone.
    temperature : ndarray or None
    """

    case: Case
    plant: object
    motion: motions.Motion
    world: sensors.World
    hidden: list
    sizes: list
    temperature: np.ndarray | None

    def truth(self, hidden=None):
        """What is true in it, with the hidden effects or others."""
        return machines.simulate(self.plant, self.motion, self.hidden if hidden is None else hidden, self.temperature)

    def columns(self, truth):
        """The log."""
        return sensors.record(self.plant, truth, self.motion, self.world, self.case.seed)


def parse(text):
    """A case by its name.

    Parameters
    ----------
    text : str

    Returns
    -------
    Case

    Raises
    ------
    ValueError
        No such condition.
    """
    condition, what, size, seed = (text.split(":") + ["none", "", "0"][text.count(":"):])[:4]
    if condition not in CONDITIONS:
        raise ValueError(f"no condition '{condition}'; one of {', '.join(CONDITIONS)}")
    return Case(condition, what or "none", float(size or 1.0), int(seed or 0))


def drawn(case):
    """Draw everything of a case; the effects reach the wanted size, or the largest that they can.

    Parameters
    ----------
    case : Case

    Returns
    -------
    Drawn
    """
    about = CONDITIONS[case.condition]
    rng = np.random.default_rng([case.seed, *map(ord, case.condition), *map(ord, case.what)])
    plant = machines.MACHINES[about.machine](rng)
    motion = _motion(about, case, rng, plant)
    world = sensors.World(**{n: v[rng.integers(len(v))] if isinstance(v, list) else v
                             for n, v in about.world.items()})
    names = [] if case.what == "none" or case.condition in ("mistake", "poor") else case.what.split("+")
    temperature = None
    if "temperature_dependence" in names:
        t = motion.time
        temperature = 27 + 6 * (1 - np.exp(-t / 40)) + 2 * np.sin(2 * np.pi * t / 23 + rng.uniform(0, 6))
    found = Drawn(case, plant, motion, world, [], [], temperature)
    for name in names:
        effect, reached = _sized(found, name, case.size, rng)
        found.hidden.append(effect)
        found.sizes.append(reached)
    return found


def _motion(about, case, rng, plant):
    options = dict(about.options)
    if about.motion == "passes" and case.quick:
        options = {"longest": 2.2, "repeats": 1, "dwell": 0.25, **options}
    if about.motion != "passes":
        options = {"axes": plant.axes, **({"duration": 32.0} if case.quick else {}), **options}
    rate = about.rate if not case.quick else min(about.rate, 200.0)
    return getattr(motions, about.motion)(rng, rate, **options)


def size_of(found, effect, sound=None):
    """Size of an effect in a case, and the errors without it: the largest ratio of any channel."""
    sound = sound or base(found)
    truth = found.truth([effect])
    errors = machines.base_errors(found.plant, truth, found.columns(truth))
    return max(errors[c] / sound[c] for c in sound), sound


def _calm(found):
    """The case with sensors as in its condition, yet no error of the reference or filter: their size is no effect's."""
    return replace(found, world=replace(_seen(found.world), low_pass={}, reference_error={}, outliers=0.0))


def _seen(world):
    """A world whose joint torques are measured: sizes are told by what a sensor would show, where there is none."""
    return replace(world, reference="sensor") if world.reference == "none" else world


def base(found):
    """Errors of the fitted base model with nothing hidden."""
    calm = _calm(found)
    truth = calm.truth([])
    return machines.base_errors(calm.plant, truth, calm.columns(truth))


def own_size(found):
    """Size of what the condition itself does with nothing hidden: filters and errors of the reference, not spikes."""
    sound, calm = base(found), replace(found, world=replace(_seen(found.world), outliers=0.0))
    truth = calm.truth([])
    errors = machines.base_errors(calm.plant, truth, calm.columns(truth))
    return max(errors[c] / sound[c] for c in sound)


def _sized(found, name, size, rng, tries=6, steps=12):
    """An effect at a random place with the wanted size; where no place reaches it, the largest that was met."""
    calm = _calm(found)
    sound, best = base(calm), (None, 0.0)
    for _ in range(tries):
        effect = laws.draw(name, rng, found.plant, found.motion)
        low, high = laws.bounds(name, found.plant)
        x, seen = np.sqrt(low * high), []
        for _ in range(steps):
            reached = size_of(calm, effect.sized(x), sound)[0]
            seen.append((x, reached))
            if reached > best[1] and reached <= size * 1.03:
                best = effect.sized(x), reached
            if abs(reached / size - 1) < 0.02:
                return effect.sized(x), reached
            low, high = (x, high) if reached < size else (low, x)
            x = _next(seen, low, high, size)
            if high / low < 1.01:
                break
    if best[1] < 1.1:
        raise ValueError(f"{name} reaches no size above 1.1 here")
    return best


def _next(seen, low, high, size):
    """Amplitude to try: squares of sizes are near linear in squares of amplitudes, kept within the bracket."""
    x, reached = seen[-1]
    if reached > 1.02:
        guess = x * np.sqrt((size ** 2 - 1) / (reached ** 2 - 1))
        if low * 1.02 < guess < high / 1.02 and len(seen) < 6:
            return guess
    return np.sqrt(low * high)


def listed(conditions, seeds, first=0, hidden=2, quick=False):
    """Cases of some conditions.

    Parameters
    ----------
    conditions : iterable of str
    seeds : int
        Logs of each condition with nothing hidden; with effects there are `hidden` times as many.
    first : int
        First seed.
    hidden : int
    quick : bool

    Returns
    -------
    list of Case
    """
    found = []
    for condition in conditions:
        cases = []
        found.append(cases)
        about = CONDITIONS[condition]
        if condition in ("mistake", "poor"):
            changes = MISTAKES if condition == "mistake" else POOR
            cases += [Case(condition, m, 1.0, s, quick) for s in range(first, first + seeds) for m in changes]
            continue
        outside = set(about.effects) <= set(laws.OUTSIDE)
        cases += [] if outside or condition == "three" else [
            Case(condition, "none", 1.0, s, quick) for s in range(first, first + seeds)]
        for k in range(first * hidden, (first + seeds) * hidden):
            cases.append(Case(condition, _what(about, k), SIZES[(k // len(about.effects) + k) % 3], k, quick))
    # one of each condition before the second of any: a run that is stopped has seen them all
    return [c for group in zip_longest(*found) for c in group if c]


def _what(about, k):
    """The k-th effect of a condition: all of them in an order of its own, then again."""
    if about.effects == ("three",):
        rng = np.random.default_rng([k, 3])
        return "+".join(str(e) for e in rng.choice(FRICTION, 3, replace=False))
    order = np.random.default_rng([*map(ord, about.says)]).permutation(len(about.effects))
    name = about.effects[order[k % len(order)]]
    hidden = name in laws.ENCODER and "joint_bits" not in about.world
    return "temperature_dependence" if hidden else name  # nothing else shows what a joint encoder would

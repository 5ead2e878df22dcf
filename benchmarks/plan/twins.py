"""Ten pairs of effects: how often the right one is named when six manoeuvres at one speed are followed by a plan.

The alternative is to make the six manoeuvres once more, which takes 160 s against the plan's 120 s.
"""

from __future__ import annotations

import numpy as np

from benchmarks.hidden_effects import machine as rig

BUDGET = 120.0  # s
SAME = 0.01  # variances of the noise: what rounding leaves of one and the same prediction
# the true effect, with its coefficients, and a rival of the catalogue
PAIRS = [
    (("viscous", "1A", {"b": 0.02}), ("stribeck", "1A")),
    (("viscous", "2A", {"b": 0.02}), ("stribeck", "2A")),
    (("viscous", "1B", {"b": 0.02}), ("viscous", "2B")),
    (("stribeck", "1A", {"fs": 0.04, "ws": 0.6}), ("viscous", "1A")),
    (("torque_offset", "motor1", {"o": 0.02}), ("direction_asymmetry", "1A")),
    (("torque_offset", "motor2", {"o": 0.02}), ("direction_asymmetry", "2A")),
    (("direction_asymmetry", "1A", {"a": 0.3}), ("torque_offset", "motor1")),
    (("load_nonlinearity", "1A", {"d": 0.02}), ("torque_saturation", "motor1")),
    (("torque_constant", "motor1", {"g": 1.05}), ("load_nonlinearity", "1A")),
    (("stribeck", "1B", {"fs": 0.03, "ws": 0.3}), ("stribeck", "2B")),
]


def fits(data, pair, truth):
    """Both rivals, fitted to a data set from the values of the first."""
    from pycosim.compile import Library, compile_model, component_name
    from pycosim.fit import least_squares
    found, library = {}, Library()
    base = least_squares.fit(data, data.base, part="all")
    for key in pair:
        model = compile_model(library, data.study.rig, [key])
        name, start = component_name(*model.attached[0]), dict(base.parameters)
        effect = model.attached[0][0]
        for c in dict.fromkeys((*effect.size, *effect.scan)):
            v = model.parameters[f"{name}.{c}"]
            start[v.name] = truth.get(c, v.value + 0.3 * v.nominal) if key == pair[0] else v.value + 0.3 * v.nominal
        found[key] = model, least_squares.fit(data, model, start, part="all")
    return found


def case(arguments):
    """Variances of the noise by which the right one of two is better on unseen folds, and over their spread."""
    from benchmarks.plan.run import baseline, dataset
    from pycosim.diagnosis.crossval import difference, select
    motion, seed, (true, other) = arguments
    key = true[:2]
    data = dataset([baseline(), motion], seed, "gravity_model", (rig.Effect(key[0], key[1], **true[2]),))
    both = fits(data, (key, other), true[2])
    noise = both[key][1].noise
    a = select(data, *both[key], noise)
    b = select(data, *both[other], noise, a.usual)
    gap, spread = difference(b.white, a.white)
    return gap, gap / spread if np.isfinite(spread) and spread > 0 else 0.0


def planned(pair, seed):
    """Plan that separates a pair, from one log of the six manoeuvres with the first of it hidden."""
    from benchmarks.plan.run import baseline, dataset
    from pycosim.design import plan
    from pycosim.fit import least_squares
    true, other = pair
    first = dataset(baseline(), seed, "gravity_model", (rig.Effect(true[0], true[1], **true[2]),))
    fit = least_squares.fit(first, first.base, part="all")
    k = plan.known(first.study, first.library, first.base, first, fit)
    blocks = plan.rivals([(true[:2], other)], fits(first, (true[:2], other), true[2]))
    found = plan.make_plan(k, "twins", BUDGET, 100.0, blocks)
    return found.motion, plan.separations(found)


def report(pairs, seeds, where, workers):
    """Print how often the right one is named, after the six manoeuvres and after the plan.

    Parameters
    ----------
    pairs : int
    seeds : sequence of int
        Of the log that is planned from, then of those that are looked at.
    where, workers
        As for `pycosim.core.executors.executor`.
    """
    from benchmarks.plan.run import as_machine, baseline
    from pycosim.core.executors import each
    print(f"\ntwins, {len(seeds) - 1} seeds: share in which the right one predicts unseen folds better, and by more "
          "than 1.645 standard errors")
    some = PAIRS[:pairs]
    made = [planned(pair, seeds[0]) for pair in some]
    work = {(k, moved, s): (case, (as_machine(made[k][0]) if moved else baseline(), s, pair))
            for k, pair in enumerate(some) for moved in (False, True) for s in seeds[1:]}
    done = {key: future.result() for key, future in each(work, where, workers)}
    for k, (pair, (_, told)) in enumerate(zip(some, made)):
        shares = []
        for moved in (False, True):
            rows = [done[k, moved, s] for s in seeds[1:]]
            shares.append((np.mean([r[0] > SAME for r in rows]), np.mean([r[0] > SAME and r[1] > 1.645 for r in rows])))
        (true, other), (before, after) = pair, shares
        name = f"{true[0]}@{true[1]} not {other[0]}@{other[1]}"
        least = min(told, key=lambda s: s["difference"])
        verdict = "separable" if all(s["separable"] for s in told) else "said to be inseparable"
        print(f"{name:58s} six manoeuvres {before[0]:.2f} {before[1]:.2f}  plan {after[0]:.2f} {after[1]:.2f}  "
              f"predicted {least['difference']:.1f} sigma, {100 * least['share']:.2g} % not bent to, {verdict}",
              flush=True)

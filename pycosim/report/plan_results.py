"""A plan in; ``plan.json``, ``plan.csv`` and sentences an engineer reads, out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..design.identifiability import identifiability
from ..design.motion import Stroke, assemble
from ..design.optimiser import DWELL
from ..design.plan import NOTHING, fast, separations
from ..design.plan import table as sampled
from ..fit.nullspace import number
from .records import SCHEMA, plain
from .thresholds import thresholds


def plan(found):
    """``plan.json``.

    Parameters
    ----------
    found : Plan
        As planned, with what is known of the rig.

    Returns
    -------
    dict
        Beyond what people read, what the motion is made of: of each stroke ``middle`` [rad of each motor], ``travel``
        and ``ramp`` [s], and of the ``ways`` between them the greatest ``speed`` and ``acceleration``, and the
        ``rest`` at each end [s].
    """
    k, motion = found.known, found.motion
    limits, kin = k.workspace.limits, k.workspace.kinematics
    zones = k.workspace.zones
    return plain({
        "schema": SCHEMA, "goal": found.goal, "duration": motion.duration, "budget": found.budget, "rate": found.rate,
        "parameters": _parameters(found), "gain": _gain(found), "rivals": separations(found),
        "identifiability": identifiability(found),
        "held_out": [[a, b] for a, b in motion.held_out],
        "strokes": [_stroke(s, kin, zones) for s in motion.strokes],
        "ways": {**{n: dict(zip(kin.motors, v)) for n, v in zip(("speed", "acceleration"), fast(limits))},
                 "rest": DWELL},
        "limits": {"angles": {n: [a, b] for n, a, b in zip(limits.names, limits.low, limits.high)},
                   "used": {**{f"{m}.w": float(np.abs(motion.speed[i]).max()) for i, m in enumerate(kin.motors)},
                            **{f"{m}.a": float(np.abs(motion.acceleration[i]).max()) for i, m in
                               enumerate(kin.motors)},
                            **({} if found.torque is None else {f"{m}.tau": float(np.abs(found.torque[i]).max())
                                                                for i, m in enumerate(kin.motors)})},
                   "least_distance_to_a_stop": float(k.workspace.margin(motion.angle).min())},
        "noise": {"assumed": k.assumed, "channels": {c: {"white": n.white, "slow": n.slow, "memory": n.memory}
                                                     for c, n in zip(k.asked.channels, k.noise)}},
        "doubts": doubts(found), "thresholds": thresholds("plan")})


def _parameters(found):
    """Every free parameter: its interval now, and how wide it should be after the experiment."""
    k, rows = found.known, {}
    after = replace(found.fit, covariance=found.covariance)
    for n in k.free:
        v = k.model.parameters[n]
        now = k.fit.interval(n) if k.fit is not None else [v.min, v.max]
        low, high = after.interval(n)
        alone = found.fit.interval(n)
        rows[n] = {"value": k.values[n], "unit": v.unit, "ci95_now": now, "width_now": now[1] - now[0],
                   "identifiable_now": k.fit is not None and k.fit.identifiable(n), "width": high - low,
                   "width_of_new_log_alone": alone[1] - alone[0], "identifiable": found.fit.identifiable(n)}
    return rows


def _gain(found):
    """Geometric mean of the intervals after over before, of what is determined before and after."""
    rows = [r for r in _parameters(found).values() if r["identifiable"] and r["identifiable_now"] and r["width_now"]]
    return float(np.exp(np.mean([np.log(r["width"] / r["width_now"]) for r in rows]))) if rows else None


def _stroke(s, kin, zones):
    signs = tuple(np.sign(kin.speed @ s.velocity).astype(int).tolist())
    return {"name": s.name, "cycles": s.cycles, "directions": dict(zip(kin.segments, signs)),
            "zone": next(k for k, z in enumerate(zones) if z.signs == signs),
            "centre": dict(zip(kin.joints or kin.motors, kin.angles(s.centre) if kin.joints else s.centre)),
            "middle": dict(zip(kin.motors, s.centre)), "speed": dict(zip(kin.motors, s.velocity)),
            "travel": s.travel, "ramp": s.ramp, "duration_of_a_way": s.travel + s.ramp}


def doubts(found):
    """What the plan does not know, in sentences.

    Parameters
    ----------
    found : Plan
        As planned, with what is known of the rig.

    Returns
    -------
    list of str
    """
    k, said = found.known, list(found.notes)
    if k.assumed:
        said.append("Nothing was measured yet: the noise is assumed to be 1 % of what each channel ranges over, so the "
                    "predicted widths scale with that guess; the strokes hardly depend on it.")
    if any(e.size and e.scan.get("travel") for e, _ in k.model.attached):
        said.append("Friction states are taken to have settled along every way.")
    said.append("Intervals are those of the fit if the model is right; diagnose the new log before believing them.")
    return said


def table(result):
    """The motion that a plan describes, sample by sample.

    Parameters
    ----------
    result : dict
        ``plan.json``.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        As of `pycosim.design.plan.table`.
    """
    ways, motors = result["ways"], list(result["ways"]["speed"])

    def of(values):
        return np.array([values[m] for m in motors])
    strokes = [Stroke(of(s["middle"]), of(s["speed"]), s["travel"], s["ramp"], s["cycles"], s["name"])
               for s in result["strokes"]]
    return sampled(motors, assemble(strokes, of(ways["speed"]), of(ways["acceleration"]), ways["rest"],
                                    result["rate"]))


def csv(motion):
    """Text of ``plan.csv``: what a scenario's trajectory and a drive read.

    Parameters
    ----------
    motion : dict of str to ndarray, shape (n,)
        Of `table`.

    Returns
    -------
    str
    """
    import pandas as pd
    return pd.DataFrame(motion).to_csv(index=False, float_format="%.9g")


def summary(result):
    """The plan in sentences.

    Parameters
    ----------
    result : dict
        ``plan.json``.

    Returns
    -------
    list of str
    """
    speeds = sorted({round(max(abs(v) for v in s["speed"].values()), 2) for s in result["strokes"]})
    lines = [f"The next experiment takes {result['duration']:.0f} s: {len(result['strokes'])} lines in "
             f"{len({s['zone'] for s in result['strokes']})} zones, "
             f"{sum(s['cycles'] for s in result['strokes'])} times to and fro, at {speeds[0]:g} to {speeds[-1]:g} "
             f"rad/s of the faster motor; {len(result['held_out'])} cycles are held out."]
    for n, p in result["parameters"].items():
        unit = "" if p["unit"] == "1" else f" {p['unit']}"
        now = f"{number(p['width_now'])}{unit} wide now" if p["identifiable_now"] else "open now"
        after = f"{number(p['width'])}{unit} wide after it" if p["identifiable"] else "still open after it"
        lines.append(f"  {n}: 95 % interval {now}, {after}")
    if result["gain"]:
        lines.append(f"Intervals become {1 / result['gain']:.1f} times narrower (geometric mean).")
    for d in result["identifiability"]["now"]:
        lines.append(f"Undetermined so far: {d['text']}. What would free it: {', '.join(d['freed_by'])}.")
    for text in result["identifiability"]["planned"]:
        lines.append(f"Left undetermined: {text}.")
    loss = result["identifiability"]["channels"].get("loss")
    if loss:
        lines.append(f"Without a reference of the joint torques, this motion gives intervals {loss:.2g} times as wide "
                     "as with one, over what both determine.")
    alone = [s for s in result["rivals"] if s["other"] == NOTHING]
    lines += [_told(s) for s in result["rivals"] if s not in alone]
    return lines + _shown(alone) + result["doubts"]


def _shown(alone):
    """Which effects of their nominal size the motion shows, the clearest first, and which it does not."""
    lines, ranked = [], sorted(alone, key=lambda s: -s["difference"])
    clear = [f"{_at(s['true'])} ({s['difference']:.3g})" for s in ranked if s["separable"]]
    slow = [f"{_at(s['true'])} (about {_lasting(s['time'])})" for s in ranked
            if not s["separable"] and s["time"] is not None]
    never = [_at(s["true"]) for s in ranked if not s["separable"] and s["time"] is None]
    if clear:
        lines.append("It shows these effects, each of the size that its file calls nominal (in brackets by how many "
                     f"standard deviations of the noise a model without it would miss): {', '.join(clear)}.")
    if slow:
        lines.append("It is too short to show these of that size (in brackets how much of such motion would): "
                     f"{', '.join(slow)}.")
    if never:
        lines.append("No motion that was found within the limits shows these: beside them the other parameters bend "
                     f"until the torques are the same: {', '.join(never)}.")
    return lines


def _told(s):
    true, other = _at(s["true"]), _at(s["other"])
    if s["separable"]:
        return (f"If {true} is true, {other} would miss by {s['difference']:.1f} standard deviations of the "
                "noise: they can be told apart.")
    why = ("the one can bend to the other: the same torque on every motion that was found within the limits"
           if s["time"] is None else "the difference is smaller than the noise within this budget; about "
           f"{_lasting(s['time'])} of such motion would tell")
    return f"{true} and {other} stay alike, {s['difference']:.1f} standard deviations apart: {why}."


def _lasting(seconds):
    """A time as people say it: seconds to ten minutes, then minutes, beyond three hours hours."""
    size, unit = (1, "s") if seconds < 600 else (60, "min") if seconds < 3 * 3600 else (3600, "h")
    return f"{seconds / size:.0f} {unit}" if seconds >= 10 else f"{number(seconds)} s"


def _at(name):
    """An effect and its place as every sentence has them; with an @ between they are a name to type."""
    return name.replace("@", " at ")

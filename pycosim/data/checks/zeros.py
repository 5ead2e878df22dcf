"""Angles and what the load weighs in; angles whose zero is elsewhere than the rig's, out."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np

from .finding import QUESTION, Finding, column_line

_VISIBLE = 0.0035
"""rad, a fifth of a degree: less is no mounting error that anybody would correct."""
_STEPS = 3.0  # of the readings
_BETTER = 1.5  # factor by which the weight must be told better with another zero
_ALIKE = 2.0  # factor within which the motors and the weight must agree on the offset of a reference
_FAR = 0.05  # relative error from which a motor may have been switched on anywhere
_ROUND, _TURNED = 8, 2  # starts round the turn of a joint, and zeros that are looked for all round
_LOWERED = 1.05  # factor by which what the study compares must be told better with another zero of a motor


def encoder_zeros(readings, sources, relations, columns):
    """Joint encoders that read another angle than the motors say.

    Parameters
    ----------
    readings : Readings
        At few enough samples to fit the model anew with each zero.
    sources : dict of str to Source
        How each variable is read, mistakes undone.
    relations : list
        `ModelRelation` and `RateRelation` that the columns are held against.
    columns : Columns
        Name the columns of the variables in the findings.

    Returns
    -------
    list of Finding
    """
    found = []
    for relation in relations:
        if not getattr(relation, "level", False):
            continue
        name = relation.channels[0]
        predicted = relation.predict(readings, sources, relation.given[relation.at])[0]
        off = relation.measured(readings, sources)[0] - predicted
        zero, scatter = float(np.median(off)), float(1.4826 * np.median(np.abs(off - np.median(off))))
        if abs(zero) < max(_VISIBLE, _STEPS * scatter):
            continue
        column = columns.column(name)
        text = (f"{columns.of(name)} reads {zero:.4g} rad ({math.degrees(zero):.3g} degrees) where the motors say zero")
        found.append(Finding("zero", text, [columns.of(name)], 0.9, {name: abs(zero)}, {name: scatter},
                             column_line(columns.of(name), _zeroed(column, zero))))
    return found


def _zeroed(column, zero):
    """The column with another zero, given in SI."""
    factor = float(column.si(np.array([1.0]))[0] - column.si(np.array([0.0]))[0])
    return replace(column, zero=column.zero + zero / factor)


def reference_offsets(readings, sources, relations, holds, columns):
    """References that are off by a constant, wherever the motors and the load's weight both say so.

    Parameters
    ----------
    readings : Readings
        At few enough samples to fit the model anew with each zero.
    sources : dict of str to Source
        How each variable is read, mistakes undone.
    relations : list
        `ModelRelation` and `RateRelation` that the columns are held against.
    holds : dict of int to Agreement
        How well each relation holds, by its place in the list.
    columns : Columns
        Name the columns of the variables in the findings.

    Returns
    -------
    list of Finding
    """
    found, compared = [], _compared(relations)
    told = {} if compared is None else _offsets(relations[compared], readings, sources, holds[compared])
    for k, relation in enumerate(relations):
        if getattr(relation, "name", "") != "weight" or not relation.free:
            continue
        there = relation.hold(readings, sources, holds[k].x, offset=True)
        for channel, offset in zip(relation.channels, relation.offsets):
            column, old, new = columns.column(channel), holds[k], there
            if not 1 / _ALIKE < told.get(channel, offset) / (offset or 1.0) < _ALIKE:
                continue
            ratio = old.smooth[channel] / max(new.smooth[channel], 1e-9)
            if ratio < _BETTER or old.smooth[channel] < 0.003 or abs(offset) < 2 * new.error[channel] or column is None:
                continue
            text = (f"{columns.of(channel)} is off by {offset:.4g} {column.dimension}, as the load's weight tells: "
                    f"{old.error[channel]:.3g} -> {new.error[channel]:.3g}")
            found.append(Finding("zero", text, [columns.of(channel)], min(0.9, 1 - 0.5 / ratio),
                                 {channel: old.error[channel]}, {channel: new.error[channel]},
                                 column_line(columns.of(channel), _zeroed(column, offset))))
    return found


def _compared(relations):
    """Place of the study's own comparison."""
    return next((k for k, r in enumerate(relations) if getattr(r, "name", "") == "estimate"), None)


def _offsets(relation, readings, sources, hold):
    """Constants that the motors' torques put into each channel."""
    relation.hold(readings, sources, hold.x, offset=True)
    return dict(zip(relation.channels, relation.offsets))


def _of_motors(relation, model):
    """Parameter by the angle of the motor whose zero it is."""
    zeros = {f"{c}.phi": f"{c}.zero" for c in model.components("signal")}
    return {a: p for a, p in zeros.items() if p in relation.names}


def turned(relation, readings, sources, model, ratios, far=True):
    """What the load weighs, with the zeros of the motors where it is told best, however far off.

    An encoder that counts from where it was switched on may be off by any angle. The weight goes round with the joint,
    so that starts all round its turn find the nearest zero.

    Parameters
    ----------
    relation : ModelRelation
        Of the weight of the load.
    readings : Readings
        At few enough samples to fit the model anew from each start.
    sources : dict of str to Source
        How each variable is read.
    model : Model
        The rig; its signals have the zeros.
    ratios : dict of str to float
        Gear ratios of the model, by parameter.
    far : bool
        Whether they may be far off.

    Returns
    -------
    agreement : Agreement
    values : dict of str to float
        Zero [rad] by the motor's angle, from the study's one; empty where the rig has no such zeros.
    """
    zeros = _of_motors(relation, model)
    freed = relation.freed(list(zeros.values()))
    at = [freed.free.index(p) for p in zeros.values()]
    given = freed.given[freed.at]
    turn = 2 * math.pi * max(ratios.values(), default=1.0)
    freed.low[at], freed.high[at] = given[at] - turn, given[at] + turn
    found = []
    around = np.arange(_ROUND) / _ROUND - 0.5 if far else (0.0,)
    for steps in itertools.product(around, repeat=min(len(at), _TURNED)):
        start = given.copy()
        start[at[:len(steps)]] += turn * np.array(steps)
        found.append(freed.hold(readings, sources, start))
    best = min(found, key=lambda a: sum(a.relative.values()))
    return best, {a: float(best.x[k] - given[k]) for a, k in zip(zeros, at)}


def motor_zeros(readings, sources, relations, k, holds, columns, model, ratios):
    """Motor angles whose zero the weight of the load shows.

    Where the mend changes nothing of what the study compares, it is a question without one.

    Parameters
    ----------
    readings : Readings
        At few enough samples to fit the model anew with each zero.
    sources : dict of str to Source
        How each variable is read, mistakes undone.
    relations : list
        `ModelRelation` and `RateRelation` that the columns are held against.
    k : int
        Place of the weight of the load against the reference.
    holds : dict of int to Agreement
        How well each relation holds with the zeros as the study has them.
    columns : Columns
        Name the columns of the variables in the findings.
    model : Model
        The rig; its signals have the zeros.
    ratios : dict of str to float
        Gear ratios of the model, by parameter.

    Returns
    -------
    list of Finding
    """
    relation, hold = relations[k], holds[k]
    zeros = _of_motors(relation, model)
    if not zeros or max(hold.relative.values()) < 0.01:
        return []
    there, moved = turned(relation, readings, sources, model, ratios, max(hold.relative.values()) > _FAR)
    ratio = max(hold.relative[c] / max(there.relative[c], 1e-9) for c in hold.relative)
    if ratio < _BETTER:
        return []
    found, compared = [], _compared(relations)
    values = {p: moved[a] + relation.given[relation.names.index(p)] for a, p in zeros.items()}
    helps = compared is None or _lowered(relations[compared], readings, sources, holds[compared], values)
    for angle, value in moved.items():
        column = columns.column(angle)
        if abs(value) < _VISIBLE or column is None:
            continue
        text = (f"{columns.of(angle)} reads {value:.4g} rad at the angle that the load's weight calls zero: "
                + ", ".join(f"{columns.of(c)} {hold.error[c]:.3g} -> {there.error[c]:.3g}" for c in hold.error))
        sure = min(0.85, 1 - 1 / ratio) * (1.0 if helps else 0.5)
        mend = column_line(columns.of(angle), _zeroed(column, value)) if helps and sure >= QUESTION else ""
        found.append(Finding("zero", text, [columns.of(angle)], sure, dict(hold.error), dict(there.error), mend))
    return found


def _lowered(relation, readings, sources, hold, values):
    """Whether the study's own comparison is better with other values of some parameters."""
    mended = relation.freed([])
    for name in set(values) & set(mended.names):
        mended.given[mended.names.index(name)] = values[name]
    there = mended.hold(readings, sources, hold.x)
    return any(hold.error[c] > _LOWERED * there.error[c] for c in hold.error)

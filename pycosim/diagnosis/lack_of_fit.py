"""A residual that no effect explains in; where it lives, as a map, and the shape that would explain most, out.

The shape is a guess, and said to be one: friction added to one segment, of one sign and so always dissipative, in N.m,
over one variable that an effect can read. It can be written as an effect of the user's own, to be tried like any other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..compile import catalogue, places
from ..core.errors import StudyError
from ..fit.least_squares import invert
from ..fit.nullspace import number
from .compare import unit_of
from .dependence import explanations

CELLS = 12
SAMPLES = 6000  # that shapes are compared on
EXACT = 1e-3  # of a variable's spread: what an expression may miss of it, rounding of two encoders
ENOUGH = 0.1  # of the energy beyond noise that a shape must explain on folds it was not fitted to


@dataclass(frozen=True)
class Shape:
    """A shape over one variable, between 0 and 1.

    Attributes
    ----------
    text : str
        In words, with ``{x}`` for the variable.
    modelica : str
        Expression, with ``{x}`` for the variable.
    values : callable
        Of an ndarray.
    """

    text: str
    modelica: str
    values: object


def shapes(values, unit):
    """Shapes to try over a variable, placed where the data are.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Of the variable, at the samples that are fitted.
    unit : str
        Of the variable, for a shape's words.

    Returns
    -------
    list of Shape
    """
    low, high = np.quantile(values, [0.01, 0.99])
    span, found = high - low, []
    for width in span * np.array([0.04, 0.08, 0.16, 0.3]):
        for centre in np.arange(low, high + width / 2, width):
            found.append(Shape(f"a hump of width {number(width)} {unit} about {{x}} = {number(centre)} {unit}",
                               f"exp(-((({{x}}) - ({centre:.6g})) / {width:.6g})^2)",
                               lambda x, c=centre, w=width: np.exp(-((x - c) / w) ** 2)))
    for edge in np.linspace(low, high, 9)[1:-1]:
        width = span / 40
        for sign, word in ((1, "above"), (-1, "below")):
            found.append(Shape(f"a step {word} {{x}} = {number(edge)} {unit}",
                               f"(1 + tanh({sign} * (({{x}}) - ({edge:.6g})) / {width:.6g})) / 2",
                               lambda x, e=edge, w=width, s=sign: (1 + np.tanh(s * (x - e) / w)) / 2))
    if low < 0 < high:
        largest = max(-low, high)
        for power in (1, 2):
            grows = "in proportion to" if power == 1 else "with the square of"
            found.append(Shape(f"friction that rises {grows} the magnitude of {{x}}",
                               f"(abs({{x}}) / {largest:.6g})^{power}",
                               lambda x, p=power: (np.abs(x) / largest) ** p))
    for sign, start, word in ((1, low, "rises"), (-1, high, "falls")):
        for power in (1, 2):
            grows = "in proportion to" if power == 1 else "with the square of"
            found.append(Shape(
                f"friction that {word} {grows} the distance of {{x}} from {number(start)} {unit}",
                f"(max(0, {sign} * (({{x}}) - ({start:.6g}))) / {span:.6g})^{power}",
                lambda x, s=sign, b=start, p=power: (np.maximum(0.0, s * (x - b)) / span) ** p))
    return found


def unexplained(table, depends, floor):
    """Where the residual lives, and what might explain it.

    Parameters
    ----------
    table : Table
        Of the fitted model whose residual is looked at.
    depends : list of dict
        Of `dependence`.
    floor : dict of str to float
        Noise floor of each channel.

    Returns
    -------
    dict
        ``share`` of the residual's energy beyond the noise, ``map``, ``proposal`` and ``free``, as in
        ``diagnosis.json``.
    """
    dataset, thin = table.dataset, table.thin
    view = dataset.view("fit")
    index = (view.i if dataset.paired else view)[::thin]
    known = explanations(dataset, table.model, table.fit, index)
    error = table.fit.error
    worst = max(error, key=lambda c: error[c] / floor[c] if floor[c] > 0 else 0.0)
    share = max(0.0, 1 - (floor[worst] / error[worst]) ** 2) if error[worst] > 0 else 0.0
    return {"share": share, "channel": worst,
            "map": _map(table.residual[table.channels.index(worst)], known, depends),
            "proposal": _proposal(table, known, depends, share, index), "free": _free(table, depends, share)}


def _map(residual, known, depends):
    """Mean residual and share of its energy over the strongest variable and the next that does not follow from it."""
    names = [d["variable"] for d in depends if d["variable"] in known]
    if not names:
        return None
    x = names[0]
    y = next((n for n in names[1:] if _ties(known[x], known[n]) < 0.9), None)
    if y is None:
        return None
    edges = [np.linspace(v.min(), v.max(), CELLS + 1) for v in (known[x], known[y])]
    count, *_ = np.histogram2d(known[x], known[y], edges)
    sums, squares = (np.histogram2d(known[x], known[y], edges, weights=w)[0] for w in (residual, residual ** 2))
    mean = np.where(count > 0, sums / np.maximum(count, 1), np.nan)
    return {"x": x, "y": y, "x_edges": edges[0], "y_edges": edges[1], "mean": mean.T,
            "energy": squares.T / squares.sum()}


def _ties(a, b):
    """Correlation of the ranks of two variables, and of their magnitudes."""
    ranks = [np.argsort(np.argsort(v)) for v in (a, b, np.abs(a), np.abs(b))]
    return max(abs(np.corrcoef(ranks[0], ranks[1])[0, 1]), abs(np.corrcoef(ranks[2], ranks[3])[0, 1]))


def _proposal(table, known, depends, share, index):
    """The shape that explains most on folds that it was not fitted to; None where none explains enough."""
    few = slice(None, None, max(1, len(table.time) // SAMPLES))
    drives = {place: _drive(table, component)[:, few] for component, place in table.model.segments.items()}
    base, residual, fold = table.slope[:, :, few], table.residual[:, few], _folds(table, few)
    best = None
    angle, torque = table.model.along("rad"), table.model.along("N.m")
    causes = {n for n in known if "@" in n or n.startswith("time") or unit_of(table.dataset, n) == angle}
    for name in [d["variable"] for d in depends if d["strength"] > 0 and d["variable"] in causes][:8]:
        values, owner = known[name][few], name.partition("@")[2]
        forms = shapes(values, unit_of(table.dataset, name))
        basis = np.array([f.values(values) for f in forms])
        for place, drive in drives.items():
            if owner not in ("", place):
                continue
            gain = _gain(_moments(basis, drive, base, residual, table.fit.weights, fold))
            k = int(np.argmax(gain))
            if best is None or gain[k] > best[0]:
                best = gain[k], place, name, forms[k], basis[k] * drive, values
    if best is None or share <= 0 or best[0] < ENOUGH * share:
        return None
    gain, place, name, form, column, values = best
    size = _sizes(_moments(np.ones((1, len(fold))), column, base, residual, table.fit.weights, fold))[0][0]
    told = form.text.format(x=name)
    return {"text": f"A guess: {number(size)} {torque} more friction at {place}, as {told}; it would take "
                    f"{100 * gain:.0f} % of the residual's energy on passes that it was not fitted to.",
            "equation": f"F += {number(size)} * {form.modelica.format(x=name)}", "place": place, "variable": name,
            "share": float(gain), "value": float(size),
            "file": _file(table, form, place, name, values, size, index[few])}


def _free(table, depends, share):
    """The free function of an angle that explains most on folds that it was not fitted to; None where none does.

    Such an effect names no cause and stands in no ranking; where a residual follows an angle and nothing else explains
    it, it is what can still be done.
    """
    angle, study = table.model.along("rad"), table.dataset.study
    if share <= 0 or not any(d["strength"] > 0 and "@" not in d["variable"]
                             and unit_of(table.dataset, d["variable"]) == angle for d in depends):
        return None
    few = slice(None, None, max(1, len(table.time) // SAMPLES))
    base, residual, fold = table.slope[:, :, few], table.residual[:, few], _folds(table, few)
    found = []
    for effect in (e for e in catalogue(table.library).values() if e.by_name):
        for place in places(table.library, table.model.rig, effect):
            if len(place.components) > 1 or study.rules_out(effect.id, place.name) or table._missing(effect, place):
                continue
            try:
                columns = table.column(table.contribution(effect), place.components[0], {})[..., few]
            except StudyError:  # nothing moves there
                continue
            found.append((_taken(columns, base, residual, table.fit.weights, fold), effect.id, place.name))
    gain, effect, place = max(found, default=(0.0, "", ""))
    if gain <= ENOUGH * share:
        return None
    file = study.path.name if table.model.keys == study.effects else "study.toml"  # of the results: with what was added
    return {"effect": effect, "place": place, "share": float(gain), "text":
            f"What is left follows an angle, and {effect} at {place}, a free function of it that names no cause, would "
            f"take {100 * gain:.0f} % of the residual's energy on passes that it was not fitted to: "
            f"'pycosim add {file} {effect}@{place}' adds it."}


def _folds(table, few):
    """Fold of some samples of a table."""
    blocks, label = np.unique(table.block[few], return_inverse=True)
    return table.dataset.fold[blocks][label]


def _taken(columns, base, residual, weights, fold):
    """Share of the residual's energy that several columns together take on folds that their sizes do not come from."""
    w = np.asarray(weights)[:, None]
    rows, r, left = np.concatenate([base.transpose(1, 0, 2), columns]) * w, w * residual, [0.0, 0.0]
    for f in np.unique(fold):
        inside = fold == f
        for k, some in enumerate((rows[:base.shape[1]], rows)):
            flat = some[:, :, ~inside].reshape(len(some), -1)
            size = invert(flat @ flat.T)[0] @ (flat @ r[:, ~inside].ravel())
            left[k] += float(((r[:, inside] - np.tensordot(size, some[:, :, inside], 1)) ** 2).sum())
    return 1 - left[1] / max(left[0], 1e-300)


def _drive(table, component):
    """Change of the channels with friction at a segment."""
    probe = table.probes.index(f"probe_{component}.dF")
    return sum(r[:, probe] for r in table.responses)


def _moments(basis, drive, base, residual, weights, fold):
    """Products of base and residual, of each shape with both, and of it with itself; fold by fold.

    A shape is the same in all channels but for what the drive makes of it, so that it meets their sum alone.
    """
    w = np.asarray(weights)[:, None]
    rows = np.concatenate([base.transpose(1, 0, 2), residual[None]]) * w
    driven, squares, found = (rows * (w * drive)).sum(1), ((w * drive) ** 2).sum(0), []
    for f in np.unique(fold):
        inside = fold == f
        flat, shape = rows[:, :, inside].reshape(len(rows), -1), basis[:, inside]
        found.append((flat @ flat.T, shape @ driven[:, inside].T, shape ** 2 @ squares[inside]))
    return found


def _sizes(moments):
    """Size of each shape that fits best beside the base parameters, never negative; and what of it these take up."""
    given, cross, own = (sum(m) for m in zip(*moments))
    taken_up = cross[:, :-1] @ invert(given[:-1, :-1])[0]
    left = own - np.einsum("ij,ij->i", taken_up, cross[:, :-1])
    score = cross[:, -1] - taken_up @ given[:-1, -1]
    return np.where(left > 1e-9 * own, np.maximum(score, 0) / np.maximum(left, 1e-300), 0), taken_up


def _gain(moments):
    """Share of the residual's energy that each shape takes on folds that its size does not come from."""
    taken = np.zeros(len(moments[0][-1]))
    for k, (given, cross, own) in enumerate(moments if len(moments) > 1 else ()):
        size, taken_up = _sizes(moments[:k] + moments[k + 1:])
        left = own + np.einsum("ij,ij->i", taken_up @ given[:-1, :-1] - 2 * cross[:, :-1], taken_up)
        taken += 2 * size * (cross[:, -1] - taken_up @ given[:-1, -1]) - size ** 2 * left
    return taken / sum(given[-1, -1] for given, *_ in moments)


def _readable(table, place, name, values, few):
    """How a segment's effect reads a variable: declarations and an expression; None where it cannot.

    An angle is read from the segment's own where it goes with that, else through the rig's variables.
    """
    ports = {"speed": "friction.w", "load": "friction.L", "time": "time"}
    kind = name.partition("@")[0]
    if kind in ports:
        return "", ports[kind]
    component = next(c for c, p in table.model.segments.items() if p == place)
    own = table.full.get(f"{component}.friction.phi")
    if own is not None and unit_of(table.dataset, name) == table.model.along("rad"):
        slope, offset = np.polyfit(own[few], values, 1) if np.ptp(own[few]) > 0 else (0.0, 0.0)
        if np.std(values - slope * own[few] - offset) <= EXACT * np.std(values):
            factor = "" if abs(slope - 1) <= EXACT else f"({slope:.6g}) * "
            shift = "" if abs(offset) <= EXACT * np.std(values) else f" + ({offset:.6g})"
            return "", f"{factor}friction.phi{shift}"
    rig = {n: table.full[n][few] for n in table.full if "." not in n and n in table.model.variables
           and isinstance(table.full[n], np.ndarray) and n != name}
    if not rig or unit_of(table.dataset, name) != table.model.along("rad"):
        return None
    columns = np.array([*rig.values(), np.ones(len(values))])
    factor = np.linalg.lstsq(columns.T, values, rcond=None)[0]
    if np.std(values - factor @ columns) > EXACT * np.std(values):
        return None
    used = {n: f for n, f in zip(rig, factor) if abs(f) * np.std(rig[n]) > EXACT * np.std(values)}
    declared = "".join(f'  input Real {n}(unit="{table.model.variables[n].unit}");\n' for n in used)
    return declared, " + ".join([*(f"({f:.6g}) * {n}" for n, f in used.items()), f"({factor[-1]:.6g})"])


def _file(table, form, place, name, values, size, few):
    """Modelica of the guess as an effect of the user's own; None where an effect cannot read the variable."""
    read = _readable(table, place, name, values, few)
    if read is None:
        return None
    declared, expression = read
    limits = f"min=0, max={100 * size:.3g}, nominal={size:.3g}"
    return f'''model Guess "Friction of a shape guessed from a residual over {name}; not a known effect"
  extends DriveTrain.Interfaces.SegmentEffect(
    dF=A * {form.modelica.format(x=expression)});
{declared}  parameter Real A(unit="N.m", {limits}) = 0 "Size of the guess";
  annotation(__pycosim(size="A", experiment="pass the same {name} slowly, several times, both ways"));
end Guess;
'''

"""A model in; a drawing of its drive train as SVG, its places named, marked or coloured by a value, out.

The layout follows the graph of connections: motors first, what they drive after them, frames as hatching under what
they carry. Colours are those of whoever shows the drawing (``currentColor`` and the page's own variables); what is
marked has a thicker line and words as well, and what is coloured carries its number.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from ..compile.effects import component_name
from ..compile.wiring import wiring
from ..core.errors import UnknownNameError, closest
from ..fit.nullspace import number

HEIGHT, ROW, GAP = 42, 100, 26  # of a box, from row to row, and between boxes [px]
NARROWEST, WIDEST, LETTER, SMALL = 92, 150, 7.8, 5.9  # of a box, and of a letter of a name and of a kind [px]
BESIDE, AFTER = 36, 8  # room for a box's sign, and after its words [px]
MARGIN, ELBOW, RAIL = 12, GAP / 2, 38  # around all, before a box where a line turns, and below one [px]
LOW, HIGH = 0.08, 0.42  # opacity of the colour of the least and the largest value: ink stays readable on both
PALE = 0.12  # opacity of the colour of what is marked
SWEEPS = 5  # over the layers, to put each part beside what it is connected with; the last follows the flow of power
THIN = 0.5  # room that a line needs beside a box, of a row
SNAP = 4  # positions of boxes across the flow, a row
APART = 14  # between connections that enter the same box [px]
LIGHT = 0.05  # weight of what carries no power, where a box is put
WORDS = {"beside": "on the link", "difference": "relative angle", "part": ""}
HIDDEN = "frame", "outside", "effect", "beside"  # not boxes in the flow of power
PAPER, ACCENT, TINT, MUTED = "var(--paper,#fff)", "var(--bad,#b04a00)", "var(--link,#005a94)", "var(--muted,#5d6670)"


@dataclass
class _Box:
    """One box of the drawing, or (without words) a bend of a line that passes a layer."""

    name: str
    kind: str = ""
    title: str = ""
    components: tuple = ()
    layer: int = 0
    lane: float = 0.0
    notes: list = field(default_factory=list)
    grounded: bool = False


@dataclass
class _Mark:
    """Words beside a place, and whether it is one among others that may be meant."""

    text: str
    other: bool = False


def schematic(model, highlight=None, values=None, unit="", down=False, also=None):
    """Draw a drive train.

    Parameters
    ----------
    model : Model
        A rig with its effects, which are named under the places where they act.
    highlight : str or dict of str to str, optional
        Place to mark, as ``2A``, ``motor1`` or ``1A+2A``; or places and the words beside each.
    values : dict of str to float, optional
        By place: coloured by size, and written under it.
    unit : str
        Of the values.
    down : bool
        From top to bottom, for narrow screens; else from left to right.
    also : dict of str to str, optional
        Further places with the words beside each, marked less: where else it could be.

    Returns
    -------
    str
        An ``<svg>`` element; put it into a page as it is. Names are escaped.

    Raises
    ------
    UnknownNameError
        A place that the rig does not have.
    """
    marked = {highlight: ""} if isinstance(highlight, str) else dict(highlight or {})
    parts = wiring(model.library, model.rig)
    boxes, edges = _graph(model, parts, {*marked, *(values or {}), *(also or {})})
    _layers(boxes, edges)
    edges = _bends(boxes, edges)
    _lanes(boxes, edges)
    marks, sizes, others = ({c: v for place, v in told.items() for c in components(model, place)}
                            for told in (marked, values or {}, also or {}))
    marks = {**{c: _Mark(text, True) for c, text in others.items()}, **{c: _Mark(t) for c, t in marks.items()}}
    return _svg(model, boxes, edges, marks, sizes, unit, down)


def components(model, place):
    """Components of a rig that a place stands for.

    Parameters
    ----------
    model : Model
        Of the rig that is drawn.
    place : str
        As ``1A``, ``1A+2A``, ``knee``, ``system`` or the name of a channel.

    Returns
    -------
    tuple of str

    Raises
    ------
    UnknownNameError
        The rig has no such place.
    """
    if place == "system":
        return tuple(model.segments)
    groups = model.aliases("channels")
    if place in groups:
        return tuple(groups[place].split("+"))
    parts, known = wiring(model.library, model.rig).parts, _places(model)
    found = []
    for name in place.split("+"):
        own = [c for c, p in known.items() if p == name] or [c for c in (name,) if c in parts]
        if not own:
            raise UnknownNameError(f"no place '{name}' in {model.rig}{closest(name, [*known.values(), *parts])}")
        found += own
    return tuple(found)


def _places(model):
    """Names of places by component, where the rig's annotation gives them."""
    return {c: p for p, c in (pair.split("=") for pair in model.notes.get("places", "").split())}


def component_of(model, channel):
    """Component whose variable a channel is.

    Parameters
    ----------
    model : Model
        Of the rig that is drawn.
    channel : str
        As ``C_H``, ``tau``, ``motor.tau`` or ``C_H_pair``.

    Returns
    -------
    str or None
        None where the rig's equations do not say.
    """
    found, name = wiring(model.library, model.rig), channel.removesuffix("_pair")
    head = name.partition(".")[0]
    return head if head in found.parts else found.signals.get(name)


def upstream(model, place):
    """Motors that drive a place.

    Parameters
    ----------
    model : Model
        Of the rig that is drawn.
    place : str
        As ``2A`` or ``joint``.

    Returns
    -------
    list of str
        Components; all motors of the rig where none is before the place.
    """
    boxes, edges = _graph(model, wiring(model.library, model.rig), ())
    before = {}
    for a, b, *_ in edges:
        before.setdefault(b, set()).add(a)
    seen, ahead = set(), [c for c in components(model, place) if c in boxes]
    while ahead:
        name = ahead.pop()
        ahead += [n for n in before.get(name, ()) if n not in seen]
        seen.add(name)
    motors = [n for n, box in boxes.items() if box.kind == "motor"]
    return [m for m in motors if m in seen] or motors


def named(model, channels):
    """Values of channels as values of the places that they are measured at.

    Parameters
    ----------
    model : Model
        Of the rig that is drawn.
    channels : dict of str to float
        A value of each, as its error.

    Returns
    -------
    dict of str to float
        By place; channels that no component has are left out, the larger of two at one place stays.
    """
    found, known = {}, _places(model)
    for channel, value in channels.items():
        component = component_of(model, channel)
        if component is not None and value is not None:
            place = known.get(component, component)
            found[place] = max(found.get(place, 0.0), value)
    return found


def marked(model, effects, alternatives=()):
    """What `schematic` takes to mark where effects act, and less, where else it could be.

    Parameters
    ----------
    model : Model
        Of the rig that is drawn.
    effects, alternatives : sequence of (str, str)
        Effects and places.

    Returns
    -------
    dict
        ``highlight`` and ``also``.
    """
    marks, others = {}, {}
    for told, keys in ((marks, effects), (others, alternatives)):
        for effect, place in keys:
            for name in components(model, place):
                told.setdefault(name, []).append(effect.replace("_", " "))
    return {"highlight": {n: _few(some) for n, some in marks.items()},
            "also": {n: f"or {_few(some)}" for n, some in others.items()}}


def _few(names):
    """One name, or how many there are."""
    different = list(dict.fromkeys(names))
    return different[0] if len(different) == 1 else f"{len(different)} effects"


def coloured(model, error, units):
    """What `schematic` takes to colour places by the errors measured there.

    Parameters
    ----------
    model : Model
        Of the rig that is drawn.
    error : dict of str to float
        By channel.
    units : dict of str to str
        Of the channels.

    Returns
    -------
    dict
        ``values`` and ``unit``: of the channels in the unit that most have, as errors in N.m and in rad do not compare.
    """
    kinds = [units[c] for c in error]
    unit = max(dict.fromkeys(kinds), key=kinds.count, default="")
    return {"values": named(model, {c: v for c, v in error.items() if units[c] == unit}),
            "unit": "" if unit == "1" else unit}


# --- graph ----------------------------------------------------------------------------------------------------------


def _graph(model, found, asked):
    """Boxes by name, and edges (from, to, connection, or None where it carries no power on)."""
    known = _places(model)
    boxes = {n: _Box(known.get(n, n), p.kind, p.description, (n,)) for n, p in found.parts.items()
             if p.kind not in HIDDEN}
    frames = {n for n, p in found.parts.items() if p.kind == "frame"}
    edges = []
    for k, net in enumerate(found.nets):
        grounded = any(c in frames for c, _ in net)
        shown = [(c, port) for c, port in net if c in boxes]
        if grounded:
            for c, _ in shown:
                boxes[c].grounded = True
        else:
            edges += _flow(shown, found.parts, k)
    _beside(boxes, edges, found, known, asked)
    _name_effects(model, boxes, found)
    return boxes, list(dict.fromkeys(edges))


def _flow(net, parts, which):
    """Edges of one connection: from what drives to what is driven; supports hang on what carries them."""
    def gives(component, port):
        return port in ("flange_b", "joint") or (parts[component].kind == "motor")
    supports = [c for c, port in net if port == "support" and parts[c].kind != "difference"]
    rest = [(c, port) for c, port in net if c not in supports]
    sources = [c for c, port in rest if gives(c, port)]
    sinks = [c for c, port in rest if not gives(c, port)]
    if not sources and rest and not supports:  # ports of a user's own components: in the order of their declaration
        sources, sinks = [rest[0][0]], [c for c, _ in rest[1:]]
    if not sinks and len(sources) > 1:
        sources, sinks = sources[:1], sources[1:]
    return ([(a, b, which) for a in sources for b in sinks]
            + [(s, b, None) for s in supports for b in sinks or sources])


def _beside(boxes, edges, found, known, asked):
    """What hangs on a link, one box a place: only places that are asked for, so that the drawing stays readable."""
    wanted = {name for place in asked for name in place.split("+")}
    for name, part in found.parts.items():
        place = known.get(name, name)
        if part.kind != "beside" or place not in wanted:
            continue
        box = boxes.setdefault(f"beside {place}", _Box(place, "beside", part.description))
        box.components += (name,)
        edges += [(other, f"beside {place}", None) for pair in found.beside
                  for (own, _), (other, _) in (pair, pair[::-1]) if own == name and other in boxes]


def _name_effects(model, boxes, found):
    """Effects of the base model and of the study, under the places where they act."""
    for (a, _), (b, _) in found.beside:
        for own, other in ((a, b), (b, a)):
            part = found.parts.get(own)
            if part is not None and part.kind == "effect" and other in boxes:
                note = own.removesuffix(f"_{other}").replace("_", " ")
                if note not in boxes[other].notes:
                    boxes[other].notes.append(note)
    owners = {c: box for box in boxes.values() for c in box.components}
    for effect, place in model.attached:
        for c in place.components:
            if c in owners and component_name(effect, place) not in found.parts:
                owners[c].notes.append(effect.id.replace("_", " "))


# --- layout ---------------------------------------------------------------------------------------------------------


def _layers(boxes, edges):
    """Layer of each box: the longest way from a motor; loops are cut where they close."""
    after = {}
    for a, b, _ in edges:
        after.setdefault(a, []).append(b)

    def place(name, layer, way):
        box = boxes[name]
        if name in way or (layer <= box.layer and way):
            return
        box.layer = max(box.layer, layer)
        for other in after.get(name, ()):
            place(other, box.layer + 1, way | {name})

    reached = {b for _, b, _ in edges}
    for name, box in boxes.items():
        if box.kind == "motor" or name not in reached:
            place(name, 0, frozenset())
    for name, box in boxes.items():  # a spring or a second load stands just before what it acts on
        if box.kind != "motor" and name not in reached and after.get(name):
            box.layer = max(0, min(boxes[b].layer for b in after[name]) - 1)


def _bends(boxes, edges):
    """Edges as chains from layer to layer; power that passes layers gets a bend in each."""
    found = []
    for k, (a, b, net) in enumerate(edges):
        chain = [a]
        for layer in () if net is None else range(boxes[a].layer + 1, boxes[b].layer):
            name = f"bend {k} {layer}"
            boxes[name] = _Box("", layer=layer)
            chain.append(name)
        found.append((*chain, b, net))
    return found


def _lanes(boxes, edges):
    """Lane of each box: near what it is connected with, with room for its neighbours."""
    neighbours = {}
    for *chain, net in edges:
        for a, b in zip(chain, chain[1:]):
            weight = LIGHT if net is None else 1.0
            neighbours.setdefault(b, ([], []))[0].append((a, weight))
            neighbours.setdefault(a, ([], []))[1].append((b, weight))
    last = max((b.layer for b in boxes.values()), default=0)
    layers = [[n for n in boxes if boxes[n].layer == k] for k in range(last + 1)]
    for k, name in enumerate(layers[0]):
        boxes[name].lane = float(k)
    for sweep in range(SWEEPS):
        forth = sweep % 2 == 0
        for layer in (layers[1:] if forth else layers[-2:0:-1]):
            wish = {}
            for name in layer:
                near = neighbours.get(name, ([], []))[0 if forth else 1]
                total = sum(w for _, w in near)
                wish[name] = sum(w * boxes[o].lane for o, w in near) / total if near else boxes[name].lane
            _spread(boxes, sorted(layer, key=wish.get), wish)
    least = min((b.lane for b in boxes.values()), default=0.0)
    for box in boxes.values():
        box.lane = round((box.lane - least) * SNAP) / SNAP


def _spread(boxes, layer, wish):
    """Lanes in an order, no two boxes on each other, together as near to the boxes' wishes as that allows."""
    at = []
    for k, name in enumerate(layer):
        room = 1.0 if k == 0 or (boxes[name].name and boxes[layer[k - 1]].name) else THIN
        at.append(wish[name] if k == 0 else max(wish[name], at[-1] + room))
    weights = [1.0 if boxes[n].name else LIGHT for n in layer]
    shift = sum(w * (wish[n] - a) for w, n, a in zip(weights, layer, at)) / max(sum(weights), LIGHT)
    for name, a in zip(layer, at):
        boxes[name].lane = a + shift


# --- drawing --------------------------------------------------------------------------------------------------------


def _svg(model, boxes, edges, marks, sizes, unit, down):
    longest = max((max(len(b.name) * LETTER, len(WORDS.get(b.kind, b.kind)) * SMALL) for b in boxes.values()),
                  default=0)
    width = min(max(NARROWEST, longest + BESIDE + AFTER), WIDEST)
    step = (width + GAP, ROW)

    def centre(box):
        a, b = (box.lane, box.layer) if down else (box.layer, box.lane)
        return MARGIN + width / 2 + a * step[0], MARGIN + HEIGHT / 2 + 16 + b * step[1]

    spots = {n: centre(b) for n, b in boxes.items()}
    right, bottom = (max((s[k] for s in spots.values()), default=0) for k in (0, 1))
    size = right + width / 2 + MARGIN + (ELBOW if down else 0), bottom + HEIGHT / 2 + 44
    top = max((abs(v) for v in sizes.values()), default=0.0)
    ports = _ports(boxes, edges)
    lines = [_line(boxes, spots, edge, ports, width, down) for edge in edges]
    drawn = [_box(box, spots[n], width, _told(box, marks), _told(box, sizes), top, unit)
             for n, box in boxes.items() if box.name]
    label = escape(_words(model, boxes, marks, sizes, unit))
    return (f'<svg class="drive{" down" if down else ""}" xmlns="http://www.w3.org/2000/svg" role="img" '
            f'aria-label="{label}" viewBox="0 0 {size[0]:.0f} {size[1]:.0f}" '
            f'style="width:100%;max-width:{size[0]:.0f}px;height:auto" font-family="system-ui, sans-serif" '
            f'fill="currentColor" stroke="none">{"".join(lines)}{"".join(drawn)}</svg>')


def _told(box, told):
    return next((told[c] for c in box.components if c in told), None)


def _words(model, boxes, marks, sizes, unit):
    """The drawing in words."""
    shown = [b for b in boxes.values() if b.name]
    by_kind = {}
    for box in shown:
        by_kind.setdefault(WORDS.get(box.kind, box.kind) or "part", []).append(box.name)
    parts = "; ".join(f"{kind} {', '.join(names)}" for kind, names in by_kind.items())
    said = [f"{b.name} is marked{': ' + _told(b, marks).text if _told(b, marks).text else ''}" for b in shown
            if _told(b, marks) is not None]
    said += [f"{b.name} {number(_told(b, sizes))} {unit}".strip() for b in shown if _told(b, sizes) is not None]
    return f"Drive train of {model.rig.rpartition('.')[2]}: {parts}." + "".join(f" {s}." for s in said)


def _ports(boxes, edges):
    """Where lines enter: of each box, its connections side by side; before each layer, where each of them turns."""
    entries, turns = {}, {}
    for *chain, net in edges:
        if net is not None:
            entries.setdefault(chain[-1], {}).setdefault(net, []).append(boxes[chain[-2]].lane)
            for name in chain[1:]:
                turns.setdefault(boxes[name].layer, {}).setdefault(net, []).append(boxes[chain[0]].lane)

    def ranked(nets):
        order = sorted(nets, key=lambda n: sum(nets[n]) / len(nets[n]))
        return {n: k - (len(order) - 1) / 2 for k, n in enumerate(order)}

    return {b: ranked(nets) for b, nets in entries.items()}, {
        layer: {n: k / len(nets) for n, k in ranked(nets).items()} for layer, nets in turns.items()}


def _line(boxes, spots, edge, ports, width, down):
    """One connection; what carries no power is dashed, and runs beside the boxes."""
    *chain, net = edge
    if net is None:
        path = _rail(spots[chain[0]], spots[chain[1]], width, down)
        return f'<path d="{path}" fill="none" stroke="{MUTED}" stroke-width="1.2" stroke-dasharray="3 4"/>'
    (x, y), half = spots[chain[0]], (HEIGHT if down else width) / 2
    path = [f"M{x:.1f},{y + half:.1f}" if down else f"M{x + half:.1f},{y:.1f}"]
    for name in chain[1:]:
        x, y = spots[name]
        real = name == chain[-1]
        half = (HEIGHT if down else width) / 2 if real else 0.0
        aside = APART * ports[0][name][net] if real else 0.0
        turn = ELBOW - GAP * ports[1][boxes[name].layer][net]
        path.append(f"V{y - half - turn:.1f}H{x + aside:.1f}V{y - half:.1f}" if down else
                    f"H{x - half - turn:.1f}V{y + aside:.1f}H{x - half:.1f}")
    return (f'<path d="{"".join(path)}" fill="none" stroke="currentColor" stroke-width="1.8" '
            'stroke-linejoin="round"/>')


def _rail(a, b, width, down):
    """Way of a line beside the boxes: out of the long side of one, into the front of the other."""
    if down:
        x, y = a[0] + width / 2, a[1] + HEIGHT / 4
        return (f"M{x:.1f},{y:.1f}H{x + ELBOW:.1f}V{b[1] - HEIGHT / 2 - 2 * ELBOW:.1f}H{b[0] + width / 4:.1f}"
                f"V{b[1] - HEIGHT / 2:.1f}")
    x, y = a[0] - width / 2 + BESIDE / 2, a[1] + HEIGHT / 2
    return (f"M{x:.1f},{y:.1f}V{y + RAIL:.1f}H{b[0] - width / 2 - ELBOW:.1f}V{b[1] + HEIGHT / 4:.1f}"
            f"H{b[0] - width / 2:.1f}")


def _box(box, spot, width, mark, value, top, unit):
    """One part: its sign, its name and its kind; under it what acts there, what it stands on, a mark and a value."""
    x, y = spot[0] - width / 2, spot[1] - HEIGHT / 2
    marked = mark is not None and not mark.other
    stroke = f'stroke="{ACCENT if mark else "currentColor"}" stroke-width="{3.5 if marked else 2 if mark else 1.3}"'
    dash = ' stroke-dasharray="5 3"' if box.kind == "beside" or mark is not None and mark.other else ""
    found = [f"<g><title>{escape(box.title or box.name)}</title>",
             f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{HEIGHT}" rx="5" fill="{PAPER}" '
             f'{stroke}{dash}/>']
    tint = TINT, LOW + (HIGH - LOW) * (abs(value) / top if top else 0.0) if value is not None else 0.0
    if marked and value is None:
        tint = ACCENT, PALE
    if tint[1]:
        found.append(f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{HEIGHT}" rx="5" fill="{tint[0]}" '
                     f'fill-opacity="{tint[1]:.3f}"/>')
    if box.grounded:
        found.append(_ground(x + width - 18, y + HEIGHT))
    found.append(f'<g transform="translate({x + 18:.1f},{spot[1]:.1f})" fill="none" stroke="currentColor" '
                 f'stroke-width="1.5" stroke-linejoin="round">{_sign(box.kind)}</g>')
    found.append(_text(x + BESIDE, spot[1] - 2, _short(box.name, width), 13, "start", weight=600))
    found.append(_text(x + BESIDE, spot[1] + 13, WORDS.get(box.kind, box.kind), 10.5, "start",
                       colour=MUTED if value is None else ""))
    found += _under(box, spot, y, mark, value, unit)
    return "".join([*found, "</g>"])


def _under(box, spot, y, mark, value, unit):
    """The words about a box: a mark above it, what acts there and a value under it."""
    found = [_text(spot[0], y - 6, mark.text, 12.5, "middle", weight=400 if mark.other else 700,
                   colour=ACCENT)] if mark else []
    rows = ([f"+ {', '.join(box.notes)}"] if box.notes else [])
    rows += [f"{number(value)} {unit}".strip()] if value is not None else []
    for k, row in enumerate(rows):
        bold = value is not None and k == len(rows) - 1
        found.append(_text(spot[0], y + HEIGHT + 15 + 14 * k, row, 12 if bold else 11, "middle",
                           weight=600 if bold else 400, colour="" if bold else MUTED))
    return found


def _text(x, y, text, size, anchor, weight=400, colour=""):
    """Words; those between the boxes have a border of paper, so that no line runs through them."""
    if not text:
        return ""
    border = f' paint-order="stroke" stroke="{PAPER}" stroke-width="4" stroke-linejoin="round"'
    return (f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" text-anchor="{anchor}" font-weight="{weight}" '
            f'fill="{colour or "currentColor"}"{border if anchor == "middle" else ""}>{escape(str(text))}</text>')


def _short(name, width):
    """A name that fits its box; the whole one is the box's title."""
    most = int((width - BESIDE - AFTER) / LETTER + 0.01)
    return name if len(name) <= most else name[:most - 1] + "…"


def _ground(x, y):
    """What a part stands on."""
    lines = "".join(f"M{x - 9 + 6 * k:.1f},{y + 1:.1f}l-4,6" for k in range(4))
    return f'<path d="M{x - 11:.1f},{y + 1:.1f}h22{lines}" stroke="currentColor" stroke-width="1.2" fill="none"/>'


def _sign(kind):
    """The sign of a kind of part, about the origin, 24 wide."""
    dot = '<circle r="2" fill="currentColor"/>'
    return {
        "motor": '<circle r="10"/><path d="M-5,5V-4L0,2L5,-4V5"/>',
        "segment": '<path d="M-11,0H11M-8,-8H8M-8,8H8M-6,-8V-3M0,-8V-3M6,-8V-3M-6,8V3M0,8V3M6,8V3"/>',
        "line": '<path d="M-11,0c3,-9 5,-9 7,0s5,9 7,0s4,-7 7,-2"/>',
        "gear": '<circle cx="-4" r="6"/><circle cx="6" r="4"/>' + dot.replace("<circle", '<circle cx="-4"'),
        "joint": '<circle r="5"/><path d="M-11,0H-5M5,0H11"/>' + dot,
        "difference": '<circle r="8"/><path d="M-4,0H4"/>',
        "link": '<circle cx="-8" cy="-6" r="3"/><path d="M-6,-4L6,5"/>' + dot.replace(
            'r="2"', 'cx="8" cy="7" r="4"'),
        "inertia": '<rect x="-6" y="-8" width="12" height="16"/><path d="M-11,0H-6M6,0H11"/>',
        "screw": '<path d="M-11,0l3,-6l4,12l4,-12l4,12l4,-12l3,6"/>',
        "spring": '<path d="M-11,0h3l2,-6l4,12l4,-12l4,12l2,-6h3"/>',
        "sensor": '<circle r="8"/><path d="M0,0L5,-5"/>' + dot,
        "beside": '<path d="M0,-9V-2"/><rect x="-6" y="-2" width="12" height="10"/>',
    }.get(kind, '<rect x="-8" y="-8" width="16" height="16"/>')


def figure(model, **options):
    """The drawing for any width: from left to right where there is room, else from top to bottom.

    Parameters
    ----------
    model : Model
        Of the rig that is drawn.
    **options
        Of `schematic`.

    Returns
    -------
    str
        HTML; `STYLE` shows one of the two.
    """
    return (f'<div class="drive-wide">{schematic(model, **options)}</div>'
            f'<div class="drive-narrow">{schematic(model, **options, down=True)}</div>')


STYLE = (".drive-narrow{display:none}"
         "@media screen and (max-width:820px){.drive-wide{display:none}.drive-narrow{display:block}}")


def write_schematic(path, model, **options):
    """Write the drawing as a file of its own, ink on white.

    Parameters
    ----------
    path : path
        An SVG file.
    model : Model
        Of the rig that is drawn.
    **options
        Of `schematic`.
    """
    text = schematic(model, **options).replace('style="', 'style="color:#1b1f24;background:#fff;', 1)
    Path(path).write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n', encoding="utf-8")

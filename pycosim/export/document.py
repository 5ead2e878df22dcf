"""A plant in, what a person wants to know about it out: HTML for the FMU, a dictionary for JSON."""

from __future__ import annotations

from html import escape

from .. import __version__
from ..compile.effects import component_name
from .description import STEP
from .xml import value_reference

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><title>{title}</title>
<style>body{{font:15px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 1em}}
table{{border-collapse:collapse}}td,th{{padding:.15em .7em;text-align:left;border-bottom:1px solid #ddd}}
code{{background:#f4f4f4}}</style></head>
<body>
{body}
</body>
</html>
"""
_STEPPING = (f"In co-simulation a communication step is cut into equal steps of an implicit method, no longer than "
             f"<code>{STEP}</code>; inputs are held over a step, or follow the derivative that FMI 2 lets an importer "
             "give. In model exchange, each <code>still_margin</code> is an event indicator.")
_LIMITS = (
    "Trains of rigid gears or cables with friction: compliance and backlash are in only where an effect above says so.",
    "What no effect describes is not here. The study's diagnosis says whether anything was left unexplained.",
    "Parameters marked <i>default</i> were not given by the study; they are the library's, and nobody measured them.",
    "The identified values hold for the speeds, loads and temperatures of the logs they came from.")


def to_dict(plant):
    """Everything about a plant that JSON can hold.

    Parameters
    ----------
    plant : Plant
        Of `describe`.

    Returns
    -------
    dict
        Rig, effects, variables in the order of their value references (SI units), states, terminals, Modelica text.
    """
    return {"schema": 1, "generator": f"pycosim {__version__}", "name": plant.name, "rig": plant.rig,
            "description": plant.description, "effects": _effects(plant),
            "variables": [_variable(plant, k, e) for k, e in enumerate(plant.entries)],
            "states": [e.name for e in plant.entries[1:1 + plant.sizes["x"]]],
            "terminals": dict(plant.terminals), "modelica": plant.model.text}


def _effects(plant):
    return [{"effect": e.id, "place": p.name, "component": component_name(e, p), "description": e.description}
            for e, p in plant.model.attached]


def _variable(plant, number, entry):
    v = entry.variable
    starts = entry.initial == "exact" or entry.causality == "input"
    return {"name": v.name, "value_reference": value_reference(number), "type": "Boolean" if entry.boolean else "Real",
            "unit": v.unit, "description": v.description, "causality": entry.causality,
            "variability": entry.variability, "initial": entry.initial, "start": v.value if starts else None,
            "min": v.min, "max": v.max, "nominal": v.nominal, "from_study": v.name in plant.identified,
            "depends_on": [plant.entries[k].name for k in entry.depends]}


def to_html(plant):
    """Page for ``documentation/index.html``.

    Parameters
    ----------
    plant : Plant
        Of `describe`; what it says of itself is escaped.

    Returns
    -------
    str
        HTML, with what the plant does not know.
    """
    parts = [f"<h1>{escape(plant.name)}</h1><p>{escape(plant.rig)}: {escape(plant.description)}. "
             f"Made by pycosim {__version__}.</p>", "<h2>Effects beyond the rig</h2>", _list(
                 [f"<b>{escape(e['effect'])}</b> at {escape(e['place'])}: {escape(e['description'])}"
                  for e in _effects(plant)])]
    for title, causality in (("Inputs", "input"), ("Outputs", "output"), ("Parameters", "parameter")):
        parts.append(f"<h2>{title}</h2>{_table(plant, causality)}")
    parts += ["<h2>How it steps</h2>", f"<p>{plant.stepping or _STEPPING} SI units throughout.</p>",
              "<h2>What it does not know</h2>", _list(_LIMITS),
              "<h2>Modelica</h2>", f"<pre>{escape(plant.model.text)}</pre>"]
    return _PAGE.format(title=escape(plant.name), body="\n".join(parts))


def _list(items):
    return "<ul>" + "".join(f"<li>{i}</li>" for i in items) + "</ul>" if items else "<p>None.</p>"


def _table(plant, causality):
    rows = []
    for e in plant.entries:
        if e.causality == causality:
            v = e.variable
            start = f"{v.value:.6g}" if e.initial == "exact" or causality == "input" else ""
            origin = ("study" if v.name in plant.identified else "default") if causality == "parameter" else ""
            rows.append(f"<tr><td><code>{escape(v.name)}</code></td><td>{start}</td><td>{escape(v.unit)}</td>"
                        f"<td>{e.variability}</td><td>{origin}</td><td>{escape(v.description)}</td></tr>")
    head = "<tr><th>name</th><th>start</th><th>unit</th><th>changes</th><th>from</th><th>meaning</th></tr>"
    return f"<table>{head}{''.join(rows)}</table>"

"""Data set and search in; one HTML page that opens anywhere, without a network, out."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import pandas as pd
from jinja2 import Environment, FileSystemLoader

from .. import __version__
from ..compile import compile_model, find_effect
from ..core.whole import write_whole
from ..data.frames import Frame
from ..diagnosis.compare import worded
from ..fit.nullspace import number
from . import cards, charts, drawings, findings, outcomes, records, schematic, sentences
from .sentences import finite
from .verdict import Verdict

HERE = Path(__file__).parent
SECTIONS = (("checked", "Check of the data"), ("measured", "What was measured"),
            ("against", "Model against measurement"), ("where", "Where it fails"),
            ("which", "Which effect is missing"), ("fall", "Watch the error fall"), ("parameters", "Parameters"),
            ("next", "What to measure next"), ("again", "How to reproduce"))
MATTERS = 0.01  # share of the residual's energy from which a variable is named
RATED = ".tau", ".w", ".a"  # limits of a motor that say nothing of how far it may move
CARDS = 4  # candidates with a card, besides those that were added
PACKAGES = "numpy", "scipy", "casadi", "pymoca", "plotly"


class Page:
    """A search, told to a stranger.

    Parameters
    ----------
    dataset : Dataset
        The logs that were searched.
    improvement : Improvement
        The search that is told.
    command : str
        What makes this page again.
    checked : Checked, optional
        What the check of the data found.
    notes : list of str
        Sentences on what the search learnt of the machine beside effects.
    """

    def __init__(self, dataset, improvement, command, checked=None, notes=()):
        self.checked = checked
        self.dataset, self.found, self.command, self.library = dataset, improvement, command, dataset.library
        self.first, self.last = (records.diagnosis(d, dataset) for d in (improvement.first, improvement.last))
        self.parameters = records.parameters(improvement.fit, improvement.model, dataset.study.seed)
        steps = improvement.steps
        self.models = [(s.model, s.fit) for s in (steps if len(steps) < 2 else (steps[0], steps[-1]))]
        self.floor = {c: v for c, v in self.last["noise_floor"].items() if v is not None}
        self.verdict = Verdict(dataset, improvement, self.first, self.last, self.parameters, checked, notes)
        self.charts = []

    def html(self):
        """The page.

        Returns
        -------
        str
        """
        parts = {"title": f"{self.dataset.study.name}: {self.dataset.study.rig.rsplit('.', 1)[-1]}",
                 "verdict": self.verdict.card(), "sections": SECTIONS, "checked": self._checked(),
                 "measured": self._measured(), "timeline": self._timeline(), "where": self._where(),
                 "which": self._which(), "fall": self._fall(), "parameters": self._parameters(), "next": self._next(),
                 "again": self._again()}
        files = {name: (HERE / f"page.{name}").read_text(encoding="utf-8") for name in ("css", "js")}
        template = Environment(loader=FileSystemLoader(HERE), autoescape=True, trim_blocks=True)
        # the trusted parts go in after the words, which are escaped
        payload = json.dumps(self._payload(), allow_nan=False)
        files["css"] += schematic.STYLE
        trusted = {**files, "plotly": _packed(_plotly()), "payload": _packed(payload)}
        text = template.get_template("page.html").render(**parts)
        for name, content in trusted.items():
            text = text.replace(f"<!--{name}-->", content, 1)
        return text

    def _errors(self, error):
        return sentences.errors_text(error, self.dataset.units)

    def _change(self, before, after):
        return sentences.change_text(before, after, self.dataset.units).replace("->", "→")

    def _blamed(self):
        """Variable that the base model's error depends on most, and the channel that shows it; None where nothing."""
        told = {c: v["depends_on"][0] for c, v in (self.first.get("channels") or {}).items() if v["depends_on"]}
        most = next((e for e in self.first["residual_depends_on"] if e["strength"] > MATTERS), None)
        if most is None:
            return None, None
        shows = [c for c, e in told.items() if e["variable"] == most["variable"]]
        return most["variable"], max(shows, key=lambda c: told[c]["strength"], default=None)

    def _opened(self, found):
        """Charts of one title, the one of what is to blame first."""
        variable, channel = self._blamed()
        branch = f"branch of {str(variable).partition('@')[2]}"
        return sorted(found, key=lambda c: (variable not in c.over and branch not in c.over, c.channel != channel))

    def _payload(self):
        """Charts for the script; the time that all signals share is told once."""
        time, told = None, []
        for chart in self.charts:
            traces = []
            for trace in chart.traces:
                signal = trace.get("meta") == "signal"
                if signal:
                    time = trace["x"]
                traces.append(charts.encoded({n: v for n, v in trace.items() if not signal or n not in "xy"}) | (
                    {"x": "@time", "y": charts.packed(trace["y"])} if signal else {}))
            told.append({"id": chart.id, "traces": traces, "layout": charts.encoded(chart.layout)})
        return {"themes": charts.THEMES, "layout": charts.base_layout(), "shown": charts.SHOWN,
                "room": charts.ROOM,
                "time": charts.packed(time, True) if time is not None else [], "charts": told}

    def _keep(self, plot):
        """The chart of a plot, among those of the page."""
        if plot is None:
            return None
        self.charts.append(charts.chart(plot))
        return self.charts[-1]

    # ---- what the data check says

    def _checked(self):
        if self.checked is None:
            return {"lines": ["The data were not checked."], "tables": []}
        rows = [(f.kind, findings.sentence(f), f.mend) for f in self.checked.findings]
        lines = findings.every(self.checked)[-1:]
        if any(f.told for f in self.checked.findings):
            lines = ["What was found stands above all else on this page."]
        elif any(f.wrong for f in self.checked.findings):
            lines = ["Nothing was found; what may be asked of the data is below."]
        return {"lines": lines,
                "tables": [_table("All that the check says", ("kind", "what", "line that mends it"), rows)]}

    # ---- what was measured

    def _measured(self):
        d = self.dataset
        reference = {"sensor": "measured by a sensor", "gravity_model": "computed from the leg's weight",
                     "unknown": "not said in the study"}[d.study.reference]
        lines = [*sentences.summary_data(d), *sentences.summary_doubt(d, self.found.steps[0].fit)]
        lines += [f"Noise floor: {self._errors(self.floor)}: no model of this kind could get below it." if self.floor
                  else "Noise floor: unknown, as nothing in these data shows how samples scatter."]
        if not d.paired:
            lines.append(f"Where the reference comes from: {reference}.")
        rows = [(log.name, len(log.time), f"{log.time[-1] - log.time[0]:.4g}",
                 f"{1 / np.median(np.diff(log.time)):.4g}" if len(log.time) > 1 else "",
                 f"{100 * d.moving[d.run == k].mean():.0f}", "yes" if log.held_out else "no",
                 sum(b - a + 1 for a, b in log.dropped)) for k, log in enumerate(d.logs)]
        header = "run", "samples", "duration [s]", "rate [Hz]", "moving [%]", "held out whole", "rows left out"
        runs = _table("Runs", header, rows)
        return {"lines": lines, "tables": [runs, self._excitation()], "plane": self._keep(drawings.manoeuvres(d))}

    def _excitation(self):
        """What the log varies, as the diagnosis says it."""
        rows = [(worded(e["variable"]), number(e["min"]), number(e["max"]), e["levels"], e["unit"])
                for e in self.first["excitation"]]
        return _table("What the log varies", ("variable", "least", "largest", "levels", "unit"), rows)

    # ---- model and measurement

    def _timeline(self):
        return None if self.dataset.averaged else self._keep(drawings.timeline(self.dataset, self.models))

    def _where(self):
        d, (variable, _) = self.dataset, self._blamed()
        found = {"maps": drawings.maps(d, self.models),
                 "profiles": drawings.profiles(d, self.models, self.floor, also=[variable] if variable else ()),
                 "groups": drawings.groups(d, self.models, self.floor)}
        found = {name: [self._keep(chart) for chart in self._opened(group)] for name, group in found.items()}
        depends = [f"{worded(e['variable'])} ({100 * e['strength']:.0f} %)"
                   for e in self.first["residual_depends_on"][:4] if e["strength"] > MATTERS]
        lines = [f"The base model's error depends most on {', '.join(depends)}: the share of its energy that each "
                 "alone predicts, on passes it was not fitted to. The charts open on the first."] if depends else []
        return {"lines": lines, **found}

    # ---- effects

    def _which(self):
        lines = self._unexplained()
        shown = [self._added(k) for k in range(1, len(self.found.steps))]
        shown += [self._rival(c) for c in self._rivals({(c["effect"], c["place"]) for c in shown})]
        rows = [(_spaced(c["effect"]), c["place"], cards.chance(c["p_value"]), self._errors(c["predicted_error"]),
                 self._fate(c)) for c in self.first["candidates"]]
        table = _table("All that was tested, best first", ("effect", "place", "chance alone does as much in",
                                                           "error with it, predicted", "what became of it"), rows)
        left = self.found.last.unexplained
        chart = self._keep(drawings.unexplained(self.dataset, left))
        return {"lines": lines, "map": chart, "cards": shown, "rest": table}

    def _rivals(self, shown):
        """Candidates worth a card although they were not added: all alternatives, and each effect at its best place."""
        left = [c for c in self.first["candidates"] if (c["effect"], c["place"]) not in shown and c["p_value"] < 0.05]
        named = any(c["accepted"] or c.get("contested") for c in self.first["candidates"])
        alike = [c for c in left if c["twins"] and named]
        effects = {effect for effect, _ in shown}
        rest = []
        for c in left:  # best first
            if c not in alike and c["refitted"] and c["effect"] not in effects:
                effects.add(c["effect"])
                rest.append(c)
        return [*alike, *rest][:CARDS]

    def _fate(self, told):
        """What became of a candidate, in words."""
        key = told["effect"], told["place"]
        step = next((k for k, s in enumerate(self.found.steps) if s.added == key), None)
        if step is not None:
            return f"added, step {step}"
        return outcomes.fate(self.found.first, next(f for f in self.found.first.candidates if f.key == key))

    def _unexplained(self):
        left = self.last.get("unexplained")
        if not left:
            return []
        lines = [f"{100 * left['share']:.0f} % of the residual's energy beyond noise is left unexplained."]
        proposal, free = left.get("proposal"), left.get("free")
        return lines + ([f"Proposed: {proposal['text']}"] if proposal else []) + ([free["text"]] if free else [])

    def _added(self, k):
        """Card of an effect that the search added: what its step brought; the verdict says the rest."""
        before, step = self.found.steps[k - 1:k + 1]
        effect, place = step.added
        line = f"Error with it: {self._change(before.error, step.error)}"
        if step.held_out_error:
            line += f"; on held-out passes {self._change(before.held_out_error, step.held_out_error)}"
        predicted = step.finding.predicted_error if step.finding is not None else None
        line += f"; predicted before any refit: {self._errors(predicted)}." if predicted else "."
        chart = drawings.signature(self.dataset, (before.model, before.fit), (step.model, step.fit), step.added)
        return {"effect": effect, "place": place, "description": f"{find_effect(self.library, effect).description}.",
                "lines": [line], "accepted": True, "status": f"added, step {k}", "chart": self._keep(chart)}

    def _rival(self, told):
        """Card of a candidate that was not added."""
        effect, place = key = told["effect"], told["place"]
        winner, lines = told.get("explained_by"), []
        if told.get("coefficients") and not winner:
            lines.append(", ".join(sentences.coefficient_text(n, c) for n, c in told["coefficients"].items()) + ".")
        fall = told.get("realised_fall") or told.get("predicted_fall") or {}
        if fall:
            text = ("By itself it takes " if told.get("realised_fall") else "By itself it should take ") + ", ".join(
                f"{100 * v:.0f} % off the error of {c}" for c, v in fall.items())
            beside = f"{_spaced(winner['effect'])} at {winner['place']}" if winner else ""
            lines.append(f"{text}; beside {beside} nothing is left for it to explain." if winner else f"{text}.")
        if not winner:
            lines.append(f"Chance alone would find something as large in {cards.chance(told['p_value'])}.")
        alike = [t for t in told.get("twins") or () if (t["effect"], t["place"]) != key]
        if alike:
            lines += sentences.alternatives_text(told, experiment=False)
            lines += [f"What would decide: {told['experiment']}."] if told.get("experiment") else []
        finding = next(f for f in self.found.first.candidates if f.key == key)
        chart = None
        if finding.fit is not None and not told.get("explained_by"):
            base = self.found.steps[0]
            model = compile_model(self.library, base.model.rig, [*base.model.keys, key])
            chart = drawings.signature(self.dataset, (base.model, base.fit), (model, finding.fit), key)
            chart.id = f"rival_{chart.id}"
        return {"effect": effect, "place": place, "description": f"{find_effect(self.library, effect).description}.",
                "lines": lines, "accepted": False, "chart": self._keep(chart), "status": self._fate(told)}

    # ---- steps, parameters

    def _fall(self):
        steps = self.found.steps
        rows = [("base model" if s.added is None else f"+ {s.added[0]} at {s.added[1]}", self._errors(s.error),
                 self._errors(s.held_out_error)) for s in steps]
        told = self.dataset.held_out_ranges()
        seconds = sum(b - a for _, a, b in told)
        lines = [f"{len(told)} passes out and back, {seconds:.4g} s, were held out of every fit and of every choice."]
        return {"lines": lines, "chart": self._keep(outcomes.ladder(self.dataset.units, steps, self.floor)),
                "table": _table("Errors, step by step (RMSE of moving samples)",
                                ("model", "fitted passes", "held-out passes"), rows)}

    def _parameters(self):
        p = self.parameters
        rows = [(n, finite(v["value"]), f"{finite(v['ci95'][0])} to {finite(v['ci95'][1])}",
                 "" if v["unit"] == "1" else v["unit"], sentences.note(v), v.get("description") or "")
                for n, v in p["parameters"].items()]
        words = sentences.summary_parameters(p)
        lines = [line for line in words if line.startswith(("Not determined", "Weak", "Error"))]
        return {"lines": lines, "chart": self._keep(outcomes.intervals(p)),
                "table": _table("Fitted parameters", ("parameter", "value", "95 %", "unit", "", "meaning"), rows)}

    # ---- next, again

    def _next(self):
        study = self.dataset.study
        ready = any(not n.endswith(RATED) for n in study.limits)
        lines = [f"'pycosim plan {study.path.name}' turns this into a motion of the motors: one that narrows the "
                 "intervals, or tells the effects above apart"
                 + ("." if ready else ", once a [limits] table in the study says what may move how far.")]
        smallest = self.last.get("smallest_detectable") or []
        rows = [(_spaced(e["effect"]), e["place"], f"{e['coefficient']} = {number(e['value'])} "
                 f"{'' if e['unit'] == '1' else e['unit']}".rstrip(), f"{100 * e['error_share']:.2g}")
                for e in smallest if e.get("value") is not None]
        tables = [_table("The smallest effect that these data would have shown",
                         ("effect", "place", "coefficient", "share of the error [%]"), rows)] if rows else []
        return {"ranked": self.verdict.experiments(), "lines": lines,
                "unseen": sentences.summary_undetectable(self.last["undetectable"]), "tables": tables}

    def _again(self):
        study = self.dataset.study
        files = [study.path, *(log.path for log in self.dataset.logs), *study.modelica]
        hashes = [(p.name, p.sha256 if isinstance(p, Frame) else hashlib.sha256(p.read_bytes()).hexdigest())
                  for p in files]
        versions = [("pycosim", __version__), ("Python", sys.version.split()[0]),
                    *((p, _version(p)) for p in PACKAGES), ("machine", f"{platform.system()} {platform.machine()}"),
                    ("seed", study.seed)]
        return {"command": self.command, "tables": [_table("Inputs", ("file", "SHA-256"), hashes),
                                                    _table("Versions", ("what", "version"), versions)],
                "files": [(f"The study, {study.path.name}", study.path.read_text(encoding="utf-8")),
                          ("The model found, in Modelica", self.found.model.text)]}


def write_report(path, dataset, improvement, command, checked=None, notes=()):
    """Write the page of a search.

    Parameters
    ----------
    path : Path
        The HTML file.
    dataset : Dataset
        The logs that were searched.
    improvement : Improvement
        The search that is told.
    command : str
        What makes this page again.
    checked : Checked, optional
        What the check of the data found.
    notes : list of str
        Sentences on what the search learnt of the machine beside effects.

    Returns
    -------
    list of Chart
        What is drawn on it.
    """
    page = Page(dataset, improvement, command, checked, notes)
    write_whole(path, page.html())
    return page.charts


def write_numbers(folder, drawn):
    """Write what charts draw, as CSV, a file a chart.

    Parameters
    ----------
    folder : Path
        Made where it is missing.
    drawn : list of Chart
        Each with what it draws as columns of numbers.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for chart in drawn:
        columns = {n: pd.Series(v) for n, v in chart.columns().items()}
        pd.DataFrame(columns).to_csv(folder / f"{chart.id}.csv", index=False)


def _spaced(effect):
    return effect.replace("_", " ")


def _table(caption, header, rows):
    return {"caption": caption, "header": header, "rows": rows}


def _version(package):
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"


def _plotly():
    from plotly.offline import get_plotlyjs
    return get_plotlyjs()


def _packed(text):
    return base64.b64encode(gzip.compress(text.encode(), 6, mtime=0)).decode()

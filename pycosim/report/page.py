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
from ..compile.effects import annotation
from ..data.frames import Frame
from ..diagnosis.compare import worded
from ..fit.nullspace import number
from . import charts, findings, records, sentences
from .sentences import finite

HERE = Path(__file__).parent
SECTIONS = (("checked", "Check of the data"), ("measured", "What was measured"),
            ("against", "Model against measurement"), ("where", "Where it fails"),
            ("which", "Which effect is missing"), ("fall", "Watch the error fall"), ("parameters", "Parameters"),
            ("next", "What to measure next"), ("again", "How to reproduce"))
CARDS = 4  # candidates with a card, besides those that were added
PACKAGES = "numpy", "scipy", "casadi", "pymoca", "plotly"


class Page:
    """A search, told to a stranger.

    Parameters
    ----------
    dataset : Dataset
    improvement : Improvement
    command : str
        What makes this page again.
    checked : Checked, optional
        What the check of the data found.
    """

    def __init__(self, dataset, improvement, command, checked=None):
        self.checked = checked
        self.dataset, self.found, self.command, self.library = dataset, improvement, command, dataset.library
        self.first, self.last = (records.diagnosis(d, dataset) for d in (improvement.first, improvement.last))
        self.parameters = records.parameters(improvement.fit, improvement.model, dataset.study.seed)
        steps = improvement.steps
        self.models = [(s.model, s.fit) for s in (steps if len(steps) < 2 else (steps[0], steps[-1]))]
        self.floor = {c: v for c, v in self.last["noise_floor"].items() if v is not None}
        self.charts = []

    def html(self):
        """The page.

        Returns
        -------
        str
        """
        parts = {"title": f"{self.dataset.study.name}: {self.dataset.study.rig.rsplit('.', 1)[-1]}",
                 "verdict": self.first["verdict"], "headline": self._headline(), "sections": SECTIONS,
                 "checked": self._checked(),
                 "measured": self._measured(), "timeline": self._timeline(), "where": self._where(),
                 "which": self._which(), "fall": self._fall(), "parameters": self._parameters(), "next": self._next(),
                 "again": self._again()}
        files = {name: (HERE / f"page.{name}").read_text(encoding="utf-8") for name in ("css", "js")}
        template = Environment(loader=FileSystemLoader(HERE), autoescape=True, trim_blocks=True)
        # the trusted parts go in after the words, which are escaped
        payload = json.dumps(self._payload(), allow_nan=False)
        trusted = {**files, "plotly": _packed(_plotly()), "payload": _packed(payload)}
        text = template.get_template("page.html").render(**parts)
        for name, content in trusted.items():
            text = text.replace(f"<!--{name}-->", content, 1)
        return text

    def _errors(self, error):
        return sentences.errors_text(error, self.dataset.units)

    def _change(self, before, after):
        return sentences.change_text(before, after, self.dataset.units)

    def _payload(self):
        """Charts for the script; the time that all signals share is told once."""
        time, told = None, []
        for chart in self.charts:
            traces = []
            for trace in chart.traces:
                if trace.get("meta") == "signal":
                    time, trace = trace["x"], {**trace, "x": "@time"}
                traces.append(charts.encoded(trace))
            told.append({"id": chart.id, "traces": traces, "layout": charts.encoded(chart.layout)})
        return {"themes": charts.THEMES, "layout": charts.base_layout(), "shown": charts.SHOWN,
                "room": charts.ROOM,
                "time": charts.encoded(time) if time is not None else [], "charts": told}

    def _keep(self, chart):
        if chart is not None:
            self.charts.append(chart)
        return chart

    def _headline(self):
        added = [s.added for s in self.found.steps[1:]]
        if not added:
            return sentences.summary_diagnosis(self.first, self.library)[0]
        names = ", then ".join(f"{e.replace('_', ' ')} at {p}" for e, p in added)
        last = sentences.summary_diagnosis(self.last, self.library, final=True)[0]
        return f"Missing in the model: {names}. {last}"

    # ---- what the data check says

    def _checked(self):
        if self.checked is None:
            return {"lines": ["The data were not checked."], "tables": []}
        rows = [(f.kind, findings.sentence(f), f.mend) for f in self.checked.findings]
        lines = [] if any(f.told for f in self.checked.findings) else findings.every(self.checked)[-1:]
        return {"lines": [findings.sentence(f) for f in self.checked.findings if f.told] + lines,
                "tables": [_table("All that the check says", ("kind", "what", "line that mends it"), rows)]}

    # ---- what was measured

    def _measured(self):
        d = self.dataset
        reference = {"sensor": "measured by a sensor", "gravity_model": "computed from the leg's weight",
                     "unknown": "not said in the study"}[d.study.reference]
        lines = [*sentences.summary_data(d), *sentences.summary_doubt(d, self.found.steps[0].fit),
                 f"Noise floor: {self._errors(self.floor)}: no model of this kind could get below it."]
        if not d.paired:
            lines.append(f"Where the reference comes from: {reference}.")
        rows = [(log.name, len(log.time), f"{log.time[-1] - log.time[0]:.4g}",
                 f"{1 / np.median(np.diff(log.time)):.4g}" if len(log.time) > 1 else "",
                 f"{100 * d.moving[d.run == k].mean():.0f}", "yes" if log.held_out else "no",
                 sum(b - a + 1 for a, b in log.dropped)) for k, log in enumerate(d.logs)]
        header = "run", "samples", "duration [s]", "rate [Hz]", "moving [%]", "held out whole", "rows left out"
        runs = _table("Runs", header, rows)
        return {"lines": lines, "tables": [runs, self._excitation()], "plane": self._keep(charts.plane(d))}

    def _excitation(self):
        """What the log varies, as the diagnosis says it."""
        rows = [(worded(e["variable"]), number(e["min"]), number(e["max"]), e["levels"], e["unit"])
                for e in self.first["excitation"]]
        return _table("What the log varies", ("variable", "least", "largest", "levels", "unit"), rows)

    # ---- model and measurement

    def _timeline(self):
        return None if self.dataset.averaged else self._keep(charts.timeline(self.dataset, self.models))

    def _where(self):
        d = self.dataset
        found = {"maps": charts.maps(d, self.models), "profiles": charts.profiles(d, self.models),
                 "groups": charts.groups(d, self.models, self.floor)}
        for group in found.values():
            for chart in group:
                self._keep(chart)
        depends = [f"{worded(e['variable'])} ({100 * e['strength']:.0f} %)"
                   for e in self.first["residual_depends_on"][:4] if e["strength"] > 0.01]
        lines = [f"The base model's error depends most on {', '.join(depends)}: the share of its energy that each "
                 "alone predicts, on passes it was not fitted to."] if depends else []
        lines += [found["maps"][0].caption] if found["maps"] else []
        return {"lines": lines, **found}

    # ---- effects

    def _which(self):
        lines = sentences.summary_diagnosis({**self.first, "undetectable": []}, self.library)
        lines += self._unexplained()
        cards = [self._added(k) for k in range(1, len(self.found.steps))]
        shown = {(c["effect"], c["place"]) for c in cards}
        cards += [self._rival(c) for c in self._rivals(shown)]
        rows = [(c["effect"], c["place"], number(c["p_value"]), self._errors(c["predicted_error"]),
                 "accepted" if c["accepted"] else "refitted" if c["refitted"] else "scored")
                for c in self.first["candidates"]]
        table = _table("Candidates, best first", ("effect", "place", "p, family-wise", "predicted error", ""), rows)
        left = self.found.last.unexplained
        chart = self._keep(charts.unexplained(self.dataset, left)) if left else None
        return {"lines": lines, "map": chart, "cards": cards, "rest": table}

    def _rivals(self, shown):
        """Candidates worth a card although they were not added: all twins, and each effect at its best place."""
        left = [c for c in self.first["candidates"] if (c["effect"], c["place"]) not in shown and c["p_value"] < 0.05]
        twins = [c for c in left if c["twins"] and (self.first["candidates"][0]["accepted"])]
        effects = {effect for effect, _ in shown}
        rest = []
        for c in left:  # best first
            if c not in twins and c["refitted"] and c["effect"] not in effects:
                effects.add(c["effect"])
                rest.append(c)
        return [*twins, *rest][:CARDS]

    def _unexplained(self):
        left = self.last.get("unexplained")
        if not left:
            return []
        lines = [f"{100 * left['share']:.0f} % of the residual's energy beyond noise is left unexplained."]
        proposal = left.get("proposal")
        return lines + ([f"Proposed: {proposal['text']}"] if proposal else [])

    def _card(self, effect, place, told):
        """What every card says."""
        kind = find_effect(self.library, effect)
        lines = [told["sentence"]] if told.get("sentence") else []
        if told.get("coefficients"):
            lines.append(", ".join(sentences.coefficient_text(n, c) for n, c in told["coefficients"].items()) + ".")
        if told.get("p_value") is not None:
            lines.append(f"p = {number(told['p_value'])} over everything that was tested.")
        lines += self._falls(told)
        lines += sentences.alternatives_text(told, self.library) if told.get("twins") else []
        if told.get("experiment"):
            lines.append(f"What would decide: {told['experiment']}.")
        return {"effect": effect, "place": place, "description": f"{kind.description}.", "lines": lines, "chart": None}

    def _falls(self, told):
        lines = []
        for key, text in (("predicted_fall", "Predicted fall of the error"), ("realised_fall", "Realised fall")):
            if told.get(key):
                lines.append(f"{text}: " + ", ".join(f"{c} {100 * v:.0f} %" for c, v in told[key].items()) + ".")
        if told.get("predicted_error") and not told.get("predicted_fall"):
            change = self._change(self.first["error"], told["predicted_error"])
            lines.append(f"Error, predicted before any refit: {change}.")
        return lines

    def _added(self, k):
        """Card of an effect that the search added."""
        before, step = self.found.steps[k - 1:k + 1]
        told = next((c for c in self.first["candidates"] if (c["effect"], c["place"]) == step.added), {})
        card = self._card(*step.added, told)
        line = f"Error with it: {self._change(before.error, step.error)}"
        if step.held_out_error:
            line += f"; on held-out passes {self._change(before.held_out_error, step.held_out_error)}"
        card["lines"].append(line + ".")
        chart = charts.signature(self.dataset, (before.model, before.fit), (step.model, step.fit), step.added)
        return {**card, "accepted": True, "status": f"added, step {k}", "chart": self._keep(chart)}

    def _rival(self, told):
        """Card of a candidate that was not added."""
        card = self._card(told["effect"], told["place"], told)
        accepted = next((c for c in self.first["candidates"] if c["accepted"]), None)
        twin = accepted and any((t["effect"], t["place"]) == (told["effect"], told["place"]) for t in accepted["twins"])
        finding = next(f for f in self.found.first.candidates if f.key == (told["effect"], told["place"]))
        chart = None
        if finding.fit is not None:
            base = self.found.steps[0]
            key = (told["effect"], told["place"])
            attached = base.model.keys
            model = compile_model(self.library, base.model.rig, [*attached, key])
            chart = charts.signature(self.dataset, (base.model, base.fit), (model, finding.fit), key)
            chart.id = f"rival_{chart.id}"
        return {**card, "accepted": False, "chart": self._keep(chart),
                "status": "not to be told from the accepted" if twin else "not accepted"}

    # ---- ladder, parameters

    def _fall(self):
        steps = self.found.steps
        rows = [("base model" if s.added is None else f"+ {s.added[0]} at {s.added[1]}", self._errors(s.error),
                 self._errors(s.held_out_error)) for s in steps]
        told = self.dataset.held_out_ranges()
        seconds = sum(b - a for _, a, b in told)
        lines = [f"{len(told)} passes out and back, {seconds:.4g} s, were held out of every fit and of every choice."]
        return {"lines": lines, "ladder": self._keep(charts.ladder(self.dataset, steps, self.floor)),
                "table": _table("Errors, step by step (RMSE of moving samples)",
                                ("model", "fitted passes", "held-out passes"), rows)}

    def _parameters(self):
        p = self.parameters
        rows = [(n, finite(v["value"]), f"{finite(v['ci95'][0])} to {finite(v['ci95'][1])}",
                 v["unit"], sentences._note(v), v.get("description") or "") for n, v in p["parameters"].items()]
        words = sentences.summary_parameters(p)
        lines = [line for line in words if line.startswith(("Not determined", "Weak", "Error"))]
        return {"lines": lines, "chart": self._keep(charts.intervals(p)),
                "table": _table("Fitted parameters", ("parameter", "value", "95 %", "unit", "", "meaning"), rows)}

    # ---- next, again

    def _next(self):
        lines = []
        for c in self.first["candidates"]:
            if c["accepted"] and c["twins"]:
                experiment = c.get("experiment") or annotation(
                    self.library, find_effect(self.library, c["effect"]).model).get("experiment")
                names = ", ".join(f"{t['effect']} at {t['place']}" for t in c["twins"])
                lines += [f"To tell {c['effect']} at {c['place']} from {names}: {experiment}."] if experiment else []
        lines += sentences.summary_undetectable(self.last["undetectable"])
        study = self.dataset.study
        lines.append(f"'pycosim plan {study.path.name}' turns this into a motion of the motors: one that narrows the "
                     "intervals, or tells the effects above apart"
                     + ("." if study.limits else ", once a [limits] table in the study says what may move how far."))
        smallest = self.last.get("smallest_detectable") or []
        rows = [(e["effect"], e["place"], f"{e['coefficient']} = {number(e['value'])} {e['unit']}",
                 f"{100 * e['error_share']:.2g}") for e in smallest if e.get("value") is not None]
        tables = [_table("The smallest effect that these data would have shown",
                         ("effect", "place", "coefficient", "share of the error [%]"), rows)] if rows else []
        return {"lines": lines, "tables": tables}

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


def write_report(path, dataset, improvement, command, checked=None):
    """Write the page of a search.

    Parameters
    ----------
    path : Path
        The HTML file.
    dataset : Dataset
    improvement : Improvement
    command : str
        What makes this page again.
    checked : Checked, optional
        What the check of the data found.

    Returns
    -------
    list of Chart
        What is drawn on it.
    """
    page = Page(dataset, improvement, command, checked)
    path.write_text(page.html(), encoding="utf-8")
    return page.charts


def write_numbers(folder, drawn):
    """Write what charts draw, as CSV, a file a chart.

    Parameters
    ----------
    folder : Path
        Made where it is missing.
    drawn : list of Chart
    """
    folder.mkdir(parents=True, exist_ok=True)
    for chart in drawn:
        columns = {n: pd.Series(v) for n, v in chart.columns().items()}
        pd.DataFrame(columns).to_csv(folder / f"{chart.id}.csv", index=False)


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

"""Fits, diagnoses and ladders in; the JSON files of a verb, sentences an engineer reads, and a result folder, out."""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import threading
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from . import cards
from ..diagnosis.compare import worded
from ..compile import Place, component_name, find_effect
from ..compile.effects import annotation
from ..core.errors import PycosimError
from ..fit.nullspace import null_directions, number, weak_directions
from ..study.schema import Setting

SCHEMA = 1
MARKER = ".pycosim"


class FolderError(PycosimError):
    """A result folder cannot be made, or holds what pycosim did not write."""


# --- JSON -----------------------------------------------------------------------------------------------------------


def plain(value):
    """A value as JSON knows it: NumPy's types unwrapped, NaN and infinities to None.

    Parameters
    ----------
    value : object

    Returns
    -------
    dict, list, str, bool, int, float or None
    """
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value if value is None else str(value)


def to_json(value):
    """JSON text of a result; never NaN or infinity.

    Parameters
    ----------
    value : dict

    Returns
    -------
    str
    """
    return json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def parameters(fit, model, seed):
    """``parameters.json``.

    Parameters
    ----------
    fit : Fit
    model : Model
        The model that was fitted.
    seed : int

    Returns
    -------
    dict
        Beyond the contract: ``stderr``, ``fixed`` (what was not fitted) and ``weak_directions``.
    """
    found = {}
    for name in fit.free:
        found[name] = {"value": fit.parameters[name], "ci95": fit.interval(name), "unit": fit.variables[name].unit,
                       "at_bound": fit.at_bound(name), "identifiable": fit.identifiable(name),
                       "stderr": fit.stderr[fit.free.index(name)] if fit.identifiable(name) else None,
                       "description": fit.variables[name].description}
    fixed = {n: {"value": v, "unit": fit.variables[n].unit} for n, v in fit.parameters.items()
             if n not in fit.free and n in fit.variables}
    owners = {component_name(e, p): p.components[0] for e, p in model.attached if len(p.components) == 1}
    return plain({"schema": SCHEMA, "parameters": found, "null_directions": null_directions(fit, owners),
                  "weak_directions": weak_directions(fit), "error": fit.error, "seed": seed, "fixed": fixed})


def diagnosis(found, library):
    """``diagnosis.json``.

    Parameters
    ----------
    found : Diagnosis
    library : Library

    Returns
    -------
    dict
        Beyond the contract, ``refitted``: candidates that were only scored have expected coefficients without interval;
        ``conditional``: the interval comes from the data that chose the effect, and holds if the effect is there;
        the cards of `cards`, what the log varies, and where an unexplained residual lives.
    """
    return plain({"schema": SCHEMA, "verdict": found.verdict, "error": found.error, "noise_floor": found.noise_floor,
                  "candidates": [_candidate(c, library, found.error) for c in found.candidates],
                  "residual_depends_on": found.residual_depends_on, "undetectable": found.undetectable,
                  "excitation": found.excitation, "smallest_detectable": found.smallest,
                  "unexplained": found.unexplained})


def _candidate(c, library, error):
    if not c.coefficients:
        from ..diagnosis.table import effect_question
        known = effect_question(library, find_effect(library, c.effect)).variables
        names = {n.rsplit(".", 1)[-1]: v for n, v in c.start.items()}
        c.coefficients = {n: {"value": v, "ci95": [None, None], "unit": known[n].unit if n in known else "1"}
                          for n, v in names.items()}
    return {"effect": c.effect, "place": c.place, "accepted": c.accepted, "p_value": c.p_value,
            "p_value_single": c.p_value_single, "predicted_error": c.predicted_error,
            "predicted_fall": cards.fall(error, c.predicted_error), "held_out_error": c.held_out_error or None,
            "coefficients": c.coefficients, "conditional": c.fit is not None, "twins": c.twins,
            "refitted": c.fit is not None, "experiment": cards.experiment(library, c),
            "variable": cards.variable(library, c), "sentence": cards.sentence(library, c, error)}


def ladder(steps, dataset):
    """``ladder.json``: errors of the base model, then with every effect added.

    Parameters
    ----------
    steps : list of Step
        Of an `Improvement`.
    dataset : Dataset

    Returns
    -------
    dict
    """
    return plain({"schema": SCHEMA, "held_out": dataset.held_out_ranges(), "steps": [
        {"added": None if s.added is None else {"effect": s.added[0], "place": s.added[1]},
         "error": s.error, "held_out_error": s.held_out_error,
         "predicted_error": s.finding.predicted_error or None if s.finding else None} for s in steps]})


def improved_study(study, model, fit):
    """The study with a model's effects, and the fitted values to start from.

    Parameters
    ----------
    study : Study
    model : Model
    fit : Fit

    Returns
    -------
    Study
    """
    settings = dict(study.parameters)
    for name in fit.free:
        old, variable = settings.get(name, Setting(fixed=False)), fit.variables[name]
        value = min(max(float(f"{fit.parameters[name]:.9g}"), variable.min), variable.max)
        settings[name] = replace(old, value=value)
    for effect, place in model.attached:  # other logs have other means, and would make other coefficients of the fitted
        for name in (f"{component_name(effect, place)}.{n}" for n in effect.means):
            settings[name] = Setting(value=float(f"{fit.parameters[name]:.9g}"), fixed=True)
    return replace(study, effects=[(e.id, p.name) for e, p in model.attached], parameters=settings)


# --- sentences ------------------------------------------------------------------------------------------------------


def errors_text(error):
    """Errors in words.

    Parameters
    ----------
    error : dict of str to float
        By channel; None or NaN where it is not known.

    Returns
    -------
    str
        As ``C_H 0.138 N.m, C_K 0.141 N.m``.
    """
    known = {c: v for c, v in error.items() if v is not None and math.isfinite(v)}
    return ", ".join(f"{c} {number(v)}{_unit(_unit_of(c))}" for c, v in known.items()) or "unknown"


def _unit_of(channel):
    if channel.startswith("q"):
        return "rad"
    return "V" if channel.startswith("voltage") else "N.m"


def _unit(unit):
    return "" if unit in ("1", "") else f" {unit}"


def _change(before, after):
    """``C_H 0.235 -> 0.138 N.m`` for every channel of both."""
    return ", ".join(f"{c} {number(before[c])} -> {number(after[c])}{_unit(_unit_of(c))}" for c in before if c in after)


def _coefficient(name, c):
    if c["value"] is None:
        return f"{name} unknown"
    text = f"{name} = {number(c['value'])}{_unit(c['unit'])}"
    low, high = c["ci95"]
    return text + (f" (95 %: {number(low)} to {number(high)})" if low is not None and high is not None else "")


def _joined(names):
    names = list(names)
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def summary_data(dataset):
    """What was used of the logs.

    Parameters
    ----------
    dataset : Dataset

    Returns
    -------
    list of str
    """
    moving, held = int(dataset.moving.sum()), int(dataset.is_test.sum())
    runs = f"{len(dataset.logs)} {'run' if len(dataset.logs) == 1 else 'runs'}"
    samples = "the mean of each is a sample" if dataset.averaged else f"{len(dataset.time)} samples"
    blocks = "means" if dataset.averaged else "passes out and back"
    lines = [f"{dataset.study.rig}: {runs}, {samples}, {moving} of them moving "
             f"(every segment above {number(dataset.w_min)} rad/s); {held} of {len(dataset.blocks)} {blocks} held out."]
    for log in dataset.logs:
        if "means_of" in log.meta:
            lines.append(f"{log.name}: {log.meta['file_rows']:,} rows, read as means of {log.meta['means_of']}.")
        if log.dropped:
            rows = sum(b - a + 1 for a, b in log.dropped)
            lines.append(f"{log.name}: {rows} {'row' if rows == 1 else 'rows'} left out.")
    if dataset.paired:
        lines.append("No torque reference: errors are half the difference between a pass out and its way back.")
    return lines


def summary_doubt(dataset, fit):
    """Whether a slip in the study or the log is likelier than a missing effect.

    Parameters
    ----------
    dataset : Dataset
    fit : Fit
        Of the base model.

    Returns
    -------
    list of str
        One line, or none.
    """
    if dataset.paired or dataset.averaged:
        return []
    view = dataset.view("fit")
    share = {c: fit.error[c] / max(np.std(dataset.measured[c][view]), 1e-300)
             for c in dataset.channels if c in dataset.measured}
    if not share or np.mean(np.square(list(share.values()))) < 1.0:
        return []
    return [f"Doubtful: the fitted model misses {_joined(share)} by more than a constant would; check units, signs, "
            "zeros and the order of the columns before believing what follows."]


def _aligned(rows):
    """Rows of text in columns."""
    widths = [max(len(r[k]) for r in rows) for k in range(len(rows[0]) - 1)]
    return ["  ".join(c.ljust(w) for c, w in zip(r, (*widths, 0))).rstrip() for r in rows]


def summary_cosimulation(result):
    """What was stepped together, and where the signals went.

    Parameters
    ----------
    result : dict
        ``cosim.json``.

    Returns
    -------
    list of str
    """
    lines = [f"{result['scenario']}: {number(result['time'])} of {number(result['duration'])} s, "
             f"{result['rows']} rows of {len(result['columns'])} signals at {number(result['log_rate'])} Hz, "
             f"{result['method']} in the order"]
    lines += [f"  {c['name']}: {c['is']}, {c['what']}, {number(c['rate'])} Hz" for c in result["components"]]
    if result["unconnected"]:
        lines.append(f"Connected to nothing, so at their start values: {', '.join(result['unconnected'])}.")
    rows = [("column", "least", "largest", "rms"), *((n, *(number(r[k]) for k in ("min", "max", "rms")))
                                                    for n, r in result["columns"].items())]
    return lines + _aligned(rows)


def summary_parameters(result):
    """Parameters with intervals, and what the data cannot tell.

    Parameters
    ----------
    result : dict
        ``parameters.json``.

    Returns
    -------
    list of str
    """
    rows = [("parameter", "value", "95 %", "unit", "")]
    for name, p in result["parameters"].items():
        rows.append((name, _finite(p["value"]), f"{_finite(p['ci95'][0])} to {_finite(p['ci95'][1])}",
                     "" if p["unit"] == "1" else p["unit"], _note(p)))
    lines = _aligned(rows)
    directions = list(dict.fromkeys(d["text"] for d in result["null_directions"]))
    lines += [f"Not determined: {t}." for t in directions]
    lines += [f"Weak: {d['text']}." for d in result["weak_directions"]]
    lines.append(f"Error on the fitted passes: {errors_text(result['error'])} (RMSE of moving samples).")
    return lines


def _finite(value):
    if value is None:
        return "any"
    return number(value, 1e-2)  # a bound of zero is approached to 5e-8


def _note(p):
    notes = []
    if not p["identifiable"]:
        notes.append("not determined by itself; the range is what the bounds allow")
    if p["at_bound"]:
        notes.append(f"at its {'lower' if p['at_bound'] == 'min' else 'upper'} bound")
    return "; ".join(notes)


def summary_diagnosis(result, library=None, final=False):
    """What is missing, how sure, what it would bring, and what these data cannot show.

    Parameters
    ----------
    result : dict
        ``diagnosis.json``.
    library : Library, optional
        To name the experiment that separates twins.
    final : bool
        Of the improved model: nothing missing means nothing else.

    Returns
    -------
    list of str
    """
    lines = {"missing_effect": _missing, "unexplained": _unexplained, "nothing_missing": _nothing,
             "not_enough_excitation": _too_little}[result["verdict"]](result, library, final)
    return lines + _smallest(result["smallest_detectable"]) + summary_undetectable(result["undetectable"])


def _smallest(entries, most=4):
    """The effects that could hide best in this log: the largest sizes that it would not show."""
    worst = {}
    for e in sorted(entries, key=lambda e: -(e["error_share"] or 0)):
        worst.setdefault(e["effect"], e)
    hidden = [f"{e['effect']} at {e['place']} below {e['coefficient']} = {number(e['value'])}{_unit(e['unit'])}"
              for e in list(worst.values())[:most]]
    if not hidden:
        return []
    return [f"What could still hide (above that size it is found in nine logs of ten): {'; '.join(hidden)}."]


def _missing(result, library, final):
    best = next(c for c in result["candidates"] if c["accepted"])
    numbers = ", ".join(_coefficient(n, c) for n, c in best["coefficients"].items())
    lines = [f"Missing: {best['effect']} at {best['place']} (p = {number(best['p_value'])} family-wise). {numbers}.",
             f"Error with it, predicted: {_change(result['error'], best['predicted_error'])}; "
             f"noise floor {errors_text(result['noise_floor'])}."]
    if best["held_out_error"]:
        lines.append(f"Error with it on passes never fitted: {errors_text(best['held_out_error'])}.")
    return lines + _twins(best, library)


def _twins(best, library):
    """What these data cannot tell a candidate from, and what would."""
    if not best["twins"]:
        return []
    line = f"These data cannot tell it from {_joined(_names(best['twins']))}"
    if library is not None:
        experiment = annotation(library, find_effect(library, best["effect"]).model).get("experiment")
        line += f"; to tell them apart, {experiment}" if experiment else ""
    return [line + "."]


def _names(pairs):
    return [f"{p['effect']} at {p['place']}" for p in pairs]


def _unexplained(result, library, final):
    depends = [f"{d['variable']} ({number(d['strength'])})" for d in result["residual_depends_on"][:3]
               if d["strength"] > 0]
    line = f"Something {'else ' if final else ''}is missing that no effect of the library explains"
    line += f"; what is left depends most on {_joined(depends)}." if depends else "."
    significant = [c for c in result["candidates"] if c["p_value"] < 0.01][:3]
    if significant:
        line += (f" Significant, but no better on passes they were not fitted to: "
                 f"{_joined(_names(significant))}.")
    mystery = result["unexplained"]
    if mystery and mystery["proposal"]:
        line += f" {mystery['proposal']['text']}"
        if mystery["proposal"]["file"]:
            line += (" It is written as guess.mo, to be tried as an effect of your own: "
                     "modelica = [\"guess.mo\"] in [rig].")
    return [line, _at_floor(result)]


def _at_floor(result):
    return f"Error {errors_text(result['error'])}; noise floor {errors_text(result['noise_floor'])}."


def _nothing(result, library, final):
    line = f"Nothing {'else ' if final else ''}is missing that these data could show"
    tested = len(result["candidates"])
    best = min(result["candidates"], key=lambda c: c["p_value"], default=None)
    if best:
        line += (f": of {tested} candidates the likeliest is {best['effect']} at {best['place']}, "
                 f"p = {number(best['p_value'])} family-wise")
    return [line + ".", _at_floor(result)]


def _too_little(result, library, final):
    return ["These data move too little, or too much alike, to tell whether an effect is missing; see below what each "
            "effect needs.", _at_floor(result)]


def summary_undetectable(entries):
    """What the data cannot show: one line a reason.

    Parameters
    ----------
    entries : list of dict
        ``undetectable`` of ``diagnosis.json``.

    Returns
    -------
    list of str
    """
    groups = {}
    for entry in entries:
        places = groups.setdefault((entry["why"], entry["experiment"]), {})
        places.setdefault(entry["effect"], []).append(entry["place"])
    return [f"Not visible ({why}): "
            + "; ".join(f"{effect} at {', '.join(p)}" for effect, p in effects.items())
            + (f". To see it: {experiment}." if experiment else ".")
            for (why, experiment), effects in groups.items()]


def summary_improvement(first, last, ladder, parameters, library=None):
    """The whole story of a search: what was missing, step by step, and what is left.

    Parameters
    ----------
    first, last : dict
        ``diagnosis.json`` and ``diagnosis_final.json``.
    ladder, parameters : dict
        ``ladder.json`` and ``parameters.json``.
    library : Library, optional

    Returns
    -------
    list of str
    """
    steps, floor = ladder["steps"], errors_text(last["noise_floor"])
    if len(steps) == 1:
        return summary_diagnosis(first, library)
    lines = [f"Base model: error {errors_text(steps[0]['error'])}"
             + (f"; held-out {errors_text(steps[0]['held_out_error'])}" if steps[0]["held_out_error"] else "") + "."]
    for before, step in zip(steps, steps[1:]):
        lines += _step(before, step, first, parameters, library)
    best, added = first["candidates"][0], [(s["added"]["effect"], s["added"]["place"]) for s in steps[1:]]
    if best["accepted"] and (best["effect"], best["place"]) not in added:
        lines.append(f"{best['effect']} at {best['place']} was found first, in place of these, and is not needed "
                     "beside them.")
    if len(steps) > 2:
        lines.append(f"In all: error {_change(steps[0]['error'], steps[-1]['error'])}; "
                     f"held-out {_change(steps[0]['held_out_error'], steps[-1]['held_out_error'])}.")
    return [*lines, f"Noise floor: {floor}.", *summary_diagnosis(last, library, final=True)]


def _step(before, step, first, parameters, library):
    """An effect that was added: its coefficients in the final model, what was expected of it, and what it brought."""
    name, place = step["added"]["effect"], step["added"]["place"]
    found = next((c for c in first["candidates"] if c["accepted"] and (c["effect"], c["place"]) == (name, place)), None)
    base = component_name(find_effect(library, name), Place(place, ())) if library else ""
    numbers = ", ".join(_coefficient(n[len(base) + 1:], p) for n, p in parameters["parameters"].items()
                        if n.startswith(f"{base}."))
    sure = f" (p = {number(found['p_value'])} family-wise)" if found else ""
    first_one = before["added"] is None
    lines = [f"{'Missing' if first_one else 'Then missing'}: {name} at {place}{sure}. {numbers}.",
             f"  Error {_change(before['error'], step['error'])}"
             + (f" (predicted {errors_text(step['predicted_error'])})" if step["predicted_error"] else "")
             + (f"; held-out {_change(before['held_out_error'], step['held_out_error'])}"
                if step["held_out_error"] else "") + "."]
    return lines + (_twins(found, library) if found else [])


def summary_comparison(result, most=3):
    """Errors, and the groups of samples where they are largest.

    Parameters
    ----------
    result : dict
        ``comparison.json``.
    most : int
        Groups to name for each channel.

    Returns
    -------
    list of str
    """
    lines = [f"Error: {errors_text(result['error'])} (RMSE of moving samples, all passes)."]
    if result.get("error_as_given"):
        lines.append(f"With the study's own values, nothing fitted: {errors_text(result['error_as_given'])}.")
    for channel, whole in result["error"].items():
        spread = []
        for name, groups in result["by"].items():
            values = {label: e[channel] for label, e in groups.items() if e.get(channel) is not None}
            if len(values) > 1:
                worst = max(values, key=values.get)
                spread.append((values[worst] / max(whole, 1e-300), name, worst, values[worst]))
        worst = sorted(spread, reverse=True)[:most]
        if worst:
            lines.append(f"{channel} is worst where " + "; ".join(
                f"{_article(name)}{worded(name)} is {label}{_unit(result['units'].get(name, ''))} "
                f"({number(value)}{_unit(_unit_of(channel))})" for _, name, label, value in worst) + ".")
    return lines


def _article(name):
    """The names of columns stand without one."""
    return "" if worded(name) == name else "the "


# --- the folder -----------------------------------------------------------------------------------------------------


class Folder:
    """Results of one verb: written beside the folder, and put in its place when whole.

    Parameters
    ----------
    path : path
        Where the results go; missing parents are made. Earlier results of the same verb are replaced whole; results of
        other verbs, and what the user added to a result folder, stay.
    verb : str
    given : path, optional
        The study, which must not be replaced.
    writes : sequence of str
        Names of the files that the verb will write.

    Raises
    ------
    FolderError
        The folder holds what is not ours, or cannot be made.
    """

    def __init__(self, path, verb, given=None, writes=()):
        self.path, self.verb = Path(os.path.realpath(path)), verb
        self.owned = self._check()
        if given is not None and Path(given).resolve() in [self.path / name for name in writes]:
            raise FolderError(f"{given}: is the given study, which is never changed; name another folder "
                              "with --out DIR")
        self.temporary = self.path.with_name(f".{self.path.name}.{os.getpid()}")
        self.parents = []

    def _check(self):
        """Files by the verb that wrote them."""
        if not os.path.lexists(self.path):
            return {}
        if not self.path.is_dir():
            raise FolderError(f"{self.path}: is a file; name another folder with --out DIR")
        if self.path == Path.cwd():
            raise FolderError(f"{self.path}: is the current folder, which cannot be replaced whole; "
                              "name a folder in it with --out DIR")
        marker = self.path / MARKER
        try:
            return {str(v): list(map(str, f)) for v, f in json.loads(marker.read_text()).items()}
        except FileNotFoundError:
            if any(self.path.iterdir()):
                raise FolderError(f"{self.path}: holds files that are not results of pycosim; empty it, or name "
                                  "another folder with --out DIR") from None
            return {}
        except (OSError, ValueError, AttributeError, TypeError):
            raise FolderError(f"{self.path}: its {MARKER} cannot be read; name another folder with --out DIR") from None

    def __enter__(self):
        for parent in reversed(self.path.parents):
            self._make(parent)
        self._make(self.temporary)
        return self

    def _make(self, folder):
        try:
            if not folder.is_dir():
                folder.mkdir()
                self.parents.insert(0, folder)
        except OSError as error:
            self._undo()
            raise FolderError(f"{self.path}: cannot be written ({error.strerror}: {folder}); "
                              "name another folder with --out DIR") from None

    @property
    def listed(self):
        """What the verb left, in words: its files, then its folders."""
        folders = dict.fromkeys(f"{name.split('/')[0]}/" for name in self.files if "/" in name)
        return ", ".join([*(name for name in self.files if "/" not in name), *folders])

    def file(self, name):
        """Where to write a file, until the folder is whole.

        Parameters
        ----------
        name : str

        Returns
        -------
        Path
        """
        return self.temporary / name

    def write(self, name, content):
        """Write one file.

        Parameters
        ----------
        name : str
        content : str or dict
            Text, or a result for JSON.

        Raises
        ------
        FolderError
        """
        with _folder_errors(self.path):
            self.file(name).write_text(content if isinstance(content, str) else to_json(content), encoding="utf-8")

    def __exit__(self, kind, error, trace):
        if kind is None:
            try:
                with _folder_errors(self.path), _uninterrupted():
                    self._put()
                return
            except BaseException:
                self._undo()
                raise
        self._undo()

    def _undo(self):
        shutil.rmtree(self.temporary, ignore_errors=True)
        for folder in self.parents:
            if folder != self.temporary:
                try:
                    folder.rmdir()
                except OSError:
                    pass

    def _put(self):
        written = sorted(p.relative_to(self.temporary).as_posix() for p in self.temporary.rglob("*") if p.is_file())
        self.files = written
        old = set(self.owned.pop(self.verb, [])) | {MARKER}
        owned = {v: [f for f in files if f not in written] for v, files in self.owned.items()}
        if self.path.is_dir():
            for source in sorted(p for p in self.path.rglob("*") if p.is_file()):
                name = source.relative_to(self.path).as_posix()
                if name not in old and name not in written:
                    self.file(name).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copy2(source, self.file(name))
        owned = {v: files for v, files in owned.items() if files} | {self.verb: written}
        self.file(MARKER).write_text(json.dumps(owned, indent=1), encoding="utf-8")
        backup = self.temporary.with_name(self.temporary.name + ".old")
        if self.path.is_dir():
            os.replace(self.path, backup)
        try:
            os.replace(self.temporary, self.path)
        except BaseException:
            if backup.is_dir():
                os.replace(backup, self.path)
            raise
        shutil.rmtree(backup, ignore_errors=True)


@contextmanager
def _uninterrupted():
    """Control-C comes too late: between two renames it would leave the earlier results under another name."""
    if threading.current_thread() is not threading.main_thread():
        yield  # no other thread is ever interrupted
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _folder_errors(path):
    try:
        yield
    except OSError as error:
        raise FolderError(f"{path}: cannot be written ({error.strerror or error}); "
                          "name another folder with --out DIR") from None

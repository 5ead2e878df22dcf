"""A verb and its settings in; its results in a folder and in sentences out."""

from __future__ import annotations

import os
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

from ..core.errors import PycosimError, StudyError, UnknownNameError
from ..report import records, sentences
from ..report.folder import Folder
from .parser import VERBS, WRITES, Stopped, UsageError


class Run:
    """One verb on one study: what is shared by all verbs that have one.

    Parameters
    ----------
    arguments : argparse.Namespace
    progress : callable
    """

    def __init__(self, arguments, progress):
        from ..compile import Library
        from ..study.parse import load_study

        self.progress, self.verb = progress, arguments.verb
        self.study, self.given = load_study(arguments.study), arguments.data
        if arguments.data:
            self.study = self.study.with_data(arguments.data)
        if getattr(arguments, "robust", False):
            self.study = replace(self.study, robust=True)
        self.library = Library(self.study.modelica)
        self.model = self.study.validate(self.library)
        self.out = Path(arguments.out or f"{self.study.name}_{self.verb}")
        self.folder = Folder(self.out, self.verb, self.study.path, WRITES[self.verb])
        self.lines = []

    def read(self):
        """Read the logs.

        Returns
        -------
        Dataset
        """
        from ..data.dataset import Dataset
        self.progress("reading the logs")
        self.dataset = Dataset(self.study, self.library)
        self.lines += sentences.summary_data(self.dataset)
        return self.dataset

    def fit(self, model=None):
        """Fit the study's free parameters.

        Parameters
        ----------
        model : Model, optional
            The study's by default.

        Returns
        -------
        Fit
        """
        from ..fit import least_squares
        self.progress("fitting")
        fit = least_squares.fit(self.dataset, model or self.model)
        self.lines += sentences.summary_doubt(self.dataset, fit)
        return fit

    def compare(self, model, fit):
        """``comparison.json`` of a fitted model, the error with the study's own values included.

        Parameters
        ----------
        model : Model
        fit : Fit

        Returns
        -------
        dict
        """
        from ..diagnosis import compare
        from ..fit import least_squares
        result = compare.compare(self.dataset, model, fit)
        if self.verb == "compare":
            given = least_squares.fit(self.dataset, model, free=[])
            result["error_as_given"] = compare.errors(self.dataset, model, given, "all")
        return records.plain(result)

    def write(self, name, result):
        """Write one result; the verb's main file is kept for ``--json``.

        Parameters
        ----------
        name : str
        result : dict or str
        """
        text = result if isinstance(result, str) else records.to_json(result)
        self.folder.write(name, text)
        if name == VERBS[self.verb][1]:
            self.main = text

    def write_model(self, model, fit):
        """The study with the model's effects, its parameters, and its errors.

        Parameters
        ----------
        model : Model
        fit : Fit

        Returns
        -------
        dict
            ``parameters.json``.
        """
        from ..study.write import write_study
        parameters = records.parameters(fit, model, self.study.seed)
        self.write("parameters.json", parameters)
        self.write("comparison.json", self.compare(model, fit))
        write_study(records.improved_study(self.study, model, fit), self.folder.file("study.toml"))
        return parameters

    def write_guess(self, diagnosis):
        """A guessed shape as a file of an effect, where there is one that an effect can read.

        Parameters
        ----------
        diagnosis : dict
            ``diagnosis.json``.
        """
        proposal = (diagnosis["unexplained"] or {}).get("proposal") or {}
        if proposal.get("file"):
            self.write("guess.mo", proposal["file"])

    def draw(self, function, *arguments):
        """Figures, into the folder of the results.

        Parameters
        ----------
        function : str
            Of `pycosim.report.figures`.
        *arguments
            Its arguments after folder and data set.
        """
        from ..report import figures
        self.progress("drawing")
        getattr(figures, function)(self.folder.temporary, self.dataset, *arguments)

    def page(self, found):
        """The report of a search, and for its own verb the numbers behind it.

        Parameters
        ----------
        found : Improvement
        """
        from ..report.page import write_numbers, write_report
        self.progress("writing the report")
        charts = write_report(self.folder.file("report.html"), self.dataset, found, again(self.study, self.given))
        if self.verb == "report":
            write_numbers(self.folder.file("data"), charts)


# --- verbs ----------------------------------------------------------------------------------------------------------


def _compare(run, arguments):
    fit = run.fit()
    result = run.compare(run.model, fit)
    run.write("comparison.json", result)
    run.draw("write_comparison", run.model, fit)
    run.lines += sentences.summary_comparison(result)


def _identify(run, arguments):
    if not run.dataset.free(run.model):
        raise StudyError(f"{run.study.path}: no parameter is free; write fixed = false at those to identify")
    result = records.parameters(run.fit(), run.model, run.study.seed)
    run.write("parameters.json", result)
    run.lines += sentences.summary_parameters(result)


def _diagnose(run, arguments):
    from ..compile import compile_model
    from ..diagnosis import compare
    from ..diagnosis.search import diagnosed
    found = diagnosed(run.dataset, run.model, run.fit(), run.study.seed, run.progress)
    if found.winner is not None and run.dataset.is_test.any():
        larger = compile_model(run.library, run.study.rig, [*run.study.effects, found.winner.key])
        found.winner.held_out_error = compare.errors(run.dataset, larger, found.winner.fit, "test")
    result = records.diagnosis(found, run.library)
    run.write("diagnosis.json", result)
    run.write_guess(result)
    run.lines += sentences.summary_diagnosis(result, run.library)


def _add(run, arguments):
    from ..diagnosis import compare
    chosen, told = best_place(run, *run.effect)
    model, fit = chosen
    run.lines += told
    before, after = (compare.errors(run.dataset, m, f, "fit") for m, f in ((run.model, run.base), (model, fit)))
    run.lines.append(f"Error on the fitted passes: {sentences.change_text(before, after)}.")
    run.lines += sentences.summary_parameters(run.write_model(model, fit))
    run.draw("write_comparison", model, fit)


def _improve(run, arguments):
    from ..diagnosis.search import improve
    found = improve(run.dataset, run.model, run.study.seed, run.progress)
    run.lines += sentences.summary_doubt(run.dataset, found.steps[0].fit)
    first, last = (records.diagnosis(d, run.library) for d in (found.first, found.last))
    steps = records.ladder(found.steps, run.dataset)
    run.write("diagnosis.json", first)
    run.write("diagnosis_final.json", last)
    run.write("ladder.json", steps)
    run.write_guess(last)
    parameters = run.write_model(found.model, found.fit)
    run.write("model.mo", found.model.text.rstrip("\n") + "\n")
    run.draw("write_figures", found)
    run.page(found)
    run.lines += sentences.summary_improvement(first, last, steps, parameters, run.library)
    run.lines += sentences.summary_parameters(parameters)


def _export(run, arguments):
    from ..export import export
    run.progress("exporting")
    kinds = arguments.type.split(",")
    done = export(run.study, run.model, run.folder.temporary, arguments.to, int(arguments.fmi), kinds,
                  arguments.platforms, arguments.real)
    run.write("export.json", done.description)
    run.lines += done.lines


def again(study, data):
    """The command that makes a report of this study.

    Parameters
    ----------
    study : Study
    data : list of str or None
        Logs given instead of the study's.

    Returns
    -------
    str
    """
    import shlex
    robust = ["--robust"] if study.robust else []
    return shlex.join(["pycosim", "report", study.path.name, *robust, *(["--data", *data] if data else [])])


def _plan(run, arguments):
    from ..design import plan
    from ..report import plan_figures, plan_results
    fit = None
    if run.dataset is not None:
        fit = run.fit()
    known = plan.known(run.study, run.library, run.model, run.dataset, fit)
    blocks = None
    if arguments.between:
        keys = [tuple(text.partition("@")[::2]) for text in arguments.between]
        blocks = plan.twins_of(known, [keys], run.progress)
    goal = "twins" if arguments.between else arguments.goal
    found = plan.make_plan(known, goal, arguments.budget, arguments.rate, blocks, arguments.criterion, run.progress)
    result = plan_results.plan(found)
    run.write("plan.json", result)
    run.write("plan.csv", plan_results.csv(found))
    run.progress("drawing")
    plan_figures.write_plan(run.folder.temporary, found)
    run.lines += plan_results.summary(result)


VERB = {"compare": _compare, "identify": _identify, "diagnose": _diagnose, "add": _add, "improve": _improve,
        "report": _improve, "plan": _plan, "export": _export}


def checked_effect(run, text):
    """Effect and candidate places of ``EFFECT[@PLACE]``.

    Parameters
    ----------
    run : Run
    text : str

    Returns
    -------
    effect : str
    places : list of str
        The given place, or all places of the rig that the effect can still be added at.

    Raises
    ------
    UnknownNameError, StudyError
    """
    from ..compile import find_effect, find_place, places
    name, at, place = text.partition("@")
    effect = find_effect(run.library, name)
    if at:
        wanted = [find_place(run.library, run.study.rig, effect, place)]
    else:
        wanted = places(run.library, run.study.rig, effect)
    if not wanted:
        find_place(run.library, run.study.rig, effect, "")
    acting = {(e.id, c): p.name for e, p in run.model.attached for c in p.components}
    allowed = [p for p in wanted if not run.study.rules_out(name, p.name)]
    if not allowed:
        raise StudyError(f"{run.study.path}: '{text}' is among [data] rejected; take it out there to add it")
    wanted = allowed
    free = [p for p in wanted if not any((name, c) in acting for c in p.components)]
    if not free:
        where = next(acting[name, c] for p in wanted for c in p.components if (name, c) in acting)
        raise StudyError(f"{run.study.path}: '{name}' at '{where}' is in the study already")
    rival = [f"{c}.{effect.replaces}" for p in free for c in p.components] if effect.replaces else []
    fitted = [n for n in rival if run.study.parameters.get(n) and run.study.parameters[n].fixed is False]
    if fitted:
        raise StudyError(f"{run.study.path}: '{name}' does what the free parameter '{fitted[0]}' does already; "
                         "fix that one first (fixed = true)")
    return name, [p.name for p in free]


def best_place(run, effect, places):
    """Refit with an effect at each of the places; the best by selection error.

    Parameters
    ----------
    run : Run
    effect : str
    places : list of str

    Returns
    -------
    chosen : (Model, Fit)
    lines : list of str
        What was done, and what it is worth.

    Raises
    ------
    StudyError
        The effect fits at none of them.
    """
    from ..compile import compile_model
    from ..diagnosis.crossval import select
    from ..diagnosis.decide import diagnose, nudged
    from ..fit import least_squares
    run.base = run.fit()
    found = diagnose(run.dataset, run.model, run.base, run.study.seed, run.progress)
    starts = {f.place: f for f in found.candidates if f.effect == effect}
    usual = select(run.dataset, run.model, run.base, found.noise).usual  # rivals are compared at one noise level
    tried = []
    for place in places:
        run.progress(f"fitting {effect} at {place}")
        model = compile_model(run.library, run.study.rig, [*run.study.effects, (effect, place)])
        finding = starts.get(place)
        try:
            start = {**run.base.parameters, **(finding.start if finding else {})}
            fit = least_squares.fit(run.dataset, model, nudged(start, model, finding))
            error = select(run.dataset, model, fit, found.noise, usual).white.sum() + 2 * len(fit.free)
        except PycosimError:
            if len(places) == 1:
                raise
            continue
        tried.append((error, place, model, fit))
    if not tried:
        raise StudyError(f"{run.study.path}: '{effect}' cannot be fitted at any place of {run.study.rig} on these data")
    _, place, model, fit = min(tried, key=lambda t: t[0])
    lines = [f"Added {effect} at {place}" + (
        f", the best of {', '.join(p for _, p, _, _ in tried)} by cross-validation." if len(places) > 1 else ".")]
    finding = starts.get(place)
    if finding is not None and finding.p_value >= 0.01:
        lines.append(f"These data do not ask for it: p = {finding.p_value:.3g} family-wise.")
    hidden = next((u for u in found.undetectable if (u["effect"], u["place"]) == (effect, place)), None)
    if hidden:
        lines.append(f"These data can hardly show it ({hidden['why']}); its coefficients mean little. "
                     f"To see it: {hidden['experiment']}.")
    return (model, fit), lines


def demo(arguments, progress):
    """Make a log with a hidden effect, and find the effect.

    Parameters
    ----------
    arguments : argparse.Namespace
    progress : callable

    Returns
    -------
    Path
        Folder of the results.

    Raises
    ------
    UsageError
        A log was given.
    """
    if arguments.data:
        raise UsageError("demo makes its own log; for yours: pycosim improve STUDY --data FILE")
    from . import demo
    out = Path(arguments.out or "demo")
    demo.run(out, arguments.quiet or arguments.json, progress)
    return out


def app(arguments, progress):
    """Serve the app until Ctrl-C.

    Parameters
    ----------
    arguments : argparse.Namespace
    progress : callable

    Raises
    ------
    UsageError
        The app's own dependency is not installed.
    """
    try:
        from ..app.page import serve
    except ModuleNotFoundError as error:
        if error.name != "nicegui":
            raise
        raise UsageError("the app needs nicegui; pip install 'pycosim-drivetrain[app]'") from None
    name = Path(arguments.study).stem if arguments.study else "study"
    out = arguments.out or f"{name}app"
    say = (lambda text: None) if arguments.quiet else partial(print, flush=True)
    serve(arguments.study, arguments.data, out, arguments.port, not arguments.no_browser, progress, say)


# --- co-simulation --------------------------------------------------------------------------------------------------


def cosim(arguments, progress):
    """Run a scenario.

    Parameters
    ----------
    arguments : argparse.Namespace
    progress : callable

    Returns
    -------
    str
        Text for stdout.

    Raises
    ------
    Stopped
        At Ctrl-C, after the log up to there and a checkpoint are written.
    """
    from ..cosim.master import cosimulate
    from ..cosim.scenario import load_scenario
    from ..report import cosim_figures
    start = time.monotonic()
    scenario = load_scenario(arguments.scenario)
    if arguments.data:
        raise UsageError("cosim reads no log; the motion that it follows stands in the scenario")
    out = Path(arguments.out or f"{scenario.name}_cosim")
    resume = _checkpoint(arguments.resume) if arguments.resume else None
    if arguments.every is not None and not arguments.every >= 0:
        raise UsageError(f"--checkpoint-every {arguments.every:g}: seconds cannot be below zero")
    beside = out.with_name(f"{out.name}.checkpoint.zip")
    save = None if arguments.every is None else lambda data: _replace(beside, data)
    with Folder(out, "cosim", scenario.path, WRITES["cosim"]) as folder:
        done = cosimulate(scenario, arguments.until, resume, progress, save=save, every=arguments.every,
                          allow_python=arguments.allow_python)
        folder.write("run.csv", done.text)
        folder.write("cosim.json", done.description)
        if done.checkpoint:
            folder.file("checkpoint.zip").write_bytes(done.checkpoint)
        progress("drawing")
        cosim_figures.write_log(folder.temporary, done)
    if save:
        beside.unlink(missing_ok=True)  # what is in the folder now goes further
    allowed = f" --allow-python {' '.join(arguments.allow_python)}" if arguments.allow_python else ""
    again = f"pycosim cosim {arguments.scenario} --resume {out / 'checkpoint.zip'}{allowed}"
    if not done.complete and (arguments.until is None or done.time < arguments.until):
        raise Stopped(f"interrupted at t = {done.time:g} s; the log up to there is in {out}, to go on: {again}")
    if arguments.json:
        return records.to_json(done.description)
    lines = sentences.summary_cosimulation(done.description)
    if not done.complete:
        lines.append(f"To go on: {again}")
    took = time.monotonic() - start
    return "\n".join([*lines, f"Took {took:.1f} s.", f"Results in {out}: {', '.join(folder.files)}", ""])


def _replace(path, data):
    """Write a file whole, so that a crash leaves the one before."""
    new = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        new.write_bytes(data)
        new.replace(path)
    except OSError as error:
        new.unlink(missing_ok=True)
        raise UsageError(f"{path}: the checkpoint cannot be written ({error.strerror})") from None


def _checkpoint(path):
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise UnknownNameError(f"no checkpoint {path} ({error.strerror})") from None

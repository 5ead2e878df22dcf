"""A verb and its settings in; its results in a folder and in sentences out."""

from __future__ import annotations

import time
from contextlib import nullcontext, suppress
from functools import partial
from pathlib import Path
from types import SimpleNamespace

from ..core.errors import PycosimError, StudyError, UnknownNameError
from ..core.whole import write_whole
from ..report import records, sentences
from ..report.folder import Folder
from .parser import VERBS, WRITES, Stopped, UsageError

SEARCHES = "diagnose", "add", "improve", "report", "confirm"
"""Verbs that speak of physics, which a mistake of wiring or units must never be taken for."""
LOOKS = "diagnose", "improve", "report"
"""Verbs that take long, and have a first look meanwhile for who watches."""


def _opened(arguments, progress):
    """The study's project; of it, for an export, what that needs: the rest takes a second to import."""
    if arguments.verb != "export":
        from ..project import open_project
        return open_project(arguments.study, arguments.data, progress, getattr(arguments, "robust", False))
    from ..compile import Library
    from ..study.parse import load_study
    study = load_study(arguments.study)
    return SimpleNamespace(study=study, model=study.validate(Library(study.modelica)))


class Run:
    """One verb on one study: what is shared by all verbs that have one.

    Parameters
    ----------
    arguments : argparse.Namespace
        As `parser.parse` gives them.
    progress : callable
        Told the stages of long work.
    """

    def __init__(self, arguments, progress):
        self.progress, self.verb = progress, arguments.verb
        self.project = _opened(arguments, progress)
        self.out = Path(arguments.out or f"{self.project.study.name}_{self.verb}")
        self.folder = Folder(self.out, self.verb, self.project.study.path, WRITES[self.verb])
        self.lines = []

    @property
    def has_logs(self):
        """Whether the study or the command line names any."""
        return bool(self.project.study.runs or self.project.study.held_out)

    def read(self):
        """Check the logs, say what was used of them, and start no search with a mistake in them.

        Raises
        ------
        DataError
            A mistake of wiring or units, and the line of the study that mends it.
        """
        if self.verb in LOOKS and self.progress.shown:
            with suppress(PycosimError):  # what cannot be used is refused below, with what the check says of it
                self.project.first_look()
        checked = self.project.check()
        self.lines += checked.told
        if self.verb in SEARCHES:
            checked.refuse()
        self.lines += self.project.sentences

    def fit(self):
        """Fit the study's free parameters, and say what is doubtful.

        Returns
        -------
        Fitted
        """
        fitted = self.project.fit()
        self.lines += fitted.doubts
        return fitted

    def write(self, name, result):
        """Write one result; the verb's main file is kept for ``--json``.

        Parameters
        ----------
        name : str
            Of the file in the verb's folder.
        result : dict or str
            Text as it is, or a record for JSON.
        """
        text = result if isinstance(result, str) else records.to_json(result)
        self.folder.write(name, text)
        if name == VERBS[self.verb][1]:
            self.main = text

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
        getattr(figures, function)(self.folder.temporary, self.project.dataset, *arguments)


# --- verbs ----------------------------------------------------------------------------------------------------------


def _check(run, arguments):
    checked = run.project.check()
    run.write("check.json", checked.to_dict())
    run.lines += checked.sentences


def _compare(run, arguments):
    fitted = run.fit()
    result = fitted.compare(given=True)
    run.write("comparison.json", result.record)
    run.draw("write_comparison", fitted.model, fitted.solution)
    run.lines += result.sentences


def _identify(run, arguments):
    if not run.project.dataset.parameters.free(run.project.model):
        raise StudyError(f"{run.project.study.path}: no parameter is free; write fixed = false at those to identify")
    fitted = run.fit()
    run.write("parameters.json", fitted.to_dict())
    run.lines += fitted.sentences


def _diagnose(run, arguments):
    found = run.fit().diagnose()
    run.write("diagnosis.json", found.to_dict())
    if found.guess:
        run.write("guess.mo", found.guess)
    run.lines += found.sentences


def _add(run, arguments):
    before = run.fit()
    after = before.add(arguments.effect)
    run.project = after.project  # it may know the machine's own travels by now
    change = sentences.change_text(run.project.fit().error, after.error, run.project.dataset.units)
    run.lines += [*after.notes, f"Error on the fitted passes: {change}."]
    run.write("parameters.json", after.to_dict())
    run.write("comparison.json", after.compare().record)
    after.save(run.folder.file("study.toml"))
    run.lines += after.sentences
    run.draw("write_comparison", after.model, after.solution)


def _improve(run, arguments):
    from .beside import Beside
    dataset, bare = run.project.dataset, getattr(arguments, "bare", False)
    with Beside(dataset.library, run.project.study.rig) as beside:
        with beside.fits(dataset) if arguments.on is None else nullcontext():
            found = _improved(run)
        if bare:
            return
        run.draw("write_figures", found.found, beside.save)
        beside.begin()
        found.report(run.folder.file("report.html"), run.folder.file("data") if run.verb == "report" else None)
        beside.finish()


def _improved(run):
    """A search, with what it writes and says, but for figures."""
    found = run.project.improve()
    run.project = found.project  # it may know the machine's own travels by now
    run.lines += found.steps[0].fitted.doubts
    for name, content in found.files().items():
        run.write(name, content)
    found.save(run.folder.file("study.toml"))
    run.lines += [*found.sentences, *found.changes, *found.final.sentences]
    return found


def _export(run, arguments):
    from ..export import export
    run.progress("exporting")
    kinds = arguments.type.split(",")
    done = export(run.project.study, run.project.model, run.folder.temporary, arguments.to, int(arguments.fmi), kinds,
                  arguments.platforms, arguments.real, arguments.self_contained)
    run.write("export.json", done.description)
    run.lines += done.lines


def _confirm(run, arguments):
    found = run.project.confirm()
    run.write("confirmation.json", found.to_dict())
    run.lines += found.sentences


def _plan(run, arguments):
    from ..report import plan_figures
    if run.has_logs:
        run.fit()
    found = run.project.plan(arguments.goal, arguments.budget, arguments.rate, arguments.criterion, arguments.between)
    run.write("plan.json", found.to_dict())
    found.to_csv(run.folder.file("plan.csv"))
    run.progress("drawing")
    plan_figures.write_plan(run.folder.temporary, found.planned)
    run.lines += found.sentences


def still(run, error):
    """Answer for a log in which nothing moves, or too little for a fit: that is a verdict too.

    Parameters
    ----------
    run : Run
        Of the verb.
    error : StillError
        What the log lacks.

    Raises
    ------
    StillError
        The verb has no verdict, or the log is one of several, of which the others may do.
    """
    study = run.project.study
    if run.verb not in ("diagnose", "improve") or len(study.runs) + len(study.held_out) > 1:
        raise error
    for name, record in records.still(run.project.library, study.rig).items():
        if name in WRITES[run.verb]:
            run.write(name, record)
    if run.verb == "improve":
        from ..study.write import write_study
        write_study(study, run.folder.file("study.toml"))
    run.lines += [f"{error}.", "These data move too little to tell whether an effect is missing."]


VERB = {"check": _check, "compare": _compare, "identify": _identify, "diagnose": _diagnose, "add": _add,
        "improve": _improve,
        "report": _improve, "confirm": _confirm, "plan": _plan, "export": _export}


def improve_many(arguments, progress):
    """Improve several studies, each in a folder of its own.

    Parameters
    ----------
    arguments : argparse.Namespace
        As `parser.parse` gives them.
    progress : callable
        Told the stages of long work.

    Returns
    -------
    str
        Text for stdout.
    """
    from .batch import COLUMNS, TABLE, improve_all
    start, out = time.monotonic(), Path(arguments.out or "studies_improve")
    rows = improve_all(arguments.studies, out, arguments.on or "serial", arguments.workers, arguments.robust, progress,
                       arguments.bare)
    if arguments.json:
        return records.to_json({"schema": 1, "studies": rows})
    told = [[str(row[c]) for c in COLUMNS[:3]] + [row["failure"] or row["held_out_error"] or row["error"]]
            for row in rows]
    lines = sentences.aligned([["study", "verdict", "added", "held-out error, or why it failed"], *told])
    return "\n".join([*lines, f"Took {time.monotonic() - start:.1f} s.", f"The table is {out / TABLE}.", ""])


def demo(arguments, progress):
    """Make a log with a hidden effect, and find the effect.

    Parameters
    ----------
    arguments : argparse.Namespace
        As `parser.parse` gives them.
    progress : callable
        Told the stages of long work.

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
        As `parser.parse` gives them.
    progress : callable
        Told the stages of long work.

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
        As `parser.parse` gives them.
    progress : callable
        Told the stages of long work.

    Returns
    -------
    str
        Text for stdout.

    Raises
    ------
    Stopped
        At Ctrl-C, after the log up to there and a checkpoint are written.
    """
    from ..cosim.scenario import load_scenario
    from ..project import cosimulate
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
        found = cosimulate(scenario, arguments.until, resume, arguments.allow_python, progress, save=save,
                           every=arguments.every)
        found.to_csv(folder.file("run.csv"))
        folder.write("cosim.json", found.to_dict())
        if found.checkpoint:
            folder.file("checkpoint.zip").write_bytes(found.checkpoint)
        progress("drawing")
        cosim_figures.write_log(folder.temporary, found.done)
    if save:
        beside.unlink(missing_ok=True)  # what is in the folder now goes further
    allowed = f" --allow-python {' '.join(arguments.allow_python)}" if arguments.allow_python else ""
    again = f"pycosim cosim {arguments.scenario} --resume {out / 'checkpoint.zip'}{allowed}"
    reached = found.done.time
    if not found.complete and (arguments.until is None or reached < arguments.until):
        raise Stopped(f"interrupted at t = {reached:g} s; the log up to there is in {out}, to go on: {again}")
    if arguments.json:
        return records.to_json(found.record)
    lines = found.sentences
    if not found.complete:
        lines.append(f"To go on: {again}")
    took = time.monotonic() - start
    return "\n".join([*lines, f"Took {took:.1f} s.", f"Results in {out}: {', '.join(folder.files)}", ""])


def calibrate(arguments, progress):
    """Fit the parameters of anyone's FMU.

    Parameters
    ----------
    arguments : argparse.Namespace
        As `parser.parse` gives them.
    progress : callable
        Told the stages of long work.

    Returns
    -------
    str
        Text for stdout.
    """
    from ..project import calibrate as calibrated
    from ..study.parse import load_study
    start, study = time.monotonic(), load_study(arguments.study)
    out, fmu = Path(arguments.out or f"{study.name}_identify"), Path(arguments.fmu)
    made = ("parameters.json", "comparison.json", "calibrated.ssv", "calibrated.ssm", "calibrated.ssp",
            f"{fmu.stem}_calibrated.fmu")
    with Folder(out, "identify", study.path, made) as folder:
        found = calibrated(fmu, study, arguments.data or None, progress)
        folder.write("parameters.json", found.to_dict())
        folder.write("comparison.json", found.comparison)
        found.write(folder.temporary)
    if arguments.json:
        return records.to_json(found.record)
    return "\n".join([*found.sentences, f"Took {time.monotonic() - start:.1f} s.",
                      f"Results in {out}: {', '.join(folder.files)}", ""])


def _replace(path, data):
    """Write a checkpoint."""
    try:
        write_whole(path, data)
    except OSError as error:
        raise UsageError(f"{path}: the checkpoint cannot be written ({error.strerror})") from None


def _checkpoint(path):
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise UnknownNameError(f"no checkpoint {path} ({error.strerror})") from None

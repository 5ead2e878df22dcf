"""Command line in; one verb run, its results in a folder and in sentences, an exit code, out.

Exit codes: 0 done; 2 bad input, one line on stderr; 1 a failure of pycosim's own; 130 interrupted.
Nothing heavy is imported before the arguments are read, so that help and refusals are quick.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
import traceback
import warnings
from functools import partial
from pathlib import Path

from .. import __version__
from ..core.errors import PycosimError, StudyError, UnknownNameError, closest

# verb: (what it does, main file, example, more)
VERBS = {
    "demo": ("the whole story on data with a hidden effect, offline", "ladder.json", "pycosim demo",
             "Makes a log of a machine with an effect that its model lacks, and finds it."),
    "new": ("a commented study to start from", None, "pycosim new HipKnee --data run1.csv",
            "Writes <rig>.toml: the rig's parameters, the columns a log needs, and the effects that can be added."),
    "compare": ("model against measurements: errors, and where they are", "comparison.json",
                "pycosim compare study.toml",
                "Free parameters are fitted first; the error with the study's own values is told as well."),
    "identify": ("parameters, intervals, what the data cannot tell", "parameters.json",
                 "pycosim identify study.toml --data run1.csv run2.csv", ""),
    "diagnose": ("which effect is missing, where, how sure; or nothing; or nothing known", "diagnosis.json",
                 "pycosim diagnose study.toml --out monday", ""),
    "add": ("refit with one more effect", "parameters.json", "pycosim add study.toml stribeck@2A",
            "Without a place, every place is tried and the best by cross-validation is taken."),
    "improve": ("diagnose, add, refit, until nothing is left to learn", "ladder.json",
                "pycosim improve study.toml --data run1.csv", ""),
    "plan": ("the next experiment: what to move so that the data answers", "plan.json",
             "pycosim plan study.toml --data run1.csv --budget 120",
             "Writes plan.csv, a motion of the motors within the study's [limits]; 'pycosim cosim' can follow it."),
    "report": ("the search as one HTML page, to zoom and to pass on", "ladder.json",
               "pycosim report study.toml --data run1.csv",
               "Searches as improve does. The page opens offline; its numbers are in data/, its figures for print in "
               "figures/."),
    "app": ("the same loop in a browser: compare, diagnose, add, undo, export", None, "pycosim app study.toml",
            "Serves a page on this machine alone, until Ctrl-C. Without a study, drop a log in and map its columns."),
    "export": ("the identified machine as an FMU, C, Modelica, SSP, MJCF or JSON, for other tools", "export.json",
               "pycosim export study.toml --to fmu --fmi 3 --platforms all",
               "The study's values and effects are taken as they are; no log is read."),
    "cosim": ("plant, controllers and estimator stepped together, each at its own rate", "cosim.json",
              "pycosim cosim examples/cosim/six_manoeuvres.toml",
              "Writes run.csv, a log as the other verbs read it. Ctrl-C leaves the log up to there, and a checkpoint."),
}
WRITES = {
    "compare": ("comparison.json",), "identify": ("parameters.json",), "diagnose": ("diagnosis.json",),
    "add": ("study.toml", "parameters.json", "comparison.json"),
    "improve": ("diagnosis.json", "diagnosis_final.json", "ladder.json", "parameters.json", "comparison.json",
                "study.toml", "model.mo", "report.html"),
    "report": ("diagnosis.json", "diagnosis_final.json", "ladder.json", "parameters.json", "comparison.json",
               "study.toml", "model.mo", "report.html"),
    "plan": ("plan.json", "plan.csv"),
    "export": ("export.json",), "cosim": ("cosim.json", "run.csv", "checkpoint.zip"),
}
# option of export: what it may be, what it is when not given, what it means
EXPORT = {
    "--to": (("fmu", "c", "modelica", "ssp", "mujoco", "json"), "fmu", "what to write"),
    "--fmi": (("2", "3"), "2", "version of the FMU"),
    "--type": (("cs,me", "cs", "me"), "cs,me", "co-simulation, model exchange, or both in one file"),
    "--platforms": (("host", "all"), "host", "binaries for this machine, or for linux, windows and macOS"),
    "--real": (("double", "float"), "double", "numbers of the C export"),
}


PLAN = ("--goal", "--budget", "--rate", "--criterion", "--between")


class UsageError(PycosimError):
    """The command line itself is wrong."""


class Stopped(KeyboardInterrupt):
    """A verb that was interrupted, but left what it had."""


# --- arguments ------------------------------------------------------------------------------------------------------


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one sentence, as an error of ours."""

    def error(self, message):
        if message.startswith("the following arguments are required: "):
            missing = message.partition(": ")[2]
            message = f"{missing} is missing; it comes before --data, which takes every name that follows"
        raise UsageError(f"{message}; see '{self.prog} --help'")


def build_parser():
    """The parser of the whole command line.

    Returns
    -------
    argparse.ArgumentParser
    """
    parser = _Parser(prog="pycosim", allow_abbrev=False, formatter_class=argparse.RawDescriptionHelpFormatter,
                     description="Compare the model of a geared or cable-driven actuator with its logs, and learn "
                                 "which physical effect is missing.",
                     epilog="example:\n  pycosim new HipKnee\n  pycosim improve HipKnee.toml --data my_log.csv\n\n"
                            "'pycosim VERB --help' has the options and an example of each. To complete verbs, options\n"
                            "and files with the tabulator key, in bash or zsh:\n"
                            "  eval \"$(register-python-argcomplete pycosim)\"")
    parser.add_argument("--version", action="version", version=f"pycosim {__version__}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", title="verbs")
    for verb, (what, _, example, more) in VERBS.items():
        sub = verbs.add_parser(verb, help=what, allow_abbrev=False,
                               description=f"{what[0].upper()}{what[1:]}. {more}".strip(),
                               formatter_class=argparse.RawDescriptionHelpFormatter, epilog=f"example:\n  {example}")
        if verb == "new":
            sub.add_argument("rig", metavar="RIG",
                             help="Modelica class, as HipKnee, or a file of your own, as winch.mo").completer = _rigs
        elif verb == "cosim":
            sub.add_argument("scenario", metavar="SCENARIO", help="scenario file (TOML)")
            sub.add_argument("--until", type=float, metavar="T", help="stop at this time [s], with a checkpoint")
            sub.add_argument("--resume", metavar="FILE", help="go on from this checkpoint")
            sub.add_argument("--checkpoint-every", type=float, metavar="S", dest="every",
                             help="leave a checkpoint beside DIR every S seconds, until the run has ended")
        elif verb != "demo":
            sub.add_argument("study", metavar="STUDY", help="study file (TOML)", nargs="?" if verb == "app" else None)
        if verb == "app":
            sub.add_argument("--port", type=int, default=8080, metavar="N", help="port of the page (default: 8080)")
            sub.add_argument("--no-browser", action="store_true", help="do not open a browser")
        if verb == "add":
            sub.add_argument("effect", metavar="EFFECT[@PLACE]", help="effect, and where, as viscous@1A")
        for option, (choices, usual, meaning) in (EXPORT if verb == "export" else {}).items():
            sub.add_argument(option, choices=choices, default=usual, help=f"{meaning} (default: {usual})")
        if verb == "plan":
            _plan_options(sub)
        reads = verb not in ("demo", "export", "cosim")
        sub.add_argument("--data", nargs="+", metavar="FILE",
                         help="logs, instead of the study's own" if reads else argparse.SUPPRESS)
        default = "demo" if verb == "demo" else f"<{'scenario' if verb == 'cosim' else 'study'}>_{verb}"
        folder = ("folder of the study (default: the current one)" if verb == "new"
                  else f"folder of the results (default: ./{default})")
        sub.add_argument("--out", metavar="DIR", help=folder)
        sub.add_argument("--json", action="store_true",
                         help=f"print {VERBS[verb][1] or 'where the study is'} and nothing else")
        sub.add_argument("--quiet", action="store_true", help="print nothing but errors")
    return parser


def _plan_options(sub):
    sub.add_argument("--goal", choices=("parameters", "twins", "detect"), default="parameters",
                     help="narrow intervals, separate what the diagnosis could not, or show what no data could "
                          "(default: parameters)")
    sub.add_argument("--budget", type=float, default=120.0, metavar="SECONDS", help="longest duration (default: 120)")
    sub.add_argument("--rate", type=float, default=100.0, metavar="HZ", help="samples a second (default: 100)")
    sub.add_argument("--criterion", choices=("intervals", "D", "E"), default="intervals",
                     help="of the parameters: their mean interval, the volume, or the worst direction "
                          "(default: intervals)")
    sub.add_argument("--between", nargs=2, metavar="EFFECT@PLACE", help="separate these two, whatever the diagnosis")


def _rigs(**_):
    """Short names of the rigs, for a shell that completes them."""
    from ..compile import Library
    from ..study.template import rigs
    return list(rigs(Library()))


def complete():
    """Answer a shell that asks how to complete a line (argcomplete says so in the environment), and leave."""
    if "_ARGCOMPLETE" in os.environ:
        import argcomplete
        argcomplete.autocomplete(build_parser())


def parse(argv):
    """Arguments of a command line.

    Parameters
    ----------
    argv : list of str

    Returns
    -------
    argparse.Namespace

    Raises
    ------
    UsageError
        With the closest verb or option that there is.
    """
    parser = build_parser()
    first = next((a for a in argv if not a.startswith("-")), None)
    if first is not None and first not in VERBS:
        raise UsageError(f"no verb '{first}'{closest(first, VERBS)}")
    arguments, unknown = parser.parse_known_args(argv)
    if unknown:
        what = "option" if unknown[0].startswith("-") else "argument"
        known = ["--data", "--out", "--json", "--quiet", "--help", "--version"] if what == "option" else []
        known += EXPORT if known and arguments.verb == "export" else []
        known += PLAN if known and arguments.verb == "plan" else []
        known += ["--until", "--resume", "--checkpoint-every"] if known and arguments.verb == "cosim" else []
        known += ["--port", "--no-browser"] if known and arguments.verb == "app" else []
        raise UsageError(f"unknown {what} '{unknown[0]}'{closest(unknown[0], known)}; "
                         f"see 'pycosim {arguments.verb or ''} --help'".replace("  ", " "))
    if arguments.verb is None and argv:
        raise UsageError(f"no verb; one of {', '.join(VERBS)}")
    return arguments


# --- progress and output --------------------------------------------------------------------------------------------


class Progress:
    """Sentences about what is going on, on a terminal only."""

    def __init__(self, quiet):
        self.status = None
        if not quiet and sys.stderr.isatty():
            from rich.console import Console
            self.status = Console(stderr=True).status("reading")
        self.start = time.monotonic()

    def __enter__(self):
        if self.status:
            self.status.start()
        return self

    def __exit__(self, *_):
        self.stop()

    def stop(self):
        """Say no more."""
        if self.status:
            self.status.stop()

    def __call__(self, text):
        if self.status:
            self.status.update(f"{text} ({time.monotonic() - self.start:.0f} s)")


class Run:
    """One verb on one study: what is shared by all verbs that have one.

    Parameters
    ----------
    arguments : argparse.Namespace
    progress : callable
    """

    def __init__(self, arguments, progress):
        from ..report import results
        from ..compile import Library
        from ..study.schema import load_study

        self.progress, self.results, self.verb = progress, results, arguments.verb
        self.study, self.given = load_study(arguments.study), arguments.data
        if arguments.data:
            self.study = self.study.with_data(arguments.data)
        self.library = Library(self.study.modelica)
        self.model = self.study.validate(self.library)
        self.out = Path(arguments.out or f"{self.study.name}_{self.verb}")
        self.folder = results.Folder(self.out, self.verb, self.study.path, WRITES[self.verb])
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
        self.lines += self.results.summary_data(self.dataset)
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
        self.lines += self.results.summary_doubt(self.dataset, fit)
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
        return self.results.plain(result)

    def write(self, name, result):
        """Write one result; the verb's main file is kept for ``--json``.

        Parameters
        ----------
        name : str
        result : dict or str
        """
        text = result if isinstance(result, str) else self.results.to_json(result)
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
        from ..study.schema import write_study
        parameters = self.results.parameters(fit, model, self.study.seed)
        self.write("parameters.json", parameters)
        self.write("comparison.json", self.compare(model, fit))
        write_study(self.results.improved_study(self.study, model, fit), self.folder.file("study.toml"))
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
    run.lines += run.results.summary_comparison(result)


def _identify(run, arguments):
    if not run.dataset.free(run.model):
        raise StudyError(f"{run.study.path}: no parameter is free; write fixed = false at those to identify")
    result = run.results.parameters(run.fit(), run.model, run.study.seed)
    run.write("parameters.json", result)
    run.lines += run.results.summary_parameters(result)


def _diagnose(run, arguments):
    from ..diagnosis import compare
    from ..compile import compile_model
    from ..diagnosis.diagnose import diagnose
    found = diagnose(run.dataset, run.model, run.fit(), run.study.seed, run.progress)
    if found.winner is not None and run.dataset.is_test.any():
        larger = compile_model(run.library, run.study.rig, [*run.study.effects, found.winner.key])
        found.winner.held_out_error = compare.errors(run.dataset, larger, found.winner.fit, "test")
    result = run.results.diagnosis(found, run.library)
    run.write("diagnosis.json", result)
    run.write_guess(result)
    run.lines += run.results.summary_diagnosis(result, run.library)


def _add(run, arguments):
    from ..diagnosis import compare
    chosen, told = best_place(run, *run.effect)
    model, fit = chosen
    run.lines += told
    before, after = (compare.errors(run.dataset, m, f, "fit") for m, f in ((run.model, run.base), (model, fit)))
    run.lines.append(f"Error on the fitted passes: {run.results._change(before, after)}.")
    run.lines += run.results.summary_parameters(run.write_model(model, fit))
    run.draw("write_comparison", model, fit)


def _improve(run, arguments):
    from ..diagnosis.search import improve
    found = improve(run.dataset, run.model, run.study.seed, run.progress)
    run.lines += run.results.summary_doubt(run.dataset, found.steps[0].fit)
    first, last = (run.results.diagnosis(d, run.library) for d in (found.first, found.last))
    steps = run.results.ladder(found.steps, run.dataset)
    run.write("diagnosis.json", first)
    run.write("diagnosis_final.json", last)
    run.write("ladder.json", steps)
    run.write_guess(last)
    parameters = run.write_model(found.model, found.fit)
    run.write("model.mo", found.model.text.rstrip("\n") + "\n")
    run.draw("write_figures", found)
    run.page(found)
    run.lines += run.results.summary_improvement(first, last, steps, parameters, run.library)
    run.lines += run.results.summary_parameters(parameters)


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
    return shlex.join(["pycosim", "report", study.path.name, *(["--data", *data] if data else [])])


def _plan(run, arguments):
    from ..design import optimiser
    from ..report import plan_figures, plan_results
    fit = None
    if run.dataset is not None:
        fit = run.fit()
    known = optimiser.known(run.study, run.library, run.model, run.dataset, fit)
    blocks = None
    if arguments.between:
        keys = [tuple(text.partition("@")[::2]) for text in arguments.between]
        blocks = optimiser.twins_of(known, [keys], run.progress)
    goal = "twins" if arguments.between else arguments.goal
    found = optimiser.make_plan(known, goal, arguments.budget, arguments.rate, blocks, arguments.criterion, run.progress)
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
    from ..fit import least_squares
    from ..compile import compile_model
    from ..diagnosis.diagnose import _nudged, diagnose, select
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
            fit = least_squares.fit(run.dataset, model, _nudged(start, model, finding))
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


# --- new and demo ---------------------------------------------------------------------------------------------------


def _new(arguments):
    """Write a commented study for a rig; returns its path."""
    from ..compile import Library
    from ..report.results import FolderError
    from ..study.schema import load_study
    own = [arguments.rig] if arguments.rig.endswith(".mo") else []
    library = Library(own)
    rig = own_rig(library, arguments.rig) if own else find_rig(library, arguments.rig)
    folder = Path(arguments.out or ".")
    path = folder / f"{rig.rsplit('.', 1)[-1]}.toml"
    if os.path.lexists(path):
        raise FolderError(f"{path}: exists already, and is not overwritten; move it, or name a folder with --out DIR")
    for file in arguments.data or []:
        if not Path(file).is_file():
            raise UnknownNameError(f"no log {file}")
    runs, own = ([os.path.relpath(f, folder) for f in files] for files in (arguments.data or [], own))
    text = "\n".join(template(library, rig, runs, own)) + "\n"
    made = []
    temporary = folder / f".{path.name}.{os.getpid()}"
    try:
        for parent in [*reversed(folder.absolute().parents), folder.absolute()]:
            if not parent.is_dir():
                parent.mkdir()
                made.insert(0, parent)
        temporary.write_text(text, encoding="utf-8")
        load_study(temporary).validate(library)
        os.replace(temporary, path)
    except BaseException as error:
        temporary.unlink(missing_ok=True) if folder.is_dir() else None
        for parent in made:
            parent.rmdir()
        if isinstance(error, OSError):
            raise FolderError(f"{path}: cannot be written ({error.strerror}); name a folder with --out DIR") from None
        raise
    return path


def find_rig(library, name):
    """Full name of a rig, from its full or its short name.

    Parameters
    ----------
    library : Library
    name : str

    Returns
    -------
    str

    Raises
    ------
    UnknownNameError
    """
    from ..study.template import rigs
    known = rigs(library)
    if name in known or name in known.values():
        return known.get(name, name)
    raise UnknownNameError(f"no rig '{name}'{closest(name.rsplit('.', 1)[-1], known)}")


def own_rig(library, file):
    """The class of a user's file that answers what a fit asks.

    Parameters
    ----------
    library : Library
        With the file.
    file : str

    Returns
    -------
    str

    Raises
    ------
    UnknownNameError
        None, or several.
    """
    from ..compile.effects import annotation
    found = [n for n in library.walk() if not n.startswith("DriveTrain.") and "estimate" in annotation(library, n)]
    if len(found) == 1:
        return found[0]
    what = f"the rigs {', '.join(found)}; keep one in a file" if found else (
        'no rig: no class with annotation(__pycosim(estimate="what is measured from what is known"))')
    raise UnknownNameError(f"{file} holds {what}")


def template(library, rig, runs, modelica=()):
    """Lines of a commented study for a rig.

    Parameters
    ----------
    library : Library
    rig : str
        Full name.
    runs : list of str
        Logs, relative to the study.
    modelica : sequence of str
        Modelica files of the user, relative to the study.

    Yields
    ------
    str
    """
    from ..compile import catalogue, compile_model, places
    from ..study.template import first_parameters
    from ..study.schema import MOST, _toml
    model = compile_model(library, rig)
    wanted, known = model.alternatives("estimate")[0]
    question = model.question("estimate")
    yield f"# {library.find(rig).comment.strip(chr(34))}" if library.find(rig).comment else f"# {rig}"
    yield f"# Next: pycosim improve {rig.rsplit('.', 1)[-1]}.toml{'' if runs else ' --data my_log.csv'}"
    yield f"\n[rig]\nmodel = {_toml(rig)}"
    if modelica:
        yield f"modelica = {_toml(list(modelica))}"
    yield "\n[parameters]                 # SI units; fixed = false is fitted, the others are the rig's defaults"
    open_ones = first_parameters(model, question)
    for name in [*open_ones, *sorted(set(question.parameters) - set(open_ones))]:
        p = model.parameters[name]
        fixed = name not in open_ones
        bounds = "".join(f", {k} = {_toml(v)}" for k, v in (("min", p.min), ("max", p.max)) if abs(v) != float("inf"))
        line = f"{_toml(name)} = {{ value = {_toml(p.value)}{bounds}, fixed = {_toml(fixed)} }}"
        yield f"{'# ' if fixed else ''}{line}  # {p.unit}; {p.description or name}"
    yield "\n[data]"
    yield f"runs = {_toml(runs)}                    # logs; or --data FILE..."
    yield "held_out = []                # logs kept for the test"
    yield 'reference = "unknown"        # of the joint torques: "sensor", "gravity_model" (computed), "unknown"'
    yield '# drop_outs = "skip"         # leave rows with missing numbers out, rather than refuse the log'
    yield f"# most = {MOST:_}            # a log with more rows is read as means of consecutive ones"
    yield "\n[columns]                    # left: the column in your log, right: what it is, and its unit there"
    speeds = [f"{n[:-4]}.w" for n in known if n.endswith(".phi") and f"{n[:-4]}.w" in model.variables]
    for name, role in [*((n, "needed") for n in known), *((n, "optional; else derived from the angle") for n in speeds),
                       *((n, "what the model is compared with") for n in wanted)]:
        v = model.variables[name]
        yield (f"{_toml(name)} = {{ variable = {_toml(name)}, unit = {_toml(v.unit)} }}"
               f"  # {v.description or name}; {role}")
    for line in _other_columns(known):
        yield f"# {line}"
    yield "\n# Effects, to be added by hand or found by 'pycosim improve':"
    yield '# [[effects]]\n# effect = "viscous"\n# place = ".."'
    for effect in catalogue(library).values():
        found = [p.name for p in places(library, rig, effect)]
        if found:
            yield f"#   {effect.id}: {effect.description}; at {', '.join(found)}"


def _other_columns(known):
    """Lines for what a log may hold otherwise."""
    torque = next((n for n in known if n.endswith(".tau")), None)
    if torque:
        yield (f'"current" = {{ variable = {json.dumps(torque)}, unit = "A", k_m = 0.1 }}'
               "  # instead of a torque; k_m [N.m/A]")
    yield '"time" = { variable = "time", unit = "ms" }  # when the time is not in s'
    yield '"temperature" = { variable = "temperature", unit = "degC" }  # optional'


def _demo(arguments, progress):
    if arguments.data:
        raise UsageError("demo makes its own log; for yours: pycosim improve STUDY --data FILE")
    from . import demo
    out = Path(arguments.out or "demo")
    demo.run(out, arguments.quiet or arguments.json, progress)
    return out


def _app(arguments, progress):
    """Serve the app until Ctrl-C."""
    try:
        from ..app.page import serve
    except ModuleNotFoundError as error:
        if error.name != "nicegui":
            raise
        raise UsageError("the app needs nicegui; pip install 'pycosim-drivetrain[app]'") from None
    name = Path(arguments.study).stem if arguments.study else "study"
    out = arguments.out or f"{name}_app"
    say = (lambda text: None) if arguments.quiet else partial(print, flush=True)
    serve(arguments.study, arguments.data, out, arguments.port, not arguments.no_browser, progress, say)


# --- co-simulation --------------------------------------------------------------------------------------------------


def _cosim(arguments, progress):
    """Run a scenario; returns the folder's text for stdout.

    Raises
    ------
    Stopped
        At Ctrl-C, after the log up to there and a checkpoint are written.
    """
    from ..report import cosim_figures, results
    from ..cosim.master import cosimulate
    from ..cosim.scenario import load_scenario
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
    with results.Folder(out, "cosim", scenario.path, WRITES["cosim"]) as folder:
        done = cosimulate(scenario, arguments.until, resume, progress, save=save, every=arguments.every)
        folder.write("run.csv", done.text)
        folder.write("cosim.json", done.description)
        if done.checkpoint:
            folder.file("checkpoint.zip").write_bytes(done.checkpoint)
        progress("drawing")
        cosim_figures.write_log(folder.temporary, done)
    if save:
        beside.unlink(missing_ok=True)  # what is in the folder now goes further
    again = f"pycosim cosim {arguments.scenario} --resume {out / 'checkpoint.zip'}"
    if not done.complete and (arguments.until is None or done.time < arguments.until):
        raise Stopped(f"interrupted at t = {done.time:g} s; the log up to there is in {out}, to go on: {again}")
    if arguments.json:
        return results.to_json(done.description)
    lines = results.summary_cosimulation(done.description)
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


# --- main -----------------------------------------------------------------------------------------------------------


def run_verb(arguments, progress):
    """Run a verb.

    Parameters
    ----------
    arguments : argparse.Namespace
    progress : callable

    Returns
    -------
    str
        Text for stdout.
    """
    start = time.monotonic()
    if arguments.verb == "new":
        path = _new(arguments)
        if arguments.json:
            from ..report.results import to_json
            return to_json({"schema": 1, "study": str(path)})
        data = "" if arguments.data else " --data my_log.csv"
        return f"Written: {path}. Say which columns your log has, then: pycosim improve {path}{data}\n"
    if arguments.verb == "demo":
        out = _demo(arguments, progress)
        return (out / VERBS["demo"][1]).read_text(encoding="utf-8") if arguments.json else ""
    if arguments.verb == "cosim":
        return _cosim(arguments, progress)
    if arguments.verb == "app":
        _app(arguments, progress)
        return ""
    run = Run(arguments, progress)
    if arguments.verb == "add":
        run.effect = checked_effect(run, arguments.effect)
    if arguments.verb == "export" and arguments.data:
        raise UsageError("export reads no log, its values are the study's; 'pycosim identify STUDY --data FILE' finds "
                         "them")
    with run.folder:
        run.dataset = None
        if arguments.verb == "plan" and not (run.study.runs or run.study.held_out):
            run.lines.append("No log was given: what is known is what the study's [parameters] say.")
        elif arguments.verb != "export":
            run.read()
        VERB[arguments.verb](run, arguments)
    if arguments.json:
        return run.main
    return "\n".join([*run.lines, f"Took {time.monotonic() - start:.1f} s.",
                      f"Results in {run.out}: {run.folder.listed}", ""])


def main(argv=None):
    """Run pycosim.

    Parameters
    ----------
    argv : list of str, optional
        The command line's arguments by default.

    Returns
    -------
    int
        Exit code.
    """
    try:
        complete()
        arguments = parse(sys.argv[1:] if argv is None else list(argv))
        if arguments.verb is None:
            build_parser().print_help()
            return 0
        with warnings.catch_warnings():
            if not os.environ.get("PYCOSIM_DEBUG"):
                warnings.simplefilter("ignore")  # a warning of a solver means nothing to who reads this
            with Progress(arguments.quiet) as progress:
                text = run_verb(arguments, progress)
        if not arguments.quiet or arguments.json:
            sys.stdout.write(text)
            sys.stdout.flush()
        return 0
    except SystemExit as stop:  # --help and --version
        return int(stop.code or 0)
    except PycosimError as error:
        return _say(str(error), 2)
    except KeyboardInterrupt as stop:
        return _say(str(stop) or "interrupted; earlier results are as they were", 130)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        return _own_failure(error)


def _say(text, code):
    print(f"pycosim: {' '.join(text.split())}", file=sys.stderr)
    return code


def _own_failure(error):
    """A fault of ours: one line, and the traceback where a report can take it from."""
    what = f"failed: {type(error).__name__}: {error}"
    if os.environ.get("PYCOSIM_DEBUG"):
        traceback.print_exc()
        return _say(what, 1)
    try:
        handle, name = tempfile.mkstemp(prefix="pycosim-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(f"pycosim {__version__}, Python {sys.version}\n{' '.join(sys.argv)}\n\n")
            file.write("".join(traceback.format_exception(error)))
    except OSError:
        return _say(f"{what}; set PYCOSIM_DEBUG=1 to see where", 1)
    return _say(f"{what}; this is a fault of pycosim, please report it with {name}", 1)



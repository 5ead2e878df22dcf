"""Words of a command line in; the verb and its settings, or one sentence that says what is wrong, out."""

from __future__ import annotations

import argparse
import os

from .. import __version__
from ..core.errors import PycosimError, closest
from ..design.goals import GOALS, goal_named

# verb: (what it does, main file, example, more)
VERBS = {
    "demo": ("the whole story on data with a hidden effect, offline", "ladder.json", "pycosim demo",
             "Makes a log of a machine with an effect that its model lacks, and finds it."),
    "new": ("a commented study to start from", None, "pycosim new HipKnee --data run1.csv",
            "Writes <rig>.toml: the rig's parameters, the columns a log needs, and the effects that can be added. A "
            "log is looked at, and what it does not tell is asked; where nobody can answer, --map, --rate, --si and "
            "--without do."),
    "check": ("what the log is, before any physics: wiring, units, clocks, outliers", "check.json",
              "pycosim check study.toml --data run1.csv",
              "Signs, swaps, units and times of every column are tried. What stops the search is said with the line of "
              "the study that mends it; [data] accept = [\"sign\"] goes on all the same."),
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
                "pycosim improve study.toml --data run1.csv",
                "Several studies are improved side by side: pycosim improve studies/*.toml --on processes. One that "
                "fails is a row of the table; what was done is not done again."),
    "confirm": ("whether a study's effects, frozen, hold on a log that was never searched", "confirmation.json",
                "pycosim confirm study_improve/study.toml --data new.csv",
                "Nothing is fitted to that log. It is replayed through the exported FMU too, without the effects and "
                "with them."),
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
    "check": ("check.json",),
    "compare": ("comparison.json",), "identify": ("parameters.json",), "diagnose": ("diagnosis.json",),
    "add": ("study.toml", "parameters.json", "comparison.json"),
    "improve": ("diagnosis.json", "diagnosis_final.json", "ladder.json", "parameters.json", "comparison.json",
                "consequence.json", "study.toml", "model.mo", "report.html"),
    "report": ("diagnosis.json", "diagnosis_final.json", "ladder.json", "parameters.json", "comparison.json",
               "consequence.json", "study.toml", "model.mo", "report.html"),
    "plan": ("plan.json", "plan.csv"), "confirm": ("confirmation.json",),
    "export": ("export.json",), "cosim": ("cosim.json", "run.csv", "checkpoint.zip"),
}
# option of export: what it may be, what it is when not given, what it means
EXPORT = {
    "--to": (("fmu", "c", "cpp", "modelica", "ssp", "mujoco", "mujoco-plugin", "jax", "json"), "fmu", "what to write"),
    "--fmi": (("2", "3"), "2", "version of the FMU"),
    "--type": (("cs,me", "cs", "me"), "cs,me", "co-simulation, model exchange, or both in one file"),
    "--platforms": (("host", "all"), "host", "binaries for this machine, or for linux, windows and macOS"),
    "--real": (("double", "float"), "double", "numbers of the C export"),
}
ROBUST = ("identify", "diagnose", "add", "improve", "report")
"""Verbs whose fits can be told to count samples that are far out for less."""
ELSEWHERE = ("diagnose", "add", "improve", "report")
"""Verbs with fits that do not need each other."""
MANY = {"improve": "; with several, DIR holds a folder for each, and studies.csv"}
NEW = ("--map", "--rate", "--si", "--without", "--rated")
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
        if verb not in ("new", "cosim", "demo"):
            sub.add_argument("study", metavar="STUDY", help=f"study file (TOML){MANY.get(verb, '')}",
                             nargs={"app": "?", "improve": "+"}.get(verb))
        OPTIONS.get(verb, lambda sub: None)(sub)
        _common_options(sub, verb)
    return parser


def _common_options(sub, verb):
    """What every verb takes."""
    if verb in ROBUST:
        sub.add_argument("--robust", action="store_true",
                         help="count samples that are far out for less, as [fit] robust = true does")
    if verb in ELSEWHERE:
        what = "fits that do not need each other" + (", or several studies," if verb == "improve" else "")
        usual = ("in this process, of one study improved on a second core too" if verb in ("improve", "report")
                 else "in this process")
        sub.add_argument("--on", metavar="WHERE", help=f"where {what} are computed: serial, threads, processes, or "
                                                       f"dask://HOST:PORT (default: {usual})")
        sub.add_argument("--workers", type=int, metavar="N", help="threads or processes (default: one a core)")
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


def _cosim_options(sub):
    sub.add_argument("scenario", metavar="SCENARIO", help="scenario file (TOML)")
    sub.add_argument("--until", type=float, metavar="T", help="stop at this time [s], with a checkpoint")
    sub.add_argument("--resume", metavar="FILE", help="go on from this checkpoint")
    sub.add_argument("--allow-python", nargs="+", default=[], metavar="FILE",
                     help="files of Python classes in the scenario whose code may run; none does otherwise")
    sub.add_argument("--checkpoint-every", type=float, metavar="S", dest="every",
                     help="leave a checkpoint beside DIR every S seconds, until the run has ended")


def _improve_options(sub):
    sub.add_argument("--bare", action="store_true", help="results alone, no figures and no page: some seconds less")


def _app_options(sub):
    sub.add_argument("--port", type=int, default=8080, metavar="N", help="port of the page (default: 8080)")
    sub.add_argument("--no-browser", action="store_true", help="do not open a browser")


def _identify_options(sub):
    sub.add_argument("--fmu", metavar="FILE", help="fit the parameters of this FMU instead of the rig's; the study's "
                     "columns and parameters are its variables")


def _add_options(sub):
    sub.add_argument("effect", metavar="EFFECT[@PLACE]", help="effect, and where, as viscous@1A")


def _export_options(sub):
    for option, (choices, usual, meaning) in EXPORT.items():
        sub.add_argument(option, choices=choices, default=usual, help=f"{meaning} (default: {usual})")
    sub.add_argument("--self-contained", action="store_true",
                     help="of modelica: the library's classes inside, so that the file needs nothing beside it")


def _new_options(sub):
    sub.add_argument("rig", metavar="RIG", nargs="?",
                     help="Modelica class, as HipKnee, or a file of your own, as winch.mo; without one, the columns of "
                          "the log tell").completer = _rigs
    sub.add_argument("--map", nargs="+", default=[], metavar="COLUMN=VARIABLE[:UNIT][,KEY=VALUE]", dest="columns",
                     help="what columns of the log are, as q1=motor1.phi:deg or i1=motor1.tau:A,k_m=0.11,sign=-1")
    sub.add_argument("--rate", type=float, metavar="HZ", help="rows a second, of a log without a column of time")
    sub.add_argument("--si", action="store_true", help="columns that state no unit are in rad, rad/s, N.m, s, ..")
    sub.add_argument("--without", nargs="+", default=[], metavar="VARIABLE",
                     help="variables of the rig that the log does not hold")
    sub.add_argument("--rated", nargs="+", default=[], metavar="VARIABLE=VALUE[:UNIT]",
                     help="what motors are rated for, as motor1.tau=15 or w=3000:rpm (of every motor)")


def _plan_options(sub):
    sub.add_argument("--goal", type=goal_named, choices=GOALS, default="parameters",
                     help="narrow intervals, separate what the diagnosis could not (alternatives; twins, as it was "
                          "called, is understood), or show what no data could (default: parameters)")
    sub.add_argument("--budget", type=float, default=120.0, metavar="SECONDS", help="longest duration (default: 120)")
    sub.add_argument("--rate", type=float, default=100.0, metavar="HZ", help="samples a second (default: 100)")
    sub.add_argument("--criterion", choices=("intervals", "D", "E"), default="intervals",
                     help="of the parameters: their mean interval, the volume, or the worst direction "
                          "(default: intervals)")
    sub.add_argument("--between", nargs=2, metavar="EFFECT@PLACE", help="separate these two, whatever the diagnosis")


OPTIONS = {"new": _new_options, "cosim": _cosim_options, "improve": _improve_options, "app": _app_options,
           "identify": _identify_options, "add": _add_options, "export": _export_options, "plan": _plan_options}
"""What a verb takes besides."""


def _rigs(**_):
    """Short names of the rigs, for a shell that completes them."""
    from ..compile import Library
    from ..study.template import rigs
    return list(rigs(Library()))


def _one_or_many(arguments):
    """Several studies of `improve` go to ``studies``; one stays in ``study``."""
    arguments.studies = arguments.study if len(arguments.study) > 1 else []
    arguments.study = arguments.study[0]
    if arguments.studies and arguments.data:
        raise UsageError("--data is for one study; with several, each names its own logs in [data] runs")


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
        Words after the program's name.

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
        known += [*EXPORT, "--self-contained"] if known and arguments.verb == "export" else []
        known += ["--robust"] if known and arguments.verb in ROBUST else []
        known += ["--fmu"] if known and arguments.verb == "identify" else []
        known += ["--on", "--workers"] if known and arguments.verb in ELSEWHERE else []
        known += ["--bare"] if known and arguments.verb == "improve" else []
        known += NEW if known and arguments.verb == "new" else []
        known += PLAN if known and arguments.verb == "plan" else []
        if known and arguments.verb == "cosim":
            known += ["--until", "--resume", "--checkpoint-every", "--allow-python"]
        known += ["--port", "--no-browser"] if known and arguments.verb == "app" else []
        raise UsageError(f"unknown {what} '{unknown[0]}'{closest(unknown[0], known)}; "
                         f"see 'pycosim {arguments.verb or ''} --help'".replace("  ", " "))
    if arguments.verb == "improve":
        _one_or_many(arguments)
    if arguments.verb in ELSEWHERE and arguments.workers is not None and arguments.workers < 1:
        raise UsageError(f"--workers {arguments.workers}: there must be one at least")
    if arguments.verb is None and argv:
        raise UsageError(f"no verb; one of {', '.join(VERBS)}")
    return arguments

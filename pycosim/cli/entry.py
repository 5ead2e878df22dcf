"""Command line in; one verb run, an exit code, and one sentence where that failed, out."""

from __future__ import annotations

import gc
import os
import sys
import tempfile
import time
import traceback
import warnings

from .. import __version__
from ..core.errors import PycosimError, StillError
from ..core.executors import computing
from .parser import VERBS, UsageError, build_parser, complete, parse
from .progress import Progress

# --- main -----------------------------------------------------------------------------------------------------------


def run_verb(arguments, progress):
    """Run a verb.

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
    # many small matrices: a second thread of their library waits more than it works, and rounds otherwise
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    from . import verbs  # only now: help and refusals are quick
    if not gc.get_freeze_count():
        gc.freeze()  # what was imported stays; to look through it again and again for garbage takes seconds
    start = time.monotonic()
    if arguments.verb == "new":
        from .new import new
        progress.stop()  # what is asked stands below it
        path, lines = new(arguments)
        if arguments.json:
            from ..report.records import to_json
            return to_json({"schema": 1, "study": str(path)})
        return "\n".join([*lines, ""])
    if arguments.verb == "demo":
        out = verbs.demo(arguments, progress)
        return (out / VERBS["demo"][1]).read_text(encoding="utf-8") if arguments.json else ""
    if arguments.verb == "cosim":
        return verbs.cosim(arguments, progress)
    if arguments.verb == "identify" and arguments.fmu:
        return verbs.calibrate(arguments, progress)
    if arguments.verb == "app":
        verbs.app(arguments, progress)
        return ""
    if getattr(arguments, "studies", None):
        return verbs.improve_many(arguments, progress)
    with computing(getattr(arguments, "on", None) or "serial", getattr(arguments, "workers", None)):
        return _on_one_study(verbs.Run(arguments, progress), arguments, start)


def _on_one_study(run, arguments, start):
    """Do what a verb does with a study; text for stdout."""
    from . import verbs
    if arguments.verb == "add":
        run.project.places(arguments.effect)  # refused before a log is read
    if arguments.verb in ("check", "compare", "identify", "plan", "export"):
        run.project.study.refuse_absent_own()  # the others may find the effect
    if arguments.verb == "confirm":
        run.project.confirmable()  # likewise
    if arguments.verb == "export" and arguments.data:
        raise UsageError("export reads no log, its values are the study's; 'pycosim identify STUDY --data FILE' finds "
                         "them")
    with run.folder:
        if arguments.verb == "plan" and not run.has_logs:
            run.lines.append("No log was given: what is known is what the study's [parameters] say.")
        try:
            if arguments.verb not in ("export", "check") and (arguments.verb != "plan" or run.has_logs):
                run.read()
            verbs.VERB[arguments.verb](run, arguments)
        except StillError as error:
            verbs.still(run, error)
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

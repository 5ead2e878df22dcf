"""Several studies in; each improved in a folder of its own, and a table with a row for each, out."""

from __future__ import annotations

import csv
import hashlib
import io
import os
import time
from pathlib import Path

from ..core.errors import PycosimError
from ..core.executors import each, lost
from ..core.whole import write_whole

TABLE = "studies.csv"
IMPORTS = ("pycosim.cli.verbs", "pycosim.project", "pycosim.report.figures", "pycosim.report.page",
           "matplotlib.backends.backend_agg", "matplotlib.backends.backend_pdf", "plotly.offline")
"""What every process would import by itself: 2 s of a core each, where a study takes 10."""
COLUMNS = ("study", "verdict", "added", "error", "held_out_error", "seconds", "failure", "given")


def improve_all(studies, out, where="serial", workers=None, robust=False, progress=None, bare=False):
    """Improve every study; what was done before, with the same study and logs, is not done again.

    Parameters
    ----------
    studies : list of path
        Study files; each with logs of its own.
    out : Path
        Folder of the table, and of one folder a study.
    where : str
        See `pycosim.core.executors.executor`.
    workers : int, optional
        Threads or processes; one a core by default.
    robust : bool
        As ``--robust`` of the verb.
    progress : callable, optional
        Called with a sentence as studies end.
    bare : bool
        Write neither figures nor the page.

    Returns
    -------
    list of dict
        A row a study, in their order. One that failed is a row too: ``failure`` says why.

    Raises
    ------
    ExecutorError
        There is nowhere of that name to compute.
    """
    say = progress or (lambda text: None)
    out.mkdir(parents=True, exist_ok=True)
    folders, rows = _folders(studies), _known(out / TABLE)
    work = {s: (*(str(Path(p).absolute()) for p in (s, out / folders[s])), robust, bare) for s in studies}
    given = {s: _given(s, robust, bare) for s in studies}
    rows = {s: rows[str(s)] for s in studies if _done(rows.get(str(s)), given[s], out / folders[s])}

    def keep(study, row):
        rows[study] = {**row, "study": str(study), "given": given[study]}
        _write(out / TABLE, [rows[s] for s in studies if s in rows])
        failed = sum(bool(r["failure"]) for r in rows.values())
        say(f"{len(rows)} of {len(studies)} studies done{f', {failed} failed' if failed else ''}")

    left = {s: (improve_one, *work[s]) for s in studies if s not in rows}
    for study, future in each(left, where, workers, IMPORTS):
        keep(study, _failed(study, 0.0, "its process was killed, perhaps for want of memory")
             if lost(future.exception()) else future.result())
    _write(out / TABLE, [rows[s] for s in studies])
    return [rows[s] for s in studies]


def improve_one(study, folder, robust=False, bare=False):
    """Improve one study as ``pycosim improve`` does.

    Parameters
    ----------
    study, folder : str
        Absolute paths, as another process has another current folder.
    robust, bare : bool
        As the options of the verb.

    Returns
    -------
    dict
        Its row.
    """
    from ..project import Search
    from .entry import run_verb
    from .parser import parse
    from .progress import Progress
    start = time.monotonic()
    try:
        options = [f"--{name}" for name, wanted in (("robust", robust), ("bare", bare)) if wanted]
        arguments = parse(["improve", study, "--out", folder, "--quiet", *options])
        run_verb(arguments, Progress(quiet=True))
    except PycosimError as error:
        return _failed(study, time.monotonic() - start, str(error))
    except Exception as error:  # a fault of ours is a row too: the other studies go on
        return _failed(study, time.monotonic() - start, f"{type(error).__name__}: {error}")
    if not (Path(folder) / "parameters.json").exists():  # nothing moves: nothing was fitted
        return {**_failed(study, time.monotonic() - start, ""), "verdict": "not_enough_excitation"}
    found = Search.load(folder)
    final = found.steps[-1]
    return {"study": study, "verdict": found.verdict, "added": " ".join(found.added),
            "error": _text(final.error, final.units), "held_out_error": _text(final.held_out_error, final.units),
            "seconds": round(time.monotonic() - start, 1), "failure": ""}


def _failed(study, seconds, why):
    return {**dict.fromkeys(COLUMNS, ""), "study": str(study), "seconds": round(seconds, 1), "failure": why}


def _text(error, units):
    return "; ".join(f"{c} = {v:.4g} {units[c]}" for c, v in error.items() if v is not None)


def _folders(studies):
    """Folder of each study: its name, with a number where several have one."""
    names, found = {}, {}
    for study in studies:
        name = Path(study).stem
        names[name] = names.get(name, 0) + 1
        found[study] = name if names[name] == 1 else f"{name}_{names[name]}"
    return found


def _given(study, *options):
    """Hash of what a study's result depends on: its text, and name, size and time of its logs and Modelica files."""
    from ..study.parse import load_study
    made = hashlib.sha256(str(options).encode())
    try:
        known = load_study(study)
        made.update(Path(study).read_bytes())
        for path in (*known.runs, *known.held_out, *known.modelica):
            state = os.stat(path)
            made.update(f"{path}\0{state.st_size}\0{state.st_mtime_ns}".encode())
    except (PycosimError, OSError):
        return ""  # it will fail, and is to be tried anew each time
    return made.hexdigest()[:16]


def _done(row, given, folder):
    return bool(row and given and row["given"] == given and not row["failure"] and (folder / "ladder.json").exists())


def _known(path):
    """Rows of an earlier table, by study."""
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            return {row["study"]: row for row in csv.DictReader(stream) if set(COLUMNS) <= set(row)}
    except OSError:
        return {}


def _write(path, rows):
    """Write the table; a crash leaves the one before."""
    stream = io.StringIO(newline="")
    table = csv.DictWriter(stream, COLUMNS)
    table.writeheader()
    table.writerows(rows)
    write_whole(path, stream.getvalue())

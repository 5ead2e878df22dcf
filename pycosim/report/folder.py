"""Files of a result in; a folder that holds all of them, or what was there before, out."""

from __future__ import annotations

import json
import os
import shutil
import signal
import threading
from contextlib import contextmanager
from pathlib import Path

from ..core.errors import PycosimError
from .records import to_json

MARKER = ".pycosim"


class FolderError(PycosimError):
    """A result folder cannot be made, or holds what pycosim did not write."""


# --- the folder -----------------------------------------------------------------------------------------------------


class Folder:
    """Results of one verb: written beside the folder, and put in its place when whole.

    Parameters
    ----------
    path : path
        Where the results go; missing parents are made. Earlier results of the same verb are replaced whole; results of
        other verbs, and what the user added to a result folder, stay.
    verb : str
        Its earlier files may be replaced.
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
            Within the folder, as ``parameters.json``.

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
            Within the folder, as ``parameters.json``.
        content : str or dict
            Text, or a result for JSON.

        Raises
        ------
        FolderError
            The file cannot be written.
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

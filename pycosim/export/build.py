"""C sources in, shared libraries for this machine or for every platform out, the same bytes each time."""

from __future__ import annotations

import hashlib
import importlib.util
import platform as host_platform
import shutil
import struct
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from ..core import cache
from ..core.errors import ExportError

FLAGS = ["-std=c99", "-O2", "-g0", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off"]


# Functions of which glibc has newer versions than the oldest of a platform: a compiler takes the newest that it finds
# where it runs, and the binary then refuses to load on an older system.
_RENEWED = ("exp", "exp2", "log", "log2", "pow", "fmod", "hypot", "lgamma")
_OLDEST = {"x86_64-linux": "2.2.5", "aarch64-linux": "2.17"}
_OLD_FUNCTIONS = "old_functions.h"


@dataclass(frozen=True)
class Platform:
    """Where a binary runs.

    Attributes
    ----------
    name : str
        As FMI 3 names it.
    target : str
        As zig names it; old systems, so that new ones are fine as well.
    fmi2 : str
        Folder in an FMU of FMI 2.
    suffix : str
        Ending of a shared library there, as ``.so``.
    """

    name: str
    target: str
    fmi2: str
    suffix: str


PLATFORMS = {p.name: p for p in (
    Platform("x86_64-linux", "x86_64-linux-gnu.2.17", "linux64", ".so"),
    Platform("aarch64-linux", "aarch64-linux-gnu.2.17", "aarch64-linux", ".so"),
    Platform("x86_64-windows", "x86_64-windows-gnu", "win64", ".dll"),
    Platform("x86_64-darwin", "x86_64-macos.10.15", "darwin64", ".dylib"),
    Platform("aarch64-darwin", "aarch64-macos.11.0", "darwin64", ".dylib"))}


def host():
    """The platform that Python runs on.

    Returns
    -------
    Platform

    Raises
    ------
    ExportError
        None of the five.
    """
    machine = host_platform.machine().lower()
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    system = {"win32": "windows"}.get(sys.platform, sys.platform)
    if f"{machine}-{system}" not in PLATFORMS:
        raise ExportError(f"no binary can be built for {machine}-{system}; there are {', '.join(PLATFORMS)}: export "
                          "with --platforms all, or rebuild the sources inside the FMU")
    return PLATFORMS[f"{machine}-{system}"]


def binaries(files, main, identifier, fmi, wanted="host"):
    """Shared libraries, by their path in the FMU.

    Parameters
    ----------
    files : dict of str to bytes
        Sources and headers.
    main : str
        The one to compile.
    identifier : str
        Name of the library.
    fmi : int
        2 or 3.
    wanted : str
        ``host`` or ``all``.

    Returns
    -------
    dict of str to bytes

    Raises
    ------
    ExportError
        There is no compiler, or it fails.
    """
    targets = list(PLATFORMS.values()) if wanted == "all" else [host()]
    found = {}
    for p in targets:
        content = library(files, main, identifier + p.suffix, p, cross=wanted == "all")
        folder = p.fmi2 if fmi == 2 else p.name
        found.setdefault(f"binaries/{folder}/{identifier}{p.suffix}", []).append(content)
    return {path: parts[0] if len(parts) == 1 else _universal(parts) for path, parts in found.items()}


def library(files, main, name, target, extra=(), cross=False):
    """One shared library, kept on disk.

    Parameters
    ----------
    files : dict of str to bytes
        Sources and headers.
    main, name : str
        The one to compile, and what it becomes.
    target : Platform
        What it is compiled for.
    extra : sequence of str
        More arguments of the compiler, as folders of headers.
    cross : bool
        Whether to take the compiler that makes the same bytes everywhere.

    Returns
    -------
    bytes

    Raises
    ------
    ExportError
        There is no compiler, or it fails.
    """
    command, version = compiler(target, cross)
    libraries = ["-lm"] if "linux" in target.name else []
    flags = [*FLAGS, *_link_flags(target, name)]
    if target.name in _OLDEST and "ziglang" not in command:
        files, flags = {**files, _OLD_FUNCTIONS: _old_functions(target)}, [*flags, "-include", _OLD_FUNCTIONS]
    command = [*command, *flags, main, "-o", name, *extra, *libraries]
    h = hashlib.sha256("\0".join([*command, version]).encode())
    for file in sorted(files):
        h.update(file.encode() + b"\0" + files[file])
    return cache.remember("binary", h.hexdigest()[:32], lambda: _compile(files, command, name), bytes, bytes)


def _old_functions(target):
    """A header that binds to the oldest versions of functions, so that this machine's binary runs on old ones too."""
    lines = [f'__asm__(".symver {n},{n}@GLIBC_{_OLDEST[target.name]}");' for n in _RENEWED]
    return "\n".join(["#include <features.h>", "#ifdef __GLIBC__", *lines, "#endif", ""]).encode()


def _link_flags(target, name):
    if "darwin" in target.name:  # else the path of the build gets in
        return [f"-Wl,-install_name,@rpath/{name}"]
    return ["-s"]


def compiler(target, cross=False):
    """A C compiler: the system's own for this machine, else zig.

    Parameters
    ----------
    target : Platform
        Where the binary is to run.
    cross : bool
        Whether to take zig in any case, so that the bytes do not depend on the system's compiler.

    Returns
    -------
    command : list of str
        To which flags and files are added.
    version : str
        What it says of itself; with the command it identifies the bytes that it makes.

    Raises
    ------
    ExportError
        There is none.
    """
    own = None if cross or sys.platform == "win32" else shutil.which("cc")
    if own:
        found = subprocess.run([own, "--version"], capture_output=True, text=True)
        if found.returncode == 0:
            return [own], found.stdout
    if importlib.util.find_spec("ziglang") is None:
        why = f"to build for {target.name}" if cross or target != host() else "there is no C compiler here"
        raise ExportError(f"{why}: an FMU's library needs one more package, 400 MB; type 'pip install ziglang' and "
                          "export again")
    from importlib.metadata import version
    return [sys.executable, "-m", "ziglang", "cc", "-target", target.target], version("ziglang")


def _compile(files, command, name):
    with tempfile.TemporaryDirectory() as folder:
        for file, content in files.items():
            (Path(folder) / file).write_bytes(content)
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace")
        if done.returncode:
            said = " ".join((done.stderr or done.stdout).split())[:300]
            raise ExportError(f"the C compiler '{command[0]}' failed on {name}: {said}")
        return (Path(folder) / name).read_bytes()


def _universal(parts):
    """One macOS library of several architectures: a table of (cpu, offset, size), then the libraries."""
    page, offset, table = 1 << 14, 1 << 14, b""
    body = b""
    for part in parts:
        cpu, kind = struct.unpack_from("<iI", part, 4)
        table += struct.pack(">iIIII", cpu, kind, offset, len(part), 14)
        padded = part + b"\0" * (-len(part) % page)
        body, offset = body + padded, offset + len(padded)
    head = struct.pack(">II", 0xCAFEBABE, len(parts)) + table
    return head + b"\0" * (page - len(head)) + body

"""Where compiled kernels are kept between runs: one folder for each state of their sources.

numba keeps machine code on disk, but looks only at the file of the outermost function to tell whether it is
stale. An inner function lies in another file here, so an edited or updated inner kernel would go on running as it
was; and then the bits of an image would depend on who compiled when. So numba is pointed to a folder named by a hash
of all kernels and of every module of ours whose values they compile in. An old state's folder is simply not found.

Call `use_kernel_cache()` first thing in a program, before anything imports numba. It costs a few milliseconds.
A NUMBA_CACHE_DIR that the user set stays as it is.
"""
# Paths are text here: twice as fast, and every start of a program pays for it.
# ruff: noqa: PTH113, PTH118, PTH123

from __future__ import annotations

import hashlib
import logging
import os
import re
import stat
import sys
import time
from pathlib import Path

_VARIABLE = "NUMBA_CACHE_DIR"
_SOURCES = Path(__file__).resolve().parent.parent
_IMPORT = re.compile(rb"^\s*(?:from\s+(scenefold[\w.]*)\s+import\s+([^\n(]+|\([^)]*\))|import\s+(scenefold[\w.]*))", re.MULTILINE)
_FOLDERS_KEPT = 4
"""States whose code is kept: a few branches, or versions, used in turn."""
_UNTOUCHED_S = 3600.0
"""Younger folders stay: whoever edits kernels goes back and forth. (numba makes a folder anew that went away.)"""

_log = logging.getLogger("scenefold.kernels")


def use_kernel_cache() -> Path | None:
    """Point numba to the folder of this state of the kernels; None if the user, or an imported numba, decided already."""
    home = _cache_home()
    chosen = os.environ.get(_VARIABLE)
    if chosen and (home is None or Path(chosen).parent != home):
        return None
    if "numba" in sys.modules:
        _log.debug("numba was imported before its folder was chosen")
        return None
    folder = _ready(home / kernels_hash()) if home is not None else None
    if folder is None:
        import tempfile  # slow to import, and seldom needed

        folder = Path(tempfile.mkdtemp(prefix="scenefold-kernels-"))
        _log.info("compiled kernels cannot be kept in %s, but only until the next run, in %s", home, folder)
    os.environ[_VARIABLE] = str(folder)
    return folder


def note_compiled() -> None:
    """All kernels of this state are compiled, and lie in the folder that was chosen."""
    mark = _mark()
    if mark is not None:
        mark.touch()


def are_compiled() -> bool:
    """Whether that was noted: a render compiles nothing, but what a changed machine makes it compile anew."""
    mark = _mark()
    return mark is not None and mark.exists()


def kernel_folder() -> Path | None:
    """Where compiled kernels are kept, once that was chosen and is there."""
    folder = os.environ.get(_VARIABLE)
    return Path(folder) if folder and Path(folder).is_dir() else None


def _mark() -> Path | None:
    folder = kernel_folder()
    return None if folder is None else folder / f"compiled-{kernels_hash()}"


def kernels_hash(sources: Path = _SOURCES) -> str:
    """A hash of every kernels module below `sources` and of all modules of ours that these import, directly or not."""
    digest = hashlib.sha256()
    contents: dict[str, bytes] = {}
    waiting = [os.path.join(folder, name) for folder, _, names in os.walk(sources) for name in names if "kernels" in name]
    waiting = [path for path in waiting if path.endswith(".py")]
    while waiting:
        path = waiting.pop()
        if path not in contents:
            with open(path, "rb") as file:
                contents[path] = file.read()
            waiting += _imported(contents[path], os.fspath(sources))
    for path in sorted(contents):
        digest.update(os.path.relpath(path, sources).encode() + b"\0" + hashlib.sha256(contents[path]).digest())
    return digest.hexdigest()[:20]


def _imported(source: bytes, sources: str) -> list[str]:
    """The files that the import lines of a module stand for: modules named whole, or as parts of their package."""
    files = []
    for parent, names, plain in _IMPORT.findall(source):
        module = os.path.join(sources, *(parent or plain).decode().split(".")[1:])
        if os.path.isfile(f"{module}.py"):
            files.append(f"{module}.py")
            continue
        parts = [os.path.join(module, f"{name}.py") for name in re.findall(r"[A-Za-z]\w*", names.decode())]
        found = [part for part in parts if os.path.isfile(part)]
        files += found or [os.path.join(module, "__init__.py")]
    return [file for file in files if os.path.isfile(file)]


def _cache_home() -> Path | None:
    """The folder of all states, in the user's cache; None if the user has no home."""
    try:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    except RuntimeError:
        return None
    return Path(base) / "scenefold" / "kernels"


def _ready(folder: Path) -> Path | None:
    """The folder, made if need be; None if it cannot be written, or if others could put code into it."""
    try:
        if not folder.is_dir():
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            _prune(folder)
        state = folder.stat()
        if state.st_uid != os.getuid() or state.st_mode & (stat.S_IWGRP | stat.S_IWOTH) or not os.access(folder, os.W_OK):
            return None
        os.utime(folder)
    except OSError:
        return None
    return folder


def _prune(newest: Path) -> None:
    """Remove the folders of old states, but for a few. What cannot be removed stays."""
    import shutil  # slow to import, and seldom needed

    others = sorted((entry.stat().st_mtime, entry) for entry in newest.parent.iterdir() if entry != newest)
    now = time.time()
    for used, folder in others[: -(_FOLDERS_KEPT - 1)]:
        if now - used > _UNTOUCHED_S:
            shutil.rmtree(folder, ignore_errors=True)

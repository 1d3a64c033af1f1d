"""The one clear error for a file that cannot be imported."""

from __future__ import annotations

from pathlib import Path

from scenefold.base.errors import LocalFault

_REPAIR = "repair the file, or export it again"


def bad_file(path: Path, what: str, remedy: str = _REPAIR) -> LocalFault:
    """A LocalFault that names the file, what is wrong with it, and what to do."""
    return LocalFault(what, where=str(path), remedy=remedy)


def readable_size(path: Path, what: str = "a scene file") -> int:
    """The size in bytes of a regular, readable file that is not empty; LocalFault otherwise. `what` it is to be, as people call it."""
    try:
        if not path.is_file():
            found = "is not a regular file" if path.exists() else "does not exist"
            raise LocalFault(f"the file {found}", where=str(path), remedy=f"give the path of {what}")
        size = path.stat().st_size
        with path.open("rb") as file:
            file.read(1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise LocalFault(f"the file cannot be read, {reason}", where=repr(str(path)), remedy="check the path") from error
    if size == 0:
        raise bad_file(path, "the file is empty")
    return size


def identity_of(path: Path) -> tuple[int, int]:
    """What a file is known by, under whichever of its names."""
    found = path.stat()
    return found.st_dev, found.st_ino


def beside(path: Path, name: str, what: str) -> Path:
    """The file that `path` names by a relative path; LocalFault if there is none, or it is no regular file."""
    # Backslashes come from exporters on Windows.
    relative = Path(name.replace("\\", "/").strip())
    target = path.parent / relative
    if relative.is_absolute() or ":" in name:
        raise bad_file(path, f"{what} {name!r} is no path relative to the file", "use relative paths, or one .glb")
    try:
        found = target.is_file()
    except (OSError, ValueError):
        found = False
    if not found:
        raise bad_file(path, f"{what} {name!r} is missing", f"put it at {target}")
    return target

"""A kept render: a file from which a render goes on that was interrupted (specs/08-passes.md, *Kept renders*).

    "scenefold/kept 1" | u32 bytes of the head | head: {asked, content, numeric_class, passes} | film | SHA-256 of all before

The head is a document of the wire. A file is whole or as it was before: it is written beside its name, made durable, and renamed.
"""

from __future__ import annotations

import hashlib
import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenefold.base.errors import DamagedData, LocalFault, ScenefoldError
from scenefold.base.plain_values import exactly, text, whole
from scenefold.crypto.drafts import new_file, sweep_files, sync_folder
from scenefold.render.image_files import check_writable
from scenefold.render.job import HASH_BYTES, RenderOptions
from scenefold.render.pool.kept_film import film_size
from scenefold.render.pool.request import Keep, options_document
from scenefold.wire import pack_value, unpack_value

_MAGIC = b"scenefold/kept 1"
_LENGTH = struct.Struct("<I")
_HEAD_BYTES_MAX = 64 * 1024
_ANEW = "remove it, and the render begins anew"


@dataclass(frozen=True, slots=True)
class KeptRender:
    """All passes below `keep.passes` of a render, as a film."""

    asked: dict[str, Any]
    """What decides the image's bits, of what was asked (`asked_of`)."""
    keep: Keep
    film: bytes
    """As `packed_film` made it."""


def asked_of(options: RenderOptions) -> dict[str, Any]:
    """Of a render's options those that decide the bits of its image: how space was divided among nodes does not."""
    document = options_document(options)
    return {name: value for name, value in document.items() if name not in {"algorithm", "moving", "pools", "skips"}}


def check_keepable(path: Path) -> None:
    """LocalFault unless a kept render may lie there, and a draft of one beside it: asked before the work."""
    check_writable(path)
    _check_regular(path)
    try:
        with new_file(path):
            pass
    except OSError as error:
        what = f"cannot keep the render: {error.strerror or error}"
        raise LocalFault(what, where=str(path), remedy="name another file for it") from None


def write_kept(path: Path, kept: KeptRender) -> None:
    """Write it durably in place of what was there; LocalFault if that cannot be."""
    keep = kept.keep
    head = pack_value(
        {
            "asked": kept.asked,
            "content": keep.content,
            "numeric_class": keep.numeric_class,
            "passes": keep.passes,
        }
    )
    start = _MAGIC + _LENGTH.pack(len(head)) + head
    try:
        sweep_files(path.parent, path.name)
        with new_file(path) as (draft, handle):
            with os.fdopen(handle, "wb", closefd=False) as file:
                file.writelines((start, kept.film, _digest(start, kept.film)))
                file.flush()
                os.fsync(handle)
            draft.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        what = f"cannot keep the render: {error.strerror or error}"
        raise LocalFault(what, where=str(path), remedy="check the folder, its rights and the room on its disk") from None


def read_kept(path: Path, options: RenderOptions) -> KeptRender | None:
    """What is kept of the render of these options; None if nothing is.

    DamagedData if it is no kept render, or not whole; LocalFault if it is of other options, naming one of them.
    """
    try:
        _check_regular(path)
        with path.open("rb") as file:
            start = file.read(len(_MAGIC) + _LENGTH.size)
            if len(start) != len(_MAGIC) + _LENGTH.size or not start.startswith(_MAGIC):
                raise DamagedData("that is no kept render", where=str(path), remedy="name another file, or one that is not there yet")
            (length,) = _LENGTH.unpack(start[len(_MAGIC) :])
            head = file.read(min(length, _HEAD_BYTES_MAX))
            asked, keep = _head_of(head, path)
            _check_asked(asked, options, path)
            if not 1 <= keep.passes < options.plan.count:
                raise DamagedData("the kept render has passes that it cannot have", where=str(path), remedy=_ANEW)
            size = film_size(options.plan, options.columns, options.window.pixels, keep.passes)
            film, digest = file.read(size), file.read(HASH_BYTES + 1)
    except FileNotFoundError:
        return None
    except OSError as error:
        what = f"cannot read the kept render: {error.strerror or error}"
        raise LocalFault(what, where=str(path), remedy="check the path and its rights") from None
    if _digest(start + head, film) != digest:
        raise DamagedData("the kept render is damaged", where=str(path), remedy=_ANEW)
    return KeptRender(asked, keep, film)


def _check_regular(path: Path) -> None:
    # Who opens a pipe that nobody writes to waits for ever.
    if path.exists() and not path.is_file():
        what = "cannot read the kept render: that is not a regular file"
        raise LocalFault(what, where=str(path), remedy="name another file, or one that is not there yet")


def _head_of(packed: bytes, path: Path) -> tuple[dict[str, Any], Keep]:
    try:
        head = unpack_value(packed, what="the head of a kept render")
        asked = head["asked"]
        if not isinstance(asked, dict):
            raise TypeError("a map is expected")
        return asked, Keep(whole(head["passes"], 0, 2**32 - 1), exactly(head["content"], HASH_BYTES), text(head["numeric_class"]))
    except (KeyError, TypeError, ValueError, ScenefoldError) as error:
        raise DamagedData(f"the kept render is damaged ({type(error).__name__})", where=str(path), remedy=_ANEW) from error


def _digest(start: bytes, film: bytes) -> bytes:
    digest = hashlib.sha256(start)
    digest.update(film)
    return digest.digest()


def _check_asked(kept: dict[str, Any], options: RenderOptions, path: Path) -> None:
    asked = asked_of(options)
    differing = sorted(name for name in kept.keys() | asked.keys() if kept.get(name) != asked.get(name))
    if differing:
        what = f"the kept render is of another {' and another '.join(name.replace('_', ' ') for name in differing)}"
        raise LocalFault(what, where=str(path), remedy="ask for the same image, or name another file for this one")

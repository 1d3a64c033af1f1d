"""An archive as it is written: beside its place, and given its name once it is whole (specs/24-archive.md, Writing)."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import io
import os
import tarfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from scenefold.base.errors import LocalFault
from scenefold.crypto.drafts import sync_folder
from scenefold.scene.archive.layout import DESCRIPTION, END, ArchivedRecord, ArchivedScene, Totals, part_name

FILE_MODE = 0o600
_SECONDS_MAX = 8**11 - 1
"""What a header of tar holds."""


class NewArchive:
    """An archive that nobody sees yet: `begin` once, `add` as often as there are records, then `finish`, and `abandon` in any case.

    LocalFault from any of them if something has its name, another process writes it, or the disk does not take it.
    """

    def __init__(self, place: Path) -> None:
        check_free(place)
        self._place = place
        self._partial = place.with_name(f".{place.name}.partial")
        self._parts = self.records = self.bytes = 0
        self._index = hashlib.sha256()
        with self._told():
            self._file: BinaryIO | None = _locked(self._partial)
            self._tar = tarfile.open(fileobj=self._file, mode="w", format=tarfile.USTAR_FORMAT)  # noqa: SIM115  ends with its file

    def begin(self, scene: ArchivedScene) -> None:
        with self._told():
            self._put(DESCRIPTION, scene.pack())

    def add(self, records: Sequence[ArchivedRecord]) -> None:
        """Up to BATCH records, as a part."""
        part = b"".join(record.line() for record in records)
        self._parts += 1
        self._index.update(part)
        with self._told():
            self._put(part_name(self._parts), part)
            for record in records:
                self._put(record.file, record.payload, record.seconds)
                self.records += 1
                self.bytes += len(record.payload)
        # It would remember all files; of a large scene that is much.
        vars(self._tar)["members"].clear()

    def finish(self) -> None:
        """Whole, durable, and under its name."""
        assert self._file is not None
        with self._told():
            self._put(END, Totals(self.records, self.bytes, self._index.hexdigest()).pack())
            self._tar.close()
            self._file.flush()
            os.fsync(self._file.fileno())
            check_free(self._place)
            self._partial.rename(self._place)
            self._close()
            sync_folder(self._place.parent)

    def abandon(self) -> None:
        """Leave nothing of it, unless it was finished."""
        if self._file is not None:
            with self._told():
                self._partial.unlink(missing_ok=True)
                self._close()

    def _close(self) -> None:
        """Ends the lock, too: so after the file has its name, or is gone."""
        if self._file is not None:
            file, self._file = self._file, None
            with suppress(OSError):
                # What could not be written is told already, or is to be forgotten.
                file.close()

    @contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except OSError as problem:
            raise _not_written(self._place, problem) from problem

    def _put(self, name: str, content: bytes, seconds: int = 0) -> None:
        told = tarfile.TarInfo(name)
        told.size = len(content)
        told.mode = 0o644
        told.mtime = seconds if 0 <= seconds <= _SECONDS_MAX else 0
        self._tar.addfile(told, io.BytesIO(content))


def check_free(place: Path) -> None:
    """LocalFault if there is something already. What an archive shall be is looked at before anything is read for it."""
    if place.exists() or place.is_symlink():
        raise LocalFault("there is a file already", where=str(place), remedy="remove it, or choose another name")


def _locked(partial: Path) -> BinaryIO:
    """A file that this process alone writes, empty. One that somebody left who died is begun anew."""
    file = os.fdopen(os.open(partial, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, FILE_MODE), "w+b")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        file.truncate()
    except BlockingIOError:
        file.close()
        remedy = "wait for it, or choose another name"
        raise LocalFault("another process writes this archive", where=str(partial), remedy=remedy) from None
    except OSError:
        file.close()
        raise
    return file


def _not_written(place: Path, problem: OSError) -> LocalFault:
    if problem.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        remedy = "make room, or choose another folder; nothing was left there"
        return LocalFault(f"the archive does not fit on the disk: {problem.strerror}", where=str(place), remedy=remedy)
    return LocalFault(
        f"cannot write the archive: {problem.strerror}", where=str(place), remedy="choose another file, in a folder that is there"
    )

"""An archive as it is read: a part of the index, then its records, each held against what was said of it (specs/24-archive.md, Bringing back).

Nothing is unpacked to the disk, and memory holds one part with its records, whatever the file says; and the ids of the objects that were met.
"""

from __future__ import annotations

import hashlib
import tarfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import SpaceId
from scenefold.scene.archive.layout import (
    DESCRIPTION,
    END,
    JSON_BYTES_MAX,
    ArchivedRecord,
    ArchivedScene,
    IndexLine,
    Totals,
    part_name,
    read_part,
)

_REMEDY = "give a file that `scenectl scene export` wrote, as it was written"


class Archive:
    """A file. LocalFault wherever it is no archive, or not the one that was written."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with self._opened() as files:
            self.scene = ArchivedScene.unpack(files.next(DESCRIPTION, JSON_BYTES_MAX))

    def batches(self) -> Iterator[list[ArchivedRecord]]:
        """All records, a part at a time, in the order of the spaces. That they are all is known at the end alone."""
        with self._opened() as files:
            if ArchivedScene.unpack(files.next(DESCRIPTION, JSON_BYTES_MAX)) != self.scene:
                raise DamagedData("it was changed while it was read")
            yield from _Records(self.scene, files).batches()

    @contextmanager
    def _opened(self) -> Iterator[_Files]:
        is_tar = False
        try:
            with tarfile.open(self._path, "r:") as tar:
                is_tar = True
                yield _Files(tar)
        except DamagedData as problem:
            raise self._bad(f", or a damaged one: {problem.what}", problem.remedy) from problem
        except (tarfile.TarError, EOFError, OverflowError, ValueError) as problem:
            raise self._bad(", or a damaged one: it was cut off, or changed" if is_tar else ": it is no tar") from problem
        except OSError as problem:
            raise LocalFault(f"cannot read the archive: {problem.strerror}", where=str(self._path), remedy="check the path") from problem

    def _bad(self, why: str, remedy: str = "") -> LocalFault:
        return LocalFault(f"the file is no archive of a scene{why}", where=str(self._path), remedy=remedy or _REMEDY)


class _Files:
    """The files of a tar, one after the other."""

    def __init__(self, tar: tarfile.TarFile) -> None:
        self._tar = tar

    def next(self, name: str, bytes_max: int) -> bytes:
        """The next file, which must have this name."""
        found, content = self.take(bytes_max)
        if found != name:
            raise DamagedData(f"{name} is missing" if found is None else f"{found[:100]!r} stands where {name} belongs")
        return content

    def take(self, bytes_max: int) -> tuple[str | None, bytes]:
        """The next file, whatever it is called; None at the end."""
        told = self._tar.next()
        if told is None:
            return None, b""
        # It would remember all files; of a large scene that is much.
        vars(self._tar)["members"].clear()
        if not told.isreg() or told.size > bytes_max:
            raise DamagedData(f"{told.name[:100]!r} is no plain file, or too large")
        file = self._tar.extractfile(told)
        content = b"" if file is None else file.read()
        if len(content) != told.size:
            raise DamagedData("it was cut off")
        return told.name, content


class _Records:
    """What follows the description."""

    def __init__(self, scene: ArchivedScene, files: _Files) -> None:
        self._managed = {space.id: space.node_managed for space in scene.spaces}
        self._turn = {space.id: turn for turn, space in enumerate(scene.order)}
        self._files = files
        self._index = hashlib.sha256()
        self._last: tuple[int, bytes] = (-1, b"")
        self._objects: set[tuple[SpaceId, bytes]] = set()

    def batches(self) -> Iterator[list[ArchivedRecord]]:
        records = size = parts = 0
        while True:
            name, content = self._files.take(JSON_BYTES_MAX)
            if name == END:
                break
            parts += 1
            if name != part_name(parts):
                raise DamagedData("it was cut off" if name is None else f"{name[:100]!r} stands where {part_name(parts)} belongs")
            self._index.update(content)
            batch = [self._record(line) for line in read_part(content, name)]
            if len({record.space for record in batch}) > 1:
                raise DamagedData(f"{name} has records of several spaces")
            records += len(batch)
            size += sum(len(record.payload) for record in batch)
            yield batch
        if Totals.unpack(content) != Totals(records, size, self._index.hexdigest()):
            raise DamagedData(f"{END} does not say what stands before it")
        if self._files.take(0)[0] is not None:
            raise DamagedData(f"something follows {END}")

    def _record(self, line: IndexLine) -> ArchivedRecord:
        name, payload = self._files.take(line.size)
        if name is None:
            raise DamagedData("it was cut off")
        record = line.record(name, payload)
        is_managed = self._managed.get(record.space)
        if is_managed is None or is_managed != bool(record.object):
            raise DamagedData(f"{record.file} is a record of a space that the scene has not, or of another kind")
        turn = self._turn[record.space]
        if is_managed:
            # They slide while they are listed, so their places say nothing of their order.
            in_order = turn >= self._last[0] and (record.space, record.object) not in self._objects
            self._objects.add((record.space, record.object))
            self._last = turn, b""
        else:
            in_order = (turn, record.location) > self._last
            self._last = turn, record.location
        if not in_order:
            raise DamagedData(f"{record.file} is there twice, or out of order")
        return record

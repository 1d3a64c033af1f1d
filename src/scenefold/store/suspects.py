"""What a former life has left that may have been deleted since, and purged (specs/22-purge.md, Who was away).

When the identity is renewed, a note says that all records here are of a former life. Those that may be older than something purged
are then set aside, into a table of their own: so they lie nowhere by right, and nobody who asks what is here meets them. They go when
the owner of their place is known to have them, or something newer, or when somebody who holds the scene's key says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from scenefold.base.errors import DamagedData
from scenefold.base.ids import SceneId
from scenefold.crypto import Record, RecordHeader, version_key
from scenefold.store.changes import MayUseReserve, storage_full
from scenefold.store.digest_sums import Held
from scenefold.store.keeping import drop_record
from scenefold.store.layout import (
    FORMER_LIFE,
    NOTES,
    RECORDS,
    SUSPECTS,
    Spot,
    record_key,
    scene_key,
    scene_of,
    sound_header,
    spot_of,
    stored_header,
    unpack_record,
)
from scenefold.store.opened import OpenedStore
from scenefold.store.tally import Tally
from scenefold.store.versions import version_of
from scenefold.store.walking import spaces
from scenefold.world.ports import ReadTransaction, WriteTransaction

LOOK_RECORDS = 2048
"""Looked at in one view: some 5 us each."""
MOVE_RECORDS = 128
"""Of one commit: each is copied, and a full one has 60 KiB."""
_OF_SCENE_END = b"\xff" * 64


class SuspectPage(NamedTuple):
    """Records in the order of their keys, and where to go on; None behind the last one."""

    records: list[Held]
    cursor: bytes | None


class Older(NamedTuple):
    """Spots of records, and of some that have rotted; and where to go on looking."""

    spots: list[Spot]
    cursor: bytes | None


class SuspectStore(OpenedStore):
    """The part of the store that keeps a former life's records apart."""

    async def has_former_life(self) -> bool:
        """Whether records of a former life were not looked through yet."""
        return await self._view(lambda view: view.get(NOTES, FORMER_LIFE) is not None)

    async def scenes_kept(self) -> list[SceneId]:
        """The scenes of which there may be records."""
        return sorted({scene for scene, _ in await self._view(spaces)})

    async def set_aside(self, scene: SceneId, below: int) -> int:
        """Move the scene's records of epochs below this one to the suspects, a few at a time; how many. May be begun again at any time.

        What has rotted so that nobody knows its epoch is deleted. Refused if the disk is full.
        """
        moved, cursor = 0, b""
        while True:
            older = await self._view(read_older, scene, below, cursor, LOOK_RECORDS)
            for start in range(0, len(older.spots), MOVE_RECORDS):
                moved += await self._writer.submit(SetAside(older.spots[start : start + MOVE_RECORDS], below))
            if older.cursor is None:
                return moved
            cursor = older.cursor

    async def end_former_life(self) -> None:
        """All that is here now is of the present life, but for the suspects. Durable on return."""
        await self._writer.submit(EndFormerLife())

    async def suspects(self, scene: SceneId | None, after: bytes, limit: int) -> SuspectPage:
        """The first `limit` >= 1 suspects behind the cursor (b"": from the first on), of one scene or all."""
        assert limit >= 1
        return await self._view(read_suspects, scene, after, limit)

    async def suspect_records(self, spots: Sequence[Spot]) -> list[Record | DamagedData | None]:
        """The suspects at these spots."""
        return await self._view(read_suspect_records, spots)

    async def discard_suspects(self, versions: Sequence[tuple[Spot, bytes]]) -> int:
        """Delete the suspects with exactly these digests; how many were there. Durable on return."""
        return await self._writer.submit(DiscardSuspects(list(versions)))

    async def suspect_counts(self) -> dict[SceneId, int]:
        """How many suspects there are of each scene that has any. Some us each."""
        return await self._view(count_suspects)


@dataclass(frozen=True, slots=True)
class SetAside(MayUseReserve):
    """Move these records to the suspects, as far as they are of epochs below this one. Of two of one spot the newer one stays."""

    spots: Sequence[Spot]
    below: int

    @property
    def size_bytes(self) -> int:
        return len(self.spots) * 65536

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> int:
        return sum(self._move(transaction, tally, spot) for spot in self.spots)

    def _move(self, transaction: WriteTransaction, tally: Tally, spot: Spot) -> bool:
        key = record_key(*spot)
        value = transaction.get(RECORDS, key)
        if value is None or not _is_older(value, self.below):
            return False
        header, packed = _header(value), bytes(value)
        present = transaction.get(SUSPECTS, key)
        known = None if present is None else _header(present)
        if header is not None and (known is None or version_key(known) < version_key(header)):
            transaction.put(SUSPECTS, key, packed)
        drop_record(transaction, tally, spot)
        return header is not None

    def when_full(self, _transaction: ReadTransaction, /) -> int:
        raise storage_full()


@dataclass(frozen=True, slots=True)
class EndFormerLife(MayUseReserve):
    """Delete the note of it."""

    @property
    def size_bytes(self) -> int:
        return 64

    def apply(self, transaction: WriteTransaction, _tally: Tally, /) -> None:
        if transaction.get(NOTES, FORMER_LIFE) is not None:
            transaction.delete(NOTES, FORMER_LIFE)

    def when_full(self, _transaction: ReadTransaction, /) -> None:
        raise storage_full()


@dataclass(frozen=True, slots=True)
class DiscardSuspects(MayUseReserve):
    """Delete exactly these versions; a rotten one is any. Gives the number deleted."""

    versions: Sequence[tuple[Spot, bytes]]

    @property
    def size_bytes(self) -> int:
        return len(self.versions) * 128

    def apply(self, transaction: WriteTransaction, _tally: Tally, /) -> int:
        return sum(self._discard(transaction, record_key(*spot), digest) for spot, digest in self.versions)

    def _discard(self, transaction: WriteTransaction, key: bytes, digest: bytes) -> bool:
        value = transaction.get(SUSPECTS, key)
        header = None if value is None else _header(value)
        if value is None or (header is not None and header.digest != digest):
            return False
        return transaction.delete(SUSPECTS, key)

    def when_full(self, _transaction: ReadTransaction, /) -> int:
        raise storage_full()


def read_older(transaction: ReadTransaction, scene: SceneId, below: int, after: bytes, limit: int) -> Older:
    """Of the first `limit` records of a scene behind the cursor those of epochs below this one."""
    first = after + b"\0" if after else scene_key(scene)
    found: list[Spot] = []
    for looked_at, (key, value) in enumerate(transaction.scan(RECORDS, first, scene_key(scene) + _OF_SCENE_END), 1):
        if _is_older(value, below):
            found.append(spot_of(key))
        if looked_at == limit:
            return Older(found, key)
    return Older(found, None)


def _is_older(value: memoryview, below: int) -> bool:
    """Of a rotten header nobody knows it."""
    header = _header(value)
    return header is None or header.epoch < below


def _header(value: memoryview) -> RecordHeader | None:
    try:
        return stored_header(value)
    except DamagedData:
        return None


def read_suspects(transaction: ReadTransaction, scene: SceneId | None, after: bytes, limit: int) -> SuspectPage:
    """See `SuspectStore.suspects`. What has rotted is left out: nobody could be shown it."""
    prefix = b"" if scene is None else scene_key(scene)
    records: list[Held] = []
    for key, value in transaction.scan(SUSPECTS, max(prefix, after + b"\0" if after else b""), prefix + _OF_SCENE_END):
        header = sound_header(value)
        if header is not None:
            spot = spot_of(key)
            records.append(Held(spot, spot.home, version_of(header), header, len(value)))
            if len(records) == limit:
                return SuspectPage(records, key)
    return SuspectPage(records, None)


def read_suspect_records(transaction: ReadTransaction, spots: Sequence[Spot]) -> list[Record | DamagedData | None]:
    """See `SuspectStore.suspect_records`."""
    return [_read(transaction.get(SUSPECTS, record_key(*spot))) for spot in spots]


def _read(value: memoryview | None) -> Record | DamagedData | None:
    try:
        return None if value is None else unpack_record(value)
    except DamagedData as damage:
        return damage


def count_suspects(transaction: ReadTransaction) -> dict[SceneId, int]:
    """See `SuspectStore.suspect_counts`."""
    counts: dict[SceneId, int] = {}
    for key in transaction.keys(SUSPECTS, b"", _OF_SCENE_END):
        scene = scene_of(key[:4])
        counts[scene] = counts.get(scene, 0) + 1
    return counts

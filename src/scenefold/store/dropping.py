"""Deleted records go for good: exactly one version each, durably (specs/22-purge.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scenefold.crypto import RecordPlace
from scenefold.store.bygone import Bygone, Version
from scenefold.store.changes import MayUseReserve, PutValues, storage_full
from scenefold.store.keeping import drop_record
from scenefold.store.layout import RECORDS, Spot, record_key, sound_header
from scenefold.store.noticing import Noticed
from scenefold.store.opened import OpenedStore
from scenefold.store.placing import place_of
from scenefold.store.tally import Tally
from scenefold.store.versions import version_of
from scenefold.world.ports import ReadTransaction, WriteTransaction

_FRAMING_BYTES = 512


@dataclass(frozen=True, slots=True)
class DropVersions(MayUseReserve):
    """Delete exactly these versions, objects wherever they lie; what has changed since stays. Gives the number that were there."""

    versions: Sequence[tuple[Spot, bytes]]
    """As `version_of`."""

    @property
    def size_bytes(self) -> int:
        return len(self.versions) * _FRAMING_BYTES

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> int:
        return sum(self._drop(transaction, tally, spot, version) for spot, version in self.versions)

    def _drop(self, transaction: WriteTransaction, tally: Tally, spot: Spot, version: bytes) -> bool:
        (scene, space, _), object_id = spot
        known = place_of(transaction, scene, space, object_id) if object_id else None
        where = spot if known is None else Spot(RecordPlace(scene, space, known), object_id)
        value = transaction.get(RECORDS, record_key(*where))
        header = None if value is None else sound_header(value)
        if header is None or version_of(header) != version:
            return False
        drop_record(transaction, tally, where)
        return True

    def when_full(self, _transaction: ReadTransaction, /) -> int:
        raise storage_full()


class DroppingStore(OpenedStore):
    """The part of the store that lets go of what was deleted."""

    bygone: Bygone
    noticed: Noticed

    async def drop(self, versions: Sequence[tuple[Spot, bytes]]) -> int:
        """Delete exactly the versions (as `version_of`), and say how many were there. Durable on return. Refused if the disk is full."""
        dropped = await self._writer.submit(DropVersions(list(versions)))
        self.noticed.gone(spot for spot, _ in versions)
        return dropped

    async def flush(self) -> None:
        """Return once everything that was given to the writer before is durable, or was refused."""
        await self._writer.submit(PutValues(()))

    def mark_bygone(self, versions: Sequence[tuple[Spot, Version]]) -> bool:
        """Take nothing older than these as long as the store is open. False if there is no room to remember that."""
        return self.bygone.mark(versions)

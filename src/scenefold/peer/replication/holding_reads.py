"""Copies as answers to readers: GetCopies (specs/20-copies.md, Reads).

What a holder says counts only together with what others say under the same configuration. So it names that configuration, and
answers only while it has its entry, whole, and its own lease: both are looked at when the records have been read. Who is asked for digests
of what it owns answers for that alone (owner_versions.py). A stray is shown under a configuration of this node alone, which counts for nobody.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from scenefold.base.errors import DamagedData
from scenefold.base.limits import BULK_BYTES_MAX, CUSTODY_ENTRIES_MAX, STORE_READ_BATCH_MAX
from scenefold.base.location import Location
from scenefold.base.placement import Layout
from scenefold.crypto import Record, RecordPlace, wanted_place
from scenefold.peer.copies.entries import Entry
from scenefold.peer.handlers import Handlers
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.rightful import rightful
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.replication.owner_versions import OwnerVersions
from scenefold.store import Spot, version_of
from scenefold.wire import Configuration, CopiesFound, Copy, CopyState, GetCopies, Packet, RecordBytes, RecordKey

_Found = Record | bytes | DamagedData | None
"""A record, its header alone, what is left of it, or nothing."""
_NO_CUSTODY = Copy(CopyState.NO_CUSTODY, 0, b"", None)
_COPY_BYTES = 64
"""Of a record's answer, beside the record."""
_MEMBER_BYTES = 32
"""Of one member of a configuration, and a share of the rest of it."""


class HoldingReads:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts, owner: OwnerVersions) -> None:
        self._parts = parts
        self._owner = owner

    def register(self, handlers: Handlers) -> None:
        handlers.add(GetCopies, self._on_get)

    async def _on_get(self, packet: GetCopies, peer: str) -> Packet:
        known = await self._parts.scenes.known(packet.scene, position=packet.position, asker=peer)
        for space in sorted({key.space for key in packet.keys}):
            known.check_no_shadow(space, "read")
        answer = _Answer(packet.digests_only)
        for start in range(0, len(packet.keys), STORE_READ_BATCH_MAX):
            keys = packet.keys[start : start + STORE_READ_BATCH_MAX]
            if not await self._read(packet, keys, known, answer):
                break
        self._parts.store.check_kept(packet.scene)
        return CopiesFound(tuple(answer.holders), tuple(answer.copies))

    async def _read(self, packet: GetCopies, keys: Sequence[RecordKey], known: KnownScene, answer: _Answer) -> bool:
        """Answer these; False if there is no room for all of them."""
        before = [self._entry(known.layouts.get(key.space), _home_of(key), any_copy=packet.any_copy) for key in keys]
        spots = [Spot(RecordPlace(packet.scene, key.space, key.location), key.object) for key in keys]
        held = [spot for spot, entry in zip(spots, before, strict=True) if entry is not None]
        records = iter(await self._found(held, digests_only=packet.digests_only))
        own: Mapping[Spot, _Found] = {}
        rest = [spot for spot, entry in zip(spots, before, strict=True) if entry is None]
        if rest and packet.digests_only and not packet.any_copy:
            own = await self._owner.told(rest)
        elif rest and packet.any_copy and not packet.digests_only:
            own = await self._strays([spot for spot in rest if known.layouts.get(spot.place.space)])
        me = Configuration(0, (self._parts.own.member,), 1)
        for key, spot, entry in zip(keys, spots, before, strict=True):
            found = None if entry is None else next(records)
            # What was said in between may have ended the entry: then others may have been told newer things since.
            is_still = entry is not None and self._entry(entry.layout, _home_of(key), any_copy=packet.any_copy) == entry
            has_room = answer.tell(me, own[spot]) if spot in own else answer.add(entry if is_still else None, found)
            if not has_room:
                return False
        return True

    async def _found(self, spots: Sequence[Spot], *, digests_only: bool) -> list[_Found]:
        """The records, or their headers if these are enough. What has no sound header is looked at as a whole: it may have rotted."""
        store = self._parts.store
        if not digests_only:
            return list(await store.read(spots))
        headers = await store.record_headers(spots)
        others = iter(await store.read([spot for spot, header in zip(spots, headers, strict=True) if header is None]))
        return [next(others) if header is None else header for header in headers]

    async def _strays(self, spots: Sequence[Spot]) -> Mapping[Spot, _Found]:
        """Those that lie here sound, and by no right. Of what does not, a stray says nothing."""
        now = await rightful(self._parts)
        strays = [spot for spot in spots if now.is_stray((spot.place.scene, spot.place.space), spot.home)]
        found = await self._found(strays, digests_only=False)
        return {spot: record for spot, record in zip(strays, found, strict=True) if isinstance(record, Record)}

    def _entry(self, layout: Layout | None, home: Location, *, any_copy: bool) -> Entry | None:
        """Under which entry this node may answer for a place."""
        if not layout or not (any_copy or self._parts.lease.holds()):
            return None
        copies = self._parts.keeper.copies
        return copies.answers(layout, home) or (copies.custody.at(layout, home) if any_copy else None)


class _Answer:
    """What fits one frame."""

    def __init__(self, digests_only: bool) -> None:
        self.holders: list[Configuration] = []
        self.copies: list[Copy] = []
        self._digests_only = digests_only
        self._places: dict[Configuration, int] = {}
        self._room = BULK_BYTES_MAX

    def add(self, entry: Entry | None, found: _Found) -> bool:
        """False, and nothing is added, if there is no room; the first always has."""
        if entry is None or (found is None and not entry.whole):
            # Who has not all of it cannot say that nothing is there.
            return self._append(_NO_CUSTODY, None)
        return self.tell(Configuration(entry.number, entry.members, entry.needed), found)

    def tell(self, group: Configuration, found: _Found) -> bool:
        """Likewise, of what counts under this configuration."""
        place = self._places.get(group, len(self.holders))
        return self._append(self._copy(place, found), group)

    def _copy(self, place: int, found: _Found) -> Copy:
        if found is None:
            return Copy(CopyState.NOTHING, place, b"", None)
        if isinstance(found, DamagedData):
            return Copy(CopyState.DAMAGED, place, b"", None)
        if isinstance(found, bytes):
            return Copy(CopyState.DIGEST, place, version_of(found), None)
        if self._digests_only:
            return Copy(CopyState.DIGEST, place, version_of(found.header_bytes), None)
        return Copy(CopyState.RECORD, place, b"", RecordBytes(found.signature, found.header_bytes, found.ciphertext))

    def _append(self, copy: Copy, group: Configuration | None) -> bool:
        record = copy.record
        size = _COPY_BYTES + (0 if record is None else len(record.signature) + len(record.header) + len(record.ciphertext))
        is_new = group is not None and group not in self._places
        if group is not None and is_new:
            size += _MEMBER_BYTES * (1 + len(group.members))
        if self.copies and (size > self._room or (is_new and len(self.holders) == CUSTODY_ENTRIES_MAX)):
            return False
        if group is not None and is_new:
            self._places[group] = len(self.holders)
            self.holders.append(group)
        self.copies.append(copy)
        self._room -= size
        return True


def _home_of(key: RecordKey) -> Location:
    return wanted_place(key.object) if key.object else key.location

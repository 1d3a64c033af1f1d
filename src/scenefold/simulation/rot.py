"""Copies of records that have rotted on disks: which of them are still there (specs/17-simulation.md, Custody).

A copy is known by its bytes, not by where it lies: a node may slide it, and a backup may bring it back. Once it was replaced or
deleted it excuses nothing any more. What is left of it may go to other disks (20-copies.md, What nobody has sound).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Location
from scenefold.crypto import RecordPlace, is_husk
from scenefold.simulation.disks import Disk, place_of, version_in
from scenefold.simulation.history import Place, Version
from scenefold.store.layout import RECORDS, location_of, pack_record, record_key, remains_of


class RottenCopy(NamedTuple):
    """One that lies on a disk now."""

    slot: int
    place: Place
    location: Location
    key: bytes


class Rot:
    """Everything that ever rotted in a run, by place."""

    def __init__(self, disks: Mapping[int, Disk]) -> None:
        self._disks = disks
        self._values: dict[Place, set[bytes]] = {}

    def add(self, slot: int, key: bytes) -> None:
        """What lies there has just rotted."""
        self._values.setdefault(place_of(key), set()).add(bytes(self._disks[slot].peek(RECORDS)[key]))

    def has(self, slot: int, key: bytes) -> bool:
        """Whether what lies there now is rotten."""
        value = self._disks[slot].peek(RECORDS).get(key)
        return place_of(key) in self._values and value is not None and self._is_rotten(place_of(key), value)

    def is_at(self, slot: int, place: Place) -> bool:
        """Whether a disk's copy of a record is rotten now."""
        return place in self._values and any(copy.place == place for copy in self.on(slot))

    def before(self, slot: int, place: Place) -> Version | None:
        """What lay on a disk where a copy is rotten now; None if that is not known, as of what came there rotten."""
        if place not in self._values:
            return None
        found = (self._disks[slot].rotten(RECORDS).get(copy.key) for copy in self.on(slot) if copy.place == place)
        return next((version_in(value) for value in found if value is not None), None)

    def copies(self) -> Iterator[RottenCopy]:
        """All that there are now, in the order of slots and places."""
        for slot in self._disks:
            yield from self.on(slot)

    def on(self, slot: int) -> list[RottenCopy]:
        """Those on one disk."""
        if not self._values:
            return []
        table = self._disks[slot].peek(RECORDS)
        keys = [key for place in sorted(self._values) for key in self._keys(place, table)]
        return [RottenCopy(slot, place_of(key), location_of(key), key) for key in keys if self._is_rotten(place_of(key), table[key])]

    def _is_rotten(self, place: Place, value: bytes) -> bool:
        """Whether it is what rotted there, or what is left of it, on whatever disk: its header alone."""
        remains = remains_of(memoryview(value))
        return value in self._values[place] or (remains is not None and is_husk(remains) and value == pack_record(remains))

    def _keys(self, place: Place, table: Mapping[bytes, bytes]) -> list[bytes]:
        """Where a record lies in a table: once at most if it has a place of its own."""
        if place.is_object:
            return sorted(key for key in table if place_of(key) == place)
        key = record_key(RecordPlace(SceneId(place.scene), SpaceId(place.space), Location(place.location)))
        return [key] if key in table else []

"""Strays come home: a copy that its place's owner does not have leaves a disk only once the owner has it, or a newer version.

A loss (custody.py) lets the versions that disks still hold come back, or not. This is what they must come back by: each is owed from
then on by the disk that holds it, until it leaves that disk. At this instant the owner must have it. Nothing is owed any more by a
disk that is replaced, of a place of which a copy has rotted, and once an owner has answered for the copy, whose disk may go later.
Where a newer version takes the place of one that is owed, on the very disk, that one is owed instead: what a lost owner had sent out
for its holders becomes durable there only afterwards.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from scenefold.base.location import Location
from scenefold.simulation import custody, laws
from scenefold.simulation.custody import Lost, is_held
from scenefold.simulation.disks import Disk, key_of_place, place_of, records_of, version_at
from scenefold.simulation.history import Place, Version
from scenefold.simulation.lies import STRAY, Lies, Manner
from scenefold.simulation.naming import is_newer
from scenefold.store.layout import RECORDS, SUSPECTS

Violated = Callable[[str, str, bytes, tuple[int, ...]], None]


class Homecoming:
    """What each disk owes to the owners of places. `owner_of`: the slot of a place's durable owner; `is_purged`: whether a key holder has this
    deletion purged, so that it may go, wherever it lies."""

    def __init__(
        self,
        disks: Mapping[int, Disk],
        owner_of: Callable[[Location], int | None],
        lies: Lies,
        violated: Violated,
        is_purged: Callable[[Place, Version], bool],
    ) -> None:
        self._disks = disks
        self._owner_of = owner_of
        self._lies = lies
        self._violated = violated
        self._is_purged = is_purged
        self._owed: dict[int, dict[Place, tuple[Version, bytes | None]]] = {slot: {} for slot in disks}
        """With the stored bytes, to notice at once that nothing has changed; None of what may lie under any key."""
        self._answered: dict[tuple[Place, Version], int] = {}
        """Strays that an owner has answered for, and its slot. Whoever brought one may delete its copy from then on."""
        self._rotten: set[Place] = set()

    def owes(self, losses: Iterable[Lost], counting: Mapping[int, custody.Disk]) -> None:
        """The owners of these places have lost them. `counting`: what lies on each disk, and is not about to be deleted rightly."""
        for place, *_ in losses:
            self._forget(place)
            for slot, disk in counting.items():
                version = disk.get(place)
                if version is not None:
                    self._owe(slot, place, version)

    def _owe(self, slot: int, place: Place, version: Version) -> None:
        if place not in self._rotten and self._answered.get((place, version), slot) == slot:
            self._owed[slot][place] = version, None if place.is_object else self._disks[slot].peek(RECORDS).get(key_of_place(place))

    def answered(self, slot: int, place: Place, version: Version) -> None:
        """The owner of a place has answered for a stray: from now on its own disk is what holds it."""
        self._answered[place, version] = slot
        for other, owed in self._owed.items():
            if other != slot and place in owed and owed[place][0] == version:
                del owed[place]

    def replaced(self, slot: int, before: custody.Disk, counting: Mapping[int, custody.Disk]) -> None:
        """A disk that held this is another now, and owes nothing. What was handed over to it, and is about to be deleted, went with it."""
        self._owed[slot].clear()
        for other, owed in self._owed.items():
            for place in [place for place in owed if place in before and not is_held(counting[other], place, owed[place][0])]:
                del owed[place]

    def rotted(self, place: Place) -> None:
        """A copy has rotted, on whichever disk: its node may still judge others by the version that it cannot show."""
        self._rotten.add(place)
        self._forget(place)

    def lied_about(self, place: Place) -> None:
        """In a handover, and the judge has entered a loss."""
        self._forget(place)

    def _forget(self, place: Place) -> None:
        for owed in self._owed.values():
            owed.pop(place, None)

    def committed(self, slot: int) -> None:
        """Something has become durable on a disk: whatever it owed and does not hold any more must have come home."""
        owed = self._owed[slot]
        if not owed:
            return
        table = self._disks[slot].peek(RECORDS)
        gone = [place for place, (_, value) in owed.items() if value is not None and table.get(key_of_place(place)) is not value]
        for place in gone:
            version, _ = owed[place]
            held = version_at(self._disks[slot], place, place.home)
            if held == version:
                continue
            del owed[place]
            if held is not None and is_newer(held, version) and not self._may_go(slot, place, version):
                self._owe(slot, place, held)
            else:
                self._judge(slot, place, version)

    def judge_rest(self) -> None:
        """Once nothing moves any more: node-managed records, which may lie anywhere."""
        for slot, owed in self._owed.items():
            if not owed:
                continue
            lies_there = records_of(self._disks[slot])
            for place, (version, _) in sorted(owed.items()):
                if lies_there.get(place) != version:
                    self._judge(slot, place, version)

    def _held_by_owner(self, place: Place) -> Version | None:
        owner = self._owner_of(place.home)
        if owner is None:
            return None
        disk = self._disks[owner]
        return records_of(disk).get(place) if place.is_object else version_at(disk, place, place.home)

    def _is_set_aside(self, slot: int, place: Place) -> bool:
        """Whether the disk's node keeps something of it apart, since it may be of before a purge: only a key holder puts that back."""
        return any(place_of(key) == place for key in self._disks[slot].peek(SUSPECTS))

    def _may_go(self, slot: int, place: Place, version: Version) -> bool:
        is_home = is_newer(self._held_by_owner(place), version)
        return is_home or self._is_purged(place, version) or self._is_set_aside(slot, place)

    def _judge(self, slot: int, place: Place, version: Version) -> None:
        if self._may_go(slot, place, version):
            return
        words = f"{version.digest.hex()[:6]} of {place.location.hex()[:8]}… leaves n{slot}, and its owner has neither that nor a newer one"
        if self._lies.is_lost(STRAY, place, version.digest):
            self._lies.report(place, Manner.LOST, words)
        else:
            self._violated(laws.BROUGHT_HOME, words, place.location, (slot,))

"""What the blacklists on true disks say, and have said lately: an owner may go by either for a while (specs/20-copies.md, Blacklists)."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from scenefold.base.ids import NodeId
from scenefold.base.prefixes import AddressPrefix
from scenefold.peer.membership.blacklist import NOTE, decode_blacklist
from scenefold.simulation.disks import Disk, note_on


def blacklist_of(disk: Disk) -> tuple[AddressPrefix, ...]:
    """What the node of this disk has written down last; nothing if it has not."""
    note = note_on(disk, NOTE)
    return decode_blacklist(note).prefixes if note else ()


class Blacklists:
    """Those of all machines, as seen at each of their commits."""

    def __init__(self, disks: Mapping[int, Disk], now: Callable[[], float]) -> None:
        self._disks = disks
        self._now = now
        self._notes: dict[int, bytes | None] = {}
        self._present: dict[int, tuple[AddressPrefix, ...]] = {}
        self._former: dict[int, dict[AddressPrefix, float]] = {}
        """What stands there no more, and until when it did."""

    def committed(self, slot: int) -> None:
        """Something has become durable on a disk, or it was replaced."""
        disk = self._disks[slot]
        note = note_on(disk, NOTE)
        if note == self._notes.get(slot):
            return
        before, self._notes[slot] = self._present.get(slot, ()), note
        self._present[slot] = blacklist_of(disk)
        self._former.setdefault(slot, {}).update((prefix, self._now()) for prefix in before if prefix not in self._present[slot])

    def may_forbid(self, slot: int, node: NodeId, seconds: float) -> bool:
        """Whether a node's blacklist covers another one, or did so within this time."""
        since, former = self._now() - seconds, self._former.get(slot, {})
        listed = [*self._present.get(slot, ()), *(prefix for prefix, until in former.items() if until >= since)]
        return any(prefix.covers(node) for prefix in listed)

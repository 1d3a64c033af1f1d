"""Where the newest version of every record lies, on the true disks, and when it may be gone (specs/17-simulation.md, Custody).

There is one copy for now. So when a disk is wiped, rolled back or damaged, or a removed node's arc is taken over by a
neighbour that never had its records, an acknowledged version is lost, or lost until its disk is offered again. That is the
only excuse for a record that cannot be read, and it is computed from what the disks hold, location by location. Pure.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from scenefold.simulation.history import Place, Version

Disk = Mapping[Place, Version]
"""Every record on one disk that can be read."""


class Lost(NamedTuple):
    """A place whose newest version does not count any more, and the versions that disks still hold."""

    place: Place
    left: tuple[Version, ...]
    newest: Version | None
    """None: not known, since it had rotted before."""
    or_nothing: bool = True
    """Whether nothing may be there from now on; else one of those that are left is."""


def newest(disks: Iterable[Disk], place: Place) -> Version | None:
    """The highest version of a record on any disk."""
    found = [disk[place] for disk in disks if place in disk]
    return max(found, default=None, key=lambda version: version.order)


def lost_by_change(before: Disk, counted: Mapping[int, Disk], after: Mapping[int, Disk]) -> list[Lost]:
    """What a disk that was wiped or rolled back took with it.

    `before`: that disk as it was. All disks as they are now: `counted`, with the records that will stay (not those that
    were given away and are about to be deleted), and `after`, with everything, since all of it may come back.
    """
    found = []
    for place, version in sorted(before.items()):
        best = newest(counted.values(), place)
        if best is None or best.order < version.order:
            found.append(Lost(place, versions_of(after, place), version))
    return found


def lost_to_claimer(disks: Mapping[int, Disk], claimer: int, places: Iterable[Place]) -> list[Lost]:
    """Places that a node took over without their newest version, which lies on another disk."""
    found = []
    for place in sorted(places):
        best, own = newest(disks.values(), place), disks[claimer].get(place)
        if best is not None and (own is None or own.order < best.order):
            found.append(Lost(place, versions_of(disks, place), best))
    return found


def versions_of(disks: Mapping[int, Disk], place: Place) -> tuple[Version, ...]:
    """The different versions of a record on all disks, oldest first."""
    found = {disk[place] for disk in disks.values() if place in disk}
    return tuple(sorted(found, key=lambda version: version.order))


def is_held(disk: Disk, place: Place, version: Version | None) -> bool:
    """Whether a disk holds this version of a record, or a newer one."""
    held = disk.get(place)
    return held is not None and version is not None and held.order >= version.order

"""What must hold when a node is about to answer that a record is stored (specs/17-simulation.md, Laws)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

from scenefold.base.location import Location
from scenefold.simulation import laws
from scenefold.simulation.disks import Disk, arc_of, version_at
from scenefold.simulation.history import Place, Version


class Owner(Protocol):
    """What the observer asks of a running node."""

    def owns(self, location: Location) -> bool: ...

    def has_lease(self) -> bool: ...


@dataclass(frozen=True, slots=True)
class Answer:
    """By whom, of what, and where it lies. `is_replaced`: the disk is a backup of what it was; `has_rotted`: just this copy did."""

    slot: int
    place: Place
    version: Version
    location: Location
    is_replaced: bool
    has_rotted: bool


Problem = tuple[str, str, tuple[int, ...]]
"""A law that is broken, in words, and by which slots."""


def problems_of(answer: Answer, disk: Disk, elsewhere: Callable[[], Version | None], running: Mapping[int, Owner]) -> Iterator[Problem]:
    """What is wrong with it. `elsewhere`: finds the version of the record, wherever it lies on the disk."""
    slot, home = answer.slot, answer.place.home
    node = running.get(slot)
    name = f"{answer.location.hex()[:8]}… {answer.version.digest.hex()[:6]}"
    if node is not None and not (node.owns(home) and node.has_lease()):
        what = "has no lease" if node.owns(home) else "does not own it"
        yield laws.RIGHT_TO_ANSWER, f"n{slot} acknowledges {name} and {what}", (slot,)
    if answer.is_replaced:
        yield laws.RIGHT_TO_ANSWER, f"n{slot} acknowledges {name}, and its disk is a backup of what it was", (slot,)
    arc = arc_of(disk)
    if arc is None or home not in arc:
        yield laws.RIGHT_TO_ANSWER, f"n{slot} acknowledges {name} outside of its durable arc", (slot,)
    # A stray of which the owner has another copy, elsewhere in its arc, is acknowledged for that one.
    stored = version_at(disk, answer.place, answer.location) or elsewhere()
    # What rotted between the commit and the answer was durable, and its loss stands in its history already.
    has_rotted = stored is None and answer.has_rotted
    if not has_rotted and (stored is None or stored.order < answer.version.order):
        yield laws.DURABLE, f"n{slot} acknowledges {name}, which its disk does not hold", (slot,)
    for other, owner in running.items():
        if other != slot and owner.owns(home) and owner.has_lease():
            yield laws.ONE_OWNER, f"n{slot} acknowledges {name} while n{other} could", (slot, other)

"""How a run keeps copies, drawn from its seed: how many, how many of them before a write counts, and in which racks nodes stand. Pure.

By default a run keeps none. With them clients work in a pair of spaces that have copies beside the pair that has one of each
record, so whatever holds of single copies goes on being tested. Racks are prefixes of addresses, and each node's own one is on its blacklist.
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from scenefold.base.ids import NodeId, SpaceId, node_id_of
from scenefold.base.location import LINE_LENGTH, Arc, Location
from scenefold.base.prefixes import AddressPrefix, forbids

KEPT, KEPT_OBJECTS = SpaceId(1001), SpaceId(1002)
"""Spaces with copies: records with places of their own, and records that the nodes place. Far from the numbers of shadows."""
KEPT_NAMES = {KEPT: "kept", KEPT_OBJECTS: "kept objects"}

_COUNTS = {(3, 2): 5, (2, 2): 2, (3, 1): 1, (3, 3): 1}
"""Copies, and those that must be there; and how often, of all seeds."""
_RACKS = {0: 2, 2: 1, 3: 2}
"""How many racks, and how often. 0: nodes stand anywhere, and nobody has a blacklist."""


@dataclass(frozen=True, slots=True)
class Copying:
    """One run's way of keeping copies."""

    copies: int
    least: int
    racks: int

    def prefix_of(self, slot: int) -> str:
        """What a node's blacklist says: the prefix of its own rack, "" if there are no racks."""
        return f"10.{rack_of(slot, self.racks) + 1}.0.0/16" if self.racks else ""

    def __str__(self) -> str:
        racks = f", nodes in {self.racks} racks" if self.racks else ""
        return f"{self.copies} copies, {self.least} of them before a write counts{racks}"


def draw_copying(seed: int) -> Copying:
    """That of a seed."""
    dice = random.Random(f"copies/{seed}")
    ((copies, least),) = dice.choices(list(_COUNTS), list(_COUNTS.values()))
    (racks,) = dice.choices(list(_RACKS), list(_RACKS.values()))
    return Copying(copies, least, racks)


def address_of_slot(slot: int, racks: int = 0) -> str:
    """The address of a machine."""
    room = rack_of(slot, racks) + 1 if racks else 0
    return f"10.{room}.{(slot + 1) >> 8}.{(slot + 1) & 255}"


def node_of_slot(slot: int, racks: int = 0) -> NodeId:
    """The id of its node."""
    return node_id_of(address_of_slot(slot, racks))


def rack_of(slot: int, racks: int) -> int:
    """In which rack a machine stands."""
    return slot % racks


def rack(number: int, racks: int, nodes: int) -> tuple[int, ...]:
    """The founders in one rack."""
    return tuple(slot for slot in range(nodes) if rack_of(slot, racks) == number)


class Rule(NamedTuple):
    """What holds for the records of one space. `needed`: so many disks before a write counts, the owner's among them."""

    layout: tuple[Location, ...]
    needed: int


def holders(
    rule: Rule,
    home: Location,
    owner: NodeId,
    arcs: Mapping[NodeId, Arc],
    forbidden: Iterable[AddressPrefix],
    waiting: Iterable[NodeId] = (),
) -> tuple[NodeId, ...]:
    """Who is to hold copies of what lies at a place, word for word as Algorithm 7 says it, and not as nodes compute it.

    `waiting`: who has no arc yet. They come last, and only as far as a write needs them.
    """
    prefixes, taken = tuple(forbidden), list[NodeId]()
    for offset in rule.layout:
        copy = (home.number + offset.number) % LINE_LENGTH
        allowed = [node for node in arcs if node not in taken and not forbids(prefixes, node, owner=owner)]
        if not allowed:
            break
        taken.append(min(allowed, key=lambda node: (_distance(arcs[node], copy), node)))
    beside = [node for node in sorted(waiting) if not forbids(prefixes, node, owner=owner)]
    return (*taken, *beside[: max(0, min(rule.needed - 1, len(rule.layout)) - len(taken))])


def _distance(arc: Arc, place: int) -> int:
    """How far a place is from an arc, around the line; 0 inside of it."""
    if arc.first.number <= place <= arc.last.number:
        return 0
    return min((arc.first.number - place) % LINE_LENGTH, (place - arc.last.number) % LINE_LENGTH)

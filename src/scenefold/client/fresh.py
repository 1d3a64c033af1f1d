"""Records that overwrite nothing: an importer's atoms at the curve index of their centre, or the next free place.

Each record asks for a place that must be empty. If something lies there, it is looked at: an equal payload is
what an interrupted import left behind, and is kept in its stead; anything else makes the record step on along
the line. So an import can be repeated, does not grow the store, and never harms what is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from scenefold.base.ids import NodeId, SpaceId
from scenefold.base.location import Location
from scenefold.client.access import SceneAccess, Wish
from scenefold.client.free_places import FreePlaces
from scenefold.wire import EXPECT_ABSENT


class FreshItem(NamedTuple):
    """A payload and the place that it would like."""

    space: SpaceId
    wanted: Location
    payload: bytes


class Stored(NamedTuple):
    """Where an item lies now; `reused` if an equal record lay there already."""

    location: Location
    node: NodeId
    reused: bool


async def put_fresh(access: SceneAccess, items: Sequence[FreshItem], places: FreePlaces | None = None) -> list[Stored]:
    """Store all items at free places and say where. `places` remembers what one import gave out, over many calls."""
    places = FreePlaces() if places is None else places
    asked = [places.take(item.space, item.wanted) for item in items]
    stored: list[Stored | None] = [None] * len(items)
    pending = list(range(len(items)))
    while pending:
        wishes = [Wish(items[index].space, asked[index], items[index].payload, EXPECT_ABSENT) for index in pending]
        taken: list[int] = []
        placed = await access.put(wishes, fresh=True)
        for index, outcome in zip(pending, placed, strict=True):
            if outcome.reason:
                taken.append(index)
            else:
                stored[index] = Stored(asked[index], outcome.node, reused=False)
        pending = []
        if not taken:
            break
        nodes = dict(zip(taken, (outcome.node for outcome in placed if outcome.reason), strict=True))
        there = await access.get([(items[index].space, asked[index]) for index in taken])
        for index, found in zip(taken, there, strict=True):
            if found is not None and found.payload == items[index].payload:
                stored[index] = Stored(asked[index], nodes[index], reused=True)
            else:
                # Each step takes one more of the bounded number of places, so this ends.
                asked[index] = places.take(items[index].space, items[index].wanted)
                pending.append(index)
    return [item for item in stored if item is not None]

"""Records that overwrite nothing: an importer's atoms at the curve index of their centre, or the next free place.

Each record asks for a place that must be empty. If something lies there, it is looked at: an equal payload is
what an interrupted import left behind, and is kept in its stead; a deleted record is replaced, if no equal one lies in the run
behind it; anything else makes the record step on along the line. So an import can be repeated, does not grow the store, and
never harms what is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId, SpaceId
from scenefold.base.location import Location
from scenefold.client.access import SceneAccess
from scenefold.client.free_places import FreePlaces
from scenefold.client.runs import run_behind
from scenefold.client.sealing import Opened
from scenefold.client.wholes import wholes
from scenefold.client.wishes import Wish
from scenefold.crypto import EXPECTS_NOTHING
from scenefold.scene.payloads.splits import decode_entry, digest_of, is_split

_LOOK = 256
"""Records of a run that are read together."""


class FreshItem(NamedTuple):
    """A payload and the place that it would like."""

    space: SpaceId
    wanted: Location
    payload: bytes
    content_position: int | None = None
    """As in Wish."""


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
    expected = [EXPECTS_NOTHING] * len(items)
    pending = list(range(len(items)))
    while pending:
        wishes = [
            Wish(items[index].space, asked[index], items[index].payload, expected[index], items[index].content_position)
            for index in pending
        ]
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
            if await _is_equal(access, items[index], asked[index], found):
                stored[index] = Stored(asked[index], nodes[index], reused=True)
                continue
            if found is not None and found.deleted and expected[index] != found.digest:
                equal = await _equal_behind(access, items[index], asked[index], places)
                if equal is not None:
                    stored[index] = Stored(equal, nodes[index], reused=True)
                    continue
                expected[index] = found.digest
            else:
                # Each step takes one more of the bounded number of places, so this ends.
                asked[index] = places.take(items[index].space, items[index].wanted)
                expected[index] = EXPECTS_NOTHING
            pending.append(index)
    return [item for item in stored if item is not None]


async def _equal_behind(access: SceneAccess, item: FreshItem, place: Location, places: FreePlaces) -> Location | None:
    """Where in the run behind a place an equal record lies that nobody of this import has: it stepped over what is deleted now."""
    batch: list[Location] = []
    async for location in run_behind(access, item.space, place):
        batch.append(location)
        if len(batch) == _LOOK:
            if (equal := await _equal_among(access, item, batch, places)) is not None:
                return equal
            batch = []
    return await _equal_among(access, item, batch, places)


async def _equal_among(access: SceneAccess, item: FreshItem, batch: Sequence[Location], places: FreePlaces) -> Location | None:
    there = await access.get([(item.space, location) for location in batch])
    for location, found in zip(batch, there, strict=True):
        if await _is_equal(access, item, location, found) and places.claim(item.space, location):
            return location
    return None


async def _is_equal(access: SceneAccess, item: FreshItem, place: Location, found: Opened | None) -> bool:
    """Whether a record says what the item says, also one that was split since. One that lacks a part does not."""
    if found is None or not is_split(found.payload):
        return found is not None and found.payload == item.payload
    try:
        if decode_entry(found.payload).digest != digest_of(item.payload):
            return False
        (whole,) = await wholes([found], [(item.space, place)], access.get, access.in_crypto_lane)
    except DamagedData:
        return False
    return whole is not None and whole.payload == item.payload

"""Parts of split records, and whether anybody needs them (specs/18-data.md, Splitting and merging).

A part says which version of which record it was made from. That is all it takes: once the record there is newer and does not name it,
nobody ever will.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import Enum

from scenefold.base.errors import DamagedData
from scenefold.base.ids import SpaceId
from scenefold.base.location import Location
from scenefold.client.access import SceneAccess
from scenefold.client.sealing import Opened
from scenefold.client.verifying import Key
from scenefold.client.wishes import Wish
from scenefold.scene.payloads.splits import Part, decode_entry, decode_part, is_part, is_split

_STORED = 0


class Standing(Enum):
    """What a part is."""

    IN_USE = "in use"
    PENDING = "pending"
    LEFT_OVER = "left over"
    ORPHANED = "orphaned"
    UNCLEAR = "unclear"
    """Its entry point cannot be read, or an older version of it was shown than the part was made from."""


def standing_of(part: Part, at: Location, payload: bytes, entry: Opened | DamagedData | None, genesis: bytes) -> Standing:
    """That of a part with this payload that lies at `at`; `entry`: what lies at its entry point, `genesis`: the scene's. Pure."""
    if isinstance(entry, DamagedData):
        return Standing.UNCLEAR
    if entry is None:
        return Standing.ORPHANED
    try:
        named = is_split(entry.payload) and decode_entry(entry.payload).names(at, payload)
    except DamagedData:
        return Standing.UNCLEAR
    if named:
        return Standing.IN_USE
    if part.genesis != genesis or entry.version > part.made_from:
        return Standing.LEFT_OVER
    return Standing.PENDING if entry.version == part.made_from else Standing.UNCLEAR


def part_in(found: Opened | DamagedData | None) -> Part | None:
    """The part that a record is; None if it is none, or an ill-formed one."""
    if found is None or isinstance(found, DamagedData) or not is_part(found.payload):
        return None
    try:
        return decode_part(found.payload)
    except DamagedData:
        return None


async def remove(access: SceneAccess, space: SpaceId, parts: Mapping[Location, Opened]) -> int:
    """Delete these records, if they are still what was read; how many were."""
    wishes = [Wish(space, at, access.tombstone((space, at)), found.digest, found.content_position) for at, found in parts.items()]
    placed = await access.put(wishes) if wishes else []
    return sum(outcome.reason == _STORED for outcome in placed)


async def remove_leftovers(access: SceneAccess, space: SpaceId, places: Sequence[Location]) -> int:
    """Delete those of the parts at these places that are left over; how many. What cannot be read is left for a walk to tell."""
    if not places:
        return 0
    keys: list[Key] = [(space, place) for place in places]
    found = dict(zip(places, await access.get(keys), strict=True))
    parts = {at: (one, part) for at, one in found.items() if one is not None and (part := part_in(one)) is not None}
    entries = list({part.entry for _, part in parts.values()})
    there = dict(zip(entries, await access.get([(space, entry) for entry in entries]), strict=True)) if entries else {}
    genesis = access.identity.genesis
    dead = {
        at: one for at, (one, part) in parts.items() if standing_of(part, at, one.payload, there[part.entry], genesis) is Standing.LEFT_OVER
    }
    return await remove(access, space, dead)

"""Records whose place the nodes choose (thesis B.3: node-managed spaces; specs/10-store.md, Node-managed spaces).

A record has a random id instead of a place. The id says which node decides about it: the owner of the place that it names as the
beginning of a location. That node chooses where in its arc the record lies, and answers with it; a range query finds it again
there. As bounds move, the record slides or goes along, so a place may grow old; the id does not, and is all that reading,
replacing and deleting go by.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from typing import NamedTuple

from scenefold.base.ids import SpaceId
from scenefold.base.location import FIRST, LAST, Location
from scenefold.client.access import SceneAccess
from scenefold.client.living import alive
from scenefold.client.sealing import payload_of
from scenefold.client.verifying import Key
from scenefold.client.wishes import Wish
from scenefold.crypto import EXPECTS_NOTHING, OBJECT_BYTES, signed_place


class ManagedPlace(NamedTuple):
    """Where a record lies, or lay, and its object id, which stays, and by which it is found."""

    location: Location
    object: bytes


class ManagedStored(NamedTuple):
    """A stored record; `digest` is what a later `expect` may name."""

    place: ManagedPlace
    digest: bytes


class ManagedRecords:
    """One node-managed space. Made by `Space.managed`."""

    def __init__(self, access: SceneAccess, space_id: SpaceId) -> None:
        self._access = access
        self._space = space_id

    async def put(self, payload: bytes) -> ManagedStored:
        """Store a new record; durable when this returns."""
        object_id = self._access.calls.world.entropy.token(OBJECT_BYTES)
        return await self._put(object_id, payload, EXPECTS_NOTHING)

    async def replace(self, place: ManagedPlace, payload: bytes, *, expect: bytes | None = None) -> ManagedStored:
        """Store a new version of a record. Refused with STALE_VERSION if `expect`, a digest, is not what is there."""
        return await self._put(place.object, payload, expect)

    async def delete(self, place: ManagedPlace, *, expect: bytes | None = None) -> bytes:
        """Replace a record by one that says that it is deleted; gives the digest of that."""
        return (await self._put(place.object, self._access.tombstone(self._key(place)), expect)).digest

    async def get(self, places: Sequence[ManagedPlace], *, stale_ok: bool = False) -> list[bytes | None]:
        """The payloads, in order; None for one that is deleted, or not there (any more)."""
        keys = [self._key(place) for place in places]
        return [payload_of(found) for found in await self._access.get(keys, stale_ok=stale_ok)]

    async def query(
        self, first: Location = FIRST, last: Location = LAST, *, deleted: bool = False, stale_ok: bool = False
    ) -> AsyncIterator[ManagedPlace]:
        """Records between two places, both included, in the order of the line. `deleted`: those that were deleted, too.

        One that slides while this goes on may be given twice, or be missed.
        """
        found = self._entries(first, last, stale_ok)
        async for place in found if deleted else alive(self._access, found, self._key, stale_ok=stale_ok):
            yield place

    async def _entries(self, first: Location, last: Location, stale_ok: bool) -> AsyncIterator[ManagedPlace]:
        async for location, object_id in self._access.entries(self._space, first, last, stale_ok=stale_ok):
            if object_id:
                yield ManagedPlace(location, object_id)

    def _key(self, place: ManagedPlace) -> Key:
        return self._space, place.location, place.object

    async def _put(self, object_id: bytes, payload: bytes, expect: bytes | None) -> ManagedStored:
        wish = Wish(self._space, signed_place(object_id), payload, expect, object=object_id)
        placed = await self._access.put_one(wish)
        return ManagedStored(ManagedPlace(placed.location, object_id), placed.digest)

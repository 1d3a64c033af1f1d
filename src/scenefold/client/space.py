"""A space of a scene: records by location, as the user of the client sees them."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterable, Sequence

from scenefold.base.errors import Refused
from scenefold.base.ids import SpaceId
from scenefold.base.limits import CLIENT_FRAME_BYTES, CLIENT_FRAMES_IN_FLIGHT
from scenefold.base.location import FIRST, LAST, Location
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess, Wish
from scenefold.client.fresh import FreshItem, put_fresh
from scenefold.wire import EXPECT_ABSENT

ABSENT = EXPECT_ABSENT
"""As `expect`: the place must be empty."""

_BATCH_BYTES = CLIENT_FRAME_BYTES * CLIENT_FRAMES_IN_FLIGHT
_GET_BATCH = 4096


class Space:
    """Records of one space. Payloads are bytes of up to 60 KiB; they are encrypted before they leave this process."""

    def __init__(self, access: SceneAccess, space_id: SpaceId) -> None:
        self.id = space_id
        self._access = access

    async def put(self, location: Location, payload: bytes, *, expect: bytes | None = None) -> bytes:
        """Store a record; durable when this returns. Gives the digest that a later `expect` may name.

        `expect`: None replaces whatever is there, ABSENT wants the place empty, a digest wants that very version
        there. Refused with STALE_VERSION if it is not so.
        """
        placed = (await self._access.put([Wish(self.id, location, payload, expect)]))[0]
        if placed.reason == RejectReason.STALE_VERSION:
            what = "there is a record already" if expect == ABSENT else "another version is there"
            where = f"scene {self._access.name}, space {self.id}, {location.hex()}"
            raise Refused(RejectReason.STALE_VERSION, what, where=where, remedy="read it, then decide")
        return placed.digest

    async def put_many(self, items: Iterable[tuple[Location, bytes]]) -> None:
        """Store many records, replacing what is there; all are durable when this returns.

        In parallel to all owners; of several payloads for one place the last one stays. If it raises, some may be stored: putting them again is safe.
        """
        batch: dict[Location, Wish] = {}
        size = 0
        for location, payload in items:
            # Frames of one call overtake each other, so each place is in it once: the last of its payloads counts.
            batch[location] = Wish(self.id, location, payload)
            size += len(payload)
            if size >= _BATCH_BYTES:
                await self._access.put(list(batch.values()))
                batch, size = {}, 0
        if batch:
            await self._access.put(list(batch.values()))

    async def put_fresh(self, items: Sequence[tuple[Location, bytes]]) -> list[Location]:
        """Store records at free places, at the wanted ones or next along the line; gives where they are."""
        fresh = [FreshItem(self.id, location, payload) for location, payload in items]
        return [stored.location for stored in await put_fresh(self._access, fresh)]

    async def get(self, location: Location) -> bytes | None:
        """The payload at a location, verified; None if the owner says that nothing is there."""
        return (await self.get_many([location]))[0]

    async def get_many(self, locations: Sequence[Location]) -> list[bytes | None]:
        """The payloads at many locations, in their order, fetched in parallel from all owners."""
        payloads: list[bytes | None] = []
        for start in range(0, len(locations), _GET_BATCH):
            keys = [(self.id, location) for location in locations[start : start + _GET_BATCH]]
            payloads += [None if found is None else found.payload for found in await self._access.get(keys)]
        return payloads

    def query(self, first: Location = FIRST, last: Location = LAST) -> AsyncIterator[Location]:
        """Locations that hold records, from `first` to `last`, both included, in the order of the line."""
        return self._access.locations(self.id, first, last)

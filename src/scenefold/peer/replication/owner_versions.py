"""What an owner says of which version lies at its places (specs/20-copies.md, Reads): its word is worth as much as a record would be.

A reader who has it may take the bytes from anybody. So all is looked at that is looked at before a record is told: the arc, the lease, that
all was recovered there, and that nothing of it is unsettled.
"""

from __future__ import annotations

from collections.abc import Sequence

import trio

from scenefold.base.errors import DamagedData
from scenefold.crypto import Record
from scenefold.peer.holdings import LOOKS_MAX, Known
from scenefold.peer.line.parts import Parts
from scenefold.peer.records.copying import TOLD_S_MAX, Copying
from scenefold.store import Spot

Told = Record | DamagedData | None
"""A record of which only the header is there, what is left of one, or nothing."""


class OwnerVersions:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts, copying: Copying, known: Known) -> None:
        self._parts = parts
        self._copying = copying
        self._known = known

    async def told(self, spots: Sequence[Spot]) -> dict[Spot, Told]:
        """What lies at those of the spots that this node may speak for now; nothing of any as long as one of them is unsettled."""
        keeper, until = self._parts.keeper, trio.current_time() + TOLD_S_MAX
        own = [spot for spot in spots if keeper.holding.owns(spot.home)]
        if not own:
            return {}
        await self._known.look_up([spot.home for spot in own], until)
        for _ in range(LOOKS_MAX):
            arc = keeper.holding.arc
            known = {spot for spot in own if self._known.is_known(spot.home)}
            found = await self._found(own)
            is_settled = await self._copying.records_settled(own, found, until)
            if keeper.holding.arc is arc:
                break
        else:
            return {}
        if not (is_settled and self._parts.lease.holds()):
            return {}
        return {spot: one for spot, one in zip(own, found, strict=True) if spot in known and keeper.holding.owns(spot.home)}

    async def _found(self, spots: Sequence[Spot]) -> list[Told]:
        """By headers alone. What has no sound one is looked at as a whole: nothing may be there, or something that has rotted."""
        store = self._parts.store
        headers = await store.record_headers(spots)
        others = iter(await store.read([spot for spot, header in zip(spots, headers, strict=True) if header is None]))
        return [next(others) if header is None else Record(header, b"", b"") for header in headers]

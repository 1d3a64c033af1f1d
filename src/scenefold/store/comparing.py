"""What nodes that hold copies ask their stores for, so as to compare them (specs/10-store.md, Digests; 20-copies.md)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Arc
from scenefold.store.changes import RestartDigests
from scenefold.store.digest_sums import Listing, read_listing, read_spaces, read_sums
from scenefold.store.digest_tree import TreeDamaged
from scenefold.store.held import HeldPage, read_held
from scenefold.store.layout import SpaceAddress, Spot
from scenefold.store.noticing import Noticed
from scenefold.store.opened import OpenedStore
from scenefold.store.versions import RangeSum


class ComparingStore(OpenedStore):
    """The part of the store that knows sums. All of it goes by the homes of records, wherever objects lie.

    A record whose header has rotted is in no sum and no list. So it is noticed here: who compares would else find nothing amiss.
    """

    noticed: Noticed

    async def spaces(self) -> list[SpaceAddress]:
        """Where there are records as of the last commit, in order."""
        return sorted(space for space, counts in self._writer.counts.items() if counts.records)

    async def spaces_in(self, arc: Arc) -> list[SpaceAddress]:
        """Likewise, where there are records with their homes in the arc. Some us a space."""
        spaces = await self.spaces()
        return await self._view(read_spaces, spaces, arc) if spaces else []

    async def sums(self, scene: SceneId, space: SpaceId, arcs: Sequence[Arc]) -> list[RangeSum]:
        """How many records have their homes in each arc, and the sum of their versions. Some tenths of a ms an arc, without a walk over it.

        A damaged tree is made anew; until then what it does not have yet is counted, some 5 us a record.
        """
        try:
            found = await self._view(read_sums, (scene, space), arcs)
        except TreeDamaged as damage:
            await self._writer.submit(RestartDigests(damage.space, str(damage)))
            found = await self._view(read_sums, (scene, space), arcs)
        self._notice(found.wrecks)
        return found.sums

    async def listing(self, scene: SceneId, space: SpaceId, arc: Arc, limit: int) -> Listing:
        """The first `limit` >= 2 records with their homes in the arc, in the order of these, and which versions they are."""
        assert limit >= 2
        found = await self._view(read_listing, (scene, space), arc, limit)
        self._notice(held.spot for held in found.records if not held.version)
        return found

    def _notice(self, wrecks: Iterable[Spot]) -> None:
        for spot in wrecks:
            self.noticed.wreck(spot)

    async def held(self, arc: Arc, after: bytes, limit: int) -> HeldPage:
        """The first `limit` >= 1 records of all spaces with their homes in the arc, behind the cursor `after` (b"": from the first on)."""
        assert limit >= 1
        return await self._view(read_held, arc, after, limit)

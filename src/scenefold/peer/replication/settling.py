"""Whoever would tell of what is unsettled waits for a moment (specs/20-copies.md, Writes)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import trio

from scenefold.base.errors import DamagedData
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Arc
from scenefold.crypto import Record
from scenefold.peer.copies.placement import Layout
from scenefold.peer.line.unsettled import Pending, Unsettled, first_unsettled, name_of
from scenefold.store import Spot
from scenefold.store.versions import version_of


class Settled:
    """Used from the Trio thread only."""

    def __init__(self, unsettled: Unsettled, layout_of: Callable[[SceneId, SpaceId], Layout | None]) -> None:
        self._unsettled = unsettled
        self._layout_of = layout_of

    async def records(self, spots: Sequence[Spot], found: Sequence[Record | DamagedData | None], until: float) -> bool:
        """Whether these records, which were just read there, may be told; waits for that.

        What is read was registered before it was stored. So what is not pending now is settled, and what settles later, or is
        replaced by something that does, was nobody's before: the question was asked before.
        """
        if self._unsettled.is_quiet:
            return True
        pendings: list[Pending] = []
        for spot, record in zip(spots, found, strict=True):
            others = self._unsettled.of(name_of(spot))
            if others and isinstance(record, Record):
                version = version_of(record.header_bytes)
                pendings += [pending for pending in others if pending.version == version]
        if await first_unsettled(pendings, until) is not None:
            return False
        places = [(spot.place.scene, spot.place.space, Arc(spot.home, spot.home)) for spot, one in zip(spots, found, strict=True) if one]
        return await self._undoubted(places, until)

    async def listed(self, scene: SceneId, space: SpaceId, arc: Arc, until: float) -> bool:
        """Whether a list of this part of the arc, which was just made, may be told; waits for that."""
        if self._unsettled.is_quiet:
            return True
        if await first_unsettled(self._unsettled.listed(scene, space, arc), until) is not None:
            return False
        return await self._undoubted([(scene, space, arc)], until)

    async def _undoubted(self, places: Sequence[tuple[SceneId, SpaceId, Arc]], until: float) -> bool:
        doubted = [(self._layout_of(scene, space), arc) for scene, space, arc in places]

        def is_over() -> bool:
            return not any(layout and self._unsettled.is_doubted(layout, arc) for layout, arc in doubted)

        with trio.CancelScope(deadline=until):
            await self._unsettled.until(is_over)
        return is_over()

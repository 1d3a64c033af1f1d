"""Whoever would tell of what is unsettled waits for a moment (specs/20-copies.md, Writes)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from types import MappingProxyType

import trio

from scenefold.base.errors import DamagedData
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Arc
from scenefold.crypto import Record
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.unsettled import Pending, first_unsettled, name_of
from scenefold.peer.replication.judging import Judging
from scenefold.peer.replication.sending_again import Place, SendingAgain, place_of
from scenefold.store import Spot
from scenefold.store.versions import version_of
from scenefold.world import first_of


class Settled:
    """Used from the Trio thread only. Times are Trio's."""

    def __init__(self, parts: Parts, judging: Judging) -> None:
        self._store = parts.store
        self._unsettled = parts.unsettled
        self._judging = judging
        self._again = SendingAgain(parts, judging)

    async def records(self, spots: Sequence[Spot], found: Sequence[Record | DamagedData | None], until: float) -> bool:
        """Whether these records, which were just read there, may be told; waits for that.

        What is read was registered before it was stored. So what is not pending now is settled, and what settles later, or is
        replaced by something that does, was nobody's before: the question was asked before.
        """
        if self._unsettled.is_quiet:
            return True
        here = [(spot, record) for spot, record in zip(spots, found, strict=True) if isinstance(record, Record)]
        if not self._unsettled.is_read and await self._owe([spot for spot, _ in here]) and not await self._read_before(until):
            return False
        if await first_unsettled(self._pending(here), until) is not None:
            return False
        if not self._unsettled.doubts:
            return True
        self._judging.doubt_turned()
        return await self._undoubted([place_of(spot) for spot, _ in here], until, await self._again.send(here))

    async def place(self, spot: Spot, until: float) -> bool:
        """Whether it may be told that something lies there, as it was just found; waits for that."""
        if self._unsettled.is_quiet:
            return True
        if not self._unsettled.is_read and await self._owe([spot]) and not await self._read_before(until):
            return False
        if await first_unsettled(self._unsettled.of(name_of(spot)), until) is not None:
            return False
        return await self._undoubted([place_of(spot)], until)

    async def listed(self, scene: SceneId, space: SpaceId, arc: Arc, until: float) -> bool:
        """Whether a list of this part of the arc, which was just made, may be told; waits for that."""
        if self._unsettled.is_quiet:
            return True
        if not self._unsettled.is_read and self._judging.layout_of(scene, space) and not await self._read_before(until):
            return False
        for page in self._unsettled.listed(scene, space, arc):
            if await first_unsettled(page, until) is not None:
                return False
            await trio.lowlevel.checkpoint()
        return await self._undoubted([(scene, space, arc)], until)

    async def _owe(self, spots: Sequence[Spot]) -> bool:
        """Whether any of this is owed to anybody: then it may be unsettled since before the start."""
        return any(await self._store.debtors_of(spots))

    async def _read_before(self, until: float) -> bool:
        """Whether what was owed at the start is looked through by then: what of it is unsettled is pending from then on."""
        with trio.CancelScope(deadline=until):
            await self._unsettled.until(lambda: self._unsettled.is_read)
        return self._unsettled.is_read

    def _pending(self, here: Sequence[tuple[Spot, Record]]) -> list[Pending]:
        found: list[Pending] = []
        for spot, record in here:
            others = self._unsettled.of(name_of(spot))
            if others:
                version = version_of(record.header_bytes)
                found += [pending for pending in others if pending.version == version]
        return found

    async def _undoubted(self, places: Sequence[Place], until: float, sent: Mapping[Place, Pending | None] = MappingProxyType({})) -> bool:
        """Whether nothing there is doubted; waits for that. Of `sent` it is enough that they settle by themselves."""
        if not self._unsettled.doubts:
            return True
        self._judging.doubt_turned()
        doubted = [(self._judging.layout_of(scene, space), arc) for scene, space, arc in places]
        alone = [(layout, place) for (layout, _), place in zip(doubted, places, strict=True) if place not in sent]

        def is_over() -> bool:
            return not any(layout is not None and self._unsettled.is_doubted(layout, arc) for layout, arc in doubted)

        def are_others_over() -> bool:
            return not any(layout is not None and self._unsettled.is_doubted(layout, arc) for layout, (_, _, arc) in alone)

        async def settle() -> None:
            await first_unsettled([pending for pending in sent.values() if pending is not None], until)
            await self._unsettled.until(are_others_over)

        with trio.CancelScope(deadline=until):
            await first_of(settle, partial(self._unsettled.until, is_over))
        settled = all(pending is None or pending.is_settled for pending in sent.values())
        return is_over() or (settled and are_others_over())

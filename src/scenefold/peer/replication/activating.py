"""A change of holders ends: the new configuration answers from now on (specs/20-copies.md, Changing).

What is acknowledged once all new holders are complete lies with enough of them as well (settling_rule.py). So what is owed is looked up
after that, and whatever is acknowledged during the look, or behind it, is safe without being looked up.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

import trio

from scenefold.base.errors import Refused
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.segment import Segment
from scenefold.peer.line.parts import Parts
from scenefold.store.debts import Debt
from scenefold.wire import Member

DEBTS_PAGE = 1_024
AGAIN_S = 1.0
"""Between two looks at debts that are being paid."""

_log = logging.getLogger("scenefold.peer.replication")


class Activating:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts

    async def run(self) -> None:
        """End what is ready until cancelled."""
        keeper = self._parts.keeper
        while True:
            seen = keeper.copies
            ready = [segment for segment in seen.configurations.segments if segment.can_activate(())]
            if ready:
                try:
                    await self._activate(ready)
                except Refused as refusal:
                    _log.debug("holders are made active later: %s", refusal)
            with trio.move_on_after(AGAIN_S if ready else float("inf")):
                await keeper.copies_changed_after(seen)

    async def _activate(self, ready: Sequence[Segment]) -> None:
        owed = await self._owed(ready)
        before = self._parts.keeper.copies
        after = await self._parts.keeper.change_copies(lambda copies, _holding: activated(copies, owed))
        self._parts.events["configurations"] += after is not before

    async def _owed(self, ready: Sequence[Segment]) -> dict[Segment, set[frozenset[Member]]]:
        """Of each record that is owed to new holders of these segments, to whom."""
        found: dict[Segment, set[frozenset[Member]]] = {segment: set() for segment in ready}
        new = {holder.node for segment in ready if segment.change is not None for holder in segment.change.holders}
        after: bytes | None = None
        while not new.isdisjoint(self._parts.store.owed):
            page = await self._parts.store.debts(after, DEBTS_PAGE)
            for debt in page.debts:
                self._note(debt, found)
            after = page.after
            if after is None:
                break
        return found

    def _note(self, debt: Debt, found: dict[Segment, set[frozenset[Member]]]) -> None:
        place, home = debt.spot.place, debt.spot.home
        layouts = [scene.layouts.get(place.space) for scene in self._parts.scenes.everyone() if scene.public.scene == place.scene]
        for segment, owed in found.items():
            if segment.change is not None and segment.layout in layouts and home in segment.arc:
                owed.add(frozenset(holder for holder in segment.change.holders if holder.node in debt.nodes))


def activated(copies: Copies, owed: dict[Segment, set[frozenset[Member]]]) -> Copies:
    """With what is ready, unless it is not what was looked at. `owed`: by the segments as they were then."""

    def debts(segment: Segment) -> Iterable[Collection[Member]] | None:
        return next((found for seen, found in owed.items() if _is_still(segment, seen)), None)

    configurations = copies.configurations.activate(debts)
    return copies if configurations is copies.configurations else replace(copies, configurations=configurations)


def _is_still(segment: Segment, seen: Segment) -> bool:
    """Whether the look at one counts for the other: all the time the same new holders were complete."""
    inside = seen.arc.first <= segment.arc.first and segment.arc.last <= seen.arc.last
    return inside and (segment.layout, segment.change, segment.sound) == (seen.layout, seen.change, seen.sound)

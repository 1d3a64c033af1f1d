"""A change of holders ends: the new configuration answers from now on (specs/20-copies.md, Changing).

What is acknowledged once all new holders are complete lies with enough of them as well (settling_rule.py). So what is owed is looked up
after that, and whatever is acknowledged during the look, or behind it, is safe without being looked up.
"""

from __future__ import annotations

import logging
from bisect import bisect_right
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import trio

from scenefold.base.errors import Refused
from scenefold.base.location import Location
from scenefold.base.placement import Layout
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.segment import Segment
from scenefold.peer.line.parts import Parts
from scenefold.store.debts import Debt
from scenefold.wire import Member

DEBTS_PAGE = 1_024
AGAIN_S = 1.0
"""Between two looks at debts that are being paid."""

_log = logging.getLogger("scenefold.peer.replication")


Owed = Mapping[Segment, set[frozenset[Member]]]
"""Of each record that is owed to new holders of these segments, to whom."""


class _Looked:
    """What is owed, to be found by place: there may be as many debts as records, and thousands of segments."""

    def __init__(self, owed: Owed) -> None:
        self._by_layout: dict[Layout, tuple[list[Location], list[tuple[Segment, set[frozenset[Member]]]]]] = {}
        for segment, found in sorted(owed.items(), key=lambda one: one[0].arc.first):
            firsts, listed = self._by_layout.setdefault(segment.layout, ([], []))
            firsts.append(segment.arc.first)
            listed.append((segment, found))

    def at(self, layout: Layout, location: Location) -> tuple[Segment, set[frozenset[Member]]] | None:
        firsts, listed = self._by_layout.get(layout, ((), ()))
        index = bisect_right(firsts, location) - 1
        return listed[index] if index >= 0 and location in listed[index][0].arc else None


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

    async def _owed(self, ready: Sequence[Segment]) -> Owed:
        found: Owed = {segment: set() for segment in ready}
        looked = _Looked(found)
        new = {holder.node for segment in ready if segment.change is not None for holder in segment.change.holders}
        after: bytes | None = None
        while not new.isdisjoint(self._parts.store.owed):
            page = await self._parts.store.debts(after, DEBTS_PAGE)
            for debt in page.debts:
                self._note(debt, looked)
            after = page.after
            if after is None:
                break
        return found

    def _note(self, debt: Debt, looked: _Looked) -> None:
        known = self._parts.scenes.here(debt.spot.place.scene)
        layout = None if known is None else known.layouts.get(debt.spot.place.space)
        found = None if layout is None else looked.at(layout, debt.spot.home)
        if found is not None:
            segment, owed = found
            assert segment.change is not None
            owed.add(frozenset(holder for holder in segment.change.holders if holder.node in debt.nodes))


def activated(copies: Copies, owed: Owed) -> Copies:
    """With what is ready, unless it is not what was looked at. `owed`: by the segments as they were then."""
    looked = _Looked(owed)

    def debts(segment: Segment) -> Iterable[Collection[Member]] | None:
        found = looked.at(segment.layout, segment.arc.first)
        return found[1] if found is not None and _is_still(segment, found[0]) else None

    configurations = copies.configurations.activate(debts)
    return copies if configurations is copies.configurations else replace(copies, configurations=configurations)


def _is_still(segment: Segment, seen: Segment) -> bool:
    """Whether the look at one counts for the other: all the time the same new holders were complete."""
    inside = seen.arc.first <= segment.arc.first and segment.arc.last <= seen.arc.last
    return inside and (segment.layout, segment.change, segment.sound) == (seen.layout, seen.change, seen.sound)

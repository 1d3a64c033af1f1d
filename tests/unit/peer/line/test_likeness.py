"""If this fails, who takes over a piece asks its giver in vain, again and again, or takes for alike what it has not compared."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
import trio

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.location import WHOLE_LINE, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.versions import told_sum
from scenefold.peer.line.likeness import unlike
from scenefold.store.versions import RangeSum
from scenefold.wire import RangeCompared

GIVER = NodeId(7)
THIRDS, HALVES = (Location.from_number(5),), (Location.from_number(9),)
OWN = RangeSum(3, 11)


class Yard:
    """A receiver's parts: spaces 1 to `count` of scene 1, in thirds, and their giver's words."""

    def __init__(self, count: int, told: Any = None, *, layouts: Any = None, turns: Any = ()) -> None:
        self.asked: list[int] = []
        self.let_go: set[int] = set()
        self.broken: set[int] = set()
        self._told = told
        self._spaces = [(1, space) for space in range(1, count + 1)]
        known = SimpleNamespace(layouts={space: THIRDS for _, space in self._spaces} if layouts is None else layouts, turns=set(turns))
        self.parts = cast(
            Any,
            SimpleNamespace(
                store=SimpleNamespace(spaces_in=self.spaces_in, sums=self.sums, has_let_go=lambda scene: scene in self.let_go),
                scenes=SimpleNamespace(here={1: known}.get, everyone=lambda: [known]),
                peers=SimpleNamespace(ask=self.ask),
            ),
        )

    async def spaces_in(self, _arc: Any) -> list[tuple[int, int]]:
        return self._spaces

    async def sums(self, _scene: int, space: int, _arcs: Any) -> list[RangeSum]:
        if space in self.broken:
            raise Refused(RejectReason.STORAGE_FULL, "the tree cannot be made anew")
        return [OWN]

    async def ask(self, _node: NodeId, _priority: Any, request: Any, *_more: Any) -> RangeCompared:
        await trio.lowlevel.checkpoint()
        self.asked.append(request.space)
        if isinstance(self._told, Exception):
            raise self._told
        count = OWN.records if self._told is None else self._told.get(request.space, OWN.records)
        return cast(Any, SimpleNamespace(sums=[SimpleNamespace(count=count, sum=told_sum(OWN))]))

    async def unlike(self) -> set[Any]:
        return await unlike(self.parts, GIVER, WHOLE_LINE)


async def test_what_is_alike_is_not_doubted_and_one_that_is_not_is() -> None:
    assert await Yard(20).unlike() == set()
    assert await Yard(20, {17: 4}).unlike() == {THIRDS}
    two = Yard(2, {2: 4}, layouts={1: THIRDS, 2: HALVES})
    assert await two.unlike() == {HALVES} and sorted(two.asked) == [1, 2]


async def test_spaces_with_one_copy_are_not_asked_for_unless_they_had_more() -> None:
    yard = Yard(2, {1: 4, 2: 4}, layouts={1: (), 2: ()}, turns={2})
    assert await yard.unlike() == {()} and yard.asked == [2]


async def test_what_is_unknown_here_may_be_anything_that_is_known() -> None:
    assert await Yard(2, {2: 4}, layouts={1: THIRDS}).unlike() == {THIRDS}


async def test_what_was_let_go_is_nobodys() -> None:
    yard = Yard(3, {2: 4})
    yard.let_go = {1}
    assert await yard.unlike() == set() and not yard.asked


async def test_who_is_away_is_asked_no_more_and_all_is_doubted() -> None:
    yard = Yard(100, Unreachable("gone"))
    assert await yard.unlike() == {THIRDS}
    assert len(yard.asked) <= 8


@pytest.mark.parametrize("refusal", [Refused(RejectReason.BUSY, "not now"), None])
async def test_what_cannot_be_compared_is_doubted(refusal: Refused | None) -> None:
    yard = Yard(3, refusal)
    yard.broken = {2}
    assert await yard.unlike() == {THIRDS}

"""If this fails, nothing else goes on at a node as long as it judges what it has not settled, however much that is."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import trio

from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.location import Location
from scenefold.crypto import RecordPlace
from scenefold.peer.copies.copies import Copies
from scenefold.peer.line.knowing import Knowing
from scenefold.peer.line.unsettled import PAGE, Pending, Unsettled
from scenefold.peer.replication.judging import Judging
from scenefold.store import Spot
from scenefold.wire import Member

ME = Member(NodeId(1), bytes(16))


class Keeper:
    copies = Copies.of(ME)

    async def copies_changed_after(self, _copies: Copies) -> None:
        await trio.sleep_forever()


def test_others_go_on_while_all_that_is_pending_is_judged() -> None:
    async def main() -> None:
        unsettled = Unsettled()
        parts = SimpleNamespace(keeper=Keeper(), unsettled=unsettled, knowing=Knowing(), scenes=SimpleNamespace(here=lambda _: None))
        judging = Judging(cast(Any, parts), cast(Any, None), cast(Any, None))
        for number in range(3 * PAGE):
            spot = Spot(RecordPlace(SceneId(1), SpaceId(2), Location.from_number(number)))
            unsettled.add(Pending(spot, bytes(32), (), 1, frozenset(), {ME}, 100, is_stored=True))
        left: list[int] = []
        async with trio.open_nursery() as nursery:
            nursery.start_soon(judging.run)
            while len(unsettled):
                left.append(len(unsettled))
                await trio.lowlevel.checkpoint()
            nursery.cancel_scope.cancel()
        assert any(0 < count < 3 * PAGE for count in left)

    trio.run(main)

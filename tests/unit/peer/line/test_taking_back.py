"""If one fails, a receiver passes on what its giver may still take back, or holds on to more than that."""

from __future__ import annotations

from typing import Any

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.peer.line.ends import Side, without
from scenefold.peer.line.holding import Step
from scenefold.world.sim import Point
from unit.peer.line.street import Street
from unit.peer.line.test_crashes import RECORDS, give
from unit.peer.line.test_hardships import SETTLED_S, endure

pytestmark = pytest.mark.usefixtures("only_errors")


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_what_was_taken_waits_for_a_giver_that_is_away(share: float) -> None:
    """The giver may not know that the piece was claimed, and takes it back if we are removed; what else is here may be given."""

    async def tale(street: Street, nursery: trio.Nursery) -> None:
        await street.fill(0, RECORDS)
        giver, receiver = street.houses[:2]
        # The third commit is the claim: noted, copied, taken.
        street.net.trap(receiver.address, Point.AFTER_COMMIT, 3, giver.crash)
        giver.stays_down = True
        nursery.start_soon(give, giver, Side.RIGHT, share)
        await trio.sleep(4 * SETTLED_S)
        line: Any = receiver.line
        taken = receiver.durable().left
        assert taken.step is Step.TAKEN
        assert not line.settled(line.arc)
        with pytest.raises(Refused) as refusal:
            await line.give(Side.RIGHT, line.arc, why="a test")
        assert refusal.value.reason is RejectReason.BUSY
        rest = without(line.arc, taken.piece, Side.LEFT)
        assert line.settled(rest)
        await line.give(Side.RIGHT, rest, why="a test")
        assert line.arc == taken.piece
        giver.stays_down = False
        nursery.start_soon(giver.run)
        await street.until_whole()
        assert line.settled(line.arc)

    endure(tale, founders=3)

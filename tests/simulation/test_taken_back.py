"""If one fails, a record reads as absent, or is written as a new one, because the receiver of a piece was removed on the way.

Whole nodes: the second of four gives what it owns to the third, which dies for good as it claims and is removed. All the while
clients read, and try to write what is there already as new. Then the piece must be its giver's again, with every record.
"""

from __future__ import annotations

from collections import Counter

import pytest
import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.location import Location
from scenefold.client.space import ABSENT
from scenefold.peer.line import Side
from scenefold.scene.layout import META
from scenefold.world.sim import Point
from simulation.steps import RECORDS, Crash, Stage, play

GIVER, RECEIVER = 1, 2
NODES = 4
CLAIM = 3
"""The receiver's third commit: noted, copied, taken."""
READ_PAUSE_S = 0.3


# Nodes complain of neighbours that are gone, as they should; what matters is what clients are told.
pytestmark = pytest.mark.usefixtures("silent")


async def giving_all_under_eyes(stage: Stage, told: Counter[str]) -> None:
    arc, context = stage.owns(GIVER), stage.cluster.nodes[GIVER].context
    assert arc is not None and context is not None
    places = [Location.from_number(arc.first.number + arc.length * index // RECORDS) for index in range(RECORDS)]
    stage.arm()
    async with trio.open_nursery() as eyes:
        for place in places:
            eyes.start_soon(read_on, stage, place, told)
            eyes.start_soon(create_again, stage, place, told)
        try:
            with trio.move_on_after(30.0):
                await context.line.give(Side.RIGHT, arc, why="a test")
        except (Refused, Unreachable, PeerFault):
            told["given up"] += 1
        if stage.sprung:
            await stage.until(stage.is_quiet)
        told["taken back"] += context.line.events["taken back"]
        await trio.sleep(30.0)
        eyes.cancel_scope.cancel()


async def read_on(stage: Stage, place: Location, told: Counter[str]) -> None:
    """No answer is fine, a record is, and nothing else."""
    while True:
        try:
            found = await stage.client.scene.space(META).get(place)
        except (Refused, Unreachable, PeerFault):
            told["no answer"] += 1
        else:
            stage.check(found == b"x" * 200, f"{place.hex()[:8]} reads as {found!r}")
            told["read"] += 1
        await trio.sleep(READ_PAUSE_S)


async def create_again(stage: Stage, place: Location, told: Counter[str]) -> None:
    while True:
        try:
            await stage.client.scene.space(META).put(place, b"new", expect=ABSENT)
        except (Refused, Unreachable, PeerFault):
            told["not created"] += 1
        else:
            stage.check(False, f"{place.hex()[:8]} was written as if nothing were there")
        await trio.sleep(READ_PAUSE_S)


@pytest.mark.parametrize("point", [Point.BEFORE_COMMIT, pytest.param(Point.AFTER_COMMIT, marks=pytest.mark.long)])
def test_no_record_is_denied_while_the_receiver_of_its_piece_is_removed(point: Point) -> None:
    told = Counter[str]()

    async def story(stage: Stage) -> None:
        await giving_all_under_eyes(stage, told)

    assert play(story, Crash(RECEIVER, point, CLAIM, returns=False), founders=NODES)
    assert told["taken back"] == 1
    assert told["no answer"] >= RECORDS
    assert told["read"] >= 10 * RECORDS

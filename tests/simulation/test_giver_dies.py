"""If one fails, records of a living owner cannot be read because who gave them to it died before it told of that; or the judge of that sees nothing.

Whole nodes: the second of four gives half of its arc to a neighbour, and is dead for good at the instant at which that owns it durably.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import pytest
import trio

from scenefold.base.ids import NodeId
from scenefold.base.location import Arc, Location
from scenefold.peer import Routing
from scenefold.peer.line import Side
from scenefold.scene.layout import META
from scenefold.simulation import laws
from scenefold.simulation.asking import ANSWER_S, Asker
from scenefold.simulation.disks import arc_of
from scenefold.world import open_links
from simulation.steps import RECORDS, Disturbed, Stage, play

GIVER, NODES = 1, 4
SOON_S = 6.0
"""Before the dead one is removed, with a margin; a client's read and each node's are well within it."""


# Nodes complain of neighbours that crash, as they should; what matters is what is answered.
pytestmark = pytest.mark.usefixtures("silent")


async def give_and_die(stage: Stage, side: Side) -> list[Location]:
    """Half of what the giver has goes to one side; the places of records in it."""
    receiver = GIVER - 1 if side is Side.LEFT else GIVER + 1
    arc, context = stage.owns(GIVER), stage.cluster.nodes[GIVER].context
    assert arc is not None and context is not None
    half = Location.from_number(arc.first.number + arc.length // 2)
    piece = Arc(arc.first, half) if side is Side.LEFT else Arc(half, arc.last)
    before = stage.owns(receiver)

    def look(slot: int) -> None:
        if slot == receiver and GIVER not in stage.absent and arc_of(stage.cluster.nodes[receiver].disk) != before:
            stage.sprung = stage.cluster.crash(GIVER)
            stage.absent.add(GIVER)

    stage.cluster.watch.on_handover = look
    async with trio.open_nursery() as nursery:
        # The dead one's own call would wait for ever.
        nursery.start_soon(partial(context.line.give, side, piece, why="a test"))
        await stage.until(lambda: GIVER in stage.absent, 10.0)
        nursery.cancel_scope.cancel()
    places = [Location.from_number(arc.first.number + arc.length * index // RECORDS) for index in range(RECORDS)]
    return [place for place in places if place in piece]


async def read_at_once(stage: Stage, places: list[Location]) -> None:
    with trio.move_on_after(SOON_S) as patience:
        assert await stage.client.scene.space(META).get_many(places) == [b"x" * 200] * len(places)
        assert [place async for place in stage.client.scene.space(META).query(places[0], places[-1])] == places
        await stage.client.scene.space(META).put(places[0], b"x" * 200)
    stage.check(not patience.cancelled_caught, "a client cannot read what a living node owns")


async def ask_each_node(stage: Stage, places: list[Location]) -> None:
    """The judge asks on; what it has to say is said at the end of the play."""
    stage.cluster.watch.counts.clear()
    async with open_links(stage.cluster.net.world("user:asker")) as links, trio.open_nursery() as nursery:
        nursery.start_soon(Asker(stage.cluster, links, stage.client.scene, META, places).run)
        await trio.sleep(ANSWER_S + 4.0)
        nursery.cancel_scope.cancel()


def story_of(side: Side, *acts: Callable[[Stage, list[Location]], object]) -> Callable[[Stage], object]:
    async def story(stage: Stage) -> None:
        places = await give_and_die(stage, side)
        assert len(places) >= RECORDS // 2 - 1
        for act in acts:
            await act(stage, places)  # type: ignore[misc]

    return story


@pytest.mark.parametrize("side", list(Side))
def test_what_was_given_away_is_read_while_its_giver_is_dead(side: Side) -> None:
    assert play(story_of(side, read_at_once, ask_each_node), founders=NODES)  # type: ignore[arg-type]


def test_the_judge_finds_nodes_that_ask_only_one_of_two_claimants(monkeypatch: pytest.MonkeyPatch) -> None:
    def the_left_one(self: Routing, location: Location) -> Sequence[NodeId]:
        held = [node for node in self._current().at(location) if node != self._own.me]
        return held[:1] or [self._own.me]

    monkeypatch.setattr(Routing, "candidates", the_left_one)
    with pytest.raises(ExceptionGroup) as caught:
        play(story_of(Side.RIGHT, ask_each_node), founders=NODES)  # type: ignore[arg-type]
    (disturbed,) = caught.value.exceptions
    assert isinstance(disturbed, Disturbed) and laws.REACHED in str(disturbed)

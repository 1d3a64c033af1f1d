"""If one fails, a gap that waits for a member which cannot speak counts as a fault of nodes; or one that waits for nobody does not.

Whole nodes: the second of four is dead for good, and a neighbour adopts its arc, whose places are then asked for.
"""

from __future__ import annotations

import pytest
import trio

from scenefold.base.location import Arc, Location
from scenefold.peer.copies.entries import Entry
from scenefold.peer.replication.recovering_hearing import Hearing
from scenefold.scene.layout import META
from scenefold.simulation import laws
from scenefold.simulation.asking import ANSWER_S, Asker
from scenefold.world import open_links
from simulation.steps import RECORDS, Disturbed, Stage, play

VOTER, DEAD, CUT_OFF, NODES = 0, 1, 3, 4
ADOPTED_S_MAX = 90.0

# Nodes complain of neighbours that crash, as they should; what matters is what the judge says.
pytestmark = pytest.mark.usefixtures("silent")


def is_adopted(stage: Stage, place: Location) -> bool:
    """Whether somebody owns the place who has not heard yet what lies there."""
    contexts = [node.context for slot, node in stage.cluster.running.items() if slot != DEAD]
    owners = [context for context in contexts if context is not None and context.line.owns(place)]
    return any(not context.line.parts.keeper.copies.is_recovered(Arc(place, place)) for context in owners)


async def die_and_ask(stage: Stage) -> int:
    """How often a place of the dead one's had to be answered for too long."""
    arc = stage.owns(DEAD)
    assert arc is not None and stage.cluster.crash(DEAD)
    stage.absent.add(DEAD)
    places = [Location.from_number(arc.first.number + arc.length * index // RECORDS) for index in range(RECORDS)]
    await stage.until(lambda: is_adopted(stage, places[0]), ADOPTED_S_MAX)
    async with open_links(stage.cluster.net.world("user:asker")) as links, trio.open_nursery() as nursery:
        nursery.start_soon(Asker(stage.cluster, links, stage.client.scene, META, places).run)
        await trio.sleep(2.0 * ANSWER_S)
        nursery.cancel_scope.cancel()
    stage.check(is_adopted(stage, places[0]), "all was heard meanwhile, so nothing is tested")
    return sum(violation.law == laws.REACHED for violation in stage.cluster.watch.violations)


async def ask_while_one_cannot_speak(stage: Stage) -> None:
    """It was started anew, and the voter cannot tell it whether its disk is the newest."""
    net, watch = stage.cluster.net, stage.cluster.watch
    voter, cut_off = stage.cluster.nodes[VOTER], stage.cluster.nodes[CUT_OFF]
    net.cut(voter.address, cut_off.address, one_way=True)
    watch.reach.cut(VOTER, CUT_OFF, net.now)
    assert stage.cluster.crash(CUT_OFF)
    await stage.cluster.restart(CUT_OFF, 1.0)
    found = await die_and_ask(stage)
    net.mend(voter.address, cut_off.address, one_way=True)
    watch.reach.mended(VOTER, CUT_OFF, net.now)
    assert not found


def test_what_waits_for_a_member_that_cannot_speak_need_not_be_answered() -> None:
    play(ask_while_one_cannot_speak, founders=NODES)


def test_what_waits_for_nobody_must_be_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    is_mute, hear = True, Hearing.hear

    async def hear_nobody(self: Hearing) -> tuple[Entry, ...]:
        while is_mute:  # noqa: ASYNC110 - the test tells nobody when it changes
            await trio.sleep(1.0)
        return await hear(self)

    async def story(stage: Stage) -> None:
        nonlocal is_mute
        assert await die_and_ask(stage) > 0
        is_mute = False

    monkeypatch.setattr(Hearing, "hear", hear_nobody)
    with pytest.raises(ExceptionGroup) as caught:
        play(story, founders=NODES)
    (disturbed,) = caught.value.exceptions
    assert isinstance(disturbed, Disturbed) and laws.REACHED in str(disturbed)

"""If one fails, a cluster that has lost what it promised to keep calls itself healthy (specs/20-copies.md, What is lost)."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Any

import pytest
import trio

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.location import Arc
from scenefold.peer.cluster_log.registered import DRAINED
from scenefold.peer.copies.losses import Loss
from scenefold.peer.replication.noting import TELL_S_MAX
from scenefold.wire import AcknowledgeLosses, Member, NotedLoss, RemoveNode, TellLosses
from scenefold.wire.copy_packets import Span
from unit.peer.replication.heirs import Estate, Heir, inherit, spread, until
from unit.peer.replication.holders import arc_of, tell

pytestmark = pytest.mark.usefixtures("only_errors")


@pytest.fixture
def warned() -> Iterator[None]:
    """What recovery warns of is of interest here."""
    log = logging.getLogger("scenefold.peer.replication")
    before = log.level
    log.setLevel(logging.WARNING)
    yield
    log.setLevel(before)


async def recovered(estate: Estate, arc: Arc) -> Heir:
    heir = await estate.adopted(arc)
    await until(lambda: not heir.gaps)
    return heir


@pytest.mark.usefixtures("warned")
@pytest.mark.expect_log(
    "not all that was acknowledged in .* may be known: .* no complete copy is left .removed: 127.0.0.3, 127.0.0.4, 127.0.0.5"
)
def test_who_adopts_what_was_held_by_none_but_the_removed_says_so_and_does_not_forget_it() -> None:
    async def story(estate: Estate) -> None:
        arc = await estate.entrust(2, 3)
        gone = [estate.homes[number] for number in (1, 2, 3)]
        await estate.bury(1, 2, 3)
        heir = await recovered(estate, arc)
        (found,), (kept,) = heir.noted, heir.replication.noting.kept
        assert any(arc.first in span.arc and arc.last in span.arc for span in kept.arcs)
        assert found["removed"] == [house.address for house in gone]
        assert (found["copies"], found["complete_copy_left"], found["noted_by"]) == (3, False, heir.address)
        assert found["share"] >= arc.length / 2**160 * 0.99
        assert (await heir.replication.health.document())["lost"] == heir.noted
        noted = heir.noted
        heir.crash()
        await trio.sleep(5.0)
        await heir.up.wait()
        await heir.replication.noting.load()
        assert heir.noted == noted

    inherit(story, founders=6)


@pytest.mark.usefixtures("warned")
@pytest.mark.expect_log("one complete copy or more is left, and what was acknowledged last may be lost")
def test_where_one_copy_is_left_of_three_the_newest_may_be_lost() -> None:
    async def story(estate: Estate) -> None:
        arc = await estate.entrust(2, 3)
        await estate.homes[3].keep(*spread(arc, 5))
        await estate.bury(1, 2)
        heir = await recovered(estate, arc)
        about = [loss for loss in heir.noted if loss["complete_copy_left"]]
        assert [loss["removed"] for loss in about] == [[estate.homes[1].address, estate.homes[2].address]]

    inherit(story, founders=6)


@pytest.mark.usefixtures("warned")
@pytest.mark.expect_log("not all that was acknowledged in .* may be known")
def test_who_adopts_and_was_told_that_it_holds_nothing_knows_of_another_configuration() -> None:
    """The one that was away meanwhile, and says what was so before, has not what was acknowledged since."""

    async def story(estate: Estate) -> None:
        await estate.entrust(2, 3)
        arc = arc_of(estate.owner)
        assert (await tell(estate.owner, estate.homes[2], 6)).reason == 0
        await estate.bury(1, 4)
        heir = await recovered(estate, arc)
        assert heir is estate.homes[2]
        about = [loss for loss in heir.noted if loss["complete_copy_left"]]
        assert [loss["removed"] for loss in about] == [[estate.homes[1].address, estate.homes[4].address]]

    inherit(story, founders=6)


def test_one_that_is_lost_is_no_loss() -> None:
    async def story(estate: Estate) -> None:
        arc = await estate.entrust(2, 3)
        await estate.bury(1)
        assert (await recovered(estate, arc)).noted == []

    inherit(story)


def test_who_has_handed_over_everything_is_no_loss() -> None:
    """Nor one where nobody was told yet to hold anything, as with a layout that has come in between."""

    async def story(estate: Estate) -> None:
        left = estate.homes[3]
        left.stays_down, member = True, left.member
        left.crash()
        estate.log.say(RemoveNode(member, DRAINED))
        arc = arc_of(estate.owner)
        await estate.bury(1)
        heir = await recovered(estate, arc)
        assert heir.noted == []

    inherit(story)


def test_all_others_keep_it_until_it_is_acknowledged() -> None:
    async def story(estate: Estate) -> None:
        witness = estate.homes[0]
        heir = estate.homes[2]
        await heir.replication.noting.note([Loss(3, False, (estate.homes[4].member,), (arc_of(heir),))])
        async with trio.open_nursery() as nursery:
            nursery.start_soon(heir.replication.noting.run)
            await until(lambda: all(home.noted == heir.noted for home in estate.homes))
            nursery.cancel_scope.cancel()
        told = TellLosses(tuple(heir.replication.noting.kept))
        seen = AcknowledgeLosses((bytes.fromhex(heir.noted[0]["id"]),))
        assert (await witness.asked(seen)).ids == ()
        assert (await witness.asked(told, heir.node)).ids == (), "who has not heard of that brings it back to nobody"
        with pytest.raises(Refused, match="not noted itself"):
            await witness.asked(told, estate.homes[3].node)
        assert heir.noted, "each is told"
        witness.crash()
        await trio.sleep(5.0)
        await witness.up.wait()
        await witness.replication.noting.load()
        assert witness.noted == []

    inherit(story)


def test_those_who_do_not_answer_keep_nobody_from_hearing_of_it() -> None:
    async def story(estate: Estate) -> None:
        heir, last = estate.homes[3], estate.homes[-1]
        asked: list[NodeId] = []
        ask = heir.replication.noting._parts.peers.ask

        async def silent(member: NodeId, *question: Any) -> Any:
            asked.append(member)
            if member == last.node:
                return await ask(member, *question)
            await trio.sleep(TELL_S_MAX)
            raise Unreachable("silent")

        heir.replication.noting._parts.peers.ask = silent  # type: ignore[method-assign]
        await heir.replication.noting.note([Loss(3, False, (estate.homes[4].member,), (arc_of(heir),))])
        async with trio.open_nursery() as nursery:
            nursery.start_soon(heir.replication.noting.run)
            with trio.fail_after(TELL_S_MAX / 2):
                await until(lambda: last.noted == heir.noted)
            await until(lambda: len(asked) > len(estate.homes))
            nursery.cancel_scope.cancel()
        assert asked.count(last.node) == 1, "who has confirmed it is not told again"

    inherit(story)


def test_what_nobody_could_read_in_a_report_is_not_kept() -> None:
    """Else one that lies takes away from administrators what all others say of themselves."""

    async def story(estate: Estate) -> None:
        witness, liar = estate.homes[0], estate.homes[3]
        arc = arc_of(liar)
        span, gone = Span(arc.first, arc.last), estate.homes[4].member
        for removed, arcs in (((Member(NodeId(0), gone.incarnation),), (span,)), ((gone,), (span, span))):
            told = TellLosses((NotedLoss(liar.node, 7, 3, False, removed, arcs),))
            with pytest.raises(Refused, match="no node's address, or with arcs that are not in order"):
                await witness.asked(told, liar.node)
        assert witness.noted == []
        assert len((await witness.asked(TellLosses((NotedLoss(liar.node, 7, 3, False, (gone,), (span,)),)), liar.node)).ids) == 1

    inherit(story)

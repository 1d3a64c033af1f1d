"""If this fails, one node's word is enough to make others take what is not theirs: two nodes answer for one place then."""

from __future__ import annotations

from typing import Any

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import NodeId
from scenefold.base.location import FIRST, LINE_LENGTH, Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.line.adoption import Adoption
from scenefold.peer.line.claims import asked_about, claimants
from scenefold.peer.line.ends import Side, touches
from scenefold.peer.line.holding import handover_id
from scenefold.wire import BoundConfirmed, ClaimRange, ConfirmBound, HandoverReply, OfferRange, Packet
from scenefold.world import Priority
from scenefold.world.sim import run_simulated
from unit.peer.line.street import House, Street

pytestmark = pytest.mark.usefixtures("only_errors")

ASK_S = 5.0
HANDOVER = handover_id(1 << 40, b"x" * 8)


def before(location: Location) -> Location:
    return Location.from_number(location.number - 1)


async def offered(giver: House, receiver: House, piece: Arc) -> HandoverReply:
    assert giver.line is not None and giver.own is not None and receiver.own is not None
    ask = giver.line._parts.peers.ask
    position = giver.street.log.registry.position
    offer = OfferRange(HANDOVER, giver.own.member, receiver.own.member, piece.first, piece.last, 0, 0, position)
    return await ask(receiver.node, Priority.LOW, offer, HandoverReply, ASK_S)


async def claimed(giver: House, receiver: House, piece: Arc) -> HandoverReply:
    assert giver.line is not None
    claim = ClaimRange(HANDOVER, piece.first, piece.last)
    return await giver.line._parts.peers.ask(receiver.node, Priority.LOW, claim, HandoverReply, ASK_S)


def play(story: Any) -> None:
    async def main() -> None:
        street = Street(3)
        async with trio.open_nursery() as nursery:
            await street.begin(nursery)
            await trio.sleep(1.0)
            await story(street)
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)


def reaching_to_the_end(street: Street) -> Arc:
    """All that lies left of the last house: its neighbour's arc, and the first house's."""
    last = street.houses[2].line
    assert last is not None and last.arc is not None
    return Arc(FIRST, before(last.arc.first))


def test_a_giver_cannot_give_what_is_another_nodes() -> None:
    async def story(street: Street) -> None:
        _, liar, receiver = street.houses
        reply = await offered(liar, receiver, reaching_to_the_end(street))
        assert reply.reason == RejectReason.NOT_READY
        assert receiver.line is not None and not receiver.line.open_handovers()

    play(story)


def test_what_another_node_claims_since_the_offer_is_not_taken() -> None:
    async def story(street: Street) -> None:
        _, liar, receiver = street.houses
        piece, arcs = reaching_to_the_end(street), street.news.arcs
        street.news.arcs = lambda: dict.fromkeys(arcs())  # type: ignore[method-assign]
        assert (await offered(liar, receiver, piece)).reason == 0
        street.news.arcs = arcs  # type: ignore[method-assign]
        assert (await claimed(liar, receiver, piece)).reason == RejectReason.NOT_READY
        assert receiver.line is not None and not receiver.line.owns(FIRST)

    play(story)


def test_what_somebody_claimed_who_was_removed_is_left_alone_until_its_leases_are_over() -> None:
    async def story(street: Street) -> None:
        _, giver, receiver = street.houses
        assert giver.line is not None and giver.line.arc is not None
        street.news.former = [giver.line.arc]
        assert (await offered(giver, receiver, giver.line.arc)).reason == RejectReason.NOT_READY
        street.news.former = []
        assert (await offered(giver, receiver, giver.line.arc)).reason == 0

    play(story)


def test_who_has_just_started_takes_nothing_before_it_has_heard_the_others() -> None:
    async def story(street: Street) -> None:
        first, giver, receiver = street.houses
        assert giver.line is not None and giver.line.arc is not None
        street.news.unheard = {first.node}
        assert (await offered(giver, receiver, giver.line.arc)).reason == RejectReason.NOT_READY
        await trio.sleep(11.0)
        assert (await offered(giver, receiver, giver.line.arc)).reason == 0, "it may never come"

    play(story)


def test_a_gap_is_adopted_only_when_all_have_said_what_they_own() -> None:
    async def story(street: Street) -> None:
        first, _, last = street.houses
        street.remove(1)
        street.news.unheard = {first.node}
        await trio.sleep(40.0)
        assert last.line is not None and last.line.arc is not None and last.line.gap_left() is not None
        street.news.unheard = set()
        await street.until_whole()
        street.check()

    play(story)


def test_an_old_claim_is_asked_for_anew_and_then_in_nobodys_way() -> None:
    async def story(street: Street) -> None:
        first, giver, receiver = street.houses
        assert giver.line is not None and giver.line.arc is not None and receiver.line is not None
        arcs, old, asked = street.news.arcs, giver.line.arc, []

        async def ask(node: NodeId) -> None:
            asked.append(node)
            street.news.arcs = arcs  # type: ignore[method-assign]

        street.news.arcs = lambda: arcs() | {first.node: old}  # type: ignore[method-assign]
        receiver.line._parts.claims.ask = ask
        assert (await offered(giver, receiver, old)).reason == 0
        assert asked == [first.node]

    play(story)


def test_a_bound_that_lies_in_anothers_arc_makes_no_gap(monkeypatch: pytest.MonkeyPatch) -> None:
    confirm = Adoption._on_confirm
    lies = False

    async def lie(self: Adoption, packet: ConfirmBound, peer: str) -> Packet:
        if lies and self._parts.own.me == liar:
            return BoundConfirmed(0, FIRST, False, packet.log_position, 7)
        return await confirm(self, packet, peer)

    monkeypatch.setattr(Adoption, "_on_confirm", lie)
    liar = NodeId(0)

    async def story(street: Street) -> None:
        nonlocal lies, liar
        liar, lies = street.houses[1].node, True
        last = street.houses[2]
        last.crash()
        await trio.sleep(5.0)
        await last.up.wait()
        await trio.sleep(20.0)
        street.check()
        # Once the liar is gone, its arc is a gap indeed.
        lies = False
        street.remove(1)
        await street.until_whole()
        street.check()

    play(story)


class Standing:
    """The order of the log, without anything else."""

    position = 1

    def __init__(self, count: int) -> None:
        self.order = tuple(NodeId(number + 1) for number in range(count))

    def rank(self, node: NodeId) -> int:
        return self.order.index(node)

    def current(self, node: NodeId) -> Any:
        return node

    def founding_arc(self, node: NodeId) -> Arc | None:
        return None


@st.composite
def lines(draw: st.DrawFn) -> tuple[Any, dict[NodeId, Arc | None]]:
    """Nodes in order, some of them empty, whose arcs ascend, with or without gaps between them."""
    count = draw(st.integers(2, 6))
    cuts = sorted(draw(st.lists(st.integers(0, 60), min_size=2 * count, max_size=2 * count)))
    arcs: dict[NodeId, Arc | None] = {}
    for number in range(count):
        first, end = cuts[2 * number], cuts[2 * number + 1]
        arcs[NodeId(number + 1)] = Arc(Location.from_number(first), Location.from_number(end - 1)) if first < end else None
    return Standing(count), arcs


@given(lines(), st.data())
def test_nobody_grows_into_what_another_honestly_claims(line: tuple[Any, dict[NodeId, Arc | None]], data: st.DataObject) -> None:
    """Whatever is offered beside the own arc: it is free if and only if none but the giver owns a part of it."""
    standing, arcs = line
    me = data.draw(st.sampled_from(standing.order))
    own = arcs[me]
    first = data.draw(st.integers(0, 60))
    piece = Arc(Location.from_number(first), Location.from_number(data.draw(st.integers(first, 61))))
    if own is not None and not any(touches(piece, own, side) for side in Side):
        return
    said = {node: arc for node, arc in arcs.items() if node != me}
    giver = data.draw(st.sampled_from([None, *said]))
    nodes = [node for node in asked_about(piece, standing, me, own) if node != giver]
    found = set(claimants(piece, standing, said, nodes))
    assert found == {node for node, arc in said.items() if node != giver and arc is not None and arc.intersection(piece) is not None}


def test_a_node_beyond_the_own_arc_cannot_keep_it_from_growing_on_the_other_side() -> None:
    standing: Any = Standing(4)
    own = Arc(Location.from_number(50), Location.from_number(60))
    piece = Arc(Location.from_number(40), Location.from_number(49))
    lies = {standing.order[3]: Arc(FIRST, Location.from_number(LINE_LENGTH - 1))}
    assert not list(claimants(piece, standing, lies, asked_about(piece, standing, standing.order[2], own)))

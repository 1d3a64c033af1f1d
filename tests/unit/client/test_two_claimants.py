"""If this fails, records that a living node owns cannot be reached, because somebody dead, hung or wrong claims their place, too."""

from __future__ import annotations

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, node_id_of
from scenefold.base.limits import CLIENT_REQUEST_S, CLIENT_STATUS_S
from scenefold.base.location import LAST, WHOLE_LINE, Arc
from scenefold.base.reasons import RejectReason
from scenefold.wire import (
    Fault,
    GetMany,
    GetManyReply,
    ListScenes,
    Packet,
    PutMany,
    PutManyReply,
    PutOutcome,
    QueryRange,
    RequestTable,
    RespondTable,
    ScenesListed,
)
from scenefold.world import Priority
from unit.client.fake_nodes import FakeNodes
from unit.client.test_records import FILES, ITEMS, PLACES, _scene

FIRST_NODE, MIDDLE, LAST_NODE = FakeNodes().addresses


async def fits(nodes: FakeNodes, claimant: str) -> None:
    """Everything can be written, read and listed although one node claims the whole line."""
    nodes.claims[claimant] = WHOLE_LINE
    space = _scene(nodes).space(FILES)
    await space.put_many(ITEMS)
    assert await space.get_many(PLACES) == [payload for _, payload in ITEMS]
    assert [location async for location in space.query()] == PLACES


@pytest.mark.parametrize("claimant", [FIRST_NODE, MIDDLE, LAST_NODE])
async def test_who_claims_everything_costs_a_round_trip(claimant: str, autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    with trio.fail_after(5):
        await fits(nodes, claimant)


@pytest.mark.parametrize(("giver", "receiver"), [(MIDDLE, LAST_NODE), (MIDDLE, FIRST_NODE)])
async def test_what_a_dead_giver_still_claims_is_read_and_written_at_its_receiver(
    giver: str, receiver: str, autojump_clock: MockClock
) -> None:
    nodes = FakeNodes()
    before = next(arc for owner, arc in nodes.table.arcs() if owner.address == giver)
    nodes.give_all(giver, receiver)
    nodes.claims[giver] = before
    space = _scene(nodes).space(FILES)
    await space.put_many(ITEMS)
    nodes.away.add(giver)
    mine = [place for place in PLACES if place in before]
    assert mine, "some records were moved"
    with trio.fail_after(5):
        assert all(payload is not None for payload in await space.get_many(mine))
        assert [location async for location in space.query(before.first, before.last)] == mine
        await space.put(mine[0], b"newer")
        assert await space.get(mine[0]) == b"newer"
    nodes.asked.clear()
    await space.get_many(mine)
    assert giver not in [address for address, packet in nodes.asked if isinstance(packet, GetMany)], "who did not answer is asked last"


async def test_who_hangs_is_not_waited_for_as_long_as_the_only_one(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    nodes.claims[FIRST_NODE] = WHOLE_LINE
    space = _scene(nodes).space(FILES)
    await space.put_many(ITEMS)
    nodes.hung.add(FIRST_NODE)
    theirs = [place for place in PLACES if nodes.table.owner_of(place).address == LAST_NODE]
    with trio.fail_after(8):
        assert all(payload is not None for payload in await space.get_many(theirs))
    nodes.hung.clear()


async def test_places_that_all_candidates_deny_are_asked_for_again_with_a_new_table(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    await space.put_many(ITEMS)
    nodes.move_bounds()
    nodes.asked.clear()
    assert [location async for location in space.query(PLACES[0], LAST)] == PLACES
    questions = [packet for _, packet in nodes.asked if isinstance(packet, QueryRange | PutMany)]
    assert len(questions) <= 3 * len(nodes.addresses)


def test_the_fake_nodes_own_disjoint_arcs() -> None:
    arcs = [arc for _, arc in FakeNodes().table.arcs()]
    assert arcs[0].first == WHOLE_LINE.first and arcs[-1] == Arc(arcs[-1].first, LAST)


@pytest.mark.parametrize("wrong", [RespondTable(()), Fault(RejectReason.ILL_FORMED, "what?")])
@pytest.mark.parametrize("liar", [FIRST_NODE, LAST_NODE])
async def test_who_claims_everything_and_answers_with_nonsense_blocks_nothing(wrong: Packet, liar: str, autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    owners = nodes.table
    await _scene(nodes).space(FILES).put_many(ITEMS)
    nodes.claims[liar] = WHOLE_LINE
    theirs = [place for place in PLACES if owners.owner_of(place).address != liar]
    honest = nodes._answer

    def answer(address: str, packet: Packet) -> Packet:
        return wrong if address == liar and isinstance(packet, GetMany | PutMany | QueryRange) else honest(address, packet)

    nodes._answer = answer  # type: ignore[method-assign]
    for fresh in (_scene(nodes).space(FILES), _scene(nodes).space(FILES)):
        assert all(payload is not None for payload in await fresh.get_many(theirs))
        await fresh.put(theirs[0], b"newer")
        assert await fresh.get(theirs[0]) == b"newer"
        in_arc = next(arc for owner, arc in owners.arcs() if theirs[0] in arc)
        assert [place async for place in fresh.query(theirs[0], in_arc.last)] == [place for place in theirs if place in in_arc]
    with pytest.raises((PeerFault, Refused)):
        await _scene(nodes).space(FILES).get(next(place for place in PLACES if place not in theirs))


async def test_a_write_that_was_answered_with_nonsense_may_have_been_carried_out(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    mine = next(place for place in PLACES if nodes.table.owner_of(place).address == LAST_NODE)
    nodes.claims[FIRST_NODE] = WHOLE_LINE
    honest = nodes._answer

    def answer(address: str, packet: Packet) -> Packet:
        if address == FIRST_NODE and isinstance(packet, PutMany):
            return RespondTable(())
        if isinstance(packet, PutMany):
            return PutManyReply(tuple(PutOutcome(RejectReason.STALE_VERSION, item.location, NodeId(0)) for item in packet.items))
        return honest(address, packet)

    nodes._answer = answer  # type: ignore[method-assign]
    with pytest.raises(Unreachable, match="the answer to a write was lost"):
        await _scene(nodes).space(FILES).put(mine, b"mine", expect=b"\1" * 32)


async def test_places_that_one_alone_claims_have_their_time_beside_one_that_two_claim(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    theirs = [place for place in PLACES if nodes.table.owner_of(place).address == FIRST_NODE]
    await _scene(nodes).space(FILES).put_many(ITEMS)
    # Of what the first node owns the second one claims the last place, too.
    nodes.claims[MIDDLE] = Arc(theirs[-1], nodes.table.owners[1].right_bound or LAST)
    space = _scene(nodes).space(FILES)
    await space.get(PLACES[-1])
    plain, limits = nodes.request, []

    async def request(address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if isinstance(packet, GetMany):
            limits.append((timeout, [key.location for key in packet.keys]))
        return await plain(address, priority, packet, timeout)

    nodes.request = request  # type: ignore[method-assign]
    await space.get_many(theirs)
    assert (CLIENT_REQUEST_S, theirs[:-1]) in limits
    assert all(locations == theirs[-1:] for timeout, locations in limits if timeout == CLIENT_STATUS_S)


async def test_who_refuses_is_not_silent_any_more(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    nodes.claims[LAST_NODE] = WHOLE_LINE
    calls = nodes.calls()
    await calls.refresh()

    def in_turn() -> list[str]:
        return [owner.address for owner in calls.to_ask(PLACES[0])]

    assert in_turn() == [FIRST_NODE, LAST_NODE]
    nodes.away.add(FIRST_NODE)
    with pytest.raises(Unreachable):
        await calls.ask(FIRST_NODE, RequestTable(), RespondTable)
    assert in_turn() == [LAST_NODE, FIRST_NODE]
    nodes.away.clear()
    nodes.busy[FIRST_NODE] = 1
    with pytest.raises(Refused):
        await calls.ask(FIRST_NODE, RequestTable(), RespondTable)
    assert in_turn() == [FIRST_NODE, LAST_NODE]


@pytest.mark.parametrize("wrong", [GetManyReply((), False), Fault(RejectReason.NOT_AUTHORISED, "not you")])
async def test_who_gives_no_table_keeps_nobody_from_the_others(wrong: Packet, autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    honest = nodes._answer

    def answer(address: str, packet: Packet) -> Packet:
        return wrong if address == MIDDLE and isinstance(packet, RequestTable) else honest(address, packet)

    nodes._answer = answer  # type: ignore[method-assign]
    for call in ("get", "put", "list"):
        space = _scene(nodes).space(FILES)
        await space.put_many(ITEMS)
        nodes.move_bounds()
        match call:
            case "get":
                assert await space.get_many(PLACES) == [payload for _, payload in ITEMS]
            case "put":
                await space.put_many(ITEMS)
            case _:
                assert [place async for place in space.query()] == PLACES


@pytest.mark.parametrize("wrong", [RespondTable(()), Fault(RejectReason.NOT_AUTHORISED, "not you")])
@pytest.mark.parametrize("busy", ["a record", "a packet"])
async def test_who_claims_everything_ends_no_write_that_waits_for_a_busy_owner(wrong: Packet, busy: str, autojump_clock: MockClock) -> None:
    """The owner's arc has just gone to a node that is busy for a moment, and all tables are old."""
    liar, giver, receiver = FIRST_NODE, MIDDLE, LAST_NODE
    nodes = FakeNodes()
    place = next(place for place in PLACES if nodes.table.owner_of(place).address == giver)
    nodes.claims[liar] = WHOLE_LINE
    honest, left = nodes._answer, [3]

    def answer(address: str, packet: Packet) -> Packet:
        if not isinstance(packet, PutMany):
            return honest(address, packet)
        if address == liar:
            return wrong
        if address == giver:
            return outcomes(packet, RejectReason.NOT_MY_LOCATION, node_id_of(receiver))
        left[0] -= 1
        if left[0] > 0 and busy == "a packet":
            return Fault(RejectReason.BUSY, "later")
        return outcomes(packet, RejectReason.BUSY if left[0] > 0 else 0, NodeId(0))

    nodes._answer = answer  # type: ignore[method-assign]
    await _scene(nodes).space(FILES).put(place, b"mine")
    assert left == [0]


async def test_who_is_named_as_owner_and_refuses_for_good_is_believed_at_once(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    nodes.claims[FIRST_NODE] = WHOLE_LINE
    place = next(place for place in PLACES if nodes.table.owner_of(place).address == LAST_NODE)
    honest = nodes._answer

    def answer(address: str, packet: Packet) -> Packet:
        if isinstance(packet, PutMany) and address == LAST_NODE:
            return Fault(RejectReason.NOT_AUTHORISED, "not you")
        return honest(address, packet)

    nodes._answer = answer  # type: ignore[method-assign]
    with pytest.raises(Refused, match="not you"), trio.fail_after(2):
        await _scene(nodes).space(FILES).put(place, b"mine")


def outcomes(packet: PutMany, reason: int, owner: NodeId) -> PutManyReply:
    return PutManyReply(tuple(PutOutcome(reason, item.location, owner) for item in packet.items))


async def test_who_refuses_what_any_node_can_answer_does_not_speak_for_the_others(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    calls = nodes.calls()
    nodes.busy[calls._addresses_from(None)[0]] = 1000
    with trio.fail_after(0.1):
        assert (await calls.ask_any(ListScenes(), ScenesListed)).scenes == ()

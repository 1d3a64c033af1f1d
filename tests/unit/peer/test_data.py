"""If this fails, a node acknowledges, or calls absent, what it may not speak for; or a moving bound loses a record."""

from __future__ import annotations

import itertools
import random
from dataclasses import replace
from typing import Any

import pytest
import trio

from scenefold.base.ids import NodeId, SpaceId
from scenefold.base.location import LAST, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import EXPECTS_NOTHING, Record, wanted_place
from scenefold.store import Put
from scenefold.wire import (
    DAMAGED_RECORD,
    AcceptData,
    EmptyData,
    Fault,
    GetData,
    GetMany,
    GetManyReply,
    ProposeData,
    PutItem,
    PutMany,
    PutManyReply,
    PutOutcome,
    QueryRange,
    RecordKey,
    RejectRange,
    ReturnData,
    ReturnRange,
)
from unit.peer import data_nodes
from unit.peer.data_nodes import LEFT, MIDDLE, RIGHT, SCENE, Neighbours, Node, arc, item, managed_item, with_nodes
from unit.peer.scenes_made import SPACE, offered, sealed

OTHERS = "node:1"
OBJECT = b"\x80" + bytes(14) + b"\x01"
NEAR = bytes(15) + b"\x01"
NEAR_END = 1 << 40
"""The home of NEAR lies before."""


async def put(node: Node, *items: PutItem) -> list[int]:
    return [outcome.reason for outcome in await outcomes(node, *items)]


async def outcomes(node: Node, *items: PutItem) -> list[PutOutcome]:
    reply = await node.ask(PutMany(items))
    assert isinstance(reply, PutManyReply)
    return list(reply.outcomes)


async def get(node: Node, *numbers: int, peer: str = "user:ada") -> GetManyReply | Fault:
    keys = tuple(RecordKey(SPACE, Location.from_number(number)) for number in numbers)
    reply = await node.ask(GetMany(SCENE.scene, 1, keys), peer)
    assert isinstance(reply, GetManyReply | Fault)
    return reply


async def query(node: Node, first: int, last: Location = LAST) -> ReturnRange | RejectRange:
    reply = await node.ask(QueryRange(SCENE.scene, SPACE, Location.from_number(first), last))
    assert isinstance(reply, ReturnRange | RejectRange)
    return reply


def reason_of(reply: object) -> RejectReason | None:
    return RejectReason(reply.reason) if isinstance(reply, Fault | RejectRange) else None


def found(reply: GetManyReply | Fault) -> list[bool]:
    assert isinstance(reply, GetManyReply)
    return [record is not None for record in reply.records]


def test_each_place_is_written_at_its_owner_and_read_anywhere() -> None:
    async def test(_: Neighbours, one: Node, other: Node) -> None:
        there, here = item(MIDDLE + 5), item(5)
        assert await outcomes(one, here, there) == [
            PutOutcome(0, here.location, NodeId(0)),
            PutOutcome(RejectReason.NOT_MY_LOCATION, there.location, other.me),
        ]
        assert await put(other, there) == [0]
        for node in (one, other):
            reply = await get(node, MIDDLE + 5, 5, 6)
            assert found(reply) == [True, True, False]
            assert isinstance(reply, GetManyReply) and not reply.stale
        assert reason_of(await get(one, MIDDLE + 5, peer=OTHERS)) is RejectReason.NOT_MY_LOCATION

    with_nodes(test, LEFT, RIGHT)


def test_without_a_lease_nothing_is_acknowledged_nor_called_absent() -> None:
    async def test(_: Neighbours, one: Node, other: Node) -> None:
        assert await put(one, item(5)) == [0]
        one.lease.held = False
        assert await put(one, item(6), item(5)) == [RejectReason.NOT_READY] * 2
        assert [outcome.owner for outcome in await outcomes(one, item(6))] == [one.me], "its own id: nothing of it was looked at"
        for node in (one, other):
            reply = await get(node, 5)
            assert isinstance(reply, GetManyReply) and reply.stale and found(reply) == [True]
            assert reason_of(await get(node, 5, 6)) is RejectReason.NOT_READY
        single = await one.ask(GetData(SCENE.scene, SPACE, Location.from_number(5), 1))
        assert isinstance(single, ReturnData) and single.stale
        assert reason_of(await one.ask(GetData(SCENE.scene, SPACE, Location.from_number(6), 1))) is RejectReason.NOT_READY
        listed = await query(one, 0)
        assert isinstance(listed, ReturnRange) and listed.stale and len(listed.locations) == 1
        assert reason_of(await query(one, 6)) is RejectReason.NOT_READY
        one.lease.held = True
        assert isinstance(await one.ask(GetData(SCENE.scene, SPACE, Location.from_number(6), 1)), EmptyData)

    with_nodes(test, LEFT, RIGHT)


def test_a_lease_that_runs_out_during_a_write_acknowledges_nothing() -> None:
    async def test(_: Neighbours, one: Node) -> None:
        one.lease.lost_after = 1
        (outcome,) = await outcomes(one, item(5))
        assert (outcome.reason, outcome.owner) == (RejectReason.NOT_READY, 0), "it may have been stored"
        one.lease = one.data.writes._lease = type(one.lease)()
        assert await put(one, item(5)) == [0], "the same bytes again"

    with_nodes(test, arc(0, 99))


def test_a_place_without_an_owner_is_waited_for() -> None:
    async def test(neighbours: Neighbours, one: Node, empty: Node) -> None:
        assert await put(one, item(200)) == [RejectReason.NOT_READY]
        assert reason_of(await get(one, 200)) is RejectReason.NOT_READY
        assert await put(empty, item(5)) == [RejectReason.NOT_MY_LOCATION]
        assert found(await get(empty, 5)) == [False], "who owns nothing forwards"
        assert reason_of(await query(empty, 0)) is RejectReason.OUTSIDE_BOUNDS
        neighbours.believed[one.me] = empty.me
        assert reason_of(await get(one, 200)) is RejectReason.NOT_READY, "tables that disagree"
        neighbours.away.add(empty.me)
        assert reason_of(await get(one, 200)) is RejectReason.NOT_READY

    with_nodes(test, arc(0, 99), None)


def test_of_two_that_may_own_a_place_the_one_that_lives_answers() -> None:
    async def test(neighbours: Neighbours, asked: Node, giver: Node, receiver: Node) -> None:
        assert await put(receiver, item(50)) == [0]
        neighbours.believed[asked.me], neighbours.also_believed = giver.me, [receiver.me]
        assert found(await get(asked, 50)) == [True], "the giver knows that it is not its own any more"
        neighbours.away.add(giver.me)
        assert found(await get(asked, 50)) == [True], "it is dead, and the receiver lives"
        neighbours.believed[asked.me], neighbours.also_believed = receiver.me, [giver.me]
        assert found(await get(asked, 50)) == [True]
        neighbours.away.add(receiver.me)
        assert reason_of(await get(asked, 50)) is RejectReason.NOT_READY

    with_nodes(test, None, arc(0, 49), arc(50, 99))


def test_of_two_that_may_own_a_place_one_that_answers_with_nonsense_hides_nothing() -> None:
    async def test(neighbours: Neighbours, asked: Node, liar: Node, owner: Node) -> None:
        assert await put(owner, item(50)) == [0]
        neighbours.nonsense.add(liar.me)
        neighbours.believed[asked.me], neighbours.also_believed = liar.me, [owner.me]
        assert found(await get(asked, 50)) == [True]
        neighbours.away.add(owner.me)
        assert reason_of(await get(asked, 50)) is RejectReason.NOT_READY, "the owner may be back soon"
        neighbours.also_believed = []
        assert reason_of(await get(asked, 50)) is RejectReason.ILL_FORMED

    with_nodes(test, None, arc(0, 49), arc(50, 99))


@pytest.mark.parametrize("ways", [1, 9])
def test_what_went_and_came_back_during_a_look_is_looked_at_again(ways: int, monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(_: Neighbours, one: Node) -> None:
        assert await put(one, item(5)) == [0]
        left = 0

        async def went_and_came_back() -> bool:
            nonlocal left
            left -= 1
            if left >= 0:
                await one.line.change(None)
                await one.line.change(arc(0, 99))
            return left >= 0

        true_read, true_range = one.store.read, one.store.range

        async def read(spots: Any) -> Any:
            return [None] if await went_and_came_back() else await true_read(spots)

        async def in_range(*question: Any) -> Any:
            answer = await true_range(*question)
            return replace(answer, locations=()) if await went_and_came_back() else answer

        monkeypatch.setattr(one.store, "read", read)
        monkeypatch.setattr(one.store, "range", in_range)
        left = ways
        reply = await get(one, 5)
        left = ways
        listed = await query(one, 0)
        if ways == 1:
            assert found(reply) == [True]
            assert isinstance(listed, ReturnRange) and len(listed.locations) == 1
        else:
            assert reason_of(reply) is reason_of(listed) is RejectReason.NOT_READY

    with_nodes(test, arc(0, 99))


def test_a_frozen_place_takes_no_writes_and_delays_them_only_for_a_moment() -> None:
    async def test(_: Neighbours, one: Node) -> None:
        await one.line.freeze(arc(50, NEAR_END))
        began = trio.current_time()
        assert await put(one, item(60)) == [RejectReason.BUSY]
        assert 1.5 < trio.current_time() - began < 3
        assert await put(one, item(40)) == [0]
        assert await put(one, managed_item(NEAR)) == [RejectReason.BUSY]
        assert found(await get(one, 60)) == [False], "reads go on"

        results: list[list[int]] = []

        async def write(number: int) -> None:
            results.append(await put(one, item(number)))

        async with trio.open_nursery() as nursery:
            nursery.start_soon(write, 61)
            nursery.start_soon(write, 41)
            await trio.sleep(0.5)
            await one.line.change(arc(0, 49))
            await one.line.freeze(None)
        assert sorted(results) == [[0], [RejectReason.NOT_READY]], "what was given away meanwhile is not ours to write"
        assert one.line.inside == 0

    with_nodes(test, arc(0, NEAR_END))


def test_node_managed_records_find_their_place() -> None:
    async def test(_: Neighbours, one: Node, other: Node) -> None:
        [outcome] = await outcomes(other, managed_item(OBJECT))
        assert (outcome.reason, outcome.location) == (0, wanted_place(OBJECT))
        for copy in (managed_item(OBJECT), managed_item(OBJECT, at=LEFT.first), managed_item(OBJECT, seq=2)):
            [outcome] = await outcomes(one, copy)
            assert (outcome.reason, outcome.owner) == (RejectReason.NOT_MY_LOCATION, other.me), "one node decides about an id"
        [outcome] = await outcomes(one, managed_item(OBJECT[::-1]))
        assert outcome.reason == 0 and outcome.location in LEFT
        listed = await query(other, MIDDLE)
        assert isinstance(listed, ReturnRange)
        assert (listed.locations, listed.objects) == ((wanted_place(OBJECT),), (OBJECT,))
        assert await put(other, managed_item(OBJECT, seq=2, at=wanted_place(OBJECT))) == [0]
        assert await outcomes(one, managed_item(OBJECT, seq=3, at=wanted_place(OBJECT))) == [
            PutOutcome(RejectReason.NOT_MY_LOCATION, wanted_place(OBJECT), other.me)
        ]
        keys = [RecordKey(SPACE, location, OBJECT) for location in (wanted_place(OBJECT), LEFT.first, RIGHT.last)]
        for node, key in itertools.product((one, other), keys):
            reply = await node.ask(GetMany(SCENE.scene, 1, (key,)))
            assert isinstance(reply, GetManyReply) and reply.records[0] is not None
            assert reply.records[0].header == managed_item(OBJECT, seq=2).header
        copy = managed_item(OBJECT, seq=2)
        await one.store.merge([Put(Record(copy.header, copy.signature, copy.ciphertext), at=LEFT.first)])
        listed = await query(one, 0, LEFT.last)
        assert isinstance(listed, ReturnRange)
        assert listed.objects == (OBJECT[::-1],), "what another node decides about is that one's to list"
        single = managed_item(b"\x81" + OBJECT[1:])
        accepted = await other.ask(
            ProposeData(single.scene, single.space, single.location, single.signature, single.header, single.ciphertext)
        )
        assert isinstance(accepted, AcceptData) and accepted.location in RIGHT

    with_nodes(test, LEFT, RIGHT)


def test_nobody_places_a_record_where_nodes_choose_the_places(monkeypatch: pytest.MonkeyPatch) -> None:
    managed = tuple(replace(entry, node_managed=True) for entry in SCENE.spaces)
    monkeypatch.setattr(data_nodes, "SCENE", replace(SCENE, spaces=managed))

    async def test(_: Neighbours, one: Node) -> None:
        assert await put(one, item(5), managed_item(NEAR)) == [RejectReason.ILL_FORMED, 0]
        listed = await query(one, 0, Location.from_number(NEAR_END))
        assert isinstance(listed, ReturnRange)
        assert listed.objects == (NEAR,)

    with_nodes(test, arc(0, NEAR_END))


def test_nobody_writes_to_a_shadow_reads_or_lists_it(monkeypatch: pytest.MonkeyPatch) -> None:
    shadow = replace(SCENE.spaces[0], space=SpaceId(11), parent=SPACE, offset=Location.from_number(1 << 159))
    monkeypatch.setattr(data_nodes, "SCENE", replace(SCENE, spaces=(replace(SCENE.spaces[0], copies=2), shadow)))
    place = Location.from_number(5)

    async def test(_: Neighbours, one: Node) -> None:
        assert await put(one, item(5)) == [0]
        assert await put(one, offered(sealed(SCENE, space=SpaceId(11), location=place))) == [RejectReason.UNKNOWN_SCENE_OR_SPACE]
        questions = {
            "read": GetMany(SCENE.scene, 1, (RecordKey(SPACE, place), RecordKey(SpaceId(11), place))),
            "read ": GetData(SCENE.scene, SpaceId(11), place, 1),
            "list": QueryRange(SCENE.scene, SpaceId(11), place, place),
        }
        for verb, question in questions.items():
            answer = await one.ask(question)
            assert isinstance(answer, Fault) and answer.reason == RejectReason.UNKNOWN_SCENE_OR_SPACE
            assert answer.text == f"space 11 holds the copies of space 10: {verb.strip()} space 10"
        assert found(await get(one, 5)) == [True]

    with_nodes(test, arc(0, 99))


def test_a_node_that_owns_nothing_sends_new_objects_on() -> None:
    async def test(_: Neighbours, empty: Node, other: Node) -> None:
        assert await outcomes(empty, managed_item(OBJECT)) == [
            PutOutcome(RejectReason.NOT_MY_LOCATION, managed_item(OBJECT).location, other.me)
        ]

    with_nodes(test, None, RIGHT)


@pytest.mark.expect_log("changed on the disk")
def test_a_damaged_record_is_no_answer() -> None:
    async def test(_: Neighbours, one: Node) -> None:
        assert await put(one, item(5), item(6)) == [0, 0]
        dice = random.Random(1)
        for _turn in range(20):
            one.disk.corrupt("records", dice)
        assert one.store.damaged == 0
        reply = await get(one, 5, 6)
        assert isinstance(reply, GetManyReply)
        assert DAMAGED_RECORD in reply.records
        assert one.store.damaged
        for number, record in zip((5, 6), reply.records, strict=True):
            single = await one.ask(GetData(SCENE.scene, SPACE, Location.from_number(number), 1))
            assert reason_of(single) is (RejectReason.NOT_READY if record == DAMAGED_RECORD else None)
        assert await put(one, item(5, seq=2), item(6, seq=2)) == [0, 0], "a new version heals it"
        assert found(await get(one, 5, 6)) == [True, True]

    with_nodes(test, arc(0, 99))


@pytest.mark.expect_log("changed on the disk")
def test_what_cannot_be_compared_with_a_damaged_record_was_not_done_and_says_so() -> None:
    """For a reason of its own: its writer is in no doubt, and does not wait for a lease that is there."""

    async def test(_: Neighbours, one: Node) -> None:
        assert await put(one, item(5, seq=2)) == [0]
        dice = random.Random(1)
        for _turn in range(20):
            one.disk.corrupt("records", dice)
        claim = item(5, seq=3, expects=EXPECTS_NOTHING)
        assert await outcomes(one, claim) == [PutOutcome(RejectReason.DAMAGED, claim.location, NodeId(0))]
        assert await put(one, item(5, seq=3)) == [0]

    with_nodes(test, arc(0, 99))


@pytest.mark.expect_log("changed on the disk")
def test_a_damaged_record_keeps_nobody_from_the_others() -> None:
    async def test(_: Neighbours, one: Node, other: Node) -> None:
        assert await put(one, item(5)) == [0]
        dice = random.Random(1)
        for _turn in range(20):
            one.disk.corrupt("records", dice)
        assert await put(one, item(6)) == [0]
        for node in (one, other):
            reply = await get(node, 5, 6, 7)
            assert isinstance(reply, GetManyReply)
            assert reply.records[0] == DAMAGED_RECORD
            assert found(reply)[1:] == [True, False]

    with_nodes(test, LEFT, RIGHT)


def test_a_bound_that_moves_under_readers_and_writers_loses_nothing() -> None:
    """Every acknowledged record is found by whoever asks its owner, whatever moved meanwhile; one seed after another."""

    async def test(_: Neighbours, one: Node, other: Node) -> None:
        acknowledged: set[int] = set()

        async def write(numbers: range) -> None:
            for number in numbers:
                for node in (one, other):
                    if await put(node, item(number)) == [0]:
                        acknowledged.add(number)

        async def read() -> None:
            for _ in range(40):
                for node in (one, other):
                    before = sorted(acknowledged)
                    if before and isinstance(reply := await get(node, *before), GetManyReply):
                        assert all(found(reply)), "an acknowledged record was called absent"

        async def move() -> None:
            for bound in (60, 30, 80, 10):
                await trio.sleep(0.01)
                await _move_bound(one, other, bound)

        async with trio.open_nursery() as nursery:
            nursery.start_soon(write, range(50))
            nursery.start_soon(write, range(50, 100))
            nursery.start_soon(read)
            nursery.start_soon(move)
        assert acknowledged

    for seed in range(12):
        with_nodes(test, arc(0, 49), arc(50, 99), seed=seed)


async def _move_bound(one: Node, other: Node, bound: int) -> None:
    """What a handover does in its end: freeze, copy, release, claim, delete."""
    assert one.line.arc is not None and other.line.arc is not None
    before = one.line.arc.last.number
    giver, taker = (one, other) if bound < before else (other, one)
    piece = arc(min(bound, before) + 1, max(bound, before))
    await giver.line.freeze(piece)
    await giver.line.drained()
    entries = (await giver.store.manifest(piece, None, 1000)).entries
    records = await giver.store.read([entry.spot for entry in entries])
    await taker.store.merge([Put(record) for record in records if not isinstance(record, Exception) and record is not None])
    arcs = {id(one): arc(0, bound), id(other): arc(bound + 1, 99)}
    await giver.line.change(arcs[id(giver)])
    await giver.line.freeze(None)
    await taker.line.change(arcs[id(taker)])
    await giver.store.remove([(entry.spot, entry.digest) for entry in entries])

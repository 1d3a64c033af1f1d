"""If this fails, a newcomer stays without an arc, a loaded node keeps everything, or a leaving one takes records with it."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from itertools import product

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId, address_of
from scenefold.base.location import FIRST, LAST, Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.balance import Joining, NodeDrained
from scenefold.peer.balance.draining import LISTED
from scenefold.peer.cluster_log.registered import DRAINED
from scenefold.peer.line.ends import Side
from scenefold.peer.line.gaps import GAP_REST_S
from scenefold.peer.membership.status import OwnStatus
from scenefold.wire import AskRange, DrainNode, HandoverReply, NodeReport, RemoveNode, unpack_value
from scenefold.wire.enrol_entries import Trust
from unit.peer.balance.street import ADMINISTRATOR, KIB, SETTLING_S, House, Street
from unit.peer.logs_made import member, node, record, secrets_of

MIB = 1024 * KIB
ORDER = DrainNode(check_only=False, cancel=False)
CHECK = DrainNode(check_only=True, cancel=False)


@asynccontextmanager
async def running(street: Street) -> AsyncIterator[trio.Nursery]:
    async with trio.open_nursery() as nursery:
        for house in street.houses:
            nursery.start_soon(run_until_drained, house)
        yield nursery
        nursery.cancel_scope.cancel()


async def run_until_drained(house: House) -> None:
    try:
        await house.run()
    except* NodeDrained:
        house.alive = False


async def tell(house: House, packet: DrainNode) -> dict[str, object]:
    reply = await house.handlers.handle(packet, ADMINISTRATOR)
    assert isinstance(reply, NodeReport)
    document = unpack_value(reply.document)
    assert isinstance(document, dict)
    return document


async def until(street: Street, wanted: object, seconds: float = 200) -> None:
    assert callable(wanted)
    with trio.fail_after(seconds):
        while not wanted():
            await trio.sleep(0.5)
            street.check()


async def test_a_loaded_end_is_shared_by_all(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 5)
    street.houses[0].fill_evenly(500, 50 * KIB)
    everything = street.records()
    async with running(street):
        await until(street, lambda: all(abs(house.used - 5000 * KIB) < 250 * KIB for house in street.houses))
    assert street.records() == everything
    assert street.handovers < 25
    assert street.houses[0].balancer.report()["handovers"] >= 1


async def test_a_paused_balancer_says_what_it_would_do(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 2)
    street.houses[0].fill_evenly(40, 50 * KIB)
    street.houses[0].resting.balance = True
    async with running(street):
        await trio.sleep(20)
        report = street.houses[0].balancer.report()
        assert street.handovers == 0
        assert report["to_give"] == {"right": 1000 * KIB}
        street.houses[0].resting.balance = False
        await until(street, lambda: street.handovers == 1)


async def test_who_is_refused_stays_away_for_longer_each_time(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 2)
    street.houses[0].fill_evenly(40, 50 * KIB)
    tries = []

    async def refuse(*_: object) -> None:
        tries.append(trio.current_time())
        raise Refused(RejectReason.BUSY, "not now")

    street.move = refuse  # type: ignore[method-assign]
    async with running(street):
        await trio.sleep(200)
    assert 4 <= len(tries) <= 8
    assert tries[-1] - tries[-2] > tries[1] - tries[0]


async def test_a_newcomer_joins_beside_the_fullest_and_gets_half(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 3)
    street.houses[1].fill_evenly(4, KIB)
    street.houses[1].measure()
    newcomer = street.add_newcomer(64 * MIB)
    async with running(street):
        await newcomer.joining.join()
        assert street.registry.order == (node(0), node(3), node(1), node(2))
        await until(street, lambda: newcomer.arc is not None)
    assert len(newcomer.sizes) == len(street.houses[1].sizes) == 2


async def test_where_it_wants_to_stand_is_said_when_that_changes(
    autojump_clock: trio.testing.MockClock, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "scenefold.peer.joining")
    street = Street([64 * MIB] * 3)
    newcomer, fullest = street.add_newcomer(64 * MIB), [street.houses[1]] * 3 + [street.houses[2]] * 2

    async def refuse(*_: object) -> int:
        raise Refused(RejectReason.BUSY, "the lease of an earlier incarnation lasts")

    street.propose = refuse  # type: ignore[method-assign]
    for house in fullest:
        house.fill_evenly(64 * (1 + street.houses.index(house)), KIB)
        house.measure()
        with pytest.raises(Refused):
            await newcomer.joining.join()
    assert caplog.messages == [f"joining left of {address_of(house.me)}" for house in (street.houses[1], street.houses[2])]


async def test_who_comes_back_empty_stands_where_it_stood(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 4)
    street.houses[3].fill_evenly(64, KIB)
    street.houses[3].measure()
    back = street.houses[1]
    back.own = OwnStatus(back.me, address_of(back.me), member(1, life=1).incarnation, 1, secrets_of(1))
    back.joining = Joining(back.world, back, back, street, street, back, back.own)  # type: ignore[arg-type]
    assert back.joining.choose() == node(2)
    street.registry = street.registry.apply(record(street.registry, RemoveNode(member(1), "it began anew")))
    assert back.joining.choose() == node(2), "also once the one before is removed"
    street.registry = street.registry.apply(record(street.registry, RemoveNode(member(2), "gone")))
    assert back.joining.choose() == node(3)
    stranger = street.add_newcomer(64 * MIB)
    assert stranger.joining.choose() == node(3), "the fullest"


async def test_who_joins_beside_a_gap_is_given_the_place_from_which_it_adopts(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 3)
    left, empty, right = street.houses
    assert empty.arc is not None
    street.former, empty.arc = [empty.arc], None
    right.fill_evenly(64, KIB)
    left.fill_evenly(64, KIB)
    answers = {}
    for host in (left, right):
        reply = await host.handlers.handle(AskRange(empty.own.member, None), f"node:{empty.me}")
        assert isinstance(reply, HandoverReply)
        answers[host.me] = reply.reason
    assert answers == {left.me: RejectReason.BUSY, right.me: 0}
    async with trio.open_nursery() as nursery:
        nursery.start_soon(right.sharing.run)
        with trio.fail_after(10):
            while empty.arc is None:  # noqa: ASYNC110 - a house tells nobody that its arc has come
                await trio.sleep(0.1)
        nursery.cancel_scope.cancel()
    assert empty.arc.length == 1
    assert empty.arc.last.next() == right.arc.first


async def test_nothing_is_given_beside_a_gap_and_nothing_over_it(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 5)
    far, left, empty, right, end = street.houses
    assert empty.arc is not None
    for house in (far, left, right, end):
        house.fill_evenly(64, 8 * KIB)
    far.fill_evenly(512, 8 * KIB)
    gap, empty.arc = empty.arc, None
    for house in street.houses:
        house.measure()
    assert [await house.balancer.look() for house in (left, right)] != [[], []], "as far as it seems, there is somebody with nothing"
    street.former = [gap]
    assert [await house.balancer.look() for house in street.houses] == [[]] * 5, "somebody will have it soon"
    await trio.sleep(GAP_REST_S)
    for house in street.houses:
        house.measure()
    assert [await house.balancer.look() for house in (left, right)] == [[], []]
    assert await far.balancer.look() == [], "who stands beside it takes nothing either"
    empty.arc = gap
    assert [give.side for give in await far.balancer.look()] == [Side.RIGHT]


@pytest.mark.parametrize("place", ["random", Location.from_number(LAST.number // 3)])
async def test_a_newcomer_at_a_place(autojump_clock: trio.testing.MockClock, place: Location | str) -> None:
    street = Street([64 * MIB] * 4)
    newcomer = street.add_newcomer(64 * MIB)
    newcomer.place_at(place)
    async with running(street):
        await newcomer.joining.join()
        await until(street, lambda: newcomer.arc is not None)
    assert newcomer.arc is not None
    if place != "random":
        assert newcomer.arc.last == place


async def test_two_newcomers_at_one_place_both_get_something(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 2)
    street.houses[0].fill_evenly(64, KIB)
    first, second = street.add_newcomer(64 * MIB), street.add_newcomer(64 * MIB)
    async with running(street):
        async with trio.open_nursery() as nursery:
            nursery.start_soon(first.joining.join)
            nursery.start_soon(second.joining.join)
        await until(street, lambda: first.arc is not None and second.arc is not None)
    street.check()


async def test_a_dead_host_is_gone_round(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 3)
    newcomer = street.add_newcomer(64 * MIB)
    async with running(street):
        await newcomer.joining.join()
        right = street.by_id(street.registry.neighbours(newcomer.me)[1] or node(0))
        right.alive = False
        await until(street, lambda: newcomer.arc is not None or street.registry.neighbours(newcomer.me)[0] is None, 300)
    street.check()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ("other", RejectReason.NOT_READY),
        ("life", RejectReason.WRONG_INCARNATION),
        ("busy", RejectReason.BUSY),
        ("leaving", RejectReason.BUSY),
        ("fresh", RejectReason.BUSY),
        ("tiny", RejectReason.OUTSIDE_BOUNDS),
        ("empty", RejectReason.OUTSIDE_BOUNDS),
    ],
)
async def test_when_nothing_is_promised(change: str, reason: RejectReason) -> None:
    street = Street([64 * MIB] * 3)
    host, street.houses[2].arc = street.houses[1], None
    asker = 2 if change != "other" else 1
    packet = AskRange(member(asker, life=change == "life"), None)
    if change == "busy":
        host.moving = set(Side)
    elif change == "leaving":
        host.refuses = "leaving"
    elif change == "fresh":
        host.fill_evenly(8, KIB)
        host.received_at = dict.fromkeys(host.sizes, trio.current_time())
    elif change == "tiny":
        host.arc = Arc(FIRST, FIRST)
    elif change == "empty":
        host.arc = None
    reply = await host.handlers.handle(packet, f"node:{node(asker)}")
    assert isinstance(reply, HandoverReply)
    assert reply.reason == reason


async def test_who_owns_plenty_gets_nothing_by_asking(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 3)
    for house in street.houses:
        house.fill_evenly(60, 50 * KIB)
        house.resting.balance = True
    greedy, host = street.houses[:2]
    async with running(street):
        for _ in range(3):
            reply = await host.handlers.handle(AskRange(greedy.own.member, None), f"node:{greedy.me}")
            assert isinstance(reply, HandoverReply) and reply.reason == RejectReason.BUSY
            await trio.sleep(SETTLING_S)
    assert len(host.sizes) == len(greedy.sizes) == 60


async def test_nobody_asks_in_anothers_name() -> None:
    street = Street([64 * MIB] * 3)
    reply = await street.houses[1].handlers.handle(AskRange(member(2), None), f"node:{node(0)}")
    assert isinstance(reply, HandoverReply)
    assert reply.reason == RejectReason.NOT_AUTHORISED


async def test_a_drained_node_leaves_when_everything_lies_elsewhere(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 3)
    for house in street.houses:
        house.fill_evenly(60, 50 * KIB)
    everything, leaving = street.records(), street.houses[1]
    async with running(street):
        before = await tell(leaving, CHECK)
        assert (before["state"], before["may_switch_off"], before["records"]) == ("serving", False, 60)
        assert before["cannot_leave"] == "" and before["bytes"] <= before["room_bytes"] <= 2 * 64 * MIB
        told = await tell(leaving, ORDER)
        assert told["state"] == "draining"
        await until(street, lambda: not leaving.alive)
    assert leaving.arc is None and not leaving.sizes
    assert leaving.me not in street.registry.order
    removal = street.registry.removal(leaving.own.incarnation)
    assert removal is not None and removal.reason == DRAINED
    assert street.records() == everything
    assert leaving.draining.is_leaving and leaving.notes == {"drain": b""}
    after = await tell(leaving, CHECK)
    assert (after["state"], after["may_switch_off"], after["obstacles"]) == ("left", True, [])


@pytest.mark.parametrize("rotten_count", [1, LISTED, 2 * LISTED + 1])
async def test_what_has_rotted_hides_no_record_from_who_wants_to_leave(rotten_count: int, autojump_clock: trio.testing.MockClock) -> None:
    """A full disk deletes nothing, so rotten strays stay, before others that nobody has taken yet."""
    street = Street([64 * MIB] * 3)
    leaving = street.houses[1]
    async with running(street):
        await tell(leaving, ORDER)
        strays = [Location.from_number(number) for number in range(rotten_count + 1)]
        leaving.sizes.update(dict.fromkeys(strays, KIB))
        leaving.rotten.update(strays[:-1])
        await until(street, lambda: leaving.arc is None)
        await trio.sleep(30)
        report = await tell(leaving, CHECK)
        assert leaving.alive and not report["may_switch_off"]
        assert report["text"] == "records lie here that their owners have not taken yet"
        assert report["obstacles"] == [report["text"]]
        del leaving.sizes[strays[-1]]
        await until(street, lambda: not leaving.alive)
    assert set(leaving.sizes) == leaving.rotten, "nobody would take what has rotted, so it holds nobody up"


async def test_a_full_neighbourhood_keeps_a_node_from_leaving_and_cancelling_lets_it_stay(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([2 * MIB, 64 * MIB, 2 * MIB])
    leaving = street.houses[1]
    leaving.fill_evenly(200, 50 * KIB)
    everything = street.records()
    async with running(street):
        await tell(leaving, ORDER)
        await trio.sleep(120)
        report = await tell(leaving, ORDER)
        assert report["state"] == "draining" and not report["may_switch_off"]
        assert report["room_bytes"] < report["bytes"]
        assert report["text"] == "127.0.0.2 has no room for what lies here; 127.0.0.4 has no room for what lies here"
        assert leaving.arc is not None
        assert all(house.used <= house.capacity for house in street.houses)
        cancelled = await tell(leaving, DrainNode(check_only=False, cancel=True))
        assert cancelled["state"] == "serving" and leaving.refuses == ""
    assert street.records() == everything
    street.check()


@pytest.mark.parametrize("is_ordered", [False, True])
@pytest.mark.parametrize("flags", list(product((False, True), repeat=2)))
async def test_only_administrators_have_a_node_leave_or_stay(flags: tuple[bool, bool], is_ordered: bool) -> None:
    house = Street([64 * MIB] * 2).houses[1]
    if is_ordered:
        await tell(house, ORDER)
    notes = dict(house.notes)
    packet = DrainNode(*flags)
    if packet == CHECK:
        assert isinstance(await house.handlers.handle(packet, "user:eve"), NodeReport)
    else:
        with pytest.raises(Refused, match="user:eve is no administrator") as refused:
            await house.handlers.handle(packet, "user:eve")
        assert refused.value.reason is RejectReason.NOT_AUTHORISED
    assert house.notes == notes
    assert (await tell(house, CHECK))["state"] == ("draining" if is_ordered else "serving")


async def test_the_last_trusted_node_with_the_authoritys_key_stays() -> None:
    street = Street([64 * MIB] * 3)
    given = Trust(node(1), True, secrets_of(1).sealing.public.raw)
    for entry in (given, replace(given, sealed=b"sealed"), Trust(node(0), False)):
        street.registry = street.registry.apply(record(street.registry, entry))
    with pytest.raises(Refused, match="only trusted node"):
        await tell(street.houses[1], ORDER)
    street.registry = street.registry.apply(record(street.registry, Trust(node(0), True, secrets_of(0).sealing.public.raw)))
    assert (await tell(street.houses[1], ORDER))["state"] == "draining"


async def test_a_node_that_cannot_leave_says_what_it_waits_for(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 3)
    leaving = street.houses[1]
    leaving.has_lease = False
    async with running(street):
        await tell(leaving, ORDER)
        await trio.sleep(20)
        text = (await tell(leaving, CHECK))["text"]
        assert text == f"this node has no lease, so it can give nothing away until the voter, {address_of(node(0))}, answers it"
        assert leaving.arc is not None
        leaving.has_lease = True
        await until(street, lambda: not leaving.alive)


async def test_who_does_not_answer_or_refuses_is_named(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 3)
    leaving = street.houses[1]
    street.houses[2].alive = False

    async def refuse(*_: object) -> None:
        raise Refused(RejectReason.BUSY, "it takes nothing now", where=address_of(node(0)))

    street.move = refuse  # type: ignore[method-assign]
    async with running(street):
        await tell(leaving, ORDER)
        await trio.sleep(3)
        text = (await tell(leaving, CHECK))["text"]
    assert text == f"it takes nothing now ({address_of(node(0))}); {address_of(node(2))} does not answer"


@pytest.mark.parametrize("running_first", [True, False])
async def test_an_order_after_a_cancelled_one_or_none_is_carried_out(running_first: bool, autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 3)
    leaving = street.houses[1]
    leaving.fill_evenly(10, KIB)
    async with running(street):
        await trio.sleep(1)
        if running_first:
            leaving.has_lease = False
            await tell(leaving, ORDER)
            await trio.sleep(3)
        await tell(leaving, DrainNode(check_only=False, cancel=True))
        leaving.has_lease = True
        await trio.sleep(3)
        assert leaving.arc is not None
        await tell(leaving, ORDER)
        with trio.fail_after(60):
            await until(street, lambda: leaving.arc is None)


async def test_cancelling_comes_too_late_once_everything_is_given_away(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 2)
    leaving = street.houses[1]
    leaving.draining._leaving = True
    with pytest.raises(Refused, match="is leaving") as refused:
        await tell(leaving, DrainNode(check_only=False, cancel=True))
    assert refused.value.reason is RejectReason.NOT_AUTHORISED


async def test_a_full_disk_delays_the_end_only(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 2)
    leaving = street.houses[1]
    kept = leaving.put_note

    async def full(_name: str, _value: bytes) -> None:
        raise Refused(RejectReason.STORAGE_FULL, "the disk is full")

    async with running(street):
        await tell(leaving, ORDER)
        leaving.put_note = full  # type: ignore[method-assign]
        await until(street, lambda: leaving.draining.is_leaving)
        await trio.sleep(5)
        assert leaving.alive
        leaving.put_note = kept  # type: ignore[method-assign]
        await until(street, lambda: not leaving.alive)


async def test_an_order_outlives_a_restart(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 3)
    street.houses[2].notes["drain"] = b"1"
    async with running(street):
        await until(street, lambda: not street.houses[2].alive)
    assert street.registry.order == (node(0), node(1))


@pytest.mark.parametrize("number", [0, 1])
async def test_who_cannot_be_spared_says_so(number: int) -> None:
    street = Street([64 * MIB] * 2)
    house = street.houses[number]
    house.decides = [SceneId(7)] if number else []
    with pytest.raises(Refused, match="decides what becomes of scene 00000007" if number else "decides the cluster's log") as caught:
        await tell(house, ORDER)
    assert caught.value.reason == RejectReason.NOT_AUTHORISED
    assert caught.value.remedy
    report = await tell(house, CHECK)
    assert len(report["obstacles"]) == 2  # type: ignore[arg-type]


async def test_a_node_that_leaves_takes_nothing(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB, 4 * MIB, 64 * MIB])
    street.houses[0].fill_evenly(60, 50 * KIB)
    street.houses[1].refuses = ""
    async with running(street):
        await tell(street.houses[1], ORDER)
        await until(street, lambda: not street.houses[1].alive)
        await until(street, lambda: street.houses[2].used > MIB)

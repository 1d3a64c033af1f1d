"""If this fails, a peer fills a node's memory, or one that is gone holds up all others."""

from __future__ import annotations

from dataclasses import replace

import pytest
import trio

from scenefold.base.errors import Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.limits import DECIDERS_MAX, LOG_BODY_BYTES_MAX, LOG_RECORD_BYTES_MAX
from scenefold.consensus import AskLog, Certificate, Learn, Message, Propose, Received, Timer, Value, Vote, Waits
from scenefold.peer.logs import Logs
from scenefold.peer.logs.ahead import POSITIONS_MAX as AHEAD_MAX
from scenefold.peer.logs.ahead import Ahead
from scenefold.peer.logs.courier import WAITING_BYTES_MAX, WAITING_MAX, Courier
from scenefold.peer.logs.inbox import BYTES_MAX, EVENTS_MAX, Inbox, fits
from scenefold.peer.logs.timers import Timers
from scenefold.wire import Ballot, Phase, ProposalId
from scenefold.world.sim import CALM, SimNet, run_simulated
from unit.consensus.logs_made import GENESIS, member

ONE, TWO = NodeId(1), NodeId(2)


def learn(position: int, data: bytes = b"value", votes: int = 2) -> Learn:
    value, ballot = Value(b"data", data), Ballot(1, ONE)
    cast = tuple(Vote(position, ballot, value.digest, member(node), bytes(64)) for node in range(votes))
    return Learn(GENESIS, position, value, Certificate(position, ballot, cast))


def test_what_finds_no_room_is_lost_and_what_is_taken_makes_room() -> None:
    inbox = Inbox()
    for number in range(EVENTS_MAX + 3):
        inbox.put(Received(ONE, AskLog(GENESIS, number)))
    assert inbox.lost == 3
    assert inbox.take() == Received(ONE, AskLog(GENESIS, 0))
    inbox.put(Received(ONE, AskLog(GENESIS, 9)))
    assert inbox.lost == 3
    while inbox.take() is not None:
        pass
    large = learn(1, bytes(LOG_BODY_BYTES_MAX))
    for _ in range(BYTES_MAX // LOG_BODY_BYTES_MAX + 1):
        inbox.put(Received(ONE, large))
    assert inbox.lost == 4
    assert inbox.take() is not None
    inbox.put(Received(ONE, large))
    assert inbox.lost == 4


def test_what_could_not_be_kept_is_not_looked_at() -> None:
    assert fits(learn(1)) and fits(learn(1, bytes(LOG_BODY_BYTES_MAX), DECIDERS_MAX)) and fits(AskLog(GENESIS, 1))
    assert not fits(learn(1, votes=DECIDERS_MAX + 1))
    assert not fits(learn(1, bytes(LOG_BODY_BYTES_MAX + 1)))
    good = learn(1)
    long = replace(good.certificate.votes[0], signature=bytes(65))
    assert not fits(replace(good, certificate=replace(good.certificate, votes=(long,))))
    proposal = ProposalId(1, Ballot(1, ONE), Phase.PREPARE)
    assert not fits(Propose(GENESIS, proposal, (ONE,), (), highest=Value(bytes(LOG_RECORD_BYTES_MAX + 1))))


async def test_waiting_ends_with_what_comes_and_with_time(autojump_clock: trio.testing.MockClock) -> None:
    inbox = Inbox()
    began = trio.current_time()
    await inbox.wait(5.0)
    assert trio.current_time() - began == pytest.approx(5.0)
    async with trio.open_nursery() as nursery:
        nursery.start_soon(inbox.wait, 1000.0)
        await trio.testing.wait_all_tasks_blocked()
        inbox.put(Received(ONE, AskLog(GENESIS, 1)))
    inbox.wake()
    await inbox.wait(1000.0)
    assert trio.current_time() - began == pytest.approx(5.0)


def test_what_is_further_on_waits_for_its_turn() -> None:
    ahead = Ahead()
    for position in (3, 5, 4, 3 + AHEAD_MAX):
        ahead.keep(Received(ONE, learn(position)), 1)
    ahead.keep(Received(TWO, learn(4)), 1)
    ahead.keep(Received(ONE, learn(2)), 1)
    assert ahead.take(1) is None, "the next one is looked at, not kept"
    assert [ahead.take(position) for position in (2, 3, 4)] == [Received(ONE, learn(3)), Received(TWO, learn(4)), Received(ONE, learn(5))]
    assert ahead.take(2 + AHEAD_MAX) is None, "too far on"
    large = learn(3, bytes(LOG_BODY_BYTES_MAX))
    for position in range(3, 3 + 2 * BYTES_MAX // LOG_BODY_BYTES_MAX):
        ahead.keep(Received(ONE, replace(large, position=position)), 1)
    there = [position for position in range(3, 60) if ahead.take(position - 1) is not None]
    assert there == list(range(3, 3 + BYTES_MAX // LOG_BODY_BYTES_MAX)), "no more than fit"


class Road:
    """A carrier on which targets are slow, or gone."""

    def __init__(self) -> None:
        self.arrived: list[tuple[NodeId, Message]] = []
        self.slow = trio.Event()
        self.gone: set[NodeId] = set()
        self.joined: list[int] = []
        """How many were sent at once."""

    async def send(self, target: NodeId, message: Message, /, *more: Learn) -> None:
        self.joined.append(1 + len(more))
        await trio.lowlevel.checkpoint()
        if target in self.gone:
            raise Unreachable("gone")
        if target == TWO:
            await self.slow.wait()
        self.arrived += [(target, one) for one in (message, *more)]


async def test_what_is_decided_one_after_the_other_is_sent_at_once() -> None:
    road = Road()
    said: list[Message] = [AskLog(GENESIS, 1), learn(2), learn(3), learn(4), learn(9), AskLog(GENESIS, 2), learn(10), learn(11)]
    async with trio.open_nursery() as nursery:
        courier = Courier(nursery, road, lambda _: None)
        for message in said:
            courier.send(ONE, message)
    assert [message for _, message in road.arrived] == said
    assert road.joined == [1, 3, 1, 1, 2]


async def test_who_is_slow_holds_up_nobody_and_who_is_gone_is_told() -> None:
    road, lost = Road(), list[NodeId]()
    async with trio.open_nursery() as nursery:
        courier = Courier(nursery, road, lost.append)
        for number in range(WAITING_MAX + 10):
            courier.send(TWO, AskLog(GENESIS, number))
        courier.send(ONE, AskLog(GENESIS, 7))
        await trio.testing.wait_all_tasks_blocked()
        assert road.arrived == [(ONE, AskLog(GENESIS, 7))]
        road.slow.set()
        await trio.testing.wait_all_tasks_blocked()
        numbers = [message.have for target, message in road.arrived if target == TWO and isinstance(message, AskLog)]
        assert numbers == list(range(len(numbers))) and WAITING_MAX <= len(numbers) <= WAITING_MAX + 1
        road.gone.add(ONE)
        for number in range(3):
            courier.send(ONE, AskLog(GENESIS, number))
        await trio.testing.wait_all_tasks_blocked()
        assert lost == [ONE], "once for all that waited"
        road.gone.clear()
        courier.send(ONE, AskLog(GENESIS, 8))
        await trio.testing.wait_all_tasks_blocked()
        assert road.arrived[-1] == (ONE, AskLog(GENESIS, 8))


async def test_what_waits_for_who_is_slow_takes_so_much_memory_and_no_more() -> None:
    road, large = Road(), learn(1, bytes(LOG_BODY_BYTES_MAX))
    fit = WAITING_BYTES_MAX // len(large.value.data + large.value.body)
    async with trio.open_nursery() as nursery:
        courier = Courier(nursery, road, lambda _: None)
        for _ in range(fit + 5):
            courier.send(TWO, large)
        courier.send(ONE, large)
        await trio.testing.wait_all_tasks_blocked()
        road.slow.set()
        await trio.testing.wait_all_tasks_blocked()
        assert [target for target, _ in road.arrived] == [ONE] + [TWO] * fit
        # What has left makes room.
        courier.send(TWO, large)
        await trio.testing.wait_all_tasks_blocked()
        assert len(road.arrived) == fit + 2


def test_timers_go_off_in_their_order_and_one_set_again_is_one() -> None:
    async def main() -> None:
        world = SimNet(1, weather=CALM).world("user:ada")
        timers = Timers(world.clock, world.entropy)
        hop = ProposalId(1, Ballot(1, ONE), Phase.PREPARE)
        orphan, late, other = Timer(Waits.ORPHAN), Timer(Waits.HOP, hop), Timer(Waits.HOP, replace(hop, position=2))
        timers.set(orphan, 5.0, 6.0)
        timers.set(late, 1.0, 1.0)
        timers.set(other, 0.5, 0.5)
        timers.set(orphan, 2.0, 2.5)
        assert timers.take() is None
        assert timers.wait_s() == pytest.approx(0.5)
        timers.forget_hops({hop})
        assert timers.wait_s() == pytest.approx(1.0)
        await world.clock.sleep(1.01)
        assert timers.take() == late
        assert timers.take() is None
        assert 0.9 < timers.wait_s() < 1.6
        await world.clock.sleep(2.0)
        assert timers.take() == orphan
        assert timers.take() is None and timers.wait_s() == float("inf")

    run_simulated(1, main)


def test_a_packet_of_a_log_that_is_not_run_here_is_nobodys() -> None:
    assert not Logs().receive(ONE, AskLog(GENESIS, 0))

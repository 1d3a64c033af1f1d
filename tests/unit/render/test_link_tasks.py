"""If this fails, a link sleeps though it has something to say, or says it in more packets than it needs."""

from __future__ import annotations

import numpy as np
import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import Unreachable
from scenefold.base.rays import RAY_WORDS
from scenefold.render.arrays import U32
from scenefold.render.ledger import Counts
from scenefold.render.pool.links import sender
from scenefold.render.pool.links.link import Link
from scenefold.render.pool.links.receiver import DELAY_S
from scenefold.render.pool.links.round_trip import RTO_S_MAX, RTO_S_MIN
from scenefold.render.pool.links.sender import BYTES_MAX, GIVE_UP_S
from scenefold.render.pool.outbox import FRAME_RAYS_ENOUGH, FRAME_RAYS_MAX, HURRIED_S, LINGER_S
from scenefold.wire import AcknowledgeRays, Packet, SendRays
from unit.peer.village import TrioClock
from unit.render.test_job import JOB


class Line:
    """One end of a link, and what left it when. Time is virtual."""

    def __init__(self) -> None:
        self.left: list[tuple[float, Packet]] = []
        self.told: list[int] = []
        self.begun = trio.current_time()
        self.has_left = trio.Event()
        self.link = Link(JOB, 3, "127.0.0.9", TrioClock(), self.send, self.told.append)

    @property
    def now(self) -> float:
        return trio.current_time() - self.begun

    async def send(self, packet: Packet) -> None:
        await trio.lowlevel.checkpoint()
        self.left.append((self.now, packet))
        self.has_left.set()

    async def until_frames(self, count: int) -> None:
        """Until so many have left."""
        while len(self.frames) < count:
            self.has_left = trio.Event()
            await self.has_left.wait()

    @property
    def frames(self) -> list[tuple[float, SendRays]]:
        return [(at, packet) for at, packet in self.left if isinstance(packet, SendRays)]

    @property
    def acknowledgements(self) -> list[tuple[float, AcknowledgeRays]]:
        return [(at, packet) for at, packet in self.left if isinstance(packet, AcknowledgeRays)]


def rays(count: int) -> U32:
    return np.zeros((count, RAY_WORDS), np.uint32)


async def test_what_is_put_while_it_sleeps_leaves_in_its_time(autojump_clock: MockClock) -> None:
    line = Line()
    async with trio.open_nursery() as nursery:
        nursery.start_soon(line.link.run)
        await trio.sleep(1.0)
        line.link.put_rays(1, 7, rays(3))
        line.link.put_counts(5, Counts(1, 2, 3, 4))
        line.link.put_closed(6)
        await trio.sleep(LINGER_S / 2)
        line.link.put_rays(1, 8, rays(2))
        await trio.sleep(0.9)
        nursery.cancel_scope.cancel()
    ((at, frame),) = line.frames
    assert at == pytest.approx(1.0 + LINGER_S)
    assert [(batch.pass_index, batch.partition_epoch, batch.count) for batch in frame.batches] == [(7, 1, 3), (8, 1, 2)]
    assert [(one.pass_index, one.created, one.retired, one.sent, one.received) for one in frame.counts] == [(5, 1, 2, 3, 4)]
    assert frame.closed == (6,) and len(frame.rays) == 5 * 36 and (frame.attempt, frame.link_sequence) == (3, 1)


async def test_many_rays_and_a_hurry_wake_it(autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sender, "BYTES_FIRST", BYTES_MAX)
    line = Line()
    async with trio.open_nursery() as nursery:
        nursery.start_soon(line.link.run)
        await trio.sleep(1.0)
        line.link.put_rays(1, 7, rays(1))
        await trio.sleep(0.001)
        line.link.put_rays(1, 7, rays(FRAME_RAYS_ENOUGH))
        await trio.sleep(0.001)
        line.link.put_rays(1, 7, rays(1))
        line.link.hurry()
        await trio.sleep(HURRIED_S / 2)
        line.link.put_rays(1, 7, rays(1))
        line.link.hurry()
        await trio.sleep(0.5)
        nursery.cancel_scope.cancel()
    assert [at for at, _ in line.frames] == pytest.approx([1.001, 1.001 + HURRIED_S])


async def test_what_waits_for_credit_leaves_with_the_next_acknowledgement(
    autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sender, "BYTES_FIRST", BYTES_MAX)
    line = Line()
    frames_of_credit = BYTES_MAX // (FRAME_RAYS_MAX * 36)
    async with trio.open_nursery() as nursery:
        nursery.start_soon(line.link.run)
        for number in range(frames_of_credit + 1):
            line.link.put_rays(1, number, rays(FRAME_RAYS_MAX))
        await trio.sleep(0.5)
        assert len(line.frames) == frames_of_credit
        line.link.acknowledged(1, b"")
        await trio.sleep(0.1)
        nursery.cancel_scope.cancel()
    assert [frame.link_sequence for _, frame in line.frames] == list(range(1, frames_of_credit + 2))
    assert line.frames[-1][0] == pytest.approx(0.5)


async def test_a_frame_takes_the_acknowledgement_along(autojump_clock: MockClock) -> None:
    line = Line()
    async with trio.open_nursery() as nursery:
        nursery.start_soon(line.link.run)
        assert line.link.is_new(1, 256) and line.link.is_new(2, 256)
        line.link.put_rays(1, 7, rays(1))
        await trio.sleep(1.0)
        nursery.cancel_scope.cancel()
    ((_, frame),) = [packet for packet in line.frames if packet[0] < RTO_S_MIN]
    assert (frame.all_until, frame.selective) == (2, b"")
    assert not line.acknowledgements and line.link.acknowledgements_sent == 0


async def test_what_nothing_rides_on_is_acknowledged_in_time_and_at_once_if_something_is_missing(autojump_clock: MockClock) -> None:
    line = Line()
    async with trio.open_nursery() as nursery:
        nursery.start_soon(line.link.run)
        await trio.sleep(1.0)
        assert line.link.is_new(1, 256)
        await trio.sleep(1.0)
        assert line.link.is_new(2, 256)
        await trio.sleep(DELAY_S / 4)
        assert line.link.is_new(4, 256)
        await trio.sleep(1.0)
        nursery.cancel_scope.cancel()
    assert [(pytest.approx(at), packet.all_until, packet.selective) for at, packet in line.acknowledgements] == [
        (1.0 + DELAY_S, 1, b""),
        (2.0 + DELAY_S / 4, 2, b"\x02"),
    ]


async def test_once_a_silent_node_answers_the_next_packet_is_not_waited_for_as_long(autojump_clock: MockClock) -> None:
    """The RTO has grown by its silence, and is what was measured again."""
    line = Line()
    async with trio.open_nursery() as nursery:
        nursery.start_soon(line.link.run)
        for number in (1, 2, 3):
            line.link.put_rays(1, number, rays(FRAME_RAYS_ENOUGH))
            await trio.sleep(0.001)
        line.link.acknowledged(1, b"")
        await line.until_frames(3 + 4)
        # Number 2 was sent again, each time later than before; now it is known to have come, sooner than it can have by that sending.
        assert {frame.link_sequence for _, frame in line.frames[3:]} == {2}
        waited_s = line.frames[-1][0] - line.frames[-2][0]
        assert waited_s > 4 * RTO_S_MIN
        line.link.acknowledged(2, b"")
        answered = line.now
        await line.until_frames(3 + 5)
        at, frame = line.frames[-1]
        assert frame.link_sequence == 3 and at <= answered + 1.5 * RTO_S_MIN
        nursery.cancel_scope.cancel()


async def test_that_a_pass_is_closed_is_known_once_it_is_acknowledged(autojump_clock: MockClock) -> None:
    line = Line()
    async with trio.open_nursery() as nursery:
        nursery.start_soon(line.link.run)
        line.link.put_closed(6)
        line.link.put_closed(8)
        await trio.sleep(2 * LINGER_S)
        assert line.told == []
        line.link.acknowledged(1, b"")
        assert line.told == [6, 8]
        line.link.acknowledged(1, b"")
        assert line.told == [6, 8]
        nursery.cancel_scope.cancel()


async def test_who_acknowledges_nothing_is_given_up(autojump_clock: MockClock) -> None:
    line = Line()
    line.link.put_rays(1, 7, rays(1))
    with pytest.raises(BaseExceptionGroup) as caught:
        await line.link.run()
    assert caught.group_contains(Unreachable, match="acknowledged no rays")
    assert GIVE_UP_S <= line.now <= GIVE_UP_S + RTO_S_MAX + 1

"""Both links between this node and another one of a job, as tasks: what leaves, what is acknowledged, what is sent again."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager

import trio

from scenefold.base.errors import Unreachable
from scenefold.base.rays import RAY_BYTES
from scenefold.render.arrays import U32
from scenefold.render.job import Job
from scenefold.render.ledger import Counts
from scenefold.render.pool.awake import Timepiece
from scenefold.render.pool.links.receiver import Receiver
from scenefold.render.pool.links.sender import GIVE_UP_S, Sender
from scenefold.render.pool.outbox import Frame, PeerOutbox
from scenefold.wire import AcknowledgeRays, Packet, PassCounts, RayBatch, SendRays


class Link:
    """To one node, and from it. From the Trio thread only."""

    def __init__(
        self, job: Job, attempt: int, where: str, clock: Timepiece, send: Callable[[Packet], Awaitable[None]], told: Callable[[int], None]
    ) -> None:
        """`where`: the other node, for errors. `send`: may raise Unreachable. `told`: the node knows that this pass is closed."""
        self._job, self._attempt, self._where = job, attempt, where
        self._clock, self._send, self._told = clock, send, told
        self._outbox = PeerOutbox()
        self._head: Frame | None = None
        """What waits for credit."""
        self._sender: Sender[SendRays] = Sender()
        self._receiver = Receiver()
        self._stirred = trio.Event()
        self._to_acknowledge = trio.Event()
        self.packets_sent = 0
        """With rays, those that were sent again left out."""
        self.packets_resent = 0
        """Of all kinds."""
        self.acknowledgements_sent = 0
        """That rode on nothing."""

    # What this node says -------------------------------------------------------------------------------------

    def put_rays(self, epoch: int, number: int, rays: U32, *, are_all: bool = False) -> None:
        """Rays of a pass, u32[n, RAY_WORDS], addressed by the partition of an epoch. `are_all`: no more of it will follow."""
        with self._filling():
            self._outbox.put_rays(epoch, number, rays, self._clock.now(), are_all=are_all)

    def put_counts(self, number: int, counts: Counts, *, are_last: bool = False) -> None:
        """Counts of a pass, for its owner. `are_last`: as far as is known no more will follow."""
        with self._filling():
            self._outbox.put_counts(number, counts, self._clock.now(), are_last=are_last)

    def put_closed(self, number: int) -> None:
        """A pass of this node is closed."""
        with self._filling():
            self._outbox.put_closed(number, self._clock.now())

    def hurry(self) -> None:
        """This node has nothing else to do: send what there is."""
        with self._filling():
            self._outbox.hurry()

    @contextmanager
    def _filling(self) -> Iterator[None]:
        """The task is woken if it would sleep for too long."""
        before = self._outbox.ripe_at()
        yield
        if self._outbox.ripe_at() != before:
            self._stirred.set()

    # What the other one says ---------------------------------------------------------------------------------

    def has_come(self, number: int) -> bool:
        """Whether a packet of that `link_sequence` came before. PeerFault outside of the window."""
        return self._receiver.has(number)

    def is_new(self, number: int, size: int) -> bool:
        """A well-formed packet of that `link_sequence` and so many bytes has come: False if it came before. PeerFault outside of the window."""
        before = self._receiver.due_at
        is_new = self._receiver.take(number, size, self._clock.now())
        if self._receiver.due_at != before:
            self._to_acknowledge.set()
        return is_new

    def acknowledged(self, all_until: int, selective: bytes) -> None:
        """PeerFault for what was never sent."""
        before = math.inf if self._sender.due_at is None else self._sender.due_at
        came = self._sender.acknowledge(all_until, selective, self._clock.now())
        for packet in came:
            for number in packet.closed:
                self._told(number)
        after = math.inf if self._sender.due_at is None else self._sender.due_at
        # What was lost is due at once; and who was waited for ever longer is waited for as usual, now that it answers.
        if came and (self._head is not None or after < before):
            self._stirred.set()

    # Tasks ---------------------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Send and acknowledge until cancelled. Unreachable if the other node acknowledges nothing for too long."""
        async with trio.open_nursery() as nursery:
            nursery.start_soon(self._acknowledge)
            while True:
                self._stirred = trio.Event()
                await self._send_what_may_leave()
                if self._sender.is_given_up(self._clock.now()):
                    raise Unreachable(f"the node acknowledged no rays for {GIVE_UP_S:g} s", where=self._where)
                with trio.move_on_after(self._wait_s()):
                    await self._stirred.wait()

    async def _send_what_may_leave(self) -> None:
        while True:
            now = self._clock.now()
            again = self._sender.due(now)
            if again is not None:
                number, sent = again
                self.packets_resent += 1
                await self._carry(sent)
                self._sender.left(number, self._clock.now())
                continue
            frame = self._next(now)
            if frame is None:
                return
            number = self._sender.next_number
            packet = self._packet(frame, number)
            self._sender.send(packet, frame.size, now)
            self.packets_sent += bool(frame.batches)
            await self._carry(packet)
            self._sender.left(number, self._clock.now())

    def _next(self, now: float) -> Frame | None:
        """What may leave now."""
        ripe_at = self._outbox.ripe_at()
        if self._head is None and ripe_at is not None and now >= ripe_at:
            self._head = self._outbox.next(now, self._sender.frame_bytes // RAY_BYTES)
        frame = self._head
        if frame is None or not self._sender.may_send(frame.size):
            return None
        self._head = None
        return frame

    def _wait_s(self) -> float:
        """Until something is to be done, unless this is stirred before."""
        moments = [] if self._head is not None else [self._outbox.ripe_at()]
        return max(0.0, min((at for at in (*moments, self._sender.due_at) if at is not None), default=math.inf) - self._clock.now())

    async def _acknowledge(self) -> None:
        while True:
            due_at = self._receiver.due_at
            wait_s = math.inf if due_at is None else due_at - self._clock.now()
            if wait_s > 0:
                self._to_acknowledge = trio.Event()
                with trio.move_on_after(wait_s):
                    await self._to_acknowledge.wait()
                continue
            all_until, selective = self._receiver.acknowledge()
            self.acknowledgements_sent += 1
            await self._carry(AcknowledgeRays(job=self._job.id, attempt=self._attempt, all_until=all_until, selective=selective))

    async def _carry(self, packet: Packet) -> None:
        try:
            await self._send(packet)
        except Unreachable:
            # A loss like any other: the timer sends it again, or gives the link up.
            await trio.lowlevel.checkpoint()

    def _packet(self, frame: Frame, number: int) -> SendRays:
        all_until, selective = self._receiver.acknowledge()
        counts = (PassCounts(of, one.created, one.retired, one.sent, one.received) for of, one in frame.counts)
        return SendRays(
            job=self._job.id,
            frame=self._job.frame,
            attempt=self._attempt,
            link_sequence=number,
            all_until=all_until,
            selective=selective,
            render_location=(),
            counts=tuple(counts),
            closed=tuple(frame.closed),
            batches=tuple(RayBatch(batch.number, batch.epoch, len(batch.rays)) for batch in frame.batches),
            rays=b"".join(batch.rays.data for batch in frame.batches),
        )

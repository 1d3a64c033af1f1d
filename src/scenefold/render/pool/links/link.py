"""Both links between this node and another one of a job, as tasks: what leaves, what is acknowledged, what is sent again."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import trio

from scenefold.base.errors import Unreachable
from scenefold.render.arrays import U32
from scenefold.render.job import Job
from scenefold.render.ledger import Counts
from scenefold.render.pool.links.receiver import Receiver
from scenefold.render.pool.links.sender import GIVE_UP_S, Sender
from scenefold.render.pool.outbox import PeerOutbox, Rays, Told
from scenefold.wire import AcknowledgeRays, JobEvent, Packet, PassCounts, SendRays, Value, pack_value
from scenefold.world import Clock


@dataclass(frozen=True, slots=True)
class _Sent:
    packet: Packet
    closed: int | None
    """The pass that is closed, if that is what it says."""


class Link:
    """To one node, and from it. From the Trio thread only."""

    def __init__(
        self, job: Job, attempt: int, where: str, clock: Clock, send: Callable[[Packet], Awaitable[None]], told: Callable[[int], None]
    ) -> None:
        """`where`: the other node, for errors. `send`: may raise Unreachable. `told`: the node knows that this pass is closed."""
        self._job, self._attempt, self._where = job, attempt, where
        self._clock, self._send, self._told = clock, send, told
        self._outbox = PeerOutbox()
        self._head: Rays | Told | None = None
        """What waits for credit."""
        self._sender: Sender[_Sent] = Sender()
        self._receiver = Receiver()
        self._stirred = trio.Event()
        self._to_acknowledge = trio.Event()
        self.packets_sent = 0
        """Of rays, those that were sent again left out."""
        self.packets_resent = 0
        """Of all kinds."""
        self.acknowledgements_sent = 0

    # What this node says -------------------------------------------------------------------------------------

    def put_rays(self, epoch: int, number: int, rays: U32) -> None:
        """Rays of a pass, u32[n, RAY_WORDS], addressed by the partition of an epoch."""
        self._outbox.put_rays(epoch, number, rays, self._clock.now())
        self._stir()

    def put_counts(self, number: int, counts: Counts) -> None:
        """Counts of a pass, for its owner."""
        self._outbox.put_counts(number, counts, self._clock.now())
        self._stir()

    def put_closed(self, number: int) -> None:
        """A pass of this node is closed."""
        self._outbox.put_closed(number, self._clock.now())
        self._stir()

    def hurry(self) -> None:
        """This node has nothing else to do: send what there is."""
        self._outbox.hurry()
        self._stir()

    # What the other one says ---------------------------------------------------------------------------------

    def counts(self, number: int, size: int) -> bool:
        """A well-formed packet of that `link_sequence` and so many bytes has come: False if it came before. PeerFault outside of the window."""
        is_new = self._receiver.take(number, size, self._clock.now())
        self._to_acknowledge.set()
        return is_new

    def acknowledged(self, packet: AcknowledgeRays) -> None:
        """PeerFault for what was never sent."""
        for sent in self._sender.acknowledge(packet.all_until, packet.selective, self._clock.now()):
            if sent.closed is not None:
                self._told(sent.closed)
        self._stir()

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
                await self._carry(sent.packet)
                self._sender.left(number, self._clock.now())
                continue
            what = self._next(now)
            if what is None:
                return
            number, packet = self._sender.next_number, self._packet(what, self._sender.next_number)
            closed = what.number if isinstance(what, Told) and what.counts is None else None
            self._sender.send(_Sent(packet, closed), what.size, now)
            self.packets_sent += isinstance(what, Rays)
            await self._carry(packet)
            self._sender.left(number, self._clock.now())

    def _next(self, now: float) -> Rays | Told | None:
        """What may leave now."""
        ripe_at = self._outbox.ripe_at()
        if self._head is None and ripe_at is not None and now >= ripe_at:
            self._head = self._outbox.next()
        what = self._head
        if what is None or not self._sender.may_send(what.size):
            return None
        self._head = None
        return what

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

    def _packet(self, what: Rays | Told, number: int) -> Packet:
        job = self._job
        match what:
            case Rays():
                return SendRays(
                    job=job.id,
                    frame=job.frame,
                    pass_index=what.number,
                    attempt=self._attempt,
                    partition_epoch=what.epoch,
                    link_sequence=number,
                    render_location=(),
                    count=len(what.rays),
                    rays=what.rays.tobytes(),
                )
            case Told(counts=None):
                document: dict[str, Value] = {"closed": what.number, "attempt": self._attempt, "link_sequence": number}
                return JobEvent(job=job.id, document=pack_value(document))
            case Told(counts=counts):
                assert counts is not None
                return PassCounts(
                    job=job.id,
                    pass_index=what.number,
                    attempt=self._attempt,
                    created=counts.created,
                    retired=counts.retired,
                    sent=counts.sent,
                    received=counts.received,
                    link_sequence=number,
                )

    def _stir(self) -> None:
        self._stirred.set()

"""What one holder is still to get of what was written lately: sent in batches, a few at a time, the first written first.

A packet costs its two nodes as much as a dozen small records in it, and a commit. So what comes while one is on its way goes together in
the next: who writes little waits for nobody, and the more is written, the more is in a packet. Only what fills one goes at once.

A holder that is slow or away holds up nobody. What is settled without it waits here only as long as there is room, and the holder is
there; beyond that it is a debt on the disk, and paid from there (paying.py). What is not settled waits here however long that takes,
but its bytes need not: they are read again when they are sent.
"""

from __future__ import annotations

import logging
import math
from collections import OrderedDict
from collections.abc import Sequence
from functools import partial
from typing import Protocol

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.crypto import Record
from scenefold.peer.copies.copies import Copies
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.pauses import Pauses
from scenefold.peer.line.unsettled import Name, Pending
from scenefold.peer.replication.batch_size import BatchSize
from scenefold.peer.replication.in_hand import InHand
from scenefold.store import Spot
from scenefold.store.versions import version_of
from scenefold.wire import CopiesStored, HandItem, Member, StoreCopies
from scenefold.world import Priority, first_of

BATCH_RECORDS_MAX = 1_024
RECORD_BYTES = 256
"""About what a record costs beside its ciphertext on its way."""
WAITING_BYTES = 2048
"""Likewise as long as it waits: its header, signature and names, and all that is known about it."""
FLIGHTS = 3
"""Batches on their way to one holder: while one is written there, the next is verified, and one is sent."""
FULL_BYTES = 1024 * 1024
"""What waits does not wait for those on their way if it is so much."""
GATHER_S_MAX = 0.2
"""Nor for longer than that: what is on its way may wait for something else."""
BACKLOG_BYTES_MAX = 16 * 1024 * 1024
"""Of what is settled and waits for one holder, with all that it costs."""
ASK_S_MAX = 10.0
AGAIN_S = 1.0
"""For what a holder refused, unless what is known about copies changes first: it may not have been told its custody yet."""
HEARD_S = 0.25
"""Between two looks at whether who was away is heard again."""

_log = logging.getLogger("scenefold.peer.replication")


class Desk(Protocol):
    """What lanes ask of who judges (spreading.py)."""

    def member_at(self, node: NodeId) -> Member | None:
        """Who is registered there now."""
        ...

    def is_alive(self, node: NodeId) -> bool: ...

    def is_target(self, pending: Pending, member: Member) -> bool:
        """Whether it is to have this still."""
        ...

    def is_replaced(self, pending: Pending) -> bool:
        """Its version is not here any more: whether that settles it, or did."""
        ...

    async def taken(self, member: Member, pendings: Sequence[Pending]) -> None:
        """It has these durably."""
        ...


class Lane:
    """Used from the Trio thread only. `run` it in one task."""

    def __init__(self, parts: Parts, desk: Desk, node: NodeId) -> None:
        self.node = node
        self.is_behind = False
        """Whether it is owed what is not here."""
        self.size = BatchSize()
        self._parts = parts
        self._desk = desk
        self._pauses = Pauses(parts.world)
        self._queue: OrderedDict[Pending, None] = OrderedDict()
        self._queued_bytes = 0
        self._known = InHand()
        """All that wait here, are on their way, or were refused and are sent again."""
        self._refused: set[Pending] = set()
        """Of these, who wait until they are sent again."""
        self._is_down = False
        self._flying = 0
        """Batches on their way."""
        self._left_at = -math.inf
        """When the last of them left."""
        self._idle = trio.lowlevel.ParkingLot()
        self._fell_behind = trio.Event()

    # -------------------------------------------------------------------------------------------------- questions

    def has(self, pending: Pending) -> bool:
        return pending in self._known

    def has_of(self, name: Name) -> bool:
        """Whether a version of this record lies here that may still be sent, whatever lies on the disk by now."""
        return self._known.has_of(name)

    @property
    def is_down(self) -> bool:
        return self._is_down

    @property
    def is_overdue(self) -> bool:
        """Whether anything is to be sent before what is only owed: somebody has waited for it in vain, or nobody knows whether anybody did."""
        late = (pending for pending in self._known if pending.item is None and not pending.is_settled)
        return any(pending not in self._refused for pending in late)

    @property
    def _backlog_bytes(self) -> int:
        return self._queued_bytes + len(self._queue) * WAITING_BYTES

    async def behind(self) -> None:
        """Return once it is owed something that is not here."""
        while not self.is_behind:
            await self._fell_behind.wait()

    # ------------------------------------------------------------------------------------------------------ doing

    def send(self, pending: Pending) -> None:
        """Have it sent, unless that is under way."""
        if pending not in self._known:
            self._known.add(pending)
            self._enqueue(pending, first=False)

    def settled(self, pending: Pending) -> None:
        """Nobody waits for this holder to have it any more."""
        if pending in self._queue and (self._is_down or self._backlog_bytes > BACKLOG_BYTES_MAX):
            self._dequeue(pending)
            self._leave(pending)

    def fall_behind(self) -> None:
        """It is owed something that is on the disk."""
        self.is_behind = True
        self._fell_behind.set()
        self._fell_behind = trio.Event()

    async def run(self) -> None:
        async with trio.open_nursery() as nursery:
            for _ in range(FLIGHTS):
                nursery.start_soon(self._fly, nursery)

    async def _fly(self, nursery: trio.Nursery) -> None:
        while True:
            batch = await self._next()
            copies = self._parts.keeper.copies
            try:
                with self._parts.carrying.begun():
                    refused = await self._deliver(batch)
                self._pauses.reset()
                self.size.answered(in_time=True)
                if refused:
                    nursery.start_soon(self._again, refused, copies)
            except (Refused, Unreachable, PeerFault) as problem:
                _log.debug("%s does not take copies: %s", address_of(self.node), problem)
                self.size.answered(in_time=not isinstance(problem, Unreachable))
                self._return(batch)
                await self._rest()
            finally:
                self._flying -= 1

    @property
    def _may_fly(self) -> bool:
        """Whether the next batch goes now."""
        if self._is_down or not self._queue:
            return False
        if not self._flying or self._queued_bytes + len(self._queue) * RECORD_BYTES >= FULL_BYTES:
            return True
        return trio.current_time() >= self._left_at + GATHER_S_MAX

    async def _next(self) -> list[Pending]:
        while not self._may_fly:
            is_gathering = self._queue and not self._is_down
            with trio.CancelScope(deadline=self._left_at + GATHER_S_MAX if is_gathering else math.inf):
                await self._idle.park()
        batch: list[Pending] = []
        size = 0
        while self._queue and len(batch) < BATCH_RECORDS_MAX:
            pending = next(iter(self._queue))
            size += pending.size + RECORD_BYTES
            if batch and size > self.size.bytes:
                break
            self._dequeue(pending)
            batch.append(pending)
        self._flying += 1
        self._left_at = trio.current_time()
        if self._queue:
            self._idle.unpark()
        return batch

    async def _deliver(self, batch: Sequence[Pending]) -> list[Pending]:
        """Send these; what is to be sent again."""
        member = self._desk.member_at(self.node)
        if member is None:
            raise Unreachable("the holder is no member", where=address_of(self.node))
        found = list(zip(batch, await self._items(batch), strict=True))
        sent = [(pending, item) for pending, item in found if isinstance(item, HandItem)]
        # Replaced by what is pending itself, and settles it, it stays; by what is settled, nobody is told of it any more.
        gone = [pending for pending, item in found if item is None]
        left = [pending for pending in gone if not self._desk.is_replaced(pending)]
        for pending, item in found:
            if isinstance(item, DamagedData):
                self._leave(pending)
            elif item is None and pending not in left:
                self._known.remove(pending)
        if not sent:
            return left
        packet = StoreCopies(self._parts.own.member, tuple(item for _, item in sent))
        reply = await self._parts.peers.ask(self.node, Priority.LOW, packet, CopiesStored, ASK_S_MAX)
        if len(reply.reasons) != len(sent):
            raise PeerFault("a holder answered for another number of records", where=address_of(self.node))
        if self._desk.member_at(self.node) != member:
            # Who answered may have been the one before or the one after.
            raise Unreachable("the holder has another incarnation now", where=address_of(self.node))
        taken = [pending for (pending, _), reason in zip(sent, reply.reasons, strict=True) if reason == 0]
        for pending in taken:
            self._known.remove(pending)
        await self._desk.taken(member, taken)
        return left + [pending for (pending, _), reason in zip(sent, reply.reasons, strict=True) if reason]

    async def _items(self, batch: Sequence[Pending]) -> list[HandItem | DamagedData | None]:
        """Their bytes; None where this version lies here no more. What has rotted is there all the same, and settled by nothing."""
        unread = [pending for pending in batch if pending.item is None]
        if not unread:
            return [pending.item for pending in batch]
        records = await self._parts.store.read([pending.spot for pending in unread])
        read = {
            pending: item_of(pending.spot, record) if isinstance(record, Record) else record
            for pending, record in zip(unread, records, strict=True)
            if not isinstance(record, Record) or version_of(record.header_bytes) == pending.version
        }
        return [pending.item or read.get(pending) for pending in batch]

    # ----------------------------------------------------------------------------------------------------- failing

    async def _again(self, refused: Sequence[Pending], copies: Copies) -> None:
        """Send what was refused once more, soon, as far as somebody waits for it."""
        keeper, clock = self._parts.keeper, self._parts.world.clock
        self._refused.update(refused)
        await first_of(partial(keeper.copies_changed_after, copies), partial(clock.sleep, AGAIN_S))
        self._refused.difference_update(refused)
        self._return(refused)

    def _return(self, batch: Sequence[Pending]) -> None:
        """These have not come there: they are the next ones, or debts."""
        member = self._desk.member_at(self.node)
        for pending in reversed([pending for pending in batch if pending in self._known]):
            if pending.is_settled or (member is not None and not self._desk.is_target(pending, member)):
                # It is owed from now on; or not any more, and its debt is forgotten.
                self._leave(pending)
            else:
                self._enqueue(pending, first=True)

    async def _rest(self) -> None:
        """Send nothing for a while, and then nothing until it is heard."""
        if self._is_down:
            return
        self._is_down = True
        for pending in [pending for pending in self._queue if pending.is_settled]:
            self._dequeue(pending)
            self._leave(pending)
        await self._pauses.wait()
        while not self._desk.is_alive(self.node):
            await self._parts.world.clock.sleep(HEARD_S)
        self._is_down = False
        self._idle.unpark_all()

    def _leave(self, pending: Pending) -> None:
        """It is a debt from now on, and no longer remembered."""
        self._known.remove(pending)
        self.fall_behind()

    def _enqueue(self, pending: Pending, *, first: bool) -> None:
        self._queue[pending] = None
        if first:
            self._queue.move_to_end(pending, last=False)
        self._queued_bytes += pending.size
        if len(self._queue) == 1 or self._may_fly:
            # One that waits looks when it may go.
            self._idle.unpark()

    def _dequeue(self, pending: Pending) -> None:
        del self._queue[pending]
        self._queued_bytes -= pending.size


def item_of(spot: Spot, record: Record) -> HandItem:
    """A record with its place, for the wire."""
    (scene, space, location), name = spot
    return HandItem(scene, space, location, name, record.signature, record.header_bytes, record.ciphertext)

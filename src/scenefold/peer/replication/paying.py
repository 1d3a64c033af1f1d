"""Debts are paid from the disk: what a holder is owed and nobody waits for (specs/20-copies.md, Writes).

One walk over all debts picks those of one holder, reads the records and sends them, within the budget that all moving of data shares.
Another one follows as long as something was left: who is owed most is away, or was. A holder that has no room is not sent all of it again and
again (paying_full.py). A debt to a node that is no holder of its place, or of a place that is not this node's, is forgotten: whoever comes to
hold the place is compared with its owner.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from enum import Enum
from typing import Protocol

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.pauses import Pauses
from scenefold.peer.replication.full_holders import AGAIN_S_MIN, FullHolders
from scenefold.peer.replication.lane import ASK_S_MAX, HEARD_S, RECORD_BYTES, Lane, item_of
from scenefold.peer.replication.paying_full import FullDisk
from scenefold.store.debts import Debt
from scenefold.store.layout import record_key
from scenefold.store.versions import version_of
from scenefold.wire import CopiesStored, HandItem, Member, StoreCopies
from scenefold.world import Priority

PAGE = 256
AGAIN_S = 60.0
"""Between two looks at whether something is owed that nobody speaks of."""
READ_BATCH = 32
"""Records read at a time: 2 MiB of the largest."""
REST_LOOK_S = 5.0
"""Between two looks at whether a holder without room is another one by now, or says that it has some."""

_log = logging.getLogger("scenefold.peer.replication")


class Due(Enum):
    """What is to be done about a debt to one node."""

    PAY = 1
    FORGET = 2
    SENT = 3
    """It is on its way already."""
    LATER = 4
    """It is not known yet who holds what."""


class Ledger(Protocol):
    """What paying asks of who judges (spreading.py)."""

    def member_at(self, node: NodeId) -> Member | None: ...

    def is_alive(self, node: NodeId) -> bool: ...

    def due(self, debt: Debt, lane: Lane) -> Due: ...

    def is_unsettled(self, debt: Debt) -> bool:
        """Whether nobody may be told of this version."""
        ...

    def has_got(self, member: Member, debt: Debt, *, is_husk: bool = False) -> None:
        """It has this durably, or what is left of it."""
        ...


class Paying:
    """To one holder. `run` it in one task."""

    def __init__(self, parts: Parts, ledger: Ledger, lane: Lane, full: FullHolders) -> None:
        """`full`: told when the holder has no room."""
        self._parts = parts
        self._full = full
        self._ledger = ledger
        self._lane = lane
        self._node = lane.node
        self._pauses = Pauses(parts.world)
        self._disk = FullDisk()
        self._after: bytes | None = None
        """Where the next walk begins: behind what was offered last before there was no room."""
        self._offered: bytes | None = None

    async def run(self) -> None:
        # What is unsettled since before the start is sent first.
        unsettled = self._parts.unsettled
        await unsettled.until(lambda: unsettled.is_read)
        while True:
            await self._something_due()
            while not self._may_walk():
                await self._parts.world.clock.sleep(HEARD_S)
            self._lane.is_behind = False
            self._disk.begin()
            try:
                left = await self._walk()
            except (Refused, Unreachable, PeerFault) as problem:
                _log.debug("debts to %s stay for now: %s", address_of(self._node), problem)
                left = 1
            if left:
                self._lane.fall_behind()
            if self._disk.has_refused:
                await self._rest()
            elif left:
                await self._pauses.wait()
            else:
                self._pauses.reset()

    async def _something_due(self) -> None:
        """Return once the lane has left something; or in a while if anything is owed: that it was paid a full disk may not have written."""
        while True:
            with trio.move_on_after(AGAIN_S):
                await self._lane.behind()
                return
            if self._parts.store.owed.get(self._node):
                return

    def _may_walk(self) -> bool:
        # Of one that is no member any more debts are forgotten.
        member = self._ledger.member_at(self._node)
        return member is None or (self._ledger.is_alive(self._node) and not self._lane.is_down and not self._lane.is_overdue)

    async def _rest(self) -> None:
        """Offer nothing for a while to who has no room, or for a short while if it says that there is some. Another incarnation may have some."""
        member, pause_s = self._ledger.member_at(self._node), self._disk.next_pause_s()
        _log.info("%s has no room for what it is owed; it is tried again in %.0f s", address_of(self._node), pause_s)
        begin = trio.current_time()
        while (rested_s := trio.current_time() - begin) < pause_s:
            if self._ledger.member_at(self._node) != member:
                self._disk, self._after = FullDisk(), None
                return
            if rested_s >= AGAIN_S_MIN and self._full.says_room(self._node):
                return
            await self._parts.world.clock.sleep(REST_LOOK_S)

    async def _walk(self) -> int:
        """Pay all that can be paid; how many are left, at least."""
        # Only what is behind there is looked at, and the rest the next time.
        left, cursor = int(self._after is not None), self._after
        while self._parts.store.owed.get(self._node):
            page = await self._parts.store.debts(cursor, PAGE)
            owed = [debt for debt in page.debts if self._node in debt.nodes]
            dues = [(debt, self._ledger.due(debt, self._lane)) for debt in owed]
            await self._parts.store.paid([(debt.spot, debt.version, self._node) for debt, due in dues if due is Due.FORGET])
            left += sum(due is Due.LATER for _, due in dues)
            to_pay = [debt for debt, due in dues if due is Due.PAY]
            for start in range(0, len(to_pay), READ_BATCH):
                with self._parts.carrying.begun():
                    left += await self._pay(to_pay[start : start + READ_BATCH])
                if self._disk.is_hopeless:
                    self._after = self._offered
                    return left
            cursor = page.after
            if cursor is None:
                break
        self._after = None
        return left

    async def _pay(self, debts: Sequence[Debt]) -> int:
        member = self._ledger.member_at(self._node)
        if member is None:
            return len(debts)
        records = await self._parts.store.read([debt.spot for debt in debts])
        found: list[tuple[Debt, HandItem]] = []
        rotten = [debt for debt, record in zip(debts, records, strict=True) if isinstance(record, DamagedData)]
        left = await self._tell_of(member, rotten) if rotten else 0
        size = 0
        for debt, record in zip(debts, records, strict=True):
            if isinstance(record, Record) and version_of(record.header_bytes) == debt.version:
                item = item_of(debt.spot, record)
                if found and size + len(item.ciphertext) + RECORD_BYTES > self._disk.packet_bytes(self._lane.size.bytes):
                    left += await self._send(member, found, size)
                    found, size = [], 0
                    if self._disk.is_hopeless:
                        return left + 1
                found.append((debt, item))
                size += len(item.ciphertext) + RECORD_BYTES
        return left + (await self._send(member, found, size) if found else 0)

    async def _tell_of(self, member: Member, rotten: Sequence[Debt]) -> int:
        """What cannot be read here cannot be paid. Whoever lacks it gets what is left, and hears of it if somebody heals it here.

        Who keeps something older is owed the record until nobody is left who might have it, and so is whoever lacks what not even its header
        is left of. None of them counts as having it. What nobody was told of yet may give way to something older (healing.py): until
        that is known its header goes nowhere.
        """
        store = self._parts.store
        husks = await store.remains([debt.spot for debt in rotten])
        left = [(debt, husk) for debt, husk in zip(rotten, husks, strict=True) if husk is not None]
        left = [(debt, husk) for debt, husk in left if store.noticed.is_given_up(debt.spot) or not self._ledger.is_unsettled(debt)]
        told = [(debt, item_of(debt.spot, husk)) for debt, husk in left if version_of(husk.header_bytes) == debt.version]
        over = [debt for debt, husk in zip(rotten, husks, strict=True) if husk is None and store.noticed.is_given_up(debt.spot)]
        reasons = await self._ask(member, told) if told else ()
        over += [
            debt
            for (debt, _), reason in zip(told, reasons, strict=True)
            if reason == 0 or (reason == RejectReason.DAMAGED and store.noticed.is_given_up(debt.spot))
        ]
        for debt in over:
            self._ledger.has_got(member, debt, is_husk=True)
        await store.paid([(debt.spot, debt.version, self._node) for debt in over])
        return len(rotten) - len(over)

    async def _send(self, member: Member, found: Sequence[tuple[Debt, HandItem]], size: int) -> int:
        await self._parts.budget.take(size)
        reasons = await self._ask(member, found)
        taken = [debt for (debt, _), reason in zip(found, reasons, strict=True) if reason == 0]
        for debt in taken:
            self._ledger.has_got(member, debt)
        self._parts.events["debts paid"] += len(taken)
        await self._parts.store.paid([(debt.spot, debt.version, self._node) for debt in taken])
        return len(found) - len(taken)

    async def _ask(self, member: Member, found: Sequence[tuple[Debt, HandItem]]) -> Sequence[int]:
        items = [item for _, item in found]
        packet = StoreCopies(self._parts.own.member, tuple(items))
        try:
            reply = await self._parts.peers.ask(self._node, Priority.LOW, packet, CopiesStored, ASK_S_MAX)
        except Unreachable:
            self._lane.size.answered(in_time=False)
            raise
        self._lane.size.answered(in_time=True)
        if len(reply.reasons) != len(items):
            raise PeerFault("a holder answered for another number of records", where=address_of(self._node))
        if self._ledger.member_at(self._node) != member:
            raise Unreachable("the holder has another incarnation now", where=address_of(self._node))
        self._disk.answered([len(item.ciphertext) + RECORD_BYTES for item in items], reply.reasons)
        self._offered = record_key(*found[-1][0].spot)
        if RejectReason.STORAGE_FULL in reply.reasons:
            self._full.note(member)
        return reply.reasons

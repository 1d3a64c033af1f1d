"""The one place where a node's holding changes, and what it keeps about copies with it: one change at a time, durable before anybody sees it.

A life that ends because the store has a new incarnation keeps nothing more: the store refuses it.

Before each change, handovers with incarnations that the log has removed are dropped (but for pieces that can be taken
back), so no decision is made beside what the log says. The mirror in memory (`holding`, and the arc that this node tells others) follows the disk.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Protocol

import trio

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.copies.copies import Copies, Passing
from scenefold.peer.copies.copies_note import check_copies, decode_copies, encode_copies
from scenefold.peer.line.holding import Holding
from scenefold.peer.line.holding_note import decode_holding, encode_holding
from scenefold.peer.membership.status import OwnStatus
from scenefold.store import Store
from scenefold.wire import Member

Transition = Callable[[Holding], Holding]
CopiesTransition = Callable[[Copies, Holding], Copies]


class Log(Protocol):
    @property
    def registry(self) -> Registry: ...


class Keeper:
    """Used from the Trio thread only."""

    def __init__(self, store: Store, cluster_log: Log, own: OwnStatus) -> None:
        self._store = store
        self._cluster_log = cluster_log
        self._own = own
        self._lock = trio.Lock()
        self._changed = trio.Event()
        self._is_begun = False
        self.require_arrival: Callable[[], None] = lambda: None
        """Refused (16) before a new incarnation may own or hold anything."""
        self.holding = Holding()
        self.copies = Copies.of(own.member)

    async def load(self) -> None:
        """Take what this node kept. DamagedData if its note is none, or speaks of another arc than the store does."""
        stored = await self._store.holding()
        if stored is None:
            return
        holding = decode_holding(stored.note)
        if holding.arc != stored.arc:
            raise DamagedData(
                "the note about this node's arc does not fit the arc", remedy="wipe the folder: the node comes back as a newcomer"
            )
        copies = Copies.of(self._own.member) if stored.copies is None else decode_copies(stored.copies, self._own.member)
        self._is_begun = True
        self._take(holding, copies)

    async def change(self, transition: Transition, told: Passing | None = None) -> Holding:
        """Make a change durable, and answer the holding after it. What the transition refuses changes nothing.

        `told`: what the giver of a piece that is claimed has said of its copies.
        """
        async with self._lock:
            await self._begin()
            after = transition(self.holding.drop_removed(self.is_removed))
            if after != self.holding:
                await self._keep(after, self.copies.follow(self.holding, after, told))
            return after

    async def change_copies(self, transition: CopiesTransition) -> Copies:
        """Make a change of what is kept about copies durable, and answer it as it is then. The holding stands still meanwhile."""
        async with self._lock:
            await self._begin()
            after = transition(self.copies, self.holding)
            if after != self.copies:
                await self._keep(self.holding, after)
            return self.copies

    async def flush(self) -> None:
        """Return once everything that was given to the store's writer before is durable. Cancelled, it changes nothing either."""
        async with self._lock:
            # Not shielded: on a slow disk a frozen piece would stay so for a whole commit longer than its writers were promised.
            await self._store.put_holding(self.holding.arc, encode_holding(self.holding))

    @asynccontextmanager
    async def unchanging(self) -> AsyncIterator[Holding]:
        """The holding, which stands still as long as the body runs: for what must not race with a change."""
        async with self._lock:
            yield self.holding

    async def changed_after(self, revision: int) -> None:
        """Return once the holding is another than it was at this revision."""
        while self.holding.revision == revision:
            await self._changed.wait()

    async def copies_changed_after(self, seen: Copies) -> None:
        """Return once what is kept about copies is another value than this."""
        while self.copies is seen:
            await self._changed.wait()

    async def _begin(self) -> None:
        """The first holding of this incarnation: a founder's arc if it took its founding seat, else nothing."""
        registry = self._cluster_log.registry
        if not registry.is_current(self._own.member):
            raise Refused(RejectReason.NOT_READY, "this node is no registered member, as far as it knows")
        if self._is_begun:
            return
        self.require_arrival()
        arc = registry.founding_arc(self._own.me)
        # Nobody can have owned a founding arc before.
        await self._keep(Holding() if arc is None else Holding().found(arc), Copies.of(self._own.member))
        self._is_begun = True

    def is_removed(self, member: Member) -> bool:
        """Whether the log, as far as it is known here, has removed this incarnation."""
        # Not "is no current member": a log that is behind does not know its newest members yet.
        return self._cluster_log.registry.removal(member.incarnation) is not None

    async def _keep(self, holding: Holding, copies: Copies) -> None:
        is_new = copies != self.copies or not self._is_begun
        if is_new:
            try:
                check_copies(copies)
            except ValueError as problem:
                what = f"what this node would keep about copies is nothing that it could read again ({problem}): somebody told it so"
                raise Refused(RejectReason.ILL_FORMED, what) from problem
        # Cancelled half-way, nobody would know what the disk says.
        with trio.CancelScope(shield=True):
            note = encode_copies(copies) if is_new else None
            await self._store.put_holding(holding.arc, encode_holding(holding), note)
        self._take(holding, copies)

    def _take(self, holding: Holding, copies: Copies) -> None:
        # Said at once, before the next look at the load: what was adopted would seem to be little.
        self._own.recovers |= bool(copies.unrecovered) and not self.copies.unrecovered
        self.holding = holding
        self.copies = copies
        self._own.arc = holding.arc
        self._changed.set()
        self._changed = trio.Event()

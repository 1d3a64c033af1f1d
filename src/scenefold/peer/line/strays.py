"""Records that lie where they no longer belong are brought home, slowly (specs/12-line.md, Strays).

A stray is deleted here only after the owner of its place has answered for it, as that version or a newer one (taking_home.py).

What lies in a piece that has just left is let alone for a while if it is of a space with copies: who gave a piece often is to hold it.

What cannot be written on a full disk (to delete is to write) is left for a later look, and holds up nothing else.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial

import trio

from scenefold.base.cover import without
from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import Arc
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record
from scenefold.peer.copies.custody import Custody
from scenefold.peer.copies.versions import told_version
from scenefold.peer.handlers import Handlers
from scenefold.peer.line.copying import hand_item
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.rightful import NO_COPIES, layout_of, rightful
from scenefold.peer.line.settling import Settling
from scenefold.peer.line.taking_home import TakingHome
from scenefold.store import Entry, Spot
from scenefold.wire import HandRecords, HeldRecord, OfferStrays, PutManyReply, StraysJudged
from scenefold.world import Priority, first_of

BATCH_RECORDS = 32
"""Of one HandRecords: 2 MiB of the largest records."""
ASK_S_MAX = 30.0
PAUSE_S_MIN = 1.0
PAUSE_S_MAX = 60.0
BUSY_S_MAX = 5.0
"""What an owner cannot answer for yet, as it does not know who holds copies there, or waits for these, it can in a moment."""
LEFT_S = 30.0
"""For the new owner of a piece to say that its giver holds copies of it."""

_log = logging.getLogger("scenefold.peer.line")


class Strays:
    """Used from the Trio thread only. `left`: strays that the last look through the store found and left."""

    def __init__(self, parts: Parts, is_leaving: Callable[[], bool] = lambda: False) -> None:
        """`is_leaving`: whether this node is to hold nothing any more."""
        self._parts = parts
        self._is_leaving = is_leaving
        self.left = 0
        self._damaged = 0
        self._waits_s = PAUSE_S_MAX
        """Until some of which nothing came now are worth another look."""
        self._kept: list[Arc] = []
        self._left_lately = Settling(parts.world.clock, LEFT_S)
        self._taking_home = TakingHome(parts)

    def register(self, handlers: Handlers) -> None:
        self._taking_home.register(handlers)

    async def run(self) -> None:
        """Look through the store again and again, more seldom while there is nothing to bring home, until cancelled."""
        await self._parts.arrival.done()
        keeper = self._parts.keeper
        pause_s, known = PAUSE_S_MIN, (0, keeper.copies.custody)
        while True:
            self._waits_s = PAUSE_S_MAX
            moved = await self._look()
            # Who owned a place may have been removed: whoever adopts it must not lack for long what is here.
            position, custody = self._parts.cluster_log.registry.position, keeper.copies.custody
            pause_s = PAUSE_S_MIN if moved or (position, custody) != known else min(PAUSE_S_MAX, 2 * pause_s)
            known = position, custody
            with trio.move_on_after(min(pause_s, self._waits_s)):
                something_new = partial(self._parts.something_new, keeper.holding.revision, position)
                await first_of(something_new, partial(self._custody_changed, custody))
                # What has just changed may have left something; but its handover comes first.
                await self._parts.world.clock.sleep(PAUSE_S_MIN)

    async def _custody_changed(self, seen: Custody) -> None:
        while self._parts.keeper.copies.custody is seen:
            await self._parts.keeper.copies_changed_after(self._parts.keeper.copies)

    async def _look(self) -> int:
        """One walk over all strays; how many were brought home."""
        moved = seen = 0
        self._damaged = 0
        # Asked once a look: with many strays of an owner that is away, those of all others would wait for its time to run out.
        silent: set[NodeId] = set()
        cursor: bytes | None = None
        while True:
            self._note_left()
            first = cursor is None
            manifest = await self._parts.store.strays(await rightful(self._parts), cursor, BATCH_RECORDS)
            cursor = manifest.cursor
            found = [*manifest.entries, *(await self._misplaced() if first else ())]
            seen += len(found)
            await self._discard(manifest.damaged)
            for owner, entries in self._by_owner([entry for entry in found if not await self._waits(entry)]):
                if owner in silent:
                    continue
                try:
                    moved += await self._bring_home(owner, entries)
                except (Refused, Unreachable, PeerFault) as problem:
                    if isinstance(problem, Unreachable):
                        silent.add(owner)
                    _log.debug("strays stay here for now, %s does not take them: %s", address_of(owner), problem)
            if cursor is None:
                # What has rotten here nobody can take: it is deleted, now or once there is room, and holds nobody up.
                self.left = seen - moved - self._damaged
                return moved

    async def _misplaced(self) -> list[Entry]:
        """Objects that lie in what is kept here though others decide about them. Our own that lie elsewhere slide into the arc."""
        async with self._parts.keeper.unchanging() as holding:
            if holding.arc is not None and not holding.handovers and await self._parts.store.parted(holding.arc):
                with self._as_far_as_there_is_room():
                    await self._parts.store.slide([holding.arc])
            held = self._parts.keeper.copies.custody.entries
            if held and not holding.handovers and await self._parts.store.beside(await rightful(self._parts)):
                # A giver has them where it had put them as their owner, and that place may be its own again.
                with self._as_far_as_there_is_room():
                    await self._parts.store.slide([entry.arc for entry in held])
            return await self._parts.store.misplaced(await rightful(self._parts), BATCH_RECORDS)

    def _note_left(self) -> None:
        """Which pieces have left since the last look."""
        kept = self._parts.keeper.holding.kept
        for piece in self._kept:
            gone = [piece]
            for other in kept:
                gone = [left for part in gone for left in without(part, other)]
            for part in gone:
                self._left_lately.note(part)
        self._kept = kept

    async def _waits(self, entry: Entry) -> bool:
        """Whether it may well be told that this node holds it."""
        left_s = self._left_lately.settles_in_s(Arc(entry.home, entry.home))
        if not left_s or self._is_leaving() or await layout_of(self._parts, *entry.place[:2]) == NO_COPIES:
            return False
        self._waits_s = min(self._waits_s, left_s)
        return True

    def _by_owner(self, entries: Sequence[Entry]) -> list[tuple[NodeId, list[Entry]]]:
        owners: dict[NodeId, list[Entry]] = {}
        for entry in entries:
            try:
                owner = self._parts.owners.owner_of(entry.home)
            except Refused:
                # Nobody is known yet, at the start.
                continue
            if owner != self._parts.own.me:
                owners.setdefault(owner, []).append(entry)
        return sorted(owners.items())

    async def _bring_home(self, owner: NodeId, entries: Sequence[Entry]) -> int:
        parts = self._parts
        custody = parts.keeper.copies.custody
        taken, wanted = await self._offered(owner, entries)
        with parts.carrying.begun():
            taken += await self._handed(owner, wanted)
        async with parts.keeper.unchanging():
            now = await rightful(parts)
            # Whoever was made a holder since the owner was asked holds what lies here already, of whatever layout its space is by now.
            new = [held for held in parts.keeper.copies.custody.entries if held not in custody.entries]
            strays = [entry for entry in taken if now.is_stray(entry.place[:2], entry.home)]
            gone = [(entry.spot, entry.digest) for entry in strays if not any(entry.home in held.arc for held in new)]
            if gone:
                await parts.store.remove(gone)
        parts.events["brought home"] += len(gone)
        return len(gone)

    async def _offered(self, owner: NodeId, entries: Sequence[Entry]) -> tuple[list[Entry], list[Entry]]:
        """Which of them the owner answers for as it is, and which are to be brought. Of spaces without copies it is not asked."""
        asked = [entry for entry in entries if await layout_of(self._parts, *entry.place[:2]) != NO_COPIES]
        if not asked:
            return [], list(entries)
        headers = await self._parts.store.record_headers([entry.spot for entry in asked])
        told = {
            entry: HeldRecord(*entry.place, entry.object, told_version(header))
            for entry, header in zip(asked, headers, strict=True)
            if header
        }
        reply = await self._parts.peers.ask(owner, Priority.LOW, OfferStrays(tuple(told.values())), StraysJudged, ASK_S_MAX)
        reasons = dict(zip(told, reply.reasons, strict=False))
        if not {RejectReason.BUSY, RejectReason.TOO_FEW_COPIES}.isdisjoint(reply.reasons):
            self._waits_s = min(self._waits_s, BUSY_S_MAX)
        # What is not told of is brought all the same: its header has rotted since, and it is found to be so.
        wanted = [entry for entry in entries if reasons.get(entry, RejectReason.PEER_MISSED) == RejectReason.PEER_MISSED]
        return [entry for entry, reason in reasons.items() if reason == 0], wanted

    async def _handed(self, owner: NodeId, entries: Sequence[Entry]) -> list[Entry]:
        """Bring them; those that the owner then answers for."""
        parts = self._parts
        found = await parts.store.read([entry.spot for entry in entries])
        rotten = [entry.spot for entry, record in zip(entries, found, strict=True) if isinstance(record, DamagedData)]
        self._damaged += len(rotten)
        await self._discard(rotten)
        whole = [(entry, record) for entry, record in zip(entries, found, strict=True) if isinstance(record, Record)]
        whole = [(entry, record) for entry, record in whole if record.header.digest == entry.digest]
        if not whole:
            return []
        size = sum(entry.size for entry, _ in whole)
        await parts.budget.take(size)
        parts.events["brought home bytes"] += size
        request = HandRecords(tuple(hand_item(entry, record) for entry, record in whole))
        reply = await parts.peers.ask(owner, Priority.LOW, request, PutManyReply, ASK_S_MAX)
        for (entry, _), outcome in zip(whole, reply.outcomes, strict=False):
            if outcome.reason == RejectReason.BUSY and await layout_of(parts, *entry.place[:2]) != NO_COPIES:
                # It need not be sent again.
                self._waits_s = min(self._waits_s, BUSY_S_MAX)
        return [entry for (entry, _), outcome in zip(whole, reply.outcomes, strict=False) if outcome.reason == 0]

    async def _discard(self, spots: Sequence[Spot]) -> None:
        """Delete damaged records that are not ours: nobody would take them, and they would be looked at for ever."""
        if not spots:
            return
        async with self._parts.keeper.unchanging():
            now = await rightful(self._parts)
            with self._as_far_as_there_is_room():
                strays = [spot for spot in spots if now.is_stray(spot.place[:2], spot.home)]
                gone = await self._parts.store.discard(strays)
                self._parts.events["damaged strays discarded"] += gone

    @contextmanager
    def _as_far_as_there_is_room(self) -> Iterator[None]:
        """A full disk is met by every look anew, until there is room."""
        try:
            yield
        except Refused as refusal:
            if refusal.reason is not RejectReason.STORAGE_FULL:
                raise
            self._parts.events["strays stay: disk full"] += 1
            _log.debug("strays stay here for now: %s", refusal)

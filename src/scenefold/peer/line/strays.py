"""Records that lie where they no longer belong are brought home, slowly (specs/12-line.md, Strays).

A stray is deleted here only after the owner of its place has answered for it, as that version or a newer one. Whoever
owns a place takes it like a put: under its lease, in its arc, behind the gate that handovers freeze. It answers for none that lies
where its copies belong: whoever brings it then does not know yet what it holds.

What lies in a piece that has just left is let alone for a while if it is of a space with copies: who gave a piece often is to hold it.

What cannot be written on a full disk (to delete is to write) is left for a later look, and holds up nothing else.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import trio

from scenefold.base.cover import without
from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import Arc
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record
from scenefold.peer.handlers import Handlers, Senders, node_of
from scenefold.peer.holdings import no_lease
from scenefold.peer.line.copying import hand_item
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.receiving import spot_of_item, verified
from scenefold.peer.line.rightful import NO_COPIES, layout_of, rightful
from scenefold.peer.line.settling import Settling
from scenefold.peer.records.copying import NotKept
from scenefold.peer.records.verification import home_of
from scenefold.store import Entry, Outcome, Put, PutResult, Spot
from scenefold.wire import HandItem, HandRecords, Packet, PutManyReply, PutOutcome, SceneMode
from scenefold.world import Priority

BATCH_RECORDS = 32
"""Of one HandRecords: 2 MiB of the largest records."""
ASK_S_MAX = 30.0
PAUSE_S_MIN = 1.0
PAUSE_S_MAX = 60.0
LEFT_S = 60.0
"""For the new owner of a piece to say that its giver holds copies of it."""
GATE_S_MAX = 2.0
"""For a place to thaw; the sender comes back later."""

_log = logging.getLogger("scenefold.peer.line")


class Strays:
    """Used from the Trio thread only. `left`: strays that the last look through the store found and left."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        self.left = 0
        self._damaged = 0
        self._kept: list[Arc] = []
        self._left_lately = Settling(parts.world.clock, LEFT_S)

    def register(self, handlers: Handlers) -> None:
        handlers.add(HandRecords, self._on_hand, senders=Senders.NODES)

    async def run(self) -> None:
        """Look through the store again and again, more seldom while there is nothing to bring home, until cancelled."""
        pause_s, known = PAUSE_S_MIN, 0
        while True:
            moved = await self._look()
            position = self._parts.cluster_log.registry.position
            pause_s = PAUSE_S_MIN if moved or position != known else min(PAUSE_S_MAX, 2 * pause_s)
            # Who owned a place may have been removed: whoever adopts it must not lack for long what is here.
            known = position
            with trio.move_on_after(pause_s):
                await self._parts.something_new(self._parts.keeper.holding.revision, position)
                # What has just changed may have left something; but its handover comes first.
                await self._parts.world.clock.sleep(PAUSE_S_MIN)

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
        if not self._left_lately.settles_in_s(Arc(entry.home, entry.home)):
            return False
        return await layout_of(self._parts, *entry.place[:2]) != NO_COPIES

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
        found = await parts.store.read([entry.spot for entry in entries])
        rotten = [entry.spot for entry, record in zip(entries, found, strict=True) if isinstance(record, DamagedData)]
        self._damaged += len(rotten)
        await self._discard(rotten)
        whole = [(entry, record) for entry, record in zip(entries, found, strict=True) if isinstance(record, Record)]
        whole = [(entry, record) for entry, record in whole if record.header.digest == entry.digest]
        if not whole:
            return 0
        await parts.budget.take(sum(entry.size for entry, _ in whole))
        request = HandRecords(tuple(hand_item(entry, record) for entry, record in whole))
        reply = await parts.peers.ask(owner, Priority.LOW, request, PutManyReply, ASK_S_MAX)
        taken = [entry for (entry, _), outcome in zip(whole, reply.outcomes, strict=False) if outcome.reason == 0]
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

    # -------------------------------------------------------------------------------------------------- handler

    async def _on_hand(self, packet: HandRecords, peer: str) -> Packet:
        verdicts = await verified(self._parts, packet.items)
        problems = [
            verdict if isinstance(verdict, Refused) else await self._why_stays(item, peer)
            for item, verdict in zip(packet.items, verdicts, strict=True)
        ]
        open_ones = [(index, verdict) for index, verdict in enumerate(verdicts) if problems[index] is None and isinstance(verdict, Put)]
        taken = await self._take([packet.items[index] for index, _ in open_ones], [put for _, put in open_ones])
        for (index, _), problem in zip(open_ones, taken, strict=True):
            problems[index] = problem
        outcomes = [
            PutOutcome(0, item.location, NodeId(0))
            if problem is None
            else PutOutcome(int(problem.reason), item.location, self._parts.own.me)
            for item, problem in zip(packet.items, problems, strict=True)
        ]
        return PutManyReply(tuple(map(self._still_so, packet.items, outcomes)))

    async def _why_stays(self, item: HandItem, peer: str) -> Refused | None:
        """Refused (13) if who brings it is counted on to have it: it would delete a copy, not a stray."""
        layout = await layout_of(self._parts, item.scene, item.space)
        copies, node = self._parts.keeper.copies.configurations, node_of(peer)
        segment = None if layout is None else copies.at(layout, home_of(item))
        if segment is not None and any(member.node == node for member in segment.counted_on(copies.me)):
            return Refused(RejectReason.BUSY, "it lies by right where it comes from", remedy="let the owner say so")
        return None

    def _still_so(self, item: HandItem, outcome: PutOutcome) -> PutOutcome:
        """What is said of an item at this very moment: while later ones waited, the place or the lease may have gone."""
        parts = self._parts
        if outcome.reason or (parts.keeper.holding.owns(home_of(item)) and parts.lease.holds()):
            return outcome
        return PutOutcome(int(RejectReason.BUSY), outcome.location, parts.own.me)

    async def _take(self, items: Sequence[HandItem], puts: Sequence[Put]) -> list[Refused | None]:
        """Why each is not to be had; None: this or a newer version is durable here, and where else its space asks for it."""
        parts = self._parts
        problems: list[Refused | None] = [Refused(RejectReason.BUSY, "the place is being handed over")] * len(items)
        with trio.move_on_after(GATE_S_MAX if items else 0) as patience:
            async with parts.writing(list(map(home_of, items)), anywhere=any(item.object for item in items)):
                patience.deadline = float("inf")
                problems = [await self._why_not(item) for item in items]
                open_ones = [index for index, problem in enumerate(problems) if problem is None]
                # All at once, so that they settle together.
                for index, result in zip(open_ones, await parts.keeping.merge([puts[index] for index in open_ones]), strict=True):
                    problems[index] = self._judged(items[index], result)
        return problems

    async def _why_not(self, item: HandItem) -> Refused | None:
        try:
            if not self._parts.keeper.holding.owns(home_of(item)):
                raise Refused(RejectReason.NOT_MY_LOCATION, "the place is not this node's")
            self._parts.require_lease()
            await self._check_mode(item)
        except Refused as refusal:
            return refusal
        return None

    def _judged(self, item: HandItem, result: PutResult | NotKept) -> Refused | None:
        if isinstance(result, NotKept):
            return Refused(result.reason, "too few of those that are to have it have it")
        if result.has_changed:
            # What was here already has settled: whoever brings it again and again must not keep us from giving it away.
            home = home_of(item)
            self._parts.settling.note(Arc(home, home))
        if result.outcome not in (Outcome.STORED, Outcome.STALE):
            return Refused(result.reason or RejectReason.STORAGE_FULL, f"it cannot be kept: {result.outcome.value}")
        if not self._parts.lease.holds():
            return no_lease()
        self._parts.events["taken home"] += 1
        return None

    async def _check_mode(self, item: HandItem) -> None:
        """While a scene is rendered, a stray may fill an empty place and replaces nothing."""
        scene = await self._parts.scenes.known(item.scene)
        if scene.public.mode is SceneMode.EDIT:
            return
        (present,) = await self._parts.store.read([spot_of_item(item)])
        if isinstance(present, Record):
            raise Refused(RejectReason.BUSY, "the scene is being rendered: nothing in it is replaced")

"""What a lying node does as one who holds copies for others, and as one for whom others hold them (specs/17-simulation.md, Lies).

As a holder it says that it has what it has not, names what there is not, leaves out what there is, and gives others than were asked for. As
an owner it sends records that it has altered, lets strays go that it has not, and says to others what to hold of what is a third one's.
Whatever it says of a place is worth nothing from then on: its disk counts there as if it were gone. All that nobody may believe at all
is looked for in what others keep.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.location import Arc
from scenefold.crypto import RecordHeader
from scenefold.peer import NodeContext
from scenefold.peer.copies.numbers import first_number
from scenefold.simulation import laws
from scenefold.simulation.history import Place
from scenefold.simulation.liar import PACKETS, WAYS, Liar, Scope
from scenefold.simulation.lies import Manner, whole
from scenefold.simulation.lying_answers import Honest, overlay
from scenefold.simulation.recording import named
from scenefold.simulation.watch import Watch
from scenefold.wire import (
    ArcSum,
    CompareRange,
    CopiesFound,
    CopiesStored,
    Copy,
    CopyState,
    CustodyEntry,
    CustodySet,
    FetchHeld,
    GetCopies,
    HandItem,
    HeldFetched,
    HeldListed,
    HeldRecord,
    ListHeld,
    OfferStrays,
    Packet,
    RangeCompared,
    RecordBytes,
    RecordVersion,
    SetCustody,
    StoreCopies,
    StraysJudged,
)
from scenefold.world import Priority

INTRUDE_S_MAX = 2.0
AHEAD = 1_000
"""Sequence numbers by which a version is ahead that there is not."""
REFUSED = 16


class LyingCopies:
    """Of one liar. `lie`: whether a node lies about copies itself, so that its word for what it keeps is worth nothing; `believe`: whether a
    node has the liar's own word that it owns an arc, which may be an old one."""

    def __init__(self, liar: Liar, watch: Watch, lie: Callable[[int], bool], believe: Callable[[int, Arc], bool]) -> None:
        self._liar = liar
        self._lie = lie
        self._believe = believe
        self._watch = watch
        self._slot = liar.node.slot
        self._context: NodeContext | None = None
        self._ask: Any = None

    def possess(self, context: NodeContext) -> None:
        """Hold, and have held, for one life of the node."""
        for packet, twist in (
            (StoreCopies, self._store),
            (CompareRange, self._compare),
            (FetchHeld, self._fetch),
            (ListHeld, self._list),
            (GetCopies, self._get),
            (OfferStrays, self._judge),
        ):
            overlay(context, packet, twist)
        peers: Any = context.peers
        ask = self._ask = peers.ask
        self._context = context

        async def send(member: int, priority: Any, packet: Packet, *rest: Any) -> Packet:
            if isinstance(packet, StoreCopies) and self._liar.lies_in(Scope.COPIES):
                return await self._send(ask, member, priority, packet, *rest)
            answer: Packet = await ask(member, priority, packet, *rest)
            return answer

        peers.ask = send

    def _lies_about(self, place: Place) -> None:
        """What it says of this is none of what lies on its disk."""
        self._liar.lies.told["about copies"] += 1
        self._watch.lied_about_copy(self._slot, place)

    def _chance(self) -> bool:
        return self._liar.chance(Scope.COPIES)

    # ----------------------------------------------------------------------------------------------------- holder

    async def _store(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        """Some are not kept, and it says that they are."""
        if not isinstance(packet, StoreCopies) or not self._liar.lies_in(Scope.COPIES):
            return await honest(packet, peer)
        for item in packet.items:
            self._saw(item)
        dropped = [index for index in range(len(packet.items)) if self._chance()]
        for index in dropped:
            self._lies_about(named(packet.items[index])[0])
        kept = [index for index in range(len(packet.items)) if index not in dropped]
        reasons, text = dict.fromkeys(dropped, 0), ""
        if kept:
            answer = await honest(replace(packet, items=tuple(packet.items[index] for index in kept)), peer)
            if not isinstance(answer, CopiesStored):
                return answer
            reasons.update(zip(kept, answer.reasons, strict=True))
            text = answer.text
        return CopiesStored(tuple(reasons[index] for index in range(len(packet.items))), text)

    async def _compare(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        answer = await honest(packet, peer)
        if not isinstance(packet, CompareRange) or not isinstance(answer, RangeCompared) or not self._liar.lies_in(Scope.COPIES):
            return answer
        return RangeCompared(tuple(self._sum(packet, told) if self._chance() else told for told in answer.sums))

    def _sum(self, packet: CompareRange, told: ArcSum) -> ArcSum:
        if told.records is None:
            # Of a sum nobody knows what it is about: whatever follows from it is asked for again.
            return replace(told, sum=self._liar.dice.randbytes(len(told.sum)), count=told.count + self._liar.dice.randrange(3))
        records = []
        for record in told.records:
            if self._chance():
                self._lies_about(Place(packet.scene, packet.space, record.object or record.location))
                if self._liar.dice.random() < 0.5:
                    continue
                records.append(replace(record, version=self._other(record.version)))
            else:
                records.append(record)
        return replace(told, records=tuple(records), count=len(records), whole=True)

    def _other(self, version: RecordVersion) -> RecordVersion:
        """One that there is not."""
        step = self._liar.dice.choice((-1, AHEAD))
        return replace(version, seq=max(0, version.seq + step), digest=self._liar.dice.randbytes(len(version.digest)))

    async def _fetch(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        answer = await honest(packet, peer)
        if not isinstance(answer, HeldFetched) or not self._liar.lies_in(Scope.COPIES):
            return answer
        return replace(answer, items=tuple(self._altered(item) if self._chance() else item for item in answer.items))

    def _altered(self, item: HandItem) -> HandItem:
        place, _ = named(item)
        self._lies_about(place)
        record = RecordBytes(item.signature, item.header, item.ciphertext)
        wrong = self._liar.older(place, record) or self._liar.wrong(place, record, self._liar.dice.randrange(WAYS))
        self._saw(item)
        return replace(item, signature=wrong.signature, header=wrong.header, ciphertext=wrong.ciphertext)

    async def _list(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        """It names what there is not, leaves out what there is, and sometimes goes on without an end."""
        answer = await honest(packet, peer)
        if not isinstance(packet, ListHeld) or not isinstance(answer, HeldListed) or answer.reason or not self._liar.lies_in(Scope.COPIES):
            return answer
        records: list[HeldRecord] = []
        for record in answer.records:
            if self._chance():
                self._lies_about(Place(record.scene, record.space, record.object or record.location))
                if self._liar.dice.random() < 0.5:
                    continue
                record = replace(record, version=self._other(record.version))
            records.append(record)
        match self._liar.dice.randrange(8) if self._chance() else 8:
            case 0:
                return replace(answer, records=tuple(reversed(records)))
            case 1:
                return replace(answer, records=tuple(records), next=packet.after or b"\0")
            case 2:
                numbered = tuple(replace(entry, number=first_number(packet.log_position) + 1) for entry in answer.entries)
                return replace(answer, records=tuple(records), entries=numbered)
            case 3:
                return replace(answer, records=tuple(records), entries=tuple(map(self._of_the_same_number, answer.entries)))
            case _:
                return replace(answer, records=tuple(records), next=answer.next if records or answer.entries else None)

    def _of_the_same_number(self, entry: CustodyEntry) -> CustodyEntry:
        """Another configuration than the one that was, with its number: whoever hears both cannot tell which was."""
        owner, *holders = entry.members
        mine = [member for member in holders if self._context is not None and member.node == self._context.me]
        return replace(entry, members=(owner, *mine), needed=1) if entry.whole and mine else entry

    async def _get(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        answer = await honest(packet, peer)
        if not isinstance(packet, GetCopies) or not isinstance(answer, CopiesFound) or not self._liar.lies_in(Scope.COPIES):
            return answer
        copies = []
        for key, copy in zip(packet.keys, answer.copies, strict=False):
            place = Place(packet.scene, key.space, key.object or key.location)
            is_lie = copy.state is not CopyState.NO_CUSTODY and self._chance()
            copies.append(self._copy(place, copy, peer) if is_lie else copy)
        if self._chance():
            # Alone it would be enough.
            alone = tuple(replace(found, number=found.number + 1, members=found.members[:2], needed=2) for found in answer.holders)
            return replace(answer, holders=alone, copies=tuple(copies))
        return replace(answer, copies=tuple(copies))

    def _copy(self, place: Place, copy: Copy, peer: str) -> Copy:
        self._lies_about(place)
        if copy.record is None:
            return replace(copy, state=CopyState.NOTHING, digest=b"")
        older = self._liar.older(place, copy.record)
        self._liar.saw(place, copy.record)
        match self._liar.dice.randrange(3):
            case 0:
                return Copy(CopyState.NOTHING, copy.holders, b"", None)
            case 1 if older is not None:
                self._liar.tells(peer, place, Manner.OLDER, RecordHeader.decode(older.header).digest)
                return replace(copy, record=older)
            case _:
                wrong = self._liar.wrong(place, copy.record, self._liar.dice.randrange(WAYS))
                self._liar.tells(peer, place, Manner.NONSENSE, whole(wrong))
                return replace(copy, record=wrong)

    # ------------------------------------------------------------------------------------------------------ owner

    async def _judge(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        """It lets strays go that it has not."""
        answer = await honest(packet, peer)
        if not isinstance(packet, OfferStrays) or not isinstance(answer, StraysJudged) or not self._liar.lies_in(Scope.COPIES):
            return answer
        reasons = list(answer.reasons)
        for index, record in enumerate(packet.records[: len(reasons)]):
            place = Place(record.scene, record.space, record.object or record.location)
            if reasons[index] and self._liar.decides(place.home) and self._chance():
                self._lies_about(place)
                reasons[index] = 0
        return StraysJudged(tuple(reasons))

    async def _send(self, ask: Any, member: int, priority: Any, packet: StoreCopies, *rest: Any) -> Packet:
        """Mostly one record of a packet is a lie."""
        items, wrong = list(packet.items), -1
        if items and self._liar.dice.random() < PACKETS:
            wrong = self._liar.dice.randrange(len(items))
            item = items[wrong]
            record = RecordBytes(item.signature, item.header, item.ciphertext)
            made = self._liar.wrong(named(item)[0], record, self._liar.dice.randrange(WAYS))
            items[wrong] = replace(item, signature=made.signature, header=made.header, ciphertext=made.ciphertext)
            self._liar.lies.told["altered among copies"] += 1
        is_liar = self._lie(member)
        answer: Packet = await ask(member, priority, replace(packet, items=tuple(items)), *rest)
        if wrong < 0 or not isinstance(answer, CopiesStored) or wrong >= len(answer.reasons):
            return answer
        if answer.reasons[wrong] == 0 and not (is_liar or self._lie(member)):
            place, _ = named(packet.items[wrong])
            words = f"a holder keeps what n{self._slot} altered of {place.location.hex()[:8]}…"
            self._watch.violated(laws.VERIFIED, words, location=place.location, slots=(self._slot,))
        reasons = list(answer.reasons)
        reasons[wrong] = reasons[wrong] or REFUSED
        return replace(answer, reasons=tuple(reasons))

    async def intrude(self) -> None:
        """Say to somebody that it is to hold what is a third one's, or hold something under a number that nobody can have come to."""
        context = self._context
        if context is None or context is not self._liar.node.context:
            return
        me, position = context.own.member, context.cluster_log.registry.position
        arcs = {node: arc for node, arc in context.roster.arcs().items() if arc is not None and node != me.node}
        if len(arcs) < 2:
            return
        holder, victim = self._liar.dice.sample(sorted(arcs), 2)
        if context.own.arc is not None and self._liar.dice.random() < 0.3:
            words = f"something for n{self._slot} under a number that nobody can have come to"
            await self._set(context, holder, context.own.arc, first_number(position + AHEAD), words)
        else:
            await self._set(context, holder, arcs[victim], first_number(position) + 1, f"for n{self._slot} what is a third one's")

    async def _set(self, context: NodeContext, holder: NodeId, arc: Arc, number: int, words: str) -> None:
        me, current = context.own.member, context.cluster_log.registry.current(holder)
        layouts = [rule.layout for rule in self._watch.keeping.rules.values() if rule.layout]
        if current is None or not layouts:
            return
        member, was_own = type(me)(holder, current.incarnation), self._believe(holder, arc)
        entry = CustodyEntry(layouts[0], arc.first, arc.last, number, (me, member), 1, whole=True)
        packet = SetCustody(me, member, number, arc.first, arc.last, (entry,))
        self._liar.lies.told["wrong custody"] += 1
        with trio.move_on_after(INTRUDE_S_MAX):
            # It may be taken also if no answer comes.
            self._liar.lies.intruded.add((holder, me.node, number))
            try:
                answer = await self._ask(holder, Priority.LOW, packet, CustodySet, INTRUDE_S_MAX)
            except (Refused, Unreachable, PeerFault, RuntimeError):
                # The last: its life has ended in the midst of it, and with it what it asks by.
                return
            is_ahead = was_own and number >= first_number(context.cluster_log.registry.position + 1)
            is_wrong = is_ahead or not (was_own or self._believe(holder, arc))
            if answer.reason == 0 and is_wrong and not self._lie(holder):
                self._watch.violated(laws.VERIFIED, f"a node holds {words}", slots=(self._slot,))

    def _saw(self, item: HandItem) -> None:
        self._liar.saw(named(item)[0], RecordBytes(item.signature, item.header, item.ciphertext))

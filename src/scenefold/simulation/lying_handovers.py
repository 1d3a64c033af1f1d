"""What a lying node does while a piece of the line changes hands, as its giver and as its receiver (specs/17-simulation.md, Lies).

As a giver it leaves records out, gives older versions, altered ones, made-up ones, and ones of other places; as a receiver it says
that it has what it has not, and keeps nothing. Whoever keeps what was altered breaks a law; what is merely missing is reported.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import LINE_LENGTH, Location
from scenefold.peer import NodeContext
from scenefold.simulation import laws
from scenefold.simulation.history import Place
from scenefold.simulation.liar import PACKETS, WAYS, Liar, Scope, place_of_record
from scenefold.simulation.lies import STRAY
from scenefold.simulation.lying_answers import Honest, overlay
from scenefold.simulation.recording import named
from scenefold.simulation.watch import Watch
from scenefold.wire import (
    CopyRecords,
    HandItem,
    HandoverReply,
    HandRecords,
    OfferRecords,
    Packet,
    PutManyReply,
    RecordBytes,
    RecordEntry,
    RecordsWanted,
)
from scenefold.world import Priority

INTRUDE_S_MAX = 2.0


class LyingHandovers:
    """Of one liar. `lie`: whether a node lies in handovers itself, so that its word for what it keeps is worth nothing."""

    def __init__(self, liar: Liar, watch: Watch, lie: Callable[[int], bool]) -> None:
        self._liar = liar
        self._lie = lie
        self._lies = liar.lies
        self._watch = watch
        self._slot = liar.node.slot
        self._context: NodeContext | None = None
        self._ask: Any = None

    def possess(self, context: NodeContext) -> None:
        """Give and take for one life of the node."""
        overlay(context, OfferRecords, self._say_what_lacks)
        overlay(context, CopyRecords, self._take)
        peers: Any = context.peers
        ask = self._ask = peers.ask
        self._context = context

        async def give(member: int, priority: Any, packet: Packet, *rest: Any) -> Packet:
            if isinstance(packet, OfferRecords) and self._liar.lies_in(Scope.HANDOVERS):
                return await self._offer(ask, member, priority, packet, *rest)
            if isinstance(packet, CopyRecords | HandRecords) and self._liar.lies_in(Scope.HANDOVERS):
                return await self._hand(ask, member, priority, packet, *rest)
            answer: Packet = await ask(member, priority, packet, *rest)
            return answer

        peers.ask = give

    async def intrude(self) -> None:
        """Bring home to its owner what never was: a record that it has altered or made up."""
        record, context = self._liar.remembered(), self._context
        if record is None or context is None or context is not self._liar.node.context:
            return
        place = place_of_record(record)
        wrong = self._liar.wrong(place, record, self._liar.dice.randrange(WAYS))
        location, name = (place.home, place.location) if place.is_object else (Location(place.location), b"")
        item = HandItem(SceneId(place.scene), SpaceId(place.space), location, name, wrong.signature, wrong.header, wrong.ciphertext)
        self._lies.told["altered in a handover"] += 1
        with trio.move_on_after(INTRUDE_S_MAX):
            try:
                owner = context.routing.owner_of(place.home)
                is_liar = self._lie(owner)
                answer = await self._ask(owner, Priority.LOW, HandRecords((item,)), PutManyReply, INTRUDE_S_MAX)
            except (Refused, Unreachable, PeerFault, RuntimeError):
                # The last: its life has ended in the midst of it, and with it what it asks by.
                return
            if owner != context.me and _has_kept(answer, 0):
                self._complain(place, is_liar or self._lie(owner))

    def _complain(self, place: Place, is_a_liars_word: bool) -> None:
        if is_a_liars_word:
            return
        words = f"a node keeps what n{self._slot} altered of {place.location.hex()[:8]}… and handed over"
        self._watch.violated(laws.VERIFIED, words, location=place.location, slots=(self._slot,))

    # ---------------------------------------------------------------------------------------------------- receiver

    async def _say_what_lacks(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        answer = await honest(packet, peer)
        if not isinstance(packet, OfferRecords) or not isinstance(answer, RecordsWanted):
            return answer
        wanted = []
        for index in answer.indexes:
            if self._liar.chance(Scope.HANDOVERS):
                self._loses(packet.handover, packet.entries[index])
            else:
                wanted.append(index)
        return replace(answer, indexes=tuple(wanted))

    async def _take(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        if not isinstance(packet, CopyRecords) or not self._liar.lies_in(Scope.HANDOVERS):
            return await honest(packet, peer)
        kept = []
        for item in packet.items:
            self._saw(item)
            if self._liar.chance(Scope.HANDOVERS):
                place, version = named(item)
                self._lies.loses(self._slot, packet.handover, place, version.digest)
            else:
                kept.append(item)
        return await honest(replace(packet, items=tuple(kept)), peer)

    # ------------------------------------------------------------------------------------------------------- giver

    async def _offer(self, ask: Any, member: int, priority: Any, packet: OfferRecords, *rest: Any) -> Packet:
        kept = []
        for index, entry in enumerate(packet.entries):
            if self._liar.chance(Scope.HANDOVERS):
                self._loses(packet.handover, entry)
            else:
                kept.append(index)
        offered = replace(packet, entries=tuple(packet.entries[index] for index in kept))
        answer: Packet = await ask(member, priority, offered, *rest)
        if isinstance(answer, RecordsWanted):
            return replace(answer, indexes=tuple(kept[index] for index in answer.indexes if index < len(kept)))
        return answer

    async def _hand(self, ask: Any, member: int, priority: Any, packet: CopyRecords | HandRecords, *rest: Any) -> Packet:
        """Mostly one record of a packet is a lie: what was altered spoils all of it."""
        items, wrong = list(packet.items), -1
        if items and self._liar.dice.random() < PACKETS:
            wrong = self._liar.dice.randrange(len(items))
            items[wrong] = self._altered(items[wrong])
        for index, item in enumerate(packet.items):
            self._saw(item)
            if index != wrong and isinstance(packet, CopyRecords) and self._liar.chance(Scope.HANDOVERS):
                items[index] = self._older(packet.handover, item)
        is_liar = self._lie(member)
        answer: Packet = await ask(member, priority, replace(packet, items=tuple(items)), *rest)
        if wrong >= 0 and _has_kept(answer, wrong):
            place, version = named(packet.items[wrong])
            if is_liar or self._lie(member):
                # Between two liars: the one altered it, the other says that it keeps it.
                handover = packet.handover if isinstance(packet, CopyRecords) else STRAY
                self._lies.loses(self._slot, handover, place, version.digest)
            self._complain(place, is_liar or self._lie(member))
        return answer

    def _altered(self, item: HandItem) -> HandItem:
        self._lies.told["altered in a handover"] += 1
        if self._liar.dice.random() < 0.2:
            place = Location.from_number(self._liar.dice.randrange(LINE_LENGTH))
            return replace(item, location=place, object=b"") if item.object else replace(item, location=place)
        place_of, _ = named(item)
        record = RecordBytes(item.signature, item.header, item.ciphertext)
        wrong = self._liar.wrong(place_of, record, self._liar.dice.randrange(WAYS))
        return replace(item, signature=wrong.signature, header=wrong.header, ciphertext=wrong.ciphertext)

    def _older(self, handover: bytes, item: HandItem) -> HandItem:
        place, version = named(item)
        record = RecordBytes(item.signature, item.header, item.ciphertext)
        older = self._liar.older(place, record)
        if older is None:
            return item
        self._lies.loses(self._slot, handover, place, version.digest)
        return replace(item, signature=older.signature, header=older.header, ciphertext=older.ciphertext)

    def _saw(self, item: HandItem) -> None:
        place, _ = named(item)
        self._liar.saw(place, RecordBytes(item.signature, item.header, item.ciphertext))

    def _loses(self, handover: bytes, entry: RecordEntry) -> None:
        place = Place(entry.scene, entry.space, entry.object or entry.location)
        self._lies.loses(self._slot, handover, place, entry.digest)


def _has_kept(answer: Packet, index: int) -> bool:
    """Whether who was handed records says that it keeps this one."""
    if isinstance(answer, HandoverReply):
        return answer.reason == 0
    outcomes: Sequence[Any] = answer.outcomes if isinstance(answer, PutManyReply) else ()
    return index < len(outcomes) and outcomes[index].reason == 0

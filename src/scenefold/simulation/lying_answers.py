"""What a lying node answers to who reads, lists and writes (specs/17-simulation.md, Lies)."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import replace

from scenefold.base.ids import NodeId
from scenefold.base.location import LINE_LENGTH, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import RecordHeader
from scenefold.peer import NodeContext
from scenefold.simulation.history import Place
from scenefold.simulation.liar import WAYS, Liar, Scope
from scenefold.simulation.lies import STRAY, Manner, whole
from scenefold.simulation.lying_judge import LyingJudge
from scenefold.simulation.recording import expected_by, named
from scenefold.wire import (
    DAMAGED_RECORD,
    GetMany,
    GetManyReply,
    HandItem,
    HandRecords,
    Packet,
    PutItem,
    PutMany,
    PutManyReply,
    PutOutcome,
    QueryRange,
    RecordBytes,
    ReturnRange,
)

OF_READS = (Manner.NONSENSE, Manner.NONSENSE, Manner.WITHHELD, Manner.OLDER)
REFUSALS = (RejectReason.STALE_VERSION, RejectReason.DAMAGED)
"""Of what it has stored: whoever signs it anew, higher, hands it a record to be kept for later."""

Honest = Callable[[Packet, str], Awaitable[Packet | None]]
Twist = Callable[[Honest, Packet, str], Awaitable[Packet | None]]


def overlay(context: NodeContext, packet: type[Packet], twist: Twist) -> None:
    """Let `twist(honest, packet, peer)` answer in place of a node's own handler."""
    table = context.handlers._table
    honest, senders = table[packet]

    async def answer(asked: Packet, peer: str) -> Packet | None:
        return await twist(honest, asked, peer)

    table[packet] = answer, senders


class LyingAnswers:
    """Of one liar."""

    def __init__(self, liar: Liar, judge: LyingJudge) -> None:
        self._liar = liar
        self._judge = judge
        self._lies = liar.lies
        self._slot = liar.node.slot

    def possess(self, context: NodeContext) -> None:
        """Answer for one life of the node."""
        overlay(context, GetMany, self._get)
        overlay(context, QueryRange, self._list)
        overlay(context, PutMany, self._put)
        overlay(context, HandRecords, self._take_home)
        self._members = context.routing

    # ------------------------------------------------------------------------------------------------------ reads

    async def _get(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        answer = await honest(packet, peer)
        if not isinstance(packet, GetMany) or not isinstance(answer, GetManyReply) or not self._liar.lies_in(Scope.READS):
            return answer
        places = [Place(packet.scene, key.space, key.object or key.location) for key in packet.keys]
        # One answer lies in one manner: what is noticed at once must not hide what is hard to notice.
        manner, how = self._liar.dice.choice(OF_READS), self._liar.dice.randrange(WAYS)
        records = tuple(self._read(place, record, manner, how, peer) for place, record in zip(places, answer.records, strict=False))
        if self._liar.chance(Scope.READS) and self._liar.dice.random() < 0.1:
            self._liar.tells(peer, places[0], Manner.NONSENSE, b"")
            return replace(answer, records=(*records, *records) if self._liar.dice.random() < 0.5 else ())
        return replace(answer, records=records)

    def _read(self, place: Place, record: RecordBytes | None, manner: Manner, how: int, peer: str) -> RecordBytes | None:
        liar = self._liar
        if record is None or record == DAMAGED_RECORD:
            return record
        older = liar.older(place, record)
        liar.saw(place, record)
        if not liar.chance(Scope.READS):
            return record
        # What another node decides about that one has; only an owner can withhold it.
        decides = liar.decides(place.home)
        if manner is Manner.WITHHELD and decides:
            self._liar.tells(peer, place, manner, None)
            return DAMAGED_RECORD if liar.dice.random() < 0.3 else None
        if manner is Manner.OLDER and decides and older is not None:
            self._liar.tells(peer, place, manner, RecordHeader.decode(older.header).digest)
            return older
        wrong = liar.wrong(place, record, how)
        self._liar.tells(peer, place, Manner.NONSENSE, whole(wrong))
        return wrong

    async def _list(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        answer = await honest(packet, peer)
        if not isinstance(answer, ReturnRange) or not self._liar.lies_in(Scope.READS):
            return answer
        names = answer.objects or answer.locations
        places = [Place(answer.scene, answer.space, name) for name in names]
        left_out = {index for index, place in enumerate(places) if self._liar.decides(place.home) and self._liar.chance(Scope.READS)}
        for index in sorted(left_out):
            self._liar.tells(peer, places[index], Manner.WITHHELD, None)
        kept = [index for index in range(len(names)) if index not in left_out]
        locations = tuple(answer.locations[index] for index in kept)
        objects = tuple(answer.objects[index] for index in kept) if answer.objects else ()
        if self._liar.chance(Scope.READS) and not objects and isinstance(packet, QueryRange):
            # A place that nobody asked for, or one twice.
            self._liar.tells(peer, Place(packet.scene, packet.space, packet.first), Manner.NONSENSE, b"")
            elsewhere = Location.from_number(self._liar.dice.randrange(LINE_LENGTH))
            locations = (*locations, *locations[-1:], elsewhere)
        return replace(answer, locations=locations, objects=objects)

    # ----------------------------------------------------------------------------------------------------- writes

    async def _put(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        """Some records are acknowledged and not stored, some judged wrongly, some sent to who has nothing to do with them."""
        if not isinstance(packet, PutMany) or not self._liar.lies_in(Scope.ACKNOWLEDGEMENTS):
            return await honest(packet, peer)
        lies: dict[int, PutOutcome] = {}
        refused: set[int] = set()
        items = packet.items
        for index, item in enumerate(items):
            place, version = named(item)
            self._liar.saw(place, RecordBytes(item.signature, item.header, item.ciphertext))
            if not self._liar.decides(place.home) or not self._liar.chance(Scope.ACKNOWLEDGEMENTS):
                continue
            match self._liar.dice.randrange(4):
                case 0:
                    self._liar.tells(peer, place, Manner.DROPPED, version.digest)
                    lies[index] = PutOutcome(0, item.location, NodeId(0))
                case 1:
                    lies[index] = PutOutcome(RejectReason.NOT_MY_LOCATION, item.location, self._somebody())
                case 2 if expected_by(item) is not None:
                    self._liar.tells(peer, place, Manner.MISJUDGED, version.digest)
                    self._judge.overrules(item)
                case _:
                    refused.add(index)
        outcomes = await self._others(honest, items, lies, peer)
        for item in items:
            self._judge.has_judged(item)
        for index, item in enumerate(items):
            if outcomes[index].reason == RejectReason.NOT_MY_LOCATION:
                # It has the bytes, and may hand them on as what lies there, whenever it comes to own the place.
                place, version = named(item)
                self._liar.tells(peer, place, Manner.MISJUDGED, version.digest)
        for index in sorted(refused):
            if outcomes[index].reason == 0:
                place, version = named(items[index])
                self._liar.tells(peer, place, Manner.MISJUDGED, version.digest)
                outcomes[index] = replace(outcomes[index], reason=self._liar.dice.choice(REFUSALS))
        return PutManyReply(tuple(outcomes))

    async def _others(self, honest: Honest, items: Sequence[PutItem], lies: dict[int, PutOutcome], peer: str) -> list[PutOutcome]:
        """The outcomes of all, in order: of those that are not lied about the honest ones."""
        rest = [index for index in range(len(items)) if index not in lies]
        outcomes = dict(lies)
        if rest:
            answer = await honest(PutMany(tuple(items[index] for index in rest)), peer)
            assert isinstance(answer, PutManyReply)
            outcomes.update(zip(rest, answer.outcomes, strict=True))
        return [outcomes[index] for index in range(len(items))]

    async def _take_home(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        """Strays of others are acknowledged and not kept."""
        if not isinstance(packet, HandRecords) or not self._liar.lies_in(Scope.HANDOVERS):
            return await honest(packet, peer)
        dropped = {index for index, item in enumerate(packet.items) if self._drops(item)}
        rest = [index for index in range(len(packet.items)) if index not in dropped]
        outcomes = {index: PutOutcome(0, packet.items[index].location, NodeId(0)) for index in dropped}
        if rest:
            answer = await honest(replace(packet, items=tuple(packet.items[index] for index in rest)), peer)
            assert isinstance(answer, PutManyReply)
            outcomes.update(zip(rest, answer.outcomes, strict=True))
        return PutManyReply(tuple(outcomes[index] for index in range(len(packet.items))))

    def _drops(self, item: HandItem) -> bool:
        place, version = named(item)
        if not self._liar.decides(place.home) or not self._liar.chance(Scope.HANDOVERS):
            return False
        self._lies.loses(self._slot, STRAY, place, version.digest)
        return True

    def _somebody(self) -> NodeId:
        return self._liar.dice.choice([*self._members.members, NodeId(self._liar.dice.randrange(1, 1 << 32))])

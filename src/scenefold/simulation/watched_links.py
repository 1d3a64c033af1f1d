"""Links of a client that are looked on: what leaves and enters it comes into histories (specs/17-simulation.md, Histories)."""

from __future__ import annotations

from scenefold.base.ids import node_id_of
from scenefold.simulation.history import Place
from scenefold.simulation.lies import TABLE, Way, of_header
from scenefold.simulation.recording import Recorder, purged_by
from scenefold.wire import (
    CopiesFound,
    GetCopies,
    GetMany,
    GetManyReply,
    Packet,
    PurgeRecords,
    PutMany,
    PutManyReply,
    QueryRange,
    RecordsPurged,
    RequestSceneLog,
    RequestTable,
    ReturnRange,
)
from scenefold.world import Links, Priority


def _asked_about(packet: Packet) -> list[Place]:
    """What nonsense in the answer would be about, as liars name it."""
    match packet:
        case GetMany() | GetCopies():
            return [Place(packet.scene, key.space, key.object or key.location) for key in packet.keys]
        case QueryRange():
            return [Place(packet.scene, packet.space, packet.first)]
        case RequestSceneLog():
            return [of_header(packet.scene)]
        case RequestTable():
            return [TABLE]
    return []


class WatchedLinks:
    """Links of a client, looked on by a recorder. Has what `Calls` uses of `Links`."""

    def __init__(self, links: Links, recorder: Recorder, who: str) -> None:
        self._links = links
        self._recorder = recorder
        self._who = who

    async def request(self, address: str, priority: Priority, packet: Packet, timeout_s: float) -> Packet:
        begin = self._recorder.histories.moment()
        answer: Packet | None = None
        if isinstance(packet, PutMany):
            for item in packet.items:
                self._recorder.offered(item)
        if isinstance(packet, PurgeRecords):
            for place, version in purged_by(packet.order):
                self._recorder.purging(place, version)
        try:
            answer = await self._links.request(address, priority, packet, timeout_s)
        finally:
            self._note(Way(f"node:{node_id_of(address)}", f"user:{self._who}"), begin, packet, answer)
        return answer

    def _note(self, way: Way, begin: int, packet: Packet, answer: Packet | None) -> None:
        recorder = self._recorder
        if any(recorder.lies.is_nonsense(place, way, begin) for place in _asked_about(packet)):
            recorder.nonsense_heard[self._who] += 1
        if isinstance(packet, PutMany):
            outcomes = None
            if isinstance(answer, PutManyReply) and len(answer.outcomes) == len(packet.items):
                outcomes = [outcome.reason for outcome in answer.outcomes]
            recorder.written(way, begin, packet.items, outcomes)
        elif isinstance(packet, PurgeRecords):
            recorder.purged(self._who, begin, packet.order, answer.reasons if isinstance(answer, RecordsPurged) else None)
        elif isinstance(packet, GetMany) and isinstance(answer, GetManyReply):
            recorder.read(way, begin, packet, answer.records, answer.stale, answer.write_floor)
        elif isinstance(packet, GetCopies) and isinstance(answer, CopiesFound):
            recorder.read_of_copies(way, begin, packet, answer)
        elif isinstance(packet, QueryRange) and isinstance(answer, ReturnRange):
            recorder.listed(way, begin, answer)

    async def send(self, address: str, priority: Priority, packet: Packet, timeout_s: float, *, while_it_moves: bool = False) -> None:
        await self._links.send(address, priority, packet, timeout_s, while_it_moves=while_it_moves)

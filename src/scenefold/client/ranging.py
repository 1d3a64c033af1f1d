"""Which places of a space hold records: asked owner by owner along the line, in parts that fit an answer.

Each answer says which part of the question it covers, and the next question begins behind that; so bounds may move
meanwhile. An owner that lists too much for one answer (reason 6) is asked for half. One that again and again covers a little, and
lists next to nothing, would keep a reader for ever: the line has 2^160 places.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import AsyncGenerator
from itertools import repeat

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.limits import CLIENT_REQUEST_S, CLIENT_STATUS_S
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.client.fetching import stale_answer
from scenefold.client.patience import heaviest, is_passing
from scenefold.client.table import Owner
from scenefold.wire import QueryRange, RejectRange, ReturnRange

SHORT_LIST = 1_024
"""An answer that lists fewer places is a short one. An honest node that does not cover all of its piece lists 65,536."""
SHORT_MAX = 16
"""Short answers of one node in one walk: it owns one piece, of which one answer is the last, unless a bound moves."""


async def entries(
    calls: Calls, scene: SceneId, space: SpaceId, first: Location, last: Location, *, stale_ok: bool
) -> AsyncGenerator[tuple[Location, bytes], None]:
    """Locations from `first` to `last` with the object at each (b"" in a fixed space), in order; asked for as they are used."""
    short = Counter[NodeId]()
    at: Location | None = first
    end = last
    while at is not None and at <= last:
        reply = await _ask_patiently(calls, QueryRange(scene, space, at, min(end, last)), stale_ok, short)
        if isinstance(reply, RejectRange):
            end = _shorter(reply, at, min(end, last))
            continue
        for location, object_id in zip(reply.locations, reply.objects or repeat(b""), strict=False):
            # Zeros stand for no object, beside others that have one.
            yield location, object_id if any(object_id) else b""
        at, end = reply.last.next(), last


async def _ask_patiently(calls: Calls, question: QueryRange, stale_ok: bool, short: Counter[NodeId]) -> ReturnRange | RejectRange:
    """The owner's answer for the beginning of the question; a RejectRange only for reasons that last. `short`: such answers so far."""

    async def ask() -> ReturnRange | RejectRange:
        # Where claims overlap one of them is old, or a lie; which one, only those know who are asked.
        candidates = calls.to_ask(question.first)
        problems: list[Unreachable | Refused | PeerFault] = []
        rejection: RejectRange | None = None
        for owner in candidates:
            try:
                reply = await ask_one(owner, CLIENT_REQUEST_S if owner is candidates[-1] else CLIENT_STATUS_S)
            except (Unreachable, Refused, PeerFault) as problem:
                problems.append(problem)
                continue
            if isinstance(reply, ReturnRange):
                return reply
            rejection = rejection or reply
        if rejection is not None:
            return rejection
        raise heaviest(problems)

    async def ask_one(owner: Owner, timeout_s: float) -> ReturnRange | RejectRange:
        packet = QueryRange(question.scene, question.space, question.first, min(question.last, calls.table.end_of(question.first)))
        reply = await calls.ask(owner.address, packet, (ReturnRange, RejectRange), timeout_s=timeout_s)
        if isinstance(reply, RejectRange):
            if reply.reason == RejectReason.OUTSIDE_BOUNDS or is_passing(reply.reason):
                # Our table is old, or the owner cannot speak just now: patiently() asks again, with a newer table.
                raise Refused(RejectReason.NOT_READY, "the owner of the range cannot answer just now", where=owner.address)
            return reply
        assert isinstance(reply, ReturnRange)
        _check_part(packet, reply, owner.address)
        if reply.first != packet.first:
            # What lies before belongs to somebody else by now.
            raise Refused(RejectReason.NOT_READY, "the owner of the range is changing", where=owner.address)
        if reply.stale and not stale_ok:
            raise stale_answer(owner.address)
        _check_progress(reply, owner, short)
        return reply

    return await calls.patiently(ask)


def _check_part(question: QueryRange, reply: ReturnRange, address: str) -> None:
    """PeerFault if an answer is of another part of the line, or lists what does not lie there, or out of order, or a place twice."""
    if not question.first <= reply.first <= reply.last <= question.last:
        raise PeerFault("a range answer lies elsewhere than its question", where=address)
    places = list(reply.locations)
    if places != sorted(places if reply.objects else set(places)) or (places and not reply.first <= places[0] <= places[-1] <= reply.last):
        raise PeerFault("a range answer lists places that it is not about, or not in order", where=address)


def _check_progress(reply: ReturnRange, owner: Owner, short: Counter[NodeId]) -> None:
    """PeerFault if a node lists next to nothing once too often."""
    short[owner.node_id] += len(reply.locations) < SHORT_LIST
    if short[owner.node_id] > SHORT_MAX:
        raise PeerFault("a node lists a range in ever smaller parts, with next to nothing in them", where=owner.address)


def _shorter(reply: RejectRange, first: Location, last: Location) -> Location:
    """Where a question that was too large ends the next time."""
    if reply.reason != RejectReason.TOO_LARGE_FOR_PACKET or first == last:
        raise Refused(reply.reason, "the node refused the range query", where=f"scene {reply.scene:08x}, space {reply.space}")
    return Location.from_number((first.number + last.number) // 2)

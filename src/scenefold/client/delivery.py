"""Many records to and from many nodes at once: split by owner, in frames, in parallel, until each has its answer.

Records whose owner is away, busy or another than we thought go into the next round, with a newer table. A
reply says the owner with reason 10, and that is believed for one round: whoever moved the bound knows best.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from typing import NamedTuple

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.limits import CLIENT_GET_KEYS, CLIENT_TRIES_MAX
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls, is_passing
from scenefold.client.split import by_owner, frames
from scenefold.client.together import together
from scenefold.wire import GetMany, GetManyReply, PutItem, PutMany, PutManyReply, RecordBytes, RecordKey

STORED = 0

Error = Unreachable | Refused


class Delivered(NamedTuple):
    """What became of a record: `reason` is STORED or a RejectReason, `node` the one that said so."""

    reason: int
    node: NodeId


async def deliver(calls: Calls, items: Sequence[PutItem]) -> list[Delivered]:
    """Send every item to its owner. Durable, or refused for a lasting reason; Unreachable if an owner stays away."""
    outcomes: list[Delivered | None] = [None] * len(items)
    locations = [item.location for item in items]
    sizes = [len(item.ciphertext) + len(item.header) + len(item.signature) + 48 for item in items]
    hints: dict[int, NodeId] = {}

    async def send(node: NodeId, frame: list[int]) -> None:
        packet = PutMany(tuple(items[index] for index in frame))
        address = calls.address_of(node)
        reply = await calls.ask_in_turn(address, packet, PutManyReply)
        if len(reply.outcomes) != len(frame):
            raise PeerFault(f"{len(reply.outcomes)} outcomes for {len(frame)} records", where=address)
        for index, outcome in zip(frame, reply.outcomes, strict=True):
            if outcome.reason == RejectReason.NOT_MY_LOCATION:
                if outcome.owner:
                    hints[index] = outcome.owner
            elif not is_passing(outcome.reason):
                outcomes[index] = Delivered(outcome.reason, node)

    def parts(pending: list[int]) -> list[tuple[NodeId, list[int]]]:
        routed = _routed(calls, locations, pending, hints)
        hints.clear()
        return [(node, frame) for node, indices in routed.items() for frame in frames(indices, sizes)]

    def pending() -> list[int]:
        return [index for index, outcome in enumerate(outcomes) if outcome is None]

    await _rounds(calls, pending, parts, send)
    return [outcome for outcome in outcomes if outcome is not None]


async def fetch(calls: Calls, scene: SceneId, position: int, keys: Sequence[tuple[SpaceId, Location]]) -> list[RecordBytes | None]:
    """The records at the keys, unverified, in order; None where the owner says that nothing is there."""
    missing = object()
    found: list[RecordBytes | object | None] = [missing] * len(keys)
    locations = [location for _, location in keys]

    async def ask(node: NodeId, frame: list[int]) -> None:
        address = calls.address_of(node)
        while frame:
            packet = GetMany(scene, position, tuple(RecordKey(*keys[index]) for index in frame))
            reply = await calls.ask_in_turn(address, packet, GetManyReply)
            if not 1 <= len(reply.records) <= len(frame):
                raise PeerFault(f"{len(reply.records)} records for {len(frame)} keys", where=address)
            for index, record in zip(frame, reply.records, strict=False):
                found[index] = record
            frame = frame[len(reply.records) :]

    def parts(pending: list[int]) -> list[tuple[NodeId, list[int]]]:
        ones = [1] * len(keys)
        routed = _routed(calls, locations, pending, {})
        return [(node, frame) for node, indices in routed.items() for frame in frames(indices, ones, CLIENT_GET_KEYS)]

    def pending() -> list[int]:
        return [index for index, record in enumerate(found) if record is missing]

    await _rounds(calls, pending, parts, ask)
    return found  # type: ignore[return-value]


async def _rounds(
    calls: Calls,
    pending: Callable[[], list[int]],
    parts: Callable[[list[int]], list[tuple[NodeId, list[int]]]],
    exchange: Callable[[NodeId, list[int]], Awaitable[None]],
) -> None:
    """Exchange all pending parts at once, again and again with pauses, until nothing is pending or tries run out."""
    for attempt in range(CLIENT_TRIES_MAX):
        waiting = pending()
        if not waiting:
            return
        if attempt:
            await calls.pause(attempt - 1)
            await calls.refresh()
        errors: list[Error] = []

        async def attempt_part(node: NodeId, frame: list[int], errors: list[Error] = errors) -> None:
            try:
                await exchange(node, frame)
            except Unreachable as error:
                errors.append(error)
            except Refused as error:
                if not is_passing(error.reason):
                    raise
                errors.append(error)

        await together(partial(attempt_part, node, frame) for node, frame in parts(waiting))
    left = pending()
    if left:
        raise errors[0] if errors else _unsettled(len(left))


def _routed(calls: Calls, locations: Sequence[Location], pending: list[int], hints: dict[int, NodeId]) -> dict[NodeId, list[int]]:
    routed: dict[NodeId, list[int]] = {}
    for node, positions in by_owner([locations[index] for index in pending], calls.table).items():
        for position in positions:
            index = pending[position]
            routed.setdefault(hints.get(index, node), []).append(index)
    return routed


def _unsettled(count: int) -> Refused:
    remedy = "try again in a while; `scenectl cluster status` shows who is there"
    return Refused(RejectReason.BUSY, f"the owners of {count} records are busy or keep changing", remedy=remedy)

"""Many records to many nodes at once: split by owner, in frames, in parallel, until each has its answer.

Records whose owner is away, busy or another than we thought go into the next round, with a newer table (seeking.py).
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SpaceId, address_of
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.client.doubt import Doubt
from scenefold.client.patience import Patience, as_told, heaviest, is_passing
from scenefold.client.seeking import Search
from scenefold.client.split import frames
from scenefold.client.together import together
from scenefold.wire import PutItem, PutMany, PutManyReply, PutOutcome

STORED = 0

Error = Unreachable | Refused | PeerFault


class Delivered(NamedTuple):
    """What became of a record: `reason` is STORED or a RejectReason, `node` the one that said so."""

    reason: int
    node: NodeId
    location: Location


async def deliver(
    calls: Calls,
    items: Mapping[int, PutItem],
    locations: Sequence[Location],
    doubt: Doubt,
    needed: Mapping[SpaceId, int] = MappingProxyType({}),
) -> dict[int, Delivered]:
    """Send every item to the owner of its location. Durable, or refused for a lasting reason. All by number; `doubt` is kept up to date.

    `needed`: how many nodes a write in each space needs, as far as it is known, for whoever is told that too few are there.

    Unreachable if an owner stays away; Refused if one cannot accept anything for longer than a lease gap lasts; PeerFault if one
    answers with nonsense. The last two may speak of a later try than one that is in doubt: see `Doubt.no_refusal`.
    """
    outcomes: dict[int, Delivered] = {}
    sizes = {index: len(item.ciphertext) + len(item.header) + len(item.signature) + 48 for index, item in items.items()}
    search = Search(calls, locations)

    async def send(node: NodeId, frame: list[int]) -> None:
        packet = PutMany(tuple(items[index] for index in frame))
        address = calls.address_of(node)
        async with calls.turn(address):
            with doubt.trying(frame):
                reply = await calls.ask(address, packet, PutManyReply)
                if len(reply.outcomes) != len(frame):
                    raise PeerFault(f"{len(reply.outcomes)} outcomes for {len(frame)} records", where=address)
        for index, outcome in zip(frame, reply.outcomes, strict=True):
            if outcome.reason == RejectReason.NOT_MY_LOCATION:
                search.passed_on(node, index, outcome.owner)
            elif not _may_pass(outcome, node):
                outcomes[index] = Delivered(outcome.reason, node, outcome.location)
                if outcome.reason == STORED:
                    doubt.settle(index)
            else:
                search.was_busy(node, [index], _why_not(outcome, node, address, needed.get(items[index].space, 0)))
                if outcome.reason == RejectReason.NOT_READY and outcome.owner != node:
                    doubt.note([index], f"{address} was not ready to say, as when its lease ends in the midst of a write")

    def parts(pending: list[int]) -> list[tuple[NodeId, list[int]]]:
        return [(node, frame) for node, indices in search.routed(pending).items() for frame in frames(indices, sizes)]

    def pending() -> list[int]:
        return [index for index in items if index not in outcomes]

    await rounds(calls, search, pending, parts, send)
    return outcomes


async def rounds(
    calls: Calls,
    search: Search,
    pending: Callable[[], list[int]],
    parts: Callable[[list[int]], list[tuple[NodeId, list[int]]]],
    exchange: Callable[[NodeId, list[int]], Awaitable[None]],
) -> None:
    """Exchange all pending parts at once, again and again with pauses, until nothing is pending or tries run out.

    What a node refuses for good, or answers with nonsense, ends it if it is the last word (`Search.is_last_word`).
    """
    patience = Patience()
    await calls.learn()
    while True:
        waiting = pending()
        if not waiting:
            return
        errors: list[Error] = []
        unbelieved: list[tuple[NodeId, list[int]]] = []

        async def attempt_part(
            node: NodeId, frame: list[int], errors: list[Error] = errors, unbelieved: list[tuple[NodeId, list[int]]] = unbelieved
        ) -> None:
            try:
                await exchange(node, frame)
            except Unreachable as error:
                errors.append(error)
            except (Refused, PeerFault) as error:
                if isinstance(error, Refused) and is_passing(error.reason):
                    search.was_busy(node, frame, error)
                elif search.is_last_word(node, frame):
                    raise
                else:
                    unbelieved.append((node, frame))
                errors.append(error)

        await together(partial(attempt_part, node, frame) for node, frame in parts(waiting))
        for node, frame in unbelieved:
            search.disbelieve(node, frame)
        left = pending()
        if not left:
            return
        # A node that says nothing wears patience out faster than one that says "not now".
        silence = next((found for found in errors if isinstance(found, Unreachable)), None)
        passing = next((found for found in errors if isinstance(found, Refused) and is_passing(found.reason)), None)
        if not patience.bears(silence or passing):
            raise as_told(silence or (heaviest(errors) if errors else search.excuse(left)))
        await calls.pause(patience)
        await calls.refresh()


def _may_pass(outcome: PutOutcome, node: NodeId) -> bool:
    """Whether the same may be stored later. Who names itself says that too few may hold copies at all; who names another, that it is not there."""
    return is_passing(outcome.reason) or (outcome.reason == RejectReason.TOO_FEW_COPIES and outcome.owner != node)


def _why_not(outcome: PutOutcome, node: NodeId, address: str, needed: int) -> Refused:
    if outcome.reason == RejectReason.TOO_FEW_COPIES:
        return _too_few_there(outcome.owner, address, needed)
    if outcome.reason == RejectReason.NOT_READY and outcome.owner == node:
        return _nothing_stored(address)
    what = (
        "is busy: the place is changing hands"
        if outcome.reason == RejectReason.BUSY
        else "is not ready: it has no lease, or does not know enough yet"
    )
    return Refused(RejectReason(outcome.reason), what, where=address)


def _too_few_there(missing: NodeId, address: str, needed: int) -> Refused:
    """Like 16 for whoever asks: it passes once nodes are back."""
    silent = f", {address_of(missing)} among those that do not" if missing else ""
    asked = f"; a write in this space needs {needed} nodes, or all where there are fewer" if needed else ""
    what = f"takes no writes there: too few of the nodes that may hold copies answer{silent}{asked}"
    remedy = "start the nodes that do not answer, or add nodes; `scenectl cluster health` tells which"
    return Refused(RejectReason.NOT_READY, what, where=address, remedy=remedy)


def _nothing_stored(address: str) -> Refused:
    what = (
        "has no lease, or does not know yet what was acknowledged there, or who is to hold copies: "
        "it takes no writes until the cluster's voter answers it, and the other nodes do"
    )
    remedy = "see that the voter runs; `scenectl cluster status` names it, and who has no lease; `scenectl cluster health` tells what is on its way"
    return Refused(RejectReason.NOT_READY, what, where=address, remedy=remedy)

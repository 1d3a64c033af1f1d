"""How much memory nodes have for another render: an organiser asks them before it forms pools (specs/36-render-pools.md, *Forming*)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import trio

from scenefold.base.errors import LocalFault, PeerFault, Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.plain_values import whole
from scenefold.base.reasons import RejectReason
from scenefold.render.pool.host import Host
from scenefold.render.pool.unattended import ALL_JOBS
from scenefold.wire import JobState, JobStateReply, Value, unpack_value
from scenefold.world import leaves

ASK_S_MAX = 30.0


async def budgets_of(host: Host, nodes: Sequence[NodeId]) -> dict[NodeId, int]:
    """Bytes, of each node. Unreachable if one does not answer, LocalFault if it does not say, PeerFault for an answer that is none."""
    free: dict[NodeId, int] = {}

    async def ask(node: NodeId) -> None:
        try:
            reply = await host.ask(node, JobState(job=ALL_JOBS), ASK_S_MAX)
        except Refused as error:
            what = "a node does not say how much memory it has: it may run an older version"
            raise LocalFault(what, where=address_of(node), remedy="run the same version on all nodes, or render in one pool") from error
        free[node] = budget_told(reply, address_of(node))

    try:
        async with trio.open_nursery() as nursery:
            for node in nodes:
                nursery.start_soon(ask, node)
    except BaseExceptionGroup as group:
        raise next(leaves(group)) from None
    return free


@contextmanager
def counted_on() -> Iterator[None]:
    """What was planned by budgets is done. Refused (16) for (13): other renders have taken memory since nodes told it, so all is to be planned anew."""
    try:
        yield
    except Exception as error:
        found = list(leaves(error)) if isinstance(error, BaseExceptionGroup) else [error]
        busy = [one for one in found if isinstance(one, Refused) and one.reason is RejectReason.BUSY]
        if not busy or len(busy) < len(found):
            raise
        raise Refused(RejectReason.NOT_READY, busy[0].what, where=busy[0].where, remedy=busy[0].remedy) from error


def budget_document(free: int) -> dict[str, Value]:
    """What a node answers that has so many bytes."""
    return {"memory": max(0, free)}


def budget_told(reply: object, where: str) -> int:
    """What `budget_document` says, as it came. PeerFault for anything else."""
    if not isinstance(reply, JobStateReply):
        raise PeerFault(f"{type(reply).__name__} is no answer to JobState", where=where)
    document = unpack_value(reply.document, what="a node's memory")
    try:
        if not isinstance(document, dict):
            raise TypeError("a map is expected")
        return whole(document["memory"], 0, 2**63 - 1)
    except (KeyError, TypeError, ValueError) as error:
        raise PeerFault("a node does not say how much memory it has", where=where) from error

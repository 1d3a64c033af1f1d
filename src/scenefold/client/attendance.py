"""Whether those who are to decide a scene's log are there: without a majority of them nothing could be changed or written any more.

Who is asked answers by himself, whatever others believe of him. That he is silent may be the asker's network alone; then nothing is lost by
refusing, while a list of nodes that are gone can never be changed again (specs/16-scene-log.md, Participants).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import CLIENT_STATUS_S
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.client.trusted import Wanted, participants_of
from scenefold.wire import ParticipantEntry, RequestTable, RespondTable
from scenefold.world import Priority
from scenefold.world.log_view import LogView

AT_ONCE_MAX = 8
"""Nodes that are asked at a time."""


async def chosen(calls: Calls, view: LogView, wanted: Wanted | None, origin: NodeId, name: str) -> tuple[ParticipantEntry, ...]:
    """Who shall decide a scene (`participants_of`): who answers before who does not, where a number is wanted. Refused (15) if too few do."""
    asked: frozenset[NodeId] = frozenset()
    silent: frozenset[NodeId] = frozenset()
    while True:
        entries = participants_of(view, wanted, origin, silent)
        nodes = [NodeId(entry.member.node) for entry in entries]
        if asked.issuperset(nodes):
            check_majority(nodes, silent, name)
            return entries
        silent |= await silent_among(calls, frozenset(nodes) - asked)
        asked = asked.union(nodes)


async def silent_among(calls: Calls, nodes: Iterable[NodeId]) -> frozenset[NodeId]:
    """Who of them does not answer in CLIENT_STATUS_S. Who refuses is there."""
    silent: set[NodeId] = set()
    places = trio.CapacityLimiter(AT_ONCE_MAX)

    async def ask(node: NodeId) -> None:
        async with places:
            try:
                await calls.ask(address_of(node), RequestTable(), RespondTable, priority=Priority.HIGH, timeout_s=CLIENT_STATUS_S)
            except Unreachable:
                silent.add(node)
            except (Refused, PeerFault):
                return

    async with trio.open_nursery() as nursery:
        for node in nodes:
            nursery.start_soon(ask, node)
    return frozenset(silent)


def has_majority(deciding: Collection[NodeId], silent: Collection[NodeId]) -> bool:
    """Whether more than half of them are there."""
    return sum(node not in silent for node in deciding) * 2 > len(deciding)


def check_majority(deciding: Sequence[NodeId], silent: Collection[NodeId], name: str) -> None:
    """Refused (15) if fewer than a majority of those who are to decide a scene are there."""
    if not deciding or has_majority(deciding, silent):
        return
    there, needed = [node for node in deciding if node not in silent], len(deciding) // 2 + 1
    away = ", ".join(address_of(node) for node in deciding if node in silent)
    answer = f"{len(there)} of them answers" if len(there) == 1 else f"{len(there) or 'none'} of them answer"
    what = f"of the {len(deciding)} nodes that are to decide the scene's log {needed} must agree, and {answer}"
    raise Refused(
        RejectReason.NO_MAJORITY,
        what,
        where=f"scene {name}; silent: {away}",
        remedy="start those that are down, or choose others; nothing was changed",
    )

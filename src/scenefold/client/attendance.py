"""Whether those who are to decide a scene's log are there: without a majority of them nothing could be changed or written any more.

Who is asked answers by himself, whatever others believe of him. That he is silent may be the asker's network alone; then nothing is lost by
refusing, while a list of nodes that are gone can never be changed again (specs/16-scene-log.md, Participants).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import CLIENT_STATUS_S
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.client.trusted import Wanted, able, participants_of
from scenefold.wire import Member, ParticipantEntry, RequestTable, RespondTable
from scenefold.world import Priority, first_of
from scenefold.world.log_view import LogView

GRACE_S = 1.0
"""Once enough have answered, the others have so long."""
OTHERS_MAX = 64
"""Nodes that are asked in place of those that are silent."""
LATELY_S = 30.0
"""Who did not answer so long ago is not asked again."""


async def chosen(calls: Calls, view: LogView, wanted: Wanted | None, origin: NodeId, name: str) -> tuple[ParticipantEntry, ...]:
    """Who shall decide a scene (`participants_of`): who answers before who does not, where a number is wanted. Refused (15) if too few do."""
    entries = participants_of(view, wanted, origin)
    if not entries:
        return entries
    members = [entry.member for entry in entries]
    there = await present_among(calls, members, grace_s=GRACE_S)
    if wanted is None or isinstance(wanted, int):
        missing = [member for member in members if member not in there]
        others = [Member(node, view.registered[node]) for node in able(view) if node in view.registered and node not in _nodes(members)]
        if missing and others:
            there |= await present_among(calls, others[:OTHERS_MAX], len(missing))
            entries = participants_of(view, wanted, origin, [node for node in able(view) if node not in _nodes(there)])
            members = [entry.member for entry in entries]
    check_majority(members, there, name)
    return entries


async def present_among(calls: Calls, members: Sequence[Member], wanted: int | None = None, *, grace_s: float = 0.0) -> frozenset[Member]:
    """Who of them answers in CLIENT_STATUS_S, in this life: who lost its disk is another one. Who refuses is there.

    Once `wanted` have answered, by default a majority, the others have `grace_s` left.
    """
    there: set[Member] = set()
    enough, found = len(members) // 2 + 1 if wanted is None else wanted, trio.Event()

    async def ask(member: Member) -> None:
        if await _answers(calls, member):
            there.add(member)
            if len(there) >= enough:
                found.set()

    async def ask_all() -> None:
        async with trio.open_nursery() as nursery:
            for member in members:
                if not calls.is_silent(NodeId(member.node), within_s=LATELY_S):
                    nursery.start_soon(ask, member)

    async def have_enough() -> None:
        await found.wait()
        await calls.world.clock.sleep(grace_s)

    await first_of(ask_all, have_enough)
    return frozenset(there)


async def _answers(calls: Calls, member: Member) -> bool:
    address = address_of(member.node)
    try:
        reply = await calls.ask(address, RequestTable(), RespondTable, priority=Priority.HIGH, timeout_s=CLIENT_STATUS_S)
    except Unreachable:
        return False
    except (Refused, PeerFault):
        return True
    # It knows itself best; who does not say is taken for who was asked.
    own = [status.incarnation for status in reply.statuses if status.node == member.node]
    return not own or member.incarnation in own


def has_majority(deciding: Sequence[Member], there: Collection[Member]) -> bool:
    """Whether more than half of them are there."""
    return sum(member in there for member in deciding) * 2 > len(deciding)


def check_majority(deciding: Sequence[Member], there: Collection[Member], name: str) -> None:
    """Refused (15) if fewer than a majority of those who are to decide a scene are there."""
    if not deciding or has_majority(deciding, there):
        return
    count, needed = sum(member in there for member in deciding), len(deciding) // 2 + 1
    away = ", ".join(address_of(member.node) for member in deciding if member not in there)
    who = "the one node that is" if len(deciding) == 1 else f"of the {len(deciding)} nodes that are"
    answer = "does not answer" if len(deciding) == 1 else f"{needed} must agree, and {_counted(count)}"
    remedy = "start those that are down, or choose others; nothing was changed"
    if not count:
        remedy = f"look whether this computer reaches them; {remedy}"
    raise Refused(
        RejectReason.NO_MAJORITY, f"{who} to decide the scene's log {answer}", where=f"scene {name}; silent: {away}", remedy=remedy
    )


def _counted(count: int) -> str:
    return f"{count} of them answers" if count == 1 else f"{count or 'none'} of them answer"


def _nodes(members: Collection[Member]) -> set[NodeId]:
    return {NodeId(member.node) for member in members}

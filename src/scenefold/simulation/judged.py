"""When the voter last found nothing against the removal of a member: what it heard later came too late for that."""

from __future__ import annotations

from collections.abc import Callable

from scenefold.peer import NodeContext
from scenefold.wire import Member


def see_judged(context: NodeContext, seen: Callable[[Member], None]) -> None:
    """Call `seen` with each member that this life of the voter does not hold back from now on; nothing at other nodes."""
    veto = context.cluster_log.veto
    if veto is None:
        return

    async def watched(member: Member) -> str | None:
        objection = await veto(member)
        if objection is None:
            seen(member)
        return objection

    context.cluster_log.veto = watched

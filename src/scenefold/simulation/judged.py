"""When the voter last found nothing against the removal of a member: what it heard later came too late for that.

Until it finds something against it again, and for as long as its log may take to have the removal written.
"""

from __future__ import annotations

from collections.abc import Callable

from scenefold.peer import NodeContext
from scenefold.wire import Member


def see_judged(context: NodeContext, seen: Callable[[Member, bool], None]) -> None:
    """Call `seen` with each member that this life of the voter judges, and whether it is not held back; nothing at other nodes."""
    veto = context.cluster_log.veto
    if veto is None:
        return

    async def watched(member: Member) -> str | None:
        objection = await veto(member)
        seen(member, objection is None)
        return objection

    context.cluster_log.veto = watched

"""`scenectl cluster join`: a node that tells on the way what becomes of it, as an extension of that node."""

from __future__ import annotations

from typing import TYPE_CHECKING

from scenectl.cluster_text import arc_text
from scenectl.output import Output, emit_event

if TYPE_CHECKING:
    import trio

    from scenefold.node import NodeContext

LOOK_S = 0.25
"""Between two looks at what has arrived."""
PATIENCE_S = 3.0
"""A cluster in order takes a node in sooner; from then on it is said what the node waits for, whenever that changes."""


class Telling:
    """Says when the node is a member, what arrives, and when it owns an arc. Once in every life of the node."""

    def __init__(self, output: Output) -> None:
        import trio

        self._output = output
        self.may_begin = trio.Event()
        """It says nothing before this is set: that the node is ready comes first, though it may be a member before that."""

    async def run(self, context: NodeContext, *, task_status: trio.TaskStatus[None]) -> None:
        """Tell, until the arc is there."""
        import trio

        task_status.started()
        await self.may_begin.wait()
        async with trio.open_nursery() as nursery:
            nursery.start_soon(self._waiting, context)
            await self._member(context)
            await self._arc(context)

    async def _waiting(self, context: NodeContext) -> None:
        told = ""
        while not context.joined.is_set():
            await context.world.clock.sleep(PATIENCE_S)
            text = waits_for(context)
            if text and text != told:
                told = text
                emit_event(self._output, {"event": "waiting", "text": text}, f"Node {context.address} waits: {text}.")

    async def _member(self, context: NodeContext) -> None:
        from scenefold.base.ids import address_of

        await context.enrolment.registered()
        registry = context.cluster_log.registry
        neighbours = [None if node is None else address_of(node) for node in registry.neighbours(context.me)]
        left, right = neighbours
        document = {"event": "member", "cluster": context.facts.name, "members": len(registry.order), "left": left, "right": right}
        beside = " and ".join(address for address in neighbours if address is not None) or "nobody"
        text = f"Node {context.address} is a member of {context.facts.name}, beside {beside}."
        emit_event(self._output, document, text)

    async def _arc(self, context: NodeContext) -> None:
        from scenefold.base.location import LINE_LENGTH

        told = 0
        while (arc := context.line.arc) is None:
            await context.world.clock.sleep(LOOK_S)
            records = (await context.store.statistics()).records
            if records > told and context.line.arc is None:
                told = records
                emit_event(self._output, {"event": "receiving", "records": records}, f"{records} records have arrived.")
        totals = await context.store.arc_totals(arc)
        share = arc.length / LINE_LENGTH
        document = {
            "event": "arrived",
            "first": arc.first.hex(),
            "last": arc.last.hex(),
            "share": share,
            "records": totals.records,
            "bytes": totals.bytes,
        }
        # A node owns a piece only once everything in it lies on its disk, so these are one event.
        text = f"Node {context.address} owns {arc_text(arc)}, {share:.1%} of the line; its {totals.records} records have arrived."
        emit_event(self._output, document, text)


def waits_for(context: NodeContext) -> str:
    """What keeps the node from being a member that may speak for its arc; empty if nothing does."""
    from scenefold.base.ids import address_of

    if context.enrolment.waits_for or context.lease.holds():
        return context.enrolment.waits_for
    return f"it is a member and has no lease, for the voter, {address_of(context.facts.voter)}, gives none: nothing is served meanwhile"

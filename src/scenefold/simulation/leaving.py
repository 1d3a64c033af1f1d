"""A node is told to hand everything over and leave, as `scenectl node drain` tells it."""

from __future__ import annotations

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.simulation.clients import Client
from scenefold.simulation.cluster import Node
from scenefold.wire import DrainNode, NodeReport
from scenefold.world import Priority

ASK_S_MAX = 5.0


async def drain(client: Client, node: Node) -> bool:
    """Whether the node took the order. It leaves in its own time; killed, it goes on once it runs again or forgets it."""
    order = DrainNode(check_only=False, cancel=False)
    # Whoever asks and hears nothing has still asked.
    node.told_to_leave = True
    with trio.move_on_after(ASK_S_MAX):
        try:
            await client.calls.ask(node.address, order, NodeReport, priority=Priority.HIGH, timeout_s=ASK_S_MAX)
            return True
        except (Unreachable, Refused, PeerFault):
            return False
    return False

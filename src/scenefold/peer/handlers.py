"""Which coroutine answers which packet, and who may send it (specs/11-peers.md, Requests).

Services add their handlers here, the renderer does likewise; connections of both ports ask this one table. Who a
peer is says its certificate: "node:<id>", or "user:<name>". A node need not be a member: it has to ask before it can become
one. A service that only members may ask looks into the cluster's log itself. A handler raises what is
somebody else's fault (Refused with a reason, above all); serving turns that into a Fault for this one request.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import replace
from enum import Flag, auto
from typing import Any, TypeVar

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import node_named
from scenefold.peer.cluster_log.registry import Registry
from scenefold.wire import MiniStatus, Packet

P = TypeVar("P", bound=Packet)
Handler = Callable[[P, str], Awaitable[Packet | None]]


class Senders(Flag):
    """Who may send a packet."""

    NODES = auto()
    USERS = auto()
    ANY = NODES | USERS


def node_of(peer: str) -> NodeId | None:
    """The node that a certificate name speaks of; None for a user."""
    return node_named(peer)


class Handlers:
    """The table. `own_mini` is put on every answer; `hear` gets the mini status of every node that asks."""

    def __init__(self, registry: Callable[[], Registry], own_mini: Callable[[], MiniStatus], hear: Callable[[MiniStatus], object]) -> None:
        self._registry = registry
        self._own_mini = own_mini
        self._hear = hear
        self._table: dict[type[Packet], tuple[Handler[Any], Senders]] = {}

    def add(self, packet: type[P], handler: Handler[P], *, senders: Senders = Senders.ANY) -> None:
        """Let `handler(packet, peer_name)` answer packets of this class; None is no answer. Once a class."""
        assert packet not in self._table, f"{packet.__name__} has a handler already"
        self._table[packet] = (handler, senders)

    async def handle(self, packet: Packet, peer: str) -> Packet | None:
        """The answer to a packet of an authenticated peer; Refused if it may not send it, or nobody answers it."""
        sender = self._sender(peer)
        mini = packet.mini_status
        if mini is not None:
            if mini.node != node_of(peer):
                raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} speaks in the name of node {mini.node}")
            self._hear(mini)
        handler, allowed = self._table.get(type(packet), (None, Senders.ANY))
        if handler is None:
            raise Refused(RejectReason.ILL_FORMED, f"nobody here answers a {type(packet).__name__}")
        if sender not in allowed:
            raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} may not send a {type(packet).__name__}")
        answer = await handler(packet, peer)
        return None if answer is None else replace(answer, mini_status=self._own_mini())

    def _sender(self, peer: str) -> Senders:
        if peer.startswith("user:"):
            return Senders.USERS
        node = node_of(peer)
        if node is None:
            raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} is neither node nor user")
        if self._registry().is_barred(node):
            raise Refused(RejectReason.KEY_REVOKED, f"the key of {peer} is revoked")
        return Senders.NODES

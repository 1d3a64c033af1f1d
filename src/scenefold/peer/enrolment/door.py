"""Who is let in, by the key in its certificate, and shown out again when that counts no longer (specs/15-cluster-log.md, Enrolling).

A certificate stays valid after its keys were revoked, so TLS lets its holder in; here its connection ends. It is told why, once.
A node that nobody knows may do what a newcomer must, and nothing else. Connections that this node opens are judged likewise.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import KeyId, SceneId
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.cluster_log import ClusterLog
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.enrolment.card_rules import is_unknown, refusal_of
from scenefold.peer.handlers import Handlers, node_of
from scenefold.wire import AddNode, LogRecord, MalformedPacket, Packet, ProposeSceneLog, RequestSceneLog, Want
from scenefold.world import Connection, Guests, Links, Priority, QuietLog, Turns, World, serve_connection
from scenefold.world.facts import ClusterFacts
from scenefold.world.serving import Handler

LAST_WORD_S = 3.0
"""One that is not let in may ask that long, and is told why at each request."""

NEWS_S_MAX = 5.0
"""For others to tell whether somebody has become a member."""

_log = logging.getLogger("scenefold.peer")


class Door:
    """Serves connections. `run` looks after those that are open already."""

    def __init__(self, world: World, facts: ClusterFacts, cluster_log: ClusterLog, handlers: Handlers, links: Links) -> None:
        self._world = world
        self._facts = facts
        self._cluster_log = cluster_log
        self._handlers = handlers
        self._links = links
        links.refusal_of = self._refusal_now
        self._quiet = QuietLog(_log)
        turns = Turns(self._is_member)
        self._at = {priority: Guests(turns, int(priority), world.clock.stopwatch) for priority in Priority}
        # Of their own: they come under a member's name, and shall take nothing of its share.
        self._refused = Guests()
        self._guests: dict[trio.CancelScope, tuple[str, KeyId | None]] = {}

    async def serve(self, priority: Priority, connection: Connection) -> None:
        """One connection to a port, until its end or that of its peer's membership."""
        refusal = await self._refusal_of(connection)
        if refusal is None:
            handle = self._newcomers_handler(connection) if self._is_unknown(connection) else self._handlers.handle
            with trio.CancelScope() as scope:
                self._guests[scope] = (connection.peer, connection.peer_key)
                try:
                    await serve_connection(connection, handle, self._quiet, self._at[priority])
                finally:
                    del self._guests[scope]
            return
        self._quiet.say(self._world.clock.now(), connection.peer, refusal.reason.name, f"connection refused: {refusal}")

        async def refuse(_packet: Packet, _peer: str) -> Packet | None:
            raise Refused(refusal.reason, refusal.what, remedy=refusal.remedy)

        with trio.move_on_after(LAST_WORD_S):
            await serve_connection(connection, refuse, self._quiet, self._refused)

    async def _refusal_of(self, connection: Connection) -> Refused | None:
        """Why a peer is not let in. One that this node does not know yet may stand in the log of others."""
        for is_last in (False, True):
            refusal = self._refusal_now(connection)
            is_settled = not self._is_unknown(connection) if refusal is None else refusal.reason is not RejectReason.NOT_READY
            if is_last or is_settled:
                break
            with trio.move_on_after(NEWS_S_MAX):
                await self._cluster_log.pull()
        return refusal

    def _is_member(self, peer: str) -> bool:
        node = node_of(peer)
        return node is not None and self._cluster_log.registry.current(node) is not None

    def _refusal_now(self, connection: Connection) -> Refused | None:
        return refusal_of(connection.peer, connection.peer_key, self._cluster_log.registry, self._facts)

    def _is_unknown(self, connection: Connection) -> bool:
        return is_unknown(connection.peer, self._cluster_log.registry, self._facts)

    def _newcomers_handler(self, connection: Connection) -> Handler:
        """Answers a node that is in no log, until it is."""
        scene = self._facts.genesis_header.scene

        async def handle(packet: Packet, peer: str) -> Packet | None:
            if not self._is_unknown(connection):
                refusal = self._refusal_now(connection)
                if refusal is not None:
                    raise refusal
                return await self._handlers.handle(packet, peer)
            if not is_for_newcomers(packet, scene):
                what = (
                    f"{peer} is no member of this cluster, as far as this node knows its log: until then it may only read that and register"
                )
                raise Refused(RejectReason.NOT_AUTHORISED, what, remedy="join by a token: scenectl cluster join TOKEN")
            # What it says of itself is nobody's status.
            return await self._handlers.handle(replace(packet, mini_status=None), peer)

        return handle

    async def run(self) -> None:
        """Close what a newer log forbids, until cancelled."""
        registry, judged = self._cluster_log.registry, None
        while True:
            # Most of what the log says revokes nothing.
            if registry.roll.revoked is not judged:
                self._show_out(registry)
                judged = registry.roll.revoked
            registry = await self._cluster_log.changed_after(registry.position)

    def _show_out(self, registry: Registry) -> None:
        for scope, (peer, key) in list(self._guests.items()):
            refusal = refusal_of(peer, key, registry, self._facts)
            if refusal is not None:
                _log.info("a connection of %s is closed: %s", peer, refusal)
                scope.cancel()
        self._links.check_again()


def is_for_newcomers(packet: Packet, cluster_log: SceneId) -> bool:
    """Whether a packet asks for the cluster's log, or to be added to it."""
    match packet:
        case RequestSceneLog():
            return packet.scene == cluster_log and packet.want is not Want.LEASE
        case ProposeSceneLog() if packet.public.scene == cluster_log:
            try:
                return isinstance(LogRecord.decode(packet.private).entry, AddNode)
            except MalformedPacket:
                return False
        case _:
            return False

"""Who is let in, by the key in its certificate, and shown out again when that counts no longer (specs/15-cluster-log.md, Enrolling).

A certificate stays valid after its keys were revoked, so TLS lets its holder in; here its connection ends. It is told why, once.
Connections that this node opens are judged likewise.
"""

from __future__ import annotations

import logging

import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import KeyId
from scenefold.base.reasons import RejectReason
from scenefold.peer.card_rules import refusal_of
from scenefold.peer.cluster_log import ClusterLog
from scenefold.peer.handlers import Handlers
from scenefold.peer.registry import Registry
from scenefold.wire import Packet
from scenefold.world import Connection, Guests, Links, Priority, QuietLog, World, serve_connection
from scenefold.world.facts import ClusterFacts

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
        self._at = {priority: Guests() for priority in Priority}
        # Of their own: they come under a member's name, and shall take nothing of its share.
        self._refused = Guests()
        self._guests: dict[trio.CancelScope, tuple[str, KeyId | None]] = {}

    async def serve(self, priority: Priority, connection: Connection) -> None:
        """One connection to a port, until its end or that of its peer's membership."""
        refusal = await self._refusal_of(connection)
        if refusal is None:
            with trio.CancelScope() as scope:
                self._guests[scope] = (connection.peer, connection.peer_key)
                try:
                    await serve_connection(connection, self._handlers.handle, self._quiet, self._at[priority])
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
            if is_last or refusal is None or refusal.reason is not RejectReason.NOT_READY:
                break
            with trio.move_on_after(NEWS_S_MAX):
                await self._cluster_log.pull()
        return refusal

    def _refusal_now(self, connection: Connection) -> Refused | None:
        return refusal_of(connection.peer, connection.peer_key, self._cluster_log.registry, self._facts)

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

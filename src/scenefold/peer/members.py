"""Who is in this cluster, and whose key is it: RequestTable (39) and RequestPublicKey (3).

Who stands on the line, and in which order, says the cluster's log; what each says of itself, the roster.
"""

from __future__ import annotations

from collections.abc import Callable

from scenefold.base.ids import KeyId, NodeId, address_of
from scenefold.base.location import FIRST, Location
from scenefold.crypto import PublicKey
from scenefold.peer.handlers import Handlers, node_of
from scenefold.peer.registered import NO_INCARNATION
from scenefold.peer.registry import Registry
from scenefold.peer.roster import Roster
from scenefold.peer.scenes import Scenes
from scenefold.peer.status import OwnStatus
from scenefold.wire import Packet, PublicKeyInfo, RequestPublicKey, RequestTable, RespondPublicKey, RespondTable, Status

ED25519 = 1


class Members:
    """Answers about members and keys."""

    def __init__(self, own: OwnStatus, roster: Roster, registry: Callable[[], Registry], scenes: Scenes) -> None:
        self._own = own
        self._roster = roster
        self._registry = registry
        self._scenes = scenes

    def register(self, handlers: Handlers) -> None:
        handlers.add(RequestTable, self._on_table)
        handlers.add(RequestPublicKey, self._on_key)

    def table(self) -> list[Status]:
        """A status of every node on the line, from left to right, those that own nothing included.

        One that was never heard stands there unsigned, with Lamport time 0; a founder with its founding arc.
        """
        return [self._own.signed() if node == self._own.me else self._status_of(node) for node in self._registry().order]

    def _status_of(self, node: NodeId) -> Status:
        heard = self._roster.status(node)
        if heard is not None:
            return heard
        registry = self._registry()
        known, founding = registry.current(node), registry.founding_arc(node)
        return Status(
            lamport=0,
            node=node,
            incarnation=NO_INCARNATION if known is None else known.incarnation,
            boot=0,
            address=address_of(node),
            left_fence=None if founding is None or founding.first == FIRST else Location.from_number(founding.first.number - 1),
            right_bound=None if founding is None else founding.last,
        )

    async def _on_table(self, _packet: RequestTable, peer: str) -> Packet:
        # Nodes have the log themselves: what was never heard tells them nothing, and while a cluster starts that is most.
        is_node = node_of(peer) is not None
        return RespondTable(statuses=tuple(status for status in self.table() if status.lamport or not is_node))

    async def _on_key(self, packet: RequestPublicKey, _peer: str) -> Packet:
        key = self._key_of_members(packet.key) or self._key_of_scenes(packet.key)
        if key is None:
            return RespondPublicKey(answer=None)
        return RespondPublicKey(answer=PublicKeyInfo(key=key.key_id, suite=ED25519, exponent=0, raw=key.raw))

    def _key_of_members(self, key: KeyId) -> PublicKey | None:
        registry = self._registry()
        found = (registry.key_of(node) for node in registry.order)
        return next((public for public in found if public is not None and public.key_id == key), None)

    def _key_of_scenes(self, key: KeyId) -> PublicKey | None:
        found = (scene.keys.get(key) for scene in self._scenes.everyone())
        return next((public for public in found if public is not None), None)

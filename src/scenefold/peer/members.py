"""Who is in this cluster, and whose key is it: RequestTable (39) and RequestPublicKey (3)."""

from __future__ import annotations

from collections.abc import Mapping

from scenefold.base.ids import KeyId, NodeId, address_of
from scenefold.crypto import PublicKey
from scenefold.peer.handlers import Handlers
from scenefold.peer.roster import Roster
from scenefold.peer.routing import Routing
from scenefold.peer.scenes import Scenes
from scenefold.peer.status import OwnStatus
from scenefold.wire import Packet, PublicKeyInfo, RequestPublicKey, RequestTable, RespondPublicKey, RespondTable, Status

ED25519 = 1
_NEVER = bytes(16)


class Members:
    """Answers about members and keys."""

    def __init__(self, own: OwnStatus, roster: Roster, routing: Routing, scenes: Scenes, keys: Mapping[NodeId, PublicKey]) -> None:
        self._own = own
        self._roster = roster
        self._routing = routing
        self._scenes = scenes
        self._keys = {key.key_id: key for key in keys.values()}

    def register(self, handlers: Handlers) -> None:
        handlers.add(RequestTable, self._on_table)
        handlers.add(RequestPublicKey, self._on_key)

    def table(self) -> list[Status]:
        """A status of every member in the order of the line.

        A member that was never heard stands there unsigned with Lamport time 0, since it owns its arc all the same.
        """
        heard = {status.node: status for status in self._roster.statuses()}
        heard[self._own.me] = self._own.signed()
        return [heard.get(member) or self._unheard(member) for member in self._routing.members]

    def _unheard(self, member: NodeId) -> Status:
        bound = self._routing.arc_of(member).last
        return Status(lamport=0, node=member, incarnation=_NEVER, boot=0, address=address_of(member), right_bound=bound)

    async def _on_table(self, _packet: RequestTable, _peer: str) -> Packet:
        return RespondTable(statuses=tuple(self.table()))

    async def _on_key(self, packet: RequestPublicKey, _peer: str) -> Packet:
        key = self._keys.get(packet.key) or self._key_of_scenes(packet.key)
        if key is None:
            return RespondPublicKey(answer=None)
        return RespondPublicKey(answer=PublicKeyInfo(key=key.key_id, suite=ED25519, exponent=0, raw=key.raw))

    def _key_of_scenes(self, key: KeyId) -> PublicKey | None:
        found = (scene.keys.get(key) for scene in self._scenes.everyone())
        return next((public for public in found if public is not None), None)

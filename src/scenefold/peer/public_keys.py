"""Whose key is it: RequestPublicKey (3), over TCP for users and by datagram for nodes (thesis C.2; specs/11-peers.md, Public keys).

Known are the keys that members sign with, nodes and users, revoked ones too, since what they signed remains; and all that scenes'
headers name. Nothing is asked of other nodes: whoever does not know a key says so, and a header always holds its own keys.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from scenefold.base.ids import KeyId
from scenefold.crypto import SUITES, Card, PublicKey
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.handlers import Handlers
from scenefold.peer.scene_log.scenes import Scenes
from scenefold.wire import Packet, PublicKeyInfo, RequestPublicKey, RespondPublicKey
from scenefold.world.facts import ClusterFacts


class PublicKeys:
    """Answers about keys."""

    def __init__(self, facts: ClusterFacts, registry: Callable[[], Registry], scenes: Scenes) -> None:
        self._facts = facts
        self._registry = registry
        self._scenes = scenes

    def register(self, handlers: Handlers) -> None:
        handlers.add(RequestPublicKey, self._on_key)

    def find(self, key: KeyId) -> PublicKey | None:
        """The key with this id; None if it is not known here."""
        for scene in self._scenes.everyone():
            if key in scene.keys:
                return scene.keys[key]
        return next((public for public in self._of_members() if public.key_id == key), None)

    def answer(self, packet: RequestPublicKey) -> RespondPublicKey:
        key = self.find(packet.key)
        if key is None:
            return RespondPublicKey(request_id=packet.request_id, answer=None)
        info = PublicKeyInfo(key=key.key_id, suite=key.suite, exponent=SUITES[key.suite].exponent, raw=key.raw)
        return RespondPublicKey(request_id=packet.request_id, answer=info)

    def _of_members(self) -> Iterator[PublicKey]:
        registry = self._registry()
        for node in registry.order:
            known = registry.key_of(node)
            if known is not None:
                yield known
        yield self._facts.log_key
        for owner in self._facts.owners:
            yield Card.read(owner).keys.signing
        for card in registry.roll.cards.values():
            yield card.keys.signing

    async def _on_key(self, packet: RequestPublicKey, _peer: str) -> Packet:
        return self.answer(packet)

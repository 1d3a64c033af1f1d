"""What a node answers to datagrams that ask: for its table, a key, or a proof that it lives (specs/11-peers.md, Gossip)."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from dataclasses import replace

from scenefold.base.ids import NodeId
from scenefold.peer.membership.pages import Pages
from scenefold.peer.membership.proofs import Proofs
from scenefold.peer.membership.status import OwnStatus
from scenefold.wire import RequestProof, RequestPublicKey, RequestState, RespondPublicKey, encode_packet
from scenefold.world import Clock

ANSWER_S_MIN = 0.05
"""Time between two answers to one node, which asks every KNOCK_S_MIN at most."""


class Answering:
    """Answers each node so often and no more."""

    def __init__(
        self, clock: Clock, own: OwnStatus, pages: Pages, proofs: Proofs, send: Callable[[bytes, NodeId], Awaitable[None]]
    ) -> None:
        self._clock = clock
        self._own = own
        self._pages = pages
        self._proofs = proofs
        self._send = send
        self._table_told_at: dict[NodeId, float] = {}
        self._key_told_at: dict[NodeId, float] = {}
        self.key_answer: Callable[[RequestPublicKey], RespondPublicKey] | None = None
        """What a node is told that asks for a key; None: nothing."""

    async def tell_table(self, packet: RequestState, sender: NodeId) -> bool:
        """Tell a node of this one, and of others; False if it asks too often."""
        if not self._is_time(self._table_told_at, sender):
            return False
        await self._send(self._pages.page(packet.request_id), sender)
        return True

    async def tell_key(self, packet: RequestPublicKey, sender: NodeId) -> None:
        if self.key_answer is not None and self._is_time(self._key_told_at, sender):
            await self._send(encode_packet(replace(self.key_answer(packet), mini_status=self._own.mini())), sender)

    async def prove(self, packet: RequestProof, sender: NodeId) -> None:
        answer = self._proofs.given(packet, sender)
        if answer is not None:
            await self._send(encode_packet(answer), sender)

    def _is_time(self, told_at: dict[NodeId, float], sender: NodeId) -> bool:
        now = self._clock.now()
        if now - told_at.get(sender, -math.inf) < ANSWER_S_MIN:
            return False
        told_at[sender] = now
        return True

"""Proof that a node lives, which whoever hands it on can neither have made nor kept (specs/11-peers.md, Suspicion).

A node that does not hear another has it sign a number, through a third one that says that it hears it. The number was drawn a
moment ago, so the signature is younger than the question.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable

import trio

from scenefold.base.ids import NodeId
from scenefold.crypto import ALIVE_DOMAIN, PublicKey
from scenefold.crypto.keys import InvalidSignature
from scenefold.peer.cluster_log.registered import NO_INCARNATION
from scenefold.peer.membership.status import OwnStatus
from scenefold.wire import Member, Packet, RequestProof, ReturnProof
from scenefold.world.buckets import Buckets
from scenefold.world.ports import Clock

PROBE_PAUSES_S = (0.3, 0.6, 1.1)
"""How long a probed node may take to answer, try by try: the last answers of a slow one still count within 2 s."""
SIGNED_BURST = 256
"""Proofs that one node is given at once: it may ask for many others."""
SIGNED_PER_S = 128.0
"""And in each second from then on. To sign one takes a twentieth of a millisecond."""

Send = Callable[[Packet, NodeId], Awaitable[None]]


class Proofs:
    """Gives proof that this node lives, and asks others for theirs. `key_of`: the key that a node signs with, None if none counts."""

    def __init__(self, clock: Clock, own: OwnStatus, send: Send, key_of: Callable[[NodeId], PublicKey | None]) -> None:
        self._clock = clock
        self._own = own
        self._send = send
        self._key_of = key_of
        self._signed = Buckets(SIGNED_BURST, SIGNED_PER_S)
        self._asked: list[_Asked] = []

    def given(self, packet: RequestProof, asker: NodeId) -> ReturnProof | None:
        """The answer to a node that asks; None if it means somebody else, or asks too often."""
        if not self._is_me(packet.member) or not self._signed.take(str(asker), self._clock.now()):
            return None
        return ReturnProof(request_id=packet.request_id, mini_status=self._own.mini(), nonce=packet.nonce, proof=self._sign(packet))

    async def ask(self, member: Member, nonce: bytes) -> bytes:
        """What a member signs, asked up to three times within about 2 s; nothing if it does not answer."""
        question = RequestProof(request_id=1, mini_status=self._own.mini(), member=member, nonce=nonce)
        if member.node == self._own.me:
            return self._sign(question) if self._is_me(member) else b""
        asked = _Asked(question)
        self._asked.append(asked)
        try:
            for pause_s in PROBE_PAUSES_S:
                await self._send(question, member.node)
                with trio.move_on_after(pause_s):
                    await asked.answered.wait()
                    break
        finally:
            self._asked.remove(asked)
        return asked.proof

    def heard(self, packet: ReturnProof, sender: NodeId) -> None:
        """A node has answered."""
        for asked in self._asked:
            if (asked.question.member.node, asked.question.nonce) == (sender, packet.nonce):
                asked.proof = packet.proof
                asked.answered.set()

    def is_right(self, member: Member, nonce: bytes, proof: bytes) -> bool:
        """Whether a member has signed this, as far as its key counts."""
        key = self._key_of(member.node)
        if key is None or not proof:
            return False
        try:
            key.verify(proof, ALIVE_DOMAIN, signable(member, nonce))
        except InvalidSignature:
            return False
        return True

    def _is_me(self, member: Member) -> bool:
        # Who asks for a vacant seat knows of no incarnation yet.
        return member.node == self._own.me and member.incarnation in (self._own.incarnation, NO_INCARNATION)

    def _sign(self, question: RequestProof) -> bytes:
        return self._own.key.sign(ALIVE_DOMAIN, signable(question.member, question.nonce))


class _Asked:
    """A question under way. Whoever asked it may have asked it twice, of others than this node."""

    def __init__(self, question: RequestProof) -> None:
        self.question = question
        self.answered = trio.Event()
        self.proof = b""


def signable(member: Member, nonce: bytes) -> bytes:
    """The bytes that a proof signs."""
    return nonce + member.node.to_bytes(4, "big") + member.incarnation

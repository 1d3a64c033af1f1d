"""How a newcomer finds nodes on its local network: one question to everybody, short answers (specs/15-cluster-log.md, Enrolling). Pure.

    question   "SFDQ" | version u8 = 1 | invitation 32 | nonce 16 | signature 64
    answer     "SFDA" | version u8 = 1 | nonce 16 | node u32

An answer is shorter than its question, so nobody can be flooded by asking in his name; and it need not be signed, since the newcomer
believes a node by its certificate, and who lies costs it one connection.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId
from scenefold.crypto import InvalidSignature, PublicKey, SigningKey

DISCOVER_DOMAIN = b"scenefold/discover"
NONCE_BYTES = 16
_VERSION = 1
_QUESTION = struct.Struct(">4sB32s16s64s")
_ANSWER = struct.Struct(">4sB16sI")
_ASKS, _ANSWERS = b"SFDQ", b"SFDA"


@dataclass(frozen=True, slots=True)
class Question:
    """Where is the cluster of this invitation? Not yet verified: see `is_signed`."""

    invitation: bytes
    nonce: bytes
    signature: bytes

    def is_signed(self) -> bool:
        """Whether who asks has the token."""
        try:
            PublicKey(self.invitation).verify(self.signature, DISCOVER_DOMAIN, self.nonce)
        except (InvalidSignature, DamagedData):
            return False
        return True


def pack_question(key: SigningKey, nonce: bytes) -> bytes:
    """The question of who holds the key of an invitation."""
    return _QUESTION.pack(_ASKS, _VERSION, key.public.raw, nonce, key.sign(DISCOVER_DOMAIN, nonce))


def read_question(data: bytes) -> Question | None:
    """The question that `data` is, wholly; None for anything else."""
    if len(data) != _QUESTION.size:
        return None
    magic, version, invitation, nonce, signature = _QUESTION.unpack(data)
    return Question(invitation, nonce, signature) if (magic, version) == (_ASKS, _VERSION) else None


def pack_answer(nonce: bytes, node: NodeId) -> bytes:
    """Here is one of its nodes."""
    return _ANSWER.pack(_ANSWERS, _VERSION, nonce, node)


def read_answer(data: bytes, nonce: bytes) -> NodeId | None:
    """Who answers the question with this nonce; None for anything else."""
    if len(data) != _ANSWER.size:
        return None
    magic, version, answered, node = _ANSWER.unpack(data)
    return NodeId(node) if (magic, version, answered) == (_ANSWERS, _VERSION, nonce) else None

"""Who takes part: a node in one of its lives, with the key that its word in a log is signed with (specs/25-consensus.md, Terms)."""

from __future__ import annotations

from dataclasses import dataclass

from scenefold.wire.common import DIGEST, INCARNATION, U32, NodeId
from scenefold.wire.containers import Struct


@dataclass(frozen=True, slots=True)
class Member:
    node: NodeId
    incarnation: bytes


@dataclass(frozen=True, slots=True)
class ParticipantEntry:
    """A participant or observer of a log. `key`: Ed25519, that its facts are verified with."""

    member: Member
    key: bytes


MEMBER = Struct(Member, ("node", U32), ("incarnation", INCARNATION))
PARTICIPANT_ENTRY = Struct(ParticipantEntry, ("member", MEMBER), ("key", DIGEST))
STRUCTS = (MEMBER, PARTICIPANT_ENTRY)

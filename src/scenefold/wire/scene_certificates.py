"""Who decided a scene's header, for those who have nothing but the header (specs/16-scene-log.md, Decisions, form 2).

A value of a scene's log is decided by its digest, and names by hashes what it says: who decides it, who decides the position after it,
and the public header, which names the sealed log in turn. So a certificate can show who decides from there on, and nothing else of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from scenefold.base.limits import CERTIFICATE_BYTES_MAX, DECIDERS_MAX, LOG_BODY_BYTES_MAX
from scenefold.wire.ballots import BALLOT, Ballot
from scenefold.wire.common import DIGEST, LOG, U32, U64, NodeId
from scenefold.wire.containers import Many, Struct
from scenefold.wire.kinds import Bin
from scenefold.wire.log_records import hash_of_record
from scenefold.wire.members import PARTICIPANT_ENTRY, ParticipantEntry
from scenefold.wire.pieces import pack_piece, unpack_piece
from scenefold.wire.scene_headers import SCENE_LOG_PUBLIC, SceneLogPublic

_ROSTERS_MAX = 256
"""Those who decide change seldom, and each value names them."""


@dataclass(frozen=True, slots=True)
class NodeSignature:
    """The signature of a vote; all else of it stands in the certificate."""

    node: NodeId
    signature: bytes


@dataclass(frozen=True, slots=True)
class SceneCertificate:
    """That a position was decided. `header`: digest of its public header. `participants`: who decides from there on, if somebody else does."""

    position: int
    ballot: Ballot
    header: bytes
    participants: tuple[ParticipantEntry, ...]
    votes: tuple[NodeSignature, ...]

    def encode(self) -> bytes:
        return pack_piece(SCENE_CERTIFICATE, self, size_max=CERTIFICATE_BYTES_MAX)

    @classmethod
    def decode(cls, data: bytes) -> SceneCertificate:
        """MalformedPacket if it is none."""
        return unpack_piece(SCENE_CERTIFICATE, data, size_max=CERTIFICATE_BYTES_MAX)


@dataclass(frozen=True, slots=True)
class SceneBody:
    """The body of a scene's value. `private`: the sealed log; empty where a newer one holds all of it."""

    public: SceneLogPublic
    private: bytes

    def encode(self) -> bytes:
        return pack_piece(SCENE_BODY, self, size_max=LOG_BODY_BYTES_MAX)

    @classmethod
    def decode(cls, data: bytes) -> SceneBody:
        """MalformedPacket if it is none."""
        return unpack_piece(SCENE_BODY, data, size_max=LOG_BODY_BYTES_MAX)


NODE_SIGNATURE = Struct(NodeSignature, ("node", U32), ("signature", Bin(lengths=(64,))))
_PARTICIPANTS = Many(PARTICIPANT_ENTRY, DECIDERS_MAX)
SCENE_CERTIFICATE = Struct(
    SceneCertificate,
    ("position", U64),
    ("ballot", BALLOT),
    ("header", DIGEST),
    ("participants", _PARTICIPANTS),
    ("votes", Many(NODE_SIGNATURE, DECIDERS_MAX)),
)
SCENE_BODY = Struct(SceneBody, ("public", SCENE_LOG_PUBLIC), ("private", LOG))
STRUCTS = (NODE_SIGNATURE, SCENE_CERTIFICATE, SCENE_BODY)


def digest_of_header(public: SceneLogPublic) -> bytes:
    """Of all that its author signed: what decides it, and by which signature it was proposed, are left out."""
    return hash_of_record(public.signable())


@lru_cache(_ROSTERS_MAX)
def digest_of_participants(participants: tuple[ParticipantEntry, ...]) -> bytes:
    """Of those who decide, in the order of their nodes."""
    return hash_of_record(pack_piece(_PARTICIPANTS, participants))

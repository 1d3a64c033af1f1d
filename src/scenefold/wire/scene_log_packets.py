"""Packets 5 to 9: scene logs and proposals (design of the consensus §3, thesis C.3).

The public header of a scene is complete here; the private part of the log is sealed for the participants
elsewhere and travels as opaque bytes, as do proposed records.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import ClassVar

from scenefold.base.limits import PARTICIPANTS_MAX, SPACES_PER_SCENE_MAX, WRITERS_PER_SCENE_MAX
from scenefold.base.reasons import RejectReason
from scenefold.wire.common import (
    BOOL,
    DIGEST,
    INCARNATION,
    LOCATION,
    LOG,
    REASON,
    SCENE,
    SIGNATURE,
    SPACE,
    SPACE_OR_NONE,
    U8,
    U32,
    U64,
    Carrier,
    KeyId,
    Location,
    NodeId,
    Packet,
    SceneId,
    SpaceId,
    row,
)
from scenefold.wire.containers import Many, Struct
from scenefold.wire.kinds import Bin, Choice, Maybe, Uint
from scenefold.wire.pieces import pack_piece, unpack_piece
from scenefold.wire.status_packets import UNSIGNED

NO_GENESIS = bytes(32)
MAC = Bin(lengths=(0, 32))
GENESIS_OR_ANY = Bin(lengths=(0, 32))
PROOF = Bin(lengths=(0, 32, 64, 384))


class SceneMode(IntEnum):
    EDIT = 0
    RENDER = 1


class Phase(IntEnum):
    PREPARE = 1
    ACCEPT = 2


class Want(IntEnum):
    """What a RequestSceneLog asks for."""

    HEADER = 1
    LOG = 2
    LEASE = 3


@dataclass(frozen=True, slots=True, order=True)
class Ballot:
    """Ordered by counter, then node; (0, 0) is none."""

    counter: int
    node: NodeId


@dataclass(frozen=True, slots=True)
class ProposalId:
    position: int
    ballot: Ballot
    phase: Phase


@dataclass(frozen=True, slots=True)
class Member:
    node: NodeId
    incarnation: bytes


@dataclass(frozen=True, slots=True)
class Highest:
    """The accepted record of the highest ballot that was met on the way."""

    ballot: Ballot
    record: bytes


@dataclass(frozen=True, slots=True)
class SpaceEntry:
    """What nodes without the key must know of a space. `parent` 0: no shadow."""

    space: SpaceId
    parent: SpaceId
    offset: Location
    copies: int
    copies_min: int
    render_output: bool
    node_managed: bool


@dataclass(frozen=True, slots=True)
class WriterEntry:
    """A writer's key and the log positions that it may sign under; `until` 2^64 - 1: not ended."""

    key: KeyId
    from_position: int
    until_position: int


@dataclass(frozen=True, slots=True)
class KeyEntry:
    """A public key in full: suite 1 is Ed25519."""

    suite: int
    raw: bytes


BALLOT = Struct(Ballot, ("counter", U32), ("node", U32))
PROPOSAL_ID = Struct(ProposalId, ("position", U64), ("ballot", BALLOT), ("phase", Choice(Phase)))
MEMBER = Struct(Member, ("node", U32), ("incarnation", INCARNATION))
MEMBERS = Many(MEMBER, PARTICIPANTS_MAX)
HIGHEST = Struct(Highest, ("ballot", BALLOT), ("record", LOG))
SPACE_ENTRY = Struct(
    SpaceEntry,
    ("space", SPACE),
    ("parent", SPACE_OR_NONE),
    ("offset", LOCATION),
    ("copies", U8),
    ("copies_min", U8),
    ("render_output", BOOL),
    ("node_managed", BOOL),
)
WRITER_ENTRY = Struct(WriterEntry, ("key", U32), ("from_position", U64), ("until_position", U64))
KEY_ENTRY = Struct(KeyEntry, ("suite", U8), ("raw", Bin(lengths=(32, 384))))


@dataclass(frozen=True, slots=True)
class SceneLogPublic:
    """The public header of a scene: all that nodes without its key need, signed by its participants.

    `keys` holds in full every key that is named by an id, so that whoever has the header can verify the
    header and every record without asking further.
    """

    scene: SceneId
    genesis: bytes
    origin: NodeId
    position: int
    write_floor: int
    mode: SceneMode
    spaces: tuple[SpaceEntry, ...]
    writers: tuple[WriterEntry, ...]
    public_key: KeyId
    private_key: KeyId
    keys: tuple[KeyEntry, ...]
    signature: bytes = UNSIGNED

    def signable(self) -> bytes:
        """The bytes that `signature` signs, under the domain scenefold/header."""
        return pack_piece(SCENE_LOG_PUBLIC, replace(self, signature=UNSIGNED))

    def with_genesis(self) -> SceneLogPublic:
        """This header as the first of its scene: genesis and scene id are its own hash."""
        import hashlib

        unborn = replace(self, scene=SceneId(1), genesis=NO_GENESIS, signature=UNSIGNED)
        genesis = hashlib.sha256(pack_piece(SCENE_LOG_PUBLIC, unborn)).digest()
        return replace(self, scene=SceneId(int.from_bytes(genesis[:4], "big")), genesis=genesis)

    def encode(self) -> bytes:
        """The header with its signature, as it is stored; LocalFault if a field is out of bounds."""
        return pack_piece(SCENE_LOG_PUBLIC, self)

    @classmethod
    def decode(cls, data: bytes) -> SceneLogPublic:
        """The header that `data` is, wholly; MalformedPacket otherwise."""
        return unpack_piece(SCENE_LOG_PUBLIC, data)


SCENE_LOG_PUBLIC = Struct(
    SceneLogPublic,
    ("scene", SCENE),
    ("genesis", DIGEST),
    ("origin", U32),
    ("position", U64),
    ("write_floor", U64),
    ("mode", Choice(SceneMode)),
    ("spaces", Many(SPACE_ENTRY, SPACES_PER_SCENE_MAX)),
    ("writers", Many(WRITER_ENTRY, WRITERS_PER_SCENE_MAX)),
    ("public_key", U32),
    ("private_key", U32),
    ("keys", Many(KEY_ENTRY, WRITERS_PER_SCENE_MAX)),
    ("signature", SIGNATURE),
)


@dataclass(frozen=True, slots=True)
class SceneLogAnswer:
    """Body of a RespondSceneLog. `flags`: bit 0 GRANT, bit 1 COMMIT."""

    nonce: int
    flags: int
    position: int
    ballot: Ballot
    nodes: tuple[Member, ...]
    public: SceneLogPublic
    private: bytes | None
    mac_epoch: int
    mac: bytes


SCENE_LOG_ANSWER = Struct(
    SceneLogAnswer,
    ("nonce", U64),
    ("flags", Uint(8, most=3)),
    ("position", U64),
    ("ballot", BALLOT),
    ("nodes", MEMBERS),
    ("public", SCENE_LOG_PUBLIC),
    ("private", Maybe(LOG)),
    ("mac_epoch", U32),
    ("mac", MAC),
)


@dataclass(frozen=True, slots=True)
class RequestSceneLog(Packet):
    """`genesis` empty: whatever scene has this id here. `lives`: with LEASE, the two that the asker's disk holds."""

    TYPE: ClassVar[int] = 5
    BULK_ANSWER: ClassVar[bool] = True
    scene: SceneId
    genesis: bytes
    have: int
    nonce: int
    want: Want
    member: Member | None = None
    proof: bytes = b""
    lives: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class RespondSceneLog(Packet):
    """None: the scene is unknown here."""

    TYPE: ClassVar[int] = 6
    answer: SceneLogAnswer | None


@dataclass(frozen=True, slots=True)
class ProposeSceneLog(Packet):
    TYPE: ClassVar[int] = 7
    genesis: bytes
    proposal: ProposalId
    route: tuple[NodeId, ...]
    nodes: tuple[Member, ...]
    highest: Highest | None
    takeover: bool
    public: SceneLogPublic
    private: bytes
    mac_epoch: int
    mac: bytes


@dataclass(frozen=True, slots=True)
class AcceptSceneProposal(Packet):
    TYPE: ClassVar[int] = 8
    genesis: bytes
    proposal: ProposalId
    record_hash: bytes
    nodes: tuple[Member, ...]
    highest: Highest | None
    mac_epoch: int
    mac: bytes


@dataclass(frozen=True, slots=True)
class RejectSceneProposal(Packet):
    TYPE: ClassVar[int] = 9
    genesis: bytes
    proposal: ProposalId
    reason: RejectReason
    nodes: tuple[Member, ...]
    hint: Ballot
    node: NodeId
    mac_epoch: int
    mac: bytes


ROWS = (
    row(
        RequestSceneLog,
        Carrier.UDP_HIGH,
        ("scene", SCENE),
        ("genesis", GENESIS_OR_ANY),
        ("have", U64),
        ("nonce", U64),
        ("want", Choice(Want)),
        ("member", Maybe(MEMBER)),
        ("proof", PROOF),
        ("lives", Many(U64, counts=(0, 2))),
    ),
    row(RespondSceneLog, Carrier.BOTH_HIGH, ("answer", Maybe(SCENE_LOG_ANSWER))),
    row(
        ProposeSceneLog,
        Carrier.TCP_HIGH,
        ("genesis", DIGEST),
        ("proposal", PROPOSAL_ID),
        ("route", Many(U32, PARTICIPANTS_MAX)),
        ("nodes", MEMBERS),
        ("highest", Maybe(HIGHEST)),
        ("takeover", BOOL),
        ("public", SCENE_LOG_PUBLIC),
        ("private", LOG),
        ("mac_epoch", U32),
        ("mac", MAC),
    ),
    row(
        AcceptSceneProposal,
        Carrier.TCP_HIGH,
        ("genesis", DIGEST),
        ("proposal", PROPOSAL_ID),
        ("record_hash", DIGEST),
        ("nodes", MEMBERS),
        ("highest", Maybe(HIGHEST)),
        ("mac_epoch", U32),
        ("mac", MAC),
    ),
    row(
        RejectSceneProposal,
        Carrier.TCP_HIGH,
        ("genesis", DIGEST),
        ("proposal", PROPOSAL_ID),
        ("reason", REASON),
        ("nodes", MEMBERS),
        ("hint", BALLOT),
        ("node", U32),
        ("mac_epoch", U32),
        ("mac", MAC),
    ),
)
STRUCTS = (
    BALLOT,
    PROPOSAL_ID,
    MEMBER,
    HIGHEST,
    SPACE_ENTRY,
    WRITER_ENTRY,
    KEY_ENTRY,
    SCENE_LOG_PUBLIC,
    SCENE_LOG_ANSWER,
)

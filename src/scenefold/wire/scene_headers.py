"""The public header of a scene: all that nodes without its key need (design of the consensus §3; specs/16-scene-log.md)."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from enum import IntEnum

from scenefold.base.limits import (
    CERTIFICATE_BYTES_MAX,
    CERTIFICATES_MAX,
    DECIDERS_MAX,
    FORMER_KEYS_BYTES_MAX,
    HEADER_KEYS_MAX,
    LOCKBOX_BYTES_MAX,
    PARTICIPANTS_MAX,
    SPACES_PER_SCENE_MAX,
    WRITERS_PER_SCENE_MAX,
)
from scenefold.wire.common import (
    BOOL,
    DIGEST,
    LOCATION,
    SCENE,
    SIGNATURE,
    SPACE,
    SPACE_OR_NONE,
    U8,
    U32,
    U64,
    KeyId,
    Location,
    NodeId,
    SceneId,
    SpaceId,
)
from scenefold.wire.containers import Late, Many, Struct
from scenefold.wire.kinds import Bin, Choice, Maybe, Uint
from scenefold.wire.members import PARTICIPANT_ENTRY, ParticipantEntry
from scenefold.wire.pieces import pack_piece, unpack_piece
from scenefold.wire.status_packets import UNSIGNED

NO_GENESIS = bytes(32)
NO_LOG = bytes(32)
"""In place of the hash of a log."""
_GENESIS_DOMAIN = b"scenefold/genesis"


class SceneMode(IntEnum):
    EDIT = 0
    RENDER = 1
    ENDED = 2
    """For ever: nothing follows it, and nobody sets it but EndScene."""


@dataclass(frozen=True, slots=True)
class SpaceEntry:
    """What nodes without the key must know of a space. `parent` 0: no shadow; then `offset` is the position at which other copies of it came to
    count, as a number, and 0 if that never happened (specs/23-turns.md)."""

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


@dataclass(frozen=True, slots=True)
class Lockbox:
    """The scene's keys, sealed to the member whose sealing key has this id, and signed by who granted them (specs/04-records.md, Lockboxes)."""

    recipient: KeyId
    sealed: bytes
    signature: bytes


@dataclass(frozen=True, slots=True)
class Succession:
    """From this position on the scene's header key is another; the one before it signed so (specs/16-scene-log.md)."""

    position: int
    key: bytes
    signature: bytes


@dataclass(frozen=True, slots=True)
class Decision:
    """Who decided a header, by whose signatures (specs/16-scene-log.md, Decisions). `form` says what the certificates are.

    A form that is not known can be read, so that one scene of a later program does not hide all others.
    """

    form: int
    certificates: tuple[bytes, ...]


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
LOCKBOX = Struct(Lockbox, ("recipient", U32), ("sealed", Bin(LOCKBOX_BYTES_MAX)), ("signature", SIGNATURE))
SUCCESSION = Struct(Succession, ("position", U64), ("key", Bin(lengths=(32,))), ("signature", Bin(lengths=(64,))))
DECISION = Struct(Decision, ("form", U8), ("certificates", Many(Bin(CERTIFICATE_BYTES_MAX), CERTIFICATES_MAX)))
DECISION_OR_NONE = Maybe(DECISION)


@dataclass(frozen=True, slots=True)
class SceneLogPublic:
    """The public header of a scene: all that nodes without its key need, signed by an owner, and decided by the node `origin`.

    `keys` holds in full every key that is named by an id, so that whoever has the header can verify the
    header and every record without asking further. `key_epoch`: of the symmetric key that new records are sealed under;
    `former_keys`: those before it, sealed under it. `birth` and `first_key` stay as they were at position 1: they are what the genesis
    is the hash of, so a header of any position shows which key the scene began with; and so is `origin_key`, by which `origin` decides.
    `log_hash`: of the sealed log of the same position. `decision` None: it was proposed, and no more. `purged`: the position at which
    the newest purge of deletions began; 0 if none did (specs/22-purge.md). `participants` decide the next position, by their nodes' ids; as
    long as there are none, `origin` does. `observers` likewise. `request` and `previous`, the request id of the newest record and the digest
    of the header before: of a position that participants have decided, else empty (specs/16-scene-log.md, Participants).
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
    key_epoch: int = 0
    former_keys: bytes = b""
    lockboxes: tuple[Lockbox, ...] = ()
    succession: tuple[Succession, ...] = ()
    birth: bytes = NO_GENESIS
    first_key: bytes = NO_GENESIS
    origin_key: bytes = NO_GENESIS
    log_hash: bytes = NO_LOG
    participants: tuple[ParticipantEntry, ...] = ()
    observers: tuple[ParticipantEntry, ...] = ()
    request: bytes = b""
    previous: bytes = b""
    signature: bytes = UNSIGNED
    decision: Decision | None = None
    purged: int = 0
    _signable: bytes | None = field(default=None, init=False, repr=False, compare=False)
    """Packed once: whoever decides on a header looks at these bytes a dozen times."""

    def signable(self) -> bytes:
        """The bytes that `signature` signs, under the domain scenefold/header, and `decision` under scenefold/decided."""
        if self._signable is None:
            packed = pack_piece(SCENE_LOG_PUBLIC, replace(self, signature=UNSIGNED, decision=None))
            object.__setattr__(self, "_signable", packed)
            return packed
        return self._signable

    def proposed(self) -> SceneLogPublic:
        """This header as its author proposed it."""
        return self if self.decision is None else self.decided_by(None)

    def decided_by(self, decision: Decision | None) -> SceneLogPublic:
        """This header with another decision, or none."""
        other = replace(self, decision=decision)
        object.__setattr__(other, "_signable", self._signable)
        return other

    def with_genesis(self) -> SceneLogPublic:
        """This header as the first of its scene: genesis and scene id follow from it, but for lockboxes and log, which name the genesis,
        and who takes part.

        `first_key` must be there, the key that it is signed with, in full; and `origin_key`.
        """
        # Who takes part is decided with the header; a creation that was interrupted may go on with others.
        unborn = replace(
            self,
            scene=SceneId(1),
            genesis=NO_GENESIS,
            lockboxes=(),
            participants=(),
            observers=(),
            birth=NO_GENESIS,
            log_hash=NO_LOG,
            signature=UNSIGNED,
            decision=None,
        )
        born = replace(self, birth=hashlib.sha256(pack_piece(SCENE_LOG_PUBLIC, unborn)).digest())
        genesis = born.proven_genesis()
        return replace(born, scene=SceneId(int.from_bytes(genesis[:4], "big")), genesis=genesis)

    def proven_genesis(self) -> bytes:
        """The genesis of the only scene that a header with this birth, first key, origin and origin's key can belong to."""
        began = _GENESIS_DOMAIN, self.origin.to_bytes(4, "big"), self.origin_key, self.first_key, self.birth
        return hashlib.sha256(b"".join(began)).digest()

    def encode(self) -> bytes:
        """The header with its signature and decision, as it is stored; LocalFault if a field is out of bounds."""
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
    ("key_epoch", U32),
    ("former_keys", Bin(FORMER_KEYS_BYTES_MAX)),
    ("lockboxes", Many(LOCKBOX, WRITERS_PER_SCENE_MAX)),
    ("succession", Many(SUCCESSION, HEADER_KEYS_MAX)),
    ("birth", DIGEST),
    ("first_key", DIGEST),
    ("origin_key", DIGEST),
    ("log_hash", DIGEST),
    ("participants", Many(PARTICIPANT_ENTRY, DECIDERS_MAX)),
    ("observers", Many(PARTICIPANT_ENTRY, PARTICIPANTS_MAX)),
    ("request", Bin(lengths=(0, 16))),
    ("previous", Bin(lengths=(0, 32))),
    ("signature", SIGNATURE),
    ("decision", DECISION_OR_NONE),
    ("purged", Late(Uint(64, least=1), 0)),
)

STRUCTS = (SPACE_ENTRY, WRITER_ENTRY, KEY_ENTRY, LOCKBOX, SUCCESSION, DECISION, SCENE_LOG_PUBLIC)

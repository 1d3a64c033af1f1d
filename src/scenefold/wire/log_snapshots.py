"""A scene's log that begins with a snapshot: what its first records add up to, signed in their place (specs/16-scene-log.md, Snapshots).

The state as bytes, no more: whether a log can come to it knows who folds logs.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from scenefold.base.limits import (
    DECIDERS_MAX,
    LOG_BYTES_MAX,
    LOG_RECORDS_MAX,
    LOG_REQUESTS_KEPT,
    PARTICIPANTS_MAX,
    SPACES_PER_SCENE_MAX,
    WRITERS_PER_SCENE_MAX,
)
from scenefold.wire.common import DIGEST, U8, U64
from scenefold.wire.containers import Many, Struct
from scenefold.wire.kinds import Bin, Choice, Uint
from scenefold.wire.log_entries import CREATE_SPACE, GRANT, CreateSpace, Grant
from scenefold.wire.log_records import SIGNED_RECORD, SignedRecord
from scenefold.wire.members import PARTICIPANT_ENTRY, ParticipantEntry
from scenefold.wire.pieces import pack_piece, unpack_piece
from scenefold.wire.render_settings import RENDER_SETTINGS, RenderSettings
from scenefold.wire.scene_headers import KEY_ENTRY, WRITER_ENTRY, KeyEntry, SceneMode, WriterEntry

REQUEST_ID_BYTES = 16


@dataclass(frozen=True, slots=True)
class SnapshotSpace:
    """A space, with the copies that it has now. `steps`: all that the log did to it, in rows; a shadow has none of its own."""

    space: CreateSpace
    created: int
    turned: int
    steps: bytes


@dataclass(frozen=True, slots=True)
class SnapshotMember:
    """A member, by an entry that gives it the role that it has. `position`: of the entry that did."""

    grant: Grant
    position: int


@dataclass(frozen=True, slots=True)
class SnapshotState:
    """What the records up to `position` fold to. `head`: the hash of the last of them.

    `former_keys`: of the epochs before the present one, from 0 on; `requests`: the ids of the newest positions, the newest last.
    """

    position: int
    head: bytes
    mode: SceneMode
    write_floor: int
    purged: int
    spaces: tuple[SnapshotSpace, ...]
    participants: tuple[ParticipantEntry, ...]
    observers: tuple[ParticipantEntry, ...]
    members: tuple[SnapshotMember, ...]
    writers: tuple[WriterEntry, ...]
    writer_keys: tuple[KeyEntry, ...]
    keyed_at: int
    header_keyed_at: int
    header_keys: int
    revoked_at: int
    former_keys: bytes = field(repr=False)
    requests: bytes = field(repr=False)
    render: RenderSettings

    def encode(self) -> bytes:
        """The state's bytes; LocalFault if a field is out of bounds, or all together are too long for a log."""
        return pack_piece(SNAPSHOT_STATE, self, size_max=LOG_BYTES_MAX)

    @classmethod
    def decode(cls, data: bytes) -> SnapshotState:
        """The state that `data` is, wholly; MalformedPacket otherwise."""
        return unpack_piece(SNAPSHOT_STATE, data, size_max=LOG_BYTES_MAX)


@dataclass(frozen=True, slots=True)
class SignedSnapshot:
    """The bytes of a SnapshotState, signed by the scene's header key under the domain scenefold/snapshot."""

    state: bytes = field(repr=False)
    signature: bytes

    def signable(self, genesis: bytes) -> bytes:
        """What `signature` signs: a snapshot is one of its scene alone."""
        return genesis + self.state


@dataclass(frozen=True, slots=True)
class ShortenedLog:
    """A log as it travels that begins with a snapshot; `records` come behind it."""

    snapshot: SignedSnapshot
    records: tuple[SignedRecord, ...]

    def encode(self) -> bytes:
        """At most LOG_BYTES_MAX; LocalFault if it is longer."""
        return pack_piece(SHORTENED_LOG, self, size_max=LOG_BYTES_MAX)

    @classmethod
    def decode(cls, data: bytes) -> ShortenedLog:
        """The log that `data` is, wholly; MalformedPacket otherwise. What is inside of state and records is not looked at."""
        return unpack_piece(SHORTENED_LOG, data, size_max=LOG_BYTES_MAX)


_POSITION = Uint(64, least=1)
_BYTES = Bin(LOG_BYTES_MAX)
SNAPSHOT_SPACE = Struct(SnapshotSpace, ("space", CREATE_SPACE), ("created", _POSITION), ("turned", U64), ("steps", _BYTES))
SNAPSHOT_MEMBER = Struct(SnapshotMember, ("grant", GRANT), ("position", _POSITION))
SNAPSHOT_STATE = Struct(
    SnapshotState,
    ("position", _POSITION),
    ("head", DIGEST),
    # No snapshot stands for the last entry.
    ("mode", Choice(SceneMode, SceneMode.RENDER)),
    ("write_floor", U64),
    ("purged", U64),
    ("spaces", Many(SNAPSHOT_SPACE, SPACES_PER_SCENE_MAX)),
    ("participants", Many(PARTICIPANT_ENTRY, DECIDERS_MAX)),
    ("observers", Many(PARTICIPANT_ENTRY, PARTICIPANTS_MAX)),
    ("members", Many(SNAPSHOT_MEMBER, WRITERS_PER_SCENE_MAX)),
    ("writers", Many(WRITER_ENTRY, WRITERS_PER_SCENE_MAX)),
    ("writer_keys", Many(KEY_ENTRY, WRITERS_PER_SCENE_MAX)),
    ("keyed_at", _POSITION),
    ("header_keyed_at", _POSITION),
    ("header_keys", U8),
    ("revoked_at", U64),
    ("former_keys", _BYTES),
    ("requests", Bin(LOG_REQUESTS_KEPT * REQUEST_ID_BYTES)),
    ("render", RENDER_SETTINGS),
)
SIGNED_SNAPSHOT = Struct(SignedSnapshot, ("state", _BYTES), ("signature", Bin(lengths=(64,))))
SHORTENED_LOG = Struct(ShortenedLog, ("snapshot", SIGNED_SNAPSHOT), ("records", Many(SIGNED_RECORD, LOG_RECORDS_MAX)))
STRUCTS = (SNAPSHOT_SPACE, SNAPSHOT_MEMBER, SNAPSHOT_STATE, SIGNED_SNAPSHOT, SHORTENED_LOG)

"""What is decided at a position of a log, as it travels and is kept (specs/25-consensus.md, Terms; specs/03-wire.md)."""

from __future__ import annotations

from dataclasses import dataclass, field

from scenefold.base.limits import DECIDED_MAX, LOG_BODY_BYTES_MAX, LOG_RECORD_BYTES_MAX
from scenefold.wire.ballots import BALLOT, Ballot
from scenefold.wire.common import DIGEST, U64
from scenefold.wire.containers import Many, Struct
from scenefold.wire.facts import RELEASES, VOTES, Release, Vote
from scenefold.wire.kinds import Bin
from scenefold.wire.log_records import hash_of_record
from scenefold.wire.pieces import pack_piece, unpack_piece


@dataclass(frozen=True, slots=True)
class LogValue:
    """A value; two with the same `data` are the same one.

    `body` is what the data names by hashes: the digest holds it, too, and whoever does not need it can do without and check certificates
    all the same. What the two are knows the log's judge alone, who refuses a body that is not the one that is named.
    """

    data: bytes = field(repr=False)
    body: bytes = field(default=b"", repr=False, compare=False)
    digest: bytes = field(init=False, compare=False)
    """SHA-512/256 of the data, like the hash of a log's record."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "digest", hash_of_record(self.data))

    def encode(self) -> bytes:
        """Both parts, as they are kept: at most LOG_VALUE_BYTES_MAX; LocalFault if one is too large."""
        return pack_piece(LOG_VALUE, self)

    @classmethod
    def decode(cls, data: bytes) -> LogValue:
        """The value that `data` is, wholly; MalformedPacket otherwise."""
        return unpack_piece(LOG_VALUE, data)


@dataclass(frozen=True, slots=True)
class DecidedValue:
    """A value that was decided, the votes that show it, and the releases that were seen (specs/26-modes.md).

    `seen`: when whoever tells this learnt it, in milliseconds since the epoch; 0: not said.
    """

    position: int
    value: LogValue
    ballot: Ballot
    votes: tuple[Vote, ...]
    releases: tuple[Release, ...] = ()
    seen: int = 0

    def encode(self) -> bytes:
        """As it is kept; LocalFault if a field is out of bounds."""
        return pack_piece(DECIDED_VALUE, self)

    @classmethod
    def decode(cls, data: bytes) -> DecidedValue:
        """What `data` is, wholly; MalformedPacket otherwise."""
        return unpack_piece(DECIDED_VALUE, data)


@dataclass(frozen=True, slots=True)
class DecidedLog:
    """What is decided of a log, from some position on, as far as it fits. `newest`: how far the sender knows it."""

    genesis: bytes
    newest: int
    decided: tuple[DecidedValue, ...]


LOG_VALUE = Struct(LogValue, ("data", Bin(LOG_RECORD_BYTES_MAX)), ("body", Bin(LOG_BODY_BYTES_MAX)))
DECIDED_VALUE = Struct(
    DecidedValue,
    ("position", U64),
    ("value", LOG_VALUE),
    ("ballot", BALLOT),
    ("votes", VOTES),
    ("releases", RELEASES),
    ("seen", U64),
)
DECIDED_LOG = Struct(DecidedLog, ("genesis", DIGEST), ("newest", U64), ("decided", Many(DECIDED_VALUE, DECIDED_MAX)))
STRUCTS = (LOG_VALUE, DECIDED_VALUE, DECIDED_LOG)

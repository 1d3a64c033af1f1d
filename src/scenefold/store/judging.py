"""Whether a new record may take its place: pure, called inside the write transaction (design: storage, data packets)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record, RecordHeader, version_key


class Outcome(Enum):
    """What became of a put."""

    STORED = "stored"
    """Durable now, or the same bytes were already: a retry is no error."""
    STALE = "stale"
    """A version as high or higher is there."""
    EXISTS = "exists"
    """What is there is not what the writer expected."""
    FULL = "full"
    """The disk has no room beyond its reserve; nothing was changed."""
    NOT_OWNED = "not owned"
    """The place lies outside of the arc that this node owned at the moment of the commit."""


_REASONS = {
    Outcome.STORED: None,
    Outcome.STALE: RejectReason.STALE_VERSION,
    Outcome.EXISTS: RejectReason.STALE_VERSION,
    Outcome.FULL: RejectReason.STORAGE_FULL,
    Outcome.NOT_OWNED: RejectReason.NOT_MY_LOCATION,
}


@dataclass(frozen=True, slots=True)
class PutResult:
    """`current` is the ciphertext's digest of what is stored there now; b"" for nothing.

    `location`: where a node-managed record lies; None for all others, which lie where they were put.
    """

    outcome: Outcome
    current: bytes = b""
    location: Location | None = None

    @property
    def reason(self) -> RejectReason | None:
        """The reject reason for the wire; None for stored."""
        return _REASONS[self.outcome]


@dataclass(frozen=True, slots=True)
class Put:
    """A verified record to be stored. `expect`: None for anything, b"" for nothing there, else the digest there.

    `at`: of a copy, where a node-managed record lies at the node that it comes from. Others lie where their header says.
    """

    record: Record
    expect: bytes | None = None
    at: Location | None = None


def judge(new: RecordHeader, expect: bytes | None, present: RecordHeader | None) -> PutResult:
    """STORED if `new` may replace `present` (if it *is* present, too), else why not."""
    if present is None:
        return PutResult(Outcome.STORED, new.digest) if not expect else PutResult(Outcome.EXISTS)
    if present == new:
        return PutResult(Outcome.STORED, present.digest)
    if expect is not None and expect != present.digest:
        return PutResult(Outcome.EXISTS, present.digest)
    if version_key(new) <= version_key(present):
        return PutResult(Outcome.STALE, present.digest)
    return PutResult(Outcome.STORED, new.digest)

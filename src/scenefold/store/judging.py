"""Whether a new record may take its place: pure, called inside the write transaction (design: storage, data packets)."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from scenefold.base.ids import NodeId
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import EXPECTS_ANYTHING, EXPECTS_NOTHING, Record, RecordHeader, is_husk, version_key


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
    DAMAGED = "damaged"
    """What is there has rotted so that nobody can tell whether this may replace it; nothing was changed."""
    NOT_OWNED = "not owned"
    """The place lies outside of the arc that this node owned at the moment of the commit."""


_REASONS = {
    Outcome.STORED: None,
    Outcome.STALE: RejectReason.STALE_VERSION,
    Outcome.EXISTS: RejectReason.STALE_VERSION,
    Outcome.FULL: RejectReason.STORAGE_FULL,
    Outcome.DAMAGED: RejectReason.DAMAGED,
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
    has_changed: bool = field(default=False, compare=False)
    """Whether anything was written: a repetition, or what is older, changes nothing."""
    over_wreck: bool = field(default=False, compare=False)
    """Whether the header that lay there had rotted."""

    @property
    def reason(self) -> RejectReason | None:
        """The reject reason for the wire; None for stored."""
        return _REASONS[self.outcome]


@dataclass(frozen=True, slots=True)
class Put:
    """A verified record to be stored.

    `at`: of a copy, where a node-managed record lies at the node that it comes from. Others lie where their header says.
    `debtors`: who is still to get it once it is here.
    `instead_of`: of a copy, the version that it may replace though it is older, where that has rotted and counted for nobody.
    `over_wreck`: whether it comes from who decides about the place, so that it takes a wreck's place though it is a husk.
    """

    record: Record
    at: Location | None = None
    debtors: tuple[NodeId, ...] = ()
    instead_of: RecordHeader | None = None
    over_wreck: bool = False

    @property
    def is_husk(self) -> bool:
        """Whether it is what is left of a record whose ciphertext is lost (husks.py)."""
        return is_husk(self.record)


def judge(new: RecordHeader, present: RecordHeader | None) -> PutResult:
    """STORED if `new` may be put where `present` is (if it *is* present, too), else why not."""
    if present != new and new.expects != EXPECTS_ANYTHING and new.expects != (EXPECTS_NOTHING if present is None else present.digest):
        return PutResult(Outcome.EXISTS, b"" if present is None else present.digest)
    return judge_copy(new, present)


def judge_copy(new: RecordHeader, present: RecordHeader | None) -> PutResult:
    """The same for a copy: what its writer expected was judged when it was put, wherever that was. The highest version stays."""
    if present is None or present == new:
        return PutResult(Outcome.STORED, new.digest)
    if version_key(new) <= version_key(present):
        return PutResult(Outcome.STALE, present.digest)
    return PutResult(Outcome.STORED, new.digest)

"""Packets 48 to 51, 53 to 60, 126 and 127: jobs, their passes and their images (design of the renderer; not in the thesis).

Documents are maps that the sender packed with `pack_value`; they stay bytes here, because what is in them is
the renderer's business, and because a job's hash is the hash of these bytes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scenefold.base.limits import BULK_BYTES_MAX
from scenefold.wire.common import DOCUMENT, MESSAGE, REASON_OR_0, U32, U64, Carrier, Packet, row
from scenefold.wire.kinds import Bin, Uint
from scenefold.wire.laws import Order

PART = Bin(BULK_BYTES_MAX)


@dataclass(frozen=True, slots=True)
class StartJob(Packet):
    TYPE: ClassVar[int] = 48
    job: int
    document: bytes


@dataclass(frozen=True, slots=True)
class JobAnswer(Packet):
    """`reason` 0: it is so; else a RejectReason, and `text` says more."""

    TYPE: ClassVar[int] = 49
    job: int
    reason: int
    text: str


@dataclass(frozen=True, slots=True)
class JobState(Packet):
    """How does the job stand?"""

    TYPE: ClassVar[int] = 50
    job: int


@dataclass(frozen=True, slots=True)
class JobStateReply(Packet):
    TYPE: ClassVar[int] = 51
    job: int
    document: bytes


@dataclass(frozen=True, slots=True)
class CollectPass(Packet):
    """Send me your sums of this pass."""

    TYPE: ClassVar[int] = 53
    job: int
    pass_index: int
    attempt: int


@dataclass(frozen=True, slots=True)
class PassSums(Packet):
    """A node's sums of one pass, in parts, with its ledger as it stood when they were taken; or all of a closed pass, for whoever keeps a copy."""

    TYPE: ClassVar[int] = 54
    job: int
    pass_index: int
    attempt: int
    created: int
    retired: int
    sent: int
    received: int
    part_index: int
    part_count: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class MergeFilm(Packet):
    """Send me your film of this job, and all behind you: films are gathered, and this is the gathering's number."""

    TYPE: ClassVar[int] = 55
    BULK_ANSWER: ClassVar[bool] = True
    job: int
    gathering: int


@dataclass(frozen=True, slots=True)
class FilmPart(Packet):
    """A part of a film that is gathered; of one that a client sends, `gathering` is 0."""

    TYPE: ClassVar[int] = 56
    job: int
    gathering: int
    part_index: int
    part_count: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class FetchImage(Packet):
    TYPE: ClassVar[int] = 57
    BULK_ANSWER: ClassVar[bool] = True
    job: int
    offset: int


@dataclass(frozen=True, slots=True)
class ImagePart(Packet):
    TYPE: ClassVar[int] = 58
    job: int
    total_bytes: int
    offset: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class CancelJob(Packet):
    TYPE: ClassVar[int] = 59
    job: int


@dataclass(frozen=True, slots=True)
class JobEvent(Packet):
    """Something happened to the job, for whoever watches it."""

    TYPE: ClassVar[int] = 60
    job: int
    document: bytes


@dataclass(frozen=True, slots=True)
class FetchFilm(Packet):
    """The film that a job's organiser keeps of its passes below `passes`; the answer is an ImagePart."""

    TYPE: ClassVar[int] = 126
    BULK_ANSWER: ClassVar[bool] = True
    job: int
    passes: int
    offset: int


@dataclass(frozen=True, slots=True)
class FetchPreview(Packet):
    """What the image looks like so far, by this number: to a job's organiser of all its nodes, to another node of that one and all behind it.

    The answer is an ImagePart (specs/34-previews.md).
    """

    TYPE: ClassVar[int] = 127
    BULK_ANSWER: ClassVar[bool] = True
    job: int
    number: int
    offset: int


_JOB = ("job", U64)
_PASS = (_JOB, ("pass_index", U32), ("attempt", U64))
_LEDGER = (("created", U64), ("retired", U64), ("sent", U64), ("received", U64))
_COUNTED = Order("part_index", "part_count", strictly=True)
_SHARE = (("part_index", U32), ("part_count", U32), ("payload", PART))

ROWS = (
    row(StartJob, Carrier.TCP_LOW, _JOB, ("document", DOCUMENT)),
    row(JobAnswer, Carrier.TCP_ANY, _JOB, ("reason", REASON_OR_0), ("text", MESSAGE)),
    row(JobState, Carrier.TCP_ANY, _JOB),
    row(JobStateReply, Carrier.TCP_ANY, _JOB, ("document", DOCUMENT)),
    row(CollectPass, Carrier.TCP_LOW, *_PASS),
    row(PassSums, Carrier.TCP_LOW, *_PASS, *_LEDGER, *_SHARE, law=_COUNTED),
    row(MergeFilm, Carrier.TCP_LOW, _JOB, ("gathering", U64)),
    row(FilmPart, Carrier.TCP_LOW, _JOB, ("gathering", U64), *_SHARE, law=_COUNTED),
    row(FetchImage, Carrier.TCP_LOW, _JOB, ("offset", U64)),
    row(ImagePart, Carrier.TCP_LOW, _JOB, ("total_bytes", U64), ("offset", U64), ("payload", PART), law=Order("offset", "total_bytes")),
    row(CancelJob, Carrier.TCP_ANY, _JOB),
    row(JobEvent, Carrier.TCP_ANY, _JOB, ("document", DOCUMENT)),
    row(FetchFilm, Carrier.TCP_LOW, _JOB, ("passes", U32), ("offset", U64)),
    row(FetchPreview, Carrier.TCP_LOW, _JOB, ("number", Uint(32, least=1)), ("offset", U64)),
)

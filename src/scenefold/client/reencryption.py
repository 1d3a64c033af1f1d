"""What a re-encryption has to do, has done, and how fast it may go (specs/16-scene-log.md, Members). Pure.

There is no list of what is left: a record says itself which key it lies under. So who begins anew goes on where it ended.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from scenefold.base.errors import DamagedData
from scenefold.client.progress import ProgressState
from scenefold.crypto import RecordHeader
from scenefold.wire import DAMAGED_RECORD, RecordBytes

PHASE = "re-encrypt"
COMPLAINTS_MAX = 8


def under_older_keys(records: Sequence[RecordBytes | None], epoch: int) -> list[int]:
    """Which of these records lie under a key of an epoch before this one. What is damaged cannot be made anew."""
    return [index for index, record in enumerate(records) if record is not None and _epoch_of(record, epoch) < epoch]


def _epoch_of(record: RecordBytes, otherwise: int) -> int:
    if record == DAMAGED_RECORD:
        return otherwise
    try:
        return RecordHeader.decode(record.header).key_epoch
    except DamagedData:
        return otherwise


def is_damaged(record: RecordBytes | None) -> bool:
    """Whether its owner says so, or its header is none."""
    return record is not None and (record == DAMAGED_RECORD or _epoch_of(record, -1) < 0)


class Pace:
    """At most so many bytes a second, evenly; None: as fast as it goes."""

    def __init__(self, bytes_per_s: float | None) -> None:
        self._bytes_per_s = bytes_per_s
        self._free_at = 0.0

    def wait_s(self, now: float, size: int) -> float:
        """How long to wait before `size` bytes are dealt with."""
        if self._bytes_per_s is None:
            return 0.0
        begin = max(now, self._free_at)
        self._free_at = begin + size / self._bytes_per_s
        return begin - now


@dataclass(slots=True)
class Reencryption:
    """How far a re-encryption is, over all its walks. `walked` counts in the present one."""

    key_epoch: int
    begun: float
    is_dry: bool = False
    """Nothing is sealed anew: what would be is counted as `to_renew`, and its bytes as they lie there."""
    total: int = 0
    walks: int = 0
    walked: int = 0
    to_renew: int = 0
    renewed: int = 0
    renewed_in_walk: int = 0
    bytes: int = 0
    """Of the payloads that were sealed anew."""
    overtaken: int = 0
    """Records that somebody else wrote between our reading and our writing."""
    unreadable: int = 0
    complaints: list[str] = field(default_factory=list)
    seconds: float = 0.0
    ended: bool = False
    """Whether a walk found nothing more to do."""

    @property
    def is_complete(self) -> bool:
        """Whether nothing is left under older keys, as far as anybody knows."""
        return self.ended and not self.unreadable

    def begin_walk(self) -> None:
        """From the first record on."""
        self.walks += 1
        self.walked = self.renewed_in_walk = 0

    def renew(self, count: int, size: int) -> None:
        """So many records were sealed anew."""
        self.renewed += count
        self.renewed_in_walk += count
        self.bytes += size

    def find(self, count: int, size: int) -> None:
        """So many records lie under older keys, and are left so."""
        self.to_renew += count
        self.bytes += size

    def complain(self, problem: str) -> None:
        """A record stays as it is. A second walk meets it again, so the last walk's count is the one that says."""
        self.unreadable += 1
        if len(self.complaints) < COMPLAINTS_MAX and problem not in self.complaints:
            self.complaints.append(problem)

    def progress(self, now: float) -> ProgressState:
        """What a person is shown: records, bytes, time left."""
        total = max(self.total, self.walked)
        left = (now - self.begun) / self.walked * (total - self.walked) if 0 < self.walked < total else None
        phase = "look" if self.is_dry else PHASE if self.walks <= 1 else f"{PHASE} ({self.walks})"
        done = "to be sealed anew" if self.is_dry else "sealed anew"
        return ProgressState(phase, self.walked, total, f"records, {self.bytes / 2**20:.1f} MiB {done}", left)

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "key_epoch": self.key_epoch,
            "dry_run": self.is_dry,
            "records": self.walked,
            "to_renew": self.to_renew,
            "renewed": self.renewed,
            "bytes": self.bytes,
            "overtaken": self.overtaken,
            "unreadable": self.unreadable,
            "complaints": list(self.complaints),
            "walks": self.walks,
            "complete": self.is_complete,
            "seconds": round(self.seconds, 3),
        }

"""Which deleted records may go, and how far a purge of them is (specs/22-purge.md, Commands). Pure.

In a fixed space who finds a place taken goes on along the line, and is found again by following the run (runs.py). A deleted record is a
part of such runs: it may go if nothing behind it can have stepped over it, that is, if all up to the next gap is deleted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from scenefold.base.errors import DamagedData
from scenefold.base.ids import SpaceId
from scenefold.base.location import LAST, Location
from scenefold.client.progress import ProgressState
from scenefold.client.runs import STEPS_MAX
from scenefold.client.sealing import SceneIdentity, deleted_all
from scenefold.client.verifying import Key, NewerThanKnown
from scenefold.crypto import RecordHeader, wanted_place
from scenefold.wire import PurgeItem, RecordBytes, RecordVersion

PHASE = "purge"
COMPLAINTS_MAX = 8


class Deletion(NamedTuple):
    """A deleted record, as this very version."""

    item: PurgeItem
    home: Location
    """Whose owner decides about it."""

    @property
    def epoch(self) -> int:
        return self.item.version.epoch


def deletion_of(space: SpaceId, location: Location, object_id: bytes, record: RecordBytes) -> Deletion:
    """Of a record that was verified."""
    header = RecordHeader.decode(record.header)
    version = RecordVersion(header.epoch, header.seq, header.writer, header.session, header.digest)
    return Deletion(PurgeItem(space, location, object_id, version), wanted_place(object_id) if object_id else location)


def deleted_or_not(identity: SceneIdentity, keys: Sequence[Key], records: Sequence[RecordBytes | None]) -> list[bool]:
    """Which of these are deleted, or not there, once no more can be known of the scene: what cannot be understood is not."""
    return [_is_deleted(identity, key, record) for key, record in zip(keys, records, strict=True)]


def _is_deleted(identity: SceneIdentity, key: Key, record: RecordBytes | None) -> bool:
    try:
        return deleted_all(identity, [key], [record])[0]
    except (NewerThanKnown, DamagedData):
        return False


class Tails:
    """Which deletions of a fixed space may go, shown all of its records in the order of the line."""

    def __init__(self) -> None:
        self.kept = 0
        """Deletions that something lies behind."""
        self._tail: deque[Deletion] = deque()
        self._first: Location | None = None
        self._last: Location | None = None

    def show(self, location: Location, deletion: Deletion | None) -> list[Deletion]:
        """The next record, None for one that lives; which of those before it may go."""
        free: list[Deletion] = []
        self._first = location if self._first is None else self._first
        if self._last is None or self._last.next() != location:
            free = self._free()
        elif deletion is None:
            self._keep()
        self._last = location
        if deletion is not None:
            self._tail.append(deletion)
            if len(self._tail) == STEPS_MAX:
                # Nothing that lies further on has stepped over it.
                free.append(self._tail.popleft())
        return free

    def end(self) -> list[Deletion]:
        """Which of the last ones may go. From the end of the line a run goes on at its beginning."""
        if self._last == LAST and self._first is not None and not any(self._first):
            self._keep()
        return self._free()

    def _free(self) -> list[Deletion]:
        free = list(self._tail)
        self._tail.clear()
        return free

    def _keep(self) -> None:
        self.kept += len(self._tail)
        self._tail.clear()


@dataclass(slots=True)
class Purge:
    """How far a purge is, and what became of the deletions that it met."""

    begun: float
    is_dry: bool = False
    total: int = 0
    walked: int = 0
    deleted: int = 0
    can_go: int = 0
    """Deletions that nothing lies behind."""
    purged: int = 0
    """No node has anything there any more."""
    kept: int = 0
    """Deletions that stay, since records lie behind them that may have stepped over them."""
    overtaken: int = 0
    """Places where somebody wrote meanwhile."""
    waiting: int = 0
    """Not yet: a node was away, or has something older, or the places were on the move."""
    not_begun: int = 0
    """Newer than the newest beginning, and we are no owner, who could begin."""
    reasons: list[str] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def is_complete(self) -> bool:
        """Whether nothing is left that could go another time."""
        return not self.waiting and not self.not_begun

    def say(self, reason: str) -> None:
        """What some deletions wait for."""
        if reason and reason not in self.reasons and len(self.reasons) < COMPLAINTS_MAX:
            self.reasons.append(reason)

    def progress(self, now: float) -> ProgressState:
        """What a person is shown: records, deletions, time left."""
        total = max(self.total, self.walked)
        left = (now - self.begun) / self.walked * (total - self.walked) if 0 < self.walked < total else None
        waiting = f", {self.waiting} wait" if self.waiting else ""
        return ProgressState(PHASE, self.walked, total, f"records, {self.purged} of {self.deleted} deletions gone{waiting}", left)

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "dry_run": self.is_dry,
            "records": self.walked,
            "deleted": self.deleted,
            "can_go": self.can_go,
            "purged": self.purged,
            "kept_for_runs": self.kept,
            "overtaken": self.overtaken,
            "waiting": self.waiting,
            "not_begun": self.not_begun,
            "reasons": list(self.reasons),
            "complete": self.is_complete,
            "seconds": self.seconds,
        }

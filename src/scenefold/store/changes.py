"""What a commit is made of. Each change is applied inside the transaction, and may be applied again if that restarts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self, TypeVar

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.store.layout import SpaceAddress
from scenefold.store.tally import Tally
from scenefold.world.ports import ReadTransaction, WriteTransaction

R_co = TypeVar("R_co", covariant=True)


class ReserveLeft(NamedTuple):
    """What of the reserve others may have than those who make room, or let others go on. Below zero: so much of theirs is gone."""

    for_deletions: int
    """Bytes for what takes the place of something, and is larger: as deletions may be."""
    for_holding: int
    """Bytes for copies that are held for others. Fewer, so that these never leave a deletion without."""
    for_merging: int
    """Bytes for copies that this node recovers, brings home or compares. Fewer than for deletions as well, and more than for what is held."""


NOTHING_LEFT = ReserveLeft(0, 0, 0)


class Change(Protocol[R_co]):
    """`size_bytes`: about what it writes."""

    @property
    def size_bytes(self) -> int: ...

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> R_co: ...

    def in_reserve(self, left: ReserveLeft, /) -> Change[R_co]:
        """What of it is done where only the reserve is left: itself, if all of it is."""
        ...

    def when_full(self, transaction: ReadTransaction, /) -> R_co:
        """The answer if the disk is full, or Refused. That it is full need not be all: what is wanted may be there already."""
        ...


class MayUseReserve:
    """What must not wait for room: it lets others go on, or makes room itself."""

    __slots__ = ()

    def in_reserve(self, _left: ReserveLeft, /) -> Self:
        return self


def storage_full() -> Refused:
    remedy = "free some space on the node's disk, or add a node"
    return Refused(RejectReason.STORAGE_FULL, "the node's disk is full", remedy=remedy)


@dataclass(frozen=True, slots=True)
class PutValue(MayUseReserve):
    """A scene's public header, or a service's note: the last one written stays."""

    table: str
    key: bytes
    value: bytes

    @property
    def size_bytes(self) -> int:
        return len(self.key) + len(self.value)

    def apply(self, transaction: WriteTransaction, _tally: Tally, /) -> None:
        transaction.put(self.table, self.key, self.value)

    def when_full(self, _transaction: ReadTransaction, /) -> None:
        raise storage_full()


@dataclass(frozen=True, slots=True)
class PutValues(MayUseReserve):
    """Values that belong together: after a crash all of them are there, or none."""

    values: tuple[PutValue, ...]

    @property
    def size_bytes(self) -> int:
        return sum(value.size_bytes for value in self.values)

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> None:
        for value in self.values:
            value.apply(transaction, tally)

    def when_full(self, _transaction: ReadTransaction, /) -> None:
        raise storage_full()


@dataclass(frozen=True, slots=True)
class BuildDigests(MayUseReserve):
    """Put so many more records into trees of digests that do not have all of them yet."""

    records: int

    @property
    def size_bytes(self) -> int:
        return self.records * 8

    def apply(self, _transaction: WriteTransaction, tally: Tally, /) -> None:
        tally.digests.to_build = self.records

    def when_full(self, _transaction: ReadTransaction, /) -> None:
        raise storage_full()


@dataclass(frozen=True, slots=True)
class RestartDigests(MayUseReserve):
    """Have the tree of a space made anew, for this reason."""

    space: SpaceAddress
    reason: str

    @property
    def size_bytes(self) -> int:
        return 512

    def apply(self, _transaction: WriteTransaction, tally: Tally, /) -> None:
        tally.digests.restarts[self.space] = self.reason

    def when_full(self, _transaction: ReadTransaction, /) -> None:
        raise storage_full()

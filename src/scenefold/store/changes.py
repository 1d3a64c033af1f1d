"""What a commit is made of. Each change is applied inside the transaction, and may be applied again if that restarts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeVar

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.store.statistics import Tally
from scenefold.world.ports import ReadTransaction, WriteTransaction

R_co = TypeVar("R_co", covariant=True)


class Change(Protocol[R_co]):
    """`size_bytes`: about what it writes; `uses_reserve`: whether it is allowed when the disk is nearly full."""

    @property
    def size_bytes(self) -> int: ...

    @property
    def uses_reserve(self) -> bool: ...

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> R_co: ...

    def when_full(self, transaction: ReadTransaction, /) -> R_co:
        """The answer if the disk is full, or Refused. That it is full need not be all: what is wanted may be there already."""
        ...


def storage_full() -> Refused:
    remedy = "free some space on the node's disk, or add a node"
    return Refused(RejectReason.STORAGE_FULL, "the node's disk is full", remedy=remedy)


@dataclass(frozen=True, slots=True)
class PutValue:
    """A scene's public header, or a service's note: the last one written stays."""

    table: str
    key: bytes
    value: bytes

    @property
    def size_bytes(self) -> int:
        return len(self.key) + len(self.value)

    @property
    def uses_reserve(self) -> bool:
        return True

    def apply(self, transaction: WriteTransaction, _tally: Tally, /) -> None:
        transaction.put(self.table, self.key, self.value)

    def when_full(self, _transaction: ReadTransaction, /) -> None:
        raise storage_full()


@dataclass(frozen=True, slots=True)
class PutValues:
    """Values that belong together: after a crash all of them are there, or none."""

    values: tuple[PutValue, ...]

    @property
    def size_bytes(self) -> int:
        return sum(value.size_bytes for value in self.values)

    @property
    def uses_reserve(self) -> bool:
        return True

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> None:
        for value in self.values:
            value.apply(transaction, tally)

    def when_full(self, _transaction: ReadTransaction, /) -> None:
        raise storage_full()

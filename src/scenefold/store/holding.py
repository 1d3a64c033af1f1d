"""The arc that this node owns, as the disk knows it (specs/10-store.md, Tables).

The line keeps its holding here: an arc, or none, a note that only it reads, and one about copies, which follow the arc. All
change in one transaction, and every put is checked against the arc inside the transaction that stores it. So there is no moment, whatever crashes
when, at which a record is acknowledged for a place that was given away before.

A holding is one incarnation's. When the identity is renewed, the tasks of the life that ends run on until they hear of
it, and may have a change on its way that would write the old arc behind the renewal. So who writes names its incarnation,
and is judged in the transaction too; and the holding says whose it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from scenefold.base.errors import Refused
from scenefold.base.location import LOCATION_BYTES, Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.store.changes import MayUseReserve, storage_full
from scenefold.store.layout import FORMER_LIFE, HOLDING, IDENTITY, NOTES
from scenefold.store.sealing import damaged
from scenefold.store.tally import Tally
from scenefold.world.ports import ReadTransaction, WriteTransaction

ARC_KEY = b"arc"
NOTE_KEY = b"note"
COPIES_KEY = b"copies"
OWNER_KEY = b"incarnation"


class StoredHolding(NamedTuple):
    """The arc, None for a node that owns nothing, the line's note, and what it keeps about copies; None in folders of before."""

    arc: Arc | None
    note: bytes
    copies: bytes | None = None


def read_arc(transaction: ReadTransaction) -> Arc | None:
    """The arc that puts are checked against; None before any was written, too."""
    value = transaction.get(HOLDING, ARC_KEY)
    if value is None and transaction.get(HOLDING, NOTE_KEY) is not None:
        raise damaged("the stored arc of this node is not there, and the note that belongs to it is")
    if value is None or not len(value):
        return None
    data = bytes(value)
    if len(data) != 2 * LOCATION_BYTES or data[:LOCATION_BYTES] > data[LOCATION_BYTES:]:
        raise damaged("the stored arc of this node is none")
    return Arc(Location(data[:LOCATION_BYTES]), Location(data[LOCATION_BYTES:]))


def read_holding(transaction: ReadTransaction) -> StoredHolding | None:
    """None if none was ever written, or the identity was renewed since. Another incarnation's is damage."""
    owner = transaction.get(HOLDING, OWNER_KEY)
    # Folders of before have none. Taking it for nothing would be no way out: a founder would begin with its first arc anew.
    if owner is not None and bytes(owner) != _incarnation(transaction):
        raise damaged("the stored arc of this node is of an incarnation that is over")
    note = transaction.get(HOLDING, NOTE_KEY)
    if note is None and transaction.get(HOLDING, ARC_KEY) is not None:
        raise damaged("the note about this node's arc is not there, and the arc is")
    if note is None:
        return None
    copies = transaction.get(HOLDING, COPIES_KEY)
    return StoredHolding(read_arc(transaction), bytes(note), None if copies is None else bytes(copies))


def _incarnation(transaction: ReadTransaction) -> bytes:
    """Whose the folder is now."""
    return bytes(transaction.get(IDENTITY, b"incarnation") or b"")


@dataclass(frozen=True, slots=True)
class PutHolding(MayUseReserve):
    """Replace the arc and the notes together, if this incarnation is the store's still: else Refused, and nothing changes.

    `copies`: None leaves that note as it is. It may use the reserve: giving an arc away makes room.
    """

    incarnation: bytes
    arc: Arc | None
    note: bytes
    copies: bytes | None = None

    @property
    def size_bytes(self) -> int:
        return len(self.note) + len(self.copies or b"") + 128

    def apply(self, transaction: WriteTransaction, _tally: Tally, /) -> Refused | None:
        if _incarnation(transaction) != self.incarnation:
            return Refused(RejectReason.NOT_READY, "this incarnation of the node is over", remedy="try again once the node runs")
        transaction.put(HOLDING, OWNER_KEY, self.incarnation)
        transaction.put(HOLDING, ARC_KEY, b"" if self.arc is None else self.arc.first + self.arc.last)
        transaction.put(HOLDING, NOTE_KEY, self.note)
        if self.copies is not None:
            transaction.put(HOLDING, COPIES_KEY, self.copies)
        return None

    def when_full(self, _transaction: ReadTransaction, /) -> None:
        raise storage_full()


@dataclass(frozen=True, slots=True)
class RenewIdentity(MayUseReserve):
    """A new incarnation, which owns nothing. Records stay, and are strays from now on; so does the boot counter.

    That they are of a former life is noted, until it is known which of them nobody may bring home by himself (suspects.py).
    """

    incarnation: bytes

    @property
    def size_bytes(self) -> int:
        return 128

    def apply(self, transaction: WriteTransaction, _tally: Tally, /) -> None:
        transaction.put(IDENTITY, b"incarnation", self.incarnation)
        transaction.put(NOTES, FORMER_LIFE, b"")
        transaction.delete(HOLDING, ARC_KEY)
        transaction.delete(HOLDING, NOTE_KEY)
        transaction.delete(HOLDING, COPIES_KEY)
        transaction.delete(HOLDING, OWNER_KEY)

    def when_full(self, _transaction: ReadTransaction, /) -> None:
        raise storage_full()

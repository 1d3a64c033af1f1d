"""What a writer may say of a record that an earlier try may have stored (specs/18-data.md, Writes).

A try whose answer was lost, or was 16, may have stored its record. Whatever refusal comes later, it was that of a later try, and
speaks of the record as it is by then, or does not look at it at all. So as long as there is doubt, no refusal is told as one: it
becomes Unreachable, which says that nobody knows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.wire import PutItem

Doubted = dict[int, PutItem]
"""By number: the try that may have stored a record of which no answer says that it is there."""


def left_open(error: Unreachable | PeerFault | Refused, tried: Mapping[int, PutItem]) -> Doubted:
    """What a node may have stored that answered a packet so. Who has lost its lease meanwhile says 16."""
    return {} if isinstance(error, Refused) and error.reason != RejectReason.NOT_READY else dict(tried)


def note(doubted: Doubted, index: int, item: PutItem, *, doubtful: bool, settled: bool) -> None:
    """What one outcome says; `settled`: that the record is there, or that whoever wanted it looks himself."""
    if doubtful:
        doubted[index] = item
    if settled:
        doubted.pop(index, None)


@contextmanager
def no_refusal_in_doubt(doubted: Doubted) -> Iterator[None]:
    """A refusal that comes while something is in doubt leaves here as Unreachable."""
    try:
        yield
    except Refused as refusal:
        if not doubted:
            raise
        item = next(iter(doubted.values()))
        where = f"scene {item.scene:08x}, space {item.space}, {item.location.hex()}"
        what = f"the answer to a write was lost, and it may have happened; a later try: {refusal.what}"
        raise Unreachable(what, where=where, remedy="read it, then decide whether to write again") from refusal

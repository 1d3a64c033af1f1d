"""What is left of a log on the disk (specs/10-store.md, Logs). Plain functions for the reading threads.

Whatever is missing or has changed makes the log shorter, and this node silent for as long as it might say again what it has said
differently before: what is decided the others have, what this node has voted for nobody else knows for sure.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from scenefold.base.errors import DamagedData
from scenefold.consensus import Slot
from scenefold.store.layout import LOGS
from scenefold.store.log_rows import (
    GENESIS_BYTES,
    POSITION_MAX,
    Decided,
    StoredLog,
    Votes,
    decided_key,
    position_of,
    unpack_decided,
    unpack_votes,
    votes_key,
)
from scenefold.world.ports import ReadTransaction


def read_log(transaction: ReadTransaction, genesis: bytes, incarnation: bytes, above: int) -> StoredLog | None:
    """What is decided above a position that the caller knows otherwise, and what is open; None if nothing of the log was ever written here."""
    first, last = decided_key(genesis, 1), decided_key(genesis, POSITION_MAX)
    newest = next(transaction.keys(LOGS, first, last, reverse=True), None)
    stored = transaction.get(LOGS, votes_key(genesis))
    if newest is None and stored is None:
        return None
    damage = list[str]()
    tail = tuple(_sound(transaction, genesis, above, damage))
    opened = above + len(tail) + 1
    silent_until = 0
    known = 0 if newest is None else position_of(newest) or 0
    if known >= opened:
        damage.append(f"what is decided at position {opened} is not there, or has changed on the disk")
        silent_until = known + 1
    votes = _votes(genesis, stored, damage)
    if votes is None:
        return StoredLog(tail, Slot(), max(silent_until, opened), tuple(damage))
    silent_until = max(silent_until, votes.silent_until)
    is_own = votes.incarnation == incarnation
    if votes.position != opened:
        damage.append(f"the votes are of position {votes.position}, and {opened} is open")
        return StoredLog(tail, Slot(), max(silent_until, opened, votes.position) if is_own else 0, tuple(damage))
    # What an earlier incarnation has said binds that one, which takes part no more.
    return StoredLog(tail, votes.slot, silent_until, tuple(damage)) if is_own else StoredLog(tail, Slot(), 0, tuple(damage))


def _sound(transaction: ReadTransaction, genesis: bytes, above: int, damage: list[str]) -> Iterator[Decided]:
    """As far as there is no gap, and nothing has changed."""
    position = above
    for key, stored in _rows_above(transaction, genesis, above):
        position += 1
        if position_of(key) != position:
            return
        try:
            yield unpack_decided(key, stored)
        except DamagedData as error:
            damage.append(str(error))
            return


def _rows_above(transaction: ReadTransaction, genesis: bytes, above: int) -> Iterator[tuple[bytes, memoryview]]:
    """In their order. Whoever asks names the position, and above the highest one there is nothing."""
    if above < POSITION_MAX:
        yield from transaction.scan(LOGS, decided_key(genesis, above + 1), decided_key(genesis, POSITION_MAX))


def _votes(genesis: bytes, stored: memoryview | None, damage: list[str]) -> Votes | None:
    if stored is None:
        damage.append("what this node has voted for is not there, and what is decided is")
        return None
    try:
        return unpack_votes(genesis, stored)
    except DamagedData as error:
        damage.append(str(error))
        return None


def read_decided(transaction: ReadTransaction, genesis: bytes, above: int, count_max: int, bytes_max: int) -> Sequence[Decided]:
    """What is decided above a position, one after the other, at least one if there is any: as many as fit."""
    found, size_bytes = list[Decided](), 0
    for decided in _sound(transaction, genesis, above, []):
        size_bytes += len(decided.value.data) + len(decided.value.body)
        if found and (len(found) >= count_max or size_bytes > bytes_max):
            break
        found.append(decided)
    return found


def read_kept(transaction: ReadTransaction, genesis: bytes, above: int, count_max: int, bytes_max: int) -> Sequence[Decided]:
    """What is kept above a position, be there gaps or not; what has changed on the disk is left out."""
    found, size_bytes = list[Decided](), 0
    for key, stored in _rows_above(transaction, genesis, above):
        if found and (len(found) >= count_max or size_bytes + len(stored) > bytes_max):
            break
        try:
            found.append(unpack_decided(key, stored))
        except DamagedData:
            continue
        size_bytes += len(stored)
    return found


def read_names(transaction: ReadTransaction) -> frozenset[bytes]:
    """The logs of which there is any row."""
    found, genesis = set[bytes](), bytes(GENESIS_BYTES)
    last = decided_key(b"\xff" * GENESIS_BYTES, POSITION_MAX)
    while (key := next(transaction.keys(LOGS, genesis, last), None)) is not None:
        name = bytes(key[:GENESIS_BYTES])
        found.add(name)
        # On to whatever lies behind its last row.
        genesis = decided_key(name, POSITION_MAX) + b"\0"
    return frozenset(found)

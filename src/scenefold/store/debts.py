"""Which nodes are still to get the version that is here (specs/10-store.md, Debts; 20-copies.md, Writes). Plain functions.

A debt is written with its record, in one transaction, and is of that very version: what replaces the record replaces the debt, and
who got an older version has not got this one.
"""

from __future__ import annotations

import logging
import struct
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import NamedTuple

from scenefold.base.ids import NodeId
from scenefold.crypto import RecordPlace
from scenefold.store.layout import DEBTORS, DEBTS, Spot, record_key, spot_of
from scenefold.store.placing import place_of
from scenefold.store.sealing import StoreDamaged, damaged
from scenefold.store.versions import VERSION_BYTES
from scenefold.world.ports import ReadTransaction, WriteTransaction

_NODE = struct.Struct(">I")
_COUNT = struct.Struct(">Q")
_LAST_KEY = b"\xff" * 64

_log = logging.getLogger("scenefold.store")


class Debt(NamedTuple):
    """Who is still to get a record, and which version of it."""

    spot: Spot
    version: bytes
    nodes: tuple[NodeId, ...]


class DebtPage(NamedTuple):
    """Debts in the order of their keys, and where to go on; None behind the last one."""

    debts: list[Debt]
    after: bytes | None


def read_debt(transaction: ReadTransaction, key: bytes) -> Debt | None:
    """What is owed of the record with this key."""
    value = transaction.get(DEBTS, key)
    return None if value is None else unpack_debt(key, value)


def read_debt_of(transaction: ReadTransaction, spot: Spot) -> Debt | None:
    """Likewise of an object wherever it lies now."""
    found = read_debt(transaction, record_key(*spot))
    if found is None and spot.object:
        (scene, space, _), object_id = spot
        known = place_of(transaction, scene, space, object_id)
        found = None if known is None else read_debt(transaction, record_key(RecordPlace(scene, space, known), object_id))
    return found


def read_debts_of(transaction: ReadTransaction, spots: Sequence[Spot]) -> list[Debt | None]:
    return [read_debt_of(transaction, spot) for spot in spots]


def read_debts(transaction: ReadTransaction, after: bytes | None, limit: int) -> DebtPage:
    """The first `limit` >= 1 debts behind the cursor."""
    begin = b"" if after is None else after + b"\0"
    rows = [(key, unpack_debt(key, value)) for key, value in islice(transaction.scan(DEBTS, begin, _LAST_KEY), limit)]
    return DebtPage([debt for _, debt in rows], rows[-1][0] if len(rows) == limit else None)


def unpack_debt(key: bytes, value: memoryview) -> Debt:
    """StoreDamaged if it is none."""
    nodes = value[VERSION_BYTES:]
    if not len(nodes) or len(nodes) % _NODE.size:
        raise damaged("a stored debt is none")
    return Debt(spot_of(key), bytes(value[:VERSION_BYTES]), tuple(NodeId(node) for (node,) in _NODE.iter_unpack(nodes)))


def pack_debt(version: bytes, nodes: Iterable[NodeId]) -> bytes:
    """A row of the table: nodes ascending."""
    return version + b"".join(map(_NODE.pack, nodes))


def pack_owed(owed: Mapping[NodeId, int]) -> dict[bytes, bytes]:
    """The rows of the table of debtors."""
    return {_NODE.pack(node): _COUNT.pack(count) for node, count in owed.items() if count}


@dataclass(slots=True)
class DebtChanges:
    """What one transaction changes: the debts at once, how much each node is owed at its end."""

    owed: Counter[NodeId] = field(default_factory=Counter)

    def write_debt(self, transaction: WriteTransaction, key: bytes, version: bytes, nodes: Sequence[NodeId]) -> None:
        """Of a record that is written over something else. Only if it heals what has rotted there, it may have a debt already."""
        former = read_debt(transaction, key)
        if former is None or former.version != version:
            self._replace(transaction, key, former, Debt(spot_of(key), version, tuple(sorted(set(nodes)))))

    def forget_debt(self, transaction: WriteTransaction, key: bytes) -> None:
        self._replace(transaction, key, read_debt(transaction, key), None)

    def pay(self, transaction: WriteTransaction, spot: Spot, version: bytes, node: NodeId) -> bool:
        """Whether this was owed."""
        former = read_debt_of(transaction, spot)
        if former is None or former.version != version or node not in former.nodes:
            return False
        left = former._replace(nodes=tuple(other for other in former.nodes if other != node))
        self._replace(transaction, record_key(*former.spot), former, left)
        return True

    def _replace(self, transaction: WriteTransaction, key: bytes, former: Debt | None, new: Debt | None) -> None:
        if former is not None:
            self.owed.subtract(former.nodes)
        if new is not None and new.nodes:
            self.owed.update(new.nodes)
            transaction.put(DEBTS, key, pack_debt(new.version, new.nodes))
        elif former is not None:
            transaction.delete(DEBTS, key)

    def write(self, transaction: WriteTransaction) -> dict[NodeId, int]:
        """Bring the counts up to date; returns those that changed."""
        return {node: _change_owed(transaction, node, change) for node, change in sorted(self.owed.items()) if change}


def move_debt(transaction: WriteTransaction, key: bytes, to: bytes) -> None:
    """An object lies elsewhere from now on."""
    value = transaction.get(DEBTS, key)
    if value is not None:
        copy = bytes(value)
        transaction.delete(DEBTS, key)
        transaction.put(DEBTS, to, copy)


def _change_owed(transaction: WriteTransaction, node: NodeId, change: int) -> int:
    key = _NODE.pack(node)
    try:
        value = transaction.get(DEBTORS, key)
        owed = change if value is None else _COUNT.unpack(value)[0] + change
    except StoreDamaged:
        owed = _counted(transaction)[node]
    if owed > 0:
        transaction.put(DEBTORS, key, _COUNT.pack(owed))
    else:
        transaction.delete(DEBTORS, key)
    return max(0, owed)


def read_owed(transaction: ReadTransaction) -> dict[NodeId, int]:
    """How many records each node is still to get, once at the start. What is damaged follows from the debts: all is counted."""
    try:
        return {NodeId(_NODE.unpack(key)[0]): _COUNT.unpack(value)[0] for key, value in transaction.scan(DEBTORS, b"", _LAST_KEY)}
    except StoreDamaged as damage:
        _log.error("%s; the debts are counted instead", damage.what)
        return dict(_counted(transaction))


def _counted(transaction: ReadTransaction) -> Counter[NodeId]:
    counts: Counter[NodeId] = Counter()
    for key, value in transaction.scan(DEBTS, b"", _LAST_KEY):
        counts.update(unpack_debt(key, value).nodes)
    return counts

"""Debts held against the records that they are of, and debtors against debts (specs/21-verify.md).

A debt that has rotted follows from the counts of the debtors: whom they count beyond all other debts it named, and nobody else. Of
several, each is taken to have named all of these. To be owed too much costs a message, and never a record.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from scenefold.base.ids import NodeId
from scenefold.store.checking.findings import Finding, Helps, named
from scenefold.store.checking.fixes import delete, put
from scenefold.store.checking.tables import EVERY_KEY, Sound, is_sound
from scenefold.store.debts import Debt, pack_debt, pack_owed, read_owed, unpack_debt
from scenefold.store.layout import DEBTORS, DEBTS, RECORDS, sound_header
from scenefold.store.sealing import StoreDamaged, opened
from scenefold.store.versions import version_of
from scenefold.world.ports import ReadTransaction


def check_debts(raw: ReadTransaction) -> Iterator[Finding]:
    """What is wrong with either table."""
    rotten, owed = list[bytes](), Counter[NodeId]()
    for key, stored in raw.scan(DEBTS, *EVERY_KEY):
        debt = _debt(key, stored)
        if debt is None:
            rotten.append(key)
            continue
        owed.update(debt.nodes)
        version = _version(raw, key)
        if raw.get(RECORDS, key) is None:
            yield Finding(DEBTS, named(DEBTS, key), "a debt of a record that is not there", Helps.MEND, delete(DEBTS, key))
        elif version is not None and debt.version != version:
            what = "a debt of another version than is there"
            yield Finding(DEBTS, named(DEBTS, key), what, Helps.MEND, put(DEBTS, key, pack_debt(version, debt.nodes)))
    yield from _rotten(raw, rotten, owed) if rotten else _debtors(raw, owed)


def _debt(key: bytes, stored: memoryview) -> Debt | None:
    try:
        return unpack_debt(key, opened(DEBTS, key, stored))
    except StoreDamaged:
        return None


def _version(raw: ReadTransaction, key: bytes) -> bytes | None:
    """Which version lies there; None for nothing, or a header that has rotted."""
    value = raw.get(RECORDS, key)
    header = None if value is None else sound_header(value)
    return None if header is None else version_of(header)


def _rotten(raw: ReadTransaction, rotten: Sequence[bytes], owed: Counter[NodeId]) -> Iterator[Finding]:
    is_counted = all(is_sound(DEBTORS, key, value) for key, value in raw.scan(DEBTORS, *EVERY_KEY))
    named_there = sorted(Counter(read_owed(Sound(raw))) - owed) if is_counted else []
    for key in rotten:
        where, version = named(DEBTS, key), _version(raw, key)
        if raw.get(RECORDS, key) is None:
            yield Finding(DEBTS, where, "a damaged debt of a record that is not there", Helps.MEND, delete(DEBTS, key))
        elif version is None or not named_there:
            yield Finding(DEBTS, where, "who is still to get a record has changed on the disk, and follows from nothing", Helps.WIPE)
        else:
            fix = put(DEBTS, key, pack_debt(version, named_there))
            yield Finding(DEBTS, where, "who is still to get a record has changed on the disk", Helps.MEND, fix)


def _debtors(raw: ReadTransaction, owed: Counter[NodeId]) -> Iterator[Finding]:
    rows, wanted = {key: bytes(value) for key, value in Sound(raw).scan(DEBTORS, *EVERY_KEY)}, pack_owed(owed)
    for key in sorted({*raw.keys(DEBTORS, *EVERY_KEY), *wanted}):
        if rows.get(key) != wanted.get(key):
            fix = put(DEBTORS, key, wanted[key]) if key in wanted else delete(DEBTORS, key)
            what = "how much a node is owed is not what debts say"
            yield Finding(DEBTORS, named(DEBTORS, key), what, Helps.MEND, fix)

"""Every record read as it would be read for a client, and held against the key that it lies under (specs/21-verify.md)."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from typing import Protocol

from scenefold.base.errors import DamagedData
from scenefold.base.location import LOCATION_BYTES
from scenefold.crypto import OBJECT_BYTES, PLACED_BY_NODE, Record, RecordHeader, object_of
from scenefold.store.checking.findings import Finding, Findings, Helps, named
from scenefold.store.checking.tables import EVERY_KEY
from scenefold.store.layout import RECORDS, SPACE_BYTES, SpaceAddress, Spot, space_of, spot_of, unpack_record
from scenefold.store.statistics import Counts
from scenefold.world.ports import ReadTransaction, WriteTransaction

Tell = Callable[[str, int, int | None], None]
"""Hears of progress: a phase, how much is done, and of how much."""
TELL_EACH = 256
PLACE_KEY_BYTES = SPACE_BYTES + LOCATION_BYTES
OBJECT_KEY_BYTES = PLACE_KEY_BYTES + OBJECT_BYTES
_CHECK_AT = 4


class Judge(Protocol):
    """Who knows the scenes' headers."""

    def __call__(self, spot: Spot, record: Record, /) -> str | None:
        """What is wrong with a record whose bytes are right; "" if nobody can tell, None if nothing is."""
        ...


def nobody_can_tell(_spot: Spot, _record: Record, /) -> str | None:
    """For who knows no scene."""
    return ""


def check_records(raw: ReadTransaction, judge: Judge, findings: Findings, tell: Tell, expected: int | None) -> dict[SpaceAddress, Counts]:
    """Add what is wrong; how much lies in each space. `expected`: how many records there should be."""
    counted: defaultdict[SpaceAddress, list[int]] = defaultdict(lambda: [0, 0])
    done = 0
    for key, value in raw.scan(RECORDS, *EVERY_KEY):
        if done % TELL_EACH == 0:
            tell("records", done, expected)
        done += 1
        if len(key) not in (PLACE_KEY_BYTES, OBJECT_KEY_BYTES):
            where = f"{RECORDS}, {key.hex()}"
            findings.add(Finding(RECORDS, where, "a record under a key that names no place", Helps.MEND, partial(_delete, key=key)))
            continue
        counts = counted[space_of(key)]
        counts[0], counts[1] = counts[0] + 1, counts[1] + len(value)
        for finding in _check(key, value, judge, findings):
            findings.add(finding)
    tell("records", done, done)
    sums = {space: Counts(*counts) for space, counts in sorted(counted.items())}
    findings.records = sum(sums.values(), Counts())
    return sums


def _check(key: bytes, value: memoryview, judge: Judge, findings: Findings) -> Iterator[Finding]:
    spot, where = spot_of(key), named(RECORDS, key)
    try:
        record = unpack_record(value)
    except DamagedData as damage:
        yield Finding(RECORDS, where, damage.what, Helps.FETCH, spot=spot)
        return
    wrong: str | None = "the record there is one of another place"
    if _is_its_place(spot, record.header):
        wrong = judge(spot, record)
        findings.signatures += wrong != ""
    if wrong:
        yield Finding(RECORDS, where, wrong, Helps.FETCH, partial(spoil, key=key), spot)


def _is_its_place(spot: Spot, header: RecordHeader) -> bool:
    place = spot.place
    if (header.scene, header.space) != (place.scene, place.space):
        return False
    if header.placement == PLACED_BY_NODE:
        return object_of(header) == spot.object
    return header.location == place.location and not spot.object


def spoil(transaction: WriteTransaction, key: bytes) -> None:
    """Make a wreck of what lies there, so that nobody takes it for what belongs there, and what does heals it."""
    value = bytes(transaction.get(RECORDS, key) or b"")
    check = bytes(255 - byte for byte in value[_CHECK_AT : _CHECK_AT + 4])
    transaction.put(RECORDS, key, value[:_CHECK_AT] + check + value[_CHECK_AT + 4 :])


def _delete(transaction: WriteTransaction, key: bytes) -> None:
    transaction.delete(RECORDS, key)

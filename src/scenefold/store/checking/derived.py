"""What follows from the records, held against them: counts, and the places of objects (specs/21-verify.md)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from scenefold.base.errors import DamagedData
from scenefold.crypto import version_key
from scenefold.store.checking.findings import Finding, Helps, named
from scenefold.store.checking.fixes import delete, put
from scenefold.store.checking.records import OBJECT_KEY_BYTES
from scenefold.store.checking.tables import EVERY_KEY, Sound
from scenefold.store.layout import (
    OBJECTS,
    RECORDS,
    STATISTICS,
    SpaceAddress,
    Spot,
    object_key,
    record_key,
    space_key,
    spot_of,
    unpack_record,
)
from scenefold.store.statistics import Counts, pack_counts
from scenefold.world.ports import ReadTransaction


def check_statistics(raw: ReadTransaction, counted: Mapping[SpaceAddress, Counts]) -> Iterator[Finding]:
    """Of a space without a row nothing would ever be handed over or compared: its records would be found by nobody who walks."""
    rows = {key: bytes(value) for key, value in Sound(raw).scan(STATISTICS, *EVERY_KEY)}
    keys = {space_key(*space): counts for space, counts in counted.items()}
    for key in sorted({*raw.keys(STATISTICS, *EVERY_KEY), *keys}):
        wanted = pack_counts(keys.get(key, Counts()))
        if rows.get(key) != wanted:
            what = "the counts of a space are not those of its records"
            yield Finding(STATISTICS, named(STATISTICS, key), what, Helps.MEND, put(STATISTICS, key, wanted))


def check_objects(raw: ReadTransaction) -> Iterator[Finding]:
    """Each object that does not lie at home has its place there, nothing else has, and no object lies at two places."""
    sound, wanted = Sound(raw), dict[bytes, Spot]()
    for key in raw.keys(RECORDS, *EVERY_KEY):
        if len(key) != OBJECT_KEY_BYTES:
            continue
        spot = spot_of(key)
        if spot.place.location == spot.home:
            continue
        row = object_key(spot.place.scene, spot.place.space, spot.object)
        other = wanted.get(row, Spot(spot.place._replace(location=spot.home), spot.object))
        if raw.get(RECORDS, record_key(*other)) is not None:
            spot, finding = _chosen(raw, spot, other)
            yield finding
        wanted[row] = spot
    for row in sorted({*raw.keys(OBJECTS, *EVERY_KEY), *wanted}):
        chosen, kept = wanted.get(row), sound.get(OBJECTS, row)
        if chosen is None or chosen.place.location == chosen.home:
            what = "a place of an object that does not lie there"
            if raw.get(OBJECTS, row) is not None:
                yield Finding(OBJECTS, named(OBJECTS, row), what, Helps.MEND, delete(OBJECTS, row))
        elif kept is None or bytes(kept) != chosen.place.location:
            what = "an object lies elsewhere than its place says"
            yield Finding(OBJECTS, named(OBJECTS, row), what, Helps.MEND, put(OBJECTS, row, chosen.place.location))


def _chosen(raw: ReadTransaction, one: Spot, other: Spot) -> tuple[Spot, Finding]:
    """Which of two records of one object counts; the other one goes, as it should have gone when that was written.

    If either has rotted, nobody knows which is newer: both stay, and the node gets it from others.
    """
    where, what = named(RECORDS, record_key(*one)), "an object lies at two places"
    mine, others = _version(raw, one), _version(raw, other)
    if mine is None or others is None:
        return one, Finding(RECORDS, where, what, Helps.FETCH, spot=one)
    lower, higher = (one, other) if mine < others else (other, one)
    return higher, Finding(RECORDS, where, what, Helps.MEND, delete(RECORDS, record_key(*lower)))


def _version(raw: ReadTransaction, spot: Spot) -> tuple[int, int, int, int, bytes] | None:
    value = raw.get(RECORDS, record_key(*spot))
    assert value is not None
    try:
        return version_key(unpack_record(value).header)
    except DamagedData:
        return None

"""Sums of arcs, from the trees of digests, and what lies in an arc by homes, for who compares (specs/10-store.md, Digests). Plain functions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from scenefold.base.location import LAST, Arc, Location
from scenefold.store.digest_changes import built_to
from scenefold.store.digest_tree import LEVELS, Rows
from scenefold.store.homes import by_home
from scenefold.store.layout import SpaceAddress, Spot, sound_header, spot_of
from scenefold.store.versions import RangeSum, stored_sum, version_of
from scenefold.world.ports import ReadTransaction

WRECKS_MAX = 256
"""Of one look: the others are met by the next one."""


class Held(NamedTuple):
    """A stored record: where it lies, where its home is, which version it is and what its header says; b"" for one whose header has rotted."""

    spot: Spot
    home: Location
    version: bytes
    header: bytes
    size: int
    """In bytes, as stored."""


class Listing(NamedTuple):
    """Records in the order of their homes. `covered` is the part of the arc that they are all of; all of it if `complete`."""

    records: list[Held]
    covered: Arc
    complete: bool


class Sums(NamedTuple):
    """Of each arc its sum. `wrecks`: records that were met on the way and are in none, as their header has rotted."""

    sums: list[RangeSum]
    wrecks: tuple[Spot, ...]


def read_sums(transaction: ReadTransaction, space: SpaceAddress, arcs: Sequence[Arc]) -> Sums:
    """What lies in each arc, by homes: some ms an arc, however much there is. TreeDamaged if the tree is to be made anew."""
    wrecks: dict[Spot, None] = {}
    built, prefixes = built_to(transaction, space), _Prefixes(transaction, space, wrecks)
    sums = []
    for arc in arcs:
        behind, last = _before(arc.first), bytes(arc.last)
        total = prefixes.up_to(min(last, built)).without(prefixes.up_to(min(behind, built)))
        # What the tree does not have yet is walked over, and nothing else is.
        sums.append(total.and_also(*_walked(transaction, space, max(behind, built), last, wrecks)))
    return Sums(sums, tuple(wrecks))


class _Prefixes:
    """Sums from the beginning of the line, each read once: arcs that meet have bounds in common."""

    def __init__(self, transaction: ReadTransaction, space: SpaceAddress, wrecks: dict[Spot, None]) -> None:
        self._transaction = transaction
        self._space = space
        self._wrecks = wrecks
        self._rows = Rows(transaction, space)
        self._known = {b"": RangeSum()}

    def up_to(self, location: bytes) -> RangeSum:
        if location not in self._known:
            self._known[location] = self._read_up_to(location)
        return self._known[location]

    def _read_up_to(self, location: bytes) -> RangeSum:
        total, begin = RangeSum(), b""
        for level in range(LEVELS, 0, -1):
            for bound, row in self._rows.behind(level, begin, bytes(LAST)):
                if bound > location:
                    break
                total, begin = total.and_also(row.records, row.sum), bound
            if begin == location:
                return total
        return total.and_also(*_walked(self._transaction, self._space, begin, location, self._wrecks))


def _walked(transaction: ReadTransaction, space: SpaceAddress, begin: bytes, last: bytes, wrecks: dict[Spot, None]) -> RangeSum:
    """Of the records themselves: less than a bucket, or what the tree does not have yet."""
    if begin >= last:
        return RangeSum()
    known = []
    for found in by_home(transaction, space, begin, last):
        one = stored_sum(found.value)
        if one is not None:
            known.append(one)
        elif len(wrecks) < WRECKS_MAX:
            wrecks[spot_of(found.key)] = None
    return RangeSum().and_also(len(known), sum(known))


def _before(location: Location) -> bytes:
    return Location.from_number(location.number - 1) if location.number else b""


def read_spaces(transaction: ReadTransaction, spaces: Sequence[SpaceAddress], arc: Arc) -> list[SpaceAddress]:
    """Those of the spaces that have a record with its home in the arc."""
    return [space for space in spaces if next(by_home(transaction, space, _before(arc.first), arc.last), None) is not None]


def read_listing(transaction: ReadTransaction, space: SpaceAddress, arc: Arc, limit: int) -> Listing:
    """The first `limit` >= 2 records with their homes in the arc, and which versions they are; of one home all or none."""
    records: list[Held] = []
    for home, key, value in by_home(transaction, space, _before(arc.first), arc.last):
        if len(records) == limit:
            # A fixed record and an object may have one home; never more.
            if records[-1].home == home:
                records.pop()
            return Listing(records, Arc(arc.first, records[-1].home), complete=False)
        header = sound_header(value)
        version = b"" if header is None else version_of(header)
        records.append(Held(spot_of(key), Location(home), version, header or b"", len(value)))
    return Listing(records, arc, complete=True)

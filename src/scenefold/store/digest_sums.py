"""Sums of arcs, from the trees of digests, and what lies in an arc by homes, for who compares (specs/10-store.md, Digests). Plain functions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from scenefold.base.location import LAST, Arc, Location
from scenefold.store.digest_changes import built_to
from scenefold.store.digest_tree import LEVELS, Rows
from scenefold.store.homes import by_home
from scenefold.store.layout import SpaceAddress, Spot, sound_header, spot_of
from scenefold.store.versions import SUM_MODULUS, RangeSum, stored_sum, version_of
from scenefold.world.ports import ReadTransaction

_END = bytes(LAST)
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
    """What lies in each arc, by homes: some tenths of a ms an arc, however much there is. TreeDamaged if the tree is to be made anew."""
    wrecks: dict[Spot, None] = {}
    built, prefixes = built_to(transaction, space), _Prefixes(transaction, space, wrecks)
    pieces = [(_before(arc.first), bytes(arc.last)) for arc in arcs]
    bounds = sorted({min(bound, built) for piece in pieces for bound in piece})
    up_to = {bound: prefixes.up_to(bound) for bound in bounds}
    # What the tree does not have yet is walked over, and nothing else is.
    sums = [
        up_to[min(last, built)].without(up_to[min(behind, built)]).and_also(*_walked(transaction, space, max(behind, built), last, wrecks))
        for behind, last in pieces
    ]
    return Sums(sums, tuple(wrecks))


class _Prefixes:
    """Sums from the beginning of the line up to ascending locations. Whatever is between two of them is read once."""

    def __init__(self, transaction: ReadTransaction, space: SpaceAddress, wrecks: dict[Spot, None]) -> None:
        self._transaction = transaction
        self._space = space
        self._wrecks = wrecks
        self._rows = Rows(transaction, space)
        self._walks: dict[int, _Walk] = {}
        """By level; 0 is that of the records themselves, less than a bucket."""

    def up_to(self, location: bytes) -> RangeSum:
        """Not below the one before."""
        reached, has_moved = _Reached(b"", RangeSum()), False
        for level in range(LEVELS, -1, -1):
            walk = self._walks.get(level)
            if walk is None or has_moved:
                # The piece above is another one by now, and this level goes on behind what is left of it.
                walk = self._walks[level] = _Walk(reached, self._parts(level, reached.bound))
            has_moved = walk.go(location) or has_moved
            reached = walk.reached
        return reached.total

    def _parts(self, level: int, begin: bytes) -> Iterator[tuple[bytes, int, int]]:
        """What is behind a location on a level: where each part ends, its records and their sum."""
        if level:
            return ((bound, row.records, row.sum) for bound, row in self._rows.behind(level, begin, _END))
        return self._records(begin)

    def _records(self, begin: bytes) -> Iterator[tuple[bytes, int, int]]:
        for found in by_home(self._transaction, self._space, begin, _END):
            one = stored_sum(found.value)
            yield found.home, int(one is not None), one or 0
            # Once it is passed: the one behind the last bound is looked at only to know that it is behind it.
            if one is None:
                _note(self._wrecks, found.key)


class _Reached(NamedTuple):
    """How far a walk is, and what lies up to there, from the beginning of the line."""

    bound: bytes
    total: RangeSum


class _Walk:
    """Along the parts of one level."""

    def __init__(self, reached: _Reached, parts: Iterator[tuple[bytes, int, int]]) -> None:
        self.reached = reached
        self._parts = parts
        self._next = next(parts, None)

    def go(self, location: bytes) -> bool:
        """Past all parts that end there or before; whether there were any."""
        bound, (records, total) = self.reached
        has_moved = False
        while self._next is not None and self._next[0] <= location:
            bound, more, value = self._next
            records, total, has_moved = records + more, total + value, True
            self._next = next(self._parts, None)
        if has_moved:
            self.reached = _Reached(bound, RangeSum(records, total % SUM_MODULUS))
        return has_moved


def _walked(transaction: ReadTransaction, space: SpaceAddress, begin: bytes, last: bytes, wrecks: dict[Spot, None]) -> RangeSum:
    """Of the records themselves: less than a bucket, or what the tree does not have yet."""
    if begin >= last:
        return RangeSum()
    known = []
    for found in by_home(transaction, space, begin, last):
        one = stored_sum(found.value)
        if one is None:
            _note(wrecks, found.key)
        else:
            known.append(one)
    return RangeSum().and_also(len(known), sum(known))


def _note(wrecks: dict[Spot, None], key: bytes) -> None:
    if len(wrecks) < WRECKS_MAX:
        wrecks[spot_of(key)] = None


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

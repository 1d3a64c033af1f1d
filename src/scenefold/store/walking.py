"""Walks over the records of pieces of the line, across all spaces: for handovers, balance and strays. Plain functions.

A handover asks what lies in an arc, whatever scene it belongs to. Keys are ordered by scene, space, location, so that
is one walk a space and piece; the spaces are those that the table of statistics has ever seen. A cursor is the
key of the last entry given: the next walk begins behind it, whatever has changed meanwhile.
"""

from __future__ import annotations

import heapq
import logging
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from typing import NamedTuple

from scenefold.base.errors import DamagedData
from scenefold.base.location import FIRST, LAST, Arc, Location
from scenefold.crypto import RecordPlace
from scenefold.store.holding import read_arc
from scenefold.store.layout import (
    OBJECTS_END,
    RECORDS,
    STATISTICS,
    SpaceAddress,
    Spot,
    location_of,
    record_key,
    space_of,
    spot_of,
    stored_header,
)
from scenefold.store.placing import displaced
from scenefold.store.statistics import Counts
from scenefold.world.ports import ReadTransaction

_log = logging.getLogger("scenefold.store")


class Entry(NamedTuple):
    """A stored record without its bytes. `size` as stored, `digest` of the ciphertext: which version it is."""

    place: RecordPlace
    object: bytes
    digest: bytes
    size: int

    @property
    def spot(self) -> Spot:
        return Spot(self.place, self.object)

    @property
    def home(self) -> Location:
        """The place whose owner decides about the record."""
        return self.spot.home


class Manifest(NamedTuple):
    """Entries in the order of (scene, space, location, object), and where to go on; None behind the last one.

    Only the cursor says whether that is all: where everything looked at has rotted, or is none, there are no entries, and more may follow.
    """

    entries: list[Entry]
    cursor: bytes | None
    damaged: tuple[Spot, ...] = ()
    """Where records lie whose header has changed on the disk: they are in no list of entries."""


class Weighed(NamedTuple):
    """What lies between `location` and the side that it was weighed from, both included."""

    location: Location
    records: int
    bytes: int


def outside(pieces: Iterable[Arc]) -> list[Arc]:
    """The rest of the line, in order."""
    rest: list[Arc] = []
    begin: Location | None = FIRST
    for piece in sorted(pieces, key=lambda piece: piece.first):
        if begin is None:
            break
        if piece.first > begin:
            rest.append(Arc(begin, Location.from_number(piece.first.number - 1)))
        if piece.last >= begin:
            begin = piece.last.next()
    return rest if begin is None else [*rest, Arc(begin, LAST)]


class Rightful:
    """Where records lie by right: in some arcs whatever space they are of, and in others those of one space alone."""

    def __init__(self, kept: Sequence[Arc], held: Mapping[SpaceAddress, Sequence[Arc]] | None = None) -> None:
        self.kept = kept
        self.held = held or {}
        self._outside: dict[SpaceAddress | None, list[Arc]] = {}

    def outside(self, space: SpaceAddress) -> list[Arc]:
        """Where its strays lie: in order, apart from each other."""
        more = self.held.get(space)
        known = space if more else None
        if known not in self._outside:
            self._outside[known] = outside([*self.kept, *(more or ())])
        return self._outside[known]

    def is_stray(self, space: SpaceAddress, home: Location) -> bool:
        pieces = self.outside(space)
        index = bisect_right(pieces, home, key=lambda piece: piece.first) - 1
        return index >= 0 and home in pieces[index]


def strays(transaction: ReadTransaction, rightful: Rightful, after: bytes | None, limit: int) -> Manifest:
    """Of the first `limit` >= 1 records that lie elsewhere than by right, behind the cursor, those whose homes do, too."""
    found = _listed(transaction, _keys(transaction, rightful.outside, after=after), limit)
    # An object may lie beside a place of ours that is its home: it slides.
    entries = [entry for entry in found.entries if not entry.object or rightful.is_stray(entry.place[:2], entry.home)]
    damaged = [spot for spot in found.damaged if not spot.object or rightful.is_stray(spot.place[:2], spot.home)]
    return Manifest(entries, found.cursor, tuple(damaged))


def manifest(transaction: ReadTransaction, pieces: Sequence[Arc], after: bytes | None, limit: int) -> Manifest:
    """The first `limit` >= 1 entries in the pieces (ascending, apart from each other) behind the cursor."""
    return _listed(transaction, entry_keys(transaction, pieces, after=after), limit)


def _listed(transaction: ReadTransaction, keys: Iterator[bytes], limit: int) -> Manifest:
    entries: list[Entry] = []
    damaged: list[Spot] = []
    looked_at, seen = None, 0
    for key in islice(keys, limit):
        looked_at, seen = key, seen + 1
        value = transaction.get(RECORDS, key)
        assert value is not None
        spot = spot_of(key)
        try:
            entries.append(Entry(*spot, stored_header(value).digest, len(value)))
        except DamagedData as error:
            # Nobody could take it from us. It stays where it is until a sound version replaces it.
            _log.error("a damaged record is left out of a list: %s (%s)", error, describe(spot))
            damaged.append(spot)
    return Manifest(entries, looked_at if seen == limit else None, tuple(damaged))


def misplaced(transaction: ReadTransaction, rightful: Rightful, limit: int) -> list[Entry]:
    """Objects that lie where records of their space lie by right, though their homes do not, at most `limit`; damaged ones stay where they are."""
    entries: list[Entry] = []
    for spot, home in displaced(transaction):
        space = spot.place[:2]
        if len(entries) < limit and rightful.is_stray(space, home) and not rightful.is_stray(space, spot.place.location):
            value = transaction.get(RECORDS, record_key(*spot))
            assert value is not None
            with suppress(DamagedData):
                entries.append(Entry(*spot, stored_header(value).digest, len(value)))
    return entries


def beside(transaction: ReadTransaction, rightful: Rightful) -> int:
    """How many objects lie in this node's arc that it holds for others: whoever lists the arc would take them for its own."""
    arc = read_arc(transaction)
    if arc is None:
        return 0
    return sum(
        spot.place.location in arc and home not in arc and not rightful.is_stray(spot.place[:2], home)
        for spot, home in displaced(transaction)
    )


def parted(transaction: ReadTransaction, piece: Arc) -> int:
    """How many objects have either their place or their home in the piece, and not both. Only those count that this node decides about."""
    arc = read_arc(transaction)
    if arc is None:
        return 0
    return sum((spot.place.location in piece) != (home in piece) for spot, home in displaced(transaction) if home in arc)


def entry_keys(transaction: ReadTransaction, pieces: Sequence[Arc], *, after: bytes | None = None) -> Iterator[bytes]:
    """Keys of the records in the pieces, space by space."""
    return _keys(transaction, lambda _: pieces, after=after)


def _keys(
    transaction: ReadTransaction, pieces_of: Callable[[SpaceAddress], Sequence[Arc]], *, after: bytes | None = None
) -> Iterator[bytes]:
    for space in spaces(transaction):
        if after is not None and space < space_of(after):
            continue
        for piece in pieces_of(space):
            first, last = _ends(space, piece)
            if after is not None and after >= last:
                continue
            begin = first if after is None or after < first else after + b"\0"
            yield from transaction.keys(RECORDS, begin, last)


def spaces(transaction: ReadTransaction) -> list[SpaceAddress]:
    """Every space that ever held a record here, in order."""
    return [space_of(key) for key in transaction.keys(STATISTICS, b"", b"\xff" * 6)]


def totals(transaction: ReadTransaction, arc: Arc) -> Counts:
    records = stored_bytes = 0
    for space in spaces(transaction):
        for _key, value in transaction.scan(RECORDS, *_ends(space, arc)):
            records += 1
            stored_bytes += len(value)
    return Counts(records, stored_bytes)


def weigh(transaction: ReadTransaction, arc: Arc, bytes_wanted: int, *, from_right: bool) -> Weighed:
    """How far from one side of the arc so many bytes reach, all spaces together: at least that many if there are.

    All records of the last location are counted, since a bound cannot part them. Nothing there: the side itself.
    """
    walks = [_sizes(transaction, space, arc, from_right) for space in spaces(transaction)]
    location, records, stored_bytes = (arc.last if from_right else arc.first), 0, 0
    for place, size in heapq.merge(*walks, key=lambda found: found[0], reverse=from_right):
        if stored_bytes >= bytes_wanted and place != location:
            break
        location, records, stored_bytes = place, records + 1, stored_bytes + size
    return Weighed(location, records, stored_bytes)


def describe(spot: Spot) -> str:
    """The place of a record, for people."""
    place, object_id = spot
    suffix = f", object {object_id.hex()}" if object_id else ""
    return f"scene {place.scene:08x}, space {place.space}, {place.location.hex()}{suffix}"


def _sizes(transaction: ReadTransaction, space: SpaceAddress, arc: Arc, from_right: bool) -> Iterator[tuple[Location, int]]:
    for key, value in transaction.scan(RECORDS, *_ends(space, arc), reverse=from_right):
        yield location_of(key), len(value)


def _ends(space: SpaceAddress, arc: Arc) -> tuple[bytes, bytes]:
    """The first and the last key that a record in the arc may have."""
    return record_key(RecordPlace(*space, arc.first)), record_key(RecordPlace(*space, arc.last), OBJECTS_END)

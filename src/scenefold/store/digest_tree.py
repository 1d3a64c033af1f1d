"""The tree of digests of one space, as a write transaction brings it up to date (specs/10-store.md, Digests).

The line is cut three times over: into buckets of records, into groups of buckets, into groups of groups. A row stands at the last
location of its piece, and tells how many parts it has, how many records, and their sum. Each bound of a level is one of the level
below, too. So a piece that has grown too large is cut anywhere between two records, however alike their locations are, and
nothing else has to be numbered anew; and one that has become small goes together with its neighbour.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from scenefold.base.location import FIRST, LAST
from scenefold.store.homes import by_home
from scenefold.store.layout import DIGESTS, SpaceAddress, space_key
from scenefold.store.sealing import StoreDamaged
from scenefold.store.versions import SUM_BYTES, SUM_MODULUS, stored_sum
from scenefold.world.ports import ReadTransaction, WriteTransaction

LEVELS = 3
PARTS_MAX = (64, 256, 256)
"""Records of a bucket, buckets of a group, and so on; more of the highest level are walked over."""
_ROW = struct.Struct(f">IQ{SUM_BYTES}s")
_END = bytes(LAST)


class TreeDamaged(Exception):
    """The tree of a space is not what was written, or not what it should be: it is to be built from the records."""

    def __init__(self, space: SpaceAddress, what: str) -> None:
        super().__init__(what)
        self.space = space


class Row(NamedTuple):
    """A piece of the line: `parts` of the level below (of a bucket: records), and what its records add up to."""

    parts: int = 0
    records: int = 0
    sum: int = 0

    def plus(self, parts: int, records: int, total: int) -> Row:
        return Row(self.parts + parts, self.records + records, (self.sum + total) % SUM_MODULUS)


class Difference(NamedTuple):
    """What becomes more, somewhere. `is_lost`: what was there before is not known, so that it is to be counted."""

    at: bytes
    parts: int
    records: int
    sum: int
    is_lost: bool = False


class Rows:
    """The rows of a space, as they are."""

    def __init__(self, transaction: ReadTransaction, space: SpaceAddress) -> None:
        self.space = space
        self._transaction = transaction
        self._prefixes = [space_key(*space) + bytes((level,)) for level in range(LEVELS + 1)]

    def key(self, level: int, bound: bytes) -> bytes:
        return self._prefixes[level] + bound

    def at_or_behind(self, level: int, location: bytes) -> tuple[bytes, Row] | None:
        """The piece that a location is in."""
        prefix = self._prefixes[level]
        try:
            found = self._transaction.first(DIGESTS, prefix + location, prefix + _END)
        except StoreDamaged as damage:
            raise TreeDamaged(self.space, damage.what) from damage
        return None if found is None else (found[0][len(prefix) :], self._row(found[1]))

    def behind(self, level: int, bound: bytes, last: bytes) -> Iterator[tuple[bytes, Row]]:
        """The pieces that end behind a bound (b"": all), up to another."""
        prefix = self._prefixes[level]
        try:
            for key, value in self._transaction.scan(DIGESTS, prefix + bound + b"\0" if bound else prefix, prefix + last):
                yield key[len(prefix) :], self._row(value)
        except StoreDamaged as damage:
            raise TreeDamaged(self.space, damage.what) from damage

    def before(self, level: int, bound: bytes) -> bytes:
        """The bound before; b"" for none."""
        if bound == FIRST:
            return b""
        highest = (int.from_bytes(bound, "big") - 1).to_bytes(len(bound), "big")
        key = next(self._transaction.keys(DIGESTS, self.key(level, b""), self.key(level, highest), reverse=True), None)
        return b"" if key is None else key[-len(bound) :]

    def is_bound(self, level: int, bound: bytes) -> bool:
        if level > LEVELS:
            return bound == _END
        return next(self._transaction.keys(DIGESTS, self.key(level, bound), self.key(level, bound)), None) is not None

    def everything(self) -> list[bytes]:
        """The keys of all rows, damaged or not."""
        return list(self._transaction.keys(DIGESTS, self.key(0, b""), self.key(LEVELS, _END)))

    def _row(self, value: memoryview) -> Row:
        if len(value) != _ROW.size:
            raise TreeDamaged(self.space, "a row of the digests is none")
        parts, records, total = _ROW.unpack(value)
        return Row(parts, records, int.from_bytes(total, "big"))


class DigestTree(Rows):
    """Likewise, to be changed. `built` is as far as records are in it; b"" for nowhere, the end of the line for all."""

    def __init__(self, transaction: WriteTransaction, space: SpaceAddress, built: bytes = _END) -> None:
        super().__init__(transaction, space)
        self._writing = transaction
        self._built = built

    def begin(self) -> None:
        """The rows of a space without records."""
        for level in range(1, LEVELS + 1):
            self._put(level, _END, Row(parts=level > 1))

    def apply(self, differences: Sequence[Difference]) -> None:
        """In the order of the line, `at` the homes of records as they are now."""
        level = 1
        while differences and level <= LEVELS:
            differences = self._apply(level, differences)
            level += 1

    def _apply(self, level: int, differences: Sequence[Difference]) -> list[Difference]:
        """Change the pieces of a level; what that changes in the level above."""
        above: list[Difference] = []
        index, most = 0, PARTS_MAX[level - 1]
        while index < len(differences):
            found = self.at_or_behind(level, differences[index].at)
            if found is None and level == 1 and self.at_or_behind(LEVELS, _END) is None:
                self.begin()
                found = self.at_or_behind(level, differences[index].at)
            if found is None:
                raise TreeDamaged(self.space, "a piece of the line has no row in the digests")
            bound, row = found
            _, parts, records, total, is_lost = differences[index]
            index += 1
            while index < len(differences) and (one := differences[index]).at <= bound:
                parts, records, total, is_lost = parts + one.parts, records + one.records, total + one.sum, is_lost or one.is_lost
                index += 1
            now, more = row.plus(parts, records, total), 0
            parts, records, _ = now
            if is_lost or parts > most:
                more, now = self._cut(level, bound, now, is_lost)
            elif parts < 0 or records < 0:
                raise TreeDamaged(self.space, "a row of the digests counts fewer records than there were")
            elif parts < row.parts and parts < most // 4 and self._join(level, bound, now):
                more = -1
            else:
                self._put(level, bound, now)
            above.append(Difference(bound, more, now.records - row.records, now.sum - row.sum))
        return above

    def _cut(self, level: int, bound: bytes, now: Row, is_lost: bool) -> tuple[int, Row]:
        """Cut a piece into some of three quarters of the most; how many more they are than one, and all of it.

        The last of them is what the others leave of it. But if one of its records has rotted, all are counted: of that one
        nobody knows what it was, and it adds nothing any more.
        """
        most, begin = PARTS_MAX[level - 1], self.before(level, bound)
        count = 1 if is_lost else -(-now.parts * 4 // (3 * most))
        size = most if is_lost else -(-now.parts // count)
        pieces, last, parts, records, total = [], begin, 0, 0, 0
        for at, of_part, sum_of_part in self._parts(level, begin, bound):
            if sum_of_part is None:
                if not is_lost:
                    return self._cut(level, bound, now, is_lost=True)
                continue
            if parts >= size and at != last:
                pieces.append((last, Row(parts, records, total % SUM_MODULUS)))
                parts, records, total = 0, 0, 0
                if len(pieces) == count - 1:
                    break
            last, parts, records, total = at, parts + 1, records + of_part, total + sum_of_part
        counted = Row()
        for _, piece in pieces:
            counted = counted.plus(*piece)
        if is_lost:
            now = counted.plus(parts, records, total)
        pieces.append((bound, Row(now.parts - counted.parts, now.records - counted.records, (now.sum - counted.sum) % SUM_MODULUS)))
        if min(pieces[-1][1]) < 0:
            raise TreeDamaged(self.space, "a row of the digests counts fewer records than there are")
        for end, piece in pieces:
            self._put(level, end, piece)
        return len(pieces) - 1, now

    def _parts(self, level: int, begin: bytes, end: bytes) -> Iterator[tuple[bytes, int, int | None]]:
        """Where each part of a piece ends, its records and their sum; None for a record that has rotted."""
        if level > 1:
            return ((at, row.records, row.sum) for at, row in self.behind(level - 1, begin, end))
        if begin >= self._built:
            return iter(())
        found = by_home(self._transaction, self.space, begin, min(end, self._built))
        return ((home, 1, stored_sum(value)) for home, _key, value in found)

    def _join(self, level: int, bound: bytes, now: Row) -> bool:
        """Put a small piece together with a neighbour, of the same piece above: False if there is none small enough."""
        most = PARTS_MAX[level - 1] * 3 // 4
        if not self.is_bound(level + 1, bound):
            behind = self.at_or_behind(level, bound + b"\0")
            if behind is not None and behind[1].parts + now.parts <= most:
                self._writing.delete(DIGESTS, self.key(level, bound))
                self._put(level, behind[0], behind[1].plus(*now))
                return True
        before = self.before(level, bound)
        if before and not self.is_bound(level + 1, before):
            found = self.at_or_behind(level, before)
            if found is not None and found[1].parts + now.parts <= most:
                self._writing.delete(DIGESTS, self.key(level, before))
                self._put(level, bound, found[1].plus(*now))
                return True
        return False

    def _put(self, level: int, bound: bytes, row: Row) -> None:
        value = _ROW.pack(row.parts, row.records, row.sum.to_bytes(SUM_BYTES, "big"))
        self._writing.put(DIGESTS, self._prefixes[level] + bound, value)

"""Records in the order of their homes (specs/10-store.md, Node-managed spaces, Digests).

Who holds a record follows from its home, and nodes that hold the same object may have put it at different places. So whatever is compared
between nodes goes by homes. Nearly all records lie at home; the table of objects, which is in the order of homes too, names the others.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from itertools import chain
from typing import NamedTuple

from scenefold.base.location import LOCATION_BYTES
from scenefold.crypto import OBJECT_BYTES, wanted_place
from scenefold.store.layout import OBJECTS, OBJECTS_END, RECORDS, SPACE_BYTES, SpaceAddress, object_of_key, space_key
from scenefold.world.ports import ReadTransaction

_HOME_END = SPACE_BYTES + LOCATION_BYTES
"""Of a record that lies at home."""


class Housed(NamedTuple):
    """A stored record, and its home, in bytes."""

    home: bytes
    key: bytes
    value: memoryview


def by_home(transaction: ReadTransaction, space: SpaceAddress, behind: bytes, last: bytes) -> Iterator[Housed]:
    """The records of a space with their homes behind one location (b"": from the first on), and up to another."""
    elsewhere = _away(transaction, space, behind, last)
    first = next(elsewhere, None)
    if first is None:
        return _at_home(transaction, space, behind, last)
    return heapq.merge(_at_home(transaction, space, behind, last), chain([first], elsewhere), key=lambda found: found[:2])


def _at_home(transaction: ReadTransaction, space: SpaceAddress, behind: bytes, last: bytes) -> Iterator[Housed]:
    prefix = space_key(*space)
    begin = prefix + behind + OBJECTS_END + b"\0" if behind else prefix
    for key, value in transaction.scan(RECORDS, begin, prefix + last + OBJECTS_END):
        home, object_id = key[len(prefix) : _HOME_END], key[_HOME_END:]
        if not object_id or wanted_place(object_id) == home:
            yield Housed(home, key, value)


def _away(transaction: ReadTransaction, space: SpaceAddress, behind: bytes, last: bytes) -> Iterator[Housed]:
    prefix = space_key(*space)
    begin = prefix + behind[:OBJECT_BYTES] + b"\0" if behind else prefix
    for object_row, place in transaction.scan(OBJECTS, begin, prefix + last[:OBJECT_BYTES]):
        object_id = object_of_key(object_row)
        home, at = wanted_place(object_id), bytes(place)
        key = prefix + at + object_id
        value = None if at == home else transaction.get(RECORDS, key)
        if value is not None:
            yield Housed(bytes(home), key, value)

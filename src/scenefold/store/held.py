"""All that lies in an arc by homes, over all spaces, for who recovers it (specs/20-copies.md, Recovery). Plain functions.

In the order of (scene, space, home, location, object). A cursor is all of these of the last record given: the next walk begins
behind it, whatever has changed meanwhile.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from scenefold.base.location import LOCATION_BYTES, Arc, Location
from scenefold.crypto import OBJECT_BYTES
from scenefold.store.digest_sums import Held
from scenefold.store.homes import Housed, by_home
from scenefold.store.layout import SPACE_BYTES, sound_header, space_key, spot_of
from scenefold.store.versions import version_of
from scenefold.store.walking import spaces
from scenefold.world.ports import ReadTransaction

CURSOR_BYTES_MAX = SPACE_BYTES + 2 * LOCATION_BYTES + OBJECT_BYTES


class HeldPage(NamedTuple):
    """Records whose headers are sound, and where to go on; None behind the last one."""

    records: list[Held]
    cursor: bytes | None


def read_held(transaction: ReadTransaction, arc: Arc, after: bytes, limit: int) -> HeldPage:
    """The first `limit` >= 1 records with their homes in the arc, behind the cursor (b"": from the first on). Some 10 us a record."""
    records: list[Held] = []
    for cursor, found in _behind(transaction, arc, after):
        header = sound_header(found.value)
        if header is not None:
            records.append(Held(spot_of(found.key), Location(found.home), version_of(header), header, len(found.value)))
            if len(records) == limit:
                return HeldPage(records, cursor)
    return HeldPage(records, None)


def _behind(transaction: ReadTransaction, arc: Arc, after: bytes) -> Iterator[tuple[bytes, Housed]]:
    for space in spaces(transaction):
        first = arc.first
        prefix = space_key(*space)
        if after[:SPACE_BYTES] > prefix:
            continue
        if after[:SPACE_BYTES] == prefix and len(after) >= SPACE_BYTES + LOCATION_BYTES:
            first = max(first, Location(after[SPACE_BYTES : SPACE_BYTES + LOCATION_BYTES]))
        if first > arc.last:
            continue
        behind = Location.from_number(first.number - 1) if first.number else b""
        for found in by_home(transaction, space, behind, arc.last):
            cursor = prefix + found.home + found.key[SPACE_BYTES:]
            if cursor > after:
                yield cursor, found

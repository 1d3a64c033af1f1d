"""Where a node-managed record lies: the node's choice (thesis B.3; specs/10-store.md, Node-managed spaces).

An object's id, read as the beginning of a location, is its *home*: whoever owns that place, and nobody else, decides about the
object. Within its arc this node chooses where the record lies, at its home or as near behind it as nothing of the space lies. So
nearly all lie at home, and the table of objects names the others only. When a bound comes between an object and its home,
the object slides.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Arc, Location
from scenefold.crypto import RecordPlace, wanted_place
from scenefold.store.layout import OBJECTS, OBJECTS_END, RECORDS, Spot, object_key, object_of_key, record_key, space_of
from scenefold.world.ports import ReadTransaction

STEPS_MAX = 64
"""Places tried. If all are taken, two records share one: their keys differ all the same."""
_FIRST_KEY, _LAST_KEY = b"", b"\xff" * 22


def place_of(transaction: ReadTransaction, scene: SceneId, space: SpaceId, object_id: bytes) -> Location | None:
    """Where this node has an object; None if it has not."""
    value = transaction.get(OBJECTS, object_key(scene, space, object_id))
    if value is not None and _is_at(transaction, scene, space, Location(bytes(value)), object_id):
        return Location(bytes(value))
    home = wanted_place(object_id)
    return home if _is_at(transaction, scene, space, home, object_id) else None


def free_place(transaction: ReadTransaction, scene: SceneId, space: SpaceId, object_id: bytes, part: Arc) -> Location:
    """The first place from the object's home on, round within this part of the line, where nothing of the space lies."""
    home = wanted_place(object_id)
    start = home.number - part.first.number
    for step in range(min(STEPS_MAX, part.length)):
        place = Location.from_number(part.first.number + (start + step) % part.length)
        key = record_key(RecordPlace(scene, space, place))
        if next(transaction.keys(RECORDS, key, key + OBJECTS_END), None) is None:
            return place
    return home


class Displaced(NamedTuple):
    """An object that does not lie at its home, and where it lies."""

    spot: Spot
    home: Location

    def part_among(self, parts: Iterable[Arc]) -> Arc | None:
        """The part that the object belongs into and does not lie in, if it is one of these."""
        part = next((part for part in parts if self.home in part), None)
        return None if part is None or self.spot.place.location in part else part


def displaced(transaction: ReadTransaction) -> Iterator[Displaced]:
    """All objects that do not lie at home."""
    for key, value in transaction.scan(OBJECTS, _FIRST_KEY, _LAST_KEY):
        place, object_id = RecordPlace(*space_of(key), Location(bytes(value))), object_of_key(key)
        home = wanted_place(object_id)
        if place.location != home and _is_at(transaction, *place, object_id):
            yield Displaced(Spot(place, object_id), home)


def _is_at(transaction: ReadTransaction, scene: SceneId, space: SpaceId, location: Location, object_id: bytes) -> bool:
    return transaction.get(RECORDS, record_key(RecordPlace(scene, space, location), object_id)) is not None

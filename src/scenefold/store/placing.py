"""Where a node-managed record lies: the node's choice (thesis B.3; specs/10-store.md, Node-managed spaces).

An object id is random, so the id itself, read as a place, spreads objects evenly over the line, and whoever looks for
a node for a new object finds the same one at every try. The node takes that place if it owns it, else one that
the id picks within its arc. The table of objects says where each was put, so that a retry changes nothing, and whoever
knows an old place of an object that has slid on since still reaches it here.
"""

from __future__ import annotations

from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Arc, Location
from scenefold.crypto import RecordPlace, wanted_place
from scenefold.store.layout import OBJECTS, OBJECTS_END, RECORDS, object_key, record_key
from scenefold.world.ports import ReadTransaction

STEPS_MAX = 64
"""Places tried. If all are taken, two objects share one: their keys differ all the same."""


def known_place(transaction: ReadTransaction, scene: SceneId, space: SpaceId, object_id: bytes) -> Location | None:
    """Where this node put an object, if it is still there."""
    value = transaction.get(OBJECTS, object_key(scene, space, object_id))
    if value is None:
        return None
    location = Location(bytes(value))
    present = transaction.get(RECORDS, record_key(RecordPlace(scene, space, location), object_id))
    return None if present is None else location


def place_in_arc(transaction: ReadTransaction, arc: Arc | None, scene: SceneId, space: SpaceId, object_id: bytes) -> Location | None:
    """Where this node has an object in its arc; None if it has not, or if there is no object (b"")."""
    known = known_place(transaction, scene, space, object_id) if object_id and arc is not None else None
    return known if known is not None and arc is not None and known in arc else None


def free_place(transaction: ReadTransaction, scene: SceneId, space: SpaceId, object_id: bytes, arc: Arc) -> Location:
    """A place in the arc where nothing of this space lies; found in one look but for rare chances."""
    wanted = wanted_place(object_id)
    start = wanted.number if wanted in arc else arc.first.number + wanted.number % arc.length
    place = start
    for step in range(min(STEPS_MAX, arc.length)):
        place = arc.first.number + (start - arc.first.number + step) % arc.length
        key = record_key(RecordPlace(scene, space, Location.from_number(place)))
        if next(transaction.keys(RECORDS, key, key + OBJECTS_END), None) is None:
            break
    return Location.from_number(place)

"""Ids of node-managed records (thesis B.3; specs/04-records.md, Record; specs/10-store.md, Node-managed spaces).

Such a record is known by a random id of 128 bits, since its place on the line is the node's to choose and to change.
The writer signs the id where other headers have their location; whoever looks for a node for a new object
takes the owner of the place that the id, read as the beginning of a location, names: so every try finds the same one.
"""

from __future__ import annotations

from scenefold.base.location import LOCATION_BYTES, Location
from scenefold.crypto.record_header import PLACED_BY_NODE, RecordHeader

OBJECT_BYTES = 16
_ZEROS = bytes(LOCATION_BYTES - OBJECT_BYTES)


def signed_place(object_id: bytes) -> Location:
    """What stands in the header, and in a request that lets the node choose."""
    return Location(_ZEROS + object_id)


def wanted_place(object_id: bytes) -> Location:
    """The place on the line that an object has if its node owns it and it is free."""
    return Location(object_id + _ZEROS)


def object_of(header: RecordHeader) -> bytes:
    """The object id of a node-managed record; b"" of any other."""
    return bytes(header.location[-OBJECT_BYTES:]) if header.placement == PLACED_BY_NODE else b""

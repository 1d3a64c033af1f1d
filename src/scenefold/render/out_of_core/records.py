"""A scene's records in a file: written by the process that imports, read by the one that renders.

Each is framed by the number of its space, its location and its length: u32, 20 bytes, u32, little endian.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from scenefold.base.ids import SpaceId
from scenefold.base.location import LOCATION_BYTES, Location
from scenefold.render.out_of_core.spill import SpillFile
from scenefold.scene.importers import ImportPlan

_HEAD = struct.Struct(f"<I{LOCATION_BYTES}sI")
_STEP_BYTES = 1 << 22


def write_records(plan: ImportPlan, file: SpillFile) -> None:
    """All records of an import, one behind the other. What finds its place taken takes the next free one."""
    taken: set[tuple[SpaceId, Location]] = set()
    pieces: list[bytes] = []
    waiting = 0
    for phase in plan.phases():
        for item in phase:
            place: Location | None = item.location
            while place is not None and (item.space, place) in taken:
                place = place.next()
            assert place is not None
            taken.add((item.space, place))
            if place != item.location:
                plan.moved(item, place)
            pieces += (_HEAD.pack(item.space, place, len(item.payload)), item.payload)
            waiting += len(item.payload)
            if waiting > _STEP_BYTES:
                file.append(b"".join(pieces))
                pieces, waiting = [], 0
    file.append(b"".join(pieces))


class RecordsOnDisk:
    """A `SceneReader` over such a file."""

    def __init__(self, file: SpillFile, size: int) -> None:
        self._file = file
        self._places: dict[tuple[int, Location], tuple[int, int]] = {}
        at = 0
        while at < size:
            space, place, length = _HEAD.unpack(file.read_at(at, _HEAD.size))
            at += _HEAD.size
            self._places[space, Location(place)] = at, length
            at += length
        assert at == size, "records are cut off"

    async def get_many(self, space: SpaceId, locations: Sequence[Location]) -> list[bytes | None]:
        """See `SceneReader`."""
        return [self._read(space, location) for location in locations]

    def _read(self, space: SpaceId, location: Location) -> bytes | None:
        place = self._places.get((space, location))
        return None if place is None else self._file.read_at(*place)

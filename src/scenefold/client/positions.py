"""From positions in the world to records and back, by what a scene's log says (specs/16-scene-log.md, Boxes).

A box is carried back through the log's transforms, cut into a bounded number of arcs of the line, and each arc is asked for.
Arcs hold more than the box does; what lies in no cell of the box is left out here, but for records that may have wanted a
place in one and found it taken: the run of occupied locations behind is followed, beyond an arc's end too.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import aclosing
from dataclasses import replace
from typing import NamedTuple

from scenefold.base.ids import SpaceId
from scenefold.base.limits import CLIENT_BOX_ARCS
from scenefold.base.location import Location
from scenefold.client.access import SceneAccess
from scenefold.client.living import alive
from scenefold.client.runs import STEPS_MAX, Run, run_behind
from scenefold.client.wholes import wholes
from scenefold.scene.layout import DOCUMENT_LOCATION, GEOMETRY, META
from scenefold.scene.log import CellBox, LoggedSpace

_BATCH = 1_024
"""Locations that are looked at together."""


class Found(NamedTuple):
    """A record of a box, and where the centre of the cell that it lies in is in the world now."""

    location: Location
    position: tuple[float, ...]


async def logged_spaces(access: SceneAccess) -> list[LoggedSpace]:
    """All spaces by the newest log; as `logged_space` gives them."""
    spaces = (await access.read_log()).state.spaces.values()
    return [await _with_lattice_of_import(access, space) if space.id == GEOMETRY else space for space in spaces]


async def logged_space(access: SceneAccess, space: SpaceId) -> LoggedSpace:
    """A space by the newest log. The geometry of an import lies in the lattice that the scene document names."""
    found = (await access.read_log()).state.space(space)
    return await _with_lattice_of_import(access, found) if space == GEOMETRY else found


async def found_in_box(
    access: SceneAccess, space: LoggedSpace, low: Sequence[float], high: Sequence[float], *, deleted: bool = False
) -> AsyncIterator[Found]:
    """See `Space.query_box`."""
    occupied = _occupied(access, space, space.cell_box(low, high))
    kept = occupied if deleted else alive(access, occupied, lambda location: (space.id, location))
    async for batch in _batches(kept):
        positions = await access.in_crypto_lane(space.world_of, batch)
        for location, position in zip(batch, positions.tolist(), strict=True):
            yield Found(location, tuple(position))


async def _occupied(access: SceneAccess, space: LoggedSpace, box: CellBox) -> AsyncIterator[Location]:
    """The locations that hold records of the box, in the order of the line; what a run brings beyond the line's end comes last."""
    run = Run()
    head: set[Location] = set()
    arcs = await access.in_crypto_lane(space.arcs_of, box, CLIENT_BOX_ARCS)
    for arc, following in zip(arcs, [*arcs[1:], None], strict=True):
        async for batch in _batches(access.locations(space.id, arc.first, arc.last)):
            insides = await access.in_crypto_lane(space.in_cells, batch, box)
            for location, inside in zip(batch, insides.tolist(), strict=True):
                if run.keeps(location, inside):
                    if location.number < STEPS_MAX:
                        head.add(location)
                    yield location
        if run.last != arc.last:
            continue
        async with aclosing(run_behind(access, space.id, arc.last)) as behind:
            async for location in behind:
                # In the next arc it is met anyway; behind the line's end, where the first arc has been, it is known already.
                if (following is not None and location == following.first) or location in head:
                    break
                if not run.keeps(location, inside=False):
                    break
                yield location


async def _batches(locations: AsyncIterator[Location]) -> AsyncIterator[list[Location]]:
    batch: list[Location] = []
    async for location in locations:
        batch.append(location)
        if len(batch) == _BATCH:
            yield batch
            batch = []
    if batch:
        yield batch


async def _with_lattice_of_import(access: SceneAccess, space: LoggedSpace) -> LoggedSpace:
    from scenefold.scene.payloads.document import decode_document

    key = META, DOCUMENT_LOCATION
    (found,) = await wholes(await access.get([key]), [key], access.get, access.in_crypto_lane)
    if found is None or found.deleted:
        return space
    document = decode_document(found.payload)
    return replace(space, low=tuple(document.lattice_low.tolist()), high=tuple(document.lattice_high.tolist()))

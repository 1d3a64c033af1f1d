"""A space of a scene: records by location and by position in the world, as the user of the client sees them.

Positions mean what the scene's log says: each call that speaks of them reads the newest log first (scene_log.py), so a
space that somebody else moved a moment ago is asked where it is now.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterable, Sequence
from functools import partial

from scenefold.base.ids import SpaceId
from scenefold.base.limits import CLIENT_FRAME_BYTES, CLIENT_FRAMES_IN_FLIGHT
from scenefold.base.location import FIRST, LAST, Location
from scenefold.client.access import SceneAccess
from scenefold.client.any_copy import any_copies
from scenefold.client.copies import CopiesPlan, is_so_already, new_copies
from scenefold.client.fresh import FreshItem, put_fresh
from scenefold.client.living import alive
from scenefold.client.managed import ManagedPlace, ManagedRecords
from scenefold.client.positions import Found, found_in_box, logged_space
from scenefold.client.progress import ProgressCallback, ProgressState, callback_of
from scenefold.client.rebasing import Carried, Rebased, carried, rebase
from scenefold.client.requests import Again, request_in
from scenefold.client.sealing import Opened, payload_of
from scenefold.client.splitting import Shape, SplitReport, merge, remove_record, split
from scenefold.client.steps import checked_factor, checked_offset, movable
from scenefold.client.tidying import Tidied, tidy
from scenefold.client.verifying import Key
from scenefold.client.wholes import wholes
from scenefold.client.wishes import Wish
from scenefold.crypto import EXPECTS_NOTHING
from scenefold.scene.log import LoggedSpace
from scenefold.scene.payloads.carrying import Carry
from scenefold.scene.payloads.splits import Cut
from scenefold.wire import ScaleSpace, TranslateSpace

ABSENT = EXPECTS_NOTHING
"""As `expect`: the place must be empty."""

_BATCH_BYTES = CLIENT_FRAME_BYTES * CLIENT_FRAMES_IN_FLIGHT
_GET_BATCH = _COUNTED_AT_A_TIME = 4096


class Space:
    """Records of one space. Payloads are bytes of up to 60 KiB; they are encrypted before they leave this process."""

    def __init__(self, access: SceneAccess, space_id: SpaceId, *, made: LoggedSpace | None = None) -> None:
        self.id = space_id
        self._access = access
        self.made = made
        """As the log described it when it was made, of what `create_space` returns. `info` asks how it is now."""

    async def put(self, location: Location, payload: bytes, *, expect: bytes | None = None) -> bytes:
        """Store a record; durable when this returns. Gives the digest that a later `expect` may name.

        `expect`: None replaces whatever is there, ABSENT wants the place empty, a digest wants that very version
        there. Refused with STALE_VERSION if it is not so.
        """
        return (await self._access.put_one(Wish(self.id, location, payload, expect))).digest

    async def put_many(self, items: Iterable[tuple[Location, bytes]]) -> None:
        """Store many records, replacing what is there; all are durable when this returns.

        In parallel to all owners; of several payloads for one place the last one stays. If it raises, some may be stored: putting them again is safe.
        """
        batch: dict[Location, Wish] = {}
        size = 0
        for location, payload in items:
            # Frames of one call overtake each other, so each place is in it once: the last of its payloads counts.
            batch[location] = Wish(self.id, location, payload)
            size += len(payload)
            if size >= _BATCH_BYTES:
                await self._access.put(list(batch.values()))
                batch, size = {}, 0
        if batch:
            await self._access.put(list(batch.values()))

    async def put_fresh(self, items: Sequence[tuple[Location, bytes]]) -> list[Location]:
        """Store records at free places, at the wanted ones or next along the line; gives where they are."""
        fresh = [FreshItem(self.id, location, payload) for location, payload in items]
        return [stored.location for stored in await put_fresh(self._access, fresh)]

    async def delete(self, location: Location, *, expect: bytes | None = None) -> bytes:
        """Replace a record by one that says that nothing lies here; `get` gives None from then on. Gives its digest.

        `expect` as in `put`. What says so stays in its place; lists leave it out. So do parts of a split record: `remove` takes them along.
        """
        return await self.put(location, self._access.tombstone((self.id, location)), expect=expect)

    async def get(self, location: Location, *, stale_ok: bool = False, any_copy: bool = False) -> bytes | None:
        """The payload at a location, verified; None if the owner says that nothing is there, or it was deleted.

        An owner that may have been replaced without knowing is asked again for a while, then Refused with NOT_READY;
        with `stale_ok` its answer counts. `any_copy`: any one node's word counts, if it is not older than what this client has met.
        """
        return (await self.get_many([location], stale_ok=stale_ok, any_copy=any_copy))[0]

    async def get_many(self, locations: Sequence[Location], *, stale_ok: bool = False, any_copy: bool = False) -> list[bytes | None]:
        """The payloads at many locations, in their order, fetched in parallel from all owners."""
        payloads: list[bytes | None] = []
        read = partial(any_copies, self._access) if any_copy else partial(self._access.get, stale_ok=stale_ok)
        for start in range(0, len(locations), _GET_BATCH):
            keys: list[Key] = [(self.id, location) for location in locations[start : start + _GET_BATCH]]
            payloads += map(payload_of, await wholes(await read(keys), keys, read, self._access.in_crypto_lane))
        return payloads

    async def read(self, locations: Sequence[Location]) -> list[Opened | None]:
        """Like `get_many`, with the version: its digest, and the log position that coordinates in the payload belong to.

        `info().fast_forward(positions, content_position)` carries such coordinates on to now.
        """
        keys: list[Key] = [(self.id, location) for location in locations]
        return await wholes(await self._access.get(keys), keys, self._access.get, self._access.in_crypto_lane)

    async def remove(self, location: Location) -> bool:
        """Delete the very record that lies there now, if it is split with its parts; False if there is none. Refused if somebody replaces it meanwhile."""
        return await remove_record(self._access, self.id, location)

    def query(self, first: Location = FIRST, last: Location = LAST, *, deleted: bool = False) -> AsyncIterator[Location]:
        """Locations that hold records, from `first` to `last`, both included, in the order of the line.

        `deleted`: those of deleted records, and of parts of split ones, too. That is faster, since only who reads a record can tell.
        """
        return self._access.locations(self.id, first, last) if deleted else self._living(first, last)

    async def _living(self, first: Location, last: Location) -> AsyncIterator[Location]:
        async for location, _ in alive(self._access, self._access.entries(self.id, first, last), self._key):
            yield location

    def _key(self, entry: tuple[Location, bytes]) -> Key:
        location, object_id = entry
        # In a node-managed space a record is read by its object: nobody could verify it as one of this place.
        return (self.id, location, object_id) if object_id else (self.id, location)

    @property
    def managed(self) -> ManagedRecords:
        """The records of a node-managed space: the node that stores one chooses its place."""
        return ManagedRecords(self._access, self.id)

    async def put_managed(self, payload: bytes) -> ManagedPlace:
        """Store a new record in a node-managed space; gives its location and object id. `managed` does the rest."""
        return (await self.managed.put(payload)).place

    # -------------------------------------------------------------------------------------------- parts of records

    async def split(self, location: Location, parts: int = 2, *, cut: Cut | None = None, dry_run: bool = False) -> SplitReport:
        """Break a record into parts that lie elsewhere in the space; it is found and read where it was, as it was. Edit mode only.

        A geometry atom is cut by its triangles, each part near the middle of its own; anything else by bytes, scattered; `cut` says otherwise.
        What is split so already stays as it is, and an interrupted call is gone on with by calling again. `dry_run`: only say where the parts
        would want to lie. LocalFault if there is no record, or it is too small, or we may not write; Refused in render mode.
        """
        return await split(self._access, self.id, location, Shape(parts, cut), dry_run=dry_run)

    async def merge(self, location: Location) -> SplitReport:
        """Put a split record together again, in its place; the parts go. What is whole stays as it is. DamagedData if a part is missing."""
        return await merge(self._access, self.id, location)

    async def tidy(
        self,
        *,
        orphans: bool = False,
        dry_run: bool = False,
        progress: ProgressCallback | bool = False,
        bytes_per_s: float | None = None,
    ) -> Tidied:
        """Remove what ended splittings and merges have left: parts that no record names. Reads all of the space.

        Somebody who splits a record in this moment begins anew. `orphans`: also parts whose record is not there at all.
        """
        tell = callback_of(progress)
        return await tidy(self._access, self.id, orphans=orphans, dry_run=dry_run, progress=tell, bytes_per_s=bytes_per_s)

    # ------------------------------------------------------------------------------------------- the world around

    async def carried(self, locations: Sequence[Location], carry: Carry, *, write_back: bool = False) -> list[Carried]:
        """The payloads with coordinates as they are now. `carry(payload, since)` gives one as it is after an `Affine`, None if it knows no way.

        It runs in a worker thread. `write_back`: what was carried on also replaces the record that was read, in edit mode, if nobody else has
        by then; LocalFault if we may not write. `payloads.carrying.carrier` has functions for atoms, and for rows of floats.
        """
        return await carried(self._access, self.id, locations, carry, write_back=write_back)

    async def rebase(
        self, carry: Carry, *, dry_run: bool = False, progress: ProgressCallback | bool = False, bytes_per_s: float | None = None
    ) -> Rebased:
        """Write all records anew whose coordinates are from before a step of the space; `carry` as in `carried`. Edit mode only.

        May be interrupted, and called again: what is done is not done twice.
        """
        return await rebase(self._access, self.id, carry, dry_run=dry_run, progress=callback_of(progress), bytes_per_s=bytes_per_s)

    async def info(self) -> LoggedSpace:
        """The space as the scene's log describes it now: dimensions, box, transforms; maps locations to positions."""
        return await logged_space(self._access, self.id)

    async def translate(self, offset: Sequence[float], *, again: Again = None) -> LoggedSpace:
        """Move the space: from now on its addresses mean places that lie by `offset` further. No record is moved.

        Gives the space as it is then. LocalFault for an offset of another number of coordinates, or not finite. `again`: see `Change`.
        """
        by = checked_offset(offset, self.id)
        log = await self._access.change_log(lambda log: TranslateSpace(movable(log, self.id), by), again=again)
        return log.state.space(self.id)

    async def scale(self, factor: float, *, again: Again = None) -> LoggedSpace:
        """Scale the space about the world's origin, along all axes alike; `factor` > 0. No record is moved. `again`: see `Change`."""
        by = checked_factor(factor, self.id)
        log = await self._access.change_log(lambda log: ScaleSpace(movable(log, self.id), by), again=again)
        return log.state.space(self.id)

    async def set_copies(self, copies: int, copies_min: int | None = None, *, again: Again = None) -> LoggedSpace:
        """Say how many nodes shall hold each record from now on, 1 to 8, and how many must before a write counts as done. An owner's to do.

        What is there already is copied, or copies of it go, in the background, and can be read and written meanwhile. The shadows that this
        takes are made. `copies_min` None: as it was, or 2 where there was one copy, or `copies` if that is less. Gives the space as it is
        then. LocalFault for a shadow, and for numbers that cannot be. `again`: see `Change`.
        """
        change = new_copies(self.id, copies, copies_min)
        log, request = await self._access.read_log(), request_in(again)
        is_there = request is not None and request.id in log.state.requests
        if is_there or not is_so_already(change(log.state), log.state):
            log = await self._access.change_log(change, again=again)
        return log.state.space(self.id)

    async def plan_copies(self, copies: int, copies_min: int | None = None, progress: ProgressCallback | bool = False) -> CopiesPlan:
        """What `set_copies` would change, and how many records that is about. Lists the space, and changes nothing."""
        change, tell = new_copies(self.id, copies, copies_min), callback_of(progress)
        log = await self._access.read_log()
        entry = change(log.state)
        await self._access.log_or_fault().owner()
        records = 0
        async for _ in self._access.entries(self.id, FIRST, LAST):
            records += 1
            if records % _COUNTED_AT_A_TIME == 0:
                tell(ProgressState("count", records, None, "records"))
        await self._access.calls.refresh()
        return CopiesPlan.of(entry, log.state, records, len(self._access.calls.table.owners))

    async def put_at(self, position: Sequence[float], payload: bytes) -> Location:
        """Store a record at a position in the world, or the next free place along the line; gives its location.

        A record with the same payload that lies there already is kept in its stead, so that this may be repeated.
        LocalFault for a position outside of the space.
        """
        return (await self.put_all_at([(position, payload)]))[0]

    async def put_all_at(self, items: Sequence[tuple[Sequence[float], bytes]]) -> list[Location]:
        """`put_at` for many records at once; nothing is stored if one of the positions lies outside."""
        if not items:
            return []
        space = await self.info()
        wanted = await self._access.in_crypto_lane(space.locations_of, [position for position, _ in items])
        return await self.put_fresh([(location, payload) for location, (_, payload) in zip(wanted, items, strict=True)])

    async def query_box(self, low: Sequence[float], high: Sequence[float], *, deleted: bool = False) -> AsyncIterator[Found]:
        """Records put at positions in the box low..high of the world: location and position. `deleted`: deleted ones, too.

        None is missing that was put before. A record that found its place taken lies next along the line; since nobody can tell
        from there what it wanted, whatever lies behind a record of the box without a gap is given, too, with the position of
        the cell that it lies in. Look at what a payload says where the edge matters.
        SpaceFault for a box that is none, or that lies outside of the space.
        """
        async for found in found_in_box(self._access, await self.info(), low, high, deleted=deleted):
            yield found

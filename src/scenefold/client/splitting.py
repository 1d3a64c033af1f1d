"""A record of a space broken into parts that lie elsewhere, and put together again (thesis B.3.5; specs/18-data.md, Splitting and merging).

    split   the parts, durable, at free places  |  then the entry point, expecting the record that was read
    merge   the whole in the place of the entry point, expecting it  |  then the parts go

One edit of one record decides which of the two is there. Whatever comes in between, the other one can be read, and whoever asks for
the same again goes on: parts follow from the version of the record that they are made from, and lie there already.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from scenefold.base.errors import DamagedData, LocalFault, Refused, UsageFault
from scenefold.base.ids import SpaceId
from scenefold.base.limits import CLIENT_TRIES_MAX, PAYLOAD_BYTES_MAX
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.client.editable import editable
from scenefold.client.fresh import FreshItem, put_fresh
from scenefold.client.leftovers import remove_leftovers
from scenefold.client.part_places import Pieces, places_wanted
from scenefold.client.sealing import Opened
from scenefold.client.verifying import Key
from scenefold.client.wholes import wholes
from scenefold.client.wishes import Wish
from scenefold.scene.log import LoggedSpace
from scenefold.scene.payloads.atom_cuts import is_atom, triangles_of
from scenefold.scene.payloads.splits import (
    PARTS_MAX,
    PARTS_MIN,
    Cut,
    Part,
    SplitEntry,
    contents_of,
    decode_entry,
    encode_entry,
    encode_part,
    is_part,
    is_split,
    whole_of,
)

_STORED = 0


@dataclass(frozen=True, slots=True)
class SplitReport:
    """What became of a record. `parts`: where they lie, or lay; `changed`: whether anything had to be done."""

    space: SpaceId
    location: Location
    bytes: int
    cut: Cut | None
    parts: tuple[Location, ...]
    changed: bool
    is_dry: bool = False

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "space": self.space,
            "location": self.location.hex(),
            "bytes": self.bytes,
            "cut": None if self.cut is None else self.cut.name.lower(),
            "parts": [part.hex() for part in self.parts],
            "changed": self.changed,
            "dry_run": self.is_dry,
        }


@dataclass(frozen=True, slots=True)
class Shape:
    """Into how many parts a record is cut, and how; `cut` None: an atom by its triangles, anything else by its bytes."""

    count: int = PARTS_MIN
    cut: Cut | None = None

    def checked(self) -> Shape:
        """UsageFault if there are no such parts."""
        if not PARTS_MIN <= self.count <= PARTS_MAX:
            what = f"a record is split into {PARTS_MIN} to {PARTS_MAX} parts, not {self.count}"
            raise UsageFault(what, where="parts", remedy="choose another number")
        return self

    def cut_of(self, payload: bytes, where: str) -> Cut:
        """How this payload is cut; LocalFault if it is too small, or none that can be cut so, DamagedData for an atom that is none."""
        cut = self.cut if self.cut is not None else Cut.TRIANGLES if is_atom(payload) else Cut.BYTES
        if cut is Cut.TRIANGLES and not is_atom(payload):
            raise LocalFault("the record is no geometry atom, and has no triangles", where=where, remedy="split it by bytes")
        try:
            size, unit = (triangles_of(payload), "triangles") if cut is Cut.TRIANGLES else (len(payload), "bytes")
        except DamagedData as damage:
            raise DamagedData(damage.what, where=where, remedy="write it anew, or split it by bytes") from damage
        if size < self.count:
            what = f"the record is too small to split: {size} {unit} make no {self.count} parts"
            raise LocalFault(what, where=where, remedy="ask for fewer parts" if size >= PARTS_MIN else "leave it whole")
        return cut


async def split(access: SceneAccess, space: SpaceId, location: Location, shape: Shape, *, dry_run: bool = False) -> SplitReport:
    """See `Space.split`."""
    shape.checked()
    logged = (await editable(access, space, "split a record of"))[1]
    key, where = (space, location), _where(access, space, location)
    for _ in range(CLIENT_TRIES_MAX):
        found = await record_at(access, key)
        if is_split(found.payload):
            return await _split_already(access, key, found, shape)
        cut = await access.in_crypto_lane(shape.cut_of, found.payload, where)
        cutting = _Cutting(access, logged, location, cut, shape.count)
        if dry_run:
            places = tuple((await cutting.wanted(found, found.payload, found.content_position))[0])
            return SplitReport(space, location, len(found.payload), cut, places, changed=False, is_dry=True)
        stored = await cutting.stored(found, found.payload, found.content_position)
        if await cutting.put_entry(found, found.payload, stored, found.content_position):
            return SplitReport(space, location, len(found.payload), cut, stored.places, changed=True)
        await remove_leftovers(access, space, stored.places)
    raise _overtaken(where)


async def merge(access: SceneAccess, space: SpaceId, location: Location) -> SplitReport:
    """See `Space.merge`."""
    await editable(access, space, "merge a record of")
    key = space, location
    for _ in range(CLIENT_TRIES_MAX):
        found = await record_at(access, key)
        if not is_split(found.payload):
            return SplitReport(space, location, len(found.payload), None, (), changed=False)
        whole = await read_whole(access, key, found)
        if whole is None:
            continue
        entry = decode_entry(found.payload)
        (placed,) = await access.put([Wish(space, location, whole, found.digest, found.content_position)])
        if placed.reason == _STORED:
            places = tuple(part.location for part in entry.parts)
            await remove_leftovers(access, space, places)
            return SplitReport(space, location, len(whole), entry.cut, places, changed=True)
    raise _overtaken(_where(access, space, location))


async def remove_record(access: SceneAccess, space: SpaceId, location: Location) -> bool:
    """See `Space.remove`."""
    key = space, location
    (found,) = await access.get([key])
    if found is None or found.deleted:
        return False
    await access.put_one(Wish(space, location, access.tombstone(key), found.digest))
    if is_split(found.payload):
        await remove_leftovers(access, space, [part.location for part in decode_entry(found.payload).parts])
    return True


async def replace_whole(
    access: SceneAccess, space: LoggedSpace, location: Location, found: Opened, whole: bytes, content_position: int
) -> bool:
    """Put another whole payload in the place of a split record, cut as before; False if somebody wrote there meanwhile."""
    entry = decode_entry(found.payload)
    cutting = _Cutting(access, space, location, entry.cut, len(entry.parts))
    stored = await cutting.stored(found, whole, content_position)
    is_put = await cutting.put_entry(found, whole, stored, content_position)
    await remove_leftovers(access, space.id, [part.location for part in entry.parts] if is_put else stored.places)
    return is_put


async def read_whole(access: SceneAccess, key: Key, found: Opened) -> bytes | None:
    """What a split record holds; None if it is another record by now. DamagedData if a part is missing."""
    (whole,) = await wholes([found], [key], access.get, access.in_crypto_lane)
    return None if whole is None or whole.version != found.version else whole.payload


async def record_at(access: SceneAccess, key: Key) -> Opened:
    """The record as it lies there; LocalFault if there is none, or it is a part of another one."""
    (found,) = await access.get([key])
    where = _where(access, key[0], key[1])
    if found is None or found.deleted:
        raise LocalFault("there is no record", where=where, remedy="`scenectl data ls` lists those that are there")
    if is_part(found.payload):
        raise LocalFault("this is a part of a split record", where=where, remedy="name the record by its own location")
    return found


@dataclass(frozen=True, slots=True)
class _Stored:
    """Parts that are durable, and where."""

    places: tuple[Location, ...]
    payloads: Sequence[bytes]


class _Cutting:
    """One record and how it is to be cut. Below, `base`: the version at its location that the parts are made from; `position`: the log position
    that the coordinates in `whole` belong to."""

    def __init__(self, access: SceneAccess, space: LoggedSpace, location: Location, cut: Cut, count: int) -> None:
        self._access = access
        self._space = space
        self._location = location
        self._cut = cut
        self._count = count

    async def wanted(self, base: Opened, whole: bytes, position: int) -> tuple[list[Location], list[bytes]]:
        """Where the parts want to lie, and their payloads. LocalFault if one does not fit a record."""
        contents = await self._access.in_crypto_lane(contents_of, whole, self._cut, self._count)
        payloads = [self._part(base, number, content) for number, content in enumerate(contents)]
        if max(map(len, payloads)) > PAYLOAD_BYTES_MAX:
            where, remedy = _where(self._access, self._space.id, self._location), "ask for more parts, or split it by bytes"
            raise LocalFault("a part of the record would not fit a record", where=where, remedy=remedy)
        pieces = Pieces(self._location, base.digest, self._cut, contents, position)
        return await places_wanted(self._access, self._space, pieces), payloads

    async def stored(self, base: Opened, whole: bytes, position: int) -> _Stored:
        """Put the parts at free places; those that lie there already are kept."""
        wanted, payloads = await self.wanted(base, whole, position)
        items = [FreshItem(self._space.id, place, payload, position) for place, payload in zip(wanted, payloads, strict=True)]
        stored = await put_fresh(self._access, items)
        return _Stored(tuple(one.location for one in stored), payloads)

    async def put_entry(self, base: Opened, whole: bytes, stored: _Stored, position: int) -> bool:
        """Put the entry point of these parts in the place of `base`; False if another version lies there."""
        entry = SplitEntry.of(self._cut, whole, stored.places, stored.payloads)
        # Nobody is to find out later that they do not fit together.
        made = await self._access.in_crypto_lane(whole_of, entry, self._location, stored.payloads)
        assert made == whole
        wish = Wish(self._space.id, self._location, encode_entry(entry), base.digest, position)
        (placed,) = await self._access.put([wish])
        return placed.reason == _STORED

    def _part(self, base: Opened, number: int, content: bytes) -> bytes:
        genesis = self._access.identity.genesis
        return encode_part(Part(self._cut, number, self._count, self._location, genesis, base.version, content))


async def _split_already(access: SceneAccess, key: Key, found: Opened, shape: Shape) -> SplitReport:
    """That of a record that is split as it is to be; LocalFault if it is split otherwise, DamagedData if a part is missing."""
    entry = decode_entry(found.payload)
    if len(entry.parts) != shape.count or shape.cut not in (None, entry.cut):
        what = f"the record is split already, into {len(entry.parts)} parts by {entry.cut.name.lower()}"
        raise LocalFault(what, where=_where(access, key[0], key[1]), remedy="merge it first")
    await read_whole(access, key, found)
    return SplitReport(key[0], key[1], entry.length, entry.cut, tuple(part.location for part in entry.parts), changed=False)


def _overtaken(where: str) -> Refused:
    return Refused(RejectReason.BUSY, "somebody else writes there all the time", where=where, remedy="try again")


def _where(access: SceneAccess, space: SpaceId, location: Location) -> str:
    return f"scene {access.name}, space {space}, {location.hex()}"

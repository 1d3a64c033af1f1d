"""Bytes of any size under a name, in a node-managed space of a scene (specs/35-kept-images.md).

A blob's head is a record whose id follows from its name; the head names a generation, and that, with an index, the ids of the parts. So
who replaces a blob writes new parts beside the old ones, then the head, and readers have the one or the other, and never some of both.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from scenefold.base.errors import DamagedData, LocalFault, Refused
from scenefold.base.ids import SpaceId
from scenefold.base.limits import PAYLOAD_BYTES_MAX
from scenefold.base.names import is_name, name_rule
from scenefold.base.plain_values import exactly, text, whole
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.client.verifying import Key
from scenefold.client.wishes import Wish
from scenefold.crypto import EXPECTS_NOTHING, OBJECT_BYTES, signed_place
from scenefold.wire import Value, pack_value, unpack_value

BLOB_BYTES_MAX = 4 << 30
PART_BYTES = PAYLOAD_BYTES_MAX
PARTS_AT_ONCE = 128
"""Some 8 MB are sealed, sent or fetched together."""
BLOBS_MAX = 512
"""Of a kind in a scene: all of their names stand in one record."""
READS_MAX = 4
"""So often a blob is read that somebody replaces at that moment."""
CHANGES_MAX = 16
"""So often the list of names is changed anew that somebody else changes at that moment."""
_GENERATION_BYTES = 16
_DIGEST_BYTES = 32


class Parts(NamedTuple):
    """Where a blob's bytes lie: part i of a generation has an id of its own."""

    generation: bytes
    pieces: int


@dataclass(frozen=True, slots=True)
class Blob:
    """A blob's head."""

    name: str
    size: int
    sha256: bytes
    parts: Parts
    about: Mapping[str, Value]
    """What whoever wrote it says of it."""


class _Head(NamedTuple):
    """As it lies there. `blob`: None as long as the first one is being written; `unused`: parts of one that is, or of the one before, which may be there; `digest`: of the record."""

    blob: Blob | None
    unused: Parts | None
    digest: bytes


class Blobs:
    """Those of one kind in one space."""

    def __init__(self, access: SceneAccess, space: SpaceId, kind: str) -> None:
        self._access, self._space, self._kind = access, space, kind

    async def names(self) -> list[str]:
        """Of all of them, in order."""
        return (await self._catalogue())[0]

    async def look(self, name: str) -> Blob | None:
        """What there is under a name; None for nothing."""
        head = await self._head(name)
        return None if head is None else head.blob

    async def read(self, name: str, progress: Callable[[int, int], object] = lambda _done, _all: None) -> tuple[Blob, bytes]:
        """LocalFault if there is none of this name; DamagedData if what there is of it is not what was written."""
        for _ in range(READS_MAX):
            blob = await self.look(name)
            if blob is None:
                break
            payload = await self._read_parts(blob, progress)
            if payload is not None:
                return blob, payload
        else:
            raise Refused(RejectReason.BUSY, "it is replaced again and again while it is read", where=name, remedy="try again later")
        raise LocalFault(
            f"there is no {self._kind} of that name in the scene", where=name, remedy="see which there are: scenectl image list"
        )

    async def write(
        self, name: str, payload: bytes, about: Mapping[str, Value], progress: Callable[[int, int], object] = lambda _done, _all: None
    ) -> Blob:
        """In place of what is there. LocalFault if that cannot be; Refused (8) if somebody else writes it at the same time."""
        if not is_name(name):
            raise LocalFault(f"no {self._kind} can be called so", where=name[:80], remedy=f"give {name_rule()}")
        if not 0 < len(payload) <= BLOB_BYTES_MAX:
            raise LocalFault(
                f"{len(payload):,} bytes are no {self._kind} that can be kept", where=name, remedy=f"at most {BLOB_BYTES_MAX:,}"
            )
        before = await self._head(name)
        if before is not None and before.unused is not None:
            # Of whoever was interrupted, or goes on: his head will not be taken any more.
            await self._drop(before.unused)
        await self._enter(name)
        token = self._access.calls.world.entropy.token(_GENERATION_BYTES)
        parts = Parts(token, -(-len(payload) // PART_BYTES))
        old = None if before is None else before.blob
        digest = await self._put_head(name, old, parts, None if before is None else before.digest)
        for first in range(0, parts.pieces, PARTS_AT_ONCE):
            numbers = range(first, min(first + PARTS_AT_ONCE, parts.pieces))
            pieces = [payload[number * PART_BYTES : (number + 1) * PART_BYTES] for number in numbers]
            await self._put_all(list(zip((_part_id(parts, number) for number in numbers), pieces, strict=True)))
            progress(min((first + PARTS_AT_ONCE) * PART_BYTES, len(payload)), len(payload))
        blob = Blob(name, len(payload), hashlib.sha256(payload).digest(), parts, about)
        try:
            await self._put_head(name, blob, None if old is None else old.parts, digest)
        except Refused as refused:
            if refused.reason is RejectReason.STALE_VERSION:
                await self._drop(parts)
            raise
        if old is not None:
            await self._drop(old.parts)
        return blob

    async def remove(self, name: str) -> None:
        """LocalFault if there is none of this name."""
        head = await self._head(name)
        names, _ = await self._catalogue()
        if head is None and name not in names:
            raise LocalFault(
                f"there is no {self._kind} of that name in the scene", where=name, remedy="see which there are: scenectl image list"
            )
        await self._change_catalogue(lambda known: [one for one in known if one != name])
        if head is None:
            return
        await self._put(self._head_id(name), self._access.tombstone(self._key(self._head_id(name))), head.digest)
        for parts in (head.unused, None if head.blob is None else head.blob.parts):
            if parts is not None:
                await self._drop(parts)

    # Records -------------------------------------------------------------------------------------------------

    async def _head(self, name: str) -> _Head | None:
        (found,) = await self._access.get([self._key(self._head_id(name))])
        if found is None or found.deleted:
            return None
        try:
            document = unpack_value(found.payload, what="the head of a blob")
            return _Head(_blob_of(name, document), _parts_of(document["unused"]), found.digest)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise DamagedData(f"the head of the {self._kind} makes no sense", where=name, remedy="remove it, and write it anew") from error

    async def _put_head(self, name: str, blob: Blob | None, unused: Parts | None, replaced: bytes | None) -> bytes:
        document: dict[str, Value] = {"unused": None if unused is None else list(unused)}
        if blob is not None:
            document |= {"bytes": blob.size, "sha256": blob.sha256, "parts": list(blob.parts), "about": dict(blob.about)}
        return await self._put(self._head_id(name), pack_value(document), EXPECTS_NOTHING if replaced is None else replaced)

    async def _read_parts(self, blob: Blob, progress: Callable[[int, int], object]) -> bytes | None:
        """None if they are gone: then there is another head."""
        payload = bytearray()
        for first in range(0, blob.parts.pieces, PARTS_AT_ONCE):
            numbers = range(first, min(first + PARTS_AT_ONCE, blob.parts.pieces))
            found = await self._access.get([self._key(_part_id(blob.parts, number)) for number in numbers])
            for one in found:
                if one is None or one.deleted:
                    return None
                payload += one.payload
            progress(len(payload), blob.size)
        if len(payload) != blob.size or hashlib.sha256(payload).digest() != blob.sha256:
            raise DamagedData(
                f"the parts of the {self._kind} are not those that were written", where=blob.name, remedy="remove it, and write it anew"
            )
        return bytes(payload)

    async def _drop(self, parts: Parts) -> None:
        """Delete those parts that are there: what was never written needs no word that it is deleted."""
        for first in range(0, parts.pieces, PARTS_AT_ONCE):
            ids = [_part_id(parts, number) for number in range(first, min(first + PARTS_AT_ONCE, parts.pieces))]
            found = await self._access.get([self._key(one) for one in ids])
            there = [one for one, record in zip(ids, found, strict=True) if record is not None and not record.deleted]
            await self._put_all([(one, self._access.tombstone(self._key(one))) for one in there])

    async def _put(self, object_id: bytes, payload: bytes, expect: bytes | None) -> bytes:
        wish = Wish(self._space, signed_place(object_id), payload, expect, object=object_id)
        return (await self._access.put_one(wish)).digest

    async def _put_all(self, items: Sequence[tuple[bytes, bytes]]) -> None:
        if items:
            await self._access.put([Wish(self._space, signed_place(one), payload, object=one) for one, payload in items])

    def _key(self, object_id: bytes) -> Key:
        return self._space, signed_place(object_id), object_id

    def _head_id(self, name: str) -> bytes:
        return _id(b"scenefold/" + self._kind.encode() + b"\0" + name.encode())

    # The catalogue -------------------------------------------------------------------------------------------

    async def _catalogue(self) -> tuple[list[str], bytes | None]:
        (found,) = await self._access.get([self._key(self._catalogue_id)])
        if found is None or found.deleted:
            return [], None if found is None else found.digest
        try:
            names = unpack_value(found.payload, what="a catalogue")
            if not isinstance(names, list) or len(names) > BLOBS_MAX:
                raise TypeError("a list of names is expected")
            return [text(name) for name in names], found.digest
        except (TypeError, ValueError) as error:
            what = f"the list of the scene's {self._kind}s makes no sense"
            raise DamagedData(what, where="its renders", remedy="restore it from a copy") from error

    async def _enter(self, name: str) -> None:
        def added(names: list[str]) -> list[str]:
            if name not in names and len(names) >= BLOBS_MAX:
                raise LocalFault(f"the scene has {len(names)} {self._kind}s, and may have no more", where=name, remedy="remove some")
            return sorted({*names, name})

        await self._change_catalogue(added)

    async def _change_catalogue(self, change: Callable[[list[str]], list[str]]) -> None:
        """Whoever else changes it meanwhile is not overwritten."""
        for _ in range(CHANGES_MAX):
            names, digest = await self._catalogue()
            after = change(names)
            if after == names:
                return
            try:
                await self._put(self._catalogue_id, pack_value(list[Value](after)), EXPECTS_NOTHING if digest is None else digest)
            except Refused as refused:
                if refused.reason is not RejectReason.STALE_VERSION:
                    raise
            else:
                return
        raise Refused(RejectReason.BUSY, f"others change the list of the scene's {self._kind}s all the time", remedy="try again later")

    @property
    def _catalogue_id(self) -> bytes:
        return _id(b"scenefold/" + self._kind.encode() + b"s")


def _id(words: bytes) -> bytes:
    return hashlib.sha256(words).digest()[:OBJECT_BYTES]


def _part_id(parts: Parts, number: int) -> bytes:
    return _id(b"scenefold/part" + parts.generation + number.to_bytes(4, "big"))


def _parts_of(row: Any) -> Parts | None:
    if row is None:
        return None
    generation, count = row
    return Parts(exactly(generation, _GENERATION_BYTES), whole(count, 1, -(-BLOB_BYTES_MAX // PART_BYTES)))


def _blob_of(name: str, document: Mapping[str, Any]) -> Blob | None:
    if "parts" not in document:
        return None
    parts, about = _parts_of(document["parts"]), document["about"]
    if parts is None or not isinstance(about, dict):
        raise TypeError("parts, and a map about them, are expected")
    return Blob(name, whole(document["bytes"], 1, BLOB_BYTES_MAX), exactly(document["sha256"], _DIGEST_BYTES), parts, about)

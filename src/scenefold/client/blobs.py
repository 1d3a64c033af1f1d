"""Bytes of any size under a name, in a node-managed space of a scene (specs/35-kept-images.md).

A blob's head is a record whose id follows from its name; the head names a generation, and that, with an index, the ids of the parts. So
who replaces a blob writes new parts beside the old ones, then the head, and readers have the one or the other, and never some of both.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, ScenefoldError
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
PART_MARK = b"\x01"
"""Begins every part: whatever a blob's bytes are, no part says that it is deleted."""
PART_BYTES = PAYLOAD_BYTES_MAX - len(PART_MARK)
PARTS_AT_ONCE = 128
"""Some 8 MB are sealed, sent or fetched together, one batch after the other."""
BLOBS_MAX = 512
"""Of a kind in a scene: all of their names stand in one record."""
UNUSED_MAX = 16
"""Generations of which parts may be there, and which no head names any more. Of more the oldest are forgotten."""
DROPS = 2
"""So often a generation is deleted: who was overtaken may put parts of his until he hears of it."""
TRIES_MAX = 4
"""So often a head is read anew that somebody replaces, or seals anew, at that moment."""
CHANGES_MAX = 16
"""So often the list of names is changed anew that somebody else changes at that moment."""
_GENERATION_BYTES = 16
_DIGEST_BYTES = 32
Progress = Callable[[int, int], object]
"""Called with so many bytes of so many."""


def _unseen(_done: int, _all: int) -> None:
    """Who wants no progress."""


class Parts(NamedTuple):
    """Where a blob's bytes lie: part i of a generation has an id of its own. `drops`: how often they were deleted."""

    generation: bytes
    pieces: int
    drops: int = 0


@dataclass(frozen=True, slots=True)
class Blob:
    """A blob's head."""

    name: str
    size: int
    sha256: bytes
    parts: Parts
    about: Mapping[str, Value]
    """What whoever wrote it says of it."""


@dataclass(frozen=True, slots=True)
class _Head:
    """As it lies there. `blob`: None as long as the first one is being written, or once it is being removed; `digest`: of the record."""

    blob: Blob | None
    unused: tuple[Parts, ...]
    """Parts that may be there, of blobs that are being written, were overtaken, or replaced."""
    turn: bytes
    """Drawn by whoever put it: sealed anew it says the same, and nobody else's does."""
    digest: bytes


class Wreck(DamagedData):
    """A head that makes no sense, of which the record's digest is known."""

    def __init__(self, what: str, digest: bytes, *, where: str, remedy: str) -> None:
        super().__init__(what, where=where, remedy=remedy)
        self.digest = digest


class Blobs:
    """Those of one kind in one space."""

    def __init__(self, access: SceneAccess, space: SpaceId, kind: str) -> None:
        self._access, self._space, self._kind = access, space, kind

    async def names(self) -> list[str]:
        """Of all of them, in order; some may not be whole (`look`)."""
        return (await self._catalogue())[0]

    async def look(self, name: str) -> Blob | None:
        """What there is under a name; None for nothing that is whole. DamagedData if that makes no sense."""
        head = await self._head(self._checked(name))
        return None if head is None else head.blob

    async def read(self, name: str, progress: Progress = _unseen) -> tuple[Blob, bytearray]:
        """LocalFault if there is none of this name; DamagedData if what there is of it is not what was written."""
        before: Parts | None = None
        for _ in range(TRIES_MAX):
            blob = await self.look(name)
            if blob is None:
                raise self._no_such(name)
            payload = await self._read_parts(blob, progress)
            if payload is not None:
                return blob, payload
            if blob.parts == before:
                raise DamagedData(f"parts of the {self._kind} are gone", where=name, remedy="remove it, and write it anew")
            before = blob.parts
        raise Refused(RejectReason.BUSY, "it is replaced again and again while it is read", where=name, remedy="try again later")

    async def write(self, name: str, payload: bytes, about: Mapping[str, Value], progress: Progress = _unseen) -> Blob:
        """In place of what is there. LocalFault if that cannot be; Refused (8) if somebody else writes it at the same time."""
        self._checked(name)
        if not 0 < len(payload) <= BLOB_BYTES_MAX:
            raise LocalFault(
                f"{len(payload):,} bytes are no {self._kind} that can be kept", where=name, remedy=f"at most {BLOB_BYTES_MAX:,}"
            )
        before = await self._head_or_wreck(name)
        await self._enter(name)
        token = self._turn()
        mine = Parts(token, -(-len(payload) // PART_BYTES))
        earlier, old = () if before is None else before.unused, None if before is None else before.blob
        # From now on no head of whoever began before can be taken: only then his parts may go.
        head = await self._put_head(name, _Head(old, _bounded(*earlier, mine), token, b"" if before is None else before.digest))
        for parts in earlier:
            with suppress(ScenefoldError):
                # It stays named as unused: what fails here is done the next time.
                await self._drop(parts)
        await self._put_parts(mine, payload, progress)
        blob = Blob(name, len(payload), await self._sha256(payload), mine, about)
        left = [parts._replace(drops=parts.drops + 1) for parts in earlier]
        await self._replace_own(head, blob, _bounded(*left, *(() if old is None else (old.parts,))))
        with suppress(ScenefoldError):
            # The new one is there. What stays of the old one goes when the next one is written, or this one is removed.
            if old is not None:
                await self._drop(old.parts, is_whole=True)
        # Somebody may have removed the old one meanwhile.
        await self._enter(name)
        return blob

    async def remove(self, name: str) -> None:
        """LocalFault if there is none of this name."""
        head = await self._head_or_wreck(self._checked(name))
        if head is None and name not in await self.names():
            raise self._no_such(name)
        if head is not None:
            unused, blob = head.unused, head.blob
            # As when it is written: nobody's head may be taken any more.
            head = await self._put_head(
                name, _Head(None, _bounded(*unused, *(() if blob is None else (blob.parts,))), self._turn(), head.digest)
            )
            for parts in unused:
                await self._drop(parts)
            if blob is not None:
                await self._drop(blob.parts, is_whole=True)
            await self._put(self._head_id(name), self._access.tombstone(self._key(self._head_id(name))), head.digest)
        await self._change_catalogue(lambda known: [one for one in known if one != name])
        if await self._head_or_wreck(name) is not None:
            await self._enter(name)

    def _turn(self) -> bytes:
        return self._access.calls.world.entropy.token(_GENERATION_BYTES)

    def _checked(self, name: str) -> str:
        if not is_name(name):
            raise LocalFault(f"no {self._kind} can be called so", where=ascii(name)[:80], remedy=f"give {name_rule()}")
        return name

    def _no_such(self, name: str) -> LocalFault:
        return LocalFault(
            f"there is no {self._kind} of that name in the scene", where=name, remedy="see which there are: scenectl image list"
        )

    # Records -------------------------------------------------------------------------------------------------

    async def _head(self, name: str) -> _Head | None:
        """DamagedData if it makes no sense."""
        (found,) = await self._access.get([self._key(self._head_id(name))])
        if found is None or found.deleted:
            return None
        try:
            document = unpack_value(found.payload, what="the head of a blob")
            unused = tuple(_parts_of(row) for row in document["unused"])
            if len(unused) > UNUSED_MAX:
                raise ValueError("a few generations are expected")
            return _Head(_blob_of(name, document), unused, exactly(document["turn"], _GENERATION_BYTES), found.digest)
        except (KeyError, TypeError, ValueError, AttributeError, PeerFault) as error:
            what = f"the head of the {self._kind} makes no sense"
            raise Wreck(what, found.digest, where=name, remedy="remove it, and write it anew") from error

    async def _head_or_wreck(self, name: str) -> _Head | None:
        """For whoever replaces it: of one that makes no sense nothing is known but its record."""
        try:
            return await self._head(name)
        except Wreck as wreck:
            return _Head(None, (), b"", wreck.digest)

    async def _put_head(self, name: str, head: _Head) -> _Head:
        """In place of that record, or of nothing if that is empty; as it lies there now."""
        document: dict[str, Value] = {"unused": [list(parts) for parts in head.unused], "turn": head.turn}
        if head.blob is not None:
            blob = head.blob
            document |= {"bytes": blob.size, "sha256": blob.sha256, "parts": list(blob.parts), "about": dict(blob.about)}
        return replace(head, digest=await self._put(self._head_id(name), pack_value(document), head.digest or EXPECTS_NOTHING))

    async def _replace_own(self, mine: _Head, blob: Blob, unused: tuple[Parts, ...]) -> None:
        """The last head of a write, in place of its first one, which may have been sealed anew. Refused (8) if another one lies there."""
        for _ in range(TRIES_MAX):
            try:
                await self._put_head(blob.name, _Head(blob, unused, mine.turn, mine.digest))
            except Refused as refused:
                if refused.reason is not RejectReason.STALE_VERSION:
                    raise
                now = await self._head_or_wreck(blob.name)
                if now is not None and now.blob == blob:
                    # It was taken, and the answer was lost.
                    return
                if now is None or now.turn != mine.turn:
                    with suppress(ScenefoldError):
                        # Whoever was quicker names them as unused.
                        await self._drop(blob.parts, is_whole=True)
                    raise
                mine = now
            else:
                return
        raise Refused(RejectReason.BUSY, "it is sealed anew again and again while it is written", where=blob.name, remedy="try again later")

    async def _put_parts(self, parts: Parts, payload: bytes, progress: Progress) -> None:
        for first in range(0, parts.pieces, PARTS_AT_ONCE):
            numbers = range(first, min(first + PARTS_AT_ONCE, parts.pieces))
            pieces = [PART_MARK + payload[number * PART_BYTES : (number + 1) * PART_BYTES] for number in numbers]
            await self._put_all([(_part_id(parts, number), piece) for number, piece in zip(numbers, pieces, strict=True)])
            progress(min((first + PARTS_AT_ONCE) * PART_BYTES, len(payload)), len(payload))

    async def _read_parts(self, blob: Blob, progress: Progress) -> bytearray | None:
        """None if some are gone: then there should be another head."""
        payload = bytearray()
        for first in range(0, blob.parts.pieces, PARTS_AT_ONCE):
            numbers = range(first, min(first + PARTS_AT_ONCE, blob.parts.pieces))
            for one in await self._access.get([self._key(_part_id(blob.parts, number)) for number in numbers]):
                if one is None or one.deleted:
                    return None
                payload += one.payload.removeprefix(PART_MARK)
            progress(min(len(payload), blob.size), blob.size)
        if len(payload) != blob.size or await self._sha256(payload) != blob.sha256:
            what = f"the parts of the {self._kind} are not those that were written"
            raise DamagedData(what, where=blob.name, remedy="remove it, and write it anew")
        return payload

    async def _drop(self, parts: Parts, *, is_whole: bool = False) -> None:
        """Delete parts. Of a blob that was never whole they were put batch after batch: behind one whose first part never was there is nothing."""
        for first in range(0, parts.pieces, PARTS_AT_ONCE):
            ids = [_part_id(parts, number) for number in range(first, min(first + PARTS_AT_ONCE, parts.pieces))]
            (there,) = [b""] if is_whole else await self._access.fetch([self._key(ids[0])])
            await self._delete(ids)
            if there is None:
                return

    async def _delete(self, ids: Sequence[bytes]) -> None:
        """All but those of which their owner cannot tell what lies there: they are healed, or lost."""
        try:
            await self._put_all([(one, self._access.tombstone(self._key(one))) for one in ids])
        except Refused as refused:
            if refused.reason is not RejectReason.DAMAGED:
                raise
            if len(ids) > 1:
                for one in ids:
                    await self._delete([one])

    async def _put(self, object_id: bytes, payload: bytes, expect: bytes | None) -> bytes:
        wish = Wish(self._space, signed_place(object_id), payload, expect, object=object_id)
        return (await self._access.put_one(wish)).digest

    async def _put_all(self, items: Sequence[tuple[bytes, bytes]]) -> None:
        await self._access.put([Wish(self._space, signed_place(one), payload, object=one) for one, payload in items])

    async def _sha256(self, payload: bytes | bytearray) -> bytes:
        return await self._access.calls.world.workers.run("crypto", _sha256_of, payload)

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
            if not all(is_name(text(name)) for name in names) or names != sorted({*names}):
                raise ValueError("names in order are expected")
            return names, found.digest
        except (TypeError, ValueError, PeerFault) as error:
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


def _sha256_of(payload: bytes | bytearray) -> bytes:
    return hashlib.sha256(payload).digest()


def _bounded(*unused: Parts) -> tuple[Parts, ...]:
    """Without what was deleted often enough."""
    return tuple(parts for parts in unused if parts.drops < DROPS)[-UNUSED_MAX:]


def _parts_of(row: Any) -> Parts:
    generation, pieces, drops = row
    return Parts(exactly(generation, _GENERATION_BYTES), whole(pieces, 1, -(-BLOB_BYTES_MAX // PART_BYTES)), whole(drops, 0, DROPS))


def _blob_of(name: str, document: Mapping[str, Any]) -> Blob | None:
    if "parts" not in document:
        return None
    parts, about, size = _parts_of(document["parts"]), document["about"], whole(document["bytes"], 1, BLOB_BYTES_MAX)
    if not isinstance(about, dict) or parts.pieces != -(-size // PART_BYTES):
        raise TypeError("as many parts as the bytes need, and a map about them, are expected")
    return Blob(name, size, exactly(document["sha256"], _DIGEST_BYTES), parts, about)

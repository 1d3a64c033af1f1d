"""Records that lie in several parts: the entry point that stays, and the parts (specs/04-records.md, Split records). Pure.

The entry point names each part by its place and the digest of its payload. A part names the entry point, and the version of the record
that it was made from, so that whoever meets it alone can tell whether it is in use, or what an ended splitting left.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise

from scenefold.base.errors import DamagedData
from scenefold.base.limits import PAYLOAD_BYTES_MAX
from scenefold.base.location import LOCATION_BYTES, Location
from scenefold.crypto.record_header import DIGEST_BYTES, GENESIS_BYTES, Version
from scenefold.scene.payloads.atom_cuts import atom_of_piece, cut_atom, joined_atom

SPLIT_MARK = hashlib.sha256(b"scenefold/split").digest()[:16]
PART_MARK = hashlib.sha256(b"scenefold/part").digest()[:16]
"""No other payload begins with these bytes."""
PARTS_MIN, PARTS_MAX = 2, 256
_VERSION = 1
_ENTRY = struct.Struct(">16sBBHI32s")
_NAMED = struct.Struct(">20s32s")
_PART = struct.Struct(">16sBBHH20s32sQQIQ32s")
assert (LOCATION_BYTES, DIGEST_BYTES, GENESIS_BYTES) == (20, 32, 32)
assert _ENTRY.size + PARTS_MAX * _NAMED.size <= PAYLOAD_BYTES_MAX


class Cut(IntEnum):
    """What the content of a part is a piece of."""

    BYTES = 0
    TRIANGLES = 1


class MissingPart(DamagedData):
    """A part that an entry point names is not there, or another one is."""


@dataclass(frozen=True, slots=True)
class NamedPart:
    """A part as its entry point names it: its place, and the SHA-256 of its payload."""

    location: Location
    digest: bytes


@dataclass(frozen=True, slots=True)
class SplitEntry:
    """The entry point of a split record. `length` and `digest`: of the whole payload."""

    cut: Cut
    length: int
    digest: bytes
    parts: tuple[NamedPart, ...]

    @classmethod
    def of(cls, cut: Cut, whole: bytes, places: Sequence[Location], parts: Sequence[bytes]) -> SplitEntry:
        """That of a whole payload whose parts, payloads in order, lie at these places."""
        named = tuple(NamedPart(place, digest_of(part)) for place, part in zip(places, parts, strict=True))
        return cls(cut, len(whole), digest_of(whole), named)

    def names(self, location: Location, payload: bytes) -> bool:
        """Whether this very part, at this place, is one of its own."""
        return NamedPart(location, digest_of(payload)) in self.parts


@dataclass(frozen=True, slots=True)
class Part:
    """One part of a split record. `content`: a piece of the whole payload, as `cut` says."""

    cut: Cut
    number: int
    count: int
    entry: Location
    genesis: bytes
    made_from: Version
    """The version of the record at the entry point from which this was made."""
    content: bytes

    @property
    def payload_alone(self) -> bytes:
        """What it holds by itself; DamagedData if that is no piece of an atom."""
        return atom_of_piece(self.content) if self.cut is Cut.TRIANGLES else self.content


def digest_of(payload: bytes) -> bytes:
    """The SHA-256 by which payloads are named here."""
    return hashlib.sha256(payload).digest()


def is_split(payload: bytes) -> bool:
    """Whether this is the payload of an entry point."""
    return payload[: len(SPLIT_MARK)] == SPLIT_MARK


def is_part(payload: bytes) -> bool:
    return payload[: len(PART_MARK)] == PART_MARK


def encode_entry(entry: SplitEntry) -> bytes:
    head = _ENTRY.pack(SPLIT_MARK, _VERSION, entry.cut, len(entry.parts), entry.length, entry.digest)
    return head + b"".join(_NAMED.pack(part.location, part.digest) for part in entry.parts)


def decode_entry(payload: bytes) -> SplitEntry:
    """The entry point; DamagedData if anything is off."""
    _require(len(payload) >= _ENTRY.size, "an entry point of a split record is cut short")
    mark, version, cut, count, length, digest = _ENTRY.unpack_from(payload)
    _require(mark == SPLIT_MARK and version == _VERSION, f"an entry point of a split record has the unknown version {version}")
    _require(cut in tuple(Cut) and PARTS_MIN <= count <= PARTS_MAX, "an entry point of a split record is cut in an unknown way")
    _require(length <= PAYLOAD_BYTES_MAX, "an entry point speaks of more than a record holds")
    _require(len(payload) == _ENTRY.size + count * _NAMED.size, "an entry point of a split record has another length than its parts take")
    named = (_NAMED.unpack_from(payload, _ENTRY.size + number * _NAMED.size) for number in range(count))
    return SplitEntry(Cut(cut), length, digest, tuple(NamedPart(Location(place), part) for place, part in named))


def encode_part(part: Part) -> bytes:
    head = _PART.pack(
        PART_MARK, _VERSION, part.cut, part.number, part.count, part.entry, part.genesis, *part.made_from[:4], part.made_from[4]
    )
    return head + part.content


def decode_part(payload: bytes) -> Part:
    """The part; DamagedData if anything is off. Its content is looked at when it is put together."""
    _require(len(payload) >= _PART.size, "a part of a split record is cut short")
    mark, version, cut, number, count, entry, genesis, *made_from = _PART.unpack_from(payload)
    _require(mark == PART_MARK and version == _VERSION, f"a part of a split record has the unknown version {version}")
    _require(cut in tuple(Cut) and PARTS_MIN <= count <= PARTS_MAX and number < count, "a part of a split record is none of its parts")
    epoch, seq, writer, session, digest = made_from
    return Part(Cut(cut), number, count, Location(entry), genesis, (epoch, seq, writer, session, digest), payload[_PART.size :])


def contents_of(whole: bytes, cut: Cut, count: int) -> list[bytes]:
    """The payload cut into so many pieces, of about equal numbers of bytes or triangles. DamagedData if it is no atom that can be cut so.

    The caller sees to it that there are so many bytes or triangles.
    """
    if cut is Cut.TRIANGLES:
        return cut_atom(whole, count)
    bounds = [len(whole) * number // count for number in range(count + 1)]
    return [whole[first:last] for first, last in pairwise(bounds)]


def whole_of(entry: SplitEntry, at: Location, payloads: Sequence[bytes | None]) -> bytes:
    """The payload that was split, of the payloads that lie at the places of its parts; MissingPart, or DamagedData, if it cannot be had."""
    contents = []
    for number, (named, payload) in enumerate(zip(entry.parts, payloads, strict=True)):
        if payload is None or digest_of(payload) != named.digest:
            what = "is not there" if payload is None else "was replaced"
            raise MissingPart(f"part {number} of {len(entry.parts)} of a split record, at {named.location.hex()}, {what}")
        part = decode_part(payload)
        mine = part.cut is entry.cut and (part.number, part.count, part.entry) == (number, len(entry.parts), at)
        _require(mine, f"part {number} of a split record is one of another record")
        contents.append(part.content)
    whole = joined_atom(contents) if entry.cut is Cut.TRIANGLES else b"".join(contents)
    _require(
        (len(whole), digest_of(whole)) == (entry.length, entry.digest), "the parts of a split record make another payload than was split"
    )
    return whole


def _require(holds: bool, otherwise: str) -> None:
    if not holds:
        raise DamagedData(otherwise)

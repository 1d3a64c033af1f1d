"""Parts of packets as bytes of their own: what is signed, hashed or kept in a file."""

from __future__ import annotations

from typing import TypeVar

import msgpack

from scenefold.base.errors import LocalFault
from scenefold.base.limits import FRAME_BYTES_MAX
from scenefold.wire.errors import MalformedPacket, Misfit
from scenefold.wire.kinds import Kind
from scenefold.wire.tokens import TRUNCATED

T = TypeVar("T")


def pack_piece(kind: Kind[T], value: T, *, size_max: int = FRAME_BYTES_MAX) -> bytes:
    """The bytes of one value; LocalFault if a field is out of bounds."""
    try:
        plain = kind.plain(value)
    except Misfit as misfit:
        raise LocalFault(f"cannot be encoded: {misfit.problem}", where=f"{kind.text}{misfit.path}") from None
    packed: bytes = msgpack.packb(plain)
    if len(packed) > size_max:
        raise LocalFault(f"cannot be encoded: {len(packed)} bytes, at most {size_max} are allowed", where=kind.text)
    return packed


def unpack_piece(kind: Kind[T], data: bytes, *, size_max: int = FRAME_BYTES_MAX) -> T:
    """The value that `data` is, wholly; MalformedPacket otherwise."""
    if len(data) > size_max:
        raise MalformedPacket(kind.text, f"{len(data)} bytes, at most {size_max} are allowed")
    data = bytes(data)
    try:
        value, end = kind.read(data, 0)
        if end != len(data):
            raise Misfit(f"{len(data) - end} bytes too many")
    except Misfit as misfit:
        raise MalformedPacket(f"{kind.text}{misfit.path}", misfit.problem, unknown=misfit.unknown) from None
    except TRUNCATED:
        raise MalformedPacket(kind.text, "truncated") from None
    return value

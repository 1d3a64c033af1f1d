"""Parts of packets as bytes of their own: what is signed, hashed or kept in a file."""

from __future__ import annotations

from typing import TypeVar

import msgpack

from scenefold.base.errors import LocalFault
from scenefold.wire.errors import MalformedPacket, Misfit
from scenefold.wire.kinds import Struct
from scenefold.wire.tokens import TRUNCATED

T = TypeVar("T")


def pack_piece(kind: Struct[T], value: T) -> bytes:
    """The bytes of one struct; LocalFault if a field is out of bounds."""
    try:
        plain = kind.plain(value)
    except Misfit as misfit:
        raise LocalFault(f"cannot be encoded: {misfit.problem}", where=f"{kind.name}{misfit.path}") from None
    packed: bytes = msgpack.packb(plain)
    return packed


def unpack_piece(kind: Struct[T], data: bytes) -> T:
    """The struct that `data` is, wholly; MalformedPacket otherwise."""
    data = bytes(data)
    try:
        value, end = kind.read(data, 0)
        if end != len(data):
            raise Misfit(f"{len(data) - end} bytes too many")
    except Misfit as misfit:
        raise MalformedPacket(f"{kind.name}{misfit.path}", misfit.problem) from None
    except TRUNCATED:
        raise MalformedPacket(kind.name, "truncated") from None
    return value

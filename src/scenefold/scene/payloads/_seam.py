"""Stands in for wire's value codec until that is there."""

from typing import Any

import msgpack

from scenefold.base.errors import PeerFault


def pack_value(value: Any) -> bytes:
    return bytes(msgpack.packb(value, use_bin_type=True))


def unpack_value(payload: bytes, *, what: str = "") -> Any:
    try:
        return msgpack.unpackb(payload, raw=False, strict_map_key=True)
    except Exception as error:
        raise PeerFault(f"{what}: {error}") from error

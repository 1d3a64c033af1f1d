"""The small binary reader and writer under the payload codecs that hold arrays.

Every such payload begins with four letters that name its kind and a u16 version, all little endian. Reading
is strict: a short, long or otherwise odd payload is DamagedData with the kind's name in it. Arrays come out
as read-only views of the payload, without a copy.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from scenefold.base.errors import DamagedData
from scenefold.base.limits import PAYLOAD_BYTES_MAX

HEAD_BYTES = 6


def head(kind: bytes, version: int) -> bytes:
    """The first bytes of a payload: its kind (4 letters) and version."""
    return struct.pack("<4sH", kind, version)


def finish(parts: list[bytes]) -> bytes:
    """The payload made of `parts`; they were chosen to fit one record."""
    payload = b"".join(parts)
    assert len(payload) <= PAYLOAD_BYTES_MAX
    return payload


class PayloadReader:
    """Walks through one payload. Every misfit is DamagedData naming `what`."""

    def __init__(self, payload: bytes, kind: bytes, version: int, what: str, *, newest: int | None = None) -> None:
        """`newest`: versions from `version` to this are read, and `self.version` is the one found."""
        # bytes() of bytes is the same object; of a view it is a copy, which keeps our views read-only.
        self._payload = bytes(payload)
        self._offset = 0
        self._what = what
        self.require(len(self._payload) <= PAYLOAD_BYTES_MAX, "is larger than a record may be")
        found_kind, found_version = self.unpack("4sH")
        self.require(found_kind == kind, "does not begin with its mark")
        self.require(version <= found_version <= (newest or version), f"has the unknown version {found_version}")
        self.version: int = found_version

    def require(self, holds: bool, otherwise: str) -> None:
        """DamagedData unless `holds`; `otherwise` completes the sentence "the payload ..."."""
        if not holds:
            raise DamagedData(f"the payload of a {self._what} {otherwise}")

    def unpack(self, layout: str) -> tuple[Any, ...]:
        """The next fields, little endian and unpadded, in struct's letters."""
        size = struct.calcsize("<" + layout)
        self.require(self._offset + size <= len(self._payload), "is cut short")
        fields = struct.unpack_from("<" + layout, self._payload, self._offset)
        self._offset += size
        return fields

    def array(self, dtype: DTypeLike, *shape: int) -> NDArray[Any]:
        """The next array of this type and shape, as a read-only view."""
        kind = np.dtype(dtype)
        count = 1
        for length in shape:
            count *= length
        size = count * kind.itemsize
        self.require(self._offset + size <= len(self._payload), "is cut short")
        view = np.frombuffer(self._payload, kind, count, self._offset).reshape(shape)
        self._offset += size
        return view

    def end(self) -> None:
        """DamagedData if bytes are left over."""
        self.require(self._offset == len(self._payload), "has bytes behind its end")

"""Frames on a stream: length (u32, big endian), then one packet (specs/03-wire.md, Frames).

    | length: 4 bytes | packet: length bytes | length: 4 bytes | ...

Sans I/O: bytes in, packets' bytes out. The limit is judged as soon as the length has arrived, before anything is
set aside for it. What is incomplete is kept in one growing buffer, so that a sender of single bytes costs no more
memory than the frame, and a frame of 8 MiB two copies however small the pieces were that it came in.
"""

from __future__ import annotations

import struct

from scenefold.base.errors import LocalFault
from scenefold.base.limits import FRAME_BYTES_MAX
from scenefold.wire.errors import MalformedPacket

_LENGTH = struct.Struct(">I")


def frame(payload: bytes) -> bytes:
    """A packet's bytes as a frame; LocalFault if it exceeds the limit."""
    if not 0 < len(payload) <= FRAME_BYTES_MAX:
        raise LocalFault(f"a frame of {len(payload)} bytes, 1 to {FRAME_BYTES_MAX} are allowed")
    return _LENGTH.pack(len(payload)) + payload


class FrameReader:
    """Cuts a stream into frames. After a MalformedPacket the stream is lost: close it."""

    def __init__(self, frame_bytes_max: int = FRAME_BYTES_MAX) -> None:
        self._frame_bytes_max = frame_bytes_max
        self._held = bytearray()
        # The length of the frame that is being read; 0 while the length itself is awaited.
        self._length = 0

    @property
    def at_boundary(self) -> bool:
        """Whether the stream may end here; if not, a frame was truncated."""
        return not self._held and not self._length

    @property
    def awaited_bytes(self) -> int:
        """Size of the packet that has begun to arrive; 0 between two, and while its length is still incomplete."""
        return self._length

    def feed(self, data: bytes) -> list[bytes]:
        """Takes what arrived, gives the frames that it completes; MalformedPacket for a length out of bounds."""
        held = self._held
        held += data
        frames: list[bytes] = []
        at = 0
        with memoryview(held) as view:
            while True:
                if not self._length:
                    if len(held) - at < _LENGTH.size:
                        break
                    self._length = self._checked(_LENGTH.unpack_from(view, at)[0])
                    at += _LENGTH.size
                if len(held) - at < self._length:
                    break
                frames.append(bytes(view[at : at + self._length]))
                at += self._length
                self._length = 0
        # Once per call, not once per frame: cutting the front off may move the rest.
        del held[:at]
        return frames

    def _checked(self, length: int) -> int:
        if not 0 < length <= self._frame_bytes_max:
            raise MalformedPacket("frame.length", f"{length} bytes, 1 to {self._frame_bytes_max} are allowed")
        return length

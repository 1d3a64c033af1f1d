"""Frames on a stream: length (u32, big endian), then one packet (specs/03-wire.md, Frames).

    | length: 4 bytes | packet: length bytes | length: 4 bytes | ...

Sans I/O: bytes in, packets' bytes out. The limit is judged as soon as the length has arrived, before anything is
set aside for it. What has come of a frame is kept in pieces, as it came, and joined once, when the last of it is there; pieces that
are small are gathered, so that a sender of single bytes costs no more memory than the frame: two copies of 8 MiB at most.
"""

from __future__ import annotations

import struct

from scenefold.base.errors import LocalFault
from scenefold.base.limits import FRAME_BYTES_MAX
from scenefold.wire.errors import MalformedPacket

_LENGTH = struct.Struct(">I")
_PIECE_BYTES_MIN = 4096
"""A smaller piece is not kept by itself."""


def frame(payload: bytes) -> bytes:
    """A packet's bytes as a frame; LocalFault if it exceeds the limit."""
    if not 0 < len(payload) <= FRAME_BYTES_MAX:
        raise LocalFault(f"a frame of {len(payload)} bytes, 1 to {FRAME_BYTES_MAX} are allowed")
    return _LENGTH.pack(len(payload)) + payload


class FrameReader:
    """Cuts a stream into frames. After a MalformedPacket the stream is lost: close it."""

    def __init__(self, frame_bytes_max: int = FRAME_BYTES_MAX) -> None:
        self._frame_bytes_max = frame_bytes_max
        # The length of the frame that is being read; 0 while the length itself is awaited.
        self._length = 0
        self._head = b""
        """What has come of an incomplete length."""
        self._pieces: list[bytes | bytearray] = []
        self._missing = 0
        """Of the frame that is being read."""

    @property
    def at_boundary(self) -> bool:
        """Whether the stream may end here; if not, a frame was truncated."""
        return not self._head and not self._length

    @property
    def awaited_bytes(self) -> int:
        """Size of the packet that has begun to arrive; 0 between two, and while its length is still incomplete."""
        return self._length

    def feed(self, data: bytes) -> list[bytes]:
        """Takes what arrived, gives the frames that it completes; MalformedPacket for a length out of bounds."""
        data = self._head + data if self._head else bytes(data)
        self._head = b""
        frames: list[bytes] = []
        at = 0
        while True:
            if not self._length:
                if len(data) - at < _LENGTH.size:
                    self._head = data[at:]
                    return frames
                self._length = self._missing = self._checked(_LENGTH.unpack_from(data, at)[0])
                at += _LENGTH.size
            if len(data) - at < self._missing:
                self._keep(data[at:])
                return frames
            end = at + self._missing
            frames.append(self._joined(data[at:end]))
            at, self._length = end, 0

    def _keep(self, piece: bytes) -> None:
        self._missing -= len(piece)
        if len(piece) >= _PIECE_BYTES_MIN:
            self._pieces.append(piece)
        elif self._pieces and isinstance(self._pieces[-1], bytearray):
            self._pieces[-1] += piece
        elif piece:
            self._pieces.append(bytearray(piece))

    def _joined(self, last: bytes) -> bytes:
        if not self._pieces:
            return last
        pieces, self._pieces = self._pieces, []
        return b"".join((*pieces, last))

    def _checked(self, length: int) -> int:
        if not 0 < length <= self._frame_bytes_max:
            raise MalformedPacket("frame.length", f"{length} bytes, 1 to {self._frame_bytes_max} are allowed")
        return length

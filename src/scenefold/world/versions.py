"""Which versions of the protocol the two ends of a connection take, and which one they talk (specs/03-wire.md, Versions).

The handshake agrees on the highest that both take. Where there is none it agrees on that: each end then sends its range
once, in bytes that are the same in every version, so that both can say what the two take and which one to upgrade.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from scenefold.base.errors import DamagedData, PeerFault
from scenefold.wire import PROTOCOL_VERSION

NO_VERSION = "scenefold"
"""The name (ALPN) of a connection on which nothing but the two ranges is said."""
NEWCOMER = "scenefold-enrol/1"
"""The name of a connection on which nothing is said but what a newcomer needs to get a certificate."""
RANGE_BYTES = 8
_RANGE = struct.Struct(">4sHH")
_MAGIC = b"SFDV"


class NoCommonVersion(PeerFault):
    """The two ends cannot talk; the words name both and say what to do."""


@dataclass(frozen=True, slots=True)
class Versions:
    """All versions from `lowest` to `highest`, 1 <= lowest <= highest <= 65,535."""

    lowest: int
    highest: int

    def __str__(self) -> str:
        return f"version {self.lowest}" if self.lowest == self.highest else f"versions {self.lowest} to {self.highest}"

    @property
    def names(self) -> list[str]:
        """What a handshake offers, the best first."""
        return [name_of(version) for version in range(self.highest, self.lowest - 1, -1)] + [NO_VERSION]

    def common(self, other: Versions) -> int | None:
        """The highest that both take."""
        highest = min(self.highest, other.highest)
        return highest if highest >= max(self.lowest, other.lowest) else None

    def named(self, name: str) -> int | None:
        """The version with this name, if we take it."""
        return next((version for version in range(self.lowest, self.highest + 1) if name_of(version) == name), None)

    def pack(self) -> bytes:
        return _RANGE.pack(_MAGIC, self.lowest, self.highest)

    @classmethod
    def unpack(cls, data: bytes) -> Versions:
        """DamagedData if this is no range."""
        if len(data) != RANGE_BYTES:
            raise DamagedData(f"a range of versions has {RANGE_BYTES} bytes, not {len(data)}")
        magic, lowest, highest = _RANGE.unpack(data)
        if magic != _MAGIC or not 1 <= lowest <= highest:
            raise DamagedData("these bytes are no range of versions")
        return cls(lowest, highest)

    def apart_from(self, other: Versions, peer: str) -> NoCommonVersion:
        """What to say to people where no version is common."""
        remedy = "upgrade this program" if self.highest < other.lowest else f"upgrade the program of {peer}"
        return NoCommonVersion(f"{peer} takes {other} of the protocol, this program {self}", remedy=remedy)

    def apart_from_nothing(self, peer: str) -> NoCommonVersion:
        """Likewise, of a peer that says nothing of versions."""
        what = f"{peer} names no version of the protocol, this program takes {self}"
        return NoCommonVersion(what, remedy=f"upgrade the program of {peer}")


TAKEN = Versions(1, PROTOCOL_VERSION)
"""What this program takes."""


def name_of(version: int) -> str:
    """The name (ALPN) of a version."""
    return f"scenefold/{version}"

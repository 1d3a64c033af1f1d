"""What a node does by itself with records: an administrator's orders to rest, to go on, and to be slower (specs/21-verify.md, Upkeep)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scenefold.wire.common import U64, Carrier, Packet, row
from scenefold.wire.kinds import Maybe, Uint

REPAIR = 1
SCRUB = 2
BALANCE = 4
ALL_DUTIES = REPAIR | SCRUB | BALANCE
"""Bits of the three duties."""


@dataclass(frozen=True, slots=True)
class ChangeUpkeep(Packet):
    """Of the duties `of`, pause those that are in `paused`, and go on with the others. Rates: nil leaves them, 0 is what the node was started with."""

    TYPE: ClassVar[int] = 116
    of: int = 0
    paused: int = 0
    transfer_bytes_per_s: int | None = None
    scrub_bytes_per_s: int | None = None


@dataclass(frozen=True, slots=True)
class UpkeepChanged(Packet):
    """What is paused, and at which rates the node moves and reads, as is durable now."""

    TYPE: ClassVar[int] = 117
    paused: int
    transfer_bytes_per_s: int
    scrub_bytes_per_s: int


_DUTIES = Uint(16, most=ALL_DUTIES)

ROWS = (
    row(
        ChangeUpkeep,
        Carrier.TCP_HIGH,
        ("of", _DUTIES),
        ("paused", _DUTIES),
        ("transfer_bytes_per_s", Maybe(U64)),
        ("scrub_bytes_per_s", Maybe(U64)),
    ),
    row(UpkeepChanged, Carrier.TCP_HIGH, ("paused", _DUTIES), ("transfer_bytes_per_s", U64), ("scrub_bytes_per_s", U64)),
)

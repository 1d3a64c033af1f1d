"""The version after ours, as it might be: every packet has one more field at its end, and there is a pair of packets more.

Tables of the wire are the module's, so in one process all programs share them: what a program takes and speaks is decided by the
versions of its world alone, as it is in a process of its own.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar
from unittest import mock

from scenefold.wire import PROTOCOL_VERSION, Packet, codec
from scenefold.wire.common import MESSAGE, U64, Carrier, row
from scenefold.wire.containers import Struct
from scenefold.wire.table import ROWS
from scenefold.world.versions import Versions

OURS = PROTOCOL_VERSION
NEXT = PROTOCOL_VERSION + 1
TODAY, TOMORROW, BOTH = Versions(OURS, OURS), Versions(NEXT, NEXT), Versions(OURS, NEXT)
ADDED = 2**63 + 1
"""In the field that each packet has more."""


@dataclass(frozen=True, slots=True)
class Wave(Packet):
    """A question that only the next version knows."""

    TYPE: ClassVar[int] = 200
    word: str


@dataclass(frozen=True, slots=True)
class WaveBack(Packet):
    """Its answer."""

    TYPE: ClassVar[int] = 201
    word: str


class Longer(Struct[Any]):
    """A packet with one more field at its end; `met` counts those that were read."""

    __slots__ = ("_met",)

    def __init__(self, ours: Struct[Any], met: Counter[str]) -> None:
        super().__init__(ours.build, *ours.fields, law=ours.law)
        self.fields = (*ours.fields, ("added", U64))
        self._met = met

    def plain_fields(self, value: Any) -> list[object]:
        return [*super().plain_fields(value), ADDED]

    def read_fields(self, data: bytes, at: int, count: int | None = None) -> tuple[list[Any], int]:
        values, at = super().read_fields(data, at, count)
        added, at = U64.read(data, at)
        assert added == ADDED
        self._met[self.name] += 1
        return values, at


@contextmanager
def next_version() -> Iterator[Counter[str]]:
    """While this lasts the wire knows the next version, too; counts what is read on its connections, by packet."""
    met = Counter[str]()
    rows = {one.TYPE: row(one, Carrier.TCP_HIGH, ("word", MESSAGE), since=NEXT) for one in (Wave, WaveBack)}
    known = ROWS | rows
    layouts: dict[int, Any] = {version: codec.layouts_of(known, version) for version in range(1, NEXT)}
    layouts[NEXT] = {number: Longer(layout, met) for number, layout in codec.layouts_of(known, NEXT).items()}
    with (
        mock.patch.dict(ROWS, rows),
        mock.patch.object(codec, "_LAYOUTS", layouts),
        mock.patch.object(codec, "PROTOCOL_VERSION", NEXT),
    ):
        yield met

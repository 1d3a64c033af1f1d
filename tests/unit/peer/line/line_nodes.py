"""Cells, registry views, nodes and messages of the model of the line (line_model)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from scenefold.base.ids import NodeId
from scenefold.base.location import Arc, Location
from scenefold.peer.line.holding import Holding
from scenefold.peer.line.holding_note import decode_holding, encode_holding
from scenefold.peer.line.sightings import Sightings
from scenefold.peer.line.survey import Survey
from scenefold.wire import Member

CELLS = 16
_CELL = (1 << 160) // CELLS


def arc_of_cells(first: int, last: int) -> Arc:
    return Arc(Location.from_number(first * _CELL), Location.from_number((last + 1) * _CELL - 1))


def cells_of(arc: Arc | None) -> range:
    return range(0) if arc is None else range(arc.first.number // _CELL, arc.last.number // _CELL + 1)


def place_of(cell: int) -> Location:
    return Location.from_number(cell * _CELL + _CELL // 2)


_decoded = lru_cache(maxsize=4096)(decode_holding)


@dataclass(frozen=True)
class Known:
    member: Member


@dataclass(frozen=True)
class View:
    """The registry at one position; `removals`: the members removed up to here."""

    position: int
    order: tuple[NodeId, ...]
    members: dict[NodeId, Member]
    removals: tuple[Member, ...] = ()

    def is_current(self, member: Member) -> bool:
        return self.members.get(member.node) == member

    def stands(self, node: NodeId) -> bool:
        return node in self.order

    def rank(self, node: NodeId) -> int:
        return self.order.index(node)

    def neighbours(self, node: NodeId) -> tuple[NodeId | None, NodeId | None]:
        rank = self.order.index(node)
        return (self.order[rank - 1] if rank else None), (self.order[rank + 1] if rank + 1 < len(self.order) else None)

    def founding_arc(self, node: NodeId) -> Arc | None:
        return None

    def current(self, node: NodeId) -> Known | None:
        return Known(self.members[node]) if node in self.members else None


@dataclass
class Search:
    """A survey under way (volatile): at which position and revision it began, whom it has asked, what it found."""

    survey: Survey
    position: int
    revision: int
    asked: NodeId | None = None
    serial: int = 0
    gap: Arc | None = None
    done: bool = False


@dataclass
class Node:
    member: Member
    position: int
    note: bytes
    """The durable holding, as bytes: every step goes through them."""
    records: dict[int, int] = field(default_factory=dict)
    leased: bool = False
    frozen: set[bytes] = field(default_factory=set)
    answered: dict[bytes, set[tuple[int, int]]] = field(default_factory=dict)
    search: Search | None = None
    sightings: Sightings = field(default_factory=Sightings)
    """Their moment: how many had been removed."""

    @property
    def holding(self) -> Holding:
        return _decoded(self.note)

    def keep(self, holding: Holding) -> None:
        self.note = encode_holding(holding)

    def crash(self) -> None:
        self.frozen, self.answered, self.search, self.leased = set(), {}, None, False
        self.sightings = Sightings()

    def strays(self) -> list[int]:
        holding = self.holding
        kept = [handover.piece for _, handover in holding.handovers]
        return [
            cell for cell in sorted(self.records) if not holding.owns(place_of(cell)) and not any(place_of(cell) in piece for piece in kept)
        ]


@dataclass(frozen=True)
class Message:
    target: Member
    source: Member
    kind: str
    body: Any


def even_right_bounds_of_cells(count: int) -> list[Location]:
    return [Location.from_number(CELLS * (index + 1) // count * _CELL - 1) for index in range(count)]

"""What is on its way between nodes, put together from the reports of giver and receiver, and what changes a second. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from scenefold.base.location import Arc
from scenefold.client.health import NodeState, stored_document
from scenefold.client.reports import HandoverReport


@dataclass(frozen=True, slots=True)
class Movement:
    """A handover, as both of its nodes see it or the one that answers."""

    id: str
    giver: str
    receiver: str
    step: str
    """The giver's, if it answers: offered (being copied), released, given (the giver deletes); else noted or taken."""
    piece: Arc
    records: int | None
    """In the piece at the giver; None if that does not answer."""
    records_arrived: int | None
    """At the receiver; None if that does not answer, or has forgotten it."""
    seconds: float

    @property
    def progress(self) -> float:
        """0 to 1: how much has arrived. From the release on, all."""
        if self.step not in ("offered", "noted"):
            return 1.0
        if not self.records or self.records_arrived is None:
            return 0.0
        return min(1.0, self.records_arrived / self.records)

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "id": self.id,
            "giver": self.giver,
            "receiver": self.receiver,
            "step": self.step,
            "first": self.piece.first.hex(),
            "last": self.piece.last.hex(),
            "records": self.records,
            "records_arrived": self.records_arrived,
            "progress": round(self.progress, 4),
            "seconds": self.seconds,
        }


def movements(nodes: Iterable[NodeState]) -> list[Movement]:
    """All handovers that some node speaks of, in the order of the line of who speaks first."""
    views: dict[str, list[tuple[str, HandoverReport]]] = {}
    for node in nodes:
        for handover in () if node.report is None else node.report.handovers:
            views.setdefault(handover.id, []).append((node.address, handover))
    return [_movement(handover, seen) for handover, seen in views.items()]


def _movement(handover: str, seen: Sequence[tuple[str, HandoverReport]]) -> Movement:
    giving = next(((address, view) for address, view in seen if view.gives), None)
    taking = next(((address, view) for address, view in seen if not view.gives), None)
    address, view = giving or taking or seen[0]
    return Movement(
        id=handover,
        giver=address if view.gives else view.peer,
        receiver=view.peer if view.gives else address,
        step=view.step,
        piece=view.piece,
        records=None if giving is None else giving[1].records,
        records_arrived=None if taking is None else taking[1].records,
        seconds=max(other.seconds for _, other in seen),
    )


@dataclass(frozen=True, slots=True)
class Rate:
    """What changed at a node between two looks, a second; None where one of the looks got no answer."""

    node: NodeState
    records_per_second: float | None
    bytes_per_second: float | None

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        silent = self.node.last is not None and not self.node.alive
        return {
            **self.node.document(),
            **(stored_document(self.node.last) if silent else {}),
            "said_s": 0.0 if self.node.alive else self.node.last_s if silent else None,
            "records_per_second": self.records_per_second,
            "bytes_per_second": self.bytes_per_second,
        }


def rates(before: Iterable[NodeState], now: Iterable[NodeState], seconds: float) -> list[Rate]:
    """The nodes of the later look with what has changed in them. Restarted ones count on: the store does."""
    known = {node.address: node.report for node in before}
    found = []
    for node in now:
        old = known.get(node.address)
        if node.report is None or old is None or seconds <= 0:
            found.append(Rate(node, None, None))
        else:
            records, size = node.report.records - old.records, node.report.bytes - old.bytes
            found.append(Rate(node, records / seconds, size / seconds))
    return found

"""Who was taken off the line, and why, as the cluster's log tells it (specs/15-cluster-log.md). Pure.

The log has no clock: its positions say in which order things happened. Reasons are words of whoever proposed the removal.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from scenefold.base.ids import address_of
from scenefold.world.log_view import LogView


@dataclass(frozen=True, slots=True)
class RemovedNode:
    """One removal."""

    address: str
    incarnation: bytes
    position: int
    """Of the cluster's log."""
    reason: str
    by: str
    """Address of the node that proposed it: the node itself if it was drained."""
    is_back: bool
    """It stands on the line again, in a later incarnation."""

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "address": self.address,
            "incarnation": self.incarnation.hex(),
            "position": self.position,
            "reason": self.reason,
            "by": self.by,
            "is_back": self.is_back,
        }


def removed_nodes(view: LogView) -> tuple[RemovedNode, ...]:
    """All removals, the newest first."""
    return tuple(
        RemovedNode(
            address=address_of(removal.member.node),
            incarnation=removal.member.incarnation,
            position=removal.position,
            reason=removal.reason,
            by=address_of(removal.by),
            is_back=removal.member.node in view.order,
        )
        for removal in reversed(view.removals)
    )


def still_gone(removed: Iterable[RemovedNode]) -> tuple[RemovedNode, ...]:
    """Of removals, newest first: the last one of each node that is not on the line now."""
    found: dict[str, RemovedNode] = {}
    for one in removed:
        if not one.is_back:
            found.setdefault(one.address, one)
    return tuple(found.values())

"""Parts of the notes in which custody and configurations are kept: arcs, members, layouts, each strictly. Pure.

Members and layouts come again and again, so a note names each once, and after that by its number.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from scenefold.base.ids import NodeId
from scenefold.base.limits import COPIES_MAX, SHADOWS_MAX
from scenefold.base.location import FIRST, Arc, Location
from scenefold.base.placement import Layout
from scenefold.base.plain_values import exactly, whole
from scenefold.wire import Member

NUMBER_MAX = (1 << 64) - 1
_NODE_MAX = (1 << 32) - 1
_INCARNATION_BYTES = 16


class Names:
    """Members and layouts of a note that is written, in the order in which they come."""

    def __init__(self) -> None:
        self._members: dict[Member, int] = {}
        self._layouts: dict[Layout, int] = {}

    def member(self, member: Member) -> int:
        return self._members.setdefault(member, len(self._members))

    def members(self, members: Sequence[Member]) -> list[int]:
        return [self.member(member) for member in members]

    def layout(self, layout: Layout) -> int:
        return self._layouts.setdefault(layout, len(self._layouts))

    def plain(self) -> dict[str, Any]:
        return {
            "members": [[member.node, member.incarnation] for member in self._members],
            "layouts": [[bytes(offset) for offset in layout] for layout in self._layouts],
        }


class Known:
    """Those of a note that is read. What is wrong raises ValueError, TypeError or IndexError."""

    def __init__(self, value: Any) -> None:
        self._members = [
            Member(NodeId(whole(node, 0, _NODE_MAX)), exactly(incarnation, _INCARNATION_BYTES)) for node, incarnation in value["members"]
        ]
        self._layouts = [_layout(offsets) for offsets in value["layouts"]]

    def member(self, index: Any) -> Member:
        return self._members[whole(index, 0, len(self._members) - 1)]

    def members(self, indexes: Any, *, least: int = 1) -> tuple[Member, ...]:
        found = tuple(map(self.member, indexes))
        if not least <= len(found) <= COPIES_MAX or len(set(found)) < len(found):
            raise ValueError("members that are too few, too many, or twice the same")
        return found

    def layout(self, index: Any) -> Layout:
        return self._layouts[whole(index, 0, len(self._layouts) - 1)]


def _layout(offsets: Any) -> Layout:
    layout = tuple(Location(exactly(offset, len(FIRST))) for offset in offsets)
    if len(layout) > SHADOWS_MAX or len(set(layout)) < len(layout) or FIRST in layout:
        raise ValueError("not the offsets of shadows")
    return layout


def plain_arc(arc: Arc) -> list[bytes]:
    return [bytes(arc.first), bytes(arc.last)]


def arc_of(first: Any, last: Any) -> Arc:
    return Arc(Location(exactly(first, len(FIRST))), Location(exactly(last, len(FIRST))))


def number_of(value: Any) -> int:
    return whole(value, 0, NUMBER_MAX)


def truth(value: Any) -> bool:
    if not isinstance(value, bool):
        raise TypeError("yes or no is expected")
    return value

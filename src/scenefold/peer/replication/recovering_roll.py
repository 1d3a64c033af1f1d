"""Who has to be heard before a gap counts as recovered (specs/20-copies.md, Recovery). Pure.

Everybody that the log names when the asking begins. Who joins later is a new incarnation: it holds nothing for anybody, and what is on its
disk are strays. Who is removed need not be heard, but its leases must be over: by what only it knows somebody might still be answered.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from scenefold.base.location import Arc
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.entries import Entry
from scenefold.peer.copies.numbers import first_number
from scenefold.wire import Member


class Roll:
    """Of one asking about one gap; a restart begins another one."""

    def __init__(self, gap: Arc, position: int, me: Member, registered: Iterable[Member]) -> None:
        """`position`: of the cluster's log, and who was registered there. This node knows what is on its own disk."""
        self.gap = gap
        self.position = position
        self.asked = tuple(sorted(set(registered) - {me}, key=lambda member: (member.node, member.incarnation)))
        self._heard: dict[Member, tuple[Entry, ...]] = {}
        self._lost: set[Member] = set()

    @property
    def number(self) -> int:
        """Below it whoever answers takes nothing in the gap any more; here the numbers of its owner begin."""
        return first_number(self.position)

    def missing(self) -> list[Member]:
        """Who is still to be heard."""
        return [member for member in self.asked if member not in self._heard and member not in self._lost]

    def hear(self, member: Member, entries: Sequence[Entry]) -> None:
        """All that a node has of the gap is here."""
        self._heard[member] = tuple(entries)

    def lose(self, member: Member) -> None:
        """The log has removed a node, and T_wait has passed since this node learnt that. What it has said before counts."""
        self._lost.add(member)

    def recover(self, copies: Copies) -> Copies:
        """What is known about copies once the gap is recovered; only when nobody is missing."""
        assert not self.missing()
        return copies.recover(self.gap, self._heard, self.number)

"""When a write counts as done, made of its segment once and asked for each answer of a holder (specs/20-copies.md, Writes). Pure."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass

from scenefold.base.ids import NodeId
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.segment import Segment
from scenefold.wire import Member


@dataclass(frozen=True, slots=True, eq=False)
class Rule:
    """That of one segment, as `Segment.is_settled` says it, and of its next configuration as soon as that may become the active one.

    Else a write could be acknowledged, by the old configuration, between the look at what is owed and the change that relies on that look.
    """

    me: Member
    is_placed: bool
    """Whether there are holders by placement."""
    targets: tuple[Member, ...]
    """To whom every write is sent."""
    placed: frozenset[Member]
    """Who may count for the first rule: this owner, and the holders by placement."""
    debtors: tuple[NodeId, ...]
    sound: frozenset[Member]
    """Who lacks nothing but what is owed to it."""
    quorums: tuple[tuple[frozenset[Member], int], ...]
    """Of so many of each of these."""

    @classmethod
    def of(cls, segment: Segment, me: Member) -> Rule:
        quorums = [(frozenset(found.members), found.needed) for found in segment.configurations if not segment.is_closed(found, me)]
        change = segment.change
        if change is not None and segment.sound.issuperset(change.holders):
            members = frozenset((me, *change.holders))
            quorums.append((members, min(change.needed, len(members))))
        targets = tuple(segment.holders(me))
        return cls(
            me,
            change is not None or segment.active(me) is not None,
            targets,
            frozenset((me, *segment.placed(me))),
            tuple(target.node for target in targets),
            segment.sound,
            tuple(quorums),
        )

    def is_settled(self, have: Set[Member], needed: int) -> bool:
        """Rules 1 and 2 for a version that these nodes have, the owner among them."""
        return len(self.placed & have) >= needed and self.is_safe(have)

    def is_safe(self, have: Set[Member]) -> bool:
        """Rule 2 alone: whoever may be asked instead of the owner, one that has it is among them."""
        return all(len(members & have) >= least for members, least in self.quorums)


class Rules:
    """The rules of one state of what is known about copies. Segments that are the same object in the state before keep theirs."""

    def __init__(self, copies: Copies, former: Rules | None = None) -> None:
        self.copies = copies
        self._me = copies.configurations.me
        self._known: dict[int, tuple[Segment, Rule]] = {}
        """By identity, which a segment keeps as long as it stands here."""
        self._former = former._known if former is not None else {}

    def of(self, segment: Segment) -> Rule:
        """`segment`: one of this very state."""
        known = self._known.get(id(segment))
        if known is None:
            known = self._former.get(id(segment))
            if known is None or known[0] is not segment:
                known = segment, Rule.of(segment, self._me)
            self._known[id(segment)] = known
        return known[1]

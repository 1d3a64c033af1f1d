"""Who owns by now what another node owned that is gone: for a while it may not tell what lies there (specs/20-copies.md, Reads). Pure.

Until an adopter knows all that was acknowledged, and enough others have that again, it waits before it tells. With what it owned before
it is quick all the while: how long those answers take says nothing of these. And what it was asked, and nobody waits for any more, it
works at nevertheless; so it is asked now and then, until it tells.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Set
from enum import Enum, auto

from scenefold.base.ids import NodeId

LEFT_ALONE_S = 1.0
"""So long an adopter that was too slow is asked only what nobody else can tell."""
KEPT_MAX = 4_096
_TELLS = -math.inf

Gone = Set[NodeId]
"""Who owned a place, and is silent, not there, or owns nothing any more."""


class Turn(Enum):
    """Who is asked."""

    OWNER = auto()
    """As anywhere: others if it is slow."""
    BOTH = auto()
    """At once."""
    HOLDERS = auto()
    """The owner if they do not know."""


class Adopters:
    """Of one client. Times are those of its clock."""

    def __init__(self) -> None:
        self._until: OrderedDict[tuple[NodeId, NodeId], float] = OrderedDict()
        """Of an owner and one who is gone: until when the first is left alone. The latest last."""

    def turn(self, now: float, owner: NodeId, gone: Gone) -> Turn:
        """Whom to ask now for places of some who are gone. After BOTH the answer is to be noted; until then it is HOLDERS for others."""
        untils = {one: self._until.get((owner, one), now) for one in gone}
        asked = [one for one, until in untils.items() if until != _TELLS]
        if not asked:
            return Turn.OWNER
        if any(now < until for until in untils.values()):
            return Turn.HOLDERS
        self.was_late(now, owner, set(asked))
        return Turn.BOTH

    def was_sooner(self, owner: NodeId, gone: Gone) -> None:
        """It has answered for their places before those who hold copies did."""
        self._note(owner, gone, _TELLS)

    def was_late(self, now: float, owner: NodeId, gone: Gone) -> None:
        """They knew sooner."""
        self._note(owner, gone, now + LEFT_ALONE_S)

    def _note(self, owner: NodeId, gone: Gone, until: float) -> None:
        for one in gone:
            self._until[owner, one] = until
            self._until.move_to_end((owner, one))
        while len(self._until) > KEPT_MAX:
            self._until.popitem(last=False)

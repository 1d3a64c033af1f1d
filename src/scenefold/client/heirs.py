"""Who owns by now what a node owned that is gone: for a while it cannot say what lies there (specs/20-copies.md, Reads). Pure.

Until it knows all that was acknowledged, and enough others have that again, it waits before it tells; and it may be quick all the while
with what it owned before. So how long its other answers take says nothing of these.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Set

from scenefold.base.ids import NodeId

SPEAKS = 8
"""So often in a row it was sooner than those who hold copies: it knows what lies there."""
KEPT_MAX = 256

Gone = Set[NodeId]
"""Who owned a place, and is silent, or owns nothing any more."""


class Heirs:
    """Of one client."""

    def __init__(self) -> None:
        self._sooner: OrderedDict[tuple[NodeId, frozenset[NodeId]], int] = OrderedDict()
        """How often in a row an owner was, of the places of some who are gone; the latest last."""

    def may_be_mute(self, owner: NodeId, gone: Gone) -> bool:
        """Whether others had better be asked as well, at once."""
        return bool(gone) and self._sooner.get((owner, frozenset(gone)), 0) < SPEAKS

    def was_sooner(self, owner: NodeId, gone: Gone) -> None:
        """It has answered for their places."""
        self._note(owner, gone, self._sooner.get((owner, frozenset(gone)), 0) + 1)

    def was_late(self, owner: NodeId, gone: Gone) -> None:
        """Those who hold copies knew sooner."""
        self._note(owner, gone, 0)

    def _note(self, owner: NodeId, gone: Gone, count: int) -> None:
        key = owner, frozenset(gone)
        self._sooner[key] = count
        self._sooner.move_to_end(key)
        if len(self._sooner) > KEPT_MAX:
            self._sooner.popitem(last=False)
